"""The user's chart: GeoJSON as the page draws it, and what of it a hull must keep off, on the grid.

Depends on frames and schema.
"""

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from aspnn.frames import Zone, to_grid
from aspnn.schema import InputError

GROUND = ("land", "shore", "danger")  # kinds of features that a ship runs aground on
HARD = (*GROUND, "berth", "buoy")  # and all that clearances are measured to
SEGMENT = (
    0.002  # deg: the longest piece of a line that is straight on the grid (3 mm off at 70 N), as in prediction.fan
)
LARGEST = 50_000_000  # bytes of a chart's file


class Nearest(NamedTuple):
    """The nearest of the chart to some geometries: distance [m], the `kind` of feature, its place there (north, east) [m], and the number `piece`
    of that one of the geometries (the first of those that are as near).
    """

    distance: float
    kind: str
    place: tuple[float, float]
    piece: int


class Touch(NamedTuple):
    """The first of some geometries that touches something: its number `piece`, `what` it touches, and whether a ship runs aground there."""

    piece: int
    what: str
    aground: bool


@dataclass(frozen=True)
class Chart:
    """A chart: `text` is its GeoJSON, `tag` changes with it; `hard` the geometries (north, east [m]) to keep off, `kinds` theirs.

    `shoals` are the depth contours and areas, `depths` [m] theirs: within an area it is shallower than that.
    """

    text: str
    tag: str
    hard: tuple[BaseGeometry, ...]
    kinds: tuple[str, ...]
    tree: shapely.STRtree
    shoals: tuple[BaseGeometry, ...] = ()
    depths: tuple[float, ...] = ()

    def nearest(self, to: np.ndarray) -> Nearest | None:
        """The nearest hard feature to geometries (n) on the grid, None on a chart without any."""
        if not self.hard:
            return None
        (which, found), distance = self.tree.query_nearest(to, return_distance=True, all_matches=False)
        best = int(np.argmin(distance))
        index, k = int(which[best]), int(found[best])
        line = shapely.get_coordinates(shapely.shortest_line(self.hard[k], to[index]))
        return Nearest(float(distance[best]), self.kinds[k], tuple(line[0]), index)

    def touched(self, by: np.ndarray, draught: float) -> list[Touch]:
        """What the first of geometries (n) on the grid touches: where a ship of `draught` [m] runs aground, and what else there is to
        keep off; each at most once, none of no touch.

        Too shallow is an area of less water than the draught. The next deeper contour, which may or may not be, is the safety
        contour, as on an ECDIS.
        """
        safety = min((depth for depth in self.depths if depth > draught), default=math.inf)
        shoals = [k for k, depth in enumerate(self.depths) if depth <= safety]
        found = [
            (*pair, self.kinds[pair[1]], self.kinds[pair[1]] in GROUND) for pair in self.tree.query(by, "intersects").T
        ]
        for k in shoals:
            hit = np.flatnonzero(shapely.intersects(by, self.shoals[k]))
            if len(hit):
                found.append((hit[0], k, f"{self.depths[k]:g} m depth contour", self.depths[k] <= draught))
        first = [min((f for f in found if f[3] is aground), default=None) for aground in (True, False)]
        return [Touch(int(f[0]), f[2], f[3]) for f in first if f is not None]


def read_chart(path: str | FilePath, zone: Zone) -> Chart:
    """The chart of a GeoJSON file (a FeatureCollection, longitude before latitude). Raises InputError naming the file."""
    path = FilePath(path)
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f"{path}: is larger than {LARGEST // 1_000_000} MB; cut the chart to the waters sailed")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is no text"
        raise InputError(f"{path}: the chart cannot be read ({reason}); give a GeoJSON file") from None
    return parse_chart(text, zone, str(path))


def parse_chart(text: str, zone: Zone, where: str = "chart") -> Chart:
    """The chart of a GeoJSON text. Raises InputError naming `where` and the feature that is wrong."""
    try:
        data = json.loads(text)
        if data["type"] != "FeatureCollection":
            raise ValueError
        features: list[dict[str, Any]] = data["features"]
        found = [(f.get("properties") or {}, shapely.force_2d(shape(f["geometry"]))) for f in features if f["geometry"]]
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, shapely.errors.ShapelyError):
        raise InputError(f"{where}: is no GeoJSON FeatureCollection of points, lines and polygons (RFC 7946)") from None
    hard: list[BaseGeometry] = []
    shoals: list[BaseGeometry] = []
    kinds: list[str] = []
    depths: list[float] = []
    for number, (properties, geometry) in enumerate(found, start=1):
        corners = shapely.get_coordinates(geometry)
        if not (np.abs(corners) <= [180, 90]).all():
            raise InputError(f"{where}: feature {number} has no longitude and latitude in degrees, in this order")
        kind: Any = properties.get("kind")
        depth: Any = properties.get("depth")
        deep = kind == "depth" and isinstance(depth, int | float) and not isinstance(depth, bool)
        if (kind in HARD or deep) and not geometry.is_empty:
            placed = shapely.transform(shapely.segmentize(geometry, SEGMENT), lambda p: _on_grid(p, zone))
            if not np.isfinite(shapely.get_coordinates(placed)).all():
                raise InputError(f"{where}: feature {number} lies too far outside zone {zone}")
            if not (geometry.is_valid and placed.is_valid):
                raise InputError(f"{where}: feature {number} is a polygon that crosses itself")
            parts = shapely.get_parts(placed).tolist()
            if deep:
                shoals += parts
                depths += [float(depth)] * len(parts)
            else:
                hard += parts
                kinds += [kind] * len(parts)
    tag = hashlib.sha256(text.encode()).hexdigest()[:16]
    shapely.prepare([*hard, *shoals])
    return Chart(json.dumps(data), tag, tuple(hard), tuple(kinds), shapely.STRtree(hard), tuple(shoals), tuple(depths))


def _on_grid(points: np.ndarray, zone: Zone) -> np.ndarray:
    return np.column_stack(to_grid(np.radians(points[:, 1]), np.radians(points[:, 0]), zone))
