# SPDX-License-Identifier: GPL-3.0-or-later

"""The words of the policy: who may send something, and a row that says so of several names at once.

The rows themselves are in `message_rules`, `command_rules`, `part_rules`, `parameters` and `files`; `tables`
holds them together.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["ANY", "Access", "Rule", "names"]

#: In a table: every name that has no row of its own.
ANY = "*"


class Access(Enum):
    """Who may send something, and what becomes of it. Who gets what in which state is decided in `judge`."""

    READ = "read"  #: any station; passed on
    BULK = "bulk read"  #: as READ on the ground; while the vehicle is armed, the commander's alone
    LIVENESS = "liveness"  #: the commander's is passed on, any other is only noticed
    COMMAND = "command"  #: the commander's is passed on; anyone else is refused and told so
    SAFEGUARD = "safeguard"  #: as COMMAND, and while the vehicle is armed from nobody
    STREAM = "stream"  #: the commander's is passed on; anyone else's is dropped in silence, for it is frequent
    ANSWERED = "answered"  #: the commander's is passed on; anyone else is answered by the companion
    RALLY_READ = "rally points"  #: any station; the companion answers of its own list, never passed on
    RALLY_WRITE = "rally upload"  #: the commander's goes to that list, never passed on; anyone else is refused
    TRANSFER = "transfer"  #: any station; the companion's business, never passed on
    CONTROL = "control"  #: operator-control request; any station; the companion's business, never passed on
    MAINTENANCE = "maintenance"  #: over no radio link, whoever sends it
    NEVER = "never"  #: no station has a reason to send it; dropped

    #: members are single objects: their identity tells them apart, and is looked up much faster than their name
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of the policy: names that share a class, and why they are in it."""

    access: Access
    why: str
    names: tuple[str, ...]
    #: of sticks and setpoints, what people call them: one that began before its station had control stays refused
    #: (`latent`). Other streams, such as corrections, are meant to run on over a handover.
    stream: str = ""


def names(text: str) -> tuple[str, ...]:
    """The words of `text`: names read better in columns than in quotes."""
    return tuple(text.split())
