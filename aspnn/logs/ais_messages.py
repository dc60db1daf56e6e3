"""What AIS messages say (ITU-R M.1371): position reports, static data, and the clock of base stations. pyais decodes the bits.

What a field calls unavailable is NaN: latitude 91, longitude 181, speed 1023 (102.3 kn), course 3600, heading 511, rate of turn -128.
"""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple

from aspnn.logs.readings import KNOT
from aspnn.schema import InputError

NAN = float("nan")
# message: the bits it has at least (5: some transponders leave out the last two, which are spare)
BITS = {1: 168, 2: 168, 3: 168, 4: 168, 5: 422, 11: 168, 18: 168, 19: 312, 24: 160, 27: 96}
POSITIONS, CLOCKS = (1, 2, 3, 18, 19, 27), (4, 11)
COARSE = 27  # the long-range report: whole tenths of a minute, knots and degrees, no second
ROT = 4.733  # ROT_AIS = 4.733 sqrt(degrees per minute)
NO_RATE = (
    126  # from here on no figure: 126 is 708 degrees per minute or more, 127 turning faster than 5 degrees in 30 s
)
UNITS = {1: 600_000.0, COARSE: 600.0}  # per degree: 1/10000 and 1/10 of a minute
SHIPS = range(200_000_000, 776_000_000)  # MMSI with the country of a ship first
CRAFT = range(980_000_000, 990_000_000)  # boats of a mother ship


class Undecodable(ValueError):
    """Bits that are no message of their type."""


class Static(NamedTuple):
    """Static data: `size` are the metres from the antenna to bow, stern, port and starboard (0: not told); draught [m]."""

    mmsi: int
    kind: int
    name: str
    size: tuple[int, int, int, int] | None
    draught: float


class Report(NamedTuple):
    """A position report; NaN where it tells nothing. `second` is the UTC second of the fix, `second` NaN: not told.

    `measured`: whether a receiver told the position (not manual input, dead reckoning, or a receiver that is out of order).
    `accurate`: the flag for 10 m or better. `turning`: the bow turns, but no sensor tells how fast.
    """

    mmsi: int
    kind: int
    latitude_deg: float
    longitude_deg: float
    speed_m_s: float
    course_deg: float
    heading_deg: float
    yaw_rate_deg_s: float
    second: float
    measured: bool
    accurate: bool
    turning: bool
    static: Static | None = None  # of message 19, which is both

    @property
    def told(self) -> tuple[float, ...]:
        """The numbers of the report: alike in the copies of it that several stations have heard."""
        return tuple(-1e9 if value != value else value for value in self[2:9])


class Clock(NamedTuple):
    """The time [s, UNIX] of a base station."""

    mmsi: int
    kind: int
    time: float


def codec() -> Any:
    """The module pyais. Raises InputError where it is not installed."""
    try:
        import pyais
    except ModuleNotFoundError:
        raise InputError("AIS needs pyais, which is not installed: pip install 'aspnn[ais]'") from None
    return pyais


def read_message(sentences: Sequence[bytes], pyais: Any) -> Report | Static | Clock | int:
    """What a whole message says, or its type (an int) where that is none of those read here. Raises Undecodable."""
    armoured = b"".join(sentence.split(b",")[5] for sentence in sentences)
    kind, bits = _six(armoured, 0), 6 * len(armoured) - int(sentences[-1].split(b",")[6][:1])
    if kind not in BITS:
        return kind
    if bits < BITS[kind]:
        raise Undecodable(f"message {kind} has {bits} bits, {BITS[kind]} are needed")
    try:
        said = pyais.decode(*sentences)
        if kind in CLOCKS:
            return Clock(said.mmsi, kind, _time(said))
        if kind in (5, 24):
            return _static(said)
        return _report(said, armoured)
    except (
        pyais.exceptions.AISBaseException,
        ArithmeticError,
        AttributeError,
        LookupError,
        TypeError,
        ValueError,
    ) as e:
        raise Undecodable(f"message {kind}: {type(e).__name__}") from None


def _six(armoured: bytes, place: int) -> int:
    """The six bits of the character at `place`."""
    value = armoured[place] - 48
    return value - 8 if value > 40 else value


def _report(said: Any, armoured: bytes) -> Report:
    kind = said.msg_type
    unit = UNITS.get(kind, UNITS[1])
    # pyais rounds degrees to six decimals (0.1 m): back to the units that were sent.
    latitude, longitude = (round(angle * unit) / unit for angle in (said.lat, said.lon))
    known = abs(latitude) <= 90 and abs(longitude) <= 180
    speed = said.speed if said.speed < (63 if kind == COARSE else 102.25) else NAN
    heading = NAN if kind == COARSE else float(said.heading)
    second = 60 if kind == COARSE else said.second
    code = _turn(armoured) if kind in (1, 2, 3) else -128
    rate = math.copysign((code / ROT) ** 2 / 60, code) if abs(code) < NO_RATE else NAN
    return Report(
        mmsi=said.mmsi,
        kind=kind,
        latitude_deg=latitude if known else NAN,
        longitude_deg=longitude if known else NAN,
        speed_m_s=speed * KNOT,
        course_deg=float(said.course) if said.course < 360 else NAN,
        heading_deg=heading % 360 if heading <= 360 else NAN,
        yaw_rate_deg_s=rate,
        second=float(second) if second < 60 else NAN,
        measured=second <= 60,
        accurate=bool(said.accuracy),
        turning=abs(code) in (126, 127),
        static=_static(said) if kind == 19 else None,
    )


def _turn(armoured: bytes) -> int:
    """The rate-of-turn code, bits 42 to 49 of messages 1 to 3, signed; pyais rounds what it means to whole degrees per minute."""
    code = _six(armoured, 7) << 2 | _six(armoured, 8) >> 4
    return code - 256 if code > 127 else code


def _static(said: Any) -> Static:
    sides = [getattr(said, f"to_{side}", 0) for side in ("bow", "stern", "port", "starboard")]
    size = (sides[0], sides[1], sides[2], sides[3]) if any(sides) else None
    name = " ".join(getattr(said, "shipname", "").split())
    return Static(said.mmsi, said.msg_type, name, size, float(getattr(said, "draught", 0.0)))


def _time(said: Any) -> float:
    """Time [s, UNIX] of a base station; NaN where it is not told (its year 0, month 0, ...)."""
    try:
        moment = datetime(said.year, said.month, said.day, said.hour, said.minute, said.second, tzinfo=UTC)
    except ValueError:
        return NAN
    return moment.timestamp()


def is_ship(mmsi: int) -> bool:
    """Whether an MMSI is a vessel's: no coast station, aircraft, buoy or beacon."""
    return mmsi in SHIPS or mmsi in CRAFT
