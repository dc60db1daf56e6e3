"""Voyages steered in a closed loop: the same whatever the batch, where they should go, and what is said of those that cannot."""

import math

import numpy as np
import pandas as pd
import pytest

from aspnn.frames import Zone, convergence, to_geodetic, to_grid
from aspnn.guidance.helms import zigzag
from aspnn.records import read_log
from aspnn.schema import InputError
from aspnn.simulation import Scenario, scenario, simulate_scenario
from aspnn.simulation.nomoto import nomoto
from aspnn.simulation.routes import RandomRoute
from aspnn.simulation.ship import Ship
from aspnn.simulation.steering import Gnss, answer
from aspnn.simulation.voyage import simulate
from aspnn.vessel import load_vessel
from aspnn.workflow import simulate_files

ZONE = Zone.parse("32N")
PLACE = 63.44, 10.4
CURRENT = {"current_kn": 0.5, "current_towards_deg": 90}
ROUTE = [[0, 0], [60, 0], [110, 50]]


def trip(manoeuvre, **changed):
    """The Otter, 1.3 m/s northwards unless said otherwise."""
    start = {"speed_kn": 2.5, "latitude_deg": PLACE[0], "longitude_deg": PLACE[1], "zone": "32N", "heading_deg": 0}
    given = {"name": "trip", "vessel": "otter", "duration_s": 110, "seed": 3, "start": start, "manoeuvre": manoeuvre}
    return Scenario.model_validate(given | changed)


def followed(steering, **more):
    return {"kind": "waypoints", "points_m": ROUTE, "steering": {"every_s": 0.2, "rudder_deg": 35} | steering} | more


def off_leg(truth, leg):
    """Cross-track error [m] of a truth on a leg of ROUTE, along it [m]."""
    north, east = to_grid(*np.radians(PLACE), ZONE)
    a, b = np.array(ROUTE[leg], float), np.array(ROUTE[leg + 1], float)
    along = (b - a) / np.hypot(*(b - a))
    at = np.stack([truth["north_m"] - north, truth["east_m"] - east], axis=-1) - a
    return at @ np.array([-along[1], along[0]]), at @ along


@pytest.mark.parametrize("law", ["los", "ilos", "alos", "kf-los"])
def test_every_law_reaches_the_waypoints_and_rests_on_the_leg_in_a_current(law):
    """Oracle: geometry of the truth. 0.26 m/s across the first leg; conventional LOS of a heading would rest 1.6 m beside it."""
    log, truth = next(simulate_scenario(trip(followed({"law": law}), environment=CURRENT)))
    assert log.notes["waypoints"] == "2 of 2 reached"
    cross, along = off_leg(truth, 0)
    late = (along > 45) & (along < 55)
    assert np.abs(cross[late]).max() < 0.45
    cross, along = off_leg(truth, 1)
    late = (along > 50) & (along < 70)
    assert late.any() and np.abs(cross[late]).max() < 0.45


def test_a_voyage_is_the_same_whatever_the_batch(monkeypatch):
    """Oracle: bit by bit, alone, among others and in other batches, with noise in the loop; others differ."""
    route = {
        "kind": "random-route",
        "leg_m": [10, 20],
        "steering": {"rudder_deg": 35, "gnss": {"white_m": 0.1, "period_s": 0.2}},
    }
    drawn = trip(route, duration_s=25, voyages=5)
    one = list(simulate_scenario(drawn, [3]))
    monkeypatch.setattr(scenario, "BATCH", 2)
    many = list(simulate_scenario(drawn))
    pd.testing.assert_frame_equal(one[0][0].table, many[3][0].table, check_exact=True)
    pd.testing.assert_frame_equal(one[0][1], many[3][1], check_exact=True)
    assert one[0][0].notes == many[3][0].notes
    assert not many[2][1].equals(many[3][1]) and not many[2][1].equals(many[4][1])


def test_the_noise_of_the_helm_is_not_that_of_the_log():
    """Law: the sensors' stream does not know the helm's: with other noise in the loop the errors of the log stay to the bit."""

    def errors(white):
        log, truth = next(simulate_scenario(trip(followed({"gnss": {"white_m": white}}), duration_s=20)))
        off = log.table["heading_deg"] - np.degrees(truth["heading_rad"])
        return (off + 180) % 360 - 180, truth

    (quiet, first), (loud, second) = errors(0.05), errors(0.5)
    assert not first.equals(second)
    np.testing.assert_allclose(quiet, loud, atol=1e-3)  # the convergence differs a little with the place


