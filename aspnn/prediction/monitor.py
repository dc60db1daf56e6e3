"""Does the model fit this ship today? Predictions that have come to their end, held against where the ship went.

From the states of one and two horizons ago the model runs on again, under the orders that were in force since and in the current that
is known now, and its errors are measured in the standard deviations that regions go by. Where the calibration holds, the
mean of their squares is one at every time from the start. In wind that the network does not know, in shallow water or in
another loading it is more, and more so the later; by that much the covariance of the prediction that begins now is widened.
Depends on orders, records and learning.
"""

from typing import NamedTuple

import numpy as np

from aspnn.angles import difference
from aspnn.learning.features import broken
from aspnn.learning.windows import WindowSpec, plans_sailed
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.records import States

AGES = (1.0, 2.0)  # horizons ago
MARKS = (1 / 3, 2 / 3, 1.0)  # of the horizon, evenly, where errors are measured
# Squares that a fifth of the starts in calibration exceed are what chance alone makes: the variance is left as it is.
USUAL = 0.8
# Each unit of square beyond adds so much to the variance. More than one, since few numbers tell: (2.45 / 1.96)^2 = 1.56 is the
# square of Student's over the Gaussian quantile at 95 % for the six of two predictions. In simulated winds up to 10 m/s that the
# network did not know steady 95 % regions held .90 at 90 s with it, .87 with 1; in calm their area grew by as much with either.
EXCESS = 1.5
ALARM = 0.99  # share of the starts in calibration that count as fitting


class Ended(NamedTuple):
    """Predictions that ended no later than the starts they are to judge: `start` (m,) is the place of the start among n,
    `rows` (m,) of the states where each began, `plans` what was ordered from there on."""

    start: np.ndarray
    rows: np.ndarray
    plans: tuple[Plan, ...]


def ended(states: States, rows: np.ndarray, spec: WindowSpec) -> Ended:
    """The predictions of AGES before each of `rows` (n,); none where the states do not reach back so far or are broken there."""
    rows, time = np.asarray(rows, int), states["time_s"]
    unusable = broken(states, spec.read, spec.period)
    of: list[int] = []
    begun: list[int] = []
    for age in AGES:
        # Never the epoch after: a prediction that began there would end after the start.
        begins = np.searchsorted(time, time[rows] - age * spec.horizon + 1e-6, side="right") - 1
        first = np.searchsorted(time, time[np.maximum(begins, 0)] - spec.history - 1e-6)
        reach = time[rows] - age * spec.horizon - spec.period * (spec.history_steps - 1) >= time[0] - 1e-6
        known = np.flatnonzero(reach & (begins >= 0) & (unusable[rows + 1] == unusable[first]))
        of += known.tolist()
        begun += begins[known].tolist()
    plans = tuple(plans_sailed(states, time[np.array(begun, int)], spec.horizon, spec.forcings))
    return Ended(np.array(of, int), np.array(begun, int), plans)


def marks(time: np.ndarray) -> np.ndarray:
    """The places of MARKS among the instants `time` (steps,) of a path."""
    return np.array([int(np.argmin(np.abs(time - mark * time[-1]))) for mark in MARKS])


def errors(found: Ended, path: Path, states: States) -> tuple[np.ndarray, np.ndarray]:
    """Errors (m, MARKS, 3) of ended predictions `path` (m, steps) against the states, and the variances of these.

    Of north, east [m] and heading [rad]. The states are the filter's, known at the start that is judged.
    """
    time, columns = states["time_s"], marks(path.time)
    at = time[found.rows][:, None] + path.time[columns]
    names = ("north_m", "east_m", "heading_rad")
    north, east, heading = (np.interp(at, time, states[k]) for k in names)
    off = [path.north[:, columns] - north, path.east[:, columns] - east, difference(path.heading[:, columns], heading)]
    own = [np.interp(at, time, states[f"{k}_sd"]) ** 2 for k in names]
    return np.array(off).transpose(1, 2, 0), np.array(own).transpose(1, 2, 0)


def misfit(start: np.ndarray, off: np.ndarray, own: np.ndarray, covariance: np.ndarray, count: int) -> np.ndarray:
    """Mean squares (count, MARKS, 2) of the errors `off` (m, MARKS, 3) of each start, in standard deviations.

    `start` (m,) is that of `Ended`. With C the sum of the prediction's `covariance` (m, MARKS, 3, 3) and the variances `own`
    of the states, first e^T C^-1 e / 3 of all numbers, then that of the heading alone, which a place far off would hide: their
    means are one where C is right. NaN for a start that nothing judges.
    """
    total = covariance + own[..., None] * np.eye(3)
    whole = np.einsum("mta,mta->mt", off, np.linalg.solve(total, off[..., None])[..., 0]) / 3
    square = np.stack([whole, off[..., 2] ** 2 / total[..., 2, 2]], axis=-1)
    sums, have = np.zeros((count, len(MARKS), 2)), np.zeros((count, 1, 1))
    np.add.at(sums, start, square)
    np.add.at(have, start, 1.0)
    return np.divide(sums, have, out=np.full_like(sums, np.nan), where=have > 0)


def overall(square: np.ndarray) -> np.ndarray:
    """One number (n,) of a misfit (n, MARKS, 2): how many standard deviations the model was off, root of the mean square."""
    return np.sqrt(square[..., 0].mean(axis=-1))


def usual_fit(square: np.ndarray) -> tuple[np.ndarray, float]:
    """What is usual, from misfits (n, MARKS, 2) where the model fits: squares (MARKS, 2), and the overall misfit that is the limit.

    One start in five has larger squares, one in a hundred a misfit beyond the limit; NaN (none) where nothing was judged.
    """
    known = square[np.isfinite(square).all(axis=(1, 2))]
    if not len(known):
        return np.ones((len(MARKS), 2)), float("nan")
    return np.quantile(known, USUAL, axis=0), float(np.quantile(overall(known), ALARM))


def widening(square: np.ndarray, usual: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Factors (n, steps, 3) on the standard deviations of north, east and heading at `time` (steps,) [s] after the start.

    From misfits (n, MARKS, 2); one where they are unknown. A variance becomes one and EXCESS times what its square is beyond
    the usual, at each of MARKS, in between linear, from one at the start; the heading's that of the larger excess.
    """
    more = EXCESS * np.maximum(np.nan_to_num(square) - usual, 0.0)
    more = np.maximum.accumulate(more, axis=-1)[..., [0, 0, 1]]
    knots = np.concatenate([np.zeros((len(more), 1, 3)), more], axis=1)
    lower = np.minimum((time / time[-1] * len(MARKS)).astype(int), len(MARKS) - 1)
    part = (time / time[-1] * len(MARKS) - lower)[:, None]
    return np.sqrt(1 + knots[:, lower] * (1 - part) + knots[:, lower + 1] * part)
