"""The message: what it must hold by page/SITUATION.md, and that no number of it is none."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import aspnn.live
from aspnn.frames import to_geodetic, to_grid
from aspnn.live.forecast import Forecaster
from aspnn.live.situation import Picture, geojson, situation
from aspnn.records import finite
from tests.live.stand_in import ZONE, Straight, turning

PAGE = Path(aspnn.live.__file__).parent / "page" / "SITUATION.md"


def picture(states, predictor, **more):
    f = Forecaster(predictor, states.vessel)
    forecast = f.predict(states)
    name = None if predictor is None else predictor.name
    return Picture(states.vessel, ZONE, 1.7e9, states, forecast, f.scores(), model=name, antennas=["bow"], **more)


def numbers(value):
    if isinstance(value, dict):
        for one in value.values():
            yield from numbers(one)
    elif isinstance(value, list):
        for one in value:
            yield from numbers(one)
    else:
        assert value is None or type(value) in (str, bool, int, float)
        if isinstance(value, float):
            yield value


@pytest.mark.parametrize("predictor", [Straight(), None])
def test_message_has_the_keys_of_its_description_and_finite_numbers(predictor):
    """Oracle: the description that the page holds to; every top-level key of it and of `own` is there, in a message of plain JSON."""
    states = turning(60.0, sway=0.2, rate=0.005)
    message = situation(picture(states, predictor))
    block = PAGE.read_text().split("```")[1]
    assert set(message) == set(re.findall(r'^ "(\w+)":', block, re.M))
    own = block[block.index('"own"') : block.index('"track"')]
    assert set(re.findall(r'"(\w+)":', own)) - {"own", "x", "y", "used", "position"} <= set(message["own"]) | {"sds"}
    assert json.loads(json.dumps(message, allow_nan=False)) == message
    assert all(math.isfinite(v) for v in numbers(message))


def test_an_empty_picture_is_a_message():
    """Law: before the first state all is null or empty, and the message is whole."""
    states = turning(1.0)
    message = situation(Picture(states.vessel, ZONE))
    assert message["own"] is message["track"] is message["forecast"] is message["time"] is None
    json.dumps(message, allow_nan=False)


def test_unknown_values_are_null():
    """Law: NaN in the states is null in the message, never NaN and never left out."""
    states = turning(60.0)
    states.table["rudder_order_rad"] = np.nan
    states.table["shaft_speed_rps"] = np.nan
    own = situation(picture(states, Straight()))["own"]
    assert own["rudder_order"] is None and own["shaft"] is None and own["pivot"] is None
    assert own["rudder_angle"] == pytest.approx(math.degrees(0.09), abs=0.01)


def test_places_come_back_to_the_grid():
    """Oracle: the projection turned round. 7 decimals of a degree are 11 mm at most, and half of that is rounding."""
    states = turning(60.0, rate=0.01)
    p = picture(states, Straight())
    message = situation(p)
    line = message["forecast"]
    north, east = to_grid(np.radians(line["lat"]), np.radians(line["lon"]), ZONE)
    np.testing.assert_allclose(north, p.forecast.path.north, atol=0.02)
    np.testing.assert_allclose(east, p.forecast.path.east, atol=0.02)
    assert message["own"]["heading"] == pytest.approx(math.degrees(0.6 + 0.01), abs=0.01)
    assert message["own"]["rot"] == pytest.approx(math.degrees(0.01) * 60, abs=0.01)
    bow = states.vessel.sway_stations[0]
    assert message["own"]["sway_bow"] == pytest.approx(0.01 * bow, abs=1e-3)
    assert [mark["time"] for mark in line["outlines"]] == list(np.arange(10.0, 91.0, 10.0))
    for ring in [*line["swept"], *line["region_swept"], *(m["ring"] for m in line["outlines"] + line["regions"])]:
        assert ring[0] == ring[-1] and len(ring) > 3


def test_track_is_bounded_and_stays_where_it_is():
    """Law: at most 300 rows, 2 to 10 s apart, none after the time; rows of one message are there in the next, but for the oldest."""
    states = turning(1500.0, step=0.5)
    first, second = (situation(picture(states.until(t), None))["track"]["time"] for t in (1400.0, 1401.0))
    assert len(first) <= 300 and first[-1] <= 1.7e9 + 1400.0
    assert all(2 <= step <= 10 for step in np.diff(first))
    assert set(first[1:]) <= set(second) | {first[0]}


def test_finite_takes_what_json_does_and_refuses_the_rest():
    """Law: numpy and tuples become plain, what is not finite becomes None, anything else is an error."""
    assert finite({"a": (np.float64(1.5), np.nan, np.inf), "b": np.arange(2)}) == {"a": [1.5, None, None], "b": [0, 1]}
    with pytest.raises(TypeError):
        finite({"a": object()})


def test_geojson_is_of_the_message():
    """Law (RFC 7946): longitude first, closed rings; the predicted path is that of the message."""
    states = turning(60.0)
    message = situation(picture(states, Straight()))
    features = geojson(message)["features"]
    path = next(f for f in features if f["properties"]["kind"] == "predicted path")
    assert path["geometry"]["coordinates"][0] == [message["forecast"]["lon"][0], message["forecast"]["lat"][0]]
    latitude = math.degrees(float(to_geodetic(states["north_m"][-1], states["east_m"][-1], ZONE)[0]))
    assert features[0]["geometry"]["coordinates"][1] == pytest.approx(latitude, abs=1e-6)
    for feature in features:
        if feature["geometry"]["type"] == "Polygon":
            ring = feature["geometry"]["coordinates"][0]
            assert ring[0] == ring[-1]
