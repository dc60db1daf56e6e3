"""The reference engine: the same problems, step by step on filterpy. Slow and plain; the oracle of the compiled one."""

import numpy as np
from filterpy.kalman import KalmanFilter

from aspnn.angles import wrap
from aspnn.estimation.compiled import GATE, REJECTIONS, Run
from aspnn.estimation.problem import COASTING, MISSING, REACQUIRED, REJECTED, USED, Problem


def run(problem: Problem) -> Run:
    """Filter a problem with filterpy's KalmanFilter: one predict per epoch, one update per block."""
    p = problem
    (n, blocks), d = p.z.shape[:2], len(p.x0)
    filters = {rows: KalmanFilter(dim_x=d, dim_z=rows) for rows in (1, 2)}  # filterpy fixes dim_z per filter
    predicted, means = np.empty((2, n, d))
    predicted_covariance, covariances = np.empty((2, n, d, d))
    innovation, whitened = np.full((2, n, blocks, 2), np.nan)
    nis = np.full((n, blocks), np.nan)
    fate = np.full((n, blocks), MISSING, np.int8)
    likelihood, last, rejections = 0.0, p.time[0], 0
    x, P = p.x0, p.P0
    for k in range(n):
        kf = filters[1]
        kf.x, kf.P = x, P
        kf.predict(F=p.F[k], Q=p.Q[k])
        x, P = kf.x, kf.P
        predicted[k], predicted_covariance[k] = x, P
        for b in range(blocks):
            have = np.isfinite(p.z[k, b])
            rows = int(have.sum())
            if rows == 0:
                continue
            H, R = p.H[k, b][have], p.R[k, b][np.ix_(have, have)]
            y = p.z[k, b][have] - H @ x
            if p.angle[b]:
                y[0] = wrap(y[0])
            S = H @ P @ H.T + R
            square, taken = float(y @ np.linalg.solve(S, y)), USED
            if p.gated[b] and square > GATE[rows]:
                away = p.time[k] - last
                taken = REJECTED if rejections < REJECTIONS or away < COASTING else REACQUIRED
                if taken == REACQUIRED:
                    P = P + np.diag(y @ y * (p.place + p.rate / away**2))
                    predicted_covariance[k] = P
                    S = H @ P @ H.T + R
                    square = float(y @ np.linalg.solve(S, y))
            counted = min(square, GATE[rows]) if p.gated[b] else square
            likelihood -= 0.5 * (rows * np.log(2 * np.pi) + np.linalg.slogdet(S)[1] + counted)
            innovation[k, b, have], nis[k, b], fate[k, b] = y, square, taken
            whitened[k, b, have] = np.linalg.solve(np.linalg.cholesky(S), y)
            if taken == REJECTED:
                rejections += 1
                continue
            if p.gated[b]:
                last, rejections = p.time[k], 0
            kf = filters[rows]
            kf.x, kf.P = x, P
            kf.update(H @ x + y, R=R, H=H)  # the innovation of an angle is y, not z - H x
            x, P = kf.x, kf.P
        means[k], covariances[k] = x, P
    return Run(predicted, predicted_covariance, means, covariances, innovation, whitened, nis, fate, likelihood)


def smooth(problem: Problem, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed means and covariances by filterpy's rts_smoother; holds where the filter never re-acquired."""
    kf = KalmanFilter(dim_x=run.mean.shape[1], dim_z=1)
    means, covariances, _, _ = kf.rts_smoother(run.mean, run.covariance, list(problem.F), list(problem.Q))
    return means, covariances
