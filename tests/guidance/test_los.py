"""Line-of-sight guidance against plane geometry and the exact solution of its cross-track error."""

import numpy as np
import pytest

from aspnn.guidance.los import LineOfSight, los_course, los_rate
from aspnn.guidance.route import Follower, Route
from aspnn.schema import InputError


def test_course_points_at_the_leg_ahead():
    """Oracle: the bearing of the point of the leg that is the look-ahead beyond the ship's foot on it."""
    rng = np.random.default_rng(3)
    angle, cross = rng.uniform(-np.pi, np.pi, 30), rng.uniform(-3000, 3000, 30)
    ship = 1j * np.exp(1j * angle) * cross
    target = 800.0 * np.exp(1j * angle)
    bearing = np.angle(target - ship)
    np.testing.assert_allclose(np.exp(1j * los_course(angle, cross, 800.0)), np.exp(1j * bearing), atol=1e-12)


@pytest.mark.parametrize("start", [-2500.0, 30.0, 900.0])
def test_cross_track_error_dies_out_as_solved(start):
    """Oracle: (37) solved exactly: with s = sqrt(D^2 + y^2), s - D asinh(D / |y|) falls by U t. Near the leg y falls as exp(-U t / D)."""
    route, speed, lookahead, dt = Route(np.array([[0, 0], [40000, 30000.0]])), 7.0, 800.0, 0.5
    follower, law = Follower(route, 50.0), LineOfSight(lookahead)
    angle = route.angles[0]
    place = start * 1j * np.exp(1j * angle)

    def velocity(place):
        error = follower.update(np.array([place.real]), np.array([place.imag]))
        return speed * np.exp(1j * law(error, np.array([speed]), np.zeros(1), dt)[0])

    found = []
    for _ in range(1200):
        found.append((place * np.exp(-1j * angle)).imag)
        half = place + velocity(place) * dt / 2
        place += velocity(half) * dt
    y, t = np.array(found), np.arange(1200) * dt

    def solved(y):
        return np.hypot(lookahead, y) - lookahead * np.arcsinh(lookahead / np.abs(y))

    np.testing.assert_allclose(solved(y), solved(start) - speed * t, atol=0.05)
    near = np.abs(y) < 40
    ratio = y[near][1:] / y[near][:-1]
    np.testing.assert_allclose(ratio, np.exp(-speed * dt / lookahead), atol=2e-5)


def test_rate_is_the_derivative():
    """Oracle: central differences of the course along straight motion."""
    rng = np.random.default_rng(6)
    angle, course = rng.uniform(-np.pi, np.pi, (2, 40))
    cross, speed, h = rng.uniform(-2000, 2000, 40), rng.uniform(1, 12, 40), 1e-3
    drift = speed * np.sin(course - angle)
    later, sooner = (los_course(angle, cross + side * h * drift, 800.0) for side in (1, -1))
    np.testing.assert_allclose(
        los_rate(angle, cross, 800.0, speed, course), (later - sooner) / (2 * h), rtol=1e-6, atol=1e-12
    )


@pytest.mark.parametrize("lookahead", [0.0, -5.0, np.nan, np.inf])
def test_look_ahead_that_leads_nowhere(lookahead):
    """Oracle: the project's rule: one line."""
    with pytest.raises(InputError, match="look-ahead of"):
        LineOfSight(lookahead)
