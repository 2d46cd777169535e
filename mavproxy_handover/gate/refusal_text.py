# SPDX-License-Identifier: GPL-3.0-or-later

"""Texts of refusals for pilots: what was refused, and why. They contain names, never numbers.

`subject_of` is cheap, and is computed for every refused frame that may be told: two frames with the same subject are
one matter. `sentence` makes the text only if it is told. Rules:

1. Acts that operators type or press have a name here. Every other command and message has its MAVLink name in small
   letters, without a common prefix.
2. Modes have the names of the firmware in use. If the firmware is not known, a mode is just "mode".
3. Of the contents of a frame only the name of a parameter is told, made printable.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Final, TypeAlias

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.safety.commands import Limit
from mavproxy_handover.gate.client_capabilities import Dialect
from mavproxy_handover.gate.intent import GUIDED_ITEM
from mavproxy_handover.gate.judge import GateReason
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.commands import MODE_BITS
from mavproxy_handover.gate.policy.files import file_rule
from mavproxy_handover.gate.policy.parts import MISSION_TYPE_MESSAGES
from mavproxy_handover.gate.policy.rows import special_value
from mavproxy_handover.gate.policy.switches import switch_name
from mavproxy_handover.vehicle.profiles import ASSUMED, Modes
from mavproxy_handover.wire.frames import Frame, field_bytes, field_float, field_int
from mavproxy_handover.wire.ids import FTP_CREATE, FTP_OPEN_WRITE, FTP_RENAME, FTP_RESET, FTP_TERMINATE, FTP_WRITE
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, MESSAGE_NAMES, message_ids

__all__ = [
    "COMMANDS",
    "LOG_ENDED",
    "MESSAGES",
    "SWITCHES",
    "Subject",
    "by_itself",
    "called",
    "how_to_lift",
    "reason_in_words",
    "sentence",
    "subject_of",
    "thesis_command",
    "unsaid",
]

#: The subject of a frame: its name, the number of a mode, or the name of a parameter as it came.
Subject: TypeAlias = "str | int | bytes"

#: The names of commands for people. Keys without MAV_CMD_.
COMMANDS: Final = {
    "MISSION_START": "START",
    "NAV_RETURN_TO_LAUNCH": "RTL",
    "NAV_LAND": "LAND",
    "NAV_LAND_LOCAL": "LAND",
    "NAV_VTOL_LAND": "LAND",
    "NAV_LOITER_UNLIM": "LOITER",
    "NAV_TAKEOFF": "take-off",
    "NAV_TAKEOFF_LOCAL": "take-off",
    "NAV_VTOL_TAKEOFF": "take-off",
    "NAV_WAYPOINT": "target",
    "NAV_SPLINE_WAYPOINT": "target",
    "DO_REPOSITION": "target",
    "OVERRIDE_GOTO": "target",
    "DO_ORBIT": "orbit",
    "DO_CHANGE_SPEED": "speed",
    "GUIDED_CHANGE_SPEED": "speed",
    "DO_CHANGE_ALTITUDE": "altitude",
    "GUIDED_CHANGE_ALTITUDE": "altitude",
    "GUIDED_CHANGE_HEADING": "heading",
    "CONDITION_YAW": "heading",
    "DO_SET_MISSION_CURRENT": "another mission item",
    "DO_SET_STANDARD_MODE": "mode",
    "DO_SET_HOME": "home position",
    "DO_SET_GLOBAL_ORIGIN": "origin",
    "SET_EKF_SOURCE_SET": "estimator source",
    "EXTERNAL_POSITION_ESTIMATE": "position estimate",
    "DO_SET_ROI": "region of interest",
    "DO_SET_ROI_LOCATION": "region of interest",
    "DO_SET_ROI_NONE": "region of interest",
    "DO_AUX_FUNCTION": "auxiliary switch",
    "DO_FLIGHTTERMINATION": "flight termination",
    "DO_MOTOR_TEST": "motor test",
    "DO_SET_RELAY": "relay",
    "DO_SET_SERVO": "servo",
    "DO_SET_PARAMETER": "parameter",
    "DO_SET_SAFETY_SWITCH_STATE": "safety switch",
    "DO_SEND_BANNER": "banner",
    "DO_GIMBAL_MANAGER_PITCHYAW": "gimbal",
    "DO_GIMBAL_MANAGER_CONFIGURE": "gimbal",
    "DO_MOUNT_CONTROL": "gimbal",
    "DO_MOUNT_CONFIGURE": "gimbal",
    "PREFLIGHT_CALIBRATION": "calibration",
    "PREFLIGHT_REBOOT_SHUTDOWN": "reboot",
    "PREFLIGHT_STORAGE": "parameter storage",
    "RUN_PREARM_CHECKS": "pre-arm checks",
    "BATTERY_RESET": "battery reset",
    "UAVCAN_GET_NODE_INFO": "list of CAN nodes",
}
#: Commands that do one thing or its opposite: the parameter that selects it, the name if it is 0, and otherwise.
SWITCHES: Final = {
    "COMPONENT_ARM_DISARM": (1, "disarm", "arm"),
    "DO_PAUSE_CONTINUE": (1, "STOP", "CONTINUE"),
    "DO_FENCE_ENABLE": (1, "fence off", "fence on"),
    "DO_GRIPPER": (2, "gripper release", "gripper grab"),
}
#: The names of other messages for people.
MESSAGES: Final = {
    "MISSION_SET_CURRENT": "another mission item",
    "MISSION_REQUEST_PARTIAL_LIST": "mission list",
    "PARAM_REQUEST_LIST": "parameter list",
    "PARAM_EXT_REQUEST_LIST": "parameter list",
    "TERRAIN_CHECK": "terrain height",
    "REQUEST_EVENT": "list of events",
    "COMMAND_CANCEL": "cancelling",
    "SET_HOME_POSITION": "home position",
    "SET_GPS_GLOBAL_ORIGIN": "origin",
    "SET_VELOCITY_LIMITS": "speed limits",
    "FENCE_POINT": "fence upload",
    "SAFETY_SET_ALLOWED_AREA": "fence upload",
    "RALLY_POINT": "rally point upload",
    "RALLY_FETCH_POINT": "rally point list",
    "LOG_ERASE": "erasing the logs",
    "LOG_REQUEST_LIST": "list of logs",
    "LOG_REQUEST_DATA": "log download",
    "LOG_REQUEST_END": "ending a log download",
    "RC_CHANNELS_OVERRIDE": "RC override",
    "RC_CHANNELS_OVERRIDE_V2": "RC override",
    "SERIAL_CONTROL": "serial passthrough",
    "CAN_FRAME": "CAN passthrough",
    "CANFD_FRAME": "CAN passthrough",
    "TUNNEL": "tunnel data",
    "V2_EXTENSION": "extension data",
    "SETUP_SIGNING": "signing key",
    "CHANGE_OPERATOR_CONTROL": "the old request of control",
}
#: MAV_MISSION_TYPE -> name of writing this list, and of clearing it
_UPLOADS: Final = {0: "mission upload", 1: "fence upload", 2: "rally point upload", 255: "upload of everything"}
_REMOVALS: Final = {0: "mission removal", 1: "fence removal", 2: "rally point removal", 255: "removal of everything"}
#: told to the station whose download ends at arming
LOG_ENDED: Final = "log download ended: the vehicle is armed"
_LOG_FILES: Final = "reading logs"
#: file-transfer opcode -> name; all others read
_FILES: Final = {
    **dict.fromkeys((FTP_CREATE, FTP_WRITE, FTP_OPEN_WRITE, 12), "file upload"),
    **dict.fromkeys((8, 10), "removing a file"),
    9: "making a folder",
    FTP_RENAME: "renaming a file",
    **dict.fromkeys((FTP_TERMINATE, FTP_RESET), "ending a file transfer"),
}
_OPCODE: Final = 3
#: opcodes that change something: programs read files, and end open transfers, on their own when they start
_CHANGES_FILES: Final = frozenset(_FILES) - {FTP_TERMINATE, FTP_RESET}
_BEGINNINGS: Final = ("NAV_", "DO_")

_COMMAND_NAMES: Final[dict[int, str]] = {
    number: entry.name.removeprefix("MAV_CMD_") for number, entry in mavlink.enums["MAV_CMD"].items()
}


def _plain(name: str) -> str:
    for beginning in _BEGINNINGS:
        name = name.removeprefix(beginning)
    return name.lower().replace("_", " ")


#: number -> name, for every command and every message
_COMMAND_WORDS: Final[Mapping[int, str]] = {
    number: COMMANDS.get(name) or _plain(name) for number, name in _COMMAND_NAMES.items()
}
_MESSAGE_WORDS: Final[Mapping[int, str]] = {
    msgid: MESSAGES.get(name) or _plain(name) for msgid, name in MESSAGE_NAMES.items()
}
_SWITCHED: Final = {number: SWITCHES[name] for number, name in _COMMAND_NAMES.items() if name in SWITCHES}
#: names that the command's name does not tell
_PARTICULAR: Final = frozenset(word for _parameter, *words in SWITCHES.values() for word in words)
_THESIS_COMMANDS: Final = frozenset((COMMANDS["MISSION_START"], *SWITCHES["DO_PAUSE_CONTINUE"][1:]))
_SWITCH: Final = f"{COMMANDS['DO_AUX_FUNCTION']} "
_SET_MODE: Final = mavlink.MAVLINK_MSG_ID_SET_MODE
_ITEM_IDS: Final = message_ids("MISSION_ITEM", "MISSION_ITEM_INT")
_UPLOAD_IDS: Final = message_ids(*MISSION_TYPE_MESSAGES)
_CLEAR_ALL: Final = mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL
_PARAMETER_IDS: Final = message_ids("PARAM_SET", "PARAM_EXT_SET", "PARAM_MAP_RC")
_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_DO_SET_MODE: Final = mavlink.MAV_CMD_DO_SET_MODE
_MODE_MASK: Final = (1 << MODE_BITS) - 1
_NO_MODE: Final = -1
_DO_AUX_FUNCTION: Final = mavlink.MAV_CMD_DO_AUX_FUNCTION
_SWITCH_MASK: Final = 0xFFFF


def subject_of(frame: Frame) -> Subject:
    """The subject of a frame. Total for frames that the dialect knows, whatever they contain."""
    msgid = frame.msgid
    if msgid in COMMAND_MESSAGES:
        return _of_command(frame)
    if msgid == _SET_MODE:
        return field_int(frame, "custom_mode") & _MODE_MASK
    if msgid in _ITEM_IDS and field_int(frame, "current") == GUIDED_ITEM:
        return COMMANDS["DO_REPOSITION"]
    if msgid in _UPLOAD_IDS:
        words = _REMOVALS if msgid == _CLEAR_ALL else _UPLOADS
        return words.get(field_int(frame, "mission_type"), "unknown list")
    if msgid in _PARAMETER_IDS:
        return field_bytes(frame, "param_id")
    if msgid == _FTP:
        return _of_file(field_bytes(frame, "payload"))
    return _MESSAGE_WORDS[msgid]


def _of_file(payload: bytes) -> str:
    opcode = payload[_OPCODE]
    if opcode in _FILES:
        return _FILES[opcode]
    rule = file_rule(opcode, payload)
    return _LOG_FILES if rule is not None and rule.access is Access.LOG else "reading files"


def by_itself(frame: Frame, access: Access | None = None) -> bool:
    """Whether programs send such a frame on their own: file transfer that changes nothing, and reads no flight log."""
    if access is Access.LOG:
        return False
    return frame.msgid == _FTP and field_bytes(frame, "payload")[_OPCODE] not in _CHANGES_FILES


def _of_command(frame: Frame) -> Subject:
    command = field_int(frame, "command")
    if command == _DO_SET_MODE:
        mode = field_float(frame, "param2")
        return int(mode) & _MODE_MASK if isfinite(mode) else _NO_MODE
    if command == _DO_AUX_FUNCTION:
        return _of_switch(field_float(frame, "param1"))
    special = special_value(frame, command)
    if special is not None:
        return special[1]
    switch = _SWITCHED.get(command)
    if switch is None:
        return _COMMAND_WORDS.get(command, "unknown command")
    parameter, zero, other = switch
    return zero if field_float(frame, f"param{parameter}") == 0.0 else other


def _of_switch(which: float) -> str:
    """An auxiliary function, by its name in the firmware."""
    name = switch_name(int(which) & _SWITCH_MASK) if isfinite(which) else None
    return f"{COMMANDS['DO_AUX_FUNCTION']} {'' if name is None else _plain(name)}".rstrip()


def called(subject: Subject, *, modes: Modes = ASSUMED.gate) -> str:
    """What people call it. `modes`: those of the aircraft's firmware."""
    if isinstance(subject, str):
        return subject
    if isinstance(subject, int):
        return f"mode {modes.names.get(subject, '')}".rstrip()
    return f"parameter {_printable(subject)}"


