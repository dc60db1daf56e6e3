"""The MMG standard model of a ship with one propeller and one rudder, in three degrees of freedom, compiled for batches.

After H. Yasukawa and Y. Yoshimura, "Introduction of MMG standard method for ship maneuvering predictions", Journal of
Marine Science and Technology 20 (2015) 37-52. Axes at midship, x forward, y starboard, rudder positive to starboard.
Forces go by the velocity through the water. The propeller has four quadrants (see `propeller`).
"""

import math
from typing import Any, NamedTuple

from numba import njit

from aspnn.schema import InputError
from aspnn.simulation.ships.coefficients import coefficients
from aspnn.simulation.ships.dynamics import UNCOUNTED, register
from aspnn.simulation.ships.propeller import Propeller, lateral, rudder_flow, thrust
from aspnn.vessel import Vessel


class Mmg(NamedTuple):
    """Coefficients of the MMG standard method, all named as in the paper; a tuple, so that compiled code can take it.

    Lengths in m, nabla in m3, A_R in m2, rho in kg/m3; everything else is without dimension (primed in the paper), forces
    by 1/2 rho Lpp d U^2, moments by 1/2 rho Lpp^2 d U^2, masses by 1/2 rho Lpp^2 d, inertia by 1/2 rho Lpp^4 d. The names
    ending in plus and minus hold for beta_P (C2) or beta_R (gamma_R) of that sign.
    """

    rho: float
    Lpp: float
    d: float
    nabla: float
    x_G: float
    kzz: float
    m_x: float
    m_y: float
    J_z: float
    R_0: float
    X_vv: float
    X_vr: float
    X_rr: float
    X_vvvv: float
    Y_v: float
    Y_r: float
    Y_vvv: float
    Y_vvr: float
    Y_vrr: float
    Y_rrr: float
    N_v: float
    N_r: float
    N_vvv: float
    N_vvr: float
    N_vrr: float
    N_rrr: float
    D_P: float
    t_P: float
    w_P0: float
    x_P: float
    C1: float
    C2_plus: float
    C2_minus: float
    k0: float
    k1: float
    k2: float
    H_R: float
    A_R: float
    f_alpha: float
    t_R: float
    a_H: float
    x_H: float
    x_R: float
    gamma_R_plus: float
    gamma_R_minus: float
    l_R: float
    epsilon: float
    kappa: float
    propeller: Propeller
    exponential_wake: bool = False  # w_P = w_P0 exp(-4 beta_P^2) instead of the paper's C1, C2

    DEGREES = 3  # type: ignore[misc]  # of the class, no field

    @staticmethod
    def of(vessel: Vessel) -> "Mmg":
        """The coefficients in the vessel's section `mmg`. Raises InputError naming the one that is missing, unknown or absurd."""
        found = coefficients(vessel, "mmg", _BOUNDS, {"B": vessel.beam, "C_b": 0.7})
        L, B, d, nabla = (found[name] for name in ("Lpp", "B", "d", "nabla"))
        for name, value, low, high, of in (
            ("nabla", nabla / (L * B * d), 0.3, 1.0, "Lpp B d"),
            ("Lpp", L / vessel.length, 0.8, 1.05, "the length overall"),
            ("A_R", found["A_R"] / (L * d), 0.002, 0.12, "Lpp d"),
            ("D_P", found["D_P"] / d, 0.1, 1.2, "d"),
            ("x_G", abs(found["x_G"]) / L, 0.0, 0.1, "Lpp"),
        ):
            if not low <= value <= high:
                raise InputError(
                    f"{vessel.label}: mmg.{name} = {found[name]:g} is {value:.3g} of {of}, not {low:g} to {high:g};"
                    f" check its unit"
                )
        if found["D_P"] > found["H_R"]:
            raise InputError(f"{vessel.label}: mmg.D_P = {found['D_P']:g} is larger than the rudder's span mmg.H_R")
        numbers: dict[str, Any] = {name: found[name] for name in Mmg._fields if name in found}
        return Mmg(**numbers, propeller=Propeller.of(vessel))

    def balance(self, speed: float) -> tuple[float, float]:
        """Shaft speed [rev/s] whose thrust balances the resistance at a straight `speed` [m/s] in calm water; pitch ratio.

        The positive root n of (1 - t_P) D^4 (k0 n^2 + k1 n u_P / D + k2 u_P^2 / D^2) = 1/2 Lpp d R_0 U^2, u_P = (1 - w_P0) U,
        at the service pitch.
        """
        inflow = (1 - self.w_P0) * speed / self.D_P
        needed = 0.5 * self.Lpp * self.d * self.R_0 * speed**2 / ((1 - self.t_P) * self.D_P**4)
        b, c = self.k1 * inflow, self.k2 * inflow**2 - needed
        pitch = self.propeller.service if self.propeller.controllable else math.nan
        return (-b + math.sqrt(b**2 - 4 * self.k0 * c)) / (2 * self.k0), pitch


