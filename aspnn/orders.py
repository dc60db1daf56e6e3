"""Orders: what was (or will be) asked of the rudder or the shaft, held until the next order, and the servo that follows."""

from dataclasses import dataclass

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
        if not known.all():
            time, value = time[known], value[known]
        if len(time) == 0:
            return Orders.held(np.nan)
        first = np.append(0, np.flatnonzero(value[1:] != value[:-1]) + 1)
        return Orders(time[first], value[first])

    def at(self, time) -> np.ndarray:
        """The order in force at `time` [s], any shape; an order counts from its own instant on."""
        row = self.times.searchsorted(np.asarray(time, float) + 1e-9, side="right") - 1
        return self.values[np.maximum(row, 0)]

    def between(self, start: float, end: float) -> "Orders":
        """The orders from `start` to `end` [s], with `start` as the new zero of time; the first is at 0."""
        inside = (self.times > start + 1e-9) & (self.times <= end + 1e-9)
        times = np.concatenate([[0.0], self.times[inside] - start])
        return Orders(times, np.concatenate([[self.at(start)], self.values[inside]]))

    def after(self, before: "Orders") -> "Orders":
        """These orders from their first time on, those of `before` until then."""
        earlier = before.times < self.times[0] - 1e-9
        return Orders(
            np.concatenate([before.times[earlier], self.times]), np.concatenate([before.values[earlier], self.values])
        )

    def servo(
        self, time, start: float, rate: float, lag: float = 0.0, delay: float = 0.0, dead_band: float = 0.0
    ) -> np.ndarray:
        """What a servo makes of the orders, from `start` at the first of `time` [s], exactly; `time` must rise.

        x' = clip((order - x) / lag, -rate, rate), each order heard `delay` [s] late: towards the order at the full `rate`
        [per s] until it is reached, with a `lag` [s] down to a difference of rate x lag, which then dies out exponentially.
        It comes to rest `dead_band` short of the order, and does not start for one that is no further.
        """
        time, heard = np.asarray(time, float), self.times + delay
        later = (heard > time[0] + 1e-9) & (heard < time[-1])
        order, value, begin, first = float(self.at(time[0] - delay)), float(start), time[0], 0
        found = np.empty(len(time))
        for end, row, after in zip(heard[later], time.searchsorted(heard[later]), self.values[later], strict=True):
            moved = _moved(value, order, np.append(time[first:row], end) - begin, rate, lag, dead_band)
            found[first:row] = moved[:-1]
            order, value, begin, first = float(after), float(moved[-1]), end, row
        found[first:] = _moved(value, order, time[first:] - begin, rate, lag, dead_band)
        return found

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


def _moved(start: float, order: float, time: np.ndarray, rate: float, lag: float, dead_band: float) -> np.ndarray:
    """Where a servo is `time` [s] after it stood at `start`, its order unchanged: a ramp, then an exponential."""
    way = abs(order - start)
    if way <= dead_band:
        return np.full(len(time), start)
    near = min(way, rate * lag) if lag > 0 else 0.0
    ramp = (way - near) / rate
    left = rate * np.maximum(ramp - time, 0.0) if ramp > 0 else np.zeros(len(time))
    if lag > 0:
        left = left + near * np.exp(-np.maximum(time - ramp, 0.0) / lag)
    moved = order - np.copysign(np.maximum(left, dead_band), order - start)
    return np.where(time > 0, moved, start)  # to the last bit, so that a log in blocks is the log in one piece


@dataclass(frozen=True)
class Plan:
    """What will be ordered after the start of a prediction, known beforehand: times [s] from now.

    `rudder` in rad, `shaft` in rev/s (None: held as it is).
    """

    rudder: Orders
    shaft: Orders | None = None
