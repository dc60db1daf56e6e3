"""Cross-validation over the recorded runs of the Esso Osaka model ship: every run is predicted by a network it never taught.

    aspnn import esso-osaka FOLDER --out runs/esso
    python training/reproduce/esso_osaka.py runs/esso [--folds 5] [--seeds 1 2 3] [--json FILE] [--report FILE]

Runs are dealt to folds by voyage, so the parts of one recording stay together. Prints errors after 10, 20 and 30 s beside
the kinematic predictors, the wind-aware polynomial (the identified ship that the network corrects, alone) and the targets;
by type of run; with orders outside the range of training apart; the noise of the labels; the coverage of 95 % regions that
were calibrated on other folds; and, of several sets of seeds, medians and ranges. The recordings are CC BY-NC 4.0 (Wakita et
al. 2022, doi 10.1007/s00773-021-00867-1; Miyauchi et al. 2022, doi 10.1007/s00773-022-00889-3): the networks stay in runs/.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from esso_osaka_regions import carry, cross_conformal, jumping, label_floor, populations
from esso_osaka_tables import (
    RATIOS,
    coverage_rows,
    coverage_table,
    floor_rows,
    floor_table,
    kind_table,
    measured,
    parts_of,
    seeds_table,
    target_table,
)

from aspnn import records
from aspnn.cli import guarded, say
from aspnn.estimation import filter_log, smooth_log
from aspnn.evaluation.evaluate import Evaluation, best_baseline, evaluate, metrics, ratios, table
from aspnn.evaluation.reference import Voyage
from aspnn.evaluation.report import write_report
from aspnn.evaluation.windows import Rule
from aspnn.learning.config import Training, read_training
from aspnn.learning.corrected import CorrectedShip
from aspnn.learning.train import Material, train_bundle, training_material
from aspnn.learning.windows import Windows
from aspnn.motion import Path as Motion
from aspnn.orders import Plan
from aspnn.prediction import baselines
from aspnn.prediction.gru import GruPredictor
from aspnn.prediction.uncertainty import beyond
from aspnn.records import Log, States

CONFIG = Path(__file__).parents[1] / "esso_osaka.toml"
POLYNOMIAL = "polynomial"
WORDS = {
    "identified": "a polynomial ship identified from recordings, each run by one that it taught nothing",
    "hybrid": "a polynomial ship whose every step a GRU corrects, each run by one that it taught nothing",
    "corrected": "a polynomial ship whose roll-out GRUs correct, each run by one that it taught nothing",
    "rollout": "GRUs over the plan, each run by those that it taught nothing",
    "thesis": "the thesis's GRUs, each run by those that it taught nothing",
    POLYNOMIAL: "the ship that is corrected, alone: a polynomial in motion, rudder, propeller and wind",
}
SEEN = (0.5, 99.5)  # percentiles of an order in training between which it counts as seen there
Range = tuple[float, float]


@dataclass(frozen=True)
class CrossValidated:
    """Each voyage predicted by the network of the fold that left it out."""

    name: str
    horizon: float
    of_voyage: Mapping[str, GruPredictor]

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Motion:
        """Paths from each of `rows`; see Predictor."""
        return self.of_voyage[states.voyage].predict_many(states, rows, plans)

    def predict_carried(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> tuple[Motion, np.ndarray]:
        """Paths and what the filter's errors become; see GruPredictor."""
        return self.of_voyage[states.voyage].predict_carried(states, rows, plans)


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


def seen_orders(windows: Windows) -> dict[str, Range]:
    """Between which values each forcing was in nearly all of training."""
    found = {}
    for k, name in enumerate(windows.spec.forcings):
        low, high = np.percentile(windows.forcing[..., k], SEEN)
        found[name] = (float(low), float(high))
    return found


def unseen(plan: Plan, seen: Mapping[str, Range]) -> bool:
    """Whether a plan orders what was hardly ordered in training."""
    orders = {"rudder_angle": plan.rudder, "shaft_speed": plan.shaft}
    return any(o is not None and bool(beyond(o.values[None], *seen[k])[0]) for k, o in orders.items() if k in seen)


def trained(material: Material, predictor: GruPredictor) -> tuple[GruPredictor, GruPredictor | None, dict[str, Range]]:
    """A fold's predictor, its identified ship alone where it has one, and the orders seen in its training."""
    network = predictor.bundle.network
    ship = None
    if isinstance(network, CorrectedShip):
        ship = replace(predictor, bundle=replace(predictor.bundle, name=POLYNOMIAL, network=network.ship))
    return predictor, ship, seen_orders(material.train)


