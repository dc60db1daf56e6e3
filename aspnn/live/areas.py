"""What a convex hull sweeps along a path, in pieces that are cheap to make, to join and to measure from; and how near its region comes.

Ten times a second and for each order of a fan. `motion.swept` does the same for any outline; here the outline counts as filled where
it is concave. Between two poses of `sweep`, whose arcs are flat to the tolerance, the convex hull of both holds all that is swept to that
tolerance. What it holds more is the notch between the sides of both where they cross, no deeper than a quarter of the turn times the
reach of the hull; so poses are as near in heading as keeps that within the tolerance too. Depends on motion.
"""

from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from aspnn.motion import Path
from aspnn.motion.swept import region_at, sweep, swept_region

EXACT, COARSE = 0.25, 1.0  # m: how far the boundaries of what is swept, and of its region, lie off at most
REGION_STEP = 6.0  # s between the poses that a swept region is made of: it is smooth, and dear
# Directions in which the distance of a region is sought, first of the whole circle, then between the neighbours of the best of those
# pieces that may be nearest: the least is too small by half the length of a side times the sine of half a fine interval (0.05 m).
DIRECTIONS, FINE = 180, 41


class Strips(NamedTuple):
    """Convex `pieces` (n) on the grid, each what is swept from `time` (n) [s] until the next."""

    time: np.ndarray
    pieces: np.ndarray

    def area(self) -> BaseGeometry:
        """The whole area."""
        return shapely.union_all(self.pieces)


def strips_of(path: Path, outline: np.ndarray, tolerance: float = EXACT) -> Strips:
    """What the hull with the body `outline` (n, 2) sweeps along one path (steps,), within `tolerance` [m]."""
    reach = float(np.hypot(*np.asarray(outline).T).max())
    swept = sweep(path, outline, tolerance, 4 * tolerance / reach)
    hulls = swept.hulls[:, :-1] + swept.origin
    lines = shapely.linestrings(np.concatenate([hulls[:-1], hulls[1:]], axis=1))
    return Strips(swept.time[:-1], shapely.convex_hull(lines))


def region_bound(path: Path, outline: np.ndarray, level: float) -> BaseGeometry:
    """`motion.swept.swept_region` by poses REGION_STEP apart, within COARSE."""
    return swept_region(_sparse(path), outline, level, COARSE)


def region_distance(path: Path, outline: np.ndarray, level: float, place: tuple[float, float]) -> float:
    """How near the swept region of one path comes to a `place` (north, east) [m]: that of `region_bound`, without making it. 0 inside.

    The distance of a place p to a convex set is the greatest n.p - h(n) over the directions n, with the support h of the set: of a
    piece the greater of the supports of its two poses, and of a pose that of its turned hull plus sqrt(n' C n) of its ellipse.
    """
    path = _sparse(path)
    swept, region = sweep(path, outline, COARSE), path.region(level)
    axes, off = region_at(swept, region)
    corners = swept.points[:-1]
    there = (place[0] - swept.origin[0]) + 1j * (place[1] - swept.origin[1])

    def apart(around: np.ndarray) -> np.ndarray:
        """n.p - h(n) (pieces, directions) [m] in the directions `around` [rad]."""
        # Each corner turned towards n as far as the interval of heading allows.
        aside = around - np.angle(corners)[:, None] - swept.heading[:, None, None]
        left = np.maximum(np.abs((aside + np.pi) % (2 * np.pi) - np.pi) - off[:, None, None], 0.0)
        hull = (np.abs(corners)[:, None] * np.cos(left)).max(axis=1)
        ellipse = np.linalg.norm(axes @ np.stack([np.cos(around), np.sin(around)]), axis=1)
        away = ((there - swept.place)[:, None] * np.exp(-1j * around)).real - hull - ellipse
        return np.minimum(away[:-1], away[1:])

    every = 2 * np.pi / DIRECTIONS
    around = every * np.arange(DIRECTIONS)
    first = apart(around)
    best = first.max(axis=1)
    longest = 2 * np.abs(corners).max() + np.abs(np.diff(swept.place)).max()
    near = np.flatnonzero(best <= best.min() + longest * np.sin(every / 2))
    finer = around[np.unique(first[near].argmax(axis=1))][:, None] + every * np.linspace(-1, 1, FINE)
    return max(float(apart(finer.ravel()).max(axis=1)[near].min()), 0.0)


def _sparse(path: Path) -> Path:
    end = float(path.time[-1])
    return path.at(np.append(np.arange(0.0, end - 1e-6, REGION_STEP), end))
