"""The sentence codec: against pynmea2, against published sentences, and against what a checksum must catch."""

import random
import string
from datetime import date

import pynmea2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aspnn.logs.readings import FORMATTERS, KNOT, Status
from aspnn.logs.recording import read_line
from aspnn.logs.sentences import Bad, Fault, Sentence, checksum, decode, encode, encode_tag

# (formatter, fields, our values by pynmea2's numbers)
CASES = {
    "GGA": (
        "123519.25,4807.0380000,S,01131.0000000,W,4,08,0.9,545.4,M,46.9,M,,",
        lambda p: {"latitude_deg": p.latitude, "longitude_deg": p.longitude, "height_m": p.altitude + float(p.geo_sep)},
    ),
    "GNS": (
        "014035.00,4332.69262,S,17235.48549,E,RR,13,0.9,25.63,11.24,,",
        lambda p: {
            "latitude_deg": p.latitude,
            "longitude_deg": p.longitude,
            "height_m": float(p.altitude) + float(p.geo_sep),
        },
    ),
    "RMC": (
        "235959.90,A,4916.4500000,N,12311.1200000,W,012.3,354.7,311299,020.3,E,A",
        lambda p: {
            "latitude_deg": p.latitude,
            "longitude_deg": p.longitude,
            "speed_over_ground_m_s": p.spd_over_grnd * KNOT,
            "course_over_ground_deg": p.true_course,
        },
    ),
    "VTG": (
        "054.7,T,034.4,M,005.5,N,010.2,K,A",
        lambda p: {
            "course_over_ground_deg": p.true_track,
            "speed_over_ground_m_s": float(p.spd_over_grnd_kts) * KNOT,
        },
    ),
    "HDT": ("274.07,T", lambda p: {"heading_deg": float(p.heading)}),
    "THS": ("359.94,A", None),
    "ROT": ("-35.6,A", lambda p: {"yaw_rate_deg_s": float(p.rate_of_turn) / 60}),
    "RSA": (
        "-10.5,A,11.25,A",
        lambda p: {"rudder_angle_deg": float(p.rsa_starboard), "rudder_angle_port_deg": float(p.rsa_port)},
    ),
    "ROR": ("-20.0,A,,V,B", None),
    "RPM": (
        "S,0,-164.9,80.0,A",
        lambda p: {"shaft_speed_rps": p.speed / 60, "propeller_pitch_percent": float(p.pitch)},
    ),
    "MWV": (
        "214.8,T,36.0,K,A",
        lambda p: {"wind_angle_true_deg": float(p.wind_angle), "wind_speed_true_m_s": float(p.wind_speed) / 3.6},
    ),
    "ZDA": ("201530.00,04,07,2002,00,00", lambda p: {}),
    "XDR": (
        "A,-1.5,D,PTCH,C,19.5,C,AIR,A,2.25,D,ROLL,G,-0.125,,ACCY",
        lambda p: {
            "pitch_deg": float(p.get_transducer(0).value),
            "roll_deg": float(p.get_transducer(2).value),
            "acceleration_sway_m_s2": float(p.get_transducer(3).value),
        },
    ),
    "VBW": ("-1.25,0.5,A,1.0,0.25,A", lambda p: {"speed_through_water_m_s": float(p.lon_water_spd) * KNOT}),
    "VHW": (
        "245.1,T,245.1,M,000.01,N,000.01,K",
        lambda p: {"speed_through_water_m_s": float(p.water_speed_knots) * KNOT},
    ),
    "DPT": ("21.4,5.5,100.0", lambda p: {"depth_m": float(p.depth) + float(p.offset)}),
    "PRC": ("45.5,A,-120.0,R,,V,B,0", None),
}


def sentence(formatter: str, fields: str) -> str:
    return encode("GP", formatter, fields.split(","))


def values(text: str) -> dict[str, float]:
    found = decode(text)
    assert isinstance(found, Sentence), found
    return found.reading.values


