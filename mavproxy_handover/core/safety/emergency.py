# SPDX-License-Identifier: GPL-3.0-or-later

"""News among the safety decisions: each decision is told and carried out once.

`common/causes.py` and `strategy.py` give causes and a decision at every moment. News is

* another cause;
* a graver action, also because the aircraft has taken off with a warning;
* the end of a hold, and the end of all causes.

TRANSFER, to wait for a station that is about to take the aircraft, is left out: authority tells of it. A held
aircraft stays held meanwhile, and the next commander decides whether it flies on. After the order of a return or a
landing nothing milder is news until the autopilot shows it: the aircraft may already fly it.

This does not weaken the autopilot's failsafes or the RC pilot. A decision is a command that the autopilot may refuse,
and the guard is independent of it.
"""

from __future__ import annotations

from collections.abc import Collection, Set
from dataclasses import dataclass

from mavproxy_handover.core.common.causes import CAUSES, Cause, CauseWatch, Ends
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, Reason
from mavproxy_handover.core.safety.strategy import Decision, Fact, Situation, Strategy

__all__ = ["Emergency", "News"]

#: actions that end as soon as no cause asks for them
_WHILE_ASKED = (FlightAction.HOLD, FlightAction.CONTINUE)
#: news that is no emergency
_NO_EMERGENCY = (FlightAction.WARN, FlightAction.CONTINUE)


@dataclass(frozen=True, slots=True)
class News:
    """The decision from now on, and the one before it; None: there is no cause.

    `grave`: an order was given since the first cause.
    """

    decision: Decision | None
    before: Decision | None
    grave: bool = False

    @property
    def reason(self) -> Reason:
        """Reason of its cause; NONE without a cause."""
        return Reason.NONE if self.decision is None else CAUSES[self.decision.cause].reason

    @property
    def warning(self) -> bool:
        """Whether nothing is commanded for it."""
        return self.decision is None or self.decision.action is FlightAction.WARN

    @property
    def holds(self) -> bool:
        """Whether the aircraft is to stand still from now on."""
        return self.decision is not None and self.decision.action is FlightAction.HOLD

    @property
    def resumes(self) -> bool:
        """Whether the hold of the aircraft ends."""
        return self.before is not None and self.before.action is FlightAction.HOLD and self.mends

    @property
    def mends(self) -> bool:
        """Whether no cause asks for a hold or more. It is false while another source holds an order back."""
        decision = self.decision
        if decision is None or self.continues:
            return True
        return decision.action < FlightAction.HOLD and decision.held_back is None

    @property
    def continues(self) -> bool:
        """Whether the aircraft flies on through a gap that its mission declares. That is no emergency."""
        return self.decision is not None and self.decision.action is FlightAction.CONTINUE

    @property
    def crossed(self) -> bool:
        """Whether the aircraft has crossed the gap, and there is no cause any more."""
        return self.decision is None and self.before is not None and self.before.action is FlightAction.CONTINUE


def _holds(told: Decision) -> bool:
    return told.action is FlightAction.HOLD


class Emergency:
    """The decision that was told last. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_grave", "_left", "_resumed", "_strategy", "_watch", "told")

    def __init__(self, limits: Limits) -> None:
        off = {cause for cause, policy in limits.policies.items() if policy == "off"}
        self._watch = CauseWatch(off, limits.hold_off_s, limits.clear_s)
        self._strategy = Strategy(limits.policies)
        #: None without a cause
        self.told: Decision | None = None
        #: the run before ended in an emergency, and its cause has not been found yet
        self._resumed = False
        #: causes of the run before that last as long as the flight, until the aircraft is known to fly
        self._left: frozenset[Cause] = frozenset()
        #: an order was given since the first cause
        self._grave = False

    @property
    def decision(self) -> Decision | None:
        """The decision of this moment. It may be milder than the one that was told, while that is held back."""
        return self._strategy.decision

    @property
    def brings_down(self) -> bool:
        """Whether the decision ends the mission: a return, or a landing."""
        return self.decision is not None and self.decision.action >= FlightAction.RETURN

    @property
    def causes(self) -> frozenset[Cause]:
        """The causes of the last call of `judge`."""
        return self._watch.active

    @property
    def lasting(self) -> tuple[Cause, ...]:
        """The causes that last until the flight is over, except those that the commander has overruled.

        The next run judges an overruled cause again.
        """
        found = (self.causes | self._left) - {cause for cause, _action in self._strategy.overruled}
        return tuple(cause for cause in Cause if cause in found and CAUSES[cause].ends is Ends.WITH_THE_FLIGHT)

    @property
    def out_of_coverage(self) -> str:
        """The policy in force outside every zone."""
        return self._strategy.policies[Cause.OUT_OF_COVERAGE]

    def set_policy(self, out_of_coverage: str | None) -> None:
        """The mission brings its own policy; None: it has none, and the one in force stays."""
        if out_of_coverage is not None:
            self._strategy.set_policy(Cause.OUT_OF_COVERAGE, out_of_coverage)

    def resume(self) -> None:
        """A restart during or after an emergency. It is over if no cause is found."""
        self._resumed = self._grave = True

    def resume_lasting(self, causes: Collection[Cause]) -> None:
        """A restart with these causes that last as long as the flight: they continue as soon as the aircraft flies."""
        self._left = frozenset(causes)

    def resume_hold(self, cause: Cause) -> None:
        """A restart while the aircraft is held: the hold is commanded again, or is over."""
        self.told = Decision(FlightAction.HOLD, cause)
        self._resumed = self._grave = True

    def overrule(self, facts: Situation) -> None:
        """The commander overrules the order: the present causes give no order until one asks for a graver one."""
        self._strategy.overrule(self._watch.active, facts)
        if self.told is not None:
            self.told = Decision(FlightAction.WARN, self.told.cause)

    def landed(self) -> None:
        """The flight is over. A cause may go on: it is told again only in the next flight."""
        self._left = frozenset()
        self._watch.landed()
        self._strategy.landed()
        if self.told is not None:
            self.told = Decision(FlightAction.WARN, self.told.cause)

    def due_at(self) -> float | None:
        """When `judge` is due at the latest; None: no time runs."""
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
        """The decision if it is news.

        `certain` False: it is not known yet that there is no cause. `stands`: the aircraft was held, and no later order
        has moved it. `unshown`: an order that need not show yet; nothing milder is news.
        """
        if self._left and Fact.FLYING in facts:
            self._watch.resume(self._left)
            self._left = frozenset()
        decision, told = self._strategy.judge(self._watch.update(signs, now), facts), self.told
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
        """Whether the told decision has another cause than this one, and that goes on."""
        told = self.told
        return told is not None and told.cause is not other and told.cause in self._watch.active

    def _known(self, decision: Decision) -> bool:
        """Whether it is the told decision, or a milder one while the cause of that goes on."""
        told = self.told
        if told is None or told.cause not in self._watch.active:
            return False
        if decision.action < told.action:
            return told.action not in _WHILE_ASKED
        return decision == told
