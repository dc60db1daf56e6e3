"""The roll-out GRU compiled by numba, for predictions: what `network.RolloutGru.forward` computes, without torch.

A prediction runs a handful of rows through a hundred small steps, and torch takes longer to call its operators than to compute
them. Here all steps of a row are one loop, without slices inside it, since numba counts who holds an array. Each row is computed
by itself. Training and large batches stay with torch, and a test holds the two to one another. All in float32, as in torch.
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
FURTHEST = np.float32(126)  # 2 to the power of more than this, or of less than minus this, is not in float32


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _powers(values, first, end, whole, scale):
    """`values` from `first` to `end` become 2 to their power; `whole` int32 is room, and `scale` the same bits as float32.

    2^y = 2^k 2^f with k whole and |f| <= 1/2: 2^k by the exponent of the number, 2^f by its series (to 1.2e-7). Other than the
    library's function, this runs on many numbers at once.
    """
    for j in range(first, end):
        y = min(max(values[j], -FURTHEST), FURTHEST)
        k = np.floor(y + HALF)
        f = y - k
        whole[j] = (np.int32(k) + np.int32(127)) << np.int32(23)
        values[j] = ONE + f * (C1 + f * (C2 + f * (C3 + f * (C4 + f * (C5 + f * C6)))))
    for j in range(first, end):
        values[j] *= scale[j]


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _add_product(total, values, weights):
    """Add values (k,) @ weights (k, n) to `total` (n,)."""
    even = len(values) // 4 * 4
    for c in range(0, even, 4):
        p, q, r, s = values[c], values[c + 1], values[c + 2], values[c + 3]
        for j in range(len(total)):
            total[j] += p * weights[c, j] + q * weights[c + 1, j] + r * weights[c + 2, j] + s * weights[c + 3, j]
    for c in range(even, len(values)):
        p = values[c]
        for j in range(len(total)):
            total[j] += p * weights[c, j]


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _gru_step(seen, hidden, W, U, b, c, given, kept, whole, scale):
    """One step of a GRU cell on `hidden` (H,), in place. The last four (3 H,) are room for it.

    r, z = s(W x + b + U h + c), n = tanh(W x + b + r o (U h + c)), h = n + z o (h - n), torch's variant (erratum E42); with
    s(x) = 1 / (1 + e^-x) and tanh(x) = 2 s(2 x) - 1.
    """
    H = len(hidden)
    for j in range(3 * H):
        given[j], kept[j] = b[j], c[j]
    _add_product(given, seen, W)
    _add_product(kept, hidden, U)
    for j in range(2 * H):
        given[j] = -LOG2_E * (given[j] + kept[j])
    _powers(given, 0, 2 * H, whole, scale)
    for j in range(2 * H):
        given[j] = ONE / (ONE + given[j])
    for j in range(H):
        given[2 * H + j] = -TWO * LOG2_E * (given[2 * H + j] + given[j] * kept[2 * H + j])
    _powers(given, 2 * H, 3 * H, whole, scale)
    for j in range(H):
        new = TWO / (ONE + given[2 * H + j]) - ONE
        hidden[j] = new + given[H + j] * (hidden[j] - new)


class Weights(NamedTuple):
    """A RolloutGru's scaling and weights, float32, with the gain of its changes taken in."""

    now: np.ndarray  # (3,) int64, places of surge and the two sways among the inputs
    history: np.ndarray  # (2, inputs): offset and scale, as of the next three
    forcing: np.ndarray
    motion: np.ndarray
    wind: np.ndarray  # (2, 0) for a network without wind
    encoder: tuple[np.ndarray, ...]  # W (inputs, 3 H), U (H, 3 H), b, c of `_gru_step`
    cell: tuple[np.ndarray, ...]
    correct: np.ndarray  # (H, 3)
    correct_bias: np.ndarray
    direct: np.ndarray  # (3, seen)
    out: np.ndarray  # (3, H)
    out_bias: np.ndarray
    per_step: np.float32  # turn of a step by the sway difference [rad per m/s]


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _scale(values, i, t, by, scaled):
    """(values[i, t] - offset) / scale (k,) in float32, into `scaled`."""
    for k in range(len(scaled)):
        scaled[k] = (np.float32(values[i, t, k]) - by[0, k]) / by[1, k]


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _tell(motion, by, i, t, velocities):
    """Velocities (3,) [m/s] of a scaled motion: RolloutGru.to_velocities."""
    mean, span = motion[1] * by[1, 1] + by[0, 1], motion[2] * by[1, 2] + by[0, 2]
    velocities[i, t, 0] = motion[0] * by[1, 0] + by[0, 0]
    velocities[i, t, 1], velocities[i, t, 2] = mean + span * HALF, mean - span * HALF


