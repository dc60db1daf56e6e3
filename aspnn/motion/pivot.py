"""The pivot point: the place on the centreline whose sway is zero, x forward of midship.

With v(x) = v + r x, the pivot point lies at x_pp = -v / r (thesis 4.1, corrected: E39). It runs to infinity as the ship
stops turning; there it is reported as NaN, "undefined", never as a wild number.
"""

import numpy as np

REGION_EDGES = np.array([-10.5, -6.5, -4.5, -3.5, -2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 3.5, 4.5, 6.5, 10.5])
REGION_CENTRES = np.array([-20, -8.5, -5.5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5.5, 8.5, 20])


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
