"""How a bridge is started: the sample settings against their model, what is refused in one line, what is told and lived with."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import BaseModel

from aspnn.live import start
from aspnn.live.bridge import SimulatedBridge
from aspnn.live.config import BridgeConfig, FileSource, N2kSource, SerialSource, TcpSource, UdpSource, read_bridge
from aspnn.live.traffic import SHIPS
from aspnn.logs.nmea import Antenna
from aspnn.prediction import Predictor
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario
from aspnn.vessel import load_vessel
from tests.test_cli import run
from tests.test_imports import modules_after

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "data" / "maps" / "bridge.toml"
HARBOUR = ROOT / "data" / "scenarios" / "harbour.toml"
SOURCES = {"udp": UdpSource, "tcp": TcpSource, "serial": SerialSource, "file": FileSource, "n2k": N2kSource}


def sections(text: str) -> dict[str, set[str]]:
    """Keys by section of a settings file, those in commented lines too; sources by their kind."""
    found, name = {"": set()}, ""
    for line in text.splitlines():
        line = re.sub(r"^# (?=\[\[?[a-z]|[a-z0-9_]+ = )", "", line)
        if head := re.match(r"\[\[?(\w+)\]\]?", line):
            name = head[1]
            found.setdefault(name, set())
        elif key := re.match(r"(\w+) = ", line):
            if key[1] == "kind":
                name = line.split('"')[1]
                found[name] = set()
            found[name].add(key[1])
    return found


def test_sample_settings_name_every_key():
    """Oracle: the models: the sample can be read, names all their keys in their sections, and none that they do not know."""
    config = read_bridge(SAMPLE).config
    assert config.share is not None and config.output is not None and config.record is not None
    said = sections(SAMPLE.read_text())
    models: dict[str, type[BaseModel]] = dict(SOURCES)
    single = set()
    for key, field in BridgeConfig.model_fields.items():
        inner = [t for t in (field.annotation, *getattr(field.annotation, "__args__", ())) if isinstance(t, type)]
        model = next((t for t in inner if issubclass(t, BaseModel)), None)
        if model is not None and key not in ("antennas", "sources"):
            models[key] = model
        elif key not in ("antennas", "sources", "scale"):
            single.add(key)
    assert said.pop("") == single
    assert said.pop("sources") == set() and said.pop("scale") == {"yaw_rate_deg_s"}
    assert said.pop("antennas") == {"bow", "stern"} and set(Antenna.model_fields) == {"source", "station_m"}
    assert said == {name: set(model.model_fields) for name, model in models.items()}


def test_harbour_is_complete():
    """Contract: chart, checkpoint and ships that the sample scenario names are there; its ships are under way as it says."""
    scenario = read_scenario(HARBOUR)
    assert (HARBOUR.parent / scenario.bridge.chart).is_file()
    assert Predictor.load(HARBOUR.parent / scenario.bridge.checkpoint).contract.vessel.name == scenario.vessel
    bridge = SimulatedBridge(scenario, 1.7e9)
    assert [ship.name for ship in bridge.traffic] == [ship.name for ship in scenario.bridge.ships]


@pytest.mark.parametrize(
    ("old", "new", "flag", "said"),
    [
        (
            'host = "127.0.0.1"\nport = 8765',
            'host = "0.0.0.0"\nport = 8765\ntoken = "sixteen-and-more"',
            False,
            "--expose",
        ),
        ('host = "127.0.0.1"\nport = 8765', 'host = "0.0.0.0"\nport = 8765', True, "token"),
        ('interface = "127.0.0.1"', 'interface = "192.0.2.7"', False, "--expose"),
        ('interface = "127.0.0.1"', 'listen = "127.0.0.1:10131"', False, "one of group"),
        ('group = "239.192.0.90:10130"', 'listen = "0.0.0.0:10131"', False, "--expose"),
        ('group = "239.192.0.90:10130"', 'group = "10.0.0.1:10130"', False, "multicast"),
        ("port = 8765", "port = 80000", False, "server.port"),
        ('folder = "../../runs/bridge"', 'folder = "x"\nday = 1', False, "record.day"),
    ],
)
def test_settings_that_are_refused_are_one_line(tmp_path, old, new, flag, said):
    """Law: exit code 2 and one line that names the file; nothing is opened to others without flag and token."""
    text = SAMPLE.read_text().replace("../charts/sound.geojson", str(ROOT / "data/charts/sound.geojson"))
    file = tmp_path / "bridge.toml"
    assert old in text
    file.write_text(text.replace(old, new))
    code, error = run("serve", "--config", file, *(["--expose"] if flag else []))
    assert code == 2 and said in error and "bridge.toml" in error and error.count("\n") == 1


def test_exposed_settings_pass_with_the_flag(tmp_path, monkeypatch):
    """Law: --expose and a token together let an address in that others can reach: it is then the network that refuses a foreign one."""
    text = SAMPLE.read_text().replace("../charts/sound.geojson", str(ROOT / "data/charts/sound.geojson"))
    old = 'host = "127.0.0.1"\nport = 8765'
    assert old in text
    file = tmp_path / "bridge.toml"
    file.write_text(text.replace(old, 'host = "192.0.2.7"\nport = 8765\ntoken = "sixteen-and-more"'))
    code, error = run("serve", "--config", file, "--expose")
    assert code == 2 and "192.0.2.7:8765 cannot be used" in error


def test_a_port_in_use_is_one_line():
    """Law: who finds the port taken is told which, at once, before anything is compiled."""
    with start._loop().listen("127.0.0.1", 0) as taken:
        code, error = run("bridge", HARBOUR, "--port", taken.getsockname()[1])
    assert (
        code == 2 and "choose another port" in error and error.splitlines()[-1].startswith("error: server: 127.0.0.1")
    )


@pytest.mark.parametrize(
    ("checkpoint", "said"),
    [("workboat8", "is for workboat8, but this ship is cargo90"), ("nowhere", "nowhere")],
)
def test_a_checkpoint_that_cannot_be_used_stops_nothing(checkpoint, said):
    """Issue 8: another ship's checkpoint, or none that can be read, is a failure that is told; the arc alone is left."""
    predictor, failures = start._model(ROOT / "checkpoints" / checkpoint, load_vessel("cargo90"))
    assert predictor is None
    assert said in failures["checkpoint"].reason and "arc alone" in failures["checkpoint"].reason
    assert "\n" not in failures["checkpoint"].reason


