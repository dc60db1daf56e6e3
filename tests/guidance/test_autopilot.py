"""Course autopilot and reference filter against closed formulas: poles, modal solutions, exponentials."""

import math

import numpy as np
import pytest

from aspnn.guidance.autopilot import CourseAutopilot, Gains, ReferenceFilter, pole_placement
from aspnn.schema import InputError

K, T = 0.185, 107.3  # paper 000


def steered(pilot, desired, duration, dt, course=0.0, rate=0.0):
    """Course and rate (steps,) of an exact Nomoto ship under a pilot; `desired(t)` gives course, rate and acceleration."""
    decay, found = math.exp(-dt / T), []
    for t in np.arange(round(duration / dt)) * dt:
        found.append((course, rate))
        (order,) = pilot.command(dt, np.array([course]), np.array([rate]), *(np.array([x]) for x in desired(t)))
        ahead = K * order
        course += ahead * dt + (rate - ahead) * T * (1 - decay)
        rate = ahead + (rate - ahead) * decay
    return np.array(found).T


def test_published_gains():
    """Oracle: the gains printed in paper 000, section 4 (E62: 1.450, 36.27 s, 200 s) and in 001 (68) (E64)."""
    gains = pole_placement(K, T, 0.05, 1.0)
    found = gains.proportional, gains.derivative_time, gains.integral_time
    np.testing.assert_allclose(found, [1.450, 36.27, 200], rtol=1e-4)
    otter = pole_placement(1 / 41.4, 1.0, 1.5, 1.0)
    found = otter.proportional, otter.derivative_time, otter.integral_time
    np.testing.assert_allclose(found, [93.15, 0.89, 6.67], atol=5e-3, rtol=0)


@pytest.mark.parametrize("zeta, omega_n", [(1.0, 0.05), (0.7, 0.03), (1.5, 0.02)])
def test_closed_loop_has_the_poles_of_31(zeta, omega_n):
    """Oracle: the modal solution of (31), s^3 + 2 zeta omega_n s^2 + omega_n^2 s + omega_n^3 / 10 = 0, from an error at rest.

    With the command held over steps of 0.05 s the error differs by the order of the step, omega_n dt / 2 of the start.
    """
    pilot, dt, start = CourseAutopilot(pole_placement(K, T, omega_n, zeta), K, T), 0.05, math.radians(10)
    chi, _ = steered(pilot, lambda t: (0.0, 0.0, 0.0), 200.0, dt, course=start)
    modes = np.roots([1.0, 2 * zeta * omega_n, omega_n**2, omega_n**3 / 10])
    # error, its rate, its second derivative at 0: start, 0, -omega_n^2 start
    weights = np.linalg.solve(np.vander(modes, 3, increasing=True).T, [start, 0.0, -(omega_n**2) * start])
    t = np.arange(len(chi)) * dt
    exact = (np.exp(np.outer(t, modes)) @ weights).real
    np.testing.assert_allclose(chi, exact, atol=start * omega_n * dt)
    assert abs(exact[-1]) < 0.4 * start


def test_feed_forward_follows_a_turn_without_error():
    """Oracle: (30) with 1 / K (E48) inverts Nomoto's equation: a smooth reference is followed with no feedback at work.

    The command is held over the step, which leaves the order of dt: the reference turns by 0.3 rad, 1e-3 of it is allowed.
    """
    pilot, w = CourseAutopilot(pole_placement(K, T, 0.05), K, T, limit=math.radians(40)), 0.02

    def desired(t):
        return 0.15 * (1 - math.cos(w * t)), 0.15 * w * math.sin(w * t), 0.15 * w * w * math.cos(w * t)

    chi, _ = steered(pilot, desired, 300.0, 0.1)
    wanted = np.array([desired(t)[0] for t in np.arange(len(chi)) * 0.1])
    np.testing.assert_allclose(chi, wanted, atol=3e-4)
    assert pilot.saturated[0] == 0


def test_integral_takes_away_a_steady_disturbance():
    """Oracle: a rudder that stands 2 degrees off its order is a constant disturbance; at rest the order is -2 degrees, error 0."""
    off, dt = math.radians(2), 0.5
    pilot = CourseAutopilot(pole_placement(K, T, 0.05), K, T)
    chi, r, order = np.zeros(1), np.zeros(1), np.zeros(1)
    for _ in range(round(3000 / dt)):
        order = pilot.command(dt, chi, r, np.zeros(1))
        r = r + dt * (K * (order + off) - r) / T
        chi = chi + dt * r
    assert order[0] == pytest.approx(-off, abs=1e-6) and abs(chi[0]) < 1e-6


