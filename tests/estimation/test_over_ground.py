"""Course and speed over ground as measurements of the planar filter."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.estimation import filter_log
from aspnn.estimation.cascade import run_cascade
from aspnn.estimation.measurements import from_log
from aspnn.estimation.over_ground import filter_over_ground, velocity, with_velocity
from aspnn.frames import Zone, convergence, to_geodetic
from aspnn.motion import integrate
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

ZONE = Zone(33)


def turning_log(noise: float = 0.0, every: float = 5.0) -> tuple[Log, np.ndarray]:
    """A ship of steady surge 6 and sway -1 m/s that turns at 0.5 deg/s, her antenna 35 m aft and 4 m to port,
    and her true velocity (n, 2)."""
    rng, step = np.random.default_rng(5), 0.05
    r = np.radians(0.5)
    path = integrate((7728000.0, 425000.0, 0.3), np.tile([6.0, -1.0, r], (12_000, 1)), step)
    rows = slice(None, None, round(every / step))
    north, east, psi = path.north[rows], path.east[rows], path.heading[rows]
    station = -35.0 - 4.0j
    place = north + 1j * east + station * np.exp(1j * psi)
    moved = np.exp(1j * psi) * (6.0 - 1.0j + 1j * r * station)
    place = place + noise * (rng.standard_normal(len(psi)) + 1j * rng.standard_normal(len(psi)))
    latitude, longitude = to_geodetic(place.real, place.imag, ZONE)
    gamma = convergence(latitude, longitude, ZONE)
    told = moved + 0.1 * (noise > 0) * (rng.standard_normal(len(psi)) + 1j * rng.standard_normal(len(psi)))
    table = {
        "time_s": np.arange(len(psi)) * every,
        "gnss_latitude_deg": np.degrees(latitude),
        "gnss_longitude_deg": np.degrees(longitude),
        "heading_deg": np.degrees(psi + gamma) % 360,
        "yaw_rate_deg_s": 0.5 + 0 * psi,
        "course_over_ground_deg": np.degrees(np.angle(told) + gamma) % 360,
        "speed_over_ground_m_s": np.abs(told),
    }
    vessel = load_vessel("cargo90").with_stations(gnss=(-35.0, -4.0))
    return Log(pd.DataFrame(table), vessel, ZONE, "2025-06-01T00:00:00Z", "made up", "turn"), np.column_stack(
        [moved.real, moved.imag]
    )


def test_the_velocity_is_that_of_the_antenna_on_the_grid():
    """Analytic: course and speed as told come back as the antenna's velocity north and east;
    the row at the true state has no innovation."""
    log, moved = turning_log()
    m = from_log(log)
    np.testing.assert_allclose(velocity(log, m), moved, atol=2e-4)  # the filter holds the convergence for a second
    cascade = run_cascade(log)
    n = len(m.time)
    heading = np.column_stack([m.heading, m.yaw_rate, 0 * m.yaw_rate])
    problem = with_velocity(cascade.motion, m, velocity(log, m), heading, np.zeros((n, 3, 3)), 0.1)
    x = np.array([0.0, 0.0, 6.0, -1.0, 0.0, 0.0])
    np.testing.assert_allclose(problem.H[:, 1] @ x, problem.z[:, 1], atol=1e-3)
    np.testing.assert_allclose(problem.R[:, 1], np.broadcast_to(0.01 * np.eye(2), (n, 2, 2)))
    # What is 2 s late told the velocity at 2 s ago: the same row, on a log whose course and speed come so late.
    shifted = np.column_stack([np.interp(m.time - 2.0, m.time, moved[:, axis]) for axis in (0, 1)])[5:]
    late = with_velocity(cascade.motion, m, np.vstack([moved[:5], shifted]), heading, np.zeros((n, 3, 3)), 0.1, 2.0)
    np.testing.assert_allclose((late.H[:, 1] @ x)[6:], late.z[6:, 1], atol=0.01)  # of linear interpolation
    np.testing.assert_array_equal(problem.z[:, [0, 2]], cascade.motion.z)  # fixes and accelerations as they were


def test_without_a_velocity_it_is_the_planar_filter():
    """Law: where course and speed are told but once, the states before are those of `filter_log` to the last bit."""
    log, _ = turning_log(noise=1.0)
    table = log.table.copy()
    table.loc[: len(table) - 2, ["course_over_ground_deg", "speed_over_ground_m_s"]] = np.nan
    sparse = replace(log, table=table)
    ours, plain = filter_over_ground(sparse).table.iloc[:-1], filter_log(sparse).table.iloc[:-1]
    pd.testing.assert_frame_equal(ours, plain)
    with pytest.raises(InputError, match="column course_over_ground_deg has no value"):
        filter_over_ground(replace(log, table=log.table.drop(columns="course_over_ground_deg")))


def test_it_is_consistent_and_better():
    """Statistics: fixes of 1 m every 5 s in a steady turn with velocities of 0.1 m/s. Surge and sway come within three times the
    deviation that the states tell (n = 100 correlated rows), and nearer to the truth than by positions alone."""
    log, _ = turning_log(noise=1.0)
    both, plain = filter_over_ground(log), filter_log(log)
    late = both["time_s"] > 100
    for name, true in (("surge_m_s", 6.0), ("sway_m_s", -1.0)):
        off = np.sqrt(np.mean((both[name][late] - true) ** 2))
        assert off < np.sqrt(np.mean(both[f"{name}_sd"][late] ** 2)) * 1.5
        assert off < 0.85 * np.sqrt(np.mean((plain[name][late] - true) ** 2))
