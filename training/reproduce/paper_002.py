"""Paper 002: a small craft on straight lines and on paths that bend, in a cross current, by six guidance laws.

    python training/reproduce/paper_002.py [--out runs/reproduce/paper_002] [--json FILE] [--quick]

The Otter (6 degrees of freedom, 2 m) stands in for the SWAMP of the paper, whose model is not public. She runs 1 m/s through the
water in 0.3 m/s across the line, 130 m along it, turns back along the same line, and again: lines at 60 and -120 degrees (text of the
paper), 119 and -61 degrees (its figures; erratum E49). A PID heading autopilot of pole placement follows each law. Prints the indices of
the laws beside the published offsets, what the filters estimate, what an error of the compass does, and paths that bend; writes
figures 2 to 6 in our form as PNG and a page. `--quick`: the first table alone, without noise.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from case_page import print_case, write_values
from paper_6_tables import Table

from aspnn.angles import difference
from aspnn.cli import guarded, say
from aspnn.estimation.sideslip import EXACT, SMALL, SideslipModel
from aspnn.evaluation.path_indices import path_indices
from aspnn.guidance.autopilot import CourseAutopilot, pole_placement
from aspnn.guidance.compensation import AdaptiveLos, IntegralLos, KalmanLos, steady_offset
from aspnn.guidance.curves import ArcPath, CurveFollower, SplinePath
from aspnn.guidance.helms import EAST, HEADING, NORTH, YAW_RATE
from aspnn.guidance.los import LineOfSight
from aspnn.guidance.route import PathError, Route
from aspnn.simulation.sea import Sea
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import Voyage, simulate
from aspnn.vessel import load_vessel

SPEED, CURRENT, LENGTH = 1.0, 0.3, 130.0  # m/s through the water; m/s across the line; m of a run
LOOKAHEAD = 5.0  # m, assumed: the paper tells none
STEP = 0.1  # s, of helm and simulator
K, T, OMEGA, DAMPING = (
    2.0,
    1.0,
    1.0,
    1.0,
)  # of the Otter's lever at 1 m/s (1/s, s), measured; of the heading loop (rad/s)
LINES = np.radians([60.0, 119.0])  # each sailed there and back
BANDWIDTH = 0.4  # rad/s of the tuned sideslip filters
PUBLISHED = {119.0: 2.4, -61.0: 0.6}  # m beside the line, conventional law (text of the paper)
CORNERS = np.array([[0.0, 0.0], [60.0, 0.0], [85.0, 55.0], [20.0, 90.0], [60.0, 150.0]])  # m, of the paths that bend
RADIUS = 12.0  # m, of their arcs
LAWS: dict[str, Callable[[int], Any]] = {
    "conventional LOS": lambda ships: LineOfSight(LOOKAHEAD),
    "KF-LOS, paper's R and Q": lambda ships: KalmanLos(LOOKAHEAD, SideslipModel.published(STEP), ships, printed=True),
    "KF-LOS, (7) and (11), tuned": lambda ships: KalmanLos(LOOKAHEAD, tuned(SMALL), ships, printed=True),
    "KF-LOS, exact, tuned": lambda ships: KalmanLos(LOOKAHEAD, tuned(EXACT), ships),
    "integral LOS": lambda ships: IntegralLos.damped(LOOKAHEAD, SPEED, ships=ships),
    "adaptive LOS": lambda ships: AdaptiveLos.damped(LOOKAHEAD, SPEED, ships=ships),
}
REASONS = """
- The offset of the conventional law is lookahead tan(sideslip), to the millimetre; every law that estimates the sideslip ends on the line.
- With the current abeam the crab angle is the same there and back, so 2.4 m one way and 0.6 m the other are not a uniform current at one
  speed through the water: a compass 9.4 degrees out (for a look-ahead of 5 m), wind or a current that changes can be. An error of the
  compass looks to the filter like sideslip: it is made up for as well.
- To which side a craft turns when the line is inverted is decided by a degree of heading: turning areas tell the side before they tell the law.
- The filter of (7) finds tan(beta) on the line, not beta, and (11) takes it for tan(beta): two approximations that cancel. With beta in (11)
  a large drift would leave lookahead (tan(beta) - beta).
