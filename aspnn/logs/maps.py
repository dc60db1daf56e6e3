"""What maps (TOML) say of recorded logs, and the source files that importers are given."""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from aspnn import schema
from aspnn.frames import Zone
from aspnn.logs.units import UNITS, units_of
from aspnn.schema import InputError
from aspnn.vessel import Vessel, load_vessel

TIMES = UNITS["s"]
ALIASES = {"Hz": "rps", "rev/s": "rps"}


class Strict(BaseModel):
    """A part of a map: every key is known, every value is what it should be."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Map(Strict):
    """What every map says. Stations are (x forward, y starboard) from midship [m]; they are added to the vessel's own."""

    vessel: str
    zone: str | None = None
    start: str = ""
    voyage: str = ""
    stations_m: dict[str, tuple[float, float]] = {}

    @field_validator("zone")
    @classmethod
    def _known_zone(cls, zone: str | None) -> str | None:
        return None if zone is None else str(Zone.parse(zone))


def mapped_vessel(map: Map, path: str | Path, vessel: str | None) -> Vessel:
    """The vessel of a map (its path counts from the map), or `vessel` in its place, with the map's stations."""
    name = map.vessel if vessel is None else vessel
    if vessel is None and name.endswith(".json"):
        name = str(Path(path).parent / name)
    return load_vessel(name).with_stations(**map.stations_m)


def source_files(sources: Sequence[str | Path], endings: Sequence[str]) -> dict[str, Path]:
    """Source files by the name of the log they make: files as given, folders searched through for `endings`.

    The name is the file's, with its folder's before it where two files have the same. Raises InputError.
    """
    files: list[Path] = []
    for source in map(Path, sources):
        inside = [source]
        if source.is_dir():
            inside = sorted(p for p in source.rglob("*") if p.suffix.lower() in endings and not p.name.startswith("."))
        elif not source.exists():
            raise InputError(f"{source}: no such file or folder")
        if not inside:
            raise InputError(f"{source}: holds no file that ends in {', '.join(endings)}; name the files themselves")
        files += inside
    stems = Counter(file.stem for file in files)
    named: dict[str, Path] = {}
    for file in files:
        name = file.stem if stems[file.stem] == 1 else f"{file.absolute().parent.name}-{file.stem}"
        if name in named:
            raise InputError(f"{file}: {named[name]} would make a log of the same name {name}; rename one of the two")
        named[name] = file
    return named


class Form(Strict):
    """How the file is written."""

    separator: str = Field(",", min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    skip_rows: int = Field(0, ge=0)  # lines above the header
    comment: str = ""  # lines that begin so are passed over
    encoding: str = "utf-8-sig"


class Clock(Strict):
    """Where the time stands: a number in `unit`, "iso8601", or text in a strptime format. Several columns are joined by a blank."""

    column: str | tuple[str, ...]
    unit: str = "s"

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str) -> str:
        if unit not in TIMES and unit != "iso8601" and "%" not in unit:
            raise ValueError(f"{unit} is not known; write s, ms, min, iso8601 or a format such as %d.%m.%Y %H:%M:%S")
        return unit

    @property
    def columns(self) -> tuple[str, ...]:
        return (self.column,) if isinstance(self.column, str) else self.column


class Source(Strict):
    """Where a canonical column comes from: sign times the recorded number in `unit`, plus `offset` in the canonical unit."""

    column: str
    unit: str = ""  # the canonical one
    sign: Literal[1, -1] = 1
    offset: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, data: Any) -> Any:
        return {"column": data} if isinstance(data, str) else data


def _columns(columns: dict[str, Source]) -> dict[str, Source]:
    found = {}
    for name, source in columns.items():
        if name == "time_s":
            raise ValueError("time_s is told in [time]")
        if not any(c.matches(name) for c in schema.LOG):
            near = get_close_matches(name, [c.name for c in schema.LOG], 1, 0.5)
            hint = f", did you mean {near[0]}?" if near else ""
            raise ValueError(f"{name} is not a column of a log{hint} (data/README.md lists them)")
        units = units_of(name)
        unit = ALIASES.get(source.unit, source.unit) or next(iter(units))
        if unit not in units:
            raise ValueError(f"{name}: unit {unit} is not known; choose {', '.join(units)}")
        found[name] = source.model_copy(update={"unit": unit})
    return found


class CsvMap(Map):
    """A map of CSV files: the canonical columns, each with its source."""

    csv: Form = Form.model_validate({})
    time: Clock
    columns: Annotated[dict[str, Source], Field(min_length=1), AfterValidator(_columns)]

    @field_validator("start")
    @classmethod
    def _instant(cls, start: str) -> str:
        return utc(datetime.fromisoformat(start)) if start else ""


def utc(instant: datetime) -> str:
    """An instant as ISO 8601 in UTC, which it is taken to be in where it names no offset."""
    instant = instant.replace(tzinfo=UTC) if instant.tzinfo is None else instant.astimezone(UTC)
    return instant.isoformat().replace("+00:00", "Z")
