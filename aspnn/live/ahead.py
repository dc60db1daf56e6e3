"""A target, another ship, and where she will be: the rate-of-turn arc, or what she says herself; and how unsure that grows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
import shapely

from aspnn.live.share import gaussian
from aspnn.motion import Path, pivot_point
from aspnn.motion.path import YAW_RATE_FLOOR, rigid_step
from aspnn.vessel import Vessel

ANY = math.pi / math.sqrt(3)  # rad: standard deviation of a heading that nobody knows
DRAWN = 0.15  # of the beam: how far a hull that is drawn may lie off


class Kind(StrEnum):
    """Who told of a target."""

    ais = "ais"
    shared = "shared"


@dataclass(frozen=True)
class Target:
    """Another ship at `time` [s, UNIX], in own ship's grid. Angles [rad] from grid north, `convergence` added from true north.

    `north`, `east` [m] of midship; `surge`, `sway` [m/s] over ground there, `yaw_rate` [rad/s]. What was not told and is not known
    is NaN in `heading_told`, `rate_told`; `derived`: speed or course are those of the course filter. `sized`: her dimensions are
    told (otherwise the hull is assumed). `position_sd` [m], `velocity_sd` [m/s], `heading_sd` [rad], `rate_sd` [rad/s] are of now,
    `speed_density` [m2/s3], `turn_density` [rad2/s3] how they grow. `path`: what she says herself, from `time` on (shared only).
    """

    id: str
    name: str
    kind: Kind
    time: float
    north: float
    east: float
    heading: float
    convergence: float
    surge: float
    sway: float
    yaw_rate: float
    heading_told: float
    rate_told: float
    derived: bool
    vessel: Vessel
    sized: bool
    interval: float
    position_sd: float
    velocity_sd: float
    heading_sd: float
    rate_sd: float
    speed_density: float
    turn_density: float
    path: Path | None = None

    @cached_property
    def outline(self) -> np.ndarray:
        """Her hull, closed, in body axes (n, 2) [m]."""
        return self.vessel.outline()

    @cached_property
    def drawn(self) -> np.ndarray:
        """The hull with no more corners than are seen: within DRAWN of her beam."""
        return shapely.get_coordinates(shapely.simplify(shapely.Polygon(self.outline), DRAWN * self.vessel.beam))

    @property
    def speed(self) -> float:
        """Speed over ground of midship [m/s]."""
        return math.hypot(self.surge, self.sway)

    @property
    def course(self) -> float:
        """Course over ground of midship [rad] from grid north; NaN at rest."""
        return self.heading + math.atan2(self.sway, self.surge) if self.speed > 0 else math.nan


def growth(targets: Sequence[Target], ahead: np.ndarray, way: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Covariance (n, steps, 3, 3) of north, east [m] and heading [rad] at `ahead` (n, steps) [s] after each target's report. Assumed.

    `way` [m] is the length of the arc and `azimuth` [rad] the direction of its chord. With t the time, D the way, p, s, h, w the standard
    deviations of position, velocity, heading and yaw rate, and q_U, q_w the densities with which speed and yaw rate wander:

        along:   p^2 + (s t)^2 + q_U t^3 / 3                 across: p^2 + (s t)^2 + (D t w / 2)^2 + D^2 q_w t^3 / 20
        heading: h^2 + (t w)^2 + q_w t^3 / 3                 with across: D t^2 w^2 / 2 + D q_w t^3 / 8

    All of first order about a straight way; of a turn, whose chord is shorter, it is too much rather than too little. An error of the
    yaw rate turns the chord by t / 2 of it; white noise on the yaw acceleration leaves t^3 / 3 in the heading, and
    t^5 / 20 U^2 across, of which U t = D. The densities are those of `CourseModel.of`: of ships that are given random orders, more
    than of one that keeps her course. No more than `ANY` is said of a heading.
    """
    # Of a report that is ahead of one's clock as much is known as of one of now.
    t, D = np.maximum(ahead, 0.0), np.maximum(way, 0.0)
    names = ("position_sd", "velocity_sd", "heading_sd", "rate_sd", "speed_density", "turn_density")
    p, s, h, w, q_U, q_w = (np.array([[getattr(target, name)] for target in targets]).reshape(-1, 1) for name in names)
    fixed = p**2 + (s * t) ** 2
    along = fixed + q_U * t**3 / 3
    across = fixed + (D * t * w / 2) ** 2 + D**2 * q_w * t**3 / 20
    heading = h**2 + (t * w) ** 2 + q_w * t**3 / 3
    both = D * (t**2 * w**2 / 2 + q_w * t**3 / 8)
    shrink = np.minimum(ANY / np.sqrt(heading), 1.0)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    C = np.empty((*t.shape, 3, 3))
    C[..., 0, 0], C[..., 1, 1] = along * cos**2 + across * sin**2, along * sin**2 + across * cos**2
    C[..., 0, 1] = C[..., 1, 0] = (along - across) * sin * cos
    C[..., 0, 2] = C[..., 2, 0] = -sin * both * shrink
    C[..., 1, 2] = C[..., 2, 1] = cos * both * shrink
    C[..., 2, 2] = heading * shrink**2
    return C


