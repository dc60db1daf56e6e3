"""What time it is: the clock of receipt against that of the receivers, and when each sentence was true.

Rows of the estimator stand on one clock, which must neither jump nor run back: that of receipt (`received`, s UNIX, steady), less
the seconds that it was found to be ahead of UTC. As in recorded files (logs.recording) a fix stands at its own time; what has none
takes the time of its TAG block, where that is finer than to the second, else that of receipt. A clock within LATENCY of another
counts as right: so long may a sentence be on its way.

A receiver whose clock jumps (a week number, leap seconds, a fault) is believed in the new time once it has kept to it for JUMP
sentences, and counts from there on as off by that jump, so that the rows go on. Until then its sentences have no time.
"""

import math
from collections import deque
from statistics import median
from typing import NamedTuple

from aspnn.logs.readings import Reading
from aspnn.logs.recording import DAY, LATENCY
from aspnn.logs.sentences import Sentence, unix_of

RECENT = 31  # sentences whose median tells how a clock stands to that of receipt
JUMP = 5  # sentences in a row that tell the same other time: the clock has jumped
DATES = 2  # sentences with a date that must agree before they move the clock of receipt
DRIFT = 5e-4  # s per second that a computer's clock drifts at most
MOST = 64  # senders with a clock that are remembered


class Event(NamedTuple):
    """Something that happened, with the time [s, UNIX, of the rows] and a line for people."""

    time: float
    code: str
    text: str


class _Sender:
    """How the clock of one sender stands to that of receipt: differences [s] of late, and what is taken off its times."""

    def __init__(self) -> None:
        self.recent: deque[float] = deque(maxlen=RECENT)
        self.strays: deque[float] = deque(maxlen=JUMP)
        self.off = 0.0
        self.anchor: float | None = None


class Clocks:
    """Times of sentences as they come. `events` are for the owner to take."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.begun = 0  # how often the clock of the rows became another; times before and after are not of one clock
        self.begin()

    def begin(self) -> None:
        """Forget everything that was learnt."""
        self.begun += 1
        self.ahead = 0.0  # s: of the clock of receipt before that of the rows
        self._first: float | None = None  # `ahead` as first learnt
        self._dated = False
        self._dates: list[float] = []
        self._senders: dict[str, _Sender] = {}
        self._drift: deque[float] = deque(maxlen=10 * RECENT)
        self._followed = float("-inf")  # when the drift was last followed
        self._leads: dict[str, deque[float]] = {}
        self._fine: set[str] = set()
        self._last = float("-inf")

    def now(self, received: float) -> float:
        """The time of the rows [s, UNIX] at an instant of the clock of receipt."""
        return received - self.ahead

    def runs_back(self, received: float) -> bool:
        """Whether the clock of receipt was set back; then everything begins anew."""
        back = self._last - received
        if back > LATENCY:
            self.begin()
            self._tell(
                received, "clock_jump", f"the clock of receipt was set back by {back:.1f} s; everything begins anew"
            )
            self._last = received
            return True
        self._last = max(self._last, received)
        return False

    def place(self, sentence: Sentence, received: float, channel: str) -> float | None:
        """When a good sentence was true [s, UNIX, of the rows]; None where that cannot be told now."""
        if sentence.reading.utc is not None:
            return self._own(sentence.identity, sentence.reading, received)
        stamp = sentence.received
        if stamp is None:
            return self.now(received)
        if stamp % 1:
            self._fine.add(channel)
        leads = self._leads.setdefault(channel, deque(maxlen=RECENT))
        leads.append(stamp - received)
        usual = median(leads)
        if channel not in self._fine or abs(leads[-1] - usual) > LATENCY:
            return self.now(received)
        return self.now(stamp if abs(usual) <= LATENCY else stamp - usual)

    def _own(self, identity: str, reading: Reading, received: float) -> float | None:
        """The time of a sentence that tells its own."""
        dated = reading.day is not None
        own = unix_of(reading)
        assert reading.utc is not None  # the caller's condition
        if own is None:  # the day that brings it within half a day
            own = reading.utc + DAY * round((self.now(received) - reading.utc) / DAY)
        apart = own - received
        if self._first is None:
            self._first = self.ahead = -apart if abs(apart) > LATENCY else 0.0
            self._dated = dated
            if self.ahead:
                self.begun += 1
                self._tell(
                    received,
                    "clock_off",
                    f"the clock of receipt is {self.ahead:+.1f} s off UTC; times are those of {identity}",
                )
        sender = self._senders.get(identity)
        if sender is None:
            if len(self._senders) >= MOST:
                return None
            sender = self._senders[identity] = _Sender()
            if abs(apart + self.ahead) > 2 * LATENCY and (self._dated or not dated):
                sender.off = apart + self.ahead
                self._tell(received, "clock_off", f"the clock of {identity} is {sender.off:+.1f} s off the others'")
        if dated and not self._dated and not self._first_date(apart, received):
            return None
        apart -= sender.off
        if sender.recent and abs(apart - median(sender.recent)) > LATENCY:
            sender.strays.append(apart)
            if len(sender.strays) < JUMP or max(sender.strays) - min(sender.strays) > LATENCY:
                return None
            jump = median(sender.strays) - median(sender.recent)
            sender.off += jump
            self._tell(
                received, "clock_jump", f"the clock of {identity} jumped by {jump:+.1f} s; it counts as off by that"
            )
            apart -= jump
            sender.recent.clear()
            sender.anchor = None
        sender.strays.clear()
        sender.recent.append(apart)
        self._follow(sender, received)
        return own - sender.off

    def _first_date(self, apart: float, received: float) -> bool:
        """Whether the first date may be believed: it agrees with the clock of receipt, or has been told DATES times."""
        if abs(apart + self.ahead) <= 2 * LATENCY:
            self._dated = True
            return True
        self._dates = [d for d in self._dates if abs(d - apart) <= LATENCY] + [apart]
        if len(self._dates) < DATES:
            return False
        last = self._last
        self.begin()
        self._last, self._dated, self._first, self.ahead = last, True, -apart, -apart
        self._tell(
            received, "clock_jump", f"the date puts the clock of receipt {-apart:+.1f} s off UTC; times are UTC now"
        )
        return False

    def _follow(self, sender: _Sender, received: float) -> None:
        """Let `ahead` follow the slow drift between the clock of receipt and UTC."""
        if sender.anchor is None:
            if len(sender.recent) >= JUMP:
                sender.anchor = median(sender.recent)
                self._followed = received if self._followed == float("-inf") else self._followed
            return
        self._drift.append(sender.recent[-1] - sender.anchor)
        if len(self._drift) >= RECENT and len(self._drift) % RECENT == 0:
            assert self._first is not None
            most, self._followed = DRIFT * abs(received - self._followed), received
            wanted = self._first - median(self._drift) - self.ahead
            # No clock drifts faster: the rest is sentences that are on their way for longer or less long than at first. A clock that was
            # learnt from sentences is right by the quickest of them: none comes before it was sent.
            moved = min(max(wanted, -math.inf if self._first else -most), most)
            self.ahead += moved
            self._drift = deque((d + wanted - moved for d in self._drift), self._drift.maxlen)
            for one in self._senders.values():
                one.anchor = None if one.anchor is None else one.anchor - (wanted - moved)

    def _tell(self, received: float, code: str, text: str) -> None:
        self.events.append(Event(self.now(received), code, text))
