"""Recorded sentence files into logs: the round trip of a simulated log, the clock, who tells what, and one clear line for errors."""

import json
import random
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aspnn.estimation import filter_log
from aspnn.logs.nmea import import_nmea0183
from aspnn.logs.nmea_write import to_nmea
from aspnn.logs.sentences import Fault, encode, encode_tag
from aspnn.records import read_log, write_log
from aspnn.schema import InputError
from aspnn.simulation import read_scenario, simulate_scenario

DATA = Path(__file__).parents[2] / "data"
EXAMPLE = DATA / "maps" / "nmea-example.toml"
SIMULATED = DATA / "maps" / "simulated.toml"
MAP = """
vessel = "cargo90"
zone = "33N"
[antennas]
bow = { source = "GP", station_m = [30.0, 1.0] }
"""


def gga(utc: str, talker="GP", minutes=10.0, quality="1") -> str:
    return encode(talker, "GGA", [utc, f"69{minutes:010.7f}", "N", "01500.0000000", "E", quality, *[""] * 8])


def hdt(angle: float, talker="HE") -> str:
    return encode(talker, "HDT", [f"{angle:.3f}", "T"])


def second(k: float) -> str:
    k = k % 86400
    return f"{int(k // 3600):02d}{int(k // 60 % 60):02d}{k % 60:05.2f}"


@pytest.fixture
def load(tmp_path):
    """Import lines written to a file, by a map of one bow antenna (or by the text of another map)."""

    def load(lines, map=MAP, name="x.nmea", end="\r\n"):
        (tmp_path / "map.toml").write_text(map)
        (tmp_path / name).write_bytes("".join(f"{line}{end}" for line in lines).encode("latin-1"))
        [log] = import_nmea0183([tmp_path / name], tmp_path / "map.toml")
        return log

    return load


