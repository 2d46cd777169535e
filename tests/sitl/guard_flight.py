# SPDX-License-Identifier: GPL-3.0-or-later

"""An ArduCopter that flies with the guard, for tests: a companion of a few lines, a station, a pilot's transmitter.

The companion sends leases on SERIAL1; the station is wired straight to SERIAL2 and plays the part that no gate
controls. Times are the autopilot's own (`time_boot_ms`): once the last lease is sent nothing that the guard does
depends on the wall clock, so that the rest of a flight may be flown at any pace. Needs an ArduCopter SITL program.
"""

from __future__ import annotations

import math
import os
import re
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles import RunningVehicle, VehicleSpec, launch
from tests.sitl.firmware import Firmware

ROOT = Path(__file__).parents[2]
GUARD = ROOT / "ardupilot_lua" / "handover_guard.lua"
PARAMETERS = ROOT / "ardupilot_lua" / "handover.parm"
PLANE_PARAMETERS = ROOT / "ardupilot_lua" / "handover_plane.parm"

HOME = (52.679, 5.924, 2.0, 0.0)
SPEEDUP = 8
#: pace of what only has to be over
HURRY = 20
#: FS_GCS_TIMEOUT of handover.parm, and one that no hiccup of this computer reaches (s of the autopilot)
GCS_TIMEOUT_S, GCS_PATIENCE_S = 10, 120
STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, CIRCLE, LAND, AUTOTUNE, BRAKE = 0, 2, 3, 4, 5, 6, 7, 9, 15, 17
AVOID_ADSB, SMART_RTL, AUTO_RTL = 19, 21, 27
HELD, LOST, ALONE = 1, 3, 5
WAITING, LIVE, EXPIRED, LOST_STATE = 1, 2, 3, 4
ACCEPTED, DENIED, FAILED = 0, 2, 4
#: MAV_MISSION_RESULT
ACCEPTED_MISSION, INVALID_SEQUENCE = 0, 13
FORCE = 21196.0
#: telemetry of the station's port, as firmware before 4.7 calls it; the base file has the newer names
_STREAMS = {"SR2_EXT_STAT": 2, "SR2_POSITION": 10, "SR2_EXTRA1": 4, "SR2_EXTRA2": 4, "SR2_EXTRA3": 2}
_HIT_GROUND = re.compile(r"SIM Hit ground at ([\d.]+) m/s")
#: metres in a degree of latitude
_DEGREE_M = 111_195.0


class Wire:
    """One TCP connection to the autopilot, with a parser and a packer of its own."""

    def __init__(self, address: str, system: int, component: int) -> None:
        _, host, port = address.split(":")
        self.socket = socket.create_connection((host, int(port)), timeout=10)
        self.socket.setblocking(False)
        self.mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True

    def send(self, message: Any) -> bytes:
        frame = bytes(message.pack(self.mav))
        self.send_raw(frame)
        return frame

    def send_raw(self, frame: bytes) -> None:
        self.socket.setblocking(True)
        try:
            self.socket.sendall(frame)
        except ConnectionError as error:
            raise AssertionError("the autopilot process is dead") from error
        self.socket.setblocking(False)

    def receive(self) -> list[Any]:
        try:
            data = self.socket.recv(65536)
        except BlockingIOError:
            return []
        except ConnectionError:
            data = b""
        if not data:
            raise AssertionError("the autopilot process is dead")
        return [m for m in self.mav.parse_buffer(data) or [] if m.get_type() != "BAD_DATA"]


