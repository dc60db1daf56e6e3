"""What the figures of all trials share: sides' colours, axes, time series, tracks to scale, and dimension lines."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from aspnn.evaluation.examples import INK
from aspnn.frames import to_north_east
from aspnn.simulation.trials.manoeuvres import Run, Trial
from aspnn.simulation.voyage import Voyage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"starboard": "#1a7f37", "port": "#cf222e", "": "#0969da"}  # the sides' own colours; dashed lines are port
DASHES = {"starboard": "-", "port": (0, (5, 2)), "": "-"}
SOFT, GRID, RULE = "#57606a", "#e8ebef", "#8c959f"


def dress(axes: "Axes", x: str, y: str) -> None:
    axes.set_xlabel(x, fontsize=8, color=SOFT)
    axes.set_ylabel(y, fontsize=8, color=SOFT)
    axes.tick_params(labelsize=8, colors=SOFT)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def series(
    axes: "Axes", trial: Trial, end: float, y: str, of: Callable[[Voyage], np.ndarray], zero: float = 0.0
) -> None:
    """A quantity of every run against the time since `zero` [s], up to `end` [s]."""
    for run in trial.runs:
        shown = run.voyage.time <= end
        axes.plot(
            run.voyage.time[shown] - zero,
            of(run.voyage)[shown],
            color=COLOURS[run.side],
            linestyle=DASHES[run.side],
            linewidth=1.3,
            label=run.side,
        )
    axes.set_xlim(0, end - zero)
    axes.axhline(0, color=RULE, linewidth=0.6)
    dress(axes, "", y)


def track(axes: "Axes", trial: Trial, run: Run, end: float, times: np.ndarray) -> None:
    """The track of midship [L] up to `end` [s], with hull outlines to scale at `times` [s]."""
    v, length = run.voyage, trial.setting.length
    shown = v.time <= end
    axes.plot(v.east[shown] / length, v.north[shown] / length, color=COLOURS[run.side], linewidth=1.4, label=run.side)
    outline = trial.setting.ship.vessel.outline()
    for time in times[np.isfinite(times)]:
        north, east, psi = (np.interp(time, v.time, values) for values in (v.north, v.east, v.heading))
        ahead, abeam = to_north_east(outline[:, 0], outline[:, 1], psi)
        axes.fill(
            (east + abeam) / length,
            (north + ahead) / length,
            facecolor="white",
            edgecolor=COLOURS[run.side],
            linewidth=0.8,
            alpha=0.85,
        )
    axes.set_aspect("equal", adjustable="datalim")


def north_up(axes: "Axes") -> None:
    dress(axes, "abeam of the initial course, to starboard [L]", "along the initial course [L]")


def measure(axes: "Axes", start: tuple[float, float], end: tuple[float, float], text: str) -> None:
    """A dimension line between two places, with its text beside it."""
    axes.annotate(
        "", start, end, arrowprops={"arrowstyle": "<->", "color": SOFT, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
    )
    upright = start[0] == end[0]
    axes.annotate(
        text,
        ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2),
        fontsize=7.5,
        color=INK,
        rotation=90 if upright else 0,
        ha="center",
        va="center",
        bbox={"boxstyle": "square,pad=0.15", "facecolor": "white", "edgecolor": "none"},
    )


def line(axes: "Axes", x: tuple[float, float], y: tuple[float, float]) -> None:
    axes.plot(x, y, color=RULE, linewidth=0.6, linestyle=":")
