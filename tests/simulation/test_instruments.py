"""Compass, rate gyro, accelerometers and rudder indicator: each error against its law, a published table or its statistic."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_voyages import made
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from aspnn.frames import Zone, to_grid
from aspnn.instruments import Mounting
from aspnn.simulation import Sensors, Voyage, measure
from aspnn.simulation.sensing.errors import bias, damped, play
from aspnn.simulation.sensing.instruments import (
    GRAVITY,
    Gyrocompass,
    Imu,
    RateGyro,
    RudderIndicator,
    compass_error,
    imu_reads,
    unit_errors,
)
from aspnn.vessel import load_vessel

ZONE = Zone.parse("33N")
PLACE = to_grid(np.radians(69.65), np.radians(18.96), ZONE)
VESSEL = load_vessel("cargo90").with_stations(imu=(-20.0, 2.5))
PLATH = Path(__file__).parents[1] / "reference" / "gyro_speed_error_plath.csv"
TILT = {"roll": ((0.15, 0.9, 0.0),), "pitch": ((0.04, 1.1, 0.3), (0.0, 0, 0.02)), "heave": ((0.8, 0.7, 0.1),)}
QUIET = {"position_m": 0, "heading_deg": 0, "yaw_rate_deg_s": 0, "acceleration_m_s2": 0}


def read(voyage, vessel=VESSEL, seed=0, **sensors):
    return measure(voyage, vessel, ZONE, Sensors(**{**QUIET, **sensors}), np.random.default_rng(seed))


def plath():
    with open(PLATH) as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    for row in rows[1:]:
        for speed, error in zip(rows[0][2:], row[2:], strict=True):
            yield float(row[0]), float(row[1]), float(speed), float(error)


def test_speed_error_is_that_of_a_makers_table():
    """Oracle: the published table, to one unit of its last place. It goes by the compass heading; the true one is less by the
    error. The mirror (south) reads too little."""
    for latitude, heading, speed, error in plath():
        for north in (1, -1):
            course = np.radians(heading - error) if north > 0 else np.radians(180 - heading + error)
            state = (np.full(3, x) for x in (course, speed * 1852 / 3600, 0.0, np.radians(latitude)))
            found = compass_error(Gyrocompass(speed_error=True), np.arange(3.0), *state)
            np.testing.assert_allclose(np.degrees(found), north * error, atol=0.1)


def test_compass_settles_by_its_law():
    """Oracle: the law at 0, half a period and a period; and after a change of course the speed error follows in its time."""
    gyro = Gyrocompass(offset_deg=1.5, settling_deg=4.0, settling_time_s=1000.0, settling_period_s=600.0)
    t = np.arange(0, 601, 1.0)
    still = np.zeros(len(t))
    found = np.degrees(compass_error(gyro, t, still, still, still, still))
    np.testing.assert_allclose(found[[0, 300, 600]], [5.5, 1.5 - 4 * np.exp(-0.3), 1.5 + 4 * np.exp(-0.6)], atol=1e-12)
    plain = Gyrocompass(settling_deg=4.0, settling_time_s=1000.0, settling_period_s=0)
    found = np.degrees(compass_error(plain, t + 50, still, still, still, still))
    np.testing.assert_allclose(found, 4 * np.exp(-t / 1000), atol=1e-12)
    heading = np.where(t < 100, 0.0, np.pi / 2)  # from north to east
    gyro = Gyrocompass(speed_error=True, settling_time_s=200.0)
    found = compass_error(gyro, t, heading, still + 6, still, still + 1.2)
    full = np.arctan2(6, 7.292115e-5 * 6.371e6 * np.cos(1.2))
    np.testing.assert_allclose(found[:100], full, rtol=1e-12)
    np.testing.assert_allclose(found[100:], full * np.exp(-(t[100:] - 99.5) / 200), rtol=1e-4)


def test_compass_error_reaches_the_log():
    voyage = made(PLACE, 60.0)
    plain, wrong = read(voyage), read(voyage, gyrocompass=Gyrocompass(offset_deg=-2.0))
    np.testing.assert_allclose((wrong["heading_deg"] - plain["heading_deg"]) % 360, 358, atol=1e-9)


@pytest.mark.parametrize("time", [0.05, 2.0, 30.0])
def test_damping_is_a_first_order_lag(time):
    """Oracle: scipy's solution of y' = (x - y) / T for a course of straight pieces, which the filter takes exactly."""
    t = np.arange(0, 40.05, 0.1)
    x = np.interp(t, [0, 5, 12, 20, 40], [0.3, 0.3, -1.0, 2.0, 0.0])
    found = damped(x, 0.1, time)
    exact = [0.3]
    for k in range(len(t) - 1):  # piece by piece, so that the solver sees no corner
        piece = solve_ivp(
            lambda s, y, k=k: (np.interp(s, t, x) - y) / time, t[k : k + 2], exact[-1:], "LSODA", rtol=1e-10, atol=1e-12
        )
        exact.append(piece.y[0, -1])
    np.testing.assert_allclose(found, exact, atol=1e-8)


def test_rate_gyro_is_damped_and_biased():
    """Oracle: a steady sine through a lag has the gain 1 / sqrt(1 + (w T)^2) and the phase -atan(w T); biases are constants."""
    w, lag = 0.5, 2.0
    voyage = made(PLACE, 400.0, turn=((0.2 / w, w, 0.0),))
    table = read(voyage, rate_gyro=RateGyro(damping_s=lag))
    late = voyage.time > 60
    expected = np.degrees(0.2 / np.hypot(1, w * lag) * np.cos(w * voyage.time - np.arctan(w * lag)))
    np.testing.assert_allclose(table["yaw_rate_deg_s"][late], expected[late], atol=np.degrees(0.2) * (w * 0.1) ** 2)
    offset = read(voyage, rate_gyro=RateGyro(bias_deg_s=0.1))["yaw_rate_deg_s"] - np.degrees(voyage.yaw_rate)
    np.testing.assert_allclose(offset, offset[0], atol=1e-12)
    assert 0 < abs(offset[0]) < 0.5


def test_biases_have_their_deviation_and_walk():
    """Oracle: variance b^2 + w^2 t / 1 h at 4.5 standard errors over 4000 draws; increments of the walk are independent."""
    count, dt = 4000, 7.2
    x = bias(np.random.default_rng(4), (count, 501), dt, 0.3, 0.5)
    t = np.array([0, 100, 500]) * dt
    np.testing.assert_allclose(
        (x[:, [0, 100, 500]] ** 2).mean(0), 0.09 + 0.25 * t / 3600, rtol=4.5 * np.sqrt(2 / count)
    )
    early, late = x[:, 100] - x[:, 0], x[:, 500] - x[:, 100]
    assert abs(np.corrcoef(early, late)[0, 1]) < 4.5 / np.sqrt(count)


def test_rate_gyro_turns_with_the_body():
    """Oracle: the rotation from one step to the next, by scipy: a gyro fixed to a rolling ship reads r, not psi' (E11)."""
    voyage = made(PLACE, 60.0, dt=0.02, turn=((0.3, 0.2, 0.0),), **TILT)
    turns = Rotation.from_euler("ZYX", np.stack([voyage.heading, voyage.pitch, voyage.roll], axis=-1))
    middle = (turns[:-2].inv() * turns[2:]).as_rotvec() / 0.04
    told = np.radians(read(voyage, yaw_rate_hz=50)["yaw_rate_deg_s"].to_numpy())
    np.testing.assert_allclose(told[1:-1], middle[:, 2], atol=1e-4)
    assert np.abs(told - voyage.yaw_rate).max() > 5e-3


