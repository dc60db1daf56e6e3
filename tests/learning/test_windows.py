"""Windows against what they are cut from, and against the law that inputs know nothing of the future."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from aspnn.learning.features import FEATURES, Begin, begins, forcing, history
from aspnn.learning.servo import Identified, Servo, Servos
from aspnn.learning.windows import (
    Sampling,
    WindowSpec,
    make_windows,
    plan_of,
    plans_sailed,
    read_windows,
    start_wind,
    starts,
    write_windows,
)
from aspnn.motion import integrate, two_station_motion
from aspnn.orders import Orders, Plan
from aspnn.prediction import learned
from aspnn.schema import InputError
from tests.evaluation.conftest import nomoto_voyage, table_of
from tests.learning.conftest import SPEC, assert_windows_equal, nomoto_states, nomoto_windows


def test_inputs_do_not_move_with_the_future(states):
    """Law: every measured column after the start is changed, orders are kept; history and forcing stay bit for bit."""
    row = 900
    changed = states.table.copy()
    kept = ("time_s", "rudder_order_rad", "engine_order_rps", "coasting", "gated", "stale")
    for name in changed.columns.difference(kept):
        changed.loc[row + 1 :, name] += 1.0
    other = replace(states, table=changed)
    for spec in (SPEC, replace(SPEC, period=0.5, inputs=tuple(FEATURES)[:-3])):
        a, b = (make_windows(s, states, spec, np.array([row])) for s in (states, other))
        np.testing.assert_array_equal(a.history, b.history)
        np.testing.assert_array_equal(a.forcing, b.forcing)
        np.testing.assert_array_equal(a.wind, b.wind)


def test_history_ends_at_the_start(states):
    """Oracle: the states table itself, at the instants the spec names."""
    rows = np.array([400, 900])
    found = history(states, rows, ("surge", "yaw_rate", "rudder_order"), SPEC.history_steps, SPEC.period)
    assert found.shape == (2, 10, 3)
    for k, row in enumerate(rows):
        instants = row - 4 * np.arange(9, -1, -1)  # 2 s are 4 rows
        for f, column in enumerate(("surge_m_s", "yaw_rate_rad_s", "rudder_order_rad")):
            np.testing.assert_allclose(found[k, :, f], states[column][instants], rtol=0, atol=1e-12)


def test_label_path_is_what_the_label_velocities_draw():
    """Oracle: motion.integrate on the label velocities; a voyage of 0.05 s steps holds each velocity over its step, so
    the two differ by at most half such a step of the yaw rate's changes (0.025 s x 0.04 rad/s) and what that displaces.
    """
    voyage = nomoto_voyage(0, duration=400.0, step=0.05).states
    for name, x in zip(("sway_bow_m_s", "sway_stern_m_s"), voyage.vessel.sway_stations, strict=True):
        voyage.table[name] = voyage["sway_m_s"] + x * voyage["yaw_rate_rad_s"]
    spec = replace(SPEC, period=0.5)
    windows = make_windows(voyage, voyage, spec, starts(voyage, spec, Sampling(sliding=30.0)))
    assert np.abs(windows.path[:, -1, 2]).max() > 0.5
    mean = (windows.target[:, 1:] + windows.target[:, :-1]).astype(float) / 2
    sway, yaw_rate = two_station_motion(mean[..., 1], mean[..., 2], *voyage.vessel.sway_stations)
    path = integrate(np.zeros(3), np.stack([mean[..., 0], sway, yaw_rate], -1), spec.period)
    np.testing.assert_allclose(path.heading, windows.path[..., 2], atol=1.5e-3)
    np.testing.assert_allclose(path.north, windows.path[..., 0], atol=0.35)
    np.testing.assert_allclose(path.east, windows.path[..., 1], atol=0.35)


def test_starts_at_orders_shifted_and_sliding():
    """Counted by hand: orders at 100, 200 and 290 s of 330 s; 20 s of history and 60 s of horizon."""
    time = np.arange(0, 330.1, 0.5)
    orders = Orders(np.array([0.0, 100, 200, 290]), np.radians([0.0, 10, -10, 5]))
    states = replace(nomoto_states(0), table=table_of(time, orders.at(time)))
    at = lambda sampling: time[starts(states, SPEC, sampling)].tolist()  # noqa: E731
    assert at(Sampling()) == [100.0, 200.0]  # 290 + 60 lies beyond the end
    assert at(Sampling(at_orders=False, shifts=(-10.0, 5.0))) == [90.0, 105.0, 190.0, 205.0]  # 280 + 60 and 295 + 60 do
    assert at(Sampling(at_orders=False, sliding=100.0)) == [20.0, 120.0, 220.0]
    states.table.loc[(time > 130) & (time < 135), "coasting"] = True
    assert at(Sampling()) == [200.0]  # the window of 100 s would learn from coasted labels


def test_forcing_is_the_plan_through_the_servo():
    """Oracle: a rudder of 2.32 deg/s from 0 towards 10 deg is over after 4.31 s; a shaft of 0.1 rev/s2 turns as ordered
    only where no servo of it is known."""
    vessel = nomoto_states(0).vessel
    plan, begin = Plan(Orders.held(np.radians(10)), Orders.held(1.5)), Begin(0.0, 2.0)
    names = ("rudder_angle", "rudder_order", "shaft_speed")
    found = forcing(Servos.of(vessel), begin, plan, names, SPEC.time)
    rate = np.degrees(vessel.rudder_rate)
    np.testing.assert_allclose(np.degrees(found[:, 0]), np.minimum(rate * SPEC.time, 10), atol=1e-9)
    np.testing.assert_allclose(np.degrees(found[:, 1]), 10)
    np.testing.assert_array_equal(found[:, 2], 1.5)
    shaft = replace(Servos.of(vessel), shaft=Identified(Servo(0.1)))
    found = forcing(shaft, begin, plan, names, SPEC.time)
    np.testing.assert_allclose(found[:, 2], np.maximum(2 - 0.1 * SPEC.time, 1.5), atol=1e-12)
    with pytest.raises(InputError, match="shaft_speed is not known"):
        forcing(shaft, Begin(0.0, np.nan), Plan(Orders.held(0.1)), ("shaft_speed",), SPEC.time)


def test_orders_on_their_way_are_heard():
    """Oracle: the servo sailed through the whole voyage; a start inside its delay sees what it does later, not a hold."""
    states = nomoto_states(0)
    time, orders = states["time_s"], Orders.from_series(states["time_s"], states["rudder_order_rad"])
    servos = Servos(Identified(Servo(np.radians(3), 1.0, 2.0)))
    angle = servos.rudder.servo.follow(orders, time, orders.values[0])
    states = replace(states, table=states.table.assign(rudder_angle_rad=angle))
    rows = np.searchsorted(time, orders.times[2] + np.array([-1.0, 0.0, 0.5, 1.5, 3.0]))
    for row, begin in zip(rows, begins(servos, states, rows), strict=True):
        found = forcing(servos, begin, plan_of(states, row, 60.0), ("rudder_angle",), SPEC.time)
        np.testing.assert_allclose(found[:, 0], np.interp(time[row] + SPEC.time, time, angle), atol=1e-9)


def test_plan_holds_orders_not_measurements(states):
    """A measured shaft speed that changes after the start is no plan; an engine order is."""
    states = replace(states, table=states.table.assign(shaft_speed_rps=states["time_s"], engine_order_rps=np.nan))
    assert plan_of(states, 500, 60.0).shaft is None
    ordered = np.where(states["time_s"] < 280, 2.0, 1.0)
    states = replace(states, table=states.table.assign(engine_order_rps=ordered))
    shaft = plan_of(states, 500, 60.0).shaft
    assert shaft is not None
    np.testing.assert_array_equal(shaft.times, [0, 30])


def test_a_past_plan_holds_orders_where_they_are_known(states):
    """By hand: the engine's order, whose change at 280 s comes 30 s after 250 s; without one, what was measured."""
    time = states["time_s"]
    table = states.table.assign(shaft_speed_rps=time, engine_order_rps=np.where(time < 280, 2.0, 1.0))
    starts, read = np.array([250.0, 270.0]), ("shaft_speed",)
    early, late = (plan.shaft for plan in plans_sailed(replace(states, table=table), starts, 60.0, read))
    assert (early.times.tolist(), late.times.tolist()) == ([0, 30], [0, 10])
    unordered = replace(states, table=table.assign(engine_order_rps=np.nan))
    (measured, _) = (plan.shaft for plan in plans_sailed(unordered, starts, 60.0, read))
    np.testing.assert_allclose(measured.at(np.array([0.0, 45.0])), [250.0, 295.0])
    assert plans_sailed(unordered, starts, 60.0, ("rudder_angle",))[0].shaft is None
    assert plans_sailed(unordered, starts, 60.0, read)[0].rudder.at(20.0) == plan_of(states, 500, 60.0).rudder.at(20.0)


