"""The unmanned trimaran of Peng and Han in surge, sway and yaw: a test plant for estimators and controllers, compiled.

Y. Peng and J. Han, "Tracking Control of Unmanned Trimaran Surface Vehicle: Using Adaptive Unscented Kalman Filter to
Estimate the Uncertain Parameters" (2007), eqs. (1) and (2); with the force -tau_1 / d22 and the moment tau_3 where the paper
prints otherwise further on (E56). Linear damping alone bounds the motion.

A poor source of ship data without a controller: above u = sqrt(d22 d33 / (m11 (m22 - m11))), 0.707 m/s for the paper's
values and below the 1 m/s it runs at, a straight course is unstable and ends in a spin.

The paper lets the mass m11 vary, 200 + 20 sin(2 pi t / 10 s) kg from 50 s on. A model is a tuple: run a voyage in
pieces, each from the last state of the one before, with `model._replace(m11=...)`.
"""

import math
from typing import NamedTuple

from numba import njit

from aspnn.guidance.helms import RUDDER, SHAFT, SURGE, SWAY, YAW_RATE
from aspnn.simulation.ships.coefficients import coefficients
from aspnn.simulation.ships.dynamics import register
from aspnn.vessel import Vessel


class Trimaran(NamedTuple):
    """Coefficients of the paper's (2): masses m11, m22 [kg], inertia m33 [kg m2], damping d11, d22 [kg/s], d33 [kg m2/s].

    The levers are ours [assumed]: tau_1 = `thrust` [N s] x SHAFT [rev/s], tau_3 = `moment` [N m/rad] x RUDDER [rad].
    """

    m11: float
    m22: float
    m33: float
    d11: float
    d22: float
    d33: float
    thrust: float
    moment: float

    DEGREES = 3  # type: ignore[misc]  # of the class, no field

    @staticmethod
    def of(vessel: Vessel) -> "Trimaran":
        """The model of a vessel file's section `trimaran`, in which `moment` is that of full lever [N m]. Raises InputError."""
        found = coefficients(vessel, "trimaran", BOUNDS)
        found["moment"] /= vessel.rudder_max
        return Trimaran(**found)

    def balance(self, speed: float) -> tuple[float, float]:
        """Engine lever [rev/s] whose thrust balances the damping at a straight `speed` [m/s]; there is no pitch."""
        return self.d11 * speed / self.thrust, math.nan


BOUNDS = dict.fromkeys(Trimaran._fields, (1e-3, 1e9))


@njit(cache=True, nogil=True, error_model="numpy")
def _accelerations(p, x, load, out):
    """out[3:6] <- u', v', r' of the state row x under the external `load` (6) [N, N m]. The paper's (2), its origin midship:

    m11 u' = m22 v r - d11 u + tau_1, m22 v' = -m11 u r - d22 v, m33 r' = (m11 - m22) u v - d33 r + tau_3.
    """
    u, v, r = x[SURGE], x[SWAY], x[YAW_RATE]
    out[SURGE] = (p.m22 * v * r - p.d11 * u + p.thrust * x[SHAFT] + load[0]) / p.m11
    out[SWAY] = (-p.m11 * u * r - p.d22 * v + load[1]) / p.m22
    out[YAW_RATE] = ((p.m11 - p.m22) * u * v - p.d33 * r + p.moment * x[RUDDER] + load[5]) / p.m33


register(Trimaran, _accelerations)
