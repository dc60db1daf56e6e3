"""Helms that steer courses, on a ship that is Nomoto's model itself, and what stands between a helm and a simulator."""

import math

import numpy as np
import pytest

from aspnn.guidance.autopilot import CourseAutopilot, pole_placement
from aspnn.guidance.helms import COLUMNS, EAST, HEADING, NORTH, SURGE, YAW_RATE
from aspnn.guidance.pilot import TrueNavigation
from aspnn.guidance.reference_model import ReferenceModel
from aspnn.guidance.steered import Compass, CourseHelm, CourseLoop, Fixes, Sampled
from aspnn.orders import Orders
from aspnn.schema import InputError

K, T, SPEED, DT = 0.2, 10.0, 5.0, 0.05


def loop(courses, limit=None):
    def make(ships):
        pilot = CourseAutopilot(pole_placement(K, T, 0.3, 1.0), K, T, limit, ships)
        return CourseLoop(Compass(TrueNavigation()), courses, ReferenceModel(0.2, ships=ships), pilot)

    return CourseHelm(make)


def sail(helm, headings, duration):
    """Ships that obey T r' + r = K delta exactly, at one speed without drift; headings (steps, ships)."""
    state = np.zeros((len(headings), COLUMNS))
    state[:, HEADING], state[:, SURGE] = headings, SPEED
    found, decay = [], math.exp(-DT / T)
    for k in range(round(duration / DT)):
        found.append(state[:, HEADING].copy())
        steady = K * helm(k * DT, state)
        gone = state[:, YAW_RATE] - steady
        state[:, HEADING] += steady * DT + gone * T * (1 - decay)
        state[:, YAW_RATE] = steady + gone * decay
        state[:, NORTH] += SPEED * DT * np.cos(state[:, HEADING])
        state[:, EAST] += SPEED * DT * np.sin(state[:, HEADING])
    return np.array(found)


def test_the_feed_forward_steers_a_ship_that_is_the_model_along_the_reference():
    """Oracle: law. T a + w over K is the inverse of the ship, so courses are those of the reference model, each ship its own."""
    courses = [Orders(np.array([0.0, 40.0]), np.radians([20.0, 0.0])), Orders.held(math.radians(-10))]
    helm = loop(courses)
    found = sail(helm, [0.0, 0.1], 80.0)
    model = ReferenceModel(0.2, ships=2)
    model.begin([0.0, 0.1])
    expected = [model.step(DT if k else 0.0, [float(one.at(k * DT)) for one in courses])[0] for k in range(len(found))]
    np.testing.assert_allclose(found, expected, atol=math.radians(0.1))
    assert np.ptp(np.degrees(found[:, 0])) == pytest.approx(20, abs=0.5)


def test_a_helm_forgets_its_last_run():
    """Oracle: bit by bit the same courses in a second run."""
    helm = loop([Orders.held(0.3)])
    np.testing.assert_array_equal(sail(helm, [0.0], 20.0), sail(helm, [0.0], 20.0))


def test_fixes_come_when_they_are_due_with_their_own_errors():
    """Oracle: by hand. Every 0.2 s of steps of 0.1 s; a helm that looks every 0.5 s gets the latest due."""
    errors = np.arange(12.0).reshape(1, 2, 6)
    state = np.zeros((1, COLUMNS))
    state[0, NORTH], state[0, EAST] = 100.0, 200.0
    receiver = Fixes(errors, 0.2)
    told = [receiver(k * 0.1, state) for k in range(5)]
    assert [float(north[0]) for north, _ in told[::2]] == [100.0, 101.0, 102.0]
    assert [float(east[0]) for _, east in told[::2]] == [206.0, 207.0, 208.0]
    assert all(np.isnan(told[k][0]).all() for k in (1, 3))
    seldom = Fixes(errors, 0.2)
    assert [float(seldom(t, state)[0][0]) for t in (0.0, 0.5, 1.0)] == [100.0, 102.0, 105.0]
    with pytest.raises(InputError, match="a fix every 0 s"):
        Fixes(errors, 0.0)


def test_orders_are_held_between_the_times_the_helm_is_asked():
    """Oracle: by hand, on a clock of its own that rounding does not move, and begun anew at 0."""
    asked = []
    helm = Sampled(lambda time, state: asked.append(round(time, 6)) or np.array([time]), 0.3)
    orders = [float(helm(k * 0.1, np.zeros((1, COLUMNS)))[0]) for k in range(8)]
    assert asked == [0.0, 0.3, 0.6] and orders == pytest.approx([0, 0, 0, 0.3, 0.3, 0.3, 0.6, 0.6])
    helm(0.0, np.zeros((1, COLUMNS)))
    assert asked[-1] == 0.0
    with pytest.raises(InputError, match="asked every -1 s"):
        Sampled(lambda time, state: state[:, 0], -1.0)


def test_a_compass_tells_the_heading_and_leaves_the_track_over_ground():
    """Oracle: by hand, a ship set sideways: speed of the track, heading and yaw rate of the ship."""
    compass, state = Compass(TrueNavigation()), np.zeros((1, COLUMNS))
    state[0, HEADING], state[0, YAW_RATE] = 1.0, 0.02
    compass(0.0, state)
    state[0, EAST] = 0.5
    told = compass(0.1, state)
    assert (told.course[0], told.course_rate[0]) == (1.0, 0.02)
    assert told.speed[0] == pytest.approx(5.0)