def test_courses_are_true_and_over_ground():
    """Oracle: 20 degrees on the chart are 20 less the convergence on the grid, in a current too."""
    courses = {"kind": "courses", "courses_deg": [[0, 20], [30, -40]], "steering": {"rudder_deg": 35}}
    _, truth = next(simulate_scenario(trip(courses, environment=CURRENT, duration_s=60)))
    gamma = math.degrees(float(convergence(*np.radians(PLACE), ZONE)))
    for at, course in ((29.0, 20.0), (59.0, -40.0)):
        rows = truth[(truth["time_s"] > at - 1) & (truth["time_s"] < at)]
        north, east = (
            np.ptp(rows["north_m"]) * np.sign(rows["north_m"].diff().iloc[-1]),
            rows["east_m"].iloc[-1] - rows["east_m"].iloc[0],
        )
        assert math.degrees(math.atan2(east, north)) == pytest.approx(course - gamma, abs=1.0)


def test_places_on_the_chart_are_those_of_the_grid():
    """Oracle: pyproj. The same route in degrees is sailed the same, but for the rounding of the grid."""
    north, east = to_grid(*np.radians(PLACE), ZONE)
    latitude, longitude = np.degrees(to_geodetic(*(np.array(ROUTE, float) + [north, east]).T, ZONE))  # noqa: RUF005
    places = followed({}, points_m=None, points_deg=np.stack([latitude, longitude], axis=-1).tolist())
    (_, metres), (_, degrees) = (next(simulate_scenario(trip(one, duration_s=30))) for one in (followed({}), places))
    np.testing.assert_allclose(metres["north_m"], degrees["north_m"], atol=1e-2)


def test_a_reference_that_she_cannot_follow_is_noted():
    """Oracle: the log's own orders: seconds at the limit, and the longest spell, are those of the note; a strong helm has none."""
    weak = followed({"rudder_deg": 2})
    log, _ = next(simulate_scenario(trip(weak)))
    limit = np.isclose(np.abs(log.table["rudder_order_deg"].to_numpy()), 2.0, atol=1e-9)[:-1]
    ends = np.flatnonzero(np.diff(np.concatenate([[0], limit.astype(int), [0]])))
    spells = (ends[1::2] - ends[::2]) * 0.1
    told = [float(word) for word in log.notes["rudder_saturated"].replace(",", "").split() if word.isdigit()]
    assert told == pytest.approx([limit.sum() * 0.1, spells.max()], abs=1.0)
    assert "cannot follow the reference: rudder at 2 degrees" in log.notes["steering"]


def test_simulating_says_which_voyages_cannot_follow(tmp_path):
    """Oracle: the notes of the logs; one line for both voyages, none for the ship that can."""
    text = """
vessel = "otter"
voyages = 2
duration_s = 40
[start]
speed_kn = 2.5
latitude_deg = 63.44
longitude_deg = 10.4
zone = "32N"
heading_deg = 0
[manoeuvre]
kind = "waypoints"
points_m = [[0, 0], [15, 0], [15, 60]]
[manoeuvre.steering]
every_s = 0.2
rudder_deg = RUDDER
"""
    said = {}
    for rudder in ("2", "35"):
        path = tmp_path / f"limit-{rudder}.toml"
        path.write_text(text.replace("RUDDER", rudder))
        lines: list[str] = []
        made = simulate_files(path, tmp_path / rudder, tell=lines.append)
        said[rudder] = lines, [read_log(file).notes.get("steering") for file in made]
    (line,), notes = said["2"]
    assert notes[0] in line and line.endswith("(and 1 more voyages)") and all(notes)
    assert said["35"] == ([], [None, None])
    strong, _ = next(simulate_scenario(trip(followed({}))))
    assert "steering" not in strong.notes


def test_random_routes_are_as_the_scenario_says():
    """Oracle: law: legs and turns within their ranges, to both sides, the first leg ahead."""
    made = RandomRoute(kind="random-route", leg_m=(50.0, 80.0), turn_deg=(10.0, 60.0))
    route = made._drawn(np.random.default_rng(5), 40, (1000.0, 2000.0), 0.7)
    assert route.points[0].tolist() == [1000.0, 2000.0] and len(route.lengths) == 40
    assert 50 <= route.lengths.min() < 55 and 75 < route.lengths.max() <= 80
    assert route.angles[0] == pytest.approx(0.7)
    turns = np.degrees(route.turns)
    assert np.abs(turns).min() >= 10 and np.abs(turns).max() <= 60 and (turns > 0).any() and (turns < 0).any()


