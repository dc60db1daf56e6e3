"""EKF and UKF of CMM and CTRA: the two engines against each other, laws of the filters, and the truth of a voyage."""

from dataclasses import replace

import numpy as np
import pytest

from aspnn.estimation import compiled, reference
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.kernels import HEADING, YAW_RATE
from aspnn.estimation.measurements import from_log
from aspnn.estimation.models import ONE_STEP, THESIS_SCHEME, Caa, Cmm, Ctra, Sigma
from aspnn.estimation.nonlinear import from_antenna, model_problem, two_point_start
from aspnn.estimation.problem import DOUBTED, OPEN, REACQUIRED, REJECTED, ModelProblem, Outliers
from aspnn.instruments import Calibration, Noise
from aspnn.schema import InputError

SETTLED = 600


@pytest.fixture(scope="module")
def measured(voyage):
    """Measurements, noise, size of the ship, and what CAA makes of the voyage."""
    log = voyage[0]
    m, size = from_log(log), (log.vessel.service_speed, log.vessel.length)
    run = compiled.run(heading_problem(m, log.vessel.noise, *size))
    return m, log.vessel.noise, size, (run.mean, run.covariance)


def caa_problem(m, noise, size, sigma=None):
    """CAA as a MotionModel, beside the exact problem of the same measurements."""
    exact = heading_problem(m, noise, *size)
    return exact, ModelProblem(
        time=m.time,
        x0=exact.x0,
        P0=exact.P0,
        model=Caa.of(noise),
        given=np.zeros((len(m.time), 3)),
        sensors=np.array([HEADING, YAW_RATE]),
        stations=np.zeros((2, 2)),
        inflation=np.ones(len(m.time)),
        z=exact.z,
        R=exact.R,
        angle=exact.angle,
        gates=exact.gates,
        group=exact.group,
        place=exact.place,
        rate=exact.rate,
        sigma=sigma,
    )


def problem_of(measured, name, sigma, scheme=ONE_STEP):
    m, noise, size, turning = measured
    if name == "CAA":
        problem = caa_problem(m, noise, size, sigma)[1]
        return replace(problem, P0=problem.P0 / 100)  # from a wider start filterpy's P - K S K' loses a tenth digit
    model = {"CTRA": Ctra, "CMM": Cmm}[name[:4].strip()].of(noise, given=name.endswith("6"))
    return model_problem(m, noise, model, *size, turning, scheme, sigma)


def cut(problem, n):
    """The first n epochs."""
    return replace(
        problem,
        time=problem.time[:n],
        given=problem.given[:n],
        inflation=problem.inflation[:n],
        z=problem.z[:n],
        R=problem.R[:n],
    )


def dirtied(problem, n):
    """The first n epochs with gaps, sensors missing, outliers, a lasting jump, an uneven clock and noise that changes."""
    p = cut(problem, n)
    z, rng = p.z.copy(), np.random.default_rng(4)
    z[30:60, rng.integers(0, z.shape[1])] = np.nan
    z[80:85, -1, 0] = np.nan
    z[100:140, 0, 0] += 0.3  # rad, or m
    z[150, -1] += 5.0
    if len(p.x0) > 3:
        positions = p.sensors == 0
        z[160:165, positions] += 40.0
        z[180:, positions] += 300.0
    time = p.time + np.where(np.arange(n) >= 120, 2.3, 0.0)
    return replace(p, z=z, time=time, inflation=1.0 + (np.arange(n) % 7 == 0))


def apart(one, two):
    """Largest differences of means and covariances, in standard deviations."""
    sd = np.sqrt(np.diagonal(two[1], axis1=1, axis2=2))
    return np.max(np.abs(one[0] - two[0]) / sd), np.max(np.abs(one[1] - two[1]) / (sd[:, :, None] * sd[:, None]))


@pytest.mark.parametrize("sigma", [None, Sigma()], ids=["EKF", "UKF"])
@pytest.mark.parametrize("name", ["CAA", "CTRA 6", "CTRA 8", "CMM 6", "CMM 8"])
def test_compiled_equals_filterpy(measured, name, sigma):
    """Oracle: filterpy's extended and unscented filters on dirty measurements; to 1e-9 of each standard deviation."""
    for problem in (
        dirtied(problem_of(measured, name, sigma), 230),
        replace(cut(dirtied(problem_of(measured, name, sigma), 230), 120), outliers=Outliers(1000.0, 2.0, spread=True)),
        cut(problem_of(measured, name, sigma, THESIS_SCHEME), 12),
    ):
        fast, plain = compiled.run(problem, crossing=True), reference.run(problem)
        assert max(apart((fast.mean, fast.covariance), (plain.mean, plain.covariance))) < 1e-9
        np.testing.assert_array_equal(fast.fate, plain.fate)
        for what in ("nis", "whitened", "innovation"):
            np.testing.assert_allclose(getattr(fast, what), getattr(plain, what), rtol=1e-6, atol=1e-8)
        assert fast.log_likelihood == pytest.approx(plain.log_likelihood, rel=1e-9)
        assert max(apart(compiled.smooth(problem, fast), reference.smooth(problem, plain))) < 1e-6


