"""Screening of measurements: repeated fixes and grid convergence, from the past alone."""

import numpy as np

from aspnn.estimation.measurements import carried, grid_convergence, repeated
from aspnn.frames import Zone, convergence

TIME = np.arange(100) / 10


def test_carried_holds_the_last_known_value():
    """Worked by hand: gaps take the last value, a leading gap the first, nothing known stays unknown."""
    nan = np.nan
    np.testing.assert_array_equal(carried(np.array([nan, 2.0, nan, nan, 5.0, nan])), [2, 2, 2, 2, 5, 5])
    assert np.isnan(carried(np.array([nan, nan]))).all()


def test_repeats_are_stale_only_if_the_ship_moved():
    """Worked by hand: a fix held for 1 s at 2 m/s is stale but for its first; below the threshold speed it is not."""
    fixes = np.column_stack([2.0 * TIME, 0 * TIME])
    fixes[40:50] = fixes[40]
    expected = np.zeros(100, bool)
    expected[41:50] = True
    np.testing.assert_array_equal(repeated(TIME, fixes, 0.3), expected)
    assert not repeated(TIME, fixes, 3.0).any()
    with_gaps = fixes.copy()
    with_gaps[44] = np.nan
    expected[44] = False
    np.testing.assert_array_equal(repeated(TIME, with_gaps, 0.3), expected)
    assert not repeated(TIME, fixes[:, ::-1] * 0, 0.3).any()  # never moved
    long = np.vstack([fixes[:40], np.tile(fixes[40], (60, 1))])
    assert repeated(TIME, long, 0.3)[41:].all()  # frozen for good


def test_convergence_holds_for_a_second_and_ignores_a_wild_fix():
    """Oracle: convergence of the true position at each epoch; a fix at (0, 0) for half a second changes nothing."""
    latitude = np.radians(69.65) + 1e-6 * TIME
    longitude = np.radians(18.96) + 2e-6 * TIME
    zone = Zone.parse("33N")
    exact = convergence(latitude, longitude, zone)
    gamma = grid_convergence(TIME, latitude, longitude, zone)
    np.testing.assert_allclose(gamma, exact, atol=1e-5)
    assert len(np.unique(gamma)) <= 10
    latitude[47:52], longitude[47:52] = 0.0, 0.0
    np.testing.assert_allclose(grid_convergence(TIME, latitude, longitude, zone), exact, atol=1e-5)
