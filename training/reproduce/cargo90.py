"""The results table of the README: flagship and thesis network, three seeds each, on 60 unseen voyages of cargo90.

    python training/reproduce/cargo90.py [--seeds 1 2 3] [--voyages 60] [--out runs/cargo90_seeds] [--json FILE] [--figure FILE]

Trains what is not trained yet in `--out` (a flagship takes 2 to 3 minutes, a thesis network about 5), evaluates each pair on
the same windows beside baselines and oracle, and prints medians over seeds with their lowest and highest.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from aspnn.cli import guarded, say, watch
from aspnn.evaluation.evaluate import metrics
from aspnn.evaluation.examples import examples
from aspnn.evaluation.figures import tracks_figure
from aspnn.workflow import evaluate_files, simulate_files, train

ROOT = Path(__file__).parents[2]
GROUPS = ("new_order", "orders_within_horizon", "steady")


def cell(values: list[dict[str, dict[str, float]]], what: str, median: str, high: str, digits: int) -> str:
    """Median / p95 over seeds, with the range of the median where there is more than one value."""
    middle, top = ([value[what][key] for value in values] for key in (median, high))
    text = f"{np.median(middle):.{digits}f} / {np.median(top):.{digits}f}"
    spread = f"{min(middle):.{digits}f}", f"{max(middle):.{digits}f}"
    return text if spread[0] == spread[1] else f"{text} ({spread[0]}-{spread[1]})"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    options.add_argument("--voyages", type=int, default=60)
    options.add_argument("--out", type=Path, default=Path("runs/cargo90_seeds"))
    options.add_argument("--json", type=Path)
    options.add_argument("--figure", type=Path, help="picture of the first flagship's 95th percentile window")
    given = options.parse_args()
    logs = simulate_files(ROOT / "data/scenarios/cargo90-test.toml", given.out / "logs", given.voyages, watch=watch)
    found = []
    for seed in given.seeds:
        pair = [
            train(ROOT / f"training/{name}.toml", given.out / f"{name}-{seed}", seed, watch=watch)
            for name in ("cargo90", "cargo90-thesis")
        ]
        result = evaluate_files(pair, logs, watch=watch)
        found.append(metrics(result)["predictors"])
        if given.figure and len(found) == 1:
            tracks_figure(
                examples(result)[1], result.vessel, given.figure
            )  # not the typical window: the 95th percentile
        say(False, f"seed {seed} evaluated on {given.voyages} voyages")
    if given.json:
        given.json.write_text(json.dumps(dict(zip(given.seeds, found, strict=True)), indent=1) + "\n")
    say(False, f"position m at 90 s, median / p95 (range of the median over seeds {given.seeds}); heading deg likewise")
    say(False, "| predictor | " + " | ".join(f"{g} m | {g} deg" for g in GROUPS) + " |")
    for name in found[0]:
        cells = []
        for group in GROUPS:
            values = [scores[name][group]["horizons"]["90"] for scores in found]
            cells.append(cell(values, "position_m", "median", "p95", 2 if values[0]["position_m"]["median"] < 5 else 1))
            cells.append(cell(values, "heading_deg", "median_abs", "p95_abs", 2))
        say(False, f"| {name} | " + " | ".join(cells) + " |")
    say(False, "windows: " + ", ".join(f"{group} {found[0]['oracle'][group]['n']}" for group in GROUPS))


if __name__ == "__main__":
    guarded(main)