- The paper's Q = 100 I, R = 10 makes a filter of 1.8 rad/s at 1 m/s. It settles at once and passes the noise on: in ours the heading asked for
  turns by 57 deg/s rms and the sideslip is 4.1 degrees out. The exact filter of 0.4 rad/s whose own y_e steers asks for 3 deg/s and is 0.5
  degrees out, with the same indices. Where a path bends the quick filter is the better one.
- Integral and adaptive LOS end on the line as well, and hold it a little better in noise (0.03 to 0.04 m rms, the filters 0.05 to 0.06 m). They
  are slower: after the short turn they are steady from 34 to 41 m on, the filters from 14 to 16 m; after the wide one it is 8 to 19 m for all.
- Look-ahead, current, noise and controller of the trials are not published, and its areas only as pictures: ours stand beside nothing there.
- The phases of the indices are assumed (reference 16 could not be opened); aspnn/evaluation/path_indices.py says how.
"""


@dataclass(frozen=True)
class Sensors:
    """Standard deviations of white noise at each step (position [m], heading [rad], speed [m/s]), and the compass's error [rad]."""

    position: float = 0.0
    heading: float = 0.0
    speed: float = 0.0
    compass: float = 0.0


@dataclass(frozen=True)
class Case:
    """What the lines are sailed in: sensors, and a current [m/s] to starboard of the outward line."""

    sensors: Sensors
    current: float = CURRENT


QUIET, NOISY = Sensors(), Sensors(position=0.2, heading=np.radians(1.0), speed=0.05)


def uneven() -> Case:
    """Current and error of the compass with which the conventional law rests where the paper's did, see `crab`."""
    there, back = (float(np.arctan(PUBLISHED[line] / LOOKAHEAD)) for line in (119.0, -61.0))
    return Case(Sensors(compass=0.5 * (back - there)), SPEED * float(np.sin(0.5 * (there + back))))


def tuned(form) -> SideslipModel:
    """The sideslip filter for the noise of NOISY."""
    return SideslipModel.tuned(BANDWIDTH, NOISY.position, STEP, SPEED, form)


class Shuttle:
    """Ships that sail a line of LENGTH to its end and back again: each time it is inverted, which `Route` would refuse."""

    def __init__(self, angles):
        self.angle, self.origin = angles.copy(), np.zeros((len(angles), 2))
        self.leg = np.zeros(len(angles), int)

    def update(self, north, east) -> PathError:
        """As a `Follower`."""
        along, cross = self._place(north, east)
        ends = along >= LENGTH
        ahead = np.stack([np.cos(self.angle), np.sin(self.angle)], axis=-1)
        self.origin = np.where(ends[:, None], self.origin + LENGTH * ahead, self.origin)
        self.angle = np.where(ends, self.angle + np.pi, self.angle)
        self.leg = self.leg + ends
        along, cross = self._place(north, east)
        return PathError(along, cross, self.angle, LENGTH - along, self.leg, np.zeros(len(along), bool))

    def _place(self, north, east):
        x, y = north - self.origin[:, 0], east - self.origin[:, 1]
        c, s = np.cos(self.angle), np.sin(self.angle)
        return x * c + y * s, y * c - x * s

    def turn(self, error, speed, course):
        """A straight line does not turn."""
        return 0.0


