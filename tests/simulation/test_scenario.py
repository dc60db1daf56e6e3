"""Scenarios: the files, their errors, and voyages that do not depend on the batch."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn import schema
from aspnn.checks import check_log
from aspnn.frames import Zone, to_grid
from aspnn.records import log_files, read_log, read_truth
from aspnn.schema import InputError
from aspnn.simulation import Scenario, read_scenario, scenario, simulate_scenario, write_voyage

SCENARIOS = Path(__file__).parents[2] / "data" / "scenarios"
BASE = """
vessel = "cargo90"
voyages = 3
duration_s = 60
seed = 7
[start]
speed_kn = 11.5
latitude_deg = 69.65
longitude_deg = 18.96
zone = "33N"
heading_deg = "random"
[manoeuvre]
kind = "random-orders"
hold_s = [5, 15]
[environment]
current_kn = [0, 2]
current_towards_deg = "random"
wind_kn = 10
wind_from_deg = 90
"""


@pytest.fixture
def given(tmp_path):
    """Writes a scenario file from text and reads it."""

    def read(text=BASE):
        (tmp_path / "trip.toml").write_text(text)
        return read_scenario(tmp_path / "trip.toml")

    return read


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_scenarios_of_the_repository_run(path):
    """Contract: the first minute and a half of each gives a log and a truth that hold to the schema."""
    one = read_scenario(path).model_copy(update={"duration_s": 90.0})
    log, truth = next(simulate_scenario(one, voyages=1))
    check_log(log, path.name)
    schema.check(truth, schema.TRUTH, path.name)
    np.testing.assert_array_equal(truth["time_s"], log.table["time_s"])


def test_standard_voyages_are_as_specified():
    """Oracle: the project's definition of the standard voyages."""
    train, test, current = (read_scenario(SCENARIOS / f"cargo90-{name}.toml") for name in ("train", "test", "current"))
    assert (train.voyages, train.duration_s, test.voyages) == (10, 1800, 60)
    files = list(SCENARIOS.glob("cargo90-*.toml"))
    assert len({read_scenario(path).seed for path in files}) == len(files) >= 5
    assert test.manoeuvre == train.manoeuvre and test.start == train.start and test.sensors == train.sensors
    assert current.environment.current_kn[1] * scenario.KNOT == pytest.approx(1.0, abs=1e-3)


def test_a_voyage_is_the_same_whatever_the_batch(given, monkeypatch):
    """Oracle: bit by bit, alone, among others and in other batches; other seeds and voyages differ."""
    trip = given()
    one = list(simulate_scenario(trip, voyages=1))
    three = list(simulate_scenario(trip))
    monkeypatch.setattr(scenario, "BATCH", 2)
    five = list(simulate_scenario(trip, voyages=5))
    for few, many in ((one, three), (three, five)):
        for (log, truth), (other, same) in zip(few, many, strict=False):
            pd.testing.assert_frame_equal(log.table, other.table, check_exact=True)
            pd.testing.assert_frame_equal(truth, same, check_exact=True)
            assert log.voyage == other.voyage
    assert [log.voyage for log, _ in five] == [f"trip-{k:04d}" for k in range(5)]
    assert len({truth["heading_rad"].iloc[0] for _, truth in five}) == 5
    other = next(simulate_scenario(trip, voyages=1, seed=8))
    assert other[0].voyage == "trip-s8-0000" and not other[1].equals(one[0][1])


def test_other_sensors_leave_the_voyage_as_it_is(given):
    """Law: the truth does not know its sensors."""
    trip = given()
    dull = given(BASE + "[sensors]\nposition_m = 5\nacceleration_hz = 0\n")
    pd.testing.assert_frame_equal(next(simulate_scenario(trip))[1], next(simulate_scenario(dull))[1], check_exact=True)


def test_the_start_is_where_and_how_the_scenario_says(given):
    """Oracle: pyproj's grid, true directions less the convergence of 3.71 degrees (E44)."""
    trip = given(BASE.replace('heading_deg = "random"', "heading_deg = 30"))
    _, truth = next(simulate_scenario(trip))
    first = truth.iloc[0]
    np.testing.assert_allclose(
        [first.north_m, first.east_m], to_grid(np.radians(69.65), np.radians(18.96), Zone.parse("33N"))
    )
    assert np.degrees(first.heading_rad) == pytest.approx(30 - 3.709, abs=1e-2)
    assert np.degrees(first.wind_from_grid_rad) == pytest.approx(90 - 3.709, abs=1e-2)
    assert first.wind_speed_true_m_s == pytest.approx(10 * 1852 / 3600)
    water = np.array([first.surge_m_s, first.sway_m_s]) - rotate(first)
    np.testing.assert_allclose(water, [11.5 * 1852 / 3600, 0], atol=1e-9)


