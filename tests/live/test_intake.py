"""Lines as they come: the rows of a simulated log back, late and disordered and damaged lines, clocks, tellers, receivers, AIS."""

import math
import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from aspnn.live.config import Bridge, read_bridge
from aspnn.live.intake import Intake
from aspnn.logs.nmea_write import to_nmea
from aspnn.logs.recording import unix
from aspnn.logs.sentences import encode, encode_tag
from aspnn.records import Log
from aspnn.simulation import read_scenario, simulate_scenario

DATA = Path(__file__).parents[2] / "data"
START = unix("2026-11-22T12:00:00Z")
ONE = """
[ship]
vessel = "cargo90"
zone = "33N"
[antennas]
bow = { source = "GP", station_m = [35.0, 0.0] }
"""
TWO = ONE + 'stern = { source = "GN", station_m = [-35.0, 0.0] }\n'
UDP = '[[sources]]\nkind = "udp"\nport = 10110\nname = "lan"\n'


def bridge(tmp_path, text=ONE, more="") -> Bridge:
    (tmp_path / "bridge.toml").write_text(more + text + UDP)
    return read_bridge(tmp_path / "bridge.toml")


@pytest.fixture
def intake(tmp_path):
    """An intake of one bow antenna, or as `text` says; `more` are keys of the whole file."""
    return lambda text=ONE, more="": Intake(bridge(tmp_path, text, more))


@pytest.fixture(scope="module")
def voyage() -> Log:
    scenario = read_scenario(DATA / "scenarios" / "cargo90-test.toml")
    orders = scenario.manoeuvre.model_copy(update={"hold_s": (40.0, 60.0)})
    return next(simulate_scenario(scenario.model_copy(update={"duration_s": 60.0, "manoeuvre": orders}), 1))[0]


def clock(t: float) -> str:
    s = t % 86400
    return f"{int(s // 3600):02d}{int(s // 60 % 60):02d}{s % 60:06.3f}"


def gga(t: float, talker="GP", north=0.0, east=0.0) -> str:
    minutes, east = 30.0 + north / 1852, 30.0 + east / (1852 * math.cos(math.radians(69.5)))
    return encode(talker, "GGA", [clock(t), f"69{minutes:010.7f}", "N", f"015{east:010.7f}", "E", "1", *[""] * 8])


def hdt(angle: float, talker="HE") -> str:
    return encode(talker, "HDT", [f"{angle:.3f}", "T"])


def run(it: Intake, timed, channel="lan", step=0.05):
    """Feed (time of receipt, line) pairs, asking for rows as a bridge does; the rows in the end too."""
    rows, asked = [], -math.inf
    for t, line in timed:
        if t - asked >= step:
            rows += it.rows(t)
            asked = t
        it.feed(line, t, channel)
    return rows + it.rows(it.latest + 10)


def recorded(log: Log):
    return [(float(line.split("c:")[1].split("*")[0]) / 1000, line) for line in to_nmea(log)]


def test_a_simulated_feed_is_the_log_that_it_was_made_of(voyage, tmp_path):
    """Oracle: the simulated log, to half a unit of the last place that a sentence tells; not a sentence is lost."""
    text = TWO.replace('"GP"', '"GP0001"').replace('"GN"', '"GN0001"')
    it = Intake(bridge(tmp_path, text))
    timed = recorded(voyage)
    rows = run(it, timed)
    start = unix(voyage.start)
    np.testing.assert_allclose([r.time - start for r in rows], voyage.table["time_s"], atol=1e-6)
    half = {"heading_deg": 1e-4, "yaw_rate_deg_s": 1e-6, "shaft_speed_rps": 1e-6}
    for name in voyage.table.columns[1:]:
        told = [r.values.get(name, math.nan) for r in rows]
        np.testing.assert_allclose(told, voyage.table[name], rtol=0, atol=half.get(name, 1e-4), err_msg=name)
    assert it.counts["lan"] == {"lines": len(timed), "sentences": len(timed), "good": len(timed)}
    assert it.told_by()["heading"] == "HE0001 HDT" and it.told_by()["stern"] == "GN0001 GGA"
    assert not it.state().disagree and not it.events


