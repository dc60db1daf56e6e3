"""Shallow water: against an independent regression, values worked by hand, limits and trends."""

import math

import numpy as np
import pytest
from numba import njit

from aspnn.schema import InputError
from aspnn.simulation.ships.dynamics import accelerations
from aspnn.simulation.ships.mmg import Mmg
from aspnn.simulation.ships.shallow import factors, shallow
from aspnn.vessel import load_vessel

SHIPS = ("cargo90", "kvlcc2_l7", "kvlcc2_full")


def the(name):
    """The ship, its beam and block coefficient."""
    vessel = load_vessel(name)
    mmg = Mmg.of(vessel)
    return mmg, vessel.beam, mmg.nabla / (mmg.Lpp * vessel.beam * mmg.d)


@pytest.mark.parametrize(
    "ratio, by_hand",
    [
        (1.5, {"m_y": 1.740, "J_z": 1.606, "Y_v": 1.849, "Y_r": 1.471, "N_v": 2.133, "N_r": 1.566, "R_0": 1.1724}),
        (1.2, {"m_y": 3.343, "Y_v": 3.757, "N_v": 4.467, "N_r": 2.838, "R_0": 1.2694}),
    ],
)
def test_factors_worked_by_hand(ratio, by_hand):
    """Oracle: the formulas worked by hand for KVLCC2 (L 320, B 58, d 20.8 m, C_b 0.81), to four figures."""
    found = factors(320.0, 58.0, 20.8, 0.81, ratio * 20.8)
    for name, value in by_hand.items():
        assert found[name] == pytest.approx(value, rel=1e-3), name


@pytest.mark.parametrize("name", SHIPS)
@pytest.mark.parametrize("ratio", [1.2, 1.3, 1.5, 2.0, 3.0])
def test_against_another_regression(name, ratio):
    """Oracle: the factors of Y_v and N_v (1 - q)^-n - q, with q = d / depth and n = 0.4 (0.425) C_b B / d, as used by
    Maimun et al. (2011), doi 10.1016/j.oceaneng.2011.05.011 (transcription): other models, other authors; within 30 %.
    """
    mmg, beam, C_b = the(name)
    found = factors(mmg.Lpp, beam, mmg.d, C_b, ratio * mmg.d)
    q = 1 / ratio
    for key, slope in (("Y_v", 0.4), ("N_v", 0.425)):
        assert found[key] == pytest.approx((1 - q) ** (-slope * C_b * beam / mmg.d) - q, rel=0.30)


@pytest.mark.parametrize("name", SHIPS)
def test_deep_water_is_the_limit(name):
    """Law: at infinite depth nothing changes (to round-off), at 100 draughts no coefficient by more than 0.3 % of itself; t_P
    and w_P0 enter as 1 - t_P and 1 - w_P0.
    """
    mmg, beam, _ = the(name)

    def numbers(ship):
        changed = ship._replace(t_P=1 - ship.t_P, w_P0=1 - ship.w_P0)
        return np.array([getattr(changed, field) for field in Mmg._fields if field != "propeller"])

    deep = numbers(mmg)
    np.testing.assert_allclose(numbers(shallow(mmg, beam, math.inf)), deep, rtol=1e-15)
    np.testing.assert_allclose(numbers(shallow(mmg, beam, 100 * mmg.d)), deep, rtol=3e-3)


@pytest.mark.parametrize("name", SHIPS)
def test_forces_grow_as_the_water_shoals(name):
    """Law: damping, added mass and resistance grow all the way from 3 draughts to 1.2."""
    mmg, beam, _ = the(name)
    ships = [shallow(mmg, beam, ratio * mmg.d) for ratio in np.linspace(3.0, 1.2, 19)]
    for key in ("m_y", "J_z", "R_0", "Y_v", "N_v", "N_r", "Y_vvv"):
        assert np.all(np.diff([abs(getattr(ship, key)) for ship in ships]) > 0), key


