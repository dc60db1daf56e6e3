"""What `aspnn consistency` says of logs with known faults, of errors against a known truth, and of runs drawn anew."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from aspnn import records
from aspnn.estimation import filter_log
from aspnn.estimation.cascade import run_cascade
from aspnn.estimation.sensors import summarise
from aspnn.evaluation.consistency import (
    consistency,
    verdict,
    words,
    write_metrics,
)
from aspnn.evaluation.consistency_report import table
from aspnn.evaluation.monte_carlo import monte_carlo, redrawer, state_errors
from aspnn.instruments import Calibration
from aspnn.schema import InputError
from aspnn.simulation import Scenario, simulate_scenario, write_voyage
from aspnn.workflow import consistency_files


@pytest.fixture(scope="module")
def sailed():
    """A log of seven minutes of random orders, and its truth."""
    start = {"speed_kn": 11.5, "latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": 200.0}
    scenario = {"name": "sailed", "vessel": "cargo90", "duration_s": 420, "seed": 5, "start": start}
    return next(simulate_scenario(Scenario.model_validate(scenario | {"manoeuvre": {"kind": "random-orders"}})))


@pytest.fixture(scope="module")
def files(sailed, tmp_path_factory):
    """Page, JSON and results of ten runs on that log as files."""
    folder = tmp_path_factory.mktemp("consistency")
    path = write_voyage(*sailed, folder)
    report, metrics = folder / "page.html", folder / "page.json"
    return report.read_text, metrics.read_text, consistency_files([path], report, metrics, 10, 4), path


def faulty(sailed, **columns):
    """The verdicts on the log with columns changed by functions of the column."""
    log = sailed[0]
    changed = log.table.assign(**{name: change(log.table[name]) for name, change in columns.items()})
    return judged(replace(log, table=changed))


def judged(log):
    return {s.sensor: "; ".join(verdict(s)) for s in summarise(run_cascade(log), 60.0)}


def with_noise(log, **noise):
    return replace(log, vessel=replace(log.vessel, noise=replace(log.vessel.noise, **noise)))


def test_a_sound_log_is_consistent(sailed):
    """Oracle: the simulator, whose sensors are those that the vessel's file tells."""
    assert set(judged(sailed[0]).values()) == {""}


def test_noise_set_wrong_is_named(sailed):
    """By construction: the position noise told half or twice its size, NIS towards four times or a quarter."""
    small, large = (judged(with_noise(sailed[0], position=value)) for value in (0.5, 2.0))
    for name in ("bow", "stern"):
        assert "too confident" in small[name] and "too cautious" in large[name]
        assert "aspnn tune" in small[name] and "aspnn tune" in large[name]
    assert "rejected" in small["bow"] and small["heading"] == large["yaw_rate"] == ""


def test_a_late_sensor_is_named_late_and_on_which_side(sailed):
    """By construction: yaw rate or heading half a second late; the correlation with the yaw acceleration tells which."""
    late = faulty(sailed, yaw_rate_deg_s=lambda v: v.shift(5))["heading"]
    assert "early, or the yaw rate late" in late and "biased" not in late
    assert "late (autocorrelation" in faulty(sailed, heading_deg=lambda v: v.shift(5))["heading"]


def test_a_bias_is_named(sailed):
    """By construction: a heading offset of 1 deg moves the antennas abeam by 0.6 m, a station 5 m wrong moves them ahead."""
    turned = faulty(sailed, heading_deg=lambda v: v + 1.0)
    assert all("biased" in turned[name] and "heading offset" in turned[name] for name in ("bow", "stern"))
    assert turned["heading"] == ""
    rated = faulty(sailed, yaw_rate_deg_s=lambda v: v + 0.02)["heading"]
    assert "biased" in rated and "zero of the sensor" in rated


def test_errors_are_those_of_the_truth(sailed):
    """By hand: a truth moved by known amounts moves the errors by as much, with the sign estimated minus true."""
    log, truth = sailed
    cascade = run_cascade(log)
    own = state_errors(cascade, truth, "log")
    moved = truth.assign(
        north_m=truth["north_m"] + 1.0,
        sway_m_s=truth["sway_m_s"] - 0.1,
        heading_rad=truth["heading_rad"] + 2 * np.pi + 0.01,
    )
    other = state_errors(cascade, moved, "log")
    np.testing.assert_allclose(other.error - own.error, np.tile([-1, 0, 0, 0.1, -0.01, 0], (len(log), 1)), atol=1e-8)
    states = filter_log(log)  # whose deviations hold the error of the heading, too (E18)
    columns = ("north_m", "east_m", "surge_m_s", "sway_m_s", "heading_rad", "yaw_rate_rad_s")
    told = np.column_stack([states[f"{name}_sd"] for name in columns])
    np.testing.assert_allclose(own.deviation, told, rtol=1e-9)
    assert np.abs(own.error[600:] / own.deviation[600:]).max() < 6
    assert other.nees["motion"][600:].min() > 20 > 4 > np.mean(own.nees["motion"][600:]) / 2


