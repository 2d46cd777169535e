# SPDX-License-Identifier: GPL-3.0-or-later

"""The classes of the policy (`Access`), and a row that gives one class to several names (`Rule`).

The rows are in `messages`, `commands`, `parts`, `parameters`, `switches` and `files`. `tables` collects them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["ANY", "Access", "Rule", "names"]

#: In a table: every name without a row of its own.
ANY = "*"


class Access(Enum):
    """Classes of frames: which station may send them, and where they go. `judge` also looks at the vehicle's state."""

    READ = "read"  #: any station; passed on
    BULK = "bulk read"  #: as READ on the ground; while the vehicle is armed, only the commander's
    LIVENESS = "liveness"  #: the commander's is passed on; all others are only noticed
    COMMAND = "command"  #: the commander's is passed on; all others are refused and told so
    SAFEGUARD = "safeguard"  #: as COMMAND on the ground; while the vehicle is armed, from no station
    LOG = "flight log"  #: reads flight logs: any station, one at a time; while the vehicle is armed, no station
    #: sticks, setpoints and other frequent input: the commander's is passed on, all others are dropped
    STREAM = "stream"
    FEED = "feed"  #: data that commands nothing: passed on if its station is the source (`gate/feeds.py`), else dropped
    ANSWERED = "answered"  #: the commander's is passed on; all others are answered by the companion
    RALLY_READ = "rally points"  #: any station; the companion answers from its own list; never passed on
    RALLY_WRITE = "rally upload"  #: the commander's goes to that list; never passed on; all others are refused
    TRANSFER = "transfer"  #: any station; handled by the companion, never passed on
    CONTROL = "control"  #: operator-control request; any station; handled by the companion, never passed on
    ABSENT = "absent"  #: refused to any station, as if the vehicle did not have it
    MAINTENANCE = "maintenance"  #: over no radio link, from any station
    NEVER = "never"  #: no station has a reason to send it; dropped

    #: members are single objects, so their identity can be the hash, which is much faster than their name
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class Rule:
    """A row of the policy: names of one class, and why they are in it."""

    access: Access
    why: str
    names: tuple[str, ...]
    #: name of sticks or setpoints for people: such a stream that began before its station had control stays refused
    #: (`stale_streams`). Other streams, such as corrections, may continue over a handover.
    stream: str = ""
    #: for `Access.NEVER`: a person may mean it, so a text says that it is dropped
    told: bool = False


def names(text: str) -> tuple[str, ...]:
    """Split `text` into names, which are easier to read in columns than in quotes."""
    return tuple(text.split())
