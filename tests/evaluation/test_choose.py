"""Oracles: the best mix of two Gaussian errors is analytic, the best falling sequence is found by trying all, leaks are refused."""

import itertools
import json
import math
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from aspnn.evaluation.choose import KNOTS, SHARES, choose, falling, fit_shares, table
from aspnn.evaluation.windows import SHIP
from aspnn.schema import InputError
from aspnn.workflow import calibrate_files, choose_files, evaluate_files, simulate_files
from tests.evaluation.conftest import Planner, nomoto_voyage

ROOT = Path(__file__).parents[2]


def test_falling_by_trying_all():
    """Every falling sequence of 5 knots and 4 columns is tried: none costs less."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        cost = rng.uniform(size=(5, 4))
        ways = [way for way in itertools.product(range(4), repeat=5) if all(a >= b for a, b in itertools.pairwise(way))]
        best = min(ways, key=lambda way: sum(cost[k, j] for k, j in enumerate(way)))
        assert falling(cost).tolist() == list(best)


@pytest.mark.parametrize("axes", [1, 2])
def test_shares_of_gaussian_errors(axes):
    """Analytic: independent errors of deviations a (network) and b (kinematic) are least at w = a^2 / (a^2 + b^2), in every
    quantile. The ratio is flat about it (0.1 off costs below 2 %) and noise of 1,600 windows is 3 %: within 0.25, in the mean 0.1.
    """
    rng = np.random.default_rng(1)
    a, b = 1.0, np.array([0.01, 0.1, 0.5, 0.8, 1.0, 1.5, 2.0, 6.0, 40.0])
    scale = 0.01 if axes == 1 else 1.0  # radians, far from the circle's end
    network = scale * a * rng.normal(size=(40, 40, len(b), axes))
    other = scale * b[:, None] * rng.normal(size=network.shape)
    shares, _ = fit_shares(list(network), list(other - network))
    assert shares[0] == 1
    assert shares[-1] == 0
    wanted = a**2 / (a**2 + b**2)
    assert np.abs(shares - wanted).max() <= 0.25
    assert np.abs(shares - wanted).mean() <= 0.1


def test_no_mix_without_a_gain():
    """Two paths with the same error and the same path twice: nothing is left to kinematics that does not win."""
    errors = list(np.random.default_rng(2).normal(size=(10, 20, 3, 2)))
    shares, _ = fit_shares(errors, [0 * e for e in errors])
    np.testing.assert_array_equal(shares, 0)


@dataclass(frozen=True)
class Lagging(Planner):
    """Knows the ship, but begins each path as if it lay still in the turn: yaw rate 0.01 rad/s too high, dying out in 10 s."""

    name: str = "lagging"

    def predict_many(self, states, rows, plans):
        path = Planner.predict_many(self, states, rows, plans)
        off = 0.1 * (1 - np.exp(-path.time / 10))
        return replace(path, heading=path.heading + off, north=path.north + 60 * off, east=path.east - 40 * off)


def test_a_network_that_begins_badly_is_helped_and_a_good_one_is_left_alone():
    """Made-up voyages: the network begins 1 m off after 2 s and knows all orders, kinematics the other way round."""
    voyages = [nomoto_voyage(seed) for seed in range(12)]
    found = choose(Lagging(), voyages, SHIP, ["voyage-99"])
    assert found.place["steady"][0] == found.heading["steady"][0] == 1
    assert found.place["order"][0] == 1
    assert found.place["order"][-1] == found.heading["order"][-1] == 0
    assert found.facts["phases"]["order"]["windows"] >= 40
    assert len(table(found).rows) == 2
    alone = choose(Planner(), voyages, SHIP, [])
    assert not alone.place["order"][3:].any()
    assert not alone.heading["order"][3:].any()
    with pytest.raises(
        InputError, match="voyage voyage-3 trained checkpoint lagging; choose on voyages it has not seen"
    ):
        choose(Lagging(), voyages, SHIP, ["voyage-3"])
    with pytest.raises(InputError, match="5 voyages have windows, 6 are needed"):
        choose(Lagging(), voyages[:5], SHIP, [])


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    text = (ROOT / "data/scenarios/cargo90-test.toml").read_text().replace("duration_s = 1800", "duration_s = 700")
    (folder / "short.toml").write_text(text)
    return simulate_files(folder / "short.toml", folder, 7, seed=90_031)


def test_choose_and_evaluate_a_checkpoint(tmp_path, logs):
    """The command's composition on the thesis network: kinematics first, in place; the parts stand beside it in an evaluation."""
    folder = tmp_path / "thesis"
    shutil.copytree(ROOT / "checkpoints/cargo90-thesis", folder)
    said: list[str] = []
    found = choose_files(folder, logs, None, said.append)
    assert not said
    assert found.place["steady"][0] == 1
    assert found.place["steady"][-1] < 0.5
    config = json.loads((folder / "config.json").read_text())
    assert config["choice"]["facts"]["voyages"] == [log.stem for log in logs]
    assert np.isin(config["choice"]["place"]["steady"], SHARES).all()
    np.testing.assert_allclose(config["choice"]["time"], 90 * KNOTS)
    with pytest.raises(InputError, match=f"voyage {logs[0].stem} trained checkpoint cargo90-thesis"):
        calibrate_files(folder, logs)  # regions of the mix need voyages that did not choose it
    result = evaluate_files([folder], logs[:2], oracle=False)
    assert result.main == "cargo90-thesis"
    assert list(result.errors)[:2] == ["cargo90-thesis", "cargo90-thesis-network"]
    early = {name: float(np.median(result.errors[name].position[:, result.column(6.0)])) for name in result.errors}
    assert math.isclose(early["cargo90-thesis"], early[found.kinematic], rel_tol=0.2)
    assert early["cargo90-thesis"] < 0.6 * early["cargo90-thesis-network"]
    assert "the choice of cargo90-thesis was fixed on 2 of 2 voyages" in " ".join(result.warnings)


def test_a_calibration_goes_with_a_line(tmp_path, logs, monkeypatch):
    """The flagship is calibrated: a choice drops that, and an idle one (made so here) writes nothing."""
    from aspnn.evaluation import choose as module

    folder = tmp_path / "flagship"
    made = choose(Lagging(), [nomoto_voyage(seed) for seed in range(6)], SHIP, [])
    monkeypatch.setattr(module, "choose", lambda *given: made)
    said: list[str] = []
    choose_files(ROOT / "checkpoints/cargo90", logs, folder, said.append)
    assert said == [
        "cargo90: its regions were calibrated without this choice and are dropped; run `aspnn calibrate` again"
    ]
    assert "calibration" not in json.loads((folder / "config.json").read_text())
    zero = {phase: 0 * share for phase, share in made.place.items()}
    idle = replace(made, place=zero, heading=zero)
    monkeypatch.setattr(module, "choose", lambda *given: idle)
    choose_files(ROOT / "checkpoints/cargo90", logs, tmp_path / "none", said.append)
    assert "nothing was written" in said[-1]
    assert not (tmp_path / "none").exists()
