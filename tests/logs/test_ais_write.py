"""AIS writer: a simulated log out as class A sentences and back in, at the reporting intervals of ITU-R M.1371."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.angles import difference
from aspnn.checks import check_log
from aspnn.estimation import filter_log
from aspnn.frames import Zone, convergence, to_geodetic, to_grid
from aspnn.logs.ais import import_ais
from aspnn.logs.ais_write import to_ais, write_ais
from aspnn.motion import integrate
from aspnn.records import Log, read_log, read_truth, write_log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

pytest.importorskip("pyais", reason="pyais is not installed (pip install 'aspnn[ais]')")

SAMPLE = Path(__file__).parents[2] / "data/sample"
ZONE, MMSI, KNOT = Zone(33), 257000001, 1852 / 3600


def log_of(speed: float, rate, duration: float = 400.0, start="2025-06-01T23:58:00Z") -> Log:
    """A log at 5 Hz of a ship at `speed` [m/s] whose yaw rate [rad/s] is `rate(time)`; exact, with all that AIS tells."""
    time = np.arange(0, duration + 0.1, 0.2)
    r = np.broadcast_to(rate(time), time.shape)
    path = integrate((7728000.0, 420000.0, 0.3), np.stack([speed + 0 * time, 0 * time, r], -1), 0.2)
    north, east, heading = path.north[:-1], path.east[:-1], path.heading[:-1]
    place = north + 1j * east + 35 * np.exp(1j * heading)
    latitude, longitude = to_geodetic(place.real, place.imag, ZONE)
    true = np.degrees(heading + convergence(latitude, longitude, ZONE)) % 360
    table = {
        "time_s": np.round(time, 3),
        "bow_latitude_deg": np.degrees(latitude),
        "bow_longitude_deg": np.degrees(longitude),
        "heading_deg": true,
        "yaw_rate_deg_s": np.degrees(r),
        "course_over_ground_deg": true,
        "speed_over_ground_m_s": speed + 0 * time,
    }
    return Log(pd.DataFrame(table), load_vessel("cargo90"), ZONE, start, "made up", "made-up")


def test_what_is_sent_comes_back(tmp_path):
    """Oracle: the log itself at the whole seconds of the reports, within half a unit of each field; over midnight."""
    log = log_of(6.0, lambda t: 0.02 * np.sin(t / 30))
    (back,) = import_ais([write_ais(log, tmp_path / "a.ais", MMSI, "Nordlys")])
    sent = log.table.set_index("time_s").loc[back.table["time_s"].to_numpy()]
    for axis in ("latitude", "longitude"):
        np.testing.assert_allclose(
            back.table[f"gnss_{axis}_deg"], sent[f"bow_{axis}_deg"], rtol=0, atol=0.5000001 / 600_000
        )
    bearing = difference(np.radians(back.table["heading_deg"]), np.radians(sent["heading_deg"]))
    assert np.degrees(np.abs(bearing).max()) <= 0.5 + 1e-9
    np.testing.assert_allclose(back.table["speed_over_ground_m_s"], 6.0, atol=0.05 * KNOT)
    code = np.sqrt(np.abs(back.table["yaw_rate_deg_s"] * 60)) * 4.733  # steps of one code in a square root
    np.testing.assert_allclose(code, 4.733 * np.sqrt(np.abs(sent["yaw_rate_deg_s"] * 60)), atol=0.5 + 1e-6)
    assert (back.table["yaw_rate_deg_s"].to_numpy() * sent["yaw_rate_deg_s"].to_numpy() >= 0).all()
    assert back.start == log.start and back.notes["mmsi"] == MMSI and back.notes["ship"] == "NORDLYS"
    assert (back.vessel.length, back.vessel.beam, back.vessel.draught) == (90, 14, 6.5)
    assert back.vessel.stations["gnss"] == (35.0, 0.0)
    write_log(back, tmp_path / "back.parquet")
    check_log(read_log(tmp_path / "back.parquet"))


@pytest.mark.parametrize(
    ("knots", "steady", "turning"), [(8.0, 10, 10 / 3), (14.0, 10, 10 / 3), (18.0, 6, 2), (26.0, 2, 2)]
)
def test_reporting_intervals(knots, steady, turning):
    """ITU-R M.1371, table 1: 10 s to 14 kn, 6 s to 23 kn, else 2 s; in turns 3 1/3 s and 2 s, and back 20 s after the turn shows."""
    for rate, expected in ((0.0, steady), (np.radians(1.0), turning)):
        lines = list(to_ais(log_of(knots * KNOT, lambda t, r=rate: r), MMSI))
        times = np.array([int(line.split("c:")[1][:13]) for line in lines if "!AIVDM,1" in line]) / 1000
        np.testing.assert_allclose(np.diff(times)[times[1:] > times[0] + 30], expected, atol=2e-3)
    # A turn of 40 degrees in 20 s: off the mean of 30 s by more than 5 degrees until 28 s after it ends, and for 20 s more.
    lines = list(to_ais(log_of(knots * KNOT, lambda t: np.radians(2.0) * ((t > 101) & (t < 121))), MMSI))
    times = np.array([int(line.split("c:")[1][:13]) for line in lines if "!AIVDM,1" in line]) / 1000
    times -= times[0]
    quick = times[:-1][np.diff(times) < steady - 0.1]
    if turning < steady:
        assert 101 - steady < quick.min() < 107 and 121 + 20 < quick.max() < 121 + 30 + 20


def test_what_a_log_does_not_tell_is_sent_as_unavailable(tmp_path):
    """Positions alone, with an outage of 60 s: absent columns stay absent, and the outage has no fixes."""
    log = log_of(6.0, lambda t: 0 * t)
    table = log.table[["time_s", "bow_latitude_deg", "bow_longitude_deg"]].copy()
    table.loc[table["time_s"].between(100, 160), table.columns[1:]] = np.nan
    (back,) = import_ais([write_ais(replace(log, table=table), tmp_path / "a.ais", MMSI)])
    assert list(back.table) == ["time_s", "gnss_latitude_deg", "gnss_longitude_deg"]
    gone = back.table["time_s"][back.table["gnss_latitude_deg"].isna()]
    assert len(gone) == 6 and gone.between(100, 162).all()
    with pytest.raises(InputError, match="needs the start"):
        write_ais(replace(log, start=""), tmp_path / "b.ais", MMSI)
    with pytest.raises(InputError, match="MMSI 7 is no ship's"):
        write_ais(log, tmp_path / "b.ais", 7)
    assert not (tmp_path / "b.ais").exists()


def test_the_planar_filter_runs_on_class_a_reports(tmp_path):
    """Statistics: on a simulated zig-zag (fixes of 1 m every 3 to 10 s, heading in whole degrees) midship comes out within the noise
    that the vessel announces, 2 m per axis, and the errors are of the size that the states say: within twice their deviation."""
    log = read_log(SAMPLE / "zigzag-20-20.parquet")
    truth = read_truth(log)
    (back,) = import_ais([write_ais(log, tmp_path / "a.ais", MMSI)])
    states = filter_log(back)
    time, late = states["time_s"], states["time_s"] > 60
    latitude, longitude = to_geodetic(truth["north_m"], truth["east_m"], log.zone)
    north, east = to_grid(latitude, longitude, back.zone)
    off = np.hypot(
        states["north_m"] - np.interp(time, truth["time_s"], north),
        states["east_m"] - np.interp(time, truth["time_s"], east),
    )[late]
    said = np.sqrt(np.mean(states["north_m_sd"][late] ** 2 + states["east_m_sd"][late] ** 2))
    assert np.sqrt(np.mean(off**2)) < min(2.0 * np.sqrt(2), 2 * said)
    surge = states["surge_m_s"][late] - np.interp(time, truth["time_s"], truth["surge_m_s"])[late]
    assert np.sqrt(np.mean(surge**2)) < 2 * np.sqrt(np.mean(states["surge_m_s_sd"][late] ** 2))
    assert not states.table["gated"].any() and not states.table["stale"].any()


def test_several_ships_in_one_file(tmp_path):
    """Lines of three ships, sorted by when they were sent: each log is what its ship alone would have made."""
    logs = [log_of(4.0 + 3 * k, lambda t, k=k: 0.01 * (k - 1) + 0 * t) for k in range(3)]
    lines = [line for k, log in enumerate(logs) for line in to_ais(log, MMSI + k)]
    lines.sort(key=lambda line: int(line.split("c:")[1][:13]))
    (tmp_path / "all.ais").write_text("".join(lines))
    together = import_ais([tmp_path / "all.ais"])
    assert [log.notes["mmsi"] for log in together] == [MMSI, MMSI + 1, MMSI + 2]
    for k, log in enumerate(together):
        (alone,) = import_ais([write_ais(logs[k], tmp_path / "one.ais", MMSI + k)])
        pd.testing.assert_frame_equal(log.table, alone.table)
        assert log.vessel == alone.vessel
