"""Paper VI: port and starboard turn of a small boat, 3D-PV and CAA, pivot point by a Gaussian process, predictions of 10 s.

    python training/reproduce/paper_6.py [--voyages 20] [--count 40] [--json FILE] [--report FILE.html]

Simulates data/scenarios/workboat8-port-turn.toml and -starboard-turn.toml (4 and 3 s straight, then hard over until 40 s; sensors
of the paper at 0.13 s, 1 m/s of current in directions drawn at random) and filters each voyage as the paper does
(paper_6_filters.py, its printed Q, R and factor) and with ours. Tables, published figures beside: NIS by the paper's
bounds and by the right ones; the pivot point in the circle; predictions from the paper's instants, in waves and without. `--count 100` fits
the processes to the paper's 10,000 samples (five minutes of one core, 3.4 GB); the default's 1,600 take seconds. `--report` writes a page.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from paper_6_filters import Estimates, paper_filter
from paper_6_tables import Table, nis_table, pivot_table, prediction_table

from aspnn.cli import guarded, say, watch
from aspnn.estimation.spatial import filter_spatial, solve_position_velocity
from aspnn.evaluation.errors import Errors, path_errors
from aspnn.evaluation.reference import Reference
from aspnn.frames import to_body
from aspnn.motion import Path as Track
from aspnn.motion import integrate
from aspnn.motion.algorithms import paper_vi_printed
from aspnn.motion.path import pivot_path
from aspnn.motion.pivot import Motion, PivotPoint, exact
from aspnn.motion.pivot_gpr import SUBSET, Angular, PivotGpr, Printed, enumerate_samples
from aspnn.prediction.kinematic import KinematicPredictor, baselines
from aspnn.records import States, atomic
from aspnn.schema import InputError
from aspnn.simulation import read_scenario, simulate_scenario
from aspnn.vessel import Vessel, load_vessel

ROOT = Path(__file__).parents[2]
TABLE_4 = ROOT / "tests/reference/paper_6_table_4.csv"
TEXT = ROOT / "tests/reference/paper_6_text.csv"
TURNS = {"PT": "port", "SBT": "starboard"}
STARTS = {"PT": (5.0, 7.0, 15.0, 30.0), "SBT": (4.0, 6.0, 20.0, 30.0)}  # s, of the paper's predictions (5.3)
CIRCLE = {"PT": 10.0, "SBT": 9.0}  # s, 6 s after the order: from there the turn counts as circular (assumed)
PERIOD, STEPS = 0.13, 77  # s; of a prediction: 10.01 s
BOUNDS = (0.2158, 9.3484)  # of the paper, for all NIS (E32)
READING = "GPR, thesis"  # of the two readings of infinity (E38) the one whose intervals are nearer to the published
SEED = 6
REASONS = """
Where these differ from the paper, and why:
- The boat is simulated, the paper's was not: speed, sea, the current's direction and the helm are ours, and over 20 voyages each figure has
  a spread where the paper has one voyage. It measures predictions against its own filter, these are against the true path.
- CAA: its quarter below the bounds is the bounds' doing. They are those of 3 degrees of freedom, CAA has 2 (E32), and R allows 2.1 deg/s
  for a gyro of 0.01 deg/s (E35), so of two values one counts. With the gyro's own R 32 and 47 % lie above: Q is far too small (E34),
  and R hides it, at the cost of a yaw rate 1.2 to 1.5 deg/s off.
- 3D-PV: as many inside as published, the others on the other side. R has 0.1058 m for the easting, our sensors 0.15 m in both axes; with
  that 95 % are inside. A factor of 1.015 on Q moves no share by more than 0.1 % (E33).
- The pivot point needs no process: -v / r is what it learns. As printed it takes the pole at r = 0 for noise: 39 m of interval with
  10,000 samples where infinity is 1000 m, 11 m where it is left out (E38); the published widths lie below both. On the circle it
  is narrow and misses, since it counts no error of v and r: -v / r with theirs is narrower still and holds.
