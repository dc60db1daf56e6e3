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

PARTS = 3  # the last horizon is gone through again in so many parts, each from the states at its begin
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


def can_estimate(spec: WindowSpec) -> bool:
    """Whether a network's inputs are such that velocities through the water can take their place."""
    return set(spec.inputs) <= {*MOVING, *STILL}


def estimate_current(
    contract: Contract, network: Network, states: States, rows: np.ndarray, deviation: float
) -> Current:
    """The current at each of `rows` (n,) from the states before it; a start with less of them than history and horizon, or broken ones, has none.

    The last horizon in PARTS: from the state at the begin of each the network runs on under the orders that were in force, and
    its end is compared with where the ship was. Least squares over these 2 PARTS numbers, each with the variance
    `deviation`^2 [m2] of the network's place after a part plus that of the filter's places at both ends, and a current that is
    normal about zero with USUAL. The gain in twice the log-likelihood over still water is c^T P^-1 c; a current is used where
    it exceeds SURE. What looks like a current and is none, such as wind that the network does not know, gains less: 16 at most
    in six simulated voyages of cargo90 in winds of up to 10 m/s.
    """
    rows, spec = np.asarray(rows, int), contract.spec
    time, span = states["time_s"], spec.horizon / PARTS
    velocity, covariance = np.zeros((len(rows), 2)), np.full((len(rows), 2, 2), np.nan)
    before = spec.horizon + spec.period * (spec.history_steps - 1)
    unusable = broken(states, spec.read, spec.period)
    whole = unusable[rows + 1] == unusable[time.searchsorted(time[rows] - before - 1e-6)]
    enough = np.flatnonzero((time[rows] - time[0] >= before - 1e-6) & whole)
    sure = np.zeros(len(rows), bool)
    if len(enough) == 0:
        return Current(velocity, covariance, sure)
    begins = np.concatenate([time[rows[enough]] - spec.horizon + k * span for k in range(PARTS)])
    first, last = (time.searchsorted(t - 1e-6) for t in (begins, begins + span))
    last = np.minimum(last, np.tile(rows[enough], PARTS))  # the start itself is the end of the last part
    plans = plans_sailed(states, begins, span, spec.forcings)
    given = material(contract, states, first, plans)
    place = states["north_m"] + 1j * states["east_m"]
    went, steps = place[last] - place[first], np.rint((time[last] - time[first]) / spec.period).astype(int)
    noise = [states[f"{axis}_m_sd"][first] ** 2 + states[f"{axis}_m_sd"][last] ** 2 for axis in ("north", "east")]
    weight = 1 / (deviation**2 + np.stack(noise, axis=-1))  # (parts, 2)

    def ways(currents: np.ndarray) -> np.ndarray:
        """Ground ways (variants, parts) in currents (variants, parts, 2), all in one call of the network."""
        many = Material(*(np.concatenate([array] * len(currents)) for array in given))
        flow = currents.reshape(-1, 2)
        seen = through_water(many, spec, flow)
        short = seen.forcing[:, : steps.max() + 1]  # a roll-out need not run further than a part
        path = draw(contract, many.pose, network(seen.history, short, seen.wind), False)
        gone = path.north - path.north[:, :1] + 1j * (path.east - path.east[:, :1])
        ends = np.tile(steps, len(currents))
        gone = gone[np.arange(len(ends)), ends] + (flow[:, 0] + 1j * flow[:, 1]) * ends * spec.period
        return gone.reshape(len(currents), -1)

    found = np.zeros((len(enough), 2))
    for step in range(STEPS):
        now = np.tile(found, (PARTS, 1))
        here, *moved = ways(now + STEP * np.array([[[0.0, 0.0]], [[1.0, 0.0]], [[0.0, 1.0]]]))
        slopes = (np.stack(moved, axis=-1) - here[:, None]) / STEP  # (parts, by north and east)
        J = np.stack([slopes.real, slopes.imag], axis=1)  # (parts, of north and east, by north and east)
        off = went - here
        weighted = J * weight[..., None]
        normal = _by_start(np.einsum("nij,nik->njk", weighted, J)) + np.eye(2) / USUAL**2
        gradient = _by_start(np.einsum("nij,ni->nj", weighted, np.stack([off.real, off.imag], axis=-1)))
        gradient -= found / USUAL**2
        found = found + np.linalg.solve(normal, gradient[..., None])[..., 0]
        gain = np.einsum("ni,nij,nj->n", found, normal, found)
        if step == 0 and gain.max() < SURE / 2:  # nowhere near; without a current the next step moves 3 mm/s at most
            break
    sure[enough] = gain > SURE
    velocity[enough] = np.where((gain > SURE)[:, None], found, 0.0)
    covariance[enough] = np.linalg.inv(normal)
    return Current(velocity, covariance, sure)


def _by_start(parts: np.ndarray) -> np.ndarray:
    """Sums over the parts of each start of arrays whose first axis runs over starts within parts."""
    return parts.reshape(PARTS, -1, *parts.shape[1:]).sum(axis=0)
