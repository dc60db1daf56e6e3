"""How an IMU is mounted: what gravity tells, which axes, the residual angles and how sure they are."""

from dataclasses import replace

import numpy as np
import pytest

from aspnn.estimation.mounting import align, coarse, mountings
from aspnn.estimation.spatial import filter_spatial
from aspnn.instruments import Mounting
from aspnn.schema import InputError
from tests.estimation.boats import Boat, Errors, boat_log

ANGLES = tuple(np.radians([1.2, -0.8, 1.7]))
YMIR = Mounting(("x", "-y", "-z"), ANGLES, -1.0)  # upside down, reads the reaction (thesis 3.44-3.46)
SLOPE = Boat(straight=True, roll=np.radians(6), pitch=np.radians(4))


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_angles_of_a_straight_run_that_changes_speed(seed):
    """Statistic: without biases all three angles lie within 4 of the standard errors that the fixes tell (yaw below 0.5 deg)."""
    log, _ = boat_log(SLOPE, 300.0, Errors(), seed, YMIR, Mounting(YMIR.axes, sign=-1.0))
    found = align(log)
    off = np.abs(np.array(found.mounting.misalignment) - ANGLES)
    assert found.unseen == () and found.errors[2] < np.radians(0.5)
    assert (off < 4 * found.errors).all() and (off[:2] < np.radians(0.05)).all()


def test_the_standard_error_of_yaw_is_that_of_repeated_runs():
    """Statistic: the spread of 8 runs' yaw angles is the standard error told, within the 99.8 % bounds of a variance (chi-square of 7)."""
    found = [align(boat_log(SLOPE, 60.0, Errors(), 50 + k, Mounting())[0]) for k in range(8)]
    yaw, told = np.array([f.mounting.misalignment[2] for f in found]), np.mean([f.errors[2] for f in found])
    assert 0.29 < yaw.std(ddof=1) / told < 1.86  # sqrt of 0.6 and 24.3 over 7


def test_yaw_cannot_be_observed_at_one_speed():
    """Law: a straight run at one speed tells roll and pitch; yaw is left and named with the remedy."""
    boat = Boat(straight=True, steady=True, roll=np.radians(2), pitch=np.radians(1))
    told = Mounting(misalignment=(0.0, 0.0, 0.03))
    found = align(boat_log(boat, 60.0, Errors(), 31, Mounting(misalignment=(0.02, -0.01, 0.03)), told)[0])
    assert found.unseen == ("yaw",) and found.mounting.misalignment[2] == pytest.approx(0.03)
    np.testing.assert_allclose(found.mounting.misalignment[:2], [0.02, -0.01], atol=2e-3)
    line = next(text for text in found.lines() if text.startswith("yaw"))
    assert "cannot be observed" in line and "speeds up and slows down" in line


def test_there_are_48_mountings():
    """Oracle: 24 proper rotations of a cube, each read as force or as reaction."""
    found = list(mountings())
    assert len({m.matrix().tobytes() for m in found}) == len(found) == 48


@pytest.mark.parametrize(
    "axes, sign",
    [(("x", "-y", "-z"), -1.0), (("x", "-y", "-z"), 1.0), (("-y", "x", "z"), 1.0), (("z", "y", "-x"), -1.0)],
)
def test_axes_are_found_by_gravity_and_motion(axes, sign):
    """Law: of all 48 the one that made the log is named, from fixes, compass, roll and pitch."""
    true = Mounting(axes, ANGLES, sign)
    found = coarse(boat_log(Boat(), 120.0, Errors(), 41, true, Mounting())[0])
    assert found == Mounting(axes, sign=sign)


WRONG = {
    "upside down": (
        Mounting(("x", "-y", "-z")),
        1.0,
        r"points down.*upside down.*\[\"x\", \"-y\", \"-z\"\], reads \"force\"",
    ),
    "reaction": (Mounting(sign=-1.0), 1.0, r"points down.*reads the reaction, not the force.*reads \"reaction\""),
    "swapped": (
        Mounting(("x", "z", "-y")),
        1.0,
        r"along the ship's y axis.*axes are swapped.*\[\"x\", \"z\", \"-y\"\]",
    ),
    "g": (Mounting(), 1 / 9.80665, r"so in g; multiply them by 9.80665"),
    "no gravity": (Mounting(), 0.01, r"without gravity; name them acceleration_surge_m_s2"),
    "feet": (Mounting(), 3.28, r"check unit and scale"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_gravity_tells_is_named(name):
    """Law: each fault is one line with file, what is wrong and the remedy."""
    true, scale, words = WRONG[name]
    log, _ = boat_log(Boat(), 120.0, Errors(), 42, true, Mounting())
    forces = [f"imu_force_{axis}_m_s2" for axis in "xyz"]
    with pytest.raises(InputError, match=words) as told:
        filter_spatial(replace(log, table=log.table.assign(**{force: log.table[force] * scale for force in forces})))
    assert "\n" not in str(told.value)


def test_gravity_alone_leaves_two_readings_open():
    """Law: at rest in harbour upside down and reaction look alike: both are named, with `aspnn mount` as the remedy."""
    boat = Boat(straight=True, steady=True, roll=1e-3, pitch=1e-3)
    log, _ = boat_log(boat, 20.0, Errors(), 43, Mounting(sign=-1.0), Mounting())
    table = log.table.drop(columns=[f"imu_rate_{axis}_deg_s" for axis in "xyz"])
    with pytest.raises(InputError, match=r"upside down or reads the reaction.*aspnn mount"):
        filter_spatial(replace(log, table=table))


def test_forces_are_needed():
    """Law: without forces one line says so."""
    log, _ = boat_log(Boat(), 20.0, Errors())
    with pytest.raises(InputError, match="no imu_force_x_m_s2"):
        align(replace(log, table=log.table.drop(columns="imu_force_x_m_s2")))
