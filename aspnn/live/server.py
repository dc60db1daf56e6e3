"""What the outside may ask: the page, the newest situation (pushed and pulled), what-if plans, orders of a simulated bridge, metrics.

Only this computer is served unless the settings name a host and a token; requests from pages of other sites are refused. Files of
the page are read once, at the start: no path that a request names is ever opened. A client that is slow gets the newest message when
it can take one, nothing is queued for it. Depends on live.config, live.situation, live.whatif.
"""

import asyncio
import hmac
import json
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Protocol
from urllib.parse import parse_qs

from fastapi import Body, FastAPI, HTTPException, Request, Response, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    generate_latest,
)
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException as AnyHttpError
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect

from aspnn.live.config import Server
from aspnn.live.situation import geojson
from aspnn.live.whatif import WhatIf
from aspnn.schema import InputError

PAGE = Path(__file__).parent / "page"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".woff2": "font/woff2",
}
HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src 'self'; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
GUARDED = ("/api/", "/ws", "/metrics")  # what a token is needed for: the page itself holds no data
LARGEST = 65_536  # bytes of a request's body
CLIENTS = 100  # browsers at once
PATIENCE = 5.0  # s until a client that takes nothing is let go
LOCAL = ("localhost", "127.0.0.1", "[::1]")
BUCKETS = (0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.25, 0.5, 1.0, 2.5)
STRICT = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Limits(BaseModel):
    """From where on a target is dangerous: CPA [m] and TCPA [s]."""

    model_config = STRICT
    cpa: Annotated[float, Field(ge=0, le=100_000)]
    tcpa: Annotated[float, Field(ge=0, le=7200)]


class Order(BaseModel):
    """Orders to a simulated bridge: rudder [deg], shaft [rev/s]; what is left out stays."""

    model_config = STRICT
    rudder: float | None = None
    shaft: float | None = None


class Engine(Protocol):
    """What the loop behind the server does for it. Each raises InputError, one line, for what cannot be done."""

    def whatif(self, asked: WhatIf) -> dict[str, Any]: ...

    def limit(self, cpa: float, tcpa: float) -> None: ...

    def order(self, rudder: float | None, shaft: float | None) -> dict[str, Any] | None:
        """The orders in force afterwards, or None where the bridge is not simulated."""
        ...


class Metrics:
    """What Prometheus reads. A registry of its own, so that several servers can be in one process."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)  # memory and processor time, where the system tells them
        made: dict[str, Any] = {"registry": self.registry}
        self.sentences = Gauge("aspnn_sentences", "Sentences taken since the start", **made)
        self.rejected = Gauge("aspnn_rejected_sentences", "Sentences refused since the start", ["fault"], **made)
        self.messages = Counter("aspnn_situations", "Situation messages made", **made)
        self.clients = Gauge("aspnn_clients", "Browsers connected", **made)
        self.targets = Gauge("aspnn_targets", "Targets present", **made)
        self.alarms = Gauge("aspnn_alarms", "Alarms present", ["severity"], **made)
        self.age = Gauge("aspnn_state_age_seconds", "How old the newest state is", **made)
        self.tick = Histogram("aspnn_tick_seconds", "Time that one tick took", buckets=BUCKETS, **made)
        self.latency = Histogram("aspnn_latency_seconds", "From a row's time to its message", buckets=BUCKETS, **made)
        self.error = Gauge("aspnn_error_meters", "Running median of errors", ["predictor", "horizon"], **made)
        self.failed = Gauge("aspnn_loop_failures", "Turns of the loop in which something failed", **made)
        self.shared = Gauge("aspnn_shared_heard", "Predictions of others taken", **made)
        self.lost = Gauge("aspnn_record_rows_lost", "Rows that the record had to give up", **made)


@dataclass
class Hub:
    """What the loop hands to the server: the newest message, the chart, whether all is up; and what the server hands back."""

    engine: Engine
    chart: str | None = None
    prepared: bool = False  # the predictor is there, or it is known that there is none
    ready: bool = False
    reason: str = "starting"  # why it is not ready
    metrics: Metrics = field(default_factory=Metrics)
    message: Mapping[str, Any] | None = None
    text: str = ""
    sequence: int = 0
    clients: int = 0
    refused: int = 0  # clients let go because they took nothing, or came when all places were taken
    _waiters: set[asyncio.Future[None]] = field(default_factory=set, repr=False)

    def publish(self, message: Mapping[str, Any]) -> None:
        """Make a message the newest: each waiting client is woken, none is waited for. Call it from the loop's own thread."""
        self.text = json.dumps(message, separators=(",", ":"), allow_nan=False)
        self.message, self.sequence = message, self.sequence + 1
        self.metrics.messages.inc()
        waiters, self._waiters = self._waiters, set()
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    async def newer(self, than: int) -> tuple[int, str]:
        """Number and text of the newest message as soon as its number is above `than`."""
        while self.sequence <= than:
            waiter = asyncio.get_running_loop().create_future()
            self._waiters.add(waiter)
            try:
                await waiter
            finally:
                self._waiters.discard(waiter)
        return self.sequence, self.text


