"""Paths for other programs: read back by standard readers and compared with the path."""

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from shapely.geometry import shape

from aspnn.frames import Zone, to_grid
from aspnn.motion import Spread, integrate
from aspnn.motion.spread import disc, strip
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


def spread_path(sd_north: float, sd_east: float, heading: float):
    """PATH with Gaussian regions of these standard deviations [m, rad], the same at every step."""
    shape = PATH.north.shape
    levels = np.array([0.5, 0.95, 0.99])
    spread = Spread(
        np.broadcast_to(np.diag([sd_north**2, sd_east**2, heading**2]), (*shape, 3, 3)),
        *(np.array(False), levels),
        *(np.broadcast_to([f(p) for p in levels], (*shape, 3)) for f in (disc, strip)),
        *(np.array(1.25), 1.8),
    )
    return replace(PATH, convergence=np.asarray(0.02), spread=spread)


def test_regions_are_written():
    """By hand: a Gaussian's 95 % ellipse has half axes 2.448 sd, its major one here to grid east, so 90 deg and the convergence true."""
    path = spread_path(1.0, 3.0, 0.01)
    found = json.loads(writers.to_json(path, states(), "flagship"))
    assert [found[name] for name in ("outside_training", "misfit", "fits")] == [False, 1.25, True]
    for misfit, said in ((1.9, [1.9, False]), (np.nan, [None, None])):
        other = replace(path, spread=replace(path.spread, misfit=np.array(misfit)))
        data = json.loads(writers.to_geojson(other, states(), "flagship"))["features"][0]["properties"]
        assert [data[name] for name in ("misfit", "fits")] == said
    expected = {
        "region_95_major_m": 3 * 2.4477,
        "region_95_minor_m": 2.4477,
        "heading_95_deg": 0.01 * 1.95996 * 57.29578,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(found["path"][name], value, rtol=1e-4)
    turned = np.degrees(path.true_heading - path.heading)
    np.testing.assert_allclose(found["path"]["region_95_azimuth_true_deg"], 90 + turned, atol=1e-6)
    places = json.loads(writers.to_geojson(path, states(), "flagship"))["features"]
    regions = [f for f in places if f["properties"]["kind"] == "region"]
    assert [f["properties"]["time_s"] for f in regions] == [15, 30, 45, 60, 75, 90]
    for feature in regions:
        longitude, latitude = np.radians(np.array(feature["geometry"]["coordinates"][0]).T)
        ring = np.array(to_grid(latitude, longitude, Zone(33))).T
        k = int(feature["properties"]["time_s"])
        far = np.hypot((ring[:, 0] - path.north[k]) / 2.4477, (ring[:, 1] - path.east[k]) / (3 * 2.4477))
        np.testing.assert_allclose(far, 1.0, atol=2e-3)
    assert "region_95_major_m" not in json.loads(writers.to_json(PATH, states(), "flagship"))["path"]


def test_what_must_be_told_is_told():
    """By hand: each fault of a spread has its line, and a faultless one none."""
    fine = spread_path(1.0, 3.0, 0.01)
    assert writers.warnings(fine, "x") == writers.warnings(PATH, "x") == []
    for changed, said in (
        ({"outside": np.array(True)}, "was not trained for this start"),
        ({"misfit": np.array(9.0)}, "does not fit this ship today"),
        ({"position": np.full_like(fine.spread.position, np.nan)}, "no regions for them"),
    ):
        (line,) = writers.warnings(replace(fine, spread=replace(fine.spread, **changed)), "x")
        assert said in line


def test_local_positions_have_no_geojson():
    with pytest.raises(InputError, match="positions are local"):
        writers.to_geojson(PATH, states(None), "x")
