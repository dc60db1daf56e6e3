"""Laws that every ship obeys, whatever its model: one parametrised test per law."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from aspnn.guidance import helms, random_orders, turning_circle
from aspnn.schema import InputError
from aspnn.simulation import Mmg, Sea, Ship, run_on, simulate
from aspnn.simulation.environment.current import current_at, draw_eddies, shear_at
from aspnn.simulation.ships.dynamics import accelerations
from aspnn.vessel import load_vessel

SHIPS = ("cargo90", "kvlcc2_l7", "kvlcc2_full", "mariner", "otter", "trimaran", "workboat8", "workboat8_loaded")
PLANAR = (helms.NORTH, helms.EAST, helms.HEADING, helms.SURGE, helms.SWAY, helms.YAW_RATE)
ODD = [*(helms.EAST, helms.HEADING, helms.SWAY, helms.YAW_RATE, helms.RUDDER), *(helms.ROLL, helms.ROLL_RATE)]


def the(name):
    """A ship, its time scale L / U [s] and a step for it."""
    ship = Ship.of(load_vessel(name))
    unit = ship.vessel.length / ship.service_speed
    return ship, unit, min(unit / 50, 0.5 * ship.largest_step())


def in_motion(ship, n, seed):
    """States (n, columns) of ordinary motion: way on, some drift and yaw, a rudder angle, of six degrees a little out of trim."""
    rng = np.random.default_rng(seed)
    speed, length = ship.service_speed, ship.vessel.length
    states = np.tile(ship.start(0.0, 0.0, 0.0, 0.7 * speed), (n, 1))
    states[:, helms.HEADING] = rng.uniform(0, 6, n)
    states[:, helms.SURGE] *= rng.uniform(0.7, 1.1, n)
    states[:, helms.SWAY] = rng.uniform(-0.1, 0.1, n) * speed
    states[:, helms.YAW_RATE] = rng.uniform(-0.2, 0.2, n) * speed / length
    states[:, helms.RUDDER] = rng.uniform(-0.5, 0.5, n) * ship.rudder.most
    if ship.columns == helms.SIX:
        states[:, helms.COLUMNS :] += rng.uniform(-0.02, 0.02, (n, helms.SIX - helms.COLUMNS))
    return states


@pytest.mark.parametrize("name", SHIPS)
def test_moving_water_is_still_water_seen_from_it(name):
    """Law (Galilei): in a uniform current nothing changes but the drift, and in one that swings with the tide neither."""
    ship, unit, dt = the(name)
    start, steps = in_motion(ship, 1, 3), 400
    orders = np.full((1, steps), 0.3 * ship.rudder.most)
    calm = run_on(ship, start, orders, dt=dt)[0]
    current = np.array([0.4, -0.3]) * ship.service_speed
    steady = run_on(ship, start, orders, sea=Sea(current=current), dt=dt)[0]
    drifted = calm.copy()
    drifted[:, :2] += current * dt * np.arange(steps + 1)[:, None]
    np.testing.assert_allclose(steady, drifted, rtol=0, atol=1e-9 * ship.vessel.length)
    long = 1e9 * ship.vessel.length  # so long a swell of the current that it is uniform here
    tide = np.array([[0.3 * ship.service_speed, 2 * math.pi / long, 0.0, 2 * math.pi / (20 * unit), 0.4]])
    swung = run_on(ship, start, orders, sea=Sea(eddies=tide), dt=dt)[0]
    np.testing.assert_allclose(swung[:, 2:], calm[:, 2:], rtol=0, atol=1e-6)
    time, omega = dt * np.arange(steps + 1), tide[0, 3]
    east = tide[0, 0] * (np.sin(omega * time - 0.4) + np.sin(0.4)) / omega
    np.testing.assert_allclose(swung[:, 1] - calm[:, 1], east, rtol=0, atol=1e-5 * ship.vessel.length)


def symmetric(ship):
    """The ship without what makes port and starboard unlike."""
    p = ship.model
    alike = {"gamma_R_plus": "gamma_R_minus", "C2_plus": "C2_minus"}
    changed = {a: getattr(p, b) for a, b in alike.items() if a in p._fields}
    changed |= {name: 0.0 for name in ("Y0", "N0", "Y0u", "N0u", "Y0uu", "N0uu") if name in p._fields}
    return replace(ship, model=p._replace(**changed))


@pytest.mark.parametrize("name", SHIPS)
def test_port_mirrors_starboard(name):
    """Law: the mirrored start under mirrored orders runs the mirrored voyage, in a mirrored wind too where the ship has loads."""
    ship, _, dt = the(name)
    ship = symmetric(ship)
    start = in_motion(ship, 2, 4)
    mirror = np.ones(ship.columns)
    mirror[[i for i in ODD if i < ship.columns]] = -1
    orders = np.repeat([[0.6, -0.9, 0.2], [-0.4, 0.8, 0.1]], 120, axis=1) * ship.rudder.most
    blow = 2 * ship.service_speed if ship.air.A_L > 0 else 0.0
    one = run_on(ship, start, orders, sea=Sea(wind=np.array([blow, -0.5 * blow])), dt=dt)
    other = run_on(ship, start * mirror, -orders, sea=Sea(wind=np.array([blow, 0.5 * blow])), dt=dt)
    np.testing.assert_allclose(other, one * mirror, rtol=1e-9, atol=1e-9)
    assert np.abs(one[..., helms.YAW_RATE]).max(axis=1).min() > 1e-3


@pytest.mark.parametrize("name", SHIPS)
def test_the_step_is_of_order_four(name):
    """Oracle: the order of the classical Runge-Kutta method; halving the step divides the error by about 16, at the median of states."""
    ship, unit, _ = the(name)
    start = in_motion(ship, 6, 5)
    longest, moving = 0.8 * ship.largest_step(), [*PLANAR, *range(helms.COLUMNS, ship.columns)]
    span = 16 * min(longest, unit / 20)

    def end(n):
        orders = np.repeat(start[:, helms.RUDDER :][:, :1], n, axis=1)
        return run_on(ship, start, orders, dt=span / n)[:, -1, moving]

    exact = end(512)
    errors = np.array([np.abs(end(n) - exact).max(axis=1) for n in (32, 64)])
    assert 12 < np.median(errors[0] / errors[1]) < 22


@njit
def _accelerations(model, x, load, out):
    accelerations(model, x, load, out)


def mass(ship, state):
    """The mass matrix that the compiled accelerations answer a load with: each unit load's change of acceleration, inverted."""
    where = [3, 4, 5] if ship.columns == helms.COLUMNS else [3, 4, 12, 13, 14, 5]
    loads = [0, 1, 5] if ship.columns == helms.COLUMNS else [0, 1, 2, 3, 4, 5]
    out = np.zeros((len(loads) + 1, ship.columns))
    _accelerations(ship.model, state, np.zeros(6), out[0])
    for row, i in zip(out[1:], loads, strict=True):
        _accelerations(ship.model, state, 1000.0 * np.eye(6)[i], row)
    return np.linalg.inv((out[1:, where] - out[0, where]).T / 1000.0), where


