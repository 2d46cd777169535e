# SPDX-License-Identifier: GPL-3.0-or-later

"""Tells whether a plane in AUTO flies its mission or lands: ArduPlane lands in the mode that flies missions.

Theory of operation
-------------------
The items from a DO_LAND_START to its landing are a way down. The mission uses it. RTL goes on there
(RTL_AUTOLAND), DO_LAND_START and a battery failsafe begin there, and all of them show as AUTO. If the number of the
mode alone counted, a return that has come to its landing would look as if a pilot had ended it. So AUTO on a way down
is

* what it was before, where it was a return or a landing: RTL has gone on;
* what it was when AUTO was left, where it goes on with the same item: it was held on its way down;
* the mission, where it came there item by item, and where no way down is known;
* a landing, where it has come there otherwise: out of another mode, or by a jump.

The mode is told before the item is (HEARTBEAT at once, MISSION_CURRENT half a second later, or never on a bad link).
So AUTO that was just entered counts as what was flown before, until the item is told, but no longer than `_WAIT_S`.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.model import ModeClass
from mavproxy_handover.mission.items import COMMANDS, LANDINGS
from mavproxy_handover.mission.plan import Route, ways_from_land_starts
from mavproxy_handover.vehicle.profiles import Profile

__all__ = ["WaysDown", "ways_down"]

#: the item that is flown to is told twice a second (s)
_WAIT_S: Final = 1.5
#: so many items may be passed without being told of before it is a jump
_MISSED: Final = 1
_ENDS: Final = (ModeClass.RETURN, ModeClass.LAND)


def ways_down(route: Route) -> tuple[range, ...]:
    """The numbers of the items of each way down: from the one after a DO_LAND_START to a landing."""
    ways = ways_from_land_starts(route.items)
    return tuple(range(way[0].seq, way[-1].seq + 1) for way in ways if way[-1].command in LANDINGS)


class WaysDown:
    """Of one aircraft. Times are monotonic seconds."""

    def __init__(self) -> None:
        #: what AUTO is now, where that is not the mission; None: what the mode is called is what is flown
        self.flown: ModeClass | None = None
        self._route: Route | None = None
        self._ways: tuple[range, ...] = ()
        self._profile: Profile | None = None
        self._mode: int | None = None
        #: what was flown before AUTO was entered, and since when that is to be told from the mission
        self._before = ModeClass.OTHER
        self._entered_at: float | None = None
        #: the item that is flown to, and the one at which AUTO was left, with what AUTO was then
        self._seq: int | None = None
        self._left: tuple[int | None, ModeClass | None] = None, None

    @property
    def _may_land(self) -> bool:
        """Its mode flies missions, and landing sequences too."""
        profile = self._profile
        return profile is not None and profile.lands_in_auto and self._mode == profile.auto

    @property
    def may_be(self) -> bool:
        """Whether it is in AUTO at an item of a way down, or of a mission that is not known."""
        return self._may_land and (self._route is None or self._is_down(self._seq))

    @property
    def is_on(self) -> bool:
        """Whether it is in AUTO on a known way down; the mission itself comes there too."""
        return self._may_land and self._is_down(self._seq)

    def leads_to(self, seq: int) -> ModeClass | None:
        """What will be flown where AUTO is told now to go on with this item; None: what is flown already."""
        if not self._may_land or not self._ways:
            return None
        if not self._is_down(seq):
            return None if self.flown is None else ModeClass.MISSION
        comes = self.flown is None and not self._is_down(self._seq)
        return ModeClass.LAND if comes else None

    def set_route(self, route: Route | None) -> None:
        """Set the mission that the autopilot holds; None: it is not known."""
        self._route = route
        self._ways = () if route is None else ways_down(route)
        if not self._ways:
            self.flown = self._entered_at = None

    def lands(self) -> None:
        """The aircraft was ordered to land. On a way down this is a landing from now on."""
        self.flown, self._entered_at = ModeClass.LAND, None

    def mode(self, profile: Profile, mode: int, now: float) -> None:
        """The mode of a heartbeat."""
        before, self._profile, self._mode = self._mode, profile, mode
        if not self._may_land:
            if before == profile.auto:
                self._left = self._seq, self.flown
            self.flown = self._entered_at = None
        elif before not in (None, mode) and self._ways:
            assert before is not None
            self._before = profile.flown(before)
            self.flown, self._entered_at = self._before, now
        elif self._entered_at is not None and now - self._entered_at > _WAIT_S:
            self.flown = self._entered_at = None

    def waypoint(self, seq: int, now: float) -> None:
        """The item that is flown to."""
        before, self._seq = self._seq, seq
        if not self._may_land or not self._ways:
            return
        entered, self._entered_at = self._entered_at is not None, None
        if not self._is_down(seq):
            self.flown = None
        elif entered and self._before in _ENDS:
            self.flown = self._before
        elif entered:
            at, flown = self._left
            self.flown = flown if at == seq else ModeClass.LAND
        elif self.flown is None and before is not None and not self._is_down(before):
            self.flown = None if self._follows(before, seq) else ModeClass.LAND

    def _is_down(self, seq: int | None) -> bool:
        return any(seq in way for way in self._ways)

    def _follows(self, before: int, seq: int) -> bool:
        """The mission goes on from one item to the other by itself."""
        assert self._route is not None
        between = [item for item in self._route.items if before < item.seq < seq and _flown(item.command)]
        return before < seq and len(between) <= _MISSED


def _flown(command: int) -> bool:
    known = COMMANDS.get(command)
    return known is None or known.flown
