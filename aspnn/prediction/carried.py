"""A learned prediction with what the filter's errors make of it: perturbed starts are further rows of the same batch.

No torch is imported here: the network is whatever `learned` accepts.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from aspnn.learning.features import WIND, broken
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.prediction import learned
from aspnn.prediction.choice import HybridChoice
from aspnn.prediction.current import Current, can_estimate, estimate_current
from aspnn.prediction.learned import Material
from aspnn.prediction.monitor import AGES, ended, errors, marks, misfit
from aspnn.prediction.plan import Orderable, make_plan
from aspnn.prediction.uncertainty import Calibration, beyond, carried, perturbed, shape, shifts, spread_of
from aspnn.records import States

# How much of the variance of a current remains: what the network's model errs by over the last minutes the estimate takes for
# current, and it cancels over the next ones. Fitted to 30 voyages in currents of up to 1 m/s: with all of it 95 % regions
# held .98 there, with 0.3 of it .92 to .95, with none .79 to .86.
UNSHARED = 0.4


class Contract(learned.Contract, Protocol):
    """What a checkpoint says of its network: the contract of `learned`, and the range of its inputs in training."""

    @property
    def domain(self) -> dict[str, list[float]]: ...


def predict_carried(
    contract: Contract,
    network: learned.Network,
    states: States,
    rows: np.ndarray,
    plans: Sequence[Plan],
    region_map: bool,
    current: np.ndarray | None = None,
) -> tuple[Path, np.ndarray, np.ndarray]:
    """Paths (n, steps) as `learned.predict_rows` gives them, their covariance by the filter's errors, and `outside` (n,).

    The covariance (n, steps, 3, 3) is of north, east [m] and heading [rad]. An error is taken as lasting over the whole
    history, so that the network cannot average it out. `outside` tells whether an input, a forcing or the wind that
    the network feels is beyond training, or the history is broken (see `features.broken`).
    """
    learned.check_vessel(states, contract)
    rows, spec = np.asarray(rows, int), contract.spec
    given = learned.material(contract, states, rows, plans)
    if current is not None:
        given = learned.through_water(given, spec, current)
    unusable, time = broken(states, spec.read, spec.period), states["time_s"]
    outside = unusable[rows + 1] > unusable[time.searchsorted(time[rows] - spec.history - 1e-6)]
    for names, values in ((spec.inputs, given.history), (spec.forcings, given.forcing)):
        for k, name in enumerate(names):
            outside |= beyond(values[..., k], *contract.domain[name])
    if WIND in contract.domain:  # of a network that feels the wind; where that is not known it was taken as none
        unheard = ~np.isfinite(states["wind_speed_true_m_s"][rows])
        outside |= unheard | beyond(np.hypot(*given.wind.T), *contract.domain[WIND])
    errors = perturbed(states, rows)
    poses, bodies = (np.concatenate(part) for part in zip(*errors, strict=True))
    n, many = len(rows), 1 + len(errors)
    given = Material(*(np.concatenate([part] * many) for part in given))
    given.history[n:] += shifts(spec.inputs, states, np.tile(rows, len(errors)), poses, bodies)[:, None]
    given.pose[n:] += poses
    paths = learned.draw(contract, given.pose, network(given.history, given.forcing, given.wind), region_map)
    if current is not None:
        paths = learned.adrift(paths, np.tile(current, (many, 1)))
    path = replace(paths[:n], convergence=states["convergence_rad"][rows])
    return path, carried(path, paths[n:], states, rows), outside


def recent(
    contract: Contract, calibration: Calibration | None, states: States, choice: HybridChoice | None = None
) -> States:
    """The end of `states` that a prediction from the last of them reads. A long voyage is not read again for each.

    That is the history, what the mean wind needs, for regions and choice the time since the last order; with regions all that for
    the predictions that judge the model (see `monitor`) and the current need too.
    """
    time, spec = states["time_s"], contract.spec
    span = max(
        spec.history, spec.wind_memory, *(0.0 if known is None else known.settled for known in (calibration, choice))
    )
    if calibration is not None:
        span += max(max(AGES) * spec.horizon, spec.current_memory or 0.0)
    first = np.searchsorted(time, time[-1] - span) - 1
    return states.read(max(int(first), 0))


def predict_one(
    contract: Contract,
    network: learned.Network,
    calibration: Calibration | None,
    states: States,
    rudder: Orderable,
    shaft: Orderable,
    region_map: bool,
    choice: HybridChoice | None = None,
) -> Path:
    """Path from the last of `states`, if the plan is followed, with regions where there is a calibration."""
    end = recent(contract, calibration, states, choice)
    plan = make_plan(end, rudder, shaft, contract.spec.horizon)
    return predict_rows(contract, network, calibration, end, np.array([len(end) - 1]), [plan], region_map, choice)[0]


def predict_rows(
    contract: Contract,
    network: learned.Network,
    calibration: Calibration | None,
    states: States,
    rows: np.ndarray,
    plans: Sequence[Plan],
    region_map: bool,
    choice: HybridChoice | None = None,
) -> Path:
    """Paths (n, steps) from each of `rows` under each of `plans`, with regions where there is a calibration.

    That also tells how well the ship keeps to the network in still water: then a current is sought (see `current`). With a
    `choice` the paths are mixed with kinematic ones, and the regions, calibrated for the mix, lie about that. Predictions that
    have come to their end are further rows of the same batch: they tell whether the regions must be wider (see `monitor`).
    """
    states = states.read()
    if calibration is None:
        path = learned.predict_rows(contract, network, states, rows, plans, region_map)
        return path if choice is None else choice.mix(path, contract.vessel, states, rows, plans)
    starts, of = np.unique(np.asarray(rows, int), return_inverse=True)  # the plans of a fan have one past
    past, n = ended(states, starts, contract.spec), len(of)
    of = np.concatenate([of, past.start])
    rows, plans = np.concatenate([starts[of[:n]], past.rows]), [*plans, *past.plans]
    found, flow = None, None
    if can_estimate(contract.spec):
        found = Current(*(part[of] for part in estimate_current(contract, network, states, starts, calibration.drift)))
        flow = found.velocity if found.sure.any() else None
    path, covariance, outside = predict_carried(contract, network, states, rows, plans, region_map, flow)
    if found is not None and flow is not None:
        # A current known to P would add P t^2, were the velocities through the water not wrong by as much the other way.
        known = np.where(found.sure[:, None, None], UNSHARED * found.covariance, 0.0)
        covariance[..., :2, :2] += known[:, None] * path.time[:, None, None] ** 2
    if choice is not None:
        path = choice.mix(path, contract.vessel, states, rows, plans)
    covariance = shape(calibration, path, covariance, plans, states["rudder_angle_rad"][rows])
    off = errors(past, path[n:], states)
    square = misfit(past.start, *off, covariance[n:, marks(path.time)], len(starts))[of[:n]]
    flow = None if flow is None else flow[:n]
    path, rows, plans = path[:n], rows[:n], plans[:n]
    spread = spread_of(calibration, path, covariance[:n], states, rows, plans, outside[:n], flow, square)
    return replace(path, spread=spread)
