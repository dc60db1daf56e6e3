"""What is kept on board as rolling Parquet parts: rows of the log, states, predictions, and what became of them.

`log-STAMP.parquet` and `states-STAMP.parquet` are those that the commands of `aspnn` read. Beside them (times in UNIX seconds, places on
the grid of `zone` in the metadata; NaN is what there is not):

`predictions-STAMP.parquet`, one row for each kept prediction (one a second) and horizon: `start_s`, that of the state it starts from;
`horizon_s`; `rudder_order_rad` in force; `north_m`, `east_m`, `heading_rad` of midship as predicted by the checkpoint `model` of the
metadata; `region_major_m`, `region_minor_m`, `region_azimuth_rad` of the ellipse that holds midship with 95 %; `outside`, `fits` (1, 0),
what the predictor knows of itself; `arc_north_m`, `arc_east_m`, `arc_heading_rad` of the rate-of-turn arc.

`errors-STAMP.parquet`, one row for each of these that has come to its end: `start_s`, `horizon_s`, the distances of midship `ours_m` and
`arc_m`, `inside` (1, 0): whether the region held it, `held` (1, 0): whether the order was.

A Parquet file is whole only once it is closed, so each part grows as a journal first: JSON lines, given to the operating system
once a second. When the process is killed at most that second is lost; the next start makes Parquet of the journals it finds. Files
older than the hours to keep are removed. No clock is read here, and no failure of the disk is raised: `error` tells it.
"""

import json
import math
import re
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pandas as pd

from aspnn.frames import Zone
from aspnn.live.forecast import EVERY, LEVEL, Ended, Forecast, has_region
from aspnn.motion import Path
from aspnn.records import Log, States, write_log, write_states, write_table
from aspnn.vessel import Vessel

KINDS = ("log", "states", "predictions", "errors")
PART = 600.0  # s in a part
FLUSH = 1.0  # s at most until a row is with the operating system
WAITING = 12_000  # rows of a kind that wait for a disk that fails; older ones are given up
STAMP = "%Y%m%dT%H%M%S"
FILE = re.compile(r"(log|states|predictions|errors)-(\d{8}T\d{6})(?:-\d+)?\.(parquet|jsonl)")
FLAGS = ("gated", "stale", "coasting")
UNITS = {"start": "start_s", "horizon": "horizon_s", "ours": "ours_m", "arc": "arc_m"}  # of `Ended`
TOLD = ("inside", "held")  # yes, no, or not known
COLUMNS = {
    "predictions": [
        *("start_s", "horizon_s", "rudder_order_rad", "north_m", "east_m", "heading_rad"),
        *("region_major_m", "region_minor_m", "region_azimuth_rad", "outside", "fits"),
        *("arc_north_m", "arc_east_m", "arc_heading_rad"),
    ],
    "errors": ["start_s", "horizon_s", "ours_m", "arc_m", "inside", "held"],
}


