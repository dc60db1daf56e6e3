"""Calibration of a checkpoint's regions: errors on voyages that taught it nothing, by population and time from the start."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from aspnn import __version__
from aspnn.angles import difference
from aspnn.evaluation.reference import Voyage
from aspnn.evaluation.windows import Rule, Starts, find_starts
from aspnn.learning.windows import WindowSpec
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.prediction.calibration import VOYAGES, fit_correlation, fit_variance, scores, with_factors
from aspnn.prediction.monitor import MARKS, Ended, ended, marks, misfit, usual_fit, widening
from aspnn.prediction.monitor import errors as monitor_errors
from aspnn.prediction.uncertainty import (
    FULL,
    LEVELS,
    MEASURED,
    POPULATIONS,
    STEERED,
    Calibration,
    axes,
    drivers,
    population,
    shape,
)
from aspnn.records import States
from aspnn.schema import InputError

if TYPE_CHECKING:
    from rich.table import Table

KNOTS = 12  # of the calibration between start and horizon: every 7.5 s of 90
SHAPING = 3  # every third voyage shapes the regions, the others scale them


class Carries(Protocol):
    """What calibration asks of a predictor."""

    @property
    def name(self) -> str: ...

    @property
    def horizon(self) -> float: ...

    @property
    def spec(self) -> WindowSpec: ...

    def predict_carried(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> tuple[Path, np.ndarray]: ...


@dataclass(frozen=True)
class _Part:
    """The windows of one voyage at the knots: path, covariance by the filter's errors, errors (n, knots, 3) in grid axes.

    `past` are the predictions that had ended by the start of each, with path and covariance at the knots, and their errors and
    the variances of these as `monitor.errors` gives them.
    """

    path: Path
    carried: np.ndarray
    errors: np.ndarray
    plans: tuple[Plan, ...]
    angle: np.ndarray
    populations: np.ndarray
    voyage: int
    measured: np.ndarray
    past: Ended
    past_path: Path
    past_carried: np.ndarray
    past_angle: np.ndarray
    past_errors: tuple[np.ndarray, np.ndarray]

    def misfit(self, calibration: Calibration) -> np.ndarray:
        """How far off (n, MARKS, 2) the past predictions of each window were, as `monitor.misfit`."""
        usual = shape(calibration, self.past_path, self.past_carried, self.past.plans, self.past_angle)
        return misfit(self.past.start, *self.past_errors, usual[:, marks(self.past_path.time)], len(self.angle))


def calibrate(predictor: Carries, voyages: Iterable[Voyage], rule: Rule, taught: Iterable[str]) -> Calibration:
    """Calibrate the regions of a predictor on the windows of `voyages` by `rule`, which taught it nothing.

    Every third voyage shapes the covariance, the others scale it (split conformal). With `rule.steered_every` windows whose plan moves
    the rudder all the time are a population of their own, which is scaled and shapes nothing: all others are as without them. Raises
    InputError for a voyage among `taught`, for fewer than six voyages with windows, and when no population has enough windows.
    """
    horizon, taught = predictor.horizon, set(taught)
    knots = np.linspace(0.0, horizon, KNOTS + 1)
    parts: list[_Part] = []
    steered: list[_Part] = []
    digest, kinds = hashlib.sha256(), set()
    seen: dict[str, int] = {}
    for voyage in voyages:
        name = voyage.states.voyage
        if name in taught:
            raise InputError(
                f"{voyage.name or name}: voyage {name} trained checkpoint {predictor.name}; calibrate it on voyages it has not seen"
            )
        number = seen.setdefault(name, len(seen))
        measured = _measure(predictor, voyage, replace(rule, horizons=(horizon,)), knots, number)
        digest.update(voyage.sha256.encode())
        kinds.add(voyage.reference.kind)
        for part, kept in zip(measured, (parts, steered), strict=True):
            if part is not None:
                kept.append(part)
    count = len({part.voyage for part in parts})
    if count < VOYAGES:
        raise InputError(
            f"calibrating {predictor.name}: {count} voyages have windows, {VOYAGES} are needed; "
            f"a window needs {rule.history:g} s before its start and {horizon:g} s after it"
        )
    ranks = {voyage: k for k, voyage in enumerate(sorted({part.voyage for part in parts}))}
    shaping = [part for part in parts if ranks[part.voyage] % SHAPING == 0]
    scaling = [part for part in parts if ranks[part.voyage] % SHAPING != 0]
    variance, correlation = _shaped(shaping)
    begun = np.concatenate([part.measured for part in parts])
    domain = {
        column: (float(values.min()), float(values.max()))
        for column, values in zip(MEASURED, begun.T, strict=True)
        if np.isfinite(values).all()
    }
    found = Calibration(
        time=knots,
        variance=variance,
        correlation=correlation,
        levels=np.array(LEVELS),
        position={},
        heading={},
        domain=domain,
        settled=rule.steady_before,
        drift=float(np.sqrt(np.mean([np.mean(part.errors[:, KNOTS // 3, :2] ** 2) for part in parts]))),
        usual=np.ones((len(MARKS), 2)),
        limit=float("nan"),
        facts={},
    )
    usual, limit = usual_fit(np.concatenate([part.misfit(found) for part in shaping]))
    found = replace(found, usual=usual, limit=limit)
    scaling += steered
    found_scores = [scores(part.errors, _covariance(found, part)) for part in scaling]
    position, heading = (np.concatenate(values) for values in zip(*found_scores, strict=True))
    populations = np.concatenate([part.populations for part in scaling])
    of = np.repeat([part.voyage for part in scaling], [len(part.angle) for part in scaling])
    facts: dict[str, Any] = {
        "aspnn": __version__,
        "voyages": list(seen),
        "data_sha256": digest.hexdigest(),
        "reference": " and ".join(sorted(kinds)),
        "shaped_by": {"windows": sum(len(part.angle) for part in shaping), "voyages": len({p.voyage for p in shaping})},
    }
    return with_factors(found, position, heading, populations, of, facts)


def _measure(
    predictor: Carries, voyage: Voyage, rule: Rule, knots: np.ndarray, number: int
) -> tuple[_Part | None, _Part | None]:
    """The windows of a voyage, and those in a closed loop apart."""
    states = voyage.states
    starts = find_starts(states, rule, voyage.shaft)
    starts = starts.keep(voyage.reference.known(states["time_s"][starts.rows], rule.horizon), "no reference")
    known = (*POPULATIONS, STEERED) if rule.steered_every is not None else POPULATIONS
    kinds = np.array(
        [
            population(states, int(row), plan, rule.horizon, rule.steady_before, known)
            for row, plan in zip(starts.rows, starts.plans, strict=True)
        ]
    )
    usual = (kinds != STEERED) & (
        starts.groups != STEERED
    )  # the group has starts at any time, the population none but its own
    usual_starts, steered = (starts.keep(mask, "another population") for mask in (usual, kinds == STEERED))
    given = predictor, voyage, rule, knots, number
    return _part(*given, usual_starts, kinds[usual]), _part(*given, steered, kinds[kinds == STEERED])


def _part(
    predictor: Carries, voyage: Voyage, rule: Rule, knots: np.ndarray, number: int, starts: Starts, kinds: np.ndarray
) -> _Part | None:
    states, rows, plans = voyage.states, starts.rows, starts.plans
    if not len(rows):
        return None
    past, n = ended(states, rows, predictor.spec), len(rows)
    path, carried = predictor.predict_carried(states, np.concatenate([rows, past.rows]), [*plans, *past.plans])
    columns = np.array([np.argmin(np.abs(path.time - knot)) for knot in knots])
    truth = voyage.reference.path(states["time_s"][rows], path.time[columns])
    both, carried = path.at(path.time[columns]), carried[:, columns]
    path, gone = both[:n], both[n:]
    errors = [path.north - truth.north, path.east - truth.east, difference(path.heading, truth.heading)]
    return _Part(
        path=path,
        carried=carried[:n],
        errors=np.stack(errors, axis=-1),
        plans=plans,
        angle=states["rudder_angle_rad"][rows],
        populations=kinds,
        voyage=number,
        measured=np.stack([states[column][rows] for column in MEASURED], axis=-1),
        past=past,
        past_path=gone,
        past_carried=carried[n:],
        past_angle=states["rudder_angle_rad"][past.rows],
        past_errors=monitor_errors(past, gone, states),
    )


def _covariance(calibration: Calibration, part: _Part) -> np.ndarray:
    """Covariance (n, knots, 3, 3) of the windows of a part before it is scaled."""
    wider = widening(part.misfit(calibration), calibration.usual, calibration.time)
    usual = shape(calibration, part.path, part.carried, part.plans, part.angle)
    return usual * wider[..., :, None] * wider[..., None, :]


def _shaped(parts: Sequence[_Part]) -> tuple[np.ndarray, np.ndarray]:
    """Variance and correlation of the model's error by knot."""
    turned, known, grows = [], [], []
    for part in parts:
        back = np.swapaxes(axes(part.path), -1, -2)  # a rotation and a sign: its transpose undoes it
        turned.append(np.einsum("...ab,...b->...a", back, part.errors))
        known.append(np.einsum("...ab,...bc,...ac->...a", back, part.carried, back))
        grows.append(drivers(part.path, part.plans, part.angle))
    errors, carried, driving = (np.concatenate(values) for values in (turned, known, grows))
    variance = fit_variance(errors, carried, driving)
    return variance, fit_correlation(errors, carried, driving, variance)


def table(calibration: Calibration) -> "Table":
    """Windows and voyages by population, and the factors on the standard deviations at 95 % and the last knot."""
    from rich.table import Table

    facts = calibration.facts
    caption = [
        f"Shaped by {facts['shaped_by']['windows']} windows of {facts['shaped_by']['voyages']} other voyages; errors against "
        f"the {facts['reference']}.",
        "Factors on the standard deviations that hold 95 % at the horizon; Gaussian errors would need 2.45 and 1.96.",
    ]
    shown = Table(title="Regions calibrated", caption="\n".join(caption), caption_justify="left")
    shown.add_column("population", no_wrap=True)
    for name in ("windows", "voyages", "position", "heading"):
        shown.add_column(name, justify="right", no_wrap=True)
    for name, count in facts["populations"].items():
        cells = [f"{factors[name][-1, FULL]:.2f}" if name in factors else "too few" for factors in
                 (calibration.position, calibration.heading)]  # fmt: skip
        shown.add_row(name, str(count["windows"]), str(count["voyages"]), *cells)
    return shown
