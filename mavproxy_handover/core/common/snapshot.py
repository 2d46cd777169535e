# SPDX-License-Identifier: GPL-3.0-or-later

"""What outlives a restart of the companion: of authority, of what is wrong, and of the batteries.

A restart must not give authority to anyone who had none. So the snapshot names the one station that had it, and the
arbiter that starts from it commands nobody until that station is heard again; then the epoch is one higher, which
makes every frame of the time before stale. No snapshot, or one that cannot be trusted, means that nobody has authority.

A snapshot may be older than the last change of authority: after a loss of power there is what the disk got in time.
Such a one is not `proven`, and the station that it names has to show that it still has authority (`authority.py`).

Nor must a restart make less of what is wrong: what lasts as long as the flight is wrong in the next run too, and the
batteries hold no more than they did (`battery.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.model import Phase

__all__ = ["PackMemory", "Snapshot"]


@dataclass(frozen=True, slots=True)
class PackMemory:
    """What a run after this one needs to know of one battery in flight; None: not known.

    `left_wh`: no more was left; `used_wh`: drawn in all; `most_wh`: no more than this can be drawn in all, by what the
    voltage said at rest; `ohm`: the resistance that the take-off showed.
    """

    left_wh: float | None = None
    used_wh: float | None = None
    most_wh: float | None = None
    ohm: float | None = None


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State at the last change of authority. `owner` None: nobody had authority.

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
    #: what is known of the batteries in flight; the arbiter has no part in it
    packs: tuple[PackMemory, ...] = ()
    #: a station wrote the mission that the autopilot holds, and nothing replaces it; by the digest of which package it
    #: is judged, empty: none is known. The arbiter has no part in it
    kept: bool = False
    kept_by: bytes = b""
