"""The area that a hull sweeps along a path, how near it comes to things, and its widening by what is not known.

Geometries are shapely's, with the coordinates (north, east) [m] of the path's grid, in this order as everywhere here. Between
two points of a path the hull moves on the one circular arc that joins the two poses (E40): the motion that `integrate` draws,
whatever velocities the path also holds. A step turns by less than a full circle.
"""

from typing import NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from aspnn.motion.path import Path
from aspnn.motion.spread import Region
from aspnn.schema import InputError

TOLERANCE = 0.01  # m: how far the boundary of a swept area may lie from the true one
TURN = 0.25  # rad, the most that a hull turns between two of the poses that are joined
RUN = 10  # poses whose strips are made at once
LOOKS = 32  # instants between two poses at which the closest approach is sought
SIDES = 32  # of the polygon around an ellipse
ARCS = 4  # parts of the arc of a corner, when the heading is not known


class Sweep(NamedTuple):
    """Poses (m,) of a hull so close together that straight lines between them stay within a tolerance of the motion.

    `time` [s]; `place`, north + i east [m] of midship from `origin` (2,); `heading` [rad]; `step` of the path that each pose lies
    in and `part` how far into it, 0 to 1; `points`, forward + i starboard [m] of the closed outline.
    """

    time: np.ndarray
    place: np.ndarray
    heading: np.ndarray
    step: np.ndarray
    part: np.ndarray
    points: np.ndarray
    origin: np.ndarray

    @property
    def hulls(self) -> np.ndarray:
        """Closed outlines (m, n, 2) as north, east [m] from the origin."""
        corners = self.place[:, None] + np.exp(1j * self.heading)[:, None] * self.points
        return np.stack([corners.real, corners.imag], axis=-1)


class Approach(NamedTuple):
    """How near a hull comes to something: the least distance [m], 0 where it touches, and when [s from the start]."""

    distance: float
    time: float


def sweep(path: Path, outline: np.ndarray, tolerance: float = TOLERANCE, most: float = TURN) -> Sweep:
    """Poses along one path (steps,) of a hull with the body `outline` (n, 2), fine enough for `tolerance` [m], no more than `most` [rad]
    of turn apart.

    A step with turn w and displacement d has the twist q = d exp(-i (psi + w / 2)) / sinc(w / 2), the body velocity times
    dt (E40 turned round). At the part s of the step midship has moved by s q exp(i s w / 2) sinc(s w / 2) in the axes of the
    start, and a point z of the hull has run an arc at the rate |q + i w z|, whose second derivative by s is |w| times that.
    Straight lines over 1 / m of the step err by at most |w| |q + i w z| / (8 m^2), which sets m.
    """
    points = np.asarray(outline, float) @ np.array([1, 1j])
    points = points if points[0] == points[-1] else np.append(points, points[0])
    origin = np.array([path.north[0], path.east[0]])
    place = (path.north - origin[0]) + 1j * (path.east - origin[1])
    turn = np.diff(path.heading)
    twist = np.diff(place) * np.exp(-1j * (path.heading[:-1] + turn / 2)) / np.sinc(turn / (2 * np.pi))
    rate = np.abs(twist[:, None] + 1j * turn[:, None] * points).max(axis=1)
    # 7.9 for 8: two tangents of a circle meet a little further out (1 / cos(w / 2) - 1) than w^2 / 8.
    parts = np.maximum(np.sqrt(np.abs(turn) * rate / (7.9 * tolerance)), np.abs(turn) / most)
    count = np.maximum(np.ceil(parts), 1).astype(int)
    last = len(turn) - 1
    step = np.append(np.repeat(np.arange(last + 1), count), last)
    first = np.cumsum(count) - count
    part = np.append(np.arange(count.sum()) - np.repeat(first, count), count[-1]) / count[step]
    turned = part * turn[step]
    moved = part * twist[step] * np.exp(1j * (path.heading[step] + turned / 2)) * np.sinc(turned / (2 * np.pi))
    time = path.time[step] + part * np.diff(path.time)[step]
    return Sweep(time, place[step] + moved, path.heading[step] + turned, step, part, points, origin)


