"""The transports of `share`: UDP multicast, lines of TCP, and a station that ships meet at. asyncio; what is carried is not looked at."""

import asyncio
import contextlib
import socket
import struct
from collections.abc import Callable

from aspnn.live.config import Share, host_port
from aspnn.live.share import SIZE
from aspnn.schema import InputError

PEERS = 64  # connections of a station
WAITING = 65536  # bytes that may wait for a slow peer

LOOK = 0.05  # s between looks for a message that is due

Take = Callable[[bytes], object]
Tell = Callable[[str], None]


async def take_part(config: Share, take: Callable[[bytes], bool], due: Callable[[], bytes | None], tell: Tell) -> None:
    """Share in the way that the settings name, until it breaks off: `take` gets what the others say and answers whether it was of use,
    `due` gives the own message when there is one, `tell` hears why it does not go, and an empty line when it does."""
    try:
        if config.group is not None:
            await _in_group(*host_port(config.group), config.interface, take, due, tell)
        elif config.listen is not None:
            await _as_station(*host_port(config.listen), take, due, tell)
        elif config.station is not None:
            await _with_station(*host_port(config.station), take, due, tell)
    except InputError as error:
        tell(str(error))


async def _in_group(group: str, port: int, interface: str, take: Take, due, tell: Tell) -> None:
    transport = await multicast(group, port, take, interface, tell)
    with contextlib.closing(transport):
        tell("")
        await _send(due, lambda data: transport.sendto(data, (group, port)))


async def _as_station(host: str, port: int, take: Callable[[bytes], bool], due, tell: Tell) -> None:
    station = Station(take)
    try:
        await station.open(host, port)
        tell("")
        await _send(due, station.send)
    finally:
        await station.close()


async def _with_station(host: str, port: int, take: Take, due, tell: Tell) -> None:
    line = await connect(host, port)
    tell("")
    sending = asyncio.create_task(_send(due, line.send))
    try:
        await line.listen(take)
        tell(f"share: {host}:{port} has ended the connection; calling again")
    finally:
        sending.cancel()
        await line.close()


async def _send(due: Callable[[], bytes | None], send: Callable[[bytes], None]) -> None:
    while True:
        data = due()
        if data is not None:
            send(data)
        await asyncio.sleep(LOOK)


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, take: Take, tell: Tell):
        self.take, self.tell = take, tell

    def datagram_received(self, data: bytes, addr) -> None:
        self.take(data)

    def error_received(self, error: Exception) -> None:
        self.tell(f"share: a datagram did not go ({error})")


async def multicast(
    group: str, port: int, take: Take, interface: str = "127.0.0.1", tell: Tell = lambda reason: None
) -> asyncio.DatagramTransport:
    """Join the UDP multicast `group` on the `interface` (its address): `take` gets every datagram; `sendto(data, (group, port))` sends.

    Hops are limited to the local network. Several programs of one machine hear each other, and themselves. Raises InputError.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM, socket.IPPROTO_UDP)
    try:
        member = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(interface))
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((group, port))
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        listener.setblocking(False)
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(take, tell), sock=listener)
    except (OSError, OverflowError) as error:
        listener.close()
        raise InputError(
            f"share: multicast group {group}:{port} on {interface} cannot be joined ({error}); name a group from 224.0.0.0 to "
            "239.255.255.255, a free port and an interface of this machine"
        ) from None
    return transport


class Line:
    """One connection of the share over TCP: a message a line, either way. `close` it in the end.

    A peer that does not read is not waited for: what would have to wait beyond WAITING bytes is left out, newer messages follow.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter):
        self._reader, self._writer = reader, writer
        self.left_out = 0

    def send(self, data: bytes) -> None:
        """Send a message (`encode`), or leave it out where the peer is slow or gone."""
        if self._writer.is_closing() or self._writer.transport.get_write_buffer_size() > WAITING:
            self.left_out += 1
            return
        self._writer.write(data + b"\n")

    async def listen(self, take: Take) -> None:
        """Give every line to `take` until the connection ends; one longer than SIZE ends it, since its end cannot be told."""
        while True:
            try:
                line = await self._reader.readuntil(b"\n")
            except (asyncio.IncompleteReadError, OSError):
                return
            except asyncio.LimitOverrunError:
                take(b" " * (SIZE + 1))  # counted as what it is: too long
                return
            take(line[:-1])

    async def close(self) -> None:
        """End the connection."""
        self._writer.close()
        with contextlib.suppress(OSError):
            await self._writer.wait_closed()


async def connect(host: str, port: int) -> Line:
    """A connection to another instance, or to a shore station. Raises InputError where nobody listens."""
    try:
        return Line(*await asyncio.open_connection(host, port, limit=SIZE + 1))
    except (OSError, OverflowError) as error:
        raise InputError(f"share: {host}:{port} does not answer ({error}); start the other side first") from None


class Station:
    """A TCP listener that hears all who connect and passes on what `take` accepts to all others: ships see each other through it.

    At most PEERS connections; those beyond are closed at once. `peers` are the connections of now.
    """

    def __init__(self, take: Callable[[bytes], bool]):
        self.peers: set[Line] = set()
        self._take = take
        self._server: asyncio.Server | None = None

    async def open(self, host: str, port: int) -> int:
        """Listen; returns the port (of 0 the system chooses one). Raises InputError."""
        try:
            self._server = await asyncio.start_server(self._serve, host, port, limit=SIZE + 1)
        except (OSError, OverflowError) as error:
            raise InputError(f"share: cannot listen at {host}:{port} ({error}); choose a free port") from None
        return int(self._server.sockets[0].getsockname()[1])

    def send(self, data: bytes) -> None:
        """Send an own message to all."""
        for peer in self.peers:
            peer.send(data)

    async def close(self) -> None:
        """End the listener and all connections."""
        if self._server is not None:
            self._server.close()
        for peer in list(self.peers):
            await peer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        line = Line(reader, writer)
        if len(self.peers) >= PEERS:
            await line.close()
            return
        self.peers.add(line)

        def pass_on(data: bytes) -> None:
            if self._take(data):
                for peer in self.peers - {line}:
                    peer.send(data)

        try:
            await line.listen(pass_on)
        finally:
            self.peers.discard(line)
            await line.close()
