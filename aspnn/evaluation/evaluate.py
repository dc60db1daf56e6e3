"""Every predictor on the same windows of the same voyages: errors, metrics.json and the table the command line prints."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pandas as pd

from aspnn import records
from aspnn.evaluation.coverage import calibrated, coverage, coverage_metrics, stacked
from aspnn.evaluation.errors import Errors, Ratio, concatenate, paired_ratios, path_errors, summary
from aspnn.evaluation.reference import Voyage
from aspnn.evaluation.windows import MODEL_SHIP_LENGTH, NEW, ORDER, WITHIN, Rule, find_starts
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel

if TYPE_CHECKING:
    from rich.table import Table

BASELINES = ("caa_ctra", "caa_cmm", "constant")
ORACLE = "oracle"
TITLES = {
    "new_order": "a new rudder order, held",
    "orders_within_horizon": "a new rudder order, another within the horizon",
    "order": "a rudder order",
    "steady": "steady, no order near",
    "steered": "at any time, whatever is ordered",
}


class Predicts(Protocol):
    """What an evaluation asks of a predictor: its name, and the paths (n, steps) from n rows of a voyage's states."""

    @property
    def name(self) -> str: ...

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path: ...


@dataclass(frozen=True)
class Evaluation:
    """Predictions of every predictor on the same windows, at `times` [s] from the start, and their errors.

    `windows` has one row per window: `voyage` (position in `data`), `time_s`, `group`. Paths and errors are arrays
    (windows, times). `left_out` tells why a predictor was not scored.
    """

    rule: Rule
    vessel: Vessel
    times: np.ndarray
    windows: pd.DataFrame
    plans: tuple[Plan, ...]
    reference: Path
    paths: dict[str, Path]
    errors: dict[str, Errors]
    data: tuple[dict[str, Any], ...]
    left_out: dict[str, str]
    seed: int
    warnings: tuple[str, ...] = ()  # what a reader must know before believing the figures

    @property
    def main(self) -> str:
        """The predictor that the evaluation is about: the first that is neither baseline nor oracle."""
        return next((name for name in self.errors if name not in (*BASELINES, ORACLE)), next(iter(self.errors)))

    def rows(self, group: str) -> np.ndarray:
        """The windows (row numbers) of a group; `order` holds both kinds of windows at orders."""
        groups = (NEW, WITHIN) if group == ORDER else (group,)
        return np.flatnonzero(self.windows["group"].isin(groups).to_numpy())

    def column(self, horizon: float) -> int:
        """The place of `horizon` [s] among `times`."""
        return int(np.argmin(np.abs(self.times - horizon)))

    def voyages(self, rows: np.ndarray) -> np.ndarray:
        """The voyage of each of `rows`."""
        return self.windows["voyage"].to_numpy()[rows]


def evaluate(
    predictors: Sequence[Predicts],
    voyages: Iterable[Voyage],
    rule: Rule,
    seed: int = 0,
    oracle: Callable[[Voyage], Predicts] | None = None,
) -> Evaluation:
    """Predict every window of every voyage with every predictor, and measure against each voyage's reference.

    `voyages` is walked through once, so that they need not all be in memory. `oracle` makes the oracle of a voyage or
    raises InputError where there can be none: then it is left out everywhere, since all are scored on the same windows.
    Raises InputError when no voyage has a window, or when a prediction is too short or not finite.
    """
    names = [predictor.name for predictor in predictors]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(
            f"two predictors are named {twice}; give one of the checkpoints another name in its config.json"
        )
    times = np.unique(np.concatenate([np.linspace(0.0, rule.horizon, 31), rule.horizons]))
    left_out: dict[str, str] = {}
    parts: list[_Part] = []
    vessel = None
    for voyage in voyages:
        vessel = vessel or voyage.states.vessel
        scored = list(predictors)
        if oracle is not None and ORACLE not in left_out:
            try:
                scored.append(oracle(voyage))
            except InputError as error:
                left_out[ORACLE] = str(error)
        parts.append(_predict(scored, voyage, rule, times, len(parts)))
    if vessel is None:
        raise InputError("no voyage to evaluate")
    windows = pd.concat([part.windows for part in parts], ignore_index=True)
    if windows.empty:
        dropped = sum((Counter(part.data["excluded"]) for part in parts), Counter())
        found = (
            ", ".join(f"{count} with {reason}" for reason, count in dropped.items()) or "no order, no steady stretch"
        )
        raise InputError(f"no window to score in {len(parts)} voyages ({found}); {_NEEDS.format(rule=rule)}")
    filled = [part for part in parts if len(part.windows)]
    kept = [name for name in filled[0].paths if all(name in part.paths for part in filled)]
    return Evaluation(
        rule=rule,
        vessel=vessel,
        times=times,
        windows=windows,
        plans=tuple(plan for part in parts for plan in part.plans),
        reference=_stack([part.reference for part in filled]),
        paths={name: _stack([part.paths[name] for part in filled]) for name in kept},
        errors={name: concatenate([path_errors(part.paths[name], part.reference) for part in filled]) for name in kept},
        data=tuple(part.data for part in parts),
        left_out=left_out,
        seed=seed,
    )


