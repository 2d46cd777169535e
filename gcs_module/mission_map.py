# SPDX-License-Identifier: GPL-3.0-or-later

"""The picture of a mission on a map, with any commander: zones, overlaps, route, gaps, and where authority should move.

Pure. The computing time grows with the mission, and missions come from others: run it beside the main loop.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import shapely
from shapely.affinity import rotate
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from gcs_module.map_items import Colour, Line, Paths, Place
from mavproxy_handover.mission.colours import rgb, station_colour
from mavproxy_handover.mission.flat import parts, quiet_place
from mavproxy_handover.mission.gaps import undeclared
from mavproxy_handover.mission.geodesy import LocalPlane
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.route_simulation import Gap, RouteSimulation, by_commander
from mavproxy_handover.mission.zones import Zone, overlap

__all__ = ["Crossing", "MissionMap", "ZoneView", "mission_map"]

_INK: Final[Colour] = (34, 34, 34)
_OVERLAP: Final[Colour] = (150, 150, 150)
_UNCOVERED: Final[Colour] = (230, 0, 0)
#: widths of lines, in pixels
_THIN, _PLAIN, _BROAD = 1, 2, 5
#: corners nearer to a straight line than this (m) are left out
_STRAIGHT_M: Final = 0.5
#: hatch lines of an overlap: about this many, and at most
_HATCHES, _MOST_HATCHES = 8.0, 60.0


@dataclass(frozen=True, slots=True)
class ZoneView:
    """A zone: its outline with holes, its words, and the place for them."""

    station: int
    outline: tuple[Line, ...]
    colour: Colour
    words: tuple[str, ...]
    name_at: Place


@dataclass(frozen=True, slots=True)
class Crossing:
    """A place of the route where authority should move."""

    number: int
    from_station: int
    to_station: int
    place: Place
    along_m: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class MissionMap:
    """The picture of one mission, with any commander."""

    digest: bytes
    zones: tuple[ZoneView, ...]
    overlaps: Paths
    #: the route, its gaps: items by name
    route: Mapping[str, Paths]
    crossings: tuple[Crossing, ...]
    #: where the leg to each item begins, along the route (m)
    begins_m: Mapping[int, float]


def mission_map(package: MissionPackage) -> MissionMap:
    """Compute what a mission shows. The time needed depends on the mission."""
    simulation, plane = package.simulate(), LocalPlane(package.route.home.lat_deg, package.route.home.lon_deg)
    colours = {entry.sysid: rgb(station_colour(number)) for number, entry in enumerate(package.stations)}
    way = LineString([plane.to_plane(sample.lat_deg, sample.lon_deg) for sample in simulation.samples])
    areas = [shapely.union_all(parts(plane, zone.outline())) for zone in package.zones]
    begins_m: dict[int, float] = {}
    for sample in simulation.samples:
        begins_m.setdefault(sample.seq, sample.distance_along_m)
    return MissionMap(
        package.digest,
        tuple(
            _zone_view(zone, area, colours[zone.station], [other for other in areas if other is not area], way, plane)
            for zone, area in zip(package.zones, areas, strict=True)
        ),
        Paths(tuple(_overlaps(package.zones, plane)), _OVERLAP, _THIN),
        _route(package, simulation, colours, plane),
        tuple(
            Crossing(
                number,
                each.from_station,
                each.to_station,
                (each.lat_deg, each.lon_deg),
                each.distance_along_m,
                colours[each.to_station],
            )
            for number, each in enumerate(simulation.handovers, 1)
        ),
        begins_m,
    )


def _zone_view(
    zone: Zone, area: BaseGeometry, colour: Colour, others: Sequence[BaseGeometry], way: LineString, plane: LocalPlane
) -> ZoneView:
    limits = [f"{word} {value:g} m" for word, value in (("above", zone.min_alt_m), ("below", zone.max_alt_m)) if value]
    room = math.sqrt(area.area) / 20.0
    words = (zone.station_name, *((zone.name,) if zone.name else ()), *limits)
    name_at = plane.to_earth(*quiet_place(area, (way.buffer(room), *others)))
    return ZoneView(zone.station, tuple(_rings(shapely.get_parts(area), plane)), colour, words, name_at)


def _rings(areas: Iterable[Polygon], plane: LocalPlane) -> Iterator[Line]:
    for area in areas:
        for ring in (area.exterior, *area.interiors):
            yield _line(ring, plane)


def _line(line: BaseGeometry, plane: LocalPlane) -> Line:
    return tuple(plane.to_earth(x, y) for x, y in line.coords)


def _overlaps(zones: Sequence[Zone], plane: LocalPlane) -> Iterator[Line]:
    """Outlines and hatch lines, so that what is below stays visible."""
    for first, second in combinations(zones, 2):
        for area in parts(plane, overlap(first, second)):
            yield from _rings([area], plane)
            for hatch in shapely.get_parts(shapely.intersection(_hatches(area), area)):
                if isinstance(hatch, LineString) and hatch.length > 0.0:
                    yield _line(hatch, plane)


def _hatches(area: Polygon) -> BaseGeometry:
    """Parallel lines from south-west to north-east across an area."""
    west, south, east, north = area.bounds
    half = math.hypot(east - west, north - south) / 2.0
    step = max(math.sqrt(area.area) / _HATCHES, 2.0 * half / _MOST_HATCHES, 0.1)
    x, y = (west + east) / 2.0, (south + north) / 2.0
    count = math.floor(half / step)
    rows = [[(x - half, y + number * step), (x + half, y + number * step)] for number in range(-count, count + 1)]
    return rotate(shapely.MultiLineString(rows), 45.0, origin=(x, y))


def _route(
    package: MissionPackage, simulation: RouteSimulation, colours: Mapping[int, Colour], plane: LocalPlane
) -> dict[str, Paths]:
    by_station: dict[int, list[Line]] = {}
    for commander, stretch in by_commander(simulation.samples):
        by_station.setdefault(commander, []).append(_way(((s.lat_deg, s.lon_deg) for s in stretch), plane))
    found = {
        f"route {station}": Paths(tuple(line for line in lines if line), colours[station], _PLAIN, edged=True)
        for station, lines in by_station.items()
    }
    open_gaps = undeclared(package.gaps, simulation)
    declared = tuple(gap for gap in simulation.gaps if gap not in open_gaps)
    for name, gaps, colour in (("uncovered", open_gaps, _UNCOVERED), ("gap", declared, _INK)):
        if gaps:
            found[name] = Paths(tuple(_of_gap(gap, simulation, plane) for gap in gaps), colour, _BROAD)
    return found


def _of_gap(gap: Gap, simulation: RouteSimulation, plane: LocalPlane) -> Line:
    first, last = gap.distance_along_m, gap.distance_along_m + gap.length_m
    return _way(((s.lat_deg, s.lon_deg) for s in simulation.samples if first <= s.distance_along_m <= last), plane)


def _way(places: Iterable[Place], plane: LocalPlane) -> Line:
    """A path without the points on straight lines; empty if it only goes up and down."""
    flat = [plane.to_plane(*place) for place in places]
    return _line(LineString(flat).simplify(_STRAIGHT_M), plane) if len(set(flat)) > 1 else ()
