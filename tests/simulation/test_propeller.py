"""The propeller in four quadrants: against published series and parameters, exact polynomials and laws."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from aspnn.schema import InputError
from aspnn.simulation.ships.propeller import BLADE, Propeller, lateral, rudder_flow, thrust
from aspnn.simulation.ships.wageningen import PITCH_RATIOS, thrust_coefficient
from aspnn.vessel import load_vessel

REFERENCE = Path(__file__).parents[1] / "reference"
SHIPS = ("cargo90", "kvlcc2_l7", "kvlcc2_full")
PITCHES = (-1.2, -0.75, -0.3, -0.1, 0.0, 0.2, 0.55, 1.0131211430885794, 1.2)


def the(name):
    return Propeller.of(load_vessel(name))


def changed(name, section, **values):
    """The vessel `name` with some keys of a simulator section changed; None takes a key out."""
    vessel = load_vessel(name)
    data = {k: v for k, v in (vessel.simulator.get(section, {}) | values).items() if v is not None}
    return replace(vessel, simulator=vessel.simulator | {section: data})


def table(vessel):
    return {float(ratio): row for ratio, row in vessel.simulator["propeller"]["table"].items()}


@njit
def along(p, n, inflow, pitch):
    out = np.empty(len(n))
    for i in range(len(n)):
        out[i] = thrust(p, n[i], inflow[i], pitch)
    return out


def round_the_quadrants(p, points=7201):
    """n and u_P at unit |(BLADE n D, u_P)|, once round from -180 degrees."""
    beta = np.linspace(-np.pi, np.pi, points)
    return beta, np.cos(beta) / (BLADE * p.D), np.sin(beta)


@pytest.mark.parametrize("name", SHIPS)
def test_ahead_is_the_polynomial(name):
    """Oracle: k0 n^2 D^2 + k1 n D u_P + k2 u_P^2 of the vessel file, to the last bit, at the service pitch and at NaN."""
    p, m = the(name), load_vessel(name).simulator["mmg"]
    for n in (1e-6, 0.3, 1.7, 12.0):
        for u in (0.0, 1e-9, 0.8, 6.0):
            exact = (m["k0"] * n * n * p.D + m["k1"] * n * u) * p.D + m["k2"] * u * u
            assert thrust(p, n, u, p.service) == exact
            assert thrust(p, n, u, math.nan) == exact
            curve = thrust(p, n, u, np.nextafter(p.service, 2.0))
            np.testing.assert_allclose(curve, exact, rtol=0, atol=1e-12 * (n * n * p.D**2 + u * u))


def test_pitch_table_is_met_at_its_rows():
    """Oracle: the rows of the pitch table (Wageningen B4-55), to round-off; a row left out is found again within 0.001 of K_T."""
    vessel = load_vessel("cargo90")
    p, rows = Propeller.of(vessel), table(vessel)
    without = Propeller.of(
        changed("cargo90", "propeller", table={str(r): row for r, row in rows.items() if r not in (0.5, 0.8)})
    )
    for ratio, (k0, k1, k2) in rows.items():
        for J in (0.0, 0.35, 1.1):
            exact = k0 + k1 * J + k2 * J * J
            assert thrust(p, 1.0, J * p.D, ratio) / p.D**2 == pytest.approx(exact, abs=1e-13)
            assert thrust(without, 1.0, J * p.D, ratio) / p.D**2 == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize("name", SHIPS)
def test_continuous_round_the_quadrants(name):
    """Law: no step at any angle of advance, nor over the pitch ratio: neighbours 0.05 degrees or 1/2000 apart differ by < 0.004."""
    p = the(name)
    for pitch in PITCHES:
        _, n, u = round_the_quadrants(p)
        assert np.abs(np.diff(along(p, n, u, pitch))).max() < 0.004
    pitches = np.linspace(-1.3, 1.3, 5201)
    for n, u in ((1.0, 0.5), (-1.0, 0.5), (1.0, -0.5), (-1.0, -0.5), (0.0, 1.0), (1.0, 0.0)):
        scale = u * u + (BLADE * n * p.D) ** 2
        forces = np.array([thrust(p, n, u, pitch) for pitch in pitches]) / scale
        assert np.abs(np.diff(forces)).max() < 0.004


@pytest.mark.parametrize("name", SHIPS)
@pytest.mark.parametrize("tiny", [1e-12, -1e-12])
def test_borders_meet(name, tiny):
    """Law: either side of n = 0 and of u_P = 0 the thrust is the same, for every pitch ratio."""
    p = the(name)
    for pitch in PITCHES:
        for sign in (-1.0, 1.0):
            assert thrust(p, tiny, sign, pitch) == pytest.approx(thrust(p, 0.0, sign, pitch), abs=1e-9)
            assert thrust(p, sign, tiny, pitch) == pytest.approx(thrust(p, sign, 0.0, pitch), abs=1e-9 * p.D**2 + 1e-9)
    assert thrust(p, 0.0, 0.0, 0.5) == 0.0


@pytest.mark.parametrize("name", SHIPS)
def test_signs(name):
    """Law: full astern on a ship going ahead brakes harder than on one at rest, which gives 60 to 82 % of the bollard ahead (the
    measured propellers, 0.6 to 1.4 pitch ratio: 69 to 80 %); ahead on a ship going astern pushes harder than at rest. Both at
    an advance ratio of -1: at about -0.4 the measured thrust dips below that at rest.
    """
    p = the(name)
    n, u = 1.5, 1.5 * p.D
    ahead, astern = thrust(p, n, 0.0, p.service), thrust(p, -n, 0.0, p.service)
    assert 0.60 < -astern / ahead < 0.82
    assert thrust(p, -n, u, p.service) < 1.5 * astern < 0
    assert thrust(p, n, -u, p.service) > 1.3 * ahead
    if p.controllable:
        assert thrust(p, n, 0.0, -p.service) == astern


@pytest.mark.parametrize("name", SHIPS)
def test_a_stopped_propeller_drags(name):
    """Law: dissipation. A shaft that does not turn takes energy from the flow at every pitch ratio and either way."""
    p = the(name)
    for pitch in np.linspace(-1.2, 1.2, 49):
        assert thrust(p, 0.0, 2.0, pitch) < -0.3
        assert thrust(p, 0.0, -2.0, pitch) > 0.3


def test_mirror_laws():
    """Law: T(-P, n, V) = T(P, -n, V) by a mirror through the shaft; the other hand puts the side force on the other side."""
    p = the("cargo90")
    other = p._replace(hand=-p.hand)
    for pitch in (0.4, 0.9, p.service):
        for n in (-2.0, 1.0, 2.5):
            for u in (-3.0, 0.0, 0.5, 4.0):
                assert thrust(p, n, u, -pitch) == pytest.approx(thrust(p, -n, u, pitch), rel=1e-13, abs=1e-13)
                Y, N = lateral(p, n, u, pitch)
                np.testing.assert_array_equal(lateral(other, n, u, pitch), (-Y, -N))
                np.testing.assert_allclose(lateral(p, -n, u, -pitch), (-Y, -N), rtol=1e-13)


@pytest.mark.parametrize("name", SHIPS)
def test_thrust_goes_with_the_square_of_speed(name):
    """Law: without a scale of its own, T(c n, c V) = c^2 T(n, V) in every quadrant."""
    p = the(name)
    _, n, u = round_the_quadrants(p, 181)
    for pitch in PITCHES:
        np.testing.assert_allclose(along(p, 3 * n, 3 * u, pitch), 9 * along(p, n, u, pitch), rtol=1e-9, atol=1e-9)


def test_series_is_the_published_one():
    """Oracle: the coefficients of pitch ratio 1.0 in tests/reference, summed term by term."""
    rows = np.loadtxt(REFERENCE / "wageningen_b4_70_pitch_1.0.csv", delimiter=",", skiprows=4)
    beta = np.radians([-170.0, -90.0, -40.0, 0.0, 10.0, 90.0, 130.0, 180.0])
    published = sum(A * np.cos(k * beta) + B * np.sin(k * beta) for k, A, B in rows) / 100
    np.testing.assert_allclose(thrust_coefficient(beta)[PITCH_RATIOS.index(1.0)], published, rtol=0, atol=1e-12)


def test_series_agrees_with_the_polynomials_ahead():
    """Oracle: K_T of Wageningen B4-55 (MSS, another publication of the same tank) in the quadrant both cover, within 0.035."""
    rows = table(load_vessel("cargo90"))
    for i, ratio in enumerate(PITCH_RATIOS):
        if ratio not in rows:
            continue
        k0, k1, k2 = rows[ratio]
        for J in np.linspace(0, 0.9 * ratio, 10):
            C = thrust_coefficient(np.array([math.atan2(J, BLADE)]))[i, 0]
            assert math.pi / 8 * C * (J * J + BLADE**2) == pytest.approx(k0 + k1 * J + k2 * J * J, abs=0.035)


def test_other_quadrants_are_the_measured_ones():
    """Oracle: a fixed propeller whose k0 and k2 are those of the measured curve is that curve wherever it has no polynomial, within
    0.004 of C_T* (its cells are 1/30 of the quadrant wide).
    """
    ratio = 0.8
    column = PITCH_RATIOS.index(ratio)
    bollard, stopped = math.pi / 8 * thrust_coefficient(np.array([0.0, np.pi / 2]))[column]
    vessel = changed("kvlcc2_full", "propeller", pitch_ratio=ratio)
    mmg = vessel.simulator["mmg"] | {"k0": bollard * BLADE**2, "k2": stopped}
    p = Propeller.of(replace(vessel, simulator=vessel.simulator | {"mmg": mmg}))
    beta, n, u = round_the_quadrants(p, 721)
    other = (beta < 0) | (beta > np.pi / 2)
    measured = math.pi / 8 * thrust_coefficient(beta)[column]
    np.testing.assert_allclose(along(p, n, u, 0.0)[other], measured[other], rtol=0, atol=0.004 * math.pi / 8)


@pytest.fixture(scope="module")
def esso():
    """The published parameters, and the propeller of the Esso Osaka model."""
    data = tomllib.loads((REFERENCE / "esso_osaka_reversing.toml").read_text())
    vessel = changed("kvlcc2_l7", "propeller", pitch_ratio=data["pitch_ratio"])
    k0, k1, k2 = data["kt"]
    mmg = vessel.simulator["mmg"] | {"D_P": data["D"], "Lpp": data["L"], "k0": k0, "k1": k1, "k2": k2}
    return data, Propeller.of(replace(vessel, simulator=vessel.simulator | {"mmg": mmg}))


@pytest.mark.parametrize("J", [-0.83, -0.6, -0.36, -0.34, -0.2, -0.07, -0.05, 0.0, 0.4])
def test_side_force_of_a_reversed_propeller(esso, J):
    """Oracle: Y_P and N_P of the Esso Osaka model, written out with dimensions from the published parameters."""
    data, p = esso
    n, rho = -9.0, 998.0
    a, b = data["A"], data["B"]
    if J < -0.35:
        Y, N = a[2] + a[3] * J, b[2] + b[3] * J
    elif J <= -0.06:
        Y, N = a[0] + a[1] * J, b[0] + b[1] * J
    else:
        Y, N = a[4], b[4]
    pressure = 0.5 * rho * data["L"] * data["d"] * (n * data["D"]) ** 2
    found = lateral(p, n, J * n * data["D"], math.nan)
    np.testing.assert_allclose(
        rho * data["D"] ** 2 * np.array(found), (pressure * Y, pressure * data["L"] * N), rtol=1e-12
    )


def test_backing_thrust_of_the_esso_osaka(esso):
    """Oracle: the effective thrust at rest of the Esso Osaka model, C6, within 10 % with its thrust deduction."""
    data, p = esso
    assert (1 - data["t_P"]) * thrust(p, -1.0, 0.0, math.nan) / p.D**2 == pytest.approx(data["C6"], rel=0.10)


@pytest.mark.parametrize("name", SHIPS)
def test_side_force_carries_the_stern_to_port(name):
    """Law: these ships swing their stern to port and their bow to starboard when backing; ahead there is no side force.
    It has no step, and fades with the shaft.
    """
    p = the(name)
    n, pitch = (1.5, -0.8) if p.controllable else (-1.5, math.nan)
    speeds = np.linspace(-6.0, 6.0, 2401) * p.D
    forces = np.array([lateral(p, n, u, pitch) for u in speeds])
    assert np.all(forces[:, 0] <= 0) and np.all(forces[:, 1] >= 0)
    assert lateral(p, n, 0.3 * p.D, pitch)[0] < 0 < lateral(p, n, 0.3 * p.D, pitch)[1]
    assert np.abs(np.diff(forces[:, 0])).max() < 0.01 * abs(thrust(p, n, 0.0, pitch))
    assert lateral(p, abs(n), 3.0, p.service) == (0.0, 0.0)
    for u in (-2.0, 0.0, 2.0):
        assert np.abs(lateral(p, 1e-7 * n, u, pitch)).max() < 1e-13 * p.D**2 * p.Lpp


def test_rudder_flow():
    """Oracle: Yasukawa & Yoshimura's u_R / epsilon where thrust and flow go ahead. Laws: no step where either changes sign; at rest a
    backing propeller's flow is the reverse of half the ahead one; without thrust it is the flow itself, either way.
    """
    eta, kappa = 0.7, 0.5
    for u in (0.0, 0.5, 6.0):
        for T in (0.0, 0.3, 40.0):
            inside = u + kappa * (math.sqrt(u * u + 8 * T / math.pi) - u)
            exact = math.sqrt(eta * inside**2 + (1 - eta) * u * u)
            assert rudder_flow(u, T, eta, kappa) == pytest.approx(exact, rel=1e-12)
    for T in (-5.0, 0.0, 5.0):
        assert rudder_flow(1e-13, T, eta, kappa) == pytest.approx(rudder_flow(-1e-13, T, eta, kappa), abs=1e-6)
    for u in (-2.0, 0.0, 2.0):
        assert rudder_flow(u, 1e-13, eta, kappa) == pytest.approx(rudder_flow(u, -1e-13, eta, kappa), abs=1e-6)
        assert rudder_flow(u, 0.0, eta, kappa) == pytest.approx(u, rel=1e-12)
    assert rudder_flow(0.0, -3.0, eta, kappa) == pytest.approx(-0.5 * rudder_flow(0.0, 3.0, eta, kappa))


def test_a_ship_without_the_section():
    """Oracle: the KVLCC2 pitch ratio, which its polynomial's advance ratio of no thrust (0.768) gives within 0.03; right-handed."""
    p = Propeller.of(changed("kvlcc2_full", "propeller", pitch_ratio=None, hand=None))
    assert p.service == pytest.approx(0.721, abs=0.03)
    assert not p.controllable and p.hand == 1


