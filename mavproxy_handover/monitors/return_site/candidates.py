# SPDX-License-Identifier: GPL-3.0-or-later

"""The candidates for the return site: home, the rally points, and the mission's landing point.

Rules:

1. Home is the autopilot's home, which moves when it arms. Until the autopilot has sent it, home is that of the plan.
2. The commander may replace the rally points (`operator/return_site/rally_list.py`), for this flight.
3. A site that was found in the autopilot's list after a restart is kept.
4. A plane without rotors lands by the landing sequences of the mission that is flown now.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from mavproxy_handover.mission.energy import Place, places_of, with_ways_down
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.items import RallyPoint, alike
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import FencePart, Route
from mavproxy_handover.mission.return_paths import FenceLimits, PlaceFinder
from mavproxy_handover.mission.returns import before_return
from mavproxy_handover.vehicle.return_limits import BELOW_CEILING_M, fence_limits, return_alt_m, return_mps
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["HOME", "Candidates"]

HOME: Final = "home"
_FOUND: Final = "place found in the list"


class Candidates:
    """The candidates of one vehicle. `places` and `finder` are rebuilt when their inputs change."""

    def __init__(self, state: VehicleState) -> None:
        self._state = state
        #: the package of the mission; None before there is one
        self.package: MissionPackage | None = None
        #: the package's route, or the one that the commander has uploaded since
        self._flown: Route | None = None
        self.rally: tuple[RallyPoint, ...] = ()
        #: the rally points come from a station
        self._rally_sent = False
        #: these rally points are not in `places` yet, because several uploads may follow each other
        self._due = False
        self._found: Place | None = None
        #: home in `places`
        self._home: tuple[float, float] | None = None
        self.places: tuple[Place, ...] = ()
        #: judges a place by map and fence
        self.finder = PlaceFinder((), Fence(()))
        #: the item after which the mission returns, and its position; None: the mission does not return
        self.last: tuple[int, tuple[float, float]] | None = None

    # ---- inputs ---------------------------------------------------------------------------------------------------

    def set_mission(self, package: MissionPackage, *, keeps_rally: bool) -> None:
        """Set the autopilot's mission. `keeps_rally`: rally points that a station has sent still count."""
        self.package, self._flown = package, package.route
        self.finder = PlaceFinder(package.zones, Fence(package.route.fence), package.relief(self._home))
        self._rally_sent = self._rally_sent and keeps_rally
        if not self._rally_sent:
            self.rally = package.route.rally
        self._found = None
        self.last = before_return(package.route)
        self._gather()

    def reroute(self, route: Route) -> None:
        """The aircraft flies another route than the package's."""
        self._flown = route
        self._gather()

    def replace_rally(self, points: tuple[RallyPoint, ...]) -> None:
        """The commander has sent these rally points. They count from the next `gather_sent` on."""
        self._rally_sent, self._due, self.rally = True, True, points

    def gather_sent(self) -> None:
        """Add the rally points that were sent to `places`."""
        if self._due:
            self._due = False
            self._gather()

    def update_home(self) -> None:
        """Follow the autopilot's home if it has moved."""
        home = self._state.telemetry.home.value
        if home != self._home:
            self._home = home
            self.finder.relief = None if self.package is None else self.package.relief(home)
            self._gather()

    def fence_read(self, parts: tuple[FencePart, ...]) -> None:
        """Set the autopilot's geofence, for a plan that has none."""
        if self.package is not None:
            self.finder = PlaceFinder(self.package.zones, Fence(parts), self.package.relief(self._home))

    def found_in_list(self, held: RallyPoint) -> Place:
        """The place in the autopilot's list after a restart: a known place, or a new one that is kept."""
        known = self.like(held)
        if known is not None:
            return known
        self._found = Place(_FOUND, held.lat_deg, held.lon_deg, held.alt_m)
        self._gather()
        return self.places[-1]

    def landed(self) -> None:
        """The flight is over, and the rally points that the commander has sent for it end."""
        self._found = None
        if self.package is not None:
            self.rally, self._rally_sent = self.package.route.rally, False
            self._gather()

    def _gather(self) -> None:
        if self.package is None or self._flown is None:
            return
        route = replace(self.package.route, rally=self.rally)
        places = [
            replace(place, lat_deg=self._home[0], lon_deg=self._home[1])
            if place.name == HOME and self._home is not None
            else place
            for place in places_of(route)
        ]
        if self._found is not None and not any(alike(self.point(self._found), self.point(place)) for place in places):
            places.append(self._found)
        self.places = with_ways_down(places, self._flown, self.package.cruise_speed_mps)

    # ---- queries --------------------------------------------------------------------------------------------------

    def named(self, name: str | None) -> Place | None:
        """The candidate of this name; None: there is none."""
        return next((place for place in self.places if place.name == name), None)

    def like(self, held: RallyPoint) -> Place | None:
        """The candidate that equals this point of the autopilot's list; None: there is none."""
        return next((place for place in self.places if alike(self.point(place), held)), None)

    def first_point(self, package: MissionPackage) -> RallyPoint:
        """The rally point that is written with a plan: home. The return site is judged after the plan was loaded."""
        home = self._home or (package.route.home.lat_deg, package.route.home.lon_deg)
        return self.point(Place(HOME, *home, 0.0))

    def point(self, place: Place) -> RallyPoint:
        """A place as the autopilot's list holds it, heights in whole metres. A level return is flown there at
        that height, so home is no lower than the return that the autopilot would fly without a list."""
        alt_m = place.alt_m
        if self._state.profile.returns_level:
            ceiling_m, return_m = fence_limits(self._state).ceiling_m, return_alt_m(self._state)
            alt_m = max(alt_m, return_m if ceiling_m is None else min(return_m, ceiling_m - BELOW_CEILING_M))
        return RallyPoint(place.lat_deg, place.lon_deg, float(int(alt_m)))

    def within(self, limits: FenceLimits, place: Place) -> bool:
        """Whether the place is inside the autopilot's own fences around home and above it."""
        if limits.ceiling_m is not None and place.alt_m > limits.ceiling_m:
            return False
        home = next(entry for entry in self.places if entry.name == HOME)
        away = distance_m(place.lat_deg, place.lon_deg, home.lat_deg, home.lon_deg)
        return limits.radius_m is None or away <= limits.radius_m

    def inside_fence(self) -> tuple[Place, ...] | None:
        """The candidates inside the fence; None: not known yet."""
        if not self.places:
            return None
        limits = fence_limits(self._state)
        return tuple(
            place
            for place in self.places
            if self.finder.in_fence((place.lat_deg, place.lon_deg)) and self.within(limits, place)
        )

    @property
    def return_mps(self) -> float | None:
        """The speed of a return (m/s), an airspeed for wings; None: there is no mission."""
        return None if self.package is None else return_mps(self._state, self.package.cruise_speed_mps)
