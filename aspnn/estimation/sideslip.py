"""Sideslip and cross-track error from positions, speed and heading: the two-state Kalman filter of paper 002, for a batch of ships.

    d/dt y_e = U sin(a) + U cos(a) beta,    d/dt beta = 0,    a = psi - alpha        (paper 002 (7), beta small)

`alpha` is the angle of the path, psi the heading, U the speed over ground, y_e the cross-track error, positive to starboard of the
path. beta is the sideslip over ground (crab angle), course minus heading: minus the `drift_rad` of STATES. All [rad, m, s], arrays (ships,).

Erratum E49: (8) is a differential equation. (7) needs a small beta: `EXACT` does not. What the second state learns comes by way of
U cos(a): across the path (a = +-90 degrees) it is not observable, its gain fades there and its variance grows until the ship turns along.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aspnn.angles import difference
from aspnn.estimation.measurements import carried, from_log
from aspnn.frames import to_north_east
from aspnn.records import Log
from aspnn.schema import InputError

SPAN = 5.0  # s over which positions tell the speed over ground
TURN = np.radians(45.0)  # from the line to the heading at which a new line is laid
STILL = 0.1  # of the service speed: slower is no way on which to tell a sideslip
QUICK = 9.0  # speeds over length: the bandwidth [rad/s] of a log's sideslip, chosen on the three sample logs
START = np.radians(20.0)  # standard deviation of the sideslip before anything is known


class Form(NamedTuple):
    """How y_e grows: its rate [m/s] and the slope of that rate by the second state, functions of (speed, a, state); what the
    state means as a sideslip [rad], and as the tangent of one."""

    rate: Callable
    slope: Callable
    sideslip: Callable
    tangent: Callable


def _linear_rate(speed, angle, state):
    return speed * (np.sin(angle) + np.cos(angle) * state)


def _linear_slope(speed, angle, state):
    return speed * np.cos(angle)


def _itself(state):
    return state


SMALL = Form(_linear_rate, _linear_slope, _itself, _itself)
"""As printed, (7): the speed over ground U; in a steady state on the path the second state is tan(beta), not beta."""
SURGE = Form(_linear_rate, _linear_slope, np.arctan, _itself)
"""Of the paper's reference [5]: y_e' = u sin a + v cos a = u (sin a + cos a tan beta), exact and linear in tan(beta). The speed is the
surge u over ground, which needs a log or a sensor of both velocities."""
EXACT = Form(
    lambda speed, angle, state: speed * np.sin(angle + state),
    lambda speed, angle, state: speed * np.cos(angle + state),
    _itself,
    np.tan,
)
"""y_e' = U sin(a + beta): exact for any beta, with the speed over ground that GNSS tells. Not in the paper."""


@dataclass(frozen=True)
class SideslipModel:
    """Noise of the filter: spectral densities of y_e [m2/s] and of the second state [rad2/s], variance of one fix of y_e [m2]."""

    cross_density: float
    sideslip_density: float
    fix_variance: float
    form: Form = EXACT

    def __post_init__(self):
        if min(self.cross_density, self.sideslip_density) < 0 or not self.fix_variance > 0:
            raise InputError(
                "sideslip filter: densities must not be negative and the variance of a fix must be above 0"
            )

    @staticmethod
    def published(period: float, form: Form = SMALL) -> "SideslipModel":
        """The paper's R = 10 and Q = 100 I of the continuous filter (9), for fixes every `period` [s]: a fix has R / period."""
        return SideslipModel(100.0, 100.0, 10.0 / period, form)

    @staticmethod
    def tuned(bandwidth: float, fix_sd: float, period: float, speed: float, form: Form = EXACT) -> "SideslipModel":
        """A filter whose estimate settles as a Butterworth filter of `bandwidth` [rad/s] at `speed` [m/s] along the path.

        Of (9) with Q = diag(0, q) the steady gains are sqrt(2 U sqrt(q / R)) and sqrt(q / R), so the error obeys s^2 + sqrt(2) w s + w^2
        with w^4 = U^2 q / R. R = `fix_sd`^2 `period` is what fixes of that standard deviation [m] are worth.
        """
        return SideslipModel(0.0, bandwidth**4 * fix_sd**2 * period / speed**2, fix_sd**2, form)


