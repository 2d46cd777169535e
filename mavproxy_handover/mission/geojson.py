# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the zones of a mission package from GeoJSON (RFC 7946: longitude first, then latitude).

A FeatureCollection with one feature a station. Properties: `station` (its name in mission.toml), `name` (a label),
`min_alt_m`, `max_alt_m` (above home), `radius_m` (makes a Point a circle). Editors add properties of their own for
colours; these are passed over, unless one looks like a misspelt property of ours: a limit that is not read is worse
than a refusal.

A zone across the 180th meridian is given as RFC 7946 wants it, a MultiPolygon that is cut in two there, or as a circle.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from shapely.geometry import MultiPolygon, Polygon
from shapely.validation import explain_validity

from mavproxy_handover.mission.errors import Where, parse_json
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.zones import Circle, Zone, beside

__all__ = [
    "LARGEST_RADIUS_M",
    "MAX_CORNERS",
    "SMALLEST_RADIUS_M",
    "altitude_limits",
    "check_valid",
    "position_of",
    "read_zones",
    "rings_of",
]

#: more would make the finder slow, and a coverage area is not known that exactly
MAX_CORNERS = 1000
SMALLEST_RADIUS_M, LARGEST_RADIUS_M = 1.0, 100000.0
#: beyond this latitude distances are not measured well enough
HIGHEST_LAT_DEG = 85.0
LOWEST_M, HIGHEST_M = -1000.0, 10000.0

_PROPERTIES = ("station", "name", "min_alt_m", "max_alt_m", "radius_m")
#: kind of detector -> geometries that its zones may have
_GEOMETRIES = {"circles": ("Point",), "polygons": ("Polygon", "MultiPolygon")}
#: zones this far from home, that would be this near with latitude and longitude swapped, are swapped
_SWAPPED_FAR_M, _SWAPPED_NEAR_M = 300e3, 100e3
#: what shapely finds wrong with an area -> what its author has to hear
_FAULTS = {
    "Self-intersection": "the outline crosses itself",
    "Ring Self-intersection": "the outline touches itself",
    "Hole lies outside shell": "a hole lies outside the outline",
    "Holes are nested": "a hole lies in another hole",
    "Nested shells": "a part lies in another part",
    "Interior is disconnected": "a hole cuts the area in two",
}


def read_zones(
    file: str, text: str, stations: Mapping[str, int], detector: str, home: tuple[float, float]
) -> tuple[Zone, ...]:
    """Read one zone for each of `stations` (name -> system id), in their order.

    `detector` is "circles" or "polygons"; `home` (latitude, longitude) serves to notice swapped coordinates. Raises
    MissionError.
    """
    where = Where(file)
    collection = where.table(parse_json(text, where), "the file")
    if collection.get("type") != "FeatureCollection":
        raise where.error("not GeoJSON of zones (allowed: a FeatureCollection)")
    found: dict[str, Zone] = {}
    for number, entry in enumerate(where.array(where.need(collection, "features"), "features"), 1):
        inside = where.at(f"feature {number}")
        feature = inside.table(entry, "the feature")
        properties = inside.table(inside.need(feature, "properties"), "properties")
        station = inside.text(inside.need(properties, "station"), "station", 60)
        inside = where.at(f"feature {number} ({station})")
        if station not in stations:
            raise inside.error(f"unknown station '{station}' (allowed: {', '.join(stations)})")
        if station in found:
            raise inside.error(f"second zone for station '{station}' (allowed: one; use a MultiPolygon for parts)")
        found[station] = _zone(inside, feature, station=station, sysid=stations[station], detector=detector, home=home)
    for station in stations:
        if station not in found:
            raise where.error(f"no zone for station '{station}' (allowed: one feature for each station)")
    return tuple(found[station] for station in stations)


