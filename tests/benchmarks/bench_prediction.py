"""Time of one 90 s prediction by each shipped checkpoint, and of a kinematic one, on one thread.

python tests/benchmarks/bench_prediction.py

The median of 50 calls from filtered states to a path, and what each costs as a multiple of the kinematic arc.
"""

import math
import time
from pathlib import Path

import numpy as np

import aspnn
from aspnn.prediction import KinematicPredictor, constant

ROOT = Path(__file__).parents[2]


def milliseconds(call) -> float:
    """Median time of a call [ms], after three that warm up."""
    times = []
    for k in range(53):
        begin = time.perf_counter()
        call()
        if k >= 3:
            times.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(times))


def main() -> None:
    log = aspnn.read_log(ROOT / "data/sample/zigzag-20-20.parquet")
    states = aspnn.filter_log(log).until(200.0)
    kinematic = KinematicPredictor(log.vessel, constant)
    arc = milliseconds(lambda: kinematic.predict(states))
    print(f"{'constant':16s} {arc:7.2f} ms")
    for name in ("cargo90", "cargo90-thesis"):
        predictor = aspnn.Predictor.load(ROOT / "checkpoints" / name)
        one = milliseconds(lambda p=predictor: p.predict(states, math.radians(20)))
        print(f"{name:16s} {one:7.2f} ms  {one / arc:6.1f} x constant")


if __name__ == "__main__":
    main()
