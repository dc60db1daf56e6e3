"""CSV files by a map. Oracle: logs of the simulator, rewritten as foreign files in every unit, sign and spelling."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.logs.csv_map import import_csv
from aspnn.logs.units import units_of
from aspnn.schema import InputError
from aspnn.simulation import read_scenario, simulate_scenario

ROOT = Path(__file__).parents[2]
HEAD = 'vessel = "cargo90"\nzone = "33N"\n'
STATIONS = "[stations_m]\nbow = [35.0, 0.0]\nstern = [-35.0, 0.0]\n"
COLUMNS = (
    *("bow_latitude_deg", "bow_longitude_deg", "stern_latitude_deg", "stern_longitude_deg", "heading_deg"),
    *("yaw_rate_deg_s", "acceleration_surge_m_s2", "acceleration_sway_m_s2", "rudder_order_deg", "rudder_angle_deg"),
    *("shaft_speed_rps", "speed_over_ground_m_s", "speed_through_water_m_s", "course_over_ground_deg"),
)


def voyages(name, duration, current=0.0, count=1):
    scenario = read_scenario(ROOT / f"data/scenarios/{name}.toml")
    environment = scenario.environment.model_copy(
        update={"current_kn": (current, current), "current_towards_deg": (70.0, 70.0)}
    )
    scenario = scenario.model_copy(update={"duration_s": duration, "environment": environment})
    for log, truth in simulate_scenario(scenario, voyages=count):
        heading, north, east = truth["heading_rad"], truth["current_north_m_s"], truth["current_east_m_s"]
        over_ground = (truth["surge_m_s"] + 1j * truth["sway_m_s"]) * np.exp(1j * heading)
        table = log.table.assign(
            speed_over_ground_m_s=np.abs(over_ground),
            speed_through_water_m_s=truth["surge_m_s"] - north * np.cos(heading) - east * np.sin(heading),
            course_over_ground_deg=np.degrees(np.angle(over_ground)) % 360,
        )
        yield table[["time_s", *COLUMNS]]


@pytest.fixture(scope="module")
def table():
    return next(voyages("cargo90-test", 900.0))


def foreign(table, units=None, signs=None):
    """The table with columns in foreign units and signs, under the same names."""
    table = table.copy()
    for name, unit in (units or {}).items():
        table[name] = table[name] / units_of(name)[unit]
    for name, sign in (signs or {}).items():
        table[name] = sign * table[name]
    return table


def entries(columns, **units):
    """The [columns] of a map: every column under its own name, some with a unit (or any other keys)."""
    lines = [f"{c} = {{column = '{c}'{units.get(c, '')}}}" for c in columns]
    return "[columns]\n" + "\n".join(lines) + "\n"


def brought_in(folder, table, time="[time]\ncolumn = 'time_s'\n", head=HEAD, **units):
    """The log that import_csv makes of a table written as plain CSV."""
    table.to_csv(folder / "voyage.csv", index=False)
    columns = [c for c in table.columns if c != "time_s"]
    (folder / "map.toml").write_text(head + time + entries(columns, **units) + STATIONS)
    return import_csv([folder / "voyage.csv"], folder / "map.toml")[0]


def named(words, call, *arguments, **keywords):
    """The call refuses with one line that holds the words."""
    with pytest.raises(InputError) as error:
        call(*arguments, **keywords)
    assert "\n" not in str(error.value)
    assert re.search(words, str(error.value)), str(error.value)


ALTERNATIVES = [(name, unit) for name in COLUMNS for unit in units_of(name)]


@pytest.mark.parametrize("name, unit", ALTERNATIVES)
def test_right_map_gives_the_log_back(tmp_path, table, name, unit):
    """Round trip: each column in each unit it may be recorded in, and turned round, comes back to rounding."""
    short = table[:600]
    log = brought_in(tmp_path, foreign(short, {name: unit}, {name: -1}), **{name: f", unit = '{unit}', sign = -1"})
    pd.testing.assert_frame_equal(log.table, short, rtol=1e-12, atol=1e-12)
    assert log.notes["name"] == log.voyage == "voyage" and str(log.zone) == "33N"
    assert log.vessel.stations["bow"] == (35.0, 0.0)


@pytest.mark.parametrize("unit, seconds", [("ms", 1e-3), ("us", 1e-6), ("min", 60.0), ("h", 3600.0)])
def test_units_of_time(tmp_path, table, unit, seconds):
    """Round trip: time in every unit, counted from wherever it was."""
    late = table[:600].assign(time_s=(table["time_s"] + 5000) / seconds)
    log = brought_in(tmp_path, late, f"[time]\ncolumn = 'time_s'\nunit = '{unit}'\n")
    np.testing.assert_allclose(log.table["time_s"], table["time_s"][:600], atol=1e-9)


def test_no_check_complains_of_right_logs(tmp_path):
    """The other side of the tests below: two voyages each in still water and in 3 kn of current pass without a note."""
    for current in (0.0, 3.0):
        for voyage in voyages("cargo90-test", 900.0, current, 2):
            notes = brought_in(tmp_path, voyage).notes
            assert set(notes) == {"name", "sha256"}
            json.dumps(notes)


def wrong_units():
    for name in COLUMNS[4:]:
        for unit in units_of(name):
            checked = not name.startswith(("rudder", "shaft", "acceleration_surge"))
            if checked and unit != next(iter(units_of(name))):
                yield name, unit


@pytest.mark.parametrize("name, unit", list(wrong_units()))
def test_wrong_unit_is_named(tmp_path, table, name, unit):
    """Simulator: a column in another unit than the map says, both ways round; the right unit and its entry are named."""
    canonical = next(iter(units_of(name)))
    words = rf"voyage.csv: .*column {name} .*set columns.{name}.unit = '{{}}' in .*map.toml$"
    named(words.format(unit), brought_in, tmp_path, foreign(table, {name: unit}))
    named(words.format(canonical), brought_in, tmp_path, table, **{name: f", unit = '{unit}'"})


@pytest.mark.parametrize(
    "name",
    ["heading_deg", "course_over_ground_deg", "yaw_rate_deg_s", "speed_through_water_m_s", "acceleration_sway_m_s2"],
)
def test_wrong_sign_is_named(tmp_path, table, name):
    """Simulator: a column with the other sign, and a map that turns a right one round."""
    words = rf"column {name} .*set columns.{name}.sign = {{}} in .*map.toml$"
    named(words.format(-1), brought_in, tmp_path, foreign(table, signs={name: -1}))
    named(words.format(1), brought_in, tmp_path, table, **{name: ", sign = -1"})


def test_wrong_sign_and_unit_together_are_named(tmp_path, table):
    """Simulator: a rate of turn to port in rad/s taken for deg/s to starboard."""
    wrong = foreign(table, {"yaw_rate_deg_s": "rad/s"}, {"yaw_rate_deg_s": -1})
    named(r"sign = -1 and columns.yaw_rate_deg_s.unit = 'rad/s'", brought_in, tmp_path, wrong)


def test_wrong_yaw_rate_without_a_cause_is_named_with_its_factor(tmp_path, table):
    """Simulator: 2.4 times the yaw rate is no unit anybody uses."""
    wrong = table.assign(yaw_rate_deg_s=2.4 * table["yaw_rate_deg_s"])
    named(r"yaw_rate_deg_s is 2\.[34]\d* times the rate at which heading_deg turns", brought_in, tmp_path, wrong)


@pytest.mark.parametrize("recorded, mapped", [("ms", "s"), ("s", "min"), ("s", "ms"), ("min", "s")])
def test_wrong_unit_of_time_is_named(tmp_path, table, recorded, mapped):
    """Simulator: time in another unit than the map says, by the speed over ground or because no ship is so fast."""
    wrong = table.assign(time_s=table["time_s"] / units_of("time_s")[recorded])
    named("time.unit", brought_in, tmp_path, wrong, f"[time]\ncolumn = 'time_s'\nunit = '{mapped}'\n")


def test_exchanged_and_misplaced_positions_are_named(tmp_path, table):
    """Simulator: latitude and longitude exchanged, signs turned, another zone."""
    pairs = {
        f"{a}_{b}_deg": f"{a}_{c}_deg"
        for a in ("bow", "stern")
        for b, c in (("latitude", "longitude"), ("longitude", "latitude"))
    }
    named(
        r"exchange columns.bow_latitude_deg and columns.bow_longitude_deg in",
        brought_in,
        tmp_path,
        table.rename(columns=pairs),
    )
    west = foreign(table, signs={"bow_longitude_deg": -1})
    named(r"set columns.bow_longitude_deg.sign = -1 in", brought_in, tmp_path, west)
    south = foreign(table, signs={"bow_latitude_deg": -1})
    named(r'set zone = "33S" or columns.bow_latitude_deg.sign = -1 in', brought_in, tmp_path, south)
    head = HEAD.replace("33N", "51N")
    named(r'far from zone 51N; set zone = "34N"', brought_in, tmp_path, table, head=head)


def local(table, speed=6.0, current=0.0):
    """Positions of the bow in a local grid: `speed` [m/s] along the heading and a current to the north; no drift, no noise."""
    heading = np.radians(table["heading_deg"])
    place = np.cumsum(0.1 * (speed * np.exp(1j * heading) + current))
    return pd.DataFrame(
        {
            "time_s": table["time_s"],
            "bow_north_m": np.real(place),
            "bow_east_m": np.imag(place),
            "heading_deg": table["heading_deg"],
            "yaw_rate_deg_s": table["yaw_rate_deg_s"],
        }
    )


def test_exchanged_local_positions_are_named(tmp_path, table):
    """By construction: north and east exchanged mirror the track, so the heading fits only when they are put back."""
    right = local(table)
    brought_in(tmp_path, right, head='vessel = "cargo90"\n')
    wrong = right.rename(columns={"bow_north_m": "bow_east_m", "bow_east_m": "bow_north_m"})
    named("north and east are exchanged", brought_in, tmp_path, wrong, head='vessel = "cargo90"\n')


def test_current_is_no_wrong_unit(tmp_path, table):
    """By construction: 2 m/s through the water, 1.9 m/s of current with her half the time; in kn she would be named."""
    time = table["time_s"]
    turning = table.assign(heading_deg=80 * np.sin(time / 60), yaw_rate_deg_s=80 / 60 * np.cos(time / 60))
    right = local(turning, 2.0, 1.9).assign(speed_through_water_m_s=2.0)
    brought_in(tmp_path, right, head='vessel = "cargo90"\n')
    wrong = foreign(right, {"speed_through_water_m_s": "kn"})
    named("columns.speed_through_water_m_s.unit = 'kn'", brought_in, tmp_path, wrong, head='vessel = "cargo90"\n')


def test_impossible_speeds_are_named_with_row_and_time(tmp_path, table):
    """By construction: from 300 s on the positions run at 50 m/s; a single jump of 2 km passes, it is the filter's to gate."""
    wrong = local(table)
    wrong.loc[3000:, "bow_north_m"] += 50 * (wrong.loc[3000:, "time_s"] - 300)
    with pytest.raises(InputError, match=r"voyage.csv: row \d+ \(time \d+") as error:
        brought_in(tmp_path, wrong, head='vessel = "cargo90"\n')
    assert abs(float(re.search(r"time ([\d.]+) s", str(error.value))[1]) - 300) < 20
    jump = local(table)
    jump.loc[3000, "bow_north_m"] += 2000
    jump.loc[6000:, "bow_east_m"] += 500
    brought_in(tmp_path, jump, head='vessel = "cargo90"\n')


