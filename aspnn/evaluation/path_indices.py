"""How well a craft came to a straight line and kept it: the indices that paper 002 tells of (its reference 16), by phase.

Reference 16 (Saggini et al., IFAC Proceedings 47(3), 2014) could not be opened. Paper 002 only names its indices: the area in the turning,
the approach and the steady phase, the last also normalised, and the vertical and horizontal Hausdorff distance, with the line as
abscissa. What bounds the phases, what an area is integrated over and which distance is meant is therefore assumed here:

- turning: until the craft is farthest from the line, which is where it begins to come nearer;
- approach: from there until the cross-track error stays within a band about its steady value, the median of the last third of the way;
- steady: what is left. A steady value that is not 0 is an offset, and counts as area;
- area: between track and line, the integral of |y_e| over |d x|, x along the line [m2]; normalised: over the length of the phase [m];
- Hausdorff distance of the track from the line's segment, taken apart: across it (vertical), how far the track gets from the line at most,
  in the steady phase and on the whole; along it (horizontal), how far the track lies outside the ends of the segment.
"""

from dataclasses import dataclass

import numpy as np

from aspnn.schema import InputError

BAND = 0.5  # m, about the steady value
TAIL = 1 / 3  # of the way, whose median is the steady value


@dataclass(frozen=True)
class PathIndices:
    """Areas [m2], normalised area [m], Hausdorff distances [m], the steady value [m] of y_e, its rms, and where [m] it begins."""

    turning_area: float
    approach_area: float
    steady_area: float
    steady_area_per_m: float
    vertical: float
    steady_vertical: float
    horizontal: float
    offset: float
    steady_rms: float
    steady_from: float


def area(along, cross) -> float:
    """Integral of |cross| over |d along| [m2] of a track of straight pieces, exact also where it crosses the line."""
    y, width = np.abs(cross), np.abs(np.diff(along))
    mean = 0.5 * (y[1:] + y[:-1])
    both = y[1:] + y[:-1]
    across = (np.sign(cross[1:]) * np.sign(cross[:-1]) < 0) & (both > 0)
    mean = np.where(across, 0.5 * (y[1:] ** 2 + y[:-1] ** 2) / np.where(across, both, 1.0), mean)
    return float(mean @ width)


def path_indices(along, cross, length: float, band: float = BAND) -> PathIndices:
    """Indices of a track given by x `along` the line from its start and `cross` to starboard of it, both (n,) [m].

    The reference is the segment from 0 to `length` [m]. Raises InputError where the track never becomes steady within `band` [m], or has
    no way to judge it by.
    """
    along, cross = np.asarray(along, float), np.asarray(cross, float)
    if len(along) < 3 or len(along) != len(cross) or not (np.isfinite(along).all() and np.isfinite(cross).all()):
        raise InputError("path indices: need three places or more, all known, of along- and cross-track position")
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(along), np.diff(cross)))])
    tail = way >= (1 - TAIL) * way[-1]
    offset = float(np.median(cross[tail]))
    farthest = int(np.argmax(np.abs(cross)))
    outside = np.flatnonzero(np.abs(cross - offset) > band)
    steady = int(outside[-1]) + 1 if len(outside) else 0
    if steady >= len(along) - 1:
        raise InputError(
            f"path indices: the track is {abs(cross[-1] - offset):.2g} m from its steady {offset:.2g} m at its end; sail longer or widen the"
            f" band of {band:g} m"
        )
    farthest = min(farthest, steady)
    parts = [slice(0, farthest + 1), slice(farthest, steady + 1), slice(steady, None)]
    turning, approach, last = (area(along[part], cross[part]) for part in parts)
    run = float(np.abs(np.diff(along[parts[2]])).sum())
    if not run > 0:
        raise InputError("path indices: the steady phase has no length along the line")
    return PathIndices(
        turning_area=turning,
        approach_area=approach,
        steady_area=last,
        steady_area_per_m=last / run,
        vertical=float(np.abs(cross).max()),
        steady_vertical=float(np.abs(cross[parts[2]]).max()),
        horizontal=float(max(0.0, -along.min(), along.max() - length)),
        offset=offset,
        steady_rms=float(np.sqrt(np.mean(cross[parts[2]] ** 2))),
        steady_from=float(along[steady]),
    )
