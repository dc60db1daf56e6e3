"""The live forecast: paths, areas, clearances and scores of made-up states, whose future is known."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from aspnn.frames import to_geodetic
from aspnn.live.chart import parse_chart
from aspnn.live.forecast import Forecaster
from aspnn.schema import InputError
from aspnn.vessel import load_vessel
from tests.live.stand_in import EAST, NORTH, ZONE, Straight, turning


def test_arc_of_a_steady_turn_is_the_truth_and_ours_errs_by_what_it_was_moved():
    """Oracle: analytic. A steady turn goes on along its circle, which is the arc; a straight path from the same place, 7 m aside,
    is off by the chord's law: |R sin(r t) - u t, R (1 - cos(r t)) - 7| with R = u / r."""
    states = turning(160.0, rate=0.01)
    f = Forecaster(Straight(aside=7.0), states.vessel)
    f.keep(f.predict(states.until(30.0)))
    ended = f.verify(states)
    assert [e.horizon for e in ended] == [30.0, 60.0, 90.0]
    heading = 0.01 * 30.0
    for one in ended:
        t, radius = one.horizon, 6.0 / 0.01
        chord = (radius * (math.sin(0.01 * t)) + 1j * radius * (1 - math.cos(0.01 * t))) * np.exp(1j * heading)
        straight = 6.0 * t * np.exp(1j * heading) + 7j
        assert one.arc == pytest.approx(0.0, abs=1e-3)
        assert one.ours == pytest.approx(abs(straight - chord), abs=1e-3)
        assert one.inside == (abs(straight - chord) <= 5.0 * math.sqrt(5.991))
    scores = f.scores()
    assert scores.count.tolist() == [1, 1, 1]
    np.testing.assert_allclose(scores.ours_median, [e.ours for e in ended])
    assert f.pending == 0


def test_region_holds_a_truth_inside_and_not_one_outside():
    """Oracle: the 95 % disc of a round Gaussian has the radius 2.4477 sd: 12 m off is inside it at 5 m, 12.5 m is not."""
    states = turning(130.0)
    for aside, inside in ((12.0, True), (12.5, False)):
        f = Forecaster(Straight(aside=aside), states.vessel)
        f.keep(f.predict(states.until(20.0)))
        assert {e.inside for e in f.verify(states)} == {inside}


def test_a_prediction_is_judged_when_it_ends_and_once():
    """Law: nothing is judged before its end, each horizon once; what is kept is bounded by the horizon, one a second."""
    states = turning(60.0)
    f, count = Forecaster(Straight(horizon=30.0), states.vessel), 0
    for time in np.arange(10.0, 60.0, 0.5):
        known = states.until(float(time))
        f.keep(f.predict(known))
        ended = f.verify(known)
        assert all(e.start + e.horizon <= time + 1e-6 for e in ended)
        count += len(ended)
        assert f.pending <= 32
    assert count == f.scores().count.sum() == sum(60 - 10 - h for h in (10, 20, 30))


def test_predictions_whose_order_was_changed_are_set_apart():
    """By hand: the order moves by 2 deg at 50 s and was steady but for 0.5 deg before: of a prediction of 20 s the one to 80 and 110 s are
    not held, the one to 50 s is, to the state at its end; of one of 51 s all are. Medians and counts are of those that were held."""
    states = turning(150.0)
    states.table.loc[states.table["time_s"] > 40, "rudder_order_rad"] += math.radians(0.5)
    states.table.loc[states.table["time_s"] > 50.05, "rudder_order_rad"] += math.radians(2.0)
    f = Forecaster(Straight(aside=3.0), states.vessel)
    for start in (20.0, 51.0):
        f.keep(f.predict(states.until(start)))
    ended = f.verify(states)
    assert {(round(e.start, 6), e.horizon): e.held for e in ended} == {
        (20.0, 30.0): True, (20.0, 60.0): False, (20.0, 90.0): False,
        (51.0, 30.0): True, (51.0, 60.0): True, (51.0, 90.0): True,
    }  # fmt: skip
    scores = f.scores()
    assert scores.count.tolist() == [2, 1, 1] and scores.set_apart.tolist() == [0, 1, 1]
    np.testing.assert_allclose(scores.ours_median, 3.0, atol=1e-6)


def test_nothing_is_judged_across_a_gap_or_while_coasting():
    """Law: a truth that the filter does not know is none; the prediction that ends there is dropped, later ones are not."""
    states = turning(130.0)
    states.table.loc[(states.table["time_s"] > 49) & (states.table["time_s"] < 51), "coasting"] = True
    gap = (states.table["time_s"] > 78) & (states.table["time_s"] < 82)
    states = replace(states, table=states.table[~gap])
    f = Forecaster(Straight(), states.vessel)
    f.keep(f.predict(states.until(20.0)))
    assert [e.horizon for e in f.verify(states)] == [90.0]


