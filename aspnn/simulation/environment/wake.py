"""The wake of a passing ship: waves of Kelvin's pattern in deep water, as components of the same kind as those of a sea.

A ship on a straight course at a steady speed U leads a pattern that stands still as she sees it: a component that travels at theta to
her course has g / omega = U cos theta, its phase speed along her track. So omega = g / (U cos theta), k = omega^2 / g, and the energy,
at half the phase speed, lies at the angle alpha from her track with tan alpha = tan theta / (1 + 2 tan^2 theta). That is greatest,
19.47 degrees, at theta = 35.26: the cusps, whose waves are the highest, have the period 2 pi U sqrt(2/3) / g and reach a
place abeam at a distance d later than she does by 2 sqrt(2) d / U. (Lord Kelvin 1887; J. N. Newman, "Marine Hydrodynamics"
(1977), chapter 6, recalled; derived here.)

How high the waves are at which theta is the ship's own. Here a normal distribution of WIDTH about the cusp is assumed: a train of about
ten waves on either side that grows longer and lower with the distance, in the far field as d^(-1/3) (Airy). The transverse waves in
her track and the shortest diverging ones are left out. As those of a sea, the waves go over the ground.
"""

import math

import numpy as np

from aspnn.simulation.environment.waves import GRAVITY, elevation

CUSP = math.atan(1 / math.sqrt(2))  # direction of the cusp's waves to the track [rad]: 35.26 degrees
WEDGE = math.atan(1 / (2 * math.sqrt(2)))  # half angle of the pattern [rad]: 19.47 degrees
WIDTH = 0.12  # rad, assumed: standard deviation of theta about CUSP
REACH = 3.0  # in WIDTHs: where the components end


def wake_period(speed: float) -> float:
    """Period [s] of the highest waves of a ship at `speed` [m/s], at a place that stands still: 2 pi U cos(35.26 deg) / g."""
    return 2 * math.pi * speed * math.cos(CUSP) / GRAVITY


def wake_delay(speed: float, distance: float) -> float:
    """How long after a ship at `speed` [m/s] is abeam at `distance` [m] her cusp waves arrive [s]: d / (U tan(19.47 deg))."""
    return distance / (speed * math.tan(WEDGE))


def wake_waves(
    speed: float,
    course: float,
    place: tuple[float, float],
    time: float,
    height: float,
    distance: float,
    count: int = 128,
) -> np.ndarray:
    """Components (count, 5) of the wake on one side of the track, to be added to those of a sea (see `waves`).

    The ship goes at `speed` [m/s] on `course` [rad from grid north] and is at `place` (north, east) [m] at `time` [s]; `height` [m] is
    that of her highest wave, crest to trough, at `distance` [m] from the track, to starboard, or to port where it is negative.
    Only that side is whole: on the other one these waves run towards her track ahead of her, as they would in no sea. The
    frequencies are even, so the sum comes again after `repeats` seconds, as though ships followed one another.
    """
    omega, step = _frequencies(speed, count)
    theta = np.arccos(GRAVITY / (speed * omega))
    towards = course + math.copysign(1.0, distance) * theta
    k = omega**2 / GRAVITY
    # an even step in omega is one of step / (omega tan(theta)) in theta
    a = np.exp(-0.5 * ((theta - CUSP) / WIDTH) ** 2) * step / (omega * np.tan(theta))
    phase = omega * time - k * (place[0] * np.cos(towards) + place[1] * np.sin(towards))
    waves = np.stack([a, k, towards, omega, phase], axis=1)
    passing = wake_delay(speed, abs(distance)) + wake_period(speed) * np.linspace(-6, 6, 601)
    north, east = place[0] - distance * math.sin(course), place[1] + distance * math.cos(course)
    waves[:, 0] *= height / np.ptp(elevation(waves, np.array(north), np.array(east), time + passing))
    return waves


def repeats(speed: float, count: int = 128) -> float:
    """After how long [s] the waves of `wake_waves` come again."""
    return 2 * math.pi / _frequencies(speed, count)[1]


def _frequencies(speed: float, count: int) -> tuple[np.ndarray, float]:
    """Frequencies [rad/s] of the components from one end of theta to the other, whole multiples of a step, and that step."""
    low, high = (GRAVITY / (speed * math.cos(CUSP + sign * REACH * WIDTH)) for sign in (-1, 1))
    step = (high - low) / count
    return step * (round(low / step) + np.arange(count)), step
