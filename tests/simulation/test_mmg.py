"""The MMG model, against shipmmg, published tables, an independent prototype, exact solutions and laws."""

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from peers import shipmmg

from aspnn.guidance import straight, turning_circle, zigzag
from aspnn.orders import Orders
from aspnn.schema import InputError
from aspnn.simulation import (
    Mmg,
    Sea,
    Ship,
    run_on,
    simulate,
    turning_circle_indices,
    zigzag_overshoots,
)
from aspnn.vessel import load_vessel

REFERENCE = Path(__file__).parents[1] / "reference"
SHIPS = ("cargo90", "kvlcc2_l7", "kvlcc2_full")


def the(name):
    """Ship, service speed and the shaft speed that balances it."""
    vessel = load_vessel(name)
    ship = Ship.of(vessel)
    return ship, vessel.service_speed, ship.model.balance(vessel.service_speed)[0]


def rows(ship, *states, shaft=0.0):
    """States (n, 7) up to the rudder with a shaft speed and the pitch of the service speed."""
    found = np.tile(ship.start(0.0, 0.0, 0.0, ship.service_speed), (len(states), 1))
    found[:, :7], found[:, 7] = states, shaft
    return found


def trial(name, helm, lengths=60, dt=None):
    """One voyage of `lengths` ship lengths at service speed, in steps of the ship's own time scale."""
    ship, speed, _ = the(name)
    unit = ship.model.Lpp / speed
    return simulate(ship, helm, ship.start(0.0, 0.0, 0.2, speed), lengths * unit, dt=dt or unit / 150)[0]


def turn(name, degrees, dt=None):
    voyage = trial(name, turning_circle(math.radians(degrees)), dt=dt)
    return turning_circle_indices(voyage.time, voyage.north, voyage.east, voyage.heading), voyage


def overshoots(name, degrees, dt=None):
    voyage = trial(name, zigzag(math.radians(degrees), math.radians(abs(degrees))), dt=dt)
    return np.degrees(zigzag_overshoots(voyage.heading, voyage.order, math.radians(abs(degrees))))


@pytest.mark.parametrize("name", SHIPS)
@pytest.mark.parametrize("rudder", ["starboard", "port", "swinging"])
def test_equals_shipmmg(name, rudder):
    """Oracle: shipmmg 0.0.11 at equal inputs, 40 ship lengths, states within 0.5 % of their largest (1e-6 at constant rudder).

    Made equal: the exponential wake, which is shipmmg's only one; x_G = 0, since shipmmg takes U and beta (hull, wake and
    rudder) from the velocity v - r x_G, which is not the midship of its other terms; rudders that its cubic spline follows
    (constant, or a slow sine that our servo follows within its rate); an integration tolerance of 1e-8.
    """
    pytest.importorskip("shipmmg.mmg_3dof")
    ship, speed, shaft = the(name)
    ship = replace(ship, model=ship.model._replace(exponential_wake=True, x_G=0.0))
    unit = ship.model.Lpp / speed
    time = np.arange(6001) * unit / 150
    delta = {
        "starboard": np.full(len(time), math.radians(20)),
        "port": np.full(len(time), math.radians(-35)),
        "swinging": math.radians(20) * np.sin(2 * np.pi * time / (8 * unit)),
    }[rudder]
    start = ship.start(0.0, 0.0, 0.0, speed)
    start[0, 6] = delta[0]
    ours = run_on(ship, start, delta[None, 1:], shaft, dt=time[1])[0]
    theirs = shipmmg(ship.model, time, delta, shaft, speed, rtol=1e-8, atol=1e-10)
    tolerance = 5e-3 if rudder == "swinging" else 1e-6
    travelled = np.abs(np.diff(ours[:, 0] + 1j * ours[:, 1])).sum()
    for column, row, scale in (
        (3, 0, None),
        (4, 1, None),
        (5, 2, None),
        (0, 3, travelled),
        (1, 4, travelled),
        (2, 5, 1.0),
    ):
        scale = np.abs(theirs[row]).max() if scale is None else scale
        np.testing.assert_allclose(ours[:, column], theirs[row], rtol=0, atol=tolerance * scale)


