"""The page of the live bridge: what it is made of, and what it shows in a browser of the recorded messages."""

import copy
import hashlib
import json
import math
import re
import shutil
import socket
import statistics
import threading
import time

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("uvicorn")
import uvicorn

from tests.live.feeder import CHART, PAGE, crowded, feeder, recording

CHROMIUM = shutil.which("chromium")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@pytest.fixture(scope="module")
def recorded() -> dict:
    return recording()


def keys(thing) -> set[str]:
    """All keys of a message, at any depth."""
    if isinstance(thing, dict):
        return set(thing) | {key for value in thing.values() for key in keys(value)}
    return {key for value in thing for key in keys(value)} if isinstance(thing, list) else set()


def test_the_recording_has_the_keys_of_the_document(recorded):
    """Oracle: the keys in the first block of SITUATION.md; those of rejected sentences are the classes' own."""
    block = (PAGE / "SITUATION.md").read_text().split("```")[1]
    block = re.sub(r'"rejected": \{[^}]*\}', '"rejected": 0', block)
    documented = set(re.findall(r'"(\w+)":', block))
    assert {key for message in recorded["situations"] for key in keys(message)} - {"checksum"} == documented


def test_the_recording_holds_to_the_document(recorded):
    """Oracle: the document's laws: one length, closed rings, the time marks, finite numbers, most dangerous first."""
    assert len(recorded["situations"]) == 60
    for message in recorded["situations"]:
        json.dumps(message, allow_nan=False)
        forecast, track = message["forecast"], message["track"]
        names = ("lat", "lon", "heading", "surge", "sway_bow", "sway_stern", "rot", "pivot")
        assert {len(forecast[name]) for name in names} == {len(forecast["time"])}
        assert {len(track[name]) for name in names[:-1]} == {len(track["time"])} and track["time"][-1] <= message[
            "time"
        ]
        assert [outline["time"] for outline in forecast["outlines"]] == list(range(10, 91, 10))
        rings = [outline["ring"] for outline in forecast["outlines"] + forecast["regions"]]
        for ring in [*rings, *forecast["swept"], *forecast["region_swept"]]:
            assert ring[0] == ring[-1] and all(10 < lon < 25 and 69 < lat < 70 for lon, lat in ring)
        dangerous = [target["dangerous"] for target in message["targets"]]
        assert dangerous == sorted(dangerous, reverse=True)


def test_vendored_files_are_those_of_the_packages():
    """Oracle: the hashes of the files in the packages of the npm registry, written down when they were taken."""
    table = (PAGE / "vendor" / "README.md").read_text()
    listed = dict(re.findall(r"^\| (\S+) \|.*\| ([0-9a-f]{64}) \|$", table, re.MULTILINE))
    assert len(listed) == 4
    for name, digest in listed.items():
        assert hashlib.sha256((PAGE / "vendor" / name).read_bytes()).hexdigest() == digest


def test_nothing_of_the_page_is_elsewhere():
    """Oracle: the content security policy's own rules: no inline script or style, no handler, no address outside."""
    html = (PAGE / "index.html").read_text()
    assert not re.search(r"<style|style=|\son\w+=|<script(?![^>]*\ssrc=)", html)
    for name in re.findall(r'(?:src|href)="([^"]+)"', html):
        assert (PAGE / name).is_file()
    for file in [*PAGE.glob("*.js"), *PAGE.glob("*.css"), PAGE / "index.html"]:
        outside = set(re.findall(r"\w+://[^\"'`\s]+", file.read_text())) - {"http://www.w3.org/2000/svg"}
        assert not outside, file.name
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|\beval\(|new Function", file.read_text())


def test_sample_chart_is_geojson():
    """Oracle: RFC 7946: a FeatureCollection of geometries in longitude and latitude; every kind that clearances need."""
    chart = json.loads(CHART.read_text())
    assert chart["type"] == "FeatureCollection"
    assert {"land", "depth", "berth", "buoy", "danger"} <= {
        feature["properties"]["kind"] for feature in chart["features"]
    }
    assert all(
        feature["geometry"]["type"] in ("Point", "LineString", "Polygon", "MultiPolygon")
        for feature in chart["features"]
    )


class Served:
    """A feeder in a thread of its own, on a free port of this machine."""

    def __init__(self, app, port: int = 0) -> None:
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(("127.0.0.1", port))
        self.port = self.socket.getsockname()[1]
        self.server = uvicorn.Server(uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=1))
        self.thread = threading.Thread(target=self.server.run, args=([self.socket],), daemon=True)

    def __enter__(self) -> "Served":
        self.thread.start()
        while not self.server.started:
            time.sleep(0.01)
        return self

    def __exit__(self, *_) -> None:
        self.server.should_exit = True
        self.thread.join()
        self.socket.close()


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as run:
        opened = run.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def opened(browser):
    """Open a page on a server; whatever it asks of another machine and whatever it complains of is collected."""
    context = browser.new_context(viewport={"width": 1600, "height": 1000})
    page = context.new_page()
    page.outside, page.complaints = [], []
    page.on(
        "request",
        lambda r: (
            page.outside.append(r.url) if "//127.0.0.1:" not in r.url and r.url[:5] not in ("data:", "blob:") else None
        ),
    )
    page.on("console", lambda m: page.complaints.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda e: page.complaints.append(str(e)))
    yield page
    assert page.outside == []
    context.close()


