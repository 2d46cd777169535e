# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds where zones begin and end on the route, and how soon the aircraft reaches these borders.

If a station awaits the aircraft at a waypoint (`waypoint_ownership.py`), its zone begins there.

The route is simulated once, when the mission is loaded (`route_simulation.py`), which finds every border. In flight
only the distance to the end of the leg is measured, so a check is cheap with any number of zones. On a circle or a
spline the aircraft is tracked from place to place. In a climb or descent on the spot its height is used.

Times of a copter include acceleration and corners (`pace.py`); those of wings are the simulation's, at their airspeed.
Both follow the flight:

* an aircraft that is slower than it should be there, for example after a stop, has yet to accelerate;
* if it flies this leg at another steady speed, because of an order or wind, that speed counts to the end of the leg;
* a wait at a waypoint ends its time after the aircraft came there.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Final

from mavproxy_handover.core.common.model import BorderFact
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.items import LANDINGS, RETURN_TO_LAUNCH
from mavproxy_handover.mission.pace import Pace, speed_up_mps2
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import RouteSimulation, Sample

__all__ = ["Seen", "WayAhead"]

#: length (m) of the path in which an aircraft on a curve is searched: some seconds of flight
_AHEAD_M: Final = 150.0
#: distance (m) within which the aircraft is at a place where it climbs, descends or waits
_THERE_M: Final = 5.0
#: distance (m) from its height at which a climb is done; horizontal metres below which a part of the path is on the
#: spot
_CLIMBED_M, _ON_THE_SPOT_M = 0.7, 0.05
#: two places of the path that are nearer in time (s) are a border beside another place, and no stay
_STAYS_S: Final = 0.1
#: a speed is steady if it stayed within this share for this time (s)
_STEADY, _STEADY_S = 0.05, 2.0
#: below this (m/s) the aircraft stands; the largest factor by which times are stretched or shortened
_STANDS_MPS, _MOST_FACTOR = 1.0, 4.0


@dataclass(frozen=True, slots=True)
class Seen:
    """The aircraft at a time (monotonic s).

    Fields: the item that it flies to, latitude and longitude (degrees), height above home (m) and ground speed (m/s).
    """

    waypoint: int
    lat_deg: float
    lon_deg: float
    alt_m: float
    speed_mps: float
    now: float


@dataclass(frozen=True, slots=True)
class _Border:
    """Time of the copter at the border (s from take-off), and the stations whose zones hold what follows."""

    time_s: float
    holding: frozenset[int]


@dataclass(frozen=True, slots=True)
class _Spot:
    """A climb, a descent or a wait on the spot: first and last number of its places."""

    first: int
    last: int


