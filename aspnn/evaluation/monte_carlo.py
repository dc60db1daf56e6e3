"""Errors against the truth, and Monte Carlo runs: the log drawn anew around its truth and filtered again (Paper II, 4.1)."""

import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from aspnn import checks, schema
from aspnn.angles import difference
from aspnn.estimation.cascade import Cascade, run_cascade
from aspnn.estimation.consistency import (
    CONDITION,
    Shares,
    average_bounds,
    lag_bound,
    lag_correlation,
    lag_products,
    nees,
    shares,
)
from aspnn.estimation.sensors import conditions, sensors
from aspnn.instruments import Calibration
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.simulation.sensing.sensors import Sensors, measure
from aspnn.simulation.voyage import Voyage

Watch = Callable[[Iterable, str, int], Iterable]  # (things, what is done, how many) -> the same things, shown

FAR = 10.0  # standard deviations; an error beyond is divergence
STATES = ("north", "east", "surge", "sway", "heading", "yaw_rate")
UNITS = {"north": "m", "east": "m", "surge": "m/s", "sway": "m/s", "heading": "deg", "yaw_rate": "deg/s"}
FILTERS = {"motion": slice(0, 4), "turning": slice(4, 6)}  # places among STATES, by the filter that estimates them


@dataclass(frozen=True)
class Errors:
    """Estimated minus true STATES (n, 6) in SI and radians, their standard deviations (n, 6), and NEES (n) by filter."""

    time: np.ndarray
    error: np.ndarray
    deviation: np.ndarray
    nees: dict[str, np.ndarray]

    def since(self, time: float) -> "Errors":
        """The part from `time` [s] on."""
        rows = self.time >= time
        squares = {name: value[rows] for name, value in self.nees.items()}
        return Errors(self.time[rows], self.error[rows], self.deviation[rows], squares)


@dataclass(frozen=True)
class Average:
    """An average over runs at every epoch `time` (n): its values, the bounds that hold 95 % of them, and the shares."""

    time: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    shares: Shares


@dataclass(frozen=True)
class MonteCarlo:
    """N runs with sensor noise drawn anew around the truth: averages of NIS by sensor and by filter (`joint`), of the
    autocorrelation between successive epochs (E30), of NEES by filter; rms errors (6) over runs and time, and how many runs diverged.
    """

    runs: int
    seed: int
    nis: dict[str, Average]
    lag_one: dict[str, Average]
    nees: dict[str, Average]
    rms: np.ndarray
    diverged: int
    seconds: float


def state_errors(cascade: Cascade, truth: pd.DataFrame, where: str) -> Errors:
    """Errors of the filtered states against the truth at the same epochs. Raises InputError when the epochs differ.

    An error e of the heading turns the velocity: surge and sway err by (v, -u) e besides, as `states.table` has it (E18).
    """
    m, moving, turning = cascade.measurements, cascade.moving, cascade.turning
    _fit(truth, m.time, where)
    north, east, u, v = moving.mean[:, :4].T
    psi, r = turning.mean[:, :2].T
    true = {name: truth[name].to_numpy(float) for name in truth.columns}
    error = np.column_stack(
        [
            north + m.origin[0] - true["north_m"],
            east + m.origin[1] - true["east_m"],
            u - true["surge_m_s"],
            v - true["sway_m_s"],
            difference(psi, true["heading_rad"]),
            r - true["yaw_rate_rad_s"],
        ]
    )
    turned = np.column_stack([np.zeros((len(u), 2)), v, -u])
    motion = moving.covariance[:, :4, :4] + turning.covariance[:, :1, :1] * turned[:, :, None] * turned[:, None, :]
    covariances = {"motion": motion, "turning": turning.covariance[:, :2, :2]}
    variance = np.concatenate([np.diagonal(P, axis1=1, axis2=2) for P in covariances.values()], axis=1)
    squares = {name: nees(error[:, FILTERS[name]], P) for name, P in covariances.items()}
    return Errors(m.time, error, np.sqrt(variance), squares)


def _fit(truth: pd.DataFrame, time: np.ndarray, where: str) -> None:
    own = truth["time_s"].to_numpy(float)
    if len(own) != len(time) or not np.allclose(own, time, rtol=0, atol=checks.SAME_EPOCH):
        raise InputError(f"{where}: the truth beside it has other epochs than the log; simulate both again")


