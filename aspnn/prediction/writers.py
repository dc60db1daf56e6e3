"""A predicted path for other programs: JSON, GeoJSON (RFC 7946) and CSV. Degrees and names with units, as at every edge."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry import mapping
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from aspnn.angles import compass
from aspnn.frames import Zone, to_geodetic
from aspnn.motion import Path
from aspnn.motion.spread import Region
from aspnn.motion.swept import swept_area, swept_region
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel

LEVEL = 0.95  # of all regions written
Notes = Sequence[dict[str, Any]]  # what is said of each order of a fan; rudder_order_deg first


def columns(path: Path, vessel: Vessel, zone: Zone | None) -> dict[str, np.ndarray]:
    """One predicted path as named columns with units. Undefined pivot points and regions are NaN.

    A path with a spread has its regions at LEVEL: half axes of the ellipse about midship, true azimuth of the major one, and the
    half-width of the interval about the heading.
    """
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
        "pivot_region": path.pivot_region(vessel.length),
    }
    if zone is not None:
        latitude, longitude = to_geodetic(path.north, path.east, zone)
        table |= {"latitude_deg": np.degrees(latitude), "longitude_deg": np.degrees(longitude)}
    if path.spread is not None:
        region = path.region(LEVEL)
        table |= {
            "region_95_major_m": region.major,
            "region_95_minor_m": region.minor,
            "region_95_azimuth_true_deg": np.degrees(np.mod(region.azimuth + path.true_heading - path.heading, np.pi)),
            "heading_95_deg": np.degrees(region.heading),
        }
    return table


def to_csv(path: Path, states: States) -> str:
    """The path as CSV, one row per step; an undefined value is empty."""
    return _csv([columns(path, states.vessel, states.zone)], [{}])


def fan_csv(paths: Path, notes: Notes, states: States) -> str:
    """A fan as CSV, one row per order and step, with what is said of the order in the first columns."""
    return _csv([columns(paths[k], states.vessel, states.zone) for k in range(len(notes))], notes)


def _csv(tables: Sequence[dict[str, np.ndarray]], notes: Notes) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*notes[0], *tables[0]])
    for table, note in zip(tables, notes, strict=True):
        said = ["" if v is None else str(v).lower() if isinstance(v, bool) else v for v in note.values()]
        for row in zip(*table.values(), strict=True):
            writer.writerow([*said, *("" if np.isnan(v) else f"{v:.10g}" for v in row)])
    return text.getvalue()


def to_json(path: Path, states: States, predictor: str, swept: bool = False) -> str:
    """The path as JSON: what predicted it, for which vessel, from which instant, and the columns; undefined is null.

    With `swept` also the swept area, and the swept region of a path with a spread, as polygons of rings of [north, east] in m.
    """
    return json.dumps({**_header(states, predictor), **_path_data(path, states, swept)}, indent=1) + "\n"


def fan_json(
    paths: Path, notes: Notes, states: States, predictor: str, chosen: dict[str, Any] | None = None, swept: bool = False
) -> str:
    """A fan as JSON: as `to_json`, with a list of one entry per order, and the order `chosen` where one was asked for."""
    entries = [{**note, **_path_data(paths[k], states, swept)} for k, note in enumerate(notes)]
    choice = {} if chosen is None else {"chosen": chosen}
    return json.dumps({**_header(states, predictor), **choice, "fan": entries}, indent=1) + "\n"


def _path_data(path: Path, states: States, swept: bool) -> dict[str, Any]:
    table = columns(path, states.vessel, states.zone)
    values = {name: [None if np.isnan(v) else float(f"{v:.10g}") for v in column] for name, column in table.items()}
    data: dict[str, Any] = {**_trust(path), "path": values}
    for kind, area, _ in _swept(path, states.vessel) if swept else ():
        polygons = [mapping(part)["coordinates"] for part in shapely.get_parts(area)]
        data[f"{kind.replace(' ', '_')}_m"] = [[np.round(ring, 3).tolist() for ring in rings] for rings in polygons]
    return data


def _trust(path: Path) -> dict[str, Any]:
    """What a path with a spread says of itself as a whole."""
    s = path.spread
    if s is None:
        return {}
    known = bool(np.isfinite(s.misfit))
    said = {"misfit": float(f"{s.misfit:.4g}"), "fits": bool(s.fits)} if known else {"misfit": None, "fits": None}
    return {"outside_training": bool(s.outside), **said}


def warnings(path: Path, predictor: str) -> list[str]:
    """What a reader must be told of a path (or a fan) with a spread, a line each; nothing where all is as in calibration."""
    spread = path.spread
    if spread is None:
        return []
    said = []
    if np.any(spread.outside):
        said.append(
            f"{predictor} was not trained for this start or plan (speed, rates, orders, wind, or a history with gaps): the half axes of "
            "its regions are doubled, and their shares are not known to hold"
        )
    if not np.all(spread.fits):
        said.append(
            f"{predictor} does not fit this ship today: its predictions of the last minutes were {np.nanmax(spread.misfit):.1f} "
            f"standard deviations off, {spread.limit:.1f} is the limit; regions are widened"
        )
    if not np.isfinite(spread.position[..., -1, :]).any(axis=-1).all():
        said.append(f"{predictor} was calibrated on too few plans of this kind: it has no regions for them")
    return said


def _known_region(path: Path) -> Region | None:
    """The region at LEVEL of a path that has one at each of its steps."""
    region = None if path.spread is None else path.region(LEVEL)
    return region if region is not None and np.isfinite(region.major + region.heading).all() else None


def _swept(path: Path, vessel: Vessel) -> list[tuple[str, BaseGeometry, dict[str, float]]]:
    """Kind, polygon (north, east [m]) and further properties of the swept area, and of the region where it is known."""
    areas: list[tuple[str, BaseGeometry, dict[str, float]]] = [("swept area", swept_area(path, vessel.outline()), {})]
    if _known_region(path) is not None:
        areas.append(("swept region", swept_region(path, vessel.outline(), LEVEL), {"level": LEVEL}))
    return areas


def to_geojson(path: Path, states: States, predictor: str, outline_every: float = 15.0, swept: bool = False) -> str:
    """The path as GeoJSON: a line of midship and hull outlines every `outline_every` [s], longitude before latitude.

    A path with a spread has the ellipse that midship is in at LEVEL beside each outline but the first. With `swept` also the
    swept area, and the swept region of a path with a spread. A path across the antimeridian is not cut there. Raises InputError
    for a log in local coordinates, which have no place on the globe.
    """
    features = _features(
        path, states, {"kind": "predicted path", **_header(states, predictor)}, {}, outline_every, swept
    )
    return json.dumps({"type": "FeatureCollection", "features": features}) + "\n"


def fan_geojson(
    paths: Path,
    notes: Notes,
    states: States,
    predictor: str,
    chosen: dict[str, Any] | None = None,
    outline_every: float = 15.0,
) -> str:
    """A fan as GeoJSON: for each order the features of `to_geojson` with its swept area, and its note in their properties.

    The order `chosen`, where one was asked for, is a member of the collection. Raises InputError as `to_geojson` does.
    """
    header = {"kind": "predicted path", **_header(states, predictor)}
    features = [
        feature
        for k, note in enumerate(notes)
        for feature in _features(paths[k], states, {**header, **note}, note, outline_every, True)
    ]
    choice = {} if chosen is None else {"chosen": chosen}
    return json.dumps({"type": "FeatureCollection", **choice, "features": features}) + "\n"


def _features(
    path: Path, states: States, header: dict[str, Any], note: dict[str, Any], outline_every: float, swept: bool
) -> list[dict[str, Any]]:
    zone = states.zone
    if zone is None:
        raise InputError(
            f"{states.path or 'states'}: positions are local, GeoJSON needs latitude and longitude; use json or csv"
        )

    def degrees(place) -> np.ndarray:
        latitude, longitude = to_geodetic(place[:, 0], place[:, 1], zone)
        return np.degrees(np.column_stack([longitude, latitude]))

    def feature(geometry: BaseGeometry, properties: dict[str, Any]) -> dict[str, Any]:
        # 1e-8 deg is a millimetre; RFC 7946 wants outer rings counter-clockwise, holes clockwise.
        placed = shapely.set_precision(shapely.transform(geometry, degrees), 1e-8)
        rounded = [orient(part) for part in shapely.get_parts(shapely.transform(placed, lambda p: np.round(p, 8)))]
        shape = rounded[0] if len(rounded) == 1 else shapely.MultiPolygon(rounded)
        return {"type": "Feature", "geometry": mapping(shape), "properties": properties}

    # Not the line: a precision grid would drop the points of a ship at rest.
    line = np.round(degrees(np.column_stack([path.north, path.east])), 8).tolist()
    whole = {**header, **_trust(path)}
    features = [{"type": "Feature", "geometry": {"type": "LineString", "coordinates": line}, "properties": whole}]
    marks = np.arange(0.0, path.time[-1] + 1e-9, outline_every)
    marked = path.at(marks)
    for k, outline in enumerate(marked.outline(states.vessel.outline())):
        heading = round(float(np.degrees(compass(marked.true_heading[k]))), 3)
        ship = {"kind": "predicted ship", "time_s": marks[k], "heading_true_deg": heading, **note}
        features.append(feature(shapely.Polygon(outline), ship))
    region = _known_region(marked)
    if region is not None:
        for k, ellipse in enumerate(region.outline()[1:], start=1):
            off = round(float(np.degrees(region.heading[k])), 3)
            place = {"kind": "region", "level": LEVEL, "time_s": marks[k], "heading_within_deg": off, **note}
            features.append(feature(shapely.Polygon(ellipse), place))
    for kind, area, more in _swept(path, states.vessel) if swept else ():
        features.append(feature(area, {"kind": kind, **more, **note}))
    return features


def _header(states: States, predictor: str) -> dict[str, Any]:
    return {
        "predictor": predictor,
        "vessel": states.vessel.name,
        "voyage": states.voyage,
        "start": states.start,
        "at_s": float(states["time_s"][-1]),
        "zone": None if states.zone is None else str(states.zone),
    }
