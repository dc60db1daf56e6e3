"""Predictions shared between ships and the shore: one JSON object per message, over UDP multicast or lines of TCP.

The message (UTF-8, at most SIZE bytes; one datagram, or one line). All keys are there; times are UNIX seconds, angles degrees clockwise
from true north, rates of turn degrees per minute, the rest metres and metres per second:

    {"aspnn": 1, "instance": "16 hex digits", "sequence": 7, "name": "CARGO 90", "mmsi": 257000001 or null, "time": 1700000000.0,
     "length": 90.0, "beam": 14.0, "surge": 6.0, "sway": 0.1, "rot": 3.0,
     "path": {"time": [0, 5, ...], "lat": [...], "lon": [...], "heading": [...]},
     "region": {"major": [...], "minor": [...], "azimuth": [...], "heading": [...]} or null}

`time` is that of the state which the prediction starts from, `path.time` counts from it and begins at 0, places are midship's. `region`
is one standard deviation: half axes [m] of the ellipse, the azimuth of the major one, and of the heading [deg]. `instance` is drawn at
random when a program starts: by it a ship knows her own messages. Nothing here is signed: a receiver believes no more than that
somebody on the network says so. What is read is held to this page strictly, bounded, counted, and never raises.
"""

import json
import math
from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from aspnn.angles import compass
from aspnn.frames import Zone, convergence, to_geodetic, to_grid
from aspnn.logs.ais_messages import is_ship
from aspnn.motion import Path, Spread, pivot_point
from aspnn.motion.path import YAW_RATE_FLOOR
from aspnn.motion.spread import disc, strip
from aspnn.schema import InputError

VERSION = 1
SIZE = 8192  # bytes of a message
POINTS = 61  # of a path
SPACING = 5.0  # s between the points of a path that is sent
HORIZON = 600.0  # s
FASTEST = 50.0  # m/s from one point of a path to the next
CLOCK = 10.0  # s: so far may another ship's clock be from one's own
INSTANCES = 64  # heard at once
OFTEN = 0.05  # s: more messages of one instance than one in this time are passed over
FORGET = 300.0  # s after which a silent instance gives its place
LEVELS = np.array([0.5, 0.8, 0.9, 0.95, 0.99])


class Refusal(StrEnum):
    """Why a message was not taken."""

    own = "own"
    size = "size"
    invalid = "invalid"
    clock = "clock"
    repeated = "repeated"
    often = "often"
    crowded = "crowded"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def _numbers(low: float, high: float):
    return Annotated[list[Annotated[float, Field(ge=low, le=high)]], Field(min_length=2, max_length=POINTS)]


class SharedPath(_Strict):
    """The path of a message."""

    time: _numbers(0, HORIZON)  # type: ignore[valid-type]
    lat: _numbers(-84, 84)  # type: ignore[valid-type]
    lon: _numbers(-180, 180)  # type: ignore[valid-type]
    heading: _numbers(0, 360)  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _whole(self):
        if not len(self.time) == len(self.lat) == len(self.lon) == len(self.heading):
            raise ValueError("the lists of a path have one length")
        if self.time[0] != 0 or (np.diff(self.time) < 0.1).any():
            raise ValueError("time begins at 0 and rises by 0.1 s at least")
        lat, lon = np.array(self.lat), np.array(self.lon)
        turned = (np.diff(lon) + 180) % 360 - 180
        way = 111.2e3 * np.hypot(np.diff(lat), turned * np.cos(np.radians(lat[1:])))
        if (way > FASTEST * np.diff(self.time)).any():
            raise ValueError(f"a path is no faster than {FASTEST:g} m/s")
        return self


class SharedRegion(_Strict):
    """The regions of a message: one standard deviation."""

    major: _numbers(0, 1e4)  # type: ignore[valid-type]
    minor: _numbers(0, 1e4)  # type: ignore[valid-type]
    azimuth: _numbers(0, 360)  # type: ignore[valid-type]
    heading: _numbers(0, 180)  # type: ignore[valid-type]


