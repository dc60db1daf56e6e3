"""End to end: `aspnn bridge` as a real process and its page in headless Chromium, steered with mouse and keys.

One process and one page for all tests of this file, which go on from each other in order. What is measured is printed (`pytest -s`).
"""

import os
import signal
import socket
import statistics
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

from tests.live.test_page import CHROMIUM, browser  # noqa: F401 - the fixture

ROOT = Path(__file__).parents[2]
HARBOUR = ROOT / "data" / "scenarios" / "harbour.toml"
COLD = 400.0  # s that a first start may take, which compiles
PREDICTS = 60_000  # ms until the predictor has its half minute of history
ANSWER = 20_000  # ms for what follows at once, on a busy computer
# Counts what leaves this computer, and how old the state of each message is when it stands on the screen.
WATCH = """
const seen = (globalThis.seen = { outside: [], ages: [] });
const Socket = WebSocket;
globalThis.WebSocket = class extends Socket {
  constructor(address, ...more) {
    super(address, ...more);
    if (new URL(address).hostname !== "127.0.0.1") seen.outside.push(String(address));
  }
};
const watch = () => new MutationObserver(() => {
  const { time } = aspnn.chart.situation;
  requestAnimationFrame(() => setTimeout(() => time && seen.ages.push(Date.now() / 1000 - time)));
}).observe(document.body, { attributeFilter: ["data-sequence"] });
document.addEventListener("DOMContentLoaded", watch);
"""
# End and extent of what is predicted, on the chart.
PLACES = """() => Object.fromEntries(['outlines', 'swept', 'region', 'arc'].map(name => {
  const f = aspnn.chart.situation[name === 'arc' ? 'arc' : 'forecast'];
  return [name, [f.lon.at(-1), f.lat.at(-1), ...aspnn.chart.sources[name].getFeatures()[0].getGeometry().getExtent()]];
}))"""
TURNED = """() => { const { forecast, own } = aspnn.chart.situation;
  return forecast && forecast.region_swept.length > 0 && Math.abs(forecast.rot.at(-1)) > 30 && own.rudder_angle > 15; }"""
# Where on the screen the rudder's dial has an angle [deg]: 62 degrees of the dial are the stops.
DIAL = """angle => {
  const a = angle / aspnn.whatif.max * 62 * Math.PI / 180;
  const place = new DOMPoint(60 * Math.sin(a), 60 * Math.cos(a));
  const { x, y } = place.matrixTransform(document.getElementById("rudder").getScreenCTM());
  return [x, y];
}"""


@pytest.fixture(scope="module")
def bridge():
    """The address of a simulated bridge that is ready."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "aspnn.cli", "bridge", str(HARBOUR), "--port", str(port), "--quiet"]
    process = subprocess.Popen(command, env=os.environ | {"OMP_NUM_THREADS": "1"})
    address = f"http://127.0.0.1:{port}"
    try:
        end = time.monotonic() + COLD
        while not answers(f"{address}/ready"):
            assert process.poll() is None and time.monotonic() < end, "the simulated bridge does not start"
            time.sleep(0.1)
        yield address
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(20)
    assert process.returncode == 0


def answers(address: str) -> bool:
    try:
        return urllib.request.urlopen(address, timeout=5).status == 200
    except (urllib.error.URLError, OSError):
        return False


@pytest.fixture(scope="module")
def page(bridge, browser):  # noqa: F811
    """The page, with what it asks for and complains of."""
    made = browser.new_page(viewport={"width": 1600, "height": 900})
    made.asked, made.complaints = [], []
    made.on("request", lambda request: made.asked.append(request.url))
    made.on("websocket", lambda one: made.asked.append(one.url))
    made.on("pageerror", lambda error: made.complaints.append(str(error)))
    made.add_init_script(WATCH)
    made.goto(f"{bridge}/?palette=day&up=north")
    made.wait_for_selector("body[data-sequence]", timeout=ANSWER)
    yield made
    made.close()


def rudder_dial(page, angle: float) -> None:
    """Drag the rudder of the dial from amidships to `angle` [deg], as a hand does."""
    page.mouse.move(*page.evaluate(DIAL, 0))
    page.mouse.down()
    page.mouse.move(*page.evaluate(DIAL, angle))
    page.mouse.up()


def test_a_target_has_its_cpa(page):
    """Oracle: the scenario's ships: each is on the page with CPA and TCPA of both hulls, and on the chart; the chart is drawn."""
    page.wait_for_function("() => aspnn.chart.situation.targets.some(t => t.cpa !== null)", timeout=ANSWER)
    told = page.evaluate("() => aspnn.chart.situation.targets.map(t => [t.name, t.cpa, t.tcpa])")
    page.wait_for_function("() => document.querySelectorAll('#targets tr').length >= 3")
    listed = page.inner_text("#targets")
    for name, cpa, tcpa in told:
        assert name in ("NORDLYS", "HAVBRIS", "TINDEN", "SKARVEN") and name in listed
        assert cpa >= 0 and 0 <= tcpa <= 90
    assert page.evaluate("() => aspnn.chart.sources.targets.getFeatures().length") >= len(told)
    assert page.evaluate("() => aspnn.chart.sources.chart.getFeatures().length") > 10


