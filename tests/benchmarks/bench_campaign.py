"""How fast campaigns are made: python tests/benchmarks/bench_campaign.py (200 ship-hours on two cores in less than 60 s and 2 GiB).

Runs `aspnn simulate` on the standard training voyages of cargo90 (half an hour each, default sensors at 10 Hz), start of the
processes and all, and prints the time, what was written, and the memory of the processes: this one's child and its workers.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

VOYAGES, WORKERS, DURATION = 400, 2, 1800.0
SCENARIO = Path(__file__).parents[2] / "data" / "scenarios" / "cargo90-train.toml"
KIB = 1024 if sys.platform != "darwin" else 1  # unit of ru_maxrss


def main():
    with tempfile.TemporaryDirectory() as folder:
        words = ["simulate", str(SCENARIO), "--out", folder, "--voyages", str(VOYAGES), "--workers", str(WORKERS)]
        begin, before = time.perf_counter(), os.times()
        subprocess.run([sys.executable, "-m", "aspnn.cli", *words, "--quiet"], check=True)
        taken, after = time.perf_counter() - begin, os.times()
        size = sum(path.stat().st_size for path in Path(folder).glob("*.parquet")) / 1e6
        (manifest,) = Path(folder).glob("*.manifest.json")
        rows = sum(entry["rows"] for entry in json.loads(manifest.read_text())["voyages"])
    hours = VOYAGES * DURATION / 3600
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * KIB * (WORKERS + 1) / 2**30
    print(
        f"{hours:g} ship-hours in {taken:.1f} s ({busy:.1f} s of processor): {hours / taken:.2f} ship-hours per second"
    )
    print(f"{size:.0f} MB of logs and truths, {rows:,} rows each; at most {memory:.2f} GiB in {WORKERS + 1} processes")


if __name__ == "__main__":
    main()
