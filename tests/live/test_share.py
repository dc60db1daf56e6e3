"""Shared predictions: what is sent is what arrives; what is not by the page is refused and counted; two instances see each other."""

import asyncio
import json
import math
import socket
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aspnn.frames import Zone, convergence, to_geodetic
from aspnn.live import share
from aspnn.live.ahead import predict
from aspnn.live.config import Share
from aspnn.live.share import Inbox, Refusal, Sender, encode, gaussian, read
from aspnn.live.share_net import Station, connect, multicast, take_part
from aspnn.live.targets import Kind, Targets
from aspnn.motion import Path, integrate
from aspnn.schema import InputError

ZONE = Zone.parse("33N")
NOW = 1_700_000_000.0
ME, SHE = Sender("0" * 16, "OWN", None, 90.0, 14.0), Sender("ab" * 8, "NORDLYS", 257000001, 120.0, 18.0)


def prediction(rate=0.01, horizon=90) -> Path:
    path = integrate((7.72e6, 6.5e5, 0.4), np.tile([6.0, 0.5, rate], (2 * horizon, 1)), 0.5)
    t = path.time
    covariance = np.zeros((len(t), 3, 3))
    covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 2, 2] = (
        (1 + 0.3 * t) ** 2,
        (1 + 0.1 * t) ** 2,
        (0.01 + 1e-3 * t) ** 2,
    )
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.3 * (1 + 0.3 * t) * (1 + 0.1 * t)
    gamma = float(convergence(*to_geodetic(path.north[0], path.east[0], ZONE), ZONE))
    return replace(path, spread=gaussian(covariance), convergence=gamma)


def message(**changes) -> dict:
    return json.loads(encode(SHE, 1, NOW, prediction(), ZONE)) | changes


def packed(said) -> bytes:
    return json.dumps(said).encode()


def test_there_and_back():
    """Law: the path, headings, velocities and regions arrive as they were sent, to the digits of the message: 7 decimals of a degree
    are 1 cm, 0.01 degrees 2e-4 rad; chords over 5 s tell the velocities of the arc."""
    path = prediction()
    data = encode(SHE, 7, NOW, path, ZONE)
    assert len(data) < share.SIZE / 2
    said = Inbox("0" * 16).take(data, NOW + 0.1)
    assert (
        said.sequence == 7
        and said.name == "NORDLYS"
        and said.surge == 6.0
        and said.rot == pytest.approx(math.degrees(0.01) * 60, abs=0.01)
    )
    back, sent = said.in_grid(ZONE), path.at(said.path.time)
    np.testing.assert_allclose(back.north, sent.north, atol=0.02)
    np.testing.assert_allclose(back.east, sent.east, atol=0.02)
    np.testing.assert_allclose(back.heading, sent.heading, atol=2e-4)
    np.testing.assert_allclose([back.surge[3], back.sway[3], back.yaw_rate[3]], [6.0, 0.5, 0.01], atol=0.01)
    np.testing.assert_allclose(back.region(0.95).major, sent.region(0.95).major, atol=0.02)
    np.testing.assert_allclose(back.spread.covariance[1:], sent.spread.covariance[1:], rtol=0.02, atol=0.02)
    assert json.loads(encode(SHE, 1, NOW, replace(path, spread=None), ZONE))["region"] is None


def test_a_shared_target_is_where_she_says():
    """Law: a target that shares goes her own way within her horizon, not the arc, and on from its end without a jump; she is not there
    twice where AIS tells of her too; she is lost when she falls silent."""
    half = integrate((7.72e6, 6.5e5, 0.4), np.repeat([[6.0, 0, 0.0], [6.0, 0, 0.02]], 60, axis=0), 0.5)
    half = replace(half, spread=gaussian(prediction(horizon=60).spread.covariance))
    found = Targets(ZONE)
    said = read(encode(SHE, 1, NOW, half, ZONE))
    found.hear_shared(said, NOW)
    (seen,) = found.present(NOW + 3)
    assert (seen.kind, seen.id, seen.vessel.length, seen.vessel.beam) == (Kind.shared, "257000001", 120.0, 18.0)
    path = predict([seen], NOW + 3.0, np.arange(0.0, 91.0))
    meant = half.at(np.arange(3.0, 61.0, 1.0))
    np.testing.assert_allclose(path.north[0, :58], meant.north, atol=0.5)  # chords of 5 s
    np.testing.assert_allclose(np.hypot(np.diff(path.north[0]), np.diff(path.east[0])), 6.0, atol=0.1)
    variance = np.trace(path.spread.covariance[0, :, :2, :2], axis1=1, axis2=2)
    told = half.at(np.array([60.0])).spread.covariance[0, :2, :2]
    assert (
        variance[57] == pytest.approx(np.trace(told), rel=1e-3) and variance[90] > variance[57] + 10
    )  # beyond her horizon it grows on
    found.hear_shared(read(encode(SHE, 2, NOW, replace(half, spread=None), ZONE)), NOW)
    (bare,) = found.present(NOW + 3)
    assert np.isfinite(predict([bare], NOW + 3.0, np.arange(0.0, 91.0)).spread.covariance).all()
    assert found.present(NOW + 10) and not found.present(NOW + 10.1)
    assert [t.id for t in found.forget(NOW + 11)] == ["257000001"]
    elsewhere = Targets(Zone.parse("33N"), own=257000001)
    elsewhere.hear_shared(said, NOW)
    assert elsewhere.present(NOW) == []


