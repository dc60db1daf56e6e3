"""The study of what AIS alone tells of a ship: its errors on motions that are known, and its order of methods on one short voyage."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.frames import Zone
from aspnn.motion import integrate
from aspnn.records import Log
from aspnn.vessel import load_vessel

pytest.importorskip("pyais", reason="pyais is not installed (pip install 'aspnn[ais]')")
ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import ais  # noqa: E402


def test_a_state_that_is_true_at_its_report_runs_on_along_the_circle():
    """Analytic: on a steady turn the arc is exact, for the antenna as for midship; taken straight on, the error is that of the chord,
    V w t^2 / 2 to the side."""
    seconds = 300
    path = integrate((100.0, 200.0, 0.4), np.tile([5.0, -0.8, 0.01], (seconds * 10, 1)), 0.1)
    north, east, psi = path.north[::10], path.east[::10], path.heading[::10]
    truth = pd.DataFrame({"time_s": np.arange(seconds + 1.0), "north_m": north, "east_m": east, "heading_rad": psi})
    truth = truth.assign(surge_m_s=5.0, sway_m_s=-0.8, yaw_rate_rad_s=0.01)
    station = -35.0 + 2.0j
    place = north + 1j * east + station * np.exp(1j * psi)
    moved = 5.0 - 0.8j + 0.01j * station
    table = pd.DataFrame({"time_s": np.arange(0.0, seconds, 10)})
    log = Log(table, load_vessel("cargo90").with_stations(gnss=(-35.0, 2.0)), Zone(33))
    told = np.column_stack([place.real, place.imag, abs(moved) + 0 * psi, psi + np.angle(moved), psi, 0.01 + 0 * psi])[
        :300:10
    ]
    exact = ais.errors(told, log, truth)
    assert exact["turning"].all()
    np.testing.assert_allclose(exact.drop(columns=["time_s", "turning"]), 0, atol=1e-8)
    told[:, 5] = 0.0
    straight = ais.errors(told, log, truth)
    gone = np.minimum(straight["time_s"] % 10 + 10 * (straight["time_s"] >= 300), 10)
    np.testing.assert_allclose(straight["antenna_m"], abs(moved) * 0.01 * gone**2 / 2, rtol=0.01)


def test_the_methods_on_a_short_voyage(monkeypatch):
    """Statistics: with fixes of 1 m and velocities of 0.05 m/s every 3 to 10 s the filter that uses both has places within a metre and
    courses within 3 degrees; the course filter, on places alone, is worse at both, and knows the antenna's place within 4 m."""
    monkeypatch.setitem(ais.SCENARIO, "duration_s", 500)
    found = {name: parts["all"] for name, parts in ais.study(2, 0.0).items()}
    best, alone = found["the same with COG and SOG (filter_over_ground)"], found["course filter (positions alone)"]
    assert best["antenna_m"] < 1.0 < alone["antenna_m"] < 4.0
    assert best["course_deg"] < min(3.0, alone["course_deg"])