@pytest.mark.parametrize("formatter", FORMATTERS)
def test_pynmea2_reads_ours_and_we_read_its(formatter):
    """Oracle: pynmea2 accepts our checksum, reads the same numbers, and what it renders we read the same."""
    fields, expected = CASES[formatter]
    ours = sentence(formatter, fields)
    if expected is None:  # pynmea2 does not know the sentence: its checksum must do
        assert int(ours[-2:], 16) == pynmea2.NMEASentence.checksum(ours[1:-3])
        return
    theirs = pynmea2.parse(ours, check=True)
    assert values(ours) == pytest.approx(expected(theirs), abs=1e-12)
    assert decode(theirs.render()) == decode(ours)
    reading = decode(ours).reading
    if formatter in ("GGA", "GNS", "RMC", "ZDA"):
        t = theirs.timestamp
        assert reading.utc == pytest.approx(t.hour * 3600 + t.minute * 60 + t.second + t.microsecond / 1e6, abs=1e-6)
    if formatter in ("RMC", "ZDA"):
        assert reading.day == theirs.datestamp


PUBLISHED = {
    # NOAA PSL, R/V Ronald H. Brown, ATOMIC 2020, raw GPS record of 14 January 2020 (public domain)
    "$GPHDT,74.20,T*34": {"heading_deg": 74.20},
    "$GPGGA,195959.00,1541.31258893,N,05130.51204125,W,2,06,1.5,9.2,M,-37.6,M,4.0,0138*7E": {
        "latitude_deg": 15 + 41.31258893 / 60,
        "longitude_deg": -51 - 30.51204125 / 60,
        "height_m": -28.4,
    },
    "$GPVTG,147.44,T,164.31,M,0.26,N,0.49,K,D*2C": {
        "course_over_ground_deg": 147.44,
        "speed_over_ground_m_s": 0.26 * 1852 / 3600,
    },
    "$GPRMC,195959.00,A,1541.31258893,N,05130.51204125,W,0.26,147.44,140120,16.9,W,D*0B": {
        "latitude_deg": 15 + 41.31258893 / 60,
        "longitude_deg": -51 - 30.51204125 / 60,
        "course_over_ground_deg": 147.44,
        "speed_over_ground_m_s": 0.26 * 1852 / 3600,
    },
    # examples in the public test-suites of NMEA parsers
    "$IIRSA,10.5,A,0.4,A*70": {"rudder_angle_deg": 10.5, "rudder_angle_port_deg": 0.4},
    "$TIROT,-0.3,A*15": {"yaw_rate_deg_s": -0.005},
    "$IIRPM,E,1,2418.2,10.5,A*5F": {"engine_speed_rps": 2418.2 / 60, "propeller_pitch_percent": 10.5},
    "$WIMWV,214.8,R,0.1,K,A*28": {"wind_angle_relative_deg": 214.8, "wind_speed_relative_m_s": 0.1 / 3.6},
}


@pytest.mark.parametrize("text", PUBLISHED)
def test_published_sentences(text):
    """Oracle: the numbers printed in the sentences of other makers' devices, checksums included."""
    assert values(text) == pytest.approx(PUBLISHED[text], abs=1e-12)


def test_published_time_and_day():
    reading = decode("$GPZDA,195959.00,14,01,2020,00,00*6A").reading
    assert (reading.utc, reading.day) == (71999.0, date(2020, 1, 14))
    assert decode(sentence("RMC", "123519,A,,,,,,,230394,,")).reading.day == date(1994, 3, 23)


def test_published_tag_block():
    """Oracle: the checksum of a TAG block in gpsd's description of AIVDM; a wrong digit in it is caught."""
    line = rb"\g:1-2-73874,n:157036,s:r003669945,c:1241544035*4A\!AIVDM,1,1,,B,15N4cJ`005Jrek0H@9n`DW5608EP,0*13"
    assert [piece.fault for piece in read_line(line)] == [Fault.unknown_sentence]
    assert [piece.fault for piece in read_line(line.replace(b"n:157036", b"n:157037"))] == [Fault.checksum]


