# SPDX-License-Identifier: GPL-3.0-or-later

"""Who flies: by the mode, and by who was heard of before it changed. Every expectation is written out."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.events import ModeSeen, ModeSourceSeen
from mavproxy_handover.core.common.model import ModeClass, ModeSource
from mavproxy_handover.core.safety.mode_source import Change, ModeTracker
from mavproxy_handover.core.safety.strategy import Fact

HANDS, AUTO, GUIDED, STOP = ModeClass.HANDS, ModeClass.MISSION, ModeClass.GUIDED, ModeClass.STOP
RTL, LAND, OTHER = ModeClass.RETURN, ModeClass.LAND, ModeClass.OTHER
#: time of the change
AT = 100.0


def flying(flown: ModeClass = AUTO, *, radio: bool = False) -> ModeTracker:
    """In the air in this mode since take-off."""
    helm = ModeTracker()
    helm.seen(ModeSeen(flown, radio=radio), False, 0.0)
    helm.seen(ModeSeen(flown, radio=radio), True, 1.0)
    return helm


def change(helm: ModeTracker, flown: ModeClass, *, radio: bool = False, at: float = AT) -> Change | None:
    return helm.seen(ModeSeen(flown, radio=radio), True, at)


#: who was heard of, with which mode (None: not known) -> the modes that he is believed to have chosen
EXPLAINS = {
    (ModeSource.COMPANION, None): {RTL, LAND},
    (ModeSource.COMMANDER, None): {HANDS, AUTO, GUIDED, STOP, RTL, LAND, OTHER},
    (ModeSource.COMMANDER, RTL): {RTL},
    (ModeSource.COMMANDER, HANDS): {HANDS},
    (ModeSource.GUARD, None): {RTL, LAND},
    (ModeSource.FAILSAFE, None): {RTL, LAND, STOP},
    (ModeSource.FAILSAFE, AUTO): {AUTO},
    (ModeSource.MISSION, None): {RTL},
}


@pytest.mark.parametrize("radio", [True, False], ids=["radio", "no radio"])
@pytest.mark.parametrize("flown", [HANDS, GUIDED, STOP, RTL, LAND, OTHER], ids=lambda flown: flown.name)
@pytest.mark.parametrize("heard", EXPLAINS, ids=lambda heard: heard[0].name)
def test_who_was_heard_of_has_chosen_what_he_can(
    heard: tuple[ModeSource, ModeClass | None], flown: ModeClass, radio: bool
) -> None:
    helm = flying(radio=radio)
    helm.note_source(ModeSourceSeen(*heard), AT - 4.9)
    change(helm, flown, radio=radio)
    helm.resolve_doubt(AT + 1.0)
    by_itself = flown in (RTL, LAND) or (flown is HANDS and heard == (ModeSource.FAILSAFE, None))
    unknown = ModeSource.PILOT if radio else ModeSource.FAILSAFE if by_itself else ModeSource.STRANGER
    assert helm.chosen_by is (heard[0] if flown in EXPLAINS[heard] else unknown)


@pytest.mark.parametrize(
    ("hand", "within_s"),
    [
        (ModeSource.COMPANION, 15.0),
        (ModeSource.COMMANDER, 5.0),
        (ModeSource.GUARD, 5.0),
        (ModeSource.FAILSAFE, 5.0),
        (ModeSource.MISSION, 5.0),
    ],
)
def test_what_was_long_ago_explains_nothing(hand: ModeSource, within_s: float) -> None:
    for earlier, found in ((within_s, hand), (within_s + 0.1, ModeSource.PILOT)):
        helm = flying(radio=True)
        helm.note_source(ModeSourceSeen(hand), AT - earlier)
        change(helm, RTL, radio=True)
        helm.resolve_doubt(AT + 1.0)
        assert helm.chosen_by is found


@pytest.mark.parametrize(("earlier_s", "found"), [(5.0, ModeSource.FAILSAFE), (5.1, ModeSource.STRANGER)])
def test_a_failsafe_of_long_ago_does_not_hover_by_hand(earlier_s: float, found: ModeSource) -> None:
    helm = flying()
    helm.note_source(ModeSourceSeen(ModeSource.FAILSAFE), AT - earlier_s)
    change(helm, HANDS)
    helm.resolve_doubt(AT + 1.0)
    assert helm.chosen_by is found


def test_a_word_may_come_behind_its_deed_and_until_then_nobody_is_fought() -> None:
    helm = flying(radio=True)
    assert change(helm, RTL, radio=True) is None
    assert helm.facts() == {Fact.PILOT, Fact.RETURNING}
    assert helm.due_at() == AT + 1.0
    assert helm.note_source(ModeSourceSeen(ModeSource.FAILSAFE), AT + 0.9) is Change.FAILSAFE
    assert helm.facts() == {Fact.FAILSAFE, Fact.RETURNING}
    assert helm.due_at() is None


def test_a_word_that_comes_later_changes_nothing() -> None:
    helm = flying(radio=True)
    change(helm, HANDS, radio=True)
    assert helm.resolve_doubt(AT + 0.99) is None
    assert helm.resolve_doubt(AT + 1.0) is Change.PILOT
    assert helm.resolve_doubt(AT + 1.1) is None
    assert helm.note_source(ModeSourceSeen(ModeSource.COMMANDER), AT + 1.2) is None
    assert helm.facts() == {Fact.PILOT}


#: the mode, chosen by -> facts, with a live radio and without
FACTS = {
    (HANDS, ModeSource.NOBODY): ({Fact.PILOT}, set()),
    (AUTO, ModeSource.NOBODY): (set(), set()),
    (RTL, ModeSource.NOBODY): ({Fact.RETURNING}, {Fact.RETURNING}),
    (LAND, ModeSource.NOBODY): ({Fact.LANDING}, {Fact.LANDING}),
    (HANDS, ModeSource.PILOT): ({Fact.PILOT}, set()),
    (AUTO, ModeSource.PILOT): ({Fact.PILOT}, set()),
    (RTL, ModeSource.PILOT): ({Fact.PILOT, Fact.RETURNING}, {Fact.RETURNING}),
    (LAND, ModeSource.PILOT): ({Fact.PILOT, Fact.LANDING}, {Fact.LANDING}),
    (HANDS, ModeSource.COMMANDER): (set(), set()),
    (RTL, ModeSource.COMMANDER): ({Fact.RETURNING}, {Fact.RETURNING}),
    (RTL, ModeSource.COMPANION): ({Fact.RETURNING}, {Fact.RETURNING}),
    (LAND, ModeSource.COMPANION): ({Fact.LANDING}, {Fact.LANDING}),
    (RTL, ModeSource.GUARD): ({Fact.RETURNING}, {Fact.RETURNING}),
    (RTL, ModeSource.FAILSAFE): ({Fact.FAILSAFE, Fact.RETURNING}, {Fact.FAILSAFE, Fact.RETURNING}),
    (LAND, ModeSource.FAILSAFE): ({Fact.FAILSAFE, Fact.LANDING}, {Fact.FAILSAFE, Fact.LANDING}),
    (HANDS, ModeSource.FAILSAFE): ({Fact.FAILSAFE}, {Fact.FAILSAFE}),
    (STOP, ModeSource.FAILSAFE): (set(), set()),
    (AUTO, ModeSource.FAILSAFE): (set(), set()),
    (RTL, ModeSource.MISSION): ({Fact.RETURNING}, {Fact.RETURNING}),
    (GUIDED, ModeSource.STRANGER): (set(), set()),
}


@pytest.mark.parametrize(("flown", "hand"), FACTS, ids=lambda value: value.name)
def test_what_it_comes_to(flown: ModeClass, hand: ModeSource) -> None:
    for radio, facts in zip((True, False), FACTS[flown, hand], strict=True):
        helm = flying(flown, radio=radio)
        helm.chosen_by = hand
        assert helm.facts() == facts


def test_what_a_failsafe_gives_back_is_no_pilots() -> None:
    """ArduPlane's short radio failsafe circles, and goes on with the mode of before."""
    helm = flying(radio=True)
    helm.note_source(ModeSourceSeen(ModeSource.FAILSAFE), AT)
    assert change(helm, STOP, at=AT) is Change.FAILSAFE
    helm.note_source(ModeSourceSeen(ModeSource.FAILSAFE, AUTO), AT + 3.0)
    assert change(helm, AUTO, radio=True, at=AT + 3.1) is Change.FAILSAFE
    assert helm.facts() == set()


