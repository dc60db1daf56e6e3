"""The workboat against the parameter set it is scaled from, what is published of the real boat, and forces at rest by hand."""

import json
import math

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

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
from aspnn.schema import InputError
from aspnn.simulation.ships.dynamics import accelerations
from aspnn.simulation.ships.workboat import Workboat
from aspnn.vessel import FOLDER, from_dict, load_vessel

NU = [SURGE, SWAY, HEAVE, ROLL_RATE, PITCH_RATE, YAW_RATE]
ATTITUDE = [DOWN, ROLL, PITCH]
VIKNES = {"D_u": 50.0, "D_uu": 135.0, "D_v": 200.0, "D_vv": 2000.0, "D_r": 1281.0, "D_rrr": 3224.0}
KNOT = 1852 / 3600


def the(**changed):
    data = load_vessel("workboat8").to_dict()
    data["workboat"] = data["workboat"] | changed
    return Workboat.of(from_dict(data))


@njit
def at_levers(model, x, out):
    accelerations(model, x, np.zeros(6), out)


def derivatives(model, lever, shaft, nu=(0,) * 6, attitude=(0,) * 3):
    x, out = np.zeros(SIX), np.zeros(SIX)
    x[NU], x[ATTITUDE], x[RUDDER], x[SHAFT] = nu, attitude, math.radians(lever), shaft
    at_levers(model, x, out)
    return out


def unsteady(model, lever, shaft, y):
    """Derivatives (9) of y = (u, v, w, p, q, r, down, roll, pitch)."""
    roll, pitch = y[7:]
    s, c = math.sin(roll), math.cos(roll)
    down = -math.sin(pitch) * y[0] + math.cos(pitch) * (s * y[1] + c * y[2])
    rolling, pitching = y[3] + (s * y[4] + c * y[5]) * math.tan(pitch), c * y[4] - s * y[5]
    return np.array([*derivatives(model, lever, shaft, y[:6], y[6:])[NU], down, rolling, pitching])


def steady(model, lever, shaft, speed):
    """The motion (u, v, w, p, q, r, down, roll, pitch) two minutes after a straight course at `speed` [m/s]."""
    start = [speed, 0, 0, 0, 0, 0, 0, 0, 0.0]
    return solve_ivp(lambda t, y: unsteady(model, lever, shaft, y), (0, 120), start, "LSODA", rtol=1e-8, atol=1e-10).y[
        :, -1
    ]


def test_damping_is_the_viknes_set_by_froude():
    """Oracle: forces by the ratio of mass, lengths by that of length, speeds by its root, applied to the published set."""
    section = json.loads((FOLDER / "workboat8.json").read_text())["workboat"]
    force, length = section["m"] / 3980, section["L"] / 8.45
    speed, rate = math.sqrt(length), 1 / math.sqrt(length)
    units = {"D_u": 1 / speed, "D_uu": 1 / speed**2, "D_v": 1 / speed, "D_vv": 1 / speed**2}
    units |= {"D_r": length / rate, "D_rrr": length / rate**3}
    for name, published in VIKNES.items():
        assert section[name] == pytest.approx(published * force * units[name], rel=2e-3), name
    assert section["m"] * section["R66"] ** 2 == pytest.approx(19703 * force * length**2, rel=2e-3)


def test_viknes_itself_runs_its_speed():
    """Oracle: 9.67 m/s at 13.1 kN, the published limit of the Viknes set on its own resistance, without planing and trim."""
    viknes = the(m=3980.0, L=8.45, U_p=1e6, trim_deg=0.0, m_z=0.0, k_pos=10.0, k_u=0.0, **VIKNES)
    n = viknes.balance(9.67)[0]
    assert 10 * n**2 == pytest.approx(13_100, rel=3e-3)


def test_thirty_knots():
    """Oracle: about 30 kn, of the real boat (thesis, Paper VI, Table 1), here at 30 rev/s; and the shaft for 8 m/s holds 8 m/s."""
    model = the()
    assert steady(model, 0, 30.0, 15.0)[0] == pytest.approx(30 * KNOT, rel=0.01)
    assert steady(model, 0, model.balance(8.0)[0], 8.0)[0] == pytest.approx(8.0, rel=1e-6)
    assert steady(model, 0, model.balance(-2.0)[0], -2.0)[0] == pytest.approx(-2.0, rel=1e-6)


@pytest.mark.parametrize("lever", [-30, -10, 10, 30])
def test_turns_like_a_small_boat(lever):
    """Law: what boats of this kind do, not this boat's figures. Full engine: yaw rate of at most 30 deg/s to the lever's side, banked
    into the turn by at most 20 degrees, slower than straight, drifting outward by at most 15 degrees. Slow: heeled outward."""
    u, v, _, _, _, r, _, roll, _ = steady(the(), lever, 30.0, 15.0)
    side = math.copysign(1, lever)
    assert 0 < side * math.degrees(r) < 30
    assert 2 < side * math.degrees(roll) < 20
    assert u < 14.5
    assert 0 < math.degrees(math.atan2(-side * v, u)) < 15
    assert -2 < side * math.degrees(steady(the(), lever, 8.0, 2.0)[7]) < 0


def test_full_lever_turns_fast_at_speed():
    """Regression: 24.5 deg/s and 8.2 m/s in the steady turn at full engine and lever; the yaw rate is bounded by the forces alone."""
    u, _, _, _, _, r, *_ = steady(the(), 30, 30.0, 15.0)
    assert math.degrees(r) == pytest.approx(24.5, abs=0.3)
    assert u == pytest.approx(8.2, abs=0.1)


