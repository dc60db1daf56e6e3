"""The page of the ablations: one figure and one table, in the form of the reports, in one file without scripts."""

import io
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from study import GROUPS, cells

from aspnn.evaluation.evaluate import TITLES
from aspnn.evaluation.page import versions

INKS, MARKS = ("#1f6feb", "#f0883e", "#2a9d4a"), ("o", "s", "D")
INK, SOFT = "#24292f", "#57606a"


def dots(found: Sequence[Any]) -> str:
    """The ratio of each row's median error to the flagship's, by group, as SVG: a mark, and a line from seed to seed."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure
    from matplotlib.ticker import FixedLocator, NullFormatter

    flagship, rows = found[0], found[1:]
    figure = Figure(figsize=(11.4, 1.1 + 0.44 * len(rows)), layout="constrained")
    axes = figure.add_subplot()
    low, high = min(r[1] for r in flagship.ratios), max(r[2] for r in flagship.ratios)
    axes.axvspan(low, high, color="#8c959f", alpha=0.22, linewidth=0, label="seeds of the flagship")
    axes.axvline(1.0, color="#8c959f", linewidth=1)
    for k, (group, ink, mark) in enumerate(zip(GROUPS, INKS, MARKS, strict=True)):
        places = np.arange(len(rows)) + 0.24 * (k - 1)
        ratios = np.array([row.ratios[k] for row in rows]).reshape(-1, 3)
        axes.hlines(places, ratios[:, 1], ratios[:, 2], color=ink, linewidth=2, alpha=0.55)
        axes.plot(ratios[:, 0], places, mark, color=ink, markersize=6, label=TITLES[group])
    axes.set_xscale("log")
    reach = max([2.0, *(r[2] for row in rows for r in row.ratios)])
    least = min([0.8, *(r[1] for row in found for r in row.ratios)])
    axes.set_xlim(least / 1.05, reach * 1.1)
    ticks = [t for t in (0.5, 0.6, 0.8, 1, 1.25, 1.5, 2, 3, 5, 10, 20, 50, 100) if least / 1.05 <= t <= reach * 1.1]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set_yticks(range(len(rows)), [row.what for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel("median position error at the horizon, over the flagship's", color=SOFT)
    axes.tick_params(colors=INK, length=0)
    axes.grid(axis="x", color="#e8ebef")
    for k in range(1, len(rows)):
        axes.axhline(k - 0.5, color="#eef1f4", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    figure.legend(loc="outside upper left", ncols=4, frameon=False)
    with rc_context({"svg.fonttype": "none", "font.family": "sans-serif", "font.size": 11, "svg.hashsalt": "aspnn"}):
        text = io.StringIO()
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    return text.getvalue().split("?>", 1)[1].split('.dtd">', 1)[1]


def render(found: Sequence[Any], oracle: dict[str, Any], voyages: int, share: Callable[..., str]) -> str:
    """The page as HTML text."""
    from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PackageLoader

    places = [FileSystemLoader(__file__.rsplit("/", 1)[0]), PackageLoader("aspnn.evaluation", "")]
    environment = Environment(loader=ChoiceLoader(places), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    limit = [text for group in GROUPS for text in cells([oracle["scores"][group]])]
    table = [(row.name, [row.what, *row.cells, *(share(r, row.seeds) for r in row.ratios), row.seeds]) for row in found]
    return environment.get_template("ablations.html.jinja").render(
        figure=dots(found) if len(found) > 1 else "",
        titles=[TITLES[group] for group in GROUPS],
        table=table,
        oracle=["the oracle: the true simulator from the filtered state", *limit],
        counts=oracle["counts"],
        voyages=voyages,
        metadata=versions(),
    )
