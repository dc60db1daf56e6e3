"""Oracle: groups counted by hand on constructed orders, with the boundary cases of architecture.md."""

from dataclasses import replace

import numpy as np
import pytest

from aspnn.evaluation.windows import GROUPS, MODEL_SHIP, NEW, SHIP, STEADY, STEERED, WITHIN, Rule, find_starts
from aspnn.orders import Orders
from aspnn.records import States
from aspnn.vessel import load_vessel
from tests.evaluation.conftest import degrees, table_of


def states_of(times, orders_deg, duration, coasting=None) -> States:
    time = np.arange(0.0, duration + 0.25, 0.5)
    table = table_of(time, Orders(np.array(times, float), degrees(*orders_deg)).at(time))
    if coasting is not None:
        table["coasting"] = (time >= coasting[0]) & (time <= coasting[1])
    return States(table, load_vessel("cargo90"))


def found(states, rule=SHIP, shaft=None):
    starts = find_starts(states, rule, shaft)
    return [
        (float(states["time_s"][row]), group) for row, group in zip(starts.rows, starts.groups, strict=True)
    ], starts


@pytest.mark.parametrize(
    ("times", "orders", "expected"),
    [
        ([0, 200], [0, 5], [(200, NEW)]),  # exactly 5 deg is an order
        ([0, 200], [0, 4.9], []),
        ([0, 200, 300], [0, 10, -10], [(200, NEW), (300, NEW)]),  # a further order after the horizon
        ([0, 200, 290], [0, 10, -10], [(200, NEW), (290, NEW)]),  # exactly at the horizon: does not act inside it
        ([0, 200, 289.5], [0, 10, -10], [(200, WITHIN), (289.5, NEW)]),
        ([0, 200, 205], [0, 10, 20], [(200, WITHIN), (205, NEW)]),  # exactly 5 s apart
        ([0, 200, 204.5], [0, 10, 20], [(200, WITHIN)]),  # too soon after the last
        ([0, 200, 250], [0, 10, 13], [(200, NEW)]),  # a correction of 3 deg does not end the hold
        ([0, 200, 250, 260], [0, 10, 13, 16], [(200, WITHIN)]),  # creeping 6 deg away does
        ([0, 100], [0, 10], []),  # less than 120 s of history
        ([0, 120], [0, 10], [(120, NEW)]),
        ([0, 310], [0, 10], [(310, NEW)]),  # the horizon ends with the log
        ([0, 310.5], [0, 10], []),
    ],
)
def test_orders_by_hand(times, orders, expected):
    starts, _ = found(states_of(times, orders, 400.0))
    assert [start for start in starts if start[1] != STEADY] == expected


@pytest.mark.parametrize(
    ("times", "orders", "expected"),
    [
        ([0], [0], list(range(120, 211, 15))),  # from the history on, the last one 90 s before the end at 300 s
        ([0, 200], [0, 10], []),  # before: 120 + 90 > 200; after: 230 + 90 > 300
        ([0, 90], [0, 10], list(range(120, 211, 15))),  # 30 s after the order exactly
        ([0, 100], [0, 10], list(range(130, 211, 15))),
        ([0, 240], [0, 10], [120, 135, 150]),  # an order exactly at the end of the horizon does not act
        ([0, 160], [0, 4], list(range(120, 211, 15))),  # no order
        ([0, 160], [4, -4], [190, 205]),  # 8 deg is an order, though either side lies within 5 deg of amidships
        ([0, 160, 170], [0, 4, 8], [195, 210]),  # creeping 8 deg in all; from 165 s on (30 s before 195 s) only 4 deg
    ],
)
def test_steady_by_hand(times, orders, expected):
    starts, _ = found(states_of(times, orders, 300.0))
    assert [time for time, group in starts if group == STEADY] == expected


def test_exclusions_are_counted():
    """By hand: orders at 60 (history), 200 (coasting), 320 (kept) and 460 s (beyond the end)."""
    states = states_of([0, 60, 200, 320, 460], [0, 10, -10, 10, -10], 500.0, coasting=(199.0, 201.0))
    starts, result = found(states)
    assert [s for s in starts if s[1] != STEADY] == [(320, NEW)]
    assert result.excluded == {
        "less than 120 s of history": 1,
        "horizon beyond the end of the log": 1,
        "coasting at the start": 1,
    }


def test_plans_are_the_orders_of_the_horizon():
    """By hand: the plan starts with the new order at 0 and holds the next 60 s later; shaft orders go along."""
    _, starts = found(
        states_of([0, 200, 260], [0, 10, -20], 400.0), shaft=Orders(np.array([0.0, 230.0]), np.array([2, 3]))
    )
    plan = starts.plans[list(starts.groups).index(WITHIN)]
    np.testing.assert_allclose(plan.rudder.times, [0, 60])
    np.testing.assert_allclose(plan.rudder.values, degrees(10, -20))
    np.testing.assert_allclose([plan.shaft.times, plan.shaft.values], [[0, 30], [2, 3]])


def test_model_ships_have_their_own_rule():
    """By hand: order at 60 s, held 30 s: new; the next start 12.5 s before an order is not; steady from 10 s after."""
    assert Rule.of(load_vessel("kvlcc2_l7")) == MODEL_SHIP and Rule.of(load_vessel("cargo90")) == SHIP
    starts, _ = found(states_of([0, 60, 130, 142.5], [0, 10, -10, 5], 172.5), MODEL_SHIP)
    assert [s for s in starts if s[1] != STEADY] == [(60, NEW), (130, WITHIN), (142.5, NEW)]
    assert [s[0] for s in starts if s[1] == STEADY] == [20, 70, 85, 100]


def test_steered_starts_are_there_whatever_is_ordered_and_only_where_asked():
    """Oracle: by hand. A rudder that moves every half second, as under an autopilot: no other group finds a start; the others' stay."""
    time = np.arange(0.0, 400.0, 0.5)
    swinging = states_of(time, 12 * np.sin(time / 9), 400.0)
    assert found(swinging)[0] == []
    rule = replace(SHIP, steered_every=50.0)
    starts, told = found(swinging, rule)
    assert starts == [(120.0 + 50 * k, STEERED) for k in range(4)]  # the last 90 s before the end at 400 s
    plan = told.plans[1].rudder
    np.testing.assert_allclose(plan.at(30.0), np.radians(12 * np.sin(200 / 9)), atol=1e-12)  # what was ordered then
    held = states_of([0, 200], [0, 10], 400.0)
    others = [start for start in found(held, rule)[0] if start[1] != STEERED]
    assert others == found(held)[0] and len(found(held, rule)[0]) == len(others) + 4
    assert (SHIP.groups, rule.groups, rule.shown[-1]) == (GROUPS, (*GROUPS, STEERED), STEERED)
