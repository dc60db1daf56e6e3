"""Sea, engine and manoeuvres of a scenario: each off by default, each as its section says, wrong ones told in one line."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from aspnn.angles import difference
from aspnn.guidance import helms
from aspnn.orders import Orders
from aspnn.schema import InputError
from aspnn.simulation import Scenario, Ship, simulate, simulate_scenario
from aspnn.simulation.motion import Motion, level, over_ground, with_waves
from aspnn.simulation.weather import Environment
from aspnn.vessel import load_vessel

KNOT = 1852 / 3600
SLOW = {"speed_kn": 2.0, "latitude_deg": 60.0, "longitude_deg": 3.0, "zone": "31N", "heading_deg": 40}


def scenario(**parts):
    start = {"speed_kn": 11.5, "latitude_deg": 60.0, "longitude_deg": 3.0, "zone": "31N", "heading_deg": 40}
    plain = {"name": "t", "vessel": "cargo90", "duration_s": 300, "start": start, "manoeuvre": {"kind": "straight"}}
    return Scenario.model_validate(plain | parts)


def voyages(**parts):
    return list(simulate_scenario(scenario(**parts)))


def test_a_scenario_is_calm_unless_told():
    """Law: without an environment the truth has no attitude and nothing blows or flows, and the sea draws from a stream of its own."""
    (_, plain), *_ = voyages(manoeuvre={"kind": "random-orders", "hold_s": [20, 60]})
    assert not plain[["current_north_m_s", "current_east_m_s", "wind_speed_true_m_s"]].to_numpy().any()
    assert not {"roll_rad", "pitch_rad", "heave_m", "out_of_domain"} & set(plain)
    rough = {
        "waves": {"height_m": 1, "period_s": 6, "from_deg": 90},
        "eddies": {"speed_kn": 0.5},
        "wind_kn": 10,
        "gusts": {},
    }
    (_, other), *_ = voyages(manoeuvre={"kind": "random-orders", "hold_s": [20, 60]}, environment=rough)
    np.testing.assert_array_equal(plain["rudder_angle_rad"], other["rudder_angle_rad"])


def test_current_and_wind_are_those_drawn():
    """Oracle: rms of the eddies and mean of the gusts within 4 standard errors of what the scenario says; truth and states agree."""
    environment = {
        "current_kn": 1.0, "current_towards_deg": 90, "wind_kn": 20, "wind_from_deg": 180, "gusts": {},
        "eddies": {"speed_kn": 0.6, "length_m": 300, "period_s": 600},
    }  # fmt: skip
    found = voyages(environment=environment, voyages=30)
    current = np.array([[t["current_north_m_s"].mean(), t["current_east_m_s"].mean()] for _, t in found])
    sd = 0.6 * KNOT / math.sqrt(2)  # of each component, at one place
    np.testing.assert_allclose(current.mean(axis=0), [0.0, KNOT], atol=4 * sd / math.sqrt(30))
    spread = np.concatenate([t["current_north_m_s"] for _, t in found])
    assert spread.std() == pytest.approx(sd, rel=0.3)  # 30 voyages of about 5 correlation lengths: 6 %, and 4 of it
    wind = np.array([t["wind_speed_true_m_s"].mean() for _, t in found])
    assert wind.mean() == pytest.approx(20 * KNOT, abs=4 * wind.std() / math.sqrt(30) + 1e-9)
    assert all(t["wind_speed_true_m_s"].std() > 0.3 for _, t in found)
    truth = found[0][1]
    np.testing.assert_allclose(
        np.degrees(truth["wind_from_grid_rad"]) % 360, 180, atol=0.5
    )  # on the zone's meridian: true


def test_waves_move_sensors_and_push_the_ship():
    """Law: waves from port make a ship on a steady heading roll, pitch and heave about its path and make it drift to starboard."""
    steady = {"kind": "keep-heading"}
    waves = {"height_m": 3, "period_s": 7, "from_deg": 310}
    (log, rough), *_ = voyages(manoeuvre=steady, environment={"waves": waves})
    (_, calm), *_ = voyages(manoeuvre=steady)
    assert 0.3 < np.degrees(rough["roll_rad"].std()) < 6 and 0.1 < np.degrees(rough["pitch_rad"].std()) < 4
    assert 0.1 < rough["heave_m"].std() < 1.0
    assert (rough["sway_m_s"] - calm["sway_m_s"]).mean() > 0.1
    assert len(log.table) == 3001


def test_a_boat_answers_the_waves_itself():
    """Law: a craft of six degrees heaves and rolls by its own dynamics; twice the height is about twice the heave."""
    start = {"speed_kn": 8, "latitude_deg": 60.0, "longitude_deg": 3.0, "zone": "31N", "heading_deg": 0}
    sea = [{"waves": {"height_m": h, "period_s": 5, "from_deg": 60}} for h in (0.2, 0.4)]
    one, two = (voyages(vessel="workboat8", start=start, environment=e)[0][1] for e in sea)
    assert 0.02 < one["heave_m"].std() < 0.2 and np.degrees(one["roll_rad"].std()) > 0.2
    assert two["heave_m"].std() / one["heave_m"].std() == pytest.approx(2, rel=0.25)


BOAT = {"speed_kn": 8, "latitude_deg": 60.0, "longitude_deg": 3.0, "zone": "31N", "heading_deg": 0}


def test_a_stream_is_where_the_scenario_puts_it():
    """Oracle: the profile by hand along the way of the boat, from the offset of the start and true directions on the zone's meridian."""
    stream = {"speed_kn": 2 / KNOT * 0.5, "towards_deg": 90, "width_m": 500, "offset_m": -100}
    (_, truth), *_ = voyages(
        vessel="workboat8", start=BOAT, duration_s=60, environment={"current_kn": 0.5 / KNOT, "stream": stream}
    )
    across = -(truth["north_m"] - truth["north_m"][0])  # to the right of the stream is south
    expected = (1 + np.cos(2 * np.pi * (across + 100) / 500)) / 2
    np.testing.assert_allclose(truth["current_east_m_s"], expected, atol=1e-6)
    np.testing.assert_allclose(truth["current_north_m_s"], 0.5, atol=1e-9)
    assert np.ptp(expected) > 0.5


