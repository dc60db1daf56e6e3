"""Statistics of consistency: bounds as tabulated, power of the tests, condition by numpy, the joint S by the sequential filter."""

from dataclasses import replace

import numpy as np
import pytest

from aspnn.estimation.cascade import run_cascade
from aspnn.estimation.consistency import (
    CONDITION,
    NORMAL,
    autocorrelation,
    average_bounds,
    innovation_covariance,
    lag_bound,
    lag_one,
    mean_error,
    nees,
    scaled_rcond,
    shares,
)
from aspnn.estimation.sensors import conditions, sensors, summarise

THESIS_R = np.diag([1, 1, np.radians(0.5), np.radians(0.001), 0.01, 0.01]) ** 2  # Paper II, table 3


@pytest.fixture(scope="module")
def cascade(voyage):
    return run_cascade(voyage[0])


def inside(values, bound):
    return float(np.mean(np.abs(values) <= bound))


@pytest.mark.parametrize(
    "dof, runs, low, high", [(6, 50, 5.078, 6.997), (2, 1, 0.0506, 7.3778), (3, 1, 0.2158, 9.3484)]
)
def test_bounds_as_tabulated(dof, runs, low, high):
    """Oracle: the quantiles of errata E29 (50 runs of 6) and E32 (single runs of 2 and 3), to their last digit."""
    np.testing.assert_allclose(average_bounds(dof, runs), (low, high), atol=6e-4 if runs > 1 else 6e-5)


def test_bounds_follow_the_degrees_of_freedom_of_each_epoch():
    """Law: an epoch with a missing row has the bounds of what is left, one with none has no bounds."""
    low, high = average_bounds(np.array([2, 1, 0, 2]), 10)
    assert (low[0], high[0]) == (low[3], high[3]) == tuple(float(b) for b in average_bounds(2, 10))
    assert high[1] == float(average_bounds(1, 10)[1]) and np.isnan([low[2], high[2]]).all()


def test_shares_count_what_is_there():
    """By hand, and E32: two degrees of freedom against the bounds of three are 88.8 % inside and 10.2 % below."""
    found = shares([0.1, 1, 9, np.nan, 1], 0.5, [2, 2, 2, 2, np.nan])
    assert (found.inside, found.below, found.above) == pytest.approx((1 / 3, 1 / 3, 1 / 3)) and found.count == 3
    wrong = shares(np.random.default_rng(0).chisquare(2, 200_000), *average_bounds(3))
    assert (wrong.inside, wrong.below) == pytest.approx((0.888, 0.102), abs=0.003)  # four standard errors
    assert shares([np.nan], 0, 1).count == 0


def test_white_innovations_are_inside_and_the_printed_factor_lets_everything_pass():
    """Statistic, E30: N = 50, m = 6, 5000 epochs; sqrt(m) gives a deviation of 1/sqrt(N), 1/sqrt(m) one of 0.167/sqrt(N)."""
    white = np.random.default_rng(1).normal(size=(50, 5001, 6))
    rho, bound = lag_one(white), lag_bound(50)
    assert bound == pytest.approx(1.96 / np.sqrt(50), abs=1e-4)
    assert np.std(rho) * np.sqrt(50) == pytest.approx(1.0, abs=0.04)  # 1/sqrt(2 n) = 0.01
    assert inside(rho, bound) == pytest.approx(0.95, abs=0.013)  # four standard errors
    assert np.std(rho / 6) * np.sqrt(50) == pytest.approx(0.167, abs=0.007) and inside(rho / 6, bound) == 1.0


def test_raw_units_are_no_test():
    """Statistic, E30: with sqrt(m) but innovations in metres and radians only 75 % of white noise is inside."""
    raw = np.random.default_rng(2).normal(size=(50, 5001, 6)) * np.sqrt(np.diag(THESIS_R))
    assert inside(lag_one(raw), lag_bound(50)) == pytest.approx(0.75, abs=0.03)


def test_coloured_innovations_are_found():
    """Analytic: first-order colour of 0.5 has the average 0.5 sqrt(6), 4.4 bounds off; by the printed factor it passes."""
    rng = np.random.default_rng(3)
    y = rng.normal(size=(50, 1001, 6))
    for k in range(1, 1001):
        y[:, k] = 0.5 * y[:, k - 1] + np.sqrt(0.75) * y[:, k]
    rho = lag_one(y)
    assert np.mean(rho) == pytest.approx(0.5 * np.sqrt(6), abs=0.02) and inside(rho, lag_bound(50)) == 0.0
    assert inside(rho / 6, lag_bound(50)) > 0.9


def test_missing_values_keep_the_level():
    """Statistic: 40 % of the components missing at random, and a white sequence is still inside 95 % of the time."""
    rng = np.random.default_rng(4)
    y = rng.normal(size=(50, 5001, 4))
    y[rng.random(y.shape) < 0.4] = np.nan
    y[:, 100] = np.nan
    rho = lag_one(y)
    assert np.isnan(rho[99:101]).all() and np.isfinite(rho).sum() == 4998
    assert inside(rho[np.isfinite(rho)], lag_bound(50)) == pytest.approx(0.95, abs=0.013)


