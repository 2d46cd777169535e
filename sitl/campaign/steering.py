# SPDX-License-Identifier: GPL-3.0-or-later

"""Chooses faults and their times.

Each flight aims at two causes at once in one phase, all such cells in turn.

A cell is met when both causes are there at the same moment in that phase. That is counted from the rules' reports
(`outcome.py`), because it is not a verdict but a measure of how much was tried. If both would at once lead to another
phase, milder policies are drawn, so that both can be there; the judge knows them.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from itertools import combinations, product
from random import Random
from typing import Final

from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.model import Phase
from sitl.campaign.faults import Fault, Target, TimedFault
from sitl.campaign.times import NEVER, SECOND

__all__ = [
    "CELLS",
    "NEVER_IN",
    "NEVER_MEET",
    "PHASES",
    "Cell",
    "never",
    "downlink_faults",
    "policies_for",
    "faults_for",
]


#: a phase that begins and how often it has, or that the aircraft is about to leave its commander's zone
_When = tuple[Phase | None, int, bool]


@dataclass(frozen=True, slots=True)
class Cell:
    """Two causes and a phase."""

    first: Cause
    second: Cause
    phase: Phase

    @classmethod
    def of(cls, seed: int) -> Cell:
        """The target of this seed's flight."""
        return CELLS[seed % len(CELLS)]

    @property
    def at_a_border(self) -> bool:
        """One of them comes up at a border."""
        return bool({self.first, self.second} & _AT_A_BORDER)

    @property
    def name(self) -> str:
        """The name in an outcome."""
        return f"{'+'.join(sorted((self.first.value, self.second.value)))}@{self.phase.name.lower()}"

    @property
    def words(self) -> str:
        """For people."""
        return f"{self.first.value} with {self.second.value} in {self.phase.name.lower()}"


#: on the ground no more is looked at than the commander and coverage
PHASES: Final = (Phase.ON_MISSION, Phase.ON_HANDOVER, Phase.EMERGENCY)
#: pairs that the rules do not let meet, and why
NEVER_MEET: Final[Mapping[frozenset[Cause], str]] = {
    frozenset({Cause.COMMANDER_LOST, Cause.COVERAGE_ENDS}): "without a commander no end of coverage is looked for",
    frozenset({Cause.OUT_OF_COVERAGE, Cause.NO_STATION}): (
        "outside every zone, and inside one; there at once only for a moment, by a border crossed to and fro in seconds"
    ),
}
#: causes that do not come up in a phase, and why
NEVER_IN: Final[Mapping[tuple[Cause, Phase], str]] = {
    (Cause.OUT_OF_COVERAGE, Phase.ON_HANDOVER): "a transfer ends where its partner's zone does",
}


def never(first: Cause, second: Cause, phase: Phase) -> str | None:
    """Why the rules do not let these two be there at once in that phase; None: they do."""
    reasons = (NEVER_MEET.get(frozenset({first, second})), NEVER_IN.get((first, phase)), NEVER_IN.get((second, phase)))
    return next((reason for reason in reasons if reason is not None), None)


