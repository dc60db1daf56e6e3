"""Importer of decoded NMEA 2000 recordings: one long CSV file per voyage, `t`, `pgn`, `src`, then a column per field.

Each row is one message: its time [s], its PGN, the address of the sender and the fields that the message has, angles in
degrees, rates in degrees per second, speeds in m/s; columns may stand in any order. Every sensor sends at its own time, so
the log has one row per time at which a sensor of the map was heard, NaN where the others were silent. Who tells what is a
map's (`YachtMap`); without one it is `DEFAULT`, the yacht of the recordings, which `data/maps/n2k-yacht.toml` explains.

What is odd in such recordings is handled here and counted in the log's notes: rows that are there twice, values of one
sensor at one time (the first is kept), half positions, messages that a gateway wrote in exchanged order. Two things are
left as they are and told: positions are decoded to few digits (1e-5 deg of longitude is 0.9 m), so a fix may repeat its
predecessor and yet be fresh; and times are those of receipt, so that after a stall of the bus the values of half a second
come late, within hundredths of a second. The filter's gate has to reject those.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from aspnn.checks import check_log
from aspnn.config import read_toml
from aspnn.frames import Zone
from aspnn.logs.maps import Map, Strict, mapped_vessel, source_files
from aspnn.records import Log, sha256
from aspnn.schema import InputError
from aspnn.vessel import Vessel, from_dict

KEYS = ("t", "pgn", "src")
# quantity of a map -> the fields of its messages and the columns of the log they fill
FIELDS: dict[str, dict[str, str]] = {
    "heading": {"yaw": "heading_deg"},
    "yaw_rate": {"rot": "yaw_rate_deg_s"},
    "roll": {"roll": "roll_deg"},
    "speed_through_water": {"stw": "speed_through_water_m_s"},
    "over_ground": {"cog": "course_over_ground_deg", "sog": "speed_over_ground_m_s"},
}
POSITION = {"lat": "latitude_deg", "lon": "longitude_deg"}
NEEDED = ("sensors.heading",)  # without it there is nothing to filter; what else is silent is told in the notes
SOON = 0.5  # of a sensor's usual interval: what is followed sooner by the next value came late itself
DISORDER = 1.0  # s: by so much may messages be exchanged in a gateway; a clock that was set runs back further

Address = Annotated[int, Field(ge=0, le=253)]  # of a sender on the bus


class Antenna(Strict):
    """A GNSS receiver by its address, and its antenna's (x forward, y starboard) from midship [m]."""

    source: Address
    station_m: tuple[float, float]


class Told(Strict):
    """The address that tells each quantity; what is left out is not taken from anybody."""

    heading: Address
    yaw_rate: Address | None = None
    roll: Address | None = None
    speed_through_water: Address | None = None
    over_ground: Address | None = None


class YachtMap(Map):
    """Who tells what on the bus. `zone` is the UTM zone; without it that of the middle position, for the whole log."""

    antennas: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9]*$")], Antenna] = Field(min_length=1)
    sensors: Told


# The yacht of the recordings. The satellite compass (52) also tells a rate of turn, damped and 8 to 9 s late, and a course
# over ground about 2.5 s late: not taken, and not moved earlier either, which would tell a prediction its future.
DEFAULT = YachtMap(
    vessel="n2k_yacht",
    antennas={"compass": Antenna(source=52, station_m=(-7.0, -2.2))},
    sensors=Told(heading=52, yaw_rate=27, roll=52, speed_through_water=35),
)


def import_n2k_yacht(
    sources: Sequence[str | Path], map: str | Path | YachtMap | None = None, vessel: str | None = None
) -> list[Log]:
    """Logs of recordings, one per file (folders are searched through), by a map: a file, its content, or None for DEFAULT.

    `vessel` takes the place of the map's. `notes` hold what was dropped, who told what and the resolution of the fixes.
    Raises InputError naming file, row and column, or the entry of the map.
    """
    if map is None or isinstance(map, YachtMap):
        plan, path = map or DEFAULT, Path()
        where = "the map (copy data/maps/n2k-yacht.toml and name yours with --map)"
    else:
        plan, path, where = read_toml(map, YachtMap), Path(map), str(map)
    ship = mapped_vessel(plan, path, vessel).with_stations(**{n: a.station_m for n, a in plan.antennas.items()})
    ship = from_dict(ship.to_dict(), where)  # as it will be read again: stations that cannot be are refused here
    return [_log(file, name, plan, where, ship) for name, file in source_files(sources, (".csv",)).items()]


def _log(file: Path, name: str, plan: YachtMap, where: str, ship: Vessel) -> Log:
    messages, notes = _read(file)
    series, heard = _series(messages, plan, file, where)
    time = np.unique(np.concatenate([s.index.to_numpy() for s in series.values()]))
    table = {"time_s": np.round(time - time[0], 5)}
    table |= {column: values.reindex(time).to_numpy(float) for column, values in series.items()}
    for bearing in ("heading_deg", "course_over_ground_deg"):
        if bearing in table:
            table[bearing] = table[bearing] % 360
    notes = {"name": name, **notes, **heard}
    if plan.zone is None:
        antenna = next(iter(plan.antennas))
        place = [float(series[f"{antenna}_{end}"].median()) for end in POSITION.values()]
        zone = Zone.of(*np.radians(place))
        notes["zone"] = f"{zone}, that of the middle position of {antenna}"
    else:
        zone = Zone.parse(plan.zone)
    notes["resolution_deg"] = {
        column: _resolution(series[column].to_numpy())
        for antenna in plan.antennas
        for column in (f"{antenna}_{end}" for end in POSITION.values())
    }
    log = Log(
        table=pd.DataFrame(table),
        vessel=ship,
        zone=zone,
        start=plan.start,
        source=f"{file.name}, decoded NMEA 2000, SHA-256 {sha256(file)}",
        voyage=plan.voyage or name,
        notes=notes,
    )
    check_log(log, str(file))
    return log


