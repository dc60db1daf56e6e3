"""What-if answers: the nearest other ship of each path against a search of all, and how a choice is told."""

import numpy as np
import pytest
import shapely

from aspnn.frames import to_geodetic
from aspnn.live.forecast import Forecaster
from aspnn.live.whatif import Clear, Other, WhatIf, _choice, answer, nearest_ships, sided
from aspnn.motion import integrate
from aspnn.motion.swept import Approach
from tests.live.stand_in import EAST, NORTH, ZONE, Straight, turning


def fan(rng, n):
    velocity = np.stack([rng.uniform(2, 7, n), rng.uniform(-1, 1, n), rng.uniform(-0.02, 0.02, n)], axis=-1)
    pose = np.tile([NORTH, EAST, 0.4], (n, 1))
    return integrate(pose, np.repeat(velocity[:, None], 45, axis=1), 2.0)


def test_nearest_ship_is_that_of_a_search_of_all():
    """Brute force: the polygons (a point where no size is known) of every ship at every instant. The others were reckoned 3 s before:
    their paths begin there."""
    rng, hull = np.random.default_rng(2), turning(1.0).vessel.outline()
    paths, others = fan(rng, 5), []
    for k in range(12):
        start = NORTH + rng.uniform(-300, 600), EAST + rng.choice([-1, 1]) * rng.uniform(350, 600), rng.uniform(-3, 3)
        path = integrate(start, np.tile([rng.uniform(0, 6), 0, rng.uniform(-0.01, 0.01)], (95, 1)), 1.0)
        others.append(Other(str(k), None, path, 97.0, None if k % 3 == 0 else hull * rng.uniform(0.3, 1.5)))
    found = nearest_ships(paths, hull, others, 100.0)
    assert any(one["distance"] > 5 for one in found)
    for k in range(5):
        best = (np.inf, 0.0, "")
        for other in others:
            for t, own in zip(paths.time, paths[k].outline(hull), strict=True):
                at = other.path.at(t + 3.0)
                place = shapely.Point(at.north[0], at.east[0])
                there = place if other.outline is None else shapely.Polygon(at.outline(other.outline)[0])
                best = min(best, (shapely.distance(shapely.Polygon(own), there), t, other.id))
        assert (found[k]["distance"], found[k]["time"], found[k]["id"]) == (
            pytest.approx(best[0], abs=0.06),
            best[1],
            best[2],
        )
    assert nearest_ships(paths, hull, [], 100.0) == [None] * 5


def test_orders_are_told_as_a_helmsman_hears_them():
    """By hand: minus is to port."""
    assert [sided(d) for d in (-25, 0, 2.5)] == ["25 deg port", "amidships", "2.5 deg starboard"]
    states = turning(30.0)
    latitude, longitude = (float(np.degrees(x)) for x in to_geodetic(NORTH + 500, EAST + 300, ZONE))
    asked = {
        "fan": {"from": -5, "to": 5, "step": 5},
        "clear": {"lat": latitude, "lon": longitude, "distance": 100},
    }
    found = answer(WhatIf.model_validate(asked), Forecaster(Straight(), states.vessel), states, 0.0)
    # All orders lead straight on and clear; the one nearest to that in force (5.7 deg) is 5 to starboard. Past her side at 300 - 7 m.
    assert found["choice"]["rudder"] == 5 and found["choice"]["clears"]
    assert found["choice"]["text"].startswith("5 deg starboard keeps 293 m off, closest at ")
    point = found["paths"][0]["point"]
    assert point["region"] == pytest.approx(293 - 5 * 2.4477 - 0.01 * 1.96 * 45, abs=1.5)


def test_an_order_that_runs_into_something_is_the_last_choice():
    """By hand, with entries as `answer` makes them: 5 to port clears and is nearest to the order in force, but touches the shore."""
    states = turning(30.0)  # 5.7 deg to starboard in force
    clear, degrees = Clear(lat=69.0, lon=18.0, distance=100.0), [-5.0, 0.0, 5.0]

    def told(shores, ships):
        near = [Approach(d, 30.0) for d in (150.0, 120.0, 110.0)]
        entries = [
            {
                "shore": {"distance": a},
                "target": {"distance": b, "name": "TOR", "id": "1"},
                "point": {"distance": n.distance, "time": 30.0},
            }
            for a, b, n in zip(shores, ships, near, strict=True)
        ]
        return _choice(clear, degrees, [np.radians(d) for d in degrees], entries, near, states)

    free = told([500.0] * 3, [500.0] * 3)
    assert (free["rudder"], free["clears"]) == (5, True) and "but" not in free["text"]
    other = told([500.0, 60.0, 0.0], [500.0] * 3)
    assert (other["rudder"], other["clears"]) == (0, True) and other["text"].endswith(
        "closest at 30 s, but shore only 60 m"
    )
    ship = told([500.0] * 3, [500.0, 0.0, 0.0])
    assert (ship["rudder"], ship["clears"]) == (-5, True)
    none = told([0.0] * 3, [500.0, 500.0, 0.0])
    assert not none["clears"] and none["text"].endswith("but touches shore, but touches TOR")
