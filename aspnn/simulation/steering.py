"""How a simulated ship is steered in a closed loop: Nomoto's constants of her zigzag, the section [manoeuvre.steering] tuned to them.

Depends on plan, ship, voyage, the errors of sensors, estimation and guidance.
"""

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, Field

from aspnn.estimation.course import CourseModel, CourseTracker
from aspnn.estimation.sideslip import SideslipModel
from aspnn.guidance.autopilot import Gains, pole_placement
from aspnn.guidance.compensation import AdaptiveLos, IntegralLos, KalmanLos
from aspnn.guidance.helms import zigzag
from aspnn.guidance.los import LineOfSight
from aspnn.guidance.pilot import Navigation, TrackedNavigation, TrueNavigation
from aspnn.guidance.steered import Compass, Fixes
from aspnn.schema import InputError
from aspnn.simulation.nomoto import Nomoto
from aspnn.simulation.plan import STRICT, Departure
from aspnn.simulation.sensing.errors import gauss_markov
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import simulate

WAY = 60  # ship lengths of way that the zigzag lasts: six to ten reversals
ANGLE = math.radians(10)  # of the rudder and of the heading at which it is reversed
# What a section [manoeuvre.steering] does not say, in ship lengths L and in L / U, the time that she takes for one at her speed U:
LOOKAHEAD, SWITCH = 4.0, 2.0  # L
BANDWIDTH, LOW_PASS = 0.5, 1.0  # U / L and L / U: twice that bandwidth swings between the stops with a metre of noise
PATIENCE = (
    3.0  # L / U at the limit of the rudder without a break, from where on the reference counts as one she cannot follow
)


def answer(ship: Ship, speed: float) -> Nomoto:
    """Nomoto's constants of a ship at `speed` [m/s] by least squares on the yaw rate of her 10/10 zigzag in still deep water.

    Those of a manoeuvre of this size, with the speed it costs. `nomoto` has those of the smallest: of a ship that is hardly stable on her
    course K and T grow without bound, and a feed-forward by 1 / K counts on turns that never get so fast.
    """
    dt = min(ship.largest_step(speed), ship.vessel.length / speed / 30)
    way = WAY * ship.vessel.length / speed
    run = simulate(ship, zigzag(ANGLE, ANGLE), ship.start(0.0, 0.0, 0.0, speed), way, dt=dt)[0]
    terms = np.stack([run.yaw_rate, run.rudder, np.ones(len(run.time))], axis=-1)  # one: the neutral rudder
    a, b, _ = np.linalg.lstsq(terms, run.yaw_acceleration, rcond=None)[0]
    return Nomoto(float(-b / a), float(-1 / a))


class Gnss(BaseModel):
    """What the helm's own positions are like: white noise and a wander (Gauss-Markov; paper 000: 4.7 m, 1100 s) on each axis."""

    model_config = STRICT
    white_m: Annotated[float, Field(ge=0)] = 1.0
    wander_m: Annotated[float, Field(ge=0)] = 0.0
    wander_time_s: Annotated[float, Field(gt=0)] = 1100.0
    period_s: Annotated[float, Field(gt=0)] = 1.0

    @property
    def expected(self) -> float:
        """Standard deviation [m] that the course filter counts with: the white noise and what the wander changes from fix to fix."""
        wander = self.wander_m * math.sqrt(-2 * math.expm1(-self.period_s / self.wander_time_s))
        return max(math.hypot(self.white_m, wander), 0.01)

    def errors(self, rngs: Sequence[np.random.Generator], duration: float) -> np.ndarray:
        """(voyages, 2, fixes) [m], each voyage from a stream of its own."""
        count = int(duration / self.period_s + 1e-6) + 2
        return np.stack([self._drawn(rng.spawn(1)[0], count) for rng in rngs])

    def _drawn(self, rng: np.random.Generator, count: int) -> np.ndarray:
        wander = gauss_markov(rng, (2, count), self.period_s, self.wander_m, self.wander_time_s)
        return wander + self.white_m * rng.standard_normal((2, count))


