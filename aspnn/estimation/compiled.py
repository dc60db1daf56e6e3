"""The compiled engine: a linear time-varying Kalman filter and its Rauch-Tung-Striebel smoother, by numba.

Both take the arrays of a `Problem` and return arrays; nothing is kept between calls. The number of states is a constant
of each compiled function, so that its small loops unroll.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import chdtri

from aspnn.estimation.problem import COASTING, MISSING, REACQUIRED, REJECTED, USED, Problem

GATE = np.array([np.inf, chdtri(1, 1e-3), chdtri(2, 1e-3)])  # 99.9 %, by the number of rows that a block has
REJECTIONS = 3  # as many, and COASTING seconds without any accepted, and the filter gives in to what it is told


@dataclass(frozen=True)
class Run:
    """What a filter makes of a problem of n epochs, d states and b measurement blocks.

    Means (n, d) and covariances (n, d, d), before (`predicted`) and after (`mean`, `covariance`) the measurements of
    each epoch; `innovation` (n, b, 2) and `whitened` (n, b, 2), which is L^-1 of it with L L' its covariance (E30), NaN where
    missing; `nis` (n, b), NaN where missing; `fate` (n, b) as named in `problem`; the log-likelihood, in which a gated
    block counts no worse than the gate.
    """

    predicted: np.ndarray
    predicted_covariance: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    innovation: np.ndarray
    whitened: np.ndarray
    nis: np.ndarray
    fate: np.ndarray
    log_likelihood: float


def _filter_of(d: int):
    """The filter of `d` states, compiled on its first call."""

    @njit(cache=True, error_model="numpy")
    def kalman(time, x0, P0, F, Q, H, span, z, R, angle, gated, place, rate, gate, patience, out):
        xp, Pp, xf, Pf, innovation, whitened, nis, fate = out
        n, blocks = z.shape[0], z.shape[1]
        x, P, A, h = x0.copy(), P0.copy(), np.empty((d, d)), np.zeros((2, d))
        G, K, W = np.empty((d, 2)), np.empty((d, 2)), np.empty((d, 2))
        likelihood, last, rejections = 0.0, time[0], 0
        for k in range(n):
            # x = F x, P = F P F' + Q with F upper triangular
            for i in range(d):
                total = 0.0
                for j in range(i, d):
                    total += F[k, i, j] * x[j]
                x[i] = total
            for i in range(d):
                for j in range(d):
                    total = 0.0
                    for m in range(i, d):
                        total += F[k, i, m] * P[m, j]
                    A[i, j] = total
            for i in range(d):
                for j in range(i, d):
                    total = Q[k, i, j]
                    for m in range(j, d):
                        total += A[i, m] * F[k, j, m]
                    P[i, j] = total
                    P[j, i] = total
            for i in range(d):
                xp[k, i] = x[i]
                for j in range(d):
                    Pp[k, i, j] = P[i, j]
            for b in range(blocks):
                have0, have1 = not np.isnan(z[k, b, 0]), not np.isnan(z[k, b, 1])
                rows = int(have0) + int(have1)
                if rows == 0:
                    continue
                # A missing row measures nothing: H = 0, R = 1, innovation 0.
                low, high = span[b, 0], span[b, 1]
                y0, y1 = z[k, b, 0], z[k, b, 1]
                for j in range(low, high):
                    h[0, j] = H[k, b, 0, j] if have0 else 0.0
                    h[1, j] = H[k, b, 1, j] if have1 else 0.0
                    y0 -= h[0, j] * x[j]
                    y1 -= h[1, j] * x[j]
                r00, r11, r01 = R[k, b, 0, 0], R[k, b, 1, 1], R[k, b, 0, 1]
                if rows == 1:
                    r01 = 0.0
                    if have0:
                        y1, r11 = 0.0, 1.0
                    else:
                        y0, r00 = 0.0, 1.0
                if angle[b]:
                    y0 = (y0 + np.pi) % (2 * np.pi) - np.pi
                taken = USED
                while True:  # once, or twice when the filter re-acquires
                    s00, s01, s11 = r00, r01, r11
                    for i in range(d):
                        g0, g1 = 0.0, 0.0
                        for j in range(low, high):
                            g0 += P[i, j] * h[0, j]
                            g1 += P[i, j] * h[1, j]
                        G[i, 0] = g0
                        G[i, 1] = g1
                    for j in range(low, high):
                        s00 += h[0, j] * G[j, 0]
                        s01 += h[0, j] * G[j, 1]
                        s11 += h[1, j] * G[j, 1]
                    determinant = s00 * s11 - s01 * s01
                    i00, i01, i11 = s11 / determinant, -s01 / determinant, s00 / determinant
                    square = y0 * y0 * i00 + 2 * y0 * y1 * i01 + y1 * y1 * i11
                    if not gated[b] or square <= gate[rows] or taken == REACQUIRED:
                        break
                    if rejections < REJECTIONS or time[k] - last < patience:
                        taken = REJECTED
                        break
                    # The offset has grown since the last accepted value: so wide may place and rate be wrong.
                    taken = REACQUIRED
                    away = y0 * y0 + y1 * y1
                    for i in range(d):
                        P[i, i] += away * (place[i] + rate[i] / (time[k] - last) ** 2)
                        Pp[k, i, i] = P[i, i]
                worst = gate[rows] if gated[b] else np.inf
                likelihood -= 0.5 * (rows * np.log(2 * np.pi) + np.log(determinant) + min(square, worst))
                innovation[k, b, 0] = y0 if have0 else np.nan
                innovation[k, b, 1] = y1 if have1 else np.nan
                root = np.sqrt(s00)
                low_left = s01 / root
                if have0:
                    whitened[k, b, 0] = y0 / root
                if have1:
                    whitened[k, b, 1] = (y1 - low_left * y0 / root) / np.sqrt(s11 - low_left**2)
                nis[k, b] = square
                fate[k, b] = taken
                if taken == REJECTED:
                    rejections += 1
                    continue
                if gated[b]:
                    last, rejections = time[k], 0
                # Joseph form: A = (I - K H) P, then P = A (I - K H)' + K R K' = A + (K R - A H') K'
                for i in range(d):
                    K[i, 0] = G[i, 0] * i00 + G[i, 1] * i01
                    K[i, 1] = G[i, 0] * i01 + G[i, 1] * i11
                    x[i] += K[i, 0] * y0 + K[i, 1] * y1
                for i in range(d):
                    for j in range(d):
                        A[i, j] = P[i, j] - K[i, 0] * G[j, 0] - K[i, 1] * G[j, 1]
                for i in range(d):
                    w0 = K[i, 0] * r00 + K[i, 1] * r01
                    w1 = K[i, 0] * r01 + K[i, 1] * r11
                    for j in range(low, high):
                        w0 -= A[i, j] * h[0, j]
                        w1 -= A[i, j] * h[1, j]
                    W[i, 0] = w0
                    W[i, 1] = w1
                for i in range(d):
                    for j in range(i, d):
                        P[i, j] = A[i, j] + W[i, 0] * K[j, 0] + W[i, 1] * K[j, 1]
                        P[j, i] = P[i, j]
            for i in range(d):
                xf[k, i] = x[i]
                for j in range(d):
                    Pf[k, i, j] = P[i, j]
        return likelihood

    return kalman


_FILTERS = {3: _filter_of(3), 6: _filter_of(6)}


def run(problem: Problem) -> Run:
    """Filter a problem: prediction, then its blocks one after the other, each gated and in Joseph form."""
    n, d = len(problem.time), len(problem.x0)
    blocks = problem.z.shape[1]
    out = (
        np.empty((n, d)),
        np.empty((n, d, d)),
        np.empty((n, d)),
        np.empty((n, d, d)),
        np.full((n, blocks, 2), np.nan),
        np.full((n, blocks, 2), np.nan),
        np.full((n, blocks), np.nan),
        np.full((n, blocks), MISSING, np.int8),
    )
    p = problem
    likelihood = _FILTERS[d](
        p.time, p.x0, p.P0, p.F, p.Q, p.H, p.span, p.z, p.R, p.angle, p.gated, p.place, p.rate, GATE, COASTING, out
    )
    return Run(*out, log_likelihood=likelihood)


@njit(cache=True, error_model="numpy")
def _rts(F, xp, Pp, xf, Pf):
    n, d = xf.shape
    xs, Ps = xf.copy(), Pf.copy()
    L, C, D = np.zeros((d, d)), np.zeros((d, d)), np.zeros((d, d))
    for k in range(n - 2, -1, -1):
        # Pp = L L'
        for i in range(d):
            for j in range(i + 1):
                total = Pp[k + 1, i, j]
                for m in range(j):
                    total -= L[i, m] * L[j, m]
                L[i, j] = np.sqrt(total) if i == j else total / L[j, j]
        # C' = Pp^-1 F Pf by the two triangular systems, one column at a time
        for c in range(d):
            for i in range(d):
                total = 0.0
                for j in range(d):
                    total += F[k + 1, i, j] * Pf[k, j, c]
                for m in range(i):
                    total -= L[i, m] * C[c, m]
                C[c, i] = total / L[i, i]
            for i in range(d - 1, -1, -1):
                total = C[c, i]
                for m in range(i + 1, d):
                    total -= L[m, i] * C[c, m]
                C[c, i] = total / L[i, i]
        for i in range(d):
            for j in range(d):
                xs[k, i] += C[i, j] * (xs[k + 1, j] - xp[k + 1, j])
                total = 0.0
                for m in range(d):
                    total += C[i, m] * (Ps[k + 1, m, j] - Pp[k + 1, m, j])
                D[i, j] = total
        for i in range(d):
            for j in range(i, d):
                total = Pf[k, i, j]
                for m in range(d):
                    total += D[i, m] * C[j, m]
                Ps[k, i, j] = total
                Ps[k, j, i] = total
    return xs, Ps


def smooth(problem: Problem, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, d) and covariances (n, d, d) given all measurements, past and future (Rauch, Tung, Striebel)."""
    return _rts(problem.F, run.predicted, run.predicted_covariance, run.mean, run.covariance)
