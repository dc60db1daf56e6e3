"""Waves: JONSWAP seas as sums of components, and what they do to ships to first order: motions of 3-DOF ships, loads on boats.

Waves are an array (n, 5), one row per component: amplitude a [m], wave number k [rad/m], direction it travels towards d [rad from
grid north], omega [rad/s], phase [rad]; the elevation, up positive, is the sum of a cos(k (north cos d + east sin d) - omega t +
phase). They are relative to the earth: a current carries ships through them but neither refracts nor shifts them.

In body axes, with mu = d - heading, c = cos mu, s = sin mu and theta the phase of a component at midship, the undisturbed pressure
is rho g a exp(-k z) cos(theta + k (c x + s y)). Over a box of length L, breadth B and draught T the integrals are closed, with
S_l = sin(p) / p, J_l = L / 2 j1(p), p = k c L / 2 (the means over the length of cos(k c x) and of x sin(k c x)), and S_b, J_b the
same of k s and the breadth; j1(p) = (sin p - p cos p) / p^2 is the spherical Bessel function.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import spherical_jn

from aspnn.simulation.environment.arithmetic import fade, spherical_bessel, turn
from aspnn.vessel import Vessel

GRAVITY = 9.81
SEA_WATER = 1025.0  # kg/m3
SHORTEST = (
    4.0  # times the peak frequency: where a drawn sea is cut off, above which lies 0.5 % of a JONSWAP sea's energy
)
BLOCK = 0.7  # assumed of vessels that do not tell their displacement
METACENTRE = 0.07  # height over the centre of gravity, in beams: assumed (KVLCC2 0.098, coasters about 0.06)
ROLL_DAMPING = 0.08  # of critical: assumed, a hull with bilge keels under way


def jonswap(omega: np.ndarray, height: float, period: float, gamma: float = 3.3) -> np.ndarray:
    """Spectral density [m2 s] at omega [rad/s] of a sea of significant `height` [m] and peak `period` [s].

    Hasselmann et al. (1973): S ~ omega^-5 exp(-5/4 (omega_p / omega)^4) gamma^exp(-((omega / omega_p - 1) / sigma)^2 / 2), sigma 0.07
    up to the peak, 0.09 beyond it, here scaled so that 4 sqrt(m0) = height by quadrature (the usual factor 5/16 H^2 omega_p^4
    (1 - 0.287 ln gamma), DNV-RP-C205, comes within 2 % of it for gamma of 1 to 7). Deep water, wind sea.
    """
    peak = 2 * np.pi / period
    grid = np.geomspace(0.25, 50, 20_000)  # nothing lies below, and 0.2e-6 of the energy beyond
    m0 = np.trapezoid(_shape(grid, gamma) * grid, np.log(grid))
    return height**2 / 16 / (m0 * peak) * _shape(np.asarray(omega) / peak, gamma)


def _shape(ratio: np.ndarray, gamma: float) -> np.ndarray:
    sigma = np.where(ratio <= 1, 0.07, 0.09)
    return ratio**-5 * np.exp(-1.25 * ratio**-4) * gamma ** np.exp(-0.5 * ((ratio - 1) / sigma) ** 2)


def draw_waves(
    rng: np.random.Generator,
    height: float,
    period: float,
    towards: float,
    spreading: float = math.inf,
    count: int = 25,
    gamma: float = 3.3,
    depth: float = math.inf,
) -> np.ndarray:
    """A random sea (count, 5) of significant `height` [m] and peak `period` [s] that travels `towards` [rad from grid north].

    Components share the energy equally, each of a random frequency in its own part of the JONSWAP spectrum up to SHORTEST peak
    frequencies, so no two records repeat. Directions are random about `towards`, with density ~ cos(theta / 2)^(2 s), s = `spreading`
    (Longuet-Higgins, Cartwright and Smith 1963); infinite is long-crested, 10 usual for a wind sea. `depth` [m] sets the wave number
    (omega^2 = g k tanh(k depth)); the spectrum stays that of deep water.
    """
    edges = 2 * np.pi / period * np.linspace(0.3, SHORTEST, 4000)
    energy = np.cumsum(jonswap(edges, 1.0, period, gamma))
    omega = np.interp((np.arange(count) + rng.uniform(size=count)) / count, energy / energy[-1], edges)
    side = 0.0 if math.isinf(spreading) else np.sqrt(rng.beta(0.5, spreading + 0.5, count)) * rng.choice([-1, 1], count)
    waves = np.empty((count, 5))
    waves[:, 0] = height / 4 * math.sqrt(2 / count)
    waves[:, 1] = wave_number(omega, depth)
    waves[:, 2] = towards + 2 * np.arcsin(side)
    waves[:, 3] = omega
    waves[:, 4] = rng.uniform(0, 2 * np.pi, count)
    return waves


def wave_number(omega: np.ndarray, depth: float = math.inf) -> np.ndarray:
    """k [rad/m] of omega^2 = g k tanh(k depth), by Newton's method from Eckart's approximation (1952)."""
    deep = np.asarray(omega) ** 2 / GRAVITY
    if math.isinf(depth):
        return deep
    k = deep / np.sqrt(np.tanh(deep * depth))
    for _ in range(6):
        slope = np.tanh(k * depth)
        k = k - (k * slope - deep) / (slope + k * depth * (1 - slope**2))
    return k


def elevation(waves: np.ndarray, north: np.ndarray, east: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Height of the water over its mean level [m] at places and times that are arrays of one shape, or broadcast to it."""
    height = np.zeros(np.broadcast_shapes(np.shape(north), np.shape(east), np.shape(time)))
    for a, k, towards, omega, phase in waves:
        height += a * np.cos(k * (north * math.cos(towards) + east * math.sin(towards)) - omega * time + phase)
    return height


