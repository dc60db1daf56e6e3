"""The loops of the compiled engine, by numba: the filter, linear, extended or unscented, and the smoother. See `compiled`."""

import zlib
from pathlib import Path

import numpy as np
from numba import njit

from aspnn.estimation import flow, kernels, problem
from aspnn.estimation.flow import NOISE_STEP, advance_points, flow_covariance, noise_of, steps_of
from aspnn.estimation.kernels import (
    ACCELERATION,
    CAA,
    CTRA6,
    POSITION,
    YAW_RATE,
    measure,
    measure_jacobian,
    still,
)
from aspnn.estimation.problem import AGAIN, COASTING, DOUBTED, REACQUIRED, REJECTED, REJECTIONS, USED

# numba's cache sees no change of what a function takes from other modules; as a constant of the engine this makes it see.
SOURCES = zlib.crc32(b"".join(Path(str(module.__file__)).read_bytes() for module in (kernels, flow, problem)))


@njit(cache=True, error_model="numpy")
def _root(P, L):
    """L (d, d) lower triangular with L L' = P; a direction without variance gets none, so that nothing fails."""
    d = P.shape[0]
    for j in range(d):
        for i in range(j):
            L[i, j] = 0.0
        for i in range(j, d):
            total = P[i, j]
            for m in range(j):
                total -= L[i, m] * L[j, m]
            if i == j:
                L[j, j] = np.sqrt(total) if total > 0 else 0.0
            else:
                L[i, j] = total / L[j, j] if L[j, j] > 0 else 0.0


@njit(cache=True, error_model="numpy")
def _points(x, P, spread, L, X):
    """X (d, 2 d + 1): x, then x + and x - the columns of the root of `spread` P."""
    d = P.shape[0]
    _root(P, L)
    scale = np.sqrt(spread)
    for i in range(d):
        X[i, 0] = x[i]
        for j in range(d):
            X[i, 1 + j], X[i, 1 + d + j] = x[i] + scale * L[i, j], x[i] - scale * L[i, j]


