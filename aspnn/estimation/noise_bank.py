"""A bank of unscented filters that differ in their process noise, weighed by what each foretold: adaptation without derivatives.

A static bank (Magill 1965, recalled) whose evidence is forgotten, so that a later change of the noise is heard: log-weights are the sums of
log-likelihoods, each worth exp(-age / memory). Every filter runs on by itself, so none can be driven off; all are one batch.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aspnn.estimation.models import Sigma
from aspnn.estimation.unscented import PAPER, Belief, StateModel, predict, update
from aspnn.schema import InputError


@dataclass(frozen=True)
class NoiseBank:
    """Process noises `Q` (g, d, d) of a step, one per filter; evidence fades within `memory` [s]."""

    Q: np.ndarray
    memory: float = 20.0

    def __post_init__(self) -> None:
        if self.Q.ndim != 3 or not len(self.Q) or not self.memory > 0:
            raise InputError(
                f"NoiseBank: Q of shape {self.Q.shape} must be (g, d, d), memory {self.memory:g} s positive"
            )


class Banked(NamedTuple):
    """The filters' beliefs, their axis first: means (g, ..., d), covariances (g, ..., d, d); faded log-likelihoods (g, ...)."""

    beliefs: Belief
    evidence: np.ndarray

    @property
    def weights(self) -> np.ndarray:
        """Probability (g, ...) of each filter's noise."""
        w = np.exp(self.evidence - self.evidence.max(axis=0))
        return w / w.sum(axis=0)

    @property
    def belief(self) -> Belief:
        """Mean (..., d) and covariance (..., d, d) of the mixture, the spread of the filters' means included."""
        w, (means, covariances) = self.weights, self.beliefs
        x = np.einsum("g...,g...i->...i", w, means)
        off = means - x
        P = np.einsum("g...,g...ij->...ij", w, covariances + off[..., :, None] * off[..., None, :])
        return Belief(x, P)


def begin(bank: NoiseBank, belief: Belief) -> Banked:
    """All filters at one belief, none preferred."""
    g = len(bank.Q)
    beliefs = Belief(*(np.broadcast_to(part, (g, *part.shape)) for part in belief))
    return Banked(beliefs, np.zeros((g, *belief.x.shape[:-1])))


def step(
    bank: NoiseBank,
    model: StateModel,
    now: Banked,
    u,
    dt: float,
    z: np.ndarray,
    R: np.ndarray,
    sigma: Sigma = PAPER,
    angles: tuple[int, ...] = (),
) -> Banked:
    """Predict over `dt` [s] under `u` and update by `z` (..., p), NaN where nothing is measured.

    Raises InputError as `unscented.predict`.
    """
    ships = now.evidence.ndim - 1
    Q = bank.Q.reshape(len(bank.Q), *(1,) * ships, *bank.Q.shape[1:])
    beliefs = predict(model, now.beliefs, u, dt, Q, sigma)
    found = update(model, beliefs, np.broadcast_to(z, (len(bank.Q), *z.shape)), R, sigma, angles)
    return Banked(found.belief, math.exp(-dt / bank.memory) * now.evidence + found.likelihood)
