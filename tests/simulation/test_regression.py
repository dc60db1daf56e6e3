"""Estimated vessels: against the constructed cargo90, the measured KVLCC2, published worked examples, and statistics."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from aspnn.cli import app
from aspnn.schema import InputError
from aspnn.simulation.estimate import bseries, regression
from aspnn.simulation.estimate.regression import Hull
from aspnn.simulation.estimate.resistance import Form, allowance, entrance, form_factor, waves, wetted_surface
from aspnn.simulation.estimate.sureness import MOST_SIGMA, draw, index_ranges, told
from aspnn.simulation.estimate.vessel_file import KNOT, Particulars, estimate, write_vessel
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import run_on
from aspnn.vessel import from_dict, load_vessel

CARGO = Particulars(
    *(85.0, 14.0, 6.5, 0.8),
    name="again",
    length_overall=90.0,
    speed=5.916106,
    power=1.8e6,
    shaft=165 / 60,
    propeller_diameter=3.1,
    rudder_area=10.3,
    rudder_span=4.2,
)
TANKER = Particulars(320.0, 58.0, 20.8, 0.81, name="tanker", speed=15.5 * KNOT)
CARGO_OPTIONS = ("--length", "85", "--beam", "14", "--draught", "6.5", "--cb", "0.8")


def test_cargo90_is_reproduced():
    """Oracle: cargo90.json, made with these formulas elsewhere: every coefficient of it from its particulars, to 1e-6."""
    expected = load_vessel("cargo90").simulator["mmg"]
    found = estimate(CARGO).data["mmg"]
    assert set(found) == set(expected)
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-6), name


def test_kvlcc2_is_reproduced_where_the_correction_is_whole():
    """Oracle: the measured KVLCC2. What is wholly corrected comes out as measured; X_vr is off by what m_y is."""
    ship = regression.type_ship()
    found = regression.corrected(ship.hull)
    whole = [n for n in ship.measured if n[:2] in ("X_", "Y_", "N_") and n not in (*regression.LINEAR, "X_vr")]
    assert len(whole) == 11
    for name in (*whole, "a_H", "kappa", "gamma_R"):
        assert found[name] == pytest.approx(ship.measured[name], rel=1e-12), name
    assert found["X_vr"] + found["m_y"] == pytest.approx(ship.measured["X_vr"] + ship.measured["m_y"])


def test_added_masses_of_kvlcc2():
    """Oracle: m_y' 0.2242 and J_z' 0.01122 by the same regression (design facts), published 0.223 and 0.011."""
    found = regression.added_masses(Hull(320.0, 58.0, 20.8, 312600.0))
    assert found["m_y"] == pytest.approx(0.2242, abs=1e-4)
    assert found["J_z"] == pytest.approx(0.01122, abs=5e-6)
    assert found["m_y"] == pytest.approx(0.223, rel=0.01)
    assert found["J_z"] == pytest.approx(0.011, rel=0.03)


def test_derivatives_give_the_forces_of_the_beta_form():
    """Oracle: the regression as published, in beta = -v', transcribed again here: the same forces in any motion."""
    L, B, d, C_b = 120.0, 20.0, 8.0, 0.7
    c, k, m_x, m_y = C_b * B / L, 2 * d / L, 0.012, 0.2
    p = regression.hull_formulas(Hull(L, B, d, C_b * L * B * d), m_x, m_y)
    rng = np.random.default_rng(1)
    for beta, r in rng.uniform(-0.6, 0.6, (50, 2)):
        v = -beta
        X = (1.15 * c - 0.18) * beta**2 - (1.91 * c - 0.08 - m_y) * beta * r + (-0.085 * c + 0.008) * r**2
        X += (-6.68 * c + 1.1) * beta**4
        Y = (0.5 * math.pi * k + 1.4 * c) * beta + (m_x + 0.5 * c) * r + (0.185 * L / B + 0.48) * beta**3
        Y += -0.75 * beta**2 * r + (0.26 * (1 - C_b) * L / B + 0.11) * beta * r**2 - 0.051 * r**3
        N = k * beta + (-0.54 * k + k**2) * r + (-0.69 * C_b + 0.66) * beta**3 + (1.55 * c - 0.76) * beta**2 * r
        N += (-0.075 * (1 - C_b) * L / B + 0.098) * beta * r**2 + (0.25 * c - 0.056) * r**3
        ours = [
            p["X_vv"] * v * v + p["X_vr"] * v * r + p["X_rr"] * r * r + p["X_vvvv"] * v**4,
            *(
                p[f"{a}_v"] * v
                + p[f"{a}_r"] * r
                + p[f"{a}_vvv"] * v**3
                + p[f"{a}_vvr"] * v * v * r
                + p[f"{a}_vrr"] * v * r * r
                + p[f"{a}_rrr"] * r**3
                for a in "YN"
            ),
        ]
        np.testing.assert_allclose(ours, [X, Y, N], rtol=1e-12, atol=1e-15)


