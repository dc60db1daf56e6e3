"""A desired course that a craft can follow, with its rate and acceleration: what a feed-forward needs of a step in the order.

    chi''' + (2 zeta + 1) omega_n chi'' + (2 zeta + 1) omega_n^2 chi' + omega_n^3 (chi - ordered) = 0

A low-pass of first order behind a damped oscillator, both of natural frequency omega_n. Depends on angles and schema.
"""

import math
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from aspnn.angles import difference
from aspnn.schema import InputError


class ReferenceModel:
    """Reference model of third order for the courses of `ships` at once; the course rate is held within +-`most_rate` [rad/s].

    `course` [rad, continuous], `rate` [rad/s] and `acceleration` [rad/s2], each (ships,), are what is desired now; NaN until begun.
    """

    def __init__(self, omega_n: float, zeta: float = 1.0, most_rate: float = math.inf, ships: int = 1):
        if not (omega_n > 0 and zeta > 0 and most_rate > 0):
            raise InputError(
                f"reference model: omega_n {omega_n:g} rad/s, zeta {zeta:g} and rate {most_rate:g} rad/s must be above 0"
            )
        self.omega_n, self.zeta, self.most_rate = omega_n, zeta, most_rate
        self.course, self.rate, self.acceleration = np.full(ships, np.nan), np.zeros(ships), np.zeros(ships)

    def begin(self, course, ships=True) -> None:
        """Stand at `course` (ships,) [rad] and at rest, for those `ships` (ships,) alone."""
        self.course = np.where(ships, course, self.course)
        self.rate, self.acceleration = (np.where(ships, 0.0, x) for x in (self.rate, self.acceleration))

    def step(self, dt: float, ordered) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Course, rate and acceleration after `dt` [s] towards the course `ordered` (ships,) [rad], by the shorter way.

        Exact for an order held over the step, as long as the rate is within its limit. At the limit the rate stands there and the
        acceleration is none.
        """
        rows = _transition(self.omega_n, self.zeta, dt)
        ahead = difference(ordered, self.course)
        left, rate, acceleration = (a * -ahead + b * self.rate + c * self.acceleration for a, b, c in rows)
        held = np.clip(rate, -self.most_rate, self.most_rate)
        cut = held != rate
        # A course that cannot turn faster goes on at the limit: half the step's two rates apart is what it turned.
        self.course = self.course + np.where(cut, 0.5 * (self.rate + held) * dt, left + ahead)
        self.rate = held
        self.acceleration = np.where(cut, 0.0, acceleration)
        return self.course, self.rate, self.acceleration


@lru_cache(maxsize=16)
def _transition(omega_n: float, zeta: float, dt: float) -> np.ndarray:
    """exp(A dt) (3, 3) of (chi - ordered, chi', chi'')."""
    w, damping = omega_n, 2 * zeta + 1
    return expm(dt * np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(w**3), -damping * w**2, -damping * w]]))
