"""How a bridge is started: settings and checkpoint read, all that is compiled compiled, then the loop of `serve`.

What cannot be started is an InputError, one line. A checkpoint that is not this ship's, or cannot be read, and a chart that is none
stop nothing: the picture lives with the rate-of-turn arc alone, or without a chart, and an alarm tells why.
"""

import asyncio
import logging
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspnn.live.alarms import Failure
from aspnn.live.config import Bridge, BridgeConfig, read_bridge
from aspnn.live.core import SAVED
from aspnn.live.warm import warm
from aspnn.logs.nmea import Antenna
from aspnn.logs.nmea_write import TALKERS
from aspnn.prediction import Predictor
from aspnn.schema import InputError
from aspnn.vessel import Vessel

if TYPE_CHECKING:  # a ship at sea needs no simulator, and starts sooner without
    from aspnn.live.bridge import SimulatedBridge

SIMULATED_PORT = 10110  # named in a simulated bridge's settings, and never opened: her sentences come by hand
OF_LATE = 600.0  # s: a run that was going so long ago has compiled all that this one needs

log = logging.getLogger("aspnn.live")


def run(config: str | Path, checkpoint: str | Path | None, expose: bool = False, quiet: bool = False) -> None:
    """Serve a bridge's settings until stopped. Raises InputError, one line, for what cannot be started."""
    loop = _loop()
    bridge = read_bridge(config)
    if not expose:
        _kept_in(bridge, str(config))
    _log_to_stderr(quiet)
    _run(loop, bridge, checkpoint)


def run_bridge(
    scenario: str | Path,
    checkpoint: str | Path | None = None,
    port: int = 8765,
    chart: str | Path | None = None,
    quiet: bool = False,
    record: str | Path | None = None,
    share: str | None = None,
) -> None:
    """Serve the simulated bridge of a scenario until stopped. Raises InputError, one line."""
    from aspnn.live.bridge import SimulatedBridge
    from aspnn.simulation.scenario import read_scenario

    loop = _loop()
    read, place = read_scenario(scenario), Path(scenario).parent
    chosen = read.bridge
    if chart is None and chosen.chart is not None:
        chart = place / chosen.chart
    if checkpoint is None and chosen.checkpoint is not None:
        checkpoint = place / chosen.checkpoint
    simulated = SimulatedBridge(read, time.time())
    bridge = settings_of(simulated, port, chart, record, share)
    _log_to_stderr(quiet)
    _run(loop, bridge, checkpoint, simulated)


def settings_of(
    simulated: "SimulatedBridge",
    port: int = 8765,
    chart: str | Path | None = None,
    record: str | Path | None = None,
    share: str | None = None,
) -> Bridge:
    """The settings that a simulated bridge's sentences need."""
    from aspnn.live.bridge import CHANNEL

    vessel, names = simulated.vessel, simulated.scenario.sensors.antennas
    antennas = {
        name: Antenna(source=talker, station_m=vessel.stations[name])
        for name, talker in zip(names, TALKERS, strict=False)
    }
    data: dict[str, Any] = {
        "ship": {"vessel": simulated.scenario.vessel, "zone": simulated.scenario.start.zone},
        "antennas": {name: antenna.model_dump() for name, antenna in antennas.items()},
        "sources": [{"kind": "udp", "name": CHANNEL, "port": SIMULATED_PORT}],
        "latency_s": 0.05,
        "predict_hz": simulated.scenario.bridge.predict_hz,
        "limits": {"cpa_m": 200.0, "tcpa_s": 600.0},
        "server": {"port": port},
        "chart": None if chart is None else {"path": str(chart)},
        "record": None if record is None else {"folder": str(record)},
        "share": None if share is None else {"group": share, "name": simulated.scenario.name},
    }
    try:
        config = BridgeConfig.model_validate(data)
    except ValueError as error:  # of what was asked, only the group of --share can be wrong
        raise InputError(f"--share {share}: {str(error).splitlines()[-2].strip()}") from None
    return Bridge(config, vessel, simulated.zone)


