# SPDX-License-Identifier: GPL-3.0-or-later

"""Evaluates the candidates from the aircraft's position: distance, time, energy, zones and fence.

`mission/return_paths.py` judges a place on the map. An evaluation takes up to a millisecond, so the chosen site and
home are evaluated each second, and some of the others in turn. If an evaluation fails, the former result stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.core.safety.energy import EnergyFact, Piece
from mavproxy_handover.core.safety.return_site import PlaceFact
from mavproxy_handover.mission.energy import Place, way_back
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.return_paths import flown_s
from mavproxy_handover.monitors.return_site.candidates import HOME, Candidates
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.vehicle.return_limits import fence_limits, return_alt_m, return_mps
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["JUDGING", "Seen", "Views"]

#: name of the job in reports of faults
JUDGING: Final = "return sites"
#: further places that are evaluated in one second
_AT_ONCE: Final = 4
#: length (m) from which the energy of one more metre of the way back is computed
_FARTHER_M: Final = 1000.0
_Where = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Seen:
    """The result of an evaluation, and its inputs.

    `at`: the time (monotonic s) of the energy fact; `left_wh`: the energy left then, None: not known; `metre_wh`: the
    part of the margin that each further metre of the way back takes.
    """

    fact: PlaceFact
    at: float
    left_wh: float | None
    metre_wh: float


class Views:
    """The last evaluation of each candidate, by name. `fault` takes the place and the text of a fault."""

    def __init__(self, state: VehicleState, candidates: Candidates, fault: Callable[[str, str], None]) -> None:
        self._state = state
        self._candidates = candidates
        self._fault = fault
        self.seen: dict[str, Seen] = {}
        self._turn = 0

    def forget_others(self) -> None:
        """The candidates have changed: drop the results of former candidates."""
        names = {place.name for place in self._candidates.places}
        self.seen = {name: seen for name, seen in self.seen.items() if name in names}

    def update(self, chosen: str | None, here: _Where, energy: EnergyFact, beyond_m: float = 0.0) -> None:
        """Evaluate the chosen site, home, and some of the others in turn.

        `beyond_m`: the aircraft may be this much farther away than `here`, its last position.
        """
        places = self._candidates.places
        others = [place for place in places if place.name not in (chosen, HOME)]
        due = [place for place in places if place.name in (chosen, HOME)]
        for _ in range(min(_AT_ONCE, len(others))):
            self._turn = (self._turn + 1) % len(others)
            due.append(others[self._turn])
        due += [place for place in others if place.name not in self.seen and place not in due]
        for place in due:
            self.evaluate(place, here, energy, beyond_m)

    def evaluate(self, place: Place, here: _Where, energy: EnergyFact, beyond_m: float = 0.0) -> None:
        """Evaluate one place."""
        attempt(self._fault, JUDGING, self._evaluate, place, here, energy, beyond_m)

    def _evaluate(self, place: Place, here: _Where, energy: EnergyFact, beyond_m: float) -> None:
        candidates, state, spot = self._candidates, self._state, (place.lat_deg, place.lon_deg)
        assert candidates.package is not None
        model, limits = energy.model, fence_limits(state)
        return_alt = max(return_alt_m(state), 0.0 if model is None else model.return_alt_m)
        speed_mps = return_mps(state, candidates.package.cruise_speed_mps)
        climbs = model is not None and model.holds_airspeed
        way = way_back(here, place, return_alt, speed_mps, climbs_on_way=climbs, beyond_m=beyond_m)
        height = max(here[2], place.alt_m, return_alt)
        if limits.ceiling_m is not None:
            height = max(here[2], min(height, limits.ceiling_m))
        if state.profile.returns_level:  # it comes down to the height of the place in the list, and flies there at that
            height = candidates.point(place).alt_m
        view = candidates.finder.evaluate(here[:2], spot, height)
        inside = view.inside and candidates.within(limits, place)
        need = None if model is None else model.need_wh(way)
        # energy left beyond need and reserve; beyond the need alone
        margin = spare = needs = left = None
        metre_wh = 0.0
        if model is not None and need is not None and energy.left_wh is not None:
            margin = energy.left_wh - model.budget_wh(need)
            spare = energy.left_wh - model.reserve_factor * need
            left = energy.left_wh / model.battery_wh
            if math.isfinite(need):
                needs = model.reserve_factor * need / model.battery_wh
                level = max(way, key=lambda piece: piece.length_m)
                farther = Piece(_FARTHER_M, level.bearing_deg, speed_mps=level.speed_mps)
                metre_wh = model.reserve_factor * model.piece_wh(farther) / _FARTHER_M
        fact = PlaceFact(
            name=place.name,
            distance_m=distance_m(*here[:2], *spot),
            time_s=flown_s(way, model, speed_mps),
            margin_wh=margin,
            spare_wh=spare,
            needs=needs,
            left=left,
            inside=inside,
            way_inside=inside and view.way_inside,
            there=view.there,
            way=view.way,
            way_clear=view.way_clear,
        )
        self.seen[place.name] = Seen(fact, energy.at, energy.left_wh, metre_wh)