class Steered:
    """A helm that follows a path by a law, with sensors and the PID heading autopilot; `track` keeps what happened, by name.

    `sensors` of each ship; `ahead` (ships,): whether the path's turning is fed forward.
    """

    def __init__(self, law, path, sensors: Sequence[Sensors], ahead=1.0):
        gains, ships = pole_placement(K, T, OMEGA, DAMPING), len(sensors)
        self.law, self.path, self.ahead = law, path, ahead
        self.sensors = Sensors(*np.array([astuple(one) for one in sensors]).T)
        self.autopilot = CourseAutopilot(gains, K, T, np.radians(35.0), ships)
        self.rng = np.random.default_rng(0)
        self.before: np.ndarray | None = None
        self.track: list[tuple[np.ndarray, ...]] = []

    def __call__(self, time: float, state: np.ndarray) -> np.ndarray:
        s, ships, place = self.sensors, len(state), state[:, [NORTH, EAST]]
        moved = place - (place if self.before is None else self.before)
        self.before = place
        speed = np.hypot(*moved.T) / STEP if time > 0 else np.full(ships, SPEED)
        course = np.arctan2(moved[:, 1], moved[:, 0]) if time > 0 else state[:, HEADING]
        noise = self.rng.standard_normal((5, ships))
        speed = np.maximum(speed + s.speed * noise[0], 0.0)
        heading = state[:, HEADING] + s.compass + s.heading * noise[1]
        north, east = place.T + s.position * noise[2:4]
        error = self.path.update(north, east)
        desired = self.law(error, speed, heading, STEP)
        sideslip = getattr(self.law, "sideslip", np.zeros(ships))
        rate = self.ahead * self.path.turn(error, speed, heading + sideslip)
        filtered = self.law.filter.cross if isinstance(self.law, KalmanLos) else np.full(ships, np.nan)
        crab = difference(course, state[:, HEADING] + s.compass)
        told = crab + s.heading * noise[1] + s.speed / SPEED * noise[4]
        now = (np.full(ships, time), desired, heading, error.cross, error.along, error.leg)
        self.track.append((*now, error.path_angle, sideslip, crab, told, filtered))
        return self.autopilot.command(STEP, heading, state[:, YAW_RATE], desired, rate)

    def seen(self) -> dict[str, np.ndarray]:
        """What happened, arrays (ships, steps): `crab` is the true sideslip as the compass has it, `told` the measured one."""
        names = ("time", "desired", "heading", "cross", "along", "leg", "angle", "sideslip", "crab", "told", "filtered")
        return dict(zip(names, np.array(self.track, float).transpose(1, 2, 0), strict=True))


@dataclass(frozen=True)
class Run:
    """One law on a batch of paths: the true voyages and what its helm saw."""

    voyages: list[Voyage]
    seen: dict[str, np.ndarray]

    def of(self, first: int, ships: int) -> "Run":
        """That of some of its ships."""
        rows = slice(first, first + ships)
        return Run(self.voyages[rows], {name: values[rows] for name, values in self.seen.items()})


def shuttled(law: str, cases: Sequence[Case], runs: int = 3) -> list[Run]:
    """The lines sailed `runs` times to and fro by a law, in all cases at once; one result per case."""
    ship, lines = Ship.of(load_vessel("otter")), np.tile(LINES, len(cases))
    current = np.repeat([case.current for case in cases], len(LINES))
    across = current[:, None] * np.stack([-np.sin(lines), np.cos(lines)], axis=-1)
    sensors = [case.sensors for case in cases for _ in LINES]
    helm = Steered(LAWS[law](len(lines)), Shuttle(lines), sensors)
    start = ship.start(np.zeros(len(lines)), 0.0, lines, SPEED)
    voyages = simulate(ship, helm, start, runs * (LENGTH / 0.9 + 12.0), sea=Sea(current=across), dt=STEP)
    whole = Run(voyages, helm.seen())
    return [whole.of(k * len(LINES), len(LINES)) for k in range(len(cases))]


def true_line(run: Run, ship: int, leg: int) -> tuple[np.ndarray, np.ndarray, float]:
    """True x and y [m] of one run along its line, from the turn to its end, and the angle of the line [deg, -180 to 180]."""
    rows = run.seen["leg"][ship] == leg
    voyage, angle = run.voyages[ship], LINES[ship] + np.pi * leg
    origin = LENGTH * (leg % 2) * np.array([np.cos(LINES[ship]), np.sin(LINES[ship])])
    x, y = voyage.north[rows] - origin[0], voyage.east[rows] - origin[1]
    along, cross = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    return along, cross, float(np.degrees(difference(angle, 0.0)))


def crab(angle_deg: float, current: float = CURRENT, compass: float = 0.0) -> float:
    """The sideslip [rad] that a ship without leeway has on a line at `angle_deg`, as its compass sees it: asin(c / V) - its error."""
    outward = min(abs(float(difference(np.radians(angle_deg), line))) for line in LINES) < 0.1
    return (1 if outward else -1) * float(np.arcsin(current / SPEED)) - compass


