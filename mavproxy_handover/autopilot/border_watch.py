# SPDX-License-Identifier: GPL-3.0-or-later

"""Tells the rules, each second, which borders of zones are ahead on the way of the mission.

Only while that mission is flown, in AUTO, and the companion knows it: the package's that it has written itself, or the
one that the commander has sent in flight and that was read back.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.core.events import BordersSeen
from mavproxy_handover.core.model import BorderFact
from mavproxy_handover.mission.crossings import Seen, WayAhead
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["BorderWatch"]

#: so much longer than an operator may take (s)
_BEYOND_S: Final = 15.0


class BorderWatch:
    """The way ahead of one vehicle. Times are monotonic seconds."""

    def __init__(self, operator_timeout_s: float, aircraft: VehicleState, ties: Ties) -> None:
        """`operator_timeout_s`: as long as an operator who is asked may take."""
        self._within_s = operator_timeout_s + _BEYOND_S
        self._aircraft = aircraft
        self._ties = ties
        self._way: WayAhead | None = None
        #: counts the missions
        self._route = 0
        self._told = BordersSeen(())

    def adopt(self, way: WayAhead | None) -> None:
        """The autopilot holds a mission with this way; None: nobody knows which one."""
        self._way = way
        self._route += 1

    def each_second(self, now: float) -> None:
        """Tell what is ahead; where there is nothing, once."""
        seen = BordersSeen(self._ahead(now), self._route)
        if seen.borders or seen != self._told:
            self._told = seen
            self._ties.handle(seen, now)

    def _ahead(self, now: float) -> tuple[BorderFact, ...]:
        aircraft = self._aircraft
        if self._way is None or aircraft.where is None or not aircraft.flying or aircraft.foreign:
            return ()
        if not aircraft.flies_mission:
            return ()
        seen = Seen(aircraft.waypoint, *aircraft.where, aircraft.track[1], now)
        return self._way.borders(seen, self._within_s)
