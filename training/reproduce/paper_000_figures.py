"""The figures and the page of paper_000.py: figures 5 to 8 of the paper in our form, and what the low-pass does."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from case_page import write_case
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from paper_000_case import CIRCLE, LOW_PASS, ROUTE, Sailed, across, true_course
from paper_6_figures import BLUE, GREEN, ORANGE, RED, clean, svg
from paper_6_tables import Table
from pivot_figures import INK, SOFT, TRUE

from aspnn.records import atomic

EXACT, STATED, PRINTED, BEST = (
    "true positions",
    "GNSS 4.7 m, paper's filter",
    "GNSS as printed, paper's filter",
    "GNSS 4.7 m, our filter, low-pass and circle",
)
INKS = {EXACT: INK, STATED: BLUE, PRINTED: RED, BEST: GREEN}
EVERY = 1.0  # s between points that are drawn
WORDS = {
    "5": "Figure 5: tracks of the first seed to the end of the route, and the second turn enlarged. Dots: fixes of 4.7 m, every 20 s.",
    "6": "Figure 6: course, true, as the filter has it, and the filtered reference; below, the filter's error. First seed.",
    "7": "Figure 7: speed over ground, true and as the filter has it. It drops in the turns.",
    "8": "Figure 8: rudder angle and its rate, of which the largest of each second; dashed: the limits of the machine, 40 deg and 5 deg/s.",
    "lp": "Cross-track errors on true positions, by the low-pass of the reference. 100 and 200 s are what the paper asks for, 40 s what it "
    "could have used without saturation.",
}


class Shown(NamedTuple):
    """What is drawn of a voyage, to the end of its route, at every second (n,); angles in deg."""

    time: np.ndarray
    north: np.ndarray
    east: np.ndarray
    fixes: np.ndarray
    cross: np.ndarray
    course: np.ndarray
    told_course: np.ndarray
    reference: np.ndarray
    speed: np.ndarray
    told_speed: np.ndarray
    rudder: np.ndarray
    rate: np.ndarray


def shown(sailed: Sailed) -> Shown:
    """What is drawn of a voyage; of the rudder's rate the largest of each second."""
    v, t = sailed.voyage, sailed.thought
    dt = float(v.time[1] - v.time[0])
    every = max(1, round(EVERY / dt))
    end = int(np.argmax(t.done)) if t.done[-1] else len(v.time) - 1
    pick = slice(0, end, every)
    course = true_course(v)
    told, reference = (course + np.angle(np.exp(1j * (x - course))) for x in (t.course, t.reference))
    rate = np.degrees(np.diff(v.rudder) / dt)[: end // every * every].reshape(-1, every)
    rows = np.arange(len(rate))
    largest = rate[rows, np.abs(rate).argmax(axis=1)]
    n = len(largest)
    return Shown(
        v.time[pick][:n],
        v.north[pick][:n],
        v.east[pick][:n],
        (np.stack([v.north, v.east]) + sailed.errors)[:, pick][:, :n],
        across(v.north, v.east, t.leg.astype(int))[pick][:n],
        *(np.degrees(x)[pick][:n] for x in (course, told, reference)),
        np.hypot(v.surge, v.sway)[pick][:n],
        t.speed[pick][:n],
        np.degrees(v.rudder)[pick][:n],
        largest,
    )


def track_figure(kept: dict[str, list[Shown]]) -> Figure:
    """Figure 5: the tracks, and a turn enlarged."""
    figure = Figure(figsize=(12.4, 6.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1))
    for axes in (left, right):
        axes.plot(*ROUTE.points.T[::-1], color=TRUE, linewidth=4, alpha=0.5, label="route")
        axes.plot(*ROUTE.points.T[::-1], "o", color=SOFT, markersize=4)
        for name, ink in INKS.items():
            one = kept[name][0]
            axes.plot(one.east, one.north, color=ink, linewidth=1.3, label=name)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east [m]")
        clean(axes)
    one = kept[STATED][0]
    right.plot(*one.fixes[::-1, ::20], ".", color=BLUE, markersize=3, alpha=0.6)
    north, east = ROUTE.points[2]
    angle = np.linspace(0, 2 * np.pi, 60)
    right.plot(east + CIRCLE * np.sin(angle), north + CIRCLE * np.cos(angle), color=SOFT, linewidth=0.8)
    right.set_xlim(east - 700, east + 1100)
    right.set_ylim(north - 1300, north + 500)
    right.set_aspect("equal", adjustable="box")
    left.set_ylabel("north [m]")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=5, frameon=False, fontsize=9)
    return figure


