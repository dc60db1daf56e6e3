"""Orders: their own definition sample by sample, and the servo against Euler's method and an exact triangle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aspnn.orders import Orders

STEPS = Orders(np.array([0.0, 100.0, 160.0, 165.0]), np.radians([0.0, 20.0, -10.0, -11.0]))
RATE = np.radians(2.5)

histories = st.lists(st.tuples(st.floats(0.5, 60), st.integers(-7, 7)), min_size=1, max_size=8).map(
    lambda pairs: Orders(
        np.concatenate([[0.0], np.cumsum([gap for gap, _ in pairs])[:-1]]),
        np.radians([5.0 * value for _, value in pairs]),
    )
)


def test_an_order_counts_from_its_own_instant():
    """Definition, by hand: before the first time the first value, the last is held, shape kept."""
    times = [[-5.0, 0.0, 99.999], [100.0, 159.9, 1e6]]
    np.testing.assert_allclose(np.degrees(STEPS.at(times)), [[0, 0, 0], [20, 20, -11]])
    assert Orders.held(0.3).at(-1.0) == Orders.held(0.3).at(1e9) == 0.3


@given(histories)
def test_sampling_and_finding_orders_again(orders):
    """Round trip: sampled at its own times and between, a history gives the same orders back."""
    times = np.sort(np.concatenate([orders.times, orders.times[1:] - 0.25, [orders.times[-1] + 1]]))
    found = Orders.from_series(times, orders.at(times))
    at = np.linspace(-1, orders.times[-1] + 5, 50)
    np.testing.assert_array_equal(found.values, orders.values[np.diff(orders.values, prepend=np.nan) != 0])
    np.testing.assert_array_equal(found.at(orders.times), orders.at(orders.times))
    later = at[~np.any(np.abs(at[:, None] - orders.times) < 0.3, axis=1)]
    np.testing.assert_array_equal(found.at(later), orders.at(later))


def test_missing_samples_repeat_the_last_order():
    """By hand: NaN is no order; nothing known is NaN, never zero."""
    orders = Orders.from_series([0, 1, 2, 3, 4], [np.nan, 0.1, np.nan, 0.1, 0.2])
    np.testing.assert_array_equal(orders.times, [1, 4])
    np.testing.assert_array_equal(orders.values, [0.1, 0.2])
    assert np.isnan(Orders.from_series([0, 1], [np.nan, np.nan]).at([0.0, 5.0])).all()


@given(histories, st.floats(0, 200), st.floats(0, 100))
def test_a_piece_of_a_history_is_that_history(orders, start, span):
    """Definition: `between` shifts the clock and forgets what is outside, first at 0."""
    piece = orders.between(start, start + span)
    assert piece.times[0] == 0 and piece.times[-1] <= span + 1e-6
    times = np.linspace(0, span, 60)
    clear = np.min(np.abs(start + times[:, None] - orders.times), axis=1) > 1e-6  # clocks differ in their last digit
    np.testing.assert_array_equal(piece.at(times[clear]), orders.at(start + times[clear]))


def test_between_at_its_ends():
    """By hand: an order at the very start is the first, one at the very end is in."""
    piece = STEPS.between(100.0, 160.0)
    np.testing.assert_array_equal(piece.times, [0, 60])
    np.testing.assert_allclose(np.degrees(piece.values), [20, -10])


@settings(max_examples=30)
@given(histories, st.floats(-0.6, 0.6))
def test_servo_follows_as_euler_does(orders, start):
    """Euler's method in steps of 20 ms: it hears each order up to a step late, one step's movement (0.05 deg) each at most."""
    h = 0.02
    time = np.arange(0, min(orders.times[-1] + 10, 60), h)
    angle, euler = start, []
    for order in orders.at(time).tolist():
        euler.append(angle)
        angle += min(max(order - angle, -RATE * h), RATE * h)
    np.testing.assert_allclose(orders.servo(time, start, RATE), euler, rtol=0, atol=RATE * h * (len(orders.times) + 1))


def test_servo_by_hand():
    """Exact: 20 deg at 2.5 deg/s takes 8 s; an order taken back half way turns the servo where it is."""
    orders = Orders(np.array([0.0, 10.0, 14.0]), np.radians([0.0, 20.0, 0.0]))
    time = np.array([0.0, 9.9, 10.0, 12.0, 14.0, 16.0, 18.0, 30.0])
    np.testing.assert_allclose(np.degrees(orders.servo(time, 0.0, RATE)), [0, 0, 0, 5, 10, 5, 0, 0], atol=1e-12)


def test_servo_does_not_depend_on_its_samples():
    """Law of an exact solution: any sampling reads the same motion."""
    fine, coarse = np.arange(0, 200.01, 0.1), np.arange(0, 200.01, 40.0)
    motion = STEPS.servo(fine, 0.05, RATE)
    np.testing.assert_allclose(STEPS.servo(coarse, 0.05, RATE), motion[::400], atol=1e-12)


@given(histories, st.floats(-0.6, 0.6))
def test_servo_keeps_its_rate_and_arrives(orders, start):
    """Law: never faster than the rate, and long after the last order the angle is that order."""
    time = np.linspace(0, orders.times[-1] + 60, 400)
    angle = orders.servo(time, start, RATE)
    assert np.all(np.abs(np.diff(angle)) <= RATE * np.diff(time) * (1 + 1e-9))
    np.testing.assert_allclose(angle[[0, -1]], [start, orders.values[-1]], atol=1e-12)


@pytest.mark.parametrize(
    "times, degrees, found",
    [
        ([0, 10, 20], [0, 5, 0], [10, 20]),  # exactly 5 deg counts
        ([0, 10, 20], [0, 4.9, 0], []),  # less does not
        ([0, 10, 15], [0, 10, -10], [10, 15]),  # exactly 5 s apart counts
        ([0, 10, 14.9], [0, 10, -10], [10]),  # sooner does not
        ([0, 10, 12, 15], [0, 10, 11, 20], [10, 15]),  # a small change parts nothing
        ([0, 10, 14, 18, 22], [0, 10, 0, 10, 0], [10]),  # counted from the change before, itself dropped or not
        ([0], [20], []),  # the first order is no change
    ],
)
def test_changes(times, degrees, found):
    """Architecture: a new order is a change of at least 5 deg at least 5 s after the last; by hand at the limits."""
    orders = Orders(np.array(times, float), np.radians(degrees))
    np.testing.assert_array_equal(orders.changes(np.radians(5), 5.0), found)


@pytest.mark.parametrize(
    "start, end, tolerance, held",
    [
        (100, 160, 5, True),  # an order at the very end is outside
        (100, 160.1, 5, False),
        (99.9, 150, 5, False),
        (160, 300, 5, True),  # one degree is course keeping
        (160, 300, 1, False),  # exactly the tolerance is not held
        (200, 300, 0.1, True),
    ],
)
def test_held_within(start, end, tolerance, held):
    """Definition, by hand at the limits."""
    assert STEPS.held_within(start, end, np.radians(tolerance)) is held
