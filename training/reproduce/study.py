"""What the studies of trained predictors share: test voyages, figures at the longest horizon, results kept by name, cells of tables."""

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aspnn import records
from aspnn.estimation import filter_log, smooth_log
from aspnn.evaluation.evaluate import Evaluation, metrics
from aspnn.evaluation.reference import Voyage
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Vessel

ROOT = Path(__file__).parents[2]
GROUPS = ("new_order", "orders_within_horizon", "steady")
POSITION = ("position_m", "median", "p95")
HEADING = ("heading_deg", "median_abs", "p95_abs")

Score = dict[str, dict[str, float]]  # of one group at one horizon: what is measured, and how it is summed up
Scores = dict[str, Score]  # by group


def refitted(log: Log, vessel: Callable[[Vessel], Vessel]) -> Log:
    """The log as if it were of a vessel with other settings; its rows stay."""
    return Log(**{**vars(log), "vessel": vessel(log.vessel)})


def test_voyages(logs: Iterable[Path], vessel: Callable[[Vessel], Vessel] = lambda same: same) -> list[Voyage]:
    """Simulated voyages to be evaluated, with their truth, filtered as `vessel` has their settings."""
    read = [refitted(records.read_log(file), vessel) for file in logs]
    return [Voyage.of(log, filter_log(log), smooth_log) for log in read]


def scores(evaluation: Evaluation, name: str) -> Scores:
    """The errors of a predictor at the longest horizon, by group. Raises InputError for a group without windows."""
    horizon, groups = f"{evaluation.rule.horizon:g}", metrics(evaluation)["predictors"][name]
    empty = [group for group in GROUPS if not groups[group]["n"]]
    if empty:
        raise InputError(f"--voyages: the test voyages have no window of {empty[0]}; make more of them")
    return {group: groups[group]["horizons"][horizon] for group in GROUPS}


def cell(values: Sequence[Score], what: str, median: str, high: str, digits: int) -> str:
    """Median / p95 over seeds, with the range of the median where there is more than one value."""
    middle, top = ([value[what][key] for value in values] for key in (median, high))
    text = f"{np.median(middle):.{digits}f} / {np.median(top):.{digits}f}"
    spread = f"{min(middle):.{digits}f}", f"{max(middle):.{digits}f}"
    return text if spread[0] == spread[1] else f"{text} ({spread[0]}-{spread[1]})"


def cells(values: Sequence[Score]) -> list[str]:
    """The two cells of a group: position in metres (tenths from 5 m on), heading in degrees."""
    digits = 2 if values[0]["position_m"]["median"] < 5 else 1
    return [cell(values, *POSITION, digits), cell(values, *HEADING, 2)]


def ratio(values: Sequence[Score], against: Sequence[Score], what: str, key: str) -> tuple[float, float, float]:
    """Median over seeds of `values` over that of `against`, and the lowest and the highest seed over the same."""
    own, other = ([score[what][key] for score in given] for given in (values, against))
    middle = float(np.median(other))
    return float(np.median(own)) / middle, min(own) / middle, max(own) / middle


class Kept:
    """Results by name in a JSON file that is whole after each of them, so that a killed study goes on.

    `made` says what they are results of; a file of something else is refused.
    """

    def __init__(self, path: Path, made: dict[str, Any]):
        self.path, self.made = path, json.loads(json.dumps(made))
        self.results: dict[str, Any] = {}
        if not path.exists():
            return
        try:
            found = json.loads(path.read_text())
            self.results = found["results"]
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: holds no results of this study; remove it or choose another --out") from None
        differ = [key for key in self.made if found["made"].get(key) != self.made[key]]
        if differ:
            raise InputError(f"{path}: holds results of another {differ[0]}; remove it or choose another --out")

    def __contains__(self, name: str) -> bool:
        return name in self.results

    def __getitem__(self, name: str) -> Any:
        return self.results[name]

    def put(self, name: str, result: Any) -> None:
        """Keep a result, on disk too."""
        self.results[name] = result
        with records.atomic(self.path) as temporary:
            temporary.write_text(json.dumps({"made": self.made, "results": self.results}, indent=1) + "\n")
