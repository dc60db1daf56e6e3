"""The one message that says all that the page draws: plain numbers, lists and texts, as `page/SITUATION.md` has it.

Pure: the parts are handed in, times too. What is not known is None, never NaN: `plain` makes it so, and `finite` of what others hand in.
Depends on frames, motion and live.forecast.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from aspnn.angles import compass
from aspnn.frames import Zone, to_geodetic
from aspnn.live.forecast import LEVEL, Clearance, Forecast, Scores, has_region
from aspnn.motion import Path
from aspnn.motion.pivot import pivot_point
from aspnn.records import States, finite
from aspnn.vessel import Vessel

VERSION = 1
MARK = 10.0  # s between outlines of the forecast
TRACK, ROWS = 600.0, 101  # s and rows of the past track at most
FINE = 0.1  # m: rings are simplified within this
CORNERS = 18  # of the ellipse of a region
PLACE, ROUGH = 7, 6  # decimals of degrees, of own ship, and of other ships and regions: 1 cm and 11 cm at most


@dataclass(frozen=True)
class Picture:
    """All that goes into one message. `epoch` [s, UNIX] is the zero of the states' `time_s`, `alarms` gravest first.

    `targets` are the entries of the message, made by live.entries; `counts`, `simulated`, `limits` likewise plain.
    """

    vessel: Vessel
    zone: Zone
    epoch: float = 0.0
    states: States | None = None
    forecast: Forecast | None = None
    scores: Scores | None = None
    horizon: float = 90.0
    targets: Sequence[Mapping[str, Any]] = ()
    targets_time: float | None = None  # s, UNIX: the instant that they are reckoned from
    limits: Mapping[str, float] = field(default_factory=dict)
    alarms: Sequence[Mapping[str, Any]] = ()
    counts: Mapping[str, Any] = field(default_factory=dict)
    model: str | None = None
    antennas: Sequence[str] = ()  # those whose fixes reach the filter now
    mmsi: int | None = None
    stw: float | None = None
    simulated: Mapping[str, Any] | None = None
    chart: str | None = None
    sequence: int = 0


def situation(p: Picture) -> dict[str, Any]:
    """The message of a picture."""
    known = p.states is not None and len(p.states) > 0
    time = p.epoch + float(p.states["time_s"][-1]) if known else None  # type: ignore[index]
    message = {
        "version": VERSION,
        "time": None if time is None else round(time, 3),
        "sequence": p.sequence,
        "own": own_ship(p) if known else None,
        "track": past_track(p) if known else None,
        "forecast": None
        if p.forecast is None or p.forecast.path is None
        else _forecast(p, p.forecast, p.forecast.path),
        "arc": None if p.forecast is None else _arc(p, p.forecast.arc),
        "scores": _scores(p),
        "targets_time": None if p.targets_time is None else round(p.targets_time, 3),
        "targets": list(p.targets),
        "limits": finite(p.limits),
        "alarms": finite(p.alarms),
        "counts": finite(p.counts),
        "model": _model(p),
        "horizon": p.horizon,
        "rudder": {
            "max": round(math.degrees(p.vessel.rudder_max), 3),
            "rate": round(math.degrees(p.vessel.rudder_rate), 3),
        },
        "simulated": finite(p.simulated),
        "chart": p.chart,
    }
    return message


def plain(values: Any, digits: int) -> list[float | None]:
    """A list of rounded numbers, None where there is none."""
    numbers = np.round(np.atleast_1d(np.asarray(values, float)), digits)
    if np.isfinite(numbers).all():
        return numbers.tolist()
    return [v if math.isfinite(v) else None for v in numbers.tolist()]


def one(value: Any, digits: int) -> float | None:
    """A rounded number, None where there is none."""
    return plain(value, digits)[0]


def bearing(angle: Any, digits: int = 2) -> list[float | None]:
    """Angles [rad] as degrees from 0 to below 360."""
    degrees = np.round(np.degrees(compass(np.asarray(angle, float))), digits) % 360.0
    return plain(degrees, digits)


def degrees_of(zone: Zone, north: Any, east: Any) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude [deg] of places on the grid."""
    latitude, longitude = to_geodetic(np.atleast_1d(north), np.atleast_1d(east), zone)
    return np.degrees(latitude), np.degrees(longitude)


