"""The command line end to end on small voyages: what each command promises, and one clear line for what goes wrong."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from safetensors.numpy import load_file

import aspnn
from aspnn import cli, records
from aspnn.evaluation.windows import Rule
from aspnn.frames import to_geodetic
from aspnn.learning.windows import read_windows
from tests.test_imports import modules_after

SCENARIO = """
vessel = "cargo90"
voyages = 3
duration_s = 420
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
[data]
scenario = "scenario.toml"
validation_voyages = 1
[windows]
history_s = 10
horizon_s = 90
period_s = 3
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
epochs = 2
learning_rate = 8e-3
one_cycle = true
"""


def run(*words) -> tuple[int, str]:
    """Exit code and standard error of the command, in this process."""
    import contextlib
    import io

    errors, old = io.StringIO(), sys.argv
    sys.argv = ["aspnn", *map(str, words)]
    try:
        with contextlib.redirect_stderr(errors):
            cli.main()
    except SystemExit as stop:
        return int(stop.code or 0), errors.getvalue()
    finally:
        sys.argv = old
    return 0, errors.getvalue()


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with a scenario, its logs, a training file and the checkpoint trained with it."""
    place = tmp_path_factory.mktemp("cli")
    (place / "scenario.toml").write_text(SCENARIO)
    (place / "small.toml").write_text(TRAINING)
    assert run("simulate", place / "scenario.toml", "--out", place / "logs", "--quiet") == (0, "")
    assert run("train", place / "small.toml", "--out", place / "run", "--quiet")[0] == 0
    return place


@pytest.fixture
def log(place) -> Path:
    return next(iter(records.log_files([place / "logs"])))


def test_simulate_writes_logs_truth_and_manifest(place):
    """Oracle: the manifest's own hashes, and the record contract."""
    logs = records.log_files([place / "logs"])
    manifest = json.loads((place / "logs" / "scenario.manifest.json").read_text())
    assert {entry["file"]: entry["sha256"] for entry in manifest["voyages"]} == {
        p.name: records.sha256(p) for p in logs
    }
    assert all(records.read_truth(records.read_log(path)) is not None for path in logs)
    assert len(logs) == 3


def test_filter_and_windows_write_what_they_say(place, tmp_path):
    assert run("filter", place / "logs", "--out", tmp_path / "states", "--smooth", "--quiet") == (0, "")
    states = sorted((tmp_path / "states").glob("*.states.parquet"))
    smoothed = sorted((tmp_path / "states").glob("*.smoothed.parquet"))
    assert [records.read_states(f).smoothed for f in (*states, *smoothed)] == [False] * 3 + [True] * 3
    assert run("windows", place / "logs", "--spec", place / "small.toml", "--out", tmp_path, "--quiet") == (0, "")
    train, validation = (read_windows(tmp_path / f"{name}.safetensors") for name in ("train", "validation"))
    assert not set(train.voyages) & set(validation.voyages)
    assert train.history.shape[1:] == (3, 4)


def test_training_repeats_bit_by_bit(place, tmp_path):
    """Oracle: the first run's weights; a second copy of the bundle is the same bundle."""
    assert (
        run("train", place / "small.toml", "--out", tmp_path / "run", "--checkpoint", tmp_path / "copy", "--quiet")[0]
        == 0
    )
    first, second = (records.sha256(p / "checkpoint" / "model.safetensors") for p in (place / "run", tmp_path / "run"))
    assert first == second == records.sha256(tmp_path / "copy" / "model.safetensors")


@pytest.mark.parametrize("stream", [False, True])
def test_logs_by_absolute_path_and_streamed(place, tmp_path, stream):
    """Oracle: the weights of the training that simulated the same voyages and held their windows in memory."""
    named = f'logs = ["{place}/logs/*.parquet"]\nstream = {str(stream).lower()}'
    (tmp_path / "logs.toml").write_text(TRAINING.replace('scenario = "scenario.toml"', named))
    assert run("train", tmp_path / "logs.toml", "--out", tmp_path / "run", "--quiet") == (0, "")
    first, second = (records.sha256(p / "checkpoint" / "model.safetensors") for p in (place / "run", tmp_path / "run"))
    assert first == second


