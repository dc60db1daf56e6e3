"""Speed of the compiled CAA and CTRA beside a plain filterpy loop on the same models, in one run.

python tests/benchmarks/bench_filters.py [MINUTES]

The plain loop, over the first ten minutes, is filterpy as a textbook uses it: a predict per epoch and an update per
sensor, transition and noise computed as it goes, nothing gated, nothing stored but the means. Compiled times hold the making of the problems, the
gate and everything that a smoother needs. Times are the best of several runs; machines differ, so quote the ratio.
"""

import sys
import time

import numpy as np
from filterpy.kalman import KalmanFilter

from aspnn.estimation import compiled, filter_log
from aspnn.estimation.exact import heading_problem, motion_problem, transition, white_jerk
from aspnn.estimation.measurements import from_log
from aspnn.simulation import Scenario, simulate_scenario

PLAIN = 6000  # epochs that the plain loop runs over


def log_of(minutes: float):
    """A log of cargo90 with the sensors of the thesis, 10 Hz."""
    scenario = {
        "name": "bench",
        "vessel": "cargo90",
        "duration_s": 60 * minutes,
        "seed": 1,
        "start": {"speed_kn": 11.5, "latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": 350},
        "manoeuvre": {"kind": "random-orders"},
    }
    return next(simulate_scenario(Scenario.model_validate(scenario)))[0]


def plain_filterpy(m, noise, first, second):
    """CAA and CTRA step by step; returns the means of CTRA. Start, measurements and R are taken from the problems."""
    turning, fix = KalmanFilter(dim_x=3, dim_z=1), KalmanFilter(dim_x=6, dim_z=2)
    turning.x, turning.P, fix.x, fix.P = first.x0, first.P0, second.x0, second.P0
    headings, motions = np.empty((PLAIN, 3)), np.empty((PLAIN, 6))
    for k, t in enumerate(m.time[:PLAIN]):
        if k:
            dt = t - m.time[k - 1]
            F, Q = transition(m.time[k - 1 : k + 1], headings[k - 1 : k + 1], noise.jerk_density)
            fix.predict(F=F[1], Q=Q[1])
            turning.predict(
                F=np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]]), Q=white_jerk(dt, noise.yaw_jerk_density)
            )
        for b in range(2):
            H = first.H[k, b, :1]
            y = first.z[k, b, :1] - H @ turning.x
            turning.update(H @ turning.x + np.mod(y + np.pi, 2 * np.pi) - np.pi, R=first.R[k, b, :1, :1], H=H)
        headings[k] = turning.x
        for b in range(second.z.shape[1]):
            fix.update(second.z[k, b], R=second.R[k, b], H=second.H[k, b])
        motions[k] = fix.x
    return motions


def best(function, runs=5):
    """Least wall time [s] of several calls, and the last result."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return min(times), result


def main(minutes: float) -> None:
    log = log_of(minutes)
    m, vessel = from_log(log), log.vessel
    size, n = (vessel.service_speed, vessel.length), len(log)

    def cascade():
        first = heading_problem(m, vessel.noise, *size)
        turning = compiled.run(first)
        second = motion_problem(m, vessel.noise, turning.mean, turning.covariance, *size)
        return first, second, compiled.run(second)

    cascade()  # compiles
    ours, (first, second, moving) = best(cascade)
    engine, _ = best(lambda: (compiled.run(first), compiled.run(second)))
    plain, motions = best(lambda: plain_filterpy(m, vessel.noise, first, second), 1)
    sd = np.sqrt(np.diagonal(moving.covariance, axis1=1, axis2=2))
    apart = np.median(np.abs(moving.mean[:PLAIN] - motions) / sd[:PLAIN])
    whole, _ = best(lambda: filter_log(log), 3)
    print(f"cargo90 with two antennas, compass, gyro and IMU, {n} epochs")
    print(f"plain filterpy loop            {plain / PLAIN * 1e6:8.2f} us/step")
    for what, seconds in (("with its models", ours), ("filters alone", engine)):
        print(f"compiled, {what:20s} {seconds / n * 1e6:8.2f} us/step   ratio {plain / PLAIN / seconds * n:6.0f}")
    print(f"filter_log, from log to states {whole / n * 1e6:8.2f} us/step   {whole:.3f} s for {minutes:g} min of 10 Hz")
    print(f"median difference of the means {apart:8.1e} sd (the plain loop does not gate)")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