def _quads(hulls: np.ndarray) -> np.ndarray:
    """Rings (m - 1, n - 1, 5, 2) around what each edge of the outline sweeps between poses: the quadrangle of its ends."""
    before, after = hulls[:-1], hulls[1:]
    return np.stack([before[:, :-1], after[:, :-1], after[:, 1:], before[:, 1:], before[:, :-1]], axis=-2)


def _strips(hulls: np.ndarray) -> np.ndarray:
    """Polygons whose union is what the edges of the outline sweep from pose to pose.

    The quadrangles of an edge over RUN poses are one strip where the edge moves to the same side all along it and the
    strip does not meet itself. (The Jacobian of the bilinear map of an edge and a step is linear in both: its four corners
    tell.) An edge that the hull turns about sweeps two triangles, which GEOS finds; one that slides along itself sweeps none.
    """
    quads = _quads(hulls)
    p0, p1, q1, q0 = (quads[:, :, k, 0] + 1j * quads[:, :, k, 1] for k in range(4))
    aside = np.stack([(edge.conj() * moved).imag for edge in (q0 - p0, q1 - p1) for moved in (p1 - p0, q1 - q0)])
    found = []
    for k in range(0, len(quads), RUN):
        tracks = hulls[k : k + RUN + 1]
        rings = np.concatenate([tracks[:, :-1], tracks[::-1, 1:], tracks[:1, :-1]]).swapaxes(0, 1)
        strips, sides = shapely.polygons(rings), aside[:, k : k + RUN]
        whole = ((sides > 0).all(axis=(0, 1)) | (sides < 0).all(axis=(0, 1))) & shapely.is_valid(strips)
        single = shapely.polygons(quads[k : k + RUN, ~whole]).ravel()
        crossed = ~shapely.is_valid(single)
        single[crossed] = shapely.make_valid(single[crossed])
        found += [strips[whole], shapely.get_parts(single)]
    pieces = np.concatenate(found)
    return pieces[shapely.area(pieces) > 0]


def swept_area(path: Path, outline: np.ndarray, tolerance: float = TOLERANCE) -> Polygon | MultiPolygon:
    """The area (north, east [m]) that a hull with the body `outline` (n, 2) sweeps along one path (steps,).

    Its boundary lies within `tolerance` [m] of the true envelope. A point that is ever under the hull is under it at the start
    or is crossed by an edge: the area is the union of the first hull and of what the edges sweep from pose to pose. So
    the outline need not be convex, and turning leaves no scallops; a closed circle leaves its hole.
    """
    swept = sweep(path, outline, tolerance)
    hulls = swept.hulls
    # Further hulls than the first close the slits of rounding between the strips of one run and those of the next.
    pieces = np.concatenate([_strips(hulls), shapely.polygons(hulls[::RUN])])
    return _placed(_without_slits(shapely.union_all(pieces), tolerance), swept.origin)


