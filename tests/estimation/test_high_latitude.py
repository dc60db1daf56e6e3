"""Heading at high latitude (Paper III): grid convergence and the switching of the compass, each taken away on purpose."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest

from aspnn import frames
from aspnn.angles import circular_mean, difference
from aspnn.estimation import filter_log
from aspnn.estimation.compiled import run
from aspnn.estimation.measurements import Measurements, from_log
from aspnn.estimation.models import Ctra, Sigma
from aspnn.estimation.nonlinear import model_problem, two_point_start
from aspnn.frames import Zone
from aspnn.records import Log
from aspnn.simulation import Scenario, simulate_scenario
from aspnn.vessel import load_vessel

DEG = np.pi / 180
ZONE = Zone(33)
DENSITY = (1e-1, 1e-1, 1e-3, 1e-3, 0.1 * DEG, 1e-5 * DEG, 1e-5, 1e-5)  # Paper III, table 2, permuted (E24)
SETTLED = 10.0  # s


@dataclass(frozen=True)
class Voyage:
    """A log, its measurements and its truth; the compass [rad, 0 to 2 pi) steps over north at the epochs `steps`."""

    log: Log
    m: Measurements
    truth: pd.DataFrame
    steps: np.ndarray

    def states(self, wrapped: bool = True, corrected: bool = True) -> np.ndarray:
        """States (n, 8) of CTRA and UKF as in the paper, without its switching or without its convergence correction."""
        m = self.m if corrected else replace(self.m, heading=self.m.heading + self.m.convergence)
        vessel = self.log.vessel
        p = model_problem(m, vessel.noise, Ctra(DENSITY), vessel.service_speed, vessel.length, sigma=Sigma())
        return run(replace(p, angle=p.angle & wrapped, gates=np.full_like(p.gates, np.inf))).mean

    def turned(self) -> np.ndarray:
        """What a heading that is gamma too large does to surge and sway: (u + i v) (exp(-i gamma) - 1)."""
        velocity = self.truth["surge_m_s"].to_numpy() + 1j * self.truth["sway_m_s"].to_numpy()
        return velocity * (np.exp(-1j * self.m.convergence) - 1)


def voyage_of(place, heading, helm, seconds) -> Voyage:
    latitude, longitude = np.degrees(frames.to_geodetic(*place, ZONE))
    scenario = Scenario.model_validate(
        {
            "name": "svalbard",
            "vessel": "cargo90",
            "duration_s": seconds,
            "seed": 76,
            "start": {
                "speed_kn": 11.5,
                "latitude_deg": float(latitude),
                "longitude_deg": float(longitude),
                "zone": "33N",
                "heading_deg": heading,
            },
            "manoeuvre": helm,
            "sensors": {"antennas": ["midship"]},
        }
    )
    log, truth = next(simulate_scenario(scenario))
    m = from_log(log)
    return Voyage(log, m, truth, np.flatnonzero(np.abs(np.diff(m.heading + m.convergence)) > np.pi) + 1)


@pytest.fixture(scope="module")
def straight():
    """To true north from the paper's x_0."""
    return voyage_of((8503821.0, 434061.0), 0.0, {"kind": "straight"}, 300)


@pytest.fixture(scope="module")
def zigzag():
    """A zigzag about 15 deg from the paper's x_0: over north on the way to port and back."""
    helm = {"kind": "zigzag", "rudder_deg": 20, "heading_change_deg": 20, "start_s": 30}
    return voyage_of((8635500.0, 424155.0), 15.0, helm, 320)


def test_convergence_left_out_is_a_sway_bias(straight):
    """Analytic: the heading is gamma = -2.48 deg off, so sway errs by -u sin gamma + v (cos gamma - 1) = 0.256 m/s.

    Against the corrected filter on the same noise, which then cancels: to 1 mm/s. That one has no bias: its error of
    0.023 m/s is correlated over about 3 s, so the mean of 290 s has a deviation of 0.003.
    """
    use = straight.m.time > SETTLED
    good, off = straight.states()[use], straight.states(corrected=False)[use]
    surge, sway = (off - good)[:, 2:4].mean(axis=0)
    expected = straight.turned()[use].mean()
    assert expected.imag == pytest.approx(5.916 * np.sin(2.4809 * DEG), abs=1e-3)
    assert surge == pytest.approx(expected.real, abs=1e-3)
    assert sway == pytest.approx(expected.imag, abs=1e-3)
    assert abs((good[:, 3] - straight.truth["sway_m_s"].to_numpy()[use]).mean()) < 0.01


def test_convergence_left_out_in_a_zigzag(zigzag):
    """Analytic, as above; the accelerometers keep to the true axes, which in turns takes a few mm/s off: to 4 %."""
    use = zigzag.m.time > SETTLED
    bias = (zigzag.states(corrected=False) - zigzag.states())[use, 3].mean()
    assert bias == pytest.approx(zigzag.turned()[use].imag.mean(), rel=0.04)


