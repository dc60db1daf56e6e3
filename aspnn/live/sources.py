"""Where lines come from: recordings played at any speed, UDP, TCP, serial lines, decoded NMEA 2000. The edge of the program: asyncio.

A source hands on text as it came (`Take`: text, time of receipt, channel) and never gives up: what cannot be opened, or breaks off,
is told and tried again. Lines are cut at their ends; what is longer than LONGEST without one is handed on in pieces, which the
intake counts as malformed, so that a dead line or noise cannot fill the memory.
"""

import asyncio
import contextlib
import csv
import math
import socket
import struct
import sys
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Iterator
from itertools import islice
from pathlib import Path
from time import time as host_time

from aspnn.live.clocks import Event
from aspnn.live.config import FileSource, N2kSource, SerialSource, Source, TcpSource, UdpSource
from aspnn.live.intake import LONGEST
from aspnn.live.n2k import line_of, read_n2k
from aspnn.logs.readings import TIMED, Status
from aspnn.logs.recording import DAY, TOGETHER, read_line, stamp
from aspnn.logs.sentences import Sentence, unix_of
from aspnn.schema import InputError

AGAIN = (1.0, 2.0, 5.0, 10.0)  # s before a source is opened again; the last for ever
QUIET = (
    30.0  # s without a byte after which a TCP server is called anew: a broken line does not always end the connection
)
PERIOD = 0.02  # s for which a played recording is handed on at once
LOOKED = 1000  # lines that tell how a recording is written
MOST = 500  # lines that are handed on at once
GAP = 10.0  # s: through a longer silence of a recording nobody waits
STAMPED = 35  # SO_TIMESTAMPNS of Linux, which Python does not name: the system says when it took a datagram
LONG = 60.0  # s: so long a datagram may have waited; beyond, the system's clock was set

Heard = tuple[str, float]  # text, and how long ago it came [s]
Take = Callable[[str, float, str], None]
Tell = Callable[[Event], None]
Clock = Callable[[], float]


async def run(source: Source, take: Take, tell: Tell, clock: Clock) -> None:
    """Hand on what `source` sends until cancelled; a recording ends. `clock` is that of receipt [s, UNIX, steady]."""
    if isinstance(source, FileSource | N2kSource):
        await play(source, take, tell, clock)
        return
    tries = 0
    while True:
        heard = False
        try:
            async for text, waited in _opened(source):
                heard = True
                take(text, clock() - waited, source.name)
            reason = "the other side ended the connection"
        except (OSError, ValueError) as error:  # pyserial's errors are OSErrors
            reason = str(error).partition("\n")[0] or type(error).__name__
        tries = 0 if heard else tries + 1
        wait = AGAIN[min(tries, len(AGAIN) - 1)]
        tell(Event(clock(), "source", f"channel {source.name}: {reason}; trying again in {wait:g} s"))
        await asyncio.sleep(wait)


def _opened(source: UdpSource | TcpSource | SerialSource) -> AsyncIterator[Heard]:
    if isinstance(source, UdpSource):
        return udp(source)
    if isinstance(source, TcpSource):
        return tcp(source)
    return serial(source)


class Lines:
    """Whole lines of a stream of bytes; the rest waits for its end, LONGEST bytes at most."""

    def __init__(self) -> None:
        self._rest = b""

    def cut(self, data: bytes) -> str:
        """The whole lines so far, with their ends; empty where there is none."""
        whole, end, self._rest = (self._rest + data).replace(b"\r", b"\n").rpartition(b"\n")
        if len(self._rest) > LONGEST:
            whole, end, self._rest = whole + end + self._rest, b"\n", b""
        return (whole + end).decode("latin-1")


