# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds the policy's row for a frame: by message id, or by the part of its contents that decides.

The policy itself is data (`tables.py`). This module maps its names to the numbers of the installed dialect, once, at
import. Then a frame costs one or two dictionary look-ups, a parameter one match of its name, and a file one check of
its path. No decision is made here.

A name that the installed dialect lacks has a row but no number. A message with such a name is dropped as unknown from
every station, whatever its row says: without the definition neither its CRC nor its target can be checked. Such a
command is refused as unknown. That is safe; a newer pymavlink makes it available to the commander.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.policy.access import ANY
from mavproxy_handover.gate.policy.commands import (
    MODE_BITS,
    TAKE_OFF_RULES,
    TURNING,
    VALUE_RULES,
    TakeOffRule,
    ValueRule,
)
from mavproxy_handover.gate.policy.files import file_rule
from mavproxy_handover.gate.policy.parameters import PARAMETER_MESSAGES, parameter_name, parameter_rule
from mavproxy_handover.gate.policy.parts import MISSION_READ_MESSAGES, MISSION_TYPE_MESSAGES
from mavproxy_handover.gate.policy.switches import switch_name, switch_rule
from mavproxy_handover.gate.policy.tables import (
    COMMAND_ACK_RULES,
    COMMAND_RULES,
    FTP_RULES,
    MESSAGE_RULES,
    MISSION_READ_RULES,
    MISSION_TYPE_RULES,
    MISSION_TYPES,
    TUNNEL_RULES,
    Access,
    Rule,
)
from mavproxy_handover.vehicle.profiles import ASSUMED, Modes
from mavproxy_handover.wire.frames import Frame, field_bytes, field_float, field_int
from mavproxy_handover.wire.ids import FTP_OPCODES, GUARD_STATUS_TUNNEL, LEASE_TUNNEL, MISSION_START
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, MESSAGE_IDS, MESSAGE_NAMES, message_ids

__all__ = [
    "MESSAGE_ROWS",
    "Access",
    "Row",
    "begins_midway",
    "classify",
    "special_value",
    "moves",
    "TAKE_OFF_MESSAGES",
    "takes_off",
]


@dataclass(frozen=True, slots=True)
class Row:
    """The policy's row for one frame.

    `what` names the frame for people. `access` is None if the policy has no row for the frame. Then `part` is None if
    the message is unknown, else it is the command, opcode, payload type or mission type.
    """

    what: str
    access: Access | None
    part: int | None = None


_COMMAND_NAMES: Final[dict[int, str]] = {
    number: entry.name for number, entry in mavlink.enums["MAV_CMD"].items() if not entry.name.endswith("_ENUM_END")
}


def _by_name(rules: tuple[Rule, ...]) -> dict[str, Access]:
    return {name: rule.access for rule in rules for name in rule.names}


def _message_rows() -> dict[int, Row]:
    access = _by_name(MESSAGE_RULES)
    return {msgid: Row(name, access[name]) for msgid, name in MESSAGE_NAMES.items() if name in access}


def _parts(rules: tuple[Rule, ...], numbers: dict[int, str], prefix: str = "") -> dict[int, tuple[str, Access]]:
    """Number -> (name for people, access), for numbers whose names have a row. `*` is a row for all."""
    access = {name if name == ANY else prefix + name: value for name, value in _by_name(rules).items()}
    found = ((number, name, access.get(name, access.get(ANY))) for number, name in numbers.items())
    return {number: (name, value) for number, name, value in found if value is not None}


