"""When everything that usually comes in a row has come, so that nobody waits for nothing: the rhythm of each column, learnt as it comes.

A column is done with a span of time once the next value that its rhythm lets expect lies beyond the end of it: the last value plus the
shortest of the last intervals. That holds for a sensor of 1 Hz between its values as for one of 20 Hz within a span.
"""

import math
from collections import deque

RECENT = 16  # intervals that make a rhythm
FEWEST = 4  # intervals without which there is none yet
SILENT = 2.0  # s that a value is overdue after which it is no longer waited for
UNEVEN, SLOW = 4.0, 1.0  # the longest interval over the shortest, and s, beyond which there is no rhythm to wait for
MARGIN = 1e-4  # s: instants that are told in milliseconds and lie on the end of a span may round to either side


class Rhythm:
    """The rhythms of columns. `hear` every value, in whatever order they come; `done` says whether a span can have no more."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}
        self._intervals: dict[str, deque[float]] = {}
        self._bounds: dict[
            str, tuple[float, float]
        ] = {}  # from when [s] until when a column's next value is waited for

    def hear(self, column: str, time: float) -> None:
        """A value of a column that is true at `time` [s]."""
        last = self._last.get(column)
        if last is None:
            self._intervals[column] = deque(maxlen=RECENT)
        elif time < last:
            return
        else:
            self._intervals[column].append(time - last)
        self._last[column] = time
        self._bounds[column] = self._due(time, self._intervals[column])

    def done(self, end: float) -> bool:
        """Whether nothing is expected any more that is true before `end` [s], of any column; False while no column has a rhythm."""
        end += MARGIN
        heard = False
        for since, until in self._bounds.values():
            if since < end <= until:
                return False
            heard |= end <= since < math.inf
        return heard

    @staticmethod
    def _due(last: float, intervals: deque[float]) -> tuple[float, float]:
        if len(intervals) < FEWEST:
            return last, last + SILENT
        shortest, longest = min(intervals), max(intervals)
        if longest > SLOW and longest > UNEVEN * shortest:
            return math.inf, math.inf
        return last + shortest, last + longest + SILENT
