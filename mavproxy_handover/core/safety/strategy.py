# SPDX-License-Identifier: GPL-3.0-or-later

"""Decision about the causes: one pure, total function over a table.

Theory of operation
-------------------
A cause asks for the action of its policy (`POLICY_LADDERS`). If that is not possible, it asks for the next graver
action that is: an aircraft that cannot hold returns, and one that can reach no return site lands. First it looks for a
reason to go on (`FIRST`): a station that is about to get authority, or a gap that the mission declares. So each ladder
is a row of rungs, each with the fact that it needs. The cause asks for the first rung whose fact holds. The last rung
needs nothing.

The gravest action of all causes is done (`FlightAction`). Of two causes that ask for the same action the first in
`Cause` is named. The order in which causes begin plays no part.

Four facts overrule the ladders: on the ground, with a pilot who steers, with a failsafe of the autopilot that acts, and
while the autopilot is not heard. Then nothing is commanded, and every action except to wait becomes a warning. Two more
facts limit them: an aircraft that returns is not stopped, and one that lands is not sent anywhere (MILDER_THAN).

The decision is the same for every kind of aircraft. The way it is carried out is in the profile (`vehicle/profiles/`).
An aircraft that cannot stand still circles, and needs room for it. `authority/coverage.py` counts with that room.

`Strategy` remembers two things:

* The return or landing that was decided. It lasts as long as its cause. Milder causes that begin or end do not change
  it. It also stays if the cause asks for a milder action by now, or if another source prevents the order. An
  aircraft that cannot return any more lands, and is not held again.
* The causes that the commander has overruled by another order. Each of them is a warning from then on, until it is over
  or asks for a graver action. A later cause, or another one, counts as if there were no other.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import Final

from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.model import FlightAction

__all__ = [
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
    """Facts that a decision rests on, besides its causes."""

    FLYING = "flying"
    PILOT = "a pilot steers"
    FAILSAFE = "a failsafe of the autopilot acts"
    RETURNING = "on the way to the return site"
    LANDING = "landing"
    AUTOPILOT = "the autopilot is heard"
    #: a transfer that would end the cause is under way, and has time left
    SUCCESSOR = "a station is about to take the aircraft"
    #: inside the commander's zone, with hold time left, and a position that is good enough to hold at
    MAY_HOLD = "it can stand still here"
    #: within the limit of a gap that the mission declares
    GAP = "the mission declares this gap"
    #: a place can be reached with the energy left
    PLACE = "a place can be reached"


#: of two causes that ask for the same action the first is named
_ORDER: Final = tuple(Cause)

#: The facts of one moment.
Situation = Set[Fact]


@dataclass(frozen=True, slots=True)
class Rung:
    """One action that a cause may ask for, if `needs` holds."""

    action: FlightAction
    needs: Fact | None = None


_TRANSFER, _CONTINUE = Rung(FlightAction.TRANSFER, Fact.SUCCESSOR), Rung(FlightAction.CONTINUE, Fact.GAP)
_HOLD, _RETURN = Rung(FlightAction.HOLD, Fact.MAY_HOLD), Rung(FlightAction.RETURN, Fact.PLACE)
_LAND, _WARN = Rung(FlightAction.LAND), Rung(FlightAction.WARN)

#: Rungs of a cause before those of its policy.
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

#: Facts that turn every order into a warning; MILDER_THAN has those that do so with milder orders.
OVERRULE: Final = (Fact.PILOT, Fact.FAILSAFE)
#: Actions that let the aircraft go on: worth waiting for.
_GOES_ON: Final = (FlightAction.TRANSFER, FlightAction.CONTINUE)
#: Actions that the commander can overrule: those that change the flight.
OVERRULED: Final = (FlightAction.HOLD, FlightAction.RETURN, FlightAction.LAND)
MILDER_THAN: Final[Mapping[Fact, FlightAction]] = {Fact.LANDING: FlightAction.LAND, Fact.RETURNING: FlightAction.RETURN}


@dataclass(frozen=True, slots=True)
class Decision:
    """Action and cause. `withheld`: the fact that turned the order into a warning, None without one.

    `held_back`: such a fact of this cause, or of another present one.
    """

    action: FlightAction
    cause: Cause
    withheld: Fact | None = field(default=None, compare=False)
    held_back: Fact | None = field(default=None, compare=False)


def ladder(cause: Cause, policy: str) -> tuple[Rung, ...]:
    """The rungs of a cause under a policy other than "off", in order; the last needs nothing."""
    return (*FIRST.get(cause, ()), *POLICY_LADDERS[policy])


def _asked(cause: Cause, policy: str, facts: Situation) -> FlightAction:
    """The action that a cause asks for by itself."""
    return next(rung.action for rung in ladder(cause, policy) if rung.needs is None or rung.needs in facts)


def withheld(action: FlightAction, facts: Situation) -> Fact | None:
    """The fact for which the action cannot, or need not, be done now; None: it is done."""
    if action in (FlightAction.WARN, FlightAction.TRANSFER):  # these command nothing
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
    """The decision about these causes; None without causes.

    `policies`: as configured, for every cause. `overruled`: the gravest action of a cause that the commander has
    overruled.
    """
    best: Decision | None = None
    held_back: Fact | None = None
    for cause in sorted(causes, key=_ORDER.index):
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
        """`policies`: those that differ from the table."""
        self.policies = {cause: policies.get(cause, row.policies[0]) for cause, row in CAUSES.items()}
        self.decision: Decision | None = None
        #: the return or the landing that was decided last, while its cause goes on
        self._lasts: Decision | None = None
        #: causes that the commander has overruled, each with the action that it asked for
        self.overruled: frozenset[tuple[Cause, FlightAction]] = frozenset()

    def set_policy(self, cause: Cause, policy: str) -> None:
        """The mission brings its own policy for a cause."""
        self.policies[cause] = policy

    def overrule(self, causes: Set[Cause], facts: Situation) -> None:
        """The commander overrules the order, with these causes and facts.

        A cause that asked for a hold gives no graver order by itself: the end of the hold time is no reason to return.
        """
        asked = ((cause, _asked(cause, self.policies[cause], facts)) for cause in causes)
        gravest = {FlightAction.HOLD: FlightAction.LAND}
        self.overruled = frozenset((cause, gravest.get(action, action)) for cause, action in asked)
        self.decision = self._lasts = None

    def judge(self, causes: Set[Cause], facts: Situation) -> Decision | None:
        """Take the causes and facts of this moment; returns the decision in force.

        A return or a landing stays while its cause lasts, unless it is not possible any more.
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
