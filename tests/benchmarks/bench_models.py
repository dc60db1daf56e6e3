"""Speed of the compiled EKF of CTRA and UKF of CMM beside filterpy with the same inner steps, in one run on one core.

python tests/benchmarks/bench_models.py

The plain loops are filterpy's filters as a textbook uses them, over the first epochs of the log: the thesis's twenty midpoint
steps of 0.005 s per epoch in numpy, for the EKF on mean and covariance, for the UKF on each sigma point, or (vectorised) on all
points at once; one update per epoch with six rows; in turns with the compiled ones, which do the same steps, and everything that gates and
statistics need. Then: one hour of 10 Hz through CAA, CTRA at two antennas and the CMM UKF, with the default step; and fifty
Monte Carlo runs of ten minutes. Processor times, best of several; machines differ, so quote the ratios.
"""

import time

import numpy as np
from bench_filters import log_of
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from aspnn.angles import wrap
from aspnn.estimation import compiled
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import from_log
from aspnn.estimation.models import THESIS_SCHEME, Cmm, Ctra, Sigma
from aspnn.estimation.nonlinear import from_antenna, model_problem

STEP, INNER = 0.005, 20


def ctra(x):
    c, s = np.cos(x[4]), np.sin(x[4])
    return np.array([c * x[2] - s * x[3], s * x[2] + c * x[3], x[6], x[7], x[5], 0.0, 0.0, 0.0])


def ctra_jacobian(x):
    c, s, F = np.cos(x[4]), np.sin(x[4]), np.zeros((8, 8))
    F[0, 2:5] = c, -s, -s * x[2] - c * x[3]
    F[1, 2:5] = s, c, c * x[2] - s * x[3]
    F[2, 6] = F[3, 7] = F[4, 5] = 1.0
    return F


def ctra_reads(x):
    return np.array([x[4], x[5], x[0], x[1], x[6] - x[3] * x[5], x[7] + x[2] * x[5]])


def ctra_slopes(x):
    H = np.zeros((6, 8))
    H[0, 4] = H[1, 5] = H[2, 0] = H[3, 1] = H[4, 6] = H[5, 7] = 1.0
    H[4, 3], H[4, 5], H[5, 2], H[5, 5] = -x[5], -x[3], x[5], x[2]
    return H


def cmm(x):
    speed = np.sqrt(x[2] * x[2] + x[3] * x[3])
    f_n, f_e = x[2] / speed, x[3] / speed
    return np.array([x[2], x[3], x[6] * f_n - x[7] * f_e, x[6] * f_e + x[7] * f_n, x[5], 0.0, 0.0, 0.0])


def cmm_steps(x, dt):
    for _ in range(INNER):
        x = x + STEP * cmm(x + STEP / 2 * cmm(x))
    return x


def cmm_points(x):
    """As `cmm`, of many states (s, 8)."""
    f = x[:, 2:4] / np.sqrt((x[:, 2:4] ** 2).sum(axis=1, keepdims=True))
    out = np.zeros_like(x)
    out[:, :2], out[:, 4] = x[:, 2:4], x[:, 5]
    out[:, 2] = x[:, 6] * f[:, 0] - x[:, 7] * f[:, 1]
    out[:, 3] = x[:, 6] * f[:, 1] + x[:, 7] * f[:, 0]
    return out


def cmm_reads(x):
    _, _, a_n, a_e = cmm(x)[:4]
    c, s = np.cos(x[4]), np.sin(x[4])
    return np.array([x[4], x[5], x[0], x[1], c * a_n + s * a_e, c * a_e - s * a_n])


def residual(a, b):
    y = a - b
    y[0] = wrap(y[0])
    return y


class PlainExtended(ExtendedKalmanFilter):
    """filterpy's, with the thesis's prediction: the midpoint rule on mean and covariance."""

    def predict(self, u=0):
        x, P = self.x, self.P
        for _ in range(INNER):
            F = ctra_jacobian(x)
            middle = x + STEP / 2 * ctra(x)
            halfway = P + STEP / 2 * (F @ P + P @ F.T + self.Q)
            F = ctra_jacobian(middle)
            x, P = x + STEP * ctra(middle), P + STEP * (F @ halfway + halfway @ F.T + self.Q)
        self.x, self.P = x, P


