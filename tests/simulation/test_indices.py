"""Indices of trials, on motions whose indices are known."""

import numpy as np
import pytest

from aspnn.simulation.trials.indices import (
    return_indices,
    spiral_loop,
    steady_turn,
    stopping_indices,
    travelled,
    turning_circle_indices,
    turning_times,
    zigzag_indices,
    zigzag_overshoots,
)


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
    time, still = np.arange(174.0), np.zeros(174)
    whole = zigzag_indices(
        time, still, still, 1.0 + side * np.radians(heading), side * np.radians(order), np.radians(20)
    )
    np.testing.assert_allclose(np.degrees(whole.overshoots), [7, 12], atol=1e-9)
    assert list(whole.executes) == [0, 20, 74, 138] and list(whole.peaks) == [27, 86] and whole.period == 118


def test_track_and_times_of_a_circle():
    """Oracle: geometry; at 10 m/s round a radius of 200 m by pi / 2 the time is 5 pi s, and the track as long as the arc."""
    time = np.linspace(0, 80, 8001)
    angle = 0.05 * time
    north, east = 200 * np.sin(angle), 200 * (1 - np.cos(angle))
    np.testing.assert_allclose(
        turning_times(time, angle, [np.pi / 2, np.pi, 9.0]), [10 * np.pi, 20 * np.pi, np.nan], atol=1e-6
    )
    np.testing.assert_allclose(travelled(north, east)[-1], 200 * 4, rtol=1e-6)
    found = zigzag_indices(time, north, east, angle, np.full(len(time), 0.2), 0.3)
    assert found.initial_track == pytest.approx(60, rel=1e-5) and found.initial_time == pytest.approx(6, rel=1e-9)
    assert len(found.overshoots) == 0 and np.isnan(found.period)


def test_steady_turn_is_the_circle_of_its_velocities():
    """Oracle: rigid-body kinematics; U = 5, r = 0.05: the radius is 100 m; the bow points inward of the course in a turn to starboard."""
    found = steady_turn(4.0, -3.0, 0.05)
    assert found == pytest.approx((200.0, 5.0, np.arctan2(3, 4), 0.05, 60.0))


def test_a_straight_stop():
    """Oracle: uniform deceleration from 8 m/s at 0.1 m/s2 on a course of 1 rad: 80 s, 320 m, all of it ahead."""
    time = np.linspace(0, 100, 10001)
    way = 8 * time - 0.05 * time**2
    found = stopping_indices(time, way * np.cos(1), way * np.sin(1), np.ones(len(time)), 8 - 0.1 * time)
    np.testing.assert_allclose(found, [80, 320, 320, 0, 0], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("side", [1, -1])
def test_back_on_the_reciprocal_course(side):
    """Oracle: a track drawn by hand: 300 m ahead, half a circle of radius 50 m, and back 100 m abeam of the old track, at 10 m/s."""
    time = np.arange(0, 100, 0.01)
    turn = np.clip((time - 30) / 5, 0, np.pi)
    home = np.clip(time - 30 - 5 * np.pi, 0, None)
    north = np.minimum(10 * time, 300) + 50 * np.sin(turn) - 10 * home
    found = return_indices(time, north, side * 50 * (1 - np.cos(turn)), side * turn, within=np.radians(0.1))
    assert found.time == pytest.approx(30 + 5 * np.pi, abs=0.02) and found.offset == pytest.approx(side * 100, abs=0.01)
    assert found.abeam_time == pytest.approx(60 + 5 * np.pi, abs=0.02) and found.abeam_offset == pytest.approx(
        side * 100
    )
    never = return_indices(time[:3000], north[:3000], 0 * time[:3000], 0 * time[:3000])
    assert np.isnan(never.time) and np.isnan(never.abeam_time)


def test_spiral_of_a_cubic():
    """Oracle: delta = r^3 - r folds at r = -+1 / sqrt 3, so its loop is 4 / (3 sqrt 3) wide and 2 high; delta = r + r^3 has slope 1."""
    rudder = np.linspace(-3, 3, 601)
    roots = [np.roots([1, 0, -1, -delta]) for delta in rudder]
    real = [r.real[np.abs(r.imag) < 1e-6] for r in roots]
    found = spiral_loop(rudder, [r.max() for r in real], [r.min() for r in real])
    assert found.width == pytest.approx(4 / (3 * np.sqrt(3)), abs=found.known) and found.known < 0.011
    assert found.height == pytest.approx(2) and np.isnan(found.slope)
    single = np.array([np.real(r[np.abs(r.imag) < 1e-9][0]) for r in (np.roots([1, 0, 1, -delta]) for delta in rudder)])
    stable = spiral_loop(rudder, single, single)
    assert stable.width == 0 and stable.height == 0 and stable.slope == pytest.approx(1, abs=1e-3)
