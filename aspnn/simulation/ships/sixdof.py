"""A craft afloat in six degrees of freedom: mass about midship, Coriolis forces, restoring and radiation damping, cross-flow.

Axes at midship, x forward, y starboard, z down; the origin lies in the still waterline at rest. T. I. Fossen, "Handbook of
Marine Craft Hydrodynamics and Motion Control" (Wiley 2021), writes M nu' + C(nu) nu + D nu + G eta = tau. Two things are done
so that energy is kept exactly at any attitude and not only at small angles:

- C(nu) nu comes from the momentum of body and added mass together (Kirchhoff's equations), not from a matrix: with
  (P, H) = M nu the forces are omega x P and the moments omega x H + v x P. The Munk moments are in it.
- Spring and radiation damping act on (down, roll, pitch) and their rates, which is where the water's surface is, and go into body
  axes by the transpose of the kinematics. At small angles this is G eta + D nu.

Both are linear in the angles: such a craft has no vanishing stability and cannot capsize.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from aspnn.guidance.helms import DOWN, HEAVE, PITCH, PITCH_RATE, ROLL, ROLL_RATE, SURGE, SWAY, YAW_RATE

GRAVITY = 9.81
# S. F. Hoerner's drag coefficient of a rectangle in cross-flow by beam / (2 draught), read off by A. J. P. Leite et al., "Current force
# in tankers and bifurcation of equilibrium of turret systems", Applied Ocean Research 20 (1998), as in MSS Hoerner.m.
_HOERNER = np.array(
    [
        (0.0108623, 1.96608),
        (0.176606, 1.96573),
        (0.353025, 1.89756),
        (0.451863, 1.78718),
        (0.472838, 1.58374),
        (0.492877, 1.27862),
        (0.493252, 1.21082),
        (0.558473, 1.08356),
        (0.646401, 0.998631),
        (0.833589, 0.87959),
        (0.988002, 0.828415),
        (1.30807, 0.759941),
        (1.63918, 0.691442),
        (1.85998, 0.657076),
        (2.31288, 0.630693),
        (2.59998, 0.596186),
        (3.00877, 0.586846),
        (3.45075, 0.585909),
        (3.7379, 0.559877),
        (4.00309, 0.559315),
    ]
)


class Body(NamedTuple):
    """Inertia, springs and dampers of a craft afloat, about midship.

    `mass` (6, 6) of body and water for (u, v, w, p, q, r), and its inverse. Stiffness G of (down, roll, pitch) [N/m, N, N m/rad] and
    damping D of their rates, both symmetric about the centre plane. `roll` and `pitch` are those at rest [rad].
    """

    mass: np.ndarray
    inverse: np.ndarray
    G33: float
    G35: float
    G44: float
    G55: float
    D33: float
    D44: float
    D55: float
    roll: float
    pitch: float


def rigid_mass(mass: float, centre: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Mass matrix (6, 6) about midship of a body with its centre of gravity at `centre` (3) and `inertia` (3, 3) about that.

    [[m I, -m S], [m S, I_g - m S^2]] with S the cross product with `centre` (Fossen 2021, 3.3.1).
    """
    S = cross_matrix(centre)
    return np.block([[mass * np.eye(3), -mass * S], [mass * S, inertia - mass * S @ S]])


