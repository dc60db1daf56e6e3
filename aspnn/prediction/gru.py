"""The learned predictor: a checkpoint's network gives the velocities, the pivot point or the exact step gives the path."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np
import torch

from aspnn.learning.checkpoint import Bundle, read_bundle
from aspnn.learning.features import forcing, history
from aspnn.learning.windows import WIND_MEMORY, start_wind
from aspnn.motion import Path, integrate, region_map_path, two_station_motion
from aspnn.orders import Plan
from aspnn.prediction.plan import Orderable, make_plan
from aspnn.records import States
from aspnn.schema import InputError


@dataclass(frozen=True)
class GruPredictor:
    """Predictor by a trained GRU. `region_map` chooses the path: Paper V's region-mapped pivot point, or the exact step."""

    bundle: Bundle
    region_map: bool = False

    @staticmethod
    def load(folder: str | FilePath) -> "GruPredictor":
        """The predictor of a checkpoint folder, with the way to the path that it was made for."""
        bundle = read_bundle(folder)
        return GruPredictor(bundle, bundle.region_map)

    @property
    def name(self) -> str:
        """The bundle's own name."""
        return self.bundle.name

    @property
    def horizon(self) -> float:
        """How far it predicts [s]."""
        return self.bundle.spec.horizon

    def predict(self, states: States, rudder_plan: Orderable = None, shaft_plan: Orderable = None) -> Path:
        """Path from the last of `states`, if the plan is followed (default: the orders in force are held).

        `rudder_plan` [rad] is one angle, or (seconds from now, angle) pairs from 0 on; `shaft_plan` [rev/s] likewise.
        Raises InputError for a plan beyond horizon or limits, too short a history, or another vessel's states.
        """
        plan = make_plan(states, rudder_plan, shaft_plan, self.horizon)
        # A long voyage is not read again for every prediction: the history and what the mean wind needs are enough.
        time = states["time_s"]
        first = np.searchsorted(time, time[-1] - max(self.bundle.spec.history, WIND_MEMORY)) - 1
        recent = replace(states, table=states.table.iloc[max(first, 0) :])
        return self.predict_many(recent, np.array([len(recent) - 1]), [plan])[0]

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """Paths (n, steps) from each of `rows` under each of `plans`; only rows up to each start are read."""
        bundle, spec, vessel = self.bundle, self.bundle.spec, self.bundle.vessel
        check_vessel(states, bundle)
        rows = np.asarray(rows, int)
        past = history(states, rows, spec.inputs, spec.history_steps, spec.period)
        if "rudder_order" in spec.inputs:
            past[:, -1, spec.inputs.index("rudder_order")] = [plan.rudder.at(0.0) for plan in plans]
        angle, shaft = states["rudder_angle_rad"][rows], states["shaft_speed_rps"][rows]
        known = [forcing(vessel, angle[k], shaft[k], plan, spec.forcings, spec.time) for k, plan in enumerate(plans)]
        with torch.inference_mode():
            inputs = (past, np.stack(known), start_wind(states, rows))
            velocities = bundle.network(*(torch.from_numpy(a.astype(np.float32)) for a in inputs)).numpy().astype(float)
        pose = np.stack([states[k][rows] for k in ("north_m", "east_m", "heading_rad")], axis=-1)
        path = self._path(pose, velocities)
        return replace(path, convergence=states["convergence_rad"][rows])

    def _path(self, pose: np.ndarray, velocities: np.ndarray) -> Path:
        spec, vessel = self.bundle.spec, self.bundle.vessel
        bow, stern = vessel.sway_stations
        mean = (velocities[:, 1:] + velocities[:, :-1]) / 2
        if self.region_map:
            surge, sway_bow, sway_stern = np.moveaxis(mean, -1, 0)
            return region_map_path(pose, surge, sway_bow, sway_stern, spec.period, bow, stern, vessel.length)
        sway, yaw_rate = two_station_motion(mean[..., 1], mean[..., 2], bow, stern)
        return integrate(pose, np.stack([mean[..., 0], sway, yaw_rate], axis=-1), spec.period)


def check_vessel(states: States, bundle: Bundle) -> None:
    """Refuse states of another vessel, or with other sway stations. Raises InputError naming both."""
    have, want = states.vessel, bundle.vessel
    if have.name != want.name:
        raise InputError(
            f"{states.path or 'states'}: vessel {have.name}, but checkpoint {bundle.name} was trained on {want.name}"
        )
    for what, a, b in (
        ("length", have.length, want.length),
        ("bow station", have.sway_stations[0], want.sway_stations[0]),
        ("stern station", have.sway_stations[1], want.sway_stations[1]),
    ):
        if abs(a - b) > 1e-3 * want.length:
            raise InputError(
                f"{states.path or 'states'}: {what} {a:g} m of {have.name}, the checkpoint was trained with {b:g} m"
            )
