# SPDX-License-Identifier: GPL-3.0-or-later

"""Who may have chosen the flight mode, and what a mode does: ArduCopter's numbers, words and commands in the words of
the rules (`core/safety/helm.py`).

Sources: ArduCopter's mode.h, events.cpp, ekf_check.cpp, fence.cpp, RC_Channel_Copter.cpp and GCS_MAVLink_Copter.cpp.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.events import HandSeen
from mavproxy_handover.core.model import Flown, Hand
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame

__all__ = ["breached", "flown", "of_command", "of_text", "radio_lives"]

_HANDS: Final = (0, 1, 2, 5, 11, 13, 14, 15, 16, 18, 22, 23, 24, 25, 26, 28)
#: mode number -> what it does; all that is not here is something else
_FLOWN: Final[Mapping[int, Flown]] = {
    # STABILIZE ACRO ALT_HOLD LOITER DRIFT SPORT FLIP AUTOTUNE POSHOLD THROW FLOWHOLD FOLLOW ZIGZAG SYSTEMID
    # AUTOROTATE TURTLE: of FOLLOW and THROW nobody knows better than the pilot who chose them
    **dict.fromkeys(_HANDS, Flown.HANDS),
    3: Flown.MISSION,
    4: Flown.GUIDED,
    20: Flown.GUIDED,
    17: Flown.STOP,
    6: Flown.RETURN,
    21: Flown.RETURN,
    27: Flown.RETURN,
    9: Flown.LAND,
}

#: "GCS Failsafe", "EKF Failsafe: changed to LAND Mode", "Failsafe: Terrain data missing", "Polygon fence breached"
_FAILSAFE: Final = re.compile(r"\bFailsafe\b(?!.*[Cc]leared)|\b[Bb]reached$|^Trying \w+ Mode|^SmartRTL Unavailable")
_OF_GUARD: Final = "Handover:"

_ANY: Final = None
#: MAV_CMD_DO_RETURN_PATH_START, which older pymavlinks do not have
_RETURN_PATH: Final = 188
#: command -> the mode that it leads to; None: any
_COMMANDS: Final[Mapping[int, Flown | None]] = {
    mavlink.MAV_CMD_MISSION_START: Flown.MISSION,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: Flown.MISSION,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: Flown.RETURN,
    mavlink.MAV_CMD_DO_LAND_START: Flown.RETURN,
    _RETURN_PATH: Flown.RETURN,
    mavlink.MAV_CMD_NAV_LAND: Flown.LAND,
    mavlink.MAV_CMD_NAV_VTOL_LAND: Flown.LAND,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: Flown.HANDS,
    mavlink.MAV_CMD_NAV_TAKEOFF: Flown.GUIDED,
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: Flown.GUIDED,
    mavlink.MAV_CMD_DO_REPOSITION: Flown.GUIDED,
    mavlink.MAV_CMD_DO_AUX_FUNCTION: _ANY,
    mavlink.MAV_CMD_DO_SET_STANDARD_MODE: _ANY,
    mavlink.MAV_CMD_SOLO_BTN_FLY_CLICK: _ANY,
    mavlink.MAV_CMD_SOLO_BTN_FLY_HOLD: _ANY,
    mavlink.MAV_CMD_SOLO_BTN_PAUSE_CLICK: _ANY,
}
_CARRIERS: Final = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)
_SET_MODE: Final[int] = mavlink.MAVLINK_MSG_ID_SET_MODE
_RADIO: Final[int] = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
_FENCE: Final[int] = mavlink.MAV_SYS_STATUS_GEOFENCE


def flown(mode: int) -> Flown:
    """What ArduCopter's mode of this number does."""
    return _FLOWN.get(mode, Flown.OTHER)


def of_text(text: str) -> HandSeen | None:
    """What a STATUSTEXT of the autopilot tells: a failsafe acts; None: nothing of the kind."""
    said = not text.startswith(_OF_GUARD) and _FAILSAFE.search(text) is not None
    return HandSeen(Hand.FAILSAFE) if said else None


def of_command(frame: Frame) -> HandSeen | None:
    """What a frame of the commander asks of the flight mode; None: nothing."""
    if frame.msgid != _SET_MODE and frame.msgid not in _CARRIERS:
        return None
    message = codec.decode_bytes(frame.raw)
    if message is None:
        return None
    if frame.msgid == _SET_MODE:
        return HandSeen(Hand.COMMANDER, flown(message.custom_mode))
    if message.command == mavlink.MAV_CMD_DO_SET_MODE:
        mode = message.param2
        return HandSeen(Hand.COMMANDER, flown(int(mode)) if 0.0 <= mode < 256.0 else _ANY)
    if message.command not in _COMMANDS:
        return None
    return HandSeen(Hand.COMMANDER, _COMMANDS[message.command])


def radio_lives(status: Any) -> bool:
    """Whether a pilot could steer, by SYS_STATUS: there is a receiver, and no radio failsafe."""
    return bool(status.onboard_control_sensors_enabled & status.onboard_control_sensors_health & _RADIO)


def breached(status: Any) -> bool:
    """Whether the aircraft is outside a fence that is on, by SYS_STATUS."""
    on = status.onboard_control_sensors_enabled & _FENCE
    return bool(on and not status.onboard_control_sensors_health & _FENCE)