def by_horizon(evaluation: Evaluation, parts: Mapping[str, np.ndarray]) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Errors at the horizons, by part of the windows (masks by title) and predictor."""
    return {
        title: {name: measured(evaluation, name, np.flatnonzero(mask)) for name in evaluation.errors}
        for title, mask in parts.items()
        if mask.any()
    }


def against(evaluation: Evaluation) -> dict[str, str]:
    """Ratio of the predictor's median error at the last horizon to the polynomial's and the best baseline's, by group."""
    found, horizon = {}, evaluation.rule.horizon
    for group in evaluation.rule.headline:
        for other in (POLYNOMIAL, best_baseline(evaluation, group, horizon)):
            if other in evaluation.errors:
                found[f"{group}, to {other}"] = str(ratios(evaluation, group, horizon, other)[evaluation.main])
    return found


def cross_validated(
    training: Training, dealt: list[list[str]], materials: Sequence[Material], seed: int, out: Path
) -> dict[str, tuple[GruPredictor, GruPredictor | None, dict[str, Range]]]:
    """What `trained` has for each voyage: that of the fold which left it out, with one set of seeds."""
    training = training.changed({"fit.seed": seed})
    found: dict[str, tuple[GruPredictor, GruPredictor | None, dict[str, Range]]] = {}
    for number, (fold, material) in enumerate(zip(dealt, materials, strict=True)):
        say(False, f"seeds from {seed} on, fold {number + 1} of {len(dealt)}: trained without {', '.join(fold)}")
        bundle = train_bundle(training, material, out / f"seed-{seed}" / f"fold-{number}")
        found |= dict.fromkeys(fold, trained(material, GruPredictor(bundle, bundle.region_map)))
    return found


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("logs", nargs="+", type=Path)
    options.add_argument("--config", type=Path, default=CONFIG)
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--seeds", type=int, nargs="+", default=[1], help="the first seed of each set of networks")
    options.add_argument("--out", type=Path, default=Path("runs/esso_osaka_cv"))
    options.add_argument("--json", type=Path)
    options.add_argument("--report", type=Path, help="of the first set")
    given = options.parse_args()
    training = read_training(given.config)
    logs = [records.read_log(file) for file in records.log_files(given.logs)]
    dealt = folds(logs, given.folds)
    materials = [training_material(training, [log for log in logs if log.voyage not in fold]) for fold in dealt]
    vessel = logs[0].vessel
    rule = Rule.of(vessel)
    voyages = [Voyage.of(log, filter_log(log), smooth_log) for log in logs]
    told: dict[int, dict[str, Any]] = {}
    noise: dict[str, Any] = {}
    for seed in given.seeds:
        of_voyage = cross_validated(training, dealt, materials, seed, given.out)
        learned = CrossValidated(training.name, rule.horizon, {v: part[0] for v, part in of_voyage.items()})
        ships = {voyage: ship for voyage, (_, ship, _) in of_voyage.items() if ship is not None}
        alone = [CrossValidated(POLYNOMIAL, rule.horizon, ships)] if ships else []
        result = evaluate([learned, *alone, *baselines(vessel, rule.horizon)], voyages, rule, seed)
        voyage = np.array([log.voyage for log in logs])[result.windows["voyage"].to_numpy()]
        outside = np.array([unseen(plan, of_voyage[v][2]) for v, plan in zip(voyage, result.plans, strict=True)])
        number = np.array([next(k for k, fold in enumerate(dealt) if v in fold) for v in voyage])
        carried = carry(result, [v.states for v in voyages], learned)
        held = coverage_rows(result, cross_conformal(carried, number, populations(result)), outside, jumping(result))
        noise = noise or floor_rows(label_floor(result, logs, smooth_log))  # the same windows for all seeds
        say(False, table(result))
        names = [learned.name, *(part.name for part in alone), "constant"]
        parts = parts_of(result, outside, jumping(result))
        say(False, kind_table(result, names, parts))
        say(False, target_table(result, learned.name))
        for what, ratio in against(result).items():
            aim = f", {RATIOS[what]}" if what in RATIOS else ""
            say(False, f"ratio of medians after {rule.horizon:g} s, {what}: {ratio}{aim}")
        say(False, coverage_table(held))
        errors = {"by_horizon": by_horizon(result, parts), "ratios": against(result), "coverage": held}
        told[seed] = metrics(result) | {"cross_validation": errors}
        if given.report and seed == given.seeds[0]:
            notes = {"cross-validation": f"{given.folds} folds by voyage, seeds from {seed} on"}
            words = {learned.name: WORDS[training.network.kind], POLYNOMIAL: WORDS[POLYNOMIAL]}
            write_report(result, given.report, notes=notes, words=words)
    say(False, floor_table(noise))
    if len(told) > 1:
        say(False, seeds_table([each["cross_validation"] for each in told.values()], training.name))
    if given.json:
        with records.atomic(given.json) as temporary:
            temporary.write_text(json.dumps({"seeds": told, "label_noise": noise}, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
