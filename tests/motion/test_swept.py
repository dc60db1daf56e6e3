"""Swept areas against motions whose envelope is known, and against a brute union of thousands of poses."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon

from aspnn.motion import Path, Spread, integrate
from aspnn.motion.swept import closest_approach, sweep, swept_area, swept_region
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

HULL = load_vessel("cargo90").outline()
PLACE = (7.72e6, 6.5e5)  # a UTM place: far from zero, as real ones are
NOTCHED = np.array([[5, -5], [5, 5], [-5, 5], [-5, 2], [1, 2], [1, -2], [-5, -2], [-5, -5]], float)  # open astern


def run(velocity, steps: int = 90, dt: float = 1.0, heading: float = 0.7) -> Path:
    return integrate((*PLACE, heading), np.tile(velocity, (steps, 1)), dt)


def brute(path: Path, hull: np.ndarray, parts: int) -> tuple[Polygon, float]:
    """Union of the hulls at `parts` poses of every step, and the most that scallops can lack: the travel between two."""
    velocity = np.stack([path.surge, path.sway, path.yaw_rate], axis=-1)[:-1]
    pose = (path.north[0] - PLACE[0], path.east[0] - PLACE[1], path.heading[0])
    fine = integrate(pose, np.repeat(velocity, parts, axis=0), path.time[1] / parts)
    speed = np.hypot(path.surge, path.sway) + np.abs(path.yaw_rate) * np.hypot(*hull.T).max()
    return shapely.union_all(shapely.polygons(fine.outline(hull))), float(speed.max() * fine.time[1])


def local(area):
    return shapely.transform(area, lambda points: points - PLACE)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
@pytest.mark.parametrize("velocity", [(6.0, 0.0, 0.0), (3.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
def test_straight_run(velocity, heading):
    """Analytic: a convex hull moved straight sweeps the convex hull of its first and last pose."""
    path = run(velocity, heading=heading)
    first, last = shapely.polygons(path.outline(HULL)[[0, -1]] - PLACE)
    expected = shapely.union(first, last).convex_hull
    assert local(swept_area(path, HULL)).symmetric_difference(expected).area < 1e-4
    if velocity[1] == 0:  # the rectangle of the run and the hull itself
        np.testing.assert_allclose(swept_area(path, HULL).area, 540 * 14 + Polygon(HULL).area, rtol=1e-7)


@pytest.mark.parametrize(("velocity", "area"), [((1.0, 0.0, 0.0), 106.0), ((0.0, 1.0, 0.0), 124.0)])
def test_concave_outline(velocity, area):
    """By hand: 3 m ahead leaves the notch of 6 by 4 m open behind the bow, 3 m abeam leaves 1 of its 4 m."""
    np.testing.assert_allclose(swept_area(run(velocity, 3), NOTCHED).area, area, atol=1e-6)


@pytest.mark.parametrize("tolerance", [0.3, 0.01])
@pytest.mark.parametrize(("steps", "dt"), [(400, 1.0), (25, 16.0)])
def test_turning_on_the_spot(steps, dt, tolerance):
    """Analytic: a full turn about midship sweeps the disc of the outermost point, within the tolerance at any step."""
    path = run((0.0, 0.0, 2 * np.pi / 400), steps, dt)
    area, radius = local(swept_area(path, HULL, tolerance)), np.hypot(*HULL.T).max()
    assert area.geom_type == "Polygon"
    assert not area.interiors
    reach = np.hypot(*shapely.get_coordinates(shapely.segmentize(area.exterior, 0.1)).T)
    assert radius - tolerance < reach.min() <= reach.max() < radius + 1e-6


@pytest.mark.parametrize("velocity", [(6.0, -0.8, 0.05), (6.0, 0.3, -0.05), (5.0, -2.0, 0.05)])
@pytest.mark.parametrize("tolerance", [0.2, 0.01])
def test_circle_is_a_ring(velocity, tolerance):
    """Analytic: a steady turn has one centre; the ring reaches from the hull's nearest to its furthest distance from it."""
    u, v, r = velocity
    path = run(velocity, 126, 2 * np.pi / 0.05 / 125)
    area = swept_area(path, HULL, tolerance)
    forward, starboard = -v / r, u / r  # the centre in body axes
    inner = Polygon(HULL).distance(Point(forward, starboard))
    outer = np.hypot(HULL[:, 0] - forward, HULL[:, 1] - starboard).max()
    centre = np.array(PLACE) + np.array(
        [
            forward * np.cos(0.7) - starboard * np.sin(0.7),
            forward * np.sin(0.7) + starboard * np.cos(0.7),
        ]
    )
    assert len(area.interiors) == 1
    for ring, radius in ((area.exterior, outer), (area.interiors[0], inner)):
        reach = np.hypot(*(shapely.get_coordinates(shapely.segmentize(ring, 0.1)) - centre).T)
        np.testing.assert_allclose(reach, radius, rtol=0, atol=tolerance)


