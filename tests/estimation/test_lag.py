"""The lag of one series against another: a synthetic swing shifted by a known time, and its standard error."""

import numpy as np
import pytest

from aspnn.estimation.lag import lag

REFERENCE_TIME = np.arange(0, 300, 0.05)


def swing(time):
    """A yaw rate [deg/s] of two periods that do not fit each other, so no other lag does as well."""
    return 1.5 * np.sin(2 * np.pi * time / 47) + np.sin(2 * np.pi * time / 19 + 0.4)


def noise(rng, samples: int, memory: float) -> np.ndarray:
    """First-order autoregression of unit variance whose neighbours are correlated by `memory`."""
    e = rng.standard_normal(samples)
    for k in range(1, samples):
        e[k] = memory * e[k - 1] + np.sqrt(1 - memory**2) * e[k]
    return e


@pytest.mark.parametrize("late", [-7.3, -0.4, 0.0, 0.12, 2.5, 9.1])
def test_a_known_lag_is_found(late):
    """Analytic: the series is the reference, shifted, damped and offset, at times of its own; only interpolation errs."""
    time = np.arange(0.013, 300, 0.1)
    found, error = lag(time, 0.4 * swing(time - late) + 3.0, REFERENCE_TIME, swing(REFERENCE_TIME))
    assert found == pytest.approx(late, abs=1e-3)
    assert error < 1e-3


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_the_standard_error_is_that_of_repetitions(memory):
    """Statistic: (found - true) / error over 100 repetitions has mean 0 and deviation 1, for white and for coloured noise.

    Tolerances are three standard deviations: of the mean 1 / sqrt(100), of the deviation 1 / sqrt(200); coloured noise has
    10 % more, since Bartlett weights leave out what is correlated beyond the bandwidth.
    """
    rng, late = np.random.default_rng(5), 1.7
    time = np.arange(0, 300, 0.2)
    scores = []
    for _ in range(100):
        values = 0.8 * swing(time - late) + 0.3 * noise(rng, len(time), memory)
        found, error = lag(time, values, REFERENCE_TIME, swing(REFERENCE_TIME), longest=5.0)
        scores.append((found - late) / error)
    assert abs(np.mean(scores)) < 3 / np.sqrt(100)
    assert abs(np.std(scores) - 1) < 3 / np.sqrt(200) + (0.1 if memory else 0.0)


def test_gaps_are_passed_over():
    """By construction: samples that are NaN, or wrong and marked NaN, change nothing but the error."""
    time = np.arange(0, 300, 0.1)
    values = swing(time - 3.0)
    values[500:900], values[::7] = np.nan, np.nan
    reference = swing(REFERENCE_TIME)
    reference[::11] = np.nan
    assert lag(time, values, REFERENCE_TIME, reference)[0] == pytest.approx(3.0, abs=2e-3)


def test_what_cannot_be_told_is_said():
    """Contract: (nan, inf) for no movement, no likeness, a lag beyond the longest, and a short series."""
    time, reference = np.arange(0, 300, 0.1), swing(REFERENCE_TIME)
    slow = np.sin(2 * np.pi * REFERENCE_TIME / 150)
    cases = [
        (time, 0 * time, REFERENCE_TIME, reference),
        (time, swing(time), REFERENCE_TIME, 0 * reference),
        (time, np.sin(2 * np.pi * (time - 30) / 150), REFERENCE_TIME, slow),
        (time[:180], swing(time[:180]), REFERENCE_TIME, reference),
        (time, np.full(len(time), np.nan), REFERENCE_TIME, reference),
        (time, swing(time), REFERENCE_TIME[:20], reference[:20]),
    ]
    for case in cases:
        found, error = lag(*case)
        assert np.isnan(found) and error == np.inf
