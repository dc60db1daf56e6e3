"""The service point of a ship with one propeller: resistance, pitch and shaft speed that go together."""

import math
from typing import NamedTuple

from scipy.optimize import brentq, minimize_scalar

from aspnn.schema import InputError
from aspnn.simulation.estimate import bseries
from aspnn.simulation.estimate.resistance import Form, resistance

AREA, BLADES = 0.55, 4  # of the propeller, Wageningen B4-55 (assumed)
SHAFT_LINE = 0.97  # of the engine's power arrives at the propeller (assumed)


class Screw(NamedTuple):
    """A propeller behind a ship: diameter [m], speed of its inflow [m/s], density of the water [kg/m3]."""

    D: float
    inflow: float
    rho: float

    def thrust(self, n: float, pitch: float) -> float:
        """rho n^2 D^4 K_T [N] at n [rev/s] and P/D `pitch`."""
        K_T, _ = bseries.thrust_torque(self.inflow / (n * self.D), pitch, AREA, BLADES)
        return self.rho * n * n * self.D**4 * float(K_T)

    def power(self, n: float, pitch: float) -> float:
        """2 pi rho n^3 D^5 K_Q [W]."""
        _, K_Q = bseries.thrust_torque(self.inflow / (n * self.D), pitch, AREA, BLADES)
        return 2 * math.pi * self.rho * n**3 * self.D**5 * float(K_Q)

    def speed_for(self, thrust: float, pitch: float) -> float:
        """Shaft speed [rev/s] at which P/D `pitch` gives `thrust` [N] > 0."""
        low = self.inflow / (1.6 * self.D)  # J 1.6, beyond that of no thrust
        return float(brentq(lambda n: self.thrust(n, pitch) - thrust, low, 100 * low))

    def best_pitch(self, thrust: float) -> float:
        """P/D that gives `thrust` [N] with the least power."""
        found = minimize_scalar(
            lambda pitch: self.power(self.speed_for(thrust, pitch), pitch),
            bounds=(bseries.LEAST, bseries.MOST),
            method="bounded",
        )
        return float(found.x)


class ServicePoint(NamedTuple):
    """Thrust [N], P/D, shaft speed [rev/s] and power at the propeller [W]; and where thrust and pitch come from."""

    thrust: float
    pitch: float
    shaft: float
    power: float
    balance: str
    choice: str


def service_point(
    form: Form, speed: float, t_P: float, screw: Screw, power: float | None = None, shaft: float | None = None
) -> ServicePoint:
    """The point at `speed` [m/s]. Without the engine's `power` [W] the thrust balances Holtrop's resistance, with it what it gives.

    Without the `shaft` speed [rev/s] the pitch is that of the best efficiency, with it the one that takes the power or gives
    the thrust. Raises InputError where the options cannot go together.
    """
    towed = resistance(form, speed, screw.rho) / (1 - t_P)
    holtrop = "Holtrop and Mennen 1982 at service speed, hull without bulb and appendages"
    given = None if power is None else SHAFT_LINE * power
    if given is None:
        balance, thrust = holtrop, towed
    else:
        balance = f"balances the thrust at the given power, {SHAFT_LINE:g} of it at the propeller"
    if shaft is not None:
        choice = "solved for the given shaft speed"
        if given is not None:
            pitch = _root(
                lambda p: screw.power(shaft, p) - given, bseries.LEAST, bseries.MOST, "--power and --rpm", screw
            )
            thrust = screw.thrust(shaft, pitch)
        else:
            pitch = _root(
                lambda p: screw.thrust(shaft, p) - thrust, bseries.LEAST, bseries.MOST, "--rpm and --speed", screw
            )
    else:
        choice = "that of the best efficiency (assumed)"
        if given is not None:

            def missing(thrust: float) -> float:
                pitch = screw.best_pitch(thrust)
                return screw.power(screw.speed_for(thrust, pitch), pitch) - given

            thrust = _root(missing, 0.05 * towed, 20 * towed, "--power and --speed", screw)
        pitch = screw.best_pitch(thrust)
        shaft = screw.speed_for(thrust, pitch)
    if thrust <= 0:
        raise InputError(
            f"--power and --rpm: a propeller of {screw.D:.3g} m gives no thrust then; check its diameter and --speed"
        )
    return ServicePoint(thrust, pitch, shaft, screw.power(shaft, pitch), balance, choice)


def _root(excess, low: float, high: float, options: str, screw: Screw) -> float:
    if excess(low) * excess(high) > 0:
        raise InputError(
            f"{options} do not go together: no Wageningen B4-55 propeller of {screw.D:.3g} m behind this hull has both;"
            f" check them or tell --propeller-diameter"
        )
    return float(brentq(excess, low, high))
