# SPDX-License-Identifier: GPL-3.0-or-later

"""Safety decisions: state in, decision and reason out. One pure, total function, tested as a table.

Nothing here weakens the autopilot's own failsafes or the RC pilot: a decision is a command that the autopilot may
refuse, and the guard stands behind it.
"""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.core.events import FlightAction
from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.model import Reason

__all__ = ["NOTHING_WRONG", "Decision", "Situation", "decide"]


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
