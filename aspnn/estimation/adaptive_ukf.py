"""An unscented filter that adapts its process noise by the MIT rule, with every derivative of the filter by that noise.

Y. Peng and J. Han, "Tracking Control of Unmanned Trimaran Surface Vehicle" (2007), eqs. (13)-(20), corrected by E51-E55. The criterion is
V = tr((S_k - S^_k)^2): the mean of the last N innovations' squares less the covariance the filter claims. Two things are ours.
log q is adapted, so that q stays positive; and innovations are told in units of their noise, or metres would outweigh radians.

Derivatives through the model are taken by complex steps, exact to rounding: its functions must be analytic and take complex arrays.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aspnn.estimation.models import Sigma
from aspnn.estimation.unscented import (
    PAPER,
    Belief,
    StateModel,
    Update,
    centred,
    columns,
    correct,
    gather,
    root,
    rows,
    sigma_points,
    symmetric,
    turned,
)
from aspnn.schema import InputError

COMPLEX_STEP = 1e-30  # its square is below rounding of anything, so nothing is lost by making it small


@dataclass(frozen=True)
class MitRule:
    """How the process noise adapts: Q = `fixed` (d, d) + sum of q_j `directions`[j] (k, d, d).

    `gain` is the eta of (13), on log q and on innovations in units of their noise (E51); one step changes log q by at most
    `fastest`, and q stays within `least` and `most` (k). `window` is N of (16).
    """

    fixed: np.ndarray
    directions: np.ndarray
    least: np.ndarray
    most: np.ndarray
    gain: float = 0.1
    window: int = 50
    fastest: float = 0.1

    def __post_init__(self) -> None:
        d, k = len(self.fixed), len(self.directions)
        if self.directions.shape != (k, d, d) or len(self.least) != k or len(self.most) != k:
            raise InputError("MitRule: directions must be (k, d, d), least and most (k), with Q of (d, d)")
        if not (self.least > 0).all() or not (self.least <= self.most).all():
            raise InputError("MitRule: least must be positive and not above most, or log q has no range")
        if self.window < 1 or not self.gain >= 0 or not self.fastest > 0:
            raise InputError(f"MitRule: window {self.window}, gain {self.gain:g} or fastest {self.fastest:g} is no use")

    def Q(self, q: np.ndarray) -> np.ndarray:
        """Process noise (..., d, d) of intensities q (..., k)."""
        return self.fixed + np.einsum("...k,kij->...ij", q, self.directions)


class Slope(NamedTuple):
    """Derivatives of a Belief by each of the k intensities: of the mean (..., k, d), of the covariance (..., k, d, d)."""

    x: np.ndarray
    P: np.ndarray


class UpdateSlope(NamedTuple):
    """Derivatives by q (..., k, ...) of an update: of the belief, the innovation (p), its covariance (p, p) and the gain (d, p)."""

    belief: Slope
    innovation: np.ndarray
    S: np.ndarray
    K: np.ndarray


class Adapting(NamedTuple):
    """What an adaptive filter carries: belief, its slope, log q (..., k); innovations (n <= N, ..., p) and their slopes (n, ..., k, p).

    `criterion` (...) is the last V, `descent` (..., k) its derivative by q.
    """

    belief: Belief
    slope: Slope
    log_q: np.ndarray
    innovations: np.ndarray
    innovation_slopes: np.ndarray
    criterion: np.ndarray
    descent: np.ndarray


def begin(rule: MitRule, belief: Belief, q: np.ndarray, measured: int) -> Adapting:
    """The filter before its first step: intensities q (..., k), `measured` rows p of a measurement; all slopes zero (18).

    Raises InputError for a q outside the rule's bounds.
    """
    q = np.broadcast_to(np.asarray(q, float), (*belief.x.shape[:-1], len(rule.directions)))
    if not ((rule.least <= q) & (q <= rule.most)).all():
        raise InputError("MitRule: the q at the start must lie within least and most")
    zero = Slope(np.zeros((*q.shape, belief.x.shape[-1])), np.zeros((*q.shape, *belief.P.shape[-2:])))
    ys, dys = np.zeros((0, *q.shape[:-1], measured)), np.zeros((0, *q.shape, measured))
    return Adapting(belief, zero, np.log(q), ys, dys, np.zeros(q.shape[:-1]), np.zeros(q.shape))


def step(
    rule: MitRule,
    model: StateModel,
    now: Adapting,
    u,
    dt: float,
    z: np.ndarray,
    R: np.ndarray,
    sigma: Sigma = PAPER,
    angles: tuple[int, ...] = (),
) -> Adapting:
    """Predict over `dt` [s] under `u`, update by `z` (..., p), then move log q down the slope of V (13)-(20).

    An epoch with a row missing (NaN) updates the belief, but is left out of the window and adapts nothing.
    Raises InputError as `unscented.predict`.
    """
    q = np.exp(now.log_q)
    predicted, slope = predict(model, now.belief, now.slope, u, dt, rule.Q(q), rule.directions, sigma)
    found, slopes = update(model, predicted, slope, z, R, sigma, angles)
    ys = np.concatenate([now.innovations, found.innovation[None]])[-rule.window :]
    dys = np.concatenate([now.innovation_slopes, slopes.innovation[None]])[-rule.window :]
    V, dV = criterion(ys, dys, found.S, slopes.S, np.sqrt(np.diag(R)))
    usable = np.isfinite(z).all(axis=-1)[..., None] & (len(ys) == rule.window)
    down = np.where(usable, rule.gain * q * dV, 0.0)  # dV / dlog q = q dV / dq
    log_q = now.log_q - np.clip(down, -rule.fastest, rule.fastest)
    log_q = np.clip(log_q, np.log(rule.least), np.log(rule.most))
    return Adapting(found.belief, slopes.belief, log_q, ys, dys, V, dV)


def predict(
    model: StateModel, belief: Belief, slope: Slope, u, dt: float, Q: np.ndarray, dQ: np.ndarray, sigma: Sigma = PAPER
) -> tuple[Belief, Slope]:
    """`unscented.predict` with its slope (19); `dQ` (k, d, d)."""
    X, mean, covariance = sigma_points(belief, sigma)
    dX = point_slopes(belief.P, slope, sigma)
    x, D = centred(rows(model.transition(columns(X), u, dt)), mean)
    dx, dD = centred(along(lambda Z: model.transition(Z, u, dt), X, dX), mean)
    half = (covariance * dD) @ turned(D)[..., None, :, :]
    P = symmetric((covariance * D) @ turned(D) + Q)
    return Belief(x, P), Slope(dx, half + turned(half) + dQ)


def update(
    model: StateModel,
    belief: Belief,
    slope: Slope,
    z: np.ndarray,
    R: np.ndarray,
    sigma: Sigma = PAPER,
    angles: tuple[int, ...] = (),
) -> tuple[Update, UpdateSlope]:
    """`unscented.update` with its slopes (19)-(20), the gain's by P_yy (E53, E55)."""
    gathered = gather(model, belief, z, R, sigma, angles)
    found = correct(belief, gathered)
    X, G, S, C, y, have = gathered
    _, mean, covariance = sigma.weights(X.shape[-2])
    dX = point_slopes(belief.P, slope, sigma)
    dexpected, dG = centred(along(model.measure, X, dX), mean)
    dG = np.where(have[..., None, :, None], dG, 0.0)
    dy = np.where(have[..., None, :], -dexpected, 0.0)
    D, dD = X - belief.x[..., None], dX - slope.x[..., None]
    turned_G, K = turned(G)[..., None, :, :], found.K[..., None, :, :]
    half = (covariance * dG) @ turned_G
    dS = half + turned(half)
    dC = (covariance * dD) @ turned_G + (covariance * D)[..., None, :, :] @ turned(dG)
    dK = (dC - K @ dS) @ np.linalg.inv(S)[..., None, :, :]  # dC S^-1 - C S^-1 dS S^-1
    seen = np.where(have, y, 0.0)[..., None, :, None]
    dx = slope.x + (dK @ seen + K @ dy[..., None])[..., 0]
    dP = symmetric(slope.P - dK @ turned(C)[..., None, :, :] - K @ turned(dC))
    return found, UpdateSlope(Slope(dx, dP), dy, dS, dK)


