# SPDX-License-Identifier: GPL-3.0-or-later

"""What has been decided in the present emergency, so that each is told and acted on once.

`safety.decide` says at every moment what is wrong. Here is what of it is news: another cause, a stronger action (what
was a warning on the ground takes off), and the end.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

from mavproxy_handover.core.events import FlightAction
from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.model import Reason
from mavproxy_handover.core.safety import NOTHING_WRONG, Decision, Situation, decide

__all__ = ["Emergency"]


class Emergency:
    """The strongest decision since the present emergency began. Times are monotonic seconds."""

    __slots__ = ("_judged_at", "_limits", "_worst")

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._worst: Decision = NOTHING_WRONG
        self._judged_at = -inf

    @property
    def reason(self) -> Reason:
        """Its cause; NONE without one."""
        return self._worst.reason

    @property
    def out_of_coverage(self) -> FlightAction:
        """The policy in force outside every zone."""
        return self._limits.out_of_coverage

    def adopt(self, out_of_coverage: FlightAction | None) -> None:
        """The mission brings its own policy; None: it has none, and the one in force stays."""
        if out_of_coverage is not None:
            self._limits = replace(self._limits, out_of_coverage=out_of_coverage)

    def resume(self) -> None:
        """A restart in an emergency: its cause is judged anew, and it is over when none is found."""
        self._worst = Decision(FlightAction.WARN, Reason.RESTARTED)

    def landed(self) -> None:
        """The flight is over. The cause may go on: on the ground that is no news, in the next flight it is acted on."""
        self._worst = Decision(FlightAction.WARN, self._worst.reason)

    def due_at(self, out_since: float | None) -> float | None:
        """When to judge at the latest, outside every zone since then; None where no moment matters."""
        if out_since is None:
            return None
        held_until = out_since + self._limits.out_hold_s
        return held_until if held_until > self._judged_at else None

    def judge(self, situation: Situation, *, certain: bool = True) -> Decision | None:
        """The decision if it is news. `certain` False: that nothing is wrong is not known yet."""
        self._judged_at = situation.now
        decision = decide(situation, self._limits)
        if decision.reason is Reason.NONE and not certain:
            return None
        if decision.reason is self._worst.reason and decision.action <= self._worst.action:
            return None
        self._worst = decision
        return decision