class Prediction(_Strict):
    """A message, as the module's page describes it."""

    aspnn: Annotated[int, Field(ge=VERSION, le=VERSION)]
    instance: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    sequence: Annotated[int, Field(ge=0, lt=2**53)]
    name: Annotated[str, Field(max_length=40, pattern=r"^[^\x00-\x1f\x7f-\x9f<>]*$")]
    mmsi: int | None
    time: Annotated[float, Field(gt=0, lt=1e11)]
    length: Annotated[float, Field(ge=1, le=600)]
    beam: Annotated[float, Field(ge=0.3, le=120)]
    surge: Annotated[float, Field(ge=-FASTEST, le=FASTEST)]
    sway: Annotated[float, Field(ge=-FASTEST, le=FASTEST)]
    rot: Annotated[float, Field(ge=-3600, le=3600)]
    path: SharedPath
    region: SharedRegion | None

    @model_validator(mode="after")
    def _whole(self):
        if self.mmsi is not None and not is_ship(self.mmsi):
            raise ValueError("mmsi is no ship's")
        if self.region is not None:
            lists = (self.region.major, self.region.minor, self.region.azimuth, self.region.heading)
            if any(len(values) != len(self.path.time) for values in lists):
                raise ValueError("the lists of region are as long as those of path")
        return self

    def in_grid(self, zone: Zone) -> Path:
        """The path (points,) in the grid of `zone`, with its spread where regions were told. Raises InputError far outside the zone."""
        lat, lon = np.radians(self.path.lat), np.radians(self.path.lon)
        north, east = to_grid(lat, lon, zone)
        gamma = convergence(lat, lon, zone)
        if not np.isfinite(north + east + gamma).all():
            raise InputError(f"shared prediction of {self.name or self.instance}: lies too far outside zone {zone}")
        time = np.array(self.path.time)
        heading = np.unwrap(np.radians(self.path.heading) - gamma)
        # The velocity at the start is told; along the path it is that of the chords, turned into the hull.
        step, turn = np.diff(time), np.diff(heading)
        chord = (np.diff(north) + 1j * np.diff(east)) / step
        body = chord * np.exp(-1j * (heading[:-1] + turn / 2)) / np.sinc(turn / (2 * np.pi))
        rate = turn / step
        u, v, r = (np.append(values, values[-1]) for values in (body.real, body.imag, rate))
        pivot = pivot_point(v, r, YAW_RATE_FLOOR / 3)
        spread = None if self.region is None else self._spread(gamma)
        return Path(time, north, east, heading, u, v, r, pivot, float(gamma[0]), spread)

    def _spread(self, gamma: np.ndarray) -> Spread:
        assert self.region is not None
        major, minor = np.array(self.region.major), np.array(self.region.minor)
        azimuth = np.radians(self.region.azimuth) - gamma
        along = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        covariance = np.zeros((len(major), 3, 3))
        for sd, d in ((major, along), (minor, across)):
            covariance[:, :2, :2] += sd[:, None, None] ** 2 * d[:, :, None] * d[:, None]
        covariance[:, 2, 2] = np.radians(self.region.heading) ** 2
        return gaussian(covariance)


def gaussian(covariance: np.ndarray) -> Spread:
    """The Spread of Gaussian errors with `covariance` (..., steps, 3, 3) of north, east [m] and heading [rad]."""
    shape = (*covariance.shape[:-2], len(LEVELS))
    return Spread(
        covariance=covariance,
        outside=np.zeros(covariance.shape[:-3], bool),
        levels=LEVELS,
        position=np.broadcast_to([disc(p) for p in LEVELS], shape).copy(),
        heading=np.broadcast_to([strip(p) for p in LEVELS], shape).copy(),
        misfit=np.full(covariance.shape[:-3], np.nan),
        limit=math.inf,
    )


class Sender(NamedTuple):
    """Who shares: the `instance` (16 hex digits, random), and what she tells of herself."""

    instance: str
    name: str
    mmsi: int | None
    length: float
    beam: float


