"""Windows worth looking at: the typical, the bad and the worst of the main predictor, and a steady one."""

from dataclasses import dataclass, replace

import numpy as np

from aspnn.evaluation.evaluate import ORACLE, Evaluation, best_baseline
from aspnn.evaluation.windows import ORDER, STEADY
from aspnn.motion import Path
from aspnn.orders import Plan


@dataclass(frozen=True)
class Example:
    """One window: the reference, every predictor's path with its position error, the plan, and what it stands for.

    Places are north and east of the reference's start [m]; `hulls` [s] are the times at which hulls are drawn.
    """

    title: str
    group: str
    voyage: str
    time: float
    plan: Plan
    reference: Path
    paths: dict[str, Path]
    errors: dict[str, np.ndarray]
    main: str
    baseline: str | None
    hulls: np.ndarray
    reference_name: str  # `truth` or `smoothed`

    @property
    def shown(self) -> list[str]:
        """The predictors that a picture shows at first: the main one, the best baseline of its group, the oracle."""
        return [name for name in (self.main, self.baseline, ORACLE) if name in self.paths]


def examples(evaluation: Evaluation) -> list[Example]:
    """Median, 95th percentile and worst window by the main predictor's last error, and the median steady one.

    The first three are of the rule's first headline group: new orders of a ship, all orders of a model ship.
    """
    first = evaluation.rule.headline[0]
    group = first if len(evaluation.rows(first)) else ORDER
    found: dict[int, Example] = {}
    for name, share, groups in (
        ("Typical (median)", 0.5, group),
        ("Bad (95th percentile)", 0.95, group),
        ("Worst", 1.0, group),
        ("Steady (median)", 0.5, STEADY),
    ):
        rows = evaluation.rows(groups)
        if len(rows):
            last = evaluation.errors[evaluation.main].position[rows, -1]
            window = int(rows[np.argsort(last, kind="stable")[round(share * (len(rows) - 1))]])
            found.setdefault(window, example(evaluation, window, name, groups))
    return list(found.values())


def example(evaluation: Evaluation, window: int, title: str, group: str) -> Example:
    """The window of that number as an example; `group` decides which baseline is the best."""
    row = evaluation.windows.iloc[window]
    reference = evaluation.reference[window]
    origin = reference.north[0], reference.east[0]
    horizon = evaluation.rule.horizon
    return Example(
        title=title,
        group=str(row["group"]),
        voyage=str(evaluation.data[row["voyage"]]["voyage"]),
        time=float(row["time_s"]),
        plan=evaluation.plans[window],
        reference=_moved(reference, *origin),
        paths={name: _moved(path[window], *origin) for name, path in evaluation.paths.items()},
        errors={name: errors.position[window] for name, errors in evaluation.errors.items()},
        main=evaluation.main,
        baseline=best_baseline(evaluation, group, horizon),
        hulls=np.linspace(0.0, horizon, 7),
        reference_name=str(evaluation.data[row["voyage"]]["reference"]),
    )


def _moved(path: Path, north: float, east: float) -> Path:
    return replace(path, north=path.north - north, east=path.east - east)


INK, MAIN, ORACLE_GREEN = "#24292f", "#1f6feb", "#2a9d4a"
_BASELINES = {"caa_ctra": "#f0883e", "caa_cmm": "#c9a227", "constant": "#cf4a3c"}
_OTHERS = ("#8250df", "#bf3989", "#1b7c83", "#57606a", "#6e4a1e")


def colours(evaluation: Evaluation) -> dict[str, str]:
    """One colour for every predictor, the same in every figure: blue the main one, warm the baselines, green the oracle."""
    others = iter(_OTHERS * len(evaluation.errors))
    fixed = {**_BASELINES, ORACLE: ORACLE_GREEN} | {evaluation.main: MAIN}
    return {name: fixed[name] if name in fixed else next(others) for name in evaluation.errors}
