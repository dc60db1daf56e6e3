"""Angles on the circle. All in radians; heading and course clockwise from north."""

import numpy as np


def wrap(angle):
    """Smallest signed angle equivalent to `angle` [rad], in [-pi, pi). Any shape (erratum E28: mod(x + pi, 2 pi) - pi)."""
    wrapped = np.mod(np.asarray(angle, dtype=float) + np.pi, 2 * np.pi) - np.pi
    return wrapped - 2 * np.pi * (wrapped >= np.pi)  # mod of a tiny negative number rounds up to 2 pi


def compass(angle):
    """Angle [rad] as a bearing in [0, 2 pi). Any shape."""
    bearing = np.mod(np.asarray(angle, dtype=float), 2 * np.pi)
    return bearing * (bearing < 2 * np.pi)  # mod of a tiny negative number rounds up to 2 pi


def difference(a, b):
    """Smallest signed angle a - b [rad], in [-pi, pi): positive when a lies clockwise of b."""
    return wrap(np.asarray(a, dtype=float) - np.asarray(b, dtype=float))


def circular_mean(angles, axis=None):
    """Mean direction [rad] of `angles` along `axis`, in (-pi, pi] (erratum E25: never the arithmetic mean)."""
    return np.angle(np.mean(np.exp(1j * np.asarray(angles, dtype=float)), axis=axis))


def unwrap(angles):
    """Continuous angle [rad] along the first axis; NaN samples are passed over and stay NaN."""
    angles = np.array(angles, dtype=float)
    known = np.isfinite(angles)
    if angles.ndim != 1:
        raise ValueError("unwrap takes one series of angles")
    angles[known] = np.unwrap(angles[known])
    return angles
