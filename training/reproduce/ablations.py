"""Every choice of the flagship on and off: what each one is worth on voyages that no training has seen.

    python training/reproduce/ablations.py [--rows NAME ...] [--seeds 3] [--voyages 25] [--out runs/ablations] [--json FILE] [--report FILE]

A row is `training/cargo90.toml` with ONE choice changed. Unless the choice is how long to train, a row takes as many steps of the
optimiser as the flagship, so that rows of few windows are not merely trained less. Results lie in `--out` and a killed study
goes on; rows and seeds that are there are shown with those asked for. Validation losses are the flagship's loss on windows that
start where the flagship's do, also of rows that were trained with another.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import torch
from study import GROUPS, ROOT, Kept, cells, ratio, refitted, scores, test_voyages

from aspnn import records
from aspnn.cli import guarded, say, watch
from aspnn.estimation import filter_log, smooth_log
from aspnn.evaluation.evaluate import ORACLE, evaluate
from aspnn.evaluation.oracle import Oracle
from aspnn.evaluation.windows import Rule
from aspnn.learning import fit
from aspnn.learning.checkpoint import Bundle
from aspnn.learning.config import RolloutNet, Training, read_training
from aspnn.learning.train import Material, train_bundle, training_material
from aspnn.learning.windows import Windows, concatenate, make_windows, starts
from aspnn.prediction.gru import GruPredictor
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Vessel
from aspnn.workflow import simulate_files, training_logs

FLAGSHIP = "flagship"
ODD = ("sway_bow", "sway_stern", "rudder_angle")  # features that change their sign in a mirror
RATE = math.radians(1.0)  # by how much the rudder's servo is wrong [rad/s]
# Paper V, table 5: Q of CAA is what accumulates in a step of 0.1 s, with q = 1e-12 pi / 180 on the derivative of the yaw
# acceleration (E34: q / dt is the density); of Q of CTRA the part on the accelerations, 1e-6, a density (E20).
PRINTED = {"yaw_jerk_density": 1e-12 * math.pi / 180 / 0.1, "jerk_density": 1e-6}


def same(thing: Any) -> Any:
    """What is not changed."""
    return thing


@dataclass(frozen=True)
class Choice:
    """One choice changed: keys of the training file, the vessel of all logs, its windows, or what is done with the network.

    `hours` are those of voyages to learn from, the others of the file's are left out. With `filed` the rudder follows its orders as
    the vessel file says, not as its logs do. `taught` changes all windows, `added` the training ones alone. A choice that is
    `used_only` takes the flagship as it was trained. `paced` keeps the flagship's steps.
    """

    name: str
    what: str
    changes: dict[str, Any] = field(default_factory=dict)
    vessel: Callable[[Vessel], Vessel] = same
    hours: float | None = None
    filed: bool = False
    taught: Callable[[Windows], Windows] = same
    added: Callable[[Windows], Windows] = same
    use: Callable[[Bundle], GruPredictor] = GruPredictor
    used_only: bool = False
    paced: bool = True


def faster(change: float) -> Callable[[Vessel], Vessel]:
    """The vessel with a rudder servo that is `change` [rad/s] faster."""
    return lambda vessel: replace(vessel, rudder_rate=vessel.rudder_rate + change)


def printed(vessel: Vessel) -> Vessel:
    """The vessel with the process noise that Paper V prints for its filters."""
    return replace(vessel, noise=replace(vessel.noise, **PRINTED))


def unplanned(windows: Windows) -> Windows:
    """Windows that know nothing of the future: the new order is the last row of the history, as in the thesis."""
    return replace(windows, forcing=np.zeros_like(windows.forcing))


class Unplanned(torch.nn.Module):
    """A network to which nobody tells the plan."""

    def __init__(self, network: torch.nn.Module):
        super().__init__()
        self.network = network

    def forward(self, history, forcing, wind):
        return self.network(history, torch.zeros_like(forcing), wind)


def mirrored(windows: Windows) -> Windows:
    """Windows and their mirror images: port for starboard."""

    def signs(names: Sequence[str]) -> np.ndarray:
        return np.array([-1 if name in ODD else 1 for name in names], np.float32)

    spec = windows.spec
    image = replace(
        windows,
        history=windows.history * signs(spec.inputs),
        forcing=windows.forcing * signs(spec.forcings),
        target=windows.target * signs(spec.targets),
        path=windows.path * np.array([1, -1, -1], np.float32),  # forward, starboard, turn
        wind=windows.wind * np.array([1, -1], np.float32),
    )
    return concatenate([windows, image])


def servo_of(change: float) -> Callable[[Bundle], GruPredictor]:
    """The predictor of a bundle whose servo is `change` [rad/s] faster than the vessel file's, which is the true one."""
    return lambda bundle: GruPredictor(replace(bundle, vessel=faster(change)(bundle.vessel), servos=None))


