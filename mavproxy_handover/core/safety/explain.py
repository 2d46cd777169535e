# SPDX-License-Identifier: GPL-3.0-or-later

"""The strategy in words: its table, and its decision in a given state, with every cause and every rung.

It is made from the data that decides (`common/causes.py`, `strategy.py`), so it cannot differ from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.core.common.causes import CAUSES, Cause, Ends
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.core.safety.strategy import (
    MILDER_THAN,
    OVERRULE,
    POLICY_LADDERS,
    Decision,
    Fact,
    Rung,
    Situation,
    Strategy,
    decide,
    ladder,
    withheld,
)

__all__ = ["HEAD", "Considered", "assumed", "carried_out_table", "consider", "facts_table", "story", "table"]

Row = tuple[str, ...]
#: facts that hold in the air unless something else is said,
_ALOFT: Final = frozenset({Fact.FLYING, Fact.AUTOPILOT, Fact.MAY_HOLD, Fact.PLACE})
#: and those of them that do not hold with a cause: the aircraft is held only inside its commander's zone, and by a
#: position. Two cases differ: a hold that goes on after a restart, and a cause whose condition is away but is not over
_NOT_WHILE: Final[Mapping[Cause, Fact]] = {
    Cause.COMMANDER_LOST: Fact.MAY_HOLD,
    Cause.OUT_OF_COVERAGE: Fact.MAY_HOLD,
    Cause.NO_STATION: Fact.MAY_HOLD,
    Cause.POSITION_STALE: Fact.MAY_HOLD,
    Cause.AUTOPILOT_LOST: Fact.AUTOPILOT,
}
#: the columns of `table`
HEAD: Final[Row] = ("cause", "what is wrong", "counts after", "ends", "policy", "what is done: the first that can be")


def _rung(rung: Rung) -> str:
    word = rung.action.name.lower()
    return word if rung.needs is None else f"{word} if {rung.needs.value}"


def _seconds(value: float) -> str:
    return "at once" if value == 0.0 else f"{value:g} s"


def table(limits: Limits) -> list[Row]:
    """A row for each cause, as configured; the policies that are not in force stand in brackets at the end."""
    rows: list[Row] = []
    policies = Strategy(limits.policies).policies
    for cause, row in CAUSES.items():
        policy = policies[cause]
        clear_s = limits.clear_s.get(cause, row.clear_s)
        ends = row.ends.value
        if row.ends is Ends.WITH_ITS_SIGN and clear_s > 0.0:
            ends = f"gone for {clear_s:g} s"
        others = [word for word in row.policies if word != policy]
        done = "nothing" if policy == "off" else "; else ".join(_rung(rung) for rung in ladder(cause, policy))
        after = _seconds(limits.hold_off_s.get(cause, row.hold_off_s))
        rows.append((cause.value, row.words, after, ends, f"{policy} ({', '.join(others)})", done))
    return rows


def facts_table() -> list[Row]:
    """What may hold besides what is wrong, and what it does to a decision."""
    rows: list[Row] = []
    for fact in Fact:
        needed = sorted({rung.action for steps in _ALL for rung in steps if rung.needs is fact})
        if fact in OVERRULE:
            does = "nothing is commanded"
        elif fact in (Fact.FLYING, Fact.AUTOPILOT):
            does = "without it nothing is commanded"
        elif fact in MILDER_THAN:
            does = f"what is milder than {MILDER_THAN[fact].name.lower()} is not commanded"
        else:
            does = f"{', '.join(action.name.lower() for action in needed)} can be"
        rows.append((fact.name.lower(), fact.value, does))
    return rows


def carried_out_table(profiles: Mapping[str, Mapping[FlightAction, str]]) -> list[Row]:
    """How each kind of aircraft does what is decided: what the columns are, and a row for each action. `profiles`: the
    words of each kind of aircraft, by its name."""
    actions = dict.fromkeys(action for words in profiles.values() for action in words)
    rows: list[Row] = [("action", *profiles)]
    return rows + [(action.name.lower(), *(words[action] for words in profiles.values())) for action in actions]


_ALL: Final = [*(ladder(cause, "warn") for cause in Cause), *POLICY_LADDERS.values()]


def assumed(causes: Set[Cause]) -> frozenset[Fact]:
    """What holds in the air beside these causes when nothing else is said."""
    return _ALOFT - {_NOT_WHILE[cause] for cause in causes & _NOT_WHILE.keys()}


@dataclass(frozen=True, slots=True)
class Considered:
    """The request of a cause.

    `passed`: rungs that are not possible; `asked`: the one that is; `withheld`: the fact that turns it into a warning.
    """

    cause: Cause
    policy: str
    passed: tuple[Rung, ...]
    asked: Rung
    withheld: Fact | None


def consider(causes: Set[Cause], facts: Situation, policies: Mapping[Cause, str]) -> list[Considered]:
    """Each cause by itself, in the order of `Cause`."""
    found = []
    for cause in Cause:
        if cause not in causes or policies[cause] == "off":
            continue
        rungs = ladder(cause, policies[cause])
        asked = next(rung for rung in rungs if rung.needs is None or rung.needs in facts)
        passed = rungs[: rungs.index(asked)]
        found.append(Considered(cause, policies[cause], passed, asked, withheld(asked.action, facts)))
    return found


def story(causes: Set[Cause], facts: Situation, limits: Limits) -> list[str]:
    """What would be decided in this state, and why, line by line."""
    policies = Strategy(limits.policies).policies
    lines = [f"{cause.value}: off, not looked at" for cause in Cause if cause in causes and policies[cause] == "off"]
    for each in consider(causes, facts, policies):
        lines.append(f"{each.cause.value} ({CAUSES[each.cause].words}), policy {each.policy}:")
        lines += [f"  no {rung.action.name.lower()}: not so that {_needs(rung)}" for rung in each.passed]
        because = "" if each.asked.needs is None else f": {_needs(each.asked)}"
        lines.append(f"  asks for {each.asked.action.name.lower()}{because}")
        if each.withheld is not None:
            lines.append(f"  not commanded, a warning: {_why_not(each.withheld)}")
    decision = decide({cause for cause in causes if policies[cause] != "off"}, facts, policies)
    lines.append(_conclusion(decision))
    return lines


def _needs(rung: Rung) -> str:
    return "" if rung.needs is None else rung.needs.value


def _why_not(fact: Fact) -> str:
    return f"not so that it is {fact.value}" if fact is Fact.FLYING else _WHY.get(fact, f"it is {fact.value}")


_WHY: Final = {
    Fact.AUTOPILOT: "the autopilot is not heard",
    Fact.PILOT: Fact.PILOT.value,
    Fact.FAILSAFE: Fact.FAILSAFE.value,
}


def _conclusion(decision: Decision | None) -> str:
    if decision is None:
        return "decision: none, nothing is wrong"
    return f"decision: {decision.action.name}, for {decision.cause.value}"