def test_a_mission_that_lands_is_landing_and_so_is_the_end_of_a_return() -> None:
    helm = flying()
    helm.seen(ModeSeen(AUTO, landing=True), True, AT)
    assert helm.facts() == {Fact.LANDING}
    helm = flying(RTL)
    helm.seen(ModeSeen(RTL, landing=True), True, AT)
    assert helm.facts() == {Fact.LANDING}


def test_a_pilot_whose_radio_is_gone_flies_no_more_and_does_when_it_is_back() -> None:
    helm = flying(radio=True)
    change(helm, HANDS, radio=True)
    helm.resolve_doubt(AT + 1.0)
    for radio, facts in ((False, set()), (True, {Fact.PILOT})):
        helm.seen(ModeSeen(HANDS, radio=radio), True, AT + 2.0)
        assert helm.facts() == facts


def by_pilot(helm: ModeTracker, *modes: ModeClass) -> list[Change | None]:
    """The pilot turns his switch; each time it is known who it was."""
    found = []
    for number, flown in enumerate(modes):
        at = AT + 10.0 * number
        change(helm, flown, radio=True, at=at)
        found.append(helm.resolve_doubt(at + 1.0))
    return found


@pytest.mark.parametrize("back", [AUTO, GUIDED], ids=lambda flown: flown.name)
def test_he_gives_it_back_by_auto_or_guided_after_he_has_flown_by_hand(back: ModeClass) -> None:
    helm = flying(RTL, radio=True)
    assert by_pilot(helm, HANDS, back) == [Change.PILOT, Change.GIVEN_BACK]
    assert helm.facts() == set()


