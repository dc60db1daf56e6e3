"""The model of the course filter: its transition against integration, finite differences, quadrature of the noise, and pyproj."""

import math

import numpy as np
import pytest
from pyproj import Geod
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from aspnn.estimation.course_model import CourseModel, per_metre, transition
from aspnn.estimation.course_run import settings
from aspnn.estimation.course_step import COEFFICIENTS, advance
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

MODEL = CourseModel(2e-3, 3e-5, 0.01, 0.2)
GEOD = Geod(ellps="WGS84")
STATES = ([100.0, -40.0, 7.0, 2.0, 0.02], [0.0, 0.0, 2.0, -3.1, -0.15], [5.0, 5.0, 0.0, 1.0, 0.1])


def rates(x, geodetic: bool) -> list[float]:
    """Equations (11)-(15) of 001, and (35), (36) with the radii of E47, transcribed."""
    first, _, U, chi, omega = x
    north, east = U * math.cos(chi), U * math.sin(chi)
    if geodetic:
        a, e2 = 6378137.0, 0.00669437999014
        RN = a / math.sqrt(1 - e2 * math.sin(first) ** 2)
        RM = RN * (1 - e2) / (1 - e2 * math.sin(first) ** 2)
        north, east = north / RM, east / (RN * math.cos(first))
    return [north, east, -MODEL.alpha_speed * U, omega, -MODEL.alpha_turn * omega]


@pytest.mark.parametrize("x", STATES)
@pytest.mark.parametrize("dt", [0.02, 0.5, 10.0])
@pytest.mark.parametrize("geodetic", [False, True])
def test_mean_runs_on_by_the_equations(x, dt, geodetic):
    """Integration by DOP853 to 1e-12; the step is no Jacobian times the state (E46), which is metres off here."""
    x = np.array(x) * [1e-5 if geodetic else 1, 1e-5 if geodetic else 1, 1, 1, 1] + [1.2 * geodetic, 0, 0, 0, 0]
    sol = solve_ivp(lambda t, y: rates(y, geodetic), (0, dt), x, method="DOP853", rtol=1e-12, atol=1e-14)
    scale = np.array([6.4e6, 2.3e6, 1, 1, 1]) if geodetic else np.ones(5)
    np.testing.assert_allclose(transition(MODEL, x, dt, geodetic)[0] * scale, sol.y[:, -1] * scale, atol=2e-6)


@pytest.mark.parametrize("geodetic", [False, True])
def test_the_printed_mean_step_is_metres_off(geodetic):
    """E46: A_d x, as Table 1 prints it, adds (-h U chi sin chi, h U chi cos chi) = (-0.91, -0.42) m in 0.1 s at U = 5, chi = 2."""
    x, h = np.array([1.2 if geodetic else 0.0, 0.3 if geodetic else 0.0, 5.0, 2.0, 0.0]), 0.1
    later, F, _ = transition(CourseModel(1, 1, 1e-9, 1e-9), x, h, geodetic)
    metres = 1 / np.array(per_metre(1.2)[:2]) if geodetic else np.ones(2)
    base = np.array([1.2, 0.3]) if geodetic else np.zeros(2)
    # F (0, 0) - 1 and F (1, 0) of the geodetic form are no part of that step
    off = (F @ (x - [*base, 0, 0, 0]) + [*base, 0, 0, 0] - later)[:2] * metres
    np.testing.assert_allclose(off, [-0.909, -0.416], atol=2e-3)


@pytest.mark.parametrize("x", STATES[:2])
@pytest.mark.parametrize("dt", [0.02, 3.0])
@pytest.mark.parametrize("geodetic", [False, True])
def test_jacobian_is_the_slope_of_the_mean(x, dt, geodetic):
    """Central differences; in the geodetic form A_21 = h U sin chi tan mu / (R_N cos mu) of (49) is among them."""
    x = np.array(x) * [1e-5 if geodetic else 1, 1e-5 if geodetic else 1, 1, 1, 1] + [1.2 * geodetic, 0, 0, 0, 0]
    F = transition(MODEL, x, dt, geodetic)[1]
    steps = np.array([1e-4, 1e-4, 1e-4, 1e-5, 1e-6])
    for j, step in enumerate(steps):
        away = np.eye(5)[j] * step
        slope = (transition(MODEL, x + away, dt, geodetic)[0] - transition(MODEL, x - away, dt, geodetic)[0]) / (
            2 * step
        )
        np.testing.assert_allclose(F[:, j], slope, rtol=2e-6, atol=1e-9 if j > 1 else 2e-11)
    if geodetic and dt < 0.1:
        U, chi = x[2], x[3] + x[4] * dt / 2
        RN = 6378137.0 / math.sqrt(1 - 0.00669437999014 * math.sin(x[0]) ** 2)
        assert F[1, 0] == pytest.approx(dt * U * math.sin(chi) * math.tan(x[0]) / (RN * math.cos(x[0])), rel=0.01)


