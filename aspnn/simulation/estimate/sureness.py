"""How sure the manoeuvres of an estimated ship are: its indices over draws of its coefficients."""

import contextlib
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from aspnn.guidance.helms import EAST, HEADING, NORTH, zigzag
from aspnn.schema import InputError
from aspnn.simulation.estimate import regression
from aspnn.simulation.estimate.vessel_file import KNOT, Estimate
from aspnn.simulation.ship import Ship
from aspnn.simulation.trials.indices import turning_circle_indices, zigzag_overshoots
from aspnn.simulation.voyage import run_on, simulate
from aspnn.vessel import from_dict

INDICES = ("advance", "tactical diameter", "first overshoot 10/10", "first overshoot 20/20")
STEPS = 40  # of the integration in the time the ship takes for its length
TURN, ZIGZAG = 20, 20  # lengths at service speed that the trials take
MOST_SIGMA = 2.0  # draws reach so far

Watch = Callable[[Iterable, str, int], Iterable]  # (things, what, count) -> the things, watched


class Range(NamedTuple):
    """An index of the estimate itself, and the 10th and 90th percentile of the draws; lengths or rad. `failed` draws have none."""

    name: str
    value: float
    low: float
    high: float
    failed: int


def _silent(things: Iterable, what: str, count: int) -> Iterable:
    return things


def draw(estimate: Estimate, rng: np.random.Generator) -> dict[str, float]:
    """The coefficients of `mmg` of one ship as likely as the estimate.

    The errors that the method makes on a known ship belong together, so they come together: sum over the known ships that
    tell a coefficient of z x error / sqrt(their number), z one standard normal number for each ship; what no ship tells
    varies by itself, k0, k1, k2 as one.
    """
    ships = {ship.name: _normal(rng) for ship in regression.known_ships()}
    blade = _normal(rng)
    values = dict(estimate.data["mmg"])
    for name, (deviation, _) in estimate.deviations.items():
        off = regression.errors().get(name)
        if off:
            change = sum(ships[ship] * error for ship, error in off.items()) / math.sqrt(len(off))
        elif name in ("k0", "k1", "k2"):
            change = blade * deviation * math.copysign(1.0, values[name])
        else:
            change = _normal(rng) * deviation
        for one in ("gamma_R_plus", "gamma_R_minus") if name == "gamma_R" else (name,):
            values[one] += change
    return values


def _normal(rng: np.random.Generator) -> float:
    return float(np.clip(rng.standard_normal(), -MOST_SIGMA, MOST_SIGMA))


def index_ranges(estimate: Estimate, draws: int = 60, seed: int = 0, watch: Watch = _silent) -> list[Range]:
    """Ranges of INDICES over `draws` ships, the same for the same `seed`. Raises InputError where no drawn ship can be."""
    rng = np.random.default_rng(seed)
    L, speed = estimate.data["mmg"]["Lpp"], estimate.data["service"]["speed_m_s"]
    own = _indices(_ship(estimate, estimate.data["mmg"]), L, speed)
    table = np.array(
        [_indices(_drawn(estimate, rng), L, speed) for _ in watch(range(draws), "trials of drawn ships", draws)]
    )
    ranges = []
    for name, value, column in zip(INDICES, own, table.T, strict=True):
        there = column[np.isfinite(column)]
        low, high = np.quantile(there, (0.1, 0.9)) if len(there) else (math.nan, math.nan)
        ranges.append(Range(name, value, float(low), float(high), len(column) - len(there)))
    return ranges


def _drawn(estimate: Estimate, rng: np.random.Generator) -> Ship:
    """A drawn ship; one that no vessel file may hold (a propeller larger than the rudder, a wake below 0) is drawn again."""
    for _ in range(100):
        with contextlib.suppress(InputError):
            return _ship(estimate, draw(estimate, rng))
    raise InputError(
        f"{estimate.data['name']}: its coefficients are at the edge of what a ship can have; check the dimensions"
    )


def _ship(estimate: Estimate, mmg: dict[str, float]) -> Ship:
    return Ship.of(from_dict(estimate.data | {"mmg": mmg}))


def _indices(ship: Ship, L: float, speed: float) -> tuple[float, ...]:
    """Advance and tactical diameter by `L` [m] at hard rudder to starboard, first overshoots [rad]; approach at `speed` [m/s]."""
    unit = L / speed
    dt = unit / STEPS
    start = ship.start(0.0, 0.0, 0.0, speed)
    turned = run_on(ship, start, np.full(TURN * STEPS, ship.rudder.most), dt=dt)[0]
    time = np.arange(len(turned)) * dt
    circle = turning_circle_indices(time, turned[:, NORTH], turned[:, EAST], turned[:, HEADING])
    angles = (math.radians(10), math.radians(20))
    small, large = (zigzag(angle, angle) for angle in angles)

    def helm(time: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([small(time, state[:1]), large(time, state[1:])])

    voyages = simulate(ship, helm, np.repeat(start, 2, axis=0), ZIGZAG * unit, dt=dt)
    past = [zigzag_overshoots(v.heading, v.order, angle) for v, angle in zip(voyages, angles, strict=True)]
    overshoots = [float(each[0]) if len(each) else math.nan for each in past]
    return circle.advance / L, circle.tactical_diameter / L, *overshoots


def table(estimate: Estimate):
    """A rich table of the coefficients with their standard deviations."""
    from rich.table import Table

    shown = Table(title=f"{estimate.data['name']}: coefficients of section mmg")
    for name in ("coefficient", "value", "standard deviation", "of it", "known from"):
        shown.add_column(name, justify="left" if name in ("coefficient", "known from") else "right")
    for name, (deviation, why) in estimate.deviations.items():
        values = estimate.data["mmg"]
        value = values[name] if name in values else (values["gamma_R_plus"] + values["gamma_R_minus"]) / 2
        shown.add_row(name, f"{value:.4g}", f"{deviation:.2g}", f"{deviation / abs(value):.0%}", why)
    return shown


def told(estimate: Estimate, ranges: list[Range], draws: int) -> list[str]:
    """In words: the service point, a line per index, and what the ranges are worth."""
    point, speed = estimate.service, estimate.data["service"]["speed_m_s"] / KNOT
    lines = [
        f"service: {speed:.1f} kn at {point.shaft * 60:.0f} rpm, P/D {point.pitch:.2f}, {point.power / 1e3:.0f} kW at the propeller"
    ]
    for one in ranges:
        scale, unit = (math.degrees(1), "deg") if "overshoot" in one.name else (1.0, "lengths")
        value, low, high = (x * scale for x in (one.value, one.low, one.high))
        line = f"{one.name}: {value:.1f} {unit}; of 10 ships like this, 8 have {low:.1f} to {high:.1f}"
        lines.append(line + (f" ({one.failed} of {draws} draws did not finish the trial)" if one.failed else ""))
    lines.append(
        "The ranges are from the method's errors on S-175, Mariner, KCS and Seiun Maru, four ships finer than KVLCC2;"
        " a turning circle of your own ship tells more."
    )
    return lines