def test_rows_leave_when_the_latency_is_over(intake):
    """By hand: 0.2 s after its point of the grid, not before, each row leaves once, and what comes later is counted as late."""
    it = intake()
    it.feed(gga(START), START + 0.05, "lan")
    it.feed(hdt(10), START + 0.02, "lan")
    assert it.rows(START + 0.19) == []
    [row] = it.rows(START + 0.2)
    assert row.time == START and set(row.values) == {"bow_latitude_deg", "bow_longitude_deg", "heading_deg"}
    it.feed(gga(START), START + 0.21, "lan")
    assert it.rows(START + 5) == [] and it.counts["lan"]["late"] == 1


def test_reordered_datagrams_make_the_same_rows(voyage, tmp_path):
    """Law: lines shuffled within 0.15 s, with the times of their TAG blocks, are the rows of the ordered feed."""
    text = TWO.replace('"GP"', '"GP0001"').replace('"GN"', '"GN0001"')
    timed, rng = recorded(voyage), random.Random(3)
    mixed = sorted(((t + rng.uniform(0, 0.15), line) for t, line in timed), key=lambda pair: pair[0])
    a, b = Intake(bridge(tmp_path, text)), Intake(bridge(tmp_path, text))
    first, other = run(a, timed), run(b, mixed)
    assert [r.time for r in other] == [r.time for r in first]
    assert [r.values for r in other][20:] == [r.values for r in first][
        20:
    ]  # whole-second stamps are not trusted at first
    assert b.counts["lan"]["out_of_order"] > 0 and b.counts["lan"]["good"] == len(timed)


def test_damaged_merged_and_bare_lines(intake):
    """By hand: what is good on a line is taken, the rest is counted by its class; datagrams with the header of IEC 61162-450."""
    it = intake()
    good = gga(START)
    bad = good[:-2] + f"{int(good[-2:], 16) ^ 1:02X}"
    lines = [
        "UdPbC\0" + encode_tag("GP0001", START) + good + "\r\n" + hdt(20) + "\r\n",  # two in a datagram
        hdt(21) + hdt(22),  # merged
        bad,
        good.partition("*")[0],
        encode("GP", "GSV", ["1"]),
        encode("HE", "HDT", ["x", "T"]),
        encode("TI", "ROT", ["5", "V"]),
        "noise",
        "\\s:X*00\\" + good,
        "x" * 5000,
        "{" * 4000,
    ]
    for line in lines:
        it.feed(line, START + 0.01, "lan")
    assert it.counts["lan"] == Counter(
        {
            "lines": 12,
            "sentences": 13,
            "good": 4,
            "checksum": 2,
            "no_checksum": 1,
            "unknown_sentence": 1,
            "malformed": 4,
            "invalid_flag": 1,
        }
    )
    assert [r.values.get("heading_deg") for r in it.rows(START + 9)] == [20.0]


def test_a_fuzzed_feed_never_raises_and_stays_small(voyage, intake):
    """Law: 6 000 damaged, cut, merged and invented lines at disordered times: no exception, bounded stores, rising rows."""
    rng, it, rows = random.Random(1), intake(TWO), []
    lines = [line for _, line in recorded(voyage)]
    t = START
    for _ in range(6_000):
        line = rng.choice(lines)
        kind = rng.random()
        if kind < 0.3:
            at = rng.randrange(len(line))
            line = line[:at] + chr(rng.randrange(1, 256)) + line[at + rng.randrange(3) :]
        elif kind < 0.4:
            line = line[: rng.randrange(len(line))] + rng.choice(lines)
        elif kind < 0.5:
            line = encode_tag(f"X{rng.randrange(10**6)}", t) + encode(
                "".join(rng.choices("ABCXYZ", k=2)), "HDT", [f"{rng.random() * 400:.2f}", "T"]
            )
        elif kind < 0.55:
            parts = [
                rng.randrange(1, 10),
                rng.randrange(1, 10),
                rng.randrange(10),
                rng.randrange(10**6),
                "w" * rng.randrange(60),
                0,
            ]
            line = encode("AI", "VDM", [str(part) for part in parts]).replace("$", "!")
        t += rng.uniform(-0.01, 0.05) if rng.random() > 1e-3 else rng.uniform(-100, 100)
        it.feed(line, t, "lan")
        rows += it.rows(t)
    assert len(it._tellers._heard) <= 256 and len(it._clocks._senders) <= 64 and len(it._parts.waiting) <= 101
    assert len(it._waiting) <= 600 and len(it._newest) <= 1001 and len(it.counts["lan"]) < 30
    assert len(rows) > 500 and it.counts["lan"]["sentences"] == sum(
        v for k, v in it.counts["lan"].items() if k not in ("lines", "sentences", "out_of_order", "rows_lost")
    )