def _printable(raw: bytes) -> str:
    text = raw.partition(b"\0")[0].decode("ascii", "replace")
    return "".join(letter if letter.isprintable() and letter.isascii() else "?" for letter in text)


_REASONS: Final[Mapping[GateReason, str]] = {
    GateReason.LOCKED_WHILE_ARMED: "locked while armed",
    GateReason.ON_GROUND: "only while the vehicle is disarmed",
    GateReason.NOT_ARMED: "not before arming, sticks could arm the vehicle",
    GateReason.NEVER: "the vehicle takes it from no station",
    GateReason.NO_NUMBER: "a value in it is no number",
    GateReason.TOO_MANY: "too many requests, wait some seconds",
    GateReason.MAINTENANCE_ONLY: "maintenance only, over no radio link",
    GateReason.ABSENT: "there is no such file, use the mission protocol",
    GateReason.UNKNOWN_COMMAND: "not known to this vehicle",
    GateReason.REHEARSAL: "a rehearsal is under way: nothing arms",
    GateReason.COMPONENT: "this component has no authority ('components' in [[station]])",
    GateReason.COMPANION_TARGET: "the companion takes none, ask the autopilot",
    GateReason.MANAGER_TARGET: "no command of a camera, gimbal or winch. Send it to the autopilot",
}