def test_accelerometers_read_the_second_derivative_of_their_track():
    """Oracle: second differences of the track of the station `imu` in space, turned into the body's axes by scipy (E1, E5)."""
    voyage = made(PLACE, 60.0, dt=0.02, turn=((0.3, 0.2, 0.0),), **TILT)
    vessel = replace(VESSEL, heights={"imu": 9.0})
    table = read(voyage, vessel, acceleration_hz=50, imu=Imu(heave=True))
    turns = Rotation.from_euler("ZYX", np.stack([voyage.heading, voyage.pitch, voyage.roll], axis=-1))
    origin = np.stack([voyage.north - PLACE[0], voyage.east - PLACE[1], voyage.heave], axis=-1)
    track = origin + turns.apply([-20.0, 2.5, -9.0])
    second = turns[1:-1].inv().apply((track[2:] - 2 * track[1:-1] + track[:-2]) / 0.02**2)
    told = table[[f"acceleration_{axis}_m_s2" for axis in ("surge", "sway", "heave")]].to_numpy()
    np.testing.assert_allclose(told[2:-2], second[1:-1], atol=2e-3)
    assert np.abs(second).max(0).min() > 0.1


def reads(imu, acceleration, roll, pitch, dt, rng):
    return imu_reads(imu, unit_errors(imu, acceleration.shape[1], dt, rng), acceleration, roll, pitch)


