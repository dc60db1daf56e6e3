"""The unscented Kalman filter for states and parameters together, of any model and of many ships at once.

The filter of Y. Peng and J. Han, "Tracking Control of Unmanned Trimaran Surface Vehicle" (2007), eqs. (8)-(12), with right weights
(E50). A parameter is a state that wanders: append it to the state, leave it unchanged in `transition`, and give it a variance in Q
for how far it may wander in a step. A parameter that must stay positive is better carried as its logarithm.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from aspnn.angles import wrap
from aspnn.estimation.models import Sigma
from aspnn.schema import InputError

PAPER = Sigma(1.0, 2.0, 0.0)  # lambda = n (alpha^2 - 1), the paper's (11); its alpha and beta are not told (assumed)


class StateModel(Protocol):
    """What a model tells: where columns of states go, and what is measured there.

    `X` (d, ..., m) holds one state per column, so `north, east, ... = X` works for any number of ships; results likewise, (d, ..., m) and
    (p, ..., m). `u` is what the filter was given: anything for one ship, for many (b) arrays (..., b, 1). Headings are continuous.
    """

    def transition(self, X: np.ndarray, u, dt: float) -> np.ndarray: ...

    def measure(self, X: np.ndarray) -> np.ndarray: ...


class Belief(NamedTuple):
    """Mean `x` (..., d) and covariance `P` (..., d, d) of the state; leading axes are ships."""

    x: np.ndarray
    P: np.ndarray


class Update(NamedTuple):
    """The belief after a measurement, the innovation (..., p) with its covariance `S` (..., p, p), the log-likelihood (...)
    and the gain `K` (..., d, p).

    A row that was not measured has the innovation NaN; its row of S is that of the identity.
    """

    belief: Belief
    innovation: np.ndarray
    S: np.ndarray
    likelihood: np.ndarray
    K: np.ndarray


class Gathered(NamedTuple):
    """Sigma points `X` (..., d, m), their readings less the mean `G` (..., p, m), the covariances `S` (..., p, p) of the innovation and `C`
    (..., d, p) of state and innovation, the innovation (..., p), and which rows were measured.
    """

    X: np.ndarray
    G: np.ndarray
    S: np.ndarray
    C: np.ndarray
    innovation: np.ndarray
    have: np.ndarray


class Track(NamedTuple):
    """A run over n epochs: means (n, ..., d), covariances (n, ..., d, d), innovations (n, ..., p) and log-likelihoods (n, ...)."""

    x: np.ndarray
    P: np.ndarray
    innovation: np.ndarray
    likelihood: np.ndarray


def predict(model: StateModel, belief: Belief, u, dt: float, Q: np.ndarray, sigma: Sigma = PAPER) -> Belief:
    """The belief after `dt` [s] under input `u`, with the covariance `Q` (d, d) of the noise on the way (10).

    Raises InputError where the covariance is not positive definite.
    """
    X, mean, covariance = sigma_points(belief, sigma)
    x, D = centred(rows(model.transition(columns(X), u, dt)), mean)
    return Belief(x, symmetric((covariance * D) @ turned(D) + Q))


def update(
    model: StateModel,
    belief: Belief,
    z: np.ndarray,
    R: np.ndarray,
    sigma: Sigma = PAPER,
    angles: tuple[int, ...] = (),
) -> Update:
    """The belief after measurements `z` (..., p), NaN where there is none, of noise covariance `R` (p, p) (12).

    The points are drawn anew from the predicted belief, as the paper does. `angles`: rows of z whose innovation is wrapped.
    Raises InputError as `predict`.
    """
    return correct(belief, gather(model, belief, z, R, sigma, angles))


def gather(
    model: StateModel, belief: Belief, z: np.ndarray, R: np.ndarray, sigma: Sigma, angles: tuple[int, ...]
) -> Gathered:
    """What the points say of a measurement, the arguments as of `update`."""
    X, mean, covariance = sigma_points(belief, sigma)
    expected, G = centred(rows(model.measure(columns(X))), mean)
    have = np.isfinite(z)
    # A missing row measures nothing: no spread, unit noise, no innovation.
    G = np.where(have[..., None], G, 0.0)
    both = have[..., :, None] & have[..., None, :]
    S = (covariance * G) @ turned(G) + np.where(both, R, np.eye(z.shape[-1]))
    C = (covariance * (X - belief.x[..., None])) @ turned(G)
    return Gathered(X, G, S, C, innovation(z, expected, angles), have)


def correct(belief: Belief, gathered: Gathered) -> Update:
    """The update that follows from it (12), K = P_xy P_yy^-1."""
    _, _, S, C, y, have = gathered
    inverse = np.linalg.inv(S)
    K, seen = C @ inverse, np.where(have, y, 0.0)[..., None]
    x = belief.x + (K @ seen)[..., 0]
    P = symmetric(belief.P - K @ turned(C))
    square = (turned(seen) @ inverse @ seen)[..., 0, 0]
    likelihood = -0.5 * (square + np.linalg.slogdet(S)[1] + have.sum(axis=-1) * math.log(2 * math.pi))
    return Update(Belief(x, P), y, S, likelihood, K)


def track(
    model: StateModel,
    start: Belief,
    dt: np.ndarray,
    u,
    z: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    sigma: Sigma = PAPER,
    angles: tuple[int, ...] = (),
) -> Track:
    """Predict and update over n epochs: `dt` (n) [s] leads to each epoch under the input u[k], `z` (n, ..., p) is measured there.

    `Q` (d, d) is the noise of a step as long as the mean one and grows with its length. No prediction where dt is zero.
    Raises InputError as `predict`.
    """
    belief, usual = start, float(np.mean(dt)) or 1.0
    xs, Ps, ys, likelihoods = [], [], [], []
    for k in range(len(dt)):
        if dt[k] > 0:
            belief = predict(model, belief, u[k], float(dt[k]), Q * (dt[k] / usual), sigma)
        found = update(model, belief, z[k], R, sigma, angles)
        belief = found.belief
        xs.append(belief.x)
        Ps.append(belief.P)
        ys.append(found.innovation)
        likelihoods.append(found.likelihood)
    return Track(np.array(xs), np.array(Ps), np.array(ys), np.array(likelihoods))


def sigma_points(belief: Belief, sigma: Sigma) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (..., d, 2 d + 1): x, then x + and x - the columns of the root of (n + lambda) P; and the weights of mean and covariance.

    Raises InputError where the covariance is not positive definite.
    """
    x, P = belief
    spread, mean, covariance = sigma.weights(x.shape[-1])
    step = math.sqrt(spread) * root(P)
    middle = x[..., None]
    return np.concatenate([middle, middle + step, middle - step], axis=-1), mean, covariance


