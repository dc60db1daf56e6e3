"""A strict codec of NMEA 0183 (IEC 61162-1) sentences: frame, checksum, fields to numbers with the unit in the name.

Pure functions on text; `decode` returns what is wrong and never raises. A sentence is `$`, talker (2), formatter (3), fields,
`*hh`: the exclusive or of the bytes between `$` and `*`. Sentences beyond the 82 characters of the standard are read: the
limit spares listeners' buffers, while precise receivers write more decimals; the checksum tells whether one is whole.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from enum import Enum, StrEnum
from functools import reduce
from operator import xor
from typing import NamedTuple

KNOT = 1852 / 3600  # m/s
DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)", re.ASCII)
TIME = re.compile(r"(\d\d)(\d\d)(\d\d(?:\.\d*)?)", re.ASCII)
WIND_UNITS = {"M": 1.0, "K": 1 / 3.6, "N": KNOT}  # to m/s


class Fault(StrEnum):
    """Why a sentence was not taken."""

    checksum = "checksum"
    no_checksum = "no_checksum"
    malformed = "malformed"
    unknown_sentence = "unknown_sentence"
    invalid_flag = "invalid_flag"
    no_time = "no_time"


class Status(Enum):
    """What a sentence says of its own data. Estimated (dead reckoning) and manual data are no measurements: invalid."""

    valid = 0
    simulated = 1
    invalid = 2


@dataclass(frozen=True)
class Bad:
    """A piece of a line that is not a good sentence."""

    fault: Fault
    reason: str


class Reading(NamedTuple):
    """What the fields say: `values` by names with units (an empty or impossible field is absent, never zero), starboard
    and ahead positive; `utc` [s] of the `day`; `device` tells engines and shafts apart (`S0`, `E1`)."""

    values: dict[str, float]
    status: Status = Status.valid
    utc: float | None = None
    day: date | None = None
    device: str = ""


@dataclass(frozen=True)
class Sentence:
    """A sentence with a right checksum. `source` is that of its TAG block, `received` [s, UNIX] the time put before it."""

    talker: str
    formatter: str
    reading: Reading
    source: str = ""
    received: float | None = None

    @property
    def identity(self) -> str:
        """Who sends it: the source of the TAG block, else the talker."""
        return self.source or self.talker

    @property
    def kind(self) -> tuple[str, str, str]:
        """Who sends what, of which device: sentences of a kind follow each other in time."""
        return self.identity, self.formatter, self.reading.device


def checksum(text: str) -> int:
    """Exclusive or of the bytes of `text` (Latin-1, as files are read here)."""
    return reduce(xor, text.encode("latin-1"), 0)


def encode(talker: str, formatter: str, fields: Sequence[str]) -> str:
    """A sentence with its checksum, without the line end."""
    body = ",".join([talker + formatter, *fields])
    return f"${body}*{checksum(body):02X}"


def encode_tag(source: str = "", time: float | None = None) -> str:
    """A TAG block with source and time [s, UNIX; written in whole milliseconds] and its checksum."""
    parts = [f"s:{source}"] * bool(source) + ([] if time is None else [f"c:{round(time * 1000)}"])
    body = ",".join(parts)
    return f"\\{body}*{checksum(body):02X}\\"


class _Malformed(ValueError):
    """A field is not of its sentence's form."""


def decode(text: str) -> Sentence | Bad:
    """One bare sentence, `$...*hh`. The checksum is needed; fields beyond those known here are left unread."""
    body, star, given = text[1:].partition("*")
    if text[:1] not in ("$", "!"):
        return Bad(Fault.malformed, "does not begin with $ or !")
    if not star:
        return Bad(Fault.no_checksum, "has no checksum")
    if not re.fullmatch(r"[0-9A-Fa-f]{2}", given):
        return Bad(Fault.malformed, f"{given!r} is no checksum")
    if int(given, 16) != checksum(body):
        return Bad(Fault.checksum, f"has checksum {given}, its bytes give {checksum(body):02X}")
    address, *fields = body.split(",")
    if text[0] == "!" or re.fullmatch(r"P[A-Z0-9]{3,}", address):
        return Bad(Fault.unknown_sentence, f"{address[:12]} is not read")  # encapsulated or proprietary
    if not re.fullmatch(r"[A-Z][A-Z0-9][A-Z]{3}", address):
        return Bad(Fault.malformed, f"{address[:12]!r} is no address")
    talker, formatter = address[:2], address[2:]
    if formatter not in FORMATTERS:
        return Bad(Fault.unknown_sentence, f"{address} is not read")
    needed, read = FORMATTERS[formatter]
    if len(fields) < needed:
        return Bad(Fault.malformed, f"{address} has {len(fields)} fields, {needed} are needed")
    try:
        return Sentence(talker, formatter, read(fields + [""] * 16))
    except _Malformed as error:
        return Bad(Fault.malformed, f"{address}: {error}")


