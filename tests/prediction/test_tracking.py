"""Tracking, against ships whose law is known, Bayes' rule, and voyages of cargo90 in her own and in another loading."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from aspnn.estimation import filter_log
from aspnn.evaluation.errors import path_errors
from aspnn.evaluation.evaluate import sees_future
from aspnn.evaluation.reference import Reference
from aspnn.evaluation.windows import SHIP, find_starts
from aspnn.learning.windows import WindowSpec
from aspnn.prediction import tracking
from aspnn.prediction.gru import GruPredictor
from aspnn.prediction.learned import Material, material
from aspnn.prediction.similarity import NAMES, check_similar, midship, similar, stations
from aspnn.prediction.tracked import Tracked
from aspnn.prediction.tracking import follow
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario, simulate_scenario
from aspnn.vessel import load_vessel

ROOT = Path(__file__).parents[2]
PLACE = {name: k for k, name in enumerate(NAMES)}
LENGTHS = {"cargo90": 11.5, "cargo90_ballast": 13.0}


@cache
def flagship() -> GruPredictor:
    return GruPredictor.load(ROOT / "checkpoints/cargo90")


@cache
def voyage(vessel: str):
    """States and reference of 25 minutes of random orders of a vessel, a seed that nothing was tuned on."""
    given = read_scenario(ROOT / "data/scenarios/cargo90-test.toml")
    start = given.start.model_copy(update={"speed_kn": (LENGTHS[vessel],) * 2})
    given = given.model_copy(update={"vessel": vessel, "start": start, "duration_s": 1500.0, "voyages": 1})
    log, truth = next(simulate_scenario(given, 1, 880))
    return filter_log(log), Reference.of_truth(truth)


@cache
def tracked(vessel: str):
    """A tracked predictor that has been through the voyage, and all starts of it."""
    states, reference = voyage(vessel)
    starts = find_starts(states, SHIP)
    begin = states["time_s"][starts.rows]
    return Tracked(flagship()), starts.keep(reference.known(begin, 90.0) & (begin >= 600), "too early")


def parameters(**values: float) -> np.ndarray:
    found = np.zeros(len(NAMES))
    for name, value in values.items():
        found[PLACE[name]] = value
    return found


def answered() -> tuple[Material, np.ndarray]:
    states, _ = voyage("cargo90")
    starts = find_starts(states, SHIP)
    given = material(flagship().bundle, states, starts.rows[:6], starts.plans[:6])
    return given, flagship().velocities(given.history, given.forcing, given.wind)


def test_no_correction_is_the_network_itself():
    """Identity: nine zeros change nothing but the rounding of float32."""
    given, plain = answered()
    network = similar(flagship().velocities, flagship().spec, flagship().bundle.vessel, np.zeros(len(NAMES)))
    np.testing.assert_allclose(network(given.history, given.forcing, given.wind), plain, atol=2e-6)


def linear(gain: float, time: float, drift: float, drag: float):
    """A ship with a law: w (half the sway difference) and v go to `gain` d and `drift` d with `time` [s], u to 5 - drag d^2."""
    spec, vessel = flagship().spec, flagship().bundle.vessel
    bow, stern = vessel.sway_stations

    def network(history, forcing, wind):
        motion = np.concatenate([history[:, -1, :1], midship(history[:, -1, 1:3], bow, stern)], axis=-1)
        found, kept = [motion], np.exp(-spec.period / time)
        for d in forcing[:, :-1, 0].T:
            settled = np.stack([vessel.service_speed - drag * d**2, drift * d, gain * d], axis=-1)
            motion = settled + kept * (motion - settled)
            found.append(motion)
        u, *rest = np.moveaxis(np.stack(found, axis=1), -1, 0)
        return np.concatenate([u[..., None], stations(np.stack(rest, axis=-1), bow, stern)], axis=-1)

    return network


def test_a_corrected_law_is_the_law_of_the_other_ship():
    """Oracle: a linear ship under a held rudder, corrected, answers as the ship whose law has the other gain, speed and time constant."""
    spec, vessel = flagship().spec, flagship().bundle.vessel
    rng = np.random.default_rng(5)
    history = rng.normal(size=(3, spec.history_steps, 4)) * 0.3 + [5.0, 0, 0, 0]
    forcing = np.broadcast_to(rng.uniform(-0.5, 0.5, (3, 1, 1)), (3, spec.horizon_steps + 1, 1)).copy()
    wind = np.zeros((3, 2))
    turn, sway, rudder = 0.3, -0.2, 0.1
    found = similar(linear(0.8, 20.0, -1.5, 4.0), spec, vessel, parameters(turn=turn, sway=sway, rudder=rudder))
    other = linear(0.8 * np.exp(turn + rudder), 20.0, -1.5 * np.exp(sway + rudder), 4.0 * np.exp(2 * rudder))
    np.testing.assert_allclose(found(history, forcing, wind), other(history, forcing, wind), atol=1e-12)
    # Twice the pace: at whole steps the same as half the time constant.
    found = similar(linear(0.8, 20.0, -1.5, 4.0), spec, vessel, parameters(pace=np.log(2.0)))
    np.testing.assert_allclose(
        found(history, forcing, wind), linear(0.8, 10.0, -1.5, 4.0)(history, forcing, wind), atol=1e-12
    )
    # Speed: all of it by a tenth, and half of what the rudder takes of it.
    found = similar(linear(0.8, 20.0, -1.5, 4.0), spec, vessel, parameters(surge=np.log(1.1), slowing=np.log(2.0)))
    end = found(history, forcing, wind)[:, -1, 0]
    d = forcing[:, 0, 0]
    settled = 1.1 * (vessel.service_speed - 4.0 / 2 * d**2)
    np.testing.assert_allclose(end, settled, atol=0.06)  # e^-4.5 of what it was off at the start
    # A neutral rudder that is off is a rudder that is off.
    found = similar(linear(0.8, 20.0, -1.5, 4.0), spec, vessel, parameters(neutral=0.02))
    np.testing.assert_allclose(
        found(history, forcing, wind), linear(0.8, 20.0, -1.5, 4.0)(history, forcing + 0.02, wind), atol=1e-12
    )


def test_ships_of_a_batch_are_each_their_own():
    """Contract: rows with parameters of their own, and blocks of them, answer as one by one."""
    given, _ = answered()
    rng = np.random.default_rng(2)
    many = rng.normal(size=(6, len(NAMES))) * 0.1
    both = [np.concatenate([a, a]) for a in (given.history, given.forcing, given.wind)]
    how = (linear(0.8, 20.0, -1.5, 4.0), flagship().spec, flagship().bundle.vessel)
    whole = similar(*how, many)(*both)
    for k in range(12):
        alone = similar(*how, many[k % 6])(*(a[k : k + 1] for a in both))
        np.testing.assert_allclose(whole[k], alone[0], atol=1e-12)


def test_steps_are_bayes_rule_on_a_linear_ship():
    """Oracle: where ends are linear in the correction, the steps end at the posterior of one regression over all parts, with the random
    walk left out (all parts at one time)."""
    rng, count = np.random.default_rng(7), 12
    A, truth = rng.normal(size=(count, 3, 11)), tracking.PRIOR * rng.normal(size=11)
    ends, variance = A @ truth, np.full((count, 3), 0.04)
    pieces = tracking.Parts(None, ends, np.zeros(count), variance, 30, 30.0)  # type: ignore[arg-type]
    at = tracking._At(0.0, np.zeros(11), np.diag(tracking.PRIOR**2), np.nan, False, 0.0, np.zeros(2))
    for k in range(count):
        at = tracking._step(at, pieces, k, lambda k, x: x @ A[k].T)
        assert not at.restarted
    H = A.reshape(-1, 11)
    information = H.T @ H / (tracking.COARSE**2 * 0.04) + np.diag(tracking.PRIOR**-2)
    np.testing.assert_allclose(at.covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-12)
    expected = np.linalg.solve(information, H.T @ ends.ravel() / (tracking.COARSE**2 * 0.04))
    np.testing.assert_allclose(at.mean, expected, rtol=1e-6, atol=1e-10)


def test_the_ship_of_the_training_is_predicted_as_ever():
    """Contract: where nothing is sure the tracked path is the untracked one, regions and all, bit for bit."""
    states, _ = voyage("cargo90")
    predictor, starts = tracked("cargo90")
    assert not predictor.tracks(states).sure.any()
    found, plain = (p.predict_many(states, starts.rows, starts.plans) for p in (predictor, flagship()))
    for name in ("north", "east", "heading", "surge", "sway", "yaw_rate"):
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))
    np.testing.assert_array_equal(found.spread.covariance, plain.spread.covariance)


def test_another_loading_is_found_and_predicted():
    """Voyage: in ballast, after ten minutes, median errors at 90 s fall to less than a quarter, and most places stay in the regions."""
    states, reference = voyage("cargo90_ballast")
    predictor, starts = tracked("cargo90_ballast")
    known = predictor.tracks(states)
    assert known.sure[known.time > 600].all() and known.gain[-1] > 10 * tracking.SURE
    ends, end = {}, np.array([90.0])
    true = reference.path(states["time_s"][starts.rows], end)
    for name, one in (("tracked", predictor), ("plain", flagship())):
        path = one.predict_many(states, starts.rows, starts.plans).at(end)
        ends[name] = path_errors(path, true).position[:, 0]
        if name == "tracked":
            held = path.region(0.95).contains(true.north, true.east)
    assert len(starts.rows) > 15 and np.median(ends["tracked"]) < 0.25 * np.median(ends["plain"])
    assert held.mean() > 0.85


def test_bit_by_bit_is_all_at_once():
    """Law: a voyage followed in pieces has the corrections it has as a whole, bit for bit, and one path is a row of many."""
    states = voyage("cargo90_ballast")[0].until(700.0)
    bundle, calibration = flagship().bundle, flagship().calibration
    whole = follow(bundle, flagship().velocities, calibration, states)
    known = None
    for until in (100.0, 431.7, 432.0, 700.0):
        known = follow(bundle, flagship().velocities, calibration, states.until(until), known)
        if until == 100.0:
            assert len(known.time) == 3  # the prior, and two parts of half a minute after half a minute of history
    for name in whole._fields:
        np.testing.assert_array_equal(getattr(whole, name), getattr(known, name))
    predictor = Tracked(flagship())
    predictor.tracks(states)
    row = int(np.searchsorted(states["time_s"], 600.0))
    now = states.until(states["time_s"][row])
    remembering, fresh = predictor.predict(now, 0.2), Tracked(flagship()).predict(now, 0.2)
    np.testing.assert_array_equal(remembering.north, fresh.north)
    np.testing.assert_array_equal(remembering.spread.covariance, fresh.spread.covariance)
    row_of_fan = predictor.fan(now, [0.1, 0.2])[1]
    np.testing.assert_allclose(row_of_fan.north, fresh.north, atol=1e-3)


def test_the_future_is_not_seen():
    """Law: later rows of the states move no tracked prediction."""
    states, _ = voyage("cargo90_ballast")
    _, starts = tracked("cargo90_ballast")
    assert not sees_future(Tracked(flagship()), states, starts.rows[::20], starts.plans[::20])


def test_another_voyage_is_begun_anew():
    """Contract: what is remembered of one voyage is not taken for another that begins at the same time."""
    predictor = Tracked(flagship())
    first, second = voyage("cargo90_ballast")[0].until(400.0), voyage("cargo90")[0].until(400.0)
    predictor.tracks(first)
    np.testing.assert_array_equal(predictor.tracks(second).mean, Tracked(flagship()).tracks(second).mean)


def test_a_sudden_change_gives_the_variance_back():
    """Law: two parts running far beyond their variance restart the belief; the first of them alone does not."""
    rng = np.random.default_rng(8)
    A = rng.normal(size=(8, 3, 11)) * np.array([[1.0], [1.0], [0.03]])  # headings stay below half a turn
    ends = np.stack([A[k] @ (tracking.PRIOR * (1.0 if k < 5 else -6.0)) for k in range(8)])
    pieces = tracking.Parts(None, ends, np.arange(8) * 30.0, np.full((8, 3), 1e-4), 30, 30.0)  # type: ignore[arg-type]
    at, restarts, traces = (
        tracking._At(0.0, np.zeros(11), np.diag(tracking.PRIOR**2), np.nan, False, 0.0, np.zeros(2)),
        [],
        [],
    )
    for k in range(8):
        at = tracking._step(at, pieces, k, lambda k, x: x @ A[k].T)
        restarts.append(at.restarted)
        traces.append(np.trace(at.covariance))
    assert restarts[:6] == [False] * 6 and restarts[6]
    assert traces[6] > 1.5 * traces[4]


def test_another_loading_is_the_same_ship():
    """Contract: checkpoints of a ship take logs of her other loadings, by `loading_of`, and still no other ship's."""
    ballast, design = load_vessel("cargo90_ballast"), load_vessel("cargo90")
    assert ballast.ship == design.ship == "cargo90" and ballast.other_hull(design) is None
    states = replace(voyage("cargo90")[0], vessel=replace(ballast, loading_of=""))
    with pytest.raises(InputError, match="vessel cargo90_ballast, but checkpoint cargo90 was trained on cargo90"):
        Tracked(flagship()).tracks(states)


def test_what_cannot_be_tracked_is_named():
    """Bad input: one line that names the checkpoint and what it lacks."""
    spec = WindowSpec(30.0, 90.0, 1.0, ("surge", "sway_bow", "sway_stern", "drift"), ("rudder_angle",))
    with pytest.raises(InputError, match="boat: sees drift"):
        check_similar(spec, "boat")
    with pytest.raises(InputError, match="boat: does not see the rudder plan"):
        check_similar(replace(spec, inputs=("surge", "sway_bow", "sway_stern"), forcings=()), "boat")
    bare = replace(flagship().bundle, calibration=None)
    with pytest.raises(InputError, match="cargo90: is not calibrated"):
        Tracked(GruPredictor(bare))
