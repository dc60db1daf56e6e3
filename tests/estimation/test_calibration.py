"""Sensors that are late and a compass that reads too much: the filters allow for it, and tuning finds it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aspnn.estimation import filter_log, smooth_log
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import Measurements
from aspnn.estimation.tuning import tune
from aspnn.frames import station_acceleration, to_north_east
from aspnn.instruments import Calibration, Noise
from aspnn.simulation import Scenario, simulate_scenario
from aspnn.vessel import load_vessel

COLUMNS = {
    "position": ("bow_latitude_deg", "bow_longitude_deg", "stern_latitude_deg", "stern_longitude_deg"),
    "heading": ("heading_deg",),
    "yaw_rate": ("yaw_rate_deg_s",),
    "acceleration": ("acceleration_surge_m_s2", "acceleration_sway_m_s2"),
}
SETTLED = 600


def spoiled(log, offset_deg: float = 0.0, **rows: int):
    """The log with sensors that many rows late and a compass that reads too much."""
    table = log.table.copy()
    for sensor, late in rows.items():
        for name in COLUMNS[sensor]:
            table[name] = table[name].shift(late)
    table["heading_deg"] = (table["heading_deg"] + offset_deg) % 360
    return replace(log, table=table)


def calibrated(log, calibration):
    return replace(log, vessel=replace(log.vessel, calibration=calibration))


def late_records(c: Calibration, n=40, dt=0.5):
    """Noise-free records, late as `c` says, of constant yaw acceleration and constant body accelerations, and the states.

    Oracle: scipy's solve_ivp over the equations of motion, forward and back from midway.
    """
    stations = {"bow": (35.0, 2.0), "stern": (-35.0, -1.0), "imu": (12.0, 3.0)}

    def motion(t, x):
        velocity = np.exp(1j * (0.5 + 0.03 * t + 0.002 * t * t)) * (x[2] + 1j * x[3])
        return [velocity.real, velocity.imag, x[4], x[5], 0, 0]

    start, t = [3.0, -2.0, 6.0, -0.8, 0.05, -0.02], np.arange(n) * dt
    ways = [
        solve_ivp(motion, (0, e), start, rtol=1e-12, atol=1e-12, dense_output=True, method="DOP853") for e in (-9, 30)
    ]

    def state(t):
        return np.where(t < 0, ways[0].sol(t), ways[1].sol(t))

    def turn(t):
        return np.array([0.5 + 0.03 * t + 0.002 * t * t, 0.03 + 0.004 * t, np.full(len(t), 0.004)])

    fixes = {}
    for name in ("bow", "stern"):
        away = to_north_east(*stations[name], turn(t - c.position_delay)[0])
        fixes[name] = (state(t - c.position_delay)[:2] + away).T
    (_, r, dr), (_, _, u, v, a_u, a_v) = turn(t - c.acceleration_delay), state(t - c.acceleration_delay)
    m = Measurements(
        time=t,
        origin=np.zeros(2),
        fixes=fixes,
        heading=turn(t - c.heading_delay)[0] + c.heading_offset,
        convergence=np.zeros(n),
        yaw_rate=turn(t - c.yaw_rate_delay)[1],
        acceleration=np.column_stack(station_acceleration(a_u - v * r, a_v + u * r, r, dr, stations["imu"])),
        stale=np.zeros(n, bool),
        stations=stations,
        calibration=c,
    )
    return m, turn(t).T, state(t).T


@pytest.mark.parametrize(
    "c",
    [
        Calibration(),
        Calibration(
            heading_offset=0.03, position_delay=0.7, heading_delay=2.5, yaw_rate_delay=4.0, acceleration_delay=0.4
        ),
    ],
)
def test_records_of_the_past_leave_no_residual(c):
    """Oracle: integrated motion; with the calibration that the records were made with, z - H x is nothing but rounding."""
    m, heading, motion = late_records(c)
    first = heading_problem(m, Noise(), 6.0, 90.0)
    second = motion_problem(m, Noise(), heading, np.zeros((len(m.time), 3, 3)), 6.0, 90.0)
    for problem, state in ((first, heading), (second, motion)):
        residual = problem.z - np.einsum("nbij,nj->nbi", problem.H, state)
        np.testing.assert_allclose(residual[np.isfinite(residual)], 0, atol=1e-9)
        for b, (low, high) in enumerate(problem.span):
            assert not problem.H[:, b, :, :low].any() and not problem.H[:, b, :, high:].any()


def test_noise_of_the_delay_is_that_of_white_jerk():
    """Oracle: white jerk in closed form at no turn: q tau^5 / 20 in place, q tau^3 / 3 in rate, q tau in acceleration."""
    m, heading, _ = late_records(Calibration())
    heading[:, 1:] = 0.0
    q, tau = Noise(jerk_density=0.3, yaw_jerk_density=0.2), 1.5
    late = replace(m, calibration=Calibration(0.0, tau, tau, tau, tau))
    sure = np.zeros((len(m.time), 3, 3))
    turned = heading_problem(late, q, 6.0, 90.0).R - heading_problem(m, q, 6.0, 90.0).R
    moved = motion_problem(late, q, heading, sure, 6.0, 90.0).R - motion_problem(m, q, heading, sure, 6.0, 90.0).R
    np.testing.assert_allclose(turned[:, 0, 0, 0], 0.2 * tau**5 / 20, rtol=1e-9)
    np.testing.assert_allclose(turned[:, 1, 0, 0], 0.2 * tau**3 / 3, rtol=1e-9)
    np.testing.assert_allclose(moved[:, :2], np.broadcast_to(0.3 * tau**5 / 20 * np.eye(2), (40, 2, 2, 2)), atol=1e-9)
    np.testing.assert_allclose(moved[:, 2], np.broadcast_to(0.3 * tau * np.eye(2), (40, 2, 2)), atol=1e-9)


@pytest.mark.parametrize(
    "rows, offset_deg, worse",
    [
        ({"position": 5}, 0.0, {"north_m": 10, "surge_m_s": 1.4, "sway_m_s": 2.5}),
        ({"heading": 5, "yaw_rate": 2}, 0.0, {"heading_rad": 10, "yaw_rate_rad_s": 1.25, "sway_m_s": 2}),
        ({"position": 2, "acceleration": 5}, 1.5, {"heading_rad": 50, "sway_m_s": 5}),
    ],
)
def test_late_sensors_cost_no_accuracy(voyage, rows, offset_deg, worse):
    """Oracle: the simulator's truth. Told delays and offset, filter and smoother are as accurate as with sensors in time.

    The rms errors are at most 6 % larger, that of the yaw rate 20 % where the gyro is late: the newest record is then of
    0.2 s ago. Not told them, errors are larger by the factors `worse` at least.
    """
    log, truth = voyage
    bad = spoiled(log, offset_deg, **rows)
    c = Calibration(np.radians(offset_deg), **{f"{sensor}_delay": late / 10 for sensor, late in rows.items()})

    def rms(states, name):
        return np.sqrt(np.mean((states[name] - truth[name].to_numpy())[SETTLED:] ** 2))

    for run in (filter_log, smooth_log):
        whole, told, untold = run(log), run(calibrated(bad, c)), run(bad)
        for name in ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s"):
            bound = 1.2 if name == "yaw_rate_rad_s" and "yaw_rate" in rows else 1.06
            assert rms(told, name) < bound * rms(whole, name), name
        for name, factor in worse.items():
            assert rms(untold, name) > factor * rms(whole, name), name


@pytest.fixture(scope="module")
def manoeuvres():
    """Two logs of ten minutes of cargo90, random orders."""
    scenario = {
        "name": "calibration",
        "vessel": "cargo90",
        "duration_s": 600,
        "start": {"speed_kn": 11.5, "latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": 200},
        "manoeuvre": {"kind": "random-orders"},
    }
    return [log for log, _ in simulate_scenario(Scenario.model_validate(scenario), 2, 909)]


@pytest.mark.parametrize(
    "rows, offset_deg, clock, expected",
    [
        ({"position": 5, "heading": 2}, 1.5, "yaw_rate_delay", Calibration(np.radians(1.5), 0.5, 0.2)),
        (
            {"heading": 5, "yaw_rate": 5, "acceleration": 5},
            -1.5,
            "position_delay",
            Calibration(np.radians(-1.5), 0.0, 0.5, 0.5, 0.5),
        ),
    ],
)
def test_tuning_finds_delays_and_offset(manoeuvres, rows, offset_deg, clock, expected):
    """Oracle: what was planted. Delays within 0.05 s, the offset within 0.05 deg, all within 3 standard errors; sensors
    that are in time stay at zero, by a note or as the quickest."""
    logs = [spoiled(log, offset_deg, **rows) for log in manoeuvres]
    tuning = tune(logs, load_vessel("cargo90"), delays=True, heading=True)
    found = tuning.vessel.calibration
    for name in ("position_delay", "heading_delay", "yaw_rate_delay", "acceleration_delay", "heading_offset"):
        value, truth = getattr(found, name), getattr(expected, name)
        assert abs(value - truth) < 3 * tuning.errors.get(name, 0.0) or value == truth, name
        if name != "acceleration_delay":  # told but roughly: its standard error is 0.07 s
            assert value == pytest.approx(truth, abs=np.radians(0.05) if name == "heading_offset" else 0.05), name
    assert tuning.errors["heading_offset"] < np.radians(0.02)
    assert [name for name, said in tuning.notes.items() if "the clock" in said] == [clock]


def test_what_the_logs_cannot_tell_stays(manoeuvres):
    """Law: no gyro and no IMU: no delays of theirs; one antenna: no offset; sensors in time: no delay. Each is said."""
    words = ("stern_", "yaw_rate", "acceleration")
    logs = [
        replace(log, table=log.table.drop(columns=[c for c in log.table if c.startswith(words)])) for log in manoeuvres
    ]
    tuning = tune(logs, load_vessel("cargo90"), delays=True, heading=True)
    assert tuning.vessel.calibration == Calibration()
    assert "two antennas" in tuning.notes["heading_offset"]
    assert "no such sensor" in tuning.notes["yaw_rate_delay"] and "no such sensor" in tuning.notes["acceleration_delay"]
    assert "within 3 standard errors" in tuning.notes["position_delay"]