def course_figure(kept: dict[str, list[Shown]]) -> Figure:
    """Figure 6: the course of two voyages, and the filter's error."""
    figure = Figure(figsize=(12.4, 5.4), layout="constrained")
    upper, lower = figure.subplots(2, 2, sharex=True, height_ratios=(2, 1))
    for top, below, name in zip(upper, lower, (STATED, PRINTED), strict=True):
        one = kept[name][0]
        top.plot(one.time, one.reference, color=ORANGE, linewidth=1.2, label="reference")
        top.plot(one.time, one.course, color=TRUE, linewidth=2.6, label="true")
        top.plot(one.time, one.told_course, color=BLUE, linewidth=0.8, label="filter")
        below.plot(one.time, one.told_course - one.course, color=BLUE, linewidth=0.7)
        top.set_title(name, loc="left", fontsize=10)
        below.set_ylim(-12, 12)
        below.set_xlabel("time [s]")
        clean(top)
        clean(below)
    upper[0].set_ylabel("course [deg]")
    lower[0].set_ylabel("error [deg]")
    figure.legend(*upper[0].get_legend_handles_labels(), loc="outside upper right", ncols=3, frameon=False)
    return figure


def speed_figure(kept: dict[str, list[Shown]]) -> Figure:
    """Figure 7: the speed of the same voyages."""
    figure = Figure(figsize=(12.4, 3.0), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2, sharey=True), (STATED, PRINTED), strict=True):
        one = kept[name][0]
        axes.plot(one.time, one.speed, color=TRUE, linewidth=2.6, label="true")
        axes.plot(one.time, one.told_speed, color=BLUE, linewidth=0.8, label="filter")
        axes.set_ylim(5.5, 8.3)
        axes.set_title(name, loc="left", fontsize=10)
        axes.set_xlabel("time [s]")
        clean(axes)
    figure.axes[0].set_ylabel("speed [m/s]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def rudder_figure(kept: dict[str, list[Shown]]) -> Figure:
    """Figure 8: rudder and rate, without errors and with two."""
    figure = Figure(figsize=(12.4, 4.6), layout="constrained")
    upper, lower = figure.subplots(2, 4, sharex=True, sharey="row")
    for top, below, (name, ink) in zip(upper, lower, INKS.items(), strict=True):
        one = kept[name][0]
        for axes, values, limit in ((top, one.rudder, 40.0), (below, one.rate, 5.0)):
            axes.plot(one.time, values, color=ink, linewidth=0.4)
            _limits(axes, limit)
        top.set_title(name.replace("our filter, low-pass and circle", "all ours"), loc="left", fontsize=9)
        below.set_xlabel("time [s]")
    upper[0].set_ylabel("rudder [deg]")
    lower[0].set_ylabel("its rate [deg/s]")
    return figure


def _limits(axes: Axes, limit: float) -> None:
    for side in (-limit, limit):
        axes.axhline(side, color=SOFT, linewidth=0.8, linestyle="--")
    axes.set_ylim(-1.15 * limit, 1.15 * limit)
    clean(axes)


def low_pass_figure(voyages: Sequence[Shown], constants: Sequence[float]) -> Figure:
    """Cross-track error over time by the low-pass."""
    figure = Figure(figsize=(12.4, 3.4), layout="constrained")
    axes = figure.add_subplot()
    inks = {20.0: GREEN, LOW_PASS: BLUE, 100.0: ORANGE, 200.0: RED}
    for one, constant in zip(voyages, constants, strict=True):
        if constant in inks:
            axes.plot(one.time, one.cross, color=inks[constant], linewidth=1.2, label=f"{constant:g} s")
    axes.axhline(0, color=TRUE, linewidth=1)
    axes.set_ylabel("to starboard of the leg [m]")
    axes.set_xlabel("time [s]")
    axes.margins(x=0.01)
    clean(axes)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4, frameon=False)
    return figure


def figures(kept: dict[str, list[Shown]], constants: Sequence[float]) -> Iterator[tuple[str, str, Figure]]:
    """Heading, key of the words and figure."""
    yield "Tracks", "5", track_figure(kept)
    yield "Course", "6", course_figure(kept)
    yield "Speed", "7", speed_figure(kept)
    yield "Rudder", "8", rudder_figure(kept)
    yield "Low-pass of the reference", "lp", low_pass_figure(kept["low-passes"], constants)


def write(
    folder: Path, tables: Sequence[Table], kept: dict[str, list[Shown]], constants: Sequence[float], reasons: str
) -> None:
    """The figures as PNG and the page, each whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    sections = []
    for heading, key, figure in figures(kept, constants):
        with atomic(folder / f"figure_{key}.png") as temporary:
            figure.savefig(temporary, format="png", dpi=110)
        sections.append((heading, WORDS[key], svg(figure)))
    summary = (
        "The Mariner of the paper along its six waypoints: line-of-sight guidance, low-passed reference, course autopilot by pole placement, "
        "course and speed by the five-state filter from positions alone."
    )
    write_case(folder / "page.html", "Paper 000: waypoints by line of sight", summary, sections, tables, reasons)
