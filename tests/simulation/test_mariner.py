"""The Mariner, against the printed coefficients, linear theory, an independent transcription and laws."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from aspnn.guidance.helms import COLUMNS, RUDDER, SHAFT, SURGE, SWAY, YAW_RATE
from aspnn.schema import InputError
from aspnn.simulation.ships.dynamics import accelerations
from aspnn.simulation.ships.mariner import DOMAIN, Mariner
from aspnn.vessel import load_vessel

REFERENCE = Path(__file__).parents[1] / "reference" / "mariner_hy5_1965.toml"
SHIP = Mariner.of(load_vessel("mariner"))


@njit
def rates(model, states, load):
    """Time derivatives (n, 9) of the states (n, 9)."""
    out = np.zeros(states.shape)
    for k in range(len(states)):
        accelerations(model, states[k], load, out[k])
    return out


@njit
def wander(model, orders, shafts, dt, start):
    """States (n, 3) u, v, r under rudder and shaft that follow `orders` and `shafts` at 5 deg/s and 0.04 rev/s2; midpoint rule."""
    x, out, load = np.zeros(9), np.zeros(9), np.zeros(6)
    path = np.empty((len(orders), 3))
    x[3:6], x[7] = start, shafts[0]
    for k in range(len(orders)):
        x[6] += min(max(orders[k] - x[6], -0.0873 * dt), 0.0873 * dt)
        x[7] += min(max(shafts[k] - x[7], -0.04 * dt), 0.04 * dt)
        before = x[3:6].copy()
        accelerations(model, x, load, out)
        x[3:6] = before + 0.5 * dt * out[3:6]
        accelerations(model, x, load, out)
        x[3:6] = before + dt * out[3:6]
        path[k] = x[3:6]
    return path


def state(u=SHIP.U0, v=0.0, r=0.0, rudder=0.0, shaft=SHIP.n0):
    x = np.zeros((1, COLUMNS))
    x[0, [SURGE, SWAY, YAW_RATE, RUDDER, SHAFT]] = u, v, r, rudder, shaft
    return x


def at(load=(0, 0, 0, 0, 0, 0), **where):
    return rates(SHIP, state(**where), np.array(load, float))[0, [SURGE, SWAY, YAW_RATE]]


def test_coefficients_are_the_printed_ones():
    """Oracle: the printed table (tests/reference), every coefficient of it and none beside."""
    printed = tomllib.loads(REFERENCE.read_text())
    coefficients = {name: value for part in printed.values() for name, value in part.items()}
    assert len(coefficients) == 47
    for name, value in coefficients.items():
        assert getattr(SHIP, name) == pytest.approx(value * 1e-5, rel=1e-12), name
    assert set(SHIP._fields) - set(coefficients) == {"rho", "L", "U0", "n0", "xG"}
    assert (SHIP.L, SHIP.U0, SHIP.xG) == (160.93, 7.7175, -0.023)


def jacobian():
    """Of (v', r') by (v, r) and by rudder at the nominal speed, by central differences of the compiled code."""
    step = 1e-6
    columns = [(at(**{name: step}) - at(**{name: -step}))[1:] / (2 * step) for name in ("v", "r", "rudder")]
    return np.column_stack(columns[:2]), columns[2]


def test_linear_theory():
    """Oracle: Nomoto's constants of the class, T 107.3 s and K 0.185 1/s to 0.5 % (paper 000), and its T1, T2, T3.

    From the compiled code's own Jacobian A, b: r / delta = K (1 + T3 s) / ((1 + T1 s)(1 + T2 s)), T = T1 + T2 - T3.
    """
    A, b = jacobian()
    T = np.sort(-1 / np.linalg.eigvals(A).real)[::-1]
    K = -np.linalg.solve(A, b)[1]
    T3 = b[1] / (A[1, 0] * b[0] - A[0, 0] * b[1])
    assert T[0] + T[1] - T3 == pytest.approx(107.3, rel=0.005)
    np.testing.assert_allclose(K, 0.185, rtol=0.005)
    np.testing.assert_allclose([*T, T3], [117.98, 7.763, 18.53], rtol=1e-3)


def test_equals_an_independent_transcription():
    """Oracle: the equations again, term by term from the printed table, with the source's own states (u, delta to port)."""
    c = {k: v * 1e-5 for part in tomllib.loads(REFERENCE.read_text()).values() for k, v in part.items()}
    terms = {  # powers of u, v, r, d
        "u": (1, 0, 0, 0),
        "uu": (2, 0, 0, 0),
        "uuu": (3, 0, 0, 0),
        "v": (0, 1, 0, 0),
        "vv": (0, 2, 0, 0),
        "rr": (0, 0, 2, 0),
        "rv": (0, 1, 1, 0),
        "dd": (0, 0, 0, 2),
        "udd": (1, 0, 0, 2),
        "vd": (0, 1, 0, 1),
        "uvd": (1, 1, 0, 1),
        "r": (0, 0, 1, 0),
        "vvv": (0, 3, 0, 0),
        "vvr": (0, 2, 1, 0),
        "vu": (1, 1, 0, 0),
        "ru": (1, 0, 1, 0),
        "d": (0, 0, 0, 1),
        "ddd": (0, 0, 0, 3),
        "ud": (1, 0, 0, 1),
        "uud": (2, 0, 0, 1),
        "vdd": (0, 1, 0, 2),
        "vvd": (0, 2, 0, 1),
        "0": (0, 0, 0, 0),
        "0u": (1, 0, 0, 0),
        "0uu": (2, 0, 0, 0),
    }
    rng = np.random.default_rng(3)
    for _ in range(200):
        U0, n = 7.7175, rng.uniform(0.7, 1.5)
        nominal = U0 * n / SHIP.n0
        surge, sway, r, delta = (
            nominal * rng.uniform(0.75, 1.2),
            rng.normal(),
            rng.normal() * 0.005,
            rng.uniform(-0.7, 0.7),
        )
        U = math.hypot(surge, sway)
        primes = np.array([(surge - nominal) / U, sway / U, r * 160.93 / U, -delta])
        X, Y, N = (
            sum(
                c[axis + name] * np.prod(primes ** np.array(powers))
                for name, powers in terms.items()
                if axis + name in c
            )
            for axis in "XYN"
        )
        mass = np.array(
            [
                [c["m"] - c["Xudot"], 0, 0],
                [0, c["m"] - c["Yvdot"], c["m"] * -0.023 - c["Yrdot"]],
                [0, c["m"] * -0.023 - c["Nvdot"], c["Iz"] - c["Nrdot"]],
            ]
        )
        expected = np.linalg.solve(mass, [X, Y, N]) * U**2 / 160.93 / [1, 1, 160.93]
        np.testing.assert_allclose(at(u=surge, v=sway, r=r, rudder=delta, shaft=n), expected, rtol=1e-9, atol=1e-12)


