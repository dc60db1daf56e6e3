"""Sensors, against the truth they record and the statistics of their noise."""

import re

import numpy as np
import pytest

from aspnn import schema
from aspnn.angles import difference
from aspnn.checks import check_log
from aspnn.frames import Zone, convergence, station_velocity, to_grid, to_north_east
from aspnn.guidance import turning_circle
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.simulation import Sensors, Ship, balanced_shaft_speed, measure, simulate, start_states
from aspnn.vessel import load_vessel

ZONE = Zone.parse("33N")
PLACE = to_grid(np.radians(69.65), np.radians(18.96), ZONE)
EXACT = Sensors(position_m=0, heading_deg=0, yaw_rate_deg_s=0, acceleration_m_s2=0)
VESSEL = load_vessel("cargo90").with_stations(mast=(12.0, 3.6), imu=(-20.0, 2.5))


@pytest.fixture(scope="module")
def voyage():
    """A hard turn in a current, from 30 s on."""
    ship = Ship.of(VESSEL)
    start = start_states(*PLACE, 2.0, VESSEL.service_speed)
    shaft = balanced_shaft_speed(ship.mmg, VESSEL.service_speed)
    return simulate(ship, turning_circle(np.radians(35), 30), start, 600, shaft, current=[0.6, -0.5])[0]


def radians(table, column):
    return np.radians(table[column].to_numpy())


def test_exact_sensors_record_the_truth(voyage):
    """Oracle: the truth; antennas lie at their stations on the UTM grid, the heading is true, the order that of the helm."""
    sensors = Sensors(
        antennas=("bow", "mast", "midship"), position_m=0, heading_deg=0, yaw_rate_deg_s=0, acceleration_m_s2=0
    )
    table = measure(voyage, VESSEL, ZONE, sensors, np.random.default_rng(0))
    check_log(Log(table, VESSEL, ZONE))
    np.testing.assert_array_equal(table["time_s"], voyage.time)
    assert list(schema.antennas(table.columns)) == ["bow", "mast", "midship"]
    for antenna in ("bow", "mast", "midship"):
        latitude, longitude = radians(table, f"{antenna}_latitude_deg"), radians(table, f"{antenna}_longitude_deg")
        north, east = to_grid(latitude, longitude, ZONE)
        ahead = (north - voyage.north) + 1j * (east - voyage.east)
        station = ahead * np.exp(-1j * voyage.heading)
        np.testing.assert_allclose(station, complex(*VESSEL.stations[antenna]), atol=1e-6)
    gamma = convergence(latitude, longitude, ZONE)
    np.testing.assert_allclose(np.degrees(gamma), 3.71, atol=0.05)  # errata E44
    true = radians(table, "heading_deg")
    np.testing.assert_allclose(difference(true, voyage.heading + gamma), 0, atol=1e-9)
    np.testing.assert_allclose(radians(table, "yaw_rate_deg_s"), voyage.yaw_rate, atol=1e-15)
    np.testing.assert_allclose(radians(table, "rudder_angle_deg"), voyage.rudder, atol=1e-15)
    np.testing.assert_array_equal(
        table["rudder_order_deg"], np.where(voyage.time < 29.99, 0, np.degrees(np.radians(35)))
    )
    np.testing.assert_array_equal(table["shaft_speed_rps"], voyage.shaft)


def test_accelerometer_reads_the_second_derivative_of_its_own_track(voyage):
    """Oracle: second differences of the track of the station `imu` over ground, turned into body axes (E1, E5)."""
    table = measure(voyage, VESSEL, ZONE, EXACT, np.random.default_rng(0))
    north, east = to_north_east(*VESSEL.stations["imu"], voyage.heading)
    track = (voyage.north - voyage.north[0] + north) + 1j * (voyage.east - voyage.east[0] + east)
    second = np.zeros_like(track)
    second[1:-1] = (track[2:] - 2 * track[1:-1] + track[:-2]) / 0.1**2
    inertial = second * np.exp(-1j * voyage.heading)
    read = table["acceleration_surge_m_s2"].to_numpy() + 1j * table["acceleration_sway_m_s2"].to_numpy()
    smooth = (voyage.time > 0.05) & (voyage.time < 599.95) & ~((voyage.time > 29.8) & (voyage.time < 45.5))
    assert np.abs(read[smooth]).max() > 0.03
    np.testing.assert_allclose(read[smooth], inertial[smooth], atol=2e-5)
    without = station_velocity(voyage.surge_rate, voyage.sway_rate, voyage.yaw_acceleration, VESSEL.stations["imu"])
    assert np.abs(inertial[smooth] - (without[0] + 1j * without[1])[smooth]).max() > 0.03  # the transport terms matter


