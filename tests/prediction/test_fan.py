"""Fans of rudder orders, the choosers against fans whose answers are worked out by hand, and their files read back."""

import io
import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
from shapely import LineString, Point
from shapely.geometry import shape

from aspnn.estimation import filter_log
from aspnn.frames import Zone, to_geodetic, to_grid
from aspnn.motion import integrate
from aspnn.motion.swept import swept_area, swept_region
from aspnn.prediction import KinematicPredictor, writers
from aspnn.prediction import fan as fans
from aspnn.prediction.gru import GruPredictor
from aspnn.records import States, read_log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

ROOT = Path(__file__).parents[2]
HULL = load_vessel("cargo90").outline()
ORDERS = [math.radians(d) for d in (-20, -10, 0, 10, 20)]
PLANS = [*ORDERS, [(0.0, 0.3), (40.0, -0.2)], None]


@cache
def now() -> States:
    return filter_log(read_log(ROOT / "data/sample/zigzag-20-20.parquet")).until(120.0)


@cache
def flagship() -> GruPredictor:
    return GruPredictor.load(ROOT / "checkpoints/cargo90")


class Spy:
    """The flagship, with its calls of predict_many counted."""

    name, horizon, calls = "spy", 90.0, 0

    def predict(self, states, rudder_plan=None, shaft_plan=None):
        raise AssertionError("a fan is one batch")

    def predict_many(self, states, rows, plans):
        self.calls += 1
        return flagship().predict_many(states, rows, plans)


def made(*turns: float, surge=6.0, steps: int = 90):
    """A fan of steady turns [rad/s] that start at zero, heading north."""
    rows = np.stack([np.broadcast_to(surge, len(turns)), np.zeros(len(turns)), turns], axis=-1)
    return integrate(np.zeros((len(turns), 3)), np.repeat(rows[:, None], steps, axis=1), 1.0)


def chosen(paths, thing, distance, in_force=0.0, orders=ORDERS):
    return fans.order_that_clears(orders, fans.approaches(paths, HULL, thing), distance, in_force)


def test_a_fan_is_one_batch_of_single_predictions():
    """Law: each row is `predict` under that order, held, planned or in force; in one call of predict_many."""
    spy = Spy()
    paths = fans.fan(spy, now(), PLANS)
    assert spy.calls == 1
    np.testing.assert_array_equal(paths.north, flagship().fan(now(), PLANS).north)
    for k, plan in enumerate(PLANS):
        one = flagship().predict(now(), plan)
        np.testing.assert_allclose([one.north, one.east], [paths[k].north, paths[k].east], atol=2e-3)  # float32 batches
        np.testing.assert_allclose(one.heading, paths[k].heading, atol=1e-5)
    assert (np.diff(paths.heading[:5, -1]) > 0).all()


def test_kinematic_fan_is_one_path_over_and_over():
    """Law: kinematics know of no rudder."""
    predictor = KinematicPredictor(now().vessel)
    paths = fans.fan(predictor, now(), ORDERS)
    one = predictor.predict(now())
    np.testing.assert_array_equal(paths.north, np.tile(one.north, (5, 1)))


def test_wrong_fans_are_refused():
    with pytest.raises(InputError, match="no order was given"):
        fans.fan(flagship(), now(), [])
    with pytest.raises(InputError, match="order 40 deg at 0 s is beyond the 35 deg stops of cargo90"):
        fans.fan(flagship(), now(), [0.0, math.radians(40)])


def test_smallest_deviation_that_clears():
    """Brute: clearances from the swept areas; of those far enough the order nearest to that in force."""
    paths, rock = made(-0.02, -0.01, 0.0, 0.01, 0.02), Point(330, 30)
    clearance = np.array([swept_area(paths[k], HULL).distance(rock) for k in range(5)])
    assert clearance[2] < 30 < clearance[1] < 110 < clearance[0]
    for distance in (0, 10, 30, 60, 110):
        for in_force in np.radians([-20, -3, 0, 12, 20]):
            found = chosen(paths, rock, distance, in_force)
            away = np.where(clearance >= distance, np.abs(np.array(ORDERS) - in_force), np.inf)
            assert away[found.index] == away.min()
            assert found.clears
            assert found.order == ORDERS[found.index]
            np.testing.assert_allclose(found.distance, clearance[found.index], atol=1e-6)


