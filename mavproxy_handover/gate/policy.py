# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds the policy's row for a frame: by message id, or by the part of the contents that decides.

The policy itself is data, in `tables.py`. Here its names meet the numbers of the installed dialect, once, at
import; a frame then costs one or two dictionary look-ups. Nothing is decided here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.tables import (
    COMMAND_RULES,
    COMPANION_COMPID,
    FTP_OPCODES,
    FTP_RULES,
    GUARD_STATUS_TUNNEL,
    LEASE_TUNNEL,
    MESSAGE_RULES,
    Access,
    Rule,
)
from mavproxy_handover.wire.frames import Frame, field_offset

__all__ = [
    "COMPANION_COMPID",
    "GUARD_STATUS_TUNNEL",
    "LEASE_TUNNEL",
    "MISSION_START",
    "Access",
    "Row",
    "classify",
]

#: MAV_CMD_MISSION_START: START, which the companion itself carries out on the ground.
MISSION_START: Final = 300


@dataclass(frozen=True, slots=True)
class Row:
    """What the policy says of one frame.

    `what` names the frame for a human. `access` is None if the policy has no row for it: `part` then tells
    whether the message is unknown (None) or what it carries (the command, opcode or payload type).
    """

    what: str
    access: Access | None
    part: int | None = None


_MESSAGE_NAMES: Final[dict[int, str]] = {msgid: cls.msgname for msgid, cls in mavlink.mavlink_map.items()}
_COMMAND_NAMES: Final[dict[int, str]] = {
    number: entry.name for number, entry in mavlink.enums["MAV_CMD"].items() if not entry.name.endswith("_ENUM_END")
}


def _by_name(rules: tuple[Rule, ...]) -> dict[str, Access]:
    return {name: rule.access for rule in rules for name in rule.names}


def _message_rows() -> dict[int, Row]:
    access = _by_name(MESSAGE_RULES)
    return {msgid: Row(name, access[name]) for msgid, name in _MESSAGE_NAMES.items() if name in access}


def _part_rows() -> dict[int, dict[int, Row]]:
    commands = {f"MAV_CMD_{name}": access for name, access in _by_name(COMMAND_RULES).items()}
    opcodes = _by_name(FTP_RULES)
    tables: dict[str, dict[int, tuple[str, Access]]] = {
        "COMMAND_LONG": {n: (name, commands[name]) for n, name in _COMMAND_NAMES.items() if name in commands},
        "COMMAND_ACK": {
            n: (name, Access.CONTROL if commands.get(name) is Access.CONTROL else Access.STREAM)
            for n, name in _COMMAND_NAMES.items()
        },
        "FILE_TRANSFER_PROTOCOL": {n: (name, opcodes[name]) for n, name in FTP_OPCODES.items()},
        "TUNNEL": {n: (str(n), Access.NEVER) for n in (LEASE_TUNNEL, GUARD_STATUS_TUNNEL)},
    }
    tables["COMMAND_INT"] = tables["COMMAND_LONG"]
    return {
        msgid: {n: Row(f"{name}/{label}", access, n) for n, (label, access) in tables[name].items()}
        for msgid, name in _MESSAGE_NAMES.items()
        if name in tables
    }


_COMMAND_LONG: Final = mavlink.MAVLINK_MSG_ID_COMMAND_LONG
_COMMAND_INT: Final = mavlink.MAVLINK_MSG_ID_COMMAND_INT
_COMMAND_ACK: Final = mavlink.MAVLINK_MSG_ID_COMMAND_ACK
_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_TUNNEL: Final = mavlink.MAVLINK_MSG_ID_TUNNEL

#: Where the part begins in the payload, and its length in bytes. The opcode is byte 3 of the file-transfer header.
_PART_FIELDS: Final[dict[int, tuple[int, int]]] = {
    _COMMAND_LONG: (field_offset(_COMMAND_LONG, "command"), 2),
    _COMMAND_INT: (field_offset(_COMMAND_INT, "command"), 2),
    _COMMAND_ACK: (field_offset(_COMMAND_ACK, "command"), 2),
    _FTP: (field_offset(_FTP, "payload") + 3, 1),
    _TUNNEL: (field_offset(_TUNNEL, "payload_type"), 2),
}

#: What a part without a row is; a message that is not here is refused then.
_PART_DEFAULTS: Final = {_COMMAND_ACK: Access.STREAM, _TUNNEL: Access.MAINTENANCE}

_MESSAGE_ROWS: Final = _message_rows()
_PART_ROWS: Final = _part_rows()


def classify(frame: Frame) -> Row:
    """The policy's row for a frame. Total: a frame without a row gets one whose `access` is None."""
    msgid = frame.msgid
    row = _MESSAGE_ROWS.get(msgid)
    if row is not None:
        return row
    field = _PART_FIELDS.get(msgid)
    if field is None:
        return Row(_MESSAGE_NAMES.get(msgid, f"message {msgid}"), None)
    offset, length = field
    part = int.from_bytes(frame.payload[offset : offset + length], "little")
    row = _PART_ROWS[msgid].get(part)
    if row is not None:
        return row
    return Row(f"{_MESSAGE_NAMES[msgid]}/{part}", _PART_DEFAULTS.get(msgid), part)
