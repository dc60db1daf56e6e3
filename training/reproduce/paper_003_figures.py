"""The figures and the page of paper_003.py: figures 2 to 8 of the paper in our form, those of one seed."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from case_page import write_case
from matplotlib.figure import Figure
from paper_003_runs import VARIES, Run
from paper_6_figures import BLUE, GREEN, ORANGE, RED, clean, svg
from paper_6_tables import Table
from pivot_figures import SOFT, TRUE

from aspnn.estimation.craft import SURGE, SWAY, YAW_RATE
from aspnn.records import atomic

BARE, DRIFTS, SLOW = "no filter", "plain UKF, q 0.0001", "plain UKF, q 0.01"
ADAPTIVE, BANK = "adaptive UKF, from q 0.01", "bank of six UKF"
INKS = {DRIFTS: RED, SLOW: "#a371f7", BANK: BLUE, ADAPTIVE: ORANGE}
TITLES = {"2": "Tracking", "3": "Velocities", "6": "Forces", "8": "The mass m11"}
WORDS = {
    "2": "Figure 2: the track of the craft with the adaptive filter, and the distance from the reference with each filter (logarithmic).",
    "3": "Figures 3 to 5: surge, sway and yaw rate with the adaptive filter: measured, true, estimated and of the reference.",
    "6": "Figures 6 and 7: surge force and yaw moment without a filter and with the adaptive one.",
    "8": "Figure 8: m11 by filter, true in grey, and below it the q that each goes by.",
}
LETTERS = {SURGE: "surge [m/s]", SWAY: "sway [m/s]", YAW_RATE: "yaw rate [deg/s]"}


def tracking(runs: dict[str, Run]) -> Figure:
    """Figure 2."""
    figure = Figure(figsize=(12.4, 4.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
    run = runs[ADAPTIVE]
    left.plot(run.reference[:, 1], run.reference[:, 0], color=TRUE, linewidth=4, alpha=0.6, label="reference")
    left.plot(run.measured[:, 1, 0], run.measured[:, 0, 0], ".", color=GREEN, markersize=1.5, label="measured")
    left.plot(run.x[:, 1, 0], run.x[:, 0, 0], color=ORANGE, linewidth=1.4, label="true")
    for place, text in ((run.x[0, :2, 0], "start"), (run.reference[0, :2], "start of the reference")):
        left.plot(place[1], place[0], "o", color=SOFT, markersize=4)
        left.annotate(text, place[::-1], xytext=(6, 5), textcoords="offset points", fontsize=9, color=SOFT)
    left.set_aspect("equal", adjustable="datalim")
    left.set_xlabel("east [m]")
    left.set_ylabel("north [m]")
    left.legend(frameon=False, fontsize=9, loc="center")
    for name, ink in {BARE: SOFT, **INKS}.items():
        away = np.hypot(*(runs[name].x[:, :2, 0] - runs[name].reference[:, :2]).T)
        right.semilogy(run.time, away, color=ink, linewidth=1.2, label=name)
    right.axvline(VARIES, color=TRUE, linestyle="--", linewidth=1)
    right.set_xlabel("time [s]")
    right.set_ylabel("from the reference [m]")
    right.legend(frameon=False, fontsize=9)
    clean(left)
    clean(right)
    return figure


def velocities(run: Run) -> Figure:
    """Figures 3 to 5."""
    figure = Figure(figsize=(12.4, 6.6), layout="constrained")
    for axes, (row, label) in zip(figure.subplots(3, 1, sharex=True), LETTERS.items(), strict=True):
        scale = 180 / np.pi if row == YAW_RATE else 1.0
        axes.plot(run.time, scale * run.measured[:, row, 0], ".", color=GREEN, markersize=1.8, label="measured")
        axes.plot(run.time, scale * run.x[:, row, 0], color=TRUE, linewidth=3.2, label="true")
        axes.plot(run.time, scale * run.believed[:, row, 0], color=ORANGE, linewidth=0.9, label="adaptive UKF")
        axes.plot(run.time, scale * run.reference[:, row], color=BLUE, linestyle="--", linewidth=0.9, label="reference")
        axes.set_ylabel(label)
        axes.margins(x=0.01)
        clean(axes)
    axes.set_xlabel("time [s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4, frameon=False)
    return figure


def efforts(runs: dict[str, Run]) -> Figure:
    """Figures 6 and 7."""
    figure = Figure(figsize=(12.4, 5.2), layout="constrained")
    for row, (axes, label) in enumerate(
        zip(figure.subplots(2, 1, sharex=True), ("surge force [N]", "yaw moment [N m]"), strict=True)
    ):
        for name, ink, width in ((BARE, TRUE, 0.8), (ADAPTIVE, ORANGE, 1.2)):
            axes.plot(runs[name].time, runs[name].tau[:, row, 0], color=ink, linewidth=width, label=name)
        axes.set_ylabel(label)
        axes.margins(x=0.01)
        clean(axes)
    axes.set_xlabel("time [s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def masses(runs: dict[str, Run]) -> Figure:
    """Figure 8, with q below."""
    figure = Figure(figsize=(12.4, 6.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.7, 1))
    run = next(iter(runs.values()))
    upper.plot(run.time, run.true_mass, color=TRUE, linewidth=4, alpha=0.7, label="true")
    for name, ink in INKS.items():
        upper.plot(run.time, runs[name].mass[:, 0], color=ink, linewidth=2.0 if name == BANK else 1.0, label=name)
        lower.semilogy(run.time, runs[name].q[:, 0], color=ink, linewidth=1.4)
    upper.set_ylim(160, 240)
    upper.set_ylabel("m11 [kg]")
    lower.set_ylabel("q of a step [kg²]")
    lower.set_xlabel("time [s]")
    upper.margins(x=0.01)
    clean(upper)
    clean(lower)
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper right", ncols=5, frameon=False)
    return figure


def write(out: Path, tables: Sequence[Table], runs: dict[str, Run], reasons: str) -> Iterator[Path]:
    """All figures as PNG and the page; yields the files."""
    figures = {"2": tracking(runs), "3": velocities(runs[ADAPTIVE]), "6": efforts(runs), "8": masses(runs)}
    out.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        file = out / f"paper_003_{name}.png"
        with atomic(file) as temporary:
            figure.savefig(temporary, dpi=120, format="png")
        yield file
    sections = [(TITLES[name], WORDS[name], svg(figure)) for name, figure in figures.items()]
    summary = (
        "An unmanned trimaran without sway actuator tracks a circle while its surge mass varies; the paper's figures in our form,"
        " one seed each."
    )
    write_case(
        out / "paper_003.html", "Paper 003: tracking with an adaptive filter", summary, sections, tables, reasons
    )
    yield out / "paper_003.html"
