# SPDX-License-Identifier: GPL-3.0-or-later

"""Ground stations as far as a measurement needs them, and the mix of frames that one sends.

The mix is that of a station with a joystick in use. A parameter and a mission download run, and a command is sent now
and then.
"""

from __future__ import annotations

import socket
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.core import (
    AuthorityHeard,
    Event,
    FromPeer,
    FromVehicle,
    MissionHeld,
    PeerHeard,
    StationCore,
    ToPeer,
    ToVehicle,
    VehicleHeard,
)
from gcs_module.ground import GroundLink
from mavproxy_handover.config.station import StationConfig
from mavproxy_handover.core.common.messages import ConnectAck, Message
from mavproxy_handover.core.common.model import AUTOMATIC, PROTOCOL_VERSION, LeaseState, Phase, Reason, Station
from mavproxy_handover.link.devices import LinkError
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.ids import COMPANION_COMPID, STATION_COMPID
from mavproxy_handover.wire.package_transfer import PackageSender
from sitl.bench.rig import AUTOPILOT, VEHICLE, BenchError, Loop, Rig, Timer, key_file, key_for, split, station_entry

__all__ = [
    "UPLINK_MIX",
    "FakeStation",
    "GroundEnd",
    "TalkingStation",
    "load_mission",
    "make_stations",
    "uplink_message",
]

_COMPONENT: Final = mavlink.MAV_COMP_ID_MISSIONPLANNER
_SIGNING_EPOCH_S: Final = 1_420_070_400  # 2015-01-01, where signatures count from
_HEARD: Final = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_CONNECT,
        mavlink.MAVLINK_MSG_ID_AUTHORITY_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_PACKAGE_ACK,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
    )
)
_GROUND_TICK_S: Final = 0.1


# ---- what one sends -------------------------------------------------------------------------------------------------


def heartbeat(number: int = 0) -> Any:
    """A ground station's heartbeat; `number` tells it from others."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, number, mavlink.MAV_STATE_ACTIVE, 3
    )


#: message -> how often in every twenty frames
UPLINK_MIX: dict[str, int] = {
    "MANUAL_CONTROL": 5,
    "RC_CHANNELS_OVERRIDE": 4,
    "PARAM_REQUEST_READ": 4,
    "MISSION_REQUEST_INT": 4,
    "COMMAND_LONG": 2,
    "HEARTBEAT": 1,
}

_UPLINK_MESSAGES: dict[str, Callable[[int], Any]] = {
    "MANUAL_CONTROL": lambda n: mavlink.MAVLink_manual_control_message(
        VEHICLE, n % 1000, n // 1000 % 1000, 500, -n % 1000, 0
    ),
    "RC_CHANNELS_OVERRIDE": lambda n: mavlink.MAVLink_rc_channels_override_message(
        VEHICLE, AUTOPILOT, 1000 + n % 1000, 1000 + n // 1000 % 1000, 1500, 1500, 1800, 1000, 1500, 65535
    ),
    "PARAM_REQUEST_READ": lambda n: mavlink.MAVLink_param_request_read_message(VEHICLE, AUTOPILOT, b"", n % 30000),
    "MISSION_REQUEST_INT": lambda n: mavlink.MAVLink_mission_request_int_message(VEHICLE, AUTOPILOT, n % 60000, 0),
    "COMMAND_LONG": lambda n: mavlink.MAVLink_command_long_message(
        VEHICLE,
        AUTOPILOT,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        0,
        n % 90,
        0,
        n,
        0,
        0,
        0,
        mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING,
    ),
    "HEARTBEAT": heartbeat,
}


def _order() -> tuple[str, ...]:
    """The mix spread evenly over its period: each message at its share of every stretch."""
    places = [((k + 0.5) / times, name) for name, times in UPLINK_MIX.items() for k in range(times)]
    return tuple(name for _place, name in sorted(places))


_ORDER = _order()


def uplink_message(number: int) -> Any:
    """Frame `number` of a station's mix; its contents tell it from all others of the next thousands."""
    return _UPLINK_MESSAGES[_ORDER[number % len(_ORDER)]](number)


# ---- stations -------------------------------------------------------------------------------------------------------


