"""What studies share, and the rows of the ablations: what they change, and that a study that was stopped goes on."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aspnn.cli import guarded
from aspnn.learning.config import read_training
from aspnn.learning.network import RolloutGru, RolloutSizes, path_of
from aspnn.learning.train import Material, training_material
from aspnn.learning.windows import Windows
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario, simulate_scenario
from aspnn.vessel import load_vessel

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import ablations  # noqa: E402
import study  # noqa: E402

FLAGSHIP = read_training(ROOT / "training/cargo90.toml")


def score(median: float, p95: float = 2.0):
    """One group at one horizon."""
    return {
        "position_m": {"median": median, "p95": p95, "mean": median},
        "heading_deg": {"median_abs": median / 10, "p95_abs": p95 / 10, "median_signed": 0.0},
    }


def result(median: float):
    """What a row and seed leave behind."""
    return {"scores": {group: score(median) for group in study.GROUPS}, "validation_loss": 0.1, "cpu_s": 1.0}


@pytest.fixture
def windows():
    """Made-up windows of the flagship's spec whose paths are those of their velocities."""
    rng, spec = np.random.default_rng(1), FLAGSHIP.windows.spec()
    target = rng.normal([6, 0.5, -0.3], 0.2, (5, spec.horizon_steps + 1, 3)).astype(np.float32)
    path = path_of(torch.from_numpy(target), spec.period, 35.0, -35.0).numpy()
    history = rng.normal(size=(5, spec.history_steps, len(spec.inputs))).astype(np.float32)
    forcing = rng.normal(size=(5, spec.horizon_steps + 1, len(spec.forcings))).astype(np.float32)
    wind, start = rng.normal(size=(5, 2)).astype(np.float32), np.arange(5.0)
    return Windows(spec, history, forcing, target, path, wind, start, np.zeros(5, np.int64), ("made",))


def test_cells_and_ratios():
    """Oracle: by hand. Medians over seeds, range of the medians, tenths from 5 m on; ratios are against the median seed."""
    values = [score(0.8, 2.0), score(1.0, 2.4), score(0.9, 2.2)]
    assert study.cells(values) == ["0.90 / 2.20 (0.80-1.00)", "0.09 / 0.22 (0.08-0.10)"]
    assert study.cells([score(13.04, 35.2)])[0] == "13.0 / 35.2"
    assert study.ratio(values, [score(0.4), score(0.5), score(9.0)], "position_m", "median") == pytest.approx(
        (1.8, 1.6, 2.0)
    )


def test_results_are_kept(tmp_path):
    """Oracle: the file. What was put is there in another session; what cannot be written leaves the file as it was; a file of
    another study, and what is no file of a study, are refused.
    """
    file, made = tmp_path / "results.json", {"voyages": 25, "shifts": (1, 2)}
    study.Kept(file, made).put("flagship 1", {"m": 0.9})
    kept = study.Kept(file, made)
    assert "flagship 1" in kept and "flagship 2" not in kept and kept["flagship 1"] == {"m": 0.9}
    before = file.read_bytes()
    with pytest.raises(TypeError):
        kept.put("flagship 2", object())
    assert file.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["results.json"]
    with pytest.raises(InputError, match=r"another voyages.*--out"):
        study.Kept(file, {**made, "voyages": 30})
    file.write_text("[]")
    with pytest.raises(InputError, match="no results"):
        study.Kept(file, made)


def test_rows_change_one_thing():
    """Oracle: the flagship's file. Every row has a name of its own and is a valid training; only rows that do something else than
    change the file are the same training, and none leaves everything as it is.
    """
    names = [choice.name for choice in ablations.CHOICES]
    assert len(set(names)) == len(names) and names[0] == "flagship"
    plain = ablations.Choice("", "")
    for choice in ablations.CHOICES[1:]:
        changed = FLAGSHIP.changed(choice.changes) != FLAGSHIP.changed({})
        done = [
            name
            for name in ("vessel", "hours", "taught", "added", "use")
            if getattr(choice, name) != getattr(plain, name)
        ]
        assert changed == bool(choice.changes), choice.name
        assert changed + (len(done) > 0 and not changed) == 1, choice.name
    with pytest.raises(InputError, match=r"--rows: servo-of is not known; choose among flagship"):
        ablations.chosen(["servo-of"])
    assert [choice.name for choice in ablations.chosen(["mirror"])] == ["flagship", "mirror"]


@pytest.mark.parametrize("count", [1, 3, 5, 9])
def test_rows_take_the_steps_of_the_flagship(windows, count):
    """Oracle: the number of steps, epochs times batches, against a flagship of `count` windows. No window is left out, and none is
    taken twice as often as another, but for one time more.
    """
    training = FLAGSHIP.changed({"fit.batch": 1})
    material, taken = ablations.paced(Material(load_vessel("cargo90"), windows, None, {}), training, count)
    steps = taken.fit.epochs * len(material.train)
    assert abs(steps - 30 * count) <= len(material.train) / 2
    _, often = np.unique(material.train.start, return_counts=True)
    assert len(often) == len(windows) and np.ptp(often) <= 1
    assert taken.changed({"fit.epochs": 30}) == training.changed({})