@pytest.mark.parametrize("side, degrees", [("stbd", 35), ("port", -35)])
def test_turning_circle_of_kvlcc2_is_the_published_one(side, degrees):
    """Oracle: Yasukawa & Yoshimura 2015, calculation; within 8 %, since their approach shaft speed is not known."""
    published = tomllib.loads((REFERENCE / "kvlcc2_yasukawa_2015.toml").read_text())["calculation"]
    indices, _ = turn("kvlcc2_l7", degrees)
    assert indices.advance / 7 == pytest.approx(published[f"AD_{side}"], rel=0.08)
    assert indices.tactical_diameter / 7 == pytest.approx(published[f"DT_{side}"], rel=0.08)


@pytest.mark.parametrize("side, degrees", [("p10", 10), ("m10", -10)])
def test_zigzag_of_kvlcc2_is_the_published_one(side, degrees):
    """Oracle: Yasukawa & Yoshimura 2015, calculation; the first overshoot within 2 degrees."""
    published = tomllib.loads((REFERENCE / "kvlcc2_yasukawa_2015.toml").read_text())["calculation"]
    assert overshoots("kvlcc2_l7", degrees)[0] == pytest.approx(published[f"OSA1_{side}"], abs=2.0)


@pytest.mark.parametrize("degrees", [35, -35])
def test_turning_circle_of_cargo90_is_that_of_the_prototype(degrees):
    """Oracle: an independent implementation, to the digits it printed."""
    printed = tomllib.loads((REFERENCE / "cargo90_prototype.toml").read_text())["turn"][str(degrees)]
    indices, voyage = turn("cargo90", degrees, dt=0.1)
    assert indices.advance / 85 == pytest.approx(printed["AD"], abs=1e-4)
    assert indices.transfer / 85 == pytest.approx(printed["TR"], abs=1e-4)
    assert indices.tactical_diameter / 85 == pytest.approx(printed["DT"], abs=1e-4)
    u, v, r = voyage.surge[-1], voyage.sway[-1], voyage.yaw_rate[-1]
    assert math.hypot(u, v) / 5.916106 == pytest.approx(printed["U_ratio"], abs=1e-4)
    assert math.degrees(math.atan2(-v, u)) == pytest.approx(printed["drift_deg"], abs=1e-4)
    assert math.degrees(r) == pytest.approx(printed["r_deg_s"], abs=1e-4)
    assert math.hypot(u, v) / abs(r) / 85 == pytest.approx(printed["steady_R_L"], abs=1e-4)


@pytest.mark.parametrize("degrees", [10, -10, 20, -20])
def test_zigzag_of_cargo90_is_that_of_the_prototype(degrees):
    """Oracle: an independent implementation, to the digits it printed."""
    printed = tomllib.loads((REFERENCE / "cargo90_prototype.toml").read_text())["zigzag"][str(degrees)]
    np.testing.assert_allclose(
        overshoots("cargo90", degrees, dt=0.1)[:2], [printed["OSA1"], printed["OSA2"]], atol=1e-4
    )


@pytest.mark.parametrize("name", SHIPS)
def test_balanced_propeller_keeps_the_speed(name):
    """Oracle: equilibrium; a straight ship neither gains nor loses speed."""
    voyage = trial(name, straight(), lengths=20)
    np.testing.assert_allclose(voyage.surge, voyage.surge[0], rtol=1e-12)
    assert not voyage.sway.any() and not voyage.yaw_rate.any()


def test_the_step_is_of_order_four():
    """Oracle: the order of the classical Runge-Kutta method; halving the step divides the error by 16, here by 12 to 40."""
    ship, _, shaft = the("cargo90")
    start = rows(
        ship, [0, 0, 0.4, 5.0, -0.6, 0.012, math.radians(20)], shaft=shaft
    )  # where all coefficients are smooth

    def end(dt):
        return run_on(ship, start, np.full((1, round(64 / dt)), math.radians(20)), shaft, dt=dt)[0, -1, :6]

    exact = end(1 / 64)
    errors = np.array([np.abs(end(dt) - exact) for dt in (4, 2, 1, 0.5)])
    ratio = errors[:-1] / errors[1:]
    assert np.all(ratio > 12) and np.all(ratio < 40)


def test_the_rudder_is_the_servo_of_the_orders():
    """Oracle: Orders.servo, exact for a limited rate; an order beyond the stop is refused."""
    ship, speed, _ = the("cargo90")
    time = np.arange(0, 300, 0.1)
    orders = Orders(np.array([0.0, 20.0, 29.7, 80.0, 200.0]), np.radians([0.0, 35.0, -20.0, 30.0, 5.0]))
    start = ship.start(0.0, 0.0, 0.0, speed)
    path = run_on(ship, start, orders.at(time)[None, :-1])[0]
    np.testing.assert_allclose(path[:, 6], orders.servo(time, 0.0, ship.rudder.rate), atol=1e-12)
    with pytest.raises(InputError, match=r"vessel cargo90: a rudder order \[rad\] of 0\.87"):
        run_on(ship, start, np.full((1, 3), math.radians(50)))


