"""What an exported checkpoint costs beside torch, on one thread: parity, time, time to the first prediction, memory.

python tests/benchmarks/bench_onnx.py

Times are medians of 200 calls on the wall clock, and the processor's own time per call, which other programs do not change.
"""

import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import aspnn
from aspnn.learning.export import TOLERANCE, export_onnx
from aspnn.orders import Plan
from aspnn.prediction.plan import make_plan

ROOT = Path(__file__).parents[2]
LOG = ROOT / "data/sample/zigzag-20-20.parquet"
FRESH = """
import time
import aspnn
states = aspnn.filter_log(aspnn.read_log({log!r})).until(200.0)
size = lambda: int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6  # resident, Linux
before, begin = size(), time.perf_counter()
aspnn.Predictor.load({model!r}).predict(states, 0.3)
print(f"{{time.perf_counter() - begin:.2f}} s, {{size() - before:.0f}} MB more than the {{before:.0f}} MB of the filter")
"""


def cost(call) -> str:
    """Median wall time of a call and processor time per call [ms], after five that warm up."""
    times = []
    for k in range(205):
        if k == 5:
            spent = time.process_time()
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    spent = (time.process_time() - spent) / 200
    return f"{1e3 * float(np.median(times[5:])):6.2f} / {1e3 * spent:5.2f} ms"


def main() -> None:
    states = aspnn.filter_log(aspnn.read_log(LOG)).until(200.0)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("cargo90", "cargo90-thesis"):
            checkpoint, file = ROOT / "checkpoints" / name, Path(folder) / f"{name}.onnx"
            begin = time.perf_counter()
            cases = export_onnx(checkpoint, file)
            print(
                f"\n{name}: {file.stat().st_size / 1e3:.0f} kB, exported and checked in {time.perf_counter() - begin:.1f} s"
            )
            print(f"largest difference from torch [m/s] ({TOLERANCE:g} allowed), by history + horizon steps")
            batches = sorted({case.batch for case in cases})
            print(f"{'steps':>12s}" + "".join(f"  batch {batch:<3d}" for batch in batches))
            for past, steps in dict.fromkeys((case.history, case.horizon) for case in cases):
                found = {c.batch: c.difference for c in cases if (c.history, c.horizon) == (past, steps)}
                print(f"{past:6d} +{steps:4d}" + "".join(f"  {found[batch]:9.1e}" for batch in batches))
            for model in (file, checkpoint):
                predictor = aspnn.Predictor.load(model)
                spec, plan = predictor_spec(predictor), make_plan(states, 0.3, None, predictor.horizon)
                print(f"\n{'onnxruntime' if model == file else 'torch'} (wall / processor)")
                for batch in (1, 9):
                    inputs = network_inputs(spec, plan, batch)
                    print(f"  network, {batch} plans  {cost(lambda p=predictor, i=inputs: p.velocities(*i))}")
                print(f"  predict           {cost(lambda p=predictor: p.predict(states, math.radians(20)))}")
                orders = np.radians(np.linspace(-35, 35, 9))
                print(f"  fan of 9          {cost(lambda p=predictor, o=orders: p.fan(states, o))}")
                code = FRESH.format(log=str(LOG), model=str(model))
                done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
                print(f"  import, load and first prediction: {done.stdout.strip()}")


def predictor_spec(predictor):
    """The WindowSpec of either predictor."""
    return predictor.bundle.spec if hasattr(predictor, "bundle") else predictor.deployed.spec


def network_inputs(spec, plan: Plan, batch: int):
    """History, forcing and wind of the right shapes."""
    known = np.tile(plan.rudder.at(spec.time)[:, None], (batch, 1, len(spec.forcings)))
    return np.full((batch, spec.history_steps, len(spec.inputs)), 0.1), known, np.zeros((batch, 2))


if __name__ == "__main__":
    main()
