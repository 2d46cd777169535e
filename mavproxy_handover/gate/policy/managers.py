# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of payload managers: onboard programs that are a camera, a gimbal or a winch of the vehicle.

A manager is an onboard program with the right `manager` and a component of the payload. Stations hear what it says, and
command it. Two tables:

* `MANAGER_SAYS`: what it may tell the stations, and how often.
* What it takes from stations: the payload's commands and messages (`policy/payload.py`), `MANAGER_COMMANDS` and
  PARAM_EXT_SET from the station with payload authority; the questions of `MANAGER_READS`, and every command of the
  class READ, from those that may read. Nothing else that is addressed to it passes, from any station. ArduPilot carries
  out commands to components that it does not know (`MAVLink_routing.cpp`), so the autopilot never gets them.

Sources: MAVLink camera protocol v2, gimbal protocol v2, extended parameter protocol.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.payload import PayloadKind
from mavproxy_handover.gate.policy.access import Access, names
from mavproxy_handover.gate.policy.payload import KIND_OF_COMPONENT, command_ids, payload_kind
from mavproxy_handover.wire.frames import Frame, field_int, target
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, message_ids

__all__ = ["MANAGER_COMMANDS", "MANAGER_READS", "MANAGER_SAYS", "Taken", "taken"]

#: Messages of a manager to the stations, and how many a second pass. COMMAND_ACK and the answers to parameters come as
#: fast as the questions.
MANAGER_SAYS: Final[Mapping[str, float]] = {
    **dict.fromkeys(names("COMMAND_ACK PARAM_EXT_VALUE PARAM_EXT_ACK PARAM_ERROR"), 100.0),
    **dict.fromkeys(
        names("""
            CAMERA_INFORMATION CAMERA_SETTINGS CAMERA_CAPTURE_STATUS CAMERA_FOV_STATUS CAMERA_THERMAL_RANGE
            STORAGE_INFORMATION VIDEO_STREAM_INFORMATION VIDEO_STREAM_STATUS CAMERA_IMAGE_CAPTURED
            CAMERA_TRACKING_IMAGE_STATUS CAMERA_TRACKING_GEO_STATUS GIMBAL_MANAGER_INFORMATION GIMBAL_MANAGER_STATUS
            GIMBAL_DEVICE_INFORMATION WINCH_STATUS
        """),
        10.0,
    ),
    "GIMBAL_DEVICE_ATTITUDE_STATUS": 20.0,
}

#: Commands of the payload at a manager alone: the autopilot makes something else of them. Names without MAV_CMD_.
MANAGER_COMMANDS: Final[Mapping[PayloadKind, tuple[str, ...]]] = {
    PayloadKind.GIMBAL: names("DO_SET_ROI_LOCATION DO_SET_ROI_NONE DO_SET_ROI_SYSID"),
    PayloadKind.CAMERA: names("CAMERA_TRACK_POINT CAMERA_TRACK_RECTANGLE CAMERA_STOP_TRACKING"),
}

#: Questions that a manager takes. Commands of the class READ are questions, too.
MANAGER_READS: Final = names("PING PARAM_EXT_REQUEST_READ PARAM_EXT_REQUEST_LIST")

_COMMANDS: Final = command_ids(MANAGER_COMMANDS)
_READS: Final = message_ids(*MANAGER_READS)
_PARAM_EXT_SET: Final = mavlink.MAVLINK_MSG_ID_PARAM_EXT_SET
_ASKING: Final = (Access.READ, Access.ANSWERED)


class Taken(Enum):
    """Fates of a frame at the manager that it is addressed to."""

    ANSWERS = "answers"  #: it asks, or sets the rate of a message
    REFUSES = "refuses"  #: no manager takes it


def taken(frame: Frame, access: Access | None) -> PayloadKind | Taken:
    """The fate of a frame at its manager. A kind: the manager carries it out for the station with that payload.

    `access`: the class of the frame, which is known to the dialect.
    """
    if frame.msgid in COMMAND_MESSAGES:
        kind = payload_kind(frame) or _COMMANDS.get(field_int(frame, "command"))
        return kind or (Taken.ANSWERS if access in _ASKING else Taken.REFUSES)
    if frame.msgid == _PARAM_EXT_SET:
        aim = target(frame)
        return Taken.REFUSES if aim is None else KIND_OF_COMPONENT[aim[1]]
    return payload_kind(frame) or (Taken.ANSWERS if frame.msgid in _READS else Taken.REFUSES)