def test_gravity_leaks_by_the_sine_of_roll_and_pitch():
    """Oracle: the specific force of a body at rest by hand: bow up reads forward, starboard down reads to port."""
    still = np.zeros((3, 5))
    rng = np.random.default_rng(0)
    roll, pitch = np.full(5, 0.1), np.full(5, 0.05)
    leak = reads(Imu(tilt_known=False), still, roll, pitch, 0.1, rng)[:, 0] / GRAVITY
    c = np.cos(0.05)
    np.testing.assert_allclose(leak, [np.sin(0.05), -c * np.sin(0.1), 1 - c * np.cos(0.1)], atol=1e-15)
    np.testing.assert_allclose(reads(Imu(heave=True), still, roll, pitch, 0.1, rng), 0, atol=1e-15)
    five = reads(Imu(tilt_known=False), still, np.full(5, np.radians(5)), np.zeros(5), 0.1, rng)
    assert five[1, 0] == pytest.approx(-0.855, abs=5e-4)  # erratum E12: 5 degrees of heel, 0.855 m/s2


def test_badly_known_tilt_leaks_and_remembers():
    """Oracle: g times a Gauss-Markov angle: its deviation, and its correlation after one time constant, over 500 of these."""
    dt, count = 0.5, 60_000
    imu = Imu(tilt_deg=0.2, tilt_time_s=60.0)
    leak = reads(imu, np.zeros((3, count)), np.zeros(count), np.zeros(count), dt, np.random.default_rng(1))
    spread = GRAVITY * np.radians(0.2)
    for axis in leak[:2]:
        assert abs((axis**2).mean() / spread**2 - 1) < 4.5 * np.sqrt(2 * 60 / (count * dt))
        assert abs((axis[120:] * axis[:-120]).mean() / spread**2 - np.exp(-1)) < 4.5 * np.sqrt(60 / (count * dt)) * 1.2
    assert np.abs(leak[2]).max() < GRAVITY * np.radians(1.5) ** 2


def test_misalignment_is_a_rotation():
    """Law: it keeps the length of the specific force. Statistic: upright and at rest it leaks g times each angle."""
    rng = np.random.default_rng(3)
    count, imu = 3000, Imu(misalignment_deg=0.5)
    upright = [reads(imu, np.zeros((3, 2)), np.zeros(2), np.zeros(2), 0.1, rng.spawn(1)[0])[:, 0] for _ in range(count)]
    forward, starboard, down = np.array(upright).T
    for axis in (forward, starboard):
        assert abs((axis**2).mean() / (GRAVITY * np.radians(0.5)) ** 2 - 1) < 4.5 * np.sqrt(2 / count) + 1e-3
    np.testing.assert_allclose(np.hypot(np.hypot(forward, starboard), down - GRAVITY), GRAVITY, rtol=1e-12)


FORCES = [f"imu_force_{axis}_m_s2" for axis in "xyz"]
RATES = [f"imu_rate_{axis}_deg_s" for axis in "xyz"]
PAPER = Mounting(("x", "-y", "-z"), sign=-1.0)  # thesis 3.44, 3.46: upside down, reads g - a


