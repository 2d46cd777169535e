# SPDX-License-Identifier: GPL-3.0-or-later

"""The border monitor: finds each second the borders of zones ahead on the mission's way.

It works only in AUTO with a mission that the companion knows: that of the package, or one that the commander has
uploaded in flight and that was read back.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.events import BordersSeen, Event
from mavproxy_handover.core.common.model import BorderFact
from mavproxy_handover.mission.crossings import Seen, WayAhead
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["BorderMonitor"]

#: borders are looked for this much (s) further ahead than an operator may take to answer
_BEYOND_S: Final = 15.0


class BorderMonitor:
    """The way ahead of one vehicle. Times are monotonic seconds."""

    def __init__(self, operator_timeout_s: float) -> None:
        """`operator_timeout_s`: the time that an operator has to answer."""
        self._within_s = operator_timeout_s + _BEYOND_S
        self._way: WayAhead | None = None
        #: counts the missions
        self._route = 0
        self._told = BordersSeen(())

    def set_way(self, way: WayAhead | None) -> None:
        """Set the way of the autopilot's mission; None: not known."""
        self._way = way
        self._route += 1

    def update(self, state: VehicleState, now: float) -> list[Event]:
        """Returns the borders ahead each time; if there are none, once."""
        seen = BordersSeen(self._ahead(state, now), self._route)
        if not seen.borders and seen == self._told:
            return []
        self._told = seen
        return [seen]

    def _ahead(self, state: VehicleState, now: float) -> tuple[BorderFact, ...]:
        if self._way is None or state.where is None or not state.flying or state.foreign:
            return ()
        if not state.flies_mission:
            return ()
        seen = Seen(state.waypoint, *state.where, state.track[1], now)
        return self._way.borders(seen, self._within_s)
