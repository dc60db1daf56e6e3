"""Calm-water resistance of a displacement ship from its main dimensions.

J. Holtrop and G. G. J. Mennen, "An approximate power prediction method", International Shipbuilding Progress 29 (1982)
166-170: a hull without bulb, transom immersion and appendages, up to a Froude number of 0.4. Midship and waterplane coefficients and
the centre of buoyancy come, unless told, from design formulas (see `Form.of`).
"""

import math
from typing import NamedTuple

GRAVITY = 9.81  # m/s2
VISCOSITY = 1.19e-6  # m2/s, sea water at 15 degrees Celsius


class Form(NamedTuple):
    """A hull for Holtrop's formulas: length in the waterline L, beam B, draught T [m], volume [m3], lcb in percent of L forward of L/2."""

    L: float
    B: float
    T: float
    volume: float
    C_M: float
    C_WP: float
    lcb: float
    stern: float = 0.0  # 10 for U-shaped sections, -10 for V

    @property
    def C_B(self) -> float:
        return self.volume / (self.L * self.B * self.T)

    @property
    def C_P(self) -> float:
        return self.C_B / self.C_M

    @property
    def run(self) -> float:
        """Length of run L_R [m]."""
        return self.L * (1 - self.C_P + 0.06 * self.C_P * self.lcb / (4 * self.C_P - 1))

    @staticmethod
    def of(L: float, B: float, T: float, C_B: float) -> "Form":
        """A hull of which no more is known: C_M = 1.006 - 0.0056 C_B^-3.56 (Kerlen), C_WP = (1 + 2 C_B) / 3 (Schneekluth),
        lcb = -13.5 + 19.4 C_P (Guldhammer and Harvald); all three recalled."""
        C_M = 1.006 - 0.0056 * C_B**-3.56
        return Form(L, B, T, C_B * L * B * T, C_M, (1 + 2 * C_B) / 3, -13.5 + 19.4 * C_B / C_M)


def wetted_surface(f: Form) -> float:
    """S = L (2 T + B) sqrt(C_M) (0.453 + 0.4425 C_B - 0.2862 C_M - 0.003467 B / T + 0.3696 C_WP) [m2], without bulb."""
    shape = 0.453 + 0.4425 * f.C_B - 0.2862 * f.C_M - 0.003467 * f.B / f.T + 0.3696 * f.C_WP
    return f.L * (2 * f.T + f.B) * math.sqrt(f.C_M) * shape


def form_factor(f: Form) -> float:
    """1 + k1 = c13 (0.93 + c12 (B / L_R)^0.92497 (0.95 - C_P)^-0.521448 (1 - C_P + 0.0225 lcb)^0.6906)."""
    ratio = f.T / f.L
    c12 = ratio**0.2228446 if ratio > 0.05 else 48.20 * max(ratio - 0.02, 0.0) ** 2.078 + 0.479948
    slim = (f.B / f.run) ** 0.92497 * (0.95 - f.C_P) ** -0.521448 * (1 - f.C_P + 0.0225 * f.lcb) ** 0.6906
    return (1 + 0.003 * f.stern) * (0.93 + c12 * slim)


def friction(f: Form, speed: float) -> float:
    """C_F = 0.075 / (log10 Re - 2)^2, the line of ITTC 1957."""
    return 0.075 / (math.log10(speed * f.L / VISCOSITY) - 2) ** 2


def allowance(f: Form) -> float:
    """C_A = 0.006 (L + 100)^-0.16 - 0.00205 + 0.003 sqrt(L / 7.5) C_B^4 (0.04 - c4), c4 = min(T / L, 0.04): the hull's roughness."""
    c4 = min(f.T / f.L, 0.04)
    return 0.006 * (f.L + 100) ** -0.16 - 0.00205 + 0.003 * math.sqrt(f.L / 7.5) * f.C_B**4 * (0.04 - c4)


def entrance(f: Form) -> float:
    """Half the angle of the waterline at the bow [deg], Holtrop's regression."""
    power = (f.L / f.B) ** 0.80856 * (1 - f.C_WP) ** 0.30484 * (1 - f.C_P - 0.0225 * f.lcb) ** 0.6367
    return 1 + 89 * math.exp(-power * (f.run / f.B) ** 0.34574 * (100 * f.volume / f.L**3) ** 0.16302)


def waves(f: Form, speed: float, rho: float) -> float:
    """R_W = c1 volume rho g exp(m1 F^-0.9 + m2 cos(lambda F^-2)) [N], F the Froude number."""
    F, slender = speed / math.sqrt(GRAVITY * f.L), f.B / f.L
    c7 = 0.229577 * slender**0.33333 if slender < 0.11 else slender if slender < 0.25 else 0.5 - 0.0625 / slender
    c1 = 2223105 * c7**3.78613 * (f.T / f.B) ** 1.07961 * (90 - entrance(f)) ** -1.37565
    thin = f.L**3 / f.volume
    c15 = -1.69385 if thin < 512 else 0.0 if thin > 1727 else -1.69385 + (thin ** (1 / 3) - 8) / 2.36
    C_P = f.C_P
    c16 = 8.07981 * C_P - 13.8673 * C_P**2 + 6.984388 * C_P**3 if C_P < 0.8 else 1.73014 - 0.7067 * C_P
    m1 = 0.0140407 * f.L / f.T - 1.75254 * thin ** (-1 / 3) - 4.79323 * slender - c16
    m2 = c15 * C_P**2 * math.exp(-0.1 / F**2)
    angle = 1.446 * C_P - (0.03 / slender if slender > 1 / 12 else 0.36)
    return c1 * f.volume * rho * GRAVITY * math.exp(m1 * F**-0.9 + m2 * math.cos(angle / F**2))


def resistance(f: Form, speed: float, rho: float) -> float:
    """R = 1/2 rho S U^2 ((1 + k1) C_F + C_A) + R_W [N] at `speed` U [m/s]."""
    viscous = form_factor(f) * friction(f, speed) + allowance(f)
    return 0.5 * rho * wetted_surface(f) * speed**2 * viscous + waves(f, speed, rho)
