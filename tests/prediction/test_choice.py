"""The mix of kinematic and learned path: laws of a rigid path, of convexity and of causal plans; what a checkpoint makes of it."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path as FilePath

import numpy as np
import pytest

from aspnn.estimation import filter_log
from aspnn.evaluation.evaluate import sees_future
from aspnn.evaluation.reference import Reference, Voyage
from aspnn.evaluation.windows import SHIP, find_starts
from aspnn.learning.card import model_card
from aspnn.learning.checkpoint import read_bundle, write_choice
from aspnn.motion import integrate
from aspnn.orders import Orders, Plan
from aspnn.prediction import KinematicPredictor, Predictor, caa_ctra
from aspnn.prediction.choice import HybridChoice, acting_from, mixed
from aspnn.prediction.gru import GruPredictor
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario, simulate_scenario

ROOT = FilePath(__file__).parents[2]
POSE = np.array([7.2e6, 4.1e5, 6.1])  # a UTM place, and a heading that will pass north
FADING = np.array([1.0, 1.0, 0.4, 0.0])


def choice(steady=FADING, order=FADING, heading_scale=1.0) -> HybridChoice:
    time = np.array([1.0, 10.0, 20.0, 30.0])
    place = {"steady": np.array(steady, float), "order": np.array(order, float)}
    heading = {phase: heading_scale * share for phase, share in place.items()}
    return HybridChoice("caa_ctra", time, place, heading, 30.0, {"voyages": ["v-0", "v-1"]})


def two_paths(n=5):
    """A learned and a kinematic path (n, 91) from one pose, both exact."""
    rng = np.random.default_rng(3)
    rates = rng.normal(0, 0.01, (2, n, 1)) + rng.normal(0, 0.002, (2, n, 90))
    body = [np.stack([6 + r, -20 * r, r], axis=-1) for r in rates]
    return [integrate(np.tile(POSE, (n, 1)), velocity, 1.0) for velocity in body]


@cache
def voyage() -> Voyage:
    """A voyage of a seed that neither training nor the published test has."""
    scenario = read_scenario(ROOT / "data/scenarios/cargo90-test.toml").model_copy(update={"duration_s": 900.0})
    ((log, truth),) = simulate_scenario(scenario, 1, seed=90_017)
    return Voyage(filter_log(log), Reference.of_truth(truth), truth, name=log.voyage)


def predictor(name="cargo90-thesis", found: HybridChoice | None = None) -> GruPredictor:
    loaded = GruPredictor.load(ROOT / "checkpoints" / name)
    found = found or choice()
    return replace(loaded, bundle=replace(loaded.bundle, choice=json.loads(json.dumps(found.to_dict()))))


def test_a_mix_is_the_path_of_a_rigid_hull():
    """Law: the mix's own velocities, run on by the exact step, are the mix; it begins in the common pose."""
    learned, kinematic = two_paths()
    share = np.clip(1.2 - learned.time / 50, 0, 1) * np.ones((5, 1))
    path = mixed(learned, kinematic, share, share**2)
    body = np.stack([path.surge, path.sway, path.yaw_rate], axis=-1)[:, :-1]
    again = integrate(POSE, body, 1.0)
    for name in ("north", "east", "heading"):
        np.testing.assert_allclose(getattr(path, name), getattr(again, name), atol=1e-6, rtol=0)
    np.testing.assert_array_equal(np.stack([path.north, path.east, path.heading], axis=-1)[:, 0], np.tile(POSE, (5, 1)))
    turning = np.abs(path.yaw_rate) > 1e-3
    np.testing.assert_allclose(path.pivot[turning], (-path.sway / path.yaw_rate)[turning])


def test_the_ends_of_the_mix_are_its_parts():
    """Law: no share is the learned path bit by bit, a whole one the kinematic one; after the last share the learned again."""
    learned, kinematic = two_paths()
    none, whole = np.zeros((5, 91)), np.ones((5, 91))
    for name in ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot"):
        np.testing.assert_array_equal(getattr(mixed(learned, kinematic, none, none), name), getattr(learned, name))
        # Places of 7e6 m resolve 1e-9 m, and so velocities over steps of 1 s; a slow turn's pivot point lies far off.
        close = {"atol": 1e-3 if name == "pivot" else 1e-7, "rtol": 1e-4 if name == "pivot" else 0}
        np.testing.assert_allclose(
            getattr(mixed(learned, kinematic, whole, whole), name), getattr(kinematic, name), **close
        )
    fading = np.where(learned.time < 40, 0.5, 0.0) * np.ones((5, 1))
    path = mixed(learned, kinematic, fading, fading)
    for name in ("north", "surge", "sway", "pivot"):
        np.testing.assert_array_equal(getattr(path, name)[:, 41:], getattr(learned, name)[:, 41:])


