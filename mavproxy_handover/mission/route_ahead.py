# SPDX-License-Identifier: GPL-3.0-or-later

"""The places that a route leads to next, from the item that is flown to."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.mission.leg import first_pass
from mavproxy_handover.mission.pieces import Line, PieceRow
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import legs_of

__all__ = ["RouteAhead"]

#: this number of legs ahead is enough for the check of zones
_LEGS: Final = 6
#: circles and splines consist of many short legs
_PIECES: Final = 40

#: number of the item, and latitude and longitude (degrees) of the end of a leg to it
_End = tuple[int, tuple[float, float]]


class RouteAhead:
    """The ends of the legs of one route, in the order in which they are flown."""

    def __init__(self, route: Route) -> None:
        legs = legs_of(route)
        self._ends: tuple[_End, ...] = tuple((leg.seq, leg.end[:2]) for leg in legs)
        curved = {leg.seq for leg in legs if leg.curved}
        #: for each item that is flown to in a curve: its pieces, to find the one that the aircraft is on
        ways = first_pass(legs)
        self._rows = {seq: PieceRow([Line(leg.start[:2], leg.end[:2]) for leg in ways[seq]]) for seq in curved}
        #: for each item that is flown several times: the ends of one round
        self._rounds: dict[int, tuple[_End, ...]] = {
            seq: tuple((seq, leg.end[:2]) for leg in ways[seq] if leg.times > 1) for seq in curved
        }

    def places(self, waypoint: int, here: tuple[float, float]) -> tuple[tuple[float, float], ...]:
        """Latitude and longitude (degrees) of the places from the item `waypoint` on; empty if the route has no such
        item.

        `here`: latitude and longitude (degrees) of the aircraft. Of a curve only the rest counts, and of a circle one
        more round.
        """
        first = next((index for index, (seq, _place) in enumerate(self._ends) if seq == waypoint), None)
        if first is None:
            return ()
        row = self._rows.get(waypoint)
        if row is None:
            count = _PIECES if self._rows else _LEGS
            return tuple(place for _seq, place in self._ends[first : first + count])
        after = first + len(row.lines)
        first += row.find(here).piece
        ends = (*self._ends[first:after], *self._rounds.get(waypoint, ()), *self._ends[after:])
        return tuple(place for _seq, place in ends[:_PIECES])
