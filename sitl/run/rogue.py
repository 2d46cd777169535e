# SPDX-License-Identifier: GPL-3.0-or-later

"""An attacker between the vehicle and its stations: `python -m sitl.run.rogue --config FILE`.

    journal = "rogue.jsonl"
    vehicle = 1                # system id of the vehicle under attack
    [[link]]
    name = "GCSB"
    listen = 14560             # the vehicle's companion sends here ...
    target = 14551             # ... and the station listens here
    [[ground]]
    name = "GCSB"
    sysid = 252
    target = 14561             # the station's ground link listens here

    [package]                  # of another mission, in the form in which stations send it
    file = "stranger.bin"
    digest = "5f0c..."
    name = "stranger"

It relays both directions unchanged and unnoticed; its own frames reach the vehicle from the station's address. So what
is refused is refused for its contents and its signature, not for its origin. When the ports are open it takes orders, a
line each, on standard input:

    attack LINK SYSID              every message of its repertoire once, as system SYSID

    flood LINK SYSID RATE SECONDS  RATE datagrams a second, by turns a valid frame (every other one signed with a key of
                                   the rogue's own), a broken one and noise

    record LINK                    keep what the station sends from here on
    replay LINK                    send that again, unchanged

    forge STATION SYSID            to a station's ground link, as its neighbour SYSID: a heartbeat, messages of
                                   transfers that were not announced, and the whole package

    feed LINK SYSID KIND RATE SECONDS [METRES]   no attack: a program beside the station that sends a feed, as another
                                   component of SYSID. KIND: rtk (METRES: the base is so far to the east), adsb,
                                   remote-id (METRES: the operator is so far to the north), or basic-id

    terrain LINK SYSID HEIGHT SECONDS   no attack: a program beside the station that answers each TERRAIN_REQUEST by
                                   HEIGHT (m), as another component of SYSID; HEIGHT "none": it only notes them

It ends when its input does. It uses no code of the vehicle except the dialect and a check sum.
"""

from __future__ import annotations

import argparse
import json
import random
import select
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final, TextIO

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.rtcm import crc24q
from sitl.run.ending import Orders
from sitl.vehicles.ports import LOOPBACK

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

__all__ = ["Rogue", "main", "neighbours_words", "repertoire"]

_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
_COMPANION = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
_LEASE_TYPE = 47116
_RTL = 6
_RECORDED = 20_000
_REPLAY_PER_S = 500.0
_CHUNK_BYTES = 200
#: transfers that may come, each as (handover id, epoch)
_GUESSED = [(number, epoch) for epoch in (1, 2) for number in range(1, 6)]
_FORGED_PER_S = 200.0
#: the component that answers requests for terrain, and the parts of a request at the most
_TERRAIN_COMPONENT, _TERRAIN_PARTS = mavlink.MAV_COMP_ID_USER5, 56
#: so that the receiver's journal of refusals, one of a kind a second, is not passed over
_AT_ONCE = 64


def repertoire(vehicle: int) -> list[Any]:
    """One message of each kind that would change something if it were obeyed, no two of the same message id."""
    command = (vehicle, _AUTOPILOT, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 21196, 0, 0, 0, 0, 0)
    reposition = (vehicle, _AUTOPILOT, 6, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, 0, 526800000, 59200000, 30.0)
    lease = bytes([2, 1, 77, 0]) + bytes([9] * 20)
    tunnel = [*lease, *([0] * (128 - len(lease)))]
    stick = (1500,) * 8
    setpoint = (0, vehicle, _AUTOPILOT, 1, 0b110111000111, 0, 0, 0, 5.0, 0, 0, 0, 0, 0, 0, 0)
    key = {"vehicle": vehicle, "from_station": 251, "to_station": 77, "handover_id": 1, "epoch": 1}
    return [
        mavlink.MAVLink_command_long_message(*command),
        mavlink.MAVLink_command_int_message(*reposition),
        mavlink.MAVLink_set_mode_message(vehicle, 1, _RTL),
        mavlink.MAVLink_mission_clear_all_message(vehicle, _AUTOPILOT),
        mavlink.MAVLink_mission_count_message(vehicle, _AUTOPILOT, 1),
        mavlink.MAVLink_mission_set_current_message(vehicle, _AUTOPILOT, 9),
        mavlink.MAVLink_param_set_message(vehicle, _AUTOPILOT, b"HNDO_ENABLE", 0.0, 9),
        mavlink.MAVLink_rc_channels_override_message(vehicle, _AUTOPILOT, *stick),
        mavlink.MAVLink_manual_control_message(vehicle, 1000, 0, 0, 0, 0),
        mavlink.MAVLink_set_position_target_local_ned_message(*setpoint),
        mavlink.MAVLink_tunnel_message(vehicle, _AUTOPILOT, _LEASE_TYPE, len(lease), tunnel),
        mavlink.MAVLink_file_transfer_protocol_message(0, vehicle, _AUTOPILOT, [0, 0, 0, 8, *([0] * 247)]),
        _transfer("disconnect_handover", vehicle, key),
        _transfer("ok_handover", vehicle, key),
        mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3),
    ]


