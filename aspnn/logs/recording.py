"""What the lines of a recording hold, and when each sentence was true.

Before a sentence may stand the time of a logger (ISO 8601 or UNIX seconds) and the header and TAG blocks of IEC 61162-450,
with the sentence's source and time.

What has a time of its own (GGA, GNS, RMC, ZDA) stands at it. The day comes from RMC, ZDA, the logger's clock or the map, and
is carried over midnight. What has none (heading, rate of turn, rudder, ...) takes the time at which it was received, where the
recording tells that finer than to the second. Else it is placed by its order between two epochs of the clock sentences: the
k-th of n of its kind stands at the part k/n of the way, so that one sentence per fix stands at the fix, and ten are spread
evenly. In gaps of the recording, and before the first clock sentence, there is no telling: those are left out and counted.
"""

import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from aspnn.logs.readings import TIMED, Status
from aspnn.logs.sentences import Bad, Fault, Sentence, checksum, decode, unix_of

DAY = 86400.0
TOGETHER = 5e-4  # s: times closer than this are one epoch
NEIGHBOURS = 11  # sentences (odd), of which the median tells about when each was recorded
STRAY = 60.0  # s: a time further from that is damage that the checksum let pass, as it does once in 256
LATENCY = 1.0  # s: a fix is sent within about a second; a larger difference is the logger's clock


# A line: pieces that begin with $ or !, each after its head (logger's time, IEC 61162-450 header, TAG blocks).
_PIECE = re.compile(r"[$!]([^*\\]*)(\*[0-9A-Fa-f]{2})?(.*)", re.DOTALL)
_HEAD = re.compile(
    r"\s*(?:(?:(?P<iso>\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?)|(?P<unix>\d{9,10}(?:\.\d+)?|\d{13}))"
    r"[ ,\t]\s*)?(?:UdPbC\0)?(?P<tags>(?:\\[^\\]*\\)*)\s*",
    re.ASCII,
)
_TAG = re.compile(r"\\([^\\*]*)(?:\*([0-9A-Fa-f]{2}))?\\")


def read_line(line: bytes) -> list[Sentence | Bad]:
    """The sentences on a line, good and bad, in their order; none on a blank line. Several merged ones are parted.

    A sentence after an unreadable head is kept, without source and time, and the head counts as a malformed piece; one
    after a TAG block whose checksum is wrong is not, since its source cannot be trusted.
    """
    text = line.decode("latin-1")
    head, *pieces = re.split(r"(?=[$!])", text)
    if not pieces:
        return [Bad(Fault.malformed, "no sentence on the line")] if text.strip() else []
    found: list[Sentence | Bad] = []
    before = _head(head)
    if before is None:
        found.append(Bad(Fault.malformed, "unreadable text before the sentence"))
    for piece in pieces:
        match = _PIECE.fullmatch(piece)
        assert match is not None  # a piece begins with $ or !, and the rest of the pattern takes anything
        body, given, tail = match.groups()
        after = _head(tail)
        result: Sentence | Bad
        if isinstance(before, Bad):
            result = before
        elif after is None:
            result = Bad(Fault.malformed, "text after the sentence")
        else:
            result = decode(f"{piece[0]}{body}{given or ''}")
        if isinstance(result, Sentence) and isinstance(before, tuple):
            result = Sentence(result.talker, result.formatter, result.reading, *before)
        found.append(result)
        before = after
    return found


def stamp(line: bytes) -> float | None:
    """The time [s, UNIX] that a logger or a TAG block tells before the first sentence of a line; None where there is none."""
    before = _head(re.split(r"[$!]", line.decode("latin-1"), maxsplit=1)[0])
    return before[1] if isinstance(before, tuple) else None


def _head(text: str) -> tuple[str, float | None] | Bad | None:
    """Source and time from what stands before a sentence; Bad for a wrong TAG block, None where it cannot be read.

    Of two times the logger's is taken: one clock has written it on every line.
    """
    source, received = "", None
    if not text.strip():
        return source, received
    match = _HEAD.fullmatch(text)
    if match is None:
        return None
    for body, given in _TAG.findall(match["tags"]):
        if not given:
            return Bad(Fault.no_checksum, "TAG block without checksum")
        if int(given, 16) != checksum(body):
            return Bad(Fault.checksum, f"TAG block has checksum {given}, its bytes give {checksum(body):02X}")
        for key, _, value in (part.partition(":") for part in body.split(",")):
            if key == "s":
                source = value
            elif key == "c":
                if not re.fullmatch(r"\d{1,13}(\.\d{1,9})?", value, re.ASCII):
                    return Bad(Fault.malformed, f"TAG block has the time {value!r}")
                received = _of_number(value)
    if match["unix"]:
        received = _of_number(match["unix"])
    elif match["iso"]:
        try:
            received = unix(match["iso"])
        except ValueError:
            return None
    return source, received


def _of_number(text: str) -> float:
    """Seconds from a UNIX time in seconds or (13 digits) milliseconds."""
    return float(text) / 1000 if len(text.partition(".")[0]) > 11 else float(text)


@dataclass(frozen=True)
class Recording:
    """The sentences of a file with right checksums, in order, those flagged as invalid too: their clock counts.

    `taken` says which are good. `faults` counts the others of all `pieces`, which stand on `lines` that are not blank.
    """

    sentences: list[Sentence]
    taken: list[bool]
    faults: Counter[Fault]
    lines: int
    pieces: int
    first_bad: str


