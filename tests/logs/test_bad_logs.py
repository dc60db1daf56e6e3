"""Bad logs, as files: what read_log refuses is one line with file, row or time, column and remedy. Oracle: the spoiling itself.

tests/test_records.py holds check_log to tables spoiled in memory; here the files on disk are wrong, and what moves impossibly.
"""

import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from aspnn import records
from aspnn.frames import Zone, to_geodetic
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

VESSEL = load_vessel("cargo90")
ROWS = 300


def a_log(time=None, geodetic=True, noise=1.0, speed=6.0) -> Log:
    """A ship on a circle at `speed` [m/s], fixes of two antennas at 10 Hz."""
    draw = np.random.default_rng(7)
    true = np.arange(ROWS) * 0.1
    table = pd.DataFrame({"time_s": true if time is None else time})
    for antenna in ("bow", "stern"):
        heading = 0.01 * true
        north = 7.7e6 + speed / 0.01 * np.sin(heading) + noise * draw.standard_normal(ROWS)
        east = 6.5e5 - speed / 0.01 * np.cos(heading) + noise * draw.standard_normal(ROWS)
        if geodetic:
            degrees = np.degrees(to_geodetic(north, east, Zone(33)))
            table[f"{antenna}_latitude_deg"], table[f"{antenna}_longitude_deg"] = degrees
        else:
            table[f"{antenna}_north_m"], table[f"{antenna}_east_m"] = north, east
    table["heading_deg"] = np.degrees(0.01 * true)
    return Log(table, VESSEL, Zone(33) if geodetic else None)


def says(words, path):
    """read_log refuses the file with one line that holds its name and the words."""
    with pytest.raises(InputError, match=words) as error:
        records.read_log(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value)


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
@pytest.mark.parametrize(
    "change, words",
    [
        ({"heading_deg": "heading"}, r"column heading is not known, did you mean heading_deg\?"),
        ({"heading_deg": "Heading_deg"}, r"column Heading_deg is not known, did you mean heading_deg\?"),
        ({"time_s": "depth_m"}, r"column time_s is missing \(time from the start of the log"),
        ({"stern_longitude_deg": "depth_m"}, r"column stern_longitude_deg is missing beside stern_latitude_deg"),
        ({"bow_latitude_deg": "mast_latitude_deg"}, r"mast_longitude_deg is missing|bow_latitude_deg is missing"),
    ],
)
def test_missing_and_misnamed_columns(tmp_path, ending, change, words):
    """A file whose column has another name: the column, and the nearest known one."""
    log = a_log()
    records.write_log(Log(log.table.rename(columns=change), VESSEL, Zone(33)), tmp_path / f"x{ending}")
    says(words, tmp_path / f"x{ending}")


def spoiled(**rows):
    """The time column with some rows changed."""
    time = np.arange(ROWS) * 0.1
    for row, value in rows.items():
        time[int(row[1:])] = value
    return time


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
@pytest.mark.parametrize(
    "time, words",
    [
        (spoiled(r100=5.0), r"row 100 \(time 5 s\), column time_s: time runs back by 4.9 s; sort"),
        (spoiled(r100=9.9), r"row 100 \(time 9.9 s\), column time_s: the epoch stands twice; drop"),
        (spoiled(r100=np.nan), r"row 100 .*column time_s: time is missing; drop the row"),
        (np.full(ROWS, np.nan), r"row 0 .*column time_s: time is missing; drop the row"),
        (np.zeros(ROWS), r"row 1 .*column time_s: the epoch stands twice"),
        (np.arange(ROWS)[::-1] * 0.1, r"row 1 .*column time_s: time runs back by 0.1 s"),
    ],
)
def test_time_that_does_not_rise(tmp_path, ending, time, words):
    """Row and time of the first epoch that is wrong."""
    records.write_log(a_log(time), tmp_path / f"x{ending}")
    says(words, tmp_path / f"x{ending}")


def test_rows_of_nan_are_missing_sensors(tmp_path):
    """Contract: rows without any value are epochs at which no sensor spoke, and are no error; a sensor that is never known is none either."""
    log = a_log()
    log.table.loc[50:120, log.table.columns != "time_s"] = np.nan
    log.table["heading_deg"] = np.nan
    records.write_log(log, tmp_path / "x.parquet")
    pd.testing.assert_frame_equal(records.read_log(tmp_path / "x.parquet").table, log.table)


