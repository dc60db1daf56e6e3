"""ONNX export: onnxruntime against torch at batches and lengths that no example had, and the refusal of what disagrees."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

from aspnn.learning import export  # noqa: E402
from aspnn.learning.network import (  # noqa: E402
    RolloutEnsemble,
    RolloutGru,
    RolloutSizes,
    ThesisGru,
    ThesisSizes,
)
from aspnn.schema import InputError  # noqa: E402
from aspnn.workflow import export_file  # noqa: E402

CHECKPOINTS = Path(__file__).parents[2] / "checkpoints"
CALM = RolloutSizes(inputs=4, forcings=1, now=(0, 1, 2), x_bow=35.0, x_stern=-30.0, period=1.0, latent=8)
WINDY = replace(CALM, inputs=5, forcings=2, now=(3, 1, 0), wind=True)
PLAIN = replace(CALM, forcings=0, wind=True)


def lively(network: nn.Module) -> nn.Module:
    """The network with large weights and scales that are not 1, so that no term is lost in the others."""
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator) * 0.4)
        for name, buffer in network.named_buffers():
            value = torch.rand(buffer.shape, generator=generator) + 0.5
            buffer.copy_(value if name.endswith("scale") else value - 1)
    return network.eval()


NETWORKS = {
    "calm": lambda: RolloutGru(CALM),
    "wind": lambda: RolloutGru(WINDY),
    "no forcing": lambda: RolloutGru(PLAIN),
    "ensemble": lambda: RolloutEnsemble(replace(WINDY, members=3)),
    "thesis": lambda: ThesisGru(ThesisSizes(inputs=5, steps=12, latent=6, dense=(7, 9))),
}


@pytest.mark.parametrize("kind", NETWORKS)
def test_onnxruntime_is_torch_at_any_batch_and_length(kind):
    """Oracle: torch. Weights are drawn, batch 1 to 33, history 1 to 40, horizon 1 to 120; float32 rounding only."""
    network = lively(NETWORKS[kind]())
    session = onnxruntime.InferenceSession(export.to_onnx(network, {}), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(1)
    sizes = network.sizes
    for batch, past, steps in ((1, 1, 1), (1, 30, 90), (2, 7, 120), (3, 40, 2), (33, 11, 60)):
        steps = sizes.steps if kind == "thesis" else steps
        shapes = {"history": (batch, past, sizes.inputs), "wind": (batch, 2)}
        shapes["forcing"] = (batch, steps + 1, getattr(sizes, "forcings", 0))
        inputs = {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
        with torch.inference_mode():
            wanted = network(**{name: torch.from_numpy(value) for name, value in inputs.items()}).numpy()
        found = session.run(None, {value.name: inputs[value.name] for value in session.get_inputs()})[0]
        assert found.shape == (batch, steps + 1, 3)
        assert np.abs(wanted - wanted[:, :1]).max() > 0.01  # the oracle moves
        np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max(), rtol=0)


def test_batch_and_lengths_are_free_in_the_file():
    """ONNX's own description of the model: symbols where sizes may change, the opset that the module states."""
    model = onnx.load_from_string(export.to_onnx(RolloutGru(WINDY), {}))

    def shape(value):
        return [d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]

    assert {v.name: shape(v) for v in model.graph.input} == {
        "history": ["batch", "steps", 5],
        "forcing": ["batch", "points", 2],
        "wind": ["batch", 2],
    }
    assert shape(model.graph.output[0]) == ["batch", "points", 3]
    assert [v.name for v in onnx.load_from_string(export.to_onnx(RolloutGru(CALM), {})).graph.input] == [
        "history",
        "forcing",
    ]
    assert model.opset_import[0].version == export.OPSET == 17
    assert len(model.graph.node) < 50  # not unrolled


