"""Oracle of the oracle: with the exact state it is the simulator itself."""

from dataclasses import replace

import numpy as np
import pytest

from aspnn.evaluation.evaluate import evaluate
from aspnn.evaluation.oracle import Oracle
from aspnn.evaluation.reference import Reference, Voyage
from aspnn.evaluation.windows import SHIP
from aspnn.orders import Orders
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.simulation import Sea, Ship, simulate
from aspnn.vessel import load_vessel
from tests.evaluation.conftest import nomoto_voyage, table_of

CURRENT = (0.4, -0.3)


def simulated(wind=0.0) -> Voyage:
    """A voyage of cargo90 in a current, with states that are the truth."""
    vessel = load_vessel("cargo90")
    ship = Ship.of(vessel)
    plan = Orders(np.array([0.0, 150.0, 190.0, 330.0]), np.radians([0.0, 20.0, -15.0, 5.0]))
    start, sea = ship.start(7.2e6, 4.1e5, 0.5, 5.9), Sea(current=np.array(CURRENT), wind=np.broadcast_to(wind, 2))
    run = simulate(ship, [plan], start, 480.0, sea=sea)[0]
    truth = run.truth()
    names = ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s", "rudder_angle_rad")
    table = table_of(run.time, run.order, {name: truth[name].to_numpy() for name in names})
    return Voyage(States(table, vessel), Reference.of_truth(truth), truth, name="simulated")


def test_exact_state_gives_the_true_path():
    """Current, plan, rudder under way: position within 1e-6 m and heading within 1e-9 rad in every window."""
    voyage = simulated()
    result = evaluate([], [voyage], SHIP, oracle=Oracle.of)
    assert len(result.windows) >= 4
    assert result.errors["oracle"].position.max() < 1e-6
    assert np.abs(result.errors["oracle"].heading).max() < 1e-9
    for name in ("surge", "sway", "yaw_rate"):
        np.testing.assert_allclose(getattr(result.paths["oracle"], name), getattr(result.reference, name), atol=1e-6)


def test_wind_is_known_only_where_said():
    """In wind the oracle that knows it is exact, the one that does not is metres off."""
    voyage = simulated(wind=(-8.0, 6.0))
    ignorant = evaluate([], [voyage], SHIP, oracle=Oracle.of).errors["oracle"]
    told = evaluate([], [voyage], SHIP, oracle=lambda v: Oracle.of(v, knows_wind=True)).errors["oracle"]
    assert told.position.max() < 1e-6 < 2.0 < np.median(ignorant.position[:, -1])


def test_current_matters():
    """An oracle that took the water to be at rest would miss by about the current's drift, 0.5 m/s x 90 s = 45 m less what
    the ship's own response takes up: the truth's columns are really used."""
    voyage = simulated()
    still = voyage.truth.assign(current_north_m_s=0.0, current_east_m_s=0.0)
    errors = evaluate([], [voyage], SHIP, oracle=lambda v: Oracle.of(replace(v, truth=still))).errors["oracle"]
    assert errors.position[:, -1].min() > 2.0


def test_no_oracle_without_truth():
    with pytest.raises(InputError, match="has no truth beside it"):
        Oracle.of(replace(nomoto_voyage(), truth=None))