class Flight:
    """A flying ArduCopter with a companion and a station; everything happens in `pump`."""

    #: the autopilot's time until its GCS failsafe
    GCS_TIMEOUT_NAME = "FS_GCS_TIMEOUT"

    def __init__(self, vehicle: RunningVehicle, firmware: Firmware, directory: Path, station_serial: int = 2) -> None:
        self.vehicle = vehicle
        self.firmware = firmware
        self.directory = directory
        self.companion = Wire(vehicle.address(1), 1, 191)
        self.station = Wire(vehicle.address(station_serial), 251, 190)
        self.speedup: float = SPEEDUP
        self.sending = False
        #: who holds the transmitter
        self.pilot: Any = None
        #: seconds until the next lease
        self.lease_gap_s: Callable[[], float] = lambda: 0.2
        #: what else is sent five times a second
        self.beside: Callable[[], object] = lambda: None
        #: stations on SERIAL2 that send heartbeats
        self.beating = {251}
        #: the companion sends heartbeats
        self.companion_beats = True
        self.lease = {"state": HELD, "commander": 251, "nonce": 0xF00DCAFE, "epoch": 1, "ttl_ms": 5000, "left_s": 0}
        self.sequence = 0xFFFFFFF0  # wraps three seconds after the first lease
        self.now_ms = 0
        self.last_lease_ms = 0
        self.mode = -1
        self.armed = False
        self.altitude_m = self.home_m = 0.0
        #: highest and lowest since somebody last set them
        self.highest_m = self.lowest_m = 0.0
        #: waypoint of the mission that is flown to
        self.waypoint = 0
        #: vertical speed at the last contact with the ground, as the simulation tells it
        self.touch_down_m_s = 0.0
        self.texts: list[str] = []
        self.statuses: list[tuple[int, ...]] = []
        self.answers: list[Any] = []
        #: latitude and longitude, 1e-7 degrees
        self.place = position(0)
        self._lease_due = self._heartbeat_due = self._beside_due = 0.0
        self._at_close: list[Callable[[], object]] = []

    def at_close(self, deed: Callable[[], object]) -> None:
        """What is in use as long as the flight lasts."""
        self._at_close.append(deed)

    def close(self) -> None:
        while self._at_close:
            self._at_close.pop()()
        self.companion.socket.close()
        self.station.socket.close()
        self.vehicle.stop()

    # -------------------------------------------------------------- time

    def pump(self) -> None:
        """Send what is due, read what came."""
        now = time.monotonic()
        if self.sending and now >= self._lease_due:
            self._lease_due = now + self.lease_gap_s() / self.speedup
            self.send_lease()
        if now >= self._beside_due:
            self._beside_due = now + 0.2 / self.speedup
            self.beside()
        if now >= self._heartbeat_due:
            self._heartbeat_due = now + 1.0 / self.speedup
            for system in sorted(self.beating):
                beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
                self.station.send_raw(bytes(beat.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=190))))
            if self.companion_beats:
                self.companion.send(dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        select.select([self.companion.socket, self.station.socket], [], [], 0.005)
        for wire in (self.companion, self.station):
            for message in wire.receive():
                self._read(message, wire is self.companion)

    def _read(self, message: Any, from_companion: bool) -> None:
        if message.get_srcSystem() != 1 or message.get_srcComponent() != 1:
            return
        kind = message.get_type()
        self.now_ms = max(self.now_ms, getattr(message, "time_boot_ms", 0))
        if kind == "TUNNEL" and from_companion and message.payload_type == 47117:
            assert message.payload_length in (24, 32)
            self.statuses.append(struct.unpack("<BBBBIIIHBBI", bytes(message.payload[:24])))
        elif from_companion:
            return
        elif kind == "HEARTBEAT":
            self.mode, self.armed = message.custom_mode, bool(message.base_mode & 128)
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
            if hit := _HIT_GROUND.search(message.text):
                self.touch_down_m_s = float(hit[1])
        elif kind == "GLOBAL_POSITION_INT":
            self._fly_past(message)
        elif kind == "MISSION_CURRENT":
            self.waypoint = message.seq
        else:
            self.answers.append(message)

    def _fly_past(self, position: Any) -> None:
        self.place = position.lat, position.lon
        self.altitude_m = position.relative_alt / 1000
        self.highest_m = max(self.highest_m, self.altitude_m)
        self.lowest_m = min(self.lowest_m, self.altitude_m)
        north_m = (position.lat / 1e7 - HOME[0]) * _DEGREE_M
        east_m = (position.lon / 1e7 - HOME[1]) * _DEGREE_M * math.cos(math.radians(HOME[0]))
        self.home_m = math.hypot(north_m, east_m)

    def mark_altitude(self) -> float:
        """From here on `highest_m` and `lowest_m` count. Returns the altitude."""
        self.highest_m = self.lowest_m = self.altitude_m
        return self.altitude_m

    def until(self, condition: Callable[[], object], limit_s: float, what: str = "") -> int:
        """Pump until the condition holds, for `limit_s` of the autopilot's time at most. Returns its time."""
        start_ms, wall = self.now_ms, time.monotonic()
        while not condition():  # asked first: after a hiccup of this computer much comes in at once
            spent = self.now_ms - start_ms
            if spent > limit_s * 1000 or time.monotonic() - wall > 20 + 3 * limit_s:
                raise AssertionError(
                    f"not within {limit_s} s: {what}; mode {self.mode}, armed {self.armed}, status "
                    f"{self.statuses[-1:]}, texts {self.texts[-12:]}"
                )
            self.pump()
        return self.now_ms

    def run(self, duration_s: float) -> None:
        end_ms = self.now_ms + duration_s * 1000
        self.until(lambda: self.now_ms >= end_ms, duration_s + 5)

    def pace(self, speedup: float) -> None:
        """Simulated seconds per second. Leases come from the wall clock: the guard's times are right at 1 only, so
        anything faster has more patience, lest a hiccup of this computer be a loss. The same with the station's
        heartbeats and the autopilot's GCS failsafe, whose ten seconds are half a second of ours at `HURRY`."""
        slow = speedup == 1
        if not slow and self.beating:
            self.set_parameter(self.GCS_TIMEOUT_NAME, GCS_PATIENCE_S)
        self.lease["ttl_ms"] = 5000 if slow else 60000
        self.set_parameter("HNDO_TIMEOUT", 3 if slow else 30)
        # nothing that was due by the old pace is late by the new one: the autopilot would miss its station
        self.speedup = max(self.speedup, speedup)
        self._lease_due = self._heartbeat_due = 0.0
        self.set_parameter("SIM_SPEEDUP", speedup)
        self.speedup = speedup
        if slow:
            self.watch_the_station()
        self.run(1)

    def real_time(self) -> None:
        self.pace(1)

    def hurry(self) -> None:
        """The rest of a flight: the guard has acted, and the way home is only to be flown to its end. In RTL's descent
        the GCS failsafe would change over to LAND (FS_OPTIONS 8): see `pace` for the heartbeats."""
        if self.beating:
            self.set_parameter(self.GCS_TIMEOUT_NAME, GCS_PATIENCE_S)
        self.speedup = HURRY
        self.set_parameter("SIM_SPEEDUP", HURRY)

    def cut(self) -> None:
        """No lease from now on; the station's heartbeats go on. The guard's time-out is the recommended one again."""
        self.set_parameter("SIM_SPEEDUP", SPEEDUP)
        self.speedup = SPEEDUP
        self.set_parameter("HNDO_TIMEOUT", 3)
        self.run(0.2)
        self.sending = False

    def companion_dies(self) -> None:
        """The computer that sent the leases passed on the commander's heartbeats as well."""
        self.cut()
        self.watch_the_station()
        self.beating.clear()

    def watch_the_station(self) -> None:
        """The autopilot's GCS failsafe is the recommended one: somebody is about to fall silent."""
        self.set_parameter(self.GCS_TIMEOUT_NAME, GCS_TIMEOUT_S)

    # -------------------------------------------------------------- companion and station

    def meet_the_guard(self) -> None:
        """It answers where it has heard something; a private payload of nobody is enough, and no lease."""
        self.beside = lambda: self.companion.send(tunnel(b"", 0))
        self.until(lambda: self.statuses, 30, "first status of the guard")
        self.beside = lambda: None

    def send_lease(self) -> bytes:
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        value = self.lease
        payload = struct.pack(
            "<BBBBIIIHHI",
            2,
            value["state"],
            value["commander"],
            0,
            value["nonce"],
            self.sequence,
            value["epoch"],
            value["ttl_ms"],
            value["left_s"],
            self.guard_nonce,
        )
        self.last_lease_ms = self.now_ms
        return self.companion.send(tunnel(payload))

    def restart_companion(self, nonce: int) -> None:
        """What a companion does that was killed: another nonce, numbers from 1, the next epoch."""
        self.lease["nonce"], self.sequence = nonce, 0
        self.lease["epoch"] += 1

    @property
    def guard_nonce(self) -> int:
        """As the guard tells it in its status; 0: not heard yet."""
        return self.statuses[-1][10] if self.statuses else 0

    @property
    def status(self) -> tuple[int, ...]:
        return self.statuses[-1]

    def is_state(self, state: int) -> bool:
        return bool(self.statuses) and self.status[1] == state

    def command(self, command: int, *parameters: float, wait: bool = True) -> int | None:
        """COMMAND_LONG of the station. Returns the result, None when nobody answers."""
        values = list(parameters) + [0.0] * (7 - len(parameters))
        self.answers.clear()
        self.station.send(dialect.MAVLink_command_long_message(1, 1, command, 0, *values))
        end_ms = self.now_ms + 3000
        while self.now_ms < end_ms:
            self.pump()
            for message in self.answers:
                if message.get_type() == "COMMAND_ACK" and message.command == command:
                    return int(message.result)
        return None

    def set_mode(self, mode: int) -> int | None:
        return self.command(176, 1, mode)

    def set_parameter(self, name: str, value: float) -> None:
        """Once more if the autopilot does not answer; one that it does not have it never answers."""
        for _ in range(3):
            self.answers.clear()
            self.station.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
            self.run(0.3)
            if any(told.get_type() == "PARAM_VALUE" and told.param_id == name for told in self.answers):
                return

    def parameter(self, name: str) -> float | None:
        self.answers.clear()
        for _ in range(5):
            self.station.send(dialect.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
            end_ms = self.now_ms + 1000
            while self.now_ms < end_ms:
                self.pump()
                for message in self.answers:
                    if message.get_type() == "PARAM_VALUE" and message.param_id == name:
                        return float(message.param_value)
        return None

    def arm(self, force: float = 0.0) -> int | None:
        return self.command(400, 1, force)

    def said(self, part: str) -> bool:
        return any(part in text for text in self.texts)

    def arm_with_lease(self) -> None:
        """With a live lease, arm in GUIDED as soon as the autopilot can.

        It goes back to its first mode once, when its radio control input has come up.
        """
        self.sending = True
        self.until(lambda: self.is_state(LIVE), 90, "lease live")
        self.pace(HURRY)
        self.until(self._arm_in_guided, 120, "arming in GUIDED")

    def _arm_in_guided(self) -> bool:
        if self.mode != GUIDED:
            self.set_mode(GUIDED)
            self.run(1.2)
        return self.mode == GUIDED and self.arm() == ACCEPTED

    def take_off(self) -> None:
        """Armed in GUIDED, climb to 20 m."""
        self.arm_with_lease()
        self.until(lambda: self.command(22, 0, 0, 0, 0, 0, 0, 20) == ACCEPTED, 5, "take-off, motors turning")
        self.until(lambda: self.altitude_m > 15, 60, "climb")


def tunnel(payload: bytes, kind: int = 47116) -> Any:
    return dialect.MAVLink_tunnel_message(1, 1, kind, 24, list(payload.ljust(128, b"\0")))


class Transmitter:
    """A pilot's radio control: what SITL flies as stick positions. `mode_pwm` is the flight mode switch, channel 5."""

    def __init__(self, vehicle: RunningVehicle) -> None:
        self._port = _rc_port(vehicle.pid)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, mode_pwm: int, throttle_pwm: int = 1500, rudder_pwm: int = 1500, seventh_pwm: int = 1000) -> None:
        sticks = [1500, 1500, throttle_pwm, rudder_pwm, mode_pwm, 1000, seventh_pwm, 1800, *[1000] * 8]
        self._socket.sendto(struct.pack("<16H", *sticks), ("127.0.0.1", self._port))

    def close(self) -> None:
        self._socket.close()


def _rc_port(pid: int) -> int:
    """The program was given port 0, so the kernel has chosen one: its only UDP socket on every interface."""
    links = [os.readlink(entry) for entry in Path(f"/proc/{pid}/fd").iterdir()]
    own = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    ports = [int(row[1].partition(":")[2], 16) for row in rows if row[9] in own and row[1].startswith("00000000:")]
    assert len(ports) == 1, ports
    return ports[0]


_Flight = TypeVar("_Flight", bound=Flight)


@contextmanager
def flying(
    firmware: Firmware,
    directory: Path,
    *beside: Path,
    parameters: Mapping[str, float] | None = None,
    station_serial: int = 2,
) -> Iterator[Flight]:
    """ArduCopter with the guard, and its status heard; `beside`: files beside the script, a key or another script.

    A station on SERIAL0 means that no other port speaks MAVLink: nobody hears a status then.
    """
    with launched(
        Flight, firmware, directory, *beside, parameters=parameters or {}, station_serial=station_serial
    ) as flight:
        yield flight


@contextmanager
def launched(
    flight_of: type[_Flight],
    firmware: Firmware,
    directory: Path,
    *beside: Path,
    parameters: Mapping[str, float],
    recommended: Path = PARAMETERS,
    model: str = "quad",
    station_serial: int = 2,
) -> Iterator[_Flight]:
    """Any vehicle with the guard, see `flying`; `recommended` is the parameter file that ships for it."""
    spec = VehicleSpec(
        home=HOME,
        speedup=SPEEDUP,
        scripts=(GUARD, *beside),
        defaults=(recommended,),
        parameters={**_STREAMS, **parameters},
        arducopter=str(firmware.program),
        model=model,
    )
    vehicle = launch("arducopter", spec, directory)
    try:
        flight = flight_of(vehicle, firmware, directory, station_serial)
        try:
            if station_serial:
                flight.meet_the_guard()
            yield flight
        except BaseException:
            print(f"the texts of {directory}:", *flight.texts, sep="\n")  # pytest shows them with the failure
            raise
        finally:
            flight.close()
    finally:
        vehicle.stop()


#: a place of a mission: command, metres to the north of home, altitude (m), and what else the command takes
Item = tuple[int, float, float, tuple[float, ...]]
WAYPOINT, RETURN, LANDING, TAKE_OFF, JUMP, LAND_START, RALLY_POINT = 16, 20, 21, 22, 177, 189, 5100


def item(command: int, north_m: float = 0.0, altitude_m: float = 0.0, *values: float) -> Item:
    return command, north_m, altitude_m, values


def upload_mission(flight: Flight, *items: Item) -> None:
    """Take-off to 20 m, then the items; without any a waypoint two kilometres to the north."""
    upload(flight, [item(WAYPOINT), item(TAKE_OFF, 0, 20), *(items or [item(WAYPOINT, 2000, 20)])], 0)


def upload(flight: Flight, items: list[Item], kind: int) -> None:
    """`kind` is the mission type, 0 mission, 2 rally points."""
    flight.answers.clear()
    flight.station.send(dialect.MAVLink_mission_count_message(1, 1, len(items), kind))
    answered = 0
    done = False
    start_ms = flight.now_ms
    while not done:
        flight.pump()
        assert flight.now_ms - start_ms < 60_000, "mission upload"
        for message in flight.answers[answered:]:
            answered += 1
            if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                flight.station.send(_mission_item(message.seq, items[message.seq], kind))
            elif message.get_type() == "MISSION_ACK":
                # an item that was asked for twice comes twice: out of sequence, and the upload goes on
                assert message.type in (ACCEPTED_MISSION, INVALID_SEQUENCE), f"mission refused, {message.type}"
                done = message.type == ACCEPTED_MISSION


def _mission_item(number: int, what: Item, kind: int) -> Any:
    command, north_m, altitude_m, values = what
    four = (*values, 0.0, 0.0, 0.0, 0.0)[:4]
    place = (0, 0) if command in (RETURN, JUMP, TAKE_OFF) else position(north_m)
    return dialect.MAVLink_mission_item_int_message(1, 1, number, 3, command, 0, 1, *four, *place, altitude_m, kind)


def position(north_m: float) -> tuple[int, int]:
    """Latitude and longitude, in 1e-7 degrees, of a place to the north of home."""
    return int((HOME[0] + north_m / _DEGREE_M) * 1e7), int(HOME[1] * 1e7)


def target(north_m: float, altitude_m: float) -> Any:
    """A guided target, as a companion sends it."""
    return dialect.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0x0DF8, *position(north_m), altitude_m, 0, 0, 0, 0, 0, 0, 0, 0
    )
