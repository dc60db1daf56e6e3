"""Paper I: six manoeuvres, CMM and CTRA, extended and unscented filter; rms errors beside the published ones.

    python training/reproduce/paper_1.py [--runs 100] [--seed 1] [--out runs/reproduce] [--json FILE]

Prints a table for each model and writes paper_1.png. The published errors (figures 5.4 and 5.5 of the thesis) stand beside four
kinds of ours, all on the same measurements of cargo90:

- no rotation: accelerometers taken for the plain rates of change of surge and sway (z_au = a_u, z_av = a_v: what Paper II adds are the
  terms of the turning axes, its 11-12), compass innovations not wrapped, Q and R of Paper II (Q in the order of the states, E24);
- rotation: the same Q and R with the terms in place and the innovation wrapped (E1, E3, E28), what Paper II's model comes to;
- likelihood: the same filters with the process noise most likely on other voyages;
- cascade: the default filters of `aspnn filter`, CAA and CTRA fed by it, likewise.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from midship import (
    NOISE,
    ONE_STEP,
    PERMUTED,
    cascade,
    cascade_states,
    draws,
    error,
    problem,
    runs_of,
    sail,
    true_states,
    tuned,
)
from numba import njit

from aspnn.cli import guarded, say, watch
from aspnn.estimation.flow import flow_covariance
from aspnn.estimation.kernels import ACCELERATION, CMM8, measure, measure_jacobian
from aspnn.estimation.measurements import Measurements
from aspnn.estimation.models import THESIS_SCHEME, Cmm, Ctra, Sigma
from aspnn.guidance.helms import turning_circle, williamson_turn, zigzag
from aspnn.records import atomic, write_json
from aspnn.schema import InputError
from aspnn.simulation.voyage import Voyage

PUBLISHED = Path(__file__).parents[2] / "tests/reference/paper_1_rmse.csv"
DURATION, ORDER, SETTLE = 400.0, 60.0, 30.0  # s: length of a manoeuvre, its first order, what is not judged
COURSE = math.radians(60)  # at first: the circles and the Williamson turn pass north, the zigzag does not
SCALE = np.array([1, 1, 1, 1, math.degrees(1), 60 * math.degrees(1), 1, 1])  # to the units of the published tables
MODELS = {"CMM": Cmm, "CTRA": Ctra}
FILTERS = {"E": None, "U": Sigma()}
REASONS = """
Where these differ from the paper, and why:
- Velocities, sway above all, and a_n: the paper's errors come back when the accelerometers are taken for plain rates of change, and go
  with the terms of the turning axes in place. It is a fault of the measurement model, not of CMM or CTRA.
- Heading: where the compass passes north the innovation jumps by 360 degrees; the paper's small values are of voyages that did not.
- Position is near what fixes of 1 m at 10 Hz can tell; yaw rate near the gyro's own noise, in the paper too.
- a_u and a_v of CTRA: the published 4e-4 m/s2 is less than any of these filters makes of accelerometers of 0.01 m/s2 on such turns;
  Paper I does not say its R, and its accelerometers must have been quieter. Not comparable.
