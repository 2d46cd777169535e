# SPDX-License-Identifier: GPL-3.0-or-later

"""The payload: commands and messages that move gimbal, camera, winch, gripper, sprayer or lights, and nothing else.

The holder of payload authority may send these. They are picked by name from the classes COMMAND and STREAM, because
other commands of the same rows reach the flight:

* DO_SET_ROI* and NAV_ROI turn a copter that has no gimbal with pan.
* DO_MOUNT_CONTROL and MOUNT_CONTROL turn a copter in the same way (`GCS_MAVLink_Copter.cpp`).
* DO_SET_SERVO, DO_SET_RELAY and DO_SET_ACTUATOR drive any output, the motors' and the parachute's among them.
* CAMERA_TRACK_* and buttons of users do what a program makes of them.

These stay with flight authority.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.policy.access import names
from mavproxy_handover.wire.frames import Frame, field_int, target
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, message_ids

__all__ = ["PAYLOAD_COMMANDS", "PAYLOAD_COMPONENTS", "PAYLOAD_MESSAGES", "is_payload"]

#: Names without MAV_CMD_.
PAYLOAD_COMMANDS: Final = names("""
    DO_DIGICAM_CONFIGURE DO_DIGICAM_CONTROL DO_CONTROL_VIDEO DO_SET_CAM_TRIGG_DIST DO_SET_CAM_TRIGG_INTERVAL
    DO_TRIGGER_CONTROL RESET_CAMERA_SETTINGS SET_CAMERA_MODE SET_CAMERA_ZOOM SET_CAMERA_FOCUS SET_CAMERA_SOURCE
    SET_STORAGE_USAGE IMAGE_START_CAPTURE IMAGE_STOP_CAPTURE REQUEST_CAMERA_IMAGE_CAPTURE VIDEO_START_CAPTURE
    VIDEO_STOP_CAPTURE VIDEO_START_STREAMING VIDEO_STOP_STREAMING DO_GIMBAL_MANAGER_PITCHYAW
    DO_GIMBAL_MANAGER_CONFIGURE DO_WINCH DO_GRIPPER DO_SPRAYER ILLUMINATOR_ON_OFF DO_ILLUMINATOR_CONFIGURE
""")

PAYLOAD_MESSAGES: Final = names("""
    GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_SET_MANUAL_CONTROL
    GIMBAL_DEVICE_SET_ATTITUDE DIGICAM_CONFIGURE DIGICAM_CONTROL GOPRO_SET_REQUEST
""")

#: Components that such a frame may be addressed to: all, the autopilot, which drives a payload of its own, cameras,
#: gimbals and the winch.
PAYLOAD_COMPONENTS: Final = frozenset(
    {
        0,
        mavlink.MAV_COMP_ID_AUTOPILOT1,
        *range(mavlink.MAV_COMP_ID_CAMERA, mavlink.MAV_COMP_ID_CAMERA6 + 1),
        mavlink.MAV_COMP_ID_GIMBAL,
        *range(mavlink.MAV_COMP_ID_GIMBAL2, mavlink.MAV_COMP_ID_GIMBAL6 + 1),
        mavlink.MAV_COMP_ID_WINCH,
    }
)

_COMMANDS: Final = frozenset(
    entry for name in PAYLOAD_COMMANDS if (entry := getattr(mavlink, f"MAV_CMD_{name}", None)) is not None
)
_MESSAGES: Final = message_ids(*PAYLOAD_MESSAGES)


def is_payload(frame: Frame) -> bool:
    """Whether a frame moves a payload and nothing else. The frame is known to the dialect."""
    if frame.msgid in COMMAND_MESSAGES:
        if field_int(frame, "command") not in _COMMANDS:
            return False
    elif frame.msgid not in _MESSAGES:
        return False
    aim = target(frame)
    return aim is None or aim[1] in PAYLOAD_COMPONENTS
