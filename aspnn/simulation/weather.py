"""What a scenario says of the sea: current, wind, waves and depth, each calm unless told, drawn anew for each voyage."""

import math
from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, Field

from aspnn.angles import compass
from aspnn.simulation.environment.current import draw_eddies
from aspnn.simulation.environment.waves import draw_waves
from aspnn.simulation.environment.wind import gust_series
from aspnn.simulation.plan import STRICT, Bearing, Positive, Strength
from aspnn.simulation.sea import Sea

KNOT = 1852 / 3600  # m/s


class Eddies(BaseModel):
    """A current that varies slowly in space and time about the steady one; see `current.draw_eddies`."""

    model_config = STRICT
    speed_kn: Strength  # rms
    length_m: float = Field(2000.0, ge=50)
    period_s: float = Field(3600.0, ge=60)


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


class Environment(BaseModel):
    """The sea of a voyage. Directions are true; numbers may be [low, high], from which each voyage draws its own."""

    model_config = STRICT
    current_kn: Strength = (0.0, 0.0)
    current_towards_deg: Bearing = (0.0, 0.0)
    wind_kn: Strength = (0.0, 0.0)
    wind_from_deg: Bearing = (0.0, 0.0)
    eddies: Eddies | None = None
    gusts: Gusts | None = None
    waves: Waves | None = None
    depth_m: float = Field(default=math.inf, gt=0)

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """What each voyage draws first, for `draw`."""
        return self.current_kn, self.current_towards_deg, self.wind_kn, self.wind_from_deg

    def draw(self, drawn: np.ndarray, gamma: float, rngs: Sequence[np.random.Generator], dt: float, steps: int) -> Sea:
        """The sea of a batch from its `drawn` (batch, 4) `ranges`, at grid convergence `gamma` [rad]; `rngs` one per voyage."""
        current, wind = drawn[:, 0] * KNOT, drawn[:, 2] * KNOT
        towards, wind_from = compass(np.radians(drawn[:, [1, 3]].T) - gamma)
        blowing = _towards(-wind, wind_from)
        if self.gusts is not None:
            height = self.gusts.height_m
            speeds = np.stack([gust_series(rng, one, height, dt, steps) for rng, one in zip(rngs, wind, strict=True)])
            blowing = speeds[..., None] * _towards(-np.ones(len(wind)), wind_from)[:, None]
        fields = {}
        if self.eddies is not None:
            e = self.eddies
            fields["eddies"] = np.stack(
                [draw_eddies(rng, rng.uniform(*e.speed_kn) * KNOT, e.length_m, e.period_s) for rng in rngs]
            )
        if self.waves is not None:
            fields["waves"] = np.stack([self._waves(self.waves, gamma, rng) for rng in rngs])
        return Sea(current=_towards(current, towards), wind=blowing, **fields)

    def _waves(self, w: Waves, gamma: float, rng: np.random.Generator) -> np.ndarray:
        height, period = rng.uniform(*w.height_m), rng.uniform(*w.period_s)
        towards = math.radians(rng.uniform(*w.from_deg)) - gamma + math.pi
        return draw_waves(rng, height, period, towards, w.spreading, w.components, w.gamma, self.depth_m)


def _towards(speed: np.ndarray, bearing: np.ndarray) -> np.ndarray:
    return np.stack([speed * np.cos(bearing), speed * np.sin(bearing)], axis=-1) + 0.0  # no negative zeros