def stability(mmg):
    """Course-stability index Y_v (N_r - m' x_G') - N_v (Y_r - m' - m_x'); positive: the ship keeps its course."""
    m = 2 * mmg.nabla / (mmg.Lpp**2 * mmg.d)
    return mmg.Y_v * (mmg.N_r - m * mmg.x_G / mmg.Lpp) - mmg.N_v * (mmg.Y_r - m - mmg.m_x)


@pytest.mark.parametrize("name", SHIPS)
def test_course_stability(name):
    """Law (as known of full ships): a little less stable in water of 2 to 3 draughts than in deep, much more so below 1.5."""
    mmg, beam, _ = the(name)
    deep, middle, very = (stability(shallow(mmg, beam, ratio * mmg.d)) for ratio in (math.inf, 3.0, 1.2))
    assert middle < deep < 0.0 < 0.05 < very


@njit
def turn(ship, rudder, rate, speed, shaft, pitch, dt, path):
    """A turning circle into `path` (steps, 9): classical Runge-Kutta steps in still water, the rudder moved at `rate`."""
    x, y, k, load = np.zeros(9), np.zeros(9), np.zeros((4, 9)), np.zeros(6)
    x[3], x[7], x[8] = speed, shaft, pitch
    for step in range(path.shape[0]):
        path[step] = x
        x[6] = min(x[6] + rate * dt, rudder)
        for stage in range(4):
            y[:] = x
            if stage > 0:
                y[:6] += (dt if stage == 3 else dt / 2) * k[stage - 1, :6]
            c, s = math.cos(y[2]), math.sin(y[2])
            k[stage, 0], k[stage, 1], k[stage, 2] = y[3] * c - y[4] * s, y[3] * s + y[4] * c, y[5]
            accelerations(ship, y, load, k[stage])
        x[:6] += dt / 6 * (k[0, :6] + 2 * k[1, :6] + 2 * k[2, :6] + k[3, :6])


def circle(mmg, vessel):
    """Tactical diameter over length, and drift [rad] and speed over approach speed of the steady turn at 35 degrees of rudder."""
    speed = 0.4 * vessel.service_speed
    shaft, _ = mmg.balance(speed)
    path = np.empty((6000, 9))
    unit = mmg.Lpp / speed
    turn(mmg, math.radians(35), vessel.rudder_rate, speed, shaft, mmg.propeller.service, unit / 150, path)
    assert np.isfinite(path).all()
    half = path[np.argmax(path[:, 2] >= np.pi)]
    u, v = path[-1, 3:5]
    return half[1] / mmg.Lpp, math.atan2(-v, u), math.hypot(u, v) / speed


@pytest.mark.parametrize("name", ["cargo90", "kvlcc2_full"])
def test_turning_circles_grow(name):
    """Law (as known from trials): as the water shoals, circles grow, to about twice at 1.2 draughts, with less drift and loss of speed."""
    vessel = load_vessel(name)
    mmg = Mmg.of(vessel)
    ships = (shallow(mmg, vessel.beam, ratio * mmg.d) for ratio in (math.inf, 3.0, 1.5, 1.2))
    diameter, drift, speed = np.transpose([circle(ship, vessel) for ship in ships])
    assert np.all(np.diff(diameter) > 0.05) and 1.5 < diameter[-1] / diameter[0] < 3.0
    assert np.all(np.diff(drift) < 0) and np.all(np.diff(speed) > 0)


@pytest.mark.parametrize(
    "depth, beam, said", [(1.1, 2.0, "below the 1.2"), (-3.0, 2.0, "below"), (2.0, 4.5, "above the 4")]
)
def test_outside_the_domain(depth, beam, said):
    """Law: a depth or beam (in draughts) that the source does not cover is refused in one line."""
    mmg = the("cargo90")[0]
    with pytest.raises(InputError, match=said) as caught:
        shallow(mmg, beam * mmg.d, depth * mmg.d)
    assert "\n" not in str(caught.value)


def test_no_depth_is_refused():
    """Law: a depth that is not a number is refused like one that is too small."""
    with pytest.raises(InputError):
        shallow(the("cargo90")[0], 14.0, math.nan)
