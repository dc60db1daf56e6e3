"""Speed of the compiled course filter beside a plain filterpy loop on the same model, in one run.

python tests/benchmarks/bench_course.py [MINUTES]

Prediction at 50 Hz, fixes at 5 Hz. The plain loop is filterpy's ExtendedKalmanFilter as a textbook uses it: Euler's step of the mean,
its Jacobian, a fixed Q, no gate, nothing stored but the means; so it does less than the compiled filter, which holds exact inner steps,
the gate, covariances and innovations. Times are the best of several runs; machines differ, so quote the ratio.
"""

import math
import sys
import time

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from aspnn.estimation.course import CourseModel, CourseTracker
from aspnn.estimation.course_run import problem_of, run
from aspnn.vessel import load_vessel

PLAIN = 3000  # epochs that the plain loop runs over
SHIPS = 50


def plain_filterpy(times, z, model, start, sd):
    """Table 1 of 001 with E46 corrected; returns the means."""
    h, kf = times[1] - times[0], ExtendedKalmanFilter(dim_x=5, dim_z=2)
    kf.x, kf.P, kf.R = start.copy(), np.diag([1.0, 1.0, 1.0, 0.1, 1e-4]), sd**2 * np.eye(2)
    kf.Q = np.diag([0, 0, model.speed_density * h, 0, model.turn_density * h])
    C, means = np.eye(2, 5), np.empty((len(times), 5))
    for k in range(len(times)):
        if k:
            _, _, U, chi, omega = kf.x
            c, s = math.cos(chi), math.sin(chi)
            kf.F = np.eye(5)
            kf.F[0, 2], kf.F[0, 3], kf.F[1, 2], kf.F[1, 3] = h * c, -h * U * s, h * s, h * U * c
            kf.F[2, 2], kf.F[3, 4], kf.F[4, 4] = 1 - h * model.alpha_speed, h, 1 - h * model.alpha_turn
            moved = kf.x + h * np.array([U * c, U * s, -model.alpha_speed * U, omega, -model.alpha_turn * omega])
            kf.predict()
            kf.x = moved
        if np.isfinite(z[k, 0]):
            kf.update(z[k], HJacobian=lambda x: C, Hx=lambda x: x[:2])
        means[k] = kf.x
    return means


def best(call, runs: int) -> float:
    """Shortest time [s] that the process needed for a call."""
    found = []
    for _ in range(runs):
        begin = time.process_time()
        call()
        found.append(time.process_time() - begin)
    return min(found)


def main() -> None:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    vessel = load_vessel("cargo90")
    model, sd = CourseModel.of(vessel), vessel.noise.position
    times = np.arange(0, 60 * minutes, 0.02)
    U, omega = vessel.service_speed, 0.005
    place = U / omega * np.column_stack([np.sin(omega * times), 1 - np.cos(omega * times)])
    z = place + sd * np.random.default_rng(1).standard_normal(place.shape)
    z[np.arange(len(times)) % 10 != 0] = np.nan
    p, start = problem_of(times, z, sd, model), np.array([0, 0, U, 0, omega])
    run(p)  # compiles
    ours = best(lambda: run(p), 5) / len(times)
    plain = best(lambda: plain_filterpy(times[:PLAIN], z[:PLAIN], model, start, sd), 3) / PLAIN
    print(f"filterpy, plain: {1e6 * plain:.1f} us per step; compiled: {1e6 * ours:.3f} us; {plain / ours:.0f} x")
    print(f"an hour at 50 Hz: {180_000 * ours:.3f} s")
    late = slice(PLAIN - 500, PLAIN)
    off = np.abs(run(p).mean[late] - plain_filterpy(times[:PLAIN], z[:PLAIN], model, start, sd)[late]).max(axis=0)
    print("greatest difference:", ", ".join(f"{x:.2g}" for x in off), "(Euler's step, another start)")
    tracker, none = CourseTracker(model, sd, SHIPS), np.full(SHIPS, np.nan)

    def stream() -> None:
        begin = max(tracker.time, 0.0)
        for k in range(1, 501):
            fix = (place[k, :1].repeat(SHIPS), place[k, 1:].repeat(SHIPS)) if k % 10 == 0 else (none, none)
            tracker.step(begin + 0.02 * k, *fix)

    stream()
    print(f"streaming {SHIPS} ships: {1e6 * best(stream, 3) / 500 / SHIPS:.2f} us per ship and step")


if __name__ == "__main__":
    main()
