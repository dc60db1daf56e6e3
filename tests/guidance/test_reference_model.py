"""The reference model of third order against its analytic step response, its limit of the rate, and the circle."""

import math

import numpy as np
import pytest

from aspnn.guidance.reference_model import ReferenceModel
from aspnn.schema import InputError


def test_a_step_is_that_of_three_equal_poles():
    """Oracle: analytic. With zeta 1, chi = A (1 - e^-s (1 + s + s^2 / 2)), chi' = A w s^2 / 2 e^-s, chi'' = A w^2 (s - s^2 / 2) e^-s."""
    for dt in (0.02, 0.5):
        model, w, A = ReferenceModel(0.7, ships=2), 0.7, np.array([0.3, -0.1])
        model.begin(np.zeros(2))
        for k in range(1, 21):
            s = w * k * dt
            course, rate, acceleration = model.step(dt, A)
            np.testing.assert_allclose(course, A * (1 - math.exp(-s) * (1 + s + s**2 / 2)), atol=1e-12)
            np.testing.assert_allclose(rate, A * w * s**2 / 2 * math.exp(-s), atol=1e-12)
            np.testing.assert_allclose(acceleration, A * w**2 * (s - s**2 / 2) * math.exp(-s), atol=1e-12)


def test_the_rate_stays_within_its_limit_and_the_course_arrives():
    """Oracle: law: |chi'| <= limit, chi is the integral of chi' (trapezoid), and in the end chi is what was ordered."""
    limit, dt = math.radians(2), 0.05
    model = ReferenceModel(1.0, most_rate=limit, ships=1)
    model.begin(np.zeros(1))
    course, rate = [0.0], [0.0]
    for _ in range(1600):
        model.step(dt, np.array([1.0]))
        course.append(model.course[0])
        rate.append(model.rate[0])
        assert model.acceleration[0] == 0 or abs(model.rate[0]) < limit
    assert max(rate) == pytest.approx(limit, rel=1e-12)
    assert np.mean(np.isclose(rate, limit)) > 0.3
    turned = np.cumsum(0.5 * (np.array(rate[1:]) + rate[:-1]) * dt)
    np.testing.assert_allclose(course[1:], turned, atol=2e-4)
    assert course[-1] == pytest.approx(1.0, abs=1e-6)


def test_it_turns_the_shorter_way_round():
    """Oracle: from 170 to -170 degrees is 20 degrees to starboard, through 180."""
    model = ReferenceModel(1.0)
    model.begin([math.radians(170)])
    found = [math.degrees(float(model.step(0.1, np.radians([-170.0]))[0][0])) for _ in range(200)]
    assert min(found) >= 170 and found[-1] == pytest.approx(190, abs=1e-3)


def test_ships_begin_one_by_one():
    """Contract: a ship that is not begun has no course; another's beginning leaves it alone, and a new one puts it at rest."""
    model = ReferenceModel(1.0, ships=2)
    model.begin([1.0, np.nan], np.array([True, False]))
    model.step(0.5, np.array([2.0, 2.0]))
    assert model.course[0] > 1 and np.isnan(model.course[1])
    before = model.course[0]
    model.begin([9.0, 0.5], np.array([False, True]))
    assert (model.course == [before, 0.5]).all() and model.rate[1] == 0 < model.rate[0]


@pytest.mark.parametrize("wrong", [{"omega_n": 0.0}, {"zeta": -1.0}, {"most_rate": 0.0}])
def test_settings_that_make_no_model_are_named(wrong):
    """Contract: InputError."""
    with pytest.raises(InputError, match="reference model"):
        ReferenceModel(**({"omega_n": 1.0} | wrong))