- Over ground the pivot point swings once a circle, as in the paper: v holds the current across the hull. Holding u, v and r carries the
  current round with the hull. Without waves that is all there is in the steady circle: 9 to 10 m, the size of the published 8.7 m,
  and 0.1 to 0.5 m with the true current taken out and put back (1.6 m at 15 s, where she still slows down).
- In waves the yaw rate swings by 1 to 2 deg/s about the circle's, and a start takes what it finds for 10 s: that is the heading error.
  The accelerations that the kinematic methods hold as well are the waves' almost entirely.
- Algorithm 2, printed or corrected, with the process or without: a metre or two beside what comes of holding u, v and r.
- Right after the order no method can know the turn to come without the rudder's plan; two seconds later errors are a third, as the paper
  says.
"""


class Voyage(NamedTuple):
    """A voyage of one turn, filtered three ways; the true motion at the same epochs."""

    truth: Reference
    current: np.ndarray  # north, east (n, 2) [m/s]
    tilt: float  # rad, largest roll or pitch
    paper: Estimates
    position_velocity: States
    error_state: States

    @property
    def time(self) -> np.ndarray:
        """Epochs (n) [s]."""
        return self.paper.time


class Predicted(NamedTuple):
    """Predictions of a turn from one of the paper's instants: by method the paths and errors (voyages, steps), and the true paths."""

    start: float
    true: Track
    paths: dict[str, Track]
    errors: dict[str, Errors]


def sailed(turn: str, count: int, waves: bool = True) -> list[Voyage]:
    """The first voyages of a turn, as the scenario is or without its waves."""
    scenario = read_scenario(ROOT / f"data/scenarios/workboat8-{TURNS[turn]}-turn.toml")
    if not waves:
        calm = scenario.environment.model_copy(update={"waves": None})
        scenario = scenario.model_copy(update={"environment": calm, "name": f"{scenario.name}, calm"})
    found = []
    for log, truth in watch(simulate_scenario(scenario, count), scenario.name, count):
        tilt = float(np.abs(truth[["roll_rad", "pitch_rad"]].to_numpy()).max())
        current = truth[["current_north_m_s", "current_east_m_s"]].to_numpy()
        ours = filter_spatial(log, solve_position_velocity), filter_spatial(log)
        found.append(Voyage(Reference.of_truth(truth), current, tilt, paper_filter(log), *ours))
    return found


def nis(voyage: Voyage) -> dict[str, dict[str, np.ndarray]]:
    """Normalised innovations squared (n) by filter and model; ours take heading and yaw rate one after the other, which adds up."""
    ours = {"ours, 3D-PV": voyage.position_velocity, "ours, error-state": voyage.error_state}
    return {"as printed": {"CAA": voyage.paper.nis_turning, "3D-PV": voyage.paper.nis_moving}} | {
        name: {"CAA": s["nis_heading"] + s["nis_yaw_rate"], "3D-PV": s["nis_gnss"]} for name, s in ours.items()
    }


