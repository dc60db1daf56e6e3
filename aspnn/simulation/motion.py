"""How a ship moves over ground: from state rows and their derivatives, and with the first-order motion of the waves on top."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from aspnn.frames import to_body, to_north_east
from aspnn.guidance import helms


class Motion(NamedTuple):
    """Place, attitude, level velocities over ground and their time derivatives, arrays (n,), as in `voyage.Voyage`.

    `surge` is along the heading and `sway` athwart it, both horizontal; `yaw_rate` is the heading's rate and `roll_rate`,
    `pitch_rate` are those of the Euler angles; `heave` and its rate are downward.
    """

    north: np.ndarray
    east: np.ndarray
    heading: np.ndarray
    surge: np.ndarray
    sway: np.ndarray
    yaw_rate: np.ndarray
    surge_rate: np.ndarray
    sway_rate: np.ndarray
    yaw_acceleration: np.ndarray
    roll: np.ndarray
    pitch: np.ndarray
    heave: np.ndarray
    roll_rate: np.ndarray
    pitch_rate: np.ndarray
    heave_rate: np.ndarray
    heave_acceleration: np.ndarray


def over_ground(states: np.ndarray, rates: np.ndarray, current: np.ndarray, current_rate: np.ndarray) -> Motion:
    """The motion over ground of states (n, columns) with derivatives `rates`; `current` (n, 2) [m/s], its rate along the way.

    Velocities through the water turn with the ship, so those of the water do in its axes: their rate adds yaw rate x current.
    """
    if states.shape[1] == helms.COLUMNS:
        u, v, r = states[:, helms.SURGE], states[:, helms.SWAY], states[:, helms.YAW_RATE]
        u_rate, v_rate, turning = rates[:, helms.SURGE], rates[:, helms.SWAY], rates[:, helms.YAW_RATE]
        roll = pitch = down = roll_rate = pitch_rate = down_rate = down_acceleration = np.zeros(len(states))
    else:
        u, v, w, p, q = (
            states[:, i] for i in (helms.SURGE, helms.SWAY, helms.HEAVE, helms.ROLL_RATE, helms.PITCH_RATE)
        )
        yaw, r, roll, pitch, down = (
            states[:, helms.YAW_RATE],
            rates[:, helms.HEADING],
            states[:, helms.ROLL],
            states[:, helms.PITCH],
            states[:, helms.DOWN],
        )
        roll_rate, pitch_rate, down_rate = rates[:, helms.ROLL], rates[:, helms.PITCH], rates[:, helms.DOWN]
        accelerated = (  # by the rotation of the body's axes
            rates[:, helms.SURGE] + q * w - yaw * v,
            rates[:, helms.SWAY] + yaw * u - p * w,
            rates[:, helms.HEAVE] + p * v - q * u,
        )
        ahead, athwart, down_acceleration = level(*accelerated, roll, pitch)
        u, v, _ = level(u, v, w, roll, pitch)
        u_rate, v_rate = ahead + r * v, athwart - r * u
        c, s = np.cos(roll), np.sin(roll)
        turning = rates[:, helms.PITCH_RATE] * s + rates[:, helms.YAW_RATE] * c + (q * c - yaw * s) * roll_rate
        turning = turning / np.cos(pitch) + r * np.tan(pitch) * pitch_rate
    heading = states[:, helms.HEADING]
    forward, starboard = to_body(current[:, 0], current[:, 1], heading)
    gaining, sidling = to_body(current_rate[:, 0], current_rate[:, 1], heading)
    return Motion(
        states[:, helms.NORTH],
        states[:, helms.EAST],
        heading,
        u + forward,
        v + starboard,
        r,
        u_rate + r * starboard + gaining,
        v_rate - r * forward + sidling,
        turning,
        roll,
        pitch,
        down,
        roll_rate,
        pitch_rate,
        down_rate,
        down_acceleration,
    )


def level(x, y, z, roll, pitch):
    """A vector in body axes (x forward, y starboard, z down) in level axes: along the heading, athwart it, down."""
    deep = y * np.sin(roll) + z * np.cos(roll)
    return (
        x * np.cos(pitch) + deep * np.sin(pitch),
        y * np.cos(roll) - z * np.sin(roll),
        deep * np.cos(pitch) - x * np.sin(pitch),
    )


def with_waves(mean: Motion, moved: np.ndarray, time: np.ndarray) -> Motion:
    """The mean motion of a ship of three degrees at `time` (n) with the waves' displacement (6, n) on top.

    In the axes of the mean heading: surge, sway, heave (down), roll, pitch, yaw; rates are those of cubic splines, so that
    velocities are the derivatives of places however the ship turns. With xi the horizontal displacement there,
    p = p_mean + R xi, p' = p_mean' + R (xi' + r x xi), p'' = p_mean'' + R (xi'' + 2 r x xi' + r' x xi - r^2 xi).
    """
    spline = CubicSpline(time, moved, axis=1)
    rate, acceleration = spline(time, 1), spline(time, 2)
    xi, xi_rate, xi_acceleration = (part[0] + 1j * part[1] for part in (moved, rate, acceleration))
    r, turning = mean.yaw_rate, mean.yaw_acceleration
    velocity = mean.surge + 1j * mean.sway + xi_rate + 1j * r * xi
    gained = mean.surge_rate + 1j * mean.sway_rate + 1j * r * (mean.surge + 1j * mean.sway)
    gained = gained + xi_acceleration + 2j * r * xi_rate + (1j * turning - r**2) * xi
    yaw_rate = r + rate[5]
    velocity, gained = velocity * np.exp(-1j * moved[5]), gained * np.exp(-1j * moved[5])
    gained = gained - 1j * yaw_rate * velocity
    north, east = to_north_east(moved[0], moved[1], mean.heading)
    return Motion(
        mean.north + north,
        mean.east + east,
        mean.heading + moved[5],
        velocity.real,
        velocity.imag,
        yaw_rate,
        gained.real,
        gained.imag,
        turning + acceleration[5],
        moved[3],
        moved[4],
        moved[2],
        rate[3],
        rate[4],
        rate[2],
        acceleration[2],
    )