def test_a_passing_ship_shakes_the_boat_once():
    """Oracle: Kelvin's cusp reaches a boat that lies still at the time by hand; it rolls then, and neither before nor long after."""
    wake = {"speed_kn": 12, "towards_deg": 0, "height_m": 0.5, "distance_m": 80, "abeam_s": 40}
    (_, truth), *_ = voyages(
        vessel="workboat8", start=BOAT | {"speed_kn": 0}, duration_s=200, environment={"wake": wake}
    )
    arrives = 40 + 2 * math.sqrt(2) * 80 / (12 * KNOT)
    roll, time = np.abs(truth["roll_rad"].to_numpy()), truth["time_s"].to_numpy()
    assert abs(time[roll.argmax()] - arrives) < 8 and np.degrees(roll.max()) > 2
    assert roll[time < arrives - 30].max() < 0.02 * roll.max() and roll[time > arrives + 60].max() < 0.1 * roll.max()


def test_wakes_and_streams_move_no_other_draw():
    """Law: what they draw comes after the rest, so that eddies, waves and orders are those of the scenario without them."""
    plain = {"eddies": {"speed_kn": 0.5}, "waves": {"height_m": [0.1, 0.5], "period_s": [3, 5], "from_deg": "random"}}
    more = {"stream": {"speed_kn": [0, 1]}, "wake": {"speed_kn": [12, 14], "height_m": 0.3, "distance_m": 60}}
    seas = [
        Environment.model_validate(e).draw(np.zeros((1, 4)), 0.1, (7e6, 5e5), [np.random.default_rng(2)], 0.1, 600)
        for e in (plain, plain | more)
    ]
    np.testing.assert_array_equal(seas[0].eddies, seas[1].eddies[:, :16])
    np.testing.assert_array_equal(seas[0].waves, seas[1].waves[:, :24])
    assert seas[1].eddies.shape == (1, 17, 5) and seas[1].waves.shape == (1, 24 + 128, 5)


def test_shallow_water_turns_wider():
    """Law: at 1.5 draughts of depth the same order turns the ship less than in deep water, and the depth is the log's."""
    turn = {"kind": "turning-circle", "rudder_deg": 20, "start_s": 30}
    (_, deep), *_ = voyages(manoeuvre=turn)
    (_, shallow), *_ = voyages(manoeuvre=turn, environment={"depth_m": 9.75})
    assert shallow["heading_rad"].iloc[-1] < deep["heading_rad"].iloc[-1] - 0.3


