"""The loop that ties sources, filters, predictions, page and outputs together, until it is told to stop. Here are the clocks.

Nothing that fails in a turn of it ends the night: it is told (the traceback once, an alarm as long as it lasts), and the next turn
comes. Depends on all of live but start.
"""

import asyncio
import contextlib
import gc
import logging
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspnn.live import share_net, sources
from aspnn.live.alarms import Failure, Severity
from aspnn.live.chart import read_chart
from aspnn.live.config import Bridge, FileSource, N2kSource, host_port
from aspnn.live.core import SAVED, Core
from aspnn.live.output import UdpOut
from aspnn.live.record import Recorder
from aspnn.live.server import Hub, make_app
from aspnn.live.troubles import Troubles, log_alarms, once_more
from aspnn.logs.recording import LATENCY
from aspnn.prediction import Predictor
from aspnn.schema import InputError

if TYPE_CHECKING:
    from aspnn.live.bridge import SimulatedBridge

POLL = 0.01  # s between looks for rows that are ready
BACK = 0.9 * LATENCY  # s
LAG = 0.05  # s that the loop is held up at least, to be said so
FIRST = 3  # situations before the checkpoint is read: the picture comes first
REST = 1.0  # s before what failed is begun anew

Prepare = Callable[[], tuple[Predictor | None, dict[str, Failure]]]

log = logging.getLogger("aspnn.live")


class Clock:
    """The clock of receipt [s, UNIX]: the host's when the program began, then steady; while recordings alone are played, theirs."""

    def __init__(self, recorded: bool) -> None:
        self.recorded, self._heard = recorded, -1.0
        self._offset = time.time() - time.monotonic()

    def host(self) -> float:
        """The host's clock, which never jumps."""
        return self._offset + time.monotonic()

    def heard(self, received: float) -> None:
        """A line was received (according to its recording) at this instant."""
        self._heard = received

    def now(self) -> float:
        """The clock of receipt."""
        return self._heard if self.recorded and self._heard >= 0 else self.host()


