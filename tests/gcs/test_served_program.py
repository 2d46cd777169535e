# SPDX-License-Identifier: GPL-3.0-or-later

"""A program that flies through a station: whose frames go where, with which system ids, and when it counts as lost."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.served_ids import Kind, Program, for_program, kind_of
from gcs_module.served_program import MOST_BEATS, MOST_FRAMES, MUTE_S, SILENT_S, Change, ServedProgram
from mavproxy_handover.config.served import parse_served
from mavproxy_handover.link.forms import LinkError
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.ids import OUR_MESSAGES, PROBE_COMPID

STATION, VEHICLE, PROGRAM = 252, 1, Program(255, 190)


def framed(message: Any, sysid: int = 255, compid: int = 190) -> Frame:
    frame = parse_one(bytes(message.pack(mavlink.MAVLink(None, sysid, compid))))
    assert frame is not None
    return frame


def beat(autopilot: int = mavlink.MAV_AUTOPILOT_INVALID) -> Any:
    return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, autopilot, 0, 0, 4, 3)


def command(to: int = VEHICLE) -> Any:
    return mavlink.MAVLink_command_long_message(to, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)


# --- the link ---


@pytest.mark.parametrize(
    ("text", "opened"),
    [
        ("udp:127.0.0.1:14550", "udpout:127.0.0.1:14550"),
        ("udpout:127.0.0.1:14550", "udpout:127.0.0.1:14550"),
        ("udpin:127.0.0.1:14551", "udpin:127.0.0.1:14551"),
        ("tcpin:localhost:5770", "tcpin:localhost:5770"),
        ("udpin:[::1]:14551", "udpin:[::1]:14551"),
    ],
)
def test_links_of_this_computer_are_served(text: str, opened: str) -> None:
    assert parse_served(text).text == opened


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "example.org", "[::]", "128.0.0.1"])
def test_no_other_computer_is_served(host: str) -> None:
    with pytest.raises(LinkError, match=r"is not this computer\. Programs are served"):
        parse_served(f"udpin:{host}:14551")


@pytest.mark.parametrize("text", ["", "14550", "udp:", "udp:127.0.0.1", "udp:127.0.0.1:0", "/dev/ttyUSB0", "http:x:1"])
def test_what_is_no_link_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(LinkError) as caught:
        parse_served(text)
    assert "\n" not in str(caught.value)


# --- from the program ---


@pytest.mark.parametrize(
    ("frame", "kind"),
    [
        (framed(beat()), Kind.HEARTBEAT),
        (framed(beat(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)), Kind.VEHICLE),
        (framed(beat(), sysid=VEHICLE), Kind.VEHICLE),
        (framed(command(), sysid=VEHICLE), Kind.VEHICLE),
        (framed(command()), Kind.PASSED),
        (framed(command(0)), Kind.PASSED),
        (framed(command(7)), Kind.ELSEWHERE),
        (framed(command(STATION)), Kind.ELSEWHERE),
        (framed(mavlink.MAVLink_gps_rtcm_data_message(0, 4, bytes(180))), Kind.PASSED),
        (framed(mavlink.MAVLink_manual_control_message(VEHICLE, 0, 0, 0, 0, 0)), Kind.PASSED),
        (framed(mavlink.MAVLink_setup_signing_message(VEHICLE, 1, bytes(32), 0)), Kind.SIGNING),
        (framed(command())._replace(known=False), Kind.UNKNOWN),
    ],
)
def test_each_frame_of_the_program_is_of_one_kind(frame: Frame, kind: Kind) -> None:
    assert kind_of(frame, (VEHICLE,)) is kind


def test_the_project_s_own_messages_are_the_module_s_alone() -> None:
    frame = framed(command())
    assert OUR_MESSAGES
    assert {kind_of(frame._replace(msgid=msgid), (VEHICLE,)) for msgid in OUR_MESSAGES} == {Kind.OURS}


# --- to the program ---


def read(data: bytes | None) -> Any:
    assert data is not None
    return mavlink.MAVLink(None).decode(bytearray(data))


def test_an_answer_to_the_station_is_one_to_the_program() -> None:
    ack = framed(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, STATION, 230), VEHICLE, 1)
    told = read(for_program(ack, STATION, PROGRAM))
    assert (told.target_system, told.target_component, told.result) == (255, 190, 0)
    assert (told.get_srcSystem(), told.get_srcComponent()) == (VEHICLE, 1)


@pytest.mark.parametrize("to", [0, 251, 255])
def test_what_is_for_another_one_stays_so(to: int) -> None:
    ack = framed(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, to, 230), VEHICLE, 1)
    assert for_program(ack, STATION, PROGRAM) == ack.raw


def test_the_station_in_control_is_the_program_for_the_program() -> None:
    status = framed(mavlink.MAVLink_control_status_message(0, STATION, [0] * 10), VEHICLE, 191)
    assert read(for_program(status, STATION, PROGRAM)).gcs_main == 255
    other = framed(mavlink.MAVLink_control_status_message(0, 251, [0] * 10), VEHICLE, 191)
    assert read(for_program(other, STATION, PROGRAM)).gcs_main == 251


def test_before_the_program_is_heard_nothing_is_changed() -> None:
    ack = framed(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, STATION, 230), VEHICLE, 1)
    assert for_program(ack, STATION, None) == ack.raw


def test_a_signed_frame_loses_its_signature() -> None:
    own = mavlink.MAVLink(None, VEHICLE, 1)
    own.signing.secret_key = bytes(32)
    own.signing.sign_outgoing = True
    frame = parse_one(bytes(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(own)))
    assert frame is not None
    assert frame.signed
    data = for_program(frame, STATION, PROGRAM)
    assert data is not None
    assert (data[2], read(data).type) == (0, 2)


def test_probes_leases_and_the_project_s_messages_are_not_for_the_program() -> None:
    frame = framed(mavlink.MAVLink_timesync_message(0, 5), VEHICLE, PROBE_COMPID)
    assert for_program(frame, STATION, PROGRAM) is None
    lease = framed(mavlink.MAVLink_tunnel_message(VEHICLE, 1, 47116, 8, bytes(128)), VEHICLE, 191)
    assert for_program(lease, STATION, PROGRAM) is None
    other = framed(mavlink.MAVLink_tunnel_message(STATION, 1, 200, 8, bytes(128)), VEHICLE, 1)
    assert read(for_program(other, STATION, PROGRAM)).target_system == 255


# --- the program ---


class Port:
    """The device of a served program."""

    def __init__(self) -> None:
        self.waiting: list[Frame] = []
        self.written: list[bytes] = []
        self.accepted = 0
        self.closed = False
        self.peer = True

    def read(self) -> list[Frame]:
        frames, self.waiting = self.waiting, []
        return frames

    def write(self, data: bytes) -> bool:
        self.written.append(data)
        return True

    def accept_sender(self, _frame: Frame) -> bool:
        self.accepted += 1
        return self.peer

    def close(self) -> None:
        self.closed = True


class Bench:
    def __init__(self) -> None:
        self.port, self.told = Port(), list[str]()
        device: Any = self.port
        self.program = ServedProgram(device, STATION, (VEHICLE,), self.told.append)

    def send(self, *messages: Any, now: float = 10.0, sysid: int = 255) -> list[Kind]:
        self.port.waiting = [framed(message, sysid) for message in messages]
        return [kind for kind, _frame in self.program.read(now)]


def test_heartbeats_and_commands_come_through_and_the_sender_gets_the_answers() -> None:
    bench = Bench()
    assert bench.send(beat(), command()) == [Kind.HEARTBEAT, Kind.PASSED]
    assert bench.program.program == PROGRAM
    bench.program.to_program(framed(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, STATION, 230), VEHICLE, 1))
    assert read(bench.port.written[0]).target_system == 255


def test_before_its_heartbeat_a_program_commands_nothing() -> None:
    bench = Bench()
    assert bench.send(command()) == []
    assert bench.program.dropped == {"before a heartbeat": 1}
    assert bench.send(beat(), command()) == [Kind.HEARTBEAT, Kind.PASSED]


def test_a_second_program_neither_commands_nor_lives_for_the_first() -> None:
    bench = Bench()
    bench.send(beat(), now=10.0)
    bench.port.peer = False
    assert bench.send(beat(), command(), now=12.0) == []
    assert bench.program.dropped == {"of a second program": 2}
    assert not bench.program.is_there(12.0)


def test_what_is_not_passed_on_is_counted_and_told_once() -> None:
    bench = Bench()
    key = mavlink.MAVLink_setup_signing_message(VEHICLE, 1, bytes(32), 0)
    assert bench.send(key, key, command(9)) == []
    assert bench.program.dropped == {"SETUP_SIGNING": 2, "to another system": 1}
    assert [text.split(",")[0] for text in bench.told] == [
        "The served program sent SETUP_SIGNING",
        "The served program sent frames to a system that is not a vehicle of this station: not passed on.",
    ]


def test_it_is_told_when_it_comes_when_it_falls_silent_and_when_it_comes_back() -> None:
    bench = Bench()
    assert bench.program.change(5.0) is Change.NONE
    bench.send(beat(), now=10.0)
    assert bench.program.change(10.0) is Change.HEARD
    assert bench.program.change(10.0 + SILENT_S - 0.1) is Change.NONE
    assert bench.program.change(10.0 + SILENT_S) is Change.SILENT
    bench.send(command(), now=14.0)
    assert bench.program.change(14.0) is Change.NONE, "a command is no heartbeat"
    bench.send(beat(), now=15.0)
    assert bench.program.change(15.0) is Change.HEARD


def test_without_a_heartbeat_nothing_is_answered_in_the_program_s_name() -> None:
    bench = Bench()
    assert not bench.program.is_there(10.0)
    bench.send(beat(), now=10.0)
    assert bench.program.is_there(10.0 + MUTE_S - 0.1)
    assert not bench.program.is_there(10.0 + MUTE_S)


def test_of_a_flood_a_second_s_worth_is_passed_on_and_every_heartbeat() -> None:
    bench = Bench()
    bench.send(beat(), now=9.0)
    flood = [command()] * (MOST_FRAMES + 50)
    assert len(bench.send(*flood, now=10.2)) == MOST_FRAMES
    assert bench.program.dropped["too many"] == 50
    assert bench.send(command(), beat(), now=10.9) == [Kind.HEARTBEAT]
    assert bench.send(command(), now=11.0) == [Kind.PASSED]


def test_a_flood_of_heartbeats_does_not_fill_the_vehicle_s_links() -> None:
    bench = Bench()
    assert bench.send(*([beat()] * 500), command()) == [Kind.HEARTBEAT] * MOST_BEATS + [Kind.PASSED]
    assert bench.program.dropped["too many"] == 500 - MOST_BEATS
    assert bench.send(beat(), now=11.0) == [Kind.HEARTBEAT]
