"""Train a predictor: `python training/train.py training/cargo90.toml [--seed N] [--out DIR] [--checkpoint DIR]`.

The same call as `aspnn train`, for job queues that want a script.
"""

import argparse
from pathlib import Path

from aspnn.cli import guarded
from aspnn.workflow import train


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("config", type=Path)
    options.add_argument("--seed", type=int)
    options.add_argument("--out", type=Path)
    options.add_argument("--checkpoint", type=Path)
    given = options.parse_args()
    print(train(given.config, given.out, given.seed, given.checkpoint))


if __name__ == "__main__":
    guarded(main)
