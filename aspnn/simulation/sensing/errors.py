"""The errors that instruments have in common: random processes in time, delay, damping, play; steps in time as the voyage's.

Every function draws for all steps of a voyage, so that the rate at which a sensor samples does not move its errors.
"""

import math

import numpy as np
from numba import njit

HOUR = 3600.0  # s


def gauss_markov(rng: np.random.Generator, shape: tuple[int, int], dt: float, deviation, time: float) -> np.ndarray:
    """First-order Gauss-Markov processes (rows, steps) of a stated stationary `deviation` and correlation `time` [s].

    x_k+1 = a x_k + deviation sqrt(1 - a^2) w_k, a = exp(-dt / time), x_0 from the stationary law: exact at any step (paper 000 (42)-
    (43), corrected: E60, where the driving noise was stated and the deviation changed with the step).
    """
    if not np.any(deviation):
        return np.zeros(shape)
    drive = rng.standard_normal(shape)
    drive[:, 1:] *= math.sqrt(-math.expm1(-2 * dt / time))
    return deviation * np.stack([_recursion(math.exp(-dt / time), row) for row in drive])


def bias(rng: np.random.Generator, shape: tuple[int, int], dt: float, deviation: float, walk_1h: float) -> np.ndarray:
    """Biases (rows, steps): a constant of standard `deviation` plus a random walk, which deviates by `walk_1h` after an hour."""
    if deviation == 0 == walk_1h:
        return np.zeros(shape)
    constant = deviation * rng.standard_normal((shape[0], 1))
    steps = rng.standard_normal(shape)
    steps[:, 0] = 0.0
    return constant + walk_1h * math.sqrt(dt / HOUR) * np.cumsum(steps, axis=1)


def spells(rng: np.random.Generator, time: np.ndarray, share: float, mean: float) -> np.ndarray:
    """Which spell each instant lies in, counted from 1; 0 between spells. They take up `share` of the time and last `mean` [s].

    Alternating renewal process with exponential lengths, begun in its stationary state: `mean` in a spell, mean (1 - share) /
    share between two.
    """
    count = np.zeros(len(time), int)
    if share == 0:
        return count
    inside, at, found = rng.random() < share, float(time[0]), 0
    while at <= time[-1]:
        end = at + rng.exponential(mean if inside else mean * (1 - share) / share)
        if inside:
            found += 1
            count[np.searchsorted(time, at) : np.searchsorted(time, end)] = found
        at, inside = end, not inside
    return count


def delayed(values: np.ndarray, time: np.ndarray, delay: float) -> np.ndarray:
    """What a sensor that is `delay` [s] late records at `time` [s]: `values` at time - delay, linearly between steps.

    NaN before it has anything to tell. (The sign is that of instruments.Calibration: a delay that the filters take away again.)
    """
    return values if delay == 0 else np.interp(time - delay, time, values, left=np.nan)


def damped(values: np.ndarray, dt: float, time: float) -> np.ndarray:
    """First-order lag y' = (x - y) / `time` of `values`, settled at the start; exact for a course linear between steps."""
    if time == 0:
        return values
    a = math.exp(-dt / time)
    gain = time * (1 - a) / dt  # of the integral of exp(-s / time) over a step
    x = values - values[0]
    return _recursion(a, (1 - gain) * x + (gain - a) * np.concatenate([[0.0], x[:-1]])) + values[0]


@njit(cache=True, nogil=True)
def _recursion(a: float, drive: np.ndarray) -> np.ndarray:
    """y_k = a y_k-1 + drive_k from rest. (scipy.signal has this too, but takes most of a second to import.)"""
    out = np.empty(len(drive))
    last = 0.0
    for k in range(len(drive)):
        last = a * last + drive[k]
        out[k] = last
    return out


@njit(cache=True, nogil=True)
def play(values: np.ndarray, width: float) -> np.ndarray:
    """What a linkage with `width` of play hands on: it stands still until the drive has taken up the play, centred at the start."""
    told = np.empty_like(values)
    last = values[0]
    for k in range(len(values)):
        last = min(max(last, values[k] - width / 2), values[k] + width / 2)
        told[k] = last
    return told
