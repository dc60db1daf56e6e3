"""Actuators: what stands between an order and the rudder, the shaft or the propeller's pitch that obeys it."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from aspnn.schema import InputError


class Servo(NamedTuple):
    """A rudder machine, an engine or a pitch hub, in the unit of what it moves (rad, rev/s, pitch ratio).

    It follows the order held between `least` and `most` with the time constant `lag` [s], at most at `rate` [per s]; it
    does not start for an order within `dead_band` of where it stands, and hears each order `delay` [s] late.
    """

    least: float
    most: float
    rate: float = math.inf
    lag: float = 0.0
    dead_band: float = 0.0
    delay: float = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def held(servo, position, order):
    """What the servo makes of an order: within its stops, and where it stands if the difference is in the dead band."""
    order = min(max(order, servo.least), servo.most)
    return position if abs(order - position) <= servo.dead_band else order


@njit(cache=True, nogil=True, error_model="numpy")
def moved(servo, position, target, time):
    """Where a servo is `time` [s] after it stood at `position`, its `target` (of `held`) unchanged: exact.

    x' = clip((target - x) / lag, -rate, rate): a ramp at full rate down to a difference of rate x lag, then an exponential;
    without lag the ramp goes all the way, and without a limit of the rate the exponential does.
    """
    way = target - position
    if time <= 0 or way == 0 or math.isnan(way):  # a pitch that is fixed is NaN
        return position
    near = servo.rate * servo.lag if servo.lag > 0 else 0.0
    ramp = max(abs(way) - near, 0.0) / servo.rate
    if time <= ramp:
        return position + math.copysign(servo.rate * time, way)
    if servo.lag == 0:
        return target
    return target - math.copysign(min(abs(way), near), way) * math.exp((ramp - time) / servo.lag)


def heard(servo: Servo, orders: np.ndarray, first, dt: float) -> np.ndarray:
    """Orders (batch, steps) as a servo hears them: `delay` late, to the nearest step; `first` (batch,) stands until then."""
    late = delay_steps(servo, dt)
    if late == 0:
        return orders
    before = np.broadcast_to(np.reshape(first, (-1, 1)), (len(orders), min(late, orders.shape[1])))
    return np.concatenate([before, orders[:, : orders.shape[1] - before.shape[1]]], axis=1)


def delay_steps(servo: Servo, dt: float) -> int:
    """The delay of a servo in steps of `dt` [s]."""
    return round(servo.delay / dt)


def within_stops(servo: Servo, orders, what: str) -> np.ndarray:
    """The orders, as floats. Raises InputError naming `what` and the stop when one is beyond it or no number."""
    orders = np.asarray(orders, float)
    beyond = ~((orders >= servo.least - 1e-9) & (orders <= servo.most + 1e-9))
    if beyond.any():
        worst = orders[beyond].flat[0]
        raise InputError(f"{what} of {worst:g} is beyond the stops, {servo.least:g} to {servo.most:g}")
    return orders