class Hull(NamedTuple):
    """What the closed-form motions need of a ship: lengths in m, the roll's natural period [s] and its damping over critical."""

    length: float
    beam: float
    draught: float
    block: float
    roll_period: float
    roll_damping: float = ROLL_DAMPING

    @staticmethod
    def of(vessel: Vessel) -> "Hull":
        """The hull of a vessel file: block coefficient from the displacement of section mmg, else BLOCK; GM = METACENTRE beams
        (assumed), roll period 2 C B / sqrt(GM), C = 0.373 + 0.023 B / d - 0.043 L / 100 (IMO weather criterion, A.685(17)).
        """
        volume = vessel.simulator.get("mmg", {}).get("nabla")
        box = vessel.length * vessel.beam * vessel.draught
        block = min(volume / box, 1.0) if isinstance(volume, int | float) else BLOCK
        C = 0.373 + 0.023 * vessel.beam / vessel.draught - 0.043 * vessel.length / 100
        period = 2 * C * vessel.beam / math.sqrt(METACENTRE * vessel.beam)
        return Hull(vessel.length, vessel.beam, vessel.draught, block, period)


def motions(
    waves: np.ndarray,
    hull: Hull,
    north: np.ndarray,
    east: np.ndarray,
    heading: np.ndarray,
    surge: np.ndarray,
    time: np.ndarray,
) -> np.ndarray:
    """First-order motions (6, n) of a ship along its mean path: displacements in surge, sway, heave [m, body axes, heave down], roll,
    pitch, yaw [rad, starboard down, bow up, starboard].

    Path of midship and heading, speed ahead `surge` [m/s], time [s], all (n,). To be added to the path afterwards: they carry
    antennas and sensors and push no ship. A component of frequency of encounter omega_e = omega - k surge cos mu moves with the
    real part of H a exp(i theta), theta its phase at midship and H that of a steady course.

    Heave and pitch: J. Juncher Jensen, A. E. Mansour, A. S. Olsen, "Estimation of ship motions using closed-form expressions", Ocean
    Engineering 31 (2004) 61-85 (from two public transcriptions; of their Smith factors exp(-k T), exp(-k |cos mu| T) the first, which
    is the pressure's own), for a box of breadth B block: with alpha = |omega_e| / omega, b = k B alpha S^2,
    S = sin(x) / x exp(-k T alpha^2), x = k B alpha^2 / 2 (their A^2 / (k B alpha^3) is this b, regular at alpha = 0),
    heave up = exp(-k T) S_l (1 - k T - i b) / (1 - 2 k T alpha^2 - i b omega_e / omega), pitch = i 6 / L j1(p) instead of S_l. The
    paper gives amplitudes; the phase is that of the same terms. Roll: 1 - (omega_e / omega_4)^2 - 2 i zeta omega_e / omega_4 divides
    the wave slope as the bottom feels it, -i k s exp(-k T) S_l 3 j1(q) / q, q = k s B / 2 (Froude-Krylov; derived here).
    Surge, sway, yaw: Froude-Krylov force over the mass of the box, added mass alike on both sides, twice integrated in time; where
    the ship meets waves slower than they pass (following seas), the displacement is held to that of the water itself, by an
    omega_e^2 that does not fall below omega^2 and leaves it smoothly (by 5 % late at twice).

    Domain: linear, deep water, slender merchant hulls, Froude number up to about 0.3; the short waves that a hull hardly feels and
    the resonance of roll are the least certain.
    """
    north, east, heading, surge, time = (
        np.ascontiguousarray(one, dtype=float) for one in (north, east, heading, surge, time)
    )
    result = np.zeros((6, len(time)))
    _motions(waves, np.array(hull, float), north, east, heading, surge, time, result)
    return result


