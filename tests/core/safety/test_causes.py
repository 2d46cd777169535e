# SPDX-License-Identifier: GPL-3.0-or-later

"""When a sign is a cause, and when a cause is over."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.core.common.causes import CAUSES, POLICIES, Cause, CauseWatch, Ends
from tests.core.safety.ledger import EXPECTED

WEAK, GUARD, LOST, ENERGY = Cause.LINKS_WEAK, Cause.GUARD_LOST, Cause.COMMANDER_LOST, Cause.ENERGY


def test_the_table_is_what_the_page_says() -> None:
    assert {c.value: (r.hold_off_s, r.clear_s, r.ends is Ends.WITH_THE_FLIGHT) for c, r in CAUSES.items()} == {
        word: row.times for word, row in EXPECTED.items()
    }
    assert {c.value: row.policies for c, row in CAUSES.items()} == {
        word: tuple(row.asks) + (("off",) if row.off else ()) for word, row in EXPECTED.items()
    }


@pytest.mark.parametrize("cause", Cause)
def test_every_cause_has_policies_that_exist_and_can_warn_at_least(cause: Cause) -> None:
    policies = CAUSES[cause].policies
    assert set(policies) <= set(POLICIES)
    assert len(set(policies)) == len(policies)
    assert "warn" in policies


@pytest.mark.parametrize("cause", [Cause.COMMANDER_LOST, Cause.OUT_OF_COVERAGE])
def test_what_this_system_is_for_cannot_be_switched_off(cause: Cause) -> None:
    assert "off" not in CAUSES[cause].policies


def test_a_sign_without_a_hold_off_is_a_cause_at_once_and_over_at_once() -> None:
    watch = CauseWatch()
    assert watch.update({LOST}, 100.0) == {LOST}
    assert watch.update(set(), 100.1) == set()


def test_a_sign_is_a_cause_once_it_has_stayed() -> None:
    watch = CauseWatch()
    assert watch.update({GUARD}, 100.0) == set()
    assert watch.due_at() == 103.0
    assert watch.update({GUARD}, 102.9) == set()
    assert watch.update({GUARD}, 103.0) == {GUARD}


def test_a_sign_that_was_there_between_two_looks_only_counts_from_the_first() -> None:
    watch = CauseWatch()
    watch.update(set(), 100.0)
    assert watch.update({GUARD}, 110.0) == set()
    assert watch.due_at() == 113.0


def test_what_flickers_gets_through() -> None:
    """One second there, one away: the hold-off of three seconds fills by 0.75 s in two."""
    watch = CauseWatch()
    seen = []
    for second in range(9):
        seen.append(watch.update({GUARD} if second % 2 == 0 else set(), 100.0 + second))
    # filled: 0, 1, 0.75, 1.75, 1.5, 2.5, 2.25, 3.25 (no sign then), 3.0
    assert [GUARD in causes for causes in seen] == [False] * 8 + [True]


def test_what_happened_once_is_forgotten_at_a_quarter_of_the_pace() -> None:
    watch = CauseWatch()
    watch.update({GUARD}, 100.0)
    watch.update(set(), 102.0)  # two seconds of three
    watch.update({GUARD}, 106.0)  # one has run back in four
    assert watch.due_at() == 108.0
    watch.update(set(), 106.0)
    watch.update({GUARD}, 150.0)
    assert watch.due_at() == 153.0


def test_a_cause_is_over_when_its_sign_has_been_away() -> None:
    watch = CauseWatch()
    watch.update({WEAK}, 100.0)
    assert watch.update({WEAK}, 110.0) == {WEAK}
    assert watch.due_at() is None
    assert watch.update(set(), 120.0) == {WEAK}
    assert watch.due_at() == 130.0
    assert watch.update({WEAK}, 125.0) == {WEAK}
    assert watch.update(set(), 126.0) == {WEAK}
    assert watch.update(set(), 135.9) == {WEAK}
    assert watch.update(set(), 136.0) == set()
    assert watch.due_at() is None


def test_energy_does_not_come_back() -> None:
    watch = CauseWatch()
    watch.update({ENERGY}, 100.0)
    assert watch.update({ENERGY}, 102.0) == {ENERGY}
    assert watch.update(set(), 5000.0) == {ENERGY}
    watch.landed()
    assert watch.active == frozenset()
    assert watch.update(set(), 5001.0) == set()


def test_after_a_landing_what_is_wrong_on_the_ground_too_goes_on() -> None:
    watch = CauseWatch()
    watch.update({GUARD, LOST}, 100.0)
    watch.landed()
    assert watch.active == {LOST}
    assert watch.due_at() == 103.0


def test_hold_offs_and_clearing_may_be_others_than_the_tables() -> None:
    watch = CauseWatch(hold_off_s={LOST: 0.7}, clear_s={LOST: 2.0})
    # 0.1 + 0.7 is the moment that is handed out; counted as seconds since, it would be a rounding error away
    assert watch.update({LOST}, 0.1) == set()
    due = watch.due_at()
    assert due == 0.1 + 0.7
    assert watch.update({LOST}, due) == {LOST}
    assert watch.update(set(), 5.0) == {LOST}
    assert watch.update(set(), 7.0) == set()


def test_a_cause_that_is_off_is_none() -> None:
    watch = CauseWatch(off={LOST})
    assert watch.update({LOST, WEAK}, 100.0) == set()
    assert watch.update({LOST, WEAK}, 110.0) == {WEAK}


def test_a_clock_that_stands_or_goes_back_fills_nothing() -> None:
    watch = CauseWatch()
    watch.update({GUARD}, 100.0)
    for _ in range(100):
        assert watch.update({GUARD}, 100.0) == set()
    assert watch.update({GUARD}, 90.0) == set()
    assert watch.update(set(), 90.0) == set()
    assert watch.update({GUARD}, 100.0) == set()
    assert watch.update({GUARD}, 102.9) == set()
    assert watch.update({GUARD}, 103.0) == {GUARD}


@given(st.lists(st.tuples(st.sets(st.sampled_from(Cause)), st.floats(0.0, 20.0)), max_size=40))
def test_whatever_comes_a_cause_has_had_its_sign_and_due_is_never_behind(
    looks: list[tuple[set[Cause], float]],
) -> None:
    watch, now, signs_so_far = CauseWatch(), 0.0, set[Cause]()
    for signs, step in looks:
        now += step
        signs_so_far |= signs
        active = watch.update(signs, now)
        assert active <= signs_so_far
        assert {cause for cause in signs if CAUSES[cause].hold_off_s == 0.0} <= active
        due = watch.due_at()
        assert due is None or due > now
        assert due is None or due <= now + 30.0


def test_causes_of_the_run_before_go_on_without_a_hold_off_unless_they_are_off() -> None:
    watch = CauseWatch({Cause.FENCE})
    watch.resume({Cause.ENERGY, Cause.FENCE})
    assert watch.update(set(), 100.0) == {Cause.ENERGY}


def test_the_next_time_of_several_is_due_first() -> None:
    watch = CauseWatch(hold_off_s={Cause.ENERGY: 2.0, Cause.GUARD_LOST: 5.0, Cause.FENCE: 3.0})
    watch.update({Cause.ENERGY, Cause.GUARD_LOST, Cause.FENCE}, 100.0)
    assert watch.due_at() == 102.0