@pytest.mark.parametrize("name", [name for name in SHIPS if name != "mariner"])
def test_energy_does_not_grow_with_the_engine_stopped(name):
    """Law: without thrust the energy of ship, added mass and, of six degrees, springs never grows, nor is mass negative.

    The Mariner's derivatives hold about service speed with the propeller that keeps it; it cannot be stopped.
    """
    ship, _, dt = the(name)
    start = in_motion(ship, 20, 6)
    start[:, helms.SHAFT] = 0.0
    if name in ("otter", "trimaran"):  # what the lever steers there is thrust
        start[:, helms.RUDDER] = 0.0
    steps = 300
    x = run_on(ship, start, np.repeat(start[:, helms.RUDDER :][:, :1], steps, axis=1), dt=dt)
    M, where = mass(ship, start[0])
    np.testing.assert_allclose(M, M.T, rtol=1e-6, atol=1e-6 * np.abs(M).max())
    assert np.linalg.eigvalsh(M).min() > 0
    energy = 0.5 * np.einsum("bti,ij,btj->bt", x[..., where], M, x[..., where])
    if ship.columns == helms.SIX:
        b = ship.model.body
        down, roll, pitch = x[..., helms.DOWN], x[..., helms.ROLL] - b.roll, x[..., helms.PITCH] - b.pitch
        energy += 0.5 * (b.G33 * down**2 + 2 * b.G35 * down * pitch + b.G55 * pitch**2 + b.G44 * roll**2)
    assert np.diff(energy, axis=1).max() < 1e-9 * energy[:, 0].max()