def _bounds() -> dict[str, tuple[float, float]]:
    """Between what every coefficient of a ship lies, from a model of 1 m to the largest ship; ratios are checked in `Mmg.of`."""
    bounds = {name: (-3.0, 3.0) for name in Mmg._fields if name[:2] in ("X_", "Y_", "N_")}
    bounds |= {"Lpp": (0.5, 500.0), "B": (0.1, 90.0), "d": (0.02, 30.0), "nabla": (1e-3, 1e6), "x_G": (-50.0, 50.0)}
    bounds |= {"rho": (950.0, 1060.0), "C_b": (0.3, 1.0), "kzz": (0.15, 0.4), "m_x": (0.0, 0.3), "m_y": (0.01, 1.5)}
    bounds |= {"J_z": (1e-4, 0.1), "R_0": (1e-3, 0.2), "D_P": (0.01, 15.0), "H_R": (0.02, 30.0), "A_R": (1e-4, 300.0)}
    bounds |= {"t_P": (0.0, 0.6), "w_P0": (0.0, 0.8), "t_R": (0.0, 0.9), "a_H": (0.0, 1.5), "x_H": (-1.0, 0.0)}
    bounds |= {"x_P": (-0.7, 0.0), "x_R": (-0.7, 0.0), "l_R": (-1.5, 0.0), "C1": (0.0, 20.0), "C2_plus": (0.0, 5.0)}
    bounds |= {"C2_minus": (0.0, 5.0), "k0": (0.02, 1.5), "k1": (-1.5, 0.5), "k2": (-1.0, 0.5), "f_alpha": (0.5, 6.3)}
    bounds |= {"gamma_R_plus": (0.05, 1.5), "gamma_R_minus": (0.05, 1.5), "epsilon": (0.3, 2.5), "kappa": (0.1, 1.0)}
    return bounds


_BOUNDS = _bounds()