- EKF and UKF tell the same, as the paper says. Another ship, other lengths of the voyages, R and Q of Paper II.
"""
EVERY = 5  # of the runs go through the unscented filters too, which tell the same at twice the time
KINDS = ("no rotation", "rotation", "likelihood", "cascade")
COLOURS = {
    "published": "#111111",
    "no rotation": "#c1440e",
    "rotation": "#8a8f98",
    "likelihood": "#1f77b4",
    "cascade": "#2a9d5c",
}


def manoeuvres() -> dict[str, Voyage]:
    """The six voyages, by their names in the published tables."""
    turns = {
        f"{side}-{angle}": turning_circle(sign * math.radians(angle), ORDER)
        for side, sign in (("Starboard", 1), ("Port", -1))
        for angle in (35, 10)
    }
    tests = {
        "20/20-Zigzag": zigzag(math.radians(20), math.radians(20), ORDER),
        "Williamson": williamson_turn(math.radians(35), ORDER),
    }
    return {name: sail(helm, COURSE, DURATION) for name, helm in (turns | tests).items()}


@njit(error_model="numpy")  # not cached: a cache would not see the kernels change
def _unrotated(kind, least, density, time, z, R, start, P0, mean):
    """The extended filter of Cmm or Ctra with h less the terms of the turning axes, (-v r, u r): its `mean` (n, 8) is filled.

    `z` (n, 6) and `R` (6): north, east, heading, yaw rate, surge and sway acceleration; those of the first epoch are in `start`.
    """
    x, P, Phi, work, narrow = start.copy(), P0.copy(), np.empty((8, 8)), np.empty((6, 8, 9)), np.empty((4, 8, 7))
    column = x.reshape(-1, 1)  # the same numbers
    p, given, reading, H = np.zeros(7), np.zeros(3), np.empty((2, 1)), np.empty((2, 8))
    along, aside, row = np.zeros(8), np.zeros(8), np.empty(8)  # du / dx, dv / dx, dh / dx
    for k in range(len(time)):
        if k > 0:
            p[3], p[4] = np.cos(x[4]), np.sin(x[4])
            flow_covariance(kind, least, given, time[k] - time[k - 1], 4, 1.0, density, p, x, P, Phi, work, narrow)
        for i in range(6 if k > 0 else 0):
            row[:] = 0.0
            if i < 4:
                state = i if i < 2 else i + 2
                row[state], expected = 1.0, x[state]
            else:
                c, s, r = np.cos(x[4]), np.sin(x[4]), x[5]
                p[3] = p[5] = c
                p[4] = p[6] = s
                measure(kind, least, column, p, ACCELERATION, 0.0, 0.0, reading)
                measure_jacobian(kind, least, column, p, ACCELERATION, 0.0, 0.0, H)
                u, v = x[2], x[3]
                if kind == CMM8:
                    u, v = c * x[2] + s * x[3], c * x[3] - s * x[2]
                    along[2], along[3], along[4] = c, s, v
                    aside[2], aside[3], aside[4] = -s, c, -u
                else:
                    along[2], aside[3] = 1.0, 1.0
                if i == 4:
                    expected = reading[0, 0] + v * r
                    row[:] = H[0] + r * aside
                    row[5] += v
                else:
                    expected = reading[1, 0] - u * r
                    row[:] = H[1] - r * along
                    row[5] -= u
            G = P @ row
            K = G / (row @ G + R[i])
            x += K * (z[k, i] - expected)
            P -= np.outer(K, G)
        mean[k] = x


def unrotated(m: Measurements, model: Cmm | Ctra) -> np.ndarray:
    """States (n - 1, 8) of Paper I's filter as we read it: see `_unrotated`."""
    p = problem(m, model, None)
    z = np.column_stack([m.fixes["midship"], m.heading, m.yaw_rate, m.acceleration])[1:]
    deviation = NOISE.position, NOISE.position, NOISE.heading, NOISE.yaw_rate, NOISE.acceleration, NOISE.acceleration
    mean = np.empty((len(z), 8))
    _unrotated(
        model.kind, model.least_speed, np.array(model.density), p.time, z, np.square(deviation), p.x0, p.P0, mean
    )
    return mean


def estimates(measured: list[Measurements], name: str, tuning) -> Iterator[tuple[str, str, np.ndarray]]:
    """Kind, filter and states (n - 1, 8) of every run of a model."""
    model = MODELS[name]
    for m in measured:
        yield "no rotation", "E", unrotated(m, model(PERMUTED))
    for kind, own in (("rotation", model(PERMUTED)), ("likelihood", model.of(tuning))):
        for letter, sigma in FILTERS.items():
            for _, run in runs_of(measured[:: EVERY if sigma else 1], own, sigma):
                yield kind, letter, run.mean
    if name == "CTRA":
        for m in measured:
            yield "cascade", "E", cascade_states(*cascade(m, tuning))[1:]


def table(voyages: dict[str, Voyage], runs: int, seed: int) -> pd.DataFrame:
    """Rms over runs and time of the errors, one row per model, manoeuvre, kind and filter, in the units of the published ones.

    Paper I's accelerations were evidently compared with what its model takes them for: those of CTRA without rotation are compared
    with the noise-free readings.
    """
    tuning, rows = tuned(), []
    todo = [(name, manoeuvre) for name in MODELS for manoeuvre in voyages]
    for name, manoeuvre in watch(todo, "filtering", len(todo)):
        voyage = voyages[manoeuvre]
        measured = list(draws(voyage, runs, seed))
        truth = true_states(voyage, MODELS[name](PERMUTED))[1:]
        felt = truth.copy()
        felt[:, 6] -= voyage.sway[1:] * voyage.yaw_rate[1:]
        felt[:, 7] += voyage.surge[1:] * voyage.yaw_rate[1:]
        judged = voyage.time[1:] >= SETTLE
        squares: dict[tuple[str, str], list[np.ndarray]] = {}
        for kind, letter, states in estimates(measured, name, tuning):
            reference = felt if name == "CTRA" and kind == "no rotation" else truth
            squares.setdefault((kind, letter), []).append(np.mean(error(states, reference)[judged] ** 2, axis=0))
        for (kind, letter), square in squares.items():
            rows.append((name, manoeuvre, kind, letter, *np.sqrt(np.mean(square, axis=0)) * SCALE))
    return pd.DataFrame(rows, columns=["model", "manoeuvre", "kind", "filter", *STATES])


def published() -> pd.DataFrame:
    """The published tables, as rows like those of `table`."""
    return pd.read_csv(PUBLISHED, comment="#").assign(kind="published")


