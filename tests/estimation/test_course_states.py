"""Logs without a heading: the table of states, what turning tells of the drift, predictors that take it, and logs that are refused."""

import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn import schema
from aspnn.angles import wrap
from aspnn.estimation import course_reference
from aspnn.estimation.course import filter_course
from aspnn.estimation.course_states import PIVOT
from aspnn.frames import Zone, to_geodetic, to_grid, to_north_east
from aspnn.learning.config import read_training
from aspnn.learning.windows import WindowSpec, check_filter
from aspnn.prediction.kinematic import KinematicPredictor, baselines
from aspnn.records import Log, read_states, write_states
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

VESSEL = load_vessel("cargo90")
TURN = 0.01  # rad/s


def turning_ship(antennas=("bow",), period=0.5, duration=400.0, seed=0, turn=TURN) -> tuple[Log, pd.DataFrame]:
    """cargo90 in a steady turn about a pivot point PIVOT lengths ahead of midship, and its truth; local positions, no heading."""
    time = np.arange(0, duration, period)
    u, v = 5.0, -turn * PIVOT * VESSEL.length
    heading = 0.3 + turn * time
    velocity = (u + 1j * v) * np.exp(1j * heading)
    place = (velocity - velocity[0]) / (1j * turn) if turn else velocity[0] * time
    rng, table = np.random.default_rng(seed), {"time_s": time}
    for name in antennas:
        north, east = to_north_east(*VESSEL.stations[name][:2], heading)
        table[f"{name}_north_m"] = place.real + north + rng.standard_normal(len(time))
        table[f"{name}_east_m"] = place.imag + east + rng.standard_normal(len(time))
    truth = pd.DataFrame({"north": place.real, "east": place.imag, "heading": heading, "sway": v})
    return Log(table=pd.DataFrame(table), vessel=VESSEL, voyage="turn", path="turn.parquet"), truth


def test_the_heading_is_the_course_and_what_turning_explains(tmp_path):
    """Analytic: a steady turn about a pivot point PIVOT L ahead of midship, seen from the bow; midship, sway and heading come out.

    The bow's own course is 0.01 (35 - 36) m/s aside: 0.1 degrees; the stern's is 8 degrees off the heading.
    """
    for name in ("bow", "stern"):
        log, truth = turning_ship((name,), seed=3)
        states = filter_course(log)
        schema.check(states.table, schema.STATES)
        late = states["time_s"] > 60
        assert np.degrees(np.abs(wrap(states["heading_rad"] - truth.heading))[late].max()) < 8
        assert np.degrees(abs(wrap(states["heading_rad"] - truth.heading)[late].mean())) < 1
        away = np.hypot(states["north_m"] - truth.north, states["east_m"] - truth.east)[late]
        assert np.sqrt(np.mean(away**2)) < 3
        assert states["sway_m_s"][late].mean() == pytest.approx(-TURN * PIVOT * VESSEL.length, abs=0.05)
        assert states["yaw_rate_rad_s"][late].mean() == pytest.approx(TURN, rel=0.05)
        off = np.degrees(wrap(states["course_rad"] - truth.heading)[late].mean())
        assert off == pytest.approx(math.degrees((35.0 if name == "bow" else -35.0) - 36.0) * TURN / 5.0, abs=1.5)
    assert not states["coasting"].any() and np.abs(np.diff(states["course_rad"])[20:]).max() < 0.5
    assert (states["heading_rad_sd"][late] > math.radians(4)).all()
    write_states(states, tmp_path / "turn.states.parquet")
    pd.testing.assert_frame_equal(read_states(tmp_path / "turn.states.parquet").table, states.table)


def test_states_of_the_reference_are_those_of_the_compiled_engine():
    """filterpy step by step, to 1e-7."""
    log, _ = turning_ship(duration=60.0)
    a, b = filter_course(log).table, filter_course(log, engine=course_reference.run).table
    np.testing.assert_allclose(a.to_numpy(float), b.to_numpy(float), rtol=1e-7, atol=1e-7)


def test_each_state_is_of_the_log_up_to_it():
    """The log cut in the middle gives the same states up to there."""
    log, _ = turning_ship(duration=120.0)
    half = filter_course(replace(log, table=log.table.iloc[:120])).table
    pd.testing.assert_frame_equal(filter_course(log).table.iloc[:120], half)


def test_a_heading_in_the_log_is_not_looked_at():
    """The same states, whatever compass and gyro say."""
    log, _ = turning_ship(duration=60.0)
    wild = log.table.assign(heading_deg=np.arange(len(log)) % 360.0, yaw_rate_deg_s=5.0)
    pd.testing.assert_frame_equal(filter_course(log).table, filter_course(replace(log, table=wild)).table)


