"""The filters of `filter_log` row by row, with all that a bridge needs besides: a memory that does not grow, and a saved state.

The states are those of `filter_log` over the same rows, to the last bit, once a second of rows with a fix and a heading has told how
the log begins (what a recording tells of its first values, whenever they come, nobody knows live: an order, a rudder angle or
a shaft speed that is first told later counts from then on). Time is that of the rows; nothing here asks a clock.
"""

import json
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd

from aspnn.checks import LIMITS, re_ending
from aspnn.estimation.cascade import Memory, filter_rows
from aspnn.estimation.measurements import STICKY, Opening, check_opening, opening
from aspnn.estimation.rows import Rows
from aspnn.estimation.states import HELD
from aspnn.frames import Zone
from aspnn.live.clocks import Event
from aspnn.live.ring import Ring
from aspnn.live.row import Row
from aspnn.live.saved import packed, unpacked
from aspnn.records import Log, States, atomic
from aspnn.schema import InputError
from aspnn.vessel import Vessel, from_dict

FORMAT = 1  # of saved states
SETTLE = 1.0  # s of rows, with a fix and a heading among them, that tell how the log begins
BEFORE = 600  # rows without a fix or a heading that are kept at most, for when they come
BLOCK = 600  # rows that are filtered at once
BACK = 1.0  # s: rows that run back further are another log: the filters begin anew
FASTEST = 20.0  # Hz: the most rows that the states of `keep_s` may have
FLAGS = ("gated", "stale", "coasting")  # the last columns of a table of states, in this order
READ = ("time_s", *STICKY, *HELD)  # what the filters read of a log, beside positions


@dataclass(frozen=True)
class EstimatorState:
    """What the alarms ask of an estimator: the last state by its columns (none before the filters have begun), its time [s, UNIX],
    since when [s, UNIX] it coasts, the mean of NIS over its expectation by sensor of late, and what keeps the filters from beginning.
    """

    time: float
    last: dict[str, float]
    coasting_since: float | None
    inconsistency: dict[str, float]
    refused: str


