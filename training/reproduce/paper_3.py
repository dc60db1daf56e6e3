"""Paper III: heading at high latitude. A straight run to true north and a zigzag off Svalbard, in three scenarios.

    python training/reproduce/paper_3.py [--voyages 10] [--out runs/reproduce]

The ship of this project (cargo90), a receiver at midship and the paper's sensors; CTRA and UKF of eight states with the
paper's noise (its list permuted: E24), sigma points and scheme. Scenario 1 corrects the compass for the grid convergence and
wraps its innovation; scenario 2 does not wrap it; scenario 3 takes the compass for the grid heading. Prints the laws that
must show, then tables 3 and 4 beside the paper's, and draws figures 7 and 8. The voyages differ by the sensors' noise only.
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from aspnn.angles import circular_mean, difference
from aspnn.cli import guarded, say, watch
from aspnn.estimation.compiled import run
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import Measurements, from_log
from aspnn.estimation.models import THESIS_SCHEME, Ctra, Sigma
from aspnn.estimation.nonlinear import model_problem, two_point_start
from aspnn.estimation.problem import ModelProblem
from aspnn.frames import Zone, to_geodetic
from aspnn.simulation import Scenario, simulate_scenario
from aspnn.vessel import Vessel

DEG = math.pi / 180
DENSITY = (1e-1, 1e-1, 1e-3, 1e-3, 0.1 * DEG, 1e-5 * DEG, 1e-5, 1e-5)  # table 2, in our order of states: E24
MANOEUVRES = {  # place [m north, east in zone 33], true heading [deg], helm
    "straight": ((8503821.0, 434061.0), 0.0, {"kind": "straight"}),
    "zigzag": (
        (8635500.0, 424155.0),
        15.0,
        {"kind": "zigzag", "rudder_deg": 20, "heading_change_deg": 20, "start_s": 60},
    ),
}
PUBLISHED = {  # tables 3 and 4: r [deg/min], a_u, a_v [m/s2] of scenarios 1 to 3
    "straight": [(3.53e-1, 4.85e-2, 2.38e-3), (3.56e-1, 4.85e-2, 2.39e-3), (3.53e-1, 4.85e-2, 2.38e-3)],
    "zigzag": [(3.94e-1, 4.81e-3, 2.61e-3), (3.94e-1, 5.44e-3, 3.70e-3), (3.94e-1, 6.09e-3, 2.77e-3)],
}
SETTLE = 10.0  # s left out at the start
APART = 0.05  # m/s: scenario 2 counts as led astray while its velocity is farther from scenario 1
SCENARIOS = ("1 both corrections", "2 no switching correction", "3 no grid convergence")


@dataclass(frozen=True)
class Voyage:
    """What one log taught: truth (n, 8) in the order of the states, the compass [rad, 0 to 2 pi), and estimates (n, 8) by name."""

    time: np.ndarray
    truth: np.ndarray
    compass: np.ndarray
    convergence: np.ndarray
    estimates: dict[str, np.ndarray]

    def error(self, name: str) -> np.ndarray:
        """Estimated minus true states (n, 8), the heading's by the smallest signed angle."""
        error = self.estimates[name] - self.truth
        error[:, 4] = difference(self.estimates[name][:, 4], self.truth[:, 4])
        return error

    def crossings(self) -> np.ndarray:
        """Epochs at which the compass steps over north."""
        return np.flatnonzero(np.abs(np.diff(self.compass)) > math.pi) + 1


def paper_problem(m: Measurements, vessel: Vessel) -> ModelProblem:
    """The paper's filter on measurements, begun at the second fix on the circular mean of two headings (E25)."""
    noise, fix = vessel.noise, m.fixes["midship"]
    p = model_problem(m, noise, Ctra(DENSITY), vessel.service_speed, vessel.length, scheme=THESIS_SCHEME, sigma=Sigma())
    heading = float(circular_mean(m.heading[:2]))
    variance = np.full(2, noise.position**2)
    x0, P0 = two_point_start(p.model, m.time[:2], fix[:2], heading, m.yaw_rate[1], noise, variance, acceleration=0.05)
    z = p.z[1:].copy()
    z[0] = np.nan  # it is in the start
    rows = {name: getattr(p, name)[1:] for name in ("time", "given", "inflation", "R")}
    return replace(p, x0=x0, P0=P0, z=z, gates=np.full_like(p.gates, np.inf), **rows)


def default_cascade(m: Measurements, vessel: Vessel) -> np.ndarray:
    """States (n, 8) of this project's filter, in the order of CTRA."""
    size = vessel.service_speed, vessel.length
    turning = run(heading_problem(m, vessel.noise, *size))
    moving = run(motion_problem(m, vessel.noise, turning.mean, turning.covariance, *size)).mean
    return np.column_stack([moving[:, :4], turning.mean[:, :2], moving[:, 4:]])


