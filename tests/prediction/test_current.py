"""The current, against Galilei, a ship whose law is known, and voyages whose current is."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import torch

from aspnn.estimation import filter_log
from aspnn.evaluation.windows import SHIP, find_starts
from aspnn.frames import to_body
from aspnn.prediction import current, learned
from aspnn.prediction.gru import GruPredictor
from aspnn.records import States
from aspnn.simulation.scenario import read_scenario, simulate_scenario

ROOT = Path(__file__).parents[2]
FLOW = np.array([0.6, -0.45])  # m/s
DEVIATION = 0.24  # m, of the shipped network's places after 30 s, rms over its validation windows


@cache
def flagship():
    return GruPredictor.load(ROOT / "checkpoints/cargo90").bundle


@cache
def voyage(name: str, seed: int):
    """States and truth of the first voyage of a standard scenario under a new seed."""
    scenario = read_scenario(ROOT / f"data/scenarios/{name}.toml")
    log, truth = next(simulate_scenario(scenario, 1, seed))
    return filter_log(log), truth


def network(history, forcing, wind):
    with torch.inference_mode():
        inputs = (torch.from_numpy(a.astype(np.float32)) for a in (history, forcing, wind))
        return flagship().network(*inputs).numpy().astype(float)


def drifted(states: States, flow) -> States:
    """The same voyage through water that flows: places and velocities over ground change, nothing else."""
    table, time = states.table.copy(), states["time_s"]
    table["north_m"] += flow[0] * time
    table["east_m"] += flow[1] * time
    ahead, athwart = to_body(flow[0], flow[1], states["heading_rad"])
    table["surge_m_s"] += ahead
    for name in ("sway_m_s", "sway_bow_m_s", "sway_stern_m_s"):
        table[name] += athwart
    return replace(states, table=table)


def estimated(states, rows, net=network):
    return current.estimate_current(flagship(), net, states, rows, DEVIATION)


def relaxing(history, forcing, wind):
    """A ship with a law: surge goes to 6 m/s with 40 s, both sways to the rudder's 2 m/s per rad with 15 s."""
    spec, time = flagship().spec, flagship().spec.time
    now = history[:, -1][:, [spec.inputs.index(name) for name in learned.MOVING]]
    surge = 6 + (now[:, :1] - 6) * np.exp(-time / 40)
    sway = now[:, 1:2] * np.exp(-time / 15)
    return np.stack([surge, sway, sway], axis=-1)


def straight(surge, sway) -> States:
    """States of a ship on a steady heading with these velocities (n,) [m/s] through still water."""
    states, _ = voyage("cargo90-test", 501)
    time, table = states["time_s"], states.table.copy()
    body = surge + 1j * sway + 0 * time
    place = np.concatenate([[0], np.cumsum((body[1:] + body[:-1]) / 2 * np.diff(time))]) * np.exp(0.7j)
    for name, values in (
        *(("north_m", place.real), ("east_m", place.imag), ("heading_rad", 0.7), ("yaw_rate_rad_s", 0.0)),
        *(
            ("surge_m_s", body.real),
            ("sway_m_s", body.imag),
            ("sway_bow_m_s", body.imag),
            ("sway_stern_m_s", body.imag),
        ),
    ):
        table[name] = values
    return replace(states, table=table)


def test_a_known_law_tells_the_current_exactly():
    """Oracle: a ship that obeys the law, made in still water and then set adrift; the prior takes less than 0.02 m/s off."""
    time = voyage("cargo90-test", 501)[0]["time_s"]
    ship = straight(6 - 2.0 * np.exp(-time / 40), 1.0 * np.exp(-time / 15))  # slow at first, and sliding
    found = estimated(drifted(ship, FLOW), np.array([1200, 1400]), relaxing)
    assert found.sure.all()
    np.testing.assert_allclose(found.velocity, [FLOW, FLOW], atol=0.02)


def test_adrift_is_the_same_voyage():
    """Law (Galilei): the same voyage through flowing water gives that much more current, and the same way through the water."""
    states, _ = voyage("cargo90-test", 501)
    starts = find_starts(states, SHIP)
    rows = starts.rows[:12]
    there = drifted(states, FLOW)
    calm, found = estimated(states, rows), estimated(there, rows)
    assert not calm.sure.any() and not calm.velocity.any()
    assert found.sure.all()
    assert np.hypot(*(found.velocity - FLOW).T).max() < 0.06
    b = flagship()
    here = learned.material(b, states, rows, starts.plans[:12])
    seen = learned.material(b, there, rows, starts.plans[:12])
    seen = learned.through_water(seen, b.spec, np.tile(FLOW, (12, 1)))
    np.testing.assert_allclose(seen.history, here.history, atol=1e-9)


def test_the_current_of_a_voyage_is_found():
    """Statistic: in a simulated current of up to 1 m/s the error is 0.01 m/s at the median; bounds are four times that."""
    states, truth = voyage("cargo90-current", 502)
    true = truth[["current_north_m_s", "current_east_m_s"]].iloc[0].to_numpy()
    found = estimated(states, find_starts(states, SHIP).rows)
    assert np.hypot(*true) > 0.2
    assert found.sure.mean() > 0.9
    assert np.median(np.hypot(*(found.velocity - true).T)) < 0.04
    deviation = np.sqrt(np.einsum("nii->n", found.covariance))
    assert 0.002 < np.median(deviation) < 0.05