def test_integral_waits_at_the_limit():
    """Oracle: conditional integration by hand. Beyond the limit with the error driving on, nothing is added; an error that leads back
    is. The seconds at the limit, and the longest spell, are counted.
    """
    pilot = CourseAutopilot(Gains(1.0, 0.0, 10.0), K, T, limit=0.1, ships=2)
    zero = np.zeros(2)
    for _ in range(30):
        order = pilot.command(0.5, np.array([1.0, -1.0]), zero, zero)
    np.testing.assert_array_equal(order, [-0.1, 0.1])
    np.testing.assert_array_equal(pilot.integral, [0.0, 0.0])
    np.testing.assert_allclose(pilot.saturated, 15.0)
    pilot.command(0.5, np.array([0.05, 0.05]), zero, zero)  # within the limit
    np.testing.assert_allclose(pilot.integral, 0.025)
    for _ in range(4):
        pilot.command(
            0.5, np.array([-0.05, 0.3]), zero, zero, np.full(2, 0.2)
        )  # fed forward beyond the limit to starboard
    np.testing.assert_allclose(pilot.integral, [0.025, 0.025 + 4 * 0.15])  # the second error leads back
    np.testing.assert_allclose(pilot.saturated, 17.0)
    np.testing.assert_allclose(pilot.longest, 15.0)


def test_angles_go_the_shorter_way_and_sides_are_alike():
    """Oracle: whole turns do not matter; the mirror image of a case has the mirrored order."""
    rng = np.random.default_rng(2)
    course, desired = rng.uniform(-math.pi, math.pi, (2, 50))
    rate, wanted = rng.normal(0, 0.01, (2, 50))
    gains = pole_placement(K, T, 0.05)

    def command(*case):
        return CourseAutopilot(gains, K, T, 0.7, ships=50).command(0.1, *case)

    order = command(course, rate, desired, wanted)
    np.testing.assert_allclose(command(course + 4 * math.pi, rate, desired - 2 * math.pi, wanted), order, atol=1e-12)
    np.testing.assert_allclose(command(-course, -rate, -desired, -wanted), -order, atol=1e-12)
    (across,) = CourseAutopilot(gains, K, T).command(0.1, np.radians([179.0]), np.zeros(1), np.radians([-179.0]))
    assert across == pytest.approx(1.45 * math.radians(2), rel=1e-3)  # to starboard


def test_unknown_course_leaves_the_rudder_amidships():
    """Oracle: the definition; what the other ships get, and the integral, do not know of it."""
    pilot = CourseAutopilot(pole_placement(K, T, 0.05), K, T, ships=2)
    order = pilot.command(0.1, np.array([np.nan, 0.1]), np.zeros(2), np.zeros(2))
    assert order[0] == 0 and order[1] == pytest.approx(-0.145, rel=1e-3)
    np.testing.assert_allclose(pilot.integral, [0.0, 0.01])


def test_reference_filter_is_an_exponential():
    """Oracle: 1 - exp(-t / T_lp), by the shorter way across south; steps of any length lead to the same."""
    for steps in (1, 7, 100):
        low_pass = ReferenceFilter(np.array([40.0, 10.0, 0.0]), 3)
        low_pass.begin(np.radians([170.0, 170.0, 170.0]))
        for _ in range(steps):
            course, rate = low_pass.step(60.0 / steps, np.radians(-150.0), 0.01)
        left = np.array([math.exp(-1.5), math.exp(-6.0), 0.0])
        np.testing.assert_allclose(np.degrees(course), 210 - 40 * left, atol=1e-9)
        np.testing.assert_allclose(rate, 0.01 * (1 - left), atol=1e-12)


def test_reference_filter_begins_where_it_is_told():
    """Oracle: the definition: ships that are not begun stand at what is desired first, the others stay where they are."""
    low_pass = ReferenceFilter(40.0, 2)
    low_pass.begin(np.array([0.5, 9.9]), np.array([True, False]))
    course, _ = low_pass.step(0.0, np.array([1.0, 1.0]))
    np.testing.assert_array_equal(course, [0.5, 1.0])


@pytest.mark.parametrize(
    "wrong, says",
    [
        (lambda: pole_placement(0.1, -5.0, 0.05), "one sign"),
        (lambda: pole_placement(K, T, 0.0), "omega_n"),
        (lambda: pole_placement(K, T, 0.05, -1.0), "zeta"),
        (lambda: pole_placement(K, T, 0.004), "at least 0.00466"),
        (lambda: Gains(-1.0, 0.0), "above 0"),
        (lambda: CourseAutopilot(Gains(1.0, 0.0), K, T, 0.0), "limit of 0"),
        (lambda: ReferenceFilter(-1.0), "filter of -1 s"),
        (lambda: ReferenceFilter(np.array([1.0, np.nan]), 2), "filter of nan s"),
    ],
)
def test_what_cannot_steer_is_named(wrong, says):
    """Oracle: the project's rule: one line that names what is wrong."""
    with pytest.raises(InputError, match=says) as caught:
        wrong()
    assert "\n" not in str(caught.value)