def test_order_and_own_messages():
    """By hand: own messages, repeated, older, too frequent and wrongly dated ones are refused, each under its name."""
    inbox = Inbox(ME.instance)
    assert inbox.take(encode(ME, 1, NOW, prediction(), ZONE), NOW) is None
    assert inbox.take(encode(SHE, 5, NOW, prediction(), ZONE), NOW) is not None
    for sequence, at, received in (
        (5, NOW, NOW + 1),
        (4, NOW, NOW + 1),
        (6, NOW - 5, NOW + 1),
        (6, NOW, NOW + 0.01),
        (6, NOW + 60, NOW + 1),
    ):
        assert inbox.take(encode(SHE, sequence, at, prediction(), ZONE), received) is None
    assert (
        inbox.counts == {Refusal.own: 1, Refusal.repeated: 3, Refusal.often: 1, Refusal.clock: 1} and inbox.taken == 1
    )


def test_many_instances(monkeypatch):
    """Law: no more instances than INSTANCES are heard at once; those long silent give their place."""
    monkeypatch.setattr(share, "INSTANCES", 2)
    inbox = Inbox(ME.instance)

    def send(k, at):
        return inbox.take(encode(SHE._replace(instance=f"{k:016x}"), 1, at, prediction(), ZONE), at)

    assert send(1, NOW) and send(2, NOW) and send(3, NOW) is None
    assert inbox.counts == {Refusal.crowded: 1}
    assert send(4, NOW + share.FORGET + 1) and len(inbox._heard) == 1


def _path(**changes):
    return {"path": message()["path"] | changes}


WRONG = {
    "aspnn": message(aspnn=2),
    "extra": message(more=1),
    "instance": message(instance="ABC"),
    "number": message(length="90"),
    "boolean": message(surge=True),
    "mmsi": message(mmsi=1),
    "name": message(name="A\u0007"),
    "tag": message(name="<b>"),
    "long": message(name="A" * 41),
    "size": message(length=5000.0),
    "lists": message(**_path(lat=message()["path"]["lat"][:-1])),
    "order": message(**_path(time=message()["path"]["time"][::-1])),
    "latitude": message(**_path(lat=[99.0] * len(message()["path"]["lat"]))),
    "jump": message(**_path(lon=[message()["path"]["lon"][0], *[x + 1 for x in message()["path"]["lon"][1:]]])),
    "region": message(region={key: [1.0, 1.0] for key in ("major", "minor", "azimuth", "heading")}),
    "missing": {key: value for key, value in message().items() if key != "beam"},
    "list": [1, 2, 3],
}


@pytest.mark.parametrize("wrong", list(WRONG))
def test_refused(wrong):
    """By hand: one thing wrong at a time, each refused as invalid; the message without it is taken."""
    inbox = Inbox(ME.instance)
    assert inbox.take(packed(WRONG[wrong]), NOW) is None and inbox.counts == {Refusal.invalid: 1}
    assert inbox.last_refused and len(inbox.last_refused) <= 200
    assert inbox.take(packed(message()), NOW) is not None


@pytest.mark.parametrize(
    "data",
    [b"", b"{", b"\xff\xfe", b"[" * 5000, b"null", b'{"aspnn":NaN}', packed(message()).replace(b"6.0", b"NaN", 1)],
)
def test_no_json(data):
    """By hand: what is no JSON, has no end or holds no number is refused; nothing raises."""
    assert isinstance(read(data), str)


def test_too_long():
    """By hand: one byte more than SIZE is not looked at, even where it would be a message."""
    data = packed(message())
    assert not isinstance(read(data + b" " * (share.SIZE - len(data))), str)
    inbox = Inbox(ME.instance)
    assert inbox.take(data + b" " * (share.SIZE - len(data) + 1), NOW) is None and inbox.counts == {Refusal.size: 1}


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_never_raises(data):
    """Law: whatever bytes come, also those of a message in which some were changed, the inbox answers and the target list stands."""
    raw = bytearray(packed(message()))
    for place, value in data.draw(st.lists(st.tuples(st.integers(0, len(raw) - 1), st.integers(0, 255)), max_size=6)):
        raw[place] = value
    inbox, found = Inbox(ME.instance), Targets(ZONE)
    for one in (bytes(raw), data.draw(st.binary(max_size=200))):
        said = inbox.take(one, NOW)
        if said is not None:
            found.hear_shared(said, NOW)


