"""Wind loads against the closed formulas of their methods, laws of symmetry, and gusts against their spectrum."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aspnn.schema import InputError
from aspnn.simulation.environment.wind import (
    AIR_DENSITY,
    FASTEST_GUST,
    SLOWEST_GUST,
    Air,
    gust_series,
    gust_spectrum,
    wind_load,
)
from aspnn.vessel import load_vessel

PROFILE = {"A_F": 160.0, "A_L": 480.0, "A_SS": 180.0, "S": 130.0, "C": 47.0, "M": 2.0}


def cargo(wind=None):
    vessel = load_vessel("cargo90")
    return vessel if wind is None else replace(vessel, simulator={"wind": wind})


def apparent(speed, degrees):
    """The ship's motion through the air that has the wind `degrees` off the starboard bow."""
    return speed * math.cos(math.radians(degrees)), speed * math.sin(math.radians(degrees))


@pytest.mark.parametrize("degrees", [0, 7.3, 30, 44.9, 60.2, 89.7, 90, 91.1, 120, 137.7, 172, 180])
def test_blendermann(degrees):
    """Oracle: Blendermann's (1994) formulas for cargo90 written out; the table between half degrees errs by at most 1e-3 of the
    greatest coefficient ((pi / 360)^2 / 8 times a curvature of about 4, and twice that at the beam's kink).
    """
    A_F, A_L, CDt, delta, s_L, L = 160.0, 480.0, 0.85, 0.4, -4.0, 90.0
    g = math.radians(degrees)
    CDl = 0.65 if degrees < 90 else 0.55
    D = 1 - delta / 2 * (1 - CDl * A_F / (CDt * A_L)) * math.sin(2 * g) ** 2
    q = AIR_DENSITY / 2 * 14.0**2
    X, Y = -q * A_F * CDl * math.cos(g) / D, -q * A_L * CDt * math.sin(g) / D
    N = Y * (s_L - 0.18 * (g - math.pi / 2) * L)
    load = wind_load(Air.of(cargo()), *apparent(14.0, degrees))
    scale = q * np.array([A_F * 0.65, A_L * 0.85, A_L * L * 0.85 * 0.2])
    np.testing.assert_allclose(load / scale, np.array([X, Y, N]) / scale, atol=1e-3)


@pytest.mark.parametrize(
    "degrees, A, B, C",
    [
        (
            30,
            (1.965, -4.81, 0.243, -0.154, 0, 0, 0.041),
            (0.225, 1.38, 0, 0.023, 0, -0.29, 0),
            (0.2258, 0.245, 0, 0, 0, -0.38),
        ),
        (90, (0.355, 0, 0, 0, -0.247, 0, 0.018), (0.889, 0, 0.138, 0, 0, -0.66, 0), (0.2627, 0, 0, 0, 0, -0.508)),
        (
            140,
            (-0.677, 3.64, 0, 0.069, -0.529, 0, -0.032),
            (0.784, 0, 0.166, 0, -0.209, -0.53, 0.38),
            (0.0256, 0, -0.0422, 0.01, 0.0889, -0.463),
        ),
    ],
)
def test_isherwood(degrees, A, B, C):
    """Oracle: rows of Isherwood's (1973) tables, typed from a second public copy, and his regression written out; wind to port."""
    L, width, q = 90.0, 14.0, AIR_DENSITY / 2 * 20.0**2
    shape = [1, 2 * 480 / L**2, 2 * 160 / width**2, L / width, 130 / L, 47 / L]
    load = wind_load(Air.of(cargo(PROFILE)), *apparent(20.0, degrees))
    assert load[0] == pytest.approx(-q * 160 * np.dot(A, [*shape, 2]), rel=1e-9)
    assert load[1] == pytest.approx(-q * 480 * np.dot(B, [*shape, 180 / 480]), rel=1e-9)
    assert load[2] == pytest.approx(-q * 480 * L * np.dot(C, shape), rel=1e-9)


def test_isherwood_agrees_with_blendermann_in_size():
    """Oracle: two independent methods for one ship agree within a factor of 1.5 in the greatest surge and sway force."""
    degrees = np.arange(0, 181, 5)
    one = np.array([wind_load(Air.of(cargo()), *apparent(15.0, d)) for d in degrees])
    two = np.array([wind_load(Air.of(cargo(PROFILE)), *apparent(15.0, d)) for d in degrees])
    ratio = np.abs(one).max(axis=0) / np.abs(two).max(axis=0)
    assert np.all((ratio[:2] > 1 / 1.5) & (ratio[:2] < 1.5))