MOST_YAW = 5.0  # |r'|: at 35 degrees of rudder ships reach about 1; the paper's polynomials are not fitted beyond


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, **UNCOUNTED)
def _accelerations(p, x, load, out):
    """Surge, sway and yaw of the MMG method (Yasukawa & Yoshimura 2015), into out[3:6]: hull, propeller, rudder and `load`.

    (m + m_x) u' - (m + m_y) v r - x_G m r^2 = X, (m + m_y) v' + (m + m_x) u r + x_G m r' = Y,
    (I_zG + x_G^2 m + J_z) r' + x_G m (v' + u r) = N.
    Hull: X_H' = -R_0' + X_vv v'^2 + ..., Y_H', N_H' likewise. The powers of U are multiplied out, which leaves sin beta = v / U
    and r' = r L / U. Both are regular at rest: the first is bounded, and the second is held to MOST_YAW. With sternway, where
    the method has no data, drift counts from the nearer end and the drag of the hull opposes the motion.
    Propeller: X_P = (1 - t_P) T, u_P = (1 - w_P) u; going astern, t_P stays (assumed) and `lateral` adds its transverse thrust.
    Wake: (1 - w_P) / (1 - w_P0) = 1 + (1 - exp(-C1 |beta_P|)) (C2 - 1), beta_P = beta - x_P' r'.
    Rudder: F_N = 1/2 rho A_R (u_R^2 + v_R^2) f_alpha sin(delta - atan(v_R / u_R)), v_R = U gamma_R beta_R,
    beta_R = beta - l_R' r', u_R = epsilon sqrt(eta (u_P + kappa (race - u_P))^2 + (1 - eta) u_P^2),
    race = sqrt(u_P^2 + 8 n^2 D^2 K_T / pi), which is the paper's expression without its division by J; other quadrants are those
    of `rudder_flow`. sin(delta - atan(...)) is written out, so that no angle is needed.
    """
    u, v, r, delta, n = x[3], x[4], x[5], x[6], x[7]
    U = math.sqrt(u * u + v * v)
    turn = r * p.Lpp  # m/s
    slowest = max(U, abs(turn) / MOST_YAW)
    yaw = turn / slowest if slowest > 0 else 0.0
    s = v / U if U > 0 else 0.0
    beta = math.atan2(-v, abs(u))

    resistance = math.copysign(p.R_0 * U * U, u)
    X = -resistance + p.X_vv * v * v + p.X_vr * v * turn + p.X_rr * turn * turn + p.X_vvvv * v * v * s * s
    Y = p.Y_v * v * U + p.Y_r * turn * U + p.Y_vvv * v * v * s
    Y += p.Y_vvr * v * s * turn + p.Y_vrr * s * turn * turn + p.Y_rrr * turn * turn * yaw
    N = p.N_v * v * U + p.N_r * turn * U + p.N_vvv * v * v * s
    N += p.N_vvr * v * s * turn + p.N_vrr * s * turn * turn + p.N_rrr * turn * turn * yaw

    beta_P = beta - p.x_P * yaw
    if p.exponential_wake:
        u_P = u * (1 - p.w_P0 * math.exp(-4 * beta_P * beta_P))
    else:
        C2 = p.C2_plus if beta_P > 0 else p.C2_minus
        u_P = u * (1 - p.w_P0) * (1 + (1 - math.exp(-p.C1 * abs(beta_P))) * (C2 - 1))
    loading = thrust(p.propeller, n, u_P, x[8])  # T / (rho D^2)

    flow = U * beta - p.l_R * turn  # U beta_R
    v_R = flow * (p.gamma_R_plus if flow > 0 else p.gamma_R_minus)
    u_R = p.epsilon * rudder_flow(u_P, loading, p.D_P / p.H_R, p.kappa)
    c_delta, s_delta = math.cos(delta), math.sin(delta)
    F_N = 0.5 * p.rho * p.A_R * p.f_alpha * math.sqrt(u_R * u_R + v_R * v_R) * (u_R * s_delta - v_R * c_delta)

    area = 0.5 * p.rho * p.Lpp * p.d
    Y_P, N_P = 0.0, 0.0
    if n < 0 or x[8] < 0:
        Y_P, N_P = lateral(p.propeller, n, u, x[8])
    water = p.rho * p.D_P * p.D_P
    X = area * X + (1 - p.t_P) * water * loading - (1 - p.t_R) * F_N * s_delta + load[0]
    Y = area * Y - (1 + p.a_H) * F_N * c_delta + water * Y_P + load[1]
    N = p.Lpp * (area * N - (p.x_R + p.a_H * p.x_H) * F_N * c_delta) + water * N_P + load[5]

    mass = area * p.Lpp
    m = p.rho * p.nabla
    m_x, m_y, x_m = m + p.m_x * mass, m + p.m_y * mass, p.x_G * m
    inertia = m * (p.kzz * p.Lpp) ** 2 + p.x_G * x_m + p.J_z * mass * p.Lpp * p.Lpp
    Y -= m_x * u * r
    N -= x_m * u * r
    share = 1 / (m_y * inertia - x_m * x_m)
    out[3] = (X + m_y * v * r + x_m * r * r) / m_x
    out[4] = (inertia * Y - x_m * N) * share
    out[5] = (m_y * N - x_m * Y) * share


register(Mmg, _accelerations)
