"""Compiled Kalman filters whose blocks have up to three rows: a linear one with input, and the update that others share.

The gates, the giving in after too many rejections and the fates are those of `engine`; a block's NIS has as many degrees of
freedom as it has rows with a value (E32), since its rows are taken at once with their whole covariance.
"""

import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numba import njit
from scipy.special import chdtri

from aspnn.estimation import attitude, problem
from aspnn.estimation.problem import AGAIN, COASTING, MISSING, REACQUIRED, REJECTED, REJECTIONS, USED, Carry

# numba's cache sees no change of what a function takes from other modules; as a constant of the engine this makes it see.
SOURCES = zlib.crc32(
    b"".join(Path(str(m.__file__)).read_bytes() for m in (attitude, problem)) + Path(__file__).read_bytes()
)


@dataclass(frozen=True)
class Blocks:
    """b measurement blocks of up to three rows at n epochs: values `z` (n, b, 3) NaN where missing, rows `H` (b, 3, d) that are zero
    outside the columns `span` (b, 2), noise `R` (n, b, 3, 3). Gates (b, 3) by rows present; `group`, `place` (b, d) and
    `rate` (b, d) as in Problem; `angle` (b) marks a first row that is an angle.
    """

    z: np.ndarray
    H: np.ndarray
    span: np.ndarray
    R: np.ndarray
    angle: np.ndarray
    gates: np.ndarray
    group: np.ndarray
    place: np.ndarray
    rate: np.ndarray

    def of(self, rows: slice) -> "Blocks":
        """Those of some epochs."""
        return replace(self, z=self.z[rows], R=self.R[rows])


@dataclass(frozen=True)
class Driven:
    """x[k] = F[k] x[k-1] + u[k] + N(0, Q[k]), measured by `blocks`; d states, n epochs. F[0], u[0], Q[0] lead to the first epoch."""

    time: np.ndarray
    F: np.ndarray
    u: np.ndarray
    Q: np.ndarray
    blocks: Blocks

    def of(self, rows: slice) -> "Driven":
        """The part of some epochs."""
        return Driven(self.time[rows], self.F[rows], self.u[rows], self.Q[rows], self.blocks.of(rows))


@dataclass(frozen=True)
class Fit:
    """What a filter makes of n epochs: `mean` (n, d), `covariance` (n, d, d); of b blocks `innovation` and `whitened` (n, b, 3), `nis`
    and `fate` (n, b); `predicted` (n, d) before the measurements; the log-likelihood; what the next epochs begin with.
    """

    mean: np.ndarray
    covariance: np.ndarray
    predicted: np.ndarray
    innovation: np.ndarray
    whitened: np.ndarray
    nis: np.ndarray
    fate: np.ndarray
    log_likelihood: float
    carry: Carry


def gates(probability: float) -> tuple[float, float, float]:
    """Largest NIS of one, two and three rows that passes a gate which good values fail with `probability`."""
    one, two, three = chdtri([1, 2, 3], probability)
    return float(one), float(two), float(three)


@njit(cache=True, error_model="numpy")
def absorb(now, k, b, y, h, R, low, high, P, shift, limits, place, rate, group, last, rejections, given_in, work, out):
    """Take block `b` with innovation y (3), NaN where missing, rows h (3, d), noise R (3, 3) into P and the state's `shift` (d).

    What it does: S = h P h' + R, L L' = S, e = L^-1 y, NIS = e'e; accepted, shift = P h' S^-1 y and P - P h' S^-1 h P (else shift
    = 0). Fills the block's row of `out`; returns the log-likelihood, in which a rejected block counts no worse than its gate.
    """
    innovation, whitened, nis, fate = out
    G, L, W, e, rows = work
    d = P.shape[0]
    for i in range(d):
        shift[i] = 0.0
    m = 0
    for i in range(3):
        if np.isfinite(y[i]):
            rows[m] = i
            m += 1
    if m == 0:
        return 0.0
    g, worst, taken = group[b], limits[b, m - 1], USED
    square, determinant = 0.0, 0.0
    while True:  # once, or twice when the filter gives in
        for j in range(m):
            row = rows[j]
            for i in range(d):
                total = 0.0
                for c in range(low, high):
                    total += P[i, c] * h[row, c]
                G[i, j] = total
        square, determinant = 0.0, 0.0
        for i in range(m):
            for j in range(i + 1):
                total = R[rows[i], rows[j]]
                for c in range(low, high):
                    total += h[rows[i], c] * G[c, j]
                for c in range(j):
                    total -= L[i, c] * L[j, c]
                L[i, j] = np.sqrt(total) if i == j else total / L[j, j]
            total = y[rows[i]]
            for c in range(i):
                total -= L[i, c] * e[c]
            e[i] = total / L[i, i]
            square += e[i] * e[i]
            determinant += 2 * np.log(L[i, i])
        if taken != USED or square <= worst:
            break
        if rejections[g] < REJECTIONS or now - last[g] < COASTING:
            taken = REJECTED
            break
        # So wide may the place be wrong; and if that is not the first time, its rate.
        taken = REACQUIRED
        away = 0.0
        for i in range(m):
            away += y[rows[i]] ** 2
        faster = 1.0 / (now - last[g]) ** 2 if now - given_in[g] < AGAIN else 0.0
        given_in[g] = now
        for i in range(d):
            P[i, i] += away * (place[b, i] + rate[b, i] * faster)
    for i in range(m):
        innovation[k, b, rows[i]], whitened[k, b, rows[i]] = y[rows[i]], e[i]
    nis[k, b], fate[k, b] = square, taken
    if taken == REJECTED:
        rejections[g] += 1
    else:
        last[g], rejections[g] = now, 0
        for i in range(d):
            for j in range(m):  # W = G L^-T, so that G S^-1 G' = W W' and G S^-1 y = W e
                total = G[i, j]
                for c in range(j):
                    total -= L[j, c] * W[i, c]
                W[i, j] = total / L[j, j]
                shift[i] += W[i, j] * e[j]
        for i in range(d):
            for j in range(i + 1):
                total = P[i, j]
                for c in range(m):
                    total -= W[i, c] * W[j, c]
                P[i, j] = P[j, i] = total
    return -0.5 * (m * np.log(2 * np.pi) + determinant + min(square, worst))


