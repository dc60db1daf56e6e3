"""Another loading of the ship that a checkpoint learned: errors and regions without and with tracking, by minutes since the log began.

    python training/reproduce/loading.py [--checkpoints DIR ...] [--voyages 20] [--changing 8] [--seed 7202] [--out runs/loading]
                                         [--json FILE]

Voyages of data/scenarios/cargo90-test.toml under another seed, which taught nothing, chose nothing and calibrated nothing: of cargo90
itself; of cargo90_ballast at the same shaft speed; in ballast for a quarter of an hour and loaded from then on (`loads`), and the other
way round (`discharges`), by the minutes since, which no voyage really does: it shows how long the tracking takes to notice.
The network's own predictions are those of the loading that it learned; the oracle is the simulator of the right ship.
Results are kept in --out case by case, so that a killed study goes on.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from study import GROUPS, ROOT, Kept

from aspnn.angles import compass
from aspnn.cli import guarded, say
from aspnn.estimation import filter_log
from aspnn.evaluation.coverage import coverage
from aspnn.evaluation.evaluate import Evaluation, evaluate
from aspnn.evaluation.oracle import Oracle
from aspnn.evaluation.reference import Reference, Voyage
from aspnn.evaluation.windows import SHIP
from aspnn.frames import Zone, convergence, to_grid
from aspnn.guidance.helms import random_orders
from aspnn.prediction.gru import GruPredictor
from aspnn.prediction.tracked import Tracked
from aspnn.records import Log
from aspnn.simulation.scenario import START, Scenario, read_scenario, simulate_scenario
from aspnn.simulation.sensing.sensors import measure
from aspnn.simulation.ship import KNOT, Ship
from aspnn.simulation.voyage import Voyage as Sailed
from aspnn.simulation.voyage import simulate
from aspnn.vessel import load_vessel

SEED = 7202
CHANGE = 900.0  # s into a voyage of the changing ship
MINUTES = {
    "design": ((2, 5), (5, 10), (10, 20), (20, 30)),
    "ballast": ((2, 5), (5, 10), (10, 20), (20, 30)),
    "loads": ((12, 15), (15, 18), (18, 21), (21, 24), (24, 30)),
    "discharges": ((12, 15), (15, 18), (18, 21), (21, 24), (24, 30)),
}
VESSELS = {"design": ("cargo90",), "ballast": ("cargo90_ballast",)}
VESSELS |= {"loads": ("cargo90_ballast", "cargo90"), "discharges": ("cargo90", "cargo90_ballast")}


def scenario(vessel: str, seed: int) -> Scenario:
    """The standard test scenario of a vessel at the speed of its own service."""
    given, speed = read_scenario(ROOT / "data/scenarios/cargo90-test.toml"), load_vessel(vessel).service_speed / KNOT
    start = given.start.model_copy(update={"speed_kn": (speed, speed)})
    return given.model_copy(update={"vessel": vessel, "start": start, "seed": seed})


def steady(case: str, count: int, seed: int) -> Iterator[Voyage]:
    """Voyages of one loading."""
    for log, truth in simulate_scenario(scenario(*VESSELS[case], seed), count):
        yield Voyage(filter_log(log), Reference.of_truth(truth), truth, None, log.voyage, "")


def changing(case: str, count: int, seed: int) -> Iterator[Voyage]:
    """Voyages that begin in one loading and go on in another from CHANGE on, at the speed and under the orders of the first."""
    first, second = (Ship.of(load_vessel(name)) for name in VESSELS[case])
    given = scenario(VESSELS[case][0], seed)
    zone, place = Zone.parse(given.start.zone), np.radians([given.start.latitude_deg, given.start.longitude_deg])
    north, east = to_grid(*place, zone)
    for k in range(count):
        orders, heading, sensors = (
            np.random.default_rng(s) for s in np.random.SeedSequence(seed, spawn_key=(k,)).spawn(3)
        )
        drawn = given.manoeuvre
        plan = random_orders(orders, given.duration_s, drawn.rudder_deg, drawn.step_deg, drawn.hold_s)
        course = compass(heading.uniform(0, 2 * np.pi) - convergence(*place, zone))
        begin = first.start(north, east, course, given.start.speed_kn[0] * KNOT)
        (before,) = simulate(first, [plan], begin, CHANGE)
        (after,) = simulate(
            second, [plan.between(CHANGE, given.duration_s)], last(before, begin), given.duration_s - CHANGE
        )
        run = one_after_the_other(before, after)
        table, truth = measure(run, second.vessel, zone, given.sensors, sensors), run.truth()
        truth = truth[truth["time_s"].isin(table["time_s"])].reset_index(drop=True)
        log = Log(table=table, vessel=second.vessel, zone=zone, start=START, source=case, voyage=f"{case}-{k:04d}")
        yield Voyage(filter_log(log), Reference.of_truth(truth), truth, None, log.voyage, "")


def last(run: Sailed, like: np.ndarray) -> np.ndarray:
    """The state row (1, columns) at the end of a run in still water, in the columns of `like`."""
    state = like.copy()
    names = ("north", "east", "heading", "surge", "sway", "yaw_rate", "rudder", "shaft", "pitch_ratio")
    state[0, : len(names)] = [getattr(run, name)[-1] for name in names]
    return state


def one_after_the_other(first: Sailed, second: Sailed) -> Sailed:
    """Two runs, the second begun where the first ended."""
    values: dict[str, Any] = {
        f.name: np.concatenate([getattr(first, f.name), getattr(second, f.name)[1:]])
        for f in fields(Sailed)
        if f.name != "depth"
    }
    values["time"] = np.concatenate([first.time, first.time[-1] + second.time[1:]])
    return Sailed(**values)


def parts(found: Evaluation, case: str) -> dict[str, Any]:
    """Errors at the horizon and what regions hold there, by predictor, minutes and group."""
    horizon, begun = found.rule.horizon, found.windows["time_s"].to_numpy() / 60
    column, scores = found.column(horizon), {}
    for low, high in MINUTES[case]:
        inside = (begun >= low) & (begun < high)
        for group in GROUPS:
            rows = np.array([row for row in found.rows(group) if inside[row]], int)
            for name, errors in found.errors.items() if len(rows) else ():
                place, turn = errors.position[rows, column], np.abs(np.degrees(errors.heading[rows, column]))
                held = coverage(narrowed(found, rows), name, group, horizon)
                scores.setdefault(name, {}).setdefault(f"{low}-{high}", {})[group] = {
                    "n": len(rows),
                    "position_m": [float(x) for x in np.percentile(place, [50, 95])],
                    "heading_deg": [float(x) for x in np.percentile(turn, [50, 95])],
                    "held": None if held is None else [held.position.value, held.heading.value, held.area],
                }
    return scores


def narrowed(found: Evaluation, rows: np.ndarray) -> Evaluation:
    """The evaluation of some windows alone."""
    return replace(
        found,
        windows=found.windows.iloc[rows].reset_index(drop=True),
        reference=found.reference[rows],
        paths={name: path[rows] for name, path in found.paths.items()},
    )


def measured(models: list[GruPredictor], case: str, count: int, seed: int) -> dict[str, Any]:
    """All predictors on the voyages of a case."""
    voyages = list((steady if case in ("design", "ballast") else changing)(case, count, seed))
    rule = SHIP if case in ("design", "ballast") else replace(SHIP, history=60.0 * MINUTES[case][0][0])
    oracle = Oracle.of if case in ("design", "ballast") else None
    tracked = [Tracked(model) for model in models]
    return parts(evaluate([*models, *tracked], voyages, rule, oracle=oracle), case)


def show(case: str, scores: dict[str, Any]) -> None:
    """A table: metres and degrees at 90 s, median / p95, the share that 95 % regions hold and their area."""
    say(False, f"\n{case}: 90 s ahead, position m and heading deg, median / p95; held by 95 % regions (area m2)")
    for minutes in dict.fromkeys(minutes for by in scores.values() for minutes in by):
        for group in GROUPS:
            for name, by in scores.items():
                got = by.get(minutes, {}).get(group)
                if got is None:
                    continue
                (a, b), (c, d), held = got["position_m"], got["heading_deg"], got["held"]
                kept = "" if held is None else f"{held[0]:.2f}, {held[1]:.2f} ({held[2]:.3g})"
                line = f"| {minutes} min | {group} ({got['n']}) | {name} | {a:.2f} / {b:.2f} | {c:.2f} / {d:.2f} | {kept} |"
                say(False, line)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    shipped = [ROOT / "checkpoints/cargo90", ROOT / "checkpoints/cargo90-hybrid"]
    options.add_argument("--checkpoints", type=Path, nargs="+", default=shipped)
    options.add_argument("--voyages", type=int, default=20)
    options.add_argument("--changing", type=int, default=8, help="voyages of each changing ship")
    options.add_argument("--seed", type=int, default=SEED)
    options.add_argument("--out", type=Path, default=Path("runs/loading"))
    options.add_argument("--json", type=Path)
    given = options.parse_args()
    models = [GruPredictor.load(folder) for folder in given.checkpoints]
    made = {"checkpoints": [m.name for m in models], "voyages": [given.voyages, given.changing], "seed": given.seed}
    kept = Kept(given.out / "results.json", made)
    for case in MINUTES:
        if case not in kept:
            count = given.voyages if case in ("design", "ballast") else given.changing
            kept.put(case, measured(models, case, count, given.seed))
        show(case, kept[case])
    if given.json:
        given.json.write_text(json.dumps(kept.results, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
