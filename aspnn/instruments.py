"""What a vessel file says of the ship's instruments: their noise, their constant errors, and how the inertial unit is mounted."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from aspnn.frames import attitude
from aspnn.schema import InputError

NOISE_KEYS = {  # section: key of a file: field of Noise; `_deg` marks angles
    "sensors": {
        "position_m": "position",
        "heading_deg": "heading",
        "yaw_rate_deg_s": "yaw_rate",
        "acceleration_m_s2": "acceleration",
    },
    "process": {
        "jerk_density_m2_s5": "jerk_density",
        "yaw_jerk_density_rad2_s5": "yaw_jerk_density",
        "turn_density_rad2_s3": "turn_density",
    },
}


CALIBRATION_KEYS = {  # key of a file: field of Calibration, least, most
    "heading_offset_deg": ("heading_offset", -180.0, 180.0),
    "position_delay_s": ("position_delay", 0.0, 5.0),
    "heading_delay_s": ("heading_delay", 0.0, 15.0),
    "yaw_rate_delay_s": ("yaw_rate_delay", 0.0, 15.0),
    "acceleration_delay_s": ("acceleration_delay", 0.0, 5.0),
}


SPATIAL_KEYS = {  # key of a file: field of Spatial; `_deg` marks angles
    "height_m": "height",
    "attitude_deg": "attitude",
    "acceleration_density_m2_s3": "acceleration_density",
    "turning_density_rad2_s": "turning_density",
    "accelerometer_bias_m_s2": "accelerometer_bias",
    "gyro_bias_deg_s": "gyro_bias",
}


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the sensors and spectral densities of the process noise, in SI and radians.

    Densities are those of white noise on the highest derivative: jerk along each body axis [m2/s5], the derivative of the yaw
    acceleration [rad2/s5], and the yaw acceleration [rad2/s3] for the models of eight states, which hold the turn rate.
    """

    position: float = 1.0
    heading: float = math.radians(0.5)
    yaw_rate: float = math.radians(0.01)
    acceleration: float = 0.01
    jerk_density: float = 1.7e-6
    yaw_jerk_density: float = 2.9e-9
    turn_density: float = 1e-7


@dataclass(frozen=True)
class Calibration:
    """Constant errors of the sensors: what the compass reads too much [rad], and how late each record is [s].

    A record that a log holds at t with the delay tau tells the state at t - tau. Only differences between the clocks of
    the sensors can be seen, so delays are counted from the quickest sensor (or from what its maker states).
    """

    heading_offset: float = 0.0
    position_delay: float = 0.0
    heading_delay: float = 0.0
    yaw_rate_delay: float = 0.0
    acceleration_delay: float = 0.0


@dataclass(frozen=True)
class Spatial:
    """What the filters in three dimensions expect beside `Noise`, in SI and radians.

    Standard deviations of the height of an antenna, of the gyro's roll and pitch, and of the constant errors of accelerometers and
    rate gyros; `acceleration_density` [m2/s3] and `turning_density` [rad2/s] are those of what the sensors' noise does not explain
    in acceleration and turning (vibration, clocks, what happens between samples).
    """

    height: float = 1.5
    attitude: float = math.radians(0.1)
    acceleration_density: float = 1e-4
    turning_density: float = 1e-8
    accelerometer_bias: float = 0.05
    gyro_bias: float = math.radians(0.05)


READS = {"force": 1.0, "reaction": -1.0}  # what accelerometers read: f = a - g, or g - a


@dataclass(frozen=True)
class Mounting:
    """How an IMU sits in its ship, and with which sign its accelerometers read.

    `axes[i]` names the sensor's axis, with its sign, that lies along axis i of the ship (x forward, y starboard, z down) but for
    the `misalignment` (roll, pitch, yaw) [rad]. `sign` is 1 for accelerometers that read the specific force f = a - g, on a
    z axis that points up +9.81 at rest, and -1 for those that read its reaction g - a (as the unit of Paper VI does, E12).
    """

    axes: tuple[str, str, str] = ("x", "y", "z")
    misalignment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sign: float = 1.0

    def rotation(self) -> np.ndarray:
        """Rotation (3, 3) from the sensor's axes into the ship's: R_zyx(yaw, pitch, roll) A (thesis 3.44-3.45), for rates."""
        return attitude(*self.misalignment) @ _axes_matrix(self.axes)

    def matrix(self) -> np.ndarray:
        """Matrix (3, 3) from the accelerometers' readings to the specific force in ship axes: sign x rotation (thesis 3.46)."""
        return self.sign * self.rotation()


