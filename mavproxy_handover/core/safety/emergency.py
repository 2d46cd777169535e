# SPDX-License-Identifier: GPL-3.0-or-later

"""What of the safety decisions is news: each is told and carried out once.

`causes.py` says what is wrong, `strategy.py` what is done about it, at every moment anew. News is another cause, a
graver action (what was a warning on the ground takes off), the end of what held the aircraft back, and the end of it
all. What waits for a station that is about to take the aircraft (TRANSFER) is none: authority tells of that itself. Who
was held stays held meanwhile: the next commander decides whether it flies on. While a return or a landing was just
ordered and the autopilot does not show it yet, nothing milder is news: the aircraft may be flying it already.

Nothing here weakens the autopilot's own failsafes or the RC pilot: a decision is a command that the autopilot may
refuse, and the guard stands behind it.
"""

from __future__ import annotations

from collections.abc import Collection, Set
from dataclasses import dataclass

from mavproxy_handover.core.common.causes import CAUSES, Cause, CauseWatch, Ends
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, Reason
from mavproxy_handover.core.safety.strategy import Decision, Fact, Situation, Strategy

__all__ = ["Emergency", "News"]

#: what is done only as long as it is asked for
_WHILE_ASKED = (FlightAction.HOLD, FlightAction.CONTINUE)
#: what is news and no emergency: nothing is commanded for it
_NO_EMERGENCY = (FlightAction.WARN, FlightAction.CONTINUE)


@dataclass(frozen=True, slots=True)
class News:
    """The decision from now on, None if nothing is wrong any more, and the one before it, None if nothing was.

    `grave`: something was commanded since something has been wrong.
    """

    decision: Decision | None
    before: Decision | None
    grave: bool = False

    @property
    def reason(self) -> Reason:
        """Its cause; NONE if nothing is wrong any more."""
        return Reason.NONE if self.decision is None else CAUSES[self.decision.cause].reason

    @property
    def warning(self) -> bool:
        """Nothing is commanded for it."""
        return self.decision is None or self.decision.action is FlightAction.WARN

    @property
    def holds(self) -> bool:
        """The aircraft is to stand still from now on."""
        return self.decision is not None and self.decision.action is FlightAction.HOLD

    @property
    def resumes(self) -> bool:
        """The aircraft was held, and is not any more."""
        return self.before is not None and self.before.action is FlightAction.HOLD and self.mends

    @property
    def mends(self) -> bool:
        """Nothing calls for a hold, or more, any more. What another hand holds back is not the companion's to end."""
        decision = self.decision
        if decision is None or self.continues:
            return True
        return decision.action < FlightAction.HOLD and decision.held_back is None

    @property
    def continues(self) -> bool:
        """The aircraft flies on through a gap that its mission declares. That is no emergency."""
        return self.decision is not None and self.decision.action is FlightAction.CONTINUE

    @property
    def crossed(self) -> bool:
        """It did, and nothing is wrong any more."""
        return self.decision is None and self.before is not None and self.before.action is FlightAction.CONTINUE


def _holds(told: Decision) -> bool:
    return told.action is FlightAction.HOLD