def feed_fixes(it, begin, seconds, off=0.0, ahead=0.0, rate=10):
    """Fixes and headings, received 20 ms late by a clock that is `ahead` of UTC; the receiver's clock is `off`."""
    rows = []
    for k in range(int(seconds * rate)):
        t = begin + k / rate
        it.feed(gga(t + off), t + ahead + 0.02, "lan")
        it.feed(encode("GP", "ZDA", [clock(t + off), "22", "11", "2026"]), t + ahead + 0.02, "lan")
        it.feed(hdt(10 + k % 7), t + ahead + 0.001, "lan")
        rows += it.rows(t + ahead + 0.03)
    return rows


def test_the_computers_clock_may_be_wrong(intake):
    """By hand: an hour and a half ahead; rows stand at UTC all the same, headings with their fixes, and it is told once."""
    it = intake()
    rows = feed_fixes(it, START, 6.0, ahead=5400.0)
    assert rows[5].time == pytest.approx(START + 0.5, abs=0.11) and len(rows) > 50
    assert all(r.values.keys() >= {"heading_deg", "bow_latitude_deg"} for r in rows[3:])
    assert [e.code for e in it.events] == ["clock_off"]


def test_a_receivers_clock_that_jumps(intake):
    """By hand: 18 s on after 5 s. Rows go on without a gap longer than the five sentences take, nothing runs back; an event tells it."""
    it = intake()
    rows = feed_fixes(it, START, 5.0) + feed_fixes(it, START + 5.0, 5.0, off=18.0)
    times = np.array([r.time for r in rows])
    assert np.diff(times).min() > 0 and np.diff(times).max() < 0.2 and times[-1] == pytest.approx(START + 9.8, abs=0.15)
    assert [e.code for e in it.events] == ["clock_jump"] and it.state().jumped.text.startswith(
        "the clock of GP jumped by +18.0 s"
    )
    without = [r for r in rows if "bow_latitude_deg" not in r.values]
    assert len(without) <= 5


def test_a_clock_of_receipt_that_is_set_back_begins_anew(intake):
    """Law: nothing is lost for ever: rows come again within a second, and the event tells it."""
    it = intake()
    feed_fixes(it, START, 3.0)
    again = feed_fixes(it, START - 7200.0, 3.0)
    assert len(again) > 20 and "clock_jump" in [e.code for e in it.events]


def test_one_wild_time_is_passed_over(intake):
    """By hand: a fix whose time is ten minutes off is not placed; the rows around it are as without it."""
    it = intake()
    rows = feed_fixes(it, START, 2.0)
    it.feed(gga(START + 602), START + 2.0, "lan")
    rows += feed_fixes(it, START + 2.0, 2.0)
    assert np.diff([r.time for r in rows]).max() < 0.11 and it.counts["lan"]["no_time"] == 1 and not it.events


def test_midnight(intake):
    """By hand: GGA alone tells no day; across midnight the rows go on."""
    it, rows, midnight = intake(), [], unix("2026-11-23T00:00:00Z")
    for k in range(-20, 20):
        t = midnight + k / 10
        it.feed(gga(t), t + 0.02, "lan")
        rows += it.rows(t + 0.03)
    np.testing.assert_allclose(np.diff([r.time for r in rows]), 0.1, atol=1e-5)


def test_the_sensor_heard_most_tells_until_it_falls_silent(intake):
    """By hand: a gyro at 10 Hz before a compass at 2 Hz; when the gyro is silent the compass takes over
    within four seconds (2 of SILENT, 1 until it is judged, 0.5 and the latency)."""
    it = intake()
    for k in range(100):
        t = START + k / 10
        it.feed(hdt(10, "HE"), t, "lan")
        if k % 5 == 0:
            it.feed(hdt(12, "HC"), t, "lan")
    assert {r.values["heading_deg"] for r in it.rows(START + 10.1)} == {10.0}
    took = None
    for k in range(100, 220):
        t = START + k / 10
        if k % 5 == 0:
            it.feed(hdt(12, "HC"), t, "lan")
        took = took or next((r.time for r in it.rows(t)), None)
    assert took is not None and took - START <= 14.0 and it.told_by()["heading"] == "HC HDT"


