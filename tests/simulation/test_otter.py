"""The Otter against figures of the source, an independent transcription of its equations, and exact allocation."""

import math

import numpy as np
import pytest
from numba import njit
from scipy.optimize import root

from aspnn.guidance.allocation import allocate
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
from aspnn.simulation.ships.otter import Otter, propelled
from aspnn.vessel import from_dict, load_vessel

NU = [SURGE, SWAY, HEAVE, ROLL_RATE, PITCH_RATE, YAW_RATE]
ATTITUDE = [DOWN, ROLL, PITCH]
CALM = np.zeros(6)
ARM, K_POS, K_NEG = 0.395, 0.01108, 0.006445
AHEAD, ASTERN = 0.5 * 24.4 * 9.81, 0.5 * 13.6 * 9.81  # N, greatest thrusts of one propeller


def the(**changed):
    data = load_vessel("otter").to_dict()
    data["otter"] = data["otter"] | changed
    return Otter.of(from_dict(data))


@njit
def at_levers(model, x, out):
    accelerations(model, x, np.zeros(6), out)


def steady(model, n_port, n_starboard, guess):
    """The steady motion (u, v, w, p, q, r, down, roll, pitch) at two propeller speeds [rad/s]."""
    out = np.zeros(SIX)

    def unsteady(y):
        x = np.zeros(SIX)
        x[NU], x[ATTITUDE] = y[:6], y[6:]
        propelled(model, x, n_port, n_starboard, CALM, out)
        return np.concatenate([out[NU], attitude_rates(y[:6], y[7], y[8])])

    found = root(unsteady, guess, tol=1e-10)
    assert found.success
    return found.x


def attitude_rates(nu, roll, pitch):
    u, v, w, p, q, r = nu
    s, c = math.sin(roll), math.cos(roll)
    down = -math.sin(pitch) * u + math.cos(pitch) * (s * v + c * w)
    return np.array([down, p + (s * q + c * r) * math.tan(pitch), c * q - s * r])


# --- the source, transcribed: MSS otter.m and crossFlowDrag.m of July 2026, matrices and strips as there


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


