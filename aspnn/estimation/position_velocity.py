"""The 3D-PV filter of Paper VI: position and velocity in three dimensions, driven by the acceleration, beside CAA on the heading.

State: north, east, down [m] and their rates at the place of the IMU, where the forces are felt: then its lever arm needs no
derivative of the turning rate. Midship's follow by the rigid body: p - C l, v - C (w x l), whose derivative is the
f - w' x l - w x (w x l) of the accelerometers.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from aspnn.estimation import compiled
from aspnn.estimation.adaptive import adapted
from aspnn.estimation.attitude import turning_rates
from aspnn.estimation.compiled import Run
from aspnn.estimation.exact import heading_problem
from aspnn.estimation.measurements import carried
from aspnn.estimation.problem import OUTLIER, Problem
from aspnn.estimation.spatial_engine import Blocks, Driven, Fit, beginning, gates, run
from aspnn.estimation.spatial_inputs import DOWN, Inertial, recent
from aspnn.frames import attitude
from aspnn.vessel import Vessel

UNFELT = 0.05  # m2/s3, density of the acceleration in the ship's axes where none is measured (assumed)
FLOAT = 10.0  # m2 s: without heights the ship floats at level zero, within white noise of this density (assumed)
MEMORY = 1.0  # s over which the innovations of the yaw rate tell how lively the ship is
FACTORS = (0.03, 30.0)  # least and most by which that scales the yaw jerk's density
Process = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # time, yaw acceleration, derived Q -> Q (n, 6, 6)


def derived(time: np.ndarray, turn: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """The process noise as it follows from the sensors: `Q`."""
    return Q


@dataclass(frozen=True)
class Scaled:
    """Paper VI's adaptive Q: `alpha` times Q where the yaw acceleration is beyond `threshold` [rad/s2], either way (E33)."""

    alpha: float = 1.015
    threshold: float = 0.02

    def __call__(self, time: np.ndarray, turn: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """Q (n, 6, 6) of the steps that end at `time`, from the yaw acceleration (n) there."""
        return Q * np.where(np.abs(turn) > self.threshold, self.alpha, 1.0)[:, None, None]


@dataclass(frozen=True)
class PaperVI:
    """Paper VI's Q (Table 2), in place of the derived one: an unknown acceleration of variance `q` [m2/s4] that each step holds.

    q [dt^4/4, dt^3/2; dt^3/2, dt^2] per axis, times that of `scaled`.
    """

    q: tuple[float, float, float] = (0.25, 0.125, 0.0625)
    scaled: Scaled = Scaled()

    def __call__(self, time: np.ndarray, turn: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """Q (n, 6, 6) of the steps that end at `time`, from the yaw acceleration (n) there."""
        dt = np.diff(time, prepend=time[0])
        gain = np.stack([dt**2 / 2, dt], axis=-1)
        held = np.einsum("ti,tj,ab->tiajb", gain, gain, np.diag(self.q)).reshape(len(time), 6, 6)
        return self.scaled(time, turn, held)


def turning_problem(i: Inertial, vessel: Vessel) -> Problem:
    """CAA on the compass and the rate of the heading, which is not the gyro's z-rate of a ship that rolls and pitches (E11)."""
    noise, spatial = vessel.noise, vessel.spatial
    rate, variance = i.heading_rates(noise.yaw_rate, spatial.attitude)
    drift = as_noise(spatial.gyro_bias, noise.heading**2 * i.period, 1) / i.period
    return turning_on(i, vessel, rate, variance + drift)


def turning_on(i: Inertial, vessel: Vessel, rate: np.ndarray, variance: np.ndarray) -> Problem:
    """CAA on the compass and measured rates (n) of the heading with their variances (n)."""
    problem = heading_problem(replace(i.planar, yaw_rate=rate), vessel.noise, vessel.service_speed, vessel.length)
    R = problem.R.copy()
    R[:, 1, 0, 0] = np.where(np.isfinite(variance), variance, 1.0)
    return replace(problem, R=R)


def as_noise(bias: float, density: float, integrals: int) -> float:
    """Density of the white noise that a constant `bias` amounts to in a filter that does not estimate it.

    Its memory 1/w: a bias held over it is noise of density s = 2 bias^2 / w, and `integrals` times integrated noise s against
    measurements of `density` makes the steady filter forget at w = (s / density)^(1 / (2 integrals)). Together
    w = (2 bias^2 / density)^(1 / (2 integrals + 1)).
    """
    return 2 * bias**2 / (2 * bias**2 / density) ** (1 / (2 * integrals + 1))


def turning_run(problem: Problem) -> Run:
    """CAA with the process noise of each step times how large the yaw-rate innovations of the last MEMORY seconds were.

    A boat that runs straight and one that is put hard over differ by decades in yaw jerk. A first run with one density tells the mean
    square of the whitened innovations (of expectation one) up to the step before; within FACTORS it scales Q of the second.
    """
    first = compiled.run(problem)
    square, dt = first.whitened[:, 1, 0] ** 2, np.diff(problem.time)
    return compiled.run(adapted(problem, _lately(square, np.append(0.0, 1 - np.exp(-dt / MEMORY)))))  # type: ignore[arg-type]


@njit(cache=True, error_model="numpy")
def _lately(square, weight):
    """Mean of the known values of `square` (n) before each epoch, the older ones forgotten by `weight` (n), within FACTORS."""
    out, mean = np.empty(len(square)), 1.0
    for k in range(len(square)):
        out[k] = min(max(mean, FACTORS[0]), FACTORS[1])
        if np.isfinite(square[k]):
            mean += (square[k] - mean) * weight[k]
    return out


def tilts(i: Inertial) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roll and pitch (n) as last measured, level where nothing is known yet, and whether they are recent (n)."""
    known = np.isfinite(recent(i.time, i.roll)) & (np.isfinite(recent(i.time, i.pitch)) | ~np.isfinite(i.pitch).any())
    return carried(i.roll, 0.0), carried(i.pitch, 0.0), known


def accelerations(i: Inertial, C: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Acceleration of the IMU (n, 3), north-east-down [m/s2]: C f + (0, 0, g) (thesis 3.47, corrected: E12); NaN where not felt."""
    force = np.column_stack([recent(i.time, axis) for axis in i.force.T])
    force[~known] = np.nan
    return np.einsum("tij,tj->ti", C, force) + DOWN


def cross_covariance(arm: np.ndarray, level: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """Covariance (n, 3, 3) of rotation error x arm (n, 3), the error of variance `level` (n) about the horizontal, `upright` about z."""
    x, y, z = arm.T
    rows = [
        [level * z**2 + upright * y**2, -upright * x * y, -level * x * z],
        [-upright * x * y, level * z**2 + upright * x**2, -level * y * z],
        [-level * x * z, -level * y * z, level * (x**2 + y**2)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def steps(i: Inertial, vessel: Vessel, turning: Run, process: Process) -> tuple[np.ndarray, ...]:
    """F, u and Q of 3D-PV, and its accelerations (n, 3), NaN where none is felt.

    Felt: p + dt v + dt^2 (2 a0 + a1) / 6, v + dt (a0 + a1) / 2, with the acceleration straight between its samples; white noise
    of density S: that of the accelerometers and their bias, of gravity by wrong attitudes (f x error) and what is tuned. Samples of
    standard deviation sd every T seconds are noise of density sd^2 T. Not felt: velocity keeps its components along and
    athwart the ship, and so turns with the heading, but for UNFELT.
    """
    noise, spatial, n = vessel.noise, vessel.spatial, len(i.time)
    roll, pitch, known = tilts(i)
    psi = turning.mean[:, 0]
    C = attitude(roll, pitch, psi)
    a = accelerations(i, C, known)
    felt = np.isfinite(a[:, 0])
    felt &= np.concatenate([[True], felt[:-1]])
    late = np.nan_to_num(a)
    early = np.concatenate([late[:1], late[:-1]])
    dt = np.diff(i.time, prepend=i.time[0])
    u = np.concatenate([(dt**2)[:, None] * (2 * early + late) / 6, dt[:, None] * (early + late) / 2], axis=1)
    u[~felt] = 0.0
    swing = np.where(felt, 0.0, np.diff(psi, prepend=psi[:1]))
    turn = attitude(0.0, 0.0, swing)
    F = np.zeros((n, 6, 6))
    F[:, :3, :3], F[:, 3:, 3:] = np.eye(3), turn
    F[:, :3, 3:] = (np.eye(3) + turn) * (dt / 2)[:, None, None]
    S = cross_covariance(late - DOWN, np.full(n, spatial.attitude**2), turning.covariance[:, 0, 0]) * i.period
    drift = as_noise(spatial.accelerometer_bias, noise.position**2 * i.period, 2)
    S += (noise.acceleration**2 * i.period + spatial.acceleration_density + drift) * np.eye(3)
    if not i.heaves:
        S += UNFELT * np.einsum("ti,tj->tij", C[:, :, 2], C[:, :, 2])
    S[~felt] = UNFELT * np.eye(3)
    weights = np.stack([dt**3 / 3, dt**2 / 2, dt**2 / 2, dt], axis=-1).reshape(n, 2, 2)
    Q = np.einsum("tab,tij->taibj", weights, S).reshape(n, 6, 6)
    return F, u, np.where(felt[:, None, None], process(i.time, turning.mean[:, 2], Q), Q), a


def targets(i: Inertial) -> dict[str, np.ndarray]:
    """Arms (3,) [m] from the IMU to what is measured: the antennas, and, where no height is known, midship, which floats."""
    arms = {name: i.arms[name] - i.arms["imu"] for name in i.planar.fixes}
    return arms if any(np.isfinite(h).any() for h in i.down.values()) else arms | {"": -i.arms["imu"]}


def position_blocks(i: Inertial, vessel: Vessel, states: int) -> Blocks:
    """What `targets` measure as blocks of up to three rows on place and velocity, the first six of `states`, as if at the IMU.

    Fixes that are tau late tell p - tau v (+ tau^2/2 a, for the caller). The block that floats is never gated.
    """
    noise, spatial, n, late = vessel.noise, vessel.spatial, len(i.time), vessel.calibration.position_delay
    names = list(targets(i))
    z, R = np.full((n, len(names), 3), np.nan), np.empty((n, len(names), 3, 3))
    H = np.zeros((len(names), 3, states))
    H[:, :, :3], H[:, :, 3:6] = np.eye(3), -late * np.eye(3)
    for b, name in enumerate(names):
        if name:
            z[:, b] = np.column_stack([i.planar.fixes[name], i.down[name]])
            R[:, b] = np.diag([noise.position**2, noise.position**2, spatial.height**2])
        else:
            z[:, b, 2], R[:, b], H[b, :, 3:6] = 0.0, FLOAT / i.period * np.eye(3), 0.0
    place, rate = np.zeros((len(names), states)), np.zeros((len(names), states))
    place[:, :3], rate[:, 3:6] = 1.0, 1.0
    return Blocks(
        z=z,
        H=H,
        span=np.array([[0, 6 if late else 3]] * len(names)),
        R=R,
        angle=np.zeros(len(names), bool),
        gates=np.array([gates(OUTLIER) if name else (np.inf,) * 3 for name in names]),
        group=np.array([0 if name else 1 for name in names]),
        place=place,
        rate=rate,
    )


def placed(i: Inertial, vessel: Vessel, turning: Run, acceleration: np.ndarray, blocks: Blocks) -> Blocks:
    """The blocks with the arms taken away by roll and pitch as measured and the heading of CAA; what their errors do is added to R."""
    late = vessel.calibration.position_delay
    roll, pitch, _ = tilts(i)
    roll, pitch = (np.interp(i.time - late, i.time, angle) for angle in (roll, pitch))
    C = attitude(roll, pitch, turning.mean[:, 0] - late * turning.mean[:, 1] + late**2 / 2 * turning.mean[:, 2])
    z, R = blocks.z.copy(), blocks.R.copy()
    for b, (name, arm) in enumerate(targets(i).items()):
        there = C @ arm
        z[:, b] -= there + (late**2 / 2 * np.nan_to_num(acceleration) if name else 0.0)
        R[:, b] += cross_covariance(there, np.full(len(z), vessel.spatial.attitude**2), turning.covariance[:, 0, 0])
    return replace(blocks, z=z, R=R)


def first_spread(i: Inertial, vessel: Vessel) -> np.ndarray:
    """Variances (6,) of place and velocity before the first measurement."""
    floats = "" in targets(i)
    place = 1e4 * vessel.noise.position**2 + vessel.length**2
    deep = 1.0 if floats else 1e4 * vessel.spatial.height**2 + vessel.length**2
    return np.array([place, place, deep, *[(10 * vessel.service_speed) ** 2] * 2, vessel.service_speed**2])


@dataclass(frozen=True)
class Moving:
    """How the IMU moved (n epochs): `mean` (n, 6) place and velocity with `covariance` (n, 6, 6), its `acceleration` (n, 3), and how the
    measurement blocks fared (`fit`, whose mean and covariance are those of the filter's last epochs).
    """

    mean: np.ndarray
    covariance: np.ndarray
    acceleration: np.ndarray
    fit: Fit


def position_velocity(i: Inertial, vessel: Vessel, turning: Run, process: Process = derived) -> Moving:
    """3D-PV over a log, beside the run of CAA."""
    F, u, Q, a = steps(i, vessel, turning, process)
    blocks = placed(i, vessel, turning, a, position_blocks(i, vessel, 6))
    problem = Driven(i.time, F, u, Q, blocks)
    fit = run(problem, beginning(float(i.time[0]), np.zeros(6), np.diag(first_spread(i, vessel)), blocks.group))
    return Moving(fit.mean, fit.covariance, a, fit)


def turned_by(i: Inertial) -> np.ndarray:
    """Turning rates (n, 3) about the ship's axes: of the gyros, else from how roll and pitch change and the yaw rate."""
    if i.turned:
        return np.column_stack([carried(axis, 0.0) for axis in i.rates.T])
    roll, pitch, _ = tilts(i)
    step = np.diff(i.time, prepend=i.time[0] - i.period)
    change = [np.diff(angle, prepend=angle[:1]) / step for angle in (roll, pitch)]
    rate = i.heading_rates(0.0, 0.0)[0]
    return turning_rates(roll, pitch, np.column_stack([*change, carried(rate, 0.0)]))


def compass_run(i: Inertial, vessel: Vessel) -> Run:
    """CAA over a log."""
    return turning_run(turning_problem(i, vessel))