MOTIONS = {
    "turn": lambda t: (6 - 0.02 * t, -0.8 * np.tanh(t / 20), 0.02 * np.tanh(t / 20)),
    "swerve": lambda t: (6 + 0 * t, 0.3 * np.sin(t / 9), 0.03 * np.cos(t / 9)),
    "about the bow": lambda t: (0.2 + 0 * t, -1.8 + 0 * t, 0.04 + 0 * t),
    "astern": lambda t: (-2 + 0 * t, 0.4 * np.cos(t / 7), -0.02 * np.sin(t / 5)),
}


@pytest.mark.parametrize("hull", [HULL, NOTCHED * 5], ids=["hull", "notched"])
@pytest.mark.parametrize("name", MOTIONS)
def test_any_motion_is_the_union_of_its_poses(name, hull):
    """Independent: the union of 40 poses a second lies inside, and reaches the boundary but for scallops and tolerance."""
    t = np.arange(30.0) * 2
    path = integrate((*PLACE, 0.7), np.stack(MOTIONS[name](t), axis=-1), 2.0)
    area = local(swept_area(path, hull, 0.02))
    poses, travel = brute(path, hull, 80)
    assert poses.difference(area.buffer(0.02 + 1e-6)).area < 1e-9
    assert area.difference(poses.buffer(travel / 2 + 0.02)).area < 1e-9


def test_tolerance_sets_the_number_of_poses():
    """Law: the error of a chord goes with the square of the angle, so a hundredth of the tolerance takes ten times the poses."""
    path = run((6.0, -0.8, 0.02), 3, 10.0)
    counts = [len(sweep(path, HULL, tolerance).time) - 1 for tolerance in (0.01, 0.0001)]
    np.testing.assert_allclose(counts[1] / counts[0], 10, rtol=0.1)
    assert len(sweep(run((6.0, 0.0, 0.0), 3, 10.0), HULL).time) == 4  # a straight run takes none but its own


def test_thinned_path_is_the_same_motion():
    """Exact: every fifth point of a steady turn, whose steps then hold no velocity of their own, sweeps the same area."""
    path = run((6.0, -0.8, 0.02), 60)
    thinned = replace(
        path, **{name: getattr(path, name)[::5] for name in ("time", "north", "east", "heading")}, surge=np.zeros(13)
    )
    whole, part = (local(swept_area(p, HULL)) for p in (path, thinned))
    assert whole.symmetric_difference(part).area < 0.01 * whole.length


def spread(path: Path, covariance) -> Spread:
    steps = len(path.time)
    position, heading = (np.tile(factors, (steps, 1)) for factors in ([1.1774, 2.4477], [0.6745, 1.96]))
    whole = np.broadcast_to(covariance, (steps, 3, 3))
    return Spread(whole, np.array(False), np.array([0.5, 0.95]), position, heading, np.array(1.0), 2.0)


def support(area, direction: np.ndarray) -> np.ndarray:
    return (shapely.get_coordinates(area) @ direction.T).max(axis=0)


def test_region_without_doubt_is_the_swept_area():
    """Limit: no covariance, no widening; the convex hulls between poses fill what is left of the pose's own corners."""
    path = run((6.0, -0.8, 0.02), 60)
    known = replace(path, spread=spread(path, np.zeros((3, 3))))
    area, region = local(swept_area(path, HULL)), local(swept_region(known, HULL))
    assert region.buffer(1e-6).contains(area)
    assert region.difference(area.buffer(0.35)).is_empty


def test_region_is_hull_and_ellipse_added():
    """Analytic: the support of a Minkowski sum is that of its parts; the ellipse's polygon lies at most 1 / cos(pi / 32) out."""
    covariance = np.diag([4.0, 1.0, 0.0])
    covariance[0, 1] = covariance[1, 0] = 1.2
    path = run((0.0, 0.0, 0.0), 3)
    region = local(swept_region(replace(path, spread=spread(path, covariance)), HULL))
    angle = np.linspace(0, 2 * np.pi, 50)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ellipse = 2.4477 * np.sqrt(np.einsum("ki,ij,kj->k", direction, covariance[:2, :2], direction))
    ship = support(local(swept_area(path, HULL)), direction)
    found = support(region, direction) - ship
    assert (found > ellipse - 1e-6).all()
    assert (found < ellipse * 1.005 + 1e-6).all()


