# SPDX-License-Identifier: GPL-3.0-or-later

"""What strikes when: each flight aims at two causes at once in one phase, all such cells in turn.

A cell is met when both causes are there at the same moment in that phase; that is counted from what the rules say
(`outcome.py`), for it is not a verdict but a measure of how much was tried. Where both would at once lead to another
phase, milder policies are drawn, so that both can be there; the judge knows them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations, product
from random import Random
from typing import Final

from mavproxy_handover.core.model import Phase
from mavproxy_handover.core.safety.causes import CAUSES, Cause
from sitl.campaign.faults import Fault, Strike, Target
from sitl.campaign.times import NEVER, SECOND

__all__ = ["CELLS", "Cell", "policies_for", "strikes_for"]


@dataclass(frozen=True, slots=True)
class Cell:
    """Two causes and a phase."""

    first: Cause
    second: Cause
    phase: Phase

    @classmethod
    def of(cls, seed: int) -> Cell:
        """What the flight of this seed aims at."""
        return CELLS[seed % len(CELLS)]

    @property
    def words(self) -> str:
        """For people."""
        return f"{self.first.value} with {self.second.value} in {self.phase.name.lower()}"


CELLS: Final = tuple(Cell(*pair, phase) for pair, phase in product(combinations(Cause, 2), Phase))

#: how a cause is brought about: fault, whom it strikes, how long it lasts (s)
_PROVOKES: Final[Mapping[Cause, tuple[tuple[Fault, Target, float, float], ...]]] = {
    Cause.ENERGY: ((Fault.SAG, Target.NOBODY, 0.4, 0.8),),
    Cause.COMMANDER_LOST: (
        (Fault.DEAD, Target.COMMANDER, 8.0, 90.0),
        (Fault.MUTE, Target.COMMANDER, 8.0, 60.0),
        (Fault.BURST, Target.COMMANDER, 6.0, 30.0),
    ),
    Cause.OUT_OF_COVERAGE: ((Fault.BREACH, Target.NOBODY, 40.0, 90.0),),
    Cause.NO_STATION: ((Fault.DEAD, Target.NEXT, 30.0, 200.0), (Fault.DEAF, Target.NEXT, 30.0, 200.0)),
    Cause.COVERAGE_ENDS: ((Fault.DEAD, Target.NEXT, 60.0, 300.0), (Fault.DEAF, Target.NEXT, 60.0, 300.0)),
    Cause.AUTHENTICATION: ((Fault.ATTACK, Target.COMMANDER, 5.0, 60.0),),
    Cause.LINKS_WEAK: ((Fault.WEAK, Target.COMMANDER, 15.0, 60.0),),
    Cause.GUARD_LOST: ((Fault.NO_GUARD, Target.NOBODY, 6.0, 90.0),),
    Cause.FENCE: ((Fault.BREACH, Target.NOBODY, 20.0, 60.0),),
    Cause.OFF_ROUTE: ((Fault.DRIFT, Target.NOBODY, 8.0, 25.0),),
    Cause.POSITION_STALE: ((Fault.NO_FIX, Target.NOBODY, 3.0, 30.0),),
    Cause.AUTOPILOT_LOST: ((Fault.BLIND, Target.NOBODY, 4.0, 30.0),),
}
#: what may come on top, in any flight
_ANYTHING: Final = (
    (Fault.ROGUE, Target.NOBODY, 5.0, 60.0),
    (Fault.KILLED, Target.NOBODY, 0.5, 4.0),
    (Fault.STALLED, Target.NOBODY, 1.0, 5.0),
    (Fault.GONE, Target.NOBODY, 1.0, 1.0),
    (Fault.BURST, Target.ALL, 2.0, 9.0),
    (Fault.PILOT, Target.NOBODY, 5.0, 60.0),
    (Fault.DEAD, Target.ALL, 20.0, 200.0),
)


def _strike(chance: Random, how: tuple[Fault, Target, float, float], after_s: float, phase: Phase | None) -> Strike:
    fault, target, shortest, longest = how
    lasts = NEVER if fault in (Fault.SAG, Fault.GONE) else int(chance.uniform(shortest, longest) * SECOND)
    nth = chance.choice((1, 1, 2, 3)) if phase is Phase.ON_HANDOVER else 1
    amount = chance.uniform(shortest, longest) if fault is Fault.SAG else chance.uniform(0.0, 1.0)
    return Strike(fault, int(after_s * SECOND), lasts, target, phase, nth, amount)


def _on_load(chance: Random) -> tuple[float, Phase | None]:
    return -chance.uniform(0.5, 4.0), None


def _on_mission(chance: Random) -> tuple[float, Phase | None]:
    return chance.uniform(20.0, 480.0), None


def _on_handover(chance: Random) -> tuple[float, Phase | None]:
    return chance.uniform(-2.0, 3.0), Phase.ON_HANDOVER


def _in_emergency(chance: Random) -> tuple[float, Phase | None]:
    return chance.uniform(0.5, 10.0), Phase.EMERGENCY


#: when the first one strikes; the second comes soon before or after
_WHEN: Final[Mapping[Phase, Callable[[Random], tuple[float, Phase | None]]]] = {
    Phase.ON_LOAD: _on_load,
    Phase.ON_MISSION: _on_mission,
    Phase.ON_HANDOVER: _on_handover,
    Phase.EMERGENCY: _in_emergency,
}


def strikes_for(chance: Random, cell: Cell) -> tuple[Strike, ...]:
    """The two causes of the cell, in its phase, and now and then one thing more."""
    if chance.random() < 0.1:  # a flight in which nothing goes wrong
        return ()
    after, phase = _WHEN[cell.phase](chance)
    found = []
    for number, cause in enumerate((cell.first, cell.second)):
        apart = chance.uniform(-6.0, 8.0) if number else 0.0
        if phase is not None:
            apart = max(0.0, after + apart) - after
        found.append(_strike(chance, chance.choice(_PROVOKES[cause]), after + apart, phase))
    if phase is Phase.EMERGENCY:  # something has to bring that about
        lost = chance.choice(((Fault.BURST, Target.ALL, 9.0, 30.0), (Fault.DEAD, Target.COMMANDER, 9.0, 60.0)))
        found.append(_strike(chance, lost, chance.uniform(30.0, 400.0), None))
    if chance.random() < 0.25:
        found.append(_strike(chance, chance.choice(_ANYTHING), chance.uniform(10.0, 500.0), None))
    return tuple(found)


#: what is never but warned of by a vehicle that is to come home by itself
_GRAVE: Final = frozenset({Cause.COMMANDER_LOST, Cause.OUT_OF_COVERAGE, Cause.ENERGY, Cause.NO_STATION})


def policies_for(chance: Random, cell: Cell) -> Mapping[Cause, str]:
    """Mostly those of the table."""
    chosen = {}
    for cause, row in CAUSES.items():
        aimed = cause in (cell.first, cell.second)
        if aimed and cell.phase in (Phase.ON_MISSION, Phase.ON_HANDOVER) and "warn" in row.policies:
            if chance.random() < 0.6:
                chosen[cause] = "warn"
        elif chance.random() < 0.1:
            chosen[cause] = chance.choice([word for word in row.policies if cause not in _GRAVE or word != "warn"])
    return chosen
