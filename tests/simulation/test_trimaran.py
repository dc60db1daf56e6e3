"""The trimaran of paper 003, against its own figures, the analytic stability limit and laws."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from aspnn.guidance.helms import COLUMNS, RUDDER, SHAFT, SURGE, SWAY, YAW_RATE
from aspnn.schema import InputError
from aspnn.simulation.ships.dynamics import accelerations
from aspnn.simulation.ships.trimaran import Trimaran
from aspnn.vessel import load_vessel

VESSEL = load_vessel("trimaran")
BOAT = Trimaran.of(VESSEL)


@njit
def rates(model, x, load):
    out = np.zeros(x.size)
    accelerations(model, x, load, out)
    return out[3:6]


@njit
def wander(model, orders, shafts, dt, start):
    """Velocities (n, 3) under lever orders held over each step of dt; midpoint rule."""
    x, out, load = np.zeros(9), np.zeros(9), np.zeros(6)
    path = np.empty((len(orders), 3))
    x[3:6] = start
    for k in range(len(orders)):
        x[6], x[7] = orders[k], shafts[k]
        before = x[3:6].copy()
        accelerations(model, x, load, out)
        x[3:6] = before + 0.5 * dt * out[3:6]
        accelerations(model, x, load, out)
        x[3:6] = before + dt * out[3:6]
        path[k] = x[3:6]
    return path


def at(model=BOAT, load=(0, 0, 0, 0, 0, 0), u=0.0, v=0.0, r=0.0, rudder=0.0, shaft=0.0):
    x = np.zeros(COLUMNS)
    x[[SURGE, SWAY, YAW_RATE, RUDDER, SHAFT]] = u, v, r, rudder, shaft
    return rates(model, x, np.array(load, float))


def fastest_growth(speed):
    """Largest real part of the eigenvalues of the compiled code's Jacobian on a straight course [1/s]."""
    step, shaft = 1e-5, BOAT.balance(speed)[0]
    columns = []
    for name in ("u", "v", "r"):
        ends = []
        for side in (1, -1):
            where = {"u": speed, "v": 0.0, "r": 0.0}
            where[name] += side * step
            ends.append(at(**where, shaft=shaft))
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.linalg.eigvals(np.column_stack(columns)).real.max()


def test_unstable_above_its_speed():
    """Analytic: a straight course is unstable above sqrt(d22 d33 / (m11 (m22 - m11))) = sqrt(1/2) m/s.

    At 1 m/s it grows at the positive root of (s + d22/m22) (s + d33/m33) = m11 (m22 - m11) / (m22 m33) = 1/2, 0.20 1/s.
    """
    low, high = 0.1, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fastest_growth(middle) < 0 else (low, middle)
    assert low == pytest.approx(math.sqrt(0.5), abs=1e-6)
    assert fastest_growth(1.0) == pytest.approx(np.roots([1, 0.4 + 0.625, 0.4 * 0.625 - 0.5]).max(), abs=1e-6)


def test_reference_motion_of_the_paper():
    """Oracle: the paper's reference u 1 m/s, v -0.1 m/s, r 0.05 rad/s is steady, with tau_1 = 71.25 N and tau_3 = -2.5 N m."""
    shaft, rudder = 71.25 / 35.0, -2.5 / 20.0 * VESSEL.rudder_max
    np.testing.assert_allclose(at(u=1.0, v=-0.1, r=0.05, rudder=rudder, shaft=shaft), 0, atol=1e-12)


def test_lever_hard_over_is_the_full_moment():
    """Convention: full lever gives the moment of the vessel file, to starboard, and a shaft's revolution its thrust."""
    assert at(rudder=VESSEL.rudder_max)[2] == pytest.approx(20.0 / 80.0)
    assert at(shaft=2.0)[0] == pytest.approx(70.0 / 200.0)
    assert BOAT.balance(1.0)[0] == 2.0


