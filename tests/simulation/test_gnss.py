"""GNSS errors: each against the statistic that its setting states, and faults that leave each other alone."""

import numpy as np
import pytest
from made_voyages import made
from scipy.stats import kstest

from aspnn.frames import Zone, to_grid
from aspnn.simulation import Sensors, measure
from aspnn.simulation.sensing.errors import gauss_markov, spells
from aspnn.simulation.sensing.gnss import Gnss, receivers
from aspnn.vessel import load_vessel

ZONE = Zone.parse("33N")
PLACE = to_grid(np.radians(69.65), np.radians(18.96), ZONE)
VESSEL = load_vessel("cargo90").with_stations(mast=(12.0, 3.6))
QUIET = {"position_m": 0, "heading_deg": 0, "yaw_rate_deg_s": 0, "acceleration_m_s2": 0}


@pytest.fixture(scope="module")
def voyage():
    return made(PLACE, 1800.0)


def grid(table, antenna):
    """North and east [m] of an antenna's fixes as complex numbers."""
    north, east = to_grid(*(np.radians(table[f"{antenna}_{axis}_deg"]) for axis in ("latitude", "longitude")), ZONE)
    return north + 1j * east


def errors(voyage, gnss, antennas=("bow", "stern"), seed=3, **sensors):
    """The errors [m] (north + 1j east) of each antenna's fixes with settings `gnss` and without white noise."""
    table = measure(
        voyage, VESSEL, ZONE, Sensors(antennas=antennas, gnss=gnss, **QUIET, **sensors), np.random.default_rng(seed)
    )
    exact = measure(voyage, VESSEL, ZONE, Sensors(antennas=antennas, **QUIET, **sensors), np.random.default_rng(0))
    return [grid(table, a) - grid(exact, a) for a in antennas]


@pytest.mark.parametrize("dt", [0.1, 1.0, 10.0])
def test_wander_keeps_its_stated_deviation_at_any_step(dt):
    """Oracle: the stationary law, 4.7 m and exp(-lag / 1100 s), at 4.5 standard errors over 4000 processes (E60: paper 000's
    driving noise of 0.21 m gives 15.6 m at a step of 0.1 s), at the first step, after 50 and after 300 of them."""
    count = 4000
    x = gauss_markov(np.random.default_rng(1), (count, 301), dt, 4.7, 1100.0)
    variance = (x[:, [0, 50, 300]] ** 2).mean(0)
    np.testing.assert_allclose(variance, 4.7**2, rtol=4.5 * np.sqrt(2 / count))
    rho = (x[:, 0] * x[:, 300]).mean() / 4.7**2
    expected = np.exp(-300 * dt / 1100)
    assert abs(rho - expected) < 4.5 * np.sqrt((1 + expected**2) / count)
    step = ((x[:, 1] - x[:, 0]) ** 2).mean() / (2 * 4.7**2 * -np.expm1(-dt / 1100))
    assert abs(step - 1) < 4.5 * np.sqrt(2 / count)


def test_wander_is_common_or_of_each_antenna(voyage):
    """Oracle: common wander is the same to the rounding of a northing of 8e6 m; own ones correlate by chance alone: with T = 10 s
    there are some 1800 / 10 independent pairs of two components."""
    bow, stern = errors(voyage, Gnss(wander_m=4.7, wander_time_s=10.0))
    np.testing.assert_allclose(bow, stern, atol=1e-6)
    bow, stern = errors(voyage, Gnss(wander_m=4.7, wander_time_s=10.0, wander_common=False))
    scale = np.sqrt(np.mean(np.abs(bow) ** 2) * np.mean(np.abs(stern) ** 2))
    assert np.abs(np.mean(bow * stern.conj())) / scale < 4.5 / np.sqrt(2 * 180)
    assert abs(np.sqrt(np.mean(np.abs(bow) ** 2) / 2) / 4.7 - 1) < 4.5 / np.sqrt(4 * 180)


@pytest.mark.parametrize(("share", "mean"), [(0.05, 20.0), (0.4, 3.0), (0.01, 0.5)])
def test_spells_take_their_share_and_last_their_time(share, mean):
    """Oracle: the two-state Markov process. The share in a time T has variance 2 s (1 - s) / ((a + b) T), 1/(a + b) = mean (1 - s);
    lengths are exponential."""
    time = np.arange(200_000) * 0.1
    found = spells(np.random.default_rng(5), time, share, mean)
    error = np.sqrt(2 * share * (1 - share) * mean * (1 - share) / time[-1])
    assert abs((found > 0).mean() - share) < 4.5 * error
    lengths = np.bincount(found)[1:] * 0.1
    whole = lengths[1:-1]
    expected = mean if mean > 1 else np.nan  # short ones may fall between two steps
    assert np.isnan(expected) or abs(whole.mean() - expected) < 4.5 * expected / np.sqrt(len(whole)) + 0.1
    starts = [(spells(np.random.default_rng(k), time[:2], share, mean) > 0)[0] for k in range(2000)]
    assert abs(np.mean(starts) - share) < 4.5 * np.sqrt(share * (1 - share) / 2000)  # stationary from the first step on


