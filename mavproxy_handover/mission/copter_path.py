# SPDX-License-Identifier: GPL-3.0-or-later

"""The path that a copter flies along the items of a route, as straight legs.

Rules
-----
* NAV_LOITER_TURNS is flown around its place: straight to the nearest point of the circle, then so many turns, to the
  right or, with a radius below 0, to the left. The turns are up to 8 % smaller than told. The aircraft leaves the
  circle up to 20 m before its end, and the next way begins there (`curves.ring`).
* NAV_SPLINE_WAYPOINT: the curve leaves in the direction of the leg before it. It arrives in the direction of the next
  one, if the aircraft does not stop there. The aircraft stops before a spline, unless a NAV_WAYPOINT without a time to
  wait or another spline precedes it. It stops after a spline that has a time to wait or is the last item. Between two
  splines the direction is that from the beginning of the first to the end of the second.
* NAV_DELAY waits parameter 1 in seconds, or else until a second of the minute, which takes 60 s at the most. Other
  times of day are refused (`plan.py`).
* A height of 0 is no height to ArduCopter: the one before is kept. So it is on the way to NAV_LAND and
  NAV_PAYLOAD_PLACE, from where it climbs back to that.
* NAV_PAYLOAD_PLACE sinks at the speed of a landing to the ground, or by parameter 1 in metres if that is less.
* NAV_LOITER_TO_ALT is over when the aircraft is within 5 cm of its height, and closes in on that slowly.
* Heights above terrain: on a straight leg the height above the ground changes evenly, and the aircraft follows the
  ground. This needs the heights of a terrain file. Without one they count as heights above home, and the check says so.
  Where the frame changes, a spline begins or ends with a stop.
* `MOST_PIECES` legs stand for all curves of a route and for all ways over the ground. If that is too few, each gets
  fewer, and `pieces_lacking` says by how much.

Sources: ArduCopter's mode_auto.cpp (`do_circle`, `do_spline_wp`, `set_next_wp`, `loc_from_cmd`, `do_nav_delay`,
`loiter_to_alt_run`),
AC_WPNav (`set_spline_destination`), AP_RTC (`get_time_utc`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.core.safety.energy import CLIMB_MPS, LANDING_MPS, LOITER_S
from mavproxy_handover.mission.curves import Spline, Vector, circle_pieces, ring
from mavproxy_handover.mission.geodesy import distance_m, east_north_m, offset
from mavproxy_handover.mission.items import (
    DELAY,
    FRAME_ABOVE_SEA,
    FRAME_ABOVE_TERRAIN,
    LAND,
    LOITER_TIME,
    LOITER_TO_ALTITUDE,
    LOITER_TURNS,
    LOITER_UNLIMITED,
    PAYLOAD_PLACE,
    RETURN_TO_LAUNCH,
    SPLINE_WAYPOINT,
    TAKEOFFS,
    WAYPOINT,
    MissionItem,
    stored_radius_m,
    stored_turns,
)
from mavproxy_handover.mission.leg import Leg, Place, above_home_m, down, duration_s, return_place, rise_m
from mavproxy_handover.mission.plan import Route

__all__ = ["MOST_PIECES", "copter_legs", "pieces_lacking"]

#: legs for curves, and over terrain, of one route
MOST_PIECES: Final = 1000
#: within this distance (m) of the middle ArduCopter does not fly to the circle first
_IN_THE_MIDDLE_M: Final = 3.0
#: a way over the ground is cut into pieces of half a cell, or of that (m), whichever is longer
_GROUND_STEP_M: Final = 25.0
#: a height below that (m) is stored as none
_NO_HEIGHT_M: Final = 0.01
#: where a height of 0 keeps the one before
_KEEP_HEIGHT: Final = frozenset((WAYPOINT, LOITER_UNLIMITED, LOITER_TURNS, LOITER_TIME, SPLINE_WAYPOINT))
_HOLDING: Final = frozenset((WAYPOINT, LOITER_TIME, SPLINE_WAYPOINT))
#: time (s) above the place of a landing until it begins: flown
_LANDS_AFTER_S: Final = 2.0
#: time (s) that these items rest at their place. NAV_LOITER_TO_ALT: for the last metre, from 1 m to 5 cm, where its
#: speed falls with the distance (PSC_POSZ_P 1)
_RESTS_S: Final = {
    LAND: _LANDS_AFTER_S,
    RETURN_TO_LAUNCH: LOITER_S + _LANDS_AFTER_S,
    LOITER_TO_ALTITUDE: 3.0,
}
#: time (s) that the aircraft rests at the edge of a circle before the turns: flown
_EDGE_S: Final = 2.0
#: most time (s) until a given second of the minute
_MINUTE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of the path: the wanted number of legs, and the function that makes a given number."""

    wanted: int
    make: Callable[[int], Iterator[Leg]]