@given(st.floats(-3600, 3600), st.floats(-90, 90))
def test_port_is_negative_on_both_sides(rate, rudder):
    """Law: minus is to port in ROT, RSA and ROR, and is so in the log; a minute has sixty seconds."""
    assert values(encode("TI", "ROT", [f"{rate:.6f}", "A"]))["yaw_rate_deg_s"] == pytest.approx(rate / 60, abs=1e-8)
    for formatter, name in (("RSA", "rudder_angle"), ("ROR", "rudder_order")):
        found = values(encode("II", formatter, [f"{rudder:.6f}", "A", f"{-rudder:.6f}", "A"]))
        assert found == pytest.approx({f"{name}_deg": rudder, f"{name}_port_deg": -rudder}, abs=1e-6)


@given(st.sampled_from(sorted(CASES)), st.data())
def test_no_single_corruption_passes_unseen(formatter, data):
    """Law: one changed byte is caught by checksum or form, or changes no value (the case of a hexadecimal digit)."""
    good = sentence(formatter, CASES[formatter][0]).encode()
    place = data.draw(st.integers(0, len(good) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda b: b not in (good[place], *b"\r\n")))
    found = read_line(good[:place] + bytes([byte]) + good[place + 1 :])
    kept = [piece for piece in found if isinstance(piece, Sentence)]
    assert all(piece == read_line(good)[0] for piece in kept)
    assert kept or found