def test_ties_go_to_the_wider_berth_then_to_the_first():
    """By hand: a rock to starboard ahead leaves more room to port; one dead ahead as much to either side."""
    paths = made(-0.02, -0.01, 0.0, 0.01, 0.02)
    assert chosen(paths, Point(330, 10), 20).index == 1
    assert chosen(paths, Point(330, -10), 20).index == 3
    assert chosen(paths, Point(-200, 0), 20).index == 2
    alike = made(0.01, 0.01, 0.01)
    assert chosen(alike, Point(330, -30), 20, orders=[0.1, -0.1, 0.1]).index == 0


def test_none_clears():
    """By hand: the best is the furthest off; where all touch, the last to touch."""
    paths = made(-0.002, 0.0, 0.002)
    found = chosen(paths, Point(300, 40), 100, orders=ORDERS[1:4])
    assert not found.clears
    assert found.index == 0
    wall = LineString([(300, -1e4), (200, 1e4)])  # nearer to starboard
    found = chosen(made(-0.005, 0.0, 0.005), wall, 10, orders=ORDERS[1:4])
    assert (found.clears, found.index, found.distance) == (False, 0, 0.0)


def test_deviation_of_plans():
    """By hand: the furthest order of a plan counts; None is the order in force."""
    found = [fans.deviation(p, 0.1) for p in (None, 0.3, [(0.0, 0.2), (40.0, -0.3)])]
    np.testing.assert_allclose(found, [0, 0.2, 0.4])


@pytest.mark.parametrize("abeam", [60.0, -60.0])
def test_soonest_past(abeam):
    """By hand: at u m/s north a buoy 300 m ahead is abaft the stern, 45 m behind midship, after 345 / u s."""
    paths = made(0.0, 0.0, 0.0, surge=np.array([4.0, 6.0, 3.0]))
    buoy = Point(300, abeam)
    np.testing.assert_allclose([fans.past(paths[k], HULL, buoy) for k in (0, 1)], [345 / 4, 345 / 6], rtol=1e-9)
    assert math.isnan(fans.past(paths[2], HULL, buoy))
    near, times = fans.approaches(paths, HULL, buoy), [fans.past(paths[k], HULL, buoy) for k in range(3)]
    found = fans.soonest_past(ORDERS[:3], near, times, 50.0, 0.0)
    assert (found.index, found.clears) == (1, True)
    np.testing.assert_allclose([found.time, found.distance], [57.5, 53.0])
    assert not fans.soonest_past(ORDERS[:3], near, times, 54.0, 0.0).clears
    assert fans.past(paths[0], HULL, Point(-50, 0)) == 0.0
    round_again = made(2 * math.pi / 80, steps=60)  # the buoy to port is astern after 20 s, ahead after 60 s
    assert math.isnan(fans.past(round_again[0], HULL, Point(10, -200)))


def test_soonest_across():
    """By hand: the stern crosses a line 200 m ahead after 245 / u s; a line along the track is never crossed."""
    paths = made(0.0, 0.0, 0.0, surge=np.array([4.0, 6.0, 1.0]))
    line = LineString([(200, -50), (200, 50)])
    found = fans.soonest_across(paths, ORDERS[:3], line, HULL, 0.0)
    assert (found.index, found.clears, found.distance) == (1, True, 0.0)
    np.testing.assert_allclose(found.time, 245 / 6)
    away = fans.soonest_across(paths, ORDERS[:3], LineString([(600, -50), (600, 50)]), HULL, 0.0)
    assert (away.index, away.clears) == (1, False)
    np.testing.assert_allclose(away.distance, 600 - 540 - 45)
    assert math.isnan(away.time)
    with pytest.raises(InputError, match="midship lies on it"):
        fans.soonest_across(paths, ORDERS[:3], LineString([(0, -50), (0, 50)]), HULL, 0.0)
    with pytest.raises(InputError, match="has 3 points"):
        fans.soonest_across(paths, ORDERS[:3], LineString([(9, -50), (9, 50), (9, 60)]), HULL, 0.0)


def test_text_of_fans():
    np.testing.assert_allclose(np.degrees(fans.parse_fan("-35:35:5")), np.arange(-35, 36, 5))
    np.testing.assert_allclose(np.degrees(fans.parse_fan("-1:1:0.1")), np.linspace(-1, 1, 21))
    np.testing.assert_allclose(np.degrees(fans.parse_fan("3:10:4")), [3, 7])
    for text, reason in (
        ("5", "is not FROM:TO:STEP"),
        ("a:b:c", "is not FROM:TO:STEP"),
        ("5:1:1", "FROM must not be above TO"),
        ("1:5:0", "STEP must be positive"),
        ("1:5:nan", "STEP must be positive"),
        ("-35:35:0.01", "is 7001 orders, at most 361"),
    ):
        with pytest.raises(InputError, match=reason):
            fans.parse_fan(text)


