"""What the filters in three dimensions take from a log: fixes with heights, attitude, specific force and turning rates in ship axes.

North-east-down with the height of the log turned round (E13); forces come by the vessel's mounting of the IMU (E12). What
gravity tells of a wrong mounting is in `mounting`.
"""

import math
from dataclasses import dataclass

import numpy as np

from aspnn.estimation import screening
from aspnn.estimation.attitude import heading_rate
from aspnn.estimation.measurements import Measurements, carried, column, from_log
from aspnn.frames import attitude
from aspnn.records import Log
from aspnn.schema import InputError

GRAVITY = 9.80665  # m/s2, standard; what a place differs by (at most 0.03) counts as bias of the accelerometer
HELD = 0.5  # s for which the last attitude, force or rate stands in for a missing one
FORCES = tuple(f"imu_force_{axis}_m_s2" for axis in "xyz")
RATES = tuple(f"imu_rate_{axis}_deg_s" for axis in "xyz")
FREE = tuple(f"acceleration_{axis}_m_s2" for axis in ("surge", "sway", "heave"))
DOWN = np.array([0.0, 0.0, GRAVITY])


@dataclass(frozen=True)
class Inertial:
    """Sensors of a log of n epochs in ship axes; NaN where one has no value.

    `planar` holds the screened fixes, heading and yaw rate with the origin of positions; `down` maps each antenna to its place (n)
    below `level` [m], the first known one; `roll`, `pitch` (n) [rad]; `force` (n, 3) the specific force a - g at the IMU [m/s2];
    `rates` (n, 3) p, q, r [rad/s]; `heaves` whether the vertical force is measured. `arms` (3,) [m] from midship: the antennas
    and `imu`. `stale` (n): some value repeats.
    """

    planar: Measurements
    level: float
    down: dict[str, np.ndarray]
    roll: np.ndarray
    pitch: np.ndarray
    force: np.ndarray
    rates: np.ndarray
    heaves: bool
    arms: dict[str, np.ndarray]
    stale: np.ndarray

    @property
    def time(self) -> np.ndarray:
        """Epochs (n) [s]."""
        return self.planar.time

    @property
    def felt(self) -> bool:
        """Whether the log tells any force."""
        return bool(np.isfinite(self.force[:, 0]).any())

    @property
    def turned(self) -> bool:
        """Whether the log tells turning rates about all three axes."""
        return bool(np.isfinite(self.rates[:, 0]).any())

    @property
    def period(self) -> float:
        """Median time between epochs [s]."""
        return float(np.median(np.diff(self.time)))

    def heading_rates(self, yaw_rate_sd: float, attitude_sd: float) -> tuple[np.ndarray, np.ndarray]:
        """psi' (n) [rad/s] at every yaw rate of the log and its variance (n), from r and roll and pitch as measured (E11).

        The pitch rate comes from the gyro athwart, else from the last two pitches. psi' = (r / cos phi + theta' tan phi) / cos theta: the
        variance holds those of r and of the pitch rate and what the error of the roll does to psi' (theta' / cos theta per rad).
        """
        roll, pitch = recent(self.time, self.roll), recent(self.time, self.pitch)
        roll, pitch = np.nan_to_num(roll), np.nan_to_num(pitch)
        if self.turned:
            q = recent(self.time, self.rates[:, 1])
            known = np.isfinite(q) & np.isfinite(self.rates[:, 2])
            r, q = np.where(known, self.rates[:, 2], self.planar.yaw_rate), np.where(known, q, 0.0)
            pitch_rate, loose = q * np.cos(roll) - np.nan_to_num(r) * np.sin(roll), yaw_rate_sd**2
        else:
            r, step = self.planar.yaw_rate, np.diff(self.time, prepend=self.time[0] - self.period)
            pitch_rate, loose = np.diff(pitch, prepend=pitch[:1]) / step, 2 * (attitude_sd / self.period) ** 2
        variance = (yaw_rate_sd / np.cos(roll)) ** 2 + loose * np.tan(roll) ** 2 + (pitch_rate * attitude_sd) ** 2
        return heading_rate(roll, pitch, r, pitch_rate), variance / np.cos(pitch) ** 2


