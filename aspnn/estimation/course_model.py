"""The model of the five-state course filter: a point that moves at a speed, along a course that turns at a rate.

States (5): north, east [m] (or latitude, longitude [rad]), speed U over ground [m/s], course chi [rad], course rate omega [rad/s]:

    x' = U cos chi,  y' = U sin chi,  U' = -a1 U + w1,  chi' = omega,  omega' = -a2 omega + w2     (000 and 001 (11)-(15))

and in the geodetic form latitude' = U cos chi / R_M, longitude' = U sin chi / (R_N cos latitude) (001 (35), (36)), where course
counts from true north. This is the plain statement, which the reference engine runs; `course_engine` is the same, compiled.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np

from aspnn.angles import wrap
from aspnn.schema import InputError
from aspnn.vessel import Vessel

EQUATOR = 6378137.0  # m, the semi-major axis of WGS 84 (001 calls it the semi-minor one: E47)
FLATTENING = 1 / 298.257223563
SQUARED = FLATTENING * (2 - FLATTENING)  # the eccentricity, squared
STEP = 0.5  # s, the longest inner step; within it a ship hardly turns
_roots, _weights = np.polynomial.legendre.leggauss(3)
NODES, WEIGHTS = (1 + _roots) / 2, _weights / 2  # of three points on [0, 1], exact to the fifth degree

# Densities in the units of a ship that goes her length in L/V: V^3 / L for the speed, (V / L)^3 for the course rate. By maximum
# likelihood on simulated voyages of four vessels (training/reproduce/course.py prints what each alone would have).
SPEED_SHARE, TURN_SHARE, TURN_DECAY = 7e-4, 4e-3, 0.06


@dataclass(frozen=True)
class CourseModel:
    """Spectral densities of the white noise on the rates of speed [m2/s3] and course rate [rad2/s3], and Singer's constants [1/s].

    Both constants are positive: the course rate of a filter that knows nothing has the variance turn_density / (2 alpha_turn).
    """

    speed_density: float
    turn_density: float
    alpha_speed: float
    alpha_turn: float

    def __post_init__(self):
        for name, value in asdict(self).items():
            if not 0 < value < math.inf:
                raise InputError(f"course filter: {name} = {value} must be a positive number")

    @classmethod
    def discrete(cls, speed: float, turn: float, step: float, alpha_speed: float, alpha_turn: float) -> "CourseModel":
        """From Q_d = diag(speed, turn) per `step` h [s] of the papers: E_d Q_d E_d' = h^2 Q_d is noise of density h Q_d."""
        return cls(speed * step, turn * step, alpha_speed, alpha_turn)

    @classmethod
    def of(cls, vessel: Vessel) -> "CourseModel":
        """What to expect of a vessel of this length L and service speed V, with densities in the units of L and V.

        The speed decays so slowly that, by its density, it spreads as far as the service speed and no farther.
        """
        V, time = vessel.service_speed, vessel.length / vessel.service_speed
        speed, turn = SPEED_SHARE * V**2 / time, TURN_SHARE / time**3
        return cls(speed, turn, speed / (2 * V**2), TURN_DECAY / time)


def per_metre(latitude: float) -> tuple[float, float, float, float]:
    """Radians of latitude and of longitude per metre north and east on the ellipsoid, and their derivatives by latitude.

    R_N = a / sqrt(1 - e^2 sin^2), R_M = R_N (1 - e^2) / (1 - e^2 sin^2) (001 (33), (34), corrected: E47).
    """
    s, c = math.sin(latitude), math.cos(latitude)
    W = 1 - SQUARED * s * s
    north, east = W**1.5 / (EQUATOR * (1 - SQUARED)), math.sqrt(W) / (EQUATOR * c)
    return north, east, -3 * SQUARED * s * c / W * north, east * (s / c - SQUARED * s * c / W)


def decays(alpha: float, time: float) -> tuple[float, float, float]:
    """exp(-a t), its integral from 0 to t, and the integral of that: what a decaying rate leaves, as way and as way of a way."""
    s = time * NODES
    e = np.exp(-alpha * s)
    return math.exp(-alpha * time), float(time * WEIGHTS @ e), float(time * WEIGHTS @ ((time - s) * e))


def transition(model: CourseModel, x, dt: float, geodetic: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State (5) after `dt` [s], its Jacobian F (5, 5) and the noise Q (5, 5) that came in on the way.

    The mean runs on by the model itself, U(t) = U e^(-a1 t), chi(t) = chi + omega (1 - e^(-a2 t)) / a2, and the place by the
    integral of U e^(i chi), never by the Jacobian (E46). The noise enters as along the course in the middle of each inner step.
    """
    x, F, Q = np.array(x, float), np.eye(5), np.zeros((5, 5))
    steps = max(1, math.ceil(dt / STEP - 1e-9))
    for _ in range(steps):
        x, A, noise = _inner(model, x, dt / steps, geodetic)
        F, Q = A @ F, A @ Q @ A.T + noise
    if geodetic:
        x[1] = wrap(x[1])
    return x, F, Q


def _inner(model: CourseModel, x: np.ndarray, h: float, geodetic: bool):
    first, _, U, chi, omega = x
    at = h * NODES
    left, gone = np.array([(*decays(model.alpha_speed, t)[:1], decays(model.alpha_turn, t)[1]) for t in at]).T
    direction = h * WEIGHTS * left * np.exp(1j * (chi + omega * gone))
    ahead, turned = direction.sum(), (direction * gone).sum()
    way = U * ahead
    north, east, by_north, by_east = (1.0, 1.0, 0.0, 0.0)
    if geodetic:
        north = per_metre(first)[0]
        north, east, by_north, by_east = per_metre(first + north * way.real / 2)
    slow, _, _ = decays(model.alpha_speed, h)
    rest, turn, _ = decays(model.alpha_turn, h)
    later = np.array([first + north * way.real, x[1] + east * way.imag, slow * U, chi + turn * omega, rest * omega])
    A = np.eye(5)
    A[0, 0], A[1, 0] = (
        1 + by_north * way.real,
        by_east * way.imag,
    )  # the latter is A_21 of 001 (49), and how R_N changes
    for column, by in ((2, ahead), (3, 1j * way), (4, 1j * U * turned)):
        A[0, column], A[1, column] = north * by.real, east * by.imag
    A[2, 2], A[3, 4], A[4, 4] = slow, turn, rest
    along = np.exp(1j * (chi + omega * decays(model.alpha_turn, h / 2)[1]))
    Q = np.zeros((5, 5))
    for t, weight in zip(at, WEIGHTS, strict=True):
        e, g, _ = decays(model.alpha_speed, t)
        faster = np.array([north * (along * g).real, east * (along * g).imag, e, 0.0, 0.0])
        e, g, gg = decays(model.alpha_turn, t)
        aside = 1j * along * U * gg
        quicker = np.array([north * aside.real, east * aside.imag, 0.0, g, e])
        Q += (
            h
            * weight
            * (model.speed_density * np.outer(faster, faster) + model.turn_density * np.outer(quicker, quicker))
        )
    return later, A, Q
