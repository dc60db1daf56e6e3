"""Decoded NMEA 2000 as text: canboat's JSON lines (`analyzer -json`), one message each, as sentences of formatter N2K.

The sender's address is its source ("52"), as `antennas.NAME.source` and `sensors` of bridge.toml name it. Angles are in degrees,
as canboat writes them, or radians with `-si`. Headings and courses count only where they are true. Of the five references that the
angle of the wind may have, two can be used: true wind from true north, and true wind from the bow, as MWV,T has it (whether
either is over ground or through the water no standard says). Rows of the long CSV that `aspnn import n2k-yacht` reads come as
lines too (`line_of`), with its names of fields.
"""

import json
import math
import re
from collections.abc import Mapping
from typing import Any

from aspnn.logs.n2k_yacht import FIELDS, POSITION
from aspnn.logs.readings import Reading
from aspnn.logs.recording import unix
from aspnn.logs.sentences import Bad, Fault, Sentence

ANGLE, RATE, PLAIN, PER_MINUTE = "angle", "rate", "plain", "per_minute"
# parameter group -> fields (letters of their names alone) with kind and our name, limits
GROUPS: dict[int, tuple[tuple[str, str, str, float], ...]] = {
    127250: (("heading", ANGLE, "heading_deg", 360),),
    127251: (("rate", RATE, "yaw_rate_deg_s", 60),),
    127257: (("roll", ANGLE, "roll_deg", 180), ("pitch", ANGLE, "pitch_deg", 180)),
    127245: (("position", ANGLE, "rudder_angle_deg", 90), ("angleorder", ANGLE, "rudder_order_deg", 90)),
    127237: (("commandedrudderangle", ANGLE, "rudder_order_deg", 90),),
    127488: (("speed", PER_MINUTE, "engine_speed_rps", 100), ("enginespeed", PER_MINUTE, "engine_speed_rps", 100)),
    128259: (("speedwaterreferenced", PLAIN, "speed_through_water_m_s", 51),),
    128267: (("depth", PLAIN, "depth_m", 12000),),
    129025: (("latitude", PLAIN, "latitude_deg", 90), ("longitude", PLAIN, "longitude_deg", 180)),
    129026: (("cog", ANGLE, "course_over_ground_deg", 360), ("sog", PLAIN, "speed_over_ground_m_s", 51)),
    130306: (("windspeed", PLAIN, "wind_speed_true_m_s", 102), ("windangle", ANGLE, "", 360)),
    129029: (("latitude", PLAIN, "latitude_deg", 90), ("longitude", PLAIN, "longitude_deg", 180)),
}
NORTH = {127250: "reference", 129026: "cogreference"}  # the field that must say True
WIND = {  # canboat's texts: what the angle is then, and a device of its own for each, since one sender may tell both
    "True (ground referenced to North)": ("wind_from_true_deg", "N"),
    "True (boat referenced)": ("wind_angle_true_deg", "B"),
}
PLAIN_FIELDS = {
    field: column for group in (*FIELDS.values(), POSITION) for field, column in group.items()
}  # of the CSV
FORMATTER = "N2K"


def line_of(row: Mapping[str, str]) -> str:
    """A row of the long CSV (`t`, `pgn`, `src`, fields) as a line of JSON."""
    fields = {name: value for name, value in row.items() if name in PLAIN_FIELDS and value}
    return json.dumps({"t": row.get("t"), "pgn": row.get("pgn"), "src": row.get("src"), "fields": fields})


def read_n2k(text: str, si: bool = False) -> Sentence | Bad:
    """One message; `si`: its angles are in radians. Nothing raises."""
    try:
        said = json.loads(text)
        fields, group, source = said["fields"], int(said["pgn"]), str(int(said["src"]))
        plain = "t" in said
        received = float(said["t"]) if plain else _instant(str(said["timestamp"]))
        named = {re.sub("[^a-z]", "", str(name).lower()): value for name, value in fields.items()}
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        return Bad(Fault.malformed, f"no decoded NMEA 2000 message ({type(error).__name__})")
    if not math.isfinite(received):
        return Bad(Fault.malformed, "the message has no finite time")
    if plain:
        found = {column: _number(named.get(field), 1e6) for field, column in PLAIN_FIELDS.items()}
        return _sentence(source, found, received)
    if group not in GROUPS:
        return Bad(Fault.unknown_sentence, f"parameter group {group} is not read")
    if group in NORTH and not _text(named.get(NORTH[group])).startswith("True"):
        return Bad(Fault.invalid_flag, f"parameter group {group} is not of true north")
    wind = ("", "")
    if group == 130306:
        reference = _text(named.get("reference"))
        if reference not in WIND:
            return Bad(Fault.unknown_sentence, f"wind of reference {reference[:40]!r} is not read")
        wind = WIND[reference]
    told: dict[str, float] = {}
    for field, kind, column, limit in GROUPS[group]:
        scale = math.degrees(1.0) if si and kind in (ANGLE, RATE) else 1 / 60 if kind == PER_MINUTE else 1.0
        value = _number(named.get(field), limit, scale)
        if value is not None:
            told[column or wind[0]] = value
    if group == 128267 and (offset := _number(named.get("offset"), 100)) is not None and "depth_m" in told:
        if offset < 0:  # minus: above the keel, and no depth of the water
            del told["depth_m"]
        else:
            told["depth_m"] += offset
    device = wind[1]
    if group == 127488:
        device = f"E{int('Starboard' in _text(named.get('instance')) or named.get('instance') == 1)}"
    return _sentence(source, told, received, device)


def _sentence(source: str, found: Mapping[str, float | None], received: float, device: str = "") -> Sentence:
    values = {name: value for name, value in found.items() if value is not None}
    for bearing in ("heading_deg", "course_over_ground_deg", "wind_from_true_deg", "wind_angle_true_deg"):
        if bearing in values:
            values[bearing] %= 360
    if ("latitude_deg" in values) != ("longitude_deg" in values):  # half a position is none
        values.pop("latitude_deg", None), values.pop("longitude_deg", None)
    return Sentence("", FORMATTER, Reading(values, device=device), source, received)


def _number(value: Any, limit: float, scale: float = 1.0) -> float | None:
    if isinstance(value, dict):
        value = value.get("value")
    try:
        number = float(value) * scale
    except (TypeError, ValueError, OverflowError):
        return None
    return number if abs(number) <= limit else None


def _text(value: Any) -> str:
    return str(value.get("name", "")) if isinstance(value, dict) else str(value)


def _instant(text: str) -> float:
    """UNIX time [s]; older versions write 2011-11-24-22:42:04.437."""
    return unix(f"{text[:10]}T{text[11:]}" if text[10:11] == "-" else text)
