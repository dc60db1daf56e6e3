"""Second-order wave drift on ships: the mean push of reflected waves, and its slow variation with the groups of a sea.

Waves as in `waves` (n, 5). First-order motions, which oscillate and average to nothing, are in `waves`; here is what steers a ship off
its path. The added resistance of pitching and heaving at wave lengths near the ship's own, which can be several times the
reflection in head seas, is not part of it.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import ive, kve

from aspnn.simulation.environment.arithmetic import turn
from aspnn.simulation.environment.waves import GRAVITY, SEA_WATER
from aspnn.vessel import Vessel

HEADINGS = 90  # evenly round the circle; a linear table errs by 0.3 % of the greatest drift
SPEEDS = 9  # evenly from a third of the fastest speed astern to the fastest ahead


class Drift(NamedTuple):
    """Drift of a hull in one sea, made once per voyage: `wave` (5, n) holds a, k cos d, k sin d, omega, phase of each component, `load`
    (HEADINGS, SPEEDS, 3, n) X, Y [N], N [N m] per squared amplitude [m2], `fastest` [m/s] is the last of the speeds.
    """

    wave: np.ndarray
    load: np.ndarray
    fastest: float

    @staticmethod
    def of(vessel: Vessel, waves: np.ndarray) -> "Drift":
        """The drift of a vessel, from its outline and draught, up to one and a half times its service speed."""
        return Drift.along(vessel.outline(), vessel.draught, 1.5 * vessel.service_speed, waves)

    @staticmethod
    def along(outline: np.ndarray, draught: float, fastest: float, waves: np.ndarray) -> "Drift":
        """The drift of a convex, wall-sided hull with a closed waterline `outline` (n, 2) in body axes [m], origin midship.

        O. M. Faltinsen, K. J. Minsaas, N. Liapis, S. O. Skjoerdal, "Prediction of resistance and propulsion of a ship in a seaway",
        13th Symposium on Naval Hydrodynamics (1980) 505-529 (formula from a public transcription): waves that are short against
        the hull are reflected where they meet it, and press on its normal per metre of waterline with
        1/2 rho g a^2 (sin^2(theta + beta) + 2 omega U / g (cos beta - cos theta cos(theta + beta))). With the wave's direction w and the
        inward normal n that is 1/2 rho g a^2 w_n (w_n - 2 omega U / g n_x), w_n = w . n: zero where the hull draws away from the waves
        as fast as their groups (g / 2 omega) come up. Only parts that face the waves (w_n > 0) and that they do reach are counted.

        The share reflected is pi^2 I1^2(kd) / (pi^2 I1^2(kd) + K1^2(kd)) at draught d (Ursell 1947, a vertical barrier in deep water;
        Fujii and Takahashi 1975 use it for ships; both recalled). Domain: waves shorter than about half the ship, Froude number
        up to about 0.2, deep water; in longer waves the reflection fades as it should, but see the module's text.
        """
        a, k, towards, omega, phase = waves.T
        edge = np.diff(outline, axis=0)
        x, y = outline[:-1].T + edge.T / 2
        clockwise = np.sign(np.sum(outline[:-1, 0] * edge[:, 1] - outline[:-1, 1] * edge[:, 0]))
        width = np.hypot(edge[:, 0], edge[:, 1])
        n_x, n_y = -clockwise * edge[:, 1] / width, clockwise * edge[:, 0] / width  # inward
        mu = (towards - 2 * np.pi / HEADINGS * np.arange(HEADINGS)[:, None])[:, None, :, None]
        speed = np.linspace(-fastest / 3, fastest, SPEEDS)[:, None, None]
        w_n = np.cos(mu) * n_x + np.sin(mu) * n_y
        push = np.maximum(w_n, 0) * np.maximum(w_n - 2 * omega[:, None] / GRAVITY * speed * n_x, 0)
        load = (push * width) @ np.column_stack([n_x, n_y, x * n_y - y * n_x])
        I1, K1 = np.pi * ive(1, k * draught), kve(1, k * draught) * np.exp(-2 * k * draught)
        share = I1**2 / (I1**2 + K1**2)
        load = 0.5 * SEA_WATER * GRAVITY * share * np.moveaxis(load, -1, -2)
        wave = np.stack([a, k * np.cos(towards), k * np.sin(towards), omega, phase])
        return Drift(wave, np.ascontiguousarray(load), fastest)


# Sums over components may be taken in any order, which is what vectors of partial sums need; nothing else is given up.
@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def drift_load(drift, x, time, load):
    """Adds the slowly varying drift X, Y [N], N [N m] to `load` (6,), for the place, heading and surge in state row x.

    J. N. Newman, "Second-order, slowly-varying forces on vessels in irregular waves" (1974, recalled): the force of a pair of
    components is the mean of their drift coefficients, D_ij = (D_i + D_j) / 2, which makes the sum over all pairs the product of
    two sums, Re(conj(sum a exp(i theta)) sum D a exp(i theta)) with a the amplitudes and theta the phases at midship: differences of
    frequency only, and a mean of sum D a^2. For seas that are not too broad. Linear between headings and speeds of the table;
    speeds beyond its ends count as its ends.
    """
    wave = drift.wave
    place = x[2] * (HEADINGS / (2 * math.pi))
    before = np.floor(place)
    part = place - before
    row = int(before) % HEADINGS
    pace = min(max((x[3] / drift.fastest + 1 / 3) * (0.75 * (SPEEDS - 1)), 0.0), SPEEDS - 1.0)
    column = min(int(pace), SPEEDS - 2)
    rest = pace - column
    A, B = drift.load[row, column], drift.load[row, column + 1]
    C, D = drift.load[(row + 1) % HEADINGS, column], drift.load[(row + 1) % HEADINGS, column + 1]
    a, b = (1 - part) * (1 - rest), (1 - part) * rest
    c, d = part * (1 - rest), part * rest
    north, east = x[0], x[1]
    cos = sin = X_c = X_s = Y_c = Y_s = N_c = N_s = 0.0
    for i in range(wave.shape[1]):
        p, q = turn(wave[1, i] * north + wave[2, i] * east - wave[3, i] * time + wave[4, i])
        p, q = wave[0, i] * p, wave[0, i] * q
        X = a * A[0, i] + b * B[0, i] + c * C[0, i] + d * D[0, i]
        Y = a * A[1, i] + b * B[1, i] + c * C[1, i] + d * D[1, i]
        N = a * A[2, i] + b * B[2, i] + c * C[2, i] + d * D[2, i]
        cos += p
        sin += q
        X_c += X * p
        X_s += X * q
        Y_c += Y * p
        Y_s += Y * q
        N_c += N * p
        N_s += N * q
    load[0] += cos * X_c + sin * X_s
    load[1] += cos * Y_c + sin * Y_s
    load[5] += cos * N_c + sin * N_s