def test_holtrop_worked_example():
    """Oracle: the example in Holtrop and Mennen (1982): 1 + k1 1.156, i_E 12.08 deg, S 7381.45 m2, C_A 0.000352, R_W 557.11 kN.

    Its bulb (20 m2) and transom (16 m2), which are left out here, come in by the paper's c2, c5 and bulb terms.
    """
    ship = Form(205.0, 32.0, 10.0, 37500.0, 0.98, 0.75, -0.75, stern=10.0)
    assert form_factor(ship) == pytest.approx(1.156, abs=1e-3)
    assert entrance(ship) == pytest.approx(12.08, abs=5e-3)
    assert wetted_surface(ship) + 2.38 * 20 / ship.C_B == pytest.approx(7381.45, abs=0.01)
    assert allowance(ship) == pytest.approx(0.000352, abs=1e-6)
    c2 = math.exp(-1.89 * math.sqrt(0.56 * 20**1.5 / (32 * 10 * (0.31 * math.sqrt(20) + 10 - 4))))
    c5 = 1 - 0.8 * 16 / (32 * 10 * 0.98)
    assert waves(ship, 25 * KNOT, 1025) * c2 * c5 == pytest.approx(557.11e3, rel=2e-3)


def test_propeller_polynomials():
    """Oracle: cargo90's table of K_T over the pitch ratio, from another transcription of the series (MSS WageningData.mat)."""
    for pitch, row in load_vessel("cargo90").simulator["propeller"]["table"].items():
        np.testing.assert_allclose(bseries.thrust_quadratic(float(pitch), 0.55, 4), row, atol=2e-6)
    K_T, K_Q = bseries.thrust_torque(np.linspace(0.1, 0.8, 8), 1.0, 0.55, 4)
    efficiency = np.linspace(0.1, 0.8, 8) * K_T / (2 * math.pi * K_Q)
    assert 0.6 < efficiency.max() < 0.72


@pytest.mark.parametrize(
    "given",
    [CARGO, TANKER, replace(CARGO, shaft=None), replace(CARGO, power=None), Particulars(175.0, 25.4, 8.5, 0.56)],
)
def test_produced_file_loads_balances_and_turns(given, tmp_path):
    """Law: the file is a vessel that needs the estimated shaft speed in service, holds it straight, and turns to its rudder."""
    found = estimate(given)
    write_vessel(found, tmp_path / "ship.json")
    vessel = load_vessel(tmp_path / "ship.json")
    ship = Ship.of(vessel)
    speed = vessel.service_speed
    shaft, _ = ship.model.balance(speed)
    assert shaft == pytest.approx(found.service.shaft, rel=0.01)  # K_T is cubic in J, the MMG's quadratic
    unit = ship.model.Lpp / speed
    start = np.repeat(ship.start(0.0, 0.0, 0.0, speed), 3, axis=0)
    end = run_on(ship, start, np.outer([0.0, 1.0, -1.0], np.full(800, vessel.rudder_max)), dt=unit / 80)[:, -1]
    assert end[0, 3] == pytest.approx(speed, rel=1e-6)
    assert end[1, 2] > math.pi / 2
    assert end[2, 2] < -math.pi / 2


