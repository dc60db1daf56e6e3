"""The integrator of all ships: kinematics, current, wind, waves and actuators around a model's `accelerations`, compiled.

States are rows as named in `guidance.helms`. The velocities in them are those through the water. A current that is uniform
carries ship and water alike, also while it changes; in one that varies over the sea the ship keeps its momentum on
its way through the water, which adds -(u . grad) V to the derivative of its velocity u through the water. (The pressure that
moves the water, D V / D t per unit mass, moves the floating ship too: the water it displaces has its mass.) The field is
taken as uniform over the hull.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from aspnn.guidance.helms import (
    COLUMNS,
    DOWN,
    EAST,
    HEADING,
    HEAVE,
    NORTH,
    PITCH,
    PITCH_RATE,
    PITCH_RATIO,
    ROLL,
    ROLL_RATE,
    RUDDER,
    SHAFT,
    SIX,
    SURGE,
    SWAY,
    YAW_RATE,
)
from aspnn.simulation.actuators import held, moved
from aspnn.simulation.environment.current import current_at, shear_at
from aspnn.simulation.environment.drift import Drift, drift_load
from aspnn.simulation.environment.waves import Excitation, wave_load
from aspnn.simulation.environment.wind import wind_load
from aspnn.simulation.ships.dynamics import UNCOUNTED, accelerations


class Water(NamedTuple):
    """What surrounds each ship b of a batch: `current` (b, 2) and `wind` (b, steps or 1, 2) velocities [m/s] towards north and
    east, `eddies` (b, m, 5) of the current; `drift` of ships of three degrees of freedom and `excitation` of craft of six are those
    of their modules with ships as the first axis, and empty where there are no waves, or of the other kind."""

    current: np.ndarray
    eddies: np.ndarray
    wind: np.ndarray
    drift: Drift
    excitation: Excitation


def calm(ships: int) -> Water:
    """No current, wind or waves."""
    drift = Drift(np.zeros((ships, 5, 0)), np.zeros((ships, 0, 0, 3, 0)), 1.0)
    excitation = Excitation(np.zeros((ships, 4, 0)), np.zeros((ships, 0, 6, 0)))
    return Water(np.zeros((ships, 2)), np.zeros((ships, 0, 5)), np.zeros((ships, 1, 2)), drift, excitation)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, **UNCOUNTED)
def _rates(model, air, current, eddies, wind, excitation, x, time, steady, load, out):
    """out <- time derivatives of the state row x. `steady` (6) is the load held over a step, `load` (6) work space.

    The wind adds what it changes of the air's load; that of still air is part of the resistance a model has.
    """
    for i in range(6):
        load[i] = steady[i]
    c, s = math.cos(x[HEADING]), math.sin(x[HEADING])
    u, v = x[SURGE], x[SWAY]
    north, east = current[0], current[1]
    if eddies.shape[0] > 0:
        north, east = current_at(current, eddies, x[NORTH], x[EAST], time)
    if wind[0] != 0 or wind[1] != 0:
        X, Y, N = wind_load(air, u + north * c + east * s, v + east * c - north * s)
        ahead, abeam = north - wind[0], east - wind[1]
        blown = wind_load(air, u + ahead * c + abeam * s, v + abeam * c - ahead * s)
        X, Y, N = blown[0] - X, blown[1] - Y, blown[2] - N
        load[0] += X
        load[1] += Y
        load[3] += Y * 0.5 * air.A_L / air.length  # at half the height of a rectangle of its area
        load[4] -= X * 0.5 * air.A_L / air.length
        load[5] += N
    if excitation.load.shape[0] > 0:
        wave_load(excitation, x, time, load)
    accelerations(model, x, load, out)
    out[RUDDER] = out[SHAFT] = out[PITCH_RATIO] = 0.0
    if x.size == COLUMNS:
        ahead, abeam = u * c - v * s, u * s + v * c
        out[HEADING] = x[YAW_RATE]
    else:
        w, p, q, r = x[HEAVE], x[ROLL_RATE], x[PITCH_RATE], x[YAW_RATE]
        cos_roll, sin_roll = math.cos(x[ROLL]), math.sin(x[ROLL])
        cos_pitch, sin_pitch = math.cos(x[PITCH]), math.sin(x[PITCH])
        athwart = v * cos_roll - w * sin_roll
        level = u * cos_pitch + (v * sin_roll + w * cos_roll) * sin_pitch
        ahead, abeam = level * c - athwart * s, level * s + athwart * c
        turning = (q * sin_roll + r * cos_roll) / cos_pitch
        out[HEADING] = turning
        out[DOWN] = -u * sin_pitch + (v * sin_roll + w * cos_roll) * cos_pitch
        out[ROLL] = p + turning * sin_pitch
        out[PITCH] = q * cos_roll - r * sin_roll
    out[NORTH], out[EAST] = ahead + north, abeam + east
    if eddies.shape[0] > 0:
        nn, ne, en, ee = shear_at(eddies, x[NORTH], x[EAST], time)
        ahead, abeam = -(nn * ahead + ne * abeam), -(en * ahead + ee * abeam)
        out[SURGE] += ahead * c + abeam * s
        out[SWAY] += abeam * c - ahead * s


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, **UNCOUNTED)
def _held_load(drift, x, time, steady):
    """steady (6) <- the second-order drift of the waves."""
    for i in range(6):
        steady[i] = 0.0
    if drift.load.shape[0] > 0:
        drift_load(drift, x, time, steady)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, **UNCOUNTED)
def _put(y, x, h, k):
    """The moving part of y <- that of the state x, h seconds along the slopes k; actuators are in places 6 to 8."""
    for i in range(6):
        y[i] = x[i] + h * k[i]
    if x.size > COLUMNS:
        for i in range(COLUMNS, SIX):
            y[i] = x[i] + h * k[i]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, **UNCOUNTED)
def _step(model, air, servos, current, eddies, wind, drift, excitation, x, time, orders, dt, y, k, total, steady, load):
    """One Runge-Kutta step of order 4 for one ship, in place on the row x at `time`; actuators are followed exactly.

    `orders` of rudder, shaft and pitch are held over the step, and so is the second-order drift of the waves. `work`: arrays
    like x for a state, a slope and a sum of slopes, and two of 6 for loads.
    """
    rudder_servo, shaft_servo, hub = servos
    rudder, shaft = held(rudder_servo, x[RUDDER], orders[0]), held(shaft_servo, x[SHAFT], orders[1])
    pitch = orders[2] if math.isnan(orders[2]) else held(hub, x[PITCH_RATIO], orders[2])
    _held_load(drift, x, time, steady)
    _rates(model, air, current, eddies, wind, excitation, x, time, steady, load, k)
    half = 0.5 * dt
    _put(total, x, dt / 6, k)
    _put(y, x, half, k)
    y[RUDDER] = moved(rudder_servo, x[RUDDER], rudder, half)
    y[SHAFT] = moved(shaft_servo, x[SHAFT], shaft, half)
    y[PITCH_RATIO] = moved(hub, x[PITCH_RATIO], pitch, half)
    _rates(model, air, current, eddies, wind, excitation, y, time + half, steady, load, k)
    _put(total, total, dt / 3, k)
    _put(y, x, half, k)
    _rates(model, air, current, eddies, wind, excitation, y, time + half, steady, load, k)
    _put(total, total, dt / 3, k)
    _put(y, x, dt, k)
    x[RUDDER] = y[RUDDER] = moved(rudder_servo, x[RUDDER], rudder, dt)
    x[SHAFT] = y[SHAFT] = moved(shaft_servo, x[SHAFT], shaft, dt)
    x[PITCH_RATIO] = y[PITCH_RATIO] = moved(hub, x[PITCH_RATIO], pitch, dt)
    _rates(model, air, current, eddies, wind, excitation, y, time + dt, steady, load, k)
    _put(x, total, dt / 6, k)


@njit(cache=True, nogil=True, error_model="numpy")
def run_batch(ship, water, first, orders, dt, paths):
    """Steps of every ship b: `paths` (b, steps + 1, columns) holds the start in its first row, reached at time `first` x dt.

    `ship` is (model, air, servos); `orders` (b, steps, 3) are rudder [rad], shaft [rev/s] and pitch ratio (NaN: fixed).
    """
    columns = paths.shape[2]
    model, air, servos = ship
    y, k, total, steady, load = np.empty(columns), np.empty(columns), np.empty(columns), np.empty(6), np.empty(6)
    x, last = np.empty(columns), water.wind.shape[1] - 1
    for b in range(paths.shape[0]):
        current, eddies = water.current[b], water.eddies[b]
        drift = Drift(water.drift.wave[b], water.drift.load[b], water.drift.fastest)
        excitation = Excitation(water.excitation.wave[b], water.excitation.load[b])
        for i in range(columns):
            x[i] = paths[b, 0, i]
        for j in range(orders.shape[1]):
            at = min(first + j, last)
            wind = water.wind[b, at, 0], water.wind[b, at, 1]
            asked = orders[b, j, 0], orders[b, j, 1], orders[b, j, 2]
            time = (first + j) * dt
            _step(
                *(model, air, servos, current, eddies, wind, drift, excitation),
                *(x, time, asked, dt, y, k, total, steady, load),
            )
            for i in range(columns):
                paths[b, j + 1, i] = x[i]


@njit(cache=True, nogil=True, error_model="numpy")
def rates_of(ship, water, b, dt, states):
    """Derivatives (n, columns) of the states (n, columns) of ship b of the batch, row k at time k x dt."""
    out, load, steady = np.empty(states.shape), np.empty(6), np.empty(6)
    drift = Drift(water.drift.wave[b], water.drift.load[b], water.drift.fastest)
    excitation = Excitation(water.excitation.wave[b], water.excitation.load[b])
    model, air, _ = ship
    last = water.wind.shape[1] - 1
    for k in range(states.shape[0]):
        wind = water.wind[b, min(k, last), 0], water.wind[b, min(k, last), 1]
        _held_load(drift, states[k], k * dt, steady)
        _rates(
            model,
            air,
            water.current[b],
            water.eddies[b],
            wind,
            excitation,
            states[k],
            k * dt,
            steady,
            load,
            out[k],
        )
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def current_along(mean, eddies, states, dt):
    """Velocities of the current (n, 2) where and when the states (n, columns) are, row k at time k x dt."""
    out = np.empty((states.shape[0], 2))
    for k in range(states.shape[0]):
        out[k, 0], out[k, 1] = current_at(mean, eddies, states[k, NORTH], states[k, EAST], k * dt)
    return out