class FakeStation:
    """A station at a UDP port of 127.0.0.1; the vehicle's side speaks first.

    It beats, answers CONNECT and TIMESYNC, and shares a mission. It counts what it hears, and sends whatever it is told
    to. With a key it signs everything that it sends.
    """

    def __init__(self, loop: Loop, name: str, sysid: int, key: bytes | None = None, vehicle: int = VEHICLE) -> None:
        """Listen. `key`: 32 bytes to sign with; `vehicle`: its MAVLink id. Raises OSError."""
        self.name = name
        #: system and component id of the companion
        self.companion = (vehicle, COMPANION_COMPID)
        self.sysid = sysid
        #: what AUTHORITY_STATUS last said
        self.commander: int | None = None
        self.phase: int = Phase.ON_LOAD
        self.digest = b""
        #: frames that arrived, by message id
        self.heard: Counter[int] = Counter()
        self._loop = loop
        self._own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=_COMPONENT)
        if key is not None:
            self._own.signing.secret_key = key
            self._own.signing.link_id = 0
            self._own.signing.sign_outgoing = True
        self._sender: PackageSender | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self._vehicle: tuple[str, int] | None = None
        loop.add_reader(self._socket.fileno(), self._read)
        self._timers: list[Timer] = [loop.every(1.0, self._beat), loop.every(0.1, self._share_on)]

    # ---- out ------------------------------------------------------------------------------------------------------

    def pack(self, message: Any) -> bytes:
        """The frame of a message as this station sends it, signed if it has a key."""
        if self._own.signing.sign_outgoing:
            self._own.signing.timestamp = max(
                self._own.signing.timestamp, int((time.time() - _SIGNING_EPOCH_S) * 100_000)
            )
        return codec.pack(message, self._own)

    def put(self, raw: bytes) -> None:
        """Send a frame; nowhere before the vehicle's side has spoken."""
        if self._vehicle is not None:
            self._socket.sendto(raw, self._vehicle)

    def send(self, message: Any) -> None:
        """Pack and send a message."""
        self.put(self.pack(message))

    def _beat(self) -> None:
        self.send(heartbeat())

    def entry(self, keys: Path | None = None) -> dict[str, Any]:
        """Its [[station]] for the companion; `keys`: the folder of its key, if it signs. Raises KeysError."""
        return station_entry(self.name, self.sysid, self.port, keys and key_file(keys, self.name))

    def share(self, package: MissionPackage) -> None:
        """Begin to send a mission package to the vehicle; `shared` says when it has loaded it."""
        self._sender = PackageSender(
            package.to_bytes(), package.digest, package.name, self.companion, until_loaded=True
        )

    @property
    def shared(self) -> bool:
        """The vehicle has loaded the package."""
        return self._sender is not None and self._sender.result == mavlink.HANDOVER_PACKAGE_RESULT_LOADED

    @property
    def share_trouble(self) -> str:
        """The vehicle's text when it refused the package."""
        sender = self._sender
        refused = sender is not None and sender.result == mavlink.HANDOVER_PACKAGE_RESULT_REFUSED
        return sender.text if refused and sender is not None else ""

    def _share_on(self) -> None:
        if self._sender is not None and not self._sender.finished:
            for message in self._sender.tick(time.monotonic()):
                self.send(message)

    # ---- in -------------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        while True:
            try:
                data, self._vehicle = self._socket.recvfrom(65536)
            except (BlockingIOError, ConnectionRefusedError):
                return
            frames, _rest = split(data)
            for raw in frames:
                self._take(raw)

    def _take(self, raw: bytes) -> None:
        msgid = raw[5] if raw[0] == 0xFE else int.from_bytes(raw[7:10], "little")
        self.heard[msgid] += 1
        if msgid not in _HEARD:
            return
        m = codec.decode_bytes(raw)
        if m is None:
            return
        kind = m.get_type()
        if kind == "CONNECT":
            answer = ConnectAck(
                self.sysid, PROTOCOL_VERSION, m.nonce, m.epoch, m.commander or None, self.name, self.digest
            )
            self.send(codec.encode(answer, self.companion, self.companion[0]))
        elif kind == "AUTHORITY_STATUS":
            self.commander, self.phase = m.commander or None, m.phase
        elif kind == "MISSION_PACKAGE_ACK" and self._sender is not None:
            for message in self._sender.on_ack(m, time.monotonic()):
                self.send(message)
        elif kind == "TIMESYNC" and m.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(time.monotonic_ns(), m.ts1))

    def close(self) -> None:
        """Close the port."""
        for timer in self._timers:
            timer.cancel()
        self._loop.remove_reader(self._socket.fileno())
        self._socket.close()


def make_stations(loop: Loop, count: int, *, signing: bool = False) -> list[FakeStation]:
    """A number of stations, the first of them the parent. Raises OSError."""
    names = [f"GCS{chr(ord('A') + number)}" for number in range(count)]
    # system ids: those of the project's missions, then others
    sysids = [(251 if number < 4 else 200) + number for number in range(count)]
    keys = [key_for(name) if signing else None for name in names]
    return [FakeStation(loop, *each) for each in zip(names, sysids, keys, strict=True)]


def load_mission(rig: Rig, parent: FakeStation, package: MissionPackage, limit_s: float = 60.0) -> None:
    """The parent sends the package, and the vehicle loads it. Raises BenchError."""
    parent.share(package)
    rig.wait(lambda: parent.shared or bool(parent.share_trouble), "the mission package is loaded", limit_s)
    if parent.share_trouble:
        raise BenchError(f"mission package refused: {parent.share_trouble}")


