# SPDX-License-Identifier: GPL-3.0-or-later

"""FILE_TRANSFER_PROTOCOL messages: a head, and data that depend on the opcode.

Sources: mavlink.io, "File Transfer Protocol (FTP)"; ArduPilot's GCS_FTP.cpp, and its `crc_crc32`, which begins with 0
and does not invert the result.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

__all__ = ["DATA", "PAYLOAD_BYTES", "Head", "answer", "checksum", "head_of", "message"]

_HEAD: Final = struct.Struct("<HBBBBBxI")
PAYLOAD_BYTES: Final = 251
DATA: Final = slice(_HEAD.size, PAYLOAD_BYTES)


class Head(NamedTuple):
    """`size`: of the data that count. `answered`: in an answer, the opcode that it answers."""

    sequence: int
    session: int
    opcode: int
    size: int = 0
    answered: int = 0
    burst_complete: int = 0
    offset: int = 0


def head_of(payload: bytes) -> Head:
    """The head of a message's `payload` field, which is whole."""
    return Head(*_HEAD.unpack_from(payload))


def message(target: tuple[int, int], head: Head, data: bytes = b"") -> Any:
    """The message to that system and component. `data` is at most 239 bytes."""
    payload = (_HEAD.pack(*head) + data).ljust(PAYLOAD_BYTES, b"\0")
    return mavlink.MAVLink_file_transfer_protocol_message(0, *target, list(payload))


def answer(target: tuple[int, int], asked: Head, opcode: int, data: bytes = b"") -> Any:
    """The answer to a request, with these data, about the same place in the file."""
    head = Head((asked.sequence + 1) & 0xFFFF, asked.session, opcode, len(data), asked.opcode, 0, asked.offset)
    return message(target, head, data)


def checksum(data: bytes) -> int:
    """CalcFileCRC32 of a file, as the autopilot counts it."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF
