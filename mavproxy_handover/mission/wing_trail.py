# SPDX-License-Identifier: GPL-3.0-or-later

"""The flown way of an aircraft with wings, as straight legs.

The guidance moves a `Flyer` in steps of two metres. The legs here are longer. A leg ends where the aircraft is 1 m away
from the direction that it had at its beginning. So the leg is within 0.3 m of the curve.
"""

from __future__ import annotations

import math
from dataclasses import replace

from mavproxy_handover.mission.geodesy import east_north_m, offset
from mavproxy_handover.mission.l1_guidance import Flyer, Point
from mavproxy_handover.mission.leg import Leg, Place

__all__ = ["Trail"]

#: how far a piece may lead away from its first direction (m), and how long it may be
_AWAY_M, _LONGEST_M = 1.0, 400.0


class Trail:
    """The legs that were flown, and the place of the aircraft."""

    def __init__(self, here: Place) -> None:
        self.here = here
        self.legs: list[Leg] = []
        self.along_m = 0.0
        #: the item that is flown to, and the speed that was told
        self.seq, self.speed_mps = 0, 1.0
        #: metres are counted from this place
        self._origin = here[:2]
        #: where the current piece began, its direction there, and when that was
        self._began: tuple[Point, Point, float] = ((0.0, 0.0), (0.0, 1.0), 0.0)

    def metres(self, place: tuple[float, float]) -> Point:
        """East and north of the place that metres are counted from."""
        return east_north_m(*self._origin, *place)

    def place(self, point: Point) -> tuple[float, float]:
        """Latitude and longitude of a point."""
        return offset(*self._origin, *point)

    def count_from(self, origin: tuple[float, float], flyer: Flyer) -> None:
        """Count metres from that place from now on."""
        here = self.place((flyer.east, flyer.north))
        self._origin = origin
        flyer.east, flyer.north = self.metres(here)
        self._begin(flyer)

    def straight(self, end: Place, duration_s: float, hold_s: float = 0.0, *, hovers: bool = False) -> None:
        """A leg from here to that place."""
        if end == self.here and hold_s <= 0.0:
            return
        leg = Leg(self.seq, self.here, end, duration_s, hold_s, self.speed_mps, hovers=hovers)
        self.legs.append(leg)
        self.along_m += leg.length_m
        self.here = end

    def follow(self, flyer: Flyer, alt_m: float) -> None:
        """The aircraft has flown a step: begin another leg if it has turned."""
        (east, north), (to_east, to_north), _at = self._began
        east, north = flyer.east - east, flyer.north - north
        if abs(east * to_north - north * to_east) > _AWAY_M or abs(east) + abs(north) > _LONGEST_M:
            self.note(flyer, alt_m)

    def note(self, flyer: Flyer, alt_m: float) -> None:
        """A leg ends where the aircraft is."""
        if (flyer.east, flyer.north) != self._began[0]:
            self.straight((*self.place((flyer.east, flyer.north)), alt_m), flyer.time_s - self._began[2])
        self._begin(flyer)

    def since_m(self, flyer: Flyer) -> float:
        """How far the aircraft is from the end of the last leg."""
        return math.dist((flyer.east, flyer.north), self._began[0])

    def repeat(self, first: int, times: int, flyer: Flyer) -> None:
        """The legs from that number on are flown so many times."""
        self.along_m += (times - 1) * sum(leg.length_m for leg in self.legs[first:])
        self.legs[first:] = [replace(leg, times=times) for leg in self.legs[first:]]
        self._begin(flyer)

    def _begin(self, flyer: Flyer) -> None:
        east, north = flyer.velocity
        speed = math.hypot(east, north)
        to = (east / speed, north / speed) if speed > 0.0 else (0.0, 1.0)
        self._began = ((flyer.east, flyer.north), to, flyer.time_s)