@pytest.mark.parametrize("geodetic", [True, False])
@pytest.mark.parametrize("factor, speed", [(1e-3, 6.0), (1 / 60, 6.0), (1.0, 61.0 * 1.1)])
def test_impossible_speeds(tmp_path, geodetic, factor, speed):
    """Time in ms or min taken for s, and a ship at 67 m/s: named with row, time and what to check."""
    log = a_log(np.arange(ROWS) * 0.1 * factor, geodetic, 0.1, speed)
    records.write_log(log, tmp_path / "x.parquet")
    says(r"row \d+ \(time [\d.e-]+ s\).* moves at .* m/s .*check the unit", tmp_path / "x.parquet")


@pytest.mark.parametrize("geodetic", [True, False])
def test_jumps_noise_and_held_fixes_are_no_impossible_speeds(tmp_path, geodetic):
    """Contract: single jumps are for the gate of the filter; 3 m of noise is 40 m/s from fix to fix and goes nowhere; a fix may
    be held for a second while the ship runs on."""
    names = ("latitude_deg", "longitude_deg") if geodetic else ("north_m", "east_m")
    jump = a_log(geodetic=geodetic)
    jump.table.loc[100, f"bow_{names[0]}"] += 0.01 if geodetic else 1000.0
    jump.table.loc[200:, f"bow_{names[1]}"] += 0.01 if geodetic else 400.0
    held = a_log(geodetic=geodetic, speed=20.0)
    held.table.loc[np.arange(ROWS) % 10 != 0, [f"{a}_{n}" for a in ("bow", "stern") for n in names]] = np.nan
    held = Log(held.table.ffill(), VESSEL, held.zone)
    for log in (jump, held, a_log(geodetic=geodetic, noise=3.0), a_log(geodetic=geodetic, speed=50.0)):
        records.write_log(log, tmp_path / "x.parquet")
        assert len(records.read_log(tmp_path / "x.parquet")) == ROWS


def test_every_truncation_of_a_log_is_refused(tmp_path):
    """A Parquet file cut anywhere, and one with a byte of its footer changed, is never half a log."""
    records.write_log(a_log(), tmp_path / "whole.parquet")
    whole = (tmp_path / "whole.parquet").read_bytes()
    for kept in (0, 1, 4, 100, len(whole) // 3, len(whole) - 8, len(whole) - 1):
        (tmp_path / "x.parquet").write_bytes(whole[:kept])
        says(
            "the file is empty; write it again" if kept == 0 else "cannot be read, it is damaged",
            tmp_path / "x.parquet",
        )


def test_csv_cut_in_its_last_number_is_read_or_refused_as_a_row(tmp_path):
    """A CSV log cut after a comma has a blank cell, a missing value; cut inside its metadata it is refused."""
    records.write_log(a_log(), tmp_path / "whole.csv")
    whole = (tmp_path / "whole.csv").read_text()
    last = whole.rstrip().rsplit(",", 1)[0]
    (tmp_path / "x.csv").write_text(last + ",")
    assert np.isnan(records.read_log(tmp_path / "x.csv").table["heading_deg"].iloc[-1])
    (tmp_path / "x.csv").write_text(whole[:200])
    says("cannot be read, it is damaged", tmp_path / "x.csv")


def test_files_that_hold_no_rows_or_another_thing(tmp_path):
    """A log of no rows, a table of somebody else, a folder's name, text where numbers belong."""
    log = a_log()
    records.write_log(Log(log.table[:0], VESSEL, Zone(33)), tmp_path / "none.parquet")
    says("holds 0 rows, at least 2 are needed", tmp_path / "none.parquet")
    pq.write_table(pa.table({"a": [1.0]}), tmp_path / "other.parquet")
    says("has no metadata of a log; bring it in with `aspnn import csv", tmp_path / "other.parquet")
    metadata = {"kind": "log", "vessel": {"name": "x"}}
    pq.write_table(
        pa.table({"a": [1.0]}).replace_schema_metadata({records.KEY: json.dumps(metadata)}), tmp_path / "hull.parquet"
    )
    says("dimensions.length_overall_m is missing", tmp_path / "hull.parquet")
    text = log.table.astype({"heading_deg": object})
    text.loc[17, "heading_deg"] = "north"
    records.write_log(Log(text, VESSEL, Zone(33)), tmp_path / "text.csv")
    says("row 17, column heading_deg: 'north' is not a number", tmp_path / "text.csv")
