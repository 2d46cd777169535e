# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones from waypoint lists: the third form of coverage in the thesis.

A station lists the items of the route that it covers. Its zone is all places within `corridor_m` of these waypoints,
and of the legs between those that follow one another on the route. So two stations that share one waypoint have a
handover region of at least twice that width around it. Two that share two waypoints have one along the whole leg. Such
a zone is an area like any other: finder, check and map need no other rules, and an aircraft that is blown off its route
leaves the zone as it should. If each waypoint belongs to one station and decides by being reached
(`waypoint_ownership.py`), the areas are made in the same way.
"""

from __future__ import annotations

from collections.abc import Collection

import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.geodesy import beside_deg, degree_lengths_m
from mavproxy_handover.mission.items import COMMANDS
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import legs_of

__all__ = ["covered_area"]


def covered_area(where: Where, route: Route, waypoints: Collection[int], corridor_m: float) -> Polygon | MultiPolygon:
    """The area, in (longitude, latitude), of a station that covers the items `waypoints` of the route.

    Longitudes are counted to the side of the 180th meridian where home is, beyond 180 where they have to be. The width
    is measured by the scale at home: 5 km north or south of it, it is 0.1 % off. Raises MissionError for an item that
    is not flown to.
    """
    listed = set(waypoints)
    for seq in sorted(listed):
        if seq > len(route.items):
            raise where.error(f"waypoint {seq} is not on the route (allowed: 1 to {len(route.items)})")
        command = COMMANDS[route.items[seq - 1].command]
        if not command.flown:
            raise where.error(f"waypoint {seq} is {command.name} (allowed: an item that is flown to)")
    per_lat, per_lon = degree_lengths_m(route.home.lat_deg)
    runs: list[list[tuple[float, float]]] = [[]]
    for seq, places in _flown_places(route).items():
        if seq in listed:
            runs[-1] += [(beside_deg(lon, route.home.lon_deg) * per_lon, lat * per_lat) for lat, lon in places]
        elif runs[-1]:
            runs.append([])
    lines = [LineString(run) if len(set(run)) > 1 else Point(run[0]) for run in runs if run]
    grown = shapely.union_all([line.buffer(corridor_m) for line in lines])
    area = shapely.transform(grown, lambda corners: corners / [per_lon, per_lat])
    assert isinstance(area, Polygon | MultiPolygon)
    return area


def _flown_places(route: Route) -> dict[int, tuple[tuple[float, float], ...]]:
    """Latitude and longitude where each flown item ends, in the order flown; of circles and splines the whole curve."""
    ends: dict[int, tuple[tuple[float, float], ...]] = {}
    for leg in legs_of(route):
        ends[leg.seq] = (*(ends.get(leg.seq, ()) if leg.curved else ()), leg.end[:2])
    before: tuple[tuple[float, float], ...] = ((route.home.lat_deg, route.home.lon_deg),)
    places = {}
    for item in route.items:
        if COMMANDS[item.command].flown:
            before = places[item.seq] = ends.get(item.seq, before[-1:])
    return places
