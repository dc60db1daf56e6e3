"""The compiled engine: Kalman filters, linear, extended and unscented, and their Rauch-Tung-Striebel smoother.

All take a problem and return arrays; nothing is kept between calls. The loops are in `engine`.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from aspnn.estimation.engine import FILTERS, rts
from aspnn.estimation.kernels import LINEAR
from aspnn.estimation.problem import MISSING, Carry, ModelProblem, Problem


@dataclass(frozen=True)
class Run:
    """What a filter makes of a problem of n epochs, d states and b measurement blocks.

    Means (n, d) and covariances (n, d, d), before (`predicted`) and after (`mean`, `covariance`) the measurements of
    each epoch; `innovation` (n, b, 2) and `whitened` (n, b, 2), which is L^-1 of it with L L' its covariance (E30), NaN where
    missing; `nis` (n, b), NaN where missing; `fate` (n, b) as named in `problem`; the log-likelihood, in which a gated
    block counts no worse than the gate. `cross` (n, d, d), of nonlinear models: the covariance of the state before each
    step and after it. `carry`: what the next block of the log begins with.
    """

    predicted: np.ndarray
    predicted_covariance: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    innovation: np.ndarray
    whitened: np.ndarray
    nis: np.ndarray
    fate: np.ndarray
    cross: np.ndarray
    log_likelihood: float
    carry: Carry


def _model_of(problem: Problem | ModelProblem) -> tuple:
    """What the engine takes for the model: arrays of the linear one, then those of the nonlinear one; the others are empty."""
    p, d, none = problem, len(problem.x0), np.empty(0)
    if isinstance(p, Problem):
        rows = np.empty((0, 3)), np.empty(0, np.int64), np.empty((0, 2))
        return (p.F, p.Q, p.H, p.span, *rows, none, none, LINEAR, 0.0, 0, 0.0, 0.0, none, none)
    matrices = np.empty((0, d, d)), np.empty((0, d, d)), np.empty((0, 0, 2, d)), np.empty((0, 2), np.int64)
    arrays = p.given, p.sensors, p.stations, p.inflation, np.array(p.model.density, float)
    numbers = p.model.kind, p.model.least_speed, p.scheme.order, p.scheme.step
    return (*matrices, *arrays, *numbers, *((0.0, none, none) if p.sigma is None else p.sigma.weights(d)))


def beginning(problem: Problem | ModelProblem) -> Carry:
    """The carry that a log begins with."""
    groups = int(problem.group.max()) + 1
    begin = float(problem.time[0])
    return Carry(
        begin, problem.x0, problem.P0, np.full(groups, begin), np.zeros(groups, np.int64), np.full(groups, -np.inf)
    )


def run(problem: Problem | ModelProblem, carry: Carry | None = None, crossing: bool = False) -> Run:
    """Filter a problem: prediction, then its blocks one after the other, each gated; Joseph form where it is linear.

    `carry` is that of the run over the block of the log before. `crossing`: keep what the smoother of a nonlinear model needs.
    """
    p, d = problem, len(problem.x0)
    n, blocks = p.z.shape[:2]
    carry = carry or beginning(p)
    gone = carry.last.copy(), carry.rejections.copy(), carry.given_in.copy()
    out = (
        np.empty((n, d)),
        np.empty((n, d, d)),
        np.empty((n, d)),
        np.empty((n, d, d)),
        np.full((n, blocks, 2), np.nan),
        np.full((n, blocks, 2), np.nan),
        np.full((n, blocks), np.nan),
        np.full((n, blocks), MISSING, np.int8),
        np.zeros((n if crossing and isinstance(p, ModelProblem) else 0, d, d)),
    )
    likelihood = FILTERS[d if isinstance(p, Problem) else 0](
        (np.array(carry.x, float), np.array(carry.P, float), *gone),
        (p.time, p.z, p.R, p.angle, p.gates, p.group, p.place, p.rate),
        _model_of(p),
        (p.outliers.factor, p.outliers.threshold, p.outliers.spread),
        out,
    )
    end = Carry(float(p.time[-1]), out[2][-1].copy(), out[3][-1].copy(), *gone)
    return Run(*out, log_likelihood=likelihood, carry=end)


def run_batch(problems: Sequence[Problem | ModelProblem], threads: int = 1) -> list[Run]:
    """Filter many problems, such as the runs of a Monte Carlo study; the engine lets threads run side by side."""
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(run, problems))


def smooth(problem: Problem | ModelProblem, run_: Run) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, d) and covariances (n, d, d) given all measurements, past and future (Rauch, Tung, Striebel).

    A run of a nonlinear model must have been made with `crossing`. Raises ValueError else.
    """
    r = run_
    if isinstance(problem, Problem):
        cross = np.zeros_like(r.covariance)
        cross[1:] = r.covariance[:-1] @ problem.F[1:].transpose(0, 2, 1)
    else:
        cross = r.cross
    if len(cross) != len(r.mean):
        raise ValueError("smooth: run the filter of a nonlinear model with crossing=True")
    return rts(cross, r.predicted, r.predicted_covariance, r.mean, r.covariance)
