"""Noise by maximum likelihood: what a vessel's recordings say of its sensors and of how abruptly it manoeuvres."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from aspnn.estimation import compiled
from aspnn.estimation.measurements import from_log
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Noise, Vessel

LEAST, MOST = 1e-4, 1e4  # times the start: bounds of the search


def tune_noise(logs: Sequence[Log], vessel: Vessel, sensors: bool = False) -> Noise:
    """The noise that makes the innovations of `logs` most likely, starting from `vessel.noise` (Nelder-Mead on logarithms).

    First yaw_jerk_density with CAA, then jerk_density with CTRA on the tuned headings; with `sensors` also the standard
    deviations of each filter's sensors that the logs have. Tune on other voyages than those the filter is judged by.
    Raises InputError for no log.
    """
    if not logs:
        raise InputError("no log to tune the noise on")
    size = vessel.service_speed, vessel.length
    measured = [from_log(replace(log, vessel=vessel)) for log in logs]
    noise = vessel.noise

    def seen(values: Callable) -> bool:
        return any(np.isfinite(values(m)).any() for m in measured)

    names = ["yaw_jerk_density"]
    if sensors:
        names += ["heading"] + (["yaw_rate"] if seen(lambda m: m.yaw_rate) else [])

    def turning(noise: Noise) -> float:
        return sum(compiled.run(heading_problem(m, noise, *size)).log_likelihood for m in measured)

    noise = _maximise(turning, noise, names)
    headings = [compiled.run(heading_problem(m, noise, *size)) for m in measured]
    names = ["jerk_density"]
    if sensors:
        names += ["position"] + (["acceleration"] if seen(lambda m: m.acceleration) else [])

    def moving(noise: Noise) -> float:
        return sum(
            compiled.run(motion_problem(m, noise, h.mean, h.covariance, *size)).log_likelihood
            for m, h in zip(measured, headings, strict=True)
        )

    return _maximise(moving, noise, names)


def _maximise(likelihood: Callable[[Noise], float], start: Noise, names: Sequence[str]) -> Noise:
    """`start` with the fields `names` where `likelihood` is greatest."""

    def at(logarithms) -> Noise:
        factors = np.clip(np.exp(logarithms), LEAST, MOST)
        return replace(start, **{name: getattr(start, name) * float(f) for name, f in zip(names, factors, strict=True)})

    simplex = np.vstack([np.zeros(len(names)), math.log(3.0) * np.eye(len(names))])
    options = {"initial_simplex": simplex, "xatol": 0.01, "fatol": 0.01, "maxiter": 200}
    best = minimize(lambda q: -likelihood(at(q)), np.zeros(len(names)), method="Nelder-Mead", options=options)
    return at(best.x)
