# SPDX-License-Identifier: GPL-3.0-or-later

"""An ArduCopter that flies with the guard, for tests: a companion of a few lines, a station, a pilot's transmitter.

The companion sends leases on SERIAL1; the station is wired straight to SERIAL2 and plays the part that no gate
controls. Times are the autopilot's own (`time_boot_ms`). Needs an ArduCopter SITL program.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pymavlink import DFReader
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles import RunningVehicle, VehicleSpec, launch

ROOT = Path(__file__).parents[2]
GUARD = ROOT / "ardupilot_lua" / "handover_guard.lua"
PARAMETERS = ROOT / "ardupilot_lua" / "handover.parm"

HOME = (52.679, 5.924, 2.0, 0.0)
SPEEDUP = 8
#: pace of what only has to be over
HURRY = 20
STABILIZE, AUTO, GUIDED, LOITER, RTL, LAND = 0, 3, 4, 5, 6, 9
HELD, LOST = 1, 3
WAITING, LIVE, EXPIRED, LOST_STATE = 1, 2, 3, 4
ACCEPTED, DENIED, FAILED = 0, 2, 4
FORCE = 21196.0


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
        self.socket.sendall(frame)
        self.socket.setblocking(False)

    def receive(self) -> list[Any]:
        try:
            data = self.socket.recv(65536)
        except BlockingIOError:
            return []
        if not data:
            raise AssertionError("the autopilot closed the connection")
        return [m for m in self.mav.parse_buffer(data) or [] if m.get_type() != "BAD_DATA"]


class Flight:
    """A flying ArduCopter with a companion and a station; everything happens in `pump`."""

    def __init__(self, vehicle: RunningVehicle) -> None:
        self.vehicle = vehicle
        self.companion = Wire(vehicle.address(1), 1, 191)
        self.station = Wire(vehicle.address(2), 251, 190)
        self.speedup: float = SPEEDUP
        self.sending = False
        #: stations on SERIAL2 that send heartbeats
        self.beating = {251}
        self.lease = {"state": HELD, "commander": 251, "nonce": 0xF00DCAFE, "epoch": 1, "ttl_ms": 5000}
        self.sequence = 0xFFFFFFF0  # wraps three seconds after the first lease
        self.now_ms = 0
        self.last_lease_ms = 0
        self.mode = -1
        self.armed = False
        self.altitude_m = 0.0
        self.texts: list[str] = []
        self.statuses: list[tuple[int, ...]] = []
        self.answers: list[Any] = []
        self._lease_due = self._heartbeat_due = 0.0

    def close(self) -> None:
        self.companion.socket.close()
        self.station.socket.close()
        self.vehicle.stop()

    # -------------------------------------------------------------- time

    def pump(self) -> None:
        """Send what is due, read what came."""
        now = time.monotonic()
        if self.sending and now >= self._lease_due:
            self._lease_due = now + 0.2 / self.speedup
            self.send_lease()
        if now >= self._heartbeat_due:
            self._heartbeat_due = now + 1.0 / self.speedup
            for system in sorted(self.beating):
                beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
                self.station.send_raw(bytes(beat.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=190))))
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
            assert message.payload_length == 20
            self.statuses.append(struct.unpack("<BBBBIIIHBB", bytes(message.payload[:20])))
        elif from_companion:
            return
        elif kind == "HEARTBEAT":
            self.mode, self.armed = message.custom_mode, bool(message.base_mode & 128)
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "GLOBAL_POSITION_INT":
            self.altitude_m = message.relative_alt / 1000
        else:
            self.answers.append(message)

    def until(self, condition: Callable[[], object], limit_s: float, what: str = "") -> int:
        """Pump until the condition holds, for `limit_s` of the autopilot's time at most. Returns its time."""
        start_ms, wall = self.now_ms, time.monotonic()
        while not condition():
            self.pump()
            spent = self.now_ms - start_ms
            if spent > limit_s * 1000 or time.monotonic() - wall > 20 + 3 * limit_s:
                raise AssertionError(
                    f"not within {limit_s} s: {what}; mode {self.mode}, armed {self.armed}, status "
                    f"{self.statuses[-1:]}, texts {self.texts[-12:]}"
                )
        return self.now_ms

    def run(self, duration_s: float) -> None:
        end_ms = self.now_ms + duration_s * 1000
        self.until(lambda: self.now_ms >= end_ms, duration_s + 5)

    def pace(self, speedup: float) -> None:
        """Simulated seconds per second. Leases come from the wall clock: the guard's times are right at 1 only, so
        anything faster has more patience, lest a hiccup of this computer be a loss."""
        slow = speedup == 1
        self.lease["ttl_ms"] = 5000 if slow else 60000
        self.set_parameter("HNDO_TIMEOUT", 3 if slow else 30)
        # nothing that was due by the old pace is late by the new one: the autopilot would miss its station
        self.speedup = max(self.speedup, speedup)
        self._lease_due = self._heartbeat_due = 0.0
        self.set_parameter("SIM_SPEEDUP", speedup)
        self.speedup = speedup
        self.run(1)

    def real_time(self) -> None:
        self.pace(1)

    # -------------------------------------------------------------- companion and station

    def send_lease(self) -> bytes:
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        value = self.lease
        payload = struct.pack(
            "<BBBBIIIHH",
            1,
            value["state"],
            value["commander"],
            0,
            value["nonce"],
            self.sequence,
            value["epoch"],
            value["ttl_ms"],
            0,
        )
        self.last_lease_ms = self.now_ms
        return self.companion.send(tunnel(payload))

    def restart_companion(self, nonce: int) -> None:
        """What a companion does that was killed: another nonce, numbers from 1, the next epoch."""
        self.lease["nonce"], self.sequence = nonce, 0
        self.lease["epoch"] += 1

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
        self.station.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
        self.run(0.3)

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
    return dialect.MAVLink_tunnel_message(1, 1, kind, 20, list(payload.ljust(128, b"\0")))


