"""Do the regions hold what they promise? Coverage and area by group and horizon, with what chance leaves open."""

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from aspnn.angles import difference
from aspnn.motion import Path, Spread
from aspnn.motion.spread import region

if TYPE_CHECKING:
    from aspnn.evaluation.evaluate import Evaluation

LEVELS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)  # of the reliability diagram
DRAWS = 1000


@dataclass(frozen=True)
class Share:
    """A share of windows with two standard errors, from drawing whole voyages anew; and how many windows there were."""

    value: float
    two_errors: float
    windows: int

    def __str__(self) -> str:
        return f"{self.value:.3f} ± {self.two_errors:.3f}"


@dataclass(frozen=True)
class Coverage:
    """Regions of one predictor, group and horizon at one level: shares held, median area [m2] and heading half-width [rad]."""

    position: Share
    heading: Share
    area: float
    width: float
    outside: float  # share of predictions beyond the predictor's domain
    unfit: float  # share of predictions whose predictor did not fit the ship of the last minutes


def share(inside: np.ndarray, voyage: np.ndarray, seed: int) -> Share:
    """Share of `inside` (windows,), with two standard errors by a bootstrap over voyages (windows,).

    Windows of one voyage resemble each other; with each voyage drawn as often as it comes up, the share of a draw is the
    sum of its windows inside over the sum of its windows.
    """
    names, number = np.unique(voyage, return_inverse=True)
    held = np.bincount(number, weights=inside, minlength=len(names))
    count = np.bincount(number, minlength=len(names))
    times = _draws(len(names), seed)
    return Share(float(np.mean(inside)), 2 * float(np.std((times @ held) / (times @ count))), len(inside))


@cache
def _draws(count: int, seed: int) -> np.ndarray:
    """How often each of `count` voyages comes up in each draw with replacement: (draws, count)."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(count, np.full(count, 1 / count), size=DRAWS).astype(float)


def calibrated(evaluation: "Evaluation") -> list[str]:
    """The predictors that have regions."""
    return [name for name, path in evaluation.paths.items() if path.spread is not None]


def coverage(evaluation: "Evaluation", name: str, group: str, horizon: float, level: float = 0.95) -> Coverage | None:
    """Coverage of a predictor's regions in a group at `horizon` [s]; None where none of its windows has a region."""
    column, rows = evaluation.column(horizon), evaluation.rows(group)
    path, reference, spread = evaluation.paths[name], evaluation.reference, evaluation.paths[name].spread
    if spread is None:
        return None
    # Regions of one instant of these windows alone: pages ask for hundreds of coverages.
    rows = rows[np.isfinite(spread.covariance[rows, column, 0, 0])]
    if not len(rows):
        return None
    here = rows, np.full(len(rows), column)
    at = {name: getattr(spread, name)[here] for name in ("covariance", "position", "heading")}
    whole = {name: getattr(spread, name)[rows] for name in ("outside", "misfit")}
    found = region(path.north[here], path.east[here], replace(spread, **whole, **at), level)
    voyage = evaluation.voyages(rows)
    place = found.contains(reference.north[here], reference.east[here])
    turn = np.abs(difference(path.heading[here], reference.heading[here])) <= found.heading
    return Coverage(
        position=share(place, voyage, evaluation.seed),
        heading=share(turn, voyage, evaluation.seed),
        area=float(np.median(found.area)),
        width=float(np.median(found.heading)),
        outside=float(np.mean(spread.outside[rows])),
        unfit=float(np.mean(~spread.fits[rows])),
    )


def coverage_metrics(evaluation: "Evaluation", groups: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    """`coverage_95` and `regions` of metrics.json: coverage by predictor, group and horizon, and all that goes with it."""
    shares: dict[str, Any] = {}
    details: dict[str, Any] = {}
    for name in calibrated(evaluation):
        shares[name], details[name] = {}, {}
        for group in groups:
            found = {f"{h:g}": coverage(evaluation, name, group, h) for h in evaluation.rule.horizons}
            known = {horizon: c for horizon, c in found.items() if c is not None}
            if known:
                shares[name][group] = {horizon: c.position.value for horizon, c in known.items()}
                details[name][group] = {
                    horizon: {
                        "windows": c.position.windows,
                        "position": {"coverage": c.position.value, "two_standard_errors": c.position.two_errors},
                        "heading": {"coverage": c.heading.value, "two_standard_errors": c.heading.two_errors},
                        "area_median_m2": c.area,
                        "heading_half_width_median_deg": float(np.degrees(c.width)),
                        "outside": c.outside,
                        "unfit": c.unfit,
                    }
                    for horizon, c in known.items()
                }
    return shares, details


def stacked(paths: list[Path]) -> Spread | None:
    """The spread of several batches of paths as one; None where any has none."""
    spreads = [path.spread for path in paths if path.spread is not None]
    if len(spreads) < len(paths):
        return None
    names = ("covariance", "outside", "position", "heading", "misfit")
    values: dict[str, Any] = {name: np.concatenate([getattr(s, name) for s in spreads]) for name in names}
    return replace(spreads[0], **values)
