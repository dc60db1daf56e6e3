"""The 3D-PV filter and its glue: against filterpy, closed forms, and statistics of matched noise."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm
from scipy.stats import chi2

from aspnn import schema
from aspnn.angles import wrap
from aspnn.estimation import spatial_engine as engine
from aspnn.estimation.consistency import average_bounds, shares
from aspnn.estimation.position_velocity import PaperVI, Scaled, as_noise, compass_run, derived, steps
from aspnn.estimation.problem import REACQUIRED, REJECTED
from aspnn.estimation.spatial import filter_spatial, midship, solve_error_state, solve_position_velocity
from aspnn.estimation.spatial_inputs import from_ship_log
from aspnn.prediction.kinematic import KinematicPredictor
from aspnn.schema import InputError
from tests.estimation.boats import EXACT, PERIOD, Boat, Errors, boat_log

BOTH = (solve_position_velocity, solve_error_state)


@pytest.fixture(scope="module")
def rough():
    """Eight minutes of a boat that rolls to 14 and pitches to 9 degrees, sensors with white noise and nothing else; and its times."""
    return boat_log(Boat(), 480.0, Errors(), seed=3)


def _matched(n: int, seed: int):
    """A made-up linear problem of six states with input and two blocks of three rows, some rows missing; its noise is as told."""
    rng = np.random.default_rng(seed)
    dt, d = 0.13, 6
    F = np.tile(np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]]), (n, 1, 1))
    root = rng.standard_normal((d, d)) * 0.05
    Q, u = np.tile(root @ root.T, (n, 1, 1)), rng.standard_normal((n, d)) * 0.1
    H = np.zeros((2, 3, d))
    H[:, :, :3], H[1, :, 3:] = np.eye(3), -0.2 * np.eye(3)
    roots = rng.standard_normal((2, 3, 3)) * 0.3 + 0.4 * np.eye(3)
    R = np.tile(roots @ roots.transpose(0, 2, 1), (n, 1, 1, 1))
    x, z = rng.standard_normal(d), np.empty((n, 2, 3))
    for k in range(n):
        x = F[k] @ x + u[k] + root @ rng.standard_normal(d)
        z[k] = np.einsum("bij,j->bi", H, x) + np.einsum("bij,bj->bi", roots, rng.standard_normal((2, 3)))
    z[rng.random(z.shape) < 0.1] = np.nan
    blocks = engine.Blocks(
        z=z,
        H=H,
        span=np.array([[0, 3], [0, 6]]),
        R=R,
        angle=np.zeros(2, bool),
        gates=np.full((2, 3), np.inf),
        group=np.zeros(2, np.int64),
        place=np.zeros((2, d)),
        rate=np.zeros((2, d)),
    )
    return engine.Driven(np.arange(n) * dt, F, u, Q, blocks)


def test_engine_is_filterpys():
    """Oracle: filterpy's KalmanFilter with the blocks one after the other, rows without value left out."""
    problem = _matched(200, 5)
    found = engine.run(problem, engine.beginning(0.0, np.zeros(6), 4 * np.eye(6), problem.blocks.group))
    kf = KalmanFilter(dim_x=6, dim_z=3)
    kf.x, kf.P = np.zeros(6), 4 * np.eye(6)
    for k in range(len(problem.time)):
        kf.predict(F=problem.F[k], Q=problem.Q[k])
        kf.x = kf.x + problem.u[k]
        for b in range(2):
            have = np.isfinite(problem.blocks.z[k, b])
            if have.any():
                kf.dim_z = int(have.sum())
                H, R = problem.blocks.H[b][have], problem.blocks.R[k, b][np.ix_(have, have)]
                y = problem.blocks.z[k, b][have] - H @ kf.x
                nis = y @ np.linalg.inv(H @ kf.P @ H.T + R) @ y
                assert found.nis[k, b] == pytest.approx(nis, rel=1e-9)
                kf.update(problem.blocks.z[k, b][have], R=R, H=H)
        np.testing.assert_allclose(found.mean[k], kf.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.covariance[k], kf.P, rtol=0, atol=1e-10)


def test_nis_of_a_block_has_as_many_degrees_of_freedom_as_rows():
    """Statistic: 4,000 epochs of a matched problem; by number of rows the mean NIS is that number, within 4 standard errors (E32)."""
    problem = _matched(4000, 6)
    found = engine.run(problem, engine.beginning(0.0, np.zeros(6), 4 * np.eye(6), problem.blocks.group))
    rows = np.isfinite(problem.blocks.z).sum(-1)
    for dof in (1, 2, 3):
        nis = found.nis[rows == dof]
        assert abs(nis.mean() - dof) < 4 * np.sqrt(2 * dof / len(nis))
    nis = found.nis[rows == 3]
    inside = shares(nis, *average_bounds(np.array([3.0]))).inside
    assert abs(inside - 0.95) < 4 * np.sqrt(0.05 * 0.95 / len(nis))


