"""The published path algorithms, as printed and corrected, against the exact step and the figures of errata E40 and E41."""

import numpy as np
import pytest

from aspnn.motion import Path, integrate, paper_v_path, pivot_path
from aspnn.motion.algorithms import midpoint_path, paper_v_corrected, paper_v_printed, paper_vi_printed, thesis_printed

# E40 and E41 state a 90 m ship at 1 deg/s; 5 m/s and a pivot point 22 m ahead give their figures. The boat's are assumed.
SHIP, BOAT = (5.0, 22.0, 1.0, 90.0, 35.0), (5.0, 2.37, 25.0, 10.0, 3.2)
POSE = (40.0, -30.0, 0.3)


def case(of, dt):
    """Surge, sway and yaw rate by step, the arguments of Paper V's algorithms, and the exact path."""
    surge, pivot, rate, span, station = of
    r = np.full(round(span / dt), np.radians(rate))
    motion = np.full(len(r), surge), -pivot * r, r
    stations = motion[0], *(motion[1] + r * x for x in (station, -station)), dt, station, -station
    return motion, stations, integrate(POSE, np.stack(motion, axis=-1), dt)


def apart(a: Path, b: Path) -> float:
    return float(np.hypot(a.north[-1] - b.north[-1], a.east[-1] - b.east[-1]))


@pytest.mark.parametrize("dt, error, rtol", [(0.1, 5e-5, 0.05), (5.0, 0.13, 0.02)])
def test_midpoint_heading(dt, error, rtol):
    """Published figures (E40): 5e-5 m at steps of 0.1 s, 0.13 m at 5 s."""
    motion, _, exact = case(SHIP, dt)
    np.testing.assert_allclose(apart(midpoint_path(POSE, *motion, dt), exact), error, rtol=rtol)


def test_midpoint_heading_is_of_second_order():
    """Order of the method: half the step, a quarter of the error."""
    errors = [apart(midpoint_path(POSE, *case(BOAT, dt)[0], dt), case(BOAT, dt)[2]) for dt in (0.2, 0.1)]
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.01)


@pytest.mark.parametrize("of", [SHIP, BOAT])
@pytest.mark.parametrize("dt", [0.1, 0.5])
def test_thesis_as_printed_is_a_step_late(of, dt):
    """By construction (E40): the corrected path one step later, so the turn of a step behind at its end."""
    motion, _, exact = case(of, dt)
    printed, corrected = thesis_printed(POSE, *motion, dt), pivot_path(POSE, *motion, dt)
    for name in ("north", "east", "heading"):
        np.testing.assert_array_equal(getattr(printed, name)[1:], getattr(corrected, name)[:-1])
    np.testing.assert_allclose(exact.heading[-1] - printed.heading[-1], motion[2][0] * dt, rtol=1e-9)
    assert printed.north[0] == POSE[0] and len(printed.north) == len(exact.north)


def test_paper_vi_as_printed_by_hand():
    """Independent transcription of Paper VI's algorithm 2, line by line with its matrix, the start's heading in both lines of PP."""
    u, v, r, dt, steps = 5.0, -1.0, 0.4, 0.13, 40
    place, heading, lever = np.array(POSE[:2]), POSE[2], -v / r
    for _ in range(steps - 1):  # the first of the loop's places is the start
        moved = place + u * dt * np.array([np.cos(heading), np.sin(heading)])
        pivot = moved + lever * np.array([np.cos(POSE[2]), np.sin(POSE[2])])
        c, s = np.cos(r * dt), np.sin(r * dt)
        place = np.array([[c, -s], [s, c]]) @ (moved - pivot) + pivot
        heading += r * dt
    path = paper_vi_printed(POSE, np.full(steps, u), v, r, dt)
    np.testing.assert_allclose([path.north[-1], path.east[-1], path.heading[-1]], [*place, heading], rtol=0, atol=1e-9)
    straight = paper_vi_printed((0, 0, np.pi / 2), np.full(10, 5.0), 1.0, 0.0, 1.0)
    np.testing.assert_allclose([straight.north[-1], straight.east[-1]], [-9, 45], atol=1e-12)


@pytest.mark.parametrize("of", [SHIP, BOAT])
def test_paper_v_as_printed_turns_the_wrong_way(of):
    """Published figure (E41a): with a length for the distance the heading runs to -90 deg where the ship turns to +90."""
    _, stations, exact = case(of, 0.1)
    printed = paper_v_printed(POSE, *stations)
    np.testing.assert_allclose(printed.heading - POSE[2], POSE[2] - exact.heading, atol=1e-9)
    if of is SHIP:
        np.testing.assert_allclose(np.degrees(printed.heading[-1] - POSE[2]), -90)


def test_paper_v_as_printed_is_right_behind_the_stern():
    """By hand: with the pivot point abaft the stern station the length is the signed distance, and the two forms agree."""
    _, stations, _ = case((5.0, -6.0, 10.0, 8.0, 3.2), 0.1)
    printed, signed = paper_v_printed(POSE, *stations), paper_v_path(POSE, *stations)
    for name in ("north", "east", "heading"):
        np.testing.assert_allclose(getattr(printed, name), getattr(signed, name), atol=1e-9)


@pytest.mark.parametrize("of, error, atol", [(SHIP, 31, 0.5), (BOAT, 4.3, 0.01)])
def test_paper_v_corrected_keeps_the_sway(of, error, atol):
    """Published figures (E41b): without the turn about the pivot point 31 m after 90 s, 4.3 m after 10 s; with it first order."""
    _, stations, exact = case(of, 0.1)
    np.testing.assert_allclose(apart(paper_v_path(POSE, *stations), exact), error, rtol=0, atol=atol)
    errors = [apart(paper_v_corrected(POSE, *case(of, dt)[1]), case(of, dt)[2]) for dt in (0.2, 0.1)]
    np.testing.assert_allclose(errors[0] / errors[1], 2, rtol=0.01)
    assert errors[1] < 0.42


def test_paper_v_corrected_without_turning():
    """By hand (E41c): equal sways are a translation, 50 m ahead and 10 m to starboard, heading east."""
    path = paper_v_corrected((0, 0, np.pi / 2), np.full(10, 5.0), 1.0, 1.0, 1.0, 3.2, -3.2)
    np.testing.assert_allclose([path.north[-1], path.east[-1], path.heading[-1]], [-10, 50, np.pi / 2], atol=1e-12)


@pytest.mark.parametrize("algorithm", [thesis_printed, paper_vi_printed, midpoint_path])
def test_batch_is_its_members(algorithm):
    """Law: a batch of motions gives the paths one by one."""
    draw = np.random.default_rng(0)
    poses, (u, v, r) = draw.normal(size=(3, 3)), draw.normal([[[5.0]], [[0.0]], [[0.0]]], 0.3, (3, 3, 7))
    together = algorithm(poses, u, v, r, 0.5)
    for k in range(3):
        alone = algorithm(poses[k], u[k], v[k], r[k], 0.5)
        for name in ("north", "east", "heading"):
            np.testing.assert_allclose(getattr(together[k], name), getattr(alone, name), atol=1e-12)
