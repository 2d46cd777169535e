# SPDX-License-Identifier: GPL-3.0-or-later

"""Which of the candidates a return goes to. What makes one better than another is `core/safety/return_site.py`.

Rules:

1. After the companion has started, the place that the list holds stays until the stations had time to be heard.
2. On its way to a place the aircraft reads no list. The choice stays fixed then, unless the return may be begun anew.
3. Shortly before the mission ends with a return, its place is the best one of that moment.
"""

from __future__ import annotations

import math
from collections.abc import Set
from typing import Final

from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.core.safety.return_site import Choice, ReturnSiteChooser
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.items import RallyPoint
from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.monitors.return_site.margin import Margin
from mavproxy_handover.monitors.return_site.views import Views
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["SiteChoice"]

#: after this run began, so long (s) the stations may take to be heard: what was found in the list stays meanwhile
_SETTLE_S: Final = 5.0
#: so long (s) before the mission ends with a return its place is the best one of that moment: it is in the list by then
_LAST_S: Final = 12.0


class SiteChoice:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(self, state: VehicleState, candidates: Candidates, views: Views, margin: Margin) -> None:
        self._state = state
        self._candidates = candidates
        self._views = views
        self._margin = margin
        self._chooser = ReturnSiteChooser()
        #: where a return goes now; None while there are no places
        self.now: Choice | None = None
        self._settled_at = math.inf

    @property
    def name(self) -> str | None:
        """The place that is chosen; None: none is."""
        return None if self.now is None else self.now.place.name

    def take_up(self, held: RallyPoint | None, energy: EnergyFact, now: float) -> None:
        """The list has been read for the first time: in flight the place that it holds is where a return goes."""
        if self._settled_at != math.inf:
            return
        self._settled_at = now + _SETTLE_S
        if held is None or not self._state.flying:
            return
        known = self._candidates.like(held)
        place = known or self._candidates.found_in_list(held)
        self._views.forget_others()
        if known is None and self._state.where is not None:
            self._views.evaluate(place, self._state.where, energy)
        self._chooser.adopt(place.name)

    def update(
        self, usable: Set[int], energy: EnergyFact, now: float, *, recovering: bool, returning: bool, may_bounce: bool
    ) -> str:
        """Choose. `usable`: stations that could take the aircraft; `recovering`: who commands is not settled;
        `returning`: it flies to a place, `may_bounce`: and may be sent to another one. Returns the name of the place
        that it has to be sent to instead; "": none."""
        fixed = now < self._settled_at or recovering or (returning and not may_bounce)
        before, seen = self.now, self._views.seen
        places = self._candidates.places
        facts = [self._margin.by_now(seen[place.name], energy) for place in places if place.name in seen]
        ends = not returning and self._mission_returns()
        self.now = self._chooser.choose(facts, usable, now, returning=returning, fixed=fixed, ends=ends)
        moved = self.now is not None and before is not None and before.place.name != self.now.place.name
        return self.now.place.name if self.now is not None and returning and moved else ""

    def _mission_returns(self) -> bool:
        """The mission flies to where it ends with a return, and is nearly there."""
        state, last = self._state, self._candidates.last
        if last is None or not state.flies_mission or state.where is None:
            return False
        seq, place = last
        return state.waypoint == seq and distance_m(*state.where[:2], *place) < _LAST_S * state.track[1]
