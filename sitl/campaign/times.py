# SPDX-License-Identifier: GPL-3.0-or-later

"""Time of a simulated flight: whole ticks of 1/64 s.

A sixty-fourth is exact in binary. So it makes no difference to any comparison of the rules at which moment something
happens, only how far it is from another: that is what lets a campaign leave time out (`pace.py`).
"""

from __future__ import annotations

from math import ceil
from typing import Final

__all__ = ["NEVER", "ROUND", "SECOND", "in_seconds", "in_ticks", "on_round"]

SECOND: Final = 64
#: the longest between two rounds of the companion's main loop, of which there are 20 a second
ROUND: Final = 4
NEVER: Final = 1 << 60
#: so many ticks hold five rounds, at 0, 3, 6, 10 and 13: every second has the same, whole ones may be left out
_FIVE: Final = 16
_NEXT: Final = tuple(next(at for at in (0, 3, 6, 10, 13, _FIVE) if at >= tick) for tick in range(_FIVE))


def in_seconds(ticks: int) -> float:
    """The time as the rules count it."""
    return ticks / SECOND


def in_ticks(seconds: float) -> int:
    """No sooner than that."""
    return ceil(seconds * SECOND)


def on_round(ticks: int) -> int:
    """The first round of the main loop then or later."""
    return ticks - ticks % _FIVE + _NEXT[ticks % _FIVE]
