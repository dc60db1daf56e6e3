"""From a log's columns to measurements in SI and radians on the grid, with frozen fixes and stuck sensors left out.

Nothing here looks ahead: a value at an epoch depends on the log up to that epoch (and, before the first known values, on
those: see `Opening`). A log may come in blocks; what the past tells the next block travels in `Past`.
"""

import math
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations

import numpy as np
import pandas as pd

from aspnn import schema
from aspnn.estimation import screening
from aspnn.estimation.rows import Rows, picked, stacked
from aspnn.frames import Zone, convergence, to_grid
from aspnn.instruments import Calibration
from aspnn.records import Log
from aspnn.schema import InputError

GRAVITY = 9.81
STILL = 0.01  # Froude number below which a repeated fix may be a ship at rest
ABSURD = 1e8  # beyond anything that a log tells in its units: counts as missing
EARTH = 6371e3  # m, mean radius: turns the resolution of an angle into metres
STICKY = {  # columns of sensors that may stick, with the period of angles
    "heading_deg": screening.CIRCLE,
    "yaw_rate_deg_s": 0.0,
    "acceleration_surge_m_s2": 0.0,
    "acceleration_sway_m_s2": 0.0,
}


@dataclass(frozen=True)
class Measurements:
    """Measurements of a log of n epochs; NaN where a sensor has none.

    `fixes` maps each antenna to north, east (n, 2) [m] from `origin`, `heading` [rad] from grid north, `convergence` [rad],
    `yaw_rate` [rad/s], `acceleration` (n, 2) forward and starboard [m/s2], `stale` (n) whether a fix or a value was left out
    because it repeats its predecessor. `stations` [m] in body axes, of the antennas and `imu`. `first_heading` [rad] is that
    of the log, wherever it comes. Values are as recorded: the problems apply `calibration`.
    """

    time: np.ndarray
    origin: np.ndarray
    fixes: dict[str, np.ndarray]
    heading: np.ndarray
    convergence: np.ndarray
    yaw_rate: np.ndarray
    acceleration: np.ndarray
    stale: np.ndarray
    stations: dict[str, tuple[float, float]]
    calibration: Calibration = field(default_factory=Calibration)
    first_heading: float = math.nan


@dataclass(frozen=True)
class Opening:
    """How a log begins, which stands in for what its first rows do not tell.

    `first` is the first known value of every column that has any; `origin` (2,) the first fix, in whole metres; `place` (2,)
    the first latitude and longitude [rad], NaN where the log is of local positions. `twins`: pairs of antennas that have had
    the same fixes in every row.
    """

    first: dict[str, float]
    origin: np.ndarray | None
    place: np.ndarray
    twins: frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Past:
    """What the measurements of a block of a log leave for those of the next.

    `rows` are those of the log that screening looks back at, `shown` what the columns have shown of their resolution;
    `place` (2,) the last latitude and longitude; `settled` (4, 2) those at the last four full seconds, `second` and `gamma`
    the last of them and its convergence.
    """

    rows: pd.DataFrame | Rows
    shown: dict[str, tuple[int, ...]]
    place: np.ndarray
    settled: np.ndarray
    second: float
    gamma: float


def column(log: Log, name: str) -> np.ndarray:
    """A column of the log as float64; NaN where it is infinite or absurd, all NaN where the log has none."""
    table = log.table
    if name not in table:
        return np.full(len(table), np.nan)
    values = np.asarray(table[name], dtype=float)
    return np.where(np.abs(values) < ABSURD, values, np.nan)


