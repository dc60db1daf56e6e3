"""The kinematic predictors: what the present motion alone says of the next 90 seconds. No network, no plan.

`caa_ctra` and `caa_cmm` are the thesis's combinations (Paper V 3.1): their system models run on from the filtered state.
`constant` keeps surge, sway and yaw rate: the rate-of-turn arc that bridge displays draw.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aspnn.angles import wrap
from aspnn.motion import Path, integrate
from aspnn.orders import Plan
from aspnn.prediction.plan import Orderable
from aspnn.records import States
from aspnn.vessel import Vessel

Motion = Callable[[dict[str, np.ndarray], np.ndarray], np.ndarray]
COLUMNS = {
    "surge": "surge_m_s",
    "sway": "sway_m_s",
    "yaw_rate": "yaw_rate_rad_s",
    "surge_acceleration": "surge_acceleration_m_s2",
    "sway_acceleration": "sway_acceleration_m_s2",
    "yaw_acceleration": "yaw_acceleration_rad_s2",
}
SLOW = 0.05  # m/s: the curvilinear model has no course at rest; below, its turning fades out (erratum E16)


def caa_ctra(now: dict[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Body velocities (n, steps, 3) at `time` [s]: constant acceleration of surge, sway (Paper V 7) and yaw (Paper V 3)."""
    u, v, r = (now[k][:, None] for k in ("surge", "sway", "yaw_rate"))
    du, dv, dr = (now[k][:, None] for k in ("surge_acceleration", "sway_acceleration", "yaw_acceleration"))
    return np.stack([u + du * time, v + dv * time, r + dr * time], axis=-1)


def constant(now: dict[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Body velocities (n, steps, 3): surge, sway and yaw rate as they are."""
    velocity = np.stack([now["surge"], now["sway"], now["yaw_rate"]], axis=-1)
    return np.repeat(velocity[:, None], len(time), axis=1)


def caa_cmm(now: dict[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Body velocities (n, steps, 3): constant tangential and normal acceleration (Paper V 12), heading by CAA (Paper V 3).

    Tangential a_t = (u u' + v v') / V and normal a_n = r V + (u v' - v u') / V are those of the filtered state. Speed
    V + a_t t does not fall below zero; the course turns by a_n / V, with V / (V^2 + 0.05^2) for 1 / V near rest (E16).
    """
    u, v, r = now["surge"], now["sway"], now["yaw_rate"]
    du, dv, dr = now["surge_acceleration"], now["sway_acceleration"], now["yaw_acceleration"]
    speed = np.hypot(u, v)
    share = speed / (speed**2 + SLOW**2)
    tangential, normal = (u * du + v * dv) * share, r * speed + (u * dv - v * du) * share
    along = np.maximum(speed[:, None] + tangential[:, None] * time, 0.0)
    turning = normal[:, None] * along / (along**2 + SLOW**2)
    step = time[1] - time[0]
    # `time` are midpoints of steps: the course there is that at the steps before plus half a step's turn.
    course = np.cumsum(turning, axis=1) * step - turning * step / 2
    heading = r[:, None] * time + dr[:, None] * time**2 / 2
    drift = wrap(np.arctan2(v, u)[:, None] + course - heading)
    return np.stack([along * np.cos(drift), along * np.sin(drift), r[:, None] + dr[:, None] * time], axis=-1)


@dataclass(frozen=True)
class KinematicPredictor:
    """Predictor by a kinematic motion model run on from the last filtered state. It needs no history and no plan."""

    vessel: Vessel
    motion: Motion = caa_ctra
    horizon: float = 90.0
    period: float = 0.5  # s between points of the path
    inner: float = 0.1  # s, the step of the integration

    @property
    def name(self) -> str:
        """The name of the motion model."""
        return self.motion.__name__  # type: ignore[attr-defined]

    def predict(self, states: States, rudder_plan: Orderable = None, shaft_plan: Orderable = None) -> Path:
        """Path from the last of `states`. The plans are accepted and have no effect: kinematics know of no rudder."""
        return self.predict_many(states, np.array([len(states) - 1]), ())[0]

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """Paths (n, steps) from each of `rows`, with time from 0 to the horizon."""
        now = {name: states[column][rows] for name, column in COLUMNS.items()}
        steps = round(self.horizon / self.inner)
        middle = (np.arange(steps) + 0.5) * self.inner
        pose = np.stack([states[k][rows] for k in ("north_m", "east_m", "heading_rad")], axis=-1)
        path = integrate(pose, self.motion(now, middle), self.inner)
        return thin(path, round(self.period / self.inner), states["convergence_rad"][rows])


def thin(path: Path, every: int, convergence) -> Path:
    """Every so many points of a path, with the convergence [rad] of its start."""
    names = ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot")
    values = {name: getattr(path, name)[..., ::every] for name in names}
    return Path(time=path.time[::every], convergence=convergence, **values)


def baselines(vessel: Vessel, horizon: float = 90.0) -> list[KinematicPredictor]:
    """The three baselines that every evaluation shows."""
    return [KinematicPredictor(vessel, motion, horizon) for motion in (caa_ctra, caa_cmm, constant)]
