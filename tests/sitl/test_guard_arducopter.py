# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard in ArduCopter itself: its arming checks, modes, 32-bit Lua and message queue.

Needs an ArduCopter SITL program (`$ARDUCOPTER`, PATH, or ~/ardupilot/build/sitl/bin/arducopter). A companion of a few
lines sends leases on SERIAL1; a ground station wired straight to SERIAL2 plays the part that no gate controls.
Times are the autopilot's own (`time_boot_ms`).
"""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import DFReader
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.base import RunningVehicle, VehicleSpec, find_arducopter, launch

pytestmark = [
    pytest.mark.sitl,
    pytest.mark.skipif(
        find_arducopter() is None,
        reason="no ArduCopter SITL program: set $ARDUCOPTER or build one in ~/ardupilot (waf copter)",
    ),
]

ROOT = Path(__file__).parents[2]
GUARD = ROOT / "ardupilot_lua" / "handover_guard.lua"
PARAMETERS = ROOT / "ardupilot_lua" / "handover.parm"

HOME = (52.679, 5.924, 2.0, 0.0)
SPEEDUP = 8
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
        self.speedup = SPEEDUP
        self.sending = False
        self.heartbeats = True
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
            if self.heartbeats:
                self.station.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
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

    def real_time(self) -> None:
        """Leases come from the wall clock: the guard's times are only right at this pace."""
        self.set_parameter("SIM_SPEEDUP", 1)
        self.speedup = 1
        self.run(1)

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


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[Flight]:
    spec = VehicleSpec(home=HOME, speedup=SPEEDUP, scripts=(GUARD,), defaults=(PARAMETERS,))
    vehicle = launch("arducopter", spec, tmp_path)
    try:
        flight = Flight(vehicle)
        try:
            flight.until(lambda: flight.statuses, 30, "first status of the guard")
            yield flight
        finally:
            flight.close()
    finally:
        vehicle.stop()


def test_no_lease_no_arming_then_lease_allows_it(flight: Flight) -> None:
    assert flight.status[1] == WAITING
    assert flight.status[8:] == (4, 7)
    flight.run(60)  # everything else has long been ready
    assert flight.set_mode(GUIDED) == ACCEPTED
    assert flight.arm() == FAILED
    flight.until(lambda: flight.said("HNDO: no lease from companion"), 3, "text")

    assert flight.arm(FORCE) == ACCEPTED
    flight.until(lambda: flight.said("HNDO: no lease, disarmed"), 5, "disarm of a forced arming")
    flight.until(lambda: not flight.armed, 5, "disarmed")

    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 5, "lease live")
    assert flight.parameter("MAV_GCS_SYSID") == 251
    flight.until(lambda: flight.arm() == ACCEPTED, 10, "arming with a lease")
    flight.run(0.5)
    flight.sending = False
    flight.until(lambda: flight.said("HNDO: lease lost, disarmed"), 5, "disarm on the ground")
    assert flight.status[2] == 4


def test_lease_lost_in_guided_flight(flight: Flight) -> None:
    flight.take_off()
    flight.real_time()
    assert flight.status[4:7][0] == 0xF00DCAFE
    flight.sending = False
    lost_ms = flight.last_lease_ms
    flight.statuses.clear()
    acted_ms = flight.until(lambda: flight.is_state(EXPIRED) and flight.status[2] == 1, 5, "guard acts")
    assert 2800 <= acted_ms - lost_ms <= 3300
    flight.until(lambda: flight.mode == RTL, 2, "RTL")
    flight.until(lambda: flight.said("HNDO: lease lost, RTL"), 3, "text")

    # a station wired straight to the autopilot cannot leave RTL
    flight.statuses.clear()
    assert flight.set_mode(LOITER) == ACCEPTED
    flight.until(lambda: flight.said("mode change undone"), 2, "undone")
    flight.run(1.5)
    assert flight.mode == RTL

    # authority back: stays in RTL until somebody commands
    flight.sending = True
    flight.until(lambda: flight.said("HNDO: authority back, staying in RTL"), 3, "back")
    flight.run(3)
    assert flight.mode == RTL
    assert flight.set_mode(GUIDED) == ACCEPTED
    flight.run(3)
    assert flight.mode == GUIDED


def test_authority_lost_in_auto_then_landing_and_no_further_arming(flight: Flight, tmp_path: Path) -> None:
    upload_mission(flight)
    flight.arm_with_lease()
    assert flight.command(300, 0, 0) == ACCEPTED
    flight.until(lambda: flight.mode == AUTO and flight.altitude_m > 15, 60, "mission under way")
    flight.real_time()

    flight.lease["state"], flight.lease["commander"] = LOST, 0
    lost_ms = flight.until(lambda: flight.is_state(LOST_STATE), 2, "LOST")
    acted_ms = flight.until(lambda: flight.status[2] == 1, 3, "guard acts")
    assert 800 <= acted_ms - lost_ms <= 1300
    flight.until(lambda: flight.mode == RTL, 2, "RTL")
    flight.until(lambda: flight.said("HNDO: no authority, RTL"), 3, "text")

    flight.set_parameter("SIM_SPEEDUP", SPEEDUP)
    flight.speedup = SPEEDUP
    flight.until(lambda: not flight.armed, 200, "landed and disarmed")
    assert flight.mode == RTL
    assert flight.arm() == FAILED
    flight.until(lambda: flight.said("HNDO: no station has authority"), 3, "text")
    flight.close()
    assert log_has_guard_records(tmp_path)


