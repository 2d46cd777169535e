# SPDX-License-Identifier: GPL-3.0-or-later

"""Simulates the flight of a route and predicts which station will command at each place.

The walk follows the path that ArduCopter flies (`copter_path.py`; a return leads to the place that is expected to be
chosen, `returns.py`, or to the nearest one where that is not known) in small steps, notes at each which zones hold it,
and moves authority by the rule of the core:

* while inside the commander's zone, entering another station's zone moves authority to that station;
* authority also moves when the commander's zone ends and another zone holds the aircraft;
* of several stations that could take over, the one that keeps the aircraft longest does;
* where waypoints belong to stations (`waypoint_ownership.py`), a zone is entered when its station awaits the aircraft
  no more.

Times come from the cruise speed and ArduCopter's default vertical speeds, without the time that speeding up, slowing
down and corners cost: the aircraft has at least the time told here. Wind is left out.

Of an aircraft with wings these are the lines between its waypoints, at its airspeed: energy and route are judged by
them. The path that it flies, with turns and circles and in the wind, is that of `path.py`, and is walked here as well.
A quadplane rises and comes down like a copter, and flies at a copter's speed after a DO_VTOL_TRANSITION to hover. A
plane climbs towards the place of its take-off and lands on a straight path. From a return site it flies the nearest
landing sequence (DO_LAND_START to NAV_LAND).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from mavproxy_handover.mission.conditions import new_speed, speeds_of, waiting
from mavproxy_handover.mission.copter_path import copter_legs, pieces_lacking
from mavproxy_handover.mission.geodesy import distance_m, east_north_m, offset
from mavproxy_handover.mission.items import (
    CHANGE_ALTITUDE,
    COMMANDS,
    LANDINGS,
    LOITER_TIME,
    LOITER_TURNS,
    RETURN_TO_LAUNCH,
    TAKEOFF,
    TAKEOFFS,
    VTOL_TRANSITION,
    MissionItem,
)
from mavproxy_handover.mission.jumps import as_flown
from mavproxy_handover.mission.leg import (
    Leg,
    above_home_m,
    down,
    duration_s,
    return_place,
    round_by_round,
)
from mavproxy_handover.mission.open_takeoff import climb_end, climb_m, is_open
from mavproxy_handover.mission.plan import Route, first_in_air, ways_from_land_starts
from mavproxy_handover.mission.waypoint_ownership import Belonging
from mavproxy_handover.mission.wings import HOVER_MPS
from mavproxy_handover.mission.zones import ZoneFinder

__all__ = [
    "Gap",
    "Handover",
    "Leg",
    "Sample",
    "RouteSimulation",
    "by_commander",
    "commanders_along",
    "cruise_of",
    "curves_lacking",
    "hovers_at",
    "landing_sequences",
    "legs_from",
    "legs_of",
    "sequence_legs",
    "sequence_place",
    "speed_at",
    "simulate_legs",
]

STEP_M = 5.0
#: a longer route gets longer steps: a walk ends in bounded time, whatever plan came over a link
MOST_STEPS = 20000
#: a border between two steps is found to this part of a metre
BORDER_M = 0.05

#: MAV_VTOL_STATE: hovering
_HOVERING = 3.0


@dataclass(frozen=True, slots=True)
class Sample:
    """A place on the path.

    Fields: distance and time from take-off, position (altitude above home), the item flown to, the stations whose zones
    hold it, and the station that commands from here on.
    """

    distance_along_m: float
    time_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    seq: int
    holding: frozenset[int]
    commander: int
    #: those of `holding` that await it at no waypoint, or have not since their zone was entered
    open: frozenset[int]
    #: it is on a circle or a spline of a copter
    curved: bool = False
    #: the aircraft stops here
    rests: bool = False


@dataclass(frozen=True, slots=True)
class Handover:
    """A predicted change of commander; stations by system id.

    The place is its start: the entry of the handover region, or the end of the commander's zone if the other zone was
    entered before. If the other station awaits the aircraft at a waypoint, it is that waypoint. `overlap_length_m` and
    `overlap_s` are what the route offers inside both zones, from that waypoint on if there is one; 0 when they do not
    overlap there.
    """

    from_station: int
    to_station: int
    lat_deg: float
    lon_deg: float
    distance_along_m: float
    time_s: float
    seq: int
    overlap_length_m: float
    overlap_s: float


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch of the route outside every zone, with the place where it starts."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    distance_along_m: float
    seq: int
    length_m: float
    duration_s: float


@dataclass(frozen=True, slots=True)
class RouteSimulation:
    """Result of the simulation of a route."""

    samples: tuple[Sample, ...]
    handovers: tuple[Handover, ...]
    gaps: tuple[Gap, ...]

    @property
    def commanders(self) -> tuple[int, ...]:
        """System ids of the commanders in the order in which the route needs them."""
        return (self.samples[0].commander, *(handover.to_station for handover in self.handovers))

    @property
    def length_m(self) -> float:
        """Horizontal length of the whole path."""
        return self.samples[-1].distance_along_m

    @property
    def duration_s(self) -> float:
        """Flight time, at the least."""
        return self.samples[-1].time_s


def by_commander(samples: tuple[Sample, ...]) -> Iterator[tuple[int, list[Sample]]]:
    """The samples cut where the commander changes; each stretch ends where the next begins."""
    stretch = [samples[0]]
    for sample in samples[1:]:
        if sample.commander != stretch[0].commander:
            yield stretch[0].commander, [*stretch, sample]
            stretch = []
        stretch.append(sample)
    yield stretch[0].commander, stretch


# --- from route to path ---


def legs_of(route: Route, cruise_speed_mps: float | None = None) -> tuple[Leg, ...]:
    """The path of a route as straight legs, from home to the ground. The given speed takes precedence over
    the plan's.
    """
    return tuple(_legs(route, cruise_of(route, cruise_speed_mps)))


def curves_lacking(route: Route, cruise_speed_mps: float | None = None) -> float:
    """How many times too few legs stand for the curves of a copter's route: 1 where there are enough."""
    if route.profile.flies_past:
        return 1.0
    cruise_mps = cruise_of(route, cruise_speed_mps)
    here = (route.home.lat_deg, route.home.lon_deg, 0.0)
    return pieces_lacking(route, _copter_items(route, as_flown(route.items), cruise_mps, cruise_mps), here)


