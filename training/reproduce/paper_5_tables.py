"""What paper_5.py prints, as lines of Markdown, and its values as JSON has them."""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pandas as pd

from aspnn.evaluation.evaluate import Evaluation, metrics
from aspnn.evaluation.windows import NEW, SHIP, STEADY
from aspnn.learning.checkpoint import Bundle

SETTLING = (30.0, 60.0, 90.0, 120.0, math.inf)  # s since the last order: where the steady windows are parted


def horizon_lines(evaluation: Evaluation, group: str) -> Iterator[str]:
    """Median / 95th percentile of every method by horizon, position [m] and absolute heading [deg]: two Markdown tables."""
    scores = metrics(evaluation)["predictors"]
    for what, title, median, high in (
        ("position_m", "position m", "median", "p95"),
        ("heading_deg", "heading deg", "median_abs", "p95_abs"),
    ):
        yield f"| {group}, {title} | " + " | ".join(scores) + " |"
        yield "|---" * (1 + len(scores)) + "|"
        for horizon in SHIP.horizons:
            at = [scores[name][group]["horizons"][f"{horizon:g}"][what] for name in scores]
            yield f"| {horizon:g} s | " + " | ".join(f"{a[median]:.2f} / {a[high]:.2f}" for a in at) + " |"


def order_words(evaluation: Evaluation, row: int) -> str:
    """The rudder order at a start [deg], with the one before it where it is new: `0 to +5`."""
    order = math.degrees(float(evaluation.plans[row].rudder.at(0.0)))
    change = float(evaluation.windows["change_deg"][row])
    angles = (order - change, order) if evaluation.windows["group"][row] == NEW else (order,)
    return " to ".join(f"{round(angle):+d}" if round(angle) else "0" for angle in angles)


def window_lines(evaluation: Evaluation, names: list[str]) -> Iterator[str]:
    """The errors of each start of the manoeuvre at the horizon: position [m] / heading [deg]."""
    yield "| start | order deg | " + " | ".join(evaluation.errors) + " |"
    yield "|---" * (2 + len(evaluation.errors)) + "|"
    end = evaluation.column(SHIP.horizon)
    for row, (name, window) in enumerate(zip(names, evaluation.windows.itertuples(), strict=True)):
        errors = [(e.position[row, end], np.degrees(abs(e.heading[row, end]))) for e in evaluation.errors.values()]
        cells = " | ".join(f"{place:.1f} / {turn:.1f}" for place, turn in errors)
        yield f"| {name}, {window.time_s:.0f} s | {order_words(evaluation, row)} | {cells} |"


def text_lines(text: pd.DataFrame, columns: dict[str, dict[str, float]]) -> Iterator[str]:
    """What the paper's words say beside ours, with whether ours lies in their interval."""
    yield "| quantity | published | " + " | ".join(columns) + " |"
    yield "|---" * (2 + len(columns)) + "|"
    for row in text.itertuples():
        unit = "" if row.unit == "1" else f" {row.unit}"
        said = f"{row.low:g}" if row.low == row.high else f"{row.low:g} to {row.high:g}"
        cells = []
        for values in columns.values():
            value = values.get(row.Index, math.nan)
            cells.append("-" if math.isnan(value) else f"{value:.3g}{unit}")
        yield f"| {row.words} ({row.where}) | {said}{unit} | " + " | ".join(cells) + " |"


def parting(curve: pd.DataFrame) -> float:
    """The epoch from which the validation loss stays a tenth above the training loss, medians of five epochs; NaN if it does not."""
    above = (curve["validation_loss"] / curve["train_loss"]).rolling(5, center=True, min_periods=1).median() > 1.1
    together = np.flatnonzero(~above.to_numpy())
    if len(together) == 0:
        return 1.0
    return float(together[-1] + 2) if together[-1] + 1 < len(curve) else math.nan


def curve_lines(curves: dict[str, pd.DataFrame]) -> Iterator[str]:
    """Figure 11 in words: where the validation loss leaves the training loss, where it is least, and how both end."""
    yield "| loss (MSE, scaled) | validation parts from training at epoch | least validation loss at | training at the end | validation |"
    yield "|---|---|---|---|---|"
    for name, curve in curves.items():
        last, least = curve.iloc[-1], curve["validation_loss"].to_numpy().argmin() + 1
        yield f"| {name} | {parting(curve):.0f} | {least} of {len(curve)} | {last.train_loss:.2g} | {last.validation_loss:.2g} |"


def settled_lines(evaluation: Evaluation) -> Iterator[str]:
    """Median position errors [m] at the horizon of the steady windows, by the time since the last order."""
    yield "| steady, since the last order | windows | " + " | ".join(evaluation.errors) + " |"
    yield "|---" * (2 + len(evaluation.errors)) + "|"
    rows, end = evaluation.rows(STEADY), evaluation.column(SHIP.horizon)
    since = evaluation.windows["since_s"].to_numpy()[rows]
    for low, high in pairwise(SETTLING):
        own = rows[(since >= low - 1e-6) & (since < high - 1e-6)]
        if len(own):
            medians = (np.median(e.position[own, end]) for e in evaluation.errors.values())
            span = f"{low:g} s or more" if math.isinf(high) else f"{low:g} to {high:g} s"
            yield f"| {span} | {len(own)} | " + " | ".join(f"{m:.2f}" for m in medians) + " |"


def settings(bundle: Bundle) -> dict[str, float]:
    """What table 6 lists, as a checkpoint has it."""
    spec, sizes, fit = bundle.spec, bundle.network.sizes, bundle.provenance["training"]["fit"]
    return {
        "training samples": bundle.provenance["training_windows"],
        "validation samples": bundle.provenance["validation_windows"],
        "input lag": spec.history_steps,
        "dense layers": len(sizes.dense),
        "nodes in 1st dense layer": sizes.dense[0],
        "nodes in 2nd dense layer": sizes.dense[1],
        "prediction horizon": sizes.steps,
        "learning rate": fit["learning_rate"],
        "batch": fit["batch"],
        "epochs": fit["epochs"],
    }
