"""The 8 m boat, 10 s ahead: errors by time since the last order in a current of 1 m/s, and fine-tuning on five minutes of another boat.

    python training/reproduce/boat.py [--checkpoints DIR ...] [--voyages 10] [--out runs/boat] [--json FILE]

Voyages of data/scenarios/workboat8-test.toml in a sheltered sea (ripples of 2 to 10 cm, no ferry), and as that file has it: 0.1 to
0.5 m of waves, which nobody knows in advance, and which turn a boat that hardly keeps its course. The oracle, the true simulator
run on from the filtered state in calm water, shows what they leave to be known. States are those of the filter in three
dimensions; "GRU, ground" takes motion over ground for that through the water. Then the first checkpoint is fine-tuned
(training/workboat8-trial.toml) on one voyage of five minutes of workboat8-trial.toml, a heavier boat with a weaker drive,
and both are measured on the voyages of workboat8-trial-test.toml. Several checkpoints (seeds) stand in the same tables.
"""

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from study import ROOT

from aspnn.cli import guarded, say, watch
from aspnn.estimation.spatial import filter_spatial
from aspnn.evaluation.errors import path_errors
from aspnn.evaluation.oracle import Oracle
from aspnn.evaluation.reference import Reference, Voyage
from aspnn.learning.config import read_training, write_training
from aspnn.learning.windows import plan_of
from aspnn.motion import Path as Track
from aspnn.motion.path import pivot_path
from aspnn.motion.pivot_gpr import PivotGpr, Printed, enumerate_samples
from aspnn.orders import Orders
from aspnn.prediction import baselines
from aspnn.prediction.current import estimate_current
from aspnn.prediction.gru import GruPredictor
from aspnn.prediction.learned import predict_rows
from aspnn.records import States, write_log
from aspnn.schema import InputError
from aspnn.simulation.scenario import Scenario, read_scenario, simulate_scenario
from aspnn.simulation.weather import Waves
from aspnn.workflow import train

AFTER = (0.0, 1.0, 2.0, 5.0, 10.0)  # s since the order
HORIZON = 10.0  # s
KNOWN = 70.0  # s of states before a start: the history, and the minute in which a current is sought
ORDER, APART = math.radians(5), 5.0  # smaller changes, and changes sooner after the last one, are no new order
RIPPLES = Waves(height_m=(0.02, 0.1), period_s=(1.5, 2.5), from_deg=(0.0, 360.0), spreading=4)
SWAYS = 32  # of bow and of stern that the GPR is fitted to; the 100 of Paper VI take gigabytes
Scores = dict[str, dict[str, np.ndarray]]  # by predictor and start: errors (n, 2) at 10 s, metres and degrees


def scenario(name: str, sheltered: bool) -> Scenario:
    """A scenario of the boat, in its own sea or in ripples."""
    found = read_scenario(ROOT / f"data/scenarios/{name}.toml")
    calm = found.environment.model_copy(update={"waves": RIPPLES, "wake": None})
    return found.model_copy(update={"environment": calm}) if sheltered else found


def voyages(given: Scenario, count: int) -> Iterator[Voyage]:
    """Simulated voyages with their truth, filtered in three dimensions."""
    for log, truth in watch(simulate_scenario(given, count), "simulating", count):
        yield Voyage(filter_spatial(log), Reference.of_truth(truth), truth, None, log.voyage, "")


def starts(states: States, after: float) -> np.ndarray:
    """Rows `after` [s] after each new order, with enough known before and the horizon inside the voyage."""
    time = states["time_s"]
    begin = Orders.from_series(time, states["rudder_order_rad"]).changes(ORDER, APART) + after
    begin = begin[(begin >= time[0] + KNOWN) & (begin <= time[-1] - HORIZON - 0.5)]
    return time.searchsorted(begin - 1e-6)


def gpr_path(gpr: PivotGpr, states: States, rows: np.ndarray) -> Track:
    """Paper VI: surge and yaw rate of the start held, the hull turning about the pivot point of the GPR's mean."""
    pose = np.stack([states[k][rows] for k in ("north_m", "east_m", "heading_rad")], axis=-1)
    surge, sway, rate = (states[k][rows] for k in ("surge_m_s", "sway_m_s", "yaw_rate_rad_s"))
    held = np.ones(round(HORIZON / 0.1))
    velocity = [np.multiply.outer(values, held) for values in (surge, -gpr.mean(sway, rate) * rate, rate)]
    return pivot_path(pose, *velocity, 0.1)


def measured(predicted: Track, voyage: Voyage, rows: np.ndarray) -> np.ndarray:
    """Errors (n, 2) at the horizon against the truth: metres, degrees without sign."""
    end = predicted.at(np.array([HORIZON]))
    error = path_errors(end, voyage.reference.path(voyage.states["time_s"][rows], end.time))
    return np.stack([error.position[:, 0], np.abs(np.degrees(error.heading[:, 0]))], axis=-1)


def learned(
    models: list[GruPredictor], drift: float, voyage: Voyage, rows: np.ndarray, name: str
) -> dict[str, np.ndarray]:
    """Errors of networks of one design, over ground and in the current that each finds; models one after the other."""
    states, found = voyage.states, {}
    plans = [plan_of(states, int(row), HORIZON) for row in rows]
    for k, model in enumerate(models):
        own = replace(model.bundle, vessel=states.vessel)  # an untuned one is tried on another boat
        flow = estimate_current(own, model.velocities, states, rows, drift).velocity
        true = voyage.truth[["current_north_m_s", "current_east_m_s"]].to_numpy()[rows]
        for title, current in ((f"{name}, ground", None), (name, flow)):
            path = predict_rows(own, model.velocities, states, rows, plans, False, current)
            found[f"{title} {k + 1}"] = measured(path, voyage, rows)
        found[f"{name}, current's error {k + 1}"] = np.repeat(np.hypot(*(flow - true).T)[:, None], 2, axis=1)
    return found