@pytest.mark.parametrize("name", SHIPS)
def test_ten_hours_of_random_orders(name):
    """Law: nothing blows up, capsizes or runs backwards under random orders of rudder and engine; training/reproduce has 100 hours."""
    ship, unit, dt = the(name)
    rng, voyages = np.random.default_rng(7), 4
    duration = 36000 / voyages
    dt = min(0.1, ship.largest_step())
    time = np.arange(0, duration, dt)
    most, service = math.degrees(ship.rudder.most), ship.start(0.0, 0.0, 0.0, ship.service_speed)[0, helms.SHAFT]
    hold = (2 * unit, 20 * unit)
    orders = np.stack([random_orders(rng, duration, most, most / 7, hold).at(time) for _ in range(voyages)])
    levels = np.repeat(rng.uniform(0.4, 1.0, (voyages, 60)), math.ceil(len(time) / 60), axis=1)[:, : len(time)]
    start = ship.start(np.zeros(voyages), 0.0, 0.0, ship.service_speed)
    x = run_on(ship, start, orders, shaft=levels * service, dt=dt)
    assert np.isfinite(x[..., :8]).all()
    assert x[..., helms.SURGE].min() > -0.02 * ship.service_speed
    assert x[..., helms.SURGE].max() < 1.3 * ship.service_speed
    assert np.abs(x[..., helms.SWAY]).max() < ship.service_speed
    assert np.abs(x[..., helms.YAW_RATE]).max() * unit < 8
    if ship.columns == helms.SIX:
        assert np.abs(x[..., [helms.ROLL, helms.PITCH]]).max() < math.radians(40)


def test_a_ship_is_carried_by_the_water_that_moves_it():
    """Oracle: scipy. A body that no force of the hull acts on follows p'' = DV/Dt at its place, the acceleration of the water there."""
    whole = Ship.of(load_vessel("cargo90"))
    keep = {name: getattr(whole.model, name) for name in ("rho", "Lpp", "d", "nabla", "kzz", "D_P", "H_R")}
    still = whole.model.propeller._replace(k0=0.0, k1=0.0, k2=0.0, curves=0 * whole.model.propeller.curves)
    numbers = {name: keep.get(name, 0.0) for name in Mmg._fields if name not in ("exponential_wake", "propeller")}
    ship = replace(whole, model=Mmg(**numbers, propeller=still))
    eddies, mean = draw_eddies(np.random.default_rng(1), 0.5, 800.0, 1200.0), np.array([0.3, -0.2])
    start = whole.start(0.0, 0.0, 0.7, 4.0)
    start[0, helms.SHAFT] = 0.0
    steps, dt = 6000, 0.1

    def slope(t, y):
        n, e = y[:2]
        V = current_at(mean, eddies, n, e, t)
        nn, ne, en, ee = shear_at(eddies, n, e, t)
        later, sooner = (np.array(current_at(mean, eddies, n, e, t + h)) for h in (0.5, -0.5))
        return [*y[2:], *(later - sooner + [nn * V[0] + ne * V[1], en * V[0] + ee * V[1]])]

    V = current_at(mean, eddies, 0.0, 0.0, 0.0)
    first = [0.0, 0.0, 4 * math.cos(0.7) + V[0], 4 * math.sin(0.7) + V[1]]
    times = dt * np.arange(steps + 1)
    theirs = solve_ivp(slope, (0, times[-1]), first, t_eval=times, rtol=1e-9, atol=1e-9).y.T
    ours = run_on(ship, start, np.zeros((1, steps)), sea=Sea(current=mean, eddies=eddies), dt=dt)[0]
    np.testing.assert_allclose(ours[:, :2], theirs[:, :2], atol=0.01)  # the time derivative above is to 1e-6
    assert np.abs(ours[-1, :2] - (first[2] * 600, first[3] * 600)).max() > 20


