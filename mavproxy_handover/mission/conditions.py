# SPDX-License-Identifier: GPL-3.0-or-later

"""Items that wait for a condition, and the speeds that a route may have because of them.

A CONDITION_DELAY, CONDITION_DISTANCE or CONDITION_YAW holds up the items between it and the next flown item. They are
done somewhere on the way to that item. If the aircraft gets there first, ArduPilot never does them. So after a
DO_CHANGE_SPEED that waits, the speed may be the old one or the new one, until it is set without a condition. A payload
whose release waits may stay on board.

The walk has the slower speed: it takes the most time, and nearly always the most energy. `Route.fastest` asks for the
other one, which leaves the least time for a handover (`check.py`).

Source: AP_Mission (`advance_current_nav_cmd`, `advance_current_do_cmd`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from mavproxy_handover.mission.items import (
    CHANGE_SPEED,
    COMMANDS,
    CONDITIONS,
    RETURN_TO_LAUNCH,
    MissionItem,
)

__all__ = ["new_speed", "speeds_of", "waiting"]


def waiting(items: Sequence[MissionItem]) -> dict[int, MissionItem]:
    """The numbers of the items that wait for a condition, each with the item of the condition."""
    found: dict[int, MissionItem] = {}
    condition: MissionItem | None = None
    for item in items:
        if item.command in CONDITIONS:
            condition = item
        elif COMMANDS[item.command].flown:
            condition = None
        elif condition is not None:
            found[item.seq] = condition
    return found


def new_speed(item: MissionItem) -> float | None:
    """The speed (m/s) that an item sets; None: it sets none."""
    changes = item.command == CHANGE_SPEED and item.param1 in (0.0, 1.0) and item.param2 > 0.0
    return item.param2 if changes else None


def speeds_of(
    items: Sequence[MissionItem],
    waits: Mapping[int, MissionItem],
    speed_mps: float,
    cruise_mps: float,
    *,
    fastest: bool = False,
) -> Iterator[tuple[MissionItem, float]]:
    """Each item with the slowest, or the fastest, speed that may be set by then.

    A return forgets what was set: ModeRTL::init, and Mode::enter of ArduPlane.
    """
    possible = {speed_mps}
    for item in items:
        new_mps = cruise_mps if item.command == RETURN_TO_LAUNCH else new_speed(item)
        if new_mps is not None:
            possible = possible | {new_mps} if item.seq in waits else {new_mps}
        yield item, max(possible) if fastest else min(possible)
