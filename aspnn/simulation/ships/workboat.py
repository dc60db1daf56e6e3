"""An 8 m workboat with one steerable drive, in six degrees of freedom, compiled. Illustrative: nothing here was measured on the boat.

It stands for the research vessel Ymir of the thesis, of which only dimensions, mass and top speed are published. Surge
and slow-speed damping are the Viknes 830's (8.45 m, 3980 kg; the public parameter set of colav-simulator, after O. Loe 2008), brought
to this size by Froude's law with forces in proportion to the mass. All else is assumed, and chosen so that energy can
only be lost to the water with the engine stopped:

- Resistance D_u u + D_uu u |u| / (1 + (u / U_p)^2): what planing saves beyond U_p, where the set's square law, fitted
  below 10 m/s, would ask for 26 kN at 30 kn.
- The sway drag of the set, spread over the hull as strips of cross-flow drag at a height z_d, which damps yaw as well.
- Lift shed at the trailing end, as slender-body theory has it: sideways -|u| m_y (v + x r - z p), upwards -|u| m_z (w - x q). The
  first holds the yawing Munk moment of the added mass, the second the pitching one, and carries part of a trimmed boat.
- The side lift's height z goes from z_d, below the centre of gravity, to z_l, above it, with s = u^2 / (u^2 + U_p^2): a planing
  bottom with deadrise is pushed along its normals, which meet up there. So the boat heels outward in a slow turn and banks
  into a fast one.
- A bow-up moment G55 trim s: the trim of a boat that begins to plane.

Levers: SHAFT is the propeller's speed [rev/s]; thrust n |n| k - k_u |n| u, along the drive. RUDDER is the drive's angle, positive
turns to starboard: the thrust then pushes the stern to port. Without thrust only the drive's leg steers, a small rudder:
its side force is leg u |u| sin(angle) across the leg.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.optimize import root

from aspnn.guidance.helms import (
    DOWN,
    HEAVE,
    PITCH,
    PITCH_RATE,
    ROLL_RATE,
    RUDDER,
    SHAFT,
    SIX,
    SURGE,
    SWAY,
    YAW_RATE,
)
from aspnn.schema import InputError
from aspnn.simulation.environment.waves import Box
from aspnn.simulation.ships.coefficients import coefficients
from aspnn.simulation.ships.dynamics import register
from aspnn.simulation.ships.sixdof import GRAVITY, Body, afloat, cross_flow, respond, rigid_mass
from aspnn.vessel import Vessel


class Workboat(NamedTuple):
    """Coefficients of the boat: body, drag, lift and drive; SI, heights z downward from the still waterline."""

    body: Body
    box: Box  # what waves press on
    length: float  # m, of the strips
    D_u: float  # N s/m
    D_uu: float  # N s2/m2
    U_p: float  # m/s
    D_v: float  # N s/m
    D_vv: float  # N s2/m2, of the whole hull
    D_r: float  # N m s
    D_rrr: float  # N m s3
    z_d: float  # height of the sway drag
    m_y: float  # kg/m, of the side lift
    m_z: float  # kg/m, of the upward lift
    x_l: float  # where the lift is shed when the boat runs ahead; at -x_l when it backs
    z_l: float  # height of the side lift when planing
    trim: float  # rad, that the bow-up moment would hold alone
    k_pos: float  # N s2: thrust at rest over n^2
    k_neg: float
    k_u: float  # N s2/m: thrust lost by speed
    x_n: float  # place of the drive
    z_n: float
    leg: float  # kg/m

    DEGREES = 6  # type: ignore[misc]  # of the class, no field

    @staticmethod
    def of(vessel: Vessel) -> "Workboat":
        """The model of a vessel file's section `workboat`. Raises InputError naming vessel and coefficient."""
        c = coefficients(vessel, "workboat", BOUNDS)
        m, rho, L = c["m"], c["rho"], c["L"]
        inertia = m * np.array([c["R44"], c["R55"], c["R66"]]) ** 2
        volume = m / rho
        surge = 2.7 * rho * volume ** (5 / 3) / L**2  # H. Soeding (1982), as for the Otter
        added = (surge, c["a22"] * m, c["a33"] * m, *(inertia * [c["a44"], c["a55"], c["a66"]]))
        mass = rigid_mass(m, np.array([c["x_g"], 0.0, c["z_g"]]), np.diag(inertia)) + np.diag(added)
        springs = (rho * GRAVITY * c["A_w"], m * GRAVITY * c["GM_T"], m * GRAVITY * c["GM_L"])
        body = afloat(mass, springs, c["LCF"], (c["zeta_heave"], c["zeta_roll"], c["zeta_pitch"]))
        trim = math.radians(c["trim_deg"])
        box = Box.fit(L, c["A_w"], volume)
        box = box._replace(added_surge=surge / m, added_sway=c["a22"], added_heave=c["a33"], rho=rho)
        return Workboat(body=body, box=box, length=L, trim=trim, **{k: c[k] for k in Workboat._fields if k in c})

    def balance(self, speed: float) -> tuple[float, float]:
        """Shaft speed [rev/s] that holds a straight `speed` [m/s]; the propeller's pitch is fixed. Raises InputError as `running`."""
        return self.running(speed)[0], math.nan

    def attitude(self, speed: float) -> tuple[float, float, float]:
        """How far midship is down [m], roll and pitch [rad] on a straight course at `speed` [m/s]."""
        _, down, pitch = self.running(speed)
        return down, 0.0, pitch

    def running(self, speed: float) -> tuple[float, float, float]:
        """Shaft speed [rev/s], how far midship is down [m] and pitch [rad] of the boat at a straight `speed` [m/s].

        Speed, heave and pitch steady. Raises InputError where no such state is found.
        """
        if speed == 0:
            return 0.0, 0.0, self.body.pitch
        out, calm = np.zeros(SIX), np.zeros(6)

        def unsteady(guess):
            row = np.zeros(SIX)
            row[SHAFT], row[DOWN], row[PITCH] = guess
            row[SURGE], row[HEAVE] = speed, speed * math.tan(guess[2])  # level
            _accelerations(self, row, calm, out)
            return out[[SURGE, HEAVE, PITCH_RATE]]

        u, k = abs(speed), self.k_pos if speed > 0 else self.k_neg
        drag = u * (self.D_u + self.D_uu * u / (1 + (u / self.U_p) ** 2))
        level = (self.k_u * u + math.sqrt((self.k_u * u) ** 2 + 4 * k * drag)) / (2 * k)
        found = root(unsteady, [math.copysign(level, speed), 0.0, 0.0])
        if not found.success:
            raise InputError(f"the workboat has no steady state at {speed:g} m/s; choose a lower speed")
        return float(found.x[0]), float(found.x[1]), float(found.x[2])


