"""The roll-out GRU compiled by numba, for predictions: what `network.RolloutGru.forward` computes, without torch.

A prediction runs a handful of rows through a hundred small steps, and torch takes longer to call its operators than to compute
them. Here all steps of a block of rows are one loop, and pasts that are alike are read once. Training and large batches stay with
torch, and a test holds the two to one another. All in float32, as in torch; beside other rows a row may round otherwise.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from torch import Tensor
from torch.nn import Module

from aspnn.learning.network import Affine, RolloutEnsemble, RolloutGru

# Sums may be taken in any order, which lets the compiler use wide registers; NaN and infinity keep their meaning.
ANY_ORDER = {"contract", "reassoc", "nsz", "arcp"}
LOG2_E = np.float32(1 / math.log(2))
C1, C2, C3, C4, C5, C6 = (np.float32(math.log(2) ** k / math.factorial(k)) for k in range(1, 7))
ONE, TWO, HALF = np.float32(1), np.float32(2), np.float32(0.5)
BLOCK = 16  # rows that go through the steps together: one product of matrices for all, so small that BLAS keeps to one thread
FURTHEST = np.float32(126)  # 2 to the power of more than this, or of less than minus this, is not in float32


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _gru_step(seen, hidden, W, U, b, c, product, kept, gates, whole, scale):
    """One step of a GRU cell on `hidden` (rows, H), in place.

    r, z = s(W x + b + U h), n = tanh(W x + b + r o (U h + c)), h = n + z o (h - n), torch's variant (erratum E42), with
    s(x) = 1 / (1 + e^-x) and tanh(x) = 2 s(2 x) - 1. The weights are such that the sums are exponents of 2 (see `_gates`).
    2^y = 2^k 2^f with k whole and |f| <= 1/2: 2^k by the exponent of the number, 2^f by its series (to 1.2e-7). Other than the
    library's function, this runs on many numbers at once. Indices are plain loop variables, which the compiler needs for that.

    W (seen, 3, H), U (H, 3 H), b (3, H), c (H,). Room: `product` (rows, 3 H) and its other shape `kept` (rows, 3, H); `gates`
    (3, H), `whole` (H,) int32 and `scale`, the same bits as float32.
    """
    rows, H = hidden.shape
    np.dot(hidden, U, product)
    for i in range(rows):
        for g in range(3):
            for j in range(H):
                gates[g, j] = b[g, j]
        for k in range(seen.shape[1]):
            for g in range(3):
                for j in range(H):
                    gates[g, j] += seen[i, k] * W[k, g, j]
        for g in range(3):
            if g < 2:
                for j in range(H):
                    gates[g, j] += kept[i, g, j]
            else:
                for j in range(H):
                    gates[g, j] += gates[0, j] * (kept[i, g, j] + c[j])
            for j in range(H):
                y = min(max(gates[g, j], -FURTHEST), FURTHEST)
                k = np.floor(y + HALF)
                f = y - k
                whole[j] = (np.int32(k) + np.int32(127)) << np.int32(23)
                gates[g, j] = ONE + f * (C1 + f * (C2 + f * (C3 + f * (C4 + f * (C5 + f * C6)))))
            for j in range(H):
                gates[g, j] = ONE / (ONE + gates[g, j] * scale[j])
        for j in range(H):
            new = TWO * gates[2, j] - ONE
            hidden[i, j] = new + gates[1, j] * (hidden[i, j] - new)


class Weights(NamedTuple):
    """A RolloutGru's scaling and weights, float32, with the gain of its changes taken in."""

    now: np.ndarray  # (3,) int64, places of surge and the two sways among the inputs
    history: np.ndarray  # (2, inputs): offset and scale, as of the next three
    forcing: np.ndarray
    motion: np.ndarray
    wind: np.ndarray  # (2, 0) for a network without wind
    encoder: tuple[np.ndarray, ...]  # W, U, b, c of `_gru_step`
    cell: tuple[np.ndarray, ...]
    correct: np.ndarray  # (3, H)
    correct_bias: np.ndarray
    direct: np.ndarray  # (3, seen)
    out: np.ndarray  # (3, H)
    out_bias: np.ndarray
    none: np.ndarray  # (3,) zeros
    per_step: np.float32  # turn of a step by the sway difference [rad per m/s]


