"""A real yacht in three dimensions where her sensors allow, her pivot point along a figure-8, predictions inside her turns.

    python training/reproduce/yacht_turns.py [FOLDER] [--out runs/reproduce] [--json FILE]

FOLDER holds the recordings that yacht.py describes. They tell heading, yaw rate, roll and positions without heights; no pitch
and no accelerations. Prints whether an antenna above midship that roll swings sideways is to be seen in positions; the two
filters beside each other; the pivot point with its interval beside that of the smoothed motion; errors of predictions of 10 s
that start while the yacht turns, against the smoothed recording. A figure shows the pivot point on the hulls of the figure-8.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from paper_6_figures import pivot_figure
from yacht import FOLDER, known

from aspnn.cli import guarded, say
from aspnn.estimation import filter_log, smooth_log
from aspnn.estimation.cascade import run_cascade
from aspnn.estimation.consistency import average_bounds, shares
from aspnn.estimation.spatial import filter_spatial, solve_position_velocity
from aspnn.evaluation.errors import path_errors
from aspnn.evaluation.reference import Reference
from aspnn.frames import convergence, to_geodetic, to_grid
from aspnn.logs.n2k_yacht import import_n2k_yacht
from aspnn.motion import Path as Track
from aspnn.motion.pivot import Motion, exact
from aspnn.prediction.kinematic import baselines
from aspnn.records import Log, States, atomic

HEIGHTS = (0.0, 2.0, 4.0, 6.0, 8.0, 12.0)  # m of the antenna above midship that are tried; the true one is not told
SETTLE = 10.0  # s left out at the start
TURNING = np.radians(1.0)  # rad/s: beyond it she turns
STRIDE, HORIZON, INNER = 2.0, 10.0, 0.1  # s: between predictions, of one, of its steps
TIMES = (5.0, 10.0)  # s at which errors are told
EVERY, HULLS = 2.0, 7  # s of the figure from step to step; steps from hull to hull
REASONS = """
- In three dimensions these sensors allow the lever arm to roll, and the rate of turn to be that of the heading; no more. Without
  accelerations nothing drives 3D-PV: it lets the velocity wander (0.05 m2/s3, not tuned to her) where the planar filter turns it
  with the hull and was tuned on the wide turn. Its sway is ten times less sure, and its predictions are worse.
- Roll swings the antenna by at most 1 cm per metre of height; a fix has 0.2 m. Up to 6 m no height gains more than 2.5 of log-likelihood,
  from 8 m on all lose: she carries it low, or its unit takes the roll away itself. What the planar filter loses at once at 2 m of
  the figure-8 are four fixes more that fail its gate.
- Where she turns the pivot point lies 2 to 22 m ahead of midship (5 to 95 %, figure-8), where the bow is at 9 m: over ground, so a current
  across the hull moves it. The interval, of the noise tuned on the wide turn, holds the smoothed place in 83 % of the figure-8.
- Inside a turn constant u, v and r beat both kinematic methods: accelerations taken from a filter that has no accelerometer are noise,
  and 10 s are 50 s2 of it.
