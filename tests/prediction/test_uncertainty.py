"""Regions: Gaussian and conformal oracles, laws of covariances under rotation, mirror and batch, and the shipped calibration."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path as FilePath

import numpy as np
import pytest

from aspnn.estimation import filter_log
from aspnn.evaluation.windows import GROUPS, SHIP, find_starts
from aspnn.learning.checkpoint import read_bundle, write_calibration
from aspnn.motion import Path, Spread, integrate
from aspnn.motion.spread import disc, strip
from aspnn.orders import Orders, Plan
from aspnn.prediction.calibration import conformal, fit_correlation, fit_variance, scores
from aspnn.prediction.gru import GruPredictor
from aspnn.prediction.uncertainty import FULL, LEVELS, POPULATIONS, WIDER, Calibration, axes, perturbed, population
from aspnn.records import States, read_log, sha256
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario, simulate_scenario

ROOT = FilePath(__file__).parents[2]
SHIPPED = ROOT / "checkpoints/cargo90"


@cache
def states() -> States:
    scenario = read_scenario(ROOT / "data/scenarios/cargo90-test.toml")
    return filter_log(next(iter(simulate_scenario(scenario, 1, seed=71)))[0])


@cache
def predictor() -> GruPredictor:
    return GruPredictor.load(SHIPPED)


def gaussian(covariance: np.ndarray, count: int = 3) -> Path:
    """A path of `count` steps whose errors are Gaussian with one covariance."""
    still = integrate((0.0, 0.0, 0.0), np.zeros((count - 1, 3)), 1.0)
    factors = [np.tile([f(p) for p in LEVELS], (count, 1)) for f in (disc, strip)]
    whole = np.tile(covariance, (count, 1, 1))
    spread = Spread(whole, np.array(False), np.array(LEVELS), *factors, np.array(1.0), 2.0)
    return replace(still, spread=spread)


@pytest.mark.parametrize("level", [0.5, 0.65, 0.95, 0.97, 0.99])
def test_gaussian_errors_fall_inside_with_the_stated_share(level):
    """Statistic: 40,000 draws of a Gaussian fall into its region with the share promised, within four standard errors.

    The area is pi d^2 sqrt(det) with d^2 = -2 ln(1 - p), levels between the measured ones included.
    """
    factor = np.array([[3.0, 0, 0], [1.5, 0.8, 0], [0.01, 0.02, 0.03]])
    covariance, draws = factor @ factor.T, np.random.default_rng(1).normal(size=(40_000, 3)) @ factor.T
    region = gaussian(covariance).region(level)
    inside = np.mean(region.contains(draws[:, :1], draws[:, 1:2])[:, 0])
    turned = np.mean(np.abs(draws[:, 2]) <= region.heading[0])
    assert [inside, turned] == pytest.approx([level, level], abs=4 * math.sqrt(level * (1 - level) / 40_000))
    area = math.pi * -2 * math.log(1 - level) * math.sqrt(np.linalg.det(covariance[:2, :2]))
    np.testing.assert_allclose(region.area, area, rtol=1e-9)


def test_outline_is_the_ellipse_in_the_north_east_plane():
    """Analytic: a ring point e has e' C^-1 e = d^2; errors along 30 deg draw an ellipse whose major axis has azimuth 30 deg."""
    turn = np.array([[math.cos(0.5236), -math.sin(0.5236), 0], [math.sin(0.5236), math.cos(0.5236), 0], [0, 0, 1]])
    covariance = turn @ np.diag([9.0, 1.0, 0.01]) @ turn.T
    region = gaussian(covariance).region(0.95)
    ring = region.outline()[0]
    np.testing.assert_allclose(
        np.einsum("pa,ab,pb->p", ring, np.linalg.inv(covariance[:2, :2]), ring), 5.991465, rtol=1e-6
    )
    assert [region.azimuth[0], region.major[0] / region.minor[0]] == pytest.approx([0.5236, 3.0])


def test_paths_without_calibration_and_other_levels_say_so():
    """Contract: one line that names the remedy."""
    path = gaussian(np.eye(3))
    with pytest.raises(InputError, match="aspnn calibrate"):
        replace(path, spread=None).region(0.95)
    with pytest.raises(InputError, match=r"levels from 0\.5 to 0\.99"):
        path.region(0.999)


