"""The MIT rule and its derivatives, against finite differences of whole runs, analytic derivatives and statistics."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aspnn.estimation import adaptive_ukf, unscented
from aspnn.estimation.adaptive_ukf import MitRule
from aspnn.estimation.craft import PAPER, WanderingMass, advance
from aspnn.estimation.models import Sigma
from aspnn.estimation.unscented import Belief
from aspnn.schema import InputError

R = np.diag([0.04, 0.04, 1e-4, 4e-4, 4e-4, 1e-6])
FIXED = np.diag([1e-6] * 3 + [1e-5] * 3 + [0.0])
DIRECTIONS = np.zeros((2, 7, 7))
DIRECTIONS[0, 6, 6], DIRECTIONS[1, 3, 3], DIRECTIONS[1, 4, 4], DIRECTIONS[1, 3, 4], DIRECTIONS[1, 4, 3] = (
    1,
    1e-3,
    2e-3,
    5e-4,
    5e-4,
)
RULE = MitRule(FIXED, DIRECTIONS, np.full(2, 1e-6), np.full(2, 1e3), gain=0.0, window=8)
BELIEF = Belief(np.array([0, 0, 0, 1, -0.1, 0.05, 200.0]), np.diag([*np.diag(R), 400.0]))
MODEL = WanderingMass()


def voyage(count=14, mass=215.0):
    rng, x, zs, taus = np.random.default_rng(0), BELIEF.x[:6], [], []
    for k in range(count):
        tau = np.array([71 + 20 * math.sin(k), -2.5])
        x = advance(PAPER._replace(m11=mass), x, tau, 0.1)
        zs.append(x + np.sqrt(np.diag(R)) * rng.standard_normal(6))
        taus.append(tau[:, None])
    return np.array(zs), taus


def run(q, sigma=unscented.PAPER):
    """The filter after the voyage with q held, and its last update with slopes."""
    zs, taus = voyage()
    now = adaptive_ukf.begin(RULE, BELIEF, q, 6)
    for z, tau in zip(zs[:-1], taus[:-1], strict=True):
        now = adaptive_ukf.step(RULE, MODEL, now, tau, 0.1, z, R, sigma)
    ahead, slope = adaptive_ukf.predict(MODEL, now.belief, now.slope, taus[-1], 0.1, RULE.Q(q), DIRECTIONS, sigma)
    found, slopes = adaptive_ukf.update(MODEL, ahead, slope, zs[-1], R, sigma)
    last = adaptive_ukf.step(RULE, MODEL, now, taus[-1], 0.1, zs[-1], R, sigma)
    return ahead, slope, found, slopes, last


@pytest.mark.parametrize("sigma", [unscented.PAPER, Sigma(0.6, 2.0, 0.0)])
def test_every_derivative_is_a_finite_difference(sigma):
    """Oracle: central differences, by Richardson, of the whole run of 14 epochs with another q: predicted mean and covariance, innovation,
    S, gain, mean, covariance and V, to 1e-6 of the largest of each, for both intensities of a full 2 x 2 direction.
    """
    q = np.array([2.0, 0.5])

    def told(q):
        ahead, _, found, _, last = run(q, sigma)
        return [ahead.x, ahead.P, found.innovation, found.S, found.K, found.belief.x, found.belief.P, last.criterion]

    _, slope, _, slopes, last = run(q, sigma)
    analytic = [slope.x, slope.P, slopes.innovation, slopes.S, slopes.K, slopes.belief.x, slopes.belief.P, last.descent]
    names = ["xbar-", "P-", "y", "S", "K", "xbar", "P", "V"]
    for j in range(2):
        differences = []
        for h in (0.02 * q[j], 0.01 * q[j]):
            step = np.eye(2)[j] * h
            differences.append([(a - b) / (2 * h) for a, b in zip(told(q + step), told(q - step), strict=True)])
        for name, exact, wide, narrow in zip(names, analytic, *differences, strict=True):
            best = (4 * narrow - wide) / 3  # error of the fourth power of the step
            assert np.abs(exact[j]).max() > 0
            np.testing.assert_allclose(exact[j], best, atol=1e-6 * np.abs(exact[j]).max(), rtol=0, err_msg=name)


def test_slope_of_a_linear_filter_by_hand():
    """Oracle: a scalar random walk. S = P + q + R, so dS/dq = 1; K = (P + q) / S, dK/dq = R / S^2; dP/dq = K_dash R."""

    class Walk:
        def transition(self, X, u, dt):
            return X

        def measure(self, X):
            return X

    P, q, noise, y = 0.7, 0.3, 0.5, 1.1
    belief, none = Belief(np.zeros(1), np.array([[P]])), adaptive_ukf.Slope(np.zeros((1, 1)), np.zeros((1, 1, 1)))
    ahead, slope = adaptive_ukf.predict(Walk(), belief, none, None, 1.0, np.array([[q]]), np.ones((1, 1, 1)))
    found, slopes = adaptive_ukf.update(Walk(), ahead, slope, np.array([y]), np.array([[noise]]))
    S = P + q + noise
    assert pytest.approx(1.0) == slopes.S
    assert pytest.approx(noise / S**2) == slopes.K
    assert pytest.approx((noise / S) ** 2) == slopes.belief.P
    assert slopes.belief.x == pytest.approx(noise / S**2 * y)
    assert pytest.approx(S) == found.S


def test_printed_derivative_of_S_is_zero_for_a_linear_model():
    """E53: (17) as printed sums the mean's derivative against points centred on it, which is 0; the main term of the rule is lost."""
    ahead, slope, _, slopes, _ = run(np.array([2.0, 0.5]))
    X, mean, covariance = unscented.sigma_points(ahead, unscented.PAPER)
    G = X[:6] - (X[:6] @ mean)[:, None]  # the six of the motion are measured
    half = (covariance * -slope.x[0, :6, None]) @ G.T
    assert np.abs(half + half.T).max() < 1e-9 * np.abs(slopes.S[0]).max()


