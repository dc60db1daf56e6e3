"""The page of paper_6.py: figures 9 to 15 of Paper VI in our form, in one file without scripts."""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from paper_6_tables import Table
from pivot_figures import SOFT, TRUE, chart, strip

from aspnn.estimation.consistency import average_bounds
from aspnn.evaluation.page import versions
from aspnn.motion import Path as Track
from aspnn.motion.pivot import Motion, PivotPoint, exact
from aspnn.records import atomic
from aspnn.vessel import Vessel

BLUE, ORANGE, GREEN, RED = "#1f6feb", "#e36209", "#2a9d4a", "#d1242f"
INKS = {
    "VI printed": RED,
    "VI exact": ORANGE,
    "caa_ctra": "#a371f7",
    "exact": BLUE,
    "true current": GREEN,
}
FILTERS = {"as printed": ORANGE, "ours, error-state": BLUE}
EVERY, HULLS = 4, 6  # epochs from point to point of a pivot figure; points from hull to hull (3 s, as the paper)
SLOW = 0.007  # rad/s: three times this and more are drawn as turning
ICON = 15  # epochs from icon to icon of a prediction, 2 s
NAMES = {"PT": "Port turn", "SBT": "Starboard turn"}
WORDS = {
    "motion": "Surge, sway and heading rate of one voyage: true, and by both filters.",
    "nis": "NIS of one voyage on a logarithmic axis. Band: the right bounds; dashed lines: those of the paper.",
    "pivot": "The pivot point over ground of one voyage, by -v / r of the error-state filter and by the process on the paper's filter, "
    "infinity left out. Hulls and dots are true.",
    "paths": "Predictions of 10 s of the same voyage from the paper's instants: true hulls filled, every 2 s; the last predicted hull "
    "outlined.",
}


