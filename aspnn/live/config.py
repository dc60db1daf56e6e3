"""What `bridge.toml` says of the ship, her sensors and the outside: one file for everything that runs on the bridge.

`[antennas]`, `[sensors]` and `[scale]` are those of the maps of recorded sentences (logs.nmea), so that a map which imports a
ship's recordings also serves her live.
"""

import ipaddress
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from aspnn import schema
from aspnn.config import read_toml
from aspnn.frames import Zone
from aspnn.logs.ais_messages import is_ship
from aspnn.logs.maps import Strict, mapped_vessel
from aspnn.logs.nmea import Antenna, Chosen, NmeaMap
from aspnn.schema import InputError
from aspnn.vessel import Vessel, from_dict

Port = Annotated[int, Field(ge=1, le=65535)]
Name = Annotated[str, Field(pattern="^[a-z][a-z0-9_-]*$", max_length=32)]


def _zone(text: str) -> str:
    return str(Zone.parse(text))


def _address(text: str) -> str:
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise ValueError(f"{text!r} is no address; write host:port, such as 239.192.0.1:10110")
    return text


def _group(text: str) -> str:
    try:
        if ipaddress.ip_address(text).is_multicast:
            return text
    except ValueError:
        pass
    raise ValueError(f"{text!r} is no multicast address; write one such as 239.192.0.1, or leave group out")


def _ipv4(text: str) -> str:
    try:
        return str(ipaddress.IPv4Address(text))
    except ValueError:
        raise ValueError(f"{text!r} is no IPv4 address of this computer; write one such as 192.168.0.5") from None


def _columns(scale: dict[str, float]) -> dict[str, float]:
    for name in scale:
        if not any(c.matches(name) for c in schema.LOG):
            raise ValueError(f"{name} is not a column of a log (data/README.md lists them)")
    return scale


def _mmsi(number: int) -> int:
    if not is_ship(number):
        raise ValueError(f"{number} is no ship's MMSI; it has nine digits, the first from 2 to 7")
    return number


Address = Annotated[str, AfterValidator(_address)]


def host_port(address: str) -> tuple[str, int]:
    """Host and port of an address as the file writes it."""
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port)


def is_local(host: str) -> bool:
    """Whether an own address is one that nobody but this computer can reach."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Ship(Strict):
    """Own ship: a packaged vessel or the path of a vessel's .json file, and the UTM zone of the waters."""

    vessel: str
    zone: Annotated[str, AfterValidator(_zone)]
    mmsi: Annotated[int, AfterValidator(_mmsi)] | None = None  # own, so that own AIS is no target
    simulator: bool = False  # take data that are flagged as simulated
    full_pitch_ratio: float | None = Field(default=None, gt=0)  # the pitch ratio that RPM calls 100 %


class FileSource(Strict):
    """A recording, played at `speed` times the pace at which it was made; 0: as fast as it is taken."""

    kind: Literal["file"]
    name: Name = "file"
    path: str
    speed: float = Field(1.0, ge=0, le=10_000)


class UdpSource(Strict):
    """Datagrams, each with one or more sentences; `group`: of this multicast group. `host` is the own address that listens."""

    kind: Literal["udp"]
    name: Name = "udp"
    port: Port
    host: str = "0.0.0.0"
    group: Annotated[str, AfterValidator(_group)] | None = None


class TcpSource(Strict):
    """A server of sentences, such as a multiplexer."""

    kind: Literal["tcp"]
    name: Name = "tcp"
    host: str
    port: Port


class SerialSource(Strict):
    """A serial line; 4800 baud is IEC 61162-1, 38400 IEC 61162-2."""

    kind: Literal["serial"]
    name: Name = "serial"
    port: str
    baud: int = Field(38400, gt=0)


class N2kSource(Strict):
    """Decoded NMEA 2000 as text: canboat's JSON lines, or the long CSV that `aspnn import n2k-yacht` reads. `si`: angles are in radians."""

    kind: Literal["n2k"]
    name: Name = "n2k"
    path: str
    speed: float = Field(1.0, ge=0, le=10_000)
    si: bool = False


Source = Annotated[FileSource | UdpSource | TcpSource | SerialSource | N2kSource, Field(discriminator="kind")]


class Server(Strict):
    """Where the page is served. Any address but this computer's own needs a token, which every client must then show."""

    host: str = "127.0.0.1"
    port: Port = 8765
    token: str = ""

    @property
    def local(self) -> bool:
        """Whether nobody but this computer can reach it."""
        return is_local(self.host)

    @model_validator(mode="after")
    def _guarded(self) -> "Server":
        if not self.local and len(self.token) < 16:
            raise ValueError(
                f"host {self.host} can be reached by others: set token to 16 characters or more, which clients must show"
            )
        return self


class Output(Strict):
    """Where VBW and $PASPN sentences are sent, as UDP."""

    udp: Address


