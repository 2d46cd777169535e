# SPDX-License-Identifier: GPL-3.0-or-later

"""Each safety decision as one sentence: action, place, what is wrong with its figures, and the place's.

"RETURN to rally 2. GCSB silent for 5 s. 1.9 km away, needs 21 % of the battery (38 % left), covered by GCSA all the
way"

The figures of a cause come from the part that knows them: the monitors for energy, route and fence (`ConditionsSeen`),
authority for the commander, links and coverage (`AuthorityFacts.words`), this module for the aircraft (`Figures`). The
words of the place come with it (`PlaceJudged`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf
from typing import Final

from mavproxy_handover.core.common.authority_facts import AuthorityFacts
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.events import Announce, ConditionsSeen, PlaceJudged
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.model import FlightAction, GuardState, Reason
from mavproxy_handover.core.safety.strategy import Decision, Fact

__all__ = ["Figures", "over", "sentence"]

#: reasons why nothing is commanded, for people
_WITHHELD: Final[Mapping[Fact, str]] = {
    Fact.FLYING: "The aircraft is on the ground",
    Fact.AUTOPILOT: "The autopilot is not heard",
    Fact.PILOT: "A pilot has the aircraft",
    Fact.FAILSAFE: "A failsafe of the autopilot acts",
    Fact.RETURNING: "The aircraft returns already",
    Fact.LANDING: "The aircraft lands already",
}

#: what an action is called, where its name is not a word for people
_ACTIONS: Final[Mapping[FlightAction, str]] = {FlightAction.WARN: "WARNING"}


def sentence(decision: Decision, figures: str, place: PlaceJudged | None) -> Announce:
    """The decision in force, for every station. `figures`: the cause with numbers; `place`: the return site."""
    word, reason = _ACTIONS.get(decision.action, decision.action.name), CAUSES[decision.cause].reason
    why = figures[:1].upper() + figures[1:]
    if decision.action is FlightAction.RETURN and place is not None:
        words = f". {place.words}" if place.words else ""
        return Announce(f"{word} to {place.name}. {why}{words}", decision.action, reason, figures, place.name)
    more = "" if decision.withheld is None else f". {_WITHHELD[decision.withheld]}"
    return Announce(f"{word}. {why}{more}", decision.action, reason, figures)


def over(before: Decision | None) -> Announce:
    """The end of all causes; `before`: the last decision, None if the run before made it."""
    if before is None:
        return Announce("ALL CLEAR. Over: the emergency before the restart", None, Reason.NONE)
    return Announce(f"ALL CLEAR. Over: {CAUSES[before.cause].words}", None, CAUSES[before.cause].reason)


class Figures:
    """Causes in words with numbers, from what the rules know. Times are monotonic seconds."""

    __slots__ = ("_authority", "_flight")

    def __init__(self, authority: AuthorityFacts, flight: Flight) -> None:
        self._authority = authority
        self._flight = flight

    def of(self, cause: Cause, reported: ConditionsSeen, now: float) -> str:
        """The cause with its figures; its name where there are none. `reported`: what the monitors report."""
        words = _WORDS.get(cause)
        found = self._authority.words(cause, now) if words is None else words(self, reported, now)
        return found or CAUSES[cause].words

    def _guard(self, _reported: ConditionsSeen, now: float) -> str:
        if self._flight.guard(now) is GuardState.DISABLED:
            return "guard switched off"
        return _silent("guard", self._flight.guard_silent_s(now))

    def _position(self, _reported: ConditionsSeen, now: float) -> str:
        silent_s = self._flight.position_silent_s(now)
        return f"no fresh position for {silent_s:.0f} s" if silent_s < inf else ""

    def _autopilot(self, _reported: ConditionsSeen, now: float) -> str:
        return _silent("autopilot", self._flight.autopilot_silent_s(now))


def _silent(who: str, silent_s: float) -> str:
    return f"{who} silent for {silent_s:.0f} s" if silent_s < inf else ""


#: causes of the aircraft; those of authority, links and coverage have their words in `authority/coverage.py`
_WORDS: Final[Mapping[Cause, Callable[[Figures, ConditionsSeen, float], str]]] = {
    Cause.ENERGY: lambda _figures, reported, _now: reported.energy_words,
    Cause.GUARD_LOST: Figures._guard,
    Cause.FENCE: lambda _figures, reported, _now: reported.fence_words,
    Cause.OFF_ROUTE: lambda _figures, reported, _now: reported.off_route_words,
    Cause.POSITION_STALE: Figures._position,
    Cause.AUTOPILOT_LOST: Figures._autopilot,
}
