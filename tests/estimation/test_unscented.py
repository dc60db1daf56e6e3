"""The unscented filter of states and parameters, against a Kalman filter, filterpy, moments and statistics."""

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from aspnn.estimation import craft, noise_bank, unscented
from aspnn.estimation.craft import MASS, PAPER, WanderingMass, advance
from aspnn.estimation.models import Sigma
from aspnn.estimation.noise_bank import NoiseBank
from aspnn.estimation.unscented import Belief
from aspnn.schema import InputError
from aspnn.simulation.ships.trimaran import Trimaran, _accelerations
from aspnn.vessel import load_vessel

REFERENCE = np.array([-2.0, -20.0, 0.0, 1.0, -0.1, 0.05])


class Linear:
    """Four states, two readings; the input is added to the third."""

    F = np.array([[1, 0, 0.1, 0], [0, 1, 0, 0.1], [0, 0, 0.98, 0.05], [0, 0, -0.05, 0.97]])
    H = np.array([[1.0, 0, 0, 0.2], [0, 1.0, 0.3, 0]])

    def transition(self, X, u, dt):
        X = np.einsum("ij,j...->i...", self.F, X)
        X[2] += u
        return X

    def measure(self, X):
        return np.einsum("ij,j...->i...", self.H, X)


class Steered:
    """North, east, heading, speed, gain of the rudder; fix and compass."""

    def transition(self, X, u, dt):
        n, e, psi, speed, gain = X
        return np.array([n + speed * np.cos(psi) * dt, e + speed * np.sin(psi) * dt, psi + gain * u * dt, speed, gain])

    def measure(self, X):
        return X[:3]


def spread(rng, n, scale=1.0):
    A = rng.standard_normal((n, n))
    return scale * (A @ A.T + n * np.eye(n))


