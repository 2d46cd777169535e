# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones from any GeoJSON file of areas (RFC 7946): a FeatureCollection, one Feature, or a bare geometry.

The name of a zone is its property `station`, `name` or `title`, whatever the case, else the `id` of its feature.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from mavproxy_handover.mission.drawn.areas import (
    ALLOWED,
    Area,
    DrawnZone,
    Home,
    NoArea,
    areas_among,
    drawn_zone,
    name_of,
    polygon_of,
)
from mavproxy_handover.mission.errors import MissionError, Where, parse_json
from mavproxy_handover.mission.geojson import LARGEST_RADIUS_M, SMALLEST_RADIUS_M, position_of
from mavproxy_handover.mission.zones import Circle

__all__ = ["MAX_DEPTH", "circle_at", "read_geojson"]

#: collections within each other
MAX_DEPTH: Final = 10

#: properties that name a zone, the first that is there counts
_NAMES: Final = ("station", "name", "title")
#: coordinate systems that are longitude and latitude in WGS 84
_WGS84: Final = ("CRS84", "4326")
#: geometries that have no area
_NO_AREAS: Final = ("MultiPoint", "LineString", "MultiLineString")
_FEATURES: Final = ("FeatureCollection", "Feature")
_DRAW: Final = "Draw it as a polygon, or name the zones that count with --station NAME=ZONE"


def read_geojson(where: Where, text: str, home: Home) -> Iterator[DrawnZone]:
    """The zones of a file, each with its own fault. Raises MissionError for a file that holds none."""
    document = where.table(parse_json(text, where), "the file")
    _check_system(where, document)
    kind = document.get("type")
    if kind == "FeatureCollection":
        for number, entry in enumerate(where.array(where.need(document, "features"), "features"), 1):
            yield _zone(where, f"feature {number}", entry, home)
    elif kind == "Feature":
        yield _zone(where, "feature 1", document, home)
    elif isinstance(kind, str) and ("coordinates" in document or "geometries" in document):
        yield _zone(where, "the geometry", {"properties": None, "geometry": document}, home)
    else:
        raise where.error(f"not GeoJSON of zones (allowed: {', '.join(_FEATURES)}, a geometry). Export it as GeoJSON")


def circle_at(where: Where, properties: Mapping[str, object], position: object, home: Home) -> Circle:
    """The circle of a Point and its property `radius_m`. Raises MissionError."""
    if "radius_m" not in properties:
        raise NoArea(str(where.error(f"a Point is no zone without radius_m (allowed: {ALLOWED}). {_DRAW}")))
    lon, lat = position_of(where, position, "the centre", home)
    return Circle(lat, lon, where.number(properties["radius_m"], "radius_m", SMALLEST_RADIUS_M, LARGEST_RADIUS_M))


def _check_system(where: Where, document: Mapping[str, object]) -> None:
    """Raise MissionError if the file names another coordinate system than WGS 84."""
    system = document.get("crs")
    if not isinstance(system, dict) or not isinstance(system.get("properties"), dict):
        return
    name = str(system["properties"].get("name", ""))
    if name and not name.rstrip("/").endswith(_WGS84):
        shown = where.text(name[:60], "crs", 60)
        raise where.error(f"crs is '{shown}' (allowed: longitude and latitude in WGS 84). Export it as EPSG:4326")


def _zone(where: Where, place: str, entry: object, home: Home) -> DrawnZone:
    inside = where.at(place)
    try:
        feature = inside.table(entry, "the feature")
        properties = inside.table(feature.get("properties") or {}, "properties")
        name = _name(properties, feature)
        inside = where.at(f"{place} ({name})") if name else inside
        geometry = inside.table(inside.need(feature, "geometry"), "geometry")
    except MissionError as error:
        return drawn_zone(inside, "", {}, (), fault=error)
    return drawn_zone(inside, name, properties, _areas(inside, properties, geometry, home))


def _name(properties: Mapping[str, object], feature: Mapping[str, object]) -> str:
    """The name of a feature; "" if it has none."""
    lower = {key.lower(): value for key, value in reversed(list(properties.items()))}
    found = next((lower[key] for key in _NAMES if lower.get(key) not in (None, "")), feature.get("id"))
    return "" if found is None else name_of(str(found))


def _areas(
    where: Where, properties: Mapping[str, object], geometry: Mapping[str, object], home: Home, depth: int = 0
) -> Iterator[Area]:
    """The areas of a geometry, and of those in a collection. Raises MissionError."""
    kind = geometry.get("type")
    if kind == "GeometryCollection":
        if depth >= MAX_DEPTH:
            raise where.error(f"a GeometryCollection more than {MAX_DEPTH} deep. {_DRAW}")
        listed = where.array(where.need(geometry, "geometries"), "geometries")
        parts = ((where.at(f"geometry {number}"), entry) for number, entry in enumerate(listed, 1))
        yield from areas_among(
            _areas(inside, properties, inside.table(entry, "the geometry"), home, depth + 1) for inside, entry in parts
        )
        return
    if kind not in ("Polygon", "MultiPolygon", "Point"):
        shown = where.text(kind, "type", 40) if isinstance(kind, str) else "geometry without a type"
        told = where.error(f"a {shown} is no zone (allowed: {ALLOWED}). {_DRAW}")
        raise NoArea(str(told)) if kind in _NO_AREAS else told
    if kind != "Point" and "radius_m" in properties:
        raise where.error(f"radius_m on a {kind} (allowed: on a Point). Remove it")
    coordinates = where.need(geometry, "coordinates")
    if kind == "Point":
        yield circle_at(where, properties, coordinates, home)
        return
    listed = where.array(coordinates, "coordinates")
    if kind == "Polygon":
        yield polygon_of(where, listed, home)
        return
    for number, part in enumerate(listed, 1):
        inside = where.at(f"polygon {number}")
        yield polygon_of(inside, inside.array(part, "the polygon"), home)