_NEEDS = "a window needs {rule.history:g} s before its start and {rule.horizon:g} s after it"
_FIELDS = ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot")


@dataclass(frozen=True)
class _Part:
    """The evaluation of one voyage."""

    windows: pd.DataFrame
    plans: tuple[Plan, ...]
    reference: Path
    paths: dict[str, Path]
    data: dict[str, Any]


def _predict(predictors: Sequence[Predicts], voyage: Voyage, rule: Rule, times: np.ndarray, number: int) -> _Part:
    states, reference = voyage.states, voyage.reference
    starts = find_starts(states, rule, voyage.shaft)
    begin = states["time_s"][starts.rows]
    starts = starts.keep(reference.known(begin, rule.horizon), "no measured reference within the horizon")
    begin = states["time_s"][starts.rows]
    paths = {}
    for predictor in predictors if len(begin) else ():
        path = predictor.predict_many(states, starts.rows, starts.plans)
        paths[predictor.name] = _at(path, times, f"predictor {predictor.name}, voyage {voyage.name}", begin)
    data = {
        "voyage": voyage.name,
        "sha256": voyage.sha256,
        "reference": reference.kind,
        "windows": len(begin),
        "excluded": dict(starts.excluded),
    }
    windows = pd.DataFrame({"voyage": number, "time_s": begin, "group": starts.groups})
    return _Part(windows, starts.plans, reference.path(begin, times), paths, data)


def _at(path: Path, times: np.ndarray, where: str, begin: np.ndarray) -> Path:
    """The path at `times`; its own last instant may miss the horizon by rounding. Raises InputError if it is no path."""
    if path.time[-1] < times[-1] - 1e-6:
        raise InputError(
            f"{where}: predicts {path.time[-1]:g} s, {times[-1]:g} s are needed; train it for that horizon"
        )
    path = replace(path.at(np.minimum(times, path.time[-1])), time=times, convergence=0.0)
    wrong = ~np.isfinite(path.north + path.east + path.heading).all(axis=-1)
    if wrong.any():
        raise InputError(
            f"{where}: the path from {begin[np.argmax(wrong)]:g} s is not finite; train the predictor again"
        )
    return path


def _stack(paths: list[Path]) -> Path:
    values = {name: np.concatenate([getattr(path, name) for path in paths]) for name in _FIELDS}
    return replace(paths[0], spread=stacked(paths), **values)


