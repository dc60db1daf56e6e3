"""Bad input is named in one line or flagged in the states, and the filters never diverge, wherever and however a log starts."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest

from aspnn import schema
from aspnn.angles import wrap
from aspnn.estimation import compiled, filter_log
from aspnn.estimation.exact import heading_problem
from aspnn.estimation.measurements import from_log
from aspnn.estimation.models import Cmm, Ctra, Sigma
from aspnn.estimation.nonlinear import model_problem
from aspnn.frames import Zone, convergence, to_geodetic, to_grid, to_north_east
from aspnn.instruments import Noise
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.simulation import Scenario, simulate_scenario
from aspnn.vessel import from_dict

NEEDED = [c.name for c in schema.STATES if c.needed and "wind" not in c.name and "engine" not in c.name]
BOW, STERN = (["bow_latitude_deg", "bow_longitude_deg"], ["stern_latitude_deg", "stern_longitude_deg"])
FIXES = BOW + STERN
RUNS = 6  # of each model, by EKF and UKF; with 100 the worst was 0.06 m/s
SENSORS = [*FIXES, "heading_deg", "yaw_rate_deg_s", "acceleration_surge_m_s2", "acceleration_sway_m_s2"]


@pytest.fixture(scope="module")
def log(voyage) -> Log:
    return replace(voyage[0], table=voyage[0].table.iloc[:4000])


def changed(log, rows, columns, change):
    """The log with `columns` of `rows` (a slice, end not included) changed by a function or set to a value."""
    table = log.table.copy()
    where = table.index[rows]
    table.loc[where, columns] = change(table.loc[where, columns]) if callable(change) else change
    return replace(log, table=table)


def sound(log) -> pd.DataFrame:
    """The states of a log, after finding every needed number finite and every deviation positive."""
    table = filter_log(log).table
    assert np.isfinite(table[NEEDED].to_numpy(float)).all()
    assert (table[[c for c in NEEDED if c.endswith("_sd")]] > 0).all(axis=None)
    return table


def away(table, truth, rows=slice(None)):
    """Distance [m] between states and truth."""
    return np.hypot(
        *(table[c].to_numpy()[rows] - truth[c].to_numpy()[: len(table)][rows] for c in ("north_m", "east_m"))
    )


@pytest.mark.parametrize("column", SENSORS)
def test_bursts_without_values(log, voyage, column):
    """Oracle: the truth; every sensor in turn is missing half of the time, in bursts of up to 3 s, and nothing is NaN."""
    rng = np.random.default_rng(5)
    gone = np.repeat(rng.random(400) < 0.5, rng.integers(1, 30, 400))[: len(log)]
    table = log.table.copy()
    table.loc[gone, column] = np.nan
    states = sound(replace(log, table=table))
    assert away(states, voyage[1])[600:].max() < 2.0


def test_all_sensors_missing(log, voyage):
    """Law: 30 s without any value are coasted, flagged after 2 s, with deviations that grow; the ship is found again."""
    states = sound(changed(log, slice(2000, 2300), SENSORS, np.nan))
    assert states["coasting"][2021:2300].all() and not states["coasting"][2310:].any()
    for name in ("north_m_sd", "surge_m_s_sd", "heading_rad_sd", "yaw_rate_rad_s_sd"):
        assert (np.diff(states[name][1999:2300]) > 0).all()
    assert away(states, voyage[1])[2400:].max() < 2.0


@pytest.mark.parametrize("column", SENSORS)
@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e300])
def test_absurd_values_are_missing_or_named(log, column, value):
    """Law: the screening takes them for missing; the check of a log names them, with their row."""
    bad = changed(log, slice(1500, 1501), [column], value)
    m, same = from_log(bad), from_log(changed(log, slice(1500, 1501), [column], np.nan))
    for name in ("heading", "yaw_rate", "acceleration"):
        np.testing.assert_array_equal(getattr(m, name), getattr(same, name))
    for name, fixes in m.fixes.items():
        np.testing.assert_array_equal(fixes, same.fixes[name])
    with pytest.raises(InputError, match=f"row 1500 .*{column}"):
        filter_log(bad)


def test_absurd_local_positions_are_missing(log):
    """Law: a northing beyond the earth does not move the filter, and is no fix."""
    table = pd.DataFrame(
        {"time_s": np.arange(400) / 10, "midship_north_m": 1.0, "midship_east_m": 2.0, "heading_deg": 90.0}
    )
    local = replace(log, table=table, zone=None)
    bad, gone = (filter_log(changed(local, slice(0, 30), ["midship_north_m"], v)).table for v in (1e300, np.nan))
    pd.testing.assert_frame_equal(bad, gone, check_exact=True)


def test_a_clock_set_back_is_named(log):
    table = log.table.assign(time_s=log.table["time_s"] - np.where(log.table.index >= 2500, 100.0, 0.0))
    with pytest.raises(InputError, match=r"row 2500 .*time runs back by 99\.9 s; sort the rows or cut the log there"):
        filter_log(replace(log, table=table))


@pytest.mark.parametrize("hours", [0.01, 1.0, 5.0, 1000.0])
def test_a_clock_set_forward_is_coasted(log, voyage, hours):
    """Law: a jump of the clock is one long step: the row is told by its first fix, and the ship is soon found again."""
    jump = np.where(log.table.index >= 2500, 3600 * hours, 0.0)
    states = sound(replace(log, table=log.table.assign(time_s=log.table["time_s"] + jump)))
    assert away(states, voyage[1])[2600:].max() < 3.0
    error = np.abs(states["surge_m_s"] - voyage[1]["surge_m_s"].to_numpy()[: len(log)])
    assert error[3100:].max() < 0.1
    turn = wrap(states["heading_rad"].to_numpy() - voyage[1]["heading_rad"].to_numpy()[: len(log)])
    assert np.degrees(np.abs(turn[3100:])).max() < 0.5


@pytest.mark.parametrize("column", SENSORS[4:])
def test_a_sensor_that_sticks_is_left_out(log, voyage, column):
    """Oracle: the truth; a sensor that repeats its value for 20 s is flagged after 2 s, until it changes."""
    held = float(log.table[column][2000])
    table = changed(log, slice(2000, 2200), [column], held)
    states, before = sound(table), filter_log(log).table
    expected = np.zeros(len(log), bool)
    expected[2021:2200] = True
    np.testing.assert_array_equal(states["stale"], expected)
    error = states["sway_m_s"] - voyage[1]["sway_m_s"].to_numpy()[: len(log)]
    assert np.abs(error[2000:]).max() < 0.25
    pd.testing.assert_frame_equal(states.iloc[:2000], before.iloc[:2000], check_exact=True)


@pytest.mark.parametrize("metres, back", [(1e4, 30), (1e4, None), (1e5, 30), (1e5, None), (1.7e6, None)])
def test_teleports(log, voyage, metres, back):
    """Law: fixes that leap 10 to 1700 km north (past 84 N) are gated; those that stay are believed after 2 s."""
    end = None if back is None else 2000 + back
    moved = changed(log, slice(2000, end), [BOW[0], STERN[0]], lambda old: old + metres / 111.2e3)
    states = sound(moved)
    assert states["gated"][2000:2019].all()
    if back is None:
        assert np.abs(np.diff(states["north_m"][2100:])).max() < 3.0 and not states["gated"][2100:].all()
        assert states["north_m"][2100] > voyage[1]["north_m"][2100] + 0.9 * metres
    else:
        assert away(states, voyage[1])[2100:].max() < 3.0


@pytest.mark.parametrize("rows", [2, 3])
def test_the_shortest_logs(log, rows):
    assert len(sound(replace(log, table=log.table.iloc[:rows]))) == rows
    with pytest.raises(InputError, match="holds 1 rows, at least 2"):
        filter_log(replace(log, table=log.table.iloc[:1]))


def test_a_constant_log(log):
    """Law: the same values from first to last row are a ship at rest: used, not stale, no speed."""
    table = pd.concat([log.table.iloc[:1]] * 3000, ignore_index=True).assign(time_s=np.arange(3000) / 10)
    at_rest = dict.fromkeys(SENSORS[5:], 0.0)
    # The noise of the two fixes does not fit the heading, so the antennas stand where the fixes have them.
    m = from_log(replace(log, table=table.assign(**at_rest)))
    psi = m.heading[0]
    gap = (m.fixes["bow"][0] - m.fixes["stern"][0]) @ np.array(
        [[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]]
    )
    vessel = log.vessel.with_stations(bow=tuple(gap / 2), stern=tuple(-gap / 2))
    states = sound(replace(log, table=table.assign(**at_rest), vessel=vessel))
    assert not states[["stale", "gated"]].any(axis=None) and not states["coasting"].any()
    assert np.abs(states[["surge_m_s", "sway_m_s"]].iloc[600:]).max(axis=None) < 1e-3


def test_headings_outside_the_circle(log):
    """Law: whole turns more or less change nothing but rounding (beyond -360 to 720 deg they are refused)."""
    turns = np.select([log.table.index % 3 == 0, log.table.index % 3 == 1], [-360.0, 360.0], 0.0)
    states, same = (
        sound(replace(log, table=log.table.assign(heading_deg=log.table["heading_deg"] + turns))),
        filter_log(log),
    )
    np.testing.assert_allclose(wrap(states["heading_rad"] - same["heading_rad"]), 0, atol=1e-12)
    np.testing.assert_allclose(states["sway_m_s"], same["sway_m_s"], atol=1e-9)
    with pytest.raises(InputError, match=r"row 70 .*heading_deg: 900 is outside"):
        filter_log(changed(log, slice(70, 71), ["heading_deg"], 900.0))


def test_one_antenna_under_two_names(log):
    """Law: two columns of one antenna at one place count once; with two stations they are named."""
    twice = log.table.drop(columns=STERN).assign(
        midship_latitude_deg=log.table[BOW[0]], midship_longitude_deg=log.table[BOW[1]]
    )
    same = log.vessel.with_stations(midship=log.vessel.stations["bow"])
    once = filter_log(replace(log, table=log.table.drop(columns=STERN))).table
    both = filter_log(replace(log, table=twice, vessel=same)).table
    pd.testing.assert_frame_equal(both[NEEDED], once[NEEDED], check_exact=True)
    with pytest.raises(InputError, match=r"bow and midship have the same position in every row, but .* 35 m apart"):
        filter_log(replace(log, table=twice))


@pytest.mark.parametrize("name", [f.name for f in fields(Noise)])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_noise_that_is_not_positive(log, name, value):
    """Law: every standard deviation and density must be positive, built in Python or read from a file."""
    wrong = replace(log.vessel, noise=replace(log.vessel.noise, **{name: value}))
    with pytest.raises(InputError, match=f"vessel cargo90: noise {name} = {value} must be a positive number"):
        filter_log(replace(log, vessel=wrong))
    data = log.vessel.to_dict()
    data["sensors"]["position_m"] = value
    with pytest.raises(InputError, match=f"sensors.position_m = {value} must be a positive number"):
        from_dict(data)


def test_two_receivers_at_one_place(log, voyage):
    """Oracle: the truth; two receivers with noise of their own at one station are legal, and better than one."""
    rng = np.random.default_rng(6)
    table = log.table.drop(columns=STERN)
    for column, scale in zip(BOW, (111.5e3, 38.9e3), strict=True):
        true = table[column] - 0.0
        table[column.replace("bow", "second")] = true + rng.normal(0, 1.0, len(table)) / scale
    vessel = log.vessel.with_stations(second=log.vessel.stations["bow"])
    both = sound(replace(log, table=table, vessel=vessel))
    one = sound(replace(log, table=log.table.drop(columns=STERN)))
    assert (both["north_m_sd"][600:] < one["north_m_sd"][600:]).all()


def test_a_zone_far_from_the_log(log, voyage):
    """Law: body velocities do not depend on the zone, but for its scale: 15 deg away convergence is 14 deg, the scale 1.003."""
    near, far = filter_log(log), sound(replace(log, zone=Zone(36)))
    assert np.degrees(far["convergence_rad"][3000]) == pytest.approx(-13.2, abs=0.3)
    assert np.abs(far["sway_m_s"] - near["sway_m_s"])[600:].max() < 0.02
    assert np.abs(far["surge_m_s"] / near["surge_m_s"] - 1)[600:].max() < 0.01
    true = near["heading_rad"] + near["convergence_rad"] - far["heading_rad"] - far["convergence_rad"]
    assert np.degrees(np.abs(wrap(true))).max() < 0.02


@pytest.fixture(scope="module")
def motions() -> list[pd.DataFrame]:
    """Truths of six simulated voyages of ten minutes; the last of them made to lie at rest, then to be towed ahead."""
    scenario = Scenario.model_validate(
        {
            "name": "runs",
            "vessel": "cargo90",
            "duration_s": 600,
            "seed": 77,
            "start": {"speed_kn": 11.5, "latitude_deg": 60.0, "longitude_deg": 9.0, "zone": "32N", "heading_deg": 0.0},
            "manoeuvre": {"kind": "random-orders"},
        }
    )
    truths = [truth for _, truth in simulate_scenario(scenario, 6)]
    t = truths[0]["time_s"].to_numpy()
    rest = truths[-1].copy()
    rest["surge_m_s"] = np.clip(0.02 * (t - 200), 0, 4)
    rest["sway_m_s"] = rest["yaw_rate_rad_s"] = 0.0
    rest["heading_rad"] = rest["heading_rad"][0]
    way = np.concatenate(
        [[0], np.cumsum((rest["surge_m_s"][1:].to_numpy() + rest["surge_m_s"][:-1].to_numpy()) / 2 * 0.1)]
    )
    heading = rest["heading_rad"][0]
    rest["north_m"], rest["east_m"] = (
        rest["north_m"][0] + way * np.cos(heading),
        rest["east_m"][0] + way * np.sin(heading),
    )
    return [*truths[:-1], rest]


def redrawn(truth, vessel, rng) -> tuple[Log, pd.DataFrame]:
    """A voyage turned to any heading, moved to any latitude and longitude that UTM covers, with sensors drawn anew.

    A turned and shifted path is a path: no simulation is needed. Derivatives of the truth by finite differences (0.1 s).
    """
    latitude, longitude = np.radians(rng.uniform(-80, 84)), np.radians(rng.uniform(-180, 180))
    zone = Zone.of(latitude, longitude)
    turn, n = rng.uniform(-np.pi, np.pi), len(truth)
    origin = np.array(to_grid(latitude, longitude, zone))
    path = truth[["north_m", "east_m"]].to_numpy()
    north, east = to_north_east(*(path - path[0]).T, turn)
    t, r = truth["time_s"].to_numpy(), truth["yaw_rate_rad_s"].to_numpy()
    u, v = truth["surge_m_s"].to_numpy(), truth["sway_m_s"].to_numpy()
    heading = truth["heading_rad"].to_numpy() + turn
    moved = truth.assign(north_m=north + origin[0], east_m=east + origin[1], heading_rad=heading)
    columns = {"time_s": t}
    noise, x = vessel.noise, rng.standard_normal
    for name in ("bow", "stern"):
        lever = to_north_east(*vessel.stations[name], heading)
        fix = [moved[c] + lever[i] + noise.position * x(n) for i, c in enumerate(("north_m", "east_m"))]
        phi, lam = to_geodetic(*fix, zone)
        columns |= {f"{name}_latitude_deg": np.degrees(phi), f"{name}_longitude_deg": np.degrees(lam)}
    gamma = convergence(*to_geodetic(moved["north_m"], moved["east_m"], zone), zone)
    columns["heading_deg"] = np.degrees(heading + gamma + noise.heading * x(n)) % 360
    columns["yaw_rate_deg_s"] = np.degrees(r + noise.yaw_rate * x(n))
    columns["acceleration_surge_m_s2"] = np.gradient(u, t) - v * r + noise.acceleration * x(n)
    columns["acceleration_sway_m_s2"] = np.gradient(v, t) + u * r + noise.acceleration * x(n)
    columns["rudder_order_deg"] = columns["rudder_angle_deg"] = np.degrees(truth["rudder_angle_rad"])
    columns["shaft_speed_rps"] = truth["shaft_speed_rps"]
    return Log(pd.DataFrame(columns), vessel, zone), moved


def test_no_divergence(motions, voyage):
    """Oracle: the truth; 100 runs of ten minutes from any heading and place: after a minute surge and sway within 0.1 m/s,

    heading within 0.2 deg, place within 1 m, and all within 6 of the deviations that the states tell.
    """
    rng, worst = np.random.default_rng(100), {}
    for run in range(100):
        log, truth = redrawn(motions[run % len(motions)], voyage[0].vessel, rng)
        states = sound(log)
        assert not states["coasting"][10:].any() and not states["stale"].any()
        for name in ("north_m", "east_m", "surge_m_s", "sway_m_s", "heading_rad"):
            error = states[name].to_numpy() - truth[name].to_numpy()
            error = np.abs(wrap(error) if name == "heading_rad" else error)[600:]
            found = error.max(), (error / states[f"{name}_sd"].to_numpy()[600:]).max()
            worst[name] = np.maximum(worst.get(name, 0), found)
    assert max(worst["surge_m_s"][0], worst["sway_m_s"][0]) < 0.1
    assert np.degrees(worst["heading_rad"][0]) < 0.2
    assert max(worst["north_m"][0], worst["east_m"][0]) < 1.0
    assert max(w[1] for w in worst.values()) < 6


@pytest.mark.parametrize("family, given", [(Ctra, False), (Cmm, False), (Ctra, True), (Cmm, True)])
def test_no_divergence_of_any_model(motions, voyage, family, given):
    """Oracle: the truth; as above for EKF and UKF of every model, RUNS runs of each: velocity over ground within 0.1 m/s.

    The starts at rest are among them, and CMM has no path there.
    """
    rng, vessel = np.random.default_rng(7), voyage[0].vessel
    size, worst = (vessel.service_speed, vessel.length), 0.0
    for run in range(RUNS):
        log, truth = redrawn(motions[run % len(motions)], vessel, rng)
        m = from_log(log)
        turning = compiled.run(heading_problem(m, vessel.noise, *size))
        for sigma in (None, Sigma()):
            told = (turning.mean, turning.covariance) if given else None
            problem = model_problem(m, vessel.noise, family.of(vessel.noise, given), *size, told, sigma=sigma)
            x = compiled.run(problem).mean
            assert np.isfinite(x).all()
            velocity = x[:, 2] + 1j * x[:, 3]
            if family is Ctra:
                velocity = velocity * np.exp(1j * (turning.mean[:, 0] if given else x[:, 4]))
            true = (truth["surge_m_s"] + 1j * truth["sway_m_s"]) * np.exp(1j * truth["heading_rad"])
            worst = max(worst, float(np.abs(velocity - true.to_numpy())[600:].max()))
    assert worst < 0.1