def test_a_redrawn_log_has_the_same_voyage_and_other_noise(sailed):
    """Statistic: the difference of log and redrawn log has sqrt 2 of each sensor's deviation and no mean; gaps stay gaps."""
    log, truth = sailed
    holed = log.table.copy()
    holed.loc[100:200, "heading_deg"] = np.nan
    holed = holed.drop(columns="acceleration_surge_m_s2")
    late = replace(log.vessel, calibration=Calibration(yaw_rate_delay=0.5))
    draw = redrawer(replace(log, table=holed, vessel=late), truth)
    assert draw(np.random.default_rng(1)).vessel == log.vessel
    other = draw(np.random.default_rng(1)).table
    assert list(other) == list(holed) and (other.isna() == holed.isna()).all(axis=None)
    noise, metre = log.vessel.noise, 111.6e3  # to a degree of latitude at 69.65 N
    for name, deviation in (
        ("yaw_rate_deg_s", np.degrees(noise.yaw_rate)),
        ("heading_deg", np.degrees(noise.heading)),
        ("acceleration_sway_m_s2", noise.acceleration),
        ("bow_latitude_deg", noise.position / metre),
    ):
        apart = (other[name] - holed[name]).dropna().to_numpy()
        apart = (apart + 180) % 360 - 180
        assert np.std(apart) == pytest.approx(np.sqrt(2) * deviation, rel=0.06), name  # five standard errors
        assert abs(np.mean(apart)) < 5 * np.std(apart) / np.sqrt(len(apart)), name
    pd.testing.assert_frame_equal(draw(np.random.default_rng(1)).table, other)
    assert not np.allclose(draw(np.random.default_rng(2)).table["yaw_rate_deg_s"], other["yaw_rate_deg_s"])


def test_monte_carlo_of_a_sound_filter(files):
    """Statistic: N-run averages lie inside 95 % bounds in 91-97 % of the epochs, about 3600 of them; nothing diverges."""
    found = files[2][0].monte_carlo
    assert set(found.nis) == {"heading", "yaw_rate", "bow", "stern", "acceleration", "turning, joint", "motion, joint"}
    for kind in (found.nis, found.lag_one):
        assert all(0.91 < average.shares.inside < 0.97 for average in kind.values()), kind
    assert np.mean(found.nis["motion, joint"].value) == pytest.approx(6.0, abs=0.1)
    assert found.diverged == 0 and found.runs == 10
    assert found.rms == pytest.approx(np.sqrt(np.mean(files[2][0].errors.error ** 2, axis=0)), rel=0.7)


def test_monte_carlo_repeats_itself_and_finds_divergence(sailed):
    """Law: one seed, one result; a filter that believes the ship never turns is counted as diverged in every run."""
    log, truth = sailed
    first, again, other = (monte_carlo(log, truth, 2, seed, 60.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.nis["bow"].value, again.nis["bow"].value)
    assert not np.array_equal(first.nis["bow"].value, other.nis["bow"].value)
    stiff = with_noise(log, yaw_jerk_density=1e-16, jerk_density=1e-14)
    found = consistency(stiff, truth, 2, 1)
    assert found.monte_carlo.diverged == 2 and "2 of 2 runs diverged: the process noise is too small." in words(found)


def test_the_page_stands_alone(files):
    """No address is loaded, the browser is forbidden to fetch, all figures and tables are there, below 2 MB per log."""
    from plotly.offline import get_plotlyjs

    page = files[0]()
    assert not re.findall(r"""(?:src|href)\s*=\s*\\?["']?\s*(?:https?:)?//[^"'\s]*""", page)
    assert "default-src 'none'" in page and "Monte Carlo" in page
    for name in ("nis", "correlations", "quantiles", "errors", "averages"):
        assert page.count(f'id="{name}-0"') == 1
    assert len(page) - len(get_plotlyjs()) < 2e6


def test_json_holds_what_was_measured(files):
    """Every sensor, state and average is there, as numbers that JSON knows."""
    log = json.loads(files[1]())["logs"][0]
    assert log["log"] == "sailed.parquet" and len(log["sha256"]) == 64 and log["since_s"] == 60.0
    assert set(log["sensors"]) == {"heading", "yaw_rate", "bow", "stern", "acceleration"}
    assert log["sensors"]["bow"]["shares"]["inside"] == pytest.approx(0.95, abs=0.02)
    assert [row["state"] for row in log["errors"]][-1] == "yaw_rate" and log["nees"]["motion"]["dof"] == 4
    unknown = replace(files[2][0], summaries=(replace(files[2][0].summaries[0], autocorrelation=np.nan),))
    write_metrics([unknown], files[3].with_suffix(".json"))
    again = json.loads(files[3].with_suffix(".json").read_text(), parse_constant=pytest.fail)
    assert again["logs"][0]["sensors"]["heading"]["autocorrelation"] is None
    assert log["monte_carlo"]["runs"] == 10 and set(log["monte_carlo"]["nees"]) == {"motion", "turning"}


def test_the_last_line_is_the_verdict(files):
    """What is printed ends with the verdict on every sensor."""
    printed = io.StringIO()
    Console(width=140, file=printed).print(table(files[2]))
    lines = printed.getvalue().strip().splitlines()
    assert lines[-1] == "Consistent: heading, yaw_rate, bow, stern, acceleration." == words(files[2][0])[-1]
    assert any(line.startswith("10 runs in ") and line.endswith("0 diverged.") for line in lines)


def test_a_log_without_truth_is_judged_by_its_innovations(sailed, tmp_path):
    """Law: without truth no errors and no runs; asking for runs is a line that names the log."""
    log = sailed[0]
    records.write_log(log, tmp_path / "alone.parquet")
    found = consistency_files([tmp_path / "alone.parquet"], tmp_path / "page.html")[0]
    assert found.errors is None and found.monte_carlo is None and (tmp_path / "page.html").exists()
    with pytest.raises(InputError, match=r"alone\.parquet: no truth"):
        consistency_files([tmp_path / "alone.parquet"], tmp_path / "other.html", runs=2)
    assert not (tmp_path / "other.html").exists()


def test_a_truth_of_other_epochs_is_refused(sailed):
    log, truth = sailed
    with pytest.raises(InputError, match="other epochs"):
        consistency(log, truth.iloc[1:])
    with pytest.raises(InputError, match="no UTM zone"):
        redrawer(replace(log, zone=None), truth)
