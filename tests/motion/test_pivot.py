"""Pivot point against rigid kinematics, a Monte Carlo of its errors, and Paper V's table of regions, verbatim."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.motion import pivot_point, pivot_point_sd, region_of, region_pivot, two_station_motion
from aspnn.motion.pivot import Z_95, Motion, RegionMap, exact

TABLE = pd.read_csv(Path(__file__).parents[1] / "reference" / "paper_v_table_4.csv", comment="#")
LENGTH = 90.0
SECTION = LENGTH / 8


@pytest.mark.parametrize("sway, yaw_rate", [(-0.38, 0.0175), (0.4, -0.02), (0.3, 0.01), (-0.2, -0.03)])
def test_sway_vanishes_at_the_pivot_point(sway, yaw_rate):
    """Law (E39): v + r x_pp = 0."""
    place = pivot_point(sway, yaw_rate)
    np.testing.assert_allclose(sway + yaw_rate * place, 0, atol=1e-15)


def test_pivot_point_lies_ahead_in_an_ordinary_turn():
    """By hand: a ship that turns to starboard sways to port at midship (v < 0 < r), or the mirror image."""
    np.testing.assert_allclose(pivot_point([-0.35, 0.35], [0.0175, -0.0175]), [20, 20])


def test_pivot_point_from_two_stations():
    """Law of the rigid hull, stations not symmetric: x_pp = (x2 v1 - x1 v2) / (v1 - v2), in errata E39."""
    u_bow, u_stern = 0.2, -0.9
    sway, yaw_rate = two_station_motion(u_bow, u_stern, 40.0, -30.0)
    np.testing.assert_allclose(sway + yaw_rate * np.array([40.0, -30.0]), [u_bow, u_stern], atol=1e-15)
    np.testing.assert_allclose(pivot_point(sway, yaw_rate), (-30.0 * u_bow - 40.0 * u_stern) / (u_bow - u_stern))


def test_pivot_point_is_undefined_without_turning():
    """Definition: NaN at r = 0 and where r is within `certainty` standard deviations of 0; never a wild number."""
    sd = np.radians(0.01)
    place = pivot_point(0.3, [0.0, 2.9 * sd, 3.1 * sd, -3.1 * sd], sd)
    np.testing.assert_array_equal(np.isnan(place), [True, True, False, False])
    assert np.isnan(pivot_point(0.0, 0.0)) and np.isnan(pivot_point_sd(0.1, 0.0, 0.02, sd))
    np.testing.assert_array_equal(np.isnan(pivot_point_sd(0.3, [2.9 * sd, 3.1 * sd], 0.02, sd)), [True, False])
    assert np.isnan(pivot_point(0.3, 2.1 * sd, sd)) and not np.isnan(pivot_point(0.3, 2.1 * sd, sd, certainty=2))


def test_standard_deviation_is_that_of_a_monte_carlo():
    """Monte Carlo, 400,000 draws: its standard deviation is known to 1 / sqrt(2 n) = 0.11 %, five times that is allowed.

    Errors of 0.02 m/s and 0.01 deg/s at 1 deg/s and a pivot point 22 m ahead give 1.167 m, as errata E39 states.
    """
    draw, n = np.random.default_rng(0), 400_000
    yaw_rate, sway_sd, yaw_rate_sd = np.radians(1.0), 0.02, np.radians(0.01)
    sway = -22.0 * yaw_rate
    sd = pivot_point_sd(sway, yaw_rate, sway_sd, yaw_rate_sd)
    np.testing.assert_allclose(sd, 1.167, rtol=0, atol=5e-4)
    places = pivot_point(sway + sway_sd * draw.normal(size=n), yaw_rate + yaw_rate_sd * draw.normal(size=n))
    np.testing.assert_allclose(np.std(places), sd, rtol=5 / np.sqrt(2 * n))


def test_regions_are_paper_v_table_4():
    """Published table: inside each range its region; just beside each limit the neighbour; far away the outermost."""
    for row in TABLE.itertuples():
        low, high = max(row[2], -1e3), min(row.to, 1e3)
        inside = np.array([low + 1e-6, (low + high) / 2, high - 1e-6]) * SECTION
        np.testing.assert_array_equal(region_of(inside, LENGTH), row.region)
    np.testing.assert_array_equal(region_of([-np.inf, np.inf, np.nan], LENGTH), [-7, 7, np.nan])


def test_two_sways_map_to_the_place_of_the_table():
    """Published table: sways that put the exact pivot point into a region map to that region's place, turning either way."""
    for row in TABLE.itertuples():
        exact = (max(row[2], -25.0) + min(row.to, 25.0)) / 2 * SECTION
        for yaw_rate in (0.02, -0.02):
            bow, stern = (yaw_rate * (x - exact) for x in (35.0, -35.0))
            np.testing.assert_allclose(region_pivot(bow, stern, 35.0, -35.0, LENGTH), row.place * SECTION)


def test_map_is_within_half_a_section_amidships():
    """Law of the table: regions -4 to 4 are one section long and mapped to their middle, 5 and 6 two and four sections."""
    exact = np.linspace(-10.4, 10.4, 2001) * SECTION
    mapped = region_pivot(0.02 * (35 - exact), 0.02 * (-35 - exact), 35.0, -35.0, LENGTH)
    sections = np.abs(mapped - exact) / SECTION
    reach = np.abs(exact) / SECTION
    assert np.all(sections[reach < 4.5] <= 0.5 + 1e-9)
    assert np.all(sections[reach < 6.5] <= 1 + 1e-9) and np.all(sections <= 2 + 1e-9)
    assert sections.max() > 1.9