class WayAhead:
    """The path of one mission, with its borders.

    `flies_past`: the aircraft does not stop at waypoints; `rests`: else the items before which it comes to rest.
    """

    @classmethod
    def of(cls, simulation: RouteSimulation, route: Route) -> WayAhead:
        """The path of a simulated route."""
        rests = frozenset(item.seq for item in route.items if item.command in (*LANDINGS, RETURN_TO_LAUNCH))
        return cls(simulation, flies_past=route.profile.flies_past, rests=rests)

    def __init__(
        self, simulation: RouteSimulation, *, flies_past: bool = False, rests: frozenset[int] = frozenset()
    ) -> None:
        samples = simulation.samples
        self._samples = samples
        self._flies_past = flies_past
        self._alongs = [sample.distance_along_m for sample in samples]
        if flies_past:
            self._times = [sample.time_s for sample in samples]
            self._speeds = _simulated_speeds(samples)
        else:
            pace = Pace(samples, rests)
            self._times, self._speeds = pace.times_s, pace.speeds_mps
        #: number of the last place on the path to each item
        self._ends = {sample.seq: number for number, sample in enumerate(samples)}
        #: for each item that is flown to in a curve: all places on it
        self._curves = {
            seq: tuple(sample for sample in samples if sample.seq == seq)
            for seq in {sample.seq for sample in samples if sample.curved}
        }
        # a circle passes again and again where it was begun
        self._spots = {
            seq: [spot for spot in spots if seq not in self._curves or samples[spot.first].curved]
            for seq, spots in _spots(samples).items()
        }
        #: the current curve, and the place of the aircraft on it
        self._curve: int | None = None
        self._curve_at = 0
        self._borders = tuple(
            _Border(self._times[number], after.open)
            for number, (before, after) in enumerate(pairwise(samples), 1)
            if before.open != after.open
        )
        #: the item at the last check, and the last speeds on the path to it (monotonic s, m/s)
        self._waypoint: int | None = None
        self._speeds_seen: deque[tuple[float, float]] = deque()
        #: time since which the aircraft waits on the spot (monotonic s)
        self._waits_since: float | None = None

    def borders(self, seen: Seen, within_s: float) -> tuple[BorderFact, ...]:
        """The borders reached within `within_s`, the nearest first; none if the route has no such item."""
        end = self._ends.get(seen.waypoint)
        if end is None:
            return ()
        self._note_speed(seen)
        spot = next((spot for spot in self._spots.get(seen.waypoint, ()) if self._is_at(spot, seen)), None)
        if spot is not None:
            here_s, late_s, slower = self._time_on(spot, seen), 0.0, 1.0
        else:
            self._waits_since = None
            here_s, late_s, slower = self._time_between(seen, end)
        leg_s = max(0.0, self._times[end] - here_s)
        found = []
        for number, border in enumerate(self._borders):
            if border.time_s <= here_s:
                continue
            in_s = border.time_s - here_s
            in_s += late_s + (slower - 1.0) * min(leg_s, in_s)
            if in_s <= within_s:
                found.append(BorderFact(number, in_s, border.holding))
        return tuple(found)

    def _note_speed(self, seen: Seen) -> None:
        if seen.waypoint != self._waypoint:
            self._waypoint, self._waits_since = seen.waypoint, None
            self._speeds_seen.clear()
        self._speeds_seen.append((seen.now, seen.speed_mps))
        while len(self._speeds_seen) > 2 and seen.now - self._speeds_seen[1][0] >= _STEADY_S:
            self._speeds_seen.popleft()

    # ---- on the spot ------------------------------------------------------------------------------------------------

    def _is_at(self, spot: _Spot, seen: Seen) -> bool:
        """True while the aircraft climbs, descends or waits there."""
        last, first = self._samples[spot.last], self._samples[spot.first]
        if distance_m(seen.lat_deg, seen.lon_deg, last.lat_deg, last.lon_deg) > _THERE_M:
            return False
        if first.alt_m == last.alt_m:
            return True
        up = 1.0 if last.alt_m > first.alt_m else -1.0
        return up * (last.alt_m - seen.alt_m) > _CLIMBED_M

    def _time_on(self, spot: _Spot, seen: Seen) -> float:
        first_s, last_s = self._times[spot.first], self._times[spot.last]
        first_m, last_m = self._samples[spot.first].alt_m, self._samples[spot.last].alt_m
        if first_m == last_m:
            if self._waits_since is None:
                self._waits_since = seen.now
            return min(last_s, first_s + seen.now - self._waits_since)
        up = 1.0 if last_m > first_m else -1.0
        for number in range(spot.first, spot.last):
            begins_m, ends_m = self._samples[number].alt_m, self._samples[number + 1].alt_m
            if up * (ends_m - seen.alt_m) > 0.0:
                # a wait before a descent is not told from its end
                part = 1.0 if begins_m == ends_m else max(0.0, (seen.alt_m - begins_m) / (ends_m - begins_m))
                return self._times[number] + part * (self._times[number + 1] - self._times[number])
        return last_s

    # ---- between places ---------------------------------------------------------------------------------------------

    def _time_between(self, seen: Seen, end: int) -> tuple[float, float, float]:
        """Time of the simulation at the aircraft's place, time to accelerate (s), and factor of the time on this leg.

        The factor is not 1 if the aircraft flies this leg at another speed.
        """
        here_m = self._along_m(seen, end)
        here_s, planned_mps = self._at(here_m)
        slower = self._slower(seen, here_m, planned_mps)
        lacks_mps = planned_mps - seen.speed_mps
        late_s = 0.0
        if slower == 1.0 and lacks_mps > 0.0 and not self._flies_past:
            late_s = lacks_mps**2 / (2.0 * speed_up_mps2() * planned_mps)
        return here_s, late_s, slower

    def _slower(self, seen: Seen, here_m: float, planned_mps: float) -> float:
        """Factor of the speed: 1 unless planned and flown speed are both steady and differ for a while."""
        speeds = [speed for _at, speed in self._speeds_seen]
        least, most = min(speeds), max(speeds)
        if seen.now - self._speeds_seen[0][0] < _STEADY_S or min(least, planned_mps) < _STANDS_MPS:
            return 1.0
        if most - least > _STEADY * most:
            return 1.0
        _time_s, before_mps = self._at(here_m - _STEADY_S * most)
        if abs(before_mps - planned_mps) > _STEADY * planned_mps:
            return 1.0
        factor = planned_mps / seen.speed_mps
        if abs(factor - 1.0) <= _STEADY:
            return 1.0
        return min(_MOST_FACTOR, max(1.0 / _MOST_FACTOR, factor))

    def _along_m(self, seen: Seen, end: int) -> float:
        if seen.waypoint in self._curves:
            return self._on_curve_m(seen.waypoint, (seen.lat_deg, seen.lon_deg))
        place = self._samples[end]
        return max(0.0, self._alongs[end] - distance_m(seen.lat_deg, seen.lon_deg, place.lat_deg, place.lon_deg))

    def _on_curve_m(self, waypoint: int, here: tuple[float, float]) -> float:
        """Distance along the path of an aircraft on a curve.

        The search starts at its last place, because a circle passes the same places again and again.
        """
        places = self._curves[waypoint]
        if self._curve != waypoint:
            self._curve, self._curve_at = waypoint, 0
        along_m, nearest_m = places[self._curve_at].distance_along_m, inf
        for number in range(self._curve_at, len(places)):
            place = places[number]
            if place.distance_along_m - along_m > _AHEAD_M:
                break
            away_m = distance_m(*here, place.lat_deg, place.lon_deg)
            if away_m < nearest_m:
                nearest_m, self._curve_at = away_m, number
        return places[self._curve_at].distance_along_m

    def _at(self, along_m: float) -> tuple[float, float]:
        """Time and speed at this distance along the path; at a stop or a climb the time of going on.

        Before the path begins, they are those of its beginning.
        """
        at = bisect_right(self._alongs, max(0.0, along_m)) - 1
        if at + 1 >= len(self._alongs):
            return self._times[-1], self._speeds[-1]
        begun_m, ended_m = self._alongs[at], self._alongs[at + 1]
        part = max(0.0, along_m - begun_m) / (ended_m - begun_m)
        time_s = self._times[at] + part * (self._times[at + 1] - self._times[at])
        square = self._speeds[at] ** 2 + part * (self._speeds[at + 1] ** 2 - self._speeds[at] ** 2)
        return time_s, square**0.5


