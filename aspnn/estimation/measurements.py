"""From a log's columns to measurements in SI and radians on the grid, with stale fixes left out.

Nothing here looks ahead: a value at an epoch depends on the log up to that epoch (and, before the first fix, on the first).
"""

import math
from dataclasses import dataclass

import numpy as np

from aspnn import schema
from aspnn.frames import convergence, to_grid
from aspnn.records import Log
from aspnn.schema import InputError

GRAVITY = 9.81
STILL = 0.01  # Froude number below which a repeated fix may be a ship at rest


@dataclass(frozen=True)
class Measurements:
    """Measurements of a log of n epochs; NaN where a sensor has none.

    `fixes` maps each antenna to north, east (n, 2) [m] from `origin`, `heading` [rad] from grid north, `convergence` [rad],
    `yaw_rate` [rad/s], `acceleration` (n, 2) forward and starboard [m/s2], `stale` (n) whether a fix was left out because
    it repeats its predecessor. `stations` [m] in body axes, of the antennas and `imu`.
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


def column(log: Log, name: str) -> np.ndarray:
    """A column of the log as float64, all NaN where the log has none."""
    table = log.table
    return table[name].to_numpy(dtype=float) if name in table else np.full(len(table), np.nan)


def carried(values: np.ndarray) -> np.ndarray:
    """Each value held until the next known one; those before the first known take the first. All NaN stays NaN."""
    known = np.isfinite(values)
    if not known.any():
        return values
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, np.argmax(known), last)]


def repeated(time, fixes, threshold: float) -> np.ndarray:
    """Which of `fixes` (n, 2) repeat their predecessor to the last bit although the ship moved before they froze.

    It moved when the fixes of the ten seconds before the first of the equal ones tell a speed above `threshold` [m/s].
    """
    stale = np.zeros(len(time), bool)
    rows = np.flatnonzero(np.isfinite(fixes).all(axis=1))
    if len(rows) < 3:
        return stale
    t, p = time[rows], fixes[rows]
    same = np.concatenate([[False], (p[1:] == p[:-1]).all(axis=1)])
    begin = np.maximum.accumulate(np.where(same, 0, np.arange(len(rows))))  # the first of each run of equal fixes
    before = np.minimum(np.searchsorted(t, t[begin] - 10.0), np.maximum(begin - 1, 0))
    moved = np.hypot(*(p[begin] - p[before]).T) > threshold * (t[begin] - t[before])
    stale[rows] = same & moved & (begin > 0)
    return stale


def grid_convergence(time, latitude, longitude, zone) -> np.ndarray:
    """Grid convergence [rad] at every epoch: afresh each second (E15) from the median of the last five, then held.

    `latitude`, `longitude` [rad] are carried over gaps. The median keeps a wild fix from turning the heading.
    """
    second = np.floor(time)
    knots = np.flatnonzero(np.diff(second, prepend=second[0] - 1))

    def settled(values):
        padded = np.concatenate([np.repeat(values[knots[0]], 4), values[knots]])
        return np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)

    gamma = convergence(settled(latitude), settled(longitude), zone)
    return gamma[np.searchsorted(knots, np.arange(len(time)), side="right") - 1]


def from_log(log: Log) -> Measurements:
    """Measurements of a log. Raises InputError when it has no heading at all, or no fix."""
    where = log.path or "log"
    time = column(log, "time_s")
    names = schema.antennas(log.table.columns)
    fixes: dict[str, np.ndarray] = {}
    latitude, longitude = np.full(len(time), np.nan), np.full(len(time), np.nan)
    for name in names:
        if f"{name}_latitude_deg" in log.table and log.zone is not None:
            phi = np.radians(column(log, f"{name}_latitude_deg"))
            lam = np.radians(column(log, f"{name}_longitude_deg"))
            latitude, longitude = (
                np.where(np.isnan(latitude), phi, latitude),
                np.where(np.isnan(longitude), lam, longitude),
            )
            fixes[name] = np.column_stack(to_grid(phi, lam, log.zone))
        else:
            fixes[name] = np.column_stack([column(log, f"{name}_north_m"), column(log, f"{name}_east_m")])
        fixes[name][np.isnan(fixes[name]).any(axis=1)] = np.nan
    known = {name: np.flatnonzero(np.isfinite(p[:, 0])) for name, p in fixes.items()}
    first = min(((rows[0], name) for name, rows in known.items() if len(rows)), default=None)
    if first is None:
        raise InputError(f"{where}: no antenna has any position; fill NAME_latitude_deg and NAME_longitude_deg")
    heading = np.radians(column(log, "heading_deg"))
    if not np.isfinite(heading).any():
        raise InputError(f"{where}: column heading_deg has no value; the filter needs a heading")
    origin = np.floor(fixes[first[1]][first[0]])
    gamma = np.zeros(len(time))
    if np.isfinite(latitude).any() and log.zone is not None:
        gamma = grid_convergence(time, carried(latitude), carried(longitude), log.zone)
    stale, frozen = np.zeros(len(time), bool), np.ones(len(time), bool)
    for p in fixes.values():
        repeats = repeated(time, p, STILL * math.sqrt(GRAVITY * log.vessel.length))
        frozen &= repeats | np.isnan(p[:, 0])
        stale |= repeats
        p[repeats] = np.nan
        p -= origin
    # A recorder that repeats the fixes repeats the heading with them; a coarse heading alone may well repeat.
    heading[stale & frozen & (np.diff(heading, prepend=np.nan) == 0)] = np.nan
    return Measurements(
        time=time,
        origin=origin,
        fixes=fixes,
        heading=heading - gamma,
        convergence=gamma,
        yaw_rate=np.radians(column(log, "yaw_rate_deg_s")),
        acceleration=np.column_stack([column(log, f"acceleration_{axis}_m_s2") for axis in ("surge", "sway")]),
        stale=stale,
        stations={name: log.vessel.stations[name] for name in (*names, "imu")},
    )
