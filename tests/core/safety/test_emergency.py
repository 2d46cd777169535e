# SPDX-License-Identifier: GPL-3.0-or-later

"""What of the safety decisions is news: each emergency once, what turns worse again, and the end."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, Reason
from mavproxy_handover.core.safety.emergency import Emergency, News
from mavproxy_handover.core.safety.strategy import Decision, Fact

LOST, OUT, ENDS, GUARD = Cause.COMMANDER_LOST, Cause.OUT_OF_COVERAGE, Cause.COVERAGE_ENDS, Cause.GUARD_LOST
RETURN = Decision(FlightAction.RETURN, LOST)
WARN = Decision(FlightAction.WARN, LOST)
HOLD = Decision(FlightAction.HOLD, ENDS)
GROUND = frozenset({Fact.AUTOPILOT, Fact.PLACE})
ALOFT = GROUND | {Fact.FLYING}
STEADY = ALOFT | {Fact.MAY_HOLD}


def decisions(news: list[News | None]) -> list[Decision | str | None]:
    return [None if each is None else each.decision or "over" for each in news]


def test_each_emergency_is_news_once_and_so_is_its_end() -> None:
    emergency = Emergency(Limits())
    signs = [set(), {LOST}, {LOST}, set(), set(), {LOST}]
    told = [emergency.judge(each, ALOFT, 100.0 + at) for at, each in enumerate(signs)]
    assert decisions(told) == [None, RETURN, None, "over", None, RETURN]


def test_news_says_why_and_whether_something_is_commanded() -> None:
    emergency = Emergency(Limits())
    assert emergency.judge({LOST}, GROUND, 100.0) == News(WARN, None)
    news = emergency.judge({LOST}, ALOFT, 101.0)
    assert news == News(RETURN, WARN, grave=True)
    assert (news.reason, news.warning, News(WARN, None).warning) == (Reason.COMMANDER_LOST, False, True)
    over = emergency.judge(set(), ALOFT, 102.0)
    assert over == News(None, RETURN, grave=True)
    assert (over.reason, over.warning, over.resumes) == (Reason.NONE, True, False)


def test_what_was_a_warning_on_the_ground_takes_off() -> None:
    emergency = Emergency(Limits())
    told = [emergency.judge({LOST}, facts, 100.0) for facts in (GROUND, ALOFT, GROUND)]
    assert decisions(told) == [WARN, RETURN, None]


def test_after_the_landing_the_same_cause_is_no_news_and_in_the_next_flight_it_is() -> None:
    emergency = Emergency(Limits())
    emergency.judge({LOST}, ALOFT, 100.0)
    emergency.landed()
    assert decisions([emergency.judge({LOST}, facts, 101.0) for facts in (GROUND, ALOFT)]) == [None, RETURN]


def test_while_it_is_not_known_that_nothing_is_wrong_no_emergency_ends() -> None:
    emergency = Emergency(Limits())
    emergency.resume()
    assert emergency.judge(set(), ALOFT, 100.0, certain=False) is None
    assert emergency.judge(set(), ALOFT, 101.0) == News(None, None, grave=True)
    assert emergency.judge(set(), ALOFT, 102.0) is None


def test_what_is_wrong_is_wrong_while_that_is_not_known() -> None:
    emergency = Emergency(Limits())
    emergency.resume()
    emergency.judge({OUT}, ALOFT, 100.0, certain=False)
    assert decisions([emergency.judge({OUT}, ALOFT, 101.0, certain=False)]) == [Decision(FlightAction.RETURN, OUT)]


def test_the_end_of_a_hold_off_is_due_until_it_was_judged() -> None:
    emergency = Emergency(Limits(hold_off_s={OUT: 0.7}))
    assert emergency.due_at() is None
    emergency.judge({OUT}, ALOFT, 0.1)
    assert emergency.due_at() == 0.1 + 0.7
    assert emergency.judge({OUT}, ALOFT, 0.1 + 0.7) is not None
    assert emergency.due_at() is None


def test_who_is_about_to_have_a_commander_is_in_no_emergency() -> None:
    emergency = Emergency(Limits())
    assert emergency.judge({LOST}, ALOFT | {Fact.SUCCESSOR}, 100.0) is None
    assert emergency.told is None
    assert decisions([emergency.judge({LOST}, ALOFT, 102.0)]) == [RETURN]
    assert emergency.judge({LOST}, ALOFT | {Fact.SUCCESSOR}, 103.0) is None
    assert emergency.told == RETURN


def test_a_gap_is_crossed_when_a_station_is_about_to_take_the_aircraft() -> None:
    """It is of the same cause, which goes on until that station has it."""
    emergency = Emergency(Limits())
    crosses = Decision(FlightAction.CONTINUE, LOST)
    assert emergency.judge({LOST}, ALOFT | {Fact.GAP}, 100.0) == News(crosses, None)
    news = emergency.judge({LOST}, ALOFT | {Fact.SUCCESSOR}, 101.0)
    assert news == News(None, crosses)
    assert news.crossed
    assert emergency.judge({LOST}, ALOFT | {Fact.SUCCESSOR}, 102.0) is None


def test_what_goes_on_is_not_over_while_another_is_waited_out() -> None:
    """The fault: "ALL CLEAR", and it was lost still, because the commander was lost beside that and another
    station about to take the aircraft."""
    emergency = Emergency(Limits())
    emergency.judge({GUARD}, ALOFT, 100.0)
    told = Decision(FlightAction.WARN, GUARD)
    assert emergency.judge({GUARD}, ALOFT, 103.0) == News(told, None)
    assert emergency.judge({GUARD, LOST}, ALOFT | {Fact.SUCCESSOR}, 104.0) is None
    assert emergency.told == told
    assert emergency.judge({GUARD}, ALOFT, 105.0) is None
    emergency.judge(set(), ALOFT, 106.0)
    assert decisions([emergency.judge(set(), ALOFT, 120.0)]) == ["over"]


def test_an_emergency_whose_cause_is_gone_is_over_while_another_is_waited_out() -> None:
    emergency = Emergency(Limits())
    emergency.judge({OUT}, ALOFT, 100.0)
    emergency.judge({OUT}, ALOFT, 101.0)
    assert decisions([emergency.judge({LOST}, ALOFT | {Fact.SUCCESSOR}, 102.0)]) == ["over"]


def test_what_was_held_goes_on_when_nothing_holds_it_any_more() -> None:
    emergency = Emergency(Limits())
    assert emergency.judge({ENDS}, STEADY, 100.0) == News(HOLD, None, grave=True)
    over = emergency.judge(set(), STEADY, 110.0)
    assert over == News(None, HOLD, grave=True)
    assert over.resumes


def test_what_was_held_and_comes_home_does_not_go_on_first() -> None:
    emergency = Emergency(Limits())
    emergency.judge({ENDS}, STEADY, 100.0)
    news = emergency.judge({ENDS}, ALOFT, 160.0)
    assert news == News(Decision(FlightAction.RETURN, ENDS), HOLD, grave=True)
    assert not news.resumes


def test_what_is_only_warned_of_by_now_ends_a_hold() -> None:
    emergency = Emergency(Limits())
    emergency.judge({ENDS}, STEADY, 100.0)
    news = emergency.judge({ENDS}, STEADY | {Fact.PILOT}, 101.0)
    assert news == News(Decision(FlightAction.WARN, ENDS), HOLD, grave=True)


def test_a_graver_action_is_told_again_of_another_cause_and_a_milder_one_is_not() -> None:
    emergency = Emergency(Limits())
    emergency.judge({LOST, GUARD}, ALOFT, 100.0)
    assert emergency.judge({LOST, GUARD}, ALOFT, 110.0) is None
    assert emergency.told == RETURN
    # what is left is told when the graver cause is gone
    assert decisions([emergency.judge({GUARD}, ALOFT, 120.0)]) == [Decision(FlightAction.WARN, GUARD)]


def test_the_end_of_a_warning_is_the_end_of_no_emergency() -> None:
    emergency = Emergency(Limits())
    emergency.judge({GUARD}, ALOFT, 100.0)
    assert emergency.judge({GUARD}, ALOFT, 103.0) == News(Decision(FlightAction.WARN, GUARD), None)
    emergency.judge(set(), ALOFT, 110.0)
    assert emergency.judge(set(), ALOFT, 111.0) == News(None, Decision(FlightAction.WARN, GUARD))


def test_a_cause_that_is_off_is_none() -> None:
    emergency = Emergency(Limits(policies={ENDS: "off"}))
    assert emergency.judge({ENDS}, STEADY, 100.0) is None


def test_a_mission_without_a_policy_leaves_the_one_in_force() -> None:
    emergency = Emergency(Limits(policies={OUT: "land"}))
    emergency.set_policy(None)
    assert emergency.out_of_coverage == "land"
    emergency.set_policy("warn")
    assert emergency.out_of_coverage == "warn"
    emergency.judge({OUT}, ALOFT, 100.0)
    assert decisions([emergency.judge({OUT}, ALOFT, 101.0)]) == [Decision(FlightAction.WARN, OUT)]


W, _, H, C, R, L = FlightAction
#: the decision (None: nothing is wrong), the one before it -> whether it warns, holds, resumes, continues, has crossed
NEWS = {
    (None, None): (True, False, False, False, False),
    (None, W): (True, False, False, False, False),
    (None, H): (True, False, True, False, False),
    (None, C): (True, False, False, False, True),
    (None, R): (True, False, False, False, False),
    (W, None): (True, False, False, False, False),
    (W, H): (True, False, True, False, False),
    (W, C): (True, False, False, False, False),
    (H, None): (False, True, False, False, False),
    (H, W): (False, True, False, False, False),
    (H, H): (False, True, False, False, False),  # for another cause
    (C, None): (False, False, False, True, False),
    (C, H): (False, False, True, True, False),
    (R, None): (False, False, False, False, False),
    (R, H): (False, False, False, False, False),
    (R, C): (False, False, False, False, False),
    (L, H): (False, False, False, False, False),
    (L, R): (False, False, False, False, False),
}


@pytest.mark.parametrize(("action", "before"), NEWS, ids=lambda each: "none" if each is None else each.name)
def test_what_news_comes_to(action: FlightAction | None, before: FlightAction | None) -> None:
    decision, told = (None if each is None else Decision(each, ENDS) for each in (action, before))
    news = News(decision, told)
    found = (news.warning, news.holds, news.resumes, news.continues, news.crossed)
    assert found == NEWS[action, before]


def test_what_another_hand_holds_back_is_not_ended() -> None:
    assert not News(Decision(W, ENDS, Fact.PILOT, Fact.PILOT), HOLD).resumes
    assert News(Decision(W, ENDS), HOLD).resumes


def test_a_return_and_a_landing_bring_it_down_and_nothing_else() -> None:
    emergency = Emergency(Limits(policies={LOST: "land"}))
    assert not emergency.brings_down
    emergency.judge({ENDS}, STEADY, 100.0)
    assert (emergency.decision, emergency.brings_down) == (HOLD, False)
    emergency.judge({ENDS}, ALOFT, 101.0)
    assert emergency.brings_down
    emergency.judge({LOST}, ALOFT, 102.0)
    assert (emergency.decision, emergency.brings_down) == (Decision(L, LOST), True)


def test_what_lasts_as_long_as_the_flight_ends_with_it_and_so_does_its_decision() -> None:
    energy = Cause.ENERGY
    emergency = Emergency(Limits())
    emergency.judge({energy}, ALOFT, 100.0)
    emergency.judge({energy}, ALOFT, 102.0)
    assert emergency.causes == {energy}
    emergency.landed()
    assert (emergency.causes, emergency.decision) == (frozenset(), None)
    assert decisions([emergency.judge(set(), GROUND, 103.0)]) == ["over"]


def test_to_fly_on_through_a_gap_is_no_emergency_and_its_end_is_news() -> None:
    emergency = Emergency(Limits(policies={LOST: "warn"}))
    assert emergency.judge({LOST}, ALOFT | {Fact.GAP}, 100.0) == News(Decision(C, LOST), None, grave=False)
    assert emergency.judge({LOST}, ALOFT, 160.0) == News(WARN, Decision(C, LOST), grave=False)


def test_what_was_grave_once_is_not_for_ever() -> None:
    emergency = Emergency(Limits(hold_off_s={GUARD: 0.0}, clear_s={GUARD: 0.0}))
    emergency.judge({LOST}, ALOFT, 100.0)
    assert emergency.judge(set(), ALOFT, 101.0) == News(None, RETURN, grave=True)
    assert emergency.judge({GUARD}, ALOFT, 102.0) == News(Decision(W, GUARD), None, grave=False)
    assert emergency.judge(set(), ALOFT, 103.0) == News(None, Decision(W, GUARD), grave=False)


def test_who_is_held_stays_held_while_a_station_is_about_to_take_it() -> None:
    emergency = Emergency(Limits())
    emergency.judge({ENDS}, STEADY, 100.0)
    assert emergency.judge({LOST}, ALOFT | {Fact.SUCCESSOR}, 101.0) is None
    assert emergency.told == HOLD
    over = emergency.judge(set(), ALOFT, 102.0)
    assert over is not None
    assert over.resumes


def test_what_lasts_as_long_as_the_flight_is_left_to_the_next_run_and_nothing_else() -> None:
    emergency = Emergency(Limits())
    emergency.judge({Cause.ENERGY, OUT}, ALOFT, 100.0)
    emergency.judge({Cause.ENERGY, OUT}, ALOFT, 102.0)
    assert emergency.causes == {Cause.ENERGY, OUT}
    assert emergency.lasting == (Cause.ENERGY,)


def test_an_order_that_the_commander_overrules_counts_as_a_warning() -> None:
    emergency = Emergency(Limits())
    emergency.overrule(ALOFT)
    assert emergency.told is None
    emergency.judge({LOST}, ALOFT, 100.0)
    emergency.overrule(ALOFT)
    assert emergency.told == WARN


class TestOrderThatNeedNotShowYet:
    """Until an order shows, or its time is over, nothing milder is news."""

    def test_the_end_of_the_cause_waits_for_it(self) -> None:
        emergency = Emergency(Limits())
        assert emergency.judge({LOST}, ALOFT, 100.0, unshown=FlightAction.LAND) is None
        assert decisions([emergency.judge({LOST}, ALOFT, 101.0)]) == [RETURN]
        assert emergency.judge(set(), ALOFT, 102.0, unshown=FlightAction.RETURN) is None
        assert decisions([emergency.judge(set(), ALOFT, 103.0)]) == ["over"]

    def test_a_warning_waits_and_the_same_order_or_a_graver_one_does_not(self) -> None:
        warning, order = Emergency(Limits(policies={LOST: "warn"})), Emergency(Limits())
        assert warning.judge({LOST}, ALOFT, 100.0, unshown=FlightAction.RETURN) is None
        assert decisions([order.judge({LOST}, ALOFT, 100.0, unshown=FlightAction.RETURN)]) == [RETURN]


@pytest.mark.parametrize(("stands", "told"), [(True, None), (False, "over")])
def test_an_aircraft_that_still_stands_is_not_let_go_for_a_station_that_may_take_it(
    stands: bool, told: str | None
) -> None:
    emergency = Emergency(Limits())
    emergency.judge({ENDS}, STEADY, 100.0)
    assert decisions([emergency.judge({ENDS}, ALOFT, 160.0)]) == [Decision(FlightAction.RETURN, ENDS)]
    assert decisions([emergency.judge({LOST}, ALOFT | {Fact.SUCCESSOR}, 161.0, stands=stands)]) == [told]
