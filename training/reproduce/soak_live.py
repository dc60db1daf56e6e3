"""The live intake, filters and record over long runs and under faults: a table, and exit code 1 when anything is lost or wrong.

    python training/reproduce/soak_live.py [--parts faults fuzz hour day fast] [--lines 1000000] [--hours 24] [--fast-hours 6]

faults  five minutes of a simulated ship with each fault of tests/live/faults.py: the alarms that must come, and no others
fuzz    a whole feed with as many lines of nonsense between its own: never an exception, and the whole feed's rows in the record
hour    a recording of an hour at 10 Hz, played at 100 x through sources, intake, filters, predictions and record: every row is there
day     24 hours at 1 Hz as fast as it goes, the memory of the process at its marks
fast    six hours at 10 Hz likewise (24 would take four times as long, and show no more)

`hour`, `day` and `fast` predict with checkpoints/cargo90. Files lie in a temporary folder, about 1 GB for `fast`.
"""

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "live"))

import faults  # noqa: E402
import numpy as np  # noqa: E402
import pyarrow.parquet as pq  # noqa: E402

from aspnn.live import sources  # noqa: E402
from aspnn.live.config import FileSource  # noqa: E402
from aspnn.live.core import Core  # noqa: E402
from aspnn.live.record import Recorder  # noqa: E402
from aspnn.logs.nmea_write import write_nmea  # noqa: E402
from aspnn.prediction import Predictor  # noqa: E402

PARTS = ("faults", "fuzz", "hour", "day", "fast")
SPEED = 100.0
LOOK = 60.0  # s of the ship between predictions of `day` and `fast`
START = {"filter_waiting"}  # alarms of every beginning


class Result(NamedTuple):
    """A line of the table."""

    part: str
    what: str
    said: str
    well: bool


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--lines", type=int, default=1_000_000)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--fast-hours", type=float, default=6.0)
    parser.add_argument("--play", nargs=2, help=argparse.SUPPRESS)  # a recording and a folder: in a process of its own
    asked = parser.parse_args()
    if asked.play:
        print(json.dumps(play(Path(asked.play[0]), Path(asked.play[1]))))
        return
    well = True
    for part in asked.parts:
        with tempfile.TemporaryDirectory() as folder:
            results = {
                "faults": lambda f: under_faults(f),
                "fuzz": lambda f: fuzzed(f, asked.lines),
                "hour": lambda f: hour(f),
                "day": lambda f: memory(f, "day", asked.hours, 10),
                "fast": lambda f: memory(f, "fast", asked.fast_hours, 1),
            }[part](Path(folder))
            for result in results:
                well &= result.well
                print(f"{result.part:7} {result.what:34} {'ok  ' if result.well else 'LOST'} {result.said}", flush=True)
    sys.exit(0 if well else 1)


def under_faults(folder: Path) -> Iterator[Result]:
    """Each fault by itself; which alarms come of it, and whether the rows go on."""
    bridge, log = faults.bridge(folder), faults.voyage(300.0)
    feed = faults.feed_of(log)
    begin = feed[0][0] + 60
    gnss = {"gnss_stale", "gnss_lost", "coasting"}
    behind = gnss - {"coasting"} | {"heading_lost", "silent_lan", "filter_behind"}
    cases = {
        "none": (feed, set(), set()),
        "GNSS lost for 60 s": (faults.without(feed, "GGA", begin, begin + 60), gnss, set()),
        "heading lost for 60 s": (
            faults.without(feed, "HDT", begin, begin + 60),
            {"heading_stale", "heading_lost"},
            set(),
        ),
        "two receivers disagree": (
            faults.astray(feed, "GN0001", begin, 0.05),
            {"disagree_bow_stern", "inconsistent_stern"},
            set(),
        ),
        "clock of receipt 10 s on": (
            faults.jumped(feed, begin, 10.0),
            {"clock_jump"},
            behind | {"inconsistent_bow", "inconsistent_stern"},
        ),
        "clock of receipt 10 s back": (faults.jumped(feed, begin, -10.0), {"clock_jump"}, set()),
        "clock of receipt 3 h on": (faults.jumped(feed, begin, 10_800.0), {"clock_jump"}, behind),
        "clock of receipt 3 h back": (faults.jumped(feed, begin, -10_800.0), {"clock_jump"}, set()),
        "clock of receipt to 1970": (faults.jumped(feed, begin, -begin), {"clock_jump"}, set()),
        "receivers 18 s on": (faults.receivers_jumped(feed, begin, 18.0), {"clock_jump"}, set()),
        "10 % damaged, merged, bare": (faults.damaged(feed, 0.1), {"damaged_lan"}, set()),
        "datagrams 0.15 s out of order": (faults.reordered(feed, 0.15), set(), set()),
        "datagrams 0.3 s out of order": (faults.reordered(feed, 0.3), {"late_lan"}, set()),
    }
    for what, (lines, needed, may) in cases.items():
        watch = faults.Watch(bridge).play(lines)
        found = set(watch.alarms) - START
        times = np.array([row.time for row in watch.rows])
        whole = len(times) == len(log.table) and watch.estimator.dropped == 0
        counts = watch.intake.counts[faults.CHANNEL]
        told = f"{len(times)} of {len(log.table)} rows, {counts['good']} of {counts['sentences']} sentences, alarms: "
        told += " ".join(sorted(found)) or "none"
        yield Result("faults", what, told, whole and needed <= found <= needed | may)


