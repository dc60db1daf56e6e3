"""What every log must keep: the contract that readers and importers hold it to, whole or block by block."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aspnn import schema
from aspnn.frames import to_grid
from aspnn.schema import InputError

if TYPE_CHECKING:
    from aspnn.records import Log

FASTEST = 60.0  # m/s; no ship keeps it up over SUSTAINED fixes in a row (a single jump is for the filter's gate)
SUSTAINED = 50
SAME_EPOCH = 1e-6  # s; rows closer than this are one epoch whose time was rounded in two ways
LIMITS: dict[str, tuple[float, float]] = {
    "latitude_deg": (-90, 90),
    "longitude_deg": (-180, 360),
    "heading_deg": (-360, 720),
    "yaw_rate_deg_s": (-60, 60),
    "roll_deg": (-180, 180),
    "pitch_deg": (-90, 90),
    "acceleration_surge_m_s2": (-30, 30),
    "acceleration_sway_m_s2": (-30, 30),
    "rudder_order_deg": (-90, 90),
    "rudder_angle_deg": (-90, 90),
    "engine_order_rps": (-100, 100),
    "shaft_speed_rps": (-100, 100),
    "speed_over_ground_m_s": (0, 60),
    "wind_speed_true_m_s": (0, 100),
    "wind_from_true_deg": (-360, 720),
}


def check_log(log: "Log", where: str = "log") -> None:
    """Hold a log to its contract: columns, numbers, rising time, values a ship can have, positions it can reach.

    Raises InputError that names `where`, the row (counted from 0, as the table counts), time, column and the remedy.
    """
    for _ in check_blocks(log, len(log.table), [log.table], where):
        pass


def check_blocks(log: "Log", rows: int, blocks: Iterable[pd.DataFrame], where: str = "log") -> Iterator[pd.DataFrame]:
    """The `blocks` of a log's `rows`, each as soon as it is found to keep the contract together with those before it.

    Raises InputError as `check_log` does.
    """
    schema.check(log.table, schema.LOG, where)
    if rows < 2:
        raise InputError(f"{where}: holds {rows} rows, at least 2 are needed")
    before, numbers, seen = None, np.empty(0, int), 0
    for block in blocks:
        numbers = np.concatenate([numbers, np.arange(seen, seen + len(block))])
        seen += len(block)
        known = block if before is None else pd.concat([before, block])
        together = replace(log, table=known.reset_index(drop=True))
        _check_rows(together, where, numbers, seen >= rows)
        if seen < rows:
            kept = _recent(together)
            before, numbers = together.table.iloc[kept], numbers[kept]
        yield block


def _recent(log: "Log") -> np.ndarray:
    """The rows that the check of the next block needs: the last, and of every antenna the last SUSTAINED different fixes."""
    fixes = (_different(log, antenna)[0][-SUSTAINED:] for antenna in schema.antennas(log.table.columns))
    return np.unique(np.concatenate([*fixes, [len(log.table) - 1]]))


def _check_rows(log: "Log", where: str, numbers: np.ndarray, last: bool) -> None:
    """Hold rows, which count as `numbers` in the log, to the contract; `last`: no rows follow."""
    table = log.table
    for name in table.columns:
        if not pd.api.types.is_numeric_dtype(table[name]):
            bad = pd.to_numeric(table[name], errors="coerce").isna() & table[name].notna()
            row = int(np.argmax(bad.to_numpy()))
            raise InputError(f"{where}: row {numbers[row]}, column {name}: {table[name].iloc[row]!r} is not a number")
    time = table["time_s"].to_numpy(float)

    def first(name: str, bad: np.ndarray, say: Callable[[int], str]) -> None:
        """Raise InputError for the first row where `bad` is true."""
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(f"{where}: row {numbers[row]} (time {time[row]:g} s), column {name}: {say(row)}")

    first("time_s", ~np.isfinite(time), lambda row: "time is missing; drop the row")
    steps = np.diff(time, prepend=time[0] - 1.0)
    first(
        "time_s",
        steps <= -SAME_EPOCH,
        lambda row: f"time runs back by {-steps[row]:g} s; sort the rows or cut the log there",
    )
    twice = np.abs(steps) < SAME_EPOCH
    first("time_s", twice, lambda row: "the epoch stands twice; drop one of the two rows")
    for name in table.columns:
        low, high = LIMITS.get(re_ending(name), (-np.inf, np.inf))
        value = table[name].to_numpy(float)
        first(name, np.isinf(value), lambda row: "is infinite; leave it empty where a sensor has no value")
        outside = (value < low) | (value > high)
        problem = f"is outside {low:g} to {high:g}; check the unit"
        first(name, outside, lambda row, v=value, p=problem: f"{v[row]:g} {p}")  # type: ignore[misc]
    names = schema.antennas(table.columns)
    if not names:
        raise InputError(
            f"{where}: no antenna has a position; columns NAME_latitude_deg and NAME_longitude_deg, or NAME_north_m and NAME_east_m, are needed"
        )
    for antenna in names:
        geodetic = f"{antenna}_latitude_deg" in table
        pair = f"{antenna}_longitude_deg" if geodetic else f"{antenna}_east_m"
        if pair not in table:
            raise InputError(
                f"{where}: column {pair} is missing beside {antenna}_{'latitude_deg' if geodetic else 'north_m'}"
            )
        if geodetic and log.zone is None:
            raise InputError(f'{where}: the log has latitudes but no UTM zone; name it when importing (zone = "33N")')
        if antenna not in log.vessel.stations:
            raise InputError(
                f"{where}: antenna {antenna} has no station in the vessel; add stations_m.{antenna} = [x, y]"
            )
        _check_speed(log, antenna, where, numbers, last)


def _different(log: "Log", antenna: str) -> tuple[np.ndarray, np.ndarray]:
    """The rows of an antenna's fixes, without those that repeat the one before, and the places as complex numbers [m]."""
    table, zone = log.table, log.zone
    if f"{antenna}_north_m" in table:
        north, east = (table[f"{antenna}_{axis}_m"].to_numpy(float) for axis in ("north", "east"))
    else:
        latitude, longitude = (np.radians(table[f"{antenna}_{axis}_deg"]) for axis in ("latitude", "longitude"))
        north, east = to_grid(latitude, longitude, zone)  # type: ignore[arg-type]
    place = north + 1j * east
    known = np.flatnonzero(np.isfinite(place))
    known = known[np.diff(place[known], prepend=np.nan) != 0]  # a recorder may repeat the last fix
    return known, place[known]