def ring_of(zone: Zone, corners: np.ndarray, digits: int = PLACE) -> list[list[float]]:
    """A ring (n, 2) of north, east [m] as closed [longitude, latitude]."""
    latitude, longitude = degrees_of(zone, corners[:, 0], corners[:, 1])
    ring = np.round(np.column_stack([longitude, latitude]), digits).tolist()
    return ring if ring[0] == ring[-1] else [*ring, ring[0]]


def rings_of(zone: Zone, area: BaseGeometry | None, digits: int = PLACE) -> list[list[list[float]]]:
    """The outer rings of an area on the grid; none of no area."""
    if area is None:
        return []
    parts = shapely.get_parts(shapely.simplify(area, FINE))
    return [ring_of(zone, shapely.get_coordinates(shapely.get_exterior_ring(part)), digits) for part in parts]


def line_of(zone: Zone, path: Path) -> dict[str, Any]:
    """Time, latitude, longitude and true heading of a path (steps,)."""
    latitude, longitude = degrees_of(zone, path.north, path.east)
    return {
        "time": plain(path.time, 2),
        "lat": plain(latitude, 7),
        "lon": plain(longitude, 7),
        "heading": bearing(path.true_heading),
    }


def outlines_of(zone: Zone, path: Path, hull: np.ndarray, marks: np.ndarray) -> list[dict[str, Any]]:
    """The hull on a path at each of `marks` [s]."""
    hulls = path.at(marks).outline(hull)
    flat = ring_points(zone, hulls)
    return [{"time": float(t), "ring": ring} for t, ring in zip(marks, flat, strict=True)]


def ring_points(zone: Zone, rings: np.ndarray, digits: int = PLACE) -> list[list[list[float]]]:
    """Rings (m, n, 2) of north, east [m], closed or not, as closed ones of [longitude, latitude]; all in one projection."""
    latitude, longitude = degrees_of(zone, rings[..., 0], rings[..., 1])
    found = np.round(np.stack([longitude, latitude], axis=-1), digits).tolist()
    return [ring if ring[0] == ring[-1] else [*ring, ring[0]] for ring in found]


def own_ship(p: Picture) -> dict[str, Any]:
    """Own ship at the last of the states."""
    assert p.states is not None
    states, vessel = p.states, p.vessel
    now = {str(name): float(value) for name, value in states.table.iloc[-1].items()}
    latitude, longitude = degrees_of(p.zone, now["north_m"], now["east_m"])
    u, v, r = now["surge_m_s"], now["sway_m_s"], now["yaw_rate_rad_s"]
    true, speed = now["heading_rad"] + now["convergence_rad"], math.hypot(u, v)
    x_bow, x_stern = vessel.sway_stations
    v_sd, r_sd = now["sway_m_s_sd"], now["yaw_rate_rad_s_sd"]
    antennas = [
        {"name": name, "x": x, "y": y, "used": name in p.antennas}
        for name, (x, y) in vessel.stations.items()
        if name in ("bow", "stern") or name in p.antennas
    ]
    return {
        "name": vessel.name,
        "mmsi": p.mmsi,
        "length": vessel.length,
        "beam": vessel.beam,
        "outline": np.round(vessel.outline(), 2).tolist(),
        "antennas": antennas,
        "lat": one(latitude, 7),
        "lon": one(longitude, 7),
        "heading": bearing(true)[0],
        "cog": bearing(true + math.atan2(v, u))[0] if speed > 0.05 else None,  # at rest there is no course
        "sog": one(speed, 3),
        "stw": None if p.stw is None else one(p.stw, 3),
        "rot": one(math.degrees(r) * 60, 2),
        "surge": one(u, 3),
        "sway": one(v, 3),
        "sway_bow": one(v + r * x_bow, 3),
        "sway_stern": one(v + r * x_stern, 3),
        "pivot": one(pivot_point(v, r, 3 * r_sd), 1),
        "rudder_order": one(math.degrees(now["rudder_order_rad"]), 2),
        "rudder_angle": one(math.degrees(now["rudder_angle_rad"]), 2),
        "shaft": one(now["shaft_speed_rps"], 3),
        "sds": {
            "position": one(math.hypot(now["north_m_sd"], now["east_m_sd"]), 3),
            "heading": one(math.degrees(now["heading_rad_sd"]), 3),
            "surge": one(now["surge_m_s_sd"], 4),
            "sway_bow": one(math.hypot(v_sd, x_bow * r_sd), 4),
            "sway_stern": one(math.hypot(v_sd, x_stern * r_sd), 4),
            "rot": one(math.degrees(r_sd) * 60, 3),
        },
    }


