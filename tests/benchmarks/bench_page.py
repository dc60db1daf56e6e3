"""How old a prediction is on the page: from the sensors' instant to the message at a client and to the picture in Chromium.

python tests/benchmarks/bench_page.py [SECONDS] [SHIPS]

A real `aspnn bridge` on one core, 10 predictions a second, SHIPS (50) others about her, each reporting by AIS; after SECONDS (60) in which
her rudder is put over every 15 s the ages [ms] are printed: median, 99 %, most. The instant is that of the sensors' sample: what the
sentences, the intake, the filters and the prediction take is in it. Chromium, which is on the other cores, draws by software.
"""

import asyncio
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np
import websockets
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.live.test_on_the_bridge import WATCH, answers  # noqa: E402
from tests.live.test_page import CHROMIUM  # noqa: E402

HARBOUR = ROOT / "data" / "scenarios" / "harbour.toml"
PORT = 8799


def scenario(folder: Path, ships: int) -> Path:
    """The harbour with `ships` others within 3 km of the start."""
    text = HARBOUR.read_text().partition("[[bridge.ships]]")[0].replace('"../', f'"{HARBOUR.parent}/../')
    text = text.replace("[bridge]", "[bridge]\npredict_hz = 10")
    draw = np.random.default_rng(1)
    for k in range(ships):
        away, bearing = 3000 * math.sqrt(draw.uniform(0.01, 1)), draw.uniform(0, 2 * math.pi)
        latitude = 69.63835 + away * math.cos(bearing) / 111_500
        longitude = 18.96 + away * math.sin(bearing) / 38_900
        text += f'\n[[bridge.ships]]\nname = "SHIP {k}"\nmmsi = {257_000_100 + k}\nlatitude_deg = {latitude:.5f}\n'
        text += f"longitude_deg = {longitude:.5f}\nheading_deg = {draw.uniform(0, 360):.0f}\nspeed_kn = {draw.uniform(0, 14):.1f}\n"
    (folder / "crowded.toml").write_text(text)
    return folder / "crowded.toml"


async def received(seconds: float) -> list[float]:
    """Ages [s] of the states in the messages that a client gets."""
    ages, end = [], time.monotonic() + seconds
    async with websockets.connect(f"ws://127.0.0.1:{PORT}/ws") as socket:
        while time.monotonic() < end:
            message = json.loads(await socket.recv())
            if message["time"] is not None:
                ages.append(time.time() - message["time"])
            if len(ages) % 150 == 1:
                await asyncio.to_thread(order, 10.0 * (-1) ** (len(ages) // 150))
    return ages


def order(rudder: float) -> None:
    """Put the rudder over [deg]."""
    body = json.dumps({"rudder": rudder}).encode()
    asked = urllib.request.Request(
        f"http://127.0.0.1:{PORT}/api/order", body, {"content-type": "application/json"}, method="POST"
    )
    urllib.request.urlopen(asked, timeout=5).read()


def line(what: str, ages: list[float]) -> str:
    median, late, most = 1000 * np.array([*np.quantile(ages, [0.5, 0.99]), max(ages)])
    return f"{what:<28}{len(ages):8d}{median:10.0f}{late:10.0f}{most:10.0f}"


def main() -> None:
    seconds, ships = (float(x) for x in (sys.argv[1:] + ["60", "50"][len(sys.argv) - 1 :])[:2])
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "aspnn.cli",
            "bridge",
            str(scenario(Path(folder), int(ships))),
            "--port",
            str(PORT),
        ]
        server = subprocess.Popen(command, env=os.environ | {"OMP_NUM_THREADS": "1"}, stderr=subprocess.DEVNULL)
        os.sched_setaffinity(server.pid, {0})
        try:
            while not answers(f"http://127.0.0.1:{PORT}/ready"):
                time.sleep(0.2)
            time.sleep(10.0)  # the others have told of themselves
            print(f"{'age [ms]':<28}{'messages':>8}{'median':>10}{'99 %':>10}{'most':>10}")
            print(line("at a client", asyncio.run(received(seconds))))
            if CHROMIUM is None:
                print("no chromium on this machine: what is drawn is not measured")
                return
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
                page = browser.new_page(viewport={"width": 1600, "height": 900})
                page.add_init_script(WATCH)
                page.goto(f"http://127.0.0.1:{PORT}/")
                page.wait_for_selector("body[data-sequence]")
                time.sleep(5.0)
                page.evaluate("() => { seen.ages.length = 0 }")
                page.wait_for_timeout(1000 * seconds)
                print(line("on the page", page.evaluate("() => seen.ages")))
                browser.close()
        finally:
            server.terminate()
            server.wait(20)


if __name__ == "__main__":
    main()
