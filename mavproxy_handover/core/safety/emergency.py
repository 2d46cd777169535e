# SPDX-License-Identifier: GPL-3.0-or-later

"""Safety decisions: state in, decision and reason out. One pure, total function, tested as a table.

`decide` says at every moment what is wrong. `Emergency` says what of it is news, so that each is told and acted on
once: another cause, a stronger action (what was a warning on the ground takes off), and the end.

Nothing here weakens the autopilot's own failsafes or the RC pilot: a decision is a command that the autopilot may
refuse, and the guard stands behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.model import FlightAction, Reason

__all__ = ["NOTHING_WRONG", "Decision", "Emergency", "Situation", "decide"]


@dataclass(frozen=True, slots=True)
class Situation:
    """What the decision rests on. `out_since`: when it left the last zone, None while a zone holds the aircraft.

    `now` and `out_since` are monotonic seconds.
    """

    flying: bool
    commander_lost: bool
    out_since: float | None
    now: float


@dataclass(frozen=True, slots=True)
class Decision:
    """What to do and why; `reason` is NONE when nothing is wrong."""

    action: FlightAction
    reason: Reason


NOTHING_WRONG = Decision(FlightAction.WARN, Reason.NONE)


def decide(situation: Situation, limits: Limits) -> Decision:
    """The strongest action that any trigger asks for; on the ground never more than a warning."""
    asked = []
    if situation.commander_lost:
        asked.append(Decision(limits.commander_lost, Reason.COMMANDER_LOST))
    if situation.out_since is not None and situation.now >= situation.out_since + limits.out_hold_s:
        asked.append(Decision(limits.out_of_coverage, Reason.OUT_OF_COVERAGE))
    if not asked:
        return NOTHING_WRONG
    decision = max(asked, key=lambda candidate: candidate.action)
    if not situation.flying:
        return Decision(FlightAction.WARN, decision.reason)
    return decision


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
