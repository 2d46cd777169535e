# SPDX-License-Identifier: GPL-3.0-or-later

"""The waypoint monitor: which stations await the aircraft at a waypoint (`mission/waypoint_ownership.py`).

Rules
-----
* MISSION_ITEM_REACHED of the target item counts at once. MISSION_CURRENT shows the same up to half a second later, when
  it names the next item. MISSION_ITEM_REACHED of any other item is old or doubled, and is ignored.
* Only AUTO has a next waypoint: in any other mode, for example in a return, only coverage counts.
* When only coverage begins to count, no waypoint has been reached. A station that awaits the aircraft then, inside its
  zone, keeps awaiting it until the aircraft leaves that zone. Otherwise authority would change with each mode.
* After a start of the companion nothing counts as reached until mode and MISSION_CURRENT have arrived. Their first
  values are news, so a waypoint that was reached meanwhile is not lost.
* If MISSION_CURRENT is missing for `MISSING_S`, only coverage counts: the companion would not notice a waypoint.
* A mission other than the package's has other waypoints: only coverage counts.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from mavproxy_handover.core.common.model import ZoneFact
from mavproxy_handover.mission.waypoint_ownership import Belonging
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["MISSING_S", "WaypointMonitor"]

#: the companion requests two messages a second
MISSING_S: Final = 5.0


class WaypointMonitor:
    """The waypoints of one vehicle. Times are monotonic seconds."""

    def __init__(self, leave_margin_m: float) -> None:
        """`leave_margin_m`: the distance outside its border at which a zone is left."""
        self._leave_margin_m = leave_margin_m
        self._belonging: Belonging | None = None
        #: when the autopilot got this mission, as far as is known
        self._since = 0.0
        #: the target item is reached
        self._reached = False
        #: the stations that awaited the aircraft at the previous position
        self._awaited: frozenset[int] = frozenset()

    def set_owners(self, belonging: Belonging | None, now: float) -> None:
        """Set the owners of the waypoints of the autopilot's mission; None: it has none, or is not known."""
        self._belonging, self._since, self._reached = belonging, now, False

    def flies_on(self) -> None:
        """The aircraft flies to another item than before."""
        self._reached = False

    def reached(self, state: VehicleState, seq: int) -> int | None:
        """An item is reached. Returns the station that owns it; None: no station."""
        self._reached = self._reached or seq == state.waypoint
        return None if self._belonging is None else self._belonging.owner(seq)

    def marked(self, state: VehicleState, facts: tuple[ZoneFact, ...]) -> tuple[ZoneFact, ...]:
        """The facts of the last position, with a mark for stations that await the aircraft."""
        awaiting = self._told(state)
        if awaiting is None:
            outside = {fact.station for fact in facts if fact.margin_m <= -self._leave_margin_m}
            awaiting = self._awaited - outside
        self._awaited = awaiting
        if not awaiting:
            return facts
        return tuple(replace(fact, awaits=True) if fact.station in awaiting else fact for fact in facts)

    def _told(self, state: VehicleState) -> frozenset[int] | None:
        """The stations that await the aircraft, by the autopilot's messages; None: only coverage counts."""
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
