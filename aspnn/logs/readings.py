"""What the fields of each NMEA 0183 (IEC 61162-1) sentence say: fields to numbers with the unit in the name.

One reader per formatter takes the fields and returns a Reading; it raises Malformed where a field is not of its sentence's form.
"""

import re
from collections.abc import Callable
from datetime import date
from enum import Enum
from typing import NamedTuple

KNOT = 1852 / 3600  # m/s
DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)", re.ASCII)
TIME = re.compile(r"(\d\d)(\d\d)(\d\d(?:\.\d*)?)", re.ASCII)
WIND_UNITS = {"M": 1.0, "K": 1 / 3.6, "N": KNOT}  # to m/s


class Status(Enum):
    """What a sentence says of its own data. Estimated (dead reckoning) and manual data are no measurements: invalid."""

    valid = 0
    simulated = 1
    invalid = 2


class Reading(NamedTuple):
    """What the fields say: `values` by names with units (an empty or impossible field is absent, never zero), starboard
    and ahead positive; `utc` [s] of the `day`; `device` tells engines and shafts apart (`S0`, `E1`)."""

    values: dict[str, float]
    status: Status = Status.valid
    utc: float | None = None
    day: date | None = None
    device: str = ""


class Malformed(ValueError):
    """A field is not of its sentence's form."""


def _number(text: str, low: float, high: float) -> float | None:
    """A decimal number; None for an empty field or one outside what can be (a sentinel such as 511 or 102.3)."""
    if not text:
        return None
    if not DECIMAL.fullmatch(text):
        raise Malformed(f"{text!r} is not a number")
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
        raise Malformed(f"{value!r} has unit {unit!r}, expected {expected}")
    return value


def _utc(text: str) -> float | None:
    if not text:
        return None
    match = TIME.fullmatch(text)
    if not match or int(match[1]) > 23 or int(match[2]) > 59 or float(match[3]) >= 61:  # 60: a leap second
        raise Malformed(f"{text!r} is no time")
    return int(match[1]) * 3600 + int(match[2]) * 60 + float(match[3])


def _date(day: str, month: str, year: str) -> date | None:
    if not (day and month and year):
        return None
    try:
        return date(int(year), int(month), int(day))
    except ValueError:
        raise Malformed(f"{day}-{month}-{year} is no date") from None


def _place(text: str, letter: str, digits: int, letters: str) -> float | None:
    """Degrees from `digits` of degrees and decimal minutes; south and west are negative."""
    if not text:
        return None
    match = re.fullmatch(rf"(\d{{{digits}}})(\d\d(?:\.\d*)?)", text, re.ASCII)
    if not match or float(match[2]) >= 60 or letter not in letters or not letter:
        raise Malformed(f"{text + letter!r} is no position")
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
        raise Malformed(f"status {text!r} is neither A nor V")
    return Status.valid if text == "A" else Status.invalid


def _mode(text: str, empty: Status) -> Status:
    """Mode indicators, one per satellite system in GNS: autonomous, differential, precise, real-time kinematic or float."""
    if not re.fullmatch("[ADEFMNPRS]*", text):
        raise Malformed(f"mode {text!r} is not known")
    if not text or set(text) & set("ADFPR"):
        return Status.valid if text else empty
    return Status.simulated if "S" in text else Status.invalid


def _gga(f: list[str]) -> Reading:
    quality = f[5]
    if quality and not re.fullmatch(r"\d", quality, re.ASCII):
        raise Malformed(f"quality {quality!r} is no digit")
    status = Status.simulated if quality == "8" else Status.invalid if quality in ("", "0", "6", "7") else Status.valid
    altitude = _number(_unit(f[8], f[9], "M"), -1e4, 1e5)
    geoid = _number(_unit(f[10], f[11], "M"), -1e3, 1e3)
    return Reading(_position(f[1:5], altitude, geoid), status, _utc(f[0]))


def _gns(f: list[str]) -> Reading:
    place = _position(f[1:5], _number(f[8], -1e4, 1e5), _number(f[9], -1e3, 1e3))
    return Reading(place, _mode(f[5], Status.invalid), _utc(f[0]))


