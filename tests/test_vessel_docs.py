"""The page on vessel files, held to the code: every key, its range, whether it is needed; every packaged vessel."""

import copy
import json
import re

import pytest

from aspnn.instruments import CALIBRATION_KEYS, NOISE_KEYS
from aspnn.schema import InputError
from aspnn.simulation.ship import MODELS, Ship
from aspnn.vessel import FOLDER, KEYS, SIMULATOR, TEXTS, from_dict, load_vessel, vessels

PAGE = (FOLDER / "README.md").read_text()
ISHERWOOD = ("A_SS", "S", "C", "M")
ROW = re.compile(r"^\| `(\w+)` \| (.+?) \| (.+) \| (.+?) \| (yes|no) \|$")
HOMES = {  # a packaged vessel with the model that reads each section
    "mmg": "cargo90",
    "mariner": "mariner",
    "otter": "otter",
    "trimaran": "trimaran",
    "workboat": "workboat8",
    "propeller": "cargo90",
    "pitch": "cargo90",
    "engine": "cargo90",
    "wind": "cargo90",
    "domain": "cargo90",
}


def documented(section: str) -> dict[str, tuple[str, bool]]:
    """Keys of a section of the page, with their range and whether they are needed."""
    found = re.search(rf"^### (?:\w+, )*{section}(?:, \w+)*\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, section
    rows = (ROW.match(line) for line in found[1].splitlines())
    return {row[1]: (row[4], row[5] == "yes") for row in rows if row}


def told(section: str, change: dict, drop: str = "") -> str:
    """What is said of a packaged vessel with `change` in a section, or without the key `drop`; "" where it is taken."""
    data = json.loads((FOLDER / f"{HOMES.get(section, 'cargo90')}.json").read_text())
    part = copy.deepcopy(data.get(section, {})) | change
    part.pop(drop, None)
    try:
        Ship.of(from_dict(data | {section: part}))
    except InputError as error:
        return str(error)
    return ""


def test_every_section_and_key_is_there():
    """Held to vessel.KEYS, SIMULATOR, NOISE_KEYS and CALIBRATION_KEYS, and to what `to_dict` writes."""
    headings = re.findall(r"^### (.+)$", PAGE, re.MULTILINE)
    sections = [name for heading in headings for name in heading.split(", ")]
    assert set(sections) == {*KEYS, *SIMULATOR} - set(TEXTS)
    assert {f"`{key}`" for key in TEXTS} <= set(re.findall(r"`\w+`", PAGE))
    noise = {key for keys in NOISE_KEYS.values() for key in keys}
    assert set(documented("sensors")) == noise
    assert set(documented("calibration")) == set(CALIBRATION_KEYS)
    data = load_vessel("cargo90").to_dict()
    for section in ("dimensions", "service"):
        assert set(documented(section)) == set(data[section])
    assert set(documented("rudder")) == {*data["rudder"], "delay_s", "dead_band_deg"}


@pytest.mark.parametrize("section", ["dimensions", "rudder", "service"])
def test_ranges_of_the_sections_every_file_has(section):
    """Held to what the reader refuses: beyond the documented range, and a needed key that is missing."""
    for key, (span, needed) in documented(section).items():
        low, high = map(float, span.split(" to "))
        assert f"{section}.{key}" in told(section, {key: high * 1.01})
        assert f"{section}.{key}" in told(section, {key: low - 1})
        assert (f"{section}.{key} is missing" in told(section, {}, drop=key)) is needed


def test_ranges_of_the_calibration():
    """Held to CALIBRATION_KEYS."""
    for key, (span, needed) in documented("calibration").items():
        assert span == f"{CALIBRATION_KEYS[key][1]:g} to {CALIBRATION_KEYS[key][2]:g}"
        assert not needed


@pytest.mark.parametrize("section", SIMULATOR)
def test_keys_of_the_simulator(section):
    """Held to the models: the keys they know, as they name them to one who misspells, their ranges and which are needed."""
    keys = documented(section)
    message = told(section, {"zzzzzz": 1.0})
    known = set(re.search(r"known: (.+)$", message)[1].split(", "))
    if section == "propeller":
        known.add("table")
    if section == "wind":
        known |= set(ISHERWOOD)
    assert set(keys) == known
    for key, (span, needed) in keys.items():
        if section == "wind" and key in ISHERWOOD:
            continue
        assert (f"{section}.{key} is missing" in told(section, {}, drop=key)) is needed, key
        if re.fullmatch(r"\S+ to \S+", span):
            assert f"{section}.{key} = 1e+300 is outside {span}" in told(section, {key: 1e300}), key


def test_isherwood_instead_of_blendermann():
    """Held to the code: the wind section with Isherwood's keys is taken, and each of them is needed."""
    keys = {"A_F": 160.0, "A_L": 480.0, "A_SS": 100.0, "S": 120.0, "C": 40.0, "M": 2.0}
    data = json.loads((FOLDER / "cargo90.json").read_text())
    Ship.of(from_dict(data | {"wind": keys}))
    for key in keys:
        with pytest.raises(InputError, match=f"wind.{key} is missing"):
            Ship.of(
                from_dict(
                    data | {"wind": {k: v for k, v in keys.items() if k != key} | {"M" if key != "M" else "C": 1.0}}
                )
            )


def test_packaged_vessels_are_listed():
    """Held to the folder: a row for each packaged vessel, and none beside."""
    part = PAGE.split("## The packaged vessels")[1].split("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", part, re.MULTILINE)) == set(vessels())


@pytest.mark.parametrize("name", vessels())
def test_every_section_of_numbers_has_a_source(name):
    """House rule: where the numbers of each section come from is told, section by section."""
    data = json.loads((FOLDER / f"{name}.json").read_text())
    for section in set(data) - {*TEXTS, "sources"}:
        assert any(key.split(".")[0] == section and text.strip() for key, text in data["sources"].items()), section
    for key in data["sources"]:
        assert key.split(".")[0] in data, key


def test_every_model_has_a_packaged_vessel():
    """The page's models are those the simulator has, each shown by a packaged vessel."""
    for section in MODELS:
        assert f"`{section}`" in PAGE
        assert section in load_vessel(HOMES[section]).simulator
