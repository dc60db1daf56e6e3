"""Wave drift: against total reflection, closed integrals, laws of symmetry, statistics and a rule of thumb for added resistance."""

import math

import numpy as np
import pytest

from aspnn.simulation.environment.drift import HEADINGS, Drift, drift_load
from aspnn.simulation.environment.waves import draw_waves
from aspnn.vessel import load_vessel

RHO_G = 1025 * 9.81
BOX = np.array([[50.0, -8.0], [50.0, 8.0], [-50.0, 8.0], [-50.0, -8.0], [50.0, -8.0]])
ROUND = 30 * np.column_stack([np.cos(np.linspace(0, 2 * np.pi, 721)), np.sin(np.linspace(0, 2 * np.pi, 721))])


def one_wave(k, towards, amplitude=1.0, phase=0.0):
    return np.array([[amplitude, k, towards, math.sqrt(9.81 * k), phase]])


def pushed(drift, heading=0.0, surge=0.0, place=(0.0, 0.0), time=0.0):
    row, load = np.zeros(15), np.zeros(6)
    row[:4] = *place, heading, surge
    drift_load(drift, row, time, load)
    assert np.all(load[2:5] == 0)
    return load[[0, 1, 5]]


def alone(drift, i):
    return Drift(drift.wave[:, i : i + 1].copy(), drift.load[..., i : i + 1].copy(), drift.fastest)


@pytest.mark.parametrize("turned", [False, True], ids=["clockwise", "anticlockwise"])
def test_total_reflection(turned):
    """Oracle: a wall that reflects all of a wave head-on takes 1/2 rho g a^2 per metre, and an oblique wave sin^2 of that (Longuet-Higgins'
    momentum flux); deep box, short waves. Whichever way round the outline is told.
    """
    outline = BOX[::-1] if turned else BOX
    unit = 0.5 * RHO_G * 0.6**2
    for towards, expected in (
        (math.pi, (-16, 0, 0)),
        (math.pi / 2, (0, 100, 0)),
        (math.radians(-120), (-16 / 4, -100 * 3 / 4, 0)),
    ):
        found = pushed(Drift.along(outline, 40.0, 10.0, one_wave(1.5, towards, 0.6)))
        np.testing.assert_allclose(found / unit, expected, atol=1e-9)


def test_drift_of_a_cylinder():
    """Oracle: the closed integral over a vertical cylinder, 2/3 rho g a^2 R, whatever the direction (Faltinsen 1990; 721 chords: 1e-4)."""
    for towards in (0.0, 1.1, -2.3):
        X, Y, N = pushed(Drift.along(ROUND, 40.0, 10.0, one_wave(1.0, towards, 0.5)))
        unit = 2 / 3 * RHO_G * 0.5**2 * 30
        np.testing.assert_allclose([X, Y], unit * np.array([math.cos(towards), math.sin(towards)]), atol=2e-4 * unit)
        assert abs(N) < 1e-6 * unit * 30


def test_speed_raises_head_seas_and_outruns_following_seas():
    """Oracle: 1 + 2 omega U / g ahead, 1 - 2 omega U / g astern down to nothing at the speed of the groups, g / 2 omega (within 2 %
    of the still force for the table's kink there).
    """
    omega = math.sqrt(9.81 * 0.5)
    head, follow = Drift.along(BOX, 40.0, 8.0, one_wave(0.5, math.pi)), Drift.along(BOX, 40.0, 8.0, one_wave(0.5, 0.0))
    still = pushed(head)[0]
    for speed in (0.5, 1.9, 4.0, 7.7):
        assert pushed(head, surge=speed)[0] / still == pytest.approx(1 + 2 * omega * speed / 9.81, rel=1e-9)
        expected = max(1 - 2 * omega * speed / 9.81, 0)
        assert -pushed(follow, surge=speed)[0] / still == pytest.approx(expected, abs=0.15 if 1 < speed < 3 else 1e-9)
    assert np.array_equal(pushed(head, surge=8.0), pushed(head, surge=20.0))


