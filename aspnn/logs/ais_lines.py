"""The AIS sentences of a file (!AIVDM of other ships, !AIVDO of one's own), put together from their parts, and when they were heard.

A sentence is `!`, talker and VDM or VDO, how many parts the message has, which of them this is, a number that parts of a
message share, the radio channel, the armoured bits, how many bits fill the last character, `*hh`. People's files put a time
before it (ISO 8601, UNIX seconds or milliseconds), a TAG block of NMEA 4.10 (`\\s:station,c:time*hh\\`), or fields behind it
(`,rSTATION,1325376000`); a `$PGHP` sentence tells the time of the one that follows. Pure functions on text: nothing here raises.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from aspnn.logs.recording import unix
from aspnn.logs.sentences import checksum

APART = 100  # lines: parts further from each other are of two messages whose numbers are alike; numbers come round after ten


class Fault(StrEnum):
    """Why a piece of a line tells nothing."""

    checksum = "checksum"
    no_checksum = "no_checksum"
    malformed = "malformed"
    incomplete = "incomplete"  # a part whose message is not whole
    undecodable = "undecodable"  # bits that are no message of their type


class Heard(NamedTuple):
    """A whole message: its sentences without checksum troubles, in the order of the parts; `line` is that of the last part.

    `received` [s, UNIX] is NaN where the file does not tell it; `own` whether it is the ship's own (VDO).
    """

    sentences: tuple[bytes, ...]
    received: float
    own: bool
    line: int


@dataclass
class Tally:
    """What a file holds, counted as it is read. `others` are sentences that are not of AIS."""

    lines: int = 0
    sentences: int = 0
    others: int = 0
    faults: Counter[Fault] = field(default_factory=Counter)
    first_bad: str = ""

    def bad(self, line: int, fault: Fault, reason: str, count: int = 1) -> None:
        """Count something that tells nothing; the first is told with its line."""
        self.faults[fault] += count
        self.first_bad = self.first_bad or f"line {line}: {fault.value}, {reason}"


_TIME = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?|\d{13}|\d{10}(?:\.\d+)?"  # no MMSI has ten digits
_HEAD = re.compile(
    rf"[\s\[(\"']*(?:(?P<time>{_TIME})[\s\])\"',;:|]*)?(?:UdPbC\0)?(?P<tags>(?:\\[^\\]*\\)*)\s*", re.ASCII
)
_TAIL = re.compile(rf"[,;\s][\s\[(\"']*(?P<time>{_TIME})[\s\])\"',;]*$", re.ASCII)
_TAG = re.compile(r"\\([^\\*]*)(?:\*([0-9A-Fa-f]{2}))?\\")
_PIECE = re.compile(r"([!$][^*\\\s]*)(?:\*([0-9A-Fa-f]{2}))?(.*)", re.DOTALL)
_VDM = re.compile(r"![A-Z]{2}VD([MO]),([1-9]),([1-9]),(\d?),([^,]*),([0-W`-w]+),([0-5])", re.ASCII)


class Part(NamedTuple):
    """A sentence of AIS with a right checksum, when it was received [s, UNIX; NaN: not told], and the line it stood on."""

    sentence: str
    received: float
    line: int


class Assembler:
    """Puts messages together from their parts, which may come in any order and among those of others; few wait at a time."""

    def __init__(self, tally: Tally):
        self.tally = tally
        self.waiting: dict[tuple, dict[int, Part]] = {}

    def take(self, part: Part) -> Heard | None:
        """The whole message that `part` completes, if any; what is no sentence of AIS is only counted."""
        tally = self.tally
        match = _VDM.fullmatch(part.sentence.partition("*")[0])
        if match is None:
            if re.match(r"![A-Z]{2}VD[MO],", part.sentence):
                tally.sentences += 1
                tally.bad(part.line, Fault.malformed, f"{part.sentence[:40]!r} is no AIS sentence")
            else:
                tally.others += 1
            return None
        tally.sentences += 1
        kind, total, number, sequence, channel, *_ = match.groups()
        count, which, own = int(total), int(number), kind == "O"
        if which > count:
            tally.bad(part.line, Fault.malformed, f"part {which} of {count}")
            return None
        if count == 1:
            return Heard((part.sentence.encode("latin-1"),), part.received, own, part.line)
        key = (kind, count, sequence, channel)
        parts = self.waiting.setdefault(key, {})
        if parts and (which in parts or part.line - max(p.line for p in parts.values()) > APART):
            self._give_up(parts)
            parts = self.waiting[key] = {}
        parts[which] = part
        if len(parts) < count:
            if len(self.waiting) > APART:  # more kinds of parts than lines that they may lie apart: the oldest is lost
                self._give_up(
                    self.waiting.pop(min(self.waiting, key=lambda k: max(p.line for p in self.waiting[k].values())))
                )
            return None
        del self.waiting[key]
        inside = [parts[i] for i in sorted(parts)]
        received = next((p.received for p in inside if p.received == p.received), float("nan"))
        return Heard(tuple(p.sentence.encode("latin-1") for p in inside), received, own, part.line)

    def finish(self) -> None:
        """Count the parts whose message never became whole."""
        for parts in self.waiting.values():
            self._give_up(parts)
        self.waiting.clear()

    def _give_up(self, parts: dict[int, Part]) -> None:
        first = min(p.line for p in parts.values())
        reason = f"part {min(parts)} of a message whose other parts are missing"
        self.tally.bad(first, Fault.incomplete, reason, len(parts))


def read_messages(file: Path, tally: Tally) -> Iterator[Heard]:
    """The whole messages of a file in the order of their last parts; `tally` counts what else is there."""
    assembler = Assembler(tally)
    told = float("nan")  # by $PGHP, for the sentence that follows
    with open(file, "rb") as stream:
        for line, raw in enumerate(stream, 1):
            text = raw.decode("latin-1")
            tally.lines += bool(text.strip())
            for sentence, received in _pieces(text, line, tally):
                if sentence.startswith("$PGHP,"):
                    told = _gatehouse(sentence)
                if _VDM.fullmatch(sentence.partition("*")[0]):
                    received, told = (told if received != received else received), float("nan")
                heard = assembler.take(Part(sentence, received, line))
                if heard is not None:
                    yield heard
    assembler.finish()


def _pieces(text: str, line: int, tally: Tally) -> Iterator[tuple[str, float]]:
    """The sentences of a line with right checksums, each with the time [s, UNIX] at which it was received, NaN if not told.

    A sentence beside text that cannot be read is kept, without a time; one after a TAG block whose checksum is wrong is not,
    since its time cannot be trusted.
    """
    head, *pieces = re.split(r"(?=[!$])", text)
    if not pieces:
        if head.strip() and not head.lstrip().startswith("#"):
            tally.bad(line, Fault.malformed, "no sentence on the line")
        return
    for i, piece in enumerate(pieces):
        match = _PIECE.fullmatch(piece)
        assert match is not None  # a piece begins with ! or $, and the rest of the pattern takes anything
        body, given, after = match.groups()
        last = i == len(pieces) - 1
        try:
            received = _before(head)
            if last and received != received:
                received = _behind(after)
        except _Wrong as wrong:
            tally.sentences += 1
            tally.bad(line, wrong.fault, wrong.reason)
        else:
            if body.startswith("$") and (not given or int(given, 16) != checksum(body[1:])):
                tally.others += 1
            elif not given:
                tally.sentences += 1
                tally.bad(line, Fault.no_checksum, f"{body[:12]!r} has no checksum")
            elif int(given, 16) != checksum(body[1:]):
                tally.sentences += 1
                reason = f"{body[:12]!r} has checksum {given}, its bytes give {checksum(body[1:]):02X}"
                tally.bad(line, Fault.checksum, reason)
            else:
                yield f"{body}*{given}", received
        head = after


class _Wrong(Exception):
    """A TAG block that cannot be trusted."""

    def __init__(self, fault: Fault, reason: str):
        super().__init__(reason)
        self.fault, self.reason = fault, reason


def _before(text: str) -> float:
    """Time [s, UNIX] told before a sentence; of two the logger's, which one clock has written on every line. Raises _Wrong."""
    match = _HEAD.fullmatch(text)
    if match is None:
        return float("nan")
    told = float("nan")
    for body, given in _TAG.findall(match["tags"]):
        if not given:
            raise _Wrong(Fault.no_checksum, "TAG block without checksum")
        if int(given, 16) != checksum(body):
            raise _Wrong(Fault.checksum, f"TAG block has checksum {given}, its bytes give {checksum(body):02X}")
        for key, _, value in (part.partition(":") for part in body.split(",")):
            if key == "c" and re.fullmatch(r"\d{9,10}(\.\d+)?|\d{13}", value, re.ASCII):
                told = _number(value)
    return _instant(match["time"]) if match["time"] else told


def _behind(text: str) -> float:
    """Time [s, UNIX] that ends the fields behind a sentence, NaN where none does."""
    match = _TAIL.search(text)
    return _instant(match["time"]) if match else float("nan")


def _instant(text: str) -> float:
    if "-" not in text:
        return _number(text)
    try:
        return unix(text.replace(",", "."))
    except ValueError:
        return float("nan")


def _number(text: str) -> float:
    """Seconds from a UNIX time in seconds or (13 digits) milliseconds."""
    return float(text) / 1000 if len(text.partition(".")[0]) > 11 else float(text)


def _gatehouse(sentence: str) -> float:
    """Time [s, UNIX] of a $PGHP sentence: type 1, then year, month, day, hour, minute, second, millisecond in UTC."""
    try:
        *whole, millisecond = (int(part) for part in sentence.split(",")[2:9])
        return datetime(*whole, tzinfo=UTC).timestamp() + millisecond / 1000  # type: ignore[arg-type,misc]
    except (ValueError, TypeError):
        return float("nan")