def udp_socket(port: int, host: str = "0.0.0.0", group: str | None = None) -> socket.socket:
    """A socket that hears datagrams at `port`, of the multicast `group` where one is named. Raises OSError.

    `host` is the own address that listens. A group of IPv6 is joined on the interface that `host` names after a % ("::%eth0"), else on
    that which the system takes.
    """
    six = ":" in (group or host)
    made = socket.socket(socket.AF_INET6 if six else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(("" if group else host, port))
        if group and six:
            _, _, interface = host.partition("%")
            index = socket.if_nametoindex(interface) if interface else 0
            member = socket.inet_pton(socket.AF_INET6, group) + struct.pack("@I", index)
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, member)
        elif group:
            member = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(host))
            made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        if sys.platform == "linux":
            made.setsockopt(socket.SOL_SOCKET, STAMPED, 1)
        made.setblocking(False)
    except BaseException:
        made.close()
        raise
    return made


async def udp(source: UdpSource) -> AsyncIterator[Heard]:
    """Datagrams as text; each ends its last line. A program that was busy takes all that wait at once, the oldest of too many are lost."""
    loop, made = asyncio.get_running_loop(), udp_socket(source.port, source.host, source.group)
    queue: deque[tuple[bytes, float]] = deque(maxlen=10_000)
    some = asyncio.Event()

    def read() -> None:
        with contextlib.suppress(BlockingIOError):
            for _ in range(MOST):  # then others have their turn; the loop comes back at once
                data, ancillary, _, _ = made.recvmsg(65_536, 64)
                queue.append((data, _arrived(ancillary)))
                some.set()

    loop.add_reader(made, read)
    try:
        while True:
            await some.wait()
            some.clear()
            while queue:
                data, at = queue.popleft()
                waited = host_time() - at  # until it is its turn, not until it was read
                yield data.decode("latin-1"), 0.0 if math.isnan(at) else min(max(waited, 0.0), LONG)
    finally:
        loop.remove_reader(made)
        made.close()


