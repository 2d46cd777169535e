# SPDX-License-Identifier: GPL-3.0-or-later

"""Waypoints that belong to stations: detector "reached", the thesis's own use of its waypoint lists.

Rules
-----
* Each waypoint belongs to one station. Authority moves when a waypoint is reached that belongs to another station than
  the one that commands: before, that station awaits the aircraft there, however far its coverage reaches.
* An item that no station lists belongs to the one of the listed item before it, and to the parent before the first.
* A station covers the way to its waypoints, from one to the next, and on to the first one of the next station: up to
  there it commands, and a transfer takes time. `corridor.py` makes the area of that.
* A way back has no waypoints: on the item that returns nobody awaits the aircraft, and coverage alone counts.

What has been reached is told by the item that the autopilot flies to: all before it are done with, whether they were
flown to or left out. So a jump ahead is no riddle, one back makes stations await the aircraft once more, and a
companion that begins anew in flight knows as much as the one before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.items import COMMANDS, RETURN_TO_LAUNCH
from mavproxy_handover.mission.plan import Route

__all__ = ["Belonging", "belonging_of"]


@dataclass(frozen=True, slots=True)
class Belonging:
    """To which station each item of a route belongs; stations by system id."""

    #: of item 0, which is home, 1, 2, ...
    owners: tuple[int, ...]
    stations: frozenset[int]
    #: items that return to a place which the mission does not say
    returns: frozenset[int]

    def owner(self, seq: int) -> int | None:
        """Whose the item is; None if the route does not have it, or it is home."""
        return self.owners[seq] if 0 < seq < len(self.owners) else None

    def awaiting(self, seq: int) -> frozenset[int]:
        """The stations that await an aircraft which flies to item `seq`, and has done with the one before it.

        One more than the route has: all are done with. None awaits it on a return, or on the way to an item that the
        route does not have.
        """
        if not 0 <= seq <= len(self.owners) or seq in self.returns:
            return frozenset()
        return self.stations - {self.owners[max(0, seq - 1)]}

    def covers(self, station: int, route: Route) -> frozenset[int]:
        """The items flown to whose way is the station's to cover: its own, and the first one behind them."""
        flown = [item.seq for item in route.items if COMMANDS[item.command].flown]
        before = [0, *flown]
        return frozenset(
            seq for seq, last in zip(flown, before, strict=False) if station in (self.owners[seq], self.owners[last])
        )


def belonging_of(where: Where, route: Route, listed: Sequence[tuple[int, Sequence[int]]]) -> Belonging:
    """What the lists of the stations (system id, items), the parent's first, say of a route.

    Raises MissionError for an item of two stations, and for one that is not flown to.
    """
    owners: dict[int, int] = {}
    for number, (station, waypoints) in enumerate(listed, 1):
        inside = where.at(f"station {number}")
        for seq in sorted(set(waypoints)):
            if seq > len(route.items):
                raise inside.error(f"waypoint {seq} is not on the route (allowed: 1 to {len(route.items)})")
            command = COMMANDS[route.items[seq - 1].command]
            if not command.flown:
                raise inside.error(f"waypoint {seq} is {command.name} (allowed: an item that is flown to)")
            if seq in owners:
                first = 1 + [sysid for sysid, _items in listed].index(owners[seq])
                raise inside.error(f"waypoint {seq} belongs to station {first} (allowed: one station for a waypoint)")
            owners[seq] = station
    in_order = [listed[0][0]]
    for item in route.items:
        in_order.append(owners.get(item.seq, in_order[-1]))
    returns = frozenset(item.seq for item in route.items if item.command == RETURN_TO_LAUNCH)
    return Belonging(tuple(in_order), frozenset(station for station, _items in listed), returns)
