"""Training files: everything that makes a checkpoint stands in `training/NAME.toml`, and nothing else does."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from aspnn.config import read_toml
from aspnn.learning.windows import WIND_MEMORY, Sampling, WindowSpec
from aspnn.records import atomic
from aspnn.schema import InputError

STRICT = ConfigDict(extra="forbid", frozen=True)
Pair = tuple[float, float]


class Data(BaseModel):
    """Where voyages come from, relative to the training file: a scenario to simulate, several, or logs (files, folders, globs).

    Of several `scenarios` all voyages are simulated, one scenario after the other, so that the last of the last are those of validation.
    With `stream`, windows are written to the run folder voyage by voyage and read from there a batch at a time.
    """

    model_config = STRICT
    scenario: str | None = None
    scenarios: tuple[str, ...] = ()
    logs: tuple[str, ...] = ()
    voyages: int | None = Field(None, ge=1)
    validation_voyages: int = Field(0, ge=0)
    exclude: tuple[str, ...] = ()
    stream: bool = False


class Cut(BaseModel):
    """What windows hold and where they start; `train` and `validation` limit how many are kept, in the order of voyages.

    With `spatial` states are those of the filter in three dimensions, for boats that roll and pitch; with `course_only` inputs are
    those of the filter that takes positions alone, for ships without a gyro (labels still need voyages with a heading).
    """

    model_config = STRICT
    history_s: float = Field(gt=0)
    horizon_s: float = Field(gt=0)
    period_s: float = Field(gt=0)
    inputs: tuple[str, ...]
    forcings: tuple[str, ...] = ()
    wind_memory_s: float = Field(WIND_MEMORY, gt=0)  # over which the wind at a start is averaged
    spatial: bool = False
    course_only: bool = False
    current_memory_s: float | None = Field(
        None, gt=0
    )  # in which a current is sought; without it as long as the horizon
    at_orders: bool = True
    shifts_s: tuple[float, ...] = ()
    sliding_s: float | None = Field(None, gt=0)
    train: int | None = Field(None, ge=1)
    validation: int | None = Field(None, ge=1)

    def spec(self) -> WindowSpec:
        """The contract of the windows."""
        return WindowSpec(
            self.history_s,
            self.horizon_s,
            self.period_s,
            self.inputs,
            self.forcings,
            wind_memory=self.wind_memory_s,
            current_memory=self.current_memory_s,
            spatial=self.spatial,
            course_only=self.course_only,
        )

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


class IdentifiedNet(BaseModel):
    """The identified ship: ridge regression on smoothed motion, then `fit` on roll-outs with the loss of the roll-out GRU."""

    model_config = STRICT
    kind: Literal["identified"]
    ridge: float = Field(1e-6, gt=0)  # against terms of unit size
    wind: bool = False
    position_tolerance_m: Pair
    heading_tolerance_deg: Pair
    velocity_tolerance_m_s: float = Field(gt=0)


class HybridNet(BaseModel):
    """An identified ship, trained first, and the GRU that learns its residual; `fit` then trains both together.

    The ship learns at its own rate when it is alone, and beside the GRU at `ship_share` of the rate of `fit`.
    """

    model_config = STRICT
    kind: Literal["hybrid"]
    latent: int = Field(24, ge=4, le=1024)
    ridge: float = Field(1e-6, gt=0)
    ship_epochs: int = Field(ge=1)
    ship_learning_rate: float = Field(1e-3, gt=0)
    ship_share: float = Field(0.02, ge=0, le=1)
    wind: bool = False
    position_tolerance_m: Pair
    heading_tolerance_deg: Pair
    velocity_tolerance_m_s: float = Field(gt=0)


class CorrectedNet(BaseModel):
    """An identified ship, trained first, and GRUs that learn what its roll-outs leave over; `fit` trains these alone."""

    model_config = STRICT
    kind: Literal["corrected"]
    latent: int = Field(24, ge=4, le=1024)
    ridge: float = Field(1e-6, gt=0)
    ship_epochs: int = Field(0, ge=0)  # none: the ship stays as the regression found it
    ship_learning_rate: float = Field(1e-3, gt=0)
    wind: bool = False
    members: int = Field(1, ge=1, le=20)  # GRUs, with seeds that follow each other; the mean of them corrects
    position_tolerance_m: Pair
    heading_tolerance_deg: Pair
    velocity_tolerance_m_s: float = Field(gt=0)


class Fit(BaseModel):
    """How long and how fast to train; see learning.fit.FitSettings."""

    model_config = STRICT
    epochs: int = Field(ge=0)  # none: the parent of a fine-tuning as it is
    batch: int = Field(64, ge=1)
    learning_rate: float = Field(1e-3, gt=0)
    one_cycle: bool = False
    weight_decay: float = Field(0.0, ge=0)
    clip: float | None = Field(None, gt=0)
    towards_parent: float = Field(0.0, ge=0)  # of fine-tuning alone: see learning.finetune
    seed: int = 1


class Range(BaseModel):
    """Numbers of a search from `low` to `high`, both in it; whole ones where both are whole. `log` searches the exponent."""

    model_config = STRICT
    low: int | float
    high: int | float
    log: bool = False
    step: Annotated[int | float | None, Field(gt=0)] = None

    @model_validator(mode="after")
    def _sound(self) -> "Range":
        if not self.low < self.high:
            raise ValueError(f"low {self.low:g} must be less than high {self.high:g}")
        if self.log and (self.low <= 0 or self.step is not None):
            raise ValueError("log needs a low above 0 and goes without step")
        return self

    def probes(self) -> tuple[int | float, ...]:
        """Values that must be fit for the key if all of them are to be."""
        if isinstance(self.low, int) and isinstance(self.high, int) and isinstance(self.step, int | None):
            return self.low, self.high
        return self.low, self.low + 0.5377 * (self.high - self.low), self.high


class Choices(BaseModel):
    """Values of a search, any of them as good as the next to begin with."""

    model_config = STRICT
    choices: tuple[Any, ...] = Field(min_length=2)

    def probes(self) -> tuple[Any, ...]:
        """Values that must be fit for the key: all of them."""
        return self.choices


class Training(BaseModel):
    """A training file, `training/NAME.toml`: everything that makes a checkpoint, and nothing else does."""

    model_config = STRICT
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    about: str = ""
    data: Data
    windows: Cut
    network: Annotated[RolloutNet | ThesisNet | IdentifiedNet | HybridNet | CorrectedNet, Field(discriminator="kind")]
    fit: Fit
    search: dict[str, Range | Choices] = {}
    folder: Path = Path(".")  # of the training file; its paths start here

    @field_validator("search", mode="before")
    @classmethod
    def _flat(cls, tables: Any) -> Any:
        """Key paths out of the tables that TOML makes of dotted keys."""
        return dict(_leaves(tables, "")) if isinstance(tables, dict) else tables

    def changed(self, values: dict[str, Any]) -> "Training":
        """This training with other values at some key paths, such as fit.batch. Raises pydantic's ValidationError."""
        data = self.model_dump(exclude={"search"})
        for path, value in values.items():
            *tables, key = path.split(".")
            place = data
            for table in tables:
                place = place[table]
            place[key] = value
        training = Training.model_validate(data)
        training.windows.spec()
        return training