def _spots(samples: tuple[Sample, ...]) -> dict[int, list[_Spot]]:
    """By item, the climbs, descents and waits on the spot before it."""
    found: dict[int, list[_Spot]] = {}
    number = 0
    while number + 1 < len(samples):
        last = number
        while last + 1 < len(samples) and _stays(samples[last], samples[last + 1], samples[number + 1].seq):
            last += 1
        if samples[last].time_s - samples[number].time_s > _STAYS_S:
            found.setdefault(samples[last].seq, []).append(_Spot(number, last))
        number = max(last, number + 1)
    return found


def _stays(before: Sample, after: Sample, seq: int) -> bool:
    return after.seq == seq and after.distance_along_m - before.distance_along_m < _ON_THE_SPOT_M


def _simulated_speeds(samples: tuple[Sample, ...]) -> list[float]:
    """Ground speed of the simulation after each of its places; at the last place the speed before it."""
    speeds = [0.0] * len(samples)
    for number in range(len(samples) - 2, -1, -1):
        time_s = samples[number + 1].time_s - samples[number].time_s
        length_m = samples[number + 1].distance_along_m - samples[number].distance_along_m
        speeds[number] = length_m / time_s if time_s > 0.0 and length_m > _ON_THE_SPOT_M else speeds[number + 1]
    return speeds
