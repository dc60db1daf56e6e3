"""Alarms of what lies ahead: from the chart, from targets, from targets that are lost."""

import math
from dataclasses import replace

import numpy as np

from aspnn.live import lookout
from aspnn.live.alarms import Severity
from aspnn.live.encounter import Limits, assess
from aspnn.live.forecast import Touching
from tests.live.test_encounter import HULL, run, target


def test_ground_is_an_alarm_and_a_berth_a_warning():
    """Law: one alarm for ground, with what and when; a warning for what may be meant; now is now."""
    found = lookout.of_touches([Touching(42.3, "shore", True), Touching(0.0, "berth", False)], 7.0)
    assert [(a.code, a.severity, a.text) for a in found] == [
        ("grounding", Severity.alarm, "predicted ship touches shore in 42 s"),
        ("touching", Severity.warning, "the ship touches berth now"),
    ]
    (crossed,) = lookout.of_touches([Touching(12.0, "10 m depth contour", False)], 7.0)
    assert crossed.text == "predicted ship crosses 10 m depth contour in 12 s"
    assert lookout.of_touches([], 7.0) == []


def test_targets_are_told_by_what_they_do():
    """By hand: head on at 12 m/s from 600 m, hulls of 90 and 60 m: bows meet after 525 / 12 s, an alarm; 60 m abeam a warning; beyond the
    horizon a warning by the straight lines; who is far off and who has passed is not told."""
    fleet = [
        target("meets", 600, 0, math.pi, 6),
        target("abeam", 600, 60, math.pi, 6),
        target("later", 2400, 50, math.pi, 6),
        target("passed", -300, 30, math.pi, 6),
        target("far", 500, 3000, 0.0, 6),
    ]
    found, _ = assess(run(0, 0, 0.0, (6, 0, 0)), HULL, fleet, 1000.0, Limits(cpa=100, tcpa=300))
    told = {a.code: a for a in lookout.of_dangers(found, 5.0)}
    assert set(told) == {"contact_meets", "danger_abeam", "danger_later"}
    assert told["contact_meets"].severity is Severity.alarm and told["contact_meets"].since == 5.0
    assert told["contact_meets"].text == f"contact with meets predicted in {525 / 12:.0f} s"
    assert told["danger_abeam"].text.startswith("abeam comes within 48 m in 4")
    assert told["danger_later"].text == "later passes 50 m off in 3 min (straight on)"


def test_a_crowd_is_told_as_one():
    """Law: each predicted contact has its alarm; of other dangerous targets five are told, the rest counted."""
    (danger,), _ = assess(run(0, 0, 0, (6, 0, 0)), HULL, [target("A", 600, 60, math.pi, 6)], 1000.0, Limits())
    crowd = [replace(danger, target=replace(danger.target, id=f"{k}")) for k in range(8)]
    crowd += [replace(danger, cpa=0.0, target=replace(danger.target, id=f"c{k}")) for k in range(7)]
    told = [a.code for a in lookout.of_dangers(crowd, 0.0)]
    assert sum(code.startswith("contact_c") for code in told) == 7
    assert sum(code.startswith("danger_") and code != "danger_more" for code in told) == 5
    more = next(a for a in lookout.of_dangers(crowd, 0.0) if a.code == "danger_more")
    assert more.text.startswith("3 more")
    assert np.all([a.severity is Severity.warning for a in lookout.of_lost([lookout.Lost("1", "", 3.0)], 9.0)])