def cross_matrix(a: np.ndarray) -> np.ndarray:
    """S (3, 3) with S b = a x b."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0.0]])


def afloat(mass: np.ndarray, springs, flotation: float, ratios, overload=(0.0, 0.0, 0.0)) -> Body:
    """The body of a `mass` matrix (6, 6) on springs.

    `springs` (3) are the stiffnesses in heave [N/m], roll and pitch [N m/rad] about the centre of flotation, which lies `flotation`
    [m] forward of midship; D = 2 `ratios` sqrt(G M), one by one, with the stiffness there and the mass about midship
    (as MSS otter.m). `overload` is the force [N], roll and pitch moment [N m] of a load that the origin and the upright
    position do not account for: what it sinks the craft goes into the origin, what it heels and trims into the rest.
    """
    heave, roll, pitch = springs
    dampers = 2 * np.array(ratios) * np.sqrt(np.array(springs) * np.diag(mass)[2:5])
    G35, G55 = -flotation * heave, pitch + flotation**2 * heave
    _, heel, trim = np.linalg.solve([[heave, 0, G35], [0, roll, 0], [G35, 0, G55]], overload)
    return Body(mass, np.linalg.inv(mass), *(float(c) for c in (heave, G35, roll, G55, *dampers, heel, trim)))


def hoerner(beam: float, draught: float) -> float:
    """Two-dimensional drag coefficient of a section in cross-flow; beyond the curve (0.011 to 4.0 half beams a draught) its end."""
    return float(np.interp(beam / (2 * draught), *_HOERNER.T))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def cross_flow(v, r, length):
    """The integrals of f |f| and x f |f| over x in +-length / 2 with f = v + x r: strip theory's drag and moment, exact.

    Where f keeps its sign this is a polynomial; where it changes sign within the hull |r| length / 2 > |v|, and f is the
    variable to integrate by. No branch divides by anything small.
    """
    half = 0.5 * length
    if abs(r) * half <= abs(v):
        square = half * half / 3
        side = math.copysign(2 * half, v)
        return side * (v * v + r * r * square), side * 2 * v * r * square
    fore, aft = v + half * r, v - half * r
    cubes = (abs(fore) ** 3 - abs(aft) ** 3) / 3
    return cubes / r, ((fore * abs(fore) ** 3 - aft * abs(aft) ** 3) / 4 - v * cubes) / (r * r)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def respond(b, x, X, Y, Z, K, M, N, out):
    """out[3:6], out[12:15] <- time derivatives of the velocities of Body `b` in the state row x under a force and moment at midship.

    To X, Y, Z [N], K, M, N [N m], in body axes, come the Coriolis forces -(omega x P), -(omega x H + v x P), (P, H) = M nu, and
    spring and damper: -J^T (G (down, roll, pitch) + D (down', roll', pitch')), with (down', roll', pitch') = J nu.
    """
    u, v, w = x[SURGE], x[SWAY], x[HEAVE]
    p, q, r = x[ROLL_RATE], x[PITCH_RATE], x[YAW_RATE]
    m = b.mass
    P0, P1, P2 = _row(m, 0, u, v, w, p, q, r), _row(m, 1, u, v, w, p, q, r), _row(m, 2, u, v, w, p, q, r)
    H0, H1, H2 = _row(m, 3, u, v, w, p, q, r), _row(m, 4, u, v, w, p, q, r), _row(m, 5, u, v, w, p, q, r)
    X -= q * P2 - r * P1
    Y -= r * P0 - p * P2
    Z -= p * P1 - q * P0
    K -= q * H2 - r * H1 + v * P2 - w * P1
    M -= r * H0 - p * H2 + w * P0 - u * P2
    N -= p * H1 - q * H0 + u * P1 - v * P0

    roll, pitch = x[ROLL], x[PITCH]
    sin_roll, cos_roll, sin_pitch, cos_pitch = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    tan_pitch = sin_pitch / cos_pitch
    across, upright = cos_pitch * sin_roll, cos_pitch * cos_roll
    roll_rate = p + (sin_roll * q + cos_roll * r) * tan_pitch
    heel, trim = roll - b.roll, pitch - b.pitch
    lift = b.G33 * x[DOWN] + b.G35 * trim + b.D33 * (-sin_pitch * u + across * v + upright * w)
    righting = b.G44 * heel + b.D44 * roll_rate
    trimming = b.G35 * x[DOWN] + b.G55 * trim + b.D55 * (cos_roll * q - sin_roll * r)
    X += sin_pitch * lift
    Y -= across * lift
    Z -= upright * lift
    K -= righting
    M -= sin_roll * tan_pitch * righting + cos_roll * trimming
    N -= cos_roll * tan_pitch * righting - sin_roll * trimming

    i = b.inverse
    out[SURGE] = _row(i, 0, X, Y, Z, K, M, N)
    out[SWAY] = _row(i, 1, X, Y, Z, K, M, N)
    out[HEAVE] = _row(i, 2, X, Y, Z, K, M, N)
    out[ROLL_RATE] = _row(i, 3, X, Y, Z, K, M, N)
    out[PITCH_RATE] = _row(i, 4, X, Y, Z, K, M, N)
    out[YAW_RATE] = _row(i, 5, X, Y, Z, K, M, N)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _row(m, i, a, b, c, d, e, f):
    return m[i, 0] * a + m[i, 1] * b + m[i, 2] * c + m[i, 3] * d + m[i, 4] * e + m[i, 5] * f