def unsaid(frame: Frame, *, modes: Modes = ASSUMED.gate) -> str:
    """What the name of a refused frame leaves open: which mode, parameter or switch; "" if the name says all."""
    subject = subject_of(frame) if frame.known else ""
    particular = not isinstance(subject, str) or subject in _PARTICULAR or subject.startswith(_SWITCH)
    return called(subject, modes=modes) if particular else ""


def thesis_command(frame: Frame) -> str:
    """START, STOP or CONTINUE, the commands of the thesis for a station in flight; "" for every other frame."""
    subject = _of_command(frame) if frame.known and frame.msgid in COMMAND_MESSAGES else ""
    return subject if isinstance(subject, str) and subject in _THESIS_COMMANDS else ""


def sentence(
    subject: Subject, reason: GateReason, commander: str, dialect: Dialect, *, modes: Modes = ASSUMED.gate
) -> str:
    """The text of a refusal. `commander`: its name, "" if no station commands; for LOG_BUSY the station that reads.
    `dialect`: the sender's dialect."""
    return f"{called(subject, modes=modes)} refused: {_why(reason, commander, dialect)}"


def how_to_lift(limit: Limit, again_in_s: float | None) -> str:
    """How an operator lifts a refusal of a command that would leave `limit`. `again_in_s`: seconds until
    the same command counts as insisting; None: it never does."""
    override = f"handover override {limit.value}"
    return (
        f"To lift it, type '{override}'"
        if again_in_s is None
        else f"To insist, send it again after {again_in_s:.0f} s, or type '{override}'"
    )


def _why(reason: GateReason, commander: str, dialect: Dialect) -> str:
    if reason is GateReason.NOT_IN_CONTROL:
        hint = f" ({dialect.value})" if dialect.value else ""
        return f"{commander or 'no station'} commands{hint}"
    if reason is GateReason.COMMANDERS_IN_FLIGHT:
        return f"in flight {commander} alone may ask" if commander else "not in flight"
    if reason is GateReason.LOG_BUSY:
        return f"{commander or 'another station'} reads a log, try again later"
    if reason is GateReason.FILE_BUSY:
        return f"{commander or 'another station'} is using file transfer"
    return reason_in_words(reason)


def reason_in_words(reason: GateReason) -> str:
    """A reason as people read it, without the names of stations."""
    return _REASONS.get(reason, "") or str(reason.value)
