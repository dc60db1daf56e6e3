"""Paths of a rigid hull against circles, an ODE solver and the figures of errata E40 and E41."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aspnn.motion import (
    Path,
    integrate,
    paper_v_path,
    pivot_path,
    pivot_point,
    region_map_path,
    two_station_motion,
)

# The case of errata E40 and E41 is a 90 m ship turning at 1 deg/s for 90 s. Its surge and pivot point are not stated: 5 m/s
# and 22 m ahead of midship reproduce all its figures.
SURGE, YAW_RATE, PIVOT, SPAN = 5.0, np.radians(1.0), 22.0, 90.0
SWAY = -YAW_RATE * PIVOT
STATIONS = (35.0, -35.0)


def case(dt):
    """Surge, sway and yaw rate of the errata's case, one value per step."""
    steps = round(SPAN / dt)
    return np.full(steps, SURGE), np.full(steps, SWAY), np.full(steps, YAW_RATE)


def at_stations(sway, yaw_rate):
    return tuple(sway + yaw_rate * x for x in STATIONS)


def apart(a: Path, b: Path) -> float:
    """Distance [m] between the ends of two paths."""
    return float(np.hypot(a.north[..., -1] - b.north[..., -1], a.east[..., -1] - b.east[..., -1]))


@pytest.mark.parametrize("u, v, r", [(7.0, -1.2, 0.012), (5.0, 0.8, -0.02), (6.0, 0.0, 0.01)])
def test_steady_turn_is_a_circle(u, v, r):
    """Constant body velocity runs a circle about one turning centre, and the pivot point lies abeam of it."""
    steps = 500
    path = integrate(pose=(40.0, -30.0, 0.3), velocity=np.tile([u, v, r], (steps, 1)), dt=2 * np.pi / abs(r) / steps)
    place = path.north + 1j * path.east
    centre = place + np.exp(1j * path.heading) * 1j * (u + 1j * v) / r
    np.testing.assert_allclose(centre, centre[0], atol=1e-9)
    np.testing.assert_allclose(place[-1], place[0], atol=1e-9)
    abeam = (centre[0] - place[0]) * np.exp(-1j * path.heading[0])
    np.testing.assert_allclose(pivot_point(v, r), abeam.real, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("r", [0.03, -0.01, 1e-9, 0.0])
def test_two_half_steps_are_one_step(r):
    """Composition law of rigid motion, also where the turn rate vanishes."""
    one = integrate((1.0, 2.0, 0.7), [[6.0, -0.5, r]], 40.0)
    two = integrate((1.0, 2.0, 0.7), [[6.0, -0.5, r]] * 2, 20.0)
    for name in ("north", "east", "heading"):
        np.testing.assert_allclose(getattr(one, name)[-1], getattr(two, name)[-1], rtol=0, atol=1e-12)


def test_straight_run_by_hand():
    """By hand: heading east, 5 m/s ahead and 1 m/s to starboard for 10 s ends 50 m east and 10 m south."""
    path = integrate((0.0, 0.0, np.pi / 2), [[5.0, 1.0, 0.0]] * 10, 1.0)
    np.testing.assert_allclose([path.north[-1], path.east[-1], path.heading[-1]], [-10, 50, np.pi / 2], atol=1e-12)


def test_exact_step_is_the_solution_of_the_kinematic_equations():
    """scipy solve_ivp of N' = u cos psi - v sin psi, E' = u sin psi + v cos psi, psi' = r with velocities held over steps."""
    draw, dt = np.random.default_rng(1), np.array([3.0, 1.0, 5.0, 2.0, 4.0])
    velocity = draw.normal([6, 0, 0], [1, 0.5, 0.05], (5, 3))
    pose = np.array([100.0, -50.0, 2.5])
    path = integrate(pose, velocity, dt)
    for step, (u, v, r) in enumerate(velocity):

        def rate(_, x, u=u, v=v, r=r):
            c, s = np.cos(x[2]), np.sin(x[2])
            return [u * c - v * s, u * s + v * c, r]

        pose = solve_ivp(rate, (0, dt[step]), pose, rtol=1e-12, atol=1e-12).y[:, -1]
        reached = [path.north[step + 1], path.east[step + 1], path.heading[step + 1]]
        np.testing.assert_allclose(reached, pose, rtol=0, atol=1e-9)
    np.testing.assert_allclose(path.time, [0, 3, 4, 9, 11, 15])


def test_batch_is_its_members():
    """Law: a batch of paths is the paths one by one, with their own convergence."""
    draw = np.random.default_rng(2)
    velocity, poses = draw.normal([6, 0, 0], [1, 0.5, 0.05], (3, 7, 3)), draw.normal(size=(3, 3))
    together = integrate(poses, velocity, 0.5)
    for k in range(3):
        alone = integrate(poses[k], velocity[k], 0.5)
        for name in ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot"):
            np.testing.assert_array_equal(getattr(together[k], name), getattr(alone, name))
    bow = np.stack([integrate(poses[k], velocity[k], 0.5).sway_at(35.0) for k in range(3)])
    np.testing.assert_array_equal(together.sway_at(35.0), bow)


@pytest.mark.parametrize("dt, error, atol", [(0.1, 0.35, 0.005), (5.0, 17.7, 0.05)])
def test_first_order_error_of_the_thesis_algorithm(dt, error, atol):
    """Published figures (E40): thesis table 4.1 in corrected form misses the exact place by 0.35 m and 17.7 m at 90 s."""
    u, v, r = case(dt)
    exact = integrate((0, 0, 0), np.stack([u, v, r], axis=-1), dt)
    thesis = pivot_path((0, 0, 0), u, v, r, dt)
    np.testing.assert_allclose(apart(thesis, exact), error, rtol=0, atol=atol)
    np.testing.assert_allclose(thesis.heading, exact.heading, atol=1e-12)


def test_wrong_side_of_the_pivot_point():
    """Published figure (E40): with the sign of L flipped the thesis's algorithm ends 61.9 m away."""
    u, v, r = case(0.1)
    exact = integrate((0, 0, 0), np.stack([u, v, r], axis=-1), 0.1)
    flipped = pivot_path((0, 0, 0), u, -v, r, 0.1)
    np.testing.assert_allclose(apart(flipped, exact), 61.9, rtol=0, atol=0.05)


def test_pivot_path_converges_in_first_order():
    """Order of the method: half the step, half the error; and no turning is a plain translation."""
    errors = []
    for dt in (1.0, 0.5):
        u, v, r = case(dt)
        errors.append(apart(pivot_path((0, 0, 0.4), u, v, r, dt), integrate((0, 0, 0.4), np.stack([u, v, r], -1), dt)))
    np.testing.assert_allclose(errors[0] / errors[1], 2, rtol=0.01)
    straight = pivot_path((0, 0, np.pi / 2), np.full(10, 5.0), np.full(10, 1.0), np.zeros(10), 1.0)
    np.testing.assert_allclose([straight.north[-1], straight.east[-1]], [-10, 50], atol=1e-12)


def test_paper_v_update_loses_the_sway():
    """Published figure (E41b): 31 m after 90 s, which is the integral of the sway alone."""
    u, v, r = case(0.1)
    exact = integrate((0, 0, 0), np.stack([u, v, r], axis=-1), 0.1)
    printed = paper_v_path((0, 0, 0), u, *at_stations(v, r), 0.1, *STATIONS)
    np.testing.assert_allclose(apart(printed, exact), 31, rtol=0, atol=0.5)
    without_sway = integrate((0, 0, 0), np.stack([u, 0 * v, r], axis=-1), 0.1)
    assert apart(printed, without_sway) < 0.4  # first order in dt, as above
    np.testing.assert_allclose(
        np.diff(printed.north), SURGE * 0.1 * np.cos(printed.heading[1:]), atol=1e-9
    )  # turns, then moves
    np.testing.assert_allclose(np.diff(printed.east), SURGE * 0.1 * np.sin(printed.heading[1:]), atol=1e-9)
    np.testing.assert_allclose(printed.heading, exact.heading, atol=1e-12)


@pytest.mark.parametrize("yaw_rate", [YAW_RATE, -YAW_RATE])
@pytest.mark.parametrize("region", [-2, -1, 0, 1, 2, 4])
def test_region_map_is_exact_at_the_middle_of_a_region(region, yaw_rate):
    """Exact step: where the pivot point is a region's own place, map and rigid body agree, and turn the right way (E41a)."""
    place = region * 90.0 / 8
    u, r = np.full(45, SURGE), np.full(45, yaw_rate)
    exact = integrate((5, 6, 0.2), np.stack([u, -r * place, r], axis=-1), 2.0)
    mapped = region_map_path((5, 6, 0.2), u, *at_stations(-r * place, r), 2.0, *STATIONS, 90.0)
    for name in ("north", "east", "heading", "sway", "pivot"):
        np.testing.assert_allclose(getattr(mapped, name), getattr(exact, name), atol=1e-9)
    np.testing.assert_array_equal(mapped.pivot_region(90.0), region)


def test_region_map_turns_as_the_stern_sways():
    """By hand: a pivot point 22 m ahead is mapped to 22.5 m, so r = v_stern / (-35 - 22.5), which is 57 / 57.5 of the truth."""
    u, v, r = case(1.0)
    mapped = region_map_path((0, 0, 0), u, *at_stations(v, r), 1.0, *STATIONS, 90.0)
    np.testing.assert_allclose(mapped.yaw_rate, r[0] * 57 / 57.5)
    np.testing.assert_allclose(mapped.pivot, 22.5)


def test_region_map_at_its_pole():
    """Law: where the stern station is a region's place, the rate comes from the two sways and the path is the exact one."""
    stern = -3 * 80.0 / 8
    r = np.full(20, 0.01)
    bow_sway, stern_sway = r * (30.0 - stern), 0 * r  # the hull turns about the stern station itself
    path = region_map_path((0, 0, 0), np.full(20, 5.0), bow_sway, stern_sway, 1.0, 30.0, stern, 80.0)
    exact = integrate((0, 0, 0), np.stack([np.full(20, 5.0), -r * stern, r], axis=-1), 1.0)
    assert np.isfinite(path.north).all()
    np.testing.assert_allclose(path.yaw_rate, exact.yaw_rate)
    assert apart(path, exact) < 1e-9


def test_stations_give_back_the_motion():
    """Law of the rigid hull: sway at two stations determines sway and yaw rate, whatever the stations."""
    sway, yaw_rate = two_station_motion(*(-0.4 + 0.02 * x for x in (31.0, -40.0)), 31.0, -40.0)
    np.testing.assert_allclose([sway, yaw_rate], [-0.4, 0.02])


@pytest.mark.parametrize("dt", [0.1, 0.2, 0.3, 0.5, 1 / 3])
def test_path_knows_every_round_time_of_its_horizon(dt):
    """Exact: at a step's own time the step's own values, though 900 steps of 0.1 s add up to 89.9999999999992 s."""
    steps = round(90 / dt)
    path = integrate((0, 0, 0), np.tile([5.0, 0.1, 0.01], (steps, 1)), dt)
    times = np.array([0.0, 15, 30, 45, 60, 75, 90])
    there = path.at(times)
    row = np.rint(times / dt).astype(int)
    for name in ("north", "east", "heading", "pivot"):
        np.testing.assert_allclose(getattr(there, name), getattr(path, name)[row], rtol=0, atol=1e-9)
    assert np.isnan(path.at([-0.01, 90.01]).north).all()


def test_path_between_two_steps():
    """By hand: half way between two epochs; the pivot point is that of the nearest step, undefined or not."""
    path = integrate((0, 0, 0), [[4.0, 0.0, 0.0], [4.0, -0.2, 0.02]], 2.0)
    np.testing.assert_allclose(path.at(1.0).north, 4.0)
    np.testing.assert_array_equal(path.at([0.0, 0.9, 1.1, 2.0, 3.0]).pivot, [np.nan, np.nan, 10.0, 10.0, 10.0])
    jump = integrate((0, 0, 0), [[4.0, -0.2, 0.02], [4.0, -0.2, -0.02]], 2.0)  # through infinity, not through 0
    np.testing.assert_array_equal(jump.at([0.9, 1.1]).pivot, [10.0, -10.0])
    np.testing.assert_array_equal(
        np.isnan(integrate((0, 0, 0), [[4, -0.2, 0.02], [4, 0, 0]], 2.0).at(0.0).pivot), False
    )


def test_outline_lies_around_the_hull():
    """By hand: heading east the bow is east of midship, the starboard side south of it."""
    hull = np.array([[45.0, 0.0], [0.0, 7.0]])
    path = integrate((100.0, 200.0, np.pi / 2), [[0.0, 0.0, 0.0]], 1.0)
    np.testing.assert_allclose(path.outline(hull)[0], [[100, 245], [93, 200]], atol=1e-12)


def test_true_heading_adds_the_convergence():
    """Definition: true heading is grid heading plus convergence, per path of a batch."""
    paths = replace(integrate(np.zeros((2, 3)), np.zeros((2, 4, 3)), 1.0), convergence=np.array([0.1, -0.2]))
    np.testing.assert_allclose(paths.true_heading, [[0.1] * 5, [-0.2] * 5])
    np.testing.assert_allclose(paths[1].true_heading, [-0.2] * 5)
