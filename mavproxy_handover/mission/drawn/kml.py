# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones from KML and KMZ (OGC KML 2.2 and older): each placemark with polygons is one.

The file is read with expat. A document type is refused, so no entity is expanded and nothing is fetched. The sizes of
the file and of what is unpacked are bounded, as is the depth of elements. Namespaces are ignored, because many
programs write wrong ones.

A KMZ file is a ZIP archive. Its `doc.kml` counts, else its first file that ends in `.kml`.
"""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from mavproxy_handover.mission.drawn.areas import (
    Area,
    DrawnZone,
    Home,
    NoArea,
    areas_among,
    drawn_zone,
    name_of,
    polygon_of,
)
from mavproxy_handover.mission.drawn.geojson import circle_at
from mavproxy_handover.mission.errors import MissionError, Where

__all__ = ["MAX_DEPTH", "MAX_ELEMENTS", "kml_of_kmz", "read_kml"]

MAX_DEPTH: Final = 60
MAX_ELEMENTS: Final = 200_000
_ALLOWED: Final = "Polygon, MultiGeometry of polygons, Point with radius_m"
_NEXT: Final = "Draw it as a polygon, or name the zones that count with --station NAME=ZONE"
#: elements of a placemark that are a geometry
_GEOMETRIES: Final = frozenset(
    ("Polygon", "MultiGeometry", "MultiPolygon", "Point", "LineString", "LinearRing", "Model", "Track", "MultiTrack")
)
_GROUPS: Final = ("MultiGeometry", "MultiPolygon")
_LIMITS: Final = ("min_alt_m", "max_alt_m", "radius_m")


def read_kml(where: Where, data: bytes, home: Home) -> Iterator[DrawnZone]:
    """The zones of a KML file, each with its own fault. Raises MissionError for a file that holds none."""
    root = _tree(where, data)
    if root.tag != "kml":
        raise where.error(f"its first element is <{root.tag[:40]}> (allowed: <kml>). Export it as KML")
    for number, placemark in enumerate(root.iter("Placemark"), 1):
        yield _zone(where, f"placemark {number}", placemark, home)


def kml_of_kmz(where: Where, data: bytes, most: int) -> bytes:
    """The KML file in a KMZ archive, of at most so many bytes. Raises MissionError."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
            if not names:
                raise where.error("no .kml file in the archive (allowed: a KMZ file). Export it as KMZ, or as KML")
            name = "doc.kml" if "doc.kml" in names else names[0]
            with archive.open(name) as stream:
                found = stream.read(most + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError, ValueError) as error:
        if isinstance(error, MissionError):
            raise
        raise where.error(f"not a readable KMZ archive ({error}). Export it again, or as KML") from None
    if len(found) > most:
        raise where.error(f"{name[:60]} is larger than {most} bytes when unpacked. Leave out what is no zone")
    return found


# ---- the tree -----------------------------------------------------------------------------------------------------


def _tree(where: Where, data: bytes) -> Element:
    """The elements by their local names. Raises MissionError."""
    builder, depth, elements = TreeBuilder(), 0, 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, elements
        depth, elements = depth + 1, elements + 1
        if depth > MAX_DEPTH or elements > MAX_ELEMENTS:
            raise where.error(
                f"more than {MAX_DEPTH} elements deep, or more than {MAX_ELEMENTS} elements. Leave out what is no zone"
            )
        builder.start(name.rpartition(":")[2], attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name.rpartition(":")[2])

    def refuse(*_document_type: object) -> None:
        raise where.error("it has a document type (allowed: plain KML). Remove the line <!DOCTYPE ...>")

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return builder.close()
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise where.at(f"line {error.lineno}, column {error.offset + 1}").error(
            f"not XML: {reason}. Export it as KML again"
        ) from None
    except (LookupError, AssertionError) as error:  # an encoding that Python does not know
        raise where.error(f"not readable as XML ({error}). Export it as KML in UTF-8") from None


def _text(element: Element | None) -> str:
    return "" if element is None else " ".join((element.text or "").split())


# ---- a placemark --------------------------------------------------------------------------------------------------


def _zone(where: Where, place: str, placemark: Element, home: Home) -> DrawnZone:
    inside = where.at(place)
    try:
        properties = _properties(inside, placemark)
        name = name_of(str(properties.get("station") or _text(placemark.find("name"))))
    except MissionError as error:
        return drawn_zone(inside, "", {}, (), fault=error)
    inside = where.at(f"{place} ({name})") if name else inside
    geometries = [each for each in placemark if each.tag in _GEOMETRIES]
    areas = areas_among(_areas(inside, each, properties, home) for each in geometries)
    return drawn_zone(inside, name, properties, areas)


def _properties(where: Where, placemark: Element) -> dict[str, object]:
    """The values of ExtendedData that are ours: `station`, and the limits as numbers. Raises MissionError."""
    found: dict[str, object] = {}
    for each in placemark.iter():
        if each.tag not in ("Data", "SimpleData"):
            continue
        name, text = each.get("name", ""), _text(each.find("value") if each.tag == "Data" else each)
        found[name] = _number(where, name, text) if name in _LIMITS else text
    return found


def _number(where: Where, name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise where.error(f"{name} is '{text[:40]}' (allowed: a number)") from None


def _areas(where: Where, geometry: Element, properties: dict[str, object], home: Home) -> Iterator[Area]:
    """The areas of a geometry and of those in it. Raises MissionError."""
    if geometry.tag in _GROUPS:
        yield from areas_among(_areas(where, each, properties, home) for each in geometry if each.tag in _GEOMETRIES)
    elif geometry.tag == "Polygon":
        outer = geometry.find("outerBoundaryIs/LinearRing/coordinates")
        if outer is None:
            raise where.error("a Polygon without outerBoundaryIs. Draw it again")
        holes = geometry.findall("innerBoundaryIs/LinearRing/coordinates")
        yield polygon_of(where, [_positions(where, each) for each in (outer, *holes)], home)
    elif geometry.tag == "Point" and "radius_m" in properties:
        (position, *_more) = _positions(where, geometry.find("coordinates")) or [[]]
        yield circle_at(where, properties, position, home)
    else:
        raise NoArea(str(where.error(f"a {geometry.tag} is no zone (allowed: {_ALLOWED}). {_NEXT}")))


def _positions(where: Where, coordinates: Element | None) -> list[object]:
    """Positions of longitude, latitude and perhaps height. Raises MissionError."""
    text = "" if coordinates is None else re.sub(r"\s*,\s*", ",", coordinates.text or "")
    found: list[object] = []
    for number, position in enumerate(text.split(), 1):
        try:
            found.append([float(part) for part in position.split(",")])
        except ValueError:
            shown = f"corner {number} is '{position[:40]}'"
            raise where.error(f"{shown} (allowed: longitude,latitude or longitude,latitude,height)") from None
    return found
