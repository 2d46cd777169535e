# SPDX-License-Identifier: GPL-3.0-or-later

"""Words that the check of a mission uses in its findings and in its report."""

from __future__ import annotations

from mavproxy_handover.mission.energy import Budget
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.route_simulation import Handover

__all__ = ["battery_words", "handover_words", "minutes_words", "pair_words", "position_words", "way_words"]


def position_words(lat: float, lon: float) -> str:
    """Text of a position, with hemispheres."""
    return f"{abs(lat):.5f} {'N' if lat >= 0 else 'S'} {abs(lon):.5f} {'E' if lon >= 0 else 'W'}"


def way_words(distance: float) -> str:
    """Text of a distance (m) along the route."""
    return f"{distance:.0f} m along the route"


def handover_words(handover: Handover) -> str:
    """Text of where a handover begins."""
    return f"{position_words(handover.lat_deg, handover.lon_deg)}, {way_words(handover.distance_along_m)}"


def pair_words(package: MissionPackage, handover: Handover) -> str:
    """The stations of a handover by name, from and to."""
    names = {station.sysid: station.name for station in package.stations}
    return f"{names[handover.from_station]} -> {names[handover.to_station]}"


def minutes_words(seconds: float) -> str:
    """Text of a duration (s)."""
    return f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"


def battery_words(budget: Budget) -> str:
    """Text of the needed energy, and of what the battery holds."""
    return f"{budget.budget_wh:.1f} Wh of {budget.model.battery_wh:.1f} Wh"