def redrawer(log: Log, truth: pd.DataFrame) -> Callable[[np.random.Generator], Log]:
    """A function that draws the log anew: the same voyage and epochs, other sensor noise, of the vessel's own `noise`.

    The sensors drawn have neither offset nor delay, so the new log's vessel has no `calibration`. What the log lacks stays
    missing. Derivatives of the truth are those of its cubic splines. Raises InputError when the log has no zone or the truth
    other epochs.
    """
    where, table, noise = log.path or log.voyage, log.table, log.vessel.noise
    if log.zone is None:
        raise InputError(f"{where}: the log has no UTM zone, which --runs needs to draw it anew; leave --runs out")
    vessel = replace(log.vessel, calibration=Calibration())
    zone, time = log.zone, table["time_s"].to_numpy(float)
    _fit(truth, time, where)
    true = {name: truth[name].to_numpy(float) for name in truth.columns}
    surge_rate, sway_rate, yaw_acceleration = (
        CubicSpline(time, true[name])(time, 1) for name in ("surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    )
    voyage = Voyage.level(
        time=time,
        north=true["north_m"],
        east=true["east_m"],
        heading=np.unwrap(true["heading_rad"]),
        surge=true["surge_m_s"],
        sway=true["sway_m_s"],
        yaw_rate=true["yaw_rate_rad_s"],
        surge_rate=surge_rate,
        sway_rate=sway_rate,
        yaw_acceleration=yaw_acceleration,
        rudder=true["rudder_angle_rad"],
        shaft=true["shaft_speed_rps"],
    )
    every = round(1 / float(time[1] - time[0]), 6)  # Hz: sampled at every row, then masked as the log is
    instruments = Sensors(
        antennas=tuple(schema.antennas(table.columns)),
        position_hz=every, position_m=noise.position,
        heading_hz=every, heading_deg=float(np.degrees(noise.heading)),
        yaw_rate_hz=every, yaw_rate_deg_s=float(np.degrees(noise.yaw_rate)),
        acceleration_hz=every, acceleration_m_s2=noise.acceleration,
        rudder_hz=0.0, shaft_hz=0.0,
    )  # fmt: skip

    def redraw(rng: np.random.Generator) -> Log:
        drawn = measure(voyage, vessel, zone, instruments, rng).drop(columns="time_s")
        drawn = drawn[[name for name in drawn if name in table]].where(table.notna())
        return Log(table.assign(**{name: drawn[name] for name in drawn}), vessel, zone, voyage=log.voyage)

    return redraw


def monte_carlo(
    log: Log,
    truth: pd.DataFrame,
    runs: int,
    seed: int,
    since: float,
    watch: Watch | None = None,
) -> MonteCarlo:
    """Filter `runs` redrawn logs; run j draws from SeedSequence(seed, spawn_key=(j,)) alone. Memory does not grow with runs."""
    begin, redraw = clock.perf_counter(), redrawer(log, truth)
    sums: dict[tuple[str, str], np.ndarray] = {}
    rows: dict[str, np.ndarray] = {}
    diverged, square = 0, np.zeros(len(STATES))

    def add(kind: str, name: str, value: np.ndarray) -> None:
        sums[kind, name] = sums.get((kind, name), 0.0) + value

    for run in watch(range(runs), "Monte Carlo", runs) if watch else range(runs):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(run,)))
        cascade = run_cascade(redraw(rng))
        errors = state_errors(cascade, truth, log.path or log.voyage).since(since)
        own = {s.name: s.since(since) for s in sensors(cascade)}
        joint = {name: [own[s] for s in members if s in own] for name, members in _members(cascade).items()}
        for name, parts in ({name: [s] for name, s in own.items()} | joint).items():
            if not parts:
                continue
            if name not in rows:
                rows[name] = np.flatnonzero(np.any([s.measured for s in parts], axis=0))
            at = rows[name]
            add("nis", name, np.sum([np.where(s.measured[at], s.nis[at], 0.0) for s in parts], axis=0))
            add("dof", name, np.sum([s.dof[at] for s in parts], axis=0))
            add("lag", name, lag_products(np.concatenate([s.whitened[at] for s in parts], axis=1)))
        for name, value in errors.nees.items():
            add("nees", name, value)
        square += np.mean(errors.error**2, axis=0)
        bad = ~(np.abs(errors.error) <= FAR * errors.deviation).all()
        worst = min(float(rcond[cascade.measurements.time >= since].min()) for rcond in conditions(cascade).values())
        diverged += bool(bad or worst < CONDITION)
    time = errors.time
    averages, lags, nees_ = {}, {}, {}
    for name, at in rows.items():
        # Bounds by the degrees of freedom that all runs together had at an epoch.
        low, high = (bound / runs for bound in average_bounds(sums["dof", name]))
        averages[name] = _average(time[at], sums["nis", name] / runs, low, high)
        rho, bound = lag_correlation(sums["lag", name], runs), lag_bound(runs)
        lags[name] = _average(time[at][1:], rho, np.full(len(rho), -bound), np.full(len(rho), bound))
    for name, place in FILTERS.items():
        low, high = average_bounds(np.full(len(time), place.stop - place.start), runs)
        nees_[name] = _average(time, sums["nees", name] / runs, low, high)
    return MonteCarlo(runs, seed, averages, lags, nees_, np.sqrt(square / runs), diverged, clock.perf_counter() - begin)


def _members(cascade: Cascade) -> dict[str, tuple[str, ...]]:
    """The sensors of each filter, by the name of their joint statistics."""
    return {
        "turning, joint": ("heading", "yaw_rate"),
        "motion, joint": (*cascade.measurements.fixes, "acceleration"),
    }


def _average(time, value, low, high) -> Average:
    return Average(time, value, low, high, shares(value, low, high))
