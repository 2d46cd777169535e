# SPDX-License-Identifier: GPL-3.0-or-later

"""The energy budget of a mission: energy of each leg, and of the return from each place of the route.

A return may begin at every waypoint. It flies as RTL does, to the best return site inside the plan's geofence, which is
the one with the largest margin. Return sites are home, the rally points and the place where the route lands. The speed
is the mission's cruise speed, whatever the route has set, because the autopilot uses its own (`vehicle/cruise.py`).
An aircraft that hovers comes down straight. A plane without rotors goes on from the return site to the landing sequence
that begins nearest to it, and along that to the ground (RTL_AUTOLAND 1). Without a sequence it would circle, which is
not counted, and such a mission does not start.

The whole route counts: if it does not end on the ground, the return from its end to home is included. After the item
that drops the payload (`released_at`) everything is flown without it.

Sources: ModeRTL::init and AC_WPNav (`wp_and_spline_init`); ArduPlane's ModeRTL::navigate, AP_Mission
(`get_landing_sequence_start`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from math import inf, isfinite, radians
from typing import Final

from mavproxy_handover.core.safety.energy import (
    LANDING_BELOW_M,
    LANDING_MPS,
    SINK_MPS,
    EnergyModel,
    MadeGood,
    Piece,
    point_of_no_return,
    way_home,
)
from mavproxy_handover.mission.conditions import waiting
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.geodesy import bearing_deg, distance_m
from mavproxy_handover.mission.items import GRIPPER, LANDINGS, PAYLOAD_PLACE, RETURN_TO_LAUNCH
from mavproxy_handover.mission.pace import corner_mps
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import (
    Leg,
    cruise_of,
    landing_sequences,
    legs_of,
    sequence_legs,
    sequence_place,
)

__all__ = [
    "LANDING",
    "Budget",
    "ItemBudget",
    "Place",
    "PreparedWay",
    "Return",
    "budget_of",
    "pieces_along",
    "pieces_of",
    "places_inside",
    "places_of",
    "released_at",
    "way_back",
    "with_ways_down",
]

#: step (m) at which the margin along the route is checked, and most number of places
_STEP_M, _MOST_STEPS = 25.0, 4000
#: times nearer than this (s) to each other are one
_SAME_S = 0.01
#: places nearer than this to each other are one
_SAME_PLACE_M = 5.0


#: a corner that is slowed down for costs that power of the part of the speed that is lost. By acceleration alone it
#: would be 2; flights on ArduCopter, whose jerk is limited too, took a little more
_GENTLE: Final = 1.5
#: name of the return site where a route lands
LANDING = "landing"
#: DO_GRIPPER's second parameter: let go
_LET_GO = 0.0


@dataclass(frozen=True, slots=True)
class Place:
    """A return site; `alt_m` above home is the least height of the return to it.

    `down`: the landing sequence from there to the ground, which begins `down_from_m` above home: a least height as
    well. None: straight down.
    """

    name: str
    lat_deg: float
    lon_deg: float
    alt_m: float
    down: tuple[Piece, ...] | None = None
    down_from_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Return:
    """The best return from a place on the route: return site, need (Wh) without reserve, and margin (Wh)."""

    place: str
    need_wh: float
    margin_wh: float


@dataclass(frozen=True, slots=True)
class ItemBudget:
    """The path to an item of the route.

    Fields: length (m), the kind of its longest piece (None: straight up or down), need (Wh), energy left at its end
    (Wh), and the best return from there (None: it has landed, or there is none).
    """

    seq: int
    length_m: float
    made: MadeGood | None
    need_wh: float
    left_wh: float
    back: Return | None


@dataclass(frozen=True, slots=True)
class Budget:
    """Energy of a route (Wh).

    `no_return_m`: distance along it from which no return site is in reach with the reserve; None: one always is.
    """

    model: EnergyModel
    items: tuple[ItemBudget, ...]
    need_wh: float
    no_return_m: float | None

    @property
    def budget_wh(self) -> float:
        """The need times its factor, plus the reserve."""
        return self.model.budget_wh(self.need_wh)


def places_of(route: Route, cruise_speed_mps: float | None = None) -> tuple[Place, ...]:
    """Return sites: home, the rally points, and the place where the route lands if that is another one."""
    home = Place("home", route.home.lat_deg, route.home.lon_deg, 0.0)
    places = [home]
    places += [Place(f"rally {n}", p.lat_deg, p.lon_deg, p.alt_m) for n, p in enumerate(route.rally, 1)]
    end = _landing(route)
    if end is not None and all(distance_m(*end, p.lat_deg, p.lon_deg) > _SAME_PLACE_M for p in places):
        places.append(Place(LANDING, *end, 0.0))
    return with_ways_down(places, route, cruise_speed_mps)


def places_inside(route: Route, cruise_speed_mps: float | None = None) -> tuple[Place, ...]:
    """Return sites inside the plan's geofence: no return goes to another one."""
    fence = Fence(route.fence)
    return tuple(place for place in places_of(route, cruise_speed_mps) if fence.holds((place.lat_deg, place.lon_deg)))


