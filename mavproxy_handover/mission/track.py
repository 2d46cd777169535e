# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds the leg that the aircraft flies, and its place relative to it: facts for `core/safety/route.py`.

The route has the planned legs, the autopilot the flown ones. ArduCopter flies a leg from the last waypoint if that was
reached. After a change of mode, or if an operator chose another item, the leg starts where the aircraft came to rest.
So:

* the item after the last one, if the aircraft came near that: the leg of the route;
* after a take-off, or a landing in between: a leg from the place of the aircraft, which may differ from the plan's;
* anything else (AUTO taken up in flight, an item that was skipped or chosen, a circle left): nothing is expected for
  `_JOIN_S`, until it has turned there; then the leg starts at its place.

On a spline or a circle of a copter the aircraft has to be near the curve (`copter_path.py`), in any direction, if the
curve begins where the route has it begin. Otherwise nothing is expected there. Nothing is expected in take-off, in a
delay, in a return, and at the end of a leg that ends in a landing either. In a turn the previous leg counts as well as
the next one, so a cut corner is no deviation. There, and below `_SLOW_MPS`, the course does not count, because a pause
or a hover has none. A hovering aircraft still has to be on the leg.

Wings turn before and after each waypoint and are on neither leg meanwhile. So nothing is expected of them within
`Wings.reach_m` of either end of a leg, on a circle, or after one until they have turned. Elsewhere they have to be on
their leg; an aircraft that flies away soon leaves that range. After a take-off wings leave in the direction of their
nose. Until they have come to their first leg, for `_SETTLES_S` at the most, nothing is expected of them.

Distances are those of the ellipsoid. ArduCopter's straight lines and ours differ at their middle: 1 m for a leg of 10
km, 30 m for one of 50 km, across both north and east at 52 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from mavproxy_handover.core.safety.route import TrackFact
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.items import (
    CHANGE_ALTITUDE,
    COMMANDS,
    LAND,
    LOITER_TIME,
    LOITER_TO_ALTITUDE,
    LOITER_TURNS,
    LOITER_UNLIMITED,
    LOITERS,
    PAYLOAD_PLACE,
    TAKEOFFS,
    VTOL_LAND,
    WAYPOINT,
    MissionItem,
)
from mavproxy_handover.mission.leg import Leg, first_pass
from mavproxy_handover.mission.pieces import Line, PieceRow
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import legs_of

__all__ = ["Motion", "RouteTracker"]

