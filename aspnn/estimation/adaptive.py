"""Adaptive process noise (Paper IV): a factor on Q that grows with the yaw-rate innovation of CAA, learnt once from simulated logs.

A new rudder order breaks the models' assumption of constant acceleration, and shows first in the innovation of the yaw rate.
CAA runs first, so the step that ends at an epoch may use the innovation of that epoch, never a later one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aspnn.estimation.problem import ModelProblem, Problem
from aspnn.schema import InputError

KNOTS = 300  # of the tabulated curve, as many as in the paper's figure 10


@dataclass(frozen=True)
class QFactor:
    """The factor alpha on the process noise by the level |y_r| / sqrt(S_rr) of the yaw-rate innovation (E37).

    `level` (k) rising and `factor` (k), at least 1, as a table between whose points a straight line is drawn. Beyond the
    last level the last factor holds: a Gaussian process would fall back to its prior there.
    """

    level: np.ndarray
    factor: np.ndarray

    @classmethod
    def fit(cls, levels, factors, seed: int) -> "QFactor":
        """Gaussian process regression on pairs of a level and its best factor, tabulated.

        Kernel theta_1 exp(-|x - x'|^2 / (2 theta_2)) + theta_3 delta (Paper IV 8), theta by maximum likelihood. The process has
        zero mean, so it is alpha - 1 that is regressed and the result is kept within 1 and the largest given factor: without
        that the process noise would vanish where there are no data (E37). `seed` draws the starts of the search for
        theta. Raises InputError for pairs that do not match or factors below 1.
        """
        import warnings

        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

        x, alpha = np.asarray(levels, float), np.asarray(factors, float)
        if x.ndim != 1 or x.shape != alpha.shape or len(x) < 2:
            raise InputError(f"QFactor: {x.size} levels and {alpha.size} factors; give as many of both, at least two")
        if not (np.isfinite(x).all() and (x >= 0).all() and np.isfinite(alpha).all() and (alpha >= 1).all()):
            raise InputError("QFactor: levels must be finite and not negative, factors finite and at least 1")
        level = np.linspace(0.0, x.max(), KNOTS)
        if alpha.max() == 1.0 or x.max() == 0.0:
            return cls(np.zeros(1), np.full(1, alpha.mean()))
        width, scale = x.max(), float(np.mean((alpha - 1) ** 2))
        kernel = ConstantKernel(scale, (1e-2 * scale, 1e2 * scale)) * RBF(0.2 * width, (1e-2 * width, 1e1 * width))
        kernel += WhiteKernel(0.1 * scale, (1e-4 * scale, 1e1 * scale))
        process = GaussianProcessRegressor(kernel, n_restarts_optimizer=3, random_state=seed)
        with (
            warnings.catch_warnings()
        ):  # a hyperparameter at the bound of its search is no fault: flat data have no length
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit(x[:, None], alpha - 1)
        return cls(level, np.clip(1 + process.predict(level[:, None]), 1.0, alpha.max()))

    def factors(self, whitened) -> np.ndarray:
        """Factor (n) on the process noise of the step that ends at each epoch, from the whitened yaw-rate innovation (n) there.

        That of CAA is `run.whitened[:, 1, 0]`. Where it is missing (NaN) nothing is known of a new order: 1.
        """
        level = np.abs(np.asarray(whitened, float))
        return np.where(np.isfinite(level), np.interp(level, self.level, self.factor), 1.0)


def adapted(problem: Problem | ModelProblem, factors: np.ndarray) -> Problem | ModelProblem:
    """The problem with the process noise of the step that ends at each epoch multiplied by `factors` (n)."""
    if isinstance(problem, Problem):
        return replace(problem, Q=problem.Q * factors[:, None, None])
    return replace(problem, inflation=problem.inflation * factors)


def best_factors(
    levels: Sequence[np.ndarray],
    edges: Sequence[float],
    candidates: Sequence[float],
    cost: Callable[[list[np.ndarray]], float],
) -> np.ndarray:
    """The factor (g) for each group of level that makes `cost` least: the paper's "multiple offline trials".

    `levels` holds one array per log; group 0 lies below edges[0], group g from edges[g - 1] on. `cost` takes the factors of
    every epoch of every log, and tells an error against the truth, or minus the log-likelihood. The groups are tried one
    after the other from the highest, the others held at what they have, twice round; `candidates` include 1.
    """
    groups = [group_of(level, edges) for level in levels]
    best = np.ones(len(edges) + 1)
    for _ in range(2):
        for g in range(len(best) - 1, -1, -1):
            if not any((group == g).any() for group in groups):
                continue
            tries = [np.where(np.arange(len(best)) == g, alpha, best) for alpha in candidates]
            best = min(tries, key=lambda factors: cost([factors[group] for group in groups]))
    return best


def group_of(level, edges: Sequence[float]) -> np.ndarray:
    """Number of the group (n) of each level; a missing one belongs to the lowest."""
    return np.searchsorted(np.asarray(edges, float), np.nan_to_num(np.asarray(level, float), nan=0.0), side="right")


def training_pairs(
    levels: Sequence[np.ndarray], edges: Sequence[float], best, count: int, spread: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Levels and factors (about `count` each) drawn at random from the groups, as the paper draws its set D.

    Half of the pairs are shared out evenly, half by the width of the groups. White noise of `spread` times the factor
    is added to each factor, which never falls below 1.
    """
    rng = np.random.default_rng(seed)
    level = np.concatenate([np.asarray(one, float) for one in levels])
    level = level[np.isfinite(level)]
    members = [level[group_of(level, edges) == g] for g in range(len(edges) + 1)]
    widths = np.array([np.ptp(group) if len(group) else 0.0 for group in members])
    filled = np.array([len(group) > 0 for group in members])
    share = 0.5 * filled / filled.sum() + 0.5 * widths / widths.sum()
    x, alpha = [], []
    for group, factor, part in zip(members, best, share, strict=True):
        chosen = rng.choice(group, min(len(group), round(count * part)), replace=False) if len(group) else group
        x.append(chosen)
        alpha.append(np.maximum(factor * (1 + spread * rng.standard_normal(len(chosen))), 1.0))
    return np.concatenate(x), np.concatenate(alpha)
