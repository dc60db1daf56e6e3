"""The current, from how a ship has drifted off what its own model says of the last minutes, used where it is sure.

A network that learned in still water knows motion through the water. Seen from the water, a steady uniform current c leaves it
right: velocities through the water are those over ground less c, and the ground path is the water path plus c t. So c is what
makes the network's own paths of the recent past end where the ship did. Depends on learned, learning and records.
"""

from typing import NamedTuple

import numpy as np

from aspnn.learning.features import broken
from aspnn.learning.windows import WindowSpec, plans_sailed
from aspnn.prediction.learned import MOVING, Contract, Material, Network, draw, material, through_water
from aspnn.records import States

PARTS = 3  # of the horizon: the recent past is gone through again in such parts, each from the states at its begin
# Twice the gain of log-likelihood that a current must bring: chance alone has 30 once in three million starts.
SURE = 30.0
# Inputs that are alike in any water, and those of the wind, which `through_water` takes relative to it.
STILL = ("yaw_rate", "rudder_order", "rudder_angle", "shaft_speed", "wind_forward", "wind_starboard")
STEPS = 3  # of Gauss and Newton; the third moves 0.04 mm/s in the median, 1 cm/s at most, in currents up to 1 m/s
STEP = 0.05  # m/s, of the differences that make their derivatives
# m/s, standard deviation of a current's components before anything is known; a ship may tell nothing of one.
USUAL = 2.0


class Current(NamedTuple):
    """Estimated currents of n starts: velocity (n, 2) [m/s] towards grid north and east, 0 where not `sure` (n,), and the covariance
    (n, 2, 2) of the estimate."""

    velocity: np.ndarray
    covariance: np.ndarray
    sure: np.ndarray


def part(spec: WindowSpec) -> float:
    """How long a part is [s]: a third of the horizon, in whole periods."""
    return round(spec.horizon / PARTS / spec.period) * spec.period


def _epoch(time: np.ndarray, instants: np.ndarray) -> np.ndarray:
    """The last epoch that is not after each of `instants` [s], -1 for none: a part from the next would end beyond its start."""
    return time.searchsorted(instants + 1e-6, side="right") - 1


def can_estimate(spec: WindowSpec) -> bool:
    """Whether a network's inputs are such that velocities through the water can take their place."""
    return set(spec.inputs) <= {*MOVING, *STILL}


def estimate_current(
    contract: Contract, network: Network, states: States, rows: np.ndarray, deviation: float
) -> Current:
    """The current at each of `rows` (n,) from the states before it; where they are less than history and horizon, or broken, none.

    The spec's `current_memory`, or as much of it as there is, else the last horizon, in parts of a third of the horizon: see
    `_sought`. What looks like a current and is none, such as wind that the network does not know, gains less than SURE: 16 at
    most in six simulated voyages of cargo90 in winds of up to 10 m/s.
    """
    rows, spec = np.asarray(rows, int), contract.spec
    time, span = states["time_s"], part(spec)
    most = PARTS if spec.current_memory is None else round(spec.current_memory / span)
    velocity, covariance = np.zeros((len(rows), 2)), np.full((len(rows), 2, 2), np.nan)
    sure = np.zeros(len(rows), bool)
    unusable = broken(states, spec.read, spec.period)
    left = np.ones(len(rows), bool)
    for count in range(most, PARTS - 1, -1):  # the longest past that is there
        first = _epoch(time, time[rows] - count * span)
        before = time[first] - spec.period * (spec.history_steps - 1)
        whole = unusable[rows + 1] == unusable[time.searchsorted(before - 1e-6)]
        enough = np.flatnonzero(left & (first >= 0) & (before >= time[0] - 1e-6) & whole)
        if len(enough) == 0:
            continue
        left[enough] = False
        begins = np.concatenate([time[rows[enough]] - count * span + k * span for k in range(count)])
        found, normal, gain = _sought(contract, network, states, begins, len(enough), deviation)
        sure[enough] = gain > SURE
        velocity[enough] = np.where((gain > SURE)[:, None], found, 0.0)
        covariance[enough] = np.linalg.inv(normal)
    return Current(velocity, covariance, sure)


