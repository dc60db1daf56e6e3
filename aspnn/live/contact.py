"""How probable it is that two hulls touch within the horizon, from the regions of both predicted paths. Deterministic.

The model. At each instant the error of the relative position of the midships is Gaussian, with C = C_own + C_target. In time an error
keeps its place in its region while the region grows: e(t) = S(t) z, with S = C^(1/2) (symmetric) and one z from N(0, I) for the whole
path. (Predictions err so: a ship that is ahead of her prediction stays ahead of it.) Then z brings contact where, at some
instant, p(t) + S(t) z lies in M(t) = {a - b: a in the own hull, b in the target's}: in the union over time of the convex sets
S^-1 (M - p), and the probability is the Gaussian measure of that union,

    P = 1 / (2 pi) integral over theta of [the measure of the union's part of that ray under r exp(-r^2 / 2)].

Each ray meets each convex set in one interval, of which the union is exact; the integral over theta is a sum over RAYS. From step to
step the convex hull of two sets is bounded by the tangents of the first's edges and those along the way between both: never too small. Errors
of the two headings are independent of z and of each other, and are drawn at the four points of the cubature of degree 3.
"""

import math

import numpy as np
from numba import njit

from aspnn.motion import Path

RAYS = 180
CIRCLE = np.exp(2j * np.pi * (np.arange(RAYS) + 0.5) / RAYS)  # their directions
SPACING = 2.0  # s, between the instants that are joined
REACH = 4.5  # standard deviations: 4e-5 of a plane Gaussian lies beyond
TURNS = math.sqrt(2) * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])  # sds of both headings, 1/4 each


def contact_probability(own: Path, outline: np.ndarray, others: Path, outlines: np.ndarray) -> np.ndarray:
    """Probability (n) that a hull on the path `own` (steps,) touches one on each of the paths `others` (n, steps), of equal times.

    `outline` (k, 2) and `outlines` (n, k', 2) are convex and closed, in body axes; a concave one counts as filled. NaN where either
    path has no spread, or none at some step.
    """
    n = len(others.north)
    found = np.full(n, np.nan)
    if own.spread is None or others.spread is None:
        return found
    every = max(1, round(SPACING / float(np.diff(own.time).mean())))
    at = np.unique(np.append(np.arange(0, len(own.time), every), len(own.time) - 1))
    C = own.spread.covariance[at, :2, :2] + others.spread.covariance[:, at, :2, :2]
    p = (others.north - own.north + 1j * (others.east - own.east))[:, at]
    sds = np.sqrt(np.stack([own.spread.covariance[at, 2, 2] + np.zeros((n, 1)), others.spread.covariance[:, at, 2, 2]]))
    known = np.isfinite(C).all(axis=(1, 2, 3)) & np.isfinite(sds).all(axis=(0, 2)) & np.isfinite(p).all(axis=1)
    A, B = outline @ np.array([1, 1j]), outlines @ np.array([1, 1j])
    reach = np.abs(A).max() + np.abs(B).max(axis=1)
    with np.errstate(invalid="ignore"):
        trace = C[..., 0, 0] + C[..., 1, 1]
        widest = np.sqrt(trace / 2 + np.hypot((C[..., 0, 0] - C[..., 1, 1]) / 2, C[..., 0, 1]))
        off = np.abs(p) - reach[:, None]
        near = np.minimum(off[:, :-1], off[:, 1:]) - np.abs(np.diff(p)) <= REACH * np.maximum(
            widest[:, :-1], widest[:, 1:]
        )
    for k in np.flatnonzero(known):
        steps = np.flatnonzero(near[k])
        if not len(steps):
            found[k] = 0.0
            continue
        headings = np.stack([own.heading[at], others.heading[k, at]])
        given = A[:-1], B[k, :-1], _normals(A), _normals(B[k]), p[k], _root(C[k])
        shares = [_measure(*given, headings + turn[:, None] * sds[:, k], steps, CIRCLE) for turn in TURNS]
        found[k] = float(np.mean(shares))
    return found


