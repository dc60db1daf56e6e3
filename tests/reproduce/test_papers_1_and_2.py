"""The scripts that reproduce papers I and II: their voyages, their shared measurements, and what of their tables is quick to see."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.estimation.kernels import ACCELERATION
from aspnn.estimation.models import Cmm, Ctra, drift, measure

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import midship  # noqa: E402
import paper_1  # noqa: E402
import paper_2  # noqa: E402


@pytest.fixture(scope="module")
def turn():
    """A turning circle of two minutes."""
    return midship.sail(paper_1.turning_circle(math.radians(35), 30.0), math.radians(60), 120.0)


@pytest.mark.parametrize("kind", [Cmm, Ctra])
def test_true_states_satisfy_the_model(turn, kind):
    """Oracle: the model itself. The drift of the true states is their rate of change by differences (but that of what it holds
    constant), and the noise-free accelerometer reads u' - v r, v' + u r.
    """
    model = kind(midship.PERMUTED)
    x = midship.true_states(turn, model)
    for k in (100, 450, 900):
        rate = (x[k + 1] - x[k - 1]) / 0.2
        np.testing.assert_allclose(drift(model, x[k])[:5], rate[:5], atol=2e-4)
        u, v, r = turn.surge[k], turn.sway[k], turn.yaw_rate[k]
        felt = turn.surge_rate[k] - v * r, turn.sway_rate[k] + u * r
        np.testing.assert_allclose(measure(model, x[k], ACCELERATION), felt, atol=2e-4)


def test_draws_have_the_noise_of_paper_2(turn):
    """Oracle: R of table 3, within four standard errors of a standard deviation; runs differ, the same run is the same."""
    first, second = midship.draws(turn, 2, 7)
    again = next(midship.draws(turn, 1, 7))
    np.testing.assert_array_equal(first.heading, again.heading)
    assert not np.array_equal(first.heading, second.heading)
    assert first.heading.min() >= 0 and first.heading.max() < 2 * math.pi
    off = {
        1.0: first.fixes["midship"][:, 0] - turn.north,
        math.radians(0.5): np.angle(np.exp(1j * (first.heading - turn.heading))),
        math.radians(1e-3): first.yaw_rate - turn.yaw_rate,
        0.01: first.acceleration[:, 1] - turn.sway_rate - turn.surge * turn.yaw_rate,
    }
    for deviation, noise in off.items():
        assert abs(noise.std() / deviation - 1) < 4 / math.sqrt(2 * len(noise))


def test_paper_2_voyage_is_its_six_segments():
    """Oracle: Paper II, 5.1. Rudder and heading at which each segment begins; the heading passes north in S3; S6 slows down."""
    voyage, segment = paper_2.six_segment_voyage()
    begins = np.searchsorted(segment, range(1, 6))
    assert np.all(np.diff(segment) >= 0) and np.allclose(np.diff(voyage.time), 0.1)
    psi = np.degrees(voyage.heading)
    np.testing.assert_allclose(psi[begins], [30, 90, -60, -130, -150], atol=0.2)
    np.testing.assert_allclose(np.degrees(voyage.order[begins - 1]), [0, 35, -35, -10, 0], atol=1e-9)
    passing = np.flatnonzero(np.diff(np.sign(psi)))
    assert set(segment[passing]) == {2}
    assert voyage.shaft[begins[4] - 1] > 2 * voyage.shaft[begins[4]]
    place = np.exp(1j * voyage.heading) * (voyage.surge + 1j * voyage.sway)  # no jump where the halves meet
    np.testing.assert_allclose(np.diff(voyage.north), 0.05 * (place[1:] + place[:-1]).real, atol=1e-4)


def test_the_terms_of_the_turning_axes_are_what_paper_1_lacks(turn):
    """Oracle: published tables. Without the rotation terms CTRA's sway and CMM's normal acceleration are off as Paper I's were (within
    a factor of 1.6, another ship), with them at least five times less, and surge and tangential acceleration less than those by far.
    """
    voyage = midship.sail(paper_1.turning_circle(math.radians(35), 30.0), math.radians(60), 300.0)
    m = next(midship.draws(voyage, 1, 3))
    judged = voyage.time[1:] >= 30
    theirs = paper_1.published().query("manoeuvre == 'Starboard-35' and filter == 'E'").set_index("model")
    for kind, column, state in ((Ctra, "velocity_2", 3), (Cmm, "a_n", 7)):
        model = kind(midship.PERMUTED)
        truth = midship.true_states(voyage, model)[1:]
        _, run = next(midship.runs_of([m], model, None))
        without, with_ = (
            np.sqrt(np.mean(midship.error(states, truth)[judged, state] ** 2))
            for states in (paper_1.unrotated(m, model), run.mean)
        )
        published = theirs.loc[kind.__name__.upper(), column]
        assert published / 1.6 < without < published * 1.6
        assert with_ < published / 5


def test_unrotated_is_the_engine_where_the_ship_goes_straight():
    """Oracle: the compiled engine. On a straight course the terms are nothing, and both filters agree to a tenth of a deviation.

    They take the sensors in another order and the yaw rate's noise into the terms, so not to the last digit.
    """
    voyage = midship.sail(paper_1.turning_circle(0.0), 1.0, 60.0)
    m = next(midship.draws(voyage, 1, 5))
    for kind in (Cmm, Ctra):
        model = kind(midship.PERMUTED)
        _, run = next(midship.runs_of([m], model, None))
        deviation = np.sqrt(np.diagonal(run.covariance, axis1=1, axis2=2))
        late = slice(300, None)
        assert (np.abs(paper_1.unrotated(m, model) - run.mean)[late] / deviation[late]).max() < 0.1


def test_published_tables_are_whole():
    """Oracle: the papers. Six manoeuvres, two models, two filters; six segments, three scenarios, two tables; sums by hand."""
    first = pd.read_csv(paper_1.PUBLISHED, comment="#")
    assert len(first) == 24 and first.notna().all(axis=None)
    assert first.groupby(["model", "filter"])["manoeuvre"].nunique().tolist() == [6] * 4
    second = pd.read_csv(paper_2.PUBLISHED, comment="#")
    assert len(second) == 6
    assert second.query("table == 'nis'")[list(paper_2.SEGMENTS)].sum(axis=1).tolist() == [450, 455, 455]


def test_wrong_runs_are_one_line(tmp_path):
    """Oracle: the rule of the project: exit code 2, one line that says what to do, nothing written."""
    script = ROOT / "training/reproduce/paper_2.py"
    done = subprocess.run(
        [sys.executable, script, "--runs", "0", "--out", tmp_path / "out"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and done.stderr.strip().count("\n") == 0 and "--runs 0" in done.stderr
    assert not (tmp_path / "out").exists()