"""


def upright(log: Log, height: float, swing: bool) -> Log:
    """The log with its fixes as if the antenna, `height` above midship, did not roll: y cos(phi) + height sin(phi) to starboard
    becomes y. With `swing` only what roll differs from its mean counts, since a list is no more than another station.
    """
    time, roll = known(log, "roll_deg")
    when, latitude = known(log, "compass_latitude_deg")
    _, longitude = known(log, "compass_longitude_deg")
    turn, heading = known(log, "heading_deg")
    phi = np.radians(np.interp(when, time, roll) - (roll.mean() if swing else 0.0))
    aside = height * np.sin(phi) - log.vessel.stations["compass"][1] * (1 - np.cos(phi))
    north, east = to_grid(np.radians(latitude), np.radians(longitude), log.zone)
    gamma = convergence(np.radians(latitude), np.radians(longitude), log.zone)
    psi = np.interp(when, turn, np.unwrap(np.radians(heading))) - gamma
    place = to_geodetic(north + aside * np.sin(psi), east - aside * np.cos(psi), log.zone)
    table = log.table.copy()
    rows = table["compass_latitude_deg"].notna()
    for axis, values in zip(("latitude", "longitude"), place, strict=True):
        table.loc[rows, f"compass_{axis}_deg"] = np.degrees(values)
    return replace(log, table=table)


def lever_lines(log: Log) -> Iterator[str]:
    """Log-likelihood gained and NIS by the height of the antenna: planar filter on corrected fixes, then 3D-PV with the arm."""
    plain = run_cascade(log).moving.log_likelihood
    bare = solve_position_velocity(log).moving.fit.log_likelihood
    yield "| antenna above midship m | planar, roll | planar, roll less its mean | 3D-PV | NIS of 3D-PV | its innovations m |"
    yield "|---|---|---|---|---|---|"
    for height in HEIGHTS:
        gains = [run_cascade(upright(log, height, swing)).moving.log_likelihood - plain for swing in (False, True)]
        tall = replace(log, vessel=replace(log.vessel, heights={**log.vessel.heights, "compass": height}))
        fit = solve_position_velocity(tall).moving.fit
        use = log.table["time_s"].to_numpy() > SETTLE
        off = fit.innovation[use, 0, :2]
        yield (
            f"| {height:g} | {gains[0]:+.1f} | {gains[1]:+.1f} | {fit.log_likelihood - bare:+.1f} | "
            f"{np.nanmean(fit.nis[use, 0]) / 2:.3f} | {np.sqrt(np.nanmean(off**2)):.4f} |"
        )


def filter_lines(filters: dict[str, States], smoothed: States) -> Iterator[str]:
    """NIS of the antenna and how far each filter's sway and yaw rate are from the smoothed motion, beside what it says itself."""
    yield "| filter | NIS per dof | % inside | surge off m/s | sway off m/s | its sd m/s | yaw rate off deg/s |"
    yield "|---|---|---|---|---|---|---|"
    for name, states in filters.items():
        use = states["time_s"] > SETTLE
        nis = states["nis_compass"][use]
        inside = 100 * shares(nis, *average_bounds(2.0)).inside
        off = {
            key: np.sqrt(np.mean((states[key] - smoothed[key])[use] ** 2))
            for key in ("surge_m_s", "sway_m_s", "yaw_rate_rad_s")
        }
        yield (
            f"| {name} | {np.nanmean(nis) / 2:.2f} | {inside:.1f} | {off['surge_m_s']:.3f} | {off['sway_m_s']:.3f} | "
            f"{np.median(states['sway_m_s_sd'][use]):.3f} | {np.degrees(off['yaw_rate_rad_s']):.3f} |"
        )


def motion(states: States, rows) -> Motion:
    """Sway and yaw rate of some rows with what the filter says of their errors."""
    names = ("sway_m_s", "yaw_rate_rad_s", "sway_m_s_sd", "yaw_rate_rad_s_sd")
    return Motion(*(states[name][rows] for name in names))


def pivot_scores(states: States, smoothed: States) -> dict[str, float]:
    """Pivot point of the filter beside that of the smoothed motion, where she turns."""
    rows = np.flatnonzero((states["time_s"] > SETTLE) & (np.abs(states["yaw_rate_rad_s"]) > TURNING))
    found, true = exact(motion(states, rows)), exact(Motion(*motion(smoothed, rows)[:2])).place
    use = np.isfinite(found.place) & np.isfinite(true)
    low, high, at = found.low[use], found.high[use], true[use]
    return {
        "rows": len(rows),
        "undefined_percent": float(100 * np.mean(np.isnan(found.place))),
        "median_m": float(np.median(found.place[use])),
        "p5_m": float(np.percentile(found.place[use], 5)),
        "p95_m": float(np.percentile(found.place[use], 95)),
        "median_half_width_m": float(np.median(high - low) / 2),
        "error_median_m": float(np.median(np.abs(found.place[use] - at))),
        "error_p95_m": float(np.percentile(np.abs(found.place[use] - at), 95)),
        "holds_smoothed_percent": float(100 * np.mean((low <= at) & (at <= high))),
    }