def test_load_enters_with_its_mass_and_sign():
    """Law: what a load adds to the accelerations is M^-1 load, M the masses with 1/2 rho L^3 and 1/2 rho L^5 in kg and kg m2."""
    rho, L = SHIP.rho, SHIP.L
    M = (
        0.5
        * rho
        * L**3
        * np.array(
            [
                [SHIP.m - SHIP.Xudot, 0, 0],
                [0, SHIP.m - SHIP.Yvdot, (SHIP.m * SHIP.xG - SHIP.Yrdot) * L],
                [0, (SHIP.m * SHIP.xG - SHIP.Nvdot) * L, (SHIP.Iz - SHIP.Nrdot) * L**2],
            ]
        )
    )
    assert 0.5 * rho * L**3 * SHIP.m == pytest.approx(1025 * 16622, rel=1e-3)  # paper 000: 16,622
    load = np.array([2e5, -3e5, 7e3, 1e4, 2e4, 4e6])
    added = at(load=load, v=0.3, r=0.002, rudder=0.1) - at(v=0.3, r=0.002, rudder=0.1)
    np.testing.assert_allclose(M @ added, load[[0, 1, 5]], rtol=1e-9)


def test_rudder_to_starboard_turns_to_starboard():
    """Convention: our rudder is positive to starboard, the source's to port."""
    assert at(rudder=0.1)[2] > at()[2] > at(rudder=-0.1)[2]


def test_sides_differ_by_the_single_screw_alone():
    """Law: without Y0 and N0 the ship mirrors; with them rudder amidships gives 0.1 of what a degree of rudder gives."""
    mirror = np.array([1, -1, -1])
    terms = ("Y0", "Y0u", "Y0uu", "N0", "N0u", "N0uu")
    symmetric = SHIP._replace(**dict.fromkeys(terms, 0.0))
    one, other = (
        rates(symmetric, state(u=7.0, v=s * 0.5, r=s * 0.004, rudder=s * 0.3), np.zeros(6))[0, [SURGE, SWAY, YAW_RATE]]
        for s in (1, -1)
    )
    np.testing.assert_allclose(one, mirror * other, rtol=1e-12)
    pull, degree = at()[2], (at(rudder=math.radians(1)) - at())[2]
    assert 0.5 < pull / degree < 2.0