def test_conformal_factor_by_hand():
    """Definition: of the scores 1 to 39, 95 % takes the ceil(40 x 0.95) = 38th, 50 % the 20th; 99 % takes more windows."""
    found = conformal(np.random.default_rng(0).permutation(np.arange(1.0, 40))[:, None], (0.5, 0.95, 0.99))
    np.testing.assert_array_equal(found, [[20, 38, np.nan]])


def test_conformal_share_on_new_scores():
    """Theorem of split conformal prediction: the mean share of new scores is ceil((n + 1) p) / (n + 1), whatever the law.

    1500 repetitions of 30 heavy-tailed scores: the share at 90 % is 28/31 = 0.903 within four standard errors
    (sqrt(0.903 x 0.097 / 1500 / 32) = 0.0014 of a Beta); the plain quantile (27th of 30) would give 0.871.
    """
    rng = np.random.default_rng(2)
    held = conformal(rng.standard_cauchy((30, 1500)), (0.9,))[:, 0]
    assert np.mean(rng.standard_cauchy((400, 1500)) <= held) == pytest.approx(28 / 31, abs=0.006)


def test_variance_is_found_again():
    """Statistic: errors made with known coefficients on top of a known carried variance give them back within 10 %."""
    rng = np.random.default_rng(3)
    n = 20_000
    drivers = np.stack([np.ones(n), *rng.exponential(1.0, (3, n))], axis=-1)[:, None]
    variance = np.array([[0.2, 0.5, 0.0, 0.3], [0.1, 0.0, 0.4, 0.0], [0.05, 0.1, 0.1, 0.1]])
    carried = rng.uniform(0.05, 0.2, (n, 1, 3))
    total = carried + drivers @ variance.T
    mixed = np.linalg.cholesky(np.array([[1, 0.6, 0], [0.6, 1, -0.3], [0, -0.3, 1]]))
    errors = np.sqrt(total) * (rng.normal(size=(n, 1, 3)) @ mixed.T)
    found = fit_variance(errors, carried, drivers)[0]
    np.testing.assert_allclose(found, variance, atol=0.05)
    correlation = fit_correlation(errors, carried, drivers, found[None])[0]
    np.testing.assert_allclose(correlation, mixed @ mixed.T, atol=0.03)


def test_scores_are_in_standard_deviations():
    """Analytic: an error of (3, 4) m in a covariance 4 I is 2.5 standard deviations off; 0.2 rad of 0.1 are 2."""
    position, heading = scores(np.array([[[3.0, 4.0, -0.2]]]), np.diag([4.0, 4.0, 0.01])[None, None])
    np.testing.assert_allclose([position[0, 0], heading[0, 0]], [2.5, 2.0])


def test_heading_error_leaves_the_velocity_over_ground():
    """E18: with the perturbed heading and body velocity, the velocity north and east is the same to first order."""
    rows = np.array([5000, 9000])
    pose, body = perturbed(states(), rows)[0]
    now = [states()[k][rows] for k in ("heading_rad", "surge_m_s", "sway_m_s")]
    before = (now[1] + 1j * now[2]) * np.exp(1j * now[0])
    after = (now[1] + body[:, 0] + 1j * (now[2] + body[:, 1])) * np.exp(1j * (now[0] + pose[:, 2]))
    assert (pose[:, 2] > 1e-4).all()
    np.testing.assert_allclose(after, before, atol=2 * np.abs(before).max() * pose[:, 2].max() ** 2)


def test_own_axes_are_those_of_a_mirrored_turn():
    """Law: errors along, outward and of too much turn are the same numbers in a turn and in its mirror image."""
    turn = integrate((0, 0, 0), np.tile([5.0, -0.5, 0.01], (60, 1)), 1.0)
    mirror = integrate((0, 0, 0), np.tile([5.0, 0.5, -0.01], (60, 1)), 1.0)
    flip = np.diag([1.0, -1.0, -1.0])  # east and heading
    np.testing.assert_allclose((flip @ axes(turn))[1:], axes(mirror)[1:], atol=1e-12)  # at the start nothing has turned
    inward = np.stack([50.0 - turn.north, 500.0 - turn.east], axis=-1)  # the centre lies at i (u + i v) / r
    away = np.einsum("ta,ta->t", axes(turn)[1:, :2, 1], inward[1:]) / np.linalg.norm(inward[1:], axis=-1)
    np.testing.assert_allclose(away, -1.0, atol=1e-9)


