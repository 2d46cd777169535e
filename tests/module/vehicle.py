# SPDX-License-Identifier: GPL-3.0-or-later

"""The two ends that the companion's module stands between: an autopilot that follows a script, and stations."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

#: home of the delivery mission, inside zone A
HOME = (52.679, 5.924)
GUIDED, AUTO, RTL, LAND = 4, 3, 6, 9


_DECODER = mavlink.MAVLink(None)


def frames(data: bytes) -> list[Any]:
    """The messages in some bytes, decoded with our dialect."""
    try:  # nearly always one frame, and a parser takes twice as long as the decoder
        found = [_DECODER.decode(bytearray(data))] if data else []
    except mavlink.MAVError:
        found = mavlink.MAVLink(None).parse_buffer(data) or []
    return [m for m in found if m.get_type() != "BAD_DATA"]


#: of each kind of message, the bytes of its id in a frame
_IDS = {kind.msgname: number.to_bytes(3, "little") for number, kind in mavlink.mavlink_map.items()}


class Inbox(list[Any]):
    """Messages that have arrived. Each is decoded when a test looks at it: most are never looked at."""

    def put(self, data: bytes) -> None:
        """Take in a datagram. What is not one whole frame of MAVLink 2 without a signature is decoded at once."""
        plain = len(data) > 11 and data[0] == 0xFD and data[2] == 0 and len(data) == data[1] + 12
        self.extend([data] if plain else frames(data))

    def got(self, kind: str, start: int = 0) -> list[Any]:
        """The messages of one kind, from this place on."""
        wanted = _IDS.get(kind)
        return [
            self[at]
            for at, frame in enumerate(super().__getitem__(slice(start, None)), start)
            if (frame[7:10] == wanted if frame.__class__ is bytes else frame.get_type() == kind)
        ]

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, slice):
            return [self[each] for each in range(*at.indices(len(self)))]
        found = super().__getitem__(at)
        if isinstance(found, bytes):
            found = self[at] = _DECODER.decode(bytearray(found))
        return found

    def __iter__(self) -> Iterator[Any]:
        at = 0
        while at < len(self):
            yield self[at]
            at += 1

    def __add__(self, other: Any) -> list[Any]:
        return [*self, *other]

    def __contains__(self, message: Any) -> bool:
        return any(each == message for each in self)


class Autopilot:
    """An ArduCopter as far as the companion talks with it; what a test scripts makes it refuse, forget or lie."""

    def __init__(self) -> None:
        self.mode = 0
        self.armed = False
        self.airborne = False
        #: the item of the mission that it says it flies to
        self.waypoint: int | None = None
        self.position: tuple[float, float] | None = HOME
        #: time between two positions as long as it stays where it is
        self.position_s = 0.1
        #: it says no oftener where it is, also when it has moved
        self.slow = False
        self._position_at = 0.0
        self._was_at: tuple[object, ...] = ()
        #: everything that was written to the autopilot, with its sender
        self.received: list[Any] = []
        #: command -> result to answer with (None: no answer at all); it is then not carried out
        self.script: dict[int, int | None] = {}
        #: commands that are acknowledged and not carried out
        self.forgets: set[int] = set()
        #: a STATUSTEXT that comes before the answer to a refused command
        self.reason = ""
        #: mission_type -> items as MISSION_ITEM_INT messages
        self.items: dict[int, list[Any]] = {0: [], 1: [], 2: []}
        #: parameters by name; it says nothing to a name that it does not have
        self.parameters: dict[str, float] = {"WPNAV_SPEED": 1000.0, "RTL_SPEED": 0.0}
        #: of these it tells everybody with its next step, as when somebody else has set them
        self.tells: list[str] = []
        #: parameters that keep their value whatever is written
        self.fixed: set[str] = set()
        #: mission_type -> what the autopilot answers to a whole list
        self.results: dict[int, int] = {}
        #: changes an item on its way back
        self.spoil: Callable[[Any], Any] = lambda item: item
        #: it does not answer those who read a list
        self.silent_lists = False
        #: how many items more than it holds the autopilot says it holds
        self.count_error = 0
        #: the guard's status is sent with this state, echoing the last lease; None: there is no guard
        self.guard_state: int | None = 2
        self._expected: dict[int, int] = {}
        self._lease: tuple[int, int, int] = (0, 0, 0)
        #: the nonce of its guard, which leases must carry
        self.guard_nonce = 0x0BADCAFE
        self._own = stock.MAVLink(None, srcSystem=1, srcComponent=1)
        self._out: list[Any] = []
        self._beat_at = 0.0
        self._guard_at = 0.0
        self.silent = False
        #: part of its battery of 10 Ah that is left; None: it says nothing of it
        self.battery: float | None = 1.0
        #: its home above the sea; it never leaves that height
        self.home_alt_m = 0.0
        #: above home
        self.height_m = 0.0
        #: north and east (m/s)
        self.velocity = (0.0, 0.0)
        #: its MAV_TYPE
        self.kind = mavlink.MAV_TYPE_QUADROTOR

    def say(self, message: Any) -> None:
        """Send a message, as MAVProxy would hand it to modules: packed, and decoded without our dialect."""
        raw = message.pack(self._own)
        self._own.seq = (self._own.seq + 1) % 256
        self._out.append(stock.MAVLink(None).decode(bytearray(raw)))

    def step(self, written: list[bytes], now: float) -> list[Any]:
        """Take in what was written; returns what is said."""
        self._out = []
        while self.tells:
            self._say_parameter(self.tells.pop())
        self._take_all(written)
        if self.silent:
            return []
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            self.beat()
        if self.guard_state is not None and now >= self._guard_at:
            self._guard_at = now + 0.5
            self.say_guard(self.guard_state)
        is_at = self.position, self.height_m, self.velocity
        if self.position is not None and (now >= self._position_at or (is_at != self._was_at and not self.slow)):
            self._position_at, self._was_at = now + self.position_s, is_at
            self.say_position(*self.position)
        return self._out

    def answers(self, written: list[bytes]) -> list[Any]:
        """Take in what was written; returns what is said to that, and nothing besides."""
        self._out = []
        self._take_all(written)
        return self._out

    def _take_all(self, written: list[bytes]) -> None:
        for data in written:
            for message in frames(data):
                self.received.append(message)
                if not self.silent:
                    self._take(message)

    def beat(self) -> None:
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (128 if self.armed else 0)
        self.say(stock.MAVLink_heartbeat_message(self.kind, 3, base, self.mode, 4 if self.airborne else 3, 3))
        self.say(stock.MAVLink_extended_sys_state_message(0, 2 if self.airborne else 1))
        if self.battery is not None:
            self.say_battery(self.battery)
        if self.waypoint is not None:
            self.say(stock.MAVLink_mission_current_message(self.waypoint))

    def say_position(self, lat: float, lon: float) -> None:
        above_m = self.height_m
        place = round(lat * 1e7), round(lon * 1e7), round((self.home_alt_m + above_m) * 1000), round(above_m * 1000)
        north, east = self.velocity
        self.say(stock.MAVLink_global_position_int_message(1000, *place, round(north * 100), round(east * 100), 0, 0))

    def say_battery(self, left: float, volts: float = 12.6, amperes: float = 0.0) -> None:
        """BATTERY_STATUS of 10 Ah at 12.6 V, so much of them left."""
        used_mah = round((1.0 - left) * 10_000)
        cells = [round(volts * 1000), *[65535] * 9]
        used_hj = round(used_mah * 12.6 * 0.036)
        body = (0, 0, 0, 32767, cells, round(amperes * 100), used_mah, used_hj, round(left * 100))
        self.say(stock.MAVLink_battery_status_message(*body))

    def say_guard(self, state: int) -> None:
        nonce, sequence, epoch = self._lease
        body = struct.pack("<BBBBIIIHBBI", 2, state, 0, 0, nonce, sequence, epoch, 0, 4, 6, self.guard_nonce)
        self.say(stock.MAVLink_tunnel_message(1, 191, 47117, 24, list(body.ljust(128, b"\0"))))

    # ---- what arrived -------------------------------------------------------------------------------------------

    def got(self, kind: str, sysid: int | None = None) -> list[Any]:
        """The messages of one kind that have arrived, of one sender or of all."""
        return [m for m in self.received if m.get_type() == kind and sysid in (None, m.get_srcSystem())]

    def commands(self) -> list[int]:
        """The commands that have arrived, in order, without requests for message rates."""
        return [m.command for m in self.got("COMMAND_LONG") if m.command != 511]

    def lease_payloads(self) -> list[bytes]:
        """The leases, whole."""
        found = [m for m in self.got("TUNNEL", 1) if m.payload_type == 47116]
        return [bytes(m.payload)[: m.payload_length] for m in found]

    def leases(self) -> list[tuple[int, ...]]:
        """The leases that have arrived: version, state, commander, flags, nonce, sequence, epoch, ttl, seconds left,
        nonce of the guard."""
        return [
            struct.unpack("<BBBBIIIHHI", bytes(m.payload[:24]))
            for m in self.got("TUNNEL", 1)
            if m.payload_type == 47116 and m.payload_length == 24
        ]

    def _take(self, m: Any) -> None:
        kind = m.get_type()
        if kind == "COMMAND_LONG":
            self._command(m)
        elif kind == "MISSION_COUNT":
            self.items[m.mission_type] = []
            self._expected[m.mission_type] = m.count
            self._ask_item(m)
        elif kind == "MISSION_ITEM_INT":
            if m.seq == len(self.items[m.mission_type]):
                self.items[m.mission_type].append(m)
            self._ask_item(m)
        elif kind == "MISSION_CLEAR_ALL":
            self.items[m.mission_type] = []
            self.say(stock.MAVLink_mission_ack_message(m.get_srcSystem(), m.get_srcComponent(), 0, m.mission_type))
        elif kind == "MISSION_REQUEST_LIST" and self.silent_lists:
            return
        elif kind == "MISSION_REQUEST_LIST":
            asker = (m.get_srcSystem(), m.get_srcComponent())
            held = len(self.items[m.mission_type]) + self.count_error
            self.say(stock.MAVLink_mission_count_message(*asker, held, m.mission_type))
        elif kind == "MISSION_REQUEST_INT":
            self._give_item(m)
        elif kind == "PARAM_REQUEST_READ":
            self._say_parameter(m.param_id)
        elif kind == "PARAM_SET":
            if m.param_id in self.parameters and m.param_id not in self.fixed:
                self.parameters[m.param_id] = m.param_value
            self._say_parameter(m.param_id)
        elif kind == "TUNNEL" and m.payload_type == 47116:
            fields = struct.unpack("<BBBBIIIHHI", bytes(m.payload[:24]))
            if fields[9] == self.guard_nonce:
                self._lease = (fields[4], fields[5], fields[6])

    def _say_parameter(self, name: str) -> None:
        if name in self.parameters:
            value = self.parameters[name]
            self.say(stock.MAVLink_param_value_message(name.encode(), value, 9, 900, 65535))

    def _ask_item(self, m: Any) -> None:
        asker, kind = (m.get_srcSystem(), m.get_srcComponent()), m.mission_type
        have = len(self.items[kind])
        if have < self._expected.get(kind, 0):
            self.say(stock.MAVLink_mission_request_int_message(*asker, have, kind))
        else:
            self.say(stock.MAVLink_mission_ack_message(*asker, self.results.get(kind, 0), kind))

    def _give_item(self, m: Any) -> None:
        item = self.spoil(self.items[m.mission_type][m.seq])
        values = [getattr(item, name) for name in item.fieldnames[2:]]
        self.say(stock.MAVLink_mission_item_int_message(m.get_srcSystem(), m.get_srcComponent(), *values))

    def _command(self, m: Any) -> None:
        asker = (m.get_srcSystem(), m.get_srcComponent())
        result = self.script.get(m.command, 0)
        if result is None:
            return
        if result != 0 and self.reason:
            self.say(stock.MAVLink_statustext_message(4, self.reason.encode()))
        self.say(stock.MAVLink_command_ack_message(m.command, result, 0, 0, *asker))
        if result != 0 or m.command in self.forgets:
            return
        if m.command == mavlink.MAV_CMD_DO_SET_MODE:
            self.mode = int(m.param2)
        elif m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = bool(m.param1)
        elif m.command == mavlink.MAV_CMD_MISSION_START:
            self.mode, self.airborne = AUTO, True


class PlaneAutopilot(Autopilot):
    """An ArduPlane likewise. With rotors it hovers while `vtol_state` says so."""

    def __init__(self, rotors: bool = False) -> None:
        super().__init__()
        self.kind = mavlink.MAV_TYPE_FIXED_WING
        self.vtol_state = mavlink.MAV_VTOL_STATE_FW if rotors else mavlink.MAV_VTOL_STATE_UNDEFINED
        self.landed_state: int | None = None
        #: modes that it does not have, or cannot take up now
        self.lacks: set[int] = set() if rotors else {19, 20, 21, 26}
        #: the mode that it takes up instead of one
        self.instead: dict[int, int] = {}
        #: the item behind its mission's DO_LAND_START; None: it has none
        self.way_down: int | None = None
        self.waypoint = 0
        self.script[mavlink.MAV_CMD_DO_PAUSE_CONTINUE] = mavlink.MAV_RESULT_UNSUPPORTED
        self.parameters = {"AIRSPEED_CRUISE": 22.0, "AIRSPEED_MIN": 13.0, "AIRSPEED_MAX": 35.0}

    def beat(self) -> None:
        super().beat()
        landed = self.landed_state or (2 if self.airborne else 1)
        self.say(stock.MAVLink_extended_sys_state_message(self.vtol_state, landed))

    def _command(self, m: Any) -> None:
        modes = m.command == mavlink.MAV_CMD_DO_SET_MODE
        if modes and int(m.param2) in self.lacks:
            self.say(stock.MAVLink_command_ack_message(m.command, 4, 0, 0, m.get_srcSystem(), m.get_srcComponent()))
            return
        if m.command == mavlink.MAV_CMD_DO_LAND_START and self.way_down is None:
            self.say(stock.MAVLink_command_ack_message(m.command, 4, 0, 0, m.get_srcSystem(), m.get_srcComponent()))
            return
        super()._command(m)
        if m.command in self.forgets or self.script.get(m.command, 0) != 0:
            return
        if modes:
            self.mode = self.instead.get(self.mode, self.mode)
        elif m.command == mavlink.MAV_CMD_DO_LAND_START:
            self.mode, self.waypoint = 10, self.way_down
        elif m.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
            self.waypoint = int(m.param1)
        self.airborne = self.airborne or (self.armed and self.mode == 10)
        self.beat()


class Station:
    """A ground station at its own UDP socket: it beats, answers CONNECT, and keeps what it hears."""

    def __init__(self, name: str, sysid: int) -> None:
        self.name = name
        self.sysid = sysid
        self.alive = True
        self.digest = bytes(32)
        self.operator = ""
        self.received = Inbox()
        self.own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self.vehicle: tuple[str, int] | None = None
        self._beat_at = 0.0

    def step(self, now: float) -> None:
        while True:
            try:
                data, self.vehicle = self._socket.recvfrom(65536)
            except BlockingIOError:
                break
            seen = len(self.received)
            self.received.put(data)
            if self.alive:
                for message in self.received.got("CONNECT", seen):
                    self._answer(message)
        if self.alive and now >= self._beat_at:
            self._beat_at = now + 1.0
            self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def _answer(self, m: Any) -> None:
        name = self.name.encode()
        values = (m.get_srcSystem(), 191, 1, self.sysid, 1, m.nonce, m.epoch, m.commander, name, list(self.digest))
        self.send(mavlink.MAVLink_connect_ack_message(*values, 0, self.operator.encode()))

    def send(self, message: Any, sysid: int | None = None) -> None:
        """Send a message; `sysid` pretends to be somebody else."""
        own = self.own if sysid is None else mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        self.send_bytes(message.pack(own))

    def send_bytes(self, data: bytes) -> None:
        if self.vehicle is not None:
            self._socket.sendto(data, self.vehicle)

    def command(self, command: int, *parameters: float, component: int = 1) -> None:
        values = (*parameters, *([0.0] * (7 - len(parameters))))
        self.send(mavlink.MAVLink_command_long_message(1, component, command, 0, *values))

    def got(self, kind: str) -> list[Any]:
        return self.received.got(kind)

    def acks(self, command: int) -> list[int]:
        """Results of a command, in the order in which they came."""
        return [m.result for m in self.got("COMMAND_ACK") if m.command == command]

    def told(self) -> list[tuple[int, str]]:
        """Severity and text of what a ground station program shows: pieces put together, blanks for one."""
        found: list[tuple[int, str]] = []
        for m in self.got("STATUSTEXT"):
            text = m.text if m.chunk_seq == 0 else found.pop()[1] + m.text
            found.append((m.severity, text))
        return [(severity, " ".join(text.split())) for severity, text in found]

    def texts(self) -> str:
        """All of them, but for who commands."""
        return "".join(text for _severity, text in self.told() if "commands now" not in text)

    def close(self) -> None:
        self._socket.close()
