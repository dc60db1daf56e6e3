"""The table of states: estimates with their standard deviations, what was ordered, and how the filters fared."""

import numpy as np
import pandas as pd

from aspnn.angles import wrap
from aspnn.estimation.compiled import Run
from aspnn.estimation.measurements import Measurements, carried, column
from aspnn.estimation.problem import COASTING, REACQUIRED, REJECTED, USED
from aspnn.orders import Orders
from aspnn.records import Log


def table(
    log: Log,
    m: Measurements,
    heading: tuple[np.ndarray, np.ndarray],
    motion: tuple[np.ndarray, np.ndarray],
    moving: Run,
    turning: Run | None,
) -> pd.DataFrame:
    """States by the columns of schema.STATES, one row per epoch of the log.

    `heading` and `motion` are mean and covariance of CAA and CTRA (filtered or smoothed), `moving` and `turning` the runs
    of the filters; innovations are told where `turning` is given. The standard deviations of surge and sway hold what the
    error of the heading does to them, which CTRA takes as known (E18): (v, -u) times that of the heading.
    """
    (psi, r, turn), (north, east, u, v, a_u, a_v) = heading[0].T, motion[0].T
    sd_psi, sd_r, sd_turn = np.sqrt(np.diagonal(heading[1], axis1=1, axis2=2)).T
    sd = np.sqrt(np.diagonal(motion[1], axis1=1, axis2=2)).T
    bow, stern = log.vessel.sway_stations
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
        **_forcings(log, m),
        **(_consistency(m, moving, turning) if turning is not None else {}),
        "gated": (moving.fate == REJECTED).any(axis=1),
        "stale": m.stale,
        "coasting": _coasting(m.time, moving.fate[:, : len(m.fixes)]),
    }
    return pd.DataFrame(columns)


def _coasting(time, fate) -> np.ndarray:
    """Whether no position has been used for longer than COASTING seconds, or none yet."""
    used = ((fate == USED) | (fate == REACQUIRED)).any(axis=1)
    return time - np.maximum.accumulate(np.where(used, time, -np.inf)) > COASTING


def _forcings(log: Log, m: Measurements) -> dict[str, np.ndarray]:
    """Orders in force, rudder angle, shaft speed and wind: the last known value, the first where none is known yet."""
    order = np.radians(column(log, "rudder_order_deg"))
    angle, shaft = np.radians(column(log, "rudder_angle_deg")), column(log, "shaft_speed_rps")
    if not np.isfinite(angle).any() and np.isfinite(order).any():
        orders = Orders.from_series(m.time, order)
        angle = orders.servo(m.time, float(orders.at(m.time[0])), log.vessel.rudder_rate)
    if not np.isfinite(shaft).any():
        shaft = column(log, "engine_order_rps")
    return {
        "rudder_order_rad": carried(order),
        "rudder_angle_rad": carried(angle),
        "shaft_speed_rps": carried(shaft),
        "engine_order_rps": carried(column(log, "engine_order_rps")),
        "wind_speed_true_m_s": carried(column(log, "wind_speed_true_m_s")),
        "wind_from_grid_rad": wrap(carried(np.radians(column(log, "wind_from_true_deg"))) - m.convergence),
    }


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
