"""Two propellers abreast: the speeds that give a surge force and a yaw moment, and the levers of a craft steered by them.

Paper 001 (60)-(63) inverted exactly, the propeller's constant being that of its own direction of thrust, and within what
propellers can give. Steering comes first: where they cannot do both, the moment is held and the surge force is the nearest that
leaves it, for a craft that no longer turns is lost sooner than one that slows down. Compiled functions take a pair of
propellers by its attributes, so a simulated craft that has those of `Propellers` is one.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit


class Propellers(NamedTuple):
    """A pair of like propellers, `arm` [m] to port and to starboard of the centre line.

    Thrust [N] is k |n| n, n in rad/s, with `k_pos` [kg m] ahead and `k_neg` astern, at most `ahead` and `astern` [N] each.
    """

    arm: float
    k_pos: float
    k_neg: float
    ahead: float
    astern: float


class Allocation(NamedTuple):
    """What two propellers make of a demand, arrays of one shape: speeds [rad/s], and the force [N] and moment [N m] they give.

    `saturated` where that is not what was asked.
    """

    port: np.ndarray
    starboard: np.ndarray
    surge_force: np.ndarray
    yaw_moment: np.ndarray
    saturated: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def thrust_at(pair, n):
    """Thrust [N] of one propeller at n [rad/s], within its limits."""
    thrust = (pair.k_pos if n > 0 else pair.k_neg) * n * abs(n)
    return min(max(thrust, -pair.astern), pair.ahead)


@njit(cache=True, nogil=True, error_model="numpy")
def speed_for(pair, thrust):
    """Propeller speed [rad/s] of a thrust [N]: n = sgn(T) sqrt(|T| / k), paper 001 (62)-(63), with the k of its direction."""
    return math.copysign(math.sqrt(abs(thrust) / (pair.k_pos if thrust > 0 else pair.k_neg)), thrust)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def share(pair, surge_force, yaw_moment):
    """Thrusts [N] of the port and the starboard propeller: their sum is X, arm times their difference N, steering first."""
    most = pair.ahead + pair.astern
    difference = min(max(yaw_moment / pair.arm, -most), most)
    spare = 0.5 * abs(difference)
    mean = min(max(0.5 * surge_force, spare - pair.astern), pair.ahead - spare)
    return mean + 0.5 * difference, mean - 0.5 * difference


@njit(cache=True, nogil=True, error_model="numpy")
def allocate(pair, surge_force, yaw_moment):
    """Propeller speeds (port, starboard) [rad/s] that give a surge force [N] and a yaw moment [N m], both numbers.

    Paper 001 (60)-(63): T_port + T_starboard = X, arm (T_port - T_starboard) = N, n = sgn(T) sqrt(|T| / k), with the k of the
    thrust's own direction (the paper uses that ahead for both, so that its reversing propeller gives 58 % of what was
    asked). When the propellers saturate steering wins: the moment is held, and the surge force is the nearest that leaves it.
    """
    port, starboard = share(pair, surge_force, yaw_moment)
    return speed_for(pair, port), speed_for(pair, starboard)


def allocate_many(pair: Propellers, surge_force, yaw_moment) -> Allocation:
    """What `allocate` makes of demands of any one shape, with what the propellers then give, and where that is not all.

    The arrays of the result have the demands' common shape.
    """
    surge_force, yaw_moment = np.broadcast_arrays(np.asarray(surge_force, float), np.asarray(yaw_moment, float))
    speeds = np.empty((surge_force.size, 2))
    _allocate_all(pair, surge_force.ravel(), yaw_moment.ravel(), speeds)
    port, starboard = (speeds[:, i].reshape(surge_force.shape) for i in (0, 1))
    force, moment = given(pair, port, starboard)
    short = ~(
        np.isclose(force, surge_force, rtol=1e-9, atol=1e-9) & np.isclose(moment, yaw_moment, rtol=1e-9, atol=1e-9)
    )
    return Allocation(port, starboard, force, moment, short)


def given(pair: Propellers, port, starboard) -> tuple[np.ndarray, np.ndarray]:
    """Surge force [N] and yaw moment [N m] of propellers at these speeds [rad/s], paper 001 (60) with the k of each direction."""
    thrusts = []
    for n in (np.asarray(port, float), np.asarray(starboard, float)):
        thrust = np.where(n > 0, pair.k_pos, pair.k_neg) * n * np.abs(n)
        thrusts.append(np.clip(thrust, -pair.astern, pair.ahead))
    return thrusts[0] + thrusts[1], pair.arm * (thrusts[0] - thrusts[1])


def most_moment(pair: Propellers, surge_force: float) -> float:
    """The largest yaw moment [N m] to either side that leaves a surge force [N], which must be one they can give."""
    mean = 0.5 * surge_force
    return 2 * pair.arm * max(min(pair.ahead - mean, mean + pair.astern), 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _allocate_all(pair, surge_force, yaw_moment, speeds):
    for k in range(len(surge_force)):
        speeds[k, 0], speeds[k, 1] = allocate(pair, surge_force[k], yaw_moment[k])