def test_mirror(windows):
    """Oracle: the exact path of the mirrored velocities. It is the mirror image of the path; twice mirrored is the same."""
    both = ablations.mirrored(windows)
    assert len(both) == 2 * len(windows)
    image = both.select(np.arange(5, 10))
    drawn = path_of(torch.from_numpy(image.target), 1.0, 35.0, -35.0).numpy()
    # In a mirror the bow still leads: both sways change sign, so the turn does.
    np.testing.assert_allclose(image.path, drawn, atol=1e-3)
    assert np.array_equal(image.forcing, -windows.forcing) and np.array_equal(
        image.history[..., 0], windows.history[..., 0]
    )
    again = ablations.mirrored(image).select(np.arange(5, 10))
    for name in ("history", "forcing", "target", "path", "wind"):
        assert np.array_equal(getattr(again, name), getattr(windows, name)), name


def test_without_plan(windows):
    """Oracle: another plan. The network answers the same whatever the plan; it does not without the wrapper."""
    torch.manual_seed(0)
    network = RolloutGru(RolloutSizes(4, 1, (0, 1, 2), 35.0, -35.0, 1.0)).eval()
    history, forcing, wind = (torch.from_numpy(a) for a in (windows.history, windows.forcing, windows.wind))
    blind = ablations.Unplanned(network)
    with torch.inference_mode():
        assert torch.equal(blind(history, forcing, wind), blind(history, 2 * forcing, wind))
        assert not torch.equal(network(history, forcing, wind), network(history, 2 * forcing, wind))
    assert not ablations.unplanned(windows).forcing.any()


def test_vessels_of_rows():
    """Oracle: by hand. A servo of 2.32 deg/s made 1 deg/s faster or slower; E34: Paper V's q over the step of 0.1 s."""
    vessel = load_vessel("cargo90")
    assert np.degrees(ablations.faster(ablations.RATE)(vessel).rudder_rate) == pytest.approx(3.32)
    assert np.degrees(ablations.faster(-ablations.RATE)(vessel).rudder_rate) == pytest.approx(1.32)
    noise = ablations.printed(vessel).noise
    assert noise.yaw_jerk_density == pytest.approx(1.7453293e-13, rel=1e-6, abs=0) and noise.jerk_density == 1e-6
    assert (
        replace(noise, yaw_jerk_density=vessel.noise.yaw_jerk_density, jerk_density=vessel.noise.jerk_density)
        == vessel.noise
    )


def test_servo_of_the_vessel_file():
    """Oracle: the order in force and the rate. Windows as the vessel file has its servo hold a rudder that goes from where it is at
    the start to its order at that rate, whatever the logs tell; voyages stay where they were.
    """
    scenario = read_scenario(ROOT / "data/scenarios/cargo90-train.toml").model_copy(update={"duration_s": 400.0})
    logs = [log for log, _ in simulate_scenario(scenario, 2)]
    training = FLAGSHIP.changed({"data.validation_voyages": 1, "windows.shifts_s": [], "windows.sliding_s": None})
    made = training_material(training, logs)
    slow = ablations.faster(-ablations.RATE)
    found = ablations.filed(made, training, [study.refitted(log, slow) for log in logs])
    for before, after in ((made.train, found.train), (made.validation, found.validation)):
        assert after.voyages == before.voyages and np.array_equal(after.history, before.history)
        angle, order = np.degrees(after.forcing[..., 0].T), np.degrees(before.forcing[:, 30, 0])
        expected = angle[0] + np.clip(order - angle[0], -1.32 * 5, 1.32 * 5)
        np.testing.assert_allclose(angle[5], expected, atol=1e-3)
        assert np.abs(angle[5] - np.degrees(before.forcing[:, 5, 0])).max() > 3


def test_study_goes_on(tmp_path, monkeypatch, capsys):
    """Oracle: what was asked for. A stopped study makes only what is missing, and shows all rows that have results."""
    asked = []

    class Made:
        """A study that trains nothing."""

        def __init__(self, training, out, voyages):
            pass

        def run(self, choice, seed):
            if choice.name == "mirror" and "stop" in asked:
                raise KeyboardInterrupt
            asked.append(f"{choice.name} {seed}")
            return result({"flagship": 1.0, "mirror": 1.5, "tenth": 3.0}[choice.name] * (1 + seed / 5))

        def oracle(self):
            counts = dict.fromkeys(study.GROUPS, 7)
            return {"scores": {group: score(0.6) for group in study.GROUPS}, "counts": counts}

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["ablations.py", "--out", str(tmp_path), *words])
        monkeypatch.setattr(ablations, "Study", Made)
        guarded(ablations.main)
        return capsys.readouterr().out

    asked.append("stop")
    with pytest.raises(SystemExit):
        run("--rows", "mirror", "--seeds", "1")
    assert asked == ["stop", "flagship 1"]
    asked.clear()
    page = tmp_path / "page.html"
    out = run("--rows", "mirror", "--seeds", "2", "--report", str(page), "--json", str(tmp_path / "all.json"))
    assert asked == ["mirror 1", "flagship 2", "mirror 2"]
    row = next(line for line in out.splitlines() if line.startswith("| mirror images"))
    # Medians 1.8 and 2.1 against 1.2 and 1.4.
    assert "| 1.95 / 2.00 (1.80-2.10) |" in row and "| 1.50 (1.38-1.62) |" in row and row.endswith("| 2 |")
    asked.clear()
    assert "| a tenth of the epochs |" in run("--rows", "tenth", "--seeds", "1") and asked == ["tenth 1"]
    assert set(json.loads((tmp_path / "all.json").read_text())["results"]) == {
        *("oracle", "flagship 1", "flagship 2", "mirror 1", "mirror 2")
    }
    text = page.read_text()
    assert text.count("<svg") == 1 and "<script" not in text and "http-equiv" in text
    assert "7 windows of new_order" in text
