"""The shipped checkpoints: laws of the family, accuracy on voyages no training has seen, and what loading costs."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import aspnn
from aspnn.estimation import filter_log
from aspnn.evaluation.evaluate import evaluate, sees_future
from aspnn.evaluation.oracle import Oracle
from aspnn.evaluation.reference import Reference, Voyage
from aspnn.evaluation.windows import SHIP, find_starts
from aspnn.motion.pivot import REGION_CENTRES
from aspnn.orders import Orders, Plan
from aspnn.prediction import baselines
from aspnn.prediction.gru import GruPredictor
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario, simulate_scenario
from aspnn.vessel import load_vessel
from tests.test_imports import modules_after

ROOT = Path(__file__).parents[2]
SHIPPED = ("cargo90", "cargo90-thesis")
LAWFUL = (*SHIPPED, "cargo90-wind")


@cache
def voyages() -> tuple[Voyage, ...]:
    """Four voyages of a seed that neither training nor the published test has."""
    scenario = read_scenario(ROOT / "data/scenarios/cargo90-test.toml")
    made = simulate_scenario(scenario, 4, seed=90_001)
    return tuple(Voyage(filter_log(log), Reference.of_truth(truth), truth, name=log.voyage) for log, truth in made)


@cache
def shipped(name: str) -> GruPredictor:
    return GruPredictor.load(ROOT / "checkpoints" / name)


def now(time: float = 600.0) -> States:
    return voyages()[0].states.until(time)


@pytest.mark.parametrize("name", LAWFUL)
def test_sees_no_future(name):
    """Law of the family: later rows are changed, the prediction does not move."""
    states = voyages()[0].states
    starts = find_starts(states, SHIP)
    assert not sees_future(shipped(name), states, starts.rows[:5], starts.plans[:5])


@pytest.mark.parametrize("name", LAWFUL)
def test_one_prediction_is_a_row_of_many(name):
    """Law: `predict` from the last state is `predict_many` of that row; starts at the filtered pose."""
    states = voyages()[0].states
    starts = find_starts(states, SHIP)
    row, plan = int(starts.rows[2]), starts.plans[2]
    many = shipped(name).predict_many(states, starts.rows[:6], starts.plans[:6])[2]
    one = shipped(name).predict(states.until(states["time_s"][row]), plan.rudder)
    np.testing.assert_allclose([one.north, one.east], [many.north, many.east], atol=2e-3)  # float32 in other batches
    np.testing.assert_allclose(one.heading, many.heading, atol=1e-5)
    pose = [states[c][row] for c in ("north_m", "east_m", "heading_rad")]
    np.testing.assert_array_equal([one.north[0], one.east[0], one.heading[0]], pose)
    np.testing.assert_allclose(one.true_heading - one.heading, states["convergence_rad"][row])


@pytest.mark.parametrize("name", LAWFUL)
def test_rudder_turns_the_ship_the_right_way(name):
    """Physics: more starboard rudder, more turn to starboard, from any order in force."""
    turned = [
        float(np.diff(shipped(name).predict(now(), math.radians(d)).heading[[0, -1]])[0]) for d in (-30, -15, 0, 15, 30)
    ]
    assert (np.diff(turned) > 0).all()


def test_a_later_order_acts_later():
    """Law of a causal plan: two plans are one path until they differ, for the predictor that reads the plan."""
    predictor = shipped("cargo90")
    held = predictor.predict(now(), math.radians(10))
    changed = predictor.predict(now(), [(0, math.radians(10)), (40, math.radians(-20))])
    np.testing.assert_array_equal(held.heading[:41], changed.heading[:41])
    assert abs(held.heading[-1] - changed.heading[-1]) > math.radians(5)


def test_region_map_and_exact_step_are_one_argument():
    """Paper V's table 4 holds every pivot point of the region map; the exact step's lie between."""
    predictor = shipped("cargo90-thesis")
    assert predictor.region_map
    assert not shipped("cargo90").region_map
    mapped, exact = (replace(predictor, region_map=way).predict(now(), math.radians(20)) for way in (True, False))
    sections = REGION_CENTRES * 90 / 8
    assert np.isin(np.round(mapped.pivot, 6), np.round(sections, 6)).all()
    assert not np.isin(np.round(exact.pivot, 6), np.round(sections, 6)).all()
    assert np.hypot(mapped.north - exact.north, mapped.east - exact.east).max() > 0.1


def test_accuracy_on_unseen_voyages():
    """Four unseen voyages against the targets of 60: flagship within 2 m / 7 m and 0.7 / 3 deg, near the oracle; the thesis
    network as published, 5 to 25 m; baselines tens of metres. A third of the windows of the published table would move
    a median by less than 20 % (bootstrap over voyages), the bounds leave more.
    """
    learned = [shipped(name) for name in SHIPPED]
    result = evaluate([*learned, *baselines(load_vessel("cargo90"))], voyages(), SHIP, oracle=Oracle.of)
    rows, last = result.rows("new_order"), result.column(90)

    def at(name, share):
        return float(np.percentile(result.errors[name].position[rows, last], share))

    turn = np.degrees(np.abs(result.errors["cargo90"].heading[rows, last]))
    assert len(rows) >= 20
    assert at("cargo90", 50) < 2.0
    assert at("cargo90", 95) < 7.0
    assert np.median(turn) < 0.7
    assert np.percentile(turn, 95) < 3.0
    assert at("cargo90", 50) < 2.5 * at("oracle", 50)
    assert 5 < at("cargo90-thesis", 50) < 25
    assert min(at(name, 50) for name in ("caa_ctra", "caa_cmm", "constant")) > 50


@cache
def windy() -> tuple[Voyage, ...]:
    """Four voyages in winds of up to 10 m/s that are measured on board, of a seed that no training, calibration or test has."""
    scenario = read_scenario(ROOT / "data/scenarios/cargo90-wind-test.toml")
    made = simulate_scenario(scenario, 4, seed=90_031)
    return tuple(Voyage(filter_log(log), Reference.of_truth(truth), truth, name=log.voyage) for log, truth in made)


def deaf(voyage: Voyage) -> Voyage:
    """The voyage without its wind sensor."""
    table = voyage.states.table.assign(wind_speed_true_m_s=np.nan, wind_from_grid_rad=np.nan)
    return replace(voyage, states=replace(voyage.states, table=table))


def test_a_measured_wind_is_used():
    """Against the simulator that ignores the wind: over the unseen voyages in wind the network that hears it is better at 90 s in
    median and 95th percentile; without the sensor its errors are larger by half at least.
    """
    network = replace(shipped("cargo90-wind"), bundle=replace(shipped("cargo90-wind").bundle, calibration=None))
    heard, unheard = (evaluate([network], some, SHIP, oracle=Oracle.of) for some in (windy(), map(deaf, windy())))
    last = heard.column(90)
    own, without, oracle = (
        np.percentile(result.errors[name].position[:, last], [50, 95])
        for result, name in ((heard, network.name), (unheard, network.name), (heard, "oracle"))
    )
    assert len(heard.windows) >= 100
    assert (own < oracle).all()
    assert (without > 1.5 * own).all()


@pytest.mark.parametrize("side", [0, 90, 180, 270])
def test_wind_moves_the_ship_as_in_the_simulator(side):
    """Oracle: the simulator run on in 8 m/s and in calm from the same state. What the wind alone does to the place after 90 s, 1.3 to
    4 m, is the simulator's within 1.2 m, about twice the network's median error in wind; a sensor that says none is no sensor.
    """
    voyage, network = voyages()[0], shipped("cargo90-wind")
    row, plan = len(now()) - 1, Plan(Orders.from_series(np.zeros(1), np.zeros(1)))
    origin = now()["heading_rad"][-1] + math.radians(side)

    def place(speed: float) -> np.ndarray:
        """North and east [m] after 90 s by network and simulator, whose sensor and truth have that wind."""
        blown = {"wind_speed_true_m_s": speed, "wind_from_grid_rad": origin}
        states = replace(voyage.states, table=voyage.states.table.assign(**blown))
        assert voyage.truth is not None
        told = replace(voyage, truth=voyage.truth.assign(**blown))
        simulator = Oracle.of(told, SHIP.horizon, knows_wind=True)
        paths = [p.predict_many(s, np.array([row]), [plan]) for p, s in ((network, states), (simulator, states))]
        return np.array([[path.north[0, -1], path.east[0, -1]] for path in paths])

    calm = place(0.0)
    without = network.predict_many(voyage.states, np.array([row]), [plan])
    np.testing.assert_allclose(calm[0], [without.north[0, -1], without.east[0, -1]], atol=1e-6)
    found, wanted = place(8.0) - calm
    assert np.hypot(*wanted) > 1.2
    assert np.hypot(*(found - wanted)) < 1.2


def test_wrong_states_are_refused():
    predictor = shipped("cargo90")
    other = replace(now(), vessel=load_vessel("kvlcc2_full"))
    with pytest.raises(InputError, match="vessel kvlcc2_full, but checkpoint cargo90 was trained on cargo90"):
        predictor.predict(other, 0.0)
    moved = replace(now(), vessel=now().vessel.with_stations(bow=(20.0, 0.0)))
    with pytest.raises(InputError, match=r"bow station 20 m of cargo90, the checkpoint was trained with 35 m"):
        predictor.predict(moved, 0.0)
    with pytest.raises(InputError, match=r"s of history at 5 s, 29\.0 s are needed"):
        predictor.predict(now(5.0), 0.0)


def test_public_api_of_the_readme():
    """`Predictor.load` of the package, and names that stay: the path's arrays end at 90 s."""
    path = aspnn.Predictor.load(ROOT / "checkpoints/cargo90").predict(now(), rudder_plan=math.radians(20))
    assert path.time[-1] == 90
    assert path.north.shape == path.pivot.shape == path.pivot_region(90.0).shape == (91,)


def test_loading_imports_no_training_and_no_plots():
    """sys.modules of a fresh interpreter after loading a checkpoint and predicting once."""
    folder = ROOT / "checkpoints/cargo90"
    code = f"import aspnn; aspnn.Predictor.load({str(folder)!r})"
    modules = modules_after(code)
    assert "torch" in modules
    assert not modules & {"lightning", "pytorch_lightning", "matplotlib", "plotly", "sklearn", "tensorboard"}


def test_wind_beyond_training_and_unheard_wind_are_flagged():
    """Definition of the domain: a network that feels the wind has been in winds up to 14.7 m/s; where none is heard it took it as none."""
    network = shipped("cargo90-wind")

    def outside(speed: float) -> bool:
        table = now().table.assign(wind_speed_true_m_s=speed, wind_from_grid_rad=0.3)
        spread = network.predict(replace(now(), table=table)).spread
        assert spread is not None
        return bool(spread.outside)

    assert [outside(speed) for speed in (0.0, 10.0, 20.0, np.nan)] == [False, False, True, True]