def test_no_prediction_is_further_off_than_its_parts_on_average():
    """Convexity: |e| <= w |e_k| + (1 - w) |e_n| for each window, place and heading, against any truth."""
    learned, kinematic = two_paths()
    truth = two_paths(10)[0][5:]
    share = np.random.default_rng(1).uniform(size=(5, 91))
    path = mixed(learned, kinematic, share, share)

    def off(p):
        return np.hypot(p.north - truth.north, p.east - truth.east), np.abs(p.heading - truth.heading)

    for mix, one, other in zip(off(path), off(kinematic), off(learned), strict=True):
        assert (mix <= share * one + (1 - share) * other + 1e-8).all()
        assert (mix < np.maximum(one, other) - 1e-3).any()


def test_shares_by_hand():
    """By hand: linear between knots; after an order the order's; an order to come leaves all before it as it is, and only takes."""
    found = choice(steady=[1, 0.9, 0.8, 0.7], order=[0.9, 0.6, 0.2, 0])
    place, _ = found.shares(np.array([math.inf, 0.0, 12.0]), np.array([0.0, 5.5, 15.0, 22.0, 60.0]))
    np.testing.assert_allclose(place[0], [1, 0.95, 0.85, 0.78, 0.7])
    np.testing.assert_allclose(place[1], [0.9, 0.75, 0.4, 0.16, 0])
    np.testing.assert_allclose(place[2], [1, 0.95, 0.9 - 0.3 * 2 / 9, 0.6, 0])


def test_when_an_order_acts():
    """By hand on a voyage: 0 at an order and up to 30 s after it, infinity once settled, the plan's own time for one to come."""
    states = voyage().states
    time, order = states["time_s"], states["rudder_order_rad"]
    change = Orders.from_series(time, order).changes(math.radians(5), 5.0)[1]
    at = int(np.searchsorted(time, change - 1e-6))

    def acting(row, *later):
        times = np.array([0.0, *(t for t, _ in later)])
        values = order[row] + np.array([0.0, *(math.radians(d) for _, d in later)])
        return acting_from(states, row, Plan(Orders(times, values)), 30.0)

    step = round(1 / (time[1] - time[0]))
    assert acting(at) == 0
    assert acting(at + 29 * step) == 0
    assert acting(at + 31 * step) == math.inf
    assert acting(at + 31 * step, (20.0, 3.0), (40.0, 6.0)) == 40
    assert acting(at - step) == math.inf  # the order is not yet known


def test_a_checkpoint_with_a_choice_keeps_the_laws():
    """Laws of the family: one prediction is a row of many, no future is seen, the network alone is what it was."""
    states = voyage().states
    starts = find_starts(states, SHIP)
    rows, plans = starts.rows[:6], starts.plans[:6]
    chosen, plain = predictor(), GruPredictor.load(ROOT / "checkpoints/cargo90-thesis")
    assert not sees_future(chosen, states, rows[:2], plans[:2])
    many = chosen.predict_many(states, rows, plans)
    one = chosen.predict(states.until(states["time_s"][rows[2]]), plans[2].rudder)
    np.testing.assert_allclose([one.north, one.east], [many[2].north, many[2].east], atol=2e-3)  # float32
    learned = plain.predict_many(states, rows, plans)
    kinematic = KinematicPredictor(states.vessel, caa_ctra).predict_many(states, rows, plans).at(np.arange(0, 91.0))
    at = [many.at(np.arange(0, 90.0)), learned.at(np.arange(0, 90.0)), kinematic]
    np.testing.assert_allclose(at[0].north[:, :11], at[2].north[:, :11], atol=1e-6)  # whole to 10 s
    np.testing.assert_array_equal(at[0].north[:, 31:], at[1].north[:, 31:])  # nothing from 30 s
    assert np.abs(at[0].north[:, 5] - at[1].north[:, 5]).max() > 0.05
    assert chosen.alone.name == "cargo90-thesis-network"
    np.testing.assert_array_equal(chosen.alone.predict_many(states, rows, plans).east, learned.east)
    exact = replace(chosen, region_map=False)  # the choice was fixed for the other way to the path
    assert exact.choice is None
    fan = chosen.fan(states.until(600.0), [0.0, 0.2, -0.2])
    np.testing.assert_allclose(
        fan.north[:, :90], fan.north[:1, :90].repeat(3, axis=0), atol=1e-6
    )  # kinematics know no rudder


