# SPDX-License-Identifier: GPL-3.0-or-later

"""The route check on the vehicle: the aircraft against the mission that the companion has written.

It finds news for the journal, and offers what it knows; it orders nothing, and people are told by the safety
decisions. A mission that somebody has written since is not known here, and so is nothing expected of the aircraft then.
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.core.safety.route import RouteCheck, RouteLimits, RouteNews, TrackFact
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.track import Motion, RouteTracker
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["RouteMonitor"]

#: a position comes 20 times a second; what is judged over seconds needs fewer
_LOOK_S: Final = 0.18
#: what comes once a second, or oftener, has stopped
_STOPPED_S: Final = 3.0
#: so long (s) the last that is known is worth showing
_SHOWN_S: Final = 5.0


class RouteMonitor:
    """Of one aircraft; `update` after each position. Times are monotonic seconds."""

    def __init__(self, limits: RouteLimits) -> None:
        self._check = RouteCheck(limits)
        self._tracker: RouteTracker | None = None
        self._looked_at = -math.inf
        #: where the aircraft is on its leg, as of the last look; None: no leg is flown
        self.track: TrackFact | None = None

    @property
    def deviation(self) -> TrackFact | None:
        """The same while the aircraft is off its route; None while it is not."""
        return self._check.deviation

    def words(self, now: float) -> str:
        """Where the aircraft is on its leg, for people; "" where that is not known, or none is flown."""
        if self.track is None or now - self._looked_at > _SHOWN_S:
            return ""
        return f"{self.track.text}{'' if self.deviation is None else ', OFF ROUTE'}"

    def set_route(self, route: Route | None) -> None:
        """The autopilot holds this route; None: nobody knows which one."""
        self._tracker = None if route is None else RouteTracker(route)

    def update(self, state: VehicleState, now: float) -> list[RouteNews]:
        """Compare the last position to the leg that is flown, if there was none just now."""
        heard_at = min(state.telemetry.waypoint.at, state.telemetry.heartbeat.at)
        if now - self._looked_at < _LOOK_S or now - heard_at > _STOPPED_S:  # what it flies to is not known
            return []
        self._looked_at = now
        motion = self._motion(state)
        self.track = None if self._tracker is None or motion is None else self._tracker.follow(motion, now)
        news = self._check.look(self.track, now)
        return [] if news is None else [news]

    @staticmethod
    def _motion(state: VehicleState) -> Motion | None:
        if state.where is None:
            return None
        lat_deg, lon_deg, _alt_m = state.where
        on_mission = state.flying and state.flies_mission and not state.foreign
        return Motion(lat_deg, lon_deg, *state.track, state.waypoint, on_mission)
