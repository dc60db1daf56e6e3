"""The records that pass between stages: a voyage's log and its states, as tables with metadata, and their files.

A record is one Parquet file (or CSV with one `# {json}` line first). Metadata travel inside the file. Files are written
beside their place and moved there when whole, so a killed run leaves no half file.
"""

import contextlib
import hashlib
import json
import math
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from aspnn import schema
from aspnn.checks import check_log
from aspnn.frames import Zone
from aspnn.schema import InputError
from aspnn.vessel import Vessel, from_dict

KEY = b"aspnn"


@dataclass(frozen=True)
class Log:
    """Sensor records of one voyage: `table` with columns of schema.LOG, one row per sensor epoch.

    `zone` is None for local north-east positions. `voyage` names what must never be split between training and test.
    `notes` holds what an importer dropped, gated or derived.
    """

    table: pd.DataFrame
    vessel: Vessel
    zone: Zone | None = None
    start: str = ""  # UTC, ISO 8601
    source: str = ""
    voyage: str = ""
    notes: dict[str, Any] = field(default_factory=dict)
    path: str = ""

    def __len__(self) -> int:
        return len(self.table)


@dataclass(frozen=True)
class States:
    """Navigation states of one voyage: `table` with columns of schema.STATES, one row per epoch.

    `smoothed` states know the future: they serve as training labels and as the reference path of an evaluation, never as
    an input of a prediction.
    """

    table: pd.DataFrame
    vessel: Vessel
    zone: Zone | None = None
    start: str = ""
    source: str = ""
    voyage: str = ""
    smoothed: bool = False
    path: str = ""
    columns: dict[str, np.ndarray] | None = field(default=None, init=False, repr=False, compare=False)  # see `read`

    @staticmethod
    def of(log: Log, table: pd.DataFrame, smoothed: bool = False) -> "States":
        """The states that a filter made of a log: all but the table is the log's."""
        return States(table, log.vessel, log.zone, log.start, log.source, log.voyage, smoothed, log.path)

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, column: str) -> np.ndarray:
        """One column as a float64 array; `states["surge_m_s"]`."""
        return self.table[column].to_numpy(dtype=float) if self.columns is None else self.columns[column]

    def read(self, first: int = 0) -> "States":
        """The states from row `first` on with all columns taken out of the table at once, for whoever reads many or often.

        What is written into the table of these states later on is not seen; states made of them (`replace`) read anew.
        """
        if self.columns is not None and first == 0:
            return self
        table = self.table.iloc[first:]
        values = table.to_numpy(dtype=float).T
        values.flags.writeable = False
        states = replace(self, table=table)
        object.__setattr__(states, "columns", dict(zip(table.columns.tolist(), values, strict=True)))
        return states

    def until(self, time: float) -> "States":
        """The states known at `time` [s]: everything up to and including it."""
        rows = int(np.searchsorted(self["time_s"], time + 1e-9, side="right"))
        if rows == 0:
            raise InputError(
                f"{self.path or 'states'}: nothing is known at {time:g} s, the first state is at {self['time_s'][0]:g} s"
            )
        return replace(self, table=self.table.iloc[:rows])


