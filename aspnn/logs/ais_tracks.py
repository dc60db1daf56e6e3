"""Which reports under one MMSI are one ship's: copies, the order of time, two ships that share a number, fixes that freeze."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from aspnn.logs.ais_messages import Report

EARTH = 6371e3  # m, mean radius
COPY = 2.0  # s: reports without a second that are alike within this are one, heard twice; no ship reports more often
FASTEST = 45.0  # m/s, over gaps in which a ship may have sailed as it liked
SLACK, MARGIN = (
    300.0,
    5.0,
)  # m, m/s: what errors of fixes and clocks, and a change of speed, may add to the way of a ship
RECENT = 200.0  # s: longer than the longest interval between reports (3 minutes at anchor)
FEW = 3  # fixes that make a ship; fewer are stray
RETURNS = 3  # changes from one ship to the other that cannot be a jump, or a spell of wrong fixes
SHIPS, PLACES = 4, 30  # more ships, or places, under one number are noise
UNCLEAR = 0.01  # share of fixes that may be of either ship
REPEATS, WAY = 3, 50.0  # fixes alike and the way [m] that the ship's own speed tells over them: frozen


class Heard(NamedTuple):
    """A report, the `time` [s] at which it was true, where it stands (`file` by its number, `line`), and whether it is one's own."""

    report: Report
    time: float
    file: int
    line: int
    own: bool


@dataclass
class Track:
    """The reports of one ship in the order of time, and what was noted of them."""

    heard: list[Heard]
    notes: dict[str, Any] = field(default_factory=dict)

    def column(self, name: str) -> np.ndarray:
        """A number of every report (n)."""
        return np.array([getattr(h.report, name) for h in self.heard], float)

    @property
    def time(self) -> np.ndarray:
        """Times [s] (n)."""
        return np.array([h.time for h in self.heard])


class Mixed(ValueError):
    """Fixes under one MMSI that no ship can have, and that cannot be told apart."""


def in_order(heard: Sequence[Heard]) -> Track:
    """The reports sorted by time, and copies, which several stations have heard, left out."""
    times = np.array([h.time for h in heard])
    notes = {"out_of_order": int(np.sum(times < np.maximum.accumulate(times))), "copies_dropped": 0}
    kept: list[Heard] = []
    seen: dict[tuple, float] = {}
    for i in np.argsort(times, kind="stable"):
        h = heard[i]
        within = 0.0 if h.report.second == h.report.second else COPY
        if h.time - seen.get(h.report.told, -np.inf) <= within:
            notes["copies_dropped"] += 1
        else:
            kept.append(h)
        seen[h.report.told] = h.time
    return Track(kept, {key: count for key, count in notes.items() if count})


def one_at_a_time(track: Track) -> Track:
    """The track with the first of what one ship reported at one time, which is a row of its log."""
    time = track.time
    first = np.diff(time, prepend=-np.inf) > 0
    notes = track.notes | ({"others_at_same_time_dropped": int(np.sum(~first))} if not first.all() else {})
    return Track([h for h, kept in zip(track.heard, first, strict=True) if kept], notes)


