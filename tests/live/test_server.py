"""What the outside may ask, without a network: the application is called in process."""

import asyncio
import json

import httpx
import pytest

from aspnn.live.config import Server
from aspnn.live.server import CLIENTS, Hub, make_app, serve_client
from aspnn.schema import InputError

TOKEN = "a token of sixteen"


class Engine:
    """Answers by rote, and notes what it was asked."""

    def __init__(self, simulated=True):
        self.simulated, self.asked = simulated, []

    def whatif(self, asked):
        self.asked.append(asked)
        if asked.plan and abs(asked.plan[0][1]) > 35:
            raise InputError("rudder plan: order 60 deg at 0 s is beyond the 35 deg stops of cargo90")
        return {"start": 0.0, "paths": [], "choice": None}

    def limit(self, cpa, tcpa):
        self.asked.append((cpa, tcpa))

    def order(self, rudder, shaft):
        return {"rudder": rudder, "shaft": shaft} if self.simulated else None


def ask(method, path, hub=None, settings=None, base="http://127.0.0.1:8765", **more):
    app = make_app(hub or Hub(Engine()), settings or Server())

    async def run():
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url=base) as client:
            return await client.request(method, path, **more)

    return asyncio.run(run())


def test_page_comes_with_a_strict_policy():
    """Law: nothing but the page's own files may be loaded, connected to or framed, on every answer."""
    for path in ("/", "/health", "/none"):
        policy = ask("GET", path).headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy and "http" not in policy
    assert ask("GET", "/").headers["content-type"].startswith("text/html")


@pytest.mark.parametrize(
    "path",
    [
        "/../server.py",
        "/..%2fserver.py",
        "/%2e%2e/server.py",
        "/vendor/../../server.py",
        "//etc/passwd",
        "/SITUATION.md",
    ],
)
def test_no_path_from_outside_is_read(path):
    """Law: only addresses of the page's files are answered; whatever else is asked is 404, in one line."""
    found = ask("GET", path)
    assert found.status_code == 404 and set(found.json()) == {"error"}


def test_situation_is_the_newest_message():
    """Law: 503 with the reason before the first; then the newest, alike by both ways."""
    hub = Hub(Engine(), reason="no position yet")
    early = ask("GET", "/api/situation", hub)
    assert early.status_code == 503 and "no position yet" in early.json()["error"]
    message = {"own": None, "track": None, "forecast": None, "arc": None, "targets": [], "time": None}
    hub.publish({**message, "sequence": 1})
    hub.publish({**message, "sequence": 2})
    assert ask("GET", "/api/situation", hub).json()["sequence"] == 2
    assert ask("GET", "/api/situation.geojson", hub).json() == {"type": "FeatureCollection", "features": []}
    with pytest.raises(ValueError, match="not JSON compliant"):
        hub.publish({"time": float("nan")})
    assert ask("GET", "/api/situation", hub).json()["sequence"] == 2


@pytest.mark.parametrize(
    ("path", "body", "status", "said"),
    [
        ("/api/whatif", {"plan": [[0, 60]]}, 400, "beyond the 35 deg stops"),
        ("/api/whatif", {"plan": [[0, "x"]]}, 422, "plan"),
        ("/api/whatif", {"file": "/etc/passwd"}, 422, "file"),
        ("/api/whatif", {"plan": [[k, 1] for k in range(51)]}, 422, "plan"),
        ("/api/limits", {"cpa": -1, "tcpa": 10}, 422, "cpa"),
        ("/api/order", {}, 400, "give rudder"),
    ],
)
def test_wrong_requests_are_answered_in_one_line(path, body, status, said):
    """Law: 4xx and {"error": line} that names what is wrong."""
    found = ask("POST", path, json=body)
    assert found.status_code == status
    assert said in found.json()["error"] and "\n" not in found.json()["error"]


def test_numbers_that_are_none_are_refused():
    """Law: JSON's NaN and Infinity, which Python reads, come no further than the gate."""
    for text in ('{"plan": [[0, NaN]]}', '{"plan": [[0, Infinity]]}', "{", ""):
        headers = {"content-type": "application/json"}
        assert ask("POST", "/api/whatif", content=text, headers=headers).status_code == 422


def test_right_requests_reach_the_engine():
    """Law: what was asked is what the engine hears; orders are taken by a simulated bridge alone."""
    hub = Hub(Engine())
    assert ask("POST", "/api/whatif", hub, json={"fan": {"from": -10, "to": 10, "step": 5}}).status_code == 200
    assert hub.engine.asked[-1].fan.orders() == [-10, -5, 0, 5, 10]
    assert ask("POST", "/api/limits", hub, json={"cpa": 200, "tcpa": 600}).json() == {"cpa": 200, "tcpa": 600}
    assert ask("POST", "/api/order", hub, json={"rudder": 10}).json()["rudder"] == 10
    assert ask("POST", "/api/order", Hub(Engine(simulated=False)), json={"rudder": 10}).status_code == 404


