"""Training files: where their voyages come from."""

from pathlib import Path

import pytest

from aspnn.learning.config import read_training, write_training
from aspnn.schema import InputError

TRAINING = Path(__file__).parents[2] / "training"
TEXT = (TRAINING / "cargo90.toml").read_text(encoding="utf-8")
ONE = 'scenario = "../data/scenarios/cargo90-train.toml"'


@pytest.fixture
def given(tmp_path):
    """Reads cargo90.toml with the source of its voyages changed."""

    def read(source):
        assert ONE in TEXT
        path = tmp_path / "training" / "x.toml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(TEXT.replace(ONE, source), encoding="utf-8")
        return read_training(path)

    return read


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("", "name either a scenario or scenarios or logs"),
        (f'{ONE}\nscenarios = ["a.toml"]', "name either a scenario or scenarios or logs"),
        ('scenarios = ["a.toml"]\nlogs = ["b"]', "name either a scenario or scenarios or logs"),
        ('scenarios = ["a.toml", "b.toml"]\nvoyages = 3', "voyages is of one scenario"),
    ],
)
def test_voyages_come_from_one_kind_of_source(given, source, message):
    """Contract: one line with the file and the key."""
    with pytest.raises(InputError, match=message) as error:
        given(source)
    assert "x.toml: data: " in str(error.value)


def test_several_scenarios_keep_their_order_and_their_places(given, tmp_path):
    """Contract: written elsewhere, a training file leads to the same files in the same order."""
    training = given('scenarios = ["../b.toml", "../a.toml"]')
    write_training(training, tmp_path / "runs" / "deep" / "y.toml")
    back = read_training(tmp_path / "runs" / "deep" / "y.toml")
    assert [(back.folder / source).resolve() for source in back.data.scenarios] == [
        tmp_path / "b.toml",
        tmp_path / "a.toml",
    ]


def test_the_steered_predictor_is_the_flagship_with_voyages_under_an_autopilot_before_its_own():
    """Contract: all but the source of voyages is that of cargo90.toml, so the voyages of validation are too."""
    flagship, steered = (read_training(TRAINING / f"{name}.toml") for name in ("cargo90", "cargo90-steered"))
    assert steered.data.scenarios[-1] == flagship.data.scenario
    assert steered.data.validation_voyages == flagship.data.validation_voyages
    assert (steered.windows, steered.network, steered.fit) == (flagship.windows, flagship.network, flagship.fit)
