"""The figure of a trial: one landscape page as PNG, SVG or PDF, tracks to scale. matplotlib is imported inside."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from aspnn import records
from aspnn.evaluation.examples import INK
from aspnn.evaluation.trial_panels import COLOURS, DASHES, RULE, SOFT, dress, line, measure, north_up, series, track
from aspnn.evaluation.trial_report import closing, heading, limit, rows
from aspnn.schema import InputError
from aspnn.simulation.trials.indices import Return, Spiral, Stop, TurningCircle, Zigzag, reached
from aspnn.simulation.trials.manoeuvres import Run, Trial

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

PAGE = (11.69, 8.27)  # inches, A4 landscape
SUFFIXES = (".png", ".svg", ".pdf")


def check_suffix(file: str | Path) -> None:
    """Raises InputError unless the figure's file ends as one of SUFFIXES."""
    if Path(file).suffix not in SUFFIXES:
        raise InputError(f"{file}: a figure ends in {', '.join(SUFFIXES)}")


def trial_figure(trial: Trial, file: str | Path) -> None:
    """Draw the trial as PNG, SVG or PDF, by the ending of `file`, whole or not at all. Raises InputError for another ending."""
    check_suffix(file)
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE, dpi=160, layout="constrained")
    lines = 2 + len(trial.notes) + len(rows(trial)[1])
    share = 0.0205 * lines / (1 - 0.0205 * lines)
    (top,), (body,), (bottom,) = figure.subfigures(3, 1, squeeze=False, height_ratios=[0.1, 1.0, 1.1 * share])
    title, conditions = heading(trial)
    top.text(0.02, 0.6, title, fontsize=15, color=INK, weight="bold", va="center")
    top.text(0.02, 0.12, conditions, fontsize=9, color=SOFT, va="center")
    DRAWN[trial.kind](body, trial)
    _indices(bottom, trial, lines)
    with records.atomic(file) as temporary:
        figure.savefig(temporary)


def _indices(figure: "SubFigure", trial: Trial, lines: int) -> None:
    """Indices, limits and verdicts, and the notes, as lines of small type."""
    heads, cells = rows(trial)
    places = [0.02, *(0.24 + 0.15 * np.arange(len(heads) - 1))]
    step = 1 / lines
    for row, texts in enumerate([heads, *cells]):
        for place, text in zip(places, texts, strict=True):
            colour = {"FAIL": COLOURS["port"], "PASS": COLOURS["starboard"]}.get(text, INK if row else SOFT)
            figure.text(place, 1 - (row + 0.5) * step, text, fontsize=7.2, color=colour, va="center")
    for row, note in enumerate((*trial.notes, closing(trial))):
        figure.text(0.02, 1 - (len(cells) + row + 1.6) * step, note, fontsize=7.2, color=SOFT, va="center")


def _turning_circle(figure: "SubFigure", trial: Trial) -> None:
    ((left, right),) = figure.subfigures(1, 2, squeeze=False, width_ratios=[1.5, 1])
    axes, length = left.subplots(), trial.setting.length
    ends = []
    for run in trial.runs:
        circle = cast(TurningCircle, run.found)
        side = -1 if run.side == "port" else 1
        turned = np.abs(run.voyage.heading)
        angles = np.radians(np.arange(0, 361, 30))
        times = np.interp([reached(turned, a) for a in angles], np.arange(len(turned)), run.voyage.time)
        ends.append(float(np.nanmax(times)))
        track(axes, trial, run, ends[-1], times)
        advance, transfer, tactical = (value / length for value in circle)
        edge, low = (
            side * max(tactical, 1.0),
            min(0.0, float(run.voyage.north[run.voyage.time <= ends[-1]].min() / length)),
        )
        if math.isfinite(advance):
            beyond, above = edge + side * 0.75, advance + 0.75
            line(axes, (side * transfer, beyond), (advance, advance))
            line(axes, (0, beyond), (0, 0))
            measure(axes, (beyond, 0), (beyond, advance), f"advance {advance:.2f} L")
            line(axes, (side * transfer, side * transfer), (advance, above))
            measure(axes, (0, above), (side * transfer, above), f"transfer\n{transfer:.2f} L")
        if math.isfinite(tactical):
            north = float(np.interp(reached(turned, np.pi), np.arange(len(turned)), run.voyage.north)) / length
            line(axes, (side * tactical, side * tactical), (north, low - 0.75))
            measure(axes, (0, low - 0.75), (side * tactical, low - 0.75), f"tactical diameter {tactical:.2f} L")
    advances = [cast(TurningCircle, run.found).advance / length for run in trial.runs]
    top = max([1.0, *(advance for advance in advances if math.isfinite(advance))])
    axes.plot([0, 0], [-1.5, top + 0.9], color=RULE, linewidth=0.8, linestyle=(0, (8, 3)))
    north_up(axes)
    panels = right.subplots(3, 1, sharex=True)
    end = max(ends)
    series(panels[0], trial, end, "speed / V", lambda v: np.hypot(v.surge, v.sway) / trial.setting.speed)
    series(panels[1], trial, end, "drift angle [deg]", lambda v: np.degrees(np.arctan2(-v.sway, v.surge)))
    series(panels[2], trial, end, "yaw rate [deg/s]", lambda v: np.degrees(v.yaw_rate))
    panels[0].set_ylim(0, 1.05)
    panels[0].legend(frameon=False, fontsize=8)
    panels[2].set_xlabel("time [s]", fontsize=8, color=SOFT)


