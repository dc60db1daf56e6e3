"""Noise, delays and compass offset by maximum likelihood: what a vessel's recordings say of its sensors and manoeuvres.

Delays are counted from the quickest sensor, since a delay that all sensors share cannot be seen. The search goes by three
lags: `turn_lag`, how much later the compass is than the gyro (negative: earlier); `position_lag` and `acceleration_lag`, how
much later fixes and accelerations are than the quicker of compass and gyro. A lag or an offset that lies within SURE
standard errors of what the vessel had before stays as it was. Standard errors take the model as true; a gyro that is seconds
late is found to 1 %, five seconds as 4.96, with errors told too small, since `exact` neglects a correlation then.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize

from aspnn.estimation import compiled
from aspnn.estimation.compiled import Run
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import Measurements, from_log
from aspnn.estimation.problem import REJECTED, Problem
from aspnn.instruments import Calibration, Noise
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Vessel

SURE = 3.0
APART = 1.0  # m between antennas that tell a heading together
MOST = math.log(1e4)  # a noise is sought from its start / 10,000 to its start x 10,000
# unit of the search and its bound (+-); with these no delay leaves the range that a vessel file allows
LINEAR = {
    "heading_offset": (math.radians(1.0), math.pi),
    "turn_lag": (0.2, 12.5),
    "position_lag": (0.2, 2.5),
    "acceleration_lag": (0.2, 2.5),
}
SCAN = (0.0, 2.5, -2.5, 5.0, -5.0, 10.0, -10.0, 20.0, -20.0, 40.0, -40.0)  # units from the start, looked at first
ROUNDS = 5  # of searches, each without what lies beyond the gates at its start
TURNING = ("yaw_jerk_density", "heading", "yaw_rate", "turn_lag")  # told by CAA; the others by CTRA
TINY = 1e-12  # least curvature: a value whose likelihood is flat has an error of a million units


@dataclass(frozen=True)
class Tuning:
    """A vessel at the `start`, tuned (`vessel`), and how sure it is, in SI and radians.

    `errors`: standard error of each field of Noise and Calibration that was estimated, from the curvature of the
    log-likelihood. `notes`: why a field that was sought stayed as it was. `before`, `after`: the log-likelihood of CAA and
    CTRA together, per epoch.
    """

    start: Vessel
    vessel: Vessel
    errors: dict[str, float]
    notes: dict[str, str]
    before: float
    after: float


def tune(
    logs: Sequence[Log],
    vessel: Vessel,
    sensors: bool = False,
    delays: bool = False,
    heading: bool = False,
    watch: Callable[[Iterable, str, int], Iterable] = lambda things, what, count: things,
) -> Tuning:
    """The vessel whose filters find the innovations of `logs` most likely, starting from `vessel` as it is.

    First yaw_jerk_density with CAA, then jerk_density with CTRA. With `sensors` also the standard deviations of the sensors
    that the logs have, with `delays` the lags between them, with `heading` the compass offset (two antennas APART metres
    apart at least). Tune on other voyages than those the filter is judged by. Raises InputError for no log.
    """
    if not logs:
        raise InputError("no log to tune the noise on")
    measured = tuple(from_log(replace(log, vessel=vessel)) for log in logs)
    voyages = _Voyages(measured, (vessel.service_speed, vessel.length))
    whole = voyages.likelihood(both=True)
    names, notes = _sought(measured, sensors, delays, heading)
    stages = [[n for n in names if n in TURNING], [n for n in names if n not in TURNING]]
    epochs = sum(len(m.time) for m in measured)
    tuned = vessel
    kept: list[str] = []
    parts: list[np.ndarray] = []
    for stage in watch(stages, "tuning", len(stages)):
        tuned, found, covariance, said = _maximise(voyages, tuned, stage)
        kept, parts, notes = [*kept, *found], [*parts, covariance], notes | said
    errors = _errors(tuned, kept, parts)
    if delays:
        fields = (f"{sensor}_delay" for sensor in ("position", "heading", "yaw_rate", "acceleration"))
        notes = {name: "the clock that the others are late against" for name in fields if name not in errors} | notes
    return Tuning(vessel, tuned, errors, notes, whole(vessel) / epochs, whole(tuned) / epochs)


def _sought(measured: Sequence[Measurements], sensors: bool, delays: bool, heading: bool):
    """Names of the values that the logs can tell, and why others cannot be told."""
    gyro = any(np.isfinite(m.yaw_rate).any() for m in measured)
    felt = any(np.isfinite(m.acceleration).any() for m in measured)
    names, notes = ["yaw_jerk_density", "jerk_density"], dict[str, str]()
    if heading and any(_baseline(m) >= APART for m in measured):
        names.append("heading_offset")  # before the lags: a wrong heading would draw them away in the scan
    elif heading:
        notes["heading_offset"] = "needs two antennas apart: with one it looks like a drift angle"
    if sensors:
        names += ["heading", "position"] + ["yaw_rate"] * gyro + ["acceleration"] * felt
    if delays:
        names += ["position_lag"] + ["turn_lag"] * gyro + ["acceleration_lag"] * felt
        missing = [name for name, have in (("yaw_rate", gyro), ("acceleration", felt)) if not have]
        notes |= {f"{name}_delay": "the logs have no such sensor" for name in missing}
    return names, notes


def _baseline(m: Measurements) -> float:
    """Greatest distance [m] between antennas that have fixes."""
    places = np.array([complex(*m.stations[name]) for name, p in m.fixes.items() if np.isfinite(p).any()])
    return float(np.abs(places[:, None] - places).max())


def _lags(c: Calibration) -> dict[str, float]:
    """The offset and the three lags of a calibration."""
    clock = min(c.heading_delay, c.yaw_rate_delay)
    return {
        "heading_offset": c.heading_offset,
        "turn_lag": c.heading_delay - c.yaw_rate_delay,
        "position_lag": c.position_delay - clock,
        "acceleration_lag": c.acceleration_delay - clock,
    }


def _delays(heading_offset: float, turn_lag: float, position_lag: float, acceleration_lag: float) -> Calibration:
    """The calibration of an offset and three lags: the quickest sensor has no delay."""
    clock = max(0.0, -position_lag, -acceleration_lag)
    return Calibration(
        heading_offset=heading_offset,
        position_delay=clock + position_lag,
        heading_delay=clock + max(turn_lag, 0.0),
        yaw_rate_delay=clock + max(-turn_lag, 0.0),
        acceleration_delay=clock + acceleration_lag,
    )


def _moved(vessel: Vessel, names: Sequence[str], q) -> Vessel:
    """`vessel` with the values `names` moved by `q`: noise times exp(q), the others by q of their units."""
    noise, c = vessel.noise, vessel.calibration
    moves = {name: float(x) for name, x in zip(names, q, strict=True)}
    factors = {name: getattr(noise, name) * math.exp(x) for name, x in moves.items() if name not in LINEAR}
    shifts = {name: x * LINEAR[name][0] for name, x in moves.items() if name in LINEAR}
    if any(name != "heading_offset" for name in shifts):
        c = _delays(**{name: value + shifts.get(name, 0.0) for name, value in _lags(c).items()})
    elif shifts:
        c = replace(c, heading_offset=c.heading_offset + shifts["heading_offset"])
    return replace(vessel, noise=replace(noise, **factors), calibration=c)


@dataclass(frozen=True)
class _Voyages:
    """The measurements that tune a vessel of service speed and length `size`, and which values are left out.

    `left` holds for each log what of CAA and of CTRA (n, b) lay beyond the gates at a point of the search; then the gates
    are open, since a value that crosses its gate would make the likelihood jump.
    """

    measured: tuple[Measurements, ...]
    size: tuple[float, float]
    left: tuple[tuple[np.ndarray, np.ndarray], ...] = ()

    def runs(self, vessel: Vessel, turnings: Callable) -> Iterator[tuple[Run, Run]]:
        """The runs of CAA, which `turnings` makes of noise and calibration, and of CTRA on their headings."""
        noise, c = vessel.noise, vessel.calibration
        caa = turnings(
            replace(noise, position=1.0, acceleration=1.0, jerk_density=1.0),
            replace(c, position_delay=0.0, acceleration_delay=0.0),
        )
        for k, (m, turning) in enumerate(zip(self.measured, caa, strict=True)):
            motion = motion_problem(replace(m, calibration=c), noise, turning.mean, turning.covariance, *self.size)
            yield turning, self._run(motion, k, 1)

    def turnings(self, noise: Noise, calibration: Calibration) -> list[Run]:
        """The runs of CAA."""
        problems = (heading_problem(replace(m, calibration=calibration), noise, *self.size) for m in self.measured)
        return [self._run(problem, k, 0) for k, problem in enumerate(problems)]

    def _run(self, problem: Problem, log: int, stage: int) -> Run:
        if self.left:
            z = np.where(self.left[log][stage][:, :, None], np.nan, problem.z)
            problem = replace(problem, z=z, gates=np.full_like(problem.gates, np.inf))
        return compiled.run(problem)

    def likelihood(self, both: bool) -> Callable[[Vessel], float]:
        """Log-likelihood of CAA, and of CTRA where `both`, summed over the logs. CAA runs again only where it changes."""
        turnings = lru_cache(maxsize=2)(self.turnings)

        def at(vessel: Vessel) -> float:
            if both:
                return sum(a.log_likelihood + b.log_likelihood for a, b in self.runs(vessel, turnings))
            return sum(run.log_likelihood for run in turnings(vessel.noise, vessel.calibration))

        return at

    def gated(self, vessel: Vessel) -> "_Voyages":
        """The voyages without what lies beyond the gates of `vessel`."""
        runs = self.runs(vessel, self.turnings)
        return replace(self, left=tuple((a.fate == REJECTED, b.fate == REJECTED) for a, b in runs))


def _maximise(voyages: _Voyages, vessel: Vessel, names: Sequence[str]):
    """`vessel` where the likelihood is greatest, the values that moved, their covariance, and notes on those that did not.

    Lags and offset are first looked for far and wide, one by one; then all values are sought together. At the end the
    likelihood is a paraboloid: all values move to its top; the least sure of lags and offset is put back and the rest moved
    to the top of what is left, until all are sure.
    """
    both = any(name not in TURNING for name in names)
    likelihood = voyages.likelihood(both)

    def cost(q) -> float:
        return -likelihood(_moved(vessel, names, q))

    bounds = _bounds(vessel.calibration, names)
    best = np.zeros(len(names))
    for i, name in enumerate(names):
        if name in LINEAR:
            tries = [x for x in SCAN if bounds[i][0] < x < bounds[i][1]]
            best[i] = min(tries, key=lambda x: cost(np.where(np.arange(len(names)) == i, x, best)))
    for _ in range(ROUNDS):
        smooth = voyages.gated(_moved(vessel, names, best)).likelihood(both)
        start, best = best, _lowest(lambda q: -smooth(_moved(vessel, names, q)), best, bounds)  # noqa: B023
        if np.abs(best - start).max() < 0.01:
            break
    best, information = _settled(lambda q: -smooth(_moved(vessel, names, q)), best, bounds)
    notes = {}
    for name, x, (low, high) in zip(names, best, bounds, strict=True):
        if not low + 1e-6 < x < high - 1e-6:
            notes[_FIELDS.get(name, name)] = "at the bound of the search: the logs do not tell it"
    names = list(names)
    while True:
        covariance = _inverse(information)
        errors = np.sqrt(np.diag(covariance))
        sure = {i: abs(best[i]) / errors[i] for i, name in enumerate(names) if name in LINEAR}
        weak = min(sure, key=sure.__getitem__, default=None)
        if weak is None or sure[weak] >= SURE:
            return _moved(vessel, names, best), names, covariance, notes
        notes |= _unsure(names.pop(weak), best[weak], errors[weak])
        best = np.delete(best - covariance[weak] / covariance[weak, weak] * best[weak], weak)
        information = np.delete(np.delete(information, weak, 0), weak, 1)


_FIELDS = {"turn_lag": "heading_delay", "position_lag": "position_delay", "acceleration_lag": "acceleration_delay"}
_AGAINST = {
    "heading_offset": "compass against antennas",
    "turn_lag": "compass against gyro",
    "position_lag": "fixes against compass and gyro",
    "acceleration_lag": "IMU against compass and gyro",
}


def _unsure(name: str, x: float, error: float) -> dict[str, str]:
    """The note on a lag or an offset that was put back: what it would have been moved by, and its standard error."""
    unit, sign = (math.degrees(LINEAR[name][0]), "deg") if name == "heading_offset" else (LINEAR[name][0], "s")
    text = f"{_AGAINST[name]} {x * unit:+.3f} +- {error * unit:.3f} {sign}: within {SURE:g} standard errors, left"
    return {_FIELDS.get(name, name): text}


def _bounds(calibration: Calibration, names: Sequence[str]) -> list[tuple[float, float]]:
    lags = _lags(calibration)
    linear = {
        name: (((-most - lags[name]) / unit), (most - lags[name]) / unit) for name, (unit, most) in LINEAR.items()
    }
    return [linear.get(name, (-MOST, MOST)) for name in names]


def _lowest(
    cost: Callable[[np.ndarray], float], start: np.ndarray, bounds: Sequence[tuple[float, float]]
) -> np.ndarray:
    """Where `cost` is least near `start`, by L-BFGS-B in units in which the curvature at the start is one."""
    scale = _steps(cost, start)
    found = minimize(
        lambda x: cost(x * scale),
        start / scale,
        method="L-BFGS-B",
        bounds=[(low / s, high / s) for (low, high), s in zip(bounds, scale, strict=True)],
        options={"eps": 1e-2, "ftol": 3e-8, "gtol": 0.3},
    )
    return found.x * scale


def _steps(cost: Callable[[np.ndarray], float], q: np.ndarray) -> np.ndarray:
    """Steps of the values at `q` that raise `cost` by about a half, as its curvature tells."""
    least, h = cost(q), np.full(len(q), 0.03)
    rise = [cost(q + s) + cost(q - s) - 2 * least for s in np.diag(h)]
    return np.clip(h / np.sqrt(np.maximum(rise, TINY)), 1e-4, 1.0)


def _settled(
    cost: Callable[[np.ndarray], float], best: np.ndarray, bounds: Sequence[tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """`best` after a Newton step, if that lowers `cost`, and the matrix of second derivatives of `cost`.

    Derivatives are differences over steps that raise `cost` by about a half.
    """
    n, least, h = len(best), cost(best), np.diag(_steps(cost, best))
    up, down = (np.array([cost(best + sign * s) - least for s in h]) for sign in (1, -1))
    information = np.diag((up + down) / np.diag(h) ** 2)
    for i in range(n):
        for j in range(i):
            step = h[i] + h[j]
            mixed = cost(best + step) + cost(best - step) - 2 * least - up[i] - down[i] - up[j] - down[j]
            information[i, j] = information[j, i] = mixed / (2 * h[i, i] * h[j, j])
    step = _inverse(information) @ ((up - down) / (2 * np.diag(h)))
    settled = np.clip(best - step, *np.transpose(bounds))  # where the likelihood is flat a Newton step is far too long
    return (settled if cost(settled) < least else best), information


def _inverse(information: np.ndarray) -> np.ndarray:
    """Its inverse; where the likelihood is flat the variance is 1 / TINY."""
    values, vectors = np.linalg.eigh(information)
    return vectors / np.maximum(values, TINY) @ vectors.T


def _errors(vessel: Vessel, names: Sequence[str], covariances: Sequence[np.ndarray]) -> dict[str, float]:
    """Standard errors of the fields of Noise and Calibration that depend on the values `names` of this covariance."""

    def fields(q) -> dict[str, float]:
        moved = _moved(vessel, names, q)
        return asdict(moved.noise) | asdict(moved.calibration)

    covariance, step = block_diag(*covariances), 1e-6
    sides = [(fields(step * e), fields(-step * e)) for e in np.eye(len(names))]
    found = {}
    for name in fields(np.zeros(len(names))):
        slope = np.array([(up[name] - down[name]) / (2 * step) for up, down in sides])
        if slope.any():
            found[name] = math.sqrt(slope @ covariance @ slope)
    return found