def test_a_chosen_sensor_is_the_only_one_that_tells(intake):
    """Contract: sensors.heading names who is taken, however seldom it is heard."""
    it = intake(ONE + '[sensors]\nheading = "HC"\n')
    for k in range(50):
        it.feed(hdt(10, "HE"), START + k / 10, "lan")
    it.feed(hdt(12, "HC"), START + 5, "lan")
    assert [r.values for r in it.rows(START + 6)] == [{"heading_deg": 12.0}]


def test_wind_pitch_and_scale_are_as_in_imported_logs(intake):
    """By hand: wind from 30 deg on the bow of a ship on 350; 50 % of a pitch ratio of 0.8; a rate sensor mounted upside down."""
    text = ONE.replace('zone = "33N"', 'zone = "33N"\nfull_pitch_ratio = 0.8') + "[scale]\nyaw_rate_deg_s = -1\n"
    it = intake(text)
    lines = (
        hdt(350),
        encode("WI", "MWV", ["30", "T", "10", "M", "A"]),
        encode("ER", "RPM", ["S", "0", "120", "50", "A"]),
        encode("TI", "ROT", ["30", "A"]),
    )
    for line in lines:
        it.feed(line, START, "lan")
    [row] = it.rows(START + 1)
    assert row.values == pytest.approx(
        {
            "heading_deg": 350,
            "wind_speed_true_m_s": 10,
            "wind_from_true_deg": 20,
            "shaft_speed_rps": 2,
            "propeller_pitch_ratio": 0.4,
            "yaw_rate_deg_s": -0.5,
        }
    )
    it.feed(lines[1], START + 5, "lan")  # the heading is too old now
    [row] = it.rows(START + 6)
    assert set(row.values) == {"wind_speed_true_m_s"}


def antennas(it, k, apart, heading=0.0):
    t = START + k / 10
    it.feed(gga(t, "GP", north=35.0), t, "lan")
    it.feed(gga(t, "GN", north=35.0 - apart), t, "lan")
    it.feed(hdt(heading), t, "lan")


def test_two_antennas_that_disagree(intake):
    """By hand: on 000 bow and stern are 70 m apart, north and south; a stern 30 m off is told after five rows and untold after ten good."""
    it = intake(TWO)
    for k in range(80):
        antennas(it, k, 100.0 if 20 <= k < 40 else 70.0)
        it.rows(START + k / 10)
        since = it.state().disagree
        if k in (15, 23, 60):
            assert not since
        if k == 35:
            assert since["bow stern"].since == pytest.approx(START + 2.0) and "30 m" in since["bow stern"].text
    assert [e.code for e in it.events] == ["disagree", "agree"]
    for k in range(80, 100):  # the same length across the heading
        antennas(it, k, 70.0, heading=90.0)
    it.rows(START + 20)
    assert "bow stern" in it.state().disagree


def test_two_compasses_that_disagree(intake):
    """By hand: 12 degrees across north are told; 3 are not."""
    for angle, told in ((6.0, True), (357.0, False)):
        it = intake(ONE + '[sensors]\nheading = "HE"\n')
        for k in range(30):
            t = START + k / 10
            it.feed(hdt(354.0, "HE"), t, "lan")
            it.feed(hdt(angle, "HC"), t, "lan")
            it.rows(t)
        assert ("heading HC" in it.state().disagree) is told


def test_ais_is_handed_on(intake):
    """Oracle: a widely published example and its decoding: MMSI 371798000, speed 12.3 kn, heading 215 (recalled)."""
    pytest.importorskip("pyais")
    it = intake()
    line = "!AIVDM,1,1,,A,15RTgt0PAso;90TKcjM8h6g208CQ,0*4A"
    it.feed(line, START, "lan")
    it.feed(line[:-1] + "B", START, "lan")
    [ais] = it.targets_in
    assert (ais.said.mmsi, ais.own, ais.time, ais.channel) == (371798000, False, START, "lan")
    assert ais.said.speed_m_s == pytest.approx(12.3 * 1852 / 3600) and ais.said.heading_deg == 215
    assert it.counts["lan"] == {"lines": 2, "sentences": 2, "good": 1, "checksum": 1}