def _axes_matrix(axes: tuple[str, str, str]) -> np.ndarray:
    """Signed permutation (3, 3): row i picks the sensor's axis that `axes[i]` names."""
    rows = np.zeros((3, 3))
    for row, axis in zip(rows, axes, strict=True):
        row["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return rows


def _degrees(angle: float) -> float:
    """Degrees that `math.radians` turns back into exactly `angle` [rad], so that a vessel read again is the same vessel."""
    near = math.degrees(angle)
    choices = (near, math.nextafter(near, -math.inf), math.nextafter(near, math.inf))
    return next((degrees for degrees in choices if math.radians(degrees) == angle), near)


def noise_data(noise: Noise) -> dict[str, dict[str, float]]:
    """The sections `sensors` and `process` of a vessel file."""
    return {
        section: {key: _told(key, getattr(noise, name)) for key, name in keys.items()}
        for section, keys in NOISE_KEYS.items()
    }


def read_noise(data: dict[str, Any], default: Noise, where: str) -> Noise:
    """Noise from the sections `sensors` and `process` of plain data, the rest as in `default`. Raises InputError."""
    found = {}
    for section, keys in NOISE_KEYS.items():
        for key, value in data.get(section, {}).items():
            if key not in keys:
                raise InputError(f"{where}: {section}.{key} is not a known noise (known: {', '.join(keys)})")
            if not (isinstance(value, int | float) and 0 < value < math.inf):
                raise InputError(f"{where}: {section}.{key} = {value} must be a positive number")
            found[keys[key]] = math.radians(value) if "_deg" in key else value
    return replace(default, **found)


def _check_key(where: str, section: str, key: str, known: Iterable[str]) -> None:
    known = tuple(known)
    if key not in known:
        near = get_close_matches(key, known, 1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
        raise InputError(f"{where}: {section}.{key} is not known, {hint}")


def calibration_data(calibration: Calibration) -> dict[str, float]:
    """The section `calibration` of a vessel file."""
    return {key: _told(key, getattr(calibration, name)) for key, (name, _, _) in CALIBRATION_KEYS.items()}


def read_calibration(data: dict[str, Any], where: str) -> Calibration:
    """Calibration from the section `calibration` of plain data; what it does not name is zero. Raises InputError."""
    found = {}
    for key, value in data.get("calibration", {}).items():
        _check_key(where, "calibration", key, CALIBRATION_KEYS)
        name, low, high = CALIBRATION_KEYS[key]
        if not (isinstance(value, int | float) and low <= value <= high):
            raise InputError(f"{where}: calibration.{key} = {value} must be a number from {low:g} to {high:g}")
        found[name] = math.radians(value) if "_deg" in key else float(value)
    return Calibration(**found)


def read_spatial(data: dict[str, Any], where: str) -> Spatial:
    """Spatial from the section `spatial` of plain data; what it does not name is the default. Raises InputError."""
    found = {}
    for key, value in data.get("spatial", {}).items():
        _check_key(where, "spatial", key, SPATIAL_KEYS)
        if not (isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf):
            raise InputError(f"{where}: spatial.{key} = {value} must be a positive number")
        found[SPATIAL_KEYS[key]] = math.radians(value) if "_deg" in key else float(value)
    return Spatial(**found)


def mounting_data(mounting: Mounting) -> dict[str, Any]:
    """The section `imu` of a vessel file."""
    return {
        "axes": list(mounting.axes),
        "misalignment_deg": [_degrees(angle) for angle in mounting.misalignment],
        "reads": next(word for word, sign in READS.items() if sign == mounting.sign),
    }


def read_mounting(data: dict[str, Any], where: str) -> Mounting:
    """Mounting from the section `imu` of plain data; what it does not name is that of a unit along the ship's axes. Raises InputError."""
    section = data.get("imu", {})
    for key in section:
        _check_key(where, "imu", key, ("axes", "misalignment_deg", "reads"))
    axes = section.get("axes", ["x", "y", "z"])
    known = [sign + axis for sign in ("", "-") for axis in "xyz"]
    if not (isinstance(axes, list) and len(axes) == 3 and all(axis in known for axis in axes)):
        raise InputError(f'{where}: imu.axes = {axes} must be three of {", ".join(known)}, such as ["x", "-y", "-z"]')
    repeated = next((a for a in "xyz" if sum(axis[-1] == a for axis in axes) > 1), None)
    if repeated:
        raise InputError(
            f"{where}: imu.axes = {axes} name the sensor's axis {repeated} more than once; name x, y and z once each"
        )
    if np.linalg.det(_axes_matrix(tuple(axes))) < 0:
        raise InputError(
            f"{where}: imu.axes = {axes} are left-handed, as no unit is mounted; turn the sign of one of them"
        )
    angles = section.get("misalignment_deg", [0.0, 0.0, 0.0])
    if not (
        isinstance(angles, list)
        and len(angles) == 3
        and all(isinstance(a, int | float) and not isinstance(a, bool) and abs(a) < 45 for a in angles)
    ):
        raise InputError(
            f"{where}: imu.misalignment_deg = {angles} must be roll, pitch and yaw within 45 degrees; larger turns belong into imu.axes"
        )
    reads = section.get("reads", "force")
    if not (isinstance(reads, str) and reads in READS):
        raise InputError(f"{where}: imu.reads = {reads} must be force (a - g) or reaction (g - a)")
    roll, pitch, yaw = (math.radians(a) for a in angles)
    return Mounting((axes[0], axes[1], axes[2]), (roll, pitch, yaw), READS[reads])


def _told(key: str, value: float) -> float:
    return _degrees(value) if "_deg" in key else value


def scaled_noise(length: float) -> Noise:
    """Noise densities for a vessel nobody has tuned: those of the 90 m cargo ship, scaled by Froude similarity.

    Accelerations are alike at every scale and time goes with sqrt(length), so the jerk density [(m/s2)2/s] goes with
    length^-1/2, the yaw-jerk density [(rad/s2)2/s] with length^-5/2 and the turn density [(rad/s)2/s] with length^-3/2.
    """
    reference, ratio = Noise(), length / 90.0
    return replace(
        reference,
        jerk_density=reference.jerk_density * ratio**-0.5,
        yaw_jerk_density=reference.yaw_jerk_density * ratio**-2.5,
        turn_density=reference.turn_density * ratio**-1.5,
    )
