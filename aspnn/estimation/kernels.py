"""The equations of the nonlinear motion models, compiled: drift and its tangent, measurements and their Jacobian.

Each is written once, here; both engines and every test call these. States are columns: `x` is (d, s), s points at once.
`p` (7) holds, at the instant of the call, heading [rad], yaw rate and yaw acceleration as given from outside (models of six
states are fed by CAA), cosine and sine of the heading that stands for the path's direction at rest, and those of the first
column's heading. `kind` is one of the numbers below.
"""

import numpy as np
from numba import njit

LINEAR, CAA, CTRA6, CTRA8, CMM6, CMM8 = range(6)
POSITION, HEADING, YAW_RATE, ACCELERATION = range(4)  # what a sensor tells


@njit(cache=True, error_model="numpy")
def moving(kind):
    """How many states drift; the others, last in order, are constant but for noise, and nobody writes their drift."""
    if kind == CAA:
        return 2
    return 5 if kind in (CTRA8, CMM8) else 4


@njit(cache=True, error_model="numpy")
def still(kind):
    """How many states, first in order, no drift depends on: the place, of CAA the heading."""
    return 1 if kind == CAA else 2


@njit(cache=True, error_model="numpy")
def turn_of(kind, x, j, p):
    """Heading, yaw rate and yaw acceleration of column j."""
    if kind == CAA:
        return x[0, j], x[1, j], x[2, j]
    if kind in (CTRA8, CMM8):
        return x[4, j], x[5, j], 0.0
    return p[0], p[1], p[2]


@njit(cache=True, error_model="numpy")
def path_direction(v_n, v_e, p, least):
    """Unit vector along the path, (v V + V0^2 e) / (V^2 + V0^2): that of the velocity, and e = p[3:5] at rest (E16).

    The printed v / V jumps at rest; this one is smooth, and differs from it by (V0 / V)^2.
    """
    squared = v_n * v_n + v_e * v_e
    speed, rest = np.sqrt(squared), least * least
    return (v_n * speed + rest * p[3]) / (squared + rest), (v_e * speed + rest * p[4]) / (squared + rest)


@njit(cache=True, error_model="numpy")
def direction_slopes(v_n, v_e, p, least):
    """d(f_N, f_E) / d(v_N, v_E) of `path_direction`: f_N,N, f_N,E, f_E,N, f_E,E."""
    squared = v_n * v_n + v_e * v_e
    speed, w = np.sqrt(squared), 1.0 / (squared + least * least)
    f_n, f_e = path_direction(v_n, v_e, p, least)
    over = 1.0 / speed if speed > 0 else 0.0
    return (
        w * (speed + v_n * v_n * over - 2 * v_n * f_n),
        w * (v_n * v_e * over - 2 * v_e * f_n),
        w * (v_n * v_e * over - 2 * v_n * f_e),
        w * (speed + v_e * v_e * over - 2 * v_e * f_e),
    )


@njit(cache=True, error_model="numpy")
def drift(kind, least, x, p, out):
    """out (d, s) = dx / dt, the first `moving` rows of it.

    CAA (thesis 3.32): psi' = r, r'' = 0. CTRA (thesis 3.30, E4): place' = R(psi) (u, v), (u, v)' = (a_u, a_v), psi' = r. CMM
    (thesis 3.28): place' = v, v' = a_t f + a_n f_perp with f along the path and f_perp to its starboard, psi' = r.
    """
    if kind == CAA:
        for j in range(x.shape[1]):
            out[0, j], out[1, j] = x[1, j], x[2, j]
    elif kind in (CTRA6, CTRA8):
        a = 4 if kind == CTRA6 else 6
        c, s = p[5], p[6]
        for j in range(x.shape[1]):
            if kind == CTRA8:
                if j > 0:
                    c, s = np.cos(x[4, j]), np.sin(x[4, j])
                out[4, j] = x[5, j]
            out[0, j] = c * x[2, j] - s * x[3, j]
            out[1, j] = s * x[2, j] + c * x[3, j]
            out[2, j], out[3, j] = x[a, j], x[a + 1, j]
    else:
        a = 4 if kind == CMM6 else 6
        for j in range(x.shape[1]):
            f_n, f_e = path_direction(x[2, j], x[3, j], p, least)
            out[0, j], out[1, j] = x[2, j], x[3, j]
            out[2, j] = x[a, j] * f_n - x[a + 1, j] * f_e
            out[3, j] = x[a, j] * f_e + x[a + 1, j] * f_n
        if kind == CMM8:
            for j in range(x.shape[1]):
                out[4, j] = x[5, j]


