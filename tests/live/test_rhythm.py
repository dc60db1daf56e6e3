"""Rows that leave as soon as they are whole: the rows are those of an intake that always waits, only sooner."""

import math
import random
from collections import Counter

import numpy as np
import pytest

from aspnn.live.intake import Intake
from aspnn.live.rhythm import FEWEST, SILENT, Rhythm
from aspnn.logs.recording import unix
from aspnn.logs.sentences import encode
from tests.live.faults import BRIDGE, bridge, feed_of, voyage

START = unix("2026-11-22T12:00:00Z")


def gga(t: float, talker: str) -> str:
    s = t % 86400
    clock = f"{int(s // 3600):02d}{int(s // 60 % 60):02d}{s % 60:06.3f}"
    return encode(talker, "GGA", [clock, f"6930.{int(s * 7) % 10000:04d}", "N", "01530.0000", "E", "1", *[""] * 8])


def sensors(seconds: float, seed: int, silent=(math.inf, math.inf)) -> list[tuple[float, str]]:
    """Fixes of 10 and 5 Hz that come 60 ms late, a gyro of 20 Hz and a rate of turn of 10 Hz that come with up to 8 ms of
    jitter at phases of their own, wind once a second, an order now and then; the rate of turn is silent between two times."""
    rng, feed = random.Random(seed), []
    phase = [rng.uniform(0, 0.1) for _ in range(3)]

    def add(rate, late, jitter, at, line):
        for k in range(int(seconds * rate)):
            t = START + k / rate + at
            feed.append((t + late + rng.uniform(0, jitter), line(START + k / rate, k)))

    add(10, 0.06, 0.0, 0.0, lambda t, k: gga(t, "GP"))
    add(5, 0.06, 0.0, 0.0, lambda t, k: gga(t, "GN"))
    add(20, 0.0, 0.008, phase[0], lambda t, k: encode("HE", "HDT", [f"{k % 360}.5", "T"]))
    add(10, 0.0, 0.008, phase[1], lambda t, k: encode("TI", "ROT", [f"{k % 60}.5", "A"]))
    add(1, 0.0, 0.008, phase[2], lambda t, k: encode("WI", "MWV", ["30", "T", f"{k % 30}.5", "M", "A"]))
    feed += [(START + rng.uniform(0, seconds), encode("II", "ROR", [str(k), "A", "", "V"])) for k in range(8)]
    gone = ((t, line) for t, line in feed if not ("ROT" in line and silent[0] <= t - START < silent[1]))
    return sorted(gone, key=lambda pair: pair[0])


def rows_of(it, feed, poll=0.02):
    """Rows and how old each is when it is taken; polled every `poll` seconds of receipt."""
    found, asked = [], -math.inf
    for t, line in feed:
        it.feed(line, t, "lan")
        if t - asked >= poll:
            asked = t
            found += [(row, t - row.time) for row in it.rows(t)]
    end = feed[-1][0] + 1
    return found + [(row, math.nan) for row in it.rows(end)]


@pytest.fixture
def intake(tmp_path):
    return lambda: Intake(bridge(tmp_path, BRIDGE.replace("GP0001", "GP").replace("GN0001", "GN")))


def waiting(monkeypatch):
    monkeypatch.setattr(Rhythm, "done", lambda self, end: False)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("silent", [(math.inf, math.inf), (6.0, 12.0)])
def test_rows_are_those_of_an_intake_that_waits(intake, monkeypatch, seed, silent):
    """Oracle: the intake that lets no row leave before `latency_s` is over, on feeds in order with sensors of five rates, of which
    one falls silent and comes back; the same values in the same rows, nothing late. Orders, which have no rhythm, may stand
    one row later, and of what comes back the first."""
    feed = sensors(20.0, seed, silent)
    early = intake()
    sooner = [row for row, _ in rows_of(early, feed)]
    waiting(monkeypatch)
    late = [row for row, _ in rows_of(intake(), feed)]
    assert [r.time for r in sooner] == [r.time for r in late]
    for k, (a, b) in enumerate(zip(sooner, late, strict=True)):
        back = {"rudder_order_deg"} | ({"yaw_rate_deg_s"} if abs(b.time - START - silent[1]) < 0.35 else set())
        assert {n: v for n, v in a.values.items() if n not in back} == {
            n: v for n, v in b.values.items() if n not in back
        }, k
    orders = [[r.values["rudder_order_deg"] for r in rows if "rudder_order_deg" in r.values] for rows in (sooner, late)]
    assert orders[0] == orders[1] and len(orders[0]) >= 6
    assert early.counts["lan"]["good"] == len(feed)


