"""The course filter compiled by numba: one fix or none at a time, for many ships or along a log.

A ship follows or is lost. She follows while the filter knows her course; else (at the start, at rest, after fixes that it could
not believe) her speed and course are those of a line through her recent fixes, until that line tells a direction.
"""

import zlib
from pathlib import Path

import numpy as np
from numba import njit

from aspnn.estimation import course_model, course_step, problem
from aspnn.estimation.course_step import COEFFICIENTS, UNIFORM, advance, per_metre
from aspnn.estimation.problem import COASTING, MISSING, OUTLIER, REACQUIRED, REJECTED, REJECTIONS, USED, gate

# numba's cache sees no change of what a function takes from other modules; as a constant of those below this makes it see.
SOURCES = zlib.crc32(
    b"".join(Path(str(module.__file__)).read_bytes() for module in (course_model, course_step, problem))
)
GATE = gate(OUTLIER)[1]
LOST = 1.0  # rad^2: with so large a variance of its course a filter of first order follows nothing
TELLS = 4.0  # a line tells a direction when its speed is so many of its standard deviations, that is within 14 degrees
FEWEST = 3  # fixes of a line that tells
RECENT = 10.0  # s after which a fix of a line counts less by 1/e,
HELD = 0.6  # but when the next one comes no less than this
GAP = 45.0  # s without a fix, after which a line begins anew
# What a ship's memory holds: of her line the weight and means of time, first and second coordinate, the sums of squares and products
# about them, the number of fixes; then the time of the last fix and of the last used one, rejections in a row, fixes that were used
# since the filter gave in, whether she follows, and the time of the state.
WEIGHT, TIME, FIRST, SECOND, SQUARE, BY_FIRST, BY_SECOND, COUNT, FIX, LAST, REJECTED_, SINCE, FOLLOWS, NOW = range(14)
MEMORY = 14
SURE = 1e9  # fixes used since the filter gave in, when it never did


@njit(cache=True, error_model="numpy")
def _remember(m, geodetic, time, z0, z1):
    """Take a fix into the line through the recent ones."""
    gap = time - m[FIX]
    m[FIX] = time
    if m[COUNT] == 0 or gap > GAP:
        m[WEIGHT], m[COUNT], m[TIME], m[FIRST], m[SECOND] = 1.0, 1.0, time, z0, z1
        m[SQUARE], m[BY_FIRST], m[BY_SECOND] = 0.0, 0.0, 0.0
        return
    keep = max(np.exp(-gap / RECENT), HELD)
    weight = keep * m[WEIGHT] + 1.0
    dt, d0, d1 = time - m[TIME], z0 - m[FIRST], z1 - m[SECOND]
    if geodetic:
        d1 = (d1 + np.pi) % (2 * np.pi) - np.pi
    share = keep * m[WEIGHT] / weight
    m[SQUARE] = keep * m[SQUARE] + share * dt * dt
    m[BY_FIRST] = keep * m[BY_FIRST] + share * dt * d0
    m[BY_SECOND] = keep * m[BY_SECOND] + share * dt * d1
    m[TIME] += dt / weight
    m[FIRST] += d0 / weight
    m[SECOND] += d1 / weight
    m[WEIGHT] = weight
    m[COUNT] += 1.0


