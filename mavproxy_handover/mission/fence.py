# SPDX-License-Identifier: GPL-3.0-or-later

"""The geofence of a plan, judged as ArduPilot judges it: inside every inclusion, outside every exclusion."""

from __future__ import annotations

from collections.abc import Iterable

import shapely
from shapely.geometry import Polygon

from mavproxy_handover.mission.geodesy import beside_deg, distance_m
from mavproxy_handover.mission.plan import FenceCircle, FencePart

__all__ = ["outside_fence"]


def outside_fence(fence: Iterable[FencePart], lat_deg: float, lon_deg: float) -> bool:
    """Whether a place breaks the fence; False where there is none."""
    return any(_inside(part, lat_deg, lon_deg) is not part.inclusion for part in fence)


def _inside(part: FencePart, lat: float, lon: float) -> bool:
    if isinstance(part, FenceCircle):
        return distance_m(lat, lon, part.lat_deg, part.lon_deg) < part.radius_m
    first = part.corners[0][1]  # the fence may lie across the 180th meridian
    outline = Polygon([(beside_deg(corner_lon, first), corner_lat) for corner_lat, corner_lon in part.corners])
    return bool(shapely.contains_xy(outline, beside_deg(lon, first), lat))
