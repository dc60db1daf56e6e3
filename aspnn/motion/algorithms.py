"""The published path algorithms as printed, and what is left of their corrections beside `path`: for comparison, not for use.

`path` holds the exact step (`integrate`), the thesis's algorithm corrected (`pivot_path`) and Paper V's with the signed
distance (`paper_v_path`), which predictions and reproductions use. What stands here is read letter by letter (E40, E41).
"""

from dataclasses import replace

import numpy as np

from aspnn.motion.path import Path, pivot_path, walk
from aspnn.motion.pivot import two_station_motion


def thesis_printed(pose, surge, sway, yaw_rate, dt) -> Path:
    """Thesis, table 4.1, as printed: the loop runs over i = k + 1 to k + N and begins with P[t_i], which is not known then.

    The only place it can begin with is the start, so every place and heading comes one step late (E40); each step is that of
    `pivot_path`. Shapes as there.
    """
    return _late(pivot_path(pose, surge, sway, yaw_rate, dt))


def paper_vi_printed(pose, surge, sway, yaw_rate, dt) -> Path:
    """Paper VI, algorithm 2, as printed: that of the thesis, but the lines of the pivot point hold psi_G without a time.

    Read as the start's heading, the pivot point stays ahead in that direction while the hull turns. The path too is a step late.
    """
    surge, sway, yaw_rate = np.broadcast_arrays(*(np.asarray(w, float) for w in (surge, sway, yaw_rate)))
    turn = yaw_rate * dt
    turning = np.abs(turn) > 1e-12
    lever = np.where(turning, -sway / np.where(turning, yaw_rate, 1.0), 0.0)
    turned = np.cumsum(turn, axis=-1) - turn
    about = np.where(turning, lever * (1 - np.exp(1j * turn)), 1j * sway * dt)
    step = surge * dt + about * np.exp(-1j * turned)
    return _late(walk(pose, step, turn, np.stack([surge, sway, yaw_rate], axis=-1), dt))


def paper_v_printed(pose, surge, sway_bow, sway_stern, dt, x_bow: float, x_stern: float) -> Path:
    """Paper V's algorithm as printed: omega = v_2 / dist with dist a length, and midship moves by u dt alone.

    With x_pp = x_2 - v_2 / r the length is |v_2 / r|, so omega is |r| with the sign of v_2: a ship whose pivot point lies ahead of
    the stern turns the wrong way (E41a). The exact pivot point takes the place of the region map.
    """
    surge, sway_bow, sway_stern = np.broadcast_arrays(*(np.asarray(w, float) for w in (surge, sway_bow, sway_stern)))
    sway, yaw_rate = two_station_motion(sway_bow, sway_stern, x_bow, x_stern)
    yaw_rate = np.copysign(yaw_rate, sway_stern)
    turn = yaw_rate * dt
    return walk(pose, surge * dt * np.exp(1j * turn), turn, np.stack([surge, sway, yaw_rate], axis=-1), dt)


def paper_v_corrected(pose, surge, sway_bow, sway_stern, dt, x_bow: float, x_stern: float) -> Path:
    """Paper V's algorithm with r = (v_1 - v_2) / (x_1 - x_2) and midship turned about the pivot point too (E41): first order.

    Its order stays: the hull turns first, then moves by u dt along the new heading. Where the sways are equal the pivot
    point's arc, L (1 - exp(i r dt)) with L = -v / r, becomes the translation v dt.
    """
    surge, sway_bow, sway_stern = np.broadcast_arrays(*(np.asarray(w, float) for w in (surge, sway_bow, sway_stern)))
    sway, yaw_rate = two_station_motion(sway_bow, sway_stern, x_bow, x_stern)
    turn = yaw_rate * dt
    # -v / r (1 - exp(i w)) = i v dt exp(i w / 2) sinc(w / 2): the same arc without the pole at r = 0.
    about = 1j * sway * dt * np.exp(1j * turn / 2) * np.sinc(turn / (2 * np.pi))
    step = about + surge * dt * np.exp(1j * turn)
    return walk(pose, step, turn, np.stack([surge, sway, yaw_rate], axis=-1), dt)


def midpoint_path(pose, surge, sway, yaw_rate, dt) -> Path:
    """Each step moves by (u, v) dt along the heading half way through it: second order, regular at r = 0 (E40)."""
    surge, sway, yaw_rate = np.broadcast_arrays(*(np.asarray(w, float) for w in (surge, sway, yaw_rate)))
    turn = yaw_rate * dt
    step = (surge + 1j * sway) * dt * np.exp(0.5j * turn)
    return walk(pose, step, turn, np.stack([surge, sway, yaw_rate], axis=-1), dt)


def _late(path: Path) -> Path:
    """The path one step late: the start is held for the first step."""

    def held(values):
        return np.concatenate([values[..., :1], values[..., :-1]], axis=-1)

    return replace(path, north=held(path.north), east=held(path.east), heading=held(path.heading))
