# SPDX-License-Identifier: GPL-3.0-or-later

"""DO_JUMP: the items of a copter's mission in the order in which the autopilot flies them.

ArduPilot counts each DO_JUMP by itself: it goes to its target as often as it is told, and then on to the next item.
What is flown so is bounded here by `MOST_FLOWN` items. More cannot be judged, nor a jump without end, nor a curve that
is flown more than once.

Source: ArduPilot's AP_Mission::get_next_cmd.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.items import COMMANDS, JUMP, LOITER_TURNS, SPLINE_WAYPOINT, MissionItem

__all__ = ["MOST_FLOWN", "as_flown", "check_jumps", "jumps"]

#: items, counted as often as they are flown
MOST_FLOWN: Final = 2000


def jumps(items: Sequence[MissionItem]) -> bool:
    """Whether a mission has a DO_JUMP."""
    return any(item.command == JUMP for item in items)


def as_flown(items: Sequence[MissionItem], first: int = 0) -> tuple[MissionItem, ...]:
    """The items in the order of flight, from number `first` on (item number n at index n - 1).

    At most `MOST_FLOWN` and one. If it begins in the middle, no later jump counts as made.
    """
    if not jumps(items):
        return tuple(item for item in items if item.seq >= first)
    made: Counter[int] = Counter()
    found: list[MissionItem] = []
    at, steps = max(0, first - 1), 0
    while at < len(items) and len(found) <= MOST_FLOWN and steps <= 2 * MOST_FLOWN:
        item = items[at]
        steps += 1
        if item.command != JUMP:
            found.append(item)
            at += 1
        elif made[at] < int(item.param2):
            made[at] += 1
            at = int(item.param1) - 1
        else:
            at += 1
    return tuple(found)


def check_jumps(where: Where, items: Sequence[MissionItem]) -> None:
    """Raises MissionError for a jump to nowhere, without end, or too often to be judged."""
    for item in items:
        if item.command != JUMP:
            continue
        inside = where.at(f"item {item.seq}")
        target, times = int(item.param1), int(item.param2)
        if not 1 <= target <= len(items) or target == item.seq:
            raise inside.error(f"DO_JUMP to item {target} (allowed: another item from 1 to {len(items)})")
        if times < 0:
            raise inside.error("DO_JUMP repeats without end: its energy cannot be judged (allowed: a number of times)")
    if not jumps(items):
        return
    flown = Counter(as_flown(items))
    if not 0 < flown.total() <= MOST_FLOWN:
        raise where.error(f"its jumps make more than {MOST_FLOWN} items of it (allowed: at most {MOST_FLOWN})")
    for item, times in flown.items():
        if times > 1 and item.command in (SPLINE_WAYPOINT, LOITER_TURNS):
            name = COMMANDS[item.command].name
            raise where.at(f"item {item.seq}").error(f"{name} is flown {times} times by DO_JUMP (allowed: once)")
