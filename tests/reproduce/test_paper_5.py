"""The script that reproduces Paper V: its starts, its errors, and what it says of them, on the validation manoeuvre alone."""

import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.cli import guarded
from aspnn.evaluation.reference import Reference
from aspnn.evaluation.windows import NEW, STEADY
from aspnn.motion import Path as Track
from aspnn.prediction.gru import GruPredictor
from aspnn.prediction.kinematic import KinematicPredictor, caa_cmm, caa_ctra
from aspnn.simulation import simulate_scenario
from aspnn.vessel import load_vessel

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import paper_5  # noqa: E402
import paper_5_figures  # noqa: E402
import paper_5_tables  # noqa: E402


@dataclass(frozen=True)
class Knowing:
    """The true path, moved 3 m north and 4 m east and turned by `turn` [rad]."""

    name: str
    reference: Reference
    moved: float = 0.0
    turn: float = 0.0

    def predict_many(self, states, rows, plans) -> Track:
        path = self.reference.path(states["time_s"][rows], np.arange(0, 90.1, 0.5))
        return replace(
            path,
            north=path.north + 3 * self.moved,
            east=path.east + 4 * self.moved,
            heading=path.heading + self.turn,
        )


@pytest.fixture(scope="module")
def found():
    """The manoeuvre under methods of known errors and the kinematic ones; its windows with the paper's names; what was kept."""
    scenario, vessel = paper_5.manoeuvre(), load_vessel("cargo90")
    _, truth = next(simulate_scenario(scenario, 1))
    reference = Reference.of_truth(truth)
    methods = [
        Knowing("gru_pp", reference, 1.0, math.radians(-10)),
        KinematicPredictor(vessel, caa_ctra),
        KinematicPredictor(vessel, caa_cmm),
        Knowing("flagship", reference),
    ]
    whole, sailed = paper_5.compared(scenario, 1, methods)
    exercise, names = paper_5.labelled(whole)
    return exercise, names, sailed


def test_predictions_start_at_the_orders(found):
    """Oracle: Paper V, figures 10 to 14 in its words: seven new orders, t_C from 0 to 5 deg and less than t_A and t_E; three without."""
    exercise, names, _ = found
    assert names == [f"t_{letter}" for letter in "ABCDEFG"] + ["t_ref1", "t_ref2", "t_ref3"]
    windows = exercise.windows
    assert list(windows["group"]) == [NEW] * 7 + [STEADY] * 3
    np.testing.assert_allclose(windows["time_s"][:7], [t for t, _ in paper_5.ORDERS[1:]], atol=1e-6)
    np.testing.assert_allclose(windows["time_s"][7:], paper_5.REFERENCES, atol=1e-6)
    change = dict(zip(names, windows["change_deg"], strict=True))
    np.testing.assert_allclose(list(change.values())[:7], np.diff([order for _, order in paper_5.ORDERS]), atol=1e-9)
    np.testing.assert_allclose(windows["since_s"], [0] * 7 + [150, 90, 120], atol=1e-6)
    assert paper_5_tables.order_words(exercise, 2) == "0 to +5"
    assert abs(change["t_C"]) < min(abs(change["t_A"]), abs(change["t_E"]))


def test_errors_are_those_of_the_paper(found):
    """Oracle: Paper V 5.2. Zero for the truth; moved by (3, 4) m the distance is 5 m; the angle between the unit vectors of heading."""
    exercise, _, _ = found
    np.testing.assert_allclose(exercise.errors["flagship"].position, 0.0, atol=1e-6)
    np.testing.assert_allclose(exercise.errors["flagship"].heading, 0.0, atol=1e-9)
    np.testing.assert_allclose(exercise.errors["gru_pp"].position, 5.0, atol=1e-6)
    for name in exercise.errors:
        true, own = exercise.reference.heading, exercise.paths[name].heading
        between = np.arccos(np.clip(np.cos(true) * np.cos(own) + np.sin(true) * np.sin(own), -1, 1))
        np.testing.assert_allclose(np.abs(exercise.errors[name].heading), between, atol=1e-6)


def test_what_the_text_says_is_measured(found):
    """Oracle: the errors of the method, known beforehand, and of the others worked out from their curves by hand."""
    exercise, _, _ = found
    text = pd.read_csv(paper_5.TEXT, comment="#", index_col="quantity", dtype={"unit": str})
    assert (text["low"] <= text["high"]).all()
    ours = paper_5.quantities(exercise, text, {})
    assert set(ours) | {"parting_epoch"} == set(text.index)
    assert ours["position_90"] == pytest.approx(5, abs=1e-6)
    assert ours["heading_90"] == pytest.approx(-10, abs=1e-6) and ours["heading_90_size"] == pytest.approx(10, abs=1e-6)
    ends = np.stack([exercise.errors[name].position[:, -1] for name in paper_5.KINEMATIC])
    assert ours["new_order_ratio"] == pytest.approx(np.median(ends[:, :7], axis=1).min() / 5)
    assert ours["steady_ratio"] == pytest.approx(np.median(ends[:, 7:], axis=1).min() / 5)
    others = np.delete(ends[:, :7], 2, axis=1)
    assert ours["magnitude"] == pytest.approx(ends[:, 2].min() / np.median(others, axis=1).min())
    assert ours["heading_lead"] == ours["position_onset"] - ours["heading_onset"] > 0


