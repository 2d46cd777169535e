# SPDX-License-Identifier: GPL-3.0-or-later

"""Positions: ArduPilot's flat earth, so that distances and tracks come out as in the autopilot.

ArduPilot measures between two points with one scale for latitude and the same scale times the cosine of the
mean latitude for longitude (`Location::get_distance_NE`, `Location::offset`). It is off by up to 0.3 % against
the ellipsoid; an aircraft that flies by it must be simulated with it. Latitudes and longitudes are integers in
1e-7 degrees, as on the wire; everything else is metres, north, east and up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

__all__ = ["AltFrame", "Location", "Vector", "altitude_frame", "bearing_deg", "distance_m", "offset_ne_m", "shift"]

#: Metres per 1e-7 degree of latitude (ArduPilot's LOCATION_SCALING_FACTOR: a sphere of 6 378 100 m).
_METRES_PER_UNIT = 0.011131884502145034

Vector = tuple[float, float, float]
"""North, east, up in metres (or metres per second)."""


class AltFrame(IntEnum):
    """The reference of an altitude. Terrain is not modelled: the ground is flat at the height of the origin."""

    ABSOLUTE = 0
    ABOVE_HOME = 1


@dataclass(frozen=True, slots=True)
class Location:
    """A place: latitude and longitude in 1e-7 degrees, altitude in metres counted from `frame`."""

    lat_e7: int
    lon_e7: int
    alt_m: float
    frame: AltFrame = AltFrame.ABSOLUTE


def _longitude_scale(lat_e7: float) -> float:
    return max(math.cos(math.radians(lat_e7 * 1e-7)), 0.01)


def _wrap_e7(lon_e7: int) -> int:
    return (lon_e7 + 1_800_000_000) % 3_600_000_000 - 1_800_000_000


def offset_ne_m(origin: Location, target: Location) -> tuple[float, float]:
    """North and east metres from `origin` to `target`."""
    north = (target.lat_e7 - origin.lat_e7) * _METRES_PER_UNIT
    scale = _longitude_scale((origin.lat_e7 + target.lat_e7) / 2)
    return north, _wrap_e7(target.lon_e7 - origin.lon_e7) * _METRES_PER_UNIT * scale


def shift(origin: Location, north_m: float, east_m: float) -> tuple[int, int]:
    """Latitude and longitude (1e-7 degrees) of the point `north_m`, `east_m` away from `origin`."""
    delta_lat = north_m / _METRES_PER_UNIT
    scale = _longitude_scale(origin.lat_e7 + delta_lat / 2)
    delta_lon = east_m / _METRES_PER_UNIT / scale
    return origin.lat_e7 + round(delta_lat), _wrap_e7(origin.lon_e7 + round(delta_lon))


def distance_m(a: Location, b: Location) -> float:
    """Horizontal distance in metres."""
    return math.hypot(*offset_ne_m(a, b))


def bearing_deg(north_m: float, east_m: float) -> float:
    """Direction of a horizontal vector, degrees clockwise from north, 0..360."""
    return math.degrees(math.atan2(east_m, north_m)) % 360.0


def altitude_frame(mav_frame: int) -> AltFrame | None:
    """Which altitude a MAV_FRAME means; None for frames that carry no place. Terrain counts as home (flat ground)."""
    if mav_frame in (3, 6, 10, 11):
        return AltFrame.ABOVE_HOME
    return AltFrame.ABSOLUTE if mav_frame in (0, 5) else None