def test_autocorrelation_of_one_run():
    """Analytic: phi^lag for a first-order sequence, whatever its size; white noise inside its bound, gaps passed over."""
    rng = np.random.default_rng(5)
    noise = rng.normal(size=(40_000, 2))
    noise[1:, 1] *= np.sqrt(1 - 0.8**2)
    for k in range(1, len(noise)):
        noise[k, 1] += 0.8 * noise[k - 1, 1]
    found = autocorrelation(7.0 * noise, 30)
    np.testing.assert_allclose(found[:, 1], 0.8 ** np.arange(1, 31), atol=0.06)
    assert inside(found[:, 0], lag_bound(40_000)) >= 0.8
    noise[rng.random(noise.shape) < 0.3] = np.nan
    np.testing.assert_allclose(autocorrelation(noise, 5)[:, 1], 0.8 ** np.arange(1, 6), atol=0.06)
    assert np.isnan(autocorrelation(np.ones((3, 1)), 4)[2:]).all()


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_standard_error_of_the_mean_of_a_coloured_sequence(phi):
    """Statistic: mean over its standard error has deviation 1 over 400 sequences (sd 0.035; Bartlett's weights cost 8 %)."""
    rng = np.random.default_rng(6)
    y = rng.normal(size=(2000, 400))
    for k in range(1, 2000):
        y[k] = phi * y[k - 1] + np.sqrt(1 - phi**2) * y[k]
    mean, error = mean_error(y)
    assert np.std(mean / error) == pytest.approx(1.0, abs=0.2)
    assert np.sqrt(2000) * np.mean(error) == pytest.approx(np.sqrt((1 + phi) / (1 - phi)), rel=0.2)


def test_nees_is_a_chi_square():
    """Oracle: numpy's inverse; the mean of 20 000 is d; a matrix that is no covariance gives NaN."""
    rng = np.random.default_rng(7)
    A = rng.normal(size=(20_000, 4, 4))
    P = A @ np.swapaxes(A, 1, 2) + 0.5 * np.eye(4)
    error = (np.linalg.cholesky(P) @ rng.normal(size=(20_000, 4, 1)))[..., 0]
    found = nees(error, P)
    np.testing.assert_allclose(found, np.einsum("ni,nij,nj->n", error, np.linalg.inv(P), error), rtol=1e-6)
    assert np.mean(found) == pytest.approx(4.0, abs=0.08)  # four standard errors
    assert shares(found, *average_bounds(4)).inside == pytest.approx(0.95, abs=0.006)
    P[3] = -P[3]
    assert np.isnan(nees(error, P)[3]) and nees(error[0], P[0]).shape == ()
    runs = nees(error[4:].reshape(4, 4999, 4), P[4:].reshape(4, 4999, 4, 4))
    np.testing.assert_array_equal(runs.ravel(), found[4:])


@pytest.mark.parametrize("size", [1, 2, 6, 8])
def test_scaled_condition(size):
    """Oracle: numpy.linalg.cond in the 1-norm of the scaled matrix; units do not matter, broken matrices give 0."""
    rng = np.random.default_rng(size)
    A = rng.normal(size=(3, 40, size, size))
    S = A @ np.swapaxes(A, -1, -2) + 1e-3 * np.eye(size)
    D = np.sqrt(np.einsum("...ii->...i", S))
    expected = 1 / np.linalg.cond(S / (D[..., :, None] * D[..., None, :]), 1)
    found = scaled_rcond(S)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    units = 10.0 ** rng.uniform(-6, 6, size)
    np.testing.assert_allclose(scaled_rcond(S * units[:, None] * units), found, rtol=1e-6)
    S[0, 0], S[0, 1, 0, 0], S[0, 2, -1, -1], S[0, 3] = -S[0, 0], np.nan, np.inf, 0.0
    assert (scaled_rcond(S)[0, :4] == 0).all() and (scaled_rcond(S)[0, 4:] > 0).all()
    assert scaled_rcond(S[1, 0]).shape == ()


def test_the_sensors_of_the_thesis_are_well_conditioned():
    """E31: the R of Paper II alone has a condition of 3e-10 in raw units, 1 when scaled; repeated rows are found."""
    assert 1 / np.linalg.cond(THESIS_R, 1) == pytest.approx(3.05e-10, rel=0.01)
    assert scaled_rcond(THESIS_R) == 1.0
    assert scaled_rcond(np.array([[1.0, 1 - 1e-10], [1 - 1e-10, 1.0]])) == pytest.approx(5e-11, rel=1e-3)


