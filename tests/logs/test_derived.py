"""Rudder orders found from the rudder angle. Oracle: the orders that the simulator gave, and the servo of aspnn.orders."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.logs.derived import rudder_orders, with_rudder_orders
from aspnn.orders import Orders
from aspnn.simulation import read_scenario, simulate_scenario
from aspnn.vessel import load_vessel

SCENARIO = Path(__file__).parents[2] / "data/scenarios/cargo90-test.toml"
RATE = load_vessel("cargo90").rudder_rate


@pytest.fixture(scope="module")
def voyages():
    scenario = read_scenario(SCENARIO).model_copy(update={"duration_s": 900.0})
    return [log for log, _ in simulate_scenario(scenario, voyages=6)]


def recorded(log, noise, quantum, every):
    """Time and angle [rad] as an indicator shows them: noisy and rounded to `quantum` [deg], one row in `every`."""
    draw = np.random.default_rng(1)
    angle = log.table["rudder_angle_deg"].to_numpy() + noise * draw.standard_normal(len(log))
    if quantum:
        angle = np.round(angle / quantum) * quantum
    return log.table["time_s"].to_numpy()[::every], np.radians(angle)[::every]


@pytest.mark.parametrize(
    "noise, quantum, every",
    [(0.0, 0.0, 1), (0.5, 0.0, 1), (0.0, 1.0, 1), (0.3, 0.5, 1), (0.4, 1.0, 1), (0.0, 0.0, 10), (0.2, 0.1, 10)],
)
def test_orders_of_the_simulator_are_found(voyages, noise, quantum, every):
    """Simulator: every change of 5 deg or more is found within 1 s and 1 deg, and nothing else is."""
    for log in voyages:
        time, angle = recorded(log, noise, quantum, every)
        found = rudder_orders(time, angle, RATE)
        true = Orders.from_series(log.table["time_s"], np.radians(log.table["rudder_order_deg"]))
        reached = true.times < time[-1] - 20  # the last order must have the time to show
        known = found.times < time[-1] - 20
        assert len(found.times[known]) == len(true.times[reached]) > 3
        np.testing.assert_allclose(found.times[known][1:], true.times[reached][1:], atol=1.0)
        np.testing.assert_allclose(found.values[known], true.values[reached], atol=np.radians(1.0))


def test_size_of_a_five_degree_order_is_five_degrees(voyages):
    """Simulator: with 0.3 deg of noise, orders are the multiples of 5 deg that were given, so none falls under the threshold."""
    for log in voyages:
        found = rudder_orders(*recorded(log, 0.3, 0.0, 1), RATE)
        inside = found.times < 880
        fives = np.degrees(found.values[inside]) / 5
        np.testing.assert_allclose(fives, np.round(fives), atol=1e-9)


def served(orders, end, step, rate=RATE):
    time = np.arange(0, end, step)
    return time, orders.servo(time, float(orders.values[0]), rate)


def test_order_that_comes_before_the_rudder_rests():
    """Servo: 20 deg to starboard, taken back to port while the rudder still moves: the level is that of the turn."""
    given = Orders(np.array([0.0, 30.0, 36.0]), np.radians([0.0, 20.0, -10.0]))
    found = rudder_orders(*served(given, 100.0, 0.1), RATE)
    np.testing.assert_allclose(found.times, given.times, atol=0.3)
    np.testing.assert_allclose(np.degrees(found.values), [0.0, np.degrees(6 * RATE), -10.0], atol=0.5)


def test_gear_of_another_rate():
    """Servo: a gear three times as fast, or half as fast, as the vessel's file says is followed as well."""
    given = Orders(np.array([0.0, 30.0, 90.0, 150.0]), np.radians([0.0, 10.0, -20.0, 5.0]))
    for factor in (0.5, 3.0):
        found = rudder_orders(*served(given, 220.0, 0.1, factor * RATE), RATE)
        np.testing.assert_allclose(found.times, given.times, atol=0.3)
        np.testing.assert_allclose(found.values, given.values, atol=1e-9)


def test_still_rudder_has_one_order():
    """Definition: a noisy rudder that is never moved, and one that swings by less than a degree, are one held order."""
    time = np.arange(0, 600, 0.1)
    noise = np.random.default_rng(2).standard_normal(len(time))
    for angle in (0.3 * noise, 2.0 + 0.3 * np.round(noise), 0.4 * np.sin(time / 5)):
        found = rudder_orders(time, np.radians(angle), RATE)
        assert len(found.times) == 1
        assert abs(np.degrees(found.values[0]) - np.mean(angle)) <= 0.3


@pytest.mark.parametrize("step", [0.1, 1.0])
def test_spike_is_no_order(step):
    """Definition: two samples of pure nonsense, twice in 600 s, move nothing, at 10 Hz and at 1 Hz."""
    given = Orders(np.array([0.0, 100.0]), np.radians([0.0, 10.0]))
    time, angle = served(given, 600.0, step)
    for at, spike in ((200.0, 40.0), (450.0, -40.0)):
        angle[np.searchsorted(time, at) :][:2] = np.radians(spike)
    found = rudder_orders(time, angle, RATE)
    np.testing.assert_allclose(found.times, given.times, atol=0.3)
    np.testing.assert_allclose(found.values, given.values, atol=1e-9)


def test_table_gets_the_column_only_where_it_is_missing(voyages):
    """Contract: derived and noted, NaN before the first angle; recorded orders and tables without angles stay as they are."""
    table = voyages[0].table.copy()
    assert with_rudder_orders(table, RATE) == (table, {})
    bare = table.drop(columns=["rudder_order_deg", "rudder_angle_deg"])
    assert with_rudder_orders(bare, RATE) == (bare, {})
    angle = table.drop(columns="rudder_order_deg")
    angle.loc[:9, "rudder_angle_deg"] = np.nan
    angle.loc[20::2, "rudder_angle_deg"] = np.nan  # half the rate
    derived, notes = with_rudder_orders(angle, RATE)
    orders = Orders.from_series(derived["time_s"], derived["rudder_order_deg"])
    assert notes == {"rudder_order_deg": f"derived from rudder_angle_deg, {len(orders.times)} orders"}
    assert derived["rudder_order_deg"].isna().sum() == 10
    differ = (derived["rudder_order_deg"] - table["rudder_order_deg"]).abs() > 1
    assert differ.sum() * 0.1 < len(orders.times)  # each within 1 s
    pd.testing.assert_frame_equal(derived.drop(columns="rudder_order_deg"), angle)
