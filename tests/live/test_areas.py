"""Swept pieces and the distance of regions against motion.swept, which makes the same areas by other means."""

import numpy as np
import pytest
import shapely

from aspnn.live.areas import COARSE, EXACT, region_bound, region_distance, strips_of
from aspnn.motion import integrate
from aspnn.motion.swept import swept_area
from tests.live.stand_in import EAST, NORTH, Straight, turning

LEVEL = 0.95


@pytest.mark.parametrize("velocity", [(6.0, 0.0, 0.0), (5.0, -0.8, 0.012), (0.5, 0.4, -0.03), (0.0, 0.0, 0.05)])
def test_pieces_make_the_swept_area(velocity):
    """Oracle: `swept_area` within 1 cm, made of what each edge sweeps. Either boundary lies within the tolerance of the other, straight
    on, in a turn with drift, and turning on the spot; each piece is convex and of its own time."""
    outline = turning(1.0).vessel.outline()
    path = integrate((NORTH, EAST, 0.4), np.tile(velocity, (45, 1)), 2.0)
    strips = strips_of(path, outline)
    found, exact = strips.area(), swept_area(path, outline, 0.01)
    assert found.difference(exact.buffer(EXACT + 0.02)).area < 1e-6
    assert exact.difference(found.buffer(EXACT + 0.02)).area < 1e-6
    assert (np.diff(strips.time) > 0).all() and strips.time[0] == 0
    k = len(strips.time) // 2
    hull = shapely.Polygon(path.at(strips.time[k]).outline(outline)[0])
    assert strips.pieces[k].buffer(EXACT).contains(hull)


@pytest.mark.parametrize("rate", [0.0, 0.01])
def test_distance_of_a_region(rate):
    """Oracle: shapely's distance to the polygon of `swept_region`, which lies outside by COARSE and the corners of its tangents (2 % of
    an ellipse); inside it is 0."""
    states = turning(30.0, rate=rate)
    path, outline = Straight(sd=12.0, turn=0.1).predict(states).at(np.arange(0.0, 91.0, 2.0)), states.vessel.outline()
    bound, rng = region_bound(path, outline, LEVEL), np.random.default_rng(4)
    centre = np.array([path.north.mean(), path.east.mean()])
    inside = 0
    for place in centre + rng.uniform(-500, 500, (60, 2)):
        expected = shapely.distance(bound, shapely.Point(place))
        found = region_distance(path, outline, LEVEL, tuple(place))
        assert expected - 0.1 <= found <= expected + COARSE + 0.02 * 12 * 2.5 + 0.1
        inside += expected == 0
    assert inside >= 3
