"""Wind loads on ships by tabulated coefficients (Blendermann, Isherwood), and gusting wind by the Froya spectrum."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from aspnn.simulation.ships.coefficients import coefficients
from aspnn.vessel import Vessel

AIR_DENSITY = 1.224  # kg/m3, at 15 degrees Celsius and sea level
GAMMA = np.linspace(0, np.pi, 361)  # rad, angle of the apparent wind off the bow at which coefficients are tabulated
SLOWEST_GUST = 1 / 2400  # Hz; the Froya spectrum is stated for 1/2400 to 0.5 Hz
FASTEST_GUST = 0.5

# R. M. Isherwood, "Wind resistance of merchant ships", Trans. RINA 115 (1973) 327-338: the coefficients by wind angle, as transcribed
# in the public Marine Systems Simulator (isherwood72.m) and, alike, in another public copy; the paper itself was not opened.
# Rows: angle off the bow [deg], then A0...A6.
ISHERWOOD_X = """
  0   2.152  -5.00   0.243  -0.164   0      0      0
 10   1.714  -3.33   0.145  -0.121   0      0      0
 20   1.818  -3.97   0.211  -0.143   0      0      0.033
 30   1.965  -4.81   0.243  -0.154   0      0      0.041
 40   2.333  -5.99   0.247  -0.190   0      0      0.042
 50   1.726  -6.54   0.189  -0.173   0.348  0      0.048
 60   0.913  -4.68   0      -0.104   0.482  0      0.052
 70   0.457  -2.88   0      -0.068   0.346  0      0.043
 80   0.341  -0.91   0      -0.031   0      0      0.032
 90   0.355   0      0       0      -0.247  0      0.018
100   0.601   0      0       0      -0.372  0     -0.020
110   0.651   1.29   0       0      -0.582  0     -0.031
120   0.564   2.54   0       0      -0.748  0     -0.024
130  -0.142   3.58   0       0.047  -0.700  0     -0.028
140  -0.677   3.64   0       0.069  -0.529  0     -0.032
150  -0.723   3.14   0       0.064  -0.475  0     -0.032
160  -2.148   2.56   0       0.081   0      1.27  -0.027
170  -2.707   3.97  -0.175   0.126   0      1.81   0
180  -2.529   3.76  -0.174   0.128   0      1.55   0
"""
ISHERWOOD_Y = """
  0   0       0      0       0       0      0      0
 10   0.096   0.22   0       0       0      0      0
 20   0.176   0.71   0       0       0      0      0
 30   0.225   1.38   0       0.023   0     -0.29   0
 40   0.329   1.82   0       0.043   0     -0.59   0
 50   1.164   1.26   0.121   0      -0.242 -0.95   0
 60   1.163   0.96   0.101   0      -0.177 -0.88   0
 70   0.916   0.53   0.069   0       0     -0.65   0
 80   0.844   0.55   0.082   0       0     -0.54   0
 90   0.889   0      0.138   0       0     -0.66   0
100   0.799   0      0.155   0       0     -0.55   0
110   0.797   0      0.151   0       0     -0.55   0
120   0.996   0      0.184   0      -0.212 -0.66   0.34
130   1.014   0      0.191   0      -0.280 -0.69   0.44
140   0.784   0      0.166   0      -0.209 -0.53   0.38
150   0.536   0      0.176  -0.029  -0.163  0      0.27
160   0.251   0      0.106  -0.022   0      0      0
170   0.125   0      0.046  -0.012   0      0      0
180   0       0      0       0       0      0      0
"""
ISHERWOOD_N = """
  0   0       0      0       0       0       0
 10   0.0596  0.061  0       0       0      -0.074
 20   0.1106  0.204  0       0       0      -0.170
 30   0.2258  0.245  0       0       0      -0.380
 40   0.2017  0.457  0       0.0067  0      -0.472
 50   0.1759  0.573  0       0.0118  0      -0.523
 60   0.1925  0.480  0       0.0115  0      -0.546
 70   0.2133  0.315  0       0.0081  0      -0.526
 80   0.1827  0.254  0       0.0053  0      -0.443
 90   0.2627  0      0       0       0      -0.508
