# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames for the gate's tests: any message of the dialect, from any sender, in either MAVLink version."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, parse_one

IDS = {cls.msgname: msgid for msgid, cls in mavlink.mavlink_map.items()}


def make_frame(name: str, sysid: int = 251, compid: int = 190, version: int = 2, **fields: Any) -> Frame:
    """A frame of the message `name`: all zeros, addressed to the vehicle's autopilot (1, 1), and `fields`."""
    cls = mavlink.mavlink_map[IDS[name]]
    sender = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    blank = bytes([0xFD, cls.unpacker.size, 0, 0, 0, sysid, compid]) + IDS[name].to_bytes(3, "little")
    blank += bytes(cls.unpacker.size)
    crc = mavlink.x25crc(blank[1:] + bytes([cls.crc_extra])).crc
    message = mavlink.MAVLink(None).decode(bytearray(blank + crc.to_bytes(2, "little")))
    values = {"target_system": 1, "target_component": 1}
    if name == "MANUAL_CONTROL":
        values = {"target": 1}
    for field, value in {**{k: v for k, v in values.items() if k in cls.fieldnames}, **fields}.items():
        assert field in cls.fieldnames, f"{name} has no {field}"
        setattr(message, field, value)
        if isinstance(value, bytes):
            setattr(message, f"_{field}_raw", value)
    frame = parse_one(message.pack(sender, force_mavlink1=version == 1))
    assert frame is not None
    assert (frame.version, frame.sysid, frame.msgid) == (version, sysid, IDS[name])
    return frame


@pytest.fixture(scope="session")
def make() -> Callable[..., Frame]:
    return make_frame
