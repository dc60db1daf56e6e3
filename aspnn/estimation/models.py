"""The motion models as objects: what the extended and the unscented filter need to know of each.

A model is its equations (by `kind`, in `kernels`) and the spectral densities of its process noise. The functions here take
any of them: `drift`, `jacobian`, `measure`, `measure_jacobian` on one state, `flow` from one instant to another.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aspnn.estimation import kernels
from aspnn.estimation.flow import flow_covariance, noise_of
from aspnn.instruments import Noise
from aspnn.schema import InputError

NOT_GIVEN = (0.0, 0.0, 0.0)


class MotionModel(Protocol):
    """What every model tells: its kind, the names of its d states, the densities of the white noise on each.

    `density` (d) in the unit of the state squared per second (E20). `least_speed` [m/s] tells CMM where a path begins.
    """

    @property
    def kind(self) -> int: ...
    @property
    def states(self) -> tuple[str, ...]: ...
    @property
    def density(self) -> tuple[float, ...]: ...
    @property
    def least_speed(self) -> float: ...


def _checked(model: MotionModel, sizes: tuple[int, ...]) -> None:
    q, name = np.asarray(model.density, float), type(model).__name__
    if len(q) not in sizes:
        raise InputError(f"{name}: density holds {len(q)} numbers; it has {' or '.join(map(str, sizes))} states")
    if not (np.isfinite(q).all() and (q >= 0).all() and q.any()):
        raise InputError(f"{name}: densities must be finite and not negative, one at least positive")


@dataclass(frozen=True)
class Caa:
    """Constant angular acceleration: heading, yaw rate, yaw acceleration (thesis 3.31-3.32). Linear."""

    density: tuple[float, ...]
    least_speed = 0.0  # no path of its own
    kind = kernels.CAA
    states = ("heading", "yaw rate", "yaw acceleration")

    def __post_init__(self) -> None:
        _checked(self, (3,))

    @classmethod
    def of(cls, noise: Noise) -> "Caa":
        """The model with noise on the highest derivative alone."""
        return cls((0.0, 0.0, noise.yaw_jerk_density))


@dataclass(frozen=True)
class Ctra:
    """Constant turn rate and acceleration at the reference point, in axes of the hull (thesis 3.29-3.30, E4).

    Eight states, or six where heading and yaw rate are given (linear then).
    """

    density: tuple[float, ...]
    least_speed = 0.0  # no path of its own

    def __post_init__(self) -> None:
        _checked(self, (6, 8))

    @property
    def kind(self) -> int:
        """CTRA6 or CTRA8, by the number of densities."""
        return kernels.CTRA6 if len(self.density) == 6 else kernels.CTRA8

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        turn = ("heading", "yaw rate") if len(self.density) == 8 else ()
        return ("north", "east", "surge", "sway", *turn, "surge acceleration", "sway acceleration")

    @classmethod
    def of(cls, noise: Noise, given: bool = False) -> "Ctra":
        """The model with noise on the highest derivatives alone; `given`: of six states, fed by CAA."""
        turn = () if given else (0.0, noise.turn_density)
        return cls((0.0, 0.0, 0.0, 0.0, *turn, noise.jerk_density, noise.jerk_density))


@dataclass(frozen=True)
class Cmm:
    """Curvilinear motion: velocity over ground, accelerations along and across the path (thesis 3.27-3.28).

    Eight states, or six where heading and yaw rate are given. Below `least_speed` [m/s] the path has no direction of its own
    and the accelerations turn into those along and across the hull; (least_speed / V)^2 tells how much at speed V (E16).
    """

    density: tuple[float, ...]
    least_speed: float = 0.1

    def __post_init__(self) -> None:
        _checked(self, (6, 8))
        if not 0 < self.least_speed < math.inf:
            raise InputError(f"Cmm: least_speed = {self.least_speed:g} m/s must be positive")

    @property
    def kind(self) -> int:
        """CMM6 or CMM8, by the number of densities."""
        return kernels.CMM6 if len(self.density) == 6 else kernels.CMM8

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        turn = ("heading", "yaw rate") if len(self.density) == 8 else ()
        motion = ("north", "east", "north velocity", "east velocity")
        return (*motion, *turn, "tangential acceleration", "normal acceleration")

    @classmethod
    def of(cls, noise: Noise, given: bool = False) -> "Cmm":
        """The model with noise on the highest derivatives alone; `given`: of six states, fed by CAA."""
        return cls(Ctra.of(noise, given).density)


@dataclass(frozen=True)
class Scheme:
    """How a filter goes from one epoch to the next: an explicit Runge-Kutta method of `order` 2 or 4 in steps of at most `step` [s].

    One step of order 4 is the default: for 0.1 s it agrees with twenty of order 2 to 3e-8 m. For epochs far apart, 0.5 s.
    """

    order: int = 4
    step: float = 0.5

    def __post_init__(self) -> None:
        if self.order not in (2, 4) or not self.step > 0:
            raise InputError(f"Scheme: order {self.order} must be 2 or 4, step {self.step:g} s positive")


ONE_STEP = Scheme()
THESIS_SCHEME = Scheme(2, 0.005)  # the papers': Delta t 0.1 s, delta t 0.005 s


@dataclass(frozen=True)
class Sigma:
    """Parameters of the scaled unscented transform; lambda = alpha^2 (n + kappa) - n (E23).

    Paper III's are the default: lambda = 1.72 with eight states (as Papers II, IV, V say), 3.54 with six.
    """

    alpha: float = 0.3
    beta: float = 2.0
    kappa: float = 100.0

    def __post_init__(self) -> None:
        if not (0 < self.alpha <= 1 and self.kappa >= 0):
            raise InputError(f"Sigma: alpha {self.alpha:g} must be in (0, 1], kappa {self.kappa:g} not negative")

    def weights(self, n: int) -> tuple[float, np.ndarray, np.ndarray]:
        """n + lambda, and the weights (2 n + 1) of mean and covariance, the middle point first."""
        spread = self.alpha**2 * (n + self.kappa)
        mean = np.full(2 * n + 1, 0.5 / spread)
        mean[0] = 1 - n / spread
        covariance = mean.copy()
        covariance[0] += 1 - self.alpha**2 + self.beta
        return spread, mean, covariance


def _rest(x, given) -> float:
    return float(x[4]) if len(x) == 8 else given[0]


def parameters(x, given, rest: float | None = None) -> np.ndarray:
    """The array `p` of the kernels for a state (d); `rest`: the heading [rad] that stands for the path's direction at rest."""
    rest, heading = _rest(x, given) if rest is None else rest, _rest(x, given)
    return np.array([*given, math.cos(rest), math.sin(rest), math.cos(heading), math.sin(heading)])