def test_joint_covariance_agrees_with_the_blocks_in_turn(voyage):
    """Law: e' S^-1 e of all rows of an epoch is the sum of the NIS of its blocks, each given those before it; also with gaps."""
    table = voyage[0].table.copy()
    table.loc[table.index % 3 > 0, ["bow_latitude_deg", "bow_longitude_deg"]] = np.nan
    table.loc[table.index % 7 == 0, "yaw_rate_deg_s"] = np.nan
    c = run_cascade(replace(voyage[0], table=table))
    for problem, run in ((c.turn, c.turning), (c.motion, c.moving)):
        n, blocks, _, d = problem.H.shape
        rows = (run.fate != 2).all(axis=1) & (np.arange(n) > 100)
        error = problem.z.reshape(n, -1) - (problem.H.reshape(n, -1, d) @ run.predicted[:, :, None])[..., 0]
        if problem.angle.any():
            error[:, 0] = (error[:, 0] + np.pi) % (2 * np.pi) - np.pi
        S = innovation_covariance(problem, run)
        joint = nees(np.nan_to_num(error), S)
        np.testing.assert_allclose(joint[rows], np.nansum(run.nis, axis=1)[rows], rtol=1e-6)
        assert rows.sum() > 0.9 * n and S.shape == (n, 2 * blocks, 2 * blocks)
        missing = np.isnan(problem.z).reshape(n, -1)
        np.testing.assert_array_equal(S[missing], np.broadcast_to(np.eye(2 * blocks), S.shape)[missing])


def test_summary_of_a_sound_log(cascade):
    """Statistic: a simulated log with the sensors the filter expects; NIS per freedom 1 within 4 %, 94-96 % inside, white, no bias."""
    found = summarise(cascade, 60.0)
    assert [s.sensor for s in found] == ["heading", "yaw_rate", "bow", "stern", "acceleration"]
    assert [s.dof for s in found] == [1, 1, 2, 2, 2]
    for s in found:
        assert s.mean_nis == pytest.approx(1.0, abs=0.04) and s.mean_low < 1 < s.mean_high
        assert 0.94 < s.shares.inside < 0.96, s.sensor
        assert abs(s.autocorrelation) < 2 * s.bound and abs(s.bias) < 4 and abs(s.lateness) < 0.1
        assert s.n == 8401 and s.rejected < 0.004 and s.stale == 0 and s.coasting < 0.5 and s.rcond > 0.9
    assert summarise(cascade)[0].n == 9001
    assert found[0].bound == pytest.approx(NORMAL / np.sqrt(8400), rel=0.01)


def test_summary_knows_rates_gaps_and_frozen_fixes(voyage):
    """By hand: fixes at 2 Hz with 20 s missing and 8 s frozen; successive values follow each other whatever lies between."""
    table = voyage[0].table.copy()
    fixes = [name for name in table if "itude_deg" in name]
    table.loc[table.index % 5 > 0, fixes] = np.nan
    table.loc[3000:3199, fixes] = np.nan
    table.loc[5005:5084, fixes] = table.loc[5000, fixes].to_numpy()
    table = table.drop(columns=[name for name in table if "acceleration" in name])
    found = {s.sensor: s for s in summarise(run_cascade(replace(voyage[0], table=table)))}
    assert "acceleration" not in found and found["bow"].n == 1801 - 40 - 16
    assert found["bow"].coasting == pytest.approx(20.5) and found["heading"].coasting < 0.5
    assert found["bow"].stale == pytest.approx(80 / (80 + found["bow"].n))
    assert found["bow"].bound == pytest.approx(NORMAL / np.sqrt(2 * found["bow"].n), rel=0.03)


@pytest.mark.parametrize("rows", [0, 30, 80])
def test_a_late_yaw_rate_is_told(voyage, rows):
    """Oracle: a yaw rate moved by a known time; found against the turn of the heading within 3 standard errors, which are small."""
    table = voyage[0].table.copy()
    table["yaw_rate_deg_s"] = table["yaw_rate_deg_s"].shift(rows, fill_value=0.0)
    found = {s.sensor: s.late for s in summarise(run_cascade(replace(voyage[0], table=table)), 60.0)}
    late, error = found["yaw_rate"]
    assert error < 0.1 and abs(late - rows / 10) < 3 * error + 0.02
    assert np.isnan(found["heading"][0]) and np.isinf(found["bow"][1])


def test_rejected_values_are_told_and_left_out_of_the_mean(voyage, cascade):
    """By hand: every 50th fix of the stern 60 m off; 2 % rejected, above their bounds, the mean NIS as before."""
    table = voyage[0].table.copy()
    table.loc[table.index % 50 == 0, "stern_latitude_deg"] += 60 / 111e3
    log = run_cascade(replace(voyage[0], table=table))
    before, found = ({s.sensor: s for s in summarise(c, 60.0)}["stern"] for c in (cascade, log))
    assert found.rejected == pytest.approx(before.rejected + 0.02, abs=0.002)
    assert found.shares.above == pytest.approx(before.shares.above + 0.02, abs=0.003)
    assert found.mean_nis == pytest.approx(before.mean_nis, abs=0.03)
    stern = next(s for s in sensors(log) if s.name == "stern")
    assert np.isnan(stern.whitened[stern.rejected]).all() and np.isfinite(stern.nis[stern.rejected]).all()


def test_the_joint_covariance_is_never_singular(cascade):
    """Law, E31: above the threshold at every epoch, the wide start included, and near 1 once the filter has settled."""
    found = conditions(cascade)
    assert set(found) == {"heading", "yaw_rate", "bow", "stern", "acceleration"}
    for values in found.values():
        assert values.min() > CONDITION and values[600:].min() > 0.9
