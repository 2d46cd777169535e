# SPDX-License-Identifier: GPL-3.0-or-later

"""Two rows of decisions side by side: which are the same, and which stand in only one of them.

Two decisions are the same if event, reason, station and action with the return site are the same. They must be no
further apart than the tolerance. Figures in their sentences follow the moment, and are not compared. Each is paired
once, the earlier ones first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sitl.replay.happened import Decision

__all__ = ["Comparison", "compare"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """`both`: pairs of the same; `before`, `after`: what stands in the first row, or the second, only."""

    both: tuple[tuple[Decision, Decision], ...]
    before: tuple[Decision, ...]
    after: tuple[Decision, ...]

    @property
    def equal(self) -> bool:
        """Whether both have the same decisions."""
        return not self.before and not self.after

    @property
    def apart_s(self) -> float:
        """The most that two of the same are apart; 0 without any."""
        return max((abs(one.at - other.at) for one, other in self.both), default=0.0)


def compare(before: Sequence[Decision], after: Sequence[Decision], tolerance_s: float) -> Comparison:
    """Pair them."""
    left = sorted(after, key=lambda decision: decision.at)
    both, alone = [], []
    for decision in sorted(before, key=lambda each: each.at):
        alike = [
            each for each in left if each.what == decision.what and abs(each.at - decision.at) <= tolerance_s
        ]  # fmt: skip
        if alike:
            nearest = min(alike, key=lambda each: abs(each.at - decision.at))
            left.remove(nearest)
            both.append((decision, nearest))
        else:
            alone.append(decision)
    return Comparison(tuple(both), tuple(alone), tuple(left))
