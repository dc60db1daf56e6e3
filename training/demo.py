"""The demonstration: simulate, filter, train the flagship, evaluate it on unseen voyages, print the table, write the report.

    python training/demo.py [--voyages N] [--out runs/demo]

Everything is made anew from seeds: 5 h of training voyages, and other voyages for the test. The thesis's network is the
shipped checkpoint, since its 300-step GRUs take longer to train than to judge.
"""

import argparse
import time
from pathlib import Path

from aspnn.cli import guarded, say, watch
from aspnn.evaluation.evaluate import table
from aspnn.workflow import evaluate_files, simulate_files, train

ROOT = Path(__file__).parents[1]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--voyages", type=int, default=20, help="test voyages, half an hour each")
    options.add_argument("--out", type=Path, default=Path("runs/demo"))
    given = options.parse_args()
    begin = time.monotonic()

    def step(text: str) -> None:
        say(False, f"[{time.monotonic() - begin:5.0f} s] {text}")

    step("simulating 5 h of training voyages of cargo90, filtering them, training the flagship")
    checkpoint = train(ROOT / "training/cargo90.toml", given.out / "training", watch=watch)
    step(f"simulating {given.voyages} test voyages that no training has seen")
    logs = simulate_files(ROOT / "data/scenarios/cargo90-test.toml", given.out / "logs", given.voyages, watch=watch)
    step("evaluating: flagship, shipped thesis network, three kinematic baselines, oracle")
    report, metrics = given.out / "report.html", given.out / "metrics.json"
    beside = [checkpoint, ROOT / "checkpoints/cargo90-thesis"]
    result = evaluate_files(beside, logs, report, metrics, watch=watch)
    say(False, table(result))
    step(f"report: {report}   metrics: {metrics}   checkpoint: {checkpoint}")


if __name__ == "__main__":
    guarded(main)