def test_spikes_are_single_and_of_stated_size(voyage):
    """Oracle: binomial share; sizes uniform in the range (Kolmogorov-Smirnov at 1e-4), directions all round."""
    bow, stern = errors(voyage, Gnss(spike_share=0.02, jump_m=(10, 50)))
    off = np.abs(bow) > 1e-3
    assert abs(off.mean() - 0.02) < 4.5 * np.sqrt(0.02 * 0.98 / len(bow))
    sizes = np.abs(bow[off])
    assert kstest(sizes, "uniform", (10, 40)).pvalue > 1e-4
    assert kstest(np.angle(bow[off]), "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-4
    assert (off & (np.abs(stern) > 1e-3)).mean() < 5 * 0.02**2
    assert np.count_nonzero(off[1:] & off[:-1]) < 0.1 * off.sum()


def test_jumps_stay_through_a_spell(voyage):
    """Law: within a spell the error is one displacement, of a size in the range; outside it is none."""
    bow, _ = errors(voyage, Gnss(jump_share=0.1, jump_s=20.0, jump_m=(10, 12)))
    off = np.abs(bow) > 1e-3
    edges = np.flatnonzero(np.diff(off.astype(int))) + 1
    assert 3 < len(edges) < 60 and 0.01 < off.mean() < 0.3
    for part in np.split(bow, edges):
        np.testing.assert_allclose(part, part[0], atol=1e-6)
        assert np.abs(part[0]) < 1e-3 or 10 - 1e-6 < np.abs(part[0]) < 12 + 1e-6


def test_frozen_fixes_repeat_bit_by_bit(voyage):
    """Law: a frozen fix is its predecessor, noise and all; the others are those of a log without freezing. At 2 Hz."""
    base = Sensors(position_hz=2, gnss=Gnss(height_m=0.5))
    frozen = Sensors(position_hz=2, gnss=Gnss(height_m=0.5, frozen_share=0.2, frozen_s=3.0))
    one, other = (measure(voyage, VESSEL, ZONE, s, np.random.default_rng(2)) for s in (base, frozen))
    for antenna in ("bow", "stern"):
        names = [f"{antenna}_{name}" for name in ("latitude_deg", "longitude_deg", "height_m")]
        a, b = one[names].dropna().to_numpy(), other[names].dropna().to_numpy()
        same = (b[1:] == b[:-1]).all(1)
        assert abs(same.mean() - 0.2) < 4.5 * np.sqrt(2 * 0.2 * 0.8 * 3.0 * 0.8 / 1800)
        np.testing.assert_array_equal(b[1:][~same], a[1:][~same])
        assert not (a[1:] == a[:-1]).any()


def test_outages_leave_nothing_and_change_nothing_else(voyage):
    """Law: NaN in the stated windows for all antennas, course and height too; what is left is what it was."""
    kwargs = {"course_hz": 1.0}
    gnss = Gnss(height_m=0.5, outages_s=((100.0, 130.0), (400.0, 400.5)))
    one = measure(voyage, VESSEL, ZONE, Sensors(gnss=Gnss(height_m=0.5), **kwargs), np.random.default_rng(2))
    two = measure(voyage, VESSEL, ZONE, Sensors(gnss=gnss, **kwargs), np.random.default_rng(2))
    t = one["time_s"]
    out = ((t > 99.95) & (t < 130.05)) | ((t > 399.95) & (t < 400.55))
    assert out.sum() == 301 + 6
    told = [c for c in one if c.startswith(("bow", "stern")) or "ground" in c]
    assert len(told) == 8
    assert two.loc[out, told].isna().all(axis=None)
    np.testing.assert_array_equal(two.loc[~out], one.loc[~out])
    np.testing.assert_array_equal(two.drop(columns=told), one.drop(columns=told))
    share = measure(voyage, VESSEL, ZONE, Sensors(gnss=Gnss(outage_share=0.2, outage_s=10)), np.random.default_rng(2))
    missing = [share[f"{a}_latitude_deg"].isna() for a in ("bow", "stern")]
    assert not missing[0].equals(missing[1])
    for one_missing in missing:
        assert abs(one_missing.mean() - 0.2) < 4.5 * np.sqrt(2 * 0.2 * 0.8 * 10 * 0.8 / 1800)


def test_one_fault_moves_no_other():
    """Law: each kind of error has a stream of its own; with one of them switched off the others are the same numbers."""
    time = np.arange(6001) * 0.1
    kinds = {
        "wander_m": 4.7, "spike_share": 0.02, "jump_share": 0.1, "frozen_share": 0.1, "outage_share": 0.1,
        "height_wander_m": 2.0,
    }  # fmt: skip
    for common in (True, False):
        every = receivers(Gnss(wander_common=common, **kinds), time, 2, np.random.default_rng(9))
        parts = {
            k: receivers(Gnss(wander_common=common, **{k: kinds[k]}), time, 2, np.random.default_rng(9)) for k in kinds
        }
        for antenna in range(2):
            total = sum(parts[kind][antenna].offset for kind in kinds)
            np.testing.assert_allclose(every[antenna].offset, total, atol=1e-9)
            np.testing.assert_array_equal(every[antenna].frozen, parts["frozen_share"][antenna].frozen)
            np.testing.assert_array_equal(every[antenna].out, parts["outage_share"][antenna].out)
            assert every[antenna].frozen.any() and every[antenna].out.any()


@pytest.mark.parametrize("delay", [0.5, 0.23])
def test_latency_tells_the_state_before(voyage, delay):
    """Oracle: the fixes of the prompt log `delay` earlier, interpolated (0.1 s x 0.1 s x 0.01 m/s2 / 8 is nothing); none before."""
    prompt = measure(voyage, VESSEL, ZONE, Sensors(**QUIET), np.random.default_rng(0))
    late = measure(voyage, VESSEL, ZONE, Sensors(position_delay_s=delay, **QUIET), np.random.default_rng(0))
    t = prompt["time_s"].to_numpy()
    for antenna in ("bow", "stern"):
        place, told = grid(prompt, antenna), grid(late, antenna)
        np.testing.assert_array_equal(np.isnan(told), t < delay - 1e-9)
        known = ~np.isnan(told)
        np.testing.assert_allclose(told[known], np.interp(t[known] - delay, t, place), atol=1e-5)
        assert np.abs(told[known] - place[known]).min() > 1.0
    np.testing.assert_array_equal(late["heading_deg"], prompt["heading_deg"])


def test_height_and_place_of_an_antenna_on_a_tilted_ship():
    """Oracle: rotation of the lever arm by scipy, angles about z, y and x in turn; height is that of the sea less what is down."""
    from dataclasses import replace

    from scipy.spatial.transform import Rotation

    voyage = made(
        PLACE, 60.0, roll=((0.2, 0.8, 0.0),), pitch=((0.05, 1.1, 0.3), (0.0, 0, 0.02)), heave=((1.2, 0.7, 0.1),)
    )
    vessel = replace(VESSEL, heights={"mast": 22.0})
    sensors = Sensors(antennas=("bow", "mast"), gnss=Gnss(height_m=0.0, sea_level_m=31.5), **QUIET)
    table = measure(voyage, vessel, ZONE, sensors, np.random.default_rng(0))
    turns = Rotation.from_euler("ZYX", np.stack([voyage.heading, voyage.pitch, voyage.roll], axis=-1))
    for antenna, arm in (("bow", [35.0, 0.0, 0.0]), ("mast", [12.0, 3.6, -22.0])):
        north, east, down = turns.apply(arm).T
        np.testing.assert_allclose(table[f"{antenna}_height_m"], 31.5 - voyage.heave - down, atol=1e-9)
        place = (voyage.north + north) + 1j * (voyage.east + east)
        np.testing.assert_allclose(grid(table, antenna), place, atol=1e-6)
    # by hand: starboard down lowers an antenna to starboard, bow up lifts the bow
    flat = made(PLACE, 10.0, roll=((0.0, 0, 0.1),))
    low = measure(flat, vessel, ZONE, sensors, np.random.default_rng(0))["mast_height_m"][0] - 31.5
    assert low == pytest.approx(22 * np.cos(0.1) - 3.6 * np.sin(0.1))


def test_course_and_speed_are_those_of_the_first_antenna(voyage):
    """Oracle: the velocity of midship plus r times the arm (E6), as a bearing from true north; white noise in its two components."""
    exact = measure(
        voyage, VESSEL, ZONE, Sensors(antennas=("mast",), course_hz=10, course_m_s=0, **QUIET), np.random.default_rng(0)
    )
    x, y = VESSEL.stations["mast"]
    u, v = voyage.surge - voyage.yaw_rate * y, voyage.sway + voyage.yaw_rate * x
    np.testing.assert_allclose(exact["speed_over_ground_m_s"], np.hypot(u, v), atol=2e-4)
    heading = np.radians(exact["heading_deg"])
    drift = np.angle(np.exp(1j * (np.radians(exact["course_over_ground_deg"]) - heading)))
    np.testing.assert_allclose(drift, np.arctan2(v, u), atol=2e-5)
    noisy = measure(
        voyage, VESSEL, ZONE, Sensors(antennas=("mast",), course_hz=10, course_m_s=0.05), np.random.default_rng(0)
    )

    def velocity(table):
        return table["speed_over_ground_m_s"].to_numpy() * np.exp(
            1j * np.radians(table["course_over_ground_deg"].to_numpy())
        )

    error = velocity(noisy) - velocity(exact)
    n = 2 * len(error)
    assert abs(np.mean(np.abs(error) ** 2) / (2 * 0.05**2) - 1) < 4.5 * np.sqrt(2 / n)