def test_root_slope_against_differences():
    """E54: the derivative of the Cholesky root, against differences of numpy's own; lower triangular."""
    rng = np.random.default_rng(3)
    A, B = rng.standard_normal((2, 5, 5)), rng.standard_normal((2, 3, 5, 5))
    P, dP = A @ A.swapaxes(-1, -2) + np.eye(5), B + B.swapaxes(-1, -2)
    found = adaptive_ukf.root_slope(np.linalg.cholesky(P), dP)
    h = 1e-6
    for k in range(3):
        ends = [np.linalg.cholesky(P + side * h * dP[:, k]) for side in (1, -1)]
        np.testing.assert_allclose(found[:, k], (ends[0] - ends[1]) / (2 * h), atol=1e-8)
    assert np.abs(np.triu(found, 1)).max() == 0


def test_filter_without_gain_is_the_plain_filter():
    """Law: eta = 0 is the plain filter with Q(q), in every mean and covariance; and the window keeps its length."""
    zs, taus = voyage()
    q, belief = np.array([2.0, 0.5]), BELIEF
    now = adaptive_ukf.begin(RULE, BELIEF, q, 6)
    for z, tau in zip(zs, taus, strict=True):
        now = adaptive_ukf.step(RULE, MODEL, now, tau, 0.1, z, R)
        belief = unscented.update(MODEL, unscented.predict(MODEL, belief, tau, 0.1, RULE.Q(q)), z, R).belief
    np.testing.assert_array_equal(now.belief.x, belief.x)
    np.testing.assert_array_equal(now.belief.P, belief.P)
    np.testing.assert_allclose(np.exp(now.log_q), q)
    assert len(now.innovations) == RULE.window


def test_criterion_by_hand():
    """Oracle: (14)-(17) written out for two rows and a window of three, one epoch of it with a missing row left out (E52)."""
    ys, S = np.array([[1.0, 2.0], [np.nan, 5.0], [3.0, -1.0]]), np.array([[2.0, 0.5], [0.5, 1.0]])
    dys, dS = np.array([[[0.1, 0.2]], [[9.0, 9.0]], [[0.3, -0.4]]]), np.array([[[0.7, 0.2], [0.2, 0.4]]])
    unit = np.array([2.0, 0.5])
    W = np.diag(1 / unit)
    off = W @ ((np.outer(ys[0], ys[0]) + np.outer(ys[2], ys[2])) / 2 - S) @ W
    change = sum(np.outer(dys[i, 0], ys[i]) + np.outer(ys[i], dys[i, 0]) for i in (0, 2)) / 2 - dS[0]
    V, dV = adaptive_ukf.criterion(ys, dys, S, dS, unit)
    assert pytest.approx(np.trace(off @ off)) == V
    assert dV == pytest.approx(np.trace((W @ change @ W) @ off + off @ (W @ change @ W)))


