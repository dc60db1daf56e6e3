"""The case of paper 000: a Mariner along six waypoints, what is varied in it, and what is measured of a voyage."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from paper_000_filter import PaperFilter

from aspnn.angles import difference
from aspnn.estimation.course import CourseModel, CourseTracker
from aspnn.guidance.autopilot import CourseAutopilot, ReferenceFilter, pole_placement
from aspnn.guidance.helms import EAST, NORTH
from aspnn.guidance.los import LineOfSight
from aspnn.guidance.pilot import Loop, PathHelm, Thought, TrackedNavigation, TrueNavigation
from aspnn.guidance.route import Follower, Route
from aspnn.guidance.steered import Compass
from aspnn.simulation.sea import Sea
from aspnn.simulation.sensing.errors import gauss_markov
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import Voyage, simulate
from aspnn.vessel import load_vessel

ROUTE = Route(np.array([(0, 0), (2000, 0), (5000, 5000), (3000, 8000), (6000, 12000), (10000, 12000)], float))
K, T = 0.185, 107.3  # 1/s and s
OMEGA, ZETA = 0.05, 1.0
LOOKAHEAD, CIRCLE, LOW_PASS = (
    800.0,
    50.0,
    40.0,
)  # m, m and s; the last is ours, between what is claimed and what follows (E63)
DURATION = 4200.0  # s: the last leg's line goes on, so that what is left of the turns dies out
STEADY = 1100.0  # s after the last turn begins, from where on a voyage counts as steady
CONVERGED = 100.0  # s, from where on the filters count as converged
SD, TIME, DRIVE = (
    4.7,
    1100.0,
    0.21,
)  # m, s and m: Gauss-Markov errors of the positions as stated, and the driving noise as printed
SEED = 7
# Ours: the least rudder on the first legs of six voyages of another seed among nine, with a course error that was no larger. The decay of
# the course rate is the paper's; of the speed the paper allows so little that a gate takes the first turn for an outlier.
OURS, OUR_SD = CourseModel(1e-4, 4e-6, 1e-5, 0.2), 1.0  # densities m2/s3 and rad2/s3, 1/s; m
OUR_CIRCLE, OUR_LOW_PASS = (
    400.0,
    20.0,
)  # m: what the sharpest turn takes on a turning circle of 577 m radius (Route.sharp); s


@dataclass(frozen=True)
class Batch:
    """Voyages that are simulated at once, and what is varied in them; where a value stands for all ships, or each has one (ships,).

    `names` (ships,) tell what each is a voyage of. `errors` of the fixes (ships, 2, steps) [m]; None: true positions without a filter.
    """

    names: Sequence[str]
    errors: np.ndarray | None = None
    tracker: Callable[[int], CourseTracker | PaperFilter] | None = None
    low_pass: float | Sequence[float] = LOW_PASS
    circle: float = CIRCLE
    fed: float | Sequence[float] = 1.0  # share of the reference's rate that is fed forward
    current: Sequence[float] | Sequence[Sequence[float]] = (0.0, 0.0)  # m/s towards north and east
    compass: bool = False  # the heading is steered, not the course


class Sailed(NamedTuple):
    """A voyage of a case, with what its helm thought (calls,) and the errors of its fixes (2, calls)."""

    voyage: Voyage
    thought: Thought
    errors: np.ndarray
    saturated: float  # s in which the command was cut


def stated(seeds: int, steps: int, dt: float) -> np.ndarray:
    """Errors (seeds, 2, steps) of 4.7 m, whatever the step (E60)."""
    return np.stack([gauss_markov(rng, (2, steps), dt, SD, TIME) for rng in np.random.default_rng(SEED).spawn(seeds)])


def printed(seeds: int, steps: int, dt: float) -> np.ndarray:
    """Errors (seeds, 2, steps) by (42)-(43) with the printed driving noise, from none at the start: 15.6 m in the end at 0.1 s (E60)."""
    drive = DRIVE * np.random.default_rng(SEED).standard_normal((seeds, 2, steps))
    drive[..., 0] = 0.0
    decay = math.exp(-dt / TIME)
    errors = np.zeros_like(drive)
    for k in range(1, steps):
        errors[..., k] = decay * errors[..., k - 1] + drive[..., k]
    return errors


def paper_filter(dt: float) -> Callable[[int], PaperFilter]:
    """The filter as the paper tunes it."""
    return lambda ships: PaperFilter(dt, load_vessel("mariner").service_speed, 0.0, ships)


def our_filter(dt: float) -> Callable[[int], CourseTracker]:
    """The product's filter, which has a gate, tuned for this loop."""
    return lambda ships: CourseTracker(OURS, OUR_SD, ships, dt)