def filed(made: Material, training: Training, logs: Iterable[Log]) -> Material:
    """Windows as `made`, of `logs`, whose rudder follows its orders at the rate of their vessel, without an identified servo."""
    spec, parts = training.windows.spec(), dict[bool, list[Windows]]()
    for log in logs:
        filtered, smoothed = filter_log(log), smooth_log(log)
        rows = starts(filtered, spec, training.windows.sampling())
        windows = make_windows(filtered, smoothed, spec, rows)
        parts.setdefault(log.voyage in made.facts["validation_voyages"], []).append(windows)
    return replace(made, train=concatenate(parts[False]), validation=concatenate(parts[True]), servos=None)


INPUTS = ["surge", "sway_bow", "sway_stern", "rudder_angle"]
HUGE = [1e9, 0.0]
CHOICES = (
    Choice(FLAGSHIP, "the flagship"),
    Choice("region-map", "path by the region map, not the exact step", use=lambda b: GruPredictor(b, True), used_only=True),
    Choice("servo-off", "rudder servo wrong by +1 deg/s in use only", use=servo_of(RATE), used_only=True),
    Choice("servo-off-slow", "rudder servo wrong by -1 deg/s in use only", use=servo_of(-RATE), used_only=True),
    Choice("orders-only", "windows at orders only", {"windows.shifts_s": [], "windows.sliding_s": None}),
    Choice("no-sliding", "no sliding windows", {"windows.sliding_s": None}),
    Choice("no-shifted", "no windows shifted from orders", {"windows.shifts_s": []}),
    Choice(
        "no-plan", "no forcing: the order ends the history, as in the thesis", {"windows.inputs": [*INPUTS, "rudder_order"]},
        taught=unplanned, use=lambda b: GruPredictor(replace(b, network=Unplanned(b.network))),
    ),
    Choice("plain-order", "the order as it is given, not through the servo", {"windows.forcings": ["rudder_order"]}),
    Choice(
        "velocities", "loss on velocities only, not on the path",
        {"network.position_tolerance_m": HUGE, "network.heading_tolerance_deg": HUGE},
    ),
    Choice("printed-noise", "filter with Paper V's printed noise", vessel=printed),
    Choice("tenth", "a tenth of the epochs", {"fit.epochs": 3}, paced=False),
    Choice("batch-512", "batches of 512, as many epochs", {"fit.batch": 512}, paced=False),
    Choice("mirror", "mirror images of all windows added", added=mirrored),
    Choice("servo-fast", "rudder servo wrong by +1 deg/s in training and use", vessel=faster(RATE), filed=True),
    Choice("servo-slow", "rudder servo wrong by -1 deg/s in training and use", vessel=faster(-RATE), filed=True),
    Choice("1-h", "1 h of voyages to learn from, not 4", hours=1.0),
    Choice("2.5-h", "2.5 h of voyages to learn from, not 4", hours=2.5),
    Choice("period-2", "steps of 2 s, not 1", {"windows.period_s": 2.0}),
    Choice("period-0.5", "steps of 0.5 s, not 1", {"windows.period_s": 0.5}),
    Choice("history-10", "10 s of history, not 30", {"windows.history_s": 10.0}),
    Choice("history-60", "60 s of history, not 30", {"windows.history_s": 60.0}),
    Choice("latent-24", "latent state of 24, not 48", {"network.latent": 24}),
    Choice("latent-96", "latent state of 96, not 48", {"network.latent": 96}),
)  # fmt: skip


