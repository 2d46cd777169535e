# SPDX-License-Identifier: GPL-3.0-or-later

"""Evidence of the source of a flight mode: texts of the autopilot, and commands of the commander.

They become events for the rules (`core/safety/mode_source.py`). Differences between firmwares are in the profiles, with
their sources.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ModeSourceSeen
from mavproxy_handover.core.common.model import ModeClass, ModeSource
from mavproxy_handover.vehicle.profiles import ASSUMED, Profile
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, field_int
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES

__all__ = ["breached", "of_command", "of_text", "radio_lives"]

_OF_GUARD: Final = "Handover:"

_ANY: Final = None
#: MAV_CMD_DO_RETURN_PATH_START, which older pymavlinks do not have
_RETURN_PATH: Final = 188
#: command -> the mode that it leads to; None: any. Where a firmware does otherwise, `Profile.commands` says so
_COMMANDS: Final[Mapping[int, ModeClass | None]] = {
    mavlink.MAV_CMD_MISSION_START: ModeClass.MISSION,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: ModeClass.MISSION,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: ModeClass.RETURN,
    mavlink.MAV_CMD_DO_LAND_START: ModeClass.RETURN,
    _RETURN_PATH: ModeClass.RETURN,
    mavlink.MAV_CMD_NAV_LAND: ModeClass.LAND,
    mavlink.MAV_CMD_NAV_VTOL_LAND: ModeClass.LAND,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: ModeClass.HANDS,
    mavlink.MAV_CMD_NAV_TAKEOFF: ModeClass.GUIDED,
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: ModeClass.GUIDED,
    mavlink.MAV_CMD_DO_REPOSITION: ModeClass.GUIDED,
    mavlink.MAV_CMD_DO_AUX_FUNCTION: _ANY,
    mavlink.MAV_CMD_DO_SET_STANDARD_MODE: _ANY,
    mavlink.MAV_CMD_SOLO_BTN_FLY_CLICK: _ANY,
    mavlink.MAV_CMD_SOLO_BTN_FLY_HOLD: _ANY,
    mavlink.MAV_CMD_SOLO_BTN_PAUSE_CLICK: _ANY,
}
_LOOKED_AT: Final = frozenset((*_COMMANDS, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, mavlink.MAV_CMD_DO_SET_MODE))
_SET_MODE: Final[int] = mavlink.MAVLINK_MSG_ID_SET_MODE
_SET_ITEM: Final[int] = mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT
_RADIO: Final[int] = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
_FENCE: Final[int] = mavlink.MAV_SYS_STATUS_GEOFENCE


def of_text(text: str, profile: Profile = ASSUMED) -> ModeSourceSeen | None:
    """What a STATUSTEXT of the autopilot tells about the source of the mode; None: nothing.

    A failsafe acts, or is over and restores the former mode, or the mission has ended.
    """
    if text.startswith(_OF_GUARD):
        return None
    if profile.by_mission is not None and profile.by_mission.search(text):
        return ModeSourceSeen(ModeSource.MISSION)
    restored = profile.restored and profile.restored.search(text)
    if restored:
        flown = [mode.flown for mode in profile.modes.values() if mode.name == restored[1]]
        return ModeSourceSeen(ModeSource.FAILSAFE, flown[0]) if flown else None
    return ModeSourceSeen(ModeSource.FAILSAFE) if profile.by_itself.search(text) else None


def _nowhere(_seq: int) -> ModeClass | None:
    return None


def of_command(
    frame: Frame, profile: Profile = ASSUMED, leads_to: Callable[[int], ModeClass | None] = _nowhere
) -> ModeSourceSeen | None:
    """What a frame of the commander asks of the flight mode; None: nothing.

    `leads_to`: what is flown when the mission goes on with an item, None if that changes nothing (`plane_landing.py`).
    """
    if frame.msgid in COMMAND_MESSAGES:
        command = field_int(frame, "command")  # decoding the frame takes longer than all else that is done with it
        if command not in _LOOKED_AT and command not in profile.commands:
            return None
    elif frame.msgid not in (_SET_MODE, _SET_ITEM):
        return None
    message = codec.decode_bytes(frame.raw)
    if message is None:
        return None
    if frame.msgid == _SET_ITEM:
        return _of_item(leads_to(message.seq))
    if frame.msgid == _SET_MODE:
        return ModeSourceSeen(ModeSource.COMMANDER, profile.flown(message.custom_mode))
    if message.command == mavlink.MAV_CMD_DO_PAUSE_CONTINUE and message.param1 == 0.0:
        return ModeSourceSeen(ModeSource.COMMANDER, ModeClass.STOP)
    if message.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
        item = message.param1
        return _of_item(leads_to(int(item)) if 0.0 <= item < 65536.0 else None)
    if message.command == mavlink.MAV_CMD_DO_SET_MODE:
        mode = message.param2
        return ModeSourceSeen(ModeSource.COMMANDER, profile.flown(int(mode)) if 0.0 <= mode < 256.0 else _ANY)
    flown = profile.commands if message.command in profile.commands else _COMMANDS
    return ModeSourceSeen(ModeSource.COMMANDER, flown[message.command])


def _of_item(flown: ModeClass | None) -> ModeSourceSeen | None:
    return None if flown is None else ModeSourceSeen(ModeSource.COMMANDER, flown)


def radio_lives(status: Any) -> bool:
    """Whether a pilot could steer, by SYS_STATUS: there is a receiver, and no radio failsafe."""
    return bool(status.onboard_control_sensors_enabled & status.onboard_control_sensors_health & _RADIO)


def breached(status: Any) -> bool:
    """Whether the aircraft is outside a fence that is on, by SYS_STATUS."""
    on = status.onboard_control_sensors_enabled & _FENCE
    return bool(on and not status.onboard_control_sensors_health & _FENCE)
