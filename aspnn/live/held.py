"""Rudder orders where nobody tells them: the measured angle held through a dead band, from what is known so far alone.

Recordings find orders by where movements begin and end (logs.derived), which looks ahead. Live, the order while the rudder moves is the
angle that it has reached; once it has rested for REST it is the middle of the rest, rounded as orders are. Steering gear and
sensor stray about a rest by less than a degree, which is no order.
"""

from collections import deque
from statistics import median

LEAST = 1.0  # deg: a smaller change is course-keeping of the gear or noise of the sensor (that of logs.derived)
GRADE = 0.5  # deg: orders are given in whole or half degrees
REST = 1.5  # s within LEAST of each other are a rest


class HeldOrder:
    """The order behind a measured rudder angle, angle by angle."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, float]] = deque(maxlen=100)
        self._order: float | None = None
        self._settled = False  # the order is that of this rest

    def take(self, time: float, angle: float) -> float:
        """The order [deg] in force at `time` [s], at which the rudder stands at `angle` [deg]; times rise."""
        self._recent.append((time, angle))
        while self._recent[0][0] < time - REST - 1e-6:
            self._recent.popleft()
        angles = [a for _, a in self._recent]
        if max(angles) - min(angles) >= 2 * LEAST:
            self._settled = False
        if self._order is None or abs(angle - self._order) >= LEAST:
            self._order, self._settled = angle, False
        if not self._settled and time - self._recent[0][0] >= 0.8 * REST and max(angles) - min(angles) < LEAST:
            self._order, self._settled = round(median(angles) / GRADE) * GRADE, True
        return self._order
