# SPDX-License-Identifier: GPL-3.0-or-later

"""The arithmetic of a comparison: quantiles, pairs measured in turns, and when there are enough of them.

A pair is one measurement of ours and one of the baseline, one after the other. A disturbance of the machine that lasts
longer affects both, so the ratio within a pair is steadier than either number. Order within pairs alternates (A B, B
A), so that a drift favours neither side. A result is the median of the pairs' ratios with its quartiles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

__all__ = ["Comparison", "Pair", "abba", "compare", "median", "quantile", "settled"]


def quantile(values: Sequence[float], part: float) -> float:
    """The `part` quantile (0 to 1) of some values, interpolated between neighbours. Raises ValueError for none."""
    if not values:
        raise ValueError("quantile of nothing")
    ordered = sorted(values)
    place = part * (len(ordered) - 1)
    below = math.floor(place)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (ordered[above] - ordered[below]) * (place - below)


def median(values: Sequence[float]) -> float:
    """The value in the middle. Raises ValueError for none."""
    return quantile(values, 0.5)


@dataclass(frozen=True, slots=True)
class Pair:
    """One measurement of each side, in the same unit."""

    ours: float
    baseline: float

    @property
    def usable(self) -> bool:
        """A baseline of nothing, or less where an idle share was taken off, gives no ratio."""
        return self.baseline > 0.0


@dataclass(frozen=True, slots=True)
class Comparison:
    """The medians of both sides, and the median ratio with its quartiles."""

    ours: float
    baseline: float
    ratio: float
    low: float
    high: float
    pairs: int
    #: ratio of the 20 % quantiles of both sides: what else a machine does only ever adds to a time
    quiet_ratio: float = 0.0
    #: pairs whose baseline was lost in the noise
    unusable: int = 0

    @property
    def uncertainty(self) -> float:
        """Half the quartile range by the root of the number of pairs, as a part of the ratio."""
        if self.ratio <= 0.0:
            return math.inf
        return (self.high - self.low) / 2.0 / math.sqrt(self.pairs) / self.ratio


def compare(pairs: Sequence[Pair]) -> Comparison:
    """The summary of some pairs. Raises ValueError if none is usable."""
    usable = [pair for pair in pairs if pair.usable]
    ratios = [pair.ours / pair.baseline for pair in usable]
    return Comparison(
        median([pair.ours for pair in usable]),
        median([pair.baseline for pair in usable]),
        median(ratios),
        quantile(ratios, 0.25),
        quantile(ratios, 0.75),
        len(usable),
        quantile([pair.ours for pair in usable], 0.2) / quantile([pair.baseline for pair in usable], 0.2),
        len(pairs) - len(usable),
    )


def settled(pairs: Sequence[Pair], least: int, uncertainty: float) -> bool:
    """Whether `least` pairs are there and more of them would hardly move the ratio."""
    usable = sum(pair.usable for pair in pairs)
    return usable >= least and compare(pairs).uncertainty <= uncertainty


def abba() -> Iterator[tuple[bool, bool]]:
    """The order within each pair, for ever: whether ours is first, then whether it is second."""
    while True:
        yield True, False
        yield False, True
