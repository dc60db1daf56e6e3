"""Errors of predicted paths, their summaries, and paired comparisons that respect the voyages they come from."""

from dataclasses import dataclass

import numpy as np

from aspnn.angles import difference
from aspnn.motion import Path


@dataclass(frozen=True)
class Errors:
    """Errors, predicted minus reference, arrays (windows, times).

    `position` [m] is the Euclidean distance; `along` [m] lies in the direction of the reference course, `cross` [m] to
    starboard of it; `heading` [rad] is the smallest signed angle.
    """

    position: np.ndarray
    along: np.ndarray
    cross: np.ndarray
    heading: np.ndarray


def path_errors(predicted: Path, reference: Path) -> Errors:
    """Errors of `predicted` against `reference`, two paths (windows, times) at the same times.

    The reference course is chi = psi + atan2(v, u); along + i cross = (dN + i dE) exp(-i chi).
    """
    offset = (predicted.north - reference.north) + 1j * (predicted.east - reference.east)
    course = reference.heading + np.arctan2(reference.sway, reference.surge)
    body = offset * np.exp(-1j * course)
    return Errors(np.abs(offset), body.real, body.imag, difference(predicted.heading, reference.heading))


def concatenate(parts: list[Errors]) -> Errors:
    """The errors of several voyages, one after the other."""
    return Errors(*(np.concatenate([getattr(part, name) for part in parts]) for name in Errors.__dataclass_fields__))


def summary(position: np.ndarray, heading: np.ndarray) -> dict[str, dict[str, float]]:
    """One horizon of one group as metrics.json has it, from position [m] and signed heading errors [rad], (windows,)."""
    degrees = np.degrees(heading)
    return {
        "position_m": {
            "median": float(np.median(position)),
            "p95": float(np.percentile(position, 95)),
            "mean": float(np.mean(position)),
        },
        "heading_deg": {
            "median_abs": float(np.median(np.abs(degrees))),
            "p95_abs": float(np.percentile(np.abs(degrees), 95)),
            "median_signed": float(np.median(degrees)),
        },
    }


def bootstrap_medians(values: np.ndarray, voyage: np.ndarray, seed: int, draws: int = 1000) -> np.ndarray:
    """Medians (draws, columns) of `values` (windows, columns) when whole voyages are drawn anew with replacement.

    Windows of one voyage resemble each other (one current, one set of orders), so single windows must not be drawn. All
    columns share the draws: comparisons between columns stay paired.
    """
    rng = np.random.default_rng(seed)
    names = np.unique(voyage)
    rows = [np.flatnonzero(voyage == name) for name in names]
    picks = rng.integers(len(names), size=(draws, len(names)))
    return np.stack([np.median(values[np.concatenate([rows[k] for k in pick])], axis=0) for pick in picks])


@dataclass(frozen=True)
class Ratio:
    """A ratio of medians on the same windows, with its 95 % interval by a bootstrap over voyages."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        value, low, high = (f"{x:.0f}" if x >= 99.5 else f"{x:.2g}" for x in (self.value, self.low, self.high))
        return f"{value} ({low} to {high})"


def paired_ratios(values: np.ndarray, against: int, voyage: np.ndarray, seed: int, draws: int = 1000) -> list[Ratio]:
    """Ratio of every column's median to that of column `against`; `values` (windows, columns), `voyage` (windows,)."""
    medians = np.median(values, axis=0)
    drawn = bootstrap_medians(values, voyage, seed, draws)
    low, high = np.percentile(drawn / drawn[:, against : against + 1], [2.5, 97.5], axis=0)
    return [Ratio(float(m / medians[against]), float(a), float(b)) for m, a, b in zip(medians, low, high, strict=True)]
