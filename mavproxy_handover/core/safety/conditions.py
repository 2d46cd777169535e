# SPDX-License-Identifier: GPL-3.0-or-later

"""Conditions: the faults that show at this moment. `common/causes.py` turns them into causes.

The rules see a condition themselves (authority, stations, autopilot, guard, position), or the monitors report it
(energy, route, fence).

Coverage that ends ahead
------------------------
Which coverage counts is in `authority/coverage.py`. Where it ends ahead, the aircraft is to stop inside. A held
aircraft stands still, and then nothing seems to end. So the condition stays until another station has authority, or
until the flight is over. If the commander orders the aircraft on in spite of it (`overruled`), the condition stays
without effect. It ends when the aircraft is away from that border: it has PASSED_M and a whole circle more room than it
had there. The next border counts again.

Other rules
-----------
* A gap that the mission declares is a fact (`gap.py`). The aircraft flies on into it, and coverage does not end ahead
  any more after it. Weak links are no condition while the aircraft crosses a gap.
* In a rehearsal the aircraft is carried, disarmed, and does not stop for a hold. So coverage ends ahead only while a
  position shows it.
* An aircraft needs a position to stand still. A position that is late by less than the hold-off of its cause ends no
  hold. If the autopilot is not heard, no position can be late.
"""

from __future__ import annotations

from math import inf
from typing import Final

from mavproxy_handover.core.common.authority_facts import AuthorityFacts
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.events import ConditionsSeen
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GapFact, GuardState
from mavproxy_handover.core.safety.gap import Crossing

__all__ = ["Conditions"]

#: a guard that says this does not watch
_NO_WATCH = (GuardState.SILENT, GuardState.DISABLED)
#: an aircraft with so much more room (m) than at a border is not at that border any more
PASSED_M: Final = 50.0


