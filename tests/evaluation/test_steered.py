"""Voyages under an autopilot are scored: the group that starts whatever is ordered, in metrics, table and report's groups."""

from dataclasses import replace

import numpy as np
import pytest

from aspnn.evaluation.evaluate import evaluate, headline_groups, metrics, table
from aspnn.evaluation.windows import SHIP, STEERED
from aspnn.orders import Orders
from aspnn.schema import InputError
from tests.evaluation.conftest import Cheat, nomoto_voyage

EVERY = replace(SHIP, steered_every=60.0)


def swinging():
    """A Nomoto ship whose rudder moves every half second."""
    time = np.arange(0.0, 900.0, 0.5)
    return nomoto_voyage(orders=Orders(time, np.radians(8 * np.sin(time / 11))), duration=900.0)


def test_a_voyage_under_an_autopilot_has_windows_where_they_are_asked_for():
    """Oracle: none without (an InputError), twelve with, of 120 to 810 s by 60; a place 5 m off has that error in all of them."""
    voyage = swinging()
    shifted = Cheat(voyage.reference, 3.0, 4.0, 0.0, name="shifted")
    with pytest.raises(InputError, match="no window to score"):
        evaluate([shifted], [voyage], SHIP)
    found = evaluate([shifted], [voyage], EVERY)
    scores = metrics(found)["predictors"]["shifted"]
    assert scores[STEERED]["n"] == len(found.windows) == 12 and headline_groups(found) == [STEERED]
    assert scores[STEERED]["horizons"]["90"]["position_m"]["p95"] == pytest.approx(5, abs=1e-6)
    assert "steered" in str(table(found).columns[0]._cells)


def test_other_groups_do_not_change_with_it():
    """Law: the metrics of all other groups are the same with it and without."""
    voyage = nomoto_voyage()
    shifted = Cheat(voyage.reference, 1.0, 0.0, 0.0, name="shifted")
    without, beside = (metrics(evaluate([shifted], [voyage], rule))["predictors"]["shifted"] for rule in (SHIP, EVERY))
    assert beside.pop(STEERED)["n"] > 5
    assert beside == without
