# SPDX-License-Identifier: GPL-3.0-or-later

"""Where zones begin and end on the way of a mission, and how soon the aircraft is there.

Where a station awaits the aircraft at a waypoint (`reached.py`), its zone begins there.

The way is walked once, when the mission is loaded (`walk.py`): that finds every border. In flight nothing is left but
to measure how far it is to the end of the leg, so a look costs little, however many zones there are. On a circle or a
spline the aircraft is followed from place to place. Times are those of
the walk: at the speed that the mission flies, without wind, and without what corners cost.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Final

from mavproxy_handover.core.model import BorderFact
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.walk import Sample, Walk

__all__ = ["WayAhead"]

#: an aircraft on a curve is looked for on so much of the way ahead (m): what it flies in some seconds
_AHEAD_M: Final = 150.0


@dataclass(frozen=True, slots=True)
class _Border:
    """How far along the way (m), when by the walk (s), and the stations whose zones hold what is behind it."""

    along_m: float
    time_s: float
    holding: frozenset[int]


class WayAhead:
    """The way of one mission, with the borders on it."""

    def __init__(self, walk: Walk) -> None:
        self._alongs = [sample.distance_along_m for sample in walk.samples]
        self._times = [sample.time_s for sample in walk.samples]
        #: the end of the way to each item
        self._ends: dict[int, Sample] = {sample.seq: sample for sample in walk.samples}
        #: of the items that are flown to in a curve: all places on it
        self._curves = {
            seq: tuple(sample for sample in walk.samples if sample.seq == seq)
            for seq in {sample.seq for sample in walk.samples if sample.curved}
        }
        #: the curve that the aircraft is on, and at which place of it
        self._curve: int | None = None
        self._curve_at = 0
        self._borders = tuple(
            _Border(after.distance_along_m, after.time_s, after.open)
            for before, after in pairwise(walk.samples)
            if before.open != after.open
        )

    def borders(self, waypoint: int, lat_deg: float, lon_deg: float, within_s: float) -> tuple[BorderFact, ...]:
        """The borders that are reached within so many seconds, the nearest first, for an aircraft at this place on its
        way to the item `waypoint`; none if the way has no such item."""
        end = self._ends.get(waypoint)
        if end is None:
            return ()
        if waypoint in self._curves:
            here_m = self._on_curve_m(waypoint, (lat_deg, lon_deg))
        else:
            here_m = max(0.0, end.distance_along_m - distance_m(lat_deg, lon_deg, end.lat_deg, end.lon_deg))
        here_s = self._time_at(here_m)
        return tuple(
            BorderFact(number, border.time_s - here_s, border.holding)
            for number, border in enumerate(self._borders)
            if border.along_m > here_m and border.time_s - here_s <= within_s
        )

    def _on_curve_m(self, waypoint: int, here: tuple[float, float]) -> float:
        """How far along the way the aircraft is on a curve: it flies on from where it was seen last, and passes the
        same places again and again on a circle."""
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

    def _time_at(self, along_m: float) -> float:
        """When the walk was so far along; where it stood, or climbed, there: when it went on."""
        at = bisect_right(self._alongs, along_m) - 1
        if at + 1 >= len(self._alongs):
            return self._times[-1]
        begun_m, ended_m = self._alongs[at], self._alongs[at + 1]
        part = (along_m - begun_m) / (ended_m - begun_m)
        return self._times[at] + part * (self._times[at + 1] - self._times[at])