def test_engine_and_pitch_orders_are_followed():
    """Oracle: Orders.servo at the rates of the vessel file; the ship slows, and stops, by pitch alone."""
    orders = {"kind": "orders", "shaft_rps": [[0, 2.7], [60, 1.5]], "pitch_ratio": [[0, 1.0], [120, -0.6]]}
    (_, truth), *_ = voyages(engine=orders, duration_s=600)
    time = truth["time_s"].to_numpy()
    ship = Ship.of(load_vessel("cargo90"))
    start = ship.start(0.0, 0.0, 0.0, 11.5 * KNOT)[0]
    shaft = Orders(np.array([0.0, 60.0]), np.array([2.7, 1.5])).servo(time, start[helms.SHAFT], ship.shaft.rate)
    pitch = Orders(np.array([0.0, 120.0]), np.array([1.0, -0.6])).servo(time, start[helms.PITCH_RATIO], ship.pitch.rate)
    np.testing.assert_allclose(truth["shaft_speed_rps"], shaft, atol=1e-9)
    np.testing.assert_allclose(truth["propeller_pitch_ratio"], pitch, atol=1e-9)
    assert truth["surge_m_s"].iloc[-1] < 0.5
    assert set(np.unique(truth["out_of_domain"])) >= {0, 8}


def test_random_engine_orders_stay_in_their_range():
    """Oracle: the range; each voyage draws its own, and they do not depend on how many voyages are made."""
    engine = {"kind": "random-orders", "shaft_rps": [1.5, 2.7], "hold_s": [30, 60]}
    found = [t["shaft_speed_rps"].to_numpy() for _, t in voyages(engine=engine, voyages=3)]
    assert min(s.min() for s in found) > 1.49 and max(s.max() for s in found) < 2.76
    assert not np.array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], voyages(engine=engine)[0][1]["shaft_speed_rps"])


def test_prescribed_orders_and_the_autopilot():
    """Oracle: the orders of the log; the autopilot holds the heading of its start in a beam wind within 2 degrees."""
    (log, _), *_ = voyages(manoeuvre={"kind": "orders", "orders_deg": [[0, 0], [50, 10], [120, -5]]})
    order = log.table["rudder_order_deg"]
    np.testing.assert_allclose(order[[499, 500, 1199, 1200]], [0, 10, 10, -5], atol=1e-9)
    (_, truth), *_ = voyages(manoeuvre={"kind": "keep-heading"}, environment={"wind_kn": 25, "wind_from_deg": 130})
    assert np.degrees(np.abs(difference(truth["heading_rad"], truth["heading_rad"][0]))).max() < 2
    assert np.degrees(np.abs(truth["rudder_angle_rad"])).max() > 0.2


