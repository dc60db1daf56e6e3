"""Screening of measurements: frozen fixes, stuck sensors, resolutions and grid convergence, from the past alone."""

import numpy as np
import pytest

from aspnn.estimation import screening
from aspnn.estimation.measurements import carried, grid_convergence
from aspnn.frames import Zone, convergence

TIME = np.arange(100) / 10


def test_carried_holds_the_last_known_value():
    """Worked by hand: gaps take the last value, a leading gap what is given, nothing known stays unknown."""
    nan = np.nan
    np.testing.assert_array_equal(carried(np.array([nan, 2.0, nan, nan, 5.0, nan]), 1.0), [1, 2, 2, 2, 5, 5])
    assert np.isnan(carried(np.array([nan, nan]))).all()


def repeated(time, fixes, threshold, columns=None):
    """Frozen fixes, on the grid that the columns (the fixes themselves unless given) have shown."""
    run = screening.runs(time, fixes)
    grids = [screening.resolution(c)[0] for c in (fixes.T if columns is None else columns)]
    step = np.column_stack(grids) * (1.0 if columns is None else METRES)
    return screening.frozen(time - time[run[0]], run, step, threshold)


def test_repeats_are_stale_only_if_the_ship_moved():
    """Worked by hand: a fix held for 1 s at 2 m/s is stale but for its first; below the threshold speed it is not."""
    fixes = np.column_stack([2.0 * TIME + 1 / 3, 0 * TIME])
    fixes[40:50] = fixes[40]
    expected = np.zeros(100, bool)
    expected[41:50] = True
    np.testing.assert_array_equal(repeated(TIME, fixes, 0.3), expected)
    assert not repeated(TIME, fixes, 3.0).any()
    with_gaps = fixes.copy()
    with_gaps[44] = np.nan
    expected[44] = False
    np.testing.assert_array_equal(repeated(TIME, with_gaps, 0.3), expected)
    assert not repeated(TIME, fixes[:, ::-1] * 0, 0.3).any()  # never moved
    long = np.vstack([fixes[:40], np.tile(fixes[40], (60, 1))])
    assert repeated(TIME, long, 0.3)[41:].all()  # frozen for good


METRES = np.radians(1.0) * 6371e3 * np.array([1.0, 0.5])  # per deg of latitude and longitude at 60 N


def recorded(rng, rate, speed, noise, step):
    """Four minutes of fixes at 60 N at `rate` [Hz] of a ship on a winding way, rounded to `step` [deg]: time, fixes, columns."""
    time = np.arange(int(240 * rate)) / rate
    course = rng.uniform(0, 2 * np.pi) + 0.8 * np.sin(time / 40)
    way = np.cumsum(speed / rate * np.stack([np.cos(course), np.sin(course)]), axis=1) + noise * rng.standard_normal(
        (2, len(time))
    )
    columns = np.array([[60.0], [10.0]]) + way / METRES[:, None]
    columns = np.round(columns / step) * step
    return time, columns


@pytest.mark.parametrize("speed", [0.0, 0.3, 1.0, 2.0, 4.0, 8.0])
@pytest.mark.parametrize("step", [1e-5, 1e-6, 1e-7])
def test_coarse_fixes(step, speed):
    """Oracle: the way itself; no fresh fix is dropped, and of frozen ones, for 8 s each minute, all beyond `late` seconds are.

    `late`: two steps of the grid, 1.1 m per 1e-5 deg, at the ship's speed, and 1.5 s more. A ship slower than 0.3 m/s may lie still.
    """
    rng, late = np.random.default_rng(8), 1.5 + 4 * 1.1e5 * step / max(speed, 1e-9)
    for rate in (5.0, 10.0):
        for noise in (0.0, 0.02, 1.0):
            time, columns = recorded(rng, rate, speed, noise, step)
            assert repeated(time, (columns * METRES[:, None]).T, 0.3, columns).sum() <= 1e-3 * len(time)
            held = np.zeros(len(time), bool)
            for begin in range(30, 240, 60):
                rows = slice(int(begin * rate), int((begin + 8) * rate))
                columns[:, rows] = columns[:, rows.start, None]
                held |= (time > begin + late) & (time < begin + 8)
            found = repeated(time, (columns * METRES[:, None]).T, 0.3, columns)
            assert found[held].all() or speed <= 0.3