class Emergency:
    """What was told last of what is wrong. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_grave", "_left", "_resumed", "_strategy", "_watch", "told")

    def __init__(self, limits: Limits) -> None:
        off = {cause for cause, policy in limits.policies.items() if policy == "off"}
        self._watch = CauseWatch(off, limits.hold_off_s, limits.clear_s)
        self._strategy = Strategy(limits.policies)
        #: None while nothing is wrong
        self.told: Decision | None = None
        #: the run before left an emergency behind, and its cause has not been found yet
        self._resumed = False
        #: what the run before left behind that lasts as long as the flight, until the aircraft is known to fly
        self._left: frozenset[Cause] = frozenset()
        #: something was commanded since something has been wrong
        self._grave = False

    @property
    def decision(self) -> Decision | None:
        """What is done at this moment; it may be less than what was told, as long as that is held back."""
        return self._strategy.decision

    @property
    def brings_down(self) -> bool:
        """That ends the mission: a return, or a landing."""
        return self.decision is not None and self.decision.action >= FlightAction.RETURN

    @property
    def causes(self) -> frozenset[Cause]:
        """What is wrong as of the last look."""
        return self._watch.active

    @property
    def lasting(self) -> tuple[Cause, ...]:
        """What is wrong until the flight is over. What the commander has overruled is not of it: he knows, and in the
        next run it is judged anew."""
        found = (self.causes | self._left) - {cause for cause, _action in self._strategy.overruled}
        return tuple(cause for cause in Cause if cause in found and CAUSES[cause].ends is Ends.WITH_THE_FLIGHT)

    @property
    def out_of_coverage(self) -> str:
        """The policy in force outside every zone."""
        return self._strategy.policies[Cause.OUT_OF_COVERAGE]

    def adopt(self, out_of_coverage: str | None) -> None:
        """The mission brings its own policy; None: it has none, and the one in force stays."""
        if out_of_coverage is not None:
            self._strategy.adopt(Cause.OUT_OF_COVERAGE, out_of_coverage)

    def resume(self) -> None:
        """A restart in an emergency, or behind one: its cause is judged anew, and it is over when none is found."""
        self._resumed = self._grave = True

    def resume_lasting(self, causes: Collection[Cause]) -> None:
        """A restart with these wrong until the flight is over: they go on as soon as there is a flight."""
        self._left = frozenset(causes)

    def resume_hold(self, cause: Cause) -> None:
        """A restart while the aircraft is held: if that is to go on it is commanded anew, else it is over."""
        self.told = Decision(FlightAction.HOLD, cause)
        self._resumed = self._grave = True

    def overrule(self, facts: Situation) -> None:
        """The commander has the aircraft fly otherwise than ordered: of what is wrong by now nothing more comes, until
        it gets graver."""
        self._strategy.overrule(self._watch.active, facts)
        if self.told is not None:
            self.told = Decision(FlightAction.WARN, self.told.cause)

    def landed(self) -> None:
        """The flight is over. The cause may go on: on the ground that is no news, in the next flight it is acted on."""
        self._left = frozenset()
        self._watch.landed()
        self._strategy.landed()
        if self.told is not None:
            self.told = Decision(FlightAction.WARN, self.told.cause)

    def due_at(self) -> float | None:
        """When to judge at the latest; None where no moment matters."""
        return self._watch.due_at()

    def judge(
        self,
        signs: Set[Cause],
        facts: Situation,
        now: float,
        *,
        certain: bool = True,
        stands: bool = False,
        unshown: FlightAction | None = None,
    ) -> News | None:
        """The decision if it is news. `certain` False: that nothing is wrong is not known yet. `stands`: it was held,
        and whatever was ordered since has not moved it. `unshown`: was ordered so lately that the autopilot need not
        show it yet; nothing milder is news."""
        if self._left and Fact.FLYING in facts:
            self._watch.resume(self._left)
            self._left = frozenset()
        decision, told = self._strategy.judge(self._watch.look(signs, now), facts), self.told
        if unshown is not None and (decision is None or decision.action < unshown):
            return None
        waits = decision is not None and decision.action is FlightAction.TRANSFER
        if waits and (stands or (told is not None and _holds(told))):
            return None
        if decision is None or waits:
            if decision is not None and self._goes_on(decision.cause):
                return None
            decision = None
            if not certain or self._left or (told is None and not self._resumed):
                return None
        elif self._known(decision) and not self._resumed:
            return None
        self.told, self._resumed = decision, False
        grave = self._grave or (decision is not None and decision.action not in _NO_EMERGENCY)
        self._grave = grave and decision is not None
        return News(decision, told, grave)

    def _goes_on(self, other: Cause) -> bool:
        """What was told is of another cause than this one, and not over."""
        told = self.told
        return told is not None and told.cause is not other and told.cause in self._watch.active

    def _known(self, decision: Decision) -> bool:
        """Whether it is what was told, or milder while the cause of that goes on."""
        told = self.told
        if told is None or told.cause not in self._watch.active:
            return False
        if decision.action < told.action:
            return told.action not in _WHILE_ASKED
        return decision == told
