"""Every motion model is held to the laws of the family; the laws do not know which model they test."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from aspnn.estimation import kernels
from aspnn.estimation.models import (
    THESIS_SCHEME,
    Caa,
    Cmm,
    Ctra,
    Scheme,
    Sigma,
    drift,
    flow,
    jacobian,
    measure,
    measure_jacobian,
)
from aspnn.instruments import Noise
from aspnn.schema import InputError

NOISE = Noise()
FAMILY = {
    "CAA": Caa.of(NOISE),
    "CTRA 6": Ctra.of(NOISE, given=True),
    "CTRA 8": Ctra.of(NOISE),
    "CMM 6": Cmm.of(NOISE, given=True),
    "CMM 8": Cmm.of(NOISE),
}
GIVEN = (0.7, 0.03, 0.001)
SENSORS = (kernels.POSITION, kernels.HEADING, kernels.YAW_RATE, kernels.ACCELERATION)


@pytest.fixture(params=FAMILY)
def model(request):
    return FAMILY[request.param]


def states(model, count=6, seed=1):
    """States of a ship that turns: speeds to 6 m/s, some near and at rest."""
    rng = np.random.default_rng(seed)
    if len(model.states) == 3:
        return rng.normal(0, [2.0, 0.03, 0.001], (count, 3))
    x = rng.normal(
        0, [100, 100, 4, 4, *([2.0, 0.03] if len(model.states) == 8 else []), 0.05, 0.05], (count, len(model.states))
    )
    x[-1, 2:4] = 0.0
    x[-2, 2:4] = 0.03, -0.02
    return x


def sensors_of(model):
    if len(model.states) == 3:
        return (kernels.HEADING, kernels.YAW_RATE)
    return SENSORS if len(model.states) == 8 else (kernels.POSITION, kernels.ACCELERATION)


def slope(function, x):
    """Central differences of a vector function, column by column."""
    step = 1e-6
    columns = [(function(x + step * e) - function(x - step * e)) / (2 * step) for e in np.eye(len(x))]
    return np.stack(columns, axis=-1)


def test_jacobians_are_the_slopes(model):
    """Oracle: central differences of drift and of every sensor, at rest too; with CMM's direction at rest held."""
    for x in states(model):
        held = x[4] if len(x) == 8 else GIVEN[0]
        numeric = slope(lambda s, held=held: drift(model, s, GIVEN, held), x)
        np.testing.assert_allclose(jacobian(model, x, GIVEN), numeric, atol=5e-6)
        for sensor in sensors_of(model):
            numeric = slope(lambda s, sensor=sensor, held=held: measure(model, s, sensor, (30.0, -4.0), GIVEN, held), x)
            np.testing.assert_allclose(measure_jacobian(model, x, sensor, (30.0, -4.0), GIVEN), numeric, atol=5e-6)


def test_the_way_solves_the_differential_equation(model):
    """Oracle: scipy's solve_ivp to 1e-12, with the heading given turning on over the step."""

    def given_at(t):
        return (GIVEN[0] + GIVEN[1] * t + GIVEN[2] * t * t / 2, GIVEN[1] + GIVEN[2] * t, GIVEN[2])

    for x in states(model)[:4]:
        exact = solve_ivp(lambda t, s: drift(model, s, given_at(t)), (0, 0.1), x, rtol=1e-12, atol=1e-12).y[:, -1]
        tolerance = 3e-7 if isinstance(model, Cmm) else 1e-9
        np.testing.assert_allclose(flow(model, x, 0.1, GIVEN)[0], exact, rtol=0, atol=tolerance)
        np.testing.assert_allclose(flow(model, x, 0.1, GIVEN, THESIS_SCHEME)[0], exact, rtol=0, atol=1e-6)


def test_two_steps_are_one(model):
    """Law: over 0.4 s and then 0.6 s as over 1 s, in state, sensitivity and noise."""
    fine = Scheme(4, 0.02)
    for x in states(model)[:4]:
        halfway, first, noise1 = flow(model, x, 0.4, GIVEN, fine)
        then = (GIVEN[0] + GIVEN[1] * 0.4 + GIVEN[2] * 0.08, GIVEN[1] + GIVEN[2] * 0.4, GIVEN[2])
        end, second, noise2 = flow(model, halfway, 0.6, then, fine)
        whole, sensitivity, noise = flow(model, x, 1.0, GIVEN, fine)
        scale = np.sqrt(np.maximum(np.diag(noise), 1e-30))
        np.testing.assert_allclose(end, whole, atol=1e-5)
        np.testing.assert_allclose(second @ first, sensitivity, atol=2e-4)
        joined = second @ noise1 @ second.T + noise2
        np.testing.assert_allclose(joined / np.outer(scale, scale), noise / np.outer(scale, scale), atol=0.02)


def test_sensitivity_is_the_slope_of_the_way(model):
    """Oracle: central differences of the way itself."""
    for x in states(model)[:4]:
        held = x[4] if len(x) == 8 else GIVEN[0]
        numeric = slope(lambda s, held=held: flow(model, s, 0.5, GIVEN, rest=held)[0], x)
        np.testing.assert_allclose(flow(model, x, 0.5, GIVEN)[1], numeric, atol=1e-6)


