"""Speed, course and course rate from positions alone: the five-state extended Kalman filter of 000 and 001, corrected.

`CourseTracker` streams, for control loops; `filter_course` makes states of a log without a heading. The model stands in
`course_model`, the compiled filter in `course_engine`, what becomes of a log in `course_states`.
"""

import numpy as np

from aspnn.angles import wrap
from aspnn.estimation import course_engine as engine
from aspnn.estimation.course_model import CourseModel
from aspnn.estimation.course_run import settings
from aspnn.estimation.course_states import filter_course
from aspnn.schema import InputError

__all__ = ["CourseModel", "CourseTracker", "filter_course"]


class CourseTracker:
    """The course filter of `ships` ships at once, step by step, in a control loop.

    `sd` [m] is the standard deviation of a fix along each axis. With `geodetic` positions are latitude and longitude [rad], and
    course counts from true north. Of fixes that come at a fifth or a tenth of the steps, a step without one is NaN.
    """

    def __init__(self, model: CourseModel, sd: float, ships: int = 1, rate: float = 0.02, geodetic: bool = False):
        if not (0 < sd < np.inf and 0 < rate < np.inf and ships >= 1):
            raise InputError(f"course filter: sd {sd:g} m, rate {rate:g} s and ships {ships} must be positive")
        self.rate = rate  # s between steps, where a step is not told its time
        self._model = settings(model)
        self._variance, self._geodetic = sd**2, geodetic
        self._x, self._P = np.full((ships, 5), np.nan), np.full((ships, 5, 5), np.nan)
        self._memory = np.zeros((ships, engine.MEMORY))
        self._work = np.zeros(engine.COEFFICIENTS), np.empty((5, 5)), np.empty(6)
        self.time = -np.inf
        self.ready = np.zeros(ships, bool)

    def step(self, time: float | None, north, east) -> None:
        """Go on to `time` [s] (None: one `rate` later) and take in the fixes (b) of that instant, NaN where there is none."""
        now = (self.time + self.rate if np.isfinite(self.time) else 0.0) if time is None else float(time)
        if not (np.isfinite(now) and now >= self.time):
            raise InputError(f"course filter: time {now:g} s does not follow {self.time:g} s; time must not run back")
        self.time = now
        first, second = (
            np.broadcast_to(np.asarray(z, float), len(self._x))
            if np.shape(z) != (len(self._x),)
            else np.asarray(z, float)
            for z in (north, east)
        )
        engine.step_ships(
            self._model,
            self._geodetic,
            self._variance,
            self._x,
            self._P,
            self._memory,
            *self._work,
            now,
            np.ascontiguousarray(first),
            np.ascontiguousarray(second),
        )
        self.ready |= self._memory[:, engine.FOLLOWS] > 0

    @property
    def north(self) -> np.ndarray:
        """Northing [m] (b), or latitude [rad]; NaN before the first fix, as all that follows."""
        return self._x[:, 0].copy()

    @property
    def east(self) -> np.ndarray:
        """Easting [m] (b), or longitude [rad]."""
        return self._x[:, 1].copy()

    @property
    def speed(self) -> np.ndarray:
        """Speed over ground [m/s] (b), never negative."""
        return self._x[:, 2].copy()

    @property
    def course(self) -> np.ndarray:
        """Course over ground [rad] (b), wrapped to [-pi, pi)."""
        return wrap(self._x[:, 3])

    @property
    def course_rate(self) -> np.ndarray:
        """Rate of the course [rad/s] (b)."""
        return self._x[:, 4].copy()

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations (b, 5) of north, east, speed, course and course rate, in their units."""
        return np.sqrt(np.diagonal(self._P, axis1=1, axis2=2))