def _read(file: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    """The messages of a file as numbers, in the order of time, and what was dropped. Raises InputError."""
    try:
        text = pd.read_csv(file, dtype=str, encoding="utf-8-sig", skipinitialspace=True)
    except (ValueError, OSError) as error:
        raise InputError(f"{file}: cannot be read as CSV ({str(error).splitlines()[0]}); decode it again") from None
    if not isinstance(text.index, pd.RangeIndex):
        raise InputError(f"{file}: rows have more cells than the header has columns; decode it again")
    fields = {field for fields in (*FIELDS.values(), POSITION) for field in fields}
    for key in KEYS:
        if key not in text:
            raise InputError(f"{file}: column {key} is missing; is it a decoded NMEA 2000 log (t, pgn, src, fields)?")
    text = text[[c for c in text.columns if c in fields or c in KEYS]].dropna(how="all")
    if len(text) < 2:
        raise InputError(f"{file}: holds {len(text)} messages, at least 2 are needed; record it again")
    table = text.apply(pd.to_numeric, errors="coerce")
    for column in table.columns:
        bad = table[column].isna() & (text[column].notna() | (column in KEYS))
        bad |= ~np.isfinite(table[column].fillna(0.0))
        if bad.any():
            row = bad.idxmax()
            cell = text[column][row]
            problem = "is missing" if pd.isna(cell) else f"{cell!r} is not a number"
            raise InputError(f"{file}: row {row}, column {column}: {problem}; correct the cell or drop the row")
    table["t"] = table["t"].round(5)  # finer differences are the rounding of one time
    back = table["t"].cummax() - table["t"]
    if back.max() > DISORDER:
        row = (back > DISORDER).idxmax()
        raise InputError(
            f"{file}: row {row}, column t: time runs back by {back[row]:.6g} s to {table['t'][row]:g} s (a clock that was "
            "set?); cut the file there"
        )
    notes: dict[str, Any] = {"messages": len(table), "in_exchanged_order": int((back > 0).sum())}
    table = table.sort_values("t", kind="stable")
    again = table.duplicated()
    notes["repeated_rows_dropped"] = int(again.sum())
    return table[~again], {key: count for key, count in notes.items() if count}


def _series(
    messages: pd.DataFrame, plan: YachtMap, file: Path, where: str
) -> tuple[dict[str, pd.Series], dict[str, Any]]:
    """Values by column of the log, each over its own times, and notes: who told them, which quantities nobody told."""
    wanted = [
        (f"antennas.{name}.source", antenna.source, {field: f"{name}_{ending}" for field, ending in POSITION.items()})
        for name, antenna in plan.antennas.items()
    ]
    if len({source for _, source, _ in wanted}) < len(wanted):
        raise InputError(f"{where}: antennas: two have the same source; each antenna has a receiver of its own")
    wanted += [
        (f"sensors.{what}", source, columns)
        for what, columns in FIELDS.items()
        if (source := getattr(plan.sensors, what)) is not None
    ]
    series: dict[str, pd.Series] = {}
    told, silent, late, twice, halves = {}, {}, {}, 0, 0
    for entry, source, columns in wanted:
        have = [field for field in columns if field in messages]
        some = messages[have].notna().any(axis=1)
        whole = messages[list(columns)].notna().all(axis=1) if have == list(POSITION) else some
        heard = messages[whole & (messages["src"] == source)]
        halves += int((some & ~whole & (messages["src"] == source)).sum())
        if heard.empty:
            others = ", ".join(f"{s:g}" for s in sorted(messages.loc[whole, "src"].unique())) or "nobody"
            if columns.keys() == POSITION.keys() or entry in NEEDED:
                raise InputError(
                    f"{file}: source {source} sends no {' and '.join(columns)} (heard from: {others}); "
                    f"change {entry} in {where}"
                )
            silent[entry] = f"{source} (heard from: {others})"
            continue
        first = ~heard["t"].duplicated()
        twice += int((~first).sum())
        for field in have:
            values = heard[first].set_index("t")[field].dropna()
            if len(values):
                series[columns[field]] = values
                told[columns[field]] = source
                step = np.diff(values.index.to_numpy())
                late[columns[field]] = int(np.sum(step < SOON * np.median(step))) if len(step) else 0
    counts = {
        "half_positions_dropped": halves,
        "values_dropped_at_same_time": twice,
        "late_values_left_to_gate": {column: count for column, count in late.items() if count},
        "told_by": told,
        "silent": silent,
    }
    return series, {key: count for key, count in counts.items() if count}


def _resolution(values: np.ndarray) -> float:
    """The smallest step [deg] between different values, to one digit: the last decimal that was written."""
    steps = np.diff(np.unique(values))
    return float(f"{steps.min():.0e}") if len(steps) else 0.0
