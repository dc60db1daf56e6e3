"""Scenarios: a TOML file that says which ship does what, where, in which weather and under which sensors."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import BaseModel, Field

from aspnn import __version__
from aspnn.angles import compass
from aspnn.config import read_toml
from aspnn.frames import Zone, convergence, to_grid
from aspnn.records import Log, write_log, write_table
from aspnn.schema import InputError
from aspnn.simulation.plan import (
    STRICT,
    Course,
    Departure,
    Engine,
    Prescribed,
    RandomOrders,
    Start,
    Straight,
    TurningCircle,
    WilliamsonTurn,
    Zigzag,
)
from aspnn.simulation.routes import Courses, RandomRoute, Steersman, Waypoints
from aspnn.simulation.sensing.sensors import Sensors, measure
from aspnn.simulation.ship import ASTERN, BACKING, DRIFT, SLOW, YAW, Ship
from aspnn.simulation.voyage import Voyage, simulate
from aspnn.simulation.weather import KNOT, Environment
from aspnn.vessel import load_vessel

START = "2025-06-01T00:00:00Z"  # a fixed instant: the same scenario gives the same file
BATCH, STEPS = 50, 500_000  # voyages integrated at once, and steps of all of them; more would only take memory
Manoeuvre = Annotated[
    Straight
    | TurningCircle
    | Zigzag
    | WilliamsonTurn
    | RandomOrders
    | Prescribed
    | Course
    | Waypoints
    | RandomRoute
    | Courses,
    Field(discriminator="kind"),
]


class OtherShip(BaseModel):
    """A ship about a simulated bridge: at a steady speed on a line or, with a rate of turn, on a circle; with a leg to and fro, as
    double-ended ferries go. She tells of herself by AIS.
    """

    model_config = STRICT
    name: str = Field(min_length=1, max_length=20)
    mmsi: int = Field(ge=200_000_000, le=799_999_999)
    latitude_deg: float = Field(ge=-80, le=84)
    longitude_deg: float = Field(ge=-180, le=180)
    heading_deg: float = Field(ge=0, le=360)  # true
    speed_kn: float = Field(0.0, ge=0, le=60)
    turn_deg_min: float = Field(0.0, ge=-720, le=720)
    leg_m: float | None = Field(None, gt=0)
    length_m: float = Field(60.0, ge=3, le=500)


class OnBridge(BaseModel):
    """What `aspnn bridge` takes with a scenario. Paths count from its file; without `ships` there are four made-up ones."""

    model_config = STRICT
    chart: str | None = None  # GeoJSON
    checkpoint: str | None = None
    predict_hz: float = Field(default=4.0, ge=1, le=10)
    ships: list[OtherShip] | None = Field(default=None, max_length=200)


class Scenario(BaseModel):
    """A scenario file; `name` is the file's, unless it says otherwise."""

    model_config = STRICT
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    vessel: str
    voyages: int = Field(1, ge=1)
    duration_s: float = Field(gt=1, le=1e6)
    step_s: float = Field(0.1, gt=0, le=1)  # of the integration; sensors are sampled from it
    seed: int = Field(0, ge=0)
    start: Start
    manoeuvre: Manoeuvre
    engine: Engine | None = None  # without one the shaft stays in balance with the speed of the start
    environment: Environment = Environment()
    sensors: Sensors = Sensors()
    bridge: OnBridge = OnBridge()  # for the simulated bridge alone


def read_scenario(path: str | Path) -> Scenario:
    """Scenario from a TOML file. Raises InputError, one line that names the file, the key and what is wrong with it."""
    return read_toml(path, Scenario, name=Path(path).stem)


def simulate_scenario(
    scenario: Scenario, voyages: int | Sequence[int] | None = None, seed: int | None = None
) -> Iterator[tuple[Log, pd.DataFrame]]:
    """The logs of a scenario, one voyage after the other, each with its truth (schema.TRUTH) at the epochs of the log.

    `voyages` (how many, or the numbers of those wanted) and `seed` take the place of the scenario's. Voyage k draws from
    SeedSequence(seed, spawn_key=(k,)) alone, so it is the same however many are made; sensors and sea draw from streams of
    their own. Raises InputError.
    """
    vessel = load_vessel(scenario.vessel)
    ship = Ship.of(vessel).at_depth(scenario.environment.depth_m)
    largest = math.degrees(ship.rudder.most)
    if abs(scenario.manoeuvre.rudder_deg) > largest + 1e-9:
        raise InputError(
            f"scenario {scenario.name}: manoeuvre.rudder_deg = {scenario.manoeuvre.rudder_deg:g} is beyond the"
            f" {largest:g} degrees of {vessel.name}"
        )
    longest = ship.largest_step(max(scenario.start.speed_kn[1] * KNOT, ship.service_speed))
    if scenario.step_s > longest:
        raise InputError(
            f"scenario {scenario.name}: step_s = {scenario.step_s:g} is too long for the fastest motion of {vessel.name};"
            f" at most {longest:.2g} s"
        )
    wanted = scenario.voyages if voyages is None else voyages
    numbers, size = range(wanted) if isinstance(wanted, int) else wanted, batch_size(scenario)
    for first in range(0, len(numbers), size):
        yield from _batch(scenario, vessel, ship, numbers[first : first + size], seed)


