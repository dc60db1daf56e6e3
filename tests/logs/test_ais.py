"""AIS importer: sentences composed with pyais and read back; what ITU-R M.1371 says of fields; broken files; ships that share a number."""

import math
import random
import sys
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aspnn.estimation import filter_log
from aspnn.frames import Zone, to_grid
from aspnn.logs.ais import import_ais
from aspnn.logs.ais_messages import Undecodable, read_message
from aspnn.logs.sentences import checksum, encode_tag
from aspnn.schema import InputError

pyais = pytest.importorskip("pyais", reason="pyais is not installed (pip install 'aspnn[ais]')")

T0 = datetime(2025, 6, 1, 12, tzinfo=UTC).timestamp()
MMSI = 257123456
KNOT = 1852 / 3600
NONE = {"lat": 91.0, "lon": 181.0, "speed": 102.3, "course": 360.0, "heading": 511, "turn": -128, "second": 60}


def ais(kind: int = 1, mmsi: int = MMSI, **fields) -> list[str]:
    """Sentences of a message; what a position report does not name is unavailable."""
    told = {**NONE, **fields} if kind in (1, 2, 3, 18, 19) else fields
    return pyais.encode_dict({"type": kind, "mmsi": mmsi, **told}, sentence_type="VDM", seq_id=fields.get("seq", 1))


def report(time: float, north: float = 0.0, east: float = 0.0, mmsi: int = MMSI, late: float = 0.7, **fields) -> str:
    """A line with a TAG block: a class A report of a place [m] from 60 N 10 E at `time` [s] after T0, received `late` [s] after."""
    lat, lon = 60 + north / 111_412, 10 + east / 55_800
    told = {"lat": lat, "lon": lon, "second": int(time) % 60, "speed": 10.0, "course": 0.0, **fields}
    return encode_tag("station", T0 + time + late) + ais(1, mmsi, **told)[0]


def voyage(count: int = 12, every: float = 10.0, mmsi: int = MMSI, **fields) -> list[str]:
    """Reports of a ship that goes north at 10 kn."""
    return [report(every * k, 10 * KNOT * every * k, mmsi=mmsi, **fields) for k in range(count)]


def imported(folder, lines, name="harbour.nmea", **options):
    file = folder / name
    file.write_bytes("\n".join(lines).encode("latin-1"))
    return import_ais([file], **options)


def test_a_report_comes_through_with_its_units(tmp_path):
    """By construction: every field that pyais encodes is in the log, within half a unit of ITU-R M.1371's coding."""
    lines = [
        report(t, 6.0 * t, 5.0 * t, speed=12.3, course=123.4, heading=119, turn=(10 / 4.733) ** 2) for t in (0, 7, 12)
    ]
    (log,) = imported(tmp_path, lines)
    table = log.table
    assert table["time_s"].tolist() == [0, 7, 12] and log.start == "2025-06-01T12:00:00Z"
    unit = 0.5 / 600_000
    np.testing.assert_allclose(table["gnss_latitude_deg"], 60 + 6 * table["time_s"] / 111_412, rtol=0, atol=unit)
    np.testing.assert_allclose(table["gnss_longitude_deg"], 10 + 5 * table["time_s"] / 55_800, rtol=0, atol=unit)
    units = table["gnss_latitude_deg"] * 600_000  # whole, where pyais rounds degrees to six decimals
    np.testing.assert_allclose(units, np.round(units), rtol=0, atol=1e-6)
    np.testing.assert_allclose(table["speed_over_ground_m_s"], 12.3 * KNOT)
    np.testing.assert_allclose(table["course_over_ground_deg"], 123.4)
    np.testing.assert_allclose(table["heading_deg"], 119)
    np.testing.assert_allclose(table["yaw_rate_deg_s"], (10 / 4.733) ** 2 / 60)
    assert log.notes["mmsi"] == MMSI and log.zone == Zone(32) and log.notes["received_later_s"].startswith("0.7")


