# SPDX-License-Identifier: GPL-3.0-or-later

"""A station driven by datagrams: its MAVProxy module as it ships, from the socket of the ground link to what it says.

Everything is the shipped code but the kernel's sockets, MAVProxy and the clock. A plan is a row of instructions: a
datagram of bytes, a frame of a peer (signed with the ground link's key, with another one, or not at all), a frame that
was sent before, one of the vehicle, a pause. What must hold:

* nothing raises, and no callback notes a fault;
* a frame that is not signed with the key, or was heard before, does nothing: it is not told to the core, and nothing is
  sent because of it;
* a station that has a package of its own keeps it; one that has none takes only what the vehicle announced, and says
  so;
* what peers say alone moves neither epoch nor commander, and sends the vehicle nothing;
* what goes out on the ground link is whole signed frames of this station, to peers that there are.
"""

from __future__ import annotations

import atexit
import shutil
import socket
import tempfile
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Final
from unittest import mock

from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import module as gcs_module
from gcs_module.events import FromPeer, PeerHeard
from gcs_module.station_resources import StationResources
from mavproxy_handover.config.files import load_station
from mavproxy_handover.link import udp
from mavproxy_handover.mission import package as packages
from mavproxy_handover.store.keys import write_key
from mavproxy_handover.tools import worker
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.frames import field_offset, parse_one
from mavproxy_handover.wire.ids import OUR_MESSAGES
from mavproxy_handover.wire.package_transfer import CHUNK_BYTES
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer, sign
from tests.fuzz.reader import Reader
from tests.module.proxy import MPState
from tests.packages import MISSIONS, ROUND

__all__ = [
    "BYTES",
    "CHUNK",
    "FOREIGN",
    "PAUSE",
    "PEER",
    "REPLAY",
    "UNSIGNED",
    "VEHICLE_SAYS",
    "Station",
    "run",
    "seeds",
]

BYTES, PEER, FOREIGN, UNSIGNED, REPLAY, CHUNK, VEHICLE_SAYS, PAUSE = range(8)
ME, PEERS, VEHICLE = 251, (252, 253), 1
KEY: Final = bytes(range(32))
OTHER_KEY: Final = bytes(range(1, 33))
#: 2026-11-20 00:00 UTC
UTC_S: Final = 1_795_132_800.0
STAMP: Final = 37_506_240_000_000
OWN, OFFERED = packages.load(ROUND), packages.load(MISSIONS / "linear")
OFFERED_BYTES: Final = OFFERED.to_bytes()
#: what our messages and a heartbeat are, and some that are nobody's business
IDS: Final = [*(number for number in OUR_MESSAGES if number in mavlink.mavlink_map), 0, 0, 76, 77, 512]
LISTEN: Final = ("127.0.0.1", 14_601)


class Socket:
    """As much of a UDP socket as `link.udp` asks for. What is written is kept in `written`."""

    written: ClassVar[deque[tuple[bytes, tuple[str, int]]]] = deque()
    family = socket.AF_INET
    _next = 10_000

    def __init__(self, *_kind: int) -> None:
        self.waiting: deque[bytes] = deque()
        Socket._next += 1
        self._fileno = Socket._next

    def setblocking(self, _flag: bool) -> None: ...

    def setsockopt(self, _level: int, option: int, _value: Any) -> None:
        if option != socket.SO_RCVBUF:
            raise OSError("no filters here")

    def getsockopt(self, _level: int, _option: int, _size: int) -> bytes:
        raise OSError("no memory figures here")

    def bind(self, address: tuple[str, int]) -> None:
        self.address = address

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        if not self.waiting:
            raise BlockingIOError
        return self.waiting.popleft()[:size], ("127.0.0.1", 40_000)

    def sendto(self, data: bytes, address: tuple[str, int]) -> int:
        self.written.append((data, address))
        return len(data)

    def fileno(self) -> int:
        return self._fileno

    def close(self) -> None: ...


