"""Frames: geodetic <-> UTM grid, grid convergence, body <-> north-east, attitude and lever arms.

North-east-down, heading clockwise from grid north, x forward, y starboard. gamma is the grid convergence:
true heading = grid heading + gamma. The UTM zone is a setting of the log, never derived per fix (erratum E44).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pyproj import Proj

from aspnn.schema import InputError


@dataclass(frozen=True)
class Zone:
    """A UTM zone: number 1 to 60, northern or southern hemisphere. `Zone.parse("33N")` reads its usual spelling."""

    number: int
    north: bool = True

    @staticmethod
    def parse(text: str) -> "Zone":
        """Zone from text such as 33N or 56S (a band letter is not accepted, since S is one too). Raises InputError."""
        text = text.strip().upper()
        if text[-1:] not in ("N", "S") or not text[:-1].isdecimal() or not 1 <= int(text[:-1]) <= 60:
            raise InputError(f"zone {text!r} is not a UTM zone; write a number from 1 to 60 and N or S, such as 33N")
        return Zone(int(text[:-1]), text[-1] == "N")

    @staticmethod
    def of(latitude: float, longitude: float) -> "Zone":
        """The standard zone of a position [rad]; 6 degrees wide, without the Norwegian and Svalbard exceptions."""
        degrees = (np.degrees(longitude) + 180.0) % 360.0
        return Zone(int(degrees // 6) % 60 + 1, bool(latitude >= 0))  # % of a tiny negative number rounds up to 360

    def __str__(self) -> str:
        return f"{self.number}{'N' if self.north else 'S'}"


@lru_cache(maxsize=8)
def _projection(zone: Zone) -> Proj:
    return Proj(proj="utm", zone=zone.number, south=not zone.north, ellps="WGS84")


def to_grid(latitude, longitude, zone: Zone):
    """UTM northing and easting [m] of geodetic positions [rad]. NaN stays NaN."""
    latitude, longitude = np.broadcast_arrays(np.asarray(latitude, float), np.asarray(longitude, float))
    known = np.isfinite(latitude) & np.isfinite(longitude)
    north, east = np.full(latitude.shape, np.nan), np.full(latitude.shape, np.nan)
    east[known], north[known] = _projection(zone)(np.degrees(longitude[known]), np.degrees(latitude[known]))
    return north, east


def to_geodetic(north, east, zone: Zone):
    """Latitude and longitude [rad] of UTM positions [m]. NaN stays NaN."""
    north, east = np.broadcast_arrays(np.asarray(north, float), np.asarray(east, float))
    known = np.isfinite(north) & np.isfinite(east)
    latitude, longitude = np.full(north.shape, np.nan), np.full(north.shape, np.nan)
    degrees = _projection(zone)(east[known], north[known], inverse=True)
    longitude[known], latitude[known] = np.radians(degrees[0]), np.radians(degrees[1])
    return latitude, longitude


def convergence(latitude, longitude, zone: Zone):
    """Grid convergence gamma [rad] at geodetic positions [rad]: true azimuth of grid north (thesis 3.7). NaN stays NaN."""
    latitude, longitude = np.broadcast_arrays(np.asarray(latitude, float), np.asarray(longitude, float))
    known = np.isfinite(latitude) & np.isfinite(longitude)
    gamma = np.full(latitude.shape, np.nan)
    if known.any():  # get_factors refuses empty arrays
        factors = _projection(zone).get_factors(np.degrees(longitude[known]), np.degrees(latitude[known]))
        gamma[known] = np.radians(factors.meridian_convergence)
    return gamma


def to_north_east(forward, starboard, heading):
    """North and east components of a body vector (x forward, y starboard) at grid `heading` [rad]."""
    c, s = np.cos(heading), np.sin(heading)
    return forward * c - starboard * s, forward * s + starboard * c


def to_body(north, east, heading):
    """Forward and starboard components of a north-east vector at grid `heading` [rad]; the inverse of `to_north_east`."""
    c, s = np.cos(heading), np.sin(heading)
    return north * c + east * s, east * c - north * s


def attitude(roll, pitch, yaw):
    """Rotation matrix (..., 3, 3) from body to north-east-down, angles [rad], order yaw-pitch-roll.

    R_psi R_theta R_phi with R_psi = [[c, -s, 0], [s, c, 0], [0, 0, 1]] (thesis 3.21, corrected: E9).
    """
    roll, pitch, yaw = np.broadcast_arrays(roll, pitch, yaw)
    cf, sf, ct, st, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    rows = [
        [cp * ct, cp * st * sf - sp * cf, cp * st * cf + sp * sf],
        [sp * ct, sp * st * sf + cp * cf, sp * st * cf - cp * sf],
        [-st, ct * sf, ct * cf],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def station_velocity(surge, sway, yaw_rate, station):
    """Surge and sway [m/s] at `station` (x, y) [m]: u_P = u - r Y, v_P = v + r X (thesis 4.1.1, corrected: E6)."""
    x, y = station
    return surge - yaw_rate * y, sway + yaw_rate * x


def station_acceleration(forward, starboard, yaw_rate, yaw_acceleration, station):
    """Inertial acceleration in body axes [m/s2] at `station` (x, y) from that at midship.

    a_P = a + r' x p + r x (r x p): (a_x - r' Y - r^2 X, a_y + r' X - r^2 Y) (Paper V 9-10, corrected: E5).
    """
    x, y = station
    return (
        forward - yaw_acceleration * y - yaw_rate**2 * x,
        starboard + yaw_acceleration * x - yaw_rate**2 * y,
    )
