"""Logs written as sentences: every line by pynmea2 and by the standard's rules, and back through the importer."""

import re
from dataclasses import replace
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pandas as pd
import pynmea2
import pytest
from typer.testing import CliRunner

from aspnn.checks import check_log
from aspnn.cli import app
from aspnn.frames import Zone
from aspnn.logs.nmea import import_nmea0183
from aspnn.logs.nmea_write import BLOCK, to_nmea, write_nmea
from aspnn.logs.readings import KNOT
from aspnn.records import Log, read_log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

MAP = Path(__file__).parents[2] / "data" / "maps" / "simulated.toml"
MINUTE, KNOTS = 1 / 60, KNOT
# The step that each column is rounded to before it is written.
STEPS = {
    "heading_deg": 0.1,
    "yaw_rate_deg_s": 0.1 * MINUTE,
    "roll_deg": 0.1,
    "pitch_deg": 0.1,
    "acceleration_surge_m_s2": 0.001,
    "acceleration_sway_m_s2": 0.001,
    "acceleration_heave_m_s2": 0.001,
    "rudder_order_deg": 0.1,
    "rudder_angle_deg": 0.1,
    "engine_order_rps": 0.1 * MINUTE,
    "shaft_speed_rps": 0.1 * MINUTE,
    "propeller_pitch_ratio": 0.001,
    "speed_through_water_m_s": 0.1 * KNOTS,
    "course_over_ground_deg": 0.1,
    "speed_over_ground_m_s": 0.1 * KNOTS,
    "wind_speed_true_m_s": 0.1,
    "wind_from_true_deg": 0.1,
    "depth_m": 0.1,
}


def made(rows=400, every=5, start="2024-12-31T23:59:50Z") -> Log:
    """A log of every column over midnight of New Year: positions at every fifth row, headings and rates at every row, the others
    at rows of their own; numbers at random over the whole range of their sentences, minus too."""
    rng = np.random.default_rng(8)
    k = np.arange(rows)
    table = {"time_s": k / 20}
    for antenna, north in (("bow", 300), ("stern", 0)):
        table[f"{antenna}_latitude_deg"] = (-41_800_000 + north + k) * 1e-4 / 60
        table[f"{antenna}_longitude_deg"] = (-107_970_000 - k) * 1e-4 / 60
        table[f"{antenna}_height_m"] = np.round(rng.uniform(-50, 60, rows), 1)
    reach = {"heading_deg": (0, 3600), "course_over_ground_deg": (0, 3600), "wind_from_true_deg": (0, 3600)}
    reach |= dict.fromkeys(("speed_over_ground_m_s", "wind_speed_true_m_s"), (0, 500)) | {"depth_m": (65, 9000)}
    for name, step in STEPS.items():
        table[name] = rng.integers(*reach.get(name, (-300, 300)), rows) * step
    frame = pd.DataFrame(table)
    for i, name in enumerate(frame.columns[1:]):
        if "heading" not in name and "yaw" not in name:
            # wind speed and direction, roll and pitch, course and speed each come together
            shift = 1 if re.search("wind|roll|pitch_deg|over_ground", name) else 0 if name[0] in "bs" else i
            frame.loc[(k + shift) % every != 0, name] = np.nan
    frame["stern_latitude_deg"] = frame["stern_latitude_deg"].where(frame["stern_height_m"].notna())
    vessel = load_vessel("cargo90")
    return Log(frame, vessel, Zone.parse("33S"), start=start, voyage="made")


@pytest.fixture(scope="module")
def log():
    made_ = made()
    check_log(made_)
    return made_


def imported(path: Path, tmp_path: Path, **changes: str) -> Log:
    text = MAP.read_text()
    for old, new in changes.items():
        text = text.replace(f'{old} = "33N"', f'{old} = "{new}"')
    (tmp_path / "map.toml").write_text(text)
    [back] = import_nmea0183([path], tmp_path / "map.toml")
    return back