def test_a_later_order_changes_nothing_before_it():
    """Law of a causal plan, for the predictor that reads it: two plans are one path until they differ."""
    chosen = predictor("cargo90", choice(steady=[1, 0.8, 0.5, 0.3]))
    states = voyage().states
    change = Orders.from_series(states["time_s"], states["rudder_order_rad"]).changes(math.radians(5), 5.0)[1]
    now = states.until(change + 45)
    order = float(now["rudder_order_rad"][-1])
    held, changed = (
        chosen.predict(now, plan) for plan in (order, [(0, order), (40, order + (0.3 if order < 0 else -0.3))])
    )
    np.testing.assert_array_equal(held.heading[:41], changed.heading[:41])
    assert abs(held.heading[-1] - changed.heading[-1]) > math.radians(5)


def test_regions_lie_about_the_mix():
    """Laws: an idle choice leaves path and regions bit by bit; calibration sees the very path that is predicted."""
    states = voyage().states
    starts = find_starts(states, SHIP)
    rows, plans = starts.rows[:4], starts.plans[:4]
    plain = GruPredictor.load(ROOT / "checkpoints/cargo90").predict_many(states, rows, plans)
    idle = predictor("cargo90", choice(np.zeros(4), np.zeros(4))).predict_many(states, rows, plans)
    for values, others in ((idle.north, plain.north), (idle.spread.covariance, plain.spread.covariance)):
        np.testing.assert_array_equal(values, others)
    chosen = predictor("cargo90")
    path = chosen.predict_many(states, rows, plans)
    seen, _ = chosen.predict_carried(states, rows, plans)
    np.testing.assert_allclose(path.north, seen.north, atol=1e-3)
    np.testing.assert_array_equal(path.region().north, path.north)
    assert np.abs(path.north - plain.north).max() > 0.05


def test_written_and_read_again(tmp_path):
    """The rule comes back to the last digit; a calibration without it goes; weights and all else stay."""
    source = ROOT / "checkpoints/cargo90"
    bundle = replace(read_bundle(source), choice=choice().to_dict(), calibration=None)
    write_choice(bundle, source, tmp_path / "copy", model_card(bundle))
    assert (tmp_path / "copy/model.safetensors").read_bytes() == (source / "model.safetensors").read_bytes()
    before, after = (json.loads((folder / "config.json").read_text()) for folder in (source, tmp_path / "copy"))
    assert set(before) - set(after) == {"calibration"}
    assert {k: v for k, v in before.items() if k != "calibration"} == {k: v for k, v in after.items() if k != "choice"}
    again = Predictor.load(tmp_path / "copy").choice
    np.testing.assert_array_equal(again.place["order"], FADING)
    assert again.to_dict() == choice().to_dict()
    assert "mixed with caa_ctra" in (tmp_path / "copy/MODEL_CARD.md").read_text()


def test_an_exported_file_chooses_as_its_checkpoint_does(tmp_path):
    """Onnxruntime beside torch: float32 rounding apart one path, with the choice in both (0.2 m and more without)."""
    pytest.importorskip("onnxruntime")
    from aspnn.learning.export import export_onnx

    source = ROOT / "checkpoints/cargo90-thesis"
    bundle = replace(read_bundle(source), choice=choice().to_dict())
    write_choice(bundle, source, tmp_path / "copy", model_card(bundle))
    export_onnx(tmp_path / "copy", tmp_path / "copy.onnx")
    now = voyage().states.until(600.0)
    found, wanted = (Predictor.load(tmp_path / name).predict(now, 0.2) for name in ("copy.onnx", "copy"))
    np.testing.assert_allclose([found.north, found.east], [wanted.north, wanted.east], atol=5e-3)
    plain = Predictor.load(source).predict(now, 0.2)
    assert np.hypot(plain.north - wanted.north, plain.east - wanted.east).max() > 0.2


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"kinematic": "magic"}, "kinematic is magic"),
        ({"time": [1.0, 2.0]}, "shares must be between 0 and 1, one for each time"),
        ({"place": {"steady": [1, 2, 0, 0], "order": [0, 0, 0, 0]}}, "shares must be between 0 and 1"),
        ({"time": [1.0, 10.0, 10.0, 30.0]}, "time must rise"),
        ({"heading": {"steady": [0, 0, 0, 0]}}, "'order'"),
        ({"settled": -1.0}, "settled must not be negative"),
    ],
)
def test_a_damaged_choice_is_refused(change, why):
    data = choice().to_dict() | change
    with pytest.raises(
        InputError, match=r"checkpoint boat: config.json: choice is damaged.*run `aspnn choose` again"
    ) as e:
        HybridChoice.from_dict(data, "boat")
    assert why in str(e.value)
