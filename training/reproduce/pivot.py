"""The pivot point four ways: accuracy and cost of -v / r, region map, Gaussian process and two stations.

    python training/reproduce/pivot.py [--voyages 3] [--count 100] [--out runs/reproduce] [--json FILE]

Motions are those of the 8 m boat in data/scenarios/workboat8-sea.toml, every second, and the middles between the enumerated
sways of Paper VI. `exact interval` compares a way with -v / r of the same motion; `true motion` gives every way the true
motion with normal errors of the deviations below and compares it with the true pivot point. The Gaussian processes are
fitted to --count^2 samples, each in a process of its own, whose time and peak memory are told. A figure shows the pivot
point along the first voyage, on the hull.
"""

import argparse
import json
import multiprocessing
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pivot_figures import along_figure

from aspnn.cli import guarded, say
from aspnn.motion import Path as Track
from aspnn.motion import two_station_motion
from aspnn.motion.pivot import CERTAINTY, Motion, PivotPoint, RegionMap, exact
from aspnn.motion.pivot_gpr import Angular, Form, PivotGpr, Printed, enumerate_samples, sways
from aspnn.records import atomic
from aspnn.schema import InputError
from aspnn.simulation import read_scenario, simulate_scenario
from aspnn.vessel import Vessel, load_vessel

ROOT = Path(__file__).parents[2]
SEED = 6
SWAY_SD, YAW_SD = 0.05, np.radians(0.05)  # m/s, at midship and at each station; rad/s
MIDDLES = 9  # every so many of the enumeration's middles are tried
EVERY, HULLS = 0.5, 2.0  # s of the figure: a step, between hulls
STRAIGHT, WINDOW = 6.0, 13.0  # s of the figure: its straight part, what is shown on each side of that
HEADS = ("median error", "p95 error", "covered %", "median width", "unbounded %", "undefined %")
COSTS = ("fit_s", "means_10000_s", "intervals_1000_s", "peak_mib")
REASONS = """
- The place -v / r has a pole at r = 0 that runs through all samples. Over (v, r) no one length scale fits both the pole and the rest, so
  what the process cannot follow it calls noise: as printed its interval covers by its width. One sign for infinity makes it worse.
- On the circle the pole is gone: the same process with as many samples is sure to little more than the 0.1 m of noise that the
  paper adds, and no sample has to be cut. With 10,000 samples its interval without that noise is 0.1 m wide and holds its share.
- All of it takes 800 MB to be what -v / r is at once, with Fieller's interval that holds the true place in 95 of 100 cases.
- The region map's interval is its region: sure, and an eighth of the length wide or more. Two sways of the same quality tell the
  yaw rate worse than a gyro does: wider intervals, and more often undefined.
"""


class Learnt(NamedTuple):
    """What a process of its own brings back of a fit: answers by motions, seconds, MiB and hyperparameters."""

    found: dict[str, PivotPoint]
    inner: dict[str, PivotPoint]  # the same with the interval of the mean alone
    fit_s: float
    means_s: float
    interval_s: float  # of 1,000 intervals
    peak_mib: float
    fitted: dict[str, Any]


def learnt(form: Form, stations: tuple[float, float], count: int, motions: dict[str, Motion]) -> Learnt:
    """Fit a process and ask it all motions."""
    samples, began = enumerate_samples(*stations, SEED, count), time.perf_counter()
    gpr = PivotGpr.fit(form, samples, SEED)
    fit_s = time.perf_counter() - began
    many, began = next(iter(motions.values())), time.perf_counter()
    gpr.mean(np.resize(many.sway, 10_000), np.resize(many.yaw_rate, 10_000))
    means_s = time.perf_counter() - began
    began = time.perf_counter()
    gpr(Motion(np.resize(many.sway, 1000), np.resize(many.yaw_rate, 1000)))
    interval_s = time.perf_counter() - began
    found = {name: gpr(motion) for name, motion in motions.items()}
    mean_only = replace(gpr, of_mean=True)
    inner = {name: mean_only(motions[name]) for name in ("boat", "middles")}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    fitted = {"signal": gpr.signal, "noise": gpr.noise, "lengths": gpr.lengths}
    return Learnt(found, inner, fit_s, means_s, interval_s, peak, fitted)


def score(found: PivotPoint, place: np.ndarray) -> dict[str, float]:
    """Errors [m], share of intervals [%] that hold the place, their median width [m], shares without ends and undefined."""
    use = ~np.isnan(found.place) & np.isfinite(place)
    at, low, high, place = found.place[use], found.low[use], found.high[use], place[use]
    error, slack = np.abs(at - place), 1e-9 * (1 + np.abs(place))
    inside, width = (low - slack <= place) & (place <= high + slack), high - low
    shares = np.array([inside.mean(), np.mean(np.isinf(width)), np.mean(np.isnan(found.place))]) * 100
    values = np.median(error), np.percentile(error, 95), shares[0], np.median(width), *shares[1:]
    return dict(zip(HEADS, map(float, values), strict=True))


def rows(title: str, count: int, table: dict[str, dict[str, float]]) -> None:
    """Print a table of scores."""
    say(False, f"\n{title}: {count} motions; m")
    say(False, f"| way | {' | '.join(HEADS)} |\n|---|" + "---|" * len(HEADS))
    for name, s in table.items():
        say(False, f"| {name} | " + " | ".join(f"{s[head]:.{1 if '%' in head else 3}f}" for head in HEADS) + " |")


