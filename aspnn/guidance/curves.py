"""Paths that bend: lines and arcs, splines through waypoints, and the point of them that ships have abeam.

A curve gives places by a parameter w from 0 to `end`; a follower moves the foot point of each ship along with it, by Newton's method from where
it was, so that it never jumps to another branch where a path comes near itself. Depends on route and schema.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from aspnn.angles import difference
from aspnn.guidance.route import PathError, Route
from aspnn.schema import InputError

ROUNDS = 20  # of Newton's method at most, beside those that walk the whole path; along it two or three are enough
SAMPLES = 2001  # of a curve, by which its tightest bend is known
NEAR = 0.2  # part of the distance to the centre of curvature within which Newton's step is not trusted
CLOSE = 1e-5  # m: a last step of Newton's method that leaves its square
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
STRIDE = 0.5  # rad, by which the path may turn at most in one step of the foot point, where it is tightest


class Place(NamedTuple):
    """Places of a curve and their first and second derivatives by its parameter: north and east [m], each (n,)."""

    north: np.ndarray
    east: np.ndarray
    d_north: np.ndarray
    d_east: np.ndarray
    dd_north: np.ndarray
    dd_east: np.ndarray

    @property
    def angle(self) -> np.ndarray:
        """Path angle [rad], wrapped."""
        return np.arctan2(self.d_east, self.d_north)

    @property
    def curvature(self) -> np.ndarray:
        """1/m, positive where the path turns to starboard."""
        return (self.d_north * self.dd_east - self.d_east * self.dd_north) / np.hypot(self.d_north, self.d_east) ** 3


class Curve(Protocol):
    """What a follower needs of a path."""

    @property
    def end(self) -> float:
        """The parameter at the end; it begins at 0."""
        ...

    def at(self, w: np.ndarray) -> Place:
        """Places at parameters within [0, end]."""
        ...

    def arc(self, w: np.ndarray) -> np.ndarray:
        """Way along the path from its start [m]."""
        ...


@dataclass(frozen=True)
class ArcPath:
    """Straight lines and circular arcs that go on in each other's direction: pieces of constant curvature, the parameter is the way [m].

    `lengths` [m] and `curvatures` [1/m, positive to starboard, 0 straight], each (n,), from `start` (2,) [m] in the direction `angle` [rad].
    """

    start: np.ndarray
    angle: float
    lengths: np.ndarray
    curvatures: np.ndarray

    def __post_init__(self):
        for name in ("start", "lengths", "curvatures"):
            object.__setattr__(self, name, np.array(getattr(self, name), float))
        if len(self.lengths) == 0 or len(self.lengths) != len(self.curvatures) or not (self.lengths > 0).all():
            raise InputError("path: needs one piece or more, each with a length above 0 and a curvature")

    @staticmethod
    def through(route: Route, radius: float) -> "ArcPath":
        """The legs of a route, its corners rounded by arcs of `radius` [m]. Raises InputError where a leg is too short for its arcs."""
        if not radius > 0:
            raise InputError(f"path: a radius of {radius:g} m rounds no corner; it must be above 0")
        turns = route.turns
        cut = np.concatenate([[0.0], radius * np.tan(np.abs(turns) / 2), [0.0]])
        straight = route.lengths - cut[:-1] - cut[1:]
        if straight.min() < 0:
            leg = int(np.argmin(straight))
            raise InputError(
                f"path: arcs of {radius:g} m take {cut[leg] + cut[leg + 1]:.4g} m of the leg from waypoint {leg + 1} to {leg + 2}, which"
                f" has {route.lengths[leg]:.4g} m; lessen the radius"
            )
        lengths, curvatures = [], []
        for leg, length in enumerate(straight):
            if length > 0:
                lengths.append(length)
                curvatures.append(0.0)
            if leg < len(turns) and turns[leg] != 0:
                lengths.append(radius * abs(turns[leg]))
                curvatures.append(math.copysign(1 / radius, turns[leg]))
        return ArcPath(route.points[0], float(route.angles[0]), np.array(lengths), np.array(curvatures))

    @cached_property
    def _joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Way, direction and place (as north + i east) where each piece begins."""
        way = np.concatenate([[0.0], np.cumsum(self.lengths)])
        direction = self.angle + np.concatenate([[0.0], np.cumsum(self.lengths * self.curvatures)])
        pieces = np.exp(1j * direction[:-1]) * self.lengths * _chord(self.curvatures * self.lengths)
        return way, direction, complex(*self.start) + np.concatenate([[0.0], np.cumsum(pieces)])

    @property
    def end(self) -> float:
        """The whole way [m]."""
        return float(self._joints[0][-1])

    def at(self, w: np.ndarray) -> Place:
        """Exact places: c = c_i + exp(i alpha_i) s (exp(i kappa s) - 1) / (i kappa s)."""
        way, direction, joint = self._joints
        piece = np.clip(np.searchsorted(way, w, side="right") - 1, 0, len(self.lengths) - 1)
        s, kappa = w - way[piece], self.curvatures[piece]
        place = joint[piece] + np.exp(1j * direction[piece]) * s * _chord(kappa * s)
        ahead = np.exp(1j * (direction[piece] + kappa * s))
        bent = 1j * kappa * ahead
        return Place(place.real, place.imag, ahead.real, ahead.imag, bent.real, bent.imag)

    def arc(self, w: np.ndarray) -> np.ndarray:
        """The parameter itself."""
        return np.asarray(w, float)


def _chord(theta) -> np.ndarray:
    """(exp(i theta) - 1) / (i theta) = exp(i theta / 2) sinc(theta / 2), regular at 0."""
    return np.exp(0.5j * theta) * np.sinc(theta / (2 * np.pi))


