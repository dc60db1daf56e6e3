"""The Mariner class cargo ship of Chislett and Strom-Tejsen in three degrees of freedom: a polynomial about one speed, compiled.

M. S. Chislett and J. Strom-Tejsen, "Planar Motion Mechanism Tests and Full-Scale Steering and Maneuvering Predictions for
a Mariner Class Vessel", report Hy-5, Hydro- and Aerodynamics Laboratory, Lyngby 1965, in the form of `mariner.m` of the
Marine Systems Simulator (T. I. Fossen and T. Perez). Axes at midship, x forward, y starboard.

The propulsion is implicit: the surge terms say how thrust and resistance differ when the speed leaves the nominal speed at
which the propeller balances. So SHAFT has one meaning here, that of the nominal speed: U0 n / n0, with n0 the shaft speed
in service [assumed]. The tests were run ahead; there is no propeller to stop or back the ship with, and a shaft that does not
turn ahead counts as stopped.
"""

import math
from typing import NamedTuple

from numba import njit

from aspnn.guidance.helms import RUDDER, SHAFT, SURGE, SWAY, YAW_RATE
from aspnn.simulation.ships.coefficients import coefficients
from aspnn.simulation.ships.dynamics import register
from aspnn.vessel import Vessel

DOMAIN = 0.5  # |u'|: at 1 the polynomial's sway and yaw damping, which go with 1 + u', would vanish; a hard turn reaches 0.33


class Mariner(NamedTuple):
    """Coefficients of the prime-I system: forces by 1/2 rho L^2 U^2, moments by 1/2 rho L^3 U^2, U the ship's own speed.

    L [m], U0 [m/s], n0 [rev/s], rho [kg/m3]; masses by 1/2 rho L^3, inertia by 1/2 rho L^5, everything else without dimension.
    `d` is the rudder angle, positive to port as in the source; `Xvdot` and the like are the added masses with their sign.
    """

    rho: float
    L: float
    U0: float  # nominal speed at n0
    n0: float
    m: float
    Iz: float
    xG: float
    Xudot: float
    Yvdot: float
    Yrdot: float
    Nvdot: float
    Nrdot: float
    Xu: float
    Xuu: float
    Xuuu: float
    Xvv: float
    Xrr: float
    Xrv: float
    Xdd: float
    Xudd: float
    Xvd: float
    Xuvd: float
    Yv: float
    Yr: float
    Yvvv: float
    Yvvr: float
    Yvu: float
    Yru: float
    Yd: float
    Yddd: float
    Yud: float
    Yuud: float
    Yvdd: float
    Yvvd: float
    Y0: float
    Y0u: float
    Y0uu: float
    Nv: float
    Nr: float
    Nvvv: float
    Nvvr: float
    Nvu: float
    Nru: float
    Nd: float
    Nddd: float
    Nud: float
    Nuud: float
    Nvdd: float
    Nvvd: float
    N0: float
    N0u: float
    N0uu: float

    DEGREES = 3  # type: ignore[misc]  # of the class, no field

    @staticmethod
    def of(vessel: Vessel) -> "Mariner":
        """The model of a vessel file's section `mariner`. Raises InputError naming vessel and coefficient."""
        return Mariner(**coefficients(vessel, "mariner", BOUNDS))

    def balance(self, speed: float) -> tuple[float, float]:
        """Shaft speed [rev/s] whose nominal speed is `speed` [m/s]; the propeller's pitch is fixed."""
        return self.n0 * speed / self.U0, math.nan


POSITIVE = {"rho": (900, 1100), "L": (1, 500), "U0": (0.1, 30), "n0": (0.01, 50), "m": (1e-3, 0.05), "Iz": (1e-5, 5e-3)}
ADDED = {"Xudot": (-0.05, 0), "Yvdot": (-0.05, 0), "Nrdot": (-5e-3, 0), "xG": (-0.2, 0.2)}
BOUNDS = {name: POSITIVE.get(name, ADDED.get(name, (-1.0, 1.0))) for name in Mariner._fields}


