"""What the trials of MSC.137(76) measure: advance, transfer and tactical diameter, and the overshoots of a zigzag."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np


class TurningCircle(NamedTuple):
    """Of midship, from where the rudder was ordered; lengths in m, NaN where the ship did not turn so far."""

    advance: float  # along the initial course until the heading has changed by 90 degrees
    transfer: float  # abeam, at the same instant
    tactical_diameter: float  # abeam, when the heading has changed by 180 degrees


def turning_circle_indices(time, north, east, heading, start: float = 0.0) -> TurningCircle:
    """Indices of a turning circle ordered at `start` [s]; midship `north`, `east` [m], `heading` [rad] continuous.

    All (steps,). Abeam is positive to the side of the turn. The instants are interpolated linearly.
    """
    time, heading = np.asarray(time, float), np.asarray(heading, float)
    first = int(np.searchsorted(time, start - 1e-9))
    along = (np.asarray(north) - north[first] + 1j * (np.asarray(east) - east[first])) * np.exp(-1j * heading[first])
    turned = heading - heading[first]
    side = np.sign(turned[-1])

    def when(angle: float) -> complex:
        reached = np.flatnonzero(side * turned[first:] >= angle)
        if len(reached) == 0:
            return complex(np.nan, np.nan)
        k = first + int(reached[0])
        part = (angle - side * turned[k - 1]) / (side * (turned[k] - turned[k - 1]))
        return along[k - 1] + part * (along[k] - along[k - 1])

    quarter, half = when(np.pi / 2), when(np.pi)
    return TurningCircle(quarter.real, side * quarter.imag, side * half.imag)


def zigzag_overshoots(heading, order, angle: float) -> np.ndarray:
    """Overshoot angles [rad] of a zigzag, first, second, ...: how far past `angle` [rad] each execute let the ship go.

    `heading` [rad] continuous and `order` [rad], both (steps,). The heading change counts from the first non-zero order; an
    overshoot counts when the next reversal shows that the ship came back.
    """
    heading, order = np.asarray(heading, float), np.asarray(order, float)
    executes = np.flatnonzero(np.diff(np.sign(order), prepend=0.0))
    turned = heading - heading[executes[0]]
    return np.array([np.max(-np.sign(order[a]) * turned[a:b]) - angle for a, b in pairwise(executes[1:])])