def test_a_current_carries_ship_and_water_alike():
    """Oracle: Galilean invariance; seen from the water nothing changes, and the track drifts with the current."""
    ship, speed, _ = the("cargo90")
    helm, start, current = turning_circle(0.4, 30.0), ship.start(10.0, 20.0, 1.0, speed), np.array([0.7, -0.4])
    calm = simulate(ship, helm, start, 600)[0]
    moved = simulate(ship, helm, start, 600, sea=Sea(current=current))[0]
    np.testing.assert_allclose(moved.north, calm.north + current[0] * calm.time, atol=1e-9)
    np.testing.assert_allclose(moved.east, calm.east + current[1] * calm.time, atol=1e-9)
    np.testing.assert_allclose(moved.heading, calm.heading, atol=1e-12)
    speeds = [(v.surge + 1j * v.sway) * np.exp(1j * v.heading) for v in (calm, moved)]
    np.testing.assert_allclose(speeds[1] - speeds[0], complex(*current), atol=1e-9)


@pytest.mark.parametrize("name", SHIPS)
def test_voyage_rates_are_derivatives(name):
    """Oracle: central differences of the voyage's own positions and velocities, in a current, with their order of error."""
    ship, speed, _ = the(name)
    unit = ship.model.Lpp / speed
    start, current = ship.start(0.0, 0.0, 0.3, speed), np.array([0.1, -0.07]) * speed
    v = simulate(ship, turning_circle(0.3), start, 20 * unit, sea=Sea(current=current), dt=unit / 400)[0]
    inner = slice(600, -2)  # the rudder, which has a kink where it stops, has reached its order
    for value, rate, scale in (
        (v.north, v.surge * np.cos(v.heading) - v.sway * np.sin(v.heading), speed),
        (v.east, v.surge * np.sin(v.heading) + v.sway * np.cos(v.heading), speed),
        (v.heading, v.yaw_rate, 1 / unit),
        (v.surge, v.surge_rate, speed / unit),
        (v.sway, v.sway_rate, speed / unit),
        (v.yaw_rate, v.yaw_acceleration, 1 / unit**2),
    ):
        np.testing.assert_allclose(np.gradient(value, v.time[1])[inner], rate[inner], rtol=0, atol=1e-5 * scale)


@pytest.mark.parametrize("name", SHIPS)
@pytest.mark.parametrize("degrees", [35, -10])
def test_a_steady_turn_is_a_circle(name, degrees):
    """Oracle: constant body velocity runs a circle about a fixed centre."""
    _, v = turn(name, degrees)
    late = v.time > 0.7 * v.time[-1]
    centre = (
        v.north + 1j * v.east + np.exp(1j * v.heading) * 1j * (v.surge + 1j * v.sway) / np.where(late, v.yaw_rate, 1)
    )
    radius = np.hypot(v.surge, v.sway)[-1] / abs(v.yaw_rate[-1])
    np.testing.assert_allclose(centre[late], centre[-1], rtol=0, atol=1e-3 * radius)


@pytest.mark.parametrize("name", SHIPS)
def test_energy_falls_with_the_engine_stopped(name):
    """Law: with the propeller stopped, no hull or rudder at any angle adds to the kinetic energy of ship and added mass."""
    ship, speed, _ = the(name)
    p, rng, n = ship.model, np.random.default_rng(1), 200
    start = rows(ship, *np.zeros((n, 7)))
    start[:, 3] = rng.uniform(0.3, 1, n) * speed
    start[:, 4] = rng.uniform(-0.3, 0.3, n) * speed
    start[:, 5] = rng.uniform(-0.4, 0.4, n) * speed / p.Lpp
    start[:, 6] = rng.uniform(-1, 1, n) * ship.rudder.most
    x = run_on(ship, start, np.repeat(start[:, 6:7], 1000, axis=1), 0.0, dt=p.Lpp / speed / 20)
    u, v, r = x[..., 3], x[..., 4], x[..., 5]
    mass, unit = p.rho * p.nabla, 0.5 * p.rho * p.Lpp**2 * p.d
    inertia = mass * (p.kzz * p.Lpp) ** 2 + p.x_G**2 * mass + p.J_z * unit * p.Lpp**2
    energy = (mass + p.m_x * unit) * u**2 + (mass + p.m_y * unit) * v**2 + 2 * p.x_G * mass * v * r + inertia * r**2
    assert np.all(np.diff(energy) < 0)


