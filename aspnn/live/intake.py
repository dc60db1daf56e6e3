"""From lines as they come to rows of a log in the order of time: a pure core, to which the caller tells what time it is.

A line may hold merged sentences, TAG blocks and the header of IEC 61162-450 (logs.recording reads it, as it reads files), or a
decoded NMEA 2000 message (n2k.py). What tells nothing is counted by its fault and channel, and nothing raises. Values leave in rows on
a grid of `rate_hz`, each at the epoch of its fix where it has one (the values of a row are at most half a period off), else at the
point of the grid.

A row waits for what comes late or out of order until everything that usually comes in it has come (rhythm.py), `latency_s` at most.
While values do come out of order, every row waits that long. What is true before a row that has left is late, counted and not used;
but when that row did not wait for it, because it comes seldom or unevenly, as an order may, it goes into the next row. When a row
leaves is decided as lines come, by their times of receipt alone: how often rows are asked for changes nothing in them.
"""

import math
import re
from collections import Counter, deque
from typing import Any

from aspnn.live.clocks import Clocks, Event
from aspnn.live.config import Bridge, N2kSource
from aspnn.live.heard import Ais, IntakeState, Recent
from aspnn.live.n2k import read_n2k
from aspnn.live.receivers import Receivers
from aspnn.live.rhythm import Rhythm
from aspnn.live.row import Row, RowMaker
from aspnn.live.tellers import Tellers
from aspnn.logs.ais_lines import Assembler, Part, Tally
from aspnn.logs.ais_messages import Undecodable, codec, read_message
from aspnn.logs.readings import Status
from aspnn.logs.recording import LATENCY, read_line
from aspnn.logs.sentences import Bad, Fault, Sentence
from aspnn.schema import InputError

LONGEST = 4096  # characters of a line; what is longer is no line of sentences
WAITING = 60.0  # s of rows that wait at most, when nobody takes them
MANY = 20  # rows that are worth filtering at once: the filters take as long for them as for one
PATIENT = 30.0  # s for which rows wait for all of `latency_s` after a value that came out of order
PLACES = ("_latitude_deg", "_longitude_deg")
TARGETS = 10_000  # AIS messages that wait at most


