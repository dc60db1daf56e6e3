"""Servos identified from logs. Oracle: the simulator's own actuators, of known rate, lag, delay and dead band."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aspnn.learning import train
from aspnn.learning.checkpoint import Bundle, read_bundle, write_bundle
from aspnn.learning.identify_servo import Record, fit_rate, fit_servo, identify_servos, records, sought, unsure
from aspnn.learning.servo import Identified, Servo, Servos
from aspnn.learning.windows import Sampling
from aspnn.orders import Orders
from aspnn.records import Log, States
from aspnn.simulation import actuators
from tests.learning.conftest import SPEC, nomoto_states

DEGREE = math.radians(1)
CASES = {
    "rate": (actuators.Servo(-1, 1, 2.3 * DEGREE), 0.1),
    "lag": (actuators.Servo(-1, 1, 3 * DEGREE, 1.5), 0.1),
    "lag and delay": (actuators.Servo(-1, 1, 3 * DEGREE, 1.0, 0.0, 0.8), 0.1),
    "dead band": (actuators.Servo(-1, 1, 3 * DEGREE, 0.0, 0.7 * DEGREE), 0.1),
    "slow log": (actuators.Servo(-1, 1, 2.3 * DEGREE, 0.0, 0.0, 2.0), 1.0),
}


def sailed(servo: actuators.Servo, orders: Orders, time: np.ndarray) -> np.ndarray:
    """The position of a simulated servo, step by step as the simulator moves it."""
    dt, places = time[1] - time[0], [float(orders.values[0])]
    for order in actuators.heard(servo, orders.at(time)[None], places[0], dt)[0, :-1]:
        places.append(actuators.moved(servo, places[-1], actuators.held(servo, places[-1], order), dt))
    return np.array(places)


def voyage(servo: actuators.Servo, seed: int, dt: float, noise: float = 0.2 * DEGREE) -> Record:
    """Twenty minutes of orders of whole 5 degrees; the angle with noise, read to 0.5 degrees, a tenth of it missing."""
    rng, time = np.random.default_rng(seed), np.arange(0, 1200, dt)
    instants = np.round(np.concatenate([[0], 30 + np.cumsum(rng.uniform(40, 120, 9))]) / dt) * dt
    orders = Orders(instants, 5 * DEGREE * rng.integers(-7, 8, len(instants)))
    value = sailed(servo, orders, time)
    if noise:
        value = np.round((value + noise * rng.normal(size=len(time))) / (0.5 * DEGREE)) * 0.5 * DEGREE
    return Record(orders, time, np.where(rng.random(len(time)) < 0.1, np.nan, value))


def voyages(name: str, **others) -> list[Record]:
    return [voyage(CASES[name][0], seed, CASES[name][1], **others) for seed in range(3)]


@pytest.mark.parametrize("name", CASES)
def test_orders_move_a_servo_as_the_simulator_does(name):
    """Oracle: simulation.actuators; a dead band, which the simulator tests step by step, is overrun by a step at most."""
    servo, dt = CASES[name]
    record = voyage(servo, 5, dt, noise=0.0)
    ours = Servo(servo.rate, servo.lag, servo.delay, servo.dead_band).follow(
        record.orders, record.time, record.value[0]
    )
    known = np.isfinite(record.value)
    within = 1.01 * servo.rate * dt if servo.dead_band else 1e-12
    np.testing.assert_allclose(ours[known], record.value[known], rtol=0, atol=within)


@pytest.mark.parametrize("name", CASES)
def test_a_servo_is_recovered_from_what_was_measured(name):
    """Oracle: the simulated servo, within five standard errors; what it does not have is found to be none. A dead band ends a
    simulated movement up to a step late, which a wider or narrower band and a lag of a few steps explain as well."""
    servo, dt = CASES[name]
    found = fit_servo(voyages(name), Servo(2 * DEGREE))
    assert found is not None and found.error is not None
    steps = 3.0 * bool(servo.dead_band)
    for part, late in (("rate", 0.0), ("lag", steps * dt), ("delay", 0.0), ("dead_band", steps * servo.rate * dt / 3)):
        true, got, error = (getattr(s, part) for s in (servo, found.servo, found.error))
        assert abs(got - true) <= (5 * error if true else 0.0) + late, part
    assert found.error.rate < 0.01 * found.servo.rate


def test_logs_that_cannot_tell():
    """Contract: too few orders, an angle that does not follow, or one that repeats the order, tell nothing."""
    some = voyages("rate")
    few = replace_orders(some[0], 3)
    assert fit_servo([few], Servo(DEGREE)) is None
    dead = [record._replace(value=0 * record.value) for record in some]
    assert fit_servo(dead, Servo(2 * DEGREE)) is None
    log = log_of(some[0])
    copied = replace(log, table=log.table.assign(rudder_angle_deg=log.table["rudder_order_deg"]))
    assert np.isnan(records([copied], "rudder_order_deg", "rudder_angle_deg", DEGREE)[0].value).all()
    kept = identify_servos([], log.vessel).rudder
    assert kept.error is None and kept.servo == Servo(log.vessel.rudder_rate)


def replace_orders(record: Record, count: int) -> Record:
    """The part of a record with its first `count` orders."""
    part = record.time < record.orders.times[count]
    return Record(
        Orders(record.orders.times[:count], record.orders.values[:count]), record.time[part], record.value[part]
    )


def log_of(record: Record) -> Log:
    states = nomoto_states(0)
    angle, order = record.value / DEGREE, record.orders.at(record.time) / DEGREE
    table = {"time_s": record.time, "rudder_order_deg": order, "rudder_angle_deg": angle}
    return Log(type(states.table)(table), states.vessel)


def test_a_wrong_vessel_file_does_not_matter_where_the_angle_is_logged():
    """Oracle: 2.3 deg/s simulated; vessel files that say 1.2 and 9 give one servo to a thousandth."""
    logs = [(log_of(record), nomoto_states(0)) for record in voyages("rate")]
    vessel = logs[0][0].vessel
    found = [identify_servos(logs, replace(vessel, rudder_rate=rate * DEGREE)).rudder.servo.rate for rate in (1.2, 9)]
    np.testing.assert_allclose(found, 2.3 * DEGREE, rtol=2e-3)


def test_a_shaft_is_identified_by_its_own_columns():
    """Oracle: a shaft of 0.05 rev/s2 with a lag of 2 s, simulated, noise 0.01 rev/s; the rudder is left as it was."""
    servo = actuators.Servo(-3, 3, 0.05, 2.0)
    rng, time, logs = np.random.default_rng(3), np.arange(0, 1500, 0.5), []
    for k in range(3):
        orders = Orders(np.arange(0, 1500, 150.0), np.round(rng.uniform(-1, 2.5, 10), 1))
        speed = sailed(servo, orders, time) + 0.01 * rng.normal(size=len(time))
        log = log_of(voyage(CASES["rate"][0], k, 1.0))
        table = {"time_s": time, "engine_order_rps": orders.at(time), "shaft_speed_rps": speed}
        logs.append((replace(log, table=type(log.table)(table)), nomoto_states(0)))
    found = identify_servos(logs, logs[0][0].vessel)
    assert found.rudder.error is None and found.shaft is not None and found.shaft.error is not None
    assert abs(found.shaft.servo.rate - 0.05) < 5 * found.shaft.error.rate < 0.005
    assert abs(found.shaft.servo.lag - 2.0) < 5 * found.shaft.error.lag < 1.5
    assert found.shaft.servo.delay == found.shaft.servo.dead_band == 0


def turning(rates: tuple[float, ...]) -> list[States]:
    """Voyages of a ship whose yaw acceleration is a polynomial of its motion and of a rudder of one of `rates`."""
    given = []
    for seed, rate in enumerate(rates):
        states = nomoto_states(seed)
        time, orders = states["time_s"], Orders.from_series(states["time_s"], states["rudder_order_rad"])
        angle, yaw = orders.servo(time, float(orders.values[0]), rate), np.zeros(len(time))
        steps = np.diff(time, append=time[-1])
        change = np.zeros(len(time))
        for k, delta in enumerate(angle):
            change[k] = (0.08 * delta - yaw[k] - 3.0 * yaw[k] * abs(yaw[k])) / 10
            if k + 1 < len(time):
                yaw[k + 1] = yaw[k] + steps[k] * change[k]
        columns = {"yaw_rate_rad_s": yaw, "yaw_acceleration_rad_s2": change}
        given.append(replace(states, table=states.table.assign(**columns)))
    return given


def test_a_rate_is_found_from_the_motion_where_only_orders_are_logged():
    """Oracle: a servo of 2.3 deg/s under a polynomial ship, within 3 %; the vessel file says 1.4."""
    rate = 2.3 * DEGREE
    found = fit_rate(turning((rate,) * 3), 0.6 * rate)
    assert found is not None and not found.measured
    assert abs(found.servo.rate / rate - 1) < 0.03


def test_a_rate_that_one_piece_tells_is_not_told():
    """Oracle: the jackknife. Seven pieces that are explained best by the same rate give it without error; where six are
    explained the better the quicker the rudder, and one alone by a rate in the middle, there is no telling."""
    rates = np.geomspace(0.25, 4.0, 9)
    middle, quick = 1 - 0.2 * np.log(rates) ** 2, 0.5 + 0.01 * np.log(rates)

    def piece(share: np.ndarray, weight: float) -> np.ndarray:  # of one term and the response, each of unit size
        return weight * np.moveaxis(np.array([[1 + 0 * share, share], [share, 1 + 0 * share]]), -1, 0)

    alike = sought([piece(middle, 1.0)] * 7, rates)
    assert alike is not None
    np.testing.assert_allclose(alike, (1.0, 0.0), atol=1e-9)
    assert sought([piece(quick, 1.0)] * 6 + [piece(middle, 3.0)], rates) is None


def test_a_rate_that_changes_from_voyage_to_voyage_is_as_unsure_as_that():
    """Oracle: the standard error of the mean of three logarithms, 0.14 of the rate, and with it what a sample is worth, 0.08.
    The five pieces that each voyage is cut into agree among themselves and are no fifteen witnesses (by them alone 0.10)."""
    rates = DEGREE * np.array([1.8, 2.3, 2.9])
    voyages = turning(tuple(rates))
    found = fit_rate(voyages, 2.3 * DEGREE)
    assert found is not None and found.error is not None
    orders = [Orders.from_series(states["time_s"], states["rudder_order_rad"]).values for states in voyages]
    late = unsure(found.servo.rate, 0.5, np.concatenate([np.diff(values) for values in orders]))
    expected = math.hypot(np.log(rates).std(ddof=1) / math.sqrt(3), late)
    assert found.error.rate / found.servo.rate == pytest.approx(expected, rel=0.13)


def test_a_rudder_as_quick_as_samples_is_not_told():
    """Oracle: by hand, 10 deg at 2 deg/s are half done after 2.5 s, which is 0.25 s in ten; steps of 1 deg hardly count. A rudder
    of 30 deg/s is over within a sample or two of 0.5 s: pieces and voyages agree on it, and would if all orders were late."""
    assert unsure(2 * DEGREE, 0.25, np.array([10, -10]) * DEGREE) == pytest.approx(0.1)
    assert unsure(2 * DEGREE, 0.25, np.array([10, -1, 1, 1]) * DEGREE) == pytest.approx(0.1, rel=0.01)
    voyages = [replace(states, voyage=str(k)) for k, states in enumerate(turning((30 * DEGREE,) * 3))]
    assert fit_rate(voyages, 20 * DEGREE) is None


def test_states_take_the_angle_of_a_servo_found_from_motion():
    """Contract: only where training had nothing but orders; the angle is then the servo's from the first one on."""
    states = nomoto_states(1)
    found = Identified(Servo(DEGREE), Servo(0.1 * DEGREE), 9, measured=False)
    assert Servos(replace(found, measured=True)).sailed(states) is states
    assert Servos(replace(found, error=None)).sailed(states) is states
    angle = Servos(found).sailed(states)["rudder_angle_rad"]
    orders = Orders.from_series(states["time_s"], states["rudder_order_rad"])
    expected = orders.servo(states["time_s"], states["rudder_angle_rad"][0], DEGREE)
    np.testing.assert_array_equal(angle, expected)