def _check_speed(log: "Log", antenna: str, where: str, numbers: np.ndarray, last: bool) -> None:
    """Refuse fixes in a row that no ship can reach from one another.

    Every step must be too fast, which a jump is not, and so must all of them together, which noise is not.
    """
    known, place = _different(log, antenna)
    length = min(SUSTAINED, len(known) - 1)
    if length < (3 if last else SUSTAINED):
        return
    time = log.table["time_s"].to_numpy(float)[known]
    fast = np.abs(np.diff(place)) > FASTEST * np.diff(time)
    far = np.abs(place[length:] - place[:-length]) > FASTEST * (time[length:] - time[:-length])
    bad = far & (np.convolve(fast, np.ones(length), "valid") > length - 0.5)
    if bad.any():
        first = int(np.argmax(bad))
        speed = abs(place[first + length] - place[first]) / (time[first + length] - time[first])
        raise InputError(
            f"{where}: row {numbers[known[first]]} (time {time[first]:g} s): antenna {antenna} moves at {speed:.4g} m/s over "
            f"{length} fixes in a row; check the unit of time, and the units and the order of the positions' columns"
        )


def re_ending(column: str) -> str:
    """The part of an antenna's column that its limits go by (`bow_latitude_deg` -> `latitude_deg`)."""
    for ending in ("latitude_deg", "longitude_deg"):
        if column.endswith(f"_{ending}"):
            return ending
    return column
