# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station that does not command may ask of autopilot and companion, through the module."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from tests.gate.frames import ftp_request
from tests.module.conftest import Bench


@pytest.fixture
def flight(bench: Bench) -> Bench:
    """GCSA commands, GCSB is an observer."""
    bench.connect()
    bench.autopilot.received.clear()
    return bench


def test_a_flood_of_questions_neither_fills_the_autopilots_channel_nor_the_journal(flight: Bench) -> None:
    before = len(flight.journal())
    for _ in range(100):
        for number in range(20):
            flight.b.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", number))
        flight.run(0.05)
    assert len(flight.autopilot.got("PARAM_REQUEST_READ", 252)) < 200 + 50 * 6
    flight.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 7))
    flight.run(0.1)
    assert len(flight.autopilot.got("PARAM_REQUEST_READ", 251)) == 1
    refused = [entry for entry in flight.journal()[before:] if entry["event"] == "refused"]
    assert 1 <= len(refused) <= 7
    assert {entry["reason"] for entry in refused} == {"too many questions"}


@pytest.mark.parametrize("kind", ["senseless transfer", "senseless control"])
def test_nor_does_a_flood_of_words_to_the_companion(flight: Bench, kind: str) -> None:
    message = (
        mavlink.MAVLink_on_handover_message(1, 191, 9, 251, 252, 7, 7, 0, 0, 0)
        if kind == "senseless transfer"
        else mavlink.MAVLink_command_long_message(1, 191, 32100, 0, 7, 7, 0, 0, 0, 0, 0)
    )
    before = len(flight.journal())
    for _ in range(100):
        for _number in range(20):
            flight.b.send(message)
        flight.run(0.05)
    assert len(flight.journal()) - before < 200 + 50 * 6 + 60


def test_an_observers_file_does_not_close_the_commanders(flight: Bench) -> None:
    def ftp(opcode: int, path: bytes) -> mavlink.MAVLink_message:
        return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, ftp_request(opcode, path, session=2))

    flight.a.send(ftp(6, b"@MISSION/mission.dat"))
    flight.wait(4.0)
    flight.b.send(ftp(4, b"@SYS/tasks.txt"))
    flight.run(0.2)
    assert flight.autopilot.got("FILE_TRANSFER_PROTOCOL", 252) == []
    assert flight.b.got("FILE_TRANSFER_PROTOCOL")[-1].payload[3] == 129
    assert flight.journal("refused")[-1]["reason"] == "the commander uses file transfer"


# ---- in flight -------------------------------------------------------------------------------------------------------


@pytest.fixture
def in_flight(flight: Bench) -> Bench:
    """The same, armed."""
    flight.autopilot.armed = True
    flight.wait(1.5)
    assert flight.companion.view.armed
    flight.autopilot.received.clear()
    flight.b.received.clear()
    return flight


BULK = [
    mavlink.MAVLink_param_request_list_message(1, 1),
    mavlink.MAVLink_param_ext_request_list_message(1, 1),
    mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, ftp_request(3, b"/")),
    mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, ftp_request(4, b"@PARAM/param.pck")),
    mavlink.MAVLink_command_long_message(1, 1, 42428, 0, *[0] * 7),
    mavlink.MAVLink_terrain_check_message(526790000, 59240000),
]


@pytest.mark.parametrize("message", BULK, ids=lambda message: message.get_type())
def test_what_would_slow_down_the_commanders_telemetry_is_its_alone_in_flight(
    in_flight: Bench, message: mavlink.MAVLink_message
) -> None:
    kind = message.get_type()
    in_flight.b.send(message)
    in_flight.run(0.1)
    assert in_flight.autopilot.got(kind, 252) == []
    assert in_flight.journal("refused")[-1]["reason"] == "only the commander's in flight"
    in_flight.a.send(message)
    in_flight.run(0.1)
    assert len(in_flight.autopilot.got(kind, 251)) == 1


def test_its_refusal_is_the_protocols_own(in_flight: Bench) -> None:
    # What a program reads by itself is answered in the protocol alone: tests/gate/test_refusal_text.py.
    for message in BULK:
        in_flight.b.send(message)
    in_flight.run(0.2)
    (error,) = in_flight.b.got("PARAM_ERROR")
    assert (error.param_id, error.param_index, error.error, error.target_system) == ("", -1, 3, 252)
    assert [m.payload[3] for m in in_flight.b.got("FILE_TRANSFER_PROTOCOL")] == [129, 129]
    assert [(m.command, m.result) for m in in_flight.b.got("COMMAND_ACK")] == [
        (42428, mavlink.MAV_RESULT_NOT_IN_CONTROL)
    ]
    assert in_flight.b.told() == [
        (mavlink.MAV_SEVERITY_WARNING, f"{what} refused: in flight GCSA alone may ask")
        for what in ("parameter list", "banner", "terrain height")
    ]


def test_who_asks_again_and_again_reads_of_it_every_ten_seconds(in_flight: Bench) -> None:
    for _ in range(25):
        in_flight.b.send(mavlink.MAVLink_param_request_list_message(1, 1))
        in_flight.run(1.0)
    assert len(in_flight.b.got("PARAM_ERROR")) == 25
    assert len(in_flight.b.told()) == 3


def test_one_thing_at_a_time_everybody_may_ask_in_flight_too(in_flight: Bench) -> None:
    in_flight.b.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1))
    in_flight.b.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    in_flight.b.command(512, 148)
    in_flight.run(0.1)
    got = [
        in_flight.autopilot.got(kind, 252) for kind in ("PARAM_REQUEST_READ", "MISSION_REQUEST_LIST", "COMMAND_LONG")
    ]
    assert [len(messages) for messages in got] == [1, 1, 1]


def test_on_the_ground_stations_load_their_parameters_but_not_without_end(flight: Bench) -> None:
    for _ in range(240):
        flight.b.send(mavlink.MAVLink_param_request_list_message(1, 1))
        flight.run(0.5)
    assert 60 < len(flight.autopilot.got("PARAM_REQUEST_LIST", 252)) < 140
    assert flight.journal("refused")[-1]["reason"] == "too many questions"