def index_table(runs: dict[str, Run], title: str, note: str) -> Table:
    """The indices of the second and third run of each law."""
    rows, values = [], {}
    for name, run in runs.items():
        for ship in range(len(LINES)):
            for leg in (1, 2):
                along, cross, line = true_line(run, ship, leg)
                found = path_indices(along, cross, LENGTH)
                values[f"{name}, {line:.0f}"] = asdict(found)
                published = PUBLISHED.get(round(line)) if name.startswith("conv") else None
                rows.append(
                    [
                        name,
                        f"{line:.0f}",
                        *(f"{x:.0f}" for x in (found.turning_area, found.approach_area)),
                        *(f"{x:.2f}" for x in (found.steady_area, found.steady_area_per_m)),
                        *(f"{x:.2f}" for x in (found.vertical, found.horizontal)),
                        f"{found.steady_from:.0f}",
                        f"{found.offset:+.3f}",
                        f"{steady_offset(LOOKAHEAD, crab(line)):+.3f}" if name.startswith("conv") else "0",
                        "" if published is None else f"{published:g}",
                    ]
                )
    heads = ["law", "line deg", "A1 turning m2", "A2 approach m2", "A3* steady m2", "A3*/length m"]
    heads += ["vertical m", "horizontal m", "steady from m", "offset m", "by formula m", "published m"]
    return Table(title, note, heads, rows, values)


def estimate_table(runs: dict[str, Run]) -> Table:
    """What each law makes of the sideslip in the steady half of a run, and how restless the heading it asks for is."""
    rows, values = [], {}
    for name, run in runs.items():
        s = run.seen
        steady = (s["along"] > LENGTH / 2) & (s["leg"] < 3)
        outward = np.degrees(s["sideslip"] - s["crab"])[steady] if not name.startswith("conv") else np.full(2, np.nan)
        asked = np.degrees(np.diff(s["desired"], axis=1))[steady[:, 1:]] / STEP
        lost = np.degrees(np.abs(difference(s["heading"], s["desired"])))[steady]
        found = values[name] = {
            "sideslip_rms_deg": float(np.sqrt(np.mean(outward**2))),
            "sideslip_bias_deg": float(np.mean(outward)),
            "asked_rate_deg_s": float(np.sqrt(np.mean(asked**2))),
            "heading_error_deg": float(np.mean(lost)),
            "true_cross_rms_m": float(np.sqrt(np.mean(_steady_cross(run) ** 2))),
        }
        rows.append([name, *("-" if np.isnan(x) else f"{x:.2f}" for x in found.values())])
    heads = [
        "law",
        "sideslip rms deg",
        "its mean deg",
        "turning asked for deg/s",
        "heading error deg",
        "true y_e rms m",
    ]
    note = (
        f"Noise of {NOISY.position:g} m, {np.degrees(NOISY.heading):g} deg and {NOISY.speed:g} m/s, white at {1 / STEP:g} Hz (assumed); the second"
        " half of each run. The sideslip is compared with that of the true motion."
    )
    return Table("What the laws estimate in noise", note, heads, rows, values)


def _steady_cross(run: Run) -> np.ndarray:
    """True y_e [m] of the second halves of the runs."""
    found = (true_line(run, ship, leg) for ship in range(len(LINES)) for leg in (0, 1, 2))
    return np.concatenate([cross[along > LENGTH / 2] for along, cross, _ in found])


