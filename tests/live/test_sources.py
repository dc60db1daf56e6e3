"""Where lines come from: recordings with and without times, sockets, serial lines; what breaks off is opened again."""

import asyncio
import os
import socket
import time
from pathlib import Path

import numpy as np
import pytest

from aspnn.live.config import FileSource, N2kSource, SerialSource, TcpSource, UdpSource
from aspnn.live.intake import LONGEST
from aspnn.live.sources import GAP, Lines, n2k_lines, play, run, timed_lines, udp_socket
from aspnn.logs.recording import clock as recorded_clock
from aspnn.logs.recording import read_recording, unix
from aspnn.logs.sentences import encode, encode_tag

START = unix("2026-11-22T12:00:00Z")


def gga(t: float) -> str:
    s = t % 86400
    utc = f"{int(s // 3600):02d}{int(s // 60 % 60):02d}{s % 60:06.3f}"
    return encode("GP", "GGA", [utc, "6930.0000", "N", "01530.0000", "E", "1", *[""] * 8])


def hdt(angle: float) -> str:
    return encode("HE", "HDT", [f"{angle:.1f}", "T"])


def test_lines_are_whole_however_they_are_cut():
    """Law: bytes in pieces of any size give the lines, each once; noise without an end never waits for long."""
    text = b"".join(f"line {k}\r\n".encode() for k in range(50))
    for size in (1, 3, 7, 1000):
        lines = Lines()
        cut = "".join(lines.cut(text[i : i + size]) for i in range(0, len(text), size))
        assert [line for line in cut.split("\n") if line] == [f"line {k}" for k in range(50)]
    lines = Lines()
    assert sum(len(lines.cut(b"x" * 1000)) for _ in range(100)) >= 100_000 - LONGEST and len(lines._rest) <= LONGEST


def test_times_of_tagged_lines(tmp_path):
    """By hand: the times of TAG blocks, and of a line without one that of the next."""
    lines = [encode_tag("GP", START + 0.1) + gga(START), hdt(1), encode_tag("GP", START + 0.25) + hdt(2)]
    (tmp_path / "a.nmea").write_text("\n".join(lines))
    timed = list(timed_lines(tmp_path / "a.nmea"))
    assert [t for t, _ in timed] == [START + 0.1, START + 0.25, START + 0.25] and [x.strip() for _, x in timed] == lines


def test_times_of_lines_that_have_none(tmp_path):
    """Oracle: logs.recording, which places the sentences of a whole file: ten headings to a fix, across midnight, dated by RMC."""
    begin = unix("2026-11-22T23:59:57Z")
    lines = [encode("GP", "ZDA", ["235957.000", "22", "11", "2026"])]
    for k in range(6):
        lines += [gga(begin + k), *(hdt(10 * k + j) for j in range(10))]
    (tmp_path / "a.nmea").write_text("\r\n".join(lines))
    placed, _, _ = recorded_clock(read_recording(tmp_path / "a.nmea"))
    timed = list(timed_lines(tmp_path / "a.nmea"))
    told = {line.strip(): t for t, line in timed}
    expected = dict(zip(lines, placed, strict=True))
    assert len(timed) == len(lines)
    for line in lines[:-10]:  # the last ten have no end
        assert told[line] == pytest.approx(expected[line], abs=1e-6), line
    assert np.diff([t for t, _ in timed]).min() >= 0


class Pace:
    """A clock that stands, and an asyncio.sleep that moves it: nobody waits."""

    def __init__(self, monkeypatch):
        self.now, self.slept = 1000.0, 0.0
        monkeypatch.setattr("aspnn.live.sources.asyncio.sleep", self.sleep)

    async def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept += seconds

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("speed, waits", [(1.0, 20.0), (100.0, 0.2), (0.0, 0.0)])
def test_a_recording_is_played_at_its_speed(tmp_path, monkeypatch, speed, waits):
    """By hand: 10 s, then an hour of silence that counts as GAP: 20 s at speed 1. Times are the recording's; all lines come, in order."""
    stamps = [START + 0.01 + k / 10 for k in range(101)] + [START + 3600.01]
    lines = [encode_tag("HE", t) + hdt(k) for k, t in enumerate(stamps)]
    (tmp_path / "a.nmea").write_text("\r\n".join(lines))
    pace, taken, told = Pace(monkeypatch), [], []
    source = FileSource(kind="file", path=str(tmp_path / "a.nmea"), speed=speed)
    asyncio.run(play(source, lambda *given: taken.append(given), told.append, pace))
    assert pace.slept == pytest.approx(waits, abs=0.1) and GAP == 10.0
    assert [line.strip() for line, _, _ in taken] == lines and {c for _, _, c in taken} == {"file"}
    np.testing.assert_allclose([t for _, t, _ in taken], stamps, atol=1e-3)
    assert [e.code for e in told] == ["ended"]


