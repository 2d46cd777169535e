# SPDX-License-Identifier: GPL-3.0-or-later

"""The commander's word ends what was ordered for what is wrong by then, and for nothing else.

The fault, found by a campaign (flight 1118681): an operator sent the aircraft on that had turned back for its energy.
The return went on being what is decided, though nobody commanded it any more, and was graver than anything that came
later: the aircraft was flown out of its commander's zone, past the border where it would have been held, and would have
been flown out of every zone.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    ConditionsSeen,
    Fly,
    LinkJudged,
    ModeSeen,
    ModeSourceSeen,
    MotionSeen,
    PlaceJudged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource, Reason
from mavproxy_handover.core.safety.strategy import Fact, decide
from mavproxy_handover.vehicle.profiles import QUADPLANE
from tests.core.bench import A, B, Bench, inside, outside
from tests.core.safety.test_conditions import ends
from tests.core.safety.test_decision_executor import (
    AUTO,
    HOLD,
    HOMEWARD,
    LAND,
    LOITER,
    RTL,
    aloft,
    said,
    taken_by_b,
    with_radio,
)

BACK = Fly(FlightAction.RETURN, Reason.ENERGY)
DOWN = Fly(FlightAction.LAND, Reason.ENERGY)
OUT = Fly(FlightAction.RETURN, Reason.OUT_OF_COVERAGE)
WEAK = Fly(FlightAction.HOLD, Reason.LINK_QUALITY)
GUIDED = ModeSeen(ModeClass.GUIDED, "GUIDED")
PLACE = PlaceJudged("home", True, "900 m")


def overruled(limits: Limits | None = None) -> Bench:
    """It has turned back for its energy, and its commander has it fly its mission on."""
    bench = aloft(limits)
    bench.give(PLACE)
    bench.give(ConditionsSeen(energy=True))
    bench.run(3.0)
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(3.0)
    assert bench.flights() == [BACK]
    flies_on(bench)
    assert bench.flights() == [BACK]
    bench.log.clear()
    return bench


def flies_on(bench: Bench) -> None:
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.mode = AUTO
    bench.run(3.0)


def test_for_the_same_cause_nothing_is_commanded_and_nothing_told_any_more() -> None:
    bench = overruled()
    bench.give(replace(PLACE, name="rally 1"))
    bench.run(120.0)
    assert bench.flights() == []
    assert said(bench) == []


def test_it_is_held_at_the_border_all_the_same() -> None:
    bench = overruled()
    bench.position(ends(4.0), outside(B))
    assert bench.flights() == [HOLD]


def test_and_flies_on_when_another_station_has_it() -> None:
    bench = overruled()
    bench.position(ends(4.0), outside(B))
    bench.run(1.0)
    bench.facts = (inside(A), inside(B))
    bench.run(1.0)
    taken_by_b(bench)
    assert [flight.action for flight in bench.flights()] == [FlightAction.HOLD, FlightAction.CONTINUE]


def test_it_comes_home_from_outside_every_zone_all_the_same() -> None:
    bench = overruled()
    bench.facts = (outside(A), outside(B))
    bench.run(3.0)
    assert bench.flights() == [OUT]


def test_what_is_graver_of_the_same_cause_is_commanded() -> None:
    bench = overruled()
    bench.give(PlaceJudged("home", False))
    bench.run(1.0)
    assert bench.flights() == [DOWN]


def test_a_landing_that_was_overruled_is_not_ordered_again_as_a_return() -> None:
    bench = aloft()
    bench.give(PlaceJudged("home", False))
    bench.give(ConditionsSeen(energy=True))
    bench.run(3.0)
    bench.mode, bench.motion = LAND, MotionSeen(0.0, -1.0)
    bench.run(2.0)
    assert bench.flights() == [DOWN]
    flies_on(bench)
    bench.give(PLACE)
    bench.run(60.0)
    assert bench.flights() == [DOWN]


def test_a_cause_that_was_over_and_is_back_counts_anew() -> None:
    limits = Limits(policies={Cause.FENCE: "return"})
    bench = aloft(limits)
    bench.give(ConditionsSeen(fence=True))
    bench.run(2.0)
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(2.0)
    flies_on(bench)
    bench.give(ConditionsSeen())
    bench.run(5.0)
    bench.give(ConditionsSeen(fence=True))
    bench.run(2.0)
    fence = Fly(FlightAction.RETURN, Reason.FENCE)
    assert bench.flights() == [fence, fence]


@pytest.mark.parametrize(("hold_s", "later_s"), [(600.0, 3.0), (60.0, 70.0)], ids=["soon", "long after"])
def test_who_flies_out_of_a_hold_is_held_for_another_cause(hold_s: float, later_s: float) -> None:
    """COVERAGE_ENDS stands before LINKS_WEAK: of two that ask for the same the first was named, and was known.

    The time that the first hold had left is no matter of the second, though the word to fly on changed no mode.
    """
    bench = aloft(Limits(policies={Cause.LINKS_WEAK: "hold"}, hold_s=hold_s))
    bench.position(ends(4.0), outside(B))
    assert bench.flights() == [HOLD]
    bench.motion = replace(HOMEWARD, speed_mps=0.0)
    bench.facts = (inside(A), outside(B))
    bench.run(3.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.motion = HOMEWARD
    bench.run(later_s)
    assert bench.flights() == [HOLD]
    bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
    bench.run(15.0)
    assert bench.flights() == [HOLD, WEAK]


def test_what_a_pilot_could_steer_is_not_sent_on_for_the_commander() -> None:
    """He chose that mode himself, and his radio was away while it was held: whether it moves is his to say again."""
    bench = aloft(mode=with_radio(AUTO))
    bench.mode = with_radio(GUIDED)
    bench.run(3.0)
    bench.mode = GUIDED
    bench.position(ends(4.0), outside(B))
    bench.motion, bench.facts = replace(HOMEWARD, speed_mps=0.0), (inside(A), outside(B))
    bench.run(3.0)
    assert bench.flights() == [HOLD]
    bench.mode = with_radio(GUIDED)
    bench.run(2.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
    bench.mode = GUIDED
    bench.run(20.0)
    assert bench.flights() == [HOLD]


def test_what_was_wrong_beside_it_was_known_to_whoever_overruled_it() -> None:
    bench = aloft(Limits(policies={Cause.FENCE: "return"}))
    bench.give(PLACE)
    bench.give(ConditionsSeen(energy=True, fence=True))
    bench.run(5.0)
    assert [flight.action for flight in bench.flights()] == [FlightAction.RETURN] * len(bench.flights())
    ordered = len(bench.flights())
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(2.0)
    flies_on(bench)
    bench.run(60.0)
    assert len(bench.flights()) == ordered


def turned_back_by_a_failsafe() -> Bench:
    """It has been turned back for its energy, and a failsafe of the autopilot has taken that over."""
    bench = aloft()
    bench.give(PLACE)
    bench.give(ConditionsSeen(energy=True))
    bench.run(2.5)
    assert bench.flights() == [BACK]
    bench.give(ModeSourceSeen(ModeSource.FAILSAFE))
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(3.0)
    bench.log.clear()
    return bench


def test_what_a_failsafe_flew_is_overruled_as_well() -> None:
    """The fault: the order was the failsafe's by then, so nothing was overruled, and out of every zone nothing was
    ordered any more. Found by a campaign."""
    bench = turned_back_by_a_failsafe()
    flies_on(bench)
    bench.run(30.0)
    assert bench.flights() == []
    bench.facts = (outside(A), outside(B))
    bench.run(3.0)
    assert bench.flights() == [OUT]


def test_and_what_a_pilot_had_interrupted() -> None:
    """The fault: it was commanded again, against the commander's word."""
    bench = aloft(mode=with_radio(AUTO))
    bench.give(PLACE)
    bench.give(ConditionsSeen(energy=True))
    bench.run(3.0)
    bench.mode, bench.motion = with_radio(RTL), HOMEWARD
    bench.run(3.0)
    bench.mode = with_radio(LOITER)
    bench.run(3.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.mode = with_radio(AUTO)
    bench.run(60.0)
    assert bench.flights() == [BACK]
    bench.facts = (outside(A), outside(B))
    bench.run(3.0)
    assert bench.flights() == [BACK, OUT]


def test_and_what_the_autopilot_did_not_follow() -> None:
    bench = aloft(Limits(policies={Cause.FENCE: "return"}))
    bench.give(PLACE)
    bench.give(ConditionsSeen(fence=True))
    bench.run(16.0)
    assert DOWN.action in {flight.action for flight in bench.flights()}
    bench.log.clear()
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
    bench.mode = GUIDED
    bench.run(30.0)
    assert bench.flights() == []
    bench.facts = (outside(A), outside(B))
    bench.run(3.0)
    assert [flight.reason for flight in bench.flights()] == [Reason.OUT_OF_COVERAGE]


def passes_a_border(limits: Limits | None = None) -> Bench:
    """Held where coverage ends ahead, and sent on over that border by its commander."""
    bench = aloft(limits or Limits(hold_s=600.0))
    bench.position(ends(4.0), outside(B))
    bench.motion = replace(HOMEWARD, speed_mps=0.0)
    bench.facts = (inside(A), outside(B))  # it stands: no end is in sight
    bench.run(3.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
    bench.mode = GUIDED
    bench.run(30.0)  # and stands there, by his word
    assert bench.flights() == [HOLD]
    return bench


def test_the_border_that_it_is_sent_over_is_known_to_the_commander() -> None:
    bench = passes_a_border()
    bench.motion = HOMEWARD
    bench.facts = (ends(4.0), outside(B))
    bench.run(4.0)
    assert bench.flights() == [HOLD]


#: where it has enough more room than it had at that border (100 m)
AWAY = (inside(A, margin_m=150.0), outside(B))


def test_a_later_border_of_the_same_commander_is_another_one() -> None:
    """The fault: until another station had authority no border of its zone held the aircraft any more."""
    bench = passes_a_border()
    bench.motion = HOMEWARD
    bench.facts = (ends(4.0), outside(B))
    bench.run(2.0)
    bench.facts = AWAY  # it has turned away
    bench.run(2.0)
    bench.position(ends(4.0), outside(B))
    assert bench.flights() == [HOLD, HOLD]


@pytest.mark.parametrize("clear_s", [0.0, 5.0])
def test_so_is_one_that_comes_before_the_last_is_cleared_at_least_the_next_time(clear_s: float) -> None:
    bench = passes_a_border(Limits(hold_s=600.0, clear_s={Cause.COVERAGE_ENDS: clear_s}))
    bench.motion = HOMEWARD
    for _ in range(2):
        bench.position(*AWAY)
        bench.position(ends(4.0), outside(B))
        bench.facts = AWAY
        bench.run(20.0)
    bench.position(ends(4.0), outside(B))
    assert bench.flights()[1:2] == [HOLD]


def test_who_turns_away_or_flies_on_slowly_has_the_same_border_ahead() -> None:
    """Where an end is ahead goes by seconds: who is slow does not see it. What has wings turns away on each circle."""
    bench = passes_a_border()
    bench.motion = replace(HOMEWARD, speed_mps=1.5)
    for margin_m in (100.0, 149.0, 60.0, 20.0):
        bench.facts = (inside(A, margin_m=margin_m), outside(B))
        bench.run(30.0)
        bench.facts = (ends(4.0), outside(B))
        bench.run(1.0)
    assert bench.flights() == [HOLD]


def test_what_has_wings_is_away_by_a_circle_more() -> None:
    bench = passes_a_border()
    bench.handling, bench.circles_s, bench.circle_m = QUADPLANE.handling, 8.0, 120.0
    bench.motion = HOMEWARD
    for margin_m in (100.0, 389.0, 100.0):
        bench.facts = (inside(A, margin_m=margin_m), outside(B))
        bench.run(20.0)
    bench.position(ends(4.0), outside(B))
    assert bench.flights() == [HOLD]
    bench.position(inside(A, margin_m=391.0), outside(B))
    bench.position(ends(4.0), outside(B))
    assert bench.flights() == [HOLD, HOLD]


def test_a_hold_for_something_else_in_between_changes_nothing_of_that() -> None:
    bench = passes_a_border(Limits(policies={Cause.LINKS_WEAK: "hold"}, hold_s=600.0))
    bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
    bench.run(15.0)
    bench.give(LinkJudged(A, weak=False, attacked=False, text=""))
    bench.run(15.0)
    assert [fly.action for fly in bench.flights()][2:] == [FlightAction.CONTINUE]
    bench.motion = HOMEWARD
    bench.position(*AWAY)
    bench.position(ends(4.0), outside(B))
    assert bench.flights()[-1] == HOLD


def test_nor_does_a_border_that_is_only_warned_of() -> None:
    """That he knew as well when he had it fly on from another hold: it is over where it has turned away."""
    bench = aloft(Limits(policies={Cause.LINKS_WEAK: "hold", Cause.COVERAGE_ENDS: "warn"}, hold_s=600.0))
    bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
    bench.run(15.0)
    assert bench.flights() == [WEAK]
    bench.position(ends(4.0), outside(B))
    bench.run(1.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.run(3.0)
    assert said(bench)[-1].startswith("WARNING. The zone of GCSA ends")
    bench.give(LinkJudged(A, weak=False, attacked=False, text=""))
    bench.run(15.0)
    bench.position(*AWAY)
    assert said(bench)[-1] == "ALL CLEAR. Over: coverage ends ahead"


def test_a_border_that_is_only_warned_of_and_comes_after_the_word_stays_ahead() -> None:
    bench = aloft(Limits(policies={Cause.LINKS_WEAK: "hold", Cause.COVERAGE_ENDS: "warn"}, hold_s=600.0))
    bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
    bench.run(15.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.run(3.0)
    bench.position(ends(4.0), outside(B))
    bench.position(*AWAY)
    bench.run(1.0)
    assert Cause.COVERAGE_ENDS in bench.arbiter.causes


def test_a_border_that_comes_after_the_word_is_none_that_he_knew() -> None:
    """Sent on from another hold: what has it come home later by that border is not over because it turns away."""
    bench = aloft(Limits(policies={Cause.LINKS_WEAK: "hold", Cause.COVERAGE_ENDS: "return"}))
    bench.give(PLACE)
    bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
    bench.run(15.0)
    assert bench.flights() == [WEAK]
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.run(3.0)
    bench.position(ends(4.0), outside(B))
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.facts = AWAY
    bench.run(30.0)
    assert bench.flights() == [WEAK, Fly(FlightAction.RETURN, Reason.COVERAGE_ENDS)]
    assert not any("OVER" in text for text in said(bench))


def test_what_gets_graver_behind_the_word_lasts_wherever_it_flies() -> None:
    bench = aloft(Limits(policies={Cause.COVERAGE_ENDS: "return"}))
    bench.give(PLACE)
    bench.position(ends(4.0), outside(B))
    bench.mode, bench.motion, bench.facts = RTL, HOMEWARD, (inside(A), outside(B))
    bench.run(2.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.mode = AUTO
    bench.run(3.0)
    bench.give(replace(PLACE, reachable=False))
    bench.run(1.0)
    lands = Fly(FlightAction.LAND, Reason.COVERAGE_ENDS)
    assert bench.flights()[-1] == lands
    bench.mode, bench.motion, bench.facts = LAND, MotionSeen(0.0, -1.0), AWAY
    bench.run(10.0)
    assert bench.flights()[-1] == lands
    assert not any("OVER" in text for text in said(bench))


def test_whose_commander_is_lost_has_left_no_word() -> None:
    """The sign outlived the word: he was back, and it was held against what he had said, then brought home for it."""
    bench = passes_a_border()
    bench.alive = {B}
    bench.run(9.0)
    bench.alive = {A, B}
    bench.run(3.0)
    assert bench.flights().count(HOLD) == 1


def test_what_a_pilot_interrupts_is_over_with_its_cause_and_not_where_he_flies_it() -> None:
    """A return that he has given back is watched on."""
    bench = aloft(Limits(hold_s=4.0), mode=with_radio(AUTO))
    bench.alive = {A}
    bench.give(PLACE)
    bench.position(ends(4.0), outside(B))
    bench.motion, bench.facts = replace(HOMEWARD, speed_mps=0.0), (inside(A), outside(B))
    bench.run(5.0)
    bench.mode, bench.motion = with_radio(RTL), HOMEWARD
    bench.run(2.0)
    bench.mode = with_radio(LOITER)
    bench.run(3.0)
    bench.mode = with_radio(AUTO)
    bench.run(2.0)
    bench.mode, bench.facts = with_radio(RTL), AWAY
    bench.run(5.0)
    assert not any("OVER" in text for text in said(bench))
    bench.mode = ModeSeen(ModeClass.STOP, "BRAKE")
    bench.log.clear()
    bench.run(10.0)
    assert bench.flights()


def test_a_warning_is_told_beside_what_a_pilot_holds_back() -> None:
    bench = aloft(Limits(policies={Cause.OUT_OF_COVERAGE: "warn"}), mode=with_radio(LOITER))
    bench.alive = {A}
    bench.run(3.0)
    bench.position(ends(4.0), outside(B))
    bench.facts = (outside(A), outside(B))
    bench.run(20.0)
    assert any("Out of coverage" in text for text in said(bench))


def test_what_was_wrong_and_known_does_not_end_a_hold_that_only_waits_for_the_autopilot() -> None:
    """The fault: beside a plain warning a hold that was held back counted as over: CONTINUE, and the hold time anew."""
    bench = aloft(Limits(policies={Cause.ENERGY: "warn"}, hold_s=60.0))
    bench.give(ConditionsSeen(energy=True))
    bench.run(3.0)
    bench.position(ends(4.0), outside(B))
    held_at = bench.now
    bench.motion, bench.facts = replace(HOMEWARD, speed_mps=0.0), (inside(A), outside(B))
    bench.run(5.0)
    for _ in range(2):
        facts, bench.facts, bench.autopilot = bench.facts, None, False
        bench.run(8.0)
        assert bench.arbiter.snapshot().held_since == held_at
        bench.facts, bench.autopilot = facts, True
        bench.run(10.0)
    assert FlightAction.CONTINUE not in {flight.action for flight in bench.flights()}
    bench.run(30.0)
    back = [at for at, action in bench.log if isinstance(action, Fly) and action.action is FlightAction.RETURN]
    assert back[0] == pytest.approx(held_at + 60.0, abs=0.6)


@pytest.mark.parametrize(
    ("cause", "fact", "goes_on"),
    [
        (Cause.OUT_OF_COVERAGE, Fact.GAP, FlightAction.CONTINUE),
        (Cause.NO_STATION, Fact.SUCCESSOR, FlightAction.TRANSFER),
    ],
)
def test_what_lets_the_aircraft_go_on_is_none_of_what_was_overruled(
    cause: Cause, fact: Fact, goes_on: FlightAction
) -> None:
    """A landing that the commander would not have says nothing against a gap that is crossed, nor a transfer."""
    facts = {Fact.FLYING, Fact.AUTOPILOT, Fact.PLACE, fact}
    decision = decide({cause}, facts, {cause: "return"}, {cause: FlightAction.LAND})
    assert decision is not None
    assert decision.action is goes_on
    without = decide({cause}, facts - {fact}, {cause: "return"}, {cause: FlightAction.LAND})
    assert without is not None
    assert without.action is FlightAction.WARN