def _zigzag(figure: "SubFigure", trial: Trial) -> None:
    tests = list(dict.fromkeys(run.test for run in trial.runs))
    panels = figure.subplots(3, len(tests), squeeze=False, sharex="col")
    for column, test in enumerate(tests):
        runs = [run for run in trial.runs if run.test == test]
        end = max(_end_of(cast(Zigzag, run.found), run) for run in runs)
        for axes, run in zip(panels[:, column], runs, strict=False):
            found, v = cast(Zigzag, run.found), run.voyage
            shown, psi = v.time <= end, np.degrees(v.heading - v.heading[0])
            axes.plot(v.time[shown], psi[shown], color=COLOURS[run.side], linewidth=1.5, label="heading change")
            axes.plot(v.time[shown], np.degrees(v.rudder[shown]), color=INK, linewidth=0.9, label="rudder")
            for k, peak in enumerate(found.peaks[:2]):
                over, start = math.degrees(found.overshoots[k]), float(np.interp(found.executes[k + 1], v.time, psi))
                top = float(np.interp(peak, v.time, psi))
                axes.plot([found.executes[k + 1], peak], [start, start], color=RULE, linewidth=0.6, linestyle=":")
                axes.annotate(
                    "",
                    (peak, start),
                    (peak, top),
                    arrowprops={"arrowstyle": "<->", "color": INK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0},
                )
                allowed = limit(run.indices[k], trial.setting.length)
                axes.annotate(
                    f"{over:.1f} deg" + (f" (limit {allowed})" if allowed else ""),
                    (peak, top),
                    xytext=(0, 5 if top > 0 else -5),
                    textcoords="offset points",
                    fontsize=7.5,
                    color=INK,
                    va="bottom" if top > 0 else "top",
                    ha="center",
                )
            high = 1.45 * float(np.abs(psi[shown]).max())
            axes.set_ylim(-high, high)
            axes.axhline(0, color=RULE, linewidth=0.6)
            axes.set_title(f"{test}, begun to {run.side}", loc="left", fontsize=9, color=INK)
            dress(axes, "", "deg")
        panels[0, column].legend(frameon=False, fontsize=7.5, loc="lower right", bbox_to_anchor=(1, 0.97), ncols=2)
        for run in runs:
            shown = run.voyage.time <= end
            rate = np.degrees(run.voyage.yaw_rate[shown])
            panels[2, column].plot(
                run.voyage.time[shown],
                rate,
                color=COLOURS[run.side],
                linestyle=DASHES[run.side],
                linewidth=1.2,
                label=run.side,
            )
        panels[2, column].axhline(0, color=RULE, linewidth=0.6)
        panels[2, column].set_xlim(0, end)
        panels[2, column].legend(frameon=False, fontsize=7.5, loc="lower right", bbox_to_anchor=(1, 0.97), ncols=2)
        dress(panels[2, column], "time [s]", "yaw rate [deg/s]")


