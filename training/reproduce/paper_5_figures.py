"""Figures 10 to 17 of Paper V in our form, as PNG: what is drawn are evaluations of the validation manoeuvre and of voyages."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from paper_5_tables import order_words

from aspnn.evaluation.evaluate import Evaluation
from aspnn.evaluation.windows import NEW, STEADY
from aspnn.motion import Path as Track
from aspnn.records import atomic
from aspnn.vessel import Vessel

TITLES = {"gru_pp": "GRU-PP", "caa_ctra": "CAA + CTRA", "caa_cmm": "CAA + CMM", "flagship": "flagship"}
INKS = {"gru_pp": "#1f6feb", "caa_ctra": "#e36209", "caa_cmm": "#c9a227", "flagship": "#2a9d4a"}
TRUE, NEW_INK, STILL_INK = "#8c959f", "#d1242f", "#1f6feb"  # starts with new orders red, without blue, as in the paper
STYLES = {name: "--" if name == "caa_cmm" else "-" for name in TITLES}  # its heading is that of CAA + CTRA
EVERY = 15.0  # s between ship icons
LEAST = 0.05  # m or deg: errors below are drawn there on logarithmic axes


def legend(figure: Figure) -> None:
    """One legend of the methods, with the true motion."""
    lines = [Line2D([], [], color=INKS[name], ls=STYLES[name], label=title) for name, title in TITLES.items()]
    figure.legend(handles=lines, loc="outside lower center", ncols=len(lines), frameon=False)


def manoeuvre_figure(track: Track, orders, exercise: Evaluation, names: Sequence[str]) -> Figure:
    """Figure 10: the manoeuvre, its rudder orders, and where predictions start."""
    figure = Figure(figsize=(12.5, 4.4), layout="constrained")
    chart, rudder = figure.subplots(1, 2, width_ratios=(1.5, 1))
    start, origin = exercise.reference, (track.north[0], track.east[0])
    chart.plot(track.east - origin[1], track.north - origin[0], color=TRUE)
    times = exercise.windows["time_s"].to_numpy()
    held = [*(time for time, _ in orders), track.time[-1]]
    rudder.stairs([order for _, order in orders], held, color=TRUE, baseline=None)
    for row, name in enumerate(names):
        ink = NEW_INK if exercise.windows["group"][row] == NEW else STILL_INK
        label = f"${name[0]}_{{{name[2:]}}}$"
        place = start.east[row, 0] - origin[1], start.north[row, 0] - origin[0]
        order = np.degrees(float(exercise.plans[row].rudder.at(0.0)))
        for axes, point in ((chart, place), (rudder, (times[row], order))):
            axes.plot(*point, "o", color=ink, markersize=5)
            axes.annotate(label, point, color=ink, xytext=(6, 5), textcoords="offset points")
    chart.set(xlabel="east [m]", ylabel="north [m]", title="Trajectory; predictions start at the marks")
    chart.margins(0.09)
    chart.set_aspect("equal")
    rudder.set(xlabel="time [s]", ylabel="rudder order [deg], starboard positive", title="Rudder order")
    rudder.margins(y=0.12)
    return figure


def curves_figure(curves: dict[str, pd.DataFrame]) -> Figure:
    """Figure 11: training and validation loss of the three networks, a row for each run."""
    figure = Figure(figsize=(11, 3.2 * (len(curves) // 3) + 0.4), layout="constrained")
    panels = figure.subplots(len(curves) // 3, 3, squeeze=False).ravel()
    for axes, (name, curve) in zip(panels, curves.items(), strict=True):
        axes.plot(curve["epoch"] + 1, curve["train_loss"], color=INKS["gru_pp"], label="training")
        axes.plot(curve["epoch"] + 1, curve["validation_loss"], color=INKS["caa_ctra"], label="validation")
        axes.set(title=name, xlabel="epoch", yscale="log")
        axes.legend(frameon=False)
    panels[0].set_ylabel("mean square error, scaled")
    return figure


def track_panel(axes: Axes, exercise: Evaluation, row: int, name: str, vessel: Vessel) -> None:
    """One start of figures 12 and 14: the true hull filled, the predicted ones outlined, every 15 s."""
    hulls = np.arange(0.0, exercise.rule.horizon + 1, EVERY)
    true = exercise.reference[row]
    origin = np.array([true.north[0], true.east[0]])
    for outline in true.at(hulls).outline(vessel.outline()) - origin:
        axes.fill(outline[:, 1], outline[:, 0], color=TRUE, alpha=0.5, linewidth=0)
    for method, ink in INKS.items():
        path = exercise.paths[method][row]
        axes.plot(path.east - origin[1], path.north - origin[0], color=ink, ls=STYLES[method], linewidth=1.0)
        for outline in path.at(hulls[1:]).outline(vessel.outline()) - origin:
            axes.fill(outline[:, 1], outline[:, 0], facecolor="none", edgecolor=ink, linewidth=0.8)
    words = f"rudder {order_words(exercise, row)} deg"
    axes.set_title(f"${name[0]}_{{{name[2:]}}}$: {words}", fontsize=10)
    axes.set_aspect("equal", adjustable="datalim")


def tracks_figure(exercise: Evaluation, rows: Sequence[int], names: Sequence[str], vessel: Vessel) -> Figure:
    """Figures 12 and 14: predictions from some starts."""
    columns = min(4, len(rows))
    deep = -(-len(rows) // columns)
    figure = Figure(figsize=(4.2 * columns, 4.2 * deep + 0.4), layout="constrained")
    panels = figure.subplots(deep, columns, squeeze=False)
    for axes in panels.ravel()[len(rows) :]:
        axes.set_axis_off()
    for axes, row in zip(panels.ravel(), rows, strict=False):
        track_panel(axes, exercise, row, names[row], vessel)
    for axes in panels[:, 0]:
        axes.set_ylabel("north of the start [m]")
    for axes in panels.ravel()[max(len(rows) - columns, 0) : len(rows)]:
        axes.set_xlabel("east of the start [m]")
    figure.suptitle("True hull grey, predicted hulls outlined, every 15 s", fontsize=11)
    legend(figure)
    return figure


def errors_figure(exercise: Evaluation, rows: Sequence[int], names: Sequence[str]) -> Figure:
    """Figures 13 and 15: errors of position and heading along the horizon."""
    figure = Figure(figsize=(9, 2.7 * len(rows) + 0.4), layout="constrained")
    for panels, row in zip(figure.subplots(len(rows), 2, squeeze=False, sharex=True), rows, strict=True):
        for method, ink in INKS.items():
            errors = exercise.errors[method]
            panels[0].plot(exercise.times, errors.position[row], color=ink, ls=STYLES[method])
            panels[1].plot(exercise.times, np.degrees(np.abs(errors.heading[row])), color=ink, ls=STYLES[method])
        for axes, what in zip(panels, ("position error [m]", "heading error [deg]"), strict=True):
            axes.set(title=f"from ${names[row][0]}_{{{names[row][2:]}}}$", ylabel=what, ylim=(0, None))
            axes.set_xticks(exercise.rule.horizons)
    for axes in panels:
        axes.set_xlabel("prediction horizon [s]")
    legend(figure)
    return figure


def boxes_figure(exercise: Evaluation, unseen: Evaluation, group: str) -> Figure:
    """Figures 16 and 17: boxes (quartiles; whiskers 5 to 95 %) of the errors by horizon, of the manoeuvre and of all voyages."""
    figure = Figure(figsize=(11, 7.5), layout="constrained")
    width = 0.19
    for panels, evaluation, where in zip(
        figure.subplots(2, 2, sharex=True, sharey="col"),
        (exercise, unseen),
        ("manoeuvre", "unseen voyages"),
        strict=True,
    ):
        rows = evaluation.rows(group)
        columns = [evaluation.column(h) for h in evaluation.rule.horizons]
        for k, (method, ink) in enumerate(INKS.items()):
            errors = evaluation.errors[method]
            for axes, values in zip(panels, (errors.position, np.degrees(np.abs(errors.heading))), strict=True):
                drawn = axes.boxplot(
                    np.maximum(values[np.ix_(rows, columns)], LEAST),
                    positions=np.arange(len(columns)) + (k - 1.5) * width, widths=0.8 * width,
                    whis=(5, 95), showfliers=False, patch_artist=True, manage_ticks=False,
                )  # fmt: skip
                for part in drawn["boxes"]:
                    part.set(facecolor=ink, alpha=0.55, edgecolor=ink)
                for part in (*drawn["whiskers"], *drawn["caps"]):
                    part.set_color(ink)
                for part in drawn["medians"]:
                    part.set_color("black")
        for axes, what in zip(panels, ("position error [m]", "heading error [deg]"), strict=True):
            axes.set(yscale="log", ylabel=what, title=f"{where}: {len(rows)} starts")
            axes.set_xticks(range(len(columns)), [f"{h:g} s" for h in evaluation.rule.horizons])
            axes.grid(axis="y", color="#e8ebef")
            axes.set_axisbelow(True)
    legend(figure)
    return figure


def figures(
    track: Track,
    orders,
    exercise: Evaluation,
    names: Sequence[str],
    unseen: Evaluation,
    vessel: Vessel,
    curves: dict[str, pd.DataFrame],
) -> dict[int, Figure]:
    """The figures by the paper's numbers; figure 11 only where there are loss curves."""
    new, still = list(exercise.rows(NEW)), list(exercise.rows(STEADY))
    return {
        10: manoeuvre_figure(track, orders, exercise, names),
        **({11: curves_figure(curves)} if curves else {}),
        12: tracks_figure(exercise, new, names, vessel),
        13: errors_figure(exercise, [row for row in new if names[row] in ("t_A", "t_C", "t_E")], names),
        14: tracks_figure(exercise, still, names, vessel),
        15: errors_figure(exercise, still, names),
        16: boxes_figure(exercise, unseen, NEW),
        17: boxes_figure(exercise, unseen, STEADY),
    }


def write_figures(folder: Path, drawings: dict[int, Figure]) -> Iterator[Path]:
    """Write figures into `folder` as PNG, one after the other; yields their files."""
    for number, drawing in drawings.items():
        path = folder / f"paper_5_fig_{number}.png"
        with atomic(path) as temporary:
            drawing.savefig(temporary, format="png", dpi=110)
        yield path
