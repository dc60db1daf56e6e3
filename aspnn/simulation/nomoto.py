"""Nomoto's constants of a ship, and its tightest turn: what a course autopilot and a route must know of it. Depends on ship and voyage."""

import math
from typing import NamedTuple

import numpy as np

from aspnn.guidance import helms
from aspnn.schema import InputError
from aspnn.simulation.integrate import calm, rates_of
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import run_on

STEP = 1e-5  # of the central differences, in m, m/s, rad and rad/s


class Nomoto(NamedTuple):
    """First-order model of steering, T r' + r = K delta: gain [1/s per rad of the rudder] and time [s], both negative for a ship that
    is unstable on a straight course."""

    K: float
    T: float


def linearised(ship: Ship, speed: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Steering about a straight course at `speed` [m/s] through the water (service speed): x' = A x + B delta, A (n, n), B (n,).

    x is sway and yaw rate and, of a craft of six degrees, down, roll, pitch, heave, roll rate and pitch rate. Surge and shaft
    are held: turning moves them in second order only.
    """
    state = ship.start(0.0, 0.0, 0.0, ship.service_speed if speed is None else speed)[0]
    moving = [helms.SWAY, helms.YAW_RATE, *range(helms.DOWN, ship.columns)]
    bent = np.array(
        [state + sign * STEP * np.eye(ship.columns)[i] for i in (*moving, helms.RUDDER) for sign in (1, -1)]
    )
    rates = rates_of(ship.compiled, calm(1), 0, 0.0, bent)[:, moving]
    slopes = ((rates[::2] - rates[1::2]) / (2 * STEP)).T
    return slopes[:, :-1], slopes[:, -1]


def nomoto(ship: Ship, speed: float | None = None) -> Nomoto:
    """Nomoto's constants of a ship at `speed` [m/s] through the water (service speed), from its linearised motion.

    The transfer function from rudder to yaw rate is C (s - A)^-1 B = K (1 - T s + ...): K = -C A^-1 B and T = C A^-2 B / K, which is
    T1 + T2 - T3 of the second-order model. Raises InputError where the rudder turns nothing.
    """
    A, B = linearised(ship, speed)
    first = np.linalg.solve(A, B)
    K = -float(first[1])  # yaw rate is the second state
    if not math.isfinite(K) or K == 0:
        raise InputError(
            f"{ship.vessel.label}: the rudder does not turn it at that speed, so it has no Nomoto constants"
        )
    return Nomoto(K, float(np.linalg.solve(A, first)[1]) / K)


def turning_radius(ship: Ship, speed: float | None = None, rudder: float | None = None) -> float:
    """Radius [m] of the steady turn under `rudder` [rad] (hard over) from `speed` [m/s] (service speed), the wider of the two sides.

    Advance through half a turn may be wider. Simulated for the time that 40 lengths take at that speed.
    """
    speed, rudder = ship.service_speed if speed is None else speed, ship.rudder.most if rudder is None else rudder
    dt = min(0.1, ship.largest_step(speed))
    steps = math.ceil(40 * ship.vessel.length / speed / dt)
    starts = np.repeat(ship.start(0.0, 0.0, 0.0, speed), 2, axis=0)
    last = run_on(ship, starts, np.repeat([[rudder], [-rudder]], steps, axis=1), dt=dt)[:, -1]
    return float(np.max(np.hypot(last[:, helms.SURGE], last[:, helms.SWAY]) / np.abs(last[:, helms.YAW_RATE])))
