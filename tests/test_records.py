"""Records: files give back what was written bit for bit, are whole or not there, and say in one line what is wrong."""

import json
import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn import checks, records, schema
from aspnn.frames import Zone
from aspnn.records import Log, States
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

VESSEL = load_vessel("cargo90").with_stations(mast=(10.0, -2.5))
ROWS = 40


def a_log(**changes) -> Log:
    """A log on the grid whose numbers fill all 53 bits, with a sensor that misses epochs and a note."""
    draw = np.random.default_rng(3)
    time = np.arange(ROWS) * 0.1
    table = pd.DataFrame(
        {
            "time_s": time,
            "bow_north_m": 8.5e6 + 5 * time + draw.normal(size=ROWS),
            "bow_east_m": 434061 + draw.normal(size=ROWS),
            "heading_deg": draw.uniform(0, 360, ROWS),
            "yaw_rate_deg_s": draw.normal(size=ROWS) * 1e-3,
            "rudder_order_deg": np.where(time < 2, np.nan, 1 / 3),
            "depth_m": np.nan,
        }
    )
    notes = {"dropped": {"bad checksum": 3}}
    log = Log(table, VESSEL, start="2024-05-01T10:00:00Z", source="a test", voyage="v 1", notes=notes)
    return replace(log, **changes)


def some_states() -> States:
    draw = np.random.default_rng(4)
    table = pd.DataFrame({c.name: draw.normal(size=ROWS) for c in schema.STATES if "NAME" not in c.name})
    table["time_s"] = np.arange(ROWS) * 0.1
    table["north_m"] += 8.5e6
    table["wind_speed_true_m_s"] = np.nan
    for flag in ("gated", "stale", "coasting"):
        table[flag] = draw.uniform(size=ROWS) > 0.5
    return States(table, VESSEL, Zone(33), "2024-05-01T10:00:00Z", "a test", "v 1", smoothed=True)


def same(a, b):
    """All fields equal but the path; tables bit for bit, NaN where NaN was."""
    pd.testing.assert_frame_equal(a.table, b.table, check_exact=True)
    assert replace(a, table=None, path="") == replace(b, table=None, path="")


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_log_round_trip(tmp_path, ending):
    """Round trip, exact: numbers, NaN, vessel with its stations, zone, start, source, voyage, notes."""
    for zone in (None, Zone(33), Zone(56, north=False)):
        path = tmp_path / f"voyage-1.5{ending}"
        log = a_log(zone=zone)
        records.write_log(log, path)
        again = records.read_log(path)
        same(again, log)
        assert again.path == str(path)


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_states_round_trip(tmp_path, ending):
    """Round trip, exact, with flags as booleans and the mark of smoothed states."""
    states = some_states()
    records.write_states(states, tmp_path / f"x{ending}")
    again = records.read_states(tmp_path / f"x{ending}")
    same(again, states)
    assert again.table["gated"].dtype == bool and again.smoothed


def test_csv_numbers_are_exact(tmp_path):
    """Round trip of 20,000 numbers over twenty decades: pandas writes the shortest decimal and reads it back as that float64."""
    draw = np.random.default_rng(5)
    table = pd.DataFrame({"x": draw.normal(size=20000) * 10 ** draw.uniform(-12, 8, 20000)})
    records.write_table(table, tmp_path / "x.csv", {})
    pd.testing.assert_frame_equal(records.read_table(tmp_path / "x.csv")[0], table, check_exact=True)


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_writing_that_fails_leaves_what_was_there(tmp_path, ending):
    """Law of atomic writes: an exception in the middle leaves the old file, byte for byte, and nothing beside it."""
    path = tmp_path / f"x{ending}"
    records.write_log(a_log(), path)
    before = path.read_bytes()
    with pytest.raises(KeyboardInterrupt), records.atomic(path) as temporary:
        temporary.write_bytes(b"half")
        raise KeyboardInterrupt
    with pytest.raises(TypeError):
        records.write_log(a_log(notes={"dropped": {1, 2}}), path)  # a set is not JSON
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


def test_killed_writer_leaves_no_half_file(tmp_path):
    """A process that dies inside the block, as by SIGKILL: no file by that name, and no log is found in the folder."""
    code = (
        "import os, sys; from aspnn.records import atomic\n"
        "with atomic(sys.argv[1]) as temporary:\n"
        "    temporary.write_bytes(b'half'); os._exit(9)"
    )
    path = tmp_path / "new" / "x.parquet"
    assert subprocess.run([sys.executable, "-c", code, str(path)]).returncode == 9
    assert not path.exists()
    with pytest.raises(InputError, match="holds no log"):
        records.log_files([tmp_path])


