# SPDX-License-Identifier: GPL-3.0-or-later

"""The delivery point of a mission: when the aircraft has reached it, by what the autopilot announces.

The autopilot announces each item that is done by MISSION_ITEM_REACHED. ArduCopter does so for some "do" items as well
(DO_CHANGE_SPEED, DO_SET_ROI), in the same step as for the waypoint before them. A link then carries only the later
announcement. So the announcement of a "do" item right after the delivery waypoint counts for that waypoint.
"""

from __future__ import annotations

from itertools import takewhile

from mavproxy_handover.mission.items import COMMANDS
from mavproxy_handover.mission.package import MissionPackage

__all__ = ["DeliveryPoint"]


class DeliveryPoint:
    """The delivery point of the mission that the autopilot flies, if that has one."""

    def __init__(self) -> None:
        self._waypoint: int | None = None
        #: the items whose announcement counts
        self._numbers: frozenset[int] = frozenset()
        self._told = False

    def set_mission(self, package: MissionPackage | None) -> None:
        """Set the package whose mission the autopilot flies; None: another mission, which has no delivery point."""
        self._waypoint, self._numbers, self._told = None, frozenset(), False
        if package is None or package.delivery_waypoint is None:
            return
        self._waypoint = package.delivery_waypoint
        after = (item for item in package.route.items if item.seq > self._waypoint)
        done = takewhile(lambda item: not COMMANDS[item.command].flown, after)
        self._numbers = frozenset((self._waypoint, *(item.seq for item in done)))

    def reached(self, number: int) -> int | None:
        """The autopilot announced this item. Returns the delivery waypoint if that is reached now, once."""
        if number not in self._numbers:
            self._told = False
            return None
        first, self._told = not self._told, True
        return self._waypoint if first else None