100   0.2102  0     -0.0195  0       0.0335 -0.492
110   0.1567  0     -0.0258  0       0.0497 -0.457
120   0.0801  0     -0.0311  0       0.0740 -0.396
130  -0.0189  0     -0.0488  0.0101  0.1128 -0.420
140   0.0256  0     -0.0422  0.0100  0.0889 -0.463
150   0.0552  0     -0.0381  0.0109  0.0689 -0.476
160   0.0881  0     -0.0306  0.0091  0.0366 -0.415
170   0.0851  0     -0.0122  0.0025  0      -0.220
180   0       0      0       0       0       0
"""


class Air(NamedTuple):
    """What the wind takes hold of: areas [m2], length overall [m], and coefficients by the angle of the wind off the bow.

    `table` (361, 3) holds C_X, C_Y, C_N at the angles GAMMA for wind from port: X = q A_F C_X, Y = q A_L C_Y,
    N = q A_L length C_N with q = 1/2 rho V^2. Wind from starboard is its mirror.
    """

    A_F: float
    A_L: float
    length: float
    table: np.ndarray

    @staticmethod
    def of(vessel: Vessel) -> "Air":
        """The air of a vessel file: Isherwood's method if section `wind` names its superstructure, perimeter, centroid or masts,
        else Blendermann's; without a section, no load. Raises InputError naming the vessel and the coefficient.
        """
        if "wind" not in vessel.simulator:
            return Air(0.0, 0.0, vessel.length, np.zeros((len(GAMMA), 3)))
        length = vessel.length
        areas = {"A_F": (0.01, 1e4), "A_L": (0.01, 1e5)}
        drags = {"CDt": (0.1, 2.0), "CDl_0": (0.0, 2.0), "CDl_pi": (0.0, 2.0), "delta": (0.0, 1.0)}
        profile = {"A_SS": (0.0, 1e5), "S": (length, 4 * length), "C": (0.0, length), "M": (0.0, 20.0)}
        if profile.keys() & vessel.simulator["wind"].keys() and not drags.keys() & vessel.simulator["wind"].keys():
            return isherwood(length=length, beam=vessel.beam, **coefficients(vessel, "wind", areas | profile))
        rest = {"s_L": (-length / 2, length / 2), "kappa": (0.0, 10.0)}
        found = coefficients(vessel, "wind", areas | drags | rest, {"kappa": 0.0})
        del found["kappa"]  # of the rolling moment, which no ship here takes
        return blendermann(length=length, **found)


def blendermann(
    A_F: float, A_L: float, length: float, CDt: float, CDl_0: float, CDl_pi: float, delta: float, s_L: float
) -> Air:
    """Air after W. Blendermann, "Parameter identification of wind loads on ships", J. Wind Eng. Ind. Aerodyn. 51 (1994) 339-351,
    as in Fossen's handbook (10.1.2). `s_L` [m] is the centroid of A_L, forward of midship.

    With the angle gamma of the apparent wind off the bow, 0 to pi, C_X = -CD_l cos gamma / D, C_Y = CD_t sin gamma / D,
    C_N = (s_L / L - 0.18 (gamma - pi / 2)) C_Y, D = 1 - delta / 2 (1 - CD_l A_F / (CD_t A_L)) sin^2(2 gamma), where CD_l on A_F
    is CDl_0 for wind from forward of the beam and CDl_pi for wind from abaft it.
    """
    CDl = np.where(np.cos(GAMMA) > 0, CDl_0, CDl_pi)
    D = 1 - delta / 2 * (1 - CDl * A_F / (CDt * A_L)) * np.sin(2 * GAMMA) ** 2
    C_X = -CDl * np.cos(GAMMA) / D
    C_Y = CDt * np.sin(GAMMA) / D
    C_N = (s_L / length - 0.18 * (GAMMA - np.pi / 2)) * C_Y
    return Air(A_F, A_L, length, np.column_stack([C_X, C_Y, C_N]))


def isherwood(A_F: float, A_L: float, length: float, beam: float, A_SS: float, S: float, C: float, M: float) -> Air:
    """Air after Isherwood (1973), a regression on wind-tunnel tests of merchant ships; its coefficients go linearly between 10 degrees.

    `A_SS` [m2] lateral area of the superstructure; `S` [m] perimeter of the lateral projection without waterline and masts; `C` [m]
    centroid of A_L aft of the bow; `M` number of groups of masts or king posts seen from abeam. With L = length, B = beam,
    C_X = -(A0 + A1 2 A_L / L^2 + A2 2 A_F / B^2 + A3 L / B + A4 S / L + A5 C / L + A6 M), C_Y = B0 + ... + B5 C / L + B6 A_SS / A_L
    and C_N = C0 + ... + C5 C / L likewise.
    """
    shape = np.array([1.0, 2 * A_L / length**2, 2 * A_F / beam**2, length / beam, S / length, C / length])
    C_X = -_isherwood(ISHERWOOD_X, np.append(shape, M))
    C_Y = _isherwood(ISHERWOOD_Y, np.append(shape, A_SS / A_L))
    return Air(A_F, A_L, length, np.column_stack([C_X, C_Y, _isherwood(ISHERWOOD_N, shape)]))


def _isherwood(table: str, shape: np.ndarray) -> np.ndarray:
    rows = np.array(table.split(), float).reshape(-1, 1 + len(shape))
    return np.interp(GAMMA, np.radians(rows[:, 0]), rows[:, 1:] @ shape)


@njit(cache=True, nogil=True, error_model="numpy")
def wind_load(air, u, v):
    """Wind's surge and sway force [N] and yaw moment [N m] at midship, on a ship that moves with (u, v) [m/s] through the air.

    1/2 rho V^2 times area and the coefficient at gamma = atan2(|v|, u), linear between tabulated angles; mirror symmetric, and
    zero at rest. The method's own range is the whole circle; heights and profiles of the wind are those of the coefficients'
    tests, usually 10 m.
    """
    square = u * u + v * v
    place = math.atan2(abs(v), u) / math.pi * (air.table.shape[0] - 1)
    row = min(int(place), air.table.shape[0] - 2)
    part = place - row
    C_X = air.table[row, 0] + part * (air.table[row + 1, 0] - air.table[row, 0])
    C_Y = air.table[row, 1] + part * (air.table[row + 1, 1] - air.table[row, 1])
    C_N = air.table[row, 2] + part * (air.table[row + 1, 2] - air.table[row, 2])
    pressure = 0.5 * AIR_DENSITY * square
    sideways = math.copysign(pressure * air.A_L, -v)
    return pressure * air.A_F * C_X, sideways * C_Y, sideways * air.length * C_N


def gust_spectrum(frequency: np.ndarray, mean: float, height: float) -> np.ndarray:
    """One-sided spectral density [m2/s2/Hz] of the wind along its mean direction, at frequencies [Hz] from 1/2400 to 0.5.

    The Froya spectrum of NORSOK N-003 and ISO 19901-1 (taken from public transcriptions), mean U0 [m/s] over one hour at 10 m,
    height z [m]: S = 320 (U0 / 10)^2 (z / 10)^0.45 / (1 + f~^n)^(5 / (3 n)), f~ = 172 f (z / 10)^(2/3) (U0 / 10)^(-3/4), n = 0.468.
    For neutral, strong wind over open sea (measured at U0 from about 10 to 26 m/s, recalled).
    """
    n = 0.468
    reduced = 172 * frequency * (height / 10) ** (2 / 3) * (mean / 10) ** -0.75
    return 320 * (mean / 10) ** 2 * (height / 10) ** 0.45 / (1 + reduced**n) ** (5 / (3 * n))


def gust_series(rng: np.random.Generator, mean: float, height: float, dt: float, steps: int) -> np.ndarray:
    """Gusting wind speed (steps,) [m/s] every `dt` [s] at `height` [m], about `mean` [m/s], the wind of an hour at 10 m.

    A Gaussian series with `gust_spectrum`, by the inverse Fourier transform of independent normal coefficients. The transform is
    at least twice as long as the record and as the slowest gust, so a record does not close on itself and its own mean varies.
    Gusts quicker than 2 s, or than two steps, are left out; no gust turns the wind.
    """
    if mean == 0:
        return np.zeros(steps)
    size = 2 * max(steps, math.ceil(1 / SLOWEST_GUST / dt))
    frequency = np.fft.rfftfreq(size, dt)
    inside = (frequency >= SLOWEST_GUST) & (frequency <= FASTEST_GUST)
    inside[-1] = False  # at half the sampling rate a coefficient has no phase
    deviation = np.sqrt(gust_spectrum(frequency[inside], mean, height) * frequency[1]) / 2
    modes = np.zeros(len(frequency), complex)
    modes[inside] = deviation * (rng.normal(size=inside.sum()) + 1j * rng.normal(size=inside.sum()))
    return mean + np.fft.irfft(modes, size)[:steps] * size
