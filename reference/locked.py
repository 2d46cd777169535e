# SPDX-License-Identifier: GPL-3.0-or-later

"""`locked.md`: what the commander may and may not set while the vehicle is armed, and why."""

from __future__ import annotations

from collections.abc import Sequence

from mavproxy_handover.gate.policy.access import ANY, Access, Rule
from mavproxy_handover.gate.policy.commands import COMMAND_RULES, VALUE_RULES, ValueRule
from mavproxy_handover.gate.policy.messages import MESSAGE_RULES
from mavproxy_handover.gate.policy.parameters import OTHER_PARAMETERS, PARAMETER_RULES
from mavproxy_handover.gate.policy.switches import OTHER_SWITCHES, SWITCH_NUMBERS, SWITCH_RULES
from reference.markdown import cell, code, page, table

__all__ = ["locked"]

_WORDS = {
    Access.SAFEGUARD: "locked while armed",
    Access.COMMAND: "the commander's at any time",
    Access.MAINTENANCE: "over no radio link",
}


def locked() -> str:
    """The page."""
    return page(
        "What is locked while armed",
        "A return is flown when no station has authority. So it has to be the one that was checked before take-off, "
        "and the one that the energy is counted for. This is the table by which the gate judges: parameters, commands, "
        "messages and auxiliary functions that shape a return, or that a failsafe, the guard or authority rests on. "
        "While the vehicle is armed nobody sets them, the commander included: the answer says `locked while armed`. On "
        "the ground the commander may. `handover policy NAME` tells of one.",
        "To fly faster or slower the commander sends `DO_CHANGE_SPEED`. It is judged, and a return does not keep it: "
        "see [authority](../authority.md).",
        "## Parameters",
        "Of ArduCopter and ArduPlane 4.5 to 4.7, in both spellings where a name changed. `*` stands for any "
        "characters. The first row that fits counts.",
        _table((*PARAMETER_RULES, OTHER_PARAMETERS), "parameters"),
        "## Auxiliary functions",
        "What `DO_AUX_FUNCTION` switches, with the number of `RCn_OPTION`. A pilot's own switch is not concerned.",
        _table((*SWITCH_RULES, OTHER_SWITCHES), "functions", SWITCH_NUMBERS),
        "## Commands",
        "Names without `MAV_CMD_`.",
        _table([rule for rule in COMMAND_RULES if rule.access is Access.SAFEGUARD], "commands"),
        "By the first parameter:",
        _table([Rule(rule.access, rule.why, (_other_than(rule),)) for rule in VALUE_RULES], "commands"),
        "## Messages",
        _table([rule for rule in MESSAGE_RULES if rule.access is Access.SAFEGUARD], "messages"),
    )


def _other_than(rule: ValueRule) -> str:
    return f"{rule.name}, other than {' and '.join(f'{value:g}' for value in rule.values)}"


def _table(rules: Sequence[Rule], what: str, numbers: dict[str, int] | None = None) -> str:
    rows = []
    for rule in rules:
        every = f"every other of the {what}" if rule.names == (ANY,) else ""
        names = every or ", ".join(code(f"{name} {numbers[name]}" if numbers else name) for name in rule.names)
        rows.append((names, _WORDS[rule.access], cell(rule.why)))
    return table((what, "class", "why"), rows)