@pytest.mark.parametrize(
    "what, period, noise, step, sticks",
    [
        ("heading", 360.0, 0.5, 0.0, True),
        ("heading", 360.0, 0.5, 0.1, True),
        ("heading", 360.0, 0.05, 0.0, True),
        ("heading", 360.0, 0.0, 0.1, False),
        ("heading", 360.0, 0.02, 0.1, False),
        ("heading", 360.0, 0.1, 1.0, False),
        ("yaw rate", 0.0, 0.01, 0.0, True),
        ("yaw rate", 0.0, 0.01, 0.1 / 60, True),
        ("yaw rate", 0.0, 0.0, 0.1 / 60, False),
        ("yaw rate", 0.0, 0.001, 1 / 60, False),
    ],
)
@pytest.mark.parametrize("rate", [5.0, 10.0])
def test_sensors_that_stick(what, period, noise, step, sticks, rate):
    """Law: runs of 8 s are found after 2 s where the noise is above the grid; a coarse sensor and a quicker recorder never stick."""
    rng, time = np.random.default_rng(9), np.arange(int(1200 * rate)) / rate
    turn = np.convolve(np.where(time // 60 % 2, 0.8, 0.0), np.ones(int(10 * rate)) / int(10 * rate), "same")  # deg/s
    values = np.cumsum(turn) / rate if what == "heading" else turn
    values = values + noise * rng.standard_normal(len(time))
    values = np.round(values / step) * step if step else values
    values = values % period if period else values

    def stuck(values):
        run = screening.runs(time, values[:, None], period)
        return screening.stuck(time - time[run[0]], run, screening.resolution(values)[0])

    assert not stuck(values).any()
    assert not stuck(values[np.arange(len(time)) // 10 * 10]).any()  # each value recorded ten times
    held, found = values.copy(), []
    for begin in range(45, 1180, 60):
        rows = slice(int(begin * rate), int((begin + 8) * rate))
        held[rows] = held[rows.start]
        found.append(slice(rows.start + int(2.5 * rate), rows.stop))
    late = np.array([stuck(held)[rows].all() for rows in found])
    assert late.mean() > 0.9 if sticks else not late.any()


@pytest.mark.parametrize("step", [1e-5, 1e-6, 1e-7, 1e-4 / 60, 0.1, 1.0, np.degrees(1e-4)])
def test_resolution(step):
    """Law: the grid that values lie on, in decimals of degrees, minutes or radians; in blocks as in one piece; 0 beyond."""
    values = np.round(np.random.default_rng(3).uniform(10, 80, 1000) / step) * step
    grid, shown = screening.resolution(values)
    assert grid[-1] == pytest.approx(step, rel=1e-9) and (np.diff(grid) <= 0).all()
    first, half = screening.resolution(values[:300])
    rest, end = screening.resolution(values[300:], half)
    np.testing.assert_array_equal(np.concatenate([first, rest]), grid)
    assert end == shown
    assert screening.resolution(np.random.default_rng(3).uniform(10, 80, 50))[0][-1] == 0


def test_resolution_of_single_precision():
    """Law: values of single precision are as coarse as its spacing: 7.6e-6 deg between 64 and 128."""
    values = np.random.default_rng(3).uniform(65, 80, 50).astype(np.float32).astype(float)
    assert screening.resolution(values)[0][-1] == 2.0**-17


def test_convergence_holds_for_a_second_and_ignores_a_wild_fix():
    """Oracle: convergence of the true position at each epoch; a fix at (0, 0) for half a second changes nothing."""
    latitude = np.radians(69.65) + 1e-6 * TIME
    longitude = np.radians(18.96) + 2e-6 * TIME
    zone = Zone.parse("33N")
    exact = convergence(latitude, longitude, zone)
    gamma, settled = grid_convergence(TIME, np.column_stack([latitude, longitude]), zone)
    np.testing.assert_allclose(gamma, exact, atol=1e-5)
    assert len(np.unique(gamma)) <= 10 and settled.shape == (4, 2)
    latitude[47:52], longitude[47:52] = 0.0, 0.0
    gamma, _ = grid_convergence(TIME, np.column_stack([latitude, longitude]), zone)
    np.testing.assert_allclose(gamma, exact, atol=1e-5)