def listen(host: str, port: int) -> socket.socket:
    """The socket of the page. Who connects before the loop runs waits. Raises InputError where it is taken or the host is not this
    computer's."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        made = socket.socket(family, socket.SOCK_STREAM)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((host, port))
        made.listen(128)
        return made
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"server: {host}:{port} cannot be used ({reason}); choose another port") from None


async def serve(
    bridge: Bridge,
    prepare: Prepare,
    listening: socket.socket,
    simulated: "SimulatedBridge | None" = None,
) -> None:
    """The loop: until SIGINT or SIGTERM. `prepare` is called in a thread and gives the predictor; until then the arc alone is shown."""
    config, zone, failures = bridge.config, bridge.zone, dict[str, Failure]()
    clock = Clock(simulated is None and all(isinstance(s, FileSource | N2kSource) for s in config.sources))
    recorder = None
    if config.record is not None:
        recorder = Recorder(Path(config.record.folder), bridge.vessel, zone, config.record.hours)
    core = Core(
        bridge,
        recorder=recorder,
        out=_out(bridge, failures, clock),
        simulated=simulated,
        saved=None if recorder is None else recorder.folder / SAVED,
        failures=failures,
    )
    hub = Hub(core)
    if config.chart is not None:
        try:
            core.chart = core.forecaster.chart = read_chart(config.chart.path, zone)
            hub.chart = core.chart.text
        except InputError as error:  # the picture lives without a chart
            failures["chart"] = Failure("chart", str(error), clock.host())
    server, stopped = _server(hub, bridge), asyncio.Event()

    def stop() -> None:
        server.should_exit = True
        stopped.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop)
    troubles = Troubles(failures)
    if simulated is not None:
        from aspnn.live.sail import have_sailed, sail

        await have_sailed(simulated, core, clock.host)
    work = [_ticks(core, hub, clock, troubles), _adopt(core, hub, prepare, clock, troubles)]
    if simulated is None:
        work += [_source(source, core, clock, troubles) for source in config.sources]
    else:
        work.append(sail(simulated, core, clock.host, troubles))
    if config.share is not None:
        work.append(_share(core, clock, troubles))
    tasks = [asyncio.create_task(one) for one in work]
    shown = f"[{config.server.host}]" if ":" in config.server.host else config.server.host
    log.info("serving http://%s:%d/%s", shown, config.server.port, "?token=..." if config.server.token else "")
    served = asyncio.create_task(server.serve([listening]))
    try:
        await asyncio.wait([served, asyncio.create_task(stopped.wait())], return_when=asyncio.FIRST_COMPLETED)
        if served.done():
            served.result()  # raises what ended it
    finally:
        server.should_exit = True
        for task in tasks:
            task.cancel()
        for ended in await asyncio.gather(*tasks, served, return_exceptions=True):
            if isinstance(ended, Exception):
                log.error("at the end: %s: %s", type(ended).__name__, ended, exc_info=ended)
        core.save()
        if core.recorder is not None:
            core.recorder.close()
        if core.out is not None:
            core.out.close()
        log.info("stopped; all is saved" if core.recorder is not None else "stopped")


def _server(hub: Hub, bridge: Bridge) -> Any:
    import uvicorn

    settings = uvicorn.Config(
        make_app(hub, bridge.config.server),
        log_config=None,
        log_level="warning",
        access_log=False,
        ws_max_size=4096,
        ws_per_message_deflate=False,
        server_header=False,
        timeout_graceful_shutdown=2,
    )
    server = uvicorn.Server(settings)
    server.capture_signals = contextlib.nullcontext  # type: ignore[assignment,method-assign]  # it would raise them again, before all is saved
    return server


def _out(bridge: Bridge, failures: dict[str, Failure], clock: Clock) -> UdpOut | None:
    """The socket of the sentences out; a host that nobody knows is told and stops nothing."""
    if bridge.config.output is None:
        return None
    try:
        return UdpOut(*host_port(bridge.config.output.udp))
    except OSError as error:
        reason = f"{bridge.config.output.udp}: {error.strerror or error}; nothing is sent"
        failures["output_address"] = Failure("output_address", reason, clock.host())
        return None


async def _adopt(core: Core, hub: Hub, prepare: Prepare, clock: Clock, troubles: Troubles) -> None:
    """The predictor, as soon as it is there. Other ticks go on meanwhile."""
    core.failures["checkpoint"] = Failure(
        "checkpoint", "it is being made ready; the arc alone is shown", clock.host(), Severity.caution
    )
    while hub.sequence < FIRST:
        await asyncio.sleep(POLL)
    try:
        predictor, failures = await asyncio.to_thread(prepare)
    except Exception as error:
        troubles.happened("checkpoint", error, clock.host())
        predictor, failures = None, {}
    del core.failures["checkpoint"]
    core.failures |= failures
    if predictor is not None:
        core.adopt(predictor)
        if core.recorder is not None:
            core.recorder.model = predictor.name
    hub.prepared = True
    gc.collect()
    gc.freeze()  # what is there for good, torch and all, is looked through no more while ships wait
    log.info("ready: %s", "the rate-of-turn arc alone" if predictor is None else f"{predictor.name} predicts")


async def _ticks(core: Core, hub: Hub, clock: Clock, troubles: Troubles) -> None:
    """Rows through the filters as soon as they are ready; a new situation at `predict_hz`, sooner or later with a new row."""
    period, fresh = 1.0 / core.bridge.config.predict_hz, 0
    last, told = -period, dict[str, list[float]]()
    while True:
        before = time.monotonic()
        await asyncio.sleep(POLL)
        if (
            time.monotonic() - before > LAG
        ):  # the loop was held up: what came meanwhile goes first, else it would be late
            for _ in range(3):
                await asyncio.sleep(0)
        try:
            fresh += core.take(clock.now())
        except Exception as error:
            troubles.happened("rows", error, clock.now())
        moment = time.monotonic()
        # With a new row as soon as most of the period has passed; without one when it is over.
        if moment - last < (0.8 if fresh else 1.2) * period:
            continue
        last, fresh, core.clients = moment, 0, hub.clients
        troubles.settle(clock.now())
        try:
            message = core.look(clock.now())
            hub.publish(message)
            hub.ready = hub.prepared and message["own"] is not None
            hub.reason = "no position and heading yet" if hub.prepared else "the checkpoint is being made ready"
            _measure(core, hub, clock, message, time.monotonic() - moment)
        except Exception as error:
            troubles.happened("situation", error, clock.now())
            if hub.message is None:
                continue
            message = once_more(hub.message, core)
            hub.publish(message)
        hub.metrics.failed.set(troubles.count)
        for line in core.events():
            log.info(line)
        log_alarms(message["alarms"], told, moment)


def _measure(core: Core, hub: Hub, clock: Clock, message: dict[str, Any], took: float) -> None:
    metrics = hub.metrics
    metrics.tick.observe(took)
    metrics.targets.set(len(message["targets"]))
    metrics.sentences.set(message["counts"]["sentences"])
    for fault, count in message["counts"]["rejected"].items():
        metrics.rejected.labels(fault).set(count)
    for severity in ("alarm", "warning", "caution"):
        metrics.alarms.labels(severity).set(sum(a["severity"] == severity for a in message["alarms"]))
    if message["time"] is not None:
        age = core.intake.time(clock.now()) - message["time"]
        metrics.age.set(age)
        metrics.latency.observe(max(age, 0.0))
    scores = message["scores"]
    for name in ("ours", "arc"):
        for horizon, error in zip(scores["horizons"], scores[name]["median"], strict=True):
            if error is not None:
                metrics.error.labels(name, f"{horizon:g}").set(error)
    metrics.shared.set(core.inbox.taken)
    if core.recorder is not None:
        metrics.lost.set(core.recorder.lost)


async def _source(source: Any, core: Core, clock: Clock, troubles: Troubles) -> None:
    """One source, for ever; a recording to its end. Whatever ends it is told."""

    def take(text: str, received: float, channel: str) -> None:
        clock.heard(received)
        if (
            not clock.recorded
        ):  # what several channels held back comes one channel after the other: receipt must not run back by that
            received = max(received, core.intake.latest - BACK)
        try:
            core.feed(text, received, channel)
            if core.intake.many:  # a recording that is played fast must not outrun the filters
                core.take(received)
        except Exception as error:
            troubles.happened(f"channel {channel}", error, clock.now())

    while True:
        try:
            await sources.run(source, take, lambda event: log.info(event.text), clock.host)
            return
        except InputError as error:
            core.failures[source.name] = Failure(source.name, str(error), clock.now())
            return
        except Exception as error:
            troubles.happened(f"channel {source.name}", error, clock.now())
            if clock.recorded:  # to begin it anew would tell the same twice
                core.failures[source.name] = Failure(source.name, f"its recording stopped ({error})", clock.now())
                return
        await asyncio.sleep(REST)


async def _share(core: Core, clock: Clock, troubles: Troubles) -> None:
    """Own prediction out to the others, theirs in; begun anew when it breaks off."""
    assert core.bridge.config.share is not None

    def due() -> bytes | None:
        data, core.shared_out = core.shared_out, None
        return data

    def told(reason: str) -> None:
        if reason:
            core.failures.setdefault("sharing", Failure("sharing", reason, clock.now()))
        else:
            core.failures.pop("sharing", None)

    while True:
        try:
            await share_net.take_part(
                core.bridge.config.share, lambda data: core.hear_shared(data, clock.now()), due, told
            )
        except Exception as error:
            troubles.happened("share", error, clock.now())
        await asyncio.sleep(REST)