def test_a_ship_that_does_not_turn_is_not_judged(tmp_path, table):
    """Contract: no decision where nothing can be decided. A straight run with the yaw rate turned round passes."""
    astern = local(table.assign(heading_deg=90.0, yaw_rate_deg_s=0.0), speed=-3.0)
    brought_in(tmp_path, astern, head='vessel = "cargo90"\n')
    straight = local(table.assign(heading_deg=40.0, yaw_rate_deg_s=-0.01 * np.sin(table["time_s"])))
    brought_in(tmp_path, straight, head='vessel = "cargo90"\n')
    brought_in(tmp_path, foreign(table, signs={"yaw_rate_deg_s": -1})[:400])  # 40 s, before the first order


def test_late_yaw_rate_and_turned_rudder_are_noted(tmp_path, table):
    """Simulator: the yaw rate moved by 2 s is noted with its lag to 0.3 s, the rudder turned round as odd; neither is an error."""
    late = table.assign(yaw_rate_deg_s=table["yaw_rate_deg_s"].shift(20).bfill())
    note = brought_in(tmp_path, late).notes["yaw_rate_deg_s"]
    assert abs(float(note.split()[0]) - 2.0) < 0.3 and "late" in note
    turned = foreign(table, signs={"rudder_angle_deg": -1, "rudder_order_deg": -1})
    assert "columns.rudder_angle_deg.sign" in brought_in(tmp_path, turned).notes["rudder_angle_deg_sign"]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_checks_bear_noise_gaps_and_missing_sensors(tmp_path, table, seed):
    """Simulator: 2 m, 2 deg and 0.1 deg/s of noise, 1 Hz fixes, 30 s gaps: the right log passes, the wrong sign is named."""
    draw = np.random.default_rng(seed)
    poor = table.copy()
    for name, noise in (("bow_latitude_deg", 2 / 111e3), ("heading_deg", 2.0), ("yaw_rate_deg_s", 0.1)):
        poor[name] += noise * draw.standard_normal(len(poor))
    poor.loc[np.arange(len(poor)) % 10 != 0, [c for c in poor if "itude" in c]] = np.nan
    poor = poor.drop(index=np.concatenate([np.arange(k, k + 300) for k in (2000, 5000, 7000)]))
    poor = poor.drop(columns=["acceleration_surge_m_s2", "rudder_order_deg", "shaft_speed_rps"])
    log = brought_in(tmp_path, poor)
    assert log.notes["gaps"] == "3 gaps, the longest of 30.1 s"
    assert len(log) == len(poor) and log.notes["rudder_order_deg"].startswith("derived from rudder_angle_deg")
    named("columns.yaw_rate_deg_s.sign = -1", brought_in, tmp_path, foreign(poor, signs={"yaw_rate_deg_s": -1}))