def with_ways_down(places: Iterable[Place], route: Route, cruise_speed_mps: float | None = None) -> tuple[Place, ...]:
    """The same places, with the way down from each by the landing sequences of this route. Takes milliseconds."""
    sequences = landing_sequences(route) if route.profile.lands_by_sequence else ()
    if not sequences:
        return tuple(replace(place, down=None, down_from_m=0.0) for place in places)
    speed_mps = cruise_of(route, cruise_speed_mps)
    begins = [sequence_place(sequence) for sequence in sequences]
    legs: dict[int, tuple[Leg, ...]] = {}
    found = []
    for place in places:
        spot = (place.lat_deg, place.lon_deg)
        away_m, number = min((distance_m(*spot, *begin), number) for number, begin in enumerate(begins))
        if number not in legs:
            legs[number] = sequence_legs(route, sequences[number], speed_mps)
        there = Piece(
            length_m=away_m,
            bearing_deg=bearing_deg(*spot, *begins[number]) if away_m > 0.0 else 0.0,
            speed_mps=speed_mps,
        )
        down = (there, *(_on_wings(leg) for leg in legs[number]))
        found.append(replace(place, down=down, down_from_m=legs[number][0].start[2] if legs[number] else 0.0))
    return tuple(found)


def _on_wings(leg: Leg) -> Piece:
    """The piece of an aircraft without rotors: it circles instead of going straight up or down."""
    piece = _piece(leg)
    return piece if leg.length_m > 0.0 else Piece(hold_s=leg.hold_s + leg.size_m / SINK_MPS)


def _landing(route: Route) -> tuple[float, float] | None:
    legs = legs_of(route)
    if not legs or not _lands(route, legs[-1]):
        return None
    return legs[-1].end[0], legs[-1].end[1]


def _lands(route: Route, last: Leg) -> bool:
    """True if the path ends there on the ground."""
    return last.end[2] <= 0.0 and route.items[last.seq - 1].command in (*LANDINGS, RETURN_TO_LAUNCH)


def released_at(route: Route) -> int | None:
    """Number of the first item that drops the payload: a gripper that opens, or NAV_PAYLOAD_PLACE; None: none does.

    A gripper that waits for a condition may never open (`conditions.py`).
    """
    waits = waiting(route.items)
    drops = (
        item.seq
        for item in route.items
        if item.command == PAYLOAD_PLACE
        or (item.command == GRIPPER and item.param2 == _LET_GO and item.seq not in waits)
    )
    return next(drops, None)


class PreparedWay:
    """The path of a route, prepared for repeated counting."""

    def __init__(self, route: Route, cruise_speed_mps: float | None) -> None:
        legs = legs_of(route, cruise_speed_mps)
        released = released_at(route)
        self._drops = released is not None
        self._climbs_on_way = route.profile.energy.holds_airspeed
        self._pieces = _pieces(legs, released)
        self._end = legs[-1].end if legs and not _lands(route, legs[-1]) else None
        self._home = places_of(route, cruise_speed_mps)[0]
        self._return_mps = cruise_of(route, cruise_speed_mps)

    def pieces(self, return_alt_m: float) -> tuple[Piece, ...]:
        """All pieces, with the return to home at that height if the route does not end on the ground."""
        if self._end is None:
            return self._pieces
        back = way_back(self._end, self._home, return_alt_m, self._return_mps, climbs_on_way=self._climbs_on_way)
        return (*self._pieces, *_loaded_as(back, unloaded=self._drops))


def pieces_of(route: Route, cruise_speed_mps: float | None, return_alt_m: float) -> tuple[Piece, ...]:
    """The whole path of a route, with the return to home if it does not end on the ground."""
    return PreparedWay(route, cruise_speed_mps).pieces(return_alt_m)


