"""The figures of the consistency report, as plotly figures. plotly is imported inside the functions only."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtri

from aspnn.estimation.consistency import average_bounds, lag_bound
from aspnn.evaluation.consistency import Consistency
from aspnn.evaluation.examples import INK
from aspnn.evaluation.monte_carlo import STATES, UNITS, Average, Errors, MonteCarlo
from aspnn.evaluation.plots import dress, faded

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

INKS = ("#1f6feb", "#f0883e", "#8250df", "#2a9d4a", "#bf3989", "#c9a227", "#57606a", "#d1242f")
BOUND = "#d1242f"
POINTS, WINDOWS, QUANTILES = 1200, 240, 160  # at most as many are drawn, so that a page of a day's log stays small
FLOOR = 1e-3  # smaller NIS are drawn here, since logarithmic axes have no zero


def _thin(count: int, most: int = POINTS) -> slice:
    return slice(None, None, max(1, -(-count // most)))


def _small(values) -> np.ndarray:
    """Single precision halves the page."""
    return np.asarray(values, np.float32)


def _bounds(figure: "Figure", x, low, high, row: int, col: int = 1) -> None:
    """A band between two bounds."""
    line = {"color": BOUND, "width": 1, "dash": "dot"}
    shared = {"mode": "lines", "line": line, "hoverinfo": "skip", "showlegend": False, "row": row, "col": col}
    figure.add_scatter(x=_small(x), y=_small(high), **shared)
    figure.add_scatter(x=_small(x), y=_small(low), fill="tonexty", fillcolor=faded(BOUND, 0.07), **shared)


def nis(result: Consistency) -> "Figure":
    """NIS of each sensor over time: single values faint, and means of successive values with the bounds of such means."""
    from plotly.subplots import make_subplots

    shown = [s for s in result.series if s.measured.any()]
    figure = make_subplots(
        rows=len(shown), cols=1, shared_xaxes=True, vertical_spacing=0.2 / len(shown),
        subplot_titles=[f"{s.name}, {s.dof.max()} degree{'s' if s.dof.max() > 1 else ''} of freedom" for s in shown],
    )  # fmt: skip
    for row, (s, ink) in enumerate(zip(shown, _inks(len(shown)), strict=True), 1):
        time, value, dof = s.time[s.measured], np.maximum(s.nis[s.measured], FLOOR), s.dof[s.measured]
        some = _thin(len(time))
        figure.add_scatter(
            x=_small(time[some]), y=_small(value[some]), mode="markers", marker={"color": faded(ink, 0.25), "size": 3},
            name="one value", hovertemplate="%{x:.1f} s: %{y:.3g}", showlegend=False, row=row, col=1,
        )  # fmt: skip
        width = max(1, len(time) // WINDOWS)
        whole = len(time) // width * width
        at, mean, total = (v[:whole].reshape(-1, width).sum(1) / width for v in (time, value, dof))
        _bounds(figure, at, *average_bounds(total, width), row)
        figure.add_scatter(
            x=_small(at), y=_small(mean), mode="lines", line={"color": ink, "width": 1.6}, showlegend=False,
            name=f"mean of {width}", hovertemplate="%{x:.0f} s: %{y:.3g}", row=row, col=1,
        )  # fmt: skip
    dress(figure, 90 + 150 * len(shown))
    figure.update_yaxes(type="log", dtick=1, exponentformat="power", range=[-2, 2])
    figure.update_xaxes(title_text="time [s]", row=len(shown))
    return figure


def _inks(count: int) -> list[str]:
    return [INKS[k % len(INKS)] for k in range(count)]


def correlations(result: Consistency) -> "Figure":
    """Autocorrelation of each sensor's whitened innovations by lag, one line per component, with the bounds of white noise."""
    from plotly.subplots import make_subplots

    names, cols = list(result.correlations), 3
    rows = -(-len(names) // cols)
    figure = make_subplots(
        rows=rows, cols=cols, shared_xaxes=True, shared_yaxes=True, subplot_titles=names,
        vertical_spacing=0.12, horizontal_spacing=0.03,
    )  # fmt: skip
    counts = {s.name: int(s.measured.sum()) for s in result.series}
    for number, name in enumerate(names):
        row, col = number // cols + 1, number % cols + 1
        found, bound = result.correlations[name], lag_bound(counts[name])
        lags = np.arange(1, len(found) + 1)
        _bounds(figure, lags, np.full(len(lags), -bound), np.full(len(lags), bound), row, col)
        for component, ink in zip(found.T, INKS, strict=False):
            figure.add_scatter(
                x=lags, y=_small(component), mode="lines+markers", marker={"size": 3}, line={"color": ink, "width": 1.2},
                name=name, showlegend=False, hovertemplate="lag %{x}: %{y:+.3f}", row=row, col=col,
            )  # fmt: skip
    dress(figure, 110 + 200 * rows)
    reach = max(0.1, *(float(np.nanmax(np.abs(v))) for v in result.correlations.values()))
    figure.update_yaxes(range=[-1.1 * reach, 1.1 * reach])
    figure.update_xaxes(title_text="lag [values]", row=rows)
    return figure


def quantiles(result: Consistency) -> "Figure":
    """Quantiles of each sensor's NIS against those of its chi-square distribution; on the diagonal where the two agree."""
    import plotly.graph_objects as go

    figure, ends = go.Figure(), [FLOOR, 30.0]
    figure.add_scatter(x=ends, y=ends, mode="lines", line={"color": INK, "width": 1, "dash": "dot"}, name="chi-square")
    shown = [s for s in result.series if s.measured.any()]
    for s, ink in zip(shown, _inks(len(shown)), strict=True):
        value = s.nis[s.measured & (s.dof == s.dof.max())]
        beyond = np.geomspace(1.0, 1 / len(value), QUANTILES) * (1 - 0.5 / len(value))  # dense in the upper tail
        beyond = np.sort(np.concatenate([beyond, 1 - np.geomspace(0.5, 1 / len(value), QUANTILES // 4)]))
        figure.add_scatter(
            x=_small(chdtri(s.dof.max(), beyond)), y=_small(np.maximum(np.quantile(value, 1 - beyond), FLOOR)),
            mode="lines", line={"color": ink, "width": 2}, name=s.name, hovertemplate="%{x:.3g}: %{y:.3g}",
        )  # fmt: skip
    dress(figure, 480, legend_y=-0.18)
    figure.update_xaxes(type="log", dtick=1, title_text="quantile of chi-square", range=[-3, 1.6])
    figure.update_yaxes(type="log", dtick=1, title_text="quantile of the NIS", range=[-3, 2])
    return figure


def errors(found: Errors) -> "Figure":
    """Estimated minus true states over time, within two of the standard deviations that the filter tells."""
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=3, cols=2, shared_xaxes=True, vertical_spacing=0.08, horizontal_spacing=0.09,
        subplot_titles=[f"{name.replace('_', ' ')} [{UNITS[name]}]" for name in STATES],
    )  # fmt: skip
    some = _thin(len(found.time))
    time = found.time[some]
    for number, name in enumerate(STATES):
        row, col = number // 2 + 1, number % 2 + 1
        scale = np.degrees(1.0) if UNITS[name].startswith("deg") else 1.0
        error, width = (scale * a[some, number] for a in (found.error, found.deviation))
        _bounds(figure, time, -2 * width, 2 * width, row, col)
        figure.add_scatter(
            x=_small(time), y=_small(error), mode="lines", line={"color": INKS[0], "width": 1.2}, showlegend=False,
            name=name, hovertemplate="%{x:.0f} s: %{y:.3g}", row=row, col=col,
        )  # fmt: skip
    dress(figure, 700)
    figure.update_xaxes(title_text="time [s]", row=3)
    return figure


def averages(found: MonteCarlo) -> "Figure":
    """Averages over the runs at every epoch, with the bounds that hold 95 %: NIS by sensor, then NEES by filter."""
    from plotly.subplots import make_subplots

    lines: Sequence[tuple[str, Average]] = (
        *((f"NIS of {name}", average) for name, average in found.nis.items()),
        *((f"NEES of {name}", average) for name, average in found.nees.items()),
    )
    figure = make_subplots(
        rows=len(lines), cols=1, shared_xaxes=True, vertical_spacing=0.25 / len(lines),
        subplot_titles=[f"{name}: {a.shares.inside:.1%} inside" for name, a in lines],
    )  # fmt: skip
    for row, ((name, average), ink) in enumerate(zip(lines, _inks(len(lines)), strict=True), 1):
        some = _thin(len(average.time), POINTS // 2)
        time = average.time[some]
        _bounds(figure, time, average.low[some], average.high[some], row)
        figure.add_scatter(
            x=_small(time), y=_small(average.value[some]), mode="lines", line={"color": ink, "width": 1}, showlegend=False,
            name=name, hovertemplate="%{x:.1f} s: %{y:.3g}", row=row, col=1,
        )  # fmt: skip
    dress(figure, 90 + 130 * len(lines))
    figure.update_yaxes(rangemode="tozero")
    figure.update_xaxes(title_text="time [s]", row=len(lines))
    return figure