def test_text_of_obstacles(tmp_path):
    """Oracle: the UTM grid; a long line of one latitude follows its parallel, 87 m off the grid's straight line half way."""
    zone = Zone(33)
    point, distance = fans.parse_clear("69.65,18.96@120.5", zone)
    np.testing.assert_allclose([point.x, point.y], to_grid(*np.radians([69.65, 18.96]), zone))
    assert distance == 120.5
    file = tmp_path / "shoal@north.geojson"
    line = {"type": "LineString", "coordinates": [[18.0, 69.65, 3.0], [19.0, 69.65, 3.0]]}
    file.write_text(json.dumps({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": line}] * 2}))
    found, _ = fans.parse_clear(f"{file}@50", zone)
    half = Point(np.array(to_grid(*np.radians([69.65, 18.5]), zone)))
    assert found.distance(half) < 0.05
    ends = LineString(np.column_stack(to_grid(np.radians([69.65, 69.65]), np.radians([18.0, 19.0]), zone)))
    assert ends.distance(half) > 70


def test_wrong_obstacles_are_refused(tmp_path):
    bow_tie = {"type": "Polygon", "coordinates": [[[18, 69], [19, 70], [19, 69], [18, 70], [18, 69]]]}
    for name, text in (("bad", "{"), ("list", "[1]"), ("none", '{"type": "FeatureCollection", "features": []}')):
        (tmp_path / f"{name}.geojson").write_text(text)
    (tmp_path / "tie.geojson").write_text(json.dumps(bow_tie))
    (tmp_path / "null.geojson").write_text('{"type": "Feature", "geometry": null}')
    for text, reason in (
        ("69,18", "is not LAT,LON@METRES"),
        ("69,18@far", "is not LAT,LON@METRES"),
        ("69,18@-5", "is not LAT,LON@METRES"),
        ("118,69@5", "latitudes are within 90 deg"),
        ("nan,69@5", "latitudes are within 90 deg"),
        (f"{tmp_path}/absent.geojson@5", "is no LAT,LON and no such file"),
        (f"{tmp_path}/bad.geojson@5", "is no GeoJSON"),
        (f"{tmp_path}/list.geojson@5", "is no GeoJSON"),
        (f"{tmp_path}/null.geojson@5", "is no GeoJSON"),
        (f"{tmp_path}/none.geojson@5", "holds no geometry"),
        (f"{tmp_path}/tie.geojson@5", "a polygon that crosses itself"),
    ):
        with pytest.raises(InputError, match=reason):
            fans.parse_clear(text, Zone(33))
    with pytest.raises(InputError, match="positions of this log are local"):
        fans.parse_clear("69,18@5", None)


def notes_of(paths, orders, target, said):
    return fans.judged(paths, orders, now(), target, said.append)


def test_files_of_a_fan():
    """Oracle: shapely, pandas and json read back the paths, areas on the grid, and the chooser's answer."""
    paths, said = flagship().fan(now(), ORDERS), []
    rock = Point(paths.north[2, 60], paths.east[2, 60])
    notes, choice = notes_of(paths, ORDERS, (rock, 25.0), said)
    near = fans.approaches(paths, HULL, rock)
    bounds = [swept_region(paths[k], HULL).distance(rock) for k in range(len(ORDERS))]
    assert all(bound < hull.distance or bound == 0 for bound, hull in zip(bounds, near, strict=True))
    sure = [a._replace(distance=bound) for a, bound in zip(near, bounds, strict=True)]
    expected = fans.order_that_clears(ORDERS, sure, 25.0, fans.order_in_force(now()))
    assert choice["rudder_order_deg"] == round(math.degrees(expected.order), 6)
    assert choice["clears"] == expected.clears
    assert said == [
        f"rudder {choice['rudder_order_deg']:g} deg keeps {near[expected.index].distance:.1f} m off, "
        f"closest at {expected.time:.1f} s (its 95 % region: {expected.distance:.1f} m)"
    ]
    collection = json.loads(writers.fan_geojson(paths, notes, now(), "flagship", choice))
    assert collection["chosen"] == choice
    lines = [f for f in collection["features"] if f["geometry"]["type"] == "LineString"]
    assert [f["properties"]["rudder_order_deg"] for f in lines] == [-20, -10, 0, 10, 20]
    assert [f["properties"]["clears"] for f in lines] == [n["clears"] for n in notes]
    areas = [f for f in collection["features"] if f["properties"]["kind"] == "swept area"]
    for k, feature in enumerate(areas):
        area = shape(feature["geometry"])
        assert area.is_valid
        assert area.exterior.is_ccw
        placed = shapely.transform(area, lambda p: np.column_stack(to_grid(*np.radians(p[:, ::-1].T), now().zone)))
        assert placed.symmetric_difference(swept_area(paths[k], HULL)).area < 0.002 * placed.length
        assert feature["properties"]["clearance_m"] == notes[k]["clearance_m"]
    data = json.loads(writers.fan_json(paths, notes, now(), "flagship", choice, swept=True))
    table = pd.read_csv(io.StringIO(writers.fan_csv(paths, notes, now())))
    for k, entry in enumerate(data["fan"]):
        rows = table[table["rudder_order_deg"] == entry["rudder_order_deg"]]
        for found in (entry["path"], rows):
            np.testing.assert_allclose(found["north_m"], paths.north[k], atol=1e-2)
        assert (rows["clears"] == entry["clears"]).all()
        (polygon,) = entry["swept_area_m"]
        np.testing.assert_allclose(
            shapely.Polygon(polygon[0], polygon[1:]).area, swept_area(paths[k], HULL).area, rtol=1e-4
        )


def test_region_of_an_order_may_not_clear():
    """By hand: the hull of straight ahead clears a buoy abeam by more than asked, its region does not."""
    (path,) = (flagship().fan(now(), [0.0]),)
    hull, bound = (
        shapely.distance(area, Point(path.north[0, 30], path.east[0, 30] + 60.0))
        for area in (swept_area(path[0], HULL), swept_region(path[0], HULL))
    )
    buoy = Point(path.north[0, 30], path.east[0, 30] + 60.0)
    notes, choice = notes_of(path, [0.0], (buoy, (hull + bound) / 2), [])
    assert bound < hull
    assert (notes[0]["clears"], choice["clears"]) == (False, False)
    np.testing.assert_allclose([notes[0]["clearance_m"], notes[0]["region_clearance_m"]], [hull, bound], atol=0.02)
    bare = replace(path, spread=None)
    notes, _ = notes_of(bare, [0.0], (buoy, (hull + bound) / 2), [])
    assert notes[0]["clears"]
    assert "region_clearance_m" not in notes[0]


def test_soonest_of_those_that_clear_is_chosen():
    """Oracle: the least time past of all that clear, taken from the notes."""
    paths, said = flagship().fan(now(), ORDERS), []
    buoy = Point(paths.north[2, 20] + 150.0, paths.east[2, 20])
    notes, choice = fans.judged(paths, ORDERS, now(), (buoy, 10.0), said.append, soonest=True)
    times = [n["past_s"] for n in notes if n["clears"] and n["past_s"] is not None]
    assert times
    assert (choice["past_s"], choice["clears"]) == (min(times), True)
    assert said[0].endswith(f"past at {min(times):.1f} s")


def test_fan_without_a_target_has_orders_only():
    paths, said = flagship().fan(now(), ORDERS), []
    notes, choice = notes_of(paths, ORDERS, None, said)
    assert (choice, said) == (None, [])
    assert [list(note) for note in notes] == [["rudder_order_deg"]] * 5


def test_none_clears_is_said():
    paths, said = flagship().fan(now(), ORDERS[:2]), []
    _, choice = notes_of(paths, ORDERS[:2], (Point(paths.north[0, 5], paths.east[0, 5]), 500.0), said)
    assert not choice["clears"]
    assert said[0].startswith("no order of the fan clears 500 m; the best: rudder -")


def test_hole_of_a_circle_runs_clockwise():
    """RFC 7946 3.1.6: the ring of a full circle has its outer ring counter-clockwise and its hole clockwise, on the globe."""
    start = (now()["north_m"][-1], now()["east_m"][-1], 0.3)
    path = integrate(start, np.tile([6.0, -0.5, 0.08], (90, 1)), 1.0)
    found = json.loads(writers.to_geojson(path, now(), "circle", swept=True))
    (feature,) = (f for f in found["features"] if f["properties"]["kind"] == "swept area")
    outer, hole = feature["geometry"]["coordinates"]
    assert shapely.LinearRing(outer).is_ccw
    assert not shapely.LinearRing(hole).is_ccw
    latitude, longitude = to_geodetic(*start[:2], now().zone)
    assert shape(feature["geometry"]).covers(Point(math.degrees(longitude), math.degrees(latitude)))