class Source:
    """Matrices of the source for 25 kg of payload; `inertia` replaces the yaw mass M66, `strips` are the stations of the drag."""

    def __init__(self, strips, inertia=None):
        m, mp, rho, g = 55.0, 25.0, 1025.0, 9.81
        self.strips, self.rp = strips, np.array([0.05, 0, -0.35])
        rg = (m * np.array([0.2, 0, -0.2]) + mp * self.rp) / (m + mp)
        Ig = m * np.diag([0.432, 0.5, 0.5]) ** 2
        for part, r in ((m, np.array([0.2, 0, -0.2]) - rg), (mp, self.rp - rg)):
            Ig -= part * skew(r) @ skew(r)
        H = np.eye(6)
        H[:3, 3:] = skew(rg).T
        rigid = np.zeros((6, 6))
        rigid[:3, :3], rigid[3:, 3:] = (m + mp) * np.eye(3), Ig
        added = [2.7 * rho * (m / rho) ** (5 / 3) / 4, 1.5 * m, m, 0.2 * Ig[0, 0], 0.8 * Ig[1, 1], 1.7 * Ig[2, 2]]
        self.M = H.T @ rigid @ H + np.diag(added)
        if inertia:
            self.M[5, 5] = inertia
        volume = (m + mp) / rho
        T = volume / (2 * 0.4 * 0.25 * 2)
        area, C = 0.75 * 2 * 0.25, 0.75
        I_T = 2 / 12 * 2 * 0.25**3 * (6 * C**3 / ((1 + C) * (1 + 2 * C))) + 2 * area * ARM**2
        KB, KG = (5 * T / 2 - 0.5 * volume / 0.5) / 3, T - rg[2]
        self.GM = KB + I_T / volume - KG, KB + 0.8 * 2 / 12 * 0.25 * 8 / volume - KG
        self.G = np.diag([0, 0, rho * g * 2 * area, *(rho * g * volume * np.array(self.GM)), 0])
        omega = np.sqrt(np.diag(self.G)[2:5] / np.diag(self.M)[2:5])
        damping = 2 * np.array([0.3, 0.2, 0.4]) * omega * np.diag(self.M)[2:5]
        self.D = np.array([24.4 * g / 3.0864, self.M[1, 1], *damping, self.M[5, 5]])
        H[:3, 3:] = skew([-0.2, 0, 0]).T
        self.G = H.T @ self.G @ H
        self.k = 0.5 * rho * T * 1.0042099953598398

    def rates(self, nu, eta, n):
        thrust = [(K_POS if a > 0 else K_NEG) * a * abs(a) for a in n]
        tau = np.array([thrust[0] + thrust[1], 0, 0, 0, 0, ARM * (thrust[0] - thrust[1])])
        tau -= self.D * nu * [1, 1, 1, 1, 1, 1 + 10 * abs(nu[5])]
        x, dx = self.strips, 0.1
        for force, moment, a, b in ((1, 5, nu[1], nu[5]), (2, 4, nu[2], nu[4])):
            flow = (a + x * b) * np.abs(a + x * b) * dx * self.k
            tau[force] -= flow.sum()
            tau[moment] -= (x * flow).sum()
        P, H = self.M[:3] @ nu, self.M[3:] @ nu
        C = np.block([[np.zeros((3, 3)), -skew(P)], [-skew(P), -skew(H)]])
        s, c, t = math.sin(eta[1]), math.cos(eta[1]), eta[2]
        weight = 25 * 9.81 * np.array([-math.sin(t), math.cos(t) * s, math.cos(t) * c])
        load = np.array([weight[2], *np.cross(self.rp, weight)[:2]])
        shifted = eta - np.linalg.solve(self.G[2:5, 2:5], load)
        tau[2:5] -= self.G[2:5, 2:5] @ shifted
        return np.concatenate([np.linalg.solve(self.M, tau - C @ nu), attitude_rates(nu, eta[1], eta[2])])

    def turn(self, n):
        found = root(lambda y: self.rates(y[:6], y[6:], n), [2.2, -0.2, 0, 0, 0, 0.2, 0, 0, 0], tol=1e-10)
        assert found.success
        return found.x


MIDDLES = -1 + (np.arange(20) + 0.5) * 0.1
ENDS = np.linspace(-1, 1, 21)  # as MSS had it until August 2026


def test_matrices_are_those_of_the_source():
    """Oracle: figures that MSS otter.m gives for 25 kg of payload: diagonals of M and D, metacentric heights, C_d, limits of n."""
    model = the()
    body, weight = model.body, 80 * 9.81
    M = [85.2815210095764, 162.5, 135.0, 17.65702775, 32.89375, 40.044921875]
    np.testing.assert_allclose(np.diag(body.mass), M, rtol=1e-12)
    D = [77.55443234836703, 162.5, 605.4038837833798, 52.27472964794131, 226.72216878653106, 40.044921875]
    np.testing.assert_allclose([model.D11, model.D22, body.D33, body.D44, body.D55, model.D66], D, rtol=1e-12)
    assert body.G44 / weight == pytest.approx(1.2325002449912894, rel=1e-12)
    assert (body.G55 - 0.2**2 * body.G33) / weight == pytest.approx(3.111255081300813, rel=1e-12)
    assert model.cross == pytest.approx(0.5 * 1025 * 0.19512195121951217 * 1.0042099953598398, rel=1e-12)
    assert allocate(model, 1e9, 0.0) == pytest.approx((103.93086427398005,) * 2, rel=1e-12)
    assert allocate(model, -1e9, 0.0) == pytest.approx((-101.73666550381692,) * 2, rel=1e-12)
    np.testing.assert_allclose(body.mass, Source(MIDDLES).M, rtol=1e-12, atol=1e-12)


