"""Paths that bend and their foot points, against closed formulae and brute force."""

import numpy as np
import pytest
from scipy.integrate import quad

from aspnn.angles import difference, unwrap
from aspnn.estimation.sideslip import SideslipModel
from aspnn.guidance.compensation import KalmanLos
from aspnn.guidance.curves import ArcPath, CurveFollower, SplinePath, path_turn
from aspnn.guidance.route import Follower, Route
from aspnn.schema import InputError

POINTS = np.array([[0.0, 0.0], [60.0, 0.0], [85.0, 55.0], [20.0, 90.0], [60.0, 150.0]])
CURVES = {
    "arcs": ArcPath.through(Route(POINTS), 12.0),
    "spline": SplinePath(POINTS),
    "monotone": SplinePath(POINTS, monotone=True),
}


@pytest.mark.parametrize("name", CURVES)
def test_derivatives_and_the_way_are_those_of_the_places(name):
    """Oracle: central differences of places and directions, and scipy's quad of the speed along the curve."""
    curve, h = CURVES[name], 1e-4
    w = np.linspace(0.7, curve.end - 0.7, 57)
    low, at, high = (curve.at(w + step) for step in (-h, 0.0, h))
    for axis in ("north", "east"):
        change = (getattr(high, axis) - getattr(low, axis)) / (2 * h)
        np.testing.assert_allclose(getattr(at, f"d_{axis}"), change, atol=1e-6)
        bend = (getattr(high, f"d_{axis}") - getattr(low, f"d_{axis}")) / (2 * h)
        np.testing.assert_allclose(getattr(at, f"dd_{axis}"), bend, atol=1e-5)
    turned = difference(high.angle, low.angle) / (curve.arc(w + h) - curve.arc(w - h))
    np.testing.assert_allclose(at.curvature, turned, atol=1e-5)

    def rate(x):
        one = curve.at(np.array([x]))
        return float(np.hypot(one.d_north, one.d_east)[0])

    for part in (0.3, 1.0):
        way = quad(rate, 0, part * curve.end, limit=400, points=np.linspace(0, part * curve.end, 30)[1:-1])[0]
        assert float(curve.arc(np.array(part * curve.end))) == pytest.approx(way, rel=1e-7)


def test_arcs_are_circles_and_keep_to_their_legs():
    """Oracle: plane geometry. One quarter turn by hand; a rounded route ends where the route ends, shorter by 2 R tan(t / 2) - R t a turn."""
    quarter = ArcPath(np.array([3.0, -1.0]), 0.0, np.array([5.0, 10 * np.pi / 2]), np.array([0.0, 0.1]))
    last = quarter.at(np.array([quarter.end]))
    np.testing.assert_allclose([last.north[0], last.east[0], last.angle[0]], [18.0, 9.0, np.pi / 2], atol=1e-12)
    route, curve = Route(POINTS), CURVES["arcs"]
    last = curve.at(np.array([curve.end]))
    np.testing.assert_allclose([last.north[0], last.east[0]], POINTS[-1], atol=1e-9)
    turns = np.abs(route.turns)
    assert curve.end == pytest.approx(route.lengths.sum() - 12 * np.sum(2 * np.tan(turns / 2) - turns))


@pytest.mark.parametrize("name", ["spline", "monotone"])
def test_splines_pass_through_their_waypoints(name):
    """Oracle: the waypoints; two alone are a straight line; the monotone one keeps within the box of two waypoints."""
    curve = CURVES[name]
    knots = np.concatenate([[0.0], np.cumsum(Route(POINTS).lengths)])
    at = curve.at(knots)
    np.testing.assert_allclose(np.stack([at.north, at.east], axis=-1), POINTS, atol=1e-9)
    straight = SplinePath(POINTS[:2]).at(np.linspace(0, 60, 7))
    np.testing.assert_allclose(straight.curvature, 0.0, atol=1e-12)
    within = curve.at(np.linspace(knots[0], knots[1], 50))
    assert (np.abs(within.east).max() < 1e-9) == (name == "monotone")


