"""The study of the course filter, on a short simulated voyage and on made-up recordings: the real ones are not part of the project."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from aspnn.estimation.course import CourseModel
from aspnn.vessel import load_vessel

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import course  # noqa: E402
import course_recordings  # noqa: E402


@pytest.fixture(scope="module")
def voyage():
    """A ship steered by the filter along the first two legs of the paper, cut short."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(course, "WAYPOINTS", ((0, 0), (1200, 0), (1700, 1800)))
        return course.sail(1, 1, 0.0)


def test_errors_are_against_the_true_motion_over_ground(voyage):
    """The targets of the issue: course within 3 degrees rms, speed within 0.15 m/s rms; the fixes' own error is the wander's."""
    voyages, fixes = voyage
    vessel = load_vessel("mariner")
    e = course.errors(voyages, fixes, CourseModel.of(vessel), vessel.noise.position, course.GATE, "wander", "own")
    assert e.course < 3 and e.speed < 0.15
    off = fixes[0] - np.column_stack([voyages[0].north, voyages[0].east])
    assert 0.5 < np.sqrt(np.mean(off**2)) < 15  # stationary deviation 4.7 m; one draw of a process that lasts 1100 s
    assert np.diff(off, axis=0).std() == pytest.approx(4.7 * math.sqrt(2 * 0.1 / 1100), rel=0.05)


def test_forms_agree_and_outages_grow(voyage):
    """0.01 degrees of the issue between the forms; a minute without fixes is worse than none, and stays finite."""
    voyages, fixes = voyage
    vessel = load_vessel("mariner")
    angle, speed = course.forms(voyages[0], fixes[0], vessel)
    assert angle < 0.01 and speed < 0.01
    dead = course.outages(voyages, fixes, vessel)
    assert dead.outages >= 1 and 1 < dead.place <= dead.worst < 400 and dead.kept < 400


def test_recordings_that_are_absent_are_said_to_be(tmp_path):
    """One line for each folder, and no figure."""
    told = list(course_recordings.lines(tmp_path))
    assert len(told) == 2 and all("is absent" in line for line in told)


def test_scores_are_put_together_by_their_samples():
    """Rms of 3 in 1 and of 1 in 3 samples: sqrt((9 + 3) / 4)."""
    a, b = course_recordings.Score("a", 1, 3.0, 3.0), course_recordings.Score("b", 3, 1.0, 1.0)
    both = course_recordings.together([a, b], "both")
    assert (both.samples, both.course, both.speed) == (4, pytest.approx(math.sqrt(3)), pytest.approx(math.sqrt(3)))
