"""Current fields: against finite differences, the law of continuity and the correlation they are drawn for."""

import math

import numpy as np
import pytest

from aspnn.simulation import Sea, Ship, simulate
from aspnn.simulation.environment.current import current_at, draw_eddies, shear_at, stream
from aspnn.vessel import load_vessel

MEAN = np.array([0.4, -0.3])


def eddies(seed=0):
    return draw_eddies(np.random.default_rng(seed), 0.5, 400.0, 900.0)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (850.0, -1300.0, 420.0), (-2.3e4, 9e3, 7200.0)])
def test_shear_is_the_gradient_of_the_current(place):
    """Oracle: central differences of current_at over 1 m, whose own error is |k|^3 a / 6, under 1e-8 1/s; the divergence is zero."""
    north, east, time = place
    field = eddies()

    def at(dn, de):
        return np.array(current_at(MEAN, field, north + dn, east + de, time))

    along, across = (at(1, 0) - at(-1, 0)) / 2, (at(0, 1) - at(0, -1)) / 2
    nn, ne, en, ee = shear_at(field, north, east, time)
    np.testing.assert_allclose([nn, en], along, atol=1e-8)
    np.testing.assert_allclose([ne, ee], across, atol=1e-8)
    assert abs(nn) > 1e-5
    assert nn + ee == 0


def test_one_mode_is_its_formula():
    """Oracle: the plane wave a (-k_e, k_n) / |k| cos(k . x - omega t + phase), written out; no rows leave the steady current."""
    mode = np.array([[0.7, 3e-3, -4e-3, 1e-3, 0.2]])
    c = 0.7 * math.cos(3e-3 * 250 - 4e-3 * 90 - 1e-3 * 1800 + 0.2)
    np.testing.assert_allclose(current_at(MEAN, mode, 250.0, 90.0, 1800.0), MEAN + np.array([0.8, 0.6]) * c, rtol=1e-11)
    assert current_at(MEAN, np.empty((0, 5)), 1.0, 2.0, 3.0) == (0.4, -0.3)
    assert shear_at(np.empty((0, 5)), 1.0, 2.0, 3.0) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("apart, later", [(0.0, 0.0), (400.0, 0.0), (0.0, 900.0), (300.0, 600.0)])
def test_speed_and_correlation_are_those_drawn_for(apart, later):
    """Oracle: E[v(x, t) . v(x + r, t + tau)] = speed^2 exp(-r^2 / 2 l^2 - tau^2 / 2 T^2), in any direction of r; mean over 4000
    fields within 4 standard errors, taken from the fields themselves.
    """
    rng, zero = np.random.default_rng(1), np.zeros(2)
    products = []
    for _ in range(4000):
        field, course = draw_eddies(rng, 0.5, 400.0, 900.0), rng.uniform(0, 2 * np.pi)
        here = current_at(zero, field, 100.0, 200.0, 300.0)
        there = current_at(zero, field, 100 + apart * math.cos(course), 200 + apart * math.sin(course), 300 + later)
        products.append(here[0] * there[0] + here[1] * there[1])
    expected = 0.25 * math.exp(-((apart / 400) ** 2) / 2 - (later / 900) ** 2 / 2)
    assert abs(np.mean(products) - expected) < 4 * np.std(products) / math.sqrt(len(products))
    assert np.std(products) / math.sqrt(len(products)) < 0.02 * 0.25


@pytest.mark.parametrize("towards", [0.0, 0.7, 4.0])
def test_a_stream_is_its_profile(towards):
    """Oracle: by hand. Full speed in the middle, half of it a quarter of the width aside, none at the banks, always along the stream,
    the same all along it and at all times; the shear is greatest a quarter aside, pi speed / width."""
    mean, mode = stream(1.2, towards, 600.0, (7.7e6, 6.5e5))
    along, right = np.array([math.cos(towards), math.sin(towards)]), np.array([-math.sin(towards), math.cos(towards)])
    for aside, speed in ((0, 1.2), (150, 0.6), (-150, 0.6), (300, 0.0), (-300, 0.0), (100, 0.9)):
        for down, time in ((0.0, 0.0), (5000.0, 400.0)):
            place = np.array([7.7e6, 6.5e5]) + aside * right + down * along
            np.testing.assert_allclose(current_at(mean, mode, *place, time), speed * along, atol=1e-9)
    nn, ne, en, ee = shear_at(mode, *(np.array([7.7e6, 6.5e5]) + 150 * right), 0.0)
    np.testing.assert_allclose(np.array([[nn, ne], [en, ee]]) @ right, -math.pi * 1.2 / 600 * along, atol=1e-9)
    np.testing.assert_allclose(np.array([[nn, ne], [en, ee]]) @ along, 0, atol=1e-9)


def test_a_boat_crosses_a_stream_by_its_momentum():
    """Law: what drifts with the water is carried straight along; and of a boat that crosses without a force of the water on it the momentum
    over ground is kept, however the stream changes: d(V_water + u)/dt along the stream is zero while the heading and the force are."""
    boat = Ship.of(load_vessel("workboat8"))
    mean, mode = stream(1.0, 0.0, 400.0, (0.0, 0.0))
    drifting = simulate(boat, 0.0, boat.start(0.0, 60.0, 0.9, 0.0), 60.0, sea=Sea(current=mean, eddies=mode))[0]
    speed = (1 + math.cos(2 * math.pi * 60 / 400)) / 2
    np.testing.assert_allclose(drifting.north, speed * drifting.time, atol=1e-6)
    np.testing.assert_allclose(drifting.east, 60.0, atol=1e-6)
    across = simulate(boat, 0.0, boat.start(0.0, -90.0, math.pi / 2, 4.0), 0.5, sea=Sea(current=mean, eddies=mode))[0]
    still = simulate(boat, 0.0, boat.start(0.0, -90.0, math.pi / 2, 4.0), 0.5, sea=Sea(current=mean))[0]
    gained = (
        across.sway - across.current @ [-1, 0] - (still.sway - still.current @ [-1, 0])
    )  # through the water, to starboard: south
    water = across.current[:, 0] - across.current[0, 0]
    assert water[-1] > 0.01
    np.testing.assert_allclose(
        gained[1:6] / water[1:6], 1.0, atol=0.25
    )  # before the hull's drag has taken it away again