def test_populations_are_those_of_the_evaluation():
    """Contract: what is recognised at the start of a prediction is the group that hindsight gives."""
    starts = find_starts(states(), SHIP)
    found = [
        population(states(), int(r), p, 90.0, SHIP.steady_before)
        for r, p in zip(starts.rows, starts.plans, strict=True)
    ]
    assert found == list(starts.groups)
    assert set(POPULATIONS) < set(GROUPS) and len(set(found)) == 3


def test_spread_of_a_batch_is_that_of_one():
    """Law: `predict` has the regions of `predict_many`; they start at the filter's own and are covariances throughout."""
    starts = find_starts(states(), SHIP)
    many = predictor().predict_many(states(), starts.rows[:8], starts.plans[:8])
    row, plan = int(starts.rows[3]), starts.plans[3]
    one = predictor().predict(states().until(states()["time_s"][row]), plan.rudder)
    a, b = one.region(0.9), many.region(0.9)
    np.testing.assert_allclose([a.major, a.minor, a.heading], [b.major[3], b.minor[3], b.heading[3]], rtol=0.02)
    assert np.linalg.eigvalsh(many.spread.covariance).min() > 0
    wider = [many.region(p).area[:, 1:] for p in (0.5, 0.8, 0.95, 0.99)]
    assert (np.diff(wider, axis=0) > 0).all()
    later = many.at([0.0, 45.5, 90.0])
    np.testing.assert_allclose(later.region().area[:, 2], many.region().area[:, -1], rtol=1e-6)
    assert later[2].spread.covariance.shape == (3, 3, 3) and np.isnan(many.at([95.0]).region().major).all()


def test_carried_covariance_is_that_of_drawn_starts():
    """Monte Carlo: 200 starts drawn by the filter's errors (E18 coupling) through the network spread as the covariance tells.

    The standard deviations at 60 s agree within 20 %: 15 % are three standard errors of chance, the rest is what is not linear.
    """
    rows, plan = np.array([9000]), Plan(Orders.held(math.radians(15)))
    path, covariance = predictor().predict_carried(states(), rows, [plan])
    rng = np.random.default_rng(4)
    errors = perturbed(states(), rows)
    part = states().until(states()["time_s"][rows[0]])
    part = replace(part, table=part.table.iloc[-400:].reset_index(drop=True))
    bow, stern = part.vessel.sway_stations
    ends = []
    for _ in range(200):
        draw = rng.normal(size=4)
        pose, body = (sum(z * error[k][0] for z, error in zip(draw, errors, strict=True)) for k in (0, 1))
        du, dv, dr = body
        added = {
            "surge_m_s": du,
            "sway_m_s": dv,
            "sway_bow_m_s": dv + bow * dr,
            "sway_stern_m_s": dv + stern * dr,
            "heading_rad": pose[2],
        }
        moved = part.table.assign(**{k: part.table[k] + v for k, v in added.items()})
        place = rng.normal(size=2) * [states()["north_m_sd"][9000], states()["east_m_sd"][9000]]
        end = GruPredictor(replace(predictor().bundle, calibration=None)).predict_many(
            replace(part, table=moved), np.array([399]), [plan]
        )
        ends.append([end.north[0, 60] + place[0], end.east[0, 60] + place[1], end.heading[0, 60]])
    np.testing.assert_allclose(np.std(ends, axis=0), np.sqrt(np.diag(covariance[0, 60])), rtol=0.2)
    assert np.abs(np.mean(ends, axis=0) - [path.north[0, 60], path.east[0, 60], path.heading[0, 60]])[:2].max() < 0.1


@pytest.mark.parametrize(
    ("lost", "columns", "flagged"),
    [((125, 145), None, True), ((120, 160), ("latitude_deg", "longitude_deg"), True), ((60, 80), None, False)],
)
def test_a_broken_history_is_flagged(lost, columns, flagged):
    """By hand: rows or fixes lost within the 30 s before 150 s flag the prediction; rows lost before do not."""
    log = read_log(ROOT / "data/sample/zigzag-20-20.parquet")
    gone = log.table["time_s"].between(*lost)
    table = log.table.copy()
    if columns is None:
        table = table[~gone].reset_index(drop=True)
    else:
        table.loc[gone, [name for name in table if name.endswith(columns)]] = np.nan
    path = predictor().predict(filter_log(replace(log, table=table)).until(150.0), 0.3)
    assert bool(path.spread.outside) == flagged


