"""The tables of paper_6.py: published figures beside ours."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from aspnn.estimation.consistency import average_bounds, shares

DOF = {"CAA": 2.0, "3D-PV": 3.0}
STEADY = 10.0  # s after the order: predictions that start later are those "after the steady state" (assumed)


class Table(NamedTuple):
    """A table as it is printed and shown, with its `values` for JSON."""

    title: str
    note: str
    heads: list[str]
    rows: list[list[str]]
    values: dict[str, Any]

    def lines(self) -> Iterator[str]:
        """As Markdown."""
        yield f"{self.title}. {self.note}"
        yield f"| {' | '.join(self.heads)} |"
        yield "|---" * len(self.heads) + "|"
        for row in self.rows:
            yield f"| {' | '.join(row)} |"


def parts(values: np.ndarray, bounds) -> np.ndarray:
    """Percentages inside, below and above bounds, NaN left out."""
    found = shares(values, *bounds)
    return 100 * np.array([found.inside, found.below, found.above])


def nis_table(found: dict[str, list[dict[str, dict[str, np.ndarray]]]], table_4: pd.DataFrame, bounds) -> Table:
    """Table 4: shares of the NIS by turn, model and filter; `found` has them by turn, voyage, filter and model.

    Of ours the mean over voyages, and of the share inside the least and the largest of single voyages.
    """
    rows, values = [], {}

    def cells(some: np.ndarray) -> list[str]:
        low, high = some[:, 0].min(), some[:, 0].max()
        return [" / ".join(f"{x:.1f}" for x in some.mean(axis=0)), f"{low:.0f} to {high:.0f}"]

    for turn, model in ((turn, model) for turn in found for model in DOF):
        published = table_4.set_index(["maneuver", "model"]).loc[(turn, model), ["within", "below", "above"]]
        told = f"{published['within']:.2f} / {published['below']:.2f} / {published['above']:.2f}"
        rows.append([turn, model, "published", told, "", "", ""])
        right = [float(bound) for bound in average_bounds(DOF[model])]
        for way in found[turn][0]:
            by = [np.array([parts(voyage[way][model], b) for voyage in found[turn]]) for b in (bounds, right)]
            rows.append([turn, model, way, *cells(by[0]), *cells(by[1])])
            values[f"{turn}, {model}, {way}"] = {
                "paper_bounds_percent": by[0].mean(axis=0).tolist(),
                "right_bounds_percent": by[1].mean(axis=0).tolist(),
            }
        values[f"{turn}, {model}, published"] = {"paper_bounds_percent": published.tolist()}
    two, three = (tuple(float(bound) for bound in average_bounds(DOF[model])) for model in DOF)
    note = (
        f"Percent inside / below / above. The paper takes ({bounds[0]}, {bounds[1]}) for both; right are ({two[0]:.4f}, {two[1]:.4f}) for "
        f"CAA and ({three[0]:.4f}, {three[1]:.4f}) for 3D-PV (E32). The text of the paper exchanges the turns (E33)."
    )
    heads = ["turn", "model", "filter", "paper's bounds", "inside, voyages", "right bounds", "inside, voyages"]
    return Table("NIS (table 4)", note, heads, rows, values)


def pivot_table(places, true, text: pd.Series) -> Table:
    """The pivot point in the circle by turn and way: `places` and `true` by turn and voyage."""
    rows, values = [], {}
    for turn in places:
        published = text[f"pivot_interval_{turn}"]
        rows.append([turn, "published", f"{published:.2f}", "", "", "", ""])
        at = np.concatenate(true[turn])
        for way in places[turn][0]:
            place, low, high = (
                np.concatenate([getattr(voyage[way], part) for voyage in places[turn]])
                for part in ("place", "low", "high")
            )
            use = np.isfinite(low) & np.isfinite(high) & np.isfinite(place)
            half, error = (high - low)[use] / 2, np.abs(place - at)[use]
            inside = 100 * np.mean(((low <= at) & (at <= high))[~np.isnan(place)])
            found = {
                "mean_half_width_m": float(half.mean()),
                "median_half_width_m": float(np.median(half)),
                "covered_percent": float(inside),
                "median_error_m": float(np.median(error)),
                "p95_error_m": float(np.percentile(error, 95)),
            }
            cells = [f"{x:.1f}" if name == "covered_percent" else f"{x:.2f}" for name, x in found.items()]
            rows.append([turn, way, *cells])
            values[f"{turn}, {way}"] = found
        values[f"{turn}, published"] = {"mean_half_width_m": float(published)}
    heads = ["turn", "way", "interval +- m, mean", "median", "holds the true one %", "error m, median", "p95"]
    note = (
        "Over ground, in the circle, from 6 s after the order. The processes are given v and r of the paper's filter as if these had no "
        "error, the exact one those of ours with what that says of their errors."
    )
    return Table("Pivot point in the circle", note, heads, rows, values)


def prediction_table(runs, text: pd.Series, title: str) -> Table:
    """Errors after 10 s by turn, start and method, and the largest of the steady starts beside the published one."""
    rows, values = [], {}
    steady: dict[str, list[np.ndarray]] = {}
    order = {"PT": 4.0, "SBT": 3.0}
    names = list(next(iter(runs.values()))[0].errors)
    for turn, starts in runs.items():
        for run in starts:
            cells = []
            for name, errors in run.errors.items():
                last = np.stack([errors.position[:, -1], np.degrees(np.abs(errors.heading[:, -1]))])
                (place, turned), (far, askew) = np.median(last, axis=1), np.percentile(last, 95, axis=1)
                cells.append(f"{place:.1f} / {far:.1f}; {turned:.0f} / {askew:.0f}")
                values[f"{turn} {run.start:g} s, {name}"] = {
                    "position_m": {"median": float(place), "p95": float(far)},
                    "heading_deg": {"median": float(turned), "p95": float(askew)},
                }
                if run.start > order[turn] + STEADY:
                    steady.setdefault(name, []).append(last)
            rows.append([f"{turn}, {run.start:g} s", f"{run.start - order[turn]:g}", *cells])
    for what, pick in (
        ("largest", lambda a: np.max(a, axis=1)),
        ("median of the voyages' largest", lambda a: np.median(a, axis=1)),
    ):
        cells = []
        for name in names:
            last = np.concatenate(steady[name], axis=1)
            if what != "largest":  # of each voyage over its steady starts, as the paper has one voyage of each turn
                last = np.stack(steady[name]).max(axis=0)
            place, turned = pick(last)
            cells.append(f"{place:.1f}; {turned:.0f}")
            values[f"steady, {what}, {name}"] = {"position_m": float(place), "heading_deg": float(turned)}
        rows.append([f"steady, {what}", "> 10", *cells])
    rows.append(
        ["steady, published largest", "> 10", f"{text['position_max']:g}; {text['heading_max']:g}"]
        + [""] * (len(names) - 1)
    )
    values["steady, published largest"] = {
        "position_m": float(text["position_max"]),
        "heading_deg": float(text["heading_max"]),
    }
    note = (
        "Median / 95th percentile of the voyages: position m; heading deg (absolute), against the true path. VI: constant u, v, r of the "
        "paper's filter, by its algorithm 2 about the pivot point of the process (as the thesis has it), and by the exact step; then the "
        "kinematic methods and the exact step on the error-state filter, and that step through the water with the true current."
    )
    return Table(title, note, ["start", "s since the order", *names], rows, values)
