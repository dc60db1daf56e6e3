"""Logs for the tests of the filters: a simulated voyage of cargo90, and exact noise-free motion."""

import pytest

from aspnn.simulation import Scenario, simulate_scenario


@pytest.fixture(scope="session")
def voyage():
    """A log of fifteen minutes and its truth: random orders, sensors of the thesis, a seed that nothing was tuned on."""
    scenario = Scenario.model_validate(
        {
            "name": "filters",
            "vessel": "cargo90",
            "duration_s": 900,
            "seed": 424242,
            "start": {
                "speed_kn": 11.5,
                "latitude_deg": 69.65,
                "longitude_deg": 18.96,
                "zone": "33N",
                "heading_deg": 350.0,
            },
            "manoeuvre": {"kind": "random-orders"},
        }
    )
    return next(simulate_scenario(scenario))