def test_decoded_nmea_2000_is_played(tmp_path):
    """By hand: the long CSV of aspnn import n2k-yacht, and canboat's JSON lines; a line that is none keeps the time before."""
    (tmp_path / "a.csv").write_text("t,pgn,src,yaw,lat,lon\n5.5,127250,52,81.5,,\n5.6,129025,52,,69.5,15.5\n")
    timed = list(n2k_lines(tmp_path / "a.csv"))
    assert [t for t, _ in timed] == [5.5, 5.6] and '"yaw": "81.5"' in timed[0][1]
    message = '{"timestamp":"2026-11-22-12:00:00.500","src":5,"pgn":127251,"fields":{"Rate":1.0}}'
    (tmp_path / "a.json").write_text(f"{message}\nnoise\n")
    assert [t for t, _ in n2k_lines(tmp_path / "a.json")] == [START + 0.5] * 2
    assert N2kSource(kind="n2k", path="x").speed == 1.0


def gather(source, send, enough, seconds=10.0):
    """Run a source while `send` (a coroutine) sends, until `enough(texts)`; returns texts and events."""
    texts, told = [], []

    async def go():
        task = asyncio.create_task(run(source, lambda text, t, channel: texts.append(text), told.append, time.time))
        sender = asyncio.create_task(send())
        end = time.monotonic() + seconds
        while not enough(texts) and time.monotonic() < end:
            await asyncio.sleep(0.01)
        for job in (task, sender):
            job.cancel()
        await asyncio.gather(task, sender, return_exceptions=True)

    asyncio.run(go())
    return texts, told


def free(kind=socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as made:
        made.bind(("127.0.0.1", 0))
        return made.getsockname()[1]


@pytest.mark.parametrize("six, group", [(False, None), (False, "239.192.0.200"), (True, None), (True, "ff01::a5:1")])
def test_datagrams(six, group):
    """Law: what is sent by UDP, to this computer or to a multicast group that does not leave it, of IPv4 or IPv6, comes as it is."""
    port = free()
    for name in [name for _, name in socket.if_nameindex()] if six and group else [""]:
        host = (f"::%{name}" if name else "::1") if six else "127.0.0.1"
        out = socket.socket(socket.AF_INET6 if six else socket.AF_INET, socket.SOCK_DGRAM)
        try:
            udp_socket(port, host, group).close()
            where = (
                (group or host, port, 0, socket.if_nametoindex(name) if name else 0) if six else (group or host, port)
            )
            if name:
                out.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_IF, where[3])
            elif not six:
                out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
            out.sendto(b"", where)
            break
        except OSError:
            out.close()
    else:
        pytest.skip("no multicast, or no IPv6, here")
    source = UdpSource(kind="udp", port=port, host=host, group=group)

    async def send():
        with out:
            while True:
                out.sendto(b"UdPbC\0" + hdt(5).encode() + b"\r\n\xff", where)
                await asyncio.sleep(0.02)

    texts, told = gather(source, send, lambda t: len(t) >= 3)
    assert texts[0] == "UdPbC\0" + hdt(5) + "\r\n\xff" and len(texts) >= 3 and not told


def test_a_server_that_ends_the_connection_is_called_again(monkeypatch):
    """Law: lines of both connections come, and the event says that the first one broke off."""
    monkeypatch.setattr("aspnn.live.sources.AGAIN", (0.05,))
    port = free(socket.SOCK_STREAM)

    async def send():
        async def serve(reader, writer):
            writer.write(f"{hdt(1)}\r\n{hdt(2)}\r\n$HEHDT,half".encode())
            await writer.drain()
            writer.close()

        async with await asyncio.start_server(serve, "127.0.0.1", port):
            await asyncio.sleep(60)

    texts, told = gather(TcpSource(kind="tcp", host="127.0.0.1", port=port), send, lambda t: len(t) >= 2)
    assert [x for x in texts[0].split("\n") if x] == [hdt(1), hdt(2)] and len(texts) >= 2
    assert any("ended the connection" in e.text and "trying again" in e.text for e in told)


def test_a_port_that_is_not_there_is_told_and_tried_again(monkeypatch):
    """Contract: wrong ports are events, one line each, and the source goes on trying."""
    monkeypatch.setattr("aspnn.live.sources.AGAIN", (0.01,))

    async def nothing():
        await asyncio.sleep(60)

    pytest.importorskip("serial")
    for source in (
        TcpSource(kind="tcp", host="127.0.0.1", port=free(socket.SOCK_STREAM)),
        SerialSource(kind="serial", port="/dev/no such"),
    ):
        _, told = gather(source, nothing, lambda _: False, 0.3)
        assert len(told) >= 2 and all(
            "\n" not in e.text and e.text.startswith(f"channel {source.name}: ") for e in told
        )


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals of POSIX")
def test_a_serial_line():
    """Law: what is written to one end of a pseudo-terminal comes in whole lines at the other."""
    pytest.importorskip("serial")
    ours, theirs = os.openpty()
    source = SerialSource(kind="serial", port=os.ttyname(theirs))

    async def send():
        while True:
            os.write(ours, f"{hdt(7)}\r\n".encode())
            await asyncio.sleep(0.02)

    texts, _ = gather(source, send, lambda t: len(t) >= 2)
    os.close(ours)
    os.close(theirs)
    assert set("".join(texts).split()) == {hdt(7)}


def test_a_file_that_cannot_be_read_is_told(tmp_path):
    """Contract: a recording that vanished is an event, no exception."""
    told = []
    source = FileSource(kind="file", path=str(tmp_path / "gone.nmea"))
    asyncio.run(play(source, lambda *_: None, told.append, time.time))
    assert "No such file" in told[0].text and Path(source.path).name in told[0].text
