"""Oracles: predictors with known errors; the form of metrics.json in architecture.md; the law that nobody sees the future."""

import io
import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.evaluation.evaluate import evaluate, metrics, ratios, sees_future, table, write_metrics
from aspnn.evaluation.reference import Reference, Voyage
from aspnn.evaluation.windows import MODEL_SHIP, SHIP, find_starts
from aspnn.prediction import baselines
from aspnn.records import Log, write_table
from aspnn.schema import InputError
from tests.evaluation.conftest import Cheat, Held, Planner, nomoto_voyage


@pytest.fixture(scope="module")
def evaluation(voyages):
    return evaluate([Planner("flagship", 1.0), Held()], voyages, SHIP, seed=7)


def test_perfect_and_shifted_predictors():
    """Analytic: the truth itself has no error, the truth moved by 3 m north and 4 m east and turned by 2 deg has exactly that."""
    voyage = nomoto_voyage()
    shifted = Cheat(voyage.reference, 3.0, 4.0, math.radians(2), name="shifted")
    scores = metrics(evaluate([Cheat(voyage.reference), shifted], [voyage], SHIP))["predictors"]
    perfect, moved = (scores[name]["order"]["horizons"]["90"] for name in ("cheat", "shifted"))
    assert perfect["position_m"]["p95"] == pytest.approx(0, abs=1e-6)
    assert moved["position_m"] == pytest.approx({"median": 5, "p95": 5, "mean": 5}, abs=1e-6)
    assert moved["heading_deg"] == pytest.approx({"median_abs": 2, "p95_abs": 2, "median_signed": 2}, abs=1e-6)


def test_form_of_metrics(evaluation, tmp_path):
    """architecture.md: the keys of metrics.json, all numbers finite; `order` is new_order and orders_within_horizon."""
    write_metrics(evaluation, tmp_path / "metrics.json")
    content = json.loads((tmp_path / "metrics.json").read_text())
    assert set(content) == {"predictors", "coverage_95", "regions", "windows", "data", "seed"}
    assert set(content["predictors"]) == {"flagship", "constant"} and content["seed"] == 7
    assert content["coverage_95"] == content["regions"] == {}  # neither has regions: see test_coverage
    for groups in content["predictors"].values():
        counts = {group: groups[group]["n"] for group in groups}
        assert set(groups) == {"new_order", "orders_within_horizon", "order", "steady"}
        assert counts["order"] == counts["new_order"] + counts["orders_within_horizon"]
        assert counts["order"] + counts["steady"] == content["windows"] == len(evaluation.windows)
        for part in groups.values():
            assert list(part["horizons"]) == (["15", "30", "45", "60", "75", "90"] if part["n"] else [])
            for at in part["horizons"].values():
                assert set(at["position_m"]) == {"median", "p95", "mean"}
                assert set(at["heading_deg"]) == {"median_abs", "p95_abs", "median_signed"}
    assert all(entry["reference"] == "truth" for entry in content["data"])


def test_all_predictors_see_the_same_windows(voyages, evaluation):
    """Pairing: every array has one row per window, in the order of the windows found voyage by voyage."""
    expected = [find_starts(v.states, SHIP) for v in voyages]
    times = np.concatenate([v.states["time_s"][s.rows] for v, s in zip(voyages, expected, strict=True)])
    np.testing.assert_array_equal(evaluation.windows["time_s"], times)
    for errors in evaluation.errors.values():
        assert errors.position.shape == (len(times), len(evaluation.times))


def test_errors_of_the_wrong_time_constant_are_found(evaluation):
    """Law: a ship model that is nearly right beats the arc that ignores the order, and by more than its interval."""
    ratio = ratios(evaluation, "new_order", 90.0, "constant")["flagship"]
    assert 0 < ratio.low < ratio.value < ratio.high < 0.2


class Peeking(Held):
    """Uses the last row of the voyage."""

    def predict_many(self, states, rows, plans):
        return super().predict_many(states, np.full(len(rows), len(states) - 1), plans)


def kinematics(vessel):
    return [Held(), Planner(), *baselines(vessel, 90.0)]


@pytest.mark.parametrize("number", range(5))
def test_nobody_sees_the_future(voyages, number):
    """Law: when later rows change, the prediction stays bit by bit the same; and the check catches one who peeks."""
    states = voyages[0].states
    starts = find_starts(states, SHIP)
    predictor = kinematics(states.vessel)[number]
    assert not sees_future(predictor, states, starts.rows[:3], starts.plans[:3])
    assert sees_future(Peeking(), states, starts.rows[:1], starts.plans[:1])


