"""Time of what a bridge does ten times a second, on one thread: rows through the filters, the situation, what-if; and its size.

python tests/benchmarks/bench_live.py [SECONDS]

The simulated bridge of data/scenarios/harbour.toml with her chart and her checkpoint, ten minutes of states behind her at 10 Hz, in a
turn under 10 degrees of rudder. SECONDS (30) of sailing for each number of other ships, those within 3 km of her (a third of them
within 1 km) on courses of their own, a report of each every 6 s. `take` brings one row through the filters (reports of others included),
`look` makes the situation, `look, full` only those that reckon other ships and regions anew, `tick` is both: at 10 Hz it
has 100 ms. `what if` is a fan of 15 orders and a plan, alone and with a place to clear. Median and 99 % of calls on the wall clock, and of
the processor, which other programs change least; the last column is the median of the processor's over that of a look without other ships.
"""

import json
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aspnn.frames import to_geodetic
from aspnn.live.bridge import CHANNEL, SimulatedBridge
from aspnn.live.chart import read_chart
from aspnn.live.core import Core
from aspnn.live.start import settings_of
from aspnn.live.whatif import WhatIf
from aspnn.logs.ais_messages import Report, Static
from aspnn.prediction import Predictor
from aspnn.simulation.scenario import read_scenario

ROOT = Path(__file__).parents[2]
BEGAN = 1_700_000_000.0  # s, UNIX
BEHIND = 600.0  # s of states
PERIOD = 0.1  # s
REPORTS = 6.0  # s between those of a ship
WARM = 10  # ticks before the count
FAN = {"plan": [[0, 20], [30, -10]], "fan": {"from": -35, "to": 35, "step": 5}}


@dataclass
class Timed:
    """Wall and processor times [ms] of calls by what they did."""

    found: dict[str, list[tuple[float, float]]] = field(default_factory=dict)

    @contextmanager
    def of(self, *what: str) -> Iterator[list[str]]:
        """Note how long what stands inside took, under each name that the list has at the end."""
        names = list(what)
        wall, processor = time.perf_counter(), time.process_time()
        yield names
        took = 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processor)
        for name in names:
            self.found.setdefault(name, []).append(took)


def sailed() -> tuple[Core, float]:
    """The core after BEHIND seconds, and the time then [s, UNIX]."""
    scenario = read_scenario(ROOT / "data/scenarios/harbour.toml")
    start = scenario.start.model_copy(update={"latitude_deg": scenario.start.latitude_deg - 0.03})
    ship = SimulatedBridge(scenario.model_copy(update={"start": start}), BEGAN, traffic=False)
    chart = ROOT / "data/charts/sound.geojson"
    bridge = settings_of(ship, chart=chart)
    core = Core(bridge, Predictor.load(ROOT / "checkpoints/cargo90"), read_chart(chart, bridge.zone), simulated=ship)
    now = BEGAN
    while now < BEGAN + BEHIND:
        now += 20.0
        sail(core, now)
        core.take(now)
    return core, now


def sail(core: Core, now: float) -> None:
    """The simulated ship's sentences up to `now`."""
    for sent, line in core.simulated.advance(now):  # type: ignore[union-attr]
        core.feed(line, sent, CHANNEL)


class Fleet:
    """`count` ships on straight courses, which report in turn."""

    def __init__(self, core: Core, count: int, now: float):
        rng = np.random.default_rng(5)
        reach = np.where(np.arange(count) % 3 == 0, rng.uniform(150, 1000, count), rng.uniform(1000, 3000, count))
        around = rng.uniform(0, 2 * np.pi, count)
        at = core.simulated.state[0, :2]  # type: ignore[union-attr]
        self.place = complex(*at) + reach * np.exp(1j * around)
        self.course, self.speed = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, 8, count)
        self.began, self.told = now, now - REPORTS + REPORTS * np.arange(count) / max(count, 1)
        for k in range(count):
            core.targets.hear(Static(257_100_000 + k, 5, f"SHIP {k}", (60, 30, 8, 7), 5.0), now)

    def tell(self, core: Core, now: float) -> None:
        """The reports that are due by `now`."""
        for k in np.flatnonzero(self.told + REPORTS <= now + 1e-9):
            self.told[k] += REPORTS
            place = self.place[k] + self.speed[k] * np.exp(1j * self.course[k]) * (now - self.began)
            lat, lon = (math.degrees(x) for x in to_geodetic(place.real, place.imag, core.bridge.zone))
            true = math.degrees(self.course[k])
            said = Report(
                257_100_000 + int(k), 1, lat, lon, self.speed[k], true, true, 0.0, now % 60, True, True, False
            )
            core.targets.hear(said, now)


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    core, now = sailed()
    core.order(10.0, None)
    timed, sizes = Timed(), {}
    for count in (0, 10, 50):
        core.targets = type(core.targets)(core.bridge.zone)
        fleet, message = Fleet(core, count, now), {}
        for k in range(round(seconds / PERIOD) + WARM):
            now += PERIOD
            sail(core, now)
            counted = timed if k >= WARM else Timed()
            before = message.get("targets_time")
            with counted.of(f"tick, {count} others"):
                with counted.of(f"take, {count} others"):
                    fleet.tell(core, now)
                    core.take(now)
                with counted.of(f"look, {count} others") as names:
                    message = core.look(now)
                    if message["targets_time"] != before:
                        names.append(f"look, {count} others, full")
        with timed.of(f"JSON, {count} others"):
            size = len(json.dumps(message, separators=(",", ":")))
        sizes[count] = size, len(message["targets"])
        ahead = message["forecast"]
        clear = {"lat": ahead["lat"][-1], "lon": ahead["lon"][-1], "distance": 100}
        plain, cleared = WhatIf.model_validate(FAN), WhatIf.model_validate({**FAN, "clear": clear})
        for _ in range(5):
            with timed.of(f"what if, {count} others"):
                core.whatif(plain)
            with timed.of(f"what if, {count} others, clear"):
                core.whatif(cleared)
    unit = np.median(np.array(timed.found["look, 0 others"])[:, 1])
    print(f"{'[ms]':28s} {'calls':>6s} {'median':>8s} {'99 %':>8s} {'processor':>10s} {'99 %':>8s} {'ratio':>7s}")
    for what, found in timed.found.items():
        (median, processor), (late, late_processor) = np.percentile(found, [50, 99], axis=0)
        numbers = f"{median:8.1f} {late:8.1f} {processor:10.1f} {late_processor:8.1f} {processor / unit:7.2f}"
        print(f"{what:28s} {len(found):6d} {numbers}")
    for count, (size, there) in sizes.items():
        print(f"message with {there} of {count} others: {size / 1000:.1f} kB")


if __name__ == "__main__":
    main()