def _part_rows() -> dict[int, dict[int, Row]]:
    commands = _parts(COMMAND_RULES, _COMMAND_NAMES, "MAV_CMD_")
    tunnels = {number: str(number) for number in (LEASE_TUNNEL, GUARD_STATUS_TUNNEL)}
    kinds, reads = _parts(MISSION_TYPE_RULES, MISSION_TYPES), _parts(MISSION_READ_RULES, MISSION_TYPES)
    tables: dict[str, dict[int, tuple[str, Access]]] = {
        "COMMAND_LONG": commands,
        "COMMAND_INT": commands,
        "COMMAND_ACK": _parts(COMMAND_ACK_RULES, _COMMAND_NAMES, "MAV_CMD_"),
        "FILE_TRANSFER_PROTOCOL": _parts(FTP_RULES, FTP_OPCODES),
        "TUNNEL": _parts(TUNNEL_RULES, tunnels),
        **dict.fromkeys(MISSION_TYPE_MESSAGES, kinds),
        **dict.fromkeys(MISSION_READ_MESSAGES, reads),
    }
    return {
        MESSAGE_IDS[message]: {n: Row(f"{message}/{name}", access, n) for n, (name, access) in table.items()}
        for message, table in tables.items()
    }


_FTP: Final = MESSAGE_IDS["FILE_TRANSFER_PROTOCOL"]
_SWITCH: Final[int] = mavlink.MAV_CMD_DO_AUX_FUNCTION
#: the bits that the autopilot keeps of the number of an auxiliary function
_SWITCH_BITS: Final = 16
#: The opcode comes after sequence number and session.
_FTP_OPCODE: Final = slice(3, 4)

#: The field with the part of a message that decides; in file transfer it is a byte of the payload.
_PART_FIELDS: Final = {
    **dict.fromkeys(COMMAND_MESSAGES, "command"),
    MESSAGE_IDS["COMMAND_ACK"]: "command",
    MESSAGE_IDS["TUNNEL"]: "payload_type",
    **{MESSAGE_IDS[name]: "mission_type" for name in (*MISSION_TYPE_MESSAGES, *MISSION_READ_MESSAGES)},
}

#: The class of a part without a row. For messages that are not here such a part is refused.
_PART_DEFAULTS: Final = {
    MESSAGE_IDS["COMMAND_ACK"]: _by_name(COMMAND_ACK_RULES)[ANY],
    MESSAGE_IDS["TUNNEL"]: _by_name(TUNNEL_RULES)[ANY],
    # the autopilot answers that it has no such list
    **{MESSAGE_IDS[name]: Access.READ for name in MISSION_READ_MESSAGES},
}

#: Messages whose id alone decides. `judge` takes them up once, at import.
MESSAGE_ROWS: Final[Mapping[int, Row]] = _message_rows()
_PART_ROWS: Final = _part_rows()
_PARAMETER_IDS: Final = message_ids(*PARAMETER_MESSAGES)


def classify(frame: Frame) -> Row:
    """The policy's row for a frame. Total: a frame without a row gets a row without `access`."""
    msgid = frame.msgid
    row = MESSAGE_ROWS.get(msgid)
    if row is not None:
        return row
    if msgid == _FTP:
        return _file_row(field_bytes(frame, "payload"))
    field = _PART_FIELDS.get(msgid)
    if field is not None:
        row = _part_row(msgid, field_int(frame, field))
        if msgid not in COMMAND_MESSAGES:
            return row
        found = special_value(frame, row.part)
        if found is not None:
            rule, word = found
            return Row(f"{row.what} ({word})", rule.access, row.part)
        return _switch_row(row, frame) if row.part == _SWITCH else row
    what = MESSAGE_NAMES.get(msgid, f"message {msgid}")
    if msgid not in _PARAMETER_IDS:
        return Row(what, None)
    name = parameter_name(field_bytes(frame, "param_id"))
    return Row(f"{what}/{name}", parameter_rule(name).access)


def _part_row(msgid: int, part: int) -> Row:
    row = _PART_ROWS[msgid].get(part)
    return Row(f"{MESSAGE_NAMES[msgid]}/{part}", _PART_DEFAULTS.get(msgid), part) if row is None else row


