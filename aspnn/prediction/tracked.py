"""A learned predictor that follows its ship: predictions with the correction that `tracking` finds in the voyage so far."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from aspnn.motion import Path, Spread
from aspnn.orders import Plan
from aspnn.prediction import carried
from aspnn.prediction.choice import HybridChoice
from aspnn.prediction.learned import Material, check_vessel, draw, material, through_water
from aspnn.prediction.monitor import MARKS, widening
from aspnn.prediction.plan import Orderable, make_plan
from aspnn.prediction.similarity import check_similar, similar
from aspnn.prediction.tracking import SHIP, Ship, Tracks, follow
from aspnn.prediction.uncertainty import Calibration
from aspnn.records import States
from aspnn.schema import InputError

NEVER = np.full((len(MARKS), 2), np.inf)  # a misfit that nothing is beyond


class Estimate(NamedTuple):
    """The correction of one instant: `parameters` (9,) and their `covariance` (9, 9), the `current` (2,) [m/s], how sure it is.

    `left` (MARKS, 2) is how much larger than told squared errors were: see Tracks.left.
    """

    parameters: np.ndarray
    covariance: np.ndarray
    current: np.ndarray
    gain: float
    sure: bool
    left: np.ndarray


class Trained(Protocol):
    """What tracking asks of a learned predictor: GruPredictor or OnnxPredictor."""

    @property
    def contract(self) -> Ship: ...

    @property
    def calibration(self) -> Calibration | None: ...

    @property
    def choice(self) -> HybridChoice | None: ...

    @property
    def region_map(self) -> bool: ...

    def velocities(self, history: np.ndarray, forcing: np.ndarray, wind: np.ndarray) -> np.ndarray: ...


class Tracked:
    """A learned predictor that follows its ship. It must be given the states from the begin of the voyage on, not only their end.

    What it has found of the voyage so far it remembers, so that each call goes through new states alone; other states than
    those remembered are gone through from their begin. Regions have the uncertainty of the correction in them, and are judged
    (`fits`, `misfit`) as the corrected network's.
    """

    def __init__(self, predictor: Trained):
        self.predictor = predictor
        self.contract, self.spec = predictor.contract, predictor.contract.spec
        check_similar(self.spec, self.contract.name)
        if predictor.calibration is None:
            raise InputError(
                f"{self.contract.name}: is not calibrated, so how much its errors tell is not known; run `aspnn calibrate` first"
            )
        self.calibration: Calibration = predictor.calibration
        self._known: Tracks | None = None

    @property
    def name(self) -> str:
        """That of the checkpoint, and that it is tracked."""
        return f"{self.contract.name}-tracked"

    @property
    def horizon(self) -> float:
        """How far it predicts [s]."""
        return self.spec.horizon

    def tracks(self, states: States) -> Tracks:
        """The corrections of the voyage so far."""
        check_vessel(states, self.contract)
        self._known = follow(
            self.contract, self.predictor.velocities, self.calibration, states, self._remembered(states)
        )
        return self._known

    def _remembered(self, states: States) -> Tracks | None:
        """What is known already, where it is of these states; of longer ones only the part that they have too."""
        known, time = self._known, states["time_s"]
        if known is None or known.time[0] != time[0]:
            return None
        known = Tracks(*(values[known.time <= time[-1] + 1e-6] for values in known))
        at = (
            np.interp(known.time[[0, -1]], time, states["north_m"]),
            np.interp(known.time[[0, -1]], time, states["east_m"]),
        )
        return known if np.array_equal(np.hypot(*at), known.place[[0, -1]]) else None

    def estimate(self, states: States) -> Estimate:
        """The correction at the end of the states."""
        return self._at(self.tracks(states), -1)

    @staticmethod
    def _at(found: Tracks, k: int) -> Estimate:
        mean, spread = found.mean[k], found.covariance[k]
        left = found.left(k % len(found.time))
        return Estimate(mean[:SHIP], spread[:SHIP, :SHIP], mean[SHIP:], float(found.gain[k]), bool(found.sure[k]), left)

    def predict(self, states: States, rudder_plan: Orderable = None, shaft_plan: Orderable = None) -> Path:
        """Path from the last of `states`, if the plan is followed; see GruPredictor.predict."""
        return self._one(states, [rudder_plan], shaft_plan)[0]

    def fan(self, states: States, orders: Sequence[Orderable], shaft_plan: Orderable = None) -> Path:
        """Paths (len(orders), steps) from the last of `states` under each of `orders`, as `prediction.fan.fan`."""
        if not len(orders):
            raise InputError("fan: no order was given; give at least one rudder order")
        return self._one(states, orders, shaft_plan)

    def _one(self, states: States, orders: Sequence[Orderable], shaft: Orderable) -> Path:
        now = self.estimate(states)
        end = carried.recent(self.contract, self.calibration, states, self.predictor.choice)
        plans = [make_plan(end, order, shaft, self.horizon) for order in orders]
        return self._drawn(now, end, np.full(len(plans), len(end) - 1), plans)

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """Paths (n, steps) from each of `rows` under each of `plans`, each with what was known of the ship at its start."""
        rows, time = np.asarray(rows, int), states["time_s"]
        known = self.tracks(replace(states, table=states.table.iloc[: rows.max() + 1]))
        place = np.searchsorted(known.time, time[rows] + 1e-6, side="right") - 1
        place = np.where(known.sure[place], place, -1)  # all that is not sure is untracked
        parts, of = [], []
        for k in np.unique(place):
            some = np.flatnonzero(place == k)
            parts.append(self._drawn(self._at(known, max(k, 0)), states, rows[some], [plans[int(i)] for i in some]))
            of.append(some)
        return joined(parts)[np.argsort(np.concatenate(of))]

    def _drawn(self, now: Estimate, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        trained = self.predictor
        how = (states, rows, plans, trained.region_map, trained.choice)
        if not now.sure:
            return carried.predict_rows(self.contract, trained.velocities, self.calibration, *how)
        network = similar(trained.velocities, self.spec, self.contract.vessel, now.parameters)
        # Many ended predictions widen these regions, in place of the two that `monitor` goes by.
        path = carried.predict_rows(self.contract, network, replace(self.calibration, usual=NEVER), *how)
        assert path.spread is not None
        more = self._unsure(now, states, rows, plans)
        wider = widening(now.left[None], np.ones((len(MARKS), 2)), path.time)[0]
        whole = path.spread.covariance * wider[:, :, None] * wider[:, None, :] + more
        return replace(path, spread=replace(path.spread, covariance=whole))

    def _unsure(self, now: Estimate, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> np.ndarray:
        """Covariance (n, steps, 3, 3) of paths by that of the parameters: J P J^T, differences of one deviation along each axis of P."""
        given, n = material(self.contract, states, rows, plans), len(rows)
        given = through_water(given, self.spec, np.tile(now.current, (n, 1)))
        values, axes = np.linalg.eigh(now.covariance)
        x = now.parameters + np.concatenate([np.zeros((1, SHIP)), (axes * np.sqrt(np.maximum(values, 0.0))).T])
        many = Material(*(np.concatenate([array] * len(x)) for array in given))
        network = similar(self.predictor.velocities, self.spec, self.contract.vessel, np.repeat(x, n, axis=0))
        path = draw(self.contract, many.pose, network(many.history, many.forcing, many.wind), self.predictor.region_map)
        ends = np.stack([path.north, path.east, path.heading], axis=-1).reshape(len(x), n, -1, 3)
        moves = ends[1:] - ends[0]
        return np.einsum("pnta,pntb->ntab", moves, moves)


def joined(paths: Sequence[Path]) -> Path:
    """Paths (n, steps) of several calls of one predictor, one after the other."""
    names = ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot", "convergence")
    values = {name: np.concatenate([getattr(path, name) for path in paths]) for name in names}
    spreads = [path.spread for path in paths if path.spread is not None]
    return replace(paths[0], **values, spread=_together(spreads) if len(spreads) == len(paths) else None)


def _together(spreads: Sequence[Spread]) -> Spread:
    names = ("covariance", "outside", "position", "heading", "misfit")
    values: dict[str, Any] = {name: np.concatenate([getattr(s, name) for s in spreads]) for name in names}
    return replace(spreads[0], **values)
