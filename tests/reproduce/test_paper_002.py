"""The study of paper 002, on shorter runs than its own."""

import sys
from pathlib import Path

import numpy as np
import pytest

from aspnn.guidance.compensation import steady_offset

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import paper_002  # noqa: E402


@pytest.fixture(scope="module")
def runs():
    """Conventional and KF-based law there and back on lines of 90 m; module scope, as it takes some seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_002, "LENGTH", 90.0)
        cases = [paper_002.Case(paper_002.QUIET), paper_002.uneven()]
        names = ("conventional LOS", "KF-LOS, exact, tuned")
        yield {name: paper_002.shuttled(name, cases, runs=2) for name in names}


def offsets(run) -> dict[float, float]:
    """Steady y_e [m] by the angle of the line."""
    found = {}
    for ship in range(len(paper_002.LINES)):
        for leg in (0, 1):
            along, cross, line = paper_002.true_line(run, ship, leg)
            found[round(line)] = float(np.median(cross[along > 70]))
    return found


def test_the_conventional_law_keeps_its_offset_and_the_filter_takes_it_away(runs):
    """Oracle: lookahead tan(asin(c / V)), on both sides of the line by its direction, to 1 cm after 70 m; the filter's is below 0.1 m."""
    expected = steady_offset(paper_002.LOOKAHEAD, np.arcsin(paper_002.CURRENT / paper_002.SPEED))
    assert expected == pytest.approx(1.572, abs=1e-3)
    found = offsets(runs["conventional LOS"][0])
    assert set(found) == {60, -120, 119, -61}
    for line, offset in found.items():
        assert offset == pytest.approx(expected if line in (60, 119) else -expected, abs=0.01)
    assert max(map(abs, offsets(runs["KF-LOS, exact, tuned"][0]).values())) < 0.01


def test_current_and_compass_give_the_published_offsets(runs):
    """Oracle: the text of the paper: 2.4 m at 119 degrees and 0.6 m at -61; the filter takes both away."""
    found = offsets(runs["conventional LOS"][1])
    assert found[119] == pytest.approx(2.4, abs=0.02) and found[-61] == pytest.approx(-0.6, abs=0.02)
    assert max(map(abs, offsets(runs["KF-LOS, exact, tuned"][1]).values())) < 0.01


def test_what_the_helm_saw_is_the_true_motion(runs):
    """Oracle: without noise the helm's y_e is that of the voyage, and its true sideslip the crab angle of the steady part."""
    run = runs["conventional LOS"][0]
    along, cross, _ = paper_002.true_line(run, 0, 1)
    rows = run.seen["leg"][0] == 1
    np.testing.assert_allclose(run.seen["cross"][0][rows], cross, atol=1e-9)
    crab = run.seen["crab"][0][rows][along > 70]
    np.testing.assert_allclose(np.degrees(crab), np.degrees(paper_002.crab(-120.0)), atol=0.1)
