# SPDX-License-Identifier: GPL-3.0-or-later

"""Distances and directions on the WGS84 ellipsoid, good for anything a drone flies.

One idea serves all: around a latitude, the ellipsoid is a plane whose east and north scales are its two radii of
curvature (M along the meridian, N across it). At the latitude halfway between two points, these scales give a distance.
Its error is below 0.01 % at 50 km, up to 80 degrees of latitude. That is thirty times better than a sphere.
`tests/mission/test_mission_geodesy.py` compares it to Karney's algorithm. At one latitude, as in `LocalPlane`, these
scales keep lines straight that are straight in longitude and latitude. GeoJSON, ArduPilot and QGroundControl understand
the edges of a polygon in this way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = [
    "LocalPlane",
    "bearing_deg",
    "beside_deg",
    "degree_lengths_m",
    "distance_m",
    "east_north_m",
    "offset",
    "wrap_longitude_deg",
]

_EQUATORIAL_RADIUS_M = 6378137.0
_ECCENTRICITY_SQUARED = 6.694379990141317e-3


def degree_lengths_m(lat_deg: float) -> tuple[float, float]:
    """Metres in one degree of latitude and in one degree of longitude at `lat_deg`."""
    phi = math.radians(lat_deg)
    sine = math.sin(phi)
    flatness = 1.0 - _ECCENTRICITY_SQUARED * sine * sine
    across = _EQUATORIAL_RADIUS_M / math.sqrt(flatness)
    along = across * (1.0 - _ECCENTRICITY_SQUARED) / flatness
    return math.radians(along), math.radians(across * math.cos(phi))


def wrap_longitude_deg(lon_deg: float) -> float:
    """The same longitude, or difference of longitudes, from -180 up to 180."""
    if -180.0 <= lon_deg < 180.0:
        return lon_deg
    return (lon_deg + 180.0) % 360.0 - 180.0


def beside_deg(lon_deg: float, middle_deg: float) -> float:
    """The same longitude within half a turn of `middle_deg`, beyond 180 if needed."""
    away = lon_deg - middle_deg
    return lon_deg if abs(away) <= 180.0 else lon_deg - 360.0 * round(away / 360.0)


def east_north_m(lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float) -> tuple[float, float]:
    """East and north from point 1 to point 2 in metres, by the scales at the latitude between them."""
    per_lat, per_lon = degree_lengths_m((lat1_deg + lat2_deg) / 2.0)
    return wrap_longitude_deg(lon2_deg - lon1_deg) * per_lon, (lat2_deg - lat1_deg) * per_lat


def distance_m(lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float) -> float:
    """Geodesic distance in metres; error below 0.01 % to 50 km and 80 degrees of latitude."""
    return math.hypot(*east_north_m(lat1_deg, lon1_deg, lat2_deg, lon2_deg))


def bearing_deg(lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float) -> float:
    """Direction of point 2 as seen from point 1, in degrees from north, clockwise, 0 up to 360."""
    east, north = east_north_m(lat1_deg, lon1_deg, lat2_deg, lon2_deg)
    # meridians converge: the direction at the start differs from that in the middle by half of it
    half_turn = wrap_longitude_deg(lon2_deg - lon1_deg) * math.sin(math.radians((lat1_deg + lat2_deg) / 2.0)) / 2.0
    return (math.degrees(math.atan2(east, north)) - half_turn) % 360.0


def offset(lat_deg: float, lon_deg: float, east_m: float, north_m: float) -> tuple[float, float]:
    """The point (latitude, longitude) that lies so far east and north; the inverse of `distance_m`."""
    lat = lat_deg
    for _ in range(3):  # the scale wanted is the one halfway there; each round gains two digits
        per_lat, per_lon = degree_lengths_m((lat_deg + lat) / 2.0)
        lat = lat_deg + north_m / per_lat
    return lat, wrap_longitude_deg(lon_deg + east_m / per_lon)


@dataclass(frozen=True, slots=True)
class LocalPlane:
    """A plane that touches the ellipsoid at a point: x metres east, y metres north of it.

    True at the point, 0.03 % off at 5 km in middle latitudes: for pictures and for the width of a corridor.
    """

    lat_deg: float
    lon_deg: float

    def to_plane(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """East and north of the touching point in metres."""
        per_lat, per_lon = degree_lengths_m(self.lat_deg)
        return wrap_longitude_deg(lon_deg - self.lon_deg) * per_lon, (lat_deg - self.lat_deg) * per_lat

    def to_earth(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Latitude and longitude in degrees."""
        per_lat, per_lon = degree_lengths_m(self.lat_deg)
        return self.lat_deg + y_m / per_lat, self.lon_deg + x_m / per_lon
