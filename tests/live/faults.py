"""What goes wrong on a bridge, put into the lines of a ship's sensors: for the tests here and for training/reproduce/soak_live.py.

A feed is (time of receipt [s, UNIX], line) pairs in the order in which they come. Each fault is a function from a feed to a feed,
with random numbers of its own.
"""

import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from aspnn.live.alarms import of_estimator, of_intake
from aspnn.live.config import Bridge, read_bridge
from aspnn.live.estimator import LiveEstimator
from aspnn.live.intake import Intake
from aspnn.live.row import Row
from aspnn.logs.nmea_write import to_nmea
from aspnn.logs.sentences import checksum, encode, encode_tag
from aspnn.records import Log
from aspnn.simulation import Scenario, simulate_scenario

Feed = Iterable[tuple[float, str]]
CHANNEL = "lan"
BRIDGE = """
[ship]
vessel = "cargo90"
zone = "33N"
[antennas]
bow = { source = "GP0001", station_m = [35.0, 0.0] }
stern = { source = "GN0001", station_m = [-35.0, 0.0] }
[[sources]]
kind = "udp"
name = "lan"
port = 10110
"""


def bridge(folder: Path, text: str = BRIDGE) -> Bridge:
    """The settings that read the ship of `voyage`."""
    (folder / "bridge.toml").write_text(text)
    return read_bridge(folder / "bridge.toml")


def voyage(seconds: float, seed: int = 5) -> Log:
    """A voyage of the cargo ship with random orders, at 10 Hz, in calm water."""
    start = {"speed_kn": 11.5, "latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": 350.0}
    data = {"name": "faults", "vessel": "cargo90", "duration_s": seconds, "seed": seed, "start": start}
    return next(simulate_scenario(Scenario.model_validate({**data, "manoeuvre": {"kind": "random-orders"}})))[0]


def feed_of(log: Log, delay: float = 0.005) -> list[tuple[float, str]]:
    """The sentences of a log, each received `delay` [s] after its TAG block's time."""
    lines = (line.rstrip("\r\n") for line in to_nmea(log))
    return [(float(line.partition("c:")[2].partition("*")[0]) / 1000 + delay, line) for line in lines]


def without(feed: Feed, address: str, begin: float, end: float) -> Iterator[tuple[float, str]]:
    """No sentence whose address ends with `address` ("GGA") between two times."""
    return ((t, line) for t, line in feed if not (begin <= t < end and f"{address}," in line))


def astray(feed: Feed, source: str, begin: float, minutes: float) -> Iterator[tuple[float, str]]:
    """Fixes (GGA) of `source` moved north by `minutes` of latitude from `begin` on, with right checksums."""
    for t, line in feed:
        head, _, body = line.partition("$")
        if t >= begin and f"s:{source}," in head and body[2:5] == "GGA":
            fields = body.partition("*")[0].split(",")
            fields[2] = f"{fields[2][:2]}{float(fields[2][2:]) + minutes:010.7f}"
            line = head + encode(body[:2], "GGA", fields[1:])
        yield t, line


def jumped(feed: Feed, begin: float, by: float) -> Iterator[tuple[float, str]]:
    """The clock of receipt, `by` seconds on (minus: back) from `begin` on; the ship's own times go on."""
    return ((t + by if t >= begin else t, line) for t, line in feed)


def receivers_jumped(feed: Feed, begin: float, by: float) -> Iterator[tuple[float, str]]:
    """The times that the fixes (GGA) tell, `by` seconds on from `begin` on, with right checksums; no date, no other times."""
    for t, line in feed:
        head, _, body = line.partition("$")
        if body[2:5] == "ZDA":
            continue
        if t >= begin and body[2:5] == "GGA":
            fields = body.partition("*")[0].split(",")
            hour, minute, second = int(fields[1][:2]), int(fields[1][2:4]), float(fields[1][4:])
            told = (hour * 3600 + minute * 60 + second + by) % 86400
            fields[1] = f"{int(told // 3600):02d}{int(told // 60 % 60):02d}{told % 60:06.3f}"
            line = head + encode(body[:2], "GGA", fields[1:])
        yield t, line


def damaged(feed: Feed, share: float, seed: int = 1) -> Iterator[tuple[float, str]]:
    """A `share` of the lines damaged, in equal parts: a byte changed, merged with the next line, without checksum, cut short."""
    rng, held = random.Random(seed), ""
    for t, line in feed:
        line, held = held + line, ""
        if rng.random() < share:
            kind = rng.randrange(4)
            if kind == 0:
                at = rng.randrange(len(line))
                line = line[:at] + chr(ord(line[at]) ^ (1 << rng.randrange(7))) + line[at + 1 :]
            elif kind == 1:
                held = line
                continue
            elif kind == 2:
                line = line.rpartition("*")[0]
            else:
                line = line[: rng.randrange(1, len(line))]
        yield t, line


def reordered(feed: Feed, within: float, seed: int = 1) -> list[tuple[float, str]]:
    """Each line comes up to `within` [s] later, by chance, as datagrams over several ways do."""
    rng = random.Random(seed)
    return sorted(((t + rng.uniform(0, within), line) for t, line in feed), key=lambda pair: pair[0])