def _number(text: str, low: float, high: float) -> float | None:
    """A decimal number; None for an empty field or one outside what can be (a sentinel such as 511 or 102.3)."""
    if not text:
        return None
    if not DECIMAL.fullmatch(text):
        raise _Malformed(f"{text!r} is not a number")
    return value if low <= (value := float(text)) <= high else None


def _scaled(text: str, low: float, high: float, scale: float) -> float | None:
    value = _number(text, low, high)
    return None if value is None else value * scale


def _bearing(text: str) -> float | None:
    value = _number(text, 0, 360)
    return None if value is None else value % 360


def _known(**values: float | None) -> dict[str, float]:
    return {name: value for name, value in values.items() if value is not None}


def _unit(value: str, unit: str, expected: str) -> str:
    """The field `value`, once its unit is as it must be."""
    if value and unit != expected:
        raise _Malformed(f"{value!r} has unit {unit!r}, expected {expected}")
    return value


def _utc(text: str) -> float | None:
    if not text:
        return None
    match = TIME.fullmatch(text)
    if not match or int(match[1]) > 23 or int(match[2]) > 59 or float(match[3]) >= 61:  # 60: a leap second
        raise _Malformed(f"{text!r} is no time")
    return int(match[1]) * 3600 + int(match[2]) * 60 + float(match[3])


def _date(day: str, month: str, year: str) -> date | None:
    if not (day and month and year):
        return None
    try:
        return date(int(year), int(month), int(day))
    except ValueError:
        raise _Malformed(f"{day}-{month}-{year} is no date") from None


def _place(text: str, letter: str, digits: int, letters: str) -> float | None:
    """Degrees from `digits` of degrees and decimal minutes; south and west are negative."""
    if not text:
        return None
    match = re.fullmatch(rf"(\d{{{digits}}})(\d\d(?:\.\d*)?)", text, re.ASCII)
    if not match or float(match[2]) >= 60 or letter not in letters or not letter:
        raise _Malformed(f"{text + letter!r} is no position")
    degrees = int(match[1]) + float(match[2]) / 60
    return None if degrees > 90 * (digits - 1) else degrees * (1 if letter == letters[0] else -1)


def _position(fields: list[str], altitude: float | None = None, geoid: float | None = None) -> dict[str, float]:
    """Latitude, longitude and ellipsoidal height, the sum of the altitude above the geoid and the geoid's height."""
    latitude, longitude = _place(fields[0], fields[1], 2, "NS"), _place(fields[2], fields[3], 3, "EW")
    if latitude is None or longitude is None:
        return {}
    height = None if altitude is None or geoid is None else altitude + geoid
    return _known(latitude_deg=latitude, longitude_deg=longitude, height_m=height)


def _flag(text: str) -> Status:
    if text not in ("A", "V", ""):
        raise _Malformed(f"status {text!r} is neither A nor V")
    return Status.valid if text == "A" else Status.invalid


def _mode(text: str, empty: Status) -> Status:
    """Mode indicators, one per satellite system in GNS: autonomous, differential, precise, real-time kinematic or float."""
    if not re.fullmatch("[ADEFMNPRS]*", text):
        raise _Malformed(f"mode {text!r} is not known")
    if not text or set(text) & set("ADFPR"):
        return Status.valid if text else empty
    return Status.simulated if "S" in text else Status.invalid


def _gga(f: list[str]) -> Reading:
    quality = f[5]
    if quality and not re.fullmatch(r"\d", quality, re.ASCII):
        raise _Malformed(f"quality {quality!r} is no digit")
    status = Status.simulated if quality == "8" else Status.invalid if quality in ("", "0", "6", "7") else Status.valid
    altitude = _number(_unit(f[8], f[9], "M"), -1e4, 1e5)
    geoid = _number(_unit(f[10], f[11], "M"), -1e3, 1e3)
    return Reading(_position(f[1:5], altitude, geoid), status, _utc(f[0]))


def _gns(f: list[str]) -> Reading:
    place = _position(f[1:5], _number(f[8], -1e4, 1e5), _number(f[9], -1e3, 1e3))
    return Reading(place, _mode(f[5], Status.invalid), _utc(f[0]))