def sees_future(predictor: Predicts, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> bool:
    """Whether a prediction from any of `rows` moves when later rows of the states change: it never may."""
    rng = np.random.default_rng(0)
    for row, plan in zip(rows, plans, strict=True):
        table = states.table.copy()
        for name in table.columns.drop("time_s"):
            later = table[name].to_numpy().copy()
            if later.dtype == bool:
                later[row + 1 :] = ~later[row + 1 :]
            else:
                later[row + 1 :] = rng.normal(size=len(later) - row - 1)
            table[name] = later
        first = predictor.predict_many(states, np.array([row]), [plan])
        second = predictor.predict_many(replace(states, table=table), np.array([row]), [plan])
        if any(not np.array_equal(getattr(first, f), getattr(second, f), equal_nan=True) for f in _FIELDS):
            return True
    return False


def best_baseline(evaluation: Evaluation, group: str, horizon: float) -> str | None:
    """The kinematic baseline with the smallest median position error in a group at `horizon` [s]; None without one."""
    rows, column = evaluation.rows(group), evaluation.column(horizon)
    names = [name for name in BASELINES if name in evaluation.errors]
    if not names or not len(rows):
        return None
    return min(names, key=lambda name: float(np.median(evaluation.errors[name].position[rows, column])))


def ratios(evaluation: Evaluation, group: str, horizon: float, against: str) -> dict[str, Ratio]:
    """Ratio of every predictor's median position error to that of `against`, in a group at `horizon` [s]."""
    rows, column = evaluation.rows(group), evaluation.column(horizon)
    names = list(evaluation.errors)
    values = np.stack([evaluation.errors[name].position[rows, column] for name in names], axis=-1)
    found = paired_ratios(values, names.index(against), evaluation.voyages(rows), evaluation.seed)
    return dict(zip(names, found, strict=True))


def metrics(evaluation: Evaluation) -> dict[str, Any]:
    """The content of metrics.json: metres and degrees by predictor, group and horizon [s].

    `coverage_95` holds the share of true places inside the 95 % regions by predictor, group and horizon, where there are
    regions; `regions` that of headings too, two standard errors by a bootstrap over voyages, and the median sizes. A group
    without windows has n = 0 and no horizons.
    """
    shares, details = coverage_metrics(evaluation, evaluation.rule.groups)
    predictors: dict[str, Any] = {}
    for name, errors in evaluation.errors.items():
        predictors[name] = {}
        for group in evaluation.rule.groups:
            rows = evaluation.rows(group)
            horizons = {}
            for horizon in evaluation.rule.horizons if len(rows) else ():
                column = evaluation.column(horizon)
                horizons[f"{horizon:g}"] = summary(errors.position[rows, column], errors.heading[rows, column])
            predictors[name][group] = {"n": len(rows), "horizons": horizons}
    return {
        "predictors": predictors,
        "coverage_95": shares,
        "regions": details,
        "windows": len(evaluation.windows),
        "data": list(evaluation.data),
        "seed": evaluation.seed,
    }


def write_metrics(evaluation: Evaluation, path: str | FilePath) -> None:
    """Write metrics.json, whole or not at all."""
    with records.atomic(path) as temporary:
        temporary.write_text(json.dumps(metrics(evaluation), indent=1, allow_nan=False) + "\n")


def headline_groups(evaluation: Evaluation) -> list[str]:
    """The groups that tables and figures show: those of the rule that have windows."""
    return [group for group in evaluation.rule.shown if len(evaluation.rows(group))]


def metres(evaluation: Evaluation, value: float) -> str:
    """A position error as people read it: centimetres for ships, millimetres for model ships."""
    return f"{value:.{3 if evaluation.vessel.length < MODEL_SHIP_LENGTH else 2}f}"


def reference_note(evaluation: Evaluation) -> str:
    """One sentence: what the errors were measured against."""
    kinds = Counter(entry["reference"] for entry in evaluation.data)
    words = {"truth": "the true path at midship", "smoothed": "the smoothed path at midship (no truth exists)"}
    if len(kinds) == 1:
        return f"Errors against {words[next(iter(kinds))]}."
    return f"Errors against {' and '.join(f'{words[kind]} in {count} voyages' for kind, count in kinds.items())}."


def table(evaluation: Evaluation) -> "Table":
    """Median and 95th percentile of every predictor at the last horizon, by group: what the command line prints."""
    from rich.table import Table

    horizon = evaluation.rule.horizon
    caption = [reference_note(evaluation), "Position in m, heading absolute in deg: median / 95th percentile."]
    caption += [f"[bold red]Warning: {warning}[/bold red]" for warning in evaluation.warnings]
    caption += [f"{name} left out: {reason}" for name, reason in evaluation.left_out.items()]
    shown = Table(title=f"Errors after {horizon:g} s", caption="\n".join(caption), caption_justify="left")
    shown.add_column("predictor", no_wrap=True)
    regions = ("95 % region holds", "its area m2") if calibrated(evaluation) else ()
    for name in ("position m", "heading deg", "ratio to best baseline", *regions):
        shown.add_column(name, justify="right", no_wrap=True)
    scores = metrics(evaluation)["predictors"]
    for group in headline_groups(evaluation):
        baseline = best_baseline(evaluation, group, horizon)
        shares = ratios(evaluation, group, horizon, baseline) if baseline else {}
        shown.add_section()
        count = next(iter(scores.values()))[group]["n"]
        shown.add_row(f"[bold]{group}[/bold] ({count} windows)")
        for name, groups in scores.items():
            at = groups[group]["horizons"][f"{horizon:g}"]
            place, turn = at["position_m"], at["heading_deg"]
            held = coverage(evaluation, name, group, horizon)
            shown.add_row(
                f"  {name}",
                f"{metres(evaluation, place['median'])} / {metres(evaluation, place['p95'])}",
                f"{turn['median_abs']:.2f} / {turn['p95_abs']:.2f}",
                f"{shares[name].value:.3f}" if shares else "",
                *(("",) * len(regions) if held is None else (str(held.position), f"{held.area:.3g}")),
            )
    return shown
