# SPDX-License-Identifier: GPL-3.0-or-later

"""Drawn zones, and areas made of corners: closed, valid, cut at the 180th meridian, with few enough corners."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Final, TypeAlias

import shapely
from shapely.affinity import translate
from shapely.geometry import MultiPolygon, Polygon, box

from mavproxy_handover.mission.errors import MissionError, Where
from mavproxy_handover.mission.geodesy import degree_lengths_m
from mavproxy_handover.mission.geojson import MAX_CORNERS, altitude_limits, check_valid, position_of, rings_of
from mavproxy_handover.mission.zones import Circle

__all__ = [
    "ALLOWED",
    "Area",
    "DrawnZone",
    "Home",
    "NoArea",
    "areas_among",
    "areas_joined",
    "corners_of",
    "cut_at_meridian",
    "drawn_zone",
    "name_of",
    "next_step",
    "polygon_of",
    "simplified",
    "with_few_corners",
]

Area: TypeAlias = Circle | Polygon | MultiPolygon
#: latitude and longitude of home; None: not known
Home: TypeAlias = tuple[float, float] | None

#: geometries that can be a zone, for messages
ALLOWED: Final = "Polygon, MultiPolygon, Point with radius_m"
#: next step after a fault that names none
_NEXT: Final = "Put it right, or name the zones that count with --station NAME=ZONE"
#: what a label in the zones of a package may have
_LONGEST_NAME: Final = 60
#: properties that limit a zone
_LIMITS: Final = ("min_alt_m", "max_alt_m", "radius_m")
#: the accuracy (m) to which the least simplification is searched
_SEARCH_M: Final = 0.01


class NoArea(MissionError):
    """A geometry is a line, a point or nothing: it can be no zone."""


@dataclass(frozen=True, slots=True)
class DrawnZone:
    """One zone of a file. `name`: as drawn, "" if it has none. `place`: the file and the feature, for messages.

    `fault`: it cannot be used, for this reason; `area` is None then. `aside`: it has no area, and stands in a file
    beside zones: it counts only if a station names it.
    """

    name: str
    place: str
    area: Area | None
    min_alt_m: float | None = None
    max_alt_m: float | None = None
    fault: MissionError | None = field(default=None, compare=False)
    #: number of the polygon or circle in the geofence of a plan, from 0; None: from no geofence
    fence_part: int | None = None
    aside: bool = False


def name_of(text: str) -> str:
    """A name as one printable line of at most 60 characters; "" if nothing is left of it."""
    plain = "".join(each if each.isprintable() else " " for each in text)
    return " ".join(plain.split())[:_LONGEST_NAME].strip()


def drawn_zone(
    where: Where,
    name: str,
    properties: Mapping[str, object],
    areas: Iterable[Area],
    *,
    fault: MissionError | None = None,
) -> DrawnZone:
    """A zone of these areas, which may be computed while they are read. Its fault is kept and not raised."""
    try:
        if fault is not None:
            raise fault
        _refuse_misspelt(where, properties)
        low, high = altitude_limits(where, properties)
        return DrawnZone(name, _place_of(where), areas_joined(where, list(areas)), low, high)
    except MissionError as error:
        text = str(error)
        told = type(error)(f"{text}. {_NEXT}") if text.endswith(")") else error
        return DrawnZone(name, _place_of(where), None, fault=told)


def _place_of(where: Where) -> str:
    """File and feature, as messages name them."""
    return f"{where.file}: {where.place}" if where.place else where.file


def _refuse_misspelt(where: Where, properties: Mapping[str, object]) -> None:
    """A limit that is not read is worse than a refusal."""
    for key in properties:
        near = get_close_matches(key, _LIMITS, n=1, cutoff=0.75)
        if near and key not in _LIMITS:
            raise where.error(f"unknown property '{where.text(key, 'a property', 40)}', did you mean '{near[0]}'?")


@contextmanager
def next_step(text: str) -> Iterator[None]:
    """Add the next step to a MissionError of the block."""
    try:
        yield
    except MissionError as error:
        raise MissionError(f"{error}. {text}", grave=error.grave) from None


def polygon_of(where: Where, rings: Sequence[object], home: Home) -> Polygon | MultiPolygon:
    """The polygon of an outline and its holes. Rings that are not closed are closed. Raises MissionError."""
    if not rings:
        raise where.error("no ring in the polygon (allowed: 1 or more)")
    paths = []
    for number, entry in enumerate(rings):
        inside = where.at(f"hole {number}") if number else where
        corners = inside.array(entry, "the ring")
        path = [position_of(inside, corner, f"corner {n}", home) for n, corner in enumerate(corners, 1)]
        if len(set(path)) < 3:
            raise inside.error(f"{len(set(path))} corners (allowed: 3 or more)")
        paths.append(path)
    return _area_of_paths(where, paths)


def _area_of_paths(where: Where, paths: Sequence[Sequence[tuple[float, float]]]) -> Polygon | MultiPolygon:
    """The area of paths of (longitude, latitude): an outline, then its holes. Raises MissionError."""
    longitudes = [lon for lon, _lat in paths[0]]
    across = max(longitudes) - min(longitudes) > 180.0
    shifted = [[(lon + 360.0 if across and lon < 0.0 else lon, lat) for lon, lat in path] for path in paths]
    polygon = Polygon(shifted[0], shifted[1:])
    with next_step("Draw the outline again, without the crossing"):
        check_valid(where, polygon)
    return cut_at_meridian(polygon)


def cut_at_meridian(area: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
    """The area with longitudes from -180 to 180: cut in two where it goes on beyond them."""
    west, _south, east, _north = area.bounds
    if west >= -180.0 and east <= 180.0:
        return area
    parts = [
        translate(shapely.intersection(area, box(180.0 + turn, -90.0, 540.0 + turn, 90.0)), -360.0 - turn)
        for turn in (-720.0, -360.0, 0.0)
    ]
    pieces = (piece for part in parts for piece in shapely.get_parts(part))
    polygons = [piece for piece in pieces if isinstance(piece, Polygon) and not piece.is_empty]
    return polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)


def areas_among(geometries: Iterable[Iterator[Area]]) -> Iterator[Area]:
    """The areas of several geometries. Lines and points among them are left out. Raises NoArea: there is no area."""
    none: NoArea | None = None
    found = False
    for geometry in geometries:
        try:
            for area in geometry:
                found = True
                yield area
        except NoArea as error:
            none = none or error
    if none is not None and not found:
        raise none


def areas_joined(where: Where, areas: Sequence[Area]) -> Area:
    """One area of several that do not overlap. Raises MissionError."""
    if not areas:
        raise NoArea(str(where.error(f"no area in it (allowed: {ALLOWED}). Draw the zone as a polygon")))
    if len(areas) == 1:
        return areas[0]
    outlines = [cut_at_meridian(area.outline()) if isinstance(area, Circle) else area for area in areas]
    parts = [part for area in outlines for part in shapely.get_parts(area)]
    joined = MultiPolygon(parts)
    if joined.is_valid:
        return joined
    union = shapely.union_all(parts)
    assert isinstance(union, Polygon | MultiPolygon)
    return union


# ---- corners ------------------------------------------------------------------------------------------------------


def corners_of(area: Area) -> int:
    """Positions of all rings, as GeoJSON counts them; a circle has none."""
    return 0 if isinstance(area, Circle) else sum(map(len, rings_of(area)))


def simplified(area: Area, most: int = MAX_CORNERS) -> tuple[Area, float]:
    """The area with at most so many corners, and by how many metres its border has moved at the most.

    The least tolerance that is enough is searched. Raises ValueError: no tolerance is enough.
    """
    if isinstance(area, Circle) or corners_of(area) <= most:
        return area, 0.0
    per_lat, per_lon = degree_lengths_m(area.centroid.y)
    scale = [per_lon, per_lat]
    flat = shapely.transform(area, lambda corners: corners * scale)
    low, high = 0.0, 1.0
    while corners_of(found := flat.simplify(high)) > most:
        low, high = high, 2.0 * high
        if high > 1e6:
            raise ValueError(f"{corners_of(found)} corners are left")
    while high - low > max(_SEARCH_M, 0.01 * high):
        middle = (low + high) / 2.0
        low, high = (low, middle) if corners_of(flat.simplify(middle)) <= most else (middle, high)
    found = flat.simplify(high)
    moved_m = float(shapely.hausdorff_distance(found.boundary, flat.boundary))
    return shapely.transform(found, lambda corners: corners / scale), moved_m


def with_few_corners(zone: DrawnZone, most: int) -> tuple[DrawnZone, float]:
    """The zone with at most so many corners, and by how many metres its border has moved. Raises MissionError."""
    assert zone.area is not None
    try:
        area, moved_m = simplified(zone.area, most)
    except ValueError as error:
        raise MissionError(
            f"{zone.place}: {error} after every simplification (allowed: at most {most}). Draw fewer parts and holes"
        ) from None
    return replace(zone, area=area), moved_m
