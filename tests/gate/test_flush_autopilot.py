# SPDX-License-Identifier: GPL-3.0-or-later

"""The flush against autopilots: the frames that it makes do there what `gate/flush.py` says they do.

ArduCopter proves the facts, the embedded vehicle that it has the same ones (it has no files and no sticks). One
connection plays the companion: it passes on what stations send, and what the flush makes, as raw frames.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.gate.judge import Fate, StationIdentity, judge
from mavproxy_handover.wire.frames import FrameSplitter, parse_one
from sitl.vehicles import VehicleSpec, find_arducopter, launch
from tests.gate.frames import ftp_request

VEHICLE, GCSA, GCSB = 1, 251, 252
COMPONENT = 190
A = StationIdentity(GCSA)
#: on the ground: in flight uploads end at the companion
COMMANDED_BY_A = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD, armed=False)
HOME = (52.679, 5.924, 2.0, 0.0)
SPEEDUP = 8
GUIDED = 4
ACCEPTED, NO_SPACE, DENIED = 0, 4, 14
ONLY_VELOCITY = 0b110111000111
CREATE, WRITE, TERMINATE = 6, 7, 1
VIBRATION = 241

VEHICLES = [
    pytest.param(
        "arducopter",
        marks=[
            pytest.mark.sitl,
            pytest.mark.skipif(
                find_arducopter() is None,
                reason="no ArduCopter SITL program: set $ARDUCOPTER or build one in ~/ardupilot (waf copter)",
            ),
        ],
    ),
    pytest.param("builtin", marks=pytest.mark.process),
]
ARDUCOPTER = VEHICLES[:1]


class Companion:
    """Two stations behind the gate's flush, on one wire to an autopilot."""

    def __init__(self, address: str) -> None:
        _, host, port = address.split(":")
        self.socket = socket.create_connection((host, int(port)), timeout=10)
        self.socket.settimeout(0.01)
        self.splitter = FrameSplitter()
        self.tracker = FlushTracker(VEHICLE)
        self.messages: list[Any] = []
        self.beat_due = 0.0

    def send(self, message: Any, station: int = GCSA) -> None:
        """`station` sends, and the gate lets it through; what GCSA sends, as commander, is tracked."""
        raw = message.pack(mavlink.MAVLink(None, srcSystem=station, srcComponent=COMPONENT))
        if station == GCSA:
            frame = parse_one(bytes(raw))
            assert frame is not None
            verdict = judge(frame, A, COMMANDED_BY_A, VEHICLE)
            if verdict.fate is Fate.CONSUME:  # it takes off, which is the companion's matter
                verdict = verdict._replace(fate=Fate.FORWARD)
            assert verdict.fate is Fate.FORWARD
            self.tracker.saw(frame, verdict, GCSA)
        self.socket.sendall(raw)

    def flush(self) -> list[str]:
        closings = self.tracker.flush(GCSA)
        for closing in closings:
            for raw in closing.frames:
                self.socket.sendall(raw)
        return [closing.what for closing in closings]

    def pump(self) -> None:
        if time.monotonic() >= self.beat_due:
            self.beat_due = time.monotonic() + 1.0 / SPEEDUP
            self.socket.sendall(
                mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, GCSA, 190))
            )
        try:
            data = self.socket.recv(65536)
        except TimeoutError:
            return
        assert data, "the autopilot closed the connection"
        for frame in self.splitter.feed(data):
            if (frame.sysid, frame.compid) == (VEHICLE, 1):
                self.tracker.note_reply(frame)
                self.messages.append(mavlink.MAVLink(None).decode(bytearray(frame.raw)))

    def wait(self, kind: str, condition: Callable[[Any], bool] = lambda m: True, timeout_s: float = 15.0) -> Any:
        """The next message of a kind (wall clock)."""
        deadline = time.monotonic() + timeout_s
        self.messages.clear()
        while time.monotonic() < deadline:
            self.pump()
            for message in self.messages:
                if message.get_type() == kind and condition(message):
                    return message
            self.messages.clear()
        raise AssertionError(f"no such {kind} within {timeout_s} s")

    def count(self, kind: int, count: int, station: int = GCSA) -> Any:
        """Begin an upload; what the autopilot says: the request for an item, or MISSION_ACK."""
        self.send(mavlink.MAVLink_mission_count_message(VEHICLE, 1, count, kind), station)
        deadline = time.monotonic() + 10
        self.messages.clear()
        while time.monotonic() < deadline:
            self.pump()
            for message in self.messages:
                if message.get_type() in ("MISSION_ACK", "MISSION_REQUEST", "MISSION_REQUEST_INT") and (
                    message.target_system == station
                ):
                    return message
        raise AssertionError("no answer to MISSION_COUNT")

    def item(self, kind: int, number: int, station: int = GCSA) -> None:
        self.send(_item(kind, number), station)

    def upload(self, kind: int, count: int, station: int) -> None:
        answer = self.count(kind, count, station)
        assert answer.get_type() != "MISSION_ACK", answer
        for number in range(count):
            self.item(kind, number, station)
            if number < count - 1:
                self.wait("MISSION_REQUEST", lambda m, n=number: m.seq == n + 1)  # type: ignore[misc]
        assert self.wait("MISSION_ACK").type == ACCEPTED

    def stored(self, kind: int) -> list[int]:
        """The latitudes (degE7) that the autopilot has, home left out."""
        self.send(mavlink.MAVLink_mission_request_list_message(VEHICLE, 1, kind), GCSB)
        count = self.wait("MISSION_COUNT", lambda m: m.mission_type == kind).count
        latitudes = []
        for number in range(1 if kind == 0 else 0, count):
            self.send(mavlink.MAVLink_mission_request_int_message(VEHICLE, 1, number, kind), GCSB)
            latitudes.append(self.wait("MISSION_ITEM_INT", lambda m, n=number: m.seq == n).x)  # type: ignore[misc]
        return latitudes

    def ftp(self, opcode: int, data: bytes, sequence: int, offset: int = 0) -> Any:
        payload = ftp_request(opcode, data, session=0, sequence=sequence)
        payload[8:12] = offset.to_bytes(4, "little")
        self.send(mavlink.MAVLink_file_transfer_protocol_message(0, VEHICLE, 1, payload))
        return self.wait("FILE_TRANSFER_PROTOCOL", lambda m: m.payload[5] == opcode).payload

    def command(self, command: int, *parameters: float) -> int:
        values = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(VEHICLE, 1, command, 0, *values))
        return int(self.wait("COMMAND_ACK", lambda m: m.command == command).result)

    def interval_us(self, msgid: int) -> int:
        values = [510, 0, msgid, *[0.0] * 6]
        self.send(mavlink.MAVLink_command_long_message(VEHICLE, 1, *values))
        return int(self.wait("MESSAGE_INTERVAL", lambda m: m.message_id == msgid).interval_us)

    def parameter(self, name: str) -> float:
        self.send(mavlink.MAVLink_param_request_read_message(VEHICLE, 1, name.encode(), -1))
        return float(self.wait("PARAM_VALUE", lambda m: m.param_id == name).param_value)


