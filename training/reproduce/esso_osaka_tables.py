"""What the cross-validation over the recordings prints: errors beside targets, by type of run, and regions by type."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from esso_osaka_regions import Floor, Regions
from rich.table import Table

from aspnn.evaluation.coverage import share
from aspnn.evaluation.evaluate import Evaluation
from aspnn.evaluation.windows import ORDER, STEADY

FEW = 20  # windows: of fewer the 95th percentile is not given
JUMPS, WHOLE = "jumps", "no jumps"
TOLD = f"{JUMPS}: windows whose labels jump; {WHOLE}: those at orders whose labels do not."
FEWEST = 10  # windows: of fewer the share that regions held is not given
# What is aimed at after 10, 20 and 30 s [m, deg]: a floor, and what is ambitious.
TARGETS: dict[str, dict[str, tuple[tuple[float, ...], tuple[float, ...]]]] = {
    ORDER: {
        "median m": ((0.07, 0.18, 0.34), (0.05, 0.14, 0.27)),
        "p95 m": ((0.20, 0.47, 0.88), (0.16, 0.38, 0.70)),
        "heading deg": ((1.5, 3.6, 6.0), (1.2, 3.0, 5.0)),
    },
    STEADY: {
        "median m": ((0.06, 0.16, 0.30), (0.05, 0.13, 0.26)),
        "p95 m": ((0.18, 0.40, 0.78), (0.14, 0.35, 0.65)),
    },
}
# And of the median error at the last horizon: its ratio to another predictor's. The polynomial is to be bettered by 15 %.
RATIOS = {f"{ORDER}, to constant": "floor 0.25, ambitious 0.20", f"{ORDER}, to polynomial": "floor 0.85"}


def kinds(evaluation: Evaluation) -> np.ndarray:
    """The type of run of each window: the first word of the voyage's name."""
    names = np.array([entry["voyage"].split("_")[0] for entry in evaluation.data])
    return names[evaluation.windows["voyage"].to_numpy()]


def measured(evaluation: Evaluation, name: str, rows: np.ndarray) -> dict[str, list[float]]:
    """Errors of a predictor in some windows at the rule's horizons: median, p95 (of FEW or more) and median heading."""
    columns = [evaluation.column(h) for h in evaluation.rule.horizons]
    errors = evaluation.errors[name]
    place, turn = errors.position[rows][:, columns], np.degrees(np.abs(errors.heading[rows][:, columns]))
    found = {"median m": np.median(place, axis=0), "heading deg": np.median(turn, axis=0)}
    if len(rows) >= FEW:
        found["p95 m"] = np.percentile(place, 95, axis=0)
    return {what: values.tolist() for what, values in found.items()}


def row(values: Sequence[float] | None, digits: int = 3) -> str:
    """Numbers at the horizons as one cell."""
    return "too few" if values is None else " / ".join(f"{value:.{digits}f}" for value in values)


def target_table(evaluation: Evaluation, name: str) -> Table:
    """The predictor beside the targets: what is reached, and by how much the rest is missed."""
    shown = Table(title=f"{name} beside the targets, after 10 / 20 / 30 s")
    for title in ("group", "what", "measured", "floor", "above the floor", "ambitious"):
        shown.add_column(title, no_wrap=True)
    for group, wanted in TARGETS.items():
        here = measured(evaluation, name, evaluation.rows(group))
        for what, (floor, high) in wanted.items():
            digits = 1 if what.endswith("deg") else 3
            have = here.get(what)
            over = [] if have is None else [100 * (a / b - 1) for a, b in zip(have, floor, strict=True)]
            verdict = " / ".join("reached" if x <= 0 else f"{x:.0f} %" for x in over)
            shown.add_row(group, what, row(have, digits), row(floor, digits), verdict, row(high, digits))
    return shown


def seeds_table(told: Sequence[Mapping[str, Any]], name: str) -> Table:
    """Medians over sets of seeds, and their ranges: a predictor's errors beside the targets, and what its regions held.

    Each of `told` has `by_horizon` (group, predictor, what, values at the horizons) and `coverage` as `coverage_rows` has it.
    """
    shown = Table(title=f"{name}: median and range of {len(told)} sets of seeds, after 10 / 20 / 30 s", caption=TOLD)
    for title in ("group", "what", "median", "lowest", "highest", "floor"):
        shown.add_column(title, no_wrap=True)

    def add(group: str, what: str, values: np.ndarray, digits: int, aim: str) -> None:
        spread = np.median(values, axis=0), values.min(axis=0), values.max(axis=0)
        shown.add_row(group, what, *(row(v.tolist(), digits) for v in spread), aim)

    for group, wanted in (TARGETS | {WHOLE: TARGETS[ORDER]}).items():
        for what, (floor, _) in wanted.items():
            found = [each["by_horizon"][group][name].get(what) for each in told]
            if all(found):
                digits = 1 if what.endswith("deg") else 3
                add(group, what, np.array(found), digits, row(floor, digits))
    for part, values in told[0]["coverage"].items():
        for what in ("position", "heading") if "position" in values else ():
            add(part, f"{what} held", np.array([each["coverage"][part][what] for each in told]), 3, "")
    return shown


