"""How near own ship and other ships come: both hulls along both predicted paths, and beside it the classical points on straight lines.

All places are (north, east) [m] of one grid. A path moves from step to step on the circular arc that joins two poses, as in
`motion.swept` (E40). Which targets are dangerous, adjustable limits say.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from aspnn.angles import compass
from aspnn.live.ahead import Target, predict
from aspnn.live.contact import contact_probability
from aspnn.motion import Path
from aspnn.schema import InputError

TOLERANCE = 0.5  # m: a least distance is surely too large by no more; where one minimum stands out it is exact to 1 mm
TOUCH = 0.05  # m: first contacts are sought until the hulls close by less in what remains of time
SPACING = 4.0  # s between the instants that are looked at first
NOW = 0.5  # s: a least distance at the start is sought, and found, within less
GOLDEN, ROUNDS = (math.sqrt(5) - 1) / 2, 12  # of the search about each minimum: 3e-3 of the interval remains


@dataclass(frozen=True)
class Limits:
    """A target is dangerous that comes within `cpa` [m] within `tcpa` [s]; one that is as near as that, but goes away, only within
    `guard` [m] of hull to hull. Raises InputError for what is no limit.
    """

    cpa: float = 200.0
    tcpa: float = 600.0
    guard: float = 50.0

    def __post_init__(self):
        named = (("cpa", self.cpa, 1e5, "m"), ("tcpa", self.tcpa, 7200.0, "s"), ("guard", self.guard, 1e5, "m"))
        for name, value, most, unit in named:
            if not 0 <= value <= most:
                raise InputError(f"limits: {name} = {value:g} is not within 0 to {most:g} {unit}")


class Closest(NamedTuple):
    """Least distances (n) [m] of two hulls, 0 where they touch; when (n) [s from the start]; the nearest places (n, 2) of each hull then.

    Where they touch the time is that of the first contact, else that of the least distance, the first of equal ones.
    """

    distance: np.ndarray
    time: np.ndarray
    own: np.ndarray
    other: np.ndarray


@dataclass(frozen=True)
class Danger:
    """One target as seen from own ship, at the start of the predictions. Distances [m], times [s], angles [rad] from grid north.

    `range`, `bearing` from midship to midship. `cpa`, `tcpa`: of both hulls along the predicted paths, within the horizon, with the
    nearest places `cpa_own`, `cpa_target` (2,); `probability` of contact within the horizon, NaN without regions. `dcpa`, `dtcpa`:
    classical, points on straight lines without end; negative times are past, NaN without relative motion. `receding`: the hulls are
    nearest now, and the points have passed each other. `index` is the target's row among the predicted paths.
    """

    target: Target
    index: int
    range: float
    bearing: float
    cpa: float
    tcpa: float
    cpa_own: np.ndarray
    cpa_target: np.ndarray
    probability: float
    dcpa: float
    dtcpa: float
    receding: bool
    dangerous: bool


class _Motion:
    """Paths (n, steps) as arcs: the pose at any instant. `points` (n, k): closed outlines, forward + i starboard [m]."""

    def __init__(self, path: Path, outlines: np.ndarray, origin: tuple[float, float]):
        north, east, self.heading = (np.atleast_2d(x) for x in (path.north, path.east, path.heading))
        self.place = (north - origin[0]) + 1j * (east - origin[1])
        self.time, self.points = path.time, np.atleast_3d(outlines) @ np.array([1, 1j])
        self.turn = np.diff(self.heading)
        self.step = np.diff(self.place)
        self.twist = self.step * np.exp(-1j * (self.heading[:, :-1] + self.turn / 2)) / np.sinc(self.turn / (2 * np.pi))
        self.radius = np.abs(self.points).max(axis=1)

    def poses(self, row: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place, north + i east [m] from the origin, and heading [rad] of `row` (m) at `time` (m) [s]."""
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        part = (time - self.time[k]) / (self.time[k + 1] - self.time[k])
        turned = part * self.turn[row, k]
        heading = self.heading[row, k]
        moved = part * self.twist[row, k] * np.exp(1j * (heading + turned / 2)) * np.sinc(turned / (2 * np.pi))
        return self.place[row, k] + moved, heading + turned

    def hulls(self, row: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Polygons (m) of the hulls of `row` (m) at `time` (m) [s]."""
        place, heading = self.poses(row, time)
        return _polygons(place[:, None] + np.exp(1j * heading)[:, None] * self.points[row])


def _polygons(corners: np.ndarray) -> np.ndarray:
    return shapely.polygons(np.stack([corners.real, corners.imag], axis=-1))


def closest(
    own: Path, outline: np.ndarray, others: Path, outlines: np.ndarray, tolerance: float = TOLERANCE
) -> Closest:
    """How near a hull on the path `own` (steps,) comes to those on `others` (n, steps), all at the times of `own`.

    `outline` (k, 2), `outlines` (n, k', 2) in body axes, closed. The polygons' distance is exact at each instant that is looked at. Between two
    instants w apart it is at least (d_a + d_b - K w) / 2, since no two points of the hulls close faster than
    K = |D_own - D_other| / dt + sum of (|q| |turn| / 2 + |turn| R) / dt: the chords' difference, what each arc departs from its
    chord, and the turning of the outermost points. Intervals that may hold less than the least so far are halved, until none may by
    more than `tolerance` [m]; a golden section search about the least one ends it.
    """
    origin = (float(own.north[0]), float(own.east[0]))
    a, b = _Motion(own, outline[None], origin), _Motion(others, outlines, origin)
    rows, dt = len(b.place), np.diff(own.time)
    closing = np.abs(a.step - b.step)
    for m in (a, b):
        closing = closing + np.abs(m.turn) * (np.abs(m.twist) / 2 + m.radius[:, None])
    closing = closing / dt
    every = max(1, round(SPACING / float(dt.mean())))
    first = np.arange(0, len(dt), every)
    nodes = np.append(first, len(dt))
    rate = np.maximum.reduceat(closing, first, axis=1)
    time = own.time[nodes]

    ship = shapely.Polygon(outline)

    def distance(row, t):
        # In the axes of own ship: one polygon to make, not two.
        (own_place, own_heading), (place, heading) = a.poses(np.zeros(len(row), int), t), b.poses(row, t)
        back, turn = np.exp(-1j * own_heading), np.exp(1j * (heading - own_heading))
        return shapely.distance(_polygons(((place - own_place) * back)[:, None] + turn[:, None] * b.points[row]), ship)

    apart = np.abs(a.place - b.place)[:, nodes]
    every_row, nearest = np.arange(rows), apart.argmin(axis=1)
    when = time[nearest]
    least, grain = distance(every_row, when), np.full(rows, float(np.diff(time).max()))
    # By circles about midship first; they leave most intervals out.
    outside = np.maximum(apart - a.radius[0] - b.radius[:, None], 0.0)
    lower = (outside[:, :-1] + outside[:, 1:] - rate * np.diff(time)) / 2
    row, k = np.nonzero(np.maximum(lower, 0.0) <= np.maximum(least - tolerance, 0.0)[:, None])
    needed = np.zeros(apart.shape, bool)
    needed[row, k] = needed[row, k + 1] = True
    at = np.nonzero(needed)
    exact = np.full(apart.shape, np.inf)
    exact[at] = distance(at[0], time[at[1]])
    _take(least, when, at[0], time[at[1]], exact[at])  # grain stays that of the nodes
    start, width, speed = time[k], time[k + 1] - time[k], rate[row, k]
    d_a, d_b = exact[row, k], exact[row, k + 1]
    while True:
        lower = np.maximum((d_a + d_b - speed * width) / 2, 0.0)
        free = least[row] > 0
        # Where they touch, only an earlier contact is of interest, to the time in which the hulls close by the tolerance.
        open_ = np.where(
            free,
            lower < least[row] - tolerance,
            (lower == 0) & (d_a > 0) & (start < when[row]) & (speed * width > TOUCH),
        )
        if not open_.any():
            break
        row, start, width, speed, d_a, d_b = (x[open_] for x in (row, start, width / 2, speed, d_a, d_b))
        middle = start + width
        d = distance(row, middle)
        moved = _take(least, when, row, middle, d)
        grain[row[moved]] = width[moved]
        row, width, speed = (np.concatenate([x, x]) for x in (row, width, speed))
        start, d_a, d_b = np.concatenate([start, middle]), np.concatenate([d_a, d]), np.concatenate([d, d_b])
    _polish(distance, least, when, grain, own.time[[0, -1]])
    lines = shapely.shortest_line(a.hulls(np.zeros(rows, int), when), b.hulls(every_row, when))
    ends = shapely.get_coordinates(lines).reshape(rows, 2, 2) + origin
    return Closest(least, when, ends[:, 0], ends[:, 1])


def _take(least: np.ndarray, when: np.ndarray, row: np.ndarray, time: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Let (row, time) with the distance `d` stand in `least` and `when`, in place, where nearer, or as near and earlier.

    Returns which of them now stand there.
    """
    order = np.lexsort((time, np.round(d, 6), row))  # a micrometre is rounding
    best = order[np.flatnonzero(np.diff(row[order], prepend=-1))]
    at, new, old = row[best], np.round(d[best], 6), np.round(least[row[best]], 6)
    better = best[(new < old) | ((new == old) & (time[best] < when[at]))]
    least[row[better]], when[row[better]] = d[better], time[better]
    return better


def _polish(distance, least: np.ndarray, when: np.ndarray, grain: np.ndarray, ends: np.ndarray) -> None:
    """Golden section search within `grain` of each minimum, in place. It takes what is nearer by more than rounding."""
    row = np.flatnonzero(least > 0)
    if not len(row):
        return
    low, high = np.clip(when[row] - grain[row], *ends), np.clip(when[row] + grain[row], *ends)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    d_left, d_right = distance(row, left), distance(row, right)
    for _ in range(ROUNDS):
        down = d_left <= d_right
        low, high = np.where(down, low, left), np.where(down, right, high)
        new = np.where(down, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        d_new = distance(row, new)
        left, right = np.where(down, new, right), np.where(down, left, new)
        d_left, d_right = np.where(down, d_new, d_right), np.where(down, d_left, d_new)
    _take(least, when, row, np.where(d_left <= d_right, left, right), np.minimum(d_left, d_right))


def classical(place: complex, velocity: complex) -> tuple[float, float]:
    """DCPA [m] and time to it [s] of points, by relative place [m] and velocity [m/s] (north + i east), target minus own.

    |p + v t| is least at t = -p.v / v^2. Without relative motion the distance stays, and the time is NaN.
    """
    squared = abs(velocity) ** 2
    if squared == 0:
        return abs(place), math.nan
    return abs((place.conjugate() * velocity).imag) / math.sqrt(squared), -(place.conjugate() * velocity).real / squared


def assess(
    own: Path, outline: np.ndarray, targets: Sequence[Target], now: float, limits: Limits
) -> tuple[list[Danger], Path]:
    """The targets as seen from own ship's predicted path `own` (steps,), which starts at `now` [s, UNIX], most dangerous first; and
    their own predicted paths (targets, steps).

    Dangerous is who comes within the limits by the hulls along the predicted paths, or by points on straight lines (which look
    further ahead than the horizon). Who goes away is so only within the guard: an alarm for every ship that has been passed is a false
    one. First the dangerous, those first that come soonest, those last that go away; the others by the least distance.
    """
    paths = predict(targets, now, own.time)
    if not targets:
        return [], paths
    outlines = np.stack([target.outline for target in targets])
    near = closest(own, outline, paths, outlines)
    probability = contact_probability(own, outline, paths, outlines)
    place = (paths.north - own.north)[:, 0] + 1j * (paths.east - own.east)[:, 0]
    speeds = [(p.surge[..., 0] + 1j * p.sway[..., 0]) * np.exp(1j * p.heading[..., 0]) for p in (paths, own)]
    found = []
    for k, target in enumerate(targets):
        dcpa, dtcpa = classical(complex(place[k]), complex(speeds[0][k] - speeds[1]))
        cpa, tcpa = float(near.distance[k]), float(near.time[k])
        receding, soon = tcpa < NOW and dtcpa < 0, math.inf
        if cpa <= (min(limits.guard, limits.cpa) if receding else limits.cpa) and tcpa <= limits.tcpa:
            soon = tcpa
        if dcpa <= limits.cpa and 0 <= dtcpa <= limits.tcpa:
            soon = min(soon, dtcpa)
        danger = Danger(
            target=target,
            index=k,
            range=abs(complex(place[k])),
            bearing=float(compass(np.angle(place[k]))),
            cpa=cpa,
            tcpa=tcpa,
            cpa_own=near.own[k],
            cpa_target=near.other[k],
            probability=float(probability[k]),
            dcpa=dcpa,
            dtcpa=dtcpa,
            receding=receding,
            dangerous=soon < math.inf,
        )
        found.append((not danger.dangerous, danger.dangerous and receding, soon, cpa, danger))
    return [danger for *_, danger in sorted(found, key=lambda entry: entry[:4])], paths
