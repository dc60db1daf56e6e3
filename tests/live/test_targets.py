"""Targets from AIS reports: places of midship by hand, arcs by their closed form, growth by a Monte Carlo of its own model."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aspnn.frames import Zone, convergence, to_geodetic
from aspnn.live import targets as module
from aspnn.live.ahead import ANY, Kind, Target, growth, predict
from aspnn.live.encounter import Limits, assess
from aspnn.live.entries import target_entries
from aspnn.live.share import gaussian
from aspnn.live.targets import Targets, interval, reported_time
from aspnn.logs.ais_messages import Report, Static
from aspnn.logs.readings import KNOT
from aspnn.motion import integrate
from aspnn.vessel import load_vessel

ZONE = Zone.parse("33N")
NORTH, EAST = 7.72e6, 6.5e5
NOW = 1_700_000_040.0  # a whole minute
NAN = math.nan
MMSI = 257000001


def report(north=0.0, east=0.0, time=NOW, **told) -> Report:
    """A report of class A at a place from (NORTH, EAST) and a time [s, UNIX]; speed 5 m/s to grid east unless told."""
    latitude, longitude = to_geodetic(NORTH + north, EAST + east, ZONE)
    gamma = math.degrees(float(convergence(latitude, longitude, ZONE)))
    said = {
        "mmsi": MMSI, "kind": 1, "latitude_deg": math.degrees(latitude), "longitude_deg": math.degrees(longitude), "speed_m_s": 5.0,
        "course_deg": 90.0 + gamma, "heading_deg": 90.0 + gamma, "yaw_rate_deg_s": 0.0, "second": time % 60, "measured": True,
        "accurate": True, "turning": False,
    }  # fmt: skip
    return Report(**(said | told))


def heard(*said, received=NOW) -> Targets:
    found = Targets(ZONE)
    for one in said:
        found.hear(one, received)
    return found


def test_midship_from_the_antenna():
    """By hand: an antenna 80 m from the bow, 20 from the stern, 3 from port, 13 from starboard is 30 m abaft midship and 5 m to
    port; of a ship that heads east, midship is then 30 m east and 5 m south of it. Turning to starboard at w the antenna, 30 m
    abaft, moves by 30 w to port against midship, and by 5 w ahead (port is the outer side)."""
    w = 0.02
    told = Static(MMSI, 5, "NORDLYS", (80, 20, 3, 13), 5.0)
    (seen,) = heard(told, report(yaw_rate_deg_s=math.degrees(w))).present(NOW)
    np.testing.assert_allclose([seen.north - NORTH, seen.east - EAST], [-5, 30], atol=1e-3)
    np.testing.assert_allclose([seen.surge, seen.sway, seen.yaw_rate], [5 - 5 * w, 30 * w, w], atol=1e-9)
    assert (seen.name, seen.id, seen.vessel.length, seen.vessel.beam, seen.sized) == (
        "NORDLYS",
        "257000001",
        100,
        16,
        True,
    )
    assert not seen.derived and seen.kind is Kind.ais


def test_arc_is_a_circle():
    """Analytic: constant velocities run the circle that `integrate` draws by steps, from the report on, whatever its age."""
    (seen,) = heard(report(yaw_rate_deg_s=1.0)).present(NOW)
    path = predict([seen], NOW + 7.0, np.arange(0.0, 91.0))
    drawn = integrate(
        (seen.north, seen.east, seen.heading), np.tile([seen.surge, seen.sway, seen.yaw_rate], (97, 1)), 1.0
    )
    np.testing.assert_allclose(path.north[0], drawn.north[7:], atol=1e-6)
    np.testing.assert_allclose(path.heading[0], drawn.heading[7:], atol=1e-9)


def test_growth_against_its_model():
    """Monte Carlo of 20000 ships: constant errors of position, velocity and yaw rate, and white noise on surge and yaw acceleration, in
    steps of 0.5 s over 60 s of a straight course. The standard deviation of a variance is 1 % of it; the formula is of first order
    in the heading (0.13 rad here, which shortens the way by 1 %)."""
    rng, n, dt, time = np.random.default_rng(2), 20_000, 0.5, 60.0
    (seen,) = heard(report()).present(NOW)
    seen = replace(
        seen, rate_sd=1.5e-3, turn_density=1e-7, speed_density=2e-4, position_sd=4.0, velocity_sd=0.2, heading_sd=0.01
    )
    r, speed = rng.normal(0, seen.rate_sd, n), np.full(n, 5.0)
    along, across, heading = np.zeros(n), np.zeros(n), np.zeros(n)
    for _ in range(round(time / dt)):
        along, across = along + speed * np.cos(heading) * dt, across + speed * np.sin(heading) * dt
        heading = heading + r * dt
        r = r + rng.normal(0, math.sqrt(seen.turn_density * dt), n)
        speed = speed + rng.normal(0, math.sqrt(seen.speed_density * dt), n)
    place, pace = rng.normal(0, seen.position_sd, (2, n)), rng.normal(0, seen.velocity_sd, (2, n))
    along, across = along + place[0] + pace[0] * time, across + place[1] + pace[1] * time
    drawn = np.cov([along, across, heading + rng.normal(0, seen.heading_sd, n)])
    found = growth([seen], np.array([[time]]), np.array([[5 * time]]), np.array([[0.0]]))[0, 0]
    np.testing.assert_allclose(np.diag(found), np.diag(drawn), rtol=0.06)
    assert found[1, 2] == pytest.approx(drawn[1, 2], rel=0.08)


def test_growth_is_a_covariance():
    """Laws: positive definite at all times, turned with the azimuth, never smaller later, and no heading is less known than ANY."""
    (seen,) = heard(report()).present(NOW)
    t = np.linspace(0, 1000, 400)
    C = growth([seen], t[None], 5 * t[None], np.zeros((1, 400)))[0]
    assert (np.linalg.eigvalsh(C) > 0).all()
    assert (np.diff(C[:, [0, 1, 2], [0, 1, 2]], axis=0) >= -1e-12).all()
    assert C[-1, 2, 2] == pytest.approx(ANY**2)
    np.testing.assert_allclose(
        growth([seen], np.array([[-5.0]]), np.zeros((1, 1)), np.zeros((1, 1)))[0], C[:1]
    )  # a clock that is ahead
    east = growth([seen], t[None], 5 * t[None], np.full((1, 400), math.pi / 2))[0]
    np.testing.assert_allclose(east[:, 1, 1], C[:, 0, 0], rtol=1e-9)
    np.testing.assert_allclose(east[:, 0, 0], C[:, 1, 1], rtol=1e-9)


@pytest.mark.parametrize("second, received, time", [(58, 2, -2), (1, 3, 1), (3, 0, 3), (NAN, 7, 7), (30, 24 + 60, 30)])
def test_time_of_a_report(second, received, time):
    """By hand: the second of a fix belongs to the minute before where receipt has passed a full minute; EARLY ahead is allowed."""
    assert reported_time(second, NOW + received) == NOW + time


def test_what_is_not_told_comes_from_the_positions():
    """Analytic: fixes of a class B every 5 s along a straight line, 4 m/s to the north, without speed, course and heading: the course
    filter finds both within its own standard deviations; and before it can, speed is unknown rather than wrong."""
    blank = {"kind": 18, "speed_m_s": NAN, "course_deg": NAN, "heading_deg": NAN, "yaw_rate_deg_s": NAN}
    found = Targets(ZONE)
    found.hear(report(time=NOW, **blank), NOW)
    (first,) = found.present(NOW)
    assert (
        first.derived
        and first.speed == 0
        and first.velocity_sd == first.vessel.service_speed
        and first.heading_sd == ANY
    )
    for t in range(5, 125, 5):
        found.hear(report(north=4.0 * t, time=NOW + t, **blank), NOW + t)
    (seen,) = found.present(NOW + 120)
    assert seen.derived and not seen.sized and math.isnan(seen.heading_told) and math.isnan(seen.rate_told)
    assert abs(seen.speed - 4.0) < 3 * seen.velocity_sd < 2.0
    assert abs(seen.course) < 0.2
    assert seen.yaw_rate == 0.0 and seen.rate_sd > 0.0


def test_turn_without_a_sensor():
    """Analytic: fixes every 2 s along a circle at 0.03 rad/s: a rate of turn that nobody told is seen in the positions."""
    found = Targets(ZONE)
    for t in range(0, 120, 2):
        north, east = 200 * math.sin(0.03 * t), 200 * (1 - math.cos(0.03 * t))
        gamma = math.degrees(float(convergence(*to_geodetic(NORTH, EAST, ZONE), ZONE)))
        said = report(
            north, east, NOW + t, yaw_rate_deg_s=NAN, speed_m_s=6.0, course_deg=(math.degrees(0.03 * t) + gamma) % 360
        )
        found.hear(said, NOW + t)
    (seen,) = found.present(NOW + 120)
    assert seen.yaw_rate == pytest.approx(0.03, abs=3 * seen.rate_sd) and seen.yaw_rate > 0.02


def test_lost_after_so_many_intervals():
    """By hand: class A at 5 m/s (9.7 kn) reports every 10 s and is lost after five of them; `forget` tells it once and drops it."""
    found = heard(report())
    assert len(found.present(NOW + 50)) == 1 and found.present(NOW + 50.1) == []
    assert found.forget(NOW + 50) == []
    assert [t.id for t in found.forget(NOW + 51)] == ["257000001"]
    assert found.forget(NOW + 51) == [] and not found._ais


@pytest.mark.parametrize(
    "kind, knots, wait", [(1, 5, 10), (1, 20, 6), (3, 25, 2), (1, 0.1, 180), (18, 5, 30), (18, 1, 180), (27, 9, 180)]
)
def test_intervals(kind, knots, wait):
    """The table of ITU-R M.1371 (recalled), steady course."""
    assert interval(report(kind=kind), knots * KNOT) == wait


def test_what_is_passed_over():
    """By hand: own ship, shore stations, fixes by hand, without a place, late or repeated ones make or move no target."""
    own = Targets(ZONE, own=MMSI)
    own.hear(report(), NOW)
    assert own.present(NOW) == []
    found = heard(
        report(mmsi=2570001),
        report(measured=False),
        report(latitude_deg=NAN),
        report(mmsi=992570001),
        9,
        Static(MMSI, 5, "A", None, 0.0),
    )
    assert found.present(NOW) == [] and found.counts == {"without_position": 2}
    found = heard(report(), report(north=50), report(north=50, time=NOW - 10))
    (seen,) = found.present(NOW)
    assert seen.north == pytest.approx(NORTH, abs=1e-3) and found.counts == {"late_or_repeated": 2}


def test_own_ship_relayed():
    """By hand: a ship that turns out to be one's own is no target from then on."""
    found = heard(report())
    found.is_own(MMSI)
    found.hear(report(time=NOW + 10), NOW + 10)
    assert found.present(NOW + 10) == []


