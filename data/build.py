"""Build a windowed dataset: `python data/build.py LOG... --spec training/NAME.toml --out DIR [--states DIR]`.

Logs to states to windows: the same calls as `aspnn filter` and `aspnn windows`. Writes train.safetensors and
validation.safetensors, each with its WindowSpec inside, and the states where asked for.
"""

import argparse
from pathlib import Path

from aspnn.cli import guarded
from aspnn.workflow import filter_files, window_files


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("logs", nargs="+", type=Path)
    options.add_argument("--spec", type=Path, required=True)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--states", type=Path)
    given = options.parse_args()
    if given.states:
        filter_files(given.logs, given.states, smooth=True)
    for path, count in window_files(given.logs, given.spec, given.out):
        print(f"{count} windows in {path}")


if __name__ == "__main__":
    guarded(main)