@pytest.mark.parametrize("sigma", [unscented.PAPER, Sigma(0.5, 2.0, 0.0), Sigma()])
def test_linear_model_gives_the_kalman_filter(sigma):
    """Oracle: filterpy's KalmanFilter; mean, covariance, log-likelihood and gain over 30 epochs, for any weights (E50)."""
    rng, model = np.random.default_rng(1), Linear()
    kf = KalmanFilter(4, 2)
    kf.x, kf.P, kf.F, kf.H = rng.standard_normal(4), spread(rng, 4), model.F, model.H
    kf.Q, kf.R, kf.B = spread(rng, 4, 0.01), spread(rng, 2, 0.1), np.array([0, 0, 1.0, 0])[:, None]
    belief = Belief(kf.x.copy(), kf.P.copy())
    for z, u in zip(rng.standard_normal((30, 2)), rng.standard_normal(30), strict=True):
        kf.predict(u=np.array([u]))
        kf.update(z)
        found = unscented.update(model, unscented.predict(model, belief, u, 0.1, kf.Q, sigma), z, kf.R, sigma)
        belief = found.belief
        np.testing.assert_allclose(belief.x, kf.x, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(belief.P, kf.P, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(found.K, kf.K, rtol=1e-8, atol=1e-9)
        assert found.likelihood == pytest.approx(kf.log_likelihood, rel=1e-8)


@pytest.mark.parametrize("alpha", [0.5, 0.8, 1.0])
def test_nonlinear_model_against_filterpy(alpha):
    """Oracle: filterpy's UnscentedKalmanFilter, its points drawn anew before the update as the paper does, to 1e-9."""
    rng, model, sigma = np.random.default_rng(2), Steered(), Sigma(alpha, 2.0, 0.0)
    kf = UnscentedKalmanFilter(5, 3, 0.5, lambda x: model.measure(x), None, MerweScaledSigmaPoints(5, alpha, 2.0, 0.0))
    kf.x, kf.P = np.array([0, 0, 0.1, 2, 0.3]), np.diag([1, 1, 0.1, 1, 0.1])
    kf.Q, kf.R = spread(rng, 5, 1e-4), np.diag([0.04, 0.04, 1e-3])
    belief = Belief(kf.x.copy(), kf.P.copy())
    for k in range(40):
        u, z = np.sin(k / 5), np.array([0.8 * k, 0.2 * k, 0.2]) + 0.1 * rng.standard_normal(3)
        kf.predict(0.5, fx=lambda x, dt, u=u: model.transition(x, u, dt))
        kf.sigmas_f = kf.points_fn.sigma_points(kf.x, kf.P)
        kf.update(z)
        found = unscented.update(model, unscented.predict(model, belief, u, 0.5, kf.Q, sigma), z, kf.R, sigma)
        belief = found.belief
        np.testing.assert_allclose(belief.x, kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.P, kf.P, rtol=1e-8, atol=1e-10)
        assert found.likelihood == pytest.approx(kf.log_likelihood, abs=1e-6)


def test_printed_weights_do_not_make_a_mean():
    """E50: with lambda = n (alpha^2 - 1) the right weights sum to 1, the printed ones to -30 (n 9, alpha 0.5)."""
    n, alpha = 9, 0.5
    total, mean, covariance = Sigma(alpha, 2.0, 0.0).weights(n)
    assert total == pytest.approx(n * alpha**2) and mean.sum() == pytest.approx(1.0)
    assert covariance[0] - mean[0] == pytest.approx(1 - alpha**2 + 2.0)
    weight = n * (alpha**2 - 1)
    assert weight / total + 2 * n * weight / (2 * total) == pytest.approx(-30.0)


def test_many_ships_at_once_are_the_same_ships_alone():
    """Law: a batch gives each ship what it gets alone, also where another ship's readings are missing."""
    rng, model = np.random.default_rng(3), Steered()
    Q, R = spread(rng, 5, 1e-4), np.diag([0.04, 0.04, 1e-3])
    x, P = rng.standard_normal((3, 5)), np.stack([spread(rng, 5, 0.05) for _ in range(3)])
    z, u = rng.standard_normal((3, 3)), np.array([0.3, -0.2, 0.9])
    z[1, 0], z[2] = np.nan, np.nan
    ahead = unscented.predict(model, Belief(x, P), u[:, None], 0.5, Q)
    found = unscented.update(model, ahead, z, R)
    for k in range(3):
        alone = unscented.predict(model, Belief(x[k], P[k]), u[k], 0.5, Q)
        np.testing.assert_allclose(ahead.P[k], alone.P, rtol=1e-10, atol=1e-14)
        single = unscented.update(model, alone, z[k], R)
        np.testing.assert_allclose(found.belief.x[k], single.belief.x, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(found.belief.P[k], single.belief.P, rtol=1e-10, atol=1e-13)
        assert found.likelihood[k] == pytest.approx(float(single.likelihood))


def test_missing_rows_are_a_smaller_measurement():
    """Oracle: the same update with the row struck out of model, z and R; nothing measured changes nothing."""

    class Fix(Steered):
        def measure(self, X):
            return X[:2]

    rng = np.random.default_rng(4)
    belief, R = Belief(rng.standard_normal(5), spread(rng, 5, 0.05)), np.diag([0.04, 0.05, 1e-3])
    found = unscented.update(Steered(), belief, np.array([0.3, -0.2, np.nan]), R)
    fewer = unscented.update(Fix(), belief, np.array([0.3, -0.2]), R[:2, :2])
    np.testing.assert_allclose(found.belief.x, fewer.belief.x, rtol=1e-12)
    np.testing.assert_allclose(found.belief.P, fewer.belief.P, rtol=1e-10, atol=1e-14)
    assert found.likelihood == pytest.approx(float(fewer.likelihood)) and np.isnan(found.innovation[2])
    nothing = unscented.update(Steered(), belief, np.full(3, np.nan), R)
    np.testing.assert_allclose(nothing.belief.P, belief.P, rtol=1e-12)
    assert nothing.likelihood == 0.0


def test_angles_are_wrapped():
    """Law: a compass that reads a full turn more tells the same."""
    belief, R = Belief(np.array([0, 0, 6.2, 1, 0.1]), 0.1 * np.eye(5)), np.diag([0.04, 0.05, 1e-3])
    found = [
        unscented.update(Steered(), belief, np.array([0, 0, psi]), R, angles=(2,)) for psi in (0.1, 0.1 - math.tau)
    ]
    np.testing.assert_allclose(found[0].belief.x, found[1].belief.x, rtol=1e-12)
    assert found[0].innovation[2] == pytest.approx(0.1 + math.tau - 6.2)


def test_parameter_is_found_and_its_covariance_is_honest():
    """Statistic: over 200 boats the mean normalised error squared of all five states lies within its 99.9 % bounds (chi-square, 1000
    degrees of freedom), and the gain comes out with less than a fifth of its first standard deviation.
    """
    rng, boats, model = np.random.default_rng(5), 200, Steered()
    P = np.diag([0.04, 0.04, 1e-3, 0.04, 0.01])
    start = np.array([0, 0, 0, 1.0, 0.5])
    true = start + rng.multivariate_normal(np.zeros(5), P, boats)
    Q, R = np.diag([1e-6, 1e-6, 1e-6, 1e-6, 1e-8]), np.diag([0.01, 0.01, 1e-4])
    dt, u, z = (
        np.full(60, 0.5),
        np.sin(np.arange(60) / 4)[:, None, None] * np.ones((boats, 1)),
        np.empty((60, boats, 3)),
    )
    for k in range(60):
        true = model.transition(true.T[..., None], u[k], 0.5)[..., 0].T + rng.multivariate_normal(np.zeros(5), Q, boats)
        z[k] = true[:, :3] + rng.multivariate_normal(np.zeros(3), R, boats)
    first = Belief(np.tile(start, (boats, 1)), np.tile(P, (boats, 1, 1)))
    found = unscented.track(model, first, dt, u, z, Q, R)
    off = found.x[-1] - true
    nees = np.einsum("bi,bi->b", off, np.linalg.solve(found.P[-1], off[..., None])[..., 0]).sum()
    assert 858 < nees < 1154
    assert off[:, 4].std() < 0.02 and found.likelihood.shape == (60, boats)


def test_track_is_its_steps():
    """Law: `track` is predict and update in turn; no prediction over no time, Q in proportion to the step."""
    model, R = Steered(), np.diag([0.04, 0.04, 1e-3])
    belief, Q = Belief(np.array([0, 0, 0.1, 1, 0.2]), 0.1 * np.eye(5)), 1e-3 * np.eye(5)
    dt, z = np.array([0.0, 0.5, 1.5, 0.4]), np.random.default_rng(6).standard_normal((4, 3))
    found = unscented.track(model, belief, dt, np.full(4, 0.3), z, Q, R)
    for k in range(4):
        if k:
            belief = unscented.predict(model, belief, 0.3, dt[k], Q * dt[k] / 0.6)
        belief = unscented.update(model, belief, z[k], R).belief
        np.testing.assert_allclose(found.x[k], belief.x, rtol=1e-12)


def test_a_covariance_that_is_none_is_told():
    """Bad input: one line that says what to give."""
    with pytest.raises(InputError, match="variance at the start") as told:
        unscented.predict(Steered(), Belief(np.zeros(5), np.diag([1, 1, 1, 1, 0.0])), 0.0, 1.0, np.eye(5))
    assert "\n" not in str(told.value)


def test_craft_is_the_simulators_trimaran():
    """Oracle: the trimaran of the simulator (the Python of its compiled function); and the rates of position are those of the hull's velocity."""
    boat, rng = Trimaran.of(load_vessel("trimaran")), np.random.default_rng(7)
    assert tuple(boat[:6]) == tuple(PAPER)
    for _ in range(20):
        x, lever, shaft = rng.standard_normal(6), rng.uniform(-0.6, 0.6), rng.uniform(-2, 3)
        tau = np.array([boat.thrust * shaft, boat.moment * lever])
        found = craft.rates(PAPER, x, tau)
        _accelerations.py_func(boat, np.array([*x, lever, shaft, np.nan]), np.zeros(6), out := np.zeros(9))
        np.testing.assert_allclose(found[3:], out[3:6], rtol=1e-12)
        assert found[0] + 1j * found[1] == pytest.approx((x[3] + 1j * x[4]) * np.exp(1j * x[2]))


def test_craft_advances_in_fourth_order():
    """Oracle: the order of the method: half the step, a sixteenth of the error (against 64 times finer steps)."""
    tau, x = np.array([100.0, 5.0]), np.array([0, 0, 0.2, 1.2, -0.2, 0.3])

    def run(steps):
        y = x
        for _ in range(steps):
            y = advance(PAPER, y, tau, 4.0 / steps)
        return y

    exact = run(512)
    ratio = np.abs(run(4) - exact).max() / np.abs(run(8) - exact).max()
    assert 11 < ratio < 24
    mass = WanderingMass().transition(np.append(x, 230.0)[:, None], tau[:, None], 0.5)
    np.testing.assert_allclose(mass[:MASS, 0], advance(PAPER._replace(m11=230.0), x, tau, 0.5), rtol=1e-12)
    assert mass[MASS, 0] == 230.0


class Walk:
    """A scalar that wanders and is measured."""

    def transition(self, X, u, dt):
        return X

    def measure(self, X):
        return X


def test_bank_finds_the_noise():
    """Statistic: of noises a hundred times apart the bank gives the true one more than 90 % after 400 epochs, in each of 20 runs, and again
    each time the truth has changed, to more and to less: ten times its memory later nothing is left of the old evidence.
    """
    rng, qs, R = np.random.default_rng(8), np.array([1e-4, 1e-2, 1.0]), np.array([[0.04]])
    bank = NoiseBank(qs[:, None, None] * np.eye(1), memory=4.0)
    now = noise_bank.begin(bank, Belief(np.zeros((20, 1)), np.ones((20, 1, 1))))
    x = np.zeros((20, 1))
    for true in (1, 2, 1):
        for _ in range(400):
            x = x + math.sqrt(qs[true]) * rng.standard_normal(x.shape)
            now = noise_bank.step(bank, Walk(), now, None, 0.1, x + 0.2 * rng.standard_normal(x.shape), R)
        assert now.weights[true].min() > 0.9
    np.testing.assert_allclose(now.weights.sum(axis=0), 1.0)


def test_bank_of_one_is_the_filter_and_its_mixture_has_the_spread():
    """Law: one noise gives the plain filter; two equal weights give the mean of means and the covariance of a mixture, by hand."""
    belief, Q, R = Belief(np.array([0, 0, 0.1, 1, 0.2]), 0.1 * np.eye(5)), 1e-3 * np.eye(5), np.eye(3)
    bank = NoiseBank(Q[None])
    now = noise_bank.step(bank, Steered(), noise_bank.begin(bank, belief), 0.3, 0.5, np.ones(3), R)
    alone = unscented.update(Steered(), unscented.predict(Steered(), belief, 0.3, 0.5, Q), np.ones(3), R).belief
    np.testing.assert_allclose(now.belief.x, alone.x, rtol=1e-12)
    np.testing.assert_allclose(now.belief.P, alone.P, rtol=1e-12)
    two = noise_bank.Banked(Belief(np.array([[1.0], [3.0]]), np.array([[[0.5]], [[1.5]]])), np.zeros(2))
    assert two.belief.x == pytest.approx(2.0) and pytest.approx(1.0 + 1.0) == two.belief.P


def test_a_bank_of_no_shape_is_told():
    """Bad input: one line."""
    for Q, memory in ((np.eye(2), 10.0), (np.eye(2)[None], 0.0)):
        with pytest.raises(InputError, match="NoiseBank"):
            NoiseBank(Q, memory)
