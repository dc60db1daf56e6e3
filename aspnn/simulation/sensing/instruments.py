"""Compass, rate gyro, inertial unit and rudder indicator: the errors that make them less than ideal, each off by default.

Deviations are those of constants drawn anew for every voyage; what the file states otherwise is the same for all.
"""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass
from scipy.spatial.transform import Rotation

from aspnn.frames import attitude, station_acceleration, to_north_east
from aspnn.instruments import Mounting
from aspnn.simulation.sensing.errors import bias, damped, gauss_markov, play
from aspnn.simulation.voyage import Voyage

NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
GRAVITY = 9.80665  # m/s2
EARTH_TURN = 7.292115e-5 * 6.371e6  # m/s, how fast the equator of the mean sphere turns east (903 kn)


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Gyrocompass:
    """The section `[sensors.gyrocompass]`: a compass that was not set right, is still settling, or is misled by the ship's speed.

    The deviation left at the start decays as settling_deg exp(-t / settling_time_s) cos(2 pi t / settling_period_s): a damped swing of
    Schuler's 84.4 minutes, 2 pi sqrt(R / g) (period 0: no swing). Time constant assumed, a compass settles in a few hours.
    """

    offset_deg: float = 0.0  # reads too much, always
    settling_deg: float = 0.0  # reads too much at the start
    settling_time_s: Positive = 2400.0
    settling_period_s: NotNegative = 5064.0
    speed_error: bool = False  # not corrected for speed and latitude; after a change it follows within settling_time_s


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class RateGyro:
    """The section `[sensors.rate_gyro]`: bias, which walks, and the damping of the indicator (first-order lag)."""

    bias_deg_s: NotNegative = 0.0  # deviation of the constant drawn per voyage
    bias_walk_1h_deg_s: NotNegative = 0.0  # deviation that its random walk gathers in an hour
    damping_s: NotNegative = 0.0


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Imu:
    """The section `[sensors.imu]`: what is recorded, how gravity is taken away, biases and misalignment.

    Gravity is taken away by roll and pitch known with a Gauss-Markov error (`tilt_deg`), or, where `tilt_known` is false, as though
    the ship stood upright: then g sin leaks in. Misalignment is a rotation drawn per voyage: it lets in gravity even then. `raw`
    records what the unit itself tells beside that: forces with gravity in them and rates, along the axes in which the vessel's
    section `imu` mounts it, every `acceleration_hz`, with the white noise of accelerometers and rate gyro.
    """

    heave: bool = False  # the acceleration downward is recorded too
    tilt_known: bool = True
    tilt_deg: NotNegative = 0.0  # stationary deviation of each of roll and pitch as used
    tilt_time_s: Positive = 60.0
    bias_m_s2: NotNegative = 0.0  # deviation per axis of the constant drawn per voyage
    bias_walk_1h_m_s2: NotNegative = 0.0  # deviation per axis that its random walk gathers in an hour
    misalignment_deg: NotNegative = 0.0  # deviation about each axis, on top of what the vessel's section `imu` states
    raw: bool = False
    gyro_bias_deg_s: NotNegative = 0.0  # of the raw rates: deviation per axis of the constant drawn per voyage
    gyro_bias_walk_1h_deg_s: NotNegative = 0.0


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class RudderIndicator:
    """The section `[sensors.rudder_indicator]`: play in its linkage, and a wrong zero."""

    play_deg: NotNegative = 0.0  # whole width: the pointer stands still until the rudder has moved so far the other way
    offset_deg: float = 0.0  # reads too much, to starboard


def compass_error(gyro: Gyrocompass, time, heading, surge, sway, latitude) -> np.ndarray:
    """What a gyrocompass reads too much [rad] at `time` [s]; `heading` true, `surge` and `sway` over ground, all over the steps.

    It settles along the horizontal part of the turning rate of the local level in inertial space, which has Omega cos(lat) +
    V_east / R to the north and -V_north / R to the east: west of north by atan(V_north / (R Omega cos(lat) + V_east)).
    """
    since = time - time[0]
    swing = np.cos(2 * np.pi * since / gyro.settling_period_s) if gyro.settling_period_s else 1.0
    error = np.radians(gyro.offset_deg + gyro.settling_deg * np.exp(-since / gyro.settling_time_s) * swing)
    if gyro.speed_error:
        north, east = to_north_east(surge, sway, heading)
        law = np.arctan2(north, EARTH_TURN * np.cos(latitude) + east)
        error = error + damped(law, float(time[1] - time[0]), gyro.settling_time_s)
    return error


def gyro_reads(gyro: RateGyro, yaw_rate: np.ndarray, dt: float, rng: np.random.Generator) -> np.ndarray:
    """What a rate gyro tells [rad/s] of the turning rate about its axis, without white noise."""
    drift = bias(rng, (1, len(yaw_rate)), dt, gyro.bias_deg_s, gyro.bias_walk_1h_deg_s)[0]
    return damped(yaw_rate, dt, gyro.damping_s) + np.radians(drift)


def tilted(voyage: Voyage) -> bool:
    """Whether a voyage has roll, pitch or heave at all."""
    return bool(voyage.roll.any() or voyage.pitch.any() or voyage.heave.any())


def lever_arm(voyage: Voyage, station: tuple[float, float], height: float):
    """Where a station `height` [m] above midship lies from midship [m]: along the heading, athwart it to starboard, and down."""
    if not tilted(voyage):
        return station[0], station[1], -height
    arm = attitude(voyage.roll, voyage.pitch, 0.0) @ np.array([*station, -height])
    return arm[:, 0], arm[:, 1], arm[:, 2]