def compass_table(runs: dict[str, Run]) -> Table:
    """What the published offsets can be: current and an error of the compass together."""
    rows, values = [], {}
    current, compass = uneven().current, uneven().sensors.compass
    for name, run in runs.items():
        for leg in (0, 1):
            along, cross, line = true_line(run, 1, leg)
            offset = float(np.median(cross[along > 0.7 * LENGTH]))
            expected = float(steady_offset(LOOKAHEAD, crab(line, current, compass)))
            values[f"{name}, {line:.0f}"] = {"offset_m": offset, "formula_m": expected}
            told = f"{expected:+.3f}" if name.startswith("conv") else "0"
            rows.append(
                [name, f"{line:.0f}", f"{offset:+.3f}", told, f"{PUBLISHED[round(line)]:g}" if "conv" in name else "0"]
            )
    note = (
        f"A current of {current:.3f} m/s across and a compass that reads {np.degrees(compass):+.1f} deg too much are one way to both, with a"
        f" look-ahead of {LOOKAHEAD:g} m. The sign of ours is the side, positive to starboard of the line."
    )
    heads = ["law", "line deg", "offset m", "by formula m", "published m"]
    return Table("2.4 m one way, 0.6 m the other", note, heads, rows, values)


def bent() -> dict[str, dict[str, Run]]:
    """All laws on lines with arcs and on a spline through the same waypoints, current from the west; runs by law and path.

    The first ship of each run has the path's turning fed forward, the second has not.
    """
    ship = Ship.of(load_vessel("otter"))
    curves = {"lines and arcs": ArcPath.through(Route(CORNERS), RADIUS), "spline": SplinePath(CORNERS)}
    found: dict[str, dict[str, Run]] = {}
    for name in LAWS:
        for path, curve in curves.items():
            helm = Steered(LAWS[name](2), CurveFollower(curve, 2), [QUIET, QUIET], np.array([1.0, 0.0]))
            first = curve.at(np.zeros(2))
            start = ship.start(first.north, first.east, first.angle, SPEED)
            duration = float(curve.arc(np.array(curve.end))) / 1.05
            voyages = simulate(ship, helm, start, duration, sea=Sea(current=np.array([0.0, CURRENT])), dt=STEP)
            found.setdefault(name, {})[path] = Run(voyages, helm.seen())
    return found


def bent_table(runs: dict[str, dict[str, Run]]) -> Table:
    """Cross-track errors on the paths that bend, from 20 m on, with and without the feed-forward of the path's turning."""
    rows, values = [], {}
    for name, paths in runs.items():
        row, found = [name], {}
        for path, run in paths.items():
            for ship, way in enumerate(("", " without feed-forward")):
                cross = run.seen["cross"][ship][run.seen["along"][ship] > 20.0]
                found[path + way] = {
                    "rms_m": float(np.sqrt(np.mean(cross**2))),
                    "most_m": float(np.abs(cross).max()),
                }
                row.append(f"{found[path + way]['rms_m']:.2f} / {found[path + way]['most_m']:.2f}")
        rows.append(row)
        values[name] = found
    heads = ["law", "lines and arcs", "the same, no feed-forward", "spline", "the same, no feed-forward"]
    note = f"y_e rms / greatest [m] from 20 m on, without noise; arcs of {RADIUS:g} m, a current of {CURRENT:g} m/s from the west."
    return Table("Paths that bend (the paper's future work)", note, heads, rows, values)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path, default=Path("runs/reproduce/paper_002"))
    options.add_argument("--json", type=Path)
    options.add_argument("--quick", action="store_true")
    given = options.parse_args()
    cases = [Case(QUIET)] if given.quick else [Case(QUIET), Case(NOISY), uneven()]
    runs = {name: shuttled(name, cases) for name in LAWS}
    still = {name: found[0] for name, found in runs.items()}
    note = f"Without noise, look-ahead {LOOKAHEAD:g} m, current {CURRENT:g} m/s across; after the turn that inverts the line."
    tables = [index_table(still, "Straight lines", note)]
    if not given.quick:
        noisy = {name: found[1] for name, found in runs.items()}
        curved = bent()
        tables += [
            index_table(noisy, "Straight lines in noise", "As above with noisy sensors."),
            estimate_table(noisy),
            compass_table({name: found[2] for name, found in runs.items()}),
            bent_table(curved),
        ]
    print_case(tables, REASONS)
    if not given.quick:
        from paper_002_figures import write

        offset = float(steady_offset(LOOKAHEAD, crab(np.degrees(LINES[0]))))
        for file in write(given.out, tables, (still, noisy, curved), true_line, LENGTH, offset, REASONS):
            say(False, f"{file} written")
    write_values(given.json, tables)


if __name__ == "__main__":
    guarded(main)
