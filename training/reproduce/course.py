"""Speed and course from positions alone: the course filter on simulated voyages, in outages, in both its forms, and on recordings.

    python training/reproduce/course.py [--shared ../shared/data] [--ships 8] [--json FILE]

The Mariner follows the waypoints of paper 000, her line-of-sight helm steering by the filter's own course and speed, with the paper's
Gauss-Markov positions (4.7 m, 1100 s; E60) at 10 Hz, alone and with 1 m of white noise, by the model of the vessel's size and by the
paper's constants. Then outages of 60 s, the geodetic form beside the grid's, what densities each of four vessels alone would have by
likelihood, and the recordings of `course_recordings` where their folder is there.
"""

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from course_recordings import lines as recording_lines
from scipy.optimize import minimize

from aspnn.angles import wrap
from aspnn.cli import guarded, say
from aspnn.estimation import course_model
from aspnn.estimation.course import CourseModel, CourseTracker
from aspnn.estimation.course_engine import GATE
from aspnn.estimation.course_run import problem_of, run
from aspnn.estimation.lag import lag
from aspnn.frames import Zone, convergence, to_geodetic
from aspnn.guidance.autopilot import CourseAutopilot, ReferenceFilter, pole_placement
from aspnn.guidance.los import LineOfSight
from aspnn.guidance.pilot import Loop, PathHelm, TrackedNavigation
from aspnn.guidance.route import Follower, Route
from aspnn.records import atomic
from aspnn.simulation.scenario import read_scenario, simulate_scenario
from aspnn.simulation.sensing.errors import gauss_markov
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import Voyage, simulate
from aspnn.vessel import Vessel, load_vessel

ROOT = Path(__file__).parents[2]
WAYPOINTS = ((0, 0), (2000, 0), (5000, 5000), (3000, 8000), (6000, 12000), (10000, 12000))  # m, paper 000, 4
NOMOTO, NATURAL, LOW_PASS, LOOKAHEAD, SWITCH = (0.185, 107.3), 0.05, 40.0, 800.0, 50.0  # paper 000, 4; low-pass: E63
WANDER, TIME = 4.7, 1100.0  # m and s of the positions' Gauss-Markov noise
SETTLE = 60.0  # s that the filter has to converge
OUTAGE = 60.0  # s
ZONE, PLACE = Zone(33), (7740000.0, 730000.0)  # near Tromso, out of the zone: convergence 3.7 degrees
TUNED = ("cargo90-train", "mariner-train", "kvlcc2_full-train", "workboat8-train")
DT = 0.1


@dataclass(frozen=True)
class Errors:
    """Rms errors of one way to filter one noise: course [deg], speed [m/s], course rate [deg/s], and how late (s) the first two are."""

    noise: str
    model: str
    course: float
    speed: float
    rate: float
    course_late: float
    speed_late: float


@dataclass(frozen=True)
class Dead:
    """Errors at the end of outages: place [m] as median and worst, and with speed and course kept as they were, course [deg], speed."""

    outages: int
    place: float
    worst: float
    kept: float
    course: float
    speed: float
    deviations: float  # rms of the place's error over its own standard deviation


def paper_model() -> CourseModel:
    """The constants of paper 000, 4: Q_d = 1e-5 I at 0.1 s, Singer constants 1e-5 and 0.2."""
    return CourseModel.discrete(1e-5, 1e-5, 0.1, 1e-5, 0.2)


