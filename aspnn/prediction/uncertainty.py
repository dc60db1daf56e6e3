"""How sure a prediction is: the filter's covariance carried through the network, a learnt model error, measured quantiles.

Depends on motion, orders and records. The covariance of a path at a time after the start is

    S W (F + J diag(s) R diag(s) J') W S

with W what the recent past widens it by (one where the model fits; see `monitor`), F what the filter's errors become (finite
differences through the network), s the standard deviations of the model's own error along, across and in heading (they grow
with turn, order and loss of speed), R their correlations, J the turn from course to grid axes, and S the scale that made the
regions hold their share on voyages that taught the network nothing (split conformal; Vovk, Gammerman and Shafer 2005, recalled).
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from aspnn.frames import to_body
from aspnn.motion import Path, Spread
from aspnn.motion.spread import disc, strip
from aspnn.orders import Plan
from aspnn.prediction.monitor import MARKS, overall, widening
from aspnn.records import States
from aspnn.schema import InputError

POPULATIONS = ("new_order", "orders_within_horizon", "steady")
STEERED = "steered"  # one more, of calibrations that had voyages in a closed loop
LEVELS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99)
FULL = LEVELS.index(0.95)  # the level that the covariance is scaled for
MOVING = 3.0  # s between changes of the rudder order, at most, where a loop is closed round the ship
ORDER_SIZE = math.radians(5)  # a smaller change of the rudder order does not part the populations
WIDER = 2.0  # outside the domain the half axes are doubled (assumed: nothing was measured there)
MARGIN = 0.05  # of the largest magnitude in training: so far beyond the extremes an input is not yet outside
MEASURED = ("surge_m_s", "sway_m_s", "yaw_rate_rad_s", "shaft_speed_rps", "wind_speed_true_m_s")


@dataclass(frozen=True)
class Calibration:
    """What calibration found. Arrays over `time` (knots,) [s] from the start.

    `variance` (knots, 3, 4): of the model's error along, outward of the turn [m2] and in heading [rad2], per one and per
    square of turn [rad], order [rad] and loss of speed [m/s]; `correlation` (knots, 3, 3) of these errors. `position` and
    `heading` map a population to factors (knots, levels) on the standard deviations; NaN for levels that take more
    windows. `domain` maps columns of the states to lowest and highest at the starts; `settled` [s] after an order a ship
    counts as steady. `drift` [m] is the deviation of a place after a third of the horizon, which seeking a current goes by.
    `usual` (MARKS, 2) and `limit` are the misfits that one start in five and one in a hundred had (see `monitor`).
    `facts` say what it was made of.
    """

    time: np.ndarray
    variance: np.ndarray
    correlation: np.ndarray
    levels: np.ndarray
    position: dict[str, np.ndarray]
    heading: dict[str, np.ndarray]
    domain: dict[str, tuple[float, float]]
    settled: float
    drift: float
    usual: np.ndarray
    limit: float
    facts: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for config.json, numbers to four figures, None for NaN."""
        return _plain(asdict(self))

    @staticmethod
    def from_dict(data: dict[str, Any], name: str) -> "Calibration":
        """The calibration of checkpoint `name` from the plain data of its config. Raises InputError if it is incomplete."""
        try:
            values = {field.name: data[field.name] for field in fields(Calibration)}
            for key in ("time", "variance", "correlation", "levels", "usual"):
                values[key] = np.array(data[key], float)
            values["limit"] = float(np.array(data["limit"], float))  # None is NaN
            for key in ("position", "heading"):
                values[key] = {k: np.array(v, float) for k, v in data[key].items()}
            values["domain"] = {k: (float(low), float(high)) for k, (low, high) in data["domain"].items()}
            found = Calibration(**values)
            if not found.drift > 0:
                raise ValueError("drift must be positive")
            knots, levels = len(found.time), len(found.levels)
            shapes = [found.variance.shape == (knots, 3, 4), found.correlation.shape == (knots, 3, 3)]
            shapes += [found.usual.shape == (len(MARKS), 2)]
            shapes += [v.shape == (knots, levels) for v in (*found.position.values(), *found.heading.values())]
            if not all(shapes):
                raise ValueError("arrays of different lengths")
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"checkpoint {name}: config.json: calibration is damaged ({error}); run `aspnn calibrate` again"
            ) from None
        return found


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if math.isfinite(value) else None
    return value


