# SPDX-License-Identifier: GPL-3.0-or-later

"""What is done about what is wrong: one pure, total function over a table.

Theory of operation
-------------------
A cause asks for what its policy says (`POLICY_LADDERS`), and where that cannot be for the next graver thing that can:
who cannot hold returns, who can reach no place lands. Before that it looks for what lets the aircraft go on (`FIRST`):
authority that is on its way to a station, and a gap that the mission declares. So each ladder is a row of rungs, each
with the fact that it needs; the first whose fact holds is what the cause asks for, and the last needs nothing.

Of all that is asked for, the gravest is done (`FlightAction`), and of two causes that ask for the same the one that
stands first in `Cause` is named. In which order causes come plays no part.

Above the ladders stand four facts: on the ground, with a pilot who steers, with a failsafe of the autopilot that has
chosen what is flown, and while the autopilot is not heard, nothing is commanded: all but to wait is a warning. And
beside them two: what returns already is not stopped, and what lands already is not sent anywhere (MILDER_THAN).

What is decided is the same for every kind of aircraft; how it is done is not (`CARRIED_OUT`). What has wings cannot
stand still, so it circles, and for that it needs room: where it is to be held is seen by that (`lookout.py`).

`Strategy` remembers two things. What was decided: a return or a landing lasts as long as its cause, whatever milder
causes come and go, whatever milder that cause would ask for by now, and whoever keeps it from being commanded for a
time; who can return no more lands, and is not held again. And what the commander has overruled: of all that is wrong
when he has it fly otherwise than ordered, he knows. So each of these causes is a warning from then on, until it is over
or asks for something graver; what comes later, or is another, counts as if nothing else were wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import Final

from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.model import FlightAction, Kind

__all__ = [
    "CARRIED_OUT",
    "FIRST",
    "MILDER_THAN",
    "OVERRULE",
    "OVERRULED",
    "POLICY_LADDERS",
    "Decision",
    "Fact",
    "Rung",
    "Situation",
    "Strategy",
    "decide",
    "ladder",
    "withheld",
]


class Fact(Enum):
    """What may hold, besides what is wrong."""

    FLYING = "flying"
    PILOT = "a pilot steers"
    FAILSAFE = "a failsafe of the autopilot acts"
    RETURNING = "on the way to the place of a return"
    LANDING = "landing"
    AUTOPILOT = "the autopilot is heard"
    #: a transfer that would mend it is under way, and has time left
    SUCCESSOR = "a station is about to take the aircraft"
    #: inside the commander's zone, with hold time and energy left, and a position to stand still by
    MAY_HOLD = "it can stand still here"
    #: within the limit of a gap that the mission declares
    GAP = "the mission declares this gap"
    #: a place can be reached with the energy left
    PLACE = "a place can be reached"


#: The facts of one moment.
Situation = Set[Fact]


@dataclass(frozen=True, slots=True)
class Rung:
    """One thing that a cause may ask for, if `needs` holds."""

    action: FlightAction
    needs: Fact | None = None


_TRANSFER, _CONTINUE = Rung(FlightAction.TRANSFER, Fact.SUCCESSOR), Rung(FlightAction.CONTINUE, Fact.GAP)
_HOLD, _RETURN = Rung(FlightAction.HOLD, Fact.MAY_HOLD), Rung(FlightAction.RETURN, Fact.PLACE)
_LAND, _WARN = Rung(FlightAction.LAND), Rung(FlightAction.WARN)

#: What a cause looks for before its policy counts.
FIRST: Final[Mapping[Cause, tuple[Rung, ...]]] = {
    Cause.COMMANDER_LOST: (_TRANSFER, _CONTINUE),
    Cause.NO_STATION: (_TRANSFER, _CONTINUE),
    Cause.OUT_OF_COVERAGE: (_CONTINUE,),
    Cause.COVERAGE_ENDS: (_CONTINUE,),
}

POLICY_LADDERS: Final[Mapping[str, tuple[Rung, ...]]] = {
    "warn": (_WARN,),
    "hold": (_HOLD, _RETURN, _LAND),
    "return": (_RETURN, _LAND),
    "land": (_LAND,),
}

#: What comes to nothing more than a warning, whatever is asked for; and what does if it is milder than this.
OVERRULE: Final = (Fact.PILOT, Fact.FAILSAFE)
#: What lets the aircraft go on: it is worth to wait for.
_GOES_ON: Final = (FlightAction.TRANSFER, FlightAction.CONTINUE)
#: What the commander can overrule: all that brings the aircraft elsewhere than it flies.
OVERRULED: Final = (FlightAction.HOLD, FlightAction.RETURN, FlightAction.LAND)
MILDER_THAN: Final[Mapping[Fact, FlightAction]] = {Fact.LANDING: FlightAction.LAND, Fact.RETURNING: FlightAction.RETURN}


#: How each is done by an aircraft of that kind, for people; the autopilot's words of it are the edge's.
CARRIED_OUT: Final[Mapping[FlightAction, Mapping[Kind, str]]] = {
    FlightAction.HOLD: {
        Kind.COPTER: "stops, its mission paused",
        Kind.PLANE: "circles, in LOITER",
        Kind.QUADPLANE: "circles, in LOITER",
    },
    FlightAction.CONTINUE: {
        Kind.COPTER: "flies on, its mission resumed",
        Kind.PLANE: "flies on, in AUTO",
        Kind.QUADPLANE: "flies on, in AUTO",
    },
    FlightAction.RETURN: {
        Kind.COPTER: "RTL to the chosen place, and down",
        Kind.PLANE: "RTL to the chosen place, and down by the landing sequence there",
        Kind.QUADPLANE: "RTL to the chosen place, and down by its rotors",
    },
    FlightAction.LAND: {
        Kind.COPTER: "LAND, where it is",
        Kind.PLANE: "the next landing sequence: it cannot come down where it is",
        Kind.QUADPLANE: "QLAND, where it is",
    },
}


@dataclass(frozen=True, slots=True)
class Decision:
    """What is done, and why. `withheld`: the fact for which no more than a warning is done; `held_back`: the same, of
    this cause or of another that is wrong beside it."""

    action: FlightAction
    cause: Cause
    withheld: Fact | None = field(default=None, compare=False)
    held_back: Fact | None = field(default=None, compare=False)


def ladder(cause: Cause, policy: str) -> tuple[Rung, ...]:
    """All that a cause may ask for under a policy other than "off", in order; the last needs nothing."""
    return (*FIRST.get(cause, ()), *POLICY_LADDERS[policy])


def _asked(cause: Cause, policy: str, facts: Situation) -> FlightAction:
    """What a cause asks for by itself."""
    return next(rung.action for rung in ladder(cause, policy) if rung.needs is None or rung.needs in facts)


def withheld(action: FlightAction, facts: Situation) -> Fact | None:
    """For which fact it cannot be, or need not be, done now; None if it is."""
    if action in (FlightAction.WARN, FlightAction.TRANSFER):  # nothing is done to the aircraft
        return None
    for fact in (Fact.FLYING, Fact.AUTOPILOT):
        if fact not in facts:
            return fact
    for fact in OVERRULE:
        if fact in facts:
            return fact
    return next((fact for fact, least in MILDER_THAN.items() if fact in facts and action < least), None)


def decide(
    causes: Set[Cause],
    facts: Situation,
    policies: Mapping[Cause, str],
    overruled: Mapping[Cause, FlightAction] = MappingProxyType({}),
) -> Decision | None:
    """What is done about these causes; None if there are none. `policies`: as configured, for every cause. `overruled`:
    the gravest that the commander will not have of a cause."""
    order = list(Cause)
    best: Decision | None = None
    held_back: Fact | None = None
    for cause in sorted(causes, key=order.index):
        action = _asked(cause, policies[cause], facts)
        if action in OVERRULED and action <= overruled.get(cause, FlightAction.WARN):
            action = FlightAction.WARN
        fact = withheld(action, facts)
        if fact is not None:
            action, held_back = FlightAction.WARN, held_back or fact
        if best is None or action > best.action:
            best = Decision(action, cause, fact)
    return best if best is None else replace(best, held_back=best.withheld or held_back)


class Strategy:
    """The decision in force. Not safe for threads."""

    __slots__ = ("_lasts", "decision", "overruled", "policies")

    def __init__(self, policies: Mapping[Cause, str]) -> None:
        """`policies`: those that differ from the table's."""
        self.policies = {cause: policies.get(cause, row.policies[0]) for cause, row in CAUSES.items()}
        self.decision: Decision | None = None
        #: the return or the landing that was decided last, while its cause goes on
        self._lasts: Decision | None = None
        #: causes that the commander has overruled, each with what it asked for
        self.overruled: frozenset[tuple[Cause, FlightAction]] = frozenset()

    def adopt(self, cause: Cause, policy: str) -> None:
        """The mission brings its own policy for a cause."""
        self.policies[cause] = policy

    def overrule(self, causes: Set[Cause], facts: Situation) -> None:
        """The commander has the aircraft fly otherwise than ordered, with these causes and facts.

        What asked for a hold comes to nothing graver by itself: that it can hold no more is no reason to turn back.
        """
        asked = ((cause, _asked(cause, self.policies[cause], facts)) for cause in causes)
        gravest = {FlightAction.HOLD: FlightAction.LAND}
        self.overruled = frozenset((cause, gravest.get(action, action)) for cause, action in asked)
        self.decision = self._lasts = None

    def judge(self, causes: Set[Cause], facts: Situation) -> Decision | None:
        """The causes and facts of this moment; returns the decision in force.

        A graver one than they ask for stays while its cause does, unless it cannot be any more.
        """
        if self.overruled:
            self.overruled = frozenset(row for row in self.overruled if row[0] in causes)
        found, lasts = decide(causes, facts, self.policies, dict(self.overruled)), self._lasts
        if found is not None and lasts is not None and lasts.cause in causes and found.action < lasts.action:
            if withheld(lasts.action, facts) is None:
                goes = lasts.action is FlightAction.LAND or Fact.PLACE in facts or found.action in _GOES_ON
                self._lasts = found = lasts if goes else Decision(FlightAction.LAND, lasts.cause)
        else:
            self._lasts = found if found is not None and found.action >= FlightAction.RETURN else None
        self.decision = found
        return found

    def landed(self) -> None:
        """The flight is over."""
        self.decision = self._lasts = None
        self.overruled = frozenset()
