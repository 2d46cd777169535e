# SPDX-License-Identifier: GPL-3.0-or-later

"""Programs that watch a simulated flight see all of it, may read, and can do nothing else."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.main import main
from sitl.run import watchers as module
from sitl.run.watchers import MOST_A_SECOND, READS, Watchers, read_address
from sitl.script.places import SetupError

WAIT_S = 5.0


class Program:
    """A ground station program at its port."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(WAIT_S)
        self.own: Any = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.answers_to: Any = None

    @property
    def address(self) -> tuple[str, int]:
        host, port = self.socket.getsockname()
        return host, port

    def hears(self) -> Any:
        data, self.answers_to = self.socket.recvfrom(65536)
        (message,) = mavlink.MAVLink(None).parse_buffer(data)
        return message

    def says(self, message: Any) -> None:
        self.socket.sendto(message.pack(self.own), self.answers_to)


@pytest.fixture
def program() -> Iterator[Program]:
    program = Program()
    yield program
    program.socket.close()


def said(*messages: Any) -> list[Any]:
    """As the observer has parsed them."""
    own: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return [found for each in messages for found in mavlink.MAVLink(None).parse_buffer(bytearray(each.pack(own))) or ()]


def asked(watchers: Watchers) -> list[Any]:
    """What goes on to the autopilot of all that was sent; a datagram on loopback is there at once."""
    return [mavlink.MAVLink(None).parse_buffer(bytearray(frame))[0] for frame in watchers.asked()]


HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 4, 3)
POSITION = mavlink.MAVLink_global_position_int_message(1, 2, 3, 4, 5, 6, 7, 8, 9)


def test_everybody_sees_every_frame_as_it_came(program: Program) -> None:
    other = Program()
    watchers = Watchers((program.address, other.address))
    watchers.show(said(HEARTBEAT, POSITION))
    for each in (program, other):
        assert [each.hears().get_type() for _ in range(2)] == ["HEARTBEAT", "GLOBAL_POSITION_INT"]
    watchers.close()
    other.socket.close()


@pytest.mark.parametrize(
    "question",
    [
        mavlink.MAVLink_param_request_list_message(1, 1),
        mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1),
        mavlink.MAVLink_mission_request_list_message(1, 1),
        mavlink.MAVLink_mission_request_int_message(1, 1, 3),
        mavlink.MAVLink_mission_request_message(1, 1, 3),
        mavlink.MAVLink_mission_ack_message(1, 1, 0),
    ],
    ids=lambda message: message.get_type(),
)
def test_questions_go_on_as_they_are(program: Program, question: Any) -> None:
    watchers = Watchers((program.address,))
    watchers.show(said(HEARTBEAT))
    program.hears()
    program.says(question)
    (found,) = asked(watchers)
    assert found.get_msgbuf() == question.get_msgbuf()
    assert found.get_type() in READS
    watchers.close()


@pytest.mark.parametrize(
    "command",
    [
        mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_int_message(1, 1, 3, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_set_mode_message(1, 1, 6),
        mavlink.MAVLink_param_set_message(1, 1, b"HNDO_ENABLE", 0, 9),
        mavlink.MAVLink_mission_count_message(1, 1, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1),
        mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8),
        mavlink.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0),
        mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251),
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3),
    ],
    ids=lambda message: message.get_type(),
)
def test_nothing_else_goes_on(program: Program, command: Any) -> None:
    watchers = Watchers((program.address,))
    watchers.show(said(HEARTBEAT))
    program.hears()
    program.says(command)
    program.says(mavlink.MAVLink_param_request_list_message(1, 1))  # behind it: it has arrived
    assert [message.get_type() for message in asked(watchers)] == ["PARAM_REQUEST_LIST"]
    watchers.close()


def test_questions_are_bounded_in_number(program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    watchers = Watchers((program.address,))
    watchers.show(said(HEARTBEAT))
    program.hears()
    for number in range(MOST_A_SECOND + 10):
        program.says(mavlink.MAVLink_mission_request_int_message(1, 1, number))
    found = [*asked(watchers), *asked(watchers)]
    assert [message.seq for message in found] == list(range(MOST_A_SECOND))
    now[0] += 1.0
    program.says(mavlink.MAVLink_mission_request_int_message(1, 1, 0))
    assert len(asked(watchers)) == 1
    watchers.close()


def test_rubbish_is_dropped_and_who_is_not_there_costs_nothing(program: Program) -> None:
    gone = Program()
    watchers = Watchers((gone.address, program.address))
    gone.socket.close()
    for _ in range(3):
        watchers.show(said(HEARTBEAT))
        assert asked(watchers) == []
        time.sleep(0.01)  # the kernel's word of the refused datagram comes back
    assert program.hears().get_type() == "HEARTBEAT"
    program.socket.sendto(bytes(range(256)), program.answers_to)
    assert asked(watchers) == []
    watchers.close()


def test_an_address() -> None:
    assert read_address("udp:127.0.0.1:14550") == ("127.0.0.1", 14550)


@pytest.mark.parametrize(
    "text", ["127.0.0.1:14550", "udp:14550", "udp::14550", "tcp:127.0.0.1:1", "udp:127.0.0.1:0", "udp:127.0.0.1:x", ""]
)
def test_what_is_no_address_is_told(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SetupError, match="udp:HOST:PORT"):
        read_address(text)
    assert main(["--watch", text]) == 2
    assert "handover sim: --watch" in capsys.readouterr().err