def test_unmeasured_reference_is_excluded_and_counted():
    """By hand: the reference coasts from 700 to 705 s, so no window may hold an instant between them."""
    voyage = nomoto_voyage()
    time = voyage.reference.time
    gap = replace(voyage.reference, coasting=(time >= 700) & (time <= 705))
    result = evaluate([Held()], [replace(voyage, reference=gap)], SHIP)
    begin = result.windows["time_s"].to_numpy()
    everything = evaluate([Held()], [voyage], SHIP).windows["time_s"].to_numpy()
    touched = (everything + 90 >= 700) & (everything <= 705)
    assert touched.any()
    np.testing.assert_array_equal(begin, everything[~touched])
    assert result.data[0]["excluded"]["no measured reference within the horizon"] == touched.sum()


def test_reference_is_known_from_the_start_to_the_end_of_the_horizon():
    """By hand: rows every second from 0 to 10 s, coasting at 6 s; 3 s from 2, 3, 6, 7 and 8 s, and from -1 s."""
    time = np.arange(11.0)
    reference = Reference("smoothed", *[time] * 7, coasting=time == 6)
    starts = np.array([2.0, 3.0, 6.0, 7.0, 8.0, -1.0])
    assert list(reference.known(starts, 3.0)) == [True, False, False, True, False, False]


def test_reference_that_ends_early_is_not_extrapolated():
    voyage = nomoto_voyage()
    short = Reference.of_truth(voyage.truth.iloc[:1000])
    windows = evaluate([Held()], [replace(voyage, reference=short)], SHIP).windows
    assert len(windows) > 0 and windows["time_s"].max() + 90 <= short.time[-1] + 1e-6


def test_oracle_is_left_out_where_one_voyage_has_no_truth(voyages):
    """Pairing comes first: without truth in one voyage the oracle is scored nowhere, and the reason is told."""

    def oracle(voyage):
        if voyage.name == voyages[1].name:
            raise InputError(f"{voyage.name} has no truth beside it, so there is no oracle")
        return Planner("oracle")

    result = evaluate([Held()], voyages, SHIP, oracle=oracle)
    assert list(result.errors) == ["constant"] and "has no truth" in result.left_out["oracle"]
    assert list(evaluate([Held()], voyages[:1], SHIP, oracle=oracle).errors) == ["constant", "oracle"]


@pytest.mark.parametrize(
    ("predictors", "message"),
    [
        ([Held(), Held()], "two predictors are named constant"),
        ([Held(horizon=60.0)], "predicts 60 s, 90 s are needed"),
        ([Planner("wild", slack=math.nan)], "is not finite"),
    ],
)
def test_bad_predictors_are_named(voyages, predictors, message):
    with pytest.raises(InputError, match=message):
        evaluate(predictors, voyages[:1], SHIP)


def test_no_window_is_an_error_that_tells_why():
    with pytest.raises(InputError, match=r"no window to score in 1 voyages.*120 s before its start and 90 s after"):
        evaluate([Held()], [nomoto_voyage(duration=150.0)], SHIP)


def test_table_names_every_group_and_predictor(evaluation):
    """What the command line prints: one row for each predictor in each group, within 90 columns."""
    from rich.console import Console

    console = Console(width=90, record=True, file=io.StringIO())
    console.print(table(evaluation))
    text = console.export_text()
    for group in ("new_order", "steady"):
        assert group in text
    assert text.count("flagship") == len([g for g in SHIP.headline if len(evaluation.rows(g))])
    assert "true path at midship" in text


def test_voyage_takes_the_truth_and_else_the_smoothed_states(tmp_path):
    """Contract: truth beside the log is the reference; without it the log is smoothed; filtered states are refused."""
    made = nomoto_voyage(duration=60.0)
    path = tmp_path / "run.parquet"
    write_table(pd.DataFrame({"time_s": [0.0, 1.0]}), path, {})
    engine = pd.DataFrame({"time_s": [0.0, 30.0], "engine_order_rps": [2.0, 2.5]})
    log = Log(engine, made.states.vessel, path=str(path))
    smooth = replace(made.states, smoothed=True)
    bare = Voyage.of(log, made.states, lambda _: smooth)
    assert (bare.reference.kind, bare.truth, bare.name, len(bare.sha256)) == ("smoothed", None, "run.parquet", 64)
    np.testing.assert_array_equal(bare.shaft.values, [2.0, 2.5])
    write_table(made.truth, tmp_path / "run.truth.parquet", {})
    assert Voyage.of(log, made.states, lambda _: smooth).reference.kind == "truth"
    with pytest.raises(InputError, match="filtered states are no reference"):
        Reference.of_states(made.states)
    with pytest.raises(InputError, match="know the future"):
        Voyage.of(log, smooth, lambda _: smooth)


def test_model_ship_headline_is_order_and_steady():
    """The rule of model ships: horizons 10, 20, 30 s and the group `order` in front."""
    voyage = nomoto_voyage(vessel="kvlcc2_l7")
    result = evaluate([Held(horizon=30.0)], [voyage], MODEL_SHIP)
    assert list(metrics(result)["predictors"]["constant"]["order"]["horizons"]) == ["10", "20", "30"]
