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


@njit(cache=True, error_model="numpy")
def flow_state(kind, least, given, begin, dt, order, steps, p, W, K, Y, sums):
    """Take W (d, c), columns of a sensitivity and last the state, from `begin` to begin + dt [s] after `given` was told.

    In place; K, Y, sums (d, c) are work space. Each of the `steps` solves x' = f(x) and Phi' = F(x) Phi together, by the
    midpoint rule (order 2) or the classical Runge-Kutta method (order 4).
    """
    d, h, last = W.shape[0], dt / steps, W.shape[1] - 1
    psi, size = min(4, d - 1), moving(kind) * (last + 1)
    k, y, w, total = K.reshape(-1), Y.reshape(-1), W.reshape(-1), sums.reshape(-1)  # the same numbers in one row
    for i in range(w.size):
        y[i] = w[i]
    for n in range(steps):
        t = begin + n * h
        at_stage(kind, given, t, W[psi, last], p)
        tangent(kind, least, p, W, K)
        for i in range(size):
            y[i] = w[i] + 0.5 * h * k[i]
        at_stage(kind, given, t + 0.5 * h, Y[psi, last], p)
        if order == 2:
            tangent(kind, least, p, Y, K)
            for i in range(size):
                w[i] += h * k[i]
            continue
        for i in range(size):
            total[i] = k[i]
        for stage in range(2, 4):
            tangent(kind, least, p, Y, K)
            ahead = 0.5 * h if stage == 2 else h
            for i in range(size):
                total[i] += 2 * k[i]
                y[i] = w[i] + ahead * k[i]
            at_stage(kind, given, t + ahead, Y[psi, last], p)
        tangent(kind, least, p, Y, K)
        for i in range(size):
            w[i] += h / 6 * (total[i] + k[i])


@njit(cache=True, error_model="numpy")
def flow_points(kind, least, given, dt, order, step, p, X, K, Y, total):
    """Take the points X (d, s) a time dt [s] on, as `flow_state`, in place; K, Y (d, s) and total (d s) are work space."""
    steps, psi, size = steps_of(dt, step), min(4, X.shape[0] - 1), moving(kind) * X.shape[1]
    h = dt / steps
    x, k, y = X.reshape(-1), K.reshape(-1), Y.reshape(-1)
    for i in range(x.size):
        y[i] = x[i]
    for n in range(steps):
        t = n * h
        at_stage(kind, given, t, X[psi, 0], p)
        drift(kind, least, X, p, K)
        for i in range(size):
            y[i] = x[i] + 0.5 * h * k[i]
        at_stage(kind, given, t + 0.5 * h, Y[psi, 0], p)
        if order == 2:
            drift(kind, least, Y, p, K)
            for i in range(size):
                x[i] += h * k[i]
            continue
        for i in range(size):
            total[i] = k[i]
        for stage in range(2, 4):
            drift(kind, least, Y, p, K)
            ahead = 0.5 * h if stage == 2 else h
            for i in range(size):
                total[i] += 2 * k[i]
                y[i] = x[i] + ahead * k[i]
            at_stage(kind, given, t + ahead, Y[psi, 0], p)
        drift(kind, least, Y, p, K)
        for i in range(size):
            x[i] += h / 6 * (total[i] + k[i])


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
        flow_state(
            kind, least, given, q * part, part, order, steps_of(part, step), p, W, narrow[1], narrow[2], narrow[3]
        )
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
