"""Helms that steer courses known beforehand, and what stands between a helm and a simulator: fixes with errors, orders held.

Depends on autopilot, helms, pilot, reference_model and orders.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aspnn.guidance.autopilot import CourseAutopilot
from aspnn.guidance.helms import EAST, HEADING, NORTH, YAW_RATE, Helm
from aspnn.guidance.pilot import Estimate, Navigation
from aspnn.guidance.reference_model import ReferenceModel
from aspnn.orders import Orders
from aspnn.schema import InputError


@dataclass(frozen=True)
class CourseLoop:
    """The parts of a helm that steers courses [rad], a series of orders per ship."""

    navigation: Navigation
    courses: Sequence[Orders]
    reference: ReferenceModel
    autopilot: CourseAutopilot


class CourseHelm:
    """A helm (guidance.helms) that steers courses known beforehand. `make(ships)` builds the parts, anew at the first call of each run.

    Navigation -> reference model -> autopilot, paper 001 section 5. Until navigation is ready nothing is ordered; the reference
    begins on the ship's own course then, so that nothing jumps. `estimates` are what navigation told at every call of the last run.
    """

    def __init__(self, make: Callable[[int], CourseLoop]):
        self.make = make
        self.loop: CourseLoop | None = None
        self.estimates: list[Estimate] = []

    def __call__(self, time: float, state: np.ndarray) -> np.ndarray:
        ships = len(state)
        if time <= 1e-9 or self.loop is None:
            self.loop, self.estimates = self.make(ships), []
            self._before, self._begun = time, np.zeros(ships, bool)
        loop, dt, self._before = self.loop, time - self._before, time
        now = loop.navigation(time, state)
        loop.reference.begin(now.course, now.ready & ~self._begun)
        self._begun = self._begun | now.ready
        wanted = loop.reference.step(dt, np.array([float(one.at(time)) for one in loop.courses]))
        self.estimates.append(now)
        return loop.autopilot.command(dt, now.course, now.course_rate, *wanted)


class Fixes:
    """A receiver (pilot.Receiver): a fix every `period` [s], `errors` (ships, 2, fixes) [m] off to north and east; NaN between fixes.

    Asked more seldom than that, it gives the latest that is due.
    """

    def __init__(self, errors: np.ndarray, period: float):
        if not period > 0:
            raise InputError(f"navigation: a fix every {period:g} s; the time between fixes must be above 0")
        self.errors, self.period, self._last = errors, period, -1

    def __call__(self, time: float, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """North and east (ships,) [m] at `time` [s], which must rise from call to call."""
        due = int(time / self.period + 1e-6)
        if due == self._last:
            none = np.full(len(state), np.nan)
            return none, none
        self._last = due
        return state[:, NORTH] + self.errors[:, 0, due], state[:, EAST] + self.errors[:, 1, due]


class Compass:
    """Navigation by a compass: a `ground` navigation's with the true heading and yaw rate in place of the course and its rate.

    For laws that steer a heading.
    """

    def __init__(self, ground: Navigation):
        self.ground = ground

    def __call__(self, time: float, state: np.ndarray) -> Estimate:
        return self.ground(time, state)._replace(course=state[:, HEADING].copy(), course_rate=state[:, YAW_RATE].copy())


class Sampled:
    """A helm that is asked every `every` [s] and whose order is held between, as that of an autopilot with a clock of its own."""

    def __init__(self, helm: Helm, every: float):
        if not every > 0:
            raise InputError(f"helm: asked every {every:g} s; the time must be above 0")
        self.helm, self.every = helm, every

    def __call__(self, time: float, state: np.ndarray) -> np.ndarray:
        if time <= 1e-9:
            self._due = 0.0
        if time >= self._due - 1e-9:
            self._order = self.helm(time, state)
            self._due += self.every
        return self._order
