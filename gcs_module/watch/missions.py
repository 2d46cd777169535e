# SPDX-License-Identifier: GPL-3.0-or-later

"""The missions of the page, and when an aircraft reaches its next handover.

A thread reads a mission and makes its map (`mission_map.py`), because the time for that depends on the mission. A
mission that cannot be read is reported once, and tried again when its folder has changed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gcs_module.map_items import Colour, Line, Paths
from gcs_module.mission_map import Crossing, MissionMap, mission_map
from gcs_module.watch.scene import Aircraft
from mavproxy_handover.mission.colours import station_colour
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.mission.route_simulation import Sample

__all__ = ["MOST_MISSIONS", "Coming", "Mission", "beside", "coming", "mission_of", "read"]

MOST_MISSIONS: Final = 32
#: the border may be this far behind (m): positions are up to a second old
_PASSED_M: Final = 20.0
#: an aircraft farther from its route than this (m) has no expected time at a border
_NEAR_M: Final = 300.0


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """One mission: its drawing for a browser (`drawn`), and the values used each second."""

    key: str
    name: str
    drawn: Mapping[str, Any]
    colours: Mapping[str, str]
    names: Mapping[int, str]
    crossings: tuple[Crossing, ...]
    #: by the number of the item that is flown to
    samples: Mapping[int, tuple[Sample, ...]]
    cruise_mps: float


@dataclass(frozen=True, slots=True)
class Coming:
    """The next handover on the route.

    Its two stations, the distance (m), and the time (s) at the mission's speed.
    """

    from_station: str
    to_station: str
    in_m: float
    in_s: float


def beside(journal: Path) -> Path | None:
    """The mission stored beside a journal, the newest of several; None if there is none."""
    laid = []
    for folder in journal.parent.glob(f"{journal.stem}-mission-*"):
        try:
            laid.append((folder.stat().st_mtime, folder))
        except OSError:
            continue
    return max(laid)[1] if laid else None


def read(folder: Path) -> Mission:
    """Read a mission and make its map. Raises MissionError."""
    return mission_of(load(folder))


def mission_of(package: MissionPackage) -> Mission:
    """Make the map of a package."""
    ground = mission_map(package)
    key = ground.digest.hex()[:16]
    by_seq: dict[int, list[Sample]] = {}
    for sample in package.simulate().samples:
        by_seq.setdefault(sample.seq, []).append(sample)
    return Mission(
        key,
        package.name,
        _drawn(key, package, ground),
        {entry.name: station_colour(number) for number, entry in enumerate(package.stations)},
        {entry.sysid: entry.name for entry in package.stations},
        ground.crossings,
        {seq: tuple(samples) for seq, samples in by_seq.items()},
        package.cruise_speed_mps,
    )


def _drawn(key: str, package: MissionPackage, ground: MissionMap) -> dict[str, Any]:
    names = {entry.sysid: entry.name for entry in package.stations}
    return {
        "key": key,
        "name": package.name,
        "zones": [
            {
                "station": names.get(zone.station, ""),
                "rings": _lines(zone.outline),
                "colour": _hex(zone.colour),
                "words": list(zone.words),
                "at": _point(zone.name_at),
            }
            for zone in ground.zones
        ],
        "overlaps": _lines(ground.overlaps.lines),
        "route": [_path(path) for path in ground.route.values()],
        "crossings": [
            {"number": each.number, "at": _point(each.place), "colour": _hex(each.colour)} for each in ground.crossings
        ],
        "home": _point((package.route.home.lat_deg, package.route.home.lon_deg)),
        "rally": [_point((each.lat_deg, each.lon_deg)) for each in package.route.rally],
    }


def _path(path: Paths) -> dict[str, Any]:
    return {"lines": _lines(path.lines), "colour": _hex(path.colour), "width": path.width}


def _lines(lines: Iterable[Line]) -> list[list[list[float]]]:
    return [[_point(place) for place in line] for line in lines]


def _point(place: tuple[float, float]) -> list[float]:
    return [round(place[0], 7), round(place[1], 7)]


def _hex(colour: Colour) -> str:
    red, green, blue = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


def coming(mission: Mission, craft: Aircraft) -> Coming | None:
    """The next handover of an aircraft that flies its mission's route.

    None: there is none, or it is not known.
    """
    place, waypoint = craft.place.value, craft.waypoint.value
    samples = mission.samples.get(-1 if waypoint is None else waypoint)
    if place is None or not samples or not craft.own_route:
        return None
    off_m, along_m = min(
        (distance_m(place.lat_deg, place.lon_deg, each.lat_deg, each.lon_deg), each.distance_along_m)
        for each in samples
    )
    if off_m > _NEAR_M:
        return None
    for each in mission.crossings:
        ahead_m = each.along_m - along_m
        if mission.names.get(each.from_station) == craft.commander.value and ahead_m >= -_PASSED_M:
            to = mission.names.get(each.to_station, "")
            return Coming(craft.commander.value, to, max(0.0, ahead_m), max(0.0, ahead_m) / mission.cruise_mps)
    return None
