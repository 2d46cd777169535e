# SPDX-License-Identifier: GPL-3.0-or-later

"""The path that wings fly along a route: past its waypoints in turns, around its circles, in the wind.

`legs_of` (route_simulation.py) has the lines between the places of a route. Here each corner becomes a bend of
`wings.py`. Each NAV_LOITER_* becomes a path to the circle, once around it, and on to the point where it is left. Times
use the ground speed in each direction, at the most, so the aircraft has at least the time stated here. The turns are as
wide as the highest ground speed makes them, in any direction.

Where a leg is shorter than its turns need (`Tight`), the way is not known: `check.py` looks for room around it, and the
time of a turn all around is added.

While hovering there are no turns: a quadplane that rises, descends or was told by DO_VTOL_TRANSITION to hover turns on
the spot. The path to a hovering landing is assumed to be straight, without braking.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from mavproxy_handover.mission.geodesy import east_north_m, offset
from mavproxy_handover.mission.items import (
    LOITER_TIME,
    LOITER_TO_ALTITUDE,
    LOITER_TURNS,
    LOITERS,
    RETURN_TO_LAUNCH,
    VTOL_LAND,
    WAYPOINT,
    MissionItem,
)
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import Leg, hovers_at, legs_of
from mavproxy_handover.mission.wings import ROLL_IN_S, Air, Bend, bend

__all__ = ["Path", "Tight", "Turn", "path_of"]

#: less than that is no turn
_LEAST_TURN_DEG: Final = 2.0
#: a circle is a row of straight pieces
_PIECES: Final = 24
#: distance after the middle of a circle, in radii, at which ArduPlane is on its next line (SITL)
_CONVERGED: Final = 2.3
#: two places nearer than that (m) are one
_SAME_M: Final = 0.5

#: latitude, longitude, metres above home
_Spot = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn at a waypoint, or a circle.

    Fields: angle (degrees; a circle: 360), radius, largest distance outside the next leg, and beginning and end on the
    path (m).
    """

    seq: int
    angle_deg: float
    radius_m: float
    outside_m: float
    begins_m: float
    ends_m: float

    @property
    def circle(self) -> bool:
        """True for a circle."""
        return self.angle_deg >= 360.0


@dataclass(frozen=True, slots=True)
class Tight:
    """A leg to item `seq` that is shorter than the turns at its ends need."""

    seq: int
    length_m: float
    needed_m: float


@dataclass(frozen=True, slots=True)
class Path:
    """The flown path.

    Fields: legs in order, turns, legs that are too short for their turns, and items that the wind does not allow.
    """

    legs: tuple[Leg, ...]
    turns: tuple[Turn, ...]
    tight: tuple[Tight, ...]
    unflown: tuple[int, ...]

    def turn_at(self, along_m: float) -> Turn | None:
        """The turn that is flown there, counted along the path."""
        return next((turn for turn in self.turns if turn.begins_m <= along_m <= turn.ends_m), None)


def path_of(route: Route, air: Air) -> Path:
    """The path of a route of an aircraft with wings. `air`: the airspeed until an item changes it, and the wind."""
    return _Tracer(route, air).path()


