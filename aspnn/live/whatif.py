"""What if: the paths of a plan and of a fan of orders, how near each comes to the chart and to other ships, the order to choose.

Pure: asked with a parsed request, the newest states and the targets as they are predicted. Depends on live.forecast and prediction.fan.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import shapely
from pydantic import BaseModel, ConfigDict, Field

from aspnn.frames import to_grid
from aspnn.live.areas import Strips, region_distance, strips_of
from aspnn.live.forecast import LEVEL, Forecaster, has_region
from aspnn.live.situation import MARK, line_of, one, outlines_of, rings_of
from aspnn.motion import Path
from aspnn.motion.swept import Approach
from aspnn.prediction.fan import order_in_force, order_that_clears
from aspnn.records import States
from aspnn.schema import InputError

MOST = 73  # orders in a fan from the page: from stop to stop at every degree
STRICT = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
Order = tuple[float, float]


class Fan(BaseModel):
    """Rudder orders from, to and step [deg]."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, populate_by_name=True)
    first: Annotated[float, Field(alias="from", ge=-180, le=180)]
    last: Annotated[float, Field(alias="to", ge=-180, le=180)]
    step: Annotated[float, Field(gt=0, le=360)]

    def orders(self) -> list[float]:
        """The orders [deg]. Raises InputError for none or too many."""
        if self.first > self.last:
            raise InputError(f"fan: from {self.first:g} is above to {self.last:g}; exchange them")
        count = (self.last - self.first) / self.step + 1 + 1e-9
        if count >= MOST + 1:
            raise InputError(f"fan: is {count:.0f} orders, at most {MOST} are predicted at once; take a larger step")
        return [self.first + k * self.step for k in range(int(count))]


class Clear(BaseModel):
    """A place to stay off: latitude and longitude [deg], distance [m]."""

    model_config = STRICT
    lat: Annotated[float, Field(ge=-84, le=84)]
    lon: Annotated[float, Field(ge=-180, le=180)]
    distance: Annotated[float, Field(ge=0, le=100_000)]


class WhatIf(BaseModel):
    """A request: a plan of (seconds from now, degrees), a fan, or both; and a place to stay off."""

    model_config = STRICT
    plan: Annotated[list[Order], Field(min_length=1, max_length=50)] | None = None
    fan: Fan | None = None
    clear: Clear | None = None


@dataclass(frozen=True)
class Other:
    """Another ship as predicted: `path` on the grid from `start` [s, UNIX], `outline` in body axes or None."""

    id: str
    name: str | None
    path: Path
    start: float
    outline: np.ndarray | None


def answer(
    asked: WhatIf, forecaster: Forecaster, states: States, epoch: float, others: Sequence[Other] = ()
) -> dict[str, Any]:
    """The answer of SITUATION.md; `epoch` [s, UNIX] is the zero of the states' time. Raises InputError, one line, for a plan beyond the stops."""
    if states.zone is None:
        raise InputError("what if: the states have no zone")
    if asked.plan is None and asked.fan is None:
        raise InputError("what if: give a plan, a fan, or both")
    degrees = [] if asked.fan is None else asked.fan.orders()
    orders: list[Any] = [math.radians(d) for d in degrees]
    if asked.plan is not None:
        orders.append([(time, math.radians(angle)) for time, angle in asked.plan])
    paths = forecaster.fan(states, orders)
    hull, start = forecaster.outline, epoch + float(states["time_s"][-1])
    spot = _spot(asked.clear, states) if asked.clear is not None else None
    ships = nearest_ships(paths, hull, others, start)
    entries, near = [], []
    for k in range(len(orders)):
        path, planned = paths[k], k >= len(degrees)
        strips = strips_of(path, hull)
        point = None
        if spot is not None:
            approach = _approach(strips, spot)
            bound = None
            if has_region(path):
                bound = region_distance(path, hull, LEVEL, (spot.x, spot.y))
            # As prediction.fan has it: where there are regions it is the region that must clear.
            near.append(approach if bound is None else approach._replace(distance=bound))
            point = {"distance": one(approach.distance, 1), "region": None if bound is None else one(bound, 1)}
            point["time"] = one(approach.time, 1)
        shore = forecaster.clearance(strips)
        last = float(path.time[-1])
        marks = np.arange(MARK, last + 1e-6, MARK) if planned else np.array([last])
        entries.append(
            {
                "rudder": None if planned else one(degrees[k], 2),
                "plan": [list(pair) for pair in asked.plan] if planned and asked.plan is not None else None,
                **line_of(states.zone, path),
                "outlines": outlines_of(states.zone, path, hull, marks),
                "swept": rings_of(states.zone, strips.area()) if planned else [],
                "shore": None if shore is None else {"distance": one(shore.distance, 1), "time": one(shore.time, 1)},
                "target": ships[k],
                "point": point,
            }
        )
    return {
        "start": round(start, 3),
        "paths": entries,
        "choice": None if asked.clear is None else _choice(asked.clear, degrees, orders, entries, near, states),
    }


