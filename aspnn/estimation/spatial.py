"""Logs to navigation states by the filters in three dimensions: which of them, midship's motion, and the table of states."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aspnn.checks import check_log
from aspnn.estimation.attitude import euler_rates
from aspnn.estimation.compiled import Run
from aspnn.estimation.errorstate import error_state
from aspnn.estimation.measurements import carried, opening
from aspnn.estimation.mounting import check_gravity
from aspnn.estimation.position_velocity import (
    UNFELT,
    Moving,
    Process,
    compass_run,
    derived,
    position_velocity,
    targets,
    tilts,
    turned_by,
    turning_on,
    turning_run,
)
from aspnn.estimation.problem import COASTING, REACQUIRED, REJECTED, USED
from aspnn.estimation.spatial_inputs import Inertial, from_ship_log
from aspnn.estimation.states import Held, in_force
from aspnn.frames import attitude, to_body
from aspnn.records import Log, States
from aspnn.schema import InputError


@dataclass(frozen=True)
class Solution:
    """A log in three dimensions (n epochs): its sensors, the run of CAA, the IMU's motion, `attitude` (n, 3) as roll, pitch and
    heading, the standard deviation of the heading (n), turning `rates` (n, 3) about the ship's axes, and, of the error-state filter,
    `biases` (n, 6) of accelerometers and gyros.
    """

    inertial: Inertial
    turning: Run
    moving: Moving
    attitude: np.ndarray
    heading_sd: np.ndarray
    rates: np.ndarray
    biases: np.ndarray | None = None


def solve_position_velocity(log: Log, process: Process = derived) -> Solution:
    """3D-PV beside CAA (Paper VI): heading and its rate from CAA, roll and pitch as measured. Raises InputError for a wrong log."""
    i = _sensors(log)
    turning = compass_run(i, log.vessel)
    roll, pitch, _ = tilts(i)
    moving = position_velocity(i, log.vessel, turning, process)
    euler = np.column_stack([roll, pitch, turning.mean[:, 0]])
    return Solution(i, turning, moving, euler, np.sqrt(turning.covariance[:, 0, 0]), turned_by(i))


def solve_error_state(log: Log) -> Solution:
    """The error-state filter, then CAA on the compass and the rate of the heading without the gyros' biases.

    Raises InputError for a wrong log, and for one without forces or turning rates.
    """
    i = _sensors(log)
    if not (i.felt and i.turned):
        raise InputError(
            f"{log.path or 'log'}: no imu_rate_x_deg_s, imu_rate_y_deg_s, imu_rate_z_deg_s beside forces; "
            f"the error-state filter needs them, 3D-PV does not"
        )
    found = error_state(i, log.vessel)
    rates = np.column_stack([carried(axis, 0.0) for axis in i.rates.T]) - found.biases[:, 3:]
    rate = euler_rates(found.attitude[:, 0], found.attitude[:, 1], rates)[:, 2]
    c, noise = np.cos(found.attitude[:, 1]), log.vessel.noise.yaw_rate
    known = np.isfinite(i.rates[:, 0])
    turning = turning_run(turning_on(i, log.vessel, np.where(known, rate, np.nan), (noise / c) ** 2))
    euler = found.attitude.copy()
    euler[:, 2] += 2 * np.pi * np.round((turning.mean[:, 0] - euler[:, 2]) / (2 * np.pi))
    return Solution(i, turning, found.moving, euler, found.attitude_sd[:, 2], rates, found.biases)


def _sensors(log: Log) -> Inertial:
    check_log(log, log.path or "log")
    i = from_ship_log(log)
    check_gravity(i, log)
    return i


def filter_spatial(log: Log, solve: Callable[[Log], Solution] | None = None) -> States:
    """States of a log from a filter in three dimensions, one row per epoch, each from the log up to that epoch.

    Without `solve` the error-state filter where the log has forces and turning rates of all three axes, else 3D-PV. They hold
    the columns of the planar filter, so every predictor takes them, with the motion up and down and the attitude besides. The
    whole log is in memory (about 2 kB per row). Raises InputError for a wrong log.
    """
    if solve is None:
        rates = [f"imu_rate_{axis}_deg_s" for axis in "xyz"] + [f"imu_force_{axis}_m_s2" for axis in "xyz"]
        complete = all(name in log.table and log.table[name].notna().any() for name in rates)
        solve = solve_error_state if complete else solve_position_velocity
    return States.of(log, _table(log, solve(log)))


@dataclass(frozen=True)
class Midship:
    """Midship's motion (n): `place` and `velocity` (n, 3) north-east-down, surge and sway, and their time derivatives."""

    place: np.ndarray
    velocity: np.ndarray
    surge: np.ndarray
    sway: np.ndarray
    surge_rate: np.ndarray
    sway_rate: np.ndarray


