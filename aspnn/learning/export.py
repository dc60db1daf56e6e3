"""A checkpoint as one ONNX file: the network as a graph, and config.json in its metadata. Needs the extra `export`.

The graph is written here operator by operator. Torch's own exporter unrolls the roll-out over a fixed horizon, a hundred
operators become two thousand, and GRUs have been exported silently wrong (linear_before_reset, gates in another order,
the batch size of the example). Here a Scan runs one GRU step per step of the plan, so that batch, history and horizon are
all free, and what was written is run beside torch before it may stay.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from aspnn.learning.checkpoint import Bundle, read_bundle
from aspnn.learning.network import Affine, RolloutEnsemble, RolloutGru, ThesisGru
from aspnn.records import atomic
from aspnn.schema import InputError

OPSET, IR = 17, 8  # read by onnxruntime 1.12 (2022) and later
TOLERANCE = 1e-4  # m/s between onnxruntime and torch: 9 mm in 90 s; float32 rounding leaves about 5e-6
BATCHES = (1, 2, 7, 64)
INTO = np.array([[1, 0, 0], [0, 0.5, 0.5], [0, 1, -1]])  # RolloutGru.to_motion: surge, mean sway, sway difference
BACK = np.linalg.inv(INTO)


class Graph:
    """Operators and constants as they are written down. Each call of `add` gives the name of what the operator makes."""

    def __init__(self, prefix: str = ""):
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.prefix = prefix

    def add(self, operator: str, *inputs: str | np.ndarray | torch.Tensor, **attributes: Any) -> str:
        """One operator with one output; arrays among its inputs become constants."""
        names = [x if isinstance(x, str) else self.constant(x) for x in inputs]
        output = f"{self.prefix}{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, names, [output], **attributes))
        return output

    def constant(self, value: np.ndarray | torch.Tensor) -> str:
        """A constant: integers as int64 (shapes and places), all else as float32."""
        array = value.detach().numpy() if isinstance(value, torch.Tensor) else np.asarray(value)
        array = array.astype(np.int64 if array.dtype.kind == "i" else np.float32, order="C")
        name = f"{self.prefix}constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def scale(self, values: str, by: Affine) -> str:
        """Affine.forward."""
        return self.add("Div", self.add("Sub", values, by.offset), by.scale)

    def unscale(self, values: str, by: Affine) -> str:
        """Affine.undo."""
        return self.add("Add", self.add("Mul", values, by.scale), by.offset)

    def gru(self, sequence: str, gates: list[torch.Tensor], start: str = "") -> str:
        """Latent state (1, batch, latent) after a sequence (steps, batch, features), from zero or from `start`.

        `gates` are torch's W_ih, W_hh, b_ih, b_hh. Torch stacks the gates as r, z, n and ONNX as z, r, h, and torch's n is
        tanh(W x + b + r o (U h + c)), the variant with linear_before_reset (erratum E42).
        """
        w, u, b, c = (torch.cat([part.chunk(3)[k] for k in (1, 0, 2)]) for part in gates)
        weights = [self.constant(x[None]) for x in (w, u, torch.cat([b, c]))]
        output = f"{self.prefix}gru_{len(self.nodes)}"
        inputs = [sequence, *weights, *(["", start] if start else [])]
        settings: dict[str, Any] = {"hidden_size": u.shape[1], "linear_before_reset": 1}
        self.nodes.append(helper.make_node("GRU", inputs, ["", output], **settings))
        return output

    def linear(self, values: str, layer: nn.Linear, gain: float = 1.0) -> str:
        """A dense layer on (batch, features), its result times `gain`."""
        return self.add("Gemm", values, gain * layer.weight.T, gain * layer.bias)


def rollout(graph: Graph, network: RolloutGru) -> str:
    """Velocities (batch, points, 3) of RolloutGru.forward; the comments of its steps stand there."""
    s, gain = network.sizes, network.CHANGE
    sequence = graph.add("Transpose", graph.scale("history", network.history), perm=[1, 0, 2])
    latent = graph.gru(sequence, _gates(network.encoder, "_l0"))
    hidden = graph.add("Squeeze", latent, np.array([0]))
    choose = np.zeros((s.inputs, 3))
    choose[list(s.now), range(3)] = 1
    now = graph.add("Gather", "history", np.array(-1), axis=1)
    motion = graph.scale(graph.add("MatMul", now, choose @ INTO.T), network.motion)
    motion = graph.add("Add", motion, graph.linear(hidden, network.correct, gain))

    plan = graph.scale("forcing", network.forcing)
    first, last, end = np.array([0]), np.array([-1]), np.array([2**62])
    before = graph.add("Slice", plan, first, last, np.array([1]))
    after = graph.add("Slice", plan, -last, end, np.array([1]))
    known = graph.add("Transpose", graph.add("Concat", before, after, axis=-1), perm=[1, 0, 2])

    # One step, on what is carried from step to step; `known` is what the plan says of each.
    step = Graph(f"{graph.prefix}step_")
    was, memory, turned = (f"{step.prefix}{name}" for name in ("motion", "latent", "turned"))
    seen = [was, f"{step.prefix}known"]
    if s.wind:
        air = graph.scale("wind", network.wind)
        across = graph.add("MatMul", air, np.array([[0.0, -1], [1, 0]]))
        along = step.add("Mul", air, step.add("Cos", turned))
        seen.append(step.add("Add", along, step.add("Mul", across, step.add("Sin", turned))))
    values = step.add("Concat", *seen, axis=-1)
    remembered = step.gru(step.add("Unsqueeze", values, np.array([0])), _gates(network.cell), memory)
    hidden = step.add("Squeeze", remembered, np.array([0]))
    passed = gain * network.direct.weight.T
    passed[:3] += torch.eye(3)  # motion + seen @ direct
    changed = step.add("Gemm", values, passed, gain * network.out.bias)
    changed = step.add("Gemm", hidden, gain * network.out.weight.T, changed)
    carried = [Carried(motion, was, changed, ["batch", 3]), Carried(latent, memory, remembered, [1, "batch", s.latent])]
    if s.wind:
        per_step = s.period / (s.x_bow - s.x_stern)
        turn = torch.zeros(3, 1)
        turn[2] = network.motion.scale[2] * per_step
        turning = step.add("Add", step.add("Gemm", was, turn, turned), network.motion.offset[2:] * per_step)
        rows = graph.add("Concat", graph.add("Shape", "wind", start=0, end=1), np.array([1]), axis=0)
        carried.append(Carried(graph.add("ConstantOfShape", rows), turned, turning, ["batch", 1]))
    found = _scan(graph, step, carried, known, ["batch", 2 * s.forcings])

    started = graph.add("Unsqueeze", motion, np.array([1]))
    whole = graph.add("Concat", started, graph.add("Transpose", found, perm=[1, 0, 2]), axis=1)
    return graph.add("MatMul", graph.unscale(whole, network.motion), BACK.T)


def _gates(cell: nn.Module, suffix: str = "") -> list[torch.Tensor]:
    return [getattr(cell, name + suffix) for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")]


class Carried(NamedTuple):
    """What a Scan carries from step to step: what it starts as, its name before and after a step, and its shape."""

    start: str
    before: str
    after: str
    shape: list[Any]


def _scan(graph: Graph, step: Graph, carried: list[Carried], known: str, shape: list[Any]) -> str:
    """Run `step` along the first axis of `known`, whose rows have `shape`: all that the first carried value becomes."""

    def value(name: str, shape: list[Any]):
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)

    kept = step.add("Identity", carried[0].after)  # an output of the body has one role only
    body = helper.make_graph(
        step.nodes,
        f"{step.prefix}body",
        [*(value(c.before, c.shape) for c in carried), value(f"{step.prefix}known", shape)],
        [*(value(c.after, c.shape) for c in carried), value(kept, carried[0].shape)],
    )
    graph.constants += step.constants
    output = f"{graph.prefix}scan_{len(graph.nodes)}"
    ends = [f"{output}_end_{k}" for k in range(len(carried))]
    inputs = [*(c.start for c in carried), known]
    graph.nodes.append(helper.make_node("Scan", inputs, [*ends, output], body=body, num_scan_inputs=1))
    return output


def ensemble(graph: Graph, network: RolloutEnsemble) -> str:
    """Velocities of RolloutEnsemble.forward: the members' mean."""
    members = []
    for k, member in enumerate(network.members):
        graph.prefix = f"member_{k}_"
        members.append(rollout(graph, member))  # type: ignore[arg-type]
    graph.prefix = ""
    return graph.add("Mean", *members)