#: how a cause is brought about: fault, its target, how long it lasts (s)
_PROVOKES: Final[Mapping[Cause, tuple[tuple[Fault, Target, float, float], ...]]] = {
    Cause.ENERGY: ((Fault.SAG, Target.NOBODY, 0.85, 0.99),),
    Cause.COMMANDER_LOST: (
        (Fault.DEAD, Target.COMMANDER, 12.0, 90.0),
        (Fault.MUTE, Target.COMMANDER, 12.0, 60.0),
        (Fault.BURST, Target.COMMANDER, 12.0, 30.0),
    ),
    Cause.OUT_OF_COVERAGE: ((Fault.BREACH, Target.NOBODY, 40.0, 90.0),),
    Cause.NO_STATION: ((Fault.DEAD, Target.NEXT, 600.0, 1200.0), (Fault.DEAF, Target.NEXT, 600.0, 1200.0)),
    Cause.COVERAGE_ENDS: ((Fault.DEAD, Target.NEXT, 600.0, 1200.0), (Fault.DEAF, Target.NEXT, 600.0, 1200.0)),
    Cause.AUTHENTICATION: ((Fault.ATTACK, Target.COMMANDER, 15.0, 60.0),),
    Cause.LINKS_WEAK: (  # of all: else it is a reason to move to a better station
        (Fault.WEAK, Target.ALL, 30.0, 90.0),
        (Fault.WEAK, Target.ALL, 30.0, 90.0),
        (Fault.WEAK, Target.COMMANDER, 30.0, 90.0),
    ),
    Cause.GUARD_LOST: ((Fault.NO_GUARD, Target.NOBODY, 15.0, 90.0),),
    Cause.FENCE: (
        *(5 * ((Fault.LIFT, Target.NOBODY, 12.0, 40.0),)),
        (Fault.BREACH, Target.NOBODY, 20.0, 60.0),
    ),
    Cause.OFF_ROUTE: ((Fault.DRIFT, Target.NOBODY, 15.0, 35.0),),
    Cause.POSITION_STALE: ((Fault.NO_FIX, Target.NOBODY, 7.0, 22.0),),
    Cause.AUTOPILOT_LOST: ((Fault.BLIND, Target.NOBODY, 6.0, 20.0),),
}
#: a cause that no fault brings about is not tried
CELLS: Final = tuple(
    Cell(*pair, phase)
    for phase, pair in product(PHASES, combinations((cause for cause in Cause if cause in _PROVOKES), 2))
    if never(*pair, phase) is None
)
#: the same where that would not do: of a commander that is lost alone, another station takes the aircraft at once
_NOBODY_ELSE: Final = (
    (Fault.DEAD, Target.ALL, 12.0, 90.0),
    (Fault.MUTE, Target.ALL, 12.0, 60.0),
    (Fault.BURST, Target.ALL, 12.0, 30.0),
)
#: a partner that dies ends the transfer before it counts as lost; of one that hears nothing it goes on
_IN_SILENCE: Final = ((Fault.DEAF, Target.NEXT, 30.0, 90.0),)
_BY_HEIGHT: Final = ((Fault.LIFT, Target.NOBODY, 12.0, 40.0),)
#: over the ceiling and then carried off; while the updraft lasts nothing else carries the aircraft
_BRIEFLY_UP: Final = ((Fault.LIFT, Target.NOBODY, 6.5, 8.5),)
#: causes by an aircraft that is carried off: by one wind at a time
_CARRIED: Final = frozenset({Cause.FENCE, Cause.OFF_ROUTE})
#: how long (s) a fault strikes before its cause is there
_TAKES_S: Final[Mapping[Cause, float]] = {
    Cause.ENERGY: 3.0,
    Cause.COMMANDER_LOST: 6.0,
    Cause.LINKS_WEAK: 13.0,
    Cause.GUARD_LOST: 5.5,
    Cause.OFF_ROUTE: 9.0,
    Cause.FENCE: 5.0,
    Cause.POSITION_STALE: 3.5,
    Cause.AUTOPILOT_LOST: 3.5,
    Cause.AUTHENTICATION: 0.5,
}
#: causes that are there when the aircraft comes to a border, whenever their fault has struck
_AT_A_BORDER: Final = frozenset({Cause.NO_STATION, Cause.COVERAGE_ENDS, Cause.OUT_OF_COVERAGE})
#: those of them that are there behind the border
_BEHIND_IT: Final = frozenset({Cause.NO_STATION, Cause.OUT_OF_COVERAGE})
#: these faults at a border strike only after something was seen or flown: how long (s) after the moment when the
#: aircraft is about to leave the zone. An updraft keeps it where it is, and without a position nothing more is seen
_NOT_BEFORE_S: Final[Mapping[Fault, float]] = {Fault.LIFT: 11.2, Fault.NO_FIX: 11.5, Fault.BLIND: 11.5}
#: causes that are not looked at any more once the commander is lost
_BEFORE_A_LOSS: Final = frozenset({Cause.NO_STATION, Cause.AUTHENTICATION, Cause.LINKS_WEAK})
#: causes that come up, and stay, only while the mission is flown
_UNDER_WAY: Final = frozenset({Cause.NO_STATION, Cause.COVERAGE_ENDS, Cause.FENCE, Cause.OFF_ROUTE})
#: what is never but warned of by a vehicle that is to come home by itself
_GRAVE: Final = frozenset({Cause.COMMANDER_LOST, Cause.OUT_OF_COVERAGE, Cause.ENERGY, Cause.NO_STATION})
#: causes after which the rules hear no more of where the aircraft is
_NO_NEWS: Final = frozenset({Cause.POSITION_STALE, Cause.AUTOPILOT_LOST})
#: causes are to meet this time (s) after take-off, or after the flight is ripe
_EARLY_S, _SOON_S = (30.0, 600.0), (30.0, 130.0)
#: and this time (s) the next station on the route dies before it is needed: early, late
_NEXT_S: Final = ((5.0, 200.0), (0.0, 30.0))
#: what may come on top, in any flight
_ANYTHING: Final = (
    (Fault.ROGUE, Target.NOBODY, 5.0, 60.0),
    (Fault.KILLED, Target.NOBODY, 0.5, 4.0),
    (Fault.STALLED, Target.NOBODY, 1.0, 5.0),
    (Fault.GONE, Target.NOBODY, 1.0, 1.0),
    (Fault.BURST, Target.ALL, 2.0, 9.0),
    (Fault.DEAF, Target.COMMANDER, 8.0, 200.0),
    (Fault.DEAD, Target.ALL, 20.0, 200.0),
)
#: how a companion dies that is there again in a moment
_DIES: Final = ((Fault.KILLED, Target.NOBODY, 0.5, 4.0), (Fault.STALLED, Target.NOBODY, 1.0, 5.0))
#: what is nothing by itself, and much where something has to be done: a pilot, an autopilot that does not follow
_IN_THE_WAY: Final = (
    (Fault.PILOT, Target.NOBODY, 5.0, 60.0),
    (Fault.DISOBEYS, Target.NOBODY, 15.0, 60.0),
    (Fault.STUCK, Target.NOBODY, 40.0, 120.0),
)
#: causes with which the companion, before any other part, can still land an aircraft without energy to return
_LEAVES_HANDS: Final = frozenset(
    {
        Cause.COMMANDER_LOST,
        Cause.OUT_OF_COVERAGE,
        Cause.NO_STATION,
        Cause.COVERAGE_ENDS,
        Cause.AUTHENTICATION,
        Cause.LINKS_WEAK,
        Cause.GUARD_LOST,
        Cause.OFF_ROUTE,
    }
)
#: what part of the way home is left in the battery where no place can be reached any more: from, to
_TOO_LITTLE: Final = (0.1, 0.75)


