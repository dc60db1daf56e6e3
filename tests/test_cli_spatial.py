"""`aspnn filter --spatial` and `aspnn mount`: files written, a mounting found and used, and wrong input in one line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from aspnn import records
from aspnn.instruments import Mounting
from tests.estimation.boats import Boat, Errors, boat_log
from tests.test_cli import run

TRUE = Mounting(("x", "-y", "-z"), tuple(np.radians([1.2, -0.8, 1.7])), -1.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A log whose IMU sits upside down, a few degrees off, and reads the reaction, while its vessel says nothing of it."""
    path = tmp_path_factory.mktemp("boat") / "boat.parquet"
    records.write_log(boat_log(Boat(), 180.0, Errors(), 61, TRUE, Mounting())[0], path)
    return path


def test_a_mounting_is_found_written_and_used(recorded, tmp_path, capsys):
    """Oracle: the mounting that made the log, and the boat's formulas for surge from the states filtered with it."""
    found = tmp_path / "mounting.json"
    assert run("mount", recorded, "--out", found) == (0, "")
    text = capsys.readouterr().out
    assert "axes x, -y, -z; reads the reaction" in text and '"imu": {"axes": ["x", "-y", "-z"]' in text
    told = json.loads(found.read_text())
    np.testing.assert_allclose(told["imu"]["misalignment_deg"], [1.2, -0.8, 1.7], atol=0.3)
    assert run("filter", recorded, "--out", tmp_path, "--spatial", "--noise", found, "--quiet") == (0, "")
    states = records.read_states(tmp_path / "boat.states.parquet")
    assert states.vessel.mounting.axes == TRUE.axes and "gyro_bias_yaw_rad_s" in states.table
    time = states["time_s"]
    assert np.abs(states["surge_m_s"] - Boat().level(time)[:, 0])[time > 60].max() < 0.2


def test_the_vessel_file_carries_the_mounting_and_the_noise(recorded, tmp_path):
    """Law: a log written and read again has the same mounting and the same expectations in three dimensions."""
    log = records.read_log(recorded)
    vessel = replace(log.vessel, mounting=TRUE, spatial=replace(log.vessel.spatial, attitude=0.003))
    records.write_log(replace(log, vessel=vessel), tmp_path / "again.parquet")
    again = records.read_log(tmp_path / "again.parquet").vessel
    assert again.spatial == vessel.spatial and again.mounting.axes == TRUE.axes
    np.testing.assert_allclose(again.mounting.matrix(), TRUE.matrix(), atol=1e-15)


def test_bad_input_is_one_line_and_writes_nothing(recorded, tmp_path):
    """Law: exit code 2, one line with the remedy, no file."""
    log = records.read_log(recorded)
    upright = replace(log, vessel=replace(log.vessel, mounting=Mounting(("x", "-y", "-z"))))
    records.write_log(upright, tmp_path / "wrong.parquet")
    records.write_log(replace(log, table=log.table.drop(columns="roll_deg")), tmp_path / "level.parquet")
    wrong = {"vessel": log.vessel.name, "spatial": {"heigth_m": 1.0}}
    (tmp_path / "noise.json").write_text(json.dumps(wrong))
    out = ("--out", tmp_path / "out")
    cases = {
        "reads": (("filter", tmp_path / "wrong.parquet", "--spatial", *out), "set imu in the vessel file to axes"),
        "attitude": (("filter", tmp_path / "level.parquet", "--spatial", *out), "roll_deg has no value"),
        "smooth": (("filter", recorded, "--spatial", "--smooth", *out), "leave out --spatial or --smooth"),
        "key": (("filter", recorded, "--spatial", "--noise", tmp_path / "noise.json", *out), "did you mean height_m"),
        "mount": (("mount", tmp_path / "level.parquet", *out), "roll_deg has no value"),
    }
    for case, (words, reason) in cases.items():
        code, text = run(*words)
        assert code == 2 and text.startswith("error: ") and text.count("\n") == 1 and reason in text, (case, text)
        assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir()), case
