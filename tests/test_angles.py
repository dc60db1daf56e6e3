"""Angles against the geometry of the circle: an angle is what its sine and cosine say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aspnn.angles import circular_mean, compass, difference, unwrap, wrap

ANGLES = st.floats(-1e4, 1e4)


@given(ANGLES)
def test_wrapped_angle_is_the_same_direction_in_its_range(angle):
    """Law: same sine and cosine, range [-pi, pi) for wrap and [0, 2 pi) for compass."""
    for turned, low, high in ((wrap(angle), -np.pi, np.pi), (compass(angle), 0.0, 2 * np.pi)):
        assert low <= turned < high
        np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j * angle), atol=1e-11)


@pytest.mark.parametrize("start", [-np.pi, np.pi, 0.0, 2 * np.pi])
def test_range_holds_beside_the_seam(start):
    """Law: the half-open range holds for the float64 neighbours of the seam, where mod rounds up to 2 pi."""
    below, above = np.nextafter(start, -10), np.nextafter(start, 10)
    for angle in (below, start, above, np.nextafter(below, -10)):
        assert -np.pi <= wrap(angle) < np.pi
        assert 0 <= compass(angle) < 2 * np.pi


def test_wrap_corrects_the_switching_rule_of_paper_iii():
    """Published counterexample (erratum E28): +30 and -7 deg stay as they are, where the printed rule adds full turns."""
    np.testing.assert_allclose(np.degrees(wrap(np.radians([30.0, -7.0, 353.0, -330.0]))), [30, -7, -7, 30], atol=1e-12)


def test_difference_is_positive_clockwise():
    """By hand: from 350 to 10 deg is 20 deg to starboard."""
    np.testing.assert_allclose(np.degrees(difference(np.radians(10), np.radians(350))), 20)
    np.testing.assert_allclose(np.degrees(difference(np.radians(350), np.radians(10))), -20)


def test_circular_mean_across_north():
    """By hand (erratum E25): the mean of headings about north is north, where the arithmetic mean is south."""
    headings = np.radians([[350.0, 355.0, 5.0, 10.0], [80.0, 85.0, 95.0, 100.0]])
    np.testing.assert_allclose(np.degrees(circular_mean(headings, axis=1)), [0, 90], atol=1e-9)


def test_unwrap_gives_back_a_continuous_heading():
    """Exact: a heading that turns twice round, recorded as a compass shows it, with gaps."""
    heading = 0.3 + np.linspace(0, 4 * np.pi, 200)
    recorded = compass(heading)
    recorded[[5, 60, 61]] = np.nan
    continuous = unwrap(recorded)
    np.testing.assert_allclose(continuous[np.isfinite(recorded)], heading[np.isfinite(recorded)], atol=1e-12)
    np.testing.assert_array_equal(np.isnan(continuous), np.isnan(recorded))


def test_unwrap_does_not_write_into_its_argument():
    """Law: what is given is left as it was."""
    angles = np.array([3.0, -3.0])
    unwrap(angles)
    np.testing.assert_array_equal(angles, [3.0, -3.0])