@pytest.mark.parametrize(
    ("manoeuvre", "message"),
    [
        (followed({}, points_m=[[0, 0], [50, 0], [50, 0]]), r"waypoints 2 and 3 are both \(50, 0\)"),
        (followed({}, points_m=[[0, 0], [50, 0], [10, 0]]), "at waypoint 2 it turns back"),
        (
            followed({}, points_m=[[0, 0], [50, 0], [50, 3]]),
            "the leg from waypoint 2 to 3 is 3 m, within a switching circle of 4 m",
        ),
        (followed({}, points_m=None), "give the waypoints as points_m or as points_deg"),
        (followed({}, points_m=None, points_deg=[[63.44, 190], [63.45, 10.4]]), "is no latitude and longitude"),
        (followed({"lookahead_m": 0}), "lookahead_m"),
        (followed({"nomoto_gain_1_s": 1.0}), "give both nomoto_gain_1_s and nomoto_time_s"),
        (followed({"nomoto_gain_1_s": 1.0, "nomoto_time_s": -1.0}), "must have one sign"),
        (followed({"omega_n_rad_s": 0.01}), "omega_n = 0.01 rad/s is too slow"),
        (followed({"gnss": {"period_s": 0.1}}), r"fixes every 0.1 s, orders every 0.2 s"),
        ({"kind": "random-route", "leg_m": [0, 50]}, "a leg of 0 m is none"),
        ({"kind": "random-route", "leg_m": [10, 50], "turn_deg": [0, 170]}, "must be within 0 and 150"),
        ({"kind": "courses", "courses_deg": [[0, 0]], "steering": {"law": "ilos"}}, "law = ilos follows a path"),
    ],
)
def test_what_cannot_be_steered_is_named(manoeuvre, message):
    """Contract: before anything is simulated, one line with what is wrong."""
    with pytest.raises((InputError, ValueError), match=message):
        next(simulate_scenario(trip(manoeuvre, duration_s=5)))


def test_errors_of_positions_are_those_that_are_stated():
    """Oracle: statistics of 20,000 fixes: deviations within four standard errors; voyages and axes independent."""
    gnss = Gnss(white_m=0.5, wander_m=2.0, wander_time_s=20.0, period_s=1.0)
    errors = gnss.errors([np.random.default_rng(k) for k in range(2)], 20000.0)
    assert errors.shape == (2, 2, 20002)
    # Of a Gauss-Markov process 40 s are worth one independent value: 500 of them here, 3 % per standard error.
    np.testing.assert_allclose(errors.std(axis=-1), math.hypot(0.5, 2.0), rtol=0.13)
    steps = np.diff(errors, axis=-1).std(axis=-1)
    np.testing.assert_allclose(
        steps, math.hypot(0.5 * math.sqrt(2), 2.0 * math.sqrt(-2 * math.expm1(-1 / 20))), rtol=0.03
    )
    assert np.abs(np.corrcoef(errors.reshape(4, -1)) - np.eye(4)).max() < 0.2
    assert gnss.expected == pytest.approx(math.hypot(0.5, 2.0 * math.sqrt(-2 * math.expm1(-1 / 20))))


@pytest.mark.parametrize("name", ["mariner", "otter"])
def test_nomotos_constants_tell_the_yaw_rate_of_a_manoeuvre_not_fitted(name):
    """Oracle: the first-order model run by the simulator's rudder, of a 15/15 zigzag: within a third of its yaw rate (rms), and nearer
    than with the constants of the linearised ship."""
    ship = Ship.of(load_vessel(name))
    length = ship.vessel.length / ship.service_speed
    angle = math.radians(15)
    run = simulate(ship, zigzag(angle, angle), ship.start(0, 0, 0, ship.service_speed), 40 * length, dt=length / 40)[0]

    def error(K, T):
        rate, kept = np.zeros(len(run.time)), math.exp(-run.time[1] / T)
        for k in range(len(rate) - 1):
            rate[k + 1] = K * run.rudder[k] * (1 - kept) + rate[k] * kept
        return np.sqrt(np.mean((rate - run.yaw_rate) ** 2) / np.mean(run.yaw_rate**2))

    assert error(*answer(ship, ship.service_speed)) < min(0.33, error(*nomoto(ship)))
