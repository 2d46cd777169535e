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
    flight.run(4.0)
    flight.b.send(ftp(4, b"@SYS/tasks.txt"))
    flight.run(0.2)
    assert flight.autopilot.got("FILE_TRANSFER_PROTOCOL", 252) == []
    assert flight.b.got("FILE_TRANSFER_PROTOCOL")[-1].payload[3] == 129
    assert flight.journal("refused")[-1]["reason"] == "the commander uses file transfer"
