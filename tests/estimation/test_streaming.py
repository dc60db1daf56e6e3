"""Filtering in blocks: the same states as in one piece, memory that does not grow, and nothing half-written."""

import os
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.checks import check_blocks, check_log
from aspnn.estimation import cascade, filter_log, reference
from aspnn.estimation.cascade import filter_file
from aspnn.records import Log, read_states, write_log, write_table
from aspnn.schema import InputError

SEVEN = 70  # rows of seven seconds


@pytest.fixture(scope="module")
def dirty(voyage) -> Log:
    """Two and a half minutes with everything that a filter must remember from block to block, at odd places."""
    log = voyage[0]
    t = log.table.iloc[3000:4500].reset_index(drop=True)
    row = t.index
    bow, stern = (["bow_latitude_deg", "bow_longitude_deg"], ["stern_latitude_deg", "stern_longitude_deg"])
    t.loc[:25, bow + stern] = np.nan  # a late start
    t.loc[:100, "heading_deg"] = np.nan
    t.loc[200:290, bow + stern] = t.loc[200, bow + stern].to_numpy()  # frozen across borders
    t.loc[400:640, bow] = t.loc[400, bow].to_numpy()
    t.loc[410:430, bow] = np.nan
    t.loc[500:545, "heading_deg"] = t.loc[500, "heading_deg"]  # stuck
    t.loc[690:725, "yaw_rate_deg_s"] = t.loc[690, "yaw_rate_deg_s"]
    t.loc[700:760, "acceleration_sway_m_s2"] = t.loc[700, "acceleration_sway_m_s2"]
    t.loc[800:835, bow + stern] = np.nan
    t.loc[835:, bow[0]] += 60 / 111e3  # a lasting jump of one antenna
    t.loc[900:960, "yaw_rate_deg_s"] = np.nan
    t.loc[1000:1075, "heading_deg"] = np.nan
    t.loc[row % 3 > 0, "acceleration_surge_m_s2"] = np.nan
    t["wind_speed_true_m_s"], t["wind_from_true_deg"] = np.where(row % 97 == 40, 7.0 + row / 100, np.nan), 10.0
    t["rudder_order_deg"] = np.select([row < 130, row < 141, row < 700], [np.nan, 5.0, -35.0], 20.0)
    t = t.drop(columns=["rudder_angle_deg", "shaft_speed_rps"]).assign(
        engine_order_rps=np.where(row < 300, np.nan, 2.0)
    )
    return replace(log, table=t.drop(index=range(1200, 1330)).reset_index(drop=True), path="")


@pytest.mark.parametrize("rows", [SEVEN, 1, 333])
def test_blocks_are_the_log_in_one_piece(dirty, rows):
    """Law: the same states to the last bit, however the log is cut."""
    whole = filter_log(dirty)
    for flag in ("stale", "gated", "coasting"):
        assert 20 < whole.table[flag].sum() < len(whole) / 2
    cut = dirty if rows > 1 else replace(dirty, table=dirty.table.iloc[:450])
    blocks = filter_log(cut, rows=rows).table
    pd.testing.assert_frame_equal(blocks, whole.table.iloc[: len(blocks)], check_exact=True)


def test_blocks_by_filterpy(dirty):
    """Oracle: filterpy in blocks, to 1e-6 of the standard deviation of each state."""
    log = replace(dirty, table=dirty.table.iloc[:500])
    plain, fast = filter_log(log, reference, SEVEN), filter_log(log)
    for name in ("north_m", "surge_m_s", "heading_rad", "yaw_rate_rad_s"):
        assert (np.abs(plain[name] - fast[name]) / fast[f"{name}_sd"]).max() < 1e-6


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_a_file_in_blocks_is_the_log_in_one_piece(dirty, tmp_path, ending):
    """Law: the state file of a log file holds what `filter_log` returns, with its metadata."""
    path = tmp_path / f"log.{ending}"
    write_log(dirty, path)
    zone, place = filter_file(path, tmp_path / "a.parquet", rows=SEVEN)
    states, whole = read_states(tmp_path / "a.parquet"), filter_log(dirty)
    if ending == "parquet":
        pd.testing.assert_frame_equal(states.table, whole.table, check_exact=True)
    else:  # text rounds
        np.testing.assert_allclose(states.table.to_numpy(float), whole.table.to_numpy(float), rtol=1e-6, atol=1e-6)
    assert (states.vessel, states.zone, states.voyage) == (dirty.vessel, dirty.zone, dirty.voyage)
    assert zone == dirty.zone and np.degrees(place) == pytest.approx([69.65, 18.96], abs=0.05)
    assert {p.name for p in tmp_path.iterdir()} == {path.name, "a.parquet"}


def wrong(table, row, column, value):
    return table.assign(**{column: np.where(np.arange(len(table)) == row, value, table[column])})


