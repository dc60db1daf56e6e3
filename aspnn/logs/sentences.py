"""A strict codec of NMEA 0183 (IEC 61162-1) sentences: frame and checksum; readings.py reads the fields.

Pure functions on text; `decode` returns what is wrong and never raises. A sentence is `$`, talker (2), formatter (3), fields,
`*hh`: the exclusive or of the bytes between `$` and `*`. Sentences beyond the 82 characters of the standard are read: the
limit spares listeners' buffers, while precise receivers write more decimals; the checksum tells whether one is whole.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from functools import reduce
from operator import xor

from aspnn.logs.readings import FORMATTERS, Malformed, Reading


class Fault(StrEnum):
    """Why a sentence was not taken."""

    checksum = "checksum"
    no_checksum = "no_checksum"
    malformed = "malformed"
    unknown_sentence = "unknown_sentence"
    invalid_flag = "invalid_flag"
    no_time = "no_time"


@dataclass(frozen=True)
class Bad:
    """A piece of a line that is not a good sentence. `text` is that of an encapsulated one (`!`, AIS) with a right checksum,
    which others read."""

    fault: Fault
    reason: str
    text: str = ""


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


def unix_of(reading: Reading) -> float | None:
    """Time [s, UNIX] of a reading with time and day (RMC, ZDA); None for others."""
    utc, day = reading.utc, reading.day
    if utc is None or day is None:
        return None
    return datetime(day.year, day.month, day.day, tzinfo=UTC).timestamp() + utc


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
        whole = text if text[0] == "!" else ""
        return Bad(Fault.unknown_sentence, f"{address[:12]} is not read", whole)  # encapsulated or proprietary
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
    except Malformed as error:
        return Bad(Fault.malformed, f"{address}: {error}")
