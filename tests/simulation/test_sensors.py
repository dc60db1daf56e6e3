"""Sensors, against the truth they record and the statistics of their noise."""

import re

import numpy as np
import pandas as pd
import pytest
from made_voyages import made

from aspnn import schema
from aspnn.angles import compass, difference
from aspnn.checks import check_log
from aspnn.frames import Zone, convergence, station_acceleration, station_velocity, to_geodetic, to_grid, to_north_east
from aspnn.guidance import turning_circle
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.simulation import Sea, Sensors, Ship, measure, read_scenario, simulate
from aspnn.simulation.sensing.gnss import Gnss
from aspnn.simulation.sensing.instruments import Gyrocompass, Imu, RateGyro, RudderIndicator
from aspnn.simulation.sensing.resolution import Resolution
from aspnn.vessel import load_vessel

ZONE = Zone.parse("33N")
PLACE = to_grid(np.radians(69.65), np.radians(18.96), ZONE)
EXACT = Sensors(position_m=0, heading_deg=0, yaw_rate_deg_s=0, acceleration_m_s2=0)
VESSEL = load_vessel("cargo90").with_stations(mast=(12.0, 3.6), imu=(-20.0, 2.5))


@pytest.fixture(scope="module")
def voyage():
    """A hard turn in a current, from 30 s on."""
    ship = Ship.of(VESSEL)
    start = ship.start(*PLACE, 2.0, VESSEL.service_speed)
    return simulate(ship, turning_circle(np.radians(35), 30), start, 600, sea=Sea(current=np.array([0.6, -0.5])))[0]


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


def test_one_period_for_all_sensors_on_board():
    """Oracle: the samples are those of a sensor at every step, each third of them; the stated times, which no whole rate has."""
    voyage = made(PLACE, 39.0, dt=0.13)
    every, third = (
        measure(voyage, VESSEL, ZONE, Sensors(period_s=p, attitude_hz=1, shaft_hz=0), np.random.default_rng(3))
        for p in (0.13, 0.39)
    )
    np.testing.assert_allclose(every["time_s"], np.arange(301) * 0.13, atol=1e-12)
    assert not every.isna().any(axis=None) and "shaft_speed_rps" not in every and "roll_deg" in every
    pd.testing.assert_frame_equal(third, every[::3].reset_index(drop=True), check_exact=True)


