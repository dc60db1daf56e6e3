"""The vocabulary: the generated tables in data/README.md, and a table held to its columns."""

import runpy
from pathlib import Path

import pandas as pd
import pytest

from aspnn import schema
from aspnn.schema import InputError

DATA = Path(__file__).parents[1] / "data"


def test_data_readme_holds_the_tables_of_the_schema():
    """schema.markdown(), word for word between the markers; `python data/columns.py` renews them."""
    text = (DATA / "README.md").read_text()
    between = text.split("<!-- columns -->\n")[1].split("<!-- /columns -->\n")[0]
    assert between == schema.markdown()
    assert runpy.run_path(str(DATA / "columns.py"))["renewed"](text) == text


def test_every_column_of_the_schema_stands_in_the_tables_once():
    """Counting: one row per column, in the order of the schema."""
    rows = [line.split("`")[1] for line in schema.markdown().splitlines() if line.startswith("| `")]
    assert rows == [c.name for c in (*schema.LOG, *schema.TRUTH, *schema.STATES)]


@pytest.mark.parametrize("columns", [schema.LOG, schema.TRUTH, schema.STATES])
def test_names_carry_their_unit(columns):
    """House rule: the unit stands in the name, and no column stands twice."""
    endings = {
        "s": "_s",
        "m": "_m",
        "deg": "_deg",
        "rad": "_rad",
        "m/s": "_m_s",
        "m/s2": "_m_s2",
        "deg/s": "_deg_s",
        "rad/s": "_rad_s",
        "rad/s2": "_rad_s2",
        "rev/s": "_rps",
        "-": "",
        "bool": "",
        "bits": "",
    }
    for column in columns:
        assert column.name.removesuffix("_sd").endswith(endings[column.unit]), column.name
    assert len({c.name for c in columns}) == len(columns)


def test_unknown_column_is_named_with_its_neighbour():
    """Contract: one line with file, column and the nearest known name."""
    table = pd.DataFrame({"time_s": [0.0], "rudder_ordr_deg": [1.0]})
    with pytest.raises(InputError, match=r"a\.csv: column rudder_ordr_deg .*did you mean rudder_order_deg") as error:
        schema.check(table, schema.LOG, "a.csv")
    assert "\n" not in str(error.value)


def test_missing_column_is_named_with_its_meaning():
    """Contract: one line with file, column, meaning and unit."""
    with pytest.raises(InputError, match=r"a.csv: column time_s is missing \(time .* \[s\]\)"):
        schema.check(pd.DataFrame({"heading_deg": [1.0]}), schema.LOG, "a.csv")


@pytest.mark.parametrize(
    "name, known", [("bow_latitude_deg", True), ("mast2_north_m", True), ("Bow_north_m", False), ("_north_m", False)]
)
def test_antenna_columns_take_any_simple_name(name, known):
    """Contract: NAME is a lower-case word, digits may follow."""
    assert any(c.matches(name) for c in schema.LOG) is known


def test_antennas_are_those_with_a_position():
    """By hand: geodetic or local, in the order of the columns; heights and headings name none."""
    columns = ["time_s", "stern_north_m", "stern_east_m", "bow_latitude_deg", "bow_longitude_deg", "mast_height_m"]
    assert schema.antennas(columns) == ["stern", "bow"]
