"""What an intake has heard, for others: AIS messages, and its state as the alarms ask for it."""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from aspnn.live.clocks import Event
from aspnn.live.receivers import Disagreement
from aspnn.logs.ais_messages import Clock, Report, Static
from aspnn.logs.sentences import Fault

SLOTS, SLOT = 12, 10.0  # so many slots of so many seconds are the two minutes of `Late`
DAMAGED = (Fault.checksum.value, Fault.no_checksum.value, Fault.malformed.value)


class Ais(NamedTuple):
    """An AIS message: when it was received [s, UNIX, of the rows], whether it is the ship's own, what it says."""

    time: float
    own: bool
    said: Report | Static | Clock
    channel: str


class Late(NamedTuple):
    """Sentences of a channel in the last two minutes, and how many of them were damaged, and came too late."""

    sentences: int
    damaged: int
    late: int


@dataclass(frozen=True)
class IntakeState:
    """What the alarms ask of an intake: by channel and by column when it was last heard [s, UNIX, of the rows], counts by channel, those
    of the last two minutes, receivers that disagree, the last jump of a clock, and who tells positions that are no antenna's."""

    began: float
    heard: dict[str, float]
    told: dict[str, float]
    counts: dict[str, dict[str, int]]
    disagree: dict[str, Disagreement]
    jumped: Event | None
    of_late: dict[str, Late] = field(default_factory=dict)
    strangers: tuple[str, ...] = ()


class Recent:
    """Counts of the last two minutes by channel."""

    def __init__(self) -> None:
        self._slots: dict[str, deque[list[int]]] = {}  # number of the slot, then as in Late

    def count(self, channel: str, received: float, fault: str | None) -> None:
        """A sentence that came at `received` [s, UNIX], with what was wrong with it."""
        slots = self._slots.setdefault(channel, deque(maxlen=SLOTS))
        slot = int(received // SLOT)
        if not slots or slots[-1][0] != slot:
            slots.append([slot, 0, 0, 0])
        slots[-1][1] += 1
        slots[-1][2] += fault in DAMAGED
        slots[-1][3] += fault == "late"

    def of_late(self, received: float) -> dict[str, Late]:
        """What came in the two minutes before `received` [s, UNIX]."""
        first = received // SLOT - SLOTS
        return {
            channel: Late(*(sum(slot[i] for slot in slots if slot[0] > first) for i in (1, 2, 3)))
            for channel, slots in self._slots.items()
        }