WORDS = (
    "",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "-0",
    "9" * 60,
    "1e-400",
    "\x00",
    "0x1F",
    "٣",
    "+",
    ".",
    "A",
    "V",
    "\x1b[2J",
    "{",
    "$",
)
FORMATTERS = (
    "GGA",
    "GNS",
    "RMC",
    "VTG",
    "HDT",
    "THS",
    "ROT",
    "RSA",
    "ROR",
    "RPM",
    "MWV",
    "ZDA",
    "XDR",
    "VBW",
    "VHW",
    "DPT",
    "PRC",
)


def fuzz(feed: Feed, share: float, seed: int = 1) -> Iterator[tuple[float, str]]:
    """Before a `share` of the lines a made-up one: bytes, cut and mutated sentences, numbers that are none or huge with right
    checksums, control bytes, JSON, AIS, TAG blocks, lines of 4096 characters and more. The feed itself is whole."""
    rng, past = random.Random(seed), ["$"]
    for t, line in feed:
        if rng.random() < share:
            yield t, _nonsense(rng, past, t)
        yield t, line
        if len(past) < 200:
            past.append(line)


def _nonsense(rng: random.Random, past: list[str], t: float) -> str:
    kind, line = rng.randrange(10), rng.choice(past)
    if kind == 0:
        return "".join(map(chr, rng.choices(range(256), k=rng.randrange(200))))
    if kind == 1:
        return line[: rng.randrange(len(line))]
    if kind == 2:
        return "".join(chr(rng.randrange(256)) if rng.random() < 0.1 else c for c in line)
    if kind in (3, 4):  # right checksums around fields that are none
        fields = [
            rng.choice(WORDS) if rng.random() < 0.5 else f"{rng.gauss(0, 1e3):.3f}" for _ in range(rng.randrange(20))
        ]
        body = (
            ",".join(["ZZ" + rng.choice(FORMATTERS), *fields])
            .replace("*", "")
            .encode("latin-1", "ignore")
            .decode("latin-1")
        )
        return f"${body}*{checksum(body):02X}"
    if kind == 5:
        return encode_tag(f"Z{rng.randrange(10**6)}", t) + encode("ZZ", "HDT", [f"{rng.random() * 720 - 360:.2f}", "T"])
    if kind == 6:
        part = (
            ",".join(str(rng.randrange(-1, 12)) for _ in range(3))
            + ",A,"
            + "".join(rng.choices("0w1?`{", k=rng.randrange(90)))
        )
        return f"!AIVDM,{part},0*{checksum(f'AIVDM,{part},0'):02X}"
    if kind == 7:
        return "$" + "9" * rng.randrange(4000, 20_000)
    if kind == 8:
        value = rng.choice(("1e999", "null", "NaN", "[]", '{"value":"x"}', '"' + "7" * 50 + '"', "-1e308"))
        group = rng.choice((127250, 127251, 127245, 129025, 130306, 7, 10**30))
        fields = f'{{"Heading":{value},"Rate":{value},"Latitude":{value}}}'
        head = f'"timestamp":"2026-11-22T12:00:00Z","src":{rng.choice((3, -1, value))},"pgn":{group}'
        return f'{{{head},"fields":{fields}}}'
    return "\\" * rng.randrange(30) + "!$*,"[rng.randrange(4)] * rng.randrange(1, 60)


@dataclass
class Watch:
    """An intake and its filters, with the alarms as they come and go, as a bridge would have them. `taken` is told of the rows."""

    bridge: Bridge
    keep_s: float = 60.0
    taken: Callable[[list[Row], float], None] | None = None
    rows: list[Row] = field(default_factory=list)  # where nobody else takes them
    alarms: dict[str, tuple[float, float]] = field(default_factory=dict)  # code: first and last seen [s, of the rows]

    def __post_init__(self) -> None:
        self.intake = Intake(self.bridge)
        self.antennas = tuple(self.bridge.config.antennas)
        self.estimator = LiveEstimator(self.bridge.vessel, self.bridge.zone, self.keep_s, self.antennas)

    def play(self, feed: Feed, poll: float = 1.0) -> "Watch":
        """Feed everything; rows through the filters and a look at the alarms every `poll` seconds of receipt, and at the end."""
        asked = received = None
        for received, line in feed:
            self.intake.feed(line, received, CHANNEL)
            if asked is None or not 0 <= received - asked < poll:
                asked = received
                self.look(received)
        if received is not None:
            self.look(received)
            self._take(received + 1.0)
        return self

    def look(self, now: float) -> None:
        """Take what is ready at `now`, and note the alarms."""
        self._take(now)
        clock = self.intake.time(now)
        found = of_intake(self.intake.state(), self.antennas, [CHANNEL], clock) + of_estimator(
            self.estimator.state(), clock
        )
        for alarm in found:
            self.alarms[alarm.code] = self.alarms.get(alarm.code, (clock, clock))[0], clock

    def _take(self, now: float) -> None:
        rows = self.intake.rows(now)
        if self.taken is None:
            self.rows += rows
        else:
            self.taken(rows, now)
        self.estimator.push(rows)
