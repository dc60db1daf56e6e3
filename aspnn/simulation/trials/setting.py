"""What a manoeuvring trial starts from: the ship, its speed, the length that criteria go by, and the steady approach."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aspnn.guidance import helms
from aspnn.guidance.helms import Helm
from aspnn.orders import Orders
from aspnn.schema import InputError
from aspnn.simulation.ship import Ship
from aspnn.simulation.ships.mariner import Mariner
from aspnn.simulation.ships.mmg import Mmg
from aspnn.simulation.voyage import Voyage, run_on, simulate
from aspnn.vessel import Vessel

STEPS = 500  # per L / V; a zigzag's reversal is then noticed within 0.03 degrees
COARSE = 20  # where only steady states count


@dataclass(frozen=True)
class Setting:
    """What a trial starts from: the ship, the speed V [m/s], and the length L [m] that the criteria go by, with its name."""

    ship: Ship
    speed: float
    length: float
    length_name: str

    @staticmethod
    def of(vessel: Vessel, speed: float | None) -> "Setting":
        """The trial of a vessel at `speed` [m/s], without it at its service speed. Raises InputError for one that is no speed."""
        speed = vessel.service_speed if speed is None else speed
        if not 0 < speed < math.inf:
            raise InputError(f"{vessel.label}: a test speed of {speed:g} m/s; give one above 0")
        ship = Ship.of(vessel)
        return Setting(ship, speed, *reference_length(ship))

    @property
    def unit(self) -> float:
        """L / V [s], the time the ship takes for its own length."""
        return self.length / self.speed

    def rudder(self, asked: float | None, usual: float) -> float:
        """The rudder angle [rad] of a trial: `asked`, else the usual one, at most what the rudder does. Raises InputError."""
        most = self.ship.rudder.most
        if asked is None:
            return min(usual, most)
        if not 0 < asked <= most + 1e-9:
            raise InputError(
                f"{self.ship.vessel.label}: a trial with {math.degrees(asked):g} deg of rudder; give an angle above 0,"
                f" up to the stop at {math.degrees(most):g} deg"
            )
        return asked

    def step(self, steps: int) -> float:
        """The time step [s]: that many per L / V, and more where a mode of the ship asks for it."""
        return self.unit / math.ceil(max(steps, self.unit / self.ship.largest_step(self.speed)))

    def approach(self, ships: int) -> np.ndarray:
        """Start states (ships, columns): steady and straight along north; a boat of six degrees has found its trim."""
        start = self.ship.start(0.0, 0.0, np.zeros(ships), self.speed)
        if self.ship.columns == helms.COLUMNS:
            return start
        dt = self.step(COARSE)
        orders = np.zeros((1, round(20 * self.unit / dt)))
        start[:] = run_on(self.ship, start[:1], orders, dt=dt)[0, -1]
        start[:, [helms.NORTH, helms.EAST, helms.HEADING]] = 0.0
        return start

    def run(
        self,
        helm: Helm | Sequence[Orders] | np.ndarray,
        ships: int,
        lengths: float,
        steps: int = STEPS,
        shaft: float | None = None,
        pitch: float | None = None,
    ) -> list[Voyage]:
        """Voyages of `ships` ships over the time of so many lengths."""
        start, dt = self.approach(ships), self.step(steps)
        return simulate(self.ship, helm, start, lengths * self.unit, shaft=shaft, pitch=pitch, dt=dt)


def reference_length(ship: Ship) -> tuple[float, str]:
    """The length [m] that criteria go by, and its name: between perpendiculars where the model has it, else overall."""
    if isinstance(ship.model, Mmg):
        return ship.model.Lpp, "length between perpendiculars"
    if isinstance(ship.model, Mariner):
        return ship.model.L, "length between perpendiculars"
    return ship.vessel.length, "length overall"
