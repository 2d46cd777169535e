# SPDX-License-Identifier: GPL-3.0-or-later

"""An autopilot with the functions that a measurement needs.

It has streams at given rates, the mission protocol, the one parameter that is written with a mission, and a place in
the world. It does not fly: its place is set, in one step if needed. It reads the lease, so it knows the commander
without asking. Its owner transports its bytes (`SerialAutopilot`: a line for one MAVProxy).
"""

from __future__ import annotations

import math
import os
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.ids import COMPANION_COMPID, LEASE_TUNNEL
from sitl.bench.loop import BenchError, Loop, Timer
from sitl.bench.traffic import AUTOPILOT, DOWNLINK, VEHICLE, Place, downlink_message, split

__all__ = ["FakeAutopilot", "SerialAutopilot"]

#: what is answered, if the companion sends it
_ASKED = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
        mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        mavlink.MAVLINK_MSG_ID_PARAM_SET,
        mavlink.MAVLINK_MSG_ID_TUNNEL,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    )
)


class FakeAutopilot:
    """`send` takes its bytes, one frame at a time."""

    def __init__(self, loop: Loop, send: Callable[[bytes], None], place: Place, sysid: int = VEHICLE) -> None:
        self.place = place
        self.armed = False
        self.in_air = False
        #: of the last lease: system id of the commander, None without one, and whether a transfer is under way
        self.commander: int | None = None
        self.in_transfer = False
        #: called with state and nonce of every lease that arrives
        self.on_lease: Callable[[int, int], None] = lambda state, nonce: None
        #: called with every frame that arrives
        self.on_frame: Callable[[bytes], None] = lambda raw: None
        self.frames_out = 0
        self.positions = 0
        self._loop = loop
        self._send = send
        self._own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=AUTOPILOT)
        self._parser = mavlink.MAVLink(None)
        self._cruise = {"WPNAV_SPEED": 1000.0, "RTL_SPEED": 0.0}
        self._items: dict[int, list[Any]] = {}
        self._expected: dict[int, int] = {}
        self._timers: list[Timer] = []
        self._booted = time.monotonic()

    # ---- out ------------------------------------------------------------------------------------------------------

    def stream(self, frames_per_s: int) -> None:
        """Send the stream of that many frames a second from now on; 0: a heartbeat and a position a second."""
        self.silence()
        table = DOWNLINK[frames_per_s] if frames_per_s else {"HEARTBEAT": 1, "GLOBAL_POSITION_INT": 1}
        for number, (name, times) in enumerate(table.items()):
            job = self._sender(name)
            # streams begin at different times, as they run on a real one: not all in one packet
            self._timers.append(self._loop.every(1.0 / times, job, number * 0.618 % 1.0 / times))

    def silence(self) -> None:
        """Send nothing more."""
        for timer in self._timers:
            timer.cancel()
        self._timers = []

    def _sender(self, name: str) -> Callable[[], None]:
        return lambda: self.say(name)

    def say(self, name: str) -> None:
        """Send one message of the streams now."""
        ms = int((time.monotonic() - self._booted) * 1000)
        if name == "GLOBAL_POSITION_INT":
            self.positions += 1
        self._put(downlink_message(name, self.place, ms, self.armed, self.in_air))

    def take_off(self) -> None:
        """Armed and in the air from now on."""
        self.armed = self.in_air = True
        self.say("EXTENDED_SYS_STATE")
        self.say("HEARTBEAT")

    def _put(self, message: Any) -> None:
        raw = bytes(message.pack(self._own))
        self._own.seq = (self._own.seq + 1) & 0xFF
        self.frames_out += 1
        self._send(raw)

    # ---- in -------------------------------------------------------------------------------------------------------

    def receive(self, raw: bytes) -> None:
        """A frame has arrived."""
        self.on_frame(raw)
        if raw[0] != 0xFD or raw[6] != COMPANION_COMPID:
            return
        if int.from_bytes(raw[7:10], "little") in _ASKED:
            try:
                message = self._parser.decode(bytearray(raw))
            except mavlink.MAVError as error:
                raise BenchError(f"the companion wrote a frame that cannot be read: {error}") from None
            self._answer(message)

    def _answer(self, m: Any) -> None:
        kind = m.get_type()
        asker = (m.get_srcSystem(), m.get_srcComponent())
        if kind == "TUNNEL":
            if m.payload_type == LEASE_TUNNEL:
                self.commander = m.payload[2] or None
                self.in_transfer = m.payload[1] == 2
                self.on_lease(m.payload[1], int.from_bytes(m.payload[4:8], "little"))
        elif kind == "COMMAND_LONG":
            self._put(mavlink.MAVLink_command_ack_message(m.command, mavlink.MAV_RESULT_ACCEPTED, 0, 0, *asker))
        elif kind in ("PARAM_REQUEST_READ", "PARAM_SET"):
            self._answer_cruise(m, kind)
        elif kind == "MISSION_CLEAR_ALL":
            self._items[m.mission_type] = []
            self._put(mavlink.MAVLink_mission_ack_message(*asker, 0, m.mission_type))
        elif kind == "MISSION_REQUEST_LIST":
            count = len(self._items.get(m.mission_type, []))
            self._put(mavlink.MAVLink_mission_count_message(*asker, count, m.mission_type))
        elif kind == "MISSION_REQUEST_INT":
            item = self._items[m.mission_type][m.seq]
            values = [getattr(item, name) for name in item.fieldnames[2:]]
            self._put(mavlink.MAVLink_mission_item_int_message(*asker, *values))
        else:
            self._upload(m, kind, asker)

    def _answer_cruise(self, m: Any, kind: str) -> None:
        name = m.param_id
        if name not in self._cruise:
            return
        if kind == "PARAM_SET":
            self._cruise[name] = m.param_value
        value = self._cruise[name]
        self._put(mavlink.MAVLink_param_value_message(name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32, 1, 0))

    def _upload(self, m: Any, kind: str, asker: tuple[int, int]) -> None:
        if kind == "MISSION_COUNT":
            self._items[m.mission_type] = []
            self._expected[m.mission_type] = m.count
        elif m.seq == len(self._items.setdefault(m.mission_type, [])):
            self._items[m.mission_type].append(m)
        have = len(self._items[m.mission_type])
        if have < self._expected.get(m.mission_type, 0):
            self._put(mavlink.MAVLink_mission_request_int_message(*asker, have, m.mission_type))
        else:
            self._put(mavlink.MAVLink_mission_ack_message(*asker, 0, m.mission_type))


