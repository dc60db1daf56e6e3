"""How sure a predicted path is: its covariance, and the regions that hold the ship with a stated share. No learning here."""

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from aspnn.frames import to_north_east
from aspnn.schema import InputError


@dataclass(frozen=True)
class Spread:
    """How far off a path may be: `covariance` (..., steps, 3, 3) of north, east [m] and heading [rad], and regions.

    The covariance is scaled so that the 95 % regions are those of a Gaussian with it: d^2 = 5.99 for the position, 1.96
    standard deviations for the heading. Real errors have other tails: `position` and `heading` (..., steps, levels) are
    the factors on the standard deviations at `levels`, as measured. NaN where nothing was measured. `outside` (...) tells
    whether the prediction is beyond the domain of its predictor, so that the shares are not known to hold. `misfit` (...)
    tells how many standard deviations predictions of the last minutes were off: about 1 where the predictor fits the ship,
    NaN where that is not known. Regions are widened by it. One in a hundred is beyond `limit` where all is as in calibration.
    """

    covariance: np.ndarray
    outside: np.ndarray
    levels: np.ndarray
    position: np.ndarray
    heading: np.ndarray
    misfit: np.ndarray
    limit: float

    @property
    def fits(self) -> np.ndarray:
        """Whether the predictor fits the ship of today (...), as far as is known."""
        return ~(np.asarray(self.misfit) > self.limit)

    def __getitem__(self, index) -> "Spread":
        """The spread of one path (or some) of a batch."""
        names = ("covariance", "outside", "position", "heading", "misfit")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def between(self, lower: np.ndarray, part: np.ndarray) -> "Spread":
        """The spread a `part` (0 to 1) of the way from each of the steps `lower` to the next, linear."""

        def mixed(values, weight):
            axis = values.ndim - weight.ndim
            return np.take(values, lower, axis) * (1 - weight) + np.take(values, lower + 1, axis) * weight

        covariance = mixed(self.covariance, part[:, None, None])
        position, heading = (mixed(values, part[:, None]) for values in (self.position, self.heading))
        return replace(self, covariance=covariance, position=position, heading=heading)

    def factors(self, level: float) -> tuple[np.ndarray, np.ndarray]:
        """Factors (..., steps) on the standard deviations of position and heading at `level`, a share between 0 and 1.

        Between the measured levels they are linear in the factor of a Gaussian: sqrt(-2 ln(1 - p)) in two dimensions,
        the normal quantile of (1 + p) / 2 in one. Raises InputError for a level that was not measured.
        """
        low, high = float(self.levels[0]), float(self.levels[-1])
        if not low - 1e-9 <= level <= high + 1e-9:
            raise InputError(f"region at level {level:g}: it was calibrated for levels from {low:g} to {high:g}")
        return (
            _interpolate(self.position, [disc(p) for p in self.levels], disc(level)),
            _interpolate(self.heading, [strip(p) for p in self.levels], strip(level)),
        )


def disc(level: float) -> float:
    """Radius, in standard deviations, of the disc that holds a share `level` of a plane Gaussian."""
    return math.sqrt(-2 * math.log1p(-level))


def strip(level: float) -> float:
    """Half-width, in standard deviations, of the interval that holds a share `level` of a Gaussian."""
    return NormalDist().inv_cdf((1 + level) / 2)


def _interpolate(values: np.ndarray, knots: list[float], at: float) -> np.ndarray:
    upper = int(np.clip(np.searchsorted(knots, at), 1, len(knots) - 1))
    part = (at - knots[upper - 1]) / (knots[upper] - knots[upper - 1])
    return values[..., upper - 1] * (1 - part) + values[..., upper] * part


@dataclass(frozen=True)
class Region:
    """Where midship and heading are with a share `level` each: arrays (..., steps).

    An ellipse about `north`, `east` [m] with half axes `major`, `minor` [m], the major one at `azimuth` [rad] from grid
    north; and `heading` [rad], the half-width of an interval about the predicted heading. Each holds its share by itself.
    """

    level: float
    north: np.ndarray
    east: np.ndarray
    major: np.ndarray
    minor: np.ndarray
    azimuth: np.ndarray
    heading: np.ndarray

    @property
    def area(self) -> np.ndarray:
        """Area of the ellipse [m2]."""
        return math.pi * self.major * self.minor

    def contains(self, north, east) -> np.ndarray:
        """Whether places (..., steps) [m] lie in the ellipse; never where there is none (NaN)."""
        body = (np.asarray(north) - self.north + 1j * (np.asarray(east) - self.east)) * np.exp(-1j * self.azimuth)
        with np.errstate(divide="ignore", invalid="ignore"):  # an ellipse without extent holds nothing
            return (body.real / self.major) ** 2 + (body.imag / self.minor) ** 2 <= 1

    def outline(self, points: int = 48) -> np.ndarray:
        """The ellipse as a ring (..., steps, points, 2) of north, east [m]."""
        angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
        along, across = self.major[..., None] * np.cos(angle), self.minor[..., None] * np.sin(angle)
        north, east = to_north_east(along, across, self.azimuth[..., None])
        return np.stack([self.north[..., None] + north, self.east[..., None] + east], axis=-1)


def region(north: np.ndarray, east: np.ndarray, spread: Spread, level: float) -> Region:
    """The region at `level` about a path (..., steps).

    The half axes are the square roots of the eigenvalues of the covariance, m +- d with m = (a + c) / 2 and
    d = hypot((a - c) / 2, b), at the azimuth atan2(2 b, a - c) / 2.
    """
    position, heading = spread.factors(level)
    a, b, c = spread.covariance[..., 0, 0], spread.covariance[..., 0, 1], spread.covariance[..., 1, 1]
    mean, half = (a + c) / 2, np.hypot((a - c) / 2, b)
    return Region(
        level=level,
        north=north,
        east=east,
        major=position * np.sqrt(mean + half),
        minor=position * np.sqrt(np.maximum(mean - half, 0.0)),  # rounding may leave less than nothing
        azimuth=np.arctan2(2 * b, a - c) / 2,
        heading=heading * np.sqrt(spread.covariance[..., 2, 2]),
    )