FORMS = """Logger 3000
made by hand

Date;Time;Lat;Lon;Gyro [°];Rud
# begins
01.05.2024;23:59:58,5;69,65;18,96;10,5;1,0
01.05.2024;23:59:59,5;69,65005;18,96;;-
Date;Time;Lat;Lon;Gyro [°];Rud
02.05.2024;00:00:00,5;69,6501;18,96;11,5;1,5;

02.05.2024;00:00:05,5;69,6502;18,96;-348;NaN
"""
FORM_MAP = """vessel = "cargo90"
zone = "33N"
voyage = "night"
[csv]
separator = ";"
decimal = ","
skip_rows = 3
comment = "#"
encoding = "latin-1"
[time]
column = ["Date", "Time"]
unit = "%d.%m.%Y %H:%M:%S,%f"
[columns]
gps_latitude_deg = "Lat"
gps_longitude_deg = "Lon"
heading_deg = {column = "Gyro [°]", offset = -1.5}
rudder_order_deg = "Rud"
depth_m = "Rud2"
[stations_m]
gps = [-20, 1.5]
"""


def test_spellings_of_csv(tmp_path):
    """By hand: two files, decimal commas, skipped lines, comments, repeated header, blanks, degree sign, date and time apart."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "log.TXT").write_bytes(FORMS.replace("Rud\n", "Rud;Rud2\n").encode("latin-1"))
    (tmp_path / "map.toml").write_text(FORM_MAP, encoding="utf-8")
    first, second = import_csv([tmp_path], tmp_path / "map.toml", vessel="esso_osaka")
    assert first.vessel.name == "esso_osaka" and first.vessel.stations["gps"] == (-20, 1.5)
    assert first.voyage == second.voyage == "night" and first.notes["name"] != second.notes["name"]
    assert first.start == "2024-05-01T23:59:58.500000Z"
    assert first.notes["dropped"] == "1 repeated headers" and first.notes["empty"] == "no value in depth_m"
    expected = pd.DataFrame(
        {
            "time_s": [0.0, 1.0, 2.0, 7.0],
            "gps_latitude_deg": [69.65, 69.65005, 69.6501, 69.6502],
            "gps_longitude_deg": [18.96] * 4,
            "heading_deg": [9.0, np.nan, 10.0, 10.5],
            "rudder_order_deg": [1.0, np.nan, 1.5, np.nan],
        }
    )
    pd.testing.assert_frame_equal(first.table, expected)


@pytest.mark.parametrize(
    "unit, text, start",
    [
        ("iso8601", ["2024-05-01T12:00:00+02:00", "2024-05-01T12:00:00.5+02:00"], "2024-05-01T10:00:00Z"),
        ("%H:%M:%S.%f", ["23:59:59.8", "00:00:00.3"], "2020-01-01T00:00:00Z"),
        ("%d/%m/%y %H:%M:%S.%f", ["31/12/23 23:59:59.9", "01/01/24 00:00:00.4"], "2020-01-01T00:00:00Z"),
    ],
)
def test_times_in_text(tmp_path, unit, text, start):
    """By hand: offsets from UTC, midnight without a date; the map's start comes before that of the times."""
    rows = pd.DataFrame({"time_s": text, "bow_north_m": [0.0, 1.0], "bow_east_m": 0.0})
    head = 'vessel = "cargo90"\n' + ("" if unit == "iso8601" else 'start = "2020-01-01"\n')
    log = brought_in(tmp_path, rows, f"[time]\ncolumn = 'time_s'\nunit = '{unit}'\n", head)
    np.testing.assert_allclose(log.table["time_s"], [0.0, 0.5])
    assert log.start == start


