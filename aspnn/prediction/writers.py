"""A predicted path for other programs: JSON, GeoJSON (RFC 7946) and CSV. Degrees and names with units, as at every edge."""

import csv
import io
import json
from typing import Any

import numpy as np

from aspnn.angles import compass
from aspnn.frames import Zone, to_geodetic
from aspnn.motion import Path
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel


def columns(path: Path, vessel: Vessel, zone: Zone | None) -> dict[str, np.ndarray]:
    """One predicted path as named columns with units. Undefined pivot points and regions are NaN."""
    bow, stern = vessel.sway_stations
    table = {
        "time_s": path.time,
        "north_m": path.north,
        "east_m": path.east,
        "heading_grid_deg": np.degrees(compass(path.heading)),
        "heading_true_deg": np.degrees(compass(path.true_heading)),
        "surge_m_s": path.surge,
        "sway_bow_m_s": path.sway_at(bow),
        "sway_stern_m_s": path.sway_at(stern),
        "yaw_rate_deg_s": np.degrees(path.yaw_rate),
        "pivot_point_m": path.pivot,
        "pivot_region": path.region(vessel.length),
    }
    if zone is not None:
        latitude, longitude = to_geodetic(path.north, path.east, zone)
        table |= {"latitude_deg": np.degrees(latitude), "longitude_deg": np.degrees(longitude)}
    return table


def to_csv(path: Path, states: States) -> str:
    """The path as CSV, one row per step; an undefined value is empty."""
    table = columns(path, states.vessel, states.zone)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    for row in zip(*table.values(), strict=True):
        writer.writerow(["" if np.isnan(v) else f"{v:.10g}" for v in row])
    return text.getvalue()


def to_json(path: Path, states: States, predictor: str) -> str:
    """The path as JSON: what predicted it, for which vessel, from which instant, and the columns; undefined is null."""
    table = columns(path, states.vessel, states.zone)
    values = {name: [None if np.isnan(v) else float(f"{v:.10g}") for v in column] for name, column in table.items()}
    return json.dumps({**_header(states, predictor), "path": values}, indent=1) + "\n"


def to_geojson(path: Path, states: States, predictor: str, outline_every: float = 15.0) -> str:
    """The path as GeoJSON: a line of midship and hull outlines every `outline_every` [s], longitude before latitude.

    Raises InputError for a log in local coordinates, which have no place on the globe.
    """
    zone = states.zone
    if zone is None:
        raise InputError(
            f"{states.path or 'states'}: positions are local, GeoJSON needs latitude and longitude; use json or csv"
        )

    def points(north, east) -> list[list[float]]:
        latitude, longitude = to_geodetic(north, east, zone)
        return np.round(np.degrees(np.column_stack([longitude, latitude])), 8).tolist()

    def feature(kind: str, coordinates: list, properties: dict[str, Any]) -> dict[str, Any]:
        return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}

    header = _header(states, predictor)
    features = [feature("LineString", points(path.north, path.east), {"kind": "predicted path", **header})]
    marks = np.arange(0.0, path.time[-1] + 1e-9, outline_every)
    marked = path.at(marks)
    for k, outline in enumerate(marked.outline(states.vessel.outline())):
        # RFC 7946 wants outer rings counter-clockwise; a body outline from the bow over starboard runs clockwise.
        ring = points(outline[::-1, 0], outline[::-1, 1])
        heading = round(float(np.degrees(compass(marked.true_heading[k]))), 3)
        features.append(
            feature("Polygon", [ring], {"kind": "predicted ship", "time_s": marks[k], "heading_true_deg": heading})
        )
    return json.dumps({"type": "FeatureCollection", "features": features}) + "\n"


def _header(states: States, predictor: str) -> dict[str, Any]:
    return {
        "predictor": predictor,
        "vessel": states.vessel.name,
        "voyage": states.voyage,
        "start": states.start,
        "at_s": float(states["time_s"][-1]),
        "zone": None if states.zone is None else str(states.zone),
    }
