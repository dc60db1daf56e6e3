"""The wake of a passing ship: against Kelvin's pattern, the dispersion of deep water and Airy's decay."""

import math

import numpy as np
import pytest

from aspnn.simulation.environment.wake import CUSP, WEDGE, repeats, wake_delay, wake_period, wake_waves
from aspnn.simulation.environment.waves import GRAVITY, elevation

COURSE, PLACE, TIME = 0.4, (100.0, 50.0), 30.0


def seen(waves, ahead, aside, time):
    """Elevation where lies `ahead` along the track and `aside` to starboard of it, from PLACE."""
    north = PLACE[0] + ahead * math.cos(COURSE) - aside * math.sin(COURSE)
    east = PLACE[1] + ahead * math.sin(COURSE) + aside * math.cos(COURSE)
    return elevation(waves, np.array(north), np.array(east), time)


def envelope(level, period, step):
    """Root of the mean square over a period."""
    n = max(round(period / step), 1)
    return np.sqrt(np.convolve(level**2, np.ones(n) / n, "same"))


def test_the_cusp_is_kelvins():
    """Oracle: the published angles, 19 deg 28 min = asin(1/3) and 35 deg 16 min, and the period 2 pi U sqrt(2/3) / g; the angle of the
    energy's way, tan theta / (1 + 2 tan^2 theta), is greatest there."""
    assert math.sin(WEDGE) == pytest.approx(1 / 3) and math.degrees(CUSP) == pytest.approx(35.264, abs=1e-3)
    theta = np.linspace(0.0, 1.5, 100_001)
    alpha = np.arctan(np.tan(theta) / (1 + 2 * np.tan(theta) ** 2))
    assert alpha.max() == pytest.approx(WEDGE) and theta[alpha.argmax()] == pytest.approx(CUSP, abs=1e-4)
    assert wake_period(6.0) == pytest.approx(2 * math.pi * 6.0 * math.sqrt(2 / 3) / 9.81)
    assert wake_delay(6.0, 60.0) == pytest.approx(2 * math.sqrt(2) * 10.0)


@pytest.mark.parametrize("side", [1, -1])
def test_the_pattern_stands_still_for_the_ship(side):
    """Law: every component keeps omega^2 = g k and, along her track, the ship's speed; so the water about her, as she goes, is as it was."""
    waves = wake_waves(6.5, COURSE, PLACE, TIME, 0.4, side * 60.0)
    _, k, towards, omega, _ = waves.T
    np.testing.assert_allclose(omega**2, GRAVITY * k, rtol=1e-12)
    np.testing.assert_allclose(omega / k, 6.5 * np.cos(towards - COURSE), rtol=1e-12)
    assert (np.sign(towards - COURSE) == side).all()
    behind = np.linspace(-400, 0, 50)
    now = [seen(waves, x, side * 60.0, TIME) for x in behind]
    later = [seen(waves, x + 6.5 * 77.0, side * 60.0, TIME + 77.0) for x in behind]
    np.testing.assert_allclose(now, later, atol=1e-9)


@pytest.mark.parametrize(("ahead", "aside", "speed"), [(0, 60, 6.5), (300, 60, 6.5), (0, 150, 6.5), (-200, 40, 9.0)])
def test_it_arrives_when_the_cusp_does(ahead, aside, speed):
    """Oracle: the cusp line at 19.47 degrees behind the ship passes; the train is the highest within a period of that, its crests follow
    each other in the cusp's period, it is over within ten periods and has the height asked for at its distance."""
    waves, period = wake_waves(speed, COURSE, PLACE, TIME, 0.4, float(aside)), wake_period(speed)
    passes = TIME + ahead / speed + aside / (speed * math.tan(math.asin(1 / 3)))
    time = np.arange(passes - 100, passes + 100, 0.02)
    level = seen(waves, ahead, aside, time)
    high = envelope(level, period, 0.02)
    assert abs(time[high.argmax()] - passes) < period
    assert np.ptp(level) == pytest.approx(0.4, rel=2e-3)
    assert high[np.abs(time - passes) > 10 * period].max() < 0.03 * high.max()
    near = np.abs(time - passes) < 1.5 * period
    up = time[near][:-1][(level[near][:-1] < 0) & (level[near][1:] >= 0)]
    assert np.diff(up).mean() == pytest.approx(period, rel=0.05)


def test_it_grows_longer_and_lower():
    """Oracle: Airy's law at a caustic: eight times the distance is half the height, from 8 to 64 km within 6 % and nearing it; the
    energy that passes a place per metre of crest falls more slowly, since the train grows longer."""
    waves, speed = wake_waves(6.5, COURSE, PLACE, TIME, 1.0, 60.0, count=4096), 6.5
    heights = []
    for aside in (1000.0, 8000.0, 64000.0):
        time = TIME + wake_delay(speed, aside) + np.arange(-150, 150, 0.3)
        heights.append(np.ptp(seen(waves, 0.0, aside, time)))
    first, second = heights[1] / heights[0], heights[2] / heights[1]
    assert 0.5 < second < first < 0.7 and second == pytest.approx(0.5, rel=0.06)


def test_it_comes_again_as_a_following_ship():
    """Law: even frequencies repeat themselves; not before."""
    waves, again = wake_waves(6.5, COURSE, PLACE, TIME, 0.4, 60.0, count=64), repeats(6.5, 64)
    time = np.linspace(TIME, TIME + 120, 400)
    np.testing.assert_allclose(seen(waves, 0, 60, time), seen(waves, 0, 60, time + again), atol=1e-9)
    middle = seen(waves, 0, 60, TIME + np.linspace(100, again - 20, 4000))
    assert np.abs(middle).max() < 0.02 * 0.4