#: parts of the downlink that are lost by chance; how long it is heard and not heard (s), and what an attack did once
_THIN: Final = (0.2, 0.4, 0.6, 0.8, 0.95, 0.97, 0.99)
_HEARS_S, _HEARS_NOT_S, _ATTACK_S = (0.2, 30.0), (1.0, 40.0), (0.3, 4.7)


def _timed_fault(
    chance: Random,
    how: tuple[Fault, Target, float, float],
    after_s: float,
    when: _When = (None, 1, False),
    *,
    late: bool = False,
) -> TimedFault:
    fault, target, shortest, longest = how
    lasts = NEVER if fault in (Fault.SAG, Fault.GONE) else int(chance.uniform(shortest, longest) * SECOND)
    amount = chance.uniform(shortest, longest) if fault is Fault.SAG else chance.uniform(0.0, 1.0)
    phase, nth, border = when
    return TimedFault(fault, int(after_s * SECOND), lasts, target, phase, nth, amount, border, late=late)


def faults_for(chance: Random, cell: Cell, *, late: bool, gap: bool) -> tuple[TimedFault, ...]:
    """The two causes of the cell, so that they are there at the same moment.

    Sometimes one more fault is added. `late`: not before the flight is ripe; `gap`: its mission declares one.
    """
    if chance.random() < 0.07:  # a flight in which nothing goes wrong
        return ()
    if gap and chance.random() < 0.25:  # only the gap takes too long
        gust = _timed_fault(chance, (Fault.GUST, Target.NOBODY, 60.0, 400.0), chance.uniform(11.0, 17.0), late=late)
        return (replace(gust, border=True, bare=True),)
    when, at_s = _moment(chance, cell, late=late)
    found: list[TimedFault] = []
    for cause in (cell.first, cell.second):
        found += _brings(chance, cell, cause, when, at_s, late=late)
    if cell.phase is Phase.EMERGENCY:
        found += _emergency(chance, cell, when, at_s, late=late)
    if Cause.OUT_OF_COVERAGE in (cell.first, cell.second):  # at the border of its gap, and no other
        found = [replace(timed, bare=timed.border) for timed in found]
    causes = {cell.first, cell.second}
    if any(timed.fault is Fault.DISOBEYS for timed in found):
        return tuple(found)
    scarce = 0.5 if cell.phase is Phase.EMERGENCY else 0.15
    if Cause.ENERGY in causes and causes - {Cause.ENERGY} <= _LEAVES_HANDS and chance.random() < scarce:
        part = chance.uniform(*_TOO_LITTLE)  # only landing is right, and nothing prevents it
        return tuple(replace(each, amount=part) if each.fault is Fault.SAG else each for each in found)
    if Cause.ENERGY in causes and chance.random() < 0.3:
        # only the companion brings home an aircraft that runs out of energy: what if it is not obeyed at first?
        how = Fault.DISOBEYS, Target.NOBODY, 20.0, 60.0
        return (*found, _timed_fault(chance, how, at_s + chance.uniform(-12.0, -4.0), when, late=late))
    if Cause.COVERAGE_ENDS in causes and chance.random() < 0.15:  # the companion dies while the aircraft is held
        dies = _timed_fault(chance, chance.choice(_DIES), chance.uniform(2.0, 50.0), (None, 1, True), late=late)
        return (*found, replace(dies, bare=any(timed.bare for timed in found)))
    return (*found, *_on_top(chance, when, at_s, late=late))