@pytest.mark.parametrize(
    ("mounting", "at_rest"),
    [
        (Mounting(), (0, 0, -1)),
        (PAPER, (0, 0, -1)),  # its z axis points up, against gravity
        (Mounting(("x", "-y", "-z")), (0, 0, 1)),
        (Mounting(("z", "x", "y")), (0, -1, 0)),  # its y axis points down
        (
            Mounting(misalignment=(0.0, 0.1, 0.0)),
            (np.sin(0.1), 0, -np.cos(0.1)),
        ),  # bow up of the ship: x feels the push up
    ],
)
def test_a_unit_at_rest_reads_gravity_along_its_axes(mounting, at_rest):
    """Oracle: by hand, for each mounting; and the vessel's own matrix turns what is read into (0, 0, -g)."""
    voyage = made(PLACE, 10.0, speed=(0.0, 0.0))
    moving = ("surge", "sway", "yaw_rate", "surge_rate", "sway_rate", "yaw_acceleration")
    still = replace(voyage, **dict.fromkeys(moving, 0 * voyage.time))
    table = read(still, replace(VESSEL, mounting=mounting), imu=Imu(raw=True))
    np.testing.assert_allclose(table[FORCES] / GRAVITY, np.tile(at_rest, (len(table), 1)), atol=1e-12)
    np.testing.assert_allclose(
        table[FORCES].to_numpy() @ mounting.matrix().T, np.tile([0, 0, -GRAVITY], (len(table), 1)), atol=1e-12
    )
    np.testing.assert_array_equal(table[RATES], 0)


def test_a_unit_in_a_banked_turn_reads_the_centripetal_force():
    """Oracle: by hand. A steady turn to starboard at u, r with a steady bank: (0, u r, 0) inwards and level, gravity down, the rate of
    heading about the vertical, all seen from the banked ship; a bank of atan(u r / g) inwards leaves no side force."""
    t = np.arange(101) * 0.1
    u, r = 6.0, 0.3
    for bank in (0.0, 0.2, np.arctan2(u * r, GRAVITY)):
        still = 0 * t
        place = PLACE[0] + u / r * np.sin(r * t), PLACE[1] - u / r * np.cos(r * t)
        voyage = Voyage.level(t, *place, r * t, still + u, still, still + r, still, still, still, still, still)
        vessel = replace(VESSEL.with_stations(imu=(0.0, 0.0)), mounting=PAPER)
        table = read(replace(voyage, roll=still + bank), vessel, imu=Imu(raw=True))
        c, s = np.cos(bank), np.sin(bank)
        ship = np.array([0, u * r * c - GRAVITY * s, -u * r * s - GRAVITY * c])
        np.testing.assert_allclose(table[FORCES].iloc[50], ship * [-1, 1, 1], atol=1e-12)
        np.testing.assert_allclose(
            np.radians(table[RATES].iloc[50].to_numpy(float)), r * np.array([0, -s, -c]), atol=1e-12
        )
    assert abs(ship[1]) < 1e-12 and ship[2] == pytest.approx(-np.hypot(u * r, GRAVITY))


def test_raw_readings_are_those_of_the_track_in_space():
    """Oracle: scipy. Through the mounting and the attitude the forces are the second differences of the track of the station `imu`
    less gravity (a = C f + (0, 0, g), E12), and the rates the rotation from one step to the next."""
    voyage = made(PLACE, 60.0, dt=0.02, turn=((0.3, 0.2, 0.0),), **TILT)
    mounting = Mounting(("-y", "x", "z"), (0.02, -0.015, 0.03), -1.0)
    vessel = replace(VESSEL, heights={"imu": 9.0}, mounting=mounting)
    table = read(voyage, vessel, acceleration_hz=50, imu=Imu(raw=True))
    turns = Rotation.from_euler("ZYX", np.stack([voyage.heading, voyage.pitch, voyage.roll], axis=-1))
    origin = np.stack([voyage.north - PLACE[0], voyage.east - PLACE[1], voyage.heave], axis=-1)
    track = origin + turns.apply([-20.0, 2.5, -9.0])
    second = (track[2:] - 2 * track[1:-1] + track[:-2]) / 0.02**2
    felt = turns.apply(table[FORCES].to_numpy() @ mounting.matrix().T) + np.array([0, 0, GRAVITY])
    np.testing.assert_allclose(felt[2:-2], second[1:-1], atol=2e-3)
    middle = (turns[:-2].inv() * turns[2:]).as_rotvec() / 0.04
    rates = np.radians(table[RATES].to_numpy()) @ mounting.rotation().T
    np.testing.assert_allclose(rates[1:-1], middle, atol=1e-4)


