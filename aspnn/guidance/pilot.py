"""The helm that follows a path: navigation, guidance law, reference filter and course autopilot in one loop, for a batch of ships.

Depends on autopilot, helms, los and route.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from aspnn.guidance import helms
from aspnn.guidance.autopilot import CourseAutopilot, ReferenceFilter
from aspnn.guidance.los import Law, Rate
from aspnn.guidance.route import PathError


class Estimate(NamedTuple):
    """What a ship knows of its motion over ground, each (ships,); `ready` where it knows anything yet."""

    north: np.ndarray
    east: np.ndarray
    speed: np.ndarray
    course: np.ndarray
    course_rate: np.ndarray
    ready: np.ndarray


class Navigation(Protocol):
    """Tells the motion over ground from the simulator's states (ships, columns of helms) at `time` [s]."""

    def __call__(self, time: float, state: np.ndarray) -> Estimate: ...


class Following(Protocol):
    """Tells where ships are on their paths."""

    def update(self, north: np.ndarray, east: np.ndarray) -> PathError: ...


class Tracker(Protocol):
    """A filter of positions, such as estimation.course.CourseTracker; a fix that is missing is NaN."""

    ready: np.ndarray

    def step(self, time: float | None, north: np.ndarray, east: np.ndarray) -> None: ...
    @property
    def north(self) -> np.ndarray: ...
    @property
    def east(self) -> np.ndarray: ...
    @property
    def speed(self) -> np.ndarray: ...
    @property
    def course(self) -> np.ndarray: ...
    @property
    def course_rate(self) -> np.ndarray: ...


Receiver = Callable[
    [float, np.ndarray], tuple[np.ndarray, np.ndarray]
]  # (time, states) -> north, east of the fixes (ships,) [m]


class TrueNavigation:
    """The true motion over ground, by differencing the true positions: speed, course and its rate of the last step."""

    def __init__(self) -> None:
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None  # time, place as a complex number, course

    def __call__(self, time: float, state: np.ndarray) -> Estimate:
        place = state[:, helms.NORTH] + 1j * state[:, helms.EAST]
        ready = np.ones(len(state), bool)
        if self._last is None:  # no current is known yet: through the water
            velocity = (state[:, helms.SURGE] + 1j * state[:, helms.SWAY]) * np.exp(1j * state[:, helms.HEADING])
            course, rate = np.angle(velocity), state[:, helms.YAW_RATE]
        else:
            before, start, last = self._last
            velocity = (place - start) / (time - before)
            turned = np.angle(velocity * np.exp(-1j * last)) * (velocity != 0)
            course, rate = last + turned, turned / (time - before)
        self._last = time, place, course
        return Estimate(place.real, place.imag, np.abs(velocity), course, rate, ready)


class TrackedNavigation:
    """What a filter makes of the fixes of a receiver."""

    def __init__(self, tracker: Tracker, receiver: Receiver):
        self.tracker, self.receiver = tracker, receiver

    def __call__(self, time: float, state: np.ndarray) -> Estimate:
        t = self.tracker
        t.step(time, *self.receiver(time, state))
        told = t.north, t.east, t.speed, t.course, t.course_rate
        north, east, speed, course, rate = (np.where(t.ready, x, np.nan) for x in told)
        return Estimate(north, east, speed, course, rate, np.array(t.ready))


@dataclass(frozen=True)
class Loop:
    """The parts of a helm. `rate` tells how fast the law's course turns, for the feed-forward; None: it is not fed forward."""

    navigation: Navigation
    follower: Following
    law: Law
    rate: Rate | None
    reference: ReferenceFilter
    autopilot: CourseAutopilot


