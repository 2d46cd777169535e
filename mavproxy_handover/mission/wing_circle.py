# SPDX-License-Identifier: GPL-3.0-or-later

"""How wings fly the circle of an item: how long, and where they leave it.

Rules
-----
* Rounds and times count from when the aircraft is on the circle (`around_circle`).
* After that, ArduPlane leaves the circle where its tangent leads to the next place, within 10 degrees. After each
  further round it is content with 10 degrees more. A place inside the circle is left for on the way towards it.
* The second round has the shape of all later ones. So it stands for them (`Leg.times`).

Sources: ArduPlane's `verify_loiter_turns`, `verify_loiter_time`, `verify_loiter_to_alt`, `isHeadingLinedUp`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.mission.items import LOITER_TIME, LOITER_TO_ALTITUDE, LOITER_TURNS, MissionItem
from mavproxy_handover.mission.l1_guidance import Flyer, Point, around_circle
from mavproxy_handover.mission.wing_trail import Trail

__all__ = ["CircleFlight", "CircleGoal"]

_ROUND_DEG: Final = 360.0
_LINED_UP_DEG: Final = 10.0
#: after so many rounds any direction is good enough
_MOST_ROUNDS: Final = 18
_LEAST_ROUND_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class CircleGoal:
    """How far (degrees) and how long (s) a circle is flown at the least."""

    degrees: float = _ROUND_DEG
    seconds: float = 0.0

    @classmethod
    def of(cls, item: MissionItem, climbs_s: float) -> CircleGoal:
        """Goal of an item. `climbs_s`: what its change of height takes after the circle is reached."""
        if item.command == LOITER_TURNS:
            return cls(_ROUND_DEG * item.param1)
        if item.command == LOITER_TIME:
            return cls(0.0, max(0.0, item.param1))
        if item.command == LOITER_TO_ALTITUDE:
            return cls(0.0, max(0.0, climbs_s))
        return cls()


class CircleFlight:
    """An aircraft on a circle around the point (0, 0)."""

    def __init__(self, flyer: Flyer, trail: Trail, radius_m: float, side: float, alt_m: float) -> None:
        """`side`: 1.0 to the right, -1.0 to the left."""
        self._flyer, self._trail = flyer, trail
        self._radius_m, self._side, self._alt_m = radius_m, side, alt_m
        self._sum_deg = 0.0

    def fly(self, goal: CircleGoal, to: Point | None) -> None:
        """Fly around until the goal is reached, and on to where it is left for a place; None: for none."""
        began_s = self._flyer.time_s
        settled = False
        while self._sum_deg <= goal.degrees or self._flyer.time_s - began_s < goal.seconds:
            self._step()
            if not settled and self._sum_deg >= _ROUND_DEG:
                settled = True
                self._rounds(goal, began_s)
        self._sum_deg = 0.0
        while to is not None and not self._lined_up(to):
            self._step()
        self._trail.note(self._flyer, self._alt_m)

    def _step(self) -> None:
        flyer = self._flyer
        before = math.atan2(flyer.east, flyer.north)
        flyer.step(around_circle(flyer, (0.0, 0.0), self._radius_m, self._side)[0])
        turned = math.remainder(math.atan2(flyer.east, flyer.north) - before, math.tau)
        self._sum_deg += self._side * math.degrees(turned)
        self._trail.follow(flyer, self._alt_m)

    def _rounds(self, goal: CircleGoal, began_s: float) -> None:
        """Fly one round for all that are left, if these are two or more."""
        flyer, trail = self._flyer, self._trail
        takes_s = max(_LEAST_ROUND_S, flyer.time_s - began_s) * _ROUND_DEG / self._sum_deg
        left = (goal.degrees - self._sum_deg) / _ROUND_DEG, (goal.seconds - flyer.time_s + began_s) / takes_s
        times = math.floor(max(left))
        if times < 2:
            return
        trail.note(flyer, self._alt_m)
        first, end_deg, at_s = len(trail.legs), self._sum_deg + _ROUND_DEG, flyer.time_s
        while self._sum_deg < end_deg and flyer.time_s - at_s < 2.0 * takes_s:
            self._step()
        trail.note(flyer, self._alt_m)
        flyer.time_s += (times - 1) * (flyer.time_s - at_s)
        self._sum_deg += (times - 1) * _ROUND_DEG
        trail.repeat(first, times, flyer)

    def _lined_up(self, to: Point) -> bool:
        """Whether the tangent leads to that place."""
        flyer, radius = self._flyer, self._radius_m
        away, distance = math.hypot(flyer.east, flyer.north), math.hypot(*to)
        rounds = math.floor(abs(self._sum_deg) / _ROUND_DEG)
        if distance == 0.0 or away == 0.0 or rounds >= _MOST_ROUNDS:
            return True
        here = (flyer.east * radius / away, flyer.north * radius / away)
        if distance >= radius:
            wanted = math.atan2(to[0] - here[0], to[1] - here[1])
        else:
            before = 2.0 * math.asin((radius - distance) / (2.0 * radius))
            wanted = math.atan2(*to) + (math.pi / 2.0 - before) * self._side
        tangent = math.atan2(*here) + self._side * math.pi / 2.0
        off_deg = abs(math.degrees(math.remainder(wanted - tangent, math.tau)))
        return off_deg <= _LINED_UP_DEG * (1 + rounds)
