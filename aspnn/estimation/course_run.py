"""A course filter's problem and what a run over it tells, by the compiled engine."""

import math
from dataclasses import dataclass

import numpy as np

from aspnn.estimation import course_engine as engine
from aspnn.estimation.course_model import CourseModel
from aspnn.estimation.problem import MISSING
from aspnn.schema import InputError


@dataclass(frozen=True)
class CourseProblem:
    """Fixes z (n, 2) at `time` (n) [s]: north and east [m], or latitude and longitude [rad] where `geodetic`; NaN where none.

    `sd` [m] is the standard deviation of a fix along each axis, `gate` the largest NIS of one that is believed. The filter begins
    with x0 (5) and P0 (5, 5) at the first epoch; only the place of x0 counts once there is a fix.
    """

    time: np.ndarray
    z: np.ndarray
    sd: float
    model: CourseModel
    x0: np.ndarray
    P0: np.ndarray
    geodetic: bool = False
    gate: float = engine.GATE


@dataclass(frozen=True)
class CourseRun:
    """The course filter along n epochs: mean (n, 5) before and after each fix, covariance (n, 5, 5) after it.

    `innovation`, `whitened` (n, 2) and `nis` (n) are NaN where no fix was judged, `fate` (n) as named in `problem`; `lost` (n):
    speed and course are those of a line through the recent fixes. The log-likelihood counts a rejected fix as one at the gate.
    """

    predicted: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    innovation: np.ndarray
    whitened: np.ndarray
    nis: np.ndarray
    fate: np.ndarray
    lost: np.ndarray
    log_likelihood: float


def problem_of(time, z, sd: float, model: CourseModel, geodetic: bool = False) -> CourseProblem:
    """The problem of fixes z (n, 2) that begins at their first, at rest, for all it knows. Raises InputError where there is none."""
    time, z = np.asarray(time, float), np.ascontiguousarray(z, float)
    known = np.isfinite(z).all(axis=1)
    if not (known.any() and 0 < sd < math.inf):
        raise InputError(
            f"course filter: {int(known.sum())} fixes with an sd of {sd:g} m; it needs a fix and a positive sd"
        )
    x0 = np.array([*z[np.argmax(known)], 0.0, 0.0, 0.0])
    speed, turn = model.speed_density / (2 * model.alpha_speed), model.turn_density / (2 * model.alpha_turn)
    P0 = np.diag([sd**2, sd**2, speed, engine.UNIFORM, turn])
    return CourseProblem(time, z, sd, model, x0, P0, geodetic)


def settings(model: CourseModel, gate: float = engine.GATE) -> np.ndarray:
    """What the engine takes for the model: densities, Singer's constants, and the gate."""
    return np.array([model.speed_density, model.turn_density, model.alpha_speed, model.alpha_turn, gate])


def run(problem: CourseProblem) -> CourseRun:
    """Filter a problem: between fixes by the model, at each fix one gated update; see `course_engine`."""
    p, n = problem, len(problem.time)
    out = (
        np.empty((n, 5)),
        np.empty((n, 5)),
        np.empty((n, 5, 5)),
        np.full((n, 2), np.nan),
        np.full((n, 2), np.nan),
        np.full(n, np.nan),
        np.full(n, MISSING, np.int8),
        np.ones(n, bool),
    )
    memory = np.zeros(engine.MEMORY)
    memory[[engine.NOW, engine.LAST, engine.SINCE]] = p.time[0], p.time[0], engine.SURE
    likelihood = engine.run_log(
        settings(p.model, p.gate), p.geodetic, p.sd**2, p.x0.copy(), p.P0.copy(), memory, p.time, p.z, out
    )
    return CourseRun(*out, log_likelihood=likelihood)


def ahead(run_: CourseRun, model: CourseModel, delay: float, geodetic: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, 5) and covariances (n, 5, 5) `delay` [s] after those of a run: of fixes that come late by it."""
    x, P = run_.mean.copy(), run_.covariance.copy()
    engine.advance_all(settings(model), geodetic, x, P, delay)
    return x, P
