# SPDX-License-Identifier: GPL-3.0-or-later

"""The facts that a decision rests on besides its causes, and when one of them changes by itself.

A fact is a yes or no (`strategy.Fact`); `DecisionFacts.now` makes the set of those that hold.

* Hold is allowed only inside the commander's own zone, with hold time left and a position that is good enough to hold
  at. Outside the zone the aircraft would wait where no station should command.
* After a restart during a hold it is not known whether the aircraft is still inside that zone. Hold is allowed until
  its position is known.
* An order that the autopilot does not follow (`command_verification.py`) is not possible: then the aircraft cannot
  hold, or cannot reach the return site.
* In a rehearsal the flight mode says nothing of who flies: the aircraft is carried.
"""

from __future__ import annotations

from math import inf

from mavproxy_handover.core.common.authority_facts import AuthorityFacts
from mavproxy_handover.core.common.events import PlaceJudged
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.core.safety.command_verification import CommandVerification
from mavproxy_handover.core.safety.conditions import Conditions
from mavproxy_handover.core.safety.hold_timer import HoldTimer
from mavproxy_handover.core.safety.mode_source import ModeTracker
from mavproxy_handover.core.safety.strategy import Fact

__all__ = ["DecisionFacts"]


class DecisionFacts:
    """The facts of one aircraft. Times are monotonic seconds; not safe for threads."""

    __slots__ = (
        "_authority",
        "_conditions",
        "_flight",
        "_hold_timer",
        "_in_gap",
        "_may_hold",
        "_mode",
        "_verification",
        "place",
    )

    def __init__(
        self,
        authority: AuthorityFacts,
        flight: Flight,
        conditions: Conditions,
        hold_timer: HoldTimer,
        mode: ModeTracker,
        verification: CommandVerification,
    ) -> None:
        self._authority = authority
        self._flight = flight
        self._conditions = conditions
        self._hold_timer = hold_timer
        self._mode = mode
        self._verification = verification
        #: the return site that is chosen now; None before the first choice
        self.place: PlaceJudged | None = None
        #: at the last look the aircraft could be held
        self._may_hold = False
        #: at the last look the aircraft was in a gap, and might fly on
        self._in_gap = False

    def place_judged(self, event: PlaceJudged) -> None:
        """The return site has been chosen or judged again."""
        self.place = event

    def now(self, now: float) -> frozenset[Fact]:
        """The facts at monotonic time `now` (s)."""
        authority, flight, unable = self._authority, self._flight, self._verification.unable
        self._in_gap = self._conditions.may_cross(now)
        found = set() if flight.rehearsing else self._mode.facts()
        if FlightAction.RETURN not in unable and (self.place is None or self.place.reachable):
            found.add(Fact.PLACE)
        if self._in_gap:
            found.add(Fact.GAP)
        if flight.flying:
            found.add(Fact.FLYING)
        if flight.autopilot_alive(now):
            found.add(Fact.AUTOPILOT)
        if authority.successor_awaited(now):
            found.add(Fact.SUCCESSOR)
        used_up = self._hold_timer.used_up(now)
        placed = self._hold_timer.resuming or (authority.covered and now < self._conditions.blind_until)
        may_hold = placed and FlightAction.HOLD not in unable
        self._may_hold = may_hold and not authority.lost and not used_up
        if self._may_hold:
            found.add(Fact.MAY_HOLD)
        return frozenset(found)

    def due_at(self) -> list[float]:
        """When a fact changes in flight though no event comes."""
        times = []
        gap_ends_at, blind_until = self._conditions.crossing.ends_at(), self._conditions.blind_until
        if self._in_gap and gap_ends_at is not None:
            times.append(gap_ends_at)
        if self._may_hold and not self._hold_timer.resuming and blind_until < inf:
            times.append(blind_until)
        return times
