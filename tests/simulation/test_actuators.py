"""Actuators, against scipy's integration of their equation and against what an order must come to."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aspnn.orders import Orders
from aspnn.schema import InputError
from aspnn.simulation.actuators import Servo, delay_steps, heard, held, moved, within_stops

SERVOS = {
    "rudder": Servo(-0.6, 0.6, rate=0.04),
    "engine": Servo(-2.0, 3.0, rate=0.2, lag=4.0),
    "quick": Servo(-100.0, 100.0, lag=0.1),
    "both": Servo(-1.0, 1.0, rate=0.05, lag=30.0),
}


@pytest.mark.parametrize("name", SERVOS)
@pytest.mark.parametrize("order", [0.5, -0.5, 0.02])
def test_a_servo_follows_its_equation(name, order):
    """Oracle: scipy's solution of x' = clip((order - x) / lag, -rate, rate); without lag x' = +-rate until the order is reached."""
    servo, start = SERVOS[name], 0.1
    times = np.linspace(0, 60, 121)
    ours = np.array([moved(servo, start, held(servo, start, order), t) for t in times])
    if servo.lag == 0:
        theirs = start + np.clip(order - start, -servo.rate * times, servo.rate * times)
    else:
        slope = lambda t, x: np.clip((order - x) / servo.lag, -servo.rate, servo.rate)  # noqa: E731
        theirs = solve_ivp(slope, (0, 60), [start], t_eval=times, rtol=1e-9, atol=1e-12, max_step=0.05).y[0]
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


@pytest.mark.parametrize("name", SERVOS)
def test_two_steps_are_one(name):
    """Law: x' depends on x alone, so 7 s and then 5 s are 12 s."""
    servo = SERVOS[name]
    target = held(servo, -0.3, 0.55)
    between = moved(servo, -0.3, target, 7.0)
    assert moved(servo, between, target, 5.0) == pytest.approx(moved(servo, -0.3, target, 12.0), abs=1e-12)


def test_stops_and_dead_band():
    """Oracle: the definitions; an order just outside the dead band is followed all the way, a pitch that is fixed stays NaN."""
    servo = Servo(-0.6, 0.5, rate=0.1, dead_band=0.02)
    assert held(servo, 0.1, 0.119) == 0.1
    assert moved(servo, 0.1, held(servo, 0.1, 0.121), 9.0) == 0.121
    assert held(servo, 0.1, 2.0) == 0.5 and held(servo, 0.1, -2.0) == -0.6
    assert math.isnan(moved(servo, math.nan, math.nan, 1.0))
    with pytest.raises(InputError, match=r"a rudder order of 0.51 is beyond the stops, -0.6 to 0.5"):
        within_stops(servo, [0.1, 0.51], "a rudder order")
    with pytest.raises(InputError, match="nan"):
        within_stops(servo, [math.nan], "a rudder order")


def test_a_delay_shifts_orders():
    """Oracle: Orders shifted by the delay, the position of the start until then; a delay longer than the voyage is never heard."""
    servo, dt = Servo(-1.0, 1.0, delay=1.5), 0.1
    orders = Orders(np.array([0.0, 3.0]), np.array([0.3, -0.2])).at(np.arange(80) * dt)
    late = heard(servo, orders[None], 0.05, dt)[0]
    shifted = Orders(np.array([-np.inf, 1.5, 4.5]), np.array([0.05, 0.3, -0.2])).at(np.arange(80) * dt)
    np.testing.assert_array_equal(late, shifted)
    assert delay_steps(servo, dt) == 15
    np.testing.assert_array_equal(heard(servo, orders[None, :10], 0.05, dt), np.full((1, 10), 0.05))
