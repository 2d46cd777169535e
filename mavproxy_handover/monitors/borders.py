# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds, each second, which borders of zones are ahead on the way of the mission.

Only while that mission is flown, in AUTO, and the companion knows it: the package's that it has written itself, or the
one that the commander has sent in flight and that was read back.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.events import BordersSeen, Event
from mavproxy_handover.core.common.model import BorderFact
from mavproxy_handover.mission.crossings import Seen, WayAhead
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["BorderMonitor"]

#: so much longer than an operator may take (s)
_BEYOND_S: Final = 15.0


class BorderMonitor:
    """The way ahead of one vehicle. Times are monotonic seconds."""

    def __init__(self, operator_timeout_s: float) -> None:
        """`operator_timeout_s`: as long as an operator who is asked may take."""
        self._within_s = operator_timeout_s + _BEYOND_S
        self._way: WayAhead | None = None
        #: counts the missions
        self._route = 0
        self._told = BordersSeen(())

    def set_way(self, way: WayAhead | None) -> None:
        """The autopilot holds a mission with this way; None: nobody knows which one."""
        self._way = way
        self._route += 1

    def update(self, state: VehicleState, now: float) -> list[Event]:
        """What is ahead, each time; nothing ahead, once."""
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