def cruise_of(route: Route, cruise_speed_mps: float | None = None) -> float:
    """The speed (m/s) of a return, and of a route that sets none.

    It is the given one, or else the plan's, or else the default of the aircraft's profile.
    """
    return cruise_speed_mps or route.cruise_speed_mps or route.profile.energy.cruise_mps


def legs_from(
    route: Route, seq: int, here: tuple[float, float, float], cruise_speed_mps: float | None = None
) -> tuple[Leg, ...]:
    """The path of a route that continues in the air, at `here`, with item `seq`; earlier items are not flown.

    `here`: latitude, longitude, metres above home. A take-off is a climb at the aircraft's place.
    """
    return tuple(_legs(route, cruise_of(route, cruise_speed_mps), seq, here))


def speed_at(route: Route, seq: int) -> float | None:
    """Speed (m/s) that the route has set before item `seq`; None: it has set none."""
    speeds = (new_speed(item) for item in route.items if item.seq < seq)
    return next((speed for speed in reversed(list(speeds)) if speed is not None), None)


def hovers_at(route: Route, seq: int) -> bool:
    """True if a quadplane hovers to that item, by the last DO_VTOL_TRANSITION before it."""
    states = [item.param1 for item in route.items if item.command == VTOL_TRANSITION and item.seq < seq]
    return bool(states) and states[-1] == _HOVERING


def landing_sequences(route: Route) -> tuple[tuple[MissionItem, ...], ...]:
    """The landing sequences of a plane: from DO_LAND_START to the landing. Each begins at the first place in it."""
    ways = ways_from_land_starts(route.items)
    return tuple(way for way in ways if way[-1].command in LANDINGS and any(item.has_place for item in way))


