"""Laws of the report: nothing is fetched, everything is in it; drawn hulls are to scale."""

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.evaluation import plots
from aspnn.evaluation.evaluate import evaluate
from aspnn.evaluation.examples import colours, examples
from aspnn.evaluation.figures import tracks_figure
from aspnn.evaluation.report import write_report
from aspnn.evaluation.windows import MODEL_SHIP, SHIP
from tests.evaluation.conftest import Held, Planner


@pytest.fixture(scope="module")
def evaluation(voyages):
    predictors = [Planner("flagship <one>", 1.0), Planner("second", 4.0), Planner("caa_ctra", 90.0), Held()]
    return evaluate(predictors, voyages, SHIP, oracle=lambda voyage: Planner("oracle"))


@pytest.fixture(scope="module")
def page(evaluation, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    curves = {"flagship": pd.DataFrame({"epoch": [0, 1, 2], "train_loss": [3.0, 2.0, 1.0], "rate": [1, 1, 1]})}
    write_report(evaluation, path, curves, {"checkpoint SHA-256": "0123abcd"}, {"second": "four metres off"})
    return path.read_text()


def test_report_asks_for_nothing_from_outside(page):
    """No address is loaded or linked, and the page itself forbids the browser to fetch anything."""
    assert not re.findall(r"""(?:src|href)\s*=\s*\\?["']?\s*(?:https?:)?//[^"'\s]*""", page)
    assert not re.findall(r"@import|<link|<iframe|url\(\s*[\"']?http", page)
    assert "default-src 'none'" in page
    assert len(page.encode()) < 8e6


def test_report_holds_what_was_measured(page, evaluation):
    """Every predictor, group, definition, seed, hash and figure is there; names are escaped."""
    for words in (
        "flagship &lt;one&gt;",
        "second",
        "caa_ctra",
        "constant",
        "oracle",
        "new_order",
        "steady",
        "0123abcd",
        "<b>second</b>: four metres off.",
        "<b>oracle</b>: the true simulator",
    ):
        assert words in page
    assert "<one>" not in re.sub(r"<script.*?</script>", "", page, flags=re.S)
    shown = [group for group in SHIP.headline if len(evaluation.rows(group))]
    ids = [f"tracks-{k}" for k in range(4)] + [f"course-{k}" for k in range(4)] + ["growth", "training"]
    for name in ids + [f"boxes-{group}" for group in shown]:
        assert page.count(f'id="{name}"') == 1
    assert "against the true path" in page and "voyage-0.parquet" in page


def test_examples_are_median_worst_and_steady(evaluation):
    """By hand: ranks of the main predictor's last error within the group."""
    assert evaluation.main == "flagship <one>"
    cases = examples(evaluation)
    last = np.sort(evaluation.errors[evaluation.main].position[evaluation.rows("new_order"), -1])
    assert [case.errors[case.main][-1] for case in cases[:3]] == [
        last[round(share * (len(last) - 1))] for share in (0.5, 0.95, 1.0)
    ]
    assert cases[3].group == "steady"
    assert all(case.reference.north[0] == case.reference.east[0] == 0 for case in cases)


def test_examples_of_a_model_ship_are_of_all_its_orders(voyages):
    """By hand: its headline group is `order`, so the ranks are among all orders, not among those that were held."""
    rule = replace(MODEL_SHIP, horizons=(30.0, 90.0))  # long enough for orders within it
    result = evaluate([Planner("main", 1.0)], voyages, rule)
    within, last = result.rows("orders_within_horizon"), result.errors["main"].position[:, -1]
    last[within] += 100  # the worst are orders with others to come
    shares, rows = (0.5, 0.95, 1.0), result.rows("order")
    assert len(result.rows("new_order")) and len(within) > 0.1 * len(rows)
    expected = [np.sort(last[rows])[round(share * (len(rows) - 1))] for share in shares]
    cases = examples(result)
    assert [case.errors["main"][-1] for case in cases[:3]] == expected
    assert [case.group for case in cases[1:3]] == ["orders_within_horizon"] * 2


def test_hulls_are_to_scale(evaluation):
    """Geometry: each of the 7 drawn outlines of the truth spans the vessel's length from bow to stern, axes share one scale."""
    case = examples(evaluation)[0]
    figure = plots.tracks(case, evaluation.vessel, colours(evaluation))
    assert (figure.layout.yaxis.scaleanchor, figure.layout.yaxis.scaleratio) == ("x", 1)
    hull = next(trace for trace in figure.data if trace.legendgroup == "truth" and trace.fill == "toself")
    place = np.asarray(hull.x) + 1j * np.asarray(hull.y)
    parts = [part[np.isfinite(part)] for part in np.split(place, np.flatnonzero(np.isnan(place)))][:-1]
    assert len(parts) == 7
    for part in parts:
        stern = np.abs(part - part[0]).max()  # the bow is first; the corners of the transom are the furthest
        assert stern == pytest.approx(np.hypot(90.0, 0.35 * 14.0), rel=1e-9)


def test_soft_log_is_odd_and_linear_for_small_errors():
    x = np.array([1e-4, 0.01, 1.0, 180.0])
    np.testing.assert_allclose(plots.soft_log(-x), -plots.soft_log(x))
    np.testing.assert_allclose(plots.soft_log(1e-4), 1e-3, rtol=1e-6)


def test_colours_are_one_per_predictor(evaluation):
    colour = colours(evaluation)
    assert list(colour) == list(evaluation.errors) and len(set(colour.values())) == len(colour)


@pytest.mark.parametrize("name", ["tracks.png", "tracks.svg"])
def test_figure_is_written(evaluation, tmp_path, name):
    """A picture with all three hull series: PNG by its signature, SVG by its labels."""
    tracks_figure(examples(evaluation)[0], evaluation.vessel, tmp_path / name)
    content = (tmp_path / name).read_bytes()
    assert content.startswith(b"\x89PNG") if name.endswith("png") else b"<svg" in content
    assert len(content) > 20_000


def test_report_without_baselines_orders_or_curves(tmp_path):
    """The smallest evaluation still makes a report: one predictor, one steady voyage, no truth of orders."""
    from aspnn.orders import Orders
    from tests.evaluation.conftest import nomoto_voyage

    voyage = nomoto_voyage(orders=Orders.held(0.0), vessel="kvlcc2_l7", duration=120.0)
    result = evaluate([Planner("alone", 3.0, 30.0)], [voyage], MODEL_SHIP)
    write_report(result, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "Steady (median)" in page and 'id="training"' not in page


def test_evaluating_needs_no_plotting_library():
    """Law: plotly and matplotlib are loaded only when something is drawn."""
    code = (
        "import sys, aspnn.evaluation.evaluate, aspnn.evaluation.oracle, aspnn.evaluation.report, "
        "aspnn.evaluation.figures; "
        "print([m for m in ('plotly', 'matplotlib', 'lightning') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
