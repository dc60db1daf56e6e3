"""The reference engine: the same problems, step by step on filterpy. Slow and plain; the oracle of the compiled one."""

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from aspnn.angles import wrap
from aspnn.estimation import models
from aspnn.estimation.compiled import Run, beginning
from aspnn.estimation.flow import NOISE_STEP
from aspnn.estimation.models import Scheme, Sigma
from aspnn.estimation.problem import (
    AGAIN,
    COASTING,
    DOUBTED,
    MISSING,
    REACQUIRED,
    REJECTED,
    REJECTIONS,
    USED,
    Carry,
    ModelProblem,
    Problem,
)


@dataclass
class Linear:
    """filterpy's KalmanFilter on a Problem."""

    p: Problem

    def predict(self, k: int, x, P):
        """x and P at epoch k from those of the epoch before, and their cross covariance."""
        kf = KalmanFilter(dim_x=len(x), dim_z=1)
        kf.x, kf.P = x, P
        kf.predict(F=self.p.F[k], Q=self.p.Q[k])
        return kf.x, kf.P, P @ self.p.F[k].T

    def expect(self, k: int, b: int, have, x, P):
        """Mean (rows) and covariance (rows, rows) of block b, without its own noise."""
        H = self.p.H[k, b][have]
        return H @ x, H @ P @ H.T

    def update(self, k: int, b: int, have, x, P, y, R):
        """x and P after the innovation y."""
        kf, H = KalmanFilter(dim_x=len(x), dim_z=len(y)), self.p.H[k, b][have]
        kf.x, kf.P = x, P
        kf.update(H @ x + y, R=R, H=H)  # the innovation of an angle is y, not z - H x
        return kf.x, kf.P


@dataclass
class Extended:
    """filterpy's ExtendedKalmanFilter on a ModelProblem."""

    p: ModelProblem

    def predict(self, k: int, x, P):
        """As Linear.predict."""
        dt = self.p.time[k] - self.p.time[k - 1] if k else 0.0
        if dt == 0:
            return x, P, P
        later, F, Q = models.flow(
            self.p.model, x, dt, self.p.given[k - 1], self.p.scheme, inflation=self.p.inflation[k]
        )
        kf = ExtendedKalmanFilter(dim_x=len(x), dim_z=1)
        kf.x, kf.P, kf.F, kf.Q = x, P, F, Q
        kf.predict()
        return later, kf.P, P @ F.T  # filterpy moves the mean by F x, which holds for linear models only

    def _h(self, k, b, have, x):
        p = self.p
        args = p.sensors[b], p.stations[b], p.given[k]
        return models.measure(p.model, x, *args)[have], models.measure_jacobian(p.model, x, *args)[have]

    def expect(self, k: int, b: int, have, x, P):
        """As Linear.expect."""
        z, H = self._h(k, b, have, x)
        return z, H @ P @ H.T

    def update(self, k: int, b: int, have, x, P, y, R):
        """As Linear.update."""
        kf = ExtendedKalmanFilter(dim_x=len(x), dim_z=len(y))
        kf.x, kf.P = x, P
        z, H = self._h(k, b, have, x)
        kf.update(z + y, HJacobian=lambda _: H, Hx=lambda _: z, R=R)
        return kf.x, kf.P


@dataclass
class Unscented:
    """filterpy's UnscentedKalmanFilter on a ModelProblem."""

    p: ModelProblem
    sigma: Sigma

    def _filter(self, x, P, rows: int) -> UnscentedKalmanFilter:
        s, n = self.sigma, len(x)
        kf = UnscentedKalmanFilter(n, rows, 1.0, None, None, MerweScaledSigmaPoints(n, s.alpha, s.beta, s.kappa))
        kf.x, kf.P = x, P
        kf.sigmas_f = kf.points_fn.sigma_points(x, P)
        return kf

    def predict(self, k: int, x, P):
        """As Linear.predict."""
        p = self.p
        dt = p.time[k] - p.time[k - 1] if k else 0.0
        if dt == 0:
            return x, P, P
        kf, given = self._filter(x, P, 1), p.given[k - 1]
        rest = x[4] if len(x) == 8 else given[0]
        before = kf.sigmas_f.copy()
        points = np.array([models.flow(p.model, s, dt, given, p.scheme, rest)[0] for s in before])
        if dt <= NOISE_STEP:
            kf.Q = models.noise(p.model, x, kf.Wm @ points, dt, given, p.inflation[k])
        else:
            kf.Q = models.flow(p.model, x, dt, given, Scheme(4, dt), inflation=p.inflation[k])[2]
        kf.predict(dt, fx=lambda s, dt: points[np.argmin(np.abs(before - s).max(axis=1))])
        return kf.x, kf.P, (before - x).T @ (kf.Wc[:, None] * (points - kf.x))

    def _h(self, k, b, have, x):
        """The reading as a function of the state; at rest the path points where the mean does."""
        p = self.p
        rest = x[4] if len(x) == 8 else p.given[k, 0]
        return lambda s: models.measure(p.model, s, p.sensors[b], p.stations[b], p.given[k], rest)[have]

    def expect(self, k: int, b: int, have, x, P):
        """As Linear.expect."""
        kf, h = self._filter(x, P, int(have.sum())), self._h(k, b, have, x)
        z = np.array([h(s) for s in kf.sigmas_f])
        away = z - kf.Wm @ z
        return kf.Wm @ z, away.T @ (kf.Wc[:, None] * away)

    def update(self, k: int, b: int, have, x, P, y, R):
        """As Linear.update."""
        kf, h = self._filter(x, P, len(y)), self._h(k, b, have, x)
        kf.update(self.expect(k, b, have, x, P)[0] + y, R=R, hx=h)
        return kf.x, kf.P