class _Tracer:
    """Flies along the lines of a route."""

    def __init__(self, route: Route, air: Air) -> None:
        self._route = route
        self._air = air
        self._lines = legs_of(route, air.airspeed_mps)
        self._hovering = {line.seq for line in self._lines if hovers_at(route, line.seq)}
        self._here: _Spot = self._lines[0].start if self._lines else (0.0, 0.0, 0.0)
        self._along_m = self._time_s = 0.0
        self._legs: list[Leg] = []
        self._turns: list[Turn] = []
        self._tight: list[Tight] = []
        self._unflown: list[int] = []
        #: length of the line from here that the last turn has used
        self._used_m = 0.0

    def path(self) -> Path:
        """All of it."""
        for number, line in enumerate(self._lines):
            following = self._lines[number + 1] if number + 1 < len(self._lines) else None
            if line.length_m < _SAME_M:
                self._straight(line, line.end, line.hold_s, at_least_s=line.duration_s)
                continue
            flies = line.seq in self._hovering or self._air_of(line).flies(_bearing_deg(line.start, line.end))
            if not flies and line.seq not in self._unflown:
                self._unflown.append(line.seq)
            item = self._route.items[line.seq - 1]
            if self._circles(item):
                self._circle(line, item, following)
            elif self._corners(item, following):
                assert following is not None
                self._corner(line, item, following)
            else:
                self._to_the_end(line)
        for tight in self._tight:
            self._circle_more(tight.seq)
        return Path(tuple(self._legs), tuple(self._turns), tuple(self._tight), tuple(self._unflown))

    # --- what is flown at an item ---

    def _air_of(self, line: Leg) -> Air:
        return Air(line.speed_mps, self._air.wind, self._air.unknown_mps)

    def _circles(self, item: MissionItem) -> bool:
        if item.command in LOITERS:
            return item.seq not in self._hovering
        if item.command == VTOL_LAND:
            return item.param1 == 1.0
        return item.command == RETURN_TO_LAUNCH and not self._route.profile.vertical

    def _corners(self, item: MissionItem, following: Leg | None) -> bool:
        """Whether the aircraft is on its wings there, and goes on to another place."""
        if item.command == RETURN_TO_LAUNCH or following is None or following.length_m < _SAME_M:
            return False
        return self._hovering.isdisjoint((item.seq, following.seq))

    # --- pieces of the path ---

    def _to_the_end(self, line: Leg) -> None:
        """Fly a line to its end, without a turn."""
        if self._used_m > line.length_m:
            self._tight.append(Tight(line.seq, line.length_m, self._used_m))
        self._straight(line, line.end, line.hold_s)
        self._used_m = 0.0

    def _straight(self, line: Leg, end: _Spot, hold_s: float = 0.0, at_least_s: float = 0.0, seq: int = 0) -> None:
        """One piece of the path; `seq`: of the item flown to, where that is not the line's."""
        start = self._here
        made = Leg(seq or line.seq, start, end, at_least_s, hold_s, line.speed_mps)
        length = made.length_m
        if length > 0.0:
            hovers = line.seq in self._hovering
            made_mps = line.speed_mps if hovers else self._air_of(line).ground_mps(_bearing_deg(start, end))
            made = replace(made, duration_s=max(at_least_s, length / made_mps))
        if start != end or hold_s > 0.0:
            self._legs.append(made)
            self._time_s += made.duration_s
        self._along_m += length
        self._here = end

    def _corner(self, line: Leg, item: MissionItem, following: Leg) -> None:
        """The way to a waypoint and around it on to the next line."""
        corner = line.end
        came, goes = east_north_m(*line.start[:2], *corner[:2]), east_north_m(*corner[:2], *following.end[:2])
        turn_deg = _difference(_direction_deg(goes), _direction_deg(came))
        length = line.length_m
        if abs(turn_deg) < _LEAST_TURN_DEG:
            self._to_the_end(line)
            return
        speed_mps = self._air_of(line).fastest_mps
        wings = self._route.wings
        before = self._begins_before_m(item, speed_mps, turn_deg) - ROLL_IN_S * speed_mps
        radius = wings.turn_radius_m(speed_mps)
        needed = self._used_m + max(0.0, before)
        if needed > length:
            self._tight.append(Tight(line.seq, length, needed))
            before = max(0.0, length - self._used_m)
        made = bend(abs(turn_deg), before, radius)
        spots = list(_spots(made, corner, came, math.copysign(1.0, turn_deg)))
        self._straight(line, (*line.at(1.0 - before / length)[:2], corner[2]))
        begins = self._along_m
        for spot in spots:
            self._straight(line, spot, seq=following.seq)
        self._turns.append(Turn(line.seq, abs(turn_deg), made.radius_m, made.outside_m, begins, self._along_m))
        self._used_m = max(0.0, made.after_m)

    def _begins_before_m(self, item: MissionItem, speed_mps: float, turn_deg: float) -> float:
        if item.command == WAYPOINT:
            if item.param3 > 0.0:
                return -math.floor(item.param3)
            if item.param2 >= 1.0:
                return math.floor(item.param2)
            return self._route.wings.turn_distance_m(speed_mps, turn_deg)
        return 0.0  # a climb straight on, a take-off: what comes next is flown to from where it is

    def _circle(self, line: Leg, item: MissionItem, following: Leg | None) -> None:
        """The way to a circle, once around it, and on to where it is left."""
        air = self._air_of(line)
        radius, side = self._radius_and_side(item, air.fastest_mps)
        lat, lon, alt = line.end
        if self._used_m + radius > line.length_m:
            self._tight.append(Tight(line.seq, line.length_m, self._used_m + radius))
        from_here = east_north_m(lat, lon, *self._here[:2])
        east, north = from_here if math.hypot(*from_here) > _SAME_M else east_north_m(lat, lon, *line.start[:2])
        angle = math.atan2(north, east)
        last = angle - side * math.tau

        def spot(at: float) -> _Spot:
            return (*offset(lat, lon, radius * math.cos(at), radius * math.sin(at)), alt)

        self._straight(line, spot(angle))
        begins, started_s = self._along_m, self._time_s
        for number in range(1, _PIECES + 1):
            self._straight(line, spot(angle - side * math.tau * number / _PIECES))
        round_s = self._time_s - started_s
        left = None if following is None else _leaves(east_north_m(lat, lon, *following.end[:2]), radius, side)
        if left is not None:
            more = (last - left) * side % math.tau
            count = max(1, math.ceil(more / math.tau * _PIECES))
            for number in range(1, count + 1):
                self._straight(line, spot(last - side * more * number / count))
        self._hold(self._longer_s(item, round_s))
        self._turns.append(Turn(line.seq, 360.0, radius, 0.0, begins, self._along_m))
        self._used_m = 0.0
        if left is not None and following is not None and item.param4 <= 0.0:
            self._onto(line, following, _CONVERGED * radius)
        if item.command == VTOL_LAND:
            self._straight(line, line.end)

    def _onto(self, line: Leg, following: Leg, along_m: float) -> None:
        """From a circle onto the line from its middle, which is where it is flown unless parameter 4 says otherwise."""
        east, north = east_north_m(*following.start[:2], *following.end[:2])
        length = math.hypot(east, north)
        if length > 2.0 * along_m:
            part = along_m / length
            lat, lon = offset(*following.start[:2], part * east, part * north)
            self._straight(line, (lat, lon, line.end[2]), seq=following.seq)

    def _hold(self, seconds: float) -> None:
        """Add the time of circling after the first round."""
        if seconds > 0.0:
            self._legs[-1] = replace(self._legs[-1], hold_s=seconds)

    def _circle_more(self, seq: int) -> None:
        """Add the time of a turn all around to the way to an item, whose way is not known."""
        number = max((number for number, leg in enumerate(self._legs) if leg.seq == seq), default=None)
        if number is None:
            return
        leg = self._legs[number]
        radius = self._route.wings.turn_radius_m(self._air_of(leg).fastest_mps)
        self._legs[number] = replace(leg, hold_s=leg.hold_s + math.tau * radius / leg.speed_mps)

    def _longer_s(self, item: MissionItem, round_s: float) -> float:
        if item.command == LOITER_TURNS:
            return max(0.0, item.param1 - 1.0) * round_s
        if item.command == LOITER_TIME:
            return max(0.0, item.param1 - round_s)
        return 0.0

    def _radius_and_side(self, item: MissionItem, speed_mps: float) -> tuple[float, float]:
        """Of the circle of an item: its radius, and 1.0 to the right, -1.0 to the left."""
        told = {LOITER_TURNS: item.param3, LOITER_TO_ALTITUDE: item.param2}.get(item.command, 0.0)
        turning = item.param3 if item.command == LOITER_TIME else told
        return self._route.wings.circle_radius_m(told, speed_mps), -1.0 if turning < 0.0 else 1.0


def _spots(made: Bend, corner: _Spot, came: tuple[float, float], side: float) -> Iterator[_Spot]:
    """The places of a bend on earth. `side`: 1.0 for a turn to the right."""
    length = math.hypot(*came)
    east, north = came[0] / length, came[1] / length
    for along, beside in made.places:
        right = side * beside
        yield (*offset(*corner[:2], along * east + right * north, along * north - right * east), corner[2])


def _leaves(to: tuple[float, float], radius_m: float, side: float) -> float | None:
    """Where a circle is left for a place, as an angle counted from east; None: the place is inside it."""
    distance = math.hypot(*to)
    if distance <= radius_m:
        return None
    return math.atan2(to[1], to[0]) + side * math.acos(radius_m / distance)


def _direction_deg(way: tuple[float, float]) -> float:
    return math.degrees(math.atan2(*way))


def _bearing_deg(start: _Spot, end: _Spot) -> float:
    return _direction_deg(east_north_m(*start[:2], *end[:2]))


def _difference(deg: float, from_deg: float) -> float:
    return (deg - from_deg + 180.0) % 360.0 - 180.0
