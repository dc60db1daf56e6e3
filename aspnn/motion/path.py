"""The path of a rigid hull from its body velocities: the exact step, and the two algorithms of the thesis, corrected."""

from dataclasses import dataclass, replace

import numpy as np

from aspnn.frames import to_north_east
from aspnn.motion.pivot import pivot_point, region_of, region_pivot, two_station_motion
from aspnn.motion.spread import Region, Spread, region
from aspnn.schema import InputError


@dataclass(frozen=True)
class Path:
    """A predicted (or true) motion of midship: arrays of shape (..., steps), the first step is the start.

    `time` [s] from the start; `north`, `east` [m]; `heading` [rad] from grid north, continuous; `surge`, `sway` at
    midship [m/s] over ground, `yaw_rate` [rad/s]; `pivot` [m] forward of midship, NaN where undefined. `spread` tells how
    sure it is, where its predictor was calibrated.
    """

    time: np.ndarray
    north: np.ndarray
    east: np.ndarray
    heading: np.ndarray
    surge: np.ndarray
    sway: np.ndarray
    yaw_rate: np.ndarray
    pivot: np.ndarray
    convergence: np.ndarray | float = 0.0  # rad, shape (...)
    spread: Spread | None = None

    @property
    def true_heading(self) -> np.ndarray:
        """Heading [rad] from true north."""
        return self.heading + np.asarray(self.convergence, float)[..., None]

    def sway_at(self, x: float) -> np.ndarray:
        """Sway [m/s] at station `x` [m] forward of midship: v + r x."""
        return self.sway + self.yaw_rate * x

    def region(self, level: float = 0.95) -> Region:
        """Ellipse of the position and interval of the heading that hold the ship with a share `level`, each by itself.

        Raises InputError where the predictor was not calibrated, or not for this level.
        """
        if self.spread is None:
            raise InputError(
                "this path has no regions; calibrate its checkpoint with `aspnn calibrate CHECKPOINT LOG...`"
            )
        return region(self.north, self.east, self.spread, level)

    def pivot_region(self, length: float) -> np.ndarray:
        """Region -7 to 7 of the pivot point (Paper V, table 4) for a ship of `length` [m]."""
        return region_of(self.pivot, length)

    def at(self, time) -> "Path":
        """The path at `time` [s] from the start, linear between steps; outside the horizon it is NaN.

        The pivot point is that of the nearest step, since it may jump through infinity between two.
        """
        time = np.atleast_1d(np.asarray(time, float))
        tolerance = 1e-9 * max(1.0, abs(float(self.time[-1])))
        inside = (time >= self.time[0] - tolerance) & (time <= self.time[-1] + tolerance)
        place = np.where(inside, np.interp(time, self.time, np.arange(len(self.time))), np.nan)
        lower = np.clip(np.nan_to_num(place).astype(int), 0, len(self.time) - 2)
        part = place - lower

        def between(values):
            return values[..., lower] * (1 - part) + values[..., lower + 1] * part

        nearest = np.where(inside, self.pivot[..., np.where(part > 0.5, lower + 1, lower)], np.nan)
        names = ("north", "east", "heading", "surge", "sway", "yaw_rate")
        values = {name: between(getattr(self, name)) for name in names}
        spread = None if self.spread is None else self.spread.between(lower, np.where(inside, part, np.nan))
        return replace(self, time=time, pivot=nearest, spread=spread, **values)

    def __getitem__(self, index) -> "Path":
        """One path (or some) of a batch."""
        names = ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot")
        values = {name: getattr(self, name)[index] for name in names}
        gamma = np.asarray(self.convergence, float)
        spread = None if self.spread is None else self.spread[index]
        return replace(self, **values, convergence=gamma[index] if gamma.ndim else float(gamma), spread=spread)

    def outline(self, hull: np.ndarray) -> np.ndarray:
        """Hull outlines (..., steps, n, 2) as north, east [m] from a body outline (n, 2)."""
        north, east = to_north_east(hull[:, 0], hull[:, 1], self.heading[..., None])
        return np.stack([self.north[..., None] + north, self.east[..., None] + east], axis=-1)


def rigid_step(heading, surge, sway, yaw_rate, dt):
    """Exact displacement of midship over `dt` with constant body velocities: north, east [m] and turn [rad] (E40).

    The integral of exp(i (psi + r s)) (u + i v) over s in [0, dt] is (u + i v) dt exp(i (psi + w / 2)) sinc(w / 2) with
    w = r dt: a circular arc, with no branch at r = 0.
    """
    turn = yaw_rate * dt
    north, east = to_north_east(surge, sway, heading + turn / 2)
    reach = dt * np.sinc(turn / (2 * np.pi))
    return north * reach, east * reach, turn