class Transmitter:
    """A pilot's radio control: what SITL flies as stick positions. `mode_pwm` is the flight mode switch, channel 5."""

    def __init__(self, vehicle: RunningVehicle) -> None:
        self._port = _rc_port(vehicle.pid)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, mode_pwm: int, throttle_pwm: int = 1500) -> None:
        sticks = [1500, 1500, throttle_pwm, 1500, mode_pwm, 1000, 1000, 1800, *[1000] * 8]
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


@contextmanager
def flying(directory: Path, *beside: Path, parameters: Mapping[str, float] | None = None) -> Iterator[Flight]:
    """ArduCopter with the guard, and its status heard; `beside`: files beside the script, a key or another script."""
    spec = VehicleSpec(
        home=HOME,
        speedup=SPEEDUP,
        scripts=(GUARD, *beside),
        defaults=(PARAMETERS,),
        parameters=parameters or {},
    )
    vehicle = launch("arducopter", spec, directory)
    try:
        flight = Flight(vehicle)
        try:
            flight.until(lambda: flight.statuses, 30, "first status of the guard")
            yield flight
        finally:
            flight.close()
    finally:
        vehicle.stop()


def upload_mission(flight: Flight) -> None:
    """Take-off to 20 m, then a waypoint two kilometres to the north."""
    latitude, longitude = int(HOME[0] * 1e7), int(HOME[1] * 1e7)
    upload(flight, [(16, latitude, longitude, 0.0), (22, 0, 0, 20.0), (16, latitude + 180_000, longitude, 20.0)], 0)


def upload(flight: Flight, places: list[tuple[int, int, int, float]], kind: int) -> None:
    """Items as (command, latitude, longitude, altitude); `kind` is the mission type, 0 mission, 2 rally points."""
    flight.answers.clear()
    flight.station.send(dialect.MAVLink_mission_count_message(1, 1, len(places), kind))
    answered = 0
    done = False
    start_ms = flight.now_ms
    while not done:
        flight.pump()
        assert flight.now_ms - start_ms < 60_000, "mission upload"
        for message in flight.answers[answered:]:
            answered += 1
            if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                command, lat, lon, alt = places[message.seq]
                flight.station.send(
                    dialect.MAVLink_mission_item_int_message(
                        1, 1, message.seq, 3, command, 0, 1, 0, 0, 0, 0, lat, lon, alt, kind
                    )
                )
            elif message.get_type() == "MISSION_ACK":
                assert message.type == 0
                done = True


def records(directory: Path, *kinds: str) -> list[Any]:
    """The records of these kinds in the flight's dataflash log, in order."""
    found = []
    for path in sorted((directory / "logs").glob("*.BIN")):
        log = DFReader.DFReader_binary(str(path))
        try:
            while (record := log.recv_match(type=list(kinds))) is not None:
                found.append(record)
        finally:
            log.close()
    return found


def guard_records(directory: Path) -> list[Any]:
    """The HNDO records of the flight's dataflash log, in order."""
    return records(directory, "HNDO")


def actions_logged(directory: Path) -> list[tuple[int, int, float]]:
    """Each time that the guard began to act: its state, the age of the lease then, and how long the state had lasted,
    both in milliseconds of the autopilot's own clock. The record is written in the very call that acts."""
    found = []
    before = since = None
    for record in guard_records(directory):
        if since is None or record.St != since.St:
            since = record
        if record.Ac and before is not None and not before.Ac:
            found.append((record.St, record.Age, (record.TimeUS - since.TimeUS) / 1000))
        before = record
    return found
