"""The learned predictor run by torch: a checkpoint's network gives the velocities, `carried` and `learned` all around it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path as FilePath

import numpy as np
import torch

from aspnn.learning import compiled
from aspnn.learning.checkpoint import Bundle, read_bundle
from aspnn.learning.network import RolloutEnsemble, RolloutGru
from aspnn.learning.windows import WindowSpec
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.prediction import carried
from aspnn.prediction.choice import HybridChoice
from aspnn.prediction.fan import fan
from aspnn.prediction.plan import Orderable
from aspnn.prediction.uncertainty import Calibration
from aspnn.records import States

FEW = 128  # rows: a fan of 25 plans with its perturbed starts. From several hundred on torch is as fast


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
    def contract(self) -> Bundle:
        """What the checkpoint says of its network."""
        return self.bundle

    @property
    def spec(self) -> WindowSpec:
        """What the network sees, and how far it predicts."""
        return self.bundle.spec

    @property
    def alone(self) -> "GruPredictor":
        """The network without choice and regions, under the name NAME-network: a part of the choice, to be shown beside it."""
        bundle = replace(self.bundle, name=f"{self.name}-network", choice=None, calibration=None)
        return GruPredictor(bundle, self.region_map)

    @property
    def horizon(self) -> float:
        """How far it predicts [s]."""
        return self.bundle.spec.horizon

    def predict(self, states: States, rudder_plan: Orderable = None, shaft_plan: Orderable = None) -> Path:
        """Path from the last of `states`, if the plan is followed (default: the orders in force are held).

        `rudder_plan` [rad] is one angle, or (seconds from now, angle) pairs from 0 on; `shaft_plan` [rev/s] likewise.
        Raises InputError for a plan beyond horizon or limits, too short a history, or another vessel's states.
        """
        how = (self.bundle, self.velocities, self.calibration)
        return carried.predict_one(*how, states, rudder_plan, shaft_plan, self.region_map, self.choice)

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """Paths (n, steps) from each of `rows` under each of `plans`, with regions where the checkpoint was calibrated.

        Only rows up to each start are read.
        """
        how = (self.bundle, self.velocities, self.calibration)
        return carried.predict_rows(*how, states, rows, plans, self.region_map, self.choice)

    def fan(self, states: States, orders: Sequence[Orderable], shaft_plan: Orderable = None) -> Path:
        """Paths (len(orders), steps) from the last of `states` under each of `orders`, as `prediction.fan.fan`."""
        return fan(self, carried.recent(self.bundle, self.calibration, states, self.choice), orders, shaft_plan)

    def predict_carried(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> tuple[Path, np.ndarray]:
        """Paths without regions, and their covariance (n, steps, 3, 3) by the filter's errors: what calibration needs."""
        path, covariance, _ = carried.predict_carried(
            self.bundle, self.velocities, states, rows, plans, self.region_map
        )
        if self.choice is not None:
            path = self.choice.mix(path, self.bundle.vessel, states, rows, plans)
        return path, covariance

    @cached_property
    def calibration(self) -> Calibration | None:
        """What `aspnn calibrate` found, for the way to the path it was found with; else None. Raises InputError."""
        found = self.bundle.calibration
        if found is None or self.region_map != self.bundle.region_map:
            return None
        return Calibration.from_dict(found, self.bundle.name)

    @cached_property
    def choice(self) -> HybridChoice | None:
        """What `aspnn choose` left to kinematics, for the way to the path it was found with; else None. Raises InputError."""
        found = self.bundle.choice
        if found is None or self.region_map != self.bundle.region_map:
            return None
        return HybridChoice.from_dict(found, self.name)

    @cached_property
    def weights(self) -> list[compiled.Weights]:
        """The network's weights for `compiled`; none for a network that it does not know."""
        network = self.bundle.network
        return compiled.weights_of(network) if isinstance(network, RolloutGru | RolloutEnsemble) else []

    def velocities(self, *inputs: np.ndarray) -> np.ndarray:
        """The network's answer to history, forcing and wind, in float64; a few rows without torch, which takes longer."""
        if self.weights and len(inputs[0]) <= FEW:
            return compiled.velocities(self.weights, *inputs)
        with torch.inference_mode():
            return self.bundle.network(*(torch.from_numpy(a.astype(np.float32)) for a in inputs)).numpy().astype(float)