def test_top_speed_is_six_knots():
    """Oracle: the design speed of the source, 6 x 0.5144 m/s, which its drag is fitted to; the trim's drag costs 0.03 %."""
    u = steady(the(), 200.0, 200.0, [3, 0, 0, 0, 0, 0, 0, 0, 0])[0]
    assert u == pytest.approx(3.0864, rel=5e-4)


def test_transcription_gives_the_figures_once_published():
    """Oracle: u 2.244 m/s, v -0.208 m/s, r 14.23 deg/s at (100, 80) rad/s, an earlier port of the source as it was, with its
    inertia in yaw of 42.65 and its 21 stations for 20 strips (r is met to 0.1 %)."""
    x = Source(ENDS, 42.65145019531249).turn((100, 80))
    assert x[:2] == pytest.approx([2.244, -0.208], abs=1e-3)
    assert math.degrees(x[5]) == pytest.approx(14.23, abs=0.015)


@pytest.mark.parametrize("inertia", [None, 42.65145019531249])
@pytest.mark.parametrize("n", [(100, 80), (60, 100), (90, -40)])
def test_turns_as_the_source(n, inertia):
    """Oracle: the transcription above, strips at their middles. Where its dampers act along the trimmed axes and ours against the
    water's surface the speeds differ by 1 % of the boat's at most, the yaw rate by 1 %."""
    model = the()
    if inertia:
        mass = model.body.mass + np.diag([0, 0, 0, 0, 0, inertia - model.body.mass[5, 5]])
        model = model._replace(D66=inertia, body=model.body._replace(mass=mass, inverse=np.linalg.inv(mass)))
    theirs = Source(MIDDLES, inertia).turn(n)
    ours = steady(model, *map(float, n), theirs)
    np.testing.assert_allclose(ours[:2], theirs[:2], atol=0.01 * theirs[0])
    assert ours[5] == pytest.approx(theirs[5], rel=0.01)


def forces(n_port, n_starboard):
    """(60) of paper 001, with each direction's own k."""
    port, starboard = ((K_POS if n > 0 else K_NEG) * n * abs(n) for n in (n_port, n_starboard))
    return port + starboard, ARM * (port - starboard)


def test_allocation_inverts_the_propellers():
    """Oracle: the forces of the propellers, (60) of paper 001, at the allocated speeds are what was asked, wherever both can give it."""
    model, rng = the(), np.random.default_rng(1)
    for port, starboard in rng.uniform(-ASTERN, AHEAD, (200, 2)):
        asked = port + starboard, ARM * (port - starboard)
        assert forces(*allocate(model, *asked)) == pytest.approx(asked, abs=1e-9)


def test_steering_wins_when_propellers_saturate():
    """Law: with too much asked the moment is kept up to the largest there is, ARM (AHEAD + ASTERN), and no surge force nearer
    to the one asked leaves it (found by trying all thrusts of one propeller)."""
    model, rng = the(), np.random.default_rng(2)
    for X, N in rng.uniform(-1, 1, (200, 2)) * [500, 120]:
        surge, moment = forces(*allocate(model, X, N))
        largest = ARM * (AHEAD + ASTERN)
        assert moment == pytest.approx(max(-largest, min(N, largest)), abs=1e-9)
        port = np.linspace(-ASTERN, AHEAD, 20_001)
        starboard = port - moment / ARM
        possible = (starboard > -ASTERN - 1e-6) & (starboard < AHEAD + 1e-6)
        best = np.abs((port + starboard)[possible] - X).min()
        assert abs(surge - X) == pytest.approx(best, abs=0.05)