def test_of_several_antennas_one_is_chosen_by_its_fixes_then_by_its_place():
    """Counting: the stern hears half the time, so the bow it is; with a midship antenna as good, midship."""
    log, _ = turning_ship(("bow", "stern"), duration=60.0)
    log.table.loc[::2, ["stern_north_m", "stern_east_m"]] = np.nan
    assert "nis_bow" in filter_course(log).table
    near = replace(VESSEL, stations=VESSEL.stations | {"midship": (0.0, 0.0)})
    table = log.table.assign(midship_north_m=log.table.bow_north_m - 30.0, midship_east_m=log.table.bow_east_m)
    assert "nis_midship" in filter_course(replace(log, table=table, vessel=near)).table


@pytest.mark.parametrize(
    "latitude, longitude, zone", [(69.65, 18.96, "33N"), (-41.0, 179.9995, "60S"), (-41.0, -179.9995, "60S")]
)
def test_geodetic_logs_anywhere(latitude, longitude, zone):
    """A turn across the date line, on either hemisphere: course rate and speed of the circle, and a continuous course."""
    log, _ = turning_ship(duration=300.0)
    z = Zone.parse(zone)
    north, east = to_grid(math.radians(latitude), math.radians(longitude), z)
    lat, lon = to_geodetic(log.table.bow_north_m.to_numpy() + north, log.table.bow_east_m.to_numpy() + east, z)
    table = pd.DataFrame(
        {"time_s": log.table.time_s, "bow_latitude_deg": np.degrees(lat), "bow_longitude_deg": np.degrees(lon)}
    )
    states = filter_course(replace(log, table=table, zone=z))
    late = states["time_s"] > 60
    assert states["course_rate_rad_s"][late].mean() == pytest.approx(TURN, rel=0.05)
    assert states["speed_over_ground_m_s"][late].mean() == pytest.approx(5.0, abs=0.05)
    assert np.abs(np.diff(states["course_rad"][late])).max() < 0.1


def test_predictors_take_them_and_regions_are_wider():
    """Every kinematic predictor gives a finite path; a straight course has a heading that is unsure by more than a compass is."""
    log, _ = turning_ship(turn=0.0)
    states = filter_course(log)
    for predictor in baselines(VESSEL):
        assert isinstance(predictor, KinematicPredictor)
        path = predictor.predict(states)
        assert np.isfinite([path.north, path.east, path.heading]).all()
        way = np.hypot(path.north[-1] - path.north[0], path.east[-1] - path.east[0])
        assert way == pytest.approx(450.0, rel=0.1)
    assert (states["heading_rad_sd"][-100:] > math.radians(3)).all()


def test_a_network_refuses_states_of_another_filter():
    """A spec says which filter its network learned from; course states have a column that no other filter makes."""
    log, _ = turning_ship(duration=60.0)
    states = replace(filter_course(log), path="a.states.parquet")
    spec = WindowSpec(30.0, 90.0, 1.0, ("surge",))
    check_filter(states, replace(spec, course_only=True), "net")
    with pytest.raises(
        InputError, match=r"a\.states\.parquet: made from positions alone, but net learned from states with a heading"
    ):
        check_filter(states, spec, "net")
    full = replace(states, table=states.table.drop(columns="course_rad"))
    check_filter(full, spec, "net")
    with pytest.raises(InputError, match="made from a heading, but net learned from states with positions alone"):
        check_filter(full, replace(spec, course_only=True), "net")
    with pytest.raises(InputError, match="spatial and course_only"):
        replace(spec, course_only=True, spatial=True)


def test_outages_coast_and_spells_of_frozen_fixes_are_stale():
    """40 s without fixes coast but for the first two seconds; 30 s of one repeated fix are stale, and not used."""
    log, truth = turning_ship(turn=0.0)
    table, time = log.table.copy(), log.table.time_s
    fix = ["bow_north_m", "bow_east_m"]
    table.loc[(time >= 200) & (time < 240), fix] = np.nan
    table.loc[(time >= 300) & (time < 330), fix] = table.loc[time == 300, fix].to_numpy()
    states = filter_course(replace(log, table=table))
    coasting, t = states["coasting"].astype(bool), states["time_s"]
    assert coasting[(t > 202) & (t < 240)].all() and not coasting[(t < 201) & (t > 1)].any()
    assert states["stale"].astype(bool)[(t > 305) & (t < 330)].all()
    away = np.hypot(states["north_m"] - truth.north, states["east_m"] - truth.east)
    assert away[(t > 60)].max() < 25 and states["speed_over_ground_m_s"][t > 60].min() > 4