ROWS = "t,lat,lon,hdg\n0,69.65,18.96,10\n1,69.65001,18.96,10\n2,69.65002,18.96,10\n"
ROWS_MAP = (
    HEAD + "[time]\ncolumn = 't'\n[columns]\nbow_latitude_deg = 'lat'\nbow_longitude_deg = 'lon'\nheading_deg = 'hdg'\n"
)


@pytest.mark.parametrize(
    "rows, plan, words",
    [
        (
            ROWS,
            ROWS_MAP.replace("'hdg'", "'Hd'"),
            r"x.csv: column 'Hd' is missing, the nearest is 'hdg'; change columns.heading_deg in .*map.toml",
        ),
        (ROWS, ROWS_MAP.replace("'t'", "'T'"), r"column 'T' is missing, the nearest is 't'; change time.column"),
        (
            ROWS.replace(",", ";"),
            ROWS_MAP,
            r"column 't' is missing; the header 't;lat;lon;hdg' is one column, check csv.separator",
        ),
        (ROWS.replace("hdg", "lat"), ROWS_MAP.replace("'hdg'", "'lat'"), r"column 'lat' stands twice in the header"),
        (
            ROWS.replace("18.96,10\n2", "18.96,north\n2"),
            ROWS_MAP,
            r"x.csv: row 1 \(line 3\), column hdg: 'north' is not a number; leave",
        ),
        (ROWS.replace("18.96,10\n2", '18.96,"10,5"\n2'), ROWS_MAP, r"'10,5' is not a number; set csv.decimal = \",\""),
        (
            ROWS.replace("18.96,10\n2", "18.96,10,5\n2"),
            ROWS_MAP,
            r"row 1 \(line 3\) has 5 cells under 4 columns; check csv",
        ),
        ("t,lat,lon,hdg\n", ROWS_MAP, r"x.csv: holds no rows below a header"),
        ("", ROWS_MAP, r"x.csv: holds no rows below a header"),
        (ROWS.replace("\n2", "\n1"), ROWS_MAP, r"x.csv: row 2 .*column time_s: the epoch stands twice"),
        (ROWS.replace("\n2", "\n0.5"), ROWS_MAP, r"x.csv: row 2 .*column time_s: time runs back by 0.5 s"),
        (ROWS.replace("\n1", "\n"), ROWS_MAP, r"x.csv: row 1 .*column time_s: time is missing"),
        (
            ROWS,
            ROWS_MAP.replace("'t'", "'t'\nunit = 'iso8601'"),
            r"column t: '.' is not a time of the form iso8601|epoch",
        ),
        (ROWS, ROWS_MAP.replace("'t'", "'t'\nunit = 'sec'"), r"map.toml: time.unit: sec is not known; write s, ms"),
        (
            ROWS,
            ROWS_MAP.replace("heading_deg", "hedding_deg"),
            r"map.toml: columns: hedding_deg .* did you mean heading_deg",
        ),
        (
            ROWS,
            ROWS_MAP.replace("'hdg'", "{column = 'hdg', unit = 'kn'}"),
            r"columns: heading_deg: unit kn .*choose deg, rad",
        ),
        (ROWS, ROWS_MAP.replace("'hdg'", "{column = 'hdg', sign = 2}"), r"map.toml: columns.heading_deg.sign: "),
        (
            ROWS,
            ROWS_MAP.replace("'hdg'", "{column = 'hdg', units = 'deg'}"),
            r"columns.heading_deg.units: is not a known key",
        ),
        (ROWS, ROWS_MAP.replace("33N", "33X"), r"map.toml: zone: .*not a UTM zone"),
        (ROWS, ROWS_MAP.replace("bow_", "mast_"), r"x.csv: antenna mast has no station .*add stations_m.mast"),
        (ROWS, 'start = "May"\n' + ROWS_MAP, r"map.toml: start: "),
    ],
)
def test_wrong_file_or_map_is_one_line(tmp_path, rows, plan, words):
    """Contract: file, row, line, column and the remedy; the entry of the map where that is to be changed."""
    (tmp_path / "x.csv").write_text(rows)
    (tmp_path / "map.toml").write_text(plan)
    named(words, import_csv, [tmp_path / "x.csv"], tmp_path / "map.toml")


