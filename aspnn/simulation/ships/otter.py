"""The Otter, an unmanned catamaran of 2 m with two propellers, in six degrees of freedom, compiled.

After `otter.m` of the Marine Systems Simulator (T. I. Fossen; MIT licence) in its state of July 2026, axes at midship. Three
things differ from it, none by more than 1 % in a turn: the cross-flow integrals are exact (MSS: 20 strips), the vertical
cross-flow is that of w - x q (MSS: w + x q, which takes the bow for the stern), and spring and heave, roll and pitch damping act
on the boat's motion against the water's surface (`sixdof.respond`), not along its trimmed axes. The payload's weight goes
into the equilibrium alone; a payload force that pitches with the boat would push it ahead.

Levers: SHAFT [rev/s] is the mean propeller speed, and asks for the surge force of both propellers at it. RUDDER [rad], the
steering lever, asks for a yaw moment in proportion; full lever is the largest moment that needs no surge force, one
propeller at full astern and the other as strong ahead. `guidance.allocation` shares both out. The propellers' own lag, 0.1 s, is that of the
integrator's shaft servo (section `engine`).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from aspnn.guidance.allocation import share, speed_for, thrust_at
from aspnn.guidance.helms import HEAVE, PITCH_RATE, RUDDER, SHAFT, SURGE, SWAY, YAW_RATE
from aspnn.schema import InputError
from aspnn.simulation.environment.waves import Box
from aspnn.simulation.ships.coefficients import coefficients
from aspnn.simulation.ships.dynamics import register
from aspnn.simulation.ships.sixdof import GRAVITY, Body, afloat, cross_flow, cross_matrix, hoerner, respond, rigid_mass
from aspnn.vessel import Vessel


class Otter(NamedTuple):
    """Coefficients of the Otter: body, drag and propellers. SI throughout; propeller speeds in rad/s as in the source."""

    body: Body
    box: Box  # what waves press on
    length: float
    D11: float  # N s/m
    D22: float  # N s/m
    D66: float  # N m s
    nl_yaw: float  # s: the yaw damping is D66 (1 + nl_yaw |r|) r
    cross: float  # kg/m2: 1/2 rho draught C_d
    arm: float  # m, of each propeller from the centre line
    k_pos: float  # kg m: thrust ahead is k_pos n^2
    k_neg: float
    ahead: float  # N, greatest thrust of one propeller
    astern: float
    moment: float  # N m per rad of steering lever

    DEGREES = 6  # type: ignore[misc]  # of the class, no field

    @staticmethod
    def of(vessel: Vessel) -> "Otter":
        """The model of a vessel file's section `otter` with its payload. Raises InputError naming vessel and coefficient."""
        c = coefficients(vessel, "otter", BOUNDS)
        hull, payload = np.array([c["x_g"], 0.0, c["z_g"]]), np.array([c["x_p"], c["y_p"], c["z_p"]])
        m, total, rho, L = c["m"], c["m"] + c["m_p"], c["rho"], c["L"]
        centre = (m * hull + c["m_p"] * payload) / total
        inertia = np.diag(m * np.array([c["R44"], c["R55"], c["R66"]]) ** 2)
        for part, at in ((m, hull - centre), (c["m_p"], payload - centre)):
            inertia -= part * cross_matrix(at) @ cross_matrix(at)
        surge = 2.7 * rho * (m / rho) ** (5 / 3) / L**2  # H. Soeding (1982), "Prediction of Ship Steering Capabilities"
        I = np.diag(inertia)
        added = (surge, c["a22"] * m, c["a33"] * m, c["a44"] * I[0], c["a55"] * I[1], c["a66"] * I[2])
        mass = rigid_mass(total, centre, inertia) + np.diag(added)

        volume = total / rho
        draught = volume / (2 * c["Cb_pont"] * c["B_pont"] * L)
        area = 2 * c["Cw_pont"] * L * c["B_pont"]
        Cw = c["Cw_pont"]
        across = L * c["B_pont"] ** 3 / 6 * 6 * Cw**3 / ((1 + Cw) * (1 + 2 * Cw)) + area * c["y_pont"] ** 2
        along = 0.8 * c["B_pont"] * L**3 / 6
        above = (5 * draught / 2 - volume / (2 * L * c["B_pont"])) / 3 - (draught - centre[2])  # KB - KG
        weight = total * GRAVITY
        springs = (rho * GRAVITY * area, weight * (above + across / volume), weight * (above + along / volume))
        if min(springs) <= 0:
            raise InputError(f"{vessel.label}: otter.z_p = {c['z_p']:g} m makes it capsize (GM < 0); lower the payload")
        extra = c["m_p"] * GRAVITY
        overload = (extra, c["y_p"] * extra, -c["x_p"] * extra)
        astern = 0.5 * c["bollard_astern"]
        plain = {
            "length": L,
            "D11": c["bollard_ahead"] / c["U_max"],
            "D22": float(mass[1, 1]) / c["T_sway"],
            "D66": float(mass[5, 5]) / c["T_yaw"],
            "nl_yaw": c["nl_yaw"],
            "cross": 0.5 * rho * draught * hoerner(c["B_pont"], draught),
            "arm": c["y_pont"],
            "k_pos": c["k_pos"],
            "k_neg": c["k_neg"],
            "ahead": 0.5 * c["bollard_ahead"],
            "astern": astern,
            "moment": 2 * c["y_pont"] * astern / vessel.rudder_max,
        }
        ratios = (c["zeta_heave"], c["zeta_roll"], c["zeta_pitch"])
        box = Box.fit(L, area, volume, 2 * c["y_pont"])
        box = box._replace(
            added_surge=surge / total, added_sway=c["a22"] * m / total, added_heave=c["a33"] * m / total, rho=rho
        )
        return Otter(body=afloat(mass, springs, c["LCF"], ratios, overload), box=box, **plain)

    def attitude(self, speed: float) -> tuple[float, float, float]:
        """How far midship is down [m], roll and pitch [rad] on a straight course; those at rest, whatever the speed."""
        return 0.0, self.body.roll, self.body.pitch

    def balance(self, speed: float) -> tuple[float, float]:
        """Shaft speed [rev/s] of both propellers that holds a straight `speed` [m/s]; their pitch is fixed."""
        thrust = 0.5 * self.D11 * speed
        if not -self.astern <= thrust <= self.ahead:
            raise InputError(
                f"the Otter cannot hold {speed:g} m/s: it runs {2 * self.ahead / self.D11:.4g} m/s ahead,"
                f" {2 * self.astern / self.D11:.4g} m/s astern"
            )
        return speed_for(self, thrust) / (2 * math.pi), math.nan


