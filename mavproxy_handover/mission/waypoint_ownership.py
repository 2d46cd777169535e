# SPDX-License-Identifier: GPL-3.0-or-later

"""Waypoints that belong to stations: detector "reached", the thesis's own use of its waypoint lists.

Rules
-----
* Each waypoint belongs to one station. Authority moves when a waypoint of another station than the commander is
  reached. Before, that station awaits the aircraft there, however far its coverage reaches.
* An item that no station lists belongs to the station of the listed item before it, or to the parent before the first.
* A station covers the path to its waypoints, from one to the next, and on to the first one of the next station. It
  commands up to there, and a transfer takes time. `corridor.py` makes that area.
* A return has no waypoints: no station awaits the aircraft on the item that returns, and only coverage counts.

The item that the autopilot flies to tells what has been reached: all items before it are finished, whether they were
flown to or skipped. So a jump ahead is well defined, and a jump back makes stations await the aircraft again. A
companion that restarts in flight knows as much as the one before it.
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

    #: owners of item 0, which is home, 1, 2, ...
    owners: tuple[int, ...]
    stations: frozenset[int]
    #: items that return to a place that the mission does not name
    returns: frozenset[int]

    def owner(self, seq: int) -> int | None:
        """Station of the item; None if the route does not have it, or it is home."""
        return self.owners[seq] if 0 < seq < len(self.owners) else None

    def awaiting(self, seq: int) -> frozenset[int]:
        """Stations that await an aircraft that flies to item `seq` and has finished the one before it.

        `seq` may be one more than the route has: all are finished. No station awaits it on a return, or on the path to
        an item that the route does not have.
        """
        if not 0 <= seq <= len(self.owners) or seq in self.returns:
            return frozenset()
        return self.stations - {self.owners[max(0, seq - 1)]}

    def covers(self, station: int, route: Route) -> frozenset[int]:
        """Items whose path the station covers: its own, and the first one after them."""
        flown = [item.seq for item in route.items if COMMANDS[item.command].flown]
        before = [0, *flown]
        return frozenset(
            seq for seq, last in zip(flown, before, strict=False) if station in (self.owners[seq], self.owners[last])
        )


def belonging_of(where: Where, route: Route, listed: Sequence[tuple[int, Sequence[int]]]) -> Belonging:
    """Make the ownership from the stations' lists (system id, items), the parent's first.

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
