"""Routes against plane geometry: shapely, circles drawn point by point, places worked out by hand."""

import numpy as np
import pytest
from shapely import LineString, Point

from aspnn.guidance.route import Follower, Route
from aspnn.schema import InputError

PAPER = Route(np.array([(0, 0), (2000, 0), (5000, 5000), (3000, 8000), (6000, 12000), (10000, 12000)], float))


def test_errors_are_those_of_geometry():
    """Oracle: shapely's projection on the leg and distance from it, for places abeam of the leg; side by the turning sense of three
    points. (46) as printed fails it (E57).
    """
    rng = np.random.default_rng(1)
    for k, (start, end) in enumerate(zip(PAPER.points[:-1], PAPER.points[1:], strict=True)):
        share, off = rng.uniform(0.05, 0.7, 20), rng.uniform(-400, 400, 20)
        ahead = (end - start) / np.hypot(*(end - start))
        places = start + share[:, None] * (end - start) + off[:, None] * np.array([-ahead[1], ahead[0]])
        follower = Follower(Route(np.array([start, end])), 50.0, ships=20)
        error = follower.update(*places.T)
        line = LineString([start, end])
        np.testing.assert_allclose(error.along, [line.project(Point(p)) for p in places], atol=1e-8)
        np.testing.assert_allclose(np.abs(error.cross), [line.distance(Point(p)) for p in places], atol=1e-8)
        turning = ahead[0] * (places - start)[:, 1] - ahead[1] * (places - start)[:, 0]
        np.testing.assert_array_equal(np.sign(error.cross), np.sign(turning))
        np.testing.assert_allclose(error.along + error.remaining, PAPER.lengths[k])
        np.testing.assert_allclose(np.exp(1j * error.path_angle), complex(*ahead))


def test_leg_gives_way_at_the_circle_or_after_an_overrun():
    """Oracle: places by hand on the paper's route: the first leg runs north, so its along-track error is the northing (E57, E58)."""
    follower = Follower(PAPER, 50.0, ships=4)
    east = np.zeros(4)
    error = follower.update(np.array([0.0, 1949.0, 1951.0, 2600.0]), east)
    np.testing.assert_array_equal(error.leg, [0, 0, 1, 1])  # the last has overrun the waypoint
    assert error.path_angle[2] == pytest.approx(np.arctan2(5, 3))
    np.testing.assert_array_equal(follower.update(np.zeros(4), east).leg, [0, 0, 1, 1])  # never back


def test_end_is_kept_and_its_line_goes_on():
    """Oracle: the definition, on a route of two legs: done once, from within the circle of the last waypoint, and for good."""
    follower = Follower(Route(np.array([[0, 0], [1000, 0], [1000, 1000.0]])), 100.0)
    steps = [
        (500, 0, False),
        (950, 0, False),
        (1000, 890, False),
        (1010, 910, True),
        (1000, 700, True),
        (1020, 1500, True),
    ]
    for north, east, done in steps:
        error = follower.update(np.array([float(north)]), np.array([float(east)]))
        assert error.done[0] == done
    assert error.remaining[0] == pytest.approx(-500) and error.cross[0] == pytest.approx(-20)
    assert error.leg[0] == 1


def test_each_ship_on_a_route_of_her_own():
    """Oracle: a follower of each route alone; routes of different lengths."""
    rng = np.random.default_rng(4)
    routes = [PAPER, Route(np.array([[0, 0], [0, 3000.0]])), Route(np.array([[100, 0], [900, 900], [0, 2500.0]]))]
    together, alone = Follower(routes, 60.0, ships=3), [Follower(route, 60.0) for route in routes]
    for place in np.cumsum(rng.uniform(-50, 150, (60, 3, 2)), axis=0):
        error = together.update(*place.T)
        for b, one in enumerate(alone):
            for found, single in zip(error, one.update(*place[b, :, None]), strict=True):
                np.testing.assert_allclose(found[b], single[0])


def test_unknown_places_change_nothing():
    """Oracle: the definition: NaN is on no leg's end."""
    follower = Follower(PAPER, 50.0, ships=2)
    error = follower.update(np.array([np.nan, 1990.0]), np.array([0.0, 0.0]))
    assert np.isnan(error.along[0]) and list(error.leg) == [0, 1] and not error.done.any()


@pytest.mark.parametrize("turn", np.radians([30.0, 70.0, 120.0]))
def test_turning_circle_leaves_the_route_as_drawn(turn):
    """Oracle: the turning circle drawn point by point from the switching circle on: how far outside it gets, and where it ends."""
    radius, circle = 500.0, 60.0
    points = np.array([[0, 0], [5000, 0], [5000 + 900 * np.cos(turn), 900 * np.sin(turn)]])
    route = Route(points)
    theta = np.linspace(0, turn, 2001)
    track = np.stack([5000 - circle + radius * np.sin(theta), radius * (1 - np.cos(theta))], axis=-1)
    ahead = np.array([np.cos(turn), np.sin(turn)])
    outside = np.max((track - points[1]) @ [-ahead[1], ahead[0]] * -1)
    ends = (track[-1] - points[1]) @ ahead
    said = route.sharp(circle, radius)
    assert said is not None
    if ends > 900:
        assert f"ends {ends:.0f} m along" in said
    else:
        assert f"by {outside:.0f} m" in said and "waypoint 2" in said
        wide = float(said.split("circle of ")[-1].split(" m")[0])
        assert route.sharp(wide + 1, radius) is None
    assert Route(points[:2]).sharp(circle, radius) is None


def test_turns_count_to_starboard():
    """Oracle: the angles between the paper's legs by atan2, by hand."""
    np.testing.assert_allclose(np.degrees(PAPER.turns), [59.036, 64.654, -70.560, -53.130], atol=1e-3)


@pytest.mark.parametrize(
    "points, says",
    [
        ([[0, 0]], "two waypoints"),
        ([[0, 0, 0], [1, 1, 1]], "two waypoints"),
        ([[0, 0], [np.nan, 1]], "two waypoints"),
        ([[0, 0], [0, 2000], [0, 2000], [9, 9]], r"waypoints 2 and 3 are both \(0, 2000\)"),
        ([[0, 0], [0, 2000], [0, 500]], "at waypoint 2 it turns back by 180 degrees"),
        ([[0, 0], [0, 2000], [9000, 2000], [0, 2010]], "at waypoint 3 it turns back by 180 degrees"),
    ],
)
def test_what_is_no_route_is_named(points, says):
    """Oracle: the project's rule: one line that names the waypoint."""
    with pytest.raises(InputError, match=says) as caught:
        Route(np.array(points, float))
    assert "\n" not in str(caught.value)


def test_circle_that_swallows_a_leg_is_named():
    """Oracle: the definition: a leg no longer than the circle would be over as it begins."""
    with pytest.raises(InputError, match="from waypoint 1 to 2 is 2000 m, within a switching circle of 2500 m"):
        Follower(PAPER, 2500.0)
    with pytest.raises(InputError, match="above 0"):
        Follower(PAPER, 0.0)