def test_outside_is_flagged_and_wider():
    """Contract: a speed beyond training (5 % of slack) is flagged, and the half axes are doubled."""
    end = states().until(900.0)
    fast = end.table.assign(surge_m_s=end.table["surge_m_s"] * 0 + 9.0)
    inside, outside = predictor().predict(end, 0.1), predictor().predict(replace(end, table=fast), 0.1)
    assert not inside.spread.outside and outside.spread.outside
    calm = predictor()
    domain = {name: [-1e3, 1e3] for name in calm.bundle.domain}
    loose = replace(calm.bundle, domain=domain, calibration=calm.bundle.calibration | {"domain": {}})
    usual = GruPredictor(loose).predict(replace(end, table=fast), 0.1)
    assert not usual.spread.outside
    np.testing.assert_allclose(outside.region().major, WIDER * usual.region().major, rtol=1e-9)
    np.testing.assert_allclose(outside.region().heading, WIDER * usual.region().heading, rtol=1e-9)


def test_wind_that_is_not_measured_is_outside_where_calibration_knew_it():
    """Contract: calibrated in measured wind, a start without any is flagged and wider, one in a calibrated wind is not."""
    end = states().until(900.0)
    domain = predictor().bundle.calibration["domain"] | {"wind_speed_true_m_s": [0.0, 12.0]}
    windy = GruPredictor(replace(predictor().bundle, calibration=predictor().bundle.calibration | {"domain": domain}))
    blown = replace(end, table=end.table.assign(wind_speed_true_m_s=5.0, wind_from_grid_rad=1.0))
    known, unknown = windy.predict(blown, 0.1), windy.predict(end, 0.1)
    assert not known.spread.outside and unknown.spread.outside
    np.testing.assert_allclose(unknown.region().major, WIDER * known.region().major, rtol=1e-6)


def test_a_population_that_was_not_calibrated_has_no_region():
    """Contract: NaN where nothing was measured, the other populations keep theirs."""
    plain = json.loads(json.dumps(predictor().bundle.calibration))
    for key in ("position", "heading"):
        del plain[key]["steady"]
    lame = GruPredictor(replace(predictor().bundle, calibration=plain))
    starts = find_starts(states(), SHIP)
    major = lame.predict_many(states(), starts.rows, starts.plans).region().major[:, -1]
    np.testing.assert_array_equal(np.isnan(major), starts.groups == "steady")


def test_calibration_in_the_bundle(tmp_path):
    """Contract: weights unchanged byte by byte; a bundle without the key predicts the same path, without regions."""
    bundle = read_bundle(SHIPPED)
    write_calibration(bundle, SHIPPED, tmp_path / "copy", "card")
    assert sha256(tmp_path / "copy/model.safetensors") == sha256(SHIPPED / "model.safetensors")
    assert read_bundle(tmp_path / "copy").calibration == bundle.calibration
    config = json.loads((tmp_path / "copy/config.json").read_text())
    del config["calibration"]
    (tmp_path / "copy/config.json").write_text(json.dumps(config))
    old = GruPredictor.load(tmp_path / "copy")
    path, new = (p.predict(states().until(700.0), 0.2) for p in (old, predictor()))
    assert path.spread is None
    np.testing.assert_allclose(path.north, new.north, atol=2e-3)  # float32 in another batch
    assert replace(predictor(), region_map=True).predict(states().until(700.0)).spread is None  # not calibrated for it


def test_damaged_calibration_is_refused():
    """Contract: one line with the remedy."""
    plain = predictor().bundle.calibration
    old = {key: value for key, value in plain.items() if key != "usual"}  # of before the fit monitor
    for wrong in ({}, old, plain | {"levels": [0.5, 0.95]}, plain | {"variance": "no"}, plain | {"usual": [1.0]}):
        with pytest.raises(InputError, match="run `aspnn calibrate` again"):
            Calibration.from_dict(wrong, "cargo90")
    assert Calibration.from_dict(plain, "cargo90").levels[FULL] == 0.95