def processes(vessel: Vessel, count: int) -> dict[str, PivotGpr]:
    """The Gaussian process as Paper VI and as the thesis print it, and on the circle, each on count^2 samples."""
    stations = vessel.sway_stations
    samples, subset = enumerate_samples(*stations, SEED, count), min(SUBSET, count**2 // 4)
    forms = {"GPR, Paper VI": Printed(), "GPR, thesis": Printed(infinity=None), "GPR, circle": Angular(*stations)}
    return {name: PivotGpr.fit(form, samples, SEED, subset) for name, form in forms.items()}


def measured(states: States, rows) -> Motion:
    """The motion of midship at some epochs with the deviations that the filter tells."""
    names = ("sway_m_s", "yaw_rate_rad_s", "sway_m_s_sd", "yaw_rate_rad_s_sd")
    return Motion(*(states[name][rows] for name in names))


def pivots(voyage: Voyage, fitted: dict[str, PivotGpr], rows: np.ndarray) -> dict[str, PivotPoint]:
    """The pivot point at some epochs: by the processes as in the paper, which counts no error of v and r, and by -v / r with it."""
    v, r = voyage.paper.sway[rows], voyage.paper.yaw_rate[rows]
    found = {name: gpr(Motion(v, r)) for name, gpr in fitted.items()}
    return found | {"exact, ours": exact(measured(voyage.error_state, rows))}


def paper_paths(e: Estimates, row: int, gpr: PivotGpr) -> dict[str, Track]:
    """Predictions of the paper's kind from an epoch of its filter: constant u, v, r, by algorithm 2 as printed and corrected about
    the process's pivot point L (v = -L r), and by the exact step with v.
    """
    pose = np.array([e.north[row], e.east[row], e.heading[row]])
    u, v, r = (np.full(STEPS, values[row]) for values in (e.surge, e.sway, e.yaw_rate))
    about = -float(gpr.mean(v[:1], r[:1])[0]) * r
    return {
        "VI printed": paper_vi_printed(pose, u, about, r, PERIOD),
        "VI corrected": pivot_path(pose, u, about, r, PERIOD),
        "VI exact": integrate(pose, np.stack([u, v, r], axis=-1), PERIOD),
    }


def in_current(voyage: Voyage, row: int) -> Track:
    """The exact step through the water, its velocities those of the error-state filter less the true current, and that current."""
    names = ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    north, east, psi, u, v, r = (float(voyage.error_state[name][row]) for name in names)
    ahead, athwart = to_body(*voyage.current[row], psi)
    path = integrate(np.array([north, east, psi]), np.tile([u - ahead, v - athwart, r], (STEPS, 1)), PERIOD)
    carried = voyage.current[row][:, None] * path.time
    return replace(path, north=path.north + carried[0], east=path.east + carried[1])


def our_methods(vessel: Vessel) -> Iterator[tuple[str, KinematicPredictor]]:
    """The baselines on the states of the error-state filter; the one with constant velocities is the exact step."""
    for predictor in baselines(vessel, PERIOD * STEPS):
        name = {"constant": "exact"}.get(predictor.name, predictor.name)
        yield name, replace(predictor, period=PERIOD, inner=PERIOD)


def stacked(paths: list[Track]) -> Track:
    """Paths of one horizon as a batch."""
    names = ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot")
    return Track(paths[0].time, *(np.stack([getattr(path, name) for path in paths]) for name in names))


def predicted(turn: str, voyages: list[Voyage], gpr: PivotGpr, vessel: Vessel) -> list[Predicted]:
    """Predictions of all voyages from each of the paper's instants, at the last epoch not after it."""
    steps = np.arange(STEPS + 1) * PERIOD
    found = []
    for start in STARTS[turn]:
        paths: dict[str, list[Track]] = {}
        true = []
        for voyage in voyages:
            row = int(np.searchsorted(voyage.time, start + 1e-6)) - 1
            own = paper_paths(voyage.paper, row, gpr)
            own |= {name: p.predict_many(voyage.error_state, np.array([row]), ())[0] for name, p in our_methods(vessel)}
            own["true current"] = in_current(voyage, row)
            for name, path in own.items():
                paths.setdefault(name, []).append(path)
            true.append(voyage.truth.path(voyage.time[row : row + 1], steps)[0])
        batch, reference = {name: stacked(some) for name, some in paths.items()}, stacked(true)
        found.append(Predicted(start, reference, batch, {name: path_errors(p, reference) for name, p in batch.items()}))
    return found


def circling(turn: str, voyage: Voyage) -> np.ndarray:
    """Epochs of the circular part, every half second."""
    return np.flatnonzero(voyage.time >= CIRCLE[turn])[::4]


def true_pivot(voyage: Voyage, rows: np.ndarray) -> np.ndarray:
    """-v / r of the true motion over ground at some epochs."""
    return exact(Motion(voyage.truth.sway[rows], voyage.truth.yaw_rate[rows])).place


def rms(voyages: list[Voyage], of: Callable[[Voyage], Any]) -> dict[str, float]:
    """Root mean square errors of surge, sway [m/s] and yaw rate [deg/s] from 2 s on, of an estimate of each voyage."""
    squares = []
    for voyage in voyages:
        use, true, told = voyage.time >= 2.0, voyage.truth, of(voyage)
        pairs = ((told[0], true.surge), (told[1], true.sway), (np.degrees(told[2]), np.degrees(true.yaw_rate)))
        squares.append([np.mean((estimate - at)[use] ** 2) for estimate, at in pairs])
    names = ("surge_m_s", "sway_m_s", "yaw_rate_deg_s")
    return dict(zip(names, map(float, np.sqrt(np.mean(squares, axis=0))), strict=True))


def rms_table(voyages: dict[str, list[Voyage]]) -> Table:
    """What the three filters make of the motion."""

    def columns(states: States):
        return [states[name] for name in ("surge_m_s", "sway_m_s", "yaw_rate_rad_s")]

    ways: dict[str, Callable[[Voyage], Any]] = {
        "as printed": lambda v: v.paper[4:7],
        "ours, 3D-PV": lambda v: columns(v.position_velocity),
        "ours, error-state": lambda v: columns(v.error_state),
    }
    rows, values = [], {}
    for turn, some in voyages.items():
        for name, way in ways.items():
            found = values[f"{turn}, {name}"] = rms(some, way)
            rows.append([turn, name, *(f"{x:.3f}" for x in found.values())])
    heads = ["turn", "filter", "surge m/s", "sway m/s", "yaw rate deg/s"]
    return Table("Errors of the estimates", "Root mean square from 2 s on, all voyages.", heads, rows, values)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--voyages", type=int, default=20)
    options.add_argument("--count", type=int, default=40, help="enumerated sways of each station; the paper's are 100")
    options.add_argument("--json", type=Path)
    options.add_argument("--report", type=Path)
    given = options.parse_args()
    if given.voyages < 1:
        raise InputError(f"--voyages {given.voyages}: give at least 1")
    table_4 = pd.read_csv(TABLE_4, comment="#")
    text = pd.read_csv(TEXT, comment="#", index_col="quantity")["value"]
    vessel = load_vessel("workboat8")
    began = time.perf_counter()
    fitted = processes(vessel, given.count)
    fit_s = time.perf_counter() - began
    voyages = {turn: sailed(turn, given.voyages) for turn in TURNS}
    places = {turn: [pivots(v, fitted, circling(turn, v)) for v in some] for turn, some in voyages.items()}
    true = {turn: [true_pivot(v, circling(turn, v)) for v in some] for turn, some in voyages.items()}
    runs = {turn: predicted(turn, some, fitted[READING], vessel) for turn, some in voyages.items()}
    calm = {turn: sailed(turn, given.voyages, waves=False) for turn in TURNS}
    still = {turn: predicted(turn, some, fitted[READING], vessel) for turn, some in calm.items()}
    tables = [
        nis_table({turn: [nis(v) for v in some] for turn, some in voyages.items()}, table_4, BOUNDS),
        rms_table(voyages),
        pivot_table(places, true, text),
        prediction_table(runs, text, "Predictions of 10 s"),
        prediction_table(still, text, "Predictions of 10 s without waves"),
    ]
    for table in tables:
        say(False, "\n".join(table.lines()) + "\n")
    tilt = {turn: np.degrees(max(v.tilt for v in some)) for turn, some in voyages.items()}
    say(False, "largest roll or pitch: " + ", ".join(f"{turn} {value:.1f} deg" for turn, value in tilt.items()))
    say(False, f"three processes on {given.count**2} samples each: {fit_s:.0f} s")
    say(False, REASONS)
    if given.report:
        from paper_6_figures import thinned, write_page

        shown = {}
        for turn, (voyage, *_) in voyages.items():
            track, rows = thinned(voyage)
            ways = pivots(voyage, fitted, rows)
            ways = {"exact": ways["exact, ours"], "process": ways[READING]}
            shown[turn] = voyage, nis(voyage), track, ways
        write_page(given.report, tables, shown, runs, vessel, BOUNDS, REASONS)
        say(False, f"{given.report} written")
    if given.json:
        result: dict[str, Any] = {table.title: table.values for table in tables}
        result |= {"voyages": given.voyages, "samples": given.count**2, "fit_s": fit_s}
        with atomic(given.json) as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