def test_raw_errors_are_those_of_one_unit():
    """Law: the misalignment drawn turns forces and rates alike, and keeps their lengths. Statistics at 4.5 standard errors: the gyros'
    biases have their deviation and are constants; white noise is that of accelerometers and rate gyro, and none is in common."""
    voyage = made(PLACE, 200.0, turn=((0.3, 0.2, 0.0),), **TILT)
    true, off = read(voyage, imu=Imu(raw=True)), read(voyage, seed=3, imu=Imu(raw=True, misalignment_deg=3.0))
    by_force, _ = Rotation.align_vectors(off[FORCES], true[FORCES])
    by_rate, _ = Rotation.align_vectors(off[RATES], true[RATES])
    assert (by_force.inv() * by_rate).magnitude() < 1e-6 < np.radians(0.5) < by_force.magnitude()
    np.testing.assert_allclose(np.linalg.norm(off[FORCES], axis=1), np.linalg.norm(true[FORCES], axis=1))
    short, found = made(PLACE, 2.0), []
    ideal = read(short, imu=Imu(raw=True))[FORCES + RATES]
    for seed in range(100):
        gained = read(short, seed=seed, imu=Imu(raw=True, gyro_bias_deg_s=0.2, bias_m_s2=0.1))[FORCES + RATES] - ideal
        assert np.ptp(gained.to_numpy(), axis=0).max() < 1e-9
        found.append(gained.iloc[0].to_numpy() / np.repeat([0.1, 0.2], 3))
    assert np.abs((np.array(found) ** 2).mean(axis=0) - 1).max() < 4.5 * np.sqrt(2 / 100)
    noise = (
        read(voyage, imu=Imu(raw=True), acceleration_m_s2=0.05, yaw_rate_deg_s=0.3)[FORCES + RATES]
        - true[FORCES + RATES]
    )
    noise = noise.to_numpy() / np.repeat([0.05, 0.3], 3)
    n = len(noise)
    assert np.abs(noise.var(axis=0) - 1).max() < 4.5 * np.sqrt(2 / n)
    assert np.abs(np.corrcoef(noise.T) - np.eye(6)).max() < 4.5 / np.sqrt(n)


def test_rudder_indicator_has_play_and_a_wrong_zero():
    """Oracle: by hand. A sweep there and back through 4 degrees of play, and a pointer that is 1 degree off."""
    swept = np.array([0.0, 1, 2, 3, 10, 9, 7, 6, 5, -10, -9, -6, -5])
    told = play(swept, 4.0)
    np.testing.assert_array_equal(told, [0, 0, 0, 1, 8, 8, 8, 8, 7, -8, -8, -8, -7])
    voyage = made(PLACE, 200.0)
    table = read(voyage, rudder_indicator=RudderIndicator(play_deg=2.0, offset_deg=1.0))
    error = table["rudder_angle_deg"] - 1.0 - np.degrees(voyage.rudder)
    assert np.abs(error).max() < 1 + 1e-9
    steady = np.abs(np.cos(0.05 * voyage.time)) > 0.5  # once the play is taken up the pointer trails by half of it
    late = steady & (voyage.time > 2)
    np.testing.assert_allclose(error[late], -np.sign(np.cos(0.05 * voyage.time[late])), atol=1e-9)