def imu_acceleration(voyage: Voyage, station: tuple[float, float], height: float) -> np.ndarray:
    """Inertial acceleration (3, steps) [m/s2] at `station` in body axes: forward, to starboard, down (E1, E5).

    Of a ship that rolls and pitches, that of midship is (u' - v psi', v' + u psi', heave'') in level axes and turned into the
    body's; the arm s adds w' x s + w x (w x s), where w' is the central difference of the body's turning rates w.
    """
    u, v, r = voyage.surge, voyage.sway, voyage.yaw_rate
    level = np.stack([voyage.surge_rate - v * r, voyage.sway_rate + u * r, voyage.heave_acceleration])
    if not tilted(voyage):
        forward, starboard = station_acceleration(level[0], level[1], r, voyage.yaw_acceleration, station)
        return np.stack([forward, starboard, level[2]])
    turning = body_rates(voyage)
    body = np.einsum("tji,jt->it", attitude(voyage.roll, voyage.pitch, 0.0), level)
    arm = np.broadcast_to(np.array([[*station, -height]]).T, turning.shape)
    gained = np.gradient(turning, float(voyage.time[1] - voyage.time[0]), axis=1)
    inward = np.cross(turning, np.cross(turning, arm, axis=0), axis=0)
    return body + np.cross(gained, arm, axis=0) + inward


def body_rates(voyage: Voyage) -> np.ndarray:
    """Turning rates (p, q, r) (3, steps) [rad/s] about the body's axes, from those of the Euler angles: the inverse of E11."""
    c, s = np.cos(voyage.roll), np.sin(voyage.roll)
    level = voyage.yaw_rate * np.cos(voyage.pitch)
    return np.stack(
        [
            voyage.roll_rate - voyage.yaw_rate * np.sin(voyage.pitch),
            voyage.pitch_rate * c + level * s,
            level * c - voyage.pitch_rate * s,
        ]
    )


def gravity(roll, pitch) -> np.ndarray:
    """Gravity (3, ...) [m/s2] in the axes of a body so tilted: g (-sin pitch, cos pitch sin roll, cos pitch cos roll)."""
    roll, pitch = np.broadcast_arrays(roll, pitch)
    return GRAVITY * np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])


class Unit(NamedTuple):
    """What is wrong with an inertial unit through a voyage: `tilt` (2, steps) [rad] of the roll and pitch used, `axes` (3, 3) from its
    axes to where they should lie, `force_bias` (3, steps) [m/s2] in ship axes, `rate_bias` (3, steps) [rad/s] in its own."""

    tilt: np.ndarray
    axes: np.ndarray
    force_bias: np.ndarray
    rate_bias: np.ndarray


def unit_errors(imu: Imu, steps: int, dt: float, rng: np.random.Generator) -> Unit:
    """The errors of the unit on one voyage; each kind has a stream of its own."""
    tilt, offset, mounting, gyros = rng.spawn(4)
    wrong = np.radians(gauss_markov(tilt, (2, steps), dt, imu.tilt_deg, imu.tilt_time_s))
    axes = Rotation.from_rotvec(np.radians(imu.misalignment_deg) * mounting.standard_normal(3)).as_matrix()
    force_bias = bias(offset, (3, steps), dt, imu.bias_m_s2, imu.bias_walk_1h_m_s2)
    rate_bias = bias(gyros, (3, steps), dt, imu.gyro_bias_deg_s, imu.gyro_bias_walk_1h_deg_s)
    return Unit(wrong, axes, force_bias, np.radians(rate_bias))


def imu_reads(imu: Imu, unit: Unit, acceleration: np.ndarray, roll, pitch) -> np.ndarray:
    """What accelerometers tell (3, steps) [m/s2] after gravity is taken away, without white noise, of the true `acceleration`.

    Each feels the specific force a - g in its own axes (E12), to which gravity by the roll and pitch used is added again.
    """
    if imu.tilt_known and not any((imu.tilt_deg, imu.bias_m_s2, imu.bias_walk_1h_m_s2, imu.misalignment_deg)):
        return acceleration
    used = (roll + unit.tilt[0], pitch + unit.tilt[1]) if imu.tilt_known else np.zeros_like(unit.tilt)
    felt = unit.axes.T @ (acceleration - gravity(roll, pitch))
    return felt + gravity(*used) + unit.force_bias


def raw_reads(unit: Unit, mounting: Mounting, acceleration: np.ndarray, rates: np.ndarray, roll, pitch):
    """Forces (3, steps) [m/s2] and rates (3, steps) [rad/s] in the unit's own axes, without white noise, of the true inertial
    `acceleration` and turning `rates` in ship axes: the specific force a - g with its sign (E12), through the inverse of the mounting.
    """
    force = unit.axes.T @ (acceleration - gravity(roll, pitch)) + unit.force_bias
    return mounting.matrix().T @ force, mounting.rotation().T @ unit.axes.T @ rates + unit.rate_bias


def indicated(indicator: RudderIndicator, rudder: np.ndarray) -> np.ndarray:
    """The rudder angle [rad] that the indicator's pointer shows."""
    shown = play(rudder, np.radians(indicator.play_deg)) if indicator.play_deg else rudder
    return shown + np.radians(indicator.offset_deg)