def test_own_checkpoint_is_taken():
    """By hand: the ship's own is loaded, and none at all is no failure."""
    predictor, failures = start._model(ROOT / "checkpoints" / "cargo90", load_vessel("cargo90"))
    assert predictor is not None and predictor.name == "cargo90" and failures == {}
    assert start._model(None, load_vessel("cargo90")) == (None, {})


def test_a_missing_package_is_one_line(monkeypatch):
    """Law: without the extra `serve` the command says how it is installed."""
    monkeypatch.setitem(sys.modules, "websockets", None)
    with pytest.raises(InputError, match=r"needs websockets, .*pip install 'aspnn\[serve\]'"):
        start.run(SAMPLE, None)


def test_a_ship_on_a_leg_goes_to_and_fro():
    """Oracle: the leg itself: a ferry of 5 kn is never further from its start than its leg and a step, and comes back; a circle closes."""
    bridge = SimulatedBridge(read_scenario(HARBOUR), 1.7e9)
    ferry, circle = bridge.traffic[0], bridge.traffic[2]
    began, far, near = ferry.place, [], circle.place
    for _ in range(int(2 * 1100 / ferry.speed / 0.1) + 1):
        ferry.move(0.1)
        far.append(abs(ferry.place - began))
    assert 1100 <= max(far) <= 1100 + ferry.speed * 0.1 + 1e-6
    assert far[-1] < 1.0
    for _ in range(7200):
        circle.move(0.1)
    assert abs(circle.place - near) < 1e-6  # 30 degrees a minute: twelve minutes a round
    assert len(SimulatedBridge(read_scenario(ROOT / "data/scenarios/williamson.toml"), 1.7e9).traffic) == len(SHIPS)


def test_the_commands_help_without_reading_the_bridge():
    """sys.modules of a fresh interpreter: naming the commands reads no server, array or network; predicting reads no server."""
    modules = modules_after("import aspnn.cli.live")
    assert not modules & {"fastapi", "uvicorn", "websockets", "numpy", "torch", "pydantic", "pyais"}
    modules = modules_after("from aspnn.prediction import Predictor; Predictor.load('checkpoints/cargo90')")
    assert "torch" in modules or "numpy" in modules
    assert not modules & {"fastapi", "uvicorn", "websockets", "prometheus_client", "pyais", "serial"}


def test_help_names_both_commands():
    """By hand: each command's help exits with 0 and names its options."""
    for command, option in (("serve", "--expose"), ("bridge", "--chart")):
        done = subprocess.run([sys.executable, "-m", "aspnn.cli", command, "--help"], capture_output=True, text=True)
        assert done.returncode == 0 and option in done.stdout