class Clock:
    """Stands in for the module `time`."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def time(self) -> float:
        return UTC_S + self.now - 1000.0

    @staticmethod
    def strftime(_form: str) -> str:
        return "00:00:00"


class _NoStore:
    """No disk: what becomes of the replay state there is what `states` drives."""

    def __init__(self, _path: Path) -> None: ...

    def load(self, _now: float) -> str:
        return ""

    def attach(self, _name: str, _peer: Any) -> None: ...

    def tick(self, _now: float) -> None: ...

    def close(self) -> None: ...


@contextmanager
def _alone(clock: Clock) -> Iterator[None]:
    """Our code, and nothing of the system around it."""
    sockets = SimpleNamespace(**{name: getattr(socket, name) for name in dir(socket) if name.isupper()})
    sockets.socket, sockets.inet_pton = Socket, socket.inet_pton
    with (
        mock.patch.object(udp, "socket", sockets),
        mock.patch.object(gcs_module, "time", clock),
        mock.patch.object(station_commands, "time", clock),
        mock.patch.object(worker, "in_thread", lambda job: job()),
        mock.patch("gcs_module.ground.ReplayStore", _NoStore),
    ):
        yield


class Station:
    """GCSA's module with GCSB and GCSC at the other end of the ground link, and the invariants."""

    def __init__(self, folder: Path, clock: Clock, *, own: bool, asks: bool) -> None:
        self.clock = clock
        self.told: list[Any] = []
        #: signed frames that were sent, and those that something came of
        self.sent: list[bytes] = []
        self.done: set[bytes] = set()
        self.announced: set[bytes] = set()
        self.vehicle_spoke = False
        self._stamp = STAMP
        self._own = own
        config = load_station(_configuration(folder, own=own, asks=asks))
        self._mpstate = MPState()
        Socket.written.clear()
        self.module: Any = gcs_module.HandoverGcsModule(
            self._mpstate, config, StationResources.of(config, Clocks(clock.time, clock.monotonic))
        )
        self._checker = SignedPeer(KEY)
        self._watch()
        self._look()

    def _watch(self) -> None:
        handle, take = self.module.aircraft[0].core.handle, self.module.aircraft[0].mission_transfer.on_message

        def handled(event: Any, now: float) -> Any:
            if isinstance(event, (FromPeer, PeerHeard)):
                self.told.append(event)
            return handle(event, now)

        def taken(sender: int, component: int, message: Any, now: float) -> Any:
            self.told.append(message)
            return take(sender, component, message, now)

        self.module.aircraft[0].core.handle, self.module.aircraft[0].mission_transfer.on_message = handled, taken

    def datagram(self, data: bytes, *, signed: bool = False) -> None:
        """A datagram arrives on the ground link. `signed`: it is one frame, signed with the link's key."""
        core = self.module.aircraft[0].core
        before = (core.epoch, core.commander, core.digest)
        held = self.module.aircraft[0].mission_transfer.held
        self.told.clear()
        self._socket.waiting.append(data)
        self.module._readable(None)
        assert (core.epoch, core.commander, core.digest) == before
        assert self.module.aircraft[0].mission_transfer.held is held
        if not signed or data in self.done:
            assert not self.told
            assert not Socket.written
        elif self.told:
            self.done.add(data)
        self._look()

    def signed(self, raw: bytes, key: bytes = KEY) -> bytes:
        self._stamp = max(self._stamp + 1, STAMP + int((self.clock.now - 1000.0) * 100_000))
        data = sign(raw, key, 1, self._stamp)
        return raw if data is None else data  # MAVLink 1 has no signatures

    def peer(self, raw: bytes) -> None:
        data = self.signed(raw)
        self.sent.append(data)
        self.datagram(data, signed=data is not raw)

    def again(self, number: int) -> None:
        if self.sent:
            data = self.sent[-1 - number % len(self.sent)]
            self.datagram(data, signed=bool(data[2] & 1) and data[0] == 0xFD)

    def vehicle_says(self, raw: bytes) -> None:
        """A message that came by MAVProxy's link."""
        message = stock.MAVLink(None).decode(bytearray(raw))
        held = self.module.aircraft[0].mission_transfer.held
        self.vehicle_spoke = True
        self.module.mavlink_packet(message)
        self._look(held)

    def pause(self, seconds: float) -> None:
        held = self.module.aircraft[0].mission_transfer.held
        self.clock.now += seconds
        self.module.idle_task()
        self._look(held)

    def close(self) -> None:
        self.module.unload()

    @property
    def _socket(self) -> Socket:
        found: Socket = self.module._ground._listening._socket
        return found

    def _look(self, held: Any = ...) -> None:
        """What holds at every moment."""
        faults = [where for where in self.module.faults if not where.startswith(("ground frame", "message of the"))]
        assert not faults, faults
        assert not self._mpstate.escaped
        now = self.module.aircraft[0].mission_transfer.held
        if self._own:
            assert now == OWN
        elif held is not ... and now is not held:
            assert now == OFFERED
            assert self.module.aircraft[0].core.vehicle_digest == OFFERED.digest
        if not self.vehicle_spoke:
            assert not self._mpstate.mav_master[0].written
        while Socket.written:
            data, address = Socket.written.popleft()
            frame = parse_one(data)
            assert frame is not None
            assert (frame.known, frame.sysid) == (True, ME)
            assert address in [("127.0.0.1", 14_600 + peer) for peer in PEERS]
            assert self._checker.check(frame, self.clock.time(), self.clock.now) is SignatureVerdict.OK