def pieces_along(
    legs: Sequence[Leg],
    places: Iterable[Place],
    model: EnergyModel,
    return_mps: float | None,
    released: int | None = None,
) -> tuple[Piece, ...]:
    """A path that begins in the air, with the cheapest return if it does not end on the ground.

    `return_mps`: see `way_back`, `released`: see `released_at`.
    """
    pieces = _pieces(legs, released)
    if not legs or legs[-1].end[2] <= 0.0:
        return pieces
    backs = (
        way_back(legs[-1].end, place, model.return_alt_m, return_mps, climbs_on_way=model.holds_airspeed)
        for place in places
    )
    ways = (_loaded_as(back, unloaded=pieces[-1].unloaded) for back in backs)
    return (*pieces, *min(ways, key=model.need_wh, default=()))


def _pieces(legs: Sequence[Leg], released: int | None) -> tuple[Piece, ...]:
    """Pieces of legs whose payload is dropped by that item."""
    return tuple(
        _piece(leg)._replace(unloaded=released is not None and leg.seq > released, stops=stops)
        for leg, stops in zip(legs, _stops(legs), strict=True)
    )


def _stops(legs: Sequence[Leg]) -> list[float]:
    """For each leg, the part of a start from rest and a stop that its two ends cost.

    A copter flies on through a curve, and over the ground that it follows, whatever pieces stand for that. A landing
    goes on down where it becomes slower. A corner costs more the sharper it is (`corner_mps`).
    """
    through = [_slows_to_mps(before, after) for before, after in pairwise(legs)]
    parts = [
        0.5 * (_part_of_stop(begins, leg.speed_mps) + _part_of_stop(ends, leg.speed_mps))
        for leg, begins, ends in zip(legs, [0.0, *through], [*through, 0.0], strict=False)
    ]
    return parts


def _part_of_stop(slows_to_mps: float, speed_mps: float) -> float:
    """What a change from a speed to a lower one and back costs, as a part of a stop. Flown: see `_GENTLE`."""
    lost = max(0.0, 1.0 - slows_to_mps / speed_mps)
    return float(lost**_GENTLE)


def _slows_to_mps(before: Leg, after: Leg) -> float:
    """The speed between two legs: 0 for a stop, infinite on a landing that becomes slower."""
    if before.hold_s > 0.0 or before.rests:
        return 0.0
    if before.length_m == after.length_m == 0.0:
        goes_on = before.seq == after.seq and before.start[2] > before.end[2] > after.end[2]
        return inf if goes_on else 0.0
    slower_mps = min(before.speed_mps, after.speed_mps)
    if (before.curved and after.curved) or (before.seq == after.seq and before.follows and after.follows):
        return slower_mps
    if before.length_m == 0.0 or after.length_m == 0.0:
        return 0.0
    return min(slower_mps, corner_mps(_turn_rad(before, after)))


def _turn_rad(before: Leg, after: Leg) -> float:
    """The angle between the directions of two level legs."""
    came, goes = bearing_deg(*before.start[:2], *before.end[:2]), bearing_deg(*after.start[:2], *after.end[:2])
    return radians(abs((goes - came + 180.0) % 360.0 - 180.0))


def _loaded_as(way: Iterable[Piece], *, unloaded: bool) -> tuple[Piece, ...]:
    return tuple(piece._replace(unloaded=unloaded) for piece in way)


def _piece(leg: Leg) -> Piece:
    length = leg.length_m
    rise = leg.end[2] - leg.start[2]
    # the last metres straight down are a landing, like every descent that is as slow
    landing = max(0.0, min(leg.start[2], LANDING_BELOW_M) - max(leg.end[2], 0.0)) if length == 0.0 else 0.0
    if length == 0.0 and rise < 0.0 and leg.duration_s > -rise / LANDING_MPS - _SAME_S:
        landing = -rise
    return Piece(
        length_m=leg.times * length,
        bearing_deg=bearing_deg(*leg.start[:2], *leg.end[:2]) if length > 0.0 else 0.0,
        climb_m=leg.times * max(0.0, rise),
        descent_m=leg.times * max(0.0, -rise),
        landing_m=min(landing, max(0.0, -rise)),
        hold_s=leg.hold_s,
        speed_mps=leg.speed_mps,
        hovers=leg.hovers,
    )


