# SPDX-License-Identifier: GPL-3.0-or-later

"""Predicts where the RTL item of a mission ends: at the place that the autopilot's rally list will hold.

That is the best return site by the rule of `core/safety/return_site.py`, with what is known before the flight.
Assumptions: every station of the mission is there and could take the aircraft. The energy is enough for any of the
sites, there is no wind, and the fence is the plan's. The return begins where the item before it ends, at its height;
with wings it leads down to the height of ArduPlane's own returns. In flight the companion chooses by the facts, so a
mission may end at another site.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from mavproxy_handover.core.safety.return_site import PlaceFact, best
from mavproxy_handover.mission.energy import LANDING, places_of
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.items import RETURN_TO_LAUNCH
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.return_paths import PlaceFinder
from mavproxy_handover.mission.route_simulation import legs_of
from mavproxy_handover.mission.terrain import Terrain, relief_of
from mavproxy_handover.mission.zones import Zone

__all__ = ["before_return", "with_return"]

#: of more sites than this, which is more than an autopilot holds, only the nearest are checked
_MOST: Final = 64


def before_return(route: Route) -> tuple[int, tuple[float, float]] | None:
    """The last item that is flown before the route returns, and where it ends (degrees); None: it does not return."""
    number = next((n for n, item in enumerate(route.items) if item.command == RETURN_TO_LAUNCH), None)
    legs = () if number is None else legs_of(replace(route, items=route.items[:number]))
    return (legs[-1].seq, legs[-1].end[:2]) if legs else None


def with_return(route: Route, zones: Sequence[Zone], terrain: Terrain | None) -> Route:
    """The same route, and where its RTL item ends; one without such an item comes back as it is."""
    number = next((n for n, item in enumerate(route.items) if item.command == RETURN_TO_LAUNCH), None)
    if number is None:
        return route
    legs = legs_of(replace(route, items=route.items[:number]))
    lat, lon, alt = legs[-1].end if legs else (route.home.lat_deg, route.home.lon_deg, 0.0)
    if route.profile.returns_level:
        alt = route.profile.energy.return_alt_m
    finder = PlaceFinder(zones, Fence(route.fence), relief_of(terrain, route.home))
    # the landing is the result of the search
    far = [(distance_m(lat, lon, p.lat_deg, p.lon_deg), p) for p in places_of(route) if p.name != LANDING]
    facts, spots = [], {}
    for away, place in sorted(far, key=lambda entry: entry[0])[:_MOST]:
        spot = spots[place.name] = (place.lat_deg, place.lon_deg)
        view = finder.evaluate((lat, lon), spot, max(alt, place.alt_m))
        facts.append(
            PlaceFact(
                place.name,
                away,
                away,
                inside=view.inside,
                way_inside=view.way_inside,
                there=view.there,
                way=view.way,
                way_clear=view.way_clear,
            )
        )
    found = best(facts, {zone.station for zone in zones})
    return route if found is None else replace(route, return_to=spots[found.name])