def thesis(graph: Graph, network: ThesisGru) -> str:
    """Velocities of ThesisGru.forward, for the number of steps that its last layer has."""
    sequence = graph.add("Transpose", graph.scale("history", network.history), perm=[1, 0, 2])
    targets = []
    for cell, dense in zip(network.cells, network.dense, strict=True):
        values = graph.add("Squeeze", graph.gru(sequence, _gates(cell, "_l0")), np.array([0]))
        for layer in dense:  # type: ignore[attr-defined]
            values = graph.linear(values, layer) if isinstance(layer, nn.Linear) else graph.add("Relu", values)
        targets.append(graph.add("Unsqueeze", values, np.array([2])))
    after = graph.unscale(graph.add("Concat", *targets, axis=2), network.target)
    start = graph.add("Slice", after, np.array([0]), np.array([1]), np.array([1]))
    return graph.add("Concat", start, after, axis=1)


class Form(NamedTuple):
    """How a kind of network is written: its function, the inputs it reads, the points it gives (None: as the forcing has)."""

    write: Any
    reads: tuple[str, ...]
    points: int | None


def form_of(network: nn.Module) -> Form:
    """The form of a network. Raises InputError for a kind that has none."""
    if isinstance(network, ThesisGru):
        return Form(thesis, ("history",), network.sizes.steps + 1)
    if isinstance(network, RolloutGru | RolloutEnsemble):
        reads = ("history", "forcing", "wind") if network.sizes.wind else ("history", "forcing")
        return Form(ensemble if isinstance(network, RolloutEnsemble) else rollout, reads, None)
    raise InputError(f"networks of kind {type(network).__name__} have no ONNX form; export a GRU checkpoint")


