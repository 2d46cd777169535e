# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover policy`: prints the gate's table: what a station may send, by name, with the reason."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from fnmatch import fnmatchcase

from mavproxy_handover.gate.examples import Example, examples
from mavproxy_handover.gate.explain import columns, for_commander, for_others, summary
from mavproxy_handover.gate.policy.access import ANY, Access
from mavproxy_handover.gate.policy.parameters import OTHER_PARAMETERS, parameter_rule
from mavproxy_handover.gate.policy.tables import MESSAGES_BY_PART, POLICY, PolicyRow
from mavproxy_handover.gate.trial import SITUATIONS, answer
from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.wire.message_ids import MESSAGE_IDS

__all__ = ["main"]

_NAMES = frozenset(row.name.upper() for row in POLICY).union(MESSAGE_IDS)
#: of so many rows the answer says what the gate does in each situation
_IN_FULL = 8
#: as ArduPilot names parameters
_PARAMETER = re.compile(r"[A-Z][A-Z0-9_]{1,15}")


def main(argv: Sequence[str]) -> int:
    """Print the policy or a part of it. 1: no row fits the names asked for."""
    parser = CommandParser(
        prog="handover policy",
        examples=(
            ("handover policy DO_SET_MODE", "which station may set the mode, when, and why"),
            ('handover policy "FS_*" --json', "the failsafe parameters, for programs"),
            ("handover policy --summary", "how many messages each class has"),
        ),
        codes={0: "printed", 1: "no row fits: such a message is refused", 2: "wrong usage"},
        description="What a station may send to the vehicle: every message, command, file opcode, mission type, "
        "parameter and file with a rule of its own, its class, and why. Of a few names it also says what the gate "
        "does in each situation: it asks the gate itself. What is not in the table is refused.",
    )
    parser.add_argument(
        "name", nargs="*", help="only names that contain this, or fit it as a pattern (FS_GCS*), or that it fits"
    )
    parser.add_argument("--summary", action="store_true", help="by class, not by name")
    parser.add_argument("--json", action="store_true", help="as JSON, one list")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    if arguments.summary:
        lines = summary()
        if arguments.json:
            print(json.dumps([dict(zip(lines[0], line, strict=True)) for line in lines[1:]], indent=1))
        else:
            print(columns(lines))
        return 0
    rows = [row for row in POLICY if _wanted(row, arguments.name)]
    if not rows:
        asked = f"{', '.join(arguments.name)}: " if arguments.name else ""
        print(f"handover policy: {asked}no row fits. What has no row is refused.", file=sys.stderr)
        return 1
    if arguments.json:
        print(json.dumps([_as_json(row, arguments.name) for row in rows], indent=1))
        return 0
    print(columns([("class", "what", "name", "why"), *((r.access.value, r.kind, r.name, r.why) for r in rows)]))
    if len(rows) <= _IN_FULL:
        for row in rows:
            _print_verdicts(row, arguments.name)
    _explain(rows, arguments.name)
    return 0


def _wanted(row: PolicyRow, names: Sequence[str]) -> bool:
    name = row.name.upper()
    asked = [word.upper().removeprefix("MAV_CMD_") for word in names]
    return not asked or any(word in name or fnmatchcase(name, word) or _fits(row, word) for word in asked)


def _fits(row: PolicyRow, word: str) -> bool:
    """True if a row decides about a name that is not its own."""
    part = MESSAGES_BY_PART.get(word)
    if part is not None:  # judged by its contents: use the rows of these
        return row.kind in part.split(", and ")
    if row.kind != "parameter" or word in _NAMES:
        return False
    if row.name == ANY:  # the row of all parameters without a row of their own
        return _PARAMETER.fullmatch(word) is not None and parameter_rule(word) is OTHER_PARAMETERS
    return fnmatchcase(word, row.name)


def _verdicts(row: PolicyRow, names: Sequence[str]) -> dict[str, dict[str, str]]:
    """What the gate does, by example and situation. A row that is a pattern is asked by the name that was given."""
    asked = (word.upper() for word in names if row.kind == "parameter" and _PARAMETER.fullmatch(word.upper()))
    own = next((word for word in asked if row.name in parameter_rule(word).names), row.name)
    found = examples(row.kind, own)
    frames: list[tuple[str, Example | None]] = [(example.label, example) for example in found] or [("", None)]
    return {
        label: {situation.who: str(answer(row.kind, example, situation)) for situation in SITUATIONS}
        for label, example in frames
    }


def _print_verdicts(row: PolicyRow, names: Sequence[str]) -> None:
    """One line for each verdict of a row, with the situations that have it."""
    for label, verdicts in _verdicts(row, names).items():
        print(f"\n{' with '.join(filter(None, (row.name, label)))} ({row.kind})")
        for verdict in dict.fromkeys(verdicts.values()):
            print(f"  {verdict}")
            for who in (who for who, each in verdicts.items() if each == verdict):
                print(f"    {who}")


def _as_json(row: PolicyRow, names: Sequence[str]) -> dict[str, object]:
    return {
        "kind": row.kind,
        "name": row.name,
        "class": row.access.value,
        "commander": for_commander(row.access),
        "others": for_others(row.access),
        "why": row.why,
        **({"verdicts": _verdicts(row, names)} if names else {}),
    }


def _explain(rows: Sequence[PolicyRow], names: Sequence[str]) -> None:
    """Print below the rows what their classes mean, and which messages are judged by their contents."""
    print()
    for access in Access:
        if any(row.access is access for row in rows):
            print(f"{access.value}: from the commander {for_commander(access)}; from others {for_others(access)}")
    asked = [word.upper() for word in names]
    judged = [message for message in MESSAGES_BY_PART if not names or message in asked]
    if judged:
        print()
    for message in judged:
        print(f"{message} is judged by its {MESSAGES_BY_PART[message]}")
