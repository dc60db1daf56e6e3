"""`aspnn serve` as real processes on free ports: what the outside sees, kills and restarts, slow clients, sharing.

One server (module fixture) is fed a simulated ship's sentences by UDP. It goes on from a state that is saved here, so that nobody
waits half a minute for the predictor's history. What is measured is printed (`pytest -s`), not asserted.
"""

import asyncio
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import pynmea2
import pytest
import websockets

from aspnn.live.bridge import SimulatedBridge
from aspnn.live.core import SAVED
from aspnn.live.estimator import LiveEstimator
from aspnn.live.intake import Intake
from aspnn.live.start import settings_of
from aspnn.records import read_log, read_states, read_table
from aspnn.simulation.scenario import read_scenario

ROOT = Path(__file__).parents[2]
HARBOUR = ROOT / "data" / "scenarios" / "harbour.toml"
PAST = 45.0  # s of states before the server starts: more than the predictor's history
COLD = 400.0  # s that a first start may take, which compiles
SETTINGS = """
predict_hz = 5
latency_s = 0.3
[ship]
vessel = "cargo90"
zone = "33N"
[antennas]
bow = {{ source = "GP0001", station_m = [35.0, 0.0] }}
stern = {{ source = "GN0001", station_m = [-35.0, 0.0] }}
[[sources]]
kind = "udp"
name = "bus"
host = "127.0.0.1"
port = {udp}
[server]
port = {port}
{more}
"""
SHARE = """[share]
name = "{name}"
group = "239.192.0.93:47093"
"""


