"""Oracles: analytic errors of shifted and turned paths; the coverage of the bootstrap by its own statistics."""

import math

import numpy as np
import pytest

from aspnn.evaluation.errors import bootstrap_medians, paired_ratios, path_errors, summary
from aspnn.motion import Path


def straight(heading, sway=0.0, north=0.0, east=0.0, turned=0.0) -> Path:
    time = np.arange(4.0)
    zero = np.zeros((1, 4))
    c, s = math.cos(heading), math.sin(heading)
    return Path(
        time, north + time * (6 * c - sway * s) + zero, east + time * (6 * s + sway * c) + zero, heading + turned + zero,
        6.0 + zero, sway + zero, zero, np.nan + zero,
    )  # fmt: skip


@pytest.mark.parametrize("heading", [0.0, 0.7, 3.1, -2.0])
@pytest.mark.parametrize("drift", [0.0, 0.3])
def test_shift_along_and_across_the_course(heading, drift):
    """A path moved 3 m ahead and 4 m to starboard of the reference course is 5 m off."""
    course = heading + drift
    sway = 6 * math.tan(drift)
    shift = (3 + 4j) * np.exp(1j * course)
    errors = path_errors(straight(heading, sway, shift.real, shift.imag), straight(heading, sway))
    np.testing.assert_allclose(errors.position, 5.0, rtol=1e-12)
    np.testing.assert_allclose(errors.along, 3.0, rtol=1e-12)
    np.testing.assert_allclose(errors.cross, 4.0, rtol=1e-12)
    np.testing.assert_allclose(errors.heading, 0.0, atol=1e-12)


@pytest.mark.parametrize(("turned", "error"), [(0.1, 0.1), (-0.1, -0.1), (3.5, 3.5 - 2 * math.pi), (2 * math.pi, 0.0)])
def test_heading_error_is_the_smallest_signed_angle(turned, error):
    errors = path_errors(straight(3.0, turned=turned), straight(3.0))
    np.testing.assert_allclose(errors.heading, error, atol=1e-12)


def test_summary_by_hand():
    """0 to 100 m: median 50, p95 95, mean 50; headings -2, -1 and +4 deg: median abs 2, signed -1."""
    place = summary(np.arange(101.0), np.zeros(101))["position_m"]
    assert place == pytest.approx({"median": 50, "p95": 95, "mean": 50})
    turn = summary(np.zeros(3), np.radians([-2.0, -1.0, 4.0]))["heading_deg"]
    assert turn == pytest.approx({"median_abs": 2.0, "p95_abs": 3.8, "median_signed": -1.0})


def test_bootstrap_draws_whole_voyages():
    """Windows of one voyage that are all alike: every drawn median is one of the voyages' values (or their midpoint)."""
    values, voyage = np.repeat([1.0, 2.0, 5.0], 7)[:, None], np.repeat([0, 1, 2], 7)
    drawn = bootstrap_medians(values, voyage, seed=1, draws=200)
    assert set(np.unique(drawn)) == {1.0, 2.0, 5.0}
    np.testing.assert_array_equal(drawn, bootstrap_medians(values, voyage, seed=1, draws=200))


def test_paired_ratio_of_proportional_errors_is_exact():
    """If one error is always half the other, so is every drawn ratio: pairing removes what the windows share."""
    rng = np.random.default_rng(0)
    error = rng.gamma(2.0, size=60)
    ratio, own = paired_ratios(np.stack([error / 2, error], axis=-1), 1, np.repeat(np.arange(6), 10), seed=0)
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((0.5, 0.5, 0.5))
    assert own.value == 1.0


def test_interval_covers_the_ratio():
    """Statistic: 200 data sets of 30 voyages, true ratio of medians 0.5. A 95 % interval, binomial 4 sd (0.015 each) and up
    to 0.04 short, as percentile intervals are with 30 clusters: coverage 0.85 to 1. Drawing windows would give 0.55."""
    rng = np.random.default_rng(3)
    voyage = np.repeat(np.arange(30), 8)
    hits = 0
    for _ in range(200):
        # A voyage makes all its errors large or small: exp of a normal, whose median is 1.
        ours, theirs = (np.exp(np.repeat(rng.normal(size=30), 8) + 0.3 * rng.normal(size=240)) for _ in range(2))
        ratio = paired_ratios(np.stack([0.5 * ours, theirs], axis=-1), 1, voyage, seed=0, draws=200)[0]
        hits += ratio.low <= 0.5 <= ratio.high
    assert 0.85 <= hits / 200 <= 1.0
