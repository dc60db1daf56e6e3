"""Cross-validation over the recorded runs of the Esso Osaka model ship: every run is predicted by a network it never taught.

    aspnn import esso-osaka FOLDER --out runs/esso
    python training/reproduce/esso_osaka.py runs/esso [--folds 5] [--seed 1] [--json FILE] [--report FILE]

Runs are dealt to folds by voyage, so the parts of one recording stay together. Prints the table of errors after 10, 20 and
30 s. The recordings are CC BY-NC 4.0 (Wakita et al. 2022, doi 10.1007/s00773-021-00867-1; Miyauchi et al. 2022,
doi 10.1007/s00773-022-00889-3): the networks stay in runs/.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aspnn import records
from aspnn.cli import guarded, say
from aspnn.estimation import filter_log, smooth_log
from aspnn.evaluation.evaluate import Evaluation, evaluate, table, write_metrics
from aspnn.evaluation.reference import Voyage
from aspnn.evaluation.report import write_report
from aspnn.evaluation.windows import Rule
from aspnn.learning.config import read_training
from aspnn.learning.train import train_bundle, training_material
from aspnn.motion import Path as Motion
from aspnn.orders import Plan
from aspnn.prediction import baselines
from aspnn.prediction.gru import GruPredictor
from aspnn.records import Log, States

CONFIG = Path(__file__).parents[1] / "esso_osaka.toml"


@dataclass(frozen=True)
class CrossValidated:
    """Each voyage predicted by the network of the fold that left it out."""

    name: str
    horizon: float
    of_voyage: Mapping[str, GruPredictor]

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Motion:
        """Paths from each of `rows`; see Predictor."""
        return self.of_voyage[states.voyage].predict_many(states, rows, plans)


def folds(logs: list[Log], count: int) -> list[list[str]]:
    """Voyages dealt to folds, the longest first, each to the fold with the least of its kind, then the least in all."""
    length: dict[str, int] = {}
    for log in logs:
        length[log.voyage] = length.get(log.voyage, 0) + len(log)
    dealt: list[list[str]] = [[] for _ in range(count)]
    for voyage in sorted(length, key=lambda v: -length[v]):

        def load(fold: list[str], kind: str = voyage.split("_")[0]) -> tuple[int, int]:
            return sum(v.startswith(kind) for v in fold), sum(length[v] for v in fold)

        min(dealt, key=load).append(voyage)
    return dealt


def by_horizon(evaluation: Evaluation) -> str:
    """Median and 95th percentile of the position error at every horizon, one line per predictor and group."""
    lines = []
    for group in evaluation.rule.headline:
        rows = evaluation.rows(group)
        for name, errors in evaluation.errors.items():
            cells = [errors.position[rows, evaluation.column(h)] for h in evaluation.rule.horizons]
            median, high = (" / ".join(f"{np.percentile(c, q):.3f}" for c in cells) for q in (50, 95))
            turn = [np.degrees(np.abs(errors.heading[rows, evaluation.column(h)])) for h in evaluation.rule.horizons]
            heading = " / ".join(f"{np.median(c):.1f}" for c in turn)
            lines.append(f"{group:8s} {name:12s} median {median} m   p95 {high} m   heading {heading} deg")
    return "\n".join(lines)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("logs", nargs="+", type=Path)
    options.add_argument("--config", type=Path, default=CONFIG)
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--out", type=Path, default=Path("runs/esso_osaka_cv"))
    options.add_argument("--json", type=Path)
    options.add_argument("--report", type=Path)
    given = options.parse_args()
    training = read_training(given.config)
    training = training.model_copy(update={"fit": training.fit.model_copy(update={"seed": given.seed})})
    logs = [records.read_log(file) for file in records.log_files(given.logs)]
    dealt = folds(logs, given.folds)
    of_voyage = {}
    for number, fold in enumerate(dealt):
        say(False, f"fold {number + 1} of {len(dealt)}: trained without {', '.join(fold)}")
        material = training_material(training, [log for log in logs if log.voyage not in fold])
        bundle = train_bundle(training, material, given.out / f"seed-{given.seed}" / f"fold-{number}")
        of_voyage |= {voyage: GruPredictor(bundle, bundle.region_map) for voyage in fold}
    vessel = logs[0].vessel
    rule = Rule.of(vessel)
    learned = CrossValidated(training.name, rule.horizon, of_voyage)
    voyages = (Voyage.of(log, filter_log(log), smooth_log) for log in logs)
    result = evaluate([learned, *baselines(vessel, rule.horizon)], voyages, rule, given.seed)
    say(False, table(result))
    say(False, by_horizon(result))
    if given.json:
        write_metrics(result, given.json)
    if given.report:
        write_report(
            result, given.report, notes={"cross-validation": f"{given.folds} folds by voyage, seed {given.seed}"}
        )


if __name__ == "__main__":
    guarded(main)