def sail(ships: int, seed: int, white: float) -> tuple[list[Voyage], np.ndarray]:
    """Voyages of the Mariner round the waypoints, steered by the filter, and their fixes (ships, n, 2)."""
    vessel = load_vessel("mariner")
    ship = Ship.of(vessel)
    points = np.array(WAYPOINTS, float)
    route = Route(points)
    length = float(np.abs(np.diff(points @ [1, 1j])).sum())
    duration = round(1.05 * length / vessel.service_speed)
    steps = round(duration / DT) + 1
    rng = np.random.default_rng(seed)
    offset = gauss_markov(rng, (2 * ships, steps), DT, WANDER, TIME).reshape(ships, 2, steps).transpose(0, 2, 1)
    offset = offset + white * rng.standard_normal((ships, steps, 2))
    fixes = np.full((ships, steps, 2), np.nan)

    def receiver(time: float, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = round(time / DT)
        fixes[:, k] = state[:, :2] + offset[:, k]
        return fixes[:, k, 0], fixes[:, k, 1]

    def make(count: int) -> Loop:
        tracker = CourseTracker(CourseModel.of(vessel), vessel.noise.position, count, DT)
        law = LineOfSight(LOOKAHEAD)
        K, T = NOMOTO
        pilot = CourseAutopilot(pole_placement(K, T, NATURAL), K, T, ship.rudder.most, count)
        navigation = TrackedNavigation(tracker, receiver)
        return Loop(navigation, Follower(route, SWITCH, count), law, law.rate, ReferenceFilter(LOW_PASS, count), pilot)

    start = np.repeat(np.atleast_2d(ship.start(0.0, 0.0, 0.0, vessel.service_speed)), ships, axis=0)
    return simulate(ship, PathHelm(make), start, duration, dt=DT), fixes


def truth(v: Voyage) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speed, course (continuous) and course rate of a voyage over ground."""
    course = np.unwrap(v.heading + np.arctan2(v.sway, v.surge))
    return np.hypot(v.surge, v.sway), course, np.gradient(course, v.time)


def errors(
    voyages: list[Voyage], fixes: np.ndarray, model: CourseModel, sd: float, gate: float, noise: str, name: str
) -> Errors:
    """How a model fares on the fixes of all voyages, after SETTLE; the papers have no gate."""
    off, late = [], []
    for v, z in zip(voyages, fixes, strict=True):
        known = np.isfinite(z[:, 0])
        time, mean = v.time[known], run(replace(problem_of(v.time[known], z[known], sd, model), gate=gate)).mean
        true = [x[known] for x in truth(v)]
        use = time > time[0] + SETTLE
        wrong = mean[:, [3, 2, 4]] - np.column_stack([true[1], true[0], true[2]])
        wrong[:, 0] = wrap(wrong[:, 0])
        off.append(wrong[use])
        late.append([lag(time[use], mean[use, k], time, true[j])[0] for k, j in ((3, 1), (2, 0))])
    course, speed, rate = np.sqrt(np.mean(np.concatenate(off) ** 2, axis=0))
    return Errors(
        noise, name, math.degrees(course), float(speed), math.degrees(rate), *np.median(late, axis=0).tolist()
    )


def outages(voyages: list[Voyage], fixes: np.ndarray, vessel: Vessel) -> Dead:
    """Outages of OUTAGE seconds every 5 minutes of each voyage, and the errors at the end of each."""
    model, sd, rows = CourseModel.of(vessel), vessel.noise.position, []
    for v, z in zip(voyages, fixes, strict=True):
        z = z.copy()
        begins = np.arange(200.0, v.time[-1] - OUTAGE - 20, 300.0)
        for begin in begins:
            z[(v.time >= begin) & (v.time < begin + OUTAGE)] = np.nan
        r = run(problem_of(v.time, z, sd, model))
        speed, course, _ = truth(v)
        place = np.column_stack([v.north, v.east])
        for begin in begins:
            a, b = (int(np.searchsorted(v.time, t - 1e-6)) - 1 for t in (begin, begin + OUTAGE))
            drift = r.mean[a, :2] - place[a]  # the receiver's wander, which is not the outage's
            kept = r.mean[a, 2] * OUTAGE * np.array([np.cos(r.mean[a, 3]), np.sin(r.mean[a, 3])]) + place[a]
            away = r.mean[b, :2] - drift - place[b]
            sure = math.sqrt(np.trace(r.covariance[b, :2, :2]))
            turned = float(wrap(r.mean[b, 3] - course[b]))
            rows.append(
                [np.hypot(*away), np.hypot(*(kept - place[b])), turned, r.mean[b, 2] - speed[b], np.hypot(*away) / sure]
            )
    away, kept, turned, slower, ratio = np.array(rows).T
    rms = [float(np.sqrt(np.mean(x**2))) for x in (turned, slower, ratio)]
    return Dead(
        len(away), float(np.median(away)), float(away.max()), float(np.median(kept)), math.degrees(rms[0]), *rms[1:]
    )


def forms(voyage: Voyage, fixes: np.ndarray, vessel: Vessel) -> tuple[float, float]:
    """Largest difference [deg] of the course by latitude and longitude from that on the grid and its convergence; speed [m/s]."""
    model, sd = CourseModel.of(vessel), vessel.noise.position
    known = np.isfinite(fixes[:, 0])
    time, grid = voyage.time[known], fixes[known] + np.array(PLACE)
    place = np.column_stack(to_geodetic(grid[:, 0], grid[:, 1], ZONE))
    on_grid, geodetic = run(problem_of(time, grid, sd, model)), run(problem_of(time, place, sd, model, geodetic=True))
    use = time > time[0] + SETTLE
    at = to_geodetic(on_grid.mean[use, 0], on_grid.mean[use, 1], ZONE)
    turned = wrap(geodetic.mean[use, 3] - on_grid.mean[use, 3] - convergence(*at, ZONE))
    return float(np.degrees(np.abs(turned).max())), float(np.abs(geodetic.mean - on_grid.mean)[use, 2].max())


def shares() -> Iterator[str]:
    """The shares of `course_model` that each vessel's random orders would have by likelihood: white noise of its own, fixes at 1 Hz."""
    yield "| vessel | speed share | turn share | turn decay | likelihood lost per fix by the common ones |"
    yield "|---|---|---|---|---|"
    common = np.log([course_model.SPEED_SHARE, course_model.TURN_SHARE, course_model.TURN_DECAY])
    for name in TUNED:
        scenario = read_scenario(ROOT / f"data/scenarios/{name}.toml")
        scenario = scenario.model_copy(update={"duration_s": min(scenario.duration_s, 1500.0)})
        rng, series = np.random.default_rng(0), []
        for log, true in simulate_scenario(scenario, 3, seed=777):
            vessel, time = log.vessel, true["time_s"].to_numpy()
            every = slice(None, None, max(1, round(1.0 / (time[1] - time[0]))))
            place = true[["north_m", "east_m"]].to_numpy()[every]
            series.append((time[every], place + vessel.noise.position * rng.standard_normal(place.shape)))

        def lost(logs: np.ndarray, vessel=vessel, series=series) -> float:
            speed, turn, decay = np.exp(logs)
            V, pace = vessel.service_speed, vessel.service_speed / vessel.length
            model = CourseModel(speed * V**2 * pace, turn * pace**3, speed * pace / 2, decay * pace)
            found = [run(problem_of(*s, vessel.noise.position, model)) for s in series]
            return -sum(r.log_likelihood for r in found) / sum(len(r.mean) for r in found)

        best = minimize(lost, common, method="Nelder-Mead", options={"maxiter": 80, "xatol": 0.1, "fatol": 1e-4})
        cells = " | ".join(f"{x:.1g}" for x in np.exp(best.x))
        yield f"| {vessel.name} | {cells} | {lost(common) - best.fun:.3f} |"


def main() -> None:
    """Sail, filter, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared/data", help="folder of the recordings")
    parser.add_argument("--ships", type=int, default=8, help="ships, each with noise of its own")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    given = parser.parse_args()
    vessel = load_vessel("mariner")
    found: list[Errors] = []
    for noise, white in ((f"Gauss-Markov {WANDER:g} m", 0.0), (f"Gauss-Markov {WANDER:g} m and white 1 m", 1.0)):
        voyages, fixes = sail(given.ships, 20 + round(white), white)
        models = (
            ("vessel's", CourseModel.of(vessel), vessel.noise.position, GATE),
            ("paper 000's constants, no gate", paper_model(), math.sqrt(0.1), math.inf),
        )
        found += [errors(voyages, fixes, model, sd, gate, noise, name) for name, model, sd, gate in models]
        if not white:
            dead, alike = outages(voyages, fixes, vessel), forms(voyages[0], fixes[0], vessel)
    say(
        False,
        f"Mariner round the waypoints of paper 000, {given.ships} ships steered by the filter, 10 Hz, after {SETTLE:g} s",
    )
    say(
        False,
        "\n| noise | model | course (deg rms) | speed (m/s rms) | course rate (deg/s rms) | course late (s) | speed late (s) |",
    )
    say(False, "|---|---|---|---|---|---|---|")
    for e in found:
        say(
            False,
            f"| {e.noise} | {e.model} | {e.course:.2f} | {e.speed:.3f} | {e.rate:.3f} | {e.course_late:.1f} | {e.speed_late:.1f} |",
        )
    say(
        False,
        f"\n{dead.outages} outages of {OUTAGE:g} s: place {dead.place:.0f} m off in the median and {dead.worst:.0f} m at worst ({dead.kept:.0f} m "
        f"by keeping speed and course), {dead.deviations:.2f} of its own deviations (rms); course {dead.course:.1f} deg, speed "
        f"{dead.speed:.2f} m/s rms",
    )
    say(
        False,
        f"latitude and longitude beside the grid: course within {alike[0]:.4f} deg, speed within {alike[1]:.4f} m/s\n",
    )
    for line in shares():
        say(False, line)
    say(False, "")
    for line in recording_lines(given.shared):
        say(False, line)
    if given.json:
        with atomic(given.json) as temporary:
            figures = {"mariner": [asdict(e) for e in found], "outages": asdict(dead), "forms": alike}
            temporary.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