def test_a_checkpoint_carries_its_servos(tmp_path):
    """Contract: back unchanged from config.json; a config without the key has none and is as it was before."""
    from aspnn.learning.network import RolloutGru, RolloutSizes

    network, vessel = RolloutGru(RolloutSizes(4, 1, (0, 1, 2), 35.0, -35.0, 2.0, latent=4)), nomoto_states(0).vessel
    servos = Servos(
        Identified(Servo(0.04, 1.0, 0.5, 0.01), Servo(0.001, 0.1, 0.1, 0.001), 80), Identified(Servo(0.1), Servo(0.01))
    )
    plain = Bundle("a", network, SPEC, vessel, False)
    for bundle in (plain, replace(plain, servos=servos)):
        write_bundle(bundle, tmp_path, "card")
        assert read_bundle(tmp_path).servos == bundle.servos
        assert ("servo" in (tmp_path / "config.json").read_text()) == (bundle.servos is not None)
    lines = servos.lines()
    assert "2.29 ± 0.057 deg/s, lag 1 ± 0.1 s, delay 0.5 ± 0.1 s" in lines["rudder servo"]
    assert lines["shaft servo"].startswith("0.1 ± 0.01 rps/s; identified by the measured speed")


def test_servos_are_those_of_training_voyages(monkeypatch):
    """Contract: the last voyages, which validate, are left out, and so are those beyond SERVO_HOURS; all are cut."""
    heard: list[list[str]] = []

    def noted(voyages, vessel):
        heard.append([log.voyage for log, _ in voyages])
        return Servos.of(vessel)

    monkeypatch.setattr(train, "identify_servos", noted)
    states = [replace(nomoto_states(0), voyage=str(k)) for k in range(6)]  # of 20 minutes each
    given = [(Log(s.table, s.vessel, voyage=s.voyage), s, s) for s in states]
    where = SPEC, Sampling(sliding=60.0)
    for hours, held, taught in ((5.0, 2, "0123"), (0.9, 2, "012"), (0.9, 0, "012"), (5.0, 0, "012345")):
        monkeypatch.setattr(train, "SERVO_HOURS", hours)
        servos, all_of_them = train._with_servos(iter(given), where, held)
        assert servos is not None and "".join(heard[-1]) == taught
        assert [log.voyage for log, _, _ in all_of_them] == [*"012345"]
    without = replace(SPEC, forcings=())
    assert train._with_servos(iter(given), (without, where[1]), 0)[0] is None