@njit(cache=True, error_model="numpy")
def _by_line(m, model, x, P, z0, z1, r0, r1, north, east):
    """A lost ship takes place, speed and course from her recent fixes; whether they tell a direction."""
    for i in range(5):
        for j in range(5):
            P[i, j] = 0.0
    x[0], x[1], x[4] = z0, z1, 0.0
    P[0, 0], P[1, 1] = r0, r1
    turning = model[1] / (2 * model[3])  # variance of a course rate of which nothing is known
    P[4, 4] = turning
    if m[COUNT] < 2:
        x[2] = 0.0
        P[2, 2], P[3, 3] = model[0] / (2 * model[2]), UNIFORM
        return False
    v_n, v_e = m[BY_FIRST] / m[SQUARE] / north, m[BY_SECOND] / m[SQUARE] / east
    variance = 0.5 * (r0 / (north * north) + r1 / (east * east)) / m[SQUARE]
    squared, lag = v_n * v_n + v_e * v_e, m[NOW] - m[TIME]
    x[2] = np.sqrt(squared)
    x[3] += (np.arctan2(v_e, v_n) - x[3] + np.pi) % (2 * np.pi) - np.pi
    tells = m[COUNT] >= FEWEST and squared > TELLS * TELLS * variance
    P[2, 2] = variance + model[0] * lag
    P[3, 3] = UNIFORM
    if tells:
        # A line is the course of a while ago.
        P[3, 3] = variance / squared + min(lag * lag * turning, LOST / 2)
        P[3, 4] = P[4, 3] = min(lag * turning, np.sqrt(LOST / 2 * turning))
    return tells


@njit(cache=True, error_model="numpy")
def _line_anew(m, time, z0, z1):
    m[WEIGHT], m[COUNT], m[TIME], m[FIRST], m[SECOND] = 1.0, 1.0, time, z0, z1
    m[SQUARE], m[BY_FIRST], m[BY_SECOND] = 0.0, 0.0, 0.0


@njit(cache=True, error_model="numpy")
def absorb(model, geodetic, variance, x, P, m, z0, z1, A, told):
    """Take a fix in at the state's time, in place; its fate. `told` (6): innovation, whitened, NIS, and what adds to log-likelihood."""
    time = m[NOW]
    north, east = 1.0, 1.0
    if geodetic:
        north, east, _, _ = per_metre(z0)
    r0, r1 = variance * north * north, variance * east * east
    for i in range(6):
        told[i] = np.nan
    _remember(m, geodetic, time, z0, z1)
    if m[FOLLOWS] == 0.0:
        m[FOLLOWS] = 1.0 if _by_line(m, model, x, P, z0, z1, r0, r1, north, east) else 0.0
        m[LAST], m[REJECTED_], m[SINCE] = time, 0.0, SURE
        return USED
    taken = USED
    s00, s01, s11, i00, i01, i11, square, determinant = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    y0, y1 = z0 - x[0], z1 - x[1]
    if geodetic:
        y1 = (y1 + np.pi) % (2 * np.pi) - np.pi
    while True:
        s00, s01, s11 = P[0, 0] + r0, P[0, 1], P[1, 1] + r1
        determinant = s00 * s11 - s01 * s01
        i00, i01, i11 = s11 / determinant, -s01 / determinant, s00 / determinant
        square = y0 * y0 * i00 + 2 * y0 * y1 * i01 + y1 * y1 * i11
        if square <= model[4] or taken != USED:
            break
        if m[REJECTED_] < REJECTIONS or time - m[LAST] < COASTING:
            taken = REJECTED
            break
        # The place was wrong; and if the filter gave in a moment ago, so is the velocity, and what the recent fixes tell counts.
        taken = REACQUIRED
        if m[SINCE] < FEWEST:
            m[FOLLOWS] = 0.0
        m[SINCE] = 0.0
        _line_anew(m, time, z0, z1)
        P[0, 0] += y0 * y0
        P[1, 1] += y1 * y1
        P[0, 1] += y0 * y1
        P[1, 0] = P[0, 1]
    told[0], told[1] = y0, y1
    told[2] = y0 / np.sqrt(s00)
    told[3] = (y1 - s01 / s00 * y0) / np.sqrt(s11 - s01 * s01 / s00)
    told[4] = square
    told[5] = -0.5 * (2 * np.log(2 * np.pi) + np.log(determinant / (north * east) ** 2) + min(square, model[4]))
    if taken == REJECTED:
        m[REJECTED_] += 1.0
        return taken
    m[LAST], m[REJECTED_] = time, 0.0
    m[SINCE] += 1.0
    # (I - K C) P (I - K C)' + K R K' with C the first two rows, whatever K; A holds K and these rows of P
    for i in range(5):
        A[i, 0], A[i, 1] = P[i, 0] * i00 + P[i, 1] * i01, P[i, 0] * i01 + P[i, 1] * i11
        A[i, 2], A[i, 3] = P[i, 0], P[i, 1]
        x[i] += A[i, 0] * y0 + A[i, 1] * y1
    for i in range(5):
        k0, k1 = A[i, 0], A[i, 1]
        for j in range(i + 1):
            w0, w1 = k0 * s00 + k1 * s01 - A[i, 2], k0 * s01 + k1 * s11 - A[i, 3]
            P[i, j] += w0 * A[j, 0] + w1 * A[j, 1] - k0 * A[j, 2] - k1 * A[j, 3]
    for i in range(5):
        for j in range(i):
            P[j, i] = P[i, j]
    if geodetic:
        x[1] = (x[1] + np.pi) % (2 * np.pi) - np.pi
    if x[2] < 0:  # (U, chi) and (-U, chi + pi) are one motion (E48)
        x[2] = -x[2]
        x[3] += np.pi
        for i in range(5):
            P[2, i] = -P[2, i]
            P[i, 2] = -P[i, 2]
    if P[3, 3] > LOST:
        m[FOLLOWS] = 0.0
    return taken


