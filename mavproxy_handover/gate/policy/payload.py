# SPDX-License-Identifier: GPL-3.0-or-later

"""The payload: commands and messages that move gimbal, camera, winch, gripper, sprayer or lights, and nothing else.

The holder of payload authority may send these. They are picked by name from the classes COMMAND and STREAM, because
other commands of the same rows reach the flight:

* DO_SET_ROI* and NAV_ROI turn a copter that has no gimbal with pan.
* DO_MOUNT_CONTROL and MOUNT_CONTROL turn a copter in the same way (`GCS_MAVLink_Copter.cpp`).
* DO_SET_SERVO, DO_SET_RELAY and DO_SET_ACTUATOR drive any output, the motors' and the parachute's among them.
* CAMERA_TRACK_* and buttons of users do what a program makes of them.

These stay with flight authority. `policy/managers.py` has those that a camera or gimbal manager takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.payload import PayloadKind
from mavproxy_handover.gate.policy.access import names
from mavproxy_handover.wire.frames import Frame, field_int, target
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, message_ids

__all__ = ["KIND_OF_COMPONENT", "PAYLOAD_COMMANDS", "PAYLOAD_MESSAGES", "command_ids", "payload_kind"]

#: Names without MAV_CMD_.
PAYLOAD_COMMANDS: Final[Mapping[PayloadKind, tuple[str, ...]]] = {
    PayloadKind.GIMBAL: names("DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE"),
    PayloadKind.CAMERA: names("""
        DO_DIGICAM_CONFIGURE DO_DIGICAM_CONTROL DO_CONTROL_VIDEO DO_SET_CAM_TRIGG_DIST DO_SET_CAM_TRIGG_INTERVAL
        DO_TRIGGER_CONTROL RESET_CAMERA_SETTINGS SET_CAMERA_MODE SET_CAMERA_ZOOM SET_CAMERA_FOCUS SET_CAMERA_SOURCE
        SET_STORAGE_USAGE IMAGE_START_CAPTURE IMAGE_STOP_CAPTURE REQUEST_CAMERA_IMAGE_CAPTURE VIDEO_START_CAPTURE
        VIDEO_STOP_CAPTURE VIDEO_START_STREAMING VIDEO_STOP_STREAMING
    """),
    PayloadKind.WINCH: names("DO_WINCH DO_GRIPPER DO_SPRAYER ILLUMINATOR_ON_OFF DO_ILLUMINATOR_CONFIGURE"),
}

PAYLOAD_MESSAGES: Final[Mapping[PayloadKind, tuple[str, ...]]] = {
    PayloadKind.GIMBAL: names("""
        GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_SET_MANUAL_CONTROL
        GIMBAL_DEVICE_SET_ATTITUDE
    """),
    PayloadKind.CAMERA: names("DIGICAM_CONFIGURE DIGICAM_CONTROL GOPRO_SET_REQUEST"),
}

#: The components of the payload. The first of each kind answers requests of authority over that kind.
KIND_OF_COMPONENT: Final[Mapping[int, PayloadKind]] = {
    mavlink.MAV_COMP_ID_GIMBAL: PayloadKind.GIMBAL,
    **dict.fromkeys(range(mavlink.MAV_COMP_ID_GIMBAL2, mavlink.MAV_COMP_ID_GIMBAL6 + 1), PayloadKind.GIMBAL),
    **dict.fromkeys(range(mavlink.MAV_COMP_ID_CAMERA, mavlink.MAV_COMP_ID_CAMERA6 + 1), PayloadKind.CAMERA),
    mavlink.MAV_COMP_ID_WINCH: PayloadKind.WINCH,
}
#: Components that a frame of the payload may be addressed to: all, the autopilot, which drives a payload of its own,
#: and those of the payload.
_COMPONENTS: Final = frozenset((0, mavlink.MAV_COMP_ID_AUTOPILOT1, *KIND_OF_COMPONENT))


def command_ids(rows: Mapping[PayloadKind, tuple[str, ...]]) -> dict[int, PayloadKind]:
    """The kind by the number of each command that the dialect knows."""
    return {
        number: kind
        for kind, each in rows.items()
        for name in each
        if (number := getattr(mavlink, f"MAV_CMD_{name}", None)) is not None
    }


_COMMANDS: Final = command_ids(PAYLOAD_COMMANDS)
_MESSAGES: Final = {msgid: kind for kind, each in PAYLOAD_MESSAGES.items() for msgid in message_ids(*each)}


def payload_kind(frame: Frame) -> PayloadKind | None:
    """The kind of payload that a frame moves, and nothing else; None: it may move something else. The frame is known to
    the dialect."""
    by_command = frame.msgid in COMMAND_MESSAGES
    kind = _COMMANDS.get(field_int(frame, "command")) if by_command else _MESSAGES.get(frame.msgid)
    if kind is None:
        return None
    aim = target(frame)
    return kind if aim is None or aim[1] in _COMPONENTS else None
