"""Recorded AIS into canonical logs, one per ship: the position reports of class A and B, at the UTC seconds of their fixes.

`ais_lines` reads files, `ais_messages` what they say, `ais_clock` tells when each report was true, `ais_tracks` which ship's it is;
`ais_write` goes the other way. Rows stand at the reports; what a report does not tell is NaN.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aspnn.checks import check_log
from aspnn.frames import Zone
from aspnn.logs.ais_clock import clock
from aspnn.logs.ais_lines import Fault, Tally, read_messages
from aspnn.logs.ais_messages import COARSE, Clock, Report, Static, Undecodable, codec, is_ship, read_message
from aspnn.logs.ais_tracks import Heard, Mixed, Track, frozen, in_order, one_at_a_time, ships
from aspnn.logs.ais_vessel import ANTENNA, announced, fitted
from aspnn.logs.maps import source_files, utc
from aspnn.records import Log, sha256
from aspnn.schema import InputError
from aspnn.vessel import Vessel, load_vessel

ENDINGS = (".ais", ".nmea", ".nmea0183", ".0183", ".aivdm", ".log", ".txt")
COLUMNS = {  # of the log: of a report
    f"{ANTENNA}_latitude_deg": "latitude_deg",
    f"{ANTENNA}_longitude_deg": "longitude_deg",
    "heading_deg": "heading_deg",
    "yaw_rate_deg_s": "yaw_rate_deg_s",
    "course_over_ground_deg": "course_deg",
    "speed_over_ground_m_s": "speed_m_s",
}


@dataclass
class _Harbour:
    """What the files tell of all ships: reports and static data by MMSI, and what was counted."""

    reports: dict[int, list[Heard]] = field(default_factory=dict)
    statics: dict[int, list[Static]] = field(default_factory=dict)
    latency: dict[int, list[float]] = field(default_factory=dict)
    counts: dict[str, Any] = field(default_factory=dict)
    dated: bool = True


def import_ais(sources: Sequence[str | Path], vessel: str | None = None, mmsi: int | None = None) -> list[Log]:
    """Logs of the ships heard in files of AIS sentences (folders are searched through), in the order of their MMSI.

    The files of a call are one recording. A ship's vessel is made of the dimensions that it announces (`announced`); `vessel`, a
    packaged one or a file, takes its place, and must have the announced length. `mmsi` takes one ship alone. Two ships under one MMSI
    become two logs, NAME-a and NAME-b; where they cannot be told apart they are left out, which the notes of all others say.
    Raises InputError naming file, line and MMSI.
    """
    pyais = codec()
    files = source_files(sources, ENDINGS)
    harbour = _heard(files, pyais)
    shape = None if vessel is None else load_vessel(vessel)
    wanted = sorted(harbour.reports) if mmsi is None else [mmsi]
    names, refused, tracks = [file.name for file in files.values()], {}, []
    for number in wanted:
        try:
            tracks += [(number, track) for track in _tracks(harbour.reports.get(number, []), names)]
        except Mixed as error:
            refused[number] = str(error)
    if not tracks:
        raise InputError(_nothing(files, harbour, wanted, refused))
    if refused:
        harbour.counts["left_out"] = "; ".join(f"MMSI {number}: {why}" for number, why in refused.items())
    parts = Counter(number for number, _ in tracks)
    source = _source(files)
    logs: list[Log] = []
    for number, track in tracks:
        letter = chr(ord("a") + sum(log.notes["mmsi"] == number for log in logs))
        name = f"{next(iter(files))}-{number:09d}{f'-{letter}' if parts[number] > 1 else ''}"
        logs.append(_log(name, number, track, harbour, shape, names, source))
    return logs


def _heard(files: dict[str, Path], pyais: Any) -> _Harbour:
    """All reports of ships in the files, with their times. Raises InputError for an undated file among several."""
    harbour, kinds, tallies = _Harbour(), Counter[int](), []
    silent = ahead = 0.0
    for number, file in enumerate(files.values()):
        tally, messages = Tally(), []
        tallies.append((file.name, tally))
        for heard in read_messages(file, tally):
            try:
                said = read_message(heard.sentences, pyais)
            except Undecodable as error:
                tally.bad(heard.line, Fault.undecodable, str(error), len(heard.sentences))
                continue
            kinds[said if isinstance(said, int) else said.kind] += 1
            static = said.static if isinstance(said, Report) else said
            if isinstance(static, Static):
                harbour.statics.setdefault(static.mmsi, []).append(static)
            if isinstance(said, Clock) or (isinstance(said, Report) and is_ship(said.mmsi)):
                messages.append((heard, said))
        times, dated, fast = clock(
            [heard.received for heard, _ in messages],
            [said.second if isinstance(said, Report) else np.nan for _, said in messages],
            [said.time if isinstance(said, Clock) else np.nan for _, said in messages],
            [said.mmsi for _, said in messages],
        )
        ahead = max(ahead, fast, key=abs)
        harbour.dated = harbour.dated and dated
        for (heard, said), time in zip(messages, times.tolist(), strict=True):
            if isinstance(said, Clock):
                continue
            if time != time:
                silent += 1
                continue
            harbour.reports.setdefault(said.mmsi, []).append(Heard(said, time, number, heard.line, heard.own))
            if said.second == said.second and heard.received == heard.received:
                harbour.latency.setdefault(said.mmsi, []).append(heard.received - fast - time)
    if not harbour.dated and len(files) > 1 and harbour.reports:
        raise InputError(
            f"{next(iter(files.values()))}: of {len(files)} files at least one tells no date (receipt or base station); "
            "import them one by one"
        )
    harbour.counts = _counts(tallies, kinds, int(silent), ahead)
    return harbour


def _counts(tallies: list[tuple[str, Tally]], kinds: Counter[int], silent: int, ahead: float) -> dict[str, Any]:
    """What the recording holds, in numbers."""
    faults = sum((tally.faults for _, tally in tallies), Counter[Fault]())
    first = next((f"{name} {tally.first_bad}" for name, tally in tallies if tally.first_bad), "")
    counts = {
        "lines": sum(tally.lines for _, tally in tallies),
        "sentences": sum(tally.sentences for _, tally in tallies),
        "other_sentences": sum(tally.others for _, tally in tallies),
        "messages": {str(kind): kinds[kind] for kind in sorted(kinds)},
        "bad": {fault.value: faults[fault] for fault in Fault if faults[fault]},
        "first_bad": first,
        "reports_without_time": silent,
        "logger_clock_ahead_s": round(ahead, 3),
    }
    return {key: value for key, value in counts.items() if value}


def _nothing(files: dict[str, Path], harbour: _Harbour, wanted: list[int], refused: dict[int, str]) -> str:
    """Why there is no log, in a line."""
    where = str(next(iter(files.values()))) + (f" and {len(files) - 1} more" if len(files) > 1 else "")
    if refused:
        number, why = next(iter(refused.items()))
        return f"{where}: MMSI {number}: {why}; cut the file so that each part holds one ship"
    if wanted and harbour.reports and not set(wanted) & set(harbour.reports):
        have = ", ".join(map(str, sorted(harbour.reports)[:10]))
        return f"{where}: holds no position of MMSI {wanted[0]}; heard from {have}"
    held = harbour.counts.get("messages", {})
    told = f"messages by type: {held}" if held else "no message"
    if first := harbour.counts.get("first_bad", ""):
        told += f"; first trouble: {first}"
    return f"{where}: holds no two positions of any ship ({told}); record position reports (messages 1, 2, 3, 18)"


def _tracks(heard: list[Heard], names: list[str]) -> list[Track]:
    """The tracks of one MMSI, each with two fixes at least. Raises Mixed."""
    fine = [h for h in heard if h.report.kind != COARSE]
    coarse = len(heard) - len(fine) if fine else 0
    whole = in_order(fine or heard)
    measured = [h for h in whole.heard if h.report.measured]
    notes = {"long_range_reports_dropped": coarse, "not_measured_dropped": len(whole.heard) - len(measured)}
    whole = Track(measured, whole.notes | {key: count for key, count in notes.items() if count})
    found = [one_at_a_time(track) for track in (ships(whole, names) if measured else [])]
    return [track for track in found if np.isfinite(track.column("latitude_deg")).sum() >= 2]


def _log(
    name: str, mmsi: int, track: Track, harbour: _Harbour, shape: Vessel | None, names: list[str], source: str
) -> Log:
    halted, frozen_note = frozen(track, names)
    time = track.time
    table = {"time_s": time - time[0]} | {column: track.column(told) for column, told in COLUMNS.items()}
    for ending in ("latitude_deg", "longitude_deg"):
        table[f"{ANTENNA}_{ending}"][halted] = np.nan
    table = {column: values for column, values in table.items() if np.isfinite(values).any()}
    kinds = {h.report.kind for h in track.heard}
    accurate = float(np.mean([h.report.accurate for h in track.heard]))
    hull, told = announced(mmsi, harbour.statics.get(mmsi, []), kinds, accurate)
    if shape is not None:
        hull, told = fitted(shape, hull, told, mmsi, names[0])
    fix = int(np.argmax(np.isfinite(table[f"{ANTENNA}_latitude_deg"])))
    first = [float(table[f"{ANTENNA}_{ending}"][fix]) for ending in ("latitude_deg", "longitude_deg")]
    zone = Zone.of(*np.radians(first))
    late = harbour.latency.get(mmsi, [])
    notes: dict[str, Any] = {"name": name, "mmsi": mmsi, "reports": len(track.heard), **told}
    notes |= {"accurate_share": round(accurate, 3), "zone": f"{zone}, of the first fix", **track.notes, **frozen_note}
    if any(h.own for h in track.heard):
        notes["own_ship"] = True
    if late:
        notes["received_later_s"] = f"{np.median(late):.3g} median, {np.max(late):.3g} longest"
    if turning := sum(h.report.turning for h in track.heard):
        notes["turning_without_figure"] = turning
    log = Log(
        table=pd.DataFrame(table),
        vessel=hull,
        zone=zone,
        start=utc(datetime.fromtimestamp(time[0], UTC)) if harbour.dated else "",
        source=source,
        voyage=name,
        notes=notes | {"recording": harbour.counts},
    )
    check_log(log, name)
    return log


def _source(files: dict[str, Path]) -> str:
    """The files by name, each with its SHA-256."""
    return "; ".join(f"{file.name}, AIS, SHA-256 {sha256(file)}" for file in files.values())