#: commands that are flown to in a straight line; those that land at its end
_LANDS: Final = frozenset((LAND, VTOL_LAND, PAYLOAD_PLACE))
_STRAIGHT: Final = frozenset((WAYPOINT, LOITER_TIME, LOITER_UNLIMITED, LOITER_TO_ALTITUDE)) | _LANDS
#: after these the aircraft is not at the item's place
_LEFT_ELSEWHERE: Final = frozenset((LOITER_TURNS,))
#: what ArduCopter needs to stop and to turn at 15 m/s, seconds
_JOIN_S: Final = 5.0
#: and what wings need to turn back, in a wide turn
_WING_JOIN_S: Final = 15.0
#: a QuadPlane in SITL took 70 s after its transition to come back to its line, which it had left by 39 m
_SETTLES_S: Final = 90.0
#: distance (m) within which an aircraft has come to a leg
_ON_IT_M: Final = 15.0
#: a turn begins and ends that near a waypoint: metres, or seconds of flight if that is more
_TURN_M, _TURN_S = 15.0, 3.0
#: below this speed (m/s) the course over ground is that of gusts
_SLOW_MPS: Final = 2.5


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of the aircraft.

    Fields: place (degrees), course over ground (degrees), ground speed (m/s), and the item of the mission that it flies
    to. `on_mission`: in the air, in AUTO.
    """

    lat_deg: float
    lon_deg: float
    course_deg: float
    speed_mps: float
    waypoint: int
    on_mission: bool

    @property
    def place(self) -> tuple[float, float]:
        """Latitude and longitude."""
        return self.lat_deg, self.lon_deg


class RouteTracker:
    """Follows one flight along one route. Times are monotonic seconds."""

    def __init__(self, route: Route) -> None:
        """`route`: with at most MAX_ITEMS items, so this takes a few milliseconds."""
        flown = [item for item in route.items if COMMANDS[item.command].flown]
        legs = legs_of(route)
        ends = {leg.seq: leg.end[:2] for leg in legs}
        place = (route.home.lat_deg, route.home.lon_deg)
        #: where each flown item ends
        self._places: dict[int, tuple[float, float]] = {}
        for item in flown:
            place = self._places[item.seq] = ends.get(item.seq, place)
        flies_past = route.profile.flies_past
        self._wings = route.wings if flies_past else None
        self._left_elsewhere = LOITERS | {CHANGE_ALTITUDE} if flies_past else _LEFT_ELSEWHERE
        self._straight = _STRAIGHT | LOITERS if flies_past else _STRAIGHT
        #: of the circles of wings: they are left from and flown to that far from their middle
        self._circles = {item.seq: _circle_m(item) for item in flown if flies_past and item.command in LOITERS}
        #: circles and splines of copters: what is flown of them, with the way there
        self._curves = _curves(legs)
        #: the one that is flown now, as the route has it
        self._curve: PieceRow | None = None
        self._commands = {item.seq: item.command for item in flown}
        self._follower = {item.seq: after.seq for item, after in pairwise(flown)}
        self._seq: int | None = None
        #: where the aircraft was seen last, how fast it was, and when that was
        self._place, self._speed_mps, self._seen_at = place, 0.0, -math.inf
        self._line: Line | None = None
        #: the previous leg
        self._behind: Line | None = None
        #: when the leg begins that has no beginning yet
        self._joins_at = -math.inf
        self._landing = False
        #: until then wings may still be on their way to their first leg
        self._settles_until = -math.inf

    def follow(self, motion: Motion, now: float) -> TrackFact | None:
        """Take the current motion; returns the place on the leg, None if nothing is expected."""
        if not motion.on_mission or not all(map(math.isfinite, (*motion.place, motion.course_deg, motion.speed_mps))):
            if not motion.on_mission:
                self._seq = None
            return None
        if motion.waypoint != self._seq:
            self._next(motion, now)
        self._place, self._speed_mps, self._seen_at = motion.place, motion.speed_mps, now
        if self._curve is not None:
            spot = self._curve.find(motion.place)
            return TrackFact(motion.waypoint, spot.across_m, None, spot.along_m, self._curve.length_m)
        if self._landing or self._commands.get(motion.waypoint) not in self._straight:
            return None
        if self._line is None:
            if now < self._joins_at:
                return None
            self._line = Line(motion.place, self._places[motion.waypoint])
        fact = self._fact(self._line, motion)
        if fact is None or now >= self._settles_until:
            return fact
        if abs(fact.cross_track_m) > _ON_IT_M:
            return None
        self._settles_until = -math.inf
        return fact

    def _next(self, motion: Motion, now: float) -> None:
        """Another item is flown to."""
        before, self._seq = self._seq, motion.waypoint
        start = None if before is None else self._start(before, motion, now)
        self._behind, self._line = self._line, None
        self._curve = self._curve_from(start, motion.waypoint)
        self._landing = False
        if start is None:
            self._behind, self._joins_at = None, now + (_JOIN_S if self._wings is None else _WING_JOIN_S)
        elif motion.waypoint in self._places:
            self._line = Line(start, self._places[motion.waypoint])

    def _curve_from(self, start: tuple[float, float] | None, waypoint: int) -> PieceRow | None:
        """The curve to an item, if it begins where the route has it begin."""
        legs = self._curves.get(waypoint)
        if legs is None or start is None or distance_m(*start, *legs[0].start[:2]) > _ON_IT_M:
            return None
        return PieceRow([Line(leg.start[:2], leg.end[:2]) for leg in legs])

    def _start(self, before: int, motion: Motion, now: float) -> tuple[float, float] | None:
        """Beginning of the leg after the item `before`; None if that is not where the route has it begin."""
        if self._follower.get(before) != motion.waypoint:
            return None
        command = self._commands[before]
        if command in TAKEOFFS and self._wings is not None:
            self._settles_until = now + _SETTLES_S
        if command in TAKEOFFS or self._landing:
            return self._place
        if command in self._left_elsewhere:
            return None
        if self._line is not None:
            along, _across, length = self._line.measure(self._place)
            speed_mps = max(motion.speed_mps, self._speed_mps)  # a gust may have stopped it since
            if length - along > self._turn_m(speed_mps) + speed_mps * (now - self._seen_at):
                return None  # it was told to go on before it was there
        return self._places[before]

    def _fact(self, line: Line, motion: Motion) -> TrackFact | None:
        along, across, length = line.measure(motion.place)
        turn = self._turn_m(motion.speed_mps)
        if self._commands[motion.waypoint] in _LANDS and length - along < turn:
            self._landing = True
            return None
        if self._wings is not None and self._turns(line, motion, turn):
            return None
        if self._behind is not None and along < turn:
            behind = self._behind.measure(motion.place)[1]
            across = behind if abs(behind) < abs(across) else across
        in_turn = along < turn or length - along < turn
        course = None if in_turn or motion.speed_mps < _SLOW_MPS else _difference(motion.course_deg, line.bearing_deg)
        return TrackFact(motion.waypoint, across, course, along, length)

    def _turn_m(self, speed_mps: float) -> float:
        copter_m = max(_TURN_M, _TURN_S * speed_mps)
        return copter_m if self._wings is None else max(copter_m, self._wings.reach_m(speed_mps))

    def _turns(self, line: Line, motion: Motion, turn_m: float) -> bool:
        """True if wings are near an end of the line, or near the circle that it leads to."""
        circle = self._circles.get(motion.waypoint)
        wings = self._wings
        circle_m = 0.0 if circle is None or wings is None else wings.circle_radius_m(circle, motion.speed_mps)
        return (
            distance_m(*line.start, *motion.place) < turn_m or distance_m(*line.end, *motion.place) < turn_m + circle_m
        )


def _curves(legs: Sequence[Leg]) -> dict[int, tuple[Leg, ...]]:
    """The legs to each item that a copter flies to in a curve."""
    ways = first_pass(legs)
    curved = {leg.seq for leg in legs if leg.curved}
    return {seq: tuple(leg for leg in ways[seq] if leg.length_m > 0.0) for seq in curved}


def _circle_m(item: MissionItem) -> float:
    """The radius that an item names, 0 where it names none."""
    return abs({LOITER_TURNS: item.param3, LOITER_TO_ALTITUDE: item.param2}.get(item.command, 0.0))


def _difference(course_deg: float, bearing_deg: float) -> float:
    return (course_deg - bearing_deg + 180.0) % 360.0 - 180.0