class SideslipFilter:
    """The filter of (8)-(10) for `ships` at once, exact from fix to fix for speed and angle held at their mean over the step.

    `cross` [m] and `state` (ships,) are the estimates, `covariance` (ships, 2, 2) theirs, `gain` (ships, 2) that of the last fix; a
    ship begins at its first fix. F = [[1, s h], [0, 1]] and Q_d = [[q_y h + q s^2 h^3 / 3, q s h^2 / 2], [., q h]], s the form's slope.
    """

    def __init__(self, model: SideslipModel, ships: int = 1):
        self.model = model
        self.cross, self.state = np.full(ships, np.nan), np.zeros(ships)
        self.covariance, self.gain = np.zeros((ships, 2, 2)), np.zeros((ships, 2))
        self.covariance[:, 1, 1] = START**2
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def sideslip(self) -> np.ndarray:
        """The estimated sideslip [rad], (ships,): course over ground minus heading."""
        return self.model.form.sideslip(self.state)

    @property
    def sd(self) -> np.ndarray:
        """Standard deviation of the second state, (ships,)."""
        return np.sqrt(self.covariance[:, 1, 1])

    def rebase(self, ships) -> None:
        """A new path begins for some `ships` (bool): y_e is another and starts at the next fix, what is known of the sideslip stays."""
        self.cross = np.where(ships, np.nan, self.cross)

    def step(self, dt: float, cross, speed, angle) -> None:
        """Go `dt` [s] on, to the instant of `cross` [m] (NaN: no fix), `speed` [m/s] and `angle` psi - alpha [rad], each (ships,)."""
        cross, speed, angle = (np.broadcast_to(np.asarray(x, float), self.cross.shape) for x in (cross, speed, angle))
        fresh = np.isnan(self.cross)
        before = (speed, angle) if self._last is None else self._last
        self._last = speed, angle
        mean_speed, mean_angle = 0.5 * (speed + before[0]), angle - 0.5 * difference(angle, before[1])
        m, P = self.model, self.covariance
        s = m.form.slope(mean_speed, mean_angle, self.state) * dt
        y = self.cross + dt * m.form.rate(mean_speed, mean_angle, self.state)
        yy = P[:, 0, 0] + s * (2 * P[:, 0, 1] + s * P[:, 1, 1]) + dt * (m.cross_density + m.sideslip_density * s**2 / 3)
        yb = P[:, 0, 1] + s * P[:, 1, 1] + m.sideslip_density * dt * s / 2
        bb = P[:, 1, 1] + m.sideslip_density * dt
        share = m.fix_variance / (yy + m.fix_variance)  # what is left of the variance of y_e
        gain = np.stack([1 - share, yb * (share / m.fix_variance)], axis=-1)
        fix = np.isfinite(cross)
        used = fix & ~fresh
        gain = np.where(used[:, None], gain, 0.0)
        off = np.where(used, cross - y, 0.0)
        self.state = self.state + gain[:, 1] * off
        bb = bb - gain[:, 1] * yb
        yy, yb = np.where(used, yy * share, yy), np.where(used, yb * share, yb)
        self.cross = np.where(fresh, cross, y + gain[:, 0] * off)
        yy, yb = np.where(fresh, m.fix_variance, yy), np.where(fresh, 0.0, yb)
        self.covariance = np.stack([yy, yb, yb, bb], axis=-1).reshape(-1, 2, 2)
        self.gain = gain


class Sideslip(NamedTuple):
    """What a log tells of the sideslip, arrays (n,): `time` [s], `angle` [rad], its standard deviation `sd`."""

    time: np.ndarray
    angle: np.ndarray
    sd: np.ndarray


def speed_over_ground(time, north, east, span: float = SPAN) -> np.ndarray:
    """Speed [m/s] (n,) by the way gone in the last `span` [s], of series without gaps; it looks at the past only.

    White position noise of sd s adds s sqrt(2) / span of noise; the chord is short of the arc by (r span)^2 / 24.
    """
    begun = np.maximum(time - span, time[0])
    passed = np.hypot(north - np.interp(begun, time, north), east - np.interp(begun, time, east))
    return np.where(time > time[0], passed / np.where(time > time[0], time - begun, 1.0), 0.0)


def sideslip_along(time, north, east, heading, speed, model: SideslipModel) -> Sideslip:
    """The sideslip of one craft that follows no path: lines are laid along its own heading.

    Whenever the heading has turned by TURN from the line, a new one begins at the next fix; so the filter always sees well. Series
    (n,) of positions [m] (NaN: no fix), heading and speed over ground; nothing looks ahead.
    """
    found = SideslipFilter(model)
    angle, sd = np.full(len(time), np.nan), np.full(len(time), np.nan)
    alpha, origin = float(heading[0]), (0.0, 0.0)
    for k in range(len(time)):
        laid = np.isnan(found.cross[0]) or abs(float(difference(heading[k], alpha))) > TURN
        if laid:
            alpha, origin = float(heading[k]), (north[k], east[k])
            found.rebase(True)
        cross = (east[k] - origin[1]) * np.cos(alpha) - (north[k] - origin[0]) * np.sin(alpha)
        found.step(time[k] - time[k - 1] if k else 0.0, cross, speed[k], difference(heading[k], alpha))
        angle[k], sd[k] = found.sideslip[0], found.sd[0]
    return Sideslip(np.asarray(time, float), angle, sd)


def log_sideslip(log: Log, bandwidth: float | None = None) -> Sideslip:
    """Sideslip at midship of a log of positions and headings: minus what `drift_rad` of its states is.

    It asks for one antenna and a heading, nothing else, and takes no part of the ship's motion as known. On the sample logs it errs by 0.6 to
    1.3 degrees rms, as the drift that `filter_log` finds in the same two sensors (0.8 to 1.1). With a rate gyro, accelerations and two antennas
    `filter_log` knows it better by far, to 0.2 to 0.4 degrees: there this adds nothing but a check that no model of motion stands behind.
    `bandwidth` [rad/s] says how fast the estimate follows, without it QUICK speeds over length. Raises InputError for a log
    without any fix or heading, or of a ship that lies still.
    """
    m = from_log(log)
    name = max(m.fixes, key=lambda antenna: int(np.isfinite(m.fixes[antenna]).sum()))
    heading = carried(m.heading, m.first_heading)
    north, east = m.fixes[name].T - np.stack(to_north_east(*m.stations[name], heading))
    told = np.isfinite(north)
    if np.count_nonzero(told) < 2:
        raise InputError(f"{log.path or 'log'}: antenna {name} has fewer than two fixes, which tell no sideslip")
    speed = speed_over_ground(m.time[told], north[told], east[told])
    typical = float(np.median(speed))
    if not typical > STILL * log.vessel.service_speed:
        raise InputError(f"{log.path or 'log'}: the ship lies still ({typical:.2f} m/s), which tells no sideslip")
    period = float(np.median(np.diff(m.time[told])))
    follow = QUICK * typical / log.vessel.length if bandwidth is None else bandwidth
    model = SideslipModel.tuned(follow, log.vessel.noise.position, period, typical)
    held = speed[np.maximum(np.cumsum(told) - 1, 0)]
    return sideslip_along(m.time, north, east, heading, held, model)
