# SPDX-License-Identifier: GPL-3.0-or-later

"""The energy margin at the best return site, also if the evaluation of the places fails.

Rules:

1. The battery empties while no place is evaluated. The energy drawn since the last evaluation is subtracted. For the
   return, the aircraft counts as if it had flown away all that time; for a landing, only the drawn energy counts.
2. During a return the aircraft comes nearer to the site as it draws energy, so the values at its beginning stay.
3. If no place is inside the fence, the best of all places counts: energy runs out there too.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.core.safety.return_site import PlaceFact
from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.monitors.return_site.views import Seen, Views
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["Margin"]

#: after this time (s) without an evaluation of a place, the evaluation has failed: up to forty places take less
_OLD_S: Final = 10.0


class Margin:
    """The energy margin of one vehicle."""

    def __init__(self, state: VehicleState, candidates: Candidates, views: Views) -> None:
        self._state = state
        self._candidates = candidates
        self._views = views
        #: the energy fact at the beginning of the current return; None: no return
        self._turned: EnergyFact | None = None

    def update(self, energy: EnergyFact) -> None:
        """The state has changed; `energy`: the current energy fact."""
        if not (self._state.flying and self._state.to_place):
            self._turned = None
        elif self._turned is None:
            self._turned = energy

    def short(self, energy: EnergyFact) -> bool:
        """No place is in reach any more with the reserve left, as far as is known. Not of a plane on its way down: a
        return would lead it away from there, and to the same landing."""
        if self._state.profile.lands_by_sequence and self._state.ways_down.is_on:
            return False
        margin_wh = self.margin_wh(energy)
        return margin_wh is not None and margin_wh <= 0.0

    def margin_wh(self, energy: EnergyFact) -> float | None:
        """The energy (Wh) left beyond need and reserve at the best site; None: not known.

        Before a place was evaluated, it is the energy left beyond the reserve.
        """
        seen = [each for each in self._views.seen.values() if each.fact.inside] or self._views.seen.values()
        margins = [margin for margin in (self._margin_of(each, energy) for each in seen) if margin is not None]
        if margins or self._candidates.package is None or energy.model is None or energy.left_wh is None:
            return max(margins, default=None)
        return energy.left_wh - energy.model.reserve_wh

    def _margin_of(self, seen: Seen, energy: EnergyFact) -> float | None:
        """The margin of one place. If the evaluation has failed, the aircraft may have flown away all the time."""
        known = self._turned or energy
        margin_wh, old_s = self.by_now(seen, energy).margin_wh, known.at - seen.at
        if margin_wh is None or old_s <= _OLD_S or not self._state.flying:
            return margin_wh
        fastest_mps = max(self._state.track[1], self._candidates.return_mps or 0.0)
        return margin_wh - seen.metre_wh * old_s * fastest_mps

    def by_now(self, seen: Seen, energy: EnergyFact) -> PlaceFact:
        """The fact less the energy drawn since the evaluation."""
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
        """The energy left and the need of the way to the best site, for people; "" if not known."""
        left_wh, margin_wh = energy.left_wh, self.margin_wh(energy)
        if left_wh is None or margin_wh is None or not math.isfinite(margin_wh):
            return ""
        return f"{left_wh:.1f} Wh left, the way back needs {left_wh - margin_wh:.1f} Wh with the reserve"
