"""Kawase's series, as Paper III and the thesis use them (E43), against pyproj over the waters of the papers."""

import numpy as np
import pytest
from reference import kawase

from aspnn import frames
from aspnn.frames import Zone

ZONE = Zone(33)
AGREE_M, AGREE_DEG = 6.3e-5, 8e-10  # measured on 1e6 points; the third order of the series leaves this
MARGIN = 1.1


def test_series_agree_over_the_whole_region():
    """Oracle: Kawase to third order at 40,000 places, 60 to 82 N, 9 to 21 E; measured 6.3e-5 m and 8e-10 deg, a tenth as margin."""
    latitude, longitude = np.radians(np.meshgrid(np.linspace(60, 82, 200), np.linspace(9, 21, 200)))
    north, east, gamma = kawase.grid(latitude, longitude, 33)
    ours = frames.to_grid(latitude, longitude, ZONE)
    assert np.hypot(ours[0] - north, ours[1] - east).max() < AGREE_M * MARGIN
    off = np.degrees(frames.convergence(latitude, longitude, ZONE) - gamma)
    assert np.abs(off).max() < AGREE_DEG * MARGIN


def test_misprinted_coefficient_over_the_whole_region():
    """Published (E43): alpha_1 = 1/2 - ... as printed is (1 - n) / 2 too large, which at Paper III's start is 1.44e6 m."""
    latitude, longitude = frames.to_geodetic(8503821.0, 434061.0, ZONE)
    right, printed = (kawase.grid(latitude, longitude, 33, alpha)[0] for alpha in (kawase.ALPHA, kawase.PRINTED_ALPHA))
    assert abs(printed - right) == pytest.approx(1.44e6, rel=0.005)
    assert abs(right - 8503821.0) < 1e-4


@pytest.mark.parametrize(
    "north, east, published, aside",
    [(8503821.0, 434061.0, -2.4823, -41.0), (8635500.0, 424155.0, -3.0933, 1080.0)],
)
def test_published_convergences(north, east, published, aside):
    """Published (Paper III, table 2): they hold 41 m west and 1.08 km east of the published starts."""
    place = frames.to_geodetic(north, east + aside, ZONE)
    assert np.degrees(frames.convergence(*place, ZONE)) == pytest.approx(published, abs=1e-4)
    assert kawase.grid(*place, 33)[2] == pytest.approx(np.radians(published), abs=2e-6)