def downlink_faults(chance: Random) -> tuple[TimedFault, ...]:
    """One or two faults of downlinks only, at any time in flight.

    In a rhythm or by chance, of one station or all.
    """
    return tuple(_of_a_downlink(chance) for _ in range(chance.choice((1, 1, 2))))


def _of_a_downlink(chance: Random) -> TimedFault:
    target = chance.choice((Target.COMMANDER, Target.COMMANDER, Target.NEXT, Target.ALL, Target.ALL))
    after, lasts = int(chance.uniform(10.0, 500.0) * SECOND), int(chance.uniform(40.0, 600.0) * SECOND)
    if chance.random() < 0.3:
        lasts = NEVER
    if chance.random() < 0.4:
        return TimedFault(Fault.THIN, after, lasts, target, amount=chance.choice(_THIN))
    hears_s, hears_not_s = (
        _ATTACK_S if chance.random() < 0.3 else (_log(chance, *_HEARS_S), _log(chance, *_HEARS_NOT_S))
    )
    return TimedFault(Fault.RHYTHM, after, lasts, target, rhythm=(_ticks(hears_s), _ticks(hears_not_s)))


def _log(chance: Random, shortest: float, longest: float) -> float:
    """Evenly on a scale of times as long."""
    return float(shortest * (longest / shortest) ** chance.random())


def _ticks(seconds: float) -> int:
    return max(1, int(seconds * SECOND))


