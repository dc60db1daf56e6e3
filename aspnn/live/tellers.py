"""Who tells what, online: of several senders of a quantity the one that is heard most, as importers of recordings choose.

Each kind of sentence has a score, one more for each that is heard, which halves every HALF seconds; one that is
heard about as often as another never takes its place (no flapping). Who is SILENT gives way to who is not.
"""

import math
from collections import defaultdict
from dataclasses import dataclass, field

from aspnn.live.n2k import FORMATTER
from aspnn.logs.nmea import POSITION, QUANTITIES, RENAMED, Key, NmeaMap
from aspnn.logs.sentences import Sentence

HALF = 10.0  # s in which a score halves
SILENT = 2.0  # s: who has told nothing for so long gives way to who has
LEAST = 1e-3  # a score below which a kind is forgotten
MOST = 256  # kinds that are remembered at once; a feed of nonsense names without end
STAY = 2.0  # by so much must another be heard more often than the one that is taken

Channels = tuple[tuple[str, tuple[str, ...]], ...]  # formatter and names of values, the preferred first
Choice = tuple[Key, tuple[str, ...]]


def _with_n2k(channels: Channels) -> Channels:
    return (*channels, *dict.fromkeys((FORMATTER, names) for _, names in channels))


PLACES = _with_n2k(POSITION)
TOLD = {what: _with_n2k(channels) for what, channels in QUANTITIES.items()}
TOLD["wind"] = (*QUANTITIES["wind"], (FORMATTER, ("wind_speed_true_m_s", "wind_angle_true_deg", "wind_from_true_deg")))


@dataclass
class Tellers:
    """Scores of the senders of `plan`, and `chosen`: what each antenna and quantity is taken from now."""

    plan: NmeaMap
    chosen: dict[str, Choice] = field(default_factory=dict)
    _heard: dict[Key, float] = field(default_factory=dict)
    _valued: dict[tuple[Key, str], float] = field(default_factory=dict)
    _talkers: dict[Key, str] = field(default_factory=dict)
    _told: dict[Key, float] = field(default_factory=dict)
    _columns: dict[tuple[Key, str], tuple[str, ...]] = field(default_factory=dict)
    _open: list[tuple[frozenset[str], str | None]] = field(default_factory=list)
    _last: float = -math.inf

    def hear(self, sentence: Sentence, good: bool, now: float) -> bool:
        """Count a sentence (also one flagged as invalid: its sender is there); False: there are too many kinds to remember it."""
        key = sentence.kind
        if key not in self._heard and len(self._heard) >= MOST:
            self._tick(now)
            return False
        new = key not in self._heard
        self._heard[key] = self._heard.get(key, 0.0) + 1.0
        self._talkers[key] = sentence.talker
        if good:
            for name in sentence.reading.values:
                new |= (key, name) not in self._valued
                self._valued[key, name] = self._valued.get((key, name), 0.0) + 1.0
            self._told[key] = now
        if (new and self._awaited(sentence)) or not 0.0 <= now - self._last < 1.0:
            self._tick(now)
        return True

    def columns(self, sentence: Sentence) -> list[tuple[str, float]]:
        """The columns of the log, with values, that a sentence fills: those it is the chosen teller of."""
        key, values = sentence.kind, sentence.reading.values
        return [(column, value) for name, value in values.items() for column in self._columns.get((key, name), ())]

    def _awaited(self, sentence: Sentence) -> bool:
        """Whether a kind of sentence may tell what nobody has told yet."""
        names = sentence.identity, sentence.talker, sentence.reading.device
        return any(sentence.formatter in some and (wanted is None or wanted in names) for some, wanted in self._open)

    def others(self, what: str) -> set[Key]:
        """Kinds that tell the quantity `what` too, and are not its chosen teller."""
        if what not in self.chosen:
            return set()
        key, names = self.chosen[what]
        return {k for k, name in self._valued if name in names and k[0] != key[0]}

    def strangers(self) -> set[str]:
        """Who tells positions and is no antenna, while there is an antenna of whose source nothing is heard."""
        if all(antenna in self.chosen for antenna in self.plan.antennas):
            return set()
        known = {self.chosen[antenna][0] for antenna in self.plan.antennas if antenna in self.chosen}
        return {key[0] for key, name in self._valued if name == "latitude_deg" and key not in known}

    def _tick(self, now: float) -> None:
        """Let scores fade, and choose anew."""
        elapsed = now - self._last
        if 0 < elapsed < math.inf:
            fade = 0.5 ** (elapsed / HALF)
            self._heard = {k: s for k, v in self._heard.items() if (s := v * fade) > LEAST}
            self._valued = {k: s for k, v in self._valued.items() if k[0] in self._heard and (s := v * fade) > LEAST}
            self._talkers = {k: t for k, t in self._talkers.items() if k in self._heard}
            self._told = {k: t for k, t in self._told.items() if k in self._heard}
        self._last = now
        sought: dict[str, tuple[Channels, str | None]] = {a: (PLACES, s.source) for a, s in self.plan.antennas.items()}
        sought |= {what: (channels, getattr(self.plan.sensors, what)) for what, channels in TOLD.items()}
        if self.plan.full_pitch_ratio is None:
            del sought["propeller_pitch"]
        # What is silent stays chosen: when it comes back, its first sentence is taken.
        found = {what: self._best(what, *asked) or self.chosen.get(what) for what, asked in sought.items()}
        self.chosen = {what: choice for what, choice in found.items() if choice is not None}
        still = [sought[what] for what in sought if what not in self.chosen]
        self._open = [(frozenset(formatter for formatter, _ in channels), wanted) for channels, wanted in still]
        columns: dict[tuple[Key, str], list[str]] = defaultdict(list)
        for what, (key, names) in self.chosen.items():
            for name in names:
                columns[key, name].append(f"{what}_{name}" if what in self.plan.antennas else RENAMED.get(name, name))
        self._columns = {pair: tuple(c) for pair, c in columns.items()}

    def _score(self, choice: Choice) -> float:
        return sum(self._valued.get((choice[0], name), 0.0) for name in choice[1])

    def _best(self, what: str, channels: Channels, wanted: str | None) -> Choice | None:
        """Of a source's own kinds, the preferred of those sent about as often: one often flagged as invalid is still it."""
        found = [
            (key, names)
            for formatter, names in channels
            for key in sorted(self._heard)
            if key[1] == formatter and any((key, name) in self._valued for name in names)
        ]
        if wanted is None:
            found = [c for c in found if not c[0][2].startswith("E")]
        else:
            found = [c for c in found if wanted in (c[0][2], c[0][0], self._talkers[c[0]])]
        if not found:
            return None
        found = [c for c in found if self._last - self._told.get(c[0], -math.inf) <= SILENT] or found
        most = max(found, key=self._score)
        now = self.chosen.get(what)
        if now in found and STAY * self._score(now) >= self._score(most):
            most = now
        same = [c for c in found if c[0][0] == most[0][0]]
        often = max(self._heard[c[0]] for c in same)
        return next(c for c in same if 2 * self._heard[c[0]] >= often)
