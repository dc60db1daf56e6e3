"""Probability of contact against closed forms and a brute Monte Carlo of real outlines."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
import shapely

from aspnn.live.contact import contact_probability
from aspnn.live.share import gaussian
from aspnn.motion import Path, integrate
from aspnn.vessel import load_vessel

PLACE = np.array([7.72e6, 6.5e5])
HULL = load_vessel("cargo90").outline()
SMALL = HULL * [0.5, 0.6]


def box(length: float, beam: float) -> np.ndarray:
    return np.array([[1, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]]) * [length / 2, beam / 2]


def run(north, east, heading, velocity, sds=(3.0, 0.15, 0.0), steps=90, dt=1.0) -> Path:
    """A path whose errors are sds[0] + sds[1] t [m] to all sides, with a standard deviation sds[2] [rad] of the heading."""
    path = integrate((PLACE[0] + north, PLACE[1] + east, heading), np.tile(velocity, (steps, 1)), dt)
    covariance = np.zeros((steps + 1, 3, 3))
    covariance[:, 0, 0] = covariance[:, 1, 1] = (sds[0] + sds[1] * path.time) ** 2
    covariance[:, 2, 2] = sds[2] ** 2
    return replace(path, spread=gaussian(covariance))


def many(path: Path) -> Path:
    names = ("north", "east", "heading", "surge", "sway", "yaw_rate", "pivot")
    spread = gaussian(path.spread.covariance[None])
    return replace(path, spread=spread, **{name: getattr(path, name)[None] for name in names})


@pytest.mark.parametrize("side, turned", [(40.0, 0.0), (80.0, 0.9), (20.0, -2.0)])
def test_passing_abeam(side, turned):
    """Closed form: of two boxes that run far past each other on opposite courses with a constant spread s, only the offset across
    counts: P = Phi((w - d) / s) - Phi((-w - d) / s), with w half of both beams, d the distance of the tracks."""
    c, s = math.cos(turned), math.sin(turned)
    own = run(0, 0, turned, (6, 0, 0), (12.0, 0.0, 0.0))
    other = run(500 * c - side * s, 500 * s + side * c, turned + math.pi, (6, 0, 0), (16.0, 0.0, 0.0))
    w, normal = (20 + 10) / 2, NormalDist(side, 20.0)
    expected = normal.cdf(w) - normal.cdf(-w)
    found = contact_probability(own, box(100, 20), many(other), box(60, 10)[None])
    np.testing.assert_allclose(found, expected, rtol=0.01)


def test_boats_faster_than_their_length():
    """Closed form, as above, of two boats of 2 m that pass at 20 m/s: nothing is lost between the instants 40 m apart."""
    own, other = run(0, 0, 0, (10, 0, 0), (3, 0, 0)), run(900, 0, math.pi, (10, 0, 0), (4, 0, 0))
    expected = 2 * NormalDist(0, 5).cdf(2) - 1
    np.testing.assert_allclose(contact_probability(own, box(2, 2), many(other), box(2, 2)[None]), expected, rtol=0.01)


def test_alongside():
    """Closed form: two boxes at rest, whose Minkowski difference is a box: P is the product of two intervals of a Gaussian."""
    own, other = run(0, 0, 0, (0, 0, 0), (6, 0, 0)), run(30, 20, 0, (0, 0, 0), (8, 0, 0))
    north, east = NormalDist(30, 10), NormalDist(20, 10)
    expected = (north.cdf(30) - north.cdf(-30)) * (east.cdf(9) - east.cdf(-9))
    np.testing.assert_allclose(
        contact_probability(own, box(40, 12), many(other), box(20, 6)[None]), expected, rtol=0.01
    )


@pytest.mark.parametrize("seed", range(4))
def test_against_brute_force(seed):
    """Monte Carlo of the same model with shapely's polygons: 2000 z and headings, outlines at every second. The share has a
    standard deviation of 0.011 at most; looking at seconds only misses what the sets between them hold, some thousandths."""
    rng = np.random.default_rng(seed)
    own = run(0, 0, 0.4, (6, 0.4, 0.01), (2.0, 0.25, 0.04))
    meet = own.at(50.0)
    heading, speed, rate = rng.uniform(-3, 3), rng.uniform(2, 7), rng.uniform(-0.01, 0.01)
    back = integrate((0.0, 0.0, 0.0), np.tile([speed, 0.0, rate], (50, 1)), 1.0)
    start = (meet.north + 1j * meet.east)[0] - (back.north + 1j * back.east)[-1] * np.exp(1j * heading)
    start += (rng.normal() + 1j * rng.normal()) * 20 - (PLACE[0] + 1j * PLACE[1])
    other = run(start.real, start.imag, heading, (speed, 0, rate), (4.0, 0.3, 0.06))
    found = contact_probability(own, HULL, many(other), SMALL[None])[0]
    assert 0.05 < found < 1
    draws = 2000
    z, off = rng.normal(size=(draws, 2)), rng.normal(size=(draws, 2)) * [0.04, 0.06]
    touched = np.zeros(draws, bool)
    sd = np.sqrt(own.spread.covariance[:, 0, 0] + other.spread.covariance[:, 0, 0])
    for k in range(91):

        def hulls(path, outline, turn, shift, k=k):
            corners = np.exp(1j * (path.heading[k] + turn))[:, None] * (outline @ np.array([1, 1j])) + shift
            return shapely.polygons(np.stack([corners.real, corners.imag], axis=-1))

        apart = (other.north - own.north + 1j * (other.east - own.east))[k] + sd[k] * (z @ np.array([1, 1j]))
        if np.abs(apart).min() < 75:
            near = (np.abs(apart) < 75) & ~touched
            a, b = hulls(own, HULL, off[near, 0], 0.0), hulls(other, SMALL, off[near, 1], apart[near, None])
            touched[near] = shapely.intersects(a, b)
    share = touched.mean()
    assert found == pytest.approx(share, abs=3.5 * math.sqrt(share * (1 - share) / draws) + 0.01)


def test_laws():
    """Laws: the mirror image and the exchange of the ships leave it; touching now is 1 without doubt; far off is 0; without regions it
    is unknown; and it never falls with the horizon."""
    own = run(0, 0, 0.3, (6, 0.3, 0.01), (2, 0.2, 0.03))
    other = run(330, 250, -2.4, (5, -0.2, -0.008), (5, 0.2, 0.02))
    there = contact_probability(own, HULL, many(other), SMALL[None])[0]
    back = contact_probability(other, SMALL, many(own), HULL[None])[0]
    assert 0.01 < there < 0.99 and back == pytest.approx(there, rel=0.02)
    image = run(0, 0, -0.3, (6, -0.3, -0.01), (2, 0.2, 0.03)), run(330, -250, 2.4, (5, 0.2, 0.008), (5, 0.2, 0.02))
    assert contact_probability(image[0], HULL, many(image[1]), SMALL[None])[0] == pytest.approx(there, rel=0.01)
    on_top = run(0, 5, 1.0, (6, 0, 0), (0.1, 0, 0))
    assert contact_probability(replace(own, spread=on_top.spread), HULL, many(on_top), SMALL[None])[0] == pytest.approx(
        1
    )
    assert contact_probability(own, HULL, many(run(9000, 0, 0, (5, 0, 0))), SMALL[None])[0] == 0
    assert math.isnan(contact_probability(replace(own, spread=None), HULL, many(other), SMALL[None])[0])
    shares = []
    for steps in (20, 40, 60, 90):
        cut = [
            run(0, 0, 0.3, (6, 0.3, 0.01), (2, 0.2, 0.03), steps),
            run(330, 250, -2.4, (5, -0.2, -0.008), (5, 0.2, 0.02), steps),
        ]
        shares.append(contact_probability(cut[0], HULL, many(cut[1]), SMALL[None])[0])
    assert (np.diff(shares) >= -1e-9).all()


def test_heading_errors_count():
    """Law: a boat 40 m ahead and 12 m aside of a narrow hull of 100 m is clear of it, but not of one that may point there."""
    other = many(run(40, 12, 0, (0, 0, 0), (1, 0, 0)))
    sure, unsure = (run(0, 0, 0, (0, 0, 0), (1, 0, sd)) for sd in (0.0, 0.2))
    assert contact_probability(sure, box(100, 2), other, box(1, 1)[None])[0] < 1e-6
    assert 0.02 < contact_probability(unsure, box(100, 2), other, box(1, 1)[None])[0] < 0.5


def test_unknown_at_some_step():
    """Law: a spread that is not known somewhere within the horizon tells no probability."""
    own, other = run(0, 0, 0, (5, 0, 0)), run(300, 0, math.pi, (5, 0, 0))
    covariance = other.spread.covariance.copy()
    covariance[-1] = np.nan
    assert math.isnan(contact_probability(own, HULL, many(replace(other, spread=gaussian(covariance))), SMALL[None])[0])
