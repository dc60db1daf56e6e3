"""Line-of-sight laws for a heading that make up for the sideslip: Kalman filter, integral and adaptive; see `los` for what a law is.

A heading that points at the path is not a course along it: with the sideslip beta (course minus heading) y_e' = U sin(psi - alpha + beta).
The conventional law, `LineOfSight` of a heading, comes to rest where psi - alpha = -beta, `steady_offset` = lookahead tan(beta) beside
the path. The laws here estimate beta, and rest on the path. All keep a memory of `ships` at once; `reset` forgets it.

Near the path, with the heading kept, integral and adaptive law are one loop: s^2 + (U / lookahead) s + U kappa / lookahead^2, kappa = gamma
lookahead^2; `damped` chooses the gain by its damping. The Kalman filter does not act on y_e but on how y_e grows, and so
does not weaken the damping of the guidance; what it cannot see is an error of the heading control, which the others integrate away.

Depends on los, route, the sideslip filter and schema.
"""

import math

import numpy as np

from aspnn.angles import difference
from aspnn.estimation.sideslip import SideslipFilter, SideslipModel
from aspnn.guidance.los import checked, los_course
from aspnn.guidance.route import PathError
from aspnn.schema import InputError

MOST = math.radians(60)  # of the sideslip that is made up for: a wild estimate must not turn the ship back


def steady_offset(lookahead: float, sideslip) -> np.ndarray:
    """Where the conventional law comes to rest beside the path [m]: y_e = lookahead tan(beta).

    y_e' = U sin(psi - alpha + beta) = 0 with psi = alpha - atan(y_e / lookahead). Of a ship without leeway and with the speed V through the
    water, in a current c to starboard of the path, V sin(beta) = c: y_e = lookahead c / sqrt(V^2 - c^2).
    """
    return lookahead * np.tan(sideslip)


def tangent_heading(path_angle, cross, lookahead, slope) -> np.ndarray:
    """Paper 002 (11): alpha - atan(y_e / lookahead + slope), with slope = tan(beta), which the filter of (7) finds on the path.

    With beta itself (the letter of (11)) it rests lookahead (tan(beta) - beta) beside the path. The heading stays within 90 degrees of
    the path, and y_e dies out more slowly than in `crab_heading`, by cos(beta)^2 near the path.
    """
    return path_angle - np.arctan(cross / lookahead + slope)


def crab_heading(path_angle, cross, lookahead, sideslip) -> np.ndarray:
    """alpha - beta - atan(y_e / lookahead): the course, not the heading, is that of the line of sight, as if there were no sideslip.

    With beta known y_e' = -U y_e / sqrt(lookahead^2 + y_e^2), whatever beta. Also the adaptive law's (Fossen 2023).
    """
    return los_course(path_angle, cross, lookahead) - sideslip


def _los_rate(drift, cross, lookahead) -> np.ndarray:
    """-d/dt atan(cross / lookahead) with `drift` = d cross / dt."""
    return -drift / (lookahead * (1 + (cross / lookahead) ** 2))


class KalmanLos:
    """KF-based LOS: the sideslip filter of paper 002 in the loop, for a heading.

    `printed` is (11) with the measured y_e; else `crab_heading` with the filter's own y_e, which is smoother. An error.cross that is NaN
    (no fix) is bridged by the filter. `filter` is open to be looked at; its sideslip counts up to `most` [rad].
    """

    def __init__(
        self, lookahead: float, model: SideslipModel, ships: int = 1, printed: bool = False, most: float = MOST
    ):
        self.lookahead, self.model, self.printed, self.most = checked(lookahead), model, printed, most
        self.reset(ships)

    def reset(self, ships: int) -> None:
        """Forget the past, for `ships` at once from now on."""
        self.filter = SideslipFilter(self.model, ships)
        self._leg = np.zeros(ships, int)

    @property
    def sideslip(self) -> np.ndarray:
        """What is made up for [rad], (ships,)."""
        return np.clip(self.filter.sideslip, -self.most, self.most)

    def _told(self, error: PathError) -> tuple[np.ndarray, np.ndarray]:
        """y_e and tan(beta) that (11) takes."""
        reach = math.tan(self.most)
        cross = np.where(np.isfinite(error.cross), error.cross, self.filter.cross)
        return cross, np.clip(self.model.form.tangent(self.filter.state), -reach, reach)

    def __call__(self, error: PathError, speed, angle, dt: float) -> np.ndarray:
        """The desired heading [rad] (ships,); `speed` as the filter's form takes it, over ground, `angle` the heading."""
        self.filter.rebase(error.leg != self._leg)
        self._leg = error.leg
        self.filter.step(dt, error.cross, speed, difference(angle, error.path_angle))
        if self.printed:
            cross, slope = self._told(error)
            return tangent_heading(error.path_angle, cross, self.lookahead, slope)
        return crab_heading(error.path_angle, self.filter.cross, self.lookahead, self.sideslip)

    def rate(self, error: PathError, speed, course) -> np.ndarray:
        """The rate [rad/s] (ships,) of the desired heading on a straight path while the sideslip is steady."""
        drift = speed * np.sin(course - error.path_angle)
        if self.printed:
            cross, slope = self._told(error)
            return _los_rate(drift, cross + self.lookahead * slope, self.lookahead)
        return _los_rate(drift, self.filter.cross, self.lookahead)