def _zone(
    where: Where,
    feature: Mapping[str, object],
    *,
    station: str,
    sysid: int,
    detector: str,
    home: tuple[float, float],
) -> Zone:
    properties = where.table(feature["properties"], "properties")
    for key in properties:
        near = difflib.get_close_matches(key, _PROPERTIES, n=1, cutoff=0.75)
        if near and key not in _PROPERTIES:
            shown = where.text(key, "a property", 40)
            raise where.error(f"unknown property '{shown}', did you mean '{near[0]}'?")
    geometry = where.table(where.need(feature, "geometry"), "geometry")
    allowed = _GEOMETRIES[detector]
    kind = where.choice(where.need(geometry, "type"), f"geometry of detector '{detector}'", allowed)
    coordinates = where.need(geometry, "coordinates")
    if kind != "Point" and "radius_m" in properties:
        raise where.error(f"radius_m on a {kind} (allowed: on a Point)")
    area: Circle | Polygon | MultiPolygon
    if kind == "Point":
        lon, lat = position_of(where, coordinates, "the centre", home)
        radius = where.number(where.need(properties, "radius_m"), "radius_m", SMALLEST_RADIUS_M, LARGEST_RADIUS_M)
        area = Circle(lat, lon, radius)
    elif kind == "Polygon":
        area = _polygon(where, coordinates, home)
    else:
        parts = where.array(coordinates, "coordinates")
        if not parts:
            raise where.error("no polygon in the MultiPolygon (allowed: 1 or more)")
        area = MultiPolygon(
            [_polygon(where.at(f"polygon {number}"), part, home) for number, part in enumerate(parts, 1)]
        )
        check_valid(where, area)
        area = beside(area, home[1])
    if not isinstance(area, Circle) and sum(len(ring) for ring in rings_of(area)) > MAX_CORNERS:
        raise where.error(f"too many corners (allowed: at most {MAX_CORNERS})")
    low, high = altitude_limits(where, properties)
    label = properties.get("name")
    return Zone(sysid, station, area, "" if label is None else where.text(label, "name", 60), low, high)


def altitude_limits(where: Where, properties: Mapping[str, object]) -> tuple[float | None, float | None]:
    """The properties `min_alt_m` and `max_alt_m`; None: not given. Raises MissionError."""
    low, high = (
        None if properties.get(key) is None else where.number(properties[key], key, LOWEST_M, HIGHEST_M)
        for key in ("min_alt_m", "max_alt_m")
    )
    if low is not None and high is not None and low >= high:
        raise where.error(f"min_alt_m is {low:g}, not below max_alt_m {high:g}")
    return low, high


def position_of(where: Where, value: object, name: str, home: tuple[float, float] | None) -> tuple[float, float]:
    """Longitude and latitude of a position. `home`: as in `read_zones`; None: not known. Raises MissionError."""
    numbers = where.array(value, name)
    if len(numbers) not in (2, 3):
        raise where.error(f"{name} has {len(numbers)} numbers (allowed: longitude, latitude, perhaps altitude)")
    lon = where.number(numbers[0], f"longitude of {name}", -180.0, 180.0)
    lat = numbers[1]
    if isinstance(lat, int | float) and 90.0 < abs(lat) <= 180.0 and abs(lon) <= 90.0:
        raise where.error(f"latitude of {name} is {lat:g}: swapped? Longitude comes first")
    lat = where.number(lat, f"latitude of {name}", -HIGHEST_LAT_DEG, HIGHEST_LAT_DEG)
    if home is None:
        return lon, lat
    if distance_m(lat, lon, *home) > _SWAPPED_FAR_M and distance_m(lon, lat, *home) < _SWAPPED_NEAR_M:
        raise where.error(f"{name} is far from home, and near it when swapped: longitude comes first")
    return lon, lat


def _polygon(where: Where, value: object, home: tuple[float, float]) -> Polygon:
    rings = where.array(value, "coordinates")
    if not rings:
        raise where.error("no ring in the polygon (allowed: 1 or more)")
    paths = []
    for number, entry in enumerate(rings):
        inside = where.at(f"hole {number}") if number else where
        corners = inside.array(entry, "the ring")
        path = [position_of(inside, corner, f"corner {n}", home) for n, corner in enumerate(corners, 1)]
        if len(path) > MAX_CORNERS:
            raise inside.error(f"too many corners (allowed: at most {MAX_CORNERS})")
        if path and path[0] != path[-1]:
            raise inside.error("the ring is not closed (the last position must repeat the first)")
        if len(set(path)) < 3:
            raise inside.error(f"{len(set(path))} corners (allowed: 3 or more)")
        if max(lon for lon, _ in path) - min(lon for lon, _ in path) > 180.0:
            raise inside.error("the polygon crosses the 180th meridian (allowed: a MultiPolygon cut there)")
        paths.append(path)
    polygon = Polygon(paths[0], paths[1:])
    check_valid(where, polygon)
    return polygon


def check_valid(where: Where, area: Polygon | MultiPolygon) -> None:
    """Raise MissionError if an outline crosses itself, or a hole or a part lies where it must not."""
    if area.is_valid:
        return
    reason, _, place = explain_validity(area).partition("[")
    at = ""
    if place:
        lon, lat = place.rstrip("]").split()[:2]
        at = f" near latitude {float(lat):.6f}, longitude {float(lon):.6f}"
    reason = reason.strip()
    raise where.error(f"{_FAULTS.get(reason, reason)}{at} (allowed: a plain area)")


def rings_of(area: Polygon | MultiPolygon) -> list[tuple[tuple[float, ...], ...]]:
    """All outlines and holes of an area; each ends where it begins."""
    polygons = area.geoms if isinstance(area, MultiPolygon) else [area]
    return [tuple(ring.coords) for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