def test_written_file_has_the_usual_permissions(tmp_path):
    """Those of a file that `open` makes, not the private ones of a temporary file."""
    records.write_log(a_log(), tmp_path / "x.parquet")
    (tmp_path / "plain").touch()
    assert (tmp_path / "x.parquet").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_json_has_no_infinity(tmp_path):
    """Oracle: the JSON standard: what is not finite is null; numpy's numbers and arrays are JSON's."""
    value = {"a": math.inf, 2: (1.0, math.nan), "c": "inf", "d": np.array([1.5, -np.inf]), "e": np.int64(3), "f": True}
    records.write_json(value, tmp_path / "value.json")
    found = json.loads((tmp_path / "value.json").read_text(), parse_constant=pytest.fail)
    assert found == {"a": None, "2": [1.0, None], "c": "inf", "d": [1.5, None], "e": 3, "f": True}


def test_sha256_is_that_of_the_standard(tmp_path):
    """FIPS 180-4, appendix B.1: the digest of "abc"."""
    (tmp_path / "abc").write_bytes(b"abc")
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert records.sha256(tmp_path / "abc") == digest


def says(words, call, *arguments):
    """The call refuses with one line that holds the words."""
    with pytest.raises(InputError, match=words) as error:
        call(*arguments)
    assert "\n" not in str(error.value)


def test_files_that_are_no_log_are_one_line(tmp_path):
    """Contract: absent, empty, truncated, of another kind, without metadata, a Parquet file's name on something else."""
    whole = tmp_path / "whole.parquet"
    records.write_log(a_log(), whole)
    (tmp_path / "empty.parquet").touch()
    (tmp_path / "torn.parquet").write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    (tmp_path / "text.parquet").write_text("time_s,heading_deg\n")
    (tmp_path / "foreign.csv").write_text("Time,Heading\n0,1\n")
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00")
    records.write_states(some_states(), tmp_path / "states.parquet")
    says("absent.parquet: no such file", records.read_log, tmp_path / "absent.parquet")
    says("empty.parquet: the file is empty", records.read_log, tmp_path / "empty.parquet")
    for name in ("torn.parquet", "text.parquet", "bytes.csv"):
        says(f"{name}: cannot be read, it is damaged", records.read_log, tmp_path / name)
    says("foreign.csv: .*aspnn import csv .*foreign.csv --map", records.read_log, tmp_path / "foreign.csv")
    says("states.parquet: holds states, expected log", records.read_log, tmp_path / "states.parquet")
    says("whole.parquet: holds log, expected states", records.read_states, whole)


def test_states_with_a_missing_column_are_one_line(tmp_path):
    """Contract: the file and the column are named."""
    states = some_states()
    records.write_states(replace(states, table=states.table.drop(columns="sway_m_s")), tmp_path / "x.parquet")
    says("x.parquet: column sway_m_s is missing", records.read_states, tmp_path / "x.parquet")


def with_value(column, row, value):
    log = a_log()
    table = log.table.copy()
    table.loc[row, column] = value
    return replace(log, table=table)


