# SPDX-License-Identifier: GPL-3.0-or-later

"""Gaps of a mission for feeds: ground around home for terrain, places of operators for Remote ID."""

from __future__ import annotations

from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.heights import above_terrain
from mavproxy_handover.mission.package import MissionPackage

__all__ = ["ground_lacks", "places_lack"]

#: ArduPilot asks for nine tiles around the aircraft, with TERRAIN_SPACING 100 (`AP_Terrain::update_surrounding_tiles`):
#: so far (km) from home, to the north and to the east, is ground that it wants
_NORTH_KM, _EAST_KM = 4.7, 5.4


def ground_lacks(package: MissionPackage) -> str:
    """Text about a grid that ends before the ground that the autopilot wants; "" if there is none."""
    home, terrain = package.route.home, package.terrain
    if terrain is None or not above_terrain(package.route):
        return ""
    sides = [(north, east) for north in (-1, 0, 1) for east in (-1, 0, 1)]
    away = [(east * _EAST_KM * 1e3, north * _NORTH_KM * 1e3) for north, east in sides]
    spots = [offset(home.lat_deg, home.lon_deg, *metres) for metres in away]
    if all(terrain.between_m(spot) is not None for spot in spots):
        return ""
    return (
        f"the heights of the ground do not reach {_NORTH_KM:g} km north and south, {_EAST_KM:g} km east and west of "
        "home. The autopilot asks for that much, and does not arm before it has all. Use a larger grid, or name "
        "stations that know the rest in [feeds] terrain"
    )


def places_lack(package: MissionPackage) -> str:
    """Text about stations without a place, where others have one; "" if there are none."""
    without = [station.name for station in package.stations if station.place is None]
    if not without or len(without) == len(package.stations):
        return ""
    return (
        f"no 'place' in [[stations]] of {', '.join(without)}: Remote ID has the operator's place only from its program"
    )