def test_a_symmetric_ship_turns_alike_to_both_sides():
    """Law: with gamma_R and C2 equal on both sides the mirrored start gives the mirrored motion, in mirrored wind too."""
    ship, speed, shaft = the("cargo90")
    p = ship.model
    ship = replace(ship, model=p._replace(gamma_R_plus=p.gamma_R_minus, C2_plus=p.C2_minus))
    start = rows(ship, [0.0, 0.0, 0.0, speed, 0.3, 0.004, 0.1], shaft=shaft)
    mirror = np.array([1, -1, -1, 1, -1, -1, -1.0, 1, 1])
    order = np.radians(np.repeat([20.0, -35.0, 5.0], 1000))[None]
    one = run_on(ship, start, order, sea=Sea(wind=np.array([-8.0, 5.0])))
    other = run_on(ship, start * mirror, -order, sea=Sea(wind=np.array([-8.0, -5.0])))
    np.testing.assert_allclose(other, one * mirror, rtol=1e-9, atol=1e-9)
    unlike = run_on(ship, start * mirror, -order, sea=Sea(wind=np.array([-8.0, 5.0])))
    assert np.abs(unlike - one * mirror).max() > 1


def test_a_free_body_turns_about_its_centre_of_gravity():
    """Oracle: without any hydrodynamic force the centre of gravity runs straight at constant speed and the yaw rate is constant."""
    ship, _, _ = the("kvlcc2_full")
    keep = {name: getattr(ship.model, name) for name in ("rho", "Lpp", "d", "nabla", "x_G", "kzz", "D_P", "H_R")}
    still = ship.model.propeller._replace(k0=0.0, k1=0.0, k2=0.0, curves=0 * ship.model.propeller.curves)
    numbers = {name: keep.get(name, 0.0) for name in Mmg._fields if name not in ("exponential_wake", "propeller")}
    ship = replace(ship, model=Mmg(**numbers, propeller=still))
    start = rows(replace(ship, model=the("kvlcc2_full")[0].model), [5.0, -3.0, 0.3, 6.0, 1.0, 0.02, 0.0])
    x = run_on(ship, start, np.zeros((1, 3000)), 0.0)[0]
    np.testing.assert_allclose(x[:, 5], 0.02, rtol=1e-9)
    middle = x[:, 0] + 1j * x[:, 1] + keep["x_G"] * np.exp(1j * x[:, 2])
    velocity = (6.0 + 1j * (1.0 + 0.02 * keep["x_G"])) * np.exp(0.3j)
    np.testing.assert_allclose(middle, middle[0] + velocity * np.arange(3001) * 0.1, atol=1e-6)


def test_wind_pushes_from_where_it_comes():
    """Law: wind from the west drives a ship that heads north to the east and leaves calm weather as it is."""
    ship, speed, _ = the("cargo90")
    start = ship.start(0.0, 0.0, 0.0, speed)
    west = simulate(ship, straight(), start, 30, sea=Sea(wind=np.array([0.0, 12.0])))[0]
    ahead = simulate(ship, straight(), start, 30, sea=Sea(wind=np.array([-12.0, 0.0])))[0]
    assert west.sway[-1] > 0.01
    assert west.truth()["wind_from_grid_rad"].iloc[0] == pytest.approx(1.5 * np.pi)
    assert ahead.surge[-1] < speed - 0.01 and not ahead.sway.any()


def test_known_orders_run_like_a_helm():
    """Oracle: the step-by-step integration, bit by bit, with a current, wind and different shafts."""
    ship, speed, shaft = the("cargo90")
    start = ship.start([0.0, 5.0], 0.0, [0.3, 2.0], speed)
    helm = turning_circle(0.5, 10.0)
    sea = Sea(current=np.array([[0.2, 0.1], [0.0, -0.5]]), wind=np.array([[3.0, 4.0], [0.0, 0.0]]))
    shafts = np.array([shaft, 0.8 * shaft])
    voyages = simulate(ship, helm, start, 60, shafts, sea=sea)
    orders = np.array([voyage.order[:-1] for voyage in voyages])
    paths = run_on(ship, start, orders, shafts[:, None], sea=sea)
    for voyage, path in zip(voyages, paths, strict=True):
        np.testing.assert_array_equal(
            np.column_stack([voyage.north, voyage.heading, voyage.rudder]), path[:, [0, 2, 6]]
        )


