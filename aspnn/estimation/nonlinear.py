"""Estimation problems of the nonlinear models: CMM and CTRA with their own turn, or fed by CAA, as the papers run them."""

from dataclasses import replace

import numpy as np

from aspnn.estimation.exact import motion_problem
from aspnn.estimation.kernels import ACCELERATION, CMM6, CMM8, HEADING, POSITION, YAW_RATE
from aspnn.estimation.measurements import Measurements
from aspnn.estimation.models import ONE_STEP, MotionModel, Scheme, Sigma
from aspnn.estimation.problem import GLITCH, OUTLIER, ModelProblem, gate
from aspnn.instruments import Noise
from aspnn.schema import InputError


def from_antenna(m: Measurements, name: str) -> Measurements:
    """The measurements as one antenna's filter sees them: its fixes alone, all stations from where it stands (E5)."""
    x, y = m.stations[name]
    stations = {other: (place[0] - x, place[1] - y) for other, place in m.stations.items() if other in (name, "imu")}
    return replace(m, fixes={name: m.fixes[name]}, stations=stations)


def model_problem(
    m: Measurements,
    noise: Noise,
    model: MotionModel,
    speed: float,
    length: float,
    turning: tuple[np.ndarray, np.ndarray] | None = None,
    scheme: Scheme = ONE_STEP,
    sigma: Sigma | None = None,
) -> ModelProblem:
    """The problem of Ctra or Cmm on measurements: extended filter, or unscented with `sigma`.

    Models of eight states take compass and yaw rate themselves; those of six take `turning`, mean (n, 3) and covariance
    (n, 3, 3) of CAA, whose errors over the lever arms are added to R (E18). Blocks: each antenna (independent, so R of the
    midpoint of two is halved by itself: E8), heading, yaw rate, accelerations. The filter starts at rest on the first fix,
    on the first heading, with variances as wide as a ship of `length` [m] at `speed` [m/s] allows; `two_point_start` gives
    Paper II's. Raises InputError for a model of six states without `turning`, and for delays, which only the exact models know.
    """
    c = m.calibration
    if c.position_delay or c.heading_delay or c.yaw_rate_delay or c.acceleration_delay:
        raise InputError(
            "calibration: sensor delays are known to the default filters only, not to CMM or CTRA of EKF and UKF"
        )
    d, n = len(model.states), len(m.time)
    if d == 6 and turning is None:
        raise InputError(f"{type(model).__name__} of six states needs the heading and yaw rate of CAA")
    names = list(m.fixes)
    blocks = [(POSITION, m.fixes[name], m.stations[name], noise.position) for name in names]
    if d == 8:
        nothing = np.full(n, np.nan)
        blocks.insert(0, (HEADING, np.column_stack([m.heading - c.heading_offset, nothing]), (0.0, 0.0), noise.heading))
        blocks.insert(1, (YAW_RATE, np.column_stack([m.yaw_rate, nothing]), (0.0, 0.0), noise.yaw_rate))
    blocks.append((ACCELERATION, m.acceleration, m.stations["imu"], noise.acceleration))
    sensors = np.array([block[0] for block in blocks])
    if d == 6 and turning is not None:
        R = motion_problem(m, noise, *turning, speed, length).R
        given = turning[0]
    else:
        R = np.broadcast_to([np.eye(2) * block[3] ** 2 for block in blocks], (n, len(blocks), 2, 2)).copy()
        given = np.zeros((n, 3))
    a, angles = d - 2, sensors == HEADING
    place, rate = np.zeros((len(blocks), d)), np.zeros((len(blocks), d))
    for b, sensor in enumerate(sensors):
        if sensor == POSITION:
            place[b, :2], rate[b, 2:4] = 1.0, 1.0
        elif sensor == ACCELERATION:
            place[b, a:] = 1.0
        else:
            place[b, 4 if sensor == HEADING else 5] = 1.0
            rate[b, 5] = float(sensor == HEADING)
    x0, P0 = _wide_start(m, noise, d, speed, length)
    return ModelProblem(
        time=m.time,
        x0=x0,
        P0=P0,
        model=model,
        given=given,
        sensors=sensors,
        stations=np.array([block[2] for block in blocks], float),
        inflation=np.ones(n),
        z=np.stack([block[1] for block in blocks], axis=1),
        R=R,
        angle=angles,
        gates=np.array([gate(OUTLIER if s in (POSITION, HEADING) else GLITCH) for s in sensors]),
        group=np.array([0 if s == POSITION else s for s in sensors]),
        place=place,
        rate=rate,
        scheme=scheme,
        sigma=sigma,
    )


