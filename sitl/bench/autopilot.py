# SPDX-License-Identifier: GPL-3.0-or-later

"""An autopilot with the functions that a measurement needs, its streams, and ways to move its aircraft.

The streams are those that an ArduCopter sends in flight. 50 a second is slightly more than the companion requests; 200
a second is a fast link with all streams.

The autopilot has streams at given rates, the mission protocol, the one parameter that is written with a mission, and a
place in the world. It does not fly: its place is set, in one step if needed (`Tour`). It reads the lease, so it knows
the commander without asking. Its owner transports its bytes: on a line for one MAVProxy (`SerialAutopilot`), or by
calls of the companion's module in this process (`HostedVehicle`).
"""

from __future__ import annotations

import math
import os
import time
import tty
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.companion import module as vehicle_module
from mavproxy_handover.wire.ids import COMPANION_COMPID, LEASE_TUNNEL
from sitl.bench.rig import AUTOPILOT, IDLE_S, VEHICLE, BenchError, Host, Loop, Timer, split

__all__ = [
    "DOWNLINK",
    "SHUTTLE",
    "STREAM",
    "A",
    "B",
    "FakeAutopilot",
    "HostedVehicle",
    "Place",
    "SerialAutopilot",
    "Stops",
    "Tour",
    "downlink_message",
]

#: the stations of the delivery mission; the first one is the parent
A, B = 251, 252
#: frames a second of an aircraft whose stream is not what is measured
STREAM: Final = 50
#: an entry into a region without a transfer is given up after this time (s)
_GIVE_UP_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Place:
    """Where the aircraft is and how it moves: degrees, metres above home, metres per second."""

    lat_deg: float
    lon_deg: float
    alt_m: float = 30.0
    north_mps: float = 0.0
    east_mps: float = 0.0


#: frames a second in all -> message -> times a second
DOWNLINK: dict[int, dict[str, int]] = {
    50: {
        "GLOBAL_POSITION_INT": 20,
        "ATTITUDE": 8,
        "VFR_HUD": 4,
        "NAV_CONTROLLER_OUTPUT": 2,
        "EXTENDED_SYS_STATE": 2,
        "MISSION_CURRENT": 2,
        "SYS_STATUS": 2,
        "GPS_RAW_INT": 2,
        "RC_CHANNELS": 2,
        "SERVO_OUTPUT_RAW": 2,
        "BATTERY_STATUS": 1,
        "SYSTEM_TIME": 1,
        "VIBRATION": 1,
        "HEARTBEAT": 1,
    },
    200: {
        "GLOBAL_POSITION_INT": 20,
        "ATTITUDE": 50,
        "LOCAL_POSITION_NED": 25,
        "RAW_IMU": 25,
        "VFR_HUD": 20,
        "SERVO_OUTPUT_RAW": 20,
        "RC_CHANNELS": 10,
        "NAV_CONTROLLER_OUTPUT": 5,
        "GPS_RAW_INT": 5,
        "SYS_STATUS": 4,
        "VIBRATION": 4,
        "EXTENDED_SYS_STATE": 3,
        "MISSION_CURRENT": 3,
        "BATTERY_STATUS": 3,
        "SYSTEM_TIME": 2,
        "HEARTBEAT": 1,
    },
}


def downlink_message(name: str, place: Place, boot_ms: int, armed: bool, in_air: bool) -> Any:
    """One message of the autopilot's streams. KeyError for a name that is in none of them."""
    if name == "HEARTBEAT":
        return _heartbeat(armed, in_air)
    if name == "EXTENDED_SYS_STATE":
        state = mavlink.MAV_LANDED_STATE_IN_AIR if in_air else mavlink.MAV_LANDED_STATE_ON_GROUND
        return mavlink.MAVLink_extended_sys_state_message(0, state)
    return getattr(mavlink, f"MAVLink_{name.lower()}_message")(*_VALUES[name](place, boot_ms))


def _heartbeat(armed: bool, in_air: bool) -> Any:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
    state = mavlink.MAV_STATE_ACTIVE if in_air else mavlink.MAV_STATE_STANDBY
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, base, 3 if in_air else 0, state, 3
    )


def _position(place: Place, ms: int) -> tuple[int, ...]:
    heading = math.degrees(math.atan2(place.east_mps, place.north_mps)) % 360.0
    lat, lon, alt_mm = round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), round(place.alt_m * 1e3)
    velocity = round(place.north_mps * 100), round(place.east_mps * 100), 0
    return ms, lat, lon, alt_mm - 4000, alt_mm, *velocity, round(heading * 100)


def _gps(place: Place, ms: int) -> tuple[int, ...]:
    return ms * 1000, 6, round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), 26000, 62, 110, 980, 6800, 14


def _wave(ms: int, size: float) -> float:
    return size * math.sin(ms / 700.0)


def _pulses(ms: int, count: int, size: float) -> list[int]:
    return [1500 + round(_wave(ms, size)) for _ in range(count)]