def _configuration(folder: Path, *, own: bool, asks: bool) -> Path:
    path = folder / f"station-{own:d}{asks:d}.toml"
    if path.exists():
        return path
    if not (folder / "ground.key").exists():
        write_key(folder / "ground.key", KEY)
    peers = "".join(
        f'[[peer]]\nname = "GCS{sysid}"\nsysid = {sysid}\nlink = "udpout:127.0.0.1:{14_600 + sysid}"\n'
        for sysid in PEERS
    )
    path.write_text(
        f"""
        [station]
        name = "GCSA"
        sysid = {ME}
        vehicle = {VEHICLE}
        consent = "{"operator" if asks else "automatic"}"
        {f'mission = "{ROUND}"' if own else ""}
        journal = "/dev/null"
        [ground]
        listen = "udpin:{LISTEN[0]}:{LISTEN[1]}"
        key = "ground.key"
        {peers}
        """
    )
    return path


def _framed(msgid: int, payload: bytes, sysid: int, compid: int, *, first: bool = False) -> bytes:
    """A frame with a right CRC, whatever it says."""
    extra = mavlink.mavlink_map[msgid].crc_extra if msgid in mavlink.mavlink_map else 0
    if first and msgid < 256:
        head, magic = bytes([len(payload), 0, sysid, compid, msgid]), b"\xfe"
    else:
        head, magic = bytes([len(payload), 0, 0, 0, sysid, compid]) + msgid.to_bytes(3, "little"), b"\xfd"
    crc = mavlink.x25crc(head + payload + bytes([extra])).crc
    return magic + head + payload + crc.to_bytes(2, "little")


def _frame(reader: Reader, sysids: tuple[int, ...], compids: tuple[int, ...]) -> bytes:
    """Message, form, then the payload; unless the form says else it is for this station, and about its vehicle."""
    msgid, form = IDS[reader.byte() % len(IDS)], reader.byte()
    sysid, compid = sysids[form % len(sysids)], compids[(form >> 2) % len(compids)]
    cls = mavlink.mavlink_map.get(msgid)
    size = 12 if cls is None else cls.unpacker.size
    payload = bytearray(reader.counted().ljust(size, b"\0")[:size])
    if cls is not None and not form & 0x40 and "target_system" in cls.fieldnames:
        payload[field_offset(msgid, "target_system")] = ME
        if "vehicle" in cls.fieldnames:
            payload[field_offset(msgid, "vehicle")] = VEHICLE
    if cls is not None and form & 0x20:  # digests that there are
        for name in ("mission_digest", "digest"):
            if name in cls.fieldnames:
                place = field_offset(msgid, name)
                payload[place : place + 32] = OFFERED.digest
    return _framed(msgid, bytes(payload), sysid, compid, first=bool(form & 0x80))


def _chunk(number: int, sysid: int) -> bytes:
    """The offer of a sound package (0), and what is in it."""
    own = mavlink.MAVLink(None, sysid, 190)
    if number == 0:
        offer = mavlink.MAVLink_mission_package_message(ME, 0, len(OFFERED_BYTES), list(OFFERED.digest), b"linear")
        return bytes(offer.pack(own))
    offset = (number - 1) * CHUNK_BYTES
    piece = OFFERED_BYTES[offset : offset + CHUNK_BYTES]
    short = int.from_bytes(OFFERED.digest[:4], "little")
    chunk = mavlink.MAVLink_mission_chunk_message(
        ME, 0, short, offset, len(piece), list(piece.ljust(CHUNK_BYTES, b"\0"))
    )
    return bytes(chunk.pack(own))