def column(log, name) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a column where it has any."""
    known = log.table[name].notna()
    return log.table["time_s"][known].to_numpy(), log.table[name][known].to_numpy()


@pytest.fixture(scope="module")
def voyage():
    scenario = read_scenario(DATA / "scenarios" / "cargo90-test.toml")
    orders = scenario.manoeuvre.model_copy(update={"hold_s": (40.0, 60.0)})
    short = scenario.model_copy(update={"duration_s": 240.0, "manoeuvre": orders})
    [(log, _)] = simulate_scenario(short, 1)
    return log


def check_round_trip(log, back):
    """Half a unit of the last written place: 0.5e-7 minutes, 0.5e-4 of a degree, degree or revolution per minute, m/s2."""
    half = {
        **{f"{a}_{axis}_deg": 0.5e-7 / 60 for a in ("bow", "stern") for axis in ("latitude", "longitude")},
        "heading_deg": 0.5e-4,
        "yaw_rate_deg_s": 0.5e-4 / 60,
        "rudder_order_deg": 0.5e-4,
        "rudder_angle_deg": 0.5e-4,
        "shaft_speed_rps": 0.5e-4 / 60,
        **{f"acceleration_{axis}_m_s2": 0.5e-4 for axis in ("surge", "sway")},
        "time_s": 0.0,
    }
    assert set(half) == set(back.table) == set(log.table)
    for name, bound in half.items():
        np.testing.assert_allclose(back.table[name], log.table[name], rtol=0, atol=bound + 1e-9, err_msg=name)
    assert (back.start, back.zone, back.vessel.stations) == (log.start, log.zone, log.vessel.stations)


def test_round_trip_and_its_states(voyage, tmp_path):
    """Oracle: the simulated log. A centimetre of place, a millimetre per second and 1e-4 degrees are far above what rounding
    does to the states (it moves fixes by 0.1 mm and headings by 5e-5 degrees), and far below the noise of the sensors."""
    file = tmp_path / "voyage.nmea"
    file.write_text("".join(to_nmea(voyage)), newline="")
    [back] = import_nmea0183([file], EXAMPLE)
    check_round_trip(voyage, back)
    assert back.notes["lines"] == back.notes["good"] == 8 * len(voyage) + 241  # ZDA each second
    assert (back.notes["bad"], back.notes["name"], back.voyage) == ({}, "voyage", "voyage")
    expected, found = filter_log(voyage), filter_log(back)
    for name, bound in (("north_m", 1e-2), ("east_m", 1e-2), ("surge_m_s", 1e-3), ("sway_m_s", 1e-3)):
        assert (
            np.abs(found[name] - expected[name])[10:].max() < bound
        )  # the second fix makes a speed of 0.1 mm in 0.1 s
    for name in ("heading_rad", "yaw_rate_rad_s"):
        assert np.abs(found[name] - expected[name]).max() < np.radians(1e-4)


def test_round_trip_without_times_of_reception(voyage, tmp_path):
    """Oracle: the simulated log. One of each kind per fix stands at the fix; ZDA alone tells the day."""
    file = tmp_path / "voyage.txt"
    file.write_text("".join(re.sub(r"^\\.*\\", "", line) for line in to_nmea(voyage)), newline="")
    [back] = import_nmea0183([tmp_path], EXAMPLE)
    check_round_trip(voyage, back)


def test_imported_log_is_a_record(load, tmp_path):
    """Contract: it is written and read again, its notes are plain JSON, its antenna stands where the map says."""
    log = load([gga("120000"), hdt(5), gga("120001", minutes=11)])
    write_log(log, tmp_path / "x.parquet")
    again = read_log(tmp_path / "x.parquet")
    assert again.notes == log.notes == json.loads(json.dumps(log.notes))
    assert again.vessel.stations["bow"] == (30.0, 1.0)
    assert log.start == ""  # nothing told the day


def test_every_line_is_counted(load):
    """Law: good and bad add up to the lines, here one of each kind; nothing bad becomes a value."""
    bad = {
        "no_time": hdt(1),
        "checksum": hdt(90).replace("90", "91"),
        "no_checksum": "$HEHDT,91.0,T",
        "malformed": "no sentence",
        "unknown_sentence": encode("GP", "GSV", ["1", "1", "00"]),
        "invalid_flag": encode("HE", "THS", ["92.0", "V"]),
    }
    good = [gga("120000"), hdt(5), gga("120001"), "", hdt(6)]
    log = load([bad.pop("no_time"), *good, *bad.values()])
    notes = log.notes
    assert notes["bad"] == {fault.value: 1 for fault in Fault}
    assert (notes["lines"], notes["sentences"], notes["good"]) == (10, 10, 4)
    assert notes["first_bad"].startswith("line 7: checksum")
    np.testing.assert_array_equal(column(log, "heading_deg")[1], [5, 6])


def test_fuzzed_recording_never_raises(load, voyage):
    """Fuzz: 10,000 lines, a third of them mangled. The counts add up, and most of the good lines are still there."""
    rng = random.Random(3)
    lines = []
    for _, line in zip(range(10_000), to_nmea(voyage), strict=False):
        line = line.rstrip()
        if rng.random() < 1 / 3:
            place = rng.randrange(len(line))
            junk = "".join(chr(rng.choice((*range(32, 256), 0))) for _ in range(rng.randrange(3)))
            line = line[:place] + junk + line[place + rng.randrange(4) :]
        lines.append(line + ("" if rng.random() < 0.01 else "\r\n"))
    notes = load(lines, SIMULATED.read_text(), end="").notes  # by sources: a mangled TAG block leaves the talker alone
    assert notes["good"] + sum(notes["bad"].values()) == notes["sentences"] >= notes["lines"] > 9800
    assert 6500 < notes["good"] < 8000


def test_midnight_and_rows_of_their_own(load):
    """Oracle: by hand. Ten headings between fixes a second apart stand 0.1 s apart, over midnight of the RMC's day."""
    lines = [encode("GP", "RMC", [second(86398), "A", "", "", "", "", "", "", "311299", "", "", "A"])]
    for k in range(86398, 86403):
        lines += [gga(second(k), minutes=10 + k * 1e-5)] + [hdt((k - 86398) + j / 10) for j in range(10)]
    log = load(lines)
    assert log.start == "1999-12-31T23:59:58Z"
    time, heading = column(log, "heading_deg")
    np.testing.assert_allclose(time, np.arange(50) / 10, atol=1e-9)
    np.testing.assert_allclose(heading, time, atol=1e-9)
    np.testing.assert_allclose(column(log, "bow_latitude_deg")[0], range(5), atol=1e-9)
    assert len(log) == 50  # the rows of fixes are rows of headings too


