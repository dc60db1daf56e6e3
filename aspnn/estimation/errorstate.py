"""The error-state filter: strapdown by forces and turning rates, corrected by fixes, compass, roll and pitch.

The nominal motion of the IMU (place, velocity, attitude as a quaternion, biases) is integrated from force and rates; the filter
estimates its error in 15 components: place and velocity (north, east, down), a rotation about the ship's axes, biases of
accelerometers and of rate gyros, and gives it back to the nominal motion after each measurement.
"""

from dataclasses import dataclass, replace

import numpy as np

from aspnn.estimation.attitude import quaternion
from aspnn.estimation.errorstate_engine import strapdown
from aspnn.estimation.position_velocity import UNFELT, Moving, first_spread, position_blocks, targets
from aspnn.estimation.problem import OUTLIER, Carry
from aspnn.estimation.spatial_engine import Blocks, Fit, beginning, gates, outputs
from aspnn.estimation.spatial_inputs import DOWN, GRAVITY, Inertial, recent
from aspnn.frames import attitude
from aspnn.vessel import Vessel

STATES = 15
HOUR = 3600.0  # s in which the walk of a bias grows as large as the bias
SPIN = 0.1  # rad2/s, density of the attitude where no turning rate is measured (assumed)


@dataclass(frozen=True)
class Strapdown:
    """What the loop takes: `force` and `rates` (n, 3) NaN where missing, `numbers` as of `errorstate_engine.advance`, and after the
    antennas' `blocks` those of the heading and of roll and pitch.
    """

    time: np.ndarray
    force: np.ndarray
    rates: np.ndarray
    numbers: np.ndarray
    blocks: Blocks
    late: float  # s, of the compass


@dataclass(frozen=True)
class Aligned:
    """What the error-state filter makes of a log: the IMU's motion, its attitude (n, 3) as roll, pitch, heading (continuous) with standard
    deviations (n, 3), and the `biases` (n, 6) of accelerometers [m/s2] and gyros [rad/s] in ship axes.
    """

    moving: Moving
    attitude: np.ndarray
    attitude_sd: np.ndarray
    biases: np.ndarray


def problem(i: Inertial, vessel: Vessel) -> Strapdown:
    """The error-state filter of a log: noise of forces and rates, antennas (or a floating midship), heading, roll and pitch.

    The arms of the antennas turn with the estimated attitude, whose errors are states: nothing is added to R. Fixes that are late
    are taken back by velocity, acceleration and turning rate, the compass by the rate of the heading.
    """
    noise, spatial, m, n = vessel.noise, vessel.spatial, i.planar, len(i.time)
    fixes = position_blocks(i, vessel, STATES)
    count = len(fixes.group)
    z, R = np.full((n, count + 2, 3), np.nan), np.empty((n, count + 2, 3, 3))
    z[:, :count], R[:, :count] = fixes.z, fixes.R
    z[:, count, 0] = m.heading - m.calibration.heading_offset
    z[:, count + 1, 0], z[:, count + 1, 1] = i.roll, i.pitch
    R[:, count], R[:, count + 1] = noise.heading**2 * np.eye(3), spatial.attitude**2 * np.eye(3)
    place, rate = np.zeros((count + 2, STATES)), np.zeros((count + 2, STATES))
    place[:count], rate[:count] = fixes.place, fixes.rate
    place[count:, 6:9], rate[count:, 12:] = 1.0, 1.0
    numbers = [
        noise.acceleration**2 * i.period + spatial.acceleration_density,
        noise.yaw_rate**2 * i.period + spatial.turning_density,
        spatial.accelerometer_bias**2 / HOUR,
        spatial.gyro_bias**2 / HOUR,
        UNFELT,
        SPIN,
        GRAVITY,
    ]
    blocks = replace(
        fixes,
        z=z,
        H=np.concatenate([fixes.H, np.zeros((2, 3, STATES))]),
        span=np.array([[0, 9]] * count + [[6, 9]] * 2),
        R=R,
        angle=np.zeros(count + 2, bool),
        gates=np.concatenate([fixes.gates, [gates(OUTLIER)] * 2]),
        group=np.concatenate([fixes.group, fixes.group.max() + np.array([1, 2])]),
        place=place,
        rate=rate,
    )
    force, rates = (np.column_stack([recent(i.time, axis) for axis in three.T]) for three in (i.force, i.rates))
    return Strapdown(i.time, force, rates, np.array(numbers), blocks, vessel.calibration.heading_delay)


def error_state(i: Inertial, vessel: Vessel) -> Aligned:
    """The error-state filter over a log that has forces, turning rates, roll and pitch."""
    p, n, spatial = problem(i, vessel), len(i.time), vessel.spatial
    b = p.blocks
    roll, pitch = (float(a[np.argmax(np.isfinite(a))]) for a in (i.roll, i.pitch))
    q, x = np.empty(4), np.zeros(12)
    quaternion(roll, pitch, i.planar.first_heading - i.planar.calibration.heading_offset, q)
    sure = np.repeat([0.1, spatial.accelerometer_bias**2, spatial.gyro_bias**2], 3)
    P = np.diag(np.concatenate([first_spread(i, vessel), sure]))
    carry = beginning(float(i.time[0]), x, P, b.group)
    gone = carry.last, carry.rejections, carry.given_in
    arms = np.array(list(targets(i).values()))
    means, covariances = np.empty((n, 12)), np.empty((n, 6, 6))
    euler, spread, before = np.empty((n, 3)), np.empty((n, 3)), np.full(10, np.nan)
    out = outputs(n, len(b.group))
    likelihood = strapdown(
        *(
            p.time,
            p.force,
            p.rates,
            p.numbers,
            b.z,
            b.H,
            b.span,
            b.R,
            arms,
            b.gates,
            b.group,
            b.place,
            b.rate,
        ),
        *(p.late, x, q, P, gone, (means, covariances, euler, spread, before), out),
    )
    euler[:, 2] = np.unwrap(euler[:, 2])
    C = attitude(*euler.T)
    acceleration = np.einsum("tij,tj->ti", C, p.force - means[:, 6:9]) + DOWN
    mean = means[:, :6]
    fit = Fit(mean, covariances, mean, *out, likelihood, Carry(float(i.time[-1]), x, P, *gone))
    return Aligned(Moving(mean, covariances, acceleration, fit), euler, spread, means[:, 6:])
