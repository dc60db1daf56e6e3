"""Which values a sensor only repeats: fixes that froze, a heading or a rate that sticks. From the past alone.

A coarse sensor repeats its value by nature, a recorder that is quicker than its sensor does too, and a ship at rest may. So
a repetition is held against the resolution that the column has shown, the noise of the sensor, how often it repeated, and
for fixes against the way that the ship has gone since.
"""

import math

import numpy as np
from numba import njit

WINDOW = 10.0  # s before a run of equal values that tell how the sensor was until then
STUCK = 2.0  # s; a heading or rate that repeats longer may be stuck
CHANCE = 1e-6  # a run that fresh values make with less than this probability is not fresh
FEWEST = (5, 8)  # values that differ before a receiver, and another sensor, is judged
CLEAR = 3.0  # noise in steps of the grid below which a sensor counts as coarse
WHITE = 0.2467  # minus the median product of two normal values of unit variance that correlate by -2/3
LONGEST = 20  # repetitions that count; so is a run's beginning all that the next block of a log must know
DIGITS = 9  # decimals from which on a column counts as continuous
SCALES = (1.0, 60.0, math.pi / 180)  # recorders round degrees, minutes, or radians
STRETCH = 256  # rows after which a continuous column has mostly shown itself
COARSE = (0, 0, 0, 0)  # nothing shown yet
CIRCLE = 360.0  # deg


def _decimals(values, scale: float, shown: int) -> np.ndarray:
    """Decimals, DIGITS at most, that `values` times `scale` have needed so far; NaN needs none."""
    if shown >= DIGITS or len(values) == 0:
        return np.full(len(values), shown)
    v = np.where(np.isnan(values), 0.0, values * scale)
    need = np.full(len(v), DIGITS)
    for k in range(DIGITS - 1, -1, -1):
        rounding = 8 * np.finfo(float).eps * np.maximum(np.abs(v), CIRCLE * scale) * 10.0**k  # whole turns are cut off
        need[np.abs(v * 10.0**k - np.rint(v * 10.0**k)) <= rounding] = k
    return np.maximum(np.maximum.accumulate(need), shown)


def resolution(values, shown: tuple[int, ...] = COARSE) -> tuple[np.ndarray, tuple[int, ...]]:
    """The step on which all `values` (n) [deg] so far lie, at each row (n), in their unit; and what has been shown at the end.

    The coarsest grid of whole 10^-k deg, minutes or rad that fits; the spacing of single precision if all are that; 0 for a
    continuous column. `shown` is that of the rows before.
    """
    first = [_decimals(values[:STRETCH], s, k) for s, k in zip(SCALES, shown[:3], strict=True)]
    rest = [_decimals(values[STRETCH:], s, int(f[-1])) for s, f in zip(SCALES, first, strict=True)]
    needs = [np.concatenate(pair) for pair in zip(first, rest, strict=True)]
    steps = [np.where(n < DIGITS, 10.0**-n / s, 0.0) for n, s in zip(needs, SCALES, strict=True)]
    single = values.astype(np.float32)
    doubles = np.maximum(np.maximum.accumulate((single != values) & ~np.isnan(values)), shown[3] > 0)
    steps.append(np.where(doubles | np.isnan(values), 0.0, np.spacing(np.abs(single)).astype(float)))
    return np.max(steps, axis=0), (*(int(n[-1]) for n in needs), int(doubles[-1]))


@njit(cache=True, error_model="numpy")
def _between(a, b, period):
    return (b - a + period / 2) % period - period / 2 if period > 0 else b - a


@njit(cache=True, error_model="numpy")
def _runs(t, p, period, begin, count, differ, share, speed, noise):
    """Fill what `runs` returns for known values p (n, a) at t (n)."""
    n, axes = p.shape
    kept = np.empty(n, np.int64)
    residual = np.empty(n)
    for i in range(n):
        begin[i] = i
        same = i > 0
        for a in range(axes):
            same = same and p[i, a] == p[i - 1, a]
        if not same:
            continue
        b, count[i] = begin[i - 1], count[i - 1] + 1
        begin[i] = b
        if count[i] > 1:
            differ[i], share[i] = differ[i - 1], share[i - 1]
            speed[i], noise[i] = speed[i - 1], noise[i - 1]
            continue
        first = b
        while first > 0 and t[first - 1] >= t[b] - WINDOW:
            first -= 1
        m = 0  # values that differ from their predecessor
        for j in range(first, b + 1):
            new = j == first
            for a in range(axes):
                new = new or p[j, a] != p[j - 1, a]
            if new:
                kept[m] = j
                m += 1
        differ[i] = m
        if m < FEWEST[0]:
            continue
        share[i] = 1 - m / (b + 1 - first)
        middle = (t[first] + t[b]) / 2
        for a in range(axes):
            early_t, early_p, late_t, late_p, early = 0.0, 0.0, 0.0, 0.0, 0
            for c in range(m):
                j = kept[c]
                if t[j] < middle:
                    early_t, early_p, early = early_t + t[j] - t[b], early_p + p[j, a] - p[b, a], early + 1
                else:
                    late_t, late_p = late_t + t[j] - t[b], late_p + p[j, a] - p[b, a]
            late = m - early
            speed[i, a] = (late_p / late - early_p / early) / (late_t / late - early_t / early)
            for c in range(m - 2):
                j, k, o = kept[c], kept[c + 1], kept[c + 2]
                w = (t[k] - t[j]) / (t[o] - t[j])
                bent = (1 - w) * _between(p[j, a], p[k, a], period) - w * _between(p[k, a], p[o, a], period)
                residual[c] = bent / math.sqrt(1 + w * w + (1 - w) ** 2)
            for c in range(m - 3):
                residual[c] *= residual[c + 1]
            noise[i, a] = math.sqrt(max(-np.median(residual[: m - 3]) / WHITE, 0.0))