def test_turning_targets_stay_unsure():
    """Law: of a ship that turns, also after a full circle (chord 0), the region is no smaller than of one that lies still."""
    (seen,) = heard(report(yaw_rate_deg_s=6.0)).present(NOW)
    path = predict([seen], NOW, np.arange(0.0, 91.0))
    assert np.hypot(path.north[0, 60] - path.north[0, 0], path.east[0, 60] - path.east[0, 0]) < 0.1
    trace = np.trace(path.spread.covariance[0, :, :2, :2], axis1=1, axis2=2)
    assert (np.diff(trace) > 0).all() and trace[60] > 4 * trace[0]


angles = st.one_of(st.just(NAN), st.floats(-360, 360))


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_whatever_ais_says(data):
    """Law: any numbers that messages can hold make targets, dangers and entries of finite numbers, and nothing raises."""
    found, outline = Targets(ZONE), load_vessel("cargo90").outline()
    now = NOW
    for _ in range(data.draw(st.integers(1, 6))):
        side = st.integers(0, 511)
        size = data.draw(st.one_of(st.none(), st.tuples(side, side, st.integers(0, 63), st.integers(0, 63))))
        found.hear(Static(MMSI, 5, data.draw(st.text(max_size=20)), size, data.draw(st.floats(0, 25.5))), now)
        told = {
            "latitude_deg": data.draw(st.one_of(st.just(NAN), st.floats(-90, 90), st.just(69.5))),
            "longitude_deg": data.draw(st.one_of(st.just(NAN), st.floats(-180, 180), st.just(18.8))),
            "speed_m_s": data.draw(st.one_of(st.just(NAN), st.floats(0, 52.6))),
            "course_deg": data.draw(angles),
            "heading_deg": data.draw(angles),
            "yaw_rate_deg_s": data.draw(st.one_of(st.just(NAN), st.floats(-11.8, 11.8))),
            "second": data.draw(st.one_of(st.just(NAN), st.integers(0, 59).map(float))),
            "kind": data.draw(st.sampled_from([1, 3, 18, 19, 27])),
        }
        found.hear(report(**told), now)
        now += data.draw(st.floats(0, 40))
    own = integrate((NORTH, EAST, 0.3), np.tile([6.0, 0.2, 0.01], (45, 1)), 2.0)
    own = replace(own, spread=gaussian(np.tile(np.diag([4.0, 4.0, 1e-4]), (46, 1, 1))))
    dangers, paths = assess(own, outline, found.present(now), now, Limits())
    for entry in target_entries(dangers, paths, now, ZONE):
        assert 0 <= entry["probability"] <= 1 and entry["cpa"] >= 0
        json.dumps(entry, allow_nan=False)
    found.forget(now)


