# SPDX-License-Identifier: GPL-3.0-or-later

"""A received MAVLink frame as ArduPilot hands it to a script: the bytes of its `mavlink_message_t`."""

from __future__ import annotations

import functools
import struct

from pymavlink.dialects.v20 import all as dialect

__all__ = ["for_autopilot", "message_image", "payload_size"]

AUTOPILOT_COMPONENT = 1
IMAGE_PAYLOAD_BYTES = 264
MAVLINK2_MAGIC, MAVLINK1_MAGIC = 0xFD, 0xFE
SIGNED_FLAG = 0x01


#: Bytes of each MAVLink field type.
FIELD_BYTES = {"char": 1, "uint8_t": 1, "int8_t": 1, "uint16_t": 2, "int16_t": 2, "uint32_t": 4, "int32_t": 4}
FIELD_BYTES |= {"float": 4, "uint64_t": 8, "int64_t": 8, "double": 8}


def payload_size(msgid: int) -> int | None:
    """Full payload length of a message that the firmware knows (it is built from `all.xml`), else None."""
    message = dialect.mavlink_map.get(msgid)
    return None if message is None else int(message.unpacker.size)


@functools.cache
def _target_offsets(msgid: int) -> tuple[int | None, int | None]:
    """Byte offsets of target_system and target_component in the payload of a known message."""
    message = dialect.mavlink_map[msgid]
    offset = 0
    found: dict[str, int] = {}
    for index, name in enumerate(message.ordered_fieldnames):
        found[name] = offset
        kind = message.fieldtypes[message.fieldnames.index(name)]
        offset += FIELD_BYTES[kind] * max(1, message.array_lengths[index])
    return found.get("target_system"), found.get("target_component")


def message_image(frame: bytes, leftovers: bytes = b"") -> bytes | None:
    """The 291 bytes of `mavlink_message_t` for a raw MAVLink 1 or 2 frame, as `receive_chan` gives them.

    Nothing is verified: ArduPilot shows scripts known messages with a wrong CRC too. Payload bytes that were
    not sent are zero for known messages and what an earlier packet left (`leftovers`, 264 bytes) for unknown
    ones. None: not one whole frame.
    """
    if len(frame) >= 12 and frame[0] == MAVLINK2_MAGIC:
        _, length, incompat, compat, seq, sysid, compid = struct.unpack_from("<7B", frame)
        head, msgid, signed = 10, int.from_bytes(frame[7:10], "little"), bool(incompat & SIGNED_FLAG)
    elif len(frame) >= 8 and frame[0] == MAVLINK1_MAGIC:
        _, length, seq, sysid, compid, msgid = struct.unpack_from("<6B", frame)
        head, incompat, compat, signed = 6, 0, 0, False
    else:
        return None
    if len(frame) != head + length + 2 + (13 if signed else 0):
        return None
    crc = frame[head + length : head + length + 2]
    payload = bytearray(IMAGE_PAYLOAD_BYTES)
    if payload_size(msgid) is None:
        payload[: len(leftovers)] = leftovers
    payload[:length] = frame[head : head + length]
    header = bytes((frame[0], length, incompat, compat, seq, sysid, compid)) + msgid.to_bytes(3, "little")
    return crc + header + bytes(payload) + crc + frame[head + length + 2 :].ljust(13, b"\0")


def for_autopilot(image: bytes, system_id: int) -> bool:
    """Whether the autopilot handles the message itself: broadcast, or meant for its system and component."""
    msgid = int.from_bytes(image[9:12], "little")
    if payload_size(msgid) is None:
        return True
    system_at, component_at = _target_offsets(msgid)
    if system_at is not None and image[12 + system_at] not in (0, system_id):
        return False
    return component_at is None or image[12 + component_at] in (0, AUTOPILOT_COMPONENT)