def _arrived(ancillary: list[tuple[int, int, bytes]]) -> float:
    """When the system took a datagram [s, UNIX, by its clock], NaN where it does not say."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, STAMPED) and len(data) == struct.calcsize("@ll"):
            seconds, nanoseconds = struct.unpack("@ll", data)
            return seconds + nanoseconds * 1e-9
    return math.nan


async def tcp(source: TcpSource) -> AsyncIterator[Heard]:
    """What a server sends, in whole lines."""
    reader, writer = await asyncio.wait_for(asyncio.open_connection(source.host, source.port), QUIET)
    lines = Lines()
    try:
        while data := await asyncio.wait_for(reader.read(4096), QUIET):
            if text := lines.cut(data):
                yield text, 0.0
    finally:
        writer.close()


async def serial(source: SerialSource) -> AsyncIterator[Heard]:
    """What comes by a serial line, in whole lines; a thread reads it, since serial ports know no asyncio. Raises InputError."""
    try:
        import serial as pyserial
    except ModuleNotFoundError:
        raise InputError("serial lines need pyserial, which is not installed: pip install 'aspnn[serve]'") from None
    port = await asyncio.to_thread(pyserial.serial_for_url, source.port, baudrate=source.baud, timeout=0.1)
    lines = Lines()
    try:
        while True:
            data = await asyncio.to_thread(lambda: port.read(max(1, min(port.in_waiting, 4096))))
            if text := lines.cut(data):
                yield text, 0.0
    finally:
        port.close()


async def play(source: FileSource | N2kSource, take: Take, tell: Tell, clock: Clock) -> None:
    """Play a recording at its speed; 0: without waiting.

    The times of receipt that are handed on are those of the recording, so that a replay is what it was at any speed. Nobody waits
    through a silence of more than GAP, nor for a time that runs back.
    """
    timed = timed_lines(source.path) if isinstance(source, FileSource) else n2k_lines(source.path, source.si)
    began, last, paced, sent = clock(), math.nan, 0.0, 0.0  # s of the recording: played, and handed on
    together: list[tuple[float, str]] = []
    period = PERIOD * max(source.speed, 1.0)
    try:
        for time, line in timed:
            paced += 0.0 if math.isnan(last) else min(max(time - last, 0.0), GAP)
            last = time
            if together and (paced - sent >= period or len(together) >= MOST):
                _hand_on(together, take, source.name)
                together, sent = [], paced
                wait = began + paced / source.speed - clock() if source.speed else 0.0
                await asyncio.sleep(max(wait, 0.0))
            together.append((time, line))
    except (OSError, UnicodeDecodeError) as error:
        tell(Event(clock(), "source", f"channel {source.name}: {source.path}: {str(error).partition(chr(10))[0]}"))
    _hand_on(together, take, source.name)
    tell(Event(clock(), "ended", f"channel {source.name}: {Path(source.path).name} has been played to its end"))


def _hand_on(together: list[tuple[float, str]], take: Take, channel: str) -> None:
    for time, line in together:
        take(line, time, channel)


def timed_lines(path: str | Path) -> Iterator[tuple[float, str]]:
    """The lines of a recording, each with the time [s, UNIX] at which it was received.

    A line's TAG block or logger tells it, finer than to the second. In a recording without, lines stand between the epochs of
    GGA, GNS, RMC and ZDA: the k-th of n of its kind at the part k/n of the way, as in logs.recording. Before the first of these
    nothing can be told, and those lines stand at it.
    """
    epoch, fine = math.nan, _tells_time(path)
    waiting: list[tuple[tuple[str, str, str], str]] = []  # lines since the last epoch, with their kinds
    with open(path, "rb") as file:
        for raw in file:
            line = raw.decode("latin-1")
            received = stamp(raw[:LONGEST]) if fine else None
            if received is not None:
                yield from ((received, text) for _, text in waiting)
                waiting, epoch = [], received
                yield received, line
                continue
            sentences = [piece for piece in read_line(raw[:LONGEST]) if isinstance(piece, Sentence)]
            own = next((t for s in sentences if (t := _epoch(s, epoch)) is not None), None)
            if own is not None and (math.isnan(epoch) or own > epoch + TOGETHER):
                yield from _spread(waiting, own if math.isnan(epoch) else epoch, own)
                waiting, epoch = [], own
            kind = sentences[0].kind if sentences else ("", "", "")
            timed = own is not None
            if timed:
                yield epoch, line
            elif len(waiting) < 10_000:
                waiting.append((kind, line))
            else:
                yield (0.0 if math.isnan(epoch) else epoch), line
    yield from _spread(waiting, 0.0 if math.isnan(epoch) else epoch, 0.0 if math.isnan(epoch) else epoch)


def _tells_time(path: str | Path) -> bool:
    """Whether the lines of a recording begin with times finer than to the second: of its first LOOKED some do."""
    with open(path, "rb") as file:
        pieces = (piece for raw in islice(file, LOOKED) for piece in read_line(raw[:LONGEST]))
        return any(isinstance(p, Sentence) and p.received is not None and p.received % 1 for p in pieces)


def _epoch(sentence: Sentence, last: float) -> float | None:
    """The own time of a valid sentence, on the day that brings it within half a day of the last."""
    reading = sentence.reading
    if sentence.formatter not in TIMED or reading.utc is None or reading.status is Status.invalid:
        return None
    own = unix_of(reading)
    if own is None:
        own = reading.utc + DAY * round(((reading.utc if math.isnan(last) else last) - reading.utc) / DAY)
    return own


def _spread(waiting: list[tuple[tuple[str, str, str], str]], begin: float, end: float) -> Iterator[tuple[float, str]]:
    """Lines between two epochs: of each kind evenly, in the order of time."""
    count, placed = Counter(kind for kind, _ in waiting), []
    seen: Counter[tuple[str, str, str]] = Counter()
    for kind, line in waiting:
        placed.append((begin + (end - begin) * seen[kind] / count[kind], line))
        seen[kind] += 1
    yield from sorted(placed, key=lambda pair: pair[0])


def n2k_lines(path: str | Path, si: bool = False) -> Iterator[tuple[float, str]]:
    """The messages of decoded NMEA 2000 with their times [s]: lines of JSON, or the long CSV with a header."""
    last = 0.0
    with open(path, encoding="utf-8-sig", newline="") as file:
        begin = file.read(1)
        file.seek(0)
        lines = (line for line in file) if begin == "{" else map(line_of, csv.DictReader(file, skipinitialspace=True))
        for line in lines:
            said = read_n2k(line, si)
            if isinstance(said, Sentence) and said.received is not None:
                last = said.received
            yield last, line