def write_training(training: Training, path: str | Path) -> None:
    """Write a training file that `read_training` reads, whole, without a section [search]; its paths lead from its new place."""
    path = Path(path)

    def moved(source: str) -> str:
        return (
            source
            if Path(source).is_absolute()
            else Path(os.path.relpath(training.folder / source, path.parent)).as_posix()
        )

    data = training.model_dump(mode="json", exclude={"folder", "search"}, exclude_none=True)
    data["data"]["logs"] = [moved(source) for source in training.data.logs]
    data["data"]["scenarios"] = [moved(source) for source in training.data.scenarios]
    if training.data.scenario is not None:
        data["data"]["scenario"] = moved(training.data.scenario)
    # JSON writes plain values, and lists of them, as TOML does.
    tables = {key: value for key, value in data.items() if isinstance(value, dict)}
    lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in data.items() if key not in tables]
    for name, values in tables.items():
        lines += ["", f"[{name}]", *(f"{key} = {json.dumps(v, ensure_ascii=False)}" for key, v in values.items())]
    with atomic(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


# What a search may change. The rest would change what is measured (horizon, tolerances, validation voyages), or is no
# choice between better and worse (the seed).
SEARCHABLE = {
    "windows": ("history_s", "inputs", "forcings", "at_orders", "shifts_s", "sliding_s", "train"),
    "fit": ("epochs", "batch", "learning_rate", "one_cycle", "weight_decay", "clip"),
    "network": None,  # all but its kind, its members, and what its loss counts
}
FIXED = ("kind", "members", "position_tolerance_m", "heading_tolerance_deg", "velocity_tolerance_m_s")


def _leaves(tables: dict[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    for name, value in tables.items():
        if isinstance(value, dict) and not {"low", "high", "choices"} & set(value):
            yield from _leaves(value, f"{path}{name}.")
        elif not isinstance(value, dict):
            raise ValueError(f"{path}{name} needs low and high, or choices")
        else:
            yield f"{path}{name}", value


def check_search(training: Training, source: str | Path) -> None:
    """Hold the section [search] to the keys of the file. Raises InputError, one line that names the key."""
    for path, values in training.search.items():
        table, _, key = path.partition(".")
        known = SEARCHABLE.get(table, ())
        fields = type(training.network).model_fields
        if not (key in known if known is not None else key in fields and key not in FIXED):
            raise InputError(
                f"{source}: search.{path}: cannot be searched; choose keys of windows ({', '.join(SEARCHABLE['windows'] or ())}), "
                f"fit ({', '.join(SEARCHABLE['fit'] or ())}) or network ({', '.join(k for k in fields if k not in FIXED)})"
            )
        for value in values.probes():
            try:
                training.changed({path: value})
            except ValidationError as error:
                raise InputError(f"{source}: search.{path}: {value!r}: {error.errors()[0]['msg']}") from None
            except InputError as error:
                raise InputError(f"{source}: search.{path}: {value!r}: {error}") from None


def read_training(path: str | Path) -> Training:
    """A training file. Raises InputError, one line that names the file and the key."""
    training = read_toml(path, Training, folder=Path(path).parent)
    data = training.data
    if (data.scenario is not None) + bool(data.scenarios) + bool(data.logs) != 1:
        raise InputError(f"{path}: data: name either a scenario or scenarios or logs")
    if data.scenarios and data.voyages is not None:
        raise InputError(f"{path}: data: voyages is of one scenario; each of several says its own")
    check_search(training, path)
    return training
