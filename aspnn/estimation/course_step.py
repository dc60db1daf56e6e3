"""The step of the course filter between fixes, compiled by numba: `course_model.transition` and P -> F P F' + Q, in place."""

import numpy as np
from numba import njit

from aspnn.estimation.course_model import EQUATOR, NODES, SQUARED, STEP, WEIGHTS

UNIFORM = np.pi**2 / 3  # variance of an angle of which nothing is known
COEFFICIENTS = 20  # what `_prepare` fills


@njit(cache=True, error_model="numpy")
def _decays(alpha, time):
    way, far = 0.0, 0.0
    for i in range(3):
        e = WEIGHTS[i] * np.exp(-alpha * time * NODES[i])
        way += e
        far += e * (1 - NODES[i])
    return np.exp(-alpha * time), time * way, time * time * far


@njit(cache=True, error_model="numpy")
def _prepare(model, h, c):
    """c: what an inner step of h seconds has in common whatever the state; see `course_model.transition`."""
    speed, turn, a1, a2 = model[0], model[1], model[2], model[3]  # and the gate
    c[0] = h
    c[1] = _decays(a1, h)[0]
    c[2], c[3], _ = _decays(a2, h)
    for i in range(4, COEFFICIENTS):
        c[i] = 0.0
    for i in range(3):
        t = h * NODES[i]
        e, g, _ = _decays(a1, t)
        c[5 + i] = h * WEIGHTS[i] * e
        w = h * WEIGHTS[i] * speed
        c[11] += w * g * g
        c[12] += w * g * e
        c[13] += w * e * e
        e, g, far = _decays(a2, t)
        c[8 + i] = g
        w = h * WEIGHTS[i] * turn
        c[14] += w * far * far
        c[15] += w * far * g
        c[16] += w * far * e
        c[17] += w * g * g
        c[18] += w * g * e
        c[19] += w * e * e


@njit(cache=True, error_model="numpy")
def per_metre(latitude):
    s, c = np.sin(latitude), np.cos(latitude)
    W = 1 - SQUARED * s * s
    north, east = W * np.sqrt(W) / (EQUATOR * (1 - SQUARED)), np.sqrt(W) / (EQUATOR * c)
    return north, east, -3 * SQUARED * s * c / W * north, east * (s / c - SQUARED * s * c / W)


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _inner(c, geodetic, x, P, A):
    U, chi, omega = x[2], x[3], x[4]
    ahead_n, ahead_e, turned_n, turned_e, cosine, sine = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        angle = chi + omega * c[8 + i]
        turned, aside = np.cos(angle), np.sin(angle)
        if i == 1:  # the middle of the step
            cosine, sine = turned, aside
        n, e = c[5 + i] * turned, c[5 + i] * aside
        ahead_n += n
        ahead_e += e
        turned_n += c[8 + i] * n
        turned_e += c[8 + i] * e
    way_n, way_e = U * ahead_n, U * ahead_e
    north, east, by_north, by_east = 1.0, 1.0, 0.0, 0.0
    if geodetic:
        north = per_metre(x[0])[0]
        north, east, by_north, by_east = per_metre(x[0] + north * way_n / 2)
    f00, f10 = 1 + by_north * way_n, by_east * way_e
    f02, f03, f04 = north * ahead_n, -north * way_e, -north * U * turned_e
    f12, f13, f14 = east * ahead_e, east * way_n, east * U * turned_n
    slow, rest, turn = c[1], c[2], c[3]
    cn, ce = north * cosine, east * sine
    sn, se = -north * U * sine, east * U * cosine
    x[0] += north * way_n
    x[1] += east * way_e
    x[2] = slow * U
    x[3] = chi + turn * omega
    x[4] = rest * omega
    for j in range(5):
        A[0, j] = f00 * P[0, j] + f02 * P[2, j] + f03 * P[3, j] + f04 * P[4, j]
        A[1, j] = f10 * P[0, j] + P[1, j] + f12 * P[2, j] + f13 * P[3, j] + f14 * P[4, j]
    for j in range(2, 5):
        A[2, j] = slow * P[2, j]
        A[3, j] = P[3, j] + turn * P[4, j]
    P[0, 0] = f00 * A[0, 0] + f02 * A[0, 2] + f03 * A[0, 3] + f04 * A[0, 4]
    P[0, 1] = f10 * A[0, 0] + A[0, 1] + f12 * A[0, 2] + f13 * A[0, 3] + f14 * A[0, 4]
    P[1, 1] = f10 * A[1, 0] + A[1, 1] + f12 * A[1, 2] + f13 * A[1, 3] + f14 * A[1, 4]
    P[4, 4] = rest * rest * P[4, 4]
    for i in range(3):
        P[i, 2] = slow * A[i, 2]
    for i in range(4):
        P[i, 3] = A[i, 3] + turn * A[i, 4]
        P[i, 4] = rest * A[i, 4]
    P[0, 0] += cn * cn * c[11] + sn * sn * c[14]
    P[0, 1] += cn * ce * c[11] + sn * se * c[14]
    P[1, 1] += ce * ce * c[11] + se * se * c[14]
    P[0, 2] += cn * c[12]
    P[1, 2] += ce * c[12]
    P[2, 2] += c[13]
    P[0, 3] += sn * c[15]
    P[1, 3] += se * c[15]
    P[0, 4] += sn * c[16]
    P[1, 4] += se * c[16]
    P[3, 3] += c[17]
    P[3, 4] += c[18]
    P[4, 4] += c[19]
    for i in range(1, 5):
        for j in range(i):
            P[i, j] = P[j, i]


@njit(cache=True, error_model="numpy")
def _forget_course(x, P):
    """Nothing is known of the course any more: its variance is that of any angle."""
    for i in range(5):
        P[3, i] = P[i, 3] = 0.0
    P[3, 3] = UNIFORM


@njit(cache=True, error_model="numpy")
def advance(model, geodetic, c, x, P, A, dt):
    """State and covariance after `dt` [s], in place; `c` (COEFFICIENTS) and `A` (5, 5) are to work in."""
    # To the nanosecond, so that the steps of a clock that counts in fractions are one step.
    dt = np.round(dt * 1e9) / 1e9
    steps = max(1, int(np.ceil(dt / STEP - 1e-9)))
    h = dt / steps
    if h <= 0:
        return
    if c[0] != h:
        _prepare(model, h, c)
    for _ in range(steps):
        _inner(c, geodetic, x, P, A)
    if geodetic:
        x[1] = (x[1] + np.pi) % (2 * np.pi) - np.pi
    if P[3, 3] > UNIFORM:
        _forget_course(x, P)