def test_reflection_fades_in_long_waves():
    """Oracle: pi^2 I1^2 / (pi^2 I1^2 + K1^2) of kd by the integrals that define I1 and K1, and (pi (kd)^2 / 2)^2 for small kd."""
    theta, t = np.linspace(0, np.pi, 20_001), np.linspace(0, 12, 200_001)
    full = pushed(Drift.along(BOX, 500.0, 10.0, one_wave(0.5, math.pi)))[0]
    for kd in (0.05, 0.3, 1.0, 2.5):
        I1 = np.trapezoid(np.exp(kd * np.cos(theta)) * np.cos(theta), theta) / np.pi
        K1 = np.trapezoid(np.exp(-kd * np.cosh(t)) * np.cosh(t), t)
        share = (np.pi * I1) ** 2 / ((np.pi * I1) ** 2 + K1**2)
        assert pushed(Drift.along(BOX, kd / 0.5, 10.0, one_wave(0.5, math.pi)))[0] / full == pytest.approx(
            share, rel=1e-6
        )
    tiny = pushed(Drift.along(BOX, 0.02, 10.0, one_wave(0.5, math.pi)))[0] / full
    assert tiny == pytest.approx((np.pi * 0.01**2 / 2) ** 2, rel=2e-3)


def test_directions_of_a_ship():
    """Laws: head seas push astern, beam seas to leeward; port mirrors starboard; only the angle between ship and waves counts (at
    headings of the table), between them within 0.5 % of the greatest force.
    """
    vessel = load_vessel("cargo90")

    def at(towards, heading=0.0, surge=4.0):
        return pushed(Drift.of(vessel, one_wave(0.3, towards)), heading, surge)

    assert at(math.pi)[0] < 0 < at(0.0, surge=0.0)[0]
    assert at(math.pi / 2)[1] > 0 > at(-math.pi / 2)[1]
    for towards in (0.4, 1.5, 2.6):
        X, Y, N = at(towards)
        np.testing.assert_allclose(at(-towards), (X, -Y, -N), rtol=1e-9)
        step = 2 * math.pi / HEADINGS
        np.testing.assert_allclose(at(towards + 7 * step, 7 * step), (X, Y, N), rtol=1e-9)
        scale = np.abs(at(math.pi / 2)[1]) * np.array([1, 1, 45])
        np.testing.assert_allclose(
            at(towards + 0.5 * step, 0.5 * step) / scale, np.array([X, Y, N]) / scale, atol=0.005
        )


def test_slow_load_has_the_mean_of_its_components():
    """Oracle: the mean of the slow force is the sum of D a^2, each component alone. Over 600 seas of other phases, within 4.5 standard
    errors; and one pair of waves beats at the difference of their frequencies about the mean.
    """
    rng, waves = np.random.default_rng(2), draw_waves(np.random.default_rng(1), 2.0, 6.0, 2.8, 12.0)
    vessel, loads = load_vessel("cargo90"), []
    drift = Drift.of(vessel, waves)
    mean = sum(pushed(alone(drift, i), 0.2, 5.0) for i in range(len(waves)))
    for _ in range(600):
        drift.wave[4] = rng.uniform(0, 2 * np.pi, len(waves))
        loads.append(pushed(drift, 0.2, 5.0))
    error = np.std(loads, axis=0) / math.sqrt(600)
    assert np.all(np.abs(np.mean(loads, axis=0) - mean) < 4.5 * error)
    assert error[0] < 0.06 * abs(mean[0])

    pair = np.concatenate([one_wave(0.2, math.pi), one_wave(0.25, math.pi, 0.5, 1.0)])
    drift = Drift.along(BOX, 6.0, 10.0, pair)
    D = [pushed(alone(drift, 0))[0], pushed(alone(drift, 1))[0] / 0.25]
    for time in (0.0, 3.0, 11.0):
        beat = math.cos((pair[0, 3] - pair[1, 3]) * time + 1.0)
        assert pushed(drift, time=time)[0] == pytest.approx(D[0] + 0.25 * D[1] + 0.5 * (D[0] + D[1]) * beat, rel=1e-9)


def test_against_a_rule_for_added_resistance():
    """Oracle: STAwave-1 (ISO 15016), R = 1/16 rho g H^2 B sqrt(B / L_BWL) for head seas with little heave and pitch, within a factor
    of 2: cargo90 at 11.5 kn in short waves (H 1.5 m, T 4.5 s); L_BWL, to 95 % of the beam, is 16.1 m of its generic outline.
    """
    vessel, waves = load_vessel("cargo90"), draw_waves(np.random.default_rng(6), 1.5, 4.5, math.pi, count=100)
    drift = Drift.of(vessel, waves)
    found = -sum(pushed(alone(drift, i), 0.0, vessel.service_speed)[0] for i in range(len(waves)))
    rule = RHO_G / 16 * 1.5**2 * 14 * math.sqrt(14 / 16.1)
    assert rule / 2 < found < rule * 2