class Intake:
    """Lines in (`feed`), rows out (`rows`); AIS messages wait in `targets_in`, what happened in `events`, for others to take."""

    def __init__(self, bridge: Bridge):
        config = bridge.config
        self.rate, self.latency = config.rate_hz, max(config.latency_s, 0.5 / config.rate_hz)
        self.counts: dict[str, Counter[str]] = {source.name: Counter() for source in config.sources}
        self.targets_in: deque[Ais] = deque(maxlen=TARGETS)
        self.events: deque[Event] = deque(maxlen=1000)
        self._plan = config.map
        self._si = {source.name for source in config.sources if isinstance(source, N2kSource) and source.si}
        self._clocks, self._tellers = Clocks(), Tellers(self._plan)
        self._receivers = Receivers(bridge.vessel, tuple(config.antennas))
        self._tally = Tally()
        self._parts = Assembler(self._tally)
        self._pyais: Any = None
        self._waiting: dict[int, dict[str, list[tuple[float, float]]]] = {}
        self._ready: deque[Row] = deque()
        self._released = -math.inf  # the last point of the grid that has left
        self._rhythm, self._patient = Rhythm(), -math.inf  # until when all rows wait
        self._newest: dict[tuple[str, str, str], float] = {}
        self._heard: dict[str, float] = {}
        self._told: dict[str, float] = {}
        self._began = math.nan
        self._recent, self._maker = Recent(), RowMaker(self._plan)
        self._jumped: Event | None = None
        self.latest = -math.inf  # the last time of receipt [s, UNIX]: what time it is where only recordings are played

    def feed(self, text: str, received: float, channel: str) -> None:
        """Take one or more lines that came at `received` [s, UNIX] by `channel`."""
        if self._clocks.runs_back(received):
            for point in sorted(self._waiting):
                self._leave(point)
            self._begin_anew(0.0)
            self._take_events()
        self._let_go(received)
        self.latest = received
        counts = self.counts.setdefault(channel, Counter())
        for line in re.split(r"[\r\n]+", text):
            if line.strip():
                counts["lines"] += 1
                self._line(line, received, channel, counts)
        self._let_go_whole(self._clocks.now(received))
        while len(self._ready) > WAITING * self.rate:
            self._ready.popleft()
            counts["rows_lost"] += 1
        self._take_events()

    def rows(self, now: float) -> list[Row]:
        """The rows that are whole or have waited long enough at `now` [s, UNIX, of the clock of receipt], in the order of time."""
        self._let_go(now)
        self._take_events()
        found = list(self._ready)
        self._ready.clear()
        return found

    def _begin_anew(self, shift: float) -> None:
        """The clock of the rows is another from now on, by `shift` [s]: nothing is known of what comes, and what waits moves along."""
        points = round(shift * self.rate)
        self._waiting = {
            point + points: {column: [(t + shift, value) for t, value in told] for column, told in row.items()}
            for point, row in self._waiting.items()
        }
        if self._jumped is not None:
            self._jumped = self._jumped._replace(time=self._jumped.time + shift)
        self._newest.clear()
        self._heard.clear()
        self._told.clear()
        self._released, self._began = -math.inf, math.nan
        self._rhythm, self._patient = Rhythm(), -math.inf
        self._maker.begin()

    def _let_go(self, now: float) -> None:
        """Let the rows leave that have waited long enough at `now`."""
        if self._waiting:
            limit = self._clocks.now(now) - self.latency
            for point in sorted(k for k in self._waiting if k / self.rate <= limit + 1e-6):
                self._leave(point)

    def _let_go_whole(self, now: float) -> None:
        """Let the first rows leave as long as nothing is expected in them any more; `now` [s] is that of the rows."""
        while self._waiting and now >= self._patient:
            point = min(self._waiting)
            if now < (point - 0.5) / self.rate or not self._rhythm.done((point + 0.5) / self.rate):
                return
            self._leave(point)

    def _leave(self, point: int) -> None:
        row = self._maker.make(point / self.rate, self._waiting.pop(point), "rudder_order" in self._tellers.chosen)
        self._released = point
        self._maker.events += [Event(row.time, *said) for said in self._receivers.compare(row.time, row.values)]
        if row.values:
            self._ready.append(row)

    @property
    def many(self) -> bool:
        """Whether MANY rows are ready, so that they had better be taken now."""
        return len(self._ready) >= MANY

    def time(self, now: float) -> float:
        """The time of the rows at an instant of the clock of receipt [s, UNIX]."""
        return self._clocks.now(now)

    def state(self) -> IntakeState:
        """What the alarms ask of it, as it is now."""
        counts = {channel: dict(c) for channel, c in self.counts.items()}
        return IntakeState(
            self._began,
            dict(self._heard),
            dict(self._told),
            counts,
            dict(self._receivers.disagree),
            self._jumped,
            self._recent.of_late(self.latest),
            tuple(sorted(self._tellers.strangers())),
        )

    def told_by(self) -> dict[str, str]:
        """Who tells each antenna's position and each quantity now."""
        told = {what: " ".join(filter(None, key)) for what, (key, _) in self._tellers.chosen.items()}
        return told | ({"rudder_order": "derived from rudder"} if self._maker.derived else {})

    def _line(self, line: str, received: float, channel: str, counts: Counter[str]) -> None:
        pieces: list[Sentence | Bad]
        if len(line) > LONGEST:
            pieces = [Bad(Fault.malformed, "the line is too long")]
        elif line.lstrip().startswith("{"):
            pieces = [read_n2k(line, channel in self._si)]
        else:
            pieces = read_line(line.encode("latin-1", "replace"))
        for piece in pieces:
            fault = (
                self._sentence(piece, received, channel)
                if isinstance(piece, Sentence)
                else self._bad(piece, received, channel)
            )
            counts["sentences"] += 1
            counts[fault or "good"] += 1
            self._recent.count(channel, received, fault)
            if fault is None:
                self._heard[channel] = self._clocks.now(received)

    def _bad(self, piece: Bad, received: float, channel: str) -> str | None:
        """Why a piece is not taken; None for a sentence of AIS, which is taken here."""
        if not piece.text:
            return piece.fault.value
        self._tally.lines += 1
        faults = self._tally.faults.total()
        others = self._tally.others
        heard = self._parts.take(Part(piece.text, received, self._tally.lines))
        if heard is None:
            return (
                "unknown_sentence"
                if self._tally.others > others
                else "malformed"
                if self._tally.faults.total() > faults
                else None
            )
        try:
            self._pyais = self._pyais or codec()
            said = read_message(heard.sentences, self._pyais)
        except InputError as error:
            if "no_ais" not in self.counts[channel]:
                self._tell(received, "no_ais", str(error))
            return "no_ais"
        except Undecodable:
            return "undecodable"
        if not isinstance(said, int):
            self.targets_in.append(Ais(self._clocks.now(received), heard.own, said, channel))
        return None

    def _sentence(self, sentence: Sentence, received: float, channel: str) -> str | None:
        """Take a sentence: its values wait in their rows. Returns why not."""
        status = sentence.reading.status
        good = status is Status.valid or (self._plan.simulator and status is Status.simulated)
        if not self._tellers.hear(sentence, good, received):
            return "too_many_senders"
        if not good:
            return Fault.invalid_flag.value
        begun, before = self._clocks.begun, self._clocks.now(received)
        time = self._clocks.place(sentence, received, channel)
        if self._clocks.begun != begun:
            self._begin_anew(self._clocks.now(received) - before)
        if time is None:
            return Fault.no_time.value
        now = self._clocks.now(received)
        self._began = now if math.isnan(self._began) else self._began
        if time > now + LATENCY:
            return "early"
        point = math.floor(time * self.rate + 0.5)
        columns = self._tellers.columns(sentence)
        heading = sentence.reading.values.get("heading_deg")
        if heading is not None and not columns and sentence.kind in self._tellers.others("heading"):
            self._receivers.other_heading(sentence.identity, time, heading)
        if not columns:
            return None
        if time < self._newest.get(sentence.kind, -math.inf):
            self._patient = now + PATIENT
            self.counts[channel]["out_of_order"] += 1  # and used, unless it is late
        self._newest[sentence.kind] = time
        for column, _ in columns:
            self._rhythm.hear(column, time)
        if point <= self._released:
            if point / self.rate <= now - self.latency or any(column.endswith(PLACES) for column, _ in columns):
                return "late"
            point = int(self._released) + 1
        row = self._waiting.setdefault(point, {})
        for column, value in columns:
            row.setdefault(column, []).append((time, value))
            self._told[column] = max(time, self._told.get(column, -math.inf))
        if len(self._newest) > 1000:
            self._newest.clear()
        return None

    def _take_events(self) -> None:
        for event in self._clocks.events:
            self.events.append(event)
            if event.code == "clock_jump":
                self._jumped = event
        self.events += self._maker.events
        self._clocks.events.clear()
        self._maker.events.clear()

    def _tell(self, received: float, code: str, text: str) -> None:
        self.events.append(Event(self._clocks.now(received), code, text))
