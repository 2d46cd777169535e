# SPDX-License-Identifier: GPL-3.0-or-later

"""The border of a zone: side of a place, distance to it, and crossings of a track.

The edges of a polygon are in a tree of boxes; each box holds half of the edges of its parent. A search visits the
nearest box first. It skips every box that cannot hold anything nearer than the best result. So it checks a few dozen
edges of a thousand. Without that, a hundred zones with a thousand corners would take a whole processor.

The nearest place is chosen by the scales of the ellipsoid halfway between the aircraft and the edge, as in
`geodesy.distance_m`. That function then measures the distance to it. A track is a straight line in the plane that
touches the earth at the aircraft, so the scale is right where it matters.

shapely decides on which side a place is. If little else runs on the processor, that costs more than the rest of a
check. So it is called only if needed: an aircraft that has moved less than its distance to the border is still on the
same side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import shapely
from shapely.geometry import MultiPolygon, Polygon

from mavproxy_handover.mission.geodesy import beside_deg, degree_lengths_m, distance_m, offset, wrap_longitude_deg

__all__ = ["Border", "Circle", "CircleBorder", "Plane", "PolygonBorder", "plane_at"]

#: corners of the polygon that replaces a circle in comparisons of areas and in drawings
CIRCLE_CORNERS = 128

#: crossings nearer to each other than this are one: the track touches a corner
_ROUNDING_M = 0.01
#: part of its length by which an edge is extended: no track passes between two edges
_EDGE_ROUNDING = 1e-9
#: distance (m) after a crossing at which the track is checked
_PROBE_M = 1.0
#: a crossing with less of its edge on either side may be one of a corner
_CORNER = 1e-6
#: a track that comes this near to running along an edge, in metres across its length, does not clearly cross it
_ALONG_M = 1e-3
#: part of the distance to the border within which the side stays the same, and its maximum in metres: at such distances
#: the scales are a hundred times better than needed
_SAME_SIDE, _SAME_SIDE_M = 0.9, 10_000.0
#: edges in the smallest box: half of it costs more boxes, twice of it more edges
_LEAF_EDGES = 8
#: margin of the boxes around their edges, so that rounding never skips an edge: 0.1 mm
_SLACK_DEG = 1e-9

#: longitude and latitude of the start of an edge, and the differences to its end
_Edge = tuple[float, float, float, float]
#: longitude and latitude of the middle of a box, half its width and height, the boxes in it, or else the edges
_Box = tuple[float, float, float, float, "tuple[_Box, ...]", tuple[_Edge, ...]]


@dataclass(frozen=True, slots=True)
class Circle:
    """All places within `radius_m` of a point."""

    lat_deg: float
    lon_deg: float
    radius_m: float

    def outline(self) -> Polygon:
        """The circle as a polygon in (longitude, latitude), corners on the circle.

        Across the 180th meridian the longitudes go on beyond 180.
        """
        corners = []
        for n in range(CIRCLE_CORNERS):
            turn = 2.0 * math.pi * n / CIRCLE_CORNERS
            east, north = self.radius_m * math.sin(turn), self.radius_m * math.cos(turn)
            lat, lon = offset(self.lat_deg, self.lon_deg, east, north)
            corners.append((beside_deg(lon, self.lon_deg), lat))
        return Polygon(corners)


@dataclass(frozen=True, slots=True)
class Plane:
    """The scales of the earth around the aircraft, in metres a degree.

    For a place `d` degrees of latitude north of it, a degree of longitude is `per_lon + d * slope` long: the scale
    halfway there, right to a ten-thousandth for 180 km.
    """

    per_lat: float
    per_lon: float
    slope: float


def plane_at(lat_deg: float) -> Plane:
    """The scales around a latitude."""
    per_lat, per_lon = degree_lengths_m(lat_deg)
    # parallels shrink towards the pole by the sine of the latitude, times the way along the meridian
    return Plane(per_lat, per_lon, -per_lat * math.sin(math.radians(lat_deg)) * math.radians(0.5))


class Border(Protocol):
    """The horizontal half of a zone. `plane` is that of the place asked about."""

    def contains(self, lat: float, lon: float) -> bool:
        """True if a place is inside; the border itself is outside."""
        ...

    def margin_m(self, lat: float, lon: float, plane: Plane) -> float:
        """Geodesic distance to the nearest place on the border, negative outside; above 0 inside only."""
        ...

    def exit_m(self, lat: float, lon: float, plane: Plane, east: float, north: float, reach_m: float) -> float:
        """Metres along the direction (`east`, `north`), from a place inside, until the border is crossed.

        More than `reach_m`, or inf, when that is farther than `reach_m`.
        """
        ...


class CircleBorder:
    """The border of a circle."""

    def __init__(self, circle: Circle) -> None:
        self._lat, self._lon, self._radius = circle.lat_deg, circle.lon_deg, circle.radius_m

    def contains(self, lat: float, lon: float) -> bool:
        return distance_m(lat, lon, self._lat, self._lon) < self._radius

    def margin_m(self, lat: float, lon: float, _plane: Plane) -> float:
        return self._radius - distance_m(lat, lon, self._lat, self._lon)

    def exit_m(self, lat: float, lon: float, plane: Plane, east: float, north: float, _reach_m: float) -> float:
        x = wrap_longitude_deg(self._lon - lon) * plane.per_lon
        y = (self._lat - lat) * plane.per_lat
        along, across = x * east + y * north, x * north - y * east
        return along + math.sqrt(max(0.0, self._radius * self._radius - across * across))


class PolygonBorder:
    """The border of one or more polygons with holes, in (longitude, latitude)."""

    def __init__(self, area: Polygon | MultiPolygon) -> None:
        self._area = area
        shapely.prepare(area)
        edges = []
        for polygon in shapely.get_parts(area):
            for ring in (polygon.exterior, *polygon.interiors):
                for start, end in pairwise(ring.coords):
                    edges.append((start[0], start[1], end[0] - start[0], end[1] - start[1]))
        self._tree = _boxed(edges)
        self._mid_lon, self._mid_lat, self._half_lon, self._half_lat = self._tree[:4]
        #: the last place given to shapely, the radius within which its answer is valid, and the answer
        self._asked_lat = self._asked_lon = self._holds_m = 0.0
        self._inside = False

    def _beside(self, lon: float) -> float:
        """The longitude on the same side of the 180th meridian as the area."""
        ahead = lon - self._mid_lon
        return lon - 360.0 if ahead > 180.0 else lon + 360.0 if ahead < -180.0 else lon

    def contains(self, lat: float, lon: float) -> bool:
        lon = self._beside(lon)
        if abs(lat - self._mid_lat) > self._half_lat or abs(lon - self._mid_lon) > self._half_lon:
            return False  # most zones are far away, and this test takes a tenth of shapely's time
        return bool(shapely.contains_xy(self._area, lon, lat))

    def margin_m(self, lat: float, lon: float, plane: Plane) -> float:
        lon = self._beside(lon)
        away = self._distance_m(lat, lon, plane)
        # an area on both sides of the 180th meridian has its other part a whole turn away, and not in `away`
        turned = abs(lon - self._asked_lon) > 180.0
        if turned or distance_m(lat, lon, self._asked_lat, self._asked_lon) >= self._holds_m:
            self._asked_lat, self._asked_lon, self._holds_m = lat, lon, min(_SAME_SIDE * away, _SAME_SIDE_M)
            self._inside = self.contains(lat, lon)
        return away if self._inside else -away

    def _distance_m(self, lat: float, lon: float, plane: Plane) -> float:
        per_lat, per_lon, slope = plane.per_lat, plane.per_lon, plane.slope
        nearest, nearest_lat, nearest_lon = math.inf, lat, lon
        box = self._tree
        waiting: list[tuple[float, _Box]] = []
        while True:
            mid_lon, mid_lat, _, half_lat, parts, edges = box
            if parts:
                found = []
                for part in parts:
                    mid_lon, mid_lat, half_lon, half_lat, _, _ = part
                    # never more than the distance to any place in the box: the nearest longitude and latitude in it,
                    # by the scale of its side nearer to a pole
                    d_lon = abs(mid_lon - lon) - half_lon
                    d_lat = mid_lat - lat
                    low, high = d_lat - half_lat, d_lat + half_lat
                    y = low if low > 0.0 else high if high < 0.0 else 0.0
                    y *= per_lat
                    square = y * y
                    if d_lon > 0.0:
                        scale, other = per_lon + low * slope, per_lon + high * slope
                        x = d_lon * (scale if scale < other else other)
                        square += x * x
                    found.append((square, part))
                first, second = found
                if first[0] > second[0]:
                    first, second = second, first
                if second[0] < nearest:
                    waiting.append(second)
                if first[0] < nearest:
                    box = first[1]
                    continue
            else:
                d_lat = mid_lat - lat
                low, high = d_lat - half_lat, d_lat + half_lat
                d_lat = low if low > 0.0 else high if high < 0.0 else 0.0
                scale = per_lon + d_lat * slope
                for start_lon, start_lat, extent_lon, extent_lat in edges:
                    d_lon, d_lat = start_lon - lon, start_lat - lat
                    dx, dy = extent_lon * scale, extent_lat * per_lat
                    along = -(d_lon * scale * dx + d_lat * per_lat * dy)
                    if along > 0.0:
                        length = dx * dx + dy * dy
                        if along < length:
                            along /= length
                            d_lon += along * extent_lon
                            d_lat += along * extent_lat
                        else:
                            d_lon += extent_lon
                            d_lat += extent_lat
                    x, y = d_lon * (per_lon + d_lat * slope), d_lat * per_lat
                    square = x * x + y * y
                    if square < nearest:
                        nearest, nearest_lat, nearest_lon = square, lat + d_lat, lon + d_lon
            while waiting:
                square, box = waiting.pop()
                if square < nearest:
                    break
            else:
                return distance_m(lat, lon, nearest_lat, nearest_lon)

    def exit_m(self, lat: float, lon: float, plane: Plane, east: float, north: float, reach_m: float) -> float:
        lon = self._beside(lon)
        per_lat, per_lon = plane.per_lat, plane.per_lon
        farthest = reach_m + 2.0 * _PROBE_M
        crossings = []
        boxes = [self._tree]
        while boxes:
            mid_lon, mid_lat, half_lon, half_lat, parts, edges = boxes.pop()
            x, y = (mid_lon - lon) * per_lon, (mid_lat - lat) * per_lat
            half_x, half_y = half_lon * per_lon, half_lat * per_lat
            if abs(x * north - y * east) > half_x * abs(north) + half_y * abs(east):
                continue  # the whole box is on one side of the track
            ahead, half = x * east + y * north, half_x * abs(east) + half_y * abs(north)
            if ahead + half < -_ROUNDING_M or ahead - half > farthest:
                continue
            boxes.extend(parts)
            for start_lon, start_lat, extent_lon, extent_lat in edges:
                x, y = (start_lon - lon) * per_lon, (start_lat - lat) * per_lat
                dx, dy = extent_lon * per_lon, extent_lat * per_lat
                slant = east * dy - north * dx
                if slant == 0.0:  # along the edge: its neighbours tell where it ends
                    continue
                part = (x * north - y * east) / slant
                if -_EDGE_ROUNDING <= part <= 1.0 + _EDGE_ROUNDING:
                    ahead = (x * dy - y * dx) / slant
                    if -_ROUNDING_M < ahead <= farthest:
                        crossings.append((ahead, _CORNER < part < 1.0 - _CORNER and abs(slant) > _ALONG_M))
        # a touched corner is no crossing, and neither is a border that was just crossed. If that is not clear, the path
        # beyond must be outside by more than a rounding error
        before = 0.0
        for (here, clear), (beyond, _) in pairwise([*sorted(crossings), (math.inf, False)]):
            alone, before = clear and here - before > _ROUNDING_M, here
            if beyond - here < _ROUNDING_M:
                continue
            if alone:
                return here
            probe = here + min(_PROBE_M, (beyond - here) / 2.0)
            if not self.contains(lat + probe * north / per_lat, lon + probe * east / per_lon):
                return max(0.0, here)
        return math.inf


def _boxed(edges: Sequence[_Edge]) -> _Box:
    """The tree of boxes around edges. A box is split across its length into halves with equal numbers of edges."""
    west = min(min(lon, lon + extent) for lon, _, extent, _ in edges)
    east = max(max(lon, lon + extent) for lon, _, extent, _ in edges)
    south = min(min(lat, lat + extent) for _, lat, _, extent in edges)
    north = max(max(lat, lat + extent) for _, lat, _, extent in edges)
    size = (east - west) / 2.0 + _SLACK_DEG, (north - south) / 2.0 + _SLACK_DEG
    parts: tuple[_Box, ...] = ()
    if len(edges) > _LEAF_EDGES:
        # a degree of longitude is the shorter one, but by how much does not matter here
        axis = 0 if size[0] > size[1] else 1
        ordered = sorted(edges, key=lambda edge: edge[axis] + edge[axis + 2] / 2.0)
        half = len(ordered) // 2
        parts = (_boxed(ordered[:half]), _boxed(ordered[half:]))
    return (west + east) / 2.0, (south + north) / 2.0, *size, parts, () if parts else tuple(edges)
