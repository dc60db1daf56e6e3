"""The report: one HTML file with everything in it, interactive and readable without a network."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pandas as pd

from aspnn import records
from aspnn.evaluation import plots
from aspnn.evaluation.coverage import calibrated, coverage
from aspnn.evaluation.evaluate import (
    BASELINES,
    ORACLE,
    TITLES,
    Evaluation,
    best_baseline,
    headline_groups,
    metres,
    metrics,
    ratios,
    reference_note,
)
from aspnn.evaluation.examples import Example, colours, examples
from aspnn.evaluation.page import embed, fill, versions
from aspnn.evaluation.windows import Rule

WORDS = {
    "caa_ctra": "kinematic: accelerations of surge, sway and yaw held (CAA and CTRA)",
    "caa_cmm": "kinematic: accelerations along and across the course, and of yaw, held (CAA and CMM)",
    "constant": "surge, sway and yaw rate held: the arc of bridge displays",
    "oracle": "the true simulator run on from the filtered state",
}


def write_report(
    evaluation: Evaluation,
    path: str | FilePath,
    curves: Mapping[str, pd.DataFrame] | None = None,
    notes: Mapping[str, str] | None = None,
    words: Mapping[str, str] | None = None,
) -> None:
    """Write the report of an evaluation, whole or not at all.

    `curves` are training curves by run (columns `epoch` and whatever has `loss` in its name); `notes` are further lines
    of the metadata (checkpoint hashes, training seeds); `words` describe predictors beside those of WORDS.
    """
    page = render(evaluation, curves or {}, notes or {}, words or {})
    with records.atomic(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def render(
    evaluation: Evaluation,
    curves: Mapping[str, pd.DataFrame],
    notes: Mapping[str, str],
    words: Mapping[str, str],
) -> str:
    """The report as HTML text."""
    colour = colours(evaluation)
    groups = headline_groups(evaluation)
    cases = [
        {
            "title": case.title,
            "group": case.group,
            "about": f"{case.voyage}, start at {case.time:g} s, rudder {_plan(case)}",
            "error": f"{metres(evaluation, case.errors[case.main][-1])} m",
            "tracks": embed(plots.tracks(case, evaluation.vessel, colour), f"tracks-{number}"),
            "course": embed(plots.course_of(case, evaluation.vessel, colour), f"course-{number}"),
        }
        for number, case in enumerate(examples(evaluation))
    ]
    return fill(
        "report.html.jinja",
        main=evaluation.main,
        vessel=evaluation.vessel,
        horizon=f"{evaluation.rule.horizon:g}",
        step=f"{evaluation.rule.horizon / 6:g}",
        reference=reference_note(evaluation),
        colour=colour,
        words=WORDS | dict(words),
        headline=[_headline(evaluation, group) for group in groups],
        cases=cases,
        growth=embed(plots.growth(evaluation), "growth"),
        boxes=[(group, TITLES[group], embed(plots.boxes(evaluation, group), f"boxes-{group}")) for group in groups],
        training=embed(plots.training(curves), "training") if curves else "",
        regions=[_regions(evaluation, name, groups) for name in calibrated(evaluation)],
        details=[_details(evaluation, group) for group in groups],
        definitions=definitions(evaluation.rule),
        left_out=evaluation.left_out,
        warnings=evaluation.warnings,
        excluded=sum((Counter(entry["excluded"]) for entry in evaluation.data), Counter()),
        windows=len(evaluation.windows),
        data=evaluation.data,
        metadata=versions() | {"bootstrap seed": evaluation.seed, **notes},
    )


def definitions(rule: Rule) -> dict[str, str]:
    """What the groups are, in words, for this rule."""
    change, horizon = f"{np.degrees(rule.order_change):g} deg", f"{rule.horizon:g} s"
    order = f"a rudder order changed by at least {change}, at least {rule.order_apart:g} s after the last such change"
    return {
        "new_order": f"the prediction starts at {order}, and the new order is held for the whole {horizon}",
        "orders_within_horizon": f"the prediction starts at {order}, and a further order follows inside the {horizon}",
        "order": "both of these together",
        "steady": f"no such order from {rule.steady_before:g} s before the start until {horizon} after it; "
        f"a start every {rule.steady_every:g} s in each such stretch",
    }


def _headline(evaluation: Evaluation, group: str) -> dict[str, Any]:
    """The rows of the headline table: one predictor each, at the last horizon."""
    horizon = evaluation.rule.horizon
    scores = metrics(evaluation)["predictors"]
    baseline = best_baseline(evaluation, group, horizon)
    against = [name for name in (baseline, ORACLE) if name is not None and name in scores]
    shares = {name: ratios(evaluation, group, horizon, name) for name in against}
    rows = []
    for name, groups in scores.items():
        at = groups[group]["horizons"][f"{horizon:g}"]
        numbers = [metres(evaluation, at["position_m"][key]) for key in ("median", "p95", "mean")]
        numbers += [f"{at['heading_deg'][key]:.2f}" for key in ("median_abs", "p95_abs")]
        rows.append(
            {
                "name": name,
                "numbers": [*numbers, _signed(at["heading_deg"]["median_signed"])],
                "ratios": [str(shares[other][name]) if other != name else "1" for other in against],
            }
        )
    return {
        "group": group,
        "title": TITLES[group],
        "n": len(evaluation.rows(group)),
        "against": [f"to {name}" + (" (best baseline)" if name in BASELINES else "") for name in against],
        "rows": rows,
    }


def _regions(evaluation: Evaluation, name: str, groups: list[str]) -> dict[str, Any]:
    """The 95 % regions of a predictor: coverage and size by group and horizon, and the reliability diagram."""
    lines = []
    for group in groups:
        for horizon in evaluation.rule.horizons:
            found = coverage(evaluation, name, group, horizon)
            if found is not None:
                sizes = [f"{found.area:.3g}", f"{np.degrees(found.width):.3g}", f"{found.outside:.1%}"]
                cells = [str(found.position), str(found.heading), *sizes]
                lines.append((group, f"{horizon:g}", found.position.windows, cells))
    figure = embed(plots.reliability(evaluation, name), f"reliability-{name}") if lines else ""
    return {"name": name, "lines": lines, "figure": figure}


def _details(evaluation: Evaluation, group: str) -> dict[str, Any]:
    """Every horizon of a group: position, along and cross track, heading."""
    rows = evaluation.rows(group)
    lines = []
    for horizon in evaluation.rule.horizons:
        column = evaluation.column(horizon)
        for name, errors in evaluation.errors.items():
            parts = [errors.position, np.abs(errors.along), np.abs(errors.cross), np.degrees(np.abs(errors.heading))]
            cells = [np.percentile(part[rows, column], [50, 95]) for part in parts]
            signed = [
                np.median(part[rows, column]) for part in (errors.along, errors.cross, np.degrees(errors.heading))
            ]
            lines.append((f"{horizon:g}", name, [f"{a:.2f} / {b:.2f}" for a, b in cells], [_signed(s) for s in signed]))
    return {"group": group, "lines": lines}


def _signed(number: float) -> str:
    return f"{round(number, 2) + 0.0:+.2f}"  # adding zero takes the sign off a rounded -0.0


def _plan(case: Example) -> str:
    rudder = case.plan.rudder
    words = [
        f"{np.degrees(value) + 0.0:.0f}° at {time:.0f} s"
        for time, value in zip(rudder.times, rudder.values, strict=True)
    ]
    return ", ".join(words[:4]) + (" and further orders" if len(words) > 4 else "")