def sequence(page, at_least: int) -> None:
    page.wait_for_function("n => Number(document.body.dataset.sequence) >= n", arg=at_least)


EXTENTS = (
    "() => ['swept', 'region', 'outlines'].map(n => aspnn.chart.sources[n].getFeatures()[0].getGeometry().getExtent())"
)


def test_the_picture_is_drawn_and_moves(recorded, opened):
    """Oracle: the message: the hull's length on the sphere, nine predicted ships, rotation by the heading; no complaint of the policy."""
    with Served(feeder(recorded, 0.2)) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/?palette=night&up=head")
        sequence(opened, 1)
        before = opened.evaluate(EXTENTS)
        sequence(opened, 8)
        assert all(a != b for a, b in zip(before, opened.evaluate(EXTENTS), strict=True))
        ends = opened.evaluate(
            "() => { const f = aspnn.chart.sources.own.getFeatures().find(f => f.get('look') === 'hull');"
            "const ring = f.getGeometry().getCoordinates()[0].map(p => ol.proj.toLonLat(p));"
            "const own = aspnn.chart.situation.own; const far = Math.max(...ring.map(p => ol.sphere.getDistance(p, ring[0])));"
            "return [far, own.length, own.beam, aspnn.chart.view.getRotation(), own.heading] }"
        )
        far, length, beam, rotation, heading = ends
        assert math.hypot(length, 0.35 * beam) == pytest.approx(
            far, rel=2e-3
        )  # from the bow to a corner of the transom
        assert math.remainder(rotation + math.radians(heading), math.tau) == pytest.approx(0, abs=1e-9)
        ships = (
            "() => aspnn.chart.sources.outlines.getFeatures().filter(f => f.getGeometry().getType() === 'MultiPolygon')"
            ".reduce((n, f) => n + f.getGeometry().getPolygons().length, 0)"
        )
        assert opened.evaluate(ships) == 9
        assert opened.evaluate("() => aspnn.chart.sources.chart.getFeatures().length") > 10
        # On a northerly heading starboard is east: 100 m, and none to the north.
        beam = opened.evaluate(
            "async () => { const { onBoard } = await import('./geometry.js'); return onBoard({ lon: 18, lat: 69, heading: 0 }, 0, 100); }"
        )
        east = math.radians(beam[0] - 18) * math.cos(math.radians(69)) * 6371008.8
        assert (east, beam[1]) == pytest.approx((100, 69), abs=1e-6)
        opened.wait_for_selector("#banner", state="hidden")
        assert opened.get_attribute("html", "data-palette") == "night"
    assert not [text for text in opened.complaints if "WebSocket" not in text and "ERR_CONNECTION" not in text]


def test_what_if_by_the_rudder_dial(recorded, opened):
    """Oracle: the recorded answer has a plan only when one is asked for; the rudder is put where the pointer is."""
    with Served(feeder(recorded, 0.2)) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/")
        sequence(opened, 1)
        opened.keyboard.press("w")
        opened.wait_for_function("() => aspnn.chart.sources.fan.getFeatures().length > 0")
        assert opened.locator("#fan tr.plan").count() == 0
        box = opened.locator("#rudder").bounding_box()
        middle, top = (
            box["x"] + box["width"] / 2,
            box["y"] + box["height"] * 26 / 142,
        )  # the place of the rudder stock in the drawing
        reach = box["height"] * 60 / 142
        opened.mouse.move(middle, top + reach)
        opened.mouse.down()
        angle = math.radians(62 * 20 / 35)  # 62 degrees of the dial are 35 of rudder
        opened.mouse.move(middle + reach * math.sin(angle), top + reach * math.cos(angle))
        opened.mouse.up()
        opened.wait_for_selector("#fan tr.plan")
        assert opened.evaluate("() => aspnn.whatif.plan") == [[0, 20]]
        opened.keyboard.press("ArrowLeft")
        assert opened.evaluate("() => aspnn.whatif.plan") == [[0, 15]]
        opened.keyboard.press("w")
        assert opened.evaluate("() => aspnn.chart.sources.fan.getFeatures().length") == 0


def test_text_from_outside_stays_text(recorded, opened):
    """Oracle: a ship's name that is markup is seen as it was written, and makes no element."""
    message = copy.deepcopy(recorded["situations"][0])
    hostile = "<img src=x onerror=alert(1)>"
    message["targets"][0]["name"] = message["alarms"] = message["own"]["name"] = hostile
    message["alarms"] = [{"code": "x", "severity": "alarm", "text": hostile, "since": message["time"]}]
    with Served(feeder({**recorded, "situations": [message]}, 0.2)) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/")
        sequence(opened, 1)
        assert opened.locator("img").count() == 0
        assert [opened.text_content(place) for place in ("#ship", "#alarms", "#targets td >> nth=5")] == [
            hostile,
            f"{hostile}0 s",
            hostile,
        ]


