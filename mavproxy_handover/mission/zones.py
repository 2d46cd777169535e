# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones of coverage, and the finder that turns a position into facts about them.

A zone is a circle or one or more polygons (with holes), edges straight in longitude and latitude. The finder answers
for every station, many times a second: how far is the border, on which side of it is the aircraft, and when will it
be crossed. It measures in the plane that touches the earth at the aircraft, so the scale is right where the decision
falls; for borders far away, where that plane is a little off, the nearest points are measured again on the ellipsoid.

Altitude limits are metres above home. They only decide between inside and outside: a margin inside is horizontal, for
an aircraft that cruises just below the ceiling is not about to leave. Outside, the way back counts, upwards too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import shapely
from shapely.geometry import MultiPolygon, Polygon

from mavproxy_handover.core.facts import ZoneFact
from mavproxy_handover.mission.geodesy import degree_lengths_m, distance_m, offset, wrap_longitude_deg

__all__ = ["Circle", "Zone", "ZoneFinder", "overlap"]

#: slower than this a track says nothing about where the aircraft will be
SLOWEST_TRACK_MPS = 0.5
#: how far ahead `exit_s` looks
HORIZON_S = 300.0
#: corners of the polygon that stands for a circle where areas are compared or drawn
CIRCLE_CORNERS = 128

#: borders nearer than this are measured in the plane at the aircraft alone: off by less than 0.02 %
_NEAR_M = 500.0
_EARTH_RADIUS_M = 6371000.0
_ROUNDING_M = 0.01


@dataclass(frozen=True, slots=True)
class Circle:
    """All places within `radius_m` of a point."""

    lat_deg: float
    lon_deg: float
    radius_m: float

    def outline(self) -> Polygon:
        """The circle as a polygon in (longitude, latitude), corners on the circle."""
        corners = []
        for n in range(CIRCLE_CORNERS):
            turn = 2.0 * math.pi * n / CIRCLE_CORNERS
            east, north = self.radius_m * math.sin(turn), self.radius_m * math.cos(turn)
            lat, lon = offset(self.lat_deg, self.lon_deg, east, north)
            corners.append((lon, lat))
        return Polygon(corners)


@dataclass(frozen=True, slots=True)
class Zone:
    """The coverage of one station.

    `area` is a circle, or a shapely polygon or multi-polygon in (longitude, latitude). `station` is the system id;
    altitude limits are metres above home, None where there is none.
    """

    station: int
    station_name: str
    area: Circle | Polygon | MultiPolygon
    name: str = ""
    min_alt_m: float | None = None
    max_alt_m: float | None = None

    def outline(self) -> Polygon | MultiPolygon:
        """The area in (longitude, latitude); a circle as a polygon of 128 corners."""
        return self.area.outline() if isinstance(self.area, Circle) else self.area

    def altitude_excess_m(self, alt_m: float | None) -> float:
        """How far `alt_m` (above home) is outside the altitude limits; 0 within them, or when it is not known."""
        if alt_m is None:
            return 0.0
        below = 0.0 if self.min_alt_m is None else self.min_alt_m - alt_m
        above = 0.0 if self.max_alt_m is None else alt_m - self.max_alt_m
        return max(0.0, below, above)


def overlap(first: Zone, second: Zone) -> Polygon | MultiPolygon:
    """The handover region of two zones in (longitude, latitude); empty where they do not overlap."""
    lowest = max((z.min_alt_m for z in (first, second) if z.min_alt_m is not None), default=-math.inf)
    highest = min((z.max_alt_m for z in (first, second) if z.max_alt_m is not None), default=math.inf)
    if lowest >= highest:
        return Polygon()
    common = first.outline().intersection(second.outline())
    parts = [part for part in shapely.get_parts(common) if isinstance(part, Polygon)]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


class _Shape(Protocol):
    """The horizontal half of a zone. `scale` is metres per degree of latitude and of longitude at the aircraft."""

    def contains(self, lat: float, lon: float) -> bool: ...

    def border_m(self, lat: float, lon: float, scale: tuple[float, float]) -> float: ...

    def exit_m(self, lat: float, lon: float, scale: tuple[float, float], east: float, north: float) -> float:
        """Metres along the direction (`east`, `north`), from a place inside, until the border is crossed."""
        ...


class _CircleShape:
    def __init__(self, circle: Circle) -> None:
        self._lat, self._lon, self._radius = circle.lat_deg, circle.lon_deg, circle.radius_m

    def contains(self, lat: float, lon: float) -> bool:
        return distance_m(lat, lon, self._lat, self._lon) < self._radius

    def border_m(self, lat: float, lon: float, scale: tuple[float, float]) -> float:
        return abs(self._radius - distance_m(lat, lon, self._lat, self._lon))

    def exit_m(self, lat: float, lon: float, scale: tuple[float, float], east: float, north: float) -> float:
        x = wrap_longitude_deg(self._lon - lon) * scale[1]
        y = (self._lat - lat) * scale[0]
        along, across = x * east + y * north, x * north - y * east
        return along + math.sqrt(max(0.0, self._radius * self._radius - across * across))