def test_every_number_names_its_formula():
    """House rule: `sources` tells every section, and every coefficient of `mmg` with its standard deviation or as fixed."""
    data = estimate(TANKER).data
    for section in set(data) - {"name", "title", "sources"}:
        assert data["sources"][section]
    for name in data["mmg"]:
        text = data["sources"][f"mmg.{name}"]
        assert (
            "standard deviation" in text
            or "fixed" in text
            or text in ("given", "sea water", "C_b L B d", "assumed: midship")
        )
    assert "(7%)" in data["sources"]["mmg.Y_v"] or "(6%)" in data["sources"]["mmg.Y_v"]


def test_draws_have_the_standard_deviations_told():
    """Statistic: 4000 draws scatter about the estimate as told, less what the bound on z takes; 4 standard errors of a deviation."""
    found, rng, n = estimate(TANKER), np.random.default_rng(7), 4000
    drawn = [draw(found, rng) for _ in range(n)]
    bound = np.clip(np.random.default_rng(1).standard_normal(1_000_000), -MOST_SIGMA, MOST_SIGMA).std()
    for name, (deviation, _) in found.deviations.items():
        key = "gamma_R_plus" if name == "gamma_R" else name
        values = np.array([one[key] for one in drawn])
        assert values.std() == pytest.approx(bound * deviation, rel=4 / math.sqrt(2 * n)), name
        assert values.mean() == pytest.approx(found.data["mmg"][key], abs=4 * deviation / math.sqrt(n)), name


def test_ranges_hold_the_measured_ship():
    """Oracle: KVLCC2's published turn to starboard (advance 3.31, diameter 3.36 L) and first overshoot (5.2 deg) lie in the ranges.

    And the same seed gives the same ranges.
    """
    found = estimate(TANKER)
    ranges = index_ranges(found, 12, seed=3)
    for one, published in zip(ranges, (3.31, 3.36, math.radians(5.2)), strict=False):
        assert one.low < published < one.high, one
        assert one.low < one.value < one.high
    assert ranges == index_ranges(found, 12, seed=3)
    assert len(told(found, ranges, 12)) == 6


def test_command_writes_a_vessel_and_says_how_sure(tmp_path):
    """The command: a file that loads, a table of coefficients, lines in words, warnings for an unusual ship."""
    out = tmp_path / "barge.json"
    options = ("--length", "85", "--beam", "20", "--draught", "6.5", "--cb", "0.8", "--draws", "0", "--out", str(out))
    result = CliRunner().invoke(app, ["vessel", "estimate", *options])
    assert result.exit_code == 0, result.output
    assert "warning: length over beam 4.25" in result.output
    assert "N_vvr" in result.output
    assert load_vessel(out).name == "barge"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--cb", "8"), "--cb 8 is outside"),
        (("--draught", "650"), "--draught 650"),
        (("--beam", "70"), "length over beam"),
        (("--length", "nan"), "--length nan"),
        (("--speed", "60"), "Froude number"),
        (("--propeller-diameter", "310"), "--propeller-diameter 310"),
        (("--rudder-area", "0.01"), "--rudder-area 0.01"),
        (("--power", "90000", "--rpm", "100", "--speed", "11"), "--power and --rpm do not go together"),
        (("--out", "ship.toml"), "--out ship.json"),
    ],
)
def test_impossible_ships_are_told(options, words, tmp_path, monkeypatch):
    """Bad input: one line that names the option; nothing is written."""
    monkeypatch.chdir(tmp_path)
    everything = [*CARGO_OPTIONS, "--out", "ship.json", *options]
    result = CliRunner().invoke(app, ["vessel", "estimate", *everything])
    assert isinstance(result.exception, InputError)
    assert words in str(result.exception)
    assert "\n" not in str(result.exception)
    assert list(tmp_path.iterdir()) == []


def test_unused_file_is_the_estimate_itself(tmp_path):
    """Round trip: what is written is read back as the same vessel."""
    found = estimate(CARGO)
    write_vessel(found, tmp_path / "ship.json")
    assert json.loads((tmp_path / "ship.json").read_text()) == found.data
    assert load_vessel(tmp_path / "ship.json") == from_dict(found.data)
