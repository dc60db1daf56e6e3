"""The sea around a batch of ships: current, wind and waves, each calm unless told."""

from dataclasses import dataclass, field

import numpy as np

from aspnn.schema import InputError
from aspnn.simulation.environment.drift import Drift
from aspnn.simulation.environment.waves import Excitation
from aspnn.simulation.integrate import Water, calm
from aspnn.simulation.ship import Ship


def _calm() -> np.ndarray:
    return np.zeros(2)


def _none() -> np.ndarray:
    return np.zeros((0, 5))


@dataclass(frozen=True)
class Sea:
    """Velocities of water and air [m/s] towards north and east, eddies of the current and components of the waves.

    `current` (2,) or (batch, 2); `eddies` (m, 5) or (batch, m, 5), see `current`; `wind` (2,), (batch, 2) or, one value a
    step, (batch, steps, 2); `waves` (n, 5) or (batch, n, 5), see `waves`.
    """

    current: np.ndarray = field(default_factory=_calm)
    eddies: np.ndarray = field(default_factory=_none)
    wind: np.ndarray = field(default_factory=_calm)
    waves: np.ndarray = field(default_factory=_none)

    def around(self, ship: Ship, batch: int) -> Water:
        """The sea for compiled code. Raises InputError where the ship has no loads for it."""
        wind = np.asarray(self.wind, float)
        wind = wind if wind.ndim == 3 else np.broadcast_to(wind, (batch, 2))[:, None]
        if wind.any() and ship.air.A_L == 0:
            raise InputError(f"{ship.vessel.label}: has no section wind, so it cannot be simulated in wind")
        eddies, waves = (np.asarray(a, float) for a in (self.eddies, self.waves))
        water = calm(batch)._replace(
            current=np.array(np.broadcast_to(self.current, (batch, 2)), float),
            eddies=np.ascontiguousarray(np.broadcast_to(eddies, (batch, *eddies.shape[-2:]))),
            wind=np.ascontiguousarray(np.broadcast_to(wind, (batch, *wind.shape[1:]))),
        )
        if waves.shape[-2] == 0:
            return water
        each = np.broadcast_to(waves, (batch, *waves.shape[-2:]))
        if ship.box is not None:
            pressed = [Excitation.of(one, ship.box) for one in each]
            return water._replace(excitation=Excitation(*(np.stack(part) for part in zip(*pressed, strict=True))))
        pushed = [Drift.of(ship.vessel, one) for one in each]
        wave, load = (np.stack([getattr(one, name) for one in pushed]) for name in ("wave", "load"))
        return water._replace(drift=Drift(wave, load, pushed[0].fastest))

    def first_order(self, ship: Ship, batch: int) -> list[np.ndarray | None]:
        """The waves (n, 5) whose first-order motion comes on top of each ship's path: none where the ship itself answers to them."""
        waves = np.asarray(self.waves, float)
        if waves.shape[-2] == 0 or ship.box is not None:
            return [None] * batch
        return list(np.broadcast_to(waves, (batch, *waves.shape[-2:])))
