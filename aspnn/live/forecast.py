"""What a tick predicts: own ship's path with its region, the rate-of-turn arc beside it, the areas swept, and who was right.

A pure core: nothing here reads a clock. Times are those of the states (`time_s`). Depends on motion, prediction, live.chart.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from shapely.geometry.base import BaseGeometry

from aspnn.live.areas import Strips, region_bound, strips_of
from aspnn.live.chart import Chart
from aspnn.motion import Path
from aspnn.prediction import KinematicPredictor, constant
from aspnn.prediction.fan import fan
from aspnn.prediction.plan import Orderable
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel

STEP = 2.0  # s between the points of a path that is shown
LEVEL = 0.95
HELD = math.radians(1.0)  # the most by which a rudder order that is held may move
EVERY = 1.0  # s between predictions that are kept for judging
KEPT = 600  # ended predictions that a median runs over
GAP = 2.0  # s: across a longer gap of the states nothing is judged


class Clearance(NamedTuple):
    """Where a hull comes nearest to the chart first: metres, seconds from the start, the feature's kind, and its place (north, east)."""

    distance: float
    time: float
    what: str
    place: tuple[float, float]


class Touching(NamedTuple):
    """What the hull touches first on the chart, in how many seconds from the start, and whether she runs aground there."""

    time: float
    what: str
    aground: bool


@dataclass(frozen=True)
class Forecast:
    """A prediction: `start` is the time of the state it starts from, `arc` the kinematic path, always there.

    `path` is ours, None without a predictor or where it refuses; then `refused` says why. `swept` and `region_swept` are areas
    on the grid, the last one and `path.spread` only where there is a calibration; `region_start` is the time of the state that
    `region_swept` starts from. `fits`, `outside`: what the predictor knows of itself (None: nothing).
    """

    start: float
    arc: Path
    path: Path | None = None
    swept: BaseGeometry | None = None
    region_swept: BaseGeometry | None = None
    region_start: float = math.nan
    clearance: Clearance | None = None
    touches: tuple[Touching, ...] = ()
    fits: bool | None = None
    outside: bool = False
    refused: str = ""


class Ended(NamedTuple):
    """A prediction that has come to its end at one of the horizons: errors [m] of midship. `ours` is NaN without a predictor.

    `inside`: whether the 95 % region held midship, None without a region. `held`: whether the rudder order that was in force at its
    start stayed, to HELD, until its end (an order that is not known is not known to have changed).
    """

    start: float
    horizon: float
    ours: float
    arc: float
    inside: bool | None
    held: bool = True


@dataclass(frozen=True)
class Scores:
    """Running medians and last errors [m] at each of `horizons`: arrays (horizons,), NaN where nothing has ended yet.

    Of predictions whose order was held to their end, `count` of them; `set_apart` counts the others, of which neither ours nor the arc
    could know the order that came.
    """

    horizons: np.ndarray
    count: np.ndarray
    set_apart: np.ndarray
    ours_median: np.ndarray
    ours_last: np.ndarray
    arc_median: np.ndarray
    arc_last: np.ndarray


class _Pending(NamedTuple):
    start: float
    ours: np.ndarray  # (horizons, 2) north, east; NaN without a predictor
    arc: np.ndarray
    inverse: np.ndarray | None  # (horizons, 2, 2): e^T A e <= 1 inside the region
    due: list[int]  # numbers of the horizons that have not ended