def test_two_runs_are_one():
    """Law: a run carried on where another ended gives the same states to the last bit."""
    problem = _matched(60, 7)
    start = engine.beginning(0.0, np.zeros(6), 4 * np.eye(6), problem.blocks.group)
    whole, first = engine.run(problem, start), engine.run(problem.of(slice(0, 25)), start)
    second = engine.run(problem.of(slice(25, 60)), first.carry)
    np.testing.assert_array_equal(whole.mean, np.concatenate([first.mean, second.mean]))
    assert whole.log_likelihood == pytest.approx(first.log_likelihood + second.log_likelihood, rel=1e-12)


def test_gates_are_those_of_three_degrees_of_freedom():
    """Oracle: scipy's chi-square."""
    np.testing.assert_allclose(engine.gates(1e-3), chi2.isf(1e-3, [1, 2, 3]))


@pytest.mark.parametrize("solve", BOTH)
def test_exact_sensors_give_the_exact_motion(solve):
    """Oracle: the closed formulas of a boat with antenna and IMU off midship: place, surge, sway, sinking, heading and its rate.

    Gravity (E12), the sign of the height (E13), lever arms and the heading's rate (E11) each err by decimetres if they are wrong.
    """
    boat = Boat()
    log, t = boat_log(boat, 60.0, EXACT)
    states, late = filter_spatial(log, solve), t > 20
    sought = {"surge_m_s": boat.level(t)[:, 0], "sway_m_s": boat.level(t)[:, 1], "yaw_rate_rad_s": boat.heading_rate(t)}
    sought |= {"down_velocity_m_s": boat.velocity(t)[:, 2], "down_m": boat.place(t)[:, 2] - 30.0}
    sought |= {"north_m": boat.place(t)[:, 0], "east_m": boat.place(t)[:, 1], "roll_rad": boat.euler(t)[:, 0]}
    for name, value in sought.items():
        np.testing.assert_allclose(states[name][late], value[late], atol=0.02, err_msg=name)
    np.testing.assert_allclose(wrap(states["heading_rad"] - boat.euler(t)[:, 2])[late], 0, atol=1e-3)
    gyro = log.table["yaw_rate_deg_s"].to_numpy()
    assert np.abs(np.radians(gyro) - boat.heading_rate(t)).max() > 0.03  # so its own rate would have failed


@pytest.mark.parametrize("solve", BOTH)
def test_surge_and_sway_accelerations_are_the_rates_of_surge_and_sway(solve):
    """Oracle: differences of the boat's surge and sway."""
    boat = Boat(roll=0.05, pitch=0.03)
    log, t = boat_log(boat, 40.0, EXACT)
    states, late = filter_spatial(log, solve), t > 20
    for k, name in enumerate(("surge", "sway")):
        rate = (boat.level(t + 1e-3) - boat.level(t - 1e-3))[:, k] / 2e-3
        np.testing.assert_allclose(states[f"{name}_acceleration_m_s2"][late], rate[late], atol=0.15, err_msg=name)


@pytest.mark.parametrize("solve", BOTH)
def test_states_keep_the_contract_and_serve_a_predictor(rough, solve):
    """Law: every column is known to the schema, what planar states need is there and finite, and a predictor takes them."""
    log, _ = rough
    states = filter_spatial(log, solve)
    schema.check(states.table, schema.STATES)
    estimates = states.table.filter(regex="^(north|east|heading|surge|sway|yaw|down|roll|pitch)")
    assert np.isfinite(estimates.to_numpy()).all()
    path = KinematicPredictor(log.vessel).predict(states.until(200.0))
    assert np.isfinite(path.north).all()
    assert "nis_bow" in states.table and states.table["innovation_bow_down_m"].notna().all()


def test_consistent_on_a_boat_that_rolls(rough):
    """Statistic: NIS of 3 and of 2 degrees of freedom inside their 95 % bounds, and the velocity better than 0.05 m/s (the issue's).

    The share of n white values spreads by sqrt(.05 x .95 / n) = 0.0037; the issue asks for 0.94 to 0.96. A smooth boat is quieter than
    white yaw jerk, so CAA is asked for 0.92 here; on simulated voyages it is measured apart.
    """
    log, t = rough
    found, boat = solve_position_velocity(log), Boat()
    late = t > 30
    nis = shares(found.moving.fit.nis[late, 0], *average_bounds(np.array([3.0])))
    assert 0.935 < nis.inside < 0.965
    turning = shares(found.turning.nis[late].sum(axis=1), *average_bounds(np.array([2.0])))
    assert 0.92 < turning.inside < 0.98
    at = midship(found)
    error = np.stack([at.surge, at.sway], axis=1) - boat.level(t)
    assert np.sqrt(np.mean(error[late] ** 2)) < 0.05