def test_every_fate_was_driven(measured):
    """Law: the dirty measurements of the test above reject, re-acquire, and doubt."""
    problem = dirtied(problem_of(measured, "CTRA 8", None), 230)
    assert {REJECTED, REACQUIRED} <= set(compiled.run(problem).fate.ravel())
    doubted = compiled.run(replace(problem, outliers=Outliers(1000.0, 2.0, spread=True))).fate
    assert DOUBTED in doubted and REJECTED not in doubted
    assert (doubted[160:165, -1] == DOUBTED).all()  # `spread`: the accelerations of an epoch with an outlier


@pytest.mark.parametrize("sigma", [None, Sigma()], ids=["EKF", "UKF"])
def test_on_a_linear_model_all_filters_are_the_kalman_filter(measured, sigma):
    """Law: EKF and UKF of CAA and of CTRA with the turn given equal the exact linear filter; smoothers too."""
    m, noise, size, turning = measured
    exact, problem = caa_problem(m, noise, size, sigma)
    n = 3000
    for linear, model in (
        (exact, problem),
        (
            motion_problem(m, noise, *turning, *size),
            model_problem(m, noise, Ctra.of(noise, True), *size, turning, sigma=sigma),
        ),
    ):
        model = replace(model, x0=linear.x0, P0=linear.P0)
        one, two = compiled.run(linear), compiled.run(model, crossing=True)
        assert max(apart((two.mean[5:n], two.covariance[5:n]), (one.mean[5:n], one.covariance[5:n]))) < 2e-5
        np.testing.assert_allclose(two.nis[5:n], one.nis[5:n], rtol=1e-3, atol=1e-4)
        assert max(apart(compiled.smooth(model, two), compiled.smooth(linear, one))) < 2e-4


def test_inner_steps_change_nothing_that_matters(measured):
    """Measured law: one RK4 step of 0.1 s and the thesis's twenty RK2 steps agree far below the standard deviation."""
    for name, sigma in (("CTRA 8", None), ("CMM 8", Sigma())):
        one, twenty = (cut(problem_of(measured, name, sigma, s), 2000) for s in (ONE_STEP, THESIS_SCHEME))
        one, twenty = compiled.run(one), compiled.run(twenty)
        assert max(apart((one.mean, one.covariance), (twenty.mean, twenty.covariance))) < 1e-3


def rms(values):
    return float(np.sqrt(np.mean(np.square(values[SETTLED:]))))


@pytest.mark.parametrize("sigma", [None, Sigma()], ids=["EKF", "UKF"])
@pytest.mark.parametrize("name", ["CTRA 6", "CTRA 8", "CMM 6", "CMM 8"])
def test_states_are_near_the_truth(measured, voyage, name, sigma):
    """Oracle: the simulator's truth; with a start at rest on the first fix, and consistent: mean NIS within 10 % of the rows."""
    truth = voyage[1]
    run = compiled.run(problem_of(measured, name, sigma))
    turning = measured[3][0]
    psi, r = (run.mean[:, 4], run.mean[:, 5]) if name.endswith("8") else (turning[:, 0], turning[:, 1])
    u, v = run.mean[:, 2], run.mean[:, 3]
    if name.startswith("CMM"):
        c, s = np.cos(psi), np.sin(psi)
        u, v = c * u + s * v, c * v - s * u
    assert rms(u - truth["surge_m_s"].to_numpy()) < 0.02
    assert rms(v - truth["sway_m_s"].to_numpy()) < 0.02
    assert np.degrees(rms(r - truth["yaw_rate_rad_s"].to_numpy())) < 0.008
    rows = np.isfinite(run.innovation).sum(axis=2)
    assert run.nis[SETTLED:].sum() / rows[SETTLED:].sum() == pytest.approx(1.0, abs=0.1)
    smoothed, _ = compiled.smooth(
        problem_of(measured, name, sigma), compiled.run(problem_of(measured, name, sigma), crossing=True)
    )
    errors = [rms(x[:, 0] - truth["north_m"].to_numpy() + measured[0].origin[0]) for x in (smoothed, run.mean)]
    assert errors[0] < 0.75 * errors[1]


