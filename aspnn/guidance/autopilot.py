"""Course autopilot: PID with reference feed-forward, gains by pole placement on Nomoto's first-order model, a filtered reference.

    omega' = -omega / T + K delta / T      (paper 000 (27); course rate omega, steering delta)

What steers is a rudder [rad] or a yaw moment [N m]: the unit of K [1/s or s / (kg m2)] decides. Arrays are (ships,). Depends on angles and schema.
"""

import math
from dataclasses import dataclass

import numpy as np

from aspnn.angles import difference
from aspnn.schema import InputError


@dataclass(frozen=True)
class Gains:
    """Gains of a PID controller: `proportional` [what steers per rad], `derivative_time` and `integral_time` [s].

    An infinite `integral_time` leaves the integral out.
    """

    proportional: float
    derivative_time: float
    integral_time: float = math.inf

    def __post_init__(self):
        if not self.proportional > 0 or not self.derivative_time >= 0 or not self.integral_time > 0:
            raise InputError(
                f"autopilot: gains of {self.proportional:g}, {self.derivative_time:g} s and {self.integral_time:g} s; the first and"
                f" the last must be above 0, the second not below"
            )


def pole_placement(K: float, T: float, omega_n: float, zeta: float = 1.0) -> Gains:
    """Gains that give the course error the natural frequency `omega_n` [rad/s] and the damping `zeta`, paper 000 (32)-(34).

    Kp = T omega_n^2 / K, Td = (2 zeta omega_n T - 1) / (K Kp), Ti = 10 / omega_n, for a ship of gain `K` and time constant `T` [s], both
    negative for one that is unstable on a straight course. Raises InputError where the ship by itself is damped more than that.
    """
    if not K * T > 0 or not math.isfinite(K * T):
        raise InputError(f"autopilot: K = {K:g} and T = {T:g} s are of no ship; they must have one sign")
    if not omega_n > 0 or not zeta > 0:
        raise InputError(f"autopilot: omega_n = {omega_n:g} rad/s and zeta = {zeta:g} must be above 0")
    proportional = T / K * omega_n**2
    derivative = (2 * zeta * omega_n * T - 1) / (K * proportional)
    if derivative < 0:
        raise InputError(
            f"autopilot: omega_n = {omega_n:g} rad/s is too slow, the ship by itself is damped more; at least {0.5 / (zeta * T):.3g}"
        )
    return Gains(proportional, derivative, 10 / omega_n)


class CourseAutopilot:
    """PID course control with reference feed-forward of `ships` at once, paper 000 (29)-(30) with the signs and the 1 / K of E48.

    delta = T omega_d' / K + omega_d / K - Kp (e + integral of e / Ti + Td (omega - omega_d)), e the smallest angle course - desired,
    held within +-`limit` (None: none). The integral waits while the command is beyond the limit and the error would drive it further
    (conditional integration: unlike back-calculation it needs no gain, and it leaves a command within the limit alone).
    A ship whose course is NaN gets amidships, and its integral waits. Each (ships,) [s]: `saturated`, the time so far in which the command
    was cut; `longest`, the longest of it without a break.
    """

    def __init__(self, gains: Gains, K: float, T: float, limit: float | None = None, ships: int = 1):
        if limit is not None and not limit > 0:
            raise InputError(f"autopilot: a limit of {limit:g} leaves nothing to steer with; it must be above 0")
        self.gains, self.K, self.T = gains, K, T
        self.limit = math.inf if limit is None else limit
        self.reset(ships)

    def reset(self, ships: int) -> None:
        """Forget the past, for `ships` at once from now on."""
        self.integral = np.zeros(ships)  # rad s, of the course error
        self.saturated, self.longest = np.zeros(ships), np.zeros(ships)
        self._spell = np.zeros(ships)  # s, in which it has been cut till now

    def command(
        self, dt: float, course, course_rate, desired, desired_rate=0.0, desired_acceleration=0.0
    ) -> np.ndarray:
        """What is ordered for the next `dt` [s], (ships,). Course, rate and what is desired of them in rad and rad/s, (ships,)."""
        error = difference(course, desired)
        ahead = (self.T * np.asarray(desired_acceleration, float) + desired_rate) / self.K
        proportional, derivative, integral = (
            self.gains.proportional,
            self.gains.derivative_time,
            self.gains.integral_time,
        )
        rate_error = np.asarray(course_rate, float) - desired_rate
        asked = ahead - proportional * (error + self.integral / integral + derivative * rate_error)
        given = np.clip(asked, -self.limit, self.limit)
        known = np.isfinite(asked)
        cut = known & (asked != given)
        self.integral = self.integral + np.where(known & ~(cut & (asked * error < 0)), error, 0.0) * dt
        self.saturated = self.saturated + cut * dt
        self._spell = np.where(cut, self._spell + dt, 0.0)
        self.longest = np.maximum(self.longest, self._spell)
        return np.where(known, given, 0.0)


class ReferenceFilter:
    """First-order low-pass of a desired course and its rate, paper 000 (44), which takes the jumps out of them at a waypoint.

    y' = (x - y) / `time_constant`, exact for a desired value held over each step; the course goes the shorter way round. 0 s: no filter;
    ships may have one constant each (ships,).
    """

    def __init__(self, time_constant: float | np.ndarray, ships: int = 1):
        constant = np.asarray(time_constant, float)
        wrong = ~((constant >= 0) & np.isfinite(constant))
        if wrong.any():
            raise InputError(
                f"autopilot: a filter of {constant[wrong].flat[0]:g} s for the course; it must be 0 or more"
            )
        self.time_constant = constant
        self.course = np.full(ships, np.nan)  # rad, continuous; NaN until it has begun
        self.rate = np.zeros(ships)  # rad/s, of the course it was given

    def begin(self, course, ships=True) -> None:
        """Stand at `course` (ships,) [rad] and at rest, for those `ships` (ships,) alone. Who is not begun stands at what is desired first."""
        self.course = np.where(ships, course, self.course)
        self.rate = np.where(ships, 0.0, self.rate)

    def step(self, dt: float, desired, desired_rate=0.0) -> tuple[np.ndarray, np.ndarray]:
        """Course [rad] and rate [rad/s] after `dt` [s] of what is desired, each (ships,)."""
        filtered = self.time_constant > 0
        gain = np.where(filtered, -np.expm1(-dt / np.where(filtered, self.time_constant, 1.0)), 1.0)
        moved = self.course + gain * difference(desired, self.course)
        self.course = np.where(np.isfinite(self.course), moved, desired)
        self.rate = self.rate + gain * (np.asarray(desired_rate, float) - self.rate)
        return self.course, self.rate