def test_rate_of_turn_codes():
    """ITU-R M.1371: ROT_AIS = 4.733 sqrt(degrees per minute), 127 and -127 turning without a figure, -128 not told.

    Worked: 20 degrees per minute are sent as 21, and 708 as 126. Finer than pyais's own whole degrees per minute.
    """
    for code in range(-128, 128):
        (sentence,) = ais(turn=float(code) if abs(code) > 126 else math.copysign((code / 4.733) ** 2, code))
        said = read_message((sentence.encode(),), pyais)
        if abs(code) <= 125:
            assert said.yaw_rate_deg_s * 60 == pytest.approx(math.copysign((code / 4.733) ** 2, code), abs=1e-12)
        else:
            assert math.isnan(said.yaw_rate_deg_s)
        assert said.turning == (abs(code) in (126, 127))
    assert round(4.733 * math.sqrt(20)) == 21 and round(4.733 * math.sqrt(708)) == 126


def test_unavailable_is_absent_and_what_was_not_measured_is_left_out(tmp_path):
    """ITU-R M.1371: latitude 91, longitude 181, speed 1023, course 3600, heading 511 and rate -128 are no values; the seconds 61
    to 63 mark manual positions, dead reckoning and a receiver that is out of order."""
    lines = [*voyage(3), report(30, **NONE), report(33, 50.0, second=62)]
    (log,) = imported(tmp_path, lines)
    assert set(log.table) == {
        *("time_s", "gnss_latitude_deg", "gnss_longitude_deg"),
        *("course_over_ground_deg", "speed_over_ground_m_s"),
    }
    assert len(log.table) == 4 and log.table.iloc[3, 1:].isna().all()
    assert log.table["time_s"].iloc[3] == pytest.approx(30.7)  # without a second of its own: when it was received
    assert log.notes["not_measured_dropped"] == 1


def test_published_examples():
    """The example sentences of pyais's own documentation and of gpsd's page on AIVDM, with the values they state there."""
    said = read_message((b"!AIVDM,1,1,,A,15M67FC000G?ufbE`FepT@3n00Sa,0*5C",), pyais)
    assert (said.mmsi, said.speed_m_s, said.course_deg, said.heading_deg, said.second) == (366053209, 0, 219.3, 1, 59)
    assert (said.latitude_deg, said.longitude_deg) == pytest.approx((37.802118, -122.341618), abs=5e-7)
    parts = (
        b"!AIVDM,2,1,1,A,55?MbV02;H;s<HtKR20EHE:0@T4@Dn2222222216L961O5Gf0NSQEp6ClRp8,0*1C",
        b"!AIVDM,2,2,1,A,88888888880,2*25",
    )
    said = read_message(parts, pyais)
    assert (said.mmsi, said.name, said.size, said.draught) == (351759000, "EVER DIADEM", (225, 70, 1, 31), 12.2)


@pytest.mark.parametrize(
    "form",
    [
        "{iso}Z {s}",
        "[{iso}] {s}",
        "{iso}+00:00;{s}",
        "{unix:.3f} {s}",
        "{unix:.3f},{s}",
        "{ms} {s}",
        "{tag}{s}",
        "{s},{unix:.1f}",
        "{s},r003669959,{unix:.0f}",
        "{s},s20683,d-099,T59.86,x5,r003669947,{unix:.0f}",
        "{s} {iso}Z",
        "{gatehouse}\n{s}",
    ],
)
def test_the_time_stands_where_people_write_it(tmp_path, form):
    """Every form of line tells the time of receipt, to which the report's own second is unwrapped: here 3 s late, over midnight."""
    lines, start = [], datetime(2025, 6, 1, 23, 59, 40, tzinfo=UTC).timestamp()
    for k in range(5):
        at = start + 10 * k
        moment = datetime.fromtimestamp(at + 3.25, UTC)
        milli = moment.microsecond // 1000
        body = f"PGHP,1,{moment:%Y,%m,%d,%H,%M,%S},{milli},219,,2190047,1,2A"
        (s,) = ais(lat=60 + 0.0005 * k, lon=10.0, second=int(at) % 60)
        words = {
            "s": s,
            "iso": moment.isoformat(timespec="milliseconds")[:23],
            "unix": at + 3.25,
            "ms": round((at + 3.25) * 1000),
            "tag": encode_tag("x", at + 3.25),
            "gatehouse": f"${body}*{checksum(body):02X}",
        }
        lines.append(form.format(**words))
    (log,) = imported(tmp_path, lines)
    assert log.start == "2025-06-01T23:59:40Z" and log.table["time_s"].tolist() == [0, 10, 20, 30, 40]
    assert "bad" not in log.notes["recording"]