def run(problem: Problem | ModelProblem, carry: Carry | None = None, crossing: bool = False) -> Run:
    """Filter a problem with filterpy: one predict per epoch, one update per block; arguments as those of `compiled.run`."""
    p = problem
    engine: Linear | Extended | Unscented = Linear(p) if isinstance(p, Problem) else Extended(p)
    if isinstance(p, ModelProblem) and p.sigma is not None:
        engine = Unscented(p, p.sigma)
    (n, blocks), d = p.z.shape[:2], len(p.x0)
    predicted, means = np.empty((2, n, d))
    predicted_covariance, covariances, cross = np.empty((3, n, d, d))
    innovation, whitened = np.full((2, n, blocks, 2), np.nan)
    nis = np.full((n, blocks), np.nan)
    fate = np.full((n, blocks), MISSING, np.int8)
    carry = carry or beginning(p)
    x, P = carry.x, carry.P
    last, rejections, given_in = carry.last.copy(), carry.rejections.copy(), carry.given_in.copy()
    likelihood = 0.0
    for k in range(n):
        x, P, cross[k] = engine.predict(k, x, P)
        predicted[k], predicted_covariance[k] = x, P
        doubted = False
        for b in range(blocks):
            have = np.isfinite(p.z[k, b])
            rows, g = int(have.sum()), p.group[b]
            if rows == 0:
                continue
            R = p.R[k, b][np.ix_(have, have)]
            taken = USED
            if doubted and p.outliers.spread:
                R, taken = p.outliers.factor * R, DOUBTED
            while True:
                expected, S = engine.expect(k, b, have, x, P)
                y, S = p.z[k, b][have] - expected, S + R
                if p.angle[b]:
                    y[0] = wrap(y[0])
                square = float(y @ np.linalg.solve(S, y))
                beyond = square > p.gates[b, rows - 1] or (np.abs(y) > p.outliers.threshold).any()
                if taken != USED or not beyond:
                    break
                if np.isfinite(p.outliers.factor):
                    R, taken, doubted = p.outliers.factor * R, DOUBTED, True
                    continue
                away = p.time[k] - last[g]
                if rejections[g] < REJECTIONS or away < COASTING:
                    taken = REJECTED
                    break
                taken = REACQUIRED
                faster = 1 / away**2 if p.time[k] - given_in[g] < AGAIN else 0.0
                given_in[g] = p.time[k]
                wider = np.diag(y @ y * (p.place[b] + p.rate[b] * faster))
                P = P + wider
                predicted_covariance[k] += wider
            likelihood -= 0.5 * (rows * np.log(2 * np.pi) + np.linalg.slogdet(S)[1] + min(square, p.gates[b, rows - 1]))
            innovation[k, b, have], nis[k, b], fate[k, b] = y, square, taken
            whitened[k, b, have] = np.linalg.solve(np.linalg.cholesky(S), y)
            if taken == REJECTED:
                rejections[g] += 1
                continue
            last[g], rejections[g] = p.time[k], 0
            x, P = engine.update(k, b, have, x, P, y, R)
        means[k], covariances[k] = x, P
    end = Carry(float(p.time[-1]), x, P, last, rejections, given_in)
    return Run(
        predicted, predicted_covariance, means, covariances, innovation, whitened, nis, fate, cross, likelihood, end
    )


def smooth(problem: Problem | ModelProblem, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed means and covariances, by filterpy's rts_smoother where the problem is linear and was never re-acquired."""
    if isinstance(problem, Problem) and not (run.fate == REACQUIRED).any():
        kf = KalmanFilter(dim_x=run.mean.shape[1], dim_z=1)
        return kf.rts_smoother(run.mean, run.covariance, list(problem.F), list(problem.Q))[:2]
    means, covariances = run.mean.copy(), run.covariance.copy()
    for k in range(len(means) - 2, -1, -1):
        C = np.linalg.solve(run.predicted_covariance[k + 1], run.cross[k + 1].T).T
        means[k] += C @ (means[k + 1] - run.predicted[k + 1])
        covariances[k] += C @ (covariances[k + 1] - run.predicted_covariance[k + 1]) @ C.T
    return means, covariances
