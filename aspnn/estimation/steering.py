"""How a ship answers her helm, followed online: Nomoto's K and T and the neutral rudder, from yaw rate, rudder angle and speed.

    T dr/dt + r = K (delta - delta_0),    K = K' U / L,  T = T' L / U

(K. Nomoto et al., 1957, first order; recalled). K' and T' hold at any speed U of a hull of length L. The joint unscented filter (see
`unscented`) has r, ln K', ln T' and delta_0 as its state, so that K' and T' stay positive: a ship that is unstable on a straight
course has no such constants, and T' then grows without end. Parameters wander, so that another loading is found in some minutes.

On a steady course, and in a steady turn, nothing tells of them: they are left as they are until the rudder moves again.

They are the constants of the turns that a log holds. A hull's drag grows faster than its turn, so hard rudder makes K' and T' small; those
of the linear derivatives hold for a ship that hardly turns, and first order is an approximation at that.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aspnn.estimation.models import Sigma
from aspnn.estimation.unscented import Belief, predict, update
from aspnn.records import States
from aspnn.schema import InputError

SIGMA = Sigma(alpha=1.0, beta=2.0, kappa=0.0)
YAW_RATE, GAIN, TIME, NEUTRAL = range(4)


@dataclass(frozen=True)
class SteeringModel:
    """Nomoto's first-order model for `unscented`: state r [rad/s], ln K', ln T', delta_0 [rad]; given (speed [m/s], rudder [rad])."""

    length: float

    def transition(self, X: np.ndarray, u: tuple[float, float], dt: float) -> np.ndarray:
        """Exact for a rudder and a speed that stay: r <- K (delta - delta_0) + (r - K (delta - delta_0)) e^(-dt / T)."""
        r, gain, time, neutral = X
        speed, rudder = u
        pace = speed / self.length
        settled = np.exp(gain) * pace * (rudder - neutral)
        return np.stack([settled + (r - settled) * np.exp(-dt * pace * np.exp(-time)), gain, time, neutral])

    def measure(self, X: np.ndarray) -> np.ndarray:
        """The yaw rate."""
        return X[:1]


@dataclass(frozen=True)
class SteeringSettings:
    """What is believed of a ship beforehand, how it may change, and when the rudder tells of it.

    `gain` and `time` are K' and T' with standard deviations of their logarithms (assumed: 0.45 to 9 with two of them), `neutral` [rad]
    the standard deviation of delta_0 about zero. `wander` [1/s] is the variance that the logarithms gain every second
    while the rudder moves (0.22 in ten minutes), `wander_neutral` [rad2/s] that of delta_0. `misfit` [rad2/s3] is the spectral density of
    the yaw acceleration that the model does not know, of a ship of 90 m at 6 m/s; others have it by (U / L)^5. An epoch
    every `period` ship lengths of way; the rudder tells where it has moved by `excitation` [rad] within `memory` lengths.
    """

    gain: tuple[float, float] = (2.0, 0.75)
    time: tuple[float, float] = (2.0, 0.75)
    neutral: float = math.radians(2.0)
    wander: float = 8e-5
    wander_neutral: float = math.radians(0.2) ** 2 / 600
    misfit: float = 1e-8
    period: float = 0.07
    excitation: float = math.radians(2.0)
    memory: float = 5.0


