"""The oracle: the true simulator run on from the filtered state.

What remains is the error of that state. A network that reads the history can start better than the last filtered state, and so pass it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aspnn.evaluation.evaluate import ORACLE
from aspnn.evaluation.reference import Voyage
from aspnn.evaluation.windows import Rule
from aspnn.frames import to_body
from aspnn.guidance.helms import EAST, HEADING, NORTH, PITCH_RATIO, RUDDER, SHAFT, SURGE, SWAY, YAW_RATE
from aspnn.motion import Path, pivot_point
from aspnn.motion.path import YAW_RATE_FLOOR
from aspnn.orders import Plan
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.simulation.sea import Sea
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import run_on

STEP = 0.1  # s, the integration step that simulated voyages are made with


@dataclass(frozen=True)
class Oracle:
    """The simulator of one voyage, knowing its ship, current and (only if `knows_wind`) wind, but not its exact state.

    The state is the filtered one, the rudder angle that of the states; the shaft follows the plan, without one it stays
    as the truth has it at the start.
    """

    ship: Ship
    truth: pd.DataFrame
    horizon: float
    knows_wind: bool = False
    name: str = ORACLE

    @staticmethod
    def of(voyage: Voyage, horizon: float | None = None, knows_wind: bool = False) -> "Oracle":
        """The oracle of a simulated voyage, over the longest horizon of its vessel's rule unless `horizon` [s] is given.

        Raises InputError where there is no truth or the vessel cannot be simulated.
        """
        if voyage.truth is None:
            raise InputError(f"{voyage.name} has no truth beside it, so there is no oracle")
        vessel = voyage.states.vessel
        return Oracle(Ship.of(vessel), voyage.truth, horizon or Rule.of(vessel).horizon, knows_wind)

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """Paths (n, steps + 1) over the horizon from each of `rows`, under `plans`. The first point is the state itself."""
        time = np.arange(round(self.horizon / STEP) + 1) * STEP
        known = np.stack([states[name][rows] for name in _STATE], axis=-1)
        heading = known[:, HEADING]
        true = self._true(states["time_s"][rows])
        current = np.stack([true["current_north_m_s"], true["current_east_m_s"]], axis=-1)
        forward, starboard = to_body(current[:, 0], current[:, 1], heading)
        start = np.tile(self.ship.start(0.0, 0.0, 0.0, self.ship.service_speed), (len(rows), 1))
        start[:, : RUDDER + 1] = known
        start[:, SURGE] -= forward
        start[:, SWAY] -= starboard
        start[:, SHAFT] = true["shaft_speed_rps"]
        if "propeller_pitch_ratio" in true:
            start[:, PITCH_RATIO] = true["propeller_pitch_ratio"]
        rudder, engine = self.ship.rudder, self.ship.shaft
        orders = np.clip(np.stack([plan.rudder.at(time[:-1]) for plan in plans]), rudder.least, rudder.most)
        shaft = np.stack(
            [
                np.full(len(time) - 1, held) if plan.shaft is None else plan.shaft.at(time[:-1])
                for plan, held in zip(plans, true["shaft_speed_rps"], strict=True)
            ]
        )
        towards = true["wind_from_grid_rad"] + np.pi
        wind = true["wind_speed_true_m_s"][:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=-1)
        sea = Sea(current=current, wind=wind if self.knows_wind else np.zeros(2))
        run = run_on(self.ship, start, orders, np.clip(shaft, engine.least, engine.most), sea=sea, dt=STEP)
        forward, starboard = to_body(current[:, :1], current[:, 1:], run[..., HEADING])
        surge, sway, yaw_rate = run[..., SURGE] + forward, run[..., SWAY] + starboard, run[..., YAW_RATE]
        pivot = pivot_point(sway, yaw_rate, YAW_RATE_FLOOR / 3)
        return Path(time, run[..., NORTH], run[..., EAST], run[..., HEADING], surge, sway, yaw_rate, pivot)

    def _true(self, time: np.ndarray) -> dict[str, np.ndarray]:
        """The truth's environment and shaft at `time` [s], from the last row that is not later."""
        rows = np.searchsorted(self.truth["time_s"].to_numpy(), time + 1e-6, side="right") - 1
        return {name: self.truth[name].to_numpy(float)[rows] for name in _ENVIRONMENT if name in self.truth}


_STATE = (
    *("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s"),
    "rudder_angle_rad",
)
_ENVIRONMENT = (
    *("current_north_m_s", "current_east_m_s", "wind_speed_true_m_s", "wind_from_grid_rad"),
    *("shaft_speed_rps", "propeller_pitch_ratio"),
)
