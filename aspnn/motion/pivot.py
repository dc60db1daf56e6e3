"""The pivot point: the place on the centreline whose sway is zero, x forward of midship.

With v(x) = v + r x, the pivot point lies at x_pp = -v / r (thesis 4.1, corrected: E39). It runs to infinity as the ship
stops turning; there it is reported as NaN, "undefined", never as a wild number.

A way to the pivot point is a callable `Motion -> PivotPoint`: `exact` is one, `RegionMap(length)` and the Gaussian process of
`pivot_gpr` are others. `Motion.of_stations` makes a motion of two sways, whose `exact` is the two-station difference.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

REGION_EDGES = np.array([-10.5, -6.5, -4.5, -3.5, -2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 3.5, 4.5, 6.5, 10.5])
REGION_CENTRES = np.array([-20, -8.5, -5.5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5.5, 8.5, 20])
CERTAINTY = 3.0  # deviations of the yaw rate that it must differ from zero by
Z_95 = 1.959963984540054  # deviations of a normal distribution that hold 95 %


class Motion(NamedTuple):
    """How a hull turns: sway at midship [m/s] and yaw rate [rad/s], arrays of any one shape, and how sure they are.

    `sway_sd` and `yaw_rate_sd` are the standard deviations of their errors, `covariance` [m rad/s2] how these go together.
    """

    sway: np.ndarray
    yaw_rate: np.ndarray
    sway_sd: np.ndarray | float = 0.0
    yaw_rate_sd: np.ndarray | float = 0.0
    covariance: np.ndarray | float = 0.0

    @classmethod
    def of_stations(cls, sway_bow, sway_stern, bow_sd, stern_sd, x_bow: float, x_stern: float) -> "Motion":
        """From the sways at two stations of a rigid hull [m/s], whose errors are independent of each other (E39)."""
        sway, yaw_rate = two_station_motion(sway_bow, sway_stern, x_bow, x_stern)
        span, one, two = x_bow - x_stern, np.square(bow_sd), np.square(stern_sd)
        return cls(
            sway,
            yaw_rate,
            np.hypot(x_bow * np.asarray(stern_sd), x_stern * np.asarray(bow_sd)) / abs(span),
            np.hypot(bow_sd, stern_sd) / abs(span),
            -(x_bow * two + x_stern * one) / span**2,
        )

    def defined(self) -> np.ndarray:
        """Where the hull turns for certain: |r| > 3 sd_r."""
        return np.abs(self.yaw_rate) > CERTAINTY * np.asarray(self.yaw_rate_sd, float)


class PivotPoint(NamedTuple):
    """Pivot point [m] forward of midship with its standard deviation and 95 % interval; all NaN where it is undefined."""

    place: np.ndarray
    sd: np.ndarray
    low: np.ndarray
    high: np.ndarray


Way = Callable[[Motion], PivotPoint]


def exact(motion: Motion) -> PivotPoint:
    """The pivot point -v / r (E39), to first order sure to sd = sqrt(sd_v^2 + 2 x cov + x^2 sd_r^2) / |r|.

    Its interval is Fieller's, exact for normal errors: all x whose sway v + r x could be zero, |v + r x| <= 1.96 sd(v + r x).
    That is a quadratic in x; its solutions are bounded wherever the pivot point is defined.
    """
    v, r, sd_v, sd_r, c = (np.asarray(w, float) for w in np.broadcast_arrays(*motion))
    turning, z2 = motion.defined(), Z_95**2
    place = pivot_point(v, r, sd_r, CERTAINTY)
    lead = np.where(turning, r**2 - z2 * sd_r**2, np.nan)
    square = z2 * ((r * sd_v) ** 2 + (v * sd_r) ** 2 - 2 * v * r * c) - z2**2 * ((sd_v * sd_r) ** 2 - c**2)
    centre, reach = (z2 * c - v * r) / lead, np.sqrt(np.where(turning, square, np.nan)) / lead
    sd = np.sqrt(sd_v**2 + 2 * place * c + (place * sd_r) ** 2) / np.where(turning, np.abs(r), np.nan)
    return PivotPoint(place, sd, centre - reach, centre + reach)


@dataclass(frozen=True)
class RegionMap:
    """The pivot point as Paper V maps it: the fixed place of its region (table 4) on a ship of `length` [m].

    The interval reaches from the far edge of the region that holds the low end of the exact interval to that of the region
    of its high end, without end for the outermost ones. The deviation takes the place as evenly spread over its region.
    """

    length: float

    def __call__(self, motion: Motion) -> PivotPoint:
        found = exact(motion)
        edges = np.concatenate([[-np.inf], REGION_EDGES, [np.inf]]) * (self.length / 8)

        def of(values, x):
            region = region_of(x, self.length)
            return np.where(np.isnan(region), np.nan, values[np.nan_to_num(region + 7).astype(int)])

        low, high = of(edges[:-1], found.low), of(edges[1:], found.high)
        sd = np.hypot(of(np.diff(edges), found.place) / np.sqrt(12), found.sd)
        return PivotPoint(of(REGION_CENTRES * (self.length / 8), found.place), sd, low, high)


def pivot_point(sway, yaw_rate, yaw_rate_sd=0.0, certainty: float = 3.0):
    """Pivot point x_pp = -v / r [m] forward of where `sway` is taken (thesis 4.1, E39). Any shape.

    `sway` [m/s], `yaw_rate` and `yaw_rate_sd` [rad/s]. NaN ("undefined") where |r| <= certainty * sd, so also at r = 0.
    """
    sway, yaw_rate = np.broadcast_arrays(np.asarray(sway, float), np.asarray(yaw_rate, float))
    turning = np.abs(yaw_rate) > certainty * np.asarray(yaw_rate_sd, float)
    return np.where(turning, -sway / np.where(turning, yaw_rate, 1.0), np.nan)


def pivot_point_sd(sway, yaw_rate, sway_sd, yaw_rate_sd, certainty: float = 3.0):
    """Standard deviation of the pivot point [m]: sqrt(sd_v^2 + x_pp^2 sd_r^2) / |r| (E39), independent errors.

    NaN where the pivot point is undefined.
    """
    place = pivot_point(sway, yaw_rate, yaw_rate_sd, certainty)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.hypot(sway_sd, place * yaw_rate_sd) / np.abs(np.where(np.isnan(place), np.nan, yaw_rate))


def two_station_motion(sway_bow, sway_stern, x_bow: float, x_stern: float):
    """Sway at midship [m/s] and yaw rate [rad/s] from the sway at two stations of a rigid hull (E39).

    r = (v1 - v2) / (x1 - x2), v = (x1 v2 - x2 v1) / (x1 - x2). Arrays or tensors of any one shape.
    """
    span = x_bow - x_stern
    return (x_bow * sway_stern - x_stern * sway_bow) / span, (sway_bow - sway_stern) / span


def region_of(place, length: float):
    """Region -7 to 7 of Paper V (table 4) that holds a pivot point at `place` [m]; sections of length / 8.

    An undefined pivot point (NaN) has no region: the result is float, NaN there.
    """
    place = np.asarray(place, float)
    region = np.searchsorted(REGION_EDGES * (length / 8), place, side="right") - 7.0
    return np.where(np.isnan(place), np.nan, region)


def region_pivot(sway_bow, sway_stern, x_bow: float, x_stern: float, length: float):
    """Pivot point [m] as Paper V maps it: the fixed place of the region (table 4) that the two sways point to.

    Equal sways (no turning) put the pivot point at infinity on the side of the ship that Paper V's outermost region
    stands for: 20 sections ahead when the common sway is to port or zero, 20 abaft when it is to starboard.
    """
    sway_bow, sway_stern = np.asarray(sway_bow, float), np.asarray(sway_stern, float)
    sway, yaw_rate = two_station_motion(sway_bow, sway_stern, x_bow, x_stern)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.where(yaw_rate != 0, -sway / yaw_rate, np.where(sway > 0, -np.inf, np.inf))
    region = region_of(exact, length)
    place = REGION_CENTRES[np.nan_to_num(region + 7).astype(int)] * (length / 8)
    return np.where(np.isnan(region), np.nan, place)