def copter_legs(route: Route, flown: Sequence[tuple[MissionItem, float]], here: Place) -> tuple[Leg, ...]:
    """The legs of a copter that flies from `here` to these items, each at its speed (m/s)."""
    parts = _Flight(route, here).parts(flown)
    scale = 1.0 / _lacking(parts)
    return tuple(leg for part in parts for leg in part.make(max(1, math.floor(part.wanted * scale))))


def pieces_lacking(route: Route, flown: Sequence[tuple[MissionItem, float]], here: Place) -> float:
    """Factor by which a route's curves have too few legs: 1 if there are enough.

    The distance of the legs from the curves grows with the square of that.
    """
    return _lacking(_Flight(route, here).parts(flown))


def _lacking(parts: Sequence[_Part]) -> float:
    return max(1.0, sum(part.wanted for part in parts if part.wanted > 1) / MOST_PIECES)


class _Flight:
    """Flies from item to item."""

    def __init__(self, route: Route, here: Place) -> None:
        self._route = route
        self._here = here
        #: True if the last leg was above terrain
        self._above_terrain = False
        #: velocity at which a spline begins here; None: the aircraft stops
        self._leaves: Vector | None = None

    def parts(self, flown: Sequence[tuple[MissionItem, float]]) -> list[_Part]:
        """The parts of the path, in the order of flight."""
        found: list[_Part] = []
        for number, (item, speed_mps) in enumerate(flown):
            following = flown[number + 1][0] if number + 1 < len(flown) else None
            found += self._part(item, speed_mps, following)
            if item.command == RETURN_TO_LAUNCH:
                break
        return found

    def _part(self, item: MissionItem, speed_mps: float, following: MissionItem | None) -> Iterator[_Part]:
        lat, lon, alt = self._here
        leaves, self._leaves = self._leaves, None
        if item.command == DELAY:
            yield from self._straight(item, self._here, speed_mps, hold_s=_delay_s(item))
        elif item.command == RETURN_TO_LAUNCH:
            yield from self._straight(
                item, (*return_place(self._route, lat, lon), alt), speed_mps, hold_s=_RESTS_S[item.command]
            )
            yield from self._landing(item)
        elif item.command in TAKEOFFS:  # straight up, even if the item has a place
            yield from self._straight(item, (lat, lon, above_home_m(self._route, item, (lat, lon))), speed_mps)
            self._above_terrain = False
        elif item.command == LOITER_TURNS:
            yield from self._circle(item, speed_mps)
        elif item.command == SPLINE_WAYPOINT:
            yield from self._spline(item, speed_mps, leaves, following)
        else:
            yield from self._to_place(item, speed_mps)

    def _to_place(self, item: MissionItem, speed_mps: float) -> Iterator[_Part]:
        start, place = self._here, self._place(item)
        up = self._up(item, item.command in (LAND, PAYLOAD_PLACE))
        end = (*place, self._height(item, up, place))
        hold_s = max(0.0, item.param1) if item.command in _HOLDING else 0.0
        if start[:2] != place or item.command != LAND:
            hold_s = _RESTS_S.get(item.command, hold_s)
        yield from self._straight(item, end, speed_mps, hold_s=hold_s)
        if item.command == LAND:
            yield from self._landing(item)
        elif item.command == PAYLOAD_PLACE:
            yield from self._placing(item, end)
        elif item.command == WAYPOINT and int(item.param1) == 0:
            self._leaves = self._way(start, end)

    def _landing(self, item: MissionItem) -> Iterator[_Part]:
        for leg in down(item.seq, self._here):
            yield _one(leg)
        self._here = (*self._here[:2], min(self._here[2], 0.0))
        self._above_terrain = False

    def _placing(self, item: MissionItem, top: Place) -> Iterator[_Part]:
        """Down at the speed of a landing, as far as the item allows, and up again."""
        deep_m = min(top[2], item.param1) if item.param1 > 0.0 else top[2]
        if deep_m > 0.0:
            low = (*top[:2], top[2] - deep_m)
            yield _one(Leg(item.seq, top, low, deep_m / LANDING_MPS))
            yield _one(Leg(item.seq, low, top, deep_m / CLIMB_MPS))

    # ---- where an item is -----------------------------------------------------------------------------------------

    def _place(self, item: MissionItem) -> tuple[float, float]:
        return (item.lat_deg, item.lon_deg) if item.has_place else self._here[:2]

    def _up(self, item: MissionItem, keeps: bool = False) -> float:
        """Height of an item in its own frame: above the ground or above home."""
        if keeps or (item.command in _KEEP_HEIGHT and abs(item.alt_m) < _NO_HEIGHT_M):
            return self._here[2] - (rise_m(self._route, *self._here[:2]) if _of_terrain(item) else 0.0)
        return item.alt_m - self._route.home.alt_m if item.frame == FRAME_ABOVE_SEA else item.alt_m

    def _height(self, item: MissionItem, up_m: float, place: tuple[float, float]) -> float:
        """Height above home of a height in the frame of an item."""
        return up_m + rise_m(self._route, *place) if _of_terrain(item) else up_m

    def _way(self, start: Place, end: Place) -> Vector:
        """Vector from one to the other, with heights above the ground if the path has that frame."""
        ground = (rise_m(self._route, *end[:2]) - rise_m(self._route, *start[:2])) if self._above_terrain else 0.0
        return (*east_north_m(*start[:2], *end[:2]), end[2] - start[2] - ground)

    # ---- ways -----------------------------------------------------------------------------------------------------

    def _straight(self, item: MissionItem, end: Place, speed_mps: float, *, hold_s: float = 0.0) -> Iterator[_Part]:
        start, self._here, self._above_terrain = self._here, end, _of_terrain(item)
        if start == end and hold_s <= 0.0:
            return
        ground = self._route.ground
        if not self._above_terrain or ground is None or start[:2] == end[:2]:
            yield _one(Leg(item.seq, start, end, duration_s(start, end, speed_mps), hold_s, speed_mps))
            return
        length, step_m = distance_m(*start[:2], *end[:2]), max(_GROUND_STEP_M, ground.cell_m / 2.0)
        ups = start[2] - rise_m(self._route, *start[:2]), end[2] - rise_m(self._route, *end[:2])

        def make(pieces: int) -> Iterator[Leg]:
            whole, before = Leg(item.seq, start, end, 0.0), start
            for number in range(1, pieces + 1):
                part = number / pieces
                lat, lon, _alt = whole.at(part)
                here = (lat, lon, ups[0] + part * (ups[1] - ups[0]) + rise_m(self._route, lat, lon))
                here = end if number == pieces else here
                waits_s = hold_s if number == pieces else 0.0
                time_s = duration_s(before, here, speed_mps)
                yield Leg(item.seq, before, here, time_s, waits_s, speed_mps, follows=True)
                before = here

        yield _Part(max(1, math.ceil(length / step_m)), make)

    def _circle(self, item: MissionItem, speed_mps: float) -> Iterator[_Part]:
        middle, radius_m, turns = (
            self._place(item),
            max(1.0, abs(stored_radius_m(item.param3))),
            stored_turns(item.param1),
        )
        up, side = self._up(item), -1.0 if item.param3 < 0.0 else 1.0
        east, north = east_north_m(*middle, *self._here[:2])
        bearing = math.atan2(east, north)
        climbs = abs(self._height(item, up, middle) - self._here[2])
        straight_there = math.hypot(east, north, climbs) > _IN_THE_MIDDLE_M

        made = ring(radius_m, speed_mps)

        def spot(turned: float, away_m: float) -> Place:
            angle = bearing + side * math.tau * turned
            place = offset(*middle, away_m * math.sin(angle), away_m * math.cos(angle))
            return (*place, self._height(item, up, place))

        told = spot(0.0, radius_m)
        if straight_there or turns > 0.0:
            yield from self._straight(item, told, speed_mps, hold_s=_EDGE_S if turns > 0.0 else 0.0)
        turns = max(0.0, turns - made.left / math.tau)
        whole, part = math.floor(turns), turns - math.floor(turns)
        follows = self._above_terrain and self._route.ground is not None

        def piece(before: Place, here: Place, times: int = 1, *, rests: bool = False) -> Leg:
            time_s = duration_s(before, here, made.speed_mps)
            return Leg(item.seq, before, here, time_s, 0.0, made.speed_mps, times, follows, curved=True, rests=rests)

        def arc(share: float, count: int, times: int = 1, *, first: bool = False) -> Iterator[Leg]:
            before = begins = told if first else spot(0.0, made.radius_m)
            for turn in (*(number / count for number in range(1, count) if number / count < share), share):
                away_m = made.after(math.tau * turn) if first and turn < 1.0 else made.radius_m
                here = begins if turn == 1.0 and not first else spot(turn % 1.0, away_m)
                yield piece(before, here, times)
                before = here

        pieces = circle_pieces(made.radius_m)
        if turns > 0.0:
            yield _Part(pieces, lambda count: arc(min(1.0, turns), count, first=True))
        if whole > 1:
            yield _Part(pieces, lambda count: arc(1.0, count, whole - 1))
        if whole and part > 0.0:
            yield _Part(pieces, lambda count: arc(part, count))
        if turns > 0.0:
            last = spot(part, made.radius_m if whole else made.after(math.tau * part))
            self._here = spot(part, made.ends_m)
            yield _one(piece(last, self._here, rests=True))
        self._above_terrain = False

    def _spline(
        self, item: MissionItem, speed_mps: float, leaves: Vector | None, following: MissionItem | None
    ) -> Iterator[_Part]:
        start, place, up = self._here, self._place(item), self._up(item)
        same_frame, self._above_terrain = self._above_terrain is _of_terrain(item), _of_terrain(item)
        end = (*place, self._height(item, up, place))
        hold_s = max(0.0, item.param1)
        if start == end:
            yield from self._straight(item, end, speed_mps, hold_s=hold_s)
            return
        velocity = leaves if leaves is not None and same_frame else _STANDS
        arrives = self._arrives(item, start, end, following)
        self._here, self._leaves = end, arrives if any(arrives) else None
        spline = Spline(self._way(start, end), velocity, arrives)
        follows = self._above_terrain and self._route.ground is not None
        up_from = start[2] - (rise_m(self._route, *start[:2]) if self._above_terrain else 0.0)

        def make(pieces: int) -> Iterator[Leg]:
            before = start
            for number, ((east, north, rise), made_mps) in enumerate(spline.points(pieces, speed_mps), 1):
                spot = offset(*start[:2], east, north)
                here = end if number == pieces else (*spot, self._height(item, up_from + rise, spot))
                waits_s = hold_s if number == pieces else 0.0
                time_s = duration_s(before, here, made_mps)
                yield Leg(item.seq, before, here, time_s, waits_s, made_mps, 1, follows, curved=True)
                before = here

        yield _Part(spline.pieces, make)

    def _arrives(self, item: MissionItem, start: Place, end: Place, following: MissionItem | None) -> Vector:
        """Velocity at the end of a spline, before it is shortened; 0 if the aircraft stops."""
        if following is None or item.param1 != 0.0 or following.command == RETURN_TO_LAUNCH:
            return _STANDS
        if _of_terrain(following) is not _of_terrain(item):
            return _STANDS
        place = (following.lat_deg, following.lon_deg) if following.has_place else end[:2]
        if abs(following.alt_m) < _NO_HEIGHT_M:
            up = end[2] - (rise_m(self._route, *end[:2]) if _of_terrain(item) else 0.0)
        else:
            above_sea = following.frame == FRAME_ABOVE_SEA
            up = following.alt_m - (self._route.home.alt_m if above_sea else 0.0)
        there = (*place, self._height(following, up, place))
        return self._way(start if following.command == SPLINE_WAYPOINT else end, there)


_STANDS: Final[Vector] = (0.0, 0.0, 0.0)


def _of_terrain(item: MissionItem) -> bool:
    return item.frame == FRAME_ABOVE_TERRAIN


def _one(leg: Leg) -> _Part:
    return _Part(1, lambda _pieces: iter((leg,)))


def _delay_s(item: MissionItem) -> float:
    """Longest time that a NAV_DELAY waits."""
    if item.param1 > 0.0:
        return item.param1
    return _MINUTE_S if int(item.param4) != -1 else 0.0