def compare(models: list[GruPredictor], drift: float, given: Scenario, count: int) -> Scores:
    """Errors of all predictors over the voyages of a scenario, by seconds since the order."""
    parts: dict[str, dict[str, list[np.ndarray]]] = {}
    gpr = None
    for voyage in voyages(given, count):
        states = voyage.states
        if gpr is None:
            samples = enumerate_samples(*states.vessel.sway_stations, seed=1, count=SWAYS)
            gpr = PivotGpr.fit(Printed(None), samples, seed=1, subset=300, restarts=1)
        oracle = Oracle.of(voyage, HORIZON)
        for after in AFTER:
            rows = starts(states, after)
            plans = [plan_of(states, int(row), HORIZON) for row in rows]
            found = {
                p.name: measured(p.predict_many(states, rows, ()), voyage, rows)
                for p in baselines(states.vessel, HORIZON)
            }
            found["GPR-PP"] = measured(gpr_path(gpr, states, rows), voyage, rows)
            found |= learned(models, drift, voyage, rows, "GRU")
            found["oracle"] = measured(oracle.predict_many(states, rows, plans), voyage, rows)
            for name, errors in found.items():
                parts.setdefault(name, {}).setdefault(f"{after:g}", []).append(errors)
    return joined(parts)


def joined(parts: dict[str, dict[str, list[np.ndarray]]]) -> Scores:
    """The errors of all voyages, one after the other."""
    return {name: {after: np.concatenate(some) for after, some in by.items()} for name, by in parts.items()}


def tuned(parent: Path, given: Scenario, out: Path, seed: int) -> GruPredictor:
    """The checkpoint `parent` fine-tuned on the one voyage of a scenario."""
    log, _ = next(simulate_scenario(given, 1))
    write_log(log, out / "trial.parquet")
    training = read_training(ROOT / "training/workboat8-trial.toml")
    write_training(
        training.changed({"data.scenario": None, "data.logs": ("trial.parquet",), "folder": out}), out / "trial.toml"
    )
    return GruPredictor.load(train(out / "trial.toml", out / "tuned", seed, watch=watch, start=parent))


def tuning(parent: GruPredictor, child: GruPredictor, drift: float, given: Scenario, count: int) -> Scores:
    """Errors of both on other voyages of the child's boat, at all starts together."""
    parts: dict[str, dict[str, list[np.ndarray]]] = {}
    for voyage in voyages(given, count):
        rows = np.unique(np.concatenate([starts(voyage.states, after) for after in AFTER]))
        for name, model in (("untuned", parent), ("tuned", child)):
            for title, errors in learned([model], drift, voyage, rows, name).items():
                parts.setdefault(title, {}).setdefault("all", []).append(errors)
    return joined(parts)


def figures(scores: Scores) -> dict[str, dict[str, list[float]]]:
    """Median and 95th percentile of position [m] and heading [deg], and the number of starts."""

    def one(errors: np.ndarray) -> list[float]:
        return [round(float(x), 4) for x in (*np.percentile(errors, [50, 95], axis=0).T.ravel(), len(errors))]

    return {name: {after: one(errors) for after, errors in by.items()} for name, by in scores.items()}


def show(title: str, found: dict[str, dict[str, list[float]]]) -> None:
    """A table: position m and heading deg at 10 s, median / p95."""
    columns = list(next(iter(found.values())))
    say(False, f"{title}; {next(iter(found.values()))[columns[0]][4]:.0f} starts each; m, deg: median / p95")
    say(False, "| predictor | " + " | ".join(columns) + " |")
    for name, by in found.items():
        cells = (
            f"{a:.2f} / {b:.2f} m/s" if "current's" in name else f"{a:.2f} / {b:.2f}, {c:.1f} / {d:.1f}"
            for a, b, c, d, _ in by.values()
        )
        say(False, f"| {name} | {' | '.join(cells)} |")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--checkpoints", type=Path, nargs="+", default=[ROOT / "checkpoints/workboat8"])
    options.add_argument("--voyages", type=int, default=10)
    options.add_argument("--seed", type=int, default=1, help="of the fine-tuning")
    options.add_argument("--out", type=Path, default=Path("runs/boat"))
    options.add_argument("--json", type=Path)
    given = options.parse_args()
    models = [GruPredictor.load(folder) for folder in given.checkpoints]
    calibration = models[0].calibration
    if calibration is None:
        raise InputError(
            f"{given.checkpoints[0]}: is not calibrated, so no current can be sought; run `aspnn calibrate` first"
        )
    drift, found = calibration.drift, {}
    for title, sheltered in (("sheltered", True), ("open", False)):
        found[title] = figures(compare(models, drift, scenario("workboat8-test", sheltered), given.voyages))
        show(f"{title} sea, by s since the order", found[title])
    child = tuned(given.checkpoints[0], scenario("workboat8-trial", True), given.out, given.seed)
    found["tuning"] = figures(tuning(models[0], child, drift, scenario("workboat8-trial-test", True), given.voyages))
    show("fine-tuned on 300 s of another boat, sheltered sea", found["tuning"])
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
