"""The Esso Osaka importer on made-up runs with each quirk, and on the recordings where they are at hand."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.estimation import filter_log
from aspnn.logs import esso_osaka, import_esso_osaka
from aspnn.motion import integrate
from aspnn.schema import InputError

RECORDINGS = Path(__file__).parents[2] / "../shared/data/esso_osaka"


def run(seconds=60.0, late=0.0) -> pd.DataFrame:
    """A run with the columns of the recordings: 0.4 m/s, yaw rate swinging by 3 deg/s with a period of 17 s."""
    time = np.arange(0, seconds, 0.1)
    swing = lambda t: np.radians(3) * np.sin(2 * np.pi * t / 17 + 0.3)  # noqa: E731
    path = integrate((2.0, 1.0, 0.3), np.stack([0.4 + 0 * time, -0.3 * swing(time), swing(time)], -1), 0.1)
    columns = {
        esso_osaka.TIME: time,
        esso_osaka.NORTH: path.north[:-1],
        "u_velo [m/s]": 0.4,
        esso_osaka.EAST: path.east[:-1],
        esso_osaka.HEADING: path.heading[:-1],
        esso_osaka.YAW_RATE: swing(time - late),
        esso_osaka.PROPELLER: 10.0,
        esso_osaka.RUDDER: np.radians(20) * np.sign(np.sin(time / 5)),
        esso_osaka.WIND_SPEED: 1.5,
        esso_osaka.WIND_FROM: 0.5,
    }
    return pd.DataFrame(columns)


def imported(table: pd.DataFrame, folder: Path, name="random_01-Jan-2020_10_00_00_3"):
    table.to_csv(folder / f"{name}.csv", index=False)
    return import_esso_osaka([folder])[0]


def test_a_clean_run_comes_through_unchanged(tmp_path):
    table = run()
    log = imported(table, tmp_path)
    counts = {k: v for k, v in log.notes.items() if k != "name"}
    assert set(counts.values()) == {0}
    np.testing.assert_allclose(log.table["midship_north_m"], table[esso_osaka.NORTH])
    np.testing.assert_allclose(np.radians(log.table["rudder_order_deg"]), table[esso_osaka.RUDDER])
    np.testing.assert_allclose(np.radians(log.table["wind_from_true_deg"]), 0.5)
    assert (log.notes["name"], log.voyage) == ("random_01-Jan-2020_10_00_00_3", "random_01-Jan-2020_10_00_00")


def test_held_samples_are_dropped_and_their_catch_up_is_no_jump(tmp_path):
    """By construction: 20 samples repeat row 100; the step after them is as long as 2.1 s of sailing, and is kept."""
    table = run()
    for name in (esso_osaka.NORTH, esso_osaka.EAST, esso_osaka.HEADING):
        table.loc[101:120, name] = table.loc[100, name]
    log = imported(table, tmp_path)
    assert log.notes["held_positions_dropped"] == log.notes["held_headings_dropped"] == 20
    assert log.notes["position_jumps_left_to_gate"] == 0
    assert log.table["midship_north_m"].isna().to_numpy().nonzero()[0].tolist() == list(range(101, 121))
    assert log.table["heading_deg"].notna().iloc[121]


def test_jumps_are_counted_and_the_filter_rejects_them(tmp_path):
    """By construction: five samples lie 0.4 m aside; the states must not follow them."""
    table = run()
    table.loc[300:304, esso_osaka.EAST] += 0.4
    log = imported(table, tmp_path)
    assert log.notes["position_jumps_left_to_gate"] == 2  # out and back
    states = filter_log(log)
    assert states.table["gated"].iloc[300:305].all()
    assert np.abs(states["east_m"] - run()[esso_osaka.EAST].to_numpy())[250:350].max() < 0.05


def test_the_end_and_empty_rows_are_cut(tmp_path):
    table = run()
    table.loc[550:, esso_osaka.PROPELLER] = 0.0
    table = pd.concat([table, pd.DataFrame(np.nan, index=range(7), columns=table.columns)])
    log = imported(table, tmp_path)
    assert (len(log), log.notes["rows_trimmed_after_stop"], log.notes["empty_rows_dropped"]) == (550, 50, 7)


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0])
def test_a_late_yaw_rate_is_found(tmp_path, late):
    """By construction; a late yaw rate is dropped, since moved earlier it would hold the future."""
    log = imported(run(late=late), tmp_path)
    assert log.notes["yaw_rate_lag_s"] == pytest.approx(late, abs=0.1)
    assert log.table["yaw_rate_deg_s"].isna().all() == (late > 0)


def test_other_tables_are_refused(tmp_path):
    table = run()
    with pytest.raises(InputError, match=r"column psi_hat \[rad\] is missing"):
        imported(table.drop(columns=esso_osaka.HEADING), tmp_path)
    broken = table.astype({esso_osaka.NORTH: object})
    broken.loc[41, esso_osaka.NORTH] = "lost"
    with pytest.raises(InputError, match=r"row 41, column x_position_mid \[m\]: 'lost' is not a number"):
        imported(broken, tmp_path)
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match=r"none: holds no \.csv file"):
        import_esso_osaka([tmp_path / "none"])


@pytest.mark.skipif(not RECORDINGS.exists(), reason="the Esso Osaka recordings are not at hand (not redistributed)")
def test_recordings():
    """The README of the recordings: 18 runs, the parts of 06-Aug in one voyage, 327 empty rows, late berthing yaw rates.

    No sample is invented: every value that is not NaN stands in the file, in its row.
    """
    logs = {log.notes["name"]: log for log in import_esso_osaka([RECORDINGS])}
    assert len(logs) == 18
    assert len({log.voyage for name, log in logs.items() if "06-Aug" in name}) == 1
    assert logs["zigzag_31-Jul-2020_13_50_28"].notes["empty_rows_dropped"] == 327
    late = {name for name, log in logs.items() if log.notes["yaw_rate_lag_s"] > 0.3}
    assert late == {name for name in logs if name.startswith("berthing")}
    for name, log in logs.items():
        file = next(RECORDINGS.rglob(f"{name}.csv"))
        recorded = pd.read_csv(file).iloc[: len(log)]
        known = log.table["midship_north_m"].notna().to_numpy()
        np.testing.assert_array_equal(log.table["midship_north_m"][known], recorded[esso_osaka.NORTH][known])
        held = np.concatenate([[False], (np.diff(recorded[[esso_osaka.NORTH, esso_osaka.EAST]], axis=0) == 0).all(1)])
        np.testing.assert_array_equal(known, ~held)