#: message -> its values at a place and a time (ms since the start)
_VALUES: dict[str, Callable[[Place, int], tuple[Any, ...]]] = {
    "GLOBAL_POSITION_INT": _position,
    "ATTITUDE": lambda _, ms: (ms, _wave(ms, 0.1), _wave(ms, 0.12), 1.2, 0.01, _wave(ms, 0.02), 0.001),
    "LOCAL_POSITION_NED": lambda at, ms: (ms, _wave(ms, 90.0), 12.5, -at.alt_m, at.north_mps, at.east_mps, 0.02),
    "RAW_IMU": lambda _, ms: (ms * 1000, round(_wave(ms, 60)), -12, -998, 3, 7, round(_wave(ms, 9)), 220, -48, 391),
    "VFR_HUD": lambda at, ms: (9.8, 9.9 + _wave(ms, 0.2), 68, 47, at.alt_m, _wave(ms, 0.1)),
    "NAV_CONTROLLER_OUTPUT": lambda _, ms: (1.5, -0.4, 68, 69, 140 + ms % 60, 0.1, 0.0, _wave(ms, 0.3)),
    "MISSION_CURRENT": lambda _, ms: (3,),
    "SYS_STATUS": lambda _, ms: (1399979183, 1382153387, 1467087023, 210, 22650 - ms % 40, 1120, 87, *[0] * 6),
    "GPS_RAW_INT": _gps,
    "RC_CHANNELS": lambda _, ms: (ms, 16, *_pulses(ms, 16, 3), 65535, 65535, 200),
    "SERVO_OUTPUT_RAW": lambda _, ms: (ms * 1000 & 0xFFFFFFFF, 0, *_pulses(ms, 8, 60)),
    "BATTERY_STATUS": lambda _, ms: (0, 0, 0, 2150, [22650 - ms % 40] + [65535] * 9, 1120, 640, 530, 87),
    "SYSTEM_TIME": lambda _, ms: (int(time.time() * 1e6), ms),
    "VIBRATION": lambda _, ms: (ms * 1000, 0.02, 0.03, 0.04, 0, 0, 0),
}


#: system and component id of a program
Asker = tuple[int, int]


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
        answer = _ANSWERS.get(int.from_bytes(raw[7:10], "little"))
        if answer is None:
            return
        try:
            message = self._parser.decode(bytearray(raw))
        except mavlink.MAVError as error:
            raise BenchError(f"the companion wrote a frame that cannot be read: {error}") from None
        reply = answer(self, message, (message.get_srcSystem(), message.get_srcComponent()))
        if reply is not None:
            self._put(reply)

    def _on_tunnel(self, m: Any, _asker: Asker) -> None:
        if m.payload_type == LEASE_TUNNEL:
            self.commander = m.payload[2] or None
            self.in_transfer = m.payload[1] == 2
            self.on_lease(m.payload[1], int.from_bytes(m.payload[4:8], "little"))

    def _on_command(self, m: Any, asker: Asker) -> Any:
        return mavlink.MAVLink_command_ack_message(m.command, mavlink.MAV_RESULT_ACCEPTED, 0, 0, *asker)

    def _on_parameter(self, m: Any, _asker: Asker) -> Any:
        name = m.param_id
        if name not in self._cruise:
            return None
        self._cruise[name] = getattr(m, "param_value", self._cruise[name])
        value = self._cruise[name]
        return mavlink.MAVLink_param_value_message(name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32, 1, 0)

    def _on_list(self, m: Any, asker: Asker) -> Any:
        count = len(self._items.get(m.mission_type, []))
        return mavlink.MAVLink_mission_count_message(*asker, count, m.mission_type)

    def _on_request(self, m: Any, asker: Asker) -> Any:
        items = self._items.get(m.mission_type, [])
        if m.seq < len(items):
            values = [getattr(items[m.seq], name) for name in items[m.seq].fieldnames[2:]]
            return mavlink.MAVLink_mission_item_int_message(*asker, *values)
        return mavlink.MAVLink_mission_ack_message(*asker, mavlink.MAV_MISSION_INVALID_SEQUENCE, m.mission_type)

    def _on_count(self, m: Any, asker: Asker) -> Any:
        """An upload of so many items begins; a mission that is cleared has none."""
        self._items[m.mission_type] = []
        self._expected[m.mission_type] = getattr(m, "count", 0)
        return self._next_item(m, asker)

    def _on_item(self, m: Any, asker: Asker) -> Any:
        items = self._items.setdefault(m.mission_type, [])
        if m.seq == len(items):
            items.append(m)
        return self._next_item(m, asker)

    def _next_item(self, m: Any, asker: Asker) -> Any:
        have = len(self._items[m.mission_type])
        if have < self._expected.get(m.mission_type, 0):
            return mavlink.MAVLink_mission_request_int_message(*asker, have, m.mission_type)
        return mavlink.MAVLink_mission_ack_message(*asker, 0, m.mission_type)


