"""Indices of path following, on tracks whose areas are known."""

import numpy as np
import pytest

from aspnn.evaluation.path_indices import area, path_indices
from aspnn.schema import InputError


def test_areas_are_exact_for_straight_pieces():
    """Oracle: triangles by hand; where the track crosses the line both sides count."""
    assert area(np.array([0.0, 4.0]), np.array([0.0, 3.0])) == pytest.approx(6.0)
    assert area(np.array([0.0, 4.0]), np.array([-1.0, 3.0])) == pytest.approx(0.5 + 4.5)
    assert area(np.array([4.0, 0.0, 4.0]), np.array([1.0, 1.0, -1.0])) == pytest.approx(4.0 + 2.0)
    assert area(np.array([0.0, 1.0, 2.0]), np.zeros(3)) == 0.0


def test_a_track_of_known_parts():
    """Oracle: by hand. Back 3 m and 8 m to port, a straight approach over 16 m to 2 m to starboard, 80 m there, 4 m beyond the end."""
    t = np.linspace(0, 1, 401)
    along = np.concatenate([3 * (np.cos(np.pi * t) - 1) / 2, -3 + 16 * t[1:], 13 + 81 * t[1:]])
    cross = np.concatenate([-8 * t, -8 + 10 * t[1:], np.full(400, 2.0)])
    found = path_indices(along, cross, 90.0, band=0.25)
    turning = 8 * 3 * np.trapezoid(t, (1 - np.cos(np.pi * t)) / 2)
    assert found.turning_area == pytest.approx(turning, rel=1e-3)
    full = 16 * (8**2 + 2**2) / (2 * 10)  # the two triangles of the approach
    assert found.approach_area + found.steady_area == pytest.approx(full + 81 * 2.0, rel=1e-9)
    early = 16 * 0.25 / 10  # the band is reached that much before the approach ends, at most a step later
    assert found.steady_area_per_m == pytest.approx(2.0, abs=0.01)
    assert found.steady_from == pytest.approx(13 - early, abs=0.05)
    assert (found.offset, found.vertical, found.steady_vertical) == (2.0, 8.0, 2.0)
    assert found.horizontal == pytest.approx(4.0)
    assert found.steady_rms == pytest.approx(2.0, abs=0.01)


def test_a_track_on_the_line_has_no_area():
    """Oracle: zero, and no excursion; the mirrored track has the same indices but for the side of the offset."""
    x = np.linspace(0, 50, 100)
    found = path_indices(x, np.zeros(100), 50.0)
    assert found.turning_area == found.approach_area == found.steady_area == found.vertical == found.horizontal == 0.0
    y = 5 * np.exp(-x / 5) * np.cos(x / 3) + 0.7
    one, other = path_indices(x, y, 50.0), path_indices(x, -y, 50.0)
    assert one.offset == pytest.approx(-other.offset) and one.approach_area == pytest.approx(other.approach_area)


def test_what_cannot_be_judged_is_named():
    """Oracle: the message says what is wrong."""
    x = np.linspace(0, 50, 100)
    with pytest.raises(InputError, match="sail longer"):
        path_indices(x, 0.2 * x, 50.0)
    with pytest.raises(InputError, match="three places"):
        path_indices(x[:2], x[:2], 50.0)
    with pytest.raises(InputError, match="three places"):
        path_indices(x, np.where(x > 20, np.nan, 0.0), 50.0)
    with pytest.raises(InputError, match="no length"):
        path_indices(np.zeros(100), np.zeros(100), 50.0)
