"""What `aspnn consistency` measures: innovations of a log, errors where there is truth, and Monte Carlo runs (Paper II)."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aspnn import records
from aspnn.estimation.cascade import run_cascade
from aspnn.estimation.consistency import CONDITION, autocorrelation, average_bounds, shares
from aspnn.estimation.sensors import Series, Summary, sensors, summarise
from aspnn.evaluation.monte_carlo import FILTERS, STATES, UNITS, Errors, MonteCarlo, Watch, monte_carlo, state_errors
from aspnn.records import Log
from aspnn.schema import InputError

SETTLE = 60.0  # s that are not judged, or a quarter of a log shorter than four minutes
RATIO = 0.1  # of a mean NIS per degree of freedom from 1: less is of no account, however sure
COLOUR, LATE, SHIFT = 0.05, 0.1, 0.1  # autocorrelation, correlation, mean over deviation: likewise
DELAY = 0.15  # s: a smaller lag of the yaw rate is of no account
SURE = 3.0  # standard errors of a mean that is called a bias


@dataclass(frozen=True)
class Consistency:
    """Everything measured of one log; series begin at `since` [s]. `correlations` (lags, c) by sensor, c its components."""

    name: str
    vessel: str
    sha256: str
    since: float
    summaries: tuple[Summary, ...]
    series: tuple[Series, ...]
    correlations: dict[str, np.ndarray]
    errors: Errors | None
    monte_carlo: MonteCarlo | None


def consistency(
    log: Log,
    truth: pd.DataFrame | None = None,
    runs: int = 0,
    seed: int = 0,
    watch: Watch | None = None,
) -> Consistency:
    """Measure one log: its own innovations, its errors if there is truth, and `runs` Monte Carlo runs around the truth.

    `watch` shows the runs going by. Raises InputError for a wrong log, and for runs without a truth that fits the log.
    """
    where = log.path or log.voyage
    if runs and truth is None:
        raise InputError(f"{where}: no truth lies beside the log, which --runs needs; leave --runs out")
    cascade = run_cascade(log)
    time = cascade.measurements.time
    since = float(time[0] + min(SETTLE, (time[-1] - time[0]) / 4))
    series = tuple(s.since(since) for s in sensors(cascade))
    file = Path(log.path) if log.path else None
    return Consistency(
        name=file.name if file else log.voyage,
        vessel=log.vessel.title or log.vessel.name,
        sha256=records.sha256(file) if file and file.exists() else "",
        since=since,
        summaries=summarise(cascade, since),
        series=series,
        correlations={s.name: autocorrelation(_components(s)) for s in series if s.measured.any()},
        errors=None if truth is None else state_errors(cascade, truth, where).since(since),
        monte_carlo=monte_carlo(log, truth, runs, seed, since, watch) if runs and truth is not None else None,
    )


def _components(s: Series) -> np.ndarray:
    """Whitened innovations of a sensor, one row per value of it whatever its rate."""
    y = s.whitened[s.measured]
    return y[:, np.isfinite(y).any(0)]


def verdict(s: Summary) -> list[str]:
    """What a summary says of its sensor, in words with the remedy; empty for a consistent one.

    Only what is both beyond chance and large enough to matter.
    """
    found = []
    if s.mean_nis > max(s.mean_high, 1 + RATIO):
        found.append(
            f"too confident (NIS {s.mean_nis:.2f} per degree of freedom): its noise is set too small, `aspnn tune`"
        )
    elif s.mean_nis < min(s.mean_low, 1 - RATIO):
        found.append(
            f"too cautious (NIS {s.mean_nis:.2f} per degree of freedom): its noise is set too large, `aspnn tune`"
        )
    late, error = s.late
    delayed = np.isfinite(late) and abs(late) > max(DELAY, SURE * error)
    if delayed:
        found.append(
            f"{'late' if late > 0 else 'early'} by {abs(late):.2f} +- {error:.2f} s against the turn of the heading: "
            "set a delay (`aspnn tune --delays`), or leave this sensor out"
        )
    if abs(s.autocorrelation) > max(s.bound, COLOUR) and not delayed:
        in_time = abs(late) + SURE * error < DELAY  # for certain
        if abs(s.lateness) > max(s.bound, LATE) and not in_time:
            found.append(_late(s))
        else:
            found.append(
                f"coloured (autocorrelation {s.autocorrelation:+.2f}): its error lasts over epochs, `aspnn tune`, "
                "or a device that smooths"
            )
    if abs(s.bias) > SURE and abs(s.shift) > SHIFT:
        worst = s.mean[int(np.argmax(np.abs(s.mean)))]
        about = "lever arm (stations_m) and heading offset" if s.unit == "m" else "zero of the sensor"
        found.append(f"biased (mean innovation {worst:+.3g} {s.unit}): check the {about}")
    if s.rejected > 0.01:
        found.append(f"{s.rejected:.1%} rejected by the gate")
    if s.rcond < CONDITION:
        found.append(
            f"its S is near singular (scaled condition {s.rcond:.1g}): two sensors tell the same, or noise is set to nothing"
        )
    return found


def _late(s: Summary) -> str:
    how = f"autocorrelation {s.autocorrelation:+.2f}, correlation with the yaw acceleration {s.lateness:+.2f}"
    if s.sensor == "heading":
        who = "late" if s.lateness < 0 else "early, or the yaw rate late"
        return f"{who} ({how}): set the sensor's delay"
    return f"late in turns ({how}): `aspnn tune`, then look for a delay among the sensors"


def words(result: Consistency) -> list[str]:
    """The verdict on every sensor of a log, one line each that is not consistent and one for all that are."""
    said = {s.sensor: verdict(s) for s in result.summaries}
    lines = [f"{name}: {'; '.join(found)}." for name, found in said.items() if found]
    lines += _runs_said(result.monte_carlo) if result.monte_carlo else []
    good = [name for name, found in said.items() if not found]
    return lines + ([f"Consistent: {', '.join(good)}."] if good else [])


def _runs_said(found: MonteCarlo) -> list[str]:
    """What the runs say beyond the innovations: divergence, and errors that are not as large as told."""
    lines = (
        [f"{found.diverged} of {found.runs} runs diverged: the process noise is too small."] if found.diverged else []
    )
    for name, average in found.nees.items():
        part = average.shares
        if part.inside < 1 - RATIO:
            lines.append(
                f"Errors of {name}: NEES of {found.runs} runs inside in {part.inside:.1%} of the epochs, above in {part.above:.1%}, "
                f"below in {part.below:.1%}; along this voyage they are not always as large as the filter tells."
            )
    return lines


def error_rows(errors: Errors) -> list[dict[str, Any]]:
    """By state: rms error and rms of the deviation told, in `unit`, and the share of errors within two deviations."""
    rms, told = (np.sqrt(np.mean(a**2, axis=0)) for a in (errors.error, errors.deviation))
    within = np.mean(np.abs(errors.error) <= 2 * errors.deviation, axis=0)
    scale = np.array([np.degrees(1.0) if UNITS[name].startswith("deg") else 1.0 for name in STATES])
    return [
        {"state": n, "unit": UNITS[n], "rms": float(a), "deviation": float(b), "within_2sd": float(w)}
        for n, a, b, w in zip(STATES, rms * scale, told * scale, within, strict=True)
    ]


def metrics(results: Sequence[Consistency]) -> dict[str, Any]:
    """The content of the JSON file: by log the sensors, the errors and the Monte Carlo; shares 0 to 1, None where unknown."""
    return {"logs": [_entry(result) for result in results]}


def _entry(result: Consistency) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "log": result.name,
        "sha256": result.sha256,
        "vessel": result.vessel,
        "since_s": result.since,
        "sensors": {s.sensor: asdict(s) | {"verdict": verdict(s)} for s in result.summaries},
    }
    if result.errors is not None:
        entry["errors"] = error_rows(result.errors)
        dof = {name: place.stop - place.start for name, place in FILTERS.items()}
        entry["nees"] = {
            name: {"dof": dof[name], "mean": float(np.mean(value)), **asdict(shares(value, *average_bounds(dof[name])))}
            for name, value in result.errors.nees.items()
        }
    if result.monte_carlo is not None:
        found = result.monte_carlo
        entry["monte_carlo"] = {
            "runs": found.runs,
            "seed": found.seed,
            "diverged": found.diverged,
            "rms": dict(zip(STATES, (float(v) for v in found.rms), strict=True)),
            **{
                kind: {name: asdict(average.shares) for name, average in getattr(found, kind).items()}
                for kind in ("nis", "lag_one", "nees")
            },
        }
    return entry


def write_metrics(results: Sequence[Consistency], path: str | Path) -> None:
    """Write the JSON file, whole or not at all."""
    records.write_json(metrics(results), path)
