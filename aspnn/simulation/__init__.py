"""The bridge simulator: ships and boats under a helm, in current, wind and waves, and the sensors that record them.

Depends on guidance, frames, orders, vessel, records and schema.
"""

from aspnn.simulation.scenario import Scenario, read_scenario, simulate_scenario, write_voyage
from aspnn.simulation.sea import Sea
from aspnn.simulation.sensing.sensors import Sensors, measure
from aspnn.simulation.ship import Ship
from aspnn.simulation.ships.mmg import Mmg
from aspnn.simulation.trials.indices import TurningCircle, turning_circle_indices, zigzag_overshoots
from aspnn.simulation.voyage import Voyage, run_on, simulate

__all__ = [
    "Mmg",
    "Scenario",
    "Sea",
    "Sensors",
    "Ship",
    "TurningCircle",
    "Voyage",
    "measure",
    "read_scenario",
    "run_on",
    "simulate",
    "simulate_scenario",
    "turning_circle_indices",
    "write_voyage",
    "zigzag_overshoots",
]
