"""Receivers that disagree: two antennas against the ship's own dimensions, two compasses against each other.

The vector between two antennas is known from their stations and the heading; what the fixes say else is an error of one of them (a
jump, spoofing, a wrong station), and which, two alone cannot tell. FIRST rows in a row make a disagreement, LAST rows end it.
"""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

from aspnn.angles import difference
from aspnn.vessel import Vessel

FIRST, LAST = 5, 10  # rows that begin and end a disagreement
LEAST = 10.0  # m: what two receivers without corrections may well differ by
SIGMAS = 6.0  # standard deviations of the difference of two fixes
HEADING = 5.0  # deg: two gyros, or a gyro and a satellite compass, differ by less in a seaway
FRESH = 1.0  # s: how old the heading may be that the antennas are compared with
SILENT = 10.0  # s after which a compass that is not heard is not compared any more
MOST = 16  # compasses that are compared at once
EARTH = 6371e3  # m, mean radius


class Disagreement(NamedTuple):
    """Since when [s, UNIX], and what."""

    since: float
    text: str


@dataclass
class _Pair:
    """How often two have disagreed in a row, and agreed since."""

    bad: int = 0
    good: int = 0
    since: float = 0.0


class Receivers:
    """Holds the rows of a ship against each other; `disagree` is what does now."""

    def __init__(self, vessel: Vessel, antennas: tuple[str, ...]):
        self.disagree: dict[str, Disagreement] = {}
        self._stations = {name: vessel.stations[name] for name in antennas}
        self._limit = max(LEAST, SIGMAS * math.sqrt(2) * vessel.noise.position)
        self._pairs: dict[str, _Pair] = {}
        self._heading: tuple[float, float] = (-math.inf, math.nan)
        self._others: dict[str, tuple[float, float]] = {}
        self._compared: dict[str, float] = {}  # the time [s] of the last heading of each that was

    def other_heading(self, identity: str, time: float, heading: float) -> None:
        """Remember the heading [deg] of a compass that is not the chosen one."""
        if identity not in self._others and len(self._others) >= MOST:
            self._forget(time)
        if identity in self._others or len(self._others) < MOST:
            self._others[identity] = time, heading

    def _forget(self, time: float) -> list[tuple[str, str]]:
        """Leave out compasses that are silent; one that disagreed does so no more."""
        said = []
        for identity in [name for name, (at, _) in self._others.items() if time - at > SILENT]:
            del self._others[identity]
            self._compared.pop(identity, None)
            self._pairs.pop(f"heading {identity}", None)
            if self.disagree.pop(f"heading {identity}", None) is not None:
                said.append(("agree", f"heading {identity} is silent"))
        return said

    def compare(self, time: float, row: dict[str, float]) -> list[tuple[str, str]]:
        """Compare what a row tells; returns what began or ended, code and text."""
        said = self._forget(time)
        if "heading_deg" in row:
            self._heading = time, row["heading_deg"]
            for identity, (at, heading) in self._others.items():
                if abs(time - at) <= FRESH and at != self._compared.get(identity):
                    self._compared[identity] = at
                    apart = abs(
                        math.degrees(float(difference(math.radians(heading), math.radians(row["heading_deg"]))))
                    )
                    said += self._judge(
                        f"heading {identity}", apart > HEADING, time, f"headings differ: {identity} by {apart:.1f} deg"
                    )
        told = [name for name in self._stations if f"{name}_latitude_deg" in row and f"{name}_longitude_deg" in row]
        for a, b in combinations(told, 2):
            off = self._off(a, b, time, row)
            said += self._judge(
                f"{a} {b}",
                off > self._limit,
                time,
                f"antennas {a} and {b} are {off:.0f} m from where they stand on the ship",
            )
        return said

    def _off(self, a: str, b: str, time: float, row: dict[str, float]) -> float:
        """How far [m] the vector from antenna a to b is from that of the stations; without a fresh heading, its length alone."""
        latitude = math.radians((row[f"{a}_latitude_deg"] + row[f"{b}_latitude_deg"]) / 2)
        north = math.radians(row[f"{b}_latitude_deg"] - row[f"{a}_latitude_deg"]) * EARTH
        turn = float(difference(math.radians(row[f"{b}_longitude_deg"]), math.radians(row[f"{a}_longitude_deg"])))
        told = complex(north, turn * EARTH * math.cos(latitude))
        ship = complex(*self._stations[b]) - complex(*self._stations[a])
        at, heading = self._heading
        if time - at > FRESH:
            return abs(abs(told) - abs(ship))
        angle = math.radians(heading)
        return abs(told - ship * complex(math.cos(angle), math.sin(angle)))

    def _judge(self, key: str, bad: bool, time: float, text: str) -> list[tuple[str, str]]:
        pair = self._pairs.setdefault(key, _Pair())
        if bad:
            pair.since = time if pair.bad == 0 else pair.since
            pair.bad, pair.good = pair.bad + 1, 0
            if pair.bad >= FIRST:
                new = key not in self.disagree
                self.disagree[key] = Disagreement(pair.since, text)
                return [("disagree", text)] if new else []
            return []
        pair.good += 1
        if pair.good >= LAST or key not in self.disagree:
            pair.bad = 0
            if self.disagree.pop(key, None) is not None:
                return [("agree", f"{key} agree again")]
        return []