def criterion(
    ys: np.ndarray, dys: np.ndarray, S: np.ndarray, dS: np.ndarray, unit: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """V (...) = tr((mean of y y' over the window - S)^2) and its derivatives (..., k) (14)-(17), each row in its `unit` (p).

    `ys` (n, ..., p), `dys` (n, ..., k, p) are the window's, those with a NaN left out; index i runs inside the sum (E52).
    """
    whole = np.isfinite(ys).all(axis=-1, keepdims=True)
    count = np.maximum(whole.sum(axis=0), 1)[..., None]
    y = np.moveaxis(np.where(whole, ys, 0.0) / unit, 0, -2)  # (..., n, p)
    dy = np.moveaxis(np.where(whole[..., None, :], dys, 0.0) / unit, 0, -2)  # (..., k, n, p)
    scale = np.outer(unit, unit)
    off = turned(y) @ y / count - S / scale
    half = turned(dy) @ y[..., None, :, :] / count[..., None, :, :]
    doff = half + turned(half) - dS / scale
    return np.einsum("...ij,...ij->...", off, off), 2 * np.einsum("...kij,...ij->...k", doff, off)


def root_slope(L: np.ndarray, dP: np.ndarray) -> np.ndarray:
    """Derivative (..., k, d, d) of the Cholesky root L (..., d, d), from that of P = L L' (..., k, d, d).

    dL = L Phi(L^-1 dP L^-T), Phi the strict lower triangle and half the diagonal (E54).
    """
    L = L[..., None, :, :]
    inner = turned(np.linalg.solve(L, turned(np.linalg.solve(L, dP))))
    lower = np.tril(inner)
    return L @ (lower - 0.5 * np.eye(L.shape[-1]) * inner)


def point_slopes(P: np.ndarray, slope: Slope, sigma: Sigma) -> np.ndarray:
    """Derivatives (..., k, d, 2 d + 1) of the sigma points of a belief of covariance P, the middle one's included (E54)."""
    spread = math.sqrt(sigma.weights(P.shape[-1])[0])
    outward, middle = spread * root_slope(root(P), slope.P), slope.x[..., None]
    return np.concatenate([middle, middle + outward, middle - outward], axis=-1)


def along(function, X: np.ndarray, dX: np.ndarray) -> np.ndarray:
    """Derivatives (..., k, r, m) of a model's function at points X (..., d, m) along dX (..., k, d, m), by one complex step."""
    k, m = dX.shape[-3], dX.shape[-1]
    Z = X[..., None, :, :] + 1j * COMPLEX_STEP * dX
    flat = np.moveaxis(Z, -3, -2).reshape(*X.shape[:-1], k * m)  # the k sets of points side by side: still columns
    found = rows(function(columns(flat))).imag / COMPLEX_STEP
    return np.moveaxis(found.reshape(*found.shape[:-1], k, m), -2, -3)