def test_file_that_is_no_text_is_one_line(tmp_path):
    """Contract: a Parquet file and a folder without CSV files."""
    (tmp_path / "map.toml").write_text(ROWS_MAP)
    (tmp_path / "x.csv").write_bytes(b"PAR1\xff\xfe\x00\x01")
    named(
        r"x.csv: is not utf-8-sig text; name its csv.encoding", import_csv, [tmp_path / "x.csv"], tmp_path / "map.toml"
    )
    (tmp_path / "empty").mkdir()
    named(r"empty: holds no", import_csv, [tmp_path / "empty"], tmp_path / "map.toml")


def test_example_map_is_read(tmp_path):
    """Law: the documented example is a map, and reads the file that it describes."""
    header = "Time;Lat 1;Lon 1;Gyro;ROT;Acc Y;Rudder;RPM;SOG;TWS;TWD"
    rows = [f"{k};69,65;18,96;11,5;60;0,1;-5;120;10;20;90" for k in range(3)]
    (tmp_path / "x.csv").write_text("\n".join(["two", "lines", header, *rows]))
    row = import_csv([tmp_path / "x.csv"], ROOT / "data/maps/example.toml")[0].table.iloc[1]
    expected = {
        "heading_deg": 10.0,
        "yaw_rate_deg_s": 1.0,
        "acceleration_sway_m_s2": -0.980665,
        "rudder_angle_deg": 5.0,
    }
    expected |= {"shaft_speed_rps": 2.0, "speed_over_ground_m_s": 10 * 1852 / 3600, "rudder_order_deg": 5.0}
    np.testing.assert_allclose(row[list(expected)], list(expected.values()))
