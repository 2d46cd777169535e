# SPDX-License-Identifier: GPL-3.0-or-later

"""The geofence of a plan, judged as ArduPilot does: inside every inclusion, outside every exclusion.

`outside_fence` judges one place. `Fence` is prepared for repeated checks of places and straight paths.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

import shapely
from shapely.geometry import LineString, Polygon

from mavproxy_handover.mission.geodesy import beside_deg, distance_m, east_north_m, wrap_longitude_deg
from mavproxy_handover.mission.plan import FenceCircle, FencePart, FencePolygon

__all__ = ["Fence", "outside_fence"]

#: latitude and longitude, degrees
Place = tuple[float, float]


def outside_fence(fence: Iterable[FencePart], lat_deg: float, lon_deg: float) -> bool:
    """Whether a place breaks the fence; False where there is none."""
    return any(_inside(part, lat_deg, lon_deg) is not part.inclusion for part in fence)


def _inside(part: FencePart, lat: float, lon: float) -> bool:
    return _shape(part).holds((lat, lon))


class _Shape(Protocol):
    """One part of a fence."""

    def holds(self, place: Place) -> bool:
        """True if a place is inside."""
        ...

    def holds_way(self, start: Place, end: Place) -> bool:
        """True if all of the straight path is inside."""
        ...

    def meets_way(self, start: Place, end: Place) -> bool:
        """True if a part of it is inside."""
        ...


class _CircleShape:
    def __init__(self, circle: FenceCircle) -> None:
        self._centre, self._radius_m = (circle.lat_deg, circle.lon_deg), circle.radius_m

    def holds(self, place: Place) -> bool:
        return distance_m(*place, *self._centre) < self._radius_m

    def holds_way(self, start: Place, end: Place) -> bool:
        return self.holds(start) and self.holds(end)

    def meets_way(self, start: Place, end: Place) -> bool:
        east, north = east_north_m(*self._centre, *start)
        to_east, to_north = east_north_m(*self._centre, *end)
        dx, dy = to_east - east, to_north - north
        length = dx * dx + dy * dy
        part = 0.0 if length == 0.0 else min(1.0, max(0.0, -(east * dx + north * dy) / length))
        return math.hypot(east + part * dx, north + part * dy) < self._radius_m


class _PolygonShape:
    def __init__(self, polygon: FencePolygon) -> None:
        self._first = polygon.corners[0][1]  # the fence may lie across the 180th meridian
        corners = [(beside_deg(lon, self._first), lat) for lat, lon in polygon.corners]
        self._outline = Polygon(corners)
        shapely.prepare(self._outline)

    def holds(self, place: Place) -> bool:
        return bool(shapely.contains_xy(self._outline, beside_deg(place[1], self._first), place[0]))

    def holds_way(self, start: Place, end: Place) -> bool:
        return bool(shapely.contains(self._outline, self._line(start, end)))

    def meets_way(self, start: Place, end: Place) -> bool:
        return bool(shapely.intersects(self._outline, self._line(start, end)))

    def _line(self, start: Place, end: Place) -> LineString:
        lon = beside_deg(start[1], self._first)
        return LineString([(lon, start[0]), (lon + wrap_longitude_deg(end[1] - start[1]), end[0])])


def _shape(part: FencePart) -> _Shape:
    return _CircleShape(part) if isinstance(part, FenceCircle) else _PolygonShape(part)


class Fence:
    """A geofence; one without parts holds everything."""

    def __init__(self, parts: Iterable[FencePart]) -> None:
        self._inclusions: list[_Shape] = []
        self._exclusions: list[_Shape] = []
        for part in parts:
            (self._inclusions if part.inclusion else self._exclusions).append(_shape(part))

    def holds(self, place: Place) -> bool:
        """True if a place does not break the fence."""
        held = all(shape.holds(place) for shape in self._inclusions)
        return held and not any(shape.holds(place) for shape in self._exclusions)

    def holds_way(self, start: Place, end: Place) -> bool:
        """True if the straight path from one place to another does not break the fence."""
        held = all(shape.holds_way(start, end) for shape in self._inclusions)
        return held and not any(shape.meets_way(start, end) for shape in self._exclusions)
