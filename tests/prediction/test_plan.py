"""Plans as users write them: what is meant, and one clear line for what cannot be."""

import math

import numpy as np
import pytest

from aspnn.prediction import make_plan
from aspnn.schema import InputError
from aspnn.workflow import parse_plan
from tests.prediction.test_kinematic import states_of

STATES = states_of((6.0, 0, 0, 0, 0, 0))


def test_forms_of_a_plan():
    """By hand: one angle is held, pairs are kept, none holds what is in force."""
    assert make_plan(STATES, 0.2, None, 90).rudder.at([0, 90]).tolist() == [0.2, 0.2]
    assert make_plan(STATES, [(0, 0.2), (30, -0.1)], None, 90).rudder.at([29.9, 30, 90]).tolist() == [0.2, -0.1, -0.1]
    assert make_plan(STATES, None, None, 90).rudder.at([0, 90]).tolist() == [0, 0]


def test_text_of_a_plan():
    assert parse_plan("20") == [(0.0, math.radians(20))]
    assert parse_plan("20@0,-10@30") == [(0.0, math.radians(20)), (30.0, math.radians(-10))]
    assert parse_plan("20@") == parse_plan("20")
    for text in ("left", "20,,3", "20@x"):
        with pytest.raises(InputError, match="DEG or DEG@SECONDS"):
            parse_plan(text)


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        (math.radians(36), "order 36 deg at 0 s is beyond the 35 deg stops of cargo90"),
        ([(0, 0.1), (20, -0.7)], r"order -40\.11 deg at 20 s is beyond"),
        ([(5, 0.1)], "the first order is at 5 s, it must be at 0"),
        ([(0, 0.1), (10, 0.2), (10, 0.3)], "the order at 10 s does not come after"),
        ([(0, 0.1), (91, 0.2)], "the order at 91 s lies beyond the horizon of 90 s"),
        ([], "give at least one order"),
        ([(0, math.nan)], "give at least one order, as numbers"),
    ],
)
def test_impossible_plans_are_named(plan, reason):
    with pytest.raises(InputError, match=reason):
        make_plan(STATES, plan, None, 90.0)


def test_unknown_order_cannot_be_held():
    states = states_of((6.0, 0, 0, 0, 0, 0))
    states.table["rudder_order_rad"] = np.nan
    with pytest.raises(InputError, match="no rudder order is known"):
        make_plan(states, None, None, 90.0)
    assert make_plan(states, 0.1, None, 90.0).rudder.at(0) == 0.1
