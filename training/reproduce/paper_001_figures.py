"""The figures of paper_001.py: figures 4 to 6 of paper 001 in our form, as PNG and in one page without scripts."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from paper_6_figures import BLUE, GREEN, ORANGE, clean, svg
from paper_6_tables import Table
from pivot_figures import TRUE

from aspnn.evaluation.page import versions
from aspnn.records import atomic

PRINTED, OURS = "as printed, north-east, Q 5e5, R 1e-8 m2", "ours, north-east"
ZOOM = (2.0, 4.0)  # s, in which the fixes show
WORDS = {
    4: "North and east positions under the autopilot: the craft steered by true positions, by the filter as printed and by ours, on "
    "fixes without noise as in the paper, and by ours on fixes with 2 cm of noise.",
    5: "Propeller speeds under the autopilot, fixes without noise: neither reverses or comes to its limit (104 rad/s).",
    6: "Estimates in the loop against the truth, fixes without noise; right the same for two seconds of the turn, where the steps at 5 Hz are the "
    "fixes.",
}


def track_figure(runs: dict) -> Figure:
    """Figure 4."""
    figure = Figure(figsize=(11, 2.9), layout="constrained")
    axes = figure.subplots()
    for name, (run, ink, style) in runs.items():
        axes.plot(run.voyage.north, run.voyage.east, color=ink, ls=style, lw=3 if ink == TRUE else 1.5, label=name)
    axes.set(xlabel="north [m]", ylabel="east [m]", aspect="equal")
    axes.invert_yaxis()  # seen from above, north to the right, starboard down
    axes.legend(frameon=False, loc="upper right")
    clean(axes)
    return figure


def propeller_figure(runs: dict) -> Figure:
    """Figure 5."""
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    for axes, (name, run) in zip(figure.subplots(1, len(runs), sharey=True), runs.items(), strict=True):
        for values, ink, label in ((run.port, BLUE, "n1, port"), (run.starboard, ORANGE, "n2, starboard")):
            axes.plot(run.voyage.time, values, color=ink, lw=1.3, label=label)
        axes.set_title(name, loc="left", fontsize=10)
        axes.set_xlabel("time [s]")
        clean(axes)
    figure.axes[0].set_ylabel("propeller speed [rad/s]")
    figure.axes[0].legend(frameon=False, loc="lower right")
    return figure


def estimates_figure(runs: dict) -> Figure:
    """Figure 6: estimates, beside each the truth of the craft that it steers (grey); right a zoom."""
    figure = Figure(figsize=(11, 8), layout="constrained")
    rows = ((2, 1.0, "SOG [m/s]"), (3, 180 / np.pi, "COG [deg]"), (4, 180 / np.pi, "course rate [deg/s]"))
    limits = {2: (1.0, 1.32), 3: (-3, 24), 4: (-7, 7)}
    for panels, (column, scale, what) in zip(figure.subplots(3, 2), rows, strict=True):
        for axes, zoomed in zip(panels, (False, True), strict=True):
            for name, (run, ink, style) in runs.items():
                time = run.voyage.time
                shown = (time >= ZOOM[0]) & (time <= ZOOM[1]) if zoomed else time >= 0.5
                label = "truth" if name == PRINTED else None
                axes.plot(time[shown], scale * run.truth[shown, column], color=TRUE, lw=2.6, label=label)
                values = scale * (np.unwrap(run.told[shown, column]) if column == 3 else run.told[shown, column])
                axes.plot(time[shown], values, color=ink, ls=style, lw=1.1, label=name)
            axes.set_ylabel(what)
            if not zoomed:
                axes.set_ylim(*limits[column])
            clean(axes)
    for axes in figure.axes[-2:]:
        axes.set_xlabel("time [s]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    return figure


def figures(runs: dict, noisy: dict) -> dict[int, Figure]:
    """The figures by the paper's numbers; `runs` without noise by navigation, `noisy` the same with some."""
    tracks = {
        "true positions": (runs["true positions"], TRUE, "-"),
        PRINTED: (runs[PRINTED], ORANGE, "-"),
        OURS: (runs[OURS], BLUE, "--"),
        "ours, 2 cm of noise": (noisy[OURS], GREEN, "-"),
    }
    told = {
        PRINTED: (runs[PRINTED], ORANGE, "-"),
        OURS: (runs[OURS], BLUE, "-"),
    }
    return {
        4: track_figure(tracks),
        5: propeller_figure({PRINTED: runs[PRINTED], OURS: runs[OURS]}),
        6: estimates_figure(told),
    }


def write(folder: Path, runs: dict, by_noise: dict, tables: Sequence[Table], reasons: str) -> Iterator[Path]:
    """Write the figures and the page `paper_001.html` into `folder`; yields the files."""
    from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PackageLoader

    drawn = figures(runs, by_noise["0.02"])
    folder.mkdir(parents=True, exist_ok=True)
    for number, figure in drawn.items():
        FigureCanvasAgg(figure)
        path = folder / f"paper_001_fig_{number}.png"
        with atomic(path) as temporary:
            figure.savefig(temporary, format="png", dpi=110)
        yield path
    places = [FileSystemLoader(Path(__file__).parent), PackageLoader("aspnn.evaluation", "")]
    environment = Environment(loader=ChoiceLoader(places), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page = environment.get_template("paper_001.html.jinja").render(
        tables=tables,
        sections=[(f"Figure {number}", WORDS[number], svg(figure)) for number, figure in drawn.items()],
        reasons=[" ".join(reason.split()) for reason in reasons.split("\n- ")[1:]],
        metadata=versions(),
    )
    path = folder / "paper_001.html"
    with atomic(path) as temporary:
        temporary.write_text(page)
    yield path