@pytest.mark.parametrize(
    "section, values, said",
    [
        ("propeller", {"pitch_ratio": 2.0}, "propeller.pitch_ratio = 2 is outside"),
        ("propeller", {"pitchratio": 0.7}, "did you mean pitch_ratio"),
        ("propeller", {"hand": 0.5}, "propeller.hand = 0.5 must be 1"),
        ("propeller", {"table": {"0.5": [0.2, -0.2, -0.1]}}, "at least three"),
        ("propeller", {"table": [1, 2, 3]}, "at least three"),
        ("propeller", {"table": {"0.5": [0.2, -0.2], "0.8": [1, 2, 3], "1.0": [1, 2, 3]}}, "table 0.5 needs three"),
        ("propeller", {"table": {"half": [0.2, -0.2, 0], "0.8": [1, 2, 3], "1.0": [1, 2, 3]}}, "table half must be"),
        ("propeller", {"table": {"9": [0.2, -0.2, 0], "0.8": [1, 2, 0], "1.0": [1, 2, 0]}}, "table 9 is outside"),
        ("propeller", {"pitch_ratio": 1.35}, "outside propeller.table, 0.3 to 1.2"),
        ("propeller", {"pitch_ratio": 0.7}, "not mmg.k0, k1, k2"),
        ("mmg", {"k0": None}, "mmg.k0 is missing"),
        ("mmg", {"k2": 0.2}, "mmg.k2 = 0.2 must not be positive"),
        ("mmg", {"D_P": -3.1}, "mmg.D_P = -3.1 must be positive"),
    ],
)
def test_bad_input_is_one_line(section, values, said):
    """Law: whatever is wrong in a vessel file is one line that names the vessel and the key."""
    with pytest.raises(InputError, match="vessel cargo90: ") as caught:
        Propeller.of(changed("cargo90", section, **values))
    assert said in str(caught.value) and "\n" not in str(caught.value)