def test_headings_in_a_gap_are_left_out(load):
    """A recorder that stopped for an hour: the headings between the last fix and the first new one belong to neither."""
    lines = []
    for k in [*range(5), *range(3600, 3605)]:
        lines += [gga(second(k))] + [hdt(k % 360)] * (2 if k == 4 else 1)
    log = load(lines)
    assert log.notes["bad"] == {"no_time": 2}
    np.testing.assert_allclose(column(log, "heading_deg")[0], [0, 1, 2, 3, *range(3600, 3605)])


def test_clock_runs_on_without_a_fix(load):
    """GGA of quality 0 gives no position, but its time places the headings; before the first fix it does not count."""
    lines = [line for k in range(4) for line in (gga(f"03000{k}", quality="0"), hdt(1))] + [gga("120000"), hdt(2)]
    for k in range(1, 6):
        lines += [gga(f"12000{k}", quality="0"), hdt(2 + k)]
    log = load([*lines, gga("120006")])
    np.testing.assert_allclose(column(log, "heading_deg"), [range(6), range(2, 8)])
    assert len(column(log, "bow_latitude_deg")[0]) == 2
    assert log.notes["bad"] == {"invalid_flag": 9, "no_time": 4}


def test_stray_times_are_left_out(load):
    """A damaged day, time of day or time of reception whose checksum fits by chance moves nothing else."""
    rmc = ["A", "", "", "", "", "", ""]
    lines = []
    for k in range(20):
        day = "010120" if k not in (0, 11) else "010199"
        lines += [encode("GP", "RMC", [second(43200 + k), *rmc, day, "", "", "A"]), gga(second(43200 + k)), hdt(k)]
    lines[33:33] = [gga("180000"), f"{encode_tag(time=2e9)}{hdt(400)}"]
    log = load(lines)
    np.testing.assert_allclose(column(log, "heading_deg"), [range(20), range(20)])
    assert (log.start, len(log)) == ("2020-01-01T12:00:00Z", 20)


@pytest.mark.parametrize("ahead", [0.0, 7200.4, -3.25])
def test_times_of_reception(load, ahead):
    """Oracle: by hand. A logger's clock that is off (or in local time) is set by the satellites'; small latency stays."""
    lines = []
    for k in range(20):
        at = 1577836800 + 43200 + ahead + k
        lines += [f"{at + 0.05:.3f} {gga(second(43200 + k))}", f"{at + 0.3:.3f} {hdt(k)}"]
    log = load(lines)
    latency = 0.05 if ahead else 0.0  # what is taken off is the median, with the latency of the fixes
    np.testing.assert_allclose(column(log, "heading_deg")[0], np.arange(20) + 0.3 - latency, atol=2e-5)
    assert log.start == "2020-01-01T12:00:00Z"
    assert log.notes.get("logger_clock_ahead_s", 0.0) == pytest.approx(ahead + latency if ahead else 0, abs=1e-3)


def test_whole_seconds_of_reception_only_give_the_day(load):
    """Four headings a second stay four, although the logger wrote whole seconds."""
    lines = []
    for k in range(5):
        stamp = f"2020-01-01T12:00:0{k}Z,"
        lines += [stamp + gga(f"12000{k}")] + [stamp + hdt(k + j / 4) for j in range(4)]
    log = load(lines)
    time, heading = column(log, "heading_deg")
    np.testing.assert_allclose(time, heading, atol=1e-9)
    assert (len(time), log.start) == (20, "2020-01-01T12:00:00Z")