def test_latency_is_taken_out(tmp_path):
    """A report stands at its own second however late it came: delays of 0 to 20 s on one clock, a logger 40 s fast on another."""
    rng = random.Random(3)
    for ahead in (0.0, 40.0, -25.0):
        lines = [report(10 * k, 50.0 * k, late=ahead + rng.uniform(0, 20)) for k in range(30)]
        (log,) = imported(tmp_path, lines)
        np.testing.assert_array_equal(np.diff(log.table["time_s"]), 10.0)
        if ahead == 0.0:
            assert log.start == "2025-06-01T12:00:00Z"


def test_all_ships_are_put_into_the_same_minute(tmp_path):
    """A feed that is half a minute late: ships whose delays lie on either side of 30 s stay together, as they were."""
    lines = [
        line for k, late in enumerate((28.5, 29.5, 30.5, 31.5)) for line in voyage(6, mmsi=257000001 + k, late=late)
    ]
    logs = imported(tmp_path, lines)
    assert [log.start for log in logs] == ["2025-06-01T12:00:00Z"] * 4


def test_a_base_station_dates_what_nobody_timed(tmp_path):
    """Messages 4 tell date and time; reports around them follow by their seconds, before and after, and over a gap to the next."""
    moment = datetime.fromtimestamp(T0 + 35, UTC)
    base = ais(4, 2570001, **{n: getattr(moment, n) for n in ("year", "month", "day", "hour", "minute", "second")})[0]
    later = datetime.fromtimestamp(T0 + 635, UTC)
    again = ais(4, 2570001, **{n: getattr(later, n) for n in ("year", "month", "day", "hour", "minute", "second")})[0]
    lines = [ais(lat=60 + 1e-3 * k, lon=10.0, second=10 * k % 60)[0] for k in range(8)]
    far = [ais(lat=60.1 + 1e-3 * k, lon=10.0, second=10 * k % 60)[0] for k in range(4, 8)]
    (log,) = imported(tmp_path, [*lines[:4], base, *lines[4:], again, *far])
    # Nobody can tell which of the reports between the two base stations came before the gap: they have no time.
    assert log.start == "2025-06-01T12:00:00Z"
    assert log.table["time_s"].tolist() == [0, 10, 20, 30, 640, 650, 660, 670]
    assert log.notes["recording"]["reports_without_time"] == 4
    (log,) = imported(tmp_path, [*lines[:4], base, *lines[4:]])
    assert log.table["time_s"].tolist() == [0, 10, 20, 30, 40, 50, 60, 70]


def test_a_base_station_sets_a_logger_that_runs_an_hour_ahead(tmp_path):
    """By construction: the logger's stamps are an hour fast against the base station's time, the fixes stand at UTC."""
    moment = datetime.fromtimestamp(T0 + 15, UTC)
    said = {n: getattr(moment, n) for n in ("year", "month", "day", "hour", "minute", "second")}
    base = encode_tag("s", T0 + 15 + 3600.5) + ais(4, 2570001, **said)[0]
    lines = voyage(4, late=3600.9)
    (log,) = imported(tmp_path, [*lines[:2], base, *lines[2:]])
    assert log.start == "2025-06-01T12:00:00Z" and log.notes["recording"]["logger_clock_ahead_s"] == 3600.5


def test_a_file_without_any_time_has_no_date(tmp_path):
    """The seconds alone unwrap over the minute; the log has no start."""
    lines = [ais(lat=60 + 1e-3 * k, lon=10.0, second=(50 + 7 * k) % 60)[0] for k in range(12)]
    (log,) = imported(tmp_path, lines)
    assert log.start == "" and log.table["time_s"].tolist() == [7 * k for k in range(12)]
    (tmp_path / "other.nmea").write_text("\n".join(lines))
    with pytest.raises(InputError, match="import them one by one"):
        import_ais([tmp_path])