@pytest.mark.parametrize("sd", [0.01, 0.2])
def test_region_turns_the_hull_through_its_interval(sd):
    """Analytic: at rest with the heading alone unknown, it is the area swept in turning from one end to the other, convex."""
    path = run((0.0, 0.0, 0.0), 2)
    region = local(swept_region(replace(path, spread=spread(path, np.diag([0, 0, sd**2]))), HULL))
    turning = integrate((*PLACE, 0.7 - 1.96 * sd), [[0.0, 0.0, 2 * 1.96 * sd]], 1.0)
    turned = local(swept_area(turning, HULL, 1e-3)).convex_hull
    assert region.buffer(2e-3).contains(turned)
    assert region.difference(turned.buffer(46 * (1 / np.cos(1.96 * sd / 4) - 1) + 1.1e-3)).is_empty


def test_region_holds_its_share():
    """Statistic: of 2000 normal errors at the end of a turn, the hull lies inside in 2 level - 1 at least (Bonferroni)."""
    path = run((6.0, -0.8, 0.02), 60)
    covariance = np.array([[4.0, 1.0, 0.01], [1.0, 2.0, 0.0], [0.01, 0.0, 1e-3]])
    region = swept_region(replace(path, spread=spread(path, covariance)), HULL)
    north, east, heading = np.random.default_rng(3).multivariate_normal(np.zeros(3), covariance, 2000).T
    ends = replace(
        path, north=path.north[-1] + north, east=path.east[-1] + east, heading=path.heading[-1] + heading
    ).outline(HULL)
    shapely.prepare(region)
    inside = shapely.contains(region, shapely.polygons(ends)).mean()
    assert 0.90 <= inside < 1.0


def test_region_needs_a_spread():
    path = run((6.0, 0.0, 0.0), 3)
    with pytest.raises(InputError, match="has no regions"):
        swept_region(path, HULL)
    cut = np.broadcast_to(np.eye(3), (4, 3, 3)).copy()
    cut[2:] = np.nan
    with pytest.raises(InputError, match="no region at 2 s"):
        swept_region(replace(path, spread=spread(path, cut)), HULL)


@pytest.mark.parametrize(
    ("place", "distance", "time"),
    [
        ((200.0, 50.0), 50 - 7, (200 - 27) / 6),  # abeam: the parallel side begins 27 m ahead of midship
        ((200.0, 0.0), 0.0, (200 - 45) / 6),  # ahead: the bow is 45 m ahead
        ((0.0, 3.0), 0.0, 0.0),  # under the hull at the start
        ((-145.0, 0.0), 100.0, 0.0),  # astern: it only goes away
        ((625.0, 0.0), 40.0, 90.0),  # beyond the end
    ],
)
def test_closest_approach_by_hand(place, distance, time):
    """By hand: a straight run north at 6 m/s for 90 s."""
    path = run((6.0, 0.0, 0.0), heading=0.0)
    found = closest_approach(path, HULL, Point(np.add(PLACE, place)))
    np.testing.assert_allclose(found.distance, distance, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.time, time, rtol=0, atol=1 / 32 + 1e-9)


@pytest.mark.parametrize("name", MOTIONS)
def test_closest_approach_is_the_distance_to_the_swept_area(name):
    """Independent: shapely's distance to the union; and at the time told, the hull itself is there."""
    t = np.arange(60.0)
    path = integrate((*PLACE, 0.7), np.stack(MOTIONS[name](t), axis=-1), 1.0)
    area = swept_area(path, HULL)
    for thing in (
        Point(np.add(PLACE, (300, 150))),
        LineString(np.add(PLACE, [(-200, 400), (500, 200)])),
        Point(np.add(PLACE, (-150, -120))).buffer(30),
    ):
        found = closest_approach(path, HULL, thing)
        np.testing.assert_allclose(found.distance, area.distance(thing), rtol=0, atol=1e-6)
        then = Polygon(path.at(found.time).outline(HULL)[0])
        np.testing.assert_allclose(
            then.distance(thing), found.distance, rtol=0, atol=0.3
        )  # 1/32 s of 6 m/s, and chords
