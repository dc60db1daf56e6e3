"""The compiled loop of the error-state filter: strapdown and the covariance of its error, and the blocks that correct them."""

import math

import numpy as np
from numba import njit

from aspnn.estimation.attitude import angles, rotation, turn
from aspnn.estimation.spatial_engine import SOURCES, absorb, workspace


@njit(cache=True, error_model="numpy")
def advance(nominal, q, C, P, force, rates, before, dt, numbers, work):
    """Move nominal motion (p, v, biases: 12), attitude and P over `dt`; `before` (10) force and rates a step ago, rates two steps
    ago and the time between those two. `numbers` are densities of the noise of force and rates and of the walks of their biases,
    densities where no force and where no rate is known, and gravity.

    v' = C (f - b) + g, C' = C [w - c]x; their errors: dv' = -C [f - b]x e - C db, e' = -[w - c]x e - dc, e about ship axes.
    Forces run straight between samples. Rates run along the parabola through three, as roll in waves needs at a few samples a
    second, and turn about each other: + dt^2 / 12 w0 x w1 (coning). P goes by the matrix of the whole step.
    """
    Phi, A, turned, f, w = work
    d = P.shape[0]
    felt, spun = np.isfinite(force[0]) and np.isfinite(before[0]), np.isfinite(rates[0]) and np.isfinite(before[3])
    earlier = before[9]  # s between the two samples before
    for i in range(3):
        w[i] = 0.0
        if spun:
            w[i] = dt * ((before[3 + i] + rates[i]) / 2 - nominal[9 + i])
            j, m = (i + 1) % 3, (i + 2) % 3
            w[i] += dt * dt / 12 * (before[3 + j] * rates[m] - before[3 + m] * rates[j])
            if np.isfinite(before[6]) and earlier > 0:
                curve = (rates[i] - before[3 + i]) / dt - (before[3 + i] - before[6 + i]) / earlier
                w[i] -= dt**3 / 6 * curve / (dt + earlier)
    for i in range(3):
        f[i] = 0.0
        for j in range(3):  # C before the turn, force before
            f[i] += C[i, j] * (before[j] - nominal[6 + j]) if felt else 0.0
        f[i] += numbers[6] if felt and i == 2 else 0.0
    turn(q, w[0], w[1], w[2])
    for i in range(3):
        for j in range(3):
            turned[i, j] = C[i, j]
    rotation(q, C)
    for i in range(3):
        late = 0.0
        for j in range(3):
            late += C[i, j] * (force[j] - nominal[6 + j]) if felt else 0.0
        late += numbers[6] if felt and i == 2 else 0.0
        nominal[i] += dt * nominal[3 + i] + dt * dt * (2 * f[i] + late) / 6
        nominal[3 + i] += dt * (f[i] + late) / 2
    for i in range(d):
        for j in range(d):
            Phi[i, j] = 1.0 if i == j else 0.0
    for i in range(3):
        Phi[i, 3 + i] = dt
        Phi[6 + i, 12 + i] = -dt if spun else 0.0
        if felt:
            for j in range(3):
                mean = (turned[i, j] + C[i, j]) / 2
                Phi[3 + i, 9 + j], Phi[i, 9 + j] = -dt * mean, -dt * dt * mean / 2
    # -[w]x over the step, and -C [f]x in ship axes of the mean force
    Phi[6, 7], Phi[6, 8], Phi[7, 6], Phi[7, 8], Phi[8, 6], Phi[8, 7] = w[2], -w[1], -w[2], w[0], w[1], -w[0]
    if felt:
        x = (before[0] + force[0]) / 2 - nominal[6]
        y = (before[1] + force[1]) / 2 - nominal[7]
        z = (before[2] + force[2]) / 2 - nominal[8]
        for i in range(3):
            a, b, c = (turned[i, 0] + C[i, 0]) / 2, (turned[i, 1] + C[i, 1]) / 2, (turned[i, 2] + C[i, 2]) / 2
            Phi[3 + i, 6], Phi[3 + i, 7], Phi[3 + i, 8] = (
                -dt * (b * z - c * y),
                -dt * (c * x - a * z),
                -dt * (a * y - b * x),
            )
            for j in range(3):
                Phi[i, 6 + j] = dt / 2 * Phi[3 + i, 6 + j]
                Phi[3 + i, 12 + j] = -dt / 2 * Phi[3 + i, 6 + j] if spun else 0.0
    # P = Phi P Phi' with Phi zero left of the diagonal but in the rows 6 to 8
    for i in range(d):
        start = 6 if 6 <= i < 9 else i
        for j in range(d):
            A[i, j] = 0.0
        for c in range(start, d):
            if Phi[i, c] != 0.0:
                for j in range(d):
                    A[i, j] += Phi[i, c] * P[c, j]
    for i in range(d):
        for j in range(i + 1):
            P[i, j] = 0.0
        start = 6 if 6 <= i < 9 else i
        for c in range(start, d):
            if Phi[i, c] != 0.0:
                for j in range(i + 1):
                    P[i, j] += A[j, c] * Phi[i, c]
    for i in range(d):
        for j in range(i):
            P[j, i] = P[i, j]
    s, g = numbers[0 if felt else 4], numbers[1 if spun else 5]
    for i in range(3):
        P[i, i] += s * dt**3 / 3
        P[i, 3 + i] += s * dt**2 / 2
        P[3 + i, i] += s * dt**2 / 2
        P[3 + i, 3 + i] += s * dt
        P[6 + i, 6 + i] += g * dt
        P[9 + i, 9 + i] += numbers[2] * dt
        P[12 + i, 12 + i] += numbers[3] * dt


