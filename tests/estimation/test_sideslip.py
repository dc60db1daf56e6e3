"""The two-state sideslip filter: against filterpy, closed formulae, statistics and the truth of simulated logs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm, solve_continuous_are
from scipy.stats import chi2

from aspnn.estimation.sideslip import (
    EXACT,
    SMALL,
    SURGE,
    SideslipFilter,
    SideslipModel,
    log_sideslip,
    sideslip_along,
    speed_over_ground,
)
from aspnn.records import read_log, read_truth
from aspnn.schema import InputError

SAMPLE = Path(__file__).parents[2] / "data/sample"
FORMS = {"small": SMALL, "surge": SURGE, "exact": EXACT}


def test_each_step_is_that_of_filterpy():
    """Oracle: filterpy's KalmanFilter with F by expm and Q by Van Loan's method, ship by ship; every third fix is missing."""
    rng, dt, ships = np.random.default_rng(2), 0.2, 3
    model = SideslipModel(0.02, 0.01, 0.3, SMALL)
    ours = SideslipFilter(model, ships)
    speed, angle = np.array([1.0, 2.5, 0.7]), np.array([0.3, -1.1, 2.8])
    first = rng.standard_normal(ships)
    ours.step(dt, first, speed, angle)
    theirs = []
    for k in range(ships):
        one = KalmanFilter(dim_x=2, dim_z=1)
        one.x, one.P = np.array([[first[k]], [0.0]]), ours.covariance[k].copy()
        A = np.array([[0.0, speed[k] * np.cos(angle[k])], [0.0, 0.0]])
        Q = np.diag([model.cross_density, model.sideslip_density])
        block = expm(dt * np.block([[-A, Q], [np.zeros((2, 2)), A.T]]))
        one.F = block[2:, 2:].T
        one.Q, one.R, one.H = one.F @ block[:2, 2:], np.array([[model.fix_variance]]), np.array([[1.0, 0.0]])
        one.B = np.array([[dt * speed[k] * np.sin(angle[k])], [0.0]])
        theirs.append(one)
    for step in range(60):
        fix = 3 * rng.standard_normal(ships) if step % 3 else np.full(ships, np.nan)
        ours.step(dt, fix, speed, angle)
        for k, one in enumerate(theirs):
            one.predict(u=np.ones((1, 1)))
            one.update(None if np.isnan(fix[k]) else fix[k])
            np.testing.assert_allclose([ours.cross[k], ours.state[k]], one.x[:, 0], rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(ours.covariance[k], one.P, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 0.9, -2.5])
def test_the_published_gain_is_that_of_the_continuous_filter(angle):
    """Oracle: the algebraic Riccati equation of (9) by scipy, and its closed form; what is left is of the order of the step."""
    dt, speed = 4e-3, 1.2
    A = np.array([[0.0, speed * np.cos(angle)], [0.0, 0.0]])
    P = solve_continuous_are(A.T, np.array([[1.0], [0.0]]), 100 * np.eye(2), [[10.0]])
    slope = abs(A[0, 1])
    closed = np.array([np.sqrt(10 + 2 * slope * np.sqrt(10)), np.sign(A[0, 1]) * np.sqrt(10)])
    np.testing.assert_allclose(P[:, 0] / 10, closed, rtol=1e-9)
    found = SideslipFilter(SideslipModel.published(dt))
    for _ in range(1500):
        found.step(dt, 0.0, speed, angle)
    np.testing.assert_allclose(found.gain[0] / dt, closed, rtol=0.02)


def test_a_tuned_filter_settles_as_a_butterworth_filter():
    """Oracle: poles w exp(+-3/4 i pi) of the steady filter's error, s = log(z) / dt."""
    dt, speed, w = 0.02, 1.7, 0.5
    found = SideslipFilter(SideslipModel.tuned(w, 0.3, dt, speed))
    for _ in range(2000):
        found.step(dt, 0.0, speed, 0.0)
    F, gain = np.array([[1.0, dt * speed], [0.0, 1.0]]), found.gain[0][:, None]
    poles = np.log(np.linalg.eigvals((np.eye(2) - gain @ [[1.0, 0.0]]) @ F).astype(complex)) / dt
    np.testing.assert_allclose(np.abs(poles), w, rtol=0.02)
    np.testing.assert_allclose(np.abs(np.angle(poles)), 0.75 * np.pi, rtol=0.02)


