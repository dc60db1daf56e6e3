"""Time of 90 s predictions on one thread: with regions and current by the shipped checkpoint, a fan, by ONNX, kinematic.

python tests/benchmarks/bench_prediction.py

From filtered states to a path, the best and the median of 60 calls on the wall clock and the best processor time of a call,
which other programs change least; all by turns, so that what else the machine does falls on all alike. `network` is what
the network's own calls take of it (regions: the start and four perturbed ones; current: nine roll-outs of 30 s), on inputs
made beforehand. Where onnxruntime is not installed its rows are left out.
"""

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import aspnn
from aspnn.prediction import KinematicPredictor, constant

ROOT = Path(__file__).parents[2]
CALLS = 60


def by_turns(calls: dict[str, Callable[[], object]]) -> dict[str, np.ndarray]:
    """Wall and processor time (CALLS, 2) [ms] of each call, one call of each after the other, after three that warm up."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for k in range(CALLS + 3):
        for name, call in calls.items():
            wall, processor = time.perf_counter(), time.process_time()
            call()
            if k >= 3:
                times[name].append((time.perf_counter() - wall, time.process_time() - processor))
    return {name: 1e3 * np.array(found) for name, found in times.items()}


def recorded(predictor, predict: Callable) -> list[tuple[np.ndarray, ...]]:
    """What the network of `predictor` is given in one call of `predict`."""
    given, network = [], predictor.velocities

    def velocities(*inputs):
        given.append(inputs)
        return network(*inputs)

    vars(predictor)["velocities"] = velocities
    predict()
    del vars(predictor)["velocities"]
    return given


def main() -> None:
    log = aspnn.read_log(ROOT / "data/sample/zigzag-20-20.parquet")
    states, orders = aspnn.filter_log(log).until(200.0), np.radians(np.linspace(-35, 35, 9))
    kinematic = KinematicPredictor(log.vessel, constant)
    calls: dict[str, Callable[[], object]] = {"constant": lambda: kinematic.predict(states)}
    with tempfile.TemporaryDirectory() as folder:
        models = {name: ROOT / "checkpoints" / name for name in ("cargo90", "cargo90-thesis")}
        if find_spec("onnx") and find_spec("onnxruntime"):
            from aspnn.learning.export import export_onnx

            models["cargo90.onnx"] = Path(folder) / "cargo90.onnx"
            export_onnx(models["cargo90"], models["cargo90.onnx"])
        for name, model in models.items():
            p = aspnn.Predictor.load(model)
            calls[name] = lambda p=p: p.predict(states, math.radians(20))
            if p.calibration is None:
                continue
            calls[f"{name}, fan of 9"] = lambda p=p: p.fan(states, orders)
            for what, call in (("", calls[name]), (", fan of 9", calls[f"{name}, fan of 9"])):
                given = recorded(p, call)
                calls[f"{name}{what}, network"] = lambda p=p, given=given: [p.velocities(*inputs) for inputs in given]
            if hasattr(p, "bundle"):
                bare = replace(p, bundle=replace(p.bundle, calibration=None))
                calls[f"{name}, no regions"] = lambda p=bare: p.predict(states, math.radians(20))
        times = by_turns(calls)
    arc = times["constant"][:, 1].min()
    print(f"{'[ms]':32s} {'best':>7s} {'median':>7s} {'processor':>9s}")
    for name, found in times.items():
        best, processor = found.min(axis=0)
        median = np.median(found[:, 0])
        print(f"{name:32s} {best:7.2f} {median:7.2f} {processor:9.2f} {processor / arc:7.1f} x constant")


if __name__ == "__main__":
    main()
