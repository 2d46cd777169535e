# SPDX-License-Identifier: GPL-3.0-or-later

"""The items of a QGroundControl plan, with survey, corridor and structure scans as the waypoints that they store.

A complex item is a pattern with its settings. QGroundControl writes the waypoints that it made of a pattern beside it
(`TransectStyleComplexItem.Items`), and these are what it uploads. A landing pattern stores only its places
(`landing_pattern.py`). Any other complex item without stored waypoints would have to be unfolded the way QGroundControl
does it, and is refused.

Source: QGroundControl developer guide, "Plan File Format".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from mavproxy_handover.mission.errors import Faults, Where
from mavproxy_handover.mission.landing_pattern import LANDING_PATTERNS, landing_items

__all__ = ["simple_items"]

_PATTERN = "TransectStyleComplexItem"
_ITEMS = "Items"


def simple_items(
    where: Where, listed: Sequence[object], faults: Faults
) -> Iterator[tuple[int, Where, Mapping[str, object]]]:
    """Number, place and table of each simple item of a plan. A complex item stands for those that it stores."""
    seq = 1
    for entry in listed:
        with faults.noted():
            for inside, item in _unfolded(where.at(f"item {seq}"), entry):
                yield seq, inside, item
                seq += 1
            continue
        seq += 1


def _unfolded(where: Where, entry: object) -> list[tuple[Where, Mapping[str, object]]]:
    """The simple items of one entry. Raises MissionError."""
    item = where.table(entry, "the item")
    kind = where.need(item, "type")
    if kind == "SimpleItem":
        return [(where, item)]
    if kind != "ComplexItem":
        raise where.error("type is not 'SimpleItem' or 'ComplexItem'")
    name = item.get("complexItemType")
    shown = f" '{where.text(name, 'complexItemType', 60)}'" if name is not None else ""
    if name in LANDING_PATTERNS:
        inside = where.at(str(name))
        return [(inside, each) for each in landing_items(inside, item)]
    pattern = item.get(_PATTERN, item)
    stored = where.table(pattern, _PATTERN).get(_ITEMS)
    if not stored:
        raise where.error(
            f"complex item{shown} stores no waypoints (allowed: a survey, corridor or structure scan that has them; "
            "rebuild the pattern from waypoints)"
        )
    numbered = enumerate(where.array(stored, _ITEMS), 1)
    return [(where.at(f"waypoint {n} of{shown}"), where.table(each, "the waypoint")) for n, each in numbered]
