# SPDX-License-Identifier: GPL-3.0-or-later

"""Orders of commanders' operators to the aircraft, good or bad, and their results.

The rules and the geometry are the real ones (`core/safety/commands.py`, `mission/ahead.py`). `Desk` is the edge around
them, as on the aircraft: what the way ahead would leave of energy, fence and coverage. An operator sends the aircraft
on along its mission again after it was stopped or turned back, for any reason. After a refusal the operator does
nothing, sends the same again in time, or lifts the limit that was named.

The operator answers for a lifted limit, and the judge is told.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Final

from mavproxy_handover.core.safety.commands import CommandRules, Kind, Limit, Outcome, Ruling
from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.mission.ahead import leaves_coverage, leaves_fence
from mavproxy_handover.mission.energy import Place, pieces_along
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.gaps import DeclaredGap, Stretch, stretches
from mavproxy_handover.mission.plan import FenceCircle
from mavproxy_handover.mission.route_simulation import Leg, simulate_legs
from mavproxy_handover.mission.zones import Zone, ZoneFinder
from sitl.campaign.aircraft import Aircraft
from sitl.campaign.plan import FlightPlan
from sitl.campaign.plane import Spot, on_earth

__all__ = ["AGAIN_S", "Desk"]

#: how long after a refusal the same command is sent again (s)
AGAIN_S: Final = 12.0
_WISH: Final = "on with the mission"


@dataclass(frozen=True, slots=True)
class Desk:
    """The commander's commands, of one run of the companion. `now_s`: time as operators count it."""

    plan: FlightPlan
    aircraft: Aircraft
    zones: tuple[Zone, ...]
    rules: CommandRules

    def start_lacks(self, now: int) -> str:
        """The energy that START lacks, in words; "" if none. `now`: a tick."""
        way = self.plan.way
        legs = tuple(self._legs(Spot(0.0, 0.0, 0.0), (Spot(0.0, 0.0, way[0].alt_m), *way[1:]), 0))
        return self._energy(legs, now)

    def start(self, lacks: str, station: int, now_s: float) -> Ruling:
        """The ruling on START."""
        return self.rules.rule(Kind.START, "START", {Limit.ENERGY: lacks}, station, now_s, heard_since=-inf)

    def go_on(self, usable: frozenset[int], station: int, now: int, now_s: float) -> Ruling:
        """The ruling on AUTO in flight. `now`: a tick."""
        x, y, z = self.aircraft.at(now)
        first = self.aircraft.waypoint
        legs = tuple(self._legs(Spot(x, y, z), self.plan.way[first:], first))
        left = {
            Limit.ENERGY: self._energy(legs, now),
            Limit.FENCE: leaves_fence(legs, self._fence()),
            Limit.COVERAGE: leaves_coverage(legs, ZoneFinder(self.zones), usable, self._stretches()),
        }
        return self.rules.rule(Kind.GO_ON, _WISH, left if legs else {}, station, now_s, heard_since=-inf)

    def lift(self, ruling: Ruling, now_s: float) -> None:
        """The operator lifts the limit of a refusal."""
        if ruling.outcome is Outcome.REFUSED:
            self.rules.lift(ruling.limits[0], now_s)

    def _legs(self, here: Spot, way: Iterable[Spot], seq: int) -> Iterable[Leg]:
        """From here along the way, and down at its end where it lands."""
        start = here
        for number, end in enumerate(way, seq):
            yield self._leg(number, start, end)
            start = end
        if start is not here and self.plan.lands:
            yield self._leg(len(self.plan.way), start, Spot(start.x_m, start.y_m, 0.0))

    def _leg(self, seq: int, start: Spot, end: Spot) -> Leg:
        begins, ends = ((*on_earth(spot.x_m, spot.y_m), spot.alt_m) for spot in (start, end))
        duration_s = start.away_m(end.x_m, end.y_m) / self.plan.speed_mps
        return Leg(seq, begins, ends, duration_s, 0.0, self.plan.speed_mps)

    def _energy(self, legs: tuple[Leg, ...], now: int) -> str:
        model = self.plan.model()
        fact = EnergyFact(0.0, self.aircraft.left_wh(now) * self.plan.truth.gauge, None, model)
        places = [
            Place(name, *on_earth(spot.x_m, spot.y_m), spot.alt_m)
            for name, spot in self.plan.named_places
            if name != "landing"
        ]
        return fact.shortfall(model.need_wh(pieces_along(legs, places, model, self.plan.speed_mps)))

    def _fence(self) -> Fence:
        fence = self.plan.fence
        return Fence((FenceCircle(True, *on_earth(fence.x_m, fence.y_m), fence.radius_m),))

    def _stretches(self) -> tuple[Stretch, ...]:
        """The declared gaps, as a walk along the whole way finds them."""
        plan = self.plan
        if not plan.gaps:
            return ()
        legs = tuple(self._legs(plan.way[0], plan.way[1:], 1))
        declared = [
            DeclaredGap(station.sysid, None, gap.waypoint, gap.limit_s, "", gap.words)
            for gap in plan.gaps
            for station in plan.stations
            if station.zone.margin_m(*gap.place(gap.begins_m - 5.0)) > 0.0
        ]
        walk = simulate_legs(legs, ZoneFinder(self.zones), plan.stations[0].sysid)
        return stretches(declared, legs, walk, plan.settings, plan.truth.wind)