def figure(track: Track, vessel: Vessel, measured: Motion, path: Path) -> None:
    """The pivot point by -v / r and by the region map around the straightest seconds, where it comes to be undefined."""
    slow = np.convolve(np.isnan(exact(measured).place), np.ones(round(STRAIGHT / EVERY)), "same")
    inside = (track.time > WINDOW) & (track.time < track.time[-1] - WINDOW)
    middle = track.time[np.argmax(np.where(inside, slow, -1.0))]
    use = np.abs(track.time - middle) <= WINDOW
    fields = (track.north, track.east, track.heading, track.surge, track.sway, track.yaw_rate, track.pivot)
    shown = Track(track.time[use] - middle + WINDOW, *(values[use] for values in fields))
    part = Motion(measured.sway[use], measured.yaw_rate[use], SWAY_SD, YAW_SD)
    ways = {"exact": exact(part), "region map": RegionMap(vessel.length)(part)}
    along_figure(shown, ways, vessel, path, round(HULLS / EVERY))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--voyages", type=int, default=3)
    options.add_argument("--count", type=int, default=100, help="enumerated sways of each station")
    options.add_argument("--out", type=Path, default=Path("runs/reproduce"))
    options.add_argument("--json", type=Path)
    given = options.parse_args()
    if given.voyages < 1 or given.count < 4 or given.count % 2:
        raise InputError("--voyages must be at least 1, --count even and at least 4")
    vessel, draw = load_vessel("workboat8"), np.random.default_rng(SEED)
    stations = vessel.sway_stations
    scenario = read_scenario(ROOT / "data/scenarios/workboat8-sea.toml")
    columns = ("time_s", "north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    sailed = [truth[list(columns)].to_numpy().T for _, truth in simulate_scenario(scenario, given.voyages)]
    tracks = [Track(*w, exact(Motion(w[5], w[6], 0.0, YAW_SD)).place) for w in (truth[:, ::5] for truth in sailed)]
    v, r = (np.concatenate([getattr(track, name)[::2] for track in tracks]) for name in ("sway", "yaw_rate"))
    bow, stern = (side.ravel() for side in np.meshgrid(*[(sways()[1:] + sways()[:-1]) / 2] * 2, indexing="ij"))
    between = two_station_motion(bow[::MIDDLES], stern[::MIDDLES], *stations)
    measured = Motion(
        v + SWAY_SD * draw.standard_normal(len(v)), r + YAW_SD * draw.standard_normal(len(v)), SWAY_SD, YAW_SD
    )
    beside = [v + r * x + SWAY_SD * draw.standard_normal(len(v)) for x in stations]
    two = Motion.of_stations(*beside, SWAY_SD, SWAY_SD, *stations)

    def sure(sway, yaw_rate):  # motions without errors, those too slow to have a pivot point left out
        use = np.abs(yaw_rate) > CERTAINTY * YAW_SD
        return Motion(sway[use], yaw_rate[use])

    motions = {"boat": sure(v, r), "middles": sure(*between), "measured": measured}
    forms = {"Paper VI, 1000 m": Printed(), "Paper VI, left out": Printed(infinity=None), "circle": Angular(*stations)}
    fits = {}
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), max_tasks_per_child=1) as pool:
        for name, form in forms.items():
            fits[f"GPR, {name}"] = pool.submit(learnt, form, stations, given.count, motions).result()
    places = {
        "boat": exact(motions["boat"]).place,
        "middles": exact(motions["middles"]).place,
        "measured": exact(Motion(v, r)).place,
    }
    result: dict[str, Any] = {
        "samples": given.count**2,
        "sway_sd_m_s": SWAY_SD,
        "yaw_rate_sd_deg_s": float(np.degrees(YAW_SD)),
    }
    for name, title in (
        ("boat", "exact interval, the boat's motions"),
        ("middles", "exact interval, between the samples"),
    ):
        table = {"region map": score(RegionMap(vessel.length)(motions[name]), places[name])}
        for way, fit in fits.items():
            table[way] = score(fit.found[name], places[name])
            table[f"{way}, of the mean"] = score(fit.inner[name], places[name])
        rows(title, len(places[name]), table)
        result[name] = table
    ways = {"exact": exact(measured), "region map": RegionMap(vessel.length)(measured), "two stations": exact(two)}
    table = {way: score(found, places["measured"]) for way, found in ways.items()}
    table |= {way: score(fit.found["measured"], places["measured"]) for way, fit in fits.items()}
    rows("true motion with errors of 0.05 m/s and 0.05 deg/s", len(v), table)
    result["measured"] = table
    cost = {way: dict(zip(COSTS, fit[2:6], strict=True)) for way, fit in fits.items()}
    many = Motion(*np.resize(measured[:2], (2, 10_000)), SWAY_SD, YAW_SD)
    for way, call in (("exact", exact), ("region map", RegionMap(vessel.length))):
        began = time.perf_counter()
        call(many)
        cost[way] = {"places_and_intervals_10000_s": time.perf_counter() - began}
    say(False, "\nCost, one thread")
    for way, told in cost.items():
        say(False, f"{way}: " + ", ".join(f"{what} {value:.3g}" for what, value in told.items()))
    for way, fit in fits.items():
        say(False, f"{way}: hyperparameters {fit.fitted}")
    result |= {"cost": cost, "hyperparameters": {way: fit.fitted for way, fit in fits.items()}}
    path, track = given.out / "pivot.png", tracks[0]
    errors = draw.standard_normal((2, len(track.time)))
    noisy = Motion(track.sway + SWAY_SD * errors[0], track.yaw_rate + YAW_SD * errors[1], SWAY_SD, YAW_SD)
    figure(track, vessel, noisy, path)
    say(False, f"{REASONS}\nfigure: {path}")
    if given.json:
        with atomic(given.json) as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
