"""The two engines against each other, against batch least squares, and against the statistics of matched noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from aspnn.estimation import compiled, reference
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import from_log
from aspnn.estimation.problem import MISSING, REACQUIRED, REJECTED, USED


def both_problems(log):
    m, vessel = from_log(log), log.vessel
    size = vessel.service_speed, vessel.length
    first = heading_problem(m, vessel.noise, *size)
    run = compiled.run(first)
    return first, motion_problem(m, vessel.noise, run.mean, run.covariance, *size)


def dirty(log):
    """The log with a gap, sensors missing for a while or at a lower rate, single sensors gone, outliers and a lasting jump."""
    t = log.table.iloc[:6000].copy()
    bow, stern = ([c for c in t if c.startswith(name)] for name in ("bow", "stern"))
    t.loc[1000:1100, bow + stern] = np.nan
    t.loc[1500:1520, bow[0]] += 60 / 111e3
    t.loc[2000:2200, stern] = np.nan
    t.loc[2600:2700, "yaw_rate_deg_s"] = np.nan
    t.loc[2900:3000, "acceleration_surge_m_s2"] = np.nan
    t.loc[3100:3150, "heading_deg"] += 40
    t.loc[3500:, [bow[0], stern[0]]] += 100 / 111e3
    t.loc[t.index % 3 > 0, "heading_deg"] = np.nan
    t.loc[t.index % 10 > 0, stern] = np.nan
    return replace(log, table=t.drop(index=range(4500, 4700)).reset_index(drop=True))


def drawn(problem, rng):
    """The problem with states and measurements drawn from its own probabilities."""
    n, d = len(problem.time), len(problem.x0)

    def normal(P):
        scale = np.sqrt(np.maximum(np.diag(P), 1e-300))
        values, vectors = np.linalg.eigh(P / np.outer(scale, scale))
        return scale * (vectors @ (np.sqrt(np.maximum(values, 0)) * rng.standard_normal(len(P))))

    x, z, truth = problem.x0 + normal(problem.P0), np.full_like(problem.z, np.nan), np.empty((n, d))
    for k in range(n):
        x = problem.F[k] @ x + normal(problem.Q[k])
        truth[k] = x
        for b in range(problem.z.shape[1]):
            z[k, b] = problem.H[k, b] @ x + normal(problem.R[k, b])
    return replace(problem, z=np.where(np.isnan(problem.z), np.nan, z)), truth


def test_compiled_equals_filterpy(voyage):
    """Oracle: filterpy's KalmanFilter on gaps, missing sensors, outliers and a jump; to 1e-9 of each standard deviation."""
    fates = set()
    for problem in both_problems(dirty(voyage[0])):
        fast, plain = compiled.run(problem), reference.run(problem)
        sd = np.sqrt(np.diagonal(plain.covariance, axis1=1, axis2=2))
        np.testing.assert_array_less(np.abs(fast.mean - plain.mean) / sd, 1e-9)
        apart = np.abs(fast.covariance - plain.covariance) / (sd[:, :, None] * sd[:, None])
        np.testing.assert_array_less(apart, 1e-9)
        np.testing.assert_array_equal(fast.fate, plain.fate)
        np.testing.assert_allclose(fast.nis, plain.nis, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(fast.whitened, plain.whitened, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(fast.predicted, plain.predicted, rtol=1e-9, atol=1e-9)
        assert fast.log_likelihood == pytest.approx(plain.log_likelihood, rel=1e-9)
        fates |= set(fast.fate.ravel())
    assert fates == {MISSING, USED, REJECTED, REACQUIRED}  # the log has driven every branch


def test_smoother_equals_filterpy(voyage):
    """Oracle: filterpy's rts_smoother, to 1e-6 of each smoothed standard deviation (it inverts P where ours solves)."""
    log = replace(voyage[0], table=voyage[0].table.iloc[:1500])
    for problem in both_problems(log):
        run = compiled.run(problem)
        fast, plain = compiled.smooth(problem, run), reference.smooth(problem, run)
        sd = np.sqrt(np.diagonal(fast[1], axis1=1, axis2=2))
        np.testing.assert_array_less(np.abs(fast[0] - plain[0]) / sd, 1e-6)
        np.testing.assert_array_less(np.abs(fast[1] - plain[1]) / (sd[:, :, None] * sd[:, None]), 1e-6)


def test_smoother_equals_batch_least_squares(voyage):
    """Oracle: all states of a short log at once, as one weighted least-squares problem solved densely."""
    _, problem = both_problems(replace(voyage[0], table=voyage[0].table.iloc[::20].head(12).reset_index(drop=True)))
    problem = replace(problem, F=problem.F[1:], Q=problem.Q[1:], time=problem.time[1:], H=problem.H[1:])
    problem = replace(problem, z=problem.z[1:], R=problem.R[1:], gates=np.full((3, 2), np.inf))
    problem, _ = drawn(problem, np.random.default_rng(5))
    n, d = len(problem.time), 6
    information, weighted = np.zeros((n * d, n * d)), np.zeros(n * d)

    def add(columns, J, value, covariance):
        W = np.linalg.inv(covariance)
        information[np.ix_(columns, columns)] += J.T @ W @ J
        weighted[columns] += J.T @ W @ value

    for k in range(n):
        own = np.arange(k * d, (k + 1) * d)
        F, Q = problem.F[k], problem.Q[k]
        if k == 0:
            add(own, np.eye(d), F @ problem.x0, F @ problem.P0 @ F.T + Q)
        else:
            add(np.concatenate([own - d, own]), np.hstack([-F, np.eye(d)]), np.zeros(d), Q)
        for b in range(3):
            add(own, problem.H[k, b], problem.z[k, b], problem.R[k, b])
    scale = 1 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    mean = (covariance @ weighted).reshape(n, d)
    run = compiled.run(problem)
    smoothed, P = compiled.smooth(problem, run)
    sd = np.sqrt(np.diag(covariance)).reshape(n, d)
    np.testing.assert_allclose((smoothed - mean) / sd, 0, atol=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diagonal(P, axis1=1, axis2=2)) / sd, 1, atol=1e-5)
    np.testing.assert_allclose((run.mean[-1] - mean[-1]) / sd[-1], 0, atol=1e-5)  # the filter's last is the smoother's


def test_innovations_of_matched_noise_are_chi_square(voyage):
    """Statistic: N times the mean NIS is chi-square with N m degrees of freedom (E29); 99.9 % interval per block.

    Data drawn from the problems themselves, so heading and yaw rate of CTRA are known and only the filter is tested. The
    errors of the states are held to their covariance alike, at instants far enough apart to be independent.
    """
    rng = np.random.default_rng(11)
    for problem in both_problems(replace(voyage[0], table=voyage[0].table.iloc[:6000])):
        problem = replace(problem, gates=np.full_like(problem.gates, np.inf), angle=np.zeros(len(problem.angle), bool))
        problem, truth = drawn(problem, rng)
        run = compiled.run(problem)
        for b in range(problem.z.shape[1]):
            rows = np.isfinite(problem.z[:, b]).sum(axis=1)
            low, high = chi2.ppf([0.0005, 0.9995], rows.sum()) / len(rows)
            assert low < run.nis[:, b].mean() < high
        error = (run.mean - truth)[::500]
        P = run.covariance[::500]
        scale = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
        whole = np.einsum(
            "ni,ni->n",
            error / scale,
            np.linalg.solve(P / (scale[:, :, None] * scale[:, None]), (error / scale)[..., None])[..., 0],
        )
        low, high = chi2.ppf([0.0005, 0.9995], error.size)
        assert low < whole.sum() < high


def test_heading_innovations_pass_north(voyage):
    """Law: turning the whole circle changes nothing but the heading itself (E28: the innovation is the smallest angle)."""
    log = voyage[0]
    turned = replace(log, table=log.table.assign(heading_deg=(log.table["heading_deg"] + 37.0) % 360))
    one, other = (compiled.run(both_problems(x)[0]) for x in (log, turned))
    offset = other.mean[:, 0] - one.mean[:, 0]
    np.testing.assert_allclose((offset - np.radians(37) + np.pi) % (2 * np.pi) - np.pi, 0, atol=1e-9)
    np.testing.assert_allclose(one.mean[:, 1:], other.mean[:, 1:], atol=1e-12)
    assert np.ptp(log.table["heading_deg"]) > 300  # the log does pass north
    assert np.abs(np.diff(one.mean[:, 0])).max() < 0.1  # and the heading runs on through it
