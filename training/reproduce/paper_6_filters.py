"""The filter of Paper VI with its printed numbers: algorithm 1 on 3D-PV (7), (9) and CAA (8), (11), noise of table 2.

Linear Kalman filters over the epochs of a log, step by step. What would make them senseless is corrected (attitude E9,
gravity E12, height E13); noise, inputs and the pair of models are as printed. What the paper does not print is said where
it is assumed.
"""

from typing import NamedTuple

import numpy as np

from aspnn.estimation.measurements import carried
from aspnn.estimation.spatial_inputs import DOWN, from_ship_log
from aspnn.frames import attitude, to_body
from aspnn.records import Log

Q_MOVING = np.array([0.25, 0.125, 0.0625])  # q_1, q_2, q_3 [m2/s4] of north, east, down
R_MOVING = np.diag([0.15**2, 0.1058**2, 0.2121**2])  # m2
ALPHA, THRESHOLD = 1.015, 0.02  # factor of Q where the yaw acceleration [rad/s2] is larger; taken both ways (E33)
Q_TURNING = 3.6642e-5  # q_psi; times a matrix that is that of white angular jerk over dt (E34)
R_TURNING = np.diag([0.005**2, 0.0375**2])  # rad2, rad2/s2: the paper names no units (E35)
SPEED = 10.0  # m/s, deviation of the velocity before the first fix (assumed)
TURNING = 1.0  # rad/s2, deviation of the yaw acceleration before the first measurement (assumed)


class Estimates(NamedTuple):
    """What the paper's filter makes of a log (n epochs): midship in the grid of the log, its motion, and the NIS of both models."""

    time: np.ndarray
    north: np.ndarray
    east: np.ndarray
    heading: np.ndarray
    surge: np.ndarray
    sway: np.ndarray
    yaw_rate: np.ndarray
    nis_turning: np.ndarray  # 2 degrees of freedom
    nis_moving: np.ndarray  # 3 degrees of freedom


def kalman(F, u, Q, R, z, x, P) -> tuple[np.ndarray, np.ndarray]:
    """Algorithm 1: means (n, d) and NIS (n) of a state that is measured in its first m components.

    `F` (d, d); inputs `u` (n, d) and `Q` (n, d, d) of the steps that end at each epoch; `R` (m, m), `z` (n, m); `x`, `P` at the
    first epoch, which is not measured again: its NIS is NaN.
    """
    m, means, nis = len(R), np.empty((len(z), len(x))), np.full(len(z), np.nan)
    means[0] = x
    for k in range(1, len(z)):
        x, P = F @ x + u[k], F @ P @ F.T + Q[k]
        e, S = z[k] - x[:m], P[:m, :m] + R
        K = np.linalg.solve(S, P[:m]).T
        nis[k] = e @ np.linalg.solve(S, e)
        x, P = x + K @ e, P - K @ P[:m]
        means[k] = x
    return means, nis


def turning_noise(dt: float) -> np.ndarray:
    """Q of CAA (table 2) for steps of `dt` [s]: as printed."""
    return Q_TURNING * np.array(
        [[dt**4 / 20, dt**3 / 8, dt**2 / 6], [dt**3 / 8, dt**2 / 3, dt / 2], [dt**2 / 6, dt / 2, 1]]
    )


def turning(time, heading, yaw_rate) -> tuple[np.ndarray, np.ndarray]:
    """CAA (8) on continuous headings and yaw rates (n): heading, rate, acceleration (n, 3), and NIS (n)."""
    dt = float(np.median(np.diff(time)))
    F = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    Q = turning_noise(dt)
    P = np.diag([*np.diag(R_TURNING), TURNING**2])
    z, n = np.stack([heading, yaw_rate], axis=-1), len(time)
    return kalman(F, np.zeros((n, 3)), np.broadcast_to(Q, (n, 3, 3)), R_TURNING, z, np.array([*z[0], 0.0]), P)


def moving(time, place, acceleration, yaw_acceleration) -> tuple[np.ndarray, np.ndarray]:
    """3D-PV (7) on places and accelerations (n, 3), north-east-down: place and velocity (n, 6), and NIS (n).

    The input is the acceleration at the step's beginning.
    """
    dt = float(np.median(np.diff(time)))
    F = np.eye(6) + dt * np.eye(6, k=3)
    gain = np.kron([[dt**2 / 2], [dt]], np.eye(3))
    u = np.concatenate([np.zeros((1, 6)), (acceleration @ gain.T)[:-1]])
    scale = np.where(np.abs(yaw_acceleration) > THRESHOLD, ALPHA, 1.0)
    Q = scale[:, None, None] * (gain @ np.diag(Q_MOVING) @ gain.T)
    P = np.diag([*np.diag(R_MOVING), *[SPEED**2] * 3])
    return kalman(F, u, Q, R_MOVING, place, np.array([*place[0], 0.0, 0.0, 0.0]), P)


def paper_filter(log: Log) -> Estimates:
    """The paper's filter on a log whose one antenna, unit and gyro are sampled together, as on its boat.

    The antenna's places are moved to the receiver at midship before they are measured, by the lever arm in three dimensions.
    The yaw rate is the gyro's about the ship's own axis, as in the paper (against E11).
    """
    i = from_ship_log(log)
    m, ((name, fixes),) = i.planar, i.planar.fixes.items()
    roll, pitch, heading, rate = (carried(a) for a in (i.roll, i.pitch, m.heading, m.yaw_rate))
    turned, nis_turning = turning(i.time, np.unwrap(heading), rate)
    psi, r, r_rate = turned.T
    C = attitude(roll, pitch, psi)
    place = np.column_stack([fixes, i.down[name]]) - C @ i.arms[name]
    felt = np.einsum("tij,tj->ti", C, np.column_stack([carried(axis) for axis in i.force.T])) + DOWN
    moved, nis_moving = moving(i.time, place, felt, r_rate)
    surge, sway = to_body(moved[:, 3], moved[:, 4], psi)
    north, east = m.origin[0] + moved[:, 0], m.origin[1] + moved[:, 1]
    return Estimates(i.time, north, east, psi, surge, sway, r, nis_turning, nis_moving)
