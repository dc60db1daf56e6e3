"""A trial's indices as people read them: the table of the command line, the lines of the figure, and the JSON file."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspnn import __version__, records
from aspnn.logs.readings import KNOT
from aspnn.simulation.trials.indices import Index, Spiral
from aspnn.simulation.trials.manoeuvres import Run, Trial

if TYPE_CHECKING:
    from rich.console import RenderableType

STANDARD = "IMO resolution MSC.137(76)"
TITLES = {
    "turning-circle": "turning circle",
    "zigzag": "zigzag",
    "williamson": "Williamson turn",
    "pull-out": "pull-out",
    "spiral": "direct spiral",
    "stopping": "full astern stop",
}
UNITS = {"rad": "deg", "rad/s": "deg/s"}  # people's units of ours


def plain(value: float, unit: str) -> float | None:
    """A value in people's units; None for what is not a number."""
    if not math.isfinite(value):
        return None
    return math.degrees(value) if unit in UNITS else float(value)


def words(value: float, unit: str, length: float) -> str:
    """A value with its unit; distances in lengths and metres."""
    number = plain(value, unit)
    if number is None:
        return "not reached"
    if unit == "m":
        return f"{value / length:.2f} L ({value:.{1 if length < 20 else 0}f} m)"
    if unit == "rad":
        return f"{number:.1f} deg"
    if unit == "s":
        return f"{number:.1f} s"
    return f"{number:.3f} {UNITS.get(unit, unit)}".rstrip()


def limit(index: Index, length: float) -> str:
    """The limit of an index, distances in lengths alone; empty without one."""
    if not math.isfinite(index.limit):
        return ""
    return f"{index.limit / length:g} L" if index.unit == "m" else words(index.limit, index.unit, length)


def rows(trial: Trial) -> tuple[list[str], list[list[str]]]:
    """Heads and cells: one row for an index of a test, with a value for each side, its limit, and PASS, FAIL or -.

    Where nothing has a limit there is no column for it.
    """
    length = trial.setting.length
    sides = list(dict.fromkeys(run.side for run in trial.runs))
    tests: dict[str, list[Run]] = {}
    for run in trial.runs:
        tests.setdefault(run.test, []).append(run)
    found: list[tuple[str, tuple[Index, ...]]] = []
    for test, runs in tests.items():
        found += [
            (f"{test} {group[0].title}".strip(), group) for group in zip(*(run.indices for run in runs), strict=True)
        ]
    found += [(index.title, (index,)) for index in trial.indices]
    cells: list[list[str]] = []
    for title, group in found:
        values = [words(index.value, index.unit, length) for index in group]
        verdicts = [index.verdict for index in group if index.verdict is not None]
        verdict = "-" if not verdicts else "PASS" if all(verdicts) else "FAIL"
        cells.append([title, *values, *[""] * (len(sides) - len(values)), limit(group[0], length), verdict])
    heads = ["", *(side or "value" for side in sides)]
    if any(line[-2] for line in cells):
        return [*heads, "limit", "verdict"], cells
    return heads, [line[:-2] for line in cells]


def heading(trial: Trial) -> tuple[str, str]:
    """Title and conditions, a line each."""
    setting = trial.setting
    vessel = setting.ship.vessel
    how = f", rudder {math.degrees(trial.rudder):g} deg" if trial.rudder else ""
    if trial.kind == "zigzag":
        how = " " + " and ".join(dict.fromkeys(run.test for run in trial.runs))
    title = f"{vessel.name}: {TITLES[trial.kind]}{how}"
    return title, (
        f"V = {setting.speed:.3g} m/s ({setting.speed / KNOT:.1f} kn), L = {setting.length:g} m ({setting.length_name}),"
        f" L/V = {setting.unit:.1f} s; calm, deep water, no wind"
    )


def closing(trial: Trial) -> str:
    """What the criteria say, in a sentence."""
    verdicts = trial.verdicts
    if not verdicts:
        return f"No criterion of {STANDARD} is judged in this trial."
    return f"{sum(verdicts)} of {len(verdicts)} criteria of {STANDARD} are met."


def table(trial: Trial) -> "RenderableType":
    """What the command line prints: the conditions, the indices with limits and verdicts, and the notes."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    title, conditions = heading(trial)
    heads, cells = rows(trial)
    shown = Table(title=title, title_justify="left")
    for number, head in enumerate(heads):
        shown.add_column(head, justify="left" if number == 0 else "right", no_wrap=True)
    for line in cells:
        shown.add_row(*line)
    return Group(shown, *(Text(line) for line in (conditions, *trial.notes, closing(trial))))


def data(trial: Trial) -> dict[str, Any]:
    """The trial as the plain data of its JSON file; angles in degrees, what was not reached null."""
    setting = trial.setting

    def one(index: Index) -> dict[str, Any]:
        entry = {
            "title": index.title,
            "value": plain(index.value, index.unit),
            "unit": UNITS.get(index.unit, index.unit),
        }
        if index.unit == "m":
            entry["lengths"] = plain(index.value / setting.length, "")
        entry["limit"] = plain(index.limit, index.unit)
        entry["verdict"] = None if index.verdict is None else "pass" if index.verdict else "fail"
        return entry

    def run(of: Run) -> dict[str, Any]:
        entry: dict[str, Any] = {
            "test": of.test,
            "side": of.side,
            "indices": {index.key: one(index) for index in of.indices},
        }
        if isinstance(of.found, Spiral):
            entry["curve"] = {
                "rudder_deg": [math.degrees(x) for x in of.found.rudder],
                "yaw_rate_falling_deg_s": [math.degrees(x) for x in of.found.falling],
                "yaw_rate_rising_deg_s": [math.degrees(x) for x in of.found.rising],
            }
        return entry

    return {
        "aspnn": __version__,
        "standard": STANDARD,
        "trial": trial.kind,
        "vessel": {"name": setting.ship.vessel.name, "title": setting.ship.vessel.title},
        "rudder_deg": math.degrees(trial.rudder),
        "speed_m_s": setting.speed,
        "speed_kn": setting.speed / KNOT,
        "length_m": setting.length,
        "length_is": setting.length_name,
        "length_over_speed_s": setting.unit,
        "runs": [run(of) for of in trial.runs],
        "indices": {index.key: one(index) for index in trial.indices},
        "criteria": {"judged": len(trial.verdicts), "met": sum(trial.verdicts)},
        "notes": list(trial.notes),
    }


def write_json(trial: Trial, path: str | Path) -> None:
    """Write the JSON file, whole or not at all."""
    with records.atomic(path) as temporary:
        temporary.write_text(json.dumps(data(trial), indent=1, allow_nan=False) + "\n")