class IntegralLos:
    """Integral LOS for a heading, after Borhaug, Pavlov and Pettersen (CDC 2008), in the form of the Marine Systems Simulator's ILOSpsi.

    psi = alpha - atan((y_e + kappa z) / lookahead),  z' = lookahead y_e / (lookahead^2 + (y_e + kappa z)^2)

    It rests where kappa z = lookahead tan(beta). The integral z [m] grows slowly far from the path, which keeps it from winding up.
    """

    def __init__(self, lookahead: float, kappa: float, ships: int = 1):
        if not kappa > 0:
            raise InputError(f"integral LOS: kappa = {kappa:g} m/s must be above 0")
        self.lookahead, self.kappa = checked(lookahead), kappa
        self.reset(ships)

    @staticmethod
    def damped(lookahead: float, speed: float, zeta: float = 1.0, ships: int = 1) -> "IntegralLos":
        """With kappa = U / (4 zeta^2), which damps the loop of heading and integral near the path by `zeta`."""
        return IntegralLos(lookahead, speed / (4 * zeta**2), ships)

    def reset(self, ships: int) -> None:
        """Forget the past, for `ships` at once from now on."""
        self.integral = np.zeros(ships)

    @property
    def sideslip(self) -> np.ndarray:
        """What is made up for [rad], (ships,)."""
        return np.arctan(self.kappa * self.integral / self.lookahead)

    def __call__(self, error: PathError, speed, angle, dt: float) -> np.ndarray:
        """The desired heading [rad] (ships,)."""
        aim = error.cross + self.kappa * self.integral
        self.integral = self.integral + dt * self.lookahead * error.cross / (self.lookahead**2 + aim**2)
        return los_course(error.path_angle, aim, self.lookahead)

    def rate(self, error: PathError, speed, course) -> np.ndarray:
        """The rate [rad/s] (ships,) of the desired heading on a straight path."""
        aim = error.cross + self.kappa * self.integral
        growth = self.kappa * self.lookahead * error.cross / (self.lookahead**2 + aim**2)
        return _los_rate(speed * np.sin(course - error.path_angle) + growth, aim, self.lookahead)


class AdaptiveLos:
    """Adaptive LOS for a heading, after Fossen (IEEE Trans. Control Systems Technology 31(6), 2023), as in the Marine Systems Simulator.

    psi = alpha - b - atan(y_e / lookahead),  b' = gamma lookahead y_e / sqrt(lookahead^2 + y_e^2),  |b| <= `most` [rad]

    b is the estimated sideslip, `gamma` in 1/(m s). The bound is a plain projection; the source's is smooth.
    """

    def __init__(self, lookahead: float, gamma: float, ships: int = 1, most: float = MOST):
        if not gamma > 0:
            raise InputError(f"adaptive LOS: gamma = {gamma:g} must be above 0")
        self.lookahead, self.gamma, self.most = checked(lookahead), gamma, most
        self.reset(ships)

    @staticmethod
    def damped(lookahead: float, speed: float, zeta: float = 1.0, ships: int = 1) -> "AdaptiveLos":
        """With gamma = U / (2 zeta lookahead)^2, which damps the loop of heading and estimate near the path by `zeta`."""
        return AdaptiveLos(lookahead, speed / (2 * zeta * checked(lookahead)) ** 2, ships)

    def reset(self, ships: int) -> None:
        """Forget the past, for `ships` at once from now on."""
        self.sideslip = np.zeros(ships)  # rad, what is made up for

    def _growth(self, cross) -> np.ndarray:
        return self.gamma * self.lookahead * cross / np.hypot(self.lookahead, cross)

    def __call__(self, error: PathError, speed, angle, dt: float) -> np.ndarray:
        """The desired heading [rad] (ships,)."""
        desired = crab_heading(error.path_angle, error.cross, self.lookahead, self.sideslip)
        self.sideslip = np.clip(self.sideslip + dt * self._growth(error.cross), -self.most, self.most)
        return desired

    def rate(self, error: PathError, speed, course) -> np.ndarray:
        """The rate [rad/s] (ships,) of the desired heading on a straight path."""
        drift = speed * np.sin(course - error.path_angle)
        return _los_rate(drift, error.cross, self.lookahead) - self._growth(error.cross)
