"""What goes wrong on a bridge: the right alarm each time and no other, rows that go on, every sentence in a row or counted.

The large runs (an hour at 100 x, 24 hours, a million lines) are training/reproduce/soak_live.py.
"""

import numpy as np
import pytest

from aspnn.live.alarms import Severity, of_intake
from aspnn.live.intake import Intake
from aspnn.logs.sentences import encode, encode_tag
from tests.live import faults
from tests.live.faults import Watch

FIRST = {"filter_waiting"}  # of every beginning
NOT_FAULTS = ("lines", "sentences", "out_of_order", "rows_lost")
BEHIND = {
    "gnss_stale",
    "gnss_lost",
    "heading_lost",
    "silent_lan",
    "filter_behind",
}  # a clock that goes on without a line


@pytest.fixture(scope="module")
def log():
    return faults.voyage(26.0)


@pytest.fixture(scope="module")
def feed(log):
    return faults.feed_of(log)


@pytest.fixture(scope="module")
def bridge(tmp_path_factory):
    return faults.bridge(tmp_path_factory.mktemp("faults"))


CASES = {
    "nothing": (lambda f, t: f, set(), set()),
    "gnss lost": (lambda f, t: faults.without(f, "GGA", t, t + 12), {"gnss_stale", "gnss_lost", "coasting"}, set()),
    "receivers disagree": (
        lambda f, t: faults.astray(f, "GN0001", t, 0.05),
        {"disagree_bow_stern"},
        {"inconsistent_stern"},
    ),
    "receipt 3 h on": (lambda f, t: faults.jumped(f, t, 10_800.0), {"clock_jump"}, BEHIND),
    "receipt to 1970": (lambda f, t: faults.jumped(f, t, -t), {"clock_jump"}, set()),
    "receivers 18 s on": (lambda f, t: faults.receivers_jumped(f, t, 18.0), {"clock_jump"}, set()),
    "damaged": (lambda f, t: faults.damaged(f, 0.1), {"damaged_lan"}, set()),
    "out of order": (lambda f, t: faults.reordered(f, 0.15), set(), set()),
    "later than the latency": (lambda f, t: faults.reordered(f, 0.3), {"late_lan"}, set()),
    "nonsense between": (lambda f, t: faults.fuzz(f, 0.3), {"damaged_lan"}, {"silent_lan"}),
}


@pytest.mark.parametrize("name", CASES)
def test_each_fault_has_its_alarm(name, log, feed, bridge):
    """Contract: the alarms that the fault calls for, no other; as many rows as the ship has, in the order of time and all filtered; each
    sentence is counted once, as good or by what is wrong with it."""
    fault, needed, may = CASES[name]
    watch = Watch(bridge).play(fault(feed, feed[0][0] + 10))
    found = set(watch.alarms) - FIRST
    assert needed <= found <= needed | may
    assert len(watch.rows) == len(log.table) and watch.estimator.dropped == 0
    assert watch.estimator.states is not None and np.isfinite(watch.estimator.states["north_m"]).all()
    counts = watch.intake.counts[faults.CHANNEL]
    assert counts["sentences"] == sum(n for k, n in counts.items() if k not in NOT_FAULTS)
    assert np.isfinite([list(row.values.values()) for row in watch.rows[:1]]).all()


def test_what_is_whole_among_nonsense_is_in_the_rows(feed, bridge):
    """Oracle: the rows of the feed without the nonsense: every value of a whole sentence is in its row."""
    plain = Watch(bridge).play(feed[:1500]).rows
    fuzzed = Watch(bridge).play(faults.fuzz(feed[:1500], 0.5, seed=7)).rows
    names = [n for n in plain[-1].values if n != "heading_deg"]  # invented compasses may be heard first
    assert [[r.values.get(n) for n in names] for r in fuzzed][20:] == [[r.values.get(n) for n in names] for r in plain][
        20:
    ]


def test_the_alarm_of_a_clock_that_was_set_back_ends(feed, bridge):
    """By hand: it is told for a minute of the ship's own time, although the clock that it was noted by is another then."""
    begin = feed[0][0] + 10
    it = Watch(bridge).play(faults.jumped(feed, begin, -7200.0)).intake
    now = it.time(feed[-1][0] - 7200.0)
    assert now == pytest.approx(feed[-1][0], abs=0.1) and it.state().jumped.time == pytest.approx(begin, abs=0.2)
    at = {
        a.code
        for k in (50.0, 70.0)
        for a in of_intake(it.state(), ("bow",), (), begin + k)
        if a.code == "clock_jump" and k > 60
    }
    assert not at and "clock_jump" in {a.code for a in of_intake(it.state(), ("bow",), (), begin + 50.0)}


def test_a_compass_that_falls_silent_disagrees_no_more(bridge):
    """By hand: a second compass 20 degrees off is told of after five of its own headings, not after one that five rows were held
    against, and no more ten seconds after its last."""
    it, t = Intake(bridge), 1_748_736_000.0
    told = {}
    for k in range(300):
        now = t + k / 10
        it.feed(encode_tag("HE0001", now) + encode("HE", "HDT", ["10.0", "T"]), now, faults.CHANNEL)
        if k in (20, *range(50, 80)):
            it.feed(encode_tag("HC0001", now) + encode("HC", "HDT", ["30.0", "T"]), now, faults.CHANNEL)
        it.rows(now)
        told[k] = bool(it.state().disagree)
    assert not any(told[k] for k in range(50)) and told[60] and told[170] and not told[190]


def test_a_wrong_port_and_an_unknown_receiver_are_named(bridge):
    """Contract: what an integrator meets: bytes of another baud rate, and a receiver whose talker is not that of the file."""
    it, t = Intake(bridge), 1_748_736_000.0
    for k in range(60):
        it.feed("\x80\xfe\x1cU\x03", t + k / 10, faults.CHANNEL)
    [alarm] = [a for a in of_intake(it.state(), ("bow", "stern"), ["lan"], t + 6) if a.code == "silent_lan"]
    assert "60 lines came" in alarm.text and "malformed" in alarm.text
    for k in range(60):
        line = encode("GA", "GGA", ["120000.00", "6930.0", "N", "01530.0", "E", "1", *[""] * 8])
        it.feed(line, t + 7 + k / 10, faults.CHANNEL)
    found = {a.code: a for a in of_intake(it.state(), ("bow", "stern"), ["lan"], it.time(t + 14))}
    assert "GA" in found["antenna_source"].text and found["antenna_source"].severity is Severity.warning
