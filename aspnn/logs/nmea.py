"""Recorded NMEA 0183 sentences into canonical logs (nmea_write.py goes the other way).

Several GNSS receivers, gyros and rudder indicators on one line are told apart by the source of their TAG block, else by
their talker. Rows stand at the epochs of the fixes and at the times of the other sensors (recording.py says which those
are); what a sensor does not say at a row is NaN.
"""

from collections import Counter, defaultdict
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from aspnn import schema
from aspnn.checks import check_log
from aspnn.config import read_toml
from aspnn.frames import Zone
from aspnn.logs.derived import with_rudder_orders
from aspnn.logs.maps import Map, Strict, mapped_vessel, source_files
from aspnn.logs.readings import ACCELERATIONS
from aspnn.logs.recording import TOGETHER, Recording, clock, read_recording, unix
from aspnn.logs.sentences import Fault, Sentence
from aspnn.records import Log, sha256
from aspnn.schema import InputError
from aspnn.vessel import from_dict

ENDINGS = (".nmea", ".nmea0183", ".0183", ".log", ".txt")
WIND_AGE = 2.0  # s: how old the heading may be that turns the wind from the bow to north
NAMES = ("latitude_deg", "longitude_deg", "height_m")
# What may tell a quantity, the preferred first: THS has a validity flag, RMC a time of its own.
POSITION = tuple((formatter, NAMES) for formatter in ("GGA", "GNS", "RMC"))
QUANTITIES: dict[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "heading": (("THS", ("heading_deg",)), ("HDT", ("heading_deg",))),
    "yaw_rate": (("ROT", ("yaw_rate_deg_s",)),),
    "rudder": (("RSA", ("rudder_angle_deg",)), ("RSA", ("rudder_angle_port_deg",))),
    "rudder_order": (("ROR", ("rudder_order_deg",)), ("ROR", ("rudder_order_port_deg",))),
    "course": tuple((formatter, ("course_over_ground_deg", "speed_over_ground_m_s")) for formatter in ("RMC", "VTG")),
    "wind": (("MWV", ("wind_speed_true_m_s", "wind_angle_true_deg")),),
    "shaft": (("RPM", ("shaft_speed_rps",)), ("RPM", ("engine_speed_rps",))),
    "propeller_pitch": (("RPM", ("propeller_pitch_percent",)),),
    "engine_order": (("PRC", ("engine_order_rps",)),),
    "attitude": (("XDR", ("roll_deg", "pitch_deg")),),
    "acceleration": (("XDR", tuple(ACCELERATIONS.values())),),
    "speed_log": tuple((formatter, ("speed_through_water_m_s",)) for formatter in ("VBW", "VHW")),
    "depth": (("DPT", ("depth_m",)),),
}
RENAMED = {
    "rudder_angle_port_deg": "rudder_angle_deg",
    "rudder_order_port_deg": "rudder_order_deg",
    "engine_speed_rps": "shaft_speed_rps",
}


class Antenna(Strict):
    """A GNSS receiver: who sends its sentences (a talker, or the source of a TAG block), and where its antenna stands."""

    source: str = Field(min_length=1)
    station_m: tuple[float, float]


class Chosen(Strict):
    """Which source tells a quantity where several do; else the one heard most. `shaft` is S0, S1, ..., or an engine, E0,
    E1, ... (only where it turns the shaft without a gear)."""

    heading: str | None = None
    yaw_rate: str | None = None
    rudder: str | None = None
    rudder_order: str | None = None
    course: str | None = None
    wind: str | None = None
    shaft: str | None = Field(default=None, pattern=r"^[SE]\d\d?$")
    propeller_pitch: str | None = None
    engine_order: str | None = None
    attitude: str | None = None
    acceleration: str | None = None
    speed_log: str | None = None
    depth: str | None = None


class NmeaMap(Map):
    """A map of a ship's sentences. `start` gives the day where no sentence does. `scale` multiplies columns (-1: sensor
    mounted the wrong way). `period_s` thins every sensor to one value per period. `simulator` takes data so flagged.
    `full_pitch_ratio` is the pitch ratio that RPM calls 100 %; without it no propeller pitch is taken."""

    zone: str
    antennas: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9]*$")], Antenna] = Field(min_length=1)
    sensors: Chosen = Chosen()
    scale: dict[str, float] = Field(default_factory=dict)
    period_s: float | None = Field(default=None, gt=0)
    simulator: bool = False
    full_pitch_ratio: float | None = Field(default=None, gt=0)


