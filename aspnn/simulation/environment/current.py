"""Currents: a steady mean, eddies that vary slowly in space and time, and sheared streams, as a sum of divergence-free plane waves.

`eddies` is an array (M, 5), one row per mode: amplitude a [m/s], k_north, k_east [rad/m], omega [rad/s], phase [rad]. The velocity
of a mode is a (-k_east, k_north) / |k| cos(k . x - omega t + phase), across its own wave vector, so its divergence is zero at every
place and time; an array of no rows is a uniform current. The field is horizontal and the same at every depth.
"""

import math

import numpy as np
from numba import njit

from aspnn.simulation.environment.waves import turn


# Sums over modes may be taken in any order, which is what vectors of partial sums need; nothing else is given up.
@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def current_at(mean, eddies, north, east, time):
    """Velocity of the water (v_north, v_east) [m/s] at one place and time; `mean` holds the steady part (north, east)."""
    v_north, v_east = mean[0], mean[1]
    for m in range(eddies.shape[0]):
        k_n, k_e = eddies[m, 1], eddies[m, 2]
        c, _ = turn(k_n * north + k_e * east - eddies[m, 3] * time + eddies[m, 4])
        speed = eddies[m, 0] * c / math.sqrt(k_n * k_n + k_e * k_e)
        v_north -= speed * k_e
        v_east += speed * k_n
    return v_north, v_east


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def shear_at(eddies, north, east, time):
    """Gradient of the current at one place and time: (dVn/dN, dVn/dE, dVe/dN, dVe/dE) [1/s]; dVe/dE is -dVn/dN.

    A ship that moves through water at u_r over such a field feels the change of the water about it as -(u_r . grad) V in the rate
    of u_r: in slowly varying flow the force on a body that displaces its own mass m is m DV/Dt + m_A (DV/Dt - dU/dt) + F (Auton,
    Hunt and Prud'homme, J. Fluid Mech. 197 (1988) 241-257, recalled), DV/Dt taken along the water, so that
    d(U - V)/dt = F / (m + m_A) - (u_r . grad) V; the local rate of V in time drops out.
    """
    nn = ne = en = 0.0
    for m in range(eddies.shape[0]):
        k_n, k_e = eddies[m, 1], eddies[m, 2]
        _, s = turn(k_n * north + k_e * east - eddies[m, 3] * time + eddies[m, 4])
        rate = -eddies[m, 0] * s / math.sqrt(k_n * k_n + k_e * k_e)
        nn -= rate * k_e * k_n
        ne -= rate * k_e * k_e
        en += rate * k_n * k_n
    return nn, ne, en, -nn


def stream(speed: float, towards: float, width: float, middle: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A steady stream that is sheared across: its mean velocity (2,) and the one mode (1, 5) that varies about it.

    It runs `towards` [rad from grid north], at `speed` [m/s] through the place `middle` (north, east) [m], and with s the distance
    across from there V = speed (1 + cos(2 pi s / width)) / 2: none at the banks, half a `width` [m] to either side, sheared by pi
    speed / width at most. Beyond the banks the next stream begins. An assumed profile; the mode is one of those above with omega 0.
    """
    k = 2 * math.pi / width
    k_n, k_e = k * math.sin(towards), -k * math.cos(towards)
    along = np.array([math.cos(towards), math.sin(towards)])
    return speed / 2 * along, np.array([[speed / 2, k_n, k_e, 0.0, -(k_n * middle[0] + k_e * middle[1])]])


def draw_eddies(rng: np.random.Generator, speed: float, length: float, period: float, count: int = 16) -> np.ndarray:
    """Eddies (count, 5) of a random field that is alike everywhere, in every direction and at all times.

    `speed` is the root of the mean square of the water's speed [m/s]. The velocities at two places r apart and t later are
    correlated (trace over both components) as exp(-r^2 / (2 length^2) - t^2 / (2 period^2)), `length` [m] and `period` [s]: the
    mean of cos(k . x - omega t) over normal wave vectors of standard deviation 1 / length in each component and normal
    frequencies of 1 / period. Equal amplitudes speed sqrt(2 / count). Derived here; a model of no particular waters. The theory of
    `shear_at` wants a `length` of several ship lengths.
    """
    eddies = np.empty((count, 5))
    eddies[:, 0] = speed * math.sqrt(2 / count)
    eddies[:, 1:3] = rng.normal(0, 1 / length, (count, 2))
    eddies[:, 3] = rng.normal(0, 1 / period, count)
    eddies[:, 4] = rng.uniform(0, 2 * np.pi, count)
    return eddies