def drift(model: MotionModel, x, given=NOT_GIVEN, rest: float | None = None) -> np.ndarray:
    """dx/dt (d) of a state (d); `given`: heading, yaw rate, yaw acceleration for models of six states.

    `rest`: the heading [rad] that CMM takes for the path's direction at rest; the state's own without it.
    """
    p, out = parameters(x, given, rest), np.zeros((len(x), 1))
    kernels.drift(model.kind, model.least_speed, np.asarray(x, float).reshape(-1, 1), p, out)
    return out[:, 0]


def jacobian(model: MotionModel, x, given=NOT_GIVEN) -> np.ndarray:
    """d drift / dx (d, d)."""
    out = np.zeros((len(x), len(x) + 1))
    kernels.tangent(model.kind, model.least_speed, parameters(x, given), np.column_stack([np.eye(len(x)), x]), out)
    return out[:, :-1]


def measure(model: MotionModel, x, sensor: int, station=(0.0, 0.0), given=NOT_GIVEN, rest=None) -> np.ndarray:
    """What `sensor` (kernels.POSITION, ...) at `station` [m] reads (2); the second is 0 for heading and yaw rate.

    `rest` as in `drift`.
    """
    out = np.empty((2, 1))
    p = parameters(x, given, rest)
    x = np.asarray(x, float).reshape(-1, 1)
    kernels.measure(model.kind, model.least_speed, x, p, sensor, float(station[0]), float(station[1]), out)
    return out[:, 0]


def measure_jacobian(model: MotionModel, x, sensor: int, station=(0.0, 0.0), given=NOT_GIVEN) -> np.ndarray:
    """d measure / dx (2, d)."""
    H, p = np.empty((2, len(x))), parameters(x, given)
    x = np.asarray(x, float).reshape(-1, 1)
    kernels.measure_jacobian(model.kind, model.least_speed, x, p, sensor, float(station[0]), float(station[1]), H)
    return H


def flow(
    model: MotionModel,
    x,
    dt: float,
    given=NOT_GIVEN,
    scheme: Scheme = ONE_STEP,
    rest: float | None = None,
    inflation: float = 1.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State (d) after `dt` [s], its sensitivity Phi (d, d) to `x`, and the covariance (d, d) of the noise on the way.

    `rest` as in `drift`; `inflation` multiplies the noise, which is `flow.noise_of`'s: what acts on the highest derivatives
    alone reaches all the others through the model (E34).
    """
    d, p = len(x), parameters(x, given, rest)
    x, P, Phi = np.array(x, float), np.zeros((d, d)), np.eye(d)
    flow_covariance(
        model.kind,
        model.least_speed,
        np.array(given, float),
        float(dt),
        scheme.order,
        scheme.step,
        inflation * np.array(model.density, float),
        p,
        x,
        P,
        Phi,
        np.empty((6, d, d + 1)),
        np.empty((4, d, d + 1 - kernels.still(model.kind))),
    )
    return x, Phi, P


def noise(model: MotionModel, x0, x1, dt: float, given=NOT_GIVEN, inflation: float = 1.0) -> np.ndarray:
    """Covariance (d, d) of the noise on the way from state x0 (d) to x1 (d) in `dt` [s]: `flow.noise_of`."""
    Q, density = np.empty((len(x0), len(x0))), inflation * np.array(model.density, float)
    told = np.array(given, float), 0.0, float(dt), density, parameters(x0, given)
    noise_of(
        model.kind,
        model.least_speed,
        *told,
        np.array(x0, float),
        np.array(x1, float),
        Q,
        *np.empty((2, len(x0), len(x0) + 1)),
    )
    return Q