def starts(states: States, reference: Reference) -> np.ndarray:
    """Rows every STRIDE seconds at which she turns, as far as the filter knows then, and the reference covers the horizon."""
    time = states["time_s"]
    rows = np.unique(np.searchsorted(time, np.arange(SETTLE, time[-1] - HORIZON, STRIDE)))
    rows = rows[np.abs(states["yaw_rate_rad_s"][rows]) > TURNING]
    return rows[reference.known(time[rows], HORIZON)]


def prediction_scores(states: States, reference: Reference, rows: np.ndarray) -> dict[str, dict[str, list[float]]]:
    """Median and 95th percentile of position [m] and absolute heading error [deg] by method, at TIMES."""
    found = {}
    for predictor in baselines(states.vessel, HORIZON):
        path = replace(predictor, period=INNER, inner=INNER).predict_many(states, rows, ()).at(TIMES)
        errors = path_errors(path, reference.path(states["time_s"][rows], np.array(TIMES)))
        name = {"constant": "exact, constant u, v, r"}.get(predictor.name, predictor.name)
        found[name] = {
            f"{what}_{word}": np.percentile(values, share, axis=0).tolist()
            for what, values in (("position_m", errors.position), ("heading_deg", np.degrees(np.abs(errors.heading))))
            for word, share in (("median", 50), ("p95", 95))
        }
    return found


def prediction_lines(scores: dict[str, dict[str, dict[str, list[float]]]]) -> Iterator[str]:
    """Errors by filter and method."""
    yield "| states of | method | " + " | ".join(f"m at {t:g} s | deg at {t:g} s" for t in TIMES) + " |"
    yield "|---" * (2 + 2 * len(TIMES)) + "|"
    for name, methods in scores.items():
        for method, s in methods.items():
            cells = (
                f"{s[f'{what}_median'][k]:.2f} / {s[f'{what}_p95'][k]:.2f}"
                for k in range(len(TIMES))
                for what in ("position_m", "heading_deg")
            )
            yield f"| {name} | {method} | {' | '.join(cells)} |"


def draw(states: States, smoothed: States, file: Path) -> None:
    """The pivot point along the recording with its interval; hulls and dots are those of the smoothed motion. PNG."""
    time = smoothed["time_s"]
    rows = np.searchsorted(time, np.arange(SETTLE, time[-1], EVERY))
    names = ("time_s", "north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    track = Track(*(smoothed[name][rows] for name in names), exact(motion(smoothed, rows)).place)
    ways = {"filtered": exact(motion(states, rows))}
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary:
        pivot_figure(track, ways, smoothed.vessel, HULLS, "smoothed").savefig(temporary, dpi=120)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    options.add_argument("--out", type=Path, default=Path("runs/reproduce"))
    options.add_argument("--json", type=Path)
    given = options.parse_args()
    result: dict[str, Any] = {}
    for log in import_n2k_yacht([given.folder]):
        smoothed = smooth_log(log)
        filters = {"planar": filter_log(log), "3D-PV": filter_spatial(log)}
        _, roll = known(log, "roll_deg")
        say(False, f"\n{log.voyage}: roll {roll.min():.1f} to {roll.max():.1f} deg, deviation {roll.std():.2f} deg")
        say(False, "Does roll swing the antenna? Log-likelihood gained by height")
        for line in (*lever_lines(log), "", *filter_lines(filters, smoothed), ""):
            say(False, line)
        pivots = {name: pivot_scores(states, smoothed) for name, states in filters.items()}
        for name, score in pivots.items():
            told = ", ".join(f"{what} {value:.3g}" for what, value in score.items())
            say(False, f"pivot point where she turns, {name}: {told}")
        reference = Reference.of_states(smoothed)
        rows = starts(filters["planar"], reference)
        scores = {name: prediction_scores(states, reference, rows) for name, states in filters.items()}
        say(
            False,
            f"\n{len(rows)} predictions inside the turns, median / 95th percentile against the smoothed recording",
        )
        for line in prediction_lines(scores):
            say(False, line)
        path = given.out / f"yacht_pivot_{log.voyage}.png"
        draw(filters["planar"], smoothed, path)
        say(False, f"figure: {path}")
        result[log.voyage] = {"pivot": pivots, "predictions": scores, "windows": len(rows), "times_s": TIMES}
    say(False, REASONS)
    if given.json:
        with atomic(given.json) as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