class _PolygonShape:
    def __init__(self, area: Polygon | MultiPolygon) -> None:
        self._area = area
        shapely.prepare(area)
        #: start and extent of each edge: longitude, latitude, and the differences to its end
        self._edges: list[tuple[float, float, float, float]] = []
        for polygon in shapely.get_parts(area):
            for ring in (polygon.exterior, *polygon.interiors):
                corners = list(ring.coords)
                for start, end in pairwise(corners):
                    self._edges.append((start[0], start[1], end[0] - start[0], end[1] - start[1]))

    def contains(self, lat: float, lon: float) -> bool:
        return bool(shapely.contains_xy(self._area, lon, lat))

    def border_m(self, lat: float, lon: float, scale: tuple[float, float]) -> float:
        per_lat, per_lon = scale
        nearest = math.inf
        squares = []
        for start_lon, start_lat, extent_lon, extent_lat in self._edges:
            x, y = (start_lon - lon) * per_lon, (start_lat - lat) * per_lat
            dx, dy = extent_lon * per_lon, extent_lat * per_lat
            length = dx * dx + dy * dy
            if length > 0.0:
                part = -(x * dx + y * dy) / length
                part = 0.0 if part < 0.0 else 1.0 if part > 1.0 else part
                x += part * dx
                y += part * dy
            square = x * x + y * y
            squares.append((square, x, y))
            nearest = min(nearest, square)
        plane_distance = math.sqrt(nearest)
        if plane_distance < _NEAR_M:
            return plane_distance
        # the plane's scale drifts with distance: measure again every edge that could be the nearest one
        drift = 4.0 * plane_distance / _EARTH_RADIUS_M * (1.0 + abs(math.tan(math.radians(lat))))
        limit = nearest * (1.0 + drift) ** 2
        return min(
            distance_m(lat, lon, lat + y / per_lat, lon + x / per_lon) for square, x, y in squares if square <= limit
        )

    def exit_m(self, lat: float, lon: float, scale: tuple[float, float], east: float, north: float) -> float:
        per_lat, per_lon = scale
        crossings = []
        for start_lon, start_lat, extent_lon, extent_lat in self._edges:
            x, y = (start_lon - lon) * per_lon, (start_lat - lat) * per_lat
            dx, dy = extent_lon * per_lon, extent_lat * per_lat
            slant = east * dy - north * dx
            if slant == 0.0:  # along the edge: its neighbours tell where it ends
                continue
            part = (x * north - y * east) / slant
            if 0.0 <= part <= 1.0:
                ahead = (x * dy - y * dx) / slant
                if ahead > 0.0:
                    crossings.append(ahead)
        crossings.sort()
        # a corner touched is not a border crossed: the way beyond must be outside, for more than a rounding error
        for here, beyond in zip(crossings, [*crossings[1:], math.inf], strict=True):
            if beyond - here < _ROUNDING_M:
                continue
            probe = here + min(1.0, (beyond - here) / 2.0)
            if not self.contains(lat + probe * north / per_lat, lon + probe * east / per_lon):
                return here
        return math.inf


class ZoneFinder:
    """Answers where the aircraft is with respect to every zone. Immutable once made; any number may exist."""

    def __init__(self, zones: Iterable[Zone], *, horizon_s: float = HORIZON_S) -> None:
        """`horizon_s`: how far ahead an exit is looked for."""
        self.zones = tuple(zones)
        self.horizon_s = horizon_s
        self._shapes: tuple[tuple[Zone, _Shape], ...] = tuple(
            (zone, _CircleShape(zone.area) if isinstance(zone.area, Circle) else _PolygonShape(zone.area))
            for zone in self.zones
        )

    def holding(self, lat_deg: float, lon_deg: float, alt_m: float | None = None) -> frozenset[int]:
        """System ids of the stations whose zone holds a place (`alt_m` above home)."""
        return frozenset(
            zone.station
            for zone, shape in self._shapes
            if shape.contains(lat_deg, lon_deg) and zone.altitude_excess_m(alt_m) == 0.0
        )

    def facts(
        self,
        lat_deg: float,
        lon_deg: float,
        track_deg: float,
        ground_speed_mps: float,
        alt_m: float | None = None,
    ) -> tuple[ZoneFact, ...]:
        """One fact a zone, in the order of the zones.

        `track_deg` is the direction of motion over ground from north, `alt_m` metres above home (None: altitude
        limits are not looked at). A position that is no place on earth gives no facts; a track or speed that is no
        number gives facts without `exit_s`.
        """
        if not (-90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0):
            return ()
        scale = degree_lengths_m(lat_deg)
        track = math.radians(track_deg) if math.isfinite(track_deg) else 0.0
        moving = math.isfinite(track_deg) and SLOWEST_TRACK_MPS <= ground_speed_mps < math.inf
        reach_m = ground_speed_mps * self.horizon_s if moving else 0.0
        found = []
        for zone, shape in self._shapes:
            excess = zone.altitude_excess_m(alt_m)
            border = shape.border_m(lat_deg, lon_deg, scale)
            exit_s = None
            if not shape.contains(lat_deg, lon_deg):
                margin = -math.hypot(border, excess)
            elif excess > 0.0:
                margin = -excess
            else:
                margin = border
                if border < reach_m:
                    away = shape.exit_m(lat_deg, lon_deg, scale, math.sin(track), math.cos(track))
                    exit_s = away / ground_speed_mps if away <= reach_m else None
            found.append(ZoneFact(zone.station, margin, exit_s))
        return tuple(found)
