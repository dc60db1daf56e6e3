"""Orders: what was (or will be) asked of the rudder or the shaft, held until the next order, and the servo that follows."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Orders:
    """Piecewise constant orders: `values[k]` holds from `times[k]` [s] until `times[k + 1]`; the last is held.

    Before the first time the first value holds. Rudder orders in rad, shaft orders in rev/s.
    """

    times: np.ndarray
    values: np.ndarray

    @staticmethod
    def held(value: float) -> "Orders":
        """One order held for ever."""
        return Orders(np.zeros(1), np.array([float(value)]))

    @staticmethod
    def from_series(time, value) -> "Orders":
        """The orders that a sampled series holds: one entry wherever the value changes. NaN samples repeat the last."""
        time, value = np.asarray(time, float), np.asarray(value, float)
        known = np.isfinite(value)
        time, value = time[known], value[known]
        if len(time) == 0:
            return Orders.held(np.nan)
        first = np.concatenate([[True], np.diff(value) != 0])
        return Orders(time[first], value[first])

    def at(self, time) -> np.ndarray:
        """The order in force at `time` [s], any shape; an order counts from its own instant on."""
        row = np.searchsorted(self.times, np.asarray(time, float) + 1e-9, side="right") - 1
        return self.values[np.clip(row, 0, None)]

    def between(self, start: float, end: float) -> "Orders":
        """The orders from `start` to `end` [s], with `start` as the new zero of time; the first is at 0."""
        inside = (self.times > start + 1e-9) & (self.times <= end + 1e-9)
        times = np.concatenate([[0.0], self.times[inside] - start])
        return Orders(times, np.concatenate([[self.at(start)], self.values[inside]]))

    def servo(self, time, start: float, rate: float) -> np.ndarray:
        """What a servo of limited `rate` [per s] makes of the orders, from `start` at the first of `time` [s], exactly.

        It moves towards the order in force at the full rate until it is reached; `time` must rise.
        """
        time = np.asarray(time, float)
        later = self.times[self.times > time[0] + 1e-9]
        instants = np.concatenate([[time[0]], later, [np.inf]])
        knots_t, knots_v, value = [time[0]], [float(start)], float(start)
        for begin, end in pairwise(instants):
            order = float(self.at(begin))
            reached = begin + abs(order - value) / rate
            if reached < end:
                knots_t.append(reached)
                knots_v.append(order)
                value = order
            else:
                value += np.sign(order - value) * rate * (end - begin)
            if np.isfinite(end):
                knots_t.append(end)
                knots_v.append(value)
        return np.interp(time, knots_t, knots_v)

    def changes(self, at_least: float, apart: float) -> np.ndarray:
        """Times [s] of the changes of at least `at_least`, each at least `apart` [s] after the one before it.

        Smaller changes (course-keeping, quantisation) do not count and do not part two others. The first value is no
        change.
        """
        times = self.times[1:][np.abs(np.diff(self.values)) >= at_least - 1e-9]
        return times[np.diff(times, prepend=-np.inf) >= apart - 1e-9]

    def held_within(self, start: float, end: float, tolerance: float) -> bool:
        """Whether the order stays within `tolerance` of that at `start` until `end` [s]."""
        inside = (self.times > start + 1e-9) & (self.times < end - 1e-9)
        return bool(np.all(np.abs(self.values[inside] - self.at(start)) < tolerance - 1e-9))


@dataclass(frozen=True)
class Plan:
    """What will be ordered after the start of a prediction, known beforehand: times [s] from now.

    `rudder` in rad, `shaft` in rev/s (None: held as it is).
    """

    rudder: Orders
    shaft: Orders | None = None
