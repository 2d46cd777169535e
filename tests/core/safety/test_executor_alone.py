# SPDX-License-Identifier: GPL-3.0-or-later

"""What a decision and a change of the flight mode do to orders, with an authority that says what the test wants."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    Announce,
    AutopilotState,
    Fly,
    GuardSeen,
    ModeSeen,
    ModeSourceSeen,
    MotionSeen,
    PlaceJudged,
    Record,
)
from mavproxy_handover.core.common.handling import CIRCLES
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GuardState, ModeClass, ModeSource, Reason
from mavproxy_handover.core.safety.strategy import Decision
from tests.core.safety.test_safety import ENDS, HOLD, LEFT, NOW, RETURN, Bench, held

CONTINUE, WARN = FlightAction.CONTINUE, FlightAction.WARN
HANDS, AUTO, GUIDED, RTL = ModeClass.HANDS, ModeClass.MISSION, ModeClass.GUIDED, ModeClass.RETURN
NAMES = {HANDS: "STABILIZE", AUTO: "AUTO", GUIDED: "GUIDED", RTL: "RTL"}


def changes(bench: Bench, mode: ModeClass, *, radio: bool = False, now: float = 101.0) -> list[str]:
    """Report a mode change and, one second later, decide who changed the mode. Returns the texts of it."""
    bench.says(now)
    bench.safety.handle(ModeSeen(mode, NAMES[mode], radio=radio), now, bench.actions)
    bench.says(now + 1.0)
    bench.safety.executor.resolve_doubt(now + 1.0, bench.actions)
    return told(bench)


def told(bench: Bench) -> list[str]:
    texts = [action.text for action in bench.actions if isinstance(action, Announce)]
    bench.actions[:] = [action for action in bench.actions if not isinstance(action, Announce)]
    return texts


def helm(bench: Bench) -> list[str]:
    return [action.text for action in bench.actions if isinstance(action, Record) and action.event == "helm"]


def flown(bench: Bench) -> list[FlightAction]:
    return [action.action for action in bench.actions if isinstance(action, Fly)]


def on_mission() -> Bench:
    bench = Bench()
    bench.fly(AUTO)
    return bench


def held_bench() -> Bench:
    bench = held()
    assert flown(bench) == [HOLD]
    bench.actions.clear()
    return bench


class TestPilot:
    def test_a_pilot_that_takes_over_ends_the_order(self) -> None:
        bench = held_bench()
        assert changes(bench, HANDS, radio=True) == [
            "PILOT: a pilot has taken over, STABILIZE; HOLD is not commanded any more (coverage ends ahead)"
        ]
        assert helm(bench) == ["STABILIZE: a pilot has taken over"]
        assert (bench.safety.verification.order, bench.safety.held_since) == (None, None)
        assert bench.safety.hold_timer.held_at == -inf
        assert bench.safety.executor.held_for is None

    def test_without_an_order_only_that_is_told_and_so_is_its_end(self) -> None:
        bench = on_mission()
        assert changes(bench, HANDS, radio=True) == ["PILOT: a pilot has taken over, STABILIZE"]
        assert changes(bench, AUTO, radio=True, now=110.0) == ["PILOT: the pilot has given it back, AUTO"]
        assert helm(bench)[-1] == "AUTO: the pilot has given it back"


class TestOthers:
    def test_a_failsafe_that_ends_an_order_is_told(self) -> None:
        bench = held_bench()
        assert changes(bench, RTL) == [
            "RTL: a failsafe of the autopilot acts; HOLD is not commanded any more (coverage ends ahead)"
        ]
        assert bench.safety.held_since is None

    def test_without_an_order_it_is_journalled_only(self) -> None:
        bench = on_mission()
        assert changes(bench, RTL) == []
        assert helm(bench) == ["RTL: a failsafe of the autopilot acts"]

    def test_a_mode_that_was_chosen_while_the_autopilot_was_not_heard(self) -> None:
        bench = on_mission()
        bench.safety.handle(ModeSeen(RTL, "RTL"), 110.0, bench.actions)
        bench.says(111.0)
        bench.safety.executor.resolve_doubt(111.0, bench.actions)
        assert helm(bench) == ["RTL: chosen while the autopilot was not heard"]


class TestCommander:
    def commands(self, bench: Bench, mode: ModeClass | None) -> None:
        bench.safety.handle(ModeSourceSeen(ModeSource.COMMANDER, mode), 101.0, bench.actions)

    def test_a_command_ends_the_hold_and_overrules_it(self) -> None:
        bench = held_bench()
        self.commands(bench, GUIDED)
        assert (bench.safety.verification.order, bench.safety.held_since) == (None, None)
        assert bench.safety.emergency.told == Decision(WARN, Cause.COVERAGE_ENDS)
        assert bench.safety.conditions.passed_at_m == 60.0
        assert bench.safety.hold_timer.held_at == -inf
        assert bench.safety.executor.held_for is None

    def test_the_mode_that_is_flown_commanded_again_sends_the_aircraft_on(self) -> None:
        bench = held_bench()
        self.commands(bench, AUTO)
        assert (bench.safety.verification.order, bench.safety.verification.stands) == (CONTINUE, True)

    def test_a_command_without_an_order_changes_no_time(self) -> None:
        bench = on_mission()
        bench.safety.hold_timer.held_at = 99.0
        self.commands(bench, GUIDED)
        assert bench.safety.hold_timer.held_at == 99.0

    def test_the_mode_that_it_chose_is_told_by_its_name_when_it_ends_an_order(self) -> None:
        bench = Bench(Limits(policies={Cause.GUARD_LOST: "return"}, hold_off_s={Cause.GUARD_LOST: 0.0}))
        bench.fly(AUTO)
        bench.flight.guard_said(GuardSeen(GuardState.DISABLED, ours=True), NOW)
        bench.judge(NOW)
        assert flown(bench) == [RETURN]
        bench.safety.handle(ModeSeen(RTL, "RTL"), 100.5, bench.actions)
        told(bench)
        self.commands(bench, GUIDED)
        assert changes(bench, GUIDED) == ["GUIDED: chosen by GCSA; RETURN is not commanded any more (guard lost)"]
        assert bench.safety.emergency.told == Decision(WARN, Cause.GUARD_LOST)

    def test_an_order_that_a_pilot_held_back_is_overruled_too(self) -> None:
        bench = Bench(Limits(policies={Cause.GUARD_LOST: "return"}, hold_off_s={Cause.GUARD_LOST: 0.0}))
        bench.fly(AUTO)
        changes(bench, HANDS, radio=True)
        bench.flight.guard_said(GuardSeen(GuardState.DISABLED, ours=True), 102.0)
        bench.judge(102.0)
        assert bench.safety.emergency.told == Decision(WARN, Cause.GUARD_LOST)
        self.commands(bench, GUIDED)
        bench.safety.handle(ModeSeen(GUIDED, "GUIDED"), 102.5, bench.actions)
        bench.flight.guard_said(GuardSeen(GuardState.DISABLED, ours=True), 103.0)
        bench.judge(103.0)
        assert flown(bench) == []

    def test_a_warning_is_nothing_to_overrule(self) -> None:
        limits = Limits(hold_off_s={Cause.GUARD_LOST: 0.0})
        bench = Bench(limits)
        bench.fly(AUTO)
        bench.flight.guard_said(GuardSeen(GuardState.DISABLED, ours=True), NOW)
        bench.judge(NOW)
        assert bench.safety.emergency.told == Decision(WARN, Cause.GUARD_LOST)
        self.commands(bench, GUIDED)
        bench.safety.handle(ModeSeen(GUIDED, "GUIDED"), 101.5, bench.actions)
        assert bench.safety.emergency._strategy.overruled == frozenset()


class TestCarriedOut:
    def lost(self) -> Bench:
        """The commander is lost: a return is ordered, and not told yet."""
        bench = on_mission()
        bench.told.lost = True
        bench.judge(NOW)
        return bench

    def test_a_return_is_ordered_at_once_and_told_with_the_next_event(self) -> None:
        bench = self.lost()
        assert (flown(bench), told(bench)) == ([RETURN], [])
        assert bench.safety.executor.tells_at() == NOW
        bench.safety.executor.tell_return(NOW, bench.actions)
        assert len(told(bench)) == 1
        assert bench.safety.executor.tells_at() is None
        bench.safety.executor.tell_return(NOW, bench.actions)
        assert told(bench) == []

    def test_a_place_that_is_judged_before_that_is_not_told_twice(self) -> None:
        bench = self.lost()
        bench.safety.handle(PlaceJudged("home", True), NOW, bench.actions)
        assert told(bench) == []
        bench.safety.executor.tell_return(NOW, bench.actions)
        [text] = told(bench)
        assert "home" in text
        bench.safety.handle(PlaceJudged("home", True), NOW, bench.actions)
        assert told(bench) == []

    def test_a_return_that_is_flown_already_is_not_ordered_again(self) -> None:
        bench = Bench()
        bench.fly(RTL)
        bench.told.lost = True
        bench.judge(NOW)
        assert flown(bench) == []
        assert bench.safety.verification.order is RETURN

    def test_the_end_of_the_cause_lets_a_held_aircraft_go_on(self) -> None:
        bench = held_bench()
        assert bench.safety.executor.held_for is Cause.COVERAGE_ENDS
        bench.told.owner = 252
        bench.position(101.0)
        bench.judge(101.0)
        assert flown(bench) == [CONTINUE]
        assert bench.safety.executor.held_for is None
        assert bench.safety.verification.order is CONTINUE

    def test_not_while_a_pilot_flies_it(self) -> None:
        bench = held_bench()
        changes(bench, HANDS, radio=True)
        bench.safety.verification.stands = True
        bench.told.owner = 252
        bench.position(103.0)
        bench.judge(103.0)
        assert flown(bench) == []
        assert not bench.safety.verification.stands

    def test_in_a_rehearsal_nothing_is_ordered(self) -> None:
        bench = on_mission()
        bench.flight.rehearsal_begun()
        bench.position(NOW, ENDS)
        bench.judge(NOW)
        assert flown(bench) == []
        [text] = told(bench)
        assert text.startswith("REHEARSAL: would ")
        bench.safety.executor.rehearsal_over(bench.actions)
        assert told(bench) == ["ALL CLEAR. Over: the rehearsal"]

    def test_without_a_decision_the_end_of_a_rehearsal_is_not_told(self) -> None:
        bench = on_mission()
        bench.safety.executor.rehearsal_over(bench.actions)
        assert told(bench) == []

    def ordered_home(self, mode: ModeClass) -> Bench:
        """A held aircraft was ordered home, and flies this mode now."""
        bench = held_bench()
        bench.told.lost = True
        bench.judge(101.0)
        bench.safety.executor.tell_return(101.0, bench.actions)
        assert flown(bench) == [RETURN]
        bench.safety.mode.flown = mode
        bench.actions.clear()
        return bench

    @pytest.mark.parametrize(("mode", "orders"), [(AUTO, [CONTINUE]), (RTL, [])])
    def test_the_end_of_an_order_home_lets_an_aircraft_go_on_that_still_stands(
        self, mode: ModeClass, orders: list[FlightAction]
    ) -> None:
        bench = self.ordered_home(mode)
        bench.told.lost = False
        bench.told.owner = 252
        bench.position(108.0)  # until 107 the order home need not show
        bench.judge(108.0)
        assert flown(bench) == orders
        assert bench.safety.verification.order is (CONTINUE if orders else None)

    def test_a_warning_of_another_cause_ends_an_order_whose_cause_is_gone(self) -> None:
        bench = Bench(Limits(hold_off_s={Cause.GUARD_LOST: 0.0}))
        bench.fly(AUTO)
        bench.told.lost = True
        bench.judge(NOW)
        assert bench.safety.verification.order is RETURN
        bench.told.lost = False
        bench.position(108.0)
        bench.flight.guard_said(GuardSeen(GuardState.DISABLED, ours=True), 108.0)
        news = bench.judge(108.0)
        assert news is not None
        assert news.decision == Decision(WARN, Cause.GUARD_LOST)
        assert bench.safety.verification.order is None

    def test_an_order_that_the_silent_autopilot_holds_back_stays_in_force(self) -> None:
        bench = self.lost()
        bench.flight._autopilot_at = NOW - 3.0
        bench.judge(101.0)
        assert bench.safety.verification.order is RETURN

    def test_after_a_restart_a_hold_that_became_a_return_is_no_hold_any_more(self) -> None:
        bench = on_mission()
        bench.safety.resume(replace(LEFT, stands=True, held_for=Cause.COVERAGE_ENDS, held_since=80.0))
        bench.told.lost = True
        bench.judge(NOW)
        bench.flight._autopilot_at = NOW - 3.0
        bench.judge(101.0)
        assert bench.safety.resuming
        assert bench.safety.executor.held_for is None

    def test_a_return_that_is_overruled_before_it_is_told_is_not_told(self) -> None:
        bench = self.lost()
        bench.safety.emergency.overrule(bench.safety.facts.now(NOW))
        bench.safety.executor.tell_return(NOW, bench.actions)
        assert told(bench) == []

    def test_a_place_is_told_of_a_return_alone(self) -> None:
        bench = held_bench()
        bench.safety.handle(PlaceJudged("field", True), NOW, bench.actions)
        assert told(bench) == []

    def test_the_mode_of_an_order_is_the_companions_choice(self) -> None:
        bench = self.lost()
        bench.safety.executor.tell_return(NOW, bench.actions)
        told(bench)
        assert changes(bench, RTL) == []
        assert helm(bench) == []
        assert bench.safety.mode.chosen_by is ModeSource.COMPANION

    def test_a_command_from_before_the_order_does_not_overrule_it(self) -> None:
        bench = on_mission()
        bench.safety.handle(ModeSourceSeen(ModeSource.COMMANDER, GUIDED), 99.5, bench.actions)
        bench.told.lost = True
        bench.judge(NOW)
        changes(bench, GUIDED)
        assert helm(bench) == ["GUIDED: the commander asked for it before the order"]
        assert bench.safety.verification.order is RETURN

    def test_an_aircraft_that_circles_shows_a_hold_by_its_mode(self) -> None:
        bench = held_bench()
        bench.flight.autopilot_said(AutopilotState(True, True, "", CIRCLES), NOW)
        bench.safety.mode.flown = ModeClass.STOP
        bench.safety.executor.verify_order(bench.safety.facts.now(NOW), NOW, bench.actions)
        texts = [action.text for action in bench.actions if isinstance(action, Record)]
        assert texts == ["HOLD: the autopilot follows, MISSION"]


class TestVerified:
    def test_an_order_that_does_not_show_is_given_again_and_told_every_ten_seconds(self) -> None:
        bench = Bench(Limits(policies={Cause.COMMANDER_LOST: "land"}))
        bench.fly(AUTO)
        bench.told.lost = True
        bench.judge(NOW)
        bench.actions.clear()
        texts = []
        for now in (105.0, 106.0, 112.0, 118.0):
            bench.says(now)
            assert not bench.safety.executor.verify_order(bench.safety.facts.now(now), now, bench.actions)
            texts.append(told(bench))
        text = "LAND is ordered again. The aircraft has not begun it, in MISSION (commander lost)"
        assert texts == [[], [text], [], [text]]
        assert bench.actions == [Fly(FlightAction.LAND, Reason.COMMANDER_LOST)] * 3

    def test_ten_seconds_after_it_was_told_it_is_told_again(self) -> None:
        bench = Bench(Limits(policies={Cause.COMMANDER_LOST: "land"}, obey_s=5.0))
        bench.fly(AUTO)
        bench.told.lost = True
        bench.judge(NOW)
        told(bench)
        counts = []
        for now in (105.0, 110.0, 115.0):
            bench.says(now)
            bench.safety.executor.verify_order(bench.safety.facts.now(now), now, bench.actions)
            counts.append(len(told(bench)))
        assert counts == [1, 0, 1]

    def test_an_order_to_go_on_has_no_cause_any_more(self) -> None:
        bench = held_bench()
        bench.safety.handle(MotionSeen(0.0, 0.0), NOW, bench.actions)
        bench.told.owner = 252
        bench.position(101.0)
        bench.judge(101.0)
        bench.actions.clear()
        bench.says(107.0)
        bench.safety.executor.verify_order(bench.safety.facts.now(107.0), 107.0, bench.actions)
        assert told(bench) == ["CONTINUE is ordered again. The aircraft has not begun it, in MISSION"]
        assert bench.actions == [Fly(CONTINUE, Reason.NONE)]

    def test_an_order_that_shows_is_journalled(self) -> None:
        bench = on_mission()
        bench.told.lost = True
        bench.judge(NOW)
        bench.fly(RTL)
        assert not bench.safety.executor.verify_order(bench.safety.facts.now(NOW), NOW, bench.actions)
        texts = [action.text for action in bench.actions if isinstance(action, Record) and action.event == "order"]
        assert texts == ["RETURN: the autopilot follows, RETURN"]

    @pytest.mark.parametrize("refused", [True, False])
    def test_an_order_that_is_refused_asks_for_another_decision(self, refused: bool) -> None:
        bench = held_bench()
        if refused:
            bench.safety.verification.refused(HOLD)
        bench.safety.verification.unseen()
        assert bench.safety.executor.verify_order(bench.safety.facts.now(NOW), NOW, bench.actions) is refused
        assert told(bench) == (
            ["HOLD: the autopilot refuses it. The autopilot is in MISSION (coverage ends ahead)"] if refused else []
        )