def past_track(p: Picture) -> dict[str, Any]:
    """The past track: at most ROWS rows of the last TRACK seconds, every 2 to 10 s, ending at the last of the states or just before.

    The rows are those nearest to multiples of the interval, so that they stay where they are from one message to the next.
    """
    assert p.states is not None
    states, time = p.states, p.states["time_s"]
    span = min(TRACK, float(time[-1] - time[0]))
    every = min(max(2.0, math.ceil(span / (ROWS - 1))), 10.0)
    first = time[-1] - min(span, every * (ROWS - 1))
    wanted = np.arange(math.ceil(first / every) * every, time[-1] + 1e-6, every)
    rows = np.unique(np.minimum(np.searchsorted(time, wanted - 1e-6), len(time) - 1))
    rows = rows if len(rows) else np.array([len(time) - 1])
    column = {name: states[name][rows] for name in _PAST}
    x_bow, x_stern = p.vessel.sway_stations
    latitude, longitude = degrees_of(p.zone, column["north_m"], column["east_m"])
    v, r = column["sway_m_s"], column["yaw_rate_rad_s"]
    v_sd, r_sd = column["sway_m_s_sd"], column["yaw_rate_rad_s_sd"]
    return {
        "time": plain(p.epoch + time[rows], 2),
        "lat": plain(latitude, 7),
        "lon": plain(longitude, 7),
        "heading": bearing(column["heading_rad"] + column["convergence_rad"]),
        "surge": plain(column["surge_m_s"], 3),
        "sway_bow": plain(v + r * x_bow, 3),
        "sway_stern": plain(v + r * x_stern, 3),
        "rot": plain(np.degrees(r) * 60, 2),
        "sds": {
            "surge": plain(column["surge_m_s_sd"], 3),
            "sway_bow": plain(np.hypot(v_sd, x_bow * r_sd), 3),
            "sway_stern": plain(np.hypot(v_sd, x_stern * r_sd), 3),
            "rot": plain(np.degrees(r_sd) * 60, 3),
        },
    }


_PAST = (
    *("north_m", "east_m", "heading_rad", "convergence_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s"),
    *("surge_m_s_sd", "sway_m_s_sd", "yaw_rate_rad_s_sd"),
)


def clearance_of(zone: Zone, clearance: Clearance | None) -> dict[str, Any] | None:
    """A clearance as the message has it."""
    if clearance is None:
        return None
    latitude, longitude = degrees_of(zone, *clearance.place)
    return {
        "distance": one(clearance.distance, 1),
        "time": one(clearance.time, 1),
        "what": clearance.what,
        "lat": one(latitude, 7),
        "lon": one(longitude, 7),
    }


def _marks(horizon: float, every: float = MARK) -> np.ndarray:
    return np.arange(every, horizon + 1e-6, every)