def root(P: np.ndarray) -> np.ndarray:
    """Lower triangular L (..., d, d) with L L' = P. Raises InputError where P is not positive definite."""
    try:
        return np.linalg.cholesky(P)
    except np.linalg.LinAlgError as error:
        raise InputError(
            "unscented filter: the covariance is not positive definite; give every state and parameter a variance at the start, "
            "and a sigma whose weights are not so negative (alpha nearer 1)"
        ) from error


def innovation(z: np.ndarray, expected: np.ndarray, angles: tuple[int, ...]) -> np.ndarray:
    """z - expected (..., p), wrapped in the rows `angles`."""
    y = z - expected
    for row in angles:
        y[..., row] = wrap(y[..., row])
    return y


def centred(X: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean (..., d) of points (..., d, m), and the points less it."""
    x = X @ weights
    return x, X - x[..., None]


def columns(X: np.ndarray) -> np.ndarray:
    """Points (..., d, m) as a model takes them, (d, ..., m)."""
    return np.moveaxis(X, -2, 0)


def rows(X: np.ndarray) -> np.ndarray:
    """What a model gives, (d, ..., m), as (..., d, m)."""
    return np.moveaxis(X, 0, -2)


def turned(A: np.ndarray) -> np.ndarray:
    """The transpose of each matrix."""
    return np.swapaxes(A, -1, -2)


def symmetric(P: np.ndarray) -> np.ndarray:
    """The symmetric part of each matrix: rounding must not grow into asymmetry."""
    return 0.5 * (P + turned(P))