def import_nmea0183(sources: Sequence[str | Path], map: str | Path, vessel: str | None = None) -> list[Log]:
    """Logs of recorded sentence files (folders are searched through), one per file, by a map (data/maps holds an example).

    Rows stand at the epochs of the fixes, and at the times of other sensors where those differ by half a millisecond.
    `notes` hold the counts of good and bad sentences and who told what; `vessel` takes the place of the map's. Raises
    InputError naming file, line or key.
    """
    plan = read_toml(map, NmeaMap, **({} if vessel is None else {"vessel": vessel}))
    for column in plan.scale:
        if not any(c.matches(column) for c in schema.LOG):
            raise InputError(f"{map}: scale.{column}: is not a column of a log (data/README.md lists them)")
    return [_log(file, name, plan, map, vessel) for name, file in source_files(sources, ENDINGS).items()]


def _log(file: Path, name: str, plan: NmeaMap, map: str | Path, vessel: str | None) -> Log:
    recording = read_recording(file, plan.simulator)
    if not any(recording.taken):
        raise InputError(f"{file}: holds no good sentence; {recording.first_bad or 'it is empty'}")
    try:
        start = unix(plan.start) if plan.start else None
    except ValueError:
        raise InputError(
            f"{map}: start: {plan.start!r} is no time in UTC; write it such as 2025-06-01T12:00:00Z"
        ) from None
    time, dated, ahead = clock(recording, start)
    placed = np.array(recording.taken) & np.isfinite(time)
    if not placed.any():
        raise InputError(
            f"{file}: no sentence tells the time (GGA, GNS, RMC, ZDA with UTC), nor the logger; record one"
        )
    chosen = _choose(recording, placed, plan, map, file)
    good = [(t, s) for t, s, known in zip(time, recording.sentences, placed, strict=True) if known]
    ship = mapped_vessel(plan, map, vessel).with_stations(**{n: a.station_m for n, a in plan.antennas.items()})
    ship = from_dict(ship.to_dict(), str(map))  # as it will be read again: stations that cannot be are refused here
    table, first, twice = _table(_series(good, chosen, plan), plan.antennas)
    for column, factor in plan.scale.items():
        if column in table:
            table[column] *= factor
    notes: dict[str, Any] = {"name": name, **_counts(recording, placed)}
    notes["told_by"] = {what: " ".join(filter(None, key)) for what, (key, _) in chosen.items()}
    if twice:
        notes["values_dropped_at_same_time"] = twice
    if ahead:
        notes["logger_clock_ahead_s"] = round(ahead, 3)
    table, derived = with_rudder_orders(table, ship.rudder_rate)
    log = Log(
        table=table,
        vessel=ship,
        zone=Zone.parse(plan.zone),
        start=_iso(first) if dated else "",
        source=f"{file.name}, NMEA 0183, SHA-256 {sha256(file)}",
        voyage=plan.voyage or name,
        notes=notes | derived,
    )
    check_log(log, str(file))
    return log


def _counts(recording: Recording, placed: np.ndarray) -> dict[str, Any]:
    """What a recording holds, in numbers: good and bad add up to the sentences (pieces of lines, where some are merged)."""
    good = [s for s, known in zip(recording.sentences, placed, strict=True) if known]
    faults = recording.faults + Counter({Fault.no_time: sum(recording.taken) - len(good)})
    counts: dict[str, Any] = {
        "lines": recording.lines,
        "sentences": recording.pieces,
        "good": len(good),
        "bad": {fault.value: faults[fault] for fault in Fault if faults[fault]},
        "heard": dict(sorted(Counter(f"{s.identity} {s.formatter}" for s in good).items())),
    }
    if recording.first_bad:
        counts["first_bad"] = recording.first_bad
    if relative := sum("wind_speed_relative_m_s" in s.reading.values for s in good):
        counts["relative_wind_not_converted"] = relative
    return counts


Key = tuple[str, str, str]  # identity, formatter, device


