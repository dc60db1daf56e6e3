"""Evaluate checkpoints: `python training/evaluate.py CHECKPOINT... --logs LOG... [--report FILE] [--json FILE]`.

The same call as `aspnn evaluate`, for evaluation scripts and job queues.
"""

import argparse
from pathlib import Path

from aspnn.cli import guarded, say
from aspnn.evaluation.evaluate import table
from aspnn.workflow import evaluate_files


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("checkpoints", nargs="+", type=Path)
    options.add_argument("--logs", nargs="+", type=Path, required=True)
    options.add_argument("--report", type=Path)
    options.add_argument("--json", type=Path)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    say(False, table(evaluate_files(given.checkpoints, given.logs, given.report, given.json, given.seed)))


if __name__ == "__main__":
    guarded(main)
