"""Sentences to states: what the bridge knows is what the importer and the filter make of the recording."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.estimation import filter_log
from aspnn.live.config import read_bridge
from aspnn.live.estimator import LiveEstimator
from aspnn.live.intake import Intake
from aspnn.live.sources import timed_lines
from aspnn.logs.nmea import import_nmea0183
from aspnn.logs.nmea_write import write_nmea
from aspnn.simulation import Scenario, simulate_scenario

MAP = """
[antennas]
bow = { source = "GP0001", station_m = [35.0, 0.0] }
stern = { source = "GN0001", station_m = [-35.0, 0.0] }
"""
BRIDGE = f'[ship]\nvessel = "cargo90"\nzone = "33N"\n{MAP}\n[[sources]]\nkind = "file"\npath = "a.nmea"\n'
START = {
    "speed_kn": 11.5,
    "latitude_deg": 69.65,
    "longitude_deg": 18.96,
    "zone": "33N",
    "heading_deg": 350.0,
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    data = {"name": "live", "vessel": "cargo90", "duration_s": 30, "seed": 5, "start": START}
    made = next(simulate_scenario(Scenario.model_validate({**data, "manoeuvre": {"kind": "random-orders"}})))[0]
    write_nmea(replace(made, start="2026-11-22T12:00:00Z"), folder / "a.nmea")
    (folder / "map.toml").write_text(f'vessel = "cargo90"\nzone = "33N"\n{MAP}')
    (folder / "bridge.toml").write_text(BRIDGE)
    return folder


def test_the_states_of_a_replay_are_those_of_the_imported_recording(recording):
    """Oracle: import_nmea0183 and filter_log of the same file, to the last bit, rows and states."""
    [log] = import_nmea0183([recording / "a.nmea"], recording / "map.toml")
    bridge = read_bridge(recording / "bridge.toml")
    intake = Intake(bridge)
    live = LiveEstimator(bridge.vessel, bridge.zone, antennas=tuple(bridge.config.antennas))
    for time, line in timed_lines(recording / "a.nmea"):
        live.push(intake.rows(time))
        intake.feed(line, time, "file")
    live.push(intake.rows(time + 1))
    whole = filter_log(replace(log, table=log.table.reindex(columns=list(live._columns)))).table
    assert len(whole) == 301
    pd.testing.assert_frame_equal(live.states.table, whole, check_exact=True)


def test_memory_is_flat(recording):
    """Law: the same quarter of a minute, later each time, takes no more memory at the eighth time than at the third, when the states of 30 s
    are there; 150 rows that were kept somewhere would take 50 kB each time."""
    bridge = read_bridge(recording / "bridge.toml")
    intake, live = Intake(bridge), LiveEstimator(bridge.vessel, bridge.zone, keep_s=30.0, antennas=("bow", "stern"))
    for time, line in timed_lines(recording / "a.nmea"):
        intake.feed(line, time, "file")
    rows = intake.rows(time + 100)[:150]
    held = []
    tracemalloc.start()
    for k in range(8):
        for first in range(0, len(rows), 30):
            live.push([r._replace(time=r.time + 15.0 * k) for r in rows[first : first + 30]])
        held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert held[-1] - held[2] < 100_000 and np.isfinite(live.state().last["surge_m_s"])