def test_one_filter_per_antenna(measured, voyage):
    """Oracle: the truth at bow and stern, v_P = v + r X (E5, E6, E41); worse than one filter at midship, but right."""
    m, noise, size, turning = measured
    truth = voyage[1]
    for name in ("bow", "stern"):
        seen = from_antenna(m, name)
        run = compiled.run(motion_problem(seen, noise, *turning, *size))
        x = m.stations[name][0]
        sway = (truth["sway_m_s"] + x * truth["yaw_rate_rad_s"]).to_numpy()
        assert rms(run.mean[:, 3] - sway) < 0.05
        assert rms(run.mean[:, 2] - truth["surge_m_s"].to_numpy()) < 0.03


def test_two_point_start_is_the_covariance_of_what_it_computes():
    """Oracle: 200,000 draws of two fixes and a heading; means and covariances to 4 standard errors (E26, E27)."""
    rng, count, dt, noise = np.random.default_rng(8), 200_000, 2.0, Noise()
    psi, velocity, variance = 0.6, np.array([5.0, 2.0]), np.array([0.5, 1.5])
    fixes = np.array([[0.0, 0.0], velocity * dt]) + rng.normal(0, np.sqrt(variance), (count, 2, 2))
    headings = psi + rng.normal(0, noise.heading, count)
    for family in (Ctra, Cmm):
        model = family.of(noise)
        mean, P = two_point_start(
            model, [0.0, dt], np.array([[0.0, 0.0], velocity * dt]), psi, 0.01, noise, variance, 0.2
        )
        v = (fixes[:, 1] - fixes[:, 0]) / dt
        if family is Ctra:
            c, s = np.cos(headings), np.sin(headings)
            v = np.column_stack([c * v[:, 0] + s * v[:, 1], c * v[:, 1] - s * v[:, 0]])
        drawn = np.column_stack([fixes[:, 1], v, headings])
        sd = drawn.std(axis=0)
        np.testing.assert_allclose(drawn.mean(axis=0), mean[:5], atol=4 * sd.max() / np.sqrt(count) + 2e-3)
        scale = np.outer(sd, sd)
        np.testing.assert_allclose(P[:5, :5] / scale, np.cov(drawn.T) / scale, atol=4 * np.sqrt(2 / count) + 2e-3)
        assert np.linalg.eigvalsh(P)[0] > 0  # the printed matrix is singular or worse
        assert P[6, 6] == P[7, 7] == pytest.approx(0.04)


def test_a_start_of_one_instant_is_refused():
    noise = Noise()
    with pytest.raises(InputError, match="later than the first"):
        two_point_start(Ctra.of(noise), [1.0, 1.0], np.zeros((2, 2)), 0.0, 0.0, noise, np.ones(2), 0.1)


def test_what_models_cannot_do_is_said(measured):
    m, noise, size, _ = measured
    with pytest.raises(InputError, match="of CAA"):
        model_problem(m, noise, Cmm.of(noise, True), *size)
    with pytest.raises(InputError, match="delays"):
        model_problem(replace(m, calibration=Calibration(position_delay=0.2)), noise, Ctra.of(noise), *size)


def test_batches_are_the_runs(measured):
    """Law: a batch over two threads equals its runs one by one, to the last bit."""
    problems = [cut(problem_of(measured, name, None), 500) for name in ("CTRA 8", "CMM 8", "CTRA 6")]
    for one, many in zip(map(compiled.run, problems), compiled.run_batch(problems, threads=2), strict=True):
        np.testing.assert_array_equal(one.mean, many.mean)


def test_a_smoother_without_its_covariances_is_refused(measured):
    problem = cut(problem_of(measured, "CMM 8", None), 50)
    with pytest.raises(ValueError, match="crossing"):
        compiled.smooth(problem, compiled.run(problem))


def test_the_filter_outlives_what_no_ship_does(measured):
    """Law: with absurd values, gates open and a start of no variance, nothing that comes out is infinite or NaN."""
    for name in ("CTRA 8", "CMM 8", "CMM 6"):
        for sigma in (None, Sigma()):
            p = cut(problem_of(measured, name, sigma), 400)
            z = p.z.copy()
            z[50], z[60, 0], z[70:90] = 1e6, np.inf, -1e5
            wild = replace(p, z=z, gates=np.array([OPEN] * z.shape[1]), P0=np.zeros_like(p.P0))
            run = compiled.run(wild)
            assert np.isfinite(run.mean).all() and np.isfinite(run.covariance).all()