def voyage(log, truth) -> Voyage:
    """All filters on one log."""
    m, vessel = from_log(log), log.vessel
    uncorrected = replace(m, heading=m.heading + m.convergence)
    paper = paper_problem(m, vessel)
    own = model_problem(m, vessel.noise, Ctra.of(vessel.noise), vessel.service_speed, vessel.length, sigma=Sigma())
    filters: dict[str, Callable[[], np.ndarray]] = {
        SCENARIOS[0]: lambda: run(paper).mean,
        SCENARIOS[1]: lambda: run(replace(paper, angle=np.zeros_like(paper.angle))).mean,
        SCENARIOS[2]: lambda: run(paper_problem(uncorrected, vessel)).mean,
        "1 with this project's noise": lambda: run(own).mean[1:],
        "default cascade": lambda: default_cascade(m, vessel)[1:],
    }
    t = {name: truth[name].to_numpy(float) for name in truth}
    surge_rate, sway_rate = (np.gradient(t[name], t["time_s"]) for name in ("surge_m_s", "sway_m_s"))
    place = t["north_m"] - m.origin[0], t["east_m"] - m.origin[1]
    turn = t["heading_rad"], t["yaw_rate_rad_s"]
    true = np.column_stack([*place, t["surge_m_s"], t["sway_m_s"], *turn, surge_rate, sway_rate])[1:]
    estimates = {name: states() for name, states in filters.items()}
    return Voyage(m.time[1:], true, (m.heading + m.convergence)[1:], m.convergence[1:], estimates)


def simulate(kind: str, count: int) -> list[Voyage]:
    """The voyages of a manoeuvre."""
    place, heading, helm = MANOEUVRES[kind]
    latitude, longitude = np.degrees(to_geodetic(*place, Zone(33)))
    scenario = Scenario.model_validate(
        {
            "name": kind,
            "vessel": "cargo90",
            "duration_s": 500,
            "seed": 76,
            "start": {
                "speed_kn": 11.5,
                "latitude_deg": float(latitude),
                "longitude_deg": float(longitude),
                "zone": "33N",
                "heading_deg": heading,
            },
            "manoeuvre": helm,
            "sensors": {"antennas": ["midship"]},
        }
    )
    return [voyage(*pair) for pair in watch(simulate_scenario(scenario, count), kind, count)]


def rms(voyages: list[Voyage], name: str) -> np.ndarray:
    """RMS error (8) over all voyages and epochs from SETTLE on."""
    return np.sqrt(np.mean(np.concatenate([v.error(name)[v.time >= SETTLE] for v in voyages]) ** 2, axis=0))


def astray(v: Voyage) -> np.ndarray:
    """Epochs at which the velocity of scenario 2 is farther than APART from that of scenario 1."""
    off = v.estimates[SCENARIOS[1]][:, 2:4] - v.estimates[SCENARIOS[0]][:, 2:4]
    return np.hypot(*off.T) > APART


def laws(kind: str, voyages: list[Voyage]) -> None:
    """What the corrections are for: where scenario 2 fails, and the bias of scenario 3."""
    first = voyages[0]
    say(False, f"\n{kind}: convergence {first.convergence[0] / DEG:.4f} deg at the start, {len(voyages)} voyages")
    say(False, "| scenario | position m | surge m/s | sway m/s | heading deg | mean sway error m/s |")
    say(False, "|---|---|---|---|---|---|")
    for name in first.estimates:
        e = rms(voyages, name)
        bias = np.mean([v.error(name)[v.time >= SETTLE, 3].mean() for v in voyages])
        row = f"{np.hypot(e[0], e[1]):.3f} | {e[2]:.4f} | {e[3]:.4f} | {e[4] / DEG:.3f} | {bias:+.4f}"
        say(False, f"| {name} | {row} |")
    expected = np.mean([(-v.truth[:, 2] * np.sin(v.convergence))[v.time >= SETTLE].mean() for v in voyages])
    say(False, f"sway error of scenario 3 by analysis, -u sin gamma (+ v (cos gamma - 1)): {expected:+.4f} m/s")
    steps = np.mean([len(v.crossings()) / v.time[-1] * 60 for v in voyages])
    say(False, f"the compass steps over north {steps:.1f} times a minute")
    if kind == "straight":  # it does so all the time: scenario 2 has no peace
        wrong = np.mean([astray(v)[v.time >= SETTLE].mean() for v in voyages])
        say(False, f"scenario 2 is more than {APART:g} m/s from 1 for {100 * wrong:.0f} % of the time")
        return
    before, away, worst = 0.0, 0.0, 0.0
    for v in voyages:
        k = v.crossings()
        off = v.estimates[SCENARIOS[1]][: k[0]] - v.estimates[SCENARIOS[0]][: k[0]]
        before = max(before, float(np.abs(off).max()))
        rows = np.flatnonzero(astray(v))
        away = max(away, float((v.time[rows] - v.time[k[np.searchsorted(k, rows, "right") - 1]]).max()))
        worst = max(worst, float(np.hypot(*v.error(SCENARIOS[1])[v.time >= SETTLE, 2:4].T).max()))
    say(False, f"scenario 2 beside 1 before the compass first steps over north: {before:.1g} (largest difference)")
    say(
        False,
        f"scenario 2 after a step: up to {worst:.2g} m/s wrong, within {APART:g} m/s of 1 for good {away:.0f} s later",
    )


