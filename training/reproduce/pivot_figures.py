"""Figures of the pivot point along a manoeuvre: on the hulls of its path, and over time beside the hull's outline."""

from pathlib import Path as FilePath

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aspnn.frames import to_north_east
from aspnn.motion import Path
from aspnn.motion.pivot import PivotPoint
from aspnn.records import atomic
from aspnn.vessel import Vessel

TRUE, INK, SOFT, GRID = "#8c959f", "#24292f", "#57606a", "#e8ebef"
BLUE, ORANGE = "#1f6feb", "#e36209"
REACH = 1.5  # lengths forward and aft of midship that are drawn


def spans(found: PivotPoint, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place, low and high end within what is drawn; NaN where undefined, or the place lies outside."""
    limit = REACH * length
    near = np.abs(found.place) <= limit
    place, low, high = (np.where(near, values, np.nan) for values in (found.place, found.low, found.high))
    return place, np.clip(low, -limit, limit), np.clip(high, -limit, limit)


def broken(values: np.ndarray, jumps: np.ndarray) -> np.ndarray:
    """The values with a gap before each of `jumps`, where the pivot point went round through infinity."""
    return np.insert(values, jumps, np.nan)


def chart(axes: Axes, path: Path, found: PivotPoint, vessel: Vessel, every: int) -> None:
    """The path with a hull every so many steps, to scale, on each its pivot point and interval along the centreline."""
    origin = path.north[0], path.east[0]
    axes.plot(path.east - origin[1], path.north - origin[0], color=TRUE, linewidth=0.9, zorder=1)
    place, low, high = spans(found, vessel.length)
    for k in range(0, len(path.time), every):
        hull = path.outline(vessel.outline())[k] - origin
        undefined = np.isnan(found.place[k])
        axes.fill(
            hull[:, 1], hull[:, 0], facecolor="#ffffff" if undefined else "#eef1f4", edgecolor=TRUE, linewidth=0.9, zorder=2,
            linestyle=":" if undefined else "-",
        )  # fmt: skip

        def at(x, k=k):
            north, east = to_north_east(x, 0.0, path.heading[k])
            return path.east[k] + east - origin[1], path.north[k] + north - origin[0]

        ends = np.array([at(low[k]), at(high[k])])
        axes.plot(*at(np.array([0.0, np.nan_to_num(place[k])])), color=SOFT, linewidth=0.5, zorder=2)
        axes.plot(ends[:, 0], ends[:, 1], color=BLUE, linewidth=4.5, alpha=0.45, solid_capstyle="butt", zorder=3)
        axes.plot(*at(place[k]), "o", color=INK, markersize=2, zorder=4)
        beside = to_north_east(0.0, 0.62 * vessel.length, path.heading[k])
        axes.annotate(
            f"{path.time[k]:.0f} s", (path.east[k] - origin[1] + beside[1], path.north[k] - origin[0] + beside[0]),
            color=SOFT, fontsize=7, ha="center", va="center",
        )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.set(xlabel="east of the start [m]", ylabel="north of the start [m]")
    axes.set_title("Pivot point on the hull, with its 95 % interval; dotted hulls: undefined", loc="left", fontsize=10)


def strip(axes: Axes, path: Path, ways: dict[str, PivotPoint], vessel: Vessel, every: int) -> None:
    """Pivot point over time, by each way, over outlines of the hull whose forward axis is that of the chart; gaps where undefined."""
    limit = REACH * vessel.length
    outline, half = vessel.outline(), (path.time[1] - path.time[0]) / 2
    wide = 0.3 * every * 2 * half / vessel.beam
    for k in range(0, len(path.time), every):
        axes.fill(
            path.time[k] + wide * outline[:, 1], outline[:, 0], facecolor="#eef1f4", edgecolor=GRID, linewidth=0.8
        )
    axes.axhline(0, color=GRID, linewidth=0.8, zorder=0)
    for (name, found), ink in zip(ways.items(), (BLUE, ORANGE), strict=False):
        place, low, high = spans(found, vessel.length)
        jumps = np.flatnonzero(np.abs(np.diff(place)) > 0.75 * vessel.length) + 1
        time, place = broken(path.time, jumps), broken(place, jumps)
        axes.bar(path.time, high - low, 2 * half, low, color=ink, alpha=0.25, linewidth=0, label=f"{name}, 95 %")
        axes.plot(time, place, color=ink, linewidth=1.3, marker=".", markersize=3, label=name)
    axes.plot(path.time, path.pivot, ".", color=INK, markersize=3, label="true")
    for time in path.time[np.isnan(next(iter(ways.values())).place)]:
        axes.axvspan(time - half, time + half, color=TRUE, alpha=0.45, linewidth=0)
    axes.fill_between([], [], color=TRUE, alpha=0.45, linewidth=0, label="undefined")
    axes.set_ylim(-limit, limit)
    axes.margins(x=0.01)
    axes.set(ylabel="forward of midship [m]")
    axes.set_title(f"Over time, within {REACH:g} lengths of midship, beside the hull", loc="left", fontsize=10)
    axes.tick_params(labelbottom=False)


def along_figure(path: Path, ways: dict[str, PivotPoint], vessel: Vessel, file: FilePath, every: int) -> None:
    """The pivot point along a true `path`: the first two of `ways` over time, the first one on the hulls, every so many steps.

    Hulls, the path and the dots are true, the ways are given a motion with errors. PNG.
    """
    figure = Figure(figsize=(14.5, 7), dpi=120, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.1), height_ratios=(1, 0.3))
    top, bottom = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[1, 1])
    middle = figure.add_subplot(grid[0, 1], sharex=bottom)
    chart(top, path, next(iter(ways.values())), vessel, every)
    strip(middle, path, ways, vessel, every)
    figure.legend(*middle.get_legend_handles_labels(), loc="outside lower right", ncols=6, frameon=False, fontsize=9)
    bottom.plot(path.time, np.degrees(path.yaw_rate), color=INK, linewidth=1.2)
    bottom.axhline(0, color=TRUE, linewidth=0.8)
    bottom.set(xlabel="time [s]", ylabel="yaw rate [deg/s]")
    for axes in (top, middle, bottom):
        axes.spines[["top", "right"]].set_visible(False)
    for axes in (top, bottom):
        axes.grid(color=GRID, linewidth=0.8)
        axes.set_axisbelow(True)
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary:
        figure.savefig(temporary)
