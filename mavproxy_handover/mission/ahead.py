# SPDX-License-Identifier: GPL-3.0-or-later

"""What a way from here on would leave: coverage, the geofence. Facts for `core/safety/commands.py`, as words.

Rules that live here
--------------------
* Near (`NEAR_M` along the way) coverage is what stations give that could take the aircraft now; farther on it is what
  the mission declares: a station down the route need not be there yet.
* A gap that the mission declares is no hole in the coverage: it was judged before take-off, and its limit is kept.
* What lies outside at the beginning does not count: whoever brings an aircraft back inside may do so. But inside it
  has to come with the first leg, or on the first curve, and to stay there.
* The vertical pieces of a way, take-off and landing, leave nothing that their place does not.
* What wings fly to they circle, as far away as the radius says: once around counts (`around`). Another height alone is
  a metre of way to it: they climb on their way, wherever that leads.
* A way is looked at every `STEP_M`, and at `MOST_STEPS` places at most; the fence is exact.

The time that a question takes grows with zones and legs: whoever asks often has to hold back.
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
#: a circle is a row of straight pieces: of so many the corners are a thousandth of its radius outside
_PIECES = 72
#: so long is the way to another height
_ON_M = 1.0

_Place = tuple[float, float, float]  #: latitude, longitude, metres above home


def straight(here: _Place, there: _Place, speed_mps: float) -> tuple[Leg, ...]:
    """The way of a guided target."""
    return (Leg(0, here, there, 0.0, 0.0, speed_mps),)


def to_height(here: _Place, alt_m: float, speed_mps: float) -> tuple[Leg, ...]:
    """The way of wings to another height (m above home)."""
    return straight(here, (*offset(*here[:2], 0.0, _ON_M), alt_m), speed_mps)


def around(there: _Place, radius_m: float, speed_mps: float) -> tuple[Leg, ...]:
    """The circle that wings fly at a guided target: out to it, and once around. Its pieces are outside of what is
    flown, nowhere inside."""
    corner_m, angles = radius_m / math.cos(math.pi / _PIECES), [math.tau * n / _PIECES for n in range(_PIECES)]
    ring = [(*offset(*there[:2], corner_m * math.sin(a), corner_m * math.cos(a)), there[2]) for a in angles]
    return tuple(leg for start, end in pairwise((there, *ring, ring[0])) for leg in straight(start, end, speed_mps))


def leaves_coverage(
    legs: Sequence[Leg], finder: ZoneFinder, usable: Collection[int], gaps: Collection[Stretch] = ()
) -> str:
    """Where a way leaves coverage, in words; "" where it does not. `usable`: stations that could take the aircraft,
    `gaps`: declared, and where they are."""
    inside, before, outside = False, 0.0, ""
    for far_m, place, seq, first in _places(legs):
        if not inside and not first:
            return outside
        holding = finder.holding(*place)
        # until it has been inside once, only what can be used counts: that is what it has to come back to
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
    """Where a way breaks the geofence, in words; "" where it does not. `ceiling_m`: above home."""
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
    """How many legs are the way to the first item, where that is a curve or follows the ground; else 1."""
    in_pieces = takewhile(lambda leg: leg.seq == legs[0].seq and (leg.curved or leg.follows), legs)
    return max(1, sum(1 for _leg in in_pieces))


def _places(legs: Sequence[Leg]) -> Iterator[tuple[float, _Place, int, bool]]:
    """Places on a way: how far each is along it (m), where, to which item, and whether on the first leg.

    The first one is where it begins.
    """
    level = [(leg, leg.length_m) for leg in legs]
    step_m = max(STEP_M, sum(length for _leg, length in level) / MOST_STEPS)
    gone_m = looked_at_m = 0.0
    if legs:
        yield 0.0, legs[0].start, 0, True
    joins = _first_way(legs)
    for number, (leg, length_m) in enumerate(level):
        first = gone_m == 0.0 or number < joins
        # of curves not every piece is looked at, but the last one is
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
    """A plan that is loaded, with the zones of its mission."""

    def __init__(self, route: Route, finder: ZoneFinder, cruise_speed_mps: float | None) -> None:
        """`finder`: one that nobody else asks, for it remembers where it was asked last."""
        self.route = route
        self.finder = finder
        self.fence = Fence(route.fence)
        #: gaps that the mission declares, once they are found on its route
        self.gaps: tuple[Stretch, ...] = ()
        #: horizontal speed where the plan itself sets none
        self.speed_mps = cruise_speed_mps or route.cruise_speed_mps or DEFAULT_CRUISE_MPS

    def way(self, seq: int, here: _Place) -> tuple[Leg, ...]:
        """The way when the mission is taken up here with that item."""
        return legs_from(self.route, seq, here, self.speed_mps)