def test_members_are_the_seeds_that_follow(place, tmp_path):
    """Oracle: single trainings with those seeds; an ensemble of two holds exactly their weights."""
    config = place / "two.toml"
    config.write_text(TRAINING.replace("latent = 8", "latent = 8\nmembers = 2"))
    assert run("train", config, "--out", tmp_path / "two", "--quiet")[0] == 0
    assert run("train", place / "small.toml", "--seed", 2, "--out", tmp_path / "second", "--quiet")[0] == 0
    both = load_file(tmp_path / "two" / "checkpoint" / "model.safetensors")
    for k, folder in enumerate((place / "run", tmp_path / "second")):
        alone = load_file(folder / "checkpoint" / "model.safetensors")
        assert all(np.array_equal(both[f"members.{k}.{name}"], values) for name, values in alone.items())


def test_evaluate_writes_metrics_in_the_agreed_form(place, tmp_path, monkeypatch, capsys):
    """The contract of metrics.json: predictors, groups, horizons, statistics; every predictor on the same windows."""
    short = Rule(history=20.0, steady_before=10.0)
    monkeypatch.setattr(Rule, "of", staticmethod(lambda vessel: short))
    report, metrics = tmp_path / "report.html", tmp_path / "metrics.json"
    code, _ = run("evaluate", place / "run" / "checkpoint", place / "logs", "--report", report, "--json", metrics)
    assert code == 0
    found = json.loads(metrics.read_text())
    assert set(found["predictors"]) == {"small", "caa_ctra", "caa_cmm", "constant", "oracle"}
    counts = {name: {g: groups[g]["n"] for g in groups} for name, groups in found["predictors"].items()}
    assert all(counts[name] == counts["oracle"] for name in counts)
    entry = found["predictors"]["small"]["order"]["horizons"]["90"]
    assert set(entry["position_m"]) == {"median", "p95", "mean"}
    assert set(entry["heading_deg"]) == {"median_abs", "p95_abs", "median_signed"}
    assert found["predictors"]["oracle"]["order"]["horizons"]["90"]["position_m"]["median"] < 5
    said = capsys.readouterr().out
    assert "small" in said
    assert "Warning: 3 of 3 voyages taught small" in said  # evaluated on its own training voyages
    assert report.stat().st_size > 1e6


@pytest.mark.parametrize("format", ["json", "geojson", "csv"])
def test_predict_starts_where_the_states_are(place, log, capsys, format):
    words = ("--at", 200, "--rudder", "20@0,-10@30", "--horizon", 60, "--format", format)
    assert run("predict", place / "run" / "checkpoint", log, *words) == (0, "")
    text = capsys.readouterr().out
    truth = records.read_truth(records.read_log(log))
    now = truth.iloc[int(np.searchsorted(truth["time_s"], 200 - 1e-6))]
    if format == "json":
        path = json.loads(text)["path"]
        assert path["time_s"][-1] == 60
        assert np.hypot(path["north_m"][0] - now["north_m"], path["east_m"][0] - now["east_m"]) < 2
    elif format == "csv":
        assert len(pd.read_csv(__import__("io").StringIO(text))) == 21
    else:
        assert {f["geometry"]["type"] for f in json.loads(text)["features"]} == {"LineString", "Polygon"}


def test_predict_fans_out_and_chooses(place, log, capsys):
    """One path per order in every format; the chosen order is the nearest to that in force of those that clear."""
    words = ("predict", place / "run" / "checkpoint", log, "--at", 200, "--fan", "-20:20:10")
    truth = records.read_truth(records.read_log(log))
    ahead = truth.iloc[int(np.searchsorted(truth["time_s"], 260))]
    zone = records.read_log(log).zone
    mark = ",".join(f"{np.degrees(a):.7f}" for a in to_geodetic(ahead["north_m"], ahead["east_m"], zone))
    assert run(*words) == (0, "")
    found = json.loads(capsys.readouterr().out)
    assert [entry["rudder_order_deg"] for entry in found["fan"]] == [-20, -10, 0, 10, 20]
    assert "chosen" not in found
    code, said = run(*words, "--clear", f"{mark}@40", "--format", "csv")
    table = pd.read_csv(__import__("io").StringIO(capsys.readouterr().out))
    assert (code, said.count("\n")) == (0, 1)
    assert len(table) == 5 * 31
    _, _ = run(*words, "--clear", f"{mark}@40", "--format", "geojson")
    collection = json.loads(capsys.readouterr().out)
    kinds = [f["properties"]["kind"] for f in collection["features"]]
    assert kinds.count("swept area") == kinds.count("predicted path") == 5
    chosen = collection["chosen"]
    now = aspnn.filter_log(records.read_log(log)).until(200)
    force = np.degrees(now["rudder_order_rad"][-1])
    clear = (
        table[table["clears"]] if table["clears"].any() else table[table["clearance_m"] == table["clearance_m"].max()]
    )
    near = clear["rudder_order_deg"].iloc[(clear["rudder_order_deg"] - force).abs().argmin()]
    np.testing.assert_allclose(abs(chosen["rudder_order_deg"] - force), abs(near - force))
    assert said.startswith(f"rudder {chosen['rudder_order_deg']:g} deg" if chosen["clears"] else "no order of the fan")