def sequence_place(sequence: Sequence[MissionItem]) -> tuple[float, float]:
    """Where a landing sequence begins."""
    return next((item.lat_deg, item.lon_deg) for item in sequence if item.has_place)


def sequence_legs(route: Route, sequence: Sequence[MissionItem], speed_mps: float) -> tuple[Leg, ...]:
    """The lines of a landing sequence: from where it begins, as high as its first place, to the ground."""
    first = next((item for item in sequence if item.has_place and COMMANDS[item.command].flown), sequence[-1])
    start = (*sequence_place(sequence), above_home_m(route, first, sequence_place(sequence)))
    return tuple(_wing_legs(route, sequence[1:], speed_mps, speed_mps, start))


def _legs(
    route: Route, cruise_mps: float, first: int = 0, start_at: tuple[float, float, float] | None = None
) -> Iterator[Leg]:
    speed_mps = speed_at(route, first) or cruise_mps
    here = start_at or (route.home.lat_deg, route.home.lon_deg, 0.0)
    items = as_flown(route.items, first)
    if not route.profile.flies_past:
        risen = _risen(items) if start_at is None else items
        yield from copter_legs(route, _copter_items(route, risen, speed_mps, cruise_mps), here)
        return
    end = next((n for n, item in enumerate(items) if item.command == RETURN_TO_LAUNCH), len(items))
    yield from _wing_legs(route, items[: end + 1], speed_mps, cruise_mps, here)


def _wing_legs(
    route: Route, items: Sequence[MissionItem], first_mps: float, cruise_mps: float, here: tuple[float, float, float]
) -> Iterator[Leg]:
    before = here
    for item, speed_mps in _with_speeds(route, items, first_mps, cruise_mps):
        if not COMMANDS[item.command].flown or item.command in route.profile.not_in_air:
            continue
        hovers = hovers_at(route, item.seq)
        made_mps = min(speed_mps, HOVER_MPS) if hovers else speed_mps
        end = _wing_end(route, item, before, here, made_mps)
        hold_s = _circling_s(route, item, made_mps)
        if is_open(route, item):  # the way back, if the aircraft stands the other way round
            hold_s += 2.0 * distance_m(*here[:2], *end[:2]) / made_mps
        if here != end or hold_s > 0.0:
            length = distance_m(*here[:2], *end[:2])
            time_s = length / made_mps if length > 0.0 else duration_s(here, end, made_mps)
            yield Leg(item.seq, here, end, time_s, hold_s, made_mps, hovers=hovers)
        before, here = (here if here[:2] != end[:2] else before), end
        if item.command in (*LANDINGS, RETURN_TO_LAUNCH) and route.profile.vertical:
            yield from down(item.seq, here)
            here = (*here[:2], 0.0)
        elif item.command == RETURN_TO_LAUNCH:
            near = [(distance_m(*here[:2], *sequence_place(each)), each) for each in landing_sequences(route)]
            if near:
                sequence = min(near, key=lambda found: found[0])[1]
                yield from _wing_legs(route, sequence[1:], cruise_mps, cruise_mps, here)


def _with_speeds(
    route: Route, items: Sequence[MissionItem], speed_mps: float, cruise_mps: float
) -> Iterator[tuple[MissionItem, float]]:
    return speeds_of(items, waiting(route.items), speed_mps, cruise_mps, fastest=route.fastest)