def region_at(swept: Sweep, region: Region) -> tuple[np.ndarray, np.ndarray]:
    """The half axes of a path's `region` as symmetric matrices (poses, 2, 2) [m] and its interval of heading (poses,) [rad] at the
    poses of its sweep, linear between the path's steps."""
    step, part = swept.step, swept.part
    along = np.stack([np.cos(region.azimuth), np.sin(region.azimuth)], axis=-1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    axes = sum(
        a[:, None, None] * d[:, :, None] * d[:, None] for a, d in ((region.major, along), (region.minor, across))
    )
    axes = axes[step] * (1 - part)[:, None, None] + axes[step + 1] * part[:, None, None]
    off = np.minimum(region.heading[step] * (1 - part) + region.heading[step + 1] * part, np.pi)
    return axes, off


def swept_region(
    path: Path, outline: np.ndarray, level: float = 0.95, tolerance: float = TOLERANCE
) -> Polygon | MultiPolygon:
    """An outer bound (north, east [m]) of where the hull may be along one path with a `spread`.

    At each pose the hull is turned through the interval of heading of `path.region(level)` and widened by its ellipse of
    position (Minkowski sum). Each of the two holds with its share; both at once, and so the hull inside the bound at any one
    instant, with at least 2 level - 1, however they depend on each other (Bonferroni). Between steps of the path the half axes
    (as a symmetric matrix) and the interval are linear; from pose to pose the convex hull of both is taken, so a concave outline
    counts as filled. As in `swept_area`, arcs lie outside by `tolerance` [m] at most. Raises InputError without a region.
    """
    swept, region = sweep(path, outline, tolerance), path.region(level)
    known = np.isfinite(region.major + region.minor + region.azimuth + region.heading)
    if not known.all():
        raise InputError(
            f"this path has no region at {path.time[~known][0]:g} s; shorten the horizon to what is calibrated"
        )
    axes, off = region_at(swept, region)
    # Around the ellipse and around the arc of each corner run tangents, so that polygons bound them from outside.
    around = 2 * np.pi * np.arange(SIDES) / SIDES
    ellipse = np.stack([np.cos(around), np.sin(around)], axis=-1) / np.cos(np.pi / SIDES) @ axes
    middles = (2 * np.arange(ARCS) + 1) / ARCS - 1
    inside = np.exp(1j * off[:, None] * middles) / np.cos(off / ARCS)[:, None]
    turned = (
        np.concatenate([inside, np.exp(1j * off[:, None] * [-1, 1])], axis=-1) * np.exp(1j * swept.heading)[:, None]
    )
    corners = swept.place[:, None, None] + turned[:, :, None] * swept.points[:-1]
    corners = np.stack([corners.real, corners.imag], axis=-1).reshape(len(off), -1, 1, 2)
    clouds = (corners + ellipse[:, None]).reshape(len(off), -1, 2)
    shapes = shapely.convex_hull(shapely.linestrings(clouds))  # ten times faster to make than multipoints
    pieces = shapely.convex_hull(shapely.geometrycollections(np.stack([shapes[:-1], shapes[1:]], axis=-1)))
    return _placed(_without_slits(shapely.union_all(pieces), tolerance), swept.origin)


def _without_slits(area: BaseGeometry, tolerance: float) -> Polygon | MultiPolygon:
    """The area without holes smaller than `tolerance` squared: slits of rounding, from which no true hole can be told."""
    parts = [
        Polygon(part.exterior, [hole for hole in part.interiors if Polygon(hole).area > tolerance**2])
        for part in shapely.get_parts(area)
    ]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _placed(area, shift: np.ndarray):
    return shapely.transform(area, lambda points: points + shift)


def closest_approach(path: Path, outline: np.ndarray, obstacle: BaseGeometry, tolerance: float = TOLERANCE) -> Approach:
    """How near a hull with the body `outline` (n, 2) comes to `obstacle` (north, east [m]) along one path (steps,).

    The distance is that to the swept area, within `tolerance` [m]; 0 where the hull touches the obstacle or covers it. The time
    is when it is first reached [s from the start], within 1/32 of a step of the path.
    """
    swept = sweep(path, outline, tolerance)
    hulls, thing = swept.hulls, _placed(obstacle, -swept.origin)
    if shapely.distance(Polygon(hulls[0]), thing) == 0:
        return Approach(0.0, float(swept.time[0]))
    # A quadrangle that crosses itself is no valid polygon, but its two triangles are its inside all the same.
    near = shapely.distance(shapely.polygons(_quads(hulls)), thing).min(axis=1)
    k = int(np.argmin(near))
    part = np.linspace(0, 1, LOOKS + 1)
    between = hulls[k] * (1 - part[:, None, None]) + hulls[k + 1] * part[:, None, None]
    first = part[np.argmin(shapely.distance(shapely.polygons(between), thing))]
    return Approach(float(near[k]), float(swept.time[k] + first * (swept.time[k + 1] - swept.time[k])))
