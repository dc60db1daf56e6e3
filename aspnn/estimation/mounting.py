"""How an IMU is mounted: what gravity tells at once, which axes fit gravity and motion (coarse), and the residual angles (fine).

Fine alignment (thesis 3.45): with R = (1 + [e]x) R0 for a small rotation e about the ship's axes, the acceleration that drives
3D-PV is C f0 + (0, 0, g) - C [f0]x e, so e joins the state as three constants and the fixes tell it by least squares, with its
standard errors. On a straight run at steady speed that is the mean force against the mean roll and pitch; yaw shows only when
speed changes, by the direction of the force against the way the fixes go. A bias b of an accelerometer looks like b / g
and is in the standard errors of roll and pitch.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from aspnn.estimation import spatial_engine as engine
from aspnn.estimation.attitude import skew, turning_rates
from aspnn.estimation.compiled import Run
from aspnn.estimation.measurements import carried, column
from aspnn.estimation.position_velocity import (
    compass_run,
    derived,
    first_spread,
    placed,
    position_blocks,
    position_velocity,
    steps,
    tilts,
)
from aspnn.estimation.spatial_engine import Driven, beginning
from aspnn.estimation.spatial_inputs import FORCES, GRAVITY, Inertial, from_ship_log
from aspnn.frames import attitude
from aspnn.instruments import Mounting, mounting_data
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Vessel

NEAR = 0.1  # how far a mean force may be from g, as a share, before its unit is in doubt
OFF = math.radians(30.0)  # how far gravity may lie from the vertical before the axes are in doubt
SURE = math.radians(1.0)  # standard error beyond which an angle counts as not observed
WIDE = math.radians(20.0)  # of the residual angles before anything is known
CLEAR = 10.0  # log-likelihood by which the best mounting must beat the next, to be named
ROUNDS = 4


@dataclass(frozen=True)
class Alignment:
    """The mounting found, its residual angles' standard errors (3,) [rad] in the order of Mounting, and which of roll, pitch and yaw
    could not be observed; `shaken` [m/s2] is the root mean square of the horizontal force, which yaw is told by.
    """

    mounting: Mounting
    errors: np.ndarray
    unseen: tuple[str, ...]
    shaken: float

    def section(self) -> dict:
        """The section `imu` of a vessel file."""
        return mounting_data(self.mounting)

    def lines(self) -> Iterator[str]:
        """What was found, in words: axes, angles with standard errors, and what could not be observed with the remedy."""
        reads = "force" if self.mounting.sign > 0 else "reaction"
        yield f"axes {', '.join(self.mounting.axes)}; reads the {reads}"
        for name, angle, error in zip(("roll", "pitch", "yaw"), self.mounting.misalignment, self.errors, strict=True):
            if name not in self.unseen:
                yield f"{name} {math.degrees(angle):+.3f} +- {math.degrees(error):.3f} deg"
                continue
            remedy = "record a run that speeds up and slows down" if name == "yaw" else "record a longer run with fixes"
            yield (
                f"{name} cannot be observed (standard error {math.degrees(error):.2g} deg, horizontal force {self.shaken:.2g} m/s2): "
                f"left at {math.degrees(angle):+.3f} deg; {remedy}"
            )


def check_units(log: Log) -> None:
    """Hold the forces of a log to the size of gravity. Raises InputError for forces in g, without gravity, or else out of scale."""
    where, forces = log.path or "log", np.column_stack([column(log, name) for name in FORCES])
    size = float(np.nanmedian(np.linalg.norm(forces, axis=1)))
    if abs(size - 1) < NEAR:
        raise InputError(f"{where}: imu_force_x_m_s2, y and z are {size:.2f} long, so in g; multiply them by 9.80665")
    if size < 0.2 * GRAVITY:
        raise InputError(
            f"{where}: imu_force_x_m_s2, y and z are {size:.2g} m/s2 long, so without gravity; name them acceleration_surge_m_s2, "
            f"acceleration_sway_m_s2 and acceleration_heave_m_s2, in ship axes"
        )
    if abs(size / GRAVITY - 1) > NEAR:
        raise InputError(
            f"{where}: imu_force_x_m_s2, y and z are {size:.4g} m/s2 long, gravity is 9.8; check unit and scale"
        )


def check_gravity(i: Inertial, log: Log) -> None:
    """Hold the forces of a log to gravity. Raises InputError that names what is wrong with them in one line, with the remedy.

    Wrong units, gravity already taken away, and a mean force that does not point up in level axes: an IMU upside down, one whose
    axes are swapped, one that reads the reaction. Which of them it is gravity alone cannot tell; the motion of the ship may.
    """
    where, vessel = log.path or "log", log.vessel
    if not all(name in log.table for name in FORCES) or not i.felt:
        return
    check_units(log)
    mean = level_force(i)
    if upright(mean):
        return
    axis = int(np.argmax(np.abs(mean)))
    told = "down" if axis == 2 else f"along the ship's {'xyz'[axis]} axis"
    fault = f"{where}: the mean force points {told}, not up, with the mounting of vessel {vessel.name}"
    found = coarse(log)
    if found is None:
        what = "is upside down or reads the reaction" if axis == 2 else "has its axes swapped"
        raise InputError(
            f"{fault}: the IMU {what}; mend imu (axes, reads) in the vessel file, or let `aspnn mount` find it on a log with "
            f"turns and changes of speed"
        )
    section = mounting_data(found)
    raise InputError(
        f"{fault}: {difference(vessel.mounting, found)}; set imu in the vessel file to axes {json.dumps(section['axes'])}, "
        f'reads "{section["reads"]}"'
    )


def upright(mean: np.ndarray) -> bool:
    """Whether a mean force (3,) in level axes points up, within OFF, as that of a ship does."""
    return bool(mean[2] < -math.cos(OFF) * np.linalg.norm(mean))


def level_force(i: Inertial) -> np.ndarray:
    """Mean specific force (3,) in level axes (forward, starboard, down) by roll and pitch as measured: (0, 0, -g) of a ship."""
    roll, pitch, known = tilts(i)
    force = np.einsum("tij,tj->ti", attitude(roll, pitch, 0.0), i.force)
    return np.nanmean(np.where(known[:, None], force, np.nan), axis=0)


def difference(told: Mounting, found: Mounting) -> str:
    """In words how the mounting found differs from the one told."""
    if found.axes == told.axes:
        return f"the IMU reads the {mounting_data(found)['reads']}, not the {mounting_data(told)['reads']}"
    turn = Mounting(found.axes).rotation() @ Mounting(told.axes).rotation().T
    if np.isclose(turn[2, 2], -1.0):
        return "the IMU is upside down"
    return "the IMU's axes are swapped"


def mountings() -> Iterator[Mounting]:
    """All ways to mount an IMU square to the ship, by axes and by what it reads: 48."""
    for order, signs in product(permutations("xyz"), product(("", "-"), repeat=3)):
        axes = (signs[0] + order[0], signs[1] + order[1], signs[2] + order[2])
        if np.linalg.det(Mounting(axes).rotation()) > 0:
            yield from (Mounting(axes), Mounting(axes, sign=-1.0))


def coarse(log: Log) -> Mounting | None:
    """The square mounting that fits gravity, the fixes (by the likelihood of 3D-PV) and the turning rates best.

    None where another fits nearly as well: forces alone look the same upside down and read as reaction until speed changes.
    """
    blank = from_ship_log(replace(log, vessel=replace(log.vessel, mounting=Mounting())))
    vessel = log.vessel
    turning = compass_run(replace(blank, rates=np.full_like(blank.rates, np.nan)), vessel)
    spun = _turned(blank, vessel)
    scores = []
    for mounting in mountings():
        tried = replace(blank, force=blank.force @ mounting.matrix().T)
        if not upright(level_force(tried)):
            continue
        score = position_velocity(tried, vessel, turning).fit.log_likelihood
        if blank.turned:
            rates, variance = spun
            off = blank.rates @ mounting.rotation().T - rates
            score -= 0.5 * float(np.nansum(off**2 / variance))
        scores.append((score, mounting))
    scores.sort(key=lambda pair: -pair[0])
    if len(scores) > 1 and scores[0][0] - scores[1][0] < CLEAR:
        return None
    return scores[0][1] if scores else None


def _turned(i: Inertial, vessel: Vessel) -> tuple[np.ndarray, float]:
    """Turning rates (n, 3) about the ship's axes by how compass, roll and pitch change, and the variance of each."""
    roll, pitch, _ = tilts(i)
    step = np.diff(i.time, prepend=i.time[0] - i.period)
    heading = np.unwrap(carried(i.planar.heading, i.planar.first_heading))
    change = np.column_stack([np.diff(a, prepend=a[:1]) / step for a in (roll, pitch, heading)])
    sd = max(vessel.spatial.attitude, vessel.noise.heading)
    return turning_rates(roll, pitch, change), 2 * (sd / i.period) ** 2 + vessel.noise.yaw_rate**2