def _forecast(p: Picture, forecast: Forecast, path: Path) -> dict[str, Any]:
    hull, marks = p.vessel.outline(), _marks(float(path.time[-1]))
    x_bow, x_stern = p.vessel.sway_stations
    latitude, longitude = degrees_of(
        p.zone, path.north + path.pivot * np.cos(path.heading), path.east + path.pivot * np.sin(path.heading)
    )
    pivot = [
        [x, y] if x is not None and y is not None else None
        for x, y in zip(plain(longitude, 7), plain(latitude, 7), strict=True)
    ]
    regions: list[dict[str, Any]] = []
    if has_region(path):
        rings = ring_points(p.zone, path.at(marks).region(LEVEL).outline(CORNERS), ROUGH)
        regions = [{"time": float(t), "ring": ring} for t, ring in zip(marks, rings, strict=True)]
    return {
        "start": round(p.epoch + forecast.start, 3),
        **line_of(p.zone, path),
        "surge": plain(path.surge, 3),
        "sway_bow": plain(path.sway_at(x_bow), 3),
        "sway_stern": plain(path.sway_at(x_stern), 3),
        "rot": plain(np.degrees(path.yaw_rate) * 60, 2),
        "pivot": pivot,
        "outlines": outlines_of(p.zone, path, hull, marks),
        "swept": rings_of(p.zone, forecast.swept),
        "regions": regions,
        "region_swept": rings_of(p.zone, forecast.region_swept, ROUGH),
        "region_start": one(p.epoch + forecast.region_start, 3),
        "clearance": clearance_of(p.zone, forecast.clearance),
    }


def _arc(p: Picture, arc: Path) -> dict[str, Any]:
    horizon = float(arc.time[-1])
    marks = horizon * np.array([1.0, 2.0, 3.0]) / 3.0
    return {**line_of(p.zone, arc), "outlines": outlines_of(p.zone, arc, p.vessel.outline(), marks)}


def _scores(p: Picture) -> dict[str, Any]:
    s = p.scores
    if s is None:
        marks = p.horizon * np.array([1.0, 2.0, 3.0]) / 3.0
        none = [None] * 3
        empty = {"median": none, "last": none}
        return {"horizons": plain(marks, 1), "count": [0, 0, 0], "set_apart": [0, 0, 0], "ours": empty, "arc": empty}
    return {
        "horizons": plain(s.horizons, 1),
        "count": s.count.tolist(),
        "set_apart": s.set_apart.tolist(),
        "ours": {"median": plain(s.ours_median, 2), "last": plain(s.ours_last, 2)},
        "arc": {"median": plain(s.arc_median, 2), "last": plain(s.arc_last, 2)},
    }


def _model(p: Picture) -> dict[str, Any] | None:
    if p.model is None:
        return None
    f = p.forecast
    return {"name": p.model, "fits": None if f is None else f.fits, "outside": False if f is None else f.outside}


def geojson(message: Mapping[str, Any]) -> dict[str, Any]:
    """A situation as a GeoJSON FeatureCollection (RFC 7946) for other programs: ship, track, paths, outlines, areas, targets."""
    features: list[dict[str, Any]] = []

    def add(kind: str, shape: str, coordinates: Any, **more: Any) -> None:
        geometry = {"type": shape, "coordinates": coordinates}
        features.append({"type": "Feature", "geometry": geometry, "properties": {"kind": kind, **more}})

    def line(part: Mapping[str, Any]) -> list[list[float]]:
        return [[x, y] for x, y in zip(part["lon"], part["lat"], strict=True) if x is not None and y is not None]

    own = message["own"]
    if own is not None and own["lat"] is not None:
        more = {key: own[key] for key in ("name", "heading", "cog", "sog", "rot")}
        add("own ship", "Point", [own["lon"], own["lat"]], time=message["time"], **more)
    for kind, key in (("past track", "track"), ("predicted path", "forecast"), ("predicted vector", "arc")):
        part = message[key]
        if part is not None and len(line(part)) > 1:
            add(kind, "LineString", line(part))
    forecast = message["forecast"]
    if forecast is not None:
        for name, kind in (("outlines", "predicted ship"), ("regions", "region")):
            for mark in forecast[name]:
                add(kind, "Polygon", [mark["ring"]], time_s=mark["time"])
        for name in ("swept", "region_swept"):
            for ring in forecast[name]:
                add(name.replace("_", " "), "Polygon", [ring])
    for target in message["targets"]:
        keys = ("id", "name", "cog", "sog", "cpa", "tcpa", "probability", "dangerous")
        add("target", "Point", [target["lon"], target["lat"]], **{key: target.get(key) for key in keys})
    return {"type": "FeatureCollection", "features": features}
