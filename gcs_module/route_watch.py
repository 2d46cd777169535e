# SPDX-License-Identifier: GPL-3.0-or-later

"""The route check of the thesis at the station (section 4.4).

It compares the aircraft's motion with the station's own copy of the mission. So the operator sees a deviation even if
the vehicle does not report it.

Rules that live here
--------------------
* Only the mission that the vehicle announces is used; a station that holds another one, or none, checks nothing.
* HANDOVER_TELEMETRY has priority over the autopilot's own messages: it is signed, and all its values are of one moment.
  An observer gets none, and uses GLOBAL_POSITION_INT, MISSION_CURRENT and HEARTBEAT. It gets MISSION_CURRENT only if it
  asks for it. If one of the three is not fresh, nothing is judged: the aircraft may fly to another item by then.
* The operator is warned once for each deviation, and told when it is over.
"""

from __future__ import annotations

import math
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.events import Notice
from gcs_module.notices import notice
from mavproxy_handover.core.safety.route import RouteCheck, RouteLimits, TrackFact
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.track import Motion, RouteTracker
from mavproxy_handover.vehicle.profiles import ASSUMED, profile_of

__all__ = ["StationRouteWatch"]

#: a message that should come once a second has stopped after this time (s)
_STOPPED_S: Final = 3.0
#: the last known track is shown for this long (s)
_SHOWN_S: Final = 5.0
#: shortest time (s) between two checks: any station may ask for a higher rate of the autopilot's positions
_CHECK_S: Final = 0.18


class StationRouteWatch:
    """The route check for one vehicle at a station. Times are monotonic seconds."""

    def __init__(self, limits: RouteLimits) -> None:
        self._check = RouteCheck(limits)
        self._package: MissionPackage | None = None
        self._tracker: RouteTracker | None = None
        self._telemetry_at = self._checked_at = -math.inf
        #: the number of the mode that flies the mission, by the type in the last heartbeat
        self.auto = ASSUMED.auto
        #: from the autopilot's own messages
        self._in_auto, self._mode_at = False, -math.inf
        self._waypoint, self._waypoint_at = 0, -math.inf
        #: where the aircraft is on its leg, by the last check; None: no leg is flown, or it is not known
        self.track: TrackFact | None = None

    def words(self, now: float) -> str:
        """Where the aircraft is on its leg, for people; "" if that is not known, or no leg is flown."""
        if self.track is None or now - self._checked_at > _SHOWN_S:
            return ""
        return f"{self.track.text}{'' if self._check.deviation is None else ', OFF ROUTE'}"

    def compare_to(self, package: MissionPackage | None) -> None:
        """The package that the vehicle flies; None: this station does not hold it."""
        if package is not self._package:
            self._package = package
            self._tracker = None if package is None else RouteTracker(package.route)

    def on_telemetry(self, m: Any, now: float) -> Notice | None:
        """HANDOVER_TELEMETRY; returns a notice for the operator, if there is one."""
        self._telemetry_at = now
        on_mission = bool(m.armed) and m.custom_mode == self.auto
        return self._check_motion(_motion(m.lat, m.lon, m.vx, m.vy, m.waypoint, on_mission), now)

    def on_autopilot(self, m: Any, now: float) -> Notice | None:
        """A message of the autopilot, of any kind; returns a notice for the operator, if there is one."""
        kind = m.get_type()
        if kind == "HEARTBEAT":
            armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.auto = (profile_of(m.autopilot, m.type) or ASSUMED).auto
            self._in_auto, self._mode_at = armed and m.custom_mode == self.auto, now
        elif kind == "MISSION_CURRENT":
            self._waypoint, self._waypoint_at = m.seq, now
        elif kind == "GLOBAL_POSITION_INT" and self._position_counts(m, now):
            motion = _motion(m.lat, m.lon, m.vx / 100.0, m.vy / 100.0, self._waypoint, self._in_auto)
            return self._check_motion(motion, now)
        return None

    def _position_counts(self, m: Any, now: float) -> bool:
        known = (m.lat != 0 or m.lon != 0) and now - min(self._mode_at, self._waypoint_at) < _STOPPED_S
        return known and now - self._telemetry_at > _STOPPED_S and now - self._checked_at > _CHECK_S

    def _check_motion(self, motion: Motion, now: float) -> Notice | None:
        self._checked_at = now
        self.track = None if self._tracker is None else self._tracker.follow(motion, now)
        news = self._check.update(self.track, now)
        if news is None:
            return None
        text = f"{news.text[:1].upper()}{news.text[1:]}"
        return notice("off_route" if news.off else "on_route", news=text)


def _motion(lat: int, lon: int, north_mps: float, east_mps: float, waypoint: int, on_mission: bool) -> Motion:
    course_deg = math.degrees(math.atan2(east_mps, north_mps)) % 360.0
    return Motion(lat / 1e7, lon / 1e7, course_deg, math.hypot(north_mps, east_mps), waypoint, on_mission)