@pytest.mark.parametrize("wind", [None, PROFILE], ids=["blendermann", "isherwood"])
def test_symmetries(wind):
    """Laws: port mirrors starboard, the load goes with the square of the speed, still air and a vessel without section take none."""
    air = Air.of(cargo(wind))
    for u, v in ((7.0, 3.0), (-2.0, 9.0), (-5.0, 0.0), (0.0, 4.0)):
        X, Y, N = wind_load(air, u, v)
        assert wind_load(air, u, -v) == (X, -Y, -N)
        np.testing.assert_allclose(wind_load(air, 3 * u, 3 * v), (9 * X, 9 * Y, 9 * N), rtol=1e-12)
        assert Y * v <= 0
    assert wind_load(air, 5.0, 0.0)[0] < 0 < wind_load(air, -5.0, 0.0)[0]
    assert wind_load(air, 0.0, 0.0) == (0, 0, 0)
    assert wind_load(Air.of(replace(cargo(), simulator={})), 5.0, 3.0) == (0, 0, 0)


@pytest.mark.parametrize(
    "wind, told",
    [
        (PROFILE | {"C": -3.0}, "wind.C = -3"),
        (PROFILE | {"perimeter": 130.0}, "wind.perimeter is not known"),
        ({k: v for k, v in PROFILE.items() if k != "S"}, "wind.S is missing"),
        ({"A_F": 160.0, "A_L": 480.0}, "wind.CDt is missing"),
        (load_vessel("cargo90").simulator["wind"] | {"s_L": 400.0}, "wind.s_L = 400"),
        (load_vessel("cargo90").simulator["wind"] | {"A_l": 400.0}, "did you mean A_L"),
    ],
)
def test_wrong_sections_are_told(wind, told):
    """Oracle: one line that names the vessel and the coefficient."""
    with pytest.raises(InputError, match=told) as error:
        Air.of(cargo(wind))
    assert "cargo90" in str(error.value) and "\n" not in str(error.value)


def test_gusts_have_their_spectrum():
    """Oracle: the Froya spectrum typed anew, averaged over bands. A record of length T holds about 2 (f2 - f1) T independent
    squares per band, 40 records of them give the band's mean a relative standard error sqrt(2 / that); 4.5 of those allowed,
    and 3 % for the leakage of a record's ends.
    """
    rng, mean, dt, steps = np.random.default_rng(3), 15.0, 0.5, 14400
    series = np.array([gust_series(rng, mean, 20.0, dt, steps) for _ in range(40)])
    frequency = np.fft.rfftfreq(steps, dt)
    window = np.hanning(steps)
    power = np.abs(np.fft.rfft((series - mean) * window, axis=1)) ** 2 * 2 * dt / np.sum(window**2)
    f = 172 * frequency * 2 ** (2 / 3) * 1.5**-0.75
    density = 320 * 1.5**2 * 2**0.45 / (1 + f**0.468) ** (5 / (3 * 0.468))
    for low, high in ((0.002, 0.005), (0.005, 0.01), (0.02, 0.05), (0.1, 0.2), (0.3, 0.45)):
        band = (frequency >= low) & (frequency < high)
        ratio = power[:, band].mean() / density[band].mean()
        assert abs(ratio - 1) < 0.03 + 4.5 * math.sqrt(2 / (2 * (high - low) * steps * dt * 40) * 2), (low, ratio)
    assert power[:, frequency > 0.52].max() < 1e-3 * density[-1]


def test_gusts_have_their_variance_and_mean():
    """Oracle: the integral of the spectrum from 1/2400 to 0.5 Hz. Over 1000 records, one value of each: the variance within 4.5
    sqrt(2 / n), the mean within 4.5 sigma / sqrt(n). Still air has no gusts, and seeds repeat.
    """
    rng, mean = np.random.default_rng(4), 12.0
    values = np.array([gust_series(rng, mean, 10.0, 1.0, 3)[1] for _ in range(1000)])
    grid = np.linspace(SLOWEST_GUST, FASTEST_GUST, 200_001)
    variance = np.trapezoid(gust_spectrum(grid, mean, 10.0), grid)
    assert values.var() == pytest.approx(variance, rel=4.5 * math.sqrt(2 / 1000))
    assert values.mean() == pytest.approx(mean, abs=4.5 * math.sqrt(variance / 1000))
    assert np.all(gust_series(rng, 0.0, 10.0, 0.1, 50) == 0)
    one, two = (gust_series(np.random.default_rng(9), mean, 10.0, 0.1, 50) for _ in range(2))
    assert np.array_equal(one, two)
