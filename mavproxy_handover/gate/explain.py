# SPDX-License-Identifier: GPL-3.0-or-later

"""Describes the policy: the verdict on each class, and the number of names in it. For `handover policy` and the README.

What is allowed comes from the tables that the gate judges by. Only the purpose of a class is described here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from mavproxy_handover.gate.judge import Fate, outcome
from mavproxy_handover.gate.policy.access import ANY, Access
from mavproxy_handover.gate.policy.tables import POLICY

__all__ = ["CLASSES", "columns", "contents", "for_commander", "for_others", "markdown_table", "summary"]

#: What each class is for. Order: from open to closed.
CLASSES: Final = {
    Access.READ: "asks and changes nothing",
    Access.BULK: "asks for much at once, or for what is dear to the autopilot",
    Access.LIVENESS: "tells the autopilot that its ground station is there",
    Access.ANSWERED: "asks for rates on a channel that all share",
    Access.COMMAND: "changes the flight, the mission or a setting",
    Access.LOG: "reads flight logs, one station at a time",
    Access.STREAM: "sticks, setpoints and other input that comes many times a second",
    Access.FEED: "data that commands nothing: corrections, traffic, terrain, weather",
    Access.SAFEGUARD: "what guard, failsafes and authority rest on, and what shapes a return",
    Access.RALLY_READ: "asks for the rally points: the places that a return is chosen from",
    Access.RALLY_WRITE: "writes them; what the autopilot's own list holds is the place that is chosen",
    Access.TRANSFER: "the handover itself, between station and companion",
    Access.CONTROL: "the operator-control request of MAVLink",
    Access.ABSENT: "reads or writes the rally points as a file: programs then use the mission protocol",
    Access.MAINTENANCE: "keys, raw buses, scripts, firmware: reconfigures the vehicle",
    Access.NEVER: "no station has a reason to send it: sensors, answers, what the vehicle says",
}

_KINDS: Final = {
    "message": ("message", "messages"),
    "command": ("command", "commands"),
    "command by parameter": ("command by its parameter", "commands by their parameter"),
    "acknowledged command": ("acknowledged command", "acknowledged commands"),
    "mission type": ("mission type", "mission types"),
    "mission type, read": ("mission type to read", "mission types to read"),
    "parameter": ("parameter pattern", "parameter patterns"),
    "auxiliary function": ("auxiliary function", "auxiliary functions"),
    "file": ("kind of file", "kinds of file"),
    "file opcode": ("file opcode", "file opcodes"),
    "tunnel payload type": ("tunnel payload type", "tunnel payload types"),
}


def _words(access: Access, commands: bool, armed: bool) -> str:
    fate, reason = outcome(access, commands, armed)
    if fate is Fate.FORWARD:
        return "passes"
    if fate is Fate.CONSUME:
        if access is Access.FEED:
            return "passes if the station is the source ([feeds])"
        return "noticed by the companion" if access is Access.LIVENESS else "answered by the companion"
    word = "refused" if fate is Fate.REFUSE else "dropped"
    return word if access in (Access.MAINTENANCE, Access.NEVER) else f"{word}: {reason.value}"


def for_commander(access: Access) -> str:
    """The verdict on frames of the commander."""
    return _ground_and_armed(access, True)


def for_others(access: Access) -> str:
    """The verdict on frames of all other stations."""
    return _ground_and_armed(access, False)


def _ground_and_armed(access: Access, commands: bool) -> str:
    ground, armed = (_words(access, commands, armed) for armed in (False, True))
    return ground if ground == armed else f"{ground}; armed: {armed}"


def contents(access: Access) -> str:
    """The number of names of each kind in a class."""
    rows = [row for row in POLICY if row.access is access]
    kinds = Counter(row.kind for row in rows if row.name != ANY)
    counts = [f"{count} {_KINDS[kind][count != 1]}" for kind, count in kinds.items()]
    return ", ".join([*counts, *(f"every other {row.kind}" for row in rows if row.name == ANY)])


def summary() -> list[tuple[str, ...]]:
    """The policy by class: a head line, then class, what it is for, commander, others, contents."""
    head = ("class", "what", "from the commander", "from any other station", "how many")
    rows = [(a.value, what, for_commander(a), for_others(a), contents(a)) for a, what in CLASSES.items()]
    return [head, *rows]


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows for a terminal, the head first: each column as wide as its longest cell, the last as it is."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    return "\n".join(
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]) for row in rows
    )


def markdown_table(lines: list[tuple[str, ...]]) -> str:
    """A table whose first line is the head. Ends without a line break."""
    head, *rows = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines]
    return "\n".join([head, "|" + "---|" * len(lines[0]), *rows])