def test_noise_is_that_of_the_linear_equations():
    """Van Loan's matrix exponential of the model linearised on a straight course, where its Jacobian stays what it is."""
    x, dt = np.array([0.0, 0.0, 6.0, 0.7, 0.0]), 0.4
    model = CourseModel(2e-3, 3e-5, 1e-9, 0.2)  # the speed stays
    A = np.zeros((5, 5))
    A[0, 2:4], A[1, 2:4] = (math.cos(0.7), -6 * math.sin(0.7)), (math.sin(0.7), 6 * math.cos(0.7))
    A[3, 4], A[4, 4] = 1, -0.2
    G = np.diag([0, 0, model.speed_density, 0, model.turn_density])
    both = expm(np.block([[-A, G], [np.zeros((5, 5)), A.T]]) * dt)
    Phi = both[5:, 5:].T
    np.testing.assert_allclose(transition(model, x, dt)[1], Phi, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(transition(model, x, dt)[2], Phi @ both[:5, 5:], rtol=1e-7, atol=1e-14)


@pytest.mark.parametrize("latitude", [-70.0, -10.0, 0.0, 45.0, 69.65, 85.0])
def test_metres_of_a_degree_are_pyprojs(latitude):
    """pyproj.Geod: ways of 10 m along the meridian and the parallel; R_M at 69.65 N is 6 391 778 m, not the printed 6 372 943 (E47)."""
    north, east, by_north, by_east = per_metre(math.radians(latitude))
    arc = math.degrees(10 * north) / 2
    way = GEOD.inv(10, latitude - arc, 10, latitude + arc)[2]
    assert way == pytest.approx(10, rel=1e-7)
    arc = math.degrees(10 * east) / 2
    assert GEOD.inv(10 - arc, latitude, 10 + arc, latitude)[2] == pytest.approx(10, rel=1e-7)
    if latitude == 69.65:
        assert 1 / north == pytest.approx(6391778, abs=1)
    h = 1e-5
    up, down = per_metre(math.radians(latitude) + h), per_metre(math.radians(latitude) - h)
    np.testing.assert_allclose([by_north, by_east], (np.array(up[:2]) - down[:2]) / (2 * h), rtol=1e-5, atol=1e-14)


@pytest.mark.parametrize("geodetic", [False, True])
@pytest.mark.parametrize("dt", [0.02, 0.5, 7.3])
def test_compiled_step_is_the_plain_one(geodetic, dt):
    """`transition`: P -> F P F' + Q and the mean, to rounding."""
    x = np.array([1.2, 3.1, 6.0, -2.0, 0.05]) if geodetic else np.array([10.0, -4.0, 6.0, -2.0, 0.05])
    root = np.random.default_rng(2).normal(size=(5, 5)) * (
        [[1e-7], [3e-7], [0.1], [0.1], [0.01]] if geodetic else [[1.0]] * 5
    )
    P = root @ root.T
    P[3, 3] = min(P[3, 3], 0.5) if geodetic else P[3, 3]
    P = P if geodetic else P * 0.05
    later, F, Q = transition(MODEL, x, dt, geodetic)
    have, spread = x.copy(), P.copy()
    advance(settings(MODEL), geodetic, np.zeros(COEFFICIENTS), have, spread, np.empty((5, 5)), dt)
    np.testing.assert_allclose(have, later, rtol=1e-12, atol=1e-14)
    wanted = F @ P @ F.T + Q
    size = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    np.testing.assert_allclose(spread / size, wanted / size, atol=1e-10)


def test_densities_of_the_papers_and_of_a_vessel():
    """000: E_d Q_d E_d' = h^2 Q_d in every h is a density h Q_d. A vessel's speed spreads as far as its service speed, sqrt(q / 2 a)."""
    model = CourseModel.discrete(1e-5, 2e-5, 0.1, 1e-5, 0.2)
    Q = transition(model, [0, 0, 0, 0, 0], 0.1)[2]
    np.testing.assert_allclose([Q[2, 2], Q[4, 4]], [1e-5 * 0.1**2, 2e-5 * 0.1**2], rtol=0.03)
    vessel = load_vessel("mariner")
    own = CourseModel.of(vessel)
    assert math.sqrt(own.speed_density / (2 * own.alpha_speed)) == pytest.approx(vessel.service_speed)
    with pytest.raises(InputError, match="alpha_turn = 0"):
        CourseModel(1, 1, 1, 0)
