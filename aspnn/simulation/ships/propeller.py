"""A propeller in four quadrants, of fixed or controllable pitch: thrust, the side force of a backing propeller, the rudder's flow.

Ahead (shaft and flow ahead) the ship's own polynomial holds, K_T = k0 + k1 J + k2 J^2; of a controllable pitch, one for every
pitch ratio of a table. The other quadrants have the shape of the Wageningen B4-70 propellers (module wageningen) at the same
pitch ratio, scaled to the own polynomial where they meet it. Assumed, as no measurement was found:
- a blade turned to astern pitch works as a propeller of that pitch turning backwards (the mirror image in a plane through the
  shaft; the same camber, leading and trailing edge exchanged): T(-P, n, V) = T(P, -n, V);
- at no pitch there is no thrust without flow, and the flow drags as it does at the table's smallest pitch;
- between the smallest measured pitch and none, and between table rows, thrust goes by cubics over the pitch ratio.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.interpolate import CubicHermiteSpline

from aspnn.schema import InputError
from aspnn.simulation.ships.coefficients import coefficients
from aspnn.simulation.ships.dynamics import UNCOUNTED
from aspnn.simulation.ships.wageningen import PITCH_RATIOS, thrust_coefficient
from aspnn.vessel import Vessel

BLADE = 0.7 * math.pi  # the blade at 0.7 of the radius moves at BLADE n D
CELLS = 30  # of the thrust curve, between no flow and a stopped shaft
SLIP = 0.06  # pitch ratio below the advance ratio of no thrust: B4 propellers 0.05 to 0.10 (assumed for others)
# k0, k1, k2 of a blade without pitch where there is no table: k1 and k2 of Wageningen B4-55 at pitch ratio 0.3 (assumed).
FLAT = (0.0, -0.2706, -0.1438)

# A backing propeller's side force and moment: Esso Osaka, 3 m model (see `lateral`).
TURNS = (-0.35, -0.06)
A = (-7.90e-5, 7.99e-3, -4.93e-3, -5.87e-3, -5.58e-4)
B = (3.50e-5, -3.17e-3, 1.96e-3, 2.33e-3, 2.25e-4)
PER_BOLLARD = 3.0 * 0.20114 / (2 * 0.084**2) / 0.3278  # L d / (2 D^2 k0) of that model

Row = tuple[float, float, float]


class Propeller(NamedTuple):
    """A propeller's coefficients; a tuple, so that compiled code can take it.

    `curves` (pitch ratios, 2 CELLS, 4, 4): powers of w by powers of the pitch ratio above `ratios`, of the reduced thrust
    T / (rho D^2 (|V| + BLADE n D)^2), n >= 0, whose argument is w = V / (|V| + BLADE n D) from -1 to 1.
    """

    D: float  # m
    Lpp: float  # m, of the ship
    k0: float  # at the service pitch
    k1: float
    k2: float
    service: float  # pitch over diameter
    controllable: bool
    hand: float  # 1 right-handed (clockwise from astern when ahead), -1 left-handed
    ratios: np.ndarray  # pitch over diameter, rising
    curves: np.ndarray

    @staticmethod
    def of(vessel: Vessel) -> "Propeller":
        """The propeller of a vessel file: `D_P`, `Lpp`, `k0`, `k1`, `k2` of section `mmg`, and section `propeller`.

        `propeller.pitch_ratio` is the pitch over diameter that k0, k1, k2 hold for (0.5 to 1.4; left out, the advance ratio of no
        thrust less 0.06), `propeller.hand` 1 or -1 (left out: right-handed). `propeller.table`, of a controllable pitch, maps
        pitch ratios (at least three, up to 1.4) to [k0, k1, k2]. Raises InputError naming the vessel and the key.
        """
        D, Lpp, k0, k1, k2 = (_number(vessel, name) for name in ("D_P", "Lpp", "k0", "k1", "k2"))
        data = dict(vessel.simulator.get("propeller", {}))
        table = data.pop("table", None)
        root = (-k1 - math.sqrt(max(k1 * k1 - 4 * k0 * k2, 0.0))) / (2 * k2) if k2 else -k0 / k1 if k1 else 1.0
        bounds = {"pitch_ratio": (min(PITCH_RATIOS), max(PITCH_RATIOS)), "hand": (-1.0, 1.0)}
        default = {"pitch_ratio": min(max(root - SLIP, 0.5), 1.4), "hand": 1.0}
        known = coefficients(
            replace(vessel, simulator=vessel.simulator | {"propeller": data}), "propeller", bounds, default
        )
        if known["hand"] not in (-1.0, 1.0):
            raise InputError(
                f"{vessel.label}: propeller.hand = {known['hand']:g} must be 1 (right-handed) or -1 (left-handed)"
            )
        service, own = known["pitch_ratio"], (k0, k1, k2)
        if table is None:
            ratios = np.array([-service, service])
            reduced = np.array([_backing(service, own, FLAT), _ahead(service, own, FLAT)])
            curves = np.zeros((2, 2 * CELLS, 4, 4))
            curves[..., 0] = _along_w(reduced)
        else:
            rows = _rows(vessel.label, table, service, own)
            flat = (0.0, *rows[min(rows)][1:])
            ratios = np.array([*(-ratio for ratio in reversed(rows)), 0.0, *rows])
            reduced = np.array(
                [
                    *(_backing(ratio, row, flat) for ratio, row in reversed(rows.items())),
                    _ahead(0.0, flat, flat),
                    *(_ahead(ratio, row, flat) for ratio, row in rows.items()),
                ]
            )
            pieces = _along_w(reduced)
            curves = np.zeros((*pieces.shape, 4))
            curves[:-1] = np.moveaxis(_hermite(ratios, pieces).c[::-1], 0, -1)
            curves[-1, ..., 0] = pieces[-1]
        return Propeller(D, Lpp, *own, service, table is not None, known["hand"], ratios, curves)


def _number(vessel: Vessel, name: str) -> float:
    value = vessel.simulator.get("mmg", {}).get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{vessel.label}: mmg.{name} is missing or not a number")
    if name in ("D_P", "Lpp", "k0") and value <= 0:
        raise InputError(f"{vessel.label}: mmg.{name} = {value:g} must be positive")
    if name == "k2" and value > 0:
        raise InputError(f"{vessel.label}: mmg.k2 = {value:g} must not be positive; a stopped propeller would push")
    return float(value)


def _rows(vessel: str, table: object, service: float, own: Row) -> dict[float, Row]:
    """The rows of a pitch table by rising pitch ratio, with the service pitch among them. Raises InputError."""
    if not isinstance(table, dict) or len(table) < 3:
        raise InputError(f"{vessel}: propeller.table must map at least three pitch ratios to [k0, k1, k2]")
    rows = {}
    for key, value in table.items():
        try:
            ratio, row = float(key), tuple(float(number) for number in value)
        except (TypeError, ValueError):
            raise InputError(f"{vessel}: propeller.table {key} must be a pitch ratio with [k0, k1, k2]") from None
        if len(row) != 3 or not all(math.isfinite(number) for number in row) or row[0] <= 0 or row[2] > 0:
            raise InputError(f"{vessel}: propeller.table {key} needs three numbers [k0 > 0, k1, k2 <= 0]")
        if not 0.1 <= ratio <= max(PITCH_RATIOS):
            raise InputError(f"{vessel}: propeller.table {key} is outside 0.1 to {max(PITCH_RATIOS):g}")
        rows[ratio] = row
    rows = dict(sorted(rows.items()))
    if not min(rows) <= service <= max(rows):
        raise InputError(
            f"{vessel}: propeller.pitch_ratio = {service:g} is outside propeller.table, {min(rows):g} to {max(rows):g}"
        )
    near = _hermite(np.array(list(rows)), np.array(list(rows.values())))(service)
    if np.abs(near - own).max() > 0.03:
        raise InputError(
            f"{vessel}: propeller.table gives K_T = {near[0]:.3f} {near[1]:+.3f} J {near[2]:+.3f} J^2 at"
            f" propeller.pitch_ratio = {service:g}, not mmg.k0, k1, k2 = {own[0]:.3f}, {own[1]:.3f}, {own[2]:.3f}"
        )
    return dict(sorted((rows | {service: own}).items()))


def _hermite(x: np.ndarray, y: np.ndarray) -> CubicHermiteSpline:
    """Cubics through `y` (n, ...) at `x` (n,), with the slopes of parabolas through three neighbours: linear in y, exact for parabolas."""
    return CubicHermiteSpline(x, y, np.gradient(y, x, axis=0, edge_order=2))


def _along_w(reduced: np.ndarray) -> np.ndarray:
    """Cubics (rows, 2 CELLS, 4), lowest power first, of reduced thrusts (rows, 2, CELLS + 1); the two directions of flow apart."""
    w = np.linspace(0.0, 1.0, CELLS + 1)
    halves = [_hermite(w, half).c[::-1] for half in np.moveaxis(reduced, 0, -1)]
    return np.concatenate(halves, axis=1).transpose(2, 1, 0)


def _measured(ratio: float, beta: np.ndarray, flat: Row) -> np.ndarray:
    """pi / 8 C_T* of Wageningen B4-70 at pitch `ratio` and `beta` (n,); below its smallest pitch towards `flat` at no pitch."""
    s, c = np.sin(beta), np.cos(beta)
    none = np.sign(s) * (flat[1] * np.abs(c * s) / BLADE + flat[2] * s * s)
    rows = np.concatenate([none[None], math.pi / 8 * thrust_coefficient(beta)])
    return _hermite(np.array([0.0, *PITCH_RATIOS]), rows)(ratio)


def _ahead(ratio: float, row: Row, flat: Row) -> np.ndarray:
    """Reduced thrust (2, CELLS + 1) at w from -1 to 0 and from 0 to 1 of a propeller turning ahead.

    Flow from ahead: k0 a^2 + k1 a w + k2 w^2, a = (1 - w) / BLADE. Flow from astern: the measured curve, times 1 + (f - 1)
    cos^4 beta, where f is k0 over the measured K_T(0).
    """
    w = np.linspace(0.0, 1.0, CELLS + 1)
    a = (1 - w) / BLADE
    forward = row[0] * a * a + row[1] * a * w + row[2] * w * w
    if ratio == 0:
        return np.array([-forward[::-1], forward])
    return np.array([_other(ratio, row, flat, -w, 1 - w)[::-1], forward])


def _backing(ratio: float, row: Row, flat: Row) -> np.ndarray:
    """Reduced thrust like `_ahead` of a propeller whose blades are turned astern, as of one of pitch `ratio` turning backwards.

    The measured curve, times 1 + (f - 1) cos^4 beta as in `_ahead`; with the flow from ahead plus (g - 1) sin^4 beta, where g
    makes the drag of the stopped propeller that of the own polynomial, k2 V^2.
    """
    w = np.linspace(0.0, 1.0, CELLS + 1)
    return np.array([_other(ratio, row, flat, -w, w - 1)[::-1], _other(ratio, row, flat, w, w - 1)])


def _other(ratio: float, row: Row, flat: Row, w: np.ndarray, blade: np.ndarray) -> np.ndarray:
    """Reduced thrust (n,) of the quadrants without an own polynomial, at flow `w` and blade speed `blade`, |w| + |blade| = 1."""
    square = w * w + blade * blade
    bollard, stopped = _measured(ratio, np.array([0.0, math.pi / 2]), flat)
    factor = 1 + (row[0] / (BLADE**2 * bollard) - 1) * (blade * blade / square) ** 2
    factor += np.where(w > 0, (row[2] / stopped - 1) * (w * w / square) ** 2, 0.0)
    return factor * _measured(ratio, np.arctan2(w, blade), flat) * square


@njit(cache=True, nogil=True, error_model="numpy", **UNCOUNTED)
def _curve(p, n, inflow, pitch):
    """T / (rho D^2) of a shaft that does not turn backwards, from the curves; pitch ratios beyond them are held at their end."""
    blade = BLADE * n * p.D
    speed = abs(inflow) + blade
    if speed == 0:
        return 0.0
    pitch = min(max(pitch, p.ratios[0]), p.ratios[-1])
    i = len(p.ratios) - 1
    while p.ratios[i] > pitch:
        i -= 1
    w = inflow / speed
    j = min(int((w + 1) * CELLS), 2 * CELLS - 1)
    x, z = pitch - p.ratios[i], w + 1 - j / CELLS
    reduced = 0.0
    for power in range(3, -1, -1):
        c = p.curves[i, j, power]
        reduced = reduced * z + ((c[3] * x + c[2]) * x + c[1]) * x + c[0]
    return reduced * speed * speed


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, **UNCOUNTED)
def thrust(p, n, inflow, pitch):
    """T / (rho D^2) [m2/s2] at shaft speed n [rev/s], flow u_P into the propeller [m/s] and pitch ratio, of either sign each.

    k0 n^2 D^2 + k1 n D u_P + k2 u_P^2 at the service pitch, shaft and flow ahead; else from the curves. `pitch` is not looked at
    where it is fixed, and NaN is the service pitch. Continuous everywhere.
    """
    if not p.controllable or pitch != pitch:
        pitch = p.service
    if n > 0 and inflow >= 0 and pitch == p.service:
        return (p.k0 * n * n * p.D + p.k1 * n * inflow) * p.D + p.k2 * inflow * inflow
    if n < 0:
        return _curve(p, -n, inflow, -pitch)
    return _curve(p, n, inflow, pitch)


@njit(cache=True, nogil=True, error_model="numpy", **UNCOUNTED)
def lateral(p, n, u, pitch):
    """(Y / (rho D^2) [m2/s2], N / (rho D^2) [m3/s2] about midship) that a propeller working astern puts on the stern.

    The Esso Osaka's 3 m model (right-handed; the reversing model of Hachii as used by Miyauchi et al. 2022, coefficients from
    Osaka University's public simulator), with J_s = u / (n D) of the ship's speed u:
    Y = 1/2 rho L d (n D)^2 (A1 + A2 J_s), A3 + A4 J_s where J_s < -0.35, A5 where J_s > -0.06; N = 1/2 rho L^2 d (n D)^2 (B...).
    A right-handed propeller backing carries the stern to port and the bow to starboard. Assumed: for other ships both
    go with the own bollard thrust K_T(0); they end where A3 + A4 J_s and B3 + B4 J_s change sign, at J_s = -0.84, beyond the
    measurements; blades turned astern work as a propeller of the other hand turning backwards; working ahead there is none.
    """
    if not p.controllable or pitch != pitch:
        pitch = p.service
    backing, hand = (n, p.hand) if pitch >= 0 else (-n, -p.hand)
    if backing >= 0:
        return 0.0, 0.0
    advance = u / (backing * p.D)
    if advance < TURNS[0]:
        Y, N = min(A[2] + A[3] * advance, 0.0), max(B[2] + B[3] * advance, 0.0)
    elif advance > TURNS[1]:
        Y, N = A[4], B[4]
    else:
        Y, N = A[0] + A[1] * advance, B[0] + B[1] * advance
    unit = hand * PER_BOLLARD * thrust(p, -backing, 0.0, abs(pitch))
    return unit * Y, unit * p.Lpp * N


@njit(cache=True, nogil=True, error_model="numpy")
def rudder_flow(inflow, loading, eta, kappa):
    """Flow along the ship at the rudder, u_R / epsilon [m/s], of a propeller with T / (rho D^2) = `loading`; `eta` = D_P / H_R.

    Thrust ahead: the race of Yasukawa & Yoshimura (2015), u_P + kappa (sqrt(u_P^2 + 8 T / (pi rho D^2)) - u_P) on eta of the
    rudder, u_P on the rest; squares are added. Thrust astern draws water away from the rudder: the increase turns round and
    halves, as in Kitagawa's model in the same simulator of the Esso Osaka (k_x 0.288 ahead, 0.144 astern). Squares keep their
    signs, so that a rudder in water that flows forward steers the other way. Assumed: u_P stands in the root astern too (0
    there and ahead where it is negative), and that model's further loss, 0.176 u^2, is left out; both keep the flow continuous.
    """
    base = max(inflow, 0.0)
    race = math.sqrt(base * base + 8 / math.pi * abs(loading)) - base
    inside = inflow + (kappa * race if loading >= 0 else -0.5 * kappa * race)
    square = eta * inside * abs(inside) + (1 - eta) * inflow * abs(inflow)
    return math.copysign(math.sqrt(abs(square)), square)
