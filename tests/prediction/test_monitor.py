"""The fit monitor, against errors drawn by a known law, and voyages in calm and in wind that the network does not know."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from aspnn.estimation import filter_log
from aspnn.evaluation.reference import Reference
from aspnn.evaluation.windows import SHIP, find_starts
from aspnn.learning.windows import WindowSpec
from aspnn.prediction import carried, monitor
from aspnn.prediction.gru import GruPredictor
from aspnn.simulation.scenario import read_scenario, simulate_scenario

ROOT = Path(__file__).parents[2]
SPEC = WindowSpec(30.0, 90.0, 1.0, ("surge", "rudder_angle"))


@cache
def flagship() -> GruPredictor:
    return GruPredictor.load(ROOT / "checkpoints/cargo90")


@cache
def voyage(name: str, seed: int):
    """States, reference and wind [m/s] of the first voyage of a standard scenario under a new seed."""
    log, truth = next(simulate_scenario(read_scenario(ROOT / f"data/scenarios/{name}.toml"), 1, seed))
    return filter_log(log), Reference.of_truth(truth), float(truth["wind_speed_true_m_s"].mean())


def drawn(growth, count: int, seed: int):
    """Errors (2 count, MARKS, 3) of two predictions a start, by covariances times `growth` (MARKS,), and what is told of them."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(2 * count, 3, 3, 3)) + 2 * np.eye(3)
    own = rng.uniform(0.1, 0.5, (2 * count, 3, 3))
    covariance = factor @ np.swapaxes(factor, -1, -2)
    root = np.linalg.cholesky(covariance + own[..., None] * np.eye(3))
    off = np.sqrt(growth)[:, None] * np.einsum("mtab,mtb->mta", root, rng.normal(size=(2 * count, 3, 3)))
    return np.tile(np.arange(count), 2), off, own, covariance, count


def test_misfit_is_how_much_larger_the_variance_is():
    """Statistic: variances 1, 4 and 9 times what is told are found within four standard errors (variance 2 / 6 of a square).

    Where nothing ended nothing is known.
    """
    square = monitor.misfit(*drawn(np.array([1.0, 4.0, 9.0]), 3000, 1))
    means = square.mean(axis=0) / np.array([[1], [4], [9]])
    np.testing.assert_allclose(means[:, 0], 1, atol=4 * np.sqrt(2 / 6 / 3000))
    np.testing.assert_allclose(means[:, 1], 1, atol=4 * np.sqrt(2 / 2 / 3000))
    *told, count = drawn(np.ones(3), 5, 2)
    alone = monitor.misfit(*told, count + 1)
    assert np.isfinite(alone[:5]).all() and np.isnan(alone[5]).all()
    np.testing.assert_array_equal(monitor.widening(alone[5:], np.ones((3, 2)), np.arange(91.0)), 1)


def test_what_is_usual_is_a_quantile():
    """Law: six Gaussian squares a mark (two of the heading) are a chi-square: a fifth exceed its quantile, one in a hundred that of
    all eighteen.

    The 80 % quantiles of 6000 have standard errors of 0.01 and 0.02, that of 99 % of 0.01: bounds are four of them.
    """
    usual, limit = monitor.usual_fit(monitor.misfit(*drawn(np.ones(3), 6000, 3)))
    np.testing.assert_allclose(usual[:, 0], chi2.ppf(0.8, 6) / 6, atol=0.045)
    np.testing.assert_allclose(usual[:, 1], chi2.ppf(0.8, 2) / 2, atol=0.09)
    assert limit == pytest.approx(np.sqrt(chi2.ppf(0.99, 18) / 18), abs=0.045)
    assert np.isnan(monitor.usual_fit(np.full((4, 3, 2), np.nan))[1])


def test_widening_by_hand():
    """By hand: squares of 2, 5 and 1 where 1.5 is usual add 0.75, 5.25 and nothing at thirds of the horizon, half between.

    The heading's own of 4.5, 2 and 2.5 would add 4.5, 0.75 and 1.5: the larger counts.
    """
    square = np.array([[[2.0, 4.5], [5.0, 2.0], [1.0, 2.5]]])
    found = monitor.widening(square, np.full((3, 2), 1.5), np.array([0.0, 15, 30, 45, 60, 75, 90]))[0] ** 2
    for k in (0, 1):
        np.testing.assert_allclose(found[:, k], 1 + np.array([0, 0.375, 0.75, 3.0, 5.25, 2.625, 0]))
    np.testing.assert_allclose(found[:, 2], 1 + np.array([0, 2.25, 4.5, 4.875, 5.25, 3.375, 1.5]))


