# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard on the card against the one that ships, by its checksum. Flown by hand on ArduCopter 4.7-dev: it agrees."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.doctor.guard_script import card_checksum
from mavproxy_handover.wire.conversation import Conversation
from mavproxy_handover.wire.file_transfer import checksum

ACK, NAK = 128, 129
HARDWARE, SIMULATION = b"/APM/scripts/handover_guard.lua", b"scripts/handover_guard.lua"


def crc(data: bytes) -> int:
    """ArduPilot's `crc32_small`, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xEDB88320 if value & 1 else 0)
    return value


def reply(request: Any, opcode: int, data: bytes, *, sequence: int = 1) -> Any:
    asked = bytes(request.payload)
    number = struct.unpack_from("<H", asked)[0] + sequence
    payload = struct.pack("<HBBBBBBI", number, 0, opcode, len(data), asked[3], 0, 0, 0) + data
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 194, list(payload.ljust(251, b"\0")))


class Card:
    """Answers by the name of the file that is asked for."""

    def __init__(self, files: dict[bytes, int]) -> None:
        self.asked: list[bytes] = []
        self._files = files
        self._requests: list[Any] = []

    def talk(self) -> Conversation:
        talk = Conversation(card_checksum(1), self._requests.append, 0.0)
        while not talk.finished and self._requests:
            request = self._requests.pop(0)
            payload = bytes(request.payload)
            self.asked.append(payload[12 : 12 + payload[4]])
            found = self._files.get(self.asked[-1])
            data = b"\x0a" if found is None else struct.pack("<I", found)
            talk.on_message(
                reply(request, NAK if found is None else ACK, data, sequence=7), 0.1
            )  # not of this question
            assert not talk.finished
            talk.on_message(reply(request, NAK if found is None else ACK, data), 0.1)
        return talk


@pytest.mark.parametrize("data", [b"", b"\0", b"123456789", bytes(range(256)) * 3])
def test_the_checksum_is_the_autopilots(data: bytes) -> None:
    assert checksum(data) == crc(data)


def test_of_a_flight_controller() -> None:
    card = Card({HARDWARE: 0x12345678})
    assert card.talk().result == 0x12345678
    assert card.asked == [HARDWARE]


def test_of_the_simulation_and_a_checksum_of_zero() -> None:
    card = Card({SIMULATION: 0})
    assert card.talk().result == 0
    assert card.asked == [HARDWARE, SIMULATION]


def test_no_such_file() -> None:
    talk = Card({}).talk()
    assert talk.finished
    assert talk.result is None


def test_nobody_answers() -> None:
    talk = Conversation(card_checksum(1), lambda _message: None, 0.0)
    talk.tick(2.0)
    assert talk.finished
    assert talk.result is None