def test_path_accelerations_on_a_circle():
    """Analytic: on a circle at constant speed the tangential acceleration is 0 and the normal one V^2 / R."""
    u, v, r = 5.0, -0.8, 0.02
    time = np.arange(0, 100, 0.5)
    motion = {"surge_m_s": u, "sway_m_s": v, "yaw_rate_rad_s": r}
    states = replace(nomoto_states(0), table=table_of(time, 0 * time, motion))
    speed = np.hypot(u, v)
    np.testing.assert_allclose(FEATURES["tangential_acceleration"](states), 0, atol=1e-12)
    np.testing.assert_allclose(FEATURES["normal_acceleration"](states), speed**2 / (speed / r), rtol=1e-12)


def test_wind_at_the_start_is_a_vector_mean():
    """Analytic: wind from the east (90 deg) at 8 m/s on a northerly heading blows to port; no sensor means zero."""
    time = np.arange(0, 100, 0.5)
    motion = {"wind_speed_true_m_s": 8.0, "wind_from_grid_rad": np.pi / 2, "heading_rad": 0.0}
    states = replace(nomoto_states(0), table=table_of(time, 0 * time, motion))
    np.testing.assert_allclose(start_wind(states, np.array([50, 199])), [[0, -8], [0, -8]], atol=1e-12)
    calm = replace(states, table=states.table.assign(wind_speed_true_m_s=np.nan))
    np.testing.assert_array_equal(start_wind(calm, np.array([50])), [[0, 0]])