class SerialAutopilot:
    """A `FakeAutopilot` at a serial line, as on the aircraft: a pseudo-terminal, for one MAVProxy to open."""

    def __init__(self, loop: Loop, place: Place) -> None:
        """Make the line. Raises OSError."""
        self._loop = loop
        self._ours, self._theirs = os.openpty()
        for end in (self._ours, self._theirs):
            tty.setraw(end)
        os.set_blocking(self._ours, False)
        #: what MAVProxy is to open
        self.device = f"{os.ttyname(self._theirs)},921600"
        self._rest = b""
        self.model = FakeAutopilot(loop, self._write, place)
        #: MAVProxy is there: it has said something
        self.connected = False
        #: when what is being taken in arrived
        self.received_at = -math.inf
        loop.add_reader(self._ours, self._read)

    def _write(self, raw: bytes) -> None:
        if not self.connected:
            return
        try:
            sent = os.write(self._ours, raw)
        except OSError as error:  # also BlockingIOError: it has not read for kilobytes
            self._lost(error.strerror or str(error))
        if sent < len(raw):
            self._lost("it does not read")

    def _read(self) -> None:
        try:
            data = os.read(self._ours, 65536)
        except BlockingIOError:
            return
        except OSError as error:
            self._lost(error.strerror or str(error))
        self.received_at = time.monotonic()
        self.connected = True
        frames, self._rest = split(self._rest + data)
        for raw in frames:
            self.model.receive(raw)

    def _lost(self, why: str) -> None:
        self.close()
        raise BenchError(f"MAVProxy under test is gone: {why}")

    def close(self) -> None:
        """Close both ends."""
        self._loop.remove_reader(self._ours)
        for end in (self._ours, self._theirs):
            with suppress(OSError):
                os.close(end)
        self._ours = self._theirs = -1