def test_to_choose_auto_instead_of_what_was_commanded_gives_nothing_back() -> None:
    helm = flying(RTL, radio=True)
    assert by_pilot(helm, AUTO, GUIDED) == [Change.PILOT, Change.PILOT]
    assert helm.facts() == {Fact.PILOT}


def test_whatever_is_chosen_on_the_ground_is_the_beginning_of_the_flight() -> None:
    helm = flying(RTL, radio=True)
    by_pilot(helm, HANDS)
    helm.seen(ModeSeen(AUTO, radio=True), False, 200.0)
    assert (helm.chosen_by, helm.facts()) == (ModeSource.NOBODY, set())
    helm.seen(ModeSeen(GUIDED, radio=True), True, 201.0)
    assert helm.chosen_by is ModeSource.NOBODY


def test_what_a_run_before_this_one_commanded_is_nobodys() -> None:
    helm = ModeTracker()
    helm.seen(ModeSeen(RTL, radio=True), True, AT)
    assert (helm.chosen_by, helm.facts()) == (ModeSource.NOBODY, {Fact.RETURNING})


def test_what_is_no_arducopter_has_no_mode_that_is_known() -> None:
    helm = ModeTracker()
    for at in (AT, AT + 1.0, AT + 2.0):
        helm.seen(ModeSeen(None, radio=True), True, at)
    assert (helm.chosen_by, helm.facts()) == (ModeSource.NOBODY, set())


def test_before_anything_was_heard_nobody_flies() -> None:
    helm = ModeTracker()
    assert (helm.facts(), helm.piloted, helm.radio, helm.due_at()) == (set(), False, False, None)


@pytest.mark.parametrize("back", [AUTO, GUIDED])
def test_a_moment_by_hand_gives_it_back_as_well(back: ModeClass) -> None:
    """Flight 1012580: his switch had left LOITER again before it was known whose that was, and AUTO counted as his for
    the rest of the flight: nothing was done any more."""
    helm = flying(radio=True)
    change(helm, HANDS, radio=True)
    assert change(helm, back, radio=True, at=AT + 0.9) is None
    assert helm.resolve_doubt(AT + 1.9) is Change.GIVEN_BACK
    assert not helm.piloted