def special_value(frame: Frame, command: int | None) -> tuple[ValueRule, str] | None:
    """The rule by which the first parameter gives a command another class, and the name of the command then."""
    rule = _VALUES.get(command)
    if rule is None:
        return None
    value = field_float(frame, "param1")
    if rule.cut and isfinite(value):
        value = float(int(value))
    if value in rule.values:
        return None
    whole = isfinite(value) and value == int(value)
    return rule, rule.words.get(int(value), rule.word) if whole else rule.word


def _switch_row(row: Row, frame: Frame) -> Row:
    """The row of the function that DO_AUX_FUNCTION switches, if its class differs from that of the command."""
    which = field_float(frame, "param1")
    if not isfinite(which):  # it may be any switch, also the one that stops the guard
        return Row(f"{row.what} (no number)", Access.MAINTENANCE, row.part)
    number = _keeps(int(which), _SWITCH_BITS)
    access = switch_rule(number).access
    return row if access is row.access else Row(f"{row.what} ({switch_name(number) or number})", access, row.part)


def _file_row(request: bytes) -> Row:
    opcode = int.from_bytes(request[_FTP_OPCODE], "little")
    row, rule = _part_row(_FTP, opcode), file_rule(opcode, request)
    return row if rule is None else Row(f"{row.what} ({rule.name})", rule.access, opcode)


_TAKE_OFFS: Final[dict[int, TakeOffRule]] = {
    getattr(mavlink, f"MAV_CMD_{rule.name}"): rule
    for rule in TAKE_OFF_RULES
    if hasattr(mavlink, f"MAV_CMD_{rule.name}")
}
_VALUES: Final[Mapping[int | None, ValueRule]] = {
    getattr(mavlink, f"MAV_CMD_{rule.name}"): rule for rule in VALUE_RULES if hasattr(mavlink, f"MAV_CMD_{rule.name}")
}
_TURNING: Final = frozenset(
    getattr(mavlink, f"MAV_CMD_{name}") for name in TURNING if hasattr(mavlink, f"MAV_CMD_{name}")
)


#: Messages besides commands that may begin a flight: their contents decide.
TAKE_OFF_MESSAGES: Final = frozenset({mavlink.MAVLINK_MSG_ID_SET_MODE})


def takes_off(frame: Frame, row: Row, modes: Modes = ASSUMED.gate) -> bool:
    """Whether a frame with this row arms an aircraft on the ground, or makes it take off. `modes`: its flight modes."""
    if frame.msgid == mavlink.MAVLINK_MSG_ID_SET_MODE:
        return _keeps(field_int(frame, "custom_mode"), MODE_BITS) in modes.take_off
    rule = None if row.part is None else _TAKE_OFFS.get(row.part)
    if rule is None:
        return False
    value = field_float(frame, f"param{rule.which}")
    # the autopilot cuts off decimals; a NaN may be any number
    values = _values(rule, modes)
    if values and isfinite(value) and _keeps(int(value), rule.bits) not in values:
        return False
    return rule.unless_zero is None or field_float(frame, f"param{rule.unless_zero}") != 0.0


def begins_midway(row: Row) -> bool:
    """Whether a frame with this row begins the mission at another item than its first."""
    rule = None if row.part is None else _TAKE_OFFS.get(row.part)
    return rule is not None and rule.midway


def _values(rule: TakeOffRule, modes: Modes) -> tuple[int, ...]:
    if rule.mode:
        return modes.take_off
    return (*rule.values, *modes.take_off_switches) if rule.switch else rule.values


def moves(frame: Frame, row: Row, modes: Modes = ASSUMED.gate) -> bool:
    """Whether a frame with this row may turn motors while people carry the aircraft: START, arming, take-off, tests."""
    if row.access is not Access.COMMAND:
        return False
    turns = frame.msgid in COMMAND_MESSAGES and (row.part == MISSION_START or row.part in _TURNING)
    return turns or takes_off(frame, row, modes)


def _keeps(number: int, bits: int) -> int:
    return number & ((1 << bits) - 1)
