"""Alarms: each from a state made by hand, with the time at which it begins; and that a healthy ship has none."""

import math
from dataclasses import replace

import pytest

from aspnn.live.alarms import (
    Alarm,
    Failure,
    ForecastState,
    Severity,
    in_order,
    of_estimator,
    of_failures,
    of_forecast,
    of_intake,
)
from aspnn.live.clocks import Event
from aspnn.live.estimator import EstimatorState
from aspnn.live.heard import IntakeState
from aspnn.live.receivers import Disagreement

TOLD = {"bow_latitude_deg": 99.9, "stern_latitude_deg": 99.8, "heading_deg": 99.9}
WELL = IntakeState(0.0, {"lan": 99.9}, TOLD, {"lan": {"sentences": 1000, "good": 990, "checksum": 10}}, {}, None)
STATE = EstimatorState(
    99.9, {"north_m_sd": 3.0, "east_m_sd": 4.0, "coasting": 0.0}, None, {"bow": 1.1, "heading": 0.9}, ""
)


def intake(now=100.0, channels=("lan",), **changed):
    return {a.code: a for a in of_intake(replace(WELL, **changed), ("bow", "stern"), channels, now)}


def test_a_healthy_ship_has_no_alarm():
    """Law: nothing is told when all is well."""
    assert not intake() and not of_estimator(STATE, 100.0) and not of_forecast(ForecastState(fits=True), 100.0)
    assert not of_forecast(ForecastState(), 100.0) and of_failures([]) == []


@pytest.mark.parametrize(
    "age, code, severity, after", [(2.9, None, None, 0), (3.5, "stale", "warning", 3.0), (61.0, "lost", "alarm", 10.0)]
)
@pytest.mark.parametrize(
    "what, keys", [("gnss", ("bow_latitude_deg", "stern_latitude_deg")), ("heading", ("heading_deg",))]
)
def test_a_sensor_that_falls_silent(what, keys, age, code, severity, after):
    """By hand: stale after 3 s, lost after 10 s, from then on."""
    found = intake(told={**TOLD, **dict.fromkeys(keys, 100.0 - age)})
    if code is None:
        assert not found
    else:
        assert list(found) == [f"{what}_{code}"]
        [alarm] = found.values()
        assert alarm.severity == severity and alarm.since == pytest.approx(100.0 - age + after)


def test_one_of_two_antennas():
    """By hand: one silent antenna is a warning of its own; both are one alarm."""
    found = intake(told={**TOLD, "stern_latitude_deg": 80.0})
    assert {c: a.severity for c, a in found.items()} == {"gnss_silent_stern": Severity.warning}
    assert list(intake(told={"heading_deg": 99.9})) == ["gnss_lost"]


def test_channels_clocks_receivers_and_damage():
    """By hand: one alarm each, with its beginning."""
    assert intake(channels=("lan", "tcp"))["silent_tcp"].severity is Severity.warning
    assert intake(heard={"lan": 90.0})["silent_lan"].since == 95.0
    jump = Event(70.0, "clock_jump", "the clock of GP jumped")
    assert intake(jumped=jump)["clock_jump"].text == jump.text and not intake(
        now=100.0, jumped=replace_time(jump, 30.0)
    )
    found = intake(disagree={"bow stern": Disagreement(97.0, "30 m off")})["disagree_bow_stern"]
    assert (found.severity, found.since) == (Severity.alarm, 97.0)
    assert "damaged_lan" in intake(of_late={"lan": (100, 6, 0)})
    assert not intake(of_late={"lan": (100, 5, 5)}) and not intake(of_late={"lan": (40, 40, 40)})
    assert "latency_s" in intake(of_late={"lan": (100, 0, 6)})["late_lan"].text


def test_a_channel_that_sends_nothing_of_use():
    """By hand: lines that cannot be read are told as such, with what is wrong with most; a position of an unknown sender with its name."""
    alarm = intake(heard={}, counts={"lan": {"lines": 90, "sentences": 90, "malformed": 80, "checksum": 10}})[
        "silent_lan"
    ]
    assert "90 lines came" in alarm.text and "malformed" in alarm.text and "port" in alarm.text
    assert "nothing heard yet" in intake(heard={}, counts={})["silent_lan"].text
    told = {"heading_deg": 99.9, "bow_latitude_deg": 99.9}
    alarm = intake(told=told, strangers=("GN", "GP0001"))["antenna_source"]
    assert "antenna stern" in alarm.text and "GN, GP0001" in alarm.text and "antennas.stern.source" in alarm.text
    assert "antenna_source" not in intake(told=told)


def replace_time(event: Event, time: float) -> Event:
    return event._replace(time=time)


def test_before_anything_is_heard():
    """Law: a bridge that has just begun tells of silent channels and that there is no prediction, and of nothing else."""
    nothing = IntakeState(math.nan, {}, {}, {"lan": {}}, {}, None)
    assert [a.code for a in of_intake(nothing, ("bow",), ("lan",), 5.0)] == ["silent_lan"]
    assert [a.code for a in of_estimator(EstimatorState(math.nan, {}, None, {}, ""), 5.0)] == ["filter_waiting"]


def test_the_filters():
    """By hand: coasting with twice the 5 m of its place, an antenna whose squares are nine times too large, a filter left behind."""
    [alarm] = of_estimator(replace(STATE, coasting_since=90.0), 100.0)
    assert (alarm.code, alarm.since) == ("coasting", 90.0) and "known to 10 m" in alarm.text and "10 s" in alarm.text
    [alarm] = of_estimator(replace(STATE, inconsistency={"bow": 9.0, "heading": 2.9}), 100.0)
    assert alarm.code == "inconsistent_bow" and "3.0 times" in alarm.text
    [alarm] = of_estimator(STATE, 110.0)
    assert (alarm.code, alarm.severity, alarm.since) == ("filter_behind", Severity.alarm, pytest.approx(102.9))
    [alarm] = of_estimator(replace(STATE, refused="antennas a and b"), 100.0)
    assert alarm.text == "antennas a and b"


def test_the_model_and_what_is_around_it():
    """By hand: outside the training range, no longer the ship it knew, and a full disk."""
    found = of_forecast(ForecastState(True, False, 4.2, 2.1, outside_since=60.0), 100.0)
    assert [(a.code, a.since) for a in found] == [("out_of_domain", 60.0), ("misfit", 100.0)] and "4.2" in found[1].text
    for now, severity in (
        (300.0, Severity.warning),
        (250.0, Severity.caution),
    ):  # since 100: for more than three minutes or not
        [alarm] = of_forecast(ForecastState(False, False, 4.2, 2.1, misfit_since=100.0), now)
        assert (alarm.since, alarm.severity) == (100.0, severity)
    [alarm] = of_failures([Failure("record", "no space left on device", 50.0)])
    assert (alarm.code, alarm.text) == ("failed_record", "record: no space left on device")
    assert [f.severity for f in of_failures([Failure("a", "b", 0.0, Severity.caution), Failure("c", "d", 0.0)])] == [
        "caution",
        "warning",
    ]


def test_the_order_of_alarms():
    """By hand: by severity, the newest first; a code stands once, and keeps its first beginning while it lasts."""
    a, b, c = (
        Alarm(code, s, "", t)
        for code, s, t in (("a", Severity.caution, 9), ("b", Severity.alarm, 3), ("c", Severity.alarm, 5))
    )
    assert [x.code for x in in_order([a, b, c])] == ["c", "b", "a"]
    assert [x.since for x in in_order([replace(b, since=50)], before=[b])] == [3]
    assert len(in_order([a, a])) == 1
