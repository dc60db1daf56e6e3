"""Craft in six degrees of freedom: analytic values, an independent form of the Coriolis forces, and laws both boats obey."""

import math

import numpy as np
import pytest
from numba import njit
from scipy.integrate import quad, solve_ivp
from scipy.linalg import eigh

from aspnn.guidance.helms import (
    DOWN,
    HEAVE,
    PITCH,
    PITCH_RATE,
    ROLL,
    ROLL_RATE,
    RUDDER,
    SHAFT,
    SIX,
    SURGE,
    SWAY,
    YAW_RATE,
)
from aspnn.simulation.ships.dynamics import accelerations
from aspnn.simulation.ships.otter import Otter
from aspnn.simulation.ships.sixdof import Body, cross_flow, cross_matrix, respond, rigid_mass
from aspnn.simulation.ships.workboat import Workboat
from aspnn.vessel import load_vessel

NU = [SURGE, SWAY, HEAVE, ROLL_RATE, PITCH_RATE, YAW_RATE]
ATTITUDE = [DOWN, ROLL, PITCH]
MODELS = {"otter": Otter, "workboat8": Workboat}
LEVERS = {"otter": (math.radians(35), 16.0), "workboat8": (math.radians(30), 30.0)}
CALM = np.zeros(6)


def the(name):
    return MODELS[name].of(load_vessel(name))


@njit
def rates(model, x, load, out):
    """Derivatives of a state row: `accelerations`, and the kinematics of Euler angles written out here."""
    accelerations(model, x, load, out)
    attitude_rates(x, out)


@njit
def attitude_rates(x, out):
    s, c, t = math.sin(x[ROLL]), math.cos(x[ROLL]), math.tan(x[PITCH])
    out[DOWN] = -math.sin(x[PITCH]) * x[SURGE] + math.cos(x[PITCH]) * (s * x[SWAY] + c * x[HEAVE])
    out[ROLL] = x[ROLL_RATE] + (s * x[PITCH_RATE] + c * x[YAW_RATE]) * t
    out[PITCH] = c * x[PITCH_RATE] - s * x[YAW_RATE]


def voyage(model, start, orders, loads, dt):
    """Runge-Kutta steps under `orders` (n, 2) of lever and shaft, which they hold, and `loads` (n, 6): states (n + 1, 15)."""
    path = np.zeros((len(orders) + 1, SIX))
    path[0], path[:-1, RUDDER], path[:-1, SHAFT] = start, orders[:, 0], orders[:, 1]
    steps(model, path, loads, dt, np.zeros(SIX), np.zeros(SIX))
    return path


@njit
def steps(model, path, loads, dt, k, y):
    """Fill the moving columns of `path`, whose levers are told; `k` and `y` are work space."""
    for i in range(len(loads)):
        x, end = path[i], path[i + 1]
        for j in range(x.size):
            y[j] = x[j]
            if j != RUDDER and j != SHAFT:
                end[j] = x[j]
        for stage in range(4):
            rates(model, y, loads[i], k)
            part, reach = (dt / 6 if stage in (0, 3) else dt / 3), (dt if stage == 2 else dt / 2)
            for j in range(x.size):
                end[j] += part * k[j]
                y[j] = x[j] + reach * k[j]


def some_states(rng, n, speed=3.0):
    """States of every kind of motion, with the levers amidships and stopped."""
    x = np.zeros((n, SIX))
    x[:, [SURGE, SWAY, HEAVE]] = rng.normal(0, speed, (n, 3)) * [1, 0.3, 0.2]
    x[:, [ROLL_RATE, PITCH_RATE, YAW_RATE]] = rng.normal(0, 0.5, (n, 3))
    x[:, ATTITUDE] = rng.normal(0, 0.2, (n, 3))
    return x


def energy(body, x):
    """Of body, added mass and springs [J], of states (..., 15); 0 at rest."""
    nu, down, heel, trim = x[..., NU], x[..., DOWN], x[..., ROLL] - body.roll, x[..., PITCH] - body.pitch
    spring = body.G33 * down**2 + 2 * body.G35 * down * trim + body.G55 * trim**2 + body.G44 * heel**2
    return 0.5 * (np.einsum("...i,ij,...j", nu, body.mass, nu) + spring)


def power(body, x, out):
    """Time derivative of `energy` along the derivatives `out`."""
    down, heel, trim = x[DOWN], x[ROLL] - body.roll, x[PITCH] - body.pitch
    spring = (body.G33 * down + body.G35 * trim) * out[DOWN] + body.G44 * heel * out[ROLL]
    return x[NU] @ body.mass @ out[NU] + spring + (body.G35 * down + body.G55 * trim) * out[PITCH]


