"""The live estimator: the states of filter_log bit for bit, a memory that does not grow, saved states, and bad rows."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.estimation import filter_log
from aspnn.live.estimator import FASTEST, LiveEstimator
from aspnn.live.row import Row
from aspnn.logs.recording import unix
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.simulation import Scenario, simulate_scenario

START = 1_760_000_000.0
PLACE = {"latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": 350.0}


@pytest.fixture(scope="module")
def log() -> Log:
    """A minute and a half of a simulated voyage with gaps, frozen fixes, a stuck gyro and a jump, all after the first second."""
    data = {"name": "live", "vessel": "cargo90", "duration_s": 90, "seed": 5, "start": {"speed_kn": 11.5, **PLACE}}
    made = next(simulate_scenario(Scenario.model_validate({**data, "manoeuvre": {"kind": "random-orders"}})))[0]
    t = made.table.assign(time_s=made.table["time_s"].round(5))  # as importers write it
    bow = ["bow_latitude_deg", "bow_longitude_deg"]
    t.loc[200:260, bow] = t.loc[200, bow].to_numpy()
    t.loc[300:340, "heading_deg"] = t.loc[300, "heading_deg"]
    t.loc[400:440, [*bow, "stern_latitude_deg", "stern_longitude_deg"]] = np.nan
    t.loc[500:, bow[0]] += 60 / 111e3
    t.loc[t.index % 3 > 0, "acceleration_surge_m_s2"] = np.nan
    t.loc[600:720, "rudder_angle_deg"] = np.nan
    return replace(made, table=t.drop(index=range(640, 660)).reset_index(drop=True))


def rows_of(table: pd.DataFrame, start: float = START) -> list[Row]:
    """A table as rows; what is NaN is not told."""
    told = table.drop(columns="time_s").to_dict("records")
    return [
        Row(start + t, {k: v for k, v in row.items() if math.isfinite(v)})
        for t, row in zip(table["time_s"], told, strict=True)
    ]


def estimator(log: Log, **settings) -> LiveEstimator:
    return LiveEstimator(log.vessel, log.zone, antennas=("bow", "stern"), **settings)


def read(log: Log) -> Log:
    """The log with the columns that the filters read, in which a live estimator keeps it."""
    live = estimator(log)
    return replace(log, table=log.table.reindex(columns=list(live._columns)))


@pytest.mark.parametrize("size", [1, 3, 1000])
def test_states_are_those_of_the_log(log, size):
    """Oracle: filter_log over the same rows, to the last bit, however many rows come at once."""
    live, rows = estimator(log), rows_of(log.table)
    count = sum(live.push(rows[i : i + size]) for i in range(0, len(rows), size))
    whole = filter_log(read(log)).table
    assert whole["stale"].any() and whole["gated"].any() and whole["coasting"][10:].any()
    pd.testing.assert_frame_equal(live.states.table, whole, check_exact=True)
    assert count == len(whole) == len(rows)
    assert live.time == pytest.approx(rows[-1].time, abs=1e-5) and live.dropped == 0
    assert unix(live.states.start) == START


@pytest.mark.parametrize("without", [[], ["rudder_angle_deg"]])
def test_a_restored_estimator_goes_on_as_if_nothing_had_been(log, tmp_path, without):
    """Law: saved and restored after any row, before and after the filters have begun, the states are the same to the last bit; also
    where the servo stands in for the rudder angle."""
    rows, whole = rows_of(log.table.drop(columns=without)), estimator(log)
    whole.push(rows)
    live = estimator(log)
    for first, last in ((0, 5), (5, 320), (320, 425), (425, 700), (700, len(rows))):
        live.push(rows[first:last])
        live.save(tmp_path / "state.npz")
        live = LiveEstimator.restore(tmp_path / "state.npz")
    pd.testing.assert_frame_equal(live.states.table, whole.states.table, check_exact=True)
    assert (live.vessel, live.zone, live.states.start) == (whole.vessel, whole.zone, whole.states.start)
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


@pytest.mark.parametrize("content", [b"", b"nothing of the kind", None])
def test_a_damaged_state_is_named(log, tmp_path, content):
    """Law: a file that is empty, no archive, or cut short is an InputError of one line."""
    path = tmp_path / "s.npz"
    estimator(log).save(path)
    path.write_bytes(path.read_bytes()[:-200] if content is None else content)
    with pytest.raises(InputError, match="damaged") as caught:
        LiveEstimator.restore(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="no such file"):
        LiveEstimator.restore(tmp_path / "none.npz")


def test_states_are_kept_for_as_long_as_asked(log):
    """By hand: 10 s at 10 Hz are 101 states; the ring never grows."""
    live, rows = estimator(log, keep_s=10.0), rows_of(log.table.iloc[:600])
    sizes = set()
    for i in range(0, 600, 7):
        live.push(rows[i : i + 7])
        sizes.add(live._ring.nbytes if live._ring else 0)
    kept = live.states.table
    assert len(kept) == 101 and kept["time_s"].iloc[-1] == pytest.approx(59.9)
    pd.testing.assert_frame_equal(
        kept,
        filter_log(read(replace(log, table=log.table.iloc[:600]))).table[-101:].reset_index(drop=True),
        check_exact=True,
    )
    assert max(sizes) == 2 * (10 * FASTEST + 2) * len(kept.columns) * 8
    assert len(live._memory.past.rows) < 1000


def test_states_that_were_handed_out_stay_as_they_are(log):
    """Law: others may keep states for as long as they like, and read them from another thread: later rows change nothing in them, nor
    can anybody write into the estimator through them; what was read out of the table at once is the table."""
    live, rows, kept = estimator(log, keep_s=10.0), rows_of(log.table.iloc[:600]), []
    for i in range(0, 600, 50):
        live.push(rows[i : i + 50])
        kept.append((live.states, live.states.table.copy()))
    for states, table in kept:
        pd.testing.assert_frame_equal(states.table, table, check_exact=True)
        for name in table:
            np.testing.assert_array_equal(states[name], table[name].to_numpy(float))
        assert states.read() is states and not states["surge_m_s"].flags.writeable


def test_what_is_told_late_counts_from_then_on(log):
    """By hand: a shaft speed and a rudder angle that are first told after 10 s are unknown, or the servo's, before and as told after."""
    table = log.table.iloc[:300].assign(engine_order_rps=2.0)
    table.loc[:99, ["shaft_speed_rps", "rudder_angle_deg"]] = np.nan
    live = estimator(log)
    for row in rows_of(table):
        live.push([row])
    states = live.states
    assert (states["shaft_speed_rps"][:100] == 2.0).all()
    np.testing.assert_array_equal(states["shaft_speed_rps"][100:], table["shaft_speed_rps"][100:])
    assert np.isfinite(states["rudder_angle_rad"][:100]).all()
    np.testing.assert_array_equal(states["rudder_angle_rad"][100:], np.radians(table["rudder_angle_deg"][100:]))


