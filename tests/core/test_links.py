# SPDX-License-Identifier: GPL-3.0-or-later

"""Which links are weak, since when, and for whom that is reason enough. What comes of it: `test_link_quality.py`."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.authority.links import Links
from mavproxy_handover.core.common.events import Action, LinkJudged, Record
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Reason

A, B, C = 251, 252, 253
LIMITS = Limits(link_weak_s=3.0, link_steady_s=30.0)


def judged(links: Links, station: int, now: float, *, weak: bool = False, attacked: bool = False) -> list[Action]:
    actions: list[Action] = []
    links.judged(LinkJudged(station, weak, attacked, "loss 40%"), "GCSX", now, actions)
    return actions


def weak_commander(now: float = 100.0) -> Links:
    links = Links(LIMITS)
    judged(links, A, now, weak=True)
    return links


@pytest.mark.parametrize(("now", "found"), [(100.0, []), (102.9, []), (103.0, [B, C]), (1000.0, [B, C])])
def test_the_commander_has_three_seconds_to_recover(now: float, found: list[int]) -> None:
    assert weak_commander().better(A, [B, C], now) == found


def test_a_commander_with_good_links_is_never_outdone() -> None:
    links = weak_commander()
    assert links.better(B, [A, C], 1000.0) == []
    judged(links, A, 101.0)
    assert links.better(A, [B, C], 1000.0) == []


def test_the_time_is_that_of_the_first_measurement_over_the_limit() -> None:
    links = weak_commander()
    judged(links, A, 102.0, weak=True)
    assert links.better(A, [B], 103.0) == [B]


def test_weak_again_the_time_begins_again() -> None:
    links = weak_commander()
    judged(links, A, 102.0)
    judged(links, A, 102.5, weak=True)
    assert links.better(A, [B], 105.4) == []
    assert links.better(A, [B], 105.5) == [B]


def test_of_two_candidates_the_one_that_is_weak_itself_is_left_out() -> None:
    links = weak_commander()
    judged(links, B, 101.0, weak=True)
    assert links.better(A, [B, C], 110.0) == [C]


@pytest.mark.parametrize(("now", "found"), [(131.9, [C]), (132.0, [B, C])])
def test_one_that_was_weak_has_to_be_good_for_half_a_minute(now: float, found: list[int]) -> None:
    links = weak_commander()
    judged(links, B, 101.0, weak=True)
    judged(links, B, 102.0)
    assert links.better(A, [B, C], now) == found


def test_what_is_told_is_the_change_and_why() -> None:
    links = Links(LIMITS)
    told = [judged(links, A, now, weak=weak) for now, weak in ((1.0, False), (2.0, True), (3.0, True), (4.0, False))]
    weak = Record("link_quality", "links of GCSX are weak: loss 40%", Reason.LINK_QUALITY, A)
    good = Record("link_quality", "links of GCSX are good again: loss 40%", Reason.LINK_QUALITY, A)
    assert told == [[], [weak], [], [good]]


def test_an_attack_is_told_when_it_begins_and_when_it_ends_and_makes_no_link_weak() -> None:
    links = Links(LIMITS)
    told = [judged(links, A, now, attacked=attacked) for now, attacked in ((1.0, True), (2.0, True), (3.0, False))]
    begun = Record("attack", "another sender speaks in the name of GCSX: loss 40%", Reason.AUTHENTICATION, A)
    ended = Record("attack", "another sender no longer speaks in the name of GCSX: loss 40%", Reason.AUTHENTICATION, A)
    assert told == [[begun], [], [ended]]
    assert links.better(A, [B], 1000.0) == []