class Conditions:
    """The conditions of one aircraft. Times are monotonic seconds; not safe for threads."""

    __slots__ = (
        "_around",
        "_authority",
        "_blind_since",
        "_ended_for",
        "_flight",
        "_limits",
        "_passed_m",
        "crossing",
        "reported",
        "seen",
    )

    def __init__(self, authority: AuthorityFacts, flight: Flight, limits: Limits) -> None:
        self._authority = authority
        self._flight = flight
        self._limits = limits
        #: what the last position showed of coverage
        self._around: frozenset[Cause] = frozenset()
        #: the commander whose coverage came to its end; None if no commander's has
        self._ended_for: int | None = None
        #: how much room (m) there was when the commander ordered the aircraft on where coverage ends ahead; None: it
        #: has not
        self._passed_m: float | None = None
        #: since when there has been no position; inf while there is one
        self._blind_since = inf
        #: what the monitors report
        self.reported = ConditionsSeen()
        #: the conditions of the last look
        self.seen: frozenset[Cause] = frozenset()
        #: gaps that the mission declares
        self.crossing = Crossing()

    # ---- what happens -----------------------------------------------------------------------------------------------

    def report(self, event: ConditionsSeen) -> None:
        """The monitors report conditions. The report counts until the next one."""
        self.reported = event

    def resume_end_of_coverage(self, owner: int | None) -> None:
        """The run before held the aircraft because this owner's coverage ended ahead."""
        self._ended_for = owner

    def end_of_coverage_decided(self) -> None:
        """A new order is given because coverage ends ahead: the commander's word on the border before is used up."""
        self._passed_m = None

    def overruled(self) -> None:
        """The commander orders the aircraft on in spite of what is wrong. It knows of the end of coverage ahead."""
        if self._ended_for is not None:
            self._passed_m = self._authority.margin_m(self._ended_for)

    def position_seen(self, gap: GapFact | None, now: float) -> None:
        """A position has come. `gap`: the gap that the mission declares there."""
        authority, flying = self._authority, self._flight.flying
        owner = authority.owner
        commanded = owner is not None and not authority.lost
        covered, exposed = commanded and authority.covered, not commanded or authority.out_of_coverage
        before = self.crossing.gap
        self.crossing.seen(gap if flying else None, now, covered=covered, exposed=exposed)
        if before is not None and self.crossing.gap is None:  # coverage ended there because the plan has it so
            self._ended_for = None
        found: set[Cause] = set()
        if owner is not None and flying:
            coverage = authority.coverage(now)
            if coverage.no_station:
                found.add(Cause.NO_STATION)
            if coverage.links_weak and self.crossing.since is None:
                found.add(Cause.LINKS_WEAK)
            if coverage.ends_ahead:
                self._ended_for = owner
            elif (self._flight.rehearsing and authority.covered) or self._has_passed(owner):
                self._ended_for = None
        self._around = frozenset(found)

    def commander_lost(self, now: float) -> bool:
        """The commander is lost at this moment; returns whether the aircraft may fly on without it."""
        self.crossing.begin(now)
        flight = self._flight
        return flight.flying and flight.position_known(now) and self.crossing.open(now, commanded=False)

    def landed(self) -> None:
        """The flight is over."""
        self.crossing.over()

    # ---- what is seen -----------------------------------------------------------------------------------------------

    @property
    def passed_at_m(self) -> float | None:
        """Distance (m) inside the commander's zone at which that border counts as passed; None: there is none."""
        return None if self._passed_m is None else self._passed_m + 2.0 * self._flight.circle_m + PASSED_M

    def _has_passed(self, owner: int) -> bool:
        """Whether the aircraft is away from the border at which it was ordered on."""
        passed_at_m = self.passed_at_m
        return passed_at_m is not None and self._authority.margin_m(owner) >= passed_at_m

    def evaluate(self, now: float) -> frozenset[Cause]:
        """What looks wrong now."""
        authority, flight = self._authority, self._flight
        found: set[Cause] = set()
        if authority.lost or (authority.owner is None and flight.flying):
            found.add(Cause.COMMANDER_LOST)
        if authority.out_of_coverage:
            found.add(Cause.OUT_OF_COVERAGE)
        if flight.flying:
            found |= self._aloft(now)
        elif flight.armed is not None:
            self._ended_for = self._passed_m = None
        self.seen = frozenset(found)
        return self.seen

    def _aloft(self, now: float) -> set[Cause]:
        authority, flight = self._authority, self._flight
        found = set()
        if not flight.autopilot_alive(now):
            found.add(Cause.AUTOPILOT_LOST)
        if self._limits.guard_required and flight.guard(now) in _NO_WATCH:
            found.add(Cause.GUARD_LOST)
        # without the autopilot no position can be late: its heartbeat may be back before its position is
        blind = not flight.position_known(now) and flight.silent_on_position()
        self._blind_since = min(self._blind_since, now) if blind else inf
        if blind:
            found.add(Cause.POSITION_STALE)
        if self.reported.energy:
            found.add(Cause.ENERGY)
        if self.reported.off_route:
            found.add(Cause.OFF_ROUTE)
        if self.reported.fence:
            found.add(Cause.FENCE)
        if self._ended_for != authority.owner:
            self._ended_for = None
        if authority.owner is None or authority.lost:
            if self._passed_m is not None:  # the commander that gave this word is lost
                self._ended_for = self._passed_m = None
            return found
        if self._ended_for is not None:
            found.add(Cause.COVERAGE_ENDS)
        if authority.attacked:
            found.add(Cause.AUTHENTICATION)
        return found | self._around

    @property
    def blind_until(self) -> float:
        """Until when the last position is good enough to stand still by; inf while there is a position."""
        cause = Cause.POSITION_STALE
        return self._blind_since + self._limits.hold_off_s.get(cause, CAUSES[cause].hold_off_s)

    def may_cross(self, now: float) -> bool:
        """Whether the aircraft is in a gap that its mission declares, or right before it, with time left."""
        authority, flight = self._authority, self._flight
        if authority.owner is None or not flight.flying or not flight.position_known(now):
            return False
        return self.crossing.open(now, commanded=not authority.lost)

    def due_at(self) -> list[float]:
        """When a condition begins in flight though no event comes."""
        flight = self._flight
        times = []
        if Cause.AUTOPILOT_LOST not in self.seen:
            times.append(flight.autopilot_lost_at())
        if Cause.GUARD_LOST not in self.seen and self._limits.guard_required:
            times.append(flight.guard_lost_at())
        if Cause.POSITION_STALE not in self.seen and flight.silent_on_position():
            times.append(flight.position_lost_at())
        return times