def test_start_of_the_map_gives_the_day(load):
    log = load([gga("235959"), gga("000000")], f'start = "2025-06-01T22:00:00Z"\n{MAP}')
    assert (log.start, log.table["time_s"].tolist()) == ("2025-06-01T23:59:59Z", [0, 1])


def test_receivers_of_one_talker_are_told_apart_by_tag(load):
    """Two receivers say GP; their TAG blocks tell them apart, and the talker alone is refused."""
    lines = [
        encode_tag(tag) + gga(f"12000{k}", minutes=m) for k in (0, 1) for tag, m in (("GP0001", 10), ("GP0002", 20))
    ]
    tagged = MAP.replace('"GP"', '"GP0001"') + 'stern = { source = "GP0002", station_m = [-30.0, 0.0] }\n'
    log = load(lines, tagged)
    np.testing.assert_allclose(log.table["bow_latitude_deg"], 69 + 10 / 60)
    np.testing.assert_allclose(log.table["stern_latitude_deg"], 69 + 20 / 60)
    with pytest.raises(InputError, match="GP0001, GP0002"):
        load(lines)


def test_who_tells_what(load):
    """THS (with its flag) before HDT of the same gyro, the gyro heard most before others, the map's choice before all."""
    lines = []
    for k in range(6):
        mode = "V" if k < 2 else "A"
        ths = encode("HE", "THS", ["10.0", mode])
        lines += [gga(f"12000{k}"), *([ths] if k < 5 else []), hdt(20), *([hdt(30, "HC")] if k else [])]
    np.testing.assert_array_equal(column(load(lines), "heading_deg")[1], [10] * 3)
    np.testing.assert_array_equal(column(load(lines, MAP + '[sensors]\nheading = "HC"'), "heading_deg")[1], [30] * 5)
    with pytest.raises(InputError, match=r"sensors.heading = 'GP' tells no THS/HDT .*heard from: HC, HE"):
        load(lines, MAP + '[sensors]\nheading = "GP"')


def test_the_fix_sent_most_often_is_taken(load):
    """Ten RMC to a GGA: the position is RMC's, at all its epochs; with as many of both it is GGA's."""
    place = ["6920.0", "N", "01500.0", "E", "", "", "010120", "", "", "A"]
    rmc = [encode("GP", "RMC", [second(k / 10), "A", *place]) for k in range(30)]
    log = load([line for k in range(30) for line in (rmc[k], *([gga(second(k / 10))] if k % 10 == 0 else []))])
    np.testing.assert_allclose(column(log, "bow_latitude_deg")[1], [69 + 20 / 60] * 30)
    log = load([line for k in range(30) for line in (rmc[k], gga(second(k / 10)))])
    np.testing.assert_allclose(column(log, "bow_latitude_deg")[1], [69 + 10 / 60] * 30)


def test_wind_is_turned_by_the_heading_before_it(load):
    """Law: wind from = heading + angle from the bow, never a later heading; relative wind is left, and counted."""
    true = encode("WI", "MWV", ["350.0", "T", "36.0", "K", "A"])
    relative = encode("WI", "MWV", ["10.0", "R", "5.0", "M", "A"])
    lines = [
        f"{1577836800.5 + 10 * k + j / 4:.2f} {text}"
        for k in range(2)
        for j, text in enumerate((gga(second(10 * k)), hdt(30 + k), true, relative))
    ]
    lines += [f"1577836825.25 {true}"]  # fifteen seconds after the last heading
    log = load(lines)
    np.testing.assert_allclose(column(log, "wind_from_true_deg")[1], [20, 21])
    np.testing.assert_allclose(column(log, "wind_speed_true_m_s")[1], [10, 10, 10])
    assert log.notes["relative_wind_not_converted"] == 2