def sail(batch: Batch, dt: float) -> list[Sailed]:
    """The voyages of a batch, in steps of `dt` [s], which is also the time between fixes."""
    ship, law, count = Ship.of(load_vessel("mariner")), LineOfSight(LOOKAHEAD), len(batch.names)
    fed = np.broadcast_to(batch.fed, count)

    def fixes(time: float, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert batch.errors is not None
        error = batch.errors[..., round(time / dt)]
        return state[:, NORTH] + error[:, 0], state[:, EAST] + error[:, 1]

    def make(ships: int) -> Loop:
        navigation = TrueNavigation() if batch.tracker is None else TrackedNavigation(batch.tracker(ships), fixes)
        return Loop(
            Compass(navigation) if batch.compass else navigation,
            Follower(ROUTE, batch.circle, ships),
            law,
            lambda *seen: fed * law.rate(*seen),
            ReferenceFilter(np.broadcast_to(batch.low_pass, ships), ships),
            CourseAutopilot(pole_placement(K, T, OMEGA, ZETA), K, T, ship.rudder.most, ships),
        )

    helm = PathHelm(make)
    starts = ship.start(0.0, 0.0, np.zeros(count), ship.service_speed)
    runs = simulate(ship, helm, starts, DURATION, sea=Sea(current=np.array(batch.current)), dt=dt)
    record, cut = helm.record, helm.loop.autopilot.saturated
    none = np.zeros((2, len(record.time)))
    return [
        Sailed(
            run,
            Thought(record.time, *(values[:, b] for values in record[1:])),
            none if batch.errors is None else batch.errors[b],
            float(cut[b]),
        )
        for b, run in enumerate(runs)
    ]


def true_course(voyage: Voyage) -> np.ndarray:
    """Course over ground [rad], continuous; the velocities of a voyage are over ground."""
    return voyage.heading + np.arctan2(voyage.sway, voyage.surge)


def across(north: np.ndarray, east: np.ndarray, leg: np.ndarray) -> np.ndarray:
    """Distance to starboard of the legs' lines [m]."""
    angle, start = ROUTE.angles[leg], ROUTE.points[leg]
    return (east - start[:, 1]) * np.cos(angle) - (north - start[:, 0]) * np.sin(angle)


def measures(sailed: Sailed) -> dict[str, float]:
    """What is measured of a voyage, NaN for what it has not come to. Distances in m, angles in degrees, shares in percent.

    From the start to the end of the route: `finished` [s], the largest of the distances passed from the waypoints, cross-track error (true
    position, leg as the helm had it), the filter's errors and how much of the course rate it tells, rudder and its rate, shares of the
    time at their limits, and of it the time before the first turn. `steady`: mean and largest cross-track error long after the last turn,
    with the error of the fixes.
    """
    v, thought = sailed.voyage, sailed.thought
    ship, dt = load_vessel("mariner"), float(v.time[1] - v.time[0])
    leg = thought.leg.astype(int)
    cross = across(v.north, v.east, leg)
    noise = sailed.errors[1] * np.cos(ROUTE.angles[leg]) - sailed.errors[0] * np.sin(ROUTE.angles[leg])
    done = bool(thought.done[-1])
    end = int(np.argmax(thought.done)) if done else len(v.time) - 1
    last = int(np.argmax(leg == len(ROUTE.lengths) - 1)) if leg[-1] == len(ROUTE.lengths) - 1 else len(v.time)
    steady, way = v.time >= v.time[min(last, len(v.time) - 1)] + STEADY, slice(0, end)
    off = np.abs(cross[last:]) > 1.0
    course = np.degrees(difference(thought.course, true_course(v)))
    speed = thought.speed - np.hypot(v.surge, v.sway)
    turning = np.gradient(true_course(v), dt)
    use = slice(round(CONVERGED / dt), end)
    rate = np.abs(np.diff(v.rudder)) / dt
    fast, hard = rate >= ship.rudder_rate * (1 - 1e-9), np.abs(v.rudder) >= ship.rudder_max * (1 - 1e-9)
    first = slice(0, int(np.argmax(leg > 0)) if leg.any() else end)

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    def mean(values: np.ndarray) -> float:
        return float(np.mean(values[steady])) if steady.any() else math.nan

    return {
        "finished_s": float(v.time[end]) if done else math.nan,
        "waypoints_reached": float(leg[-1] + done),
        "passed_m": max(float(np.hypot(v.north - north, v.east - east).min()) for north, east in ROUTE.points),
        "cross_rms_m": rms(cross[way]),
        "cross_largest_m": float(np.abs(cross[way]).max()),
        "within_1_m_after_s": float(dt * (np.flatnonzero(off)[-1] + 1)) if off.any() and not off[-1] else math.nan,
        "steady_mean_m": mean(np.abs(cross)),
        "last_m": float(cross[-1]),
        "steady_largest_m": float(np.abs(cross[steady]).max()) if steady.any() else math.nan,
        "noise_mean_m": mean(np.abs(noise)),
        "course_rms_deg": rms(course[use]),
        "course_largest_deg": float(np.abs(course[use]).max()),
        "speed_rms_m_s": rms(speed[use]),
        "rate_told_percent": 100 * float(np.sum((thought.course_rate * turning)[use]) / np.sum(turning[use] ** 2)),
        "slowest_m_s": float(np.hypot(v.surge, v.sway)[way].min()),
        "rudder_largest_deg": float(np.degrees(np.abs(v.rudder[way]).max())),
        "rudder_rms_first_leg_deg": float(np.degrees(rms(v.rudder[first]))),
        "rudder_rms_deg": float(np.degrees(rms(v.rudder[way]))),
        "rate_largest_deg_s": float(np.degrees(rate[way].max())),
        "at_limit_percent": 100 * float(np.mean(hard[way])),
        "at_rate_percent": 100 * float(np.mean(fast[way])),
        "rate_first_leg_percent": 100 * float(np.mean(fast[first])),
        "cut_s": sailed.saturated,
    }
