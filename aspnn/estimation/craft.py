"""A linearly damped craft in surge, sway and yaw whose surge mass is not known: the trimaran of paper 003, as an estimator sees it.

Y. Peng and J. Han, "Tracking Control of Unmanned Trimaran Surface Vehicle" (2007), eqs. (1) and (2). Plain numpy for any number of
craft; the simulator has its own compiled one.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

NORTH, EAST, HEADING, SURGE, SWAY, YAW_RATE, MASS = range(7)


class Craft(NamedTuple):
    """Masses m11, m22 [kg], inertia m33 [kg m2], damping d11, d22 [kg/s], d33 [kg m2/s]; each a number or an array of many craft's."""

    m11: float | np.ndarray
    m22: float
    m33: float
    d11: float
    d22: float
    d33: float


PAPER = Craft(200.0, 250.0, 80.0, 70.0, 100.0, 50.0)  # section IV


def rates(craft: Craft, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Time derivative (6, ...) of north, east [m], heading [rad], surge, sway [m/s] and yaw rate [rad/s] (6, ...) (1)-(2).

    `tau` (2, ...): surge force [N] and yaw moment [N m]. The sway has no actuator.
    """
    _, _, heading, u, v, r = x
    force, moment = tau
    c, s = np.cos(heading), np.sin(heading)
    return np.array(
        [
            u * c - v * s,
            u * s + v * c,
            r + 0 * u,
            (craft.m22 * v * r - craft.d11 * u + force) / craft.m11,
            (-craft.m11 * u * r - craft.d22 * v) / craft.m22,
            ((craft.m11 - craft.m22) * u * v - craft.d33 * r + moment) / craft.m33,
        ]
    )


def advance(craft: Craft, x: np.ndarray, tau: np.ndarray, dt: float) -> np.ndarray:
    """The state (6, ...) after `dt` [s] of forces `tau` (2, ...) held: one step of Runge and Kutta, of order 4."""
    k1 = rates(craft, x, tau)
    k2 = rates(craft, x + 0.5 * dt * k1, tau)
    k3 = rates(craft, x + 0.5 * dt * k2, tau)
    k4 = rates(craft, x + dt * k3, tau)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@dataclass(frozen=True)
class WanderingMass:
    """State (7, ...): position, heading, velocities and m11 [kg], which wanders. The six of the motion are measured.

    What `tau` (2, ..., 1) the controls gave is known.
    """

    craft: Craft = PAPER

    def transition(self, X: np.ndarray, u, dt: float) -> np.ndarray:
        """The states after `dt` [s]."""
        moved = advance(self.craft._replace(m11=X[MASS]), X[:MASS], u, dt)
        return np.concatenate([moved, X[MASS:]])

    def measure(self, X: np.ndarray) -> np.ndarray:
        """Position, heading, velocities (6, ...)."""
        return X[:MASS]