def test_nothing_known_is_no_failure(recorded, opened):
    """Oracle: every null that SITUATION.md allows: dashes, no complaint, and the next whole message is drawn."""
    whole = recorded["situations"][0]
    empty = dict.fromkeys(whole) | {"version": 1, "sequence": 1, "targets": [], "alarms": []}
    empty |= {"limits": whole["limits"], "counts": whole["counts"], "horizon": 90.0, "rudder": whole["rudder"]}
    empty["scores"] = {**whole["scores"], "count": [0, 0, 0]}
    for name in ("ours", "arc"):
        empty["scores"][name] = {"median": [None] * 3, "last": [None] * 3}
    with Served(feeder({**recorded, "situations": [empty, {**whole, "sequence": 2}]}, 1.0)) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/")
        sequence(opened, 1)
        assert opened.inner_text("#hdg") == "–"
        sequence(opened, 2)
        assert opened.inner_text("#hdg") == f"{whole['own']['heading']:05.1f}"
        assert not opened.complaints


def test_a_lost_server_is_told_and_found_again(recorded, opened):
    """Oracle: the state of the server: gone, the banner stands; back on its port, the picture goes on."""
    with Served(feeder(recorded, 0.2)) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/")
        sequence(opened, 1)
        port = served.port
    opened.wait_for_selector("body[data-link=lost] #banner", state="visible")
    assert "NO CONNECTION" in opened.inner_text("#banner")
    with Served(feeder(recorded, 0.2), port):
        opened.wait_for_selector("#banner", state="hidden")


@pytest.mark.parametrize(
    "text", ["no chart at all", '{"type": "Nonsense"}', '{"type": "FeatureCollection", "features": [7]}']
)
def test_a_chart_that_is_none_is_told_and_the_picture_lives(recorded, opened, tmp_path, text):
    """Oracle: RFC 7946: none of these is GeoJSON: a line says so, nothing of a chart is drawn, and the messages go on."""
    (tmp_path / "chart.json").write_text(text)
    with Served(feeder(recorded, 0.2, tmp_path / "chart.json")) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/")
        opened.wait_for_function("() => document.getElementById('notice').textContent.startsWith('Chart: ')")
        shown = int(opened.get_attribute("body", "data-sequence"))
        sequence(opened, shown + 2)
        assert opened.evaluate("() => aspnn.chart.sources.chart.getFeatures().length") == 0
        assert opened.evaluate("() => aspnn.chart.sources.outlines.getFeatures().length") > 2


def test_a_state_that_stands_still_is_told(recorded, opened):
    """Oracle: the same state again and again, though messages come: after 3 s it is old, and a newer one is none."""
    situations = [recorded["situations"][0]] * 9 + recorded["situations"][1:]
    with Served(feeder({**recorded, "situations": situations}, 0.5)) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/")
        opened.wait_for_selector("body[data-link=live]")
        opened.wait_for_selector("body[data-link=old] #banner", state="visible")
        assert "NOT UPDATED" in opened.inner_text("#banner")
        opened.wait_for_selector("#banner", state="hidden")


def test_fifty_targets_are_drawn(recorded, opened):
    """Oracle: the message: a hull or symbol for each, names for the first dozen, five in the list. Prints what drawing takes."""
    many = crowded(recorded)
    texts = [json.dumps(message) for message in many["situations"][:20]]
    with Served(feeder(many, 0.5)) as served:
        opened.goto(f"http://127.0.0.1:{served.port}/")
        sequence(opened, 2)
        count = (
            "look => aspnn.chart.sources.targets.getFeatures().filter(f => f.get('look').endsWith(look))"
            ".reduce((n, f) => n + (f.getGeometry().getPolygons?.().length ?? 1), 0)"
        )
        assert [opened.evaluate(count, look) for look in ("-hull", "-name")] == [50, 12]
        opened.evaluate(
            "() => aspnn.chart.view.setResolution(100)"
        )  # a ship is smaller than 6 mm: symbols, own of two circles
        assert opened.evaluate(count, "-hull") == 50 and opened.evaluate(count, "-later") == 0
        assert "symbol" in opened.evaluate("() => aspnn.chart.sources.own.getFeatures().map(f => f.get('look'))")
        opened.evaluate("() => aspnn.chart.view.setResolution(2)")
        assert opened.locator("#targets tr").count() == 1 + 1 + 5 + 1  # head, land, five, and the rest as a number
        took = opened.evaluate(
            "async texts => { const took = []; for (const text of texts) { const began = performance.now(); aspnn.draw(JSON.parse(text));"
            "aspnn.chart.map.renderSync(); took.push(performance.now() - began); await new Promise(done => setTimeout(done, 100)); } return took; }",
            texts,
        )
        late = sorted(took)[int(0.9 * len(took))]
        print(f"\na message with 50 targets is drawn in {statistics.median(took):.1f} ms median, {late:.1f} ms p90")