def _root(C: np.ndarray) -> np.ndarray:
    """Symmetric roots (..., 2, 2): (C + s I) / sqrt(tr C + 2 s) with s = sqrt(det C), by Cayley and Hamilton."""
    s = np.sqrt(C[..., 0, 0] * C[..., 1, 1] - C[..., 0, 1] ** 2)
    return (C + s[..., None, None] * np.eye(2)) / np.sqrt(C[..., 0, 0] + C[..., 1, 1] + 2 * s)[..., None, None]


def _normals(points: np.ndarray) -> np.ndarray:
    """Outward normals (k - 1), complex, of a closed convex outline."""
    edges = np.diff(points)
    area = float((np.conj(points[:-1]) * points[1:]).imag.sum())
    return edges * (-1j if area > 0 else 1j)


@njit(cache=True, error_model="numpy")
def _support(x: float, y: float, S, a, b, p) -> float:
    """Support of S^-1 (M - p) along the direction (x, y), with M = {a - b}: that of M - p along S^-1 (x, y), S being symmetric."""
    determinant = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    m, n = (S[1, 1] * x - S[1, 0] * y) / determinant, (S[0, 0] * y - S[0, 1] * x) / determinant
    along, against = -np.inf, np.inf
    for corner in a:
        along = max(along, m * corner.real + n * corner.imag)
    for corner in b:
        against = min(against, m * corner.real + n * corner.imag)
    return along - against - (m * p.real + n * p.imag)


@njit(cache=True, error_model="numpy")
def _measure(A, B, normal_a, normal_b, p, S, headings, steps, rays) -> float:
    """The Gaussian measure of the union over `steps` (intervals) of the sets S^-1 (M - p), for given headings (2, times).

    `A`, `B`: corners of the outlines in body axes, with the outward normals of their edges; `rays`: unit vectors.
    """
    edges = len(normal_a) + len(normal_b)
    low, high = np.zeros((len(steps), len(rays))), np.full((len(steps), len(rays)), np.inf)
    for row in range(len(steps)):
        k = steps[row]
        place = np.empty((2, 2))
        turned = []
        for end in range(2):
            t = k + end
            turned.append((np.exp(1j * headings[0, t]) * A, np.exp(1j * headings[1, t]) * B))
            determinant = S[t, 0, 0] * S[t, 1, 1] - S[t, 0, 1] ** 2
            place[end, 0] = (S[t, 1, 1] * p[t].real - S[t, 0, 1] * p[t].imag) / determinant
            place[end, 1] = (S[t, 0, 0] * p[t].imag - S[t, 0, 1] * p[t].real) / determinant
        for j in range(edges + 2):
            if j < edges:
                own = j < len(normal_a)
                n = normal_a[j] if own else -normal_b[j - len(normal_a)]
                n *= np.exp(1j * headings[0 if own else 1, k])
                x, y = S[k, 0, 0] * n.real + S[k, 0, 1] * n.imag, S[k, 0, 1] * n.real + S[k, 1, 1] * n.imag
            else:
                side = 1.0 if j == edges else -1.0
                x, y = -side * (place[1, 1] - place[0, 1]), side * (place[1, 0] - place[0, 0])
            length = np.hypot(x, y)
            if length == 0:
                continue
            x, y = x / length, y / length
            bound = max(
                _support(x, y, S[k], turned[0][0], turned[0][1], p[k]),
                _support(x, y, S[k + 1], turned[1][0], turned[1][1], p[k + 1]),
            )
            for i in range(len(rays)):
                rate = x * rays[i].real + y * rays[i].imag
                if rate > 0:
                    high[row, i] = min(high[row, i], bound / rate)
                elif rate < 0:
                    low[row, i] = max(low[row, i], bound / rate)
                elif bound < 0:
                    high[row, i] = 0.0
    total = 0.0
    for i in range(len(rays)):
        reached = 0.0
        for row in np.argsort(low[:, i]):
            start = max(low[row, i], reached)
            if high[row, i] > start:
                total += np.exp(-(start**2) / 2) - np.exp(-(high[row, i] ** 2) / 2)
                reached = high[row, i]
    return total / len(rays)
