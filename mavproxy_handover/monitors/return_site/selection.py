# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs the choice of the return site: once a second it gives the candidates' facts to the chooser.

The chooser and its rules are in `core/safety/return_site.py`. Here is decided when the choice is fixed. "The list" is
the autopilot's rally list, which holds the chosen site alone. Rules:

1. After a start of the companion, the site in the list stays chosen until the stations had time to be heard.
2. The autopilot reads the list only when a return begins. So the choice is fixed during a return, unless the companion
   may begin the return again towards another site (`operator/return_site/return_site.py`). It is the site that the list
   held when the return began, even if another site was chosen by then.
3. Shortly before the mission ends with a return, the best site of that moment is chosen.
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

__all__ = ["SiteSelection"]

#: time (s) for the stations to be heard after the start of this run; the site found in the list stays meanwhile
_SETTLE_S: Final = 5.0
#: this time (s) before the mission ends with a return, the best site is chosen, early enough to be written
_LAST_S: Final = 12.0


class SiteSelection:
    """The choice for one vehicle. Times are monotonic seconds."""

    def __init__(self, state: VehicleState, candidates: Candidates, views: Views, margin: Margin) -> None:
        self._state = state
        self._candidates = candidates
        self._views = views
        self._margin = margin
        self._chooser = ReturnSiteChooser()
        #: the current choice; None while there are no candidates
        self.current: Choice | None = None
        self._settled_at = math.inf
        #: the name of the listed place that was chosen since the last update
        self._listed: str | None = None

    @property
    def name(self) -> str | None:
        """The name of the chosen site; None: none is chosen."""
        return None if self.current is None else self.current.place.name

    def restore_from_list(self, held: RallyPoint | None, energy: EnergyFact, now: float) -> None:
        """The list was read for the first time: in flight, the site that it holds becomes the choice."""
        if self._settled_at != math.inf:
            return
        self._settled_at = now + _SETTLE_S
        if held is not None and self._state.flying:
            self.choose_listed(held, energy)

    def choose_listed(self, held: RallyPoint, energy: EnergyFact) -> None:
        """The place in the autopilot's list becomes the choice. The next `update` may choose another place."""
        place = self._candidates.found_in_list(held)
        self._views.forget_others()
        if place.name not in self._views.seen and self._state.where is not None:
            self._views.evaluate(place, self._state.where, energy)
        self._chooser.restore(place.name)
        self._listed = place.name

    def update(
        self, usable: Set[int], energy: EnergyFact, now: float, *, recovering: bool, returning: bool, may_bounce: bool
    ) -> str:
        """Choose. Returns the name of the site that a running return must be sent to instead; "": none.

        `usable`: stations that could take the aircraft; `recovering`: the commander is not certain yet; `returning`:
        the aircraft flies a return; `may_bounce`: the return may begin again, to go to another site.
        """
        fixed = now < self._settled_at or recovering or (returning and not may_bounce)
        before, seen = self._listed or self.name, self._views.seen
        self._listed = None
        places = self._candidates.places
        facts = [self._margin.by_now(seen[place.name], energy) for place in places if place.name in seen]
        ends = not returning and self._mission_returns()
        self.current = self._chooser.choose(facts, usable, now, returning=returning, fixed=fixed, ends=ends)
        moved = before is not None and self.current is not None and before != self.current.place.name
        return self.current.place.name if self.current is not None and may_bounce and moved else ""

    def _mission_returns(self) -> bool:
        """Whether the mission has nearly reached the point where it ends with a return."""
        state, last = self._state, self._candidates.last
        if last is None or not state.flies_mission or state.where is None:
            return False
        seq, place = last
        return state.waypoint == seq and distance_m(*state.where[:2], *place) < _LAST_S * state.track[1]
