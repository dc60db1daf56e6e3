"""Canonical logs into NMEA 0183 sentences, as a ship's recorder has them; `nmea.import_nmea0183` reads them back.

Every line has a TAG block with the source and the time, then a sentence of at most 82 characters with its checksum. Written
column by column: all sentences of a kind are put into words at once, then brought into the order of time.
"""

from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from aspnn import schema
from aspnn.logs.nmea import NAMES, WIND_AGE
from aspnn.logs.readings import ACCELERATIONS, KNOT
from aspnn.logs.recording import TOGETHER, unix
from aspnn.records import Log, atomic
from aspnn.schema import InputError

TALKERS = ("GP", "GN", "GL", "GA", "GB", "GQ")  # one per antenna, in the order of the log
BLOCK = 20_000  # rows put into words at once
Field = Callable[[np.ndarray], list[str]]  # rows -> a field of each one's sentence


def write_nmea(log: Log, path: str | Path) -> Path:
    """Write the log's sentences (`to_nmea`) to `path`, whole or not at all. Raises InputError."""
    with atomic(path) as temporary, open(temporary, "w", encoding="ascii", newline="") as file:
        for lines in _blocks(log):
            file.write("".join(lines))
    return Path(path)


def to_nmea(log: Log) -> Iterator[str]:
    """The log as lines of a recording, in the order of time, with the line ends. Raises InputError.

    GGA per antenna (talkers GP, GN, GL, ... in the log's order, sources GP0001, GN0001, ...), ZDA at the first row of each second,
    VTG, HDT, ROT, RSA, ROR, PRC (engine order), RPM (shaft 0; the pitch in percent of a pitch ratio of 1), XDR (roll and pitch; the
    accelerations as ACCX, ACCY, ACCZ in m/s2), VBW, MWV (true, from the bow) and DPT (the transducer at the vessel's draught).
    Positions have 4 decimals of a minute where they fit, else 7 (0.2 mm), all else up to four decimals, times milliseconds.
    """
    for lines in _blocks(log):
        yield from lines


