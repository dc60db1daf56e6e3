"""The bridge simulator: MMG ships under a helm, in current and wind, and the sensors that record them.

Depends on guidance, frames, orders, vessel, records and schema.
"""

from aspnn.simulation.indices import TurningCircle, turning_circle_indices, zigzag_overshoots
from aspnn.simulation.mmg import Mmg, Ship, balanced_shaft_speed
from aspnn.simulation.scenario import Scenario, read_scenario, simulate_scenario, write_voyage
from aspnn.simulation.sensors import Sensors, measure
from aspnn.simulation.voyage import Voyage, run_on, simulate, start_states

__all__ = [
    "Mmg",
    "Scenario",
    "Sensors",
    "Ship",
    "TurningCircle",
    "Voyage",
    "balanced_shaft_speed",
    "measure",
    "read_scenario",
    "run_on",
    "simulate",
    "simulate_scenario",
    "start_states",
    "turning_circle_indices",
    "write_voyage",
    "zigzag_overshoots",
]
