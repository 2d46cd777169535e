# SPDX-License-Identifier: GPL-3.0-or-later

"""The figures of many flights together: how they ended, what was unsafe, what was tried."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, product
from math import sqrt
from typing import Final

from mavproxy_handover.core.common.causes import Cause
from sitl.campaign.outcome import Outcome
from sitl.campaign.steering import CELLS, PHASES, Cell, never

__all__ = ["ENOUGH", "Figures", "figures", "wilson"]

#: so often each pair of causes is to come up in each phase
ENOUGH: Final = 100
#: a flight counts with this time in the air (s), and this number of handovers
WHOLE_S, WHOLE_HANDOVERS = 600.0, 2


def wilson(part: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """The interval that holds a probability of which `part` of `of` was seen, 95 times of 100 (Wilson, 1927)."""
    if of == 0:
        return 0.0, 1.0
    seen, square = part / of, z * z
    middle = (seen + square / (2 * of)) / (1 + square / of)
    half = z * sqrt(seen * (1 - seen) / of + square / (4 * of * of)) / (1 + square / of)
    return max(0.0, middle - half), min(1.0, middle + half)


@dataclass(frozen=True, slots=True)
class Figures:
    """All flights. `cells`: pairs of causes and phase, and in how many flights they were there at once."""

    flights: int
    hours: float
    cpu_s: float
    whole: int
    ended: Counter[str]
    unsafe: Counter[str]
    examples: dict[str, list[int]]
    cells: Counter[str]

    @property
    def unsafe_flights(self) -> int:
        """How many flights had anything unsafe."""
        return len({seed for seeds in self.examples.values() for seed in seeds})

    @property
    def short(self) -> list[str]:
        """Pairs of causes that did not come up often enough in a phase."""
        return [cell for cell in all_cells() if self.cells[cell] < ENOUGH]

    @property
    def against_the_rules(self) -> list[str]:
        """Pairs of causes that came up in a phase although the rules are said not to let them."""
        pairs = product(PHASES, combinations(Cause, 2))
        cells = (Cell(*pair, phase).name for phase, pair in pairs if never(*pair, phase) is not None)
        return [cell for cell in cells if self.cells[cell]]

    @property
    def hours_per_cpu_s(self) -> float:
        """Flight hours for each second of processor time."""
        return self.hours / self.cpu_s if self.cpu_s > 0.0 else 0.0


def all_cells() -> list[str]:
    """Every pair of causes that can meet, in every phase of a flight, as an outcome names it."""
    return [cell.name for cell in CELLS]


def figures(outcomes: Iterable[Outcome]) -> Figures:
    """Count them."""
    ended: Counter[str] = Counter()
    unsafe: Counter[str] = Counter()
    cells: Counter[str] = Counter()
    examples: dict[str, list[int]] = {}
    flights = whole = 0
    seconds = cpu = 0.0
    for outcome in sorted(outcomes, key=lambda each: each.seed):
        flights += 1
        ended[outcome.ended] += 1
        cells.update(outcome.cells)
        seconds += outcome.aloft_s
        cpu += outcome.cpu_s
        whole += outcome.aloft_s >= WHOLE_S and outcome.handovers >= WHOLE_HANDOVERS
        for row, _at, _text in outcome.unsafe:
            unsafe[row] += 1
            examples.setdefault(row, []).append(outcome.seed)
    return Figures(flights, seconds / 3600.0, cpu, whole, ended, unsafe, examples, cells)