def _run(loop: Any, bridge: Bridge, checkpoint: str | Path | None, simulated: "SimulatedBridge | None" = None) -> None:
    """The page once all is ready: what has never been run is compiled, which would leave the loop no time for its sensors.

    After a restart all has been compiled: then filters and page come first, so that the picture is back at once, and the checkpoint is
    made ready beside them, in a thread.
    """

    def prepare() -> tuple[Predictor | None, dict[str, Failure]]:
        predictor, failures = _model(checkpoint, bridge.vessel)
        if predictor is not None:
            warm(bridge, predictor)
        return predictor, failures

    with loop.listen(bridge.config.server.host, bridge.config.server.port) as listening:
        log.info("getting ready; the first start on a computer compiles, which takes a minute or two")
        warm(bridge, None, simulated)
        if _ran_of_late(bridge):
            asyncio.run(loop.serve(bridge, prepare, listening, simulated))
        else:
            ready = prepare()
            asyncio.run(loop.serve(bridge, lambda: ready, listening, simulated))


def _ran_of_late(bridge: Bridge) -> bool:
    """Whether a state of the filters was saved within the last OF_LATE seconds: by a run that had compiled all."""
    if bridge.config.record is None:
        return False
    try:
        return abs(time.time() - (Path(bridge.config.record.folder) / SAVED).stat().st_mtime) < OF_LATE
    except OSError:
        return False


def _loop() -> Any:
    """The module of the loop, which needs the packages of the extra `serve`. Raises InputError where one is not installed."""
    try:
        import uvicorn  # noqa: F401 - serve imports it when it runs
        import websockets  # noqa: F401 - without it uvicorn knows no WebSocket

        from aspnn.live import serve
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("aspnn"):
            raise
        raise InputError(f"the bridge needs {error.name}, which is not installed: pip install 'aspnn[serve]'") from None
    return serve


def _kept_in(bridge: Bridge, where: str) -> None:
    """Refuse settings that let other computers in, which the user of the command has not asked for."""
    config = bridge.config
    if not config.server.local:
        raise InputError(
            f"{where}: server.host {config.server.host} can be reached by others; add --expose to the command, or take 127.0.0.1"
        )
    if config.share is not None and not config.share.local:
        raise InputError(
            f"{where}: [share] is with other computers; add --expose to the command, or keep it to 127.0.0.1"
        )


def _log_to_stderr(quiet: bool) -> None:
    """Lines with their UTC on standard error, of warnings alone where `quiet`."""
    form = logging.Formatter("%(asctime)sZ %(levelname)s %(message)s", "%Y-%m-%dT%H:%M:%S")
    form.converter = time.gmtime
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(form)
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)
    log.setLevel(logging.WARNING if quiet else logging.INFO)


def _model(checkpoint: str | Path | None, vessel: Vessel) -> tuple[Predictor | None, dict[str, Failure]]:
    """The predictor; None, and the failure that an alarm tells of, where it cannot be read or is another ship's."""
    if checkpoint is None:
        log.info("no checkpoint is named: the rate-of-turn arc alone is shown")
        return None, {}
    try:
        predictor: Any = Predictor.load(checkpoint)
        _is_of(predictor, vessel)
    except InputError as error:
        return None, {"checkpoint": Failure("checkpoint", f"{error}; the arc alone is shown", time.time())}
    return predictor, {}


def _is_of(predictor: Any, own: Vessel) -> None:
    """Refuse a checkpoint of another ship at once, rather than at every tick. Raises InputError."""
    contract = getattr(predictor, "contract", None)
    if contract is None:
        return
    want = contract.vessel
    other = own.other_hull(want)
    if own.ship != want.ship or other is not None:
        what = "" if other is None else f" ({other[0]} {other[1]:g} m, not {other[2]:g} m)"
        raise InputError(f"checkpoint {contract.name} is for {want.name}, but this ship is {own.name}{what}")