@njit(cache=True, fastmath=ANY_ORDER, error_model="numpy", nogil=True)
def _roll_out(history, forcing, wind, w):
    """Velocities (n, steps + 1, 3) as RolloutGru.forward gives them; the comments of its steps stand there."""
    n, steps, inputs, forcings, H = (
        len(history),
        forcing.shape[1] - 1,
        history.shape[2],
        forcing.shape[2],
        len(w.correct),
    )
    found = np.empty((n, steps + 1, 3))
    given, kept, whole = np.empty(3 * H, np.float32), np.empty(3 * H, np.float32), np.empty(3 * H, np.int32)
    scale = whole.view(np.float32)
    past, hidden, seen = np.empty(inputs, np.float32), np.empty(H, np.float32), np.empty(w.direct.shape[1], np.float32)
    motion, air = seen[:3], np.empty(w.wind.shape[1], np.float32)  # the cell sees the motion first
    before, after = seen[3 : 3 + forcings], seen[3 + forcings : 3 + 2 * forcings]
    change = np.empty(3, np.float32)
    for i in range(n):
        hidden[:] = 0
        for t in range(history.shape[1]):
            _scale(history, i, t, w.history, past)
            _gru_step(past, hidden, *w.encoder, given, kept, whole, scale)  # type: ignore[call-arg]
        last = history[i, -1]
        surge, bow, stern = np.float32(last[w.now[0]]), np.float32(last[w.now[1]]), np.float32(last[w.now[2]])
        change[0], change[1], change[2] = surge, (bow + stern) * HALF, bow - stern
        for m in range(3):
            motion[m] = (change[m] - w.motion[0, m]) / w.motion[1, m]
        motion += w.correct_bias
        _add_product(motion, hidden, w.correct)
        _tell(motion, w.motion, i, 0, found)
        for k in range(len(air)):
            air[k] = (np.float32(wind[i, k]) - w.wind[0, k]) / w.wind[1, k]
        turned = np.float32(0)
        _scale(forcing, i, 0, w.forcing, after)
        for t in range(steps):
            for k in range(forcings):
                before[k] = after[k]
            _scale(forcing, i, t + 1, w.forcing, after)
            if len(air):
                c, s = np.cos(turned), np.sin(turned)
                seen[-2], seen[-1] = air[0] * c + air[1] * s, air[1] * c - air[0] * s
                turned += (motion[2] * w.motion[1, 2] + w.motion[0, 2]) * w.per_step
            _gru_step(seen, hidden, *w.cell, given, kept, whole, scale)  # type: ignore[call-arg]
            for m in range(3):  # the cell still sees the motion before the step
                change[m] = motion[m] + w.out_bias[m]
                for k in range(len(seen)):
                    change[m] += w.direct[m, k] * seen[k]
                for k in range(H):
                    change[m] += w.out[m, k] * hidden[k]
            for m in range(3):
                motion[m] = change[m]
            _tell(motion, w.motion, i, t + 1, found)
    return found


def weights_of(network: RolloutGru | RolloutEnsemble) -> list[Weights]:
    """The weights of a network, or of each member of an ensemble, as they are now."""
    members = network.members if isinstance(network, RolloutEnsemble) else [network]
    return [_weights(member) for member in members]  # type: ignore[arg-type]


def _weights(network: RolloutGru) -> Weights:
    s, gain = network.sizes, np.float32(network.CHANGE)

    def array(values: Tensor) -> np.ndarray:
        return values.detach().numpy().copy()

    def turned(values: Tensor) -> np.ndarray:
        return np.ascontiguousarray(array(values).T)

    def gates(of: Module, suffix: str) -> tuple[np.ndarray, ...]:
        return tuple(turned(getattr(of, name + suffix)) for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"))

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
        correct=gain * turned(network.correct.weight),
        correct_bias=gain * array(network.correct.bias),
        direct=gain * array(network.direct.weight),
        out=gain * array(network.out.weight),
        out_bias=gain * array(network.out.bias),
        per_step=np.float32(s.period / (s.x_bow - s.x_stern)),
    )


def velocities(members: list[Weights], history: np.ndarray, forcing: np.ndarray, wind: np.ndarray) -> np.ndarray:
    """Velocities (n, steps + 1, 3) [m/s], the mean of the members' answers to history, forcing and wind."""
    inputs = [np.ascontiguousarray(values, float) for values in (history, forcing, wind)]
    found = [_roll_out(*inputs, member) for member in members]  # type: ignore[call-arg]
    return found[0] if len(found) == 1 else np.mean(found, axis=0)