def test_large_bodies_are_refused():
    """Law: 413 by the length that is told, and by what comes where none is told."""
    assert ask("POST", "/api/whatif", content=b" " * 70_000).status_code == 413

    async def pieces():
        for _ in range(70):
            yield b" " * 1000

    assert ask("POST", "/api/whatif", content=pieces(), headers={"content-type": "application/json"}).status_code == 413


def test_this_computer_alone_is_answered():
    """Law: a foreign name that resolves here (DNS rebinding) and another site's page are refused; local names are not."""
    for base in ("http://evil.example:8765", "http://127.0.0.1.evil.example"):
        assert ask("GET", "/api/situation", base=base).status_code == 403
    assert ask("POST", "/api/order", json={"rudder": 1}, headers={"origin": "https://evil.example"}).status_code == 403
    own = {"origin": "http://localhost:8765"}
    assert ask("POST", "/api/order", base="http://localhost:8765", json={"rudder": 1}, headers=own).status_code == 200


def test_a_token_guards_all_data():
    """Law: with a token, data, orders and metrics need it, by header or query; the page, which holds none, health and readiness do not."""
    settings = Server(host="192.0.2.1", token=TOKEN)
    base = "http://192.0.2.1:8765"
    hub = Hub(Engine())
    hub.publish({"sequence": 1})
    for path in ("/api/situation", "/metrics"):
        assert ask("GET", path, hub, settings, base).status_code == 401
        assert ask("GET", path, hub, settings, base, params={"token": TOKEN[:-1]}).status_code == 401
        assert ask("GET", path, hub, settings, base, params={"token": TOKEN}).status_code == 200
        assert ask("GET", path, hub, settings, base, headers={"authorization": f"Bearer {TOKEN}"}).status_code == 200
    assert ask("POST", "/api/order", hub, settings, base, json={"rudder": 1}).status_code == 401
    assert ask("GET", "/health", hub, settings, base).status_code == 200
    with pytest.raises(InputError, match="token"):
        make_app(hub, Server.model_construct(host="0.0.0.0", port=1, token=""))


def test_health_readiness_and_metrics():
    """Law: alive at once, ready when there is own ship; metrics are Prometheus's text."""
    hub = Hub(Engine(), reason="starting")
    assert ask("GET", "/health", hub).status_code == 200
    assert ask("GET", "/ready", hub).json() == {"error": "starting"}
    hub.ready = True
    assert ask("GET", "/ready", hub).status_code == 200
    assert "# TYPE aspnn_clients gauge" in ask("GET", "/metrics", hub).text


class Socket:
    """A client that takes a message only when it is told to."""

    def __init__(self):
        self.got, self.free, self.gone, self.closed = [], asyncio.Event(), asyncio.Event(), None

    async def accept(self):
        self.got.clear()

    async def close(self, code, reason):
        self.closed = code

    async def send_text(self, text):
        await self.free.wait()
        self.got.append(json.loads(text)["sequence"])

    async def receive(self):
        await self.gone.wait()
        return {"type": "websocket.disconnect"}


def test_a_slow_client_gets_the_newest_and_holds_up_nobody():
    """Law: of 50 messages a client that sleeps through 49 gets the one it was in and the last; the others get theirs; none is queued."""

    async def run():
        hub, slow, others = Hub(Engine()), Socket(), [Socket() for _ in range(19)]
        for one in others:
            one.free.set()
        tasks = [asyncio.create_task(serve_client(hub, one)) for one in (slow, *others)]
        await asyncio.sleep(0)
        for k in range(1, 51):
            hub.publish({"sequence": k})
            for _ in range(5):
                await asyncio.sleep(0)
        assert hub.clients == 20
        slow.free.set()
        for _ in range(10):
            await asyncio.sleep(0)
        for one in (slow, *others):
            one.gone.set()
        await asyncio.wait_for(asyncio.gather(*tasks), 5)
        assert hub.clients == 0
        return slow.got, [one.got for one in others]

    slow, others = asyncio.run(run())
    assert slow == [1, 50]
    assert all(got[-1] == 50 and got == sorted(set(got)) for got in others)


def test_a_dead_client_is_let_go(monkeypatch):
    """Law: who takes nothing for PATIENCE seconds loses the place; who comes when all are taken is told so."""
    monkeypatch.setattr("aspnn.live.server.PATIENCE", 0.01)

    async def run():
        hub, dead, late = Hub(Engine()), Socket(), Socket()
        task = asyncio.create_task(serve_client(hub, dead))
        await asyncio.sleep(0)
        hub.publish({"sequence": 1})
        await asyncio.wait_for(task, 5)
        assert hub.clients == 0 and hub.refused == 1
        hub.clients = CLIENTS
        await serve_client(hub, late)
        assert late.closed == 1013

    asyncio.run(run())