def test_mass_matrix_is_that_of_its_particles():
    """Oracle: 1/2 sum m |v + omega x r|^2 over a cloud of particles, whose mass, centre and inertia are summed directly."""
    rng = np.random.default_rng(1)
    m, r, nu = rng.uniform(1, 5, 40), rng.normal(0, 1, (40, 3)), rng.normal(0, 1, 6)
    centre = m @ r / m.sum()
    inertia = sum(mi * ((ri @ ri) * np.eye(3) - np.outer(ri, ri)) for mi, ri in zip(m, r - centre, strict=True))
    kinetic = 0.5 * m @ np.square(nu[:3] + np.cross(nu[3:], r)).sum(axis=1)
    M = rigid_mass(m.sum(), centre, inertia)
    np.testing.assert_allclose(0.5 * nu @ M @ nu, kinetic, rtol=1e-12)
    np.testing.assert_allclose(M, M.T, atol=1e-12)


@pytest.mark.parametrize(
    "v, r", [(0.5, 0.2), (-0.5, 0.2), (0.1, 0.4), (-0.1, 0.4), (0.1, -0.4), (0.3, 0.0), (0.0, 0.3), (0, 0)]
)
def test_cross_flow_integrals(v, r):
    """Oracle: adaptive quadrature of f |f| and x f |f|, f = v + x r, split where f changes sign."""
    length = 8.0
    split = [-v / r] if r and abs(v / r) < length / 2 else None
    for power, value in enumerate(cross_flow(v, r, length)):
        whole = quad(lambda x, k=power: x**k * (v + x * r) * abs(v + x * r), -length / 2, length / 2, points=split)[0]
        assert value == pytest.approx(whole, abs=1e-10)


def test_cross_flow_has_no_seam():
    """Law: the two expressions meet where the flow stands still at the bow, |v| = |r| length / 2, to rounding."""
    for v, r in ((1.0, 0.25), (-1.0, 0.25), (1.0, -0.25)):
        inside, outside = cross_flow(v * (1 - 1e-12), r, 8.0), cross_flow(v * (1 + 1e-12), r, 8.0)
        np.testing.assert_allclose(inside, outside, rtol=1e-10)


def bare(body):
    """The body without springs and dampers."""
    return Body(body.mass, body.inverse, *[0.0] * 9)


