# SPDX-License-Identifier: GPL-3.0-or-later

"""A plane's take-off without a place: it climbs straight ahead, in the direction in which it stands.

Mission Planner makes such take-offs. ArduPlane passes over the place of a take-off anyhow (`Plane::do_takeoff`): it
holds its course until it is as high as the item says. A place tells the check in which direction the runway leads.
Without one the check walks the climb towards the next place. It adds the time of the way back, which there is if the
aircraft stands the other way round. Coverage and geofence must hold the climb in every direction (`check.py`).
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.mission.geodesy import east_north_m, offset
from mavproxy_handover.mission.items import TAKEOFFS, MissionItem
from mavproxy_handover.mission.plan import Route, first_in_air, next_place

__all__ = ["WING_CLIMB_MPS", "climb_end", "climb_m", "is_open", "open_takeoff"]

#: how slowly wings may climb or sink while they go straight on to another height
WING_CLIMB_MPS: Final = 2.0


def open_takeoff(route: Route) -> MissionItem | None:
    """The take-off of a route if it has no place and needs one; None: there is no such take-off."""
    first = first_in_air(route.items)
    return first if first is not None and is_open(route, first) else None


def is_open(route: Route, item: MissionItem) -> bool:
    """True for a take-off whose direction the plan leaves open."""
    return route.profile.takeoff_needs_place and item.command in TAKEOFFS and not item.has_place


def climb_m(climb_m: float, speed_mps: float) -> float:
    """How far wings go ahead while they climb so much."""
    return speed_mps * abs(climb_m) / WING_CLIMB_MPS


def climb_end(route: Route, item: MissionItem, here: tuple[float, float], ahead_m: float) -> tuple[float, float]:
    """Where the climb of such a take-off ends if the aircraft stands towards the next place."""
    to = next_place(route.items, item)
    east, north = (0.0, 0.0) if to is None else east_north_m(*here, *to)
    length = math.hypot(east, north)
    if length == 0.0:  # one direction is as good as another
        return offset(*here, 0.0, ahead_m)
    return offset(*here, ahead_m * east / length, ahead_m * north / length)