def _filled(instruction: int, msgid: int, form: int, **values: Any) -> bytes:
    """An instruction to send a message with these values."""
    cls = mavlink.mavlink_map[msgid]
    fields = {name: values.get(name, 0) for name in cls.fieldnames}
    for name, length in zip(cls.fieldnames, cls.array_lengths, strict=False):
        if length and name not in values:
            fields[name] = b"" if cls.fieldtypes[cls.fieldnames.index(name)] == "char" else [0] * length
    message = cls(**fields)
    raw = bytes(message.pack(mavlink.MAVLink(None, 1, 1)))
    payload = raw[10:-2]
    return bytes([instruction, IDS.index(msgid), form, len(payload)]) + payload


def seeds() -> Iterator[bytes]:
    """Each message of a peer under each sign, a whole package, a handover as both ends see it."""
    for setting in range(4):
        head = bytes([setting])
        for msgid in IDS[:-5]:
            said = _filled(PEER, msgid, 0)
            yield head + said + bytes([REPLAY, 0]) + _filled(FOREIGN, msgid, 0) + _filled(UNSIGNED, msgid, 0)
            yield head + _filled(VEHICLE_SAYS, msgid, 0x24) + bytes([PAUSE, 4]) + said
        chunks = len(OFFERED_BYTES) // CHUNK_BYTES + 2
        package = b"".join(bytes([CHUNK, number]) for number in range(chunks)) + bytes([PAUSE, 1])
        connect = _filled(VEHICLE_SAYS, mavlink.MAVLINK_MSG_ID_CONNECT, 0x24, target_system=ME, epoch=1)
        yield head + package + connect + bytes([PAUSE, 1, PAUSE, 30])
        yield head + connect + package + bytes([PAUSE, 30])
    status = mavlink.MAVLINK_MSG_ID_AUTHORITY_STATUS
    names = mavlink.mavlink_map[status].fieldnames
    for commander, partner in ((ME, 252), (252, ME)):
        known = {"commander": commander, "partner": partner, "epoch": 3, "handover_id": 5, "phase": 2, "lease": 2}
        told = _filled(VEHICLE_SAYS, status, 0, **{name: value for name, value in known.items() if name in names})
        key = {"target_system": ME, "vehicle": VEHICLE, "handover_id": 5, "epoch": 3}
        steps = b""
        for name in ("ON_HANDOVER", "HANDOVER_REQUEST", "CONNECT_HANDOVER", "DRONE_CONNECTED", "HANDOVER_RESULT"):
            msgid = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
            fields = mavlink.mavlink_map[msgid].fieldnames
            values = {**key, "from_station": commander, "to_station": partner}
            chosen = {field: value for field, value in values.items() if field in fields}
            steps += _filled(PEER, msgid, 0, **chosen) + _filled(VEHICLE_SAYS, msgid, 0, **chosen)
        yield bytes([1]) + told + steps + bytes([PAUSE, 2])
        yield bytes([3]) + told + steps + bytes([PAUSE, 2])


def _carry_out(reader: Reader, station: Station) -> None:
    while reader.more():
        what = reader.byte() % 8
        if what == BYTES:
            station.datagram(reader.counted())
        elif what == PEER:
            station.peer(_frame(reader, (*PEERS, 99, ME), (190, 1, 191)))
        elif what == FOREIGN:
            station.datagram(station.signed(_frame(reader, (*PEERS, 99, ME), (190, 1)), OTHER_KEY))
        elif what == UNSIGNED:
            station.datagram(_frame(reader, (*PEERS, 99, ME), (190, 1)))
        elif what == REPLAY:
            station.again(reader.byte())
        elif what == CHUNK:
            number = reader.byte()
            station.peer(_chunk(number & 0x1F, PEERS[number >> 7]))
        elif what == VEHICLE_SAYS:
            station.vehicle_says(_frame(reader, (VEHICLE,), (198, 191, 1, 240)))
        else:
            station.pause(reader.byte() / 20)


def run(plan: bytes) -> Station:
    """Carry a plan out; any exception is a finding. The first byte is the station's setting."""
    reader, clock = Reader(plan), Clock()
    setting = reader.byte()
    with _alone(clock):
        station = Station(_folder(), clock, own=bool(setting & 1), asks=bool(setting & 2))
        try:
            _carry_out(reader, station)
        finally:
            station.close()
    return station


@cache
def _folder() -> Path:
    """Where the configuration lies; gone with the process."""
    folder = tempfile.mkdtemp(prefix="handover-fuzz-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
