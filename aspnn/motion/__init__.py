"""Motion of a rigid hull: the pivot point and the path that body velocities draw. Depends on frames and angles only."""

from aspnn.motion.path import Path, integrate, paper_v_path, pivot_path, region_map_path
from aspnn.motion.pivot import pivot_point, pivot_point_sd, region_of, region_pivot, two_station_motion
from aspnn.motion.spread import Region, Spread

__all__ = [
    "Path",
    "Region",
    "Spread",
    "integrate",
    "paper_v_path",
    "pivot_path",
    "pivot_point",
    "pivot_point_sd",
    "region_map_path",
    "region_of",
    "region_pivot",
    "two_station_motion",
]
