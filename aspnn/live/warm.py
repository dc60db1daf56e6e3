"""All that a tick needs, run once before anybody waits for it: what numba compiles at first use takes a minute or two."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from aspnn.frames import to_geodetic
from aspnn.live.config import Bridge
from aspnn.live.core import Core
from aspnn.live.intake import Row
from aspnn.logs.ais_messages import Report
from aspnn.prediction import Predictor

if TYPE_CHECKING:
    from aspnn.live.bridge import SimulatedBridge

BEGAN = 1_700_000_000.0  # s, UNIX: any time
SECONDS = (*range(100), *(100 + k / 5 for k in range(201)))  # of its rows: long and dense enough for any predictor


def warm(bridge: Bridge, predictor: Predictor | None, simulated: "SimulatedBridge | None" = None) -> None:
    """Take a made-up ship and target through a tick of their own, and a simulated ship through a second. Nothing is recorded, sent or
    kept of it."""
    if simulated is not None:
        type(simulated)(simulated.scenario, BEGAN).advance(BEGAN + 1.0)
    nothing = {"chart": None, "record": None, "output": None, "share": None}
    core = Core(Bridge(bridge.config.model_copy(update=nothing), bridge.vessel, bridge.zone), predictor)
    rows = list(_rows(bridge))
    core.push(rows[:-3])
    for row in rows[-3:]:  # one row is compiled apart from many
        core.push([row])
    latitude = next(value for name, value in rows[-1].values.items() if name.endswith("_latitude_deg"))
    longitude = next(value for name, value in rows[-1].values.items() if name.endswith("_longitude_deg"))
    for k in range(4):
        time = rows[-1].time - 30.0 + 10.0 * k
        place = latitude + 0.01 - 4.5e-4 * k, longitude + 0.002
        core.targets.hear(Report(257000001, 1, *place, 5.0, 180.0, 180.0, 0.0, time % 60, True, True, False), time)
    core.look(rows[-1].time)


def _rows(bridge: Bridge) -> Iterator[Row]:
    """A ship that heads north at service speed from the middle of her zone."""
    vessel, zone = bridge.vessel, bridge.zone
    for seconds in SECONDS:
        north = (6_650_000.0 if zone.north else 3_350_000.0) + vessel.service_speed * seconds
        values = {"heading_deg": 0.0, "yaw_rate_deg_s": 0.0, "rudder_order_deg": 0.0, "rudder_angle_deg": 0.0}
        for name in bridge.config.antennas:
            forward, starboard = vessel.stations[name]
            place = to_geodetic(north + forward, 500_000.0 + starboard, zone)
            values[f"{name}_latitude_deg"], values[f"{name}_longitude_deg"] = (math.degrees(x) for x in place)
        yield Row(BEGAN + seconds, values)
