"""How each sensor of a filtered log fares: its innovations as series, and a summary by the statistics of `consistency`."""

import math
from dataclasses import dataclass, replace

import numpy as np

from aspnn.estimation import compiled
from aspnn.estimation.cascade import Cascade
from aspnn.estimation.consistency import (
    Shares,
    average_bounds,
    innovation_covariance,
    lag_bound,
    lag_products,
    mean_error,
    scaled_rcond,
    shares,
)
from aspnn.estimation.lag import lag
from aspnn.estimation.problem import MISSING, REJECTED
from aspnn.frames import to_body

ENOUGH = 5000  # yaw rates that a lag is found from
UNITS = {"heading": ("deg", math.degrees(1)), "yaw_rate": ("deg/s", math.degrees(1)), "acceleration": ("m/s2", 1.0)}


@dataclass(frozen=True)
class Series:
    """One sensor (measurement block) of a filtered log over its n epochs.

    `dof` (n) rows measured, `nis` (n), `whitened` (n, 2) NaN where not used, `offset` (n, 2) the innovation used in SI and
    radians, that of a fix turned to forward and starboard; `measured`, `rejected` and `stale` (n) flags.
    """

    name: str
    unit: str
    scale: float  # from SI and radians to `unit`
    time: np.ndarray
    dof: np.ndarray
    nis: np.ndarray
    whitened: np.ndarray
    offset: np.ndarray
    measured: np.ndarray
    rejected: np.ndarray
    stale: np.ndarray

    def since(self, time: float) -> "Series":
        """The part from `time` [s] on."""
        rows = self.time >= time
        arrays = (getattr(self, name)[rows] for name in _ARRAYS)
        return Series(self.name, self.unit, self.scale, *arrays)


_ARRAYS = ("time", "dof", "nis", "whitened", "offset", "measured", "rejected", "stale")


@dataclass(frozen=True)
class Summary:
    """How one sensor of one run fares. Shares are 0 to 1; `mean` is the mean innovation per component in `unit`.

    `shares` holds NIS against the single-run bounds, rejected values included; `mean_nis` is per degree of freedom and of used
    values, of a consistent filter within `mean_low` and `mean_high`. `autocorrelation` at lag one, of a white sequence within
    +-`bound`. `bias` is the mean over its standard error, `shift` the mean over the innovation's deviation, both of the worst
    component; `lateness` the correlation with the predicted yaw acceleration, within +-`bound` where there is no delay. `late`
    is the lag [s] of a yaw rate against the turn of the heading, with its standard error; (nan, inf) where nothing can be told.
    `coasting` [s] is the longest time without a used value; `rcond` the worst scaled condition of the joint S of its filter.
    """

    sensor: str
    unit: str
    n: int
    dof: int
    mean_nis: float
    mean_low: float
    mean_high: float
    shares: Shares
    autocorrelation: float
    bound: float
    mean: tuple[float, ...]
    shift: float
    bias: float
    lateness: float
    late: tuple[float, float]
    rejected: float
    stale: float
    coasting: float
    rcond: float


def sensors(cascade: Cascade) -> tuple[Series, ...]:
    """The sensors that a filtered log has, those of CAA (heading, yaw rate) and then those of CTRA (fixes, accelerations)."""
    m, found = cascade.measurements, []
    blocks = [("heading", cascade.turning, 0), ("yaw_rate", cascade.turning, 1)]
    blocks += [(name, cascade.moving, b) for b, name in enumerate((*m.fixes, "acceleration"))]
    for name, run, b in blocks:
        measured = run.fate[:, b] != MISSING
        if not measured.any():
            continue
        rejected = run.fate[:, b] == REJECTED
        whitened, offset = (np.where(rejected[:, None], np.nan, a[:, b]) for a in (run.whitened, run.innovation))
        stale = np.zeros(len(m.time), bool)
        if name in m.fixes:
            offset = np.column_stack(to_body(offset[:, 0], offset[:, 1], cascade.turning.predicted[:, 0]))
            stale = m.stale & ~measured
        unit, scale = UNITS.get(name, ("m", 1.0))
        dof = np.isfinite(run.innovation[:, b]).sum(1)
        found.append(Series(name, unit, scale, m.time, dof, run.nis[:, b], whitened, offset, measured, rejected, stale))
    return tuple(found)