def test_rudder_over_moves_what_is_predicted(page):
    """Oracle: a ship turns to the side of her rudder: path, outlines, swept area and region go to starboard, and the arc lags them."""
    page.wait_for_function("() => aspnn.chart.situation.forecast?.region_swept.length", timeout=PREDICTS)
    # With a region there is a chance of contact.
    page.wait_for_function("() => aspnn.chart.situation.targets.every(t => t.probability !== null)", timeout=ANSWER)
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    page.wait_for_function("() => aspnn.chart.situation.simulated.rudder_order === 10", timeout=ANSWER)
    before, heading = page.evaluate(PLACES), page.evaluate("() => aspnn.chart.situation.own.heading")
    rudder_dial(page, 20)
    page.wait_for_function("() => aspnn.chart.situation.simulated.rudder_order === 20", timeout=ANSWER)
    page.wait_for_function(TURNED, timeout=ANSWER)
    after = page.evaluate(PLACES)
    assert set(before) == {"outlines", "swept", "region", "arc"}
    assert all(before[name] != after[name] for name in before)
    assert after["outlines"][0] > before["outlines"][0]  # she went north: starboard is east
    end, arc = page.evaluate(
        "() => [aspnn.chart.situation.forecast, aspnn.chart.situation.arc].map(p => p.heading.at(-1))"
    )
    turned = [(h - heading + 180) % 360 - 180 for h in (end, arc)]
    assert turned[0] > 45 and turned[1] > 0
    assert page.inner_text("#rot").startswith("S") and page.text_content("#rudder .value").startswith("S")
    assert len(page.evaluate("() => aspnn.chart.situation.forecast.outlines")) == 9


def test_what_if_shows_the_fan_and_the_order_that_clears(page):
    """Oracle: the place lies on the path in force, so another order must be chosen; by the answer it stays as far off as was asked."""
    page.keyboard.press("w")
    page.wait_for_function("() => aspnn.chart.sources.fan.getFeatures().length >= 30", timeout=ANSWER)
    page.click("#point")
    spot = page.evaluate(
        "() => { const { lon, lat } = aspnn.chart.situation.forecast; const k = Math.round(lon.length * 0.7);"
        "const [x, y] = aspnn.chart.map.getPixelFromCoordinate(ol.proj.fromLonLat([lon[k], lat[k]]));"
        "const box = document.getElementById('map').getBoundingClientRect(); return [box.x + x, box.y + y]; }"
    )
    page.fill("#point-distance", "30")
    page.mouse.click(*spot)
    page.wait_for_function("() => document.getElementById('choice').textContent !== ''", timeout=ANSWER)
    assert page.locator("#fan tr.chosen").count() == 1
    looks = page.evaluate("() => aspnn.chart.sources.fan.getFeatures().map(f => f.get('look'))")
    assert "fan-chosen" in looks and "spot" in looks
    assert " keeps " in page.inner_text("#choice") and " m off" in page.inner_text("#choice")
    page.click("#plan-add")
    page.wait_for_selector("#fan tr.plan", timeout=ANSWER)


def test_a_plan_beyond_the_stops_is_refused_and_the_picture_lives(page):
    """Oracle: the vessel's stops, 35 degrees: a line says so, and messages are drawn after it as before."""
    page.fill("#plan .row input >> nth=1", "50")
    page.keyboard.press("Tab")
    page.wait_for_function("() => /stops|beyond/.test(document.getElementById('notice').textContent)", timeout=ANSWER)
    number = int(page.get_attribute("body", "data-sequence"))
    page.wait_for_function("n => Number(document.body.dataset.sequence) > n + 2", arg=number, timeout=ANSWER)
    page.keyboard.press("Escape")
    page.click("#whatif")
    assert page.evaluate("() => aspnn.chart.sources.fan.getFeatures().length") == 0
    assert page.get_attribute("body", "data-link") == "live"


def test_nothing_leaves_this_computer(page, bridge):
    """Oracle: the addresses of all requests and sockets of the session: the server's own. Prints the latency that was seen."""
    ours = (f"{bridge}/", bridge.replace("http", "ws") + "/", "data:", f"blob:{bridge}/")
    assert len(page.asked) > 15 and [url for url in page.asked if not url.startswith(ours)] == []
    assert page.evaluate("() => seen.outside") == [] and page.complaints == []
    ages = sorted(page.evaluate("() => seen.ages"))
    late = ages[int(0.99 * len(ages))]
    print(
        f"\nfrom a state's time to its message on the screen: median {1000 * statistics.median(ages):.0f} ms, p99 {1000 * late:.0f} ms of {len(ages)}"
    )
