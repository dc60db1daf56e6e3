"""bridge.toml: what it takes, and one line that names file and key for everything wrong in it."""

import pytest

from aspnn.live.config import host_port, read_bridge
from aspnn.schema import InputError

GOOD = """
latency_s = 0.3
[ship]
vessel = "cargo90"
zone = "33n"
mmsi = 257000001
[antennas]
bow = { source = "GP", station_m = [30.0, 1.0] }
[sensors]
heading = "HE"
[[sources]]
kind = "udp"
port = 60001
group = "239.192.0.1"
[[sources]]
kind = "serial"
port = "/dev/ttyUSB0"
[[sources]]
kind = "tcp"
host = "10.0.0.7"
port = 60002
[output]
udp = "127.0.0.1:10110"
[share]
group = "239.192.0.9:60009"
name = "Ada"
[chart]
path = "chart.json"
[record]
folder = "kept"
"""


PLAYED = """
[ship]
vessel = "cargo90"
zone = "33N"
[antennas]
bow = { source = "GP", station_m = [30.0, 1.0] }
[[sources]]
kind = "file"
path = "day.nmea"
speed = 10
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        for name in ("day.nmea", "chart.json"):
            (tmp_path / name).write_text("")
        (tmp_path / "bridge.toml").write_text(text)
        return read_bridge(tmp_path / "bridge.toml")

    return read


def test_a_whole_file(read, tmp_path):
    """By hand: what is written and what is left out; paths count from the file, antennas stand where it says."""
    bridge = read(GOOD)
    config = bridge.config
    assert bridge.vessel.stations["bow"] == (30.0, 1.0) and str(bridge.zone) == "33N"
    assert config.ship.mmsi == 257000001 and config.chart.path == str(tmp_path / "chart.json")
    assert config.record.folder == str(tmp_path / "kept") and config.record.hours == 72
    assert [s.name for s in config.sources] == ["udp", "serial", "tcp"] and config.sources[1].baud == 38400
    assert (config.latency_s, config.rate_hz, config.server.host, config.server.local) == (0.3, 10.0, "127.0.0.1", True)
    assert config.map.antennas["bow"].source == "GP" and config.map.sensors.heading == "HE"
    assert host_port(config.share.group) == ("239.192.0.9", 60009)


@pytest.mark.parametrize(
    "old, new, words",
    [
        ('vessel = "cargo90"', 'vessel = "titanic9"', "titanic9"),
        ('zone = "33n"', 'zone = "33X"', "ship.zone: zone '33X'"),
        ("257000001", "2570001", "ship.mmsi: 2570001 is no ship's MMSI"),
        ("port = 60001", "port = 70000", "sources.0.port: input should be less"),
        ("port = 60001", "ports = 60001", "sources.0.port: is missing"),
        ('kind = "udp"', 'kind = "radio"', "sources.0"),
        ("239.192.0.1", "10.0.0.1", "sources.0.group: '10.0.0.1' is no multicast address"),
        ("127.0.0.1:10110", "127.0.0.1", "output.udp: '127.0.0.1' is no address"),
        ("[share]", '[server]\nhost = "0.0.0.0"\n[share]', "server: host 0.0.0.0 can be reached by others: set token"),
        ('kind = "serial"', 'kind = "serial"\nname = "udp"', "two are named udp"),
        ('host = "10.0.0.7"\nport = 60002', 'host = "10.0.0.7"', "sources.2.port: is missing"),
        ('"tcp"\nhost = "10.0.0.7"\nport = 60002', '"file"\npath = "day.nmea"', "file is a recording, udp is live"),
        ("chart.json", "map.json", "chart.path"),
        ("bow = {", 'aft = { source = "GP", station_m = [0.0, 0.0] }\nbow = {', "two have the same source"),
        ("[sensors]", "[scale]\nheading = -1\n[sensors]", "scale: heading is not a column of a log"),
        ("latency_s = 0.3", "latency_s = 0.3\ncolour = 1", "colour: is not a known key"),
        ('heading = "HE"', 'compass = "HE"', "sensors.compass: is not a known key"),
        ("[ship]", "[ship", "cannot be read as TOML"),
    ],
)
def test_what_is_wrong_is_named(read, old, new, words):
    """Contract: one line with the file, the key and what to do."""
    assert old in GOOD
    with pytest.raises(InputError) as caught:
        read(GOOD.replace(old, new, 1))
    said = str(caught.value)
    assert "\n" not in said and words in said and "bridge.toml" in said


def test_a_recording(read, tmp_path):
    """By hand: paths count from the file; two recordings are played together, one that is not there is named."""
    bridge = read(PLAYED + '[[sources]]\nkind = "n2k"\npath = "day.nmea"\n')
    assert [s.path for s in bridge.config.sources] == [str(tmp_path / "day.nmea")] * 2
    with pytest.raises(InputError, match=r"sources\.0\.path: .*night\.nmea: no such file"):
        read(PLAYED.replace("day.nmea", "night.nmea"))


def test_a_token_opens_the_server(read):
    """Contract: another address than this computer's own is taken with a token of 16 characters, not with a short one."""
    server = '[server]\nhost = "192.168.1.4"\ntoken = "%s"\n[share]'
    assert not read(GOOD.replace("[share]", server % ("x" * 16))).config.server.local
    with pytest.raises(InputError, match="16 characters"):
        read(GOOD.replace("[share]", server % ("x" * 15)))