def _rmc(f: list[str]) -> Reading:
    if f[8] and not re.fullmatch(r"\d{6}", f[8], re.ASCII):
        raise _Malformed(f"{f[8]!r} is no date")
    century = "19" if f[8][4:] >= "80" else "20"
    motion = _known(speed_over_ground_m_s=_scaled(f[6], 0, 100, KNOT), course_over_ground_deg=_bearing(f[7]))
    status = max(_flag(f[1]), _mode(f[11], Status.valid), key=lambda s: s.value)
    day = _date(f[8][:2], f[8][2:4], century + f[8][4:]) if f[8] else None
    return Reading(_position(f[2:6]) | motion, status, _utc(f[0]), day)


def _vtg(f: list[str]) -> Reading:
    speed = _scaled(_unit(f[4], f[5], "N"), 0, 100, KNOT)
    if speed is None:
        speed = _scaled(_unit(f[6], f[7], "K"), 0, 185.2, 1 / 3.6)
    values = _known(course_over_ground_deg=_bearing(_unit(f[0], f[1], "T")), speed_over_ground_m_s=speed)
    return Reading(values, _mode(f[8], Status.valid))


def _hdt(f: list[str]) -> Reading:
    return Reading(_known(heading_deg=_bearing(_unit(f[0], f[1], "T"))))


def _ths(f: list[str]) -> Reading:
    if f[1] not in ("A", "E", "M", "S", "V", ""):
        raise _Malformed(f"mode {f[1]!r} is not known")
    status = Status.valid if f[1] == "A" else Status.simulated if f[1] == "S" else Status.invalid
    return Reading(_known(heading_deg=_bearing(f[0])), status)


def _rot(f: list[str]) -> Reading:
    """Degrees per minute, minus: the bow turns to port."""
    return Reading(_known(yaw_rate_deg_s=_scaled(f[0], -3600, 3600, 1 / 60)), _flag(f[1]))


def _rudder(name: str, f: list[str]) -> Reading:
    """Starboard or single rudder and its status, port rudder and its status; minus turns to port."""
    sides = ((f"{name}_deg", f[0], _flag(f[1])), (f"{name}_port_deg", f[2], _flag(f[3])))
    angles = {side: (_number(text, -90, 90), status) for side, text, status in sides}
    values = _known(**{side: angle for side, (angle, status) in angles.items() if status is Status.valid})
    return Reading(values, min((status for _, status in angles.values()), key=lambda s: s.value))


def _rsa(f: list[str]) -> Reading:
    return _rudder("rudder_angle", f)


def _ror(f: list[str]) -> Reading:
    return _rudder("rudder_order", f)


def _rpm(f: list[str]) -> Reading:
    """Revolutions per minute of a shaft (S) or an engine (E), minus: astern. Pitch, in percent of an unknown most, is unread."""
    if f[0] not in ("S", "E") or not re.fullmatch(r"\d{0,2}", f[1], re.ASCII):
        raise _Malformed(f"{f[0] + f[1]!r} is no shaft or engine")
    speed = _scaled(f[2], -6000, 6000, 1 / 60)
    name = "shaft_speed_rps" if f[0] == "S" else "engine_speed_rps"
    return Reading(_known(**{name: speed}), _flag(f[4]), device=f"{f[0]}{int(f[1] or 0)}")


def _mwv(f: list[str]) -> Reading:
    """Wind relative to the ship (R) or true (T); the angle, clockwise, is from the bow in both."""
    if f[1] not in ("R", "T") or (f[2] and f[3] not in WIND_UNITS):
        raise _Malformed(f"reference {f[1]!r} or unit {f[3]!r} is not known")
    which = "true" if f[1] == "T" else "relative"
    unit = WIND_UNITS.get(f[3], 1.0)
    speed = _scaled(f[2], 0, 100 / unit, unit)
    return Reading(_known(**{f"wind_speed_{which}_m_s": speed, f"wind_angle_{which}_deg": _bearing(f[0])}), _flag(f[4]))


def _zda(f: list[str]) -> Reading:
    if not all(re.fullmatch(r"\d*", part, re.ASCII) for part in f[1:4]):
        raise _Malformed(f"{'-'.join(f[1:4])!r} is no date")
    return Reading({}, utc=_utc(f[0]), day=_date(f[1], f[2], f[3]))


# The fields a sentence must have at least, and what reads them; some devices leave out trailing ones.
FORMATTERS: dict[str, tuple[int, Callable[[list[str]], Reading]]] = {
    "GGA": (9, _gga),
    "GNS": (9, _gns),
    "RMC": (9, _rmc),
    "VTG": (8, _vtg),
    "HDT": (2, _hdt),
    "THS": (2, _ths),
    "ROT": (2, _rot),
    "RSA": (2, _rsa),
    "ROR": (2, _ror),
    "RPM": (5, _rpm),
    "MWV": (5, _mwv),
    "ZDA": (4, _zda),
}
TIMED = ("GGA", "GNS", "RMC", "ZDA")