class Box(NamedTuple):
    """A box-shaped hull, or a pair of them `spacing` apart (centre to centre): lengths in m, density of the water in kg/m3.

    `beam` is that of one hull. The added masses, over the displaced mass, are those with which the boat's own equations go.
    """

    length: float
    beam: float
    draught: float
    spacing: float = 0.0
    added_surge: float = 0.0
    added_sway: float = 0.0
    added_heave: float = 0.0
    rho: float = SEA_WATER

    @staticmethod
    def fit(length: float, area: float, volume: float, spacing: float = 0.0) -> "Box":
        """The box of a boat's waterplane area [m2] and displaced volume [m3], so that it rides long waves as the boat floats."""
        return Box(length, area / length / (2 if spacing else 1), volume / area, spacing)


class Excitation(NamedTuple):
    """What a sea does to a box, made once per voyage: `wave` (4, n) holds k cos d, k sin d, omega, phase of each component, `load`
    (HEADINGS, 6, n) the amplitudes of X, Y, K, M (with sin theta) and Z, N (with cos theta) at headings evenly round the circle.
    """

    wave: np.ndarray
    load: np.ndarray

    @staticmethod
    def of(waves: np.ndarray, box: Box) -> "Excitation":
        """First-order load of the undisturbed pressure on a box (Froude-Krylov), with the diffraction of long waves.

        Per a and rho g area, e = exp(-k T), E = 1 - e, Q = (E - k T e) / k, and added masses A1, A2, A3 over the displaced mass:
        X = (1 + A1) c E S_l S_b sin theta, Y = (1 + A2) s E S_l S_b sin theta, Z = -(1 - A3 k T) e S_l S_b cos theta,
        K = (e J_b - (1 + A2) s Q S_b) S_l sin theta, M = -((1 - A3 k T) e J_l - (1 + A1) c Q S_l) S_b sin theta,
        N = ((1 + A2) s S_b J_l - (1 + A1) c S_l J_b) E cos theta, positive along and about body axes whose origin is midship in the
        waterline. A pair of hulls has S_b cos(h) and J_b cos(h) + spacing / 2 S_b sin(h), h = k s spacing / 2. Diffraction is added
        mass times the acceleration of the water (at the keel for heave, as in Jensen et al. 2004); its damping is left out.

        Derived here. Domain: linear, at the mean waterline, deep water, waves not much shorter than the hull.
        """
        a, k, towards, omega, phase = waves.T
        mu = towards - 2 * np.pi / HEADINGS * np.arange(HEADINGS)[:, None]
        c, s = np.cos(mu), np.sin(mu)
        S_l, J_l = _means(k * c, box.length)
        S, J = _means(k * s, box.beam)
        half = k * s * box.spacing / 2
        S_b, J_b = S * np.cos(half), J * np.cos(half) + box.spacing / 2 * S * np.sin(half)
        e = np.exp(-k * box.draught)
        E, lift = 1 - e, (1 - box.added_heave * k * box.draught) * e
        Q = (E - k * box.draught * e) / k
        along, across = (1 + box.added_surge) * c, (1 + box.added_sway) * s
        X, Y, Z = along * E * S_l * S_b, across * E * S_l * S_b, -lift * S_l * S_b
        K, M = (e * J_b - across * Q * S_b) * S_l, (along * Q * S_l - lift * J_l) * S_b
        N = (across * S_b * J_l - along * S_l * J_b) * E
        area = box.length * box.beam * (2 if box.spacing else 1)
        load = box.rho * GRAVITY * area * a * np.stack([X, Y, Z, K, M, N], axis=1)
        return Excitation(np.stack([k * np.cos(towards), k * np.sin(towards), omega, phase]), load)


HEADINGS = 256  # a linear table errs by at most (2 pi / 256)^2 / 8 (k L / 2)^2 of a component: 0.6 % for a wave of a third of the length