@njit(cache=True, error_model="numpy")
def workspace(d):
    """Arrays that `absorb` works in."""
    return np.empty((d, 3)), np.empty((3, 3)), np.empty((d, 3)), np.empty(3), np.empty(3, np.int64)


@njit(cache=True, error_model="numpy", nogil=True)
def _linear(time, F, u, Q, z, H, span, R, angle, limits, group, place, rate, x, P, gone, xp, xf, Pf, out):
    """Run the filter of a Driven problem on; fills the outputs, changes x, P and gone = (last, rejections, given_in)."""
    assert SOURCES
    last, rejections, given_in = gone
    n, blocks, d = z.shape[0], z.shape[1], len(x)
    work, A, y, shift, moved = workspace(d), np.empty((d, d)), np.empty(3), np.empty(d), np.empty(d)
    likelihood = 0.0
    for k in range(n):
        for i in range(d):
            moved[i] = u[k, i]
            for j in range(d):
                moved[i] += F[k, i, j] * x[j]
                total = 0.0
                for c in range(d):
                    total += F[k, i, c] * P[c, j]
                A[i, j] = total
        for i in range(d):
            x[i] = xp[k, i] = moved[i]
            for j in range(i + 1):
                total = Q[k, i, j]
                for c in range(d):
                    total += A[i, c] * F[k, j, c]
                P[i, j] = P[j, i] = total
        for b in range(blocks):
            low, high = span[b, 0], span[b, 1]
            for i in range(3):
                y[i] = z[k, b, i]
                for j in range(low, high):
                    y[i] -= H[b, i, j] * x[j]
            if angle[b]:
                y[0] = (y[0] + np.pi) % (2 * np.pi) - np.pi
            likelihood += absorb(
                *(time[k], k, b, y, H[b], R[k, b], low, high, P, shift, limits, place, rate, group),
                *(last, rejections, given_in, work, out),
            )
            for i in range(d):
                x[i] += shift[i]
        for i in range(d):
            xf[k, i] = x[i]
            for j in range(d):
                Pf[k, i, j] = P[i, j]
    return likelihood


def beginning(time: float, x, P, group: np.ndarray) -> Carry:
    """The carry that a log begins with at `time`."""
    groups = int(group.max()) + 1
    gone = np.full(groups, time), np.zeros(groups, np.int64), np.full(groups, -np.inf)
    return Carry(time, np.asarray(x, float), np.asarray(P, float), *gone)


def outputs(n: int, blocks: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Innovation, whitened, NIS and fate, empty, as `absorb` fills them."""
    nothing = np.full((n, blocks, 3), np.nan), np.full((n, blocks, 3), np.nan), np.full((n, blocks), np.nan)
    return *nothing, np.full((n, blocks), MISSING, np.int8)


def run(driven: Driven, carry: Carry) -> Fit:
    """Filter a Driven problem from `carry` on; epochs follow each other in one run or in several, to the same states."""
    p, d = driven, len(carry.x)
    n = len(p.time)
    x, P = carry.x.copy(), carry.P.copy()
    gone = carry.last.copy(), carry.rejections.copy(), carry.given_in.copy()
    xp, xf, Pf = np.empty((n, d)), np.empty((n, d)), np.empty((n, d, d))
    out, b = outputs(n, p.blocks.z.shape[1]), p.blocks
    likelihood = _linear(
        *(p.time, p.F, p.u, p.Q, b.z, b.H, b.span, b.R, b.angle, b.gates, b.group, b.place, b.rate),
        *(x, P, gone, xp, xf, Pf, out),
    )
    return Fit(xf, Pf, xp, *out, likelihood, Carry(float(p.time[-1]), x, P, *gone))
