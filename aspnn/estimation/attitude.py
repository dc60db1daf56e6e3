"""Attitude kinematics: turning rates about the ship's axes and the rates of the Euler angles, and small rotations.

Angles in rad: roll, pitch, heading of the rotation C = R_psi R_theta R_phi from ship axes (x forward, y starboard, z down) to
north-east-down (`frames.attitude`, E9). (p, q, r) are the turning rates about x, y and z of the ship.
"""

import math

import numpy as np
from numba import njit


def euler_rates(roll, pitch, rates) -> np.ndarray:
    """Rates (..., 3) of roll, pitch and heading from turning `rates` (..., 3) about the ship's axes.

    phi' = p + tan(theta) (q sin phi + r cos phi), theta' = q cos phi - r sin phi, psi' = (q sin phi + r cos phi) / cos theta
    (thesis 3.26, corrected: E11, which has p and q the wrong way round and holds for small angles only).
    """
    p, q, r = np.moveaxis(np.asarray(rates, float), -1, 0)
    level = q * np.sin(roll) + r * np.cos(roll)
    return np.stack([p + np.tan(pitch) * level, q * np.cos(roll) - r * np.sin(roll), level / np.cos(pitch)], axis=-1)


def turning_rates(roll, pitch, rates) -> np.ndarray:
    """Turning rates (..., 3) about the ship's axes from the `rates` (..., 3) of roll, pitch and heading: the inverse."""
    roll_rate, pitch_rate, heading_rate = np.moveaxis(np.asarray(rates, float), -1, 0)
    c, s, level = np.cos(roll), np.sin(roll), heading_rate * np.cos(pitch)
    return np.stack(
        [roll_rate - heading_rate * np.sin(pitch), pitch_rate * c + level * s, level * c - pitch_rate * s], axis=-1
    )


def heading_rate(roll, pitch, yaw_rate, pitch_rate):
    """psi' of a ship whose turning rate about its own vertical axis is `yaw_rate` and whose pitch changes by `pitch_rate`.

    With q from theta' (E11) it needs no gyro athwart: psi' = (r / cos phi + theta' tan phi) / cos theta.
    """
    return (yaw_rate / np.cos(roll) + pitch_rate * np.tan(roll)) / np.cos(pitch)


def skew(vector) -> np.ndarray:
    """Matrix (..., 3, 3) of the cross product with `vector` (..., 3): skew(a) b = a x b."""
    a, b, c = np.moveaxis(np.asarray(vector, float), -1, 0)
    none = np.zeros_like(a)
    rows = [[none, -c, b], [c, none, -a], [-b, a, none]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@njit(cache=True, error_model="numpy")
def quaternion(roll, pitch, heading, q):
    """Fill `q` (4), scalar first, with the rotation from ship axes to north-east-down."""
    a, b = math.cos(roll / 2), math.sin(roll / 2)
    c, d = math.cos(pitch / 2), math.sin(pitch / 2)
    e, f = math.cos(heading / 2), math.sin(heading / 2)
    q[0] = a * c * e + b * d * f
    q[1] = b * c * e - a * d * f
    q[2] = a * d * e + b * c * f
    q[3] = a * c * f - b * d * e


@njit(cache=True, error_model="numpy")
def turn(q, x, y, z):
    """Turn the rotation `q` (4) in place by the rotation vector (x, y, z) [rad] in ship axes: q exp(v / 2), kept of unit length."""
    half = math.sqrt(x * x + y * y + z * z) / 2
    scale = np.sinc(half / math.pi) / 2
    w, x, y, z = math.cos(half), scale * x, scale * y, scale * z
    a, b, c, d = q[0], q[1], q[2], q[3]
    q[0] = a * w - b * x - c * y - d * z
    q[1] = a * x + b * w + c * z - d * y
    q[2] = a * y - b * z + c * w + d * x
    q[3] = a * z + b * y - c * x + d * w
    length = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for i in range(4):
        q[i] /= length


@njit(cache=True, error_model="numpy")
def rotation(q, C):
    """Fill C (3, 3), from ship axes to north-east-down, from the quaternion `q` (4)."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    C[0, 0], C[0, 1], C[0, 2] = 1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)
    C[1, 0], C[1, 1], C[1, 2] = 2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)
    C[2, 0], C[2, 1], C[2, 2] = 2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)


@njit(cache=True, error_model="numpy")
def angles(C):
    """Roll, pitch and heading [rad] of the rotation C (3, 3)."""
    return math.atan2(C[2, 1], C[2, 2]), math.asin(min(max(-C[2, 0], -1.0), 1.0)), math.atan2(C[1, 0], C[0, 0])
