# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones that hold the aircraft, and reasons to move authority because of them.

Rules
-----
* A zone is entered `enter_margin_m` inside its border and left `leave_margin_m` outside: a track along a border does
  not flicker.
* Authority moves to a station when its zone is entered while another commands (the thesis's rule), or when the
  commander's zone has ended or is about to end along the track while another zone still holds the aircraft longer.
* A zone is no reason to move from good links to weak ones: the links would call authority back at once. Good links are
  no reason to move to a zone that ends within `link_steady_s`: that end would call authority back.
* After a change of authority only zones entered since then count as entered. During the dwell time authority does not
  move unless the commander's zone has ended. So it does not go back and forth inside one overlap.
* A zone whose station awaits the aircraft at a waypoint (`ZoneFact.awaits`) counts as entered when the waypoint is
  reached. Until then it calls for no transfer. But it covers the aircraft, also if the commander is lost or its zone
  ends.
* Of several stations the next one on the route is chosen, then the one whose zone keeps the aircraft longest.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Reason, ZoneFact

__all__ = ["ZoneChange", "ZoneTracker"]


@dataclass(frozen=True, slots=True)
class ZoneChange:
    """Changes by the last position: system ids in the order of the facts, stations without a fact first."""

    entered: tuple[int, ...]
    left: tuple[int, ...]


class ZoneTracker:
    """Zone membership with hysteresis, and the choice of the next station."""

    __slots__ = ("_facts", "_fresh", "_inside", "_limits", "_moved_at", "out_since")

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._facts: dict[int, ZoneFact] = {}
        self._inside: set[int] = set()
        self._fresh: set[int] = set()
        self._moved_at = -inf
        #: since when the aircraft is outside every zone; None while one holds it or nothing is known
        self.out_since: float | None = None

    def update(self, facts: Iterable[ZoneFact], now: float) -> ZoneChange:
        """Take in the facts of one position."""
        entered, left = [], []
        before, self._facts = self._facts, {}
        for fact in facts:
            # a station with several zones is covered by the best of them
            known = self._facts.get(fact.station)
            if known is None or fact.margin_m > known.margin_m:
                self._facts[fact.station] = fact
        for station in sorted(self._inside - self._facts.keys()):
            # another mission package, and no zone of that station in it
            self._inside.discard(station)
            self._fresh.discard(station)
            left.append(station)
        for station, fact in self._facts.items():
            if station in self._inside:
                if fact.margin_m <= -self._limits.leave_margin_m:
                    self._inside.discard(station)
                    self._fresh.discard(station)
                    left.append(station)
                elif fact.awaits:
                    self._fresh.discard(station)
                elif station in before and before[station].awaits:  # its waypoint has been reached
                    self._fresh.add(station)
            elif fact.margin_m >= self._limits.enter_margin_m:
                self._inside.add(station)
                entered.append(station)
                if not fact.awaits:
                    self._fresh.add(station)
        if self._inside or not self._facts:
            self.out_since = None
        elif self.out_since is None:
            self.out_since = now
        return ZoneChange(tuple(entered), tuple(left))

    def holds(self, station: int | None) -> bool:
        """Whether this station's zone holds the aircraft."""
        return station in self._inside

    def open(self, station: int) -> bool:
        """Whether this station's zone holds the aircraft, and awaits it at no waypoint any more."""
        return station in self._inside and not self._facts[station].awaits

    def inside(self, first: int | None = None) -> tuple[int, ...]:
        """Stations whose zones hold the aircraft, `first` at the head if it is one of them."""
        return tuple(sorted(self._inside, key=lambda station: (station != first, station)))

    def nearest(self) -> tuple[int, float] | None:
        """The station whose zone is nearest, and the distance to its border (m, < 0 outside); None if none is known."""
        nearest = max(self._facts.values(), key=lambda fact: fact.margin_m, default=None)
        return None if nearest is None else (nearest.station, nearest.margin_m)

    def moved(self, now: float) -> None:
        """Authority has just changed: entries before this do not count any more."""
        self._fresh.clear()
        self._moved_at = now

    def forget_entries(self) -> None:
        """Entries so far were made on the ground and do not count."""
        self._fresh.clear()

    def time_left_s(self, station: int) -> float:
        """Seconds that the zone holds the aircraft on its present track; 0 outside, inf without an end in sight.

        Across the border, where the zone still counts as holding the aircraft, no time is left.
        """
        if station not in self._inside or self._facts[station].margin_m < 0.0:
            return 0.0
        exit_s = self._facts[station].exit_s
        return inf if exit_s is None else exit_s

    def margin_m(self, station: int) -> float:
        """How far inside its border the station's zone holds the aircraft (m); less than 0 outside, -inf if unknown."""
        fact = self._facts.get(station)
        return -inf if fact is None else fact.margin_m

    def ends_s(self, station: int) -> float:
        """How soon the known way leaves the station's zone; 0 outside, inf when it stays inside for the next while."""
        if station not in self._inside or self._facts[station].margin_m < 0.0:
            return 0.0
        ends_s = self._facts[station].ends_s
        return inf if ends_s is None else ends_s

    def beyond(self, station: int) -> frozenset[int]:
        """Stations whose zones hold the place where the known way leaves this station's zone, if it does."""
        fact = self._facts.get(station)
        return frozenset() if fact is None else fact.beyond

    def reasons(
        self, commander: int, usable: Sequence[int], now: float, better: Sequence[int] = (), worse: Sequence[int] = ()
    ) -> dict[int, Reason]:
        """Why authority should move now: each station that it should move to, with the gravest reason.

        `usable`: stations that could take the aircraft. `better`: those of them whose links are good while the
        commander's are not; `worse`: those whose links are weak while the commander's are good.
        """
        if now - self._moved_at < self._limits.dwell_s and commander in self._inside:
            return {}
        left_s = self.time_left_s(commander)
        ends = left_s <= self._limits.exit_soon_s
        found: dict[int, Reason] = {}
        for station in usable:
            if station not in self._inside or station == commander:
                continue
            own_s = self.time_left_s(station)
            if ends and own_s > left_s:
                found[station] = Reason.ZONE_ENDS
            # a better link is no reason to go where the zone ends before it was worth it: authority would come back
            elif station in better and own_s > self._limits.link_steady_s:
                found[station] = Reason.LINK_QUALITY
            elif station in self._fresh and station not in worse:
                found[station] = Reason.ZONE
        return found

    def best(self, stations: Sequence[int], route_next: int | None) -> int:
        """The best of these stations: `route_next`, else the one whose zone keeps the aircraft longest.

        `stations`: at least one, and the zones of all hold the aircraft. `route_next`: the next one on the route.
        """
        return min(stations, key=lambda station: (station != route_next, -self.time_left_s(station), station))

    @property
    def known(self) -> bool:
        """Whether there has been a position with zones to compare it to."""
        return bool(self._facts)