class Steering(BaseModel):
    """How a route or a course is steered, the section [manoeuvre.steering]. What is left out follows from the ship.

    `law` los steers the course, the others (integral, adaptive, sideslip-filter line of sight) the true heading. Without the section
    `gnss` the helm knows true positions; with it the course filter makes speed, course and course rate of fixes.
    """

    model_config = STRICT
    law: Literal["los", "ilos", "alos", "kf-los"] = "los"
    lookahead_m: Annotated[float | None, Field(gt=0)] = None
    switch_m: Annotated[float | None, Field(gt=0)] = None
    omega_n_rad_s: Annotated[float | None, Field(gt=0)] = None
    damping: Annotated[float, Field(gt=0)] = 1.0
    low_pass_s: Annotated[float | None, Field(ge=0)] = None
    every_s: Annotated[float | None, Field(gt=0)] = None  # between orders; without it at every step
    rudder_deg: Annotated[float, Field(gt=0)] = 20.0
    nomoto_gain_1_s: float | None = None
    nomoto_time_s: float | None = None
    gnss: Gnss | None = None


class Tuned(NamedTuple):
    """The numbers of a steering for one ship at one speed, SI and radians."""

    K: float
    T: float
    gains: Gains
    omega_n: float
    limit: float
    lookahead: float
    switch: float
    low_pass: float
    every: float
    patience: (
        float  # s at the limit of the rudder without a break after which the reference counts as one she cannot follow
    )

    @staticmethod
    def of(steering: Steering, leaving: Departure) -> "Tuned":
        """Raises InputError for constants of no ship, an autopilot slower than she is, and fixes more often than orders."""
        length, speed = leaving.ship.vessel.length, leaving.speed
        K, T = steering.nomoto_gain_1_s, steering.nomoto_time_s
        if (K is None) != (T is None):
            raise InputError("manoeuvre.steering: give both nomoto_gain_1_s and nomoto_time_s, or neither")
        if K is None or T is None:
            K, T = answer(leaving.ship, speed)
        every = max(steering.every_s or leaving.step, leaving.step)
        if steering.gnss is not None and steering.gnss.period_s < every - 1e-9:
            raise InputError(
                f"manoeuvre.steering: fixes every {steering.gnss.period_s:g} s, orders every {every:g} s; the helm would pass fixes over"
            )

        def told(value: float | None, own: float) -> float:
            return own if value is None else value

        # A craft that is damped more than that by herself is steered a little faster.
        own = max(BANDWIDTH * speed / length, 0.6 / (steering.damping * T))
        omega = told(steering.omega_n_rad_s, own)
        return Tuned(
            K=K,
            T=T,
            gains=pole_placement(K, T, omega, steering.damping),
            omega_n=omega,
            limit=math.radians(steering.rudder_deg),
            lookahead=told(steering.lookahead_m, LOOKAHEAD * length),
            switch=told(steering.switch_m, SWITCH * length),
            low_pass=told(steering.low_pass_s, LOW_PASS * length / speed),
            every=every,
            patience=PATIENCE * length / speed,
        )


def navigation_of(
    steering: Steering, leaving: Departure, rngs: Sequence[np.random.Generator]
) -> Callable[[int], Navigation]:
    """Makes the navigation of a batch, always with the same errors."""
    gnss = steering.gnss
    if gnss is None:
        ground: Callable[[int], Navigation] = lambda ships: TrueNavigation()  # noqa: E731
    else:
        errors, model = gnss.errors(rngs, leaving.duration), CourseModel.of(leaving.ship.vessel)

        def ground(ships: int) -> Navigation:
            return TrackedNavigation(CourseTracker(model, gnss.expected, ships), Fixes(errors, gnss.period_s))

    return ground if steering.law == "los" else lambda ships: Compass(ground(ships))


def law_of(steering: Steering, tuned: Tuned, speed: float, ships: int):
    """The guidance law of a batch and how fast what it asks for turns."""
    ahead = tuned.lookahead
    if steering.law == "los":
        law = LineOfSight(ahead)
        return law, law.rate
    heading: IntegralLos | AdaptiveLos | KalmanLos
    if steering.law == "ilos":
        heading = IntegralLos.damped(ahead, speed, ships=ships)
    elif steering.law == "alos":
        heading = AdaptiveLos.damped(ahead, speed, ships=ships)
    else:
        sd = 0.1 if steering.gnss is None else max(steering.gnss.expected, 0.1)
        heading = KalmanLos(ahead, SideslipModel.tuned(speed / ahead, sd, tuned.every, speed), ships)
    # Navigation tells the heading here; over ground the ship goes as far beside it as the law makes up for.
    return heading, lambda error, over_ground, angle: heading.rate(error, over_ground, angle + heading.sideslip)
