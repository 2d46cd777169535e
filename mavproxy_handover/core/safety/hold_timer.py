# SPDX-License-Identifier: GPL-3.0-or-later

"""How long the aircraft has been held, and how long it may still be.

Rules
-----
* The time runs from the order to hold. Another cause gives no new time, and neither does an order after the hold that
  has not moved the aircraft.
* A command of the commander, a pilot or a failsafe ends it: then the aircraft no longer stands by an order.
* A restart of the companion does not end a hold. The next run continues it for the time that is left (`resume`). Until
  that run knows that the aircraft flies, and where, the aircraft counts as being where it can be held (`resuming`).
"""

from __future__ import annotations

from math import inf
from typing import Final

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.safety.emergency import News

__all__ = ["HoldTimer"]

#: before every clock's beginning (s): no hold time is left from then
_LONG_AGO: Final = -1e9


class HoldTimer:
    """The hold time of one aircraft. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_limits", "_used_up", "held_at", "resuming")

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        #: since when the aircraft is held; -inf if it is not
        self.held_at = -inf
        #: at the last check the time was used up
        self._used_up = False
        #: the aircraft stood by an order before a restart, and this run has had no position yet
        self.resuming = False

    def resume(self, since: float | None, *, certain: bool) -> None:
        """The aircraft stood by an order of the run before, and stands until something else shows.

        `since`: when it was held; None: it was told to go on already. `certain` False: the clock of the run before
        says nothing here, so no time is left.
        """
        self.held_at = -inf if since is None else since if certain else _LONG_AGO
        self.resuming = True

    def resume_hold(self, since: float | None, *, certain: bool) -> None:
        """The run before held the aircraft; `since`, `certain` as in `resume`. Without `since` no time is left."""
        self.resume(_LONG_AGO if since is None else since, certain=certain)

    def decided(self, news: News, now: float, *, stands: bool) -> None:
        """A decision is news. `stands`: the aircraft was held, and nothing shows that it no longer is."""
        if news.holds:
            self.held_at = self.held_at if stands and self.held_at > -inf else now
        elif news.mends or not stands:
            self.held_at = -inf

    def overridden(self) -> None:
        """The commander, a pilot or a failsafe says how the aircraft flies."""
        self.held_at = -inf

    def aircraft_known(self) -> None:
        """The state of the aircraft is known: it flies and has a position, or it is on the ground."""
        self.resuming = False

    def used_up(self, now: float) -> bool:
        """Whether the aircraft has been held as long as it may be."""
        self._used_up = self.held_at > -inf and now >= self.held_at + self._limits.hold_s
        return self._used_up

    def due_at(self) -> float | None:
        """When the time will be used up; None if no time runs."""
        return None if self.held_at == -inf or self._used_up else self.held_at + self._limits.hold_s
