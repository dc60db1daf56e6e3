"""The helm that follows a path, on ships that obey Nomoto's equation exactly."""

import numpy as np
import pytest

from aspnn.estimation.course import CourseModel, CourseTracker
from aspnn.guidance import helms
from aspnn.guidance.autopilot import CourseAutopilot, ReferenceFilter, pole_placement
from aspnn.guidance.los import LineOfSight
from aspnn.guidance.pilot import Loop, PathHelm, TrackedNavigation, TrueNavigation
from aspnn.guidance.route import Follower, Route

K, T, SPEED, DT = 0.4, 20.0, 6.0, 0.5
GAINS = pole_placement(K, T, 0.15)
ROUTE = Route(np.array([[0, 0], [1500, 200], [2500, 2500], [6500, 2500.0]]))
MIRRORED = Route(ROUTE.points * [1, -1])


def path_helm(routes=ROUTE, navigation=None, limit=0.6, radius=100.0, every=1, rate=True):
    law = LineOfSight(300.0)
    return PathHelm(
        lambda ships: Loop(
            (navigation or (lambda n: TrueNavigation()))(ships),
            Follower(routes, radius, ships),
            law,
            law.rate if rate else None,
            ReferenceFilter(5.0, ships),
            CourseAutopilot(GAINS, K, T, limit, ships),
        ),
        every,
    )


def sail(helm, ships=1, duration=1600.0, current=0j, start=0.0):
    """States (steps, ships, columns) and orders (steps, ships) of ships that turn by Nomoto's equation at a steady speed."""
    state = np.zeros((ships, helms.COLUMNS))
    state[:, helms.SURGE], state[:, helms.HEADING] = SPEED, start
    states, orders = [], []
    decay = np.exp(-DT / T)
    for time in np.arange(round(duration / DT)) * DT:
        order = helm(time, state.copy())
        states.append(state.copy())
        orders.append(order)
        psi, r = state[:, helms.HEADING], state[:, helms.YAW_RATE]
        turned = K * order * DT + (r - K * order) * T * (1 - decay)
        way = SPEED * DT * np.exp(1j * (psi + turned / 2)) + current * DT
        state[:, helms.NORTH] += way.real
        state[:, helms.EAST] += way.imag
        state[:, helms.HEADING] += turned
        state[:, helms.YAW_RATE] = K * order + (r - K * order) * decay
    return np.array(states), np.array(orders)


@pytest.mark.parametrize("current", [0j, 0.5 - 1.0j])
def test_reaches_every_waypoint_and_settles_on_the_leg(current):
    """Oracle: the course law has its only rest on the leg, with a current too: the error dies out below 0.1 m."""
    helm = path_helm()
    states, _ = sail(helm, current=current)
    for north, east in ROUTE.points:
        assert np.hypot(states[:, 0, helms.NORTH] - north, states[:, 0, helms.EAST] - east).min() < 100
    record = helm.record
    assert record.done[-1, 0] and list(np.unique(record.leg)) == [0, 1, 2]
    assert abs(states[-1, 0, helms.EAST] - 2500) < 0.1 and abs(record.cross[-1, 0]) < 0.1
    assert helm.notes(60.0) == [""]


def test_mirrored_route_gives_mirrored_rudder():
    """Oracle: the law of symmetry, two ships in one batch."""
    states, orders = sail(path_helm([ROUTE, MIRRORED]), 2, 900.0)
    np.testing.assert_allclose(orders[:, 0], -orders[:, 1], atol=1e-9)
    np.testing.assert_allclose(states[:, 0, helms.EAST], -states[:, 1, helms.EAST], atol=1e-6)
    assert np.abs(orders).max() > 0.1