@pytest.mark.parametrize("name", CURVES)
def test_the_foot_point_is_the_nearest_of_the_curve(name):
    """Oracle: the least distance to 50,000 places, for ships that move along beside the curve within its radius."""
    curve = CURVES[name]
    w = np.linspace(0.5, curve.end - 0.5, 200)
    at = curve.at(w)
    beside = np.minimum(6.0, 0.6 / np.abs(at.curvature).max()) * np.sin(np.linspace(0, 20, 200))
    place = at.north + 1j * at.east + 1j * beside * np.exp(1j * at.angle)
    dense = curve.at(np.linspace(0, curve.end, 50_001))
    dense = dense.north + 1j * dense.east
    follower = CurveFollower(curve)
    for k, p in enumerate(place):
        error = follower.update(np.array([p.real]), np.array([p.imag]))
        if k % 10 == 0:
            assert abs(error.cross[0]) == pytest.approx(np.abs(dense - p).min(), abs=4e-3)
            assert np.sign(error.cross[0]) == np.sign(beside[k]) or abs(beside[k]) < 1e-3
            assert error.along[0] == pytest.approx(float(curve.arc(w[k])), abs=0.02 if name == "monotone" else 1e-6)
    assert not error.done[0] and error.remaining[0] == pytest.approx(curve.arc(curve.end) - error.along[0])


def test_a_straight_curve_is_a_leg():
    """Oracle: `route.Follower` on the same leg, also before its start and beyond its end."""
    route = Route(np.array([[10.0, -5.0], [40.0, 35.0]]))
    ours, theirs = CurveFollower(ArcPath.through(route, 1.0), 5, arrival=1.0), Follower(route, 1.0, 5)
    north, east = np.array([12.0, 0.0, 39.9, 50.0, 20.0]), np.array([3.0, -9.0, 35.0, 52.0, -30.0])
    for got, wanted in zip(ours.update(north, east), theirs.update(north, east), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-9)


def test_the_foot_point_stays_on_its_branch():
    """Oracle: the way gone. A path that comes back beside itself 2 m away, and one that crosses itself: a ship nearer to the other
    branch keeps its own."""
    hairpin = ArcPath(np.zeros(2), 0.0, np.array([60.0, np.pi, 60.0]), np.array([0.0, 1.0, 0.0]))
    follower = CurveFollower(hairpin)
    for x in np.arange(0.0, 50.0, 0.5):
        error = follower.update(np.array([x]), np.array([1.4]))  # the other branch is 0.6 m away
        assert error.along[0] == pytest.approx(x) and error.cross[0] == pytest.approx(1.4)
    # A leap of 7 m beyond the bend, where Newton's method alone swings from branch to branch.
    follower = CurveFollower(hairpin)
    follower.update(np.array([59.0]), np.array([0.0]))
    along = follower.update(np.array([66.0]), np.array([2.0])).along[0]
    assert along == pytest.approx(60 + np.pi / 2 + np.arctan2(1, 6), abs=1e-6)
    loop = ArcPath(np.zeros(2), 0.0, np.array([40.0, 1.5 * np.pi * 10, 40.0]), np.array([0.0, 0.1, 0.0]))
    follower = CurveFollower(loop, 2)
    for w in np.arange(0.0, loop.end, 0.5):
        at = loop.at(np.full(2, w))
        aside = np.array([0.5, -0.5])
        error = follower.update(at.north - aside * np.sin(at.angle), at.east + aside * np.cos(at.angle))
        np.testing.assert_allclose(error.along, w, atol=1e-6)
        np.testing.assert_allclose(error.cross, aside, atol=1e-9)


def test_beyond_the_centre_of_a_bend_the_foot_point_is_still_the_nearest_about():
    """Oracle: no place within 5 cm along the path is nearer. Beyond the centre the old nearest place becomes the farthest, and
    the foot point walks round the bend."""
    arc = ArcPath(np.zeros(2), 0.0, np.array([30.0, 5 * np.pi, 30.0]), np.array([0.0, 0.2, 0.0]))
    follower, before = CurveFollower(arc), 0.0
    for x in np.arange(0.1, 34.0, 0.25):
        along = follower.update(np.array([x]), np.array([6.0])).along[0]  # the bend has its centre at (30, 5)
        about = arc.at(np.clip(along + np.linspace(-0.05, 0.05, 401), 0, arc.end))
        away = np.hypot(about.north - x, about.east - 6.0)
        assert away[200] <= away.min() + 1e-9
        before = along
    assert before > 30 + 2.5 * np.pi
    assert follower.update(np.array([0.0]), np.array([10.0])).along[0] == pytest.approx(arc.end, abs=1e-6)


