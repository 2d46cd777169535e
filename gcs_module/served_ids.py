# SPDX-License-Identifier: GPL-3.0-or-later

"""System ids between a served program and the vehicle. Pure.

The program has an id of its own, 255 as most programs come. The vehicle knows the station's id only. So:

1. A frame of the program leaves as the station's: MAVProxy packs it, signs it and numbers it on the vehicle's link.
2. A frame of the vehicle to the station goes to the program as one to the program. This holds for every message with a
   target (acknowledgements, mission items, file transfers), and for the station in control (CONTROL_STATUS).
3. Some messages of the program are not passed on: its heartbeat, which the station answers for; this project's own
   messages, which the station's module speaks; SETUP_SIGNING, which carries a key in the clear; and frames in the name
   of a vehicle or to another system.
4. This project's messages, and probes of links, are not for the program.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, field_offset, target, target_offsets
from mavproxy_handover.wire.ids import LEASE_TUNNEL, OUR_MESSAGES, PROBE_COMPID
from mavproxy_handover.wire.rewritten import rewritten

__all__ = ["Kind", "Program", "for_program", "kind_of"]

_HEARTBEAT: Final[int] = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_SETUP_SIGNING: Final[int] = mavlink.MAVLINK_MSG_ID_SETUP_SIGNING
_CONTROL_STATUS: Final[int] = mavlink.MAVLINK_MSG_ID_CONTROL_STATUS
_TUNNEL: Final[int] = mavlink.MAVLINK_MSG_ID_TUNNEL
_IN_CONTROL: Final = field_offset(_CONTROL_STATUS, "gcs_main")
_AUTOPILOT: Final = field_offset(_HEARTBEAT, "autopilot")
_PAYLOAD_TYPE: Final = field_offset(_TUNNEL, "payload_type")


class Kind(Enum):
    """Kinds of frames of a served program."""

    HEARTBEAT = "heartbeat"
    PASSED = "passed on"
    SIGNING = "SETUP_SIGNING"
    VEHICLE = "in the name of a vehicle"
    ELSEWHERE = "to another system"
    OURS = "a message of this project"
    UNKNOWN = "not known"


@dataclass(frozen=True, slots=True)
class Program:
    """The ids of the served program, from its heartbeat."""

    sysid: int
    compid: int


def kind_of(frame: Frame, vehicles: Collection[int]) -> Kind:
    """What to do with a frame of the program. `vehicles`: system ids of the station's vehicles."""
    if not frame.known:
        return Kind.UNKNOWN
    if frame.sysid in vehicles:
        return Kind.VEHICLE
    if frame.msgid == _HEARTBEAT:
        of_program = frame.payload[_AUTOPILOT] == mavlink.MAV_AUTOPILOT_INVALID
        return Kind.HEARTBEAT if of_program else Kind.VEHICLE
    if frame.msgid == _SETUP_SIGNING:
        return Kind.SIGNING
    if frame.msgid in OUR_MESSAGES:
        return Kind.OURS
    to = target(frame)
    if to is not None and to[0] not in (0, *vehicles):
        return Kind.ELSEWHERE
    return Kind.PASSED


def for_program(frame: Frame, station: int, program: Program | None) -> bytes | None:
    """A frame of the vehicle as the program gets it; None: it is not for it. `program` None: not heard yet."""
    if frame.msgid in OUR_MESSAGES or frame.compid == PROBE_COMPID or _is_lease(frame):
        return None
    if not frame.known:
        return frame.raw
    changed: dict[int, int] = {}
    if program is not None:
        _length, system, component = target_offsets(frame.msgid)
        if system is not None and frame.payload[system] == station:
            changed[system] = program.sysid
            if component is not None and frame.payload[component]:
                changed[component] = program.compid
        if frame.msgid == _CONTROL_STATUS and frame.payload[_IN_CONTROL] == station:
            changed[_IN_CONTROL] = program.sysid
    return rewritten(frame, changed) if changed or frame.signed else frame.raw


def _is_lease(frame: Frame) -> bool:
    if frame.msgid != _TUNNEL:
        return False
    return int.from_bytes(frame.payload[_PAYLOAD_TYPE : _PAYLOAD_TYPE + 2], "little") == LEASE_TUNNEL