@pytest.mark.parametrize("name", ["cargo90", "cargo90-thesis"])
def test_a_checkpoint_becomes_one_file_with_its_config(name, tmp_path):
    """The metadata are config.json's content; every batch size of the brief agrees with torch within the tolerance."""
    cases = export.export_onnx(CHECKPOINTS / name, tmp_path / "new" / "m.onnx")
    assert {case.batch for case in cases} == {1, 2, 7, 64}
    assert len({(case.history, case.horizon) for case in cases}) == (9 if name == "cargo90" else 3)
    assert max(case.difference for case in cases) < export.TOLERANCE / 5
    held = onnx.load(tmp_path / "new" / "m.onnx").metadata_props
    config = json.loads((CHECKPOINTS / name / "config.json").read_text())
    assert {p.key: json.loads(p.value) for p in held} == {"aspnn": config}
    assert len(config["model_sha256"]) == 64


def other_reset(model: bytes) -> bytes:
    """The model with the GRU that resets before the linear map: ONNX's default, which once was exported silently."""
    changed = onnx.load_from_string(model)
    bodies = [a.g for n in changed.graph.node for a in n.attribute if a.name == "body"]
    for node in [n for graph in (changed.graph, *bodies) for n in graph.node if n.op_type == "GRU"]:
        next(a for a in node.attribute if a.name == "linear_before_reset").i = 0
    return changed.SerializeToString()


def other_gates(model: bytes) -> bytes:
    """The model with update and reset gate of the first GRU's inputs exchanged."""
    changed = onnx.load_from_string(model)
    name = next(n for n in changed.graph.node if n.op_type == "GRU").input[1]
    held = next(i for i in changed.graph.initializer if i.name == name)
    z, r, n = np.split(onnx.numpy_helper.to_array(held), 3, axis=1)
    held.CopyFrom(onnx.numpy_helper.from_array(np.concatenate([r, z, n], axis=1), name))
    return changed.SerializeToString()


def fixed_batch(model: bytes) -> bytes:
    """The model for one window only."""
    changed = onnx.load_from_string(model)
    graph, last = changed.graph, changed.graph.node[-1]
    for name, place in (("begin", 0), ("end", 1)):
        graph.initializer.append(onnx.numpy_helper.from_array(np.array([place]), name))
    cut = onnx.helper.make_node("Slice", [last.input[0], "begin", "end", "begin"], ["first"])
    last.input[0] = "first"
    graph.node.insert(len(graph.node) - 1, cut)
    return changed.SerializeToString()


@pytest.mark.parametrize("wrong", [other_reset, other_gates, fixed_batch])
def test_a_graph_that_disagrees_is_not_left_behind(wrong, monkeypatch, tmp_path):
    """Three ways in which exported GRUs have been silently wrong are refused; the file that was there stays as it was."""
    right = export.to_onnx
    monkeypatch.setattr(export, "to_onnx", lambda *given: wrong(right(*given)))
    file = tmp_path / "m.onnx"
    file.write_text("before")
    with pytest.raises(InputError, match=r"m\.onnx: not written: onnxruntime and torch differ by .* m/s at batch"):
        export.export_onnx(CHECKPOINTS / "cargo90", file)
    assert [p.name for p in tmp_path.iterdir()] == ["m.onnx"]
    assert file.read_text() == "before"


def test_what_cannot_be_exported_is_said(tmp_path):
    """One line that names the file or the kind of network and the remedy."""
    with pytest.raises(InputError, match="kind Linear have no ONNX form"):
        export.to_onnx(nn.Linear(2, 3), {})
    with pytest.raises(InputError, match=r"m\.bin: name it with the ending \.onnx"):
        export.export_onnx(CHECKPOINTS / "cargo90", tmp_path / "m.bin")
    with pytest.raises(InputError, match=r"nothing: is no checkpoint"):
        export.export_onnx(tmp_path / "nothing", tmp_path / "m.onnx")
    assert not list(tmp_path.iterdir())


def test_a_missing_extra_is_said(monkeypatch, tmp_path):
    """The error where onnx cannot be imported names the remedy; no file is left."""
    monkeypatch.setitem(sys.modules, "onnx", None)
    monkeypatch.delitem(sys.modules, "aspnn.learning.export")
    with pytest.raises(InputError, match=r"export: onnx is not installed; pip install aspnn\[export\]"):
        export_file(CHECKPOINTS / "cargo90", tmp_path / "m.onnx")
    assert not list(tmp_path.iterdir())