def ais(period, seed=0):
    """Reports every 2 to 10 s."""
    rng = np.random.default_rng(seed)
    log, truth = turning_ship(period=0.5, duration=900.0, turn=0.002)
    rows = np.cumsum(rng.integers(2 * period[0], 2 * period[1] + 1, 400))
    rows = np.concatenate([[0], rows[rows < len(log)]])
    return replace(log, table=log.table.iloc[rows].reset_index(drop=True)), truth.iloc[rows].reset_index(drop=True)


def test_irregular_reports_every_two_to_ten_seconds():
    """Course within 5 degrees and speed within 0.3 m/s of the truth, and no coasting between reports."""
    log, truth = ais((2, 10))
    states = filter_course(log)
    late = states["time_s"] > 60
    assert np.degrees(np.sqrt(np.mean(wrap(states["heading_rad"] - truth.heading)[late] ** 2))) < 5
    assert np.sqrt(np.mean((states["surge_m_s"] - 5)[late] ** 2)) < 0.3
    assert not states["coasting"][1:].any()


def mixed(how: str) -> tuple[Log, int]:
    """A log with another ship's fixes: every other one, or twenty at a time; and the row where they begin."""
    log, _ = turning_ship(turn=0.0)
    other, _ = turning_ship(turn=0.0, seed=9)
    table, rows = log.table.copy(), np.arange(len(log.table))
    theirs = (rows >= 100) & (rows % 2 == 1 if how == "alternating" else (rows // 20) % 2 == 1)
    for name in ("bow_north_m", "bow_east_m"):
        table.loc[theirs, name] = other.table[name][theirs] + 3000.0
    return replace(log, table=table, path="two.parquet"), int(rows[theirs][0])


@pytest.mark.parametrize("how", ["alternating", "spells"])
def test_two_vessels_in_one_file_are_named(how):
    """Their fixes change between two tracks 4243 m apart: file, row, time, remedy."""
    log, row = mixed(how)
    with pytest.raises(
        InputError, match=rf"two.parquet: row {row} \(time {row / 2:g} s\): antenna bow .* 424\d m apart.*two vessels"
    ):
        filter_course(log)


def test_wild_fixes_of_one_receiver_are_no_second_vessel():
    """One fix in ten is wild, every other of them at one and the same offset, and there is one excursion of a minute: gated, not refused."""
    log, truth = turning_ship(turn=0.0)
    rng, table = np.random.default_rng(1), log.table.copy()
    wild = rng.choice(len(table), len(table) // 10, replace=False)
    for name in ("bow_north_m", "bow_east_m"):
        table.loc[wild[::2], name] += rng.uniform(-3000, 3000, len(wild[::2]))
        table.loc[wild[1::2], name] -= 2500.0
        table.loc[(table.time_s > 200) & (table.time_s < 260), name] += 2000.0
    states = filter_course(replace(log, table=table))
    late = states["time_s"] > 300
    away = np.hypot(states["north_m"] - truth.north, states["east_m"] - truth.east)
    assert states["gated"].sum() >= len(wild) // 2 and np.median(away[late]) < 10


def test_a_receiver_that_froze_for_all_the_log_and_too_few_fixes_are_named():
    """One line with file, antenna, what is wrong and what to do."""
    log, _ = turning_ship(duration=60.0)
    table = log.table.copy()
    table["bow_north_m"], table["bow_east_m"] = 5.0, 7.0
    with pytest.raises(
        InputError, match=r"turn.parquet: row 0 \(time 0 s\): antenna bow repeats its position .*the receiver froze"
    ):
        filter_course(replace(log, table=table))
    table = log.table.copy()
    table.loc[2:, ["bow_north_m", "bow_east_m"]] = np.nan
    with pytest.raises(InputError, match=r"turn\.parquet: antenna bow has 2 fixes; a course needs at least 3"):
        filter_course(replace(log, table=table))
    table.loc[:, ["bow_north_m", "bow_east_m"]] = np.nan
    with pytest.raises(InputError, match="no antenna has any position"):
        filter_course(replace(log, table=table))


def test_a_training_file_says_that_its_network_sees_positions_alone():
    """windows.course_only of training/cargo90-course.toml stands in the spec, which travels in the checkpoint."""
    file = Path(__file__).parents[2] / "training/cargo90-course.toml"
    spec = read_training(file).windows.spec()
    assert spec.course_only and WindowSpec.from_dict(asdict(spec)) == spec