def rotate(row):
    current = (row.current_north_m_s + 1j * row.current_east_m_s) * np.exp(-1j * row.heading_rad)
    return np.array([current.real, current.imag])


def test_files_hold_log_and_truth_apart(given, tmp_path):
    """Contract: read_log and read_truth give back what was written, and a truth is never found as a log."""
    log, truth = next(simulate_scenario(given()))
    path = write_voyage(log, truth, tmp_path / "out")
    assert path.name == "trip-0000.parquet" and log_files([tmp_path / "out"]) == [path]
    back = read_log(path)
    pd.testing.assert_frame_equal(back.table, log.table)
    pd.testing.assert_frame_equal(read_truth(back), truth)
    assert back.voyage == "trip-0000" and back.start.endswith("Z") and "seed 7" in back.source
    assert not {"surge_m_s", "north_m"} & set(back.table.columns)


@pytest.mark.parametrize(
    "change, message",
    [
        (('vessel = "cargo90"', ""), "vessel: is missing"),
        (("seed = 7", "sede = 7"), "sede: is not a known key"),
        (("speed_kn = 11.5", 'speed_kn = "fast"'), "start.speed_kn"),
        (('zone = "33N"', 'zone = "33W"'), "start.zone: zone '33W' is not a UTM zone"),
        (('kind = "random-orders"', 'kind = "slalom"'), "manoeuvre: input tag 'slalom'"),
        (("hold_s = [5, 15]", "hold_s = [15, 5]"), "manoeuvre.hold_s: the range runs from 15 down to 5"),
        (("hold_s = [5, 15]", "hold = [5, 15]"), "manoeuvre.hold: is not a known key"),
        (("duration_s = 60", "duration_s = -1"), "duration_s: input should be greater than 1"),
        (("wind_kn = 10", "wind_kn = [1, 2, 3]"), "environment.wind_kn"),
        (("[environment]", "[sensors]\nfog = 1\n[environment]"), "sensors.fog: is not a known key"),
        (("[environment]", "[sensors]\nheading_hz = -1\n[environment]"), "sensors.heading_hz: input should be"),
        (("[start]", "[start"), "cannot be read as TOML"),
    ],
)
def test_a_wrong_scenario_is_one_line_with_file_and_key(given, change, message):
    """Oracle: the message names file and key, in one line."""
    with pytest.raises(InputError) as error:
        given(BASE.replace(*change))
    text = str(error.value)
    assert "trip.toml: " in text and message in text and "\n" not in text


def test_what_the_vessel_cannot_do_is_said(given, tmp_path):
    """Oracle: the messages."""
    with pytest.raises(InputError, match=r"manoeuvre\.rudder_deg = 40 is beyond the 35 degrees of cargo90"):
        next(simulate_scenario(given(BASE.replace("hold_s", "rudder_deg = 40\nhold_s"))))
    with pytest.raises(InputError, match="vessel cargo91 is not known"):
        next(simulate_scenario(given(BASE.replace("cargo90", "cargo91"))))
    with pytest.raises(InputError, match="has no section wind"):
        next(simulate_scenario(given(BASE.replace("cargo90", "kvlcc2_full"))))
    with pytest.raises(InputError, match=r"nowhere.toml: no such file"):
        read_scenario(tmp_path / "nowhere.toml")


def test_a_scenario_can_be_made_in_code():
    """Contract: the same model validates plain data."""
    trip = Scenario.model_validate(
        {
            "name": "inline",
            "vessel": "kvlcc2_l7",
            "duration_s": 20,
            "step_s": 0.02,
            "start": {"speed_kn": 2.3, "latitude_deg": 34, "longitude_deg": 135, "zone": "53N", "heading_deg": 10},
            "manoeuvre": {"kind": "zigzag", "rudder_deg": 10, "heading_change_deg": 10, "start_s": 2},
        }
    )
    log, truth = next(simulate_scenario(trip))
    assert log.voyage == "inline" and len(log) == 201 and len(truth) == 201
    assert np.degrees(truth["rudder_angle_rad"]).abs().max() == pytest.approx(10)