@njit(cache=True, nogil=True)
def _room(rows, H):
    """The last five arguments of `_gru_step`."""
    product, whole = np.empty((rows, 3 * H), np.float32), np.empty(H, np.int32)
    return product, product.reshape(rows, 3, H), np.empty((3, H), np.float32), whole, whole.view(np.float32)


@njit(cache=True, nogil=True)
def _scale(values, first, t, by, scaled):
    """(values[first + i, t] - offset) / scale in float32, into `scaled` (rows, k)."""
    for i in range(len(scaled)):
        for k in range(scaled.shape[1]):
            scaled[i, k] = (np.float32(values[first + i, t, k]) - by[0, k]) / by[1, k]


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _add_change(motion, bias, weights, values):
    """Add bias (3,) + weights (3, k) @ values (rows, k) to `motion` (rows, 3)."""
    for i in range(len(motion)):
        for m in range(3):
            total = bias[m]
            for k in range(values.shape[1]):
                total += weights[m, k] * values[i, k]
            motion[i, m] += total


@njit(cache=True, nogil=True)
def _tell(motion, by, first, t, velocities):
    """Velocities [m/s] of scaled motions (rows, 3): RolloutGru.to_velocities."""
    for i in range(len(motion)):
        mean, span = motion[i, 1] * by[1, 1] + by[0, 1], motion[i, 2] * by[1, 2] + by[0, 2]
        velocities[first + i, t, 0] = motion[i, 0] * by[1, 0] + by[0, 0]
        velocities[first + i, t, 1], velocities[first + i, t, 2] = mean + span * HALF, mean - span * HALF


@njit(cache=True, nogil=True)
def _encode(history, w):
    """Latent states (n, H) after histories (n, steps, inputs)."""
    n, H = len(history), w.correct.shape[1]
    found = np.zeros((n, H), np.float32)
    for first in range(0, n, BLOCK):
        hidden = found[first : first + BLOCK]
        past = np.empty((len(hidden), history.shape[2]), np.float32)
        room = _room(len(hidden), H)
        for t in range(history.shape[1]):
            _scale(history, first, t, w.history, past)
            _gru_step(past, hidden, *w.encoder, *room)  # type: ignore[call-arg]
    return found


@njit(cache=True, nogil=True)
def _roll_out(latent, last, forcing, wind, w):
    """Velocities (n, steps + 1, 3) as RolloutGru.forward gives them, from latent states and the last inputs (n, inputs)."""
    n, steps, forcings, H, airs = len(latent), forcing.shape[1] - 1, forcing.shape[2], latent.shape[1], w.wind.shape[1]
    found, air = np.empty((n, steps + 1, 3)), (wind[:, :airs].astype(np.float32) - w.wind[0]) / w.wind[1]
    for first in range(0, n, BLOCK):
        hidden = latent[first : first + BLOCK].copy()
        rows = len(hidden)
        room = _room(rows, H)
        motion, plan = np.empty((rows, 3), np.float32), np.empty((rows, forcings), np.float32)
        seen, turned = np.empty((rows, 3 + 2 * forcings + airs), np.float32), np.zeros(rows, np.float32)
        for i in range(rows):
            now = last[first + i]
            surge, bow, stern = np.float32(now[w.now[0]]), np.float32(now[w.now[1]]), np.float32(now[w.now[2]])
            motion[i, 0], motion[i, 1], motion[i, 2] = surge, (bow + stern) * HALF, bow - stern
            for m in range(3):
                motion[i, m] = (motion[i, m] - w.motion[0, m]) / w.motion[1, m]
        _add_change(motion, w.correct_bias, w.correct, hidden)
        _tell(motion, w.motion, first, 0, found)
        _scale(forcing, first, 0, w.forcing, plan)
        for t in range(steps):
            seen[:, :3], seen[:, 3 : 3 + forcings] = motion, plan  # the cell sees the motion before the step
            _scale(forcing, first, t + 1, w.forcing, plan)
            seen[:, 3 + forcings : 3 + 2 * forcings] = plan
            if airs:
                for i in range(rows):
                    ahead, athwart = air[first + i, 0], air[first + i, 1]
                    c, s = np.cos(turned[i]), np.sin(turned[i])
                    seen[i, -2], seen[i, -1] = ahead * c + athwart * s, athwart * c - ahead * s
                    turned[i] += (motion[i, 2] * w.motion[1, 2] + w.motion[0, 2]) * w.per_step
            _gru_step(seen, hidden, *w.cell, *room)  # type: ignore[call-arg]
            _add_change(motion, w.out_bias, w.direct, seen)
            _add_change(motion, w.none, w.out, hidden)
            _tell(motion, w.motion, first, t + 1, found)
    return found