def test_forged_leases_do_not_keep_it_alive(flight: Flight) -> None:
    flight.take_off()
    flight.real_time()
    recorded = flight.send_lease()
    flight.sending = False
    lost_ms = flight.last_lease_ms
    forger = Wire(flight.vehicle.address(0), 1, 191)
    try:
        rejected = flight.status[7]
        sequence = flight.sequence
        while flight.now_ms < lost_ms + 4000 and flight.mode != RTL:
            sequence += 1
            payload = struct.pack("<BBBBIIIHH", 1, HELD, 251, 0, 0xF00DCAFE, sequence & 0xFFFFFFFF, 1, 5000, 0)
            forger.send(tunnel(payload))  # right in everything but the wire it comes in on
            corrupted = bytearray(tunnel(payload).pack(flight.companion.mav))
            corrupted[-1] ^= 0xFF
            flight.companion.send_raw(bytes(corrupted))  # a known message with a wrong CRC reaches scripts
            flight.companion.send_raw(recorded)
            for _ in range(20):
                flight.pump()
        flight.until(lambda: flight.mode == RTL, 2, "RTL")
        assert flight.status[7] >= rejected + 15
    finally:
        forger.socket.close()


def test_guard_cannot_be_stopped_by_command_and_leaves_no_authorisation(flight: Flight) -> None:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    assert flight.command(42701, 2) == DENIED  # STOP
    flight.until(lambda: flight.said("HNDO: scripting command of 251/190 denied"), 3, "text")
    flight.statuses.clear()
    flight.run(3)
    assert len(flight.statuses) >= 4
    assert flight.status[3] & 8

    # SCR_ENABLE 0 does stop it: what it allowed once must not stay allowed
    flight.arm_with_lease()
    flight.set_parameter("SCR_ENABLE", 0)
    flight.until(lambda: flight.said("Scripting: stopped"), 5, "scripting stops")
    flight.until(lambda: flight.command(400, 0) == ACCEPTED and not flight.armed, 20, "disarmed")
    assert flight.arm() == FAILED
    flight.until(lambda: flight.said("HNDO: guard stopped while armed"), 3, "text")


def test_gcs_id_and_epoch_follow_the_commander(flight: Flight) -> None:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    flight.until(lambda: flight.sequence < 100 and flight.status[5] < 100, 20, "sequence wraps")
    assert flight.status[7] == 0
    flight.lease["commander"], flight.lease["epoch"] = 252, 2
    flight.until(lambda: flight.said("HNDO: lease live, 252 commands"), 3, "new commander")
    assert flight.parameter("MAV_GCS_SYSID") == 252
    flight.lease["nonce"], flight.lease["epoch"], flight.sequence = 0xFFFFFFFF, 0x80000001, 5
    flight.until(lambda: flight.status[4] == 0xFFFFFFFF, 3, "restarted companion, epoch beyond the sign bit")
    assert flight.status[6] == 0x80000001
    flight.lease["nonce"], flight.lease["epoch"] = 7, 0x80000000
    flight.run(2)
    assert flight.status[4] == 0xFFFFFFFF


def test_recommended_parameters_are_taken(flight: Flight) -> None:
    wanted = {"RALLY_LIMIT_KM": 0, "FS_GCS_ENABLE": 1, "FS_GCS_TIMEOUT": 10, "FS_OPTIONS": 8, "SCR_ENABLE": 1}
    assert {name: flight.parameter(name) for name in wanted} == wanted
    defaults = {"HNDO_ENABLE": 1, "HNDO_TIMEOUT": 3, "HNDO_LOST_T": 1, "HNDO_ACTION": 1, "HNDO_CHAN": 1}
    defaults |= {"HNDO_COMPID": 191, "HNDO_SYSID_SW": 1}
    assert {name: flight.parameter(name) for name in defaults} == defaults


def upload_mission(flight: Flight) -> None:
    """Take-off to 20 m, then a waypoint two kilometres to the north."""
    latitude, longitude = int(HOME[0] * 1e7), int(HOME[1] * 1e7)
    places = [(16, latitude, longitude, 0.0), (22, 0, 0, 20.0), (16, latitude + 180_000, longitude, 20.0)]
    flight.station.send(dialect.MAVLink_mission_count_message(1, 1, len(places), 0))
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
                        1, 1, message.seq, 3, command, 0, 1, 0, 0, 0, 0, lat, lon, alt, 0
                    )
                )
            elif message.get_type() == "MISSION_ACK":
                assert message.type == 0
                done = True


def log_has_guard_records(directory: Path) -> bool:
    for path in sorted((directory / "logs").glob("*.BIN")):
        log = DFReader.DFReader_binary(str(path))
        try:
            record = log.recv_match(type="HNDO")
            if record is not None:
                assert {"St", "Ac", "Fl", "Cmd", "LSt", "Ep", "Seq", "Age", "Rej"} <= set(record.get_fieldnames())
                return True
        finally:
            log.close()
    return False