def _brings(
    chance: Random, cell: Cell, cause: Cause, when: _When, at_s: float, *, late: bool
) -> tuple[TimedFault, ...]:
    """The faults that cause one of the two causes of the cell."""
    transfer = cell.phase is Phase.ON_HANDOVER
    if transfer and cause is Cause.COVERAGE_ENDS:  # that is by operators who do not answer
        return ()
    if transfer and cause is Cause.NO_STATION:
        return (_timed_fault(chance, chance.choice(_IN_SILENCE), chance.uniform(3.5, 5.0), when, late=late),)
    causes = {cell.first, cell.second}
    if Cause.OUT_OF_COVERAGE in causes and (
        cause is Cause.COVERAGE_ENDS or (cause is Cause.OUT_OF_COVERAGE and causes & _CARRIED)
    ):  # the way leads there by itself, if no other station is in it
        return ()
    how = chance.choice(_ways(chance, cell, cause))
    if cause in _AT_A_BORDER and how[0] is not Fault.BREACH:
        return (_timed_fault(chance, how, chance.uniform(*_NEXT_S[late]), late=late),)
    strikes_s = at_s + _later_s(cause, cell) - _TAKES_S.get(cause, 0.0) + chance.uniform(-1.0, 2.0)
    if causes & _BEHIND_IT and when[2]:
        strikes_s = max(strikes_s, _NOT_BEFORE_S.get(how[0], strikes_s) + chance.uniform(0.0, 1.0))
    return (_timed_fault(chance, how, strikes_s, when, late=late),)


def _ways(chance: Random, cell: Cell, cause: Cause) -> tuple[tuple[Fault, Target, float, float], ...]:
    """How it may be brought about there."""
    if cause is Cause.COMMANDER_LOST and cell.phase is not Phase.ON_HANDOVER and chance.random() < 0.8:
        return _NOBODY_ELSE
    if cause is Cause.FENCE and Cause.OFF_ROUTE in (cell.first, cell.second):
        return _BRIEFLY_UP
    if cause is Cause.FENCE and cell.at_a_border:
        return _BY_HEIGHT
    if cause is Cause.LINKS_WEAK and (cell.at_a_border or cell.phase is Phase.ON_HANDOVER):
        return _PROVOKES[cause][:1]
    return _PROVOKES[cause]


def _emergency(chance: Random, cell: Cell, when: _When, at_s: float, *, late: bool) -> tuple[TimedFault, ...]:
    """Faults that cause an emergency if neither of the two causes does.

    An autopilot that does not follow keeps the aircraft from being turned back, if one of the causes occurs only on the
    route.
    """
    causes = {cell.first, cell.second}
    first_s = at_s + min(0.0, _later_s(cell.first, cell), _later_s(cell.second, cell))
    sag = _timed_fault(chance, chance.choice(_PROVOKES[Cause.ENERGY]), first_s - 10.0, when, late=late)
    if causes & _UNDER_WAY and (Cause.FENCE in causes or chance.random() < 0.6):
        takes_s = at_s - first_s
        how = Fault.DISOBEYS, Target.NOBODY, takes_s + 18.0, takes_s + 28.0
        stays = _timed_fault(chance, how, first_s - 10.0, when, late=late)
        return (stays,) if causes & {Cause.ENERGY, Cause.COMMANDER_LOST} else (sag, stays)
    if not causes & _BEFORE_A_LOSS and chance.random() < 0.3:
        lost = chance.choice(((Fault.BURST, Target.ALL, 12.0, 30.0), (Fault.DEAD, Target.ALL, 12.0, 60.0)))
        return (_timed_fault(chance, lost, at_s - 7.0 + chance.uniform(-2.0, 2.0), when, late=late),)
    return () if causes & (_GRAVE | _UNDER_WAY) else (sag,)


def _on_top(chance: Random, when: _When, at_s: float, *, late: bool) -> tuple[TimedFault, ...]:
    """Further faults: at the time of the cell's causes, or at any time."""
    luck = chance.random()
    if luck < 0.2:
        return (_timed_fault(chance, chance.choice(_IN_THE_WAY), at_s + chance.uniform(-9.0, 5.0), when, late=late),)
    if luck < 0.27:
        return (_timed_fault(chance, chance.choice(_ANYTHING), at_s + chance.uniform(-6.0, 10.0), when, late=late),)
    if luck < 0.34:
        return (_timed_fault(chance, chance.choice((*_ANYTHING, *_IN_THE_WAY)), chance.uniform(10.0, 500.0)),)
    return ()