def kind_table(evaluation: Evaluation, names: Sequence[str], parts: Mapping[str, np.ndarray]) -> Table:
    """Errors of some predictors in parts of the windows (masks by title), after 10 / 20 / 30 s."""
    shown = Table(title="Errors after 10 / 20 / 30 s, by type of run", caption=f"p95 of {FEW} windows or more. {TOLD}")
    for title in ("windows", "predictor", "median m", "p95 m", "heading deg"):
        shown.add_column(title, no_wrap=True)
    for title, mask in parts.items():
        rows = np.flatnonzero(mask)
        shown.add_section()
        for k, name in enumerate(names if len(rows) else ()):
            found = measured(evaluation, name, rows)
            cells = row(found["median m"]), row(found.get("p95 m")), row(found["heading deg"], 1)
            shown.add_row(f"{title} ({len(rows)})" if k == 0 else "", name, *cells)
    return shown


def parts_of(evaluation: Evaluation, outside: np.ndarray, jumping: np.ndarray) -> dict[str, np.ndarray]:
    """Masks (windows,) by title: groups, types of run within groups, orders `outside` the range of training, labels that jump."""
    steady = (evaluation.windows["group"] == STEADY).to_numpy()
    found = {ORDER: ~steady, STEADY: steady}
    kind = kinds(evaluation)
    for name in np.unique(kind):
        found |= {f"{name}, {group}": (kind == name) & mask for group, mask in ((ORDER, ~steady), (STEADY, steady))}
    return found | {"orders outside training": outside, JUMPS: jumping, WHOLE: ~steady & ~jumping}


def coverage_rows(evaluation: Evaluation, regions: Regions, outside: np.ndarray, jumping: np.ndarray) -> dict[str, Any]:
    """Coverage and area of the regions at the horizons, overall, by group and by type of run, where windows are FEWEST or more."""
    kind = kinds(evaluation)
    steady = (evaluation.windows["group"] == STEADY).to_numpy()
    parts = {"all": np.full(len(kind), True), ORDER: ~steady, STEADY: steady}
    parts |= {str(name): kind == name for name in np.unique(kind)}
    parts |= {"orders outside training": outside, JUMPS: jumping}
    names = np.array([entry["voyage"] for entry in evaluation.data])[evaluation.windows["voyage"].to_numpy()]
    found: dict[str, Any] = {}
    for title, mask in parts.items():
        known = mask & np.isfinite(regions.area).all(axis=1)
        found[title] = {"windows": int(known.sum())}
        if known.sum() < FEWEST:
            continue
        for what, held in (("position", regions.position), ("heading", regions.heading)):
            shares = [share(column, names[known], evaluation.seed) for column in held[known].T]
            found[title][what] = [s.value for s in shares]
            found[title][f"{what}_two_errors"] = [s.two_errors for s in shares]
        found[title]["area_median_m2"] = np.median(regions.area[known], axis=0).tolist()
        found[title]["heading_half_width_median_deg"] = np.degrees(np.median(regions.width[known], axis=0)).tolist()
    return found


def coverage_table(found: Mapping[str, Any]) -> Table:
    """Coverage of the 95 % regions, as `coverage_rows` has it."""
    caption = f"± two standard errors of the last share, by a bootstrap over runs; of {FEWEST} windows or more."
    aim = "0.93 to 0.97 overall and 0.85 in every type of run are aimed at"
    shown = Table(title=f"95 % regions after 10 / 20 / 30 s: {aim}", caption=caption)
    for title in ("windows", "place held", "heading held", "median area m2"):
        shown.add_column(title, no_wrap=True)
    for title, values in found.items():
        if "position" not in values:
            shown.add_row(f"{title} ({values['windows']})", "too few", "too few", "")
            continue
        cells = [f"{row(values[k])} ± {values[f'{k}_two_errors'][-1]:.3f}" for k in ("position", "heading")]
        shown.add_row(f"{title} ({values['windows']})", *cells, row(values["area_median_m2"]))
    return shown


def floor_rows(floor: Floor) -> dict[str, Any]:
    """Medians and 95th percentiles of the labels' noise at the horizons: places [m], headings [deg]."""
    found: dict[str, Any] = {}
    for name, (place, heading) in (("smoother", floor.smoother), ("halves", floor.halves)):
        for what, values in (("position_m", place), ("heading_deg", np.degrees(heading))):
            median, high = np.percentile(values, [50, 95], axis=0)
            found[f"{name}_{what}"] = {"median": median.tolist(), "p95": high.tolist()}
    return found


def floor_table(found: Mapping[str, Any]) -> Table:
    """Noise of the labels, as `floor_rows` has it."""
    shown = Table(title="Noise of the labels after 10 / 20 / 30 s: errors are read against it")
    for title in ("by", "median", "p95"):
        shown.add_column(title, no_wrap=True)
    titles = {
        "smoother_position_m": "place m, the smoother's own deviation",
        "halves_position_m": "place m, halves of the record apart",
        "smoother_heading_deg": "heading deg, the smoother's own deviation",
        "halves_heading_deg": "heading deg, halves of the record apart",
    }
    for name, title in titles.items():
        shown.add_row(title, *(row(found[name][k], 3) for k in ("median", "p95")))
    return shown
