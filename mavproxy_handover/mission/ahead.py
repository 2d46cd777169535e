# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks whether a path from here leaves coverage or geofence, as text for `core/safety/commands.py`.

Rules that live here
--------------------
* Within `NEAR_M` along the path, coverage is that of the stations that could take the aircraft now. Farther on it is
  that of the mission, because a station down the route need not be there yet.
* A gap that the mission declares counts as covered: it was judged before take-off, and its limit is enforced.
* Places outside at the beginning do not count, so that an aircraft can be brought back inside. But it must come inside
  with the first leg or on the first curve, and stay there.
* The vertical parts of a path, take-off and landing, leave nothing that their place does not leave.
* Wings circle their target, as far away as the radius says: one circle counts (`around`). A change of height alone
  counts as a metre of path, because wings climb on their way, wherever that leads.
* A path is checked every `STEP_M`, at `MOST_STEPS` places at most; the fence is checked exactly.

The time of a check grows with zones and legs, so the caller must limit its rate.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise, takewhile

from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.gaps import Stretch
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.leg import DEFAULT_CRUISE_MPS
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import Leg, legs_from
from mavproxy_handover.mission.zones import ZoneFinder

__all__ = ["NEAR_M", "Ahead", "around", "leaves_coverage", "leaves_fence", "straight", "to_height"]

#: half a minute of flight at 10 m/s
NEAR_M = 300.0
STEP_M = 20.0
MOST_STEPS = 400
#: straight pieces of a circle: with this number the corners are a thousandth of its radius outside
_PIECES = 72
#: length (m) of the path to another height
_ON_M = 1.0

_Place = tuple[float, float, float]  #: latitude, longitude, metres above home


def straight(here: _Place, there: _Place, speed_mps: float) -> tuple[Leg, ...]:
    """The path to a guided target."""
    return (Leg(0, here, there, 0.0, 0.0, speed_mps),)


def to_height(here: _Place, alt_m: float, speed_mps: float) -> tuple[Leg, ...]:
    """The path of wings to another height (m above home)."""
    return straight(here, (*offset(*here[:2], 0.0, _ON_M), alt_m), speed_mps)


def around(there: _Place, radius_m: float, speed_mps: float) -> tuple[Leg, ...]:
    """The circle that wings fly around a guided target: out to it, and once around.

    Its pieces are outside the flown circle, nowhere inside.
    """
    corner_m, angles = radius_m / math.cos(math.pi / _PIECES), [math.tau * n / _PIECES for n in range(_PIECES)]
    ring = [(*offset(*there[:2], corner_m * math.sin(a), corner_m * math.cos(a)), there[2]) for a in angles]
    return tuple(leg for start, end in pairwise((there, *ring, ring[0])) for leg in straight(start, end, speed_mps))


def leaves_coverage(
    legs: Sequence[Leg], finder: ZoneFinder, usable: Collection[int], gaps: Collection[Stretch] = ()
) -> str:
    """Text about where a path leaves coverage; "" if it does not.

    `usable`: stations that could take the aircraft. `gaps`: declared gaps, with their places.
    """
    inside, before, outside = False, 0.0, ""
    for far_m, place, seq, first in _places(legs):
        if not inside and not first:
            return outside
        holding = finder.holding(*place)
        # before it has been inside once, only coverage that can be used now counts
        by_plan = inside and far_m > NEAR_M
        covered = bool(holding) if by_plan else any(station in usable for station in holding)
        covered = covered or any(_within_gap(gap, seq, place) for gap in gaps)
        if not covered and inside:
            return f"leaves coverage {_after(before)}{_item(seq)}"
        outside = "" if covered else f"leads out of coverage{_item(seq)}"
        inside, before = covered, far_m
    return outside


def _within_gap(gap: Stretch, seq: int, place: _Place) -> bool:
    along_m = gap.along_m(seq, *place[:2])
    return along_m is not None and -STEP_M <= along_m <= gap.found.length_m + STEP_M


def leaves_fence(legs: Sequence[Leg], fence: Fence, ceiling_m: float | None = None) -> str:
    """Text about where a path leaves the geofence; "" if it does not. `ceiling_m`: above home."""
    gone_m, inside = 0.0, bool(legs) and fence.holds(legs[0].start[:2])
    joins = _first_way(legs)
    for number, leg in enumerate(legs):
        if ceiling_m is not None and leg.end[2] > ceiling_m:
            return f"climbs above the fence's ceiling of {ceiling_m:g} m"
        start, end = leg.start[:2], leg.end[:2]
        held = fence.holds(end)
        comes_back = not inside and number + 1 < joins
        if not (held or comes_back) or (fence.holds(start) and not fence.holds_way(start, end)):
            return f"breaks the geofence {_within(gone_m + leg.length_m)}{_item(leg.seq)}"
        gone_m, inside = gone_m + leg.length_m, inside or held
    return ""


def _first_way(legs: Sequence[Leg]) -> int:
    """Number of legs to the first item, if that is a curve or follows the ground; else 1."""
    in_pieces = takewhile(lambda leg: leg.seq == legs[0].seq and (leg.curved or leg.follows), legs)
    return max(1, sum(1 for _leg in in_pieces))


def _places(legs: Sequence[Leg]) -> Iterator[tuple[float, _Place, int, bool]]:
    """Places on a path: distance along it (m), place, item, and True on the first leg.

    The first one is the beginning.
    """
    level = [(leg, leg.length_m) for leg in legs]
    step_m = max(STEP_M, sum(length for _leg, length in level) / MOST_STEPS)
    gone_m = looked_at_m = 0.0
    if legs:
        yield 0.0, legs[0].start, 0, True
    joins = _first_way(legs)
    for number, (leg, length_m) in enumerate(level):
        first = gone_m == 0.0 or number < joins
        # of curves not every piece is checked, but the last one is
        goes_on = (leg.curved or leg.follows) and number + 1 < len(level) and level[number + 1][0].seq == leg.seq
        steps = 0 if goes_on and gone_m + length_m - looked_at_m < step_m else math.ceil(length_m / step_m)
        for step in range(1, steps + 1):
            looked_at_m = gone_m + length_m * step / steps
            yield looked_at_m, leg.at(step / steps), leg.seq, first
        gone_m += length_m


def _after(far_m: float) -> str:
    return "at once" if far_m < STEP_M else f"in {far_m:.0f} m"


def _within(far_m: float) -> str:
    return f"within {far_m:.0f} m"


def _item(seq: int) -> str:
    return f" (item {seq})" if seq else ""


class Ahead:
    """A loaded plan, with the zones of its mission."""

    def __init__(self, route: Route, finder: ZoneFinder, cruise_speed_mps: float | None) -> None:
        """`finder`: used only here, because it remembers its last place."""
        self.route = route
        self.finder = finder
        self.fence = Fence(route.fence)
        #: declared gaps, once they are found on its route
        self.gaps: tuple[Stretch, ...] = ()
        #: horizontal speed if the plan sets none
        self.speed_mps = cruise_speed_mps or route.cruise_speed_mps or DEFAULT_CRUISE_MPS

    def way(self, seq: int, here: _Place) -> tuple[Leg, ...]:
        """The path if the mission continues here with that item."""
        return legs_from(self.route, seq, here, self.speed_mps)
