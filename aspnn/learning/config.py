"""Training files: everything that makes a checkpoint stands in `training/NAME.toml`, and nothing else does."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from aspnn.config import read_toml
from aspnn.learning.windows import Sampling, WindowSpec
from aspnn.schema import InputError

STRICT = ConfigDict(extra="forbid", frozen=True)
Pair = tuple[float, float]


class Data(BaseModel):
    """Where voyages come from, relative to the training file: a scenario to simulate, or logs (files, folders, globs)."""

    model_config = STRICT
    scenario: str | None = None
    logs: tuple[str, ...] = ()
    voyages: int | None = Field(None, ge=1)
    validation_voyages: int = Field(0, ge=0)
    exclude: tuple[str, ...] = ()


class Cut(BaseModel):
    """What windows hold and where they start; `train` and `validation` limit how many are kept, in the order of voyages."""

    model_config = STRICT
    history_s: float = Field(gt=0)
    horizon_s: float = Field(gt=0)
    period_s: float = Field(gt=0)
    inputs: tuple[str, ...]
    forcings: tuple[str, ...] = ()
    at_orders: bool = True
    shifts_s: tuple[float, ...] = ()
    sliding_s: float | None = Field(None, gt=0)
    train: int | None = Field(None, ge=1)
    validation: int | None = Field(None, ge=1)

    def spec(self) -> WindowSpec:
        """The contract of the windows."""
        return WindowSpec(self.history_s, self.horizon_s, self.period_s, self.inputs, self.forcings)

    def sampling(self) -> Sampling:
        """Where they start."""
        return Sampling(self.at_orders, self.shifts_s, self.sliding_s)


class RolloutNet(BaseModel):
    """The roll-out GRU and the tolerances of its loss, each at the start and per second."""

    model_config = STRICT
    kind: Literal["rollout"]
    latent: int = Field(48, ge=4, le=1024)
    wind: bool = False
    members: int = Field(1, ge=1, le=20)  # trained one by one, with seeds that follow each other; the mean predicts
    position_tolerance_m: Pair
    heading_tolerance_deg: Pair
    velocity_tolerance_m_s: float = Field(gt=0)


class ThesisNet(BaseModel):
    """The thesis's three GRUs (Paper V, table 6)."""

    model_config = STRICT
    kind: Literal["thesis"]
    latent: int = Field(64, ge=4, le=1024)
    dense: tuple[int, int] = (240, 120)
    rudder_limit_deg: float = 45.0


class Fit(BaseModel):
    """How long and how fast to train; see learning.fit.FitSettings."""

    model_config = STRICT
    epochs: int = Field(ge=1)
    batch: int = Field(64, ge=1)
    learning_rate: float = Field(1e-3, gt=0)
    one_cycle: bool = False
    weight_decay: float = Field(0.0, ge=0)
    clip: float | None = Field(None, gt=0)
    seed: int = 1


class Training(BaseModel):
    """A training file, `training/NAME.toml`: everything that makes a checkpoint, and nothing else does."""

    model_config = STRICT
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    about: str = ""
    data: Data
    windows: Cut
    network: Annotated[RolloutNet | ThesisNet, Field(discriminator="kind")]
    fit: Fit
    folder: Path = Path(".")  # of the training file; its paths start here


def read_training(path: str | Path) -> Training:
    """A training file. Raises InputError, one line that names the file and the key."""
    training = read_toml(path, Training, folder=Path(path).parent)
    if (training.data.scenario is None) == (not training.data.logs):
        raise InputError(f"{path}: data: name either a scenario or logs")
    return training