@pytest.mark.parametrize("format", ["json", "geojson"])
def test_predict_adds_the_swept_area(place, log, capsys, format):
    words = ("predict", place / "run" / "checkpoint", log, "--at", 200, "--rudder", 10, "--swept", "--format", format)
    assert run(*words) == (0, "")
    assert "swept" in capsys.readouterr().out


def test_region_map_is_one_argument(place, log, capsys):
    """The two ways to the path differ, and the region map reports only places of Paper V's table 4."""
    paths = []
    for way in ("--region-map", "--exact"):
        assert run("predict", place / "run" / "checkpoint", log, "--at", 200, "--rudder", 20, way)[0] == 0
        paths.append(json.loads(capsys.readouterr().out)["path"])
    assert paths[0]["north_m"][-1] != paths[1]["north_m"][-1]
    sections = np.array([0, 1, 2, 3, 4, 5.5, 8.5, 20]) * 90 / 8
    assert all(np.abs(sections - abs(p)).min() < 1e-6 for p in paths[0]["pivot_point_m"])


def test_info_tells_of_checkpoint_log_and_states(place, log, capsys):
    for thing, said in ((place / "run" / "checkpoint", "rollout"), (log, "rudder_order_deg")):
        assert run("info", thing)[0] == 0
        assert said in capsys.readouterr().out


def bad_inputs(place: Path, log: Path, tmp: Path):
    """Commands that cannot be done, and the words of the one line that says so."""
    checkpoint = place / "run" / "checkpoint"
    other = tmp / "other"
    other.mkdir()
    for name in ("config.json", "model.safetensors"):
        (other / name).write_bytes((checkpoint / name).read_bytes())
    config = json.loads((other / "config.json").read_text())
    (other / "config.json").write_text(json.dumps(config | {"format": 99}))
    foreign = tmp / "foreign"
    foreign.mkdir()
    (foreign / "model.safetensors").write_bytes((checkpoint / "model.safetensors").read_bytes())
    vessel = config["vessel"] | {"name": "kvlcc2_full"}
    (foreign / "config.json").write_text(json.dumps(config | {"vessel": vessel}))
    damaged = tmp / "damaged"
    damaged.mkdir()
    (damaged / "config.json").write_text(json.dumps(config))
    (damaged / "model.safetensors").write_bytes(b"x" * 100)
    truncated = tmp / "truncated.parquet"
    truncated.write_bytes(log.read_bytes()[:5000])
    (tmp / "empty.parquet").touch()
    wrong = tmp / "wrong.toml"
    wrong.write_text(
        TRAINING.replace("latent = 8", "latents = 8").replace("scenario.toml", str(place / "scenario.toml"))
    )
    predict = ("predict", checkpoint, log)
    out = ("--out", tmp / "out")
    return {
        "rudder beyond the stops": ((*predict, "--at", 100, "--rudder", 40), "beyond the 35 deg stops"),
        "order beyond the horizon": ((*predict, "--at", 100, "--rudder", "5,10@95"), "beyond the horizon of 90 s"),
        "no number": ((*predict, "--at", 100, "--rudder", "hard"), "DEG or DEG@SECONDS"),
        "fan and rudder": ((*predict, "--at", 100, "--rudder", 5, "--fan", "-5:5:5"), "--fan and --rudder exclude"),
        "fan beyond the stops": (
            (*predict, "--at", 100, "--fan", "-40:40:5"),
            "-40 deg at 0 s is beyond the 35 deg stops",
        ),
        "no fan": ((*predict, "--at", 100, "--fan", "5"), "is not FROM:TO:STEP"),
        "clear without fan": ((*predict, "--at", 100, "--clear", "69,18@50"), "add --fan FROM:TO:STEP"),
        "soonest of nothing": ((*predict, "--at", 100, "--fan", "-5:5:5", "--soonest"), "add --clear"),
        "clear without metres": (
            (*predict, "--at", 100, "--fan", "-5:5:5", "--clear", "69,18"),
            "is not LAT,LON@METRES",
        ),
        "clear without file": ((*predict, "--at", 100, "--fan", "-5:5:5", "--clear", "no.geojson@5"), "no such file"),
        "swept csv": ((*predict, "--at", 100, "--swept", "--format", "csv"), "--swept has no form in csv"),
        "short history": ((*predict, "--at", 3, "--rudder", 5), "s of history at 3 s"),
        "outside the log": ((*predict, "--at", 999), "outside the log, which runs from 0 to"),
        "horizon too long": ((*predict, "--at", 100, "--horizon", 91), "beyond the 90 s"),
        "other version": (("predict", other, log, "--at", 100), "checkpoint format 99"),
        "other vessel": (("predict", foreign, log, "--at", 100), "was trained on kvlcc2_full"),
        "damaged weights": (("info", damaged), "does not match config.json"),
        "no checkpoint": (("info", tmp), "is no checkpoint"),
        "no log": (("filter", tmp / "absent.parquet", *out), "no such file"),
        "truncated log": (("filter", truncated, *out), "truncated.parquet: cannot be read"),
        "empty log": (("filter", tmp / "empty.parquet", *out), "the file is empty"),
        "no scenario": (("simulate", tmp / "absent.toml", *out), "no such file"),
        "unknown key": (("train", wrong, *out), "network.latents: is not a known key"),
        "no map": (("import", "csv", log, *out), "--map"),
    }