class Share(Strict):
    """Own prediction for other ships and shore stations, and theirs; `name` is the one to go by. One of three ways: UDP multicast in a
    `group`, on the own address `interface`; TCP to a `station` ashore; TCP as that station, which others call at `listen`.
    """

    name: str = Field(min_length=1, max_length=40)
    group: Address | None = None
    interface: Annotated[str, AfterValidator(_ipv4)] = "127.0.0.1"
    station: Address | None = None
    listen: Address | None = None

    @property
    def local(self) -> bool:
        """Whether no other computer is let in. A station that is called is not: it was chosen."""
        own = self.interface if self.group else host_port(self.listen)[0] if self.listen else "localhost"
        return is_local(own)

    @model_validator(mode="after")
    def _one_way(self) -> "Share":
        if sum(way is not None for way in (self.group, self.station, self.listen)) != 1:
            raise ValueError("name one of group (UDP multicast), station and listen (TCP)")
        if self.group is not None:
            _group(host_port(self.group)[0])
        return self


class Chart(Strict):
    """The user's chart: GeoJSON of shore, depth contours and berths."""

    path: str


class Limits(Strict):
    """From where on a target is dangerous."""

    cpa_m: float = Field(500.0, ge=0)
    tcpa_s: float = Field(600.0, ge=0)
    guard_m: float = Field(50.0, ge=0)  # from hull to hull, within which a target that goes away still is


class Record(Strict):
    """Where lines, states and predictions are kept, and for how many hours."""

    folder: str
    hours: float = Field(72.0, gt=0)


class BridgeConfig(Strict):
    """All of `bridge.toml`. Paths count from the file; `read_bridge` makes them whole."""

    ship: Ship
    antennas: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9]*$")], Antenna] = Field(min_length=1)
    sensors: Chosen = Chosen()
    scale: Annotated[dict[str, float], AfterValidator(_columns)] = Field(default_factory=dict)
    sources: list[Source] = Field(min_length=1)
    latency_s: float = Field(0.2, ge=0, le=5)
    rate_hz: float = Field(10.0, ge=1, le=20)
    predict_hz: float = Field(2.0, ge=1, le=10)
    server: Server = Server()
    output: Output | None = None
    share: Share | None = None
    chart: Chart | None = None
    limits: Limits = Limits.model_validate({})
    record: Record | None = None

    @model_validator(mode="after")
    def _together(self) -> "BridgeConfig":
        names = [source.name for source in self.sources]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"sources: two are named {twice[0]}; give each a name of its own")
        told = [antenna.source for antenna in self.antennas.values()]
        if len(set(told)) < len(told):
            raise ValueError("antennas: two have the same source; each antenna has a receiver of its own")
        played = [source.name for source in self.sources if isinstance(source, FileSource | N2kSource)]
        if played and len(played) < len(names):
            live = next(name for name in names if name not in played)
            raise ValueError(
                f"sources: {played[0]} is a recording, {live} is live; their times are not of one clock, so take one or the other"
            )
        return self

    @property
    def map(self) -> NmeaMap:
        """The map of recorded sentences that says the same."""
        return NmeaMap(
            vessel=self.ship.vessel,
            zone=self.ship.zone,
            antennas=self.antennas,
            sensors=self.sensors,
            scale=self.scale,
            simulator=self.ship.simulator,
            full_pitch_ratio=self.ship.full_pitch_ratio,
        )


@dataclass(frozen=True)
class Bridge:
    """A bridge's settings, ready to run: the vessel with her antennas' stations, and paths that stand by themselves."""

    config: BridgeConfig
    vessel: Vessel
    zone: Zone


def read_bridge(path: str | Path) -> Bridge:
    """The settings in `path`. Raises InputError, one line that names file and key."""
    path = Path(path)
    config = read_toml(path, BridgeConfig)
    try:
        ship = mapped_vessel(config.map, path, None)
    except InputError as error:
        raise InputError(f"{path}: ship.vessel: {error}") from None
    ship = ship.with_stations(**{n: a.station_m for n, a in config.antennas.items()})
    ship = from_dict(ship.to_dict(), str(path))  # stations that cannot be are refused here
    sources = [
        s.model_copy(update={"path": str(path.parent / s.path)}) if hasattr(s, "path") else s for s in config.sources
    ]
    changed: dict = {"sources": sources}
    if config.chart is not None:
        changed["chart"] = Chart(path=str(path.parent / config.chart.path))
    if config.record is not None:
        changed["record"] = config.record.model_copy(update={"folder": str(path.parent / config.record.folder)})
    config = config.model_copy(update=changed)
    _there(
        path,
        [(f"sources.{i}.path", s.path) for i, s in enumerate(config.sources) if isinstance(s, FileSource | N2kSource)],
    )
    _there(path, [] if config.chart is None else [("chart.path", config.chart.path)])
    return Bridge(config, ship, Zone.parse(config.ship.zone))


def _there(path: Path, files: Iterable[tuple[str, str]]) -> None:
    for key, file in files:
        if not Path(file).is_file():
            raise InputError(f"{path}: {key}: {file}: no such file")