def test_jumps():
    """By hand: a fix 50 km off is not believed; three in a row there are, and the track begins anew."""
    found = heard(report())
    for k, there in enumerate([False, False, True]):
        time = NOW + 10 * (k + 1)
        found.hear(report(north=50_000 + 5 * k, time=time), time)
        (seen,) = found.present(time)
        assert (seen.north - NORTH > 49_000) == there
    assert found.counts == {"jumps": 2}


def test_memory_is_bounded(monkeypatch):
    """Law: of more ships than MOST the one silent longest goes; static data without positions are forgotten in time."""
    monkeypatch.setattr(module, "MOST", 3)
    found = Targets(ZONE)
    for k in range(5):
        found.hear(report(mmsi=MMSI + k, time=NOW + k), NOW + k)
    assert [t.id for t in found.present(NOW + 5)] == ["257000003", "257000004", "257000005"]
    found = heard(Static(MMSI, 5, "A", (10, 10, 2, 2), 1.0))
    found.forget(NOW + 10_000)
    assert not found._ais


def test_impossible_static_data():
    """By hand: a ship that announces 1 m of length and no beam is a target all the same; the sizes that follow count."""
    found = heard(Static(MMSI, 5, "A", (0, 0, 63, 63), 0.0), report())
    (seen,) = found.present(NOW)
    assert isinstance(seen, Target) and seen.name == "A" and not seen.sized
    found.hear(Static(MMSI, 5, "A", (40, 10, 4, 4), 0.0), NOW)
    found.hear(report(time=NOW + 10, east=50), NOW + 10)
    assert found.present(NOW + 10)[0].vessel.length == 50