@contextlib.contextmanager
def atomic(path: str | Path):
    """A temporary path beside `path` that replaces it when the block ends well, and vanishes when it does not."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    os.close(handle)
    umask = os.umask(0)
    os.umask(umask)
    try:
        yield Path(name)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name)
        raise


def finite(value: Any) -> Any:
    """A value in JSON's own types: numbers that are finite, or None; tuples, arrays and their like as lists."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, Mapping):
        return {str(key): finite(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return finite(value.tolist())
    if isinstance(value, Iterable):
        return [finite(one) for one in value]
    raise TypeError(f"{type(value).__name__} has no place in JSON")


def write_json(value: Any, path: str | Path) -> None:
    """Write `value` as JSON (see `finite`), whole or not at all."""
    with atomic(path) as temporary:
        temporary.write_text(json.dumps(finite(value), indent=1, allow_nan=False) + "\n")


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_table(table: pd.DataFrame, path: str | Path, metadata: dict[str, Any]) -> None:
    """Write a table with its metadata, as Parquet or (by the ending) CSV, whole or not at all."""
    path = Path(path)
    with atomic(path) as temporary:
        if path.suffix == ".csv":
            with open(temporary, "w") as file:
                file.write(f"# {json.dumps(metadata)}\n")
                table.to_csv(file, index=False)
        else:
            data = pa.Table.from_pandas(table, preserve_index=False, nthreads=1)  # the processes are what is parallel
            data = data.replace_schema_metadata({KEY: json.dumps(metadata).encode()})
            pq.write_table(data, temporary, **_encoding(data.schema))


def _encoding(columns: pa.Schema) -> dict[str, Any]:
    """How Parquet files are packed: lossless, and for numbers a third smaller and three times faster than the defaults.

    Values of a sensor seldom come twice, so a dictionary only costs time; but their first bytes are alike, so all the first
    bytes, all the second ones and so on, each together (BYTE_STREAM_SPLIT), pack well.
    """
    real = [column.name for column in columns if pa.types.is_floating(column.type)]
    others = [column.name for column in columns if column.name not in real]
    return {"compression": "zstd", "use_dictionary": others, "use_byte_stream_split": real}


def read_table(path: str | Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    """A table and its metadata ({} where a file has none). Raises InputError naming the file."""
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty; write it again")
    try:
        if path.suffix == ".csv":
            with open(path) as file:
                first = file.readline()
            metadata = json.loads(first[1:]) if first.startswith("#") else {}
            return pd.read_csv(path, comment="#"), metadata
        data = pq.read_table(path)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _damaged(path, error) from None
    return data.to_pandas(), json.loads((data.schema.metadata or {}).get(KEY, b"{}"))


def read_metadata(path: str | Path) -> tuple[int, dict[str, Any]]:
    """Number of rows and metadata of a Parquet file, without its rows. Raises InputError naming the file."""
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file")
    with _opened(path) as file:
        return file.metadata.num_rows, json.loads((file.schema_arrow.metadata or {}).get(KEY, b"{}"))


def _metadata(record: Log | States, kind: str) -> dict[str, Any]:
    return {
        "kind": kind,
        "format": 1,
        "vessel": record.vessel.to_dict(),
        "zone": None if record.zone is None else str(record.zone),
        "start": record.start,
        "source": record.source,
        "voyage": record.voyage,
    }


def write_log(log: Log, path: str | Path) -> None:
    """Write a log as Parquet or CSV (by the ending), atomically."""
    write_table(log.table, path, {**_metadata(log, "log"), "notes": log.notes})


def write_states(states: States, path: str | Path) -> None:
    """Write states as Parquet or CSV (by the ending), atomically."""
    write_table(states.table, path, {**_metadata(states, "states"), "smoothed": states.smoothed})


def write_state_blocks(states: States, tables: Iterable[pd.DataFrame], path: str | Path) -> None:
    """Write `tables`, one after the other, as the table of `states` (whose own is left out), as Parquet, atomically."""
    metadata = {KEY: json.dumps({**_metadata(states, "states"), "smoothed": states.smoothed}).encode()}
    with atomic(path) as temporary, contextlib.ExitStack() as stack:
        writer = None
        for table in tables:
            data = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(metadata)
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(temporary, data.schema, **_encoding(data.schema)))
            writer.write_table(data)


def _head(path: Path, kind: str, metadata: dict[str, Any]) -> dict[str, Any]:
    """What logs and states share, from the metadata of a file. Raises InputError unless it is of `kind`."""
    if "vessel" not in metadata:
        raise InputError(
            f"{path}: has no metadata of a {kind}; bring it in with `aspnn import csv {path} --map MAP.toml`"
        )
    if metadata.get("kind") != kind:
        raise InputError(f"{path}: holds {metadata.get('kind')}, expected {kind}")
    zone = metadata.get("zone")
    return {
        "vessel": from_dict(metadata["vessel"], str(path)),
        "zone": Zone.parse(zone) if zone else None,
        "start": metadata.get("start", ""),
        "source": metadata.get("source", ""),
        "voyage": metadata.get("voyage") or path.stem,
        "path": str(path),
    }


def read_log(path: str | Path) -> Log:
    """Read and check a canonical log. Raises InputError naming file, row and column of the first thing that is wrong."""
    path = Path(path)
    table, metadata = read_table(path)
    log = Log(table=table, notes=metadata.get("notes", {}), **_head(path, "log", metadata))
    check_log(log, str(path))
    return log


def read_blocks(path: str | Path, rows: int) -> tuple[Log, int, Callable[[], Iterator[pd.DataFrame]]]:
    """A canonical log to be read in blocks of `rows`: the log without its rows, their number, and what yields the blocks.

    Of a Parquet file no more than a block is in memory; a CSV file is read whole. Nothing is checked yet: see `check_blocks`.
    """
    path = Path(path)
    if path.suffix == ".csv" or not path.exists() or path.stat().st_size == 0:
        log = read_log(path)
        table = log.table
        return replace(log, table=table.iloc[:0]), len(table), lambda: _slices(table, rows)
    with _opened(path) as file:
        metadata = json.loads((file.schema_arrow.metadata or {}).get(KEY, b"{}"))
        table, count = file.schema_arrow.empty_table().to_pandas(), file.metadata.num_rows
    log = Log(table=table, notes=metadata.get("notes", {}), **_head(path, "log", metadata))
    return log, count, lambda: _batches(path, rows)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    """A Parquet file, read page by page. Raises InputError that names a damaged one."""
    try:
        with pq.ParquetFile(path, buffer_size=1 << 16, pre_buffer=False) as file:
            yield file
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> InputError:
    reason = str(error).splitlines()[0]
    return InputError(f"{path}: cannot be read, it is damaged or of another format ({reason}); write it again")


def _batches(path: Path, rows: int) -> Iterator[pd.DataFrame]:
    with _opened(path) as file:
        for batch in file.iter_batches(rows, use_threads=False):
            yield batch.to_pandas()


def _slices(table: pd.DataFrame, rows: int) -> Iterator[pd.DataFrame]:
    for start in range(0, len(table), rows):
        yield table.iloc[start : start + rows]


def read_states(path: str | Path) -> States:
    """Read states written by `write_states`. Raises InputError naming the file."""
    path = Path(path)
    table, metadata = read_table(path)
    shared = _head(path, "states", metadata)
    schema.check(table, schema.STATES, str(path))
    return States(table=table, smoothed=bool(metadata.get("smoothed")), **shared)


def read_truth(log: Log) -> pd.DataFrame | None:
    """The truth written beside a simulated log (`X.truth.parquet`), or None where there is none."""
    path = Path(log.path).with_name(f"{Path(log.path).stem}.truth.parquet") if log.path else None
    if path is None or not path.exists():
        return None
    table, _ = read_table(path)
    schema.check(table, schema.TRUTH, str(path))
    return table


MADE = (".truth.parquet", ".states.parquet", ".smoothed.parquet")  # endings of what is no log


def log_files(sources: Iterable[str | Path]) -> list[Path]:
    """Canonical log files among files and folders, sorted. Raises InputError if none.

    What is made beside or of a log (truth, states) is never one, so that the pattern *.parquet of a shell names logs alone.
    """
    found: list[Path] = []
    for source in map(Path, sources):
        if source.is_dir():
            inside = sorted(
                p for p in source.rglob("*") if p.suffix in (".parquet", ".csv") and not p.name.startswith(".")
            )
            inside = [p for p in inside if not p.name.endswith(MADE)]
            if not inside:
                raise InputError(f"{source}: holds no log (.parquet or .csv)")
            found += inside
        elif not source.exists():
            raise InputError(f"{source}: no such file or folder")
        elif not source.name.endswith(MADE):
            found.append(source)
    if not found:
        raise InputError("no log was given; truth and states are none")
    return found
