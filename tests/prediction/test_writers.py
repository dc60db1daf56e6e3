"""Paths for other programs: read back by standard readers and compared with the path."""

import io
import json

import numpy as np
import pandas as pd
import pytest
from shapely.geometry import shape

from aspnn.frames import Zone, to_grid
from aspnn.motion import integrate
from aspnn.prediction import writers
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import load_vessel
from tests.evaluation.conftest import table_of

TIME = np.arange(0, 10.1, 0.5)
PATH = integrate((7.72e6, 6.5e5, 6.2), np.tile([6.0, -0.5, 0.01], (90, 1)), 1.0)


def states(zone=Zone(33)) -> States:  # noqa: B008
    return States(table_of(TIME, 0 * TIME), load_vessel("cargo90"), zone=zone, voyage="v")


def test_json_and_csv_hold_the_path():
    """Oracle: json and pandas read back the columns; headings stand in [0, 360)."""
    data = json.loads(writers.to_json(PATH, states(), "flagship"))
    table = pd.read_csv(io.StringIO(writers.to_csv(PATH, states())))
    assert (data["predictor"], data["vessel"], data["at_s"], data["zone"]) == ("flagship", "cargo90", 10.0, "33N")
    for found in (data["path"], table):
        np.testing.assert_allclose(found["north_m"], PATH.north, atol=1e-3)
        np.testing.assert_allclose(found["sway_bow_m_s"], PATH.sway_at(35.0), atol=1e-9)
        np.testing.assert_allclose(found["pivot_point_m"], 50.0, rtol=1e-9)
        np.testing.assert_allclose(found["pivot_region"], 4.0)
        heading = np.asarray(found["heading_grid_deg"])
        assert ((heading >= 0) & (heading < 360)).all()
        np.testing.assert_allclose(np.exp(1j * np.radians(heading)), np.exp(1j * PATH.heading), atol=1e-8)


def test_undefined_pivot_is_null():
    """RFC 8259 knows no NaN: a path that does not turn has null pivot points."""
    straight = integrate((7.72e6, 6.5e5, 0.0), np.tile([6.0, 0.0, 0.0], (10, 1)), 1.0)
    text = writers.to_json(straight, states(), "x")
    assert "NaN" not in text
    assert set(json.loads(text)["path"]["pivot_point_m"]) == {None}
    assert pd.read_csv(io.StringIO(writers.to_csv(straight, states())))["pivot_point_m"].isna().all()


def test_geojson_is_where_the_hull_is():
    """Oracle: shapely reads the polygons, valid and counter-clockwise; the UTM grid gives back place and area."""
    found = json.loads(writers.to_geojson(PATH, states(), "flagship"))
    line, *hulls = found["features"]
    longitude, latitude = np.radians(np.array(line["geometry"]["coordinates"]).T)
    north, east = to_grid(latitude, longitude, Zone(33))
    np.testing.assert_allclose([north, east], [PATH.north, PATH.east], atol=2e-3)
    assert [hull["properties"]["time_s"] for hull in hulls] == [0, 15, 30, 45, 60, 75, 90]
    for hull in hulls:
        polygon = shape(hull["geometry"])
        assert polygon.is_valid
        assert polygon.exterior.is_ccw


def test_local_positions_have_no_geojson():
    with pytest.raises(InputError, match="positions are local"):
        writers.to_geojson(PATH, states(None), "x")
