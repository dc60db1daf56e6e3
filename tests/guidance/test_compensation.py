"""Laws that make up for the sideslip, on a kinematic craft whose every motion is known."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aspnn.estimation.sideslip import EXACT, SMALL, SURGE, SideslipModel
from aspnn.guidance.compensation import (
    AdaptiveLos,
    IntegralLos,
    KalmanLos,
    crab_heading,
    steady_offset,
    tangent_heading,
)
from aspnn.guidance.los import LineOfSight
from aspnn.guidance.route import PathError
from aspnn.schema import InputError

DT, LOOKAHEAD, SPEED = 0.2, 6.0, 1.4


def error_of(cross, path_angle=0.0, leg=0):
    n = len(cross)
    return PathError(np.zeros(n), cross, np.full(n, path_angle), np.ones(n), np.full(n, leg), np.zeros(n, bool))


def sail(law, cross, sideslip, duration=300.0, alpha=2.9, surge=False, dt=DT):
    """Cross-track errors (steps, ships) of craft that take the desired heading at once, y_e' = U sin(psi - alpha + beta) exactly."""
    y, psi = np.array(cross, float), np.full(len(cross), alpha)
    speed = SPEED * np.cos(sideslip) if surge else np.full(len(y), SPEED)
    found = []
    for _ in range(round(duration / dt)):
        psi = law(error_of(y, alpha), speed, psi, dt)
        y = y + dt * SPEED * np.sin(psi - alpha + sideslip)
        found.append(y)
    return np.array(found)


BETA = np.radians([20.0, -20.0, 5.0])
LAWS = {
    "printed": KalmanLos(LOOKAHEAD, SideslipModel.published(DT), 3, printed=True),
    "small": KalmanLos(LOOKAHEAD, SideslipModel.tuned(0.4, 0.1, DT, SPEED, SMALL), 3, printed=True),
    "surge": KalmanLos(LOOKAHEAD, SideslipModel.tuned(0.4, 0.1, DT, SPEED, SURGE), 3, printed=True),
    "exact (11)": KalmanLos(LOOKAHEAD, SideslipModel.tuned(0.4, 0.1, DT, SPEED, EXACT), 3, printed=True),
    "exact": KalmanLos(LOOKAHEAD, SideslipModel.tuned(0.4, 0.1, DT, SPEED, EXACT), 3),
    "integral": IntegralLos.damped(LOOKAHEAD, SPEED, ships=3),
    "adaptive": AdaptiveLos.damped(LOOKAHEAD, SPEED, ships=3),
}


def test_the_conventional_law_rests_where_the_formula_says():
    """Oracle: lookahead tan(beta), derived from y_e' = 0; and for a ship in a current lookahead c / sqrt(V^2 - c^2)."""
    found = sail(LineOfSight(LOOKAHEAD), [0.0, 10.0, -3.0], BETA)
    np.testing.assert_allclose(found[-1], LOOKAHEAD * np.tan(BETA), rtol=1e-9)
    V, c = 1.0, 0.3
    np.testing.assert_allclose(steady_offset(LOOKAHEAD, np.arcsin(c / V)), LOOKAHEAD * c / np.sqrt(V**2 - c**2))


@pytest.mark.parametrize("name", LAWS)
def test_every_law_ends_on_the_line_and_knows_the_sideslip(name):
    """Oracle: the equilibrium: y_e = 0, the sideslip made up for is the true one (tan(beta) of the printed form)."""
    law = LAWS[name]
    law.reset(3)
    found = sail(law, [0.0, 15.0, -8.0], BETA, surge=name == "surge")
    np.testing.assert_allclose(found[-1], 0.0, atol=1e-6)
    printed = name in ("printed", "small")
    np.testing.assert_allclose(law.sideslip, np.tan(BETA) if printed else BETA, atol=1e-6)
    assert np.abs(found[0] - found[-1]).max() > 5  # it came from somewhere


def test_with_beta_in_the_printed_law_an_offset_is_left():
    """Oracle: (11) with beta for tan(beta) rests lookahead (tan(beta) - beta) beside the line."""
    found = sail(lambda e, u, psi, dt: tangent_heading(e.path_angle, e.cross, LOOKAHEAD, BETA), [1.0, 1.0, 1.0], BETA)
    np.testing.assert_allclose(found[-1], LOOKAHEAD * (np.tan(BETA) - BETA), rtol=1e-6, atol=1e-9)


def test_a_known_sideslip_leaves_the_ideal_line_of_sight():
    """Oracle: solve_ivp of y' = -U y / sqrt(lookahead^2 + y^2) for `crab_heading`; near the line (11) is slower by cos(beta)^2."""
    ideal = solve_ivp(lambda t, y: -SPEED * y / np.hypot(LOOKAHEAD, y), (0, 20), [15.0], rtol=1e-9, atol=1e-9)
    found = sail(
        lambda e, u, psi, dt: crab_heading(e.path_angle, e.cross, LOOKAHEAD, BETA), [15.0] * 3, BETA, 20.0, dt=0.01
    )
    np.testing.assert_allclose(found[-1], ideal.y[0, -1], atol=0.02)  # of Euler's steps
    small = sail(
        lambda e, u, psi, dt: tangent_heading(e.path_angle, e.cross, LOOKAHEAD, np.tan(BETA)),
        [1e-3] * 3,
        BETA,
        5,
        dt=0.01,
    )
    rates = -np.log(small[-1] / small[0]) / (0.01 * (len(small) - 1))
    np.testing.assert_allclose(rates, SPEED / LOOKAHEAD * np.cos(BETA) ** 2, rtol=0.01)


