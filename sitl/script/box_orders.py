# SPDX-License-Identifier: GPL-3.0-or-later

"""The orders to the position box in a scenario. The head of `sitl/run/data_box.py` explains each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

__all__ = ["parse_order"]

#: order -> how many numbers follow
_ORDERS: Final[Mapping[str, int]] = {
    "stall": 0,
    "resume": 0,
    "cut": 0,
    "restart": 1,
    "drift": 2,
    "carry": 3,
    "true": 0,
    "garbage": 0,
    "thesis": 0,
    "full": 0,
}


def parse_order(line: str) -> tuple[str, tuple[float, ...]]:
    """An order and its numbers. Raises ValueError: none of these."""
    word, *rest = line.split() or [""]
    if word not in _ORDERS:
        raise ValueError(f"{line!r} must be one of {', '.join(_ORDERS)}")
    try:
        numbers = tuple(float(each) for each in rest)
    except ValueError:
        numbers = ()
    if len(numbers) != _ORDERS[word] or not all(map(math.isfinite, numbers)) or len(rest) != len(numbers):
        raise ValueError(f"{line!r}: {word} takes {_ORDERS[word] or 'no'} numbers")
    if word == "carry" and not 0.1 <= numbers[2] <= 50.0:
        raise ValueError(f"{line!r}: the pace must be 0.1 to 50 m/s")
    if word == "restart" and not 0.0 <= numbers[0] <= 600.0:
        raise ValueError(f"{line!r}: must be 0 to 600 s")
    return word, numbers
