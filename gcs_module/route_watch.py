# SPDX-License-Identifier: GPL-3.0-or-later

"""The route check of the thesis at the station (section 4.4): what it hears of the aircraft against its own copy of the
mission, so that its operator sees a deviation even if the vehicle says nothing of it.

Rules that live here
--------------------
* Only the mission that the vehicle announces is compared to; a station that holds another one, or none, checks nothing.
* HANDOVER_TELEMETRY goes before what the autopilot itself is heard to say: it is signed, and all its values are of one
  moment. An observer, who is sent none, goes by GLOBAL_POSITION_INT, MISSION_CURRENT and HEARTBEAT. It gets the second
  of them only if it asks for it, and where one of the three is not fresh nothing is judged: the item that was flown to
  when it was heard last is none that the aircraft could be off.
* The operator is warned once for each deviation, and told when it is over.
"""

from __future__ import annotations

import math
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.events import Notice
from mavproxy_handover.core.safety.route import RouteCheck, RouteLimits, TrackFact
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.track import Motion, RouteTracker
from mavproxy_handover.vehicle.profiles import ASSUMED, profile_of

__all__ = ["StationRouteWatch"]

#: what comes once a second has stopped
_STOPPED_S: Final = 3.0
#: so long (s) the last that is known is worth showing
_SHOWN_S: Final = 5.0
#: positions of the autopilot come at whatever rate somebody has asked for
_LOOK_S: Final = 0.18


class StationRouteWatch:
    """One vehicle, as this station hears of it. Times are monotonic seconds."""

    def __init__(self, limits: RouteLimits) -> None:
        self._check = RouteCheck(limits)
        self._package: MissionPackage | None = None
        self._tracker: RouteTracker | None = None
        self._telemetry_at = self._looked_at = -math.inf
        #: the number of the mode that flies the mission, by the last heartbeat
        self.auto = ASSUMED.auto
        #: of the autopilot's own messages
        self._in_auto, self._mode_at = False, -math.inf
        self._waypoint, self._waypoint_at = 0, -math.inf
        #: where the aircraft is on its leg, as of the last look; None: no leg is flown, or nothing is known
        self.track: TrackFact | None = None

    def words(self, now: float) -> str:
        """Where the aircraft is on its leg, for people; "" where that is not known, or none is flown."""
        if self.track is None or now - self._looked_at > _SHOWN_S:
            return ""
        return f"{self.track.text}{'' if self._check.deviation is None else ', OFF ROUTE'}"

    def compare_to(self, package: MissionPackage | None) -> None:
        """The vehicle flies this package; None: this station does not hold the one that it flies."""
        if package is not self._package:
            self._package = package
            self._tracker = None if package is None else RouteTracker(package.route)

    def on_telemetry(self, m: Any, now: float) -> Notice | None:
        """HANDOVER_TELEMETRY; returns what the operator is to be told."""
        self._telemetry_at = now
        on_mission = bool(m.armed) and m.custom_mode == self.auto
        return self._look(_motion(m.lat, m.lon, m.vx, m.vy, m.waypoint, on_mission), now)

    def on_autopilot(self, m: Any, now: float) -> Notice | None:
        """A message of the autopilot itself, of any kind; returns the same."""
        kind = m.get_type()
        if kind == "HEARTBEAT":
            armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.auto = (profile_of(m.autopilot, m.type) or ASSUMED).auto
            self._in_auto, self._mode_at = armed and m.custom_mode == self.auto, now
        elif kind == "MISSION_CURRENT":
            self._waypoint, self._waypoint_at = m.seq, now
        elif kind == "GLOBAL_POSITION_INT" and self._position_counts(m, now):
            motion = _motion(m.lat, m.lon, m.vx / 100.0, m.vy / 100.0, self._waypoint, self._in_auto)
            return self._look(motion, now)
        return None

    def _position_counts(self, m: Any, now: float) -> bool:
        known = (m.lat != 0 or m.lon != 0) and now - min(self._mode_at, self._waypoint_at) < _STOPPED_S
        return known and now - self._telemetry_at > _STOPPED_S and now - self._looked_at > _LOOK_S

    def _look(self, motion: Motion, now: float) -> Notice | None:
        self._looked_at = now
        self.track = None if self._tracker is None else self._tracker.follow(motion, now)
        news = self._check.look(self.track, now)
        if news is None:
            return None
        text = f"{news.text[:1].upper()}{news.text[1:]}, as this station sees it."
        return Notice("off_route" if news.off else "on_route", text)


def _motion(lat: int, lon: int, north_mps: float, east_mps: float, waypoint: int, on_mission: bool) -> Motion:
    course_deg = math.degrees(math.atan2(east_mps, north_mps)) % 360.0
    return Motion(lat / 1e7, lon / 1e7, course_deg, math.hypot(north_mps, east_mps), waypoint, on_mission)
