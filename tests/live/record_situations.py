"""Make tests/live/situations.json.gz: 60 situation messages of the simulated bridge, for the page without a server.

The harbour of data/scenarios with its chart, its checkpoint and its other ships is steered by a fixed list of orders, and looked at
every other second for two minutes; the stern's receiver is silent for twenty seconds of them. All is as `aspnn bridge` would have
sent it. Run from the project folder after the message has changed: `python tests/live/record_situations.py` (two minutes).
"""

import gzip
import json
import math
from pathlib import Path

from aspnn.live.bridge import CHANNEL, SimulatedBridge
from aspnn.live.chart import read_chart
from aspnn.live.core import Core
from aspnn.live.start import settings_of
from aspnn.live.whatif import WhatIf
from aspnn.logs.nmea_write import TALKERS
from aspnn.prediction import Predictor
from aspnn.simulation.scenario import read_scenario

HERE = Path(__file__).parent
SCENARIO = HERE.parents[1] / "data" / "scenarios" / "harbour.toml"
EPOCH = 1_700_000_000.0
STEP = 0.1  # s of the bridge between two looks at what she says
LOOK = 1.0  # s between predictions, so that all that can be judged are
FIRST, EVERY, COUNT = 200.0, 2, 60
SILENT = (250.0, 270.0)  # s without the stern's receiver
# Seconds from the start, and the rudder order [deg] from there on: a bend to port, then to starboard, then hard to port.
ORDERS = [(60.0, -5.0), (100.0, 0.0), (150.0, 5.0), (190.0, 0.0), (215.0, 15.0), (255.0, 0.0), (275.0, -20.0)]


def main() -> None:
    scenario = read_scenario(SCENARIO)
    simulated = SimulatedBridge(scenario, EPOCH)
    bridge = settings_of(simulated)
    core = Core(
        bridge,
        Predictor.load(SCENARIO.parent / scenario.bridge.checkpoint),
        chart=read_chart(SCENARIO.parent / scenario.bridge.chart, bridge.zone),
        simulated=simulated,
    )
    messages, due = [], list(ORDERS)
    asked = found = None
    for number in range(1, round((FIRST + EVERY * COUNT) / STEP)):
        past = number * STEP
        if due and past >= due[0][0]:
            core.order(due.pop(0)[1], None)
        for sent, line in simulated.advance(EPOCH + past):
            if SILENT[0] <= past < SILENT[1] and f"s:{TALKERS[1]}0001" in line:
                continue
            core.feed(line, sent, CHANNEL)
        core.take(EPOCH + past)
        if number % round(LOOK / STEP):
            continue
        message = core.look(EPOCH + past)
        if past < FIRST - 1e-6 or round(past) % EVERY:
            continue
        if not messages:  # a place to stay off that lies on the path in force
            ahead = message["forecast"]
            k = next(k for k, time in enumerate(ahead["time"]) if time >= 70.0)
            asked = {"lat": ahead["lat"][k], "lon": ahead["lon"][k], "distance": 100.0}
            fan = {"from": -35, "to": 35, "step": 5}
            found = core.whatif(WhatIf.model_validate({"plan": [[0, 20], [30, -10]], "fan": fan, "clear": asked}))
        messages.append(message | {"sequence": len(messages) + 1})
    assert found is not None and len(messages) == COUNT and math.isfinite(messages[-1]["time"])
    text = json.dumps({"situations": messages, "whatif": {"asked": asked, **found}}, separators=(",", ":"))
    (HERE / "situations.json.gz").write_bytes(gzip.compress(text.encode(), 9, mtime=0))
    print(f"{COUNT} messages of {len(text) / COUNT / 1000:.0f} kB")


if __name__ == "__main__":
    main()