def test_every_column_comes_back(log, tmp_path):
    """Oracle: the log, whose values are whole steps of their sentences. Rounding to whole steps again leaves no difference."""
    back = imported(write_nmea(log, tmp_path / "made.nmea"), tmp_path, zone="33S")
    assert back.start == "2024-12-31T23:59:50Z"
    assert back.notes["bad"] == {} and set(back.table) == set(log.table)
    np.testing.assert_allclose(back.table["time_s"], log.table["time_s"], atol=1e-9)
    for name in log.table.columns[1:]:
        step = 1e-4 / 60 if name.endswith("tude_deg") else 0.1 if name.endswith("height_m") else STEPS[name]
        got, put = back.table[name], log.table[name]
        np.testing.assert_array_equal(got.notna(), put.notna(), err_msg=name)
        circle = 3600 if name in ("heading_deg", "course_over_ground_deg", "wind_from_true_deg") else None
        steps = np.round((got - put).dropna() / step)
        np.testing.assert_array_equal(steps if circle is None else steps % circle, 0, err_msg=name)
        assert np.abs(got - put).dropna().mod(360 if circle else np.inf).max() < 0.51e-4 + 1e-9


def test_lines_keep_the_standard(log):
    """Oracle: pynmea2 where it knows the sentence; the rules: 82 characters with the line end, checksum, CR LF, printable ASCII;
    TAG blocks of at most 80 characters with a checksum of their own; and the number of fields of each sentence."""
    fields = {"GGA": 14, "ZDA": 6, "VTG": 9, "HDT": 2, "ROT": 2, "RSA": 4, "ROR": 5, "PRC": 8, "RPM": 5, "XDR": None}
    fields |= {"VBW": 6, "MWV": 5, "DPT": 3}
    seen = set()
    for line in to_nmea(log):
        match = re.fullmatch(r"(\\(s:(\w\w)0001,c:\d{13})\*([0-9A-F]{2})\\)(\$([ -~]{5,})\*([0-9A-F]{2})\r\n)", line)
        assert match, line
        tag, told, talker, tag_sum, sentence, body, body_sum = match.groups()
        assert len(sentence) <= 82 and len(tag) <= 80
        assert (reduce(xor, told.encode()), reduce(xor, body.encode())) == (int(tag_sum, 16), int(body_sum, 16))
        assert body[:2] == talker and not re.search(r"[$*\\!^~]", body)
        form = body[2:5]
        assert fields[form] in (body.count(","), None), line
        seen.add(form)
        if form not in ("ROR", "PRC"):
            parsed = pynmea2.parse(sentence.strip(), check=True)
            assert (parsed.talker, parsed.sentence_type) == (talker, form)
    assert seen == set(fields)


@pytest.mark.parametrize("step", [1e-4, 1e-5, 1e-7])
def test_positions_have_the_decimals_they_need(log, step):
    """Law: four decimals of a minute where every position is a whole number of them, else seven; none is lost."""
    rows = np.arange(len(log))
    table = log.table.assign(bow_latitude_deg=-69 - (41 + rows * step) / 60)
    words = [re.search(r"GPGGA,[^,]*,69(\d\d\.\d*),S", line) for line in to_nmea(replace(log, table=table))]
    minutes = [word[1] for word in words if word]
    rows = rows[log.table["bow_longitude_deg"].notna()]
    assert {len(word) for word in minutes} == {7 if step == 1e-4 else 10}
    np.testing.assert_allclose(np.array(minutes, float), 41 + rows * step, rtol=0, atol=1e-9)


def test_longest_lines_fit():
    """Law: 82 characters, with seven decimals of a minute, the widest numbers, and all columns."""
    wide = made(rows=10, every=1)
    table = wide.table.assign(
        bow_longitude_deg=-179.123456789, bow_latitude_deg=-69.987654321, bow_height_m=-1234.5678,
        acceleration_surge_m_s2=-29.8765, acceleration_sway_m_s2=-29.8765, acceleration_heave_m_s2=-29.8765,
        course_over_ground_deg=359.8765, speed_over_ground_m_s=51.23456, depth_m=11234.5678, roll_deg=-123.4567,
        pitch_deg=-89.8765, wind_speed_true_m_s=99.87654, yaw_rate_deg_s=-59.87654,
    )  # fmt: skip
    longest = max(len(line[line.index("$") :]) for line in to_nmea(replace(wide, table=table)))
    assert 75 < longest <= 82