def conditions(cascade: Cascade) -> dict[str, np.ndarray]:
    """Scaled reciprocal condition (n) of the joint S by sensor; the sensors of one filter share theirs (E31)."""
    turning = scaled_rcond(innovation_covariance(cascade.turn, cascade.turning))
    moving = scaled_rcond(innovation_covariance(cascade.motion, cascade.moving))
    names = (*cascade.measurements.fixes, "acceleration")
    return {"heading": turning, "yaw_rate": turning} | dict.fromkeys(names, moving)


def summarise(cascade: Cascade, since: float = -np.inf) -> tuple[Summary, ...]:
    """The summary of every sensor of a filtered log, from `since` [s] on (the filter settles before)."""
    turn, rcond = cascade.turning.predicted[:, 2], conditions(cascade)
    rows = cascade.measurements.time >= since
    found = [s for s in sensors(cascade) if s.measured[rows].any()]
    late = {"yaw_rate": _yaw_rate_lag(cascade, rows)} if any(s.name == "yaw_rate" for s in found) else {}
    return tuple(
        _summary(s.since(since), turn[rows], rcond[s.name][rows], late.get(s.name, (np.nan, np.inf))) for s in found
    )


def _yaw_rate_lag(cascade: Cascade, rows: np.ndarray) -> tuple[float, float]:
    """How late the measured yaw rate is [s] against that of the headings alone, smoothed, and the standard error."""
    z = cascade.turn.z.copy()
    z[:, 1] = np.nan
    problem = replace(cascade.turn, z=z)
    heading = compiled.smooth(problem, compiled.run(problem))[0]
    told = np.flatnonzero(rows & np.isfinite(cascade.turn.z[:, 1, 0]))
    told = told[:: max(1, len(told) // ENOUGH)]
    time = cascade.turn.time
    return lag(time[told], cascade.turn.z[told, 1, 0], time[rows], heading[rows, 1])


def _summary(s: Series, turn: np.ndarray, rcond: np.ndarray, late: tuple[float, float]) -> Summary:
    # Successive values of a sensor, whatever its rate, follow each other.
    y, offset, turn, used = s.whitened[s.measured], s.offset[s.measured], turn[s.measured], ~s.rejected[s.measured]
    dof = s.dof[s.measured][used]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_nis = s.nis[s.measured][used].sum() / dof.sum()
    low, high = (float(bound) / max(dof.sum(), 1) for bound in average_bounds(dof.sum()))
    columns = np.isfinite(y).any(0)  # a heading has one component
    products = lag_products(y[:, columns]).sum(-1)
    pairs = int(products[3])
    mean, error = mean_error(offset[:, columns])
    spread = np.sqrt(np.nanmean(np.square(offset[:, columns]), axis=0)) if used.any() else mean
    times = np.concatenate([s.time[:1], s.time[s.measured][used], s.time[-1:]])
    worst = int(np.argmax(np.abs(mean / error))) if used.any() else 0
    known = (s.measured | s.stale).sum()
    return Summary(
        sensor=s.name,
        unit=s.unit,
        n=int(s.measured.sum()),
        dof=int(s.dof.max()),
        mean_nis=float(mean_nis),
        mean_low=low,
        mean_high=high,
        shares=shares(s.nis, *average_bounds(s.dof)),
        autocorrelation=float(products[0] / np.sqrt(products[1] * products[2])) if pairs else np.nan,
        bound=float(lag_bound(pairs)),
        mean=tuple(float(v) for v in mean * s.scale),
        shift=float(mean[worst] / spread[worst]),
        bias=float(mean[worst] / error[worst]),
        lateness=_lateness(offset[:, columns], turn),
        late=late,
        rejected=float(s.rejected.sum() / s.measured.sum()),
        stale=float(s.stale.sum() / known),
        coasting=float(np.diff(times).max()),
        rcond=float(rcond[s.measured].min()),
    )


def _lateness(offset: np.ndarray, turn: np.ndarray) -> float:
    """The strongest correlation of a component of an innovation (n, c) with the predicted yaw acceleration (n).

    Innovations of a true filter are independent of everything predicted, so it is white noise's. Where heading and yaw rate
    differ by a delay, the filter believes the sharper of the two, and the innovations of the other follow the turn's changes.
    """
    known = np.isfinite(offset) & np.isfinite(turn)[:, None]
    a, b = np.where(known, offset, 0.0), np.where(known, turn[:, None], 0.0)
    a, b = (np.where(known, v - v.sum(0) / np.maximum(known.sum(0), 1), 0.0) for v in (a, b))
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (a * b).sum(0) / np.sqrt((a**2).sum(0) * (b**2).sum(0))
    return float(found[np.argmax(np.nan_to_num(np.abs(found), nan=-1.0))])
