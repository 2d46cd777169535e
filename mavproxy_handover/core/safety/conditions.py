# SPDX-License-Identifier: GPL-3.0-or-later

"""What looks wrong at this moment, and what else a decision rests on: signs and facts from what the rules know.

Coverage counts only where a station could take the aircraft: the commander's own zone, and those of stations that may
be asked now, here or where the commander's zone ends. A station that dies is silent for seconds before that is known,
and by then its zone would be flown over. So who is asked already has `answer_s`: a partner that does not answer for so
long counts no more here, until it does, and one that has not taken the aircraft by then, whatever keeps it (an operator
thinks, a message is on its way), not behind the border. The transfer goes on meanwhile.

Where the last coverage ends ahead (`hold_lead_s`), the aircraft is to stop inside. It then stands still, which looks as
if nothing ended: so that sign stays until another station has authority, or the flight is over. If its commander has it
fly on in spite of it, that is the commander's word, and that border is his: the sign stays, and means nothing, until
the aircraft has got away from it, to where it has more room by PASSED_M, and by a whole circle. Behind that the
next border is one again.

Outside of the commander's zone nobody is held: who waits there for a partner is commanded from where no station should
command. What has wings circles where it is held, and needs room for that: ahead (`circles_s`), and on both sides
(`circle_m`).

A gap that the mission declares is a fact (`gap.py`). Into one the aircraft flies on, and behind it that sign is gone.
Weak links are no sign while one is crossed.

In a rehearsal the aircraft is carried, disarmed: its flight mode says nothing of who flies it, and nobody stands still
where it would: it is carried on or back, and coverage ends ahead only as long as it does.

An aircraft that was held when the companion died stands where it was told to: the next run holds it on, for what is
left of the time (`resume`), or, where it was ordered home or to go on by then and did not, has it go on once nothing is
wrong (`resume_standing`). Until it knows that the aircraft flies, and where, it counts as where it could be held.

To stand still it takes a position. One that is late by less than the hold-off of its cause ends no hold, and of an
autopilot that is not heard, or was not right before, there is none to be late.

What the autopilot was commanded in vain (`supervision.py`) is none of the things that can be done: then it cannot hold,
and no place can be reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.events import PlaceJudged, SignsSeen
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GapFact, GuardState, Reason
from mavproxy_handover.core.safety.command_verification import Supervision
from mavproxy_handover.core.safety.emergency import News
from mavproxy_handover.core.safety.gap import Crossing
from mavproxy_handover.core.safety.mode_source import Helm
from mavproxy_handover.core.safety.strategy import Fact

__all__ = ["Lookout"]

#: what a guard says that does not watch
_NO_WATCH = (GuardState.SILENT, GuardState.DISABLED)
#: who has so much more room (m) than at a border is not there any more
PASSED_M: Final = 50.0
#: before every clock's beginning (s): no hold time is left from then
_LONG_AGO: Final = -1e9


class Lookout:
    """Looks at authority, stations and aircraft. Times are monotonic seconds."""

    __slots__ = (
        "_around",
        "_authority",
        "_blind_since",
        "_candidates",
        "_ended_for",
        "_flight",
        "_held_long",
        "_in_gap",
        "_limits",
        "_may_hold",
        "_passed_m",
        "crossing",
        "held_at",
        "helm",
        "place",
        "resuming",
        "seen",
        "supervision",
        "told",
    )

    def __init__(self, authority: Authority, flight: Flight, candidates: Candidates, limits: Limits) -> None:
        self._authority = authority
        self._flight = flight
        self._candidates = candidates
        self._limits = limits
        #: what the last position showed of coverage
        self._around: frozenset[Cause] = frozenset()
        #: the commander whose coverage came to its end; None if nobody's has
        self._ended_for: int | None = None
        #: how much room it had (m) when its commander had it fly on where coverage ends ahead; None: he has not
        self._passed_m: float | None = None
        #: since when there has been no position; inf while there is one
        self._blind_since = inf
        #: since when the aircraft is held for that; -inf if it is not
        self.held_at = -inf
        #: at the last look that was as long as it may be
        self._held_long = False
        #: that was so before a restart, or it stood by an order, and there has been no position since
        self.resuming = False
        #: who flies, and whether what was commanded is done
        self.helm = Helm()
        self.supervision = Supervision(limits)
        #: what the edge has seen by itself
        self.told = SignsSeen()
        #: where a return goes; None while nobody has said
        self.place: PlaceJudged | None = None
        #: the signs of the last look
        self.seen: frozenset[Cause] = frozenset()
        #: gaps that the mission declares
        self.crossing = Crossing()
        #: at the last look it could stand still
        self._may_hold = False
        #: at the last look the aircraft was in one, and might fly on
        self._in_gap = False

    def resume(self, cause: Cause, since: float | None, owner: int | None, *, certain: bool) -> None:
        """Hold on what the run before held. `certain` False: its clock says nothing here, so no time is left."""
        self.resume_standing(_LONG_AGO if since is None else since, certain=certain)
        if cause is Cause.COVERAGE_ENDS:
            self._ended_for = owner

    def resume_standing(self, since: float | None, *, certain: bool) -> None:
        """It stood by an order of the run before, whatever was ordered since, and stands until something else shows.
        `since`: when it was held; None: it was told to go on already."""
        self.held_at = -inf if since is None else since if certain else _LONG_AGO
        self.resuming = self.supervision.stands = True

    def hold(self, news: News, now: float) -> None:
        """The aircraft is to stand still from now on, or need not. Another cause gives it no new time, nor does what
        was ordered meanwhile, and did not move it."""
        stands = self.supervision.stands
        decision = news.decision
        if decision is not None and decision.cause is Cause.COVERAGE_ENDS and not news.warning:
            self._passed_m = None
        if news.holds:
            self.held_at = self.held_at if stands and self.held_at > -inf else now
        elif news.mends or not stands:
            self.held_at = -inf

    def others_word(self) -> None:
        """Somebody else has said how it flies: whether it stands now is not by an order, and whatever time it had to
        stand is over."""
        self.held_at = -inf

    def overruled(self) -> None:
        """The commander has it fly otherwise in spite of what is wrong: where coverage ends ahead by now he knows."""
        if self._ended_for is not None and not self.resuming:
            self._passed_m = self._candidates.zones.margin_m(self._ended_for)

    def look_around(self, gap: GapFact | None, now: float) -> None:
        """A position has come: what does coverage look like from there? `gap`: that the mission declares there."""
        if self._flight.flying:
            self.resuming = False
        owner, zones = self._authority.owner, self._candidates.zones
        commanded = owner is not None and not self._authority.lost
        covered, exposed = commanded and zones.holds(owner), not commanded or zones.out_since is not None
        before = self.crossing.gap
        self.crossing.seen(gap if self._flight.flying else None, now, covered=covered, exposed=exposed)
        if before is not None and self.crossing.gap is None:  # it ended there because the plan has it so
            self._ended_for = None
        found: set[Cause] = set()
        if owner is not None and self._flight.flying:
            others = self._candidates.ready(zones.inside(), owner, Reason.ZONE_ENDS, now)
            partner, answers, _quick = self._asked(now)
            others = [station for station in others if station != partner or answers]
            if zones.inside() and not zones.holds(owner) and not others:
                found.add(Cause.NO_STATION)
            links = self._candidates.links
            if links.weak(owner) and not links.better(owner, others, now) and self.crossing.since is None:
                found.add(Cause.LINKS_WEAK)
            if commanded and self._ends_ahead(owner, others, now):
                self._ended_for = owner
            elif (self._flight.rehearsing and zones.holds(owner)) or self._has_passed(owner):
                self._ended_for = None
        self._around = frozenset(found)

    @property
    def passed_at_m(self) -> float | None:
        """How far inside its commander's zone (m) it has left behind the border at which it was flown on; None: it was
        at none."""
        return None if self._passed_m is None else self._passed_m + 2.0 * self._flight.circle_m + PASSED_M

    def _has_passed(self, owner: int) -> bool:
        """Whether it has left behind the border at which it was flown on."""
        passed_at_m = self.passed_at_m
        return passed_at_m is not None and self._candidates.zones.margin_m(owner) >= passed_at_m

    def _ends_ahead(self, owner: int, others: Sequence[int], now: float) -> bool:
        """Whether the last coverage that counts ends ahead. `others`: who could take the aircraft here."""
        zones = self._candidates.zones
        left_s = zones.ends_s(owner)
        if not zones.holds(owner) or left_s == inf:
            return False
        room = zones.margin_m(owner) >= self._flight.circle_m
        if room and left_s > max(self._limits.hold_lead_s, self._flight.circles_s):
            return False
        partner, _answers, quick = self._asked(now)
        if any(zones.ends_s(station) > left_s for station in others if station != partner or quick):
            return False
        beyond = zones.beyond(owner) if quick else zones.beyond(owner) - {partner}
        return not self._candidates.ready(beyond, owner, Reason.ZONE_ENDS, now)

    def _asked(self, now: float) -> tuple[int | None, bool, bool]:
        """The partner of the transfer under way, None without one; whether it answers what it is asked, as far as is
        known, and whether it may still have the aircraft in time. Who did not answer the last time has to answer
        first."""
        transfer = self._authority.transfer
        if transfer is None:
            return None, True, True
        partner = transfer.key.to_station
        answers = not (transfer.unanswered(now) or self._candidates.mute(partner))
        return partner, answers, answers and not transfer.slow(now)

    def signs(self, now: float) -> frozenset[Cause]:
        """What looks wrong now."""
        authority, flight = self._authority, self._flight
        found: set[Cause] = set()
        if authority.lost or (authority.owner is None and flight.flying):
            found.add(Cause.COMMANDER_LOST)
        if self._candidates.zones.out_since is not None:
            found.add(Cause.OUT_OF_COVERAGE)
        if flight.flying:
            found |= self._aloft(now)
        elif flight.armed is not None:
            self._ended_for = self._passed_m = None
            self.resuming = self.supervision.stands = False
        self.seen = frozenset(found)
        return self.seen

    def _aloft(self, now: float) -> set[Cause]:
        authority, flight = self._authority, self._flight
        found = set()
        if not flight.autopilot_alive(now):
            found.add(Cause.AUTOPILOT_LOST)
        if self._limits.guard_required and flight.guard(now) in _NO_WATCH:
            found.add(Cause.GUARD_LOST)
        # of an autopilot that is not heard there is nothing to say: its heartbeat may be back before its position is
        blind = not flight.position_known(now) and flight.silent_on_position()
        self._blind_since = min(self._blind_since, now) if blind else inf
        if blind:
            found.add(Cause.POSITION_STALE)
        if self.told.energy:
            found.add(Cause.ENERGY)
        if self.told.off_route:
            found.add(Cause.OFF_ROUTE)
        if self.told.fence:
            found.add(Cause.FENCE)
        if self._ended_for != authority.owner:
            self._ended_for = None
        if authority.owner is None or authority.lost:
            if self._passed_m is not None:  # whose word that was is lost
                self._ended_for = self._passed_m = None
            return found
        if self._ended_for is not None:
            found.add(Cause.COVERAGE_ENDS)
        if self._candidates.links.attacked(authority.owner):
            found.add(Cause.AUTHENTICATION)
        return found | self._around

    def facts(self, now: float) -> frozenset[Fact]:
        """What else a decision rests on now."""
        authority, flight, transfer = self._authority, self._flight, self._authority.transfer
        self._in_gap = self.may_cross(now)
        hurried = now < authority.hurry_until(self._limits.forced_timeout_s)
        unable = self.supervision.unable
        found = set() if flight.rehearsing else self.helm.facts()
        if FlightAction.RETURN not in unable and (self.place is None or self.place.reachable):
            found.add(Fact.PLACE)
        if self._in_gap:
            found.add(Fact.GAP)
        if flight.flying:
            found.add(Fact.FLYING)
        if flight.autopilot_alive(now):
            found.add(Fact.AUTOPILOT)
        soon = transfer is not None and transfer.forced and not transfer.patient and hurried
        if authority.lost and (authority.recovering or soon):
            found.add(Fact.SUCCESSOR)
        self._held_long = self.held_at > -inf and now >= self.held_at + self._limits.hold_s
        covered = authority.owner is not None and self._candidates.zones.holds(authority.owner)
        placed = self.resuming or (covered and now < self._blind_until)
        may_hold = placed and FlightAction.HOLD not in unable
        self._may_hold = may_hold and not authority.lost and not self._held_long
        if self._may_hold:
            found.add(Fact.MAY_HOLD)
        return frozenset(found)

    @property
    def _blind_until(self) -> float:
        """Until when the last position is good enough to stand still by."""
        cause = Cause.POSITION_STALE
        return self._blind_since + self._limits.hold_off_s.get(cause, CAUSES[cause].hold_off_s)

    def may_cross(self, now: float) -> bool:
        """Whether the aircraft is in a gap that its mission declares, or right before it, with time left."""
        authority, flight = self._authority, self._flight
        if authority.owner is None or not flight.flying or not flight.position_known(now):
            return False
        return self.crossing.open(now, commanded=not authority.lost)

    def lost(self, now: float) -> bool:
        """The commander is, in this moment; whether the aircraft may fly on without."""
        self.crossing.begin(now)
        flight = self._flight
        return flight.flying and flight.position_known(now) and self.crossing.open(now, commanded=False)

    def landed(self) -> None:
        """The flight is over."""
        self.crossing.over()

    def due_at(self) -> float | None:
        """When something begins to look wrong without anything being said; None if nothing does."""
        flight = self._flight
        if not flight.flying:
            return self.helm.due_at()
        times = [] if self.held_at == -inf or self._held_long else [self.held_at + self._limits.hold_s]
        gap_ends_at = self.crossing.ends_at()
        times += [at for at in (self.helm.due_at(), self.supervision.due_at) if at is not None]
        if self._in_gap and gap_ends_at is not None:
            times.append(gap_ends_at)
        if self._may_hold and not self.resuming and self._blind_until < inf:
            times.append(self._blind_until)
        if Cause.AUTOPILOT_LOST not in self.seen:
            times.append(flight.autopilot_lost_at())
        if Cause.GUARD_LOST not in self.seen and self._limits.guard_required:
            times.append(flight.guard_lost_at())
        if Cause.POSITION_STALE not in self.seen and flight.silent_on_position():
            times.append(flight.position_lost_at())
        return min((time for time in times if time > -inf), default=None)