def test_order_and_seconds_over_blocks():
    """Law: lines stand in the order of time over the writer's blocks, one ZDA in every second, the day that of the time."""
    log = made(rows=BLOCK + 50)
    lines = list(to_nmea(log))
    stamps = [int(re.search(r"c:(\d+)", line)[1]) for line in lines]
    assert stamps == sorted(stamps)
    days = [line.split("GPZDA,")[1] for line in lines if "ZDA" in line]
    assert len(days) == (BLOCK + 50) // 20 + 1
    assert days[9].startswith("235959.000,31,12,2024,00,00*") and days[10].startswith("000000.000,01,01,2025,00,00*")


def test_bow_and_stern_are_told_apart(log, tmp_path):
    """Oracle: the columns; the sources of the TAG blocks alone tell, here where both have the same talker."""
    text = "".join(re.sub(r"\\.*\\\$GNGGA(.*)\*..", _as_gp, line) for line in to_nmea(log))
    (tmp_path / "made.nmea").write_text(text, newline="")
    back = imported(tmp_path / "made.nmea", tmp_path, zone="33S")
    gap = (back.table["bow_latitude_deg"] - back.table["stern_latitude_deg"]).dropna()
    np.testing.assert_allclose(gap, 300e-4 / 60, atol=1e-9)


def _as_gp(match: re.Match) -> str:
    body = f"GPGGA{match[1]}"
    return f"{match[0].split('$')[0]}${body}*{reduce(xor, body.encode()):02X}"


def test_nothing_half_written(log, tmp_path, monkeypatch):
    """A writer that fails leaves neither a file nor a part of one; a log without its start is named in one line."""
    with pytest.raises(InputError, match="need the start of the log in UTC"):
        write_nmea(replace(log, start=""), tmp_path / "made.nmea")
    monkeypatch.setattr("aspnn.logs.nmea_write._lines", lambda *args: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_nmea(log, tmp_path / "made.nmea")
    assert list(tmp_path.iterdir()) == []


SCENARIO = """
vessel = "cargo90"
duration_s = 60
[start]
speed_kn = 11.5
latitude_deg = 69.65
longitude_deg = 18.96
zone = "33N"
heading_deg = 350
[manoeuvre]
kind = "turning-circle"
rudder_deg = 20
start_s = 5
[sensors]
quantised = true
position_hz = 5
course_hz = 1
attitude_hz = 5
engine_order_hz = 1
speed_log_hz = 1
wind_hz = 1
"""


def test_simulated_recording_comes_back(tmp_path):
    """Oracle: the log. `aspnn simulate --nmea`, then `aspnn import nmea0183` by the packaged map, to the rounding of the sensors."""
    (tmp_path / "x.toml").write_text(SCENARIO)
    simulate = ["simulate", str(tmp_path / "x.toml"), "--nmea", "--quiet", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, simulate).exit_code == 0
    back = [
        "import",
        "nmea0183",
        str(tmp_path / "x.nmea"),
        "--map",
        str(MAP),
        "--quiet",
        "--out",
        str(tmp_path / "back"),
    ]
    assert CliRunner().invoke(app, back).exit_code == 0
    log, again = read_log(tmp_path / "x.parquet"), read_log(tmp_path / "back" / "x.parquet")
    assert set(again.table) == set(log.table) and len(log.table.columns) == 20
    assert (again.start, again.zone, again.vessel.stations) == (log.start, log.zone, log.vessel.stations)
    for name in log.table:
        step = 1e-3 if name == "time_s" else 1e-4 / 60 if name.endswith("tude_deg") else STEPS[name]
        got, put = again.table[name], log.table[name]
        np.testing.assert_array_equal(got.notna(), put.notna(), err_msg=name)
        np.testing.assert_allclose(got.dropna(), put.dropna(), rtol=0, atol=0.01 * step, err_msg=name)