class Thought(NamedTuple):
    """What a helm thought at an instant, each (ships,); of a whole run (calls, ships), with `time` (calls,).

    North, east, speed, course and course rate as estimated; `cross` as it saw it; `desired` what the law asked for,
    `reference` and its rate what the filter made of that (continuous); `order` the rudder [rad]. NaN where nothing was known yet.
    """

    time: np.ndarray | float
    north: np.ndarray
    east: np.ndarray
    speed: np.ndarray
    course: np.ndarray
    course_rate: np.ndarray
    along: np.ndarray
    cross: np.ndarray
    leg: np.ndarray
    done: np.ndarray
    desired: np.ndarray
    reference: np.ndarray
    reference_rate: np.ndarray
    order: np.ndarray


class PathHelm:
    """A helm (guidance.helms) that steers ships along their paths. `make(ships)` builds the parts, anew at the first call of each run.

    Navigation -> path error -> law -> reference filter -> autopilot -> rudder. Until navigation is ready the rudder is amidships; the
    reference begins at the ship's own course, so that nothing jumps. What it thought in the last run is its `record`, of each call, or of
    one call in `every`.
    """

    def __init__(self, make: Callable[[int], Loop], every: int = 1):
        self.make, self.every = make, every
        self._thoughts: list[Thought] = []
        self._loop: Loop | None = None

    def __call__(self, time: float, state: np.ndarray) -> np.ndarray:
        ships = len(state)
        if time <= 1e-9 or self._loop is None:
            self._loop, self._thoughts, self._calls = self.make(ships), [], 0
            self._before, self._begun = time, np.zeros(ships, bool)
        loop, dt, self._before = self._loop, time - self._before, time
        now = loop.navigation(time, state)
        seen = loop.follower.update(now.north, now.east)
        error = seen._replace(along=_told(seen.along), cross=_told(seen.cross), remaining=_told(seen.remaining))
        speed, course = _told(now.speed), _told(now.course)
        desired = np.broadcast_to(loop.law(error, speed, course, dt), ships)
        turning = np.zeros(ships) if loop.rate is None else loop.rate(error, speed, course)
        loop.reference.begin(now.course, now.ready & ~self._begun)
        self._begun = self._begun | now.ready
        reference, rate = loop.reference.step(dt, desired, np.where(now.ready, turning, 0.0))
        order = loop.autopilot.command(dt, now.course, now.course_rate, reference, rate)
        if self._calls % self.every == 0:
            self._thoughts.append(
                Thought(
                    *(time, now.north, now.east, now.speed, now.course, now.course_rate),
                    *(seen.along, seen.cross, seen.leg, seen.done, desired, reference, rate, order),
                )
            )
        self._calls, self._at = self._calls + 1, seen
        return order

    @property
    def loop(self) -> Loop:
        """The parts of the last run, as that has left them."""
        if self._loop is None:
            raise ValueError("the helm has not steered yet")
        return self._loop

    @property
    def record(self) -> Thought:
        """What it thought in the last run, over time (calls / every, ships)."""
        return Thought(*(np.array(values) for values in zip(*self._thoughts, strict=True)))

    def notes(self, patience: float) -> list[str]:
        """What to say of each ship's last run, "" where all went well: a route not finished, and a reference that she could not follow.

        The latter is when the command was beyond the limit of the rudder for more than `patience` [s] without a break.
        """
        pilot, last = self.loop.autopilot, self._at
        texts = []
        for leg, done, longest, whole in zip(last.leg, last.done, pilot.longest, pilot.saturated, strict=True):
            parts = [] if done else [f"route not finished, on leg {leg + 1} at the end"]
            if longest > patience:
                parts.append(
                    f"rudder at its limit of {math.degrees(pilot.limit):.3g} degrees for {longest:.0f} s without a break ({whole:.0f} s"
                    f" in all): the vessel cannot follow the reference"
                )
            texts.append("; ".join(parts))
        return texts


def _told(values: np.ndarray) -> np.ndarray:
    """Zero for what is not known yet, so that a law with a memory does not remember NaN."""
    return np.where(np.isnan(values), 0.0, values)