def test_without_predictor_or_history_the_arc_is_there():
    """Law: what a predictor refuses is said in a line, and the arc stands."""

    class Refuses(Straight):
        def predict(self, states, rudder_plan=None, shaft_plan=None):
            raise InputError("too little history")

    states = turning(30.0, rate=0.01)
    bare, refused = (Forecaster(p, states.vessel).predict(states) for p in (None, Refuses()))
    assert bare.path is None and bare.refused == ""
    assert refused.path is None and refused.refused == "too little history"
    np.testing.assert_array_equal(bare.arc.north, refused.arc.north)
    assert bare.arc.time[-1] == 90.0
    with pytest.raises(InputError, match="no predictor"):
        Forecaster(None, states.vessel).fan(states, [0.1])


def chart_of(*features):
    made = [
        {"type": "Feature", "properties": {"kind": kind}, "geometry": shapely.geometry.mapping(g)}
        for kind, g in features
    ]
    return json.dumps({"type": "FeatureCollection", "features": made})


def point(north, east):
    latitude, longitude = (float(np.degrees(x)) for x in to_geodetic(north, east, ZONE))
    return shapely.Point(longitude, latitude)


def test_clearance_is_to_the_hull_and_to_hard_features_only():
    """Oracle: geometry. She runs north at 6 m/s, 7 m of half beam: a buoy 57 m to the east of the track is 50 m off the hull when
    her parallel side (30 % of the length before midship to 42 % abaft it) is beside it; a depth contour nearer by does not count."""
    states = turning(30.0)
    start = states["north_m"][-1]
    chart = parse_chart(
        chart_of(("buoy", point(start + 300, EAST + 57)), ("depth", point(start + 100, EAST + 20))), ZONE
    )
    found = Forecaster(Straight(), states.vessel, chart=chart).predict(states).clearance
    assert found is not None and found.what == "buoy"
    assert found.distance == pytest.approx(50.0, abs=0.3)  # the swept area's tolerance
    assert Forecaster(Straight(), states.vessel, chart=chart).predict(states).touches == ()
    assert (300 - 27.5) / 6 - 2 <= found.time <= (300 + 37.8) / 6 + 2
    np.testing.assert_allclose(found.place, [start + 300, EAST + 57], atol=0.01)


def test_what_she_touches_and_when():
    """By hand: she runs north at 6 m/s with her bow 45 m ahead. A berth 165 m ahead is touched after 20 s, land 405 m ahead after 60 s; the
    area of 5 m, too shallow for her 5.6 m, after 40 s; the 10 m contour is the safety contour, at 10 s, but not the 20 m one. Pieces are
    2 s long."""
    states = turning(30.0)
    start, draught = states["north_m"][-1], states.vessel.draught
    assert 5 < draught < 10

    def bar(ahead):
        return shapely.Polygon(
            [point(start + ahead + n, EAST + e).coords[0] for n, e in ((0, -9), (0, 9), (9, 9), (9, -9))]
        )

    def touched(*features):
        text = json.loads(chart_of(*((kind, g) for kind, g, _ in features)))
        for feature, (_, _, depth) in zip(text["features"], features, strict=True):
            feature["properties"]["depth"] = depth
        f = Forecaster(Straight(), states.vessel, chart=parse_chart(json.dumps(text), ZONE))
        return [(t.what, t.aground, t.time) for t in f.predict(states).touches]

    berth, land = ("berth", bar(165), None), ("land", bar(405), None)
    close = pytest.approx
    assert touched(berth, land) == [("land", True, close(59, abs=1.1)), ("berth", False, close(19, abs=1.1))]
    depths = [("depth", bar(285), 5), ("depth", bar(105), 10), ("depth", bar(50), 20)]
    assert touched(land, *depths) == [
        ("5 m depth contour", True, close(39, abs=1.1)),
        ("10 m depth contour", False, close(9, abs=1.1)),
    ]
    assert touched(("land", bar(700), None)) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no GeoJSON"),
        ('{"type": "Topology"}', "is no GeoJSON"),
        ("[" * 5000, "is no GeoJSON"),
        (chart_of(("land", shapely.Point(7e6, 3e5))), "feature 1 has no longitude"),
        (chart_of(("land", shapely.Polygon([(18, 69), (19, 70), (19, 69), (18, 70)]))), "crosses itself"),
    ],
)
def test_a_chart_that_is_none_is_refused_in_one_line(text, said):
    """Law: every text that is no chart is an InputError of one line that names the file."""
    with pytest.raises(InputError, match=said) as error:
        parse_chart(text, ZONE, "my.geojson")
    assert "\n" not in str(error.value) and str(error.value).startswith("my.geojson")


def test_the_swept_region_of_before_is_taken_over_and_says_so():
    """Law: with a forecast of before the region is that one's, with its start; all else is of now."""
    states = turning(31.0)
    f = Forecaster(Straight(), states.vessel)
    first = f.predict(states.until(30.0))
    second = f.predict(states, before=first)
    assert first.region_start == first.start == second.region_start and second.region_swept is first.region_swept
    assert second.start == pytest.approx(31.0) and not second.swept.equals(first.swept)
    assert f.predict(states).region_start == second.start


def test_swept_region_holds_the_swept_area():
    """Law: where the hull may be holds where it is predicted to be; with a coarser boundary, within its tolerance."""
    states = turning(30.0)
    found = Forecaster(Straight(), load_vessel("cargo90")).predict(states)
    assert found.region_swept.buffer(0.01).contains(found.swept)
    assert shapely.get_coordinates(found.swept)[:, 0].max() > NORTH
