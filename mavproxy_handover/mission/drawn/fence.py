# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones from the geofence of a QGroundControl plan: its inclusion polygons and circles. They have no names."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import replace

from mavproxy_handover.mission.drawn.areas import Area, DrawnZone, Home, drawn_zone, polygon_of
from mavproxy_handover.mission.errors import Where, parse_json
from mavproxy_handover.mission.plan import FenceCircle, FencePart, read_fence
from mavproxy_handover.mission.zones import Circle

__all__ = ["read_plan_fence", "without_parts"]


def read_plan_fence(where: Where, text: str, home: Home) -> Iterator[DrawnZone]:
    """The inclusion areas of a plan's geofence, polygons first. Raises MissionError."""
    plan = where.table(parse_json(text, where), "the file")
    polygons = circles = 0
    for number, part in enumerate(read_fence(where.at("geoFence"), plan.get("geoFence"))):
        circle = isinstance(part, FenceCircle)
        polygons, circles = polygons + (not circle), circles + circle
        if part.inclusion:
            inside = where.at(f"geoFence, circle {circles}" if circle else f"geoFence, polygon {polygons}")
            yield replace(drawn_zone(inside, "", {}, _areas(inside, part, home)), fence_part=number)


def _areas(where: Where, part: FencePart, home: Home) -> Iterator[Area]:
    if isinstance(part, FenceCircle):
        yield Circle(part.lat_deg, part.lon_deg, part.radius_m)
    else:
        yield polygon_of(where, [[[lon, lat] for lat, lon in part.corners]], home)


def without_parts(text: str, parts: Collection[int]) -> str:
    """The text of a plan without these parts of its geofence, counted from 0, polygons first."""
    plan = json.loads(text)
    fence = plan["geoFence"]
    polygons, circles = fence.get("polygons", []), fence.get("circles", [])
    fence["polygons"] = [each for number, each in enumerate(polygons) if number not in parts]
    fence["circles"] = [each for number, each in enumerate(circles, len(polygons)) if number not in parts]
    return json.dumps(plan, indent=4) + "\n"
