"""Anybody's own logs: CSV files whose columns, units, signs, time and antennas a map (TOML) tells.

`data/maps/example.toml` is a map with every key explained. What a map says is held against what the log says of itself:
a wrong sign or unit shows as a factor between two columns that measure the same motion, and is named with its remedy. A
check that has too little movement to decide says nothing.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aspnn.checks import check_log
from aspnn.config import read_toml
from aspnn.frames import Zone
from aspnn.logs.derived import with_rudder_orders
from aspnn.logs.maps import TIMES, CsvMap, Form, mapped_vessel, source_files, utc
from aspnn.logs.plausible import oddities, problems
from aspnn.logs.units import units_of
from aspnn.records import Log, sha256
from aspnn.schema import InputError
from aspnn.vessel import Vessel

BEARINGS = {"heading_deg", "course_over_ground_deg", "wind_from_true_deg"}
BLANK = {"", "nan", "na", "n/a", "null", "none", "-", "--"}


def import_csv(sources: Sequence[str | Path], map: str | Path, vessel: str | None = None) -> list[Log]:
    """The logs in CSV files (or all *.csv and *.txt of folders), one per file, as the map at `map` tells; checked.

    `vessel` takes the place of the map's. `notes` tell what was dropped, derived or looks odd; `notes["name"]` is a stem for
    the file of each log, no two alike. Raises InputError, one line that names file, row, column and the entry of the map to change.
    """
    plan = read_toml(map, CsvMap)
    ship = mapped_vessel(plan, map, vessel)
    found = source_files(sources, (".csv", ".txt"))
    return [_import(file, name, plan, Path(map), ship) for name, file in found.items()]


def _import(file: Path, name: str, plan: CsvMap, map: Path, vessel: Vessel) -> Log:
    cells = _read(file, plan.csv)
    time, start = _time(cells, plan, map)
    table, empty = {"time_s": time}, []
    for column, source in plan.columns.items():
        values = _numbers(cells, source.column, f"columns.{column}", map)
        if np.isnan(values).all():
            empty.append(column)
        else:
            table[column] = source.sign * units_of(column)[source.unit] * values + source.offset
    notes: dict[str, Any] = {"name": name, "sha256": sha256(file)}
    if cells.repeated:
        notes["dropped"] = f"{cells.repeated} repeated headers"
    if empty:
        notes["empty"] = f"no value in {', '.join(empty)}"
    log = Log(
        table=pd.DataFrame(table),
        vessel=vessel,
        zone=Zone.parse(plan.zone) if plan.zone else None,
        start=start,
        source=f"{file.name} by {map.name}",
        voyage=plan.voyage or file.stem,
        notes=notes,
        path=str(file),
    )
    step = np.diff(time)
    if len(step) and np.all(step > 0):  # check_log says what is wrong with another time
        for problem in problems(log, plan):
            raise InputError(f"{file}: {problem} in {map}")
    check_log(log, str(file))
    gaps = step > max(1.0, 5 * float(np.median(step)))
    if gaps.any():
        notes["gaps"] = f"{gaps.sum()} gaps, the longest of {step.max():.3g} s"
    notes |= oddities(log)
    for bearing in BEARINGS & table.keys():  # only now: wrapped earlier, a wrong unit would not show
        table[bearing] = np.where((table[bearing] >= 0) & (table[bearing] < 360), table[bearing], table[bearing] % 360)
    derived, orders = with_rudder_orders(pd.DataFrame(table), vessel.rudder_rate)
    return replace(log, table=derived, notes=notes | orders)


# ---- Reading ----


@dataclass(frozen=True)
class _Cells:
    """The text of a CSV file: the header, the rows below it and the line each stands in, counted from 1."""

    file: Path
    form: Form
    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    repeated: int  # rows that were the header again

    def column(self, name: str, entry: str, map: Path) -> list[str]:
        """The cells of a column. Raises InputError naming the column, the entry of the map and the nearest column there is."""
        if self.header.count(name) != 1:
            near = get_close_matches(name.lower(), [h.lower() for h in self.header], 1, 0.3)
            hint = next((f", the nearest is {h!r}" for h in self.header if near and h.lower() == near[0]), "")
            if len(self.header) == 1:
                hint = f"; the header {self.header[0]!r} is one column, check csv.separator"
            problem = "stands twice in the header" if name in self.header else f"is missing{hint}"
            raise InputError(f"{self.file}: column {name!r} {problem}; change {entry} in {map}")
        place = self.header.index(name)
        return [row[place] for row in self.rows]


def _read(file: Path, form: Form) -> _Cells:
    header: list[str] = []
    rows: list[list[str]] = []
    lines, repeated = [], 0
    try:
        with open(file, newline="", encoding=form.encoding) as text:
            reader = csv.reader(islice(text, form.skip_rows, None), delimiter=form.separator, skipinitialspace=True)
            for cells in reader:
                row = [cell.strip() for cell in cells]
                if not any(row) or (form.comment and row[0].startswith(form.comment)):
                    continue
                line = reader.line_num + form.skip_rows
                if not header:
                    header = row
                elif row == header:
                    repeated += 1
                elif len(row) > len(header) and any(row[len(header) :]):
                    raise InputError(
                        f"{file}: row {len(rows)} (line {line}) has {len(row)} cells under {len(header)} columns; "
                        "check csv.separator and csv.decimal"
                    )
                else:
                    rows.append(row + [""] * (len(header) - len(row)))
                    lines.append(line)
    except FileNotFoundError:
        raise InputError(f"{file}: no such file") from None
    except (UnicodeDecodeError, LookupError):
        raise InputError(f'{file}: is not {form.encoding} text; name its csv.encoding, such as "latin-1"') from None
    except (OSError, csv.Error) as error:
        raise InputError(f"{file}: cannot be read as CSV ({error})") from None
    if not rows:
        raise InputError(f"{file}: holds no rows below a header; check csv.skip_rows, or record it again")
    return _Cells(file, form, header, rows, lines, repeated)


def _numbers(cells: _Cells, column: str, entry: str, map: Path) -> np.ndarray:
    """A column as numbers, NaN where blank. Raises InputError naming row and column of text that is no number."""
    text = cells.column(column, entry, map)
    values = np.full(len(text), np.nan)
    for row, cell in enumerate(text):
        if cell.lower() in BLANK:
            continue
        try:
            values[row] = float(cell.replace(",", ".") if cells.form.decimal == "," else cell)
        except ValueError:
            comma = cells.form.decimal == "." and cell.count(",") == 1
            remedy = 'set csv.decimal = ","' if comma else "leave the cell empty or correct it"
            raise InputError(
                f"{cells.file}: row {row} (line {cells.lines[row]}), column {column}: {cell!r} is not a number; {remedy}"
            ) from None
    return values


def _time(cells: _Cells, plan: CsvMap, map: Path) -> tuple[np.ndarray, str]:
    """Time [s] from the first row, and the start as UTC in ISO 8601 ("" where nothing tells it)."""
    clock, start = plan.time, plan.start
    if clock.unit in TIMES:
        if len(clock.columns) > 1:
            raise InputError(f"{map}: time.column: several columns make text, so time.unit must be iso8601 or a format")
        time = TIMES[clock.unit] * _numbers(cells, clock.columns[0], "time.column", map)
    else:
        parts = [cells.column(column, "time.column", map) for column in clock.columns]
        text = pd.Series([" ".join(row).replace(",", ".") for row in zip(*parts, strict=True)])
        form = "ISO8601" if clock.unit == "iso8601" else clock.unit.replace(",", ".")
        instants = pd.to_datetime(text, format=form, utc=True, errors="coerce")
        if instants.isna().any():
            row = int(np.argmax(instants.isna()))
            raise InputError(
                f"{cells.file}: row {row} (line {cells.lines[row]}), column {' '.join(clock.columns)}: "
                f"{text[row]!r} is not a time of the form {clock.unit}; correct it or time.unit in {map}"
            )
        seconds = (instants - instants[0]).dt.total_seconds().to_numpy()
        dated = clock.unit == "iso8601" or any(sign in clock.unit for sign in ("%d", "%j", "%x", "%c", "%s"))
        if not dated:  # a clock without a date starts again at midnight
            seconds = seconds + 86400 * np.concatenate([[0], np.cumsum(np.diff(seconds) < -43200)])
        else:
            start = start or utc(instants[0].to_pydatetime())
        time = seconds
    known = time[np.isfinite(time)]
    first = known[0] if len(known) else 0.0
    return time - first, start
