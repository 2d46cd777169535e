# SPDX-License-Identifier: GPL-3.0-or-later

"""The path that wings fly along a route: past its waypoints in turns, around its circles, in the wind.

`legs_of` (route_simulation.py) has the lines between the places of a route. Here they are flown in small steps by the
guidance of ArduPlane (`l1_guidance.py`), with its rules for going on to the next item:

* A waypoint is done when it is nearer than the turn distance (`wings.py`), or when its plane across the line is passed.
* A line leads from the last item's place. After a take-off and a return it leads from the aircraft's place. The same
  holds if the aircraft is past the end of the line already.
* A circle is flown until its turns, its time or its height are done. It is left where the course leads to the next
  place, within 10 degrees, and 10 degrees more after each further round. The next line leads from its middle, or with
  parameter 4 from where it is left.
* NAV_CONTINUE_AND_CHANGE_ALT goes on along the last line, whose end is moved on by 300 m again and again.

With a known wind the aircraft is moved by it. If the wind is not known, a tail wind is assumed in every direction: then
there is least time, and the turns are widest. Airspeeds are those at sea level; at the height of the route the aircraft
is faster (`true_airspeed_factor`).

Where a leg is shorter than its turns need (`Tight`), small differences decide on the way: `check.py` looks for room
around it, and the time of a turn all around is added.

While hovering there are no turns: a quadplane that rises, descends or was told by DO_VTOL_TRANSITION to hover turns on
the spot. The path to a hovering landing is assumed to be straight, without braking.

Sources: ArduPlane's `set_next_WP`, `verify_nav_wp`, `update_loiter`, `verify_loiter_turns`, `isHeadingLinedUp`,
`verify_continue_and_change_alt`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

from mavproxy_handover.mission.flown_line import (
    SAME_M,
    Slope,
    bearing_of_deg,
    beside_m,
    beyond,
    difference_deg,
    direction_deg,
    part_behind,
)
from mavproxy_handover.mission.geodesy import distance_m, east_north_m
from mavproxy_handover.mission.items import (
    CHANGE_ALTITUDE,
    LOITER_TIME,
    LOITER_TO_ALTITUDE,
    LOITER_TURNS,
    LOITERS,
    RETURN_TO_LAUNCH,
    TAKEOFFS,
    VTOL_LAND,
    WAYPOINT,
    MissionItem,
)
from mavproxy_handover.mission.l1_guidance import STEP_S, Flyer, Point, along_line, around_circle
from mavproxy_handover.mission.open_takeoff import WING_CLIMB_MPS
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import Leg, hovers_at, legs_of
from mavproxy_handover.mission.wing_circle import CircleFlight, CircleGoal
from mavproxy_handover.mission.wing_trail import Trail
from mavproxy_handover.mission.wings import ROLL_IN_S, Air, true_airspeed_factor, turn_end_m

__all__ = ["Loose", "Path", "Tight", "Turn", "path_of"]

#: less than that is no turn
_LEAST_TURN_DEG: Final = 2.0
#: beyond that an aircraft may turn to either side
_ABOUT_DEG: Final = 170.0
#: a line is flown steadily below that distance (m) from it, demand (m/s^2) and bank (radians)
_STEADY_M, _STEADY_MPSS, _STEADY_BANK = 0.5, 0.05, 0.01
#: most steps on the way to an item, and steps that are left to fly before a line is done
_MOST_STEPS, _STEPS_LEFT = 3000, 2.5
#: a turn is over when the aircraft is so near the next line (m), with so little demand (m/s^2)
_TURNED_M, _TURNED_MPSS = 5.0, 1.0
#: NAV_CONTINUE_AND_CHANGE_ALT moves the end of the line by the second distance when it is nearer than the first (m)
_NEAR_END_M, _FURTHER_M = 200.0, 300.0
#: Q_TRANS_DECEL: how fast a quadplane slows down to hover
_SLOWS_MPSS: Final = 2.0
#: TECS_CLMB_MAX: how fast wings may climb or sink at the most
_FASTEST_CLIMB_MPS: Final = 5.0
#: a circle is flown to along a line while it is farther away than so many radii
_FAR_RADII: Final = 3.0
_MIDDLE: Final[Point] = (0.0, 0.0)


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
class Loose:
    """A part of the way to item `seq` that is not known: within `radius_m` of a leg. `why`: what is flown there."""

    seq: int
    leg: Leg
    radius_m: float
    why: str


@dataclass(frozen=True, slots=True)
class Path:
    """The flown path.

    Fields: legs in order, turns, and legs that are too short for their turns. Then items that the wind does not allow,
    and parts of the way that are not known.
    """

    legs: tuple[Leg, ...]
    turns: tuple[Turn, ...]
    tight: tuple[Tight, ...]
    unflown: tuple[int, ...]
    loose: tuple[Loose, ...] = ()

    def turn_at(self, along_m: float) -> Turn | None:
        """The turn that is flown there, counted along the path."""
        return next((turn for turn in self.turns if turn.begins_m <= along_m <= turn.ends_m), None)


@lru_cache(maxsize=8)
def path_of(route: Route, air: Air, *, sideslip: bool = True, about: float = 1.0) -> Path:
    """The path of a route of an aircraft with wings. `air`: the airspeed until an item changes it, and the wind.

    `sideslip`: its turns have the sideslip of [wings]. Else they have none and are as narrow as the bank allows, and it
    climbs as fast as ArduPlane allows. `about`: the side to which it turns about, 1.0 to the right, -1.0 to the left.
    A check asks for the same path several times: the last ones are kept.
    """
    if sideslip:
        return _Tracer(route, air, route.wings.turn_part, about, WING_CLIMB_MPS).path()
    return _Tracer(route, air, 1.0, about, _FASTEST_CLIMB_MPS).path()


class _Tracer:
    """Flies along the lines of a route."""

    def __init__(self, route: Route, air: Air, turn_part: float, about: float, climb_mps: float) -> None:
        self._route = route
        self._turn_part, self._about, self._climb_mps = turn_part, about, climb_mps
        self._air = air
        self._lines = legs_of(route, air.airspeed_mps)
        self._hovering = {line.seq for line in self._lines if hovers_at(route, line.seq)}
        self._trail = Trail(self._lines[0].start if self._lines else (0.0, 0.0, 0.0))
        #: the aircraft, while it is on its wings
        self._flyer: Flyer | None = None
        #: where the last line begins and ends; the next one begins at its end, or where the aircraft is if it is None
        self._last: tuple[tuple[float, float], tuple[float, float]] | None = None
        self._turns: list[Turn] = []
        self._tight: list[Tight] = []
        self._unflown: list[int] = []
        self._loose: list[Loose] = []
        #: length of the line from here that the last turn needs
        self._used_m = 0.0
        #: the turn that is flown: its item, its angle, where it began, and how far outside of the line it came
        self._turning: tuple[int, float, float] | None = None
        self._outside_m = 0.0

    def path(self) -> Path:
        """All of it."""
        for number, line in enumerate(self._lines):
            following = self._lines[number + 1] if number + 1 < len(self._lines) else None
            self._trail.seq, self._trail.speed_mps = line.seq, line.speed_mps
            self._fly(line, self._route.items[line.seq - 1], following)
        for tight in self._tight:
            self._circle_more(tight.seq)
        legs, turns = tuple(self._trail.legs), tuple(self._turns)
        return Path(legs, turns, tuple(self._tight), tuple(self._unflown), tuple(self._loose))

    def _fly(self, line: Leg, item: MissionItem, following: Leg | None) -> None:
        circles = self._circles(item) and (line.length_m >= SAME_M or item.command in LOITERS)
        if line.seq in self._hovering or (line.length_m < SAME_M and not circles):
            self._straight(line)
            return
        air = self._air_of(line)
        if not air.flies(bearing_of_deg(line.start, line.end)) and line.seq not in self._unflown:
            self._unflown.append(line.seq)
        if item.command in TAKEOFFS or line.seq in self._unflown:
            self._straight(line)
            return
        flyer = self._on_wings(line, item, air)
        self._note_tight(flyer, line, item, following)
        if circles:
            self._circle(flyer, line, item, following)
        elif item.command == CHANGE_ALTITUDE:
            self._go_on(flyer, line, item)
        else:
            self._past(flyer, line, item, following)

    # --- what is flown at an item ---

    def _air_of(self, line: Leg) -> Air:
        return Air(line.speed_mps * self._factor(line), self._air.wind, self._air.unknown_mps)

    def _factor(self, line: Leg) -> float:
        return true_airspeed_factor(self._route.home.alt_m + line.end[2])

    def _circles(self, item: MissionItem) -> bool:
        if item.command in LOITERS:
            return item.seq not in self._hovering
        if item.command == VTOL_LAND:
            return item.param1 == 1.0
        return item.command == RETURN_TO_LAUNCH and not self._route.profile.vertical

    def _lands_on_wings(self, line: Leg) -> bool:
        """True if a quadplane in hover flies to its landing on its wings, as ArduPlane has it."""
        return line.length_m >= SAME_M and self._route.items[line.seq - 1].command == VTOL_LAND

    # --- straight ---

    def _straight(self, line: Leg) -> None:
        """A line as it is: straight up or down, in hover, in a take-off, or what is left of it."""
        here = self._trail.here
        if line.seq in self._hovering and self._flyer is not None:
            speed_mps = self._flyer.ground_mps
            stops_m = speed_mps**2 / (2.0 * _SLOWS_MPSS) + ROLL_IN_S * speed_mps
            self._loose.append(Loose(line.seq, replace(line, end=here, start=here), stops_m, "slows down to hover"))
        length = distance_m(*here[:2], *line.end[:2])
        if line.seq in self._hovering and self._lands_on_wings(line):
            far_m = 2.0 * self._route.wings.turn_radius_m(self._air.fastest_mps)
            self._loose.append(Loose(line.seq, replace(line, start=here), far_m, "takes to its wings again to land"))
        made_mps = line.speed_mps
        if line.seq not in self._hovering:
            made_mps = self._air_of(line).ground_mps(bearing_of_deg(here, line.end))
        duration_s = length / made_mps if line.length_m >= SAME_M else line.duration_s
        self._trail.straight(line.end, duration_s, line.hold_s, hovers=line.hovers)
        self._flyer, self._last, self._used_m, self._turning = None, None, 0.0, None

    def _on_wings(self, line: Leg, item: MissionItem, air: Air) -> Flyer:
        """The aircraft on its wings, with metres counted from the end of the line."""
        if self._flyer is None:
            heading = math.radians(bearing_of_deg(self._trail.here, line.end))
            self._flyer = Flyer(*self._trail.metres(self._trail.here[:2]), heading, 1.0, 1.0)
        flyer = self._flyer
        flyer.speed_mps = air.fastest_mps if air.wind is None else air.airspeed_mps
        flyer.limit = math.radians(self._route.wings.bank_deg)
        flyer.turn_part, flyer.about = self._turn_part, self._about
        flyer.wind = air.blows
        self._trail.count_from(line.end[:2] if item.has_place else self._trail.here[:2], flyer)
        return flyer

    def _start(self, flyer: Flyer) -> tuple[Point, bool]:
        """Where the line to the point (0, 0) begins, and whether it is kept to."""
        here = (flyer.east, flyer.north)
        if self._last is None:
            return here, False
        start = self._trail.metres(self._last[1])
        return (here if part_behind(start, _MIDDLE, here) >= 1.0 else start), True

    def _past(self, flyer: Flyer, line: Leg, item: MissionItem, following: Leg | None) -> None:
        """Along a line to its end, until the next item begins."""
        start, keeps = self._start(flyer)
        angle = self._next_angle_deg(line, following, start)
        end = beyond(start, _MIDDLE, math.floor(item.param3)) if item.command == WAYPOINT else _MIDDLE
        near_m = self._near_m(item, flyer, angle, self._factor(line))
        slope = Slope(self._trail.here[2], line.end[2], math.dist((flyer.east, flyer.north), end))
        steps = 0
        while steps < _MOST_STEPS:
            here = (flyer.east, flyer.north)
            distance = math.dist(here, end)
            if distance <= near_m or part_behind(start, end, here) >= 1.0:
                break
            demand = along_line(flyer, start if keeps else end, end)
            beside = beside_m(start, end, here) if keeps else 0.0
            self._watch_turn(flyer, beside, demand)
            if _is_steady(flyer, beside, demand):
                self._skip(flyer, end, distance - near_m, slope)
            flyer.step(demand)
            self._trail.follow(flyer, slope.at(math.dist((flyer.east, flyer.north), end)))
            steps += 1
        self._end_turn(flyer)
        self._trail.note(flyer, slope.at(math.dist((flyer.east, flyer.north), end)))
        if item.command != WAYPOINT or following is None or following.length_m < SAME_M or steps == _MOST_STEPS:
            self._straight(line)
            return
        self._last = (self._trail.place(start), line.end[:2])
        if abs(angle) >= _LEAST_TURN_DEG:
            side = self._about if abs(angle) > _ABOUT_DEG else math.copysign(1.0, angle)
            self._turning, self._outside_m = (line.seq, side * abs(angle), self._trail.along_m), 0.0

    def _skip(self, flyer: Flyer, end: Point, distance_m: float, slope: Slope) -> None:
        """Fly straight on at once, up to some steps before the end."""
        east, north = flyer.velocity
        speed = math.hypot(east, north)
        seconds = distance_m / speed - _STEPS_LEFT * STEP_S
        if seconds < _STEPS_LEFT * STEP_S or (end[0] - flyer.east) * east + (end[1] - flyer.north) * north <= 0.0:
            return
        self._trail.note(flyer, slope.at(math.dist((flyer.east, flyer.north), end)))
        flyer.east += east * seconds
        flyer.north += north * seconds
        flyer.time_s += seconds
        self._trail.note(flyer, slope.at(math.dist((flyer.east, flyer.north), end)))

    def _near_m(self, item: MissionItem, flyer: Flyer, angle_deg: float, factor: float = 1.0) -> float:
        """Distance from its end at which a line is done."""
        if item.command != WAYPOINT:
            return flyer.ground_mps * STEP_S
        if item.param2 >= 1.0:
            return math.floor(item.param2)
        if item.param3 >= 1.0:
            return 0.0
        return self._route.wings.turn_distance_m(flyer.ground_mps, angle_deg, factor)

    def _next_angle_deg(self, line: Leg, following: Leg | None, start: Point) -> float:
        """How much the next line turns away, as ArduPlane has it: an item without a place is at 0, 0."""
        if following is None:
            return 90.0
        item = self._route.items[following.seq - 1]
        goes = east_north_m(*line.end[:2], item.lat_deg, item.lon_deg)
        return difference_deg(direction_deg(goes), direction_deg((-start[0], -start[1])))

    # --- turns ---

    def _watch_turn(self, flyer: Flyer, beside: float, demand: float) -> None:
        """Note how far the aircraft is outside of the line that it turns to (right of it above 0)."""
        if self._turning is None:
            return
        self._outside_m = max(self._outside_m, -math.copysign(1.0, self._turning[1]) * beside)
        if abs(beside) < _TURNED_M and abs(demand) < _TURNED_MPSS:
            self._end_turn(flyer)

    def _end_turn(self, flyer: Flyer) -> None:
        if self._turning is None:
            return
        seq, angle, begins_m = self._turning
        radius = self._route.wings.turn_radius_m(flyer.ground_mps)
        ends_m = self._trail.along_m + self._trail.since_m(flyer)
        self._turns.append(Turn(seq, abs(angle), radius, self._outside_m, begins_m, ends_m))
        self._turning = None

    def _note_tight(self, flyer: Flyer, line: Leg, item: MissionItem, following: Leg | None) -> None:
        """Note a leg that is shorter than its turns need. What the turn at its end needs counts for the next one."""
        speed_mps = self._air_of(line).fastest_mps
        needed, used = self._used_m, 0.0
        if self._circles(item):
            needed += self._radius_and_side(item, line)[0]
        elif following is not None and item.command == WAYPOINT:
            came, goes = (east_north_m(*each.start[:2], *each.end[:2]) for each in (line, following))
            turn_deg = abs(difference_deg(direction_deg(goes), direction_deg(came)))
            if turn_deg >= _LEAST_TURN_DEG:
                before = self._near_m(item, flyer, turn_deg) - ROLL_IN_S * speed_mps
                needed += max(0.0, before)
                used = max(0.0, turn_end_m(turn_deg, before, self._route.wings.turn_radius_m(speed_mps)))
        if needed > line.length_m >= SAME_M:
            self._tight.append(Tight(line.seq, line.length_m, needed))
        self._used_m = used

    def _circle_more(self, seq: int) -> None:
        """Add the time of a turn all around to the way to an item, whose way is not known."""
        legs = self._trail.legs
        number = max((number for number, leg in enumerate(legs) if leg.seq == seq), default=None)
        if number is None:
            return
        leg = legs[number]
        radius = self._route.wings.turn_radius_m(self._air_of(leg).fastest_mps)
        legs[number] = replace(leg, hold_s=leg.hold_s + math.tau * radius / leg.speed_mps)

    # --- on to another height ---

    def _go_on(self, flyer: Flyer, line: Leg, item: MissionItem) -> None:
        """Straight on along the last line while the height changes."""
        last = self._last or (line.start[:2], line.end[:2])
        start, end = self._trail.metres(last[0]), self._trail.metres(last[1])
        alt_m, began_s = self._trail.here[2], flyer.time_s
        rise = line.end[2] - alt_m
        takes_s = abs(rise) / self._climb_mps
        while flyer.time_s - began_s < takes_s:
            if math.dist((flyer.east, flyer.north), end) < _NEAR_END_M:
                end = beyond(start, end, _FURTHER_M)
            flyer.step(along_line(flyer, start, end))
            self._trail.follow(flyer, alt_m + rise * min(1.0, (flyer.time_s - began_s) / takes_s))
        soonest = replace(line, start=line.at(WING_CLIMB_MPS / _FASTEST_CLIMB_MPS), end=line.end)
        reach_m = self._route.wings.reach_m(self._air_of(line).fastest_mps)
        self._loose.append(Loose(line.seq, soonest, reach_m, "turns as soon as it has the height"))
        self._trail.note(flyer, line.end[2])
        self._last = (last[0], self._trail.place(end))

    # --- circles ---

    def _circle(self, flyer: Flyer, line: Leg, item: MissionItem, following: Leg | None) -> None:
        """To a circle around the point (0, 0), around it, and on to where it is left."""
        trail, (radius, side) = self._trail, self._radius_and_side(item, line)
        start, keeps = self._start(flyer)
        if item.command == RETURN_TO_LAUNCH:
            keeps = False
        rise_s = abs(line.end[2] - trail.here[2]) / self._climb_mps
        began_s = flyer.time_s
        self._to_circle(flyer, start if keeps else None, (radius, side), line.end[2])
        self._end_turn(flyer)
        trail.note(flyer, line.end[2])
        begins_m = trail.along_m
        goal = CircleGoal.of(item, rise_s - (flyer.time_s - began_s))
        to = None if following is None else self._trail.metres(self._route_place(following))
        CircleFlight(flyer, trail, radius, side, line.end[2]).fly(goal, to)
        self._turns.append(Turn(line.seq, 360.0, radius, 0.0, begins_m, trail.along_m))
        if item.command == VTOL_LAND:
            far_m = radius + 2.0 * self._route.wings.turn_radius_m(flyer.ground_mps)
            spot = replace(line, start=line.end)
            self._loose.append(Loose(line.seq, spot, far_m, "circles down and comes in against the wind"))
        if item.command == VTOL_LAND or following is None or following.length_m < SAME_M:
            self._straight(replace(line, hold_s=0.0))
            return
        leaves = trail.here[:2]
        middle = line.end[:2] if item.has_place else leaves
        self._last = None if item.command == RETURN_TO_LAUNCH else (leaves, leaves if item.param4 > 0.0 else middle)

    def _to_circle(self, flyer: Flyer, start: Point | None, circle: tuple[float, float], alt_m: float) -> None:
        """To a circle (radius and side) around the point (0, 0), until the aircraft is on it."""
        radius, side = circle
        slope = Slope(self._trail.here[2], alt_m, math.hypot(flyer.east, flyer.north) - radius)
        for _ in range(_MOST_STEPS):
            here = (flyer.east, flyer.north)
            distance = math.hypot(*here)
            if start is not None and distance > _FAR_RADII * radius:
                demand = along_line(flyer, start, _MIDDLE)
                beside = beside_m(start, _MIDDLE, here)
                self._watch_turn(flyer, beside, demand)
                if _is_steady(flyer, beside, demand):
                    self._skip(flyer, _MIDDLE, distance - _FAR_RADII * radius, slope)
            else:
                demand, on_it = around_circle(flyer, _MIDDLE, radius, side)
                if on_it:
                    return
            flyer.step(demand)
            self._trail.follow(flyer, slope.at(math.hypot(flyer.east, flyer.north) - radius))

    def _route_place(self, following: Leg) -> tuple[float, float]:
        """Where the next item is."""
        item = self._route.items[following.seq - 1]
        return (item.lat_deg, item.lon_deg) if item.has_place else following.end[:2]

    def _radius_and_side(self, item: MissionItem, line: Leg) -> tuple[float, float]:
        """Of the circle of an item: its radius, and 1.0 to the right, -1.0 to the left."""
        told = {LOITER_TURNS: item.param3, LOITER_TO_ALTITUDE: item.param2}.get(item.command, 0.0)
        turning = item.param3 if item.command == LOITER_TIME else told
        wings = self._route.wings
        radius = (abs(told) or wings.circle_m) * self._factor(line) ** 2
        return radius, -1.0 if turning < 0.0 else 1.0


def _is_steady(flyer: Flyer, beside: float, demand: float) -> bool:
    return abs(beside) < _STEADY_M and abs(demand) < _STEADY_MPSS and abs(flyer.bank) < _STEADY_BANK