def to_onnx(network: nn.Module, metadata: dict[str, str]) -> bytes:
    """The network as an ONNX model: history (batch, steps, inputs), forcing (batch, points, forcings) and wind (batch, 2),
    in float32 and SI units, as far as it reads them; velocities (batch, points, 3).
    """
    form, sizes = form_of(network), cast(Any, network.sizes)
    shapes: dict[str, list[Any]] = {"history": ["batch", "steps", sizes.inputs], "wind": ["batch", 2]}
    if "forcing" in form.reads:
        shapes["forcing"] = ["batch", "points", sizes.forcings]
    points = "points" if form.points is None else form.points
    graph = Graph()
    with torch.no_grad():
        result = form.write(graph, network)
    graph.nodes.append(helper.make_node("Identity", [result], ["velocities"]))
    whole = helper.make_graph(
        graph.nodes,
        "aspnn",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shapes[name]) for name in form.reads],
        [helper.make_tensor_value_info("velocities", TensorProto.FLOAT, ["batch", points, 3])],
        graph.constants,
    )
    opsets = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(whole, opset_imports=opsets, ir_version=IR, producer_name="aspnn")
    helper.set_model_props(model, metadata)
    onnx.checker.check_model(model)
    return model.SerializeToString()


@dataclass(frozen=True)
class Parity:
    """The largest difference between onnxruntime and torch [m/s] at one batch size and number of steps."""

    batch: int
    history: int
    horizon: int
    difference: float


def parity(network: nn.Module, model: bytes, history: int, horizon: int) -> Iterator[Parity]:
    """Run a model beside torch at several batch sizes and numbers of steps, on inputs as in training and up to half beyond.

    `history` and `horizon` are the numbers of steps in use; one step and twice as many are tried too, where they are free.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    form, rng = form_of(network), np.random.default_rng(0)
    some: Any = network.members[0] if isinstance(network, RolloutEnsemble) else network
    horizons = (horizon, 1, 2 * horizon) if form.points is None else (form.points - 1,)

    def draw(scaling: Affine, *shape: int) -> torch.Tensor:
        return scaling.undo(torch.from_numpy(rng.uniform(-1.5, 1.5, (*shape, len(scaling.offset))).astype(np.float32)))

    for batch in BATCHES:
        for past in (history, 1, 2 * history):
            for steps in horizons:
                plan = (
                    draw(some.forcing, batch, steps + 1)
                    if "forcing" in form.reads
                    else torch.zeros(batch, steps + 1, 0)
                )
                air = draw(some.wind, batch) if "wind" in form.reads else torch.zeros(batch, 2)
                inputs = {"history": draw(some.history, batch, past), "forcing": plan, "wind": air}
                with torch.inference_mode():
                    wanted = network(**inputs).numpy()
                found = session.run(None, {name: inputs[name].numpy() for name in form.reads})[0]
                difference = float(np.abs(found - wanted).max()) if found.shape == wanted.shape else float("inf")
                yield Parity(batch, past, steps, difference)


def export_onnx(folder: str | Path, file: str | Path) -> list[Parity]:
    """Write a checkpoint folder as one ONNX file that holds all a prediction needs, and say how far it is from torch.

    Raises InputError, and leaves no file, when onnxruntime and torch differ by more than `TOLERANCE` in any case.
    """
    file = Path(file)
    if file.suffix != ".onnx":
        raise InputError(f"{file}: name it with the ending .onnx, by which `aspnn predict` knows it")
    bundle: Bundle = read_bundle(folder)
    config = json.dumps(json.loads((Path(folder) / "config.json").read_text()))
    with atomic(file) as temporary:
        temporary.write_bytes(to_onnx(bundle.network, {"aspnn": config}))
        spec = bundle.spec
        cases = list(parity(bundle.network, temporary.read_bytes(), spec.history_steps, spec.horizon_steps))
        worst = max(cases, key=lambda case: case.difference if case.difference >= 0 else np.inf)  # NaN is worst
        if not worst.difference <= TOLERANCE:
            raise InputError(
                f"{file}: not written: onnxruntime and torch differ by {worst.difference:.2g} m/s at batch {worst.batch}, "
                f"{worst.history} + {worst.horizon} steps ({TOLERANCE:g} allowed); report this checkpoint"
            )
    return cases
