"""Search: repeats, goes on, shares windows, stops the hopeless, and writes a training file that trains."""

import builtins
import csv
import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from aspnn import cli, workflow
from aspnn.learning import search as module
from aspnn.learning import train
from aspnn.learning.config import read_training, write_training
from aspnn.schema import InputError

pytest.importorskip("optuna")
SCENARIO = """
vessel = "cargo90"
voyages = 3
duration_s = 300
seed = 11
[start]
speed_kn = 11.5
latitude_deg = 69.65
longitude_deg = 18.96
zone = "33N"
heading_deg = "random"
[manoeuvre]
kind = "random-orders"
hold_s = [40, 90]
"""
TRAINING = """
name = "small"
about = "a \\"small\\" one"
[data]
logs = ["logs"]
validation_voyages = 1
[windows]
history_s = 10
horizon_s = 60
period_s = 5
inputs = ["surge", "sway_bow", "sway_stern", "rudder_angle"]
forcings = ["rudder_angle"]
sliding_s = 10
[network]
kind = "rollout"
latent = 8
position_tolerance_m = [0.5, 0.05]
heading_tolerance_deg = [0.5, 0.05]
velocity_tolerance_m_s = 0.1
[fit]
epochs = 3
one_cycle = true
learning_rate = 8e-3
"""
SPACE = """
[search]
fit.learning_rate = { low = 1e-7, high = 3e-2, log = true }
network.latent = { low = 4, high = 8, step = 2 }
windows.inputs = { choices = [["surge", "sway_bow", "sway_stern"], ["surge", "sway_bow", "sway_stern", "rudder_angle"]] }
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with logs and a training file with a search space."""
    place = tmp_path_factory.mktemp("search")
    (place / "scenario.toml").write_text(SCENARIO)
    workflow.simulate_files(place / "scenario.toml", place / "logs")
    (place / "small.toml").write_text(TRAINING + SPACE)
    return place


@pytest.fixture(scope="module")
def whole(place) -> module.Found:
    """Seven trials in one go."""
    return workflow.search_file(place / "small.toml", 7, out=place / "whole")


def told(found: module.Found) -> list:
    """What a search found, without its times and without the numbers of trials (a killed one has one too)."""
    return [replace(trial, number=0, seconds=0.0) for trial in found.trials]


def test_killed_search_goes_on_as_if_nothing_had_happened(place, whole, monkeypatch):
    """Oracle: the same search without the kill, trial by trial and bit by bit; the kill strikes inside the third trial."""
    train_bundle, calls = module.train_bundle, iter(range(100))

    def killed(*given, **named):
        if next(calls) == 2:
            raise KeyboardInterrupt
        return train_bundle(*given, **named)

    with (
        monkeypatch.context() as patch,
        pytest.raises(KeyboardInterrupt, match="2 of 7 trials; the same command goes on"),
    ):
        patch.setattr(module, "train_bundle", killed)
        workflow.search_file(place / "small.toml", 7, out=place / "cut")
    assert told(workflow.search_file(place / "small.toml", 7, out=place / "cut")) == told(whole)
    assert told(workflow.search_file(place / "small.toml", 7, out=place / "whole")) == told(whole)  # nothing left to do


def test_hopeless_trials_end_early(whole):
    """A learning rate of 1e-7 learns nothing: such a trial ends before the last epoch, and the best is none of them."""
    stopped = [t for t in whole.trials if t.loss is None]
    assert stopped
    assert all(t.epochs < 3 for t in stopped)
    assert all(t.epochs == 3 for t in whole.trials if t.loss is not None)
    assert whole.best.loss == min(t.loss for t in whole.trials if t.loss is not None)


def test_best_file_trains_to_the_loss_the_search_saw(place, whole, tmp_path):
    """Oracle: an ordinary training of best.toml from its own folder, and the curve that it writes."""
    workflow.train(whole.config, tmp_path, quiet=True)
    with open(tmp_path / "rollout" / "curves.csv") as file:
        assert float(list(csv.DictReader(file))[-1]["validation_loss"]) == whole.best.loss
    assert read_training(whole.config).network.latent == whole.best.values["network.latent"]
    with open(whole.table) as file:
        rows = list(csv.DictReader(file))
    assert [row["validation_loss"] for row in rows] == ["" if t.loss is None else str(t.loss) for t in whole.trials]
    assert json.loads(rows[0]["windows.inputs"]) == whole.trials[0].values["windows.inputs"]