@njit(cache=True, nogil=True, error_model="numpy")
def _accelerations(p, x, load, out):
    """out[3:6] <- u', v', r' of the state row x under the external `load` (6) [N, N m].

    With S the total speed, u = (surge - U0 n / n0) / S, v = sway / S, r = yaw rate L / S, d = -rudder:
    X' = Xu u + Xuu u^2 + Xuuu u^3 + Xvv v^2 + Xrr r^2 + Xrv r v + Xdd d^2 + Xudd u d^2 + Xvd v d + Xuvd u v d,
    Y' = Yv v + Yr r + Yvvv v^3 + Yvvr v^2 r + Yvu v u + Yru r u + Yd d + Yddd d^3 + Yud u d + Yuud u^2 d + Yvdd v d^2
         + Yvvd v^2 d + Y0 + Y0u u + Y0uu u^2, and N' alike;
    (m - Xudot) u' = X' S^2 / L, [[m - Yvdot, m xG - Yrdot], [m xG - Nvdot, Iz - Nrdot]] (v', r' L) = (Y', N') S^2 / L.
    Yr, Nr, Yru, Nru and Xrv hold the centripetal terms, so no rigid-body Coriolis force is added. Y0 and N0, the pull of a
    single screw, make the ship turn by itself a little and port differ from starboard.

    Outside |u'| <= DOMAIN the polynomial keeps its value at that edge, and S does not fall below the speed at which the
    edge is reached on a straight course: no division by a speed near zero, forces that stay bounded.
    """
    nominal = p.U0 * max(x[SHAFT], 0.0) / p.n0
    S = max(math.hypot(x[SURGE], x[SWAY]), nominal / (1 + DOMAIN))
    u = v = r = 0.0
    if S > 0:
        u = min(max((x[SURGE] - nominal) / S, -DOMAIN), DOMAIN)
        v, r = x[SWAY] / S, x[YAW_RATE] * p.L / S
    d = -x[RUDDER]
    X = u * (p.Xu + u * (p.Xuu + u * p.Xuuu)) + p.Xvv * v * v + p.Xrr * r * r + p.Xrv * r * v
    X += d * d * (p.Xdd + p.Xudd * u) + v * d * (p.Xvd + p.Xuvd * u)
    Y = v * (p.Yv + p.Yvu * u + p.Yvvv * v * v) + r * (p.Yr + p.Yru * u + p.Yvvr * v * v)
    Y += d * (p.Yd + u * (p.Yud + p.Yuud * u) + p.Yddd * d * d + v * (p.Yvdd * d + p.Yvvd * v))
    Y += p.Y0 + u * (p.Y0u + u * p.Y0uu)
    N = v * (p.Nv + p.Nvu * u + p.Nvvv * v * v) + r * (p.Nr + p.Nru * u + p.Nvvr * v * v)
    N += d * (p.Nd + u * (p.Nud + p.Nuud * u) + p.Nddd * d * d + v * (p.Nvdd * d + p.Nvvd * v))
    N += p.N0 + u * (p.N0u + u * p.N0uu)
    scale, unit = S * S / p.L, 0.5 * p.rho * p.L**3
    X = X * scale + load[0] / unit
    Y = Y * scale + load[1] / unit
    N = N * scale + load[5] / (unit * p.L)
    m22, m23 = p.m - p.Yvdot, p.m * p.xG - p.Yrdot
    m32, m33 = p.m * p.xG - p.Nvdot, p.Iz - p.Nrdot
    determinant = m22 * m33 - m23 * m32
    out[SURGE] = X / (p.m - p.Xudot)
    out[SWAY] = (m33 * Y - m23 * N) / determinant
    out[YAW_RATE] = (m22 * N - m32 * Y) / determinant / p.L


register(Mariner, _accelerations)
