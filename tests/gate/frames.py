# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames for the gate's tests: any message of the dialect, from any sender, in either MAVLink version."""

from __future__ import annotations

from copy import copy
from functools import cache
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, parse_one

__all__ = ["IDS", "ftp_request", "make_frame"]

IDS = {cls.msgname: msgid for msgid, cls in mavlink.mavlink_map.items()}


@cache
def _blank(name: str) -> Any:
    """The message with zeros in all fields, as if it had been received."""
    cls = mavlink.mavlink_map[IDS[name]]
    raw = bytes([0xFD, cls.unpacker.size, 0, 0, 0, 1, 1]) + IDS[name].to_bytes(3, "little") + bytes(cls.unpacker.size)
    crc = mavlink.x25crc(raw[1:] + bytes([cls.crc_extra])).crc
    return mavlink.MAVLink(None).decode(bytearray(raw + crc.to_bytes(2, "little")))


def make_frame(name: str, sysid: int = 251, compid: int = 190, version: int = 2, **fields: Any) -> Frame:
    """A frame of the message `name`: all zeros, addressed to the vehicle's autopilot (1, 1), and `fields`."""
    message = copy(_blank(name))
    known = message.fieldnames
    address = {"target": 1} if name == "MANUAL_CONTROL" else {"target_system": 1, "target_component": 1}
    for field, value in {**{k: v for k, v in address.items() if k in known}, **fields}.items():
        assert field in known, f"{name} has no {field}"
        setattr(message, field, value)
        if isinstance(value, bytes):
            setattr(message, f"_{field}_raw", value)
    sender = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    frame = parse_one(message.pack(sender, force_mavlink1=version == 1))
    assert frame is not None
    assert (frame.version, frame.sysid, frame.msgid) == (version, sysid, IDS[name])
    return frame


def ftp_request(opcode: int, data: bytes = b"", session: int = 0, sequence: int = 0) -> list[int]:
    """The payload field of a FILE_TRANSFER_PROTOCOL request."""
    head = sequence.to_bytes(2, "little") + bytes([session, opcode, len(data), 0, 0, 0]) + bytes(4)
    return list((head + data).ljust(251, b"\0"))
