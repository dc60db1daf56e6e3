"""The figures and the page of paper_002.py: figures 2 to 6 of the paper in our form, all laws beside each other, paths that bend."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from case_page import write_case
from matplotlib.figure import Figure
from paper_6_figures import BLUE, GREEN, ORANGE, RED, clean, svg
from paper_6_tables import Table
from pivot_figures import SOFT, TRUE

from aspnn.angles import difference
from aspnn.evaluation.path_indices import path_indices
from aspnn.records import atomic

CONVENTIONAL, PAPER, TUNED, EXACT = (
    "conventional LOS",
    "KF-LOS, paper's R and Q",
    "KF-LOS, (7) and (11), tuned",
    "KF-LOS, exact, tuned",
)
INKS = {
    CONVENTIONAL: RED,
    PAPER: ORANGE,
    TUNED: "#a371f7",
    EXACT: BLUE,
    "integral LOS": GREEN,
    "adaptive LOS": "#bf8700",
}
SHOWN = slice(0, 3000)  # steps of figures 2 to 4: two runs and the turns between them
WORDS = {
    "2": "Figure 2: the heading that the KF-LOS asks for (the paper's R and Q, sensors with noise) and the measured one.",
    "3": "Figure 3: cross-track error as measured and as the filter has it. Each turn inverts the line, and the sign with it.",
    "4": "Figure 4: sideslip by the filter with the paper's R and Q and tuned, beside the measured course less the measured heading.",
    "5": "Figures 5 and 6: true tracks, the line is the abscissa and the craft comes from its end, turning. Sensors with noise.",
    "laws": "All laws in one run without noise: how the cross-track error dies out, and where the conventional law rests. Dashed: its formula.",
    "bent": "The same waypoints as lines with arcs, and as a spline; current from the west, no noise. Below: cross-track errors.",
}


def over_time(run, other) -> Iterator[tuple[str, Figure]]:
    """Figures 2 to 4 of the first line; `other` is the run of the tuned filter."""
    s = {name: values[0][SHOWN] for name, values in run.seen.items()}
    time = s["time"]
    figure = Figure(figsize=(12.4, 3.0), layout="constrained")
    axes = figure.add_subplot()
    heading = np.degrees(s["heading"])
    asked = heading + np.degrees(difference(s["desired"], s["heading"]))  # on the turn of the circle that is nearest
    axes.plot(time, asked, color=ORANGE, linewidth=1.2, label="asked for")
    axes.plot(time, heading, color=BLUE, linewidth=0.9, label="measured")
    _finish(figure, axes, "heading [deg]", "2")
    yield "2", figure
    figure = Figure(figsize=(12.4, 3.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(time, s["cross"], color=TRUE, linewidth=2.4, label="measured")
    axes.plot(time, s["filtered"], color=ORANGE, linewidth=0.9, label="filter, paper's R and Q")
    _finish(figure, axes, "cross-track error [m]", "3")
    yield "3", figure
    figure = Figure(figsize=(12.4, 3.4), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(time, np.degrees(s["told"]), color=TRUE, linewidth=0.8, label="measured: course less heading")
    axes.plot(time, np.degrees(s["sideslip"]), color=ORANGE, linewidth=0.9, label="filter, paper's R and Q")
    o = other.seen
    axes.plot(
        o["time"][0][SHOWN], np.degrees(o["sideslip"][0][SHOWN]), color=BLUE, linewidth=1.5, label="filter, tuned"
    )
    axes.set_ylim(-50, 50)
    _finish(figure, axes, "sideslip [deg]", "4")
    yield "4", figure


def _finish(figure: Figure, axes, label: str, number: str) -> None:
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.margins(x=0.01)
    clean(axes)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=3, frameon=False)


def lines_figure(runs, true_line, length: float) -> Figure:
    """Figures 5 and 6: tracks in the frame of the line, conventional beside KF-LOS, with their indices."""
    figure = Figure(figsize=(12.4, 7.2), layout="constrained")
    for row, leg in zip(figure.subplots(2, 2, sharex=True, sharey=True), (2, 1), strict=True):
        for axes, name in zip(row, (CONVENTIONAL, PAPER), strict=True):
            along, cross, line = true_line(runs[name], 1, leg)
            found = path_indices(along, cross, length)
            axes.plot([0, length], [0, 0], color=TRUE, linewidth=3.5, alpha=0.6, label="line")
            axes.plot(along, cross, color=INKS[name], linewidth=1.4, label=name)
            axes.text(
                0.98, 0.97,
                f"A1 {found.turning_area:.0f} m²   A2 {found.approach_area:.0f} m²   A3* {found.steady_area:.1f} m²\n"
                f"A3*/length {found.steady_area_per_m:.2f} m   vertical {found.vertical:.1f} m   horizontal {found.horizontal:.1f} m\n"
                f"offset {found.offset:+.2f} m",
                transform=axes.transAxes, ha="right", va="top", fontsize=9, color=SOFT,
            )  # fmt: skip
            axes.set_title(f"{name}, line at {line:.0f}°", loc="left", fontsize=10)
            axes.set_ylim(13, -13)  # starboard down, as on a chart that looks along the line
            clean(axes)
    for axes in figure.axes[2:]:
        axes.set_xlabel("along the line [m]")
    for axes in figure.axes[::2]:
        axes.set_ylabel("to starboard of the line [m]")
    return figure


def laws_figure(runs, true_line, offset: float) -> Figure:
    """Cross-track error along the line, by law: near the line, and the whole turn."""
    figure = Figure(figsize=(12.4, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        for name, run in runs.items():
            along, cross, _ = true_line(run, 0, 2)
            axes.plot(along, cross, color=INKS[name], linewidth=1.4, label=name)
        axes.axhline(offset, color=RED, linewidth=1, linestyle="--")
        axes.axhline(0, color=TRUE, linewidth=1)
        axes.set_xlabel("along the line [m]")
        clean(axes)
    left.set_ylabel("to starboard of the line [m]")
    right.set_ylim(-0.5, 2.0)
    right.set_xlim(15, 130)
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=6, frameon=False, fontsize=9)
    return figure


def bent_figure(curved) -> Figure:
    """Maps of the two paths with the tracks, and the cross-track errors along them."""
    figure = Figure(figsize=(12.4, 8.6), layout="constrained")
    upper, lower = figure.subplots(2, 2, height_ratios=(1.7, 1))
    for top, below, path in zip(upper, lower, next(iter(curved.values())), strict=True):
        for name in (CONVENTIONAL, PAPER, EXACT, "integral LOS", "adaptive LOS"):
            run = curved[name][path]
            voyage, seen = run.voyages[0], run.seen
            if name == CONVENTIONAL:
                foot = seen["cross"][0] * np.exp(
                    1j * (seen["angle"][0] + np.pi / 2)
                )  # from the foot point to the craft
                top.plot(
                    voyage.east - foot.imag, voyage.north - foot.real, color=TRUE, linewidth=4, alpha=0.5, label="path"
                )
            top.plot(voyage.east, voyage.north, color=INKS[name], linewidth=1.2, label=name)
            below.plot(seen["along"][0], seen["cross"][0], color=INKS[name], linewidth=1.1)
        top.set_aspect("equal", adjustable="datalim")
        top.set_title(path, loc="left", fontsize=10)
        top.set_xlabel("east [m]")
        below.set_xlabel("along the path [m]")
        below.axhline(0, color=TRUE, linewidth=1)
        clean(top)
        clean(below)
    upper[0].set_ylabel("north [m]")
    lower[0].set_ylabel("to starboard of the path [m]")
    figure.legend(*upper[0].get_legend_handles_labels(), loc="outside upper center", ncols=6, frameon=False, fontsize=9)
    return figure


def write(
    out: Path, tables: Sequence[Table], runs: tuple, true_line: Callable, length: float, offset: float, reasons: str
) -> Iterator[Path]:
    """All figures as PNG and the page; yields the files.

    `runs` without noise, in noise and on paths that bend; `true_line` gives places in the frame of a line of `length` [m]; `offset` [m]
    is that of the conventional law on the first line.
    """
    still, noisy, curved = runs
    figures = dict(over_time(noisy[PAPER], noisy[EXACT]))
    figures["5"] = lines_figure(noisy, true_line, length)
    figures["laws"] = laws_figure(still, true_line, offset)
    figures["bent"] = bent_figure(curved)
    titles = {
        "2": "Heading",
        "3": "Cross-track error",
        "4": "Sideslip",
        "5": "Tracks",
        "laws": "All laws",
        "bent": "Paths that bend",
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        file = out / f"paper_002_{name}.png"
        with atomic(file) as temporary:
            figure.savefig(temporary, dpi=120, format="png")
        yield file
    sections = [(titles[name], WORDS[name], svg(figure)) for name, figure in figures.items()]
    summary = (
        "A small craft follows lines in a current of 0.3 m/s by six guidance laws; the paper's figures in our form."
    )
    write_case(out / "paper_002.html", "Paper 002: KF-based line of sight", summary, sections, tables, reasons)
    yield out / "paper_002.html"
