"""Routes of straight legs between waypoints, and where ships are along them: path angle, along- and cross-track error, next leg.

North and east in m, angles in rad clockwise from north, cross-track error positive to starboard of the leg. Depends on angles and schema.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from aspnn.angles import wrap
from aspnn.schema import InputError

SHARPEST = math.radians(175)  # of a turn at a waypoint; nearer to a reversal it is the noise that says to which side


@dataclass(frozen=True)
class Route:
    """Waypoints `points` (n, 2), north and east [m]. Raises InputError for those that are no route, named by their number from 1."""

    points: np.ndarray

    def __post_init__(self):
        points = np.array(self.points, float)
        object.__setattr__(self, "points", points)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
            raise InputError("route: needs two waypoints or more, each [north, east] in metres")
        same = np.flatnonzero(self.lengths == 0)
        if len(same):
            place = ", ".join(f"{x:g}" for x in points[same[0]])
            raise InputError(f"route: waypoints {same[0] + 1} and {same[0] + 2} are both ({place}); drop one of them")
        back = np.flatnonzero(np.abs(self.turns) > SHARPEST)
        if len(back):
            raise InputError(
                f"route: at waypoint {back[0] + 2} it turns back by {math.degrees(abs(self.turns[back[0]])):.3g} degrees;"
                f" put a waypoint beside it, which says to which side to turn"
            )

    @cached_property
    def lengths(self) -> np.ndarray:
        """Of each leg (n - 1,) [m]."""
        return np.hypot(*np.diff(self.points, axis=0).T)

    @cached_property
    def angles(self) -> np.ndarray:
        """Path angle of each leg (n - 1,) [rad], wrapped."""
        north, east = np.diff(self.points, axis=0).T
        return np.arctan2(east, north)

    @cached_property
    def turns(self) -> np.ndarray:
        """Turn at each inner waypoint (n - 2,) [rad], positive to starboard."""
        return wrap(np.diff(self.angles))

    def sharp(self, switch_radius: float, turning_radius: float) -> str | None:
        """One line about the turns that a ship of `turning_radius` [m] cannot make without leaving the route; None if there are none.

        A turn by theta on a circle of radius rho, begun `switch_radius` R before the waypoint, ends rho (1 - cos theta) - R sin theta
        outside the next leg, rho sin theta - R cos theta along it (plane geometry; rudder and reference make it worse).
        """
        theta = np.abs(self.turns)
        outside = turning_radius * (1 - np.cos(theta)) - switch_radius * np.sin(theta)
        ends = turning_radius * np.sin(theta) - switch_radius * np.cos(theta)
        lost = ends > self.lengths[1:]
        if lost.any():
            first = int(np.argmax(lost))
            return (
                f"route: the turn of {math.degrees(theta[first]):.0f} degrees at waypoint {first + 2} ends {ends[first]:.0f} m along a leg"
                f" of {self.lengths[first + 1]:.0f} m, with a turning circle of {turning_radius:.0f} m radius"
            )
        if not (outside > 0).any():
            return None
        worst = int(np.argmax(outside))
        return (
            f"route: {np.count_nonzero(outside > 0)} of {len(theta)} turns leave it, that at waypoint {worst + 2} by {outside[worst]:.0f} m,"
            f" with a turning circle of {turning_radius:.0f} m radius; a switching circle of"
            f" {turning_radius * np.tan(theta.max() / 2):.0f} m would not"
        )


class PathError(NamedTuple):
    """Where ships are on their paths, each (ships,)."""

    along: np.ndarray  # m from the start of the leg
    cross: np.ndarray  # m, positive to starboard of the leg
    path_angle: np.ndarray  # rad, wrapped
    remaining: np.ndarray  # m along the leg to its end, negative beyond
    leg: np.ndarray  # its number from 0
    done: np.ndarray  # whether the end of the last leg has been reached


class Follower:
    """Follows `ships` along their routes: each has its own of `routes`, or all have the one.

    A leg gives way to the next, and the last is done, when less than `switch_radius` [m] remains of it along the track, which is also so
    after an overrun (paper 000 (45), E58). Beyond the end of the last leg its line goes on. Raises InputError for a circle that
    swallows a leg.
    """

    def __init__(self, routes: Route | Sequence[Route], switch_radius: float, ships: int = 1):
        if not switch_radius > 0:
            raise InputError(f"route: a switching circle of {switch_radius:g} m; its radius must be above 0")
        each = [routes] if isinstance(routes, Route) else list(routes)
        if len(each) not in (1, ships):
            raise ValueError(f"{len(each)} routes for {ships} ships")
        for route in each:
            short = int(np.argmin(route.lengths))
            if route.lengths[short] <= switch_radius:
                raise InputError(
                    f"route: the leg from waypoint {short + 1} to {short + 2} is {route.lengths[short]:.4g} m, within a switching circle"
                    f" of {switch_radius:g} m; lessen the circle or drop a waypoint"
                )
        most = max(len(route.lengths) for route in each)
        padded = [(np.pad(route.angles, (0, most - len(route.angles))), route) for route in each]
        self._angle = np.stack([angle for angle, _ in padded])
        self._length = np.stack([np.pad(route.lengths, (0, most - len(route.lengths))) for route in each])
        self._start = np.stack([np.pad(route.points[:-1], ((0, most - len(route.lengths)), (0, 0))) for route in each])
        self._last = np.broadcast_to([len(route.lengths) - 1 for route in each], ships)
        self._row = np.arange(ships) if len(each) == ships else np.zeros(ships, int)
        self.switch_radius = switch_radius
        self.leg = np.zeros(ships, int)
        self.done = np.zeros(ships, bool)

    def update(self, north, east) -> PathError:
        """Where ships at `north` and `east` (ships,) [m] are, after as many changes of leg as that place asks for."""
        while True:
            error = self._error(north, east)
            reached = error.remaining < self.switch_radius
            onward = reached & (self.leg < self._last)
            if not onward.any():
                break
            self.leg = self.leg + onward
        self.done = self.done | reached
        return error._replace(done=self.done)

    def _error(self, north, east) -> PathError:
        """Paper 000 (36), and (46) with cos on the northing and sin on the easting (E57)."""
        at = self._row, self.leg
        angle = self._angle[at]
        x, y = np.asarray(north, float) - self._start[at][:, 0], np.asarray(east, float) - self._start[at][:, 1]
        along, cross = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        return PathError(along, cross, angle, self._length[at] - along, self.leg, self.done)