class Study:
    """Trains and evaluates rows. What several of them need is made once: logs, the flagship's windows, test voyages."""

    def __init__(self, training: Training, out: Path, voyages: int):
        self.training, self.out = training, out
        self.logs = list(training_logs(training, watch))
        self.files = simulate_files(ROOT / "data/scenarios/cargo90-test.toml", out / "logs", voyages, watch=watch)
        self.material = self._material(CHOICES[0])
        self.voyages = test_voyages(watch(self.files, "filtering", len(self.files)))

    def _material(self, choice: Choice) -> Material:
        """The windows of a row; validation windows start where the flagship's do."""
        held, logs = self.training.data.validation_voyages, self.logs
        if choice.hours is not None:
            count = round(choice.hours * 3600 / (logs[0].table["time_s"].iloc[-1] - logs[0].table["time_s"].iloc[0]))
            logs = [*logs[:-held][:count], *logs[-held:]]
        told = [refitted(log, choice.vessel) for log in logs]
        training = self.training.changed(choice.changes)
        judge = self.training.changed(
            {"windows.history_s": training.windows.history_s}
        )  # which a start must have before it
        made = training_material(training, told, judge=judge)
        if choice.filed:
            made = filed(made, training, told)
        assert made.validation is not None
        return replace(made, train=choice.added(choice.taught(made.train)), validation=choice.taught(made.validation))

    def run(self, choice: Choice, seed: int) -> dict[str, Any]:
        """Train a row with a seed (a run that was killed goes on) and evaluate it."""
        begun = process_time()
        alike = choice is CHOICES[0] or choice.used_only
        material = self.material if alike else self._material(choice)
        training = self.training.changed({**choice.changes, "fit.seed": seed})
        if choice.paced and not alike:
            material, training = paced(material, training, len(self.material.train))
        folder = self.out / f"{FLAGSHIP if alike else choice.name}-{seed}"
        bundle = train_bundle(training, replace(material, validation=None), folder)  # its loss is computed below
        loss = flagship_loss(self.training, bundle, material.validation)
        voyages = self.voyages if choice.vessel is same else test_voyages(self.files, choice.vessel)
        predictor = choice.use(replace(bundle, name=choice.name))
        return {
            "scores": scores(evaluate([predictor], voyages, Rule.of(bundle.vessel)), choice.name),
            "validation_loss": loss,
            "windows": material.facts["training_windows"],
            "steps": training.fit.epochs * math.ceil(len(material.train) / training.fit.batch),
            "cpu_s": round(process_time() - begun, 1),
        }

    def oracle(self) -> dict[str, Any]:
        """The limit that the filter sets, on the same windows."""
        evaluation = evaluate([], self.voyages, Rule.of(self.material.vessel), oracle=Oracle.of)
        counts = {group: len(evaluation.rows(group)) for group in GROUPS}
        return {"scores": scores(evaluation, ORACLE), "counts": counts}


def paced(material: Material, training: Training, count: int) -> tuple[Material, Training]:
    """Material and training that take as many steps as `count` windows do: few are repeated within an epoch, many take fewer epochs."""
    windows = material.train
    if len(windows) < count:
        material = replace(material, train=windows.select(np.resize(np.arange(len(windows)), count)))
    epochs = max(1, round(training.fit.epochs * min(1.0, count / len(windows))))
    return material, training.changed({"fit.epochs": epochs})


def flagship_loss(flagship: Training, bundle: Bundle, windows: Windows | None) -> float:
    """The flagship's loss of a network on `windows`."""
    net = flagship.network
    assert isinstance(net, RolloutNet) and windows is not None
    start, growth = (math.radians(tolerance) for tolerance in net.heading_tolerance_deg)
    loss = fit.path_loss(fit.Tolerance(net.position_tolerance_m, (start, growth), net.velocity_tolerance_m_s))
    history, forcing, wind = (fit.tensor(array) for array in (windows.history, windows.forcing, windows.wind))
    with torch.inference_mode():
        return float(
            loss(bundle.network, (history, forcing, wind, fit.tensor(windows.target), fit.tensor(windows.path)))
        )


class Line(NamedTuple):
    """A row as people read it; `ratios` are (median, lowest, highest) over seeds by group, against the flagship's median."""

    name: str
    what: str
    cells: list[str]
    ratios: list[tuple[float, float, float]]
    seeds: int