def _blocks(log: Log) -> Iterator[list[str]]:
    names, where = schema.antennas(log.table.columns), log.path or "log"
    if not log.start or f"{names[0]}_latitude_deg" not in log.table:
        raise InputError(f"{where}: sentences need the start of the log in UTC, and latitudes")
    if len(names) > len(TALKERS):
        raise InputError(f"{where}: has {len(names)} antennas, at most {len(TALKERS)} have a talker")
    stamps = round(unix(log.start) * 1000) + np.round(log.table["time_s"].to_numpy() * 1000).astype(np.int64)
    columns = {str(name): log.table[name].to_numpy(float) for name in log.table.columns}
    if {"wind_speed_true_m_s", "wind_from_true_deg", "heading_deg"} <= columns.keys():
        columns["from_bow"] = _from_bow(columns)
    for antenna in names:  # both, or no fix
        columns[f"{antenna}_fix"] = columns[f"{antenna}_latitude_deg"] + columns[f"{antenna}_longitude_deg"]
    columns["new_second"] = np.where(np.diff(stamps // 1000, prepend=-1) > 0, 1.0, np.nan)
    for first in range(0, len(stamps), BLOCK):
        part = slice(first, first + BLOCK)
        block = {name: values[part] for name, values in columns.items()}
        yield _lines(block, stamps[part], names, log.vessel.draught)


def _from_bow(columns: dict[str, np.ndarray]) -> np.ndarray:
    """The wind's angle from the bow as told with the last heading told (to four decimals), if that is fresh; else NaN."""
    known, time = np.isfinite(columns["heading_deg"]), columns["time_s"]
    last = np.maximum.accumulate(np.where(known, np.arange(len(time)), -1))
    fresh = (last >= 0) & (time - time[last] <= WIND_AGE - TOGETHER)
    heading = np.round(columns["heading_deg"][last], 4)
    fresh &= np.isfinite(columns["wind_speed_true_m_s"])
    return np.where(fresh, np.round(columns["wind_from_true_deg"] - heading, 4) % 360, np.nan)


def _lines(columns: dict[str, np.ndarray], stamps: np.ndarray, antennas: list[str], draught: float) -> list[str]:
    """The lines of some rows: bodies of sentences by kind, then the checksums of all, then the order of time."""
    rows: list[np.ndarray] = []
    sources: list[str] = []
    bodies: list[str] = []
    seconds, utc = stamps // 1000, stamps % 86_400_000
    times = [f"{t // 3_600_000:02d}{t // 60_000 % 60:02d}{t // 1000 % 60:02d}.{t % 1000:03d}" for t in utc.tolist()]

    def column(name: str, scale: float = 1.0, plus: float = 0.0, circle: float | None = None) -> Field:
        def words(which: np.ndarray) -> list[str]:
            value = np.round(columns[name][which] * scale + plus, 4)
            return _decimals(value if circle is None else value % circle)

        return words if name in columns else lambda which: [""] * len(which)

    def clock(which: np.ndarray) -> list[str]:
        return [times[i] for i in which]

    def date(which: np.ndarray) -> list[str]:
        return [f"{datetime.fromtimestamp(t, UTC):%d,%m,%Y}" for t in seconds[which].tolist()]

    def add(address: str, form: str, needs: Sequence[str], *fields: Field) -> None:
        """Sentences at the rows where any column of `needs` has a value; `fields` fill the places of `form`."""
        known = [np.isfinite(columns[name]) for name in needs if name in columns]
        which = np.flatnonzero(np.any(known, axis=0)) if known else np.empty(0, int)
        rows.append(which)
        sources.extend([f"{address[:2]}0001"] * len(which))
        bodies.extend(map(f"{address},{form}".format, *(field(which) for field in fields)))

    add(f"{TALKERS[0]}ZDA", "{},{},00,00", ["new_second"], clock, date)
    for talker, antenna in zip(TALKERS, antennas, strict=False):
        latitude, longitude, height = (f"{antenna}_{name}" for name in NAMES)
        north, east = _minutes(columns[latitude], 2, "NS"), _minutes(columns[longitude], 3, "EW")
        above = "{},M,0.0,M" if height in columns else "{},,,"
        add(f"{talker}GGA", f"{{}},{{}},{{}},1,,,{above},,", [f"{antenna}_fix"], clock, north, east, column(height))
    speed, course = "speed_over_ground_m_s", column("course_over_ground_deg", circle=360.0)
    motion = course, column(speed, 1 / KNOT), column(speed, 3.6)
    add(f"{TALKERS[0]}VTG", "{},T,,M,{},N,{},K,A", ["course_over_ground_deg", speed], *motion)
    add("HEHDT", "{},T", ["heading_deg"], column("heading_deg", circle=360.0))
    add("TIROT", "{},A", ["yaw_rate_deg_s"], column("yaw_rate_deg_s", 60.0))
    add("IIRSA", "{},A,,V", ["rudder_angle_deg"], column("rudder_angle_deg"))
    add("IIROR", "{},A,,V,B", ["rudder_order_deg"], column("rudder_order_deg"))
    add("ERPRC", ",V,{},R,,V,B,0", ["engine_order_rps"], column("engine_order_rps", 60.0))
    turning = column("shaft_speed_rps", 60.0), column("propeller_pitch_ratio", 100.0)
    add("ERRPM", "S,0,{},{},A", ["shaft_speed_rps", "propeller_pitch_ratio"], *turning)
    attitude = ["roll_deg", "pitch_deg"]
    add("INXDR", "A,{},D,ROLL,A,{},D,PTCH", attitude, *(column(name) for name in attitude))
    felt = {transducer: name for transducer, name in ACCELERATIONS.items() if name in columns}
    form = ",".join(f"G,{{}},,{transducer}" for transducer in felt)
    add("YXXDR", form, list(felt.values()), *(column(name) for name in felt.values()))
    add("VDVBW", "{},,A,,,V", ["speed_through_water_m_s"], column("speed_through_water_m_s", 1 / KNOT))
    add("WIMWV", "{},T,{},M,A", ["from_bow"], column("from_bow", circle=360.0), column("wind_speed_true_m_s"))
    add("SDDPT", f"{{}},{draught:.2f},", ["depth_m"], column("depth_m", plus=-round(draught, 2)))
    order = np.concatenate(rows)
    tags = [f"s:{source},c:{stamp}" for source, stamp in zip(sources, stamps[order].tolist(), strict=True)]
    parts = zip(tags, _checksums(tags), bodies, _checksums(bodies), strict=True)
    lines = [f"\\{tag}*{first:02X}\\${body}*{last:02X}\r\n" for tag, first, body, last in parts]
    return [lines[i] for i in np.argsort(order, kind="stable")]


def _checksums(texts: list[str]) -> list[int]:
    """The exclusive or of the bytes of each text, none empty: as `sentences.checksum`, of all at once."""
    if not texts:
        return []
    starts = np.cumsum([0, *map(len, texts[:-1])])
    return np.bitwise_xor.reduceat(np.frombuffer("".join(texts).encode("ascii"), np.uint8), starts).tolist()


def _decimals(values: np.ndarray) -> list[str]:
    """Numbers with one to four decimals; NaN is empty, and nothing is minus zero."""
    words = [f"{value:.4f}" for value in (values + 0.0).tolist()]
    cut = [word[:-3] + word[-3:].rstrip("0") for word in words]
    return ["" if word == "nan" else word for word in cut]


def _minutes(angles: np.ndarray, digits: int, letters: str) -> Field:
    """Degrees and minutes with the letter, such as 6939.1234,N; counted in 1e-7 minutes, so that none rounds up to 60."""

    def words(which: np.ndarray) -> list[str]:
        units = np.round(np.abs(angles[which]) * 6e8).astype(np.int64)
        coarse = not np.any(units % 1000)
        scale, places = (1000, 4) if coarse else (1, 7)
        degrees, rest = np.divmod(units // scale, 600_000_000 // scale)
        minutes, fraction = np.divmod(rest, 10**places)
        sides = np.where(angles[which] < 0, letters[1], letters[0])
        parts = zip(degrees.tolist(), minutes.tolist(), fraction.tolist(), sides.tolist(), strict=True)
        return [f"{d:0{digits}d}{m:02d}.{f:0{places}d},{side}" for d, m, f, side in parts]

    return words