def midship(s: Solution) -> Midship:
    """From the IMU to midship: p - C l, v - C (w x l), a - C (w' x l + w x (w x l)); then along and athwart the heading (Paper VI 6).

    In the acceleration w' is the yaw acceleration of CAA alone: those of roll and pitch are not measured. Where no acceleration
    is felt, surge and sway keep steady.
    """
    C, arm, psi = attitude(*s.attitude.T), s.inertial.arms["imu"], s.attitude[:, 2]
    whirl = np.cross(s.rates, arm)
    place = s.moving.mean[:, :3] - C @ arm
    velocity = s.moving.mean[:, 3:] - np.einsum("tij,tj->ti", C, whirl)
    inward = np.cross(s.rates, whirl) + np.cross(s.turning.mean[:, 2, None] * C[:, 2], arm)
    acceleration = s.moving.acceleration - np.einsum("tij,tj->ti", C, inward)
    r = s.turning.mean[:, 1]
    surge, sway = to_body(velocity[:, 0], velocity[:, 1], psi)
    ahead, athwart = to_body(acceleration[:, 0], acceleration[:, 1], psi)
    rates = np.nan_to_num(ahead + r * sway), np.nan_to_num(athwart - r * surge)
    return Midship(place, velocity, surge, sway, *rates)


def _table(log: Log, s: Solution) -> pd.DataFrame:
    """States by the columns of schema.STATES.

    The standard deviations of surge and sway hold what the error of the heading does to them (E18), as in the planar filter's.
    """
    i, m, fit, at = s.inertial, s.inertial.planar, s.moving.fit, midship(s)
    noise, spatial = log.vessel.noise, log.vessel.spatial
    psi, (_, r, turn) = s.attitude[:, 2], s.turning.mean.T
    _, sd_r, sd_turn = np.sqrt(np.diagonal(s.turning.covariance, axis1=1, axis2=2)).T
    P = s.moving.covariance
    sd = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    c, sine = np.cos(psi), np.sin(psi)
    ahead = c**2 * P[:, 3, 3] + 2 * c * sine * P[:, 3, 4] + sine**2 * P[:, 4, 4]
    athwart = sine**2 * P[:, 3, 3] - 2 * c * sine * P[:, 3, 4] + c**2 * P[:, 4, 4]
    felt = np.isfinite(s.moving.acceleration[:, 0])
    tilt = 0.0 if s.biases is not None else 9.81 * spatial.attitude
    shaken = np.where(felt, np.hypot(noise.acceleration, tilt), np.sqrt(UNFELT / i.period))
    antennas = [name for name in targets(i) if name]
    used = fit.fate[:, : len(antennas)]
    last = np.where(((used == USED) | (used == REACQUIRED)).any(axis=1), i.time, -np.inf)
    bow, stern = log.vessel.sway_stations
    deep = i.heaves or "" not in targets(i)
    columns = {
        "time_s": i.time,
        "north_m": at.place[:, 0] + m.origin[0],
        "east_m": at.place[:, 1] + m.origin[1],
        "heading_rad": psi,
        "surge_m_s": at.surge,
        "sway_m_s": at.sway,
        "yaw_rate_rad_s": r,
        "surge_acceleration_m_s2": at.surge_rate,
        "sway_acceleration_m_s2": at.sway_rate,
        "yaw_acceleration_rad_s2": turn,
        "north_m_sd": sd[:, 0],
        "east_m_sd": sd[:, 1],
        "heading_rad_sd": s.heading_sd,
        "surge_m_s_sd": np.hypot(np.sqrt(ahead), at.sway * s.heading_sd),
        "sway_m_s_sd": np.hypot(np.sqrt(athwart), at.surge * s.heading_sd),
        "yaw_rate_rad_s_sd": sd_r,
        "surge_acceleration_m_s2_sd": shaken,
        "sway_acceleration_m_s2_sd": shaken,
        "yaw_acceleration_rad_s2_sd": sd_turn,
        "convergence_rad": m.convergence,
        "sway_bow_m_s": at.sway + r * bow,
        "sway_stern_m_s": at.sway + r * stern,
        "drift_rad": np.arctan2(-at.sway, at.surge),
        **in_force(log, m, Held.before(opening(log), float(i.time[0])))[0],
        "innovation_heading_rad": s.turning.innovation[:, 0, 0],
        "innovation_yaw_rate_rad_s": s.turning.innovation[:, 1, 0],
        "nis_heading": s.turning.nis[:, 0],
        "nis_yaw_rate": s.turning.nis[:, 1],
    }
    for b, name in enumerate(antennas):
        for axis, way in enumerate(("north", "east", "down")):
            columns[f"innovation_{name}_{way}_m"] = fit.innovation[:, b, axis]
        columns[f"nis_{name}"] = fit.nis[:, b]
    columns |= {
        "gated": (fit.fate == REJECTED).any(axis=1),
        "stale": i.stale,
        "coasting": i.time - np.maximum.accumulate(last) > COASTING,
    }
    columns |= {"roll_rad": s.attitude[:, 0], "pitch_rad": s.attitude[:, 1]}
    if deep:
        columns |= {
            "down_m": at.place[:, 2] + i.level,
            "down_velocity_m_s": at.velocity[:, 2],
            "down_m_sd": sd[:, 2],
            "down_velocity_m_s_sd": sd[:, 5],
        }
    if s.biases is not None:
        names = [f"accelerometer_bias_{way}_m_s2" for way in ("forward", "starboard", "down")]
        names += [f"gyro_bias_{way}_rad_s" for way in ("roll", "pitch", "yaw")]
        columns |= dict(zip(names, s.biases.T, strict=True))
    return pd.DataFrame(columns)