class VectorisedUnscented(UnscentedKalmanFilter):
    """filterpy's, with all sigma points taken on at once."""

    def compute_process_sigmas(self, dt, fx=None, **_):
        x = self.points_fn.sigma_points(self.x, self.P)
        for _ in range(INNER):
            x = x + STEP * cmm_points(x + STEP / 2 * cmm_points(x))
        self.sigmas_f = x


def unscented(kind, p, R):
    points = MerweScaledSigmaPoints(8, p.sigma.alpha, p.sigma.beta, p.sigma.kappa)
    kf = kind(8, 6, 0.1, cmm_reads, cmm_steps, points, residual_z=residual)
    kf.x, kf.P, kf.R, kf.Q = p.x0.copy(), p.P0.copy(), R, 0.1 * np.diag(p.model.density)
    kf.x[2:4] = 5 * np.cos(kf.x[4]), 5 * np.sin(kf.x[4])  # the printed model has no direction at rest
    return kf


def best(function, runs=7):
    """Least processor time [s] of several calls."""
    times = []
    for _ in range(runs):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    log = log_of(60)
    m, noise = from_log(log), log.vessel.noise
    size, n = (log.vessel.service_speed, log.vessel.length), len(log)
    one = from_antenna(m, "bow")
    one.stations["imu"] = (0.0, 0.0)  # the textbook's filter has every sensor at one place
    problems = [
        model_problem(one, noise, f.of(noise), *size, scheme=THESIS_SCHEME, sigma=s)
        for f, s in ((Ctra, None), (Cmm, Sigma()))
    ]
    for p in problems:
        compiled.run(p)
    R = (
        np.diag([noise.heading, noise.yaw_rate, noise.position, noise.position, noise.acceleration, noise.acceleration])
        ** 2
    )
    rows = np.column_stack([one.heading, one.yaw_rate, one.fixes["bow"], one.acceleration])
    ekf = PlainExtended(8, 6)
    ekf.x, ekf.P, ekf.R, ekf.Q = problems[0].x0.copy(), problems[0].P0.copy(), R, np.diag(problems[0].model.density)

    def extended():
        for z in rows[:1000]:
            ekf.predict()
            ekf.update(z, ctra_slopes, ctra_reads, residual=residual)

    def loop(kf, epochs):
        for z in rows[:epochs]:
            kf.predict()
            kf.update(z)

    print(f"twenty midpoint steps of {STEP} s per epoch, one antenna, compass, gyro and IMU, {n} epochs")
    slow = (
        ("CTRA EKF, plain filterpy", 0, extended, 1000),
        ("CMM UKF, plain filterpy", 1, lambda: loop(unscented(UnscentedKalmanFilter, problems[1], R), 100), 100),
        ("CMM UKF, vectorised", 1, lambda: loop(unscented(VectorisedUnscented, problems[1], R), 300), 300),
    )
    for what, which, function, epochs in slow:
        rounds = [(best(function, 1), best(lambda p=problems[which]: compiled.run(p), 2)) for _ in range(5)]
        plain, ours = (
            min(times) * 1e6 / count for times, count in zip(zip(*rounds, strict=True), (epochs, n), strict=True)
        )
        print(f"{what:26s} {plain:8.1f} us/step, compiled {ours:6.2f} us/step, ratio {plain / ours:5.0f}")

    def hour():
        turn = compiled.run(heading_problem(m, noise, *size))
        turning = turn.mean, turn.covariance
        for name in m.fixes:
            compiled.run(motion_problem(from_antenna(m, name), noise, *turning, *size))
        compiled.run(model_problem(m, noise, Cmm.of(noise, given=True), *size, turning, sigma=Sigma()))

    hour()
    print(f"one hour of 10 Hz through CAA, CTRA at two antennas and CMM UKF: {best(hour, 5):.3f} s")
    short = from_log(log_of(10))
    runs = [model_problem(short, noise, f.of(noise), *size, sigma=s) for f, s in ((Ctra, None), (Cmm, Sigma()))]
    for what, p in zip(("CTRA EKF", "CMM UKF"), runs, strict=True):
        print(f"fifty runs of ten minutes, {what}: {best(lambda p=p: compiled.run_batch([p] * 50), 1):.2f} s")


if __name__ == "__main__":
    main()
