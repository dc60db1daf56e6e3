"""What people read of `aspnn consistency`: the tables on the terminal and the page."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspnn import records
from aspnn.estimation.consistency import average_bounds, shares
from aspnn.estimation.sensors import Summary
from aspnn.evaluation import consistency_plots as plots
from aspnn.evaluation.consistency import Consistency, error_rows, verdict, words
from aspnn.evaluation.monte_carlo import FILTERS, MonteCarlo
from aspnn.evaluation.page import embed, fill, versions

if TYPE_CHECKING:
    from rich.console import RenderableType

SENSORS = (
    *("sensor", "values", "NIS\nper dof", "inside\n%", "below\n%", "above\n%", "lag one\n(bound)", "mean /\nerror"),
    *("with\nyaw acc.", "rejected\n%", "stale\n%", "gap\ns", "rcond"),
)
ERRORS = ("state", "unit", "rms error", "rms sd told", "within 2 sd %")
RUNS = ("average over the runs", "inside\n%", "below\n%", "above\n%", "lag one\ninside %")


def sensor_cells(s: Summary) -> list[str]:
    """A line of the table of sensors."""
    return [
        s.sensor,
        str(s.n),
        f"{s.mean_nis:.3f}",
        *(_percent(share) for share in (s.shares.inside, s.shares.below, s.shares.above)),
        f"{s.autocorrelation:+.3f} ({s.bound:.3f})",
        f"{s.bias:+.1f}",
        f"{s.lateness:+.3f}",
        _percent(s.rejected),
        _percent(s.stale),
        f"{s.coasting:.1f}",
        f"{s.rcond:.2g}",
    ]


def error_cells(result: Consistency) -> list[list[str]]:
    """The lines of the table of errors; none without truth."""
    if result.errors is None:
        return []
    return [
        [r["state"].replace("_", " "), r["unit"], f"{r['rms']:.3g}", f"{r['deviation']:.3g}", _percent(r["within_2sd"])]
        for r in error_rows(result.errors)
    ]


def run_cells(found: MonteCarlo) -> list[list[str]]:
    """The lines of the table of Monte Carlo averages."""
    lines = [
        [f"NIS of {name}", *_shares(average.shares), _percent(found.lag_one[name].shares.inside)]
        for name, average in found.nis.items()
    ]
    return lines + [[f"NEES of {name}", *_shares(average.shares), ""] for name, average in found.nees.items()]


def nees_line(result: Consistency) -> str:
    """One sentence on the NEES of the log itself; empty without truth."""
    if result.errors is None:
        return ""
    told = []
    for name, place in FILTERS.items():
        dof = place.stop - place.start
        value = result.errors.nees[name]
        inside = shares(value, *average_bounds(dof)).inside
        told.append(f"{name} {value.mean() / dof:.2f} per degree of freedom, {inside:.1%} inside")
    return f"NEES: {'; '.join(told)} (errors last for seconds, so one run tells little)."


def run_line(found: MonteCarlo) -> str:
    """One sentence on the Monte Carlo."""
    return (
        f"{found.runs} runs in {found.seconds:.1f} s, sensor noise of the vessel's settings drawn anew around the truth; "
        f"{found.diverged} diverged."
    )


def table(results: Sequence[Consistency]) -> "RenderableType":
    """What the command line prints: sensors, errors and runs of each log, and last the verdict in words."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    def grid(title: str, heads: Sequence[str], lines: Sequence[Sequence[str]], left: int = 1) -> Table:
        shown = Table(title=title, title_justify="left")
        for number, head in enumerate(heads):
            shown.add_column(head, justify="left" if number < left else "right", no_wrap=True)
        for line in lines:
            shown.add_row(*line)
        return shown

    parts: list[RenderableType] = []
    for result in results:
        parts.append(
            grid(f"{result.name}, from {result.since:g} s", SENSORS, [sensor_cells(s) for s in result.summaries])
        )
        if result.errors is not None:
            parts += [grid("Errors against the truth", ERRORS, error_cells(result), 2), Text(nees_line(result))]
        if result.monte_carlo is not None:
            parts += [grid("Monte Carlo", RUNS, run_cells(result.monte_carlo)), Text(run_line(result.monte_carlo))]
    for result in results:
        prefix = f"{result.name}: " if len(results) > 1 else ""
        parts += [Text(prefix + line) for line in words(result)]
    return Group(*parts)


def write_report(results: Sequence[Consistency], path: str | Path) -> None:
    """Write the page of all logs, whole or not at all."""
    page = fill(
        "consistency.html.jinja",
        heads={"sensors": SENSORS, "errors": ERRORS, "runs": RUNS},
        logs=[_log(result, number) for number, result in enumerate(results)],
        metadata=versions(),
    )
    with records.atomic(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _log(result: Consistency, number: int) -> dict[str, Any]:
    found, errors = result.monte_carlo, result.errors
    return {
        "result": result,
        "words": [(s.sensor, verdict(s)) for s in result.summaries],
        "sensors": [sensor_cells(s) for s in result.summaries],
        "errors": error_cells(result),
        "nees": nees_line(result),
        "runs": run_cells(found) if found else [],
        "run_line": run_line(found) if found else "",
        "nis": embed(plots.nis(result), f"nis-{number}"),
        "correlations": embed(plots.correlations(result), f"correlations-{number}"),
        "quantiles": embed(plots.quantiles(result), f"quantiles-{number}"),
        "states": embed(plots.errors(errors), f"errors-{number}") if errors else "",
        "averages": embed(plots.averages(found), f"averages-{number}") if found else "",
    }


def _shares(s) -> list[str]:
    return [_percent(share) for share in (s.inside, s.below, s.above)]


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"
