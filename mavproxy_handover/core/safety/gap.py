# SPDX-License-Identifier: GPL-3.0-or-later

"""Crossing of a gap in coverage that the mission declares: its beginning, its longest time, its end.

Rules
-----
* A crossing begins outside every zone, or with the loss of the commander, on a stretch of the way that is declared.
* It is over when the commander's own zone holds the aircraft again, and with the flight. Nothing else ends it. A
  commander that is heard in between, a mode change, or a zone whose station is dead gives no new time.
* It may take the time of the gap that the aircraft is in, counted from the beginning of the crossing.
* Right before a gap the aircraft may fly into it with its commander. If the commander is lost there, it may not: before
  the border a loss has its ordinary effect.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.model import GapFact

__all__ = ["Crossing"]

#: before every clock's beginning (s): no gap has time left from then
_LONG_AGO: Final = -1e9


class Crossing:
    """Crossings, one after the other. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("gap", "since")

    def __init__(self) -> None:
        #: the gap at the last position; None: in no gap
        self.gap: GapFact | None = None
        #: since when the aircraft has been crossing; None if it is not
        self.since: float | None = None

    def resume(self, since: float | None, *, certain: bool) -> None:
        """Go on where the run before ended. `certain` False: its clock says nothing here, so no time is left."""
        self.since = since if since is None or certain else _LONG_AGO

    def seen(self, gap: GapFact | None, now: float, *, covered: bool, exposed: bool) -> None:
        """A position has come.

        `covered`: the commander is heard, and its zone holds the aircraft. `exposed`: no zone holds it, or there is no
        commander.
        """
        self.gap = gap
        if covered:
            self.since = None
        elif exposed:
            self.begin(now)

    def begin(self, now: float) -> None:
        """There is no commander, or no zone holds the aircraft: in a gap, a crossing begins now."""
        if self.since is None and self.gap is not None and not self.gap.ahead:
            self.since = now

    def over(self) -> None:
        """The flight is over."""
        self.gap = self.since = None

    def open(self, now: float, *, commanded: bool) -> bool:
        """Whether the aircraft may fly on. `commanded`: there is a commander."""
        if self.gap is None or (self.gap.ahead and not commanded):
            return False
        return self.since is None or now < self.since + self.gap.limit_s

    def left_s(self, now: float) -> float:
        """Seconds that are left without a commander; 0: none."""
        if self.gap is None or self.since is None:
            return 0.0
        return max(0.0, self.since + self.gap.limit_s - now)

    def words(self, now: float) -> str:
        """For people: "It crosses the mission's gap GCSA -> GCSB, 40 s left"; "" in none."""
        if self.gap is None:
            return ""
        left = f"{self.left_s(now):.0f} s left" if self.since is not None else f"at most {self.gap.limit_s:g} s"
        return f"It crosses the mission's gap {self.gap.words}, {left}"

    def ends_at(self) -> float | None:
        """When that time is over; None while none runs."""
        return None if self.gap is None or self.since is None else self.since + self.gap.limit_s
