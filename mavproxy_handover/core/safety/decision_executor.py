# SPDX-License-Identifier: GPL-3.0-or-later

"""Executes decisions: tells each one, commands it, watches it, and leaves the aircraft to a person who takes it.

`mode_source.py` knows the source of the flight mode, and `command_verification.py` whether the autopilot follows. Both
meet the decision in force here. Every decision is told in one sentence. The results are told too: another source has
taken the aircraft, an order is repeated, the autopilot does not follow.

A return is told a moment after the order, and again if its return site changes. The return site is judged once more at
the order. The cause of the return, a lost station, may just have made another one the best.

In a rehearsal every decision is told as what would be done. Nothing is commanded, so there is nothing to watch.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Final

from mavproxy_handover.core.common.authority_facts import AuthorityFacts
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.events import Action, Announce, Fly, ModeSeen, ModeSourceSeen, Record
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource, Reason
from mavproxy_handover.core.safety.command_verification import CommandVerification, Seen
from mavproxy_handover.core.safety.conditions import Conditions
from mavproxy_handover.core.safety.decision_facts import DecisionFacts
from mavproxy_handover.core.safety.emergency import Emergency, News
from mavproxy_handover.core.safety.hold_timer import HoldTimer
from mavproxy_handover.core.safety.mode_source import GIVES_BACK, Change, ModeTracker
from mavproxy_handover.core.safety.sentence import Figures, over, sentence
from mavproxy_handover.core.safety.strategy import OVERRULE, OVERRULED, Decision, Fact, Situation

__all__ = ["DecisionExecutor"]

#: mode changes that end an order; the guard does the same as the order
_TAKES: Final = {
    Change.PILOT: ModeSource.PILOT,
    Change.COMMANDER: ModeSource.COMMANDER,
    Change.FAILSAFE: ModeSource.FAILSAFE,
}
#: the modes of an order: in one of them no command is needed
_SAME: Final = {FlightAction.RETURN: (ModeClass.RETURN,), FlightAction.LAND: (ModeClass.LAND,)}
_COMES_HOME: Final = (ModeClass.RETURN, ModeClass.LAND)
#: actions that are commanded
_COMMANDED: Final = (FlightAction.HOLD, FlightAction.CONTINUE, FlightAction.RETURN, FlightAction.LAND)
#: pause between two messages that an order is repeated (s)
_AGAIN_TOLD_S: Final = 10.0


class DecisionExecutor:
    """Executor of one vehicle. Times are monotonic seconds; not safe for threads."""

    __slots__ = (
        "_again_at",
        "_authority",
        "_conditions",
        "_emergency",
        "_facts",
        "_figures",
        "_flight",
        "_hold_cause",
        "_hold_timer",
        "_mode",
        "_tells_at",
        "_told_place",
        "_verification",
    )

    def __init__(
        self,
        authority: AuthorityFacts,
        flight: Flight,
        emergency: Emergency,
        conditions: Conditions,
        facts: DecisionFacts,
        hold_timer: HoldTimer,
        mode: ModeTracker,
        verification: CommandVerification,
    ) -> None:
        self._authority = authority
        self._flight = flight
        self._emergency = emergency
        self._conditions = conditions
        self._facts = facts
        self._hold_timer = hold_timer
        self._mode = mode
        self._verification = verification
        self._figures = Figures(authority, flight)
        #: the cause that the aircraft is held for, whether or not that is commanded; None after another hand has the
        #: aircraft
        self._hold_cause: Cause | None = None
        #: when it was told last that something is commanded again
        self._again_at = -inf
        #: since when a return is to be told, with the next event; None: none is. And the place that was told last
        self._tells_at: float | None = None
        self._told_place = ""

    @property
    def held_for(self) -> Cause | None:
        """Cause for which the aircraft stands still by the order in force; None: it does not.

        The order stays in force while the autopilot is not heard, though only a warning is told then.
        """
        told = self._emergency.told
        if told is None or not (told.action is FlightAction.HOLD or self._only_waits(self._emergency.decision)):
            return None
        return self._hold_cause if self._hold_timer.resuming or self._verification.order is FlightAction.HOLD else None

    def _only_waits(self, decision: Decision | None) -> bool:
        """Whether a hold goes on though the decision is a warning.

        The autopilot cannot be commanded now, or the source of the mode is in doubt.
        """
        if decision is None or decision.action is not FlightAction.WARN:
            return False
        doubt = decision.held_back is Fact.PILOT and self._mode.chosen_by is ModeSource.DOUBT
        return doubt or decision.held_back in (Fact.FLYING, Fact.AUTOPILOT)

    def resume_hold(self, cause: Cause) -> None:
        """The run before held the aircraft for this cause."""
        self._hold_cause = cause

    @property
    def _others_fly(self) -> bool:
        """Whether a pilot or a failsafe flies: then the companion does not order the aircraft on."""
        return not self._mode.facts().isdisjoint(OVERRULE)

    # ---- the source of the mode -----------------------------------------------------------------------------------

    def mode_seen(self, event: ModeSeen, now: float, actions: list[Action]) -> None:
        """The autopilot reports its mode."""
        unheard = not self._flight.autopilot_alive(now)
        self._changed(self._mode.seen(event, self._flight.aloft, now, unheard=unheard), now, actions)

    def mode_source_seen(self, event: ModeSourceSeen, now: float, actions: list[Action]) -> None:
        """A source has, or may have, chosen the mode."""
        self._changed(self._mode.note_source(event, now), now, actions)
        if event.hand is not ModeSource.COMMANDER:
            return
        self._hold_cause = None
        ended = self._verification.commanded()
        if ended is FlightAction.HOLD:
            self._overrule(now)
        if ended is not None:
            self._hold_timer.overridden()
            if event.flown in GIVES_BACK and event.flown is self._mode.flown and not self._mode.piloted:
                self._verification.sent_on(now)

    def resolve_doubt(self, now: float, actions: list[Action]) -> None:
        """Time has passed: a doubt may be over."""
        self._changed(self._mode.resolve_doubt(now), now, actions)

    def _changed(self, change: Change | None, now: float, actions: list[Action]) -> None:
        if change is None:
            return
        who = {Change.COMMANDER: self._authority.owner_name}.get(change)
        text = f"{self._mode.name}: {change.value}" if who is None else f"{self._mode.name}: chosen by {who}"
        actions.append(Record("helm", text))
        ended = None
        if change in _TAKES:
            ended, self._hold_cause = self._verification.taken(_TAKES[change]), None
            self._hold_timer.overridden()
        told = self._emergency.told
        if change is Change.PILOT:
            behind = "" if ended is None else f"; {ended.name} is not commanded any more"
            self._tell(f"PILOT: a pilot has taken over, {self._mode.name}{behind}", FlightAction.WARN, told, actions)
        elif change is Change.GIVEN_BACK:
            self._tell(f"PILOT: the pilot has given it back, {self._mode.name}", FlightAction.WARN, told, actions)
        elif ended is not None:
            text = f"{text}; {ended.name} is not commanded any more"
            self._tell(text, FlightAction.WARN, told, actions)
        waits = told is not None and (told.action in OVERRULED or told.withheld in OVERRULE)
        if change is Change.COMMANDER and (ended is not None or waits):
            self._overrule(now)

    def _overrule(self, now: float) -> None:
        self._emergency.overrule(self._facts.now(now))
        if not self._hold_timer.resuming:
            self._conditions.overruled()

    # ---- what was decided -----------------------------------------------------------------------------------------

    def carry_out(self, news: News, now: float, actions: list[Action]) -> None:
        """A decision is news: tell it, command it unless it is flown already, and watch it."""
        decision = news.decision
        returns = decision is not None and decision.action is FlightAction.RETURN
        self._tells_at = now if returns else None
        if decision is None:
            self._say(over(news.before), actions)
        elif not returns:
            self._tell_decision(decision, now, actions, crosses=news.continues)
        if self._flight.rehearsing:
            return
        if news.holds:
            self._hold_cause = None if decision is None else decision.cause
        elif not self._only_waits(decision):
            self._hold_cause = None
        stands = self._verification.stands and self._mode.flown not in _COMES_HOME
        if (news.resumes or (news.mends and stands)) and self._others_fly:
            self._verification.over()
        elif news.resumes or (news.mends and stands):
            self._verification.go_on(now)
            self._fly(FlightAction.CONTINUE, news.reason, now, actions)
        elif decision is not None and not news.warning and not news.continues:
            self._verification.ordered(decision.action, now)
            self._mode.ordered()
            if not self._flown_already(decision.action):
                self._fly(decision.action, news.reason, now, actions)
        elif decision is None or decision.held_back is None:  # an order that is held back may still be needed
            self._verification.over()

    def _tell_decision(self, decision: Decision, now: float, actions: list[Action], *, crosses: bool = False) -> None:
        figures, place = self._figures.of(decision.cause, self._conditions.reported, now), self._facts.place
        if crosses:
            figures += f". {self._conditions.crossing.words(now)}"
        self._told_place = "" if place is None else place.name
        self._say(sentence(decision, figures, place), actions)

    def _say(self, told: Announce, actions: list[Action]) -> None:
        """Tell every station; in a rehearsal with the word REHEARSAL, and what would be commanded."""
        if self._flight.rehearsing:
            would = "would " if told.action in _COMMANDED else ""
            told = replace(told, text=f"REHEARSAL: {would}{told.text}")
        actions.append(told)

    def rehearsal_over(self, actions: list[Action]) -> None:
        """The rehearsal is over: nothing of it is in force."""
        self._tells_at = None
        if self._emergency.told is not None:
            actions.append(Announce("ALL CLEAR. Over: the rehearsal", None, Reason.NONE))

    def place_seen(self, now: float, actions: list[Action]) -> None:
        """The return site has been judged: tell it if another one was told."""
        told, place = self._emergency.told, self._facts.place
        returns = told is not None and told.action is FlightAction.RETURN and self._tells_at is None
        if returns and told is not None and place is not None and place.name != self._told_place:
            self._tell_decision(told, now, actions)

    def tell_return(self, now: float, actions: list[Action]) -> None:
        """The first event after the order of a return: tell the return, unless it is over."""
        tells_at, told = self._tells_at, self._emergency.told
        if tells_at is None:
            return
        self._tells_at = None
        if told is not None and told.action is FlightAction.RETURN:
            self._tell_decision(told, now, actions)

    def tells_at(self) -> float | None:
        """When a return is due to be told; None: none is."""
        return self._tells_at

    def _flown_already(self, action: FlightAction) -> bool:
        """Whether the mode of this order is flown already, from any source: to command it again would change
        nothing."""
        return self._mode.flown in _SAME.get(action, ())

    def _fly(self, action: FlightAction, reason: Reason, now: float, actions: list[Action]) -> None:
        if action in _SAME:
            self._mode.note_source(ModeSourceSeen(ModeSource.COMPANION), now)
        elif action in self._flight.handling.by_mode:
            self._mode.note_source(ModeSourceSeen(ModeSource.COMPANION, self._flight.handling.by_mode[action]), now)
        actions.append(Fly(action, reason))

    def verify_order(self, facts: Situation, now: float, actions: list[Action]) -> bool:
        """Compare the aircraft to the order in force; returns whether a new decision is needed."""
        verification, decision = self._verification, self._emergency.told
        verification.watch(self._flight.handling)
        order, breached = verification.order, self._conditions.reported.fence
        seen = verification.verify(self._mode, facts, breached, now)
        if seen is None:
            return False
        order = order or verification.order
        assert order is not None
        if seen is Seen.OBEYED:
            actions.append(Record("order", f"{order.name}: {seen.value}, {self._mode.name}"))
        elif seen is Seen.AGAIN:
            if now >= self._again_at + _AGAIN_TOLD_S:
                self._again_at = now
                self._tell(
                    f"{order.name} is ordered again. The aircraft has not begun it, in {self._mode.name}",
                    order,
                    decision,
                    actions,
                )
            self._fly(order, Reason.NONE if decision is None else CAUSES[decision.cause].reason, now, actions)
        else:
            text = f"{order.name}: {seen.value}. The autopilot is in {self._mode.name}"
            self._tell(text, FlightAction.WARN, decision, actions)
            return True
        return False

    def _tell(self, text: str, action: FlightAction, decision: Decision | None, actions: list[Action]) -> None:
        cause: Cause | None = None if decision is None else decision.cause
        if cause is None:
            self._say(Announce(text, action, Reason.NONE), actions)
        else:
            self._say(Announce(f"{text} ({CAUSES[cause].words})", action, CAUSES[cause].reason), actions)
