"""The MMG standard model of a ship with one propeller and one rudder, in three degrees of freedom, compiled for batches.

After H. Yasukawa and Y. Yoshimura, "Introduction of MMG standard method for ship maneuvering predictions", Journal of
Marine Science and Technology 20 (2015) 37-52. Axes at midship, x forward, y starboard, rudder positive to starboard.
Hydrodynamic forces go by the velocity through the water; a steady uniform current carries ship and water alike. Wind loads
are Blendermann's (see `_wind_load`). The propeller has one quadrant: ships run ahead, shaft speeds are not negative.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from aspnn.schema import InputError
from aspnn.vessel import Vessel

AIR_DENSITY = 1.224  # kg/m3, at 15 degrees Celsius and sea level


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
    exponential_wake: bool = False  # w_P = w_P0 exp(-4 beta_P^2) instead of the paper's C1, C2


class Air(NamedTuple):
    """Wind-load coefficients of Blendermann; areas in m2, lengths in m. Without areas there is no load."""

    A_F: float = 0.0  # frontal area
    A_L: float = 0.0  # lateral area
    length: float = 1.0  # overall
    CDt: float = 1.0
    CDl_0: float = 0.0  # longitudinal drag on A_F, wind from ahead
    CDl_pi: float = 0.0  # longitudinal drag on A_F, wind from astern
    delta: float = 0.0
    s_L: float = 0.0  # centroid of A_L, forward of midship


@dataclass(frozen=True)
class Ship:
    """What moves: the coefficients, the wind loads and the rudder servo (rate [rad/s], greatest angle [rad])."""

    name: str
    mmg: Mmg
    air: Air
    rudder_rate: float
    rudder_max: float

    @staticmethod
    def of(vessel: Vessel) -> "Ship":
        """The ship of a vessel file. Raises InputError naming the vessel and the coefficient that is missing or wrong."""
        if vessel.mmg is None:
            raise InputError(f"vessel {vessel.name}: has no section mmg, so it cannot be simulated")
        needed = [name for name in Mmg._fields if name not in Mmg._field_defaults]
        mmg = Mmg(**{name: _number(vessel.name, "mmg", vessel.mmg, name) for name in needed}, exponential_wake=False)
        for name in ("rho", "Lpp", "d", "nabla", "kzz", "D_P", "H_R", "A_R", "f_alpha", "k0", "R_0"):
            if getattr(mmg, name) <= 0:
                raise InputError(f"vessel {vessel.name}: mmg.{name} = {getattr(mmg, name):g} must be positive")
        for name in ("t_P", "w_P0", "t_R"):
            if not 0 <= getattr(mmg, name) < 1:
                raise InputError(f"vessel {vessel.name}: mmg.{name} = {getattr(mmg, name):g} must be in [0, 1)")
        if mmg.D_P > mmg.H_R:
            raise InputError(f"vessel {vessel.name}: mmg.D_P = {mmg.D_P:g} is larger than the rudder's span mmg.H_R")
        return Ship(vessel.name, mmg, _air(vessel), vessel.rudder_rate, vessel.rudder_max)


def _number(vessel: str, section: str, data: dict, name: str) -> float:
    value = data.get(name)
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"vessel {vessel}: {section}.{name} is missing or not a number")
    return float(value)


def _air(vessel: Vessel) -> Air:
    if vessel.wind is None:
        return Air()
    names = ("A_F", "A_L", "CDt", "CDl_0", "CDl_pi", "delta", "s_L")
    air = Air(length=vessel.length, **{name: _number(vessel.name, "wind", vessel.wind, name) for name in names})
    for name in ("A_F", "A_L", "CDt"):
        if getattr(air, name) <= 0:
            raise InputError(f"vessel {vessel.name}: wind.{name} = {getattr(air, name):g} must be positive")
    return air


def balanced_shaft_speed(mmg: Mmg, speed: float) -> float:
    """Shaft speed [rev/s] whose thrust balances the resistance at a straight `speed` [m/s] in calm water.

    The positive root n of (1 - t_P) D^4 (k0 n^2 + k1 n u_P / D + k2 u_P^2 / D^2) = 1/2 Lpp d R_0 U^2, u_P = (1 - w_P0) U.
    """
    inflow = (1 - mmg.w_P0) * speed / mmg.D_P
    needed = 0.5 * mmg.Lpp * mmg.d * mmg.R_0 * speed**2 / ((1 - mmg.t_P) * mmg.D_P**4)
    b, c = mmg.k1 * inflow, mmg.k2 * inflow**2 - needed
    return (-b + math.sqrt(b**2 - 4 * mmg.k0 * c)) / (2 * mmg.k0)


MOST_YAW = 5.0  # |r'|: at 35 degrees of rudder ships reach about 1; the paper's polynomials are not fitted beyond


@njit(cache=True, nogil=True, error_model="numpy")
def _hydrodynamics(p, u, v, r, delta, n):
    """Surge force, sway force [N] and yaw moment [N m] of hull, propeller and rudder (Yasukawa & Yoshimura 2015).

    Hull: X_H' = -R_0' + X_vv v'^2 + ..., Y_H', N_H' likewise. The powers of U are multiplied out, which leaves sin beta = v / U
    and r' = r L / U. Both are regular at rest: the first is bounded, and the second is held to MOST_YAW. With sternway, where
    the method has no data, drift counts from the nearer end and the drags of hull and stopped propeller oppose the motion.
    Propeller: X_P = (1 - t_P) rho n^2 D^4 K_T(J) with n^2 K_T = k0 n^2 + k1 n u_P / D + k2 u_P^2 / D^2, u_P = (1 - w_P) u.
    Wake: (1 - w_P) / (1 - w_P0) = 1 + (1 - exp(-C1 |beta_P|)) (C2 - 1), beta_P = beta - x_P' r'.
    Rudder: F_N = 1/2 rho A_R (u_R^2 + v_R^2) f_alpha sin alpha_R, alpha_R = delta - atan(v_R / u_R),
    v_R = U gamma_R beta_R, beta_R = beta - l_R' r',
    u_R = epsilon sqrt(eta (u_P + kappa (sqrt(u_P^2 + 8 n^2 D^2 K_T / pi) - u_P))^2 + (1 - eta) u_P^2), which is the paper's
    expression without its division by J.
    """
    U = math.hypot(u, v)
    turn = r * p.Lpp  # m/s
    slowest = max(U, abs(turn) / MOST_YAW)
    yaw = turn / slowest if slowest > 0 else 0.0
    s = v / U if U > 0 else 0.0
    beta = math.atan2(-v, abs(u))

    resistance = math.copysign(p.R_0 * U * U, u)
    X_H = -resistance + p.X_vv * v * v + p.X_vr * v * turn + p.X_rr * turn * turn + p.X_vvvv * v * v * s * s
    Y_H = p.Y_v * v * U + p.Y_r * turn * U + p.Y_vvv * v * v * s
    Y_H += p.Y_vvr * v * s * turn + p.Y_vrr * s * turn * turn + p.Y_rrr * turn * turn * yaw
    N_H = p.N_v * v * U + p.N_r * turn * U + p.N_vvv * v * v * s
    N_H += p.N_vvr * v * s * turn + p.N_vrr * s * turn * turn + p.N_rrr * turn * turn * yaw

    beta_P = beta - p.x_P * yaw
    if p.exponential_wake:
        u_P = u * (1 - p.w_P0 * math.exp(-4 * beta_P * beta_P))
    else:
        C2 = p.C2_plus if beta_P > 0 else p.C2_minus
        u_P = u * (1 - p.w_P0) * (1 + (1 - math.exp(-p.C1 * abs(beta_P))) * (C2 - 1))
    thrust = (p.k0 * n * n * p.D_P + p.k1 * n * u_P) * p.D_P + p.k2 * u_P * abs(u_P)  # n^2 D^2 K_T
    X_P = (1 - p.t_P) * p.rho * p.D_P * p.D_P * thrust

    flow = U * beta - p.l_R * turn  # U beta_R
    v_R = flow * (p.gamma_R_plus if flow > 0 else p.gamma_R_minus)
    eta = p.D_P / p.H_R
    race = math.sqrt(max(u_P * u_P + 8 / math.pi * thrust, 0.0))  # a slipstream does not flow backwards
    u_R = p.epsilon * math.sqrt(eta * ((1 - p.kappa) * u_P + p.kappa * race) ** 2 + (1 - eta) * u_P * u_P)
    F_N = 0.5 * p.rho * p.A_R * p.f_alpha * (u_R * u_R + v_R * v_R) * math.sin(delta - math.atan2(v_R, u_R))

    unit = 0.5 * p.rho * p.Lpp * p.d
    X = unit * X_H + X_P - (1 - p.t_R) * F_N * math.sin(delta)
    Y = unit * Y_H - (1 + p.a_H) * F_N * math.cos(delta)
    N = p.Lpp * (unit * N_H - (p.x_R + p.a_H * p.x_H) * F_N * math.cos(delta))
    return X, Y, N


@njit(cache=True, nogil=True, error_model="numpy")
def _wind_load(a, u, v):
    """Wind surge and sway force [N] and yaw moment [N m] on a ship that moves with (u, v) through still air.

    W. Blendermann, "Parameter identification of wind loads on ships", J. Wind Eng. Ind. Aerodyn. 51 (1994) 339-351, as in
    Fossen's handbook (10.1.2): with the angle gamma of the apparent wind off the bow,
    C_X = -CD_l cos gamma / D, C_Y = CD_t sin gamma / D, C_N = (s_L / L - 0.18 (|gamma| - pi / 2)) C_Y,
    D = 1 - delta / 2 (1 - CD_l A_F / (CD_t A_L)) sin^2(2 gamma). |gamma| makes a wind from port the mirror of one from starboard.
    """
    speed = math.hypot(u, v)
    if speed == 0 or a.A_L == 0:
        return 0.0, 0.0, 0.0
    cosine, sine = u / speed, -v / speed
    CDl = a.CDl_0 if u > 0 else a.CDl_pi
    D = 1 - 2 * a.delta * (1 - CDl * a.A_F / (a.CDt * a.A_L)) * (sine * cosine) ** 2
    pressure = 0.5 * AIR_DENSITY * speed * speed
    X = -pressure * a.A_F * CDl * cosine / D
    Y = pressure * a.A_L * a.CDt * sine / D
    gamma = math.atan2(abs(v), u)
    return X, Y, Y * (a.s_L - 0.18 * (gamma - math.pi / 2) * a.length)


@njit(cache=True, nogil=True, error_model="numpy")
def _rates(p, a, x, delta, n, current, wind):
    """Time derivatives of x = (north, east, heading, u, v, r), u and v through the water.

    (m + m_x) u' - (m + m_y) v r - x_G m r^2 = X, (m + m_y) v' + (m + m_x) u r + x_G m r' = Y,
    (I_zG + x_G^2 m + J_z) r' + x_G m (v' + u r) = N (Yasukawa & Yoshimura 2015, midship axes).
    The wind adds what it changes of the air's load; the load of still air is part of the resistance R_0. A current that is
    steady and uniform leaves these equations as they are and adds its velocity to that of the ship.
    """
    psi, u, v, r = x[2], x[3], x[4], x[5]
    c, s = math.cos(psi), math.sin(psi)
    X, Y, N = _hydrodynamics(p, u, v, r, delta, n)
    if wind[0] != 0 or wind[1] != 0:
        north, east = current[0], current[1]
        still = _wind_load(a, u + north * c + east * s, v + east * c - north * s)
        north, east = north - wind[0], east - wind[1]
        blown = _wind_load(a, u + north * c + east * s, v + east * c - north * s)
        X, Y, N = X + blown[0] - still[0], Y + blown[1] - still[1], N + blown[2] - still[2]
    unit = 0.5 * p.rho * p.Lpp * p.Lpp * p.d
    m = p.rho * p.nabla
    m_x, m_y, x_m = m + p.m_x * unit, m + p.m_y * unit, p.x_G * m
    inertia = m * (p.kzz * p.Lpp) ** 2 + p.x_G * x_m + p.J_z * unit * p.Lpp * p.Lpp
    Y_ = Y - m_x * u * r
    N_ = N - x_m * u * r
    determinant = m_y * inertia - x_m * x_m
    return (
        u * c - v * s + current[0],
        u * s + v * c + current[1],
        r,
        (X + m_y * v * r + x_m * r * r) / m_x,
        (inertia * Y_ - x_m * N_) / determinant,
        (m_y * N_ - x_m * Y_) / determinant,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _along(x, k, h):
    return (x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3], x[4] + h * k[4], x[5] + h * k[5])


@njit(cache=True, nogil=True, error_model="numpy")
def _step(p, a, rate, limit, before, order, n, current, wind, dt, after):
    """One Runge-Kutta step of order 4 for one ship, from `before` (7,) into `after` (7,).

    The rudder moves towards the order, held within `limit`, at `rate`: delta(t) = delta + clip(order - delta, -rate t, rate t),
    followed exactly inside the step.
    """
    x = (before[0], before[1], before[2], before[3], before[4], before[5])
    delta = before[6]
    way = min(max(order, -limit), limit) - delta
    middle = delta + min(max(way, -rate * dt / 2), rate * dt / 2)
    end = delta + min(max(way, -rate * dt), rate * dt)
    k1 = _rates(p, a, x, delta, n, current, wind)
    k2 = _rates(p, a, _along(x, k1, dt / 2), middle, n, current, wind)
    k3 = _rates(p, a, _along(x, k2, dt / 2), middle, n, current, wind)
    k4 = _rates(p, a, _along(x, k3, dt), end, n, current, wind)
    for i in range(6):
        after[i] = x[i] + dt / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i])
    after[6] = end


@njit(cache=True, nogil=True, error_model="numpy")
def step_batch(p, a, rate, limit, states, orders, shaft, current, wind, dt, after):
    """One step of every ship: `states` (batch, 7) into `after`; `orders`, `shaft` (batch,), `current`, `wind` (batch, 2)."""
    for b in range(states.shape[0]):
        _step(p, a, rate, limit, states[b], orders[b], shaft[b], current[b], wind[b], dt, after[b])


@njit(cache=True, nogil=True, error_model="numpy")
def run_batch(p, a, rate, limit, orders, shaft, current, wind, dt, paths):
    """All steps of every ship: `paths` (batch, steps + 1, 7) holds the start in its first row; `orders`, `shaft` (batch, steps)."""
    for b in range(paths.shape[0]):
        for k in range(orders.shape[1]):
            order, n = orders[b, k], shaft[b, k]
            _step(p, a, rate, limit, paths[b, k], order, n, current[b], wind[b], dt, paths[b, k + 1])


@njit(cache=True, nogil=True, error_model="numpy")
def rates_of(p, a, states, shaft, current, wind):
    """Derivatives (n, 6) of one ship's states (n, 7) at shaft speeds (n,): those of north, east, heading, u, v, r."""
    out = np.empty((states.shape[0], 6))
    for k in range(states.shape[0]):
        s = states[k]
        rates = _rates(p, a, (s[0], s[1], s[2], s[3], s[4], s[5]), s[6], shaft[k], current, wind)
        for i in range(6):
            out[k, i] = rates[i]
    return out