STATES = ("p_x", "p_y", "velocity_1", "velocity_2", "psi", "r", "a_t", "a_n")
LIMITS = {
    **dict.fromkeys(("p_x", "p_y"), (0.05, 2)),
    **dict.fromkeys(("velocity_1", "velocity_2"), (0.005, 2)),
    "psi": (0.005, 10),
    "r": (0.01, 0.2),
    **dict.fromkeys(("a_t", "a_n"), (1e-4, 0.2)),
}
TITLES = {
    "CMM": ("p_x m", "p_y m", "v_x m/s", "v_y m/s", "psi deg", "r deg/min", "a_t m/s2", "a_n m/s2"),
    "CTRA": ("p_x m", "p_y m", "u m/s", "v m/s", "psi deg", "r deg/min", "a_u m/s2", "a_v m/s2"),
}


def lines(both: pd.DataFrame, name: str) -> Iterator[str]:
    """The table of a model in Markdown."""
    yield f"| {name} | kind | filter | " + " | ".join(TITLES[name]) + " |"
    yield "|---" * (3 + len(STATES)) + "|"
    own = both[both["model"] == name]
    for manoeuvre in own["manoeuvre"].unique():
        for row in own[own["manoeuvre"] == manoeuvre].itertuples():
            cells = " | ".join(f"{getattr(row, state):.3g}" for state in STATES)
            yield f"| {manoeuvre} | {row.kind} | {row.filter} | {cells} |"


def ratios(both: pd.DataFrame) -> Iterator[str]:
    """Published over ours, the geometric mean over the manoeuvres with the least and the greatest, extended filters."""
    yield "| published / ours | kind | " + " | ".join(STATES) + " |"
    yield "|---" * (2 + len(STATES)) + "|"
    extended = both[both["filter"] == "E"].set_index(["model", "kind", "manoeuvre"])[list(STATES)].sort_index()
    for name in MODELS:
        theirs = extended.loc[name, "published"]
        for kind in KINDS:
            if (name, kind) in extended.index.droplevel(2):
                factor = theirs / extended.loc[name, kind]
                middle = np.exp(np.log(factor).mean())
                cells = " | ".join(f"{middle[s]:.2g} ({factor[s].min():.2g}-{factor[s].max():.2g})" for s in STATES)
                yield f"| {name} | {kind} | {cells} |"


def schemes(voyage: Voyage, seed: int) -> float:
    """Greatest difference of the estimates by the papers' twenty steps of order 2 and by one of order 4, in units of their deviations."""
    measured, model = list(draws(voyage, 1, seed)), Ctra(PERMUTED)
    (_, coarse), (_, fine) = (next(runs_of(measured, model, None, scheme=s)) for s in (ONE_STEP, THESIS_SCHEME))
    deviation = np.sqrt(np.diagonal(fine.covariance, axis1=1, axis2=2))
    return float((np.abs(coarse.mean - fine.mean) / deviation).max())


def figure(both: pd.DataFrame, path: Path) -> None:
    """Every error by manoeuvre, on a logarithmic axis: a row of panels for each model."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    names = list(both["manoeuvre"].unique())
    drawing = Figure(figsize=(19, 7.5), layout="constrained")
    axes = drawing.subplots(len(MODELS), len(STATES))
    for name, panels in zip(MODELS, axes, strict=True):
        for state, title, ax in zip(STATES, TITLES[name], panels, strict=True):
            for kind, colour in COLOURS.items():
                own = both[(both["model"] == name) & (both["kind"] == kind) & (both["filter"] == "E")]
                if len(own):
                    values = own.set_index("manoeuvre")[state].reindex(names)
                    ax.plot(values, range(len(names)), "o-", color=colour, label=kind, markersize=5, linewidth=1)
            ax.set_xscale("log")
            ax.set_xlim(LIMITS[state])
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.set_title(f"{name}: {title}", fontsize=10)
            ax.set_yticks(range(len(names)), names if ax is panels[0] else [""] * len(names))
            ax.invert_yaxis()
            ax.grid(True, which="major", color="#dddddd")
    handles, labels = axes[1, 0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    drawing.suptitle("Rms errors, extended filters: Paper I beside cargo90")
    with atomic(path) as temporary:
        drawing.savefig(temporary, format="png", dpi=110)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--runs", type=int, default=100)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--out", type=Path, default=Path("runs/reproduce"))
    options.add_argument("--json", type=Path)
    given = options.parse_args()
    if given.runs < 1:
        raise InputError(f"--runs {given.runs}: at least one run is needed")
    voyages = manoeuvres()
    own = table(voyages, given.runs, given.seed)
    both = pd.concat([published(), own], ignore_index=True)
    say(
        False, f"{given.runs} runs of {DURATION:g} s per manoeuvre, errors from {SETTLE:g} s on, rms over runs and time"
    )
    for name in MODELS:
        for line in (*lines(both, name), ""):
            say(False, line)
    for line in ratios(both):
        say(False, line)
    apart = schemes(voyages["Starboard-35"], given.seed)
    say(
        False,
        f"\ntwenty steps of order 2 (delta t 0.005 s) and one of order 4 differ by {apart:.1g} standard deviations at most",
    )
    say(False, REASONS)
    figure(both, given.out / "paper_1.png")
    say(False, f"{given.out / 'paper_1.png'} written")
    if given.json:
        write_json(both.to_dict("records"), given.json)


if __name__ == "__main__":
    guarded(main)
