"""The learned predictor without torch: one .onnx file that `aspnn export` wrote, run by onnxruntime."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from aspnn.learning.servo import Servos
from aspnn.learning.windows import WindowSpec
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.prediction import carried
from aspnn.prediction.choice import HybridChoice
from aspnn.prediction.fan import fan
from aspnn.prediction.plan import Orderable
from aspnn.prediction.uncertainty import Calibration
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel, from_dict

if TYPE_CHECKING:
    import onnxruntime

FORMAT = 1  # of the checkpoint's config, as in learning.checkpoint, which needs torch


@dataclass(frozen=True)
class Deployed:
    """What the file says of its network; as learning.checkpoint.Bundle has it."""

    name: str
    spec: WindowSpec
    vessel: Vessel
    region_map: bool
    domain: dict[str, list[float]]
    calibration: dict[str, Any] | None
    choice: dict[str, Any] | None
    servos: Servos | None


@dataclass(frozen=True)
class OnnxPredictor:
    """Predictor by an exported GRU: the same paths as GruPredictor's, but for float32 rounding."""

    deployed: Deployed
    session: "onnxruntime.InferenceSession"
    region_map: bool = False

    @staticmethod
    def load(file: str | FilePath) -> "OnnxPredictor":
        """The predictor of an .onnx file, on one thread. Raises InputError naming the file."""
        try:
            import onnxruntime
        except ImportError:
            raise InputError(f"{file}: needs onnxruntime, which is not installed: pip install aspnn[export]") from None
        if not FilePath(file).is_file():
            raise InputError(f"{file}: no such file; write it with `aspnn export CHECKPOINT --onnx FILE`")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # two threads only wait for each other in such small networks
        options.log_severity_level = 4
        try:
            session = onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has a class of errors for each way in which a file can be bad
            raise InputError(f"{file}: is no ONNX model ({str(error).splitlines()[0]}); export it again") from None
        deployed = read_metadata(session.get_modelmeta().custom_metadata_map, str(file))
        return OnnxPredictor(deployed, session, deployed.region_map)

    @property
    def name(self) -> str:
        """The checkpoint's own name."""
        return self.deployed.name

    @property
    def contract(self) -> Deployed:
        """What the file says of its network."""
        return self.deployed

    @property
    def spec(self) -> WindowSpec:
        """What the network sees, and how far it predicts."""
        return self.deployed.spec

    @property
    def horizon(self) -> float:
        """How far it predicts [s]."""
        return self.deployed.spec.horizon

    def predict(self, states: States, rudder_plan: Orderable = None, shaft_plan: Orderable = None) -> Path:
        """Path from the last of `states`, if the plan is followed; as GruPredictor.predict."""
        how = (self.deployed, self.velocities, self.calibration)
        return carried.predict_one(*how, states, rudder_plan, shaft_plan, self.region_map, self.choice)

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """Paths (n, steps) from each of `rows` under each of `plans`; as GruPredictor.predict_many."""
        how = (self.deployed, self.velocities, self.calibration)
        return carried.predict_rows(*how, states, rows, plans, self.region_map, self.choice)

    def fan(self, states: States, orders: Sequence[Orderable], shaft_plan: Orderable = None) -> Path:
        """Paths (len(orders), steps) from the last of `states` under each of `orders`, as `prediction.fan.fan`."""
        return fan(self, carried.recent(self.deployed, self.calibration, states, self.choice), orders, shaft_plan)

    @cached_property
    def calibration(self) -> Calibration | None:
        """What `aspnn calibrate` had found before the export, for the way to the path it was found with; else None."""
        found = self.deployed.calibration
        if found is None or self.region_map != self.deployed.region_map:
            return None
        return Calibration.from_dict(found, self.name)

    @cached_property
    def choice(self) -> HybridChoice | None:
        """What `aspnn choose` left to kinematics, for the way to the path it was found with; else None. Raises InputError."""
        found = self.deployed.choice
        if found is None or self.region_map != self.deployed.region_map:
            return None
        return HybridChoice.from_dict(found, self.name)

    def velocities(self, history: np.ndarray, forcing: np.ndarray, wind: np.ndarray) -> np.ndarray:
        """The network's answer to history, forcing and wind (as far as it reads them), in float64."""
        given = {"history": history, "forcing": forcing, "wind": wind}
        feed = {value.name: given[value.name].astype(np.float32) for value in self.session.get_inputs()}
        return self.session.run(None, feed)[0].astype(float)


def read_metadata(metadata: dict[str, str], file: str) -> Deployed:
    """The checkpoint's config from the metadata of a model. Raises InputError naming the file."""
    if "aspnn" not in metadata:
        raise InputError(f"{file}: was not written by `aspnn export`, so its inputs are not known")
    config = json.loads(metadata["aspnn"])
    if config.get("format") != FORMAT:
        raise InputError(
            f"{file}: checkpoint format {config.get('format')}, this version reads {FORMAT}; export it with this version"
        )
    return Deployed(
        name=config["name"],
        spec=WindowSpec.from_dict(config["spec"]),
        vessel=from_dict(config["vessel"], file),
        region_map=config["region_map"],
        domain=config["domain"],
        calibration=config.get("calibration"),
        choice=config.get("choice"),
        servos=Servos.from_dict(config["servo"]) if "servo" in config else None,
    )
