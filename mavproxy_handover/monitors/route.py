# SPDX-License-Identifier: GPL-3.0-or-later

"""The route check on the vehicle: feeds position and current item into the check of `core/safety/route.py`.

It returns news for the journal. The safety decisions read `deviation` (cause `off_route`), and tell the stations. The
route is that of the mission on the autopilot (`operator/uploads/flown_mission.py`). If that mission is not known,
nothing is expected of the aircraft. Height is not judged.
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.core.safety.route import RouteCheck, RouteLimits, RouteNews, TrackFact
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.track import Motion, RouteTracker
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["RouteMonitor"]

#: least interval (s) of the checks: a deviation lasts for seconds, so not each of the 20 positions a second is checked
_LOOK_S: Final = 0.18
#: after this time (s) without MISSION_CURRENT or HEARTBEAT, which come at least once a second, nothing is checked
_STOPPED_S: Final = 3.0
#: for this time (s) the last result is shown
_SHOWN_S: Final = 5.0


class RouteMonitor:
    """The route check of one aircraft; `update` after each position. Times are monotonic seconds."""

    def __init__(self, limits: RouteLimits) -> None:
        self._check = RouteCheck(limits)
        self._tracker: RouteTracker | None = None
        self._looked_at = -math.inf
        #: position on the leg at the last check, which `words` shows for _SHOWN_S; None: no leg is flown
        self.track: TrackFact | None = None

    @property
    def deviation(self) -> TrackFact | None:
        """The position on the leg while the aircraft is off its route; else None.

        Without a check it stays as it was: a deviation is over only after the aircraft was seen on its route again.
        """
        return self._check.deviation

    def words(self, now: float) -> str:
        """The position on the leg, for people; "" if not known, or if no leg is flown."""
        if self.track is None or now - self._looked_at > _SHOWN_S:
            return ""
        return f"{self.track.text}{'' if self.deviation is None else ', OFF ROUTE'}"

    def set_route(self, route: Route | None) -> None:
        """Set the autopilot's route; None: not known."""
        self._tracker = None if route is None else RouteTracker(route)

    def update(self, state: VehicleState, now: float) -> list[RouteNews]:
        """Compare the last position with the leg that is flown, if the last check is old enough."""
        if now - self._looked_at < _LOOK_S:
            return []
        # without these two messages it is not known to which item the aircraft flies
        if now - min(state.telemetry.waypoint.at, state.telemetry.heartbeat.at) > _STOPPED_S:
            return []
        self._looked_at = now
        motion = self._motion(state)
        self.track = None if self._tracker is None or motion is None else self._tracker.follow(motion, now)
        news = self._check.update(self.track, now)
        return [] if news is None else [news]

    @staticmethod
    def _motion(state: VehicleState) -> Motion | None:
        if state.where is None:
            return None
        lat_deg, lon_deg, _alt_m = state.where
        on_mission = state.flying and state.flies_mission and not state.foreign
        return Motion(lat_deg, lon_deg, *state.track, state.waypoint, on_mission)
