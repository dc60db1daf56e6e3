"""The interactive figures of the report, as plotly figures. plotly is imported inside the functions only."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aspnn.evaluation.coverage import LEVELS, coverage
from aspnn.evaluation.evaluate import Evaluation, headline_groups
from aspnn.evaluation.examples import INK, Example, colours
from aspnn.motion import Path
from aspnn.motion.pivot import REGION_CENTRES
from aspnn.vessel import Vessel

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

FONT = {"family": "system-ui, -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif", "size": 13, "color": INK}
GRID = "#e8ebef"
INKS = ("#1f6feb", "#f0883e", "#8250df", "#2a9d4a", "#bf3989", "#c9a227")
HIDDEN = 4  # rank in the legend from which on a path is hidden at first
WHISKERS = (5, 25, 50, 75, 95)  # percentiles of the boxplots
FLOOR = 1e-3  # m or deg: smaller errors are drawn here, since logarithmic axes have no zero
SOFT = 0.1  # deg: heading errors are drawn on a scale that is linear below this and logarithmic above


def dress(figure: "Figure", height: int, **layout) -> "Figure":
    """The look that all figures share."""
    figure.update_layout(
        template="none",
        font=FONT,
        height=height,
        margin={"l": 64, "r": 24, "t": 60, "b": 52},
        paper_bgcolor="white",
        plot_bgcolor="white",
        hoverlabel={"font": FONT, "bgcolor": "white", "bordercolor": "#d0d7de"},
        legend={"orientation": "h", "y": -0.12, "x": 0, "yanchor": "top"},
        **layout,
    )
    axis = {"gridcolor": GRID, "zerolinecolor": "#c9d1d9", "linecolor": "#8c959f", "ticks": "outside", "ticklen": 4}
    figure.update_xaxes(**axis, title_standoff=8)
    figure.update_yaxes(**axis, title_standoff=8, automargin=True)
    figure.update_annotations(font={**FONT, "size": 14})
    return figure


def faded(colour: str, opacity: float) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"


def _joined(outlines: np.ndarray) -> np.ndarray:
    """Closed outlines (hulls, points, 2) in one series (n, 2), parted by NaN."""
    gap = np.full((len(outlines), 1, 2), np.nan)
    return np.concatenate([outlines, gap], axis=1).reshape(-1, 2)


def tracks(case: Example, vessel: Vessel, colour: Mapping[str, str]) -> "Figure":
    """Tracks of one window with hull outlines to scale and the pivot point on each hull; equal scales, north up."""
    import plotly.graph_objects as go

    figure = go.Figure()

    def draw(name: str, path: Path, ink: str, rank: int) -> None:
        shared = {"legendgroup": name, "legendrank": rank, "visible": True if rank < HIDDEN else "legendonly"}
        hull = _joined(path.at(case.hulls).outline(vessel.outline()))
        figure.add_scatter(
            x=hull[:, 1], y=hull[:, 0], mode="lines", fill="toself", fillcolor=faded(ink, 0.13),
            line={"color": ink, "width": 1}, hoverinfo="skip", showlegend=False, **shared,
        )  # fmt: skip
        figure.add_scatter(
            x=path.east, y=path.north, mode="lines", line={"color": ink, "width": 2}, name=name, **shared,
            customdata=np.column_stack([path.time, np.degrees(path.heading) % 360]),
            hovertemplate="%{customdata[0]:.0f} s: %{y:.1f} m north, %{x:.1f} m east, heading %{customdata[1]:.1f}°",
        )  # fmt: skip
        at = path.at(case.hulls[1:])
        inside = np.abs(at.pivot) <= vessel.length  # further off it lies outside the picture
        figure.add_scatter(
            x=(at.east + at.pivot * np.sin(at.heading))[inside], y=(at.north + at.pivot * np.cos(at.heading))[inside],
            mode="markers", marker={"symbol": "x-thin", "size": 8, "line": {"color": ink, "width": 2}}, showlegend=False,
            customdata=np.column_stack([at.time, at.pivot, at.pivot_region(vessel.length)])[inside], name=name, **shared,
            hovertemplate="%{customdata[0]:.0f} s: pivot point %{customdata[1]:.1f} m forward, region %{customdata[2]:+.0f}",
        )  # fmt: skip

    for name in case.paths:
        if name != case.main:
            draw(name, case.paths[name], colour[name], 3 if name in case.shown else HIDDEN)
    draw(case.reference_name, case.reference, INK, 1)
    draw(case.main, case.paths[case.main], colour[case.main], 2)
    return dress(
        figure,
        640,
        xaxis={"title": {"text": "east of the start [m]"}, "constrain": "domain"},
        yaxis={"title": {"text": "north of the start [m]"}, "scaleanchor": "x", "scaleratio": 1},
    )


def course_of(case: Example, vessel: Vessel, colour: Mapping[str, str]) -> "Figure":
    """Along the time of one window: the planned rudder, the position error and the pivot point with its regions."""
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.1, row_heights=[0.18, 0.36, 0.46],
        subplot_titles=("Planned rudder order", "Position error", "Pivot point, forward of midship"),
        specs=[[{}], [{}], [{"secondary_y": True}]],
    )  # fmt: skip
    time = case.reference.time
    order = np.degrees(case.plan.rudder.at(time))
    figure.add_scatter(
        x=time, y=order, line={"color": INK, "shape": "hv"}, showlegend=False, name="order", row=1, col=1
    )
    for name in case.shown:
        figure.add_scatter(
            x=time[1:], y=np.maximum(case.errors[name][1:], FLOOR), line={"color": colour[name], "width": 2}, name=name, legendgroup=name,
            hovertemplate="%{x:.0f} s: %{y:.2f} m", row=2, col=1,
        )  # fmt: skip
    length = vessel.length
    for name, path, ink in (
        (case.reference_name, case.reference, INK),
        *((name, case.paths[name], colour[name]) for name in case.shown),
    ):
        place = np.where(np.abs(path.pivot) <= 0.8 * length, path.pivot, np.nan)
        figure.add_scatter(
            x=time, y=place, line={"color": ink, "width": 2}, name=name, legendgroup=name,
            showlegend=name == case.reference_name, customdata=path.pivot_region(length),
            hovertemplate="%{x:.0f} s: %{y:.1f} m, region %{customdata:+.0f}", row=3, col=1,
        )  # fmt: skip
    figure.add_scatter(x=[0], y=[0], opacity=0, showlegend=False, hoverinfo="skip", row=3, col=1, secondary_y=True)
    dress(figure, 640)
    figure.update_xaxes(title_text="time from the start [s]", row=3)
    reach = 1.1 * float(np.degrees(vessel.rudder_max))
    figure.update_yaxes(title_text="deg", range=[-reach, reach], row=1)
    figure.update_yaxes(title_text="m", type="log", dtick=1, row=2)
    limits = [-0.8 * length, 0.8 * length]
    figure.update_yaxes(title_text="m", range=limits, row=3, secondary_y=False)
    centres = REGION_CENTRES[2:-2]
    figure.update_yaxes(
        title_text="region", range=limits, showgrid=False, row=3, secondary_y=True,
        tickvals=centres * length / 8, ticktext=[f"{k:+d}" if k else "0" for k in range(-5, 6)], tickfont={"size": 9},
    )  # fmt: skip
    return figure


def growth(evaluation: Evaluation) -> "Figure":
    """Growth of position and absolute heading errors with the horizon: median (solid) and 95th percentile (dashed)."""
    from plotly.subplots import make_subplots

    groups, colour = headline_groups(evaluation), colours(evaluation)
    titles = [f"{group} ({len(evaluation.rows(group))} windows)" for group in groups]
    figure = make_subplots(
        rows=2, cols=len(groups), shared_xaxes=True, shared_yaxes=True, subplot_titles=titles,
        vertical_spacing=0.06, horizontal_spacing=0.03,
    )  # fmt: skip
    time = evaluation.times[1:]
    for col, group in enumerate(groups, 1):
        rows = evaluation.rows(group)
        for name, errors in evaluation.errors.items():
            for row, values in ((1, errors.position), (2, np.degrees(np.abs(errors.heading)))):
                for share, dash in ((50, "solid"), (95, "dot")):
                    figure.add_scatter(
                        x=time, y=np.maximum(np.percentile(values[rows, 1:], share, axis=0), FLOOR), row=row, col=col, name=name,
                        line={"color": colour[name], "dash": dash, "width": 2 if dash == "solid" else 1.5},
                        legendgroup=name, showlegend=(row, col, share) == (1, 1, 50),
                        hovertemplate=f"{name}, {share} %: %{{y:.3g}} {'m' if row == 1 else 'deg'} at %{{x:.0f}} s<extra></extra>",
                    )  # fmt: skip
    dress(figure, 700, legend_y=-0.1)
    figure.update_yaxes(type="log", dtick=1, exponentformat="none")
    figure.update_yaxes(title_text="position error [m]", row=1, col=1)
    figure.update_yaxes(title_text="absolute heading error [deg]", row=2, col=1)
    figure.update_xaxes(title_text="horizon [s]", row=2)
    return figure


def soft_log(degrees):
    """asinh(x / 0.1 deg): linear for small errors, logarithmic for large ones, odd, so that both signs can be drawn."""
    return np.arcsinh(np.asarray(degrees, float) / SOFT)


def boxes(evaluation: Evaluation, group: str) -> "Figure":
    """Boxplots of one group by horizon and predictor (Paper V, figures 16 and 17): position and signed heading error."""
    from plotly.subplots import make_subplots

    rows, colour = evaluation.rows(group), colours(evaluation)
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    horizons = evaluation.rule.horizons
    columns = [evaluation.column(horizon) for horizon in horizons]
    for name, errors in evaluation.errors.items():
        for row, values in ((1, np.maximum(errors.position, FLOOR)), (2, soft_log(np.degrees(errors.heading)))):
            low, first, middle, third, high = np.percentile(values[rows][:, columns], WHISKERS, axis=0)
            figure.add_box(
                x=[f"{horizon:g} s" for horizon in horizons], lowerfence=low, q1=first, median=middle, q3=third,
                upperfence=high, name=name, offsetgroup=name, legendgroup=name, showlegend=row == 1,
                line={"color": colour[name], "width": 1.5}, fillcolor=faded(colour[name], 0.25),
                hoverinfo="y" if row == 1 else "skip", row=row, col=1,
            )  # fmt: skip
    dress(figure, 680, boxmode="group", boxgap=0.15, boxgroupgap=0.15, legend_y=-0.1)
    figure.update_yaxes(title_text="position error [m]", type="log", dtick=1, exponentformat="none", row=1, col=1)
    ticks = np.array([0, 0.1, 0.3, 1, 3, 10, 30, 90, 180])
    ticks = np.concatenate([-ticks[:0:-1], ticks])
    figure.update_yaxes(
        title_text="heading error [deg]", row=2, col=1,
        tickvals=soft_log(ticks), ticktext=[f"{tick:g}" for tick in ticks], zeroline=True, tickfont={"size": 11},
    )  # fmt: skip
    figure.update_xaxes(title_text="horizon", row=2, col=1)
    return figure


def reliability(evaluation: Evaluation, name: str) -> "Figure":
    """Reliability of a predictor's regions: the share they hold over the share they promise, by group, with two errors.

    On the diagonal they are right, above it too wide, below it too narrow. Position above, heading below.
    """
    from plotly.subplots import make_subplots

    groups = [
        group for group in headline_groups(evaluation) if coverage(evaluation, name, group, evaluation.rule.horizon)
    ]
    figure = make_subplots(
        rows=2, cols=len(groups), shared_xaxes=True, shared_yaxes=True, subplot_titles=groups,
        vertical_spacing=0.05, horizontal_spacing=0.03,
    )  # fmt: skip
    some = evaluation.rule.horizons[1::2] or evaluation.rule.horizons
    for col, group in enumerate(groups, 1):
        for row, what in ((1, "position"), (2, "heading")):
            figure.add_scatter(
                x=[0.45, 1], y=[0.45, 1], mode="lines", line={"color": INK, "width": 1, "dash": "dot"}, name="right",
                hoverinfo="skip", legendgroup="right", showlegend=(row, col) == (1, 1), row=row, col=col,
            )  # fmt: skip
            for number, horizon in enumerate(some):
                found = [coverage(evaluation, name, group, horizon, level) for level in LEVELS]
                shares = [(level, getattr(c, what)) for level, c in zip(LEVELS, found, strict=True) if c is not None]
                figure.add_scatter(
                    # Set apart a little, so that the errors of three horizons do not hide each other.
                    x=[level + 0.004 * (number - (len(some) - 1) / 2) for level, _ in shares],
                    y=[s.value for _, s in shares], mode="lines+markers", name=f"{horizon:g} s",
                    error_y={"array": [s.two_errors for _, s in shares], "thickness": 1, "width": 2},
                    line={"color": INKS[number % len(INKS)], "width": 1.5}, marker={"size": 5},
                    customdata=[level for level, _ in shares],
                    legendgroup=f"{horizon:g}", showlegend=(row, col) == (1, 1), row=row, col=col,
                    hovertemplate=f"{horizon:g} s: %{{customdata:.0%}} promised, %{{y:.1%}} held<extra></extra>",
                )  # fmt: skip
    dress(figure, 760, legend_y=-0.08)
    figure.update_xaxes(range=[0.45, 1.02], tickformat=".0%", dtick=0.1)
    figure.update_xaxes(title_text="share promised", row=2)
    figure.update_yaxes(range=[0.4, 1.04], tickformat=".0%", dtick=0.1)
    for row, what in ((1, "position"), (2, "heading")):
        figure.update_yaxes(title_text=f"share held, {what}", row=row, col=1)
    return figure


def training(curves: Mapping[str, pd.DataFrame]) -> "Figure":
    """Training curves: every column with `loss` in its name against the epoch (or the step where there is no epoch)."""
    import plotly.graph_objects as go

    figure = go.Figure()
    lines = [(run, column) for run, table in curves.items() for column in table.columns if "loss" in column]
    for number, (run, column) in enumerate(lines):
        table = curves[run].dropna(subset=[column])
        over = "epoch" if "epoch" in table else "step"
        ink = INKS[number % len(INKS)]
        figure.add_scatter(x=table[over], y=table[column], name=f"{run}: {column}", mode="lines", line={"color": ink})
    dress(figure, 380, xaxis_title_text="epoch", yaxis_title_text="loss", yaxis_type="log", yaxis_dtick="D2")
    return figure