def _means(k: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Means of cos(k x) and of x sin(k x) over a width about zero."""
    return np.sinc(k * width / (2 * np.pi)), width / 2 * spherical_jn(1, k * width / 2)


# Sums over components may be taken in any order, which is what vectors of partial sums need; nothing else is given up.
@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def wave_load(excitation, x, time, load):
    """Adds the first-order load of the waves, X, Y, Z [N] and K, M, N [N m], to `load` (6,), for the place and heading in state row x.

    Body axes with the origin at midship in the waterline; amplitudes are linear between the headings of the table.
    """
    wave = excitation.wave
    place = x[2] * (HEADINGS / (2 * math.pi))
    before = np.floor(place)
    part = place - before
    row = int(before) % HEADINGS
    A, B = excitation.load[row], excitation.load[(row + 1) % HEADINGS]
    north, east = x[0], x[1]
    X = Y = Z = K = M = N = 0.0
    for i in range(wave.shape[1]):
        c, s = turn(wave[0, i] * north + wave[1, i] * east - wave[2, i] * time + wave[3, i])
        X += s * (A[0, i] + part * (B[0, i] - A[0, i]))
        Y += s * (A[1, i] + part * (B[1, i] - A[1, i]))
        Z += c * (A[2, i] + part * (B[2, i] - A[2, i]))
        K += s * (A[3, i] + part * (B[3, i] - A[3, i]))
        M += s * (A[4, i] + part * (B[4, i] - A[4, i]))
        N += c * (A[5, i] + part * (B[5, i] - A[5, i]))
    load[0] += X
    load[1] += Y
    load[2] += Z
    load[3] += K
    load[4] += M
    load[5] += N


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _motions(waves, hull, north, east, heading, surge, time, result):
    """The transfer functions of `motions`, component by component, and their sums; `result` (6, n) is filled."""
    L, B, T, block, roll_period, zeta = hull[0], hull[1], hull[2], hull[3], hull[4], hull[5]
    count = waves.shape[0]
    a, k, omega, phase = waves[:, 0].copy(), waves[:, 1].copy(), waves[:, 3].copy(), waves[:, 4].copy()
    towards_n, towards_e = np.cos(waves[:, 2]), np.sin(waves[:, 2])
    e = np.exp(-k * T)
    depth = (1 - e) / (k * T)  # the mean of exp(-k z) over the draught
    parts = np.empty((6, count))
    breadth, omega_4 = B * block, 2 * math.pi / roll_period
    gyration = (L * L + B * B) / 12
    for t in range(len(time)):
        ahead_n, ahead_e = math.cos(heading[t]), math.sin(heading[t])
        for i in range(count):
            c = towards_n[i] * ahead_n + towards_e[i] * ahead_e
            s = towards_e[i] * ahead_n - towards_n[i] * ahead_e
            omega_e = omega[i] - k[i] * surge[t] * c
            ratio = omega_e / omega[i]
            alpha = abs(ratio)
            cos, sin = turn(k[i] * (towards_n[i] * north[t] + towards_e[i] * east[t]) - omega[i] * time[t] + phase[i])
            cos, sin = a[i] * cos, a[i] * sin
            S_l, j_l = spherical_bessel(0.5 * k[i] * c * L)
            S_b, j_b = spherical_bessel(0.5 * k[i] * s * B)

            S, _ = spherical_bessel(0.5 * k[i] * breadth * alpha * alpha)
            b = k[i] * breadth * alpha * (S * fade(k[i] * T * alpha * alpha)) ** 2
            p, q = 1 - k[i] * T, 1 - 2 * k[i] * T * alpha * alpha
            over = e[i] / (q * q + b * b * ratio * ratio)
            up, lag = (p * q + b * b * ratio) * over, (p * b * ratio - b * q) * over  # (p - i b) / (q - i b ratio)
            parts[2, i] = -S_l * (up * cos - lag * sin)
            slope = 6 / L * j_l
            parts[4, i] = -slope * (up * sin + lag * cos)

            quick = omega_e / omega_4
            stiff, loss = 1 - quick * quick, 2 * zeta * quick
            # 3 j1(q) / q is 1 for long waves; k s 3 j1(q) / q = 6 / B j1(q)
            moment = 6 / B * j_b * e[i] * S_l / (stiff * stiff + loss * loss)  # -i moment (stiff + i loss)
            parts[3, i] = moment * (stiff * sin + loss * cos)

            square = omega[i] * omega[i]
            more = max(omega_e * omega_e - square, 0.0)
            slow = GRAVITY * k[i] * depth[i] / (square + more * more / (more + 0.1 * square))
            orbit = slow * S_l * S_b
            parts[0, i], parts[1, i] = -orbit * c * sin, -orbit * s * sin
            twist = -slow / gyration * (0.5 * L * j_l * s * S_b - 0.5 * B * j_b * c * S_l)
            parts[5, i] = twist * cos
        for m in range(6):
            total = 0.0
            for i in range(count):
                total += parts[m, i]
            result[m, t] = total