@pytest.mark.parametrize("name", FORMS)
def test_slopes_are_those_of_the_rates(name):
    """Oracle: central differences."""
    form, rng = FORMS[name], np.random.default_rng(1)
    speed, angle, state = rng.uniform(0.5, 3, 20), rng.uniform(-3, 3, 20), rng.uniform(-0.6, 0.6, 20)
    change = (form.rate(speed, angle, state + 1e-5) - form.rate(speed, angle, state - 1e-5)) / 2e-5
    np.testing.assert_allclose(form.slope(speed, angle, state), change, rtol=1e-8)


def test_rates_are_the_velocity_across_the_path():
    """Oracle: u sin a + v cos a (paper 002 (1), (4)); the printed form errs by U (sin a (1 - cos beta) + cos a (beta - sin beta))."""
    u, v, a = 1.1, 0.35, np.linspace(-3, 3, 31)
    U, beta = np.hypot(u, v), np.arctan2(v, u)
    across = u * np.sin(a) + v * np.cos(a)
    np.testing.assert_allclose(SURGE.rate(u, a, np.tan(beta)), across, rtol=1e-12)
    np.testing.assert_allclose(EXACT.rate(U, a, beta), across, rtol=1e-12)
    error = U * (np.sin(a) * (1 - np.cos(beta)) + np.cos(a) * (beta - np.sin(beta)))
    np.testing.assert_allclose(SMALL.rate(U, a, beta) - across, error, atol=1e-12)
    assert np.abs(error).max() > 0.05  # for 18 degrees the approximation is seen


@pytest.mark.parametrize("name", FORMS)
def test_on_the_line_each_form_finds_its_sideslip(name):
    """Oracle: on the line a = -beta. The exact forms find beta; the printed one finds tan(beta)."""
    form, beta, U = FORMS[name], np.radians([25.0, -8.0]), 1.3
    speed = U * np.cos(beta) if form is SURGE else U
    found = SideslipFilter(SideslipModel.tuned(0.5, 0.1, 0.1, U, form), 2)
    for _ in range(600):
        found.step(0.1, 0.0, speed, -beta)
    np.testing.assert_allclose(form.tangent(found.state), np.tan(beta), rtol=1e-6)
    np.testing.assert_allclose(found.sideslip, np.tan(beta) if form is SMALL else beta, rtol=1e-6)


def test_across_the_path_the_sideslip_cannot_be_seen():
    """Oracle: the law of E49: with cos a = 0 the gain of the second state dies out and its variance grows by q t."""
    found = SideslipFilter(SideslipModel(0.01, 1e-4, 0.04, SMALL))
    for _ in range(400):
        found.step(0.1, 0.0, 1.0, 0.2)
    assert abs(found.gain[0, 1]) > 0.005
    before = found.sd[0] ** 2
    for step in range(1200):
        found.step(0.1, np.sin(step), 1.0, np.pi / 2)
        if step == 199:
            begun, held = found.sd[0] ** 2, found.state[0]
    assert abs(found.gain[0, 1]) < 1e-9 and found.state[0] == pytest.approx(held, abs=1e-4)
    assert found.sd[0] ** 2 - begun == pytest.approx(1e-4 * 100, rel=1e-3) and begun > before


def test_errors_are_as_large_as_the_filter_says():
    """Oracle: normalised squared errors of motions drawn from the model are chi-square of two degrees of freedom, 300 ships."""
    rng, ships, dt = np.random.default_rng(5), 300, 0.5
    model = SideslipModel(0.0, 2e-4, 0.25, EXACT)
    found, y, beta = SideslipFilter(model, ships), np.zeros(ships), 0.2 * rng.standard_normal(ships)
    before = np.zeros(ships)
    for step in range(120):
        angle = 0.5 * np.sin(0.05 * step * dt) * np.ones(ships)
        if step:
            mean = 0.5 * (angle + before)
            wander = rng.multivariate_normal([0, 0], 2e-4 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), ships)
            y = y + dt * 2.0 * np.sin(mean + beta) + 2.0 * np.cos(mean + beta) * wander[:, 0]
            beta = beta + wander[:, 1]
        before = angle
        found.step(dt, y + 0.5 * rng.standard_normal(ships), 2.0, angle)
    off = np.stack([y - found.cross, beta - found.state], axis=-1)
    nees = np.einsum("bi,bij,bj->b", off, np.linalg.inv(found.covariance), off)
    low, high = chi2.ppf([0.001, 0.999], 2 * ships)
    assert low < nees.sum() < high