def test_ended_predictions_end_before_the_start():
    """Law: also where epochs are uneven, none ends after the start it judges, nor does it begin without its history."""
    states, _, _ = voyage("cargo90-test", 501)
    table = states.table.iloc[::3].copy()
    table = table[np.random.default_rng(1).uniform(size=len(table)) > 0.3].reset_index(drop=True)
    uneven = replace(states, table=table)
    time, rows = uneven["time_s"], np.array([200, 300, 450, 700, 2000])
    found = monitor.ended(uneven, rows, SPEC)
    gap = time[rows[found.start]] - time[found.rows]
    ages = np.round(gap / 90) * 90
    assert (gap >= ages).all() and (gap < ages + 3).all() and set(ages) == {90, 180}
    assert (time[found.rows] - time[0] >= SPEC.history - 1 - 1e-6).all()
    for start in range(len(rows)):
        want = sum(time[rows[start]] - time[0] >= age * 90 + SPEC.history - 1 for age in monitor.AGES)
        assert (found.start == start).sum() == want
    order = uneven["rudder_order_rad"]
    for row, plan in zip(found.rows, found.plans, strict=True):
        for later in (0.0, 44.0, 90.0):
            assert plan.rudder.at(later) == order[np.searchsorted(time, time[row] + later + 1e-9, side="right") - 1]


def test_a_past_that_cannot_be_read_is_left_out():
    """Contract: no prediction from or through coasting states or without an input; the one from now is none the worse."""
    states, _, _ = voyage("cargo90-test", 501)
    row = np.array([4000])
    assert len(monitor.ended(states, row, SPEC).rows) == 2
    for name, value, at in (("coasting", True, 2000), ("rudder_angle_rad", np.nan, 2100), ("coasting", True, 3500)):
        table = states.table.copy()
        table.loc[at : at + 20, name] = value
        found = monitor.ended(replace(states, table=table), row, SPEC)
        np.testing.assert_array_equal(found.rows, [3100] if at < 2500 else [])
    path = flagship().predict(states.until(100.0), 0.1)
    assert np.isnan(path.spread.misfit) and path.spread.fits and np.isfinite(path.region().major).all()


def regions(name: str, seed: int):
    """Whether the 95 % regions at 60 and 90 s hold, their areas and their spread, with the monitor and without it."""
    states, reference, wind = voyage(name, seed)
    starts = find_starts(states, SHIP)
    truth = reference.path(states["time_s"][starts.rows], np.array([60.0, 90.0]))
    bundle = flagship().bundle
    deaf = GruPredictor(replace(bundle, calibration=bundle.calibration | {"usual": [[1e9, 1e9]] * 3}))
    found = []
    for predictor in (flagship(), deaf):
        path = predictor.predict_many(states, starts.rows, starts.plans).at([60.0, 90.0])
        region = path.region()
        found.append((region.contains(truth.north, truth.east), region.area, path.spread))
    return wind, *found


def test_calm_regions_stay_and_those_in_unknown_wind_widen():
    """Statistic: in calm the misfit is about one and areas grow by a tenth at most (median); in a wind of more than 7 m/s, which the
    flagship does not know, most starts are beyond the limit, and regions that held less than half hold nine tenths.
    """
    wind, (held, area, spread), (_, plain, _) = regions("cargo90-test", 71)
    assert wind == 0
    assert np.median(spread.misfit) == pytest.approx(1.0, abs=0.25)
    assert spread.fits.mean() > 0.9 and held.mean() > 0.85
    assert np.median(area / plain) < 1.1
    wind, (held, area, spread), (before, plain, _) = regions("cargo90-wind", 5)
    assert wind > 7
    assert spread.fits.mean() < 0.5
    assert before.mean() < 0.5 and held.mean() > 0.85
    assert np.median(area / plain) > 3


def test_one_and_many_and_a_later_record_see_the_same_past():
    """Law: the misfit of `predict` is that of `predict_many`, and states after the start do not move it."""
    states, _, _ = voyage("cargo90-wind", 5)
    starts = find_starts(states, SHIP)
    rows, plans = starts.rows[4:8], starts.plans[4:8]
    many = flagship().predict_many(states, rows, plans).spread
    row = int(rows[2])
    table = states.table.copy()
    table.loc[row + 1 :, ["north_m", "surge_m_s", "heading_rad", "rudder_order_rad"]] = 3.0
    for seen in (states, replace(states, table=table)):
        one = flagship().predict(seen.until(states["time_s"][row]), plans[2].rudder)
        np.testing.assert_allclose(one.spread.misfit, many.misfit[2], rtol=2e-3)  # float32 in another batch
    bundle = flagship().bundle
    alone = carried.recent(bundle, flagship().calibration, states.until(states["time_s"][row]))
    assert alone["time_s"][-1] - alone["time_s"][0] == pytest.approx(SPEC.history + 180, abs=0.2)