@pytest.mark.parametrize(
    "parts, message",
    [
        ({"manoeuvre": {"kind": "orders", "orders_deg": [[0, 0], [5, 40]]}}, "manoeuvre.rudder_deg = 40 is beyond the 35"),
        ({"engine": {"kind": "orders", "shaft_rps": [[0, 9.0]]}}, r"a shaft order \[rev/s\] of 9 is beyond the stops, 0 to 3"),
        ({"engine": {"kind": "orders", "pitch_ratio": [[0, -0.9]]}}, "an order of the pitch ratio of -0.9 is beyond the stops"),
        ({"vessel": "workboat8", "step_s": 0.5}, "step_s = 0.5 is too long for the fastest motion of workboat8; at most 0.2"),
        (
            {"duration_s": 1200, "environment": {"wake": {"speed_kn": 12, "height_m": 0.3, "distance_m": 60}}},
            "environment.wake.components = 128 let the wake come again after 675 s, within the voyage of 1200 s; take at least 228",
        ),
        ({"vessel": "mariner", "environment": {"depth_m": 20}}, "mariner: its model has no shallow-water correction"),
        ({"environment": {"depth_m": 7.0}}, "depth"),
        ({"vessel": "trimaran"}, r"vessel trimaran: 5.916 m/s \(11.5 kn\) needs 11.8 rev/s of the shaft"),
        ({"vessel": "kvlcc2_l7", "start": SLOW, "environment": {"wind_kn": 5}}, "vessel kvlcc2_l7: has no section wind"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said(parts, message):
    """Oracle: the messages, one line each."""
    with pytest.raises(InputError, match=message) as error:
        voyages(**parts)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "parts",
    [
        {"environment": {"waves": {"height_m": -1, "period_s": 6}}},
        {"environment": {"waves": {"height_m": 1, "period_s": 0}}},
        {"environment": {"current_kn": [2, 1]}},
        {"environment": {"swell": 1}},
        {"environment": {"stream": {"speed_kn": 1, "width_m": 5}}},
        {"environment": {"wake": {"speed_kn": 0, "height_m": 0.3, "distance_m": 60}}},
        {"environment": {"wake": {"speed_kn": 12, "height_m": 0.3, "distance_m": -60}}},
        {"engine": {"kind": "orders", "shaft_rps": [[5, 1.0]]}},
        {"manoeuvre": {"kind": "orders", "orders_deg": [[0, 0], [0, 5]]}},
    ],
)
def test_wrong_sections_are_refused(parts):
    """Oracle: the rules of each key."""
    with pytest.raises(ValidationError):
        scenario(**parts)


def test_level_axes():
    """Oracle: rotation matrices of roll and pitch; and a turn that is upright has the velocities of its body."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        v, roll, pitch = rng.normal(size=3), *rng.uniform(-0.6, 0.6, 2)
        about_x = np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]])
        about_y = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]])
        np.testing.assert_allclose(level(*v, roll, pitch), about_y @ about_x @ v, atol=1e-12)


def test_waves_on_top_of_a_turn():
    """Oracle: central differences of the places, with surge, sway, yaw of the waves on a steady turn."""
    time = np.arange(0, 60, 0.05)
    r, u, v = 0.03, 5.0, -0.6
    heading = r * time
    ground = (u + 1j * v) * np.exp(1j * heading)
    place = (ground - ground[0]) / (1j * r)
    still = np.zeros(len(time))
    mean = Motion(place.real, place.imag, heading, still + u, still + v, still + r, *[still] * 3, *[still] * 7)
    moved = np.array(
        [
            a * np.sin(w * time + p)
            for a, w, p in zip((0.5, 0.4, 0.3, 0.05, 0.02, 0.03), (0.8, 1.0, 1.2, 0.9, 0.7, 1.1), range(6), strict=True)
        ]
    )
    found = with_waves(mean, moved, time)
    ahead = np.gradient(found.north + 1j * found.east, 0.05, edge_order=2) * np.exp(-1j * found.heading)
    np.testing.assert_allclose(found.surge[2:-2], ahead.real[2:-2], atol=3e-3)
    np.testing.assert_allclose(found.sway[2:-2], ahead.imag[2:-2], atol=3e-3)
    for value, rate in (
        (found.surge, found.surge_rate),
        (found.sway, found.sway_rate),
        (found.heading, found.yaw_rate),
    ):
        np.testing.assert_allclose(np.gradient(value, 0.05)[2:-2], rate[2:-2], atol=3e-3)
    np.testing.assert_array_equal(found.roll, moved[3])


def test_over_ground_of_an_upright_body():
    """Oracle: a craft of six degrees that keeps upright moves over ground as one of three with the same velocities."""
    rng = np.random.default_rng(4)
    three = rng.normal(size=(7, helms.COLUMNS))
    six = np.concatenate([three, np.zeros((7, helms.SIX - helms.COLUMNS))], axis=1)
    rates = rng.normal(size=(7, helms.SIX))
    rates[:, helms.HEADING] = three[:, helms.YAW_RATE]
    rates[:, helms.COLUMNS :] = 0.0
    current = rng.normal(size=(2, 7, 2))
    for a, b in zip(
        over_ground(three, rates[:, : helms.COLUMNS], *current), over_ground(six, rates, *current), strict=True
    ):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_helms_may_be_callables():
    """Oracle: the voyage of the same orders told beforehand; a helm, a shaft lever and a pitch lever that look at the states."""
    ship = Ship.of(load_vessel("cargo90"))
    start = ship.start([0.0, 0.0], 0.0, 0.0, [5.0, 4.0])
    asked = simulate(
        ship,
        lambda time, state: np.where(state[:, helms.HEADING] < 0.5, 0.2, -0.1),
        start,
        120.0,
        shaft=lambda time, state: np.full(len(state), 2.0 if time < 50 else 2.5),
        pitch=lambda time, state: np.where(state[:, helms.SURGE] > 4, 0.9, 1.0),
    )
    for b, voyage in enumerate(asked):
        told = [Orders.from_series(voyage.time, s) for s in (voyage.order, voyage.shaft_order, voyage.pitch_order)]
        known = simulate(ship, told[:1], start[b], 120.0, shaft=told[1:2], pitch=told[2:])[0]
        np.testing.assert_array_equal(known.north, voyage.north)
        np.testing.assert_array_equal(known.pitch_ratio, voyage.pitch_ratio)