def test_onset_is_the_last_crossing():
    """Oracle: straight lines. 2 t passes 5 at 2.5; a curve that falls back counts from its last rise; never is NaN, always the start."""
    t = np.arange(11.0)
    assert paper_5.onset(t, 2 * t, 5.0) == pytest.approx(2.5)
    assert paper_5.onset(t, np.where(t < 4, 9.0 * (t == 2), t), 5.0) == pytest.approx(5.0)
    assert math.isnan(paper_5.onset(t, 0 * t, 5.0)) and paper_5.onset(t, t + 6, 5.0) == 0.0


def test_losses_part_where_they_were_parted():
    """Oracle: made curves. Equal for 40 epochs, half as much again from then on; one spike does not part them; equal ones never do."""
    epoch = np.arange(100)
    train = np.exp(-epoch / 30)
    valid = train * np.where(epoch < 40, 1.0, 1.5)
    valid[10] *= 3
    assert paper_5_tables.parting(pd.DataFrame({"train_loss": train, "validation_loss": valid})) == 41
    assert math.isnan(paper_5_tables.parting(pd.DataFrame({"train_loss": train, "validation_loss": train})))


def test_printed_update_loses_the_sway(found):
    """Oracle: E41. With perfect velocities the exact step is exact; the printed update is off by the integral of sway, and of surge
    turned by half a step too much.
    """
    exercise, _, sailed = found
    paths = paper_5.reconstruction(exercise, sailed, load_vessel("cargo90"))
    assert paths["exact pivot point"].position.max() < 0.01
    time = np.arange(0.05, 90, 0.1)
    true = sailed[0].reference.path(exercise.windows["time_s"].to_numpy()[:7], time)
    wrong = true.surge * (np.exp(0.05j * true.yaw_rate) - 1) - 1j * true.sway
    lost = np.abs(np.sum(wrong * np.exp(1j * true.heading), axis=1) * 0.1)
    np.testing.assert_allclose(paths["as printed"].position[:, 0], lost, atol=0.02)
    assert np.median(paths["region map (table 4)"].position) < np.median(lost)


def test_shipped_network_is_that_of_table_6():
    """Oracle: Paper V, table 6, and its prediction by regions (table 4)."""
    predictor = GruPredictor.load(ROOT / "checkpoints/cargo90-thesis")
    published = pd.read_csv(paper_5.TABLE_6, comment="#", index_col="quantity")["value"]
    assert paper_5.settings(predictor.bundle) == published.to_dict()
    methods = {m.name: m for m in paper_5.predictors([predictor], predictor)}
    assert list(methods) == ["gru_pp", "gru_exact", "caa_ctra", "caa_cmm", "flagship"]
    assert methods["gru_pp"].region_map and not methods["gru_exact"].region_map


def test_figures_are_the_papers(found, tmp_path):
    """Oracle: the paper's list, figures 10 to 17; figure 11 only with loss curves; icons every 15 s (true and four predicted)."""
    exercise, names, sailed = found
    vessel, reference = load_vessel("cargo90"), sailed[0].reference
    track = reference.path(reference.time[:1], reference.time)[0]
    drawn = paper_5_figures.figures(track, paper_5.ORDERS, exercise, names, exercise, vessel, {})
    assert list(drawn) == [10, 12, 13, 14, 15, 16, 17]
    (file,) = paper_5_figures.write_figures(tmp_path, {10: drawn[10]})
    assert file.name == "paper_5_fig_10.png" and file.read_bytes().startswith(b"\x89PNG")
    curve = pd.DataFrame({"epoch": [0, 1], "train_loss": [1.0, 0.5], "validation_loss": [1.0, 0.6]})
    assert len(paper_5_figures.curves_figure(dict.fromkeys(paper_5.TARGETS, curve)).axes) == 3
    panel = drawn[12].axes[0]
    assert len(panel.patches) == 7 + 4 * 6 and "0 to +20" in panel.get_title()


def test_no_voyages_is_one_line(tmp_path, monkeypatch, capsys):
    """Oracle: the rule of the project: exit code 2, one line that says what to do, nothing written."""
    out = tmp_path / "out.json"
    monkeypatch.setattr(sys, "argv", ["paper_5.py", "--voyages", "0", "--json", str(out)])
    with pytest.raises(SystemExit) as ended:
        guarded(paper_5.main)
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1 and "--voyages 0" in said and not out.exists()
