"""A boat that turns, speeds up, rolls and pitches by closed formulas, and logs of its sensors: oracles of the filters in space.

Accelerations and turning rates are central differences of the formulas, by scipy's Rotation: nothing of the package is in them.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from aspnn.instruments import Mounting, Spatial
from aspnn.records import Log
from aspnn.vessel import load_vessel

G = 9.80665
PERIOD = 0.13
H = 1e-3  # s, of the differences
IMU = (-0.6, 0.3, 0.8)  # forward, starboard, up
ANTENNA = (3.0, 0.4, 2.0)


@dataclass(frozen=True)
class Boat:
    """Place of midship, roll, pitch and heading as functions of time."""

    straight: bool = False
    steady: bool = False  # and at one speed
    roll: float = np.radians(14)
    pitch: float = np.radians(9)

    def place(self, t):
        surge = 0.0 * t if self.steady else 9.0 * np.sin(0.22 * t)
        side = 0.0 * t if self.straight else 35.0 * np.sin(0.16 * t)
        return np.stack([6.0 * t + surge, side, 0.25 * np.sin(2.1 * t)], axis=-1)

    def euler(self, t):
        """Roll, pitch, heading (n, 3)."""
        roll, pitch = self.roll * np.sin(1.9 * t + 0.4), self.pitch * np.sin(1.5 * t)
        way = 0.0 * t if self.straight else np.arctan2(5.6 * np.cos(0.16 * t), 6.0) + 0.1 * np.sin(0.3 * t)
        return np.stack([roll, pitch, 0.4 + way + 0.02 * np.sin(1.7 * t)], axis=-1)

    def attitude(self, t) -> Rotation:
        return Rotation.from_euler("ZYX", self.euler(t)[:, ::-1])

    def station(self, t, station):
        """Place (n, 3) of a station (forward, starboard, up) of the hull."""
        return self.place(t) + self.attitude(t).apply(np.array(station) * [1, 1, -1])

    def velocity(self, t):
        return (self.place(t + H) - self.place(t - H)) / (2 * H)

    def level(self, t):
        """Surge and sway (n, 2) in the horizontal frame."""
        v, psi = self.velocity(t), self.euler(t)[:, 2]
        return np.stack(
            [v[:, 0] * np.cos(psi) + v[:, 1] * np.sin(psi), v[:, 1] * np.cos(psi) - v[:, 0] * np.sin(psi)], 1
        )

    def heading_rate(self, t):
        return (self.euler(t + H)[:, 2] - self.euler(t - H)[:, 2]) / (2 * H)

    def rates(self, t):
        return (self.attitude(t - H).inv() * self.attitude(t + H)).as_rotvec() / (2 * H)

    def force(self, t):
        """Specific force (n, 3) at the IMU in ship axes."""
        places = [self.station(t + k * H, IMU) for k in (-1, 0, 1)]
        return self.attitude(t).inv().apply((places[0] - 2 * places[1] + places[2]) / H**2 - [0, 0, G])


@dataclass(frozen=True)
class Errors:
    """Standard deviations and constant errors of the sensors."""

    position: float = 0.15
    height: float = 0.2
    heading: float = 0.005
    attitude: float = np.radians(0.1)
    force: float = 0.01
    rate: float = np.radians(0.01)
    force_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rate_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


EXACT = Errors(*[0.0] * 6)
SQUARE = Mounting()


def boat_log(
    boat: Boat,
    seconds: float,
    errors: Errors,
    seed: int = 0,
    mounting: Mounting = SQUARE,
    told: Mounting | None = None,
) -> tuple[Log, np.ndarray]:
    """A log of the boat in a local grid, mounted as `mounting` while the vessel's file says `told`; and its times (n)."""
    t, rng = np.arange(0.0, seconds, PERIOD), np.random.default_rng(seed)
    n = len(t)

    def noisy(values, sd):
        return values + sd * rng.standard_normal(values.shape)

    place, euler = boat.station(t, ANTENNA), boat.euler(t)
    fix, height = noisy(place[:, :2], errors.position), noisy(30.0 - place[:, 2], errors.height)
    tilt, heading = noisy(euler[:, :2], errors.attitude), noisy(euler[:, 2], errors.heading)
    force = noisy(boat.force(t) + errors.force_bias, errors.force) @ np.linalg.inv(mounting.matrix()).T
    rates = noisy(boat.rates(t) + errors.rate_bias, errors.rate)
    raw = np.degrees(rates @ mounting.rotation())
    columns = {
        "time_s": t,
        "bow_north_m": fix[:, 0],
        "bow_east_m": fix[:, 1],
        "bow_height_m": height,
        "heading_deg": np.degrees(heading) % 360,
        "yaw_rate_deg_s": np.degrees(rates[:, 2]),
        "roll_deg": np.degrees(tilt[:, 0]),
        "pitch_deg": np.degrees(tilt[:, 1]),
        "rudder_order_deg": np.zeros(n),
    }
    columns |= {f"imu_force_{axis}_m_s2": force[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"imu_rate_{axis}_deg_s": raw[:, k] for k, axis in enumerate("xyz")}
    vessel = load_vessel("workboat8")
    least = {"position": 1e-3, "heading": 1e-4, "yaw_rate": 1e-5, "acceleration": 1e-3}
    actual = {
        "position": errors.position,
        "heading": errors.heading,
        "yaw_rate": errors.rate,
        "acceleration": errors.force,
    }
    noise = replace(
        vessel.noise, **{name: max(actual[name], low) for name, low in least.items()}, yaw_jerk_density=0.01
    )
    spatial = Spatial(max(errors.height, 1e-3), max(errors.attitude, 1e-4), 1e-6, 1e-9, 0.03, np.radians(0.05))
    vessel = replace(
        vessel,
        stations={**vessel.stations, "bow": ANTENNA[:2], "imu": IMU[:2]},
        heights={"bow": ANTENNA[2], "imu": IMU[2]},
        noise=noise,
        spatial=spatial,
        mounting=mounting if told is None else told,
    )
    return Log(pd.DataFrame(columns), vessel, voyage="boat"), t