def way_back(
    here: tuple[float, float, float],
    place: Place,
    return_alt_m: float,
    return_mps: float | None,
    *,
    climbs_on_way: bool = False,
    beyond_m: float = 0.0,
) -> tuple[Piece, ...]:
    """The path of a return, as RTL flies it, from here (degrees, degrees, metres above home) to a return site.

    `return_mps`: how fast RTL flies, of wings the airspeed; None: at the cruise speed of the model.
    `climbs_on_way`: see `way_home`. `beyond_m`: so much farther than that it may be.
    """
    there = (place.lat_deg, place.lon_deg)
    distance = distance_m(*here[:2], *there)
    bearing = bearing_deg(*here[:2], *there) if distance > 0.0 else 0.0
    return way_home(
        distance + beyond_m,
        bearing,
        here[2],
        max(place.alt_m, place.down_from_m),
        return_alt_m,
        speed_mps=return_mps,
        climbs_on_way=climbs_on_way or place.down is not None,
        down=place.down,
    )


class _Route:
    """A route with a model: needs along it, and returns from it."""

    def __init__(self, route: Route, cruise_speed_mps: float | None, model: EnergyModel) -> None:
        self.legs = legs_of(route, cruise_speed_mps)
        self.model = model
        self.places = places_inside(route, cruise_speed_mps)
        self.return_mps = cruise_of(route, cruise_speed_mps)
        pieces = _pieces(self.legs, released_at(route))
        self.needs = [model.piece_wh(piece) for piece in pieces]
        #: the aircraft of each leg, with its payload or without
        self.models = [model.unloaded if piece.unloaded else model for piece in pieces]
        #: energy used and distance flown, up and down included, before each leg and after the last
        self.used_wh = list(accumulate(self.needs, initial=0.0))
        self.gone_m = list(accumulate((leg.times * leg.size_m for leg in self.legs), initial=0.0))

    def best(self, here: tuple[float, float, float], left_wh: float, model: EnergyModel) -> Return | None:
        """The best return from here, as heavy as `model` is; None: there is none."""
        found = []
        for place in self.places:
            need = model.need_wh(
                way_back(here, place, model.return_alt_m, self.return_mps, climbs_on_way=model.holds_airspeed)
            )
            found.append(Return(place.name, need, left_wh - model.budget_wh(need)))
        return max(found, key=lambda way: way.margin_wh, default=None)

    def margin_wh(self, gone_m: float) -> float:
        """Margin of the best return from there; -infinite: there is none."""
        number = min(bisect_right(self.gone_m, gone_m), len(self.legs)) - 1
        leg, size = self.legs[number], self.legs[number].times * self.legs[number].size_m
        part = min(1.0, (gone_m - self.gone_m[number]) / size) if size > 0.0 else 1.0
        left = self.model.battery_wh - self.used_wh[number] - part * self.needs[number]
        back = self.best(leg.at(part), left, self.models[number])
        return -inf if back is None else back.margin_wh

    def no_return_m(self) -> float | None:
        """Distance along the route (horizontal m) from which no return is possible."""
        step = max(_STEP_M, self.gone_m[-1] / _MOST_STEPS)
        looked_at = {*self.gone_m, *(n * step for n in range(int(self.gone_m[-1] / step) + 1))}
        gone = point_of_no_return(self.margin_wh, sorted(looked_at))
        if gone is None:
            return None
        along = 0.0
        for leg, begins in zip(self.legs, self.gone_m, strict=False):
            if leg.size_m > 0.0:
                along += leg.times * leg.length_m * min(1.0, max(0.0, gone - begins) / (leg.times * leg.size_m))
        return along

    def items(self) -> Iterator[ItemBudget]:
        """The budget of each item that is flown to, in their order."""
        number = 0
        while number < len(self.legs):
            seq, first = self.legs[number].seq, number
            while number < len(self.legs) and self.legs[number].seq == seq:
                number += 1
            legs = self.legs[first:number]
            piece = _piece(max(legs, key=lambda leg: leg.size_m))
            level = piece.length_m > 0.0
            left, end, model = self.model.battery_wh - self.used_wh[number], legs[-1].end, self.models[number - 1]
            yield ItemBudget(
                seq,
                sum(leg.times * leg.length_m for leg in legs),
                model.made_good(piece.bearing_deg, piece.speed_mps) if level else None,
                sum(self.needs[first:number]),
                left,
                self.best(end, left, model) if end[2] > 0.0 else None,
            )


def budget_of(route: Route, cruise_speed_mps: float | None, model: EnergyModel) -> Budget:
    """The whole budget of a route, with the wind of the model. Takes milliseconds: not for the main loop."""
    whole = _Route(route, cruise_speed_mps, model)
    need = model.need_wh(pieces_of(route, cruise_speed_mps, model.return_alt_m))
    no_return = whole.no_return_m() if isfinite(whole.used_wh[-1]) else None
    return Budget(model, tuple(whole.items()), need, no_return)
