# SPDX-License-Identifier: GPL-3.0-or-later

"""Where the aircraft is with respect to the zones of its mission."""

from __future__ import annotations

from mavproxy_handover.core.common.model import ModeClass, ZoneFact
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_ahead import RouteAhead
from mavproxy_handover.mission.zones import ZoneFinder
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["ZoneMonitor"]


class ZoneMonitor:
    """The zones of one vehicle's mission package."""

    def __init__(self) -> None:
        self._finder: ZoneFinder | None = None
        self._ahead: RouteAhead | None = None

    def set_mission(self, finder: ZoneFinder, route: Route) -> None:
        """The autopilot holds a package with these zones and this route."""
        self._finder = finder
        self.reroute(route)

    def reroute(self, route: Route) -> None:
        """The autopilot flies another route; the zones of the package stay."""
        self._ahead = RouteAhead(route)

    def facts(self, state: VehicleState) -> tuple[ZoneFact, ...]:
        """Facts about every zone at the last position; empty before a package and a position are known."""
        where = state.where
        if self._finder is None or self._ahead is None or where is None:
            return ()
        lat_deg, lon_deg, alt_m = where
        way = self._ahead.places(state.waypoint, where[:2]) if state.flies_mission else ()
        course_deg, speed_mps = state.track
        if state.profile.holds_by_circling and state.flown is ModeClass.STOP:
            speed_mps = 0.0  # it circles: its course changes all the time
        return self._finder.facts(lat_deg, lon_deg, course_deg, speed_mps, alt_m, way)
