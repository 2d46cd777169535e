# SPDX-License-Identifier: GPL-3.0-or-later

"""Keeps the geofence: around home (FENCE_TYPE bit 1), and stored areas to stay inside and out of (bit 2).

A breach is acted on once, at its beginning: RTL, or LAND if that cannot be had, or nothing where FENCE_ACTION is 0. The
fence above home, the margin, and the ten seconds of manual recovery are not modelled.
"""

from __future__ import annotations

import math
from typing import Final

from sitl.vehicles.builtin.copter import Copter, ModeReason
from sitl.vehicles.builtin.frame import offset_ne_m
from sitl.vehicles.builtin.items import Item

__all__ = ["Geofence"]

_CIRCLE, _POLYGON = 2, 4
_CHECK_S: Final = 0.04
_INSIDE, _OUTSIDE, _CIRCLE_INSIDE, _CIRCLE_OUTSIDE = 5001, 5002, 5003, 5004
_RTL, _LAND = 6, 9


class Geofence:
    """The fence of one vehicle."""

    def __init__(self, copter: Copter) -> None:
        self._copter = copter
        self._checked_at_s = 0.0
        self.breached = False
        #: how many breaches there were, and when the last one began
        self.count = 0
        self.at_s = 0.0

    @property
    def on(self) -> bool:
        """Whether a fence exists and is switched on."""
        return self._copter.parameters["FENCE_ENABLE"] != 0 and (self._has(_CIRCLE) or self._has(_POLYGON))

    def _has(self, kind: int) -> bool:
        wanted = bool(int(self._copter.parameters["FENCE_TYPE"]) & kind)
        return wanted and (kind == _CIRCLE or bool(self._copter.fence))

    def update(self) -> None:
        """Look where the aircraft is."""
        copter = self._copter
        if copter.time_s - self._checked_at_s < _CHECK_S:
            return
        self._checked_at_s = copter.time_s
        watched = self.on and copter.armed and not copter.land_complete
        kind = self._left() if watched else ""
        if kind and not self.breached:
            self.count, self.at_s = self.count + 1, copter.time_s
            copter.say(5, f"{kind} fence breached")
            if copter.parameters["FENCE_ACTION"] != 0 and not copter.set_mode(_RTL, ModeReason.FENCE_BREACHED):
                copter.set_mode(_LAND, ModeReason.FENCE_BREACHED)
        elif self.breached and not kind and copter.armed:
            copter.say(5, "Fence breach cleared")
        self.breached = bool(kind)

    def _left(self) -> str:
        """The kind of fence that the aircraft is outside of, "" if none."""
        copter = self._copter
        away_m = math.hypot(*offset_ne_m(copter.location(), copter.home or copter.start))
        if self._has(_CIRCLE) and away_m > copter.parameters["FENCE_RADIUS"]:
            return "Circle"
        return "Polygon" if self._has(_POLYGON) and self._outside() else ""

    def _outside(self) -> bool:
        """Out of any area to stay inside, or in one to stay out of."""
        items, index = self._copter.fence, 0
        while index < len(items):
            item = items[index]
            count = int(item.param1) if item.command in (_INSIDE, _OUTSIDE) else 1
            if item.command in (_INSIDE, _OUTSIDE):
                within = self._in_polygon(items[index : index + count])
            elif item.command in (_CIRCLE_INSIDE, _CIRCLE_OUTSIDE):
                within = math.hypot(*self._offset(item)) <= item.param1
            else:  # the point to return to is none of it
                index += 1
                continue
            if within is not (item.command in (_INSIDE, _CIRCLE_INSIDE)):
                return True
            index += count
        return False

    def _offset(self, item: Item) -> tuple[float, float]:
        """From the aircraft to a point of the fence: north and east (m)."""
        return offset_ne_m(self._copter.location(), self._copter.item_location(item, self._copter.location()))

    def _in_polygon(self, corners: list[Item]) -> bool:
        points = [self._offset(corner) for corner in corners]
        inside = False
        for (n1, e1), (n2, e2) in zip(points, points[1:] + points[:1], strict=True):
            if (e1 > 0) is not (e2 > 0) and (n2 - n1) * (0 - e1) / (e2 - e1) + n1 > 0:
                inside = not inside
        return inside
