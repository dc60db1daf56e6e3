"""Tracking control of a craft that has no sway actuator, by backstepping: it follows a moving reference, position and time.

Y. Peng and J. Han, "Tracking Control of Unmanned Trimaran Surface Vehicle" (2007), eqs. (3)-(7) and the laws after (7), corrected (E56).
In coordinates (5), the craft of (1) and (2) is the chain

    x3' = x5 x6,  x4' = x5,  x5' = u1,  x6' = u2,

and beside it x1, x2, which are stable by damping alone: x1' = -(d22/m11) (x1 + x6) + x5 (x3 - (m22/d22) x2),
x2' = -(d22/m22) (x2 - x5 (x1 + x6)). The law makes yaw linear, e4'' = -(k1 + k2) e4' - k1 k2 e4, and with
z = e6 + k3 x5d e3 lets V = (e3^2 + z^2) / 2 fall: V' = -k3 x5d^2 e3^2 - k4 z^2 + x6d e3 e5 - k3 x5d e5 e3^2, whose last two terms
vanish with e5. So it needs a turning reference: at x5d = 0 nothing pulls e3 in.

Mended besides E56: the moment has + d33 r; the force has - d22 (...), which follows from E56; x5d and e3 have lost their dots in print.
Positions are told from an origin near the reference: far away, a small error of heading turns into a large one of position.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aspnn.estimation.craft import SURGE, SWAY, YAW_RATE, Craft, rates
from aspnn.schema import InputError


@dataclass(frozen=True)
class Gains:
    """k1, k2 [1/s], poles of the heading error; k3 [s], along the way; k4 [1/s], of the surge. The paper tells none; these are ours.

    Errors along the way fall at the slower root of s^2 + (k3 r_d^2 + k4) s + (k3 k4 + 1) r_d^2, 0.087 1/s at 0.05 rad/s.
    """

    k1: float = 0.5
    k2: float = 0.5
    k3: float = 30.0
    k4: float = 0.3

    def __post_init__(self) -> None:
        for name, gain in vars(self).items():
            if not 0 < gain < math.inf:
                raise InputError(f"tracking Gains: {name} = {gain:g} must be positive")


class Reference(NamedTuple):
    """A virtual craft over n epochs: states `x` (n, 6), their `rate` (n, 6), and the forces `tau` (n, 2) [N, N m] that move it so."""

    x: np.ndarray
    rate: np.ndarray
    tau: np.ndarray


class Command(NamedTuple):
    """Surge force and yaw moment `tau` (2, ...) [N, N m], errors (6, ...) of the coordinates, and which force met its limit (2, ...)."""

    tau: np.ndarray
    error: np.ndarray
    saturated: np.ndarray


def coordinates(craft: Craft, x: np.ndarray) -> np.ndarray:
    """x1 to x6 (6, ...) of states (6, ...): (5), with m22 / d22 in x3 (E56)."""
    north, east, heading, u, v, r = x
    c, s = np.cos(heading), np.sin(heading)
    ahead = north * c + east * s
    aside = -north * s + east * c
    parts = ahead, v, aside + craft.m22 / craft.d22 * v, heading, r, -craft.m11 / craft.d22 * u - ahead
    return np.stack(np.broadcast_arrays(*parts))  # one reference may serve many masses


def coordinate_rates(craft: Craft, x: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """x3', x5', x6' (3, ...) of states (6, ...) that change at `rate` (6, ...), whatever moves them.

    Where `rate` is that of the craft, x3' is x5 x6, and x5', x6' are the u1, u2 of (6).
    """
    z, (_, _, _, u, v, r) = coordinates(craft, x), x
    aside = z[2] - craft.m22 / craft.d22 * v
    third = v - r * z[0] + craft.m22 / craft.d22 * rate[SWAY]
    sixth = -craft.m11 / craft.d22 * rate[SURGE] - u - r * aside
    return np.stack(np.broadcast_arrays(third, rate[YAW_RATE], sixth))


def forces(craft: Craft, x: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The forces (2, ...) that give x5 and x6 the `wanted` rates u1, u2 (2, ...): (6), with -tau_1 / d22 (E56), solved."""
    u, v, r = x[SURGE], x[SWAY], x[YAW_RATE]
    force = (craft.d11 - craft.d22) * u - craft.d22 * (coordinates(craft, x)[2] * r + wanted[1])
    moment = (craft.m22 - craft.m11) * u * v + craft.d33 * r + craft.m33 * wanted[0]
    return np.array([force, moment])