@pytest.mark.parametrize("name", ["cargo90", "otter", "workboat8"])
def test_velocities_and_rates_of_a_voyage_are_derivatives(name):
    """Oracle: central differences of places, attitude and velocities in current, wind and (of six degrees) waves."""
    ship, unit, dt = the(name)
    length = ship.vessel.length
    waves = np.array(
        [[0.01 * length, 2 * math.pi / (4 * length), 0.6, math.sqrt(9.81 * 2 * math.pi / (4 * length)), 0.3]]
    )
    eddies = draw_eddies(np.random.default_rng(2), 0.1 * ship.service_speed, 40 * length, 300 * unit)
    sea = Sea(np.array([0.05, -0.02]) * ship.service_speed, eddies, waves=waves)
    start = ship.start(0.0, 0.0, 0.3, 0.8 * ship.service_speed)
    dt = dt / 10
    v = simulate(ship, turning_circle(0.4 * ship.rudder.most), start, 12 * unit, sea=sea, dt=dt)[0]
    inner = slice(len(v.time) // 3, -2)  # the rudder, which has a kink where it stops, has reached its order
    speed = ship.service_speed
    ahead, athwart = v.surge + 0j, v.sway * 1j
    ground = (ahead + athwart) * np.exp(1j * v.heading)
    for value, rate, scale in (
        (v.north, ground.real, speed),
        (v.east, ground.imag, speed),
        (v.heading, v.yaw_rate, 1 / unit),
        (v.surge, v.surge_rate, speed / unit),
        (v.sway, v.sway_rate, speed / unit),
        (v.yaw_rate, v.yaw_acceleration, 1 / unit**2),
        (v.roll, v.roll_rate, 1 / unit),
        (v.pitch, v.pitch_rate, 1 / unit),
        (v.heave, v.heave_rate, speed),
        (v.heave_rate, v.heave_acceleration, speed / unit),
    ):
        np.testing.assert_allclose(np.gradient(value, dt)[inner], rate[inner], rtol=0, atol=2e-3 * scale)


def test_what_a_model_has_no_data_for_is_flagged():
    """Oracle: the definitions, on states made for each bit; a voyage astern says so in its truth and a plain one has no column."""
    ship = Ship.of(load_vessel("cargo90"))
    rows = np.tile(ship.start(0.0, 0.0, 0.0, 5.0), (5, 1))
    rows[1, helms.SURGE] = -1.0
    rows[2, helms.SWAY] = 4.0
    rows[3, helms.YAW_RATE] = 1.5 * 5 / ship.vessel.length
    rows[4, helms.PITCH_RATIO] = -0.3
    np.testing.assert_array_equal(ship.outside(rows), [0, 1, 2, 4, 8])
    start = ship.start(0.0, 0.0, 0.0, 5.0)
    assert "out_of_domain" not in simulate(ship, 0.1, start, 60.0)[0].truth()
    backing = simulate(ship, 0.0, start, 600.0, pitch=ship.pitch.least)[0].truth()
    assert backing["out_of_domain"].iloc[-1] & 9 == 9


def test_a_step_too_long_is_refused_by_what_is_fast():
    """Oracle: the Otter's stiffest mode; at the longest step the motion is damped still, at 2.5 times it blows up."""
    ship = Ship.of(load_vessel("otter"))
    longest = ship.largest_step()
    assert 0.1 < longest < 0.3
    start = in_motion(ship, 1, 8)
    for factor, stays in ((1.0, True), (2.5, False)):
        x = run_on(ship, start, np.zeros((1, 2000)), dt=factor * longest)[0]
        assert np.isfinite(x[-1, :8]).all() == stays


def test_a_depth_needs_a_model_for_it():
    """Oracle: the message."""
    with pytest.raises(InputError, match="vessel otter: its model has no shallow-water correction"):
        Ship.of(load_vessel("otter")).at_depth(3.0)
