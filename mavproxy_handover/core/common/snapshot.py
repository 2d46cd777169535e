# SPDX-License-Identifier: GPL-3.0-or-later

"""State that outlives a restart of the companion: authority, causes, holds and batteries.

A restart must not give authority to a station that had none. So the snapshot names the one station that had it. After
the restart no station commands until that one is heard again. Then the epoch is one higher, which makes every earlier
frame stale. Without a snapshot, or with one that cannot be trusted, no station has authority.

After a loss of power the disk may have an older snapshot than the last change of authority. Such a snapshot is not
`proven`, and its station has to show that it still has authority (`authority/authority.py`).

A restart must not make a fault smaller either: a cause that lasts as long as the flight continues in the next run, and
the batteries hold no more than before (`safety/battery.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.model import Phase

__all__ = ["PackMemory", "Snapshot"]


@dataclass(frozen=True, slots=True)
class PackMemory:
    """State of one battery in flight that the next run needs; None: not known.

    `left_wh`: no more was left; `used_wh`: drawn in all; `most_wh`: no more than this can be drawn in all, by what the
    voltage said at rest; `ohm`: the resistance that the take-off showed.
    """

    left_wh: float | None = None
    used_wh: float | None = None
    most_wh: float | None = None
    ohm: float | None = None


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State at the last change of authority. `owner` None: no station had authority.

    `out_of_coverage`: the policy in force, which the mission may have brought; None: that of the configuration.
    """

    owner: int | None
    epoch: int
    handover_id: int
    phase: Phase
    route_at: int
    digest: bytes
    route: tuple[int, ...]
    takeover_allowed: bool = False
    out_of_coverage: str | None = None
    #: since when a gap was being crossed (monotonic seconds of the same boot); None: none was
    gap_since: float | None = None
    #: there was no change of authority after it
    proven: bool = True
    #: it was no flight, but a rehearsal on the ground
    rehearsal: bool = False
    #: since when the aircraft has stood still by the companion's order (monotonic seconds of the same boot), and for
    #: what; None: it does not
    held_since: float | None = None
    held_for: Cause | None = None
    #: it stands still by that order, or did when it was ordered home or to go on, and nothing has shown since
    stands: bool = False
    #: what is wrong until the flight is over, and the commander has not overruled
    lasting: tuple[Cause, ...] = ()
    #: state of the batteries in flight; the arbiter does not use it
    packs: tuple[PackMemory, ...] = ()
    #: a station wrote the mission that the autopilot holds, and no package replaces it; the digest of the package that
    #: it is judged by, empty: none is known. The arbiter does not use it
    kept: bool = False
    kept_by: bytes = b""