def read_recording(file: Path, simulator: bool = False) -> Recording:
    """The sentences of a file; nothing in it raises. Data flagged as simulated are good where `simulator` says so."""
    sentences: list[Sentence] = []
    taken: list[bool] = []
    faults: Counter[Fault] = Counter()
    lines, first_bad = 0, ""
    with open(file, "rb") as stream:
        for number, line in enumerate(stream, 1):
            pieces = read_line(line)
            lines += bool(pieces)
            for piece in pieces:
                if isinstance(piece, Bad):
                    bad = piece
                else:
                    status = piece.reading.status
                    sentences.append(piece)
                    taken.append(status is Status.valid or (simulator and status is Status.simulated))
                    if taken[-1]:
                        continue
                    bad = Bad(Fault.invalid_flag, f"{piece.talker}{piece.formatter} is flagged {status.name}")
                faults[bad.fault] += 1
                first_bad = first_bad or f"line {number}: {bad.fault.value}, {bad.reason}"
    return Recording(sentences, taken, faults, lines, sum(taken) + faults.total(), first_bad)


def clock(recording: Recording, start: float | None = None) -> tuple[np.ndarray, bool, float]:
    """The time [s, UNIX] of every sentence, NaN where it cannot be told; whether the day is known (`start`, a time [s, UNIX]
    of that day, where nothing in the recording tells it); and by how much [s] the logger's clock was ahead of UTC.

    A receiver without a fix runs on: its clock counts even then, once it has had one.
    """
    sentences = recording.sentences
    stamps = _steady(np.array([np.nan if s.received is None else s.received for s in sentences]))
    dated = (unix_of(s.reading) if good else None for s, good in zip(sentences, recording.taken, strict=True))
    own = _steady(np.array([np.nan if t is None else t for t in dated]))
    known = next((float(t[np.isfinite(t)][0]) for t in (own, stamps) if np.isfinite(t).any()), start)
    reference, fixed = known or 0.0, False
    for i, (sentence, good) in enumerate(zip(sentences, recording.taken, strict=True)):
        utc = sentence.reading.utc
        fixed = fixed or (good and utc is not None)
        if utc is None or not fixed:
            continue
        if np.isnan(own[i]):  # the day that brings it within half a day of the last
            own[i] = utc + DAY * round((reference - utc) / DAY)
        reference = float(own[i])
    own = _steady(own)
    both = np.isfinite(own) & np.isfinite(stamps)
    ahead = float(np.median(stamps[both] - own[both])) if both.any() else 0.0
    ahead = ahead if abs(ahead) > LATENCY else 0.0
    received = stamps - ahead
    if not (stamps[np.isfinite(stamps)] % 1).any():
        received[:] = np.nan  # whole seconds would heap the sentences of a second upon each other
    untimed = np.where(np.isfinite(received), received, _by_order(sentences, own))
    return np.where(np.isfinite(own), own, untimed), known is not None, ahead


def _steady(time: np.ndarray) -> np.ndarray:
    """`time` without what strays from its neighbours in the recording. Gaps and slow recordings are no straying."""
    known = np.flatnonzero(np.isfinite(time))
    if len(known) < NEIGHBOURS:
        return time
    t = time[known]
    padded = np.pad(t, NEIGHBOURS // 2, mode="symmetric")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS), axis=1)
    steady = np.full(len(time), np.nan)
    kept = np.abs(t - middle) <= max(STRAY, NEIGHBOURS * float(np.median(np.abs(np.diff(t)))))
    steady[known[kept]] = t[kept]
    return steady


def _by_order(sentences: list[Sentence], own: np.ndarray) -> np.ndarray:
    """Times of sentences without one by their order between epochs of the clock; NaN in gaps, and for fixes.

    The usual spacing of a kind is its median; an interval that would more than double it has a gap.
    """
    epochs: list[float] = []
    members: dict[tuple[str, str, str], list[tuple[int, int]]] = defaultdict(list)  # kind -> interval, sentence
    for i, (sentence, t) in enumerate(zip(sentences, own, strict=True)):
        if np.isfinite(t) and (not epochs or t > epochs[-1] + TOGETHER):
            epochs.append(float(t))
        if epochs and np.isnan(t) and sentence.formatter not in TIMED:
            members[sentence.kind].append((len(epochs) - 1, i))
    time = np.full(len(sentences), np.nan)
    for pairs in members.values():
        interval, index = np.array(pairs).T
        kept, first, count = np.unique(interval, return_index=True, return_counts=True)
        spacing = np.append(np.diff(epochs), np.nan)[kept] / count
        usual = float(np.nanmedian(spacing)) if np.isfinite(spacing).any() else 0.0
        spacing[spacing > 2 * usual] = np.nan
        if kept[-1] == len(epochs) - 1:
            spacing[-1] = usual  # the last interval has no end
        group = np.repeat(np.arange(len(kept)), count)
        time[index] = np.array(epochs)[interval] + (np.arange(len(index)) - first[group]) * spacing[group]
    return time


def unix(text: str) -> float:
    """UNIX time [s] of an ISO 8601 time; UTC where it names no offset. Raises ValueError."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