def test_straight_at_the_balance():
    """Law: at the balance the surge force vanishes at any speed, and the nominal speed goes with the shaft speed."""
    for speed in (4.0, SHIP.U0, 8.0):
        shaft, pitch = SHIP.balance(speed)
        assert math.isnan(pitch)
        assert at(u=speed, shaft=shaft)[0] == pytest.approx(0, abs=1e-12)
        assert shaft / SHIP.n0 == pytest.approx(speed / SHIP.U0)


def test_forces_are_continuous_at_the_edge_of_the_domain_and_at_rest():
    """Law: the held polynomial joins without a step where u' = -DOMAIN and DOMAIN, and at rest nothing divides by zero."""
    slow, fast = SHIP.U0 / (1 + DOMAIN), SHIP.U0 / (1 - DOMAIN)
    for edge in (slow, fast):
        near = [at(u=edge * (1 + side), v=0.2, r=0.003, rudder=0.2) for side in (1e-7, -1e-7)]
        np.testing.assert_allclose(*near, rtol=1e-5)
    assert at(u=0.0, shaft=0.0) == pytest.approx(0)
    assert np.isfinite(at(u=0.0, r=0.01, shaft=0.0)).all()
    assert at(u=0.0)[0] > 0


@pytest.mark.parametrize("speed", [0.0, 2.0, 4.0, 5.5, 7.7, 10.0, 15.0, 25.0])
def test_sway_and_yaw_stay_damped_outside_the_domain(speed):
    """Law: at any surge speed a sway velocity is opposed by the sway force and a yaw rate by the yaw moment.

    The polynomial itself goes with 1 + u' and would drive the ship instead below half the nominal speed.
    """
    masses = np.array(
        [
            [SHIP.m - SHIP.Yvdot, SHIP.m * SHIP.xG - SHIP.Yrdot],
            [SHIP.m * SHIP.xG - SHIP.Nvdot, SHIP.Iz - SHIP.Nrdot],
        ]
    )

    def force(**where):
        rate = at(u=speed, **where)[1:]
        return masses @ [rate[0], rate[1] * SHIP.L]

    assert (force(v=0.01) - force(v=-0.01))[0] < -1e-9
    assert (force(r=1e-4) - force(r=-1e-4))[1] < -1e-9


def test_random_orders_for_thirty_hours_stay_bounded():
    """Law: 30 h of random rudder and engine orders, from rest: no reversal, no spin, speed within the engine's.

    training/reproduce/campaign.py does 100 h.
    """
    rng = np.random.default_rng(11)
    dt, hold = 1.0, 120
    orders = np.repeat(np.radians(rng.integers(-8, 9, 900) * 5.0), hold)
    shafts = np.repeat(rng.uniform(0.7, 1.54, 225), 4 * hold)
    path = wander(SHIP, orders, shafts, dt, np.zeros(3))
    assert len(path) * dt == 30 * 3600
    moving = path[1200:]
    assert np.isfinite(path).all()
    assert moving[:, 0].min() > 0.3 * SHIP.U0
    assert path[:, 0].max() < 1.15 * SHIP.U0
    assert np.abs(path[:, 1]).max() < 2.5
    assert np.abs(path[:, 2]).max() < math.radians(1.5)


def test_speed_nothing_drives_dies_away():
    """Law: with the shaft stopped the speed falls all the way, in whichever motion it starts."""
    for u, v, r in ((7.7, 0.0, 0.0), (7.0, -1.0, 0.01), (3.0, 0.5, -0.01)):
        path = wander(SHIP, np.zeros(20000), np.zeros(20000), 0.5, np.array([u, v, r]))
        speed = np.hypot(path[:, 0], path[:, 1])
        assert speed[-1] < 0.2 * math.hypot(u, v)
        assert speed.max() <= math.hypot(u, v) * (1 + 1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"Yv": -11.6}, "mariner.Yv"),
        ({"Nrdott": -1.0}, "did you mean Nrdot"),
        ({"L": "long"}, "mariner.L"),
        ({"m": -0.00798}, "mariner.m"),
    ],
)
def test_wrong_coefficients_are_told(change, words):
    """Bad input: one line that names the vessel and the coefficient."""
    vessel = load_vessel("mariner")
    wrong = replace(vessel, simulator={"mariner": vessel.simulator["mariner"] | change})
    with pytest.raises(InputError, match=words) as told:
        Mariner.of(wrong)
    assert "\n" not in str(told.value)
