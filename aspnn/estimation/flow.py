"""From one instant to the next: Runge-Kutta for a state with its sensitivity, for sigma points, and the noise on the way. Compiled.

Numba keeps these compiled between sessions and does not see a change of `kernels`: whoever makes one touches this file too.
"""

import numpy as np
from numba import njit

from aspnn.estimation.kernels import CTRA6, CTRA8, drift, moving, still, tangent

NOISE_STEP = 0.5  # s: the noise of a longer way is gathered in parts, each with its own Jacobian


@njit(cache=True, error_model="numpy")
def steps_of(dt, longest):
    """Least number of equal steps, none longer than `longest` [s], in dt."""
    return max(1, int(np.ceil(dt / longest - 1e-9)))


@njit(cache=True, error_model="numpy")
def at_stage(kind, given, t, psi, p):
    """Fill p[:3] with what was `given`, t [s] later, and p[5:] with cosine and sine of the heading, given or a state (`psi`)."""
    p[0], p[1], p[2] = given[0] + (given[1] + 0.5 * given[2] * t) * t, given[1] + given[2] * t, given[2]
    if kind in (CTRA6, CTRA8):  # no other turns its state
        psi = psi if kind == CTRA8 else p[0]
        p[5], p[6] = np.cos(psi), np.sin(psi)


def _advance_of(swept: bool):
    """The function that takes the columns of X (d, c) from `begin` to begin + dt [s] after `given` was told, in place.

    Columns are points, or `swept`: a sensitivity Phi with its state last, for x' = f(x) and Phi' = F(x) Phi together. Each of
    the `steps` is one of the midpoint rule (order 2) or of the classical Runge-Kutta method (order 4). K, Y, sums (d, c) are
    work space.
    """

    @njit(cache=True, error_model="numpy")
    def advance(kind, least, given, begin, dt, order, steps, p, X, K, Y, sums):
        state, psi, size = X.shape[1] - 1 if swept else 0, min(4, X.shape[0] - 1), moving(kind) * X.shape[1]
        x, k, y, total, h = X.reshape(-1), K.reshape(-1), Y.reshape(-1), sums.reshape(-1), dt / steps  # all in one row
        for i in range(x.size):
            y[i] = x[i]
        for n in range(steps):
            for stage in range(order):
                after = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                at_stage(kind, given, begin + n * h + after, Y[psi, state], p)
                if swept:
                    tangent(kind, least, p, Y, K)
                else:
                    drift(kind, least, Y, p, K)
                ahead = h if stage == 2 else 0.5 * h  # to where the next stage looks
                weight = (0.0 if stage == 0 else h) if order == 2 else (h / 3 if stage in (1, 2) else h / 6)
                if stage < order - 1:
                    for i in range(size):
                        total[i] = weight * k[i] + (total[i] if stage > 0 else 0.0)
                        y[i] = x[i] + ahead * k[i]
                else:
                    for i in range(size):
                        x[i] += total[i] + weight * k[i]
                        y[i] = x[i]

    return advance


advance_points, advance_state = _advance_of(False), _advance_of(True)


@njit(cache=True, error_model="numpy")
def noise_of(kind, least, given, begin, dt, density, p, x0, x1, Q, L, T):
    """Q (d, d): covariance of the noise on the way from x0 (d) to x1 (d), from `begin` to begin + dt [s].

    L, T (d, d + 1) are work space.

    Sum over k of dt^(k+1) / (k+1)! L^k(diag density), L(X) = F X + X F', k to 4: the series of Van Loan's integral with the
    Jacobian F held at the middle of the way; no term is missing for CAA and CTRA, for CMM those of a dt / V and beyond in what
    is of order dt^5.
    """
    d = len(x0)
    for i in range(d):
        for j in range(d):
            L[i, j] = density[i] if i == j else 0.0
            T[i, j] = 0.0
        L[i, d] = 0.5 * (x0[i] + x1[i])
    at_stage(kind, given, begin + dt / 2, L[min(4, d - 1), d], p)
    for k in range(5, 1, -1):  # from the inside out: D + dt / 2 L(D + dt / 3 L(...))
        tangent(kind, least, p, L, T)
        for i in range(d):
            for j in range(i, d):
                L[i, j] = L[j, i] = (T[i, j] + T[j, i]) * (dt / k)
            L[i, i] += density[i]
    for i in range(d):
        for j in range(d):
            Q[i, j] = dt * L[i, j]


@njit(cache=True, error_model="numpy")
def _product(W, X, first, out):
    """out (d, d) = Phi X for the sensitivity Phi whose columns from `first` on are W's, and before it those of the identity."""
    d = X.shape[0]
    for i in range(d):
        for j in range(d):
            out[i, j] = X[i, j] if i < first else 0.0
        for k in range(first, d):
            if W[i, k - first] != 0.0:
                for j in range(d):
                    out[i, j] += W[i, k - first] * X[k, j]


@njit(cache=True, error_model="numpy")
def flow_covariance(kind, least, given, dt, order, step, density, p, x, P, Phi, work, narrow):
    """Take x (d) and P (d, d) a time dt on, in place; Phi (d, d), unless it is empty, <- the sensitivity of the way.

    P <- Phi P Phi' + noise, part by part: the solution of the thesis's P' = F P + P F' + Q (table 3.3, E20), and never less
    than positive semidefinite. work (6, d, d + 1) and narrow (4, d, d + 1 - still) are work space.
    """
    d, first, parts = len(x), still(kind), steps_of(dt, NOISE_STEP)
    part, columns = dt / parts, narrow.shape[2]
    Q, T, own, x0, W = work[0], work[1], work[2], work[3, 0], narrow[0]
    for q in range(parts):
        for i in range(d):
            x0[i] = W[i, columns - 1] = x[i]
            for j in range(columns - 1):
                W[i, j] = 1.0 if i == j + first else 0.0
        count = steps_of(part, step)
        advance_state(kind, least, given, q * part, part, order, count, p, W, narrow[1], narrow[2], narrow[3])
        for i in range(d):
            x[i] = W[i, columns - 1]
        noise_of(kind, least, given, q * part, part, density, p, x0[:d], x, Q, work[4], work[5])
        _product(W, P, first, T)
        for i in range(d):
            for j in range(d):
                own[j, i] = T[i, j]
        _product(W, own, first, P)
        for i in range(d):
            for j in range(i, d):
                P[i, j] = 0.5 * (P[i, j] + P[j, i]) + Q[i, j]
                P[j, i] = P[i, j]
        if len(Phi) > 0:
            for i in range(d if q == 0 else 0):
                for j in range(d):
                    Phi[i, j] = 1.0 if i == j else 0.0
            _product(W, Phi, first, T)
            for i in range(d):
                for j in range(d):
                    Phi[i, j] = T[i, j]