def encode(sender: Sender, sequence: int, time: float, path: Path, zone: Zone) -> bytes:
    """The message of one path (steps,) in the grid of `zone`, which starts at `time` [s, UNIX]. Raises InputError where it breaks the rules."""
    points = min(POINTS - 1, max(1, math.ceil(float(path.time[-1]) / SPACING)))
    at = path.at(np.linspace(0, float(path.time[-1]), points + 1))
    lat, lon = to_geodetic(at.north, at.east, zone)
    gamma = convergence(lat, lon, zone)
    told = {
        "time": np.round(at.time, 2),
        "lat": np.round(np.degrees(lat), 7),
        "lon": np.round(np.degrees(lon), 7),
        "heading": _bearing(at.heading + gamma),
    }
    region = None
    if at.spread is not None and np.isfinite(at.spread.covariance).all():
        c = at.spread.covariance
        mean, half = (c[:, 0, 0] + c[:, 1, 1]) / 2, np.hypot((c[:, 0, 0] - c[:, 1, 1]) / 2, c[:, 0, 1])
        region = {
            "major": np.round(np.sqrt(mean + half), 2).tolist(),
            "minor": np.round(np.sqrt(np.maximum(mean - half, 0.0)), 2).tolist(),
            "azimuth": _bearing(np.arctan2(2 * c[:, 0, 1], c[:, 0, 0] - c[:, 1, 1]) / 2 + gamma).tolist(),
            "heading": np.round(np.minimum(np.degrees(np.sqrt(c[:, 2, 2])), 180.0), 2).tolist(),
        }
    message = {
        "aspnn": VERSION,
        **sender._asdict(),
        "sequence": sequence,
        "time": round(time, 3),
        "surge": round(float(path.surge[0]), 3),
        "sway": round(float(path.sway[0]), 3),
        "rot": round(math.degrees(float(path.yaw_rate[0])) * 60, 2),
        "path": {key: values.tolist() for key, values in told.items()},
        "region": region,
    }
    data = json.dumps(message, separators=(",", ":"), ensure_ascii=False).encode()
    if isinstance(read(data), str):
        raise InputError(f"own prediction of {sender.name!r} cannot be shared: {read(data)}")
    return data


def _bearing(angle: np.ndarray) -> np.ndarray:
    return np.round(np.degrees(compass(angle)), 2)


def read(data: bytes) -> "Prediction | str":
    """The message in `data`, or in one line why it is none. Never raises."""
    if len(data) > SIZE:
        return f"{len(data)} bytes, at most {SIZE} are read"
    try:
        return Prediction.model_validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        return f"{'.'.join(map(str, first['loc'])) or 'message'}: {first['msg']}"[:200]


@dataclass
class Inbox:
    """What one instance hears: the messages of others, each once and in order. Bounded; `counts` tells what was refused and why."""

    instance: str
    counts: Counter[Refusal] = field(default_factory=Counter)
    taken: int = 0
    last_refused: str = ""
    _heard: dict[str, tuple[int, float, float]] = field(default_factory=dict)  # sequence, time of the state, received

    def take(self, data: bytes, received: float) -> Prediction | None:
        """The prediction in `data`, received at `received` [s, UNIX]; None where it is not to be used. Never raises."""
        said = read(data)
        if isinstance(said, str):
            why, text = (Refusal.size if len(data) > SIZE else Refusal.invalid), said
        elif (objection := self._objection(said, received)) is None:
            self._heard[said.instance] = (said.sequence, said.time, received)
            self.taken += 1
            return said
        else:
            why, text = objection
        self.counts[why] += 1
        self.last_refused = text or self.last_refused
        return None

    def _objection(self, said: Prediction, received: float) -> tuple[Refusal, str] | None:
        """Why a message of the right form is not to be used, None where it is."""
        if said.instance == self.instance:
            return Refusal.own, ""
        if not -CLOCK <= received - said.time <= CLOCK + HORIZON:
            return Refusal.clock, f"{said.name}: its clock is {said.time - received:+.0f} s off"
        sequence, time, last = self._heard.get(said.instance, (-1, -math.inf, -math.inf))
        if said.sequence <= sequence or said.time < time:
            return Refusal.repeated, f"{said.name}: message {said.sequence} after {sequence}"
        if received - last < OFTEN:
            return Refusal.often, f"{said.name}: more than {1 / OFTEN:g} messages a second"
        if said.instance not in self._heard and len(self._heard) >= INSTANCES:
            self._heard = {key: h for key, h in self._heard.items() if received - h[2] < FORGET}
            if len(self._heard) >= INSTANCES:
                return Refusal.crowded, f"more than {INSTANCES} instances at once"
        return None