def test_a_new_path_keeps_the_sideslip():
    """Oracle: the definition; the other ship goes on as if nothing had been."""
    one, other = (SideslipFilter(SideslipModel.tuned(0.5, 0.1, 0.1, 1.0), 2) for _ in range(2))
    for found in (one, other):
        for _ in range(200):
            found.step(0.1, [0.0, 0.0], 1.0, [-0.3, 0.2])
    one.rebase(np.array([True, False]))
    one.step(0.1, [40.0, 0.1], 1.0, [-0.3, 0.2])
    other.step(0.1, [0.0, 0.1], 1.0, [-0.3, 0.2])
    assert one.cross[0] == 40.0 and one.state[0] == pytest.approx(0.3, abs=1e-6)
    assert one.state[1] == other.state[1] and one.cross[1] == other.cross[1]


def test_without_a_path_lines_are_laid_along_the_heading():
    """Oracle: a circle with constant sideslip by closed formula, several times round; positions exact."""
    t, U, r, beta = np.arange(0, 900, 0.5), 4.0, 0.02, np.radians(11.0)
    heading = 0.4 + r * t
    place = U / (1j * r) * (np.exp(1j * (heading + beta)) - np.exp(1j * (0.4 + beta)))
    model = SideslipModel.tuned(0.3, 0.5, 0.5, U)
    found = sideslip_along(t, place.real, place.imag, heading, np.full(len(t), U), model)
    np.testing.assert_allclose(found.angle[t > 60], beta, atol=np.radians(0.05))
    way = speed_over_ground(t, place.real, place.imag, 5.0)
    np.testing.assert_allclose(way[t > 5], U * np.sinc(r * 5.0 / (2 * np.pi)), rtol=1e-6)  # the chord


def test_the_sideslip_of_a_log_is_that_of_the_truth():
    """Oracle: truth of the simulated sample zigzag, more than 5 deg rms of sideslip, from one antenna and the heading alone.

    1.9 deg: of 1 m fixes at 10 Hz a filter of 9 U / L leaves 1.5 deg by its own standard deviation, and lags in a turn.
    """
    log = read_log(SAMPLE / "zigzag-20-20.parquet")
    truth = read_truth(log)
    bare = replace(log, table=log.table[["time_s", "heading_deg", "bow_latitude_deg", "bow_longitude_deg"]].iloc[:1800])
    found = log_sideslip(bare)
    true = np.interp(found.time, truth["time_s"], np.arctan2(truth["sway_m_s"], truth["surge_m_s"]))
    use = found.time > 30
    assert np.degrees(np.sqrt(np.mean(true[use] ** 2))) > 5
    assert np.degrees(np.sqrt(np.mean((found.angle - true)[use] ** 2))) < 1.9


def test_the_future_is_not_known():
    """Oracle: the same series with another future, to the last bit."""
    rng, t = np.random.default_rng(3), np.arange(0, 60, 0.2)
    heading = 0.05 * t
    north, east = np.cumsum(rng.uniform(0.3, 0.6, (2, len(t))), axis=1)
    model, later = SideslipModel.tuned(0.3, 0.5, 0.2, 2.0), t > 40
    found = [
        sideslip_along(
            t, north, east + shift * later, heading + shift * later, speed_over_ground(t, north, east), model
        )
        for shift in (0.0, 3.0)
    ]
    np.testing.assert_array_equal(found[0].angle[~later], found[1].angle[~later])
    assert not np.array_equal(found[0].angle[later], found[1].angle[later])
    ways = [speed_over_ground(t, north, east + shift * later) for shift in (0.0, 3.0)]
    np.testing.assert_array_equal(ways[0][~later], ways[1][~later])


def test_what_tells_no_sideslip_is_named():
    """Oracle: the message names what is wrong."""
    with pytest.raises(InputError, match="densities must not be negative"):
        SideslipModel(-1.0, 1.0, 1.0)
    with pytest.raises(InputError, match="variance of a fix"):
        SideslipModel(1.0, 1.0, 0.0)
    log = read_log(SAMPLE / "zigzag-20-20.parquet")
    rng, table = np.random.default_rng(0), log.table[["time_s", "heading_deg"]].iloc[:600].copy()
    for name, value in (("bow_latitude_deg", 69.65), ("bow_longitude_deg", 18.96)):
        table[name] = value + 1e-7 * rng.standard_normal(600)
    with pytest.raises(InputError, match="lies still"):
        log_sideslip(replace(log, table=table))