def test_parts_of_messages_may_be_mixed(tmp_path):
    """Static data of two ships in parts that alternate, one back to front: each ship has its own; a part alone is counted."""
    a = ais(5, 257000001, shipname="NORDLYS", to_bow=80, to_stern=20, to_port=5, to_starboard=11, seq=1)
    b = ais(5, 257000002, shipname="VESTFJORD", to_bow=5, to_stern=15, to_port=3, to_starboard=3, draught=2.5, seq=2)
    c = ais(5, 257000003, shipname="LOST", to_bow=50, to_stern=15, seq=3)
    lines = [a[0], b[1], *voyage(3, mmsi=257000001), c[0], b[0], *voyage(3, mmsi=257000002), a[1]]
    first, second = imported(tmp_path, lines)
    assert first.vessel.title == "NORDLYS (MMSI 257000001)" and first.vessel.length == 100
    assert first.vessel.stations["gnss"] == (-30.0, -3.0)  # 80 m abaft the bow of 100 m, 5 m from the port side of 16 m
    assert (second.vessel.length, second.vessel.beam, second.vessel.draught) == (20, 6, 2.5)
    assert second.vessel.stations["gnss"] == (5.0, 0.0)
    assert first.notes["recording"]["bad"] == {"incomplete": 1}
    assert "line 6: incomplete, part 1" in first.notes["recording"]["first_bad"]


def test_parts_of_different_messages_are_not_joined(tmp_path):
    """Numbers of messages come round: a second first part, and a last part 120 lines later, leave what waited incomplete."""
    lost = ais(5, 257000001, shipname="LOST", to_bow=50, to_stern=15)
    good = ais(5, 257000001, shipname="GOOD", to_bow=60, to_stern=15)
    (log,) = imported(tmp_path, [lost[0], *good, *voyage(120, mmsi=257000001), lost[0]])
    assert log.notes["ship"] == "GOOD" and log.notes["recording"]["bad"] == {"incomplete": 2}
    (log,) = imported(tmp_path, [lost[0], *voyage(120, mmsi=257000001), good[1]])
    assert "ship" not in log.notes and log.notes["recording"]["bad"] == {"incomplete": 2}


def test_broken_sentences_are_counted_with_the_first_line(tmp_path):
    """Each fault once: checksum, none, a part beyond the count, cut bits, a TAG block that is damaged, and no sentence at all."""
    good = voyage(6)
    cut = ais()[0].split(",")
    cut[5] = cut[5][:20]
    body = ",".join(cut)[1:].split("*")[0]
    bad = [
        "!AIVDM,1,1,,A,15M67FC000G?ufbE`FepT@3n00Sa,0*5D",
        "!AIVDM,1,1,,A,15M67FC000G?ufbE`FepT@3n00Sa,0",
        f"!AIVDM,2,3,1,A,88888888880,2*{checksum('AIVDM,2,3,1,A,88888888880,2'):02X}",
        f"!{body}*{checksum(body):02X}",
        "\\s:x,c:1*00\\" + ais()[0],
        "nothing",
        "$GPZDA,120000,01,06,2025,00,00*4B",
    ]
    (log,) = imported(tmp_path, [good[0], *bad, *good[1:]])
    counts = log.notes["recording"]
    assert counts["bad"] == {"checksum": 2, "no_checksum": 1, "malformed": 2, "undecodable": 1}
    assert counts["first_bad"].startswith("harbour.nmea line 2: checksum") and counts["other_sentences"] == 1
    assert len(log.table) == 6


@settings(max_examples=150, deadline=None)
@given(st.randoms(use_true_random=False))
def test_no_damage_raises(random):
    """A message whose sentence is altered anywhere, with a checksum that is right again, is read, or Undecodable; never more."""
    kind = random.choice((1, 4, 5, 18, 19, 24, 27))
    payload = list(random.choice((ais(1)[0], ais(18)[0])).split(",")[5])
    for _ in range(random.randint(0, 8)):
        payload[random.randrange(len(payload))] = random.choice(
            "0123456789:;<=>?@ABCDEFGHIJKLMNOPQRSTUVW`abcdefghijklmnopqrstuvw"
        )
    payload[0] = chr(kind + 48)
    text = "".join(payload)[: random.randint(1, 28)] + "0" * random.choice((0, 40, 60))
    body = f"AIVDM,1,1,,A,{text},{random.randint(0, 5)}"
    try:
        said = read_message((f"!{body}*{checksum(body):02X}".encode(),), pyais)
    except Undecodable:
        return
    assert said is not None