def neighbours_words(vehicle: int, station: int, neighbour: int) -> list[Any]:
    """The messages of `neighbour` to `station` as its partner, in transfers that have not begun."""
    head = (station, mavlink.MAV_COMP_ID_MISSIONPLANNER)
    words: list[Any] = [
        mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    ]
    for handover_id, epoch in _GUESSED:
        key = (vehicle, station, neighbour, handover_id, epoch)
        words.append(mavlink.MAVLink_on_handover_message(*head, *key, mavlink.HANDOVER_CONSENT_GRANTED, 0, 0))
        words.append(mavlink.MAVLink_drone_connected_message(*head, *key, 0))
    return words


@dataclass(frozen=True, slots=True)
class ForeignPackage:
    """A mission package as stations send it."""

    data: bytes
    digest: bytes
    name: str

    def messages(self, station: int) -> list[Any]:
        """All of it, without waiting to be asked."""
        head = (station, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        number = int.from_bytes(self.digest[:4], "little")
        offer = mavlink.MAVLink_mission_package_message(*head, len(self.data), list(self.digest), self.name.encode())
        pieces = ((at, self.data[at : at + _CHUNK_BYTES]) for at in range(0, len(self.data), _CHUNK_BYTES))
        return [
            offer,
            *(
                mavlink.MAVLink_mission_chunk_message(
                    *head, number, at, len(piece), list(piece.ljust(_CHUNK_BYTES, b"\0"))
                )
                for at, piece in pieces
            ),
        ]


def _transfer(name: str, vehicle: int, key: dict[str, int]) -> Any:
    """A transfer message: every field that is not of the transfer's key is 1."""
    kind = getattr(mavlink, f"MAVLink_{name}_message")
    known = {**key, "target_system": vehicle, "target_component": _COMPANION}
    return kind(*(known.get(field, 1) for field in kind.fieldnames))


class _Tap:
    """One link: two sockets, and what was recorded."""

    def __init__(self, name: str, listen: int, target: int) -> None:
        """Raises OSError: port in use."""
        self.name = name
        self.near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.near.bind((LOOPBACK, listen))
        self.far.bind((LOOPBACK, 0))
        for sock in (self.near, self.far):
            sock.setblocking(False)
        self._target = (LOOPBACK, target)
        self._vehicle: tuple[str, int] | None = None
        self.recorded: list[bytes] | None = None
        #: what the vehicle sends, kept until it is looked at; None: is not
        self.overheard: list[bytes] | None = None

    def pass_on(self, sock: socket.socket) -> None:
        """Relay the datagrams of one side to the other."""
        for _ in range(_AT_ONCE):
            try:
                data, address = sock.recvfrom(65536)
            except OSError:
                return
            if sock is self.near:
                self._vehicle = address
                _send(self.far, data, self._target)
                if self.overheard is not None:
                    self.overheard.append(data)
            elif address == self._target:
                if self.recorded is not None and len(self.recorded) < _RECORDED:
                    self.recorded.append(data)
                self.inject(data)

    def inject(self, data: bytes) -> None:
        """To the vehicle, from where it expects the station."""
        if self._vehicle is not None:
            _send(self.near, data, self._vehicle)


class Ground:
    """A station's ground link, from outside."""

    def __init__(self, name: str, sysid: int, target: int) -> None:
        self.name = name
        self.sysid = sysid
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._target = (LOOPBACK, target)

    def inject(self, data: bytes) -> None:
        """To the station."""
        _send(self._socket, data, self._target)


def _send(sock: socket.socket, data: bytes, address: tuple[str, int]) -> None:
    try:
        sock.sendto(data, address)
    except OSError:  # no receiver, or the system is full
        pass


@dataclass(slots=True)
class _Stream:
    """Datagrams that go out at a rate, and what is journalled when all are out."""

    tap: _Tap | Ground
    what: str
    datagrams: Sequence[bytes]
    total: int
    rate: float
    began: float
    sent: int = 0

    def send(self, now: float) -> bool:
        """Send what is due; True when that was all."""
        due = min(self.total, int((now - self.began) * self.rate) + 1, self.sent + 10 * _AT_ONCE)
        while self.sent < due:
            self.tap.inject(self.datagrams[self.sent % len(self.datagrams)])
            self.sent += 1
        return self.sent >= self.total


class _GroundHeights:
    """A program beside a station that hears requests for heights of the ground. `height_m` None: it does not answer."""

    def __init__(self, tap: _Tap, sysid: int, height_m: int | None, until: float) -> None:
        self.tap = tap
        self.until = until
        self._height_m = height_m
        self._parser: Any = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._own: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=_TERRAIN_COMPONENT)

    def answer(self) -> list[Any]:
        """Answer what was asked since; returns the requests."""
        heard, self.tap.overheard = self.tap.overheard or [], []
        found = [message for data in heard for message in self._parser.parse_buffer(data) or ()]
        asked = [message for message in found if message.get_type() == "TERRAIN_REQUEST"]
        for message in asked if self._height_m is not None else ():
            for part in (bit for bit in range(_TERRAIN_PARTS) if message.mask >> bit & 1):
                where = (message.lat, message.lon, message.grid_spacing, part)
                self.tap.inject(mavlink.MAVLink_terrain_data_message(*where, [self._height_m] * 16).pack(self._own))
                self._own.seq = (self._own.seq + 1) % 256
        return asked