def voyage_current(contract: Contract, network: Network, states: States, deviation: float) -> Current:
    """The one current of a whole voyage (arrays of n = 1), from all of its parts that have their history and are not broken."""
    spec, time = contract.spec, states["time_s"]
    span, before = part(spec), spec.period * (spec.history_steps - 1)
    begins = np.arange(time[0] + before, time[-1] - span, span)
    first, last = time[_epoch(time, begins)] - before, time.searchsorted(begins + span - 1e-6)
    unusable = broken(states, spec.read, spec.period)
    begins = begins[(unusable[last + 1] == unusable[time.searchsorted(first - 1e-6)]) & (first >= time[0] - 1e-6)]
    if not len(begins):
        return Current(np.zeros((1, 2)), np.full((1, 2, 2), np.nan), np.zeros(1, bool))
    found, normal, gain = _sought(contract, network, states, begins, 1, deviation)
    sure = gain > SURE
    return Current(np.where(sure[:, None], found, 0.0), np.linalg.inv(normal), sure)


def _sought(
    contract: Contract, network: Network, states: States, begins: np.ndarray, count: int, deviation: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The current (n, 2) that explains parts of a voyage, its information (n, 2, 2) and gain (n,), for each of `count` = n starts.

    `begins` [s] are where parts begin: the first of every start, then the second of every start and so on. From the state at the
    begin of each the network runs on under the orders that were in force, and its end is compared with where the ship was.
    Least squares over these two numbers a part, each with the variance `deviation`^2 [m2] of the network's place after a part
    plus that of the filter's places at both ends, and a current that is normal about zero with USUAL. The gain in twice the
    log-likelihood over still water is c^T P^-1 c.
    """
    spec, time = contract.spec, states["time_s"]
    span, parts, steps = part(spec), len(begins) // count, round(part(spec) / spec.period)
    first = _epoch(time, begins)
    plans = plans_sailed(states, time[first], span, spec.forcings)
    given = material(contract, states, first, plans)
    place = states["north_m"] + 1j * states["east_m"]
    went = np.interp(time[first] + span, time, place) - place[first]
    spread = [states[f"{axis}_m_sd"] ** 2 for axis in ("north", "east")]
    noise = [values[first] + np.interp(time[first] + span, time, values) for values in spread]
    weight = 1 / (deviation**2 + np.stack(noise, axis=-1))  # (parts, 2)

    def ways(currents: np.ndarray) -> np.ndarray:
        """Ground ways (variants, parts) in currents (variants, parts, 2), all in one call of the network."""
        many = Material(*(np.concatenate([array] * len(currents)) for array in given))
        flow = currents.reshape(-1, 2)
        seen = through_water(many, spec, flow)
        short = seen.forcing[:, : steps + 1]  # a roll-out need not run further than a part
        path = draw(contract, many.pose, network(seen.history, short, seen.wind), False)
        gone = path.north[:, steps] - path.north[:, 0] + 1j * (path.east[:, steps] - path.east[:, 0])
        return (gone + (flow[:, 0] + 1j * flow[:, 1]) * span).reshape(len(currents), -1)

    def by_start(values: np.ndarray) -> np.ndarray:
        """Sums over the parts of each start."""
        return values.reshape(parts, -1, *values.shape[1:]).sum(axis=0)

    found = np.zeros((count, 2))
    for step in range(STEPS):
        now = np.tile(found, (parts, 1))
        here, *moved = ways(now + STEP * np.array([[[0.0, 0.0]], [[1.0, 0.0]], [[0.0, 1.0]]]))
        slopes = (np.stack(moved, axis=-1) - here[:, None]) / STEP  # (parts, by north and east)
        J = np.stack([slopes.real, slopes.imag], axis=1)  # (parts, of north and east, by north and east)
        off = went - here
        weighted = J * weight[..., None]
        normal = by_start(np.einsum("nij,nik->njk", weighted, J)) + np.eye(2) / USUAL**2
        gradient = by_start(np.einsum("nij,ni->nj", weighted, np.stack([off.real, off.imag], axis=-1)))
        gradient -= found / USUAL**2
        found = found + np.linalg.solve(normal, gradient[..., None])[..., 0]
        gain = np.einsum("ni,nij,nj->n", found, normal, found)
        if step == 0 and gain.max() < SURE / 2:  # nowhere near; without a current the next step moves 3 mm/s at most
            break
    return found, normal, gain
