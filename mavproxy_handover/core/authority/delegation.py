# SPDX-License-Identifier: GPL-3.0-or-later

"""Delegation of guided targets to an onboard program: its conditions, and its end.

The commander delegates to one program at a time, while the aircraft flies in GUIDED by the commander's order. A
delegation moves no authority: it permits targets of one program, which are judged as the commander's are. It ends

* by any other command of the commander, except of the payload, and by the commander's own sticks and targets;
* by a change of authority: another commander, none, or another epoch;
* by a decision that does more than warn;
* when the aircraft leaves GUIDED;
* when no target has passed for `SILENT_S`. The first target may take `FIRST_S`;
* when the program's link is closed after a fault, or the commander takes it back.

A companion that starts again in flight does not know what was delegated before. If the aircraft flies GUIDED then, a
delegation counts as ended (`Delegation.restarted`): nothing would lead the aircraft, and no person would know.

It never begins again by itself. The caller orders a hold at the end (`Over.holds`), except where a command or a
decision has just taken the aircraft elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

__all__ = ["FIRST_S", "SILENT_S", "Delegation", "End", "GuidedFacts", "Over"]

SILENT_S: Final = 1.0
FIRST_S: Final = 5.0


class End(Enum):
    """Why a delegation ended, in words."""

    COMMAND = "the commander sent another command"
    AUTHORITY = "authority has moved"
    DECISION = "the companion has decided"
    MODE = "the aircraft has left GUIDED"
    SILENCE = "the program is silent"
    REVOKED = "the commander took it back"
    FAULT = "the link of the program was closed"
    RESTART = "the companion has restarted"


@dataclass(frozen=True, slots=True)
class GuidedFacts:
    """The facts that a delegation rests on, at one moment."""

    commander: int | None
    epoch: int
    flying: bool
    #: the autopilot flies GUIDED
    guided: bool
    #: the commander that ordered this GUIDED; None: the order was not seen
    ordered_by: int | None
    #: a decision holds, continues, returns or lands, or a transfer for safety is under way
    decided: bool = False


@dataclass(frozen=True, slots=True)
class Over:
    """The end of a delegation. `holds`: the aircraft has to be stopped."""

    program: str
    end: End
    holds: bool


@dataclass(frozen=True, slots=True)
class _Given:
    program: str
    commander: int
    epoch: int


#: after these the aircraft flies what a command, a decision or a pilot has chosen
_GOES_ELSEWHERE: Final = frozenset((End.DECISION, End.MODE))


class Delegation:
    """The delegation of one vehicle. Times are monotonic seconds."""

    def __init__(self) -> None:
        self._given: _Given | None = None
        #: when it was given, and when the last target passed; None: none yet
        self._given_at = -inf
        self._target_at: float | None = None

    @property
    def program(self) -> str:
        """The program that guided targets are delegated to; "" if there is none."""
        return "" if self._given is None else self._given.program

    def give(self, program: str, station: int, facts: GuidedFacts, now: float) -> str:
        """The operator at `station` delegates to `program`. Returns why not, in words; "" if it is done."""
        lacks = self._lacks(program, station, facts)
        if not lacks:
            self._given = _Given(program, station, facts.epoch)
            self._given_at, self._target_at = now, None
        return lacks

    def _lacks(self, program: str, station: int, facts: GuidedFacts) -> str:
        if facts.commander != station:
            return "only the commander delegates"
        if self._given is not None and self._given.program != program:
            return f"targets are delegated to {self._given.program}; take that back first"
        if not facts.flying:
            return "the aircraft does not fly"
        if facts.decided:
            return "the companion has decided what the aircraft does now"
        if not facts.guided:
            return "the aircraft does not fly GUIDED; order GUIDED first"
        return "" if facts.ordered_by == station else "this GUIDED was not ordered by the commander; order GUIDED again"

    def permits(self, program: str) -> bool:
        """Whether targets of this program may pass. The caller has called `tick` with the facts of now."""
        return self._given is not None and self._given.program == program

    def target_passed(self, program: str, now: float) -> None:
        """A target of the program went to the autopilot."""
        if self._given is not None and self._given.program == program:
            self._target_at = now

    def tick(self, facts: GuidedFacts, now: float) -> Over | None:
        """Time has passed, or a fact has changed. Returns the end of the delegation, if it ends."""
        given = self._given
        if given is None:
            return None
        if (facts.commander, facts.epoch) != (given.commander, given.epoch):
            return self._end(End.AUTHORITY)
        if facts.decided:
            return self._end(End.DECISION)
        if not facts.guided or not facts.flying or facts.ordered_by != given.commander:
            return self._end(End.MODE)
        last, most_s = (self._given_at, FIRST_S) if self._target_at is None else (self._target_at, SILENT_S)
        return self._end(End.SILENCE) if now - last > most_s else None

    def commanded(self, *, flies: bool) -> Over | None:
        """The commander sent another command. `flies`: it takes the aircraft elsewhere, so nothing is held."""
        return self._end(End.COMMAND, holds=not flies)

    def restarted(self, program: str, facts: GuidedFacts) -> Over | None:
        """The companion has started in flight, and `program` is one that may have led the aircraft before."""
        unled = self._given is None and facts.ordered_by is None
        if unled and facts.flying and facts.guided and not facts.decided:
            return Over(program, End.RESTART, holds=True)
        return None

    def revoke(self) -> Over | None:
        """The commander takes it back."""
        return self._end(End.REVOKED)

    def link_closed(self, program: str) -> Over | None:
        """The link of a program was closed after a fault."""
        return self._end(End.FAULT) if self.permits(program) else None

    def _end(self, end: End, *, holds: bool = True) -> Over | None:
        given, self._given = self._given, None
        if given is None:
            return None
        return Over(given.program, end, holds and end not in _GOES_ELSEWHERE)
