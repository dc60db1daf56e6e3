"""The servos of a ship: how its rudder and shaft follow their orders, as identified from its logs. Torch-free."""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from aspnn.orders import Orders
from aspnn.records import States
from aspnn.vessel import Vessel


@dataclass(frozen=True)
class Servo:
    """A rudder machine or an engine, in the unit of what it moves (rad, rev/s): see Orders.servo."""

    rate: float
    lag: float = 0.0
    delay: float = 0.0
    dead_band: float = 0.0

    def follow(self, orders: Orders, time, start: float) -> np.ndarray:
        """What it makes of the orders, from `start` at the first of `time` [s]."""
        return orders.servo(time, start, self.rate, self.lag, self.delay, self.dead_band)


@dataclass(frozen=True)
class Identified:
    """A servo, the standard errors of its parts (0: not sought) and the number of order changes that told.

    `error` is None for a servo that is the vessel file's. `measured`: whether logs held what it moves; where they did not,
    the rudder angle of all states is what this servo makes of the orders.
    """

    servo: Servo
    error: Servo | None = None
    changes: int = 0
    measured: bool = True


@dataclass(frozen=True)
class Servos:
    """The servos of a ship; without one of the shaft, its speed is what is ordered."""

    rudder: Identified
    shaft: Identified | None = None

    @staticmethod
    def of(vessel: Vessel) -> "Servos":
        """The servo of a vessel file: its rudder's rate."""
        return Servos(Identified(Servo(vessel.rudder_rate)))

    def to_dict(self) -> dict[str, Any]:
        """As plain data; `from_dict` reads it back unchanged."""
        return asdict(self)

    @staticmethod
    def from_dict(data: dict[str, Any]) -> "Servos":
        """Servos from plain data. Raises KeyError or TypeError for any other."""

        def one(part: dict[str, Any]) -> Identified:
            error = None if part["error"] is None else Servo(**part["error"])
            return Identified(**part | {"servo": Servo(**part["servo"]), "error": error})

        return Servos(one(data["rudder"]), None if data["shaft"] is None else one(data["shaft"]))

    def sailed(self, states: States) -> States:
        """The states with the rudder angle by this servo, where training voyages had only the orders; else as they are."""
        if self.rudder.measured or self.rudder.error is None:
            return states
        time, angle = states["time_s"], states["rudder_angle_rad"]
        orders = Orders.from_series(time, states["rudder_order_rad"])
        return replace(
            states, table=states.table.assign(rudder_angle_rad=self.rudder.servo.follow(orders, time, float(angle[0])))
        )

    def lines(self) -> dict[str, str]:
        """What a model card says of each."""
        found = {"rudder servo": told(self.rudder, math.degrees(1), "deg", "angle")}
        if self.shaft is not None:
            found["shaft servo"] = told(self.shaft, 1.0, "rps", "speed")
        return found


def told(found: Identified, unit: float, name: str, what: str) -> str:
    """A servo in words, its rate and dead band times `unit` in units of `name`."""
    s, e = found.servo, found.error
    if e is None:
        return f"{s.rate * unit:.3g} {name}/s by the vessel file; {found.changes} order changes did not tell"
    parts = [
        f"{s.rate * unit:.3g} ± {e.rate * unit:.2g} {name}/s" if e.rate else f"{s.rate * unit:.3g} {name}/s (file)"
    ]
    parts += [f"lag {s.lag:.2g} ± {e.lag:.1g} s"] * (s.lag > 0) + [f"delay {s.delay:.2g} ± {e.delay:.1g} s"] * (
        s.delay > 0
    )
    parts += [f"dead band {s.dead_band * unit:.2g} ± {e.dead_band * unit:.1g} {name}"] * (s.dead_band > 0)
    source = f"the measured {what}" if found.measured else "the ship's motion"
    return f"{', '.join(parts)}; identified by {source} at {found.changes} order changes"
