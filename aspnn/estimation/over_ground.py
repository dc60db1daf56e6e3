"""The planar filters with course and speed over ground among their measurements: for reports that come seldom, such as AIS.

Fixes every 3 to 10 s tell a velocity late; a receiver measures it, by Doppler, at every report. Receivers smooth what they tell, by how
much their makers seldom say (a yacht's compass: 2.5 s). A velocity that is 2 s late and taken as of now makes places worse than none
does, so this is a filter of its own, and `delay` says how late.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from aspnn.checks import check_log
from aspnn.estimation import compiled
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import Measurements, check_opening, column, from_log, opening
from aspnn.estimation.problem import OUTLIER, Problem, gate
from aspnn.estimation.states import Held, estimates
from aspnn.frames import to_body
from aspnn.records import Log, States
from aspnn.schema import InputError

LATEST = 10.0  # s; beyond, taking the motion back by its rates tells nothing
DEVIATION = 0.1  # m/s per axis: Doppler of a receiver 0.05, and 0.1 kn steps; assumed


def filter_over_ground(log: Log, delay: float = 0.0, deviation: float = DEVIATION, engine=compiled) -> States:
    """States of a log as `filter_log` makes them, with course and speed over ground of its first antenna used too.

    They tell the velocity `delay` [s] ago, with `deviation` [m/s] along each axis. Raises InputError for a wrong log, or one that does
    not tell them.
    """
    where = log.path or "log"
    check_log(log, where)
    begin = opening(log)
    check_opening(log, begin)
    for name in ("course_over_ground_deg", "speed_over_ground_m_s"):
        if name not in begin.first:
            raise InputError(f"{where}: column {name} has no value; filter without it (leave out --over-ground)")
    if not (0 < deviation < np.inf and 0 <= delay <= LATEST):
        raise InputError(
            f"velocity over ground: deviation {deviation:g} m/s must be positive, delay {delay:g} s from 0 to {LATEST:g}"
        )
    m, vessel = from_log(log), log.vessel
    size = vessel.service_speed, vessel.length
    turn = heading_problem(m, vessel.noise, *size)
    turning = engine.run(turn)
    motion = motion_problem(m, vessel.noise, turning.mean, turning.covariance, *size)
    given = turning.mean, turning.covariance
    problem = with_velocity(motion, m, velocity(log, m), *given, deviation, delay, vessel.noise.jerk_density)
    moving = engine.run(problem)
    held = Held.before(begin, float(m.time[0]))
    heading, path = (turning.mean, turning.covariance), (moving.mean, moving.covariance)
    columns, _ = estimates(log, m, heading, path, moving, turning, held)
    return States.of(log, pd.DataFrame(columns))


def velocity(log: Log, m: Measurements) -> np.ndarray:
    """Velocity over ground (n, 2) [m/s] north and east on the grid, from course (true) and speed; NaN where not both are told."""
    course = np.radians(column(log, "course_over_ground_deg")) - m.convergence
    speed = column(log, "speed_over_ground_m_s")
    return np.column_stack([speed * np.cos(course), speed * np.sin(course)])


def with_velocity(
    problem: Problem,
    m: Measurements,
    told: np.ndarray,
    heading: np.ndarray,
    covariance: np.ndarray,
    deviation: float,
    delay: float = 0.0,
    density: float = 0.0,
) -> Problem:
    """The CTRA problem with the velocity over ground (n, 2) of the first antenna as one block more, before the accelerations.

    An antenna at (X, Y) moves at u - r Y, v + r X in body axes (thesis 4.1.1, corrected: E6), on the heading and yaw rate r of CAA. The
    error of r over the lever arm is added to R; that of the heading is not: it turns the states as it turns the measurement, and the
    table of states adds it (E18). A record that is tau late tells u - tau a_u and v - tau a_v at heading psi - r tau + r' tau^2 / 2 and
    yaw rate r - r' tau; what the jerk of `density` [m2/s5] did meanwhile adds density tau^3 / 3 to R.
    """
    n, block = len(m.time), problem.z.shape[1] - 1
    x, y = next(iter(m.stations.values()))
    psi, r, turn = heading.T
    psi, r, variance = psi - r * delay + turn * delay**2 / 2, r - turn * delay, covariance[:, 1, 1]
    u, v = to_body(told[:, 0], told[:, 1], psi)
    H, R = np.zeros((n, 2, 6)), np.zeros((n, 2, 2))
    H[:, 0, 2] = H[:, 1, 3] = 1.0
    H[:, 0, 4] = H[:, 1, 5] = -delay
    lever = np.array([-y, x])
    R[:] = (deviation**2 + density * delay**3 / 3) * np.eye(2) + variance[:, None, None] * np.outer(lever, lever)
    z = np.column_stack([u, v]) - r[:, None] * lever
    return replace(
        problem,
        z=np.insert(problem.z, block, z, axis=1),
        H=np.insert(problem.H, block, H, axis=1),
        R=np.insert(problem.R, block, R, axis=1),
        span=np.insert(problem.span, block, [2, 6], axis=0),
        angle=np.insert(problem.angle, block, False),
        gates=np.insert(problem.gates, block, gate(OUTLIER), axis=0),
        group=np.insert(problem.group, block, 2),
        place=np.insert(problem.place, block, [0, 0, 1.0, 1, 0, 0], axis=0),
        rate=np.insert(problem.rate, block, [0, 0, 0, 0, 1.0, 1], axis=0),
    )