#: what the autopilot answers, if the companion sends it
_ANSWERS: dict[int, Callable[[FakeAutopilot, Any, Asker], Any]] = {
    mavlink.MAVLINK_MSG_ID_TUNNEL: FakeAutopilot._on_tunnel,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: FakeAutopilot._on_command,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: FakeAutopilot._on_parameter,
    mavlink.MAVLINK_MSG_ID_PARAM_SET: FakeAutopilot._on_parameter,
    mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: FakeAutopilot._on_count,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: FakeAutopilot._on_list,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT: FakeAutopilot._on_request,
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT: FakeAutopilot._on_count,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT: FakeAutopilot._on_item,
}


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


# ---- aircraft that are moved ----------------------------------------------------------------------------------------


#: places, and the station that is to command there; None: the region between its neighbours
Stops = Sequence[tuple[Place, int | None]]
#: places in the delivery mission: zone of each station alone, and the region of both
SHUTTLE: Final[Stops] = ((Place(52.6790, 5.9240), A), (Place(52.6790, 5.9255), None), (Place(52.6790, 5.9310), B))


class Tour:
    """An aircraft that is moved up and down a row of places, so that transfers follow each other quickly.

    The row is a zone, the region to the next zone, that zone, and so on. The aircraft leaves a region when the lease
    names the next station; each entry into a region is one transfer.
    """

    def __init__(self, autopilot: FakeAutopilot, stops: Stops, pause_s: float, seed: int) -> None:
        """`pause_s`: between a commit and the next entry, about; a fifth more or less."""
        self.commits = 0
        #: the regions that were entered, as commander and partner
        self.asked: list[tuple[int | None, int | None]] = []
        #: regions in which authority went nowhere
        self.given_up = 0
        self._autopilot, self._stops, self._pause_s, self._luck = autopilot, stops, pause_s, Random(seed)
        self._at, self._step = 0, 1
        self._next_at = 0.0
        autopilot.place = stops[0][0]

    def begin(self, now: float) -> None:
        """In the air; where it stands, it stands for a while. Without this the first region is entered at once."""
        self._next_at = now + self._pause_s * self._luck.uniform(0.0, 1.0)

    def step(self, now: float) -> None:
        """To be called often, once the aircraft is in the air."""
        if self._stops[self._at][1] is None:
            self._in_region(now)
        elif now >= self._next_at:
            if not 0 <= self._at + self._step < len(self._stops):
                self._step = -self._step
            self._go(now, _GIVE_UP_S)

    def _in_region(self, now: float) -> None:
        follows = self._stops[self._at + self._step][1]
        if self._autopilot.commander == follows and not self._autopilot.in_transfer:
            self.commits += 1
        elif now < self._next_at:
            return
        else:
            self.given_up += 1
            self._step = -self._step
        self._go(now, self._pause_s * self._luck.uniform(0.8, 1.2))

    def _go(self, now: float, stay_s: float) -> None:
        before = self._stops[self._at][1]
        self._at += self._step
        place, owner = self._stops[self._at]
        if owner is None:
            self.asked.append((before, self._stops[self._at + self._step][1]))
        self._autopilot.place = place
        self._next_at = now + stay_s


class HostedVehicle:
    """An autopilot on a tour and the companion's module, in this process.

    There is no wire between them, but no call within a call either.
    """

    def __init__(self, loop: Loop, sysid: int, stops: Stops, pause_s: float, seed: int) -> None:
        self.autopilot = FakeAutopilot(loop, self._from_autopilot, stops[0][0], sysid)
        self.tour = Tour(self.autopilot, stops, pause_s, seed)
        #: it goes from place to place; not before it is in the air and the stations know it
        self.moves = False
        self._loop = loop
        self._parser = mavlink.MAVLink(None)
        self._waiting: list[bytes] = []
        master = SimpleNamespace(write=lambda data: self._waiting.append(bytes(data)))
        self._host = Host(loop, master, sysid, COMPANION_COMPID)
        self._timers: list[Timer] = []

    def load(self, config: Path) -> None:
        """Load the companion. Raises BenchError."""
        self.companion: Any = self._host.load(vehicle_module, str(config)).companion
        self._timers.append(self._loop.every(IDLE_S, self._idle))

    def _from_autopilot(self, raw: bytes) -> None:
        for message in self._parser.parse_buffer(raw) or []:
            self._host.deliver(message)
        self._to_autopilot()

    def _to_autopilot(self) -> None:
        waiting, self._waiting = self._waiting, []
        for raw in waiting:
            self.autopilot.receive(raw)

    def _idle(self) -> None:
        self._host.idle_if_due()
        self._to_autopilot()
        if self.moves:
            self.tour.step(time.monotonic())

    def faults(self) -> str:
        """The faults inside the companion; "" if none."""
        broken = self.companion.faults or self.companion.failed
        return f"faults inside the companion: {dict(self.companion.faults)}" if broken else ""

    def close(self) -> None:
        """Unload the module and end the streams."""
        for timer in self._timers:
            timer.cancel()
        self.autopilot.silence()
        self._host.unload()
