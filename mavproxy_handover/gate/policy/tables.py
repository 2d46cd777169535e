# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy, as data: every message, MAV_CMD, file-transfer opcode, tunnel payload type, mission type, and the
parameters and files that matter have a row, by name, with the reason.

What has no row is refused, so a message or command that a newer dialect brings stays outside until somebody
gives it one. Names that MAVLink has already, and the installed pymavlink has not, have their rows too, so that an
update of pymavlink changes nothing by itself; until then `rows` passes over them. `tests/gate/test_policy.py` holds
both ends: nothing missing, nothing stale. `handover policy` prints it all.

What a class means is said at `Access`; who gets what is decided in `judge.py`. Decisions behind the rows:

* No canonical list of "state-changing" messages exists. These rows follow what ArduPilot's message handlers do.
* A stop from a station that does not command is refused, as in the thesis. Its operator asks for control
  instead; the aircraft's own failsafes need nobody's stop.
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

#: Messages that are judged by a part of their contents, and which part.
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
    """One name of the policy. `kind`: what it is the name of."""

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
