"""What a scenario says of the sea: current, wind, waves and depth, each calm unless told, drawn anew for each voyage."""

import math
from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, Field

from aspnn.angles import compass
from aspnn.schema import InputError
from aspnn.simulation.environment.current import draw_eddies, stream
from aspnn.simulation.environment.wake import repeats, wake_waves
from aspnn.simulation.environment.waves import draw_waves
from aspnn.simulation.environment.wind import gust_series
from aspnn.simulation.plan import STRICT, Above, Bearing, Drawn, Positive, Strength
from aspnn.simulation.sea import Sea

KNOT = 1852 / 3600  # m/s


class Eddies(BaseModel):
    """A current that varies slowly in space and time about the steady one; see `current.draw_eddies`."""

    model_config = STRICT
    speed_kn: Strength  # rms
    length_m: float = Field(2000.0, ge=50)
    period_s: float = Field(3600.0, ge=60)


class Stream(BaseModel):
    """A steady stream, sheared across, on top of the steady current; see `current.stream`."""

    model_config = STRICT
    speed_kn: Strength  # in its middle
    towards_deg: Bearing = (0.0, 0.0)  # true
    width_m: float = Field(1000.0, ge=50)  # from bank to bank
    offset_m: Drawn = (0.0, 0.0)  # how far its middle lies to the right of the start, looking along the stream


class Gusts(BaseModel):
    """Gusts of the spectrum of `wind.gust_series` about the mean wind, which is that of 10 m height."""

    model_config = STRICT
    height_m: float = Field(10.0, gt=1, le=100)  # where the ship feels them


class Waves(BaseModel):
    """Long- or short-crested waves of a JONSWAP spectrum; see `waves.draw_waves`."""

    model_config = STRICT
    height_m: Strength  # significant
    period_s: Positive  # of the peak
    from_deg: Bearing = (0.0, 0.0)  # true
    gamma: float = Field(3.3, ge=1, le=7)
    spreading: float = Field(math.inf, gt=0)  # exponent s of cos^2s; without it long-crested
    components: int = Field(24, ge=5, le=200)


class Wake(BaseModel):
    """The waves of a ship that passes on a straight course; see `wake.wake_waves`. She is not there otherwise."""

    model_config = STRICT
    speed_kn: Above
    towards_deg: Bearing = (0.0, 0.0)  # true
    height_m: Strength  # of the highest wave, crest to trough, at the distance of the start
    distance_m: Above  # of the start from her track, to starboard of it
    abeam_s: Drawn = (0.0, 0.0)  # when she is abeam of the start
    components: int = Field(128, ge=16, le=1000)


class Environment(BaseModel):
    """The sea of a voyage. Directions are true; numbers may be [low, high], from which each voyage draws its own."""

    model_config = STRICT
    current_kn: Strength = (0.0, 0.0)
    current_towards_deg: Bearing = (0.0, 0.0)
    wind_kn: Strength = (0.0, 0.0)
    wind_from_deg: Bearing = (0.0, 0.0)
    eddies: Eddies | None = None
    stream: Stream | None = None
    gusts: Gusts | None = None
    waves: Waves | None = None
    wake: Wake | None = None
    depth_m: float = Field(default=math.inf, gt=0)

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """What each voyage draws first, for `draw`."""
        return self.current_kn, self.current_towards_deg, self.wind_kn, self.wind_from_deg

    def draw(
        self,
        drawn: np.ndarray,
        gamma: float,
        place: tuple[float, float],
        rngs: Sequence[np.random.Generator],
        dt: float,
        steps: int,
    ) -> Sea:
        """The sea of a batch from its `drawn` (batch, 4) `ranges`, at the start's `place` on the grid (north, east) [m] and its
        convergence `gamma` [rad]; `rngs` one per voyage. Raises InputError for a wake that would come again within the voyage."""
        current, wind = drawn[:, 0] * KNOT, drawn[:, 2] * KNOT
        towards, wind_from = compass(np.radians(drawn[:, [1, 3]].T) - gamma)
        flowing, blowing = _towards(current, towards), _towards(-wind, wind_from)
        if self.gusts is not None:
            height = self.gusts.height_m
            speeds = np.stack([gust_series(rng, one, height, dt, steps) for rng, one in zip(rngs, wind, strict=True)])
            blowing = speeds[..., None] * _towards(-np.ones(len(wind)), wind_from)[:, None]
        modes, waves = [], []
        if self.eddies is not None:
            e = self.eddies
            modes.append([draw_eddies(rng, rng.uniform(*e.speed_kn) * KNOT, e.length_m, e.period_s) for rng in rngs])
        if self.waves is not None:
            waves.append([self._waves(self.waves, gamma, rng) for rng in rngs])
        if self.stream is not None:
            means, sheared = zip(*(self._stream(self.stream, gamma, place, rng) for rng in rngs), strict=True)
            flowing = flowing + np.stack(means)
            modes.append(list(sheared))
        if self.wake is not None:
            slowest, count = self.wake.speed_kn[0] * KNOT, self.wake.components
            if repeats(slowest, count) < dt * steps:
                enough = math.ceil(count * dt * steps / repeats(slowest, count))
                raise InputError(
                    f"environment.wake.components = {count} let the wake come again after {repeats(slowest, count):.0f} s, within the"
                    f" voyage of {dt * steps:.0f} s; take at least {enough}"
                )
            waves.append([self._wake(self.wake, gamma, place, rng) for rng in rngs])
        fields = {"eddies": modes, "waves": waves}
        parts = {
            name: np.concatenate([np.stack(one) for one in kinds], axis=1) for name, kinds in fields.items() if kinds
        }
        return Sea(current=flowing, wind=blowing, **parts)

    def _stream(self, s: Stream, gamma: float, place: tuple[float, float], rng: np.random.Generator):
        speed, towards = rng.uniform(*s.speed_kn) * KNOT, math.radians(rng.uniform(*s.towards_deg)) - gamma
        offset = rng.uniform(*s.offset_m)
        middle = place[0] - offset * math.sin(towards), place[1] + offset * math.cos(towards)
        return stream(speed, towards, s.width_m, middle)

    def _wake(self, w: Wake, gamma: float, place: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
        speed, course = rng.uniform(*w.speed_kn) * KNOT, math.radians(rng.uniform(*w.towards_deg)) - gamma
        height, distance, time = (rng.uniform(*drawn) for drawn in (w.height_m, w.distance_m, w.abeam_s))
        abeam = place[0] + distance * math.sin(course), place[1] - distance * math.cos(course)
        return wake_waves(speed, course, abeam, time, height, distance, w.components)

    def _waves(self, w: Waves, gamma: float, rng: np.random.Generator) -> np.ndarray:
        height, period = rng.uniform(*w.height_m), rng.uniform(*w.period_s)
        towards = math.radians(rng.uniform(*w.from_deg)) - gamma + math.pi
        return draw_waves(rng, height, period, towards, w.spreading, w.components, w.gamma, self.depth_m)


def _towards(speed: np.ndarray, bearing: np.ndarray) -> np.ndarray:
    return np.stack([speed * np.cos(bearing), speed * np.sin(bearing)], axis=-1) + 0.0  # no negative zeros