def _end_of(found: Zigzag, run: Run) -> float:
    """When the picture of a zigzag ends: a little after the fourth execute."""
    return float(found.executes[3] * 1.12) if len(found.executes) > 3 else float(run.voyage.time[-1])


def _williamson(figure: "SubFigure", trial: Trial) -> None:
    ((left, right),) = figure.subfigures(1, 2, squeeze=False, width_ratios=[1.2, 1])
    axes, ends, length = left.subplots(), [], trial.setting.length
    for run in trial.runs:
        found, v = cast(Return, run.found), run.voyage
        last = np.nanmax([found.time, found.abeam_time, v.time[-1] / 2 if math.isnan(found.abeam_time) else 0.0])
        ends.append(float(last))
        track(axes, trial, run, ends[-1], np.arange(0, ends[-1], max(1.5 * trial.setting.unit, ends[-1] / 16)))
        if math.isfinite(found.offset):
            north, east = (float(np.interp(found.time, v.time, values)) / length for values in (v.north, v.east))
            measure(axes, (0, north), (east, north), f"{abs(found.offset) / length:.2f} L")
            axes.plot(east, north, "D", color=COLOURS[run.side], markersize=5)
    axes.axvline(0, color=RULE, linewidth=0.8, linestyle=(0, (8, 3)))
    axes.plot(0, 0, "o", color=INK, markersize=5, linestyle="", label="rudder ordered")
    axes.plot([], [], "D", color=SOFT, markersize=5, linestyle="", label="on the reciprocal course to stay")
    axes.legend(frameon=False, fontsize=8)
    north_up(axes)
    panels = right.subplots(3, 1, sharex=True)
    series(panels[0], trial, max(ends), "heading change [deg]", lambda v: np.degrees(v.heading - v.heading[0]))
    series(panels[1], trial, max(ends), "rudder [deg]", lambda v: np.degrees(v.rudder))
    series(panels[2], trial, max(ends), "speed / V", lambda v: np.hypot(v.surge, v.sway) / trial.setting.speed)
    panels[0].set_yticks(np.arange(-240, 241, 60))
    panels[2].set_xlabel("time [s]", fontsize=8, color=SOFT)