def _choose(
    recording: Recording, placed: np.ndarray, plan: NmeaMap, map: str | Path, file: Path
) -> dict[str, tuple[Key, tuple[str, ...]]]:
    """Which sentences, and which of their values, tell each antenna's position and each quantity.

    Of a source's own, the preferred of those sent about as often: one that is often flagged as invalid is still it.
    """
    heard = Counter(s.kind for s in recording.sentences)
    valued: Counter[tuple[Key, str]] = Counter()
    talkers: dict[str, set[str]] = defaultdict(set)
    for s, good in zip(recording.sentences, placed, strict=True):
        if good:
            talkers[s.talker].add(s.identity)
            valued.update((s.kind, value) for value in s.reading.values)

    def best(channels, wanted: str | None, what: str) -> tuple[Key, tuple[str, ...]] | None:
        found = [
            (key, names)
            for formatter, names in channels
            for key in sorted(heard)
            if key[1] == formatter and any(valued[key, name] for name in names)
        ]
        if wanted is None:
            found = [(key, names) for key, names in found if not key[2].startswith("E")]
        else:
            among = [(key, names) for key, names in found if key[2] == wanted or key[0] in {wanted} | talkers[wanted]]
            if not among:
                have = ", ".join(sorted({key[2] or key[0] for key, _ in found})) or "none"
                kinds = "/".join(dict.fromkeys(formatter for formatter, _ in channels))
                raise InputError(f"{map}: {what} = {wanted!r} tells no {kinds} in {file}; heard from: {have}")
            if not among[0][0][2] and len({key[0] for key, _ in among}) > 1:
                several = ", ".join(sorted({key[0] for key, _ in among}))
                raise InputError(
                    f"{map}: {what} = {wanted!r} is the talker of several sources in {file}; name one of {several}"
                )
            found = among
        if not found:
            return None
        who = max(found, key=lambda f: sum(valued[f[0], name] for name in f[1]))[0]
        same = [(key, names) for key, names in found if key[0] == who[0]]
        most = max(heard[key] for key, _ in same)
        return next((key, names) for key, names in same if 2 * heard[key] >= most)

    chosen = {}
    for antenna, settings in plan.antennas.items():
        chosen[antenna] = best(POSITION, settings.source, f"antennas.{antenna}.source")
    if len({choice[0] for choice in chosen.values() if choice}) < len(chosen):
        raise InputError(f"{map}: antennas: two have the same source; each antenna has a receiver of its own")
    for what, channels in QUANTITIES.items():
        chosen[what] = best(channels, getattr(plan.sensors, what), f"sensors.{what}")
    if plan.full_pitch_ratio is None:
        chosen["propeller_pitch"] = None
    return {what: choice for what, choice in chosen.items() if choice is not None}


def _series(good: list[tuple[float, Sentence]], chosen, plan: NmeaMap) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times [s, UNIX] and values by column, in the order of time, thinned to the map's period."""
    columns: dict[tuple[Key, str], list[str]] = defaultdict(list)
    for what, (key, names) in chosen.items():
        for name in names:
            columns[key, name].append(f"{what}_{name}" if what in plan.antennas else RENAMED.get(name, name))
    points: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for t, s in good:
        for name, value in s.reading.values.items():
            for column in columns.get((s.kind, name), ()):
                points[column].append((t, value))
    series = {}
    for column, pairs in points.items():
        t, value = np.array(pairs).T
        order = np.argsort(t, kind="stable")
        t, value = t[order], value[order]
        if plan.period_s is not None:
            kept = np.diff(np.floor(t / plan.period_s + 1e-3), prepend=-np.inf) > 0
            t, value = t[kept], value[kept]
        series[column] = t, value
    if plan.full_pitch_ratio is not None and "propeller_pitch_percent" in series:
        t, percent = series.pop("propeller_pitch_percent")
        series["propeller_pitch_ratio"] = t, percent / 100 * plan.full_pitch_ratio
    angle = series.pop("wind_angle_true_deg", None)
    if angle is not None and "heading_deg" in series:
        (t, heading), (at, from_bow) = series["heading_deg"], angle
        last = np.searchsorted(t, at + TOGETHER, side="right") - 1  # never a later heading: live, there is none
        fresh = (last >= 0) & (at - t[last] <= WIND_AGE)
        series["wind_from_true_deg"] = at[fresh], (heading[last] + from_bow)[fresh] % 360
    return series


def _table(series: dict[str, tuple[np.ndarray, np.ndarray]], antennas) -> tuple[pd.DataFrame, float, int]:
    """Table, the time of its first row [s, UNIX], and how many values gave way to an earlier one at the same time."""
    every = np.sort(np.concatenate([t for t, _ in series.values()]))
    begins = np.diff(every, prepend=-np.inf) >= TOGETHER
    rows = np.cumsum(begins) - 1
    time = every[begins]
    table, twice = {"time_s": np.round(time - time[0], 5)}, 0  # a UNIX time resolves 0.2 us
    order = [f"{a}_{name}" for a in antennas for name in NAMES] + [c.name for c in schema.LOG]
    for column in sorted(series, key=order.index):
        t, value = series[column]
        row, first = np.unique(rows[np.searchsorted(every, t)], return_index=True)
        twice += len(t) - len(row)
        table[column] = np.full(len(time), np.nan)
        table[column][row] = value[first]
    return pd.DataFrame(table), float(time[0]), twice


def _iso(time: float) -> str:
    moment = datetime(1970, 1, 1) + timedelta(milliseconds=round(time * 1000))
    return moment.isoformat(timespec="milliseconds" if moment.microsecond else "seconds") + "Z"
