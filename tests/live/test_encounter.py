"""CPA and TCPA of hulls against hand geometry, laws, and a brute search over thousands of instants."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from aspnn.live.ahead import Kind, Target, predict
from aspnn.live.encounter import Limits, assess, classical, closest
from aspnn.motion import Path, integrate
from aspnn.schema import InputError
from aspnn.vessel import Vessel, load_vessel

PLACE = np.array([7.72e6, 6.5e5])
SHIP = load_vessel("cargo90")
HULL = SHIP.outline()


def box(length: float, beam: float) -> np.ndarray:
    return np.array([[1, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]]) * [length / 2, beam / 2]


def run(north: float, east: float, heading: float, velocity, steps: int = 90, dt: float = 1.0) -> Path:
    return integrate((PLACE[0] + north, PLACE[1] + east, heading), np.tile(velocity, (steps, 1)), dt)


def fleet(*paths: Path) -> Path:
    names = ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot")
    return replace(paths[0], **{name: np.stack([getattr(p, name) for p in paths]) for name in names})


def brute(own: Path, outline, other: Path, outline2, parts: int) -> tuple[float, float]:
    """Least distance over `parts` instants of every step, each run anew from the body velocities."""

    def fine(path):
        velocity = np.stack([path.surge, path.sway, path.yaw_rate], axis=-1)[:-1]
        pose = (path.north[0] - PLACE[0], path.east[0] - PLACE[1], path.heading[0])
        return integrate(pose, np.repeat(velocity, parts, axis=0), path.time[1] / parts)

    a, b = fine(own), fine(other)
    distance = shapely.distance(shapely.polygons(a.outline(outline)), shapely.polygons(b.outline(outline2)))
    k = int(np.argmin(distance))
    return float(distance[k]), float(a.time[k])


def test_boxes_that_pass_abeam():
    """By hand: 100 x 20 m north at 5 m/s, 60 x 10 m south at 4 m/s, tracks 80 m apart: 65 m from side to side, from when bow meets
    bow, (600 - 80) / 9 s; the classical points are 80 m off at 600 / 9 s."""
    own, other = run(0, 0, 0, (5, 0, 0)), run(600, 80, math.pi, (4, 0, 0))
    near = closest(own, box(100, 20), fleet(other), box(60, 10)[None])
    np.testing.assert_allclose(near.distance, 80 - 10 - 5, atol=1e-6)
    np.testing.assert_allclose(near.time, (600 - 80) / 9, atol=0.02)
    np.testing.assert_allclose(near.own[0, 1] - PLACE[1], 10, atol=1e-6)
    np.testing.assert_allclose(near.other[0, 1] - PLACE[1], 75, atol=1e-6)


def test_crossing_boxes():
    """By hand: own ship 100 x 20 m runs north at 5 m/s, a box of 40 m that runs west at 5 m/s begins 300 m ahead and 400 m to
    starboard. Their sides are parallel: the gaps are |300 - 5 t| - 70 along and |400 - 5 t| - 30 across, and the distance is their
    hypotenuse where positive. From 46 s to 74 s they overlap lengthwise, and across from 74 s: corner touches corner at 74 s."""
    own, other = run(0, 0, 0, (5, 0, 0)), run(300, 400, -math.pi / 2, (5, 0, 0))
    near = closest(own, box(100, 20), fleet(other), box(40, 40)[None])
    assert near.distance[0] < 1e-6
    t = np.linspace(0, 90, 90001)
    gap = np.hypot(np.maximum(np.abs(300 - 5 * t) - 70, 0), np.maximum(np.abs(400 - 5 * t) - 30, 0))
    assert gap.min() < 1e-9
    np.testing.assert_allclose(near.time, t[np.argmax(gap < 1e-9)], atol=0.02)


def test_first_contact():
    """By hand: bow to bow with 9 m/s from 600 m, halves of 50 and 30 m: contact after 520 / 9 s, though the hulls overlap longer."""
    own, other = run(0, 0, 0.7, (5, 0, 0)), None
    ahead = 600 * np.array([math.cos(0.7), math.sin(0.7)])
    other = run(*ahead, 0.7 + math.pi, (4, 0, 0))
    near = closest(own, box(100, 20), fleet(other), box(60, 10)[None])
    assert near.distance[0] == 0
    np.testing.assert_allclose(near.time, 520 / 9, atol=0.01)


def test_points_on_straight_lines():
    """Analytic: hulls of 2 mm come within d = |p x v| / |v| at t = -p.v / v^2, as the classical figures say, in the horizon."""
    rng, tiny = np.random.default_rng(3), box(2e-3, 2e-3)
    starts = [run(0, 0, 0.4, (6, 0.5, 0))] + [
        run(*rng.uniform(-400, 400, 2), rng.uniform(-3, 3), (rng.uniform(1, 8), rng.uniform(-1, 1), 0))
        for _ in range(30)
    ]
    own, others = starts[0], fleet(*starts[1:])
    near = closest(own, tiny, others, np.repeat(tiny[None], 30, axis=0))
    place = (others.north - own.north)[:, 0] + 1j * (others.east - own.east)[:, 0]
    speeds = [(p.surge[..., 0] + 1j * p.sway[..., 0]) * np.exp(1j * p.heading[..., 0]) for p in (own, others)]
    within = 0
    for k in range(30):
        dcpa, dtcpa = classical(complex(place[k]), complex(speeds[1][k] - speeds[0]))
        if 0 < dtcpa < 90:
            within += 1
            assert near.distance[k] == pytest.approx(dcpa, abs=4e-3 + 1e-4 * dcpa)
            assert near.time[k] == pytest.approx(dtcpa, abs=0.3)
    assert within > 5


@pytest.mark.parametrize("steps, dt", [(90, 1.0), (9, 10.0)])
def test_turning_hulls_against_brute_force(steps, dt):
    """Brute force: the distance of real outlines at 100 or 1000 instants of every step, of ships that turn and drift. It is an upper
    bound of the least one, by what the hulls move in half an instant (0.3 m at most)."""
    rng = np.random.default_rng(8)

    def some(spread):
        return run(
            *rng.uniform(-spread, spread, 2),
            rng.uniform(-3, 3),
            (*rng.uniform([2, -1, -0.03], [8, 1, 0.03]),),
            steps,
            dt,
        )

    own, others = some(1), [some(500) for _ in range(12)]
    hulls = np.stack([replace(SHIP, length=float(rng.uniform(20, 200))).outline() for _ in others])
    near = closest(own, HULL, fleet(*others), hulls)
    for k, other in enumerate(others):
        distance, time = brute(own, HULL, other, hulls[k], round(100 * dt))
        assert distance - 0.3 <= near.distance[k] <= distance + 1e-3
        if distance == 0:
            assert near.time[k] == pytest.approx(time, abs=0.03)


def test_laws():
    """Laws: exchanging the ships exchanges the places; the mirror image and the turned picture have the same distances."""
    own, other = run(0, 0, 0.3, (6, 0.3, 0.01)), run(400, 250, -2.4, (5, -0.2, -0.008))
    there = closest(own, HULL, fleet(other), box(60, 10)[None])
    back = closest(other, box(60, 10), fleet(own), HULL[None])
    np.testing.assert_allclose(back.distance, there.distance, atol=2e-3)
    np.testing.assert_allclose(back.time, there.time, atol=0.3)
    np.testing.assert_allclose(back.own, there.other, atol=2.0)
    assert np.hypot(*(there.own - there.other)[0]) == pytest.approx(there.distance[0], abs=1e-6)

    def mirrored(p):
        start = (p.north[0] - PLACE[0], -(p.east[0] - PLACE[1]))
        return run(*start, -p.heading[0], (p.surge[0], -p.sway[0], -p.yaw_rate[0]))

    image = closest(mirrored(own), HULL, fleet(mirrored(other)), box(60, 10)[None])
    np.testing.assert_allclose(image.distance, there.distance, atol=2e-3)

    def turned(p, angle=1.1):
        place = ((p.north[0] - PLACE[0]) + 1j * (p.east[0] - PLACE[1])) * np.exp(1j * angle)
        return run(place.real, place.imag, p.heading[0] + angle, (p.surge[0], p.sway[0], p.yaw_rate[0]))

    around = closest(turned(own), HULL, fleet(turned(other)), box(60, 10)[None])
    np.testing.assert_allclose(around.distance, there.distance, atol=2e-3)


def test_turn_between_two_looks():
    """By hand: a ship of 20 m that drifts away at 1 cm/s and then turns half round from 40 s to 44 s, between two of the instants that are
    looked at first, points her bow in the middle of it at a box whose side was 10.82 m off: the nearest is 10.82 + 0.4 - 10 m then,
    not the 10.82 m of the start."""
    velocity = np.tile([0.0, -0.01, 0.0], (90, 1))
    velocity[40:] = 0.0
    velocity[40:44, 2] = math.pi / 4
    own = integrate((*PLACE, 0.0), velocity, 1.0)
    other = run(0, 10.8 + 0.02 + 0.5, 0, (0, 0, 0))
    near = closest(own, box(20, 1e-3), fleet(other), box(1, 1)[None])
    np.testing.assert_allclose(near.distance, 10.82 + 0.4 - 10, atol=0.02)
    np.testing.assert_allclose(near.time, 42, atol=0.05)


def test_beside_each_other():
    """By hand: the same velocity keeps the distance; the time of equal distances is the first, and the classical time is unknown."""
    near = closest(run(0, 0, 0.0, (5, 0, 0)), box(100, 20), fleet(run(0, 75, 0.0, (5, 0, 0))), box(60, 10)[None])
    np.testing.assert_allclose([near.distance[0], near.time[0]], [60, 0], atol=1e-6)
    distance, time = classical(75j, 0j)
    assert distance == 75 and math.isnan(time)


def vessel(length: float) -> Vessel:
    return replace(SHIP, length=length, beam=length / 6)


def target(name: str, north: float, east: float, heading: float, speed: float) -> Target:
    return Target(
        id=name, name=name, kind=Kind.ais, time=1000.0, north=PLACE[0] + north, east=PLACE[1] + east, heading=heading,
        convergence=0.0, surge=speed, sway=0.0, yaw_rate=0.0, heading_told=heading, rate_told=0.0, derived=False,
        vessel=vessel(60), sized=True, interval=10.0, position_sd=4.0, velocity_sd=0.2, heading_sd=0.01, rate_sd=0.001,
        speed_density=1e-3, turn_density=1e-7,
    )  # fmt: skip


def test_list_of_dangers():
    """By hand: who meets soonest comes first; who comes near beyond the horizon is dangerous by the classical figures; who has passed
    and who is far off are not. Limits decide."""
    own = run(0, 0, 0.0, (6, 0, 0))
    fleet_ = [
        target("past", -700, 30, math.pi, 6),
        target("later", 2400, 50, math.pi, 6),  # meets after 200 s, past the horizon
        target("soon", 600, 60, math.pi, 6),
        target("clear", 500, 3000, 0.0, 6),
    ]
    found, paths = assess(own, HULL, fleet_, 1000.0, Limits(cpa=100, tcpa=300))
    assert [d.target.name for d in found] == ["soon", "later", "past", "clear"]
    assert [d.dangerous for d in found] == [True, True, False, False]
    assert [d.index for d in found] == [2, 1, 0, 3] and paths.north.shape == (4, 91)
    soon, later = found[:2]
    assert (
        soon.dcpa == pytest.approx(60)
        and soon.dtcpa == pytest.approx(50)
        and soon.range == pytest.approx(math.hypot(600, 60))
    )
    assert soon.cpa == pytest.approx(60 - 5 - 7, abs=1e-3)  # half the beams of 10 and 14 m
    assert later.dtcpa == pytest.approx(200) and later.tcpa == pytest.approx(90)
    assert math.isnan(soon.probability)  # own path has no regions
    assert not any(d.dangerous for d in assess(own, HULL, fleet_, 1000.0, Limits(cpa=10, tcpa=300))[0])
    assert [d.dangerous for d in assess(own, HULL, fleet_, 1000.0, Limits(cpa=100, tcpa=100))[0]] == [
        True,
        False,
        False,
        False,
    ]
    assert assess(own, HULL, [], 1000.0, Limits())[0] == []


def test_who_goes_away_is_no_danger_but_close_by():
    """By hand: two ships abeam, own ship 7 m and they 5 m of half beam, 40 and 80 m off and drawing away at 1 m/s: hulls 28 and 68 m apart
    now. With a guard of 50 m the nearer one is dangerous, after the one that closes; one on the same course is not going away."""
    own = run(0, 0, 0.0, (6, 0, 0))
    leaving = [replace(target(f"{d}", 0, d, 0.0, 6), sway=1.0) for d in (40, 80)]
    abreast, closing = target("abreast", 0, -80, 0.0, 6), target("closing", 900, 60, math.pi, 6)
    found, _ = assess(own, HULL, [*leaving, abreast, closing], 1000.0, Limits(cpa=100, tcpa=300, guard=50))
    assert [(d.target.name, d.dangerous, d.receding) for d in found] == [
        ("abreast", True, False),
        ("closing", True, False),
        ("40", True, True),
        ("80", False, True),
    ]
    none, _ = assess(own, HULL, leaving, 1000.0, Limits(cpa=100, tcpa=300, guard=0))
    assert not any(d.dangerous for d in none)


@pytest.mark.parametrize("wrong", [{"cpa": -1}, {"tcpa": math.nan}, {"cpa": math.inf}, {"guard": -1}])
def test_wrong_limits(wrong):
    """A limit that is none is refused with its name."""
    with pytest.raises(InputError, match=next(iter(wrong))):
        Limits(**wrong)


def test_predicted_from_an_old_report():
    """Analytic: a report of 20 s ago of a ship on a straight course is 20 s further on, and her region has grown by then."""
    seen = target("A", 0, 0, 0.5, 5.0)
    path = predict([seen], 1020.0, np.arange(0, 91.0))
    np.testing.assert_allclose(path.north[0] - PLACE[0], 5 * np.arange(20, 111) * math.cos(0.5), atol=1e-6)
    fresh = predict([seen], 1000.0, np.arange(0, 111.0))
    np.testing.assert_allclose(path.spread.covariance[0], fresh.spread.covariance[0, 20:], rtol=1e-9)
