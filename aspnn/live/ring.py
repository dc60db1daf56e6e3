"""The last seconds of a table that grows row by row, in memory that does not."""

import numpy as np


class Ring:
    """Rows of the last `seconds`, of columns by `names`, the first of which is the time [s] and rises; `fastest` rows a second at most.

    It lies in memory twice as long as it is, so that the last rows are in one piece. A full one goes on in memory of its own: what
    was handed out of the old one stays as it is, without being copied.
    """

    def __init__(self, names: tuple[str, ...], seconds: float, fastest: float) -> None:
        self.names, self.seconds = names, seconds
        self._size = int(seconds * fastest) + 2
        self._values = np.empty((len(names), 2 * self._size))
        self._end = 0

    @property
    def nbytes(self) -> int:
        """The memory that it takes."""
        return self._values.nbytes

    def add(self, values: np.ndarray) -> None:
        """Add rows (columns, n)."""
        values = values[:, -self._size :]
        count = values.shape[1]
        if self._end + count > 2 * self._size:
            kept = self._values[:, max(self._end - (self._size - count), 0) : self._end]
            self._values = np.empty((len(self.names), 2 * self._size))
            self._values[:, : kept.shape[1]] = kept
            self._end = kept.shape[1]
        self._values[:, self._end : self._end + count] = values
        self._end += count

    def recent(self, seconds: float) -> np.ndarray:
        """The rows (columns, n) of the last `seconds`, not to be written."""
        time = self._values[0, : self._end]
        first = int(np.searchsorted(time, time[-1] - seconds - 1e-9)) if self._end else 0
        found = self._values[:, first : self._end]
        found.flags.writeable = False
        return found
