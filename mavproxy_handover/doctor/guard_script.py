# SPDX-License-Identifier: GPL-3.0-or-later

"""Is the guard on the autopilot's card the one that ships here? It is asked for its checksum, by file transfer.

Nothing is read off the card and nothing is opened on it. An autopilot without file transfer does not answer.
Sources: mavlink.io "File Transfer Protocol (FTP)"; ArduPilot's `crc_crc32`, which begins with 0 and inverts nothing.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.resources import shipped
from mavproxy_handover.wire.conversation import Ask, Asking, NoAnswer
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, EVERYBODY, FTP_ACK, FTP_NAK, FTP_OPCODES

__all__ = ["card_checksum", "checksum", "shipped_script"]

_CRC: Final = next(number for number, name in FTP_OPCODES.items() if name == "CalcFileCRC32")
#: sequence, session, opcode, size, opcode that is answered, burst, padding, offset
_HEAD: Final = struct.Struct("<HBBBBBBI")
_PAYLOAD_BYTES: Final = 251
#: on a flight controller, and in simulation
_PLACES: Final = ("/APM/scripts/handover_guard.lua", "scripts/handover_guard.lua")


def shipped_script() -> bytes:
    """The guard of this installation. Raises OSError."""
    return (shipped("ardupilot_lua") / "handover_guard.lua").read_bytes()


def checksum(data: bytes) -> int:
    """As the autopilot counts it."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def card_checksum(sysid: int) -> Asking:
    """Returns that of the guard on the card; None: there is none, or nobody answers."""
    for sequence, place in enumerate(_PLACES, 1):
        name = place.encode("ascii")
        payload = _HEAD.pack(sequence, 0, _CRC, len(name), 0, 0, 0, 0) + name
        data = list(payload.ljust(_PAYLOAD_BYTES, b"\0"))
        request = mavlink.MAVLink_file_transfer_protocol_message(EVERYBODY, sysid, AUTOPILOT_COMPID, data)
        try:
            found = yield Ask("checksum of the guard", (request,), _answer(sequence + 1), timeout_s=1.5, tries=1)
        except NoAnswer:
            return None
        if found is not False:
            return found
    return None


def _answer(sequence: int) -> Callable[[Any], Any]:
    """Its checksum, False where it has no such file."""

    def answer(message: Any) -> Any:
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return None
        payload = bytes(message.payload)
        number, _session, opcode, size, answered, _burst, _padding, _offset = _HEAD.unpack_from(payload)
        if number != sequence or answered != _CRC or opcode not in (FTP_ACK, FTP_NAK):
            return None
        if opcode == FTP_NAK or size != 4:
            return False
        return int.from_bytes(payload[_HEAD.size : _HEAD.size + 4], "little")

    return answer
