"""Helms, against the orders they stand for and against a ship whose heading is known."""

import numpy as np
import pytest

from aspnn.guidance import held_orders, random_orders, straight, turning_circle, williamson_turn, zigzag
from aspnn.guidance.helms import COLUMNS, HEADING, YAW_RATE, pull_out_orders, spiral_orders
from aspnn.orders import Orders


def steer(helm, headings, turn=0.5, duration=200.0, dt=0.1):
    """Times, headings and orders (steps, batch) of ideal ships that turn at once, at `turn` times the rudder per second."""
    state = np.zeros((len(headings), COLUMNS))
    state[:, HEADING] = headings
    time, psi, orders = np.arange(0, duration, dt), [], []
    for t in time:
        order = np.array(helm(t, state))
        psi.append(state[:, HEADING].copy())
        orders.append(order)
        state[:, HEADING] += turn * order * dt
        state[:, YAW_RATE] = turn * order
    return time, np.array(psi), np.array(orders)


def test_held_orders_are_the_orders():
    """Oracle: Orders.at, one ship at a time."""
    rng = np.random.default_rng(4)
    orders = [random_orders(rng, 900, 35, 5) for _ in range(5)]
    helm = held_orders(orders)
    for time in np.arange(0, 900, 0.7):
        np.testing.assert_array_equal(helm(time, np.zeros((5, COLUMNS))), [one.at(time) for one in orders])
    one = held_orders([Orders(np.array([0.0, 5.0]), np.array([0.1, -0.2]))])
    np.testing.assert_array_equal(one(5.0, np.zeros((3, COLUMNS))), [-0.2] * 3)


def test_straight_and_turning_circle_begin_at_their_instant():
    """Oracle: the definition."""
    state = np.ones((2, COLUMNS))
    assert not straight()(7.0, state).any()
    helm = turning_circle(np.radians(-35), 60.0)
    np.testing.assert_array_equal(helm(59.9, state), [0, 0])
    np.testing.assert_array_equal(helm(60.0, state), np.radians([-35, -35]))


@pytest.mark.parametrize("first", [1, -1])
def test_zigzag_reverses_at_its_heading_whatever_the_initial_one(first):
    """Oracle: a ship that turns at once zigzags in triangles between +-20 degrees; the first side is the order's."""
    headings = np.array([0.3, 2.0, -40.0])
    time, psi, orders = steer(zigzag(first * np.radians(10), np.radians(20), 5.0), headings)
    change = np.degrees(psi - headings)
    assert not orders[time < 4.99].any()
    np.testing.assert_allclose(orders[np.searchsorted(time, 4.999)], first * np.radians(10))
    np.testing.assert_allclose(np.abs(orders[time > 5.01]), np.radians(10))
    reversals = np.diff(orders[:, 0]) * (time[1:] > 5.01) != 0
    np.testing.assert_allclose(
        change[1:][reversals][:, 0] * first, 20 * (-1.0) ** np.arange(reversals.sum()), atol=0.51
    )
    assert reversals.sum() in (
        23,
        24,
    )  # 195 s at 5 deg/s: 4 s to the first, 8 s to each further one and at most a step late


@pytest.mark.parametrize("side", [1, -1])
def test_williamson_turn_ends_on_the_reciprocal_course(side):
    """Oracle: the manoeuvre's definition; away to the side of the rudder by 60 degrees, then round the other way."""
    headings = np.array([0.0, 1.0])
    _, psi, orders = steer(williamson_turn(side * np.radians(35), 10.0, lead=1.0), headings, turn=0.1)
    change = np.degrees(psi - headings) * side
    np.testing.assert_allclose(change.max(axis=0), 60, atol=0.4)
    np.testing.assert_allclose(change[-1], -180, atol=0.1)
    assert np.all(np.diff(change[np.argmax(change[:, 0]) :], axis=0) <= 1e-9)
    assert np.abs(orders).max() == pytest.approx(np.radians(35))


def test_a_helm_steers_a_second_run_like_the_first():
    """Oracle: the first run; a helm forgets at the start."""
    for helm in (zigzag(0.2, 0.3), williamson_turn(0.5, 20.0)):
        first = steer(helm, [0.1])[2]
        np.testing.assert_array_equal(steer(helm, [0.1])[2], first)


def test_random_orders_obey_their_law():
    """Oracle: the law of the standard voyages, and the mean of a uniform hold to 4 standard errors."""
    rng = np.random.default_rng(11)
    many = [random_orders(rng, 1800, 35, 5) for _ in range(200)]
    holds, used = [], set()
    for orders in many:
        degrees = np.degrees(orders.values)
        assert orders.times[0] == 0 and degrees[0] == 0 and orders.times[-1] < 1800
        np.testing.assert_allclose(degrees, 5 * np.round(degrees / 5), atol=1e-9)
        assert np.all(np.abs(np.diff(degrees)) > 4.9)
        used |= set(np.round(degrees).astype(int))
        holds.append(np.diff(orders.times))
    holds = np.concatenate(holds)
    assert used == set(range(-35, 36, 5))
    assert holds.min() >= 60 and holds.max() <= 240
    first = np.array([orders.times[1] for orders in many])  # later ones are cut by the end, the first is not
    assert abs(first.mean() - 150) < 4 * 180 / np.sqrt(12 * len(first))


def test_random_orders_repeat_with_their_seed():
    """Oracle: the same generator."""
    one, two = (random_orders(np.random.default_rng(3), 1800, 35, 5) for _ in range(2))
    np.testing.assert_array_equal(one.times, two.times)
    np.testing.assert_array_equal(one.values, two.values)


def test_spiral_and_pull_out_orders_are_their_angles_in_turn():
    """Oracle: the definition; the spiral goes from starboard to port and back, the pull-out back to amidships."""
    spiral = spiral_orders(np.array([-0.2, 0.0, 0.2]), 30.0)
    np.testing.assert_array_equal(spiral.at(np.arange(0, 180, 15)), np.repeat([0.2, 0.0, -0.2, 0.0, 0.2, 0.2], 2))
    np.testing.assert_array_equal(pull_out_orders(-0.3, 60.0).at([0.0, 59.9, 60.0, 900.0]), [-0.3, -0.3, 0.0, 0.0])
