"""Logs without a heading to navigation states: the course filter on one antenna's fixes, and what turning tells of the drift.

A ship that turns drifts: her stern slides outward, about a point ahead of midship that moves along the hull, the pivot point. At
a distance P ahead of midship sway is -r P, so an antenna x ahead of midship has the crab angle -asin(omega (P - x) / U), and

    heading = course + asin(omega (P - x) / U)

What wind and current add nobody sees in positions; the standard deviations hold it.
"""

import math
from collections.abc import Callable

import numpy as np
import pandas as pd

from aspnn.checks import check_log
from aspnn.estimation import course_run
from aspnn.estimation.course_checks import antenna_of, check_fixes
from aspnn.estimation.course_engine import UNIFORM
from aspnn.estimation.course_model import CourseModel
from aspnn.estimation.course_run import CourseProblem, CourseRun, ahead, problem_of
from aspnn.estimation.measurements import Measurements, Opening, check_opening, from_block, opening
from aspnn.estimation.problem import COASTING, REACQUIRED, REJECTED, USED
from aspnn.estimation.states import Held, in_force
from aspnn.frames import to_body, to_north_east
from aspnn.records import Log, States
from aspnn.vessel import Vessel

# Ship lengths. Least squares of sway against -r on simulated voyages of random orders: 0.35 (cargo90), 0.39 (mariner), 0.43
# (kvlcc2_full), 0.46 (workboat8); the spread also holds what begins and ends of turns do.
PIVOT, PIVOT_SD = 0.4, 0.1
STEEPEST = math.sin(math.radians(45))  # of the crab angle that turning may explain
SIDEWAYS = 0.08  # of the service speed: standard deviation of the velocity across that wind and current add (assumed)

Engine = Callable[[CourseProblem], CourseRun]


def filter_course(log: Log, model: CourseModel | None = None, engine: Engine = course_run.run) -> States:
    """States of a log by its positions alone, one row per epoch, each from the log up to that epoch; a heading is not looked at.

    `model` is by default that of the vessel's size and speed, and a fix has the vessel's position noise, taken as white: of a
    receiver whose errors last, more. Surge and yaw accelerations are not known, hence zero, with the deviation of what they come to
    within a ship length. They hold the columns of the other filters, so that every predictor takes them. Raises InputError for a
    wrong log.
    """
    where = log.path or "log"
    check_log(log, where)
    begin = opening(log)
    check_opening(log, begin, heading=False)
    antenna = antenna_of(log)
    m, _ = from_block(log, begin)
    fixes = m.fixes.get(antenna)
    if fixes is None:  # an antenna that tells another's fixes to the last bit is that one
        antenna, fixes = next(iter(m.fixes.items()))
    known = np.isfinite(fixes).all(axis=1)
    check_fixes(m.time, fixes, log.vessel, antenna, where)
    model = model or CourseModel.of(log.vessel)
    sd = log.vessel.noise.position
    run = engine(problem_of(m.time, fixes, sd, model))
    usual = float(np.median(np.diff(m.time[known])))
    return States.of(log, _table(log, begin, m, antenna, model, run, usual))


def _table(log: Log, begin: Opening, m: Measurements, antenna: str, model: CourseModel, run: CourseRun, usual: float):
    """States by the columns of schema.STATES; `usual` [s] is the interval of the fixes."""
    mean, covariance = ahead(run, model, log.vessel.calibration.position_delay)
    place_sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    U, course, omega = mean[:, 2:].T
    sd_U, sd_course, sd_omega = place_sd[:, 2:].T
    heading, drift_sd = _heading(log.vessel, m.stations[antenna], U, course, omega)
    heading_sd = np.minimum(np.hypot(sd_course, drift_sd), math.sqrt(UNIFORM))
    x, y = m.stations[antenna][:2]
    lever = np.column_stack(to_north_east(x, y, heading))
    north, east = (mean[:, :2] - lever + m.origin).T
    u, v = to_body(U * np.cos(course), U * np.sin(course), heading)
    u, v = u + omega * y, v - omega * x
    length, pace = log.vessel.length, log.vessel.service_speed / log.vessel.length
    speeding, turning = math.sqrt(model.speed_density * pace), math.sqrt(model.turn_density * pace)
    pivot = PIVOT * length
    rate_sd = np.hypot(
        sd_omega, pivot * turning / np.maximum(U, log.vessel.service_speed / 10)
    )  # r = omega - d beta_c / dt
    bow, stern = log.vessel.sway_stations
    forcings, _ = in_force(log, m, Held.before(begin, float(m.time[0])))
    used = np.where((run.fate == USED) | (run.fate == REACQUIRED), m.time, -np.inf)
    silent = m.time - np.maximum.accumulate(used)
    still = np.zeros(len(m.time))
    columns = {
        "time_s": m.time,
        "north_m": north,
        "east_m": east,
        "heading_rad": heading,
        "surge_m_s": u,
        "sway_m_s": v,
        "yaw_rate_rad_s": omega,
        "surge_acceleration_m_s2": still,
        "sway_acceleration_m_s2": still,
        "yaw_acceleration_rad_s2": still,
        "north_m_sd": np.hypot(place_sd[:, 0], lever[:, 1] * heading_sd),
        "east_m_sd": np.hypot(place_sd[:, 1], lever[:, 0] * heading_sd),
        "heading_rad_sd": heading_sd,
        # Whoever reads them takes an error e of the heading to leave the velocity over ground, so (v, -u) e with it (E18), and what
        # remains of these for errors of that velocity: of the speed, and of the course.
        "surge_m_s_sd": np.hypot(sd_U, v * heading_sd),
        "sway_m_s_sd": np.sqrt((u * heading_sd) ** 2 + (U * np.minimum(sd_course, 1.0)) ** 2 + (pivot * sd_omega) ** 2),
        "yaw_rate_rad_s_sd": rate_sd,
        "surge_acceleration_m_s2_sd": still + speeding,
        "sway_acceleration_m_s2_sd": still + pivot * turning,
        "yaw_acceleration_rad_s2_sd": still + turning,
        "convergence_rad": m.convergence,
        "sway_bow_m_s": v + omega * bow,
        "sway_stern_m_s": v + omega * stern,
        "drift_rad": np.arctan2(-v, u),
        **forcings,
        f"innovation_{antenna}_north_m": run.innovation[:, 0],
        f"innovation_{antenna}_east_m": run.innovation[:, 1],
        f"nis_{antenna}": run.nis,
        "gated": run.fate == REJECTED,
        "stale": m.stale,
        "coasting": silent > max(COASTING, 2 * usual),
        "course_rad": course,
        "speed_over_ground_m_s": U,
        "course_rate_rad_s": omega,
        "course_rad_sd": sd_course,
        "speed_over_ground_m_s_sd": sd_U,
        "course_rate_rad_s_sd": sd_omega,
    }
    return pd.DataFrame(columns)


def _heading(vessel: Vessel, station: tuple[float, ...], U, course, omega) -> tuple[np.ndarray, np.ndarray]:
    """Heading [rad] and the standard deviation of the drift that it takes, from speed, course and course rate of an antenna."""
    slowest = (
        vessel.service_speed / 100
    )  # below, no direction tells anything; the deviation is that of any angle anyway
    speed = np.maximum(U, slowest)
    beyond = np.clip(omega * (PIVOT * vessel.length - station[0]) / speed, -STEEPEST, STEEPEST)
    turned = np.minimum(np.abs(omega) * PIVOT_SD * vessel.length / speed, math.pi / 2)
    return course + np.arcsin(beyond), np.hypot(np.arctan2(SIDEWAYS * vessel.service_speed, speed), turned)
