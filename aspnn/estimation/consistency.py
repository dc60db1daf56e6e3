"""Whether a filter is as good as it says: statistics of innovations and errors, with the bounds that belong to them.

Paper II judges by the normalised innovation squared (25), its autocorrelation (26) and the condition of S (23); the bounds,
the factor and the scaling are corrected here (E29, E30, E31). Everything counts present values only: a missing
measurement is NaN and neither inside nor outside.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from aspnn.estimation.compiled import Run
from aspnn.estimation.problem import Problem

LEVEL = 0.95  # of all bounds, two-sided
NORMAL = 1.959964  # two-sided 95 % of the normal distribution
CONDITION = 1e-8  # scaled reciprocal condition below which S counts as singular (E31; the paper's 1e-10 measures units)
LAGS = 50  # of the time-averaged autocorrelation, and of the standard error of a mean


@dataclass(frozen=True)
class Shares:
    """Shares (0 to 1) of the present values that lie inside, below and above their bounds, and how many were present."""

    inside: float
    below: float
    above: float
    count: int


def average_bounds(dof, runs: int = 1, level: float = LEVEL) -> tuple[np.ndarray, np.ndarray]:
    """Two-sided bounds of the average of `runs` independent NIS or NEES, each with `dof` (...) degrees of freedom.

    N times the average is chi-square with N m degrees of freedom, so the bounds are chi2_{N m} / N (Paper II (25), corrected:
    E29; N = 50, m = 6: 5.078 and 6.997). `dof` may differ by epoch; where it is 0 the bounds are NaN (E32: each sensor by its own).
    """
    total, place = np.unique(np.asarray(dof, float) * runs, return_inverse=True)  # few differ, and quantiles are slow
    known, tail = total > 0, (1 - level) / 2
    safe = np.where(known, total, 1.0)
    low, high = (np.where(known, chdtri(safe, beyond) / runs, np.nan)[place] for beyond in (1 - tail, tail))
    return low, high


def shares(values, low, high) -> Shares:
    """Shares of `values` (any shape) inside, below and above `low` and `high` (broadcast); NaN values do not count."""
    values, low, high = np.broadcast_arrays(*(np.asarray(a, float) for a in (values, low, high)))
    known = ~np.isnan(values) & ~np.isnan(low) & ~np.isnan(high)
    count = int(known.sum())
    if count == 0:
        return Shares(np.nan, np.nan, np.nan, 0)
    below, above = float((values < low)[known].mean()), float((values > high)[known].mean())
    return Shares(1.0 - below - above, below, above, count)


def nees(error, covariance) -> np.ndarray:
    """Normalised estimation error squared e' P^-1 e (...) of errors (..., d) with covariances (..., d, d).

    Chi-square with d degrees of freedom at each epoch; NaN where P is not positive definite or not finite. Errors of
    successive epochs are correlated over the memory of the filter (seconds): an average over the time of one run has
    far fewer degrees of freedom than epochs times d, only averages over independent runs have `average_bounds`.
    """
    error = np.asarray(error, float)
    L = _cholesky(np.asarray(covariance, float))
    y = np.moveaxis(error, -1, 0).copy()
    for i in range(len(y)):
        y[i] = (y[i] - (L[i, :i] * y[:i]).sum(0)) / L[i, i]
    return (y**2).sum(0)


def lag_products(whitened) -> np.ndarray:
    """The sums that `lag_correlation` needs, over the components of whitened innovations (..., n, m): (4, ..., n - 1).

    Products of successive epochs, squares of the first and of the second, and the number of pairs; a component that is
    NaN at either epoch does not count. Sums over runs may be taken before the correlation.
    """
    whitened = np.asarray(whitened, float)
    first, second = whitened[..., :-1, :], whitened[..., 1:, :]
    both = np.isfinite(first) & np.isfinite(second)
    first, second = np.where(both, first, 0.0), np.where(both, second, 0.0)
    return np.stack([(first * second).sum(-1), (first**2).sum(-1), (second**2).sum(-1), both.sum(-1)])


def lag_correlation(products, runs: int) -> np.ndarray:
    """Average autocorrelation (n - 1) of successive epochs from `lag_products` summed over `runs` (4, n - 1).

    rho = sqrt(m) sum y_k' y_{k+1} / sqrt(sum y_k' y_k sum y_{k+1}' y_{k+1}) with y = L^-1 e, S = L L', m the components per run
    (Paper II (26), corrected: E30, which prints 1/sqrt(m) and raw units, so that white noise of six components spreads by
    0.167/sqrt(N) and anything passes). White innovations spread by 1/sqrt(N): 95 % within +-1.96/sqrt(N). NaN without pairs.
    """
    num, one, two, pairs = np.asarray(products, float)
    known = (one > 0) & (two > 0)
    return np.where(known, np.sqrt(pairs / runs) * num / np.sqrt(np.where(known, one * two, 1.0)), np.nan)


def lag_one(whitened) -> np.ndarray:
    """Average autocorrelation (n - 1) of whitened innovations (N runs, n, m) between successive epochs (E30)."""
    whitened = np.asarray(whitened, float)
    return lag_correlation(lag_products(whitened).sum(axis=1), len(whitened))


def lag_bound(runs: int) -> float:
    """Two-sided 95 % bound 1.96/sqrt(N) of `lag_one` over N runs, and of `autocorrelation` over N samples."""
    return NORMAL / np.sqrt(runs) if runs else np.nan


def autocorrelation(series, lags: int = LAGS) -> np.ndarray:
    """Autocorrelation (lags, c) at lags 1 to `lags` of one run of series (n, c), about zero, averaged over time.

    rho_l = mean of y_k y_{k+l} over mean of y_k^2, over the pairs that are present. Of n white samples 95 % lie within
    +-1.96/sqrt(n) at each lag. NaN where no pair is that far apart.
    """
    series = np.asarray(series, float)
    known = np.isfinite(series)
    filled = np.where(known, series, 0.0)
    power = (filled**2).sum(0) / np.maximum(known.sum(0), 1)
    found = np.full((lags, series.shape[1]), np.nan)
    for lag in range(1, min(lags, len(series) - 1) + 1):
        pairs = (known[lag:] & known[:-lag]).sum(0)
        total = (filled[lag:] * filled[:-lag]).sum(0)
        good = (pairs > 0) & (power > 0)
        found[lag - 1] = np.where(good, total / np.where(good, pairs * power, 1.0), np.nan)
    return found


def mean_error(series, lags: int = LAGS) -> tuple[np.ndarray, np.ndarray]:
    """Mean (c) of series (n, c) and its standard error (c), widened for the series' own autocorrelation.

    The variance of the mean is s^2 (1 + 2 sum (1 - l/(lags + 1)) rho_l) / n (Newey and West, with Bartlett's weights), never
    taken below that of white noise: a filter that overcorrects tells nothing more of the mean.
    """
    series = np.asarray(series, float)
    count = np.isfinite(series).sum(0)
    mean = np.nansum(series, axis=0) / np.where(count, count, np.nan)
    centred = series - mean
    weights = 1 - np.arange(1, lags + 1) / (lags + 1)
    factor = 1 + 2 * np.nansum(weights[:, None] * autocorrelation(centred, lags), axis=0)
    square = np.nansum(centred**2, axis=0) / np.where(count, count, np.nan)
    return mean, np.sqrt(square * np.maximum(factor, 1.0) / np.where(count, count, np.nan))


def _cholesky(S: np.ndarray) -> np.ndarray:
    """Lower L with L L' = S of whole stacks (..., m, m) at once, its axes first (m, m, ...), which is what makes it quick.

    NaN throughout where S is not positive definite.
    """
    S = np.ascontiguousarray(np.moveaxis(S, (-2, -1), (0, 1)))
    L = np.zeros_like(S)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for j in range(len(S)):
            for i in range(j, len(S)):
                L[i, j] = S[i, j] - (L[i, :j] * L[j, :j]).sum(0)
            L[j:, j] /= np.sqrt(np.where(L[j, j] > 0, L[j, j], np.nan))
    L[:, :, ~np.isfinite(L).all(axis=(0, 1))] = np.nan
    return L


def scaled_rcond(S) -> np.ndarray:
    """Reciprocal condition number (...) in the 1-norm of D^-1/2 S D^-1/2 with D = diag S, of matrices (..., m, m).

    Paper II (23-24) takes that of S itself, which with the sensors of the thesis measures units: R alone gives 3e-10 (E31).
    With a unit diagonal it is 1 for independent sensors, whatever their units, and small only where rows repeat each
    other. 0 where S is not finite or not positive definite.
    """
    S = np.asarray(S, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(np.einsum("...ii->...i", S))
        C = S / (root[..., :, None] * root[..., None, :])
    L = _cholesky(C)
    C, m = np.moveaxis(C, (-2, -1), (0, 1)), S.shape[-1]
    inverse = np.zeros_like(L)  # of L
    for i in range(m):
        inverse[i, i] = 1 / L[i, i]
        for j in range(i):
            inverse[i, j] = -(L[i, j:i] * inverse[j:i, j]).sum(0) / L[i, i]
    norm = np.zeros((m, *L.shape[2:]))  # of the columns of C^-1
    for i in range(m):
        for j in range(m):
            norm[j] += np.abs((inverse[max(i, j) :, i] * inverse[max(i, j) :, j]).sum(0))
    return np.nan_to_num(1 / (np.abs(C).sum(0).max(0) * norm.max(0)), nan=0.0)


def innovation_covariance(problem: Problem, run: Run) -> np.ndarray:
    """Joint covariance S = H P H' + R (n, 2b, 2b) of all b blocks of each epoch of a linear problem, P the predicted one.

    A row without a value has variance 1 and no covariance, which changes neither condition number nor definiteness.
    """
    n, blocks, _, d = problem.H.shape
    missing = np.isnan(problem.z).reshape(n, 2 * blocks)
    H = np.where(missing[..., None], 0.0, problem.H.reshape(n, 2 * blocks, d))
    S = H @ run.predicted_covariance @ np.swapaxes(H, -1, -2)
    for b in range(blocks):
        S[:, 2 * b : 2 * b + 2, 2 * b : 2 * b + 2] += problem.R[:, b]
    apart = missing[:, :, None] | missing[:, None, :]
    return np.where(apart, np.eye(2 * blocks), S)