def command(
    craft: Craft,
    x: np.ndarray,
    reference: np.ndarray,
    reference_rate: np.ndarray,
    gains: Gains,
    limit: tuple[float, float] = (math.inf, math.inf),
) -> Command:
    """What brings states `x` (6, ...) to the `reference` (6, ...) that changes at `reference_rate` (6, ...).

    `craft` as it is believed to be: a varying m11 goes in as the estimate, and the reference stays that of a craft with its own.
    Headings are continuous and must be of the same turn. `limit` [N, N m] cuts the forces off.
    """
    k1, k2, k3, k4 = gains.k1, gains.k2, gains.k3, gains.k4
    here, there = coordinates(craft, x), coordinates(craft, reference)
    e, rate = here - there, there[4]
    third, turning, sixth = coordinate_rates(craft, reference, reference_rate)
    approach = here[4] * here[5] - third  # e3'
    turn = turning - (k1 + k2) * e[4] - k1 * k2 * e[3]
    surge = sixth - k3 * turning * e[2] - k3 * rate * approach - k4 * e[5] - (k3 * k4 + 1) * rate * e[2]
    asked = forces(craft, x, np.array([turn, surge - e[2] * e[4]]))
    bound = np.reshape(limit, (2,) + (1,) * (asked.ndim - 1))
    return Command(np.clip(asked, -bound, bound), e, np.abs(asked) > bound)


def lyapunov(gains: Gains, error: np.ndarray, reference_yaw_rate: float) -> np.ndarray:
    """V (...) of the errors (6, ...) of `command`, which falls once the yaw rate follows."""
    z = error[5] + gains.k3 * reference_yaw_rate * error[2]
    return 0.5 * (error[2] ** 2 + z**2)


def turning_reference(craft: Craft, start: np.ndarray, dt: float, count: int) -> Reference:
    """A feasible reference: the surge and yaw rate of `start` (6) are held for `count` epochs, `dt` [s] apart.

    The sway follows from them, v' = -(m11 u r + d22 v) / m22, and the forces from (4): tau_1 = d11 u - m22 v r,
    tau_3 = d33 r - (m11 - m22) u v. In closed form.
    Raises InputError for a start that does not turn, or does not move.
    """
    north, east, heading, u, v, r = np.asarray(start, float)
    if r == 0 or u == 0:
        raise InputError("turning_reference: surge and yaw rate must not be zero; this law cannot hold a straight line")
    time, damping, steady = dt * np.arange(count), craft.d22 / craft.m22, -craft.m11 * u * r / craft.d22
    sway = steady + (v - steady) * np.exp(-damping * time)
    # Place: the integral of (u + i v) exp(i heading), v in its two parts.
    turn, fade = 1j * r, 1j * r - damping
    way = (u + 1j * steady) * np.expm1(turn * time) / turn + 1j * (v - steady) * np.expm1(fade * time) / fade
    place = north + 1j * east + np.exp(1j * heading) * way
    held = np.ones(count)
    x = np.stack([place.real, place.imag, heading + r * time, u * held, sway, r * held], axis=1)
    tau = np.stack([craft.d11 * u - craft.m22 * sway * r, craft.d33 * r - (craft.m11 - craft.m22) * u * sway], axis=1)
    return Reference(x, rates(craft, x.T, tau.T).T, tau)