def _rmc(f: list[str]) -> Reading:
    if f[8] and not re.fullmatch(r"\d{6}", f[8], re.ASCII):
        raise Malformed(f"{f[8]!r} is no date")
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
        raise Malformed(f"mode {f[1]!r} is not known")
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
    """Revolutions per minute of a shaft (S) or an engine (E) and pitch in percent of the most, minus: astern."""
    if f[0] not in ("S", "E") or not re.fullmatch(r"\d{0,2}", f[1], re.ASCII):
        raise Malformed(f"{f[0] + f[1]!r} is no shaft or engine")
    speed = _scaled(f[2], -6000, 6000, 1 / 60)
    name = "shaft_speed_rps" if f[0] == "S" else "engine_speed_rps"
    values = _known(**{name: speed}, propeller_pitch_percent=_number(f[3], -100, 100))
    return Reading(values, _flag(f[4]), device=f"{f[0]}{int(f[1] or 0)}")


def _mwv(f: list[str]) -> Reading:
    """Wind relative to the ship (R) or true (T); the angle, clockwise, is from the bow in both."""
    if f[1] not in ("R", "T") or (f[2] and f[3] not in WIND_UNITS):
        raise Malformed(f"reference {f[1]!r} or unit {f[3]!r} is not known")
    which = "true" if f[1] == "T" else "relative"
    unit = WIND_UNITS.get(f[3], 1.0)
    speed = _scaled(f[2], 0, 100 / unit, unit)
    return Reading(_known(**{f"wind_speed_{which}_m_s": speed, f"wind_angle_{which}_deg": _bearing(f[0])}), _flag(f[4]))


def _zda(f: list[str]) -> Reading:
    if not all(re.fullmatch(r"\d*", part, re.ASCII) for part in f[1:4]):
        raise Malformed(f"{'-'.join(f[1:4])!r} is no date")
    return Reading({}, utc=_utc(f[0]), day=_date(f[1], f[2], f[3]))


# Names of transducers in XDR: type, unit and name to ours. Makers choose the names; accelerations have no type of their own.
ACCELERATIONS = {
    f"ACC{axis}": f"acceleration_{name}_m_s2" for axis, name in zip("XYZ", ("surge", "sway", "heave"), strict=True)
}
TRANSDUCERS = {
    ("A", "D", "ROLL"): "roll_deg",
    ("A", "D", "PTCH"): "pitch_deg",
    ("A", "D", "PITCH"): "pitch_deg",
    **{("G", "", name): column for name, column in ACCELERATIONS.items()},
}


def _xdr(f: list[str]) -> Reading:
    """Transducers: type, value, unit and name of each; roll with starboard down and pitch with the bow up are positive."""
    found = {}
    for kind, value, unit, name in zip(*(f[i::4] for i in range(4)), strict=False):
        column = TRANSDUCERS.get((kind, unit, name.upper()))
        if column is not None:
            found[column] = _number(value, -180, 180)
    return Reading(_known(**found))


def _vbw(f: list[str]) -> Reading:
    """Speed through the water ahead in knots, minus: astern, and its status; what follows, athwart and over ground, is unread."""
    return Reading(_known(speed_through_water_m_s=_scaled(f[0], -100, 100, KNOT)), _flag(f[2]))


def _vhw(f: list[str]) -> Reading:
    """Speed through the water in knots, which has no sign; the headings before it are unread."""
    return Reading(_known(speed_through_water_m_s=_scaled(_unit(f[4], f[5], "N"), 0, 100, KNOT)))


def _dpt(f: list[str]) -> Reading:
    """Depth below the transducer, and how far it lies below the waterline; minus: above the keel, and no depth of the water."""
    below, offset = _number(f[0], 0, 12000), _number(f[1], 0, 100)
    return Reading({} if below is None or offset is None else {"depth_m": below + offset})


def _prc(f: list[str]) -> Reading:
    """Orders to the engine: lever and status, revolutions (R: per minute), pitch, place of command, shaft."""
    if not re.fullmatch(r"\d{0,2}", f[7], re.ASCII):
        raise Malformed(f"{f[7]!r} is no shaft")
    order = _scaled(f[2], -6000, 6000, 1 / 60) if f[3] == "R" else None
    return Reading(_known(engine_order_rps=order), device=f"S{int(f[7] or 0)}")


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
    "XDR": (4, _xdr),
    "VBW": (3, _vbw),
    "VHW": (6, _vhw),
    "DPT": (2, _dpt),
    "PRC": (8, _prc),
}
TIMED = ("GGA", "GNS", "RMC", "ZDA")