def _wide_start(m: Measurements, noise: Noise, d: int, speed: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """At rest on the first fix and heading, with the variances of any ship of this size."""
    first = next(p[k] for p in m.fixes.values() for k in [np.argmax(np.isfinite(p[:, 0]))] if np.isfinite(p[k]).all())
    pace = speed / length
    x0 = np.concatenate([first, np.zeros(d - 2)])
    variances = [noise.position**2 + length**2] * 2 + [speed**2] * 2 + [(speed * pace) ** 2] * 2
    if d == 8:
        x0[4] = m.heading[np.argmax(np.isfinite(m.heading))]
        variances[4:4] = [(3 * noise.heading) ** 2, pace**2]
    return x0, np.diag(variances)


def two_point_start(
    model: MotionModel,
    time: np.ndarray,
    position: np.ndarray,
    heading: float,
    yaw_rate: float,
    noise: Noise,
    position_variance: np.ndarray,
    acceleration: float,
) -> tuple[np.ndarray, np.ndarray]:
    """State (d) and covariance (d, d) at the second of two fixes (Paper II 13-22, corrected: E26, E27).

    `time` (2) [s], `position` (2, 2) north and east [m] of the reference point with `position_variance` (2) [m2] each, the
    measured `heading` [rad] and `yaw_rate`; the accelerations start at zero with the standard deviation `acceleration`
    [m/s2] of a manoeuvre: nothing has measured them (E27). Velocity is the difference of the fixes, so var(v) = 2 R / dt^2 and
    cov(p, v) = R / dt, on the axis of each (E26). For CTRA both are turned into the hull's axes, with the error of the
    heading: P_uv = C' (2 R / dt^2) C + sigma^2 [v, -u] [v, -u]', cov(uv, psi) = sigma^2 [v, -u]', C = [[c, -s], [s, c]].
    Raises InputError when the fixes have no time between them.
    """
    dt = float(time[1] - time[0])
    if not dt > 0:
        raise InputError(f"the start needs two fixes, the second later than the first; they are {dt:g} s apart")
    d = len(model.states)
    velocity, R = (position[1] - position[0]) / dt, np.diag(position_variance)
    x, P = np.zeros(d), np.zeros((d, d))
    x[:2], P[:2, :2] = position[1], R
    P[-2:, -2:] = acceleration**2 * np.eye(2)
    if d == 8:
        x[4:6] = heading, yaw_rate
        P[4, 4], P[5, 5] = noise.heading**2, noise.yaw_rate**2
    if model.kind in (CMM6, CMM8):
        x[2:4] = velocity
        P[2:4, 2:4], P[:2, 2:4], P[2:4, :2] = 2 * R / dt**2, R / dt, R / dt
        return x, P
    c, s = np.cos(heading), np.sin(heading)
    C = np.array([[c, -s], [s, c]])
    x[2:4] = C.T @ velocity
    turned = np.array([x[3], -x[2]])  # d(u, v) / d psi
    P[2:4, 2:4] = C.T @ (2 * R / dt**2) @ C + noise.heading**2 * np.outer(turned, turned)
    P[:2, 2:4] = R / dt @ C
    P[2:4, :2] = P[:2, 2:4].T
    if d == 8:
        P[2:4, 4] = P[4, 2:4] = noise.heading**2 * turned
    return x, P