def lines(kept: Kept) -> list[Line]:
    """The rows that have results, in the order of CHOICES."""
    results: dict[str, list] = {
        name: [] for name in ("", *(choice.name for choice in CHOICES))
    }  # the oracle has no seed
    for name in sorted(kept.results):
        results[name.rpartition(" ")[0]].append(kept[name])
    first = results[CHOICES[0].name]
    return [line(choice, results[choice.name], first) for choice in CHOICES if first and results[choice.name]]


def line(choice: Choice, results: list[dict[str, Any]], flagship: list[dict[str, Any]]) -> Line:
    """One row."""
    texts, shares = [], []
    for group in GROUPS:
        own, other = ([result["scores"][group] for result in given] for given in (results, flagship))
        texts += cells(own)
        shares.append(ratio(own, other, "position_m", "median"))
    loss = f"{np.median([result['validation_loss'] for result in results]):.3g}"
    return Line(choice.name, choice.what, [*texts, loss], shares, len(results))


def share(value: tuple[float, float, float], seeds: int) -> str:
    """A ratio with the range of the seeds."""
    middle, low, high = (f"{x:.2f}" if x < 10 else f"{x:.0f}" for x in value)
    return middle if seeds == 1 else f"{middle} ({low}-{high})"


def report(found: list[Line], oracle: dict[str, Any], voyages: int, path: Path) -> None:
    """Write the page, whole or not at all."""
    from ablations_page import render

    with records.atomic(path) as temporary:
        temporary.write_text(render(found, oracle, voyages, share), encoding="utf-8")


def chosen(names: Iterable[str] | None) -> list[Choice]:
    """The rows of these names, all without names; the flagship always, since all are measured against it. Raises InputError."""
    known = {choice.name: choice for choice in CHOICES}
    wrong = [name for name in names or () if name not in known]
    if wrong:
        raise InputError(f"--rows: {wrong[0]} is not known; choose among {', '.join(known)}")
    return [choice for choice in CHOICES if names is None or choice.name in names or choice is CHOICES[0]]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument(
        "--rows", nargs="+", metavar="NAME", help=f"among {', '.join(choice.name for choice in CHOICES)}"
    )
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--voyages", type=int, default=25)
    options.add_argument("--out", type=Path, default=Path("runs/ablations"))
    options.add_argument("--json", type=Path)
    options.add_argument("--report", type=Path)
    given = options.parse_args()
    rows = chosen(given.rows)
    training = read_training(ROOT / "training/cargo90.toml")
    kept = Kept(
        given.out / "results.json",
        {"training": training.model_dump(mode="json", exclude={"folder"}), "voyages": given.voyages},
    )
    wanted = [(choice, seed) for seed in range(1, given.seeds + 1) for choice in rows]
    missing = [(choice, seed) for choice, seed in wanted if f"{choice.name} {seed}" not in kept]
    if missing or ORACLE not in kept:
        study = Study(training, given.out, given.voyages)
        if ORACLE not in kept:
            kept.put(ORACLE, study.oracle())
        for done, (choice, seed) in enumerate(missing, 1):
            kept.put(f"{choice.name} {seed}", study.run(choice, seed))
            say(
                False,
                f"{choice.name}, seed {seed}: {kept[f'{choice.name} {seed}']['cpu_s']:g} s, {done} of {len(missing)}",
            )
    found = lines(kept)
    if given.json:
        with records.atomic(given.json) as temporary:
            temporary.write_text(json.dumps({"made": kept.made, "results": kept.results}, indent=1) + "\n")
    if given.report:
        report(found, kept[ORACLE], given.voyages, given.report)
    heads = [f"{group} {unit}" for group in GROUPS for unit in ("m", "deg")]
    say(False, "median / p95 at 90 s (range of the median over seeds); ratios of medians to the flagship's")
    say(False, f"| | {' | '.join(heads)} | validation loss | {' | '.join(f'{g} ratio' for g in GROUPS)} | seeds |")
    for row in found:
        say(
            False,
            f"| {row.what} | {' | '.join([*row.cells, *(share(r, row.seeds) for r in row.ratios)])} | {row.seeds} |",
        )
    limit = [text for group in GROUPS for text in cells([kept[ORACLE]["scores"][group]])]
    say(False, f"| the oracle | {' | '.join(limit)} | |")


if __name__ == "__main__":
    guarded(main)
