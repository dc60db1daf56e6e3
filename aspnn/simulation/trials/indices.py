"""What trials measure, from the motion of midship: turning circle, zigzag, stop, Williamson turn and spiral.

Terms as in the resolution MSC.137(76), section 4.2, and its notes MSC/Circ.1053. Plain arrays in, named tuples out; times
count from the order. What a ship did not reach is NaN.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from aspnn.motion.pivot import pivot_point

DIFFER = 0.02  # of the largest yaw rate: branches of a spiral nearer than that are one


class Index(NamedTuple):
    """One figure of a trial: `value` in `unit` (m, s, rad, rad/s, or none), and the greatest that a criterion allows, NaN for none.

    One that is not `judged` is held beside its limit without a verdict. What was not reached (NaN) fails.
    """

    key: str
    title: str
    value: float
    unit: str
    limit: float = np.nan
    judged: bool = True

    @property
    def verdict(self) -> bool | None:
        """Pass or fail; None without a criterion."""
        return bool(self.value <= self.limit) if self.judged and np.isfinite(self.limit) else None


class TurningCircle(NamedTuple):
    """Of midship, from where the rudder was ordered; lengths in m, NaN where the ship did not turn so far."""

    advance: float  # along the initial course until the heading has changed by 90 degrees
    transfer: float  # abeam, at the same instant
    tactical_diameter: float  # abeam, when the heading has changed by 180 degrees


class SteadyTurn(NamedTuple):
    """A turn that no longer changes. `pivot` [m] is where on the centre line the ship has no sway, forward of midship."""

    diameter: float  # of midship's circle, m
    speed: float  # m/s
    drift: float  # rad, positive with the bow to starboard of the course
    yaw_rate: float  # rad/s
    pivot: float


class Zigzag(NamedTuple):
    """`executes` [s] are the orders; overshoot i is reached at `peaks[i]`, the turn having been reversed at `executes[i + 1]`."""

    executes: np.ndarray
    peaks: np.ndarray
    overshoots: np.ndarray  # rad
    initial_time: float  # until the heading has first changed by the angle of the reversals, s
    initial_track: float  # travelled until then, m
    period: float  # from the second execute to the fourth, s


class Stop(NamedTuple):
    """From the order astern until the ship is dead in the water."""

    time: float  # s
    track_reach: float  # along the track, m
    head_reach: float  # along the initial course, m
    side_reach: float  # abeam of it, to starboard positive, m
    heading_change: float  # rad


class Return(NamedTuple):
    """Back on the reciprocal course (for good), and back abeam of the place of the order. Offsets to starboard of the old course."""

    time: float  # s
    offset: float  # m
    heading_error: float  # rad, at the last sample
    abeam_time: float
    abeam_offset: float


class Spiral(NamedTuple):
    """Steady yaw rates `falling` and `rising` [rad/s] at the rudder angles `rudder` [rad], ascending, and the loop between them."""

    rudder: np.ndarray
    falling: np.ndarray  # while the rudder goes from starboard to port
    rising: np.ndarray
    height: float  # difference of the branches amidships, 0 without a loop there, rad/s
    width: float  # of the rudder angles at which the branches differ, rad
    known: float  # how well the width is known: half of the gaps in which the branches part, rad
    slope: float  # of the yaw rate by the rudder angle amidships, 1/s; NaN in a loop


def reached(values, level: float) -> float:
    """Where `values` (steps,) first reach `level`, as a fractional index, interpolated linearly; NaN if they do not."""
    over = np.flatnonzero(np.asarray(values) >= level)
    if len(over) == 0:
        return np.nan
    k = int(over[0])
    return float(k) if k == 0 else k - 1 + (level - values[k - 1]) / (values[k] - values[k - 1])


def at(values, index: float):
    """`values` (steps,), real or complex, at a fractional index; NaN (in both parts) at NaN."""
    values = np.asarray(values)
    if np.isnan(index):
        return complex(np.nan, np.nan) if np.iscomplexobj(values) else np.nan
    return np.interp(index, np.arange(len(values)), values)


def from_start(north, east, heading) -> np.ndarray:
    """Places as complex numbers (steps,) [m]: along the initial heading, and abeam of it to starboard."""
    place = np.asarray(north) - north[0] + 1j * (np.asarray(east) - east[0])
    return place * np.exp(-1j * heading[0])


def travelled(north, east) -> np.ndarray:
    """Length of the track (steps,) [m] since its first place."""
    return np.append(0.0, np.cumsum(np.hypot(np.diff(north), np.diff(east))))


def turning_circle_indices(time, north, east, heading, start: float = 0.0) -> TurningCircle:
    """Indices of a turning circle ordered at `start` [s]; midship `north`, `east` [m], `heading` [rad] continuous.

    All (steps,). Abeam is positive to the side of the turn. The instants are interpolated linearly.
    """
    first = int(np.searchsorted(time, start - 1e-9))
    along = from_start(np.asarray(north)[first:], np.asarray(east)[first:], np.asarray(heading)[first:])
    turned = np.asarray(heading, float)[first:] - heading[first]
    side = np.sign(turned[-1])
    quarter, half = (at(along, reached(side * turned, angle)) for angle in (np.pi / 2, np.pi))
    return TurningCircle(quarter.real, side * quarter.imag, side * half.imag)


def turning_times(time, heading, angles) -> np.ndarray:
    """Times [s] at which a turn ordered at the first sample has changed the heading by each of `angles` [rad]."""
    turned = np.asarray(heading, float) - heading[0]
    return np.array([at(time, reached(np.sign(turned[-1]) * turned, angle)) - time[0] for angle in angles])


def steady_turn(surge: float, sway: float, yaw_rate: float) -> SteadyTurn:
    """The circle of steady velocities at midship [m/s, rad/s]: diameter 2 U / |r|, drift atan(-v / u), pivot point -v / r."""
    speed = float(np.hypot(surge, sway))
    diameter = 2 * speed / abs(yaw_rate) if yaw_rate else np.inf
    return SteadyTurn(
        diameter, speed, float(np.arctan2(-sway, surge)), float(yaw_rate), float(pivot_point(sway, yaw_rate))
    )


def zigzag_overshoots(heading, order, angle: float) -> np.ndarray:
    """Overshoot angles [rad] of a zigzag, first, second, ...: how far past `angle` [rad] each execute let the ship go.

    `heading` [rad] continuous and `order` [rad], both (steps,). The heading change counts from the first non-zero order; an
    overshoot counts when the next reversal shows that the ship came back.
    """
    heading, order = np.asarray(heading, float), np.asarray(order, float)
    executes = np.flatnonzero(np.diff(np.sign(order), prepend=0.0))
    turned = heading - heading[executes[0]]
    return np.array([np.max(-np.sign(order[a]) * turned[a:b]) - angle for a, b in pairwise(executes[1:])])


def zigzag_indices(time, north, east, heading, order, angle: float) -> Zigzag:
    """Indices of a zigzag whose first sample is the first execute; all (steps,) and `order` [rad] as given to the rudder.

    An overshoot is what the heading changes on after a reversal was ordered (the definition of MSC.137(76)). That differs from
    how far it passes `angle` by what the ship turns in the step in which it is noticed, and converges faster with it.
    """
    time, heading, order = (np.asarray(values, float) for values in (time, heading, order))
    executes = np.flatnonzero(np.diff(np.sign(order), prepend=0.0))
    peaks, overshoots = [], []
    for a, b in pairwise(executes[1:]):
        gone = -np.sign(order[a]) * (heading[a:b] - heading[a])
        peaks.append(time[a + int(np.argmax(gone))])
        overshoots.append(float(gone.max()))
    first = reached(np.sign(order[0]) * (heading - heading[0]), angle)
    times = time[executes] - time[0]
    return Zigzag(
        executes=times,
        peaks=np.array(peaks) - time[0],
        overshoots=np.array(overshoots),
        initial_time=at(time, first) - time[0],
        initial_track=float(at(travelled(north, east), first)),
        period=times[3] - times[1] if len(times) > 3 else np.nan,
    )


def stopping_indices(time, north, east, heading, surge) -> Stop:
    """Indices of a stop ordered at the first sample: until the `surge` [m/s] through the water is no longer ahead; all (steps,)."""
    end = reached(-np.asarray(surge), 0.0)
    place, turned = at(from_start(north, east, heading), end), at(heading, end) - heading[0]
    track = float(at(travelled(north, east), end))
    return Stop(at(time, end) - time[0], track, float(place.real), float(place.imag), float(turned))


def return_indices(time, north, east, heading, within: float = np.radians(2)) -> Return:
    """Indices of a turn onto the reciprocal course ordered at the first sample; all (steps,).

    The ship is back on that course when its heading stays `within` [rad] of it to the end, and back at the place of the order when
    it comes abeam of it after it was furthest ahead.
    """
    place, turned = from_start(north, east, heading), np.asarray(heading, float) - heading[0]
    error = np.abs(turned) - np.pi
    off = np.flatnonzero(np.abs(error) > within)
    settled = int(off[-1]) + 1 if len(off) else 0
    if settled == len(error):
        return Return(np.nan, np.nan, float(error[-1]), np.nan, np.nan)
    furthest = int(np.argmax(place.real))
    back = furthest + reached(-place.real[furthest:], 0.0)
    return Return(
        time[settled] - time[0],
        float(place.imag[settled]),
        float(error[-1]),
        at(time, back) - time[0],
        float(at(place.imag, back)),
    )


def spiral_loop(rudder, falling, rising) -> Spiral:
    """A spiral's curve and loop from the steady yaw rates [rad/s] of both ways at ascending `rudder` angles [rad]; all (n,), n odd.

    The branches are two where they differ by more than DIFFER of the largest rate. Either end of the loop lies between the last such
    angle and the next one: it is taken halfway. The middle angle is amidships.
    """
    rudder, falling, rising = (np.asarray(values, float) for values in (rudder, falling, rising))
    apart = np.abs(falling - rising) > DIFFER * max(np.abs(falling).max(), np.abs(rising).max())
    apart[[0, -1]] = False  # there the ways turn
    middle, angles = len(rudder) // 2, np.flatnonzero(apart)
    height, width, known, slope = 0.0, 0.0, float(rudder[middle + 1] - rudder[middle]), np.nan
    if len(angles):
        gaps = rudder[angles[0]] - rudder[angles[0] - 1], rudder[angles[-1] + 1] - rudder[angles[-1]]
        known = float(sum(gaps) / 2)
        width = float(rudder[angles[-1]] - rudder[angles[0]]) + known
    if apart[middle]:
        height = abs(float(falling[middle] - rising[middle]))
    else:
        mean = (falling + rising) / 2
        slope = float((mean[middle + 1] - mean[middle - 1]) / (rudder[middle + 1] - rudder[middle - 1]))
    return Spiral(rudder, falling, rising, height, width, known, slope)
