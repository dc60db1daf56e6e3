"""The exported predictor: the same paths as torch's, without torch, and one line for a file that is none of ours."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

import aspnn  # noqa: E402
from aspnn.evaluation.evaluate import sees_future  # noqa: E402
from aspnn.learning.checkpoint import read_bundle, write_calibration  # noqa: E402
from aspnn.learning.export import export_onnx  # noqa: E402
from aspnn.learning.windows import plan_of  # noqa: E402
from aspnn.prediction import Predictor  # noqa: E402
from aspnn.prediction.onnx import OnnxPredictor  # noqa: E402
from aspnn.prediction.uncertainty import LEVELS, POPULATIONS, Calibration  # noqa: E402
from aspnn.records import States  # noqa: E402
from aspnn.schema import InputError  # noqa: E402
from aspnn.vessel import load_vessel  # noqa: E402

ROOT = Path(__file__).parents[2]
LOG = ROOT / "data/sample/zigzag-20-20.parquet"
NAMES = ("cargo90", "cargo90-thesis")


@cache
def voyage() -> States:
    return aspnn.filter_log(aspnn.read_log(LOG))


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("onnx")
    for name in NAMES:
        export_onnx(ROOT / "checkpoints" / name, folder / f"{name}.onnx")
    return {name: folder / f"{name}.onnx" for name in NAMES}


def assert_same(found, wanted):
    """Float32 rounding of the velocities alone: 1e-5 m/s and, by it, 1e-3 m and 1e-5 rad in 90 s."""
    assert found.north.shape == wanted.north.shape
    for name in ("north", "east"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=0, atol=2e-3)
    np.testing.assert_allclose(found.heading, wanted.heading, rtol=0, atol=3e-5)
    np.testing.assert_allclose(found.surge, wanted.surge, rtol=0, atol=2e-5)
    np.testing.assert_array_equal(found.convergence, wanted.convergence)


@pytest.mark.parametrize("name", NAMES)
def test_paths_are_those_of_torch(name, exported):
    """Oracle: GruPredictor. One prediction, many starts with the plans that were followed, a fan, the other way to a path."""
    ours, wanted = Predictor.load(exported[name]), Predictor.load(ROOT / "checkpoints" / name)
    assert isinstance(ours, OnnxPredictor)
    assert (ours.name, ours.horizon, ours.region_map) == (wanted.name, wanted.horizon, wanted.region_map)
    now, plan = voyage().until(200.0), math.radians(20)
    assert_same(ours.predict(now, plan), wanted.predict(now, plan))
    rows = np.searchsorted(voyage()["time_s"], (60.0, 100.0, 140.0, 180.0, 220.0))
    plans = [plan_of(voyage(), row, ours.horizon) for row in rows]
    assert_same(ours.predict_many(voyage(), rows, plans), wanted.predict_many(voyage(), rows, plans))
    orders = np.radians([-30.0, 0.0, 30.0])
    assert_same(ours.fan(now, orders), wanted.fan(now, orders))
    other, reference = (replace(p, region_map=not p.region_map).predict(now, plan) for p in (ours, wanted))
    assert_same(other, reference)
    assert np.hypot(other.north - ours.predict(now, plan).north, other.east - ours.predict(now, plan).east).max() > 0.1


def test_regions_are_those_of_torch(tmp_path):
    """Oracle: GruPredictor with the same made-up calibration, which travels inside the file."""
    knots = np.array([0.0, 30.0, 90.0])
    table = {name: np.outer(1 + knots / 90, np.linspace(1, 3, len(LEVELS))) for name in POPULATIONS}
    made = Calibration(
        time=knots,
        variance=np.full((3, 3, 4), 0.01) * (1 + knots)[:, None, None],
        correlation=np.tile(np.eye(3), (3, 1, 1)),
        levels=np.array(LEVELS),
        position=table,
        heading=table,
        domain={"surge_m_s": (0.0, 10.0)},
        settled=60.0,
        drift=0.3,
        usual=np.full((3, 2), 1.5),
        limit=1.8,
        facts={},
    )
    source = ROOT / "checkpoints/cargo90"
    bundle = replace(read_bundle(source), calibration=made.to_dict())
    write_calibration(bundle, source, tmp_path / "checkpoint", "a card\n")
    export_onnx(tmp_path / "checkpoint", tmp_path / "m.onnx")
    now = voyage().until(200.0)
    ours, wanted = (Predictor.load(tmp_path / name).predict(now, 0.2) for name in ("m.onnx", "checkpoint"))
    assert_same(ours, wanted)
    scale = np.abs(wanted.spread.covariance).max()
    np.testing.assert_allclose(ours.spread.covariance, wanted.spread.covariance, rtol=1e-3, atol=1e-4 * scale)
    assert wanted.spread.covariance[-1, 0, 0] > 1e-3
    assert Predictor.load(tmp_path / "m.onnx").predict(now).region().level == 0.95
    unlike = replace(Predictor.load(tmp_path / "m.onnx"), region_map=True)  # not what was calibrated
    assert unlike.predict(now).spread is None


def test_sees_no_future(exported):
    """Law of the family: later rows are changed, the prediction does not move."""
    rows = np.searchsorted(voyage()["time_s"], (100.0, 150.0))
    ours = OnnxPredictor.load(exported["cargo90"])
    plans = [plan_of(voyage(), row, ours.horizon) for row in rows]
    assert not sees_future(ours, voyage(), rows, plans)


def test_no_torch_is_imported(exported):
    """sys.modules of a fresh interpreter: loading, predicting and the command itself take onnxruntime and no torch."""
    given = ["aspnn", "predict", str(exported["cargo90"]), str(LOG), "--at", "200", "--rudder", "20", "--format", "csv"]
    code = f"import sys; sys.argv = {given!r}\nfrom aspnn.cli import app\napp(standalone_mode=False)"
    run = subprocess.run([sys.executable, "-c", code + "\nprint(*sys.modules)"], capture_output=True, text=True)
    *table, modules = run.stdout.splitlines()
    assert run.returncode == 0, run.stderr
    assert len(table) == 92
    top = {name.partition(".")[0] for name in modules.split()}
    assert "onnxruntime" in top
    assert not top & {"torch", "lightning", "onnx", "onnxscript", "matplotlib", "plotly", "sklearn"}


def test_other_files_are_refused(exported, tmp_path):
    """One line that names the file and the remedy: none there, no ONNX, another's model, another format."""
    with pytest.raises(InputError, match=r"none\.onnx: no such file; write it with `aspnn export"):
        Predictor.load(tmp_path / "none.onnx")
    (tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(InputError, match=r"text\.onnx: is no ONNX model .*; export it again") as caught:
        Predictor.load(tmp_path / "text.onnx")
    assert "\n" not in str(caught.value)
    model = onnx.load(exported["cargo90"])
    config = json.loads(model.metadata_props[0].value)
    model.metadata_props[0].value = json.dumps(config | {"format": 99})
    onnx.save(model, tmp_path / "later.onnx")
    with pytest.raises(InputError, match=r"later\.onnx: checkpoint format 99, this version reads 1"):
        Predictor.load(tmp_path / "later.onnx")
    del model.metadata_props[:]
    onnx.save(model, tmp_path / "other.onnx")
    with pytest.raises(InputError, match=r"other\.onnx: was not written by `aspnn export`"):
        Predictor.load(tmp_path / "other.onnx")


def test_states_of_another_ship_are_refused(exported):
    """As with a checkpoint folder: both vessels are named."""
    other = replace(voyage().until(200.0), vessel=load_vessel("kvlcc2_full"))
    with pytest.raises(InputError, match="vessel kvlcc2_full, but checkpoint cargo90 was trained on cargo90"):
        Predictor.load(exported["cargo90"]).predict(other, 0.0)


def test_a_missing_onnxruntime_is_said(monkeypatch, exported):
    """The error where onnxruntime cannot be imported names the remedy."""
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InputError, match=r"needs onnxruntime, which is not installed: pip install aspnn\[export\]"):
        Predictor.load(exported["cargo90"])
