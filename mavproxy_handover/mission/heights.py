# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights of a route that depend on more than the route: above the sea, above terrain, near the ground.

Rules
-----
* A height above the sea is right only if the plan's home is as high as the autopilot's. They may differ by
  `HOME_WITHIN_M`: so much lower than checked an item may be flown, and so much clearance above the ground the check
  demands (`CLEAR_M`). Satellite positions at rest are within it, a forgotten home height is not.
* A height above terrain is known before the flight only with the heights of the ground that a mission may bring.
* Where the mission brings no heights of the ground, a way at home's height or below leads into the ground, unless that
  is lower there: an error. Less than `LOW_M` above home is a warning: the height itself is known to some metres only
  (the barometer drifts, home is set when arming). Take-offs and landings are neither. NAV_DELAY is not
  judged: it waits where the item before it ends, also on the ground.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, inf
from typing import Final

from mavproxy_handover.mission.items import (
    COMMANDS,
    DELAY,
    FRAME_ABOVE_SEA,
    FRAME_ABOVE_TERRAIN,
    LANDINGS,
    RETURN_TO_LAUNCH,
    TAKEOFFS,
    MissionItem,
)
from mavproxy_handover.mission.leg import Leg
from mavproxy_handover.mission.plan import Route, ways_from_land_starts
from mavproxy_handover.mission.terrain import CLEAR_M, Relief

__all__ = [
    "HOME_WITHIN_M",
    "LOW_M",
    "Low",
    "above_ground_m",
    "above_sea",
    "above_terrain",
    "home_disagrees",
    "into_ground",
    "listed",
    "low_ways",
    "named",
]

#: how far the plan's home and the autopilot's may be apart in height (m) if any item is above the sea
HOME_WITHIN_M: Final = CLEAR_M
#: lower above home than that (m) a way is near the ground
LOW_M: Final = 5.0
#: a way that climbs is compared to the ground in pieces of this length (m)
_GROUND_STEP_M: Final = 25.0
#: most item numbers in a list
_MOST_LISTED: Final = 8
#: a height that is stored as none, by autopilots that do that (m)
_NO_HEIGHT_M: Final = 0.01


def above_sea(route: Route) -> tuple[MissionItem, ...]:
    """The items that are flown at a height above the sea."""
    profile = route.profile
    return tuple(
        item
        for item in _flown(route, FRAME_ABOVE_SEA)
        if item.command not in profile.height_unused
        and not (profile.height_zero_unused and abs(item.alt_m) < _NO_HEIGHT_M)
    )


def above_terrain(route: Route) -> tuple[MissionItem, ...]:
    """The items that are flown to at a height above terrain."""
    return tuple(_flown(route, FRAME_ABOVE_TERRAIN))


def above_ground_m(relief: Relief, leg: Leg) -> float:
    """The least height above the ground on a way, which may climb, or follow the ground; infinite: not known."""
    if leg.follows:
        return min(alt - (relief.rise_m(lat, lon) or 0.0) for lat, lon, alt in (leg.start, leg.end))
    count = max(1, ceil(leg.length_m / _GROUND_STEP_M))
    spots = [leg.at(number / count) for number in range(count + 1)]
    return min(relief.above_m(a[:2], b[:2], min(a[2], b[2])) for a, b in pairwise(spots))


def into_ground(route: Route, legs: Sequence[Leg], relief: Relief | None) -> str:
    """Text about a path into the ground; "" if there is none, or the ground is unknown."""
    for leg in legs:
        item = route.items[leg.seq - 1]
        # a return climbs first, and is judged by itself
        if relief is None or leg.length_m <= 0.0 or item.command == RETURN_TO_LAUNCH:
            continue
        if above_ground_m(relief, leg) < 0.0:
            return f"the way to {named(item)} leads into the ground. Plan it higher"
    return ""


def _flown(route: Route, frame: int) -> Iterator[MissionItem]:
    for item in route.items:
        command = COMMANDS[item.command]
        if command.flown and command.located and item.frame == frame:
            yield item


def named(item: MissionItem) -> str:
    """An item for people: its number and its kind."""
    return f"item {item.seq} ({COMMANDS[item.command].name})"


def listed(items: Sequence[MissionItem]) -> str:
    """Several items for people: their numbers, and the kind of the first."""
    if len(items) == 1:
        return named(items[0])
    numbers = [str(item.seq) for item in items[:_MOST_LISTED]]
    more = len(items) - len(numbers)
    last = f"{more} more" if more else numbers.pop()
    return f"items {', '.join(numbers)} and {last} ({COMMANDS[items[0].command].name} first)"


def home_disagrees(items: Sequence[MissionItem], plan_m: float, autopilot_m: float | None) -> str:
    """Why items above the sea would not be flown at the heights that were checked, in words; "": they would.

    `plan_m`: home above the sea in the plan, `autopilot_m`: in the autopilot; None: not known.
    """
    if not items:
        return ""
    what = f"{named(items[0])}{'' if len(items) == 1 else f' and {len(items) - 1} more'} above sea"
    if autopilot_m is None:
        return f"{what}: the height of the autopilot's home is not known"
    if abs(autopilot_m - plan_m) <= HOME_WITHIN_M:
        return ""
    return (
        f"{what}: home is at {plan_m:.0f} m in the plan and at {autopilot_m:.0f} m in the autopilot (allowed: "
        f"{HOME_WITHIN_M:g} m apart). Plan heights above home, or home at its height"
    )


@dataclass(frozen=True, slots=True)
class Low:
    """Items on the way to which the aircraft comes near home's height, and the lowest height above home (m)."""

    items: tuple[MissionItem, ...]
    lowest_m: float

    @property
    def below(self) -> bool:
        """True if it is at home's height or below."""
        return self.lowest_m <= 0.0

    @property
    def text(self) -> str:
        """What is wrong and what to do, for people."""
        height = f"{abs(self.lowest_m):.1f}".removesuffix(".0")
        if self.lowest_m == 0.0:
            where = "down to the height of home: into the ground unless that is lower there"
        elif self.below:
            where = f"down to {height} m below home: into the ground unless that is lower there"
        else:
            where = f"{height} m above home, less than {LOW_M:g} m"
        return f"{listed(self.items)}: {where}. Plan higher, or bring the heights of the ground (key 'terrain')"


def low_ways(route: Route, legs: Iterable[Leg]) -> tuple[Low, ...]:
    """The legs at home's height or below, and low ones, if the mission has no heights of the ground."""
    lands = {item.seq for way in ways_from_land_starts(route.items) for item in way}
    free = frozenset((*TAKEOFFS, *LANDINGS, RETURN_TO_LAUNCH, DELAY, *route.profile.height_unused))
    lowest: dict[int, float] = {}
    for leg in legs:
        item = route.items[leg.seq - 1]
        known = route.ground is not None and route.ground.rise_m(*leg.end[:2]) is not None
        if item.command in free or known or (route.profile.flies_past and leg.seq in lands):
            continue
        lowest[leg.seq] = min(lowest.get(leg.seq, inf), round(leg.end[2], 3))
    below = {seq: height for seq, height in lowest.items() if height <= 0.0}
    low = {seq: height for seq, height in lowest.items() if 0.0 < height < LOW_M}
    return tuple(
        Low(tuple(route.items[seq - 1] for seq in found), min(found.values())) for found in (below, low) if found
    )
