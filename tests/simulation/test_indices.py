"""Indices of trials, on motions whose indices are known."""

import numpy as np
import pytest

from aspnn.simulation import turning_circle_indices, zigzag_overshoots


@pytest.mark.parametrize("side", [1, -1])
def test_indices_of_a_circle_after_a_straight(side):
    """Oracle: geometry; ordered 30 m before a circle of radius 100 m: advance 130, transfer 100, tactical diameter 200."""
    time = np.arange(0, 100, 0.1)
    angle = side * np.clip(time - 13, 0, None) * 0.1  # the order at 10 s, the circle at 13 s, 10 m/s
    place = np.where(time < 13, 10 * (time - 10), 30 + 100 * np.sin(np.abs(angle))) + 1j * side * 100 * (
        1 - np.cos(angle)
    )
    place = place * np.exp(0.7j) + (500 - 200j)
    found = turning_circle_indices(time, place.real, place.imag, 0.7 + angle, start=10.0)
    np.testing.assert_allclose(found, [130, 100, 200], atol=0.05)


def test_a_turn_that_ends_early_has_no_tactical_diameter():
    """Oracle: definition."""
    time = np.arange(0, 30, 0.1)
    angle = 0.1 * time
    found = turning_circle_indices(time, 100 * np.sin(angle), 100 * (1 - np.cos(angle)), angle)
    assert found.advance == pytest.approx(100, abs=0.1) and np.isnan(found.tactical_diameter)


@pytest.mark.parametrize("side", [1, -1])
def test_overshoots_of_a_made_up_zigzag(side):
    """Oracle: a heading drawn by hand; execute at 20 degrees, turns back at 27, -32 and 30; the last leg is not over."""
    heading = np.interp(np.arange(174), [0, 27, 86, 148, 173], [0, 27, -32, 30, 5])  # a degree per step
    order = np.repeat([20, -20, 20, -20], [20, 54, 64, 36])  # reversed at 20, -20 and 20 degrees
    found = zigzag_overshoots(1.0 + side * np.radians(heading), side * np.radians(order), np.radians(20))
    np.testing.assert_allclose(np.degrees(found), [7, 12], atol=1e-9)