def test_bad_input_is_one_line_and_exit_code_2(place, log, tmp_path):
    """Each wrong input: one line that names it, exit code 2, no traceback, nothing written."""
    for case, (words, reason) in bad_inputs(place, log, tmp_path).items():
        code, text = run(*words)
        assert code == 2, case
        assert text.startswith("error: ") and text.count("\n") == 1, (case, text)
        assert reason in text, (case, text)
        assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir()), case


def test_help_is_light():
    """sys.modules of a fresh interpreter: the command line itself loads no array, table or network library."""
    assert not modules_after("import aspnn.cli") & {"numpy", "pandas", "torch", "numba", "scipy", "pyproj", "lightning"}


@pytest.mark.parametrize("name", ["simulate", "import", "filter", "windows", "train", "evaluate", "predict", "info"])
def test_every_command_has_help(name):
    found = subprocess.run(
        [sys.executable, "-m", "aspnn.cli", name, "--help"], capture_output=True, text=True, check=True
    )
    assert "Usage" in found.stdout


def test_fine_tuning_starts_from_a_checkpoint(place, tmp_path):
    """Law: no epochs leave the parent's weights, on logs read as the file says; another network is one line and exit code 2."""
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    tuned = TRAINING.replace('"small"', '"tuned"').replace("epochs = 2", "epochs = 0\ntowards_parent = 1.0")
    (tmp_path / "tuned.toml").write_text(tuned)
    parent = place / "run" / "checkpoint"
    assert run("train", tmp_path / "tuned.toml", "--from", parent, "--out", tmp_path / "run", "--quiet") == (0, "")
    first, second = (load_file(folder / "model.safetensors") for folder in (parent, tmp_path / "run" / "checkpoint"))
    assert all(np.array_equal(values, second[name]) for name, values in first.items())
    config = json.loads((tmp_path / "run" / "checkpoint" / "config.json").read_text())
    assert config["provenance"]["parent"]["model_sha256"] == records.sha256(parent / "model.safetensors")
    (tmp_path / "other.toml").write_text(tuned.replace("latent = 8", "latent = 9"))
    for words in (("--from", parent), ("--from", tmp_path), ()):
        code, told = run("train", tmp_path / "other.toml", *words, "--out", tmp_path / "none", "--quiet")
        assert code == 2 and told.count("\n") == 1 and told.startswith("error: ")
    assert not (tmp_path / "none").exists()