def integrate(pose, velocity, dt, time=None) -> Path:
    """Path from body velocities held over each step: exact for piecewise constant velocities (E40).

    `pose` (..., 3): north, east [m], heading [rad] at the start. `velocity` (..., steps, 3): surge, sway [m/s], yaw rate
    [rad/s] over each step of `dt` [s] (a number or (steps,)). The path has steps + 1 points; its velocities at the start
    of step k are those held over the step, the last point repeats the last step's.
    """
    surge, sway, yaw_rate = np.ascontiguousarray(np.moveaxis(np.asarray(velocity, float), -1, 0))
    dt = np.broadcast_to(np.asarray(dt, float), surge.shape[-1:])
    pose = np.broadcast_to(np.asarray(pose, float), (*surge.shape[:-1], 3))
    walked = np.zeros((3, *surge.shape[:-1], len(dt) + 1))
    np.cumsum(yaw_rate * dt, axis=-1, out=walked[2, ..., 1:])
    heading = pose[..., 2:3] + walked[2]
    north, east, _ = rigid_step(heading[..., :-1], surge, sway, yaw_rate, dt)
    np.cumsum(north, axis=-1, out=walked[0, ..., 1:])
    np.cumsum(east, axis=-1, out=walked[1, ..., 1:])
    u, v, r = (np.concatenate([w, w[..., -1:]], axis=-1) for w in (surge, sway, yaw_rate))
    return Path(
        time=np.concatenate([[0.0], np.cumsum(dt)]) if time is None else np.asarray(time, float),
        north=pose[..., 0:1] + walked[0],
        east=pose[..., 1:2] + walked[1],
        heading=heading,
        surge=u,
        sway=v,
        yaw_rate=r,
        pivot=pivot_point(v, r, YAW_RATE_FLOOR / 3),
    )


YAW_RATE_FLOOR = 1e-4  # rad/s (0.006 deg/s): a predicted turn slower than this has no pivot point


def region_map_path(pose, surge, sway_bow, sway_stern, dt, x_bow: float, x_stern: float, length: float) -> Path:
    """Path by Paper V's pivot-point regions (table 4), corrected (E41): the thesis predictor's default.

    The two sways choose a region, its fixed place x_pp gives the yaw rate r = v_stern / (x_stern - x_pp) with the signed
    distance, midship sways with -r x_pp, and the rigid body moves by the exact step (E40). `surge`, `sway_bow`,
    `sway_stern` (..., steps) [m/s] over each step of `dt`. The path's `pivot` is the mapped one. A station at the centre
    of a region is a pole of the map: there the two sways give the yaw rate directly.
    """
    place = region_pivot(sway_bow, sway_stern, x_bow, x_stern, length)
    lever = x_stern - place
    _, direct = two_station_motion(sway_bow, sway_stern, x_bow, x_stern)
    pole = np.abs(lever) < 1e-6 * length
    yaw_rate = np.where(pole, direct, sway_stern / np.where(pole, 1.0, lever))
    path = integrate(pose, np.stack([surge, -yaw_rate * place, yaw_rate], axis=-1), dt)
    return replace(path, pivot=np.concatenate([place, place[..., -1:]], axis=-1))


def pivot_path(pose, surge, sway, yaw_rate, dt) -> Path:
    """Path by the thesis's algorithm (table 4.1, Paper VI algorithm 2), corrected (E40): first order in dt.

    Each step translates midship by u dt along the heading, then turns the hull by r dt about the pivot point
    L = -v / r ahead, for steps k to k + N - 1. Without turning the sway is a translation. Shapes as in `integrate`.
    """
    surge, sway, yaw_rate = np.broadcast_arrays(*(np.asarray(w, float) for w in (surge, sway, yaw_rate)))
    turn = yaw_rate * dt
    turning = np.abs(turn) > 1e-12
    lever = np.where(turning, -sway / np.where(turning, yaw_rate, 1.0), 0.0)
    # In body axes at the step's start: forward u dt, then (1 - exp(i turn)) L for the turn about the pivot point.
    step = surge * dt + np.where(turning, lever * (1 - np.exp(1j * turn)), 1j * sway * dt)
    return walk(pose, step, turn, np.stack([surge, sway, yaw_rate], axis=-1), dt)


def paper_v_path(pose, surge, sway_bow, sway_stern, dt, x_bow: float, x_stern: float) -> Path:
    """Path by Paper V's printed update with the signed distance (E41a): turn first, then u dt along the new heading.

    Midship is never turned about the pivot point, so its sway is lost: 31 m after 90 s in a turn (E41b). Kept for the
    comparison that shows it; predictions use `region_map_path` or `integrate`.
    """
    sway, yaw_rate = two_station_motion(np.asarray(sway_bow, float), np.asarray(sway_stern, float), x_bow, x_stern)
    turn = yaw_rate * dt
    return walk(pose, surge * dt * np.exp(1j * turn), turn, np.stack([surge + 0 * sway, sway, yaw_rate], axis=-1), dt)


def walk(pose, step, turn, velocity, dt) -> Path:
    """Add up body displacements `step` (forward + i starboard) and turns; the velocities are kept as given."""
    path = integrate(pose, velocity, dt)
    heading = np.asarray(pose, float)[..., 2:3] + np.concatenate([0 * turn[..., :1], np.cumsum(turn, axis=-1)], axis=-1)
    walked = np.cumsum(step * np.exp(1j * heading[..., :-1]), axis=-1)
    north = path.north[..., :1] + np.concatenate([0 * turn[..., :1], walked.real], axis=-1)
    east = path.east[..., :1] + np.concatenate([0 * turn[..., :1], walked.imag], axis=-1)
    return replace(path, north=north, east=east, heading=heading)