BOUNDS = {
    "rho": (900, 1100),
    "L": (2, 30),
    "m": (100, 1e5),
    "x_g": (-5, 5),
    "z_g": (-5, 5),
    "R44": (0.1, 5),
    "R55": (0.3, 12),
    "R66": (0.3, 12),
    "a22": (0, 5),
    "a33": (0, 5),
    "a44": (0, 5),
    "a55": (0, 5),
    "a66": (0, 5),
    "A_w": (0.5, 300),
    "GM_T": (0.05, 10),
    "GM_L": (0.5, 200),
    "LCF": (-5, 5),
    "zeta_heave": (0, 2),
    "zeta_roll": (0, 2),
    "zeta_pitch": (0, 2),
    "D_u": (0, 1e5),
    "D_uu": (0.1, 1e5),
    "U_p": (0.5, 1e6),
    "D_v": (0, 1e6),
    "D_vv": (1, 1e6),
    "D_r": (0, 1e7),
    "D_rrr": (0, 1e8),
    "z_d": (-3, 3),
    "m_y": (0, 1e5),
    "m_z": (0, 1e5),
    "x_l": (-15, 0),
    "z_l": (-5, 5),
    "trim_deg": (0, 15),
    "k_pos": (1e-3, 1e5),
    "k_neg": (1e-3, 1e5),
    "k_u": (0, 1e4),
    "x_n": (-15, 0),
    "z_n": (-3, 3),
    "leg": (0, 1e4),
}


@njit(cache=True, nogil=True, error_model="numpy")
def _accelerations(b, x, load, out):
    """out[3:6], out[12:15] <- velocity derivatives of the state row x at its levers, under the external `load` (6)."""
    u, v, w = x[SURGE], x[SWAY], x[HEAVE]
    p, q, r = x[ROLL_RATE], x[PITCH_RATE], x[YAW_RATE]
    square = u * u / (b.U_p * b.U_p)
    s = square / (1 + square)

    low = v - b.z_d * p  # sway where the drag acts
    side, turning = cross_flow(low, r, b.length)
    per_length = b.D_vv / b.length
    drag = b.D_v * low + per_length * side

    end = b.x_l if u > 0 else -b.x_l
    height = b.z_d + s * (b.z_l - b.z_d)
    side_lift = abs(u) * b.m_y * (v + end * r - height * p)
    up_lift = abs(u) * b.m_z * (w - end * q)

    n, angle = x[SHAFT], x[RUDDER]
    thrust = (b.k_pos if n > 0 else b.k_neg) * n * abs(n) - b.k_u * abs(n) * u
    sine, cosine = math.sin(angle), math.cos(angle)
    across = b.leg * u * abs(u) * sine
    ahead = thrust * cosine - across * sine
    abeam = -thrust * sine - across * cosine

    X = -u * (b.D_u + b.D_uu * abs(u) / (1 + square)) + ahead + load[0]
    Y = -drag - side_lift + abeam + load[1]
    Z = -up_lift + load[2]
    K = b.z_d * drag + height * side_lift - b.z_n * abeam + load[3]
    M = end * up_lift + b.z_n * ahead + load[4]
    if u > 0:
        M += b.body.G55 * b.trim * s
    N = -(b.D_r + b.D_rrr * r * r) * r - per_length * turning - end * side_lift + b.x_n * abeam + load[5]
    respond(b.body, x, X, Y, Z, K, M, N, out)


register(Workboat, _accelerations)
