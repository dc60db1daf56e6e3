"""The study of loadings: its changing voyages against the simulator, and its table on a voyage that is made up."""

import importlib.util
import sys
from pathlib import Path

import numpy as np

from aspnn.simulation.ship import Ship
from aspnn.vessel import load_vessel

ROOT = Path(__file__).parents[2]


def study():
    folder = str(ROOT / "training/reproduce")
    sys.path.insert(0, folder)
    try:
        spec = importlib.util.spec_from_file_location("loading", f"{folder}/loading.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path.remove(folder)


def test_a_changing_ship_goes_on_where_it_was(monkeypatch):
    """Law: one set of orders, no jump in place, heading or velocity; before the change in the one ship's balance, then in the other's."""
    loading = study()
    monkeypatch.setattr(loading, "CHANGE", 60.0)
    given = loading.scenario("cargo90_ballast", 5).model_copy(update={"duration_s": 120.0})
    monkeypatch.setattr(loading, "scenario", lambda *_: given)
    kept = {}
    monkeypatch.setattr(loading, "filter_log", lambda log: kept.setdefault("log", log))
    (voyage,) = loading.changing("loads", 1, 5)
    truth = voyage.truth
    time, surge = truth["time_s"].to_numpy(), truth["surge_m_s"].to_numpy()
    assert len(time) == 1201 and kept["log"].vessel.name == "cargo90"
    for name in ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s", "rudder_angle_rad"):
        steps = np.abs(np.diff(truth[name].to_numpy()))
        assert steps[599:602].max() < 1.5 * np.delete(steps, [599, 600, 601]).max() + 1e-4, name
    # In balance at 13.0 kn in ballast; loaded the same propeller does not hold that speed.
    np.testing.assert_allclose(surge[:600], Ship.of(load_vessel("cargo90_ballast")).service_speed, rtol=1e-3)
    assert surge[-1] < surge[600] - 0.05


def test_minutes_and_groups_are_told_apart():
    """Contract: the first checkpoint's errors and those of its tracked self stand by minutes and group, with the oracle, in order."""
    loading = study()
    from aspnn.prediction.gru import GruPredictor

    models = [GruPredictor.load(ROOT / "checkpoints/cargo90")]
    scores = loading.measured(models, "design", 1, 5)
    assert list(scores) == ["cargo90", "cargo90-tracked", "oracle"]
    counts = {minutes: sum(g["n"] for g in by.values()) for minutes, by in scores["cargo90"].items()}
    assert set(counts) <= {"2-5", "5-10", "10-20", "20-30"} and sum(counts.values()) > 20
    assert scores["cargo90"] == scores["cargo90-tracked"]  # the ship that it learned
    some = scores["cargo90"]["10-20"]["steady"]
    assert some["position_m"][0] < 2 and some["held"][0] > 0.8 and scores["oracle"]["10-20"]["steady"]["held"] is None
