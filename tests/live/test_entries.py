"""Targets in the situation message against its page, and against places known by hand."""

import json
import math
import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from aspnn.frames import Zone, convergence, to_geodetic, to_grid
from aspnn.live.ahead import ANY
from aspnn.live.encounter import Limits, assess
from aspnn.live.entries import OUTLINED, target_entries
from aspnn.live.targets import Targets
from aspnn.logs.ais_messages import Report, Static
from aspnn.motion import integrate
from aspnn.vessel import load_vessel

ZONE, NOW = Zone.parse("33N"), 1_700_000_040.0
NORTH, EAST, MMSI = 7.72e6, 6.5e5, 257000001
GAMMA = math.degrees(float(convergence(*to_geodetic(NORTH, EAST, ZONE), ZONE)))


def seen(size=(80, 20, 8, 8), heading=180.0, **told):
    """The entries of one ship 600 m to the true north of own ship, on an opposite true course, reported 3 s ago."""
    c, s = math.cos(-math.radians(GAMMA)), math.sin(-math.radians(GAMMA))
    lat, lon = to_geodetic(NORTH + 600 * c, EAST + 600 * s, ZONE)
    said = {
        "mmsi": MMSI, "kind": 1, "latitude_deg": math.degrees(lat), "longitude_deg": math.degrees(lon), "speed_m_s": 5.0,
        "course_deg": 180.0, "heading_deg": heading, "yaw_rate_deg_s": 0.0, "second": 57.0, "measured": True, "accurate": True,
        "turning": False,
    }  # fmt: skip
    targets = Targets(ZONE)
    targets.hear(Static(MMSI, 5, "NORDLYS" if size else "", size, 5.0), NOW - 3)
    targets.hear(Report(**(said | told)), NOW - 3)
    vessel = load_vessel("cargo90")
    own = integrate((NORTH, EAST, -math.radians(GAMMA)), np.tile([5.0, 0.0, 0.0], (180, 1)), 0.5)
    dangers, paths = assess(own, vessel.outline(), targets.present(NOW), NOW, Limits())
    return target_entries(dangers, paths, NOW, ZONE), dangers, paths


def test_as_the_page_says():
    """The keys are those of SITUATION.md, in its order, and all of it is JSON of finite numbers."""
    page = (files("aspnn.live") / "page" / "SITUATION.md").read_text()
    part = page[page.index('"targets": [{') + 13 : page.index('"limits":')]
    keys = re.findall(r'"(\w+)":', re.sub(r"//.*|\{\"time[^}]*\}", "", part))
    (entry,), *_ = seen()
    assert list(entry) == keys
    json.dumps(entry, allow_nan=False)


def test_true_bearings_and_places():
    """By hand: 15 m nearer after 3 s, bearing, heading and course true, not of the grid (which is 2.8 degrees off here); places in the
    order longitude, latitude; 50 m from midship to the bow of the outline."""
    (entry,), (danger,), paths = seen()
    assert abs(GAMMA) > 2
    assert entry["bearing"] == pytest.approx(0.0, abs=0.02) or entry["bearing"] == pytest.approx(360.0, abs=0.02)
    assert entry["heading"] == pytest.approx(180.0, abs=0.02) and entry["cog"] == pytest.approx(180.0, abs=0.02)
    # The fix is the antenna's, 30 m abaft midship of a ship that heads south: midship is 30 m nearer too.
    assert entry["age"] == 3.0 and entry["range"] == pytest.approx(600 - 15 - 30, abs=0.5)
    assert (entry["id"], entry["name"], entry["kind"], entry["sog"], entry["rot"]) == (
        "257000001",
        "NORDLYS",
        "ais",
        5.0,
        0.0,
    )
    north, east = to_grid(*np.radians([entry["lat"], entry["lon"]]), ZONE)
    np.testing.assert_allclose([north, east], [paths.north[0, 0], paths.east[0, 0]], atol=0.08)  # 6 decimals
    ring = np.array(entry["outline"])
    assert ring[0].tolist() == ring[-1].tolist()
    bow = np.array(to_grid(*np.radians(ring[0][::-1]), ZONE))
    assert np.hypot(*(bow - [north, east])) == pytest.approx(50, abs=0.15)
    assert [o["time"] for o in entry["outlines"]] == [30, 60, 90] and entry["path"]["time"][-1] == 90
    assert len(entry["path"]["time"]) == len(entry["path"]["lat"]) == len(entry["path"]["lon"]) == 2
    far = np.radians([entry["path"]["lat"][-1], entry["path"]["lon"][-1]])
    np.testing.assert_allclose(to_grid(*far, ZONE), [paths.north[0, -1], paths.east[0, -1]], atol=0.1)
    assert entry["cpa"] == 0.0 and entry["dangerous"] and entry["probability"] is None
    contact = np.array(to_grid(*np.radians(entry["cpa_own"][::-1]), ZONE))
    np.testing.assert_allclose(contact, danger.cpa_own, atol=0.08)


def test_a_turning_ship_has_her_curve_and_far_ones_no_outlines():
    """By hand: 5 m/s at 6 deg/min are 4.5 deg in 45 s: 9 m from the chord, every 10 s is told; of ships that are not dangerous the hull is
    there as it is now, and never one more than OUTLINED have theirs ahead."""
    (entry,), (danger,), paths = seen(yaw_rate_deg_s=0.1)
    assert entry["path"]["time"] == list(np.arange(0.0, 91.0, 10.0)) and len(entry["path"]["lat"]) == 10
    (calm,) = target_entries([replace(danger, dangerous=False)], paths, NOW, ZONE)
    assert calm["outlines"] == [] and calm["outline"] == entry["outline"]
    crowd = target_entries([danger] * (OUTLINED + 3), paths, NOW, ZONE)
    assert [len(e["outlines"]) for e in crowd] == [3] * OUTLINED + [0] * 3


def test_what_is_not_known_is_null():
    """By hand: no size, no outline; no heading or rate told, none written."""
    (entry,), *_ = seen(size=None, heading=math.nan, yaw_rate_deg_s=math.nan)
    assert entry["outline"] is None and entry["outlines"] == [] and entry["name"] is None
    assert entry["heading"] is None and entry["rot"] is None and entry["cog"] is not None
    (entry,), (danger,), paths = seen()
    unknown = replace(danger, target=replace(danger.target, heading_sd=ANY, surge=0.0, sway=0.0))
    (entry,) = target_entries([unknown], paths, NOW, ZONE)
    assert entry["outline"] is None and entry["cog"] is None and entry["sog"] == 0.0
    assert target_entries([], paths, NOW, ZONE) == []
