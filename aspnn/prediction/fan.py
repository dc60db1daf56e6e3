"""What if: the paths of many rudder orders in one call, and the order to choose so that the hull clears something.

A fan is a Path with a leading axis, one row per order. Obstacles are shapely geometries with the coordinates (north, east) [m]
of the states' grid: points, lines or polygons. `outline` is the hull in body axes, as Vessel.outline() gives it.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely.geometry import LineString, shape
from shapely.geometry.base import BaseGeometry

from aspnn.frames import Zone, to_grid
from aspnn.motion import Path
from aspnn.motion.swept import Approach, Sweep, closest_approach, sweep, swept_region
from aspnn.orders import Orders
from aspnn.prediction.plan import Orderable, make_plan
from aspnn.records import States
from aspnn.schema import InputError

if TYPE_CHECKING:
    from aspnn.prediction import Predictor

MOST = 361  # orders in one fan: more than the quarter degrees from stop to stop
LEVEL = 0.95  # of the regions that a clearance is judged by
SEGMENT = 0.002  # deg, the most of a line of longitude and latitude that is drawn straight on the grid (3 mm at 70 N)


@dataclass(frozen=True)
class Choice:
    """The order chosen from a fan: its row `index`, its `order`, how near the hull comes, and `time` [s].

    `clears` tells whether it does what was asked; where no order does, the row is the best one, as the chooser says. `time`
    is that of the closest approach (order_that_clears), of being past (soonest_past) or across (soonest_across), NaN for never.
    """

    index: int
    order: Orderable
    clears: bool
    distance: float
    time: float


def fan(predictor: "Predictor", states: States, orders: Sequence[Orderable], shaft_plan: Orderable = None) -> Path:
    """Paths (len(orders), steps) from the last of `states` under each of `orders`, in one call of `predict_many`.

    An order is an angle [rad] held from now on, or a plan of (seconds from now, angle) pairs; `shaft_plan` [rev/s] is that of
    all. A kinematic predictor knows of no rudder: its rows are all alike. Raises InputError as `predict` does.
    """
    if not len(orders):
        raise InputError("fan: no order was given; give at least one rudder order")
    plans = [make_plan(states, order, shaft_plan, predictor.horizon) for order in orders]
    return predictor.predict_many(states, np.full(len(plans), len(states) - 1), plans)


def approaches(paths: Path, outline: np.ndarray, obstacle: BaseGeometry) -> list[Approach]:
    """How near the hull comes to `obstacle` on each path of a fan, and when."""
    return [closest_approach(paths[k], outline, obstacle) for k in range(len(paths.north))]


def region_distances(paths: Path, outline: np.ndarray, obstacle: BaseGeometry) -> list[float] | None:
    """How near the 95 % swept region of each path comes to `obstacle` [m], or None where the paths have no regions.

    The hull is inside that region at any one instant with at least 90 % (see `swept_region`).
    """
    if paths.spread is None or not np.isfinite(paths.region(LEVEL).major).all():
        return None
    return [float(shapely.distance(swept_region(paths[k], outline, LEVEL), obstacle)) for k in range(len(paths.north))]


def order_in_force(states: States) -> float:
    """The rudder order [rad] at the last of `states`, or the rudder angle where no order is known. Raises InputError."""
    now = states.table.iloc[-1]
    for angle in (now["rudder_order_rad"], now["rudder_angle_rad"]):
        if math.isfinite(angle):
            return float(angle)
    raise InputError(
        f"{states.path or 'states'}: neither rudder order nor angle is known at the start; give another start"
    )


def deviation(order: Orderable, in_force: float) -> float:
    """The most [rad] that an order or a plan departs from the order in force; None holds that."""
    if order is None:
        return 0.0
    if isinstance(order, Orders):
        values = order.values
    else:
        values = np.array([order] if isinstance(order, int | float | np.number) else [pair[1] for pair in order], float)
    return round(float(np.abs(values - in_force).max()), 9)  # so that equal angles to either side are equal


def order_that_clears(
    orders: Sequence[Orderable], near: Sequence[Approach], distance: float, in_force: float
) -> Choice:
    """The order nearest to that `in_force` [rad] under which the hull stays at least `distance` [m] away, to the horizon.

    `near` are the `approaches` of the fan's paths. Of orders that depart equally far, the one that stays further away; of
    those, the one given first. Where none clears: the one that stays furthest away; of those that touch, the last to touch.
    """
    return _nearest(orders, near, [k for k, a in enumerate(near) if a.distance >= distance], in_force)


def _nearest(orders, near, clear, in_force) -> Choice:
    def depart(k):
        return deviation(orders[k], in_force)

    if clear:
        best = min(clear, key=lambda k: (depart(k), -near[k].distance))
    else:
        best = min(range(len(orders)), key=lambda k: (-near[k].distance, -near[k].time, depart(k)))
    return Choice(best, orders[best], bool(clear), near[best].distance, near[best].time)


def past(path: Path, outline: np.ndarray, obstacle: BaseGeometry) -> float:
    """When `obstacle` is abaft the hull for good [s]: wholly behind its aftmost end, athwart, until the horizon. NaN: never."""
    swept = sweep(path, outline)
    return _past(swept, shapely.get_coordinates(obstacle) - swept.origin, float(np.min(np.asarray(outline)[:, 0])))


def _past(swept: Sweep, corners: np.ndarray, aft: float) -> float:
    # Of a line or a polygon the foremost place is one of its corners.
    place = corners[:, 0] + 1j * corners[:, 1]
    ahead = ((place - swept.place[:, None]) * np.exp(-1j * swept.heading)[:, None]).real.max(axis=1) - aft
    return _below(swept.time, ahead, for_good=True)


def across(path: Path, outline: np.ndarray, line: LineString) -> float:
    """When the whole hull is first on the other side [s] of the line through the two ends of `line`. NaN: never.

    The side it starts from is that of midship. Raises InputError when that is on the line, or the line has no two ends.
    """
    ends = shapely.get_coordinates(line)
    if len(ends) != 2 or (ends[0] == ends[1]).all():
        raise InputError(f"line to cross: has {len(ends)} points; give two different ones")
    swept = sweep(path, outline)
    start, end = (ends - swept.origin) @ np.array([1, 1j])
    normal = (end - start) * 1j / abs(end - start)
    from_line = ((swept.hulls @ np.array([1, 1j]) - start) * np.conj(normal)).real
    side = np.sign(((swept.place[0] - start) * np.conj(normal)).real)
    if side == 0:
        raise InputError("line to cross: midship lies on it at the start; give a line ahead")
    return _below(swept.time, (from_line * side).max(axis=1), for_good=False)


def _below(time: np.ndarray, value: np.ndarray, for_good: bool) -> float:
    """When `value` first falls below zero, or does so for good, linear between the times; NaN where it does not."""
    over = value >= 0
    if for_good:
        if over[-1]:
            return math.nan
        k = len(over) - int(np.argmax(over[::-1])) if over.any() else 0
    else:
        if over.all():
            return math.nan
        k = int(np.argmin(over))
    if k == 0:
        return float(time[0])
    return float(time[k - 1] + (time[k] - time[k - 1]) * value[k - 1] / (value[k - 1] - value[k]))


def soonest_past(
    orders: Sequence[Orderable], near: Sequence[Approach], times: Sequence[float], distance: float, in_force: float
) -> Choice:
    """The order under which the hull is past soonest, at least `distance` [m] away all the time.

    `near` are the `approaches` of the fan's paths, `times` [s] when each is `past`. Ties as in order_that_clears. Where none does
    both within the horizon: the one that stays furthest away.
    """
    done = [k for k, a in enumerate(near) if a.distance >= distance and math.isfinite(times[k])]
    first = min((times[k] for k in done), default=math.nan)
    found = _nearest(orders, near, [k for k in done if times[k] <= first], in_force)
    return replace(found, time=times[found.index])


def soonest_across(
    paths: Path, orders: Sequence[Orderable], line: LineString, outline: np.ndarray, in_force: float
) -> Choice:
    """The order under which the whole hull is across `line` soonest (`across`); of equals the nearest to that in force.

    `distance` [m] is that to the line, 0 once it is touched. Where none gets across: the one that comes nearest to it, or touches it first.
    """
    near, times = approaches(paths, outline, line), [across(paths[k], outline, line) for k in range(len(orders))]
    first = np.nanmin(times) if np.isfinite(times).any() else math.nan

    def rank(k: int) -> tuple[float, ...]:
        return (near[k].distance, near[k].time) if math.isnan(first) else (0.0 if times[k] <= first else 1.0,)

    best = min(range(len(orders)), key=lambda k: (*rank(k), deviation(orders[k], in_force)))
    return Choice(best, orders[best], math.isfinite(times[best]), near[best].distance, times[best])


def judged(
    paths: Path,
    orders: Sequence[float],
    states: States,
    target: tuple[BaseGeometry, float] | None,
    tell: Callable[[str], None],
    soonest: bool = False,
) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    """What to write of each order of a fan, and of the one chosen to clear `target` (obstacle, distance [m]); None without.

    Where the paths have regions it is the region that must clear. The choice is the order nearest to that in force, or with `soonest`
    the one that is past soonest; `tell` gets a line on it.
    """
    notes: list[dict[str, Any]] = [{"rudder_order_deg": round(math.degrees(order), 6)} for order in orders]
    if target is None:
        return notes, None
    obstacle, distance = target
    outline = states.vessel.outline()
    near = approaches(paths, outline, obstacle)
    bounds = region_distances(paths, outline, obstacle)
    sure = near if bounds is None else [a._replace(distance=d) for a, d in zip(near, bounds, strict=True)]
    times = [past(paths[k], outline, obstacle) for k in range(len(orders))]
    for note, hull, bound, behind in zip(notes, near, sure, times, strict=True):
        note["clearance_m"] = round(hull.distance, 3)
        if bounds is not None:
            note["region_clearance_m"] = round(bound.distance, 3)
        note |= {"closest_s": round(hull.time, 3), "past_s": None if math.isnan(behind) else round(behind, 3)}
        note["clears"] = bound.distance >= distance
    in_force = order_in_force(states)
    smallest = order_that_clears(orders, sure, distance, in_force)
    choice = soonest_past(orders, sure, times, distance, in_force) if soonest else smallest
    said, hull = notes[choice.index], near[choice.index]
    words = f"rudder {said['rudder_order_deg']:g} deg keeps {hull.distance:.1f} m off, closest at {hull.time:.1f} s"
    if "region_clearance_m" in said:
        words += f" (its 95 % region: {said['region_clearance_m']:.1f} m)"
    if soonest:
        words += "" if said["past_s"] is None else f", past at {said['past_s']:.1f} s"
    asked = f"clears {distance:g} m" + (" and is past within the horizon" if soonest else "")
    tell(words if choice.clears else f"no order of the fan {asked}; the best: {words}")
    return notes, {**said, "distance_m": distance}


def parse_fan(text: str) -> list[float]:
    """Rudder orders [rad] from text such as -35:35:5, degrees FROM:TO:STEP with both ends. Raises InputError."""
    try:
        first, last, step = (float(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"--fan {text!r}: is not FROM:TO:STEP in degrees, such as -35:35:5") from None
    if not (math.isfinite(first) and math.isfinite(last) and 0 < step < math.inf and first <= last):
        raise InputError(f"--fan {text!r}: FROM must not be above TO, and STEP must be positive")
    count = (last - first) / step + 1 + 1e-9
    if count >= MOST + 1:
        raise InputError(
            f"--fan {text!r}: is {count:.0f} orders, at most {MOST} are predicted at once; take a larger STEP"
        )
    return [math.radians(first + k * step) for k in range(int(count))]


def parse_clear(text: str, zone: Zone | None) -> tuple[BaseGeometry, float]:
    """Obstacle (north, east [m]) and distance [m] from LAT,LON@METRES or FILE.geojson@METRES. Raises InputError."""
    what, _, metres = text.rpartition("@")
    try:
        distance = float(metres)
    except ValueError:
        distance = math.nan
    if not what or not 0 <= distance < math.inf:
        raise InputError(f"--clear {text!r}: is not LAT,LON@METRES or FILE.geojson@METRES, such as 69.65,18.96@100")
    if zone is None:
        raise InputError(
            "--clear: the positions of this log are local, latitude and longitude have no place among them"
        )
    try:
        latitude, longitude = (float(part) for part in what.split(","))
        given: BaseGeometry = shapely.Point(longitude, latitude)
    except ValueError:
        given = _read_geometry(what)
    corners = shapely.get_coordinates(given)
    if not (np.abs(corners) <= [180, 90]).all():
        raise InputError(
            f"--clear {what}: latitudes are within 90 deg and longitudes within 180; on the command line latitude is first"
        )

    def on_grid(points):
        return np.column_stack(to_grid(np.radians(points[:, 1]), np.radians(points[:, 0]), zone))

    placed = shapely.transform(shapely.segmentize(given, SEGMENT), on_grid)
    if not np.isfinite(shapely.get_coordinates(placed)).all():
        raise InputError(f"--clear {what}: lies too far outside zone {zone} of the log")
    return placed, distance


def _read_geometry(file: str) -> BaseGeometry:
    """All geometries of a GeoJSON file as one, (longitude, latitude) [deg]. Raises InputError naming the file."""
    if not FilePath(file).is_file():
        raise InputError(f"--clear {file}: is no LAT,LON and no such file")
    try:
        data = json.loads(FilePath(file).read_text())
        features = data["features"] if data["type"] == "FeatureCollection" else [data]
        shapes = [shape(f["geometry"] if f["type"] == "Feature" else f) for f in features]
        found = shapely.force_2d(shapes[0] if len(shapes) == 1 else shapely.union_all(shapes))
    except (ValueError, TypeError, LookupError, AttributeError, shapely.errors.ShapelyError):
        raise InputError(f"{file}: is no GeoJSON of points, lines or polygons (RFC 7946)") from None
    if found.is_empty or not found.is_valid:
        raise InputError(
            f"{file}: " + ("holds no geometry" if found.is_empty else "holds a polygon that crosses itself")
        )
    return found