@pytest.mark.parametrize("kind", [IntegralLos, AdaptiveLos])
@pytest.mark.parametrize("zeta", [0.5, 1.0])
def test_damped_loops_have_their_poles(kind, zeta):
    """Oracle: s^2 + (U / lookahead) s + U kappa / lookahead^2, its roots by their damping; the loop linearised by differences."""
    law = kind.damped(LOOKAHEAD, SPEED, zeta)

    def step(y, memory):
        law.reset(1)
        name = "integral" if kind is IntegralLos else "sideslip"
        setattr(law, name, np.array([memory]))
        psi = law(error_of(np.array([y])), np.array([SPEED]), np.zeros(1), 1e-4)
        return np.array([y + 1e-4 * SPEED * np.sin(psi[0]), getattr(law, name)[0]])

    near = 1e-4
    columns = [(step(*(near * np.eye(2)[k])) - step(*(-near * np.eye(2)[k]))) / (2 * near) for k in range(2)]
    poles = np.log(np.linalg.eigvals(np.stack(columns, axis=1)).astype(complex)) / 1e-4
    omega = np.sqrt(np.prod(poles)).real
    assert omega == pytest.approx(SPEED / LOOKAHEAD / (2 * zeta), rel=1e-3)
    assert -np.sum(poles).real / (2 * omega) == pytest.approx(zeta, rel=1e-3)


@pytest.mark.parametrize("name", ["exact (11)", "exact", "integral", "adaptive"])
def test_rates_are_those_of_the_desired_headings(name):
    """Oracle: differences of the desired heading along an approach to a new leg, once the sideslip is known."""
    law, dt = LAWS[name], 0.005
    law.reset(3)
    sail(law, [0.0, 0.0, 0.0], BETA, 150.0, alpha=0.0)
    y, psi, asked, told = np.array([6.0, -4.0, 2.0]), -BETA, [], []
    for _ in range(1200):
        error = error_of(y, leg=1)
        psi = law(error, np.full(3, SPEED), psi, dt)
        asked.append(psi)
        told.append(law.rate(error, SPEED, psi + BETA))
        y = y + dt * SPEED * np.sin(psi + BETA)
    turned = np.diff(asked, axis=0)[50:] / dt
    assert np.abs(turned).max() > 0.04
    np.testing.assert_allclose(turned, 0.5 * (np.array(told)[:-1] + told[1:])[50:], atol=1e-3)


def test_the_filter_bridges_missing_fixes_and_legs():
    """Oracle: without fixes for 20 s the exact law stays on the line; a new leg does not move the sideslip."""
    law = KalmanLos(LOOKAHEAD, SideslipModel.tuned(0.4, 0.1, DT, SPEED), 1)
    y, psi = np.array([3.0]), np.zeros(1)
    for k in range(1300):
        lost = 1000 <= k < 1100
        psi = law(error_of(np.full(1, np.nan) if lost else y), np.full(1, SPEED), psi, DT)
        y = y + DT * SPEED * np.sin(psi + 0.3)
        assert k < 1000 or abs(y[0]) < 1e-3
    known = law.sideslip.copy()
    law(error_of(np.array([50.0]), leg=1), np.full(1, SPEED), psi, DT)
    np.testing.assert_array_equal(law.sideslip, known)
    assert law.filter.cross[0] == 50.0


def test_estimates_are_bounded():
    """Oracle: the bound; a craft that never comes nearer would wind them up."""
    wild = [AdaptiveLos(LOOKAHEAD, 1.0), KalmanLos(LOOKAHEAD, SideslipModel.published(DT))]
    for law in wild:
        for k in range(400):
            law(error_of(np.array([1.0 * k])), np.array([SPEED]), np.zeros(1), DT)
        assert abs(law.sideslip[0]) <= law.most
    integral = IntegralLos(LOOKAHEAD, 0.3)
    for _ in range(1000):
        integral(error_of(np.array([500.0])), np.array([SPEED]), np.zeros(1), 5.0)
    assert 0 < integral.integral[0] < 5000 * LOOKAHEAD / 500  # z' < lookahead / y_e


def test_impossible_laws_are_named():
    """Oracle: the message names the law and what must change."""
    with pytest.raises(InputError, match="look-ahead of 0 m"):
        KalmanLos(0.0, SideslipModel.published(DT))
    with pytest.raises(InputError, match="kappa"):
        IntegralLos(LOOKAHEAD, 0.0)
    with pytest.raises(InputError, match="gamma"):
        AdaptiveLos(LOOKAHEAD, -1.0)
    with pytest.raises(InputError, match="look-ahead"):
        AdaptiveLos.damped(0.0, SPEED)