@dataclass(frozen=True)
class SplinePath:
    """A smooth path through waypoints `points` (n, 2) [m]; the parameter runs by the chords between them.

    A cubic spline has a continuous curvature. `monotone` takes piecewise cubic Hermite (PCHIP) instead, which does not swing out beside the
    waypoints but whose curvature jumps at them. Raises InputError as `Route` for points that are no route.
    """

    points: np.ndarray
    monotone: bool = False

    def __post_init__(self):
        object.__setattr__(self, "points", Route(self.points).points)

    @cached_property
    def _knots(self) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(Route(self.points).lengths)])

    @cached_property
    def _curves(self):
        """The interpolating piecewise polynomial and its two derivatives."""
        kind = PchipInterpolator if self.monotone or len(self.points) < 3 else CubicSpline
        place = kind(self._knots, self.points)
        return place, place.derivative(), place.derivative(2)

    @cached_property
    def _ways(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters between which the way is one Gauss-Legendre sum, and the way at each."""
        at = np.concatenate([[0.0], *(a + (b - a) * np.arange(1, 17) / 16 for a, b in pairwise(self._knots))])
        return at, np.concatenate([[0.0], np.cumsum(self._length(at[:-1], at[1:]))])

    def _length(self, low, high) -> np.ndarray:
        half = 0.5 * (np.asarray(high) - low)
        inside = self._curves[1](np.asarray(low)[..., None] + half[..., None] * (NODES + 1))
        return half * (np.hypot(inside[..., 0], inside[..., 1]) @ WEIGHTS)

    @property
    def end(self) -> float:
        """The sum of the chords [m]."""
        return float(self._knots[-1])

    def at(self, w: np.ndarray) -> Place:
        """Places of the spline."""
        return Place(*(values for curve in self._curves for values in np.moveaxis(curve(w), -1, 0)))

    def arc(self, w: np.ndarray) -> np.ndarray:
        """Way along the spline [m], by Gauss-Legendre quadrature."""
        at, way = self._ways
        panel = np.clip(np.searchsorted(at, w, side="right") - 1, 0, len(at) - 2)
        return way[panel] + self._length(at[panel], w)


def path_turn(curvature, cross, speed, off) -> np.ndarray:
    """How fast the path angle at the foot point turns [rad/s]: kappa s', s' = U cos(chi - alpha) / (1 - kappa y_e).

    `off` = chi - alpha [rad]. A heading control needs it as feed-forward: without it the heading lags behind a path that bends.
    """
    return curvature * speed * np.cos(off) / (1 - curvature * cross)


class CurveFollower:
    """Follows `ships` along one curve; as `route.Follower`, with the curvature at the foot point beside the error.

    The foot point minimises the distance |p - c(w)|: Newton's step (p - c) . c' / (|c'|^2 - (p - c) . c'') where the ship is well on this side
    of the centre of curvature, else down the slope; no step is longer than the tightest bend of the path allows (STRIDE), so that
    none reaches another branch. It begins at the parameter `start`. Beyond its ends the path goes straight on; without a place (NaN) the
    foot point waits. `curvature` [1/m] and `parameter` (ships,) are those of the last update.
    """

    def __init__(self, curve: Curve, ships: int = 1, start: float = 0.0, arrival: float = 0.0):
        if not 0 <= start <= curve.end:
            raise InputError(f"path: the parameter {start:g} lies outside 0 to {curve.end:.4g}")
        self.curve, self.arrival = curve, arrival
        self.parameter, self.curvature = np.full(ships, float(start)), np.zeros(ships)
        self.done = np.zeros(ships, bool)
        self._way = float(curve.arc(np.array(curve.end)))
        every = curve.at(np.linspace(0.0, curve.end, SAMPLES))
        tightest = np.max(np.abs(every.curvature) * np.hypot(every.d_north, every.d_east))
        self._stride = curve.end if tightest * curve.end < STRIDE else STRIDE / tightest
        self._rounds = ROUNDS + int(curve.end / self._stride)

    def update(self, north, east) -> PathError:
        """Where ships at `north` and `east` (ships,) [m] are; `along` from the start of the curve, `done` within `arrival` [m] of its end."""
        north, east = np.asarray(north, float), np.asarray(east, float)
        w, end = self.parameter, self.curve.end
        known = np.isfinite(north) & np.isfinite(east)
        for _ in range(self._rounds):
            c = self.curve.at(w)
            x, y = north - c.north, east - c.east
            slope = x * c.d_north + y * c.d_east
            square = c.d_north**2 + c.d_east**2
            bend = square - (x * c.dd_north + y * c.dd_east)
            step = np.where(known, slope / np.where(bend > NEAR * square, bend, square), 0.0)
            moved = np.clip(w + np.clip(step, -self._stride, self._stride), 0.0, end)
            settled = np.abs(moved - w) * np.sqrt(square) < CLOSE
            w = moved
            if settled.all():
                break
        self.parameter = w
        c = self.curve.at(w)
        angle = c.angle
        x, y = north - c.north, east - c.east
        beyond = np.where((w <= 0) | (w >= end), x * np.cos(angle) + y * np.sin(angle), 0.0)
        along = self.curve.arc(w) + beyond
        self.curvature = np.where((beyond < 0) & (w <= 0) | (beyond > 0) & (w >= end), 0.0, c.curvature)
        remaining = self._way - along
        self.done = self.done | (remaining <= self.arrival)
        leg = np.zeros(len(self.parameter), int)
        return PathError(along, y * np.cos(angle) - x * np.sin(angle), angle, remaining, leg, self.done)

    def turn(self, error: PathError, speed, course) -> np.ndarray:
        """The feed-forward of the path's turning [rad/s] (ships,), see `path_turn`."""
        return path_turn(self.curvature, error.cross, speed, difference(course, error.path_angle))