def test_windows_are_made_once_unless_a_trial_changes_them(place, tmp_path, monkeypatch):
    """Count of the passes over the logs: one for the file's own windows, one for the other inputs, however many trials."""
    passes = []
    material = train.training_material

    def counted(training, *given):
        passes.append(training.windows.inputs)
        return material(training, *given)

    monkeypatch.setattr(module, "training_material", counted)
    found = workflow.search_file(place / "small.toml", 6, out=tmp_path)
    inputs = {tuple(t.values["windows.inputs"]) for t in found.trials}
    assert len(inputs) == 2
    assert sorted(passes) == sorted(inputs)


def test_trials_of_other_histories_are_judged_on_the_same_starts(place):
    """Oracle: the starts themselves; a history four times as long takes those near the start of a voyage from all trials."""
    training = read_training(place / "small.toml")
    searched = training.changed({}).model_copy(
        update={"search": {"windows.history_s": module.Choices(choices=(10, 40))}}
    )
    judge = module._judge(searched)
    made = [
        train.training_material(t, workflow.training_logs(t), judge=judge)
        for t in (training, training.changed({"windows.history_s": 40, "windows.sliding_s": 25}))
    ]
    first, second = (m.validation for m in made)
    assert first.start.tolist() == second.start.tolist() != []
    assert first.start[0] >= 40
    assert made[0].train.start[0] < 40


def test_processes_share_a_study(place):
    """Two processes come to the number of trials that was asked for, each trial with the space's values."""
    (place / "plain.toml").write_text(TRAINING + "[search]\nnetwork.latent = { low = 4, high = 8, step = 2 }")
    found = workflow.search_file(place / "plain.toml", 4, processes=2, out=place / "two")
    assert len(found.trials) == 4
    assert {t.values["network.latent"] for t in found.trials} <= {4, 6, 8}


def test_interrupt_is_one_line(place, tmp_path):
    """Oracle: the command's promise. Ctrl-C inside a trial: exit code 130, one line that says how to go on, a study to go on with."""
    code = "import sys; from aspnn import cli; sys.argv[0] = 'aspnn'; cli.main()"
    words = ["search", place / "small.toml", "--trials", "500", "--out", tmp_path, "--quiet"]
    # A shell that runs the tests in its background ignores interrupts, which children inherit.
    heard = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    running = subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)], stderr=subprocess.PIPE, text=True, **heard
    )
    while not list(tmp_path.glob("trials/*/rollout/curves.csv")) and running.poll() is None:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    errors = running.communicate(timeout=60)[1]
    assert running.returncode == 130, errors
    assert errors.startswith("stopped: ")
    assert errors.endswith(" of 500 trials; the same command goes on\n")
    assert errors.count("\n") == 1