def test_load_is_force_over_mass():
    """Law: a load adds X / m11, Y / m22, N / m33."""
    added = at(load=[100, 50, 9, 9, 9, 8], u=0.5, v=0.1, r=0.2) - at(u=0.5, v=0.1, r=0.2)
    np.testing.assert_allclose(added, [0.5, 0.2, 0.1])


def test_energy_falls_by_what_the_damping_takes():
    """Law: d/dt (m11 u^2 + m22 v^2 + m33 r^2) / 2 = -d11 u^2 - d22 v^2 - d33 r^2; the Coriolis terms do no work. So it is bounded."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        u, v, r = rng.normal(size=3)
        power = np.dot(at(u=u, v=v, r=r), [200 * u, 250 * v, 80 * r])
        assert power == pytest.approx(-(70 * u * u + 100 * v * v + 50 * r * r), rel=1e-10)


def test_random_levers_for_thirty_hours_stay_bounded():
    """Law: by the energy above |velocities| stay below what full levers hold against the damping, 30 h of random orders."""
    rng = np.random.default_rng(2)
    dt, hold = 0.2, 300
    orders = np.repeat(np.radians(rng.integers(-7, 8, 1800) * 5.0), hold)
    shafts = np.repeat(rng.uniform(-1.4, 2.4, 1800), hold)
    path = wander(BOAT, orders, shafts, dt, np.zeros(3))
    assert len(path) * dt == pytest.approx(30 * 3600)
    energy = path**2 @ [100.0, 125.0, 40.0]
    u, r = 84.0 / 70.0, 20.0 / 50.0  # the most each lever can hold alone
    assert energy.max() < 100 * u**2 + 125 * u**2 + 40 * r**2
    assert np.abs(path).max() < 2.0


def test_without_a_controller_it_spins():
    """Oracle: 1 m/s and a touch of yaw end, with tau_3 = 0, in the spin the facts tell, a steady 0.24 rad/s."""
    shafts = np.full(3000, 71.25 / 35.0)
    path = wander(BOAT, np.zeros(3000), shafts, 0.1, np.array([1.0, 0.0, 0.001]))
    assert path[-1, 2] == pytest.approx(0.24, abs=0.01)
    np.testing.assert_allclose(path[-1], path[-500], atol=1e-4)
    assert path[-1, 0] == pytest.approx(math.sqrt(0.5), abs=1e-3)  # there yaw neither grows nor dies


def test_mass_may_vary_along_a_voyage():
    """The paper's sinusoidal m11, as `_replace` between steps, against the same equation integrated here with m11(t)."""

    def mass(t):
        return 200.0 + 20.0 * math.sin(2 * math.pi * t / 10.0)

    dt, x, y = 0.01, np.array([0.8, -0.05, 0.03]), np.array([0.8, -0.05, 0.03])
    for k in range(1000):
        m = mass(k * dt)
        x = wander(BOAT._replace(m11=m), np.zeros(1), np.full(1, 2.0), dt, x)[0]
        half = None
        for h in (0.5 * dt, dt):
            u, v, r = y if half is None else half
            slope = np.array(
                [(250 * v * r - 70 * u + 70) / m, (-m * u * r - 100 * v) / 250, ((m - 250) * u * v - 50 * r) / 80]
            )
            half = y + h * slope
        y = half
    np.testing.assert_allclose(x, y, rtol=1e-9)
    constant = wander(BOAT, np.zeros(1000), np.full(1000, 2.0), dt, np.array([0.8, -0.05, 0.03]))[-1]
    assert np.abs(constant - y).max() > 1e-4


@pytest.mark.parametrize(
    ("change", "words"),
    [({"m11": 0.0}, "trimaran.m11"), ({"d_33": 1.0}, "did you mean d33"), ({"thrust": None}, "thrust")],
)
def test_wrong_coefficients_are_told(change, words):
    """Bad input: one line that names the vessel and the coefficient."""
    wrong = replace(VESSEL, simulator={"trimaran": VESSEL.simulator["trimaran"] | change})
    with pytest.raises(InputError, match=words) as told:
        Trimaran.of(wrong)
    assert "\n" not in str(told.value)