def test_any_bytes_are_survived(tmp_path):
    """Random bytes and cut lines among the reports: all good ones come through, and nothing raises."""
    rng = random.Random(7)
    good = voyage(20)
    lines = []
    for line in good:
        lines += [
            bytes(rng.randrange(1, 256) for _ in range(60)).decode("latin-1").replace("\n", " ").replace("!", " ")
        ]
        lines += [line[: rng.randrange(len(line) - 1)], line]
    (log,) = imported(tmp_path, lines)
    assert len(log.table) == 20


def test_copies_of_other_stations_and_reports_out_of_order(tmp_path):
    """By construction: each report heard by three stations at different delays, two of them after the next one."""
    lines = []
    for k in range(10):
        north = 50.0 * k
        lines += [report(10 * k, north, late=0.3), report(10 * k, north, late=2.0)]
        if k:
            lines += [report(10 * (k - 1), 50.0 * (k - 1), late=14.0)]
    (log,) = imported(tmp_path, lines)
    assert log.table["time_s"].tolist() == [10 * k for k in range(10)]
    assert log.notes["copies_dropped"] == 19 and log.notes["out_of_order"] == 9


def test_of_two_reports_at_one_second_the_first_counts(tmp_path):
    """A row of a log is one time: a report that differs from another of its second only by 20 m gives way to it, counted."""
    lines = voyage(5)
    (log,) = imported(tmp_path, [*lines[:3], report(20, 10 * KNOT * 20 + 20), *lines[3:]])
    assert log.table["time_s"].tolist() == [0, 10, 20, 30, 40] and log.notes["others_at_same_time_dropped"] == 1
    assert log.table["gnss_latitude_deg"][2] == pytest.approx(60 + 10 * KNOT * 20 / 111_412, abs=1e-6)


def test_two_ships_under_one_number_are_told_apart(tmp_path):
    """By construction: 30 km apart, reports alternating, some in the same second: each log holds its own ship's fixes, all of them."""
    lines = []
    for k in range(20):
        lines += [report(10 * k, 50.0 * k), report(10 * k + (k % 3), 30_000 - 40.0 * k)]
    a, b = imported(tmp_path, lines)
    assert (a.notes["name"], b.notes["name"]) == (f"harbour-{MMSI}-a", f"harbour-{MMSI}-b")
    assert a.table["time_s"].tolist() == [10 * k for k in range(20)]
    assert len(b.table) == 20 and b.table["gnss_latitude_deg"].min() > 60.2 > a.table["gnss_latitude_deg"].max()
    for log in (a, b):
        assert "2 ships" in log.notes["shares_mmsi"] and "harbour.nmea line 2" in log.notes["shares_mmsi"]


def test_two_ships_that_cannot_be_told_apart_are_refused(tmp_path):
    """Two ships under one MMSI that pass each other: alone an error that names file, line and MMSI; among others left out, and said."""
    lines = []
    for k in range(60):
        lines += [report(10 * k, 50.0 * k), report(10 * k + 4, 3000 - 50.0 * k, 40.0)]
    with pytest.raises(
        InputError, match=rf"harbour.nmea: MMSI {MMSI}: positions jump to and fro .*harbour.nmea line 2"
    ):
        imported(tmp_path, lines)
    (other,) = imported(tmp_path, lines + voyage(5, mmsi=257000002))
    assert f"MMSI {MMSI}: positions jump" in other.notes["recording"]["left_out"]


def test_a_number_that_many_use_is_refused(tmp_path):
    """A default MMSI, sent by everybody: fixes all over the sea are nobody's, and said so with the line; two far apart are a jump."""
    rng = random.Random(1)
    lines = [report(10 * k, rng.uniform(-5e5, 5e5), rng.uniform(-5e5, 5e5)) for k in range(200)]
    with pytest.raises(InputError, match=r"fixes at more than 30 places .*harbour\.nmea line"):
        imported(tmp_path, lines)
    with pytest.raises(InputError, match=r"20 of 26 fixes lie where no ship gets; first harbour\.nmea line 7"):
        imported(tmp_path, [*voyage(6), *[report(60 + 10 * k, 1e5 * (k + 1)) for k in range(20)]])
    (log,) = imported(tmp_path, [report(0), report(10, 3e5)])
    assert log.notes["jumps"].startswith("1, first 299.4 km in 10 s") and len(log.table) == 2