def test_derived_noise_is_van_loans(rough):
    """Oracle: Van Loan's matrix exponential of the double integrator with the density that Q tells for the velocity."""
    log, _ = rough
    i = from_ship_log(log)
    _, _, Q, _ = steps(i, log.vessel, compass_run(i, log.vessel), derived)
    dt = PERIOD
    density = Q[50, 3:, 3:] / dt
    A = np.zeros((12, 12))
    A[:3, 3:6] = -np.eye(3)
    A[3:6, 9:12] = density
    A[9:12, 6:9] = np.eye(3)
    B = expm(A * dt)
    np.testing.assert_allclose(Q[50], B[6:, 6:].T @ B[:6, 6:], rtol=1e-9, atol=1e-15)
    least = (log.vessel.noise.acceleration**2 + (9.8 * log.vessel.spatial.attitude) ** 2) * dt
    assert density[0, 0] > 0.9 * least  # accelerometer, and gravity by the attitude's error


def test_bias_as_noise_is_consistent_with_the_filters_memory():
    """Law: the density s it returns is 2 bias^2 / w with w = (s / r)^(1 / (2 n)), the corner of the steady filter."""
    for integrals in (1, 2):
        s = as_noise(0.02, 3e-3, integrals)
        assert s == pytest.approx(2 * 0.02**2 / (s / 3e-3) ** (1 / (2 * integrals)), rel=1e-12)


def test_paper_vi_noise():
    """Oracle: Paper VI's Table 2 printed for one step, and its factor where the yaw acceleration is large, either way (E33)."""
    time, turn = np.array([0.0, 0.13, 0.26, 0.39]), np.array([0.0, 0.019, 0.021, -0.021])
    Q = PaperVI()(time, turn, np.zeros((4, 6, 6)))
    for axis, q in enumerate((0.25, 0.125, 0.0625)):
        np.testing.assert_allclose(Q[1][axis, [axis, axis + 3]], [q * 0.13**4 / 4, q * 0.13**3 / 2])
        assert Q[1][axis + 3, axis + 3] == pytest.approx(q * 0.13**2)
    np.testing.assert_allclose(Q[2:], 1.015 * Q[[1, 1]], rtol=1e-12)
    np.testing.assert_array_equal(Scaled(2.0, 0.02)(time, turn, np.ones((4, 1, 1)))[:, 0, 0], [1, 1, 2, 2])


def test_paper_vi_noise_costs_velocity(rough):
    """Law: Paper VI's Q supposes accelerations unknown to 0.5 m/s2, so the velocity is that of fixes alone: over twice the error."""
    log, t = rough
    found = [midship(solve_position_velocity(log, process)) for process in (derived, PaperVI())]
    true, late = Boat().level(t), t > 30
    good, paper = (np.sqrt(np.mean((np.stack([at.surge, at.sway], axis=1) - true)[late] ** 2)) for at in found)
    assert paper > 2 * good


@pytest.mark.parametrize("solve", BOTH)
def test_nothing_of_the_future_is_used(rough, solve):
    """Law: rows after an instant changed, the states up to it stay to the last bit."""
    log, _ = rough
    log = replace(log, table=log.table.iloc[:1200].reset_index(drop=True))
    table = log.table.copy()
    later = table.index >= 800
    for name in ("bow_north_m", "bow_height_m", "heading_deg", "roll_deg", "imu_force_x_m_s2", "imu_rate_z_deg_s"):
        table.loc[later, name] += 0.7
    a, b = (filter_spatial(replace(log, table=t), solve).table.iloc[:800] for t in (log.table, table))
    for name in a.columns:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


@pytest.mark.parametrize("solve", BOTH)
def test_a_jump_is_gated_and_a_lasting_one_believed(rough, solve):
    """Law: one fix 30 m off is rejected and moves nothing; fixes that stay 30 m off are believed after two seconds, with a new place."""
    log, t = rough
    table = log.table.copy()
    table.loc[1000, "bow_north_m"] += 30.0
    table.loc[2000:, "bow_east_m"] += 30.0
    found = solve(replace(log, table=table))
    fate = found.moving.fit.fate[:, 0]
    assert fate[1000] == REJECTED and (fate[2000:2015] == REJECTED).all() and (fate[2000:2030] == REACQUIRED).sum() >= 1
    place = midship(found).place[:, :2] + found.inertial.planar.origin
    true = Boat().place(t)[:, :2]
    np.testing.assert_allclose(place[1000], true[1000], atol=0.5)
    np.testing.assert_allclose(place[2100:, 1], true[2100:, 1] + 30.0, atol=1.0)