@pytest.mark.parametrize(
    "spoil",
    [
        lambda t: wrong(t, 140, "time_s", 5.0),  # the first row of a block of 70: time runs back over the border
        lambda t: wrong(t, 210, "time_s", t["time_s"][209]),
        lambda t: wrong(t, 500, "heading_deg", 1e3),
        lambda t: wrong(t, 71, "yaw_rate_deg_s", np.inf),
        lambda t: t.assign(time_s=t["time_s"] / 1000),  # milliseconds taken for seconds
        lambda t: t.assign(time_s=np.where(t.index > 675, t["time_s"] / 500 + t["time_s"][675], t["time_s"])),
        lambda t: t.assign(stern_latitude_deg=np.nan, bow_latitude_deg=np.nan),
        lambda t: t.assign(heading_deg=np.nan),
        lambda t: t.assign(stern_latitude_deg=t["bow_latitude_deg"], stern_longitude_deg=t["bow_longitude_deg"]),
        lambda t: t.iloc[:1],
        lambda t: t.drop(columns="time_s"),
    ],
)
def test_a_wrong_log_is_named_alike_and_leaves_no_file(voyage, tmp_path, spoil):
    """Law: block by block the message is that of the whole log, with the same row; nothing is written."""
    log = replace(voyage[0], table=spoil(voyage[0].table.iloc[:1500].reset_index(drop=True)), path="")
    path = tmp_path / "bad.parquet"
    write_log(log, path)
    with pytest.raises(InputError) as whole:
        filter_log(replace(log, path=str(path)))
    with pytest.raises(InputError) as cut:
        filter_file(path, tmp_path / "out" / "bad.states.parquet", rows=SEVEN)
    assert str(cut.value) == str(whole.value) and "\n" not in str(cut.value)
    assert not (tmp_path / "out").exists()


def test_slow_fixes_are_checked_across_blocks(voyage):
    """Law: fixes that come less than once a block and move too fast are found as in the whole log."""
    row = np.arange(9000)
    away = np.where(row % 90 == 0, row * 20.0, np.nan)  # 200 m/s
    table = pd.DataFrame({"time_s": row / 10, "midship_north_m": away, "midship_east_m": 0.0, "heading_deg": 0.0})
    log = replace(voyage[0], table=table, zone=None)
    with pytest.raises(InputError, match="antenna midship moves at 200 m/s") as whole:
        check_log(log)
    with pytest.raises(InputError) as cut:
        list(check_blocks(log, 9000, [table.iloc[k : k + 70] for k in range(0, 9000, 70)], "log"))
    assert str(cut.value) == str(whole.value)


MEMORY = """
import sys, tracemalloc
import pyarrow
from aspnn.estimation.cascade import filter_file
filter_file(sys.argv[1], sys.argv[3], rows=2000)
tracemalloc.start()
peaks = []
for file in sys.argv[1:3]:
    tracemalloc.reset_peak()
    filter_file(file, sys.argv[3], rows=2000)
    peaks.append(tracemalloc.get_traced_memory()[1])
print(*peaks, pyarrow.default_memory_pool().max_memory())
"""


def test_memory_does_not_grow_with_the_log(voyage, tmp_path):
    """Law: a log of half an hour and one of an hour and a half take the same memory within 10 %, and Arrow less than 64 MB."""
    files = [tmp_path / "short.parquet", tmp_path / "long.parquet"]
    for quarters, file in zip((2, 6), files, strict=True):
        table = pd.concat([voyage[0].table.iloc[:9000]] * quarters, ignore_index=True)
        write_log(replace(voyage[0], table=table.assign(time_s=np.arange(len(table)) / 10)), file)
    run = subprocess.run([sys.executable, "-c", MEMORY, *files, tmp_path / "s.parquet"], capture_output=True, text=True)
    short, long, arrow = (int(x) for x in run.stdout.split())
    assert long < 1.1 * short and arrow < 64 * 2**20
    assert len(read_states(tmp_path / "s.parquet")) == 54_000


def test_a_failure_midway_leaves_no_file(dirty, tmp_path, monkeypatch):
    """Law: when filtering fails in the tenth block, the folder holds what it held before, the older states included."""
    write_log(dirty, tmp_path / "log.parquet")
    filter_file(tmp_path / "log.parquet", tmp_path / "s.parquet")
    before, count, good = (tmp_path / "s.parquet").read_bytes(), [], cascade._filter_block

    def fails(*given):
        count.append(1)
        if len(count) == 10:
            raise KeyboardInterrupt
        return good(*given)

    monkeypatch.setattr(cascade, "_filter_block", fails)
    with pytest.raises(KeyboardInterrupt):
        filter_file(tmp_path / "log.parquet", tmp_path / "s.parquet", rows=SEVEN)
    assert (tmp_path / "s.parquet").read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"log.parquet", "s.parquet"}


KILLED = """
import os, signal, sys
from aspnn.estimation import cascade
count, good = [], cascade._filter_block
def deadly(*given):
    count.append(1)
    if len(count) == 10:
        os.kill(os.getpid(), signal.SIGKILL)
    return good(*given)
cascade._filter_block = deadly
cascade.filter_file(sys.argv[1], sys.argv[2], rows=70)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_killed_run_leaves_no_state_file(dirty, tmp_path):
    """Law: a process killed in the tenth block leaves nothing under the name of the states."""
    write_log(dirty, tmp_path / "log.parquet")
    run = subprocess.run([sys.executable, "-c", KILLED, tmp_path / "log.parquet", tmp_path / "s.parquet"], check=False)
    assert run.returncode == -signal.SIGKILL
    assert not (tmp_path / "s.parquet").exists()
    assert [p.name for p in tmp_path.iterdir() if not p.name.startswith(".")] == ["log.parquet"]


def test_metadata_of_a_damaged_file(tmp_path, dirty):
    """Law: a file that is no log, or damaged, is named in one line."""
    (tmp_path / "a.parquet").write_bytes(b"PAR1 nothing of the kind")
    write_table(dirty.table, tmp_path / "b.parquet", {})
    for name, words in (("a", "damaged"), ("b", "no metadata"), ("c", "no such file")):
        with pytest.raises(InputError, match=words):
            filter_file(tmp_path / f"{name}.parquet", tmp_path / "s.parquet")