def fuzzed(folder: Path, lines: int) -> Iterator[Result]:
    """Half of `lines` a whole feed, half nonsense."""
    bridge = faults.bridge(folder)
    log = faults.voyage(max(60.0, lines / 2 / 81))
    recorder, handed = Recorder(folder / "record", bridge.vessel, bridge.zone, 1e4), [0]

    def taken(rows, now) -> None:
        handed[0] += len(rows)
        recorder.rows(rows)
        recorder.flush(now)

    watch, began = faults.Watch(bridge, taken=taken), time.process_time()
    watch.play(faults.fuzz(faults.feed_of(log), 1.0))
    took = time.process_time() - began
    recorder.close()
    counts, kept = watch.intake.counts[faults.CHANNEL], recorded(folder / "record")
    counted = sum(n for k, n in counts.items() if k not in ("lines", "sentences", "out_of_order", "rows_lost"))
    well = handed[0] == kept == len(log.table) and recorder.lost == 0 and counts["rows_lost"] == 0
    told = (
        f"{counts['lines']} lines, {counts['lines'] / took:.0f} a second; {kept} of {len(log.table)} rows in the record"
    )
    yield Result("fuzz", "rows", told, well)
    yield Result("fuzz", "every sentence counted", json.dumps(dict(counts)), counted == counts["sentences"])
    found = set(watch.alarms) - START - {"silent_lan"}
    yield Result("fuzz", "alarms", " ".join(sorted(found)), found == {"damaged_lan"})


def hour(folder: Path) -> Iterator[Result]:
    """An hour at 10 Hz at SPEED, as `aspnn serve` plays it."""
    log = faults.voyage(3600.0)
    write_nmea(log, folder / "hour.nmea")
    core, source = (
        core_of(folder),
        FileSource(kind="file", name=faults.CHANNEL, path=str(folder / "hour.nmea"), speed=SPEED),
    )
    looked = [0.0, 0]

    async def go() -> None:
        def take(text: str, received: float, channel: str) -> None:
            core.feed(text, received, channel)
            if core.intake.many:
                core.take(received)

        player = asyncio.create_task(sources.run(source, take, lambda event: None, time.monotonic))
        while not player.done():
            await asyncio.sleep(0.01)
            core.take(core.intake.latest)
            if time.monotonic() - looked[0] > 0.5:
                looked[0], looked[1] = time.monotonic(), looked[1] + 1
                core.look(core.intake.latest)
        player.result()

    began = time.monotonic()
    asyncio.run(go())
    took = time.monotonic() - began
    finish(core)
    kept, counts = recorded(folder / "record"), core.intake.counts[faults.CHANNEL]
    told = f"{kept} of {len(log.table)} rows in the record, {counts['good']} of {counts['lines']} sentences, "
    told += f"{3600 / took:.0f} x, {looked[1]} predictions"
    yield Result("hour", f"played at {SPEED:.0f} x", told, kept == len(log.table) and counts["good"] == counts["lines"])


def memory(folder: Path, part: str, hours: float, every: int) -> Iterator[Result]:
    """`hours` of every `every`-th row, as fast as it goes, in a process of its own; its memory after each hour."""
    log = faults.voyage(3600.0 * hours)
    log = replace(log, table=log.table.iloc[::every].reset_index(drop=True))
    rows = len(log.table)
    write_nmea(log, folder / "long.nmea")
    del log
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, __file__, "--play", str(folder / "long.nmea"), str(folder)],
        stdout=subprocess.PIPE,
        check=False,
    )
    if done.returncode:
        yield Result(part, "played", f"ended with {done.returncode}", False)
        return
    said = json.loads(done.stdout)
    kept, marks = recorded(folder / "record"), said["rss_mb"]
    took = time.monotonic() - began
    told = f"{kept} of {rows} rows in the record, {said['lines']} lines, {said['lines'] / took:.0f} a second with all that follows"
    yield Result(part, f"{hours:g} h at {10 / every:g} Hz", told, kept == rows)
    first = marks[min(1, len(marks) - 1)]  # when the states of 10 minutes and the first parts have been written
    told = (
        f"RSS {marks[0]:.0f} MB after 1 h, {first:.0f} after 2 h, {marks[-1]:.0f} at the end, {max(marks):.0f} at most"
    )
    yield Result(part, "memory", told, marks[-1] < 1.1 * first)


def play(path: Path, folder: Path) -> dict:
    """Play a recording as fast as it goes; lines, and the memory [MB] after each hour of it."""
    core = core_of(folder)
    marks: list[float] = []
    begun = looked = None
    for received, line in sources.timed_lines(path):
        begun, looked = (received, received) if begun is None or looked is None else (begun, looked)
        core.feed(line, received, faults.CHANNEL)
        if core.intake.many:
            core.take(received)
        if received - looked >= LOOK:
            looked = received
            core.take(received)
            core.look(received)
            core.events()
        if received - begun >= 3600.0 * (len(marks) + 1):
            marks.append(rss())
            print(f"{len(marks)} h: {marks[-1]:.0f} MB", file=sys.stderr, flush=True)
    finish(core)
    return {"lines": core.intake.counts[faults.CHANNEL]["lines"], "rss_mb": [*marks, rss()]}


def core_of(folder: Path) -> Core:
    bridge = faults.bridge(folder)
    recorder = Recorder(folder / "record", bridge.vessel, bridge.zone, 1e4)
    return Core(bridge, Predictor.load(ROOT / "checkpoints" / "cargo90"), recorder=recorder, saved=folder / "state.npz")


def finish(core: Core) -> None:
    """What still waits goes through, and into whole files."""
    core.take(core.intake.latest + 1.0)
    core.look(core.intake.latest + 1.0)
    assert core.recorder is not None
    core.recorder.close()


def recorded(folder: Path) -> int:
    """Rows of the log in the record's Parquet files."""
    return sum(pq.read_metadata(file).num_rows for file in folder.glob("log-*.parquet"))


def rss() -> float:
    """Memory of this process [MB] that is not swapped out."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


if __name__ == "__main__":
    main()
