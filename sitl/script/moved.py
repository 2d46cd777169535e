# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission package at another home: the same flight anywhere on earth.

Every place of the route, the fence, the rally points and the zones keeps its way east and north from home; the rest of
the package stays as it is. Distances from home are the same. Those between other places change with the latitude: by
one in a thousand for a package of 10 km that goes from one side of the equator to the other.

A zone that comes to lie across the 180th meridian is cut there, as GeoJSON wants it. Heights of the ground belong to
the ground: a package that brings some along is not moved.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon, box, mapping, shape
from shapely.ops import unary_union

from mavproxy_handover.mission.geodesy import beside_deg, east_north_m, offset
from mavproxy_handover.mission.items import COMMANDS
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage, from_texts
from mavproxy_handover.mission.plan import Home
from sitl.script.places import SetupError

__all__ = ["Place", "moved", "read_place"]

#: nearer to a pole distances are not measured well enough
HIGHEST_LAT_DEG: Final = 80.0
_LOWEST_M, _HIGHEST_M = -500.0, 9000.0
#: a tenth of a millimetre
_DIGITS: Final = 9
#: halves of a zone that was cut meet within this (degrees)
_SEAM_DEG: Final = 1e-9

#: (latitude, longitude) to (latitude, longitude), degrees
_Move = Callable[[float, float], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Place:
    """Where a flight is to begin. `alt_m` above the sea, None: as the mission has it; `heading_deg` of the aircraft."""

    lat_deg: float
    lon_deg: float
    alt_m: float | None = None
    heading_deg: float = 0.0


def read_place(text: str) -> Place:
    """Parse LAT,LON or LAT,LON,ALT or LAT,LON,ALT,HEADING. Raises SetupError."""
    parts = text.split(",")
    limits = (
        ("latitude", -HIGHEST_LAT_DEG, HIGHEST_LAT_DEG),
        ("longitude", -180.0, 180.0),
        ("altitude", _LOWEST_M, _HIGHEST_M),
        ("heading", 0.0, 360.0),
    )
    if not 2 <= len(parts) <= len(limits):
        raise SetupError(
            f"--home {text!r}: {len(parts)} numbers (allowed: LAT,LON or LAT,LON,ALT or LAT,LON,ALT,HEADING)"
        )
    numbers = []
    for part, (name, low, high) in zip(parts, limits, strict=False):
        try:
            number = float(part)
        except ValueError:
            raise SetupError(f"--home {text!r}: {name} is {part.strip()!r} (allowed: a number)") from None
        if not low <= number <= high:
            raise SetupError(f"--home {text!r}: {name} {number:g} (allowed: {low:g} to {high:g})")
        numbers.append(number)
    if numbers[:2] == [0.0, 0.0]:
        raise SetupError(f"--home {text!r}: at latitude 0, longitude 0 an item means wherever the aircraft is")
    return Place(*numbers)


def moved(package: MissionPackage, place: Place) -> MissionPackage:
    """The package with its home there. Raises SetupError: it cannot be moved; MissionError: there it is no mission."""
    if package.terrain is not None:
        raise SetupError(f"{package.name}: its heights of the ground are of where it is: it cannot be flown elsewhere")
    home = package.route.home
    alt_m = home.alt_m if place.alt_m is None else place.alt_m

    def move(lat_deg: float, lon_deg: float) -> tuple[float, float]:
        lat, lon = offset(place.lat_deg, place.lon_deg, *east_north_m(home.lat_deg, home.lon_deg, lat_deg, lon_deg))
        return round(lat, _DIGITS), round(lon, _DIGITS)

    texts = {}
    for name, data in package.files.items():
        text = data.decode()
        if name.endswith(".plan"):
            text = _plan(json.loads(text), move, alt_m, alt_m - home.alt_m)
        elif name.endswith(".waypoints"):
            text = _waypoints(text, move, alt_m, alt_m - home.alt_m)
        elif name != MISSION_FILE:
            text = _zones(json.loads(text), move, home, place)
        texts[name] = text
    return from_texts(texts, package.name)


def _plan(plan: Any, move: _Move, alt_m: float, higher_m: float) -> str:
    """Of what read_route takes: places are at known keys, those of a scan too.

    Latitude and longitude 0, both, are no place: an item with these is for wherever the aircraft is then.
    """
    mission = plan["mission"]
    mission["plannedHomePosition"] = [*move(*mission["plannedHomePosition"][:2]), alt_m]
    for item in _simple(mission["items"]):
        numbers = item["params"]
        if COMMANDS[item["command"]].located and any(numbers[4:6]):
            numbers[4:6] = move(*numbers[4:6])
            if item["frame"] in _ABOVE_SEA:
                numbers[6] += higher_m
    for point in (plan.get("rallyPoints") or {}).get("points", []):
        point[:2] = move(*point[:2])
    fence = plan.get("geoFence") or {}
    for polygon in fence.get("polygons", []):
        polygon["polygon"] = [move(*corner) for corner in polygon["polygon"]]
    for circle in fence.get("circles", []):
        circle["circle"]["center"] = move(*circle["circle"]["center"])
    if fence.get("breachReturn") is not None:
        fence["breachReturn"][:2] = move(*fence["breachReturn"][:2])
    return json.dumps(plan, indent=4) + "\n"


def _simple(items: list[Any]) -> Iterator[Any]:
    """The items of a plan, and those that its scans store."""
    for item in items:
        scan = item.get("TransectStyleComplexItem", item)
        yield from [item] if item["type"] == "SimpleItem" else scan["Items"]


#: MAV_FRAME_GLOBAL, MAV_FRAME_MISSION and MAV_FRAME_GLOBAL_INT
_ABOVE_SEA: Final = (0, 2, 5)


def _waypoints(text: str, move: _Move, alt_m: float, higher_m: float) -> str:
    lines = text.splitlines()
    home = True
    for number, line in enumerate(lines[1:], 1):
        fields = line.split()
        if not fields or line.startswith("#"):
            continue
        at = float(fields[8]), float(fields[9])
        if home or (COMMANDS[int(float(fields[3]))].located and any(at)):
            lat, lon = move(*at)
            fields[8:10] = f"{lat:.{_DIGITS}f}", f"{lon:.{_DIGITS}f}"
            if home:
                fields[10] = f"{alt_m:g}"
            elif float(fields[2]) in _ABOVE_SEA:
                fields[10] = f"{float(fields[10]) + higher_m:g}"
        lines[number] = "\t".join(fields)
        home = False
    return "\n".join(lines) + "\n"


def _zones(zones: Any, move: _Move, home: Home, place: Place) -> str:
    def beside(spots: NDArray[np.float64]) -> NDArray[np.float64]:
        there = [move(lat, lon) for lon, lat in spots]
        return np.array([(beside_deg(lon, place.lon_deg), lat) for lat, lon in there])

    for feature in zones["features"]:
        geometry = feature["geometry"]
        if geometry["type"] == "Point":
            lat, lon = move(geometry["coordinates"][1], geometry["coordinates"][0])
            feature["geometry"] = {"type": "Point", "coordinates": [lon, lat]}
            continue
        area = shape(geometry)
        if isinstance(area, MultiPolygon):  # what was cut at the meridian is whole again
            whole = unary_union(
                [_beside(part, home.lon_deg).buffer(_SEAM_DEG, join_style="mitre") for part in area.geoms]
            )
            area = whole.buffer(-_SEAM_DEG, join_style="mitre")
        feature["geometry"] = mapping(_cut(shapely.transform(area, beside)))
    return json.dumps(zones, indent=4) + "\n"


def _beside(part: Polygon, lon_deg: float) -> Polygon:
    """The part, counted from the side of the 180th meridian where that longitude is."""
    middle = part.centroid.x
    return affinity.translate(part, beside_deg(middle, lon_deg) - middle)


def _cut(area: Any) -> Any:
    """Cut at the 180th meridian where it lies across it, each part counted from -180 to 180."""
    west, _south, east, _north = area.bounds
    if west >= -180.0 and east <= 180.0:
        return area
    parts = []
    for turn in (-360.0, 0.0, 360.0):
        part = area.intersection(box(-180.0 + turn, -90.0, 180.0 + turn, 90.0))
        pieces = part.geoms if isinstance(part, MultiPolygon) else [part]
        parts += [
            affinity.translate(piece, -turn) for piece in pieces if isinstance(piece, Polygon) and piece.area > 0.0
        ]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)