def test_stray_fixes_and_jumps_are_named(tmp_path):
    """One fix at 0 N 0 E goes; a receiver that jumps 5 km and stays there keeps its fixes, and both are told with their lines."""
    lines = [report(10 * k, 50.0 * k + (5000 if k >= 15 else 0)) for k in range(30)]
    lines[6] = encode_tag("station", T0 + 60.7) + ais(lat=0.0, lon=0.0, second=0)[0]
    (log,) = imported(tmp_path, lines)
    assert log.notes["stray_fixes_dropped"] == "1, first harbour.nmea line 7"
    assert log.notes["jumps"].startswith("1, first 5.04 km in 10 s, harbour.nmea line 16")
    assert len(log.table) == 29 and log.zone == Zone(32)


def test_frozen_fixes_are_named(tmp_path):
    """A receiver that repeats its fix over 60 s at 10 kn (308 m): the repetitions are no fixes; a ship at anchor may repeat."""
    lines = [report(10 * k, 51.4 * (k if k < 10 else max(10, k - 5)), heading=3) for k in range(30)]
    (log,) = imported(tmp_path, lines)
    assert log.notes["frozen_fixes_dropped"] == "5, first harbour.nmea line 12"
    gone = log.table["gnss_latitude_deg"].isna()
    assert np.flatnonzero(gone).tolist() == [11, 12, 13, 14, 15] and log.table["heading_deg"].notna().all()
    (log,) = imported(tmp_path, [report(10 * k, heading=3, speed=0.0) for k in range(30)])
    assert "frozen_fixes_dropped" not in log.notes and log.table["gnss_latitude_deg"].notna().all()


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(60.0, 179.98), (-17.0, 179.98), (86.0, 12.0), (-85.5, -179.98), (0.001, 9.0)]
)
def test_one_zone_over_the_date_line_the_equator_and_near_the_poles(tmp_path, latitude, longitude):
    """Law: steps of a ship on a straight course are alike on the grid of the first fix, whatever lines it crosses."""
    lines = []
    for k in range(40):
        lat, lon = latitude - 5e-4 * k, longitude + 1.5e-3 * k / math.cos(math.radians(latitude))
        told = {"lat": lat, "lon": (lon + 180) % 360 - 180, "second": 10 * k % 60}
        lines.append(encode_tag("s", T0 + 10 * k + 0.4) + ais(heading=120, **told)[0])
    (log,) = imported(tmp_path, lines)
    assert "jumps" not in log.notes and log.zone == Zone.of(math.radians(latitude), math.radians(longitude))
    north, east = to_grid(*np.radians([log.table["gnss_latitude_deg"], log.table["gnss_longitude_deg"]]), log.zone)
    steps = np.hypot(np.diff(north), np.diff(east))
    np.testing.assert_allclose(steps, steps.mean(), rtol=6e-3)
    assert filter_log(log).table.notna()["north_m"].all()


def test_what_a_ship_does_not_announce_is_assumed_and_said(tmp_path):
    """Without static data: 100 m of class A, 12 m of class B, antenna amidships; A = C = 0 tells the size and no station."""
    (log,) = imported(tmp_path, voyage(3))
    assert log.vessel.length == 100 and "not announced" in log.notes["size"]
    assert log.vessel.sources["dimensions.length_overall_m"] == "assumed"
    boat = [encode_tag("s", T0 + 30 * k) + ais(18, lat=60 + 1e-4 * k, lon=10, second=30 * k % 60)[0] for k in range(4)]
    (log,) = imported(tmp_path, boat)
    assert log.vessel.length == 12 and log.table["time_s"].tolist() == [0, 30, 60, 90]
    part = [*ais(24, partno=0, shipname="MOLLY"), *ais(24, partno=1, to_bow=0, to_stern=9, to_port=0, to_starboard=3)]
    (log,) = imported(tmp_path, boat + part)
    assert (log.vessel.length, log.vessel.beam, log.notes["ship"]) == (9, 3, "MOLLY")
    assert log.vessel.stations["gnss"] == (0.0, 0.0) and "no station" in log.notes["size"]