def test_a_moment_in_a_return_gives_nothing_back() -> None:
    helm = flying(radio=True)
    change(helm, RTL, radio=True)
    assert change(helm, AUTO, radio=True, at=AT + 0.9) is None
    assert helm.resolve_doubt(AT + 1.9) is Change.PILOT
    assert helm.piloted


def test_who_took_off_by_hand_gives_it_back_like_any_pilot() -> None:
    """The fault: by AUTO in the air he had taken over, and for the whole mission nothing was done about anything."""
    helm = flying(HANDS, radio=True)
    assert helm.facts() == {Fact.PILOT}
    assert by_pilot(helm, AUTO) == [Change.GIVEN_BACK]
    assert helm.facts() == set()


def test_to_return_or_to_land_gives_nothing_back() -> None:
    for flown in (RTL, LAND, STOP, OTHER):
        helm = flying(AUTO, radio=True)
        assert by_pilot(helm, HANDS, flown) == [Change.PILOT, Change.PILOT]
        assert helm.chosen_by is ModeSource.PILOT


def test_auto_by_the_commander_gives_back_nothing_of_the_pilots_and_ends_his_flight() -> None:
    helm = flying(AUTO, radio=True)
    by_pilot(helm, HANDS)
    helm.note_source(ModeSourceSeen(ModeSource.COMMANDER, AUTO), AT + 9.0)
    assert change(helm, AUTO, radio=True, at=AT + 10.0) is Change.COMMANDER
    assert helm.facts() == set()


def test_hands_that_the_commander_chose_are_not_the_pilots_to_give_back() -> None:
    helm = flying(AUTO, radio=True)
    helm.note_source(ModeSourceSeen(ModeSource.COMMANDER, HANDS), AT - 1.0)
    assert change(helm, HANDS, radio=True) is Change.COMMANDER
    change(helm, AUTO, radio=True, at=AT + 10.0)
    assert helm.resolve_doubt(AT + 11.0) is Change.PILOT


@pytest.mark.parametrize(
    ("heard", "found"),
    [
        ([(ModeSource.COMMANDER, 4.0), (ModeSource.COMPANION, 3.0)], ModeSource.COMPANION),
        ([(ModeSource.COMMANDER, 3.0), (ModeSource.COMPANION, 4.0)], ModeSource.COMMANDER),
        ([(ModeSource.FAILSAFE, 3.0), (ModeSource.GUARD, 4.0)], ModeSource.FAILSAFE),
        ([(ModeSource.FAILSAFE, 4.0), (ModeSource.GUARD, 3.0)], ModeSource.GUARD),
        (
            [
                (ModeSource.FAILSAFE, 3.0),
                (ModeSource.GUARD, 3.0),
                (ModeSource.COMMANDER, 3.0),
                (ModeSource.COMPANION, 3.0),
            ],
            ModeSource.COMPANION,
        ),
        ([(ModeSource.FAILSAFE, 3.0), (ModeSource.GUARD, 3.0)], ModeSource.GUARD),
    ],
)
def test_of_those_who_may_have_it_was_who_was_heard_of_last_and_at_once_the_first_of_the_table(
    heard: list[tuple[ModeSource, float]], found: ModeSource
) -> None:
    helm = flying(radio=True)
    for hand, ago_s in heard:
        helm.note_source(ModeSourceSeen(hand), AT - ago_s)
    change(helm, RTL, radio=True)
    assert helm.chosen_by is found


def test_a_mode_that_becomes_known_in_the_air_was_chosen_by_nobody() -> None:
    helm = ModeTracker()
    helm.seen(ModeSeen(None, radio=True), True, 1.0)
    assert change(helm, RTL, radio=True) is None
    assert (helm.chosen_by, helm.facts()) == (ModeSource.NOBODY, {Fact.RETURNING})


