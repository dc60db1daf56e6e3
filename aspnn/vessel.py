"""Vessels: dimensions, stations, rudder limits, hull outline, and the noise and delays a filter should expect.

A vessel is data: one JSON file per vessel, with a source for every number (`sources`, by key). Files of the package lie
in `aspnn/vessels/`; a user's own file is named by its path.
"""

import json
import math
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from aspnn.instruments import (
    SPATIAL_KEYS,
    Calibration,
    Mounting,
    Noise,
    Spatial,
    _degrees,
    _told,
    calibration_data,
    mounting_data,
    noise_data,
    read_calibration,
    read_mounting,
    read_noise,
    read_spatial,
    scaled_noise,
)
from aspnn.schema import InputError

FOLDER = Path(__file__).parent / "vessels"
KEYS = (
    "name",
    "title",
    "loading_of",
    "dimensions",
    "stations_m",
    "rudder",
    "service",
    "sensors",
    "process",
    "calibration",
    "imu",
    "spatial",
    "sources",
)
TEXTS = ("name", "title", "loading_of")
SIMULATOR = ("mmg", "mariner", "otter", "trimaran", "workboat", "propeller", "engine", "pitch", "wind", "domain")


@dataclass(frozen=True)
class Vessel:
    """What the predictor knows of a ship. Lengths in metres, angles in radians, stations in body axes from midship.

    `stations` maps a name (`bow`, `stern`, `imu`, antennas) to (x forward, y starboard), `heights` some of them to their
    height above the waterline at rest (0 where none is told). `sway_stations` are the two
    places whose sway is predicted. `simulator` holds the raw parameter sets that `simulation` reads, by section (SIMULATOR).
    `steering_delay` [s] and `dead_band` [rad] are those of the rudder's servo. `loading_of` names the ship, where the file is of
    another loading of it.
    """

    name: str
    length: float  # overall; the region map and the outline use it
    beam: float
    draught: float
    rudder_max: float
    rudder_rate: float
    service_speed: float
    stations: dict[str, tuple[float, float]] = field(default_factory=dict)
    noise: Noise = field(default_factory=Noise)
    calibration: Calibration = field(default_factory=Calibration)
    mounting: Mounting = field(default_factory=Mounting)
    spatial: Spatial = field(default_factory=Spatial)
    title: str = ""
    loading_of: str = ""
    heights: dict[str, float] = field(default_factory=dict)
    steering_delay: float = 0.0
    dead_band: float = 0.0
    simulator: dict[str, dict[str, Any]] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    file: str = field(
        default="", compare=False
    )  # where it was read from; empty for a packaged one, or one that came with a log

    @property
    def label(self) -> str:
        """What a message calls it: its file, or the name of a packaged vessel."""
        return self.file or f"vessel {self.name}"

    @property
    def ship(self) -> str:
        """The name of the ship, the same in every loading."""
        return self.loading_of or self.name

    @property
    def sway_stations(self) -> tuple[float, float]:
        """x of the bow and the stern station [m], forward positive."""
        return self.stations["bow"][0], self.stations["stern"][0]

    def other_hull(self, want: "Vessel") -> tuple[str, float, float] | None:
        """What of length and sway stations differs first from those of `want`, by more than a thousandth of its length: name, own, wanted [m]."""
        pairs = zip(self.sway_stations, want.sway_stations, strict=True)
        lengths = [(self.length, want.length), *pairs]
        for what, (own, wanted) in zip(("length", "bow station", "stern station"), lengths, strict=True):
            if abs(own - wanted) > 1e-3 * want.length:
                return what, own, wanted
        return None

    def outline(self) -> np.ndarray:
        """Hull outline in body axes, (n, 2) as (x forward, y starboard) [m], closed, bow first.

        A generic merchant waterplane: parallel sides, a bow rounded over the first 20 % and a transom of 70 % of the beam.
        """
        x = np.array([0.5, 0.46, 0.40, 0.30, -0.42, -0.5])
        y = np.array([0.0, 0.22, 0.38, 0.5, 0.5, 0.35])
        port = np.column_stack([x[:0:-1], -y[:0:-1]])
        return np.concatenate([np.column_stack([x, y]), port, [[0.5, 0.0]]]) * [self.length, self.beam]

    def to_dict(self) -> dict[str, Any]:
        """The vessel as the plain data of a vessel file; `from_dict` reads it back unchanged."""
        data: dict[str, Any] = {
            "name": self.name,
            "title": self.title,
            "dimensions": {"length_overall_m": self.length, "beam_m": self.beam, "draught_m": self.draught},
            "stations_m": {
                name: [*place, self.heights[name]] if name in self.heights else list(place)
                for name, place in self.stations.items()
            },
            "rudder": {"max_deg": _degrees(self.rudder_max), "rate_deg_s": _degrees(self.rudder_rate)},
            "service": {"speed_m_s": self.service_speed},
            **noise_data(self.noise),
            "sources": dict(self.sources),
        }
        if self.loading_of:
            data["loading_of"] = self.loading_of
        if self.steering_delay:
            data["rudder"]["delay_s"] = self.steering_delay
        if self.dead_band:
            data["rudder"]["dead_band_deg"] = _degrees(self.dead_band)
        data |= self.simulator
        if self.calibration != Calibration():
            data["calibration"] = calibration_data(self.calibration)
        if self.mounting != Mounting():
            data["imu"] = mounting_data(self.mounting)
        if self.spatial != Spatial():
            data["spatial"] = {key: _told(key, getattr(self.spatial, name)) for key, name in SPATIAL_KEYS.items()}
        return data

    def with_stations(self, **stations: tuple[float, float]) -> "Vessel":
        """The same vessel with some stations added or replaced (an importer's antennas)."""
        return replace(self, stations={**self.stations, **stations})