class LiveEstimator:
    """Filters rows as they come (`push`); `states` are those of the last `keep_s` seconds."""

    def __init__(self, vessel: Vessel, zone: Zone, keep_s: float = 600.0, antennas: Sequence[str] = ()):
        self.vessel, self.zone, self.keep_s = vessel, zone, keep_s
        self.antennas = tuple(antennas) or tuple(name for name in vessel.stations if name != "imu")
        places = (f"{name}_{axis}_deg" for name in self.antennas for axis in ("latitude", "longitude"))
        self._columns = (*READ[:1], *places, *READ[1:])
        self.events: deque[Event] = deque(maxlen=1000)
        self.dropped = 0  # values and rows that were left out: beyond what can be, or not later than the last
        self.refused = ""
        self._forget()

    def _forget(self) -> None:
        self.began = math.nan  # time [s, UNIX] of time_s = 0
        self._before: list[Row] = []
        self._begin: Opening | None = None
        self._memory: Memory | None = None
        self._ring: Ring | None = None
        self._index = pd.Index([])
        self._last = -math.inf

    def push(self, rows: Sequence[Row]) -> int:
        """Filter `rows`, in the order of time; returns how many states there are more. Nothing in them raises."""
        count = 0
        for first in range(0, len(rows), BLOCK):
            count += self._push(rows[first : first + BLOCK])
        return count

    def _push(self, rows: Sequence[Row]) -> int:
        count = 0
        fresh: list[Row] = []
        for row in rows:
            if row.time < self._last - BACK:
                count += self._filter(fresh)
                fresh = []
                text = f"the rows run back by {self._last - row.time:.1f} s: the filters begin anew"
                self.events.append(Event(row.time, "restarted", text))
                self._forget()
            if row.time <= self._last:
                self.dropped += 1
                continue
            self._last = row.time
            fresh.append(self._clean(row))
        return count + self._filter(fresh)

    def _clean(self, row: Row) -> Row:
        """The row without values that no ship has, which a log would be refused for."""
        kept = {}
        for name, value in row.values.items():
            low, high = LIMITS.get(re_ending(name), (-math.inf, math.inf))
            if low <= value <= high and math.isfinite(value):
                kept[name] = value
            else:
                self.dropped += 1
        return Row(row.time, kept)

    def _filter(self, rows: list[Row]) -> int:
        if not rows:
            return 0
        if self._begin is None:
            self._before += rows
            rows = self._opened()
            if not rows:
                return 0
        log = self._log()
        table = self._table(rows)
        self._adopt(table)
        assert self._begin is not None
        try:
            states, memory = filter_rows(log, table, self._begin, self._memory)
            numbers = np.array([np.asarray(values, float) for values in states.values()])
            sound = bool(np.isfinite(memory.filters[1].x).all() and np.isfinite(memory.filters[0].x).all())
        except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
            sound, reason = False, str(error).partition("\n")[0]
        else:
            reason = "the state is no number any more"
        if not sound:
            self.events.append(Event(rows[-1].time, "restarted", f"the filters failed ({reason}) and begin anew"))
            last = self._last
            self._forget()
            self._last = last
            return 0
        self._memory = memory
        self._keep(tuple(states), numbers)
        return numbers.shape[1]

    def _opened(self) -> list[Row]:
        """The rows so far, once they tell how the log begins; else none, and the oldest of too many are let go."""
        self._before = self._before[-BEFORE:]
        rows = self._before
        if rows[-1].time - rows[0].time < SETTLE - 1e-6:
            return []
        told: set[str] = set().union(*(row.values for row in rows))
        if "heading_deg" not in told or not any(f"{a}_latitude_deg" in told for a in self.antennas):
            return []
        self.began = rows[0].time
        log = replace(self._log(), table=self._table(rows))  # type: ignore[arg-type]
        begin = opening(log)
        try:
            check_opening(log, begin)
        except InputError as error:
            self.refused = str(error)
            self.began = math.nan
            return []
        self.refused, self._begin, self._before = "", begin, []
        return rows

    def _adopt(self, rows: Rows) -> None:
        """Take what is told for the first time, after the beginning, as what the filters' table holds from now on."""
        if self._memory is None or self._begin is None:
            return
        held, begin = self._memory.held, self._begin
        for name in HELD:
            if name in begin.first or not np.isfinite(rows[name]).any():
                continue
            row = int(np.argmax(np.isfinite(rows[name])))
            value = float(rows[name][row])
            begin = replace(begin, first={**begin.first, name: value})
            if name == "shaft_speed_rps":
                held = replace(held, shaft=name)
            elif name == "rudder_angle_deg":
                held = replace(held, servo=None)
            elif name == "rudder_order_deg" and "rudder_angle_deg" not in begin.first:
                order = math.radians(value)  # the servo stands at the first order
                held = replace(held, servo=(float(rows["time_s"][row]), order), last={**held.last, name: value})
        self._begin, self._memory = begin, replace(self._memory, held=held)

    def _log(self) -> Log:
        return Log(table=pd.DataFrame(), vessel=self.vessel, zone=self.zone)

    def _table(self, rows: Sequence[Row]) -> Rows:
        return Rows.of(self._columns, [{**row.values, "time_s": round(row.time - self.began, 5)} for row in rows])

    def _keep(self, names: tuple[str, ...], numbers: np.ndarray) -> None:
        """Add states (columns, n) to the ring."""
        if self._ring is None or names != self._ring.names:
            self._ring, self._index = Ring(names, self.keep_s, FASTEST), pd.Index(names)
        self._ring.add(numbers)

    @property
    def time(self) -> float:
        """Time of the last state [s, UNIX]; NaN before the first."""
        return math.nan if self._ring is None else self.began + float(self._ring.recent(0.0)[0, -1])

    @property
    def states(self) -> States | None:
        """The states of the last `keep_s` seconds, read (`States.read`); None before the filters have begun."""
        if self._ring is None:
            return None
        values = self._ring.recent(self.keep_s)
        table = pd.DataFrame(values[: -len(FLAGS)].T, copy=False)
        for flag in values[-len(FLAGS) :]:
            table[len(table.columns)] = flag.astype(bool)
        table.columns = self._index
        start = datetime.fromtimestamp(self.began, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        states = States(
            table=table,
            vessel=self.vessel,
            zone=self.zone,
            start=start,
            source="live",
            voyage="live",
            path="live states",
        )
        # Ten times a second: to take the columns out of the table again would cost ten times what all of this does.
        object.__setattr__(states, "columns", dict(zip(self._ring.names, values, strict=True)))
        return states

    def state(self, window: float = 30.0) -> EstimatorState:
        """What the alarms ask of it; consistency over the last `window` seconds."""
        if self._ring is None:
            return EstimatorState(math.nan, {}, None, {}, self.refused)
        rows = self._ring.recent(window)
        last = dict(zip(self._ring.names, rows[:, -1].tolist(), strict=True))
        far: dict[str, float] = {}
        for i, name in enumerate(self._ring.names):
            if name.startswith("nis_"):
                known = rows[i][np.isfinite(rows[i])]
                if len(known) >= 10:
                    far[name[4:]] = float(np.mean(known)) / (1.0 if name in ("nis_heading", "nis_yaw_rate") else 2.0)
        assert self._memory is not None  # there are states
        used = self._memory.held.used
        since = self.began + used if math.isfinite(used) else self.began
        return EstimatorState(self.time, last, since if last["coasting"] else None, far, "")

    def save(self, path: str | Path) -> None:
        """Write all that is needed to go on, whole or not at all."""
        data: dict = {
            "format": FORMAT,
            "vessel": self.vessel.to_dict(),
            "zone": str(self.zone),
            "keep_s": self.keep_s,
            "antennas": self.antennas,
            "began": self.began,
            "last": self._last,
            "dropped": self.dropped,
            "before": [[row.time, row.values] for row in self._before],
            "names": () if self._ring is None else self._ring.names,
        }
        arrays = {"states": np.empty((0, 0)) if self._ring is None else self._ring.recent(self.keep_s)}
        if self._begin is not None and self._memory is not None:
            more, filters = packed(self._begin, self._memory)
            data |= more
            arrays |= filters
        with atomic(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, allow_pickle=False, data=np.array(json.dumps(data)), **arrays)

    @staticmethod
    def restore(path: str | Path) -> "LiveEstimator":
        """The estimator that was saved. Raises InputError for a file that is damaged or of another version."""
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            data = json.loads(str(arrays["data"]))
            if data["format"] != FORMAT:
                raise InputError(
                    f"{path}: is of format {data['format']}, this version reads {FORMAT}; delete it to begin anew"
                )
            return _restored(data, arrays, str(path))
        except FileNotFoundError:
            raise InputError(f"{path}: no such file") from None
        except InputError:
            raise
        except Exception as error:  # a damaged archive raises whatever its bytes happen to say
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise InputError(f"{path}: cannot be read, it is damaged ({reason}); delete it to begin anew") from None


def _restored(data: dict, arrays: dict[str, np.ndarray], where: str) -> LiveEstimator:
    self = LiveEstimator(from_dict(data["vessel"], where), Zone.parse(data["zone"]), data["keep_s"], data["antennas"])
    self.began, self._last, self.dropped = data["began"], data["last"], data["dropped"]
    self._before = [Row(time, values) for time, values in data["before"]]
    if "begin" in data:
        self._begin, self._memory = unpacked(data, arrays, self._columns)
        self._keep(tuple(data["names"]), arrays["states"])
    return self