def test_wind_of_nmea_2000(tmp_path):
    """By hand: canboat's five references of parameter group 130306 (the texts of its WIND_REFERENCE); the two that tell true wind over a
    known direction are taken, from the bow with the heading; the others are counted, and none of their numbers is in a row."""
    text = ONE.split("[antennas]")
    (tmp_path / "bus.json").write_text("")
    (tmp_path / "b.toml").write_text("[antennas]".join(text) + '[[sources]]\nkind = "n2k"\npath = "bus.json"\n')
    bus = read_bridge(tmp_path / "b.toml")
    form = '{"timestamp":"2026-11-22T12:00:0%.1fZ","src":%d,"pgn":%d,"fields":{%s}}'
    wind = '"SID":1,"Wind Speed":%s,"Wind Angle":%s,"Reference":"%s"'
    heading = (5, 127250, '"Heading": 350.0, "Reference":"True"')
    references = {
        "True (ground referenced to North)": 40.0,
        "True (boat referenced)": 30.0,
        "Magnetic (ground referenced to Magnetic North)": None,
        "Apparent": None,
        "True (water referenced)": None,
        "": None,
    }
    for reference, expected in references.items():
        it = Intake(bus)
        it.feed(form % (0.1, *heading), START + 0.1, "n2k")
        it.feed(form % (0.1, 9, 130306, wind % (8.5, 40.0, reference)), START + 0.1, "n2k")
        [row] = it.rows(START + 1)
        if expected is None:
            assert set(row.values) == {"heading_deg"} and it.counts["n2k"]["unknown_sentence"] == 1
        else:
            assert row.values == pytest.approx(
                {"heading_deg": 350.0, "wind_speed_true_m_s": 8.5, "wind_from_true_deg": expected}
            )
    both = Intake(bus)  # a sender of both is taken at one of them
    for k in range(30):
        both.feed(form % (k / 10, *heading), START + k / 10, "n2k")
        for reference, angle in (("True (boat referenced)", 30.0), ("True (ground referenced to North)", 20.0)):
            both.feed(form % (k / 10, 9, 130306, wind % (8.5, angle, reference)), START + k / 10, "n2k")
    assert {r.values.get("wind_from_true_deg") for r in both.rows(START + 9)} == {20.0}


def test_decoded_nmea_2000(tmp_path):
    """By hand: canboat's JSON lines as its analyzer writes them; magnetic headings do not count."""
    text = ONE.replace('"GP"', '"3"').split("[antennas]")
    (tmp_path / "bus.json").write_text("")
    (tmp_path / "b.toml").write_text(
        "[antennas]".join(text) + '[[sources]]\nkind = "n2k"\npath = "bus.json"\nname = "bus"\n'
    )
    it = Intake(read_bridge(tmp_path / "b.toml"))
    form = (
        '{"timestamp":"2026-11-22T12:00:00.100Z","prio":2,"src":%d,"dst":255,"pgn":%d,"description":"x","fields":{%s}}'
    )
    said = [
        (3, 129025, '"Latitude": 69.5, "Longitude": 15.5'),
        (5, 127250, '"SID":1,"Heading": 81.8, "Reference":"True"'),
        (6, 127250, '"SID":1,"Heading": 99.0, "Reference":"Magnetic"'),
        (5, 127251, '"Rate": -0.25'),
        (7, 127245, '"Position": 4.5, "Angle Order": 5.0'),
    ]
    for source, group, fields in said:
        it.feed(form % (source, group, fields), START + 0.1, "bus")
    [row] = it.rows(START + 1)
    expected = {
        "bow_latitude_deg": 69.5,
        "bow_longitude_deg": 15.5,
        "heading_deg": 81.8,
        "yaw_rate_deg_s": -0.25,
        "rudder_angle_deg": 4.5,
    }
    assert row.values == pytest.approx({**expected, "rudder_order_deg": 5.0})
    assert it.counts["bus"]["invalid_flag"] == 1