def batch_size(scenario: Scenario) -> int:
    """How many voyages of a scenario are integrated at once."""
    return min(BATCH, max(1, int(STEPS * scenario.step_s / scenario.duration_s)))


def stem(scenario: Scenario, seed: int) -> str:
    """What the names of all voyages of a scenario under a seed begin with."""
    return scenario.name if seed == scenario.seed else f"{scenario.name}-s{seed}"


def voyage_name(scenario: Scenario, number: int, seed: int) -> str:
    """The name of a voyage, and of its files."""
    alone = scenario.voyages == 1 and number == 0
    return stem(scenario, seed) if alone else f"{stem(scenario, seed)}-{number:04d}"


def _batch(scenario, vessel, ship, numbers, seed) -> Iterator[tuple[Log, pd.DataFrame]]:
    own = scenario.seed if seed is None else seed
    streams = [
        [np.random.default_rng(child) for child in np.random.SeedSequence(own, spawn_key=(k,)).spawn(3)]
        for k in numbers
    ]
    plans, noises, seas = zip(*streams, strict=True)
    zone, start, weather = Zone.parse(scenario.start.zone), scenario.start, scenario.environment
    place = math.radians(start.latitude_deg), math.radians(start.longitude_deg)
    north, east = to_grid(*place, zone)
    gamma = float(convergence(*place, zone))
    ranges = (start.speed_kn, start.heading_deg, *weather.ranges)
    drawn = np.array([[rng.uniform(*pair) for pair in ranges] for rng in plans])
    heading = compass(np.radians(drawn[:, 1]) - gamma)
    speeds = start.speed_kn[0] * KNOT, start.speed_kn[1] * KNOT
    leaving = Departure(
        ship, zone, float(north), float(east), heading, gamma, speeds, scenario.duration_s, scenario.step_s
    )
    try:
        helm = scenario.manoeuvre.helm(plans, leaving)
    except InputError as error:
        raise InputError(f"scenario {scenario.name}: {error}") from None
    shaft, pitch = scenario.engine.levers(plans, scenario.duration_s) if scenario.engine else (None, None)
    steps = round(scenario.duration_s / scenario.step_s)
    runs = simulate(
        ship,
        helm,
        ship.start(north, east, heading, drawn[:, 0] * KNOT),
        scenario.duration_s,
        shaft,
        pitch,
        weather.draw(drawn[:, 2:], gamma, (float(north), float(east)), seas, scenario.step_s, steps),
        scenario.step_s,
    )
    steered = helm.notes() if isinstance(helm, Steersman) else [{}] * len(numbers)
    for number, run, noise, told in zip(numbers, runs, noises, steered, strict=True):
        table, truth = measure(run, vessel, zone, scenario.sensors, noise), run.truth()
        truth = truth[truth["time_s"].isin(table["time_s"])].reset_index(drop=True)
        if "out_of_domain" in truth:
            table["out_of_domain"] = truth["out_of_domain"]
        log = Log(
            table=table,
            vessel=vessel,
            zone=zone,
            start=START,
            source=f"simulated by aspnn {__version__}, scenario {scenario.name}, seed {own}, voyage {number}",
            voyage=voyage_name(scenario, number, own),
            notes=_outside(run) | told,
        )
        yield log, truth


OUTSIDE = {ASTERN: "astern", DRIFT: "drift", YAW: "yaw rate", BACKING: "engine astern", SLOW: "slow"}


def _outside(voyage: Voyage) -> dict[str, str]:
    """A note on how long a voyage was beyond what its ship's model has data for; none where it never was."""
    bits, dt = voyage.out_of_domain, float(voyage.time[1] - voyage.time[0])
    parts = [f"{what} {np.count_nonzero(bits & bit) * dt:.0f} s" for bit, what in OUTSIDE.items() if (bits & bit).any()]
    return {"out_of_domain": ", ".join(parts)} if parts else {}


def write_voyage(log: Log, truth: pd.DataFrame, folder: str | Path) -> Path:
    """Write `VOYAGE.parquet` and, before it, `VOYAGE.truth.parquet` into `folder`; returns the path of the log."""
    path = Path(folder) / f"{log.voyage}.parquet"
    metadata = {"kind": "truth", "format": 1, "voyage": log.voyage, "notes": log.notes}
    write_table(truth, path.with_suffix(".truth.parquet"), metadata)
    write_log(log, path)
    return path