def test_shaft_and_engine(load):
    """The shaft's revolutions are taken, the engine's (perhaps geared) only where the map says so."""
    rpm = [encode("ER", "RPM", [*device, "", "A"]) for device in (("E", "1", "900.0"), ("S", "0", "-90.0"))]
    lines = [gga("120000"), *rpm, gga("120001")]
    assert column(load(lines), "shaft_speed_rps")[1] == [-1.5]
    assert column(load(lines, MAP + '[sensors]\nshaft = "E1"'), "shaft_speed_rps")[1] == [15]
    assert "shaft_speed_rps" not in load([gga("120000"), rpm[0], gga("120001")]).table


def test_orders_are_derived_and_flagged(load, voyage):
    """Oracle: the orders that the simulation gave, which the recording does not hold here."""
    lines = [line.rstrip() for line in to_nmea(voyage) if "ROR" not in line]
    log = load(lines, EXAMPLE.read_text())
    assert "derived from rudder_angle_deg" in log.notes["rudder_order_deg"]
    order = voyage.table["rudder_order_deg"]
    settled = (
        voyage.table["time_s"] < voyage.table["time_s"][order.diff() != 0].iloc[-1]
    )  # the last is still on its way
    differs = np.abs(log.table["rudder_order_deg"] - order)[settled] > 0.6
    assert order[settled].nunique() > 1
    assert differs.mean() < 0.01


def test_scale_and_period(load):
    """The map's factor turns a sensor mounted the wrong way; thinning keeps values at their own times."""
    lines = []
    for k in range(10):
        lines += [gga(second(k / 2)), encode("TI", "ROT", [f"{6 * k}.0", "A"])]
    log = load(lines, f"period_s = 1.0\n{MAP}[scale]\nyaw_rate_deg_s = -1.0\n")
    np.testing.assert_allclose(column(log, "yaw_rate_deg_s"), [range(5), -0.2 * np.arange(5)], atol=1e-9)


def test_simulator_data_only_where_asked(load):
    lines = [gga("120000", quality="8"), encode("HE", "THS", ["10.0", "S"]), gga("120001", quality="8")]
    with pytest.raises(InputError, match="line 1: invalid_flag, GPGGA is flagged simulated"):
        load(lines)
    assert load(lines, f"simulator = true\n{MAP}").notes["good"] == 3


def test_written_sentences_never_round_up_to_the_next(voyage):
    """60 minutes and 360 degrees are never written: what rounds up to them is carried."""
    table = voyage.table.iloc[:2].assign(bow_latitude_deg=-69.99999999999, heading_deg=359.99999)
    text = "".join(to_nmea(replace(voyage, table=table)))
    assert ",7000.0000,S," in text
    assert "$HEHDT,0.0,T" in text


@pytest.mark.parametrize(
    ("lines", "map", "words"),
    [
        (["$HEHDT,1.0,T", "x"], MAP, r"x.nmea: holds no good sentence; line 1: no_checksum"),
        ([], MAP, "x.nmea: holds no good sentence; it is empty"),
        ([hdt(1)], MAP, "x.nmea: no sentence tells the time"),
        ([gga("120000"), gga("120001")], MAP.replace('"GP"', '"GN"'), r"antennas.bow.source = 'GN' .*heard from: GP"),
        ([gga("120000")], MAP, "holds 1 rows"),
        ([gga("120000")], MAP.replace("[30.0", "[-35.0"), "map.toml: stations_m bow and stern lie 0 m apart"),
        ([gga("120000")], MAP.replace('zone = "33N"', ""), "zone: is missing"),
        ([gga("120000")], MAP + "height = 3\n", "antennas.height"),
        ([gga("120000")], f"colour = 1\n{MAP}", "colour: is not a known key"),
        ([gga("120000")], MAP + "[scale]\nyaw = -1\n", "scale.yaw: is not a column"),
        ([gga("120000")], f'start = "yesterday"\n{MAP}', "'yesterday' is no time"),
        ([gga("120000")], MAP + 'stern = { source = "GP", station_m = [1, 0] }\n', "two have the same source"),
    ],
)
def test_errors_are_one_clear_line(load, lines, map, words):
    with pytest.raises(InputError, match=words) as error:
        load(lines, map)
    assert "\n" not in str(error.value)