def _wing_end(
    route: Route,
    item: MissionItem,
    before: tuple[float, float, float],
    here: tuple[float, float, float],
    speed_mps: float,
) -> tuple[float, float, float]:
    """Where the way to an item ends. `before`: where the aircraft came from to `here`."""
    lat, lon, alt = here
    place = (item.lat_deg, item.lon_deg) if item.has_place else (lat, lon)
    if item.command == RETURN_TO_LAUNCH:
        return (*return_place(route, lat, lon), alt)
    if item.command in LANDINGS:
        return (*place, alt if route.profile.vertical else 0.0)
    to_alt = above_home_m(route, item, place)
    if item.command in TAKEOFFS and route.profile.vertical:
        return lat, lon, to_alt
    if is_open(route, item):
        return (*climb_end(route, item, (lat, lon), climb_m(to_alt - alt, speed_mps)), to_alt)
    if item.command == CHANGE_ALTITUDE:  # straight on until it is there
        east, north = east_north_m(*before[:2], lat, lon)
        length = math.hypot(east, north)
        on_m = climb_m(to_alt - alt, speed_mps)
        return (
            *(offset(lat, lon, on_m * east / length, on_m * north / length) if length > 0.0 else (lat, lon)),
            to_alt,
        )
    return (*place, to_alt)


def _circling_s(route: Route, item: MissionItem, speed_mps: float) -> float:
    """How long it circles at an item."""
    if item.command == LOITER_TIME:
        return max(0.0, item.param1)
    if item.command == LOITER_TURNS:
        return item.param1 * math.tau * route.wings.circle_radius_m(item.param3, speed_mps) / speed_mps
    return 0.0


def _risen(items: Sequence[MissionItem]) -> Sequence[MissionItem]:
    """The items of a mission from the ground. Without a take-off the pilot is taken to rise to the first height."""
    first = first_in_air(items)
    if first is None or first.command in TAKEOFFS:
        return items
    return (replace(first, command=TAKEOFF), *items)


def _copter_items(
    route: Route, items: Sequence[MissionItem], speed_mps: float, cruise_mps: float
) -> list[tuple[MissionItem, float]]:
    """The items that a copter flies, each with the speed that the route has set by then."""
    flown = _with_speeds(route, items, speed_mps, cruise_mps)
    return [(item, mps) for item, mps in flown if COMMANDS[item.command].flown]


# --- from path to commanders ---


@dataclass(frozen=True, slots=True)
class _Place:
    distance_along_m: float
    time_s: float
    position: tuple[float, float, float]
    seq: int
    holding: frozenset[int]
    #: the item is reached here, with everything that belongs to it
    reached: bool = False
    curved: bool = False
    rests: bool = False


def commanders_along(
    route: Route,
    finder: ZoneFinder,
    parent: int,
    *,
    cruise_speed_mps: float | None = None,
    step_m: float = STEP_M,
    belonging: Belonging | None = None,
) -> RouteSimulation:
    """Simulate `route` through the zones of `finder`, from take-off under `parent` (a system id) to landing.

    `belonging`: the owners of its waypoints, if these decide.
    """
    return simulate_legs(legs_of(route, cruise_speed_mps), finder, parent, step_m, belonging)


def simulate_legs(
    legs: tuple[Leg, ...],
    finder: ZoneFinder,
    parent: int,
    step_m: float = STEP_M,
    belonging: Belonging | None = None,
) -> RouteSimulation:
    """Simulate a path of at least one leg, whose beginning is under `parent`."""
    legs = round_by_round(legs)
    places = list(_places(legs, finder, max(step_m, sum(leg.size_m for leg in legs) / MOST_STEPS)))
    order = [zone.station for zone in finder.zones]
    next_items = [place.seq + place.reached for place in places]
    awaiting = {seq: frozenset[int]() if belonging is None else belonging.awaiting(seq) for seq in set(next_items)}
    open_to = [place.holding - awaiting[seq] for place, seq in zip(places, next_items, strict=True)]
    commander, waiting, opened = parent, frozenset[int](), frozenset[int]()
    handovers: list[Handover] = []
    samples: list[Sample] = []
    for number, place in enumerate(places):
        entered = open_to[number] - open_to[number - 1] if number else frozenset[int]()
        waiting = (waiting & open_to[number]) | (entered - {commander})
        opened = (opened & place.holding) | open_to[number]
        beyond = places[number + 1].holding if number + 1 < len(places) else place.holding
        if commander not in place.holding:
            possible = place.holding
        elif waiting:
            possible = waiting
        elif commander not in beyond:
            possible = (place.holding & beyond) - {commander}
        else:
            possible = frozenset()
        if possible:
            taker = max((s for s in order if s in possible), key=lambda s: _stay_m(places, number, s))
            handovers.append(_handover(places, open_to, number, commander, taker))
            commander, waiting = taker, frozenset()
        samples.append(
            Sample(
                place.distance_along_m,
                place.time_s,
                *place.position,
                place.seq,
                place.holding,
                commander,
                opened,
                place.curved,
                place.rests,
            )
        )
    return RouteSimulation(tuple(samples), tuple(handovers), tuple(_gaps(places)))