@njit(cache=True, error_model="numpy")
def tangent(kind, least, p, Y, out):
    """out (d, m + 1) = [F Y, f]: what the columns of Y (d, m + 1) become at first, F (d, d) = d drift / dx.

    The first `moving` rows are written. The last column of Y is the state itself and the last of out its drift, so that both run on in one sweep.
    """
    m = Y.shape[1] - 1
    if kind == CAA:
        for j in range(m + 1):
            out[0, j], out[1, j] = Y[1, j], Y[2, j]
        return
    turning = kind in (CTRA8, CMM8)
    a = 6 if turning else 4
    if kind in (CTRA6, CTRA8):
        c, s = p[5], p[6]
        for j in range(m + 1):
            out[0, j], out[1, j] = c * Y[2, j] - s * Y[3, j], s * Y[2, j] + c * Y[3, j]
            out[2, j], out[3, j] = Y[a, j], Y[a + 1, j]
        if turning:
            north, east = -out[1, m], out[0, m]  # d(place') / d psi
            for j in range(m):
                out[0, j] += north * Y[4, j]
                out[1, j] += east * Y[4, j]
    else:
        along, across = Y[a, m], Y[a + 1, m]
        f_n, f_e = path_direction(Y[2, m], Y[3, m], p, least)
        nn, ne, en, ee = direction_slopes(Y[2, m], Y[3, m], p, least)
        north_n, north_e = along * nn - across * en, along * ne - across * ee
        east_n, east_e = along * en + across * nn, along * ee + across * ne
        for j in range(m + 1):
            out[0, j], out[1, j] = Y[2, j], Y[3, j]
            out[2, j] = f_n * Y[a, j] - f_e * Y[a + 1, j]
            out[3, j] = f_e * Y[a, j] + f_n * Y[a + 1, j]
        for j in range(m):
            out[2, j] += north_n * Y[2, j] + north_e * Y[3, j]
            out[3, j] += east_n * Y[2, j] + east_e * Y[3, j]
    if turning:
        for j in range(m + 1):
            out[4, j] = Y[5, j]


@njit(cache=True, error_model="numpy")
def measure(kind, least, x, p, sensor, ahead, starboard, out):
    """out (2, s): what `sensor` at the station (ahead, starboard) [m] reads; the second row is 0 for heading and yaw rate.

    Positions: place + R(psi) station (E7). Accelerometers: a_u - v r, a_v + u r at the reference point (thesis 3.39, E1, E2),
    for CMM z_au = a_N cos psi + a_E sin psi, z_av = -a_N sin psi + a_E cos psi (E3), and moved to the station:
    - r' Y - r^2 X, + r' X - r^2 Y (E5).
    """
    a = 4 if kind in (CTRA6, CMM6) else 6
    for j in range(x.shape[1]):
        psi, r, turn = turn_of(kind, x, j, p)
        c, s = p[5], p[6]
        if j > 0 and sensor != HEADING and sensor != YAW_RATE:
            c, s = np.cos(psi), np.sin(psi)
        if sensor in (HEADING, YAW_RATE):
            out[0, j], out[1, j] = psi if sensor == HEADING else r, 0.0
        elif sensor == POSITION:
            out[0, j] = x[0, j] + c * ahead - s * starboard
            out[1, j] = x[1, j] + s * ahead + c * starboard
        else:
            if kind in (CTRA6, CTRA8):
                forward, sideways = x[a, j] - x[3, j] * r, x[a + 1, j] + x[2, j] * r
            else:
                f_n, f_e = path_direction(x[2, j], x[3, j], p, least)
                a_n, a_e = x[a, j] * f_n - x[a + 1, j] * f_e, x[a, j] * f_e + x[a + 1, j] * f_n
                forward, sideways = c * a_n + s * a_e, c * a_e - s * a_n
            out[0, j] = forward - turn * starboard - r * r * ahead
            out[1, j] = sideways + turn * ahead - r * r * starboard


@njit(cache=True, error_model="numpy")
def measure_jacobian(kind, least, x, p, sensor, ahead, starboard, H):
    """H (2, d) = d measure / dx at the first column of x."""
    for j in range(H.shape[1]):
        H[0, j], H[1, j] = 0.0, 0.0
    turning = kind in (CTRA8, CMM8)
    if sensor in (HEADING, YAW_RATE):
        H[0, (0 if kind == CAA else 4) + (0 if sensor == HEADING else 1)] = 1.0
        return
    _, r, _ = turn_of(kind, x, 0, p)
    c, s = p[5], p[6]
    if sensor == POSITION:
        H[0, 0] = H[1, 1] = 1.0
        if turning:
            H[0, 4], H[1, 4] = -s * ahead - c * starboard, c * ahead - s * starboard
        return
    a = 6 if turning else 4
    if kind in (CTRA6, CTRA8):
        H[0, a] = H[1, a + 1] = 1.0
        H[0, 3], H[1, 2] = -r, r
        if turning:
            H[0, 5], H[1, 5] = -x[3, 0] - 2 * r * ahead, x[2, 0] - 2 * r * starboard
        return
    along, across = x[a, 0], x[a + 1, 0]
    f_n, f_e = path_direction(x[2, 0], x[3, 0], p, least)
    nn, ne, en, ee = direction_slopes(x[2, 0], x[3, 0], p, least)
    # d(a_N, a_E) by v_N, v_E, a_t, a_n, turned into the hull's axes
    north = (along * nn - across * en, along * ne - across * ee, f_n, -f_e)
    east = (along * en + across * nn, along * ee + across * ne, f_e, f_n)
    columns = (2, 3, a, a + 1)
    for i in range(4):
        H[0, columns[i]] = c * north[i] + s * east[i]
        H[1, columns[i]] = c * east[i] - s * north[i]
    if turning:
        a_n, a_e = along * f_n - across * f_e, along * f_e + across * f_n
        H[0, 4], H[1, 4] = c * a_e - s * a_n, -c * a_n - s * a_e
        H[0, 5], H[1, 5] = -2 * r * ahead, -2 * r * starboard