def test_without_wrapping_the_straight_run_diverges(straight):
    """Law: a compass that jumps between 0 and 2 pi drives the velocity away at once; wrapped, the error stays below 5 deviations."""
    use = straight.m.time > SETTLED
    surge = straight.truth["surge_m_s"].to_numpy()[use]
    assert np.abs(straight.states(wrapped=False)[use, 2] - surge).max() > 50.0
    assert np.abs(straight.states()[use, 2] - surge).max() < 0.12


def test_without_wrapping_the_zigzag_fails_after_steps_alone(zigzag):
    """Law: until the compass first steps over north both filters are one; a step throws heading and velocity off, for a while."""
    good, bad = zigzag.states(), zigzag.states(wrapped=False)
    steps, time = zigzag.steps, zigzag.m.time
    assert len(steps) >= 2
    np.testing.assert_allclose(bad[: steps[0]], good[: steps[0]], rtol=0, atol=1e-9)
    apart = np.hypot(*(bad - good)[:, 2:4].T)
    turned = np.abs(difference(bad[:, 4], good[:, 4]))
    clusters = steps[np.diff(time[steps], prepend=-np.inf) > 10.0]  # noise makes several steps of one crossing
    assert len(clusters) >= 2
    for first in clusters:
        assert apart[first - 1] < 0.05
        assert turned[first : first + 30].max() > 1.0
        assert apart[first : first + 30].max() > 0.08
    last = steps[np.searchsorted(steps, np.arange(len(time)), side="right") - 1]
    quiet = (time - time[last] > 40.0) & (np.arange(len(time)) > steps[0])
    assert quiet.sum() > 100
    assert apart[quiet].max() < 0.05


def test_crossing_north_does_nothing_to_the_default(zigzag):
    """Law: the same recording with the compass written from -180 to 180 deg instead of 0 to 360 gives the same states."""
    states = filter_log(zigzag.log).table
    log = zigzag.log
    signed = log.table.assign(heading_deg=np.degrees(difference(np.radians(log.table["heading_deg"]), 0.0)))
    other = filter_log(replace(log, table=signed)).table
    apart = {c: np.abs(other[c] - states[c]).max() for c in ("north_m", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")}
    assert max(apart.values()) < 1e-8, apart


def test_start_on_the_circular_mean(straight):
    """By hand (E25): headings of 359.5 and 0.3 deg mean 359.9; their arithmetic mean points astern and turns the surge round."""
    headings = np.array([359.5, 0.3]) * DEG
    noise, time, fixes = straight.log.vessel.noise, np.array([0.0, 1.0]), np.array([[0.0, 0.0], [5.9, 0.0]])

    def surge(heading):
        return two_point_start(Ctra(DENSITY), time, fixes, heading, 0.0, noise, np.ones(2), 0.05)[0][2]

    assert circular_mean(headings) == pytest.approx(-0.1 * DEG)
    assert surge(float(circular_mean(headings))) == pytest.approx(5.9, abs=1e-4)
    assert surge(headings.mean()) == pytest.approx(-5.9, abs=1e-4)


@pytest.mark.parametrize("degrees", [30.0, -7.0, 179.0, -179.0])
def test_switching_is_the_smallest_signed_angle(zigzag, degrees):
    """By hand (E28): a heading so much off has so much more innovation, where the printed rule makes 30 into -330, -7 into 353."""
    m, vessel = zigzag.m, zigzag.log.vessel
    k = int(zigzag.steps[0]) - 100  # well before the step: near north, with small innovations
    found = []
    for extra in (0.0, degrees * DEG):
        heading = m.heading.copy()
        heading[k] += extra
        p = model_problem(replace(m, heading=heading), vessel.noise, Ctra(DENSITY), vessel.service_speed, vessel.length)
        found.append(run(p).innovation[k, 0, 0])
    assert abs(found[0]) < 3 * DEG
    assert found[1] == pytest.approx(difference(found[0] + degrees * DEG, 0.0), abs=1e-9)


def test_convergence_follows_the_ship():
    """Analytic (E15): d gamma = sin(latitude) d longitude, 0.44 deg an hour for a ship going east at 5 m/s at 70 N.

    The value used is never older than the median of five seconds makes it: 3 s, which is 4e-4 deg.
    """
    time = np.arange(0.0, 3600.0, 0.5)
    latitude = np.full(len(time), 70.0 * DEG)
    radius = 6378137.0 / np.sqrt(1 - 0.00669438 * np.sin(latitude) ** 2) * np.cos(latitude)
    longitude = 14.0 * DEG + 5.0 * time / radius
    columns = {"time_s": time, "midship_latitude_deg": latitude / DEG, "midship_longitude_deg": longitude / DEG}
    table = pd.DataFrame(columns | {"heading_deg": np.full(len(time), 90.0)})
    gamma = from_log(Log(table, load_vessel("cargo90"), ZONE)).convergence
    rate = (gamma[-1] - gamma[0]) / DEG
    assert rate == pytest.approx(np.sin(70 * DEG) * np.ptp(longitude) / DEG, rel=2e-3)
    assert rate == pytest.approx(0.44, abs=0.005)
    np.testing.assert_allclose(gamma, frames.convergence(latitude, longitude, ZONE), rtol=0, atol=4e-4 * DEG)