@pytest.mark.parametrize(
    ("formatter", "fields", "expected"),
    [
        ("HDT", ",T", {}),
        ("HDT", "511.0,T", {}),
        ("HDT", "360.0,T", {"heading_deg": 0.0}),
        ("ROT", ",A", {}),
        ("ROT", "-9999.9,A", {}),
        ("ROT", "0.0,A", {"yaw_rate_deg_s": 0.0}),
        ("RSA", "-100.0,A,5.0,A", {"rudder_angle_port_deg": 5.0}),
        ("RSA", "-3.5,A", {"rudder_angle_deg": -3.5}),
        ("RSA", "5.0,V,-4.0,A", {"rudder_angle_port_deg": -4.0}),
        ("VTG", ",T,,M,0.00,N,0.00,K,A", {"speed_over_ground_m_s": 0.0}),
        ("VTG", "90.0,T,,M,,N,36.0,K,A", {"course_over_ground_deg": 90.0, "speed_over_ground_m_s": 10.0}),
        ("VTG", "360.0,T,,M,102.3,N,,K,A", {"course_over_ground_deg": 0.0}),
        ("RMC", "120000,A,9100.000,N,18100.000,E,,,010125,,", {}),
        ("GGA", "120000,4807.038,N,,,1,08,0.9,545.4,M,46.9,M,,", {}),
        ("GGA", "120000,4807.038,N,01131.000,E,1,08,0.9,545.4,M,,M,,", {"latitude_deg": 48.1173, "longitude_deg": 11 + 31 / 60}),
        ("MWV", "10.0,T,,N,A", {"wind_angle_true_deg": 10.0}),
        ("RPM", "S,1,,,A", {}),
    ],
)  # fmt: skip
def test_empty_and_sentinel_fields_are_no_values(formatter, fields, expected):
    """Contract: what is not known is absent, and never zero; a zero that is sent is a zero."""
    assert values(sentence(formatter, fields)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("formatter", "fields", "status"),
    [
        ("RMC", "120000,A,4807.0,N,01131.0,E,,,010125,,", "valid"),
        ("RMC", "120000,V,4807.0,N,01131.0,E,,,010125,,", "invalid"),
        ("RMC", "120000,A,4807.0,N,01131.0,E,,,010125,,,E", "invalid"),
        ("RMC", "120000,A,4807.0,N,01131.0,E,,,010125,,,S", "simulated"),
        ("RMC", "120000,A,4807.0,N,01131.0,E,,,010125,,,D,V", "valid"),
        *(("GGA", f"120000,4807.0,N,01131.0,E,{q},8,1,5,M,4,M,,", "valid") for q in "12345"),
        *(("GGA", f"120000,4807.0,N,01131.0,E,{q},8,1,5,M,4,M,,", "invalid") for q in ("0", "6", "7", "")),
        ("GGA", "120000,4807.0,N,01131.0,E,8,8,1,5,M,4,M,,", "simulated"),
        ("GNS", "120000,4807.0,N,01131.0,E,NN,8,1,5,4,,", "invalid"),
        ("GNS", "120000,4807.0,N,01131.0,E,NA,8,1,5,4,,,V", "valid"),
        ("GNS", "120000,4807.0,N,01131.0,E,SN,8,1,5,4,,", "simulated"),
        ("VTG", "90.0,T,,M,5.0,N,,K,N", "invalid"),
        ("VTG", "90.0,T,,M,5.0,N,,K", "valid"),
        *(("THS", f"90.0,{mode}", "invalid") for mode in ("E", "M", "V", "")),
        ("THS", "90.0,A", "valid"),
        ("THS", "90.0,S", "simulated"),
        ("ROT", "1.0,V", "invalid"),
        ("RSA", "1.0,V,,V", "invalid"),
        ("RSA", "1.0,V,2.0,A", "valid"),
        ("ROR", "1.0,V,,V,B", "invalid"),
        ("RPM", "S,0,100,,V", "invalid"),
        ("MWV", "10,T,5,M,V", "invalid"),
    ],
)
def test_flags_are_honoured(formatter, fields, status):
    """Oracle: the meaning of each status, quality and mode in makers' manuals; dead reckoning is no measurement."""
    found = decode(sentence(formatter, fields))
    assert found.reading.status is Status[status]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("$HEHDT,12.0,T", "no_checksum"),
        ("$HEHDT,12.0,T*", "malformed"),
        ("$HEHDT,12.0,T*G1", "malformed"),
        (encode("HE", "HDT", ["12.0", "M"]), "malformed"),
        (encode("HE", "HDT", ["1e1", "T"]), "malformed"),
        (encode("HE", "HDT", ["nan", "T"]), "malformed"),
        (encode("HE", "HDT", ["12\u00b2", "T"]), "malformed"),
        (encode("HE", "HDT", ["12.0"]), "malformed"),
        (sentence("GGA", "246000,4807.0,N,01131.0,E,1,8,1,5,M,4,M,,"), "malformed"),
        (sentence("GGA", "120000,4860.0,N,01131.0,E,1,8,1,5,M,4,M,,"), "malformed"),
        (sentence("GGA", "120000,4807.0,,01131.0,E,1,8,1,5,M,4,M,,"), "malformed"),
        (sentence("RMC", "120000,A,4807.0,N,01131.0,E,,,310225,,"), "malformed"),
        (encode("GP", "GSV", ["1", "1", "00"]), "unknown_sentence"),
        (encode("PA", "SHR", ["1"]), "unknown_sentence"),
        (encode("h", "dt", ["1"]), "malformed"),
        ("hello", "malformed"),
        ("$", "no_checksum"),
        (encode("HE", "HDT", ["12.0", "T"]) + " and more", "malformed"),
        (encode_tag("GP0001") + "$HEHDT,12.0,T", "no_checksum"),
        ("\\s:GP0001\\" + encode("HE", "HDT", ["12.0", "T"]), "no_checksum"),
        ("\\s:GP0001*00\\" + encode("HE", "HDT", ["12.0", "T"]), "checksum"),
    ],
)
def test_bad_lines_are_classed(line, fault):
    assert [piece.fault.value for piece in read_line(line.encode("latin-1")) if isinstance(piece, Bad)] == [fault]


HDT = encode("HE", "HDT", ["12.0", "T"])


