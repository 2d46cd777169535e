# SPDX-License-Identifier: GPL-3.0-or-later

"""The places that a return may be sent to: home, the rally points, and where the mission lands.

Rules:

1. Home is where the autopilot has it, which moves when it arms; until it has told, where the plan has it.
2. The commander may replace the rally points (`autopilot/rally_list.py`), for this flight.
3. A place that was found in the autopilot's list after a restart is kept, whoever put it there.
4. A plane without rotors comes down by the landing sequences of the mission that is flown now.
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
    """The candidates of one vehicle. `places` and `finder` are made anew when something that they rest on changes."""

    def __init__(self, state: VehicleState) -> None:
        self._state = state
        #: of the mission that is flown; None before there is one
        self.package: MissionPackage | None = None
        #: its route, or the one that the commander has sent since
        self._flown: Route | None = None
        self.rally: tuple[RallyPoint, ...] = ()
        #: a station has sent these
        self._rally_sent = False
        #: and they are not among the places yet: uploads may come in a row
        self._due = False
        self._found: Place | None = None
        #: home as it is among the places
        self._home: tuple[float, float] | None = None
        self.places: tuple[Place, ...] = ()
        #: what the map and the fence say of a place
        self.finder = PlaceFinder((), Fence(()))
        #: the item after which the mission returns, and where that is; None: it does not
        self.last: tuple[int, tuple[float, float]] | None = None

    # ---- what they rest on ----------------------------------------------------------------------------------------

    def set_mission(self, package: MissionPackage, *, keeps_rally: bool) -> None:
        """The autopilot holds this mission. `keeps_rally`: rally points that a station has sent go on to count."""
        self.package, self._flown = package, package.route
        self.finder = PlaceFinder(package.zones, Fence(package.route.fence), package.relief(self._home))
        self._rally_sent = self._rally_sent and keeps_rally
        if not self._rally_sent:
            self.rally = package.route.rally
        self._found = None
        self.last = before_return(package.route)
        self._gather()

    def reroute(self, route: Route) -> None:
        """Another route is flown than the package's."""
        self._flown = route
        self._gather()

    def replace_rally(self, points: tuple[RallyPoint, ...]) -> None:
        """The commander has sent these rally points. They count from the next `gather_sent` on."""
        self._rally_sent, self._due, self.rally = True, True, points

    def gather_sent(self) -> None:
        """Take the rally points that were sent among the places."""
        if self._due:
            self._due = False
            self._gather()

    def update_home(self) -> None:
        """Follow the autopilot's home, if that has moved."""
        home = self._state.telemetry.home.value
        if home != self._home:
            self._home = home
            self.finder.relief = None if self.package is None else self.package.relief(home)
            self._gather()

    def fence_read(self, parts: tuple[FencePart, ...]) -> None:
        """The geofence that the autopilot holds, for a plan that has none."""
        if self.package is not None:
            self.finder = PlaceFinder(self.package.zones, Fence(parts), self.package.relief(self._home))

    def found_in_list(self, held: RallyPoint) -> Place:
        """The place that the autopilot's list holds after a restart: one that is known, or one that is kept now."""
        known = self.like(held)
        if known is not None:
            return known
        self._found = Place(_FOUND, held.lat_deg, held.lon_deg, held.alt_m)
        self._gather()
        return self.places[-1]

    def landed(self) -> None:
        """The flight is over, and with it what the commander has sent for it."""
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

    # ---- what is asked of them ------------------------------------------------------------------------------------

    def named(self, name: str | None) -> Place | None:
        """The place of this name; None: there is none."""
        return next((place for place in self.places if place.name == name), None)

    def like(self, held: RallyPoint) -> Place | None:
        """The place that is this point in the autopilot's list; None: there is none."""
        return next((place for place in self.places if alike(self.point(place), held)), None)

    def first_point(self, package: MissionPackage) -> RallyPoint:
        """What is written with a plan: home. Where a return goes is judged when the plan is there."""
        home = self._home or (package.route.home.lat_deg, package.route.home.lon_deg)
        return self.point(Place(HOME, *home, 0.0))

    def point(self, place: Place) -> RallyPoint:
        """A place as the autopilot's list holds it, heights in whole metres. What has wings flies there at that height,
        on its wings, so home is no lower than the return that the autopilot would fly without a list."""
        alt_m = place.alt_m
        if self._state.kind.winged:
            ceiling_m, return_m = fence_limits(self._state).ceiling_m, return_alt_m(self._state)
            alt_m = max(alt_m, return_m if ceiling_m is None else min(return_m, ceiling_m - BELOW_CEILING_M))
        return RallyPoint(place.lat_deg, place.lon_deg, float(int(alt_m)))

    def within(self, limits: FenceLimits, place: Place) -> bool:
        """Whether the autopilot's own fences around home and above it hold the place."""
        if limits.ceiling_m is not None and place.alt_m > limits.ceiling_m:
            return False
        home = next(entry for entry in self.places if entry.name == HOME)
        away = distance_m(place.lat_deg, place.lon_deg, home.lat_deg, home.lon_deg)
        return limits.radius_m is None or away <= limits.radius_m

    def inside_fence(self) -> tuple[Place, ...] | None:
        """Places that a return could be sent to, wherever it begins: those inside the fence; None: not known yet."""
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
        """How fast a return is flown (m/s), of wings the airspeed; None: there is no mission."""
        return None if self.package is None else return_mps(self._state, self.package.cruise_speed_mps)
