"""The results table of the README: flagship and thesis network, three seeds each, on 60 unseen voyages of cargo90.

    python training/reproduce/cargo90.py [--seeds 1 2 3] [--voyages 60] [--out runs/cargo90_seeds] [--json FILE] [--figure FILE]
    python training/reproduce/cargo90.py --ship kvlcc2_full [--voyages 30]

Trains what is not trained yet in `--out` (a flagship takes 1 to 2 minutes, a thesis network about 5), evaluates each pair on
the same windows beside baselines and oracle, and prints medians over seeds with their lowest and highest, then the ratios to
the oracle. Another `--ship` needs `training/SHIP.toml` and `data/scenarios/SHIP-test.toml`; it goes without a thesis network
where there is no `training/SHIP-thesis.toml`. `--training cargo90-120h` takes the flagship from another training file.
"""

import argparse
import json
from pathlib import Path

from study import GROUPS, ROOT, cells, ratio

from aspnn.cli import guarded, say, watch
from aspnn.evaluation.evaluate import ORACLE, metrics
from aspnn.evaluation.examples import examples
from aspnn.evaluation.figures import tracks_figure
from aspnn.schema import InputError
from aspnn.workflow import evaluate_files, simulate_files, train


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--ship", default="cargo90", help="a vessel with training and scenario files of its own")
    options.add_argument("--training", help="training/NAME.toml, in place of the ship's flagship and thesis network")
    options.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    options.add_argument("--voyages", type=int, default=60)
    options.add_argument("--out", type=Path, help="default: runs/SHIP_seeds")
    options.add_argument("--json", type=Path)
    options.add_argument("--figure", type=Path, help="picture of the first flagship's 95th percentile window")
    given = options.parse_args()
    out = given.out or Path(f"runs/{given.ship}_seeds")
    names = [given.training or given.ship]
    scenario = ROOT / f"data/scenarios/{given.ship}-test.toml"
    for option, file in (("--ship", scenario), ("--training", ROOT / f"training/{names[0]}.toml")):
        if not file.exists():
            raise InputError(f"{option}: there is no {file.relative_to(ROOT)}; write one as of cargo90")
    if given.training is None and (ROOT / f"training/{given.ship}-thesis.toml").exists():
        names.append(f"{given.ship}-thesis")
    logs = simulate_files(scenario, out / "logs", given.voyages, watch=watch)
    found = []
    for seed in given.seeds:
        pair = [train(ROOT / f"training/{name}.toml", out / f"{name}-{seed}", seed, watch=watch) for name in names]
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
    at_end = [{n: {g: by[g]["horizons"]["90"] for g in GROUPS} for n, by in scores.items()} for scores in found]
    for name in at_end[0]:
        texts = [text for group in GROUPS for text in cells([scores[name][group] for scores in at_end])]
        say(False, f"| {name} | {' | '.join(texts)} |")
    say(False, "windows: " + ", ".join(f"{group} {found[0][ORACLE][group]['n']}" for group in GROUPS))
    say(False, f"position at 90 s, ratio to the oracle of median / p95 (range over seeds {given.seeds})")
    for name in names:
        texts = []
        for group in GROUPS:
            own, limit = ([scores[n][group] for scores in at_end] for n in (name, ORACLE))
            parts = [ratio(own, limit, "position_m", key) for key in ("median", "p95")]
            texts.append(" / ".join(f"{middle:.2f} ({low:.2f}-{high:.2f})" for middle, low, high in parts))
        say(False, f"| {name} | {' | '.join(texts)} |")


if __name__ == "__main__":
    guarded(main)