@pytest.mark.parametrize(
    "log, words",
    [
        (with_value("time_s", 7, 0.3), r"row 7 \(time 0.3 s\), column time_s: time runs back by 0.3 s; sort"),
        (with_value("time_s", 7, 0.6), r"row 7 .*column time_s: the epoch stands twice; drop"),
        (with_value("time_s", 7, 0.6 + 1e-9), r"row 7 .*column time_s: the epoch stands twice; drop"),
        (with_value("time_s", 7, np.nan), r"row 7 .*column time_s: time is missing; drop"),
        (with_value("heading_deg", 5, 1e4), r"row 5 \(time 0.5 s\), column heading_deg: 10000 is outside .*unit"),
        (with_value("depth_m", 5, np.inf), r"row 5 .*column depth_m: is infinite; leave it empty"),
        (with_value("yaw_rate_deg_s", 0, -61.0), r"row 0 .*yaw_rate_deg_s: -61 is outside -60 to 60"),
        (replace(a_log(), table=a_log().table[:1]), r"holds 1 rows, at least 2"),
        (
            replace(a_log(), table=a_log().table.drop(columns="bow_east_m")),
            r".*bow_east_m is missing beside bow_north_m",
        ),
        (replace(a_log(), table=a_log().table.drop(columns=["bow_north_m", "bow_east_m"])), r"no antenna has"),
        (replace(a_log(), table=a_log().table.assign(deck_north_m=0.0, deck_east_m=0.0)), r".*add stations_m.deck"),
        (replace(a_log(), table=a_log().table.assign(heading_deg=["x"] * ROWS)), r"row 0, column heading_deg: 'x' is"),
        (
            replace(a_log(), table=a_log().table.assign(mast_latitude_deg=70.0, mast_longitude_deg=15.0)),
            r'.*no UTM zone; name it when importing \(zone = "33N"\)',
        ),
        (
            replace(
                a_log(), table=a_log().table.assign(mast_latitude_deg=[70.0] * 9 + [700.0] * 31, mast_longitude_deg=1.0)
            ),
            r"row 9 .*mast_latitude_deg: 700 is outside -90 to 90",
        ),
    ],
)
def test_wrong_log_is_one_line(log, words):
    """Contract: file, row, time, column and the remedy."""
    says(f"f.csv: {words}", checks.check_log, log, "f.csv")


def test_right_log_passes():
    """The other side of the tests above: the log they spoil is accepted, missing sensors and gaps included."""
    checks.check_log(a_log())
    checks.check_log(replace(a_log(), table=a_log().table.drop(index=range(10, 20))))


def test_reading_checks_the_log(tmp_path):
    """Contract: what check_log refuses cannot be read, and the file is named."""
    records.write_log(with_value("time_s", 7, 0.6), tmp_path / "x.parquet")
    says("x.parquet: row 7 .*stands twice", records.read_log, tmp_path / "x.parquet")


@pytest.mark.parametrize("name", ["zigzag", "zigzag-20.5-run.2"])
def test_truth_lies_beside_its_log(tmp_path, name):
    """Contract: X.truth.parquet beside X.parquet, whatever dots X holds; None where there is none."""
    records.write_log(a_log(), tmp_path / f"{name}.parquet")
    log = records.read_log(tmp_path / f"{name}.parquet")
    assert records.read_truth(log) is None and records.read_truth(a_log()) is None
    truth = pd.DataFrame({c.name: np.arange(3.0) for c in schema.TRUTH})
    records.write_table(truth, tmp_path / f"{name}.truth.parquet", {})
    pd.testing.assert_frame_equal(records.read_truth(log), truth)
    assert records.log_files([tmp_path]) == [tmp_path / f"{name}.parquet"]


def test_log_files_are_found_in_files_and_folders(tmp_path):
    """By hand: sorted, folders within folders, never truth, states or hidden files."""
    for name in ("b.parquet", "a.csv", "in/c.parquet", "b.truth.parquet", "b.states.parquet", ".b.parquet.x.parquet"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = records.log_files([tmp_path, tmp_path / "b.parquet"])
    assert [str(p.relative_to(tmp_path)) for p in found] == ["a.csv", "b.parquet", "in/c.parquet", "b.parquet"]
    says("no such file or folder", records.log_files, [tmp_path / "absent"])
    says("no log was given", records.log_files, [])


def test_states_until_know_nothing_later():
    """Definition: up to and including the time; an error where that is nothing."""
    states = some_states()
    assert states.until(2.0)["time_s"][-1] == 2.0 and len(states.until(2.0)) == 21
    assert len(states.until(1.95)) == 20 and len(states.until(1e9)) == ROWS
    np.testing.assert_array_equal(states.until(2.0)["surge_m_s"], states["surge_m_s"][:21])
    says("nothing is known at -1 s, the first state is at 0 s", states.until, -1.0)


def test_states_read_at_once_are_those_of_the_table():
    """Oracle: the table itself, column by column, also of a part; changed states are read anew."""
    states = some_states()
    part = states.read(1)
    assert part.read() is part
    for name in states.table.columns:
        np.testing.assert_array_equal(part[name], states[name][1:])
    with pytest.raises(ValueError, match="read-only"):
        part["time_s"][0] = 1.0
    other = replace(part, table=part.table.assign(surge_m_s=7.0))
    assert (other["surge_m_s"] == 7.0).all()
    assert len(part.until(float(part["time_s"][0]))) == 1