def test_a_ship_with_its_engine_stopped_runs_out():
    """Oracle: quadratic drag of hull and stopped propeller, u = u0 / (1 + k u0 t); astern it runs out too, without turning."""
    ship, speed = the("cargo90")[0], 4.0
    p = ship.model
    drag = p.Lpp * p.d * p.R_0 / 2 - (1 - p.t_P) * p.D_P**2 * p.k2 * (1 - p.w_P0) ** 2
    k = drag / (p.nabla + p.m_x * p.Lpp**2 * p.d / 2)
    start = rows(ship, [0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    ahead, astern = run_on(ship, start, np.zeros((2, 6000)), 0.0)
    np.testing.assert_allclose(ahead[:, 3], speed / (1 + k * speed * np.arange(6001) * 0.1), rtol=1e-9)
    assert np.all(np.diff(astern[:, 3]) > 0) and -1.5 < astern[-1, 3] < -0.5
    assert not ahead[:, 4:6].any() and not astern[:, 4:6].any()


def test_rest_and_spin_stay_regular():
    """Law: at rest with the engine stopped nothing moves; a spin on the spot dies out; from rest the engine drives ahead."""
    ship, _, shaft = the("cargo90")
    start = rows(ship, *np.zeros((3, 7)), shaft=[0.0, 0.0, shaft])
    start[1, 5] = 0.05
    path = run_on(ship, start, np.full((3, 6000), 0.3))
    assert np.isfinite(path).all()
    assert not path[0, :, :6].any()
    assert abs(path[1, -1, 5]) < 0.2 * 0.05
    assert path[2, -1, 3] > 1


@pytest.mark.parametrize(
    "change, message",
    [
        ({"Y_v": None}, "vessel cargo90: mmg.Y_v is missing or not a number"),
        ({"x_G": math.nan}, "vessel cargo90: mmg.x_G is missing or not a number"),
        ({"nabla": -1.0}, "vessel cargo90: mmg.nabla = -1 is outside 0.001 to 1e.06; check its unit and sign"),
        ({"nabla": 6.188}, "vessel cargo90: mmg.nabla = 6.188 is 0.0008 of Lpp B d, not 0.3 to 1; check its unit"),
        ({"A_R": 103.0}, "vessel cargo90: mmg.A_R = 103 is 0.186 of Lpp d"),
        ({"w_P0": 1.2}, "vessel cargo90: mmg.w_P0 = 1.2 is outside 0 to 0.8"),
        ({"Y_vr": 1.2}, "vessel cargo90: mmg.Y_vr is not known, did you mean Y_v"),
        ({"D_P": 5.0}, "vessel cargo90: mmg.D_P = 5 is larger than the rudder's span"),
    ],
)
def test_a_wrong_coefficient_is_named(change, message):
    """Oracle: the message names vessel and coefficient."""
    vessel = load_vessel("cargo90")
    with pytest.raises(InputError, match=message):
        Ship.of(replace(vessel, simulator=vessel.simulator | {"mmg": vessel.simulator["mmg"] | change}))


def test_what_cannot_be_simulated_is_said():
    """Oracle: the messages."""
    vessel = load_vessel("cargo90")
    with pytest.raises(InputError, match="has none of the sections mmg, mariner"):
        Ship.of(replace(vessel, simulator={}))
    with pytest.raises(InputError, match=r"wind\.A_L is missing"):
        Ship.of(replace(vessel, simulator=vessel.simulator | {"wind": {"A_F": 1.0}}))
    calm = {key: value for key, value in vessel.simulator.items() if key != "wind"}
    ship = Ship.of(replace(vessel, simulator=calm))
    start = ship.start(0.0, 0.0, 0.0, 5.0)
    with pytest.raises(InputError, match="has no section wind"):
        run_on(ship, start, np.zeros((1, 2)), sea=Sea(wind=np.array([1.0, 0.0])))
    with pytest.raises(InputError, match=r"a shaft order \[rev/s\] of -50 is beyond the stops"):
        run_on(ship, start, np.zeros((1, 2)), -50.0)


def test_a_file_of_ones_own_is_named(tmp_path):
    """Oracle: the message names the file that the user wrote, not the vessel it says it is."""
    data = load_vessel("cargo90").to_dict()
    data["mmg"]["Y_v"] = 37.0
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"mine\.json: mmg\.Y_v = 37 is outside -3 to 3; check its unit and sign"):
        Ship.of(load_vessel(path))