def multicast_works() -> bool:
    """Whether a datagram to a group comes back on the loopback interface."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("239.192.0.94", 0))
            member = socket.inet_aton("239.192.0.94") + socket.inet_aton("127.0.0.1")
            probe.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            probe.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
            probe.settimeout(1)
            probe.sendto(b"?", probe.getsockname())
            return probe.recv(1) == b"?"
        except OSError:
            return False


MULTICAST = multicast_works()


def free(kind: int = socket.SOCK_STREAM) -> int:
    """A port that nobody has now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def until(condition, seconds: float, what: str):
    """The first true answer of `condition`; a failure after `seconds`."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            if found := condition():
                return found
        except (httpx.HTTPError, OSError):
            pass
        time.sleep(0.02)
    raise AssertionError(f"not within {seconds:g} s: {what}")


class Ship(threading.Thread):
    """A simulated ship that sends her sentences to UDP ports at the pace of the clock; the first PAST seconds are `past`."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        began = time.time() - PAST
        self.bridge = SimulatedBridge(read_scenario(HARBOUR), began)
        self.past = self.bridge.advance(time.time())
        self.ports: list[int] = []
        self.spoilt: list[str] = []  # sent once, as they are
        self.stopped = threading.Event()

    def run(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self.stopped.wait(0.02):
                now = time.time()
                lines = [
                    line for sent, line in self.bridge.advance(now) if now - sent < 0.5
                ]  # what was not sent in time is not sent
                while self.spoilt:
                    lines.append(self.spoilt.pop())
                for line in lines:
                    for port in self.ports:
                        out.sendto(f"{line}\r\n".encode("latin-1"), ("127.0.0.1", port))

    def save(self, folder: Path) -> float:
        """The filters' state after the past, as a server would have saved it; returns its epoch."""
        settings = settings_of(self.bridge)
        intake = Intake(settings)
        estimator = LiveEstimator(settings.vessel, settings.zone, 600.0, tuple(settings.config.antennas))
        for sent, line in self.past:
            intake.feed(line, sent, "bridge")
            estimator.push(intake.rows(sent))
        folder.mkdir(exist_ok=True)
        estimator.save(folder / SAVED)
        os.utime(folder / SAVED, (0, 0))  # as of a run of long ago: all is compiled before the page is served
        return estimator.began


class Served:
    """`aspnn serve` as a process of its own."""

    def __init__(
        self, place: Path, name: str, more: str, udp: int, checkpoint: Path | None = None, *flags: str
    ) -> None:
        self.port, self.folder = free(), place / name
        self.folder.mkdir(exist_ok=True)
        (self.folder / "bridge.toml").write_text(SETTINGS.format(udp=udp, port=self.port, more=more))
        words = [] if checkpoint is None else [str(checkpoint)]
        self.command = [
            sys.executable,
            "-m",
            "aspnn.cli",
            "serve",
            *words,
            "--config",
            str(self.folder / "bridge.toml"),
        ]
        self.command += flags
        self.url = f"http://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        self.log = open(self.folder / "log.txt", "a")  # noqa: SIM115 - closed by `stop`
        self.process = subprocess.Popen(self.command, stderr=self.log, stdout=self.log, env=os.environ, cwd=ROOT)

    def get(self, path: str, **more) -> httpx.Response:
        return httpx.get(self.url + path, timeout=10, **more)

    def situation(self) -> dict:
        found = self.get("/api/situation")
        return found.json() if found.status_code == 200 else {}

    def ready(self) -> bool:
        assert self.process.poll() is None, self.said()
        return self.get("/ready").status_code == 200

    def work(self) -> float:
        """Seconds of processor that the process has taken."""
        lines = self.get("/metrics").text.splitlines()
        return next(float(line.split()[1]) for line in lines if line.startswith("process_cpu_seconds_total"))

    def said(self) -> str:
        return (self.folder / "log.txt").read_text()

    def stop(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        code = self.process.wait(30)
        self.log.close()
        return code


@pytest.fixture(scope="module")
def ship():
    one = Ship()
    yield one
    one.stopped.set()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("serve")


@pytest.fixture(scope="module")
def out():
    """A socket that hears what is sent to other systems."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(10)
        yield listener


@pytest.fixture(scope="module")
def served(ship, place, out):
    udp = free(socket.SOCK_DGRAM)
    (place / "chart.geojson").write_text("this is no chart")
    more = f"""[record]
folder = "record"
[output]
udp = "127.0.0.1:{out.getsockname()[1]}"
[chart]
path = "../chart.geojson"
""" + SHARE.format(name="OWN")
    (place / "own").mkdir()
    began = ship.save(place / "own" / "record")
    one = Served(place, "own", more, udp, ROOT / "checkpoints" / "cargo90")
    one.began = began
    ship.ports.append(udp)
    ship.start()
    until(one.ready, COLD, "ready")
    yield one
    if one.process.poll() is None:
        one.stop(signal.SIGKILL)


def test_everything_is_served(served, ship):
    """Contract: the page's files, health, the situation by both ways, GeoJSON, metrics; the prediction goes on from the saved state."""
    until(lambda: served.situation().get("forecast"), 20, "a forecast")
    message = served.situation()
    state = ship.bridge.state[0]
    assert message["own"]["name"] == "cargo90" and abs(message["own"]["surge"] - state[3]) < 0.3
    assert message["model"]["name"] == "cargo90" and len(message["forecast"]["outlines"]) == 9
    assert message["track"]["time"][0] < served.began + 15  # of before the server was there
    assert served.get("/").text.startswith("<!doctype html>") and served.get("/health").json() == {"status": "alive"}
    kinds = {feature["geometry"]["type"] for feature in served.get("/api/situation.geojson").json()["features"]}
    assert kinds >= {"Polygon", "LineString"}
    names = dict(
        line.rsplit(" ", 1)
        for line in served.get("/metrics").text.splitlines()
        if line.startswith(("aspnn_", "process_"))
    )
    assert float(names["aspnn_sentences"]) > 10 and float(names["process_resident_memory_bytes"]) > 1e6
    assert float(names["aspnn_loop_failures"]) == 0 and float(names["aspnn_tick_seconds_count"]) > 0


def test_a_chart_that_is_none_is_told_and_lived_with(served):
    """Issue 8: an alarm and a line in the log that name the file; the picture is alive, the chart 404."""
    alarm = next(a for a in served.situation()["alarms"] if a["code"] == "failed_chart")
    assert "chart.geojson" in alarm["text"] and "\n" not in alarm["text"]
    assert served.get("/api/chart").status_code == 404
    until(lambda: "failed_chart" in served.said(), 5, "a line in the log")
    assert served.said().count("failed_chart") == 1


def test_sentences_go_out(served, out):
    """Oracle: pynmea2: VBW once a second with the speeds over ground, nine $PASPN with right checksums after each."""
    while select.select([out], [], [], 0)[0]:  # what was sent before
        out.recv(200)
    said, began = [], time.monotonic()
    while time.monotonic() - began < 2.2:
        said.append(out.recv(200).decode("ascii"))
    vbw = [pynmea2.parse(line.strip(), check=True) for line in said if line[3:6] == "VBW"]
    assert 1 <= len(vbw) <= 3
    own = served.situation()["own"]
    assert float(vbw[-1].lon_grnd_spd) * 1852 / 3600 == pytest.approx(own["surge"], abs=0.2)
    assert float(vbw[-1].trans_grnd_spd) * 1852 / 3600 == pytest.approx(own["sway_bow"], abs=0.2)
    assert vbw[-1].data_validity_water_spd == "V" and vbw[-1].lon_water_spd is None
    paspn = [line for line in said if line.startswith("$PASPN")]
    assert all(pynmea2.NMEASentence.checksum(line[1:].split("*")[0]) == int(line.strip()[-2:], 16) for line in paspn)
    steps = [int(line.split(",")[3]) for line in paspn]
    assert steps[steps.index(1) :][:9] == list(range(1, 10))
    print(f"\n{len(vbw)} VBW and {len(paspn)} $PASPN in 2.2 s")


def test_what_if_beyond_the_stops_leaves_the_picture_alive(served):
    """Issue 8: 400 and one line; the next situation comes, and a plan within the stops is answered."""
    before = served.situation()["sequence"]
    refused = httpx.post(served.url + "/api/whatif", json={"plan": [[0, 60]]}, timeout=10)
    assert refused.status_code == 400 and "stops" in refused.json()["error"] and "\n" not in refused.json()["error"]
    until(lambda: served.situation()["sequence"] > before, 5, "a newer situation")
    good = httpx.post(served.url + "/api/whatif", json={"plan": [[0, 20]]}, timeout=20)
    assert good.status_code == 200 and good.json()["paths"][0]["heading"][-1] != good.json()["paths"][0]["heading"][0]
    assert httpx.post(served.url + "/api/order", json={"rudder": 5}, timeout=10).status_code == 404


def test_noise_is_counted_and_told(served, ship):
    """Issue 8: sentences that are damaged or unknown are counted by their fault, and the picture goes on."""
    before = served.situation()
    ship.spoilt += ["$GPGGA,1,2,3*00", "$XXQQQ,1,2", "\x00\xff\xfe", "$" + "A" * 5000, "!AIVDM,1,1,,A,notasixbit,9*00"]
    until(
        lambda: (
            sum((now := served.situation())["counts"]["rejected"].values())
            >= sum(before["counts"]["rejected"].values()) + 4
            and now["sequence"] > before["sequence"]
        ),
        10,
        "the counts",
    )
    assert "Traceback" not in served.said()


def test_twenty_clients_one_that_never_reads_and_one_dead(served):
    """Issue 8: the others get as many messages as alone (each is the newest: sequences rise), and the server lets the silent ones be."""

    async def listen(seconds: float) -> list[int]:
        got = []
        async with websockets.connect(f"ws://127.0.0.1:{served.port}/ws", max_size=None) as socket_:
            end = time.monotonic() + seconds
            while (left := end - time.monotonic()) > 0:
                try:
                    got.append(json.loads(await asyncio.wait_for(socket_.recv(), left))["sequence"])
                except TimeoutError:
                    break
        return got

    def silent() -> socket.socket:
        """A client that says what it must to be let in, and then never reads."""
        made = socket.socket()
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        made.connect(("127.0.0.1", served.port))
        words = f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        made.sendall(
            f"{words}Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        return made

    async def many() -> tuple[list[int], list[list[int]]]:
        alone = await listen(2.0)
        held, dead = silent(), silent()
        dead.close()
        found = await asyncio.gather(*(listen(2.0) for _ in range(18)))
        held.close()
        return alone, found

    alone, found = asyncio.run(many())
    assert all(got == sorted(set(got)) for got in found)
    least = min(map(len, found))
    print(f"\nmessages in 2 s: {len(alone)} alone, {least} to {max(map(len, found))} with 20 clients")
    assert least >= 0.5 * len(alone)
    assert "Traceback" not in served.said()


def test_two_instances_see_each_other(served, place, ship):
    """Issue 8: over UDP multicast two servers are targets to each other, of kind "shared"; the second wants a token, and gets it."""
    if not MULTICAST:
        pytest.skip("this computer's loopback takes no multicast")
    udp, token = free(socket.SOCK_DGRAM), "sixteen-and-more"
    (place / "other" / "record").mkdir(parents=True)
    shutil.copy(served.folder / "record" / SAVED, place / "other" / "record" / SAVED)
    more = f'token = "{token}"\n[record]\nfolder = "record"\n' + SHARE.format(name="OTHER")
    ship.ports.append(udp)
    other = Served(place, "other", more, udp, ROOT / "checkpoints" / "cargo90")
    try:
        until(other.ready, COLD, "ready")
        assert other.get("/api/situation").status_code == 401
        head = {"authorization": f"Bearer {token}"}

        def seen(message: dict) -> list[str]:
            return [t["name"] for t in message["targets"] if t["kind"] == "shared"]

        until(lambda: "OTHER" in seen(served.situation()), 60, "the other as a target")
        until(lambda: "OWN" in seen(other.get("/api/situation", headers=head).json()), 60, "own ship as its target")
    finally:
        ship.ports.remove(udp)
        assert other.stop() == 0
    assert "Traceback" not in served.said() + other.said()


def test_killed_it_goes_on_from_where_it_was(served):
    """Issue 8: kill -9: the states go on at the epoch of before, the record misses the last second at most; measured and printed."""
    message = served.situation()
    epoch = message["track"]["time"][0]
    killed = message["time"]
    served.stop(signal.SIGKILL)
    began = time.monotonic()
    served.start()
    until(lambda: (served.situation().get("time") or 0) > killed + 0.5, COLD, "newer states")
    picture, work = time.monotonic() - began, served.work()
    until(served.ready, COLD, "ready")
    now = until(lambda: (m := served.situation()).get("forecast") and m, 60, "a forecast")
    took = time.monotonic() - began
    print(
        f"\nkill -9: newer states after {picture:.1f} s ({work:.1f} s of processor), the prediction after {took:.1f} s"
    )
    assert now["track"]["time"][0] <= epoch + 10.0
    assert "go on from where they were" in served.said()
    logs = [(f, read_log(f)) for f in sorted((served.folder / "record").glob("log-*.parquet"))]
    file, log = logs[-1]
    assert len(log) > 10 and not list((served.folder / "record").glob(f"{file.stem}.jsonl"))
    last = time.mktime(time.strptime(log.start, "%Y-%m-%dT%H:%M:%SZ")) - time.timezone + log.table["time_s"].iloc[-1]
    assert last >= killed - 1.5


def test_told_to_stop_it_leaves_whole_files(served):
    """Issue 8: SIGTERM with a client on: exit code 0, every part is Parquet that its reader takes, no journal is left."""
    with socket.create_connection(("127.0.0.1", served.port)):
        time.sleep(1.5)
        assert served.stop() == 0
    folder = served.folder / "record"
    assert not list(folder.glob("*.jsonl")) and (folder / SAVED).exists()
    assert all(len(read_states(f)) for f in folder.glob("states-*.parquet"))
    predictions = [read_table(f) for f in sorted(folder.glob("predictions-*.parquet"))]
    assert predictions and predictions[-1][1]["model"] == "cargo90"
    table = predictions[-1][0]
    assert table["north_m"].notna().any() and set(table["horizon_s"]) == {30.0, 60.0, 90.0}
    assert "stopped; all is saved" in served.said() and "Traceback" not in served.said()