def perturbed(states: States, rows: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The filter's errors, one standard deviation each: pose (n, 3) and body velocity (n, 3) to be added at each of `rows`.

    Of heading, surge, sway and yaw rate. An error e of the heading leaves the velocity over ground as it is, so surge and
    sway err by v e and -u e with it (erratum E18); their own parts are what remains of their standard deviations. Other
    correlations are not in the states and are taken as none.
    """
    u, v = states["surge_m_s"][rows], states["sway_m_s"][rows]
    heading, surge, sway, yaw = (
        states[f"{name}_sd"][rows] for name in ("heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    )
    zero = np.zeros(len(rows))
    own = [np.sqrt(np.maximum(sd**2 - (w * heading) ** 2, 0.0)) for sd, w in ((surge, v), (sway, u))]
    still = np.stack([zero, zero, zero], axis=-1)
    return [
        (np.stack([zero, zero, heading], axis=-1), np.stack([v * heading, -u * heading, zero], axis=-1)),
        (still, np.stack([own[0], zero, zero], axis=-1)),
        (still, np.stack([zero, own[1], zero], axis=-1)),
        (still, np.stack([zero, zero, yaw], axis=-1)),
    ]


def shifts(names: Sequence[str], states: States, rows: np.ndarray, pose: np.ndarray, body: np.ndarray) -> np.ndarray:
    """What errors of pose and body velocity (n, 3) do to the features `names` at `rows`: (n, features), to first order.

    Accelerations, orders and weather have errors of their own and are left as they are.
    """
    u, v = states["surge_m_s"][rows], states["sway_m_s"][rows]
    speed = np.hypot(u, v)
    share = np.divide(
        1.0, speed, out=np.zeros_like(speed), where=speed > 0
    )  # at rest speed and drift have no derivative
    du, dv, dr = body.T
    bow, stern = states.vessel.sway_stations
    known = {
        "surge": du,
        "sway_bow": dv + bow * dr,
        "sway_stern": dv + stern * dr,
        "yaw_rate": dr,
        "heading": pose[:, 2],
        "speed": (u * du + v * dv) * share,
        "drift": (v * du - u * dv) * share**2,
    }
    return np.array([known.get(name, np.zeros(len(rows))) for name in names]).T


def carried(path: Path, moved: Path, states: States, rows: np.ndarray) -> np.ndarray:
    """Covariance (n, steps, 3, 3) of paths by the filter's errors, from the paths (errors n, steps) that one standard
    deviation of each error moves."""

    names, shape = ("north", "east", "heading"), (-1, *path.north.shape)
    steps = [getattr(moved, name).reshape(shape) - getattr(path, name) for name in names]
    covariance = np.empty((*path.north.shape, 3, 3))
    for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        covariance[..., a, b] = covariance[..., b, a] = (steps[a] * steps[b]).sum(axis=0)
    for k, name in enumerate(("north_m_sd", "east_m_sd")):
        covariance[..., k, k] += states[name][rows, None] ** 2
    return covariance


def drivers(path: Path, plans: Sequence[Plan], angle: np.ndarray) -> np.ndarray:
    """What the model's error grows with (n, steps, 4): 1, and squares of turn, order and loss of speed so far.

    `angle` (n,) [rad] is the rudder's at the start; the order is the furthest from it until then.
    """
    turn = path.heading - path.heading[:, :1]
    ordered = np.reshape([plan.rudder.at(path.time) for plan in plans], turn.shape)
    order = np.maximum.accumulate(np.abs(ordered - angle[:, None]), axis=1)
    found = np.ones((*turn.shape, 4))
    found[..., 1], found[..., 2], found[..., 3] = turn**2, order**2, (path.surge - path.surge[:, :1]) ** 2
    return found


def axes(path: Path) -> np.ndarray:
    """Turn J (n, steps, 3, 3) to north, east, heading from errors along the course, outward of the turn and of too much turn.

    Outward is to port of the predicted course in a turn to starboard; a turn and its mirror image are one in these axes.
    """
    course = path.heading + np.arctan2(path.sway, path.surge)
    side = np.where(path.heading < path.heading[..., :1], -1.0, 1.0)
    c, s, found = np.cos(course), np.sin(course), np.zeros((*course.shape, 3, 3))
    found[..., 0, 0], found[..., 0, 1] = c, s * side
    found[..., 1, 0], found[..., 1, 1] = s, -c * side
    found[..., 2, 2] = side
    return found


def population(
    states: States, row: int, plan: Plan, horizon: float, settled: float, known: Collection[str] = ()
) -> str:
    """The population of a prediction, from what is known at its start: orders of the last `settled` [s], and the plan.

    Where `steered` is among the populations `known`: a plan that moves the rudder every MOVING seconds or more often on average, as an
    autopilot does. With an order (of at least 5 deg) inside the horizon, else with one now or in the last `settled` seconds, else steady.
    """
    if STEERED in known and 0 < horizon <= MOVING * (len(plan.rudder.between(0.0, horizon).times) - 1):
        return STEERED
    order = float(plan.rudder.at(0.0))
    time, past = states["time_s"], states["rudder_order_rad"]
    first = time.searchsorted(time[row] - settled - 1e-6)
    recent = bool((np.abs(past[first : row + 1] - order) >= ORDER_SIZE - 1e-9).any())
    if not plan.rudder.held_within(0.0, horizon, ORDER_SIZE):
        # Starts in a steady stretch with an order to come behave as those at an order do.
        return "orders_within_horizon"
    return "new_order" if recent else "steady"


def beyond(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Whether any of `values` (n, ...) lies beyond [low, high] by more than 5 % of the larger magnitude, for each of n."""
    slack = MARGIN * max(abs(low), abs(high))
    wrong = (values < low - slack) | (values > high + slack)
    return np.asarray(wrong.reshape(len(values), -1).any(axis=1))


def spread_of(
    calibration: Calibration,
    path: Path,
    covariance: np.ndarray,
    states: States,
    rows: np.ndarray,
    plans: Sequence[Plan],
    outside: np.ndarray,
    current: np.ndarray | None = None,
    square: np.ndarray | None = None,
) -> Spread:
    """The spread of paths (n, steps) with the covariances (n, steps, 3, 3) that `shape` gives.

    `outside` (n,) tells whether an input was beyond the network's training; states and shaft orders beyond those of
    calibration count too. There the half axes are doubled. `square` (n, MARKS, 2) are the misfits of `monitor`, if they are known.
    """
    c, time, flow = calibration, path.time, {}
    if current is not None:  # velocities through the water are what the domain is about
        flow = dict(
            zip(
                ("surge_m_s", "sway_m_s"),
                to_body(current[:, 0], current[:, 1], states["heading_rad"][rows]),
                strict=True,
            )
        )
    for name, (low, high) in c.domain.items():
        outside = outside | beyond(states[name][rows] - flow.get(name, 0.0), low, high)
        if name == "wind_speed_true_m_s":  # calibrated in measured wind: unknown wind is taken as none, which it is not
            outside = outside | ~np.isfinite(states[name][rows])
        if name == "shaft_speed_rps":
            ordered = [np.array([]) if plan.shaft is None else plan.shaft.values for plan in plans]
            outside = outside | np.array([bool(beyond(v[None], low, high)[0]) for v in ordered], bool)
    square = np.full((len(rows), len(MARKS), 2), np.nan) if square is None else square
    wider = widening(square, c.usual, time)
    found = [
        population(states, int(row), plan, float(time[-1]), c.settled, c.position)
        for row, plan in zip(rows, plans, strict=True)
    ]
    unknown = np.full((len(c.time), len(c.levels)), np.nan)
    names = sorted(set(found))  # the plans of a fan are mostly of one population
    position, heading = (
        np.array([at_times(table.get(name, unknown), c.time, time) for name in names])[list(map(names.index, found))]
        for table in (c.position, c.heading)
    )
    full = float(c.levels[FULL])
    a, b = position[..., FULL] / disc(full), heading[..., FULL] / strip(full)
    wider = wider * np.array([a, a, b]).transpose(1, 2, 0) * np.where(outside, WIDER, 1.0)[:, None, None]
    return Spread(
        covariance=covariance * wider[..., :, None] * wider[..., None, :],
        outside=outside,
        levels=c.levels,
        position=position / a[..., None],
        heading=heading / b[..., None],
        misfit=overall(square),
        limit=c.limit,
    )


def shape(c: Calibration, path: Path, carried: np.ndarray, plans: Sequence[Plan], angle: np.ndarray) -> np.ndarray:
    """Covariance (n, steps, 3, 3) before it is scaled: the filter's errors carried on, and the model's own."""
    variance, correlation = (at_times(values, c.time, path.time) for values in (c.variance, c.correlation))
    sd = np.sqrt(np.einsum("tak,ntk->nta", variance, drivers(path, plans, angle)))
    turned = axes(path) * sd[..., None, :]
    return carried + turned @ correlation @ np.swapaxes(turned, -1, -2)


def at_times(values: np.ndarray, knots: np.ndarray, time: np.ndarray) -> np.ndarray:
    """`values` (knots, ...) at `time` (steps,), linear between knots."""
    lower = np.minimum(np.maximum(knots.searchsorted(time) - 1, 0), len(knots) - 2)
    part = (time - knots[lower]) / (knots[lower + 1] - knots[lower])
    part = np.minimum(np.maximum(part, 0.0), 1.0).reshape(-1, *[1] * (values.ndim - 1))
    return values[lower] * (1 - part) + values[lower + 1] * part