@pytest.mark.parametrize(
    "sensors, message",
    [
        (
            Sensors(period_s=0.13),
            "sensors.period_s = 0.13 s must be a whole number of the simulation's steps of 0.1 s; change step_s",
        ),
        (Sensors(period_s=0.05), "sensors.period_s = 0.05 s must be a whole number"),
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


def first_measure(voyage, vessel, zone, sensors, rng):
    """The sensors as they were when the published checkpoints were trained, kept as they were: white noise and nothing else."""
    steps = len(voyage.time)
    table = {"time_s": voyage.time}

    def record(**columns):
        noise = rng.standard_normal((len(columns), steps))
        for (name, (truth, sd)), error in zip(columns.items(), noise, strict=True):
            table[name] = truth + sd * error

    heading, u, v, r = voyage.heading, voyage.surge, voyage.sway, voyage.yaw_rate
    for antenna in sensors.antennas:
        north, east = to_north_east(*vessel.stations[antenna], heading)
        sd = sensors.position_m
        record(north=(voyage.north + north, sd), east=(voyage.east + east, sd))
        latitude, longitude = to_geodetic(table.pop("north"), table.pop("east"), zone)
        table[f"{antenna}_latitude_deg"] = np.degrees(latitude)
        table[f"{antenna}_longitude_deg"] = np.degrees(longitude)
    latitude, longitude = to_geodetic(voyage.north, voyage.east, zone)
    gamma = convergence(latitude, longitude, zone)
    record(heading_deg=(np.degrees(heading + gamma), sensors.heading_deg))
    table["heading_deg"] = np.degrees(compass(np.radians(table["heading_deg"])))
    record(yaw_rate_deg_s=(np.degrees(r), sensors.yaw_rate_deg_s))
    inertial = voyage.surge_rate - v * r, voyage.sway_rate + u * r
    forward, starboard = station_acceleration(*inertial, r, voyage.yaw_acceleration, vessel.stations["imu"])
    sd = sensors.acceleration_m_s2
    record(acceleration_surge_m_s2=(forward, sd), acceleration_sway_m_s2=(starboard, sd))
    angle = np.degrees(voyage.rudder), sensors.rudder_angle_deg
    record(rudder_order_deg=(np.degrees(voyage.order), 0.0), rudder_angle_deg=angle)
    record(shaft_speed_rps=(voyage.shaft, sensors.shaft_rps))
    return pd.DataFrame(table)


def test_default_sensors_are_those_of_the_checkpoints(voyage):
    """Oracle: the first algorithm, bit by bit, its draws of random numbers too; on a voyage simulated and on one made of sines."""
    for one in (voyage, made(PLACE, 120.0)):
        new, old = np.random.default_rng(17), np.random.default_rng(17)
        pd.testing.assert_frame_equal(
            measure(one, VESSEL, ZONE, Sensors(), new),
            first_measure(one, VESSEL, ZONE, Sensors(), old),
            check_exact=True,
        )
        assert new.bit_generator.state == old.bit_generator.state


# Every setting that is off by default, switched on; and the columns that it may touch.
POSITIONS = r"(bow|stern)_.*"
SWITCHES = {
    "gnss": (
        Gnss(wander_m=4.7, spike_share=0.01, frozen_share=0.05, outage_share=0.05, height_m=1.0),
        POSITIONS + "|.*ground.*",
    ),
    "gyrocompass": (Gyrocompass(offset_deg=1.0, settling_deg=3.0, speed_error=True), "heading_deg"),
    "rate_gyro": (RateGyro(bias_deg_s=0.1, bias_walk_1h_deg_s=0.1, damping_s=3.0), "yaw_rate_deg_s"),
    "imu": (Imu(True, False, 0.5, 60.0, 0.05, 0.05, 1.0, True, 0.1, 0.1), "acceleration_.*|imu_.*"),
    "rudder_indicator": (RudderIndicator(play_deg=1.0, offset_deg=0.5), "rudder_angle_deg"),
    "course_hz": (1.0, ".*over_ground.*"),
    "attitude_hz": (10.0, "(roll|pitch)_deg"),
    "engine_order_hz": (1.0, "engine_order_rps"),
    "propeller_pitch_hz": (1.0, "propeller_pitch_ratio"),
    "speed_log_hz": (1.0, "speed_through_water_m_s"),
    "wind_hz": (1.0, "wind_.*"),
    "depth_hz": (0.5, "depth_m"),
    "position_delay_s": (0.7, POSITIONS),
    "heading_delay_s": (0.2, "heading_deg"),
    "yaw_rate_delay_s": (1.3, "yaw_rate_deg_s"),
    "acceleration_delay_s": (0.1, "acceleration_.*|imu_.*"),
    "rudder_delay_s": (0.4, "rudder_angle_deg"),
    "shaft_delay_s": (2.0, "shaft_speed_rps"),
}


@pytest.mark.parametrize("switch", SWITCHES)
def test_a_sensor_moves_no_other(switch):
    """Law: one setting switched on among none, and off among all, changes its own columns and, bit by bit, no other."""
    still = np.full(1201, 0.8)
    voyage = made(PLACE, 120.0, roll=((0.1, 0.9, 0.0),), pitch_ratio=still, shaft_order=still, depth=40.0)
    every = {name: value for name, (value, _) in SWITCHES.items()}
    value, own = SWITCHES[switch]
    rest = {name: v for name, v in every.items() if name != switch}
    for without, with_ in (({}, {switch: value}), (rest, every)):
        a, b = (measure(voyage, VESSEL, ZONE, Sensors(**s), np.random.default_rng(6)) for s in (without, with_))
        mine = [c for c in b if re.fullmatch(own, c)]
        assert mine and not a[[c for c in mine if c in a]].equals(b[mine])
        others = [c for c in b if c not in mine]
        assert others == [c for c in a if c not in mine]
        pd.testing.assert_frame_equal(a[others], b[others], check_exact=True)


def test_other_sensors_tell_the_truth():
    """Oracle: the voyage. A current and a wind by hand; deep water gives no echo, a fixed propeller no pitch."""
    t = np.arange(1201) * 0.1
    steady = {"current": np.tile([0.5, -0.3], (1201, 1)), "wind": np.tile([-3.0, -4.0], (1201, 1))}
    orders = {"shaft_order": np.where(t < 60, 2.0, 1.0), "pitch_ratio": np.full(1201, 0.7), "depth": 12.5}
    voyage = made(PLACE, 120.0, roll=((0.1, 0.9, 0.0),), pitch=((0.03, 0.7, 1.0),), **steady, **orders)
    rates = ("attitude", "engine_order", "propeller_pitch", "speed_log", "wind", "depth")
    exact = {"attitude_deg": 0, "speed_log_m_s": 0, "wind_m_s": 0, "depth_m": 0}
    sensors = Sensors(**{f"{what}_hz": 10 for what in rates}, **exact)
    table = measure(voyage, VESSEL, ZONE, sensors, np.random.default_rng(0))
    check_log(Log(table, VESSEL, ZONE))
    np.testing.assert_allclose(radians(table, "roll_deg"), voyage.roll, atol=1e-15)
    np.testing.assert_allclose(radians(table, "pitch_deg"), voyage.pitch, atol=1e-15)
    np.testing.assert_array_equal(table["engine_order_rps"], voyage.shaft_order)
    np.testing.assert_array_equal(table["propeller_pitch_ratio"], 0.7)
    np.testing.assert_array_equal(table["depth_m"], 12.5)
    ahead = voyage.surge - 0.5 * np.cos(voyage.heading) + 0.3 * np.sin(voyage.heading)
    np.testing.assert_allclose(table["speed_through_water_m_s"], ahead, atol=1e-12)
    np.testing.assert_allclose(table["wind_speed_true_m_s"], 5.0)
    gamma = convergence(*to_geodetic(voyage.north, voyage.east, ZONE), ZONE)
    np.testing.assert_allclose(table["wind_from_true_deg"], np.degrees(np.arctan2(4, 3) + gamma), atol=1e-9)
    deep = measure(made(PLACE, 10.0), VESSEL, ZONE, sensors, np.random.default_rng(0))
    assert deep["depth_m"].isna().all() and deep["propeller_pitch_ratio"].isna().all()


def test_quantised_values_are_whole_steps():
    """Oracle: whole steps, an error within half of one and, where the noise is wider than it, uniform: variance step^2 / 12."""
    voyage = made(PLACE, 120.0, roll=((0.1, 0.9, 0.0),))
    on = {"attitude_hz": 10, "course_hz": 10, "wind_hz": 10, "gnss": Gnss(height_m=1.0)}
    fine = measure(voyage, VESSEL, ZONE, Sensors(**on), np.random.default_rng(6))
    coarse = measure(voyage, VESSEL, ZONE, Sensors(**on, quantised=True), np.random.default_rng(6))
    steps = {
        "bow_latitude_deg": 1e-4 / 60, "stern_longitude_deg": 1e-4 / 60, "bow_height_m": 0.1, "heading_deg": 0.1,
        "yaw_rate_deg_s": 0.1 / 60, "roll_deg": 0.1, "acceleration_sway_m_s2": 0.001, "rudder_angle_deg": 0.1,
        "shaft_speed_rps": 0.1 / 60, "speed_over_ground_m_s": 0.1 * 1852 / 3600, "course_over_ground_deg": 0.1,
        "wind_speed_true_m_s": 0.1, "wind_from_true_deg": 0.1,
    }  # fmt: skip
    for name, step in steps.items():
        whole = coarse[name] / step
        np.testing.assert_allclose(whole, np.round(whole), atol=1e-6, err_msg=name)
        error = (coarse[name] - fine[name]) / step
        error = error - np.round(error * step / 360) * 360 / step
        assert np.abs(error).max() <= 0.5 + 1e-6
        if name not in ("rudder_angle_deg", "shaft_speed_rps"):
            spread = 4.5 * np.sqrt(1 / 180 / len(error))  # of a square, whose variance is 1/80 - 1/144
            assert abs((error**2).mean() - 1 / 12) < spread, name
    own = measure(voyage, VESSEL, ZONE, Sensors(resolution=Resolution(heading_deg=5.0)), np.random.default_rng(6))
    assert set(own["heading_deg"] % 5) == {0.0} and own["heading_deg"].max() < 360


SCENARIO = """
vessel = "cargo90"
duration_s = 60
[start]
speed_kn = 11
latitude_deg = 69
longitude_deg = 15
zone = "33N"
heading_deg = 0
[manoeuvre]
kind = "straight"
[sensors]
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[sensors.gnss]\nwander = 4.7", "sensors.gnss.wander: is not a known key"),
        ("[sensors.gnss]\njump_m = [50, 10]", "sensors.gnss.jump_m: from 50 to 10: both must be 0 or more"),
        ("[sensors.gnss]\noutages_s = [[10]]", "sensors.gnss.outages_s.0.1: is missing"),
        ("[sensors.gnss]\nfrozen_share = 1.0", "sensors.gnss.frozen_share: input should be less than 1"),
        ("[sensors.imu]\nmisalignment_deg = -1", "sensors.imu.misalignment_deg: input should be greater than"),
        ("[sensors.gyrocompass]\nspeed_error = 3", "sensors.gyrocompass.speed_error: input should be a valid boolean"),
        ("heading_delay_s = -1", "sensors.heading_delay_s: input should be greater than"),
        ("[sensors.resolution]\nheading = 1", "sensors.resolution.heading: is not a known key"),
    ],
)
def test_wrong_settings_are_named(tmp_path, text, words):
    """Oracle: the messages, one line each that names the file and the key."""
    (tmp_path / "x.toml").write_text(SCENARIO + text)
    with pytest.raises(InputError) as problem:
        read_scenario(tmp_path / "x.toml")
    assert words in str(problem.value) and "\n" not in str(problem.value)


def test_all_settings_can_stand_in_a_file(tmp_path):
    (tmp_path / "x.toml").write_text(
        SCENARIO + "quantised = true\ndepth_hz = 1\n[sensors.gnss]\nwander_m = 4.7\noutages_s = [[10, 20], [30, 31]]\n"
        "[sensors.gyrocompass]\nspeed_error = true\n[sensors.rate_gyro]\ndamping_s = 2\n[sensors.imu]\ntilt_known = false\n"
        "[sensors.rudder_indicator]\nplay_deg = 1\n[sensors.resolution]\nposition_min = 1e-7\n"
    )
    sensors = read_scenario(tmp_path / "x.toml").sensors
    assert (sensors.gnss.outages_s, sensors.imu.tilt_known) == (((10.0, 20.0), (30.0, 31.0)), False)
    assert sensors.resolution.position_min == 1e-7