def ships(track: Track, files: Sequence[str]) -> list[Track]:
    """The ships whose fixes a track holds: itself, without stray fixes, or one track per ship where two or more share the MMSI.

    A fix belongs to the nearest of the ships that can have reached it: by SLACK, and by half more than the speed that it reports, or
    by FASTEST over a longer silence. What none can have reached is another ship; where the positions go to and fro between two it is one
    indeed, else a jump of the receiver, which stays and is noted. Raises Mixed where too many fixes can be of either.
    """
    place, time = _places(track), track.time
    fixes = np.flatnonzero(np.isfinite(place[:, 0]))
    speed = track.column("speed_m_s")
    last: list[int] = []  # the last fix of every ship
    whose = np.full(len(time), -1)
    either: list[list[int]] = []  # ships that a fix may be of, where there is more than one
    for i in fixes.tolist():
        away = [float(np.linalg.norm(place[i] - place[j])) for j in last]
        near = [k for k, j in enumerate(last) if away[k] <= _reach(time[i] - time[j], speed[j], speed[i])]
        if not near:
            whose[i], last = len(last), [*last, i]
            if len(last) > PLACES:
                raise Mixed(
                    f"fixes at more than {PLACES} places between which no ship gets; {_where(track.heard[i], files)}"
                )
            continue
        best = min(near, key=away.__getitem__)
        fresh = [k for k in near if time[i] - time[last[k]] <= RECENT and away[k] < 3 * away[best] + SLACK]
        either += [fresh] if len(fresh) > 1 else []
        whose[i], last[best] = best, i
    counts = np.bincount(whose[fixes], minlength=1)
    many = np.flatnonzero(counts >= min(FEW, counts.max()))
    stray = fixes[~np.isin(whose[fixes], many)]
    sequence = [int(w) for w in whose[fixes] if w in many]
    turns = [i for i, (a, b) in enumerate(pairwise(sequence)) if a != b]
    notes = dict(track.notes)
    if len(stray):
        notes["stray_fixes_dropped"] = f"{len(stray)}, first {_where(track.heard[stray[0]], files)}"
    if len(stray) > max(FEW, 0.2 * len(fixes)) or len(many) > SHIPS:
        first = stray[0] if len(stray) else fixes[0]
        raise Mixed(
            f"{len(stray)} of {len(fixes)} fixes lie where no ship gets; first {_where(track.heard[first], files)}"
        )
    strays = set(stray.tolist())
    kept = [h for i, h in enumerate(track.heard) if i not in strays]
    if not turns:
        return [Track(kept, notes)]
    known = fixes[np.isin(whose[fixes], many)]
    a, b = known[turns[0]], known[turns[0] + 1]
    far, apart = float(np.linalg.norm(place[b] - place[a])), time[b] - time[a]
    jump = f"{far / 1000:.4g} km in {apart:.4g} s, {_where(track.heard[b], files)}"
    if len(turns) < RETURNS:
        notes["jumps"] = f"{len(turns)}, first {jump}"
        return [Track(kept, notes)]
    unclear = sum(len(set(ones) & set(many.tolist())) > 1 for ones in either)
    if unclear > UNCLEAR * len(fixes):
        raise Mixed(
            f"positions jump to and fro {len(turns)} times ({jump}), and {unclear} of {len(fixes)} can be of either ship"
        )
    parts = []
    for number in many:
        inside = [h for i, h in enumerate(track.heard) if whose[i] == number]
        parts.append(Track(inside, notes | {"shares_mmsi": f"{len(many)} ships, told apart by place; first {jump}"}))
    return parts


def _reach(elapsed: float, before: float, after: float) -> float:
    """How far [m] a ship may be after `elapsed` [s] from where it was, by the speeds [m/s] that it told then and tells now."""
    fastest = np.fmax(before, after)
    if elapsed > RECENT or np.isnan(fastest):
        return SLACK + FASTEST * elapsed
    return SLACK + (1.5 * float(fastest) + MARGIN) * elapsed


def _places(track: Track) -> np.ndarray:
    """Fixes (n, 3) [m] from the middle of the Earth, whose chords are distances wherever they are; NaN where there is none."""
    latitude, longitude = np.radians(track.column("latitude_deg")), np.radians(track.column("longitude_deg"))
    level = np.cos(latitude)
    return EARTH * np.column_stack([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)])


def _where(heard: Heard, files: Sequence[str]) -> str:
    return f"{files[heard.file]} line {heard.line}"


def frozen(track: Track, files: Sequence[str]) -> tuple[np.ndarray, dict[str, str]]:
    """Which fixes (n) only repeat the one before while the ship's own speed says that it moves, and a note on them."""
    place = np.column_stack([track.column("latitude_deg"), track.column("longitude_deg")])
    time, speed = track.time, np.nan_to_num(track.column("speed_m_s"))
    bad = np.zeros(len(time), bool)
    fixes = np.flatnonzero(np.isfinite(place[:, 0]))
    starts = np.flatnonzero(np.any(np.diff(place[fixes], axis=0, prepend=np.inf), axis=1))
    for first, end in zip(starts, [*starts[1:], len(fixes)], strict=True):
        run = fixes[first:end]
        if len(run) >= REPEATS and np.sum(np.diff(time[run]) * speed[run][1:]) > WAY:
            bad[run[1:]] = True
    if not bad.any():
        return bad, {}
    where = _where(track.heard[int(np.argmax(bad))], files)
    return bad, {"frozen_fixes_dropped": f"{int(bad.sum())}, first {where}"}