def make_app(hub: Hub, config: Server) -> FastAPI:
    """The application. Raises InputError where settings would serve others without a token, or the page is not installed."""
    if not config.local and not config.token:
        raise InputError(f"server.host {config.host} can be reached by others: set server.token")
    app = FastAPI(title="aspnn", docs_url=None, redoc_url=None, openapi_url=None)
    files = page_files(PAGE)
    asking = asyncio.Lock()  # one fan at a time: clients queue, the loop's ticks do not

    @app.exception_handler(InputError)
    async def _input(request: Request, error: InputError) -> JSONResponse:
        return refusal(400, str(error))

    @app.exception_handler(RequestValidationError)
    async def _invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"] if part != "body")
        return refusal(422, f"{key or 'request'}: {str(first['msg'])[:150].lower()}")

    @app.exception_handler(AnyHttpError)
    async def _http(request: Request, error: AnyHttpError) -> JSONResponse:
        return refusal(error.status_code, str(error.detail))

    @app.get("/api/situation")
    async def _situation() -> Response:
        return Response(_newest(hub), media_type="application/json")

    @app.get("/api/situation.geojson")
    async def _geojson() -> Response:
        _newest(hub)
        assert hub.message is not None
        return Response(json.dumps(geojson(hub.message), allow_nan=False), media_type="application/geo+json")

    @app.get("/api/chart")
    async def _chart() -> Response:
        if hub.chart is None:
            raise HTTPException(404, "no chart is loaded; name one in the settings, [chart] path")
        return Response(hub.chart, media_type="application/geo+json")

    @app.post("/api/whatif")
    async def _whatif(asked: Annotated[WhatIf, Body()]) -> dict[str, Any]:
        async with asking:
            return await asyncio.to_thread(hub.engine.whatif, asked)

    @app.post("/api/limits")
    async def _limits(asked: Annotated[Limits, Body()]) -> dict[str, float]:
        hub.engine.limit(asked.cpa, asked.tcpa)
        return {"cpa": asked.cpa, "tcpa": asked.tcpa}

    @app.post("/api/order")
    async def _order(asked: Annotated[Order, Body()]) -> dict[str, Any]:
        if asked.rudder is None and asked.shaft is None:
            raise InputError("order: give rudder, shaft, or both")
        found = hub.engine.order(asked.rudder, asked.shaft)
        if found is None:
            raise HTTPException(404, "this is no simulated bridge: the ship takes no orders from here")
        return found

    @app.get("/health")
    async def _health() -> dict[str, str]:
        return {"status": "alive"}

    @app.get("/ready")
    async def _ready() -> Response:
        if hub.ready:
            return JSONResponse({"status": "ready"})
        return refusal(503, hub.reason)

    @app.get("/metrics")
    async def _metrics() -> Response:
        hub.metrics.clients.set(hub.clients)
        return Response(generate_latest(hub.metrics.registry), media_type=CONTENT_TYPE_LATEST)

    @app.websocket("/ws")
    async def _ws(socket: WebSocket) -> None:
        await serve_client(hub, socket)

    @app.get("/{name:path}")
    async def _page(name: str) -> Response:
        found = files.get(name or "index.html")
        if found is None:
            raise HTTPException(404, "there is no such page")
        return Response(found[0], media_type=found[1])

    app.add_middleware(Gate, config=config)
    return app


