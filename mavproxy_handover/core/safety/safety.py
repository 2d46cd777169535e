# SPDX-License-Identifier: GPL-3.0-or-later

"""The safety part of the rules: what is wrong, what is decided about it, and whether the aircraft does it.

It owns its parts and takes each event to them:

* `conditions.py`: what looks wrong; `emergency.py`: which decision is news (causes: `common/causes.py`, the table of
  decisions: `strategy.py`).
* `decision_facts.py`: what else a decision rests on; `hold_timer.py`: how long the aircraft is held.
* `mode_source.py`: which source chose the flight mode; `command_verification.py`: whether the autopilot follows an
  order.
* `decision_executor.py`: tells a decision, orders it, and leaves the aircraft to a person who takes it.

It knows of authority what `common/authority_facts.py` says, and changes nothing there: that is the arbiter's part.
"""

from __future__ import annotations

from math import inf

from mavproxy_handover.core.common.authority_facts import AuthorityFacts
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    Action,
    ConditionsSeen,
    ModeSeen,
    ModeSourceSeen,
    MotionSeen,
    MotionUnseen,
    OrderRefused,
    PlaceJudged,
)
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GapFact, Phase
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.core.safety.command_verification import CommandVerification
from mavproxy_handover.core.safety.conditions import Conditions
from mavproxy_handover.core.safety.decision_executor import DecisionExecutor
from mavproxy_handover.core.safety.decision_facts import DecisionFacts
from mavproxy_handover.core.safety.emergency import Emergency, News
from mavproxy_handover.core.safety.hold_timer import HoldTimer
from mavproxy_handover.core.safety.mode_source import ModeTracker
from mavproxy_handover.core.safety.strategy import Situation

__all__ = ["Safety", "SafetyEvent"]

#: the events that concern safety alone
SafetyEvent = ModeSeen | ModeSourceSeen | OrderRefused | MotionSeen | MotionUnseen | ConditionsSeen | PlaceJudged


class Safety:
    """Safety of one vehicle. Times are monotonic seconds; not safe for threads."""

    __slots__ = (
        "_authority",
        "_flight",
        "conditions",
        "emergency",
        "executor",
        "facts",
        "hold_timer",
        "mode",
        "verification",
    )

    def __init__(self, authority: AuthorityFacts, flight: Flight, limits: Limits) -> None:
        self._authority = authority
        self._flight = flight
        self.emergency = Emergency(limits)
        self.conditions = Conditions(authority, flight, limits)
        self.hold_timer = HoldTimer(limits)
        self.mode = ModeTracker()
        self.verification = CommandVerification(limits)
        self.facts = DecisionFacts(authority, flight, self.conditions, self.hold_timer, self.mode, self.verification)
        self.executor = DecisionExecutor(
            authority,
            flight,
            self.emergency,
            self.conditions,
            self.facts,
            self.hold_timer,
            self.mode,
            self.verification,
        )

    # ---- a restart --------------------------------------------------------------------------------------------------

    def resume(self, restored: Snapshot) -> None:
        """Continue where the run before ended, which was in flight. Authority is restored already."""
        certain, held_for = restored.proven, restored.held_for
        self.emergency.set_policy(restored.out_of_coverage)
        self.conditions.crossing.resume(restored.gap_since, certain=certain)
        self.emergency.resume_lasting(restored.lasting)
        if restored.phase is Phase.EMERGENCY or (restored.stands and held_for is None):
            self.emergency.resume()
        elif held_for is not None:
            self.emergency.resume_hold(held_for)
            self.executor.resume_hold(held_for)
            self.hold_timer.resume_hold(restored.held_since, certain=certain)
            self.verification.resume_standing()
            if held_for is Cause.COVERAGE_ENDS:
                self.conditions.resume_end_of_coverage(self._authority.owner)
        if restored.stands and held_for is None:
            self.hold_timer.resume(restored.held_since, certain=certain)
            self.verification.resume_standing()

    @property
    def resuming(self) -> bool:
        """The aircraft stood by an order of the run before, and this run does not know more yet."""
        return self.hold_timer.resuming

    @property
    def held_since(self) -> float | None:
        """Since when the aircraft has stood still by an order; None: it does not."""
        stands = self.verification.stands or self.executor.held_for is not None
        return self.hold_timer.held_at if stands and self.hold_timer.held_at > -inf else None

    # ---- what happens -----------------------------------------------------------------------------------------------

    def handle(self, event: SafetyEvent, now: float, actions: list[Action]) -> None:
        """Take in an event that concerns safety alone."""
        match event:
            case ModeSeen():
                self.executor.mode_seen(event, now, actions)
            case ModeSourceSeen():
                self.executor.mode_source_seen(event, now, actions)
            case OrderRefused():
                self.verification.refused(event.action)
            case MotionSeen():
                self.verification.moved(event, now)
            case MotionUnseen():
                self.verification.unseen()
            case ConditionsSeen():
                self.conditions.report(event)
            case PlaceJudged():
                self.facts.place_judged(event)
                self.executor.place_seen(now, actions)
            case _:
                assert_never(event)

    def position_seen(self, gap: GapFact | None, now: float) -> None:
        """A position has come. `gap`: the gap that the mission declares there."""
        if self._flight.flying:
            self.hold_timer.aircraft_known()
        self.conditions.position_seen(gap, now)

    def commander_lost(self, now: float) -> bool:
        """The commander is lost at this moment; returns whether the aircraft may fly on without it."""
        return self.conditions.commander_lost(now) and not self.emergency.brings_down

    def landed(self) -> None:
        """The flight is over."""
        self.emergency.landed()
        self.conditions.landed()
        self.verification.over()

    # ---- judging ----------------------------------------------------------------------------------------------------

    def judge(self, now: float) -> tuple[Situation, News | None]:
        """Decide; returns the facts, and the decision if it is news. The caller carries it out (`carry_out`)."""
        conditions = self.conditions.evaluate(now)
        if not self._flight.flying and self._flight.armed is not None:
            self.hold_timer.aircraft_known()
            self.verification.grounded()
        facts = self.facts.now(now)
        certain = not self._authority.recovering and not self.hold_timer.resuming
        stands, unshown = self.verification.stands, self.verification.unshown(self.mode, now)
        news = self.emergency.judge(conditions, facts, now, certain=certain, stands=stands, unshown=unshown)
        if news is not None:
            decision = news.decision
            if decision is not None and decision.cause is Cause.COVERAGE_ENDS and not news.warning:
                self.conditions.end_of_coverage_decided()
            self.hold_timer.decided(news, now, stands=stands)
        return facts, news

    def due_at(self) -> list[float]:
        """When something is due though no event comes."""
        others = (self.emergency.due_at(), self.executor.tells_at(), self.mode.due_at(), self.verification.shows_by)
        times = [time for time in others if time is not None]
        if not self._flight.flying:
            return times
        verified_at, held_until = self.verification.due_at, self.hold_timer.due_at()
        flown = [time for time in (verified_at, held_until) if time is not None]
        flown += [*self.facts.due_at(), *self.conditions.due_at()]
        return times + [time for time in flown if time > -inf]
