"""The course filter: circle and straight, both engines, both forms, starts in any direction, outages, jumps, frozen fixes, statistics."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aspnn.angles import wrap
from aspnn.estimation import course_reference
from aspnn.estimation.course import CourseModel, CourseTracker
from aspnn.estimation.course_run import ahead, problem_of, run
from aspnn.estimation.problem import REACQUIRED, REJECTED
from aspnn.frames import Zone, convergence, to_geodetic, to_grid
from aspnn.schema import InputError

MODEL = CourseModel(1e-3, 1e-6, 1e-5, 0.001)


def circle(time, U=7.0, chi=0.4, omega=0.0):
    """Places (n, 2) [m] of a point at speed U whose course turns at omega from chi."""
    angle = chi + omega * time
    if omega == 0:
        return U * time[:, None] * np.array([np.cos(chi), np.sin(chi)])
    return U / omega * np.column_stack([np.sin(angle) - np.sin(chi), np.cos(chi) - np.cos(angle)])


def fixes(time, sd=1.0, seed=0, **motion):
    """Fixes of a circle with white noise."""
    return circle(time, **motion) + sd * np.random.default_rng(seed).standard_normal((len(time), 2))


@pytest.mark.parametrize("chi", np.radians([0, 60, 135, 180, -120, -45]))
@pytest.mark.parametrize("place", [(1.2, 0.3), (-0.7, math.pi - 2e-6), (0.5, -math.pi + 2e-6)])
@pytest.mark.parametrize("omega", [0.0, -0.01])
def test_starts_in_any_direction_in_either_hemisphere_and_across_the_date_line(chi, place, omega):
    """Analytic circle and straight on noise-free fixes at 5 Hz, predicted at 50 Hz; the metres of a radian by the local radii."""
    time = np.arange(0, 45, 0.02)
    metres = circle(time, chi=chi, omega=omega)
    metres[np.arange(len(time)) % 10 != 0] = np.nan
    grid = run(problem_of(time, metres, 0.1, MODEL))
    e2 = 0.00669437999014
    W = 1 - e2 * math.sin(place[0]) ** 2
    RN, RM = 6378137.0 / math.sqrt(W), 6378137.0 * (1 - e2) / W**1.5
    geodetic = place + metres / [RM, RN * math.cos(place[0])]
    geodetic[:, 1] = wrap(geodetic[:, 1])
    world = run(problem_of(time, geodetic, 0.1, MODEL, geodetic=True))
    for r in (grid, world):
        after = time > 30
        assert not r.lost[after].any()
        np.testing.assert_allclose(r.mean[after, 2], 7.0, atol=0.02)
        assert np.abs(wrap(r.mean[after, 3] - chi - omega * time[after])).max() < math.radians(0.3)
        np.testing.assert_allclose(r.mean[after, 4], omega, atol=3e-4)
    assert (np.abs(world.mean[:, 1]) <= math.pi).all()


def test_latitude_and_longitude_tell_the_course_of_the_grid_and_its_convergence():
    """pyproj: UTM fixes of a noisy turn, projected back; out of its zone the grid is 3.7 degrees off true north. 0.01 degrees."""
    zone, time = Zone(33), np.arange(0, 300, 0.2)
    z = fixes(time, 1.0, 3, omega=0.01) + np.array(to_grid(math.radians(69.65), math.radians(18.96), zone))
    world = run(problem_of(time, np.column_stack(to_geodetic(*z.T, zone)), 1.0, MODEL, geodetic=True))
    grid = run(problem_of(time, z, 1.0, MODEL))
    gamma = convergence(*to_geodetic(*grid.mean[:, :2].T, zone), zone)
    off = np.degrees(wrap(world.mean[:, 3] - grid.mean[:, 3] - gamma))[time > 60]
    assert np.degrees(gamma).min() > 3.6
    assert np.abs(off).max() < 0.01
    np.testing.assert_allclose(np.degrees(grid.covariance[:, 3, 3]), np.degrees(world.covariance[:, 3, 3]), rtol=0.01)


def hard_track():
    """Fixes at odd times with an outage, a single jump, a jump that lasts, a halt and a start astern of where she pointed."""
    rng = np.random.default_rng(3)
    time = np.sort(np.concatenate([np.arange(0, 200, 0.1), rng.uniform(0, 200, 50)]))
    z = fixes(time, seed=4, chi=2.9, omega=0.01)
    z[rng.uniform(size=len(time)) < 0.5] = np.nan
    z[800:1100] = np.nan
    z[300] += 50
    z[1300:1500] += [30, 40]
    z[1600:] = z[np.flatnonzero(np.isfinite(z[:1600, 0]))[-1]] + rng.standard_normal((len(time) - 1600, 2))
    z[1800:] -= 6 * (time[1800:] - time[1800])[:, None]
    return time, z


@pytest.mark.parametrize("geodetic", [False, True])
def test_compiled_engine_is_filterpys(geodetic):
    """An EKF step by step on filterpy, with the recent fixes kept one by one: means to 1e-7 of their deviations, fates alike."""
    time, z = hard_track()
    if geodetic:
        z = np.column_stack([1.2 + z[:, 0] / 6.4e6, wrap(np.pi - 1e-5 + z[:, 1] / 6.4e6 / math.cos(1.2))])
    p = problem_of(time, z, 1.0, CourseModel(1e-3, 1e-5, 1e-5, 0.2), geodetic)
    a, b = run(p), course_reference.run(p)
    deviation = np.sqrt(np.diagonal(b.covariance, axis1=1, axis2=2))
    assert {REJECTED, REACQUIRED} <= set(a.fate.tolist()) and a.lost[10:].any()
    np.testing.assert_array_equal(a.fate, b.fate)
    np.testing.assert_array_equal(a.lost, b.lost)
    assert np.abs((a.mean - b.mean) / deviation).max() < 1e-7
    size = deviation[:, :, None] * deviation[:, None, :]
    assert np.abs((a.covariance - b.covariance) / size).max() < 1e-8
    for one, other in ((a.nis, b.nis), (a.whitened, b.whitened), (a.log_likelihood, b.log_likelihood)):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)


def test_the_tracker_is_the_filter_of_a_log():
    """`run` over the same fixes, for three ships in one tracker of which one hears every fifth fix alone."""
    time = np.arange(0, 40, 0.02)
    z = np.stack([fixes(time, seed=k, chi=k, omega=0.01 * k) for k in range(3)])
    z[:, np.arange(len(time)) % 10 != 0] = np.nan
    z[2, np.arange(len(time)) % 50 != 0] = np.nan
    tracker = CourseTracker(MODEL, 1.0, 3, 0.02)
    told = []
    for k, t in enumerate(time):
        tracker.step(t, z[:, k, 0], z[:, k, 1])
        told.append(np.stack([tracker.north, tracker.east, tracker.speed, tracker.course, tracker.course_rate], -1))
    told = np.array(told)
    assert tracker.ready.all()
    for k in range(3):
        r = run(problem_of(time, z[k], 1.0, MODEL))
        np.testing.assert_allclose(wrap(r.mean[:, 3] - told[:, k, 3]), 0, atol=1e-9)
        np.testing.assert_allclose(told[:, k, [0, 1, 2, 4]], r.mean[:, [0, 1, 2, 4]], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(tracker.sd[k], np.sqrt(np.diag(r.covariance[-1])), rtol=1e-9)


def test_a_tracker_before_its_first_fix_and_with_a_clock_that_runs_back():
    """Nothing is known: NaN, not ready. A step back in time is refused."""
    tracker = CourseTracker(MODEL, 1.0, 2)
    tracker.step(None, np.nan, np.nan)
    tracker.step(None, [1.0, np.nan], [2.0, np.nan])
    assert tracker.time == pytest.approx(0.02) and not tracker.ready.any()
    assert tracker.north[0] == 1.0 and np.isnan([tracker.north[1], tracker.course[1]]).all()
    with pytest.raises(InputError, match="time must not run back"):
        tracker.step(0.0, np.nan, np.nan)
    with pytest.raises(InputError, match="must be positive"):
        CourseTracker(MODEL, 0.0)


def test_dead_reckoning_of_a_minute_keeps_course_and_speed():
    """A straight track without fixes for 60 s: the place within 4 of its deviations, the speed less by its decay e^(-60 a1)."""
    time = np.arange(0, 400, 0.1)
    model = CourseModel(1e-4, 1e-9, 2e-4, 0.01)
    z = fixes(time, chi=-2.5)
    z[(time > 300) & (time < 360)] = np.nan
    r = run(problem_of(time, z, 1.0, model))
    before, after = np.searchsorted(time, [300.05, 359.95]) - 1
    assert r.mean[after, 2] / r.mean[before, 2] == pytest.approx(
        math.exp(-2e-4 * (time[after] - time[before])), rel=1e-9
    )
    away = r.mean[after, :2] - circle(time[after : after + 1], chi=-2.5)[0]
    spread = r.covariance[after, :2, :2]
    assert away @ np.linalg.solve(spread, away) < 16
    assert np.all(np.diff(r.covariance[before : after + 1, 0, 0]) > 0)
    last = time > 380
    assert np.abs(wrap(r.mean[last, 3] + 2.5)).max() < math.radians(2) and not r.lost[last].any()


def test_innovations_are_chi_square_and_white():
    """Truth drawn from the model itself, 40 runs of 500 fixes: mean NIS 2 within four standard errors; lag-one correlation likewise."""
    rng, dt, n, runs = np.random.default_rng(7), 1.0, 500, 40
    model = CourseModel(1e-4, 1e-7, 1e-5, 0.01)
    U, chi, omega = np.full(runs, 7.0), rng.uniform(-3, 3, runs), np.zeros(runs)
    place, series, inner = np.zeros((runs, 2)), [], 10
    for _ in range(n):
        for _ in range(inner):
            h = dt / inner
            place += h * (U * np.array([np.cos(chi + omega * h / 2), np.sin(chi + omega * h / 2)])).T
            chi = chi + h * omega
            U = U - h * model.alpha_speed * U + math.sqrt(model.speed_density * h) * rng.standard_normal(runs)
            omega = omega - h * model.alpha_turn * omega + math.sqrt(model.turn_density * h) * rng.standard_normal(runs)
        series.append(place + rng.standard_normal((runs, 2)))
    z = np.stack(series, 1)
    found = [run(replace(problem_of(np.arange(n) * dt, one, 1.0, model), gate=math.inf)) for one in z]
    nis = np.concatenate([r.nis[100:] for r in found])
    assert abs(nis.mean() - 2) < 4 * 2 / math.sqrt(len(nis))
    white = np.stack([r.whitened[100:] for r in found])
    lagged = np.mean(white[:, 1:] * white[:, :-1])
    assert abs(lagged) < 4 / math.sqrt(white[:, 1:].size)


def test_a_ship_that_goes_astern_has_no_negative_speed():
    """(U, chi) and (-U, chi + pi) are one motion (E48): a point that turns back on its own track."""
    time = np.arange(0, 200, 0.2)
    way = np.where(time < 100, 2 * time, 400 - 2 * time)
    z = way[:, None] * [1.0, 0.0] + 0.3 * np.random.default_rng(1).standard_normal((len(time), 2))
    r = run(problem_of(time, z, 0.3, CourseModel(1e-2, 1e-4, 1e-5, 0.05)))
    assert (r.mean[:, 2] >= 0).all()
    late = time > 140
    assert np.abs(wrap(r.mean[late, 3] - np.pi)).max() < math.radians(15)
    np.testing.assert_allclose(r.mean[late, 2], 2.0, atol=0.4)


def test_a_halt_and_a_start_in_another_direction():
    """At rest no direction is told, and the filter says so; it follows again within half a minute of a start abeam."""
    time = np.arange(0, 900, 1.0)
    way = np.stack([np.minimum(time, 200) * 4, np.maximum(time - 700, 0) * 4], -1)
    z = way + np.random.default_rng(2).standard_normal(way.shape)
    r = run(problem_of(time, z, 1.0, CourseModel(1e-3, 1e-4, 1e-5, 0.05)))
    assert r.lost[(time > 400) & (time < 700)].mean() > 0.5
    going = time > 730
    assert np.abs(wrap(r.mean[going, 3] - np.pi / 2)).max() < math.radians(20)
    assert np.degrees(math.sqrt(r.covariance[600, 3, 3])) > 50


def test_single_jumps_are_rejected_and_lasting_ones_accepted():
    """A fix 40 m off changes nothing; a receiver that stays 40 m off is believed after two seconds and three fixes."""
    time = np.arange(0, 200, 0.5)
    clean = fixes(time, seed=5)
    single, lasting = clean.copy(), clean.copy()
    single[200] += 40
    lasting[200:] += 40
    a, b, c = (run(problem_of(time, z, 1.0, MODEL)) for z in (clean, single, lasting))
    assert b.fate[200] == REJECTED and np.abs((a.mean - b.mean)[201:, :2]).max() < 1.0
    assert (c.fate == REACQUIRED).sum() == 1 and time[np.argmax(c.fate == REACQUIRED)] - time[200] < 2.6
    assert np.abs(wrap(c.mean[240:, 3] - 0.4)).max() < math.radians(6)


def test_late_fixes_are_run_on_to_now():
    """`ahead` by half a second is the filter without fixes for half a second."""
    time = np.arange(0, 50, 0.5)
    z = fixes(time, omega=0.02)
    p = problem_of(time, z, 1.0, MODEL)
    mean, covariance = ahead(run(p), MODEL, 0.5)
    blind = z.copy()
    blind[-1] = np.nan
    r = run(replace(p, z=blind))
    np.testing.assert_allclose(mean[-2], r.mean[-1], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(covariance[-2], r.covariance[-1], rtol=1e-9, atol=1e-12)


def test_no_fix_and_no_deviation_are_refused():
    """A problem needs a fix, and a positive deviation."""
    with pytest.raises(InputError, match="0 fixes"):
        problem_of([0, 1], np.full((2, 2), np.nan), 1.0, MODEL)
    with pytest.raises(InputError, match="positive sd"):
        problem_of([0, 1], np.zeros((2, 2)), 0.0, MODEL)