@njit(cache=True, error_model="numpy", nogil=True)
def strapdown(
    time, force, rates, numbers, z, H, span, R, arms, limits, group, place, rate, late, x, q, P, gone, outs, out
):
    """Run the filter on: `x` (12) nominal place, velocity, biases, `q` attitude, P; the last two blocks are those of the attitude."""
    assert SOURCES
    last, rejections, given_in = gone
    means, covariances, euler, spread, before = outs
    n, blocks, d = z.shape[0], z.shape[1], P.shape[0]
    antennas = blocks - 2
    work, y, shift, h = workspace(d), np.empty(3), np.empty(d), np.zeros((3, d))
    room = np.empty((d, d)), np.empty((d, d)), np.empty((3, 3)), np.empty(3), np.empty(3)
    C, t, arm, f, w = np.empty((3, 3)), time[0], np.empty(3), np.empty(3), np.empty(3)
    rotation(q, C)
    likelihood = 0.0
    for k in range(n):
        dt = time[k] - t
        t = time[k]
        if dt > 0:
            advance(x, q, C, P, force[k], rates[k], before, dt, numbers, room)
        for i in range(3):
            before[i], before[6 + i], before[3 + i] = force[k, i], before[3 + i], rates[k, i]
        before[9] = dt
        for b in range(blocks):
            low, high = span[b, 0], span[b, 1]
            roll, pitch, psi = angles(C)
            if b < antennas:
                slow = -H[b, 0, 3]  # s, how late
                for i in range(3):
                    w[i] = rates[k, i] - x[9 + i] if np.isfinite(rates[k, i]) else 0.0
                    f[i] = force[k, i] - x[6 + i] if np.isfinite(force[k, i]) else 0.0
                for i in range(3):
                    m, c = (i + 1) % 3, (i + 2) % 3
                    arm[i] = arms[b, i] - slow * (w[m] * arms[b, c] - w[c] * arms[b, m])
                for i in range(3):
                    felt = C[i, 0] * f[0] + C[i, 1] * f[1] + C[i, 2] * f[2] + (numbers[6] if i == 2 else 0.0)
                    back = slow * slow / 2 * felt if np.isfinite(force[k, 0]) else 0.0
                    # C l then, and what a rotation about the ship's axes does to it: -C [l]x
                    there = C[i, 0] * arm[0] + C[i, 1] * arm[1] + C[i, 2] * arm[2]
                    y[i] = z[k, b, i] - there - x[i] - back
                    for j in range(6):
                        h[i, j] = H[b, i, j]
                    for j in range(3, 6):
                        y[i] -= H[b, i, j] * x[j]
                    h[i, 6] = -(C[i, 1] * arm[2] - C[i, 2] * arm[1])
                    h[i, 7] = -(C[i, 2] * arm[0] - C[i, 0] * arm[2])
                    h[i, 8] = -(C[i, 0] * arm[1] - C[i, 1] * arm[0])
            elif b == antennas:
                y[1] = y[2] = np.nan
                swing = 0.0
                if np.isfinite(rates[k, 0]):
                    swing = math.sin(roll) * (rates[k, 1] - x[10]) + math.cos(roll) * (rates[k, 2] - x[11])
                y[0] = z[k, b, 0] - psi + late * swing / math.cos(pitch)
                y[0] = (y[0] + np.pi) % (2 * np.pi) - np.pi
                h[0, 6], h[0, 7], h[0, 8] = 0.0, math.sin(roll) / math.cos(pitch), math.cos(roll) / math.cos(pitch)
            else:
                y[0], y[1], y[2] = z[k, b, 0] - roll, z[k, b, 1] - pitch, np.nan
                h[0, 6], h[0, 7], h[0, 8] = 1.0, math.tan(pitch) * math.sin(roll), math.tan(pitch) * math.cos(roll)
                h[1, 6], h[1, 7], h[1, 8] = 0.0, math.cos(roll), -math.sin(roll)
            likelihood += absorb(
                *(time[k], k, b, y, h, R[k, b], low, high, P, shift, limits, place, rate, group),
                *(last, rejections, given_in, work, out),
            )
            for i in range(6):
                x[i] += shift[i]
                x[6 + i] += shift[9 + i]
            turn(q, shift[6], shift[7], shift[8])
            rotation(q, C)
        roll, pitch, psi = angles(C)
        euler[k, 0], euler[k, 1], euler[k, 2] = roll, pitch, psi
        h[0, 6], h[0, 7], h[0, 8] = 1.0, math.tan(pitch) * math.sin(roll), math.tan(pitch) * math.cos(roll)
        h[1, 6], h[1, 7], h[1, 8] = 0.0, math.cos(roll), -math.sin(roll)
        h[2, 6], h[2, 7], h[2, 8] = 0.0, math.sin(roll) / math.cos(pitch), math.cos(roll) / math.cos(pitch)
        for i in range(3):
            total = 0.0
            for j in range(6, 9):
                for c in range(6, 9):
                    total += h[i, j] * P[j, c] * h[i, c]
            spread[k, i] = math.sqrt(total)
        for i in range(12):
            means[k, i] = x[i]
        for i in range(6):
            for j in range(6):
                covariances[k, i, j] = P[i, j]
    return likelihood