def test_noise_has_the_stated_size_and_no_memory(voyage):
    """Oracle: chi-square and correlation statistics at 4.5 standard errors (two-sided 7e-6 for each of 22 checks)."""
    sensors = Sensors(rudder_angle_deg=0.2, shaft_rps=0.01)
    exact = measure(voyage, VESSEL, ZONE, EXACT, np.random.default_rng(0))
    noisy = measure(voyage, VESSEL, ZONE, sensors, np.random.default_rng(5))
    error = {}
    for antenna in ("bow", "stern"):
        grids = [
            to_grid(radians(t, f"{antenna}_latitude_deg"), radians(t, f"{antenna}_longitude_deg"), ZONE)
            for t in (noisy, exact)
        ]
        for axis, (got, true) in enumerate(zip(*grids, strict=True)):
            error[antenna, axis] = (got - true) / 1.0
    turn = difference(radians(noisy, "heading_deg"), radians(exact, "heading_deg"))
    error["heading"] = np.degrees(turn) / 0.5
    for column, sd in (
        ("yaw_rate_deg_s", 0.01),
        ("acceleration_surge_m_s2", 0.01),
        ("acceleration_sway_m_s2", 0.01),
        ("rudder_angle_deg", 0.2),
        ("shaft_speed_rps", 0.01),
    ):
        error[column] = ((noisy[column] - exact[column]) / sd).to_numpy()
    np.testing.assert_array_equal(noisy["rudder_order_deg"], exact["rudder_order_deg"])
    n = len(noisy)
    noise = np.array(list(error.values()))
    assert np.all(np.abs(noise.mean(axis=1)) < 4.5 / np.sqrt(n))
    assert np.all(np.abs((noise**2).mean(axis=1) - 1) < 4.5 * np.sqrt(2 / n))
    assert np.all(np.abs((noise[:, 1:] * noise[:, :-1]).mean(axis=1)) < 4.5 / np.sqrt(n - 1))
    across = np.corrcoef(noise) - np.eye(len(noise))
    assert np.abs(across).max() < 4.5 / np.sqrt(n)


def test_sensors_keep_their_own_rates(voyage):
    """Oracle: the stated rates; a sensor's samples are those of the fast log, and others do not move them."""
    rates = {"bow_latitude_deg": 1, "heading_deg": 2, "yaw_rate_deg_s": 5, "rudder_angle_deg": 5}
    slow = Sensors(position_hz=1, heading_hz=2, yaw_rate_hz=5, acceleration_hz=0, shaft_hz=0, rudder_hz=5)
    table = measure(voyage, VESSEL, ZONE, slow, np.random.default_rng(3))
    fast = measure(voyage, VESSEL, ZONE, Sensors(), np.random.default_rng(3))
    assert "acceleration_surge_m_s2" not in table and "shaft_speed_rps" not in table
    step = np.round(table["time_s"] * 10).astype(int).to_numpy()
    np.testing.assert_array_equal(step, [k for k in range(6001) if k % 2 == 0 or k % 5 == 0])
    for column, rate in rates.items():
        np.testing.assert_array_equal(table[column].notna(), step % (10 // rate) == 0)
        known = table[column].notna().to_numpy()
        np.testing.assert_array_equal(table[column][known], fast[column][step[known]])


@pytest.mark.parametrize(
    "sensors, message",
    [
        (Sensors(heading_hz=4), "sensors.heading_hz = 4 Hz must divide 10 Hz"),
        (Sensors(position_hz=3), "sensors.position_hz = 3 Hz"),
        (Sensors(heading_hz=20), "sensors.heading_hz = 20 Hz"),
        (Sensors(position_hz=0), "needs the position of an antenna"),
        (Sensors(antennas=("funnel",)), "antenna funnel has no station"),
    ],
)
def test_impossible_sensors_are_named(voyage, sensors, message):
    """Oracle: the messages."""
    with pytest.raises(InputError, match=re.escape(message)):
        measure(voyage, VESSEL, ZONE, sensors, np.random.default_rng(0))