class Rogue:
    """Passes on, and attacks when it is told to. Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        taps: Sequence[_Tap],
        journal: TextIO,
        grounds: Mapping[str, Ground] | None = None,
        package: ForeignPackage | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._taps = {tap.name: tap for tap in taps}
        self._grounds = grounds or {}
        self._package = package
        self._journal = journal
        self._streams: list[_Stream] = []
        self._ground: list[_GroundHeights] = []
        self.sockets = {sock: tap for tap in taps for sock in (tap.near, tap.far)}
        self.note("loaded", f"in the links of {', '.join(self._taps)}")

    @property
    def busy(self) -> bool:
        """Whether it sends at a rate now."""
        return bool(self._streams or self._ground)

    def note(self, event: str, text: str, **values: object) -> None:
        """Write to the journal."""
        now = datetime.now(timezone.utc).isoformat(timespec="milliseconds")
        entry = {"t": round(time.monotonic(), 4), "utc": now, "who": "rogue", "event": event, "text": text, **values}
        self._journal.write(json.dumps(entry) + "\n")

    def order(self, line: str, now: float) -> None:
        """Carry out a line; what cannot be understood is journalled as a fault."""
        word, *rest = line.split() or [""]
        tap = self._taps.get(rest[0] if rest else "")
        try:
            if word == "forge" and rest and rest[0] in self._grounds:
                self._forge(rest[0], int(rest[1]), now)
            elif tap is None:
                raise ValueError(f"no such link: {line!r}")
            elif word == "attack":
                self._attack(tap, int(rest[1]))
            elif word == "flood":
                self._flood(tap, int(rest[1]), float(rest[2]), float(rest[3]), now)
            elif word == "feed":
                self._feed(tap, int(rest[1]), rest[2], (float(rest[3]), float(rest[4])), float((*rest, "0")[5]), now)
            elif word == "terrain":
                height_m = None if rest[2] == "none" else int(rest[2])
                tap.overheard = []
                self._ground.append(_GroundHeights(tap, int(rest[1]), height_m, now + float(rest[3])))
            elif word == "record":
                tap.recorded = []
                self.note("recording", f"what {tap.name} sends is kept", station=tap.name)
            elif word == "replay" and tap.recorded:
                kept, tap.recorded = tap.recorded, None
                self.note("replay_begun", f"{len(kept)} datagrams of {tap.name} again", station=tap.name)
                self._streams.append(_Stream(tap, "replay", kept, len(kept), _REPLAY_PER_S, now))
            else:
                raise ValueError(f"not understood: {line!r}")
        except (ValueError, IndexError) as error:
            self.note("fault", str(error))

    def _forge(self, station: str, neighbour: int, now: float) -> None:
        ground = self._grounds[station]
        messages = neighbours_words(self._vehicle, ground.sysid, neighbour)
        if self._package is not None:
            messages += self._package.messages(ground.sysid)
        frames = _packed(messages, neighbour)
        text = f"{len(frames)} datagrams as {neighbour}"
        self.note("forge_begun", text, station=station, sysid=neighbour, datagrams=len(frames))
        self._streams.append(_Stream(ground, "forge", frames, len(frames), _FORGED_PER_S, now))

    def _attack(self, tap: _Tap, sysid: int) -> None:
        frames = self._frames(sysid)
        for frame in frames:
            tap.inject(frame)
        self.note("attack", f"{len(frames)} frames as {sysid}", station=tap.name, sysid=sysid, frames=len(frames))

    def _frames(self, sysid: int) -> list[bytes]:
        return _packed(repertoire(self._vehicle), sysid)

    def _flood(self, tap: _Tap, sysid: int, rate: float, seconds: float, now: float) -> None:
        luck = random.Random(1)
        frames = []
        for number in range(256):
            frame = bytearray(self._frames(sysid)[number % 12])
            frame[4] = number
            if number % 3 == 1:
                frame[-1] ^= 0x55
            elif number % 3 == 2:
                frame = bytearray(luck.randbytes(40))
            frames.append(bytes(frame) if number % 3 else _stamped(self._vehicle, sysid, number))
        self._streams.append(_Stream(tap, "flood", frames, int(rate * seconds), rate, now))
        self.note("flood_begun", f"{rate:g} datagrams a second for {seconds:g} s", station=tap.name, sysid=sysid)

    def _feed(self, tap: _Tap, sysid: int, kind: str, lasts: tuple[float, float], metres: float, now: float) -> None:
        rate, seconds = lasts
        frames = feed_frames(kind, sysid, metres)
        self._streams.append(_Stream(tap, "feed", frames, int(rate * seconds), rate, now))
        self.note("feed_begun", f"{kind}, {rate:g} a second for {seconds:g} s", station=tap.name, kind=kind)

    def tick(self, now: float) -> None:
        """Send what is due."""
        for ground in list(self._ground):
            for asked in ground.answer():
                what = {"lat": asked.lat, "lon": asked.lon, "parts": bin(asked.mask).count("1")}
                self.note("terrain_asked", f"{what['parts']} parts", station=ground.tap.name, **what)
            if now >= ground.until:
                ground.tap.overheard = None
                self._ground.remove(ground)
        for stream in list(self._streams):
            if stream.send(now):
                self._streams.remove(stream)
                text = f"{stream.sent} datagrams sent"
                self.note(f"{stream.what}_ended", text, station=stream.tap.name, datagrams=stream.sent)


def feed_frames(kind: str, sysid: int, metres: float) -> list[bytes]:
    """Frames of one feed, numbered as one sender does it. Raises ValueError for another kind."""
    if kind not in _FEEDERS:
        raise ValueError(f"no such feed: {kind!r}")
    component, make = _FEEDERS[kind]
    sender: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=component)
    frames = []
    for number in range(256):
        sender.seq = number
        frames.append(bytes(make(number, metres).pack(sender)))
    return frames


def _corrections(number: int, metres: float) -> Any:
    """Message 1005 of RTCM 3, of a base near the flights, and nothing else."""
    x, y, z = _BASE
    fields = [(1005, 12), (1, 12), (0, 6), (0b1110, 4)]
    for value, more in ((x, 2), (y + metres, 2), (z, 0)):
        fields += [(round(value * 10000) % (1 << 38), 38), (0, more)]
    bits = "".join(f"{value:0{width}b}" for value, width in fields if width)
    body = b"\xd3\x00\x13" + int(bits, 2).to_bytes(19, "big")
    data = body + crc24q(body).to_bytes(3, "big")
    return mavlink.MAVLink_gps_rtcm_data_message(number % 32 << 3, len(data), list(data.ljust(180, b"\0")))


def _traffic(number: int, _metres: float) -> Any:
    at = (527_000_000 + number, 57_000_000)
    return mavlink.MAVLink_adsb_vehicle_message(0xABCDE, *at, 0, 900_000, 0, 5000, 0, b"OTHER", 0, 1, 3, 1200)


def _operator(number: int, metres: float) -> Any:
    at = (527_000_000 + round(metres * 90), 57_000_000)
    return mavlink.MAVLink_open_drone_id_system_message(
        0, 0, bytes(20), 1, 0, *at, 1, 0, -1000, -1000, 0, 0, 12.0, number
    )


def _aircraft(_number: int, _metres: float) -> Any:
    serial, multirotor = mavlink.MAV_ODID_ID_TYPE_SERIAL_NUMBER, mavlink.MAV_ODID_UA_TYPE_HELICOPTER_OR_MULTIROTOR
    return mavlink.MAVLink_open_drone_id_basic_id_message(
        0, 0, bytes(20), serial, multirotor, b"0000F1DRONE1".ljust(20)
    )


#: a place on Earth, in metres from its centre
_BASE: Final = (3_855_000.0, 386_000.0, 5_050_000.0)
#: kind -> the component that sends it, and what makes one message of its number
_FEEDERS: Final[Mapping[str, tuple[int, Callable[[int, float], Any]]]] = {
    "rtk": (mavlink.MAV_COMP_ID_GPS, _corrections),
    "adsb": (mavlink.MAV_COMP_ID_ADSB, _traffic),
    "remote-id": (mavlink.MAV_COMP_ID_MISSIONPLANNER, _operator),
    "basic-id": (mavlink.MAV_COMP_ID_MISSIONPLANNER, _aircraft),
}


def _packed(messages: Sequence[Any], sysid: int) -> list[bytes]:
    sender: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=mavlink.MAV_COMP_ID_MISSIONPLANNER)
    frames = []
    for message in messages:
        frames.append(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
    return frames


def _stamped(vehicle: int, sysid: int, number: int) -> bytes:
    """A valid frame with its own sequence number.

    It is a command, a request, or a message of a transfer that does not exist. Every other one carries a signature, by
    a key that no station has.
    """
    sender: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=mavlink.MAV_COMP_ID_MISSIONPLANNER)
    sender.seq = number
    sender.signing.secret_key = bytes(range(32))
    sender.signing.sign_outgoing = number % 2 == 1
    order = (vehicle, _AUTOPILOT, mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, 0, 0, 0, 0, 0)
    messages = (
        mavlink.MAVLink_command_long_message(*order),
        mavlink.MAVLink_param_request_read_message(vehicle, _AUTOPILOT, b"", number),
        mavlink.MAVLink_disconnect_handover_message(vehicle, _COMPANION, vehicle, sysid, sysid, number, number),
    )
    packed: bytes = messages[number // 3 % 3].pack(sender)
    return packed


def main(argv: Sequence[str] | None = None) -> int:
    """Run until standard input ends."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.rogue", description="An attacker on a station's link.")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE")
    arguments = parser.parse_args(argv)
    config = tomllib.loads(arguments.config.read_text(encoding="utf-8"))
    taps = [_Tap(link["name"], link["listen"], link["target"]) for link in config["link"]]
    grounds = {link["name"]: Ground(link["name"], link["sysid"], link["target"]) for link in config.get("ground", ())}

    orders = Orders()
    with Path(config["journal"]).open("a", encoding="utf-8", buffering=1) as journal:
        _serve(Rogue(config["vehicle"], taps, journal, grounds, _foreign(config.get("package"))), orders)
    return 0


def _foreign(table: Mapping[str, str] | None) -> ForeignPackage | None:
    if table is None:
        return None
    return ForeignPackage(Path(table["file"]).read_bytes(), bytes.fromhex(table["digest"]), table["name"])


def _serve(rogue: Rogue, orders: Orders) -> None:
    sources: list[Any] = [*orders.descriptors, *rogue.sockets]
    while True:
        readable, _, _ = select.select(sources, [], [], 0.002 if rogue.busy else 0.2)
        for sock, tap in rogue.sockets.items():
            if sock in readable:
                tap.pass_on(sock)
        for descriptor in orders.descriptors:
            lines = orders.read(descriptor) if descriptor in readable else []
            if lines is None:
                return
            for line in lines:
                rogue.order(line, time.monotonic())
        rogue.tick(time.monotonic())


if __name__ == "__main__":
    raise SystemExit(main())