def align(log: Log) -> Alignment:
    """Axes and residual angles of the IMU of a log with forces, best of a straight run that speeds up and slows down.

    Raises InputError for a log without forces, attitude or fixes, in the wrong unit, or whose axes cannot be told.
    """
    where, vessel = log.path or "log", log.vessel
    i = from_ship_log(log)
    if not all(name in log.table for name in FORCES) or not i.felt:
        raise InputError(f"{where}: no imu_force_x_m_s2, imu_force_y_m_s2, imu_force_z_m_s2; only they tell a mounting")
    check_units(log)
    found = coarse(log)
    if found is None:
        check_gravity(i, log)
    elif (found.axes, found.sign) != (vessel.mounting.axes, vessel.mounting.sign):
        vessel = replace(vessel, mounting=found)
        i = from_ship_log(replace(log, vessel=vessel))
    mounting, turning = vessel.mounting, compass_run(i, vessel)
    total, covariance = Rotation.from_matrix(attitude(*mounting.misalignment)), np.eye(3)
    for _ in range(ROUNDS):
        small, covariance = _residual(i, vessel, turning)
        total = Rotation.from_rotvec(small) * total
        i = replace(i, force=i.force @ Rotation.from_rotvec(small).as_matrix().T)
    yaw, pitch, roll = total.as_euler("ZYX")
    leaning = vessel.spatial.accelerometer_bias / GRAVITY
    errors = np.sqrt(np.diag(covariance) + np.array([leaning**2, leaning**2, 0.0]))
    unseen = tuple(name for name, error in zip(("roll", "pitch", "yaw"), errors, strict=True) if error > SURE)
    kept = [
        old if name in unseen else new
        for name, old, new in zip(("roll", "pitch", "yaw"), mounting.misalignment, (roll, pitch, yaw), strict=True)
    ]
    shaken = float(np.sqrt(np.nanmean(np.sum(i.force[:, :2] ** 2, axis=1))))
    return Alignment(replace(mounting, misalignment=(kept[0], kept[1], kept[2])), errors, unseen, shaken)