def test_the_wind_is_remembered_as_long_as_the_spec_says():
    """Analytic: a wind that freshens from 2 to 8 m/s 4 s ago is 8 over 3 s and (2 x 12 + 8 x 9) / 21 over 10 s at 2 Hz;
    windows and predictions read the spec's memory, and a spec that does not say has 10 s."""
    time = np.arange(0, 100, 0.5)
    motion = {"wind_speed_true_m_s": np.where(time < 46, 2.0, 8.0), "wind_from_grid_rad": np.pi, "heading_rad": 0.0}
    base = nomoto_states(0)
    states = replace(base, table=base.table.iloc[: len(time)].assign(time_s=time, **motion))
    row, plan = np.array([100]), [plan_of(states, 100, SPEC.horizon)]
    short = replace(SPEC, horizon=20.0, wind_memory=3.0)
    for spec, expected in ((short, 8.0), (replace(short, wind_memory=10.0), (2 * 12 + 8 * 9) / 21)):
        contract = SimpleNamespace(name="x", spec=spec, vessel=states.vessel, servos=None)
        given = learned.material(contract, states, row, plan).wind
        np.testing.assert_allclose(make_windows(states, states, spec, row).wind, [[expected, 0]], atol=1e-6)
        np.testing.assert_allclose(given, [[expected, 0]], atol=1e-12)
    old = {k: v for k, v in asdict(SPEC).items() if k != "wind_memory"}
    assert WindowSpec.from_dict(old).wind_memory == 10.0


def test_too_short_a_history_is_named(states):
    with pytest.raises(InputError, match=r"10\.0 s of history at 10 s, 18\.0 s are needed"):
        history(states, np.array([20]), ("surge",), SPEC.history_steps, SPEC.period)


def test_round_trip_is_bit_equal(windows, tmp_path):
    write_windows(windows, tmp_path / "w.safetensors")
    assert_windows_equal(windows, read_windows(tmp_path / "w.safetensors"))
    (tmp_path / "bad.safetensors").write_bytes((tmp_path / "w.safetensors").read_bytes()[:1000])
    for name, reason in (("bad", "no windowed dataset"), ("absent", "no such file")):
        with pytest.raises(InputError, match=f"{name}.safetensors.*{reason}"):
            read_windows(tmp_path / f"{name}.safetensors")


def test_voyages_keep_their_windows_apart():
    """The voyage index of every window leads to the voyage it was cut from; parts of one voyage share it."""
    both = nomoto_windows((3, 4))
    alone = nomoto_windows((4,))
    assert both.voyages == ("voyage-3", "voyage-4")
    np.testing.assert_array_equal(both.select(both.voyage == 1).history, alone.history)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"inputs": ("surge", "sway")}, "input sway is not known"),
        ({"forcings": ("wind_forward",)}, "forcing wind_forward is not known"),
        ({"period": 0.0}, "period 0 s must be positive"),
    ],
)
def test_wrong_spec_is_named(change, reason):
    with pytest.raises(InputError, match=reason):
        WindowSpec(**({"history": 20.0, "horizon": 60.0, "period": 2.0, "inputs": ("surge",)} | change))
