# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station as far as a measurement needs one: it beats, answers CONNECT and TIMESYNC, and shares a mission.

It counts what it hears, and sends whatever it is told to. With a key it signs everything it sends.
"""

from __future__ import annotations

import socket
import time
from collections import Counter
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.messages import ConnectAck
from mavproxy_handover.core.common.model import PROTOCOL_VERSION, Phase
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.ids import COMPANION_COMPID
from mavproxy_handover.wire.package_transfer import PackageSender
from sitl.bench.loop import Loop, Timer
from sitl.bench.traffic import VEHICLE, split

__all__ = ["FakeStation"]

_COMPONENT = mavlink.MAV_COMP_ID_MISSIONPLANNER
_SIGNING_EPOCH_S = 1_420_070_400  # 2015-01-01, where signatures count from
_HEARD = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_CONNECT,
        mavlink.MAVLINK_MSG_ID_AUTHORITY_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_PACKAGE_ACK,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
    )
)


class FakeStation:
    """A station at a UDP port of 127.0.0.1; the vehicle's side speaks first."""

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
        self._parser = mavlink.MAVLink(None)
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
        self.send(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
            )
        )

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
