# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a file of zones, of the format that its ending names and of bounded size."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from mavproxy_handover.mission.drawn.areas import DrawnZone, Home, NoArea, corners_of
from mavproxy_handover.mission.drawn.fence import read_plan_fence
from mavproxy_handover.mission.drawn.geojson import read_geojson
from mavproxy_handover.mission.drawn.kml import kml_of_kmz, read_kml
from mavproxy_handover.mission.errors import MissionError, Where

__all__ = ["ENDINGS", "MAX_FILE_BYTES", "read_text", "read_zone_file"]

MAX_FILE_BYTES: Final = 16 * 1024 * 1024
#: corners of all zones of a file, before they are simplified
MAX_FILE_CORNERS: Final = 200_000
ENDINGS: Final = (".geojson", ".json", ".kml", ".kmz", ".plan")


def read_zone_file(path: Path, home: Home = None) -> tuple[DrawnZone, ...]:
    """The zones of a file. `home`: latitude and longitude, to notice swapped coordinates. Raises MissionError.

    A file with one zone that has no name gives it the name of the file. Lines and points beside zones are `aside`.
    """
    where = Where(path.name)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise where.error(f"not a file of zones (allowed: a file that ends in {', '.join(ENDINGS)}). Export it so")
    zones = tuple(reader(where, _read(path, MAX_FILE_BYTES), home))
    if not zones:
        raise where.error(f"no zone in it (allowed: {_HOLDS[path.suffix.lower()]}). Draw one for each station")
    corners = sum(corners_of(zone.area) for zone in zones if zone.area is not None)
    if corners > MAX_FILE_CORNERS:
        raise where.error(f"{corners} corners (allowed: at most {MAX_FILE_CORNERS}). Export it with less detail")
    if path.suffix.lower() == ".plan":
        return zones
    areas = [zone for zone in zones if not isinstance(zone.fault, NoArea)] or zones
    alone = len(areas) == 1 and not areas[0].name
    return tuple(
        replace(zone, name=path.stem if alone and zone is areas[0] else zone.name, aside=zone not in areas)
        for zone in zones
    )


def read_text(path: Path, most: int = MAX_FILE_BYTES) -> str:
    """The text of a file in UTF-8, with line ends as \\n. Raises MissionError."""
    return _decoded(Where(path.name), _read(path, most))


def _read(path: Path, most: int) -> bytes:
    try:
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except OSError as error:
        raise MissionError(f"{path}: {error.strerror or 'cannot be read'}") from None
    if len(data) > most:
        raise MissionError(f"{path}: larger than {most} bytes. Leave out what is not needed")
    return data


def _decoded(where: Where, data: bytes) -> str:
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise where.error(f"not UTF-8 text (byte {error.start}). Save it as UTF-8") from None


def _geojson(where: Where, data: bytes, home: Home) -> Iterator[DrawnZone]:
    return read_geojson(where, _decoded(where, data), home)


def _kmz(where: Where, data: bytes, home: Home) -> Iterator[DrawnZone]:
    return read_kml(where, kml_of_kmz(where, data, MAX_FILE_BYTES), home)


def _plan(where: Where, data: bytes, home: Home) -> Iterator[DrawnZone]:
    return read_plan_fence(where, _decoded(where, data), home)


_READERS: Final[Mapping[str, Callable[[Where, bytes, Home], Iterator[DrawnZone]]]] = {
    ".geojson": _geojson,
    ".json": _geojson,
    ".kml": read_kml,
    ".kmz": _kmz,
    ".plan": _plan,
}
#: ending -> what a file of it has to hold
_HOLDS: Final = {
    ".geojson": "a feature with a polygon",
    ".json": "a feature with a polygon",
    ".kml": "a placemark with a polygon",
    ".kmz": "a placemark with a polygon",
    ".plan": "an inclusion polygon or circle in the geofence",
}
