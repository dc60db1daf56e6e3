"""The trial's table, JSON file and figure, and the command that makes them."""

import json
import math
from functools import cache

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.image import imread

from aspnn import __version__
from aspnn.evaluation import trial_plot
from aspnn.evaluation.trial_plot import DRAWN, trial_figure
from aspnn.evaluation.trial_report import closing, data, heading, rows, write_json
from aspnn.schema import InputError
from aspnn.simulation.trials.manoeuvres import TRIALS
from aspnn.vessel import load_vessel
from tests.test_cli import run


@cache
def trial(kind, vessel="cargo90"):
    return TRIALS[kind](load_vessel(vessel), None, None)


@pytest.mark.parametrize("kind", TRIALS)
def test_every_trial_has_a_landscape_page(kind, tmp_path):
    """Oracle: A4 landscape at 160 dots per inch, white at its edge and with ink on it; every trial can be drawn."""
    trial_figure(trial(kind), tmp_path / "a.png")
    picture = imread(tmp_path / "a.png")[..., :3]
    assert picture.shape[:2] == (1323, 1870)
    assert picture[:, :2].min() == 1.0 and 0.005 < (picture < 0.9).any(axis=-1).mean() < 0.2


def test_the_suffix_decides_and_no_other_is_taken(tmp_path):
    """Oracle: the first bytes of the formats; a wrong ending leaves nothing."""
    for suffix, first in ((".svg", b"<?xml"), (".pdf", b"%PDF-")):
        trial_figure(trial("stopping"), tmp_path / f"a{suffix}")
        assert (tmp_path / f"a{suffix}").read_bytes().startswith(first)
    with pytest.raises(InputError, match=r"a figure ends in \.png"):
        trial_figure(trial("stopping"), tmp_path / "a.bmp")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.pdf", "a.svg"]


def test_hulls_are_drawn_to_scale(tmp_path, monkeypatch):
    """Oracle: the vessel; every outline filled in the turning circle is as long as the ship, in lengths between perpendiculars."""
    hulls, fill = [], Axes.fill
    monkeypatch.setattr(Axes, "fill", lambda self, *points, **how: hulls.append(points) or fill(self, *points, **how))
    trial_figure(trial("turning-circle"), tmp_path / "a.png")
    assert len(hulls) == 26  # every 30 degrees of a full circle, on both sides
    lengths = [
        np.hypot(east[0] - (east[5] + east[6]) / 2, north[0] - (north[5] + north[6]) / 2) for east, north in hulls
    ]
    np.testing.assert_allclose(lengths, 90 / 85, rtol=1e-9)


def test_dimension_lines_measure_what_they_say(tmp_path, monkeypatch):
    """Oracle: the indices; each line is as long as the number at it."""
    lines, measure = [], trial_plot.measure
    monkeypatch.setattr(trial_plot, "measure", lambda axes, *line: lines.append(line) or measure(axes, *line))
    trial_figure(trial("turning-circle"), tmp_path / "a.png")
    assert len(lines) == 6
    for start, end, text in lines:
        assert math.dist(start, end) == pytest.approx(float(text.split()[-2]), abs=0.005)


def test_table_names_limits_and_verdicts():
    """Oracle: MSC.137(76) for L / V = 14.37 s: 12.2 and 28.3 degrees; a test for both sides passes when both do."""
    heads, cells = rows(trial("zigzag"))
    assert heads == ["", "starboard", "port", "limit", "verdict"]
    first, second, track = cells[:3]
    assert first[0] == "10/10 first overshoot" and first[3:] == ["12.2 deg", "PASS"]
    assert second[3:] == ["28.3 deg", "PASS"] and track[3:] == ["2.5 L", "PASS"] and cells[3][3:] == ["", "-"]
    assert closing(trial("zigzag")).startswith("8 of 8 criteria")
    assert rows(trial("turning-circle", "mariner"))[1][2][-1] == "FAIL"
    assert rows(trial("williamson"))[0] == ["", "starboard", "port"]
    assert "L = 85 m (length between perpendiculars), L/V = 14.4 s" in heading(trial("zigzag"))[1]


def test_json_holds_the_indices_in_peoples_units(tmp_path):
    """Oracle: the trial itself, and JSON's own rules; what was not reached is null."""
    write_json(trial("turning-circle"), tmp_path / "a.json")
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["aspnn"] == __version__ and found["vessel"]["name"] == "cargo90" and found["length_m"] == 85
    assert found["rudder_deg"] == pytest.approx(35) and found["speed_kn"] == pytest.approx(11.5, abs=1e-4)
    advance = found["runs"][0]["indices"]["advance"]
    assert advance["lengths"] * 85 == pytest.approx(advance["value"]) and advance["limit"] == 4.5 * 85
    assert advance["verdict"] == "pass" and found["runs"][0]["indices"]["transfer"]["verdict"] is None
    drift = found["runs"][1]["indices"]["drift"]
    assert drift["unit"] == "deg" and drift["value"] == pytest.approx(
        math.degrees(trial("turning-circle").runs[1].indices[5].value)
    )
    curve = data(trial("spiral"))["runs"][0]["curve"]
    assert len(curve["rudder_deg"]) == 61 and curve["rudder_deg"][0] == pytest.approx(-15)


def test_the_command_prints_and_writes(tmp_path, capsys):
    """Oracle: what `aspnn trial` promises: table, JSON and figure, and exit code 0 although the Mariner fails a criterion."""
    code, errors = run(
        "trial", "mariner", "turning-circle", "--json", tmp_path / "a.json", "--plot", tmp_path / "a.svg"
    )
    printed = capsys.readouterr().out
    assert (code, errors) == (0, "") and "FAIL" in printed and "tactical diameter" in printed
    assert json.loads((tmp_path / "a.json").read_text())["criteria"] == {"judged": 4, "met": 2}
    assert (tmp_path / "a.svg").exists()


@pytest.mark.parametrize(
    "words, says",
    [
        (("cargo90", "zigzag", "--rudder", 40), "40 deg of rudder; give an angle above 0, up to the stop at 35 deg"),
        (("cargo90", "zigzag", "--speed", 0), "a test speed of 0 m/s"),
        (("mariner", "stopping"), "no drive astern"),
        (("nobody", "zigzag"), "vessel nobody is not known"),
        (("cargo90", "stopping", "--plot", "a.txt"), "a figure ends in .png, .svg, .pdf"),
    ],
)
def test_what_a_user_gets_wrong_is_one_line(words, says, tmp_path, monkeypatch):
    """Oracle: exit code 2, one line that names the remedy, nothing written."""
    monkeypatch.chdir(tmp_path)
    code, errors = run("trial", *words, "--json", "a.json")
    assert code == 2 and says in errors and errors.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_every_trial_of_the_simulator_is_drawn():
    """Oracle: the two tables have the same names."""
    assert DRAWN.keys() == TRIALS.keys()