class Steering(NamedTuple):
    """Nomoto's constants at `time` (k,) [s]: `gain` K', `time_constant` T', `neutral` rudder [rad], each (k,), and their covariance.

    `covariance` (k, 3, 3) is of ln K', ln T' and delta_0; `square` (k,) is the squared innovation over its variance (one on average
    where the model holds), NaN where the rudder did not tell (`excited` false).
    """

    time: np.ndarray
    gain: np.ndarray
    time_constant: np.ndarray
    neutral: np.ndarray
    covariance: np.ndarray
    square: np.ndarray
    excited: np.ndarray

    @property
    def sd(self) -> np.ndarray:
        """Standard errors (k, 3) of K', T' and delta_0 [rad]."""
        spread = np.sqrt(np.einsum("kii->ki", self.covariance))
        return spread * np.stack([self.gain, self.time_constant, np.ones(len(self.time))], axis=-1)

    def at(self, length: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """K [1/s] and T [s] (k,) of a hull of `length` [m] at `speed` [m/s]."""
        return self.gain * speed / length, self.time_constant * length / speed


def track_steering(states: States, settings: SteeringSettings | None = None) -> Steering:
    """Nomoto's constants through a voyage; each row knows the states up to its time alone.

    The rudder between two epochs is its mean, and the speed that over ground. An epoch that coasts, lacks a value or makes less than a
    tenth of the service speed tells nothing. Raises InputError without rudder angles, or for states too short for two epochs.
    """
    given, vessel = settings or SteeringSettings(), states.vessel
    model = SteeringModel(vessel.length)
    every = given.period * vessel.length / vessel.service_speed
    rows = _rows(states["time_s"], every)
    angle = states["rudder_angle_rad"]
    if not np.isfinite(angle).any():
        raise InputError(f"{states.path or 'states'}: no rudder angle is known, so steering cannot be tracked")
    if len(rows) < 2:
        raise InputError(f"{states.path or 'states'}: shorter than {2 * every:.1f} s, so steering cannot be tracked")
    time, r, sd = (states[name][rows] for name in ("time_s", "yaw_rate_rad_s", "yaw_rate_rad_s_sd"))
    speed, rudder = np.hypot(states["surge_m_s"], states["sway_m_s"])[rows], _means(angle, rows)
    known = np.isfinite(r + sd + speed + rudder) & (states["coasting"][rows] == 0)
    usable = known & (speed > 0.1 * vessel.service_speed)
    moved = _moved(time, angle[rows], given.memory * vessel.length / vessel.service_speed)
    excited = usable & np.append(False, usable[:-1]) & (moved >= given.excitation)
    scale = (vessel.service_speed / vessel.length / (6 / 90)) ** 5
    wander = np.array([given.misfit * scale, given.wander, given.wander, given.wander_neutral])
    x = np.array([0.0, math.log(given.gain[0]), math.log(given.time[0]), 0.0])
    P = np.diag([0.0, given.gain[1] ** 2, given.time[1] ** 2, given.neutral**2])
    belief = _seen(Belief(x, P), r[0], sd[0]) if known[0] else Belief(x, P + np.diag([1e-6, 0, 0, 0]))
    means, spreads, squares = [belief.x], [belief.P], [np.nan]
    for k in range(1, len(rows)):
        square, dt = np.nan, float(time[k] - time[k - 1])
        if excited[k]:
            ahead = predict(
                model, belief, (float(speed[k - 1 : k + 1].mean()), float(rudder[k])), dt, np.diag(wander * dt), SIGMA
            )
            found = update(model, ahead, r[k : k + 1], np.array([[sd[k] ** 2]]), SIGMA)
            belief, square = found.belief, float(found.innovation[0] ** 2 / found.S[0, 0])
        elif known[k]:
            belief = _seen(belief, r[k], sd[k])
        means.append(belief.x)
        spreads.append(belief.P)
        squares.append(square)
    found_mean, found_spread = np.array(means), np.array(spreads)
    return Steering(
        time=time,
        gain=np.exp(found_mean[:, GAIN]),
        time_constant=np.exp(found_mean[:, TIME]),
        neutral=found_mean[:, NEUTRAL],
        covariance=found_spread[:, GAIN:, GAIN:],
        square=np.array(squares),
        excited=excited,
    )


def _seen(belief: Belief, r: float, sd: float) -> Belief:
    """The belief with its yaw rate as it is seen, the parameters untouched."""
    x, P = belief.x.copy(), belief.P.copy()
    x[YAW_RATE], P[YAW_RATE], P[:, YAW_RATE] = r, 0.0, 0.0
    P[YAW_RATE, YAW_RATE] = sd**2
    return Belief(x, P)


def _rows(time: np.ndarray, every: float) -> np.ndarray:
    """Epochs at least `every` [s] apart, on a grid that begins with the first."""
    grid = np.floor((time - time[0]) / every + 1e-6)
    return np.flatnonzero(np.append(True, np.diff(grid) > 0))


def _means(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The mean of `values` between each of `rows` and the one before it, by the trapezoidal rule on even epochs; the first its own."""
    total = np.append(0.0, np.cumsum((values[1:] + values[:-1]) / 2))
    return np.append(values[rows[:1]], np.diff(total[rows]) / np.diff(rows))


def _moved(time: np.ndarray, values: np.ndarray, memory: float) -> np.ndarray:
    """How far `values` (k,) ranged in the last `memory` [s]; 0 where none is known."""
    first = np.searchsorted(time, time - memory - 1e-9)
    spans = [values[a : k + 1][np.isfinite(values[a : k + 1])] for k, a in enumerate(first)]
    return np.array([float(np.ptp(span)) if len(span) else 0.0 for span in spans])
