"""The table of states: estimates with their standard deviations, what was ordered, and how the filters fared."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aspnn.angles import wrap
from aspnn.estimation.compiled import Run
from aspnn.estimation.measurements import Measurements, Opening, carried, column
from aspnn.estimation.problem import COASTING, REACQUIRED, REJECTED, USED
from aspnn.orders import Orders
from aspnn.records import Log

HELD = (
    "rudder_order_deg",
    "rudder_angle_deg",
    "shaft_speed_rps",
    "engine_order_rps",
    "wind_speed_true_m_s",
    "wind_from_true_deg",
)
# s: what is measured and not heard for so long is not known any more. An order holds until the next. A rudder goes from stop to
# stop in 28 s (SOLAS II-1/29), shafts and winds change more slowly.
SILENT = {"rudder_angle_deg": 10.0, "shaft_speed_rps": 30.0, "wind_speed_true_m_s": 60.0, "wind_from_true_deg": 60.0}


@dataclass(frozen=True)
class Held:
    """What the rows of a block of a log leave for those of the next.

    `shaft` is the column that tells the shaft speed. `last` are the last known values of HELD, `heard` the times [s] of those in SILENT;
    `servo` the time [s] of the last
    new order and the rudder angle [rad] then, None unless the servo stands in for the angle; `used` the time of the last
    position that was used.
    """

    shaft: str
    last: dict[str, float]
    heard: dict[str, float]
    servo: tuple[float, float] | None
    used: float

    @staticmethod
    def before(begin: Opening, time: float) -> "Held":
        """What a log that begins as `begin` at `time` [s] is taken to hold before: its first known values."""
        last = {name: begin.first.get(name, math.nan) for name in HELD}
        order = math.radians(last["rudder_order_deg"])
        stands_in = math.isnan(last["rudder_angle_deg"]) and math.isfinite(order)
        shaft = "shaft_speed_rps" if "shaft_speed_rps" in begin.first else "engine_order_rps"
        return Held(shaft, last, dict.fromkeys(SILENT, time), (time, order) if stands_in else None, -math.inf)


def estimates(
    log: Log,
    m: Measurements,
    heading: tuple[np.ndarray, np.ndarray],
    motion: tuple[np.ndarray, np.ndarray],
    moving: Run,
    turning: Run | None,
    held: Held,
) -> tuple[dict[str, np.ndarray], Held]:
    """States by the columns of schema.STATES, one row per epoch of a block of a log, and what they leave for the next block.

    `heading` and `motion` are mean and covariance of CAA and CTRA (filtered or smoothed), `moving` and `turning` the runs
    of the filters; innovations are told where `turning` is given. The standard deviations of surge and sway hold what the
    error of the heading does to them, which CTRA takes as known (E18): (v, -u) times that of the heading.
    """
    (psi, r, turn), (north, east, u, v, a_u, a_v) = heading[0].T, motion[0].T
    sd_psi, sd_r, sd_turn = np.sqrt(np.diagonal(heading[1], axis1=1, axis2=2)).T
    sd = np.sqrt(np.diagonal(motion[1], axis1=1, axis2=2)).T
    bow, stern = log.vessel.sway_stations
    forcings, after = in_force(log, m, held)
    fate = moving.fate[:, : len(m.fixes)]
    used = np.where(((fate == USED) | (fate == REACQUIRED)).any(axis=1), m.time, held.used)
    used = np.maximum.accumulate(used)
    columns = {
        "time_s": m.time,
        "north_m": north + m.origin[0],
        "east_m": east + m.origin[1],
        "heading_rad": psi,
        "surge_m_s": u,
        "sway_m_s": v,
        "yaw_rate_rad_s": r,
        "surge_acceleration_m_s2": a_u,
        "sway_acceleration_m_s2": a_v,
        "yaw_acceleration_rad_s2": turn,
        "north_m_sd": sd[0],
        "east_m_sd": sd[1],
        "heading_rad_sd": sd_psi,
        "surge_m_s_sd": np.hypot(sd[2], v * sd_psi),
        "sway_m_s_sd": np.hypot(sd[3], u * sd_psi),
        "yaw_rate_rad_s_sd": sd_r,
        "surge_acceleration_m_s2_sd": sd[4],
        "sway_acceleration_m_s2_sd": sd[5],
        "yaw_acceleration_rad_s2_sd": sd_turn,
        "convergence_rad": m.convergence,
        "sway_bow_m_s": v + r * bow,
        "sway_stern_m_s": v + r * stern,
        "drift_rad": np.arctan2(-v, u),
        **forcings,
        **(_consistency(m, moving, turning) if turning is not None else {}),
        "gated": (moving.fate == REJECTED).any(axis=1),
        "stale": m.stale,
        "coasting": m.time - used > COASTING,  # or no position has been used yet
    }
    return columns, replace(after, used=float(used[-1]))


def in_force(log: Log, m: Measurements, held: Held) -> tuple[dict[str, np.ndarray], Held]:
    """Orders in force, rudder angle, shaft speed and wind: the last known value, NaN where it is older than SILENT.

    And what `Held` keeps of them.
    """
    given = {name: column(log, name) for name in HELD}
    values = {name: carried(value, held.last[name]) for name, value in given.items()}
    last = {name: float(value[-1]) for name, value in values.items()}
    heard = dict(held.heard)
    for name, limit in SILENT.items():
        since = carried(np.where(np.isfinite(given[name]), m.time, np.nan), heard[name])
        heard[name] = float(since[-1])
        values[name] = np.where(m.time - since > limit, np.nan, values[name])
    angle, servo = np.radians(values["rudder_angle_deg"]), held.servo
    if servo is not None:
        # The servo starts at the last new order, so that the blocks of a log are one servo to the last bit.
        begun, start = servo
        time = np.concatenate([[begun], m.time])
        order = np.radians(np.concatenate([[held.last["rudder_order_deg"]], values["rudder_order_deg"]]))
        orders = Orders.from_series(time, order)
        angle = orders.servo(time, start, log.vessel.rudder_rate)[1:]
        if len(orders.times) > 1:
            renewed = float(orders.times[-1])
            servo = renewed, float(orders.servo(np.array([begun, renewed]), start, log.vessel.rudder_rate)[1])
    forcings = {
        "rudder_order_rad": np.radians(values["rudder_order_deg"]),
        "rudder_angle_rad": angle,
        "shaft_speed_rps": values[held.shaft],
        "engine_order_rps": values["engine_order_rps"],
        "wind_speed_true_m_s": values["wind_speed_true_m_s"],
        "wind_from_grid_rad": wrap(np.radians(values["wind_from_true_deg"]) - m.convergence),
    }
    return forcings, replace(held, last=last, heard=heard, servo=servo)


def _consistency(m: Measurements, moving: Run, turning: Run) -> dict[str, np.ndarray]:
    """Innovations and normalised innovations squared of the sensors that the log has."""
    columns = {
        "innovation_heading_rad": turning.innovation[:, 0, 0],
        "innovation_yaw_rate_rad_s": turning.innovation[:, 1, 0],
        "nis_heading": turning.nis[:, 0],
        "nis_yaw_rate": turning.nis[:, 1],
    }
    for b, name in enumerate(m.fixes):
        columns[f"innovation_{name}_north_m"] = moving.innovation[:, b, 0]
        columns[f"innovation_{name}_east_m"] = moving.innovation[:, b, 1]
        columns[f"nis_{name}"] = moving.nis[:, b]
    columns["innovation_surge_m_s2"] = moving.innovation[:, -1, 0]
    columns["innovation_sway_m_s2"] = moving.innovation[:, -1, 1]
    columns["nis_acceleration"] = moving.nis[:, -1]
    return columns
