"""Scenarios: a TOML file that says which ship does what, where, in which weather and under which sensors."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import pandas as pd
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from aspnn import __version__
from aspnn.angles import compass
from aspnn.config import read_toml
from aspnn.frames import Zone, convergence, to_grid
from aspnn.guidance.helms import (
    Helm,
    held_orders,
    random_orders,
    straight,
    turning_circle,
    williamson_turn,
    zigzag,
)
from aspnn.records import Log, write_log, write_table
from aspnn.schema import InputError
from aspnn.simulation.mmg import Ship, balanced_shaft_speed
from aspnn.simulation.sensors import Sensors, measure
from aspnn.simulation.voyage import simulate, start_states
from aspnn.vessel import load_vessel

KNOT = 1852 / 3600  # m/s
START = "2025-06-01T00:00:00Z"  # a fixed instant: the same scenario gives the same file
BATCH = 50  # voyages integrated at once; more would only take memory
STRICT = ConfigDict(extra="forbid", frozen=True)


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"the range runs from {pair[0]:g} down to {pair[1]:g}; write the lower end first")
    return pair


def _positive(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] <= 0:
        raise ValueError(f"a time of {pair[0]:g} s must be positive")
    return pair


def _zone(text: str) -> str:
    return str(Zone.parse(text))


Range = Annotated[tuple[float, float], AfterValidator(_rising)]
# A number, or [low, high] from which each voyage draws its own.
Drawn = Annotated[Range, BeforeValidator(lambda x: (x, x) if isinstance(x, int | float) else x)]
Bearing = Annotated[Drawn, BeforeValidator(lambda x: (0.0, 360.0) if x == "random" else x)]


class Start(BaseModel):
    """Where midship is and how it moves at time 0: straight ahead through the water, rudder amidships."""

    model_config = STRICT
    speed_kn: Drawn
    latitude_deg: float = Field(ge=-80, le=84)
    longitude_deg: float = Field(ge=-180, le=180)
    zone: Annotated[str, AfterValidator(_zone)]
    heading_deg: Bearing  # true


class Straight(BaseModel):
    """Rudder amidships."""

    model_config = STRICT
    kind: Literal["straight"]
    rudder_deg: ClassVar[float] = 0.0

    def helm(self, rngs: Sequence[np.random.Generator], duration: float) -> Helm:
        """One helm for all voyages of a batch; `rngs` holds a generator per voyage. The same in all manoeuvres."""
        return straight()


class TurningCircle(BaseModel):
    """A turning circle; positive rudder turns to starboard."""

    model_config = STRICT
    kind: Literal["turning-circle"]
    rudder_deg: float
    start_s: float = Field(60.0, ge=0)

    def helm(self, rngs: Sequence[np.random.Generator], duration: float) -> Helm:
        return turning_circle(math.radians(self.rudder_deg), self.start_s)


class Zigzag(BaseModel):
    """A zigzag test; positive rudder begins to starboard."""

    model_config = STRICT
    kind: Literal["zigzag"]
    rudder_deg: float
    heading_change_deg: float = Field(gt=0, le=90)
    start_s: float = Field(60.0, ge=0)

    def helm(self, rngs: Sequence[np.random.Generator], duration: float) -> Helm:
        return zigzag(math.radians(self.rudder_deg), math.radians(self.heading_change_deg), self.start_s)


class WilliamsonTurn(BaseModel):
    """A Williamson turn; positive rudder begins to starboard."""

    model_config = STRICT
    kind: Literal["williamson"]
    rudder_deg: float
    start_s: float = Field(60.0, ge=0)

    def helm(self, rngs: Sequence[np.random.Generator], duration: float) -> Helm:
        return williamson_turn(math.radians(self.rudder_deg), self.start_s)


class RandomOrders(BaseModel):
    """Orders drawn anew for each voyage: multiples of `step_deg` within `rudder_deg`, each held for a time in `hold_s`."""

    model_config = STRICT
    kind: Literal["random-orders"]
    rudder_deg: float = Field(35.0, gt=0)
    step_deg: float = Field(5.0, gt=0)
    hold_s: Annotated[Range, AfterValidator(_positive)] = (60.0, 240.0)

    def helm(self, rngs: Sequence[np.random.Generator], duration: float) -> Helm:
        return held_orders([random_orders(rng, duration, self.rudder_deg, self.step_deg, self.hold_s) for rng in rngs])


class Environment(BaseModel):
    """Steady and uniform current and wind, of the same strength for a whole voyage. Directions are true."""

    model_config = STRICT
    current_kn: Drawn = (0.0, 0.0)
    current_towards_deg: Bearing = (0.0, 0.0)
    wind_kn: Drawn = (0.0, 0.0)
    wind_from_deg: Bearing = (0.0, 0.0)


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
    manoeuvre: Annotated[Straight | TurningCircle | Zigzag | WilliamsonTurn | RandomOrders, Field(discriminator="kind")]
    environment: Environment = Environment()
    sensors: Sensors = Sensors()


def read_scenario(path: str | Path) -> Scenario:
    """Scenario from a TOML file. Raises InputError, one line that names the file, the key and what is wrong with it."""
    return read_toml(path, Scenario, name=Path(path).stem)


def simulate_scenario(
    scenario: Scenario, voyages: int | None = None, seed: int | None = None
) -> Iterator[tuple[Log, pd.DataFrame]]:
    """The logs of a scenario, one voyage after the other, each with its truth (schema.TRUTH) at the epochs of the log.

    `voyages` and `seed` take the place of the scenario's. Voyage k draws from SeedSequence(seed, spawn_key=(k,)) alone, so
    it is the same however many are made; the sensors draw from a stream of their own. Raises InputError.
    """
    vessel = load_vessel(scenario.vessel)
    ship = Ship.of(vessel)
    largest = math.degrees(ship.rudder_max)
    if abs(scenario.manoeuvre.rudder_deg) > largest + 1e-9:
        raise InputError(
            f"scenario {scenario.name}: manoeuvre.rudder_deg = {scenario.manoeuvre.rudder_deg:g} is beyond the"
            f" {largest:g} degrees of {vessel.name}"
        )
    count = scenario.voyages if voyages is None else voyages
    for first in range(0, count, BATCH):
        yield from _batch(scenario, vessel, ship, range(first, min(first + BATCH, count)), seed)


def _batch(scenario, vessel, ship, numbers, seed) -> Iterator[tuple[Log, pd.DataFrame]]:
    own = scenario.seed if seed is None else seed
    streams = [
        [np.random.default_rng(child) for child in np.random.SeedSequence(own, spawn_key=(k,)).spawn(2)]
        for k in numbers
    ]
    zone = Zone.parse(scenario.start.zone)
    place = math.radians(scenario.start.latitude_deg), math.radians(scenario.start.longitude_deg)
    north, east = to_grid(*place, zone)
    gamma = float(convergence(*place, zone))
    start, air = scenario.start, scenario.environment
    ranges = (
        *(start.speed_kn, start.heading_deg),
        *(air.current_kn, air.current_towards_deg, air.wind_kn, air.wind_from_deg),
    )
    drawn = np.array([[rng.uniform(*pair) for pair in ranges] for rng, _ in streams])
    speed, current, wind = drawn[:, [0, 2, 4]].T * KNOT
    heading, towards, wind_from = compass(np.radians(drawn[:, [1, 3, 5]].T) - gamma)
    runs = simulate(
        ship,
        scenario.manoeuvre.helm([rng for rng, _ in streams], scenario.duration_s),
        start_states(north, east, heading, speed),
        scenario.duration_s,
        shaft=[balanced_shaft_speed(ship.mmg, one) for one in speed],
        current=_towards(current, towards),
        wind=_towards(-wind, wind_from),
        dt=scenario.step_s,
    )
    stem = scenario.name if own == scenario.seed else f"{scenario.name}-s{own}"
    for number, run, (_, noise) in zip(numbers, runs, streams, strict=True):
        table, truth = measure(run, vessel, zone, scenario.sensors, noise), run.truth()
        log = Log(
            table=table,
            vessel=vessel,
            zone=zone,
            start=START,
            source=f"simulated by aspnn {__version__}, scenario {scenario.name}, seed {own}, voyage {number}",
            voyage=stem if scenario.voyages == 1 and number == 0 else f"{stem}-{number:04d}",
        )
        yield log, truth[truth["time_s"].isin(table["time_s"])].reset_index(drop=True)


def _towards(speed: np.ndarray, bearing: np.ndarray) -> np.ndarray:
    return np.stack([speed * np.cos(bearing), speed * np.sin(bearing)], axis=-1) + 0.0  # no negative zeros


def write_voyage(log: Log, truth: pd.DataFrame, folder: str | Path) -> Path:
    """Write `VOYAGE.parquet` and, before it, `VOYAGE.truth.parquet` into `folder`; returns the path of the log."""
    path = Path(folder) / f"{log.voyage}.parquet"
    write_table(truth, path.with_suffix(".truth.parquet"), {"kind": "truth", "format": 1, "voyage": log.voyage})
    write_log(log, path)
    return path