def test_the_future_is_not_seen_and_a_short_past_tells_nothing():
    """Law: later rows are changed, the estimate does not move; less than two horizons of states give none."""
    states, _ = voyage("cargo90-current", 502)
    row = int(find_starts(states, SHIP).rows[3])
    table = states.table.copy()
    table.loc[row + 1 :, ["north_m", "surge_m_s", "sway_bow_m_s", "heading_rad", "rudder_order_rad"]] = 7.0
    first, second = (estimated(s, np.array([row])) for s in (states, replace(states, table=table)))
    np.testing.assert_array_equal(first.velocity, second.velocity)
    short = estimated(states, np.array([1180]))
    assert not short.sure.any() and np.isnan(short.covariance).all()


def test_a_ship_that_tells_nothing_keeps_the_prior():
    """Law: on a straight course a network that holds the velocities of its start sees no difference between water and ground."""
    places = [flagship().spec.inputs.index(name) for name in learned.MOVING]

    def held(history, forcing, wind):
        return np.repeat(history[:, -1][:, None, places], len(flagship().spec.time), axis=1)

    found = estimated(drifted(straight(6.0, 0.0), FLOW), np.array([3000]), held)
    assert not found.sure.any()
    np.testing.assert_allclose(found.covariance[0], np.eye(2) * current.USUAL**2, rtol=1e-3)


def test_a_network_that_sees_the_ground_is_told():
    """Oracle: the thesis's network, which sees course and speed over ground, has no current; the flagship has."""
    thesis = GruPredictor.load(ROOT / "checkpoints/cargo90-thesis").bundle
    assert not current.can_estimate(thesis.spec) and current.can_estimate(flagship().spec)


def test_a_memory_longer_than_the_horizon():
    """Statistic: with the last 180 s in place of 90 an error of the current is smaller; parts stay a third of the horizon."""
    states, truth = voyage("cargo90-current", 502)
    true = truth[["current_north_m_s", "current_east_m_s"]].iloc[0].to_numpy()
    longer = replace(flagship(), spec=replace(flagship().spec, current_memory=180.0))
    rows = find_starts(states, SHIP).rows
    rows = rows[states["time_s"][rows] >= 215.0]
    short = estimated(states, rows)
    found = current.estimate_current(longer, network, states, rows, DEVIATION)
    assert np.median(np.hypot(*(found.velocity - true).T)) < np.median(np.hypot(*(short.velocity - true).T))
    assert (found.covariance[:, [0, 1], [0, 1]] < short.covariance[:, [0, 1], [0, 1]]).all()


def test_a_memory_that_the_log_does_not_fill_yet():
    """Law: until the memory is full a start goes by the parts that there are, as one with just so long a memory."""
    states, _ = voyage("cargo90-current", 502)
    rows = np.searchsorted(states["time_s"], [100.0, 130.0, 160.0, 190.0, 300.0])
    spec = flagship().spec

    def by(memory):
        return current.estimate_current(
            replace(flagship(), spec=replace(spec, current_memory=memory)), network, states, rows, DEVIATION
        )

    found, shorter = by(180.0), by(120.0)
    assert np.isfinite(found.covariance[:, 0, 0]).tolist() == [
        False,
        True,
        True,
        True,
        True,
    ]  # history 30 s, horizon 90 s
    np.testing.assert_allclose(found.velocity[2], shorter.velocity[2], rtol=1e-12)
    assert (found.covariance[4, 0, 0] < shorter.covariance[4, 0, 0]) and found.sure[2]


def test_parts_that_fit_neither_period_nor_epochs():
    """Oracle: a ship that obeys the law in a known current, states at 0.13 s: a part's end is read off between epochs, and a part is
    whole periods long, or the way of a tenth of a second would pass for a current."""
    spec = replace(flagship().spec, horizon=10.0, period=0.5, history=4.0, current_memory=30.0)
    boat = replace(flagship(), spec=spec)
    states = straight(0.0, 0.0)
    table = states.table.iloc[: len(states) // 4].reset_index(drop=True)
    table["time_s"] = time = 0.13 * np.arange(len(table))
    body = 6 - 2.0 * np.exp(-time / 40) + 1j * np.exp(-time / 15)
    place = np.cumsum(body) * 0.13 * np.exp(0.7j)  # errors of the sum are alike at both ends of a part
    place = place - body / 2 * 0.13 * np.exp(0.7j)
    sides = dict.fromkeys(("sway_m_s", "sway_bow_m_s", "sway_stern_m_s"), body.imag)
    table = table.assign(north_m=place.real, east_m=place.imag, surge_m_s=body.real, **sides)
    ship = drifted(replace(states, table=table), FLOW)

    def law(history, forcing, wind):
        instants = spec.period * np.arange(forcing.shape[1])
        now = history[:, -1][:, [spec.inputs.index(name) for name in learned.MOVING]]
        surge, sway = 6 + (now[:, :1] - 6) * np.exp(-instants / 40), now[:, 1:2] * np.exp(-instants / 15)
        return np.stack([surge, sway, sway], axis=-1)

    found = current.estimate_current(boat, law, ship, np.array([400]), 0.01)
    assert found.sure.all()
    np.testing.assert_allclose(found.velocity, [FLOW], atol=0.02)
    whole = current.voyage_current(boat, law, ship, 0.01)
    assert whole.sure.all()
    np.testing.assert_allclose(whole.velocity, [FLOW], atol=0.02)