@dataclass
class Forecaster:
    """Predicts from the newest states and keeps the score of what it predicted. Memory is bounded: a horizon of predictions.

    `predictor` None: the arc alone. `horizon` [s] is that of the arc then, else the predictor's counts.
    """

    predictor: Any  # a prediction.Predictor with `fan`, or None
    vessel: Vessel
    horizon: float = 90.0
    chart: Chart | None = None
    _pending: deque[_Pending] = field(default_factory=deque, repr=False)
    _errors: list[deque[Ended]] = field(default_factory=list, repr=False)
    _counts: list[int] = field(default_factory=list, repr=False)
    _apart: list[int] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        if self.predictor is not None:
            self.horizon = float(self.predictor.horizon)
        self.horizons = self.horizon * np.array([1.0, 2.0, 3.0]) / 3.0
        self.time = np.append(np.arange(0.0, self.horizon, STEP), self.horizon)
        self.outline = self.vessel.outline()
        self.kinematic = KinematicPredictor(self.vessel, constant, self.horizon, period=STEP / 2)
        self._errors = [deque(maxlen=KEPT) for _ in self.horizons]
        self._counts = [0 for _ in self.horizons]
        self._apart = [0 for _ in self.horizons]

    @property
    def pending(self) -> int:
        """How many predictions wait for their end."""
        return len(self._pending)

    def predict(
        self, states: States, rudder: Orderable = None, shaft: Orderable = None, before: Forecast | None = None
    ) -> Forecast:
        """The forecast from the last of `states` (not empty) under a plan, without one under the orders in force.

        What the predictor cannot do (too little history, another ship, no order known) leaves `path` None and a line in `refused`.
        The swept region, its dearest part, is taken over from the forecast `before`, if one is given.
        """
        arc = self.kinematic.predict(states).at(self.time)
        start = float(states["time_s"][-1])
        if self.predictor is None:
            return Forecast(start, arc)
        try:
            whole = self.predictor.predict(states, rudder, shaft)
        except InputError as error:
            return Forecast(start, arc, refused=str(error))
        path = whole.at(self.time)
        if not np.isfinite(path.north + path.east + path.heading).all():
            return Forecast(
                start, arc, refused=f"{self.predictor.name}: its path is no numbers; the arc is shown alone"
            )
        strips = strips_of(path, self.outline)
        bound, since, fits, outside = None, math.nan, None, False
        if path.spread is not None:
            outside = bool(path.spread.outside)
            fits = bool(path.spread.fits) if math.isfinite(float(path.spread.misfit)) else None
            if has_region(path):
                if before is not None and before.region_swept is not None:
                    bound, since = before.region_swept, before.region_start
                else:
                    bound, since = region_bound(path, self.outline, LEVEL), start
        near, touches = self.clearance(strips), self.touches(strips)
        return Forecast(start, arc, path, strips.area(), bound, since, near, touches, fits, outside)

    def clearance(self, strips: Strips) -> Clearance | None:
        """The nearest of the chart to the hull along a path, of which the strips are; None without a chart."""
        near = None if self.chart is None else self.chart.nearest(strips.pieces)
        if near is None:
            return None
        return Clearance(near.distance, float(strips.time[near.piece]), near.kind, near.place)

    def touches(self, strips: Strips) -> tuple[Touching, ...]:
        """What of the chart the hull touches along a path: where she runs aground first, and what else first."""
        if self.chart is None:
            return ()
        found = self.chart.touched(strips.pieces, self.vessel.draught)
        return tuple(Touching(float(strips.time[touch.piece]), touch.what, touch.aground) for touch in found)

    def fan(self, states: States, orders: Sequence[Orderable]) -> Path:
        """Paths (len(orders), steps) under each of `orders`. Raises InputError, one line, as `prediction.predict` does."""
        if self.predictor is None:
            raise InputError("what if: no predictor is loaded; start aspnn serve with a checkpoint")
        many = getattr(self.predictor, "fan", None)
        paths = fan(self.predictor, states, orders) if many is None else many(states, orders)
        return paths.at(self.time)

    def keep(self, forecast: Forecast) -> None:
        """Keep a forecast under the orders in force, to be judged when it ends; at most one in EVERY seconds."""
        if self._pending and forecast.start - self._pending[-1].start < EVERY - 1e-6:
            if forecast.start >= self._pending[-1].start:
                return
            self._pending.clear()  # the clock has run back: nothing of before can be judged
        arc = forecast.arc.at(self.horizons)
        ours, inverse = np.full((len(self.horizons), 2), np.nan), None
        if forecast.path is not None:
            path = forecast.path.at(self.horizons)
            ours = np.column_stack([path.north, path.east])
            if has_region(path):
                region = path.region(LEVEL)
                along = np.stack([np.cos(region.azimuth), np.sin(region.azimuth)], axis=-1)
                across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
                inverse = sum(
                    d[:, :, None] * d[:, None] / axis[:, None, None] ** 2
                    for d, axis in ((along, region.major), (across, region.minor))
                )
        places = np.column_stack([arc.north, arc.east])
        self._pending.append(_Pending(forecast.start, ours, places, inverse, list(range(len(self.horizons)))))

    def verify(self, states: States) -> list[Ended]:
        """The predictions that have come to their end by the last of `states`, held against where the states say the ship was.

        The place is linear between the two states about the end. Where no state is within GAP, or the filter was coasting,
        the prediction is dropped: it has nothing to be judged by.
        """
        time = states["time_s"]
        if not len(time) or not self._pending:
            return []
        north, east, coasting, order = (states[name] for name in ("north_m", "east_m", "coasting", "rudder_order_rad"))
        found: list[Ended] = []
        for one in self._pending:
            while one.due and one.start + self.horizons[one.due[0]] <= time[-1] + 1e-6:
                k = one.due.pop(0)
                at = one.start + self.horizons[k]
                after = min(int(np.searchsorted(time, at - 1e-6)), len(time) - 1)
                before = max(after - 1, 0)
                gone = time[before] > at + 1e-6 or time[after] - time[before] > GAP
                if gone or coasting[before] or coasting[after]:
                    continue
                true = np.array([np.interp(at, time, north), np.interp(at, time, east)])
                orders = order[np.searchsorted(time, one.start - 1e-6) : after + 1]
                held = not (np.abs(orders - orders[0]) > HELD).any()
                off, inside = one.ours[k] - true, None
                if one.inverse is not None:
                    inside = bool(off @ one.inverse[k] @ off <= 1)
                error = float(np.hypot(*off)), float(np.hypot(*(one.arc[k] - true)))
                found.append(Ended(one.start, float(self.horizons[k]), *error, inside, held))
                if held:
                    self._errors[k].append(found[-1])
                    self._counts[k] += 1
                else:
                    self._apart[k] += 1
        while self._pending and not self._pending[0].due:
            self._pending.popleft()
        return found

    def scores(self) -> Scores:
        """Medians over the last KEPT ended predictions whose order was held, and the last errors of these."""
        last = [list(errors) for errors in self._errors]
        median = [[_median([getattr(e, name) for e in one]) for one in last] for name in ("ours", "arc")]
        final = [[getattr(one[-1], name) if one else math.nan for one in last] for name in ("ours", "arc")]
        return Scores(
            self.horizons,
            np.array(self._counts),
            np.array(self._apart),
            np.array(median[0]),
            np.array(final[0]),
            np.array(median[1]),
            np.array(final[1]),
        )


def has_region(path: Path) -> bool:
    """Whether a path has a 95 % region at each of its steps."""
    if path.spread is None:
        return False
    region = path.region(LEVEL)
    return bool(np.isfinite(region.major + region.heading).all() and (region.minor[-1] > 0))


def _median(values: list[float]) -> float:
    known = [v for v in values if math.isfinite(v)]
    return float(np.median(known)) if known else math.nan