def carried(values: np.ndarray, start: float = math.nan) -> np.ndarray:
    """Each value held until the next known one; those before the first known take `start`."""
    known = np.isfinite(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(last < 0, start, values[last])


def _fixes(log: Log, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Northing and easting (n, 2) [m] of an antenna, and its latitude and longitude (n, 2) [rad]; NaN where not both known."""
    if f"{name}_latitude_deg" in log.table and log.zone is not None:
        place = np.radians(np.column_stack([column(log, f"{name}_{axis}_deg") for axis in ("latitude", "longitude")]))
        fixes = np.column_stack(to_grid(place[:, 0], place[:, 1], log.zone))
    else:
        fixes = np.column_stack([column(log, f"{name}_north_m"), column(log, f"{name}_east_m")])
        place = np.full_like(fixes, np.nan)
    gone = ~np.isfinite(fixes).all(axis=1)
    fixes[gone], place[gone] = np.nan, np.nan
    return fixes, place


def _first(series: list[np.ndarray]) -> np.ndarray | None:
    """The first known row of any of `series` (n, 2), the first of those that share it; None where there is none."""
    rows = [int(np.argmax(known)) if (known := np.isfinite(s[:, 0])).any() else len(s) for s in series]
    best = int(np.argmin(rows)) if rows else 0
    return series[best][rows[best]] if rows and rows[best] < len(series[best]) else None


def opening(log: Log) -> Opening:
    """How a log, or a block of one, begins."""
    first = {}
    for name in log.table.columns:
        values = column(log, name)
        known = np.isfinite(values)
        if known.any():
            first[name] = float(values[np.argmax(known)])
    antennas = {name: _fixes(log, name) for name in schema.antennas(log.table.columns)}
    fix, place = _first([fixes for fixes, _ in antennas.values()]), _first([place for _, place in antennas.values()])
    return Opening(
        first=first,
        origin=None if fix is None else np.floor(fix),
        place=np.full(2, np.nan) if place is None else place,
        twins=frozenset(
            (a, b)
            for a, b in combinations(antennas, 2)
            if np.array_equal(antennas[a][0], antennas[b][0], equal_nan=True)
        ),
    )


def joined(early: Opening, late: Opening) -> Opening:
    """How a log begins whose first block begins as `early` and the next as `late`."""
    return Opening(
        first=late.first | early.first,
        origin=late.origin if early.origin is None else early.origin,
        place=late.place if np.isnan(early.place).any() else early.place,
        twins=early.twins & late.twins,
    )


def check_opening(log: Log, begin: Opening, heading: bool = True) -> None:
    """Raise InputError when a log has no fix or no heading at all, one antenna twice under two names, or no noise to expect.

    Without `heading` the filter needs none.
    """
    where = log.path or "log"
    for name, value in asdict(log.vessel.noise).items():
        if not 0 < value < math.inf:
            raise InputError(f"{where}: vessel {log.vessel.name}: noise {name} = {value} must be a positive number")
    if begin.origin is None:
        raise InputError(f"{where}: no antenna has any position; fill NAME_latitude_deg and NAME_longitude_deg")
    if heading and "heading_deg" not in begin.first:
        raise InputError(
            f"{where}: column heading_deg has no value; the filter needs a heading (filter --course-only goes without)"
        )
    told = set(schema.antennas(begin.first))
    for a, b in sorted(pair for pair in begin.twins if told.issuperset(pair)):
        apart = math.dist(log.vessel.stations[a], log.vessel.stations[b])
        if apart > 0:
            raise InputError(
                f"{where}: antennas {a} and {b} have the same position in every row, but their stations lie {apart:g} m "
                f"apart; drop the columns of one of them"
            )


def grid_convergence(time, place, zone: Zone, past: Past | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Grid convergence [rad] (n): afresh each second (E15) from the median of the last five, then held.

    `place` (n, 2) are latitude and longitude [rad], carried over gaps. The median keeps a wild fix from turning the heading.
    Also returns the places at the last four of the seconds, for the next block; `past` are those before this block.
    """
    second = np.floor(time)
    knots = np.flatnonzero(np.diff(second, prepend=second[0] - 1 if past is None else past.second))
    before = np.repeat(place[:1], 4, axis=0) if past is None else past.settled
    padded = np.concatenate([before, place[knots]])
    if len(knots):
        settled = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0), axis=-1)
        gamma = convergence(settled[:, 0], settled[:, 1], zone)
    else:
        gamma = np.empty(0)
    held = np.concatenate([[math.nan if past is None else past.gamma], gamma])
    return held[np.searchsorted(knots, np.arange(len(time)), side="right")], padded[-4:]


