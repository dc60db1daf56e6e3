"""A log as the AIS sentences that the ship's transponder of class A would have sent; `ais.import_ais` reads them back.

Position reports (message 1) at the intervals of ITU-R M.1371 (its table as makers reproduce it): 10 s below 14 knots, 6 s below 23
and 2 s above, 3 1/3 s and 2 s while the course changes, 3 minutes below 3 knots at anchor. The course changes (recalled from its
annex 2) from when the heading is more than 5 degrees off its mean of the last 30 s until 20 s after it last was. A report
tells the fix of the last whole second, as a receiver of 1 Hz has it. Static data (message 5) go out first and every 6 minutes.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aspnn import schema
from aspnn.angles import difference
from aspnn.logs.ais_messages import ROT, codec, is_ship
from aspnn.logs.readings import KNOT
from aspnn.logs.recording import unix
from aspnn.logs.sentences import encode_tag
from aspnn.records import Log, atomic
from aspnn.schema import InputError

BENT, MEAN, STEADY = math.radians(5.0), 30.0, 20.0  # rad, s, s
INTERVALS = ((14.0, 10.0, 10 / 3), (23.0, 6.0, 2.0), (math.inf, 2.0, 2.0))  # below [kn]: on a course, changing it [s]
STATIC = 360.0  # s
FRESH = 1.5  # s: a value of the log that is older at a report is not told
NOT_TOLD = {"lat": 91.0, "lon": 181.0, "speed": 102.3, "course": 360.0, "heading": 511, "turn": -128}
ACCURATE = 10 / 2.45  # m: deviation per axis of fixes that lie within 10 m in 95 % of cases
STATION = "aspnn"


def write_ais(log: Log, path: str | Path, mmsi: int, name: str = "") -> Path:
    """Write the log's sentences (`to_ais`) to `path`, whole or not at all. Raises InputError."""
    with atomic(path) as temporary, open(temporary, "w", encoding="ascii", newline="") as file:
        file.writelines(to_ais(log, mmsi, name))
    return Path(path)


def to_ais(log: Log, mmsi: int, name: str = "") -> Iterator[str]:
    """The log as !AIVDM lines in the order of time, with a TAG block that tells when each was sent, and line ends.

    Of the first antenna; `name` is the ship's (its vessel's where empty). What the log does not tell within FRESH is sent as unavailable.
    Raises InputError where the log has no start, no latitudes, or no column that steering shows in.
    """
    pyais = codec()
    where, antenna = log.path or log.voyage or "log", schema.antennas(log.table.columns)[0]
    if not log.start or f"{antenna}_latitude_deg" not in log.table:
        raise InputError(f"{where}: AIS needs the start of the log in UTC, and latitudes")
    if not is_ship(mmsi):
        raise InputError(f"MMSI {mmsi} is no ship's; nine digits that begin with 2 to 7 are")
    start, time = unix(log.start), log.table["time_s"].to_numpy(float)
    columns = {str(c): log.table[c].to_numpy(float) for c in log.table.columns}
    due, static = float(time[0]), -math.inf
    bends = _bends(time, columns)
    while due <= time[-1]:
        tag = encode_tag(STATION, start + due)
        if due - static >= STATIC:
            static = due
            said = _static(log, antenna, mmsi, name or log.vessel.name)
            for sentence in pyais.encode_dict(said, sentence_type="VDM", seq_id=1):
                yield f"{tag}{sentence}\r\n"
        # The last fix at a whole second of UTC, or before.
        second = math.floor(start + due + 1e-6) - start
        said = _report(columns, time, max(second, float(time[0])), antenna, mmsi)
        said |= {"second": round(second + start) % 60, "accuracy": log.vessel.noise.position <= ACCURATE}
        yield f"{tag}{pyais.encode_dict(said, sentence_type='VDM')[0]}\r\n"
        due = _next(due, said["speed"], time, bends)