class Walk:
    """A scalar that wanders and is measured."""

    def transition(self, X, u, dt):
        return X

    def measure(self, X):
        return X


@pytest.mark.parametrize("start", [1e-3, 30.0])
def test_rule_comes_to_the_true_noise(start):
    """Statistic: a random walk of q = 1 measured with R = 0.04. From 1000 times too small and 30 times too large, the median of q over the
    last half lies within a factor of 1.5 of the truth, over 20 runs; a window of 50 knows a variance to 20 %.
    """
    rng = np.random.default_rng(9)
    rule = MitRule(np.zeros((1, 1)), np.ones((1, 1, 1)), np.array([1e-4]), np.array([1e3]), gain=2e-3, window=50)
    now = adaptive_ukf.begin(rule, Belief(np.zeros((20, 1)), np.ones((20, 1, 1))), start, 1)
    x, seen = np.zeros((20, 1)), []
    for _ in range(360):
        x = x + rng.standard_normal(x.shape)
        now = adaptive_ukf.step(
            rule, Walk(), now, None, 1.0, x + 0.2 * rng.standard_normal(x.shape), np.array([[0.04]])
        )
        seen.append(now.log_q[:, 0])
    assert abs(np.median(seen[180:])) < math.log(1.5)
    assert now.criterion.shape == (20,) and now.descent.shape == (20, 1)


def test_missing_rows_adapt_nothing():
    """Law: an epoch with a missing row updates the belief, keeps q, and is the plain update."""
    zs, taus = voyage()
    rule = replace(RULE, gain=0.1)
    now = adaptive_ukf.begin(rule, BELIEF, np.array([2.0, 0.5]), 6)
    for z, tau in zip(zs[:-1], taus[:-1], strict=True):
        now = adaptive_ukf.step(rule, MODEL, now, tau, 0.1, z, R)
    holed = zs[-1].copy()
    holed[5] = np.nan
    later = adaptive_ukf.step(rule, MODEL, now, taus[-1], 0.1, holed, R)
    whole = adaptive_ukf.step(rule, MODEL, now, taus[-1], 0.1, zs[-1], R)
    np.testing.assert_array_equal(later.log_q, now.log_q)
    assert not np.array_equal(whole.log_q, now.log_q)
    ahead = unscented.predict(MODEL, now.belief, taus[-1], 0.1, rule.Q(np.exp(now.log_q)))
    np.testing.assert_array_equal(later.belief.x, unscented.update(MODEL, ahead, holed, R).belief.x)
    assert np.isfinite(later.slope.P).all()


def test_q_stays_within_its_bounds():
    """Law: whatever the gain, q stays in bounds (E51), and one step changes log q by no more than `fastest`."""
    zs, taus = voyage()
    rule = replace(RULE, gain=1e6, fastest=0.5, window=3, least=np.array([0.5, 0.1]), most=np.array([3.0, 1.0]))
    now = adaptive_ukf.begin(rule, BELIEF, np.array([2.0, 0.5]), 6)
    for z, tau in zip(zs, taus, strict=True):
        later = adaptive_ukf.step(rule, MODEL, now, tau, 0.1, z, R)
        assert np.abs(later.log_q - now.log_q).max() <= 0.5 + 1e-12
        assert (np.exp(later.log_q) >= rule.least - 1e-12).all() and (np.exp(later.log_q) <= rule.most + 1e-12).all()
        now = later
    assert not np.allclose(np.exp(now.log_q), [2.0, 0.5])


def test_wrong_rules_are_told():
    """Bad input: one line each."""
    for change in (
        {"least": np.zeros(2)},
        {"directions": np.zeros((2, 6, 6))},
        {"window": 0},
        {"least": np.full(2, 1e4)},
    ):
        with pytest.raises(InputError, match="MitRule"):
            replace(RULE, **change)
    with pytest.raises(InputError, match="within least and most"):
        adaptive_ukf.begin(RULE, BELIEF, np.array([1e4, 1.0]), 6)
