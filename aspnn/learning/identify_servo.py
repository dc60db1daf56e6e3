"""Servos from logs: what stands between an order and the rudder or shaft that obeys it, on this ship, not in its papers.

Where the log has orders and what came of them, a servo is fitted to both. Where it has rudder orders alone, the motion of
the ship tells how fast its rudder moves. Where neither tells, the vessel file does.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from scipy.optimize import least_squares

from aspnn.learning.identified import hull_terms
from aspnn.learning.servo import Identified, Servo, Servos
from aspnn.orders import Orders
from aspnn.records import Log, States
from aspnn.vessel import Vessel

ENOUGH = 5  # order changes, below which a servo is not identified
SURE = 3.0  # standard errors that lag, delay and dead band must differ from none, and the rate from all rates
RATES = (0.3, 0.6, 1.0, 1.7, 3.0, 10.0)  # of the rate that is guessed: where a fit begins
SETTLED = 20.0  # s after an order, and twice what the guessed rate needs, in which a servo shows itself
ENDS = {"xtol": 1e-6, "ftol": 1e-6, "gtol": 1e-6}  # of a search: a millionth is well within any standard error
SAMPLES = 5000  # that a fit reads
LONGEST = 60.0  # s: no lag or delay is sought beyond it
PIECE = 300.0  # s of a voyage, left out in turn to see how far a rate found from motion moves
WIDE = np.geomspace(0.2, 5.0, 9)  # rates tried by motion, of the guess: each half a step from what FINE reaches
FINE = np.geomspace(0.8, 1.25, 9)  # of the best of them
RIDGE = 1e-8  # against terms of unit size


class Record(NamedTuple):
    """What one voyage tells of a servo: its orders, and `value` (n,) at `time` (n,) [s], NaN where it was not measured."""

    orders: Orders
    time: np.ndarray
    value: np.ndarray


def identify_servos(voyages: Sequence[tuple[Log, States]], vessel: Vessel) -> Servos:
    """The servos of a ship, from logs and smoothed states of training voyages."""
    logs = [log for log, _ in voyages]
    rudders = records(logs, "rudder_order_deg", "rudder_angle_deg", math.radians(1))
    rudder = Identified(Servo(vessel.rudder_rate), None, _changes(rudders))
    if any(np.isfinite(record.value).any() for record in rudders):
        rudder = fit_servo(rudders, rudder.servo) or rudder
    else:
        rudder = replace(fit_rate([states for _, states in voyages], vessel.rudder_rate) or rudder, measured=False)
    shafts = records(logs, "engine_order_rps", "shaft_speed_rps", 1.0)
    steps = [float(np.abs(np.diff(record.orders.values)).max(initial=0.0)) for record in shafts]
    shaft = fit_servo(shafts, Servo(max(steps) / 30.0)) if any(steps) else None
    return Servos(rudder, shaft)


def records(logs: Sequence[Log], order: str, value: str, unit: float) -> list[Record]:
    """The records of two columns of some logs, times `unit`; logs without orders have none.

    Values that are the orders again were not measured.
    """
    found = []
    for log in logs:
        if order in log.table and log.table[order].notna().any():
            time = log.table["time_s"].to_numpy(float)
            values = log.table[value].to_numpy(float) if value in log.table else np.full(len(time), np.nan)
            orders = Orders.from_series(time, unit * log.table[order].to_numpy(float))
            known = np.isfinite(values)
            if np.array_equal(values[known], log.table[order].to_numpy(float)[known]):
                values = np.full(len(time), np.nan)
            found.append(Record(orders, time, unit * values))
    return found


def _changes(voyages: Sequence[Record]) -> int:
    return sum(len(record.orders.times) - 1 for record in voyages)


def fit_servo(voyages: Sequence[Record], guess: Servo) -> Identified | None:
    """The servo whose answer to the orders comes closest to what was measured; None where the voyages cannot tell.

    Least squares with outliers damped (pseudo-Huber), over the time after each order. Lag, delay and dead band are kept as
    far as they are SURE; a rate that is not, since small orders never ask for the full one, is what they ask for, and that of
    `guess` at least. Standard errors are those of a sandwich estimate clustered by order: what errors within one order have
    in common does not average out; instants are known to no better than a sample.
    """
    parts = [part for record in voyages if (part := _told(record, guess.rate)) is not None]
    changes = sum(part.changes for part in parts)
    if changes < ENOUGH:
        return None
    every = max(1, sum(len(part.row) for part in parts) // SAMPLES)
    parts = [replace(part, row=part.row[::every], order=part.order[::every]) for part in parts]
    cluster = np.concatenate([part.order + 1_000_000 * k for k, part in enumerate(parts)])

    def residual(values: np.ndarray) -> np.ndarray:
        return np.concatenate([part.residual(Servo(*values)) for part in parts])

    begins = [np.array([guess.rate * k, lag, delay, 0.0]) for k in RATES for lag in (0.0, 2.0) for delay in (0.0, 1.0)]
    best = min(begins, key=lambda values: float(np.abs(residual(values)).sum()))
    tick = float(np.median(np.concatenate([np.diff(part.time) for part in parts])))
    free = [0, 1, 2, 3]
    while True:
        best, error = _fitted(residual, best, free, cluster, guess.rate)
        error = np.where(
            np.isin(range(4), free), np.hypot(error, np.array([0.0, 1.0, 1.0, best[0]]) * tick / math.sqrt(12)), 0.0
        )
        worst = min(free, key=lambda k: best[k] / max(error[k], 1e-12))
        if best[worst] >= SURE * error[worst]:
            break
        if worst == 0 and best[0] <= guess.rate:
            return None  # slow, and not surely so: what was measured does not follow the orders
        quickest = max(part.largest for part in parts) / max(best[1], tick)
        best[worst] = max(guess.rate, quickest) if worst == 0 else 0.0
        free.remove(worst)
    moved = np.concatenate([part.value[part.row] - part.value[0] for part in parts])
    if np.abs(residual(best)).sum() > 0.5 * np.abs(moved).sum():
        return None  # as good as resting: the orders do not move it
    return Identified(Servo(*best.tolist()), Servo(*error.tolist()), changes)


@dataclass(frozen=True)
class _Told:
    """A voyage from its first measurement on, at the rows where a servo shows itself, with the order that each belongs to."""

    orders: Orders
    time: np.ndarray
    value: np.ndarray
    row: np.ndarray
    order: np.ndarray
    changes: int
    largest: float  # change of the orders

    def residual(self, servo: Servo) -> np.ndarray:
        time = np.concatenate([self.time[:1], self.time[self.row]])
        return servo.follow(self.orders, time, float(self.value[0]))[1:] - self.value[self.row]


def _told(record: Record, rate: float) -> _Told | None:
    known = np.isfinite(record.value)
    if not known.any():
        return None
    time, value = record.time[known], record.value[known]
    instants, sizes = record.orders.times[1:], np.abs(np.diff(record.orders.values))
    inside = (instants > time[0]) & (instants < time[-1])
    if not inside.any():
        return None
    instants, sizes = instants[inside], sizes[inside]
    order = np.searchsorted(instants, time, side="right") - 1
    since = time - instants[np.clip(order, 0, None)]
    near = (order >= 0) & (since <= SETTLED + 2 * sizes[np.clip(order, 0, None)] / rate)
    row = np.flatnonzero(near)
    return (
        _Told(record.orders, time, value, row, order[row], len(np.unique(order[row])), max(sizes)) if len(row) else None
    )


def _fitted(
    residual: Callable[[np.ndarray], np.ndarray], start: np.ndarray, free: list[int], cluster: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """The values (4,) of a servo by robust least squares over the `free` ones, and their standard errors (0: not free)."""
    units = np.array([rate, 1.0, 1.0, rate])[free]

    def of(some: np.ndarray) -> np.ndarray:
        values = start.copy()
        values[free] = some * units
        return residual(values)

    most = np.array([1e3, LONGEST, LONGEST, 5.0])[free]
    some = np.clip(start[free] / units, 1e-3, most)
    for _ in range(2):  # the spread of the errors is that of the first fit
        size = np.sort(np.abs(of(some)))[: math.ceil(0.95 * len(cluster))]
        spread = float(np.sqrt(np.mean(size**2)))
        if spread == 0:
            break
        some = least_squares(of, some, bounds=(0.0, most), loss="soft_l1", f_scale=2 * spread, diff_step=1e-4, **ENDS).x
    at = of(some)
    steps = 1e-4 * np.maximum(some, 0.1)
    slopes = np.stack(
        [(of(some + step * one) - at) / step for step, one in zip(steps, np.eye(len(some)), strict=True)], 1
    )
    weight = 1 / np.sqrt(1 + (at / (2 * spread)) ** 2) if spread > 0 else np.ones(len(at))
    _, group = np.unique(cluster, return_inverse=True)
    scores = np.stack([np.bincount(group, weight * at * slope) for slope in slopes.T], axis=1)
    normal = (slopes * weight[:, None]).T @ slopes
    known = np.flatnonzero(np.diag(normal) > 0)  # what moves no sample is not known at all
    values, error = start.copy(), np.zeros(4)
    values[free] = some * units
    inverse = np.linalg.pinv(normal[np.ix_(known, known)])
    spreads = np.full(len(free), math.inf)
    spreads[known] = np.sqrt(np.diag(inverse @ (scores.T @ scores)[np.ix_(known, known)] @ inverse))
    error[free] = spreads * units
    return values, error


def fit_rate(voyages: Sequence[States], rate: float) -> Identified | None:
    """The rudder's rate [rad/s] with which polynomials of motion and rudder angle explain the yaw acceleration best.

    `voyages` are smoothed states; the polynomials are those of the identified ship. It is sought about `rate`, the vessel
    file's; None where it cannot be told. The standard error is that of a jackknife, over pieces of voyages or over voyages,
    whichever is larger, each replicate of which has all rates to choose from: few pieces often decide, and what is left then
    says another rate altogether. With it counts what a delay of one sample would do (see `unsure`).
    """
    every = [Orders.from_series(s["time_s"], s["rudder_order_rad"]).values for s in voyages]
    steps = np.concatenate([np.diff(values) for values in every]) if every else np.array([])
    if len(steps) < ENOUGH:
        return None
    speed = math.sqrt(np.mean(np.concatenate([s["surge_m_s"] for s in voyages]) ** 2))
    tick = float(np.median(np.concatenate([np.diff(s["time_s"]) for s in voyages])))
    middle, errors = rate, []
    for rates in (WIDE, FINE):
        tried: dict[str, list[np.ndarray]] = {}  # parts of one recording are one voyage
        for states in voyages:
            tried.setdefault(states.voyage, []).extend(_sums(states, speed, middle * rates))
        parts = [pieces for pieces in tried.values() if pieces]
        if sum(len(pieces) for pieces in parts) < ENOUGH:
            return None
        found = [sought([piece for pieces in parts for piece in pieces], rates)]
        if len(parts) > 1:
            found.append(sought([np.sum(pieces, axis=0) for pieces in parts], rates))
        known = [one for one in found if one is not None]
        if len(known) < len(found):
            return None
        middle *= known[0][0]
        errors += [error for _, error in known]
    error = math.hypot(max(errors), unsure(middle, tick, steps))
    return Identified(Servo(middle), Servo(middle * error), len(steps), measured=False) if error < 1 / SURE else None


def unsure(rate: float, tick: float, steps: np.ndarray) -> float:
    """The relative error of a rate [rad/s] if orders and motion are a sample of `tick` [s] apart, which nothing here tells.

    A rudder of this rate lags behind a change s of the order by s2 / (2 rate) rad s, one that is late by d by s d: least
    squares over `steps` s [rad] take the one for the other with a relative error 2 d rate sum |s|3 / sum s4 of the rate. A
    rudder as quick as this tells no rate, however well many orders agree on one: all of them are late alike.
    """
    size = np.abs(steps)
    return float(2 * tick * rate * np.sum(size**3) / np.sum(size**4))


def sought(pieces: Sequence[np.ndarray], rates: np.ndarray) -> tuple[float, float] | None:
    """The rate that explains the pieces best and its relative standard error; None where it is not sure.

    It is not sure either where without one piece the best lies at an end of `rates`: then the motion tells no more than
    that the rudder is quick (or slow).
    """
    whole = np.sum(pieces, axis=0)
    found, *others = (_lowest([_unexplained(s) for s in sums], rates) for sums in (whole, *(whole - p for p in pieces)))
    error = math.sqrt((len(others) - 1) * float(np.var(others)))
    return (math.exp(found), error) if error < 1 / SURE else None  # NaN where one lies at an end


def _sums(states: States, speed: float, rates: np.ndarray) -> list[np.ndarray]:
    """Sums of products (rates, terms + 1, terms + 1) of the terms and the yaw acceleration, over each piece of a voyage."""
    time, order = states["time_s"], states["rudder_order_rad"]
    row = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], 1.0)))
    row = row[(states["coasting"][row] == 0) & np.isfinite(order[row])]
    if len(row) < PIECE / 2:
        return []
    arm = states.vessel.length / 2 / speed
    motion = np.stack(
        [states["surge_m_s"] / speed, states["sway_m_s"] / speed, states["yaw_rate_rad_s"] * arm], axis=-1
    )
    hull, yaw = hull_terms(torch.from_numpy(motion[row])).numpy(), arm * states["yaw_acceleration_rad_s2"][row]
    orders, begin = Orders.from_series(time, order), float(states["rudder_angle_rad"][0])
    angles = np.stack([orders.servo(time, begin, rate)[row] for rate in rates])
    powers = np.stack([np.ones_like(angles), angles, angles**2, angles**3], axis=-1)  # (rates, n, 4)
    cuts = np.array_split(np.arange(len(row)), max(1, round(len(row) / PIECE)))
    found = []
    for cut in cuts:
        terms = (hull[cut, :, None] * powers[:, cut, None, :]).reshape(len(rates), len(cut), -1)
        both = np.concatenate([terms, np.broadcast_to(yaw[cut, None], (len(rates), len(cut), 1))], axis=-1)
        found.append(np.swapaxes(both, -1, -2) @ both)
    return found


def _unexplained(sums: np.ndarray) -> float:
    """The logarithm of what the terms leave of the yaw acceleration, by ridge regression; its products stand last."""
    size = np.sqrt(np.diag(sums))
    scaled = sums / np.where(size > 0, size, 1.0) / np.where(size > 0, size, 1.0)[:, None]
    gram, moment = scaled[:-1, :-1] + RIDGE * np.eye(len(sums) - 1), scaled[:-1, -1]
    return math.log(1 - moment @ np.linalg.solve(gram, moment))


def _lowest(values: Sequence[float], rates: np.ndarray) -> float:
    """The logarithm of the rate where values are lowest, by a parabola through three of them; NaN at an end."""
    k = int(np.argmin(values))
    if k in (0, len(rates) - 1):
        return math.nan
    before, here, after = values[k - 1 : k + 2]
    return math.log(rates[k]) + math.log(rates[1] / rates[0]) * (before - after) / (2 * (before - 2 * here + after))
