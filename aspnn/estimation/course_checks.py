"""What a log of positions must keep so that a course can be told from them: fixes of one ship that moves its receiver's numbers."""

import numpy as np

from aspnn import schema
from aspnn.estimation.course_engine import FEWEST
from aspnn.estimation.measurements import column
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Vessel

FASTER = 4.0  # times the service speed: no ship goes so fast
APART = 3.0, 20.0  # ship lengths and deviations of a fix: nearer tracks may be one ship's
SWITCHES = 4  # from one track to the other and back: a receiver may jump once and return, two ships take turns
TRACKS = 8  # that are followed at once
BEFORE = 50  # fixes before the first jump, which belong to the first track
LEAST = 0.2  # of the fixes is the smaller share of two ships; wild fixes are fewer, and here and there


def antenna_of(log: Log) -> str:
    """The antenna whose fixes tell the course: of those with nine tenths of the most fixes, the one nearest to midship."""
    names = schema.antennas(log.table.columns)
    ending = {
        n: ("latitude_deg", "longitude_deg") if f"{n}_latitude_deg" in log.table else ("north_m", "east_m")
        for n in names
    }
    many = {n: int(np.isfinite(sum(column(log, f"{n}_{e}") for e in ending[n])).sum()) for n in names}
    most = max(many.values())
    return min((n for n in names if many[n] >= 0.9 * most), key=lambda n: float(np.hypot(*log.vessel.stations[n][:2])))


def check_fixes(time: np.ndarray, fixes: np.ndarray, vessel: Vessel, antenna: str, where: str) -> None:
    """Raise InputError where fixes (n, 2) [m] are too few, all the same, or those of two ships, naming row, time and remedy."""
    rows = np.flatnonzero(np.isfinite(fixes).all(axis=1))
    if len(rows) < FEWEST:
        raise InputError(
            f"{where}: antenna {antenna} has {len(rows)} fixes; a course needs at least {FEWEST}; record on, or name another antenna"
        )
    t, place = time[rows], fixes[rows, 0] + 1j * fixes[rows, 1]
    new = np.concatenate([[True], np.diff(place) != 0])
    if new.sum() < FEWEST:
        row = int(rows[np.flatnonzero(new)[-1]])
        raise InputError(
            f"{where}: row {row} (time {time[row]:g} s): antenna {antenna} repeats its position to the end of the log, {len(rows)} fixes in "
            f"all: the receiver froze; use another antenna, or a part of the log in which its positions change"
        )
    rows, t, place = rows[new], t[new], place[new]
    found = _two_tracks(
        t, place, FASTER * vessel.service_speed, APART[0] * vessel.length + APART[1] * vessel.noise.position
    )
    if found is not None:
        k, away, counts = found
        raise InputError(
            f"{where}: row {rows[k]} (time {t[k]:g} s): antenna {antenna} goes to and fro between two tracks {away:.0f} m apart, of "
            f"{counts[0]} and {counts[1]} fixes: two vessels in one file; split it by vessel, one log each"
        )


def _two_tracks(
    time: np.ndarray, place: np.ndarray, fastest: float, apart: float
) -> tuple[int, float, tuple[int, int]] | None:
    """Where fixes (n, complex) begin to change between two tracks that no ship can change between: index, distance, fixes of each.

    A fix goes on the nearest track that a ship at `fastest` [m/s] can have followed to it, or begins one.
    """
    jumps = np.abs(np.diff(place)) > apart + fastest * np.diff(time)
    if jumps.sum() < SWITCHES:
        return None
    tracks: list[list[int]] = []  # of each the last fix, how many there were, and the first
    order: list[list[int]] = []  # the tracks in turn
    for k in range(max(int(np.argmax(jumps)) - BEFORE, 0), len(place)):
        away = [abs(place[k] - place[track[0]]) for track in tracks]
        fits = [d <= apart + fastest * (time[k] - time[track[0]]) for d, track in zip(away, tracks, strict=True)]
        if any(fits):
            on = tracks[min((d, j) for j, (d, fit) in enumerate(zip(away, fits, strict=True)) if fit)[1]]
            on[0], on[1] = k, on[1] + 1
        else:
            on = [k, 1, k]
            tracks = [*sorted(tracks)[1 - TRACKS :], on]  # the one that has been silent longest makes room
        if not order or order[-1] is not on:
            order = [*order[-SWITCHES:], on]
        pair = order[:2]
        if len(order) <= SWITCHES or any(track is not pair[j % 2] for j, track in enumerate(order)):
            continue
        if min(track[1] for track in pair) >= LEAST * sum(track[1] for track in tracks):
            first = max(track[2] for track in pair)
            return first, float(abs(place[first] - place[first - 1])), (pair[0][1], pair[1][1])
    return None