def _frozen(log: Log, name: str, time, fixes, rows: int, shown: dict) -> tuple[np.ndarray, np.ndarray]:
    """Which fixes (the last `rows`) are frozen, and which rows (n) the next block needs. Adds to `shown`."""
    run = screening.runs(time, fixes)
    geodetic = f"{name}_latitude_deg" in log.table
    grids = []
    for ending in ("latitude_deg", "longitude_deg") if geodetic else ("north_m", "east_m"):
        values = column(log, f"{name}_{ending}")[-rows:]
        grid, shown[f"{name}_{ending}"] = screening.resolution(values, shown.get(f"{name}_{ending}", screening.COARSE))
        grids.append(np.radians(grid) * EARTH if geodetic else grid)
    if geodetic:
        grids[1] = grids[1] * np.cos(np.radians(column(log, f"{name}_latitude_deg")[-rows:]))
    elapsed = time - time[run[0]]
    tail = [part[-rows:] for part in run]
    threshold = STILL * math.sqrt(GRAVITY * log.vessel.length)
    repeats = screening.frozen(elapsed[-rows:], tail, np.column_stack(grids), threshold)
    return repeats, screening.remembered(time, run[0], run[1], np.isfinite(fixes[:, 0]))


def from_log(log: Log) -> Measurements:
    """Measurements of a log. Raises InputError when it has no heading at all, or no fix."""
    begin = opening(log)
    check_opening(log, begin)
    return from_block(log, begin)[0]


def from_block(log: Log, begin: Opening, past: Past | None = None) -> tuple[Measurements, Past]:
    """Measurements of a block of a log that begins as `begin`, and what the next block must know; `past` is what this one must.

    Where two antennas tell the same fix to the last bit it is one fix, the first's.
    """
    n = len(log)
    assert begin.origin is not None  # see check_opening
    if past is not None:
        log = replace(log, table=stacked(past.rows, log.table))  # type: ignore[arg-type]
    time = np.asarray(log.table["time_s"], dtype=float)
    shown = {} if past is None else dict(past.shown)
    needed = np.zeros(len(time), bool)
    needed[-1] = True
    fixes: dict[str, np.ndarray] = {}
    place = np.full((n, 2), np.nan)
    stale, frozen = np.zeros(n, bool), np.ones(n, bool)
    for name in schema.antennas(log.table.columns):
        every, where = _fixes(log, name)
        place = np.where(np.isnan(place), where[-n:], place)
        repeats, keep = _frozen(log, name, time, every, n, shown)
        needed |= keep
        p = every[-n:] - begin.origin
        frozen &= repeats | np.isnan(p[:, 0])
        stale |= repeats
        p[repeats] = np.nan
        for other in fixes.values():
            p[(p == other).all(axis=1)] = np.nan
        fixes[name] = p
    start = begin.place if past is None else past.place
    place = np.column_stack([carried(place[:, axis], start[axis]) for axis in range(2)])
    gamma, settled = np.zeros(n), np.full((4, 2), np.nan)
    if np.isfinite(place[0]).all() and log.zone is not None:
        gamma, settled = grid_convergence(time[-n:], place, log.zone, past)
    values = {}
    for name, period in STICKY.items():
        every = column(log, name)
        run = screening.runs(time, every[:, None], period)
        grid, shown[name] = screening.resolution(every[-n:], shown.get(name, screening.COARSE))
        sticks = screening.stuck((time - time[run[0]])[-n:], [part[-n:] for part in run], grid)
        needed |= screening.remembered(time, run[0], run[1], np.isfinite(every))
        values[name] = np.where(sticks, np.nan, every[-n:])
        if name == "heading_deg":
            # A recorder that repeats the fixes repeats the heading with them; a coarse heading alone may well repeat.
            values[name][frozen & stale & (run[1][-n:] > 0)] = np.nan
        stale |= sticks
    heading = np.radians(values["heading_deg"]) - gamma
    measured = Measurements(
        time=time[-n:],
        origin=begin.origin,
        fixes=fixes,
        heading=heading,
        convergence=gamma,
        yaw_rate=np.radians(values["yaw_rate_deg_s"]),
        acceleration=np.column_stack([values[f"acceleration_{axis}_m_s2"] for axis in ("surge", "sway")]),
        stale=stale,
        stations={name: log.vessel.stations[name] for name in (*fixes, "imu")},
        calibration=log.vessel.calibration,
        first_heading=math.radians(begin.first.get("heading_deg", math.nan)) - float(gamma[0]),
    )
    rows = picked(log.table, needed)
    return measured, Past(rows, shown, place[-1], settled, float(np.floor(time[-1])), float(gamma[-1]))