class TalkingStation(FakeStation):
    """A station that takes part in transfers by the rules that ship (`StationCore`). It consents to each at once.

    What it may send besides is up to the measurement. Without a ground link (`GroundEnd`) the vehicle passes on what
    the stations have to say to each other.
    """

    def __init__(
        self,
        loop: Loop,
        name: str,
        sysid: int,
        key: bytes | None = None,
        vehicle: int = VEHICLE,
        peers: tuple[Station, ...] = (),
    ) -> None:
        """`peers`: the stations that it reaches over a ground link, once it has one."""
        super().__init__(loop, name, sysid, key, vehicle)
        #: sends another station a message over the ground link
        self.to_peer: Callable[[int, Message], None] = lambda _peer, _message: None
        self._core = StationCore(Station(sysid, name), "drone-1", peers, automatic=AUTOMATIC)

    def hold(self, package: MissionPackage) -> None:
        """The station holds this mission package."""
        self.digest = package.digest
        self.hear(MissionHeld(package.digest))

    def reaches(self, peer: int) -> bool:
        """Whether another station is heard over the ground link."""
        return self._core.peer_alive(peer, time.monotonic())

    def hear(self, event: Event) -> None:
        """Do what the rules say to an event."""
        for action in self._core.handle(event, time.monotonic()):
            if isinstance(action, ToVehicle):
                self.send(codec.encode(action.message, self.companion, self.companion[0]))
            elif isinstance(action, ToPeer):
                self.to_peer(action.peer, action.message)

    def _take(self, raw: bytes) -> None:
        message = codec.decode_bytes(raw)
        if message is None:
            return
        kind = message.get_type()
        decoded = codec.decode(message)
        event: Any = VehicleHeard() if decoded is None else FromVehicle(decoded)
        if kind == "AUTHORITY_STATUS":
            who = message.commander or None, message.partner or None
            recovering = message.lease == LeaseState.RECOVERING
            event = AuthorityHeard(
                Phase(message.phase),
                *who,
                message.epoch,
                message.handover_id,
                recovering,
                Reason(message.transfer_reason),
                crossing=message.crossing,
            )
        self.hear(event)
        if kind != "CONNECT":  # the core has answered that
            super()._take(raw)


class GroundEnd:
    """The ground link of an artificial station: one end for all its vehicles, as a station has it.

    The link itself is the one that ships, signed with the ground key. This class does what MAVProxy's module does
    around it: a heartbeat a second, and each message to its vehicle. `config`: as far as the ground link goes.
    """

    def __init__(self, loop: Loop, config: StationConfig) -> None:
        """Listen. Raises BenchError, KeysError."""
        self._loop = loop
        self._talkers: dict[int, TalkingStation] = {}
        self._own = mavlink.MAVLink(None, srcSystem=config.station.sysid, srcComponent=STATION_COMPID)
        try:
            self._link = GroundLink(config, Clocks(time.time, time.monotonic))
        except LinkError as error:
            raise BenchError(f"{config.station.name}: ground link: {error}") from None
        listening = self._link.listening
        if listening is None:
            raise BenchError(f"{config.station.name} has no ground link")
        self._descriptor = listening
        loop.add_reader(listening, self._read)
        self._timers: list[Timer] = [loop.every(1.0, self._beat), loop.every(_GROUND_TICK_S, self._tick)]

    @property
    def refused(self) -> dict[str, int]:
        """Frames that were dropped, by what was wrong with their signature."""
        return dict(self._link.refused)

    def join(self, talker: TalkingStation) -> None:
        """From now on it is this station's part for its vehicle."""
        vehicle = talker.companion[0]
        self._talkers[vehicle] = talker
        talker.to_peer = partial(self._send, vehicle)

    def _read(self) -> None:
        for frame in self._link.read():
            if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                for talker in self._talkers.values():
                    talker.hear(PeerHeard(frame.sysid))
                continue
            message = codec.decode_bytes(frame.raw)
            decoded = None if message is None else codec.decode(message)
            about = self._talkers.get(getattr(message, "vehicle", 0))
            if decoded is not None and about is not None:
                about.hear(FromPeer(frame.sysid, decoded))

    def _send(self, vehicle: int, peer: int, message: Message) -> None:
        self._link.write(peer, codec.pack(codec.encode(message, (peer, 0), vehicle), self._own))

    def _beat(self) -> None:
        for peer in self._link.peers:
            self._link.write(peer, codec.pack(heartbeat(), self._own))

    def _tick(self) -> None:
        self._link.tick(time.monotonic())

    def close(self) -> None:
        """Close everything."""
        for timer in self._timers:
            timer.cancel()
        self._loop.remove_reader(self._descriptor)
        self._link.close()
