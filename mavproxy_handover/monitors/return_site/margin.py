# SPDX-License-Identifier: GPL-3.0-or-later

"""What the battery leaves for the best place of a return, also when looking at the places breaks.

Rules:

1. The battery goes on emptying while no place is looked at: what was drawn since a place was seen does not take the
   aircraft there. It turns back as if it had flown away all that time, and lands for what was drawn alone.
2. On its way back the aircraft gets nearer to the place by what it draws: what was known when it turned stays.
3. If no place is inside the fence, the best of all counts: energy comes to its end there as well.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from mavproxy_handover.core.common.model import Kind
from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.core.safety.return_site import PlaceFact
from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.monitors.return_site.views import Seen, Views
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["Margin"]

#: what was seen of a place longer ago says that looking is broken: up to forty of them come round in less
_OLD_S: Final = 10.0


class Margin:
    """Of one vehicle. `turned`: what was known of energy when the return that is flown began; None: none is flown."""

    def __init__(self, state: VehicleState, candidates: Candidates, views: Views) -> None:
        self._state = state
        self._candidates = candidates
        self._views = views
        self._turned: EnergyFact | None = None

    def update(self, energy: EnergyFact) -> None:
        """The state has changed; `energy`: what is known now."""
        if not (self._state.flying and self._state.to_place):
            self._turned = None
        elif self._turned is None:
            self._turned = energy

    def short(self, energy: EnergyFact) -> bool:
        """No place is in reach any more with the reserve left, as far as is known. Not of a plane on its way down: a
        return would lead it away from there, and to the same landing."""
        if self._state.kind is Kind.PLANE and self._state.ways_down.is_on:
            return False
        margin_wh = self.margin_wh(energy)
        return margin_wh is not None and margin_wh <= 0.0

    def margin_wh(self, energy: EnergyFact) -> float | None:
        """What the best place leaves beyond need and reserve; None: not known. Before a place was seen it is what is
        left beyond the reserve."""
        seen = [each for each in self._views.seen.values() if each.fact.inside] or self._views.seen.values()
        margins = [margin for margin in (self._margin_of(each, energy) for each in seen) if margin is not None]
        if margins or self._candidates.package is None or energy.model is None or energy.left_wh is None:
            return max(margins, default=None)
        return energy.left_wh - energy.model.reserve_wh

    def _margin_of(self, seen: Seen, energy: EnergyFact) -> float | None:
        """Of one place; if looking is broken, the aircraft may have flown away from there all the time."""
        known = self._turned or energy
        margin_wh, old_s = self.by_now(seen, energy).margin_wh, known.at - seen.at
        if margin_wh is None or old_s <= _OLD_S or not self._state.flying:
            return margin_wh
        fastest_mps = max(self._state.track[1], self._candidates.return_mps or 0.0)
        return margin_wh - seen.metre_wh * old_s * fastest_mps

    def by_now(self, seen: Seen, energy: EnergyFact) -> PlaceFact:
        """The fact without what was drawn since: nothing, if the place was looked at this second."""
        fact, left_wh = seen.fact, (self._turned or energy).left_wh
        if fact.margin_wh is None or fact.spare_wh is None or fact.left is None:
            return fact
        if left_wh is None or seen.left_wh is None or left_wh >= seen.left_wh:
            return fact
        drawn_wh = seen.left_wh - left_wh
        return replace(
            fact,
            margin_wh=fact.margin_wh - drawn_wh,
            spare_wh=fact.spare_wh - drawn_wh,
            left=fact.left * left_wh / seen.left_wh,
        )

    def words(self, energy: EnergyFact) -> str:
        """What is left, and what the way to the best place needs, for people; "": not known."""
        left_wh, margin_wh = energy.left_wh, self.margin_wh(energy)
        if left_wh is None or margin_wh is None or not math.isfinite(margin_wh):
            return ""
        return f"energy: {left_wh:.1f} Wh left, the way back needs {left_wh - margin_wh:.1f} Wh with the reserve"
