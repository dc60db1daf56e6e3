"""Rudder orders that nobody tells: from the measured angle, without looking ahead."""

import numpy as np
import pytest

from aspnn.live.held import LEAST, REST, HeldOrder
from aspnn.live.intake import Intake
from aspnn.live.row import UNTOLD
from aspnn.logs.recording import unix
from aspnn.logs.sentences import encode
from aspnn.orders import Orders
from tests.live.faults import BRIDGE, bridge

START = unix("2026-11-22T12:00:00Z")
RATE = 2.32  # deg/s of the rudder


def moved(noise: float, seed: int = 1):
    """Times, angles of a rudder that follows orders (times and levels in deg), and those orders: at 10 Hz, with noise [deg]."""
    orders = Orders(np.array([0.0, 20.0, 60.0, 90.0, 92.0]), np.array([0.0, 20.0, -10.0, 5.0, -35.0]))
    time = np.arange(0, 140, 0.1)
    angle = orders.servo(time, 0.0, RATE)
    return time, angle + noise * np.random.default_rng(seed).standard_normal(len(time)), orders


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_orders_are_those_at_which_the_rudder_rests(noise):
    """By hand: from REST after the rudder has come to rest the order is the true one, which is a whole grade, and stays; while it moves the order
    is the angle, within the dead band."""
    time, angle, orders = moved(noise)
    held, true = HeldOrder(), orders.at(time)
    found = np.array([held.take(t, a) for t, a in zip(time, angle, strict=True)])
    clean = moved(0.0)[1]
    begun = np.concatenate([[0], np.flatnonzero(np.abs(clean - true) > 1e-9)]) / 10  # moving: not there yet
    rested = np.array([t - begun[begun <= t].max() > REST + 0.3 for t in time])
    assert rested.sum() > 800
    np.testing.assert_allclose(found[rested], true[rested], atol=1e-6)
    assert np.abs(found - angle).max() < LEAST + 6 * noise
    changes = np.flatnonzero(np.abs(np.diff(found)) > 0)
    assert not rested[changes + 1].any()


def test_nothing_later_changes_an_order():
    """Law: the orders up to an instant are those of the angles up to it."""
    time, angle, _ = moved(0.1)
    whole, part = HeldOrder(), HeldOrder()
    first = [whole.take(t, a) for t, a in zip(time, angle, strict=True)]
    other = [part.take(t, a if t < 61 else -a) for t, a in zip(time, angle, strict=True)]
    assert first[:610] == other[:610] and first[650:] != other[650:]


@pytest.mark.parametrize("told", [False, True])
def test_a_ship_that_tells_no_orders(tmp_path, told):
    """Contract: after UNTOLD seconds of angles without an order rows have one, and it is said that it is derived; a ship that tells
    orders has those alone."""
    it, rows = Intake(bridge(tmp_path, BRIDGE)), []
    for k in range(120):
        t = START + k / 10
        it.feed(encode("II", "RSA", [f"{min(k, 50) / 5:.1f}", "A", "", "V"]), t, "lan")
        if told:
            it.feed(encode("II", "ROR", ["10.0", "A", "", "V"]), t, "lan")
        rows += it.rows(t)
    rows += it.rows(START + 20)
    orders = [(r.time - START, r.values["rudder_order_deg"]) for r in rows if "rudder_order_deg" in r.values]
    if told:
        assert len(orders) == 120 and {o for _, o in orders} == {10.0} and not it.events
        assert it.told_by()["rudder_order"] == "II ROR"
    else:
        assert orders[0][0] == pytest.approx(UNTOLD) and orders[-1][1] == 10.0 and len(orders) == 70
        assert it.told_by()["rudder_order"] == "derived from rudder" and [e.code for e in it.events] == ["derived"]


def test_a_source_that_is_named_for_orders_is_waited_for(tmp_path):
    """Contract: where sensors.rudder_order names who tells orders, none is derived."""
    it = Intake(bridge(tmp_path, BRIDGE + '[sensors]\nrudder_order = "AP"\n'))
    for k in range(120):
        it.feed(encode("II", "RSA", ["5.0", "A", "", "V"]), START + k / 10, "lan")
    assert not any("rudder_order_deg" in r.values for r in it.rows(START + 20))
