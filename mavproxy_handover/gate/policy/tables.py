# SPDX-License-Identifier: GPL-3.0-or-later

"""Collects the policy as data: a row with a reason for every name that the gate judges.

Names are messages, MAV_CMDs, file-transfer opcodes, tunnel payload types, mission types, and the parameters and files
that matter. A name without a row is refused: a message or command of a newer dialect stays out until it has a row here.
Names that MAVLink has already, and the installed pymavlink has not, also have rows, so that an update of pymavlink
changes nothing by itself; until then `rows` ignores them. `tests/gate/test_policy.py` checks that no row is missing and
none is obsolete. `handover policy` prints all rows.

`Access` explains the classes, and `judge.py` applies them. Reasons of the rows:

* No canonical list of "state-changing" messages exists. These rows follow ArduPilot's message handlers.
* A stop from a station that does not command is refused, as in the thesis. Its operator asks for control instead. The
  aircraft's own failsafes do not depend on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mavproxy_handover.gate.policy.access import Access, Rule
from mavproxy_handover.gate.policy.commands import COMMAND_RULES, VALUE_RULES
from mavproxy_handover.gate.policy.files import FILE_RULES
from mavproxy_handover.gate.policy.messages import MESSAGE_RULES
from mavproxy_handover.gate.policy.parameters import OTHER_PARAMETERS, PARAMETER_MESSAGES, PARAMETER_RULES
from mavproxy_handover.gate.policy.parts import (
    COMMAND_ACK_RULES,
    FTP_RULES,
    MISSION_READ_MESSAGES,
    MISSION_READ_RULES,
    MISSION_TYPE_MESSAGES,
    MISSION_TYPE_RULES,
    MISSION_TYPES,
    TUNNEL_RULES,
)
from mavproxy_handover.gate.policy.switches import OTHER_SWITCHES, SWITCH_RULES

__all__ = [
    "COMMAND_ACK_RULES",
    "COMMAND_RULES",
    "FILE_RULES",
    "FTP_RULES",
    "MESSAGES_BY_PART",
    "MESSAGE_RULES",
    "MISSION_READ_RULES",
    "MISSION_TYPES",
    "MISSION_TYPE_RULES",
    "PARAMETER_RULES",
    "POLICY",
    "TUNNEL_RULES",
    "Access",
    "PolicyRow",
    "Rule",
]

#: Messages that are judged by a part of their contents, and that part.
MESSAGES_BY_PART: Final = {
    "COMMAND_LONG": "command",
    "COMMAND_INT": "command",
    "COMMAND_ACK": "acknowledged command",
    "FILE_TRANSFER_PROTOCOL": "file opcode, and file",
    "TUNNEL": "tunnel payload type",
    **dict.fromkeys(MISSION_TYPE_MESSAGES, "mission type"),
    **dict.fromkeys(MISSION_READ_MESSAGES, "mission type, read"),
    **dict.fromkeys(PARAMETER_MESSAGES, "parameter"),
}


@dataclass(frozen=True, slots=True)
class PolicyRow:
    """One name of the policy. `kind`: the kind of thing that it names."""

    kind: str
    name: str
    access: Access
    why: str


def _listed(values: tuple[float, ...]) -> str:
    return " and ".join(f"{value:g}" for value in values)


def _policy() -> tuple[PolicyRow, ...]:
    kinds: tuple[tuple[str, tuple[Rule, ...]], ...] = (
        ("message", MESSAGE_RULES),
        ("command", COMMAND_RULES),
        ("acknowledged command", COMMAND_ACK_RULES),
        ("mission type", MISSION_TYPE_RULES),
        ("mission type, read", MISSION_READ_RULES),
        ("parameter", (*PARAMETER_RULES, OTHER_PARAMETERS)),
        ("auxiliary function", (*SWITCH_RULES, OTHER_SWITCHES)),
        ("file opcode", FTP_RULES),
        ("tunnel payload type", TUNNEL_RULES),
    )
    rows = [
        PolicyRow(kind, name, rule.access, rule.why) for kind, rules in kinds for rule in rules for name in rule.names
    ]
    rows += [
        PolicyRow("command by parameter", f"{rule.name} (other than {_listed(rule.values)})", rule.access, rule.why)
        for rule in VALUE_RULES
    ]
    rows += [PolicyRow("file", rule.name, rule.access, rule.why) for rule in FILE_RULES]
    return tuple(rows)


#: The whole policy, name by name.
POLICY: Final = _policy()