def _later_s(cause: Cause, cell: Cell) -> float:
    """How much later a cause strikes than the other one (s).

    A cause that leaves the rules without news strikes after they have had the other news. A cause that turns the
    aircraft back strikes after one that occurs only on the route.
    """
    other = cell.second if cause is cell.first else cell.first
    if (cause, other) == (Cause.FENCE, Cause.OFF_ROUTE):
        return -14.0
    if (cause, other) == (Cause.AUTOPILOT_LOST, Cause.POSITION_STALE):
        return 3.5
    if cause is Cause.COMMANDER_LOST and other in _BEFORE_A_LOSS:
        return 3.0
    if cell.phase is Phase.EMERGENCY and cause in _GRAVE and other in _UNDER_WAY:
        return -2.5 if other is Cause.FENCE else 3.0  # the autopilot keeps its fence itself: an emergency comes before
    if cause not in _NO_NEWS or other in _NO_NEWS:
        return 0.0
    return 0.0 if other in _AT_A_BORDER else 5.0


def _moment(chance: Random, cell: Cell, *, late: bool) -> tuple[_When, float]:
    """When both causes are to be there (s): after take-off, or after an event in flight.

    `late`: after the flight is ripe.
    """
    causes = {cell.first, cell.second}
    if cell.at_a_border:
        return (None, 1, True), chance.uniform(*_border_s(causes))
    if cell.phase is Phase.ON_HANDOVER and Cause.LINKS_WEAK in causes:
        return (Phase.ON_HANDOVER, 1, False), chance.uniform(13.0, 20.0)
    if cell.phase is Phase.ON_HANDOVER:
        takes_s = max(_TAKES_S.get(cause, 0.0) - _later_s(cause, cell) for cause in causes)
        at_s = chance.uniform(max(3.0, takes_s), max(9.0, takes_s + 4.0))
        return (Phase.ON_HANDOVER, 1 if late else chance.choice((1, 1, 2)), False), at_s
    return (None, 1, False), chance.uniform(*(_SOON_S if late else _EARLY_S))


def _border_s(causes: Set[Cause]) -> tuple[float, float]:
    """When at a border: the time after the moment when the aircraft is about to leave the zone (s)."""
    if Cause.LINKS_WEAK in causes:
        return 12.5, 14.0
    if causes & _BEHIND_IT:
        return 12.0, 14.5
    return (9.5, 11.5) if causes & _NO_NEWS else (5.5, 11.5)


def _turns_back(chance: Random, cell: Cell) -> dict[Cause, str]:
    """Policies for an emergency that one of these causes has to bring about, and is there with it."""
    under_way = [cause for cause in (cell.first, cell.second) if cause in _UNDER_WAY]
    if cell.phase is not Phase.EMERGENCY or not under_way or chance.random() < 0.2:
        return {}
    grave = {cell.first, cell.second} & (_GRAVE - _UNDER_WAY)
    turns = None if grave else chance.choice(under_way)
    return {
        cause: "return" if cause is turns else "warn"
        for cause in (cell.first, cell.second)
        if cause not in grave and "warn" in CAUSES[cause].policies
    }


def policies_for(chance: Random, cell: Cell) -> Mapping[Cause, str]:
    """Mostly those of the table."""
    chosen = _turns_back(chance, cell)
    mild = cell.phase in (Phase.ON_MISSION, Phase.ON_HANDOVER) and chance.random() < 0.9
    if Cause.COVERAGE_ENDS not in (cell.first, cell.second) and {cell.first, cell.second} & _AT_A_BORDER:
        chosen[Cause.COVERAGE_ENDS] = "off"  # else it would stop before anything happens at the border
    for cause, row in CAUSES.items():
        aimed = cause in (cell.first, cell.second)
        if aimed and mild and "warn" in row.policies:
            chosen[cause] = "warn"
        elif aimed and cause is Cause.POSITION_STALE and chance.random() < 0.5:
            chosen[cause] = "land"  # after it, and on its way down, the other cause asks for less
        elif cause not in chosen and chance.random() < 0.1:
            unfit = {"off"} if aimed else set()
            if cause in _GRAVE:
                unfit.add("warn")
            chosen[cause] = chance.choice([word for word in row.policies if word not in unfit])
    return chosen