def from_dict(data: dict[str, Any], where: str = "vessel") -> Vessel:
    """Vessel from the plain data of a vessel file. Raises InputError that names `where` and the key."""

    def number(section: str, key: str, low: float = 0.0, high: float = 1e4) -> float:
        try:
            value = float(data[section][key])
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{where}: {section}.{key} is missing or not a number") from None
        if not low < value < high:
            raise InputError(f"{where}: {section}.{key} = {value:g} is outside {low:g} to {high:g}")
        return value

    def optional(section: str, key: str, high: float) -> float:
        value = data[section].get(key, 0.0)
        if not (isinstance(value, int | float) and 0 <= value < high):
            raise InputError(f"{where}: {section}.{key} = {value} must be a number from 0 to {high:g}")
        return float(value)

    for key in data:
        if key not in (*KEYS, *SIMULATOR):
            near = get_close_matches(key, (*KEYS, *SIMULATOR), 1)
            raise InputError(f"{where}: key {key} is not known{f', did you mean {near[0]}?' if near else ''}")
        if key not in TEXTS and not isinstance(data[key], dict):
            raise InputError(f"{where}: {key} must be an object of named values")
    if "name" not in data:
        raise InputError(f"{where}: key name is missing")
    length = number("dimensions", "length_overall_m")
    try:
        places = data.get("stations_m", {})
        stations = {str(k): (float(v[0]), float(v[1])) for k, v in places.items()}
        heights = {str(k): float(v[2]) for k, v in places.items() if len(v) > 2}
        if not np.isfinite([*sum(stations.values(), ()), *heights.values()]).all():
            raise ValueError
    except (TypeError, ValueError, IndexError):
        raise InputError(
            f"{where}: stations_m must map each name to [x forward, y starboard] or [x, y, height] in metres"
        ) from None
    stations = {
        "bow": (0.4 * length, 0.0),
        "stern": (-0.4 * length, 0.0),
        "imu": (0.0, 0.0),
        "midship": (0.0, 0.0),
    } | stations
    if stations["bow"][0] - stations["stern"][0] < 0.1 * length:
        raise InputError(
            f"{where}: stations_m bow and stern lie {stations['bow'][0] - stations['stern'][0]:g} m apart; sway needs at least {0.1 * length:g} m"
        )
    return Vessel(
        name=str(data["name"]),
        title=str(data.get("title", "")),
        loading_of=str(data.get("loading_of", "")),
        length=length,
        beam=number("dimensions", "beam_m"),
        draught=number("dimensions", "draught_m"),
        rudder_max=math.radians(number("rudder", "max_deg", 0, 90)),
        rudder_rate=math.radians(number("rudder", "rate_deg_s", 0, 400)),
        service_speed=number("service", "speed_m_s", 0, 60),
        stations=stations,
        heights=heights,
        noise=read_noise(data, scaled_noise(length), where),
        calibration=read_calibration(data, where),
        mounting=read_mounting(data, where),
        spatial=read_spatial(data, where),
        steering_delay=optional("rudder", "delay_s", 10),
        dead_band=math.radians(optional("rudder", "dead_band_deg", 10)),
        simulator={key: data[key] for key in SIMULATOR if key in data},
        sources=data.get("sources", {}),
    )


def load_vessel(name: str | Path) -> Vessel:
    """Vessel by the name of a packaged file (`cargo90`) or by the path of a user's own JSON file.

    Raises InputError when there is no such vessel, or naming file and key when its data are wrong.
    """
    path = Path(name)
    if path.suffix != ".json":
        path = FOLDER / f"{name}.json"
        if not path.exists():
            raise InputError(
                f"vessel {name} is not known; have {', '.join(vessels())}, or give the path of a .json file"
            )
    try:
        data = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of a .json file") from None
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error})") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: a vessel file holds one JSON object")
    if path.parent == FOLDER:
        return from_dict(data, f"{name}.json")
    return replace(from_dict(data, str(path)), file=str(path))


def vessels() -> list[str]:
    """Names of the packaged vessels."""
    return sorted(p.stem for p in FOLDER.glob("*.json"))
