"""Adaptive process noise (Paper IV): the curve of the factor, how its training pairs are made, and what it may know."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from aspnn.estimation.adaptive import QFactor, adapted, best_factors, group_of, training_pairs
from aspnn.estimation.compiled import run
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import from_log
from aspnn.estimation.models import Ctra
from aspnn.estimation.nonlinear import model_problem
from aspnn.schema import InputError

PRINTED = (0.0023, 8.7554, 0.7914)  # Paper IV: "optimal theta"


def groups_of_figure_9():
    """A hundred pairs as figures 8 to 10 show them: four groups of |y_r| up to 0.03, alpha from 1.5 to 10.7."""
    rng = np.random.default_rng(8)
    spans, means, sizes = (
        ((0, 0.004), (0.004, 0.009), (0.009, 0.017), (0.017, 0.03)),
        (1.5, 4.5, 8, 10.7),
        (22, 22, 25, 31),
    )
    x = np.concatenate([rng.uniform(*span, n) for span, n in zip(spans, sizes, strict=True)])
    y = np.concatenate([mean + 0.3 * rng.standard_normal(n) for mean, n in zip(means, sizes, strict=True)])
    return x, y


def posterior_mean(theta, x, y, at):
    """Paper IV (8) and (9), written out: k_*' K^-1 y."""
    amplitude, square_length, noise = theta

    def kernel(a, b):
        return amplitude * np.exp(-((a[:, None] - b) ** 2) / (2 * square_length))

    return kernel(at, x) @ np.linalg.solve(kernel(x, x) + noise * np.eye(len(x)), y)


def most_likely(x, y):
    """Theta that makes Paper IV (11) greatest."""

    def cost(log_theta):
        amplitude, square_length, noise = np.exp(log_theta)
        K = amplitude * np.exp(-((x[:, None] - x) ** 2) / (2 * square_length)) + noise * np.eye(len(x))
        return np.linalg.slogdet(K)[1] + y @ np.linalg.solve(K, y)

    start = np.log([np.mean(y**2), 0.004**2, 0.1])
    found = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-6, "maxiter": 2000})
    return np.exp(found.x)


def test_printed_hyperparameters_are_out_of_order():
    """Published (E37): theta as printed predicts a constant of about 1.45 = theta_1 sum y / (theta_3 + N theta_1); as (length^2,
    amplitude, noise) it predicts the graded 1.5 to 10.7 of figure 10, and 0 far from the data.
    """
    x, y = groups_of_figure_9()
    at = np.linspace(0, 0.03, 300)
    constant = posterior_mean(PRINTED, x, y, at)
    assert np.ptp(constant) < 0.01
    assert constant.mean() == pytest.approx(PRINTED[0] * y.sum() / (PRINTED[2] + len(x) * PRINTED[0]), abs=0.01)
    assert constant.mean() == pytest.approx(1.45, abs=0.1)
    swapped = (PRINTED[1], PRINTED[0], PRINTED[2])
    graded = posterior_mean(swapped, x, y, at)
    assert graded.min() < 2.5
    assert graded.max() > 9.5
    assert abs(posterior_mean(swapped, x, y, np.array([0.4]))[0]) < 1e-6


def test_curve_follows_the_groups_and_stays_above_one():
    """Oracle: Paper IV (8), (9) and (11) written out on alpha - 1, theta by scipy; beyond the data the last value (E37)."""
    x, y = groups_of_figure_9()
    curve = QFactor.fit(x, np.maximum(y, 1.0), seed=1)
    at = np.linspace(0.001, 0.029, 50)
    by_hand = 1 + posterior_mean(most_likely(x, np.maximum(y, 1.0) - 1), x, np.maximum(y, 1.0) - 1, at)
    np.testing.assert_allclose(curve.factors(at), by_hand, rtol=0, atol=0.01)
    np.testing.assert_array_equal(curve.factors([0.4, -0.4]), np.full(2, curve.factor[-1]))
    assert curve.factor[-1] > 9
    assert curve.factor.min() >= 1
    assert curve.factor.max() <= y.max()
    np.testing.assert_array_equal(curve.factors([np.nan]), [1.0])
    np.testing.assert_array_equal(QFactor.fit(x, np.maximum(y, 1.0), seed=1).factor, curve.factor)


def test_nothing_to_gain_is_a_factor_of_one():
    """By hand: where one is best everywhere the curve is one everywhere, also outside the data."""
    curve = QFactor.fit([0.5, 1.0, 4.0], [1.0, 1.0, 1.0], seed=0)
    np.testing.assert_array_equal(curve.factors([0.0, 2.0, 99.0]), np.ones(3))


def test_a_step_does_not_ring_below_one():
    """Law (E37): a Gaussian process rings beside a step from 1 to 50; the factor keeps within 1 and the largest given."""
    x = np.concatenate([np.linspace(0, 2.2, 40), np.linspace(2.4, 3.4, 40)])
    y = np.where(x < 2.3, 1.0, 50 + 5 * np.sin(37 * x))
    factor = QFactor.fit(x, y, seed=0).factor
    assert factor.min() == 1.0
    assert (factor == 1.0).sum() > 10  # it does ring, and is cut
    assert factor.max() <= y.max()


