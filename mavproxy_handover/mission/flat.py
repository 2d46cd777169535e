# SPDX-License-Identifier: GPL-3.0-or-later

"""Areas of a mission on a plane, in metres around home, for drawings."""

from __future__ import annotations

import math
from collections.abc import Iterable

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import polylabel

from mavproxy_handover.mission.geodesy import LocalPlane, degree_lengths_m
from mavproxy_handover.mission.zones import beside

__all__ = ["parts", "quiet_place"]


def parts(plane: LocalPlane, area: Polygon | MultiPolygon) -> list[Polygon]:
    """The parts of an area in (longitude, latitude) as polygons on the plane, holes included."""
    per_lat, per_lon = degree_lengths_m(plane.lat_deg)
    origin, scale = [plane.lon_deg, plane.lat_deg], [per_lon, per_lat]
    flat = shapely.transform(beside(area, plane.lon_deg), lambda corners: (corners - origin) * scale)
    return [part for part in shapely.get_parts(flat) if not part.is_empty]


def quiet_place(area: BaseGeometry, busy: Iterable[BaseGeometry]) -> tuple[float, float]:
    """A place for the name of an area: middle of the largest circle in it that is free of `busy`.

    Parts of `busy` that leave no room at all are ignored.
    """
    room = area
    for other in busy:
        rest = room.difference(other)
        room = room if rest.is_empty else rest
    largest = max(shapely.get_parts(room), key=lambda part: float(part.area))
    place = polylabel(largest, tolerance=max(0.1, math.sqrt(largest.area) / 50.0))
    return place.x, place.y