def _step_ships(sources: int):
    @njit(cache=True, error_model="numpy")
    def step_ships(model, geodetic, variance, x, P, m, c, A, told, time, first, second):
        """One step of b ships at once, in place: x (b, 5), P (b, 5, 5), m (b, MEMORY); fixes (b), NaN where there is none."""
        assert sources
        for k in range(len(x)):
            if m[k, COUNT] > 0:
                advance(model, geodetic, c, x[k], P[k], A, time - m[k, NOW])
            m[k, NOW] = time
            if np.isfinite(first[k]) and np.isfinite(second[k]):
                if m[k, COUNT] == 0:
                    x[k, 3] = 0.0
                absorb(model, geodetic, variance, x[k], P[k], m[k], first[k], second[k], A, told)

    return step_ships


def _run_log(sources: int):
    @njit(cache=True, error_model="numpy")
    def run_log(model, geodetic, variance, x, P, m, time, z, out):
        """Filter fixes z (n, 2) at `time` (n) from x, P and memory m on; fills what `course_log.Course` returns."""
        assert sources
        predicted, mean, covariance, innovation, whitened, nis, fate, lost = out
        c, A, told = np.zeros(COEFFICIENTS), np.empty((5, 5)), np.empty(6)
        likelihood = 0.0
        for k in range(len(time)):
            advance(model, geodetic, c, x, P, A, time[k] - m[NOW])
            m[NOW] = time[k]
            for i in range(5):
                predicted[k, i] = x[i]
            fate[k] = MISSING
            if np.isfinite(z[k, 0]) and np.isfinite(z[k, 1]):
                fate[k] = absorb(model, geodetic, variance, x, P, m, z[k, 0], z[k, 1], A, told)
                for i in range(2):
                    innovation[k, i], whitened[k, i] = told[i], told[2 + i]
                nis[k] = told[4]
                if np.isfinite(told[5]):
                    likelihood += told[5]
            lost[k] = m[FOLLOWS] == 0.0
            for i in range(5):
                mean[k, i] = x[i]
                for j in range(5):
                    covariance[k, i, j] = P[i, j]
        return likelihood

    return run_log


def _advance_all(sources: int):
    @njit(cache=True, error_model="numpy")
    def advance_all(model, geodetic, x, P, dt):
        """States x (n, 5) and covariances P (n, 5, 5) after `dt` [s], in place."""
        assert sources
        c, A = np.zeros(COEFFICIENTS), np.empty((5, 5))
        for k in range(len(x)):
            advance(model, geodetic, c, x[k], P[k], A, dt)

    return advance_all


step_ships, run_log, advance_all = _step_ships(SOURCES), _run_log(SOURCES), _advance_all(SOURCES)
