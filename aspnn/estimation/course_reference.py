"""The reference of the course filter: the same problem step by step on filterpy. Slow and plain; the oracle of the compiled one."""

import math

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from aspnn.angles import wrap
from aspnn.estimation.course_engine import FEWEST, GAP, HELD, LOST, RECENT, TELLS, UNIFORM
from aspnn.estimation.course_model import CourseModel, per_metre, transition
from aspnn.estimation.course_run import CourseProblem, CourseRun
from aspnn.estimation.problem import COASTING, MISSING, REACQUIRED, REJECTED, REJECTIONS, USED

C = np.eye(2, 5)


class _Line:
    """The fixes of late, kept one by one, and the line of weighted least squares through them."""

    def __init__(self):
        self.fixes: list[tuple[float, np.ndarray]] = []
        self.weights = np.empty(0)

    def take(self, time: float, z: np.ndarray, geodetic: bool) -> None:
        if self.fixes:
            gap, away = time - self.fixes[-1][0], z - self.fixes[-1][1]
            if gap > GAP:
                self.restart()
            else:
                if geodetic:
                    z = self.fixes[-1][1] + [away[0], float(wrap(away[1]))]
                self.weights = self.weights * max(math.exp(-gap / RECENT), HELD)
        self.fixes.append((time, z))
        self.weights = np.append(self.weights, 1.0)

    def restart(self) -> None:
        self.fixes, self.weights = [], np.empty(0)

    def velocity(self) -> tuple[np.ndarray, float, float]:
        """Slope (2), weighted sum of squared times, and the weighted mean of time."""
        t, z = np.array([f[0] for f in self.fixes]), np.array([f[1] for f in self.fixes])
        middle = float(np.average(t, weights=self.weights))
        square = float(self.weights @ (t - middle) ** 2)
        return (self.weights * (t - middle)) @ (z - z[0]) / square, square, middle


def _by_line(line: _Line, model: CourseModel, chi: float, now: float, z, R, metres):
    """Of a lost ship state, covariance, and whether her recent fixes tell a direction; `metres` (2) scale what coordinates count in."""
    turning = model.turn_density / (2 * model.alpha_turn)
    x, P = np.array([*z, 0.0, chi, 0.0]), np.zeros((5, 5))
    P[:2, :2], P[4, 4], P[3, 3] = R, turning, UNIFORM
    if len(line.fixes) < 2:
        P[2, 2] = model.speed_density / (2 * model.alpha_speed)
        return x, P, False
    slope, square, middle = line.velocity()
    v_n, v_e = slope / metres
    variance, lag = float(np.mean(np.diag(R) / metres**2)) / square, now - middle
    speed = math.hypot(v_n, v_e)
    x[2], x[3] = speed, chi + float(wrap(math.atan2(v_e, v_n) - chi))
    P[2, 2] = variance + model.speed_density * lag
    tells = len(line.fixes) >= FEWEST and speed**2 > TELLS**2 * variance
    if tells:
        P[3, 3] = variance / speed**2 + min(lag**2 * turning, LOST / 2)
        P[3, 4] = P[4, 3] = min(lag * turning, math.sqrt(LOST / 2 * turning))
    return x, P, tells


def run(problem: CourseProblem) -> CourseRun:
    """Filter a problem with filterpy: a prediction per epoch, an update per fix; as `course_run.run`, to rounding."""
    p, n = problem, len(problem.time)
    predicted, mean = np.empty((2, n, 5))
    covariance = np.empty((n, 5, 5))
    innovation, whitened = np.full((2, n, 2), np.nan)
    nis, fate, lost = np.full(n, np.nan), np.full(n, MISSING, np.int8), np.ones(n, bool)
    kf = ExtendedKalmanFilter(dim_x=5, dim_z=2)
    kf.x, kf.P = p.x0.copy(), p.P0.copy()
    line, follows, now = _Line(), False, float(p.time[0])
    used, rejections, since, likelihood = now, 0, math.inf, 0.0
    for k, time in enumerate(p.time):
        dt, now = round((time - now) * 1e9) / 1e9, time
        if dt > 0:
            x, kf.F, kf.Q = transition(p.model, kf.x, dt, p.geodetic)
            kf.predict()
            kf.x = x  # filterpy moves the mean by F x, which is not the model (E46)
        if kf.P[3, 3] > UNIFORM:
            kf.P[3, :] = kf.P[:, 3] = 0.0
            kf.P[3, 3] = UNIFORM
        predicted[k] = kf.x
        z = p.z[k]
        if np.isfinite(z).all():
            metres = np.array(per_metre(z[0])[:2]) if p.geodetic else np.ones(2)
            R = p.sd**2 * np.diag(metres**2)
            line.take(time, z, p.geodetic)
            if not follows:
                kf.x, kf.P, follows = _by_line(line, p.model, kf.x[3], time, z, R, metres)
                used, rejections, since, fate[k] = time, 0, math.inf, USED
            else:
                y = z - kf.x[:2]
                if p.geodetic:
                    y[1] = float(wrap(y[1]))
                S = C @ kf.P @ C.T + R
                square, taken = float(y @ np.linalg.solve(S, y)), USED
                if square > p.gate:
                    taken = REJECTED
                    if rejections >= REJECTIONS and time - used >= COASTING:
                        taken, follows, since = REACQUIRED, since >= FEWEST, 0
                        line.restart()
                        line.take(time, z, p.geodetic)
                        kf.P = kf.P + C.T @ np.outer(y, y) @ C
                        S = C @ kf.P @ C.T + R
                        square = float(y @ np.linalg.solve(S, y))
                innovation[k], nis[k], fate[k] = y, square, taken
                whitened[k] = np.linalg.solve(np.linalg.cholesky(S), y)
                size = np.linalg.slogdet(S / np.outer(metres, metres))[1]
                likelihood -= 0.5 * (2 * np.log(2 * np.pi) + size + min(square, p.gate))
                if taken == REJECTED:
                    rejections += 1
                else:
                    used, rejections, since = time, 0, since + 1
                    kf.update(z, HJacobian=lambda _: C, Hx=lambda x: x[:2], R=R, residual=lambda *_, y=y: y)
                    if p.geodetic:
                        kf.x[1] = float(wrap(kf.x[1]))
                    if kf.x[2] < 0:  # (U, chi) and (-U, chi + pi) are one motion (E48)
                        turned = np.diag([1.0, 1.0, -1.0, 1.0, 1.0])
                        kf.x, kf.P = turned @ kf.x + [0, 0, 0, np.pi, 0], turned @ kf.P @ turned
                    follows = follows and not kf.P[3, 3] > LOST
        mean[k], covariance[k], lost[k] = kf.x, kf.P, not follows
    return CourseRun(predicted, mean, covariance, innovation, whitened, nis, fate, lost, likelihood)
