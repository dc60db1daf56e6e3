"""The record: what was given in comes out of the files, also after a kill, and disks that fail do not stop anything."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest

from aspnn.live.forecast import Ended, Forecaster
from aspnn.live.record import COLUMNS, PART, Recorder
from aspnn.records import read_log, read_states, read_table
from aspnn.vessel import load_vessel
from tests.live.stand_in import ZONE, Straight, turning

BEGAN = 1_700_000_000.0


def rows(first, count):
    for k in range(count):
        time = first + k / 10
        yield time, {"bow_latitude_deg": 69.0 + k * 1e-7, "bow_longitude_deg": 18.0, "heading_deg": float(k % 360)}


def recorder(folder, **more):
    return Recorder(folder, load_vessel("cargo90"), ZONE, **{"hours": 1.0, **more})


def test_a_part_is_a_log_and_states_that_the_commands_read(tmp_path):
    """Law: every row and state comes back by the ordinary readers (which check them), with the times they had."""
    states = turning(20.0)
    r = recorder(tmp_path)
    for k in range(20):
        r.rows(rows(BEGAN + k, 10))
        r.states(states.table.iloc[10 * k : 10 * k + 10], BEGAN)
        r.flush(BEGAN + k)
    r.ended([Ended(3.0, 30.0, 1.5, 2.5, True), Ended(4.0, 30.0, math.nan, 2.5, None)], BEGAN)
    r.close()
    assert r.error == "" and not list(tmp_path.glob("*.jsonl"))
    log = read_log(next(tmp_path.glob("log-*.parquet")))
    assert len(log) == 200 and log.start == "2023-11-14T22:13:20Z"
    np.testing.assert_allclose(log.table["time_s"], np.arange(200) / 10, atol=1e-6)
    back = read_states(next(tmp_path.glob("states-*.parquet")))
    assert len(back) == 200 and back.table["coasting"].dtype == bool
    np.testing.assert_array_equal(back["surge_m_s"], states["surge_m_s"][:200])
    table, _ = read_table(next(tmp_path.glob("errors-*.parquet")))
    np.testing.assert_array_equal(table["arc_m"], [2.5, 2.5])
    np.testing.assert_array_equal(table["inside"], [1.0, np.nan])
    assert table["start_s"].tolist() == [BEGAN + 3, BEGAN + 4]


def test_predictions_are_kept_as_they_were_made(tmp_path):
    """Oracle: the forecasts themselves: one a second, at each horizon places, heading and the 95 % region (a disc of 5 m, 2.4477 x 5 m)
    of ours and the arc's; without a predictor the arc's alone, and the columns stay."""
    states = turning(30.0)
    forecaster = Forecaster(Straight(), states.vessel)
    r = recorder(tmp_path, model="straight")
    for k in range(4):  # two a second
        found = dataclasses.replace(forecaster.predict(states), start=10.0 + k / 2)
        r.forecast(found, forecaster.horizons, 0.1, BEGAN)
    alone = Forecaster(None, states.vessel)
    r.forecast(dataclasses.replace(alone.predict(states), start=12.0), alone.horizons, math.nan, BEGAN)
    r.flush(BEGAN)
    r.close()
    assert r.error == ""
    table, metadata = read_table(next(tmp_path.glob("predictions-*.parquet")))
    assert metadata["model"] == "straight" and metadata["zone"] == str(ZONE)
    assert list(table.columns) == COLUMNS["predictions"]
    assert table["start_s"].tolist() == [BEGAN + 10] * 3 + [BEGAN + 11] * 3 + [BEGAN + 12] * 3
    assert table["horizon_s"].tolist() == [30.0, 60.0, 90.0] * 3
    path, arc = found.path.at(forecaster.horizons), found.arc.at(forecaster.horizons)
    for name, values in (("north_m", path.north), ("east_m", path.east), ("heading_rad", path.heading)):
        np.testing.assert_allclose(table[name][3:6], values, atol=1e-6)
        np.testing.assert_allclose(table[f"arc_{name}"][3:6], getattr(arc, name.partition("_")[0]), atol=1e-6)
        assert table[name][6:].isna().all() and table[f"arc_{name}"].notna().all()
    np.testing.assert_allclose(table["region_major_m"][:6], 5 * math.sqrt(5.991), atol=0.01)
    assert table["rudder_order_rad"][:6].tolist() == [0.1] * 6


def test_a_kill_loses_one_second_at_most(tmp_path):
    """Law: a process that never closes leaves journals with all but the rows since the last flush; the next start makes them
    Parquet, and passes over a line that was half written."""
    killed = recorder(tmp_path)
    for k in range(100):
        killed.rows(rows(BEGAN + k / 10, 1))
        killed.flush(BEGAN + k / 10)
    last = BEGAN + 9.9
    journal = next(tmp_path.glob("log-*.jsonl"))
    with open(journal, "a") as file:
        file.write('{"time_s": 17000')
    del killed
    recorder(tmp_path)
    log = read_log(next(tmp_path.glob("log-*.parquet")))
    assert BEGAN + log.table["time_s"].iloc[-1] >= last - 1.0 - 1e-6
    assert not list(tmp_path.glob("*.jsonl"))


def test_parts_roll_and_the_oldest_go(tmp_path):
    """Law: a new part every PART seconds, none older than the hours to keep, and other files of the folder stay."""
    (tmp_path / "state.npz").write_text("mine")
    r = recorder(tmp_path, hours=0.5)
    steps = int(3 * 3600 / 10)
    for k in range(steps):
        r.rows([(BEGAN + 10.0 * k, {"heading_deg": 1.0, "bow_latitude_deg": 69.0, "bow_longitude_deg": 18.0})])
        r.flush(BEGAN + 10.0 * k)
    files = sorted(tmp_path.glob("log-*"))
    assert len(files) <= 0.5 * 3600 / PART + 3
    assert sum(f.suffix == ".jsonl" for f in files) == 1
    assert (tmp_path / "state.npz").read_text() == "mine"


def test_a_disk_that_fails_is_told_and_nothing_is_lost_when_it_comes_back(tmp_path, monkeypatch):
    """Law: an OSError is kept as a line; the rows of meanwhile are written once it is over."""
    r = recorder(tmp_path)
    r.rows(rows(BEGAN, 5))
    with monkeypatch.context() as broken:

        def full(*_, **__):
            raise OSError(28, "No space left on device", "log.jsonl")

        broken.setattr("builtins.open", full)
        r.flush(BEGAN)
        assert "No space left" in r.error and r.waiting == 5
    r.rows(rows(BEGAN + 0.5, 5))
    r.flush(BEGAN + 1.5)
    assert r.error == "" and r.waiting == 0
    r.close()
    assert len(pd.read_parquet(next(tmp_path.glob("log-*.parquet")))) == 10


def test_memory_is_bounded_while_the_disk_fails(tmp_path):
    """Law: rows beyond what may wait are given up, the oldest first, and counted."""
    blocked = tmp_path / "file"
    blocked.write_text("")
    r = recorder(blocked / "folder")
    assert r.error
    r.rows(rows(BEGAN, 13_000))
    assert r.waiting == 12_000 and r.lost == 1_000


@pytest.mark.parametrize("back", [5.0, 0.4])
def test_a_clock_that_runs_back_overwrites_nothing(tmp_path, back):
    """Law: a second part of the same stamp gets a name of its own."""
    r = recorder(tmp_path)
    for shift in (0.0, -back, 0.0):
        r.rows(rows(BEGAN + shift, 3))
        r.flush(BEGAN + shift)
        r.close()
    found = sum(len(pd.read_parquet(f)) for f in tmp_path.glob("log-*.parquet"))
    assert found == 9
    assert r.error == ""