def weights_of(network: RolloutGru | RolloutEnsemble) -> list[Weights]:
    """The weights of a network, or of each member of an ensemble, as they are now."""
    members = network.members if isinstance(network, RolloutEnsemble) else [network]
    return [_weights(member) for member in members]  # type: ignore[arg-type]


def _weights(network: RolloutGru) -> Weights:
    s, gain = network.sizes, np.float32(network.CHANGE)

    def array(values: Tensor) -> np.ndarray:
        return values.detach().numpy().copy()

    def gates(of: Module, suffix: str) -> tuple[np.ndarray, ...]:
        W, U, b, c = (array(getattr(of, name + suffix)) for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"))
        exponent = -LOG2_E * np.repeat(np.array([ONE, ONE, TWO]), len(c) // 3)  # s(x) = 1 / (1 + 2^y), tanh with 2 x
        W, U = (np.ascontiguousarray(values.T * exponent) for values in (W, U))
        b, c = (b * exponent).reshape(3, -1), (c * exponent).reshape(3, -1)
        b[:2] += c[:2]
        return W.reshape(len(W), 3, -1), U, b, c[2]

    def scaling(by: Affine) -> np.ndarray:
        return np.stack([array(by.offset), array(by.scale)])

    return Weights(
        now=np.array(s.now),
        history=scaling(network.history),
        forcing=scaling(network.forcing),
        motion=scaling(network.motion),
        wind=scaling(network.wind)[:, : 2 * s.wind].copy(),
        encoder=gates(network.encoder, "_l0"),
        cell=gates(network.cell, ""),
        correct=gain * array(network.correct.weight),
        correct_bias=gain * array(network.correct.bias),
        direct=gain * array(network.direct.weight),
        out=gain * array(network.out.weight),
        out_bias=gain * array(network.out.bias),
        none=np.zeros(3, np.float32),
        per_step=np.float32(s.period / (s.x_bow - s.x_stern)),
    )


def velocities(members: list[Weights], history: np.ndarray, forcing: np.ndarray, wind: np.ndarray) -> np.ndarray:
    """Velocities (n, steps + 1, 3) [m/s], the mean of the members' answers to history, forcing and wind."""
    history, forcing, wind = (np.ascontiguousarray(values, float) for values in (history, forcing, wind))
    other = np.append(True, (history[1:] != history[:-1]).any(axis=(1, 2)))[
        : len(history)
    ]  # plans of a fan have one past
    past, of = history[other], np.cumsum(other) - 1
    found = [
        _roll_out(_encode(past, member)[of], history[:, -1], forcing, wind, member)  # type: ignore[call-arg]
        for member in members
    ]
    return found[0] if len(found) == 1 else np.mean(found, axis=0)