def test_noise_is_van_loans_and_never_negative(model):
    """Oracle: Van Loan's matrix exponential with the Jacobian held; law: positive semidefinite over 0.01 to 30 s."""
    for x in states(model):
        d, dt = len(x), 0.1
        tolerance = 5e-3 if isinstance(model, Cmm) else 1e-9  # the series of CMM goes on, by a dt / V a term
        middle = (x + flow(model, x, dt, GIVEN)[0]) / 2
        given = (GIVEN[0] + GIVEN[1] * dt / 2 + GIVEN[2] * dt**2 / 8, GIVEN[1] + GIVEN[2] * dt / 2, GIVEN[2])
        if isinstance(model, Cmm) and np.hypot(*x[2:4]) < 0.1:
            continue  # the direction at rest is that of the start, not of the middle
        F = jacobian(model, middle, given)
        block = np.block([[-F, np.diag(model.density)], [np.zeros((d, d)), F.T]]) * dt
        exponential = expm(block)
        expected = exponential[d:, d:].T @ exponential[:d, d:]
        scale = np.sqrt(np.diag(expected))
        noise = flow(model, x, dt, GIVEN)[2]
        np.testing.assert_allclose(noise / np.outer(scale, scale), expected / np.outer(scale, scale), atol=tolerance)
        for dt in (0.01, 1.0, 30.0):
            noise = flow(model, x, dt, GIVEN)[2]
            scale = np.sqrt(np.diag(noise))
            assert np.linalg.eigvalsh(noise / np.outer(scale, scale))[0] > -1e-12


def test_accelerometers_read_the_inertial_acceleration():
    """Oracle: second differences of a station's path over ground, in hull axes (E1, E3, E5), for CTRA and CMM alike."""
    u, v, psi, r, a_u, a_v = 6.0, -0.8, 0.4, 0.03, 0.02, -0.01
    c, s = np.cos(psi), np.sin(psi)
    velocity = np.array([c * u - s * v, s * u + c * v])
    inertial = np.array([[c, -s], [s, c]]) @ [a_u - v * r, a_v + u * r]
    along = velocity / np.hypot(*velocity)
    tangential, normal = inertial @ along, inertial @ [-along[1], along[0]]
    station = np.array([30.0, -4.0])

    def place(t):
        heading = psi + r * t
        turned = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        return velocity * t + inertial * t * t / 2 + turned @ station

    h = 1e-3
    read = np.array([[c, s], [-s, c]]) @ (place(h) - 2 * place(0.0) + place(-h)) / h**2
    ctra = np.array([0, 0, u, v, psi, r, a_u, a_v])
    cmm = np.array([0, 0, *velocity, psi, r, tangential, normal])
    for model, x in ((FAMILY["CTRA 8"], ctra), (replace(FAMILY["CMM 8"], least_speed=1e-6), cmm)):
        np.testing.assert_allclose(measure(model, x, kernels.ACCELERATION, station), read, atol=1e-6)
        np.testing.assert_allclose(measure(model, x, kernels.POSITION, station), place(0.0), atol=1e-12)


def test_cmm_and_ctra_are_one_motion_in_two_frames():
    """Oracle: the constant acceleration that both stand for; over 0.1 s they differ by what each holds constant only."""
    x = np.array([5.0, -3.0, 6.0, 0.5, 0.3, 0.0, 0.05, 0.0])  # no turn: body accelerations keep their direction
    c, s = np.cos(x[4]), np.sin(x[4])
    turn = np.array([[c, -s], [s, c]])
    velocity, acceleration = turn @ x[2:4], turn @ x[6:8]
    along = velocity / np.hypot(*velocity)
    y = np.array([5.0, -3.0, *velocity, 0.3, 0.0, acceleration @ along, acceleration @ [-along[1], along[0]]])
    one, two = flow(FAMILY["CTRA 8"], x, 0.1)[0], flow(FAMILY["CMM 8"], y, 0.1)[0]
    np.testing.assert_allclose(one[:2], two[:2], atol=1e-5)
    np.testing.assert_allclose(turn @ one[2:4], two[2:4], atol=1e-4)


def test_cmm_is_regular_at_rest():
    """Law (E16): at rest the path points ahead, nothing is infinite, and a ship that starts to move does so along her heading."""
    x = np.array([0, 0, 0, 0, 0.3, 0.0, 0.05, 0.0])
    later = flow(FAMILY["CMM 8"], x, 20.0)[0]
    assert np.hypot(*later[2:4]) == pytest.approx(1.0, rel=1e-3)
    assert np.arctan2(later[3], later[2]) == pytest.approx(0.3, abs=1e-6)
    fast = np.array([0, 0, 6.0, 0.2, 0.3, 0.0, 0.05, 0.02])
    printed = np.array([0.05 * fast[2] - 0.02 * fast[3], 0.05 * fast[3] + 0.02 * fast[2]]) / np.hypot(*fast[2:4])
    np.testing.assert_allclose(drift(FAMILY["CMM 8"], fast)[2:4], printed, rtol=1e-3)


def test_sigma_weights_are_the_papers():
    """Published (E23): lambda 1.72 with eight states, 3.54 with six; weights of the mean sum to one; W0c = 3.087."""
    spread, mean, covariance = Sigma().weights(8)
    assert spread - 8 == pytest.approx(1.72) and Sigma().weights(6)[0] - 6 == pytest.approx(3.54)
    assert mean.sum() == pytest.approx(1.0) and covariance[0] == pytest.approx(3.087, abs=1e-3)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Ctra((1.0,) * 7),
        lambda: Cmm((0.0,) * 8),
        lambda: Caa((0.0, 0.0, -1.0)),
        lambda: Cmm.of(NOISE).__class__(Cmm.of(NOISE).density, least_speed=0.0),
        lambda: Scheme(3),
        lambda: Scheme(4, 0.0),
        lambda: Sigma(alpha=0.0),
    ],
)
def test_what_cannot_be_a_model_is_said(wrong):
    with pytest.raises(InputError) as caught:
        wrong()
    assert "\n" not in str(caught.value)