def predict(targets: Sequence[Target], now: float, time: np.ndarray) -> Path:
    """Paths (targets, steps) of `targets` at `time` [s] from `now` [s, UNIX], each with the spread of `growth`.

    A target that shares a prediction is where she says, until its end, and goes on from there; without regions of her own hers are
    those of an AIS target.
    """
    time = np.asarray(time, float)
    ahead = now - np.array([target.time for target in targets])[:, None] + time
    values, covariance = _arcs(targets, ahead)
    for k, target in enumerate(targets):
        if target.path is not None:
            values[:, k], covariance[k] = _as_shared(target, target.path, ahead[k])
    gamma = np.array([target.convergence for target in targets])
    pivot = pivot_point(values[4], values[5], YAW_RATE_FLOOR / 3)
    spread = gaussian(covariance)
    north, east, heading, surge, sway, yaw_rate = values
    return Path(time, north, east, heading, surge, sway, yaw_rate, pivot, gamma, spread)


def _arcs(targets: Sequence[Target], ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """North, east, heading, surge, sway, yaw rate (6, n, steps) of rate-of-turn arcs `ahead` (n, steps) [s] of reports, and covariances."""
    names = ("north", "east", "heading", "surge", "sway", "yaw_rate")
    start = np.array([[getattr(target, name) for target in targets] for name in names])[..., None]
    values = start + np.zeros_like(ahead)
    _, _, heading, u, v, r = start
    values[:3] += rigid_step(heading, u, v, r, ahead)
    azimuth = heading + r * ahead / 2 + np.arctan2(v, u)
    return values, growth(targets, ahead, np.hypot(u, v) * ahead, azimuth)


def _as_shared(target: Target, path: Path, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    end = float(path.time[-1])
    inside, beyond = np.clip(ahead, 0.0, end), np.maximum(ahead - end, 0.0)
    at = path.at(inside)
    values = np.stack([at.north, at.east, at.heading, at.surge, at.sway, at.yaw_rate])
    north, east, turn = rigid_step(values[2], values[3], values[4], values[5], beyond)
    values[:3] += [north, east, turn]
    if at.spread is None:
        chord = values[:2] - [[target.north], [target.east]]
        return values, growth([target], ahead[None], target.speed * ahead[None], np.arctan2(chord[1], chord[0])[None])[
            0
        ]
    # Beyond her horizon the growth of an arc of that length is added to what she says of its end.
    azimuth = values[2] - turn / 2 + np.arctan2(values[4], values[3])
    more = growth([target], beyond[None], (np.hypot(values[3], values[4]) * beyond)[None], azimuth[None])[0]
    none = growth([target], np.zeros((1, len(beyond))), np.zeros((1, len(beyond))), azimuth[None])[0]
    return values, at.spread.covariance + more - none
