"""Helms: callables `(time, state) -> rudder order`, for a whole batch of ships at once.

`time` [s] is one number, `state` an array (batch, 9) or (batch, 15) whose columns are named by the constants below, the result an array
(batch,) of rudder orders [rad], positive to starboard. Any simulator, or a live ship, that offers these columns can be
steered by these helms. A helm with a memory (zigzag, Williamson turn) forgets it at every call up to its first order, so
the same helm can steer one run after another.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from aspnn.orders import Orders

NORTH = 0  # m, grid
EAST = 1  # m, grid
HEADING = 2  # rad, from grid north, continuous (not wrapped)
SURGE = 3  # m/s, through the water, at midship
SWAY = 4  # m/s, through the water, at midship
YAW_RATE = 5  # rad/s
RUDDER = 6  # rad, the rudder angle itself (of a craft without rudder: its steering lever)
SHAFT = 7  # rev/s, the shaft speed itself, ahead positive
PITCH_RATIO = 8  # the propeller's pitch over its diameter, ahead positive; NaN where it is fixed
COLUMNS = 9  # of a ship of three degrees of freedom; one of six goes on:
DOWN = 9  # m, of midship below its place at rest
ROLL = 10  # rad, starboard side down positive
PITCH = 11  # rad, bow up positive
HEAVE = 12  # m/s, downward, body axes
ROLL_RATE = 13  # rad/s
PITCH_RATE = 14  # rad/s
SIX = 15

Helm = Callable[[float, np.ndarray], np.ndarray]


def straight() -> Helm:
    """Rudder amidships for ever."""
    return lambda time, state: np.zeros(len(state))


def turning_circle(order: float, start: float = 0.0) -> Helm:
    """Rudder amidships, from `start` [s] on the rudder `order` [rad] (turning circle of MSC.137(76))."""
    return held_orders([Orders(np.array([-np.inf, start]), np.array([0.0, order]))])


def zigzag(order: float, heading: float, start: float = 0.0) -> Helm:
    """Zigzag test of MSC.137(76): rudder `order` [rad] from `start` [s], reversed each time the ship has come round.

    The reversal is ordered when the heading has changed by `heading` [rad, > 0] to the side of the rudder, from what it was at
    `start`. A positive `order` begins to starboard.
    """
    memory: dict[str, np.ndarray] = {}

    def helm(time: float, state: np.ndarray) -> np.ndarray:
        psi = state[:, HEADING]
        if time <= start + 1e-9:
            memory["initial"] = psi.copy()
            memory["side"] = np.full(len(state), math.copysign(1.0, order))
        if time < start - 1e-9:
            return np.zeros(len(state))
        side = memory["side"]
        reached = side * (psi - memory["initial"]) >= heading
        memory["side"] = np.where(reached, -side, side)
        return abs(order) * memory["side"]

    return helm


def williamson_turn(order: float, start: float = 0.0, away: float = math.radians(60), lead: float = 20.0) -> Helm:
    """Williamson turn: back along the own track, or near it, on the reciprocal course (IAMSAR manual).

    Rudder `order` [rad] from `start` [s] until the heading has changed by `away` [rad]; then the opposite rudder, round the
    other way, eased onto the reciprocal course: rudder = error - `lead` [s] x yaw rate, held within +-order. `lead` should be
    about 1.4 ship lengths at service speed.
    """
    side, hard = math.copysign(1.0, order), abs(order)
    memory: dict[str, np.ndarray] = {}

    def helm(time: float, state: np.ndarray) -> np.ndarray:
        psi = state[:, HEADING]
        if time <= start + 1e-9:
            memory["initial"] = psi.copy()
            memory["returning"] = np.zeros(len(state), bool)
        if time < start - 1e-9:
            return np.zeros(len(state))
        memory["returning"] = memory["returning"] | (side * (psi - memory["initial"]) >= away)
        error = memory["initial"] - side * math.pi - psi
        back = np.clip(error - lead * state[:, YAW_RATE], -hard, hard)
        return np.where(memory["returning"], back, side * hard)

    return helm


def steady_heading(gain: float, lead: float, most: float) -> Helm:
    """An autopilot that keeps the heading of its first call: rudder = gain x (error - `lead` [s] x yaw rate), within +-`most` [rad]."""
    memory: dict[str, np.ndarray] = {}

    def helm(time: float, state: np.ndarray) -> np.ndarray:
        if time <= 1e-9:
            memory["initial"] = state[:, HEADING].copy()
        return np.clip(gain * (memory["initial"] - state[:, HEADING] - lead * state[:, YAW_RATE]), -most, most)

    return helm


def held_orders(orders: Sequence[Orders]) -> Helm:
    """Rudder orders known beforehand, one series per ship of the batch; a single series serves every ship."""
    length = max(len(one.times) for one in orders)
    times = np.array([np.pad(one.times, (0, length - len(one.times)), constant_values=np.inf) for one in orders])
    values = np.array([np.pad(one.values, (0, length - len(one.values))) for one in orders])
    rows = np.arange(len(orders))

    def helm(time: float, state: np.ndarray) -> np.ndarray:
        begun = np.count_nonzero(times <= time + 1e-9, axis=1)
        order = values[rows, np.maximum(begun - 1, 0)]
        return order if len(order) == len(state) else np.full(len(state), order[0])

    return helm


def pull_out_orders(order: float, hold: float) -> Orders:
    """Pull-out: the rudder `order` [rad] held for `hold` [s], then amidships (MSC/Circ.1053, appendix 4)."""
    return Orders(np.array([0.0, hold]), np.array([order, 0.0]))


def spiral_orders(angles: np.ndarray, hold: float) -> Orders:
    """Direct spiral: rudder `angles` [rad], ascending, from the last (most to starboard) down to the first and up again.

    Each is held for `hold` [s], which must be enough for a steady yaw rate (MSC/Circ.1053, appendix 4).
    """
    way = np.append(angles[::-1], angles[1:])
    return Orders(np.arange(len(way)) * hold, way)


def random_orders(
    rng: np.random.Generator,
    duration: float,
    max_deg: float,
    step_deg: float,
    hold_s: tuple[float, float] = (60.0, 240.0),
) -> Orders:
    """Random rudder orders until `duration` [s]: amidships first, then multiples of `step_deg` within `max_deg`.

    Each order is held for a time uniform in `hold_s` and differs from the one before it; all other values are equally likely.
    """
    reach = int(max_deg / step_deg + 1e-9)
    multiples = np.arange(-reach, reach + 1)
    times, values, end = [0.0], [0], rng.uniform(*hold_s)
    while end < duration:
        times.append(end)
        values.append(int(rng.choice(multiples[multiples != values[-1]])))
        end += rng.uniform(*hold_s)
    return Orders(np.array(times), np.radians(np.array(values) * step_deg))
