"""Fitting a calibration: the model's error on some voyages, conformal quantiles on others. Arrays in, Calibration out."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from aspnn.prediction.uncertainty import FULL, LEVELS, POPULATIONS, STEERED, Calibration
from aspnn.schema import InputError

ROUNDS = 10  # of reweighting
TAILS = 3.0  # standard deviations at which single errors are cut when correlations are taken
VOYAGES = 6  # at least: two shape the regions, four scale them


def fit_variance(errors: np.ndarray, carried: np.ndarray, drivers: np.ndarray) -> np.ndarray:
    """Coefficients (knots, 3, 4) of the model's variances, none negative.

    `errors` (n, knots, 3) in the axes of `uncertainty.axes`, `carried` (n, knots, 3) variances by the filter's errors in
    the same axes, `drivers` (n, knots, 4). Squares of errors minus the carried variance are regressed on the drivers, by
    non-negative least squares with weights 1 / variance, reweighted: the scores of a Gaussian likelihood.
    """
    from scipy.optimize import nnls

    knots = errors.shape[1]
    found = np.zeros((knots, 3, drivers.shape[-1]))
    for k in range(knots):
        size = np.sqrt((drivers[:, k] ** 2).mean(axis=0))
        used = size > 0  # at the start nothing has turned and no speed is lost
        columns = drivers[:, k, used] / size[used]
        for a in range(3):
            squares, known = errors[:, k, a] ** 2, carried[:, k, a]
            total = np.full(len(squares), squares.mean() + known.mean())
            for _ in range(ROUNDS):
                solution, _ = nnls(columns / total[:, None], (squares - known) / total)
                total = known + columns @ solution
                if not (total > 0).all():
                    raise InputError(
                        "calibration: the states have no standard deviations; filter the logs again with this version"
                    )
            found[k, a, used] = solution / size[used]
    return found


def fit_correlation(errors: np.ndarray, carried: np.ndarray, drivers: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Correlations (knots, 3, 3) of the errors over their standard deviations, single errors cut at three of them."""
    total = carried + np.einsum("tak,ntk->nta", variance, drivers)
    z = np.clip(errors / np.sqrt(total), -TAILS, TAILS)
    moments = np.einsum("nta,ntb->tab", z, z)
    sd = np.sqrt(np.einsum("taa->ta", moments))
    return moments / (sd[:, :, None] * sd[:, None, :])


def scores(errors: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far off in standard deviations, position and heading (n, knots), by `covariance` (n, knots, 3, 3)."""
    place = errors[..., :2]
    solved = np.linalg.solve(covariance[..., :2, :2], place[..., None])[..., 0]
    return np.sqrt((place * solved).sum(-1)), np.abs(errors[..., 2]) / np.sqrt(covariance[..., 2, 2])


def conformal(scores: np.ndarray, levels=LEVELS) -> np.ndarray:
    """Factors (knots, levels) that hold a share of at least `levels` of new scores: (n, knots) -> quantiles.

    The ceil((n + 1) p)-th smallest of n scores holds a new, exchangeable one with probability p or more (Vovk, Gammerman
    and Shafer 2005; recalled); NaN where n is too small for that. Windows of one voyage resemble each other, which leaves the mean share
    as it is and makes it vary more: many voyages matter, not many windows.
    """
    n, knots = scores.shape
    ordered = np.sort(scores, axis=0)
    ranks = [math.ceil((n + 1) * p - 1e-9) for p in levels]
    return np.stack([ordered[r - 1] if r <= n else np.full(knots, np.nan) for r in ranks], axis=-1)


def with_factors(
    calibration: Calibration,
    position: np.ndarray,
    heading: np.ndarray,
    populations: np.ndarray,
    voyages: np.ndarray,
    facts: dict[str, Any],
) -> Calibration:
    """The calibration with the factors of each population, from scores (n, knots) and the windows' populations, voyages.

    A population with too few windows for 95 % has none. Raises InputError when no population has enough.
    """
    places, headings, counts = {}, {}, {}
    for name in (*POPULATIONS, *([STEERED] if STEERED in populations else [])):
        of = populations == name
        counts[name] = {"windows": int(of.sum()), "voyages": len(np.unique(voyages[of]))}
        factors = conformal(position[of])
        if np.isfinite(factors[:, FULL]).all():
            places[name], headings[name] = factors, conformal(heading[of])
    if not places:
        raise InputError(
            "calibration: no population has the 19 windows that 95 % regions take; give more or longer logs"
        )
    return replace(calibration, position=places, heading=headings, facts={**facts, "populations": counts})