def _next(due: float, speed: float, time: np.ndarray, bends: np.ndarray) -> float:
    """When the report after that at `due` [s] goes out, at `speed` [kn] (102.3: not told): sooner once the course changes."""
    most = speed if speed < NOT_TOLD["speed"] else 0.0
    steady, turning = next((a, b) for limit, a, b in INTERVALS if most <= limit)
    inside = slice(np.searchsorted(time, due, side="right") - 1, np.searchsorted(time, due + steady))
    if not bends[inside].any():
        return due + steady
    return max(due + turning, float(time[inside][np.argmax(bends[inside])]))


def _bends(time: np.ndarray, columns: dict[str, np.ndarray]) -> np.ndarray:
    """Whether the course changes (n), from the heading, else from the course over ground; never where neither is told."""
    bearing = next((columns[c] for c in ("heading_deg", "course_over_ground_deg") if c in columns), None)
    bent = np.zeros(len(time), bool)
    if bearing is None:
        return bent
    known = np.flatnonzero(np.isfinite(bearing))
    at, wave = time[known], np.exp(1j * np.radians(bearing[known]))
    total = np.concatenate([[0], np.cumsum(wave)])
    mean = total[1:] - total[np.searchsorted(at, at - MEAN)]
    off = at[np.abs(difference(np.angle(wave), np.angle(mean))) > BENT]
    last = np.searchsorted(off, time, side="right") - 1
    bent[last >= 0] = (time - off[np.maximum(last, 0)])[last >= 0] <= STEADY if len(off) else False
    return bent


def _report(columns: dict[str, np.ndarray], time: np.ndarray, at: float, antenna: str, mmsi: int) -> dict[str, Any]:
    """Message 1 with what the log tells at `at` [s], or shortly before."""

    def told(name: str) -> float:
        if name not in columns:
            return math.nan
        rows = np.arange(np.searchsorted(time, at - FRESH), np.searchsorted(time, at + 1e-6, side="right"))
        rows = rows[np.isfinite(columns[name][rows])]
        return float(columns[name][rows[-1]]) if len(rows) else math.nan

    latitude, longitude = (told(f"{antenna}_{axis}_deg") for axis in ("latitude", "longitude"))
    speed, course = told("speed_over_ground_m_s") / KNOT, told("course_over_ground_deg")
    heading, rate = told("heading_deg"), told("yaw_rate_deg_s") * 60
    said: dict[str, Any] = {"type": 1, "mmsi": mmsi, "status": 0} | NOT_TOLD
    if math.isfinite(latitude + longitude):
        said |= {"lat": latitude, "lon": (longitude + 180) % 360 - 180}
    if math.isfinite(speed):
        said["speed"] = min(round(speed, 1), 102.2)
    if math.isfinite(course):
        said["course"] = round(course * 10) % 3600 / 10
    if math.isfinite(heading):
        said["heading"] = round(heading) % 360
    if math.isfinite(rate):
        code = min(round(ROT * math.sqrt(abs(rate))), 126)
        said["turn"] = math.copysign((code / ROT) ** 2, rate)  # never the 127 that pyais takes for a code
    return said


def _static(log: Log, antenna: str, mmsi: int, name: str) -> dict[str, Any]:
    """Message 5: the metres from the antenna to bow, stern, port and starboard, whole and at least as their fields hold."""
    ship = log.vessel
    x, y = ship.stations[antenna]
    sides = (ship.length / 2 - x, ship.length / 2 + x, ship.beam / 2 + y, ship.beam / 2 - y)
    most = (511, 511, 63, 63)
    size = [min(max(round(side), 0), top) for side, top in zip(sides, most, strict=True)]
    named = dict(zip(("to_bow", "to_stern", "to_port", "to_starboard"), size, strict=True))
    draught = min(round(ship.draught, 1), 25.5)
    return {"type": 5, "mmsi": mmsi, "shipname": name.upper()[:20], "draught": draught, **named}
