"""Attitude kinematics against scipy's Rotation and closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aspnn.estimation import attitude as kinematics
from aspnn.frames import attitude

TILTS = [(0.0, 0.0, 0.0), (0.26, 0.14, 1.0), (-0.5, 0.3, -2.8), (0.2, -0.6, 3.1)]


@pytest.mark.parametrize("roll, pitch, heading", TILTS)
def test_euler_rates_are_those_of_a_body_that_turns(roll, pitch, heading):
    """Oracle: a rotation turned on for 1 us either way by scipy, its Euler angles differenced (E11)."""
    rates, h = np.array([0.1, -0.05, 0.2]), 1e-6
    start = Rotation.from_euler("ZYX", [heading, pitch, roll])
    late, early = (start * Rotation.from_rotvec(sign * h * rates) for sign in (1, -1))
    change = (late.as_euler("ZYX") - early.as_euler("ZYX"))[::-1] / (2 * h)
    np.testing.assert_allclose(kinematics.euler_rates(roll, pitch, rates), change, atol=1e-8)
    np.testing.assert_allclose(kinematics.turning_rates(roll, pitch, change), rates, atol=1e-8)


def test_printed_case_of_the_erratum():
    """Oracle: E11's figures for roll 15, pitch 8 deg and (p, q, r) = (.1, .05, .2)."""
    found = kinematics.euler_rates(np.radians(15), np.radians(8), [0.1, 0.05, 0.2])
    np.testing.assert_allclose(found, [0.129, -0.0035, 0.208], atol=5e-4)


@pytest.mark.parametrize("roll, pitch, heading", TILTS)
def test_heading_rate_of_a_steady_coordinated_turn(roll, pitch, heading):
    """Oracle: a turn at W rad/s about the vertical with steady roll and pitch has r = W cos roll cos pitch."""
    turn = 0.3
    r = turn * np.cos(roll) * np.cos(pitch)
    assert kinematics.heading_rate(roll, pitch, r, 0.0) == pytest.approx(turn, rel=1e-14)


def test_heading_rate_needs_the_pitch_rate():
    """Oracle: the third of the Euler rates, with q known (E11)."""
    rates = np.array([0.3, 0.4, 0.2])
    _, pitch_rate, heading_rate = kinematics.euler_rates(0.25, -0.1, rates)
    assert kinematics.heading_rate(0.25, -0.1, rates[2], pitch_rate) == pytest.approx(heading_rate, rel=1e-13)


@pytest.mark.parametrize("roll, pitch, heading", TILTS)
def test_quaternion_turns_as_scipy(roll, pitch, heading):
    """Oracle: scipy's Rotation, for turns from none at all to over half a circle; then the angles of the matrix."""
    q, C = np.empty(4), np.empty((3, 3))
    kinematics.quaternion(roll, pitch, heading, q)
    kinematics.rotation(q, C)
    np.testing.assert_allclose(C, attitude(roll, pitch, heading), atol=1e-15)
    start = Rotation.from_matrix(C)
    for vector in ([0.0, 0.0, 0.0], [1e-9, 0.0, -1e-9], [0.01, -0.02, 0.03], [2.0, 1.0, -2.5]):
        turned = q.copy()
        kinematics.turn(turned, *vector)
        kinematics.rotation(turned, C)
        np.testing.assert_allclose(C, (start * Rotation.from_rotvec(vector)).as_matrix(), atol=1e-15)
        heading_, pitch_, roll_ = (start * Rotation.from_rotvec(vector)).as_euler("ZYX")
        np.testing.assert_allclose(kinematics.angles(C), (roll_, pitch_, heading_), atol=1e-12)


def test_skew_is_the_cross_product():
    """Oracle: numpy's cross."""
    a, b = np.random.default_rng(1).standard_normal((2, 5, 3))
    np.testing.assert_allclose(np.einsum("tij,tj->ti", kinematics.skew(a), b), np.cross(a, b), atol=1e-15)
