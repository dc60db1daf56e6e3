"""Tracking control of a craft without sway actuator, against its own differential equations, eigenvalues and Lyapunov's function."""

import math

import numpy as np
import pytest

from aspnn.estimation.craft import PAPER, advance, rates
from aspnn.guidance.tracking import (
    Gains,
    command,
    coordinate_rates,
    coordinates,
    forces,
    lyapunov,
    turning_reference,
)
from aspnn.schema import InputError

START = np.array([30.0, -1.0, 0.2, 0.0, 0.0, 0.0])
REFERENCE = np.array([-2.0, -20.0, 0.0, 1.0, -0.1, 0.05])
GAINS, DT = Gains(), 0.1


def followed(start=START, reference=REFERENCE, seconds=150.0, gains=GAINS, limit=(math.inf, math.inf), believed=PAPER):
    """Distances, V, forces and the last error of the closed loop."""
    path = turning_reference(PAPER, reference, DT, round(seconds / DT))
    x, away, fall, tau = start, [], [], []
    for there, change in zip(path.x, path.rate, strict=True):
        told = command(believed, x, there, change, gains, limit)
        away.append(np.hypot(*(x - there)[:2]))
        fall.append(lyapunov(gains, told.error, there[5]))
        tau.append(told.tau)
        x = advance(PAPER, x, told.tau, DT)
    return np.array(away), np.array(fall), np.array(tau), told.error


def test_coordinates_make_the_chain():
    """Oracle: differences of the coordinates along the craft's own equations: x3' = x5 x6, x4' = x5 and the two that damping holds; with m11
    in x3, as printed, x3' is something else (E56).
    """
    rng = np.random.default_rng(0)
    x = rng.standard_normal((6, 40)) * np.array([20, 20, 2, 1, 1, 1])[:, None]
    tau = 50 * rng.standard_normal((2, 40))
    change, h = rates(PAPER, x, tau), 1e-5
    z = coordinates(PAPER, x)
    found = (coordinates(PAPER, x + h * change) - coordinates(PAPER, x - h * change)) / (2 * h)
    c = PAPER
    first = -c.d22 / c.m11 * (z[0] + z[5]) + z[4] * (z[2] - c.m22 / c.d22 * z[1])
    second = -c.d22 / c.m22 * (z[1] - z[4] * (z[0] + z[5]))
    third, fifth, sixth = coordinate_rates(PAPER, x, change)
    np.testing.assert_allclose(found, [first, second, z[4] * z[5], z[4], fifth, sixth], atol=2e-5)
    np.testing.assert_allclose(third, z[4] * z[5], atol=1e-10)
    printed = third + (c.m11 - c.m22) / c.d22 * change[4]
    assert np.abs(printed - z[4] * (z[5])).max() > 0.1


def test_forces_give_the_rates_asked_for():
    """Oracle: the craft's equations under those forces: x5' and x6' are what was asked; - tau_1 / d22 (E56), + d33 r."""
    rng = np.random.default_rng(1)
    x, asked = rng.standard_normal((6, 30)), rng.standard_normal((2, 30))
    _, turn, surge = coordinate_rates(PAPER, x, rates(PAPER, x, forces(PAPER, x, asked)))
    np.testing.assert_allclose([turn, surge], asked, atol=1e-10)


def test_reference_is_the_papers_circle():
    """Oracle: geometry: from the paper's start a circle about the origin of radius |v| / r, under 71.25 N and -2.5 N m."""
    path = turning_reference(PAPER, REFERENCE, 0.1, 1500)
    np.testing.assert_allclose(np.hypot(*path.x[:, :2].T), math.hypot(1, 0.1) / 0.05, rtol=1e-8)
    np.testing.assert_allclose(path.tau, np.tile([71.25, -2.5], (1500, 1)), atol=1e-9)


def test_reference_is_feasible_from_any_sway():
    """Oracle: the craft's equations: under the reference's forces and from its start the craft stays on it (sway of its own at first)."""
    start = np.array([5.0, 3.0, 1.0, 0.8, 0.3, -0.08])
    path = turning_reference(PAPER, start, 0.05, 600)
    np.testing.assert_allclose(path.x[:, 3], 0.8)
    np.testing.assert_allclose(path.x[:, 5], -0.08)
    x = start
    for tau in 0.5 * (path.tau[1:] + path.tau[:-1]):
        x = advance(PAPER, x, tau, 0.05)
    np.testing.assert_allclose(x, path.x[-1], atol=1e-3)
    np.testing.assert_allclose(np.gradient(path.x, 0.05, axis=0)[5:-5], path.rate[5:-5], atol=1e-4)


@pytest.mark.parametrize("limit", [(math.inf, math.inf), (100.0, 20.0)])
def test_converges_from_the_papers_start(limit):
    """The claim of the paper: from its start, 37 m off and at rest, the position error falls below 1 m within 60 s and to a millimetre;
    with bounded forces too, which are not exceeded.
    """
    away, _, tau, error = followed(limit=limit)
    assert away[0] == pytest.approx(math.hypot(32, 19))
    assert away[round(60 / DT) :].max() < 1.0 and away[-1] < 2e-3 and np.abs(error).max() < 2e-3
    assert np.abs(tau[:, 0]).max() <= limit[0] and np.abs(tau[:, 1]).max() <= limit[1]
    assert np.abs(tau[-1] - [71.25, -2.5]).max() < 0.01


