"""Nomoto's constants online, against a ship whose constants are known and change, and the Mariner's own steady turns."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.estimation import filter_log
from aspnn.estimation.steering import SteeringModel, SteeringSettings, track_steering
from aspnn.orders import Orders
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.simulation.scenario import Scenario, simulate_scenario
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import simulate
from aspnn.vessel import load_vessel

NEUTRAL = math.radians(1.0)
SD = math.radians(0.005)


def ship(constants, rudder, speed, noise, dt=0.5, seed=0) -> States:
    """States of a first-order ship by exact steps: `constants` (n, 2) K' and T', `rudder` (n,) held over each step, `speed` (n,)."""
    rng, vessel = np.random.default_rng(seed), load_vessel("cargo90")
    r = np.zeros(len(rudder))
    for k in range(len(rudder) - 1):
        K, T = constants[k][0] * speed[k] / vessel.length, constants[k][1] * vessel.length / speed[k]
        settled = K * ((rudder[k] + rudder[k + 1]) / 2 - NEUTRAL)
        r[k + 1] = settled + (r[k] - settled) * math.exp(-dt / T) + math.sqrt(noise * dt) * rng.normal()
    table = pd.DataFrame({"time_s": np.arange(len(r)) * dt, "yaw_rate_rad_s": r + SD * rng.normal(size=len(r))})
    table["yaw_rate_rad_s_sd"], table["surge_m_s"], table["sway_m_s"] = SD, speed, 0.0
    table["rudder_angle_rad"], table["coasting"] = rudder, False
    return States(table, vessel)


def helm(count: int, dt: float = 0.5, seed: int = 1) -> np.ndarray:
    """Rudder angles: random orders within 10 deg, held for a minute or so, followed at 2.32 deg/s."""
    rng, time = np.random.default_rng(seed), np.arange(count) * dt
    times = np.cumsum(rng.uniform(40, 100, count // 80))
    orders = Orders(np.append(0.0, times), np.radians(np.append(0.0, rng.uniform(-10, 10, len(times)))))
    return orders.servo(time, 0.0, math.radians(2.32))


def test_constants_that_change_are_found_within_their_errors():
    """Statistic: a ship of K' 1.5, T' 1.2, then 2.2, 0.8 (another loading), at a speed that changes; neutral rudder 1 deg.

    At the end of each half all three lie within four standard errors, which have become small; squared innovations are one on average, of
    about 2,000 with two standard errors of 2 sqrt(2 / n), where nothing changes.
    """
    count = 7200
    first = np.arange(count) < count // 2
    constants = np.where(first[:, None], [1.5, 1.2], [2.2, 0.8])
    speed = 5.5 + 0.8 * np.sin(np.arange(count) / 300)
    settings = SteeringSettings(wander=2e-5, misfit=1e-10, wander_neutral=1e-10)
    found = track_steering(ship(constants, helm(count), speed, noise=1e-10), settings)
    for end, truth in ((1790.0, (1.5, 1.2)), (found.time[-1], (2.2, 0.8))):
        k = int(np.searchsorted(found.time, end)) - 1
        told = np.array([found.gain[k], found.time_constant[k], found.neutral[k]])
        error = np.abs(told - np.array([*truth, NEUTRAL]))
        assert (error < 4 * found.sd[k]).all(), (end, told, found.sd[k])
        assert (
            found.sd[k, 0] < 0.15 * told[0] and found.sd[k, 1] < 0.25 * told[1] and found.sd[k, 2] < math.radians(0.3)
        )
    quiet = found.square[(found.time > 300) & (found.time < 1790)]
    quiet = quiet[np.isfinite(quiet)]
    assert abs(quiet.mean() - 1) < 4 * math.sqrt(2 / len(quiet)) + 0.1  # the wander that is told and is not there


def test_a_step_is_exact_and_batched():
    """Analytic: two steps of half a second are one of a second, and columns of many ships are those of each alone."""
    model, X = SteeringModel(90.0), np.random.default_rng(3).normal(size=(4, 5, 9)) * 0.2
    whole = model.transition(X, (6.0, 0.1), 1.0)
    halves = model.transition(model.transition(X, (6.0, 0.1), 0.5), (6.0, 0.1), 0.5)
    np.testing.assert_allclose(whole, halves, atol=1e-15)
    np.testing.assert_array_equal(whole[:, 2], model.transition(X[:, 2], (6.0, 0.1), 1.0))


def test_a_quiet_rudder_tells_nothing():
    """Contract: on a steady course, whatever the yaw rate does, constants and their errors stay what was believed beforehand."""
    count = 1200
    found = track_steering(ship(np.tile([1.5, 1.2], (count, 1)), np.zeros(count), np.full(count, 6.0), noise=1e-9))
    assert not found.excited.any() and np.isnan(found.square).all()
    np.testing.assert_array_equal(found.gain, found.gain[0])
    np.testing.assert_array_equal(found.covariance, np.broadcast_to(found.covariance[0], found.covariance.shape))
    np.testing.assert_allclose(found.sd[-1], [2.0 * 0.75, 2.0 * 0.75, math.radians(2.0)])


def test_nothing_later_is_read():
    """Law: what is known at an instant is what states up to it give, bit for bit."""
    states = ship(np.tile([1.5, 1.2], (2400, 1)), helm(2400), np.full(2400, 6.0), noise=1e-9)
    whole, part = track_steering(states), track_steering(states.until(600.0))
    for name in ("gain", "time_constant", "neutral", "covariance", "square", "excited"):
        np.testing.assert_array_equal(getattr(whole, name)[: len(part.time)], getattr(part, name))


def test_the_mariners_log_tells_what_her_steady_turns_do():
    """Oracle: simulated steady turns under 2.5 deg to either side, whose yaw rates differ by K 5 deg; random orders up to 2.5 deg.

    Within 25 %: a ship of higher order is no first-order one. The paper's 0.185 1/s and 107 s hold about zero drift alone, where this hull,
    which turns at 0.17 deg/s with her rudder amidships, never is; ten degrees of rudder make K smaller still.
    """
    vessel = load_vessel("mariner")
    hull, rates = Ship.of(vessel), []
    for side in (1, -1):
        order = Orders(np.array([0.0]), np.array([side * math.radians(2.5)]))
        rates.append(simulate(hull, [order], hull.start(0, 0, 0, vessel.service_speed), 1500.0, dt=0.5)[0].yaw_rate[-1])
    gain = (rates[0] - rates[1]) / math.radians(5.0)
    given = {"name": "mariner", "vessel": "mariner", "duration_s": 5400, "seed": 3}
    given["start"] = {"speed_kn": 15, "latitude_deg": 60, "longitude_deg": 3, "zone": "31N", "heading_deg": 40}
    given["manoeuvre"] = {"kind": "random-orders", "rudder_deg": 2.5, "step_deg": 1.25, "hold_s": [100, 400]}
    (log, _), *_ = simulate_scenario(Scenario.model_validate(given))
    states = filter_log(log)
    found = track_steering(states, SteeringSettings(excitation=math.radians(1.0)))
    K, T = found.at(vessel.length, float(states["surge_m_s"].mean()))
    later = found.time > 2700
    np.testing.assert_allclose(K[later].mean(), gain, rtol=0.25)
    assert 20 < T[later].mean() < 107


def test_states_without_a_rudder_are_named():
    """Bad input: one line that names the states and what they lack."""
    states = ship(np.tile([1.5, 1.2], (100, 1)), np.zeros(100), np.full(100, 6.0), noise=0.0)
    without = replace(states, table=states.table.assign(rudder_angle_rad=np.nan), path="a.states.parquet")
    with pytest.raises(InputError, match=r"a\.states\.parquet: no rudder angle"):
        track_steering(without)
    with pytest.raises(InputError, match="shorter than"):
        track_steering(states.until(0.5))