def test_how_old_rows_are_when_they_leave(intake, monkeypatch):
    """By hand: the fixes come 60 ms late, so a row is 60 ms old and waits for the gyro's second value 50 ms more at most, not the 200 ms of
    `latency_s`; while a sensor is silent it is not waited for after SILENT."""
    feed = sensors(20.0, 1, (6.0, 18.0))
    found = rows_of(intake(), feed, poll=0.0)
    ages = {round(row.time - START, 1): age for row, age in found}
    well = [age for t, age in ages.items() if 2.5 < t < 5.5 or 6.5 + SILENT < t < 17.5]
    assert 0.0599 <= np.median(well) <= 0.12
    assert np.median([age for t, age in ages.items() if 6.3 < t < 5.8 + SILENT]) >= 0.2
    waiting(monkeypatch)
    assert np.nanmin([age for _, age in rows_of(intake(), feed, poll=0.0)]) >= 0.2 - 1e-6


def test_how_often_rows_are_asked_for_changes_nothing(intake):
    """Law: the rows are those of the lines and their times of receipt, whoever asks, and when."""
    feed = sensors(10.0, 4, (4.0, 7.0))
    feed = sorted((t + 0.3 * ("GNGGA" in line and k % 7 == 0), line) for k, (t, line) in enumerate(feed))
    kept: list[Counter] = []
    rows: list[list] = []
    for poll in (0.0, 1.7):
        it = intake()
        rows.append([row for row, _ in rows_of(it, feed, poll)])
        kept.append(it.counts["lan"])
    assert rows[0] == rows[1] and kept[0] == kept[1] and kept[0]["late"] > 3


def test_an_order_that_comes_after_its_row_goes_into_the_next(intake):
    """By hand: fixes and headings at the points of the grid; the row of 5.0 s leaves at once, an order of 5.02 s stands in that of 5.1 s;
    a fix of 5.0 s that comes then is late."""
    it, rows = intake(), []
    for k in range(80):
        t = START + k / 10
        for line in (gga(t, "GP"), gga(t, "GN"), encode("HE", "HDT", [f"{k}.5", "T"])):
            it.feed(line, t + 0.001, "lan")
        rows += it.rows(t + 0.001)
        if k == 50:
            assert rows[-1].time == t
            it.feed(encode("II", "ROR", ["15.0", "A", "", "V"]), t + 0.02, "lan")
            it.feed(gga(t, "GP"), t + 0.03, "lan")
    assert [r.time - START for r in rows if "rudder_order_deg" in r.values] == [pytest.approx(5.1)]
    assert it.counts["lan"]["late"] == 1 and len(rows) == 80


def test_rows_that_nobody_takes_do_not_fill_the_memory(intake):
    """By hand: of 90 s of rows at 10 Hz the last 60 are kept; the 300 others are counted as lost."""
    it = intake()
    for k in range(900):
        it.feed(encode("HE", "HDT", [f"{k % 360}.5", "T"]), START + k / 10, "lan")
    rows = it.rows(START + 100)
    assert len(rows) in (600, 601) and len(rows) + it.counts["lan"]["rows_lost"] == 900
    assert rows[-1].time == pytest.approx(START + 89.9)


def test_rows_wait_while_values_come_out_of_order(tmp_path):
    """Law: of a feed whose lines come up to 0.15 s late and out of order all are in the rows, none is late, once that is known; the
    first thirty rows may go before it is."""
    log = voyage(12.0)
    rng, feed = random.Random(3), feed_of(log)
    mixed = sorted(((t + rng.uniform(0, 0.15), line) for t, line in feed), key=lambda pair: pair[0])
    it = Intake(bridge(tmp_path))
    rows = [row for row, _ in rows_of(it, mixed)]
    other = [row for row, _ in rows_of(Intake(bridge(tmp_path)), feed)]
    assert it.counts["lan"]["out_of_order"] > 20 and it.counts["lan"]["late"] <= 2
    assert rows[30:] == other[30:]


def test_rhythms_by_hand():
    """By hand: a column of 1 Hz is done with spans before its next value, waited for when that is due, given up SILENT after; nothing is
    done before a rhythm is known; one that comes as it likes is not waited for."""
    rhythm = Rhythm()
    assert not rhythm.done(0.0)
    for k in range(FEWEST):
        rhythm.hear("a", float(k))
        assert not rhythm.done(k + 0.5)
    rhythm.hear("a", float(FEWEST))
    assert rhythm.done(FEWEST + 0.9) and not rhythm.done(FEWEST + 1.0)
    assert not rhythm.done(FEWEST + 1 + SILENT - 0.01) and not rhythm.done(FEWEST + 1 + SILENT + 0.01)
    for t in (0.0, 0.1, 3.0, 3.1, 4.0, 4.05):
        rhythm.hear("b", t)
    assert rhythm.done(FEWEST + 0.9)
    rhythm.hear("a", 2.0)  # out of order: no rhythm
    assert rhythm.done(FEWEST + 0.9)