@pytest.mark.parametrize("solve", BOTH)
def test_frozen_fixes_and_an_outage(rough, solve):
    """Law: repeated fixes are stale and not used; 10 s without fixes are coasted through, within 2 m by the IMU, and flagged."""
    log, t = rough
    table = log.table.copy()
    names = ["bow_north_m", "bow_east_m", "bow_height_m"]
    table.loc[1001:1010, names] = table.loc[1000, names].to_numpy()
    out = (t > 200) & (t < 210)
    table.loc[out, names] = np.nan
    states = filter_spatial(replace(log, table=table), solve)
    assert states.table["stale"].iloc[1003:1011].all() and states.table["nis_bow"].iloc[1003:1011].isna().all()
    coasting = states.table["coasting"].to_numpy(bool)
    assert coasting[(t > 202.2) & (t < 210)].all() and not coasting[(t > 30) & (t < 200)].any()
    true = Boat().place(t)
    assert np.hypot(states["north_m"] - true[:, 0], states["east_m"] - true[:, 1])[out].max() < 2.0


def test_without_heights_it_floats(rough):
    """Oracle: the boat's heave of 0.25 m amplitude is followed by the IMU alone within 0.15 m; NIS then has 2 degrees of freedom."""
    log, t = rough
    states = filter_spatial(replace(log, table=log.table.drop(columns="bow_height_m")))
    late = t > 120
    assert np.sqrt(np.mean((states["down_m"] - Boat().place(t)[:, 2])[late] ** 2)) < 0.15
    assert abs(np.nanmean(states["nis_bow"][late]) - 2) < 4 * np.sqrt(2 * 2 / late.sum())


def test_without_forces_velocity_turns_with_the_ship(rough):
    """Oracle: the boat's formulas; roll and heading alone keep surge and sway of a 5.6 m/s turn within 0.5 m/s."""
    log, t = rough
    names = [f"imu_{what}_{axis}_{unit}" for what, unit in (("force", "m_s2"), ("rate", "deg_s")) for axis in "xyz"]
    states = filter_spatial(replace(log, table=log.table.drop(columns=names)))
    error = np.stack([states["surge_m_s"], states["sway_m_s"]], axis=1) - Boat().level(t)
    assert np.sqrt(np.mean(error[t > 60] ** 2)) < 0.5
    assert "nis_bow" in states.table and "gyro_bias_yaw_rad_s" not in states.table


def test_gravity_free_accelerations_serve_as_well_as_forces(rough):
    """Law: the log with gravity taken away by the measured attitude gives the 3D-PV states of the one with forces."""
    log, _ = rough
    table = log.table.copy()
    i = from_ship_log(log)
    from aspnn.frames import attitude  # the reverse of what the inputs do

    free = i.force + np.einsum("tji,j->ti", attitude(i.roll, i.pitch, 0.0), [0, 0, 9.80665])
    for k, name in enumerate(("surge", "sway", "heave")):
        table[f"acceleration_{name}_m_s2"] = free[:, k]
    table = table.drop(columns=[f"imu_force_{axis}_m_s2" for axis in "xyz"])
    a, b = (filter_spatial(replace(log, table=one), solve_position_velocity) for one in (log.table, table))
    np.testing.assert_allclose(a["surge_m_s"], b["surge_m_s"], atol=1e-6)


@pytest.mark.parametrize("gone", ["roll_deg", "pitch_deg"])
def test_attitude_missing_is_named(rough, gone):
    """Law: one line that names the column and the remedy."""
    log, _ = rough
    with pytest.raises(InputError, match=rf"column {gone} has no value.*--spatial"):
        filter_spatial(replace(log, table=log.table.drop(columns=gone)))


@pytest.mark.parametrize("solve", BOTH)
def test_late_imu_is_refused_and_late_fixes_are_taken_back(solve):
    """Oracle: fixes recorded 0.26 s late and told so give the boat's place to 0.2 m rms (untold 1.6 m off); a late IMU is named."""
    boat = Boat()
    log, t = boat_log(boat, 120.0, Errors(), seed=4)
    table = log.table.copy()
    for name in ("bow_north_m", "bow_east_m", "bow_height_m"):
        table[name] = table[name].shift(2)
    late = replace(log.vessel, calibration=replace(log.vessel.calibration, position_delay=2 * PERIOD))
    error = filter_spatial(replace(log, table=table, vessel=late), solve)["north_m"] - boat.place(t)[:, 0]
    assert np.sqrt(np.mean(error[t > 30] ** 2)) < 0.2
    wrong = replace(log.vessel, calibration=replace(log.vessel.calibration, acceleration_delay=0.1))
    with pytest.raises(InputError, match="acceleration_delay_s must be 0"):
        filter_spatial(replace(log, vessel=wrong))
