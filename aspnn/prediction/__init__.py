"""Predictors: from filtered states and a plan to a path. No plotting and no Lightning is imported here."""

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Protocol

import numpy as np

from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.prediction.kinematic import KinematicPredictor, baselines, caa_cmm, caa_ctra, constant
from aspnn.prediction.plan import Orderable, make_plan
from aspnn.records import States

if TYPE_CHECKING:
    from aspnn.prediction.gru import GruPredictor
    from aspnn.prediction.onnx import OnnxPredictor

__all__ = ["KinematicPredictor", "Predictor", "baselines", "caa_cmm", "caa_ctra", "constant", "make_plan"]


class Predictor(Protocol):
    """What every predictor offers. It looks at the states up to the start only; the plan is what is known of the future."""

    @property
    def name(self) -> str: ...

    @property
    def horizon(self) -> float: ...

    def predict(self, states: States, rudder_plan: Orderable = None, shaft_plan: Orderable = None) -> Path:
        """Path from the last of `states`, if the plan is followed."""
        ...

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """Paths (n, steps) from each of `rows` of a voyage, each under its plan; time runs from 0 to the horizon."""
        ...

    @staticmethod
    def load(checkpoint: str | FilePath) -> "GruPredictor | OnnxPredictor":
        """The predictor of a checkpoint folder, or (by its ending) of an exported .onnx file, which takes no torch."""
        if FilePath(checkpoint).suffix == ".onnx":
            from aspnn.prediction.onnx import OnnxPredictor

            return OnnxPredictor.load(checkpoint)
        from aspnn.prediction.gru import GruPredictor

        return GruPredictor.load(checkpoint)
