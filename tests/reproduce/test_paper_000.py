"""Paper 000's script: its filter against a plain transcription, its errors against their law, its measures by hand, and the whole."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from aspnn.cli import guarded

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "training/reproduce"))

import paper_000  # noqa: E402
import paper_000_case as case  # noqa: E402
from paper_000_filter import ALPHA, PaperFilter, Q, R  # noqa: E402


def test_filter_is_table_1_corrected():
    """Oracle: Table 1 transcribed for one ship with numerical Jacobians of f_d and plain inverses (E46, E48)."""
    rng, h = np.random.default_rng(5), 0.1
    track = np.cumsum(np.stack([0.77 * np.cos(0.004 * np.arange(80)), 0.77 * np.sin(0.004 * np.arange(80))]), axis=1)
    fixes = track + rng.normal(0, 0.3, (2, 80))

    def f(x):
        return x + h * np.array(
            [x[2] * math.cos(x[3]), x[2] * math.sin(x[3]), -ALPHA[0] * x[2], x[4], -ALPHA[1] * x[4]]
        )

    def jacobian(x):
        return np.array([(f(x + 1e-6 * e) - f(x - 1e-6 * e)) / 2e-6 for e in np.eye(5)]).T

    E = np.zeros((5, 2))
    E[2, 0] = E[4, 1] = h
    C = np.eye(5)[:2]
    x, P = np.array([*fixes[:, 0], 7.7, 0.0, 0.0]), np.eye(5)
    several = PaperFilter(h, 7.7, 0.0, 3)
    for k in range(80):
        if k:
            A = jacobian(x)
            x, P = f(x), A @ P @ A.T + E @ Q @ E.T
        G = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x, P = x + G @ (fixes[:, k] - C @ x), (np.eye(5) - G @ C) @ P
        several.step(k * h, *(np.full(3, z) for z in fixes[:, k]))
    np.testing.assert_allclose(several.x, np.tile(x, (3, 1)), atol=1e-7)
    np.testing.assert_allclose(several.P[1], P, atol=1e-9)


def test_errors_have_the_stated_and_the_printed_size():
    """Oracle: stationary deviations: 4.7 m at any step, and 0.21 / sqrt(1 - exp(-2 h / 1100)) = 15.6 m at 0.1 s (E60).

    Of 4000 independent values a deviation is known to 1.1 %; four of that are allowed. The walk (43) after n steps by its own sum.
    """
    for dt in (0.1, 2.0):
        ends = case.stated(2000, 2, dt)[..., -1]
        assert ends.std() == pytest.approx(4.7, rel=0.045)
    errors = case.printed(2000, 400, 10.0)
    a = math.exp(-10.0 / 1100)
    assert not errors[..., 0].any()
    assert errors[..., -1].std() == pytest.approx(0.21 * math.sqrt((1 - a**798) / (1 - a * a)), rel=0.045)
    assert 0.21 / math.sqrt(1 - math.exp(-0.2 / 1100)) == pytest.approx(15.6, abs=0.05)


def test_route_is_the_papers():
    """Oracle: the printed waypoints: 20.4 km in five legs; the distance across by hand."""
    assert case.ROUTE.lengths.sum() == pytest.approx(2000 + 34e6**0.5 + 13e6**0.5 + 5000 + 4000)
    across = case.across(np.array([500.0, 8000.0]), np.array([30.0, 11990.0]), np.array([0, 4]))
    np.testing.assert_allclose(across, [30.0, -10.0])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The whole script once, in coarse steps."""
    folder = tmp_path_factory.mktemp("paper_000")
    out = folder / "out.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(case, "DURATION", 3700.0)
        patch.setattr(
            sys, "argv", ["paper_000.py", "--seeds", "1", "--step", "1", "--out", str(folder), "--json", str(out)]
        )
        guarded(paper_000.main)
    return folder, json.loads(out.read_text())


def test_true_positions_lead_along_the_route(whole):
    """Oracle: the issue: every waypoint, a steady cross-track error below 1 m; the low-pass of 40 s does not saturate, none does."""
    _, found = whole
    row = found["Route"][paper_000.TRUE]
    assert row["waypoints_reached"] == 5 and row["steady_mean_m"] < 1.0
    shares = found["Low-pass of the reference"]
    assert shares["40 s"]["at_rate_percent"] == 0 < shares["0 s"]["at_rate_percent"]
    assert 900 < shares["40 s"]["within_1_m_after_s"] < 1100
    assert shares["200 s"]["cross_rms_m"] > 2 * shares["40 s"]["cross_rms_m"]


def test_current_leaves_the_offset_of_the_formula(whole):
    """Oracle: look-ahead x c / sqrt(V^2 - c^2) for a heading, none for a course; the ship turns a little by herself, which is left."""
    _, found = whole
    by = found["Current"]
    assert by["current, heading steered"]["offset_m"] == pytest.approx(51.94, rel=0.02)
    assert abs(by["current, course steered"]["offset_m"]) < 0.5


def test_page_and_figures(whole):
    """Oracle: what must come out: a page without scripts with five figures, their PNG, and the gains as published."""
    folder, found = whole
    page = (folder / "page.html").read_text()
    assert page.count("<svg") == 5 and "<script" not in page
    assert len(list(folder.glob("figure_*.png"))) == 5
    assert found["Gains"]["pole placement"]["Kp"] == pytest.approx(1.45, abs=1e-3)
    assert found["Filter in the loop"][paper_000.STATED]["course_rms_deg"] < 3.0


def test_no_seeds_is_one_line(monkeypatch, capsys):
    """Oracle: the rule of the project: exit code 2, one line that says what to do."""
    monkeypatch.setattr(sys, "argv", ["paper_000.py", "--seeds", "0"])
    with pytest.raises(SystemExit) as ended:
        guarded(paper_000.main)
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1 and "--seeds 0" in said