@pytest.mark.parametrize("name", MODELS)
def test_coriolis_forces_equal_the_matrix_form(name):
    """Oracle: C(nu) of Fossen (2021, 3.3), [[0, -S(P)], [-S(P), -S(H)]] with (P, H) = M nu, as a matrix times nu."""
    body, rng = bare(the(name).body), np.random.default_rng(2)
    for x in some_states(rng, 20):
        out, (P, H) = np.zeros(SIX), np.split(body.mass @ x[NU], 2)
        respond(body, x, *CALM, out)
        C = np.block([[np.zeros((3, 3)), -cross_matrix(P)], [-cross_matrix(P), -cross_matrix(H)]])
        np.testing.assert_allclose(body.mass @ out[NU], -C @ x[NU], rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("name", MODELS)
def test_springs_and_coriolis_forces_keep_energy(name):
    """Law: without dampers and drag the energy of body, water and springs stays, at any attitude."""
    body, rng = the(name).body._replace(D33=0.0, D44=0.0, D55=0.0), np.random.default_rng(3)
    for x in some_states(rng, 50):
        out = np.zeros(SIX)
        respond(body, x, *CALM, out)
        attitude_rates(x, out)
        scale = np.abs(x[NU] * (body.mass @ out[NU])).sum()
        assert abs(power(body, x, out)) < 1e-12 * scale


@pytest.mark.parametrize("name", MODELS)
def test_energy_only_falls_with_the_engine_stopped(name):
    """Law: with levers amidships and stopped the water only takes energy, in 3000 states of every kind of motion, and it is
    taken from all of them (a state of rest has none to give)."""
    model, rng = the(name), np.random.default_rng(4)
    for x in np.concatenate([some_states(rng, 1000, speed) for speed in (0.3, 3.0, 12.0)]):
        out = np.zeros(SIX)
        rates(model, x, CALM, out)
        assert power(model.body, x, out) < -1e-3 * energy(model.body, x)


@pytest.mark.parametrize("name", MODELS)
def test_energy_falls_along_a_voyage(name):
    """Law: as above along two minutes from fast, heeled and turning states, step by step (steps of 0.02 s, RK4)."""
    model, rng = the(name), np.random.default_rng(5)
    for x in some_states(rng, 4, 3.0):
        path = voyage(model, x, np.zeros((6000, 2)), np.zeros((6000, 6)), 0.02)
        along = energy(model.body, path)
        assert (np.diff(along) <= 1e-12 * along[0]).all()
        assert along[-1] < 1e-2 * along[0]


@pytest.mark.parametrize("name", MODELS)
def test_port_mirrors_starboard(name):
    """Law: the mirror image of state, lever and load has the mirror image of derivatives, to rounding."""
    model, rng = the(name), np.random.default_rng(6)
    mirror = np.ones(SIX)
    mirror[[SWAY, YAW_RATE, RUDDER, ROLL, ROLL_RATE]] = -1
    for x in some_states(rng, 50):
        x[[RUDDER, SHAFT]] = rng.uniform(-1, 1, 2) * LEVERS[name]
        load, out, image = rng.normal(0, 100, 6), np.zeros(SIX), np.zeros(SIX)
        rates(model, x, load, out)
        rates(model, x * mirror, load * [1, -1, 1, -1, 1, -1], image)
        np.testing.assert_allclose(image, out * mirror, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_natural_periods(name):
    """Oracle: the linear formula G a = omega^2 M a (6 x 6). Started a little along a mode, an undamped boat is back after
    2 pi / omega, to what the second order of a motion of 1e-4 leaves; heave, roll and pitch are the three modes with springs."""
    body = the(name).body._replace(D33=0.0, D44=0.0, D55=0.0, roll=0.0, pitch=0.0)
    G = np.zeros((6, 6))
    G[2, 2], G[3, 3], G[4, 4], G[2, 4], G[4, 2] = body.G33, body.G44, body.G55, body.G35, body.G35
    squares, shapes = eigh(G, body.mass)
    for square, shape in zip(squares[3:], shapes.T[3:], strict=True):
        x, period = np.zeros(SIX), 2 * math.pi / math.sqrt(square)
        x[ATTITUDE] = 1e-4 * shape[2:5] / np.abs(shape[2:5]).max()
        end = solve_ivp(free, (0, period), x, args=(body,), rtol=1e-9, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(end[ATTITUDE], x[ATTITUDE], atol=1e-7)


def free(time, x, body):
    """Derivatives of the body alone."""
    out = np.zeros(SIX)
    respond(body, x, *CALM, out)
    attitude_rates(x, out)
    return out


@pytest.mark.parametrize("name", MODELS)
def test_it_comes_to_rest_in_equilibrium(name):
    """Law: pushed and left alone the boat comes back to its own roll and pitch, midship at its place, and stands still there."""
    model = the(name)
    rest, out = np.zeros(SIX), np.zeros(SIX)
    rest[[ROLL, PITCH]] = model.body.roll, model.body.pitch
    rates(model, rest, CALM, out)
    np.testing.assert_allclose(out, 0, atol=1e-12)
    pushed = rest.copy()
    pushed[[DOWN, ROLL, PITCH]] += [0.05, 0.2, 0.1]
    end = voyage(model, pushed, np.zeros((2400, 2)), np.zeros((2400, 6)), 0.05)[-1]
    np.testing.assert_allclose(end[ATTITUDE], rest[ATTITUDE], atol=1e-4)


@pytest.mark.parametrize("name, dt", [("otter", 0.05), ("workboat8", 0.1)])
def test_random_orders_in_rough_water(name, dt):
    """Law: an hour of random lever and engine orders under loads that lift, roll, pitch and push as a sea of 1 m does the 8 m boat,
    and one of a quarter metre the Otter, leaves every state finite: no roll of 60 degrees, no yaw rate of 75 degrees a second."""
    model, rng = the(name), np.random.default_rng(7)
    n, body = round(3600 / dt), model.body
    lever, shaft = LEVERS[name]
    held = round(8 / dt)
    orders = np.repeat(rng.uniform([-lever, 0.1 * shaft], [lever, shaft], (n // held, 2)), held, axis=0)
    for i, slew in enumerate((lever, shaft / 3)):  # a second to full lever, three to full speed
        for k in range(1, n):
            orders[k, i] = orders[k - 1, i] + min(max(orders[k, i] - orders[k - 1, i], -slew * dt), slew * dt)
    weight = 9.81 * body.mass[0, 0]
    slope = np.array([weight, weight, 0.0, body.G44, body.G55, 0.2 * weight * model.length])
    lift = np.array(
        [0, 0, model.length / 32 * body.G33, 0, 0, 0]
    )  # a quarter of the significant height, times the stiffness
    deviation = 0.05 * slope + lift  # a slope of 1 in 20
    omega, phase = rng.uniform(0.8, 3.5, 8), rng.uniform(0, 2 * np.pi, (6, 8, 1))
    waves = np.cos(omega[:, None] * np.arange(n) * dt + phase).sum(axis=1) / 2  # of unit variance
    path = voyage(model, np.zeros(SIX), orders, (deviation[:, None] * waves).T.copy(), dt)
    assert np.isfinite(path).all()
    assert np.degrees(np.abs(path[:, ROLL])).max() < 60
    assert np.degrees(np.abs(path[:, YAW_RATE])).max() < 75
    assert np.abs(path[:, SURGE]).max() < 20
