# SPDX-License-Identifier: GPL-3.0-or-later

"""Which stations await the aircraft at a waypoint, by what the autopilot says of its mission
(`mission/waypoint_ownership.py`).

Rules
-----
* MISSION_ITEM_REACHED of the item that is flown to counts at once; MISSION_CURRENT says the same up to half a second
  later, when it names the next one. Of any other item it is old, or doubled, and counts for nothing.
* Only AUTO has a next waypoint: in any other mode, on a way back for one, coverage alone counts.
* Where coverage begins to count alone no waypoint has been reached: a station that awaits the aircraft then, inside its
  zone, does so until that zone is left. Else authority would go back and forth with the mode.
* After a start of the companion nothing counts as reached until mode and MISSION_CURRENT are heard: what they say then
  is news, so a waypoint that was reached meanwhile is not lost.
* Where MISSION_CURRENT is missing for `MISSING_S`, coverage alone counts: nobody would be told of a waypoint reached.
* A mission that is not the package's has other waypoints: coverage alone counts.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from mavproxy_handover.core.common.model import ZoneFact
from mavproxy_handover.mission.waypoint_ownership import Belonging
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["MISSING_S", "WaypointMonitor"]

#: the autopilot is asked for two a second
MISSING_S: Final = 5.0


class WaypointMonitor:
    """The waypoints of one vehicle. Times are monotonic seconds."""

    def __init__(self, leave_margin_m: float) -> None:
        """`leave_margin_m`: a zone is left so far outside its border."""
        self._leave_margin_m = leave_margin_m
        self._belonging: Belonging | None = None
        #: since when the autopilot holds this mission, as far as is known
        self._since = 0.0
        #: the item that is flown to is reached
        self._reached = False
        #: who awaited the aircraft of the position before
        self._awaited: frozenset[int] = frozenset()

    def set_owners(self, belonging: Belonging | None, now: float) -> None:
        """The autopilot holds a mission whose waypoints belong to stations; None: another one, or an unknown one."""
        self._belonging, self._since, self._reached = belonging, now, False

    def flies_on(self) -> None:
        """It flies to another item than before."""
        self._reached = False

    def reached(self, state: VehicleState, seq: int) -> int | None:
        """It has reached an item; whose that is, None if it is nobody's."""
        self._reached = self._reached or seq == state.waypoint
        return None if self._belonging is None else self._belonging.owner(seq)

    def marked(self, state: VehicleState, facts: tuple[ZoneFact, ...]) -> tuple[ZoneFact, ...]:
        """The facts of the last position, with whose stations await the state."""
        awaiting = self._told(state)
        if awaiting is None:
            outside = {fact.station for fact in facts if fact.margin_m <= -self._leave_margin_m}
            awaiting = self._awaited - outside
        self._awaited = awaiting
        if not awaiting:
            return facts
        return tuple(replace(fact, awaits=True) if fact.station in awaiting else fact for fact in facts)

    def _told(self, state: VehicleState) -> frozenset[int] | None:
        """Who awaits the aircraft by what the autopilot says; None: coverage alone counts."""
        belonging = self._belonging
        if belonging is None or state.foreign:
            return None
        mode_known = state.telemetry.heartbeat.at > -math.inf
        if mode_known and not state.flies_mission:
            return None
        if state.position.at - max(state.telemetry.waypoint.at, self._since) > MISSING_S:
            return None
        if not mode_known or state.telemetry.waypoint.at < self._since:
            return belonging.stations
        return belonging.awaiting(state.waypoint + self._reached)