def test_batch_is_each_ship_alone_and_memory_is_forgotten():
    """Oracle: a run of each ship by itself; the second run of the same helm."""
    helm = path_helm([ROUTE, MIRRORED])
    states, _ = sail(helm, 2, 600.0)
    again, _ = sail(helm, 2, 600.0)
    np.testing.assert_array_equal(states, again)
    assert len(helm.record.time) == 1200
    alone, _ = sail(path_helm(MIRRORED, every=10), 1, 600.0)
    np.testing.assert_allclose(alone[:, 0], states[:, 1], atol=1e-9)


def test_filter_in_the_loop():
    """Oracle: fixes without error, of a filter that trusts them, steer as true positions do; no fix in the first 10 s leaves the
    rudder amidships, an outage of 20 s is survived.
    """

    def navigation(out):
        def receiver(time, state):
            known = time >= 10 and not out[0] <= time < out[1]
            return tuple(np.where(known, state[:, column], np.nan) for column in (helms.NORTH, helms.EAST))

        model = CourseModel(1e-2, 1e-3, 1e-3, 0.05)
        return lambda ships: TrackedNavigation(CourseTracker(model, 0.05, ships, DT), receiver)

    true, _ = sail(path_helm(), duration=900.0, start=0.1)
    helm = path_helm(navigation=navigation((0, 0)))
    states, orders = sail(helm, duration=900.0, start=0.1)
    assert not orders[:20].any() and np.isnan(helm.record.course[0, 0])
    assert orders[30:].any()
    apart = np.hypot(*(states - true)[:, 0, :2].T)
    assert apart[-1] < 3.0 and apart.max() < 15.0
    states, _ = sail(path_helm(navigation=navigation((700, 720))), duration=1450.0, start=0.1)
    assert abs(states[-1, 0, helms.EAST] - 2500) < 1.0


def test_record_tells_what_was_thought():
    """Oracle: the definitions: differenced positions, the law, the rate's derivative and the orders given."""
    helm = path_helm(every=4)
    states, orders = sail(helm, duration=500.0)
    record = helm.record
    assert len(record.time) == 250
    np.testing.assert_array_equal(record.order, orders[::4])
    np.testing.assert_allclose(record.north, states[::4, :, helms.NORTH])
    np.testing.assert_allclose(record.speed, SPEED, rtol=1e-3)
    half = (states[4::4] + states[3::4][: len(record.time) - 1])[
        ..., helms.YAW_RATE
    ] / 2  # a difference tells of half a step ago
    np.testing.assert_allclose(record.course_rate[1:], half, atol=2e-3)
    np.testing.assert_allclose(record.desired, ROUTE.angles[record.leg] - np.arctan(record.cross / 300), atol=1e-12)


def test_ship_that_stands_keeps_her_course():
    """Oracle: the definition: no way has no direction."""
    navigation, state = TrueNavigation(), np.zeros((1, helms.COLUMNS))
    state[:, helms.HEADING] = 1.0
    state[:, helms.SURGE] = 2.0
    assert navigation(0.0, state).course[0] == pytest.approx(1.0)
    told = navigation(0.5, state)
    assert told.course[0] == pytest.approx(1.0) and told.speed[0] == 0 and told.course_rate[0] == 0


def test_reference_beyond_the_vessel_is_said():
    """Oracle: a rudder of 0.02 rad turns by 8 mrad/s, so a turn of 60 degrees takes over two minutes, all of them at the limit; the route
    is not at its end after 400 s (2400 m).
    """
    helm = path_helm(limit=0.02)
    sail(helm, 1, 600.0)
    (text,) = helm.notes(60.0)
    assert "rudder at its limit of 1.15 degrees for" in text and "cannot follow the reference" in text
    assert "route not finished, on leg" in text and "\n" not in text
    assert helm.loop.autopilot.longest[0] > 100
    assert path_helm_quiet(600.0) == ["route not finished, on leg 2 at the end"]


def path_helm_quiet(duration):
    helm = path_helm()
    sail(helm, 1, duration)
    return helm.notes(60.0)


def test_helm_that_has_not_steered_has_no_parts():
    """Oracle: the definition."""
    with pytest.raises(ValueError, match="not steered"):
        path_helm().loop  # noqa: B018
