"""Features: what a network may see of the states, by name, in SI and radians. None holds an absolute position.

The rudder angle among the forcings is the plan sent through the vessel's rudder servo from the angle at the start, in
training as in use, so a network never sees a future measurement.
"""

from collections.abc import Callable, Sequence

import numpy as np

from aspnn.angles import compass
from aspnn.frames import to_body
from aspnn.orders import Plan
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel


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
FORCINGS = ("rudder_order", "rudder_angle", "shaft_speed")
STEPWISE = ("rudder_order",)  # held from order to order; every other feature is interpolated between epochs


def _wind(s: States) -> tuple[np.ndarray, np.ndarray]:
    """True wind as the velocity of the air, in body axes [m/s]."""
    speed, origin = s["wind_speed_true_m_s"], s["wind_from_grid_rad"]
    return to_body(-speed * np.cos(origin), -speed * np.sin(origin), s["heading_rad"])


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


def forcing(vessel: Vessel, rudder_angle: float, shaft_speed: float, plan: Plan, names: Sequence[str], time):
    """Forcings (steps, features) at `time` [s] from the start, of one plan, float64.

    `rudder_angle` [rad] and `shaft_speed` [rev/s] are those at the start. Raises InputError when a forcing is unknown.
    """
    columns = []
    for name in names:
        if name == "rudder_order":
            column = plan.rudder.at(time)
        elif name == "rudder_angle":
            column = plan.rudder.servo(time, rudder_angle, vessel.rudder_rate)
        else:
            column = np.full(len(time), shaft_speed) if plan.shaft is None else plan.shaft.at(time)
        if not np.isfinite(column).all():
            raise InputError(f"forcing {name} is not known for the horizon; give it in the plan")
        columns.append(column)
    return np.array(columns).reshape(len(columns), len(time)).T  # (steps, 0) where nothing is known of the future