def test_a_lost_place_is_no_loss_for_good():
    """Oracle: a follower that was never told of the gap; the other ship does not notice."""
    curve = CURVES["arcs"]
    one, other = CurveFollower(curve, 2), CurveFollower(curve, 2)
    for w in np.arange(0.0, 40.0, 1.0):
        at = curve.at(np.full(2, w))
        whole = other.update(at.north, at.east)
        lost = np.array([np.nan if 10 < w < 20 else 0.0, 0.0])
        error = one.update(at.north + lost, at.east)
        assert np.isnan(error.cross[0]) == (10 < w < 20) and error.along[1] == whole.along[1]
    np.testing.assert_allclose(error.along, whole.along, atol=1e-9)


def test_the_path_turns_as_it_is_sailed():
    """Oracle: differences of the path angle at the foot point of a ship that sails at an angle beside a circle."""
    radius, U, dt = 25.0, 2.0, 1e-3
    circle = ArcPath(np.zeros(2), 0.3, np.array([100.0]), np.array([1 / radius]))
    follower, course = CurveFollower(circle, start=20.0), 1.5
    at = circle.at(np.array([20.0]))
    p = at.north + 1j * at.east + 3j * np.exp(1j * at.angle)
    one = follower.update(p.real, p.imag)
    rate = path_turn(follower.curvature, one.cross, U, course - one.path_angle)
    np.testing.assert_allclose(follower.turn(one, U, np.array([course])), rate)
    p = p + U * dt * np.exp(1j * course)
    other = follower.update(p.real, p.imag)
    np.testing.assert_allclose(difference(other.path_angle, one.path_angle) / dt, rate, rtol=1e-3)


def test_kalman_guidance_keeps_a_curve_in_a_current():
    """Oracle: the law; a craft that takes its heading at once in a current of 0.3 m/s stays within 0.6 m of the spline from 30 m on,
    where the conventional law's offset would be 5 tan(17.5 deg) = 1.57 m. The path angle it follows is continuous."""
    curve, dt, V, current = CURVES["spline"], 0.5, 1.0, 0.3j
    follower, law = CurveFollower(curve, arrival=1.0), KalmanLos(5.0, SideslipModel.published(dt))
    place, psi, speed, seen = 0j, np.array([curve.at(np.zeros(1)).angle[0]]), np.array([V]), []
    while not follower.done[0] and len(seen) < 5000:
        error = follower.update(np.array([place.real]), np.array([place.imag]))
        psi = law(error, speed, psi, dt)
        over_ground = V * np.exp(1j * psi[0]) + current
        speed, place = np.array([abs(over_ground)]), place + dt * over_ground
        seen.append((error.along[0], error.cross[0], error.path_angle[0]))
    along, cross, angle = np.array(seen).T
    assert follower.done[0] and np.all(np.diff(along) > 0)
    assert np.abs(cross[along > 30]).max() < 0.6
    assert np.abs(np.diff(unwrap(angle))).max() < 0.1


def test_impossible_paths_are_named():
    """Oracle: the message names the waypoint or piece and what must change."""
    with pytest.raises(InputError, match="waypoints 1 and 2 are both"):
        SplinePath(np.zeros((2, 2)))
    with pytest.raises(InputError, match=r"from waypoint 3 to 4.*lessen the radius"):
        ArcPath.through(Route(POINTS), 60.0)
    with pytest.raises(InputError, match="radius of 0 m"):
        ArcPath.through(Route(POINTS), 0.0)
    with pytest.raises(InputError, match="length above 0"):
        ArcPath(np.zeros(2), 0.0, np.array([1.0, 0.0]), np.array([0.0, 0.1]))
    with pytest.raises(InputError, match="parameter 500"):
        CurveFollower(CURVES["arcs"], start=500.0)
