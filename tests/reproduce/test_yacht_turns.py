"""The study of the yacht's turns, on made-up recordings: her own are not part of the project."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from aspnn.evaluation.reference import Reference
from aspnn.frames import Zone, convergence, to_geodetic, to_grid
from aspnn.records import Log, States
from aspnn.vessel import load_vessel

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import yacht_turns  # noqa: E402

ZONE = Zone(53)


def test_upright_takes_the_roll_of_the_antenna_away():
    """Oracle: scipy's Rotation. Fixes of an antenna 5 m up on a hull that rolls come to where it stands on an upright one; with
    `swing` they keep what the mean roll does. Half a millimetre is the scale of the grid.
    """
    n, height = 40, 5.0
    t, vessel = np.arange(n) * 0.1, load_vessel("n2k_yacht")
    x, y = vessel.stations["compass"]
    roll, psi = np.radians(4 + 3 * np.sin(t)), 1.0 + 0.3 * t  # of the grid
    rolled = Rotation.from_euler("ZX", np.stack([psi, roll], axis=-1)).apply([x, y, -height])
    level = Rotation.from_euler("Z", psi[:, None]).apply([x, y, 0.0])
    origin = np.array([3808000.0, 640000.0])
    latitude, longitude = to_geodetic(*(rolled[:, :2] + origin).T, ZONE)
    table = pd.DataFrame(
        {
            "time_s": t,
            "compass_latitude_deg": np.degrees(latitude),
            "compass_longitude_deg": np.degrees(longitude),
            "heading_deg": np.degrees(psi + convergence(latitude, longitude, ZONE)),
            "roll_deg": np.degrees(roll),
        }
    )
    log = Log(table, vessel, zone=ZONE)

    def places(swing):
        made = yacht_turns.upright(log, height, swing).table
        names = ("compass_latitude_deg", "compass_longitude_deg")
        return np.stack(to_grid(*(np.radians(made[name].to_numpy()) for name in names), ZONE), axis=-1)

    np.testing.assert_allclose(places(False) - origin, level[:, :2], atol=5e-4)
    left = places(True) - origin - level[:, :2]
    aside = left[:, 1] * np.cos(psi) - left[:, 0] * np.sin(psi)
    np.testing.assert_allclose(aside, height * np.sin(roll.mean()), atol=0.02)  # second order: 2.2 (1 - cos 7 deg)
    assert table["compass_latitude_deg"][0] == np.degrees(latitude[0])  # the log itself is left as it was


def test_predictions_start_inside_turns_and_are_exact_in_a_circle():
    """Oracle: a steady circle by closed formula: every start where |r| > 1 deg/s, none before it; constant velocities err by
    nothing there, and the pivot point is -v / r.
    """
    t = np.arange(0, 120.05, 0.1)
    u, v, r = (
        3.0,
        0.4,
        np.radians(np.where(t < 60, 0.5, 2.0)),
    )  # told to turn a little on the straight: too little to count
    psi = np.radians(2.0) * np.maximum(t - 60, 0)
    turn = (u + 1j * v) / (1j * np.radians(2.0)) * (np.exp(1j * psi) - 1)
    place = (u + 1j * v) * np.minimum(t, 60) + turn
    names = ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    table = pd.DataFrame(dict(zip(names, (place.real, place.imag, psi, u + 0 * t, v + 0 * t, r), strict=True)))
    table["time_s"], table["convergence_rad"], table["coasting"] = t, 0.0, False
    for name in ("surge_acceleration_m_s2", "sway_acceleration_m_s2", "yaw_acceleration_rad_s2"):
        table[name] = 0.0
    for name in ("sway_m_s_sd", "yaw_rate_rad_s_sd"):
        table[name] = 1e-3
    smoothed = States(table, load_vessel("n2k_yacht"), smoothed=True)
    reference = Reference.of_states(smoothed)
    rows = yacht_turns.starts(smoothed, reference)
    assert np.all(t[rows] >= 60) and np.all(t[rows] <= 110 + 1e-9) and len(rows) == 25
    scores = yacht_turns.prediction_scores(smoothed, reference, rows)
    assert set(scores) == {"caa_ctra", "caa_cmm", "exact, constant u, v, r"}
    for method in ("caa_ctra", "exact, constant u, v, r"):
        np.testing.assert_allclose(scores[method]["position_m_p95"], 0.0, atol=1e-3)
    found = yacht_turns.pivot_scores(smoothed, smoothed)
    assert found["median_m"] == pytest.approx(-0.4 / np.radians(2.0))
    assert found["holds_smoothed_percent"] == 100 and found["undefined_percent"] == 0