def published(kind: str, voyages: list[Voyage]) -> None:
    """Tables 3 and 4."""
    say(False, f"\n{kind}: RMSE of yaw rate deg/min | a_u m/s2 | a_v m/s2, the paper's and ours")
    say(False, "| filter | paper | ours |\n|---|---|---|")
    names = list(voyages[0].estimates)
    for name, theirs in zip(names, [*PUBLISHED[kind], *[None] * (len(names) - 3)], strict=True):
        e = rms(voyages, name)
        told = " ".join(f"{value:.2e}" for value in theirs) if theirs else "-"
        say(False, f"| {name} | {told} | {e[5] / DEG * 60:.2e} {e[6]:.2e} {e[7]:.2e} |")


def figure(found: dict[str, list[Voyage]], path: Path) -> None:
    """Errors of heading, surge and sway of the first voyage of each manoeuvre (the paper's figures 7 and 8)."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    picture, axes = plt.subplots(3, 2, figsize=(11, 8.5), sharex="col", layout="constrained")
    rows = (
        ("heading error [deg]", 4, 1 / DEG, 1.0),
        ("surge error [m/s]", 2, 1.0, 0.1),
        ("sway error [m/s]", 3, 1.0, 0.1),
    )
    for column, (kind, voyages) in zip(axes.T, found.items(), strict=True):
        v = voyages[0]
        use = v.time >= SETTLE
        for axis, (label, state, scale, straight) in zip(column, rows, strict=True):
            for name, ink, order in zip(SCENARIOS, ("#1f6feb", "#d1242f", "#2a9d4a"), (3, 1, 2), strict=True):
                axis.plot(v.time[use], v.error(name)[use, state] * scale, color=ink, lw=1, zorder=order, label=name)
            if state == 3:
                (_, _, u, w), gamma = v.truth[use, :4].T, v.convergence[use]
                bias = -u * np.sin(gamma) + w * (np.cos(gamma) - 1)
                axis.plot(v.time[use], bias, "k--", lw=1, zorder=4, label="scenario 3 by analysis, $-u\\,\\sin\\gamma$")
            for k in v.crossings() if kind == "zigzag" else ():
                axis.axvline(v.time[k], color="#57606a", lw=0.6, ls=":", zorder=0)
            axis.set_yscale("symlog", linthresh=straight, linscale=1.0)
            axis.set_ylabel(label)
            axis.grid(alpha=0.25)
        column[0].set_title(
            kind + (" (dotted: the compass steps over north)" if kind == "zigzag" else " to true north")
        )
        column[-1].set_xlabel("time [s]")
    picture.legend(*axes[-1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.savefig(path, dpi=110)
    plt.close(picture)


REASONS = """
Where the figures differ:
- The ship is cargo90 and not the bridge simulator's; the manoeuvres are ours at the paper's places.
- a_u of the straight run, 0.0485 in the paper, is the same in all its scenarios, also where the filter diverges, and twenty times
  its a_v with the same noise: it is not made by the filter. An a_u recorded 0.05 m/s2 off du/dt would do it; ours is 0.002.
- Scenario 2 on the straight run: ours leaves with 80 m/s and a wrong yaw rate and a_v besides; the paper prints its errors of these
  unchanged, and shows the divergence in position, velocity and heading only.
- The printed Q belongs to another order of states (E24); it is permuted here. The start is on the circular mean of headings, where
  the printed psi = 3.14 is the arithmetic mean of 0 and 360 deg (E25); the switching correction is the smallest signed angle
  (E28); the convergence is computed afresh each second (E15).
- With noise on the highest derivatives alone, tuned by likelihood, errors of position and velocity are half, that of heading a
  fourteenth; the yaw rate gains by the yaw acceleration as a state (default cascade).
In a zigzag the bias of scenario 3 is a little under -u sin gamma: the accelerometers keep to the hull's true axes.
"""


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--voyages", type=int, default=10)
    options.add_argument("--out", type=Path, default=Path("runs/reproduce"))
    given = options.parse_args()
    found = {kind: simulate(kind, given.voyages) for kind in MANOEUVRES}
    for kind, voyages in found.items():
        laws(kind, voyages)
    for kind, voyages in found.items():
        published(kind, voyages)
    say(False, REASONS)
    path = given.out / "paper_3.png"
    figure(found, path)
    say(False, f"figure: {path}")


if __name__ == "__main__":
    guarded(main)