@pytest.mark.parametrize(
    "levels, factors", [([1.0], [2.0]), ([1.0, 2.0], [2.0]), ([1.0, np.nan], [2.0, 3.0]), ([1.0, 2.0], [0.5, 1.0])]
)
def test_wrong_pairs_are_one_line(levels, factors):
    """Contract: InputError, one line."""
    with pytest.raises(InputError, match="QFactor") as error:
        QFactor.fit(levels, factors, seed=0)
    assert "\n" not in str(error.value)


def test_best_factors_of_a_known_cost():
    """Analytic: a cost whose least is known by group is found, and a group that no epoch belongs to stays at one."""
    levels = [np.array([0.1, 0.5, 1.0, np.nan]), np.array([2.5, 0.2, 1.2])]
    edges, wanted = (1.0, 2.0, 9.0), np.array([1.0, 3.0, 8.0, 1.0])
    np.testing.assert_array_equal(group_of(levels[0], edges), [0, 0, 1, 0])

    def cost(factors):
        return sum(
            float(np.sum(np.log(f / wanted[group_of(x, edges)]) ** 2)) for f, x in zip(factors, levels, strict=True)
        )

    np.testing.assert_array_equal(best_factors(levels, edges, (1.0, 2.0, 3.0, 5.0, 8.0), cost), wanted)


def test_training_pairs_are_drawn_from_the_groups():
    """Law: every level is one of the log, its factor that of its group within the noise; wide groups give more; a seed repeats."""
    level = np.abs(np.random.default_rng(3).standard_normal(20000)) * 2
    edges, best = (1.0, 2.0, 4.0), (1.0, 2.0, 5.0, 10.0)
    x, alpha = training_pairs([level[:9000], level[9000:]], edges, best, count=200, spread=0.05, seed=5)
    assert np.isin(x, level).all()
    group = group_of(x, edges)
    counts = np.bincount(group, minlength=4)
    assert counts.sum() == pytest.approx(200, abs=3)
    assert counts[3] > counts[0] >= 25
    assert alpha.min() >= 1
    np.testing.assert_allclose(alpha, np.array(best)[group], rtol=0.05 * 5)
    assert np.std((alpha / np.array(best)[group])[group > 0]) == pytest.approx(0.05, rel=0.3)
    np.testing.assert_array_equal(training_pairs([level], edges, best, 200, 0.05, 5)[0], x)


def test_adapted_is_more_noise_of_the_step_that_ends_there(voyage):
    """Law: linear and model problems alike: at the epoch of the factor the predicted covariance grows by (alpha - 1) Q, not before."""
    log, _ = voyage
    log = replace(log, table=log.table.iloc[:600].reset_index(drop=True))
    m, vessel = from_log(log), log.vessel
    size = vessel.service_speed, vessel.length
    turning = run(heading_problem(m, vessel.noise, *size))
    given = turning.mean, turning.covariance
    factors = np.ones(len(m.time))
    factors[400] = 50.0
    for problem in (
        motion_problem(m, vessel.noise, *given, *size),
        model_problem(m, vessel.noise, Ctra.of(vessel.noise, given=True), *size, given),
    ):
        plain, more = run(problem), run(adapted(problem, factors))
        np.testing.assert_array_equal(more.mean[:400], plain.mean[:400])
        np.testing.assert_array_equal(more.predicted[400], plain.predicted[400])
        grown = (more.predicted_covariance - plain.predicted_covariance)[400]
        assert grown[4, 4] == pytest.approx(49 * vessel.noise.jerk_density * 0.1, rel=1e-6)
        assert np.abs(more.mean[400] - plain.mean[400]).max() > 0


def test_factor_uses_no_later_innovation(voyage):
    """Law: what happens to the gyro after an epoch changes no factor up to it."""
    log, _ = voyage
    m, vessel = from_log(log), log.vessel
    curve = QFactor(np.array([1.0, 3.0]), np.array([1.0, 20.0]))
    gyro = m.yaw_rate.copy()
    gyro[5000:] += 0.01
    factors = []
    for rate in (m.yaw_rate, gyro):
        p = heading_problem(replace(m, yaw_rate=rate), vessel.noise, vessel.service_speed, vessel.length)
        factors.append(curve.factors(run(p).whitened[:, 1, 0]))
    np.testing.assert_array_equal(factors[0][:5000], factors[1][:5000])
    assert factors[1][5000] == 20.0


def test_using_a_curve_needs_no_scikit_learn():
    """sys.modules of a fresh interpreter: only the fit imports scikit-learn."""
    code = (
        "import sys, numpy as np; from aspnn.estimation.adaptive import QFactor;"
        "QFactor(np.array([0.0, 1.0]), np.array([1.0, 2.0])).factors(np.zeros(3)); print('sklearn' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "False\n"