@pytest.mark.parametrize("sway, place", [(0.3, -20), (-0.3, 20), (0.0, 20)])
def test_equal_sways_put_the_pivot_point_outermost(sway, place):
    """Definition: without turning the pivot point is at infinity; the side is that of the docstring."""
    np.testing.assert_allclose(region_pivot(sway, sway, 35.0, -35.0, LENGTH), place * SECTION)


def test_unknown_sway_has_no_place():
    """Law: NaN in, NaN out, the others untouched."""
    place = region_pivot([np.nan, 0.0], [0.3, -0.7], 35.0, -35.0, LENGTH)
    np.testing.assert_array_equal(place, [np.nan, 3 * SECTION])


MOTION = Motion(np.array([-0.5, 0.4, 0.02]), np.array([0.02, 0.03, -0.01]), 0.05, 0.001, 2e-5)


def test_exact_way_is_the_pivot_point_and_its_deviation():
    """Definitions (E39): place and first-order deviation, by the functions above where the errors are independent."""
    found = exact(MOTION._replace(covariance=0.0))
    np.testing.assert_array_equal(found.place, pivot_point(*MOTION[:2], MOTION.yaw_rate_sd))
    np.testing.assert_allclose(found.sd, pivot_point_sd(*MOTION[:4]), rtol=1e-14)


def test_ends_of_the_interval_are_where_the_sway_is_just_no_longer_zero():
    """Law (Fieller): at both ends the sway v + r x is 1.96 of its own deviations from zero, covariance included."""
    found = exact(MOTION)
    v, r, sd_v, sd_r, c = MOTION
    for end in (found.low, found.high):
        away = (v + r * end) / np.sqrt(sd_v**2 + 2 * end * c + (end * sd_r) ** 2)
        np.testing.assert_allclose(np.abs(away), Z_95, rtol=1e-10)
    assert np.all((found.low < found.place) & (found.place < found.high))


@pytest.mark.parametrize("correlation", [-0.8, 0.0, 0.8])
def test_interval_holds_the_true_pivot_point_in_95_of_100_cases(correlation):
    """Monte Carlo of 200,000 draws, 1 / sqrt(n) of a share allowed (two deviations), at a turn of only 8 deviations of r."""
    draw, n = np.random.default_rng(5), 200_000
    v, r, sd_v, sd_r = -0.4, 0.02, 0.05, 0.0025
    one, two = draw.standard_normal((2, n))
    yaw_rate = r + sd_r * (correlation * one + np.sqrt(1 - correlation**2) * two)
    found = exact(Motion(v + sd_v * one, yaw_rate, sd_v, sd_r, correlation * sd_v * sd_r))
    share = np.mean((found.low <= -v / r) & (-v / r <= found.high))
    np.testing.assert_allclose(share, 0.95, rtol=0, atol=1 / np.sqrt(n))


def test_two_stations_carry_the_errors_of_both():
    """By hand: v + r x is w v_1 + (1 - w) v_2 with w = (x - x_2) / (x_1 - x_2), so both deviations weigh in that way."""
    motion = Motion.of_stations(0.2, -0.9, 0.03, 0.05, 40.0, -30.0)
    found = exact(motion)
    w = (found.place + 30) / 70
    by_hand = np.hypot(w * 0.03, (1 - w) * 0.05) / (1.1 / 70)
    np.testing.assert_allclose(found.place, pivot_point(*two_station_motion(0.2, -0.9, 40.0, -30.0)), rtol=1e-14)
    np.testing.assert_allclose(found.sd, by_hand, rtol=1e-12)
    np.testing.assert_allclose(motion.yaw_rate_sd, np.hypot(0.03, 0.05) / 70, rtol=1e-14)


def test_region_map_as_a_way_is_table_4():
    """Published table: the place of the region, and without errors the region's own limits as interval."""
    far = {-np.inf: -1e3, np.inf: 1e3}
    for row in TABLE.itertuples():
        middle = (far.get(row[2], row[2]) + far.get(row.to, row.to)) / 2 * SECTION
        found = RegionMap(LENGTH)(Motion(-0.02 * middle, 0.02))
        np.testing.assert_allclose(found.place, row.place * SECTION)
        np.testing.assert_allclose([found.low, found.high], [row[2] * SECTION, row.to * SECTION])
        np.testing.assert_allclose(found.sd, (row.to - row[2]) * SECTION / np.sqrt(12))
    both = Motion(-0.02 * 1.4 * SECTION, 0.02, 0.02 * 0.2 * SECTION)  # 95 % reach from 1.0 to 1.8 sections: two regions
    found = RegionMap(LENGTH)(both)
    np.testing.assert_allclose([found.low, found.place, found.high], [0.5 * SECTION, SECTION, 2.5 * SECTION])


@pytest.mark.parametrize("way", [exact, RegionMap(LENGTH)])
def test_every_way_is_undefined_without_turning(way):
    """Definition: NaN in all four answers at r = 0 and within three deviations of it, finite places beyond."""
    found = way(Motion([0.3, 0.3, 0.0, 0.3], [0.0, 2.9e-3, 0.0, 3.1e-3], 0.02, 1e-3))
    for values in found:
        np.testing.assert_array_equal(np.isnan(values), [True, True, True, False])
    assert np.isnan(way(Motion(0.3, 0.0)).place)