def _item(kind: int, number: int, shift: int = 0) -> Any:
    """Item `number`; its latitude is 52.6 degrees and its number in 1e-4 degrees, `shift` on top."""
    command = {0: 16, 1: 5001, 2: 5100}[kind]
    latitude = 526_000_000 + 1000 * number + shift
    vertices = 3.0 if kind == 1 else 0.0
    return mavlink.MAVLink_mission_item_int_message(
        VEHICLE, 1, number, 3, command, 0, 1, vertices, 0, 0, 0, latitude, 59_240_000 + 1000 * number * number, 30, kind
    )


@pytest.fixture(scope="module")
def companion(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Companion]:
    """One vehicle of a kind for all tests: each leaves nothing open."""
    folder = tmp_path_factory.mktemp(request.param)
    parameters = {"MAV_GCS_SYSID": float(GCSA)}
    vehicle = launch(request.param, VehicleSpec(home=HOME, speedup=SPEEDUP, parameters=parameters), folder)
    companion = Companion(vehicle.companion_master)
    try:
        companion.wait("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_STANDBY)
        for msgid in (33, 32, 65):  # position, local position, sticks
            companion.command(511, msgid, 100_000)
        companion.tracker.flush(GCSA)  # these rates stay for all tests
        yield companion
    finally:
        companion.socket.close()
        vehicle.stop()


@pytest.mark.parametrize("companion", VEHICLES, indirect=True)
@pytest.mark.parametrize(("kind", "kept"), [(0, 2), (1, 3)], ids=["mission", "fence"])
def test_an_unfinished_upload_no_longer_blocks_the_new_commander(companion: Companion, kind: int, kept: int) -> None:
    companion.upload(kind, 3, GCSA)
    before = companion.stored(kind)
    companion.count(kind, 3)
    companion.item(kind, 0)
    denied = companion.count(kind, 3, GCSB)
    assert (denied.get_type(), denied.type) == ("MISSION_ACK", DENIED)

    assert len(companion.flush()) == 1
    assert companion.wait("MISSION_ACK", lambda m: m.target_system == GCSA).type == NO_SPACE
    assert companion.stored(kind) == before, "the count that ended the upload changed what is stored"
    assert len(before) == kept
    companion.upload(kind, 3, GCSB)
    assert companion.flush() == []


@pytest.mark.parametrize("companion", ARDUCOPTER, indirect=True)
def test_an_upload_goes_on_while_its_sender_is_denied_a_download(companion: Companion) -> None:
    companion.upload(0, 3, GCSA)
    companion.count(0, 3)
    companion.send(mavlink.MAVLink_mission_request_list_message(VEHICLE, 1, 0))
    assert companion.wait("MISSION_ACK", lambda m: m.target_system == GCSA).type == DENIED
    assert companion.count(0, 3, GCSB).type == DENIED, "it goes on"
    assert companion.flush() == ["unfinished mission upload ended"]
    companion.upload(0, 3, GCSB)


@pytest.mark.parametrize("companion", VEHICLES, indirect=True)
def test_a_finished_upload_leaves_nothing_to_flush(companion: Companion) -> None:
    companion.upload(0, 3, GCSA)
    assert companion.flush() == []


def mission_file(items: int) -> bytes:
    header = b"".join(value.to_bytes(2, "little") for value in (0x763D, 0, 0, 0, items))
    packed = [_item(0, number, shift=7).pack(mavlink.MAVLink(None))[10:-2].ljust(38, b"\0") for number in range(items)]
    return header + b"".join(packed)


@pytest.mark.parametrize("companion", ARDUCOPTER, indirect=True)
@pytest.mark.parametrize("spoiled", [True, False])
def test_an_unfinished_file_of_a_mission_is_thrown_away_and_not_applied(companion: Companion, spoiled: bool) -> None:
    """All but the last 20 bytes are there: the last item is half, and closing applies a file with half an item."""
    companion.upload(0, 3, GCSA)
    before = companion.stored(0)
    contents = mission_file(4)
    assert companion.ftp(CREATE, b"@MISSION/mission.dat", 1)[3] == 128
    assert companion.ftp(WRITE, contents[:-20], 2)[3] == 128
    if spoiled:
        assert companion.flush() == ["file '@MISSION/mission.dat' closed, contents thrown away"]
        companion.wait("FILE_TRANSFER_PROTOCOL", lambda m: m.payload[5] == TERMINATE)
        assert companion.stored(0) == before
    else:  # what a flush without the spoiling would do
        companion.ftp(TERMINATE, b"", 3)
        assert companion.stored(0) != before


def parameter_file(name: bytes, value: float) -> bytes:
    packed = bytes([4, (len(name) - 1) << 4]) + name + struct.pack("<f", value)
    return struct.pack("<HHH", 0x671B, 1, 6 + len(packed)) + packed


@pytest.mark.parametrize("companion", ARDUCOPTER, indirect=True)
@pytest.mark.parametrize("closed_by", ["flush", "arming", "station"])
def test_a_file_of_parameters_that_is_open_is_thrown_away(companion: Companion, closed_by: str) -> None:
    speed = {"flush": 321.0, "arming": 322.0, "station": 323.0}[closed_by]
    assert companion.ftp(CREATE, b"@PARAM/param.pck", 1)[3] == 128
    assert companion.ftp(WRITE, parameter_file(b"WPNAV_SPEED", speed), 2)[3] == 128
    if closed_by == "station":
        companion.ftp(TERMINATE, b"", 3)
        assert companion.parameter("WPNAV_SPEED") == speed
        return
    closings = companion.tracker.arming() if closed_by == "arming" else companion.tracker.flush(GCSA)
    assert [closing.what for closing in closings] == ["file '@PARAM/param.pck' closed, contents thrown away"]
    for raw in closings[0].frames:
        companion.socket.sendall(raw)
    companion.wait("FILE_TRANSFER_PROTOCOL", lambda m: m.payload[5] == TERMINATE)
    assert companion.parameter("WPNAV_SPEED") != speed


@pytest.mark.parametrize("companion", ARDUCOPTER, indirect=True)
def test_a_second_file_is_refused_and_the_first_one_thrown_away(companion: Companion) -> None:
    assert companion.ftp(CREATE, b"@PARAM/param.pck", 1)[3] == 128
    assert companion.ftp(WRITE, parameter_file(b"WPNAV_SPEED", 324.0), 2)[3] == 128
    assert companion.ftp(CREATE, b"x", 3)[3] == 129
    (closing,) = companion.tracker.arming()
    for raw in closing.frames:
        companion.socket.sendall(raw)
    companion.wait("FILE_TRANSFER_PROTOCOL", lambda m: m.payload[5] == TERMINATE)
    assert companion.parameter("WPNAV_SPEED") != 324.0


@pytest.mark.parametrize("companion", ARDUCOPTER, indirect=True)
@pytest.mark.parametrize("name", ["RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"])
def test_sticks_are_released(companion: Companion, name: str) -> None:
    idle = companion.wait("RC_CHANNELS").chan1_raw
    override = [1777] + [65535] * 17
    sticks = (
        mavlink.MAVLink_rc_channels_override_message(VEHICLE, 1, *override)
        if name == "RC_CHANNELS_OVERRIDE"
        else mavlink.MAVLink_manual_control_message(VEHICLE, 0, 600, 500, 0, 0)
    )
    companion.send(sticks)
    companion.wait("RC_CHANNELS", lambda m: m.chan1_raw > 1700)
    assert companion.flush() == ["RC override released"]
    start = companion.wait("RC_CHANNELS").time_boot_ms
    back = companion.wait("RC_CHANNELS", lambda m: m.chan1_raw == idle)
    assert back.time_boot_ms - start < 1000, "released only by the autopilot's own time-out of 3 s"


@pytest.mark.parametrize("companion", VEHICLES, indirect=True)
def test_a_streamed_velocity_is_stopped_at_once(companion: Companion) -> None:
    _fly(companion)
    velocity = [0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0]
    stream = mavlink.MAVLink_set_position_target_global_int_message(0, VEHICLE, 1, 3, ONLY_VELOCITY, *velocity)
    deadline = time.monotonic() + 30
    while True:
        companion.send(stream)
        moving = companion.wait("GLOBAL_POSITION_INT")
        if moving.vx > 600:
            break
        assert time.monotonic() < deadline, "the aircraft does not follow the stream"
    assert companion.flush() == ["guided stream stopped"]
    start = companion.wait("GLOBAL_POSITION_INT").time_boot_ms
    slower = companion.wait("GLOBAL_POSITION_INT", lambda m: m.time_boot_ms > start + 2500)
    assert slower.vx < 500, "it flies on as the former commander said, until GUID_TIMEOUT"


def _fly(companion: Companion) -> None:
    deadline = time.monotonic() + 60
    while not (companion.command(176, 1, GUIDED) == ACCEPTED and companion.command(400, 1) == ACCEPTED):
        assert time.monotonic() < deadline, "it does not arm"
        companion.wait("HEARTBEAT")
    while companion.command(22, 0, 0, 0, 0, 0, 0, 10) != ACCEPTED:
        assert time.monotonic() < deadline, "it does not take off"
        companion.wait("HEARTBEAT")
    companion.wait("GLOBAL_POSITION_INT", lambda m: m.relative_alt > 9000, 30)


@pytest.mark.parametrize("companion", VEHICLES, indirect=True)
def test_the_rate_of_a_message_is_the_default_again(companion: Companion) -> None:
    before = companion.interval_us(VIBRATION)
    assert before != 100_000
    assert companion.command(511, VIBRATION, 100_000) == ACCEPTED
    assert companion.interval_us(VIBRATION) == 100_000
    assert companion.flush() == ["default message rates restored: VIBRATION"]
    assert companion.interval_us(VIBRATION) == before