def _pull_out(figure: "SubFigure", trial: Trial) -> None:
    panels = figure.subplots(3, 1, height_ratios=[1.6, 1, 0.7], sharex=True)
    v = trial.runs[0].voyage
    released = float(v.time[len(v.time) // 2])
    end = released + 0.6 * (v.time[-1] - released)
    series(panels[0], trial, end, "yaw rate [deg/s]", lambda v: np.degrees(v.yaw_rate), released)
    series(panels[1], trial, end, "speed / V", lambda v: np.hypot(v.surge, v.sway) / trial.setting.speed, released)
    series(panels[2], trial, end, "rudder [deg]", lambda v: np.degrees(v.rudder), released)
    for axes in panels:
        axes.axvline(0, color=RULE, linewidth=0.8, linestyle=":")
        axes.set_xlim(-0.4 * (end - released), end - released)
    panels[0].annotate(
        "rudder amidships",
        (0, panels[0].get_ylim()[1]),
        fontsize=8,
        color=SOFT,
        xytext=(4, -10),
        textcoords="offset points",
    )
    for run in trial.runs:
        left = math.degrees(run.voyage.yaw_rate[-1])
        panels[0].annotate(
            f"{run.side}: {left:.3g} deg/s remain" if abs(left) > 1e-4 else f"{run.side}: nothing remains",
            (end - released, left),
            fontsize=8,
            color=COLOURS[run.side],
            ha="right",
            xytext=(-4, 5 if run.side == "starboard" else -11),
            textcoords="offset points",
        )
    panels[0].legend(frameon=False, fontsize=8, loc="lower right")
    panels[2].set_xlabel("time since the rudder was ordered amidships [s]", fontsize=8, color=SOFT)


def _spiral(figure: "SubFigure", trial: Trial) -> None:
    whole, near = figure.subplots(1, 2, width_ratios=[1.5, 1])
    found = cast(Spiral, trial.runs[0].found)
    rudder, falling, rising = (np.degrees(values) for values in (found.rudder, found.falling, found.rising))
    for axes in (whole, near):
        axes.plot(
            rudder,
            falling,
            "-o",
            color=COLOURS["starboard"],
            markersize=3.5,
            linewidth=1.2,
            label="rudder going to port",
        )
        axes.plot(
            rudder, rising, "--s", color=COLOURS["port"], markersize=3, linewidth=1.2, label="rudder going to starboard"
        )
        axes.axhline(0, color=RULE, linewidth=0.8)
        axes.axvline(0, color=RULE, linewidth=0.8)
        dress(axes, "rudder angle [deg], to starboard positive", "steady yaw rate [deg/s]")
    unit = trial.setting.unit
    second = whole.secondary_yaxis("right", functions=(lambda r: np.radians(r) * unit, lambda r: np.degrees(r / unit)))
    second.set_ylabel("r' = r L / V", fontsize=8, color=SOFT)
    second.tick_params(labelsize=8, colors=SOFT)
    whole.legend(frameon=False, fontsize=8, loc="upper left")
    reach = max(1.5 * math.degrees(found.width), 0.1 * float(rudder[-1]))
    inside = np.abs(rudder) <= reach
    high = 1.15 * float(np.abs([falling[inside], rising[inside]]).max())
    near.set_xlim(-reach, reach)
    near.set_ylim(-high, high)
    if found.width > 0:
        near.set_title(
            f"loop {math.degrees(found.width):.2g} deg wide, {math.degrees(found.height):.2g} deg/s high",
            loc="left",
            fontsize=9,
        )
    else:
        near.set_title(f"no loop; slope K' = {found.slope * unit:.2f} amidships", loc="left", fontsize=9, color=INK)


def _stopping(figure: "SubFigure", trial: Trial) -> None:
    ((left, right),) = figure.subfigures(1, 2, squeeze=False, width_ratios=[1, 1.3])
    axes, run, length = left.subplots(), trial.runs[0], trial.setting.length
    found, v = cast(Stop, run.found), run.voyage
    end = found.time if math.isfinite(found.time) else float(v.time[-1])
    track(axes, trial, run, end, np.linspace(0, end, int(np.clip(np.nan_to_num(found.track_reach / length), 2, 8))))
    axes.axvline(0, color=RULE, linewidth=0.8, linestyle=(0, (8, 3)))
    if math.isfinite(found.time):
        head, side = found.head_reach / length, found.side_reach / length
        beyond = max(side, 0) + 1.0
        line(axes, (side, beyond), (head, head))
        line(axes, (0, beyond), (0, 0))
        measure(axes, (beyond, 0), (beyond, head), f"head reach {head:.2f} L")
        if abs(side) > 0.3:
            measure(axes, (0, head + 0.8), (side, head + 0.8), f"side reach\n{side:.2f} L")
        axes.set_title(
            f"track reach {found.track_reach / length:.2f} L, stopped after {found.time:.{0 if found.time > 20 else 1}f} s",
            loc="left",
            fontsize=9,
            color=INK,
        )
    north_up(axes)
    panels = right.subplots(3, 1, sharex=True)
    series(panels[0], trial, 1.05 * end, "ahead speed / V", lambda v: v.surge / trial.setting.speed)
    turned = bool(np.ptp(v.pitch_order) > 0 or abs(v.pitch_order[0] - v.pitch_ratio[0]) > 1e-9)
    series(
        panels[1],
        trial,
        1.05 * end,
        "propeller pitch ratio" if turned else "shaft [rev/s]",
        lambda v: v.pitch_ratio if turned else v.shaft,
    )
    series(panels[2], trial, 1.05 * end, "heading change [deg]", lambda v: np.degrees(v.heading - v.heading[0]))
    panels[2].set_xlabel("time [s]", fontsize=8, color=SOFT)


DRAWN: dict[str, Callable[["SubFigure", Trial], None]] = {
    "turning-circle": _turning_circle,
    "zigzag": _zigzag,
    "williamson": _williamson,
    "pull-out": _pull_out,
    "spiral": _spiral,
    "stopping": _stopping,
}
