# SPDX-License-Identifier: GPL-3.0-or-later

"""DO_JUMP: what is flown how often, and what cannot be judged."""

from __future__ import annotations

import pytest

from mavproxy_handover.mission.errors import MissionError, Where
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.jumps import as_flown, check_jumps

WAYPOINT, SPLINE, JUMP = 16, 82, 177


def item(seq: int, command: int = WAYPOINT, first: float = 0.0, second: float = 0.0) -> MissionItem:
    return MissionItem(seq, command, 3, first, second, 0.0, 0.0, 52.0 + seq / 1000.0, 5.0, 40.0)


def numbers(*items: MissionItem, first: int = 0) -> list[int]:
    return [each.seq for each in as_flown(items, first)]


def test_without_a_jump_the_items_are_flown_in_their_order() -> None:
    assert numbers(item(1), item(2), item(3)) == [1, 2, 3]
    assert numbers(item(1), item(2), item(3), first=2) == [2, 3]


def test_a_jump_is_made_as_often_as_it_says() -> None:
    route = (item(1), item(2), item(3), item(4, JUMP, 2.0, 2.0), item(5))
    assert numbers(*route) == [1, 2, 3, 2, 3, 2, 3, 5]
    assert numbers(*route, first=3) == [3, 2, 3, 2, 3, 5]


def test_a_jump_ahead_leaves_items_out_and_one_of_no_times_none() -> None:
    assert numbers(item(1), item(2, JUMP, 4.0, 1.0), item(3), item(4)) == [1, 4]
    assert numbers(item(1), item(2, JUMP, 4.0, 0.0), item(3), item(4)) == [1, 3, 4]


def test_a_jump_within_a_jump_is_counted_for_the_whole_flight() -> None:
    """ArduPilot does not begin to count anew."""
    route = (item(1), item(2, JUMP, 1.0, 1.0), item(3), item(4, JUMP, 1.0, 1.0), item(5))
    assert numbers(*route) == [1, 1, 3, 1, 3, 5]


@pytest.mark.parametrize(
    ("items", "why"),
    [
        ((item(1), item(2, JUMP, 3.0, 1.0)), "item 2: DO_JUMP to item 3 (allowed: another item from 1 to 2)"),
        ((item(1), item(2, JUMP, 2.0, 1.0)), "item 2: DO_JUMP to item 2 (allowed: another item from 1 to 2)"),
        (
            (item(1), item(2, JUMP, 1.0, -1.0)),
            "item 2: DO_JUMP repeats without end: its energy cannot be judged (allowed: a number of times)",
        ),
        (
            (item(1), item(2, JUMP, 1.0, 2500.0)),
            "its jumps make more than 2000 items of it (allowed: at most 2000)",
        ),
        (
            (item(1), item(2, SPLINE), item(3, JUMP, 1.0, 1.0)),
            "item 2: NAV_SPLINE_WAYPOINT is flown 2 times by DO_JUMP (allowed: once)",
        ),
        ((item(1, JUMP, 2.0, 1.0), item(2, JUMP, 1.0, 32767.0)), "its jumps make more than 2000 items of it"),
    ],
)
def test_what_cannot_be_judged_is_named(items: tuple[MissionItem, ...], why: str) -> None:
    with pytest.raises(MissionError) as error:
        check_jumps(Where(""), items)
    assert str(error.value).startswith(why)
