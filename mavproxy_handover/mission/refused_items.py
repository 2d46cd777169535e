# SPDX-License-Identifier: GPL-3.0-or-later

"""Mission items that no mission may have, with the reason of each.

An item that takes away a safeguard (`SAFEGUARDS`, `SAFEGUARD_VALUES`) is the gravest fault of a mission. It makes the
check before the flight worthless: it moves home, switches the geofence off, hands the aircraft to another controller,
or stops its motors. `NOT_JUDGED` has what ArduPilot does, but the check cannot judge. ArduPilot does not store any
other command that is not in `items.COMMANDS`, and then refuses the whole mission (MAV_MISSION_UNSUPPORTED).

Source: AP_Mission (`mavlink_int_to_mission_cmd`, `start_command`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.items import COMMANDS

__all__ = ["command_name", "safeguard_taken_away", "why_not_flown"]

SAFEGUARDS: Final[Mapping[int, str]] = {
    mavlink.MAV_CMD_DO_SET_HOME: "it moves home, to which a return leads",
    mavlink.MAV_CMD_NAV_GUIDED_ENABLE: "it hands the aircraft to another controller",
    mavlink.MAV_CMD_DO_GUIDED_LIMITS: "it goes with NAV_GUIDED_ENABLE, which hands the aircraft to another controller",
    mavlink.MAV_CMD_NAV_SCRIPT_TIME: "a script on board flies the aircraft",
    mavlink.MAV_CMD_DO_SEND_SCRIPT_MESSAGE: "a script on board acts on it, and what the script does is not known",
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: "it stops the motors",
    mavlink.MAV_CMD_DO_AUX_FUNCTION: "it can switch the geofence, the flight mode and the motors",
}
#: MAV_CMD -> the only value of parameter 1 that keeps the safeguard, and what another value does
SAFEGUARD_VALUES: Final[Mapping[int, tuple[float, str]]] = {
    mavlink.MAV_CMD_DO_FENCE_ENABLE: (1.0, "it switches the geofence, or its floor, off"),
    mavlink.MAV_CMD_DO_PARACHUTE: (1.0, "it releases the parachute, or switches it off"),
    mavlink.MAV_CMD_DO_ENGINE_CONTROL: (1.0, "it stops the engine"),
}
_NOT_WALKED: Final = "the path that it makes is not known before the flight"
NOT_JUDGED: Final[Mapping[int, str]] = {
    mavlink.MAV_CMD_NAV_ATTITUDE_TIME: _NOT_WALKED,
    mavlink.MAV_CMD_NAV_ALTITUDE_WAIT: _NOT_WALKED,
    mavlink.MAV_CMD_NAV_SET_YAW_SPEED: "only rovers do it",
    mavlink.MAV_CMD_DO_SET_REVERSE: "only rovers, and aircraft with reverse thrust, do it",
    mavlink.MAV_CMD_DO_INVERTED_FLIGHT: "upside down the path of wings is not known",
    mavlink.MAV_CMD_DO_AUTOTUNE_ENABLE: "it changes the parameters of the autopilot in flight",
    mavlink.MAV_CMD_DO_GO_AROUND: "it breaks off a landing",
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: "the aircraft may wait without end",
    mavlink.MAV_CMD_DO_SET_RESUME_REPEAT_DIST: "after a break the aircraft flies a part of its path again",
}


def command_name(command: int) -> str:
    """A MAV_CMD for people: its name without the prefix, or its number if it has none."""
    if command in COMMANDS:
        return COMMANDS[command].name
    known = mavlink.enums["MAV_CMD"].get(command)
    return f"command {command}" if known is None else str(known.name).removeprefix("MAV_CMD_")


def safeguard_taken_away(command: int, param1: object) -> str:
    """Why an item takes away a safeguard; "": it does not."""
    if command in SAFEGUARDS:
        return SAFEGUARDS[command]
    if command not in SAFEGUARD_VALUES:
        return ""
    kept, why = SAFEGUARD_VALUES[command]
    return "" if param1 == kept else f"{why} (allowed: {kept:g} in parameter 1)"


def why_not_flown(command: int) -> str:
    """Why an item that is not in `COMMANDS` is refused."""
    return NOT_JUDGED.get(command, "ArduPilot does not store it, and would refuse the mission: remove the item")
