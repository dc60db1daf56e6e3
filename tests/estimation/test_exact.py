"""The motion models against numerical integration, Van Loan's matrix exponential and exact rigid motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm

from aspnn.estimation.exact import heading_problem, moments, motion_problem, transition, white_jerk
from aspnn.estimation.measurements import Measurements
from aspnn.instruments import Noise

CASES = [(0.3, 0.02, -0.001, 0.1), (2.0, -0.05, 0.002, 4.0), (-1.0, 0.0, 0.0, 1.0), (5.0, 0.2, 0.0, 3.0)]


def van_loan(A, density, dt):
    """exp(A dt) and the covariance that white noise of spectral `density` leaves after dt (Van Loan 1978)."""
    d = len(A)
    block = expm(np.block([[-A, density], [np.zeros((d, d)), A.T]]) * dt)
    F = block[d:, d:].T
    return F, F @ block[:d, d:]


def one_step(psi, r, turn, dt, density=1.0):
    F, Q = transition(np.array([0.0, dt]), np.array([[psi, r, turn], [0, 0, 0]]), density)
    return F[1], Q[1]


@pytest.mark.parametrize("theta, bend", [(0.0, 0.0), (1e-9, 0.0), (0.5, -0.2), (-1.0, 0.1)])
def test_moments_equal_quadrature(theta, bend):
    """Oracle: scipy.integrate.quad; regular at zero turn rate."""
    for k, value in enumerate(moments(theta, bend)):
        parts = [
            quad(lambda s, f=f, k=k: s**k * f(theta * s + bend * s * s), 0, 1, epsabs=1e-14)[0]
            for f in (np.cos, np.sin)
        ]
        assert value == pytest.approx(complex(*parts), abs=1e-13)


@pytest.mark.parametrize("psi, r, turn, dt", CASES)
def test_ctra_step_solves_its_equations_of_motion(psi, r, turn, dt):
    """Oracle: scipy.integrate.solve_ivp on N' + i E' = exp(i psi)(u + i v), psi' = r + r' t, u' = a_u, v' = a_v."""

    def motion(t, x):
        velocity = np.exp(1j * (psi + r * t + turn * t * t / 2)) * (x[2] + 1j * x[3])
        return [velocity.real, velocity.imag, x[4], x[5], 0, 0]

    start = np.array([3.0, -2.0, 6.0, -0.8, 0.05, -0.02])
    end = solve_ivp(motion, (0, dt), start, rtol=1e-12, atol=1e-12, method="DOP853").y[:, -1]
    np.testing.assert_allclose(one_step(psi, r, turn, dt)[0] @ start, end, rtol=1e-10, atol=1e-10)


def test_two_ctra_steps_compose_to_one():
    """Law: F(a + b) = F(b) F(a) and Q(a + b) = F(b) Q(a) F(b)' + Q(b), while the turn rate is constant."""
    psi, r, a, b = 0.4, 0.03, 0.7, 1.6
    Fa, Qa = one_step(psi, r, 0.0, a)
    Fb, Qb = one_step(psi + r * a, r, 0.0, b)
    F, Q = one_step(psi, r, 0.0, a + b)
    np.testing.assert_allclose(Fb @ Fa, F, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(Fb @ Qa @ Fb.T + Qb, Q, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("psi, r, turn, dt", [case for case in CASES if case[2] == 0.0] + [(1.0, 0.05, 0.0, 0.1)])
def test_ctra_noise_equals_van_loan(psi, r, turn, dt):
    """Oracle: Van Loan. Seen from axes that turn with the ship, p' = -r x p + (u, v), a system with constant A."""
    turned, A = np.array([[0.0, r], [-r, 0.0]]), np.zeros((6, 6))
    A[:2, :2], A[:2, 2:4], A[2:4, 4:] = turned, np.eye(2), np.eye(2)
    _, Q = van_loan(A, np.diag([0, 0, 0, 0, 1.0, 1.0]), dt)
    c, s = np.cos(psi + r * dt), np.sin(psi + r * dt)
    grid = np.eye(6)
    grid[:2, :2] = [[c, -s], [s, c]]
    expected = grid @ Q @ grid.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(one_step(psi, r, turn, dt)[1] / scale, expected / scale, atol=2e-8)


def test_white_jerk_equals_van_loan():
    """Oracle: Van Loan on a chain of three integrators (E34: without the factor 1 / dt of the papers)."""
    for dt in (0.1, 2.5):
        _, Q = van_loan(np.diag([1.0, 1.0], 1), np.diag([0, 0, 0.3]), dt)
        np.testing.assert_allclose(white_jerk(dt, 0.3), Q, rtol=1e-8)


def exact_motion(n=200, dt=0.1, stations=None):
    """Noise-free measurements of a ship in an unsteady turn, from finite differences of positions of rigid points."""
    stations = stations or {"bow": (35.0, 2.0), "stern": (-35.0, -1.0), "imu": (12.0, 3.0)}
    t = np.arange(n) * dt

    def pose(t):
        psi = 0.5 + 0.03 * t + 0.004 * t**2 / 2
        return 4 * t + 3 * np.sin(0.1 * t) + 1j * (2 * t - 0.05 * t**2), psi

    def differentiate(f, h=1e-3):
        return lambda t: (8 * (f(t + h) - f(t - h)) - f(t + 2 * h) + f(t - 2 * h)) / (12 * h)

    def point(station):
        return lambda t: pose(t)[0] + np.exp(1j * pose(t)[1]) * complex(*station)

    turn_of = np.exp(-1j * pose(t)[1])
    velocity = differentiate(point((0, 0)))
    body_rate = differentiate(lambda t: np.exp(-1j * pose(t)[1]) * velocity(t))(t)
    felt = turn_of * differentiate(differentiate(point(stations["imu"])))(t)
    truth = np.stack([point((0, 0))(t), turn_of * velocity(t), body_rate], axis=1)
    heading = np.column_stack([pose(t)[1], 0.03 + 0.004 * t, np.full(n, 0.004)])
    m = Measurements(
        time=t,
        origin=np.zeros(2),
        fixes={k: np.column_stack([point(p)(t).real, point(p)(t).imag]) for k, p in stations.items() if k != "imu"},
        heading=heading[:, 0],
        convergence=np.zeros(n),
        yaw_rate=heading[:, 1],
        acceleration=np.column_stack([felt.real, felt.imag]),
        stale=np.zeros(n, bool),
        stations=stations,
    )
    return m, truth.view(float).reshape(n, 6), heading


def test_measurements_of_exact_rigid_motion_leave_no_residual():
    """Oracle: positions of rigid points, differentiated numerically (E1, E5, E7: lever arms of antennas and IMU)."""
    m, truth, heading = exact_motion()
    problem = motion_problem(m, Noise(), heading, np.zeros((len(m.time), 3, 3)), 6.0, 90.0)
    residual = problem.z - np.einsum("nbij,nj->nbi", problem.H, truth)
    np.testing.assert_allclose(residual[:, :2], 0, atol=1e-9)
    np.testing.assert_allclose(residual[:, 2], 0, atol=2e-6)  # of the numerical second derivative


def test_problems_keep_the_law_of_the_engines():
    """Law: F upper triangular, H within its span, F[0] = 1 and Q[0] = 0, Q symmetric and not negative."""
    m, _, heading = exact_motion()
    m = replace(m, time=m.time + np.where(np.arange(len(m.time)) > 50, 7.0, 0.0))
    covariance = np.tile(np.diag([1e-6, 1e-8, 1e-10]), (len(m.time), 1, 1))
    for p in (heading_problem(m, Noise(), 6.0, 90.0), motion_problem(m, Noise(), heading, covariance, 6.0, 90.0)):
        assert np.array_equal(p.F, np.triu(p.F))
        assert np.array_equal(p.F[0], np.eye(len(p.x0))) and not p.Q[0].any()
        for b, (low, high) in enumerate(p.span):
            assert not p.H[:, b, :, :low].any() and not p.H[:, b, :, high:].any()
        np.testing.assert_allclose(p.Q, np.swapaxes(p.Q, 1, 2), rtol=1e-14)
        scale = np.sqrt(np.diagonal(p.Q[1:], axis1=1, axis2=2))
        assert np.linalg.eigvalsh(p.Q[1:] / (scale[:, :, None] * scale[:, None])).min() > 1e-4
        assert np.linalg.eigvalsh(p.R).min() > 0
