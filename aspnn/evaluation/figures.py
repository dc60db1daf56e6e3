"""The picture of the README: a new order, the true hull and the predicted ones, to scale. matplotlib is imported inside."""

from pathlib import Path as FilePath

import numpy as np

from aspnn import records
from aspnn.evaluation.examples import INK, MAIN, Example
from aspnn.evaluation.reference import TRUTH
from aspnn.frames import to_body, to_north_east
from aspnn.motion import Path
from aspnn.vessel import Vessel

TRUE, ARC = "#8c959f", "#e36209"


def tracks_figure(case: Example, vessel: Vessel, file: str | FilePath, kinematic: str | None = None) -> None:
    """Draw one example as PNG or SVG (by the ending of `file`): truth grey, main predictor blue, kinematic arc orange.

    `kinematic` names the baseline to draw; by default the best one of the example's group.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    baseline = kinematic or case.baseline
    drawn = [("true path" if case.reference_name == TRUTH else "smoothed path", case.reference, TRUE, True, None)]
    if baseline is not None:
        drawn.append((f"kinematic ({baseline})", case.paths[baseline], ARC, False, case.errors[baseline][-1]))
    drawn.append((case.main, case.paths[case.main], MAIN, False, case.errors[case.main][-1]))
    places = np.concatenate([np.stack([path.east, path.north]) for _, path, *_ in drawn], axis=1)
    width, height = np.ptp(places, axis=1) + vessel.length
    figure = Figure(figsize=(8.4, float(np.clip(7.6 * height / width, 3.6, 6.2)) + 0.9), dpi=160, layout="constrained")
    axes = figure.add_subplot()
    for name, path, colour, filled, error in drawn:
        _hulls(axes, path.at(case.hulls), vessel, colour, filled)
        label = name if error is None else f"{name}: {_metres(error)} off after {case.reference.time[-1]:.0f} s"
        axes.plot(path.east, path.north, color=colour, linewidth=1.4, label=label)
    main = case.paths[case.main].at(case.hulls[1:])
    labels = _beside(case, vessel, baseline)
    sides = np.where(labels[1] < case.reference.at(case.hulls[1:]).east, "right", "left")
    for time, pivot, region, north, east, side in zip(
        case.hulls[1:], main.pivot, main.pivot_region(vessel.length), *labels, sides, strict=True
    ):
        where = "pivot undefined" if np.isnan(pivot) else f"pivot {pivot:+.0f} m, region {region:+.0f}"
        axes.annotate(f"{time:.0f} s\n{where}", (east, north), color="#57606a", fontsize=7.5, ha=side, va="center")
    near = np.where(np.abs(main.pivot) < vessel.length, main.pivot, np.nan)
    north, east = to_north_east(near, 0.0, main.heading)
    axes.plot(main.east + east, main.north + north, "x", color=MAIN, markersize=6, label="its pivot point")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east of the start [m]")
    axes.set_ylabel("north of the start [m]")
    axes.set_title(_title(case), loc="left", fontsize=11, color=INK)
    axes.grid(color="#e8ebef", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="best")
    with records.atomic(file) as temporary:
        canvas = FigureCanvasSVG(figure) if temporary.suffix == ".svg" else FigureCanvasAgg(figure)
        canvas.print_figure(temporary)


def _hulls(axes, path: Path, vessel: Vessel, colour: str, filled: bool) -> None:
    for outline in path.outline(vessel.outline()):
        axes.fill(
            outline[:, 1],
            outline[:, 0],
            facecolor=colour if filled else "none",
            alpha=0.55 if filled else 1.0,
            edgecolor=colour,
            linewidth=1.1,
        )


def _beside(case: Example, vessel: Vessel, baseline: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Places of the labels (north, east): clear of the true hulls, on the side that the kinematic path does not take."""
    at, end = case.reference.at(case.hulls[1:]), case.reference
    other = case.paths[baseline] if baseline is not None else end
    _, cross = to_body(other.north[-1] - end.north[-1], other.east[-1] - end.east[-1], end.heading[-1])
    north, east = to_north_east(0.0, (-1 if cross > 0 else 1) * (0.5 * vessel.beam + 0.2 * vessel.length), at.heading)
    return at.north + north, at.east + east


def _metres(error: float) -> str:
    return f"{error:.0f} m" if error >= 10 else f"{error:.1f} m"


def _title(case: Example) -> str:
    order = np.degrees(case.plan.rudder.values[0])
    side = "starboard" if order > 0 else "port"
    words = f"Rudder {abs(order):.0f}° to {side}" if abs(order) >= 0.5 else "Rudder amidships"
    return f"{words}: hull outlines to scale, every {case.hulls[1]:.0f} s"