# ---- the autopilot was not heard when it changed --------------------------------------------------------------------


@pytest.mark.parametrize("radio", [True, False], ids=["radio", "no radio"])
@pytest.mark.parametrize("flown", [RTL, LAND])
def test_a_return_that_began_while_the_autopilot_was_not_heard_is_the_guards(flown: ModeClass, radio: bool) -> None:
    """The fault: with a radio it was a pilot's, and else a failsafe's, so nothing graver was commanded any more."""
    helm = flying(radio=radio)
    assert helm.seen(ModeSeen(flown, radio=radio), True, AT, unheard=True) is None
    assert helm.resolve_doubt(AT + 1.0) is Change.UNHEARD
    assert helm.chosen_by is ModeSource.GUARD
    assert not helm.facts() & {Fact.PILOT, Fact.FAILSAFE}


@pytest.mark.parametrize(
    ("hand", "change"), [(ModeSource.COMMANDER, Change.COMMANDER), (ModeSource.FAILSAFE, Change.FAILSAFE)]
)
def test_unless_somebody_was_heard_of(hand: ModeSource, change: Change) -> None:
    helm = flying(radio=True)
    helm.note_source(ModeSourceSeen(hand), AT - 2.0)
    assert helm.seen(ModeSeen(RTL, radio=True), True, AT, unheard=True) is change


@pytest.mark.parametrize("flown", [AUTO, GUIDED])
def test_what_a_pilot_may_have_given_back_then_is_nobodys(flown: ModeClass) -> None:
    """The fault: a pilot who had flown by hand meanwhile was believed to have it still, in AUTO."""
    helm = flying(RTL, radio=True)
    helm.seen(ModeSeen(flown, radio=True), True, AT, unheard=True)
    assert helm.resolve_doubt(AT + 1.0) is Change.GIVEN_BACK
    assert helm.chosen_by is ModeSource.NOBODY
    assert not helm.piloted


@pytest.mark.parametrize("flown", [HANDS, STOP, OTHER])
def test_what_else_was_chosen_then_is_a_pilots_or_a_strangers(flown: ModeClass) -> None:
    for radio, hand in ((True, ModeSource.PILOT), (False, ModeSource.STRANGER)):
        helm = flying(radio=radio)
        helm.seen(ModeSeen(flown, radio=radio), True, AT, unheard=True)
        helm.resolve_doubt(AT + 1.0)
        assert helm.chosen_by is hand


def test_the_next_change_is_judged_by_itself() -> None:
    helm = flying(radio=True)
    helm.seen(ModeSeen(RTL, radio=True), True, AT, unheard=True)
    helm.resolve_doubt(AT + 1.0)
    change(helm, LAND, radio=True, at=AT + 20.0)
    helm.resolve_doubt(AT + 21.0)
    assert helm.chosen_by is ModeSource.PILOT


@pytest.mark.parametrize(
    ("ordered_first", "change"), [(True, Change.COMMANDER), (False, Change.OVERTAKEN)], ids=["order", "command"]
)
def test_a_command_from_before_the_order_does_not_overrule_it(ordered_first: bool, change: Change) -> None:
    mode = ModeTracker()
    mode.seen(ModeSeen(ModeClass.MISSION, "AUTO"), True, 99.0)
    if ordered_first:
        mode.ordered()
    mode.note_source(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED), 100.0)
    if not ordered_first:
        mode.ordered()
    assert mode.seen(ModeSeen(ModeClass.GUIDED, "GUIDED"), True, 100.5) is change


def test_a_report_of_another_source_does_not_make_an_old_command_a_new_one() -> None:
    mode = ModeTracker()
    mode.seen(ModeSeen(ModeClass.MISSION, "AUTO"), True, 99.0)
    mode.note_source(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED), 100.0)
    mode.ordered()
    mode.note_source(ModeSourceSeen(ModeSource.COMPANION), 100.0)
    assert mode.seen(ModeSeen(ModeClass.GUIDED, "GUIDED"), True, 100.5) is Change.OVERTAKEN
