"""The kinematic predictors against closed forms and an independent integration of Paper V's system models."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aspnn.prediction import KinematicPredictor, caa_cmm, caa_ctra, constant
from aspnn.records import States
from aspnn.vessel import load_vessel
from tests.evaluation.conftest import table_of

TIME = np.arange(0, 10.1, 0.5)
CASES = [  # surge, sway, yaw rate and their derivatives
    (6.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (6.0, -0.8, 0.012, -0.03, 0.01, 1e-4),
    (3.0, 0.9, -0.02, 0.02, 0.0, -2e-4),
    (-1.0, 0.3, 0.01, 0.0, 0.0, 0.0),
]


def states_of(case) -> States:
    names = ("surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    names += ("surge_acceleration_m_s2", "sway_acceleration_m_s2", "yaw_acceleration_rad_s2")
    motion = dict(zip(names, case, strict=True)) | {"north_m": 100.0, "east_m": -50.0, "heading_rad": 0.7}
    return States(table_of(TIME, 0 * TIME, motion), load_vessel("cargo90"))


def test_constant_is_the_arc_of_a_bridge_display():
    """Analytic: constant body velocities run a circle of radius hypot(u, v) / |r| about one centre."""
    case = (6.0, -0.8, 0.012, -0.03, 0.01, 1e-4)
    path = KinematicPredictor(load_vessel("cargo90"), constant).predict(states_of(case))
    place = path.north + 1j * path.east
    centre = place + np.exp(1j * path.heading) * 1j * (6.0 - 0.8j) / 0.012
    np.testing.assert_allclose(centre, centre[0], atol=1e-8)
    np.testing.assert_allclose(path.pivot, 0.8 / 0.012)


@pytest.mark.parametrize("case", CASES)
def test_ctra_runs_the_system_model_on(case):
    """Oracle: scipy's integration of Paper V (3) and (7) from the same start; the steps of 0.1 s cost millimetres."""
    u, v, r, du, dv, dr = case

    def model(t, x):
        heading = 0.7 + r * t + dr * t**2 / 2
        forward, starboard = u + du * t, v + dv * t
        return [
            forward * np.cos(heading) - starboard * np.sin(heading),
            starboard * np.cos(heading) + forward * np.sin(heading),
        ]

    path = KinematicPredictor(load_vessel("cargo90"), caa_ctra).predict(states_of(case))
    exact = solve_ivp(model, (0, 90), [100.0, -50.0], t_eval=path.time.clip(0, 90), rtol=1e-10, atol=1e-10).y
    np.testing.assert_allclose(np.stack([path.north, path.east]), exact, atol=5e-3)
    np.testing.assert_allclose(path.heading, 0.7 + r * path.time + dr * path.time**2 / 2, atol=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_cmm_runs_the_system_model_on(case):
    """Oracle: scipy's integration of Paper V (12), with the accelerations of the same start, while the ship moves."""
    u, v, r, du, dv, _ = case
    velocity = (u + 1j * v) * np.exp(0.7j)
    inertial = (du - v * r + 1j * (dv + u * r)) * np.exp(0.7j)
    along = inertial * np.conj(velocity) / abs(velocity)
    tangential, normal = along.real, along.imag

    def model(t, x):
        f = (x[2] + 1j * x[3]) / np.hypot(x[2], x[3])
        acceleration = (tangential + 1j * normal) * f
        return [x[2], x[3], acceleration.real, acceleration.imag]

    path = KinematicPredictor(load_vessel("cargo90"), caa_cmm).predict(states_of(case))
    moving = path.time <= 30  # the ship of the second case stops later
    start = [100.0, -50.0, velocity.real, velocity.imag]
    exact = solve_ivp(model, (0, 30), start, t_eval=path.time[moving].clip(0, 30), rtol=1e-10, atol=1e-10).y
    # 1 / V is regularised by 0.05 m/s: at 1 m/s it turns the course 0.25 % less.
    slack = 2e-2 + 0.0025 * np.abs(np.hypot(*exact[:2] - exact[:2, :1])).max() * (abs(u) < 2)
    np.testing.assert_allclose(np.stack([path.north, path.east])[:, moving], exact[:2], atol=slack)


def test_cmm_at_rest_stays_finite_and_still():
    """Erratum E16: 1 / V has no place at rest; a ship that stops does not run backwards and never becomes NaN."""
    for case in ((0.0,) * 6, (0.5, 0.0, 0.01, -0.05, 0.0, 0.0)):
        path = KinematicPredictor(load_vessel("cargo90"), caa_cmm).predict(states_of(case))
        assert np.isfinite(path.north).all()
        assert np.hypot(path.north - 100, path.east + 50).max() <= 2.6  # V^2 / (2 a)