@pytest.mark.parametrize("lever, shaft", [(0, 20.0), (30, 20.0), (-15, 30.0), (20, -10.0)])
def test_thrust_follows_the_drive(lever, shaft):
    """Oracle: at rest M nu' is the thrust k n |n| along the drive at (x_n, z_n): its force and moments by the cross product."""
    model = the()
    thrust = (model.k_pos if shaft > 0 else model.k_neg) * shaft * abs(shaft)
    force = thrust * np.array([math.cos(math.radians(lever)), -math.sin(math.radians(lever)), 0])
    load = model.body.mass @ derivatives(model, lever, shaft)[NU]
    np.testing.assert_allclose(load, [*force, *np.cross([model.x_n, 0, model.z_n], force)], atol=1e-8)


def test_without_thrust_only_the_leg_steers():
    """Oracle: shaft stopped, the lever changes M nu' by leg u |u| sin(lever) across the leg, nothing at rest, and to starboard turns
    the boat to starboard when it runs ahead."""
    model, angle = the(), math.radians(20)
    np.testing.assert_allclose(derivatives(model, 20, 0.0)[NU], 0, atol=1e-12)
    for u in (6.0, -2.0):
        nu = (u, 0, 0, 0, 0, 0)
        change = model.body.mass @ (derivatives(model, 20, 0.0, nu) - derivatives(model, 0, 0.0, nu))[NU]
        force = -model.leg * u * abs(u) * math.sin(angle) * np.array([math.sin(angle), math.cos(angle), 0])
        np.testing.assert_allclose(change, [*force, *np.cross([model.x_n, 0, model.z_n], force)], atol=1e-8)
        assert math.copysign(1, change[5]) == math.copysign(1, u)


@pytest.mark.parametrize("speed", [9.0, 2.0, -3.0])
def test_hull_forces_act_where_the_water_passes(speed):
    """Oracle: drag and lifts as forces against the velocity v + omega x r of the place they act at, their moments by r x F: strips
    of sway drag at z_d, the lifts at the trailing end, the side lift as high as the speed puts it. Resistance and the plain yaw
    damping are added; springs are off."""
    model, rng, strips = the(), np.random.default_rng(1), np.zeros((4000, 3))
    springs = dict.fromkeys(("G33", "G35", "G44", "G55", "D33", "D44", "D55"), 0.0)
    model = model._replace(body=model.body._replace(**springs))
    strips[:, 0], strips[:, 2] = -4 + (np.arange(4000) + 0.5) / 500, model.z_d
    for nu in rng.normal(0, 1, (10, 6)) * [0, 1, 1, 0.5, 0.5, 0.5] + [speed, 0, 0, 0, 0, 0]:
        P, H = np.split(model.body.mass @ nu, 2)
        coriolis = np.concatenate([np.cross(nu[3:], P), np.cross(nu[3:], H) + np.cross(nu[:3], P)])
        s = speed**2 / (speed**2 + model.U_p**2)
        end = math.copysign(model.x_l, -speed)
        places = np.vstack(
            [strips, [[0, 0, model.z_d], [end, 0, model.z_d + s * (model.z_l - model.z_d)], [end, 0, 0]]]
        )
        sway, heave = (nu[:3] + np.cross(nu[3:], places))[:, 1:].T
        force = np.zeros_like(places)
        force[:4000, 1] = -model.D_vv / 4000 * np.abs(sway[:4000]) * sway[:4000]
        force[4000, 1] = -model.D_v * sway[4000]
        force[4001, 1] = -model.m_y * abs(speed) * sway[4001]
        force[4002, 2] = -model.m_z * abs(speed) * heave[4002]
        expected = np.concatenate([force.sum(axis=0), np.cross(places, force).sum(axis=0)])
        expected[0] -= model.D_u * speed + model.D_uu * speed * abs(speed) / (1 + (speed / model.U_p) ** 2)
        expected[5] -= model.D_r * nu[5] + model.D_rrr * nu[5] ** 3
        load = model.body.mass @ derivatives(model, 0, 0.0, nu)[NU] + coriolis
        np.testing.assert_allclose(load, expected, rtol=1e-5, atol=0.1)


def test_course_stable_at_every_speed():
    """Law: no eigenvalue of the boat on a straight course, idle to full, has a positive real part: no spin, no porpoising."""
    model = the()
    for shaft in (3.0, 8.0, 13.0, 18.0, 23.0, 30.0):
        y = steady(model, 0, shaft, 0.5 * shaft)
        shifts = 1e-5 * np.vstack([np.eye(9), -np.eye(9)])
        out = np.array([unsteady(model, 0, shaft, row) for row in y + shifts])
        modes = np.linalg.eigvals((out[:9] - out[9:]).T / 2e-5)
        assert modes.real.max() < 0


@pytest.mark.parametrize("changed, message", [({"GM": 1.0}, "GM is not known"), ({"m": 3.0}, "check its unit")])
def test_bad_vessel_files(changed, message):
    """Law: one line that names the vessel and the coefficient."""
    with pytest.raises(InputError, match=message) as error:
        the(**changed)
    assert "vessel workboat8: workboat." in str(error.value) and "\n" not in str(error.value)