def nearest_ships(paths: Path, hull: np.ndarray, others: Sequence[Other], start: float) -> list[dict[str, Any] | None]:
    """For each of `paths` (n, steps) from `start` [s, UNIX] the other ship that comes nearest to the hull, at the paths' own instants; a
    point where her size is unknown."""
    if not others:
        return [None] * len(paths.north)
    theirs = [other.path.at(paths.time + (start - other.start)) for other in others]
    place = np.array([path.north + 1j * path.east for path in theirs])
    reach = [0.0 if other.outline is None else float(np.hypot(*other.outline.T).max()) for other in others]
    # Hulls are no further apart than their midships, and nearer by no more than both reach.
    margin = np.array(reach)[:, None] + float(np.hypot(*hull.T).max())
    found: list[dict[str, Any] | None] = []
    for k in range(len(paths.north)):
        path = paths[k]
        apart = np.abs(place - (path.north + 1j * path.east))
        if not np.isfinite(apart).any():
            found.append(None)
            continue
        row, step = np.nonzero(apart - margin <= np.nanmin(apart))
        mine = shapely.polygons(path.outline(hull))
        shapes = np.empty(len(row), object)
        for i in np.unique(row):
            at, outline = row == i, others[i].outline
            there = place[i, step[at]]
            corners = np.stack([there.real, there.imag], axis=-1)
            if outline is not None:
                turned = np.exp(1j * theirs[i].heading[step[at]])[:, None] * (outline @ np.array([1, 1j]))
                corners = corners[:, None] + np.stack([turned.real, turned.imag], axis=-1)
            shapes[at] = shapely.points(corners) if outline is None else shapely.polygons(corners)
        distance = shapely.distance(mine[step], shapes)
        best = np.lexsort((step, distance))[0]
        other = others[row[best]]
        time = one(path.time[step[best]], 1)
        found.append({"distance": one(distance[best], 1), "time": time, "id": other.id, "name": other.name})
    return found


def _approach(strips: Strips, spot: shapely.Point) -> Approach:
    """How near what is swept comes to a place, first."""
    distance = shapely.distance(strips.pieces, spot)
    k = int(np.argmin(distance))
    return Approach(float(distance[k]), float(strips.time[k]))


def _spot(clear: Clear, states: States) -> shapely.Point:
    assert states.zone is not None
    north, east = to_grid(math.radians(clear.lat), math.radians(clear.lon), states.zone)
    if not np.isfinite(north + east):
        raise InputError(f"clear: the place lies too far outside zone {states.zone}")
    return shapely.Point(float(north), float(east))


def sided(degrees: float) -> str:
    """A rudder order as a helmsman hears it: 25 deg port, 5 deg starboard, amidships."""
    return "amidships" if degrees == 0 else f"{abs(degrees):g} deg {'port' if degrees < 0 else 'starboard'}"


def _choice(clear: Clear, degrees, orders, entries, near, states: States) -> dict[str, Any] | None:
    """Of the fan's orders the one nearest to that in force that stays off; None where there is no fan.

    Orders that run into the shore or another ship are chosen only where all do; a shore or a ship that is nearer than the distance
    asked of the place is told besides.
    """
    if not degrees:
        return None
    fan = range(len(degrees))
    free = [k for k in fan if all(there["distance"] > 0 for _, there in _besides(entries[k]))]
    kept = free or list(fan)
    found = order_that_clears(
        [orders[k] for k in kept], [near[k] for k in kept], clear.distance, order_in_force(states)
    )
    chosen = kept[found.index]
    entry, clears = entries[chosen]["point"], found.clears and bool(free)
    said = f"{sided(degrees[chosen])} keeps {entry['distance']:.0f} m off, closest at {entry['time']:.0f} s"
    for what, there in _besides(entries[chosen]):
        if there["distance"] < clear.distance:
            said += (
                f", but touches {what}" if there["distance"] == 0 else f", but {what} only {there['distance']:.0f} m"
            )
    return {
        "rudder": one(degrees[chosen], 2),
        "clears": clears,
        "distance": entry["distance"],
        "text": said if clears else f"no order keeps {clear.distance:g} m off and touches nothing; the best: {said}",
    }


def _besides(entry: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Shore and nearest ship of a path, where there are any."""
    target = entry["target"]
    found = [("shore", entry["shore"]), ("" if target is None else target["name"] or target["id"], target)]
    return [(what, there) for what, there in found if there is not None]