async def serve_client(hub: Hub, socket: WebSocket) -> None:
    """Send the newest message, again and again, until the client goes or takes nothing for PATIENCE seconds."""
    if hub.clients >= CLIENTS:
        hub.refused += 1
        await socket.close(1013, "too many clients")
        return
    await socket.accept()
    hub.clients += 1

    async def send() -> None:
        sequence = 0
        while True:
            sequence, text = await hub.newer(sequence)
            try:
                await asyncio.wait_for(socket.send_text(text), PATIENCE)
            except TimeoutError:
                hub.refused += 1
                return

    async def listen() -> None:  # a page says nothing; reading notices that it has gone
        while (await socket.receive())["type"] != "websocket.disconnect":
            pass

    tasks = [asyncio.create_task(send()), asyncio.create_task(listen())]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.clients -= 1
        for task in tasks:
            task.cancel()
        for error in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(error, Exception) and not isinstance(error, WebSocketDisconnect | RuntimeError | OSError):
                raise error


def page_files(folder: Path) -> dict[str, tuple[bytes, str]]:
    """The files of the page by their address, with their media types. Raises InputError where there is none."""
    found = {
        path.relative_to(folder).as_posix(): (path.read_bytes(), TYPES[path.suffix])
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix in TYPES
    }
    if "index.html" not in found:
        raise InputError(f"{folder}: the page is not there; install aspnn again")
    return found


def refusal(status: int, text: str) -> JSONResponse:
    """An answer that says in one line what is wrong."""
    return JSONResponse({"error": " ".join(text.split())}, status)


def _newest(hub: Hub) -> str:
    if not hub.text:
        raise HTTPException(503, f"there is no situation yet ({hub.reason})")
    return hub.text


class Gate:
    """Before every request: the host it was asked for, the site it comes from, the token, the size of its body; and the headers of answers."""

    def __init__(self, app: ASGIApp, config: Server) -> None:
        self.app, self.config = app, config

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        status, why = self.refused(scope, headers)
        if status:
            await _refuse(scope, receive, send, status, why)
            return
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
            return
        taken = 0

        async def limited() -> Any:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > LARGEST:
                raise HTTPException(413, f"the request is larger than {LARGEST} bytes")
            return message

        async def dressed(message: Any) -> None:
            if message["type"] == "http.response.start":
                more = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message = {**message, "headers": [*message["headers"], *more]}
            await send(message)

        await self.app(scope, limited, dressed)

    def refused(self, scope: Scope, headers: Mapping[str, str]) -> tuple[int, str]:
        """Status and reason of a refusal; 0 where the request may pass.

        On a loopback address the Host must be a local name (a foreign name that resolves to this computer is an attack on it), and
        an Origin, where one is told, must be the page's own: other sites that a browser shows may not talk to the bridge.
        """
        host = headers.get("host", "")
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdecimal() else host
        if self.config.local and name.lower() not in (*LOCAL, self.config.host):
            return 403, "this server answers to this computer alone; ask for http://127.0.0.1 and its port"
        origin = headers.get("origin")
        if origin is not None and origin.partition("://")[2].lower() != host.lower():
            return 403, "this request comes from another site's page"
        path = scope["path"]
        if self.config.token and path.startswith(GUARDED):
            query = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
            given = headers.get("authorization", "").removeprefix("Bearer ") or query
            if not hmac.compare_digest(given.encode(), self.config.token.encode()):
                return 401, "a token is needed: open the page as /?token=..."
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > LARGEST:
            return 413, f"the request is larger than {LARGEST} bytes"
        return 0, ""


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": why[:120]})
        return
    answer: Callable[[Scope, Receive, Send], Awaitable[None]] = refusal(status, why)
    await answer(scope, receive, send)
