"""What a scenario asks of ship and engine: the parts of a scenario file that say where it starts and what is ordered.

Manoeuvres that close a loop round the ship (routes, courses) are in `routes`.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from aspnn.frames import Zone
from aspnn.guidance.helms import Helm, random_orders, steady_heading, williamson_turn, zigzag
from aspnn.orders import Orders
from aspnn.simulation.ship import Ship

STRICT = ConfigDict(extra="forbid", frozen=True)
Ordered = Helm | list[Orders]  # a helm, or the orders of each voyage known beforehand


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"the range runs from {pair[0]:g} down to {pair[1]:g}; write the lower end first")
    return pair


def _positive(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] <= 0:
        raise ValueError(f"{pair[0]:g} s is no time, which must be positive")
    return pair


def _above(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] <= 0:
        raise ValueError(f"{pair[0]:g} must be above 0")
    return pair


def _not_negative(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] < 0:
        raise ValueError(f"{pair[0]:g} is negative; turn the direction instead")
    return pair


def _in_order(series: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    times = [time for time, _ in series]
    if not times or times[0] != 0 or any(b <= a for a, b in pairwise(times)):
        raise ValueError("orders are [seconds, order] with rising times, the first at 0")
    return series


def _zone(text: str) -> str:
    return str(Zone.parse(text))


Range = Annotated[tuple[float, float], AfterValidator(_rising)]
# A number, or [low, high] from which each voyage draws its own.
Drawn = Annotated[Range, BeforeValidator(lambda x: (x, x) if isinstance(x, int | float) else x)]
Strength = Annotated[Drawn, AfterValidator(_not_negative)]
Positive = Annotated[Drawn, AfterValidator(_positive)]
Above = Annotated[Drawn, AfterValidator(_above)]
Bearing = Annotated[Drawn, BeforeValidator(lambda x: (0.0, 360.0) if x == "random" else x)]
Hold = Annotated[Range, AfterValidator(_positive)]
Series = Annotated[tuple[tuple[float, float], ...], AfterValidator(_in_order)]


class Start(BaseModel):
    """Where midship is and how it moves at time 0: straight ahead through the water, rudder amidships."""

    model_config = STRICT
    speed_kn: Drawn
    latitude_deg: float = Field(ge=-80, le=84)
    longitude_deg: float = Field(ge=-180, le=180)
    zone: Annotated[str, AfterValidator(_zone)]
    heading_deg: Bearing  # true


class Departure(NamedTuple):
    """What a manoeuvre may know of the voyages of a batch when they begin: place and heading of the grid, SI and radians.

    `speeds` are the least and the greatest that a start is drawn from; `speed` the middle of them, which a helm is tuned for.
    """

    ship: Ship
    zone: Zone
    north: float
    east: float
    heading: np.ndarray  # (batch,)
    convergence: float
    speeds: tuple[float, float]
    duration: float
    step: float

    @property
    def speed(self) -> float:
        """What a helm is tuned for; the service speed where voyages start at rest."""
        return 0.5 * sum(self.speeds) or self.ship.service_speed


class Straight(BaseModel):
    """Rudder amidships."""

    model_config = STRICT
    kind: Literal["straight"]
    rudder_deg: ClassVar[float] = 0.0

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Ordered:
        """What steers the voyages of a batch that is `leaving`; `rngs` holds a generator per voyage. The same in all manoeuvres."""
        return [Orders(np.array([0.0]), np.array([0.0]))] * len(rngs)


class TurningCircle(BaseModel):
    """A turning circle; positive rudder turns to starboard."""

    model_config = STRICT
    kind: Literal["turning-circle"]
    rudder_deg: float
    start_s: float = Field(60.0, ge=0)

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Ordered:
        order = Orders(np.array([-np.inf, self.start_s]), np.array([0.0, math.radians(self.rudder_deg)]))
        return [order] * len(rngs)


class Zigzag(BaseModel):
    """A zigzag test; positive rudder begins to starboard."""

    model_config = STRICT
    kind: Literal["zigzag"]
    rudder_deg: float
    heading_change_deg: float = Field(gt=0, le=90)
    start_s: float = Field(60.0, ge=0)

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Ordered:
        return zigzag(math.radians(self.rudder_deg), math.radians(self.heading_change_deg), self.start_s)


class WilliamsonTurn(BaseModel):
    """A Williamson turn; positive rudder begins to starboard."""

    model_config = STRICT
    kind: Literal["williamson"]
    rudder_deg: float
    start_s: float = Field(60.0, ge=0)

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Ordered:
        return williamson_turn(math.radians(self.rudder_deg), self.start_s)


class RandomOrders(BaseModel):
    """Orders drawn anew for each voyage: multiples of `step_deg` within `rudder_deg`, each held for a time in `hold_s`."""

    model_config = STRICT
    kind: Literal["random-orders"]
    rudder_deg: float = Field(35.0, gt=0)
    step_deg: float = Field(5.0, gt=0)
    hold_s: Hold = (60.0, 240.0)

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Ordered:
        return [random_orders(rng, leaving.duration, self.rudder_deg, self.step_deg, self.hold_s) for rng in rngs]


class Prescribed(BaseModel):
    """Orders as listed: [seconds, degrees], the last is held."""

    model_config = STRICT
    kind: Literal["orders"]
    orders_deg: Series

    @property
    def rudder_deg(self) -> float:
        """The largest order [deg]."""
        return max((order for _, order in self.orders_deg), key=abs)

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Ordered:
        return [_orders(self.orders_deg, math.radians(1.0))] * len(rngs)


class Course(BaseModel):
    """An autopilot that keeps the heading of the start: rudder = gain x (error - lead x yaw rate), within `rudder_deg`."""

    model_config = STRICT
    kind: Literal["keep-heading"]
    rudder_deg: float = Field(20.0, gt=0)
    gain: float = Field(1.5, gt=0)
    lead_s: float = Field(15.0, ge=0)

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Ordered:
        return steady_heading(self.gain, self.lead_s, math.radians(self.rudder_deg))


class PrescribedEngine(BaseModel):
    """Shaft speed (and pitch) orders as listed: [seconds, rev/s] and [seconds, pitch ratio]; the start is in balance till then."""

    model_config = STRICT
    kind: Literal["orders"]
    shaft_rps: Series | None = None
    pitch_ratio: Series | None = None

    def levers(self, rngs: Sequence[np.random.Generator], duration: float):
        """Orders of shaft and of pitch, per voyage, or None where they are left alone. The same in all engines."""
        return tuple(None if s is None else [_orders(s)] * len(rngs) for s in (self.shaft_rps, self.pitch_ratio))


class RandomEngine(BaseModel):
    """Orders drawn anew for each voyage, uniform in `shaft_rps` (and `pitch_ratio`), each held for a time in `hold_s`."""

    model_config = STRICT
    kind: Literal["random-orders"]
    shaft_rps: Range | None = None
    pitch_ratio: Range | None = None
    hold_s: Hold = (120.0, 600.0)

    def levers(self, rngs: Sequence[np.random.Generator], duration: float):
        return tuple(
            None if r is None else [self._drawn(rng, r, duration) for rng in rngs]
            for r in (self.shaft_rps, self.pitch_ratio)
        )

    def _drawn(self, rng: np.random.Generator, limits: tuple[float, float], duration: float) -> Orders:
        times, end = [0.0], rng.uniform(*self.hold_s)
        while end < duration:
            times.append(end)
            end += rng.uniform(*self.hold_s)
        return Orders(np.array(times), rng.uniform(*limits, len(times)))


Engine = Annotated[PrescribedEngine | RandomEngine, Field(discriminator="kind")]


def _orders(series: tuple[tuple[float, float], ...], unit: float = 1.0) -> Orders:
    times, values = np.array(series).T
    return Orders(times, values * unit)