def test_an_interrupt_while_the_lock_changes_hands_is_an_interrupt(place, tmp_path, monkeypatch):
    """Oracle: the command's promise again. Optuna's lock then raises OSError in the handling of the interrupt; without an interrupt
    an OSError stays what it is."""

    def half_taken(*_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            raise FileNotFoundError("journal.log.lock") from None

    monkeypatch.setattr(module._Work, "trial", half_taken)
    with pytest.raises(KeyboardInterrupt, match="0 of 2 trials; the same command goes on"):
        workflow.search_file(place / "small.toml", 2, out=tmp_path)
    monkeypatch.setattr(module._Work, "trial", lambda *_: (tmp_path / "nowhere").read_text())
    with pytest.raises(FileNotFoundError):
        workflow.search_file(place / "small.toml", 2, out=tmp_path)


def test_default_spaces_are_fit_for_their_networks(place):
    """Every default space passes the check that a file's own section passes, and is taken when the file has none."""
    training = read_training(place / "small.toml")
    thesis = {"kind": "thesis"}
    for kind in (training, training.model_validate({**training.model_dump(), "network": thesis, "search": {}})):
        space = module.SPACES[kind.network.kind]
        for path, values in space.items():
            for value in values.probes():
                kind.changed({path: value})


SHIPS = {"identified": "", "hybrid": "ship_epochs = 1", "corrected": "ship_epochs = 1"}


@pytest.mark.parametrize("kind", SHIPS)
def test_a_search_of_a_kind_with_a_ship_runs_without_a_section(place, kind, tmp_path):
    """Oracle: the curves on disk. Trials try the kind's own space; the loss is that of the whole, not that of its ship before."""
    net = f'kind = "{kind}"\n{SHIPS[kind]}' + ("" if kind == "identified" else "\nlatent = 8")
    (place / f"{kind}.toml").write_text(TRAINING.replace('kind = "rollout"\nlatent = 8', net))
    found = workflow.search_file(place / f"{kind}.toml", 2, out=tmp_path)
    assert len(found.trials) == 2
    assert {path for trial in found.trials for path in trial.values} == set(module.SPACES[kind])
    last = {"corrected": "correction-1"}.get(kind, kind)
    with open(tmp_path / "trials" / f"{found.best.number:04d}" / last / "curves.csv") as file:
        assert float(list(csv.DictReader(file))[-1]["validation_loss"]) == found.best.loss
    assert found.best.epochs == 3 + (kind != "identified")


def test_a_ship_that_runs_away_ends_its_trial_not_the_search(place, tmp_path, monkeypatch):
    """Contract: that trial is stopped early without an epoch, the next one goes on."""
    train_bundle, calls = module.train_bundle, iter(range(100))

    def first_runs_away(*given, **named):
        if next(calls) == 0:
            raise train.RunsAway("network.ridge: raise it tenfold")
        return train_bundle(*given, **named)

    monkeypatch.setattr(module, "train_bundle", first_runs_away)
    found = workflow.search_file(place / "small.toml", 2, out=tmp_path)
    assert [(trial.loss is None, trial.epochs) for trial in found.trials] == [(True, 0), (False, 3)]


def test_training_file_comes_back_as_written(place, tmp_path):
    """Oracle: the file it was read from, but for the search space; paths lead to the same logs."""
    training = read_training(place / "small.toml")
    write_training(training, tmp_path / "deep" / "copy.toml")
    copy = read_training(tmp_path / "deep" / "copy.toml")
    assert (copy.folder / copy.data.logs[0]).resolve() == (place / "logs").resolve()
    same = {"folder", "search", "data"}
    assert copy.model_dump(exclude=same) == training.model_dump(exclude=same)


@pytest.mark.parametrize(
    "section, line",
    [
        ("network.latents = { low = 4, high = 8 }", "search.network.latents: cannot be searched"),
        ("fit.seed = { low = 1, high = 8 }", "search.fit.seed: cannot be searched"),
        ("windows.horizon_s = { low = 30, high = 60 }", "search.windows.horizon_s: cannot be searched"),
        ("network.position_tolerance_m = { choices = [[1, 2], [2, 3]] }", "tolerance_m: cannot be searched"),
        ("network.latent = { low = 2, high = 8 }", "search.network.latent: 2: "),
        ("network.latent = { low = 4.0, high = 9.5 }", "search.network.latent: 6.9"),
        ("fit.batch = { low = 8, high = 4 }", "low 8 must be less than high 4"),
        ("fit.batch = { low = 1, high = 4, log = true, step = 1 }", "goes without step"),
        ('windows.inputs = { choices = [["surge"], ["surg"]] }', "input surg is not known"),
        ("windows.history_s = { low = 1, high = 20 }", "period 5 s must be positive"),
        ("fit.batch = 8", "search: fit.batch needs low and high, or choices"),
    ],
)
def test_wrong_spaces_are_one_line(place, tmp_path, section, line):
    path = tmp_path / "wrong.toml"
    path.write_text(TRAINING + "[search]\n" + section)
    with pytest.raises(InputError, match=r"^[^\n]*$") as error:
        read_training(path)
    assert str(error.value).startswith(str(path))
    assert line in str(error.value)


def test_searches_that_cannot_be_are_one_line(place, whole, tmp_path, monkeypatch, capsys):
    text = (place / "small.toml").read_text()
    (place / "blind.toml").write_text(text.replace("validation_voyages = 1", ""))
    (place / "other.toml").write_text(text.replace("epochs = 3", "epochs = 2"))

    def said(*words) -> str:
        monkeypatch.setattr(sys, "argv", ["aspnn", "search", *map(str, words), "--trials", "1", "--quiet"])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        assert stop.value.code == 2
        return capsys.readouterr().err

    assert "a search judges by validation voyages" in said(place / "blind.toml", "--out", tmp_path / "out")
    assert "holds another search" in said(place / "other.toml", "--out", place / "whole")
    real = builtins.__import__

    def without(name, *given, **named):
        if name == "optuna":
            raise ImportError(name)
        return real(name, *given, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    missing = said(place / "small.toml", "--out", tmp_path / "out")
    assert missing == "error: aspnn search needs Optuna: pip install 'aspnn[search]'\n"
    assert not (tmp_path / "out").exists()
