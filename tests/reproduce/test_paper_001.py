"""The study of paper 001: its transcription of the filter, its figures of a run, and the loop that it says works."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import paper_001 as paper  # noqa: E402

K = paper.T / paper.M66["paper's gains"]
GAINS = paper.pole_placement(K, paper.T, paper.OMEGA, paper.ZETA)


def test_gains_are_the_published_ones():
    """Oracle: (68), to its digits, from T / K = 41.4 kg m2 (E64)."""
    assert GAINS.proportional == pytest.approx(93.15, abs=5e-3)
    assert GAINS.derivative_time == pytest.approx(0.89, abs=5e-3)
    assert GAINS.integral_time == pytest.approx(6.67, abs=5e-3)


@pytest.mark.parametrize("geodetic", [False, True])
def test_the_printed_filter_finds_a_steady_course(geodetic):
    """Oracle: positions of a straight track, in metres and on the ellipsoid: its speed and true course come back."""
    # It begins at rest and northbound; a course of 70 degrees it never finds (E66).
    speed, course = 2.0, math.radians(5)
    step = paper.STEP * speed * np.array([math.cos(course), math.sin(course)])
    found = paper.PrintedFilter((5e5, 5e5), 1e-8 if not geodetic else 1e-22, geodetic)
    at = paper.PLACE.copy() if geodetic else np.zeros(2)
    for k in range(300):
        fix = at if k % 10 == 0 else np.full(2, np.nan)
        found.step(k * paper.STEP, fix[:1], fix[1:])
        scale = np.array(found.scale(float(at[0]))[:2])
        at = at + scale * step
    # Singer's decay of the speed over the 0.2 s between fixes: 0.2 %.
    assert found.speed[0] == pytest.approx(speed, rel=4e-3)
    assert math.degrees(found.course[0]) == pytest.approx(5.0, abs=0.05)


def test_the_step_is_sailed_as_the_paper_says():
    """Oracle: the paper's claim. By the printed filter on fixes without noise 20 degrees and back, without saturation; true estimates."""
    way = paper.ways(0.0)["as printed, north-east, Q 5e5, R 1e-8 m2"]
    run = paper.sailed(way, GAINS, K)
    found = paper.figures_of(run)
    at = {t: math.degrees(run.truth[round(t / paper.STEP), 3]) for t in (19.0, 39.0)}
    assert at[19.0] == pytest.approx(20, abs=0.1) and at[39.0] == pytest.approx(0, abs=0.1)
    assert found["saturated s"] == 0 and found["overshoot out deg"] < 1 and found["settled back s"] < 6
    assert found["COG deg"] < 0.1 and found["SOG m/s"] < 0.01 and found["course rate deg/s"] < 0.4
    assert run.port.min() > 0 and run.port.max() < 103.9
    alone = paper.alone(way, run)
    assert alone["COG deg"] == pytest.approx(found["COG deg"], rel=1e-9)  # the loop has no share in what it heard


def test_what_never_settles_is_told():
    """Oracle: a made-up course that swings for ever: infinite settling, its overshoot, and "never" and null where they are shown."""
    run = paper.sailed(lambda ships: paper.TrueNavigation(), GAINS, K)
    v = run.voyage
    swing = v.heading + np.radians(5) * np.sin(v.time)
    swinging = run._replace(voyage=type(v)(**{**vars(v), "heading": swing}))
    found = paper.figures_of(swinging)
    assert math.isinf(found["settled out s"]) and 4.5 < found["overshoot back deg"] < 6
    shown = paper.table("title", "note", {"x": found})
    assert "never" in shown.rows[0] and shown.values["x"]["settled out s"] is None
