# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the paths to return sites: zones on the path and at the site, fence, and height above the ground.

RTL flies straight, at one height: up, there, down. The path is cut exactly where it enters or leaves a zone, and not by
samples, so a hundred zones cost little. `core/safety/return_site.py` gets the stations that cover each part of it. This
module does not know which of them could take the aircraft.

A zone's limits of altitude are compared to the height of the return, also above the site itself. Coming down leaves
every zone that ends above the ground, and the ground is the end of the return.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import shapely
from shapely.geometry import LineString, MultiPolygon, Polygon

from mavproxy_handover.core.safety.energy import EnergyModel, Piece
from mavproxy_handover.mission.borders import Circle
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.geodesy import east_north_m, wrap_longitude_deg
from mavproxy_handover.mission.terrain import CLEAR_M, Relief
from mavproxy_handover.mission.zones import Zone

__all__ = ["FenceLimits", "PlaceFinder", "PlaceView", "flown_s"]

#: latitude and longitude, degrees
_Spot = tuple[float, float]
#: from one fraction of the path, 0 to 1, to another
_Span = tuple[float, float]
#: a part of the path shorter than this (m) is ignored: two zones that touch leave no gap
_SLIVER_M = 1.0
#: at the site itself the path has no length; a line as short as this cannot be cut
_NO_WAY_DEG, _NO_WAY_M = 1e-8, 1e-3
#: least speed of a return
_LEAST_MPS = 0.1


@dataclass(frozen=True, slots=True)
class FenceLimits:
    """Settings of ArduCopter's own fence besides the plan's: radius and height (m) around home; None if it is off."""

    radius_m: float | None = None
    ceiling_m: float | None = None


@dataclass(frozen=True, slots=True)
class PlaceView:
    """A return site as seen from the aircraft. The fields are those of `PlaceFact`."""

    inside: bool
    way_inside: bool
    there: frozenset[int]
    way: frozenset[frozenset[int]]
    way_clear: bool = True


class PlaceFinder:
    """Judges the return sites of one mission, by its zones, the current fence, and the ground (None: unknown)."""

    def __init__(self, zones: Iterable[Zone], fence: Fence, relief: Relief | None = None) -> None:
        self._zones = [_Cover(zone) for zone in zones]
        self._fence = fence
        self.relief = relief

    def in_fence(self, place: _Spot) -> bool:
        """True if the fence holds a place."""
        return self._fence.holds(place)

    def evaluate(self, here: _Spot, place: _Spot, height_m: float) -> PlaceView:
        """Judge a return site and the straight path to it at that height above home."""
        east, north = east_north_m(*here, *place)
        length_m = math.hypot(east, north)
        sliver = _SLIVER_M / length_m if length_m > 0.0 else 1.0
        spans: list[tuple[int, _Span]] = []
        there: set[int] = set()
        for zone in self._zones:
            found = zone.spans(here, place, height_m)
            spans += [(zone.station, span) for span in found]
            if any(end >= 1.0 - 1e-9 for _begin, end in found):
                there.add(zone.station)
        inside = self._fence.holds(place)
        way_inside = inside and self._fence.holds_way(here, place)
        clear = self.relief is None or self.relief.above_m(here, place, height_m) >= CLEAR_M
        return PlaceView(inside, way_inside, frozenset(there), _sets(spans, sliver), clear)


def _sets(spans: Sequence[tuple[int, _Span]], sliver: float) -> frozenset[frozenset[int]]:
    """The different sets of stations along a path; parts as short as `sliver` are left out."""
    edges = sorted({0.0, 1.0, *(edge for _station, span in spans for edge in span)})
    found = set()
    for begin, end in pairwise(edges):
        if end - begin > sliver or len(edges) == 2:
            middle = (begin + end) / 2.0
            found.add(frozenset(station for station, (low, high) in spans if low <= middle <= high))
    return frozenset(found)


class _Cover:
    """One zone, to find the parts of a straight path in it."""

    def __init__(self, zone: Zone) -> None:
        self.station = zone.station
        self._zone = zone
        self._circle = zone.area if isinstance(zone.area, Circle) else None
        self._area: Polygon | MultiPolygon = zone.outline()
        shapely.prepare(self._area)
        west, self._south, east, self._north = self._area.bounds
        self._middle, self._half = (west + east) / 2.0, (east - west) / 2.0

    def spans(self, here: _Spot, place: _Spot, height_m: float) -> list[_Span]:
        """The parts of the path that are inside, unordered."""
        if self._zone.altitude_excess_m(height_m) > 0.0:
            return []
        if self._circle is not None:
            return _in_circle(self._circle, here, place)
        # an area in two parts across the 180th meridian is met from either side
        return [span for turn in (0.0, 360.0, -360.0) for span in self._in_area(here, place, turn)]

    def _in_area(self, here: _Spot, place: _Spot, turn: float) -> list[_Span]:
        lon = here[1] + turn
        to_lon = lon + wrap_longitude_deg(place[1] - here[1])
        if min(lon, to_lon) > self._middle + self._half or max(lon, to_lon) < self._middle - self._half:
            return []
        if min(here[0], place[0]) > self._north or max(here[0], place[0]) < self._south:
            return []
        dx, dy = to_lon - lon, place[0] - here[0]
        square = dx * dx + dy * dy
        if square < _NO_WAY_DEG**2:
            return [(0.0, 1.0)] if shapely.contains_xy(self._area, lon, here[0]) else []
        cut = shapely.intersection(LineString([(lon, here[0]), (to_lon, place[0])]), self._area)
        found = []
        for part in shapely.get_parts(cut):
            if isinstance(part, LineString) and not part.is_empty:
                ends = [((x - lon) * dx + (y - here[0]) * dy) / square for x, y in part.coords]
                found.append((min(ends), max(ends)))
        return found


def _in_circle(circle: Circle, here: _Spot, place: _Spot) -> list[_Span]:
    x, y = east_north_m(circle.lat_deg, circle.lon_deg, *here)
    to_x, to_y = east_north_m(circle.lat_deg, circle.lon_deg, *place)
    dx, dy = to_x - x, to_y - y
    square = dx * dx + dy * dy
    beyond = x * x + y * y - circle.radius_m**2
    if square < _NO_WAY_M**2:
        return [(0.0, 1.0)] if beyond < 0.0 else []
    half, root = (x * dx + y * dy) / square, ((x * dx + y * dy) / square) ** 2 - beyond / square
    if root <= 0.0:
        return []
    low, high = -half - math.sqrt(root), -half + math.sqrt(root)
    return [(max(0.0, low), min(1.0, high))] if high > 0.0 and low < 1.0 else []


def flown_s(way: Iterable[Piece], model: EnergyModel | None, speed_mps: float) -> float:
    """Time of a path; infinite if the wind does not allow it.

    Without a model `speed_mps` counts for pieces that name no speed.
    """
    total = 0.0
    for piece in way:
        level_s = 0.0
        if piece.length_m > 0.0:
            told_mps = speed_mps if piece.speed_mps is None else piece.speed_mps
            made_mps = told_mps if model is None else model.made_good(piece.bearing_deg, piece.speed_mps).speed_mps
            level_s = piece.length_m / made_mps if made_mps > _LEAST_MPS else math.inf
        total += max(level_s, piece.vertical_s) + piece.hold_s
    return total