@pytest.mark.parametrize(
    ("line", "source", "received"),
    [
        (f"{HDT}\r\n", "", None),
        (f"{HDT}\n", "", None),
        (f"\\s:GP0001,c:1577836800*{checksum('s:GP0001,c:1577836800'):02X}\\{HDT}\r\n", "GP0001", 1577836800.0),
        (f"UdPbC\0{encode_tag('GP0001', 1577836800.25)}{HDT}\r\n", "GP0001", 1577836800.25),
        (f"{encode_tag('GP0001')}{encode_tag(time=5e8)}{HDT}", "GP0001", 5e8),
        (f"2020-01-01T00:00:00.5Z {HDT}", "", 1577836800.5),
        (f"2020-01-01 01:00:00+01:00,{HDT}", "", 1577836800.0),
        (f"2020-01-01T00:00:00,125\t{HDT}", "", 1577836800.125),
        (f"1577836800.125,{HDT}", "", 1577836800.125),
        (f"1577836800125 {HDT}", "", 1577836800.125),
        (f"1577836801.5 UdPbC\0{encode_tag('HE0001', 1577836800)}{HDT}", "HE0001", 1577836801.5),
    ],
)
def test_time_and_source_before_a_sentence(line, source, received):
    """Oracle: 1577836800 is 2020-01-01 00:00 UTC. Of two times the logger's counts."""
    [found] = read_line(line.encode("latin-1"))
    assert (found.source, found.received, found.reading.values) == (source, received, {"heading_deg": 12.0})


def test_merged_sentences_are_parted():
    """Two sentences on a line, also after a truncated one, each with its own TAG block or time."""
    rot = encode("TI", "ROT", ["6.0", "A"])
    first, second = encode_tag("HE0001", 1e9), encode_tag("TI0001", 1e9 + 1)
    for line in (HDT + rot, HDT + "\r" + rot, f"{first}{HDT}{second}{rot}", f"1000000000.5 {HDT}1000000001.5 {rot}"):
        one, two = read_line(line.encode())
        assert (one.formatter, two.formatter) == ("HDT", "ROT")
    assert (two.received, one.received) == (1000000001.5, 1000000000.5)
    one, two = read_line(f"{first}{HDT}{second}{rot}".encode())
    assert (one.identity, two.identity, two.received) == ("HE0001", "TI0001", 1e9 + 1)
    cut, whole = read_line(f"$GPGGA,1200{second}{rot}".encode())
    assert (cut.fault, whole.identity) == (Fault.no_checksum, "TI0001")
    junk, whole = read_line(f"\x00\xff12{rot}".encode("latin-1"))
    assert (junk.fault, whole.formatter) == (Fault.malformed, "ROT")


def test_long_lines_are_read_when_whole():
    """Beyond the 82 characters of the standard: precise receivers write more decimals, and the checksum tells."""
    fields = "123519.250000,4807.03812345678,N,01131.00012345678,E,4,08,0.9,545.412345,M,46.912345,M,,0000"
    text = sentence("GGA", fields)
    assert len(text) > 82
    assert values(text)["latitude_deg"] == pytest.approx(48 + 7.03812345678 / 60, abs=1e-13)


def test_ten_thousand_mangled_lines_never_raise():
    """Fuzz: random bytes and mutated good lines; each piece is a sentence or has a fault, and a blank line has none."""
    rng = random.Random(7)
    good = [sentence(f, fields).encode() for f, (fields, _) in CASES.items()]
    marks = b"$!*,\\.-:;sc\r\0" + string.printable.encode() + bytes(range(128, 256))
    seen = set()
    for _ in range(10_000):
        line = bytearray(rng.choice(good) * rng.choice((0, 1, 1, 1, 2)))
        if rng.random() < 0.3:
            line = bytearray(encode_tag("GP0001", 1.5e9).encode() + line)
        for _ in range(rng.randrange(4)):
            place = rng.randrange(len(line) + 1)
            line[place : place + rng.randrange(3)] = bytes(rng.choice(marks) for _ in range(rng.randrange(4)))
        found = read_line(bytes(line))
        assert bool(found) == bool(bytes(line).decode("latin-1").strip())
        seen |= {piece.fault if isinstance(piece, Bad) else "good" for piece in found}
    assert seen >= {"good", Fault.checksum, Fault.no_checksum, Fault.malformed}
