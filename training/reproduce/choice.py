"""The hybrid choice: is the mix of kinematic and learned path never worse than either, from 1 s to 90 s and in every group?

    python training/reproduce/choice.py [--checkpoint FOLDER...] [--validation 60] [--voyages 120] [--out runs/choice]
                                        [--json FILE] [--figure FILE]

For each checkpoint (cargo90-thesis and cargo90 without --checkpoint) `aspnn choose` fixes the choice on `--validation` voyages
of another seed; then mix, network alone and the kinematic path are scored on the same windows of unseen voyages of
cargo90-test.toml, at every second. Prints by group and quantity the worst ratio of the mix to the better of its two parts, in
median and 95th percentile, with the 95 % interval of that cell by a bootstrap over voyages; the checkpoints with their choice
stay in `--out`. Neither has regions here: a calibration is made after the choice.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from aspnn import records
from aspnn.cli import guarded, say, watch
from aspnn.estimation import filter_log
from aspnn.evaluation.choose import table
from aspnn.evaluation.evaluate import BASELINES, Evaluation, evaluate
from aspnn.evaluation.reference import Reference, Voyage
from aspnn.evaluation.windows import SHIP
from aspnn.prediction import baselines
from aspnn.prediction.gru import GruPredictor
from aspnn.simulation import read_scenario
from aspnn.simulation.campaign import run_campaign
from aspnn.workflow import choose_files

ROOT = Path(__file__).parents[2]
SCENARIO = ROOT / "data/scenarios/cargo90-test.toml"
SHIPPED = [ROOT / "checkpoints/cargo90-thesis", ROOT / "checkpoints/cargo90"]
SEED = 6611  # of the voyages that fix the choice
GROUPS = ("new_order", "orders_within_horizon", "steady")
QUANTITIES = ("position", "heading")
SHARES = (50, 95)  # median, 95th percentile
HORIZONS = np.arange(1.0, 91.0)
DRAWS = 300
BOUND = 1.02
COLOURS = {50: "#0969da", 95: "#bc4c00"}


class Ratios(NamedTuple):
    """Ratios of one checkpoint, group and quantity, arrays (2, horizons) for median and 95th percentile.

    `mix` to the better of network and kinematic path, with the ends of its interval; `network` and `kinematic` to the better of
    both; `all` the mix to the best of network and all three baselines. `below` is the share of draws in which every cell is
    within BOUND.
    """

    mix: np.ndarray
    low: np.ndarray
    high: np.ndarray
    network: np.ndarray
    kinematic: np.ndarray
    all: np.ndarray
    windows: int
    below: float


def voyages(folder: Path, name: str, count: int, seed: int | None) -> list[Path]:
    """Logs of `count` test voyages of `seed` under `name`, simulated where they are not there yet."""
    scenario = read_scenario(SCENARIO).model_copy(update={"name": name})
    return run_campaign(scenario, folder, count, seed, 1, None, watch)


def predictors(checkpoint: Path, logs: list[Path], out: Path) -> tuple[GruPredictor, GruPredictor, str | None]:
    """The mix, its network alone and the name of its kinematic model, None where all is left to the network."""
    found = choose_files(checkpoint, logs, out, lambda line: say(False, line), watch)
    say(False, table(found))
    if found.idle:
        network = GruPredictor.load(checkpoint)
        return replace(network, bundle=replace(network.bundle, calibration=None)), network.alone, None
    mix = GruPredictor.load(out)
    return mix, mix.alone, found.kinematic


def sizes(result: Evaluation, name: str, quantity: str, rows: np.ndarray) -> np.ndarray:
    """Errors (windows, horizons) of a predictor, in m or rad."""
    columns = [result.column(horizon) for horizon in HORIZONS]
    return np.abs(getattr(result.errors[name], quantity)[rows][:, columns])


def ratios(result: Evaluation, mix: str, network: str, kinematic: str, group: str, quantity: str) -> Ratios:
    """What `Ratios` says, of one group and quantity."""
    rows = result.rows(group)
    names = [mix, network, kinematic, *(name for name in BASELINES if name != kinematic)]
    errors = np.stack([sizes(result, name, quantity, rows) for name in names], axis=-1)
    of = result.voyages(rows)
    parts = [np.flatnonzero(of == voyage) for voyage in np.unique(of)]

    def against(values: np.ndarray, last: int | None) -> np.ndarray:
        """Ratios (2, horizons, names) to the best of the parts up to `last`."""
        found = np.percentile(values, SHARES, axis=0)
        return found / found[..., 1:last].min(axis=-1, keepdims=True)

    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(DRAWS):
        pick = rng.integers(len(parts), size=len(parts))
        drawn.append(against(errors[np.concatenate([parts[k] for k in pick])][..., :3], 3)[..., 0])
    plain = against(errors, 3)
    low, high = np.percentile(drawn, (2.5, 97.5), axis=0)
    below = float(np.mean([(draw <= BOUND).all() for draw in drawn]))
    best = against(errors, None)[..., 0]
    return Ratios(plain[..., 0], low, high, plain[..., 1], plain[..., 2], best, len(rows), below)


def lines(found: dict[tuple[str, str, str], Ratios]) -> list[str]:
    """The table, Markdown: worst cell of each checkpoint, group and quantity."""
    made = [
        "| checkpoint | group (windows) | of | worst median | worst p95 | mean median / p95 | cells above 1.02 | surely above | "
        "worst against all three baselines |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for (name, group, quantity), r in found.items():
        cells = []
        for k in range(2):
            at = int(np.argmax(r.mix[k]))
            cells.append(f"{r.mix[k, at]:.3f} ({r.low[k, at]:.3f}-{r.high[k, at]:.3f}) at {HORIZONS[at]:g} s")
        mean = " / ".join(f"{value:.3f}" for value in r.mix.mean(axis=1))
        above, sure = int((r.mix > BOUND).sum()), int((r.low > BOUND).sum())
        made.append(
            f"| {name} | {group} ({r.windows}) | {quantity} | {cells[0]} | {cells[1]} | {mean} | {above} of {r.mix.size} | {sure} | "
            f"{r.all.max():.3f} |"
        )
    return made


def figure(found: dict[tuple[str, str, str], Ratios], file: Path) -> None:
    """Ratio to the better part against horizon, a row for each checkpoint and quantity, a column for each group."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    pairs = list(dict.fromkeys((name, quantity) for name, _, quantity in found))
    drawn = Figure(figsize=(10.5, 2.35 * len(pairs) + 0.7), dpi=140, layout="constrained")
    grid = drawn.subplots(len(pairs), len(GROUPS), sharex=True, sharey=True, squeeze=False)
    for row, (name, quantity) in zip(grid, pairs, strict=True):
        for axes, group in zip(row, GROUPS, strict=True):
            r = found[name, group, quantity]
            axes.axhline(1.0, color="#8c959f", linewidth=0.8)
            axes.axhline(BOUND, color="#8c959f", linewidth=0.8, linestyle=":")
            for k, share in enumerate(SHARES):
                colour, what = COLOURS[share], "median" if share == 50 else "95th percentile"
                axes.fill_between(HORIZONS, r.low[k], r.high[k], color=colour, alpha=0.15, linewidth=0)
                axes.plot(HORIZONS, r.network[k], color=colour, linewidth=0.8, linestyle="--", label=f"network, {what}")
                axes.plot(
                    HORIZONS, r.kinematic[k], color=colour, linewidth=0.8, linestyle=":", label=f"kinematic, {what}"
                )
                axes.plot(HORIZONS, r.mix[k], color=colour, linewidth=1.8, label=f"choice, {what}")
            axes.set_ylim(0.5, 1.75)
            axes.set_xlim(0, 90)
            axes.set_xticks(range(0, 91, 15))
            axes.grid(color="#e8ebef", linewidth=0.8)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
            axes.set_title(f"{name}, {quantity}\n{group} ({r.windows} windows)", loc="left", fontsize=9)
        row[0].set_ylabel("error / better part's", fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("horizon [s]", fontsize=9)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncol=6, frameon=False, fontsize=8)
    with records.atomic(file) as temporary:
        FigureCanvasAgg(drawn).print_figure(temporary, format="png")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--checkpoint", type=Path, nargs="+", default=SHIPPED)
    options.add_argument("--validation", type=int, default=60)
    options.add_argument("--voyages", type=int, default=120)
    options.add_argument("--out", type=Path, default=Path("runs/choice"))
    options.add_argument("--json", type=Path)
    options.add_argument("--figure", type=Path)
    given = options.parse_args()
    fixing = voyages(given.out / "validation", "cargo90-choice", given.validation, SEED)
    testing = voyages(given.out / "test", "cargo90-test", given.voyages, None)
    trios = [predictors(folder, fixing, given.out / folder.name) for folder in given.checkpoint]

    def seen():
        for file in watch(testing, "evaluating", len(testing)):
            log = records.read_log(file)
            truth = records.read_truth(log)
            yield Voyage(filter_log(log), Reference.of_truth(truth), truth, name=file.name)

    learned = [predictor for mix, network, _ in trios for predictor in (mix, network)]
    rule = replace(SHIP, horizons=tuple(HORIZONS))
    result = evaluate([*learned, *baselines(learned[0].bundle.vessel, rule.horizon)], seen(), rule)
    found = {}
    for mix, network, kinematic in trios:
        for quantity in QUANTITIES:
            for group in GROUPS:
                names = (mix.name, network.name, kinematic or BASELINES[0])
                found[mix.name, group, quantity] = ratios(result, *names, group, quantity)
    say(False, f"{given.voyages} unseen voyages; ratios of the choice to the better of its parts, 95 % intervals")
    for line in lines(found):
        print(line)
    if given.json:
        data = {
            " ".join(key): {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in r._asdict().items()}
            for key, r in found.items()
        }
        with records.atomic(given.json) as temporary:
            temporary.write_text(json.dumps(data, indent=1) + "\n")
    if given.figure:
        figure(found, given.figure)


if __name__ == "__main__":
    guarded(main)
