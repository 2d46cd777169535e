# SPDX-License-Identifier: GPL-3.0-or-later

"""DO_JUMP: what is flown how often, and what cannot be judged."""

from __future__ import annotations

import pytest

from mavproxy_handover.mission.errors import MissionError, Where
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.jumps import as_flown, check_jumps, endless_jumps

WAYPOINT, SPLINE, JUMP, TAG, TO_TAG = 16, 82, 177, 600, 601


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


def test_a_jump_within_a_jump_is_counted_anew_in_each_round() -> None:
    """ArduPilot forgets the count when a jump is done (unless MIS_OPTIONS keeps it)."""
    route = (item(1), item(2, JUMP, 1.0, 1.0), item(3), item(4, JUMP, 1.0, 1.0), item(5))
    assert numbers(*route) == [1, 1, 3, 1, 1, 3, 5]


def test_a_jump_to_a_tag_goes_to_the_first_tag_of_that_number() -> None:
    route = (item(1), item(2, TAG, 7.0), item(3), item(4, TAG, 7.0), item(5, TO_TAG, 7.0, 1.0), item(6))
    assert numbers(*route) == [1, 2, 3, 4, 2, 3, 4, 6]


def test_a_jump_without_end_is_walked_once_and_nothing_after_it() -> None:
    route = (item(1), item(2), item(3, JUMP, 1.0, -1.0), item(4))
    assert numbers(*route) == [1, 2, 1]
    check_jumps(Where(""), route, endless=True)
    assert [each.seq for each in endless_jumps(route)] == [3]


def test_a_jump_with_another_number_below_zero_is_never_made() -> None:
    assert numbers(item(1), item(2, JUMP, 1.0, -2.0), item(3)) == [1, 3]


def test_a_curve_may_be_flown_again() -> None:
    check_jumps(Where(""), (item(1), item(2, SPLINE), item(3, JUMP, 1.0, 1.0)))


@pytest.mark.parametrize(
    ("items", "why"),
    [
        ((item(1), item(2, JUMP, 3.0, 1.0)), "item 2: DO_JUMP to item 3 (allowed: another item from 1 to 2)"),
        ((item(1), item(2, JUMP, 2.0, 1.0)), "item 2: DO_JUMP to item 2 (allowed: another item from 1 to 2)"),
        (
            (item(1), item(2, JUMP, 1.0, -1.0)),
            "item 2: DO_JUMP repeats without end: its energy cannot be judged (allowed: a number of times, or "
            "'endless_jump = true' in the mission)",
        ),
        (
            (item(1), item(2, JUMP, 1.0, 2500.0)),
            "its jumps make more than 2000 items of it (allowed: at most 2000)",
        ),
        (
            (item(1), item(2, TO_TAG, 5.0, 1.0)),
            "item 2: DO_JUMP_TAG to tag 5 (allowed: the number of a JUMP_TAG of the mission)",
        ),
        ((item(1, JUMP, 2.0, 1.0), item(2, JUMP, 1.0, 32767.0)), "its jumps make more than 2000 items of it"),
    ],
)
def test_what_cannot_be_judged_is_named(items: tuple[MissionItem, ...], why: str) -> None:
    with pytest.raises(MissionError) as error:
        check_jumps(Where(""), items)
    assert str(error.value).startswith(why)