def recent(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The last known value (n) no older than HELD, else NaN."""
    since = carried(np.where(np.isfinite(values), time, np.nan))
    return np.where(time - since <= HELD, carried(values), np.nan)


def from_ship_log(log: Log) -> Inertial:
    """The sensors of a log in ship axes. Raises InputError for a log that has forces but no attitude, or no attitude at all.

    Forces are those of FORCES; where the log has only accelerations without gravity, gravity is put back by roll and pitch as
    measured, which is what the unit has taken away.
    """
    where = log.path or "log"
    m, mounting = from_log(log), log.vessel.mounting
    stale = m.stale.copy()
    values: dict[str, np.ndarray] = {}
    for name in (*FORCES, *RATES, *FREE, "roll_deg", "pitch_deg"):
        values[name] = column(log, name)
        if np.isfinite(values[name]).any():
            repeated = _stuck(m.time, values[name])
            values[name] = np.where(repeated, np.nan, values[name])
            stale |= repeated
    known = {name: bool(np.isfinite(v).any()) for name, v in values.items()}
    raw, free = all(known[name] for name in FORCES), known[FREE[0]] and known[FREE[1]]
    for name in ("roll_deg", "pitch_deg"):
        if not known[name] and (raw or free or name == "roll_deg"):
            raise InputError(
                f"{where}: column {name} has no value; the filter in three dimensions needs the attitude, "
                f"leave out --spatial for the planar one"
            )
    late = log.vessel.calibration
    for name in ("acceleration_delay", "yaw_rate_delay"):
        if getattr(late, name) > 0:
            raise InputError(
                f"{where}: vessel {log.vessel.name}: calibration {name}_s must be 0 for the filter in three dimensions; "
                f"count the other delays from the IMU"
            )
    roll, pitch = np.radians(values["roll_deg"]), np.radians(values["pitch_deg"])
    force = np.full((len(m.time), 3), np.nan)
    if raw:
        force = np.column_stack([values[name] for name in FORCES]) @ mounting.matrix().T
    elif free:
        a = np.column_stack([values[name] for name in FREE])
        a[:, 2] = np.where(known[FREE[2]], a[:, 2], 0.0)
        tilt = attitude(recent(m.time, roll), recent(m.time, pitch), 0.0)
        force = a - np.einsum("tji,j->ti", tilt, DOWN)
    force[np.isnan(force).any(axis=1)] = np.nan
    rates = np.full((len(m.time), 3), np.nan)
    if all(known[name] for name in RATES):
        rates = np.radians(np.column_stack([values[name] for name in RATES])) @ mounting.rotation().T
        rates[np.isnan(rates).any(axis=1)] = np.nan
    heights = {
        name: np.where(np.isfinite(p[:, 0]), column(log, f"{name}_height_m"), np.nan) for name, p in m.fixes.items()
    }
    first = [float(h[np.argmax(np.isfinite(h))]) for h in heights.values() if np.isfinite(h).any()]
    level = -math.floor(first[0]) if first else 0.0
    vessel = log.vessel
    return Inertial(
        planar=m,
        level=level,
        down={name: -h - level for name, h in heights.items()},
        roll=roll,
        pitch=pitch,
        force=force,
        rates=rates,
        heaves=raw or known[FREE[2]],
        arms={name: np.array([*vessel.stations[name], -vessel.heights.get(name, 0.0)]) for name in m.stations},
        stale=stale,
    )


def _stuck(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Which values (n) of a sensor that changed until then only repeat their predecessor."""
    run = screening.runs(time, values[:, None])
    return screening.stuck(time - time[run[0]], run, screening.resolution(values)[0])