def _places(legs: tuple[Leg, ...], finder: ZoneFinder, step_m: float) -> Iterator[_Place]:
    """Places along the legs, at least one every `step_m`, and one just after each border."""
    along = time = 0.0
    lat, lon, alt = legs[0].start
    before = finder.holding(lat, lon, alt)
    yield _Place(along, time, (lat, lon, alt), legs[0].seq, before)
    for number, leg in enumerate(legs, 1):
        ends = number == len(legs) or legs[number].seq != leg.seq  # the way to its item
        size = leg.size_m
        steps = max(1, math.ceil(size / step_m))
        part = 0.0
        for step in range(1, steps + 1):
            target = step / steps
            after = finder.holding(*leg.at(target))
            while before != after:
                part, before = _border(
                    leg, part, target, before=before, finder=finder, smallest=BORDER_M / max(size, BORDER_M)
                )
                yield _Place(
                    along + part * leg.length_m,
                    time + part * leg.duration_s,
                    leg.at(part),
                    leg.seq,
                    before,
                    curved=leg.curved,
                )
            if part < target:
                part = target
                yield _Place(
                    along + part * leg.length_m,
                    time + part * leg.duration_s,
                    leg.at(part),
                    leg.seq,
                    before,
                    reached=ends and step == steps and leg.hold_s == 0.0,
                    curved=leg.curved,
                    rests=leg.rests and step == steps,
                )
        along += leg.length_m
        time += leg.duration_s
        if leg.hold_s > 0.0:
            time += leg.hold_s
            yield _Place(along, time, leg.end, leg.seq, before, reached=ends)


def _border(
    leg: Leg, low: float, high: float, *, before: frozenset[int], finder: ZoneFinder, smallest: float
) -> tuple[float, frozenset[int]]:
    """Bisect between `low` (inside `before`) and `high` (not) to a place just after a border; returns its zones too."""
    while high - low > smallest:
        middle = (low + high) / 2.0
        if finder.holding(*leg.at(middle)) == before:
            low = middle
        else:
            high = middle
    return high, finder.holding(*leg.at(high))


def _stay_m(places: list[_Place], number: int, station: int) -> float:
    last = places[number]
    for last in places[number:]:
        if station not in last.holding:
            break
    return last.distance_along_m - places[number].distance_along_m


def _handover(places: list[_Place], open_to: list[frozenset[int]], number: int, commander: int, taker: int) -> Handover:
    both = {commander, taker}
    first = last = number
    if both <= places[number].holding:
        while first > 0 and both <= places[first - 1].holding and taker in open_to[first - 1]:
            first -= 1
        while last + 1 < len(places) and both <= places[last].holding:
            last += 1
    here = places[number]
    return Handover(
        commander,
        taker,
        here.position[0],
        here.position[1],
        here.distance_along_m,
        here.time_s,
        here.seq,
        places[last].distance_along_m - places[first].distance_along_m,
        places[last].time_s - places[first].time_s,
    )


def _gaps(places: list[_Place]) -> Iterator[Gap]:
    start: _Place | None = None
    for place in places:
        if not place.holding and start is None:
            start = place
        elif place.holding and start is not None:
            yield _gap(start, place)
            start = None
    if start is not None:
        yield _gap(start, places[-1])


def _gap(start: _Place, end: _Place) -> Gap:
    length, duration = end.distance_along_m - start.distance_along_m, end.time_s - start.time_s
    return Gap(*start.position, start.distance_along_m, start.seq, length, duration)
