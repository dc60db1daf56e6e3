"""Features: what a network may see of the states, by name, in SI and radians. None holds an absolute position.

The rudder angle among the forcings is the plan sent through the ship's rudder servo from the angle at the start, in
training as in use, so a network never sees a future measurement. Likewise the shaft speed, where its servo is known.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from aspnn.angles import compass
from aspnn.frames import to_body
from aspnn.learning.servo import Servos
from aspnn.orders import Orders, Plan
from aspnn.records import States
from aspnn.schema import InputError


def _tangential(s: States) -> np.ndarray:
    """Tangential acceleration of midship: (u u' + v v') / V, zero at rest (the centripetal terms cancel)."""
    u, v = s["surge_m_s"], s["sway_m_s"]
    speed = np.hypot(u, v)
    moving = speed > 0
    return np.where(
        moving, (u * s["surge_acceleration_m_s2"] + v * s["sway_acceleration_m_s2"]) / np.where(moving, speed, 1), 0
    )


def _normal(s: States) -> np.ndarray:
    """Normal acceleration of midship, to starboard: r V + (u v' - v u') / V; r V alone at rest."""
    u, v = s["surge_m_s"], s["sway_m_s"]
    speed = np.hypot(u, v)
    moving = speed > 0
    turning = (u * s["sway_acceleration_m_s2"] - v * s["surge_acceleration_m_s2"]) / np.where(moving, speed, 1)
    return s["yaw_rate_rad_s"] * speed + np.where(moving, turning, 0)


def _station_acceleration(s: States, station: int) -> np.ndarray:
    return s["sway_acceleration_m_s2"] + s.vessel.sway_stations[station] * s["yaw_acceleration_rad_s2"]


FEATURES: dict[str, Callable[[States], np.ndarray]] = {
    "surge": lambda s: s["surge_m_s"],
    "sway_bow": lambda s: s["sway_bow_m_s"],
    "sway_stern": lambda s: s["sway_stern_m_s"],
    "yaw_rate": lambda s: s["yaw_rate_rad_s"],
    "heading": lambda s: compass(s["heading_rad"]),  # absolute: in the thesis's network only
    "drift": lambda s: s["drift_rad"],
    "speed": lambda s: np.hypot(s["surge_m_s"], s["sway_m_s"]),
    "tangential_acceleration": _tangential,
    "normal_acceleration": _normal,
    "surge_acceleration": lambda s: s["surge_acceleration_m_s2"],
    "sway_bow_acceleration": lambda s: _station_acceleration(s, 0),
    "sway_stern_acceleration": lambda s: _station_acceleration(s, 1),
    "rudder_order": lambda s: s["rudder_order_rad"],
    "rudder_angle": lambda s: s["rudder_angle_rad"],
    "shaft_speed": lambda s: s["shaft_speed_rps"],
    "wind_forward": lambda s: _wind(s)[0],
    "wind_starboard": lambda s: _wind(s)[1],
}
TARGETS = ("surge", "sway_bow", "sway_stern")
WIND = "wind"  # in the domain of a network that feels it: the speed of the air [m/s]
FORCINGS = ("rudder_order", "rudder_angle", "shaft_speed")
STEPWISE = ("rudder_order",)  # held from order to order; every other feature is interpolated between epochs


def _wind(s: States) -> tuple[np.ndarray, np.ndarray]:
    """True wind as the velocity of the air, in body axes [m/s]."""
    speed, origin = s["wind_speed_true_m_s"], s["wind_from_grid_rad"]
    return to_body(-speed * np.cos(origin), -speed * np.sin(origin), s["heading_rad"])


def broken(states: States, names: Sequence[str], period: float) -> np.ndarray:
    """How many of the epochs before each are no base for a history of features `names`: (epochs + 1,), from 0 on.

    The filter coasts, a feature has no value, or the epoch before is more than three of the history's steps of `period` [s] ago.
    """
    bad = (states["coasting"] != 0) | (np.diff(states["time_s"], prepend=states["time_s"][:1]) > 3 * period)
    for name in names:
        bad = bad | ~np.isfinite(FEATURES[name](states))
    return np.append(0, np.cumsum(bad))


def history(states: States, rows: np.ndarray, names: Sequence[str], steps: int, period: float) -> np.ndarray:
    """Features at `steps` instants `period` [s] apart that end at each of `rows`: (n, steps, features), float64.

    Only rows up to each start are read: interpolation between epochs never reaches past the start, which is itself an
    epoch. Raises InputError when a start has less history, or a feature has no values there.
    """
    time = states["time_s"]
    starts = time[np.asarray(rows, int)]
    instants = starts[:, None] + period * np.arange(1 - steps, 1)
    if len(starts) and instants.min() < time[0] - 1e-6:
        have, need = starts.min() - time[0], period * (steps - 1)
        raise InputError(
            f"{states.path or 'states'}: {have:.1f} s of history at {starts.min():g} s, {need:.1f} s are needed"
        )
    columns = []
    for name in names:
        values = FEATURES[name](states)
        if name in STEPWISE:
            index = np.searchsorted(time, instants + 1e-6, side="right") - 1
            column = values[np.clip(index, 0, None)]
        else:
            column = np.interp(instants, time, np.unwrap(values) if name == "heading" else values)
            column = compass(column) if name == "heading" else column
        if not np.isfinite(column).all():
            raise InputError(f"{states.path or 'states'}: {name} has no values, and the network needs it")
        columns.append(column)
    return np.stack(columns, axis=-1)


class Begin(NamedTuple):
    """Rudder angle [rad] and shaft speed [rev/s] at a start, and the orders before it that their servos have not heard yet."""

    rudder_angle: float
    shaft_speed: float
    rudder: Orders | None = None
    shaft: Orders | None = None


def begins(servos: Servos, states: States, rows: np.ndarray) -> list[Begin]:
    """What the plans of predictions from each of `rows` begin with."""
    angle, shaft = states["rudder_angle_rad"][rows], states["shaft_speed_rps"][rows]
    orders = [_unheard(states, rows, "rudder_order_rad", servos.rudder.servo.delay)]
    orders.append(_unheard(states, rows, "engine_order_rps", servos.shaft.servo.delay if servos.shaft else 0.0))
    return [Begin(*each) for each in zip(angle, shaft, *orders, strict=True)]


def _unheard(states: States, rows: np.ndarray, name: str, delay: float) -> list[Orders | None]:
    """The orders of the last `delay` [s] before each of `rows`, their times counted from there."""
    if delay == 0:
        return [None] * len(rows)
    time, order = states["time_s"], states[name]
    first = np.clip(np.searchsorted(time, time[rows] - delay + 1e-9) - 1, 0, None)
    return [
        Orders.from_series(time[a:row] - time[row], order[a:row]) if a < row else None
        for a, row in zip(first, rows, strict=True)
    ]


def forcing(servos: Servos, begin: Begin, plan: Plan, names: Sequence[str], time) -> np.ndarray:
    """Forcings (steps, features) at `time` [s] from the start, of one plan, float64. Raises InputError when one is unknown."""
    columns = []
    for name in names:
        if name == "rudder_order":
            column = plan.rudder.at(time)
        elif name == "rudder_angle":
            column = servos.rudder.servo.follow(_after(plan.rudder, begin.rudder), time, begin.rudder_angle)
        elif plan.shaft is None:
            column = np.full(len(time), begin.shaft_speed)
        elif servos.shaft is None:
            column = plan.shaft.at(time)
        else:
            column = servos.shaft.servo.follow(_after(plan.shaft, begin.shaft), time, begin.shaft_speed)
        if not np.isfinite(column).all():
            raise InputError(f"forcing {name} is not known for the horizon; give it in the plan")
        columns.append(column)
    return np.array(columns).reshape(len(columns), len(time)).T  # (steps, 0) where nothing is known of the future


def _after(plan: Orders, unheard: Orders | None) -> Orders:
    return plan if unheard is None else plan.after(unheard)