def runs(time, values, period: float = 0.0):
    """How `values` (n, a) repeat: per row begin, count, differ, share (n), speed, noise (n, a); nothing at rows without value.

    A run is a stretch of known rows equal to the last bit: the row where it began, and how often it has repeated by now. Of
    the WINDOW seconds before a run: how many values `differ` from the one before, the `share` that repeated, the mean `speed`
    per second (from half to half), and the standard deviation of the white `noise`, by how far each different value lies off
    the line through its neighbours: of white noise one such residual and the next correlate by -2/3, of a ship that begins
    or ends to turn by +1. The median of their products is not moved by single wild values. `period` of angles.
    """
    n, axes = values.shape
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    known = len(rows)
    found = (
        *(np.zeros(known, np.int64), np.zeros(known, np.int64), np.zeros(known, np.int64), np.zeros(known)),
        *(np.zeros((known, axes)), np.zeros((known, axes))),
    )
    _runs(time[rows], np.ascontiguousarray(values[rows]), period, *found)
    whole = []
    for part in (rows[found[0]], *found[1:]):
        full = np.zeros((n, *part.shape[1:]), part.dtype)
        full[rows] = part
        whole.append(full)
    return whole


def remembered(time, begin, count, known) -> np.ndarray:
    """Which rows (n) the next block of the log must see to go on with the run that the last known row stands in."""
    rows = np.flatnonzero(known)
    if len(rows) == 0:
        return np.zeros(len(time), bool)
    start = time[begin[rows[-1]]]
    return (time >= start - WINDOW) & ((time <= start) | (known & (count <= LONGEST) & (count > 0) & (time > start)))


def _by_chance(step, noise) -> np.ndarray:
    """Probability that a fresh value with white `noise` (standard deviation) repeats its predecessor on a grid of `step`.

    The difference has the density 1 / (2 sqrt(pi) noise) at zero. Without noise: 1, which is never held against a sensor.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(noise > 0, np.minimum(step / (2 * math.sqrt(math.pi) * noise), 1.0), 1.0)


def frozen(elapsed, run, step, threshold: float) -> np.ndarray:
    """Which fixes repeat their predecessor although the ship moved before: faster than `threshold` [m/s], and either

    further since, `elapsed` [s] ago, than two steps of the recorder's grid `step` (n, 2) [m] and six deviations of a difference, or
    more often than chance makes the noise of the receiver repeat on that grid. `run` is what `runs` tells of the fixes.
    """
    _, count, differ, share, speed, noise = run
    way = np.abs(speed) * elapsed[:, None]
    beyond = (way > 2 * step + 6 * math.sqrt(2) * np.maximum(noise - step / 2, 0)).any(axis=1)  # rounding is no noise
    # On a grid about as coarse as the noise, fixes repeat more often than white noise would.
    coarse = (noise <= CLEAR * step).any(axis=1)
    chance = np.maximum(_by_chance(step, noise).prod(axis=1), np.where(coarse, share, 0.0))
    moved = np.hypot(*speed.T) > threshold
    return (count > 0) & (differ >= FEWEST[0]) & moved & (beyond | (chance ** np.minimum(count, LONGEST) < CHANCE))


def stuck(elapsed, run, step) -> np.ndarray:
    """Which values repeat for longer than STUCK seconds though the sensor changed at nearly every sample until then.

    `elapsed` [s] since the run of equal values began, `run` as of `runs`, `step` (n) the resolution. A sensor that the recorder
    repeats does so with more than the probability CHANCE; one whose noise is below CLEAR steps is coarse, and may.
    """
    _, count, differ, share, _, noise = run
    chance = np.maximum(_by_chance(step, noise[:, 0]), share)
    judged = (differ >= FEWEST[1]) & (noise[:, 0] > CLEAR * step)
    return (elapsed > STUCK) & judged & (chance ** np.minimum(count, LONGEST) < CHANCE)