def test_what_cannot_be_sent():
    """By hand: a sender whose name breaks the rules is told so, before anything goes out."""
    with pytest.raises(InputError, match="name"):
        encode(SHE._replace(name="A" * 50), 1, NOW, prediction(), ZONE)


async def _until(condition) -> None:
    for _ in range(200):
        if condition():
            return
        await asyncio.sleep(0.01)


def test_two_instances_over_multicast():
    """Two instances of one machine over a real multicast group: each has the other's prediction, and knows its own."""

    async def main():
        inboxes = {one.instance: Inbox(one.instance) for one in (ME, SHE)}
        got = {one.instance: [] for one in (ME, SHE)}

        def take(instance):
            return lambda data: got[instance].append(inboxes[instance].take(data, time.time()))

        address = ("239.192.0.77", 47017)
        ends = {one.instance: await multicast(*address, take(one.instance)) for one in (ME, SHE)}
        for one in (ME, SHE):
            ends[one.instance].sendto(encode(one, 1, time.time(), prediction(), ZONE), address)
        await _until(lambda: all(inbox.taken and inbox.counts for inbox in inboxes.values()))
        for end in ends.values():
            end.close()
        assert all(inbox.taken == 1 and inbox.counts == {Refusal.own: 1} for inbox in inboxes.values())
        assert {said.name for said in got[ME.instance] if said} == {"NORDLYS"}

    asyncio.run(main())


def test_ships_meet_at_a_station():
    """Two ships over TCP: the station has both predictions and each ship the other's; a line without end ends its connection alone."""

    async def main():
        inboxes = {name: Inbox(name) for name in (ME.instance, SHE.instance, "f" * 16)}
        station = Station(lambda data: inboxes["f" * 16].take(data, NOW) is not None)
        port = await station.open("127.0.0.1", 0)
        ships = {one.instance: await connect("127.0.0.1", port) for one in (ME, SHE)}
        rude = await connect("127.0.0.1", port)
        ears = [
            asyncio.create_task(line.listen(lambda data, name=name: inboxes[name].take(data, NOW)))
            for name, line in ships.items()
        ]
        await _until(lambda: len(station.peers) == 3)
        rude.send(b"x" * (3 * share.SIZE))
        for one in (ME, SHE):
            ships[one.instance].send(encode(one, 1, NOW, prediction(), ZONE))
        await _until(lambda: inboxes["f" * 16].taken == 2 and len(station.peers) == 2)
        await _until(lambda: all(inboxes[one.instance].taken for one in (ME, SHE)))
        assert [inbox.taken for inbox in inboxes.values()] == [1, 1, 2]
        assert inboxes["f" * 16].counts == {Refusal.size: 1} and len(station.peers) == 2
        for line in (*ships.values(), rude):
            await line.close()
        await asyncio.gather(*ears)
        await station.close()

    asyncio.run(main())


def test_nobody_there():
    """By hand: a port where nobody listens, and a group that is none, are one line each."""

    async def main():
        with pytest.raises(InputError, match="does not answer"):
            await connect("127.0.0.1", 1)
        with pytest.raises(InputError, match="cannot be joined"):
            await multicast("10.1.2.3", 47018, lambda data: None)

    asyncio.run(main())


def test_the_ways_that_settings_name():
    """Issue 8: by `listen` and `station` two programs hear each other over TCP; a caller whose station is not there, or goes away, is told
    so in a line and calls again."""

    async def main():
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            address = f"127.0.0.1:{probe.getsockname()[1]}"
        heard: dict[str, list[bytes]] = {"ashore": [], "ship": []}
        told: list[str] = []

        async def part(name, config, tell):
            waiting = [name.encode()]

            def take(data):
                heard[name].append(data)
                return True

            await take_part(config, take, lambda: waiting.pop() if waiting else None, tell)

        ship = Share(name="SHIP", station=address)
        await part("ship", ship, told.append)
        assert len(told) == 1 and "does not answer" in told[0]
        ashore = asyncio.create_task(part("ashore", Share(name="ASHORE", listen=address), lambda reason: None))
        await asyncio.sleep(0.05)
        calling = asyncio.create_task(part("ship", ship, told.append))
        await _until(lambda: heard["ashore"])
        assert heard["ashore"] == [b"ship"] and told[-1] == ""
        ashore.cancel()
        await _until(lambda: calling.done())
        assert calling.done() and "has ended the connection" in told[-1]

    asyncio.run(main())