def _residual(i: Inertial, vessel: Vessel, turning: Run) -> tuple[np.ndarray, np.ndarray]:
    """Residual rotation e (3,) about the ship's axes by which the forces are still off, and its covariance, from all fixes."""
    F6, u6, Q6, a = steps(i, vessel, turning, derived)
    n = len(i.time)
    roll, pitch, _ = tilts(i)
    C = attitude(roll, pitch, turning.mean[:, 0])
    slope = np.nan_to_num(-C @ skew(i.force))  # of the acceleration by e
    early = np.concatenate([slope[:1], slope[:-1]])
    dt = np.diff(i.time, prepend=i.time[0])[:, None, None]
    F, u, Q = np.zeros((n, 9, 9)), np.zeros((n, 9)), np.zeros((n, 9, 9))
    F[:, :6, :6], F[:, 6:, 6:] = F6, np.eye(3)
    F[:, :3, 6:], F[:, 3:6, 6:] = dt**2 * (2 * early + slope) / 6, dt * (early + slope) / 2
    u[:, :6], Q[:, :6, :6] = u6, Q6
    blocks = placed(i, vessel, turning, a, position_blocks(i, vessel, 9))
    P = np.diag(np.concatenate([first_spread(i, vessel), np.full(3, WIDE**2)]))
    fit = engine.run(Driven(i.time, F, u, Q, blocks), beginning(float(i.time[0]), np.zeros(9), P, blocks.group))
    return fit.mean[-1, 6:], fit.covariance[-1, 6:, 6:]