def test_extended_reports_of_class_b(tmp_path):
    """Message 19 is a position and static data in one."""
    told = {"to_bow": 8, "to_stern": 4, "to_port": 2, "to_starboard": 2, "shipname": "SOLVEIG"}
    parts = [ais(19, lat=60 + 1e-4 * k, lon=10, second=30 * k % 60, **told) for k in range(4)]
    lines = [encode_tag("s", T0 + 30 * k) + s for k, ss in enumerate(parts) for s in ss]
    (log,) = imported(tmp_path, lines)
    assert (log.vessel.length, log.notes["ship"], len(log.table)) == (12, "SOLVEIG", 4)


def test_long_range_reports_count_only_where_there_is_nothing_better(tmp_path):
    """Message 27 has tenths of a minute: 185 m. Beside others it is left out; alone it makes a log with that noise."""
    far = [
        encode_tag("s", T0 + 180 * k + 5) + ais(27, lat=60 + 0.01 * k, lon=10.0, speed=11, course=0)[0]
        for k in range(5)
    ]
    (log,) = imported(tmp_path, voyage(5) + far)
    assert len(log.table) == 5 and log.notes["long_range_reports_dropped"] == 5
    (log,) = imported(tmp_path, far)
    assert log.vessel.noise.position == pytest.approx(185.2 / math.sqrt(12), rel=0.01)
    np.testing.assert_allclose(np.diff(log.table["time_s"]), 180)


def test_a_vessel_file_takes_the_place_of_what_is_announced(tmp_path):
    """The packaged hull with the announced antenna; one of another length is refused, by name; one ship can be chosen by number."""
    static = ais(5, shipname="CARGO", to_bow=10, to_stern=80, to_port=7, to_starboard=7)
    other = ais(5, 257000002, to_bow=30, to_stern=170, to_port=7, to_starboard=7, seq=2)
    lines = [*static, *other, *voyage(4), *voyage(4, mmsi=257000002)]
    with pytest.raises(InputError, match="MMSI 257000002 announces 200 m, vessel cargo90 is 90 m long"):
        imported(tmp_path, lines, vessel="cargo90")
    (log,) = imported(tmp_path, lines, vessel="cargo90", mmsi=MMSI)
    assert log.vessel.name == "cargo90" and log.vessel.stations["gnss"] == (35.0, 0.0)
    assert log.vessel.noise.position > 1.0 and log.vessel.simulator
    with pytest.raises(InputError, match="no position of MMSI 257999999; heard from 257000002, 257123456"):
        imported(tmp_path, lines, mmsi=257999999)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ([], "no message"),
        (["text", "more"], "line 1: malformed, no sentence"),
        (["!AIVDM,1,1,,A,1,0*00"], "line 1: checksum"),
        (ais(5), "messages by type: {'5': 1}"),
        (voyage(1), "messages by type: {'1': 1}"),
        ([report(0, mmsi=2570001), report(9, mmsi=2570001)], "messages by type: {'1': 2}"),
    ],
)
def test_a_file_without_positions_is_refused(tmp_path, lines, told):
    """One line that names the file and what it holds."""
    with pytest.raises(InputError, match=r"harbour\.nmea: holds no two positions of any ship") as error:
        imported(tmp_path, lines)
    assert told in str(error.value) and "\n" not in str(error.value)


def test_own_ship_and_several_files(tmp_path):
    """!AIVDO is the ship itself; the files of a call are one recording, so a ship in both has one log."""
    lines = voyage(10)
    own = [
        encode_tag("", T0 + 100 + k)
        + pyais.encode_dict(
            {"type": 1, "mmsi": MMSI, **NONE, "lat": 60 + 0.0046 + 5e-5 * k, "lon": 10, "second": (40 + k) % 60},
            sentence_type="VDO",
        )[0]
        for k in range(9)
    ]
    (tmp_path / "b.nmea").write_text("\n".join(own))
    (tmp_path / "a.nmea").write_text("\n".join(lines))
    (log,) = import_ais([tmp_path])
    assert len(log.table) == 19 and log.notes["own_ship"] and log.source.count("SHA-256") == 2
    with pytest.raises(InputError, match="no such file"):
        import_ais([tmp_path / "none"])


def test_without_pyais_one_line_says_what_to_install(tmp_path, monkeypatch):
    """pyais is an extra: importing names it, as the other extras do."""
    monkeypatch.setitem(sys.modules, "pyais", None)
    with pytest.raises(InputError, match=r"AIS needs pyais, which is not installed: pip install 'aspnn\[ais\]'"):
        import_ais([tmp_path])