BOUNDS = {
    "rho": (900, 1100),
    "L": (0.5, 10),
    "m": (5, 5000),
    "m_p": (0, 5000),
    "x_g": (-5, 5),
    "z_g": (-5, 5),
    "x_p": (-5, 5),
    "y_p": (-5, 5),
    "z_p": (-5, 5),
    "R44": (0.05, 10),
    "R55": (0.05, 10),
    "R66": (0.05, 10),
    "B_pont": (0.05, 5),
    "y_pont": (0.05, 5),
    "Cw_pont": (0.3, 1),
    "Cb_pont": (0.2, 1),
    "LCF": (-5, 5),
    "a22": (0, 5),
    "a33": (0, 5),
    "a44": (0, 5),
    "a55": (0, 5),
    "a66": (0, 5),
    "T_sway": (0.05, 100),
    "T_yaw": (0.05, 100),
    "nl_yaw": (0, 1000),
    "zeta_heave": (0, 2),
    "zeta_roll": (0, 2),
    "zeta_pitch": (0, 2),
    "U_max": (0.1, 30),
    "bollard_ahead": (1, 1e5),
    "bollard_astern": (1, 1e5),
    "k_pos": (1e-5, 100),
    "k_neg": (1e-5, 100),
}


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _pushed(p, x, port, starboard, load, out):
    """Velocity derivatives under the two thrusts [N], drag, cross-flow and the external `load` (6)."""
    u, v, w, q, r = x[SURGE], x[SWAY], x[HEAVE], x[PITCH_RATE], x[YAW_RATE]
    side, turning = cross_flow(v, r, p.length)
    vertical, tilting = cross_flow(w, -q, p.length)
    X = port + starboard - p.D11 * u + load[0]
    Y = -p.D22 * v - p.cross * side + load[1]
    Z = -p.cross * vertical + load[2]
    M = p.cross * tilting + load[4]
    N = p.arm * (port - starboard) - p.D66 * (1 + p.nl_yaw * abs(r)) * r - p.cross * turning + load[5]
    respond(p.body, x, X, Y, Z, load[3], M, N, out)


@njit(cache=True, nogil=True, error_model="numpy")
def propelled(model, x, n_port, n_starboard, load, out):
    """As `accelerations`, with the propellers at `n_port` and `n_starboard` [rad/s] whatever the levers in x say."""
    _pushed(model, x, thrust_at(model, n_port), thrust_at(model, n_starboard), load, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _accelerations(p, x, load, out):
    """out[3:6], out[12:15] <- velocity derivatives of the state row x at its levers, under the external `load` (6)."""
    port, starboard = share(p, 2 * thrust_at(p, 2 * math.pi * x[SHAFT]), p.moment * x[RUDDER])
    _pushed(p, x, port, starboard, load, out)


register(Otter, _accelerations)
