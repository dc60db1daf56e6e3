"""The whole core on a simulated bridge, without clocks and sockets: from sentences to situations."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from aspnn.frames import to_geodetic
from aspnn.live import lookout
from aspnn.live.chart import parse_chart
from aspnn.live.core import Core
from aspnn.live.intake import Ais, Row
from aspnn.live.record import Recorder
from aspnn.live.start import settings_of
from aspnn.live.whatif import WhatIf
from aspnn.logs.ais_messages import Report, Static
from aspnn.records import read_log
from aspnn.schema import InputError
from tests.live.stand_in import Straight
from tests.live.test_bridge import BEGAN, bridge

SENSORS = {"position_m": 0.2, "speed_log_hz": 1.0}
OWN = 257000099


def sail(core, first, last, every=1.0, lines=None, keep=lambda time, line: True):
    """Run from `first` to `last` [s after BEGAN] on recorded `lines`, else steering; the situations, one each `every` seconds."""
    found = []
    for k in range(round(first / every) + 1, round(last / every) + 1):
        now = BEGAN + k * every
        said = core.simulated.advance(now) if lines is None else [x for x in lines if now - every < x[0] - 1e-6 <= now]
        for time, line in said:
            if keep(time - BEGAN, line):
                core.feed(line, time, "bridge")
        core.take(now)
        found.append(core.look(now))
        json.dumps(found[-1], allow_nan=False)
    return found


@pytest.fixture(scope="module")
def steady():
    """What a bridge that runs straight on, with three other ships and one at anchor about her, says in a minute."""
    return bridge(sensors=SENSORS).advance(BEGAN + 60.0)


def core_of(**more):
    b = bridge(sensors=SENSORS)
    return Core(settings_of(b), Straight(), simulated=b, **more)


def test_from_sentences_to_the_situation(tmp_path):
    """Law: within seconds own ship is where the simulated one is, others are there with their CPA, predictions that end are judged,
    and the record holds a row for each step; the rudder that the page orders is in the next message, and the predictions that could
    not know it are set apart."""
    core = core_of()
    core.recorder = Recorder(tmp_path, core.bridge.vessel, core.bridge.zone, 1.0)
    messages = sail(core, 0, 40, 1.25)
    last = messages[-1]
    assert last["own"]["sog"] == pytest.approx(10 * 1852 / 3600, abs=0.3)
    assert last["own"]["stw"] == pytest.approx(last["own"]["surge"], abs=0.3)
    assert last["time"] == pytest.approx(BEGAN + 40, abs=0.2)
    assert last["scores"]["count"][0] >= 4 and last["scores"]["arc"]["median"][0] < 5
    assert last["scores"]["set_apart"] == [0, 0, 0]
    assert len(last["targets"]) == 4 and all(t["cpa"] is not None for t in last["targets"])
    assert [a for a in last["alarms"] if a["severity"] == "alarm"] == []
    assert core.order(10, None) == {"rudder": 10.0, "shaft": pytest.approx(core.simulated.shaft, abs=1e-3)}
    turned = sail(core, 40, 50, 1.25)[-1]
    assert turned["simulated"]["rudder_order"] == 10.0 and turned["own"]["rudder_order"] == 10.0
    assert turned["own"]["rot"] > 5
    assert turned["scores"]["set_apart"][0] >= 6 and turned["scores"]["count"][0] <= last["scores"]["count"][0] + 1
    core.recorder.close()
    time = read_log(next(tmp_path.glob("log-*.parquet"))).table["time_s"]
    np.testing.assert_allclose(np.diff(time), 0.1, atol=2e-3)
    assert len(time) >= 498


def test_gnss_lost_is_told_and_over(steady):
    """Law: while positions are missing own ship coasts, the picture lives and the alarm is there; a while after it is over."""
    core = core_of()
    found = sail(
        core, 0, 60, 2.0, steady, keep=lambda t, line: "AIVDM" not in line and not ("GGA" in line and 14 < t < 44)
    )
    codes = {round(m["time"] - BEGAN): {a["code"] for a in m["alarms"]} for m in found if m["time"]}
    assert "gnss_lost" in codes[36] and "coasting" in codes[36]
    assert not {"gnss_lost", "gnss_stale", "coasting"} & codes[60] and not {"gnss_lost", "coasting"} & codes[12]
    assert all(m["own"] is not None for m in found[2:])
    assert found[20]["own"]["sds"]["position"] > 3 * found[5]["own"]["sds"]["position"]


def test_killed_it_goes_on_where_it_was(tmp_path, steady):
    """Law: a new core on the saved state has own ship at its first row, and the states go on from those before."""
    first = core_of(saved=tmp_path / "state.npz")
    sail(first, 0, 20, 2.0, steady)
    second = Core(settings_of(first.simulated), Straight(), simulated=first.simulated, saved=tmp_path / "state.npz")
    assert second.look(BEGAN + 20.0)["own"] is not None
    message = sail(second, 20, 22, 1.0, steady)[-1]
    assert message["forecast"] is not None and message["track"]["time"][0] < BEGAN + 7
    assert message["time"] == pytest.approx(BEGAN + 22, abs=0.2)


def test_an_old_state_has_no_prediction(steady):
    """Law: when nothing is heard any more the last prediction goes after ten seconds, with the targets; the alarm stays."""
    core = core_of()
    sail(core, 0, 10, 2.0, steady)
    messages = sail(core, 10, 30, 4.0, [])
    assert messages[0]["forecast"] is not None and messages[0]["targets"]
    assert messages[-1]["forecast"] is None and messages[-1]["own"] is not None
    assert messages[-1]["targets"] == [] and messages[-1]["targets_time"] is None
    assert any(a["severity"] == "alarm" for a in messages[-1]["alarms"])


def test_what_is_dear_is_reckoned_once_a_second_and_says_when(steady):
    """Law: at 10 Hz path and arc are of every look; targets and swept region of one a second each, not of the same look, and what
    they say of their time is that of the look that made them. New limits and a new order are not waited for."""
    core = core_of()
    sail(core, 0, 10, 2.0, steady)
    found = sail(core, 10, 14, 0.1, steady)
    start = [m["forecast"]["start"] for m in found]
    assert len(set(start)) >= 39
    for key in (lambda m: m["targets_time"], lambda m: m["forecast"]["region_start"]):
        times = [key(m) for m in found]
        assert all(0 <= s - t < 1.0 + 1e-6 for s, t in zip(start, times, strict=True))
        assert 4 <= len(set(times)) <= 5 and set(times) <= {*start, times[0]}
    # The very first look made both.
    assert {m["targets_time"] for m in found} & {m["forecast"]["region_start"] for m in found} <= {BEGAN + 10.0}
    last, ages = found[-1], {t["id"]: t["age"] for t in found[-1]["targets"]}
    checked = 0
    for target in core.targets.present(last["time"]):
        heard = last["targets_time"] - target.time
        if heard > 1.0:  # a report tells its whole second: one of the last may have come after that look
            assert ages[target.id] == pytest.approx(heard, abs=0.06)
            checked += 1
    assert checked
    core.limit(1000.0, 60.0)
    sail(core, 14, 14.1, 0.1, steady)
    assert core.look(BEGAN + 14.1)["targets_time"] == core.look(BEGAN + 14.1)["forecast"]["start"]
    core.push([Row(core.estimator.time + 0.1, {"rudder_order_deg": 12.0})])
    message = core.look(BEGAN + 14.2)
    assert message["forecast"]["region_start"] == message["targets_time"] == message["forecast"]["start"]


def test_what_if_is_asked_of_the_newest_state(steady):
    """Law: before own ship is known a line says so; then the fan starts at her, each order with the nearest other ship, and the
    order in force is chosen where all clear alike."""
    core = core_of()
    asked = {"fan": {"from": -10, "to": 10, "step": 10}, "plan": [[0, 5], [30, -5]]}
    with pytest.raises(InputError, match="no own ship"):
        core.whatif(WhatIf.model_validate(asked))
    message = sail(core, 0, 5, 1.0, steady)[-1]
    far = {"lat": message["own"]["lat"] + 0.5, "lon": message["own"]["lon"], "distance": 100}
    answer = core.whatif(WhatIf.model_validate({**asked, "clear": far}))
    assert [p["rudder"] for p in answer["paths"]] == [-10, 0, 10, None]
    assert answer["paths"][3]["plan"] == [[0, 5], [30, -5]] and answer["paths"][3]["swept"]
    assert answer["choice"]["rudder"] == 0 and answer["choice"]["clears"]
    for path in answer["paths"]:
        assert path["lat"][0] == pytest.approx(message["own"]["lat"], abs=1e-6)
        assert path["target"]["id"] in {t["id"] for t in message["targets"]}
        assert path["point"]["distance"] == pytest.approx(55_300, rel=0.02)
    for wrong, said in (
        ({"fan": {"from": 0, "to": 35, "step": 0.1}}, "at most"),
        ({"plan": [[0, 60]]}, "stops"),
        ({}, "give a plan"),
    ):
        with pytest.raises(InputError, match=said):
            core.whatif(WhatIf.model_validate(wrong))


def test_limits_move_what_is_dangerous(steady):
    """Law: with limits of nothing nobody is dangerous, with a mile and an hour somebody ahead is, and has an alarm."""
    core = core_of()
    sail(core, 0, 15, 3.0, steady)
    core.limit(0.0, 0.0)
    assert not any(t["dangerous"] for t in core.look(BEGAN + 15)["targets"])
    core.limit(1852.0, 3600.0)
    message = core.look(BEGAN + 15)
    told = {a["code"].removeprefix("danger_") for a in message["alarms"]}
    assert [t for t in message["targets"] if t["dangerous"]]
    assert all(t["id"] in told for t in message["targets"] if t["dangerous"])
    with pytest.raises(InputError):
        core.limit(math.nan, 10.0)


def test_own_ship_is_no_target(steady):
    """Law: own MMSI, of the settings or as the own transponder says it, is in the message, and what others relay of it is no target."""
    core = core_of()
    assert core.look(BEGAN)["own"] is None
    sail(core, 0, 4, 2.0, steady)
    place = core.look(BEGAN + 4)["own"]
    report = Report(OWN, 1, place["lat"], place["lon"], 5.0, 40.0, 40.0, 0.0, (BEGAN + 4) % 60, True, True, False)

    def hear(own, said, time):
        core.intake.targets_in.append(Ais(time, own, said, "bridge"))
        core.take(time)

    hear(False, report, BEGAN + 4)
    core.limit(501.0, 600.0)
    assert str(OWN) in {t["id"] for t in core.look(BEGAN + 4)["targets"]}  # nobody knows yet
    hear(True, Static(OWN, 5, "", None, 0.0), BEGAN + 4)
    hear(False, report._replace(second=(BEGAN + 5) % 60), BEGAN + 5)
    core.limit(502.0, 600.0)
    message = core.look(BEGAN + 5)
    assert message["own"]["mmsi"] == OWN and str(OWN) not in {t["id"] for t in message["targets"]}
    settings = core.bridge
    ship = settings.config.ship.model_copy(update={"mmsi": OWN})
    named = replace(settings, config=settings.config.model_copy(update={"ship": ship}))
    assert Core(named, Straight()).targets.own == OWN


def test_a_dangerous_target_that_is_lost_is_told_for_a_minute(steady):
    """By hand: at 8 m/s a ship reports every 6 s and is lost after five of these. The one that meets own ship is a warning then, for a
    minute, or until she is heard again; the one that is far off goes in silence."""
    core = core_of()

    def quiet(time, line):
        return "AIVDM" not in line

    sail(core, 0, 6, 2.0, steady, keep=quiet)
    path, zone = core.forecast.path, core.bridge.zone
    ahead = np.exp(1j * path.heading[0])

    def hear(mmsi, off, now):
        lat, lon = (float(np.degrees(x)) for x in to_geodetic(path.north[0] + off.real, path.east[0] + off.imag, zone))
        core.targets.hear(Report(mmsi, 1, lat, lon, 8.0, 220.0, 220.0, 0.0, now % 60, True, True, False), now)

    hear(257000021, 1500 * ahead, BEGAN + 6)
    hear(257000022, 1500 * ahead + 9000j * ahead, BEGAN + 6)
    found = sail(core, 6, 48, 2.0, steady, keep=quiet)
    lost = [any(a["code"] == "target_lost_257000021" for a in m["alarms"]) for m in found]
    there = [{t["id"] for t in m["targets"]} for m in found]
    first = lost.index(True)
    assert there[0] == {"257000021", "257000022"} and there[first] == set()
    assert 6 + 2 * (first + 1) == pytest.approx(6 + 30, abs=2.1) and all(lost[first:])
    assert not any("257000022" in a["code"] for m in found for a in m["alarms"])
    clock = BEGAN + 6 + 2 * (first + 1)
    kept = dict(core._lost)
    for later, told in ((lookout.TOLD - 0.5, True), (lookout.TOLD + 0.5, False)):
        core._lose(clock + later)
        assert bool(core._lost) is told
    core._lost = kept
    hear(257000021, 900 * ahead, BEGAN + 48)
    assert not any("lost" in a["code"] for a in sail(core, 48, 50, 2.0, steady, keep=quiet)[-1]["alarms"])


def test_ground_ahead_is_an_alarm(steady):
    """By hand: she heads 40 degrees at 10 knots; land across her course 250 m ahead of midship is 205 m ahead of her bow: 40 s."""
    core = core_of()
    own = sail(core, 0, 6, 2.0, steady)[-1]["own"]
    forecast = core.forecast
    ahead, aside = np.exp(1j * forecast.path.heading[0]), 1j * np.exp(1j * forecast.path.heading[0])
    corners = [250 * ahead - 50 * aside, 250 * ahead + 50 * aside, 260 * ahead + 50 * aside, 260 * ahead - 50 * aside]
    place = np.array(corners) + forecast.path.north[0] + 1j * forecast.path.east[0]
    ring = np.degrees(np.column_stack(to_geodetic(place.real, place.imag, core.bridge.zone)[::-1])).tolist()
    land = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    chart = {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "properties": {"kind": "land"}, "geometry": land}],
    }
    core.forecaster.chart = parse_chart(json.dumps(chart), core.bridge.zone)
    message = sail(core, 6, 7, 1.0, steady)[-1]
    (alarm,) = [a for a in message["alarms"] if a["code"] == "grounding"]
    assert alarm["severity"] == "alarm" and message["alarms"][0] == alarm
    seconds = int(alarm["text"].removeprefix("predicted ship touches land in ").removesuffix(" s"))
    assert seconds == pytest.approx(205 / own["sog"] - 1, abs=2.5)
    assert message["forecast"]["clearance"]["distance"] == 0