@pytest.mark.parametrize("lever, shaft", [(35, 0.0), (-35, 0.0), (10, 0.0), (-20, 6.0), (35, 16.5), (0, -10.0)])
def test_levers(lever, shaft):
    """Oracle: full lever is the moment 2 ARM ASTERN, half lever half of it, the shaft 2 k n |n| of surge force; at rest
    M nu' is then that force and moment through `forces(allocate(...))`."""
    model = the()
    x, out = np.zeros(SIX), np.zeros(SIX)
    x[PITCH], x[RUDDER], x[SHAFT] = model.body.pitch, math.radians(lever), shaft
    at_levers(model, x, out)
    n = 2 * math.pi * shaft
    asked = 2 * (K_POS if n > 0 else K_NEG) * n * abs(n), 2 * ARM * ASTERN * lever / 35
    surge, moment = forces(*allocate(model, *asked))
    np.testing.assert_allclose(model.body.mass @ out[NU], [surge, 0, 0, 0, 0, moment], atol=1e-9)
    assert moment == pytest.approx(asked[1], abs=1e-9)


def test_cross_flow_acts_where_the_water_passes():
    """Oracle: -k |f| f dx on 4000 strips, f the velocity v + omega x r of each place on the centre line, athwart and downward, the
    moments by r x F. What M nu' and the momentum leave, without springs and linear damping, is that."""
    model, rng, places = the(), np.random.default_rng(3), np.zeros((4000, 3))
    body = model.body._replace(**dict.fromkeys(("G33", "G35", "G44", "G55", "D33", "D44", "D55"), 0.0))
    model = model._replace(body=body, D11=0.0, D22=0.0, D66=0.0)
    places[:, 0] = -1 + (np.arange(4000) + 0.5) / 2000
    for nu in rng.normal(0, 1, (20, 6)):
        x, out = np.zeros(SIX), np.zeros(SIX)
        x[NU] = nu
        propelled(model, x, 0.0, 0.0, CALM, out)
        P, H = np.split(body.mass @ nu, 2)
        coriolis = np.concatenate([np.cross(nu[3:], P), np.cross(nu[3:], H) + np.cross(nu[:3], P)])
        flow = (nu[:3] + np.cross(nu[3:], places)) * [0, 1, 1]
        drag = -model.cross * np.abs(flow) * flow / 2000
        expected = np.concatenate([drag.sum(axis=0), np.cross(places, drag).sum(axis=0)])
        np.testing.assert_allclose(body.mass @ out[NU] + coriolis, expected, atol=1e-3)


def test_payload_trims_and_heels():
    """Oracle: by hand. The payload weighs 0.25 m ahead of the centre of flotation: it trims by W 0.25 / (weight GM_L), bow
    down; moved 0.05 m to starboard it heels by W 0.05 / (weight GM_T), starboard down."""
    W, body = 25 * 9.81, the(y_p=0.05).body
    assert body.pitch == pytest.approx(-W * 0.25 / (80 * 9.81 * 3.111255081300813), rel=1e-6)
    assert body.roll == pytest.approx(W * 0.05 / body.G44, rel=1e-12) and body.roll > 0


def test_balance():
    """Oracle: linear drag. 1.5 m/s needs 2 k n^2 = D 1.5, with n in rad/s; a speed beyond 6 kn is refused."""
    n = 2 * math.pi * the().balance(1.5)[0]
    assert 2 * K_POS * n**2 == pytest.approx(24.4 * 9.81 / 3.0864 * 1.5)
    with pytest.raises(InputError, match=r"cannot hold 4 m/s.*3\.086 m/s ahead"):
        the().balance(4.0)


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"mp": 25.0}, "otter.mp is not known, did you mean m_p"),
        ({"z_p": -4.9}, "capsize"),
        ({"L": 200.0}, "check its unit"),
    ],
)
def test_bad_vessel_files(changed, message):
    """Law: one line that names the vessel and the coefficient."""
    with pytest.raises(InputError, match=message) as error:
        the(**changed)
    assert "vessel otter" in str(error.value) and "\n" not in str(error.value)
