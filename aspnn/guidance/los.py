"""Line-of-sight guidance: the course that leads back to a leg, and how fast it turns. Depends on route and schema.

A guidance law is a callable `(error, speed, angle, dt) -> desired angle` for a batch of ships, arrays (ships,) in SI and radians: `error`
from a `Follower`, `speed` over ground, `angle` the course (or the heading, for laws that steer a heading), `dt` since the last call.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aspnn.guidance.route import PathError
from aspnn.schema import InputError

Law = Callable[[PathError, np.ndarray, np.ndarray, float], np.ndarray]
Rate = Callable[[PathError, np.ndarray, np.ndarray], np.ndarray]


def los_course(path_angle, cross, lookahead) -> np.ndarray:
    """Course [rad] towards the point of the leg `lookahead` [m] ahead: pi_p - atan(y_e / lookahead), paper 000 (35). Not wrapped."""
    return path_angle - np.arctan(np.asarray(cross, float) / lookahead)


def los_rate(path_angle, cross, lookahead, speed, course) -> np.ndarray:
    """How fast that course turns [rad/s] on a leg: -U sin(chi - pi_p) / (lookahead (1 + (y_e / lookahead)^2)), paper 000 (39)."""
    sideways = speed * np.sin(np.asarray(course, float) - path_angle)
    return -sideways / (lookahead * (1 + (np.asarray(cross, float) / lookahead) ** 2))


def checked(lookahead: float) -> float:
    """A look-ahead distance [m] that can be used, else InputError."""
    if not lookahead > 0 or not math.isfinite(lookahead):
        raise InputError(f"guidance: a look-ahead of {lookahead:g} m leads nowhere; it must be above 0")
    return lookahead


@dataclass(frozen=True)
class LineOfSight:
    """The proportional line-of-sight law of paper 000 with its look-ahead distance [m].

    While the course is kept, y_e' = -U y_e / sqrt(lookahead^2 + y_e^2) (37): the cross-track error dies out with the time constant
    lookahead / U. A law for the course needs nothing more in a current; one for the heading keeps an offset.
    """

    lookahead: float

    def __post_init__(self):
        checked(self.lookahead)

    def __call__(self, error: PathError, speed, angle, dt: float) -> np.ndarray:
        """The desired course [rad] (ships,)."""
        return los_course(error.path_angle, error.cross, self.lookahead)

    def rate(self, error: PathError, speed, course) -> np.ndarray:
        """The rate [rad/s] (ships,) of the desired course."""
        return los_rate(error.path_angle, error.cross, self.lookahead, speed, course)
