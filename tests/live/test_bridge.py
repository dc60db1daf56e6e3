"""The simulated bridge against the simulator it is made of, and its sentences against the intake that reads them."""

import math

import numpy as np
import pytest

from aspnn.frames import to_grid
from aspnn.guidance import helms
from aspnn.live.bridge import SimulatedBridge
from aspnn.live.intake import Intake
from aspnn.live.start import settings_of
from aspnn.live.traffic import SHIPS
from aspnn.logs.ais_messages import Report, Static
from aspnn.schema import InputError
from aspnn.simulation.scenario import Scenario
from aspnn.simulation.voyage import run_on

BEGAN = 1_700_000_000.0
SCENARIO = {
    "name": "harbour",
    "vessel": "cargo90",
    "duration_s": 600,
    "start": {"speed_kn": 10, "latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": 40},
    "manoeuvre": {"kind": "straight"},
    "sensors": {"position_m": 0.0, "heading_deg": 0.0, "yaw_rate_deg_s": 0.0, "acceleration_m_s2": 0.0},
}


def bridge(**more):
    return SimulatedBridge(Scenario.model_validate(SCENARIO | more), BEGAN)


def test_steered_live_it_sails_as_simulated_at_once():
    """Oracle: `run_on` of the whole series of orders in one compiled call: the same states to the last bit, step by step."""
    b, orders = bridge(), np.zeros(600)
    start = b.state.copy()
    orders[200:] = math.radians(20)
    b.advance(BEGAN + 20.0)
    b.order(rudder=math.radians(20))
    for k in range(40):
        b.advance(BEGAN + 21.0 + k)
    late = round(b.ship.rudder.delay / b.dt)
    found = run_on(b.ship, start, orders[None], dt=b.dt)
    assert b.step == 600 and late == 0
    np.testing.assert_array_equal(b.state[0], found[0, 600])
    assert b.state[0, helms.YAW_RATE] > 0.01


def test_its_sentences_tell_where_it_is():
    """Oracle: the state itself, by way of sentences, intake and rows: without noise the antennas are where the hull has them
    (7 decimals of a minute: 0.2 mm), heading and orders as they are; each row at the time of its step."""
    b = bridge()
    intake = Intake(settings_of(b))
    for time, line in b.advance(BEGAN + 10.0):
        intake.feed(line, time, "bridge")
    row = intake.rows(BEGAN + 12.0)[-1]
    assert row.time == pytest.approx(BEGAN + 10.0, abs=1e-3)
    state = b.state[0]
    for name in ("bow", "stern"):
        x, y = b.vessel.stations[name]
        place = to_grid(*(math.radians(row.values[f"{name}_{axis}_deg"]) for axis in ("latitude", "longitude")), b.zone)
        off = complex(*(float(v) for v in place)) - complex(state[helms.NORTH], state[helms.EAST])
        assert abs(off - complex(x, y) * np.exp(1j * state[helms.HEADING])) < 1e-3
    assert row.values["rudder_order_deg"] == 0.0
    assert row.values["shaft_speed_rps"] == pytest.approx(state[helms.SHAFT], abs=1e-5)
    assert intake.state().counts["bridge"]["good"] == intake.state().counts["bridge"]["sentences"]


def test_others_tell_who_and_where_they_are():
    """Law: every other ship has told her name and size and is on the course and at the speed that she sails."""
    b = bridge()
    intake = Intake(settings_of(b))
    for time, line in b.advance(BEGAN + 22.0):
        intake.feed(line, time, "bridge")
    said = [ais.said for ais in intake.targets_in]
    assert {s.name for s in said if isinstance(s, Static)} == {ship[1] for ship in SHIPS}
    for other in b.traffic:
        report = [s for s in said if isinstance(s, Report) and s.mmsi == other.mmsi][-1]
        assert report.speed_m_s == pytest.approx(other.speed, abs=0.03)
        told = [a.time for a in intake.targets_in if isinstance(a.said, Report) and a.said.mmsi == other.mmsi]
        first, *gaps = np.diff(told)  # the second report is in a slot of her own, then they come evenly
        assert 0 < first < other.every + 0.15
        np.testing.assert_allclose(gaps, other.every, atol=0.15)


@pytest.mark.parametrize(
    ("what", "said"), [({"rudder": 0.7}, "35 deg stops"), ({"shaft": 9.0}, "stops"), ({"rudder": math.nan}, "stops")]
)
def test_orders_beyond_the_stops_change_nothing(what, said):
    """Law: an order that cannot be is refused in one line, and the one in force stands."""
    b = bridge()
    before = b.orders
    with pytest.raises(InputError, match=said):
        b.order(**what)
    assert b.orders == before


def test_a_long_pause_is_not_sailed():
    """Law: a caller that was away for an hour gets a minute of lines, at the times of now."""
    b = bridge()
    b.advance(BEGAN + 1.0)
    sent = b.advance(BEGAN + 3600.0)
    assert b.step <= 620
    assert sent[0][0] >= BEGAN + 3539.0 and b.time == pytest.approx(BEGAN + 3600.0, abs=0.11)
