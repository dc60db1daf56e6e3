"""Nomoto's constants and the tightest turn of ships, against published constants and against simulated steps of the rudder."""

import numpy as np
import pytest
from scipy.linalg import expm

from aspnn.guidance import helms
from aspnn.simulation.nomoto import linearised, nomoto, turning_radius
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import run_on
from aspnn.vessel import load_vessel


@pytest.fixture(scope="module")
def mariner():
    return Ship.of(load_vessel("mariner"))


def test_mariner_has_the_published_constants(mariner):
    """Oracle: K 0.185 1/s and T 107.3 s of paper 000; by the linear terms of its model T1 117.98, T2 7.76, T3 18.53 s and T 107.21 s."""
    found = nomoto(mariner)
    np.testing.assert_allclose(found, [0.185, 107.3], rtol=2e-3)
    times = np.sort(-1 / np.linalg.eigvals(linearised(mariner)[0]).real)
    np.testing.assert_allclose(times, [7.76, 117.98], atol=0.02)
    assert sum(times) - found.T == pytest.approx(18.53, abs=0.02)


@pytest.mark.parametrize("name, speed", [("mariner", None), ("mariner", 5.0), ("cargo90", 5.0)])
def test_linear_motion_is_that_of_a_small_step(name, speed):
    """Oracle: the simulated answer to 0.01 degree of rudder, half the difference of both sides, against the matrix exponential."""
    ship, delta, dt, steps = Ship.of(load_vessel(name)), np.radians(0.01), 0.25, 160
    A, B = linearised(ship, speed)
    start = np.repeat(ship.start(0, 0, 0, ship.service_speed if speed is None else speed), 2, axis=0)
    start[:, helms.RUDDER] = delta, -delta
    one, other = run_on(ship, start, start[:, helms.RUDDER, None].repeat(steps, axis=1), dt=dt)
    found = ((one - other) / 2)[:, [helms.SWAY, helms.YAW_RATE]]
    held = np.block([[A, B[:, None]], [np.zeros((1, 3))]])
    step = expm(held * dt)
    exact, x = [], np.array([0.0, 0.0, delta])
    for _ in range(steps + 1):
        exact.append(x[:2])
        x = step @ x
    np.testing.assert_allclose(found / exact[-1], exact / exact[-1], atol=0.01)


def test_constants_are_the_moments_of_the_answer(mariner):
    """Oracle: a unit step of the linear motion, summed up: it ends at K, and the area above it is K T (trapezoids of 0.1 s)."""
    A, B = linearised(mariner)
    dt = 0.1
    step, x, r = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * dt), np.array([0.0, 0.0, 1.0]), []
    for _ in range(20000):
        r.append(x[1])
        x = step @ x
    found = nomoto(mariner)
    assert r[-1] == pytest.approx(found.K, rel=1e-6)
    assert np.trapezoid(r[-1] - np.array(r), dx=dt) == pytest.approx(found.K * found.T, rel=1e-5)


def test_radius_is_that_of_the_track(mariner):
    """Oracle: places half a steady turn apart are two radii apart; the wider of the two sides counts."""
    found, order, dt = turning_radius(mariner), mariner.rudder.most, 0.5
    start = np.repeat(mariner.start(0, 0, 0, mariner.service_speed), 2, axis=0)
    across = []
    for path in run_on(mariner, start, np.repeat([[order], [-order]], 3000, axis=1), dt=dt):
        north, east, heading = (path[:, column] for column in (helms.NORTH, helms.EAST, helms.HEADING))
        last = np.argmax(np.abs(heading) > np.abs(heading[-1]) - np.pi)
        across.append(np.hypot(north[-1] - north[last], east[-1] - east[last]))
    assert found == pytest.approx(max(across) / 2, rel=0.01)
    assert turning_radius(mariner, rudder=np.radians(10)) > 1.3 * found