@dataclass
class Recorder:
    """Keeps rows in `folder`. `push` is cheap; `flush(now)` once a tick writes what waits and rolls parts over.

    Times are UNIX seconds: `time_s` of the rows handed in, `now` that of the host or of the replay. `lost` counts rows given up.
    """

    folder: FilePath
    vessel: Vessel
    zone: Zone
    hours: float
    model: str = ""  # the name of the checkpoint; empty: the arc alone
    error: str = ""
    lost: int = 0
    _waiting: dict[str, deque[str]] = field(default_factory=dict, repr=False)
    _begun: float = math.nan
    _flushed: float = -math.inf
    _stamp: str = ""
    _predicted: float = -math.inf  # start of the last prediction kept

    def __post_init__(self) -> None:
        self.folder = FilePath(self.folder)
        self._waiting = {kind: deque() for kind in KINDS}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for journal in sorted(self.folder.glob("*.jsonl")):
                self._close(journal)
        except OSError as error:
            self._failed(error)

    def rows(self, rows: Iterable[tuple[float, Mapping[str, float]]]) -> None:
        """Rows of the log: time and columns of schema.LOG."""
        self._push("log", ({"time_s": time, **values} for time, values in rows))

    def states(self, table: pd.DataFrame, epoch: float) -> None:
        """Rows of states; `epoch` [s, UNIX] is the zero of their `time_s`."""
        if len(table):
            moved = table.assign(time_s=table["time_s"].to_numpy(float) + epoch)
            self._push("states", moved.to_dict("records"))

    def forecast(self, found: Forecast, horizons: np.ndarray, rudder: float, epoch: float) -> None:
        """A prediction under the `rudder` order [rad] in force, at `horizons` [s]; of those of one second the first is kept."""
        if 0 <= found.start - self._predicted < EVERY - 1e-6:
            return
        self._predicted = found.start
        table = {
            "start_s": np.full(len(horizons), epoch + found.start),
            "horizon_s": horizons,
            "rudder_order_rad": np.full(len(horizons), rudder),
            **_places(found.arc.at(horizons), "arc_"),
        }
        if found.path is not None:
            path = found.path.at(horizons)
            table |= _places(path, "")
            table["outside"] = np.full(len(horizons), float(found.outside))
            table["fits"] = np.full(len(horizons), np.nan if found.fits is None else float(found.fits))
            if has_region(path):
                region = path.region(LEVEL)
                table |= {
                    "region_major_m": region.major,
                    "region_minor_m": region.minor,
                    "region_azimuth_rad": region.azimuth,
                }
        values = {name: np.round(column, 6).tolist() for name, column in table.items()}
        self._push("predictions", (dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)))

    def ended(self, found: Iterable[Ended], epoch: float) -> None:
        """Predictions that have come to their end."""
        rows = (one._asdict() | {"start": epoch + one.start} for one in found)
        self._push("errors", ({UNITS.get(name, name): value for name, value in row.items()} for row in rows))

    def flush(self, now: float) -> None:
        """Hand what waits to the operating system if a second has passed; begin a new part where the old one is full."""
        if abs(now - self._flushed) < FLUSH:
            return
        self._flushed = now
        try:
            if not math.isfinite(self._begun):
                self._begin(now)
            elif not 0 <= now - self._begun < PART:
                self._write()
                self._roll()
                self._begin(now)
                self._forget(now)
            self._write()
            self.error = ""
        except OSError as error:
            self._failed(error)

    def close(self) -> None:
        """Write all that waits and make Parquet of the open part."""
        try:
            if self._stamp:
                self._write()
                self._roll()
                self._stamp, self._begun, self._flushed = "", math.nan, -math.inf
        except OSError as error:
            self._failed(error)

    @property
    def waiting(self) -> int:
        """Rows that are not with the operating system yet."""
        return sum(map(len, self._waiting.values()))

    def _push(self, kind: str, rows: Iterable[Mapping[str, Any]]) -> None:
        waiting = self._waiting[kind]
        for row in rows:
            waiting.append(json.dumps(row, default=_json))
            if len(waiting) > WAITING:
                waiting.popleft()
                self.lost += 1

    def _begin(self, now: float) -> None:
        stamp = f"{datetime.fromtimestamp(now, UTC):{STAMP}}"
        taken, number = stamp, 0
        while any(self.folder.glob(f"*-{taken}.*")):  # a clock that was set back
            number += 1
            taken = f"{stamp}-{number}"
        self._stamp, self._begun = taken, now

    def _write(self) -> None:
        for kind, waiting in self._waiting.items():
            if waiting:
                with open(self.folder / f"{kind}-{self._stamp}.jsonl", "a", encoding="ascii") as file:
                    file.write("".join(f"{line}\n" for line in waiting))
                waiting.clear()

    def _roll(self) -> None:
        for kind in KINDS:
            journal = self.folder / f"{kind}-{self._stamp}.jsonl"
            if journal.exists():
                self._close(journal)

    def _close(self, journal: FilePath) -> None:
        """Make Parquet of a journal and remove it. What is no row (the line that a killed process had begun) is left out."""
        match = FILE.fullmatch(journal.name)
        if match is None:
            return
        rows = []
        for line in journal.read_text(encoding="ascii", errors="replace").splitlines():
            with suppress(ValueError):
                row = json.loads(line)
                if isinstance(row, dict):
                    rows.append(row)
        if rows:
            self._parquet(match[1], pd.DataFrame(rows), journal.with_suffix(".parquet"))
        journal.unlink()

    def _parquet(self, kind: str, table: pd.DataFrame, path: FilePath) -> None:
        if kind in ("predictions", "errors"):
            known = table.assign(
                **{name: table[name].astype("boolean").astype(float) for name in TOLD if name in table}
            )
            metadata = {
                "kind": kind,
                "format": 1,
                "vessel": self.vessel.name,
                "zone": str(self.zone),
                "model": self.model,
            }
            write_table(known.reindex(columns=COLUMNS[kind]), path, metadata)
            return
        table = table.sort_values("time_s", kind="stable").drop_duplicates("time_s", keep="last", ignore_index=True)
        first = math.floor(float(table["time_s"].iloc[0]))
        table["time_s"] = np.round(table["time_s"].to_numpy(float) - first, 6)
        head: dict[str, Any] = {
            "vessel": self.vessel,
            "zone": self.zone,
            "start": datetime.fromtimestamp(first, UTC).isoformat().replace("+00:00", "Z"),
            "source": "recorded live by aspnn",
            "voyage": path.stem.split("-", 1)[1],
        }
        if kind == "log":
            write_log(Log(table=table, **head), path)
            return
        flags = {name: table[name].astype(bool) for name in FLAGS if name in table}
        write_states(States(table=table.assign(**flags), **head), path)

    def _forget(self, now: float) -> None:
        """Remove the parts that ended more than the hours to keep ago, by the time in their names."""
        for path in self.folder.iterdir():
            match = FILE.fullmatch(path.name)
            if match is None:
                continue
            begun = datetime.strptime(match[2], STAMP).replace(tzinfo=UTC).timestamp()
            if begun + PART < now - self.hours * 3600:
                path.unlink()

    def _failed(self, error: OSError) -> None:
        self.error = f"{error.filename or self.folder}: {error.strerror or error}"


def _places(path: Path, prefix: str) -> dict[str, np.ndarray]:
    """North, east [m] and grid heading [rad] of a path, as columns."""
    return {f"{prefix}north_m": path.north, f"{prefix}east_m": path.east, f"{prefix}heading_rad": path.heading}


def _json(value: Any) -> Any:
    """numpy's numbers as Python's."""
    return value.item()
