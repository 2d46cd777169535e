# SPDX-License-Identifier: GPL-3.0-or-later

"""DO_JUMP and DO_JUMP_TAG: the items of a mission in the order in which the autopilot flies them.

Rules
-----
* ArduPilot counts each jump by itself: it goes to its target as often as it is told, and then on to the next item. Then
  it forgets the count, so a jump inside the round of another one is made as often in each round. MIS_OPTIONS can keep
  the count; the longer flight is judged.
* DO_JUMP_TAG goes to the first JUMP_TAG with its number.
* A jump without end (-1) is walked once, and the walk ends where it would be made again: one round, and the way back to
  its beginning. Only a mission that declares it may have one (`endless_jump`).
* `MOST_FLOWN` items bound what is flown. More cannot be judged.

Source: ArduPilot's AP_Mission (`get_next_cmd`, `get_index_of_jump_tag`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.items import COMMANDS, JUMP_TAG, JUMP_TO_TAG, JUMPS, MissionItem

__all__ = ["MOST_FLOWN", "as_flown", "check_jumps", "endless_jumps", "jumps"]

#: items, counted as often as they are flown
MOST_FLOWN: Final = 2000
_WITHOUT_END: Final = -1


def jumps(items: Sequence[MissionItem]) -> bool:
    """Whether a mission has a jump."""
    return any(item.command in JUMPS for item in items)


def endless_jumps(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """The jumps that repeat without end."""
    return tuple(item for item in items if item.command in JUMPS and int(item.param2) == _WITHOUT_END)


def as_flown(items: Sequence[MissionItem], first: int = 0) -> tuple[MissionItem, ...]:
    """The items in the order of flight, from number `first` on (item number n at index n - 1).

    At most `MOST_FLOWN` and one. If it begins in the middle, no later jump counts as made.
    """
    if not jumps(items):
        return tuple(item for item in items if item.seq >= first)
    made: Counter[int] = Counter()
    found: list[MissionItem] = []
    at, steps = max(0, first - 1), 0
    while 0 <= at < len(items) and len(found) <= MOST_FLOWN and steps <= 2 * MOST_FLOWN:
        item = items[at]
        steps += 1
        if item.command not in JUMPS:
            found.append(item)
            at += 1
        elif int(item.param2) == _WITHOUT_END:
            found += _to_its_beginning(items, _target(items, item))
            break
        elif made[at] < int(item.param2):
            made[at] += 1
            at = _target(items, item) - 1
        else:
            made[at] = 0
            at += 1
    return tuple(found)


def _to_its_beginning(items: Sequence[MissionItem], target: int) -> tuple[MissionItem, ...]:
    """The items from the target of a jump to the first one that is flown; a further jump ends them."""
    after = items[target - 1 :] if target > 0 else ()
    for count, item in enumerate(after):
        if item.command in JUMPS:
            return tuple(after[:count])
        if COMMANDS[item.command].flown:
            return tuple(after[: count + 1])
    return tuple(after)


def _target(items: Sequence[MissionItem], jump: MissionItem) -> int:
    """Number of the item that a jump goes to; 0: there is none."""
    number = int(jump.param1)
    if jump.command == JUMP_TO_TAG:
        return next((item.seq for item in items if item.command == JUMP_TAG and int(item.param1) == number), 0)
    return number if 1 <= number <= len(items) else 0


def check_jumps(where: Where, items: Sequence[MissionItem], *, endless: bool = False) -> None:
    """Raises MissionError for a jump to nowhere, too often to be judged, or without end. `endless`: the mission
    declares one without end."""
    for item in items:
        if item.command not in JUMPS:
            continue
        inside, name = where.at(f"item {item.seq}"), COMMANDS[item.command].name
        target = _target(items, item)
        if target == 0 and item.command == JUMP_TO_TAG:
            raise inside.error(f"{name} to tag {item.param1:g} (allowed: the number of a JUMP_TAG of the mission)")
        if target in (0, item.seq):
            allowed = f"another item from 1 to {len(items)}"
            raise inside.error(f"{name} to item {int(item.param1)} (allowed: {allowed})")
        if int(item.param2) == _WITHOUT_END and not endless:
            raise inside.error(
                f"{name} repeats without end: its energy cannot be judged (allowed: a number of times, or "
                "'endless_jump = true' in the mission)"
            )
    if jumps(items) and not 0 < len(as_flown(items)) <= MOST_FLOWN:
        raise where.error(f"its jumps make more than {MOST_FLOWN} items of it (allowed: at most {MOST_FLOWN})")