def test_bad_rows_are_left_out_and_the_filters_go_on(log):
    """Law: rows that stand twice, values that no ship has, and a log that begins anew: nothing raises, all is counted or told."""
    rows = rows_of(log.table.iloc[:100])
    spoilt = [
        Row(
            r.time,
            {**r.values, "heading_deg": 1e4}
            if i == 50
            else {**r.values, "roll_deg": math.nan}
            if i == 60
            else r.values,
        )
        for i, r in enumerate(rows)
    ]
    live = estimator(log)
    live.push(spoilt + rows[90:95])
    assert live.dropped == 2 + 5 and len(live.states) == 100
    live.push([Row(r.time - 1000, r.values) for r in rows])
    assert [e.code for e in live.events] == ["restarted"] and len(live.states) == 100
    assert live.states["time_s"][0] == 0 and live.time == pytest.approx(rows[-1].time - 1000)
    live.push([Row(rows[-1].time - 999, {})])  # a row of silence is a state too
    assert len(live.states) == 101


def test_it_waits_for_a_fix_and_a_heading(log):
    """Law: without them there is no state and no end of memory; the reason is told."""
    live = estimator(log)
    rows = rows_of(log.table.iloc[:500])
    silent = [Row(r.time - 100, {k: v for k, v in r.values.items() if k != "heading_deg"}) for r in rows]
    live.push(silent)
    assert live.states is None and live.state().last == {} and len(live._before) <= 600
    live.push(rows)
    assert len(live.states) >= 500


def test_two_names_of_one_antenna_are_refused_and_told(log):
    """Law: the InputError of filter_log becomes what the alarms tell, and the filters begin when it is mended."""
    table = log.table.iloc[:60].copy()
    for axis in ("latitude_deg", "longitude_deg"):
        table[f"stern_{axis}"] = table[f"bow_{axis}"]
    live = estimator(log)
    live.push(rows_of(table))
    assert "same position" in live.state().refused and live.states is None
    live.push(rows_of(log.table.iloc[60:120]))
    assert live.state().refused == "" and live.states is not None


def test_what_it_tells_the_alarms(log):
    """By hand: no fix from 40.0 to 44.0 s; the last one was used at 39.9 s, and two seconds later the filter coasts."""
    live = estimator(log)
    live.push(rows_of(log.table.iloc[:431]))
    state = live.state()
    assert state.coasting_since == pytest.approx(START + 39.9, abs=1e-4)
    assert state.time == pytest.approx(START + 43.0, abs=1e-4)
    assert set(state.inconsistency) <= {"heading", "yaw_rate", "bow", "stern", "acceleration"}
    assert state.last["north_m_sd"] > 0