def _filter_of(states: int, sources: int):
    """The filter of linear problems of so many states, or of any MotionModel (`states` 0), compiled on its first call."""
    linear = states > 0

    @njit(cache=True, error_model="numpy", nogil=True)
    def kalman(start, data, model, limits, out):
        assert sources  # see SOURCES
        x0, P0, last, rejections, given_in = start
        time, z, R, angle, gates, group, place, rate = data
        F, Q, H, span, given, sensors, stations, inflation, density, kind, least, order, step, spread, wm, wc = model
        factor, threshold, spreads = limits
        xp, Pp, xf, Pf, innovation, whitened, nis, fate, cross = out
        n, blocks = z.shape[0], z.shape[1]
        d = states if linear else len(x0)
        points = 2 * d + 1
        x, P, A, h = x0.copy(), P0.copy(), np.empty((d, d)), np.zeros((2, d))
        G, K = np.empty((2, d)), np.empty((2, d))
        unscented, crossing = len(wm) > 0, len(cross) > 0
        one, reading, work = np.empty((d, 1)), np.empty((2, 1)), np.empty((6, d, d + 1))
        p, noise, old, later = np.empty(7), density.copy(), np.empty(d), np.empty(d)
        Phi = np.empty((d, d)) if crossing and not unscented else np.empty((0, 0))
        narrow = np.empty((4, d, d + 1 - still(kind)))
        size = points if unscented else 0
        X, Y, before = np.empty((d, size)), np.empty((d, size)), np.empty((d, size))
        slope, slopes, readings = np.empty((d, size)), np.empty((d, size)), np.empty((2, size))
        likelihood = 0.0
        for k in range(n):
            if linear:
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
            elif k > 0 and time[k] > time[k - 1]:
                dt = time[k] - time[k - 1]
                rest = x[4] if d == 8 else given[k - 1, 0]
                p[3], p[4] = np.cos(rest), np.sin(rest)
                for i in range(d):
                    noise[i] = density[i] * inflation[k]
                    old[i] = later[i] = x[i]
                if unscented:
                    _points(x, P, spread, A, X)
                    before[:] = X
                    advance_points(
                        kind, least, given[k - 1], 0.0, dt, order, steps_of(dt, step), p, X, slope, Y, slopes
                    )
                    for i in range(d):
                        x[i] = 0.0
                        for j in range(points):
                            x[i] += wm[j] * X[i, j]
                        for j in range(points):
                            X[i, j] -= x[i]
                    # The noise on the way, from the mean: E21
                    if dt <= NOISE_STEP:
                        noise_of(kind, least, given[k - 1], 0.0, dt, noise, p, old, x, A, work[0], work[1])
                    else:
                        A[:] = 0.0
                        flow_covariance(kind, least, given[k - 1], dt, 4, dt, noise, p, later, A, Phi, work, narrow)
                    for i in range(d):
                        for j in range(i, d):
                            total = A[i, j]
                            for m in range(points):
                                total += wc[m] * X[i, m] * X[j, m]
                            P[i, j] = total
                            P[j, i] = total
                    if crossing:
                        for i in range(d):
                            for j in range(d):
                                for m in range(points):
                                    cross[k, i, j] += wc[m] * (before[i, m] - old[i]) * X[j, m]
                else:
                    if crossing:
                        A[:] = P
                    flow_covariance(kind, least, given[k - 1], dt, order, step, noise, p, x, P, Phi, work, narrow)
                    if crossing:
                        for i in range(d):
                            for j in range(d):
                                for m in range(d):
                                    cross[k, i, j] += A[i, m] * Phi[j, m]
            for i in range(d):
                xp[k, i] = x[i]
                for j in range(d):
                    Pp[k, i, j] = P[i, j]
            doubted = False
            for b in range(blocks):
                have0, have1 = np.isfinite(z[k, b, 0]), np.isfinite(z[k, b, 1])
                rows = int(have0) + int(have1)
                if rows == 0:
                    continue
                # A missing row measures nothing: H = 0, R = 1, innovation 0.
                y0, y1 = z[k, b, 0], z[k, b, 1]
                r00, r11, r01 = R[k, b, 0, 0], R[k, b, 1, 1], R[k, b, 0, 1]
                if rows == 1:
                    r01 = 0.0
                    if have0:
                        r11 = 1.0
                    else:
                        r00 = 1.0
                curved, low, high = False, 0, d
                if linear:
                    low, high = span[b, 0], span[b, 1]
                    for j in range(low, high):
                        h[0, j] = H[k, b, 0, j] if have0 else 0.0
                        h[1, j] = H[k, b, 1, j] if have1 else 0.0
                        y0 -= h[0, j] * x[j]
                        y1 -= h[1, j] * x[j]
                else:
                    sensor, ahead, starboard = sensors[b], stations[b, 0], stations[b, 1]
                    bent = ahead != 0 or starboard != 0
                    if sensor != ACCELERATION and not (sensor == POSITION and bent):  # it reads states as they are
                        low = 0 if sensor == POSITION or kind == CAA else 4
                        low += int(sensor == YAW_RATE)
                        high = low + (2 if sensor == POSITION else 1)
                        y0 -= x[low]
                        h[0, low], h[1, low] = 1.0 if have0 else 0.0, 0.0
                        if sensor == POSITION:
                            y1 -= x[1]
                            h[0, 1], h[1, 1] = 0.0, 1.0 if have1 else 0.0
                    else:
                        for i in range(d):
                            one[i, 0] = x[i]
                        rest = x[4] if d == 8 else given[k, 0]
                        p[0], p[1], p[2] = given[k, 0], given[k, 1], given[k, 2]
                        p[3] = p[5] = np.cos(rest)
                        p[4] = p[6] = np.sin(rest)
                        # Where a sensor is linear in the state the unscented update is the linear one.
                        curved = unscented and (d == 8 if sensor == POSITION else kind != CTRA6)
                        if not curved:
                            measure(kind, least, one, p, sensor, ahead, starboard, reading)
                            measure_jacobian(kind, least, one, p, sensor, ahead, starboard, h)
                            y0 -= reading[0, 0]
                            y1 -= reading[1, 0]
                            low, high = d, 0
                            for j in range(d):
                                if h[0, j] != 0.0 or h[1, j] != 0.0:
                                    low, high = min(low, j), j + 1
                                h[0, j] = h[0, j] if have0 else 0.0
                                h[1, j] = h[1, j] if have1 else 0.0
                y0, y1 = y0 if have0 else 0.0, y1 if have1 else 0.0
                if angle[b]:
                    y0 = (y0 + np.pi) % (2 * np.pi) - np.pi
                worst, g = gates[b, rows - 1], group[b]
                taken = USED
                doubt0, doubt1 = factor if have0 else 1.0, factor if have1 else 1.0
                if doubted and spreads:
                    r00, r01, r11, taken = doubt0 * r00, factor * r01, doubt1 * r11, DOUBTED
                while True:  # once, or twice when a value is doubted or the filter re-acquires
                    s00, s01, s11 = r00, r01, r11
                    if not linear and curved:
                        _points(x, P, spread, A, X)
                        measure(kind, least, X, p, sensor, ahead, starboard, readings)
                        mean0, mean1 = 0.0, 0.0
                        for j in range(points):
                            mean0 += wm[j] * readings[0, j]
                            mean1 += wm[j] * readings[1, j]
                        y0, y1 = z[k, b, 0] - mean0 if have0 else 0.0, z[k, b, 1] - mean1 if have1 else 0.0
                        for j in range(points):
                            readings[0, j] = readings[0, j] - mean0 if have0 else 0.0
                            readings[1, j] = readings[1, j] - mean1 if have1 else 0.0
                            s00 += wc[j] * readings[0, j] * readings[0, j]
                            s01 += wc[j] * readings[0, j] * readings[1, j]
                            s11 += wc[j] * readings[1, j] * readings[1, j]
                        for i in range(d):
                            g0, g1 = 0.0, 0.0
                            for j in range(points):
                                g0 += wc[j] * (X[i, j] - x[i]) * readings[0, j]
                                g1 += wc[j] * (X[i, j] - x[i]) * readings[1, j]
                            G[0, i], G[1, i] = g0, g1
                    else:
                        for i in range(d):
                            g0, g1 = 0.0, 0.0
                            for j in range(low, high):
                                g0 += P[i, j] * h[0, j]
                                g1 += P[i, j] * h[1, j]
                            G[0, i], G[1, i] = g0, g1
                        for j in range(low, high):
                            s00 += h[0, j] * G[0, j]
                            s01 += h[0, j] * G[1, j]
                            s11 += h[1, j] * G[1, j]
                    determinant = s00 * s11 - s01 * s01
                    i00, i01, i11 = s11 / determinant, -s01 / determinant, s00 / determinant
                    square = y0 * y0 * i00 + 2 * y0 * y1 * i01 + y1 * y1 * i11
                    if taken != USED or (square <= worst and abs(y0) <= threshold and abs(y1) <= threshold):
                        break
                    if factor < np.inf:
                        r00, r01, r11, taken, doubted = doubt0 * r00, factor * r01, doubt1 * r11, DOUBTED, True
                        continue
                    if rejections[g] < REJECTIONS or time[k] - last[g] < COASTING:
                        taken = REJECTED
                        break
                    # So wide may the place be wrong; and if that is not the first time, its rate.
                    taken = REACQUIRED
                    away = y0 * y0 + y1 * y1
                    faster = 1.0 / (time[k] - last[g]) ** 2 if time[k] - given_in[g] < AGAIN else 0.0
                    given_in[g] = time[k]
                    for i in range(d):
                        wider = away * (place[b, i] + rate[b, i] * faster)
                        P[i, i] += wider
                        Pp[k, i, i] += wider
                likelihood -= 0.5 * (rows * np.log(2 * np.pi) + np.log(determinant) + min(square, worst))
                if have0:
                    innovation[k, b, 0], whitened[k, b, 0] = y0, y0 / np.sqrt(s00)
                if have1:
                    innovation[k, b, 1] = y1
                    whitened[k, b, 1] = (y1 - s01 / s00 * y0) / np.sqrt(s11 - s01 * s01 / s00)
                nis[k, b] = square
                fate[k, b] = taken
                if taken == REJECTED:
                    rejections[g] += 1
                    continue
                last[g], rejections[g] = time[k], 0
                for i in range(d):
                    K[0, i] = G[0, i] * i00 + G[1, i] * i01
                    K[1, i] = G[0, i] * i01 + G[1, i] * i11
                    x[i] += K[0, i] * y0 + K[1, i] * y1
                # Joseph form: A = (I - K H) P, then P = A (I - K H)' + K R K' = A + (K R - A H') K'
                for i in range(d):
                    for j in range(d):
                        A[i, j] = P[i, j] - K[0, i] * G[0, j] - K[1, i] * G[1, j]
                if not linear and curved:  # K S = G: P - K S K'
                    for i in range(d):
                        for j in range(d):
                            P[i, j] = 0.5 * (A[i, j] + A[j, i])
                    continue
                for i in range(d):
                    w0 = K[0, i] * r00 + K[1, i] * r01
                    w1 = K[0, i] * r01 + K[1, i] * r11
                    for j in range(low, high):
                        w0 -= A[i, j] * h[0, j]
                        w1 -= A[i, j] * h[1, j]
                    for j in range(d):
                        P[i, j] = A[i, j] + w0 * K[0, j] + w1 * K[1, j]
            for i in range(d):
                xf[k, i] = x[i]
                for j in range(d):
                    Pf[k, i, j] = P[i, j]
        return likelihood

    return kalman


FILTERS = {states: _filter_of(states, SOURCES) for states in (0, 3, 6)}


@njit(cache=True, error_model="numpy", nogil=True)
def rts(cross, xp, Pp, xf, Pf):
    """Smoothed means (n, d) and covariances (n, d, d) from those of a filter: C = cross Pp^-1, x_s += C (x_s' - xp'), from the end."""
    n, d = xf.shape
    xs, Ps = xf.copy(), Pf.copy()
    L, C, D = np.zeros((d, d)), np.zeros((d, d)), np.zeros((d, d))
    for k in range(n - 2, -1, -1):
        _root(Pp[k + 1], L)
        # C' = Pp^-1 cross' by the two triangular systems, one column at a time
        for c in range(d):
            for i in range(d):
                total = cross[k + 1, c, i]
                for m in range(i):
                    total -= L[i, m] * C[c, m]
                C[c, i] = total / L[i, i] if L[i, i] > 0 else 0.0
            for i in range(d - 1, -1, -1):
                total = C[c, i]
                for m in range(i + 1, d):
                    total -= L[m, i] * C[c, m]
                C[c, i] = total / L[i, i] if L[i, i] > 0 else 0.0
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