def clean(axes: Axes) -> None:
    """No frame but the two axes, a soft grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e8ebef", linewidth=0.8)
    axes.set_axisbelow(True)


def motion_figure(turn: str, voyage) -> Figure:
    """Figures 9 and 10: the states over time."""
    figure = Figure(figsize=(12.4, 3.1), layout="constrained")
    states = voyage.error_state
    told = ((voyage.truth.surge, "surge_m_s", 4), (voyage.truth.sway, "sway_m_s", 5))
    told += ((np.degrees(voyage.truth.yaw_rate), "yaw_rate_rad_s", 6),)
    for axes, (true, name, field), title in zip(
        figure.subplots(1, 3), told, ("surge m/s", "sway m/s", "heading rate deg/s"), strict=True
    ):
        scale = 180 / np.pi if field == 6 else 1.0
        axes.plot(voyage.time, true, color=TRUE, linewidth=3.0, label="true")
        axes.plot(
            voyage.time, scale * voyage.paper[field], color=FILTERS["as printed"], linewidth=0.9, label="as printed"
        )
        axes.plot(voyage.time, scale * states[name], color=FILTERS["ours, error-state"], linewidth=0.9, label="ours")
        axes.set_title(title, loc="left", fontsize=10)
        axes.set_ylim(*padded(true))
        axes.set_xlabel("time [s]")
        clean(axes)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=3, frameon=False)
    return figure


def padded(values: np.ndarray) -> tuple[float, float]:
    """Limits of an axis: a quarter of the range beyond the values."""
    low, high = float(values.min()), float(values.max())
    return low - 0.25 * (high - low), high + 0.25 * (high - low)


def nis_figure(found: dict[str, dict[str, np.ndarray]], time: np.ndarray, bounds: tuple[float, float]) -> Figure:
    """Figures 11 and 12: NIS over time of both models."""
    figure = Figure(figsize=(12.4, 3.2), layout="constrained")
    for axes, (model, dof) in zip(figure.subplots(1, 2, sharey=True), (("CAA", 2.0), ("3D-PV", 3.0)), strict=True):
        low, high = average_bounds(dof)
        axes.axhspan(float(low), float(high), color=TRUE, alpha=0.2, linewidth=0)
        for bound in bounds:
            axes.axhline(bound, color=SOFT, linewidth=1, linestyle="--")
        for name, ink in FILTERS.items():
            axes.plot(time, found[name][model], ".", color=ink, markersize=4, alpha=0.8, label=name)
        axes.set_yscale("log")
        axes.set_ylim(1e-3, 1e2)
        axes.set_xlabel("time [s]")
        axes.set_title(f"{model}, {dof:g} degrees of freedom", loc="left", fontsize=10)
        clean(axes)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    return figure


def pivot_figure(track: Track, ways: dict[str, PivotPoint], vessel: Vessel, hulls: int, of: str) -> Figure:
    """Figure 13, beside the track of figures 9 and 10: the first way on the hulls, every so many steps, up to two over time.

    `of` tells what the track is: true or smoothed.
    """
    figure = Figure(figsize=(12.4, 5.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
    chart(left, track, next(iter(ways.values())), vessel, hulls)
    strip(right, track, ways, vessel, hulls)
    right.tick_params(labelbottom=True)
    right.set_xlabel("time [s]")
    lines, labels = right.get_legend_handles_labels()
    labels = [of if label == "true" else label for label in labels]
    figure.legend(lines, labels, loc="outside lower right", ncols=6, frameon=False, fontsize=9)
    for axes in (left, right):
        clean(axes)
    return figure


def paths_figure(turn: str, starts: Sequence, vessel: Vessel, voyage: int = 0) -> Figure:
    """Figures 14 and 15: predictions of one voyage from the paper's instants."""
    figure = Figure(figsize=(12.4, 4.0), layout="constrained")
    hull = vessel.outline()
    for axes, run in zip(figure.subplots(1, len(starts)), starts, strict=True):
        true = run.true[voyage]
        origin = np.array([true.north[0], true.east[0]])
        for outline in true.outline(hull)[::ICON] - origin:
            axes.fill(outline[:, 1], outline[:, 0], color=TRUE, alpha=0.45, linewidth=0)
        for name, ink in INKS.items():
            path = run.paths[name][voyage]
            axes.plot(path.east - origin[1], path.north - origin[0], color=ink, linewidth=1.4, label=name)
            last = path.outline(hull)[-1] - origin
            axes.fill(last[:, 1], last[:, 0], facecolor="none", edgecolor=ink, linewidth=1.2)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(f"{turn}, from {run.start:g} s", loc="left", fontsize=10)
        axes.set_xlabel("east [m]")
        axes.margins(0.08)
        clean(axes)
    axes.figure.axes[0].set_ylabel("north [m]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=len(INKS), frameon=False)
    return figure


def svg(figure: Figure) -> str:
    """A figure as SVG, the same for the same data."""
    with rc_context({"svg.fonttype": "none", "font.family": "sans-serif", "font.size": 10, "svg.hashsalt": "aspnn"}):
        text = io.StringIO()
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    return text.getvalue().split("?>", 1)[1].split('.dtd">', 1)[1]


def thinned(voyage) -> tuple[Track, np.ndarray]:
    """Every few epochs of the true track, and which."""
    rows, t = np.arange(0, len(voyage.time), EVERY), voyage.truth
    fields = (t.north, t.east, t.heading, t.surge, t.sway, t.yaw_rate)
    place = exact(Motion(t.sway[rows], t.yaw_rate[rows], 0.0, SLOW)).place
    return Track(voyage.time[rows], *(values[rows] for values in fields), place), rows


def sections(shown: dict, runs: dict, vessel: Vessel, bounds) -> Iterator[tuple[str, str, str]]:
    """Title, words and figure of each part; `shown` has voyage, NIS and pivot points by turn."""
    for turn, (voyage, nis, track, ways) in shown.items():
        yield NAMES[turn], WORDS["motion"], svg(motion_figure(turn, voyage))
        yield "", WORDS["nis"], svg(nis_figure(nis, voyage.time, bounds))
        yield "", WORDS["pivot"], svg(pivot_figure(track, ways, vessel, HULLS, "true"))
        yield "", WORDS["paths"], svg(paths_figure(turn, runs[turn], vessel))


def write_page(
    file: Path, tables: Sequence[Table], shown: dict, runs: dict, vessel: Vessel, bounds, reasons: str
) -> None:
    """The page, whole or not at all."""
    from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PackageLoader

    places = [FileSystemLoader(Path(__file__).parent), PackageLoader("aspnn.evaluation", "")]
    environment = Environment(loader=ChoiceLoader(places), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page = environment.get_template("paper_6.html.jinja").render(
        tables=tables,
        sections=list(sections(shown, runs, vessel, bounds)),
        reasons=[" ".join(reason.split()) for reason in reasons.split("\n- ")[1:]],
        metadata=versions(),
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary:
        temporary.write_text(page)