def test_rate_of_convergence_is_that_of_the_eigenvalues():
    """Oracle: analytic: late errors die with the slower root of s^2 + (k3 r^2 + k4) s + (k3 k4 + 1) r^2."""
    r = REFERENCE[5]
    slow = np.roots([1, GAINS.k3 * r**2 + GAINS.k4, (GAINS.k3 * GAINS.k4 + 1) * r**2]).real.max()
    away, *_ = followed()
    late = away[round(80 / DT) : round(140 / DT)]
    assert math.log(late[-1] / late[0]) / (DT * (len(late) - 1)) == pytest.approx(slow, rel=0.02)
    assert slow == pytest.approx(-0.0867, abs=1e-4)


def test_lyapunov_function_falls():
    """Law: with the yaw rate on its reference V' = -k3 r^2 e3^2 - k4 z^2 exactly, at random errors (differences of the craft's equations)."""
    rng, h = np.random.default_rng(4), 1e-6
    path = turning_reference(PAPER, REFERENCE, DT, 2)
    there, change = path.x[0], path.rate[0]
    for _ in range(20):
        x = there + np.array([*(10 * rng.standard_normal(2)), 0, *rng.standard_normal(2), 0])
        told = command(PAPER, x, there, change, GAINS)
        assert abs(told.error[4]) == 0
        moving = rates(PAPER, x, told.tau)
        values = [
            lyapunov(
                GAINS, coordinates(PAPER, x + s * h * moving) - coordinates(PAPER, there + s * h * change), there[5]
            )
            for s in (1, -1)
        ]
        z = told.error[5] + GAINS.k3 * there[5] * told.error[2]
        law = -GAINS.k3 * there[5] ** 2 * told.error[2] ** 2 - GAINS.k4 * z**2
        assert (values[0] - values[1]) / (2 * h) == pytest.approx(law, rel=1e-6, abs=1e-5)


def test_converges_from_many_starts():
    """Claim: from 40 random starts in 30 m about the origin, headings within 60 deg, either turn, the error is below 2 m after 110 s
    (of up to 50), forces within 100 N and 20 N m.

    Not with 150 N: 20 N m do not hold the Munk moment of the speed that 150 N bring, and some crafts stay in a spin (so LIMIT of the
    paper's study).
    """
    rng = np.random.default_rng(5)
    starts = rng.uniform(-1, 1, (6, 20)) * np.array([30, 30, 1, 1, 0.5, 0.1])[:, None]
    ends = {}
    for side, force in ((1, 100.0), (-1, 100.0), (1, 150.0)):
        path, x = turning_reference(PAPER, REFERENCE * [1, 1, 1, 1, side, side], 0.1, 1100), starts
        for there, change in zip(path.x, path.rate, strict=True):
            told = command(PAPER, x, there[:, None], change[:, None], GAINS, (force, 20.0))
            away, x = np.hypot(*(x[:2] - there[:2, None])), advance(PAPER, x, told.tau, 0.1)
        ends[side, force] = away
    assert ends[1, 100.0].max() < 2.0 and ends[-1, 100.0].max() < 2.0
    assert 0 < (ends[1, 150.0] > 2.0).sum() < 6


def test_origin_may_lie_off_the_circle():
    """Law: the chain holds about any origin: 100 m off the circle's centre the craft converges as well."""
    away = np.array([100.0, 50, 0, 0, 0, 0])
    assert followed(START + away, REFERENCE + away, 120.0)[0][-1] < 0.1


def test_wrong_mass_turns_the_heading():
    """Oracle: analytic: with m11 believed 20 kg too high, e4 = 20 u v / (m33 k1 k2), -0.1 rad, which puts the craft 2 m aside at 20 m from
    the origin. The right mass has nothing of the kind.
    """
    away, _, _, error = followed(seconds=150.0, believed=PAPER._replace(m11=220.0))
    expected = -20 * REFERENCE[3] * REFERENCE[4] / (PAPER.m33 * GAINS.k1 * GAINS.k2)
    assert abs(error[3]) == pytest.approx(expected, rel=0.1)
    assert away[-1] == pytest.approx(expected * math.hypot(1, 0.1) / 0.05, rel=0.1)


def test_many_masses_share_one_reference():
    """Law: an array of masses gives what each gives alone; which force met its limit is told."""
    path = turning_reference(PAPER, REFERENCE, DT, 1)
    masses, x = np.array([180.0, 220.0]), np.column_stack([START, REFERENCE + 0.01])
    there, change = path.x[0], path.rate[0]
    both = command(PAPER._replace(m11=masses), x, there[:, None], change[:, None], GAINS, (100.0, 20.0))
    for k in range(2):
        alone = command(PAPER._replace(m11=masses[k]), x[:, k], there, change, GAINS, (100.0, 20.0))
        np.testing.assert_allclose(both.tau[:, k], alone.tau)
    assert both.saturated.tolist() == [[True, False], [False, False]]


def test_what_cannot_be_followed_is_told():
    """Bad input: a straight reference, gains that do not pull; one line each."""
    with pytest.raises(InputError, match="straight line"):
        turning_reference(PAPER, REFERENCE * [1, 1, 1, 1, 1, 0], 0.1, 5)
    with pytest.raises(InputError, match="k3 = 0"):
        Gains(k3=0.0)
